//! Exponential, logarithm and power: the pair and its contract.

pub use raytwin_cpu::math::exponent::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::math::EXPONENT;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};

    const SOURCE: &str = "Cody and Waite 1980, ch. 6 and 5; own minimax coefficients";

    vec![
        Kernel::new(
            "math/exponent",
            "exp2_poly",
            ["x"],
            exp2_poly,
            |x: f64| match x {
                x if x < -126.0 => 0.0,
                x if x >= 128.0 => f64::from(f32::MAX),
                x => x.exp2(),
            },
            (domains::range(-130.0, 130.0),),
        )
        .few_ulp(1.25, 2.0)
        .hard(
            [
                0.0, -0.0, 0.5, -0.5, 0.49999997, 0.50000006, 1.0, -126.0, -126.00001, 127.0,
                127.5, 127.49999, 127.99999, 128.0, 1e30, -1e30, 1e-30,
            ]
            .map(|x| (x,)),
        )
        .source(SOURCE)
        .baseline(
            "built-in exp2",
            "fn baseline(x: f32) -> f32 { return exp2(x); }",
            |x: f32| x.exp2(),
        )
        .build(),
        Kernel::new(
            "math/exponent",
            "log2_poly",
            ["x"],
            log2_poly,
            |x: f64| {
                if x < f64::from(f32::MIN_POSITIVE) {
                    -127.0
                } else {
                    x.log2()
                }
            },
            (domains::log_range(1.2e-38, 3e38)
                .and(domains::range(0.5, 2.0))
                .and(domains::unit())
                .map(|((far, near), u)| if u < 0.5 { near } else { far }),),
        )
        .few_ulp(2.25, 3.5)
        .hard(
            [
                1.0,
                0.99999994,
                1.0000001,
                std::f32::consts::SQRT_2,
                1.4142137,
                1.4142134,
                std::f32::consts::FRAC_1_SQRT_2,
                f32::MIN_POSITIVE,
                f32::MAX,
                0.0,
                -1.0,
                2.0,
                0.5,
            ]
            .map(|x| (x,)),
        )
        .source(SOURCE)
        .baseline(
            "built-in log2",
            "fn baseline(x: f32) -> f32 { return log2(x); }",
            |x: f32| x.log2(),
        )
        .build(),
        Kernel::new(
            "math/exponent",
            "pow_poly",
            ["x", "y"],
            pow_poly,
            |x: f64, y: f64| match (x, y) {
                (_, 0.0) => 1.0,
                (0.0, _) => 0.0,
                // As documented: what would be subnormal is zero.
                (x, y) if y * x.log2() < -126.0 => 0.0,
                (x, y) => x.powf(y),
            },
            (domains::range(0.0, 1.0), domains::range(0.0, 16.0)),
        )
        // The exponent's absolute error is the result's relative error.
        .scale_by(|x: f64, y: f64| {
            let size = if x > 0.0 { (y * x.log2()).abs() } else { 0.0 };
            x.powf(y) * (1.0 + size)
        })
        .undecided(|x: f64, y: f64| x > 0.0 && (y * x.log2() + 126.0).abs() < 1e-3)
        .few_ulp(2.25, 4.0)
        .hard([
            (0.0, 0.0),
            (0.0, 2.0),
            (1.0, 5.0),
            (0.5, 1.0),
            (0.99999994, 16.0),
            (1e-6, 0.01),
            (0.25, 0.5),
        ])
        .source(SOURCE)
        .baseline(
            "built-in pow",
            "fn baseline(x: f32, y: f32) -> f32 { return pow(x, y); }",
            |x: f32, y: f32| x.powf(y),
        )
        .build(),
    ]
}
