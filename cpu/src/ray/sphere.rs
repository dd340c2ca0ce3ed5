//! Ray against sphere.

use glam::Vec3;

use super::ray::Ray;
use crate::math::vector::vec3_dot;

/// Where a ray meets a sphere.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::Ray;
/// use raytwin_cpu::ray::sphere::sphere_intersect;
///
/// // From inside, the first crossing within the range is the far one.
/// let ray =
///     Ray { origin: Vec3::ZERO, direction: Vec3::X, t_min: 0.0, t_max: 9.0 };
/// let hit = sphere_intersect(ray, Vec3::ZERO, 2.0);
/// assert_eq!((hit.t, hit.t_near, hit.t_far), (2.0, -2.0, 2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SphereHit {
    /// 1 if the ray meets the surface within its range, else 0.
    pub hit: u32,
    /// The first crossing within the range; 0 on a miss.
    pub t: f32,
    /// Where the line enters; 0 on a miss.
    pub t_near: f32,
    /// Where the line leaves; 0 on a miss.
    pub t_far: f32,
}

const MISS: SphereHit = SphereHit {
    hit: 0,
    t: 0.0,
    t_near: 0.0,
    t_far: 0.0,
};

/// Ray against the surface of a sphere.
///
/// The textbook discriminant `b² - ac` subtracts squares of the distance: a
/// sphere of radius 1 seen from 5000 has lost every digit of it. Here the
/// discriminant is `r² - |perp|²`, where `perp` is the vector from the
/// line's closest point to the centre, whose error is a few ULP of the
/// distance itself; and the root that would cancel is the other one's
/// conjugate, `c / (a t)` with `c = (|oc| - r)(|oc| + r)`. After Haines, Günther,
/// Akenine-Möller: Precision Improvements for Ray/Sphere Intersection, Ray
/// Tracing Gems, 2019, chapter 7.
///
/// Ranges: `radius >= 0`, distances and direction lengths between 1e-15 and
/// 1e15. Hit or miss is right for a sphere shifted by less than 8 ULP of the
/// centre's distance.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::ray::ray::Ray;
/// use raytwin_cpu::ray::sphere::sphere_intersect;
///
/// let ray = Ray {
///     origin: Vec3::new(-5.0, 0.0, 0.0),
///     direction: Vec3::X,
///     t_min: 0.0,
///     t_max: f32::MAX,
/// };
/// let hit = sphere_intersect(ray, Vec3::ZERO, 2.0);
/// assert_eq!((hit.hit, hit.t), (1, 3.0));
/// assert_eq!(sphere_intersect(ray, Vec3::new(0.0, 2.5, 0.0), 2.0).hit, 0);
/// ```
#[inline]
#[must_use]
pub fn sphere_intersect(ray: Ray, center: Vec3, radius: f32) -> SphereHit {
    let oc = center - ray.origin;
    let a = vec3_dot(ray.direction, ray.direction);
    let closest = vec3_dot(oc, ray.direction) / a;
    let perp = Vec3::new(
        oc.x - ray.direction.x * closest,
        oc.y - ray.direction.y * closest,
        oc.z - ray.direction.z * closest,
    );
    let discriminant = radius * radius - vec3_dot(perp, perp);
    if discriminant < 0.0 {
        return MISS;
    }
    let reach = (discriminant / a).sqrt();
    let distance = vec3_dot(oc, oc).sqrt();
    let c = ((distance - radius) * (distance + radius)) / a;
    let outer = if closest < 0.0 {
        closest - reach
    } else {
        closest + reach
    };
    let inner = if outer == 0.0 {
        0.0
    } else {
        c / if outer == 0.0 { 1.0 } else { outer }
    };
    let t_near = if inner < outer { inner } else { outer };
    let t_far = if inner < outer { outer } else { inner };
    let near_inside = t_near >= ray.t_min && t_near <= ray.t_max;
    let far_inside = t_far >= ray.t_min && t_far <= ray.t_max;
    if near_inside || far_inside {
        SphereHit {
            hit: 1,
            t: if near_inside { t_near } else { t_far },
            t_near,
            t_far,
        }
    } else {
        MISS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: Vec3, direction: Vec3) -> Ray {
        Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::MAX,
        }
    }

    #[test]
    fn front_inside_and_behind() {
        let h = sphere_intersect(ray(Vec3::ZERO, Vec3::Z), Vec3::Z * 5.0, 2.0);
        assert_eq!((h.hit, h.t, h.t_near, h.t_far), (1, 3.0, 3.0, 7.0));
        let h = sphere_intersect(ray(Vec3::Z * 5.0, Vec3::Z * 0.5), Vec3::Z * 5.0, 2.0);
        assert_eq!((h.hit, h.t, h.t_near), (1, 4.0, -4.0));
        let h = sphere_intersect(ray(Vec3::Z * 8.0, Vec3::Z), Vec3::Z * 5.0, 2.0);
        assert_eq!(h, MISS);
        assert_eq!(
            sphere_intersect(ray(Vec3::X * 2.5, Vec3::Z), Vec3::Z, 2.0),
            MISS
        );
    }

    #[test]
    fn surface_origin() {
        let h = sphere_intersect(ray(Vec3::Z * 2.0, Vec3::Z), Vec3::ZERO, 2.0);
        assert_eq!((h.hit, h.t, h.t_near), (1, 0.0, -4.0));
        let h = sphere_intersect(ray(Vec3::Z * 2.0, -Vec3::Z), Vec3::ZERO, 2.0);
        assert_eq!((h.t_near, h.t_far), (0.0, 4.0));
    }

    #[test]
    fn far_and_tiny_spheres_keep_their_outline() {
        // The textbook form gives 0 or garbage from about 5e3 radii on.
        for distance in [1e2f32, 1e4, 1e5, 1e6] {
            for offset in [0.0f32, 0.25, 0.5, 0.75, 0.9, 1.1, 1.5, 2.0] {
                let h = sphere_intersect(ray(Vec3::X * offset, Vec3::Z), Vec3::Z * distance, 1.0);
                assert_eq!(h.hit == 1, offset <= 1.0, "{distance} {offset}");
                if h.hit == 1 {
                    let truth = f64::from(distance) - (1.0 - f64::from(offset).powi(2)).sqrt();
                    let error = (f64::from(h.t) - truth).abs() / truth;
                    assert!(error < 2e-7, "{distance} {offset} {error:e}");
                }
            }
        }
    }

    #[test]
    fn tangent_point() {
        let h = sphere_intersect(ray(Vec3::X * 2.0, Vec3::Z), Vec3::Z * 4.0, 2.0);
        assert_eq!((h.hit, h.t_near, h.t_far), (1, 4.0, 4.0));
        let h = sphere_intersect(ray(Vec3::X, Vec3::Z), Vec3::X, 0.0);
        assert_eq!((h.hit, h.t), (1, 0.0));
    }
}
