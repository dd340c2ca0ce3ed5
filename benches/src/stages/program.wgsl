// The stages of the report, one entry point each. Appended to what they use:
// ray/bvh with its bindings (group 2), ray/camera, the samples, the random
// numbers and math/exponent. program.rs is the twin: the same functions in the
// same order.

struct StageParameters {
    camera: Camera,
    // Unit vector towards the middle of the light, and 1 - cos of its radius.
    light_direction: vec3f,
    light_one_minus_cos: f32,
    // Start of secondary rays, in units of the scene.
    offset: f32,
    ao_distance: f32,
    ao_power: f32,
    width: u32,
    height: u32,
    // 0 white noise, 1 Halton with rotation, 2 regular grid.
    sampler_kind: u32,
    // Samples a pixel in all, and for the grid their square root.
    samples: u32,
    grid_side: u32,
    frame: u32,
    // What this dispatch does.
    first_row: u32,
    first_sample: u32,
    sample_count: u32,
}

// What a pixel sees; two vec4f in the buffer.
struct StageSurface {
    position: vec3f,
    // 1 where there is a surface.
    hit: f32,
    // Geometric, towards the eye.
    normal: vec3f,
    distance: f32,
}

@group(0) @binding(0) var<storage, read> parameters: StageParameters;
// Geometric normals by primitive.
@group(0) @binding(1) var<storage, read> stage_normals: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> stage_surfaces: array<vec4f>;
// Colours in the primary stage, else sums over the samples.
@group(0) @binding(3) var<storage, read_write> stage_sums: array<f32>;

const STAGE_SAMPLER_WHITE: u32 = 0u;
const STAGE_SAMPLER_HALTON: u32 = 1u;
const STAGE_FRAME_LOOP: u32 = 4u;
const STAGE_OFFSET_PRECISION: f32 = 0x1p-18f;

fn stage_random(p: StageParameters, pixel: vec2u, sample: u32) -> vec2f {
    if p.sampler_kind == STAGE_SAMPLER_WHITE {
        let a = pcg_next(pcg_seed(pixel, p.frame * p.samples + sample));
        let b = pcg_next(a.state);
        return vec2f(pcg_unit(a.value), pcg_unit(b.value));
    }
    if p.sampler_kind == STAGE_SAMPLER_HALTON {
        let state = halton_init(pixel.x, pixel.y, sample, p.samples, p.frame, STAGE_FRAME_LOOP);
        let x = halton_next(state);
        let y = halton_next(x.state);
        let a = pcg_next(pcg_seed(pixel, p.frame));
        let b = pcg_next(a.state);
        return vec2f(
            halton_rotate(x.value, pcg_unit(a.value)),
            halton_rotate(y.value, pcg_unit(b.value)),
        );
    }
    let side = f32(p.grid_side);
    return vec2f(
        (f32(sample % p.grid_side) + 0.5) / side,
        (f32(sample / p.grid_side) + 0.5) / side,
    );
}

fn stage_offset(p: StageParameters, position: vec3f) -> f32 {
    return max(p.offset, vec3_length(position) * STAGE_OFFSET_PRECISION);
}

fn stage_surface(p: StageParameters, pixel: vec2u) -> StageSurface {
    let ray = camera_ray(vec2f(f32(pixel.x) + 0.5, f32(pixel.y) + 0.5), p.camera);
    let hit = bvh_closest(ray);
    if hit.primitive == BVH_MISS {
        return StageSurface(ray.direction, 0.0, vec3f(0.0), 0.0);
    }
    let n = stage_normals[hit.primitive].xyz;
    let away = vec3_dot(n, ray.direction) > 0.0;
    return StageSurface(
        ray_at(ray, hit.t),
        1.0,
        vec3f(select(n.x, -n.x, away), select(n.y, -n.y, away), select(n.z, -n.z, away)),
        hit.t,
    );
}

fn stage_shade(p: StageParameters, s: StageSurface, light: f32, open: f32) -> vec3f {
    if s.hit == 0.0 {
        // position holds the direction.
        let up = 0.5 + 0.5 * s.position.y;
        return vec3f(0.60 - 0.34 * up, 0.68 - 0.30 * up, 0.78 - 0.22 * up);
    }
    let up = 0.5 + 0.5 * s.normal.y;
    let key = max(vec3_dot(s.normal, p.light_direction), 0.0) * light;
    return vec3f(
        (0.18 + 0.13 * up) * open + 0.62 * key,
        (0.16 + 0.17 * up) * open + 0.55 * key,
        (0.15 + 0.22 * up) * open + 0.45 * key,
    );
}

fn stage_faces_light(p: StageParameters, s: StageSurface) -> bool {
    return s.hit != 0.0 && vec3_dot(s.normal, p.light_direction) > 0.0;
}

fn stage_light_visible(p: StageParameters, s: StageSurface, direction: vec3f) -> f32 {
    let ray = Ray(s.position, direction, stage_offset(p, s.position), CAMERA_FAR);
    return select(1.0, 0.0, bvh_any(ray) != 0u);
}

