//! Halton points, aligned to pixels, with exact integer digits.
//!
//! Source: Halton 1964; pixel-aligned index after Grünschloß, Raab and Keller,
//! *Enumerating Quasi-Monte Carlo Point Sequences in Elementary Intervals*
//! (2012), as used by the PICA PICA chapter (*Ray Tracing Gems*, chapter 25,
//! section 25.5); rotation: Cranley and Patterson 1976.

/// Bases of the first 32 dimensions.
pub const HALTON_PRIMES: [u32; 32] = [
    2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97,
    101, 103, 107, 109, 113, 127, 131,
];

/// Width of the tile over which [`halton_index`] enumerates pixels: 2^8.
pub const HALTON_TILE_WIDTH: u32 = 256;
/// Height of that tile: 3^6.
pub const HALTON_TILE_HEIGHT: u32 = 729;
/// Distance between the indices of successive samples of one pixel.
pub const HALTON_STRIDE: u32 = 186_624;
/// Samples of one pixel whose indices all fit 32 bits; then they repeat.
pub const HALTON_PERIOD: u32 = 23_014;

/// Where one pixel is in its sequence.
///
/// ```
/// use raytwin_cpu::random::halton::{halton_index, halton_init};
///
/// // The first path of pixel (3, 5) in frame 0: two dimensions chose the pixel.
/// let state = halton_init(3, 5, 0, 1, 0, 64);
/// assert_eq!(state.dimension, 2);
/// assert_eq!(state.index, halton_index(3, 5, 0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HaltonState {
    /// Dimension that the next [`halton_next`] draws.
    pub dimension: u32,
    /// Index of the point.
    pub index: u32,
}

/// What one draw gives.
///
/// ```
/// use raytwin_cpu::random::halton::{halton_init, halton_next};
///
/// let first = halton_next(halton_init(3, 5, 0, 1, 0, 64));
/// let second = halton_next(first.state);
/// assert_eq!(second.state.dimension, 4);
/// assert!((0.0..1.0).contains(&second.value));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HaltonDraw {
    /// State for the next draw: one dimension on.
    pub state: HaltonState,
    /// The coordinate, in `[0, 1)`.
    pub value: f32,
}

/// The lowest `digits` binary digits of `index`, mirrored. `digits <= 32`; 0
/// digits give 0.
///
/// ```
/// use raytwin_cpu::random::halton::halton_reverse_base_two;
///
/// assert_eq!(halton_reverse_base_two(0b0001_0110, 8), 0b0110_1000);
/// // A mirror image mirrored is the number itself.
/// assert_eq!(halton_reverse_base_two(halton_reverse_base_two(77, 8), 8), 77);
/// ```
#[inline]
#[must_use]
pub fn halton_reverse_base_two(index: u32, digits: u32) -> u32 {
    if digits == 0 {
        return 0;
    }
    index.reverse_bits() >> (32 - digits)
}

/// The lowest `digits` ternary digits of `index`, mirrored. `digits <= 20`.
///
/// ```
/// use raytwin_cpu::random::halton::halton_reverse_base_three;
///
/// // 5 is 12 in base three; with three digits 012, mirrored 210: 21.
/// assert_eq!(halton_reverse_base_three(5, 3), 21);
/// assert_eq!(halton_reverse_base_three(21, 3), 5);
/// ```
#[inline]
#[must_use]
pub fn halton_reverse_base_three(index: u32, digits: u32) -> u32 {
    let mut n = index;
    let mut result = 0u32;
    let mut digit = 0;
    while digit < digits {
        result = result.wrapping_mul(3).wrapping_add(n % 3);
        n /= 3;
        digit += 1;
    }
    result
}

