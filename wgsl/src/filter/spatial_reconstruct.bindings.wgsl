// What filter/spatial_reconstruct asks for, over storage buffers.
//
// A hit takes two vec4f: its position and density, its radiance and 0. A
// full-resolution surface takes three: its position and the plane distance at
// which a neighbour no longer counts (0: no surface), its normal and GGX's
// alpha, the unit vector toward the viewer and 0. layout holds the width of the
// half-resolution image, then that of the full-resolution one.

@group(2) @binding(2) var<storage, read> spatial_reconstruct_hits: array<vec4f>;
@group(2) @binding(3) var<storage, read> spatial_reconstruct_surfaces: array<vec4f>;
@group(2) @binding(4) var<uniform> spatial_reconstruct_layout: vec4u;

// The hit of a half-resolution pixel. Outside the buffer: no ray.
fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit {
    let index = at.y * spatial_reconstruct_layout.x + at.x;
    if index >= arrayLength(&spatial_reconstruct_hits) / 2u {
        return SpatialReconstructHit(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 0.0));
    }
    let where_hit = spatial_reconstruct_hits[2u * index];
    return SpatialReconstructHit(
        where_hit.xyz,
        where_hit.w,
        spatial_reconstruct_hits[2u * index + 1u].xyz,
    );
}

// A GGX lobe (with Kelemen's visibility) times the cosine, and the edge weight
// between the pixel and the surface that the hit was traced from: that of the
// full-resolution pixel 2 at. Define your own for another material.
fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32 {
    let width = spatial_reconstruct_layout.y;
    let index = pixel.y * width + pixel.x;
    let other = (2u * at.y) * width + 2u * at.x;
    let count = arrayLength(&spatial_reconstruct_surfaces) / 3u;
    if index >= count || other >= count {
        return 0.0;
    }
    let place = spatial_reconstruct_surfaces[3u * index];
    let shape = spatial_reconstruct_surfaces[3u * index + 1u];
    let viewer = spatial_reconstruct_surfaces[3u * index + 2u].xyz;
    let other_place = spatial_reconstruct_surfaces[3u * other];
    let other_shape = spatial_reconstruct_surfaces[3u * other + 1u];
    let away = hit.position - place.xyz;
    if place.w <= 0.0 || other_place.w <= 0.0 || vec3_dot(away, away) <= 0.0 {
        return 0.0;
    }
    let normal = shape.xyz;
    let light = vec3_normalize(away);
    let middle = light + viewer;
    let cos_light = vec3_dot(normal, light);
    if cos_light <= 0.0 || vec3_dot(middle, middle) <= 1e-12 {
        return 0.0;
    }
    let h = vec3_normalize(middle);
    // Sine by the cross product: 1 - cos^2 would cancel in narrow lobes.
    let side = vec3_cross(normal, h);
    let c = vec3_dot(normal, h);
    let alpha = max(shape.w, 1e-4);
    let wide = (alpha * alpha) * (c * c) + vec3_dot(side, side);
    let slope = alpha / wide;
    let toward = max(vec3_dot(light, h), 1e-3);
    let lobe = (slope * slope) * 0.31830987 / (4.0 * (toward * toward));
    let edge = spatial_reconstruct_edge(
        normal,
        other_shape.xyz,
        other_place.xyz - place.xyz,
        place.w,
    );
    return (lobe * cos_light) * edge;
}
