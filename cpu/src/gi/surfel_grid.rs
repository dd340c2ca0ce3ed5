//! Cells with lists of surfels: which ones a surfel's box touches, and which
//! one a point looks up.
//!
//! A grid is dense (its slots are its cells) or hashed (any number of cells
//! share the slots; a surfel from elsewhere in a list weighs nothing). With
//! levels its cells double in size as often as the distance from its origin
//! does. The build is count, sum, scatter, sort: `pass::surfel_grid` on the CPU,
//! `surfel_grid.pass.wgsl` on the GPU, in the same order.
//!
//! Source: Barré-Brisebois et al. (Ray Tracing Gems, chapter 25) for lists in
//! cells; Teschner et al., *Optimized Spatial Hashing for Collision Detection of
//! Deformable Objects* (2003) for hashed cells; the levels are ours.

use glam::{UVec2, UVec3, UVec4, Vec3};

use super::surfel::{SURFEL_LARGEST, Surfel, surfel_sound};
use crate::math::sanitize::magnitude_bits;
use crate::random::pcg::pcg4d;

/// The slot of what is in no cell.
pub const SURFEL_GRID_NOWHERE: u32 = 0xffff_ffff;

/// Cells that a surfel may touch along an axis; one that touches more is in
/// none of that level.
pub const SURFEL_GRID_SPAN: u32 = 3;

/// Levels that a surfel may touch; one that touches more is in none.
pub const SURFEL_GRID_DEEP: u32 = 2;

/// Highest level; it has no outer end.
pub const SURFEL_GRID_LEVELS: u32 = 16;

/// Coordinates end here, on either side; beyond, cells have no end.
pub const SURFEL_GRID_FAR: f32 = 4_194_304.0;

/// Where the cells are.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel_grid::{
///     SURFEL_GRID_NOWHERE, SurfelGrid, surfel_grid_find,
/// };
///
/// // 8 x 8 x 8 cells of half a metre about the world's origin.
/// let grid = SurfelGrid {
///     origin: Vec3::splat(-2.0),
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// assert_eq!(surfel_grid_find(Vec3::splat(-2.0), grid), 0);
/// assert_eq!(surfel_grid_find(Vec3::splat(2.5), grid), SURFEL_GRID_NOWHERE);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SurfelGrid {
    /// Lower corner of cell (0, 0, 0), and the middle of the levels.
    pub origin: Vec3,
    /// One over the width of a cell of level 0.
    pub inverse_cell: f32,
    /// Cells along each axis of a dense grid; 0 for a hashed one.
    pub size: UVec3,
    /// How many lists there are: for a dense grid at least its cells.
    pub slots: u32,
    /// One over the distance from the origin, along the farthest axis, up to
    /// which cells have level 0; 0 for a grid without levels.
    pub inverse_reach: f32,
}

/// The cells of a level that a surfel's box touches.
///
/// ```
/// use glam::UVec3;
/// use raytwin_cpu::gi::surfel_grid::{SurfelGridRange, surfel_grid_count};
///
/// let range =
///     SurfelGridRange { low: UVec3::new(3, 4, 5), span: UVec3::new(2, 1, 1) };
/// assert_eq!(surfel_grid_count(range), 2);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct SurfelGridRange {
    /// The first one.
    pub low: UVec3,
    /// How many along each axis, at most [`SURFEL_GRID_SPAN`]; 0: none.
    pub span: UVec3,
}

/// The level of what is so far from the origin, in units of level 0's reach.
#[inline(always)]
fn surfel_grid_level_of(far: f32) -> u32 {
    if far < 1.0 {
        return 0;
    }
    // The exponent: 1 for [1, 2), 2 for [2, 4).
    ((far.to_bits() >> 23) - 126).min(SURFEL_GRID_LEVELS)
}

