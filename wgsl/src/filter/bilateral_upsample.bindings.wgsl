// What filter/bilateral_upsample asks for, over storage buffers. A surface
// takes two vec4f, position and reach, normal and 0; a tap one, colour and
// weight, and its surface two. layout.x is the width of the full
// image, layout.y that of the low-resolution one.

@group(2) @binding(25) var<storage, read> bilateral_upsample_surfaces: array<vec4f>;
@group(2) @binding(26) var<storage, read> bilateral_upsample_colors: array<vec4f>;
@group(2) @binding(88) var<storage, read> bilateral_upsample_low_surfaces: array<vec4f>;
@group(2) @binding(27) var<uniform> bilateral_upsample_layout: vec4u;

// Outside the buffer: no surface.
fn bilateral_upsample_read_surface(pixel: vec2u) -> BilateralUpsampleSurface {
    let index = pixel.y * bilateral_upsample_layout.x + pixel.x;
    if index >= arrayLength(&bilateral_upsample_surfaces) / 2u {
        return BilateralUpsampleSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0));
    }
    let place = bilateral_upsample_surfaces[2u * index];
    let shape = bilateral_upsample_surfaces[2u * index + 1u];
    return BilateralUpsampleSurface(place.xyz, place.w, shape.xyz);
}

// Outside the buffer: no value.
fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap {
    let index = at.y * bilateral_upsample_layout.y + at.x;
    if index >= arrayLength(&bilateral_upsample_colors)
        || index >= arrayLength(&bilateral_upsample_low_surfaces) / 2u {
        return BilateralUpsampleTap(
            vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 1.0),
        );
    }
    let value = bilateral_upsample_colors[index];
    let place = bilateral_upsample_low_surfaces[2u * index];
    let shape = bilateral_upsample_low_surfaces[2u * index + 1u];
    return BilateralUpsampleTap(value.xyz, value.w, place.xyz, shape.xyz);
}

// For the pass: the results.
@group(2) @binding(90) var<storage, read_write> bilateral_upsample_results: array<vec4f>;

fn bilateral_upsample_write(at: vec2u, result: vec4f) {
    let index = at.y * bilateral_upsample_layout.x + at.x;
    if index < arrayLength(&bilateral_upsample_results) {
        bilateral_upsample_results[index] = result;
    }
}
