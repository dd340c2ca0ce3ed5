//! Which tiles of 8 × 8 pixels a filter has to touch, so that leaving out the
//! others changes no bit.
//!
//! A pixel is flagged lit or dark if its value is exactly 1 or 0 and known
//! without doubt (variance 0), both if it is anything else, and nothing if the
//! filter gives it back as it is and no other pixel reads it (no surface). A
//! tile's flags are those of its pixels together. A filter whose result is a
//! mean between its smallest and largest input cannot change a tile around
//! which, as far as the filter reaches, only one of the two flags occurs: its
//! inputs are all the same, as is what its neighbours become on the way, pass
//! by pass.
//!
//! The reach is the whole filter's: that of all passes together. It is counted
//! in tiles and looked up in two passes, rows and columns, as a bit-wise or.
//!
//! Reflections have three kinds of pixel by roughness
//! ([`reflection_kind`](crate::brdf::reflection::reflection_kind)); which tiles
//! need rays is [`tiles_reflection_kind`], and only the sampled pixels are a
//! surface to the filter.
//!
//! Source: AMD, *FidelityFX Denoiser* 1.x (shadows) for the classes of tiles and
//! the indirect dispatch; what makes leaving out exact is ours.

use glam::{UVec2, UVec3, Vec3};

/// Pixels on a side of a tile.
pub const TILES_SIZE: u32 = 8;

/// Nothing here is filtered, nor read by what is.
pub const TILES_NONE: u32 = 0;
/// Exactly 1.
pub const TILES_LIT: u32 = 1;
/// Exactly 0.
pub const TILES_DARK: u32 = 2;
/// Both, or neither: to be filtered.
pub const TILES_MIXED: u32 = 3;

/// A pixel of this kind is in the tile: a mirror's.
pub const TILES_REFLECTION_MIRROR: u32 = 1;
/// A glossy one.
pub const TILES_REFLECTION_SAMPLED: u32 = 2;
/// A rough one, which takes no ray.
pub const TILES_REFLECTION_DIFFUSE: u32 = 4;

/// Workgroups in a row of an indirect dispatch: one dimension alone would end
/// at 65535.
pub const TILES_ROW: u32 = 256;

/// Bits of 2^60 and of 2^121: from here on a value and a variance are no data,
/// as for `filter/svgf`.
const TILES_VALUE_BITS: u32 = 0x5d80_0000;
const TILES_VARIANCE_BITS: u32 = 0x7c00_0000;
/// Bits of 1.
const TILES_ONE_BITS: u32 = 0x3f80_0000;

/// What to dispatch over a list of tiles.
///
/// ```
/// use raytwin_cpu::filter::tiles::tiles_dispatch;
///
/// // Nothing to do is a dispatch too: of no workgroups.
/// let dispatch = tiles_dispatch(0, 1000, 8160);
/// assert_eq!((dispatch.groups.y, dispatch.whole, dispatch.count), (0, 0, 0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct TilesDispatch {
    /// Workgroups in each dimension.
    pub groups: UVec3,
    /// Not 0 if the list does not hold all that are needed: every tile is to be
    /// filtered, in order.
    pub whole: u32,
    /// Tiles to filter.
    pub count: u32,
}

/// The flags of a pixel of one channel: shadow, ambient occlusion.
///
/// `surface` is 0 where the filter has no surface, and so gives the pixel back
/// as it is. A filter without variances passes 0. Compares bit patterns: -0 is
/// not dark, and what is no data (NaN, infinite, 2^60) is to be filtered. Exact.
///
/// ```
/// use raytwin_cpu::filter::tiles::{
///     TILES_DARK, TILES_LIT, TILES_MIXED, TILES_NONE, tiles_scalar_flags,
/// };
///
/// assert_eq!(tiles_scalar_flags(1.0, 0.0, 1), TILES_LIT);
/// assert_eq!(tiles_scalar_flags(0.0, 0.0, 1), TILES_DARK);
/// // In the half shadow, in doubt, and without a surface.
/// assert_eq!(tiles_scalar_flags(0.5, 0.0, 1), TILES_MIXED);
/// assert_eq!(tiles_scalar_flags(1.0, 0.1, 1), TILES_MIXED);
/// assert_eq!(tiles_scalar_flags(0.5, 0.1, 0), TILES_NONE);
/// ```
#[inline]
#[must_use]
pub fn tiles_scalar_flags(value: f32, variance: f32, surface: u32) -> u32 {
    let v = value.to_bits();
    let spread = variance.to_bits();
    if surface == 0 {
        if (v & 0x7fff_ffff) < TILES_VALUE_BITS && spread < TILES_VARIANCE_BITS {
            return TILES_NONE;
        }
        return TILES_MIXED;
    }
    if spread == 0 {
        if v == TILES_ONE_BITS {
            return TILES_LIT;
        }
        if v == 0 {
            return TILES_DARK;
        }
    }
    TILES_MIXED
}

