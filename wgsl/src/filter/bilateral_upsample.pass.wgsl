// filter/bilateral_upsample over an image, with any of its ready bindings.

struct BilateralUpsamplePass {
    size: vec2u,
    low_size: vec2u,
    scale: u32,
}

@group(2) @binding(91) var<uniform> bilateral_upsample_pass: BilateralUpsamplePass;

// The colours at full resolution; w is 1.
@compute @workgroup_size(8, 8)
fn bilateral_upsample_pass_main(@builtin(global_invocation_id) id: vec3u) {
    let size = bilateral_upsample_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let color = bilateral_upsample_pixel(
        id.xy, bilateral_upsample_pass.low_size, bilateral_upsample_pass.scale,
    );
    bilateral_upsample_write(id.xy, vec4f(color, 1.0));
}
