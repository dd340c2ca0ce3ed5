// What filter/separable_blur asks for, over textures: view depths (r32float;
// not above 0 or not finite: no surface), normals (r32uint: pack2x16snorm of
// octahedral_encode), values (r32float), and for the pass the results. Between
// the passes bind the first one's result as values.

struct SeparableBlurScene {
    // The camera that sees the image.
    camera: Camera,
    // A surface's reach over its depth.
    reach: f32,
}

@group(2) @binding(28) var separable_blur_depths: texture_2d<f32>;
@group(2) @binding(92) var separable_blur_normals: texture_2d<u32>;
@group(2) @binding(29) var separable_blur_values: texture_2d<f32>;
@group(2) @binding(30) var<uniform> separable_blur_scene: SeparableBlurScene;
@group(2) @binding(93) var separable_blur_results: texture_storage_2d<r32float, write>;

fn separable_blur_read(at: vec2u) -> SeparableBlurPixel {
    let value = textureLoad(separable_blur_values, at, 0).x;
    let depth = sanitize_finite(textureLoad(separable_blur_depths, at, 0).x, 0.0);
    if depth <= 0.0 {
        return SeparableBlurPixel(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), value);
    }
    let middle = vec2f(f32(at.x) + 0.5, f32(at.y) + 0.5);
    return SeparableBlurPixel(
        camera_position_from_depth(middle, depth, separable_blur_scene.camera),
        separable_blur_scene.reach * depth,
        octahedral_unpack(textureLoad(separable_blur_normals, at, 0).x),
        value,
    );
}

fn separable_blur_write(at: vec2u, result: f32) {
    textureStore(separable_blur_results, at, vec4f(result, 0.0, 0.0, 1.0));
}
