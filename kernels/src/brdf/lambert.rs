//! Diffuse reflection: the pair and its contract.

pub use raytwin_cpu::brdf::lambert::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::LAMBERT;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, DVec3, Vec2, Vec3};
    use std::f64::consts::{FRAC_PI_4, PI};

    const MODULE: &str = "brdf/lambert";
    const SOURCE: &str = "Lambert 1760, Photometria; sampled by Malley's method";

    // Shirley and Chiu's square, by its angle.
    fn square(d: DVec3) -> DVec2 {
        let p = d.truncate();
        let r = p.length();
        let (ax, ay) = (p.x.abs(), p.y.abs());
        let part = if r == 0.0 {
            0.0
        } else {
            ax.min(ay).atan2(ax.max(ay)) / FRAC_PI_4 * r
        };
        let v = if ax > ay {
            DVec2::new(r, part)
        } else {
            DVec2::new(part, r)
        };
        (v * DVec2::new(p.x.signum(), p.y.signum()) + 1.0) / 2.0
    }

    let us = [Vec2::ZERO, Vec2::splat(0.5), Vec2::new(0.99999994, 0.25)];
    let ws = [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::new(0.6, 0.0, 0.8)];
    vec![
        Kernel::new(
            MODULE,
            "lambert_eval",
            ["albedo"],
            lambert_eval,
            |a: DVec3| a / PI,
            (domains::vec3(domains::range(0.0, 1.0)),),
        )
        .few_ulp(1.5, 2.0)
        .hard([(Vec3::ZERO,), (Vec3::ONE,)])
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "lambert_sample",
            ["u"],
            lambert_sample,
            |u: DVec2| {
                let v = u * 2.0 - 1.0;
                let r = v.abs().max_element();
                // The angle grows evenly along the square's rim.
                let angle = if r == 0.0 {
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
        .few_ulp(3.0, 9.5)
        .hard(us.map(|u| (u,)))
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "lambert_pdf",
            ["wi"],
            lambert_pdf,
            |w: DVec3| w.z.max(0.0) / PI,
            (domains::unit_vector(),),
        )
        .few_ulp(1.5, 2.0)
        .hard(ws.map(|w| (w,)))
        .source(SOURCE)
        .build(),
        Kernel::new(
            MODULE,
            "lambert_invert",
            ["wi"],
            lambert_invert,
            square,
            (domains::unit_pair().map(lambert_sample),),
        )
        .scale(0.5)
        .few_ulp(2.25, 6.0)
        .hard(ws.map(|w| (w,)))
        .source(SOURCE)
        .build(),
    ]
}
