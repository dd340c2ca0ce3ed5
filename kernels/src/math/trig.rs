//! Sine, cosine and angle in turns: the pair and its contract.

pub use raytwin_cpu::math::trig::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::math::TRIG;

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use glam::{DVec2, Vec2};

    const SOURCE: &str = "Cody and Waite 1980, ch. 8 and 11; own minimax coefficients";
    const PI: f64 = std::f64::consts::PI;

    // Reduced exactly before the library sees it: near a zero of the sine,
    // 2πu rounded to f64 would be the larger error.
    let sincos = |u: f64| {
        let quarter = (4.0 * u).round();
        let rest = (u - 0.25 * quarter) * 2.0 * PI;
        let (s, c) = rest.sin_cos();
        match quarter.rem_euclid(4.0) as u32 {
            0 => DVec2::new(s, c),
            1 => DVec2::new(c, -s),
            2 => DVec2::new(-s, -c),
            _ => DVec2::new(-c, s),
        }
    };
    let turns = domains::unit()
        .and(domains::signed_log_range(1e-7, 1_048_576.0))
        .map(|(u, far)| (if u < 0.75 { u * (4.0 / 3.0) } else { far },));
    let plane = domains::signed_log_range(1e-6, 1e6);

    vec![
        Kernel::new(
            "math/trig",
            "sincos_turn",
            ["u"],
            sincos_turn,
            sincos,
            turns,
        )
        .few_ulp(1.5, 3.0)
        .hard(
            [
                0.0,
                -0.0,
                0.125,
                0.12499999,
                0.12500001,
                0.25,
                0.375,
                0.5,
                0.625,
                0.75,
                0.875,
                0.99999994,
                1.0,
                -0.125,
                -1.0,
                1e-30,
                1_048_576.0,
                1_048_575.9,
                -1_048_576.0,
            ]
            .map(|u| (u,)),
        )
        .source(SOURCE)
        .baseline(
            "built-in sin, cos of 2πu",
            "fn baseline(u: f32) -> vec2f { let a = 6.2831855 * u; return vec2f(sin(a), cos(a)); }",
            |u: f32| {
                let a = 6.283_185_5 * u;
                Vec2::new(a.sin(), a.cos())
            },
        )
        .build(),
        Kernel::new(
            "math/trig",
            "atan2_turn",
            ["y", "x"],
            atan2_turn,
            // Adding zero turns -0 into 0: the origin's angle is 0.
            |y: f64, x: f64| ((y + 0.0).atan2(x + 0.0) / (2.0 * PI)).rem_euclid(1.0),
            (plane.clone(), plane),
        )
        .few_ulp(1.0, 1.5)
        .scale(0.5)
        .undecided(|y: f64, x: f64| x > 0.0 && y < 0.0 && y.atan2(x).abs() < 1e-6)
        .hard([
            (0.0, 0.0),
            (0.0, 1.0),
            (-0.0, 1.0),
            (0.0, -1.0),
            (1.0, 0.0),
            (-1.0, 0.0),
            (1.0, 1.0),
            (1.0, -1.0),
            (-1.0, -1.0),
            (-1.0, 1.0),
            (0.41421357, 1.0),
            (0.4142136, 1.0),
            (1e18, 1e-18),
            (1e-18, 1e18),
            (1.0000001, 1.0),
        ])
        .source(SOURCE)
        .baseline(
            "built-in atan2 over 2π",
            "fn baseline(y: f32, x: f32) -> f32 {
                let t = atan2(y, x) * 0.15915494;
                return select(t, t + 1.0, t < 0.0);
            }",
            |y: f32, x: f32| {
                let t = y.atan2(x) * 0.159_154_94;
                if t < 0.0 { t + 1.0 } else { t }
            },
        )
        .build(),
    ]
}
