//! Ray against plane: the pair and its contract.

pub use raytwin_cpu::ray::plane::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::ray::PLANE;

#[cfg(feature = "contract")]
crate::value_struct!(PlaneHit { hit: u32, t: f32 });

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ray::{Ray, WideRay, ray_domain};
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    fn exact((o, d, _, _): WideRay, point: DVec3, normal: DVec3) -> (f64, f64) {
        (normal.dot(point - o), normal.dot(d))
    }
    // How far t can move for rounding in the two dot products.
    fn condition((o, d, _, _): WideRay, point: DVec3, normal: DVec3) -> f64 {
        let (top, bottom) = exact((o, d, 0.0, 0.0), point, normal);
        let n = normal.abs();
        let spread = n.dot((point - o).abs());
        let along = n.dot(d.abs());
        (spread + (top / bottom).abs() * along) / bottom.abs()
    }
    let ray = |direction: Vec3, t_max: f32| Ray {
        origin: Vec3::new(0.0, 0.0, 2.0),
        direction,
        t_min: 0.0,
        t_max,
    };

    vec![
        Kernel::new(
            "ray/plane",
            "plane_intersect",
            ["ray", "point", "normal"],
            plane_intersect,
            |ray: WideRay, point: DVec3, normal: DVec3| {
                let (top, bottom) = exact(ray, point, normal);
                let t = top / bottom;
                if bottom != 0.0 && t >= ray.2 && t <= ray.3 {
                    (1, t)
                } else {
                    (0, 0.0)
                }
            },
            (
                ray_domain(),
                domains::vec3(domains::range(-4.0, 4.0)),
                domains::unit_vector(),
            ),
        )
        .scale_by(condition)
        .undecided(|ray: WideRay, point: DVec3, normal: DVec3| {
            let (top, bottom) = exact(ray, point, normal);
            let t = top / bottom;
            let near = condition(ray, point, normal) * 1e-5;
            // Grazing, or at an end of the range.
            bottom.abs() < 1e-4 * ray.1.length()
                || (t - ray.2).abs() < near
                || (t - ray.3).abs() < near
        })
        .few_ulp(2.25, 5.5)
        .hard([
            (ray(-Vec3::Z, 10.0), Vec3::ZERO, Vec3::Z),
            (ray(Vec3::Z, 10.0), Vec3::ZERO, Vec3::Z),
            (ray(Vec3::X, 10.0), Vec3::ZERO, Vec3::Z),
            (ray(Vec3::new(1.0, 0.0, -1e-3), 1e4), Vec3::ZERO, Vec3::Z),
            (ray(-Vec3::Z, 1e12), Vec3::new(0.0, 0.0, -1e9), Vec3::Z),
            (ray(-Vec3::Z * 1e-10, 1e12), Vec3::ZERO, Vec3::Z * 1e-5),
        ])
        .source("Physically Based Rendering, 4th ed., 6.1; n·(o + td - p) = 0")
        .build(),
    ]
}
