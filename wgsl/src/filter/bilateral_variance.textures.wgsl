// What filter/bilateral_variance asks for, over textures: colours with their
// variance in w (any float format), view depths (r32float; not above 0 or not
// finite: no surface), normals (r32uint: pack2x16snorm of octahedral_encode),
// and for the pass the results.

alias BilateralVarianceTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const BILATERAL_VARIANCE_TARGET_MAX: f32 = 65504.0;

struct BilateralVarianceScene {
    // The camera that sees the image.
    camera: Camera,
    // A surface's reach over its depth.
    reach: f32,
}

@group(2) @binding(5) var bilateral_variance_colors: texture_2d<f32>;
@group(2) @binding(75) var bilateral_variance_depths: texture_2d<f32>;
@group(2) @binding(76) var bilateral_variance_normals: texture_2d<u32>;
@group(2) @binding(6) var<uniform> bilateral_variance_scene: BilateralVarianceScene;
@group(2) @binding(77) var bilateral_variance_results: BilateralVarianceTarget;

fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel {
    let value = textureLoad(bilateral_variance_colors, at, 0);
    let depth = sanitize_finite(textureLoad(bilateral_variance_depths, at, 0).x, 0.0);
    if depth <= 0.0 {
        return BilateralVariancePixel(
            value.xyz, value.w, vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0),
        );
    }
    let middle = vec2f(f32(at.x) + 0.5, f32(at.y) + 0.5);
    return BilateralVariancePixel(
        value.xyz,
        value.w,
        camera_position_from_depth(middle, depth, bilateral_variance_scene.camera),
        bilateral_variance_scene.reach * depth,
        octahedral_unpack(textureLoad(bilateral_variance_normals, at, 0).x),
    );
}

fn bilateral_variance_write(at: vec2u, result: vec4f) {
    textureStore(bilateral_variance_results, at, min(result, vec4f(BILATERAL_VARIANCE_TARGET_MAX)));
}
