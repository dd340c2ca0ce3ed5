// What filter/packed_visibility asks for, over storage buffers: the words of
// the blocks, row by row, and the rows' sums, a pixel each. layout is the
// image's width and height in blocks, then in pixels.

@group(2) @binding(20) var<storage, read> packed_visibility_words: array<u32>;
@group(2) @binding(21) var<storage, read> packed_visibility_rows: array<u32>;
@group(2) @binding(22) var<uniform> packed_visibility_layout: vec4u;

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

// For the passes: each pixel's visibility, above 0 where its ray reached the
// light; the words; the rows' sums; the results.
@group(2) @binding(80) var<storage, read> packed_visibility_visible: array<f32>;
@group(2) @binding(81) var<storage, read_write> packed_visibility_new_words: array<u32>;
@group(2) @binding(82) var<storage, read_write> packed_visibility_new_rows: array<u32>;
@group(2) @binding(83) var<storage, read_write> packed_visibility_results: array<vec4f>;

// Outside the buffer: dark.
fn packed_visibility_read_visible(at: vec2u) -> f32 {
    let index = at.y * packed_visibility_layout.z + at.x;
    if index >= arrayLength(&packed_visibility_visible) {
        return 0.0;
    }
    return packed_visibility_visible[index];
}

fn packed_visibility_write(block: vec2u, word: u32) {
    let index = block.y * packed_visibility_layout.x + block.x;
    if index < arrayLength(&packed_visibility_new_words) {
        packed_visibility_new_words[index] = word;
    }
}

fn packed_visibility_write_row(at: vec2u, sum: u32) {
    let index = at.y * packed_visibility_layout.z + at.x;
    if index < arrayLength(&packed_visibility_new_rows) {
        packed_visibility_new_rows[index] = sum;
    }
}

fn packed_visibility_write_mean(at: vec2u, result: vec4f) {
    let index = at.y * packed_visibility_layout.z + at.x;
    if index < arrayLength(&packed_visibility_results) {
        packed_visibility_results[index] = result;
    }
}
