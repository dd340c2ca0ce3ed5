// A pool of surfels that follows what the camera sees, in three passes a frame,
// after gi/surfel_irradiance and gi/surfel_grid:
//   surfel_pass_recycle  one workgroup: who goes, and which slots are free
//   (the passes of surfel_grid over the pool)
//   surfel_pass_cover    a workgroup for each tile of 16 x 16 pixels
//   surfel_pass_spawn    one workgroup: new surfels, tile by tile
// Free slots are taken in ascending order by tiles in reading order: the result
// does not depend on the order of the threads, and is that of the processor.

struct SurfelPass {
    camera: Camera,
    grid: SurfelGrid,
    // The image in pixels.
    width: u32,
    height: u32,
    // Its number.
    frame: u32,
    // Slots of the pool, at most those of the buffers.
    capacity: u32,
    // Coverage up to which surfels are spawned.
    target_coverage: f32,
    // How much of what is missing is spawned in a frame.
    rate: f32,
    // Least radius, and radius over depth.
    radius: f32,
    radius_per_depth: f32,
    // Frames that a surfel may go unseen while there is room.
    patience: u32,
}

@group(0) @binding(0) var<uniform> surfel_pass: SurfelPass;
// Two to a pixel, all in bits: position and mesh; normal, zero without a surface.
@group(0) @binding(1) var<storage, read> surfel_pass_pixels: array<vec4u>;
// Two to a slot, all in bits: position and radius, normal and mesh. A free slot
// has no radius.
@group(0) @binding(2) var<storage, read_write> surfel_pass_surfels: array<vec4u>;
// Frames since a pixel last saw it.
@group(0) @binding(3) var<storage, read_write> surfel_pass_unseen: array<atomic<u32>>;
// Free slots at the frame's start, recycled, spawned, dropped; then the slots.
@group(0) @binding(4) var<storage, read_write> surfel_pass_free: array<u32>;
// By tile.
@group(0) @binding(5) var<storage, read_write> surfel_pass_keys: array<u32>;
// The lists.
@group(0) @binding(6) var<storage, read> surfel_pass_first: array<u32>;
@group(0) @binding(7) var<storage, read> surfel_pass_lengths: array<u32>;
@group(0) @binding(8) var<storage, read> surfel_pass_entries: array<u32>;

var<workgroup> surfel_pass_parts: array<u32, 256>;
var<workgroup> surfel_pass_more: array<u32, 256>;
var<workgroup> surfel_pass_key: atomic<u32>;

fn surfel_pass_slots() -> u32 {
    let pool = min(arrayLength(&surfel_pass_surfels) / 2u, arrayLength(&surfel_pass_unseen));
    let free = max(arrayLength(&surfel_pass_free), 4u) - 4u;
    return min(surfel_pass.capacity, min(pool, free));
}

fn surfel_pass_surfel(slot: u32) -> Surfel {
    let place = surfel_pass_surfels[2u * slot];
    let shape = surfel_pass_surfels[2u * slot + 1u];
    return Surfel(
        bitcast<vec3f>(place.xyz),
        bitcast<f32>(place.w),
        bitcast<vec3f>(shape.xyz),
        shape.w,
    );
}

fn surfel_read(entry: u32) -> Surfel {
    if entry < arrayLength(&surfel_pass_entries) {
        let slot = surfel_pass_entries[entry];
        if slot < surfel_pass_slots() {
            return surfel_pass_surfel(slot);
        }
    }
    return Surfel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0u);
}

// These passes gather nothing.
fn surfel_read_irradiance(entry: u32) -> vec3f {
    return vec3f(0.0, 0.0, 0.0);
}

// What the threads before this one have counted.
fn surfel_pass_before(thread: u32) -> u32 {
    var sum = 0u;
    for (var i = 0u; i < thread; i++) {
        sum = sum + surfel_pass_parts[i];
    }
    return sum;
}

