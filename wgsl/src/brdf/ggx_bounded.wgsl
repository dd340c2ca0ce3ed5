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
    let deep = lift * o.z;
    let height = (1.0 - u.x) * span;
    let r = sqrt(x * ((ggx_visible_drop(o) + deep) + height));
    let turn = sincos_turn(u.y);
    let m = vec3f(
        alpha.x * (r * turn.y + o.x),
        alpha.y * (r * turn.x + o.y),
        height + deep,
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

// 1/2pi.
const GGX_BOUNDED_INV_TWO_PI: f32 = 0.15915494;

// A reflected direction with its density.
struct GgxBoundedDirection {
    // Toward the light; unit.
    direction: vec3f,
    // Per steradian; 0 for a sample that is to be dropped.
    pdf: f32,
}

// ggx_bounded_sample, reflected, with ggx_bounded_direction_pdf, from the same
// lengths: wo.m is |wo|_s n^2/2, and D is (m^2/n^2)^2 / (pi ax ay).
fn ggx_bounded_direction_sample(u: vec2f, wo: vec3f, alpha: vec2f) -> GgxBoundedDirection {
    // From below nothing is drawn; computed all the same, so that a loop over
    // this has no branch.
    let z = max(wo.z, 0.0);
    let wide = vec2f(alpha.x * wo.x, alpha.y * wo.y);
    let side = wide.x * wide.x + wide.y * wide.y;
    let length = sqrt(side + z * z);
    let up = length + z;
    // One quotient for 1/length and for 1 - oz.
    let inverse = 1.0 / max(length * up, GGX_TINY);
    let scale = inverse * up;
    let ox = wide.x * scale;
    let oy = wide.y * scale;
    let oz = z * scale;
    // ggx_bounded_lift.
    let a = min(min(alpha.x, alpha.y), 1.0);
    let s = 1.0 + sqrt(wo.x * wo.x + wo.y * wo.y);
    let square = s * s;
    let az = a * z;
    let lift = a * a * (square + z * z) / (square + az * az);
    let kept = 1.0 - lift;
    let span = 1.0 + kept * oz;
    let x = u.x * span;
    let deep = lift * oz;
    let height = (1.0 - u.x) * span;
    let drop = side * inverse;
    let r = sqrt(x * ((drop + deep) + height));
    let turn = sincos_turn(u.y);
    let n = vec3f(r * turn.y + ox, r * turn.x + oy, height + deep);
    let m = vec3f(alpha.x * n.x, alpha.y * n.y, n.z);
    let ratio = vec3_dot(n, n) / max(vec3_dot(m, m), GGX_TINY);
    let to = length * ratio;
    let direction = vec3f(to * m.x - wo.x, to * m.y - wo.y, to * m.z - wo.z);
    let area = alpha.x * alpha.y * (kept * z + length);
    let pdf = GGX_BOUNDED_INV_TWO_PI / max(ratio * ratio * area, GGX_TINY);
    let drawn = wo.z > 0.0 && direction.z > 0.0;
    return GgxBoundedDirection(direction, select(0.0, pdf, drawn));
}

// Density of the reflected directions, per steradian; 0 at and below the
// horizon.
fn ggx_bounded_direction_pdf(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    return 0.25 * ggx_d_between(wo, wi, alpha) / ggx_bounded_area(wo, alpha);
}
