//! The unit disk: the pair and its contract.

pub use raytwin_cpu::sample::disk::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::sample::DISK;

/// The azimuth of `(x, y)` in turns and whether it is next to the seam between
/// 1 and 0, where either end is right.
#[cfg(feature = "contract")]
pub(crate) fn azimuth(y: f64, x: f64) -> (f64, bool) {
    // WGSL may ignore a zero's sign: the origin has azimuth 0 whatever it is.
    let turn = ((y + 0.0).atan2(x + 0.0) / std::f64::consts::TAU).rem_euclid(1.0);
    (turn, y < 0.0 && turn > 1.0 - 2.4e-7)
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, Vec2};
    use std::f64::consts::{FRAC_PI_4, PI, TAU};

    const POLAR: &str = "Physically Based Rendering, 4th ed., A.5.1";
    const CONCENTRIC: &str = "Shirley and Chiu 1997, JGT 2(3)";

    let hard_u = [
        Vec2::ZERO,
        Vec2::splat(0.5),
        Vec2::new(0.0, 0.5),
        Vec2::new(0.5, 0.0),
        Vec2::splat(0.99999994),
        Vec2::new(0.25, 0.75),
        Vec2::new(0.50000006, 0.5),
        Vec2::new(5.9604645e-8, 0.3),
        Vec2::new(0.5, 0.49999997),
    ];
    let hard_p = [
        Vec2::ZERO,
        Vec2::X,
        -Vec2::X,
        Vec2::Y,
        -Vec2::Y,
        Vec2::new(0.70710677, 0.70710677),
        Vec2::new(-0.70710677, 0.70710677),
        Vec2::new(1e-18, -1e-18),
        Vec2::new(-0.0, 0.5),
        Vec2::new(0.99999994, 1e-7),
    ];
    let on_disk = domains::unit_pair().map(disk_concentric_sample);

    vec![
        Kernel::new(
            "sample/disk",
            "disk_polar_sample",
            ["u"],
            disk_polar_sample,
            |u: DVec2| DVec2::from_angle(TAU * u.y) * u.x.sqrt(),
            (domains::unit_pair(),),
        )
        .scale(0.5)
        .few_ulp(2.0, 10.0)
        .hard(hard_u.map(|u| (u,)))
        .source(POLAR)
        .baseline(
            "built-in sin and cos",
            "fn baseline(u: vec2f) -> vec2f {
                let r = sqrt(u.x);
                let a = 6.2831855 * u.y;
                return vec2f(r * cos(a), r * sin(a));
            }",
            |u: Vec2| {
                let (s, c) = (6.283_185_5 * u.y).sin_cos();
                u.x.sqrt() * Vec2::new(c, s)
            },
        )
        .build(),
        Kernel::new(
            "sample/disk",
            "disk_polar_invert",
            ["p"],
            disk_polar_invert,
            |p: DVec2| DVec2::new(p.length_squared(), azimuth(p.y, p.x).0),
            (on_disk.clone(),),
        )
        .scale(0.5)
        .undecided(|p: DVec2| azimuth(p.y, p.x).1)
        .few_ulp(2.0, 2.5)
        .hard(hard_p.map(|p| (p,)))
        .source(POLAR)
        .build(),
        Kernel::new(
            "sample/disk",
            "disk_concentric_sample",
            ["u"],
            disk_concentric_sample,
            |u: DVec2| {
                let v = u * 2.0 - 1.0;
                if v == DVec2::ZERO {
                    return v;
                }
                let (r, angle) = if v.x.abs() > v.y.abs() {
                    (v.x, FRAC_PI_4 * v.y / v.x)
                } else {
                    (v.y, PI / 2.0 - FRAC_PI_4 * v.x / v.y)
                };
                DVec2::from_angle(angle) * r
            },
            (domains::unit_pair(),),
        )
        .scale(0.5)
        .few_ulp(3.0, 7.0)
        .hard(hard_u.map(|u| (u,)))
        .source(CONCENTRIC)
        .build(),
        Kernel::new(
            "sample/disk",
            "disk_concentric_invert",
            ["p"],
            disk_concentric_invert,
            |p: DVec2| {
                // By sector: the angle from the nearest axis, over 45 degrees.
                let r = p.length();
                let angle = p.y.atan2(p.x);
                let square = if p.x.abs() > p.y.abs() {
                    let from_axis = if p.x > 0.0 { angle } else { p.y.atan2(-p.x) };
                    DVec2::new(p.x.signum(), from_axis / FRAC_PI_4)
                } else if p == DVec2::ZERO {
                    DVec2::ZERO
                } else {
                    let from_axis = p.x.atan2(p.y.abs());
                    DVec2::new(from_axis / FRAC_PI_4, p.y.signum())
                };
                (square * r + 1.0) / 2.0
            },
            (on_disk.clone(),),
        )
        .scale(0.5)
        .few_ulp(2.0, 6.0)
        .hard(hard_p.map(|p| (p,)))
        .source(CONCENTRIC)
        .build(),
        Kernel::new(
            "sample/disk",
            "disk_pdf",
            ["p"],
            disk_pdf,
            |p: DVec2| if p.length() <= 1.0 { 1.0 / PI } else { 0.0 },
            (on_disk
                .and(domains::range(0.5, 1.5))
                .map(|(p, far)| p * far),),
        )
        .undecided(|p: DVec2| (p.length() - 1.0).abs() < 2e-6)
        .few_ulp(0.5, 0.5)
        .hard([Vec2::ZERO, Vec2::X, Vec2::new(1.00001, 0.0), Vec2::ONE].map(|p| (p,)))
        .source(POLAR)
        .build(),
    ]
}
