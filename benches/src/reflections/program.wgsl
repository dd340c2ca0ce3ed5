// The reflections of the report. Appended to what they use and to
// `const LAYERED_COUNT`; program.rs is the twin: the same functions in the
// same order. A program is made for each number of layers, and looks after
// the balls that have as many.

struct ReflectParameters {
    camera: Camera,
    light_direction: vec3f,
    // Start of secondary rays, in units of the scene.
    offset: f32,
    // Below this height a surface that faces up has a pattern of squares, and
    // how many of them fill a unit.
    ground: f32,
    checker: f32,
    width: u32,
    height: u32,
    balls: u32,
    frame: u32,
    first_row: u32,
    first_sample: u32,
    sample_count: u32,
    // Of the reconstruction and of the filter after it.
    neighbours: u32,
    max_taps: u32,
    max_radius: f32,
}

struct ReflectSurface {
    position: vec3f,
    ball: u32,
    normal: vec3f,
    reach: f32,
    viewer: vec3f,
}

struct ReflectMet {
    t: f32,
    normal: vec3f,
    ball: u32,
    hit: bool,
}

@group(0) @binding(0) var<storage, read> parameters: ReflectParameters;
@group(0) @binding(1) var<storage, read> reflect_normals: array<vec4f>;
@group(0) @binding(2) var<storage, read> reflect_balls: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> reflect_surfaces: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> reflect_hits: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> reflect_means: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> reflect_image: array<vec4f>;

const REFLECT_ALBEDOS: u32 = 32u;
const REFLECT_BALL: u32 = 39u;
const REFLECT_OFFSET_PRECISION: f32 = 0x1p-18f;
const REFLECT_FAR: f32 = 1000.0;
const REFLECT_REACH: f32 = 0.02;
const REFLECT_NONE: u32 = 0xffffffffu;

fn reflect_layer(ball: u32, k: u32) -> LayeredLayer {
    let a = reflect_balls[ball * REFLECT_BALL + 1u + 2u * k];
    let b = reflect_balls[ball * REFLECT_BALL + 2u + 2u * k];
    return LayeredLayer(a.xyz, a.w, b.xyz, vec2f(b.w, b.w));
}

fn reflect_count(ball: u32) -> u32 {
    return u32(reflect_balls[ball * REFLECT_BALL + 5u].w);
}

fn reflect_stack(ball: u32) -> LayeredStack {
    var stack: LayeredStack;
    for (var k = 0u; k < LAYERED_COUNT; k++) {
        stack.layers[k] = reflect_layer(ball, k);
    }
    stack.diffuse = reflect_balls[ball * REFLECT_BALL + 5u].xyz;
    return stack;
}

fn reflect_offset(position: vec3f) -> f32 {
    return max(parameters.offset, vec3_length(position) * REFLECT_OFFSET_PRECISION);
}

fn reflect_closest(ray: Ray) -> ReflectMet {
    let hit = bvh_closest(ray);
    var met = ReflectMet(REFLECT_FAR, vec3f(0.0), REFLECT_NONE, false);
    if hit.primitive != BVH_MISS {
        let n = reflect_normals[hit.primitive].xyz;
        let away = vec3_dot(n, ray.direction) > 0.0;
        met.t = hit.t;
        met.normal = vec3f(select(n.x, -n.x, away), select(n.y, -n.y, away), select(n.z, -n.z, away));
        met.hit = true;
    }
    for (var k = 0u; k < parameters.balls; k++) {
        let ball = reflect_balls[k * REFLECT_BALL];
        let s = sphere_intersect(ray, ball.xyz, ball.w);
        if s.hit != 0u && s.t < met.t {
            met.t = s.t;
            met.ball = k;
            met.hit = true;
        }
    }
    if met.ball != REFLECT_NONE {
        met.normal = vec3_normalize(ray_at(ray, met.t) - reflect_balls[met.ball * REFLECT_BALL].xyz);
    }
    return met;
}

fn reflect_any(balls: u32, ray: Ray) -> bool {
    if bvh_any(ray) != 0u {
        return true;
    }
    for (var k = 0u; k < balls; k++) {
        let ball = reflect_balls[k * REFLECT_BALL];
        if sphere_intersect(ray, ball.xyz, ball.w).hit != 0u {
            return true;
        }
    }
    return false;
}

fn reflect_light_visible(position: vec3f) -> f32 {
    let ray = Ray(position, parameters.light_direction, reflect_offset(position), CAMERA_FAR);
    return select(1.0, 0.0, reflect_any(parameters.balls, ray));
}

