//! PCG hashes: integers in, integers out, the same bits everywhere.
//!
//! Source: Jarzynski and Olano, *Hash Functions for GPU Rendering*, JCGT 9(3),
//! 2020 (`pcg2d`, `pcg3d`, `pcg4d`, listings in section 4); O'Neill, *PCG: A
//! Family of Simple Fast Space-Efficient Statistically Good Algorithms* (2014)
//! for the permutation RXS-M-XS behind `pcg_hash`.

use glam::{UVec2, UVec3, UVec4};

/// One word to one word, a bijection.
///
/// Outputs from the advanced state: `pcg_hash(0)` is `0x07bb2fe2`.
///
/// ```
/// use raytwin_cpu::random::pcg::pcg_hash;
///
/// assert_eq!(pcg_hash(0), 0x07bb_2fe2);
/// assert_ne!(pcg_hash(1), pcg_hash(2));
/// ```
#[inline]
#[must_use]
pub fn pcg_hash(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Two words to two words, a bijection.
///
/// ```
/// use glam::{UVec2, Vec2};
/// use raytwin_cpu::random::pcg::{pcg_unit, pcg2d};
///
/// // Two random numbers for a pixel, without a state.
/// let bits = pcg2d(UVec2::new(3, 5));
/// let u = Vec2::new(pcg_unit(bits.x), pcg_unit(bits.y));
/// assert!(u.min_element() >= 0.0 && u.max_element() < 1.0);
/// assert_ne!(bits, pcg2d(UVec2::new(5, 3)));
/// ```
#[inline]
#[must_use]
pub fn pcg2d(v: UVec2) -> UVec2 {
    let mut x = v.x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut y = v.y.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    x = x.wrapping_add(y.wrapping_mul(1_664_525));
    y = y.wrapping_add(x.wrapping_mul(1_664_525));
    x ^= x >> 16;
    y ^= y >> 16;
    x = x.wrapping_add(y.wrapping_mul(1_664_525));
    y = y.wrapping_add(x.wrapping_mul(1_664_525));
    x ^= x >> 16;
    y ^= y >> 16;
    UVec2::new(x, y)
}

/// Three words to three words, a bijection.
///
/// ```
/// use glam::UVec3;
/// use raytwin_cpu::random::pcg::pcg3d;
///
/// // Pixel and frame in, three random words out.
/// let bits = pcg3d(UVec3::new(1, 2, 3));
/// assert_eq!(bits, UVec3::new(0xfa9f_79a6, 0x48f2_f44c, 0x596f_5ab1));
/// ```
#[inline]
#[must_use]
pub fn pcg3d(v: UVec3) -> UVec3 {
    let mut x = v.x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut y = v.y.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut z = v.z.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    x = x.wrapping_add(y.wrapping_mul(z));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    x ^= x >> 16;
    y ^= y >> 16;
    z ^= z >> 16;
    x = x.wrapping_add(y.wrapping_mul(z));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    UVec3::new(x, y, z)
}

/// Four words to four words, a bijection.
///
/// ```
/// use glam::UVec4;
/// use raytwin_cpu::random::pcg::pcg4d;
///
/// // Pixel, frame and bounce in, four random words out.
/// let bits = pcg4d(UVec4::new(3, 5, 7, 0));
/// assert_ne!(bits, pcg4d(UVec4::new(3, 5, 7, 1)));
/// ```
#[inline]
#[must_use]
pub fn pcg4d(v: UVec4) -> UVec4 {
    let mut x = v.x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut y = v.y.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut z = v.z.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut w = v.w.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    x ^= x >> 16;
    y ^= y >> 16;
    z ^= z >> 16;
    w ^= w >> 16;
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    UVec4::new(x, y, z, w)
}

/// A generator's state after a draw, and what it drew.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::random::pcg::{pcg_next, pcg_seed};
///
/// let first = pcg_next(pcg_seed(UVec2::new(3, 5), 7));
/// let second = pcg_next(first.state);
/// assert_ne!(first.value, second.value);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PcgDraw {
    /// State to pass to the next [`pcg_next`].
    pub state: u32,
    /// 32 random bits.
    pub value: u32,
}

/// Seed for one pixel in one frame: neighbours and successors are unrelated.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::random::pcg::pcg_seed;
///
/// let pixel = UVec2::new(3, 5);
/// assert_eq!(pcg_seed(pixel, 7), pcg_seed(pixel, 7));
/// assert_ne!(pcg_seed(pixel, 7), pcg_seed(pixel, 8));
/// ```
#[inline]
#[must_use]
pub fn pcg_seed(pixel: UVec2, frame: u32) -> u32 {
    pcg3d(UVec3::new(pixel.x, pixel.y, frame)).x
}

/// Draws 32 bits and advances the state (period 2^32).
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::random::pcg::{pcg_next, pcg_seed, pcg_unit};
///
/// // The mean of many draws is near a half.
/// let mut state = pcg_seed(UVec2::new(3, 5), 7);
/// let mut sum = 0.0;
/// for _ in 0..1000 {
///     let draw = pcg_next(state);
///     state = draw.state;
///     sum += pcg_unit(draw.value);
/// }
/// assert!((sum / 1000.0 - 0.5).abs() < 0.05);
/// ```
#[inline]
#[must_use]
pub fn pcg_next(state: u32) -> PcgDraw {
    PcgDraw {
        state: state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453),
        value: pcg_hash(state),
    }
}

/// Random bits to a number in `[0, 1)`: the top 24 bits over 2^24.
///
/// Exact, so the largest value is `1 - 2^-24` and `1 - u` is exact and never
/// zero. (Dividing all 32 bits by 2^32 gives 1.0 for 128 inputs.)
///
/// ```
/// use raytwin_cpu::random::pcg::pcg_unit;
///
/// assert_eq!(pcg_unit(0), 0.0);
/// assert_eq!(pcg_unit(1 << 31), 0.5);
/// assert!(pcg_unit(u32::MAX) < 1.0);
/// ```
#[inline]
#[must_use]
pub fn pcg_unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_values() {
        assert_eq!(pcg_hash(0), 0x07bb_2fe2);
        assert_eq!(pcg_hash(1), 0xa8be_ea3c);
        assert_eq!(pcg_hash(2), 0x7a7e_cc88);
        assert_eq!(pcg_hash(0xffff_ffff), 0xe62a_4902);
        assert_eq!(
            pcg3d(UVec3::ZERO),
            UVec3::new(0x9baf_d7c6, 0xa8e8_8a6b, 0x3f15_482c)
        );
        assert_eq!(
            pcg3d(UVec3::new(1, 2, 3)),
            UVec3::new(0xfa9f_79a6, 0x48f2_f44c, 0x596f_5ab1)
        );
        assert_eq!(
            pcg4d(UVec4::ZERO),
            UVec4::new(0x0f02_f829, 0x2d56_8769, 0x32b0_c43b, 0xd325_48ea)
        );
        assert_eq!(
            pcg4d(UVec4::new(1, 2, 3, 4)),
            UVec4::new(0x3622_cd16, 0xf114_71d8, 0xe110_9b3f, 0x02b9_4c2f)
        );
    }

    #[test]
    fn unit_never_reaches_one() {
        assert_eq!(pcg_unit(0), 0.0);
        assert_eq!(pcg_unit(u32::MAX), 1.0 - f32::EPSILON / 2.0);
    }
}
