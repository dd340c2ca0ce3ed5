// What filter/firefly asks for, over a storage buffer: a pixel takes a vec4f,
// its colour and anything. layout.x is the image's width.

@group(2) @binding(23) var<storage, read> firefly_pixels: array<vec4f>;
@group(2) @binding(24) var<uniform> firefly_layout: vec4u;

// Outside the buffer: black.
fn firefly_read(at: vec2u) -> vec3f {
    let index = at.y * firefly_layout.x + at.x;
    if index >= arrayLength(&firefly_pixels) {
        return vec3f(0.0, 0.0, 0.0);
    }
    return firefly_pixels[index].xyz;
}

// For the pass: the results.
@group(2) @binding(85) var<storage, read_write> firefly_results: array<vec4f>;

fn firefly_write(at: vec2u, result: vec4f) {
    let index = at.y * firefly_layout.x + at.x;
    if index < arrayLength(&firefly_results) {
        firefly_results[index] = result;
    }
}
