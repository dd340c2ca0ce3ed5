// The Trowbridge-Reitz (GGX) microfacet distribution: density, masking,
// visibility. Shading frame: normal = +z; wo toward the viewer, wi toward the
// light, both away from the surface; alpha is the roughness along x and y.
// Walter et al., EGSR 2007; Heitz, JCGT 3(2), 2014.

// 1/pi.
const GGX_INV_PI: f32 = 0.31830987;
// Stands in for zero where something divides.
const GGX_TINY: f32 = 1e-30;
// Smallest roughness that these functions take.
const GGX_ALPHA_MIN: f32 = 1e-4;
// Below this roughness along both axes a surface is a mirror.
const GGX_MIRROR_ALPHA: f32 = 1e-3;

// Roughness along x and y from perceptual roughness and anisotropy in [0, 1].
fn ggx_alpha(roughness: f32, anisotropy: f32) -> vec2f {
    let square = roughness * roughness;
    let aspect = sqrt(1.0 - 0.9 * anisotropy);
    return vec2f(
        max(square / aspect, GGX_ALPHA_MIN),
        max(square * aspect, GGX_ALPHA_MIN),
    );
}

// 1 if the surface is to be treated as a mirror, else 0.
fn ggx_is_mirror(alpha: vec2f) -> u32 {
    return u32(alpha.x < GGX_MIRROR_ALPHA && alpha.y < GGX_MIRROR_ALPHA);
}

// The half vector of two unit directions; +z if they are opposite.
fn ggx_half(wo: vec3f, wi: vec3f) -> vec3f {
    let m = vec3f(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let square = vec3_dot(m, m);
    if square < GGX_TINY {
        return vec3f(0.0, 0.0, 1.0);
    }
    let scale = 1.0 / sqrt(square);
    return vec3f(m.x * scale, m.y * scale, m.z * scale);
}

// wo mirrored about h.
fn ggx_reflect(wo: vec3f, h: vec3f) -> vec3f {
    let k = 2.0 * vec3_dot(wo, h);
    return vec3f(k * h.x - wo.x, k * h.y - wo.y, k * h.z - wo.z);
}

// Density of microfacet normals; 0 where h.z <= 0. A sum of positive terms.
fn ggx_d(h: vec3f, alpha: vec2f) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let x = h.x / alpha.x;
    let y = h.y / alpha.y;
    let s = (x * x + y * y) + h.z * h.z;
    return GGX_INV_PI / ((alpha.x * alpha.y) * (s * s));
}

// ggx_d of the half vector of two directions, without normalising it. 0 if it
// points below the surface or the directions are opposite.
fn ggx_d_between(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    let m = vec3f(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let square = vec3_dot(m, m);
    if m.z <= 0.0 || square < GGX_TINY {
        return 0.0;
    }
    let x = m.x / alpha.x;
    let y = m.y / alpha.y;
    let k = square / ((x * x + y * y) + m.z * m.z);
    return GGX_INV_PI * (k * k) / (alpha.x * alpha.y);
}

// ggx_d with one roughness.
fn ggx_d_isotropic(h: vec3f, alpha: f32) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let z = alpha * h.z;
    let p = (h.x * h.x + h.y * h.y) + z * z;
    return GGX_INV_PI * (alpha * alpha) / (p * p);
}

// Length of a direction as the stretched surface sees it.
fn ggx_stretched(w: vec3f, alpha: vec2f) -> f32 {
    let x = alpha.x * w.x;
    let y = alpha.y * w.y;
    return sqrt((x * x + y * y) + w.z * w.z);
}

// Area of the microfacets that face a direction, as seen from there and per
// area of the surface; also from below, where the plain sum would cancel.
fn ggx_projected_area(w: vec3f, alpha: vec2f) -> f32 {
    let x = alpha.x * w.x;
    let y = alpha.y * w.y;
    let side = x * x + y * y;
    let length = sqrt(side + w.z * w.z);
    if w.z >= 0.0 {
        return 0.5 * (w.z + length);
    }
    return 0.5 * side / (length - w.z);
}

// Smith's Lambda; 1 + Lambda(-w) below the surface.
fn ggx_lambda(w: vec3f, alpha: vec2f) -> f32 {
    let x = alpha.x * w.x;
    let y = alpha.y * w.y;
    let side = x * x + y * y;
    let z = max(abs(w.z), 1e-7);
    let length = sqrt(side + z * z);
    let up = side / (2.0 * z * (z + length));
    return select(up, 1.0 + up, w.z < 0.0);
}

// Smith's masking, the same from both sides, 0 along the surface.
fn ggx_g1(w: vec3f, alpha: vec2f) -> f32 {
    let z = abs(w.z);
    return 2.0 * z / (z + ggx_stretched(w, alpha));
}

// Height-correlated masking and shadowing.
fn ggx_g2(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    let o = wi.z * ggx_stretched(wo, alpha);
    let i = wo.z * ggx_stretched(wi, alpha);
    return 2.0 * (wo.z * wi.z) / max(o + i, GGX_TINY);
}

// G2 / (4 cos cos), finite down to the horizon.
fn ggx_visibility(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    let o = wi.z * ggx_stretched(wo, alpha);
    let i = wo.z * ggx_stretched(wi, alpha);
    return 0.5 / max(o + i, GGX_TINY);
}

// ggx_visibility with one roughness, from the two cosines.
fn ggx_visibility_isotropic(cos_o: f32, cos_i: f32, alpha: f32) -> f32 {
    let a = alpha * alpha;
    let o = cos_i * sqrt(a * ((1.0 - cos_o) * (1.0 + cos_o)) + cos_o * cos_o);
    let i = cos_o * sqrt(a * ((1.0 - cos_i) * (1.0 + cos_i)) + cos_i * cos_i);
    return 0.5 / max(o + i, GGX_TINY);
}