/// The flags of a pixel of three channels, lit if all are 1 and dark if all are
/// 0; else as [`tiles_scalar_flags`]. Exact.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::tiles::{
///     TILES_DARK, TILES_MIXED, tiles_color_flags,
/// };
///
/// assert_eq!(tiles_color_flags(Vec3::ZERO, 0.0, 1), TILES_DARK);
/// assert_eq!(tiles_color_flags(Vec3::X, 0.0, 1), TILES_MIXED);
/// ```
#[inline]
#[must_use]
pub fn tiles_color_flags(color: Vec3, variance: f32, surface: u32) -> u32 {
    let red = tiles_scalar_flags(color.x, variance, surface);
    let green = tiles_scalar_flags(color.y, variance, surface);
    let blue = tiles_scalar_flags(color.z, variance, surface);
    red | green | blue
}

/// The flag of a pixel's kind of reflection: `kind` is what `reflection_kind`
/// gives for its roughness. Exact.
///
/// ```
/// use raytwin_cpu::brdf::reflection::reflection_kind;
/// use raytwin_cpu::filter::tiles::{
///     TILES_REFLECTION_SAMPLED, tiles_reflection_flags,
/// };
///
/// let kind = reflection_kind(0.3, 0.05, 0.7);
/// assert_eq!(tiles_reflection_flags(kind), TILES_REFLECTION_SAMPLED);
/// ```
#[inline]
#[must_use]
pub fn tiles_reflection_flags(kind: u32) -> u32 {
    1 << kind.min(2)
}

/// A tile's kind of reflection from its pixels' flags together, named as
/// `reflection_kind` does: sampled if any pixel is, and needs denoising; else a
/// mirror if any is, and needs rays alone; else diffuse, and needs neither.
/// Exact.
///
/// ```
/// use raytwin_cpu::brdf::reflection::{REFLECTION_DIFFUSE, REFLECTION_MIRROR};
/// use raytwin_cpu::filter::tiles::{
///     TILES_REFLECTION_DIFFUSE, TILES_REFLECTION_MIRROR, tiles_reflection_kind,
/// };
///
/// // A mirror among rough pixels: the tile needs rays, but no denoising.
/// let flags = TILES_REFLECTION_MIRROR | TILES_REFLECTION_DIFFUSE;
/// assert_eq!(tiles_reflection_kind(flags), REFLECTION_MIRROR);
/// assert_eq!(
///     tiles_reflection_kind(TILES_REFLECTION_DIFFUSE),
///     REFLECTION_DIFFUSE
/// );
/// ```
#[inline]
#[must_use]
pub fn tiles_reflection_kind(flags: u32) -> u32 {
    if (flags & TILES_REFLECTION_SAMPLED) != 0 {
        return 1;
    }
    if (flags & TILES_REFLECTION_MIRROR) != 0 {
        return 0;
    }
    2
}

/// How many tiles lie across and down an image; those at its end may be cut.
/// Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::tiles_count;
///
/// assert_eq!(tiles_count(UVec2::new(1920, 1080)), UVec2::new(240, 135));
/// assert_eq!(tiles_count(UVec2::new(9, 8)), UVec2::new(2, 1));
/// ```
#[inline]
#[must_use]
pub fn tiles_count(size: UVec2) -> UVec2 {
    UVec2::new(tiles_reach(size.x), tiles_reach(size.y))
}

/// The place of a tile by its index, row by row; `across` is the number of
/// tiles in a row, at least 1. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::tiles_at;
///
/// assert_eq!(tiles_at(241, 240), UVec2::new(1, 1));
/// ```
#[inline]
#[must_use]
pub fn tiles_at(index: u32, across: u32) -> UVec2 {
    let columns = across.max(1);
    UVec2::new(index % columns, index / columns)
}

