//! Ray against axis-aligned box.

use glam::{Vec2, Vec3};

use super::ray::{RAY_FAR, Ray, RayShear, ray_shear};

/// The far plane moves out by this factor, `1 + 2^-18`: more than the rounding
/// of both planes and of the shear in the triangle test together.
pub const AABB_WIDEN: f32 = 1.0 + 1.0 / 262_144.0;

/// Where a ray is inside a box.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::aabb::aabb_intersect;
/// use raytwin_cpu::ray::ray::Ray;
///
/// let ray =
///     Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min: 0.0, t_max: 9.0 };
/// // From inside, the ray enters at its own start.
/// let hit = aabb_intersect(ray, Vec3::NEG_ONE, Vec3::ONE);
/// assert_eq!((hit.hit, hit.t_near), (1, 0.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct AabbHit {
    /// 1 if the ray touches the box within its range, else 0.
    pub hit: u32,
    /// Where it enters, not below the ray's `t_min`; 0 on a miss.
    pub t_near: f32,
    /// Where it leaves, not above the ray's `t_max`; 0 on a miss.
    pub t_far: f32,
}

/// The smaller number; the first if they are equal.
#[inline(always)]
pub(super) fn aabb_min(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// The larger number; the first if they are equal.
#[inline(always)]
pub(super) fn aabb_max(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// The interval of a slab parallel to the ray: everything or nothing.
#[inline(always)]
fn aabb_parallel(lower: f32, upper: f32, direction: f32, through: Vec2) -> Vec2 {
    let inside = lower <= 0.0 && upper >= 0.0;
    let far = if inside { RAY_FAR } else { -RAY_FAR };
    if direction == 0.0 {
        Vec2::new(-far, far)
    } else {
        through
    }
}

/// The interval `(near, far)` of `t` in which the ray's line is inside a box,
/// given the box's corners minus the ray's origin.
///
/// The line meets the box where `near <= far · AABB_WIDEN + slack`; near may
/// be above far by rounding, or far by far on a miss. A direction component of
/// zero makes its slab a containment test, both ends included.
///
/// Every step is monotone in the corners, also after rounding: a box inside
/// another never has the smaller near or the larger far. Traversal relies on
/// that, see [`bvh`](super::bvh).
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::aabb::aabb_slab_local;
/// use raytwin_cpu::ray::ray::{Ray, ray_shear};
///
/// let ray = Ray {
///     origin: Vec3::new(0.5, 0.5, -2.0),
///     direction: Vec3::Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// // The corners of the unit cube, as seen from the origin of the ray.
/// let lower = Vec3::ZERO - ray.origin;
/// let upper = Vec3::ONE - ray.origin;
/// let slab = aabb_slab_local(lower, upper, &ray_shear(ray));
/// assert_eq!(slab, Vec2::new(2.0, 3.0));
/// ```
#[inline(always)]
#[must_use]
pub fn aabb_slab_local(lower: Vec3, upper: Vec3, shear: &RayShear) -> Vec2 {
    let ax = lower.x * shear.inverse.x;
    let ay = lower.y * shear.inverse.y;
    let az = lower.z * shear.inverse.z;
    let bx = upper.x * shear.inverse.x;
    let by = upper.y * shear.inverse.y;
    let bz = upper.z * shear.inverse.z;
    let mut x = Vec2::new(aabb_min(ax, bx), aabb_max(ax, bx));
    let mut y = Vec2::new(aabb_min(ay, by), aabb_max(ay, by));
    let mut z = Vec2::new(aabb_min(az, bz), aabb_max(az, bz));
    if shear.parallel != 0 {
        x = aabb_parallel(lower.x, upper.x, shear.direction.x, x);
        y = aabb_parallel(lower.y, upper.y, shear.direction.y, y);
        z = aabb_parallel(lower.z, upper.z, shear.direction.z, z);
    }
    Vec2::new(
        aabb_max(aabb_max(x.x, y.x), z.x),
        aabb_min(aabb_min(x.y, y.y), z.y),
    )
}

/// [`aabb_slab_local`] for a box given by its corners.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::aabb::aabb_slab;
/// use raytwin_cpu::ray::ray::{Ray, ray_shear};
///
/// let ray = Ray {
///     origin: Vec3::new(0.5, 0.5, -2.0),
///     direction: Vec3::Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let slab = aabb_slab(Vec3::ZERO, Vec3::ONE, &ray_shear(ray));
/// assert_eq!(slab, Vec2::new(2.0, 3.0));
/// ```
#[inline(always)]
#[must_use]
pub fn aabb_slab(box_min: Vec3, box_max: Vec3, shear: &RayShear) -> Vec2 {
    aabb_slab_local(box_min - shear.origin, box_max - shear.origin, shear)
}

/// Ray against a box; the box and the ray's range include their ends.
///
/// Never misses a box that the exact line touches within the range, whatever
/// the direction of rounding and with subnormals flushed; may report a box
/// that the line passes by less than 2^-18 of the distance. After Ize: Robust
/// BVH Ray Traversal, JCGT 2(2), 2013, with the margin derived anew.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::aabb::aabb_intersect;
/// use raytwin_cpu::ray::ray::Ray;
///
/// let ray = Ray {
///     origin: Vec3::new(0.5, 0.5, -2.0),
///     direction: Vec3::Z,
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let hit = aabb_intersect(ray, Vec3::ZERO, Vec3::ONE);
/// assert_eq!((hit.hit, hit.t_near), (1, 2.0));
/// // A box beside the ray is missed.
/// assert_eq!(aabb_intersect(ray, Vec3::ONE, 2.0 * Vec3::ONE).hit, 0);
/// ```
#[inline]
#[must_use]
pub fn aabb_intersect(ray: Ray, box_min: Vec3, box_max: Vec3) -> AabbHit {
    let shear = ray_shear(ray);
    let slab = aabb_slab(box_min, box_max, &shear);
    let far = slab.y * AABB_WIDEN + shear.slack;
    let t_near = aabb_max(slab.x, ray.t_min);
    let t_far = aabb_min(far, ray.t_max);
    if t_near <= t_far {
        AabbHit {
            hit: 1,
            t_near,
            t_far,
        }
    } else {
        AabbHit {
            hit: 0,
            t_near: 0.0,
            t_far: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(origin: [f32; 3], direction: [f32; 3], t_min: f32, t_max: f32) -> AabbHit {
        aabb_intersect(
            Ray {
                origin: origin.into(),
                direction: direction.into(),
                t_min,
                t_max,
            },
            Vec3::splat(-1.0),
            Vec3::splat(1.0),
        )
    }

    #[test]
    fn enters_and_leaves() {
        let h = hit([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0, 100.0);
        assert_eq!((h.hit, h.t_near), (1, 2.0));
        assert!((h.t_far - 4.0).abs() <= 4.0 * 4e-6);
        assert_eq!(hit([-3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], 0.0, 100.0).hit, 0);
    }

    #[test]
    fn faces_are_inside() {
        for zero in [0.0, -0.0] {
            for face in [-1.0, 1.0] {
                assert_eq!(hit([face, -3.0, 0.5], [zero, 1.0, zero], 0.0, 9.0).hit, 1);
            }
            let out = 1.0f32.next_up();
            assert_eq!(hit([out, -3.0, 0.5], [zero, 1.0, zero], 0.0, 9.0).hit, 0);
        }
    }

    #[test]
    fn ends_of_the_range_are_inside() {
        assert_eq!(hit([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0, 2.0).hit, 1);
        assert_eq!(
            hit([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0, 2.0f32.next_down()).hit,
            0
        );
        assert_eq!(hit([-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], 4.0, 9.0).hit, 1);
        assert_eq!(hit([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], 0.0, 0.0).hit, 1);
    }

    #[test]
    fn corner_to_corner() {
        for d in [[1.0, 1.0, 1.0], [1e-10; 3], [1e10; 3]] {
            let h = hit([-3.0, -3.0, -3.0], d, 0.0, f32::MAX);
            assert_eq!(h.hit, 1, "{d:?}");
            // Through one edge only.
            assert_eq!(
                hit([-3.0, -1.0, -1.0], [d[0], 0.0, 0.0], 0.0, f32::MAX).hit,
                1
            );
            assert_eq!(
                hit([-2.0, 0.0, 0.0], [d[0], d[0], 0.0], 0.0, f32::MAX).hit,
                1
            );
        }
    }

    #[test]
    fn subnormal_boxes_are_hit() {
        let tiny = f32::from_bits(3);
        let ray = Ray {
            origin: Vec3::ZERO,
            direction: Vec3::new(1.0, 1e-3, 1e-10),
            t_min: 0.0,
            t_max: f32::MAX,
        };
        let max = Vec3::new(1.2e-38, tiny, tiny);
        assert_eq!(
            aabb_intersect(ray, Vec3::new(1.1e-38, 0.0, 0.0), max).hit,
            1
        );
    }
}
