// What filter/spatial_reconstruct asks for, over textures. At half resolution:
// where the rays hit with their density in w (rgba32float: densities and
// positions do not fit 16 bits), and their radiance (any float format). At full
// resolution: view depths (r32float; not above 0 or not finite: no surface),
// normals (r32uint: pack2x16snorm of octahedral_encode) and GGX's alpha (any
// float format). For the pass the results.

alias SpatialReconstructTarget = texture_storage_2d<rgba16float, write>;
// The largest number that fits.
const SPATIAL_RECONSTRUCT_TARGET_MAX: f32 = 65504.0;

struct SpatialReconstructScene {
    // The camera that sees the full image.
    camera: Camera,
    // Plane distance at which a neighbour no longer counts, over its depth.
    reach: f32,
}

@group(2) @binding(2) var spatial_reconstruct_hits: texture_2d<f32>;
@group(2) @binding(70) var spatial_reconstruct_radiances: texture_2d<f32>;
@group(2) @binding(3) var spatial_reconstruct_depths: texture_2d<f32>;
@group(2) @binding(71) var spatial_reconstruct_normals: texture_2d<u32>;
@group(2) @binding(72) var spatial_reconstruct_alphas: texture_2d<f32>;
@group(2) @binding(4) var<uniform> spatial_reconstruct_scene: SpatialReconstructScene;
@group(2) @binding(73) var spatial_reconstruct_results: SpatialReconstructTarget;

fn spatial_reconstruct_read_hit(at: vec2u) -> SpatialReconstructHit {
    let where_hit = textureLoad(spatial_reconstruct_hits, at, 0);
    return SpatialReconstructHit(
        where_hit.xyz,
        where_hit.w,
        textureLoad(spatial_reconstruct_radiances, at, 0).xyz,
    );
}

fn spatial_reconstruct_read_surface(at: vec2u) -> SpatialReconstructSurface {
    let depth = sanitize_finite(textureLoad(spatial_reconstruct_depths, at, 0).x, 0.0);
    if depth <= 0.0 {
        return SpatialReconstructSurface(
            vec3f(0.0, 0.0, 0.0), 0.0, vec3f(0.0, 0.0, 1.0), 1.0, vec3f(0.0, 0.0, 1.0),
        );
    }
    let middle = vec2f(f32(at.x) + 0.5, f32(at.y) + 0.5);
    let camera = spatial_reconstruct_scene.camera;
    let position = camera_position_from_depth(middle, depth, camera);
    return SpatialReconstructSurface(
        position,
        spatial_reconstruct_scene.reach * depth,
        octahedral_unpack(textureLoad(spatial_reconstruct_normals, at, 0).x),
        textureLoad(spatial_reconstruct_alphas, at, 0).x,
        vec3_normalize(camera.origin - position),
    );
}

fn spatial_reconstruct_write(at: vec2u, result: vec4f) {
    let largest = vec4f(SPATIAL_RECONSTRUCT_TARGET_MAX);
    textureStore(spatial_reconstruct_results, at, min(result, largest));
}