/// How many tiles to either side hold whatever lies within a reach in pixels.
/// Exact.
///
/// ```
/// use raytwin_cpu::filter::tiles::tiles_reach;
///
/// assert_eq!(tiles_reach(0), 0);
/// assert_eq!(tiles_reach(8), 1);
/// assert_eq!(tiles_reach(9), 2);
/// ```
#[inline]
#[must_use]
pub fn tiles_reach(pixels: u32) -> u32 {
    (pixels >> 3) + u32::from((pixels & 7) != 0)
}

/// How far `filter/svgf`'s passes reach together, in pixels: pass `i` has taps
/// as far as `radius·2^i`, so 62 for the paper's five passes of 5 × 5.
///
/// The 3 × 3 mean of variances adds nothing: it changes weights, and weights do
/// not matter where all values are the same. Where `svgf_variance_pixel` runs
/// before, add 3 for its 7 × 7. At most 2 and 16 count, as there. Exact.
///
/// ```
/// use raytwin_cpu::filter::tiles::tiles_atrous_reach;
///
/// // 2 (1 + 2 + 4 + 8 + 16)
/// assert_eq!(tiles_atrous_reach(2, 5), 62);
/// ```
#[inline]
#[must_use]
pub fn tiles_atrous_reach(radius: u32, passes: u32) -> u32 {
    radius.min(2) * ((1 << passes.min(16)) - 1)
}

/// A tile's flags: those of its pixels together, of those inside `size`. Exact.
///
/// `read_pixel(at)` gives a pixel's flags and is only called inside the image.
/// In WGSL it is a function that the program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::{
///     TILES_DARK, TILES_LIT, TILES_MIXED, tiles_flags,
/// };
///
/// // A shadow's edge runs through the second tile.
/// let read = |at: UVec2| if at.x < 12 { TILES_LIT } else { TILES_DARK };
/// let size = UVec2::new(32, 8);
/// assert_eq!(tiles_flags(UVec2::new(0, 0), size, read), TILES_LIT);
/// assert_eq!(tiles_flags(UVec2::new(1, 0), size, read), TILES_MIXED);
/// ```
#[inline]
#[must_use]
pub fn tiles_flags<R>(tile: UVec2, size: UVec2, read_pixel: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    let tiles = tiles_count(size);
    if tile.x >= tiles.x || tile.y >= tiles.y {
        return TILES_NONE;
    }
    let mut flags = 0;
    let mut i = 0;
    while i < TILES_SIZE * TILES_SIZE {
        // The first pixel of a tile in the image is in the image.
        let x = i & 7;
        let y = i >> 3;
        i += 1;
        if x < size.x - (tile.x << 3) && y < size.y - (tile.y << 3) {
            flags |= read_pixel(UVec2::new((tile.x << 3) + x, (tile.y << 3) + y));
        }
    }
    flags
}

/// First of two passes: the flags of the tiles in a row, `reach` tiles to
/// either side. `tiles` is [`tiles_count`], each below 2^31 as is `reach`; 0
/// outside of it. Exact.
///
/// `read(tile)` gives a tile's flags and is only called for tiles of the image.
/// In WGSL it is a function that the program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::{
///     TILES_DARK, TILES_LIT, TILES_MIXED, tiles_horizontal,
/// };
///
/// // One dark tile at x = 5; a reach of two tiles sees it from x = 3 on.
/// let read = |tile: UVec2| if tile.x == 5 { TILES_DARK } else { TILES_LIT };
/// let tiles = UVec2::new(10, 1);
/// assert_eq!(tiles_horizontal(UVec2::new(2, 0), tiles, 2, read), TILES_LIT);
/// assert_eq!(tiles_horizontal(UVec2::new(3, 0), tiles, 2, read), TILES_MIXED);
/// ```
#[inline]
#[must_use]
pub fn tiles_horizontal<R>(tile: UVec2, tiles: UVec2, reach: u32, read: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    if tile.x >= tiles.x || tile.y >= tiles.y {
        return TILES_NONE;
    }
    let last = tile.x + (tiles.x - 1 - tile.x).min(reach);
    let mut flags = 0;
    let mut x = tile.x - tile.x.min(reach);
    while x <= last {
        flags |= read(UVec2::new(x, tile.y));
        x += 1;
    }
    flags
}

