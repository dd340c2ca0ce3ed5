// Directions over the hemisphere around +z: uniform, or by the cosine
// (Physically Based Rendering, 4th ed., appendix A.5.2 and A.5.3).

// 1/pi and 1/(2 pi).
const HEMISPHERE_INV_PI: f32 = 0.31830987;
const HEMISPHERE_INV_TWO_PI: f32 = 0.15915494;
// Largest f32 below one: what invert may return at most.
const HEMISPHERE_ONE_BELOW: f32 = 0.99999994;

// A direction with density cos/pi. z is 0 only when a component of u is 0; its
// density is then 0 too, so weigh by pi, the ratio, and never divide.
fn hemisphere_cosine_sample(u: vec2f) -> vec3f {
    let p = disk_concentric_sample(u);
    let r = max(abs(2.0 * u.x - 1.0), abs(2.0 * u.y - 1.0));
    return vec3f(p.x, p.y, sqrt((1.0 - r) * (1.0 + r)));
}

// Density of hemisphere_cosine_sample per steradian.
fn hemisphere_cosine_pdf(direction: vec3f) -> f32 {
    return max(direction.z, 0.0) * HEMISPHERE_INV_PI;
}

// The u that hemisphere_cosine_sample maps to direction.
fn hemisphere_cosine_invert(direction: vec3f) -> vec2f {
    return disk_concentric_invert(vec2f(direction.x, direction.y));
}

// A direction with the same density everywhere: z = 1 - u.x.
fn hemisphere_uniform_sample(u: vec2f) -> vec3f {
    let r = sqrt(u.x * (2.0 - u.x));
    let turn = sincos_turn(u.y);
    return vec3f(r * turn.y, r * turn.x, 1.0 - u.x);
}

// Density of hemisphere_uniform_sample per steradian.
fn hemisphere_uniform_pdf(direction: vec3f) -> f32 {
    if direction.z < 0.0 {
        return 0.0;
    }
    return HEMISPHERE_INV_TWO_PI;
}

// The u that hemisphere_uniform_sample maps to direction.
fn hemisphere_uniform_invert(direction: vec3f) -> vec2f {
    return vec2f(
        clamp(1.0 - direction.z, 0.0, HEMISPHERE_ONE_BELOW),
        atan2_turn(direction.y, direction.x),
    );
}