fn reflect_radiance(ray: Ray, met: ReflectMet) -> vec3f {
    if !met.hit {
        let up = 0.5 + 0.5 * ray.direction.y;
        return vec3f(0.60 - 0.34 * up, 0.68 - 0.30 * up, 0.78 - 0.22 * up);
    }
    let position = ray_at(ray, met.t);
    let up = 0.5 + 0.5 * met.normal.y;
    let facing = max(vec3_dot(met.normal, parameters.light_direction), 0.0);
    var key = 0.0;
    if facing > 0.0 {
        key = facing * reflect_light_visible(position);
    }
    var albedo = vec3f(1.0);
    if met.ball != REFLECT_NONE {
        albedo = reflect_balls[met.ball * REFLECT_BALL + 6u].xyz;
    } else if met.normal.y > 0.9 && position.y < parameters.ground {
        let square = i32(floor(position.x * parameters.checker))
            + i32(floor(position.z * parameters.checker));
        if (square & 1) != 0 {
            albedo = vec3f(0.35, 0.33, 0.38);
        }
    }
    return vec3f(
        albedo.x * ((0.18 + 0.13 * up) + 1.24 * key),
        albedo.y * ((0.16 + 0.17 * up) + 1.10 * key),
        albedo.z * ((0.15 + 0.22 * up) + 0.90 * key),
    );
}

fn reflect_random(pixel: vec2u, sample: u32) -> vec3f {
    let a = pcg_next(pcg_seed(pixel, sample));
    let b = pcg_next(a.state);
    let c = pcg_next(b.state);
    return vec3f(pcg_unit(a.value), pcg_unit(b.value), pcg_unit(c.value));
}

fn reflect_turn(pixel: vec2u, lane: u32) -> f32 {
    return pcg_unit(pcg_hash(
        pixel.x ^ pcg_hash(pixel.y ^ pcg_hash(2u * parameters.frame + lane)),
    ));
}

struct ReflectTraced {
    hit: SpatialReconstructHit,
    weight: vec3f,
}

fn reflect_trace(s: ReflectSurface, u: vec3f) -> ReflectTraced {
    let none = SpatialReconstructHit(s.position, 0.0, vec3f(0.0));
    let frame = basis_from_normal(s.normal);
    let wo = basis_to_local(frame, s.normal, s.viewer);
    let sample = layered_sample(reflect_stack(s.ball), wo, u);
    if sample.pdf <= 0.0 {
        return ReflectTraced(none, vec3f(0.0));
    }
    let ray = Ray(
        s.position,
        basis_to_world(frame, s.normal, sample.direction),
        reflect_offset(s.position),
        CAMERA_FAR,
    );
    let met = reflect_closest(ray);
    let hit = SpatialReconstructHit(ray_at(ray, met.t), sample.pdf, reflect_radiance(ray, met));
    return ReflectTraced(hit, sample.weight);
}

fn reflect_load(index: u32) -> ReflectSurface {
    let a = reflect_surfaces[3u * index];
    let b = reflect_surfaces[3u * index + 1u];
    let c = reflect_surfaces[3u * index + 2u];
    return ReflectSurface(a.xyz, select(u32(max(a.w, 0.0)), REFLECT_NONE, a.w < 0.0), b.xyz, b.w, c.xyz);
}

fn reflect_half_size() -> vec2u {
    return vec2u((parameters.width + 1u) / 2u, (parameters.height + 1u) / 2u);
}

fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit {
    let index = at.y * reflect_half_size().x + at.x;
    let a = reflect_hits[2u * index];
    return SpatialReconstructHit(a.xyz, a.w, reflect_hits[2u * index + 1u].xyz);
}

fn spatial_reconstruct_weight(pixel: vec2u, at: vec2u, hit: SpatialReconstructHit) -> f32 {
    let s = reflect_load(pixel.y * parameters.width + pixel.x);
    let other = reflect_load(2u * at.y * parameters.width + 2u * at.x);
    let away = hit.position - s.position;
    if other.reach <= 0.0 || hit.pdf <= 0.0 || vec3_dot(away, away) <= 0.0 {
        return 0.0;
    }
    let frame = basis_from_normal(s.normal);
    let wo = basis_to_local(frame, s.normal, s.viewer);
    let wi = basis_to_local(frame, s.normal, vec3_normalize(away));
    let value = luminance(layered_eval(reflect_stack(s.ball), wo, wi)) * max(wi.z, 0.0);
    return value
        * spatial_reconstruct_edge(s.normal, other.normal, other.position - s.position, s.reach);
}

fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel {
    let index = at.y * parameters.width + at.x;
    let mean = reflect_means[index];
    let s = reflect_load(index);
    return BilateralVariancePixel(mean.xyz, mean.w, s.position, s.reach, s.normal);
}

fn reflect_albedo(ball: u32, cos: f32) -> vec3f {
    let x = clamp(cos, 0.0, 1.0) * f32(REFLECT_ALBEDOS - 1u);
    let k = min(u32(x), REFLECT_ALBEDOS - 2u);
    let t = x - f32(k);
    let a = reflect_balls[ball * REFLECT_BALL + 7u + k].xyz;
    let b = reflect_balls[ball * REFLECT_BALL + 8u + k].xyz;
    return vec3f(a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t, a.z + (b.z - a.z) * t);
}

