// Compute passes that leave out the tiles which filter/svgf cannot change. The
// program is the linked modules filter/svgf and filter/tiles, the passes for one
// kind of signal, the bindings of filter/tiles, and this. Dispatched in this
// order, tiles_list.count cleared before:
//   classify   a workgroup a tile
//   rows       a thread a tile
//   list       a workgroup a tile; input and output are the variance's
//   arguments  one thread; then copy tiles_list.groups to a buffer
//   variance_listed and atrous_listed, indirect from that buffer

fn svgf_pass_flags(at: vec2u) -> u32 {
    let surface = select(0u, 1u, svgf_surface_usable(svgf_read_surface(at)));
    if SVGF_PASS_COLOR {
        let color = svgf_read_color(at);
        return tiles_color_flags(color.value, color.variance, surface);
    }
    let found = svgf_read_scalar(at);
    return tiles_scalar_flags(found.value, found.variance, surface);
}

@compute @workgroup_size(8, 8)
fn svgf_pass_classify(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    var flags = TILES_NONE;
    if id.x < svgf_pass.width && id.y < svgf_pass.height {
        flags = svgf_pass_flags(id.xy);
    }
    let all_flags = tiles_collect(lane, flags);
    if lane == 0u {
        tiles_tile_flags[tile.y * tiles_layout.z + tile.x] = all_flags;
    }
}

@compute @workgroup_size(8, 8)
fn svgf_pass_rows(@builtin(global_invocation_id) id: vec3u) {
    let tiles = tiles_count(tiles_layout.xy);
    if id.x < tiles.x && id.y < tiles.y {
        let index = id.y * tiles_layout.z + id.x;
        tiles_row_flags[index] = tiles_horizontal(id.xy, tiles, tiles_layout.w);
    }
}

var<workgroup> svgf_pass_needed: u32;

// Lists a tile, or gives it to all later passes as it is: they write two images
// in turn, and both must hold it.
@compute @workgroup_size(8, 8)
fn svgf_pass_list(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) tile: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if lane == 0u {
        let tiles = tiles_count(tiles_layout.xy);
        let around = tiles_vertical(tile.xy, tiles, tiles_layout.w);
        let needed = tiles_needed(tiles_read(tile.xy), around);
        if needed != 0u {
            tiles_add(tile.y * tiles_layout.z + tile.x);
        }
        svgf_pass_needed = needed;
    }
    workgroupBarrier();
    if svgf_pass_needed == 0u && id.x < svgf_pass.width && id.y < svgf_pass.height {
        let index = id.y * svgf_pass.width + id.x;
        svgf_pass_output[index] = svgf_pass_input[index];
    }
}

@compute @workgroup_size(1)
fn svgf_pass_arguments() {
    let tiles = tiles_count(tiles_layout.xy);
    let found = tiles_dispatch(
        atomicLoad(&tiles_list.count), arrayLength(&tiles_list.tiles), tiles.x * tiles.y,
    );
    tiles_list.groups = found.groups;
    tiles_list.whole = found.whole;
}

// A thread's pixel in the tile that its workgroup takes from the list; outside
// the image if there is none.
fn svgf_pass_taken(group: vec2u, local: vec2u) -> vec2u {
    let tiles = tiles_count(tiles_layout.xy);
    let taken = tiles_take(group, tiles.x * tiles.y);
    if taken.y == 0u {
        return tiles_layout.xy;
    }
    let tile = tiles_at(taken.x, tiles_layout.z);
    return vec2u(tile.x * TILES_SIZE + local.x, tile.y * TILES_SIZE + local.y);
}

@compute @workgroup_size(8, 8)
fn svgf_pass_variance_listed(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    svgf_pass_estimate(svgf_pass_taken(group.xy, local.xy));
}

@compute @workgroup_size(8, 8)
fn svgf_pass_atrous_listed(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
) {
    svgf_pass_filter(svgf_pass_taken(group.xy, local.xy));
}
