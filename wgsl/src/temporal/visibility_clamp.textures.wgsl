// What the pass of temporal/visibility_clamp asks for besides the words of
// filter/packed_visibility, over textures: the history of each pixel's
// visibility (any float format), and the results.

@group(2) @binding(118) var visibility_clamp_histories: texture_2d<f32>;
@group(2) @binding(119) var visibility_clamp_results: texture_storage_2d<r32float, write>;

fn visibility_clamp_read_history(at: vec2u) -> f32 {
    return textureLoad(visibility_clamp_histories, at, 0).x;
}

fn visibility_clamp_write(at: vec2u, result: f32) {
    textureStore(visibility_clamp_results, at, vec4f(result, 0.0, 0.0, 1.0));
}
