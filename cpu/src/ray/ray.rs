//! The ray and what is computed once for each ray.

use glam::{Vec2, Vec3};

/// Direction components smaller than this, 2^-80, count as zero.
pub const RAY_FLUSH: f32 = f32::from_bits((127 - 80) << 23);

/// A stand-in for infinity that arithmetic may touch: 2^126.
pub const RAY_FAR: f32 = f32::from_bits((127 + 126) << 23);

/// Largest rounding-independent shift of a slab, in units of `1 / direction`:
/// 2^-124, which is four times the smallest normal number.
pub const RAY_SLACK: f32 = f32::from_bits((127 - 124) << 23);

/// Points `origin + direction · t` with `t_min <= t <= t_max`.
///
/// Ranges in which every statement about these kernels holds: coordinates up
/// to 2^39 (5.5e11), the largest direction component between 2^-40 and 2^40,
/// `0 <= t_min <= t_max`, all finite.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::{Ray, ray_at};
///
/// // A shadow ray toward a lamp: `t` runs from the surface (0) to the lamp (1).
/// let (point, lamp) = (Vec3::ZERO, Vec3::new(1.0, 4.0, 2.0));
/// let ray = Ray {
///     origin: point,
///     direction: lamp - point,
///     t_min: 1e-3,
///     t_max: 1.0 - 1e-3,
/// };
/// assert_eq!(ray_at(ray, 1.0), lamp);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Where `t` is zero.
    pub origin: Vec3,
    /// Any length but zero.
    pub direction: Vec3,
    /// Smallest accepted `t`, itself accepted.
    pub t_min: f32,
    /// Largest accepted `t`, itself accepted; `f32::MAX` for no limit.
    pub t_max: f32,
}

/// What the box and triangle tests need of a ray, computed once by
/// [`ray_shear`].
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::{Ray, ray_shear};
///
/// let ray = Ray {
///     origin: Vec3::ZERO,
///     direction: Vec3::new(1.0, 0.0, -4.0),
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let shear = ray_shear(ray);
/// assert_eq!(shear.axis, 2);
/// assert_eq!(shear.inverse, Vec3::new(1.0, 0.0, -0.25));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct RayShear {
    /// The ray's origin.
    pub origin: Vec3,
    /// The ray's direction, components below [`RAY_FLUSH`] set to zero.
    pub direction: Vec3,
    /// Reciprocal of each component of `direction`; 0 where that is zero.
    pub inverse: Vec3,
    /// The two other components of the direction over the largest one, in
    /// cyclic order: `(y, z)/x`, `(z, x)/y` or `(x, y)/z`.
    pub shear: Vec2,
    /// Index of the direction's largest component.
    pub axis: u32,
    /// 1 if some component of `direction` is zero.
    pub parallel: u32,
    /// Added to the far end of every slab interval: more than what flushing
    /// subnormal numbers can take away.
    pub slack: f32,
}

/// The point of the ray at parameter `t`.
///
/// Each component is one product and one sum: error at most 1 ULP of the
/// larger of `|origin|` and `|direction · t|`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::{Ray, ray_at};
///
/// let ray = Ray {
///     origin: Vec3::ONE,
///     direction: Vec3::new(0.0, 0.0, 2.0),
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// assert_eq!(ray_at(ray, 3.0), Vec3::new(1.0, 1.0, 7.0));
/// ```
#[inline]
#[must_use]
pub fn ray_at(ray: Ray, t: f32) -> Vec3 {
    Vec3::new(
        ray.origin.x + ray.direction.x * t,
        ray.origin.y + ray.direction.y * t,
        ray.origin.z + ray.direction.z * t,
    )
}

/// A direction component, or 0 where it is too small to divide by.
#[inline]
fn ray_flush(component: f32) -> f32 {
    if component.abs() < RAY_FLUSH {
        0.0
    } else {
        component
    }
}

/// `1 / component`, or 0 for 0.
#[inline]
fn ray_inverse(component: f32) -> f32 {
    if component == 0.0 {
        0.0
    } else {
        1.0 / component
    }
}

/// The components `(axis + 1, axis + 2, axis)` of a vector, modulo three.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::ray_rotate;
///
/// let v = Vec3::new(1.0, 2.0, 3.0);
/// // The axis comes last.
/// assert_eq!(ray_rotate(v, 0), Vec3::new(2.0, 3.0, 1.0));
/// assert_eq!(ray_rotate(v, 2), v);
/// ```
#[inline]
#[must_use]
pub fn ray_rotate(v: Vec3, axis: u32) -> Vec3 {
    match axis {
        0 => Vec3::new(v.y, v.z, v.x),
        1 => Vec3::new(v.z, v.x, v.y),
        _ => v,
    }
}

