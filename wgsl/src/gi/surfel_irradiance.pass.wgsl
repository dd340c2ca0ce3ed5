// The light of a pool of surfels, in four passes a frame after those of
// gi/surfel.pass, after gi/surfel_irradiance, gi/surfel_grid and
// temporal/multiscale_mean:
//   surfel_irradiance_pass_begin  a thread for each slot: new surfels are dark
//   surfel_irradiance_pass_share  one workgroup: who gets how many rays
//   surfel_irradiance_pass_trace  a thread for each slot: rays and estimator
//   surfel_irradiance_pass_end    a thread for each slot: the new irradiance
// Rays see the irradiance of the frame before, whatever the order of the threads.
//
// The program defines what rays meet, ray/bvh for one:
//     fn surfel_irradiance_trace(origin: vec3f, direction: vec3f) -> SurfelIrradianceHit
//     fn surfel_irradiance_direct(hit: SurfelIrradianceHit) -> vec3f
// the first hit along a unit direction, and the irradiance that the lights give
// there, the cosine and their shadow rays included. The trace has six storage
// buffers of its own; WebGPU promises eight.

struct SurfelIrradiancePass {
    grid: SurfelGrid,
    // Slots of the pool, at most those of the buffers.
    capacity: u32,
    // The frame's number.
    frame: u32,
    // Rays of a surfel in its first frame.
    rays: u32,
    // Rays of all surfels in a frame.
    budget: u32,
    // Memory of the estimator in frames, at most.
    longest: f32,
}

// What a ray hit.
struct SurfelIrradianceHit {
    position: vec3f,
    // 0 for a miss; then the rest does not count.
    found: u32,
    // Unit normal, towards the ray's origin.
    normal: vec3f,
    // What part of the light it sends back.
    albedo: vec3f,
    // Radiance of its own.
    emission: vec3f,
}

// A surfel's light: zeros for none. 96 bytes.
struct SurfelIrradianceLight {
    state: MultiscaleMeanRobustRgbState,
    // Frames with rays.
    age: u32,
    // Rays in this frame.
    rays: u32,
}

@group(0) @binding(0) var<uniform> surfel_irradiance_pass: SurfelIrradiancePass;
// As in gi/surfel.pass.
@group(0) @binding(1) var<storage, read> surfel_irradiance_pass_surfels: array<vec4u>;
@group(0) @binding(2) var<storage, read> surfel_irradiance_pass_free: array<u32>;
// By slot.
@group(0) @binding(3) var<storage, read_write> surfel_irradiance_pass_lights: array<SurfelIrradianceLight>;
@group(0) @binding(4) var<storage, read_write> surfel_irradiance_pass_irradiances: array<vec4f>;
// The lists.
@group(0) @binding(5) var<storage, read> surfel_irradiance_pass_first: array<u32>;
@group(0) @binding(6) var<storage, read> surfel_irradiance_pass_lengths: array<u32>;
@group(0) @binding(7) var<storage, read> surfel_irradiance_pass_entries: array<u32>;

var<workgroup> surfel_irradiance_pass_parts: array<u32, 256>;

fn surfel_irradiance_pass_slots() -> u32 {
    let surfels = arrayLength(&surfel_irradiance_pass_surfels) / 2u;
    let lights = arrayLength(&surfel_irradiance_pass_lights);
    return min(surfel_irradiance_pass.capacity, min(surfels, lights));
}

fn surfel_irradiance_pass_surfel(slot: u32) -> Surfel {
    let place = surfel_irradiance_pass_surfels[2u * slot];
    let shape = surfel_irradiance_pass_surfels[2u * slot + 1u];
    return Surfel(
        bitcast<vec3f>(place.xyz),
        bitcast<f32>(place.w),
        bitcast<vec3f>(shape.xyz),
        shape.w,
    );
}

fn surfel_read(entry: u32) -> Surfel {
    if entry < arrayLength(&surfel_irradiance_pass_entries) {
        let slot = surfel_irradiance_pass_entries[entry];
        if slot < surfel_irradiance_pass_slots() {
            return surfel_irradiance_pass_surfel(slot);
        }
    }
    return Surfel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0u);
}

fn surfel_read_irradiance(entry: u32) -> vec3f {
    if entry < arrayLength(&surfel_irradiance_pass_entries) {
        let slot = surfel_irradiance_pass_entries[entry];
        if slot < arrayLength(&surfel_irradiance_pass_irradiances) {
            return surfel_irradiance_pass_irradiances[slot].xyz;
        }
    }
    return vec3f(0.0, 0.0, 0.0);
}

fn surfel_irradiance_pass_list(point: vec3f) -> vec2u {
    let slot = surfel_grid_find(point, surfel_irradiance_pass.grid);
    if slot < arrayLength(&surfel_irradiance_pass_first)
        && slot < arrayLength(&surfel_irradiance_pass_lengths) {
        return vec2u(surfel_irradiance_pass_first[slot], surfel_irradiance_pass_lengths[slot]);
    }
    return vec2u(0u, 0u);
}