@compute @workgroup_size(256)
fn surfel_pass_recycle(@builtin(local_invocation_index) thread: u32) {
    let slots = surfel_pass_slots();
    let share = (slots + 255u) / 256u;
    let begin = min(thread * share, slots);
    let end = min(begin + share, slots);
    var count = 0u;
    for (var slot = begin; slot < end; slot++) {
        count = count + select(0u, 1u, surfel_pass_surfels[2u * slot].w != 0u);
    }
    surfel_pass_parts[thread] = count;
    workgroupBarrier();
    let used = surfel_pass_before(256u);
    workgroupBarrier();
    let patience = surfel_irradiance_patience(used, slots, surfel_pass.patience);
    var free = 0u;
    var gone = 0u;
    for (var slot = begin; slot < end; slot++) {
        let unseen = atomicLoad(&surfel_pass_unseen[slot]);
        var taken = surfel_pass_surfels[2u * slot].w != 0u;
        if taken && surfel_irradiance_recycle(surfel_pass_surfel(slot), unseen, patience) == 1u {
            surfel_pass_surfels[2u * slot] = vec4u(0u, 0u, 0u, 0u);
            surfel_pass_surfels[2u * slot + 1u] = vec4u(0u, 0u, 0x3f800000u, 0u);
            gone = gone + 1u;
            taken = false;
        }
        atomicStore(&surfel_pass_unseen[slot], max(unseen, unseen + 1u));
        free = free + select(1u, 0u, taken);
    }
    surfel_pass_parts[thread] = free;
    surfel_pass_more[thread] = gone;
    workgroupBarrier();
    var at = 4u + surfel_pass_before(thread);
    for (var slot = begin; slot < end; slot++) {
        if surfel_pass_surfels[2u * slot].w == 0u {
            surfel_pass_free[at] = slot;
            at = at + 1u;
        }
    }
    if thread == 0u {
        var recycled = 0u;
        for (var i = 0u; i < 256u; i++) {
            recycled = recycled + surfel_pass_more[i];
        }
        surfel_pass_free[0] = surfel_pass_before(256u);
        surfel_pass_free[1] = recycled;
    }
}

// Where a pixel's two words are; the image's size is that of the uniform.
fn surfel_pass_pixel(x: u32, y: u32) -> u32 {
    return 2u * (y * surfel_pass.width + x);
}

@compute @workgroup_size(16, 16)
fn surfel_pass_cover(
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_id) id: vec3u,
) {
    let index = id.y * 16u + id.x;
    if index == 0u {
        atomicStore(&surfel_pass_key, SURFEL_TILE_EMPTY);
    }
    workgroupBarrier();
    let x = tile.x * 16u + id.x;
    let y = tile.y * 16u + id.y;
    let at = surfel_pass_pixel(x, y);
    let inside = x < surfel_pass.width && y < surfel_pass.height;
    if inside && at + 1u < arrayLength(&surfel_pass_pixels) {
        let position = bitcast<vec3f>(surfel_pass_pixels[at].xyz);
        let normal = bitcast<vec3f>(surfel_pass_pixels[at + 1u].xyz);
        if surfel_sound(Surfel(position, 1.0, normal, 0u)) == 1u {
            // surfel_coverage, and who takes part.
            let slot = surfel_grid_find(position, surfel_pass.grid);
            var list = vec2u(0u, 0u);
            if slot < arrayLength(&surfel_pass_first) && slot < arrayLength(&surfel_pass_lengths) {
                list = vec2u(surfel_pass_first[slot], surfel_pass_lengths[slot]);
            }
            let count = min(list.y, SURFEL_WALK);
            var sum = 0.0;
            for (var i = 0u; i < count; i++) {
                let surfel = surfel_read(list.x + i);
                let weight = surfel_weight(surfel, position, normal);
                if weight > 0.0 {
                    sum = sum + weight;
                    atomicStore(&surfel_pass_unseen[surfel_pass_entries[list.x + i]], 0u);
                }
            }
            atomicMin(&surfel_pass_key, surfel_tile_key(sum, index));
        }
    }
    workgroupBarrier();
    let across = (surfel_pass.width + 15u) / 16u;
    let place = tile.y * across + tile.x;
    if index == 0u && tile.x < across && place < arrayLength(&surfel_pass_keys) {
        surfel_pass_keys[place] = atomicLoad(&surfel_pass_key);
    }
}

