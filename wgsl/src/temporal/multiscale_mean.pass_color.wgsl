// A compute pass of temporal/multiscale_mean over storage buffers: append this
// to the linked module. Each state takes 40 bytes (packed; zeros are none), a
// sample and an answer a vec4f. An answer's w is the state's age in frames.

struct MultiscaleMeanPass {
    // States.
    count: u32,
    short_blend: f32,
    // Longest memory in frames, at most 256.
    longest: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> multiscale_mean_pass: MultiscaleMeanPass;
@group(0) @binding(1) var<storage, read> multiscale_mean_pass_samples: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> multiscale_mean_pass_states:
    array<MultiscaleMeanRobustRgbPacked>;
@group(0) @binding(3) var<storage, read_write> multiscale_mean_pass_answers: array<vec4f>;

// Adds a frame's samples to all states. One row of groups, or several.
@compute @workgroup_size(64)
fn multiscale_mean_pass_step(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let index = id.y * (groups.x * 64u) + id.x;
    if index >= multiscale_mean_pass.count {
        return;
    }
    let state = multiscale_mean_robust_rgb_step(
        multiscale_mean_robust_rgb_unpack(multiscale_mean_pass_states[index]),
        multiscale_mean_pass_samples[index].xyz,
        multiscale_mean_pass.short_blend,
        multiscale_mean_pass.longest,
    );
    multiscale_mean_pass_states[index] = multiscale_mean_robust_rgb_pack(state);
    let answer = multiscale_mean_robust_rgb_value(state);
    multiscale_mean_pass_answers[index] = vec4f(answer, state.age);
}
