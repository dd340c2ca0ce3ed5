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
