//! 32 shadow rays in one word, and their mean over 17 x 17 pixels.
//!
//! One word holds a block of 8 x 4 pixels: bit `8 y + x` is set if the ray of
//! the pixel `(x, y)` of the block reached the light. A neighbourhood is then
//! counted word by word: 289 rays lie in at most 15 words, and integers add up
//! exactly in any order.
//!
//! Pixels outside the image do not count, neither as rays nor in the number
//! that the sum is divided by, whatever the unused bits of a block hold.
//!
//! Source: AMD, *FidelityFX Denoiser* 1.x (shadows) for blocks of 8 x 4 and the
//! neighbourhood of 17 x 17; counting by masks and the borders are ours.

use glam::UVec2;

/// How far the neighbourhood reaches in each direction: 8 pixels, 17 in a row.
pub const PACKED_VISIBILITY_REACH: u32 = 8;

/// Whether each of a block's rays reached the light.
///
/// ```
/// use raytwin_cpu::filter::packed_visibility::{
///     PackedVisibilityRays, packed_visibility_pack,
/// };
///
/// let lit = PackedVisibilityRays { visible: [1; 32] };
/// assert_eq!(packed_visibility_pack(lit), u32::MAX);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct PackedVisibilityRays {
    /// At `8 y + x` the ray of the pixel `(x, y)` of the block: 0 if something
    /// is in its way.
    pub visible: [u32; 32],
}

/// The block that holds a pixel. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_block;
///
/// assert_eq!(packed_visibility_block(UVec2::new(7, 3)), UVec2::ZERO);
/// assert_eq!(packed_visibility_block(UVec2::new(8, 4)), UVec2::ONE);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_block(pixel: UVec2) -> UVec2 {
    UVec2::new(pixel.x >> 3, pixel.y >> 2)
}

/// A pixel's bit in its block's word.
///
/// `local` may be the pixel in its block or the pixel in the image: only the
/// three lowest bits of `x` and the two lowest of `y` are looked at. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_bit;
///
/// // Bit 8 y + x, for a pixel of the image as well as of the block.
/// assert_eq!(packed_visibility_bit(UVec2::new(2, 1)), 1 << 10);
/// assert_eq!(packed_visibility_bit(UVec2::new(8 + 2, 4 + 1)), 1 << 10);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_bit(local: UVec2) -> u32 {
    1 << (((local.y & 3) << 3) | (local.x & 7))
}

/// A block's word. Exact.
///
/// ```
/// use raytwin_cpu::filter::packed_visibility::{
///     PackedVisibilityRays, packed_visibility_pack,
/// };
///
/// let mut rays = PackedVisibilityRays { visible: [0; 32] };
/// rays.visible[10] = 1;
/// assert_eq!(packed_visibility_pack(rays), 1 << 10);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_pack(rays: PackedVisibilityRays) -> u32 {
    let mut word = 0;
    let mut i = 0;
    while i < 32 {
        if rays.visible[i as usize] != 0 {
            word |= 1 << i;
        }
        i += 1;
    }
    word
}

/// 1 if the pixel's ray reached the light, else 0; `local` as in
/// [`packed_visibility_bit`]. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_unpack;
///
/// let word = 1 << 10;
/// assert_eq!(packed_visibility_unpack(word, UVec2::new(2, 1)), 1);
/// assert_eq!(packed_visibility_unpack(word, UVec2::new(1, 2)), 0);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_unpack(word: u32, local: UVec2) -> u32 {
    (word >> (((local.y & 3) << 3) | (local.x & 7))) & 1
}