/// The level of the cell a point is in: 0 within the grid's reach, and one more
/// for each doubling of the distance, to [`SURFEL_GRID_LEVELS`].
///
/// The distance is that along the farthest axis. Points up to 1e15.
///
/// Error analysis: a difference and a product, both rounded correctly on every
/// machine, so the level never falls as the distance grows.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_level};
///
/// // Hashed, with levels: level 0 within 10 metres, 1 to 20, 2 to 40.
/// let grid = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::ZERO,
///     slots: 4096,
///     inverse_reach: 0.1,
/// };
/// let levels = [5.0, 15.0, 35.0]
///     .map(|x| surfel_grid_level(Vec3::new(x, 0.0, 0.0), grid));
/// assert_eq!(levels, [0, 1, 2]);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_level(point: Vec3, grid: SurfelGrid) -> u32 {
    let x = (point.x - grid.origin.x).abs();
    let y = (point.y - grid.origin.y).abs();
    let z = (point.z - grid.origin.z).abs();
    surfel_grid_level_of(x.max(y).max(z) * grid.inverse_reach)
}

#[inline(always)]
fn surfel_grid_axis(offset: f32, scale: f32) -> u32 {
    let cell = (offset * scale).clamp(-SURFEL_GRID_FAR, SURFEL_GRID_FAR);
    cell.floor() as i32 as u32
}

/// The cell of a level that a point is in; below the origin coordinates wrap
/// (2^32 - 1 for -1).
///
/// `level` at most [`SURFEL_GRID_LEVELS`]. Cells double with each level.
///
/// Error analysis: as [`surfel_grid_level`]: coordinates never fall as a point
/// moves up, so a point in a box has a cell between those of its corners.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_coordinate};
///
/// let grid = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::ZERO,
///     slots: 4096,
///     inverse_reach: 0.1,
/// };
/// let point = Vec3::new(3.2, 0.0, 0.0);
/// // Cells of half a metre; a level higher of a metre.
/// assert_eq!(surfel_grid_coordinate(point, 0, grid).x, 6);
/// assert_eq!(surfel_grid_coordinate(point, 1, grid).x, 3);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_coordinate(point: Vec3, level: u32, grid: SurfelGrid) -> UVec3 {
    // A power of two: exact.
    let part = 1.0 / (1u32 << level.min(SURFEL_GRID_LEVELS)) as f32;
    let scale = grid.inverse_cell * part;
    UVec3::new(
        surfel_grid_axis(point.x - grid.origin.x, scale),
        surfel_grid_axis(point.y - grid.origin.y, scale),
        surfel_grid_axis(point.z - grid.origin.z, scale),
    )
}

/// The list of a cell: its index in a dense grid ([`SURFEL_GRID_NOWHERE`]
/// outside it and above level 0), a hash in a hashed one.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_slot};
///
/// let dense = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// assert_eq!(
///     surfel_grid_slot(UVec3::new(1, 2, 3), 0, dense),
///     1 + 8 * (2 + 8 * 3)
/// );
/// let hashed = SurfelGrid { size: UVec3::ZERO, ..dense };
/// assert!(surfel_grid_slot(UVec3::new(1000, 2, 3), 0, hashed) < 512);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_slot(coordinate: UVec3, level: u32, grid: SurfelGrid) -> u32 {
    if grid.slots == 0 {
        return SURFEL_GRID_NOWHERE;
    }
    if grid.size == UVec3::ZERO {
        let cell = UVec4::new(coordinate.x, coordinate.y, coordinate.z, level);
        return pcg4d(cell).x % grid.slots;
    }
    let outside =
        coordinate.x >= grid.size.x || coordinate.y >= grid.size.y || coordinate.z >= grid.size.z;
    if outside || level > 0 {
        return SURFEL_GRID_NOWHERE;
    }
    let row = coordinate
        .z
        .wrapping_mul(grid.size.y)
        .wrapping_add(coordinate.y);
    let slot = row.wrapping_mul(grid.size.x).wrapping_add(coordinate.x);
    if slot >= grid.slots {
        return SURFEL_GRID_NOWHERE;
    }
    slot
}

/// The list that a point looks up; [`SURFEL_GRID_NOWHERE`] outside a dense grid
/// and for what is not finite.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel_grid::{
///     SURFEL_GRID_NOWHERE, SurfelGrid, surfel_grid_find,
/// };
///
/// let grid = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// assert_eq!(surfel_grid_find(Vec3::new(0.6, 0.1, 0.1), grid), 1);
/// assert_eq!(
///     surfel_grid_find(Vec3::splat(f32::NAN), grid),
///     SURFEL_GRID_NOWHERE
/// );
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_find(point: Vec3, grid: SurfelGrid) -> u32 {
    if magnitude_bits(point) > SURFEL_LARGEST.to_bits() {
        return SURFEL_GRID_NOWHERE;
    }
    let level = surfel_grid_level(point, grid);
    surfel_grid_slot(surfel_grid_coordinate(point, level, grid), level, grid)
}

