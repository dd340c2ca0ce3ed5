// What temporal/variance_clamp asks for, over a storage buffer: the current
// frame's colours, a vec4f a pixel (the last is free). layout.x is the image's
// width.

@group(2) @binding(37) var<storage, read> variance_clamp_pixels: array<vec4f>;
@group(2) @binding(38) var<uniform> variance_clamp_layout: vec4u;

// Outside the buffer: black.
fn variance_clamp_read(at: vec2u) -> vec3f {
    let index = at.y * variance_clamp_layout.x + at.x;
    if index >= arrayLength(&variance_clamp_pixels) {
        return vec3f(0.0, 0.0, 0.0);
    }
    return variance_clamp_pixels[index].xyz;
}

// For the pass: the history, with its length in w, and the results.
@group(2) @binding(106) var<storage, read> variance_clamp_histories: array<vec4f>;
@group(2) @binding(107) var<storage, read_write> variance_clamp_results: array<vec4f>;

// Outside the buffer: no history.
fn variance_clamp_read_history(at: vec2u) -> vec4f {
    let index = at.y * variance_clamp_layout.x + at.x;
    if index >= arrayLength(&variance_clamp_histories) {
        return vec4f(0.0, 0.0, 0.0, 0.0);
    }
    return variance_clamp_histories[index];
}

fn variance_clamp_write(at: vec2u, result: vec4f) {
    let index = at.y * variance_clamp_layout.x + at.x;
    if index < arrayLength(&variance_clamp_results) {
        variance_clamp_results[index] = result;
    }
}