/// Prepares a ray for [`aabb_slab`](super::aabb::aabb_slab) and
/// [`triangle_intersect_sheared`](super::triangle::triangle_intersect_sheared).
///
/// Tiny direction components become zero here, once, so that the box test and
/// the triangle test see the same ray. The shear is that of Woop, Benthin,
/// Wald: Watertight Ray/Triangle Intersection, JCGT 2(1), 2013, section 3.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::ray::{Ray, ray_shear};
///
/// let ray = Ray {
///     origin: Vec3::ZERO,
///     direction: Vec3::new(1.0, 0.0, -4.0),
///     t_min: 0.0,
///     t_max: 9.0,
/// };
/// let shear = ray_shear(ray);
/// // The direction has a zero, and mostly points along z.
/// assert_eq!((shear.parallel, shear.axis), (1, 2));
/// assert_eq!(shear.shear, Vec2::new(-0.25, 0.0));
/// ```
#[inline]
#[must_use]
pub fn ray_shear(ray: Ray) -> RayShear {
    let direction = Vec3::new(
        ray_flush(ray.direction.x),
        ray_flush(ray.direction.y),
        ray_flush(ray.direction.z),
    );
    let inverse = Vec3::new(
        ray_inverse(direction.x),
        ray_inverse(direction.y),
        ray_inverse(direction.z),
    );
    let x = direction.x.abs();
    let y = direction.y.abs();
    let z = direction.z.abs();
    let axis = if z >= x && z >= y {
        2
    } else if y >= x {
        1
    } else {
        0
    };
    let rotated = ray_rotate(direction, axis);
    let largest = if rotated.z == 0.0 { 1.0 } else { rotated.z };
    let parallel = x == 0.0 || y == 0.0 || z == 0.0;
    let steepest = 1.0f32
        .max(inverse.x.abs())
        .max(inverse.y.abs())
        .max(inverse.z.abs());
    RayShear {
        origin: ray.origin,
        direction,
        inverse,
        shear: Vec2::new(rotated.x / largest, rotated.y / largest),
        axis,
        parallel: u32::from(parallel),
        slack: RAY_SLACK * steepest,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(direction: Vec3) -> Ray {
        Ray {
            origin: Vec3::new(1.0, 2.0, 3.0),
            direction,
            t_min: 0.0,
            t_max: f32::MAX,
        }
    }

    #[test]
    fn at_counts_in_direction_lengths() {
        let p = ray_at(ray(Vec3::new(0.0, 0.0, 2.0)), 1.5);
        assert_eq!(p, Vec3::new(1.0, 2.0, 6.0));
    }

    #[test]
    fn shear_takes_the_largest_axis() {
        for (d, axis, shear) in [
            (Vec3::new(-4.0, 2.0, 1.0), 0, Vec2::new(-0.5, -0.25)),
            (Vec3::new(1.0, 4.0, 2.0), 1, Vec2::new(0.5, 0.25)),
            (Vec3::new(2.0, 1.0, -4.0), 2, Vec2::new(-0.5, -0.25)),
        ] {
            let s = ray_shear(ray(d));
            assert_eq!((s.axis, s.shear), (axis, shear), "{d}");
            assert_eq!(s.parallel, 0);
            assert_eq!(s.inverse, Vec3::ONE / d);
        }
    }

    #[test]
    fn tiny_components_are_parallel() {
        for tiny in [0.0, -0.0, 1e-40, -1e-30] {
            let s = ray_shear(ray(Vec3::new(tiny, 1.0, 0.5)));
            assert_eq!(s.parallel, 1);
            assert_eq!(s.inverse.x, 0.0);
            assert_eq!(s.direction.x, 0.0);
            assert_eq!(s.shear, Vec2::new(0.5, 0.0));
        }
        assert_eq!(ray_shear(ray(Vec3::new(1e-20, 1.0, 0.5))).parallel, 0);
    }

    #[test]
    fn zero_direction_stays_finite() {
        let s = ray_shear(ray(Vec3::ZERO));
        assert_eq!((s.inverse, s.shear), (Vec3::ZERO, Vec2::ZERO));
    }
}
