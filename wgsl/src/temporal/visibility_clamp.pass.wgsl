// temporal/visibility_clamp over an image, with any of its ready bindings.

struct VisibilityClampPass {
    size: vec2u,
    gamma: f32,
}

@group(2) @binding(120) var<uniform> visibility_clamp_pass: VisibilityClampPass;

// The history, held to the rays around each pixel.
@compute @workgroup_size(8, 8)
fn visibility_clamp_pass_main(@builtin(global_invocation_id) id: vec3u) {
    let size = visibility_clamp_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let history = visibility_clamp_read_history(id.xy);
    visibility_clamp_write(
        id.xy, visibility_clamp_pixel(id.xy, size, history, visibility_clamp_pass.gamma),
    );
}