/// The bits of those pixels of a block that lie in the rectangle from `low` to
/// `high`, both included, in pixels of the image.
///
/// The block is one that [`packed_visibility_block`] can give: `x` below 2^29,
/// `y` below 2^30. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_window;
///
/// // The upper left 2 x 2 pixels of the first block.
/// let window = packed_visibility_window(UVec2::ZERO, UVec2::ZERO, UVec2::ONE);
/// assert_eq!(window, 0b11 | 0b11 << 8);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_window(block: UVec2, low: UVec2, high: UVec2) -> u32 {
    let start = UVec2::new(block.x << 3, block.y << 2);
    let end = UVec2::new(start.x + 7, start.y + 3);
    if low.x > end.x || low.y > end.y || high.x < start.x || high.y < start.y {
        return 0;
    }
    if low.x > high.x || low.y > high.y {
        return 0;
    }
    let x0 = low.x.max(start.x) & 7;
    let y0 = low.y.max(start.y) & 3;
    let x1 = high.x.min(end.x) & 7;
    let y1 = high.y.min(end.y) & 3;
    let row = (0xff << x0) & (0xff >> (7 - x1));
    let rows = (0xffff_ffff << (y0 << 3)) & (0xffff_ffff >> ((3 - y1) << 3));
    (row * 0x0101_0101) & rows
}

/// How many rays of a block reached the light, of those whose bit is set in
/// `window`. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::{
///     packed_visibility_count, packed_visibility_window,
/// };
///
/// let window = packed_visibility_window(UVec2::ZERO, UVec2::ZERO, UVec2::ONE);
/// assert_eq!(packed_visibility_count(u32::MAX, window), 4);
/// assert_eq!(packed_visibility_count(0b01, window), 1);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_count(word: u32, window: u32) -> u32 {
    (word & window).count_ones()
}

/// How many rays reached the light in the rectangle from `low` to `high`, both
/// included; 0 if one is beyond the other. Exact.
///
/// `read(block)` gives a block's word and is only called for blocks that the
/// rectangle touches. In WGSL it is a function that the program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_rectangle;
///
/// // All rays of the left column of blocks reached the light.
/// let read = |block: UVec2| if block.x == 0 { u32::MAX } else { 0 };
/// let count =
///     packed_visibility_rectangle(UVec2::new(6, 1), UVec2::new(9, 5), read);
/// assert_eq!(count, 2 * 5);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_rectangle<R>(low: UVec2, high: UVec2, read: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    let first = packed_visibility_block(low);
    let last = packed_visibility_block(high);
    let mut sum = 0;
    let mut y = first.y;
    while y <= last.y {
        let mut x = first.x;
        while x <= last.x {
            let block = UVec2::new(x, y);
            let window = packed_visibility_window(block, low, high);
            if window != 0 {
                sum += packed_visibility_count(read(block), window);
            }
            x += 1;
        }
        y += 1;
    }
    sum
}

/// The first pixel of the neighbourhood. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_low;
///
/// assert_eq!(packed_visibility_low(UVec2::new(20, 3)), UVec2::new(12, 0));
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_low(pixel: UVec2) -> UVec2 {
    UVec2::new(
        pixel.x - pixel.x.min(PACKED_VISIBILITY_REACH),
        pixel.y - pixel.y.min(PACKED_VISIBILITY_REACH),
    )
}

/// The last pixel of the neighbourhood; `pixel` lies inside `size`. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_high;
///
/// let size = UVec2::new(64, 32);
/// let last = packed_visibility_high(UVec2::new(20, 30), size);
/// assert_eq!(last, UVec2::new(28, 31));
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_high(pixel: UVec2, size: UVec2) -> UVec2 {
    UVec2::new(
        pixel.x + (size.x - 1 - pixel.x).min(PACKED_VISIBILITY_REACH),
        pixel.y + (size.y - 1 - pixel.y).min(PACKED_VISIBILITY_REACH),
    )
}

/// How many pixels of the image lie in the neighbourhood of a pixel: 289 away
/// from the borders, 81 in a corner, 0 for a pixel outside. Exact.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_area;
///
/// let size = UVec2::new(64, 32);
/// assert_eq!(packed_visibility_area(UVec2::new(20, 15), size), 17 * 17);
/// assert_eq!(packed_visibility_area(UVec2::ZERO, size), 9 * 9);
/// assert_eq!(packed_visibility_area(size, size), 0);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_area(pixel: UVec2, size: UVec2) -> u32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    (high.x - low.x + 1) * (high.y - low.y + 1)
}

