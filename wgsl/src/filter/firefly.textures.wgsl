// What filter/firefly asks for, over textures: the colours, read in any float
// format, and for the pass the results.

alias FireflyTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const FIREFLY_TARGET_MAX: f32 = 65504.0;

@group(2) @binding(23) var firefly_colors: texture_2d<f32>;
@group(2) @binding(85) var firefly_results: FireflyTarget;

fn firefly_read(at: vec2u) -> vec3f {
    return textureLoad(firefly_colors, at, 0).xyz;
}

fn firefly_write(at: vec2u, result: vec4f) {
    textureStore(firefly_results, at, min(result, vec4f(FIREFLY_TARGET_MAX)));
}
