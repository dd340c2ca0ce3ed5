// filter/packed_visibility over an image, with any of its ready bindings: words
// from pixels, sums over rows, means over 17 x 17 pixels.

struct PackedVisibilityPass {
    size: vec2u,
}

@group(2) @binding(84) var<uniform> packed_visibility_pass: PackedVisibilityPass;

// Whether a thread's ray reached the light; not outside the image.
fn packed_visibility_pass_visible(pixel: vec2u) -> bool {
    let size = packed_visibility_pass.size;
    if pixel.x >= size.x || pixel.y >= size.y {
        return false;
    }
    return packed_visibility_read_visible(pixel) > 0.0;
}

// A word for each block of 8 x 4 pixels.
@compute @workgroup_size(8, 4)
fn packed_visibility_pass_pack(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) block: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let word = packed_visibility_ballot(lane, packed_visibility_pass_visible(id.xy));
    if lane == 0u {
        packed_visibility_write(block.xy, word);
    }
}

// The sum of 17 pixels of a row.
@compute @workgroup_size(8, 8)
fn packed_visibility_pass_rows(@builtin(global_invocation_id) id: vec3u) {
    let size = packed_visibility_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    packed_visibility_write_row(id.xy, packed_visibility_horizontal(id.xy, size));
}

// Mean, variance, sum and number of the rays around a pixel.
@compute @workgroup_size(8, 8)
fn packed_visibility_pass_mean(@builtin(global_invocation_id) id: vec3u) {
    let size = packed_visibility_pass.size;
    if id.x >= size.x || id.y >= size.y {
        return;
    }
    let sum = packed_visibility_vertical(id.xy, size);
    let area = packed_visibility_area(id.xy, size);
    packed_visibility_write_mean(id.xy, vec4f(
        packed_visibility_mean(sum, area),
        packed_visibility_variance(sum, area),
        f32(sum),
        f32(area),
    ));
}
