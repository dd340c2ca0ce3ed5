// temporal/variance_clamp over an image, with any of its ready bindings.

struct VarianceClampPass {
    size: vec2u,
    radius: u32,
    // As for variance_clamp_pixel.
    mode: u32,
    gamma: f32,
}

@group(2) @binding(108) var<uniform> variance_clamp_pass: VarianceClampPass;

// The history, held to its neighbourhood; its length stays.
@compute @workgroup_size(8, 8)
fn variance_clamp_pass_main(@builtin(global_invocation_id) id: vec3u) {
    let size = variance_clamp_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let history = variance_clamp_read_history(id.xy);
    let color = variance_clamp_pixel(
        id.xy,
        size,
        variance_clamp_pass.radius,
        history.xyz,
        variance_clamp_pass.gamma,
        variance_clamp_pass.mode,
    );
    variance_clamp_write(id.xy, vec4f(color, history.w));
}
