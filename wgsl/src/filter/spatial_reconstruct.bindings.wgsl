// What filter/spatial_reconstruct asks for, over storage buffers.
//
// A hit takes a vec4f, its position and density, its radiance another one. A
// full-resolution surface takes three: its position and the plane distance at
// which a neighbour no longer counts (0: no surface), its normal and GGX's
// alpha, the unit vector toward the viewer and 0. layout holds the width of the
// half-resolution image, then that of the full-resolution one.

@group(2) @binding(2) var<storage, read> spatial_reconstruct_hits: array<vec4f>;
@group(2) @binding(70) var<storage, read> spatial_reconstruct_radiances: array<vec4f>;
@group(2) @binding(3) var<storage, read> spatial_reconstruct_surfaces: array<vec4f>;
@group(2) @binding(4) var<uniform> spatial_reconstruct_layout: vec4u;

// The hit of a half-resolution pixel. Outside the buffer: no ray.
fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit {
    let index = at.y * spatial_reconstruct_layout.x + at.x;
    if index >= arrayLength(&spatial_reconstruct_hits)
        || index >= arrayLength(&spatial_reconstruct_radiances) {
        return SpatialReconstructHit(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 0.0));
    }
    let where_hit = spatial_reconstruct_hits[index];
    return SpatialReconstructHit(
        where_hit.xyz,
        where_hit.w,
        spatial_reconstruct_radiances[index].xyz,
    );
}

// The surface of a full-resolution pixel. Outside the buffer: none.
fn spatial_reconstruct_read_surface(at: vec2u) -> SpatialReconstructSurface {
    let index = at.y * spatial_reconstruct_layout.y + at.x;
    if index >= arrayLength(&spatial_reconstruct_surfaces) / 3u {
        return SpatialReconstructSurface(
            vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 1.0, vec3f(0.0, 0.0, 1.0),
        );
    }
    let place = spatial_reconstruct_surfaces[3u * index];
    let shape = spatial_reconstruct_surfaces[3u * index + 1u];
    let viewer = spatial_reconstruct_surfaces[3u * index + 2u];
    return SpatialReconstructSurface(place.xyz, place.w, shape.xyz, shape.w, viewer.xyz);
}

// For the pass: the results.
@group(2) @binding(73) var<storage, read_write> spatial_reconstruct_results: array<vec4f>;

fn spatial_reconstruct_write(at: vec2u, result: vec4f) {
    let index = at.y * spatial_reconstruct_layout.y + at.x;
    if index < arrayLength(&spatial_reconstruct_results) {
        spatial_reconstruct_results[index] = result;
    }
}
