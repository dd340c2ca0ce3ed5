// temporal/accumulate over an image, with any of its ready bindings.

struct TemporalAccumulatePass {
    size: vec2u,
    cap: f32,
    moments_cap: f32,
}

@group(2) @binding(115) var<uniform> temporal_accumulate_pass: TemporalAccumulatePass;

// A frame of colours.
@compute @workgroup_size(8, 8)
fn temporal_accumulate_pass_color(@builtin(global_invocation_id) id: vec3u) {
    let size = temporal_accumulate_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let color = temporal_accumulate_read_color(id.xy);
    let moments = temporal_accumulate_read_moments(id.xy);
    let state = temporal_accumulate_rgb_step(
        TemporalAccumulateRgbState(color.xyz, moments.x, moments.y, color.w),
        temporal_accumulate_read_sample(id.xy),
        temporal_accumulate_pass.cap,
        temporal_accumulate_pass.moments_cap,
    );
    temporal_accumulate_write_color(id.xy, vec4f(state.color, state.history));
    temporal_accumulate_write_moments(
        id.xy, vec4f(state.mean_luminance, state.variance, 0.0, state.history),
    );
}

// A frame of scalars.
@compute @workgroup_size(8, 8)
fn temporal_accumulate_pass_scalar(@builtin(global_invocation_id) id: vec3u) {
    let size = temporal_accumulate_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let known = temporal_accumulate_read_moments(id.xy);
    let state = temporal_accumulate_step(
        TemporalAccumulateState(known.x, known.y, known.w),
        temporal_accumulate_read_scalar(id.xy),
        temporal_accumulate_pass.cap,
    );
    temporal_accumulate_write_moments(
        id.xy, vec4f(state.mean, state.variance, 0.0, state.history),
    );
}
