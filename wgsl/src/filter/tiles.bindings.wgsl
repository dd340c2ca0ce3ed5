// What filter/tiles asks for, over storage buffers: a word of flags for each
// pixel, each tile and each tile's row, all row by row; and a list of tiles
// behind what an indirect dispatch reads. layout is the image's width and
// height, the number of tiles in a row and their reach in tiles. And how a
// workgroup of 8 x 8 threads makes its tile's flags, and adds it to the list.

struct TilesList {
    // What tiles_dispatch gives, after all tiles were added: copy the groups to
    // a buffer for the indirect dispatch.
    groups: vec3u,
    whole: u32,
    // Tiles added, also those that found no room. Clear it before.
    count: atomic<u32>,
    tiles: array<u32>,
}

@group(2) @binding(40) var<storage, read> tiles_pixel_flags: array<u32>;
@group(2) @binding(41) var<storage, read_write> tiles_tile_flags: array<u32>;
@group(2) @binding(42) var<storage, read_write> tiles_row_flags: array<u32>;
@group(2) @binding(43) var<storage, read_write> tiles_list: TilesList;
@group(2) @binding(44) var<uniform> tiles_layout: vec4u;

var<workgroup> tiles_shared: atomic<u32>;

// Outside a buffer: to be filtered.
fn tiles_read_pixel(at: vec2u) -> u32 {
    let index = at.y * tiles_layout.x + at.x;
    if index >= arrayLength(&tiles_pixel_flags) {
        return TILES_MIXED;
    }
    return tiles_pixel_flags[index];
}

fn tiles_read(tile: vec2u) -> u32 {
    let index = tile.y * tiles_layout.z + tile.x;
    if index >= arrayLength(&tiles_tile_flags) {
        return TILES_MIXED;
    }
    return tiles_tile_flags[index];
}

fn tiles_read_row(tile: vec2u) -> u32 {
    let index = tile.y * tiles_layout.z + tile.x;
    if index >= arrayLength(&tiles_row_flags) {
        return TILES_MIXED;
    }
    return tiles_row_flags[index];
}

// The flags of all threads of a workgroup together, the same in all of them:
// lane is the local_invocation_index. All threads call it.
fn tiles_collect(lane: u32, flags: u32) -> u32 {
    if lane == 0u {
        atomicStore(&tiles_shared, 0u);
    }
    workgroupBarrier();
    atomicOr(&tiles_shared, flags);
    workgroupBarrier();
    let all = atomicLoad(&tiles_shared);
    // The next call may not clear it while another thread still reads.
    workgroupBarrier();
    return all;
}

// Adds a tile by its index, row by row. The order is the device's. What finds
// no room counts, and so the list is not used.
fn tiles_add(index: u32) {
    let place = atomicAdd(&tiles_list.count, 1u);
    if place < arrayLength(&tiles_list.tiles) {
        tiles_list.tiles[place] = index;
    }
}

// The tile of a workgroup of the indirect dispatch: its index in x, and 1 in y
// if there is one.
fn tiles_take(group: vec2u, tiles: u32) -> vec2u {
    let slot = tiles_slot(group);
    if tiles_list.whole != 0u {
        return vec2u(slot, select(0u, 1u, slot < tiles));
    }
    if slot >= atomicLoad(&tiles_list.count) || slot >= arrayLength(&tiles_list.tiles) {
        return vec2u(0u, 0u);
    }
    return vec2u(tiles_list.tiles[slot], 1u);
}
