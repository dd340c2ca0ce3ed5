// What temporal/taa asks for, over a storage buffer: a pixel of the new frame
// takes a vec4f, its colour and anything. layout.x is the image's width.

@group(2) @binding(31) var<storage, read> taa_pixels: array<vec4f>;
@group(2) @binding(32) var<uniform> taa_layout: vec4u;

// Outside the buffer: black.
fn taa_read(at: vec2u) -> vec3f {
    let index = at.y * taa_layout.x + at.x;
    if index >= arrayLength(&taa_pixels) {
        return vec3f(0.0, 0.0, 0.0);
    }
    return taa_pixels[index].xyz;
}

// For the pass: the history, where the surface was, with its length in w (not
// above 0: none), and the results.
@group(2) @binding(95) var<storage, read> taa_histories: array<vec4f>;
@group(2) @binding(96) var<storage, read_write> taa_results: array<vec4f>;

// Outside the buffer: no history.
fn taa_read_history(at: vec2u) -> vec4f {
    let index = at.y * taa_layout.x + at.x;
    if index >= arrayLength(&taa_histories) {
        return vec4f(0.0, 0.0, 0.0, 0.0);
    }
    return taa_histories[index];
}

fn taa_write(at: vec2u, result: vec4f) {
    let index = at.y * taa_layout.x + at.x;
    if index < arrayLength(&taa_results) {
        taa_results[index] = result;
    }
}