/// Half the box around a surfel, along each axis: that of a flat ellipsoid, a
/// little larger so that rounding leaves nothing outside.
///
/// Error analysis: a sum of squares, its root and a product, a few ULP, in a
/// margin of 1/32. What a coordinate loses by its size is added.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_extent};
///
/// let grid = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// let surfel =
///     Surfel { position: Vec3::ONE, radius: 0.2, normal: Vec3::Y, mesh: 0 };
/// // As far as the radius along the surface, a quarter of it along the normal.
/// let half = surfel_grid_extent(surfel, grid);
/// assert!(half.x > 0.2 && half.x < 0.21 && half.y > 0.05 && half.y < 0.06);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_extent(surfel: Surfel, grid: SurfelGrid) -> Vec3 {
    // One over the square of the squash.
    const FLAT: f32 = 0.0625;
    const LOST: f32 = 2.384_185_8e-7;
    let x = surfel.normal.x * surfel.normal.x;
    let y = surfel.normal.y * surfel.normal.y;
    let z = surfel.normal.z * surfel.normal.z;
    let radius = surfel.radius * 1.03125;
    Vec3::new(
        radius * ((y + z) + x * FLAT).sqrt()
            + (surfel.position.x.abs() + grid.origin.x.abs()) * LOST,
        radius * ((x + z) + y * FLAT).sqrt()
            + (surfel.position.y.abs() + grid.origin.y.abs()) * LOST,
        radius * ((x + y) + z * FLAT).sqrt()
            + (surfel.position.z.abs() + grid.origin.z.abs()) * LOST,
    )
}

/// The levels that a surfel's box touches: the first one and how many, at most
/// [`SURFEL_GRID_DEEP`]; 0 if more, or if the surfel is not sound.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_levels};
///
/// let grid = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::ZERO,
///     slots: 4096,
///     inverse_reach: 0.1,
/// };
/// let surfel = Surfel {
///     position: Vec3::new(10.0, 0.0, 0.0),
///     radius: 0.2,
///     normal: Vec3::Y,
///     mesh: 0,
/// };
/// // On the border of two levels: from level 0 on, two of them.
/// assert_eq!(surfel_grid_levels(surfel, grid).to_array(), [0, 2]);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_levels(surfel: Surfel, grid: SurfelGrid) -> UVec2 {
    if surfel_sound(surfel) == 0 {
        return UVec2::ZERO;
    }
    let h = surfel_grid_extent(surfel, grid);
    let x = (surfel.position.x - grid.origin.x).abs();
    let y = (surfel.position.y - grid.origin.y).abs();
    let z = (surfel.position.z - grid.origin.z).abs();
    let near = (x - h.x).max(y - h.y).max(z - h.z).max(0.0);
    let far = (x + h.x).max(y + h.y).max(z + h.z);
    let first = surfel_grid_level_of(near * grid.inverse_reach);
    let last = surfel_grid_level_of(far * grid.inverse_reach);
    if last - first >= SURFEL_GRID_DEEP {
        return UVec2::ZERO;
    }
    UVec2::new(first, last - first + 1)
}

/// The cells of a level that a sound surfel's box touches; none if they are
/// more than [`SURFEL_GRID_SPAN`] along an axis.
///
/// ```
/// use glam::{UVec3, Vec3};
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_grid::{SurfelGrid, surfel_grid_range};
///
/// let grid = SurfelGrid {
///     origin: Vec3::ZERO,
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// let surfel = Surfel {
///     position: Vec3::new(1.0, 0.25, 0.25),
///     radius: 0.2,
///     normal: Vec3::Y,
///     mesh: 0,
/// };
/// // It reaches over the border between cells 1 and 2.
/// let range = surfel_grid_range(surfel, 0, grid);
/// assert_eq!(
///     (range.low, range.span),
///     (UVec3::new(1, 0, 0), UVec3::new(2, 1, 1))
/// );
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_range(surfel: Surfel, level: u32, grid: SurfelGrid) -> SurfelGridRange {
    let h = surfel_grid_extent(surfel, grid);
    let p = surfel.position;
    let low = Vec3::new(p.x - h.x, p.y - h.y, p.z - h.z);
    let high = Vec3::new(p.x + h.x, p.y + h.y, p.z + h.z);
    let first = surfel_grid_coordinate(low, level, grid);
    let last = surfel_grid_coordinate(high, level, grid);
    let span = UVec3::new(
        last.x.wrapping_sub(first.x).wrapping_add(1),
        last.y.wrapping_sub(first.y).wrapping_add(1),
        last.z.wrapping_sub(first.z).wrapping_add(1),
    );
    if span.x.max(span.y).max(span.z) > SURFEL_GRID_SPAN {
        return SurfelGridRange {
            low: first,
            span: UVec3::ZERO,
        };
    }
    SurfelGridRange { low: first, span }
}

