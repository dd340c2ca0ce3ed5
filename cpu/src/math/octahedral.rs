//! Unit vectors as two numbers: the octahedral map.
//!
//! Source: Cigolle et al., *A Survey of Efficient Representations for
//! Independent Unit Vectors*, JCGT 3(2), 2014.

use glam::{Vec2, Vec3};

use super::vector::vec3_normalize;

/// 1/32767.
const OCTAHEDRAL_SNORM: f32 = 3.051_850_9e-5;

/// Maps a direction to the square `[-1, 1]²`.
///
/// `n` need not be of unit length, but must not be zero and its components
/// must stay below 1e37. The upper half (`z >= 0`) fills the inner diamond.
///
/// Error analysis: a sum of three sizes (2 ULP), one division (2.5 ULP in
/// WGSL) and, in the lower half, one subtraction from 1 that adds an absolute
/// half ULP of 1: a few 2^-24 absolute.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::math::octahedral::{octahedral_decode, octahedral_encode};
///
/// assert_eq!(octahedral_encode(Vec3::Z), Vec2::ZERO);
/// let n = Vec3::new(0.48, -0.6, -0.64);
/// let back = octahedral_decode(octahedral_encode(n));
/// assert!((back - n).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn octahedral_encode(n: Vec3) -> Vec2 {
    let sum = (n.x.abs() + n.y.abs()) + n.z.abs();
    let x = n.x / sum;
    let y = n.y / sum;
    if n.z >= 0.0 {
        return Vec2::new(x, y);
    }
    // Fold the lower half outward; a zero folds to the positive side, so that
    // -0 and 0 (which WGSL need not tell apart) give one answer.
    let fold_x = 1.0 - y.abs();
    let fold_y = 1.0 - x.abs();
    Vec2::new(
        if x >= 0.0 { fold_x } else { -fold_x },
        if y >= 0.0 { fold_y } else { -fold_y },
    )
}

/// Maps a point of the square `[-1, 1]²` back to the unit vector.
///
/// Error analysis: before normalisation each component is exact to an
/// absolute 2^-24 or so and the vector is at least 1/√3 long, so each
/// component of the result is within a few 2^-24.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::math::octahedral::octahedral_decode;
///
/// assert_eq!(octahedral_decode(Vec2::ZERO), Vec3::Z);
/// // The square's corners all are the lower pole.
/// assert_eq!(octahedral_decode(Vec2::ONE), Vec3::NEG_Z);
/// ```
#[inline]
#[must_use]
pub fn octahedral_decode(p: Vec2) -> Vec3 {
    let z = 1.0 - (p.x.abs() + p.y.abs());
    let t = (-z).max(0.0);
    vec3_normalize(Vec3::new(
        p.x + if p.x >= 0.0 { -t } else { t },
        p.y + if p.y >= 0.0 { -t } else { t },
        z,
    ))
}

/// [`octahedral_decode`] of two 16-bit snorms, `x` in the low half: what WGSL's
/// `pack2x16snorm(octahedral_encode(n))` gives.
///
/// WGSL's own `unpack2x16snorm` may be rounded as the implementation likes; this
/// is the same everywhere but for the normalisation. -32768 counts as -32767.
///
/// Error analysis: a product with a rounded constant, 1 ULP, which the vector's
/// length before it is normalised (1/√3 at least) can make 1.7 of the result;
/// then that of [`octahedral_decode`].
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::octahedral::octahedral_unpack;
///
/// // x in the low half, y in the high one, as snorm: (1, 0) is the x axis.
/// assert_eq!(octahedral_unpack(0x0000_7fff), Vec3::X);
/// assert_eq!(octahedral_unpack(0x8001_0000), Vec3::NEG_Y);
/// ```
#[inline]
#[must_use]
pub fn octahedral_unpack(bits: u32) -> Vec3 {
    let x = (((bits & 0xffff) ^ 0x8000) as f32 - 32768.0) * OCTAHEDRAL_SNORM;
    let y = (((bits >> 16) ^ 0x8000) as f32 - 32768.0) * OCTAHEDRAL_SNORM;
    octahedral_decode(Vec2::new(x.clamp(-1.0, 1.0), y.clamp(-1.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_round_trip() {
        for v in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert_eq!(octahedral_decode(octahedral_encode(v)), v);
        }
    }
}
