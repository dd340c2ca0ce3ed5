//! Three-component products in one fixed order.
//!
//! glam's `dot`, `cross` and `normalize` pick fused multiply-adds when the
//! target has them, and WGSL's built-ins may be rewritten by a driver. Twins
//! that must give the same bits spell the order out instead.

use glam::Vec3;

/// Dot product, summed as `(x·x + y·y) + z·z`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::vector::vec3_dot;
///
/// assert_eq!(
///     vec3_dot(Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 5.0, 6.0)),
///     32.0
/// );
/// assert_eq!(vec3_dot(Vec3::X, Vec3::Y), 0.0);
/// ```
#[inline]
#[must_use]
pub fn vec3_dot(a: Vec3, b: Vec3) -> f32 {
    (a.x * b.x + a.y * b.y) + a.z * b.z
}

/// Cross product, each component a difference of two products.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::vector::vec3_cross;
///
/// assert_eq!(vec3_cross(Vec3::X, Vec3::Y), Vec3::Z);
/// assert_eq!(vec3_cross(Vec3::Y, Vec3::X), Vec3::NEG_Z);
/// ```
#[inline]
#[must_use]
pub fn vec3_cross(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(
        a.y * b.z - a.z * b.y,
        a.z * b.x - a.x * b.z,
        a.x * b.y - a.y * b.x,
    )
}

/// Euclidean length. Overflows above about 1.8e19 and underflows below 1e-19.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::vector::vec3_length;
///
/// assert_eq!(vec3_length(Vec3::new(2.0, 3.0, 6.0)), 7.0);
/// ```
#[inline]
#[must_use]
pub fn vec3_length(a: Vec3) -> f32 {
    vec3_dot(a, a).sqrt()
}

/// Unit vector in the direction of `a`, each component divided by the length.
///
/// `a` must have a length between 1e-18 and 1e18; the zero vector has no
/// direction and is the caller's to exclude.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::math::vector::{vec3_length, vec3_normalize};
///
/// assert_eq!(vec3_normalize(Vec3::new(0.0, -8.0, 0.0)), Vec3::NEG_Y);
/// let n = vec3_normalize(Vec3::new(1.0, 2.0, 3.0));
/// assert!((vec3_length(n) - 1.0).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn vec3_normalize(a: Vec3) -> Vec3 {
    let len = vec3_length(a);
    Vec3::new(a.x / len, a.y / len, a.z / len)
}
