
// A surface at full resolution, for the ready bindings' weight.
struct SpatialReconstructSurface {
    position: vec3f,
    // Plane distance at which a neighbour no longer counts; 0: no surface.
    reach: f32,
    normal: vec3f,
    // GGX's alpha.
    alpha: f32,
    // Unit vector toward the viewer.
    viewer: vec3f,
}

// A GGX lobe (with Kelemen's visibility) times the cosine, and the edge weight
// between the pixel and the surface that the hit was traced from: that of the
// full-resolution pixel 2 at. Define your own for another material.
fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32 {
    let own = spatial_reconstruct_read_surface(pixel);
    let other = spatial_reconstruct_read_surface(vec2u(2u * at.x, 2u * at.y));
    let away = hit.position - own.position;
    if own.reach <= 0.0 || other.reach <= 0.0 || vec3_dot(away, away) <= 0.0 {
        return 0.0;
    }
    let light = vec3_normalize(away);
    let middle = light + own.viewer;
    let cos_light = vec3_dot(own.normal, light);
    if cos_light <= 0.0 || vec3_dot(middle, middle) <= 1e-12 {
        return 0.0;
    }
    let h = vec3_normalize(middle);
    // Sine by the cross product: 1 - cos^2 would cancel in narrow lobes.
    let side = vec3_cross(own.normal, h);
    let c = vec3_dot(own.normal, h);
    let alpha = max(own.alpha, 1e-4);
    let wide = (alpha * alpha) * (c * c) + vec3_dot(side, side);
    let slope = alpha / wide;
    let toward = max(vec3_dot(light, h), 1e-3);
    let lobe = (slope * slope) * 0.31830987 / (4.0 * (toward * toward));
    let edge = spatial_reconstruct_edge(
        own.normal,
        other.normal,
        other.position - own.position,
        own.reach,
    );
    return (lobe * cos_light) * edge;
}