/// Index of the `i`-th point whose first two coordinates fall into pixel
/// `(x, y)` of the tile of 256 × 729 pixels.
///
/// Tiles repeat over the screen. `i` counts modulo [`HALTON_PERIOD`]: one more
/// and the index would pass 2^32, and an index that wrapped would belong to
/// another pixel.
///
/// ```
/// use raytwin_cpu::random::halton::{
///     HALTON_TILE_WIDTH, halton_index, halton_sample,
/// };
///
/// // Every point of the sequence of pixel (17, 300) lies in that pixel.
/// for i in 0..4 {
///     let index = halton_index(17, 300, i);
///     let x = halton_sample(0, index) * HALTON_TILE_WIDTH as f32;
///     assert_eq!(x.floor(), 17.0);
/// }
/// ```
#[inline]
#[must_use]
pub fn halton_index(x: u32, y: u32, i: u32) -> u32 {
    let column = halton_reverse_base_two(x % HALTON_TILE_WIDTH, 8);
    let row = halton_reverse_base_three(y % HALTON_TILE_HEIGHT, 6);
    // 76545 = 729·105 is 1 mod 256 and 0 mod 729; 110080 = 256·430 the other
    // way round (the Chinese remainder theorem).
    let offset = (column * 76_545 + row * 110_080) % HALTON_STRIDE;
    offset + (i % HALTON_PERIOD) * HALTON_STRIDE
}

/// State for one path of one pixel in one frame.
///
/// `paths` paths are traced in a pixel each frame, `path` is this one's
/// number, and after `frame_loop` frames the points repeat. The first two
/// dimensions placed the point in its pixel, so drawing starts at the third.
///
/// ```
/// use raytwin_cpu::random::halton::halton_init;
///
/// // Two paths in a pixel each frame; after 16 frames the points repeat.
/// let state = halton_init(3, 5, 1, 2, 4, 16);
/// assert_eq!(state, halton_init(3, 5, 1, 2, 20, 16));
/// assert_ne!(state, halton_init(3, 5, 0, 2, 4, 16));
/// ```
#[inline]
#[must_use]
pub fn halton_init(
    x: u32,
    y: u32,
    path: u32,
    paths: u32,
    frame: u32,
    frame_loop: u32,
) -> HaltonState {
    // Reduced before the product so that no frame number overflows it.
    let i = (frame % frame_loop.max(1))
        .wrapping_mul(paths.max(1))
        .wrapping_add(path % paths.max(1));
    HaltonState {
        dimension: 2,
        index: halton_index(x, y, i),
    }
}

/// Base of a dimension: the primes in order. Dimensions repeat from 32 on.
///
/// ```
/// use raytwin_cpu::random::halton::halton_prime;
///
/// assert_eq!(halton_prime(0), 2);
/// assert_eq!(halton_prime(31), 131);
/// assert_eq!(halton_prime(32), 2);
/// ```
#[inline]
#[must_use]
pub fn halton_prime(dimension: u32) -> u32 {
    HALTON_PRIMES[(dimension & 31) as usize]
}

/// Digits of `index` in `base`, mirrored at the radix point; in `[0, 1)`.
///
/// `base` in `[2, 256]`, any `index`; 0 for a base below, which has no digits.
///
/// Error analysis: digits are integers. While `base^k <= 2^24` numerator and
/// denominator are exact in `f32` and the one division is the only rounding;
/// further digits enter as an exact ratio below one, added before that
/// division: three roundings, 1.5 ULP. Base two truncates to 24 digits: below
/// 2^-24 absolute.
///
/// ```
/// use raytwin_cpu::random::halton::halton_radical_inverse;
///
/// // 6 is 110 in base two: 0.011 is 3/8.
/// assert_eq!(halton_radical_inverse(2, 6), 0.375);
/// // 5 is 12 in base three: 0.21 is 7/9.
/// assert_eq!(halton_radical_inverse(3, 5), 7.0 / 9.0);
/// ```
#[inline]
#[must_use]
pub fn halton_radical_inverse(base: u32, index: u32) -> f32 {
    if base == 2 {
        return (index.reverse_bits() >> 8) as f32 * (1.0 / 16_777_216.0);
    }
    if base < 2 {
        return 0.0;
    }
    let limit = 16_777_216 / base;
    let mut n = index;
    let mut mirrored = 0u32;
    let mut power = 1u32;
    while n != 0 && power <= limit {
        mirrored = mirrored * base + n % base;
        power *= base;
        n /= base;
    }
    let mut tail = 0u32;
    let mut tail_power = 1u32;
    while n != 0 {
        tail = tail * base + n % base;
        tail_power *= base;
        n /= base;
    }
    let u = (mirrored as f32 + tail as f32 / tail_power as f32) / power as f32;
    // All digits at their highest can round to one.
    u.min(0.99999994)
}

