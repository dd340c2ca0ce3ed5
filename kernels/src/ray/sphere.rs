//! Ray against sphere: the pair and its contract.

pub use raytwin_cpu::ray::sphere::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::ray::SPHERE;

#[cfg(feature = "contract")]
crate::value_struct!(SphereHit {
    hit: u32,
    t: f32,
    t_near: f32,
    t_far: f32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ray::{Ray, WideRay};
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    // Where the line is closest to the centre, and half the chord, both in t;
    // the chord's radicand is relative to r².
    fn exact((o, d, _, _): WideRay, center: DVec3, radius: f64) -> (f64, f64, f64) {
        let oc = center - o;
        let closest = oc.dot(d) / d.length_squared();
        let perp = oc - d * closest;
        let radicand = (radius * radius - perp.length_squared()) / (radius * radius);
        let reach = radius * radicand.max(0.0).sqrt() / d.length();
        (closest, reach, radicand)
    }
    // The perpendicular is known to an ULP of the distance; the chord's end
    // moves by that over the cosine at which the ray meets the surface.
    fn condition((o, d, _, _): WideRay, center: DVec3, radius: f64) -> f64 {
        let distance = (center - o).length();
        let (_, _, radicand) = exact((o, d, 0.0, 0.0), center, radius);
        let cosine = radicand.max(1e-12).sqrt();
        (distance + radius) / (cosine * d.length())
    }
    let aimed = domains::vec3(domains::range(-4.0, 4.0))
        .and(domains::unit_vector())
        .and(domains::log_range(0.1, 10.0))
        .and(domains::log_range(0.01, 1e3))
        .and(domains::unit_vector())
        .and(domains::log_range(0.05, 1.5))
        .map(|(((((origin, toward), length), radius), side), miss)| {
            // A ray that passes the centre at `miss` radii, from up to ten
            // radii away.
            let distance = radius * 10.0 * length.fract();
            let center = origin + toward * distance + side * (miss * radius);
            let ray = Ray {
                origin,
                direction: toward * length,
                t_min: 0.0,
                t_max: 1e6,
            };
            (ray, center, radius)
        });
    let down = |height: f32| Ray {
        origin: Vec3::new(0.0, 0.0, height),
        direction: -Vec3::Z,
        t_min: 0.0,
        t_max: 1e30,
    };

    vec![
        Kernel::new(
            "ray/sphere",
            "sphere_intersect",
            ["ray", "center", "radius"],
            sphere_intersect,
            |ray: WideRay, center: DVec3, radius: f64| {
                let (closest, reach, radicand) = exact(ray, center, radius);
                if radicand < 0.0 {
                    return (0, 0.0, 0.0, 0.0);
                }
                let (near, far) = (closest - reach, closest + reach);
                let inside = |t: f64| t >= ray.2 && t <= ray.3;
                if inside(near) {
                    (1, near, near, far)
                } else if inside(far) {
                    (1, far, near, far)
                } else {
                    (0, 0.0, 0.0, 0.0)
                }
            },
            aimed,
        )
        .scale_by(condition)
        .undecided(|ray: WideRay, center: DVec3, radius: f64| {
            let (closest, reach, radicand) = exact(ray, center, radius);
            let near = condition(ray, center, radius) * 2e-5;
            let ends = [closest - reach, closest + reach];
            // Tangent to the eye's limit, or a crossing at an end of the range.
            radicand.abs() < 1e-3 * (1.0 + (center - ray.0).length() / radius)
                || ends
                    .iter()
                    .any(|t| (t - ray.2).abs() < near || (t - ray.3).abs() < near)
        })
        .few_ulp(5.5, 32.0)
        .hard([
            (down(2.0), Vec3::ZERO, 1.0),
            (down(0.5), Vec3::ZERO, 1.0),
            (down(-2.0), Vec3::ZERO, 1.0),
            // A small sphere far away: the textbook discriminant is all
            // cancellation here.
            (down(1e4), Vec3::new(0.1, 0.0, 0.0), 1.0),
            (down(1e6), Vec3::ZERO, 1e3),
            (down(1e5), Vec3::new(500.0, 0.0, 0.0), 1e3),
        ])
        .source("Haines et al., Ray Tracing Gems ch. 7, Precision Improvements for Ray/Sphere Intersection")
        .build(),
    ]
}
