// What filter/svgf asks for, over storage buffers.
//
// A surface takes two vec4f: its position and reach, its normal and 0. A colour
// takes one, its variance last; a scalar takes a vec2f, its variance last.
// layout.x is the image's width. A program with one kind of signal leaves the
// other's buffer out of its bind group layout, or binds a small one.

@group(2) @binding(7) var<storage, read> svgf_surfaces: array<vec4f>;
@group(2) @binding(8) var<storage, read> svgf_colors: array<vec4f>;
@group(2) @binding(9) var<storage, read> svgf_scalars: array<vec2f>;
@group(2) @binding(10) var<uniform> svgf_layout: vec4u;

// Outside the buffer: no surface.
fn svgf_read_surface(at: vec2u) -> SvgfSurface {
    let index = at.y * svgf_layout.x + at.x;
    if index >= arrayLength(&svgf_surfaces) / 2u {
        return SvgfSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0));
    }
    let place = svgf_surfaces[2u * index];
    return SvgfSurface(place.xyz, place.w, svgf_surfaces[2u * index + 1u].xyz);
}

// Outside the buffer: black.
fn svgf_read_color(at: vec2u) -> SvgfColor {
    let index = at.y * svgf_layout.x + at.x;
    if index >= arrayLength(&svgf_colors) {
        return SvgfColor(vec3f(0.0, 0.0, 0.0), 0.0);
    }
    let found = svgf_colors[index];
    return SvgfColor(found.xyz, found.w);
}

// Outside the buffer: 0.
fn svgf_read_scalar(at: vec2u) -> SvgfScalar {
    let index = at.y * svgf_layout.x + at.x;
    if index >= arrayLength(&svgf_scalars) {
        return SvgfScalar(0.0, 0.0);
    }
    let found = svgf_scalars[index];
    return SvgfScalar(found.x, found.y);
}

// For the passes: frames that each pixel has accumulated, and the results.
@group(2) @binding(121) var<storage, read> svgf_histories: array<f32>;
@group(2) @binding(122) var<storage, read_write> svgf_new_colors: array<vec4f>;
@group(2) @binding(123) var<storage, read_write> svgf_new_scalars: array<vec2f>;

// Outside the buffer: none.
fn svgf_read_history(at: vec2u) -> f32 {
    let index = at.y * svgf_layout.x + at.x;
    if index >= arrayLength(&svgf_histories) {
        return 0.0;
    }
    return svgf_histories[index];
}

fn svgf_write_color(at: vec2u, result: vec4f) {
    let index = at.y * svgf_layout.x + at.x;
    if index < arrayLength(&svgf_new_colors) {
        svgf_new_colors[index] = result;
    }
}

fn svgf_write_scalar(at: vec2u, result: vec2f) {
    let index = at.y * svgf_layout.x + at.x;
    if index < arrayLength(&svgf_new_scalars) {
        svgf_new_scalars[index] = result;
    }
}
