// What temporal/taa asks for, over textures: the new frame, and for the pass
// the history, where the surface was, with its length in w (not above 0: none),
// and the results. Read in any float format.

alias TaaTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const TAA_TARGET_MAX: f32 = 65504.0;

@group(2) @binding(31) var taa_colors: texture_2d<f32>;
@group(2) @binding(95) var taa_histories: texture_2d<f32>;
@group(2) @binding(96) var taa_results: TaaTarget;

fn taa_read(at: vec2u) -> vec3f {
    return textureLoad(taa_colors, at, 0).xyz;
}

fn taa_read_history(at: vec2u) -> vec4f {
    return textureLoad(taa_histories, at, 0);
}

fn taa_write(at: vec2u, result: vec4f) {
    textureStore(taa_results, at, min(result, vec4f(TAA_TARGET_MAX)));
}