// The slots that gi/surfel.pass filled in this frame.
@compute @workgroup_size(64)
fn surfel_irradiance_pass_begin(@builtin(global_invocation_id) id: vec3u) {
    let known = arrayLength(&surfel_irradiance_pass_free);
    if known < 4u || id.x >= min(surfel_irradiance_pass_free[2], known - 4u) {
        return;
    }
    let slot = surfel_irradiance_pass_free[id.x + 4u];
    if slot < surfel_irradiance_pass_slots() {
        let zero = vec3f(0.0, 0.0, 0.0);
        let state = MultiscaleMeanRobustRgbState(zero, zero, zero, zero, 0.0, 0.0, 0.0);
        surfel_irradiance_pass_lights[slot] = SurfelIrradianceLight(state, 0u, 0u);
        if slot < arrayLength(&surfel_irradiance_pass_irradiances) {
            surfel_irradiance_pass_irradiances[slot] = vec4f(0.0, 0.0, 0.0, 0.0);
        }
    }
}

// a + b modulo m, both below it: the sum may not fit.
fn surfel_irradiance_pass_add(a: u32, b: u32, m: u32) -> u32 {
    let gap = m - b;
    if a >= gap {
        return a - gap;
    }
    return a + b;
}

// The slot that comes first: frame times budget, modulo the slots.
fn surfel_irradiance_pass_start(slots: u32) -> u32 {
    var power = surfel_irradiance_pass.frame % slots;
    var left = surfel_irradiance_pass.budget;
    var sum = 0u;
    for (var i = 0u; i < 32u; i++) {
        if (left & 1u) == 1u {
            sum = surfel_irradiance_pass_add(sum, power, slots);
        }
        power = surfel_irradiance_pass_add(power, power, slots);
        left = left >> 1u;
    }
    return sum;
}

fn surfel_irradiance_pass_wanted(slot: u32) -> u32 {
    if surfel_sound(surfel_irradiance_pass_surfel(slot)) == 0u {
        return 0u;
    }
    return surfel_irradiance_rays(
        surfel_irradiance_pass_lights[slot].age,
        surfel_irradiance_pass.rays,
    );
}

// A sum that stays at the largest number.
fn surfel_irradiance_pass_sum(a: u32, b: u32) -> u32 {
    return a + min(b, 0xffffffffu - a);
}

@compute @workgroup_size(256)
fn surfel_irradiance_pass_share(@builtin(local_invocation_index) thread: u32) {
    let slots = surfel_irradiance_pass_slots();
    let share = (slots + 255u) / 256u;
    let begin = min(thread * share, slots);
    let end = min(begin + share, slots);
    let start = surfel_irradiance_pass_start(max(slots, 1u));
    var wanted = 0u;
    for (var i = begin; i < end; i++) {
        let slot = surfel_irradiance_pass_add(start, i, slots);
        wanted = surfel_irradiance_pass_sum(wanted, surfel_irradiance_pass_wanted(slot));
    }
    surfel_irradiance_pass_parts[thread] = wanted;
    workgroupBarrier();
    var before = 0u;
    for (var i = 0u; i < thread; i++) {
        before = surfel_irradiance_pass_sum(before, surfel_irradiance_pass_parts[i]);
    }
    for (var i = begin; i < end; i++) {
        let slot = surfel_irradiance_pass_add(start, i, slots);
        let wants = surfel_irradiance_pass_wanted(slot);
        surfel_irradiance_pass_lights[slot].rays =
            surfel_irradiance_allowed(before, wants, surfel_irradiance_pass.budget);
        before = surfel_irradiance_pass_sum(before, wants);
    }
}

@compute @workgroup_size(64)
fn surfel_irradiance_pass_trace(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= surfel_irradiance_pass_slots() {
        return;
    }
    let rays = surfel_irradiance_pass_lights[id.x].rays;
    if rays == 0u {
        return;
    }
    let surfel = surfel_irradiance_pass_surfel(id.x);
    let origin = surfel_irradiance_origin(surfel);
    var sum = vec3f(0.0, 0.0, 0.0);
    for (var ray = 0u; ray < rays; ray++) {
        let frame = surfel_irradiance_pass.frame;
        let direction = surfel_irradiance_direction(surfel.normal, id.x, frame, ray);
        let hit = surfel_irradiance_trace(origin, direction);
        if hit.found != 0u {
            let list = surfel_irradiance_pass_list(hit.position);
            let found = surfel_gather(hit.position, hit.normal, list);
            let direct = surfel_irradiance_direct(hit);
            let light = surfel_irradiance_outgoing(
                hit.albedo,
                hit.emission,
                direct,
                found.irradiance,
            );
            sum = sum + light;
        }
    }
    let light = surfel_irradiance_pass_lights[id.x];
    surfel_irradiance_pass_lights[id.x].state = multiscale_mean_robust_rgb_step(
        light.state,
        surfel_irradiance_sample(sum, rays),
        MULTISCALE_MEAN_SHORT_BLEND,
        surfel_irradiance_pass.longest,
    );
    surfel_irradiance_pass_lights[id.x].age = light.age + min(1u, 0xffffffffu - light.age);
}

@compute @workgroup_size(64)
fn surfel_irradiance_pass_end(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= surfel_irradiance_pass_slots()
        || id.x >= arrayLength(&surfel_irradiance_pass_irradiances) {
        return;
    }
    let light = surfel_irradiance_pass_lights[id.x];
    if light.rays > 0u {
        let value = multiscale_mean_robust_rgb_value(light.state);
        surfel_irradiance_pass_irradiances[id.x] = vec4f(value, 0.0);
    }
}