/// First of two passes: how many rays reached the light in the pixel's row, 8
/// pixels to either side. From three words at most; 0 outside the image.
/// Exact.
///
/// `read(block)` gives a block's word. In WGSL it is a function that the
/// program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_horizontal;
///
/// // Every ray reached the light: 9 pixels at the border, 17 away from it.
/// let size = UVec2::new(64, 32);
/// assert_eq!(packed_visibility_horizontal(UVec2::ZERO, size, |_| u32::MAX), 9);
/// let inside = UVec2::new(20, 15);
/// assert_eq!(packed_visibility_horizontal(inside, size, |_| u32::MAX), 17);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_horizontal<R>(pixel: UVec2, size: UVec2, read: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    packed_visibility_rectangle(
        UVec2::new(low.x, pixel.y),
        UVec2::new(high.x, pixel.y),
        read,
    )
}

/// Second of two passes: the sum of the rows' sums, 8 pixels up and down; 0
/// outside the image. Exact.
///
/// `read_row(pixel)` gives what [`packed_visibility_horizontal`] gave. In WGSL
/// it is a function that the program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::{
///     packed_visibility_horizontal, packed_visibility_sum,
///     packed_visibility_vertical,
/// };
///
/// let size = UVec2::new(64, 32);
/// let read = |block: UVec2| 0x1234_5678 ^ block.x;
/// let row = |pixel: UVec2| packed_visibility_horizontal(pixel, size, read);
/// // Two passes count what one does.
/// let pixel = UVec2::new(20, 15);
/// let sum = packed_visibility_vertical(pixel, size, row);
/// assert_eq!(sum, packed_visibility_sum(pixel, size, read));
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_vertical<R>(pixel: UVec2, size: UVec2, read_row: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    let mut sum = 0;
    let mut y = low.y;
    while y <= high.y {
        sum += read_row(UVec2::new(pixel.x, y));
        y += 1;
    }
    sum
}

/// The same sum in one pass, without an image of rows: from 15 words at most.
/// 0 outside the image. Exact.
///
/// `read(block)` gives a block's word. In WGSL it is a function that the
/// program defines.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::{
///     packed_visibility_area, packed_visibility_mean, packed_visibility_sum,
/// };
///
/// // Half of the rays: every other pixel of a row.
/// let size = UVec2::new(64, 32);
/// let pixel = UVec2::new(20, 15);
/// let sum = packed_visibility_sum(pixel, size, |_| 0x5555_5555);
/// let mean = packed_visibility_mean(sum, packed_visibility_area(pixel, size));
/// assert!((mean - 0.5).abs() < 0.05);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_sum<R>(pixel: UVec2, size: UVec2, read: R) -> u32
where
    R: Fn(UVec2) -> u32,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0;
    }
    let low = packed_visibility_low(pixel);
    let high = packed_visibility_high(pixel, size);
    packed_visibility_rectangle(low, high, read)
}

/// The mean of `area` rays of which `sum` reached the light, `area <= 4096`;
/// without rays 1, lit.
///
/// Exactly 0 if none did and exactly 1 if all did.
///
/// Error analysis: one quotient of exact numbers.
///
/// ```
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_mean;
///
/// assert_eq!(packed_visibility_mean(64, 256), 0.25);
/// assert_eq!(packed_visibility_mean(289, 289), 1.0);
/// // No rays, no shadow.
/// assert_eq!(packed_visibility_mean(0, 0), 1.0);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_mean(sum: u32, area: u32) -> f32 {
    if sum >= area {
        return 1.0;
    }
    sum as f32 / area as f32
}