/// How many cells a range has: at most 27.
///
/// ```
/// use glam::UVec3;
/// use raytwin_cpu::gi::surfel_grid::{SurfelGridRange, surfel_grid_count};
///
/// let range = SurfelGridRange { low: UVec3::ZERO, span: UVec3::new(3, 2, 1) };
/// assert_eq!(surfel_grid_count(range), 6);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_count(range: SurfelGridRange) -> u32 {
    range.span.x * range.span.y * range.span.z
}

/// A range's cell of number `index`, below its count; `x` first.
///
/// ```
/// use glam::UVec3;
/// use raytwin_cpu::gi::surfel_grid::{
///     SurfelGridRange, surfel_grid_cell, surfel_grid_count,
/// };
///
/// let range =
///     SurfelGridRange { low: UVec3::new(3, 4, 5), span: UVec3::new(2, 2, 1) };
/// let cells: Vec<_> = (0..surfel_grid_count(range))
///     .map(|i| surfel_grid_cell(range, i))
///     .collect();
/// assert_eq!(cells[0], range.low);
/// assert_eq!(cells[3], UVec3::new(4, 5, 5));
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_cell(range: SurfelGridRange, index: u32) -> UVec3 {
    let width = range.span.x.max(1);
    let height = range.span.y.max(1);
    UVec3::new(
        range.low.x.wrapping_add(index % width),
        range.low.y.wrapping_add((index / width) % height),
        range.low.z.wrapping_add(index / (width * height)),
    )
}