/// Second of two passes: the flags of the rows, `reach` tiles up and down; else
/// as [`tiles_horizontal`]. Exact.
///
/// `read_row(tile)` gives what [`tiles_horizontal`] gave. In WGSL it is a
/// function that the program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::{
///     TILES_DARK, TILES_LIT, TILES_MIXED, tiles_vertical,
/// };
///
/// let row = |tile: UVec2| if tile.y == 5 { TILES_DARK } else { TILES_LIT };
/// let tiles = UVec2::new(1, 10);
/// assert_eq!(tiles_vertical(UVec2::new(0, 2), tiles, 2, row), TILES_LIT);
/// assert_eq!(tiles_vertical(UVec2::new(0, 3), tiles, 2, row), TILES_MIXED);
/// ```
#[inline]
#[must_use]
pub fn tiles_vertical<R>(tile: UVec2, tiles: UVec2, reach: u32, read_row: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    if tile.x >= tiles.x || tile.y >= tiles.y {
        return TILES_NONE;
    }
    let last = tile.y + (tiles.y - 1 - tile.y).min(reach);
    let mut flags = 0;
    let mut y = tile.y - tile.y.min(reach);
    while y <= last {
        flags |= read_row(UVec2::new(tile.x, y));
        y += 1;
    }
    flags
}

/// 1 if a tile is to be filtered, else 0: if it holds anything that the filter
/// may change (`own` flags), and there are both lit and dark pixels, or others,
/// as far `around` it as the filter reaches. Exact.
///
/// ```
/// use raytwin_cpu::filter::tiles::{
///     TILES_LIT, TILES_MIXED, TILES_NONE, tiles_needed,
/// };
///
/// // Lit, but a shadow is within reach; lit far and wide; nothing to filter.
/// assert_eq!(tiles_needed(TILES_LIT, TILES_MIXED), 1);
/// assert_eq!(tiles_needed(TILES_LIT, TILES_LIT), 0);
/// assert_eq!(tiles_needed(TILES_NONE, TILES_MIXED), 0);
/// ```
#[inline]
#[must_use]
pub fn tiles_needed(own: u32, around: u32) -> u32 {
    if own == TILES_NONE {
        return 0;
    }
    u32::from(around >= TILES_MIXED)
}

/// What to dispatch, a workgroup a tile, for `count` needed tiles of which a
/// list of `capacity` holds the first; `tiles` are in the image.
///
/// A list that is too short is not used: all tiles are filtered, which gives
/// the same image later. At most 2^24 - 256 tiles can be dispatched. Exact.
///
/// ```
/// use glam::UVec3;
/// use raytwin_cpu::filter::tiles::tiles_dispatch;
///
/// let dispatch = tiles_dispatch(1000, 2000, 8160);
/// assert_eq!((dispatch.groups, dispatch.count), (UVec3::new(256, 4, 1), 1000));
/// // More than the list holds: all tiles.
/// assert_eq!(tiles_dispatch(3000, 2000, 8160).count, 8160);
/// ```
#[inline]
#[must_use]
pub fn tiles_dispatch(count: u32, capacity: u32, tiles: u32) -> TilesDispatch {
    let whole = u32::from(count > capacity || count > tiles);
    let listed = if whole != 0 { tiles } else { count };
    let rows = (listed / TILES_ROW) + u32::from((listed % TILES_ROW) != 0);
    TilesDispatch {
        groups: UVec3::new(listed.min(TILES_ROW), rows, 1),
        whole,
        count: listed,
    }
}

