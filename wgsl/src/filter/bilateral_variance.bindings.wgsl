// What filter/bilateral_variance asks for, over storage buffers: a pixel takes
// a vec4f, its colour and variance; its surface two, position and reach, normal
// and 0. layout.x is the image's width.

@group(2) @binding(5) var<storage, read> bilateral_variance_colors: array<vec4f>;
@group(2) @binding(75) var<storage, read> bilateral_variance_surfaces: array<vec4f>;
@group(2) @binding(6) var<uniform> bilateral_variance_layout: vec4u;

// Outside the buffer: black, without a surface.
fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel {
    let index = at.y * bilateral_variance_layout.x + at.x;
    if index >= arrayLength(&bilateral_variance_colors)
        || index >= arrayLength(&bilateral_variance_surfaces) / 2u {
        return BilateralVariancePixel(
            vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0),
        );
    }
    let value = bilateral_variance_colors[index];
    let place = bilateral_variance_surfaces[2u * index];
    let shape = bilateral_variance_surfaces[2u * index + 1u];
    return BilateralVariancePixel(value.xyz, value.w, place.xyz, place.w, shape.xyz);
}

// For the pass: the results.
@group(2) @binding(77) var<storage, read_write> bilateral_variance_results: array<vec4f>;

fn bilateral_variance_write(at: vec2u, result: vec4f) {
    let index = at.y * bilateral_variance_layout.x + at.x;
    if index < arrayLength(&bilateral_variance_results) {
        bilateral_variance_results[index] = result;
    }
}
