//! The unit sphere: the pair and its contract.

pub use raytwin_cpu::sample::sphere::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::sample::SPHERE;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::disk::azimuth;
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::{PI, TAU};

    const SOURCE: &str = "Physically Based Rendering, 4th ed., A.5.2";

    vec![
        Kernel::new(
            "sample/sphere",
            "sphere_sample",
            ["u"],
            sphere_sample,
            |u: DVec2| {
                let z = 1.0 - 2.0 * u.x;
                let p = DVec2::from_angle(TAU * u.y) * (1.0 - z * z).max(0.0).sqrt();
                p.extend(z)
            },
            (domains::unit_pair(),),
        )
        .scale(0.5)
        .few_ulp(2.25, 9.5)
        .hard(
            [
                Vec2::ZERO,
                Vec2::splat(0.5),
                Vec2::splat(0.99999994),
                Vec2::new(5.9604645e-8, 0.125),
                Vec2::new(0.5, 0.0),
            ]
            .map(|u| (u,)),
        )
        .source(SOURCE)
        .baseline(
            "√(1 - z²), built-in sin and cos",
            "fn baseline(u: vec2f) -> vec3f {
                let z = 1.0 - 2.0 * u.x;
                let r = sqrt(max(0.0, 1.0 - z * z));
                let a = 6.2831855 * u.y;
                return vec3f(r * cos(a), r * sin(a), z);
            }",
            |u: Vec2| {
                let z = 1.0 - 2.0 * u.x;
                let r = (1.0 - z * z).max(0.0).sqrt();
                let (s, c) = (6.283_185_5 * u.y).sin_cos();
                Vec3::new(r * c, r * s, z)
            },
        )
        .build(),
        Kernel::new(
            "sample/sphere",
            "sphere_pdf",
            ["direction"],
            sphere_pdf,
            |_: DVec3| 1.0 / (4.0 * PI),
            (domains::unit_vector(),),
        )
        .few_ulp(0.5, 0.5)
        .hard([Vec3::Z, -Vec3::Z].map(|d| (d,)))
        .source(SOURCE)
        .build(),
        Kernel::new(
            "sample/sphere",
            "sphere_invert",
            ["direction"],
            sphere_invert,
            |d: DVec3| DVec2::new((1.0 - d.z) / 2.0, azimuth(d.y, d.x).0),
            (domains::unit_vector(),),
        )
        .scale(0.5)
        .undecided(|d: DVec3| azimuth(d.y, d.x).1)
        .few_ulp(0.75, 1.5)
        .hard([Vec3::Z, -Vec3::Z, Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(|d| (d,)))
        .source(SOURCE)
        .build(),
    ]
}