/// The place in the list that a workgroup of [`tiles_dispatch`] works on; those
/// at or beyond `count` have none. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::tiles::{TILES_ROW, tiles_slot};
///
/// assert_eq!(tiles_slot(UVec2::new(3, 2)), 2 * TILES_ROW + 3);
/// ```
#[inline]
#[must_use]
pub fn tiles_slot(group: UVec2) -> u32 {
    group.y * TILES_ROW + group.x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::reflection::{
        REFLECTION_DIFFUSE, REFLECTION_MIRROR, REFLECTION_SAMPLED, reflection_kind,
    };
    use crate::filter::svgf;
    use crate::random::pcg::pcg_hash;

    #[test]
    fn what_is_no_data_is_the_filters() {
        assert_eq!(TILES_VALUE_BITS, svgf::VALUE_BITS);
        assert_eq!(TILES_VARIANCE_BITS, svgf::VARIANCE_BITS);
        assert_eq!(TILES_ONE_BITS, 1f32.to_bits());
    }

    #[test]
    fn a_pixel_is_lit_or_dark_only_beyond_doubt() {
        assert_eq!(tiles_scalar_flags(1.0, 0.0, 1), TILES_LIT);
        assert_eq!(tiles_scalar_flags(0.0, 0.0, 1), TILES_DARK);
        for (value, variance) in [
            (1.0, 1e-30),
            (0.0, 1e-30),
            (1.0, -0.0),
            (-0.0, 0.0),
            (1.0 - f32::EPSILON / 2.0, 0.0),
            (f32::NAN, 0.0),
            (1.0, f32::NAN),
            (f32::INFINITY, 0.0),
        ] {
            assert_eq!(tiles_scalar_flags(value, variance, 1), TILES_MIXED);
        }
        // Without a surface whatever is data comes back as it is.
        for (value, variance) in [(0.3, 0.0), (-0.0, 2.0), (1e17, 1e30)] {
            assert_eq!(tiles_scalar_flags(value, variance, 0), TILES_NONE);
        }
        // But not this: the filter makes it 0.
        for (value, variance) in [
            (f32::NAN, 0.0),
            (1.2e18, 0.0),
            (0.3, -0.0),
            (0.3, -1.0),
            (0.3, f32::MAX),
        ] {
            assert_eq!(tiles_scalar_flags(value, variance, 0), TILES_MIXED);
        }
        assert_eq!(tiles_color_flags(Vec3::ONE, 0.0, 1), TILES_LIT);
        assert_eq!(tiles_color_flags(Vec3::ZERO, 0.0, 1), TILES_DARK);
        assert_eq!(tiles_color_flags(Vec3::X, 0.0, 1), TILES_MIXED);
        assert_eq!(tiles_color_flags(Vec3::X, 0.1, 0), TILES_NONE);
    }

    #[test]
    fn kinds_of_reflections_are_those_of_the_cuts() {
        let tile = |roughness: &[f32]| {
            tiles_reflection_kind(roughness.iter().fold(0, |flags, r| {
                flags | tiles_reflection_flags(reflection_kind(*r, 0.05, 0.75))
            }))
        };
        assert_eq!(tile(&[0.0, 0.01]), REFLECTION_MIRROR);
        assert_eq!(tile(&[0.0, 0.9]), REFLECTION_MIRROR);
        assert_eq!(tile(&[0.9, 0.8]), REFLECTION_DIFFUSE);
        assert_eq!(tile(&[0.9, 0.01, 0.3]), REFLECTION_SAMPLED);
        for (kind, flag) in [
            (REFLECTION_MIRROR, TILES_REFLECTION_MIRROR),
            (REFLECTION_SAMPLED, TILES_REFLECTION_SAMPLED),
            (REFLECTION_DIFFUSE, TILES_REFLECTION_DIFFUSE),
        ] {
            assert_eq!(tiles_reflection_flags(kind), flag);
        }
    }

    #[test]
    fn every_pixel_counts_once_and_none_outside() {
        for size in [
            UVec2::new(45, 30),
            UVec2::ONE,
            UVec2::new(8, 16),
            UVec2::new(9, 3),
        ] {
            let tiles = tiles_count(size);
            let seen = std::cell::RefCell::new(std::collections::BTreeSet::new());
            for i in 0..tiles.x * tiles.y {
                let tile = tiles_at(i, tiles.x);
                let _ = tiles_flags(tile, size, |at| {
                    assert!(at.cmplt(size).all() && at / 8 == tile);
                    assert!(seen.borrow_mut().insert((at.x, at.y)));
                    0
                });
            }
            assert_eq!(seen.borrow().len() as u32, size.x * size.y);
            let none = |_: UVec2| -> u32 { panic!("a pixel was read") };
            assert_eq!(tiles_flags(UVec2::new(tiles.x, 0), size, none), TILES_NONE);
        }
        // The last tile that a u32 can name.
        let end = UVec2::splat(u32::MAX);
        assert_eq!(tiles_flags(tiles_count(end) - 1, end, |_| 2), TILES_DARK);
    }

    #[test]
    fn rows_and_columns_are_the_square() {
        let tiles = UVec2::new(11, 7);
        let read =
            |t: UVec2| u32::from(pcg_hash(t.x ^ pcg_hash(t.y)).is_multiple_of(9)) << (t.x % 2);
        for reach in [0, 1, 3, 20] {
            for i in 0..77 {
                let tile = tiles_at(i, tiles.x);
                let row = |t| {
                    assert!(UVec2::cmplt(t, tiles).all());
                    tiles_horizontal(t, tiles, reach, read)
                };
                let mut want = 0;
                for j in 0..77 {
                    let other = tiles_at(j, tiles.x);
                    let near = other.x.abs_diff(tile.x).max(other.y.abs_diff(tile.y));
                    want |= if near <= reach { read(other) } else { 0 };
                }
                assert_eq!(tiles_vertical(tile, tiles, reach, row), want);
            }
        }
        let none = |_: UVec2| -> u32 { panic!("a tile was read") };
        assert_eq!(tiles_horizontal(tiles, tiles, 1, none), TILES_NONE);
        assert_eq!(tiles_vertical(tiles, tiles, 1, none), TILES_NONE);
    }

    #[test]
    fn the_reach_is_that_of_all_passes() {
        assert_eq!(tiles_atrous_reach(2, 5), 2 * (1 + 2 + 4 + 8 + 16));
        assert_eq!(tiles_atrous_reach(1, 4), 15);
        assert_eq!(tiles_atrous_reach(2, 0), 0);
        assert_eq!(tiles_atrous_reach(9, 99), 2 * 65535);
        assert_eq!(tiles_reach(0), 0);
        assert_eq!(tiles_reach(1), 1);
        assert_eq!(tiles_reach(62), 8);
        assert_eq!(tiles_reach(65), 9);
        assert_eq!(tiles_reach(u32::MAX), 1 << 29);
        // Whatever is so many pixels away lies in a tile so many tiles away.
        for pixels in 0..40u32 {
            let farthest = (0..8)
                .flat_map(|x: u32| [(x + 800 + pixels) / 8 - 100, 100 - (x + 800 - pixels) / 8])
                .max();
            assert_eq!(farthest, Some(tiles_reach(pixels)));
        }
    }

    #[test]
    fn a_list_that_is_too_short_means_everything() {
        let fits = tiles_dispatch(700, 1000, 1000);
        assert_eq!(fits.groups, UVec3::new(256, 3, 1));
        assert_eq!((fits.whole, fits.count), (0, 700));
        let short = tiles_dispatch(700, 699, 1000);
        assert_eq!(short.groups, UVec3::new(256, 4, 1));
        assert_eq!((short.whole, short.count), (1, 1000));
        // Nothing to do is nothing to dispatch.
        assert_eq!(tiles_dispatch(0, 10, 10).groups, UVec3::new(0, 0, 1));
        // A count that cannot be (nobody cleared it).
        assert_eq!(tiles_dispatch(u32::MAX, u32::MAX, 10).count, 10);
        // Each place has a workgroup, and no two the same.
        for count in [1, 255, 256, 257, 5000] {
            let d = tiles_dispatch(count, count, count);
            let mut slots: Vec<_> = (0..d.groups.x * d.groups.y)
                .map(|i| tiles_slot(UVec2::new(i % d.groups.x, i / d.groups.x)))
                .filter(|slot| *slot < d.count)
                .collect();
            slots.sort_unstable();
            assert_eq!(slots, (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_tile_is_left_out_only_if_all_around_is_alike() {
        assert_eq!(tiles_needed(TILES_LIT, TILES_LIT), 0);
        assert_eq!(tiles_needed(TILES_DARK, TILES_DARK), 0);
        assert_eq!(tiles_needed(TILES_LIT, TILES_MIXED), 1);
        assert_eq!(tiles_needed(TILES_MIXED, TILES_MIXED), 1);
        // The sky, whatever is next to it.
        assert_eq!(tiles_needed(TILES_NONE, TILES_MIXED), 0);
    }
}
