// What temporal/variance_clamp asks for, over a storage buffer: the current
// frame's colours, a vec4f a pixel (the last is free). layout.x is the image's
// width.

@group(2) @binding(26) var<storage, read> variance_clamp_pixels: array<vec4f>;
@group(2) @binding(27) var<uniform> variance_clamp_layout: vec4u;

// Outside the buffer: black.
fn variance_clamp_read(at: vec2u) -> vec3f {
    let index = at.y * variance_clamp_layout.x + at.x;
    if index >= arrayLength(&variance_clamp_pixels) {
        return vec3f(0.0, 0.0, 0.0);
    }
    return variance_clamp_pixels[index].xyz;
}
