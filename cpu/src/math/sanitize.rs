//! Keeping NaN and infinity out of buffers, by bit pattern.
//!
//! WGSL lets an implementation assume that NaN and infinity do not occur, and
//! both software drivers fold `x != x` to false. A test on the bits survives.

use glam::Vec3;

/// 1 if the bits are those of a finite `f32`, else 0 (NaN or infinity).
///
/// ```
/// use raytwin_cpu::math::sanitize::finite_bits;
///
/// assert_eq!(finite_bits(1.5_f32.to_bits()), 1);
/// assert_eq!(finite_bits(f32::INFINITY.to_bits()), 0);
/// assert_eq!(finite_bits(f32::NAN.to_bits()), 0);
/// ```
#[inline]
#[must_use]
pub fn finite_bits(bits: u32) -> u32 {
    u32::from((bits & 0x7f80_0000) != 0x7f80_0000)
}

/// The number behind `bits`, or `fallback` if that is NaN or infinite.
///
/// Takes bits so that no NaN ever exists as an `f32`: read the buffer as
/// `u32`. Exact.
///
/// ```
/// use raytwin_cpu::math::sanitize::sanitize_bits;
///
/// assert_eq!(sanitize_bits(1.5_f32.to_bits(), 0.0), 1.5);
/// assert_eq!(sanitize_bits(f32::NAN.to_bits(), 0.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn sanitize_bits(bits: u32, fallback: f32) -> f32 {
    if finite_bits(bits) == 0 {
        return fallback;
    }
    f32::from_bits(bits)
}

/// `x`, or `fallback` if `x` is NaN or infinite. Exact.
///
/// ```
/// use raytwin_cpu::math::sanitize::sanitize_finite;
///
/// assert_eq!(sanitize_finite(1.5, 0.0), 1.5);
/// assert_eq!(sanitize_finite(1.0 / 0.0, 0.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn sanitize_finite(x: f32, fallback: f32) -> f32 {
    sanitize_bits(x.to_bits(), fallback)
}

/// `v`, or `fallback` if any component of `v` is NaN or infinite: half a
/// colour is no colour. Exact.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::sanitize::sanitize_vector;
///
/// let colour = Vec3::new(1.0, f32::NAN, 2.0);
/// assert_eq!(sanitize_vector(colour, Vec3::ZERO), Vec3::ZERO);
/// assert_eq!(sanitize_vector(Vec3::ONE, Vec3::ZERO), Vec3::ONE);
/// ```
#[inline]
#[must_use]
pub fn sanitize_vector(v: Vec3, fallback: Vec3) -> Vec3 {
    if (finite_bits(v.x.to_bits()) & finite_bits(v.y.to_bits()) & finite_bits(v.z.to_bits())) == 0 {
        return fallback;
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_only_what_is_not_finite() {
        assert_eq!(sanitize_finite(f32::NAN, 3.0), 3.0);
        assert_eq!(sanitize_finite(f32::NEG_INFINITY, 3.0), 3.0);
        assert_eq!(sanitize_finite(f32::MAX, 3.0), f32::MAX);
        assert_eq!(
            sanitize_vector(Vec3::new(1.0, f32::INFINITY, 2.0), Vec3::ZERO),
            Vec3::ZERO
        );
    }
}
