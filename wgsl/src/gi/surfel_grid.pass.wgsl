// The lists of a grid, in four passes, after gi/surfel_grid: zero the counts,
// then
//   surfel_grid_pass_count   a thread for each surfel
//   surfel_grid_pass_sum     one workgroup
//   surfel_grid_pass_scatter a thread for each surfel
//   surfel_grid_pass_sort    a thread for each slot
// The sort puts each list in the order of the surfels' numbers and takes out
// what is there twice: the result does not depend on the order of the threads.

struct SurfelGridPass {
    grid: SurfelGrid,
    // How many surfels there are.
    surfels: u32,
    // Room for entries, at most that of the buffer.
    capacity: u32,
}

@group(0) @binding(0) var<uniform> surfel_grid_pass: SurfelGridPass;
// Two to a surfel: position and radius, normal and the bits of mesh.
@group(0) @binding(1) var<storage, read> surfel_grid_pass_surfels: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> surfel_grid_pass_first: array<u32>;
@group(0) @binding(3) var<storage, read_write> surfel_grid_pass_counts: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> surfel_grid_pass_entries: array<u32>;
// Entries that had no room; surfels in no list of some level.
@group(0) @binding(5) var<storage, read_write> surfel_grid_pass_lost: array<atomic<u32>, 2>;
// How long each slot's list is in the end.
@group(0) @binding(6) var<storage, read_write> surfel_grid_pass_lengths: array<u32>;

var<workgroup> surfel_grid_pass_parts: array<u32, 256>;

fn surfel_grid_pass_surfel(index: u32) -> Surfel {
    let place = surfel_grid_pass_surfels[2u * index];
    let shape = surfel_grid_pass_surfels[2u * index + 1u];
    return Surfel(place.xyz, place.w, shape.xyz, bitcast<u32>(shape.w));
}

fn surfel_grid_pass_alive(index: u32) -> bool {
    return index < surfel_grid_pass.surfels
        && index < arrayLength(&surfel_grid_pass_surfels) / 2u;
}

@compute @workgroup_size(64)
fn surfel_grid_pass_count(@builtin(global_invocation_id) id: vec3u) {
    if !surfel_grid_pass_alive(id.x) {
        return;
    }
    let surfel = surfel_grid_pass_surfel(id.x);
    let grid = surfel_grid_pass.grid;
    let levels = surfel_grid_levels(surfel, grid);
    var whole = levels.y > 0u;
    for (var l = 0u; l < levels.y; l++) {
        let range = surfel_grid_range(surfel, levels.x + l, grid);
        let count = surfel_grid_count(range);
        if count == 0u {
            whole = false;
        }
        for (var k = 0u; k < count; k++) {
            let cell = surfel_grid_cell(range, k);
            let slot = surfel_grid_slot(cell, levels.x + l, grid);
            if slot < arrayLength(&surfel_grid_pass_counts) {
                atomicAdd(&surfel_grid_pass_counts[slot], 1u);
            }
        }
    }
    if !whole {
        atomicAdd(&surfel_grid_pass_lost[1], 1u);
    }
}

@compute @workgroup_size(256)
fn surfel_grid_pass_sum(@builtin(local_invocation_index) thread: u32) {
    let slots = min(surfel_grid_pass.grid.slots, arrayLength(&surfel_grid_pass_counts));
    let share = (slots + 255u) / 256u;
    let begin = min(thread * share, slots);
    let end = min(begin + share, slots);
    var part = 0u;
    for (var slot = begin; slot < end; slot++) {
        part = part + atomicLoad(&surfel_grid_pass_counts[slot]);
    }
    surfel_grid_pass_parts[thread] = part;
    workgroupBarrier();
    var at = 0u;
    for (var i = 0u; i < thread; i++) {
        at = at + surfel_grid_pass_parts[i];
    }
    let capacity = min(surfel_grid_pass.capacity, arrayLength(&surfel_grid_pass_entries));
    for (var slot = begin; slot < end; slot++) {
        let count = atomicLoad(&surfel_grid_pass_counts[slot]);
        let kept = surfel_grid_kept(at, count, capacity);
        surfel_grid_pass_first[slot] = at;
        atomicAdd(&surfel_grid_pass_lost[0], count - kept);
        // The scatter counts from here down to 0.
        atomicStore(&surfel_grid_pass_counts[slot], kept);
        surfel_grid_pass_lengths[slot] = kept;
        at = at + count;
    }
}

// Entries are placed from the end of a list: its count falls to 0.
@compute @workgroup_size(64)
fn surfel_grid_pass_scatter(@builtin(global_invocation_id) id: vec3u) {
    if !surfel_grid_pass_alive(id.x) {
        return;
    }
    let surfel = surfel_grid_pass_surfel(id.x);
    let grid = surfel_grid_pass.grid;
    let levels = surfel_grid_levels(surfel, grid);
    for (var l = 0u; l < levels.y; l++) {
        let range = surfel_grid_range(surfel, levels.x + l, grid);
        let count = surfel_grid_count(range);
        for (var k = 0u; k < count; k++) {
            let cell = surfel_grid_cell(range, k);
            let slot = surfel_grid_slot(cell, levels.x + l, grid);
            if slot >= arrayLength(&surfel_grid_pass_counts)
                || atomicLoad(&surfel_grid_pass_counts[slot]) == 0u {
                continue;
            }
            let left = atomicSub(&surfel_grid_pass_counts[slot], 1u);
            let entry = surfel_grid_pass_first[slot] + left - 1u;
            if left > 0u && entry < arrayLength(&surfel_grid_pass_entries) {
                surfel_grid_pass_entries[entry] = id.x;
            }
        }
    }
}

// A heap's entry at place, of count, sinks to where it belongs.
fn surfel_grid_pass_sink(first: u32, place: u32, count: u32) {
    var at = place;
    let value = surfel_grid_pass_entries[first + at];
    while 2u * at + 1u < count {
        var child = 2u * at + 1u;
        if child + 1u < count
            && surfel_grid_pass_entries[first + child + 1u]
                > surfel_grid_pass_entries[first + child] {
            child = child + 1u;
        }
        if surfel_grid_pass_entries[first + child] <= value {
            break;
        }
        surfel_grid_pass_entries[first + at] = surfel_grid_pass_entries[first + child];
        at = child;
    }
    surfel_grid_pass_entries[first + at] = value;
}

// A heap sort: its cost is bounded, whatever the list.
@compute @workgroup_size(64)
fn surfel_grid_pass_sort(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= surfel_grid_pass.grid.slots || id.x >= arrayLength(&surfel_grid_pass_lengths) {
        return;
    }
    let first = surfel_grid_pass_first[id.x];
    let count = surfel_grid_pass_lengths[id.x];
    if count < 2u {
        return;
    }
    for (var i = count / 2u; i > 0u; i--) {
        surfel_grid_pass_sink(first, i - 1u, count);
    }
    for (var last = count - 1u; last > 0u; last--) {
        let largest = surfel_grid_pass_entries[first];
        surfel_grid_pass_entries[first] = surfel_grid_pass_entries[first + last];
        surfel_grid_pass_entries[first + last] = largest;
        surfel_grid_pass_sink(first, 0u, last);
    }
    // Two cells of one surfel may share a slot.
    var kept = 1u;
    for (var i = 1u; i < count; i++) {
        let entry = surfel_grid_pass_entries[first + i];
        if entry != surfel_grid_pass_entries[first + kept - 1u] {
            surfel_grid_pass_entries[first + kept] = entry;
            kept = kept + 1u;
        }
    }
    surfel_grid_pass_lengths[id.x] = kept;
}
