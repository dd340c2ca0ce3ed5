// Microfacet normals by their distribution (Walter et al., EGSR 2007).

// Largest f32 below one: what invert may return at most.
const GGX_NDF_ONE_BELOW: f32 = 0.99999994;

// A microfacet normal; u.x = 0 is the surface's, u.y the azimuth.
fn ggx_ndf_sample(u: vec2f, alpha: vec2f) -> vec3f {
    let r = sqrt(u.x);
    let turn = sincos_turn(u.y);
    let x = alpha.x * (r * turn.y);
    let y = alpha.y * (r * turn.x);
    let square = 1.0 - u.x;
    let scale = 1.0 / sqrt((x * x + y * y) + square);
    return vec3f(x * scale, y * scale, sqrt(square) * scale);
}

// Density over half vectors, per steradian.
fn ggx_ndf_pdf(h: vec3f, alpha: vec2f) -> f32 {
    return ggx_d(h, alpha) * h.z;
}

// Density of the reflected directions, per steradian; 0 at and below the
// horizon.
fn ggx_ndf_direction_pdf(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let m = vec3f(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    // cos / (4 wo.h) = m.z / (2 |m|^2), since |m| = 2 wo.h.
    return ggx_d_between(wo, wi, alpha) * m.z / (2.0 * vec3_dot(m, m));
}

// The u that ggx_ndf_sample maps to h, h.z >= 0.
fn ggx_ndf_invert(h: vec3f, alpha: vec2f) -> vec2f {
    let x = alpha.y * h.x;
    let y = alpha.x * h.y;
    let z = alpha.x * alpha.y * h.z;
    let side = x * x + y * y;
    let u = side / (side + z * z);
    return vec2f(min(u, GGX_NDF_ONE_BELOW), atan2_turn(y, x));
}
