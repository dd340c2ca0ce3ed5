//! Keeping NaN and infinity out of buffers, by bit pattern.
//!
//! WGSL lets an implementation assume that NaN and infinity do not occur, and
//! both software drivers fold `x != x` to false. A test on the bits survives.

use glam::Vec3;

/// Bits of 2^60, from where on [`usable_surface`] takes a number for none: what is
/// below it, squared and summed, stays finite.
pub const USABLE_BITS: u32 = 0x5d80_0000;

/// Bits of 2, from where on it takes a normal for none.
pub const USABLE_NORMAL_BITS: u32 = 0x4000_0000;

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

/// The bits of the component that is largest in size, without its sign: ordered
/// like the sizes, infinity above all numbers, NaN above infinity. Exact.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::sanitize::magnitude_bits;
///
/// assert_eq!(magnitude_bits(Vec3::new(1.0, -3.0, 2.0)), 3.0_f32.to_bits());
/// assert!(magnitude_bits(Vec3::new(1.0, f32::NAN, 2.0)) > f32::INFINITY.to_bits());
/// ```
#[inline]
#[must_use]
pub fn magnitude_bits(v: Vec3) -> u32 {
    let x = v.x.to_bits() & 0x7fff_ffff;
    let y = v.y.to_bits() & 0x7fff_ffff;
    let z = v.z.to_bits() & 0x7fff_ffff;
    x.max(y).max(z)
}

/// 1 if a pixel has a surface whose numbers are ones, else 0: the position below
/// 2^60 in size, the normal below 2, and `scale` (a depth, a reach, a weight; 0
/// says that there is no surface) above 0 and below 2^60. Exact.
///
/// By bits, since a comparison with a NaN is false either way round, and WGSL
/// lets an implementation assume that there is none.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::sanitize::usable_surface;
///
/// assert_eq!(usable_surface(Vec3::ONE, Vec3::Z, 0.1), 1);
/// assert_eq!(usable_surface(Vec3::ONE, Vec3::Z, 0.0), 0);
/// assert_eq!(usable_surface(Vec3::splat(f32::NAN), Vec3::Z, 0.1), 0);
/// ```
#[inline]
#[must_use]
pub fn usable_surface(position: Vec3, normal: Vec3, scale: f32) -> u32 {
    let bits = scale.to_bits();
    u32::from(magnitude_bits(position) < USABLE_BITS)
        & u32::from(magnitude_bits(normal) < USABLE_NORMAL_BITS)
        & u32::from(bits > 0)
        & u32::from(bits < USABLE_BITS)
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
