// What temporal/reproject asks for, over textures, with three channels: of this
// frame and of the one before view depths (r32float; not above 0 or not finite:
// no surface), normals (r32uint: pack2x16snorm of octahedral_encode) and meshes
// (r32uint); the history with its length in w (any float format). For the
// passes motions (x and y in pixels, from now to then; z the change of view
// depth, from now to then), the distances from a mirror to what it shows, and
// the results.

alias ReprojectValue = vec3f;
alias ReprojectTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const REPROJECT_TARGET_MAX: f32 = 65504.0;

struct ReprojectScene {
    // The camera that sees this frame, and that of the frame before.
    camera: Camera,
    prior_camera: Camera,
}

@group(2) @binding(33) var reproject_depths: texture_2d<f32>;
@group(2) @binding(98) var reproject_normals: texture_2d<u32>;
@group(2) @binding(99) var reproject_meshes: texture_2d<u32>;
@group(2) @binding(34) var reproject_prior_depths: texture_2d<f32>;
@group(2) @binding(100) var reproject_prior_normals: texture_2d<u32>;
@group(2) @binding(101) var reproject_prior_meshes: texture_2d<u32>;
@group(2) @binding(35) var reproject_histories: texture_2d<f32>;
@group(2) @binding(36) var<uniform> reproject_scene: ReprojectScene;
@group(2) @binding(102) var reproject_motions: texture_2d<f32>;
@group(2) @binding(103) var reproject_distances: texture_2d<f32>;
@group(2) @binding(104) var reproject_results: ReprojectTarget;

// What a camera's G-buffer says about a pixel.
fn reproject_surface_from(
    at: vec2u,
    view_depth: f32,
    normal: u32,
    mesh: u32,
    camera: Camera,
) -> ReprojectSurface {
    let depth = sanitize_finite(view_depth, 0.0);
    if depth <= 0.0 {
        return ReprojectSurface(vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 0u);
    }
    let middle = vec2f(f32(at.x) + 0.5, f32(at.y) + 0.5);
    let position = camera_position_from_depth(middle, depth, camera);
    return ReprojectSurface(
        position,
        vec3_length(position - camera.origin),
        octahedral_unpack(normal),
        mesh,
    );
}

fn reproject_read_surface(at: vec2u) -> ReprojectSurface {
    return reproject_surface_from(
        at,
        textureLoad(reproject_depths, at, 0).x,
        textureLoad(reproject_normals, at, 0).x,
        textureLoad(reproject_meshes, at, 0).x,
        reproject_scene.camera,
    );
}

fn reproject_read_prior(at: vec2u) -> ReprojectSurface {
    return reproject_surface_from(
        at,
        textureLoad(reproject_prior_depths, at, 0).x,
        textureLoad(reproject_prior_normals, at, 0).x,
        textureLoad(reproject_prior_meshes, at, 0).x,
        reproject_scene.prior_camera,
    );
}

// The history of a pixel; none where it is not finite.
fn reproject_read_history(at: vec2u) -> ReprojectHistory {
    let texel = textureLoad(reproject_histories, at, 0);
    let bits = bitcast<vec4u>(texel);
    let finite = (finite_bits(bits.x) & finite_bits(bits.y))
        & (finite_bits(bits.z) & finite_bits(bits.w));
    if finite == 0u {
        return ReprojectHistory(vec3f(0.0, 0.0, 0.0), 0.0);
    }
    return ReprojectHistory(texel.xyz, texel.w);
}

fn reproject_read_motion(at: vec2u) -> vec3f {
    return textureLoad(reproject_motions, at, 0).xyz;
}

fn reproject_read_distance(at: vec2u) -> f32 {
    return textureLoad(reproject_distances, at, 0).x;
}

fn reproject_write(at: vec2u, result: vec4f) {
    let largest = vec4f(REPROJECT_TARGET_MAX);
    textureStore(reproject_results, at, min(max(result, -largest), largest));
}
