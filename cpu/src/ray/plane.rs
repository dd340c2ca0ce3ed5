//! Ray against plane.

use glam::Vec3;

use super::ray::Ray;
use crate::math::vector::vec3_dot;

/// Smallest denominator that the divisions of this group accept: 2^-120.
pub(crate) const PLANE_TINY: f32 = f32::from_bits((127 - 120) << 23);

/// Largest quotient that the divisions of this group give is below 2^100.
pub(crate) const PLANE_RATIO: f32 = f32::from_bits((127 - 100) << 23);

/// Where a ray meets a plane.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::plane::{PlaneHit, plane_intersect};
/// use raytwin_cpu::ray::ray::Ray;
///
/// let away =
///     Ray { origin: Vec3::Y, direction: Vec3::Y, t_min: 0.0, t_max: 9.0 };
/// let hit = plane_intersect(away, Vec3::ZERO, Vec3::Y);
/// assert_eq!(hit, PlaneHit { hit: 0, t: 0.0 });
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct PlaneHit {
    /// 1 if the ray meets the plane within its range, else 0.
    pub hit: u32,
    /// The ray's parameter there; 0 on a miss.
    pub t: f32,
}

/// 1 if `numerator / denominator` is safe: the denominator is a normal number
/// above 2^-120 and the quotient is below 2^100.
#[inline]
pub(super) fn plane_divides(numerator: f32, denominator: f32) -> bool {
    let size = denominator.abs();
    size > numerator.abs() * PLANE_RATIO && size > PLANE_TINY
}

/// Ray against the plane through `point` with the given normal, of any length.
///
/// `t = n·(p - o) / n·d`. A point near the ray makes the numerator small
/// without cancellation; an offset from the world's origin would not. Error:
/// with `u = 2^-24`, `|dt| <= 4u (|n|·|p - o| + |t| |n|·|d|) / |n·d|`, where
/// `|a|·|b|` is the sum of products of absolute values: it grows as the ray
/// gets parallel to the plane. A ray with `|n·d| <= 2^-120` misses.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::plane::plane_intersect;
/// use raytwin_cpu::ray::ray::{Ray, ray_at};
///
/// // From height 3 down at 45 degrees to the floor.
/// let ray = Ray {
///     origin: Vec3::new(0.0, 3.0, 0.0),
///     direction: Vec3::new(1.0, -1.0, 0.0),
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit = plane_intersect(ray, Vec3::ZERO, Vec3::Y);
/// assert_eq!((hit.hit, ray_at(ray, hit.t)), (1, Vec3::new(3.0, 0.0, 0.0)));
/// ```
#[inline]
#[must_use]
pub fn plane_intersect(ray: Ray, point: Vec3, normal: Vec3) -> PlaneHit {
    let numerator = vec3_dot(normal, point - ray.origin);
    let denominator = vec3_dot(normal, ray.direction);
    let divides = plane_divides(numerator, denominator);
    let t = numerator / if divides { denominator } else { 1.0 };
    if divides && t >= ray.t_min && t <= ray.t_max {
        PlaneHit { hit: 1, t }
    } else {
        PlaneHit { hit: 0, t: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(direction: Vec3) -> Ray {
        Ray {
            origin: Vec3::new(0.0, 2.0, 0.0),
            direction,
            t_min: 0.0,
            t_max: 10.0,
        }
    }

    #[test]
    fn hits_from_both_sides() {
        for n in [Vec3::Y, -Vec3::Y, Vec3::Y * 1e-6, Vec3::Y * 1e6] {
            let h = plane_intersect(ray(Vec3::new(1.0, -0.5, 0.0)), Vec3::X * 7.0, n);
            assert_eq!((h.hit, h.t), (1, 4.0));
        }
    }

    #[test]
    fn parallel_behind_and_beyond_miss() {
        for d in [Vec3::X, Vec3::Y, Vec3::Y * -0.1, Vec3::new(1.0, -0.0, 1.0)] {
            assert_eq!(plane_intersect(ray(d), Vec3::ZERO, Vec3::Y).hit, 0, "{d}");
        }
    }

    #[test]
    fn range_ends_hit() {
        let mut r = ray(-Vec3::Y);
        r.t_max = 2.0;
        assert_eq!(plane_intersect(r, Vec3::ZERO, Vec3::Y).hit, 1);
        r.t_min = 2.0;
        assert_eq!(plane_intersect(r, Vec3::ZERO, Vec3::Y).t, 2.0);
        r.t_min = 2.0f32.next_up();
        assert_eq!(plane_intersect(r, Vec3::ZERO, Vec3::Y).hit, 0);
    }
}