/// How many entries of a list are kept: all, or none if they do not all lie
/// within the `capacity`. `first` is where the list begins.
///
/// ```
/// use raytwin_cpu::gi::surfel_grid::surfel_grid_kept;
///
/// assert_eq!(surfel_grid_kept(90, 10, 100), 10);
/// // One entry has no room: the whole list is left out.
/// assert_eq!(surfel_grid_kept(91, 10, 100), 0);
/// ```
#[inline]
#[must_use]
pub fn surfel_grid_kept(first: u32, count: u32, capacity: u32) -> u32 {
    if first > capacity || count > capacity - first {
        return 0;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gi::surfel::surfel_weight;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    fn random(i: u32) -> f32 {
        pcg_unit(pcg_hash(i))
    }

    fn hashed(levels: bool) -> SurfelGrid {
        SurfelGrid {
            origin: Vec3::new(0.3, -0.7, 0.1),
            inverse_cell: 2.0,
            size: UVec3::ZERO,
            slots: 4093,
            inverse_reach: if levels { 0.25 } else { 0.0 },
        }
    }

    fn surfel(i: u32, scale: f32) -> Surfel {
        let at = |k: u32| random(i * 8 + k) * 2.0 - 1.0;
        Surfel {
            position: Vec3::new(at(0), at(1), at(2)) * scale,
            radius: 0.05 + 0.2 * random(i * 8 + 3),
            normal: Vec3::new(at(4), at(5), at(6) + 1.5).normalize(),
            mesh: 0,
        }
    }

    fn slots_of(s: Surfel, grid: SurfelGrid) -> Vec<u32> {
        let levels = surfel_grid_levels(s, grid);
        let mut found = Vec::new();
        for level in levels.x..levels.x + levels.y {
            let range = surfel_grid_range(s, level, grid);
            for k in 0..surfel_grid_count(range) {
                found.push(surfel_grid_slot(surfel_grid_cell(range, k), level, grid));
            }
        }
        found
    }

    #[test]
    fn whatever_covers_a_point_is_in_the_list_it_finds() {
        for grid in [hashed(false), hashed(true)] {
            let mut covered = 0;
            for i in 0..20_000 {
                let s = surfel(i, if i % 2 == 0 { 3.0 } else { 9.0 });
                let slots = slots_of(s, grid);
                assert!(!slots.is_empty() && slots.len() <= 54);
                for k in 0..20 {
                    let j = (i * 20 + k) * 3 + 1_000_000;
                    let d = Vec3::new(random(j), random(j + 1), random(j + 2)) * 2.0 - 1.0;
                    let p = s.position + d * s.radius;
                    if surfel_weight(s, p, s.normal) > 0.0 {
                        covered += 1;
                        assert!(slots.contains(&surfel_grid_find(p, grid)));
                    }
                }
            }
            assert!(covered > 10_000);
        }
    }

    #[test]
    fn levels_double_and_never_fall() {
        let mut grid = hashed(true);
        grid.origin = Vec3::ZERO;
        let level = |x: f32| surfel_grid_level(Vec3::new(0.0, -x, 0.0), grid);
        assert_eq!(
            [0.0, 3.99, 4.0, 7.99, 8.0, 16.0, 1e12].map(level),
            [0, 0, 1, 1, 2, 3, 16]
        );
        assert_eq!(surfel_grid_level(Vec3::splat(1e9), hashed(false)), 0);
        let p = Vec3::new(5.3, -5.3, 0.6);
        assert_eq!(
            surfel_grid_coordinate(p, 0, grid)
                .to_array()
                .map(|c| c as i32),
            [10, -11, 1]
        );
        assert_eq!(
            surfel_grid_coordinate(p, 1, grid)
                .to_array()
                .map(|c| c as i32),
            [5, -6, 0]
        );
    }

    #[test]
    fn what_is_broken_or_too_large_is_nowhere() {
        let s = surfel(1, 1.0);
        for grid in [hashed(false), hashed(true)] {
            for bad in [f32::NAN, f32::INFINITY, 1e30] {
                assert_eq!(
                    surfel_grid_find(Vec3::new(0.0, bad, 0.0), grid),
                    SURFEL_GRID_NOWHERE
                );
                let mut t = s;
                t.position.x = bad;
                assert!(slots_of(t, grid).is_empty());
                let t = Surfel { radius: bad, ..s };
                assert!(slots_of(t, grid).is_empty());
            }
            assert!(slots_of(Surfel { radius: 50.0, ..s }, grid).is_empty());
        }
        let none = SurfelGrid {
            slots: 0,
            ..hashed(false)
        };
        assert_eq!(surfel_grid_find(Vec3::ZERO, none), SURFEL_GRID_NOWHERE);
    }

    #[test]
    fn a_dense_grid_has_each_cell_once() {
        let grid = SurfelGrid {
            size: UVec3::new(5, 4, 3),
            slots: 60,
            ..hashed(false)
        };
        let mut seen = [false; 60];
        for z in 0..3 {
            for y in 0..4 {
                for x in 0..5 {
                    let slot = surfel_grid_slot(UVec3::new(x, y, z), 0, grid) as usize;
                    assert!(!std::mem::replace(&mut seen[slot], true));
                }
            }
        }
        for outside in [
            UVec3::new(5, 0, 0),
            UVec3::new(0, u32::MAX, 0),
            UVec3::new(0, 0, 3),
        ] {
            assert_eq!(surfel_grid_slot(outside, 0, grid), SURFEL_GRID_NOWHERE);
        }
        let short = SurfelGrid { slots: 7, ..grid };
        assert_eq!(
            surfel_grid_slot(UVec3::new(2, 1, 0), 0, short),
            SURFEL_GRID_NOWHERE
        );
    }

    #[test]
    fn a_list_is_kept_whole_or_not_at_all() {
        assert_eq!(surfel_grid_kept(0, 10, 10), 10);
        assert_eq!(surfel_grid_kept(1, 10, 10), 0);
        assert_eq!(surfel_grid_kept(u32::MAX, u32::MAX, 10), 0);
        assert_eq!(surfel_grid_kept(10, 0, 10), 0);
    }
}
