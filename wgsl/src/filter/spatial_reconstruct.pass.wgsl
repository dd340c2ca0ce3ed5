// filter/spatial_reconstruct over an image, with any of its ready bindings.

struct SpatialReconstructPass {
    size: vec2u,
    // Of the half-resolution image.
    low_size: vec2u,
    count: u32,
    // Changes each pixel's turn: the frame's number.
    seed: u32,
}

@group(2) @binding(74) var<uniform> spatial_reconstruct_pass: SpatialReconstructPass;

// The reconstructed colours, with their variance in w.
@compute @workgroup_size(8, 8)
fn spatial_reconstruct_pass_main(@builtin(global_invocation_id) id: vec3u) {
    let size = spatial_reconstruct_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let seed = spatial_reconstruct_pass.seed;
    let found = spatial_reconstruct_pixel(
        id.xy,
        spatial_reconstruct_pass.low_size,
        spatial_reconstruct_pass.count,
        pcg_unit(pcg_hash(id.x ^ pcg_hash(id.y ^ pcg_hash(seed)))),
    );
    spatial_reconstruct_write(id.xy, vec4f(found.color, found.variance));
}
