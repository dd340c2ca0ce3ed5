// What the pass of temporal/visibility_clamp asks for besides the words of
// filter/packed_visibility, over storage buffers: the history of each pixel's
// visibility, and the results, an f32 each, of the image that
// packed_visibility_layout describes.

@group(2) @binding(118) var<storage, read> visibility_clamp_histories: array<f32>;
@group(2) @binding(119) var<storage, read_write> visibility_clamp_results: array<f32>;

// Outside the buffer: 0.
fn visibility_clamp_read_history(at: vec2u) -> f32 {
    let index = at.y * packed_visibility_layout.z + at.x;
    if index >= arrayLength(&visibility_clamp_histories) {
        return 0.0;
    }
    return visibility_clamp_histories[index];
}

fn visibility_clamp_write(at: vec2u, result: f32) {
    let index = at.y * packed_visibility_layout.z + at.x;
    if index < arrayLength(&visibility_clamp_results) {
        visibility_clamp_results[index] = result;
    }
}
