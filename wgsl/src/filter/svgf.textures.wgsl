// What filter/svgf asks for, over textures: view depths (r32float; not above 0
// or not finite: no surface), normals (r32uint: pack2x16snorm of
// octahedral_encode), colours with their variance in w, scalars with theirs in
// y (any float format). For the passes the frames that each pixel has
// accumulated (any float format), and the results. A program with one kind of
// signal leaves the other's textures out of its bind group layout.

alias SvgfTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const SVGF_TARGET_MAX: f32 = 65504.0;

struct SvgfScene {
    // The camera that sees the image.
    camera: Camera,
    // A surface's reach over its depth.
    reach: f32,
}

@group(2) @binding(7) var svgf_depths: texture_2d<f32>;
@group(2) @binding(79) var svgf_normals: texture_2d<u32>;
@group(2) @binding(8) var svgf_colors: texture_2d<f32>;
@group(2) @binding(9) var svgf_scalars: texture_2d<f32>;
@group(2) @binding(10) var<uniform> svgf_scene: SvgfScene;
@group(2) @binding(121) var svgf_histories: texture_2d<f32>;
@group(2) @binding(122) var svgf_new_colors: SvgfTarget;
@group(2) @binding(123) var svgf_new_scalars: texture_storage_2d<rg32float, write>;

fn svgf_read_surface(at: vec2u) -> SvgfSurface {
    let depth = sanitize_finite(textureLoad(svgf_depths, at, 0).x, 0.0);
    if depth <= 0.0 {
        return SvgfSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0));
    }
    let middle = vec2f(f32(at.x) + 0.5, f32(at.y) + 0.5);
    return SvgfSurface(
        camera_position_from_depth(middle, depth, svgf_scene.camera),
        svgf_scene.reach * depth,
        octahedral_unpack(textureLoad(svgf_normals, at, 0).x),
    );
}

fn svgf_read_color(at: vec2u) -> SvgfColor {
    let found = textureLoad(svgf_colors, at, 0);
    return SvgfColor(found.xyz, found.w);
}

fn svgf_read_scalar(at: vec2u) -> SvgfScalar {
    let found = textureLoad(svgf_scalars, at, 0);
    return SvgfScalar(found.x, found.y);
}

fn svgf_read_history(at: vec2u) -> f32 {
    return textureLoad(svgf_histories, at, 0).x;
}

// What is no data stays so: held to the largest number, the next pass would take
// it for one.
fn svgf_write_color(at: vec2u, result: vec4f) {
    let largest = vec4f(SVGF_TARGET_MAX);
    var held = min(max(result, -largest), largest);
    if svgf_color_bits(result.xyz) >= SVGF_VALUE_BITS {
        // An infinity, of bits that no compiler knows.
        let sign = bitcast<u32>(result.x) & 0x80000000u;
        held.x = bitcast<f32>(sign | 0x7f800000u);
    }
    textureStore(svgf_new_colors, at, held);
}

fn svgf_write_scalar(at: vec2u, result: vec2f) {
    textureStore(svgf_new_scalars, at, vec4f(result, 0.0, 1.0));
}
