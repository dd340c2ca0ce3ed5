//! Absorbing and dispersing media: the pair and its contract.

pub use raytwin_cpu::brdf::medium::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::MEDIUM;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};
    use std::f64::consts::LOG2_E;

    const MODULE: &str = "brdf/medium";
    const BEER: &str = "the law of Beer and Lambert";

    /// Below 2^-126 the twins give 0.
    fn exact(a: f64, d: f64) -> f64 {
        if a * d * LOG2_E > 126.0 {
            0.0
        } else {
            (-a * d).exp()
        }
    }
    /// How far the result moves, in its own size, when the optical depth is
    /// rounded: by that depth.
    fn steepness(a: f64, d: f64) -> f64 {
        (1.0 + a * d) * (-a * d).exp()
    }
    /// Around the threshold of underflow.
    fn threshold(a: f64, d: f64) -> bool {
        (a * d * LOG2_E - 126.0).abs() < 1e-3
    }
    let depths = [
        (0.0, 10.0),
        (1.0, 0.0),
        (1e-7, 1.0),
        (80.0, 1.0),
        (87.0, 1.0),
        (1e3, 1.0),
        (1e20, 1e15),
    ];

    vec![
        Kernel::new(
            MODULE,
            "medium_transmittance_scalar",
            ["absorption", "distance"],
            medium_transmittance_scalar,
            exact,
            (
                domains::log_range(1e-3, 10.0),
                domains::log_range(1e-3, 10.0),
            ),
        )
        .scale_by(steepness)
        .undecided(threshold)
        .few_ulp(2.0, 3.75)
        .hard(depths)
        .source(BEER)
        .baseline(
            "built-in exp",
            "fn baseline(absorption: f32, distance: f32) -> f32 {
                return exp(-absorption * distance);
            }",
            |absorption: f32, distance: f32| (-absorption * distance).exp(),
        )
        .build(),
        Kernel::new(
            MODULE,
            "medium_transmittance",
            ["absorption", "distance"],
            medium_transmittance,
            |a: DVec3, d: f64| DVec3::new(exact(a.x, d), exact(a.y, d), exact(a.z, d)),
            (
                domains::vec3(domains::range(0.0, 10.0)),
                domains::log_range(1e-3, 10.0),
            ),
        )
        // Of the clearest channel; the others are held by the scalar's contract.
        .scale_by(|a: DVec3, d: f64| steepness(a.min_element(), d))
        .undecided(|a: DVec3, d: f64| threshold(a.x, d) || threshold(a.y, d) || threshold(a.z, d))
        .few_ulp(2.0, 3.75)
        .hard(
            depths
                .into_iter()
                .map(|(a, d)| (Vec3::splat(a), d))
                .chain([(Vec3::new(0.0, 1e-7, 80.0), 1.0)]),
        )
        .source(BEER)
        .build(),
        Kernel::new(
            MODULE,
            "medium_cauchy_eta",
            ["a", "b", "wavelength_um"],
            medium_cauchy_eta,
            |a: f64, b: f64, l: f64| a + b / (l * l),
            (
                domains::range(1.0, 2.5),
                domains::range(0.0, 0.05),
                domains::range(0.3, 1.0),
            ),
        )
        .few_ulp(1.25, 2.25)
        .hard([(1.5046, 0.0042, 0.5876), (1.0, 0.0, 0.38), (1.7, 0.05, 0.3)])
        .source("Cauchy's equation, two terms")
        .build(),
    ]
}