fn reflect_pixel(id: vec3u) -> vec2u {
    return vec2u(id.x, id.y + parameters.first_row);
}

fn reflect_outside(pixel: vec2u) -> bool {
    return pixel.x >= parameters.width || pixel.y >= parameters.height;
}

// Whether this program is the one for the ball.
fn reflect_mine(ball: u32) -> bool {
    if ball == REFLECT_NONE {
        return false;
    }
    return reflect_count(ball) == LAYERED_COUNT;
}

@compute @workgroup_size(8, 8)
fn reflect_surface(@builtin(global_invocation_id) id: vec3u) {
    let pixel = reflect_pixel(id);
    if reflect_outside(pixel) {
        return;
    }
    let ray = camera_ray(vec2f(f32(pixel.x) + 0.5, f32(pixel.y) + 0.5), parameters.camera);
    let met = reflect_closest(ray);
    let index = pixel.y * parameters.width + pixel.x;
    let none = met.ball == REFLECT_NONE;
    var colour = vec3f(0.0);
    if none {
        colour = reflect_radiance(ray, met);
    }
    reflect_surfaces[3u * index] = vec4f(ray_at(ray, met.t), select(f32(met.ball), -1.0, none));
    reflect_surfaces[3u * index + 1u] = vec4f(met.normal, select(REFLECT_REACH * met.t, 0.0, none));
    reflect_surfaces[3u * index + 2u] = vec4f(-ray.direction, 0.0);
    reflect_means[index] = vec4f(0.0);
    reflect_image[index] = vec4f(colour, 1.0);
}

// One ray for each half-resolution pixel.
@compute @workgroup_size(8, 8)
fn reflect_half(@builtin(global_invocation_id) id: vec3u) {
    let at = reflect_pixel(id);
    let size = reflect_half_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let index = at.y * size.x + at.x;
    let s = reflect_load(2u * at.y * parameters.width + 2u * at.x);
    if LAYERED_COUNT == 1u && s.ball == REFLECT_NONE {
        reflect_hits[2u * index] = vec4f(s.position, 0.0);
        reflect_hits[2u * index + 1u] = vec4f(0.0);
    }
    if !reflect_mine(s.ball) {
        return;
    }
    let traced = reflect_trace(s, reflect_random(at, parameters.frame));
    reflect_hits[2u * index] = vec4f(traced.hit.position, traced.hit.pdf);
    reflect_hits[2u * index + 1u] = vec4f(traced.hit.radiance, 0.0);
}

// The sum over a pixel's own samples.
@compute @workgroup_size(8, 8)
fn reflect_sum(@builtin(global_invocation_id) id: vec3u) {
    let pixel = reflect_pixel(id);
    if reflect_outside(pixel) {
        return;
    }
    let index = pixel.y * parameters.width + pixel.x;
    let s = reflect_load(index);
    if !reflect_mine(s.ball) {
        return;
    }
    var sum = vec3f(0.0);
    if parameters.first_sample > 0u {
        sum = reflect_image[index].xyz;
    }
    for (var i = 0u; i < parameters.sample_count; i++) {
        let u = reflect_random(pixel, parameters.frame + parameters.first_sample + i);
        let traced = reflect_trace(s, u);
        sum += vec3f(
            traced.weight.x * traced.hit.radiance.x,
            traced.weight.y * traced.hit.radiance.y,
            traced.weight.z * traced.hit.radiance.z,
        );
    }
    reflect_image[index] = vec4f(sum, 1.0);
}

@compute @workgroup_size(8, 8)
fn reflect_reconstruct(@builtin(global_invocation_id) id: vec3u) {
    let pixel = reflect_pixel(id);
    if reflect_outside(pixel) {
        return;
    }
    let index = pixel.y * parameters.width + pixel.x;
    let s = reflect_load(index);
    if !reflect_mine(s.ball) {
        return;
    }
    let r = spatial_reconstruct_pixel(
        pixel,
        reflect_half_size(),
        parameters.neighbours,
        reflect_turn(pixel, 0u),
    );
    reflect_means[index] = vec4f(r.color, r.variance);
}

@compute @workgroup_size(8, 8)
fn reflect_finish(@builtin(global_invocation_id) id: vec3u) {
    let pixel = reflect_pixel(id);
    if reflect_outside(pixel) {
        return;
    }
    let index = pixel.y * parameters.width + pixel.x;
    let s = reflect_load(index);
    if s.ball == REFLECT_NONE {
        return;
    }
    var radiance = reflect_means[index].xyz;
    if parameters.max_taps > 0u {
        radiance = bilateral_variance_pixel(
            pixel,
            vec2u(parameters.width, parameters.height),
            parameters.max_radius,
            parameters.max_taps,
            reflect_turn(pixel, 1u),
        );
    }
    let albedo = reflect_albedo(s.ball, vec3_dot(s.normal, s.viewer));
    reflect_image[index] = vec4f(radiance.x * albedo.x, radiance.y * albedo.y, radiance.z * albedo.z, 1.0);
}
