// What filter/bilateral_variance asks for, over a storage buffer: a pixel takes
// three vec4f, its colour and variance, its position and reach, its normal and
// 0. layout.x is the image's width.

@group(2) @binding(5) var<storage, read> bilateral_variance_pixels: array<vec4f>;
@group(2) @binding(6) var<uniform> bilateral_variance_layout: vec4u;

// Outside the buffer: black, without a surface.
fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel {
    let index = at.y * bilateral_variance_layout.x + at.x;
    if index >= arrayLength(&bilateral_variance_pixels) / 3u {
        return BilateralVariancePixel(
            vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0),
        );
    }
    let value = bilateral_variance_pixels[3u * index];
    let place = bilateral_variance_pixels[3u * index + 1u];
    let shape = bilateral_variance_pixels[3u * index + 2u];
    return BilateralVariancePixel(value.xyz, value.w, place.xyz, place.w, shape.xyz);
}
