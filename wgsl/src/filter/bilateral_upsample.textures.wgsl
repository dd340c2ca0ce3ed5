// What filter/bilateral_upsample asks for, over textures. At full resolution:
// view depths (r32float; not above 0 or not finite: no surface) and normals
// (r32uint: pack2x16snorm of octahedral_encode). At low resolution: colours
// with their weight in w (any float format), depths and normals, as seen in the
// middle of the scale x scale pixels for which each stands. For the pass the
// results.

alias BilateralUpsampleTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const BILATERAL_UPSAMPLE_TARGET_MAX: f32 = 65504.0;

struct BilateralUpsampleScene {
    // The camera that sees the full image.
    camera: Camera,
    // A surface's reach over its depth.
    reach: f32,
    // Pixels of the full image for one of the low, along each side.
    scale: f32,
}

@group(2) @binding(25) var bilateral_upsample_depths: texture_2d<f32>;
@group(2) @binding(87) var bilateral_upsample_normals: texture_2d<u32>;
@group(2) @binding(26) var bilateral_upsample_colors: texture_2d<f32>;
@group(2) @binding(88) var bilateral_upsample_low_depths: texture_2d<f32>;
@group(2) @binding(89) var bilateral_upsample_low_normals: texture_2d<u32>;
@group(2) @binding(27) var<uniform> bilateral_upsample_scene: BilateralUpsampleScene;
@group(2) @binding(90) var bilateral_upsample_results: BilateralUpsampleTarget;

fn bilateral_upsample_read_surface(pixel: vec2u) -> BilateralUpsampleSurface {
    let depth = sanitize_finite(textureLoad(bilateral_upsample_depths, pixel, 0).x, 0.0);
    if depth <= 0.0 {
        return BilateralUpsampleSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0));
    }
    let middle = vec2f(f32(pixel.x) + 0.5, f32(pixel.y) + 0.5);
    return BilateralUpsampleSurface(
        camera_position_from_depth(middle, depth, bilateral_upsample_scene.camera),
        bilateral_upsample_scene.reach * depth,
        octahedral_unpack(textureLoad(bilateral_upsample_normals, pixel, 0).x),
    );
}

fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap {
    let value = textureLoad(bilateral_upsample_colors, at, 0);
    let depth = sanitize_finite(textureLoad(bilateral_upsample_low_depths, at, 0).x, 0.0);
    if depth <= 0.0 {
        return BilateralUpsampleTap(
            value.xyz, 0.0, vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 1.0),
        );
    }
    let scale = bilateral_upsample_scene.scale;
    let middle = vec2f((f32(at.x) + 0.5) * scale, (f32(at.y) + 0.5) * scale);
    return BilateralUpsampleTap(
        value.xyz,
        value.w,
        camera_position_from_depth(middle, depth, bilateral_upsample_scene.camera),
        octahedral_unpack(textureLoad(bilateral_upsample_low_normals, at, 0).x),
    );
}

fn bilateral_upsample_write(at: vec2u, result: vec4f) {
    textureStore(bilateral_upsample_results, at, min(result, vec4f(BILATERAL_UPSAMPLE_TARGET_MAX)));
}
