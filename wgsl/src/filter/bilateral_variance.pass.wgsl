// filter/bilateral_variance over an image, with any of its ready bindings.

struct BilateralVariancePass {
    size: vec2u,
    max_radius: f32,
    max_taps: u32,
    // Changes each pixel's turn: the frame's number.
    seed: u32,
}

@group(2) @binding(78) var<uniform> bilateral_variance_pass: BilateralVariancePass;

// The filtered colours; w is 1.
@compute @workgroup_size(8, 8)
fn bilateral_variance_pass_main(@builtin(global_invocation_id) id: vec3u) {
    let size = bilateral_variance_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let turn = pcg_unit(pcg_hash(id.x ^ pcg_hash(id.y ^ pcg_hash(bilateral_variance_pass.seed))));
    let color = bilateral_variance_pixel(
        id.xy,
        size,
        bilateral_variance_pass.max_radius,
        bilateral_variance_pass.max_taps,
        turn,
    );
    bilateral_variance_write(id.xy, vec4f(color, 1.0));
}
