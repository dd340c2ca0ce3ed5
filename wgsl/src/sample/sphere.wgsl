// Uniform directions on the unit sphere (Physically Based Rendering, 4th ed.,
// appendix A.5.2), with the sine in a form that does not cancel at the poles.

// 1/(4 pi).
const SPHERE_INV_FOUR_PI: f32 = 0.07957747;
// Largest f32 below one: what invert may return at most.
const SPHERE_ONE_BELOW: f32 = 0.99999994;

// A uniform direction: z falls from 1 with u.x, the azimuth is u.y turns.
fn sphere_sample(u: vec2f) -> vec3f {
    let z = 1.0 - 2.0 * u.x;
    let r = 2.0 * sqrt(u.x * (1.0 - u.x));
    let turn = sincos_turn(u.y);
    return vec3f(r * turn.y, r * turn.x, z);
}

// Density per steradian: 1/(4 pi), everywhere.
fn sphere_pdf(direction: vec3f) -> f32 {
    return SPHERE_INV_FOUR_PI;
}

// The u that sphere_sample maps to direction; a pole's azimuth is 0.
fn sphere_invert(direction: vec3f) -> vec2f {
    return vec2f(
        clamp(0.5 - 0.5 * direction.z, 0.0, SPHERE_ONE_BELOW),
        atan2_turn(direction.y, direction.x),
    );
}
