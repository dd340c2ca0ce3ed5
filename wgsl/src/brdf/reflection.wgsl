// Reflection rays: one below the horizon gets an alternative, the sample space
// may be trimmed toward the mirror, and roughness decides whether a ray is
// worth it (PICA PICA, Ray Tracing Gems 2019, 25.2.2). Normal = +z.

// A mirror: one ray, no density, no denoising.
const REFLECTION_MIRROR: u32 = 0u;
// Glossy: a sampled ray.
const REFLECTION_SAMPLED: u32 = 1u;
// Rough: no ray, a diffuse lookup.
const REFLECTION_DIFFUSE: u32 = 2u;

// A reflection ray.
struct ReflectionRay {
    // Toward the light; unit.
    direction: vec3f,
    // Density of the direction, however it came about; 0 if it is to be dropped.
    pdf: f32,
    // 1 if the ray first drawn pointed below the horizon, else 0.
    below: u32,
}

// What to do at a surface of this perceptual roughness.
fn reflection_kind(roughness: f32, mirror: f32, diffuse: f32) -> u32 {
    if roughness < mirror {
        return REFLECTION_MIRROR;
    }
    if roughness > diffuse {
        return REFLECTION_DIFFUSE;
    }
    return REFLECTION_SAMPLED;
}

// A reflection by visible normals that is never below the horizon: there the
// direction mirrored at the surface is the alternative.
fn reflection_sample(u: vec2f, wo: vec3f, alpha: vec2f) -> ReflectionRay {
    let d = ggx_reflect(wo, ggx_visible_sample(u, wo, alpha));
    let direction = vec3f(d.x, d.y, abs(d.z));
    return ReflectionRay(
        direction,
        reflection_pdf(wo, direction, alpha),
        u32(d.z < 0.0),
    );
}

// Density of reflection_sample: that of wi and that of its mirror image below
// the surface. 0 below the horizon.
fn reflection_pdf(wo: vec3f, wi: vec3f, alpha: vec2f) -> f32 {
    if wo.z <= 0.0 || wi.z < 0.0 {
        return 0.0;
    }
    let image = vec3f(wi.x, wi.y, -wi.z);
    let d = ggx_d_between(wo, wi, alpha) + ggx_d_between(wo, image, alpha);
    return 0.25 * d / ggx_projected_area(wo, alpha);
}

// A reflection by the normal distribution with its sample space trimmed to the
// part trim, in (0, 1], nearest to the mirror direction.
fn reflection_trimmed_sample(u: vec2f, wo: vec3f, alpha: vec2f, trim: f32) -> ReflectionRay {
    let d = ggx_reflect(wo, ggx_ndf_sample(vec2f(u.x * trim, u.y), alpha));
    let below = d.z <= 0.0;
    return ReflectionRay(
        d,
        select(ggx_ndf_direction_pdf(wo, d, alpha) / trim, 0.0, below),
        u32(below),
    );
}

// Density of reflection_trimmed_sample; 0 outside of the trimmed part, whose
// rim counts as 2^-18 wide, and at or below the horizon.
fn reflection_trimmed_pdf(wo: vec3f, wi: vec3f, alpha: vec2f, trim: f32) -> f32 {
    let m = vec3f(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let x = alpha.y * m.x;
    let y = alpha.x * m.y;
    let z = alpha.x * alpha.y * m.z;
    let side = x * x + y * y;
    // The radius that the normal was drawn with, side / (side + z^2).
    if side > trim * (1.0 + 1.0 / 262144.0) * (side + z * z) {
        return 0.0;
    }
    return ggx_ndf_direction_pdf(wo, wi, alpha) / trim;
}
