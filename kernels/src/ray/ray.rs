//! The ray and its set-up: the pair and its contract.

pub use raytwin_cpu::ray::ray::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::ray::RAY;

#[cfg(feature = "contract")]
crate::value_struct!(Ray {
    origin: glam::Vec3,
    direction: glam::Vec3,
    t_min: f32,
    t_max: f32,
});
#[cfg(feature = "contract")]
crate::value_struct!(RayShear {
    origin: glam::Vec3,
    direction: glam::Vec3,
    inverse: glam::Vec3,
    shear: glam::Vec2,
    axis: u32,
    parallel: u32,
    slack: f32,
});

/// A ray, widened: origin, direction, `t_min`, `t_max`.
#[cfg(feature = "contract")]
pub(crate) type WideRay = (glam::DVec3, glam::DVec3, f64, f64);

/// Rays from around the origin, of any direction and length from 0.1 to 10,
/// axis-aligned ones with zeros of either sign among them.
#[cfg(feature = "contract")]
pub(crate) fn ray_domain() -> crate::contract::Domain<Ray> {
    use crate::contract::domains;
    domains::vec3(domains::range(-4.0, 4.0))
        .and(domains::unit_vector())
        .and(domains::log_range(0.1, 10.0))
        .map(|((origin, direction), length)| Ray {
            origin,
            direction: direction * length,
            t_min: 0.0,
            t_max: 1000.0,
        })
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec3};

    const SHEAR: &str = "Woop, Benthin and Wald 2013, JCGT 2(1), section 3.1";
    let ray = |direction: Vec3| Ray {
        origin: Vec3::new(1.0, -2.0, 3.0),
        direction,
        t_min: 0.0,
        t_max: 100.0,
    };
    let hard = [
        Vec3::X,
        -Vec3::Y,
        Vec3::Z,
        Vec3::new(0.0, -0.0, -1.0),
        Vec3::new(1.0, 1.0, 1.0),
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::new(1e-10, 0.0, 0.0),
        Vec3::new(1e10, 1e-10, -1e10),
        Vec3::new(1.0, 1e-25, 0.0),
        Vec3::new(1.0, 1e-24, 1e-23),
    ];

    vec![
        Kernel::new(
            "ray/ray",
            "ray_at",
            ["ray", "t"],
            ray_at,
            |(o, d, _, _): WideRay, t: f64| o + d * t,
            (ray_domain(), domains::range(0.0, 100.0)),
        )
        .scale_by(|(o, d, _, _): WideRay, t: f64| {
            o.abs().max_element() + (d.abs() * t).max_element()
        })
        .few_ulp(1.25, 2.5)
        .hard(hard.map(|d| (ray(d), 10.0)))
        .source("parametric line")
        .build(),
        Kernel::new(
            "ray/ray",
            "ray_rotate",
            ["v", "axis"],
            ray_rotate,
            |v: DVec3, axis: u32| {
                let c = v.to_array();
                let i = axis.min(2) as usize;
                DVec3::new(c[(i + 1) % 3], c[(i + 2) % 3], c[i])
            },
            (
                domains::vec3(domains::signed_log_range(1e-6, 1e6)),
                domains::below(3),
            ),
        )
        .bit_exact()
        .hard([
            (Vec3::new(1.0, 2.0, 3.0), 0),
            (Vec3::new(1.0, 2.0, 3.0), 1),
            (Vec3::new(1.0, 2.0, 3.0), 2),
        ])
        .source(SHEAR)
        .build(),
        Kernel::new(
            "ray/ray",
            "ray_shear",
            ["ray"],
            ray_shear,
            |(o, d, _, _): WideRay| {
                let flush = |c: f64| {
                    if c.abs() < f64::from(RAY_FLUSH) {
                        0.0
                    } else {
                        c
                    }
                };
                let d = DVec3::new(flush(d.x), flush(d.y), flush(d.z));
                let invert = |c: f64| if c == 0.0 { 0.0 } else { 1.0 / c };
                let inverse = DVec3::new(invert(d.x), invert(d.y), invert(d.z));
                let c = d.to_array();
                // The largest component; of equal ones the last axis.
                let axis = (0..3).fold(
                    0,
                    |best, i| if c[i].abs() >= c[best].abs() { i } else { best },
                );
                let shear = DVec2::new(c[(axis + 1) % 3], c[(axis + 2) % 3]) / c[axis];
                let slack = f64::from(RAY_SLACK) * inverse.abs().max_element().max(1.0);
                let parallel = u32::from(c.contains(&0.0));
                (o, d, inverse, shear, axis as u32, parallel, slack)
            },
            (ray_domain(),),
        )
        .few_ulp(0.5, 2.5)
        .hard(hard.map(|d| (ray(d),)))
        .source(SHEAR)
        .build(),
    ]
}
