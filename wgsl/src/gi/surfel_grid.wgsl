// Cells with lists of surfels: which ones a surfel's box touches, and which one
// a point looks up. Dense, or hashed; with levels, cells double in size as often
// as the distance from the origin does.

// The slot of what is in no cell.
const SURFEL_GRID_NOWHERE: u32 = 0xffffffffu;
// Cells that a surfel may touch along an axis.
const SURFEL_GRID_SPAN: u32 = 3u;
// Levels that a surfel may touch.
const SURFEL_GRID_DEEP: u32 = 2u;
// Highest level; it has no outer end.
const SURFEL_GRID_LEVELS: u32 = 16u;
// Coordinates end here, on either side.
const SURFEL_GRID_FAR: f32 = 4194304.0;
// One over the square of a surfel's squash.
const SURFEL_GRID_FLAT: f32 = 0.0625;
// What a coordinate loses by its size.
const SURFEL_GRID_LOST: f32 = 2.3841858e-7;

// Where the cells are.
struct SurfelGrid {
    // Lower corner of cell (0, 0, 0), and the middle of the levels.
    origin: vec3f,
    // One over the width of a cell of level 0.
    inverse_cell: f32,
    // Cells along each axis of a dense grid; 0 for a hashed one.
    size: vec3u,
    // How many lists there are.
    slots: u32,
    // One over the distance up to which cells have level 0; 0: no levels.
    inverse_reach: f32,
}

// The cells of a level that a surfel's box touches.
struct SurfelGridRange {
    // The first one.
    low: vec3u,
    // How many along each axis; 0: none.
    span: vec3u,
}

fn surfel_grid_level_of(far: f32) -> u32 {
    if far < 1.0 {
        return 0u;
    }
    // The exponent: 1 for [1, 2), 2 for [2, 4).
    return min((bitcast<u32>(far) >> 23u) - 126u, SURFEL_GRID_LEVELS);
}

// The level of the cell a point is in: 0 within the grid's reach, and one more
// for each doubling of the distance along the farthest axis.
fn surfel_grid_level(point: vec3f, grid: SurfelGrid) -> u32 {
    let x = abs(point.x - grid.origin.x);
    let y = abs(point.y - grid.origin.y);
    let z = abs(point.z - grid.origin.z);
    return surfel_grid_level_of(max(max(x, y), z) * grid.inverse_reach);
}

fn surfel_grid_axis(offset: f32, scale: f32) -> u32 {
    let cell = clamp(offset * scale, -SURFEL_GRID_FAR, SURFEL_GRID_FAR);
    return bitcast<u32>(i32(floor(cell)));
}

// The cell of a level that a point is in; below the origin coordinates wrap.
fn surfel_grid_coordinate(point: vec3f, level: u32, grid: SurfelGrid) -> vec3u {
    // A power of two, from its exponent: exact.
    let part = bitcast<f32>((127u - min(level, SURFEL_GRID_LEVELS)) << 23u);
    let scale = grid.inverse_cell * part;
    return vec3u(
        surfel_grid_axis(point.x - grid.origin.x, scale),
        surfel_grid_axis(point.y - grid.origin.y, scale),
        surfel_grid_axis(point.z - grid.origin.z, scale),
    );
}

// The list of a cell: its index in a dense grid (SURFEL_GRID_NOWHERE outside it
// and above level 0), a hash in a hashed one.
fn surfel_grid_slot(coordinate: vec3u, level: u32, grid: SurfelGrid) -> u32 {
    if grid.slots == 0u {
        return SURFEL_GRID_NOWHERE;
    }
    if grid.size.x == 0u && grid.size.y == 0u && grid.size.z == 0u {
        let cell = vec4u(coordinate.x, coordinate.y, coordinate.z, level);
        return pcg4d(cell).x % grid.slots;
    }
    let outside = coordinate.x >= grid.size.x
        || coordinate.y >= grid.size.y
        || coordinate.z >= grid.size.z;
    if outside || level > 0u {
        return SURFEL_GRID_NOWHERE;
    }
    let slot = (coordinate.z * grid.size.y + coordinate.y) * grid.size.x + coordinate.x;
    if slot >= grid.slots {
        return SURFEL_GRID_NOWHERE;
    }
    return slot;
}

