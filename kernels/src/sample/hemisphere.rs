//! The hemisphere, uniform and by the cosine: the pair and its contract.

pub use raytwin_cpu::sample::hemisphere::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::sample::HEMISPHERE;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::disk::azimuth;
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::{FRAC_PI_4, PI, TAU};

    const COSINE: &str = "Physically Based Rendering, 4th ed., A.5.3 (Malley)";
    const UNIFORM: &str = "Physically Based Rendering, 4th ed., A.5.2";

    let hard_u = [
        Vec2::ZERO,
        Vec2::splat(0.5),
        Vec2::splat(0.99999994),
        Vec2::new(5.9604645e-8, 0.5),
        Vec2::new(0.0, 0.7),
        Vec2::new(0.25, 0.75),
        Vec2::new(0.5, 0.50000006),
    ];
    let hard_d = [
        Vec3::Z,
        -Vec3::Z,
        Vec3::X,
        -Vec3::X,
        Vec3::Y,
        -Vec3::Y,
        Vec3::new(0.70710677, 0.0, 0.70710677),
    ];
    let upper = domains::unit_pair().map(hemisphere_cosine_sample);

    vec![
        Kernel::new(
            "sample/hemisphere",
            "hemisphere_cosine_sample",
            ["u"],
            hemisphere_cosine_sample,
            |u: DVec2| {
                let v = u * 2.0 - 1.0;
                let r = v.abs().max_element();
                let angle = if v == DVec2::ZERO {
                    0.0
                } else if v.x.abs() > v.y.abs() {
                    FRAC_PI_4 * v.y / v.x + if v.x < 0.0 { PI } else { 0.0 }
                } else {
                    PI / 2.0 - FRAC_PI_4 * v.x / v.y + if v.y < 0.0 { PI } else { 0.0 }
                };
                (DVec2::from_angle(angle) * r).extend((1.0 - r * r).sqrt())
            },
            (domains::unit_pair(),),
        )
        .scale(0.5)
        .few_ulp(3.0, 9.0)
        .hard(hard_u.map(|u| (u,)))
        .source(COSINE)
        .baseline(
            "polar disk, built-in sin and cos, √(1 - x² - y²)",
            "fn baseline(u: vec2f) -> vec3f {
                let r = sqrt(u.x);
                let a = 6.2831855 * u.y;
                let x = r * cos(a);
                let y = r * sin(a);
                return vec3f(x, y, sqrt(max(0.0, 1.0 - x * x - y * y)));
            }",
            |u: Vec2| {
                let (s, c) = (6.283_185_5 * u.y).sin_cos();
                let p = u.x.sqrt() * Vec2::new(c, s);
                Vec3::new(p.x, p.y, (1.0 - p.x * p.x - p.y * p.y).max(0.0).sqrt())
            },
        )
        .build(),
        Kernel::new(
            "sample/hemisphere",
            "hemisphere_cosine_pdf",
            ["direction"],
            hemisphere_cosine_pdf,
            |d: DVec3| d.z.max(0.0) / PI,
            (domains::unit_vector(),),
        )
        .few_ulp(1.25, 2.0)
        .hard(hard_d.map(|d| (d,)))
        .source(COSINE)
        .build(),
        Kernel::new(
            "sample/hemisphere",
            "hemisphere_cosine_invert",
            ["direction"],
            hemisphere_cosine_invert,
            |d: DVec3| {
                // The square's larger coordinate is the radius; the smaller
                // follows from the angle to that axis.
                let p = DVec2::new(d.x, d.y);
                let (ax, ay) = (p.x.abs(), p.y.abs());
                let small = if p == DVec2::ZERO {
                    0.0
                } else {
                    ax.min(ay).atan2(ax.max(ay)) / FRAC_PI_4 * p.length()
                };
                let large = p.length();
                let v = if ax > ay {
                    DVec2::new(large, small)
                } else {
                    DVec2::new(small, large)
                };
                (v * DVec2::new(p.x.signum(), p.y.signum()) + 1.0) / 2.0
            },
            (upper.clone(),),
        )
        .scale(0.5)
        .few_ulp(2.0, 6.0)
        .hard(hard_d.map(|d| (d,)))
        .source(COSINE)
        .build(),
        Kernel::new(
            "sample/hemisphere",
            "hemisphere_uniform_sample",
            ["u"],
            hemisphere_uniform_sample,
            |u: DVec2| {
                let z = 1.0 - u.x;
                (DVec2::from_angle(TAU * u.y) * (1.0 - z * z).max(0.0).sqrt()).extend(z)
            },
            (domains::unit_pair(),),
        )
        .scale(0.5)
        .few_ulp(2.5, 10.0)
        .hard(hard_u.map(|u| (u,)))
        .source(UNIFORM)
        .build(),
        Kernel::new(
            "sample/hemisphere",
            "hemisphere_uniform_pdf",
            ["direction"],
            hemisphere_uniform_pdf,
            |d: DVec3| if d.z >= 0.0 { 1.0 / TAU } else { 0.0 },
            (domains::unit_vector(),),
        )
        .few_ulp(0.5, 0.5)
        .hard(hard_d.map(|d| (d,)))
        .source(UNIFORM)
        .build(),
        Kernel::new(
            "sample/hemisphere",
            "hemisphere_uniform_invert",
            ["direction"],
            hemisphere_uniform_invert,
            |d: DVec3| DVec2::new((1.0 - d.z).clamp(0.0, 1.0), azimuth(d.y, d.x).0),
            (upper,),
        )
        .scale(0.5)
        .undecided(|d: DVec3| azimuth(d.y, d.x).1)
        .few_ulp(1.0, 1.5)
        .hard([Vec3::Z, Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(|d| (d,)))
        .source(UNIFORM)
        .build(),
    ]
}
