//! Energy compensation for GGX: the pair and its contract.

pub use raytwin_cpu::brdf::compensation::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::brdf::COMPENSATION;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec3, Vec3};

    const MODULE: &str = "brdf/compensation";
    /// Of `(√t - 1/2)^i (alpha² - 1/2)^j` in row `i`, column `j`.
    const FIT: [[f32; 3]; 5] = [
        [1.5838451, 2.1568155, -0.6933848],
        [-0.048463564, -1.1377293, 0.6492186],
        [6.0199094, 5.0317416, -11.384926],
        [5.047814, 9.75618, -28.203835],
        [-3.2352748, 67.391525, 138.04222],
    ];

    /// The fit as a sum of powers. How near it is to the albedo is a unit test
    /// of the CPU twin, by quadrature.
    fn albedo(alpha: f64, cos: f64) -> f64 {
        let cos = cos.clamp(0.0, 1.0);
        let t = cos / (alpha + cos);
        let (x, y) = (t.sqrt() - 0.5, alpha.powi(2) - 0.5);
        let mut p = 0.0;
        for (i, row) in (0..).zip(FIT) {
            for (j, c) in (0..).zip(row) {
                p += f64::from(c) * x.powi(i) * y.powi(j);
            }
        }
        (f64::from(1.0053f32) - t * (1.0 - t) * p).min(1.0)
    }

    let near = 1.745_329e-4;
    vec![
        Kernel::new(
            MODULE,
            "compensation_albedo",
            ["alpha", "cos"],
            compensation_albedo,
            albedo,
            (
                domains::log_range(1e-4, 1.0)
                    .and(domains::range(1e-4, 1.0))
                    .and(domains::below(2))
                    .map(|((log, even), pick)| if pick == 0 { log } else { even }),
                domains::range(0.0, 1.0)
                    .and(domains::log_range(1e-5, 1.0))
                    .and(domains::below(4))
                    .map(|((even, log), pick)| if pick == 3 { log } else { even }),
            ),
        )
        .few_ulp(9.0, 34.0)
        .hard([
            (1e-4, 0.0),
            (1e-4, near),
            (1e-4, 1.0),
            (0.01, near),
            (0.5, near),
            (1.0, 0.0),
            (1.0, 1.0),
            (1.0, 1.000_000_1),
            (0.25, 0.258_819),
        ])
        .source("Turquin 2019, Practical multiple scattering compensation; our own fit")
        .build(),
        Kernel::new(
            MODULE,
            "compensation_factor",
            ["f0", "albedo"],
            compensation_factor,
            |f0: DVec3, albedo: f64| DVec3::ONE + f0 * ((1.0 - albedo) / albedo),
            (
                domains::vec3(domains::range(0.0, 1.0)),
                domains::range(0.3, 1.0),
            ),
        )
        .few_ulp(2.0, 4.0)
        .hard([
            (Vec3::ONE, 1.0),
            (Vec3::ZERO, 0.3),
            (Vec3::new(1.0, 0.78, 0.34), 0.306_85),
            (Vec3::ONE, 0.999_999_94),
        ])
        .source("Turquin 2019, Practical multiple scattering compensation")
        .build(),
    ]
}
