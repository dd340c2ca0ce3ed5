// What the passes of temporal/accumulate ask for, over textures, with the
// channels of the storage buffers: a colour and its length, the luminance's (or
// the scalar's) mean and variance, 0 and the length again. Read in any float
// format. Moments are always written in 32 bits: their changes are small.

alias TemporalAccumulateTarget = texture_storage_2d<rgba16float, write>;
alias TemporalAccumulateMoments = texture_storage_2d<rgba32float, write>;
// The largest number that fits.
const TEMPORAL_ACCUMULATE_TARGET_MAX: f32 = 65504.0;

@group(2) @binding(109) var temporal_accumulate_samples: texture_2d<f32>;
@group(2) @binding(110) var temporal_accumulate_colors: texture_2d<f32>;
@group(2) @binding(111) var temporal_accumulate_moments: texture_2d<f32>;
@group(2) @binding(112) var temporal_accumulate_new_colors: TemporalAccumulateTarget;
@group(2) @binding(113) var temporal_accumulate_new_moments: TemporalAccumulateMoments;
@group(2) @binding(116) var temporal_accumulate_scalars: texture_2d<f32>;

fn temporal_accumulate_read_sample(at: vec2u) -> vec3f {
    return textureLoad(temporal_accumulate_samples, at, 0).xyz;
}

fn temporal_accumulate_read_scalar(at: vec2u) -> f32 {
    return textureLoad(temporal_accumulate_scalars, at, 0).x;
}

fn temporal_accumulate_read_color(at: vec2u) -> vec4f {
    return textureLoad(temporal_accumulate_colors, at, 0);
}

fn temporal_accumulate_read_moments(at: vec2u) -> vec4f {
    return textureLoad(temporal_accumulate_moments, at, 0);
}

fn temporal_accumulate_write_color(at: vec2u, color: vec4f) {
    let largest = vec4f(TEMPORAL_ACCUMULATE_TARGET_MAX);
    textureStore(temporal_accumulate_new_colors, at, min(max(color, -largest), largest));
}

fn temporal_accumulate_write_moments(at: vec2u, moments: vec4f) {
    textureStore(temporal_accumulate_new_moments, at, moments);
}
