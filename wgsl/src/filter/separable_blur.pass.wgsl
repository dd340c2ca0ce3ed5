// filter/separable_blur over an image, with any of its ready bindings: rows,
// then columns.

struct SeparableBlurPass {
    size: vec2u,
    radius: u32,
}

@group(2) @binding(94) var<uniform> separable_blur_pass: SeparableBlurPass;

fn separable_blur_pass_axis(pixel: vec2u, axis: u32) {
    let size = separable_blur_pass.size;
    if pixel.x >= size.x || pixel.y >= size.y {
        return;
    }
    let radius = separable_blur_pass.radius;
    separable_blur_write(pixel, separable_blur_pixel(pixel, size, axis, radius));
}

@compute @workgroup_size(8, 8)
fn separable_blur_pass_rows(@builtin(global_invocation_id) id: vec3u) {
    separable_blur_pass_axis(id.xy, 0u);
}

@compute @workgroup_size(8, 8)
fn separable_blur_pass_columns(@builtin(global_invocation_id) id: vec3u) {
    separable_blur_pass_axis(id.xy, 1u);
}
