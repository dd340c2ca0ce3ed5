// Uniform directions in a cone around the z axis, for disc-like lights
// (Physically Based Rendering, 4th ed., appendix A.5.4, reparametrised). The
// cone is given by 1 - cos of its half-angle, in (0, 2]: stored as a cosine,
// the Sun's cone keeps 182 distinct radii of 4096, in this form all of them.

// 1/(2 pi) and 1/(4 pi).
const CONE_INV_TWO_PI: f32 = 0.15915494;
const CONE_INV_FOUR_PI: f32 = 0.07957747;
// Largest f32 below one: what invert may return at most.
const CONE_ONE_BELOW: f32 = 0.99999994;

// 1 - cos of a half-angle in radians, [0, pi], without cancellation.
fn cone_one_minus_cos(half_angle: f32) -> f32 {
    // 2 sin^2(a/2), and a/2 radians are a/(4 pi) turns.
    let s = sincos_turn(half_angle * CONE_INV_FOUR_PI).x;
    return 2.0 * (s * s);
}

// 1 - cos of the cone that a sphere fills, from the sine of its half-angle:
// radius over distance, [0, 1].
fn cone_one_minus_cos_from_sin(sin_half_angle: f32) -> f32 {
    let s = sin_half_angle * sin_half_angle;
    return s / (1.0 + sqrt((1.0 - sin_half_angle) * (1.0 + sin_half_angle)));
}

// A uniform direction within the cone around +z.
fn cone_sample(u: vec2f, one_minus_cos: f32) -> vec3f {
    let x = u.x * one_minus_cos;
    // 2 - x without cancellation at the far pole.
    let rest = (2.0 - one_minus_cos) + (1.0 - u.x) * one_minus_cos;
    let r = sqrt(x * rest);
    let turn = sincos_turn(u.y);
    return vec3f(r * turn.y, r * turn.x, 1.0 - x);
}

// 1 - z of a unit vector; near the pole from x and y, where z says little.
fn cone_height(direction: vec3f) -> f32 {
    let s = direction.x * direction.x + direction.y * direction.y;
    if direction.z > 0.0 {
        return s / (1.0 + direction.z);
    }
    return 1.0 - direction.z;
}

// Density per steradian: 1/(2 pi one_minus_cos) in the cone, 0 outside. The
// rim is taken 2^-19 wide (relative), since a sample on it may round outward.
fn cone_pdf(direction: vec3f, one_minus_cos: f32) -> f32 {
    if cone_height(direction) > one_minus_cos * (1.0 + 1.0 / 524288.0) {
        return 0.0;
    }
    return CONE_INV_TWO_PI / one_minus_cos;
}

// The u that cone_sample maps to direction; the axis' azimuth is 0.
fn cone_invert(direction: vec3f, one_minus_cos: f32) -> vec2f {
    return vec2f(
        clamp(cone_height(direction) / one_minus_cos, 0.0, CONE_ONE_BELOW),
        atan2_turn(direction.y, direction.x),
    );
}