/// Coordinate `dimension` of point `index`, in `[0, 1)`.
///
/// ```
/// use raytwin_cpu::random::halton::halton_sample;
///
/// // Points 1, 2, 3, 4 of the first dimension fill the gaps of those before.
/// let points = [1, 2, 3, 4].map(|index| halton_sample(0, index));
/// assert_eq!(points, [0.5, 0.25, 0.75, 0.125]);
/// ```
#[inline]
#[must_use]
pub fn halton_sample(dimension: u32, index: u32) -> f32 {
    halton_radical_inverse(halton_prime(dimension), index)
}

/// Draws one coordinate and moves on to the next dimension.
///
/// ```
/// use raytwin_cpu::random::halton::{
///     halton_index, halton_init, halton_next, halton_sample,
/// };
///
/// let draw = halton_next(halton_init(3, 5, 0, 1, 0, 64));
/// assert_eq!(draw.value, halton_sample(2, halton_index(3, 5, 0)));
/// assert_eq!(draw.state.dimension, 3);
/// ```
#[inline]
#[must_use]
pub fn halton_next(state: HaltonState) -> HaltonDraw {
    HaltonDraw {
        state: HaltonState {
            dimension: state.dimension.wrapping_add(1),
            index: state.index,
        },
        value: halton_sample(state.dimension, state.index),
    }
}

/// Cranley–Patterson rotation: `u + shift` modulo one, in `[0, 1)`.
///
/// Both arguments in `[0, 1)`. Added as 24-bit integers: a float sum just
/// below one would round to one, and `fract` of it would be the wrong end.
/// Exact for multiples of 2^-24, else the digits beyond are dropped.
///
/// ```
/// use raytwin_cpu::random::halton::halton_rotate;
///
/// assert_eq!(halton_rotate(0.75, 0.5), 0.25);
/// // Just below one stays below one.
/// assert!(halton_rotate(0.5, 0.49999997) < 1.0);
/// ```
#[inline]
#[must_use]
pub fn halton_rotate(u: f32, shift: f32) -> f32 {
    let a = (u * 16_777_216.0) as u32;
    let b = (shift * 16_777_216.0) as u32;
    ((a + b) & 0x00ff_ffff) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_points() {
        let bases = [(0, [0.5, 0.25, 0.75]), (2, [0.2, 0.4, 0.6])];
        for (dimension, values) in bases {
            for (i, v) in values.into_iter().enumerate() {
                assert_eq!(halton_sample(dimension, i as u32 + 1), v);
            }
        }
    }

    #[test]
    fn index_lands_in_its_pixel() {
        for (x, y) in [(0, 0), (255, 728), (17, 300), (128, 243), (300, 1000)] {
            for i in [0, 1, 2, 63] {
                let index = halton_index(x, y, i);
                // Exact digits: integers, not floats, decide the pixel.
                assert_eq!(halton_reverse_base_two(index, 8), x % 256);
                assert_eq!(halton_reverse_base_three(index, 6), y % 729);
            }
        }
    }

    #[test]
    fn index_never_overflows_and_repeats() {
        for i in [0, 1, HALTON_PERIOD - 1] {
            assert_eq!(
                halton_index(255, 728, i),
                halton_index(255, 728, i + HALTON_PERIOD)
            );
        }
        let widest =
            u64::from(HALTON_STRIDE - 1) + u64::from(HALTON_PERIOD - 1) * u64::from(HALTON_STRIDE);
        assert!(widest <= u64::from(u32::MAX));
    }

    #[test]
    fn no_coordinate_reaches_one() {
        for base in HALTON_PRIMES {
            for index in [u32::MAX, u32::MAX - 1, 294_500_312, 3_486_785_458] {
                let u = halton_radical_inverse(base, index);
                assert!((0.0..1.0).contains(&u), "base {base}, index {index}: {u}");
            }
        }
    }

    #[test]
    fn no_argument_panics() {
        let _ = halton_init(u32::MAX, u32::MAX, 5, 0, u32::MAX, 0);
        let _ = halton_next(HaltonState {
            dimension: u32::MAX,
            index: u32::MAX,
        });
    }
}
