// temporal/taa over an image, with any of its ready bindings.

struct TaaPass {
    size: vec2u,
    alpha: f32,
    exposure: f32,
}

@group(2) @binding(97) var<uniform> taa_pass: TaaPass;

// The new picture; its w is 1, so that it can be the next history.
@compute @workgroup_size(8, 8)
fn taa_pass_main(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= taa_pass.size.x || id.y >= taa_pass.size.y {
        return;
    }
    let history = taa_read_history(id.xy);
    let alpha = select(taa_pass.alpha, 1.0, history.w <= 0.0);
    let color = taa_pixel(id.xy, taa_pass.size, history.xyz, alpha, taa_pass.exposure);
    taa_write(id.xy, vec4f(color, 1.0));
}