// Where the pixel is that spawns in a tile, and the radius; none: radius 0.
struct SurfelPassSpawn {
    at: u32,
    radius: f32,
}

fn surfel_pass_candidate(tile: u32) -> SurfelPassSpawn {
    let none = SurfelPassSpawn(0u, 0.0);
    let key = surfel_pass_keys[tile];
    if key == SURFEL_TILE_EMPTY {
        return none;
    }
    let width = surfel_pass.width;
    let height = surfel_pass.height;
    let across = (width + 15u) / 16u;
    let left = (tile % across) * 16u;
    let top = (tile / across) * 16u;
    let index = surfel_tile_index(key);
    let x = left + index % 16u;
    let y = top + index / 16u;
    let at = surfel_pass_pixel(x, y);
    if x >= width || y >= height || at + 1u >= arrayLength(&surfel_pass_pixels) {
        return none;
    }
    let position = bitcast<vec3f>(surfel_pass_pixels[at].xyz);
    let normal = bitcast<vec3f>(surfel_pass_pixels[at + 1u].xyz);
    let camera = surfel_pass.camera;
    let eye = vec3f(
        camera.origin.x - position.x,
        camera.origin.y - position.y,
        camera.origin.z - position.z,
    );
    let depth = -vec3_dot(eye, camera.forward);
    if depth <= 0.0 {
        return none;
    }
    let area = surfel_pixel_area(depth, vec3_dot(eye, normal) / depth, camera);
    let radius = max(surfel_pass.radius, depth * surfel_pass.radius_per_depth);
    let pixels = min(width - left, 16u) * min(height - top, 16u);
    let chance = surfel_spawn_chance(
        surfel_tile_coverage(key),
        surfel_pass.target_coverage,
        area,
        f32(pixels),
        radius,
        surfel_pass.rate,
    );
    let spawns = surfel_spawns(vec2u(x, y), surfel_pass.frame, chance);
    if spawns == 0u {
        return none;
    }
    return SurfelPassSpawn(at, radius);
}

@compute @workgroup_size(256)
fn surfel_pass_spawn(@builtin(local_invocation_index) thread: u32) {
    let across = (surfel_pass.width + 15u) / 16u;
    let down = (surfel_pass.height + 15u) / 16u;
    let tiles = min(across * down, arrayLength(&surfel_pass_keys));
    let share = (tiles + 255u) / 256u;
    let begin = min(thread * share, tiles);
    let end = min(begin + share, tiles);
    var count = 0u;
    for (var tile = begin; tile < end; tile++) {
        count = count + select(0u, 1u, surfel_pass_candidate(tile).radius > 0.0);
    }
    surfel_pass_parts[thread] = count;
    workgroupBarrier();
    let free = surfel_pass_free[0];
    var at = surfel_pass_before(thread);
    for (var tile = begin; tile < end; tile++) {
        let found = surfel_pass_candidate(tile);
        if found.radius > 0.0 {
            if at < free && at + 4u < arrayLength(&surfel_pass_free) {
                let slot = surfel_pass_free[at + 4u];
                if slot < surfel_pass_slots() {
                    let place = surfel_pass_pixels[found.at];
                    let shape = surfel_pass_pixels[found.at + 1u];
                    let radius = bitcast<u32>(found.radius);
                    surfel_pass_surfels[2u * slot] = vec4u(place.xyz, radius);
                    surfel_pass_surfels[2u * slot + 1u] = vec4u(shape.xyz, place.w);
                    atomicStore(&surfel_pass_unseen[slot], 0u);
                }
            }
            at = at + 1u;
        }
    }
    if thread == 255u {
        let spawned = min(at, free);
        surfel_pass_free[2] = spawned;
        surfel_pass_free[3] = at - spawned;
    }
}