// The list that a point looks up; SURFEL_GRID_NOWHERE outside a dense grid and
// for what is not finite.
fn surfel_grid_find(point: vec3f, grid: SurfelGrid) -> u32 {
    if magnitude_bits(point) > bitcast<u32>(SURFEL_LARGEST) {
        return SURFEL_GRID_NOWHERE;
    }
    let level = surfel_grid_level(point, grid);
    return surfel_grid_slot(surfel_grid_coordinate(point, level, grid), level, grid);
}

// Half the box around a surfel: that of a flat ellipsoid, a little larger so
// that rounding leaves nothing outside.
fn surfel_grid_extent(surfel: Surfel, grid: SurfelGrid) -> vec3f {
    let x = surfel.normal.x * surfel.normal.x;
    let y = surfel.normal.y * surfel.normal.y;
    let z = surfel.normal.z * surfel.normal.z;
    let radius = surfel.radius * 1.03125;
    return vec3f(
        radius * sqrt((y + z) + x * SURFEL_GRID_FLAT)
            + (abs(surfel.position.x) + abs(grid.origin.x)) * SURFEL_GRID_LOST,
        radius * sqrt((x + z) + y * SURFEL_GRID_FLAT)
            + (abs(surfel.position.y) + abs(grid.origin.y)) * SURFEL_GRID_LOST,
        radius * sqrt((x + y) + z * SURFEL_GRID_FLAT)
            + (abs(surfel.position.z) + abs(grid.origin.z)) * SURFEL_GRID_LOST,
    );
}

// The levels that a surfel's box touches: the first one and how many; 0 if more
// than SURFEL_GRID_DEEP, or if the surfel is not sound.
fn surfel_grid_levels(surfel: Surfel, grid: SurfelGrid) -> vec2u {
    if surfel_sound(surfel) == 0u {
        return vec2u(0u, 0u);
    }
    let h = surfel_grid_extent(surfel, grid);
    let x = abs(surfel.position.x - grid.origin.x);
    let y = abs(surfel.position.y - grid.origin.y);
    let z = abs(surfel.position.z - grid.origin.z);
    let near = max(max(max(x - h.x, y - h.y), z - h.z), 0.0);
    let far = max(max(x + h.x, y + h.y), z + h.z);
    let first = surfel_grid_level_of(near * grid.inverse_reach);
    let last = surfel_grid_level_of(far * grid.inverse_reach);
    if last - first >= SURFEL_GRID_DEEP {
        return vec2u(0u, 0u);
    }
    return vec2u(first, last - first + 1u);
}

// The cells of a level that a sound surfel's box touches; none if they are more
// than SURFEL_GRID_SPAN along an axis.
fn surfel_grid_range(surfel: Surfel, level: u32, grid: SurfelGrid) -> SurfelGridRange {
    let h = surfel_grid_extent(surfel, grid);
    let p = surfel.position;
    let low = vec3f(p.x - h.x, p.y - h.y, p.z - h.z);
    let high = vec3f(p.x + h.x, p.y + h.y, p.z + h.z);
    let first = surfel_grid_coordinate(low, level, grid);
    let last = surfel_grid_coordinate(high, level, grid);
    let span = vec3u(
        last.x - first.x + 1u,
        last.y - first.y + 1u,
        last.z - first.z + 1u,
    );
    if max(max(span.x, span.y), span.z) > SURFEL_GRID_SPAN {
        return SurfelGridRange(first, vec3u(0u, 0u, 0u));
    }
    return SurfelGridRange(first, span);
}

// How many cells a range has: at most 27.
fn surfel_grid_count(range: SurfelGridRange) -> u32 {
    return range.span.x * range.span.y * range.span.z;
}

// A range's cell of number index, below its count; x first.
fn surfel_grid_cell(range: SurfelGridRange, index: u32) -> vec3u {
    let width = max(range.span.x, 1u);
    let height = max(range.span.y, 1u);
    return vec3u(
        range.low.x + index % width,
        range.low.y + (index / width) % height,
        range.low.z + index / (width * height),
    );
}

// How many entries of a list are kept: all, or none if they do not all lie
// within the capacity.
fn surfel_grid_kept(first: u32, count: u32, capacity: u32) -> u32 {
    if first > capacity || count > capacity - first {
        return 0u;
    }
    return count;
}
