// Visible microfacet normals, fewer of them such as reflect below the horizon
// (Eto and Tokuyoshi, SIGGRAPH Asia 2023). For reflection only.

// Largest f32 below one: what invert may return at most.
const GGX_BOUNDED_ONE_BELOW: f32 = 0.99999994;

// How much of the cap's depth below the equator is left out, in [0, 1].
fn ggx_bounded_lift(wo: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 {
        return 0.0;
    }
    let a = min(min(alpha.x, alpha.y), 1.0);
    let s = 1.0 + sqrt(wo.x * wo.x + wo.y * wo.y);
    let square = s * s;
    let az = a * wo.z;
    return a * a * (square + wo.z * wo.z) / (square + az * az);
}

// A visible normal that probably reflects wo upward.
fn ggx_bounded_sample(u: vec2f, wo: vec3f, alpha: vec2f) -> vec3f {
    let o = ggx_visible_stretch(wo, alpha);
    let lift = ggx_bounded_lift(wo, alpha);
    let span = 1.0 + (1.0 - lift) * o.z;
    let x = u.x * span;
    let r = sqrt(max(x * (2.0 - x), 0.0));
    let turn = sincos_turn(u.y);
    let m = vec3f(
        alpha.x * (r * turn.y + o.x),
        alpha.y * (r * turn.x + o.y),
        (1.0 - u.x) * span + lift * o.z,
    );
    return ggx_visible_unit(m);
}

// The u that ggx_bounded_sample maps to h.
fn ggx_bounded_invert(h: vec3f, wo: vec3f, alpha: vec2f) -> vec2f {
    let o = ggx_visible_stretch(wo, alpha);
    let n = ggx_visible_unstretch(h, alpha);
    let k = 2.0 * vec3_dot(o, n);
    let x = (1.0 + o.z) - k * n.z;
    let u = x / (1.0 + (1.0 - ggx_bounded_lift(wo, alpha)) * o.z);
    return vec2f(
        clamp(u, 0.0, GGX_BOUNDED_ONE_BELOW),
        atan2_turn(k * n.y - o.y, k * n.x - o.x),
    );
}

// The area that divides the density.
fn ggx_bounded_area(wo: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 {
        return ggx_projected_area(wo, alpha);
    }
    return 0.5 * ((1.0 - ggx_bounded_lift(wo, alpha)) * wo.z + ggx_stretched(wo, alpha));
}

// Density over half vectors, per steradian, for those that it can give.
fn ggx_bounded_pdf(h: vec3f, wo: vec3f, alpha: vec2f) -> f32 {
    let area = ggx_bounded_area(wo, alpha);
    if area < GGX_TINY {
        return 0.0;
    }
    return ggx_d(h, alpha) * max(vec3_dot(wo, h), 0.0) / area;
}

// Density of the reflected directions, per steradian; 0 at and below the
// horizon.
fn ggx_bounded_direction_pdf(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    return 0.25 * ggx_d_between(wo, wi, alpha) / ggx_bounded_area(wo, alpha);
}
