// Diffuse reflection: the same radiance in all directions.

// 1/pi.
const LAMBERT_INV_PI: f32 = 0.31830987;

// The BRDF, without the cosine.
fn lambert_eval(albedo: vec3f) -> vec3f {
    return vec3f(
        albedo.x * LAMBERT_INV_PI,
        albedo.y * LAMBERT_INV_PI,
        albedo.z * LAMBERT_INV_PI,
    );
}

// A direction toward the light by the cosine; its weight is the albedo.
fn lambert_sample(u: vec2f) -> vec3f {
    return hemisphere_cosine_sample(u);
}

// Density of lambert_sample per steradian, 0 below the horizon.
fn lambert_pdf(wi: vec3f) -> f32 {
    return hemisphere_cosine_pdf(wi);
}

// The u that lambert_sample maps to wi.
fn lambert_invert(wi: vec3f) -> vec2f {
    return hemisphere_cosine_invert(wi);
}
