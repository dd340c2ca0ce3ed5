// The specular microfacet BRDF, and what a sample of it weighs. Shading frame:
// normal = +z, wo toward the viewer, wi toward the light.

// Stands in for zero where something divides.
const COOK_TORRANCE_TINY: f32 = 1e-30;

// Schlick's term: half the length of wo + wi is the cosine to the half vector.
fn cook_torrance_fresnel(wo: vec3f, wi: vec3f, f0: vec3f) -> vec3f {
    let m = vec3f(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    return fresnel_schlick(f0, 0.5 * vec3_length(m));
}

// D F G2 / (4 cos cos), without the cosine; 0 at and below the horizon.
fn cook_torrance_eval(wo: vec3f, wi: vec3f, alpha: vec2f, f0: vec3f) -> vec3f {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return vec3f(0.0);
    }
    let f = cook_torrance_fresnel(wo, wi, f0);
    let dv = ggx_d_between(wo, wi, alpha) * ggx_visibility(wo, wi, alpha);
    return vec3f(f.x * dv, f.y * dv, f.z * dv);
}

// F times a number; 0 at and below the horizon.
fn cook_torrance_scaled(wo: vec3f, wi: vec3f, f0: vec3f, scale: f32) -> vec3f {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return vec3f(0.0);
    }
    let f = cook_torrance_fresnel(wo, wi, f0);
    return vec3f(f.x * scale, f.y * scale, f.z * scale);
}

// Value * cosine / density of a sample of the normal distribution.
fn cook_torrance_weight_ndf(wo: vec3f, wi: vec3f, alpha: vec2f, f0: vec3f) -> vec3f {
    let m = vec3f(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let o = wi.z * ggx_stretched(wo, alpha);
    let i = wo.z * ggx_stretched(wi, alpha);
    let scale = wi.z * vec3_dot(m, m) / max(m.z * (o + i), COOK_TORRANCE_TINY);
    return cook_torrance_scaled(wo, wi, f0, scale);
}

// The same of a sample of the visible normals: at most F.
fn cook_torrance_weight_visible(wo: vec3f, wi: vec3f, alpha: vec2f, f0: vec3f) -> vec3f {
    let length = ggx_stretched(wo, alpha);
    let o = wi.z * length;
    let i = wo.z * ggx_stretched(wi, alpha);
    let scale = wi.z * (wo.z + length) / max(o + i, COOK_TORRANCE_TINY);
    return cook_torrance_scaled(wo, wi, f0, scale);
}

// The same of a sample of the bounded visible normals: at most F.
fn cook_torrance_weight_bounded(wo: vec3f, wi: vec3f, alpha: vec2f, f0: vec3f) -> vec3f {
    let length = ggx_stretched(wo, alpha);
    let o = wi.z * length;
    let i = wo.z * ggx_stretched(wi, alpha);
    let kept = (1.0 - ggx_bounded_lift(wo, alpha)) * wo.z;
    let scale = wi.z * (kept + length) / max(o + i, COOK_TORRANCE_TINY);
    return cook_torrance_scaled(wo, wi, f0, scale);
}