fn stage_soft_shadow_sample(p: StageParameters, s: StageSurface, u: vec2f) -> f32 {
    let light = p.light_direction;
    let local = cone_sample(u, p.light_one_minus_cos);
    let direction = basis_to_world(basis_from_normal(light), light, local);
    // The part of the light below the surface's horizon gives it nothing.
    if vec3_dot(s.normal, direction) <= 0.0 {
        return 0.0;
    }
    return stage_light_visible(p, s, direction);
}

fn stage_ao_ray(p: StageParameters, s: StageSurface, u: vec2f) -> Ray {
    let local = hemisphere_cosine_sample(u);
    let direction = basis_to_world(basis_from_normal(s.normal), s.normal, local);
    let t_min = stage_offset(p, s.position);
    return Ray(s.position, direction, t_min, max(p.ao_distance, t_min));
}

fn stage_ao_sample(p: StageParameters, s: StageSurface, u: vec2f) -> f32 {
    return select(1.0, 0.0, bvh_any(stage_ao_ray(p, s, u)) != 0u);
}

fn stage_ao_power_sample(p: StageParameters, s: StageSurface, u: vec2f) -> f32 {
    let hit = bvh_closest(stage_ao_ray(p, s, u));
    if hit.primitive == BVH_MISS {
        return 1.0;
    }
    return pow_poly(hit.t / p.ao_distance, p.ao_power);
}

fn stage_pixel(id: vec3u) -> vec2u {
    return vec2u(id.x, id.y + parameters.first_row);
}

fn stage_outside(pixel: vec2u) -> bool {
    return pixel.x >= parameters.width || pixel.y >= parameters.height;
}

fn stage_load(pixel: vec2u) -> StageSurface {
    let at = 2u * (pixel.y * parameters.width + pixel.x);
    let a = stage_surfaces[at];
    let b = stage_surfaces[at + 1u];
    return StageSurface(a.xyz, a.w, b.xyz, b.w);
}

// The sum of the dispatches before this one.
fn stage_sum_before(pixel: vec2u) -> f32 {
    if parameters.first_sample == 0u {
        return 0.0;
    }
    return stage_sums[pixel.y * parameters.width + pixel.x];
}

@compute @workgroup_size(8, 8)
fn stage_primary(@builtin(global_invocation_id) id: vec3u) {
    let pixel = stage_pixel(id);
    if stage_outside(pixel) {
        return;
    }
    let s = stage_surface(parameters, pixel);
    let at = pixel.y * parameters.width + pixel.x;
    stage_surfaces[2u * at] = vec4f(s.position, s.hit);
    stage_surfaces[2u * at + 1u] = vec4f(s.normal, s.distance);
    let colour = stage_shade(parameters, s, 1.0, 1.0);
    stage_sums[3u * at] = colour.x;
    stage_sums[3u * at + 1u] = colour.y;
    stage_sums[3u * at + 2u] = colour.z;
}

@compute @workgroup_size(8, 8)
fn stage_hard_shadow(@builtin(global_invocation_id) id: vec3u) {
    let pixel = stage_pixel(id);
    if stage_outside(pixel) {
        return;
    }
    let s = stage_load(pixel);
    var sum = select(1.0, 0.0, s.hit != 0.0);
    if stage_faces_light(parameters, s) {
        sum = stage_light_visible(parameters, s, parameters.light_direction);
    }
    stage_sums[pixel.y * parameters.width + pixel.x] = sum;
}

@compute @workgroup_size(8, 8)
fn stage_soft_shadow(@builtin(global_invocation_id) id: vec3u) {
    let pixel = stage_pixel(id);
    if stage_outside(pixel) {
        return;
    }
    let s = stage_load(pixel);
    var sum = stage_sum_before(pixel);
    for (var i = 0u; i < parameters.sample_count; i += 1u) {
        if stage_faces_light(parameters, s) {
            let u = stage_random(parameters, pixel, parameters.first_sample + i);
            sum += stage_soft_shadow_sample(parameters, s, u);
        } else {
            sum += select(1.0, 0.0, s.hit != 0.0);
        }
    }
    stage_sums[pixel.y * parameters.width + pixel.x] = sum;
}

@compute @workgroup_size(8, 8)
fn stage_ao(@builtin(global_invocation_id) id: vec3u) {
    let pixel = stage_pixel(id);
    if stage_outside(pixel) {
        return;
    }
    let s = stage_load(pixel);
    var sum = stage_sum_before(pixel);
    for (var i = 0u; i < parameters.sample_count; i += 1u) {
        if s.hit != 0.0 {
            let u = stage_random(parameters, pixel, parameters.first_sample + i);
            sum += stage_ao_sample(parameters, s, u);
        } else {
            sum += 1.0;
        }
    }
    stage_sums[pixel.y * parameters.width + pixel.x] = sum;
}

@compute @workgroup_size(8, 8)
fn stage_ao_power(@builtin(global_invocation_id) id: vec3u) {
    let pixel = stage_pixel(id);
    if stage_outside(pixel) {
        return;
    }
    let s = stage_load(pixel);
    var sum = stage_sum_before(pixel);
    for (var i = 0u; i < parameters.sample_count; i += 1u) {
        if s.hit != 0.0 {
            let u = stage_random(parameters, pixel, parameters.first_sample + i);
            sum += stage_ao_power_sample(parameters, s, u);
        } else {
            sum += 1.0;
        }
    }
    stage_sums[pixel.y * parameters.width + pixel.x] = sum;
}
