// What filter/separable_blur asks for, over storage buffers: a surface takes
// two vec4f, position and reach, normal and 0; a value one f32. layout.x is
// the image's width. Between the passes bind the first one's result.

@group(2) @binding(28) var<storage, read> separable_blur_surfaces: array<vec4f>;
@group(2) @binding(29) var<storage, read> separable_blur_values: array<f32>;
@group(2) @binding(30) var<uniform> separable_blur_layout: vec4u;

// Outside the buffers: 0, without a surface.
fn separable_blur_read(at: vec2u) -> SeparableBlurPixel {
    let index = at.y * separable_blur_layout.x + at.x;
    if index >= arrayLength(&separable_blur_surfaces) / 2u
        || index >= arrayLength(&separable_blur_values) {
        return SeparableBlurPixel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0.0);
    }
    let place = separable_blur_surfaces[2u * index];
    let shape = separable_blur_surfaces[2u * index + 1u];
    return SeparableBlurPixel(place.xyz, place.w, shape.xyz, separable_blur_values[index]);
}

// For the pass: what an axis gives.
@group(2) @binding(93) var<storage, read_write> separable_blur_results: array<f32>;

fn separable_blur_write(at: vec2u, result: f32) {
    let index = at.y * separable_blur_layout.x + at.x;
    if index < arrayLength(&separable_blur_results) {
        separable_blur_results[index] = result;
    }
}
