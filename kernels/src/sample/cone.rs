//! Uniform cone: the pair and its contract.

pub use raytwin_cpu::sample::cone::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::sample::CONE;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::disk::azimuth;
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::TAU;

    const SOURCE: &str = "Physically Based Rendering, 4th ed., A.5.4, by 1 - cos";

    // From a cone of 1e-6 rad to the whole sphere; the Sun is 1.08e-5.
    let width = domains::log_range(5e-13, 2.0);
    let sun = cone_one_minus_cos(0.00465);
    let height = |d: DVec3| {
        let s = d.x * d.x + d.y * d.y;
        if d.z > 0.0 {
            s / (1.0 + d.z)
        } else {
            1.0 - d.z
        }
    };
    // Directions inside the cone and around its rim.
    let around = domains::unit_pair()
        .and(width.clone())
        .and(domains::range(0.5, 1.5))
        .map(|((u, omc), far)| (cone_sample(u, (omc * far).min(2.0)), omc));
    let inside = domains::unit_pair()
        .and(width.clone())
        .map(|(u, omc)| (cone_sample(u, omc), omc));

    vec![
        Kernel::new(
            "sample/cone",
            "cone_one_minus_cos",
            ["half_angle"],
            cone_one_minus_cos,
            |a: f64| 2.0 * (a / 2.0).sin().powi(2),
            (domains::log_range(1e-6, std::f32::consts::PI),),
        )
        .few_ulp(5.5, 9.5)
        .hard([0.0, 0.00465, 1e-3, 2e-4, 1e-10, std::f32::consts::PI, 1.5].map(|a| (a,)))
        .source("half-angle identity")
        .baseline(
            "1 - built-in cos",
            "fn baseline(a: f32) -> f32 { return 1.0 - cos(a); }",
            |a: f32| 1.0 - a.cos(),
        )
        .build(),
        Kernel::new(
            "sample/cone",
            "cone_one_minus_cos_from_sin",
            ["sin_half_angle"],
            cone_one_minus_cos_from_sin,
            // Rationalised, since 1 - √(1 - s²) cancels in f64 as well.
            |s: f64| s * s / (1.0 + ((1.0 - s) * (1.0 + s)).sqrt()),
            (domains::log_range(1e-6, 1.0),),
        )
        .few_ulp(2.25, 9.5)
        .hard([0.0, 1.0, 0.99999994, 1e-10, 0.00465].map(|s| (s,)))
        .source("Physically Based Rendering, 4th ed., 6.2.4")
        .build(),
        Kernel::new(
            "sample/cone",
            "cone_sample",
            ["u", "one_minus_cos"],
            cone_sample,
            |u: DVec2, omc: f64| {
                // u.x·omc is exact in f64, and so is 2 minus it.
                let x = u.x * omc;
                (DVec2::from_angle(TAU * u.y) * (x * (2.0 - x)).sqrt()).extend(1.0 - x)
            },
            (domains::unit_pair(), width.clone()),
        )
        // Absolute, as for any unit vector. That a narrow cone keeps its radii
        // apart is a unit test of the CPU twin.
        .scale(0.5)
        .few_ulp(2.5, 10.0)
        .hard([
            (Vec2::ZERO, 0.5),
            (Vec2::splat(0.99999994), 2.0),
            (Vec2::new(0.5, 0.25), sun),
            (Vec2::new(5.9604645e-8, 0.5), sun),
            (Vec2::new(0.99999994, 0.125), 5e-13),
            (Vec2::new(0.99999994, 0.7), 1e-30),
            (Vec2::new(0.3, 0.6), 2.0),
            (Vec2::new(0.9999999, 0.125), 1.9999999),
            (Vec2::new(0.99999994, 0.3), 1.9999999),
            (Vec2::new(0.9999, 0.7), 1.9998),
        ])
        .source(SOURCE)
        .baseline(
            "usual form: lerp of a stored cosine, built-in sin and cos",
            "fn baseline(u: vec2f, one_minus_cos: f32) -> vec3f {
                let cos_max = 1.0 - one_minus_cos;
                let z = (1.0 - u.x) + u.x * cos_max;
                let r = sqrt(max(0.0, 1.0 - z * z));
                let a = 6.2831855 * u.y;
                return vec3f(r * cos(a), r * sin(a), z);
            }",
            |u: Vec2, one_minus_cos: f32| {
                let cos_max = 1.0 - one_minus_cos;
                let z = (1.0 - u.x) + u.x * cos_max;
                let r = (1.0 - z * z).max(0.0).sqrt();
                let (s, c) = (6.283_185_5 * u.y).sin_cos();
                Vec3::new(r * c, r * s, z)
            },
        )
        .build(),
        Kernel::new(
            "sample/cone",
            "cone_pdf",
            ["direction", "one_minus_cos"],
            cone_pdf,
            move |d: DVec3, omc: f64| {
                if height(d) <= omc {
                    1.0 / (TAU * omc)
                } else {
                    0.0
                }
            },
            around,
        )
        .undecided(move |d: DVec3, omc: f64| (height(d) / omc - 1.0).abs() < 4e-6)
        .few_ulp(1.25, 3.5)
        .hard([
            (Vec3::Z, sun),
            (Vec3::X, sun),
            (-Vec3::Z, 2.0),
            (Vec3::Z, 5e-13),
            (Vec3::new(1e-6, 0.0, 1.0), 5e-13),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "sample/cone",
            "cone_invert",
            ["direction", "one_minus_cos"],
            cone_invert,
            move |d: DVec3, omc: f64| DVec2::new((height(d) / omc).min(1.0), azimuth(d.y, d.x).0),
            inside,
        )
        .scale(0.5)
        .undecided(|d: DVec3, _: f64| azimuth(d.y, d.x).1)
        .few_ulp(3.25, 11.0)
        .hard([
            (Vec3::Z, sun),
            (-Vec3::Z, 2.0),
            (Vec3::X, 1.0),
            (-Vec3::Y, 2.0),
            (cone_sample(Vec2::new(0.5, 0.3), 5e-13), 5e-13),
        ])
        .source(SOURCE)
        .build(),
    ]
}
