// What temporal/variance_clamp asks for, over textures: the current frame's
// colours, and for the pass the history, with its length in w, and the results.
// Read in any float format.

alias VarianceClampTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const VARIANCE_CLAMP_TARGET_MAX: f32 = 65504.0;

@group(2) @binding(37) var variance_clamp_colors: texture_2d<f32>;
@group(2) @binding(106) var variance_clamp_histories: texture_2d<f32>;
@group(2) @binding(107) var variance_clamp_results: VarianceClampTarget;

fn variance_clamp_read(at: vec2u) -> vec3f {
    return textureLoad(variance_clamp_colors, at, 0).xyz;
}

fn variance_clamp_read_history(at: vec2u) -> vec4f {
    return textureLoad(variance_clamp_histories, at, 0);
}

fn variance_clamp_write(at: vec2u, result: vec4f) {
    let largest = vec4f(VARIANCE_CLAMP_TARGET_MAX);
    textureStore(variance_clamp_results, at, min(max(result, -largest), largest));
}
