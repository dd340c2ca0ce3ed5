// What filter/packed_visibility asks for, over storage buffers: the words of
// the blocks, row by row, and the rows' sums, a pixel each. layout is the
// image's width and height in blocks, then in pixels. And how a workgroup of
// 8 x 4 threads makes its word.

@group(2) @binding(20) var<storage, read> packed_visibility_words: array<u32>;
@group(2) @binding(21) var<storage, read> packed_visibility_rows: array<u32>;
@group(2) @binding(22) var<uniform> packed_visibility_layout: vec4u;

var<workgroup> packed_visibility_shared: atomic<u32>;

// Outside the buffer: dark.
fn packed_visibility_read(block: vec2u) -> u32 {
    let index = block.y * packed_visibility_layout.x + block.x;
    if index >= arrayLength(&packed_visibility_words) {
        return 0u;
    }
    return packed_visibility_words[index];
}

// Outside the buffer: dark.
fn packed_visibility_read_row(pixel: vec2u) -> u32 {
    let index = pixel.y * packed_visibility_layout.z + pixel.x;
    if index >= arrayLength(&packed_visibility_rows) {
        return 0u;
    }
    return packed_visibility_rows[index];
}

// The word of a workgroup of 8 x 4 threads, the same in all of them: lane is
// the local_invocation_index, visible this thread's ray. All threads call it.
// A ballot without the subgroups extension, and right for subgroups of any
// width.
fn packed_visibility_ballot(lane: u32, visible: bool) -> u32 {
    if lane == 0u {
        atomicStore(&packed_visibility_shared, 0u);
    }
    workgroupBarrier();
    if visible {
        atomicOr(&packed_visibility_shared, 1u << (lane & 31u));
    }
    workgroupBarrier();
    let word = atomicLoad(&packed_visibility_shared);
    // The next call may not clear it while another thread still reads.
    workgroupBarrier();
    return word;
}
