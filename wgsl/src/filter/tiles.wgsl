// Which tiles of 8 x 8 pixels a filter has to touch, so that leaving out the
// others changes no bit: those around which, as far as the whole filter
// reaches, all pixels are exactly 1, or all exactly 0, and known without doubt.
//
// The program defines
//   fn tiles_read_pixel(at: vec2u) -> u32
//   fn tiles_read(tile: vec2u) -> u32
//   fn tiles_read_row(tile: vec2u) -> u32

// Pixels on a side of a tile.
const TILES_SIZE: u32 = 8u;

// Nothing here is filtered, nor read by what is.
const TILES_NONE: u32 = 0u;
// Exactly 1; exactly 0.
const TILES_LIT: u32 = 1u;
const TILES_DARK: u32 = 2u;
// Both, or neither: to be filtered.
const TILES_MIXED: u32 = 3u;

// A pixel of this kind is in the tile: a mirror's, a glossy one, a rough one
// without a ray.
const TILES_REFLECTION_MIRROR: u32 = 1u;
const TILES_REFLECTION_SAMPLED: u32 = 2u;
const TILES_REFLECTION_DIFFUSE: u32 = 4u;

// Workgroups in a row of an indirect dispatch.
const TILES_ROW: u32 = 256u;

// Bits of 2^60 and of 2^121, from which on nothing is data, and of 1.
const TILES_VALUE_BITS: u32 = 0x5d800000u;
const TILES_VARIANCE_BITS: u32 = 0x7c000000u;
const TILES_ONE_BITS: u32 = 0x3f800000u;

// What to dispatch over a list of tiles.
struct TilesDispatch {
    // Workgroups in each dimension.
    groups: vec3u,
    // Not 0 if the list does not hold all: every tile is filtered, in order.
    whole: u32,
    // Tiles to filter.
    count: u32,
}

// The flags of a pixel of one channel. surface is 0 where the filter has no
// surface, and so gives the pixel back as it is. Compares bit patterns.
fn tiles_scalar_flags(value: f32, variance: f32, surface: u32) -> u32 {
    let v = bitcast<u32>(value);
    let spread = bitcast<u32>(variance);
    if surface == 0u {
        if (v & 0x7fffffffu) < TILES_VALUE_BITS && spread < TILES_VARIANCE_BITS {
            return TILES_NONE;
        }
        return TILES_MIXED;
    }
    if spread == 0u {
        if v == TILES_ONE_BITS {
            return TILES_LIT;
        }
        if v == 0u {
            return TILES_DARK;
        }
    }
    return TILES_MIXED;
}

// The flags of a pixel of three channels, lit if all are 1, dark if all are 0.
fn tiles_color_flags(color: vec3f, variance: f32, surface: u32) -> u32 {
    let red = tiles_scalar_flags(color.x, variance, surface);
    let green = tiles_scalar_flags(color.y, variance, surface);
    let blue = tiles_scalar_flags(color.z, variance, surface);
    return red | green | blue;
}

// The flag of a pixel's kind of reflection, as reflection_kind gives it.
fn tiles_reflection_flags(kind: u32) -> u32 {
    return 1u << min(kind, 2u);
}

// A tile's kind of reflection, named as reflection_kind does: sampled (1) if
// any pixel is, else a mirror (0) if any is, else diffuse (2).
fn tiles_reflection_kind(flags: u32) -> u32 {
    if (flags & TILES_REFLECTION_SAMPLED) != 0u {
        return 1u;
    }
    if (flags & TILES_REFLECTION_MIRROR) != 0u {
        return 0u;
    }
    return 2u;
}

// How many tiles lie across and down an image.
fn tiles_count(size: vec2u) -> vec2u {
    return vec2u(tiles_reach(size.x), tiles_reach(size.y));
}

// The place of a tile by its index, row by row.
fn tiles_at(index: u32, across: u32) -> vec2u {
    let columns = max(across, 1u);
    return vec2u(index % columns, index / columns);
}

// How many tiles to either side hold whatever lies within a reach in pixels.
fn tiles_reach(pixels: u32) -> u32 {
    return (pixels >> 3u) + select(0u, 1u, (pixels & 7u) != 0u);
}

// How far filter/svgf's passes reach together, in pixels. Add 3 where the
// spatial variance runs before.
fn tiles_atrous_reach(radius: u32, passes: u32) -> u32 {
    return min(radius, 2u) * ((1u << min(passes, 16u)) - 1u);
}

// A tile's flags: those of its pixels together, of those inside size.
fn tiles_flags(tile: vec2u, size: vec2u) -> u32 {
    let tiles = tiles_count(size);
    if tile.x >= tiles.x || tile.y >= tiles.y {
        return TILES_NONE;
    }
    var flags = 0u;
    for (var i = 0u; i < TILES_SIZE * TILES_SIZE; i++) {
        // The first pixel of a tile in the image is in the image.
        let x = i & 7u;
        let y = i >> 3u;
        if x < size.x - (tile.x << 3u) && y < size.y - (tile.y << 3u) {
            flags |= tiles_read_pixel(vec2u((tile.x << 3u) + x, (tile.y << 3u) + y));
        }
    }
    return flags;
}

// First of two passes: the flags of the tiles in a row, reach tiles to either
// side. tiles is tiles_count.
fn tiles_horizontal(tile: vec2u, tiles: vec2u, reach: u32) -> u32 {
    if tile.x >= tiles.x || tile.y >= tiles.y {
        return TILES_NONE;
    }
    let last = tile.x + min(tiles.x - 1u - tile.x, reach);
    var flags = 0u;
    for (var x = tile.x - min(tile.x, reach); x <= last; x++) {
        flags |= tiles_read(vec2u(x, tile.y));
    }
    return flags;
}

// Second of two passes: the flags of the rows, reach tiles up and down.
fn tiles_vertical(tile: vec2u, tiles: vec2u, reach: u32) -> u32 {
    if tile.x >= tiles.x || tile.y >= tiles.y {
        return TILES_NONE;
    }
    let last = tile.y + min(tiles.y - 1u - tile.y, reach);
    var flags = 0u;
    for (var y = tile.y - min(tile.y, reach); y <= last; y++) {
        flags |= tiles_read_row(vec2u(tile.x, y));
    }
    return flags;
}

// 1 if a tile is to be filtered: if it holds anything that the filter may
// change, and not all around is alike.
fn tiles_needed(own: u32, around: u32) -> u32 {
    if own == TILES_NONE {
        return 0u;
    }
    return select(0u, 1u, around >= TILES_MIXED);
}

// What to dispatch, a workgroup a tile, for count needed tiles of which a list
// of capacity holds the first. A list that is too short is not used.
fn tiles_dispatch(count: u32, capacity: u32, tiles: u32) -> TilesDispatch {
    let whole = select(0u, 1u, count > capacity || count > tiles);
    let listed = select(count, tiles, whole != 0u);
    let rows = (listed / TILES_ROW) + select(0u, 1u, (listed % TILES_ROW) != 0u);
    return TilesDispatch(vec3u(min(listed, TILES_ROW), rows, 1u), whole, listed);
}

// The place in the list that a workgroup works on.
fn tiles_slot(group: vec2u) -> u32 {
    return group.y * TILES_ROW + group.x;
}