/// The variance of one ray among `area` of which `sum` reached the light,
/// `p (1 - p)` with `p` the mean; `area <= 4096`.
///
/// Exactly 0 where all agree, never negative; at most 1/4.
///
/// Error analysis: one quotient of exact numbers, as `p - p²` over `area²`.
///
/// ```
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_variance;
///
/// assert_eq!(packed_visibility_variance(128, 256), 0.25);
/// // All agree.
/// assert_eq!(packed_visibility_variance(289, 289), 0.0);
/// ```
#[inline]
#[must_use]
pub fn packed_visibility_variance(sum: u32, area: u32) -> f32 {
    if sum >= area {
        return 0.0;
    }
    (sum * (area - sum)) as f32 / (area * area) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::pcg_hash;

    const SIZES: [UVec2; 5] = [
        UVec2::new(1, 1),
        UVec2::new(8, 4),
        UVec2::new(45, 30),
        UVec2::new(64, 5),
        UVec2::new(3, 70),
    ];

    fn blocks(size: UVec2) -> UVec2 {
        UVec2::new(size.x.div_ceil(8), size.y.div_ceil(4))
    }

    /// Packs an image; bits without a pixel are `beyond`.
    fn pack(size: UVec2, visible: impl Fn(UVec2) -> bool, beyond: bool) -> Vec<u32> {
        let blocks = blocks(size);
        (0..blocks.x * blocks.y)
            .map(|i| {
                let start = UVec2::new(i % blocks.x * 8, i / blocks.x * 4);
                packed_visibility_pack(PackedVisibilityRays {
                    visible: std::array::from_fn(|k| {
                        let at = start + UVec2::new(k as u32 % 8, k as u32 / 8);
                        u32::from(if at.cmplt(size).all() {
                            visible(at)
                        } else {
                            beyond
                        })
                    }),
                })
            })
            .collect()
    }

    fn reader(words: &[u32], size: UVec2) -> impl Fn(UVec2) -> u32 {
        let blocks = blocks(size);
        move |block| {
            assert!(block.cmplt(blocks).all(), "{block} is outside");
            words[(block.y * blocks.x + block.x) as usize]
        }
    }

    fn pixels(size: UVec2) -> impl Iterator<Item = UVec2> {
        (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
    }

    fn speckle(at: UVec2) -> bool {
        pcg_hash(at.x ^ pcg_hash(at.y)) & 1 == 1
    }

    fn by_hand(pixel: UVec2, size: UVec2, visible: impl Fn(UVec2) -> bool) -> u32 {
        pixels(size)
            .filter(|at| at.x.abs_diff(pixel.x) <= 8 && at.y.abs_diff(pixel.y) <= 8)
            .filter(|at| visible(*at))
            .count() as u32
    }

    #[test]
    fn what_is_packed_comes_out_again() {
        let size = UVec2::new(45, 30);
        let words = pack(size, speckle, false);
        let read = reader(&words, size);
        for at in pixels(size) {
            let word = read(packed_visibility_block(at));
            assert_eq!(packed_visibility_unpack(word, at), u32::from(speckle(at)));
            let bit = packed_visibility_bit(at);
            assert_eq!(bit.count_ones(), 1);
            assert_eq!(word & bit != 0, speckle(at));
        }
        let lit: u32 = words.iter().map(|w| packed_visibility_count(*w, !0)).sum();
        assert_eq!(lit as usize, pixels(size).filter(|at| speckle(*at)).count());
    }

    #[test]
    fn the_two_passes_the_one_and_the_plain_sum_agree() {
        for size in SIZES {
            // What lies beyond the image must not matter.
            for beyond in [false, true] {
                let words = pack(size, speckle, beyond);
                let read = reader(&words, size);
                let rows: Vec<_> = pixels(size)
                    .map(|at| packed_visibility_horizontal(at, size, &read))
                    .collect();
                for at in pixels(size) {
                    let row = |p: UVec2| rows[(p.y * size.x + p.x) as usize];
                    let want = by_hand(at, size, speckle);
                    assert_eq!(packed_visibility_vertical(at, size, row), want);
                    assert_eq!(packed_visibility_sum(at, size, &read), want);
                    let area = by_hand(at, size, |_| true);
                    assert_eq!(packed_visibility_area(at, size), area);
                }
            }
        }
    }

    #[test]
    fn all_lit_is_one_and_all_dark_is_zero_up_to_the_border() {
        for size in SIZES {
            for lit in [false, true] {
                let words = pack(size, |_| lit, !lit);
                for at in pixels(size) {
                    let sum = packed_visibility_sum(at, size, reader(&words, size));
                    let area = packed_visibility_area(at, size);
                    let value = f32::from(u8::from(lit));
                    assert_eq!(packed_visibility_mean(sum, area), value);
                    assert_eq!(packed_visibility_variance(sum, area), 0.0);
                }
            }
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_mirrored_and_transposed_means() {
        let size = UVec2::new(45, 30);
        let words = pack(size, speckle, true);
        let mirror = |at: UVec2| UVec2::new(size.x - 1 - at.x, size.y - 1 - at.y);
        let mirrored = pack(size, |at| speckle(mirror(at)), false);
        let turned = UVec2::new(size.y, size.x);
        let transposed = pack(turned, |at| speckle(UVec2::new(at.y, at.x)), true);
        for at in pixels(size) {
            let sum = packed_visibility_sum(at, size, reader(&words, size));
            let other = packed_visibility_sum(mirror(at), size, reader(&mirrored, size));
            assert_eq!(sum, other, "{at} mirrored");
            let swapped = UVec2::new(at.y, at.x);
            let other = packed_visibility_sum(swapped, turned, reader(&transposed, turned));
            assert_eq!(sum, other, "{at} transposed");
        }
    }

    /// Trap: dividing by 289 at the border too, as a well-known sample does,
    /// darkens the border of an image in full light.
    #[test]
    fn dividing_by_289_darkens_the_border() {
        let size = UVec2::new(45, 30);
        let words = pack(size, |_| true, false);
        let corner = packed_visibility_sum(UVec2::ZERO, size, reader(&words, size));
        assert_eq!(corner, 81);
        assert!(corner as f32 / 289.0 < 0.3);
        let area = packed_visibility_area(UVec2::ZERO, size);
        assert_eq!(packed_visibility_mean(corner, area), 1.0);
    }

    /// Trap: bits of the last blocks that no pixel set are not rays.
    #[test]
    fn unmasked_words_count_rays_outside_the_image() {
        let size = UVec2::new(45, 30);
        let words = pack(size, |_| false, true);
        let at = size - 1;
        let unmasked: u32 = words.iter().map(|w| w.count_ones()).sum();
        assert!(unmasked > 0);
        assert_eq!(packed_visibility_sum(at, size, reader(&words, size)), 0);
    }

    #[test]
    fn nothing_is_read_that_is_not_there() {
        let read = |_: UVec2| -> u32 { panic!("a block was read") };
        for (at, size) in [
            (UVec2::ZERO, UVec2::ZERO),
            (UVec2::new(5, 0), UVec2::new(5, 9)),
            (UVec2::splat(u32::MAX), UVec2::splat(100)),
        ] {
            assert_eq!(packed_visibility_sum(at, size, read), 0);
            assert_eq!(packed_visibility_horizontal(at, size, read), 0);
            assert_eq!(packed_visibility_vertical(at, size, read), 0);
            assert_eq!(packed_visibility_area(at, size), 0);
        }
        // The last pixel that a u32 can name.
        let size = UVec2::splat(u32::MAX);
        let sum = packed_visibility_sum(size - 1, size, |_| !0);
        assert_eq!(sum, 81);
        assert_eq!(packed_visibility_area(size - 1, size), 81);
    }

    #[test]
    fn reads_are_few() {
        let size = UVec2::new(64, 64);
        for at in pixels(size) {
            let reads = std::cell::Cell::new(0);
            let read = |_| {
                reads.set(reads.get() + 1);
                0
            };
            let _ = packed_visibility_sum(at, size, read);
            assert!(reads.replace(0) <= 15);
            let _ = packed_visibility_horizontal(at, size, read);
            assert!(reads.get() <= 3);
        }
    }
}
