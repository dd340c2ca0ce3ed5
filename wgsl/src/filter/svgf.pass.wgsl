// filter/svgf over an image, with any of its ready bindings: the variance, then
// the passes, whose steps are 1, 2, 4, 8, 16.

struct SvgfImagePass {
    size: vec2u,
    // Pixels between taps.
    step: u32,
    unused: u32,
    settings: SvgfSettings,
}

@group(2) @binding(124) var<uniform> svgf_image_pass: SvgfImagePass;

// Whether a thread has no pixel.
fn svgf_image_pass_outside(at: vec2u) -> bool {
    return at.x >= svgf_image_pass.size.x || at.y >= svgf_image_pass.size.y;
}

// The colours, with their variance: estimated over the image where the history
// is short.
@compute @workgroup_size(8, 8)
fn svgf_image_pass_variance_color(@builtin(global_invocation_id) id: vec3u) {
    if svgf_image_pass_outside(id.xy) {
        return;
    }
    let variance = svgf_variance_pixel(
        id.xy, svgf_image_pass.size, svgf_read_history(id.xy), svgf_image_pass.settings,
    );
    svgf_write_color(id.xy, vec4f(svgf_read_color(id.xy).value, variance));
}

@compute @workgroup_size(8, 8)
fn svgf_image_pass_atrous_color(@builtin(global_invocation_id) id: vec3u) {
    if svgf_image_pass_outside(id.xy) {
        return;
    }
    let out = svgf_atrous_pixel(
        id.xy, svgf_image_pass.size, svgf_image_pass.step, svgf_image_pass.settings,
    );
    svgf_write_color(id.xy, vec4f(out.value, out.variance));
}

// The same for one channel.
@compute @workgroup_size(8, 8)
fn svgf_image_pass_variance_scalar(@builtin(global_invocation_id) id: vec3u) {
    if svgf_image_pass_outside(id.xy) {
        return;
    }
    let variance = svgf_variance_scalar_pixel(
        id.xy, svgf_image_pass.size, svgf_read_history(id.xy), svgf_image_pass.settings,
    );
    svgf_write_scalar(id.xy, vec2f(svgf_read_scalar(id.xy).value, variance));
}

@compute @workgroup_size(8, 8)
fn svgf_image_pass_atrous_scalar(@builtin(global_invocation_id) id: vec3u) {
    if svgf_image_pass_outside(id.xy) {
        return;
    }
    let out = svgf_atrous_scalar_pixel(
        id.xy, svgf_image_pass.size, svgf_image_pass.step, svgf_image_pass.settings,
    );
    svgf_write_scalar(id.xy, vec2f(out.value, out.variance));
}
