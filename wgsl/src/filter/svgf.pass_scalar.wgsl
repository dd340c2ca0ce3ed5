// Compute passes of filter/svgf for scalars over storage buffers: append this
// to the linked module. A surface takes two vec4f (position and reach, normal
// and 0), a scalar a vec2f (its variance last), the history an f32, in frames.

struct SvgfPass {
    width: u32,
    height: u32,
    // Pixels between taps.
    step: u32,
    unused: u32,
    settings: SvgfSettings,
}

@group(0) @binding(0) var<uniform> svgf_pass: SvgfPass;
@group(0) @binding(1) var<storage, read> svgf_pass_surfaces: array<vec4f>;
@group(0) @binding(2) var<storage, read> svgf_pass_history: array<f32>;
@group(0) @binding(3) var<storage, read> svgf_pass_input: array<vec2f>;
@group(0) @binding(4) var<storage, read_write> svgf_pass_output: array<vec2f>;

fn svgf_read_surface(at: vec2u) -> SvgfSurface {
    let index = at.y * svgf_pass.width + at.x;
    let place = svgf_pass_surfaces[2u * index];
    return SvgfSurface(place.xyz, place.w, svgf_pass_surfaces[2u * index + 1u].xyz);
}

fn svgf_read_color(at: vec2u) -> SvgfColor {
    return SvgfColor(vec3f(0.0, 0.0, 0.0), 0.0);
}

fn svgf_read_scalar(at: vec2u) -> SvgfScalar {
    let found = svgf_pass_input[at.y * svgf_pass.width + at.x];
    return SvgfScalar(found.x, found.y);
}

// What is filtered here, for the passes over tiles.
const SVGF_PASS_COLOR: bool = false;

// The variance, estimated over the image where the history is short.
fn svgf_pass_estimate(at: vec2u) {
    if at.x >= svgf_pass.width || at.y >= svgf_pass.height {
        return;
    }
    let index = at.y * svgf_pass.width + at.x;
    let size = vec2u(svgf_pass.width, svgf_pass.height);
    let variance = svgf_variance_scalar_pixel(
        at, size, svgf_pass_history[index], svgf_pass.settings,
    );
    svgf_pass_output[index] = vec2f(svgf_pass_input[index].x, variance);
}

fn svgf_pass_filter(at: vec2u) {
    if at.x >= svgf_pass.width || at.y >= svgf_pass.height {
        return;
    }
    let size = vec2u(svgf_pass.width, svgf_pass.height);
    let out = svgf_atrous_scalar_pixel(at, size, svgf_pass.step, svgf_pass.settings);
    svgf_pass_output[at.y * svgf_pass.width + at.x] = vec2f(out.value, out.variance);
}

@compute @workgroup_size(8, 8)
fn svgf_pass_variance(@builtin(global_invocation_id) id: vec3u) {
    svgf_pass_estimate(id.xy);
}

@compute @workgroup_size(8, 8)
fn svgf_pass_atrous(@builtin(global_invocation_id) id: vec3u) {
    svgf_pass_filter(id.xy);
}
