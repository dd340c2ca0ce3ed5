//! An orthonormal basis around a normal, without a branch or a square root.
//!
//! Source: Duff et al., *Building an Orthonormal Basis, Revisited*, JCGT 6(1),
//! 2017, listing 3, with a comparison in the place of `copysign`: WGSL has none
//! and may ignore the sign of a zero, so -0 counts as positive in both twins.

use glam::Vec3;

/// Two unit vectors that make a right-handed basis with the normal:
/// `tangent × bitangent = normal`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::basis::basis_from_normal;
///
/// let normal = Vec3::new(0.48, 0.6, 0.64);
/// let frame = basis_from_normal(normal);
/// let cross = frame.tangent.cross(frame.bitangent);
/// assert!((cross - normal).length() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BasisFrame {
    /// The basis' x axis.
    pub tangent: Vec3,
    /// The basis' y axis.
    pub bitangent: Vec3,
}

/// The basis whose z axis is the unit vector `n`.
///
/// Exact on the axes, at `n.z = -1` and at `n.z = -0` too.
///
/// Error analysis: `sign + n.z` is at least 1 in size, so the one division is
/// well conditioned; every component is within a few 2^-24 of the exact basis
/// of the given `n` (one division, three products, one sum).
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::basis::basis_from_normal;
///
/// let frame = basis_from_normal(Vec3::Z);
/// assert_eq!((frame.tangent, frame.bitangent), (Vec3::X, Vec3::Y));
/// // The lower pole is no special case.
/// let below = basis_from_normal(Vec3::NEG_Z);
/// assert_eq!(below.tangent.cross(below.bitangent), Vec3::NEG_Z);
/// ```
#[inline]
#[must_use]
pub fn basis_from_normal(n: Vec3) -> BasisFrame {
    let sign = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let a = -1.0 / (sign + n.z);
    let b = (n.x * n.y) * a;
    BasisFrame {
        tangent: Vec3::new(1.0 + (sign * n.x) * (n.x * a), sign * b, -sign * n.x),
        bitangent: Vec3::new(b, sign + n.y * (n.y * a), -n.y),
    }
}

/// From the basis' coordinates to the world: `v.x·tangent + v.y·bitangent + v.z·n`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_world};
///
/// let normal = Vec3::new(0.48, 0.6, 0.64);
/// let frame = basis_from_normal(normal);
/// // The frame's z axis is the normal.
/// assert_eq!(basis_to_world(frame, normal, Vec3::Z), normal);
/// ```
#[inline]
#[must_use]
pub fn basis_to_world(frame: BasisFrame, n: Vec3, v: Vec3) -> Vec3 {
    Vec3::new(
        (v.x * frame.tangent.x + v.y * frame.bitangent.x) + v.z * n.x,
        (v.x * frame.tangent.y + v.y * frame.bitangent.y) + v.z * n.y,
        (v.x * frame.tangent.z + v.y * frame.bitangent.z) + v.z * n.z,
    )
}

/// From the world to the basis' coordinates: the three dot products.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::basis::{
///     basis_from_normal, basis_to_local, basis_to_world,
/// };
///
/// let normal = Vec3::new(0.48, 0.6, 0.64);
/// let frame = basis_from_normal(normal);
/// let v = Vec3::new(1.0, 2.0, 3.0);
/// let back = basis_to_world(frame, normal, basis_to_local(frame, normal, v));
/// assert!((back - v).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn basis_to_local(frame: BasisFrame, n: Vec3, v: Vec3) -> Vec3 {
    let t = frame.tangent;
    let b = frame.bitangent;
    Vec3::new(
        (v.x * t.x + v.y * t.y) + v.z * t.z,
        (v.x * b.x + v.y * b.y) + v.z * b.z,
        (v.x * n.x + v.y * n.y) + v.z * n.z,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poles_are_exact() {
        let up = basis_from_normal(Vec3::Z);
        assert_eq!((up.tangent, up.bitangent), (Vec3::X, Vec3::Y));
        let down = basis_from_normal(-Vec3::Z);
        assert_eq!((down.tangent, down.bitangent), (Vec3::X, -Vec3::Y));
        for z in [0.0, -0.0] {
            let side = basis_from_normal(Vec3::new(1.0, 0.0, z));
            assert_eq!((side.tangent, side.bitangent), (-Vec3::Z, Vec3::Y));
        }
    }
}
