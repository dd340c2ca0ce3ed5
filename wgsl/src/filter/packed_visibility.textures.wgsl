// What filter/packed_visibility asks for, over textures: the words of the
// blocks, and the rows' sums, a pixel each (r32uint). For the passes: each
// pixel's visibility, above 0 where its ray reached the light (any float
// format); the words; the rows' sums; the results.

@group(2) @binding(20) var packed_visibility_words: texture_2d<u32>;
@group(2) @binding(21) var packed_visibility_rows: texture_2d<u32>;
@group(2) @binding(80) var packed_visibility_visible: texture_2d<f32>;
@group(2) @binding(81) var packed_visibility_new_words: texture_storage_2d<r32uint, write>;
@group(2) @binding(82) var packed_visibility_new_rows: texture_storage_2d<r32uint, write>;
@group(2) @binding(83) var packed_visibility_results: texture_storage_2d<rgba16float, write>;

fn packed_visibility_read(block: vec2u) -> u32 {
    return textureLoad(packed_visibility_words, block, 0).x;
}

fn packed_visibility_read_row(pixel: vec2u) -> u32 {
    return textureLoad(packed_visibility_rows, pixel, 0).x;
}

fn packed_visibility_read_visible(at: vec2u) -> f32 {
    return textureLoad(packed_visibility_visible, at, 0).x;
}

fn packed_visibility_write(block: vec2u, word: u32) {
    textureStore(packed_visibility_new_words, block, vec4u(word, 0u, 0u, 1u));
}

fn packed_visibility_write_row(at: vec2u, sum: u32) {
    textureStore(packed_visibility_new_rows, at, vec4u(sum, 0u, 0u, 1u));
}

fn packed_visibility_write_mean(at: vec2u, result: vec4f) {
    textureStore(packed_visibility_results, at, result);
}
