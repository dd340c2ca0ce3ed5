// Microfacet normals by the area that the viewer sees of them: spherical caps
// (Dupuy and Benyoub, HPG 2023) and Heitz's disk (JCGT 7(4), 2018).

// Largest f32 below one: what invert may return at most.
const GGX_VISIBLE_ONE_BELOW: f32 = 0.99999994;

// Unit vector along v, or +x if it has no length.
fn ggx_visible_unit(v: vec3f) -> vec3f {
    let square = vec3_dot(v, v);
    if square < GGX_TINY {
        return vec3f(1.0, 0.0, 0.0);
    }
    let scale = 1.0 / sqrt(square);
    return vec3f(v.x * scale, v.y * scale, v.z * scale);
}

// The view direction in the space in which the surface is a hemisphere.
fn ggx_visible_stretch(wo: vec3f, alpha: vec2f) -> vec3f {
    return ggx_visible_unit(vec3f(alpha.x * wo.x, alpha.y * wo.y, wo.z));
}

// The stretched normal of a half vector.
fn ggx_visible_unstretch(h: vec3f, alpha: vec2f) -> vec3f {
    return ggx_visible_unit(vec3f(
        alpha.y * h.x,
        alpha.x * h.y,
        alpha.x * alpha.y * h.z,
    ));
}

// 1 - o.z of a unit vector, without cancelling where it points up.
fn ggx_visible_drop(o: vec3f) -> f32 {
    if o.z > 0.0 {
        return (o.x * o.x + o.y * o.y) / (1.0 + o.z);
    }
    return 1.0 - o.z;
}

// A visible normal by spherical caps.
fn ggx_visible_sample(u: vec2f, wo: vec3f, alpha: vec2f) -> vec3f {
    let o = ggx_visible_stretch(wo, alpha);
    let up = 1.0 + o.z;
    let x = u.x * up;
    let height = (1.0 - u.x) * up;
    let r = sqrt(x * (ggx_visible_drop(o) + height));
    let turn = sincos_turn(u.y);
    let m = vec3f(
        alpha.x * (r * turn.y + o.x),
        alpha.y * (r * turn.x + o.y),
        height,
    );
    return ggx_visible_unit(m);
}

// The u that ggx_visible_sample maps to h; wo.z >= 0.
fn ggx_visible_invert(h: vec3f, wo: vec3f, alpha: vec2f) -> vec2f {
    let o = ggx_visible_stretch(wo, alpha);
    let n = ggx_visible_unstretch(h, alpha);
    let k = 2.0 * vec3_dot(o, n);
    let u = 1.0 - k * n.z / (1.0 + o.z);
    return vec2f(
        clamp(u, 0.0, GGX_VISIBLE_ONE_BELOW),
        atan2_turn(k * n.y - o.y, k * n.x - o.x),
    );
}

// A visible normal by Heitz's disk. wo.z >= 0.
fn ggx_visible_sample_heitz(u: vec2f, wo: vec3f, alpha: vec2f) -> vec3f {
    let o = ggx_visible_stretch(wo, alpha);
    let p = disk_polar_sample(u);
    let frame = ggx_visible_frame(o);
    let s = 0.5 * (1.0 + o.z);
    let rim = sqrt(max((1.0 - p.x) * (1.0 + p.x), 0.0));
    let y = (1.0 - s) * rim + s * p.y;
    let z = sqrt(max((rim - y) * (rim + y), 0.0));
    // cross(o, t) for the tangent t = (c, d, 0).
    let c = frame.x;
    let d = frame.y;
    let n = vec3f(
        (p.x * c - y * (o.z * d)) + z * o.x,
        (p.x * d + y * (o.z * c)) + z * o.y,
        y * (o.x * d - o.y * c) + z * o.z,
    );
    let m = vec3f(alpha.x * n.x, alpha.y * n.y, max(n.z, 0.0));
    return ggx_visible_unit(m);
}

// The tangent across the view direction, its two horizontal components.
fn ggx_visible_frame(o: vec3f) -> vec2f {
    let square = o.x * o.x + o.y * o.y;
    if square < GGX_TINY {
        return vec2f(1.0, 0.0);
    }
    let scale = 1.0 / sqrt(square);
    return vec2f(-o.y * scale, o.x * scale);
}

// The u that ggx_visible_sample_heitz maps to h; wo.z >= 0.
fn ggx_visible_invert_heitz(h: vec3f, wo: vec3f, alpha: vec2f) -> vec2f {
    let o = ggx_visible_stretch(wo, alpha);
    let n = ggx_visible_unstretch(h, alpha);
    let frame = ggx_visible_frame(o);
    let c = frame.x;
    let d = frame.y;
    let x = n.x * c + n.y * d;
    let y = (n.y * c - n.x * d) * o.z + n.z * (o.x * d - o.y * c);
    let s = 0.5 * (1.0 + o.z);
    let rim = sqrt(max((1.0 - x) * (1.0 + x), 0.0));
    return disk_polar_invert(vec2f(x, (y - (1.0 - s) * rim) / s));
}

// Density over half vectors, per steradian; 0 for normals that face away.
fn ggx_visible_pdf(h: vec3f, wo: vec3f, alpha: vec2f) -> f32 {
    let area = ggx_projected_area(wo, alpha);
    if area < GGX_TINY {
        return 0.0;
    }
    return ggx_d(h, alpha) * max(vec3_dot(wo, h), 0.0) / area;
}

// Density of the reflected directions, per steradian; 0 at and below the
// horizon.
fn ggx_visible_direction_pdf(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    return 0.25 * ggx_d_between(wo, wi, alpha) / ggx_projected_area(wo, alpha);
}
