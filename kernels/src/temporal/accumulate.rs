//! Temporal accumulation: the pair and its contract.

pub use raytwin_cpu::temporal::accumulate::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::temporal::ACCUMULATE;

#[cfg(feature = "contract")]
use glam::{DVec2, DVec3, Vec2, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(TemporalAccumulateState {
    mean: f32,
    variance: f32,
    history: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(TemporalAccumulateRgbState {
    color: Vec3,
    mean_luminance: f32,
    variance: f32,
    history: f32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};

    const MODULE: &str = "temporal/accumulate";
    const SVGF: &str = "Schied et al. 2017, section 4.1";
    const MOMENTS: &str = "West 1979; Finch 2009, section 9";
    const OURS: &str = "ours: by bit pattern";
    const NOT_A_NUMBER: &str = "WGSL defines no f32 parameter that holds a NaN, so no table \
                                covers this signature; the tests are on bits and exact";
    const BAD: [f32; 6] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -1e30,
        2e15,
    ];
    type Wide = (f64, f64, f64);
    type WideRgb = (DVec3, f64, f64, f64);

    // 1e15, 4e30 and 2^24 as the f32 next to them.
    fn small(x: f64) -> bool {
        x.abs() <= f64::from(1e15f32)
    }
    fn sound(mean: f64, variance: f64, history: f64) -> bool {
        small(mean) && variance.abs() <= f64::from(4e30f32) && history.abs() <= 2f64.powi(24)
    }
    fn guarded((mean, variance, history): Wide) -> Wide {
        if sound(mean, variance, history) {
            (mean, variance.max(0.0), history.max(0.0))
        } else {
            (0.0, 0.0, 0.0)
        }
    }
    fn guarded_rgb((color, mean, variance, history): WideRgb) -> WideRgb {
        if color.to_array().into_iter().all(small) && sound(mean, variance, history) {
            (color, mean, variance.max(0.0), history.max(0.0))
        } else {
            (DVec3::ZERO, 0.0, 0.0, 0.0)
        }
    }
    fn longer(history: f64, cap: f64) -> f64 {
        if history < 1.0 {
            1.0
        } else {
            (history + 1.0).min(cap.max(1.0))
        }
    }
    // As one pool of h samples: sums of all weights, not steps from the mean.
    fn pooled(mean: f64, x: f64, h: f64) -> f64 {
        (mean * (h - 1.0) + x) / h
    }
    // Distances of both parts from the new mean.
    fn pooled_variance(mean: f64, variance: f64, x: f64, h: f64) -> f64 {
        let rest = (h - 1.0) / h;
        let (old, new) = ((x - mean) / h, (x - mean) * rest);
        rest * (variance + old * old) + new * new / h
    }
    fn plain_step(s: TemporalAccumulateState, x: f32, cap: f32) -> TemporalAccumulateState {
        let history = (s.history + 1.0).min(cap);
        let alpha = 1.0 / history;
        let square = s.variance + s.mean * s.mean;
        let mean = s.mean * (1.0 - alpha) + x * alpha;
        let moment = square * (1.0 - alpha) + (x * x) * alpha;
        TemporalAccumulateState {
            mean,
            variance: (moment - mean * mean).max(0.0),
            history,
        }
    }

    let length = || {
        domains::log_range(0.25, 1e5)
            .and(domains::below(8))
            .map(|(x, kind)| match kind {
                0 => 0.0,
                // Mostly whole numbers; reprojection gives others.
                1..=4 => x.round(),
                _ => x,
            })
    };
    let cap = || {
        domains::log_range(2.0, 4096.0)
            .and(domains::below(8))
            .map(|(x, kind)| match kind {
                0 => 1.0,
                1 => x,
                _ => x.round(),
            })
    };
    let value = || domains::log_range(1e-5, 1e5);
    let state = || -> Domain<TemporalAccumulateState> {
        (value().and(domains::log_range(1e-8, 1e9)).and(length())).map(
            |((mean, variance), history)| TemporalAccumulateState {
                mean,
                variance,
                history,
            },
        )
    };
    let broken = |good: Domain<f32>| {
        good.and(domains::below(24))
            .map(|(x, kind)| match kind as usize {
                k if k < BAD.len() => BAD[k],
                6 => -x,
                _ => x,
            })
    };
    let state_of = |mean: f32, variance: f32, history: f32| TemporalAccumulateState {
        mean,
        variance,
        history,
    };
    let rgb_of = |color: Vec3, mean: f32, variance: f32, history: f32| TemporalAccumulateRgbState {
        color,
        mean_luminance: mean,
        variance,
        history,
    };
    let unit_color = || domains::vec3(domains::range(0.0, 1.0));
    let rgb_state = unit_color()
        .and(domains::range(0.0, 1.0))
        .and(domains::range(0.0, 0.25))
        .and(length())
        .map(
            |(((color, mean_luminance), variance), history)| TemporalAccumulateRgbState {
                color,
                mean_luminance,
                variance,
                history,
            },
        );

    vec![
        Kernel::new(
            MODULE,
            "temporal_accumulate_usable",
            ["value", "largest"],
            temporal_accumulate_usable,
            |value: f64, largest: f64| u32::from(value.abs() <= largest),
            (broken(value()), domains::log_range(1.0, 1e15)),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(BAD.map(|b| (b, 1e15)))
        .hard([
            (0.0, 0.0),
            (-0.0, 1.0),
            (1e15, 1e15),
            (-1e15, 1e15),
            (1e15f32.next_up(), 1e15),
            (f32::MIN_POSITIVE, 0.0),
            (f32::from_bits(0x7f80_0001), f32::MAX),
            (f32::MAX, f32::MAX),
        ])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_history",
            ["history", "cap"],
            temporal_accumulate_history,
            longer,
            (length(), cap()),
        )
        .few_ulp(0.5, 0.75)
        .hard([
            (0.0, 32.0),
            (0.5, 32.0),
            (0.99999994, 32.0),
            (1.0, 32.0),
            (31.0, 32.0),
            (32.0, 32.0),
            (500.0, 32.0),
            (3.0, 0.0),
            (0.0, 0.0),
            (16777216.0, 3e7),
        ])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_alpha",
            ["history", "cap"],
            temporal_accumulate_alpha,
            |history: f64, cap: f64| {
                if history > 1.0 && cap > 1.0 {
                    (1.0 / history).max(1.0 / cap)
                } else {
                    1.0
                }
            },
            (length(), cap()),
        )
        .few_ulp(0.5, 2.5)
        .hard([
            (0.0, 5.0),
            (1.0, 5.0),
            (3.0, 5.0),
            (5.0, 5.0),
            (1e7, 5.0),
            (7.0, 0.0),
            (16777216.0, 16777216.0),
        ])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_mean",
            ["mean", "sample", "alpha"],
            temporal_accumulate_mean,
            |mean: f64, x: f64, alpha: f64| mean * (1.0 - alpha) + x * alpha,
            (
                domains::signed_log_range(1e-5, 1e5),
                domains::signed_log_range(1e-5, 1e5),
                domains::unit(),
            ),
        )
        // Of different signs: absolute in the larger.
        .scale_by(|mean: f64, x: f64, _: f64| {
            if mean * x < 0.0 {
                mean.abs().max(x.abs())
            } else {
                f64::from(f32::MIN_POSITIVE)
            }
        })
        .few_ulp(2.0, 4.0)
        .hard([
            (0.1, 0.1, 0.3),
            (1e15, 1e15, 0.7),
            (0.0, 0.0, 0.5),
            (1e4, 0.0, 0.99999994),
            (0.0, 1e4, 5.9604645e-8),
            (1e-5, 1e5, 0.5),
            (1e5, 1e-5, 0.50000006),
            (3.0, 7.0, 1.0),
            (3.0, 7.0, 0.0),
            (-1.0, 1.0, 0.5),
            (-1e15, 1e15, 0.25),
        ])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_variance",
            ["variance", "difference", "alpha"],
            temporal_accumulate_variance,
            |v: f64, d: f64, alpha: f64| {
                // Distances of the old mean and of the sample from the new one.
                let (old, new) = (alpha * d, (1.0 - alpha) * d);
                (1.0 - alpha) * (v + old * old) + alpha * (new * new)
            },
            (
                domains::log_range(1e-8, 1e9),
                domains::signed_log_range(1e-5, 1e5),
                domains::unit(),
            ),
        )
        .few_ulp(3.25, 6.25)
        .hard([
            (0.0, 0.0, 0.2),
            (0.0, 1.0, 0.5),
            (1.0, 0.0, 0.5),
            (7.0, 3.0, 1.0),
            (7.0, 3.0, 0.0),
            (7.0, 3.0, 0.99999994),
            (1e30, 2e15, 0.5),
            (1e-30, 1e-15, 0.001),
        ])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_guard",
            ["state"],
            temporal_accumulate_guard,
            guarded,
            (broken(value())
                .and(broken(domains::log_range(1e-8, 1e9)))
                .and(broken(length()))
                .map(|((mean, variance), history)| TemporalAccumulateState {
                    mean,
                    variance,
                    history,
                }),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(BAD.map(|b| (state_of(b, 1.0, 4.0),)))
        .hard(
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX]
                .map(|b| (state_of(1.0, b, 4.0),)),
        )
        .hard(BAD.map(|b| (state_of(1.0, 1.0, b),)))
        .hard([
            (TEMPORAL_ACCUMULATE_EMPTY,),
            (state_of(1.0, -1e-6, 4.0),),
            (state_of(1.0, 1.0, -3.0),),
            (state_of(-1e15, 4e30, 16777216.0),),
        ])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_step",
            ["state", "sample", "cap"],
            temporal_accumulate_step,
            |state: Wide, x: f64, cap: f64| {
                let (mean, variance, history) = guarded(state);
                if !small(x) {
                    return (mean, variance, history);
                }
                let h = longer(history, cap);
                (pooled(mean, x, h), pooled_variance(mean, variance, x, h), h)
            },
            (state(), value(), cap()),
        )
        .few_ulp(5.0, 15.0)
        .hard([
            (TEMPORAL_ACCUMULATE_EMPTY, 3.3, 32.0),
            (TEMPORAL_ACCUMULATE_EMPTY, 0.0, 32.0),
            (TEMPORAL_ACCUMULATE_EMPTY, 1e15, 1.0),
            (state_of(0.1, 0.0, 7.0), 0.1, 32.0),
            (state_of(65000.0, 0.0, 32.0), 65000.0, 32.0),
            (state_of(1e4, 1e-6, 1024.0), 10000.001, 1024.0),
            (state_of(0.0, 0.0, 5.0), 1e4, 5.0),
            (state_of(1e4, 1e8, 5.0), 0.0, 5.0),
            (state_of(1.0, 1.0, 0.7), 2.0, 5.0),
            (state_of(1.0, 1.0, 1e6), 2.0, 1e6),
            // Samples that are left out, histories that count as none.
            (state_of(1.0, 0.5, 4.0), 1e30, 5.0),
            (state_of(1e30, 0.5, 4.0), 2.0, 5.0),
            (state_of(1.0, -0.5, -4.0), 2.0, 5.0),
        ])
        .source(MOMENTS)
        .baseline(
            "plain moments, E[x^2] - E[x]^2",
            "fn baseline(s: TemporalAccumulateState, x: f32, cap: f32) -> TemporalAccumulateState {
                let history = min(s.history + 1.0, cap);
                let alpha = 1.0 / history;
                let square = s.variance + s.mean * s.mean;
                let mean = s.mean * (1.0 - alpha) + x * alpha;
                let moment = square * (1.0 - alpha) + (x * x) * alpha;
                return TemporalAccumulateState(mean, max(moment - mean * mean, 0.0), history);
            }",
            plain_step,
        )
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_rgb_guard",
            ["state"],
            temporal_accumulate_rgb_guard,
            guarded_rgb,
            (domains::vec3(broken(value()))
                .and(broken(value()))
                .and(broken(domains::log_range(1e-8, 1e9)))
                .and(length())
                .map(|(((color, mean_luminance), variance), history)| {
                    TemporalAccumulateRgbState {
                        color,
                        mean_luminance,
                        variance,
                        history,
                    }
                }),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(BAD.map(|b| (rgb_of(Vec3::new(1.0, b, 1.0), 1.0, 1.0, 4.0),)))
        .hard(BAD.map(|b| (rgb_of(Vec3::ONE, b, 1.0, 4.0),)))
        .hard([
            (TEMPORAL_ACCUMULATE_RGB_EMPTY,),
            (rgb_of(Vec3::ONE, 1.0, f32::NAN, 4.0),),
            (rgb_of(Vec3::ONE, 1.0, 1.0, f32::NAN),),
            (rgb_of(Vec3::ONE, 1.0, -1.0, -4.0),),
        ])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_rgb_step",
            ["state", "sample", "cap", "moments_cap"],
            temporal_accumulate_rgb_step,
            |state: WideRgb, c: DVec3, cap: f64, moments_cap: f64| {
                let (color, mean, variance, history) = guarded_rgb(state);
                if !c.to_array().into_iter().all(small) {
                    return (color, mean, variance, history);
                }
                let h = longer(history, cap.max(moments_cap));
                let (of_color, of_moments) = (h.min(cap.max(1.0)), h.min(moments_cap.max(1.0)));
                let light = c.dot(DVec3::new(0.2126, 0.7152, 0.0722));
                (
                    DVec3::new(
                        pooled(color.x, c.x, of_color),
                        pooled(color.y, c.y, of_color),
                        pooled(color.z, c.z, of_color),
                    ),
                    pooled(mean, light, of_moments),
                    pooled_variance(mean, variance, light, of_moments),
                    h,
                )
            },
            (rgb_state, unit_color(), cap(), cap()),
        )
        // Colours are in [0, 1] here; other exposures differ by a factor.
        .scale(1.0)
        .few_ulp(1.0, 2.75)
        .hard([
            (TEMPORAL_ACCUMULATE_RGB_EMPTY, Vec3::ONE, 32.0, 5.0),
            (TEMPORAL_ACCUMULATE_RGB_EMPTY, Vec3::ZERO, 32.0, 5.0),
            (
                rgb_of(Vec3::splat(0.1), 0.1, 0.0, 32.0),
                Vec3::splat(0.1),
                32.0,
                5.0,
            ),
            (rgb_of(Vec3::ZERO, 0.0, 0.0, 32.0), Vec3::ONE, 32.0, 5.0),
            (rgb_of(Vec3::X, 0.2126, 0.1, 3.0), Vec3::Z, 1.0, 32.0),
            (rgb_of(Vec3::ONE, 1.0, 0.1, 0.4), Vec3::ZERO, 8.0, 8.0),
            (
                rgb_of(Vec3::ONE, 0.5, 0.1, 4.0),
                Vec3::new(0.1, 1e30, 0.1),
                8.0,
                8.0,
            ),
            (
                rgb_of(Vec3::ONE, 1e30, 0.1, 4.0),
                Vec3::splat(0.5),
                8.0,
                8.0,
            ),
        ])
        .source(MOMENTS)
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_squares",
            ["squares", "alpha"],
            temporal_accumulate_squares,
            |s: f64, alpha: f64| (1.0 - alpha).powi(2) * s + alpha.powi(2),
            (domains::log_range(1e-5, 1.0), domains::unit()),
        )
        .few_ulp(2.0, 4.0)
        .hard([(1.0, 0.5), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1e-7, 1e-7)])
        .source("Kish 1965")
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_unbiased",
            ["variance", "squares"],
            temporal_accumulate_unbiased,
            |v: f64, s: f64| if s >= 1.0 { 0.0 } else { v / (1.0 - s) },
            (domains::log_range(1e-8, 1e9), domains::unit()),
        )
        .few_ulp(1.25, 3.5)
        .hard([
            (1.0, 1.0),
            (1.0, 2.0),
            (1.0, 0.99999994),
            (0.0, 0.5),
            (4e30, 0.111),
            (1.0, 0.0),
        ])
        .source("Kish 1965")
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_plain_moments",
            ["moments", "sample", "alpha"],
            temporal_accumulate_plain_moments,
            |m: DVec2, x: f64, alpha: f64| m * (1.0 - alpha) + DVec2::new(x, x * x) * alpha,
            (
                value()
                    .and(domains::log_range(1.0, 10.0))
                    .map(|(m, spread)| Vec2::new(m, m * m * spread)),
                value(),
                domains::unit(),
            ),
        )
        .few_ulp(2.75, 5.75)
        .hard([
            (Vec2::ZERO, 0.0, 0.5),
            (Vec2::ZERO, 300.0, 0.2),
            (Vec2::new(1e4, 1e8), 1e4, 0.2),
            (Vec2::new(1e4, 1e8), 0.0, 1.0),
        ])
        .source("Schied et al. 2017, equation 3")
        .build(),
        Kernel::new(
            MODULE,
            "temporal_accumulate_plain_variance",
            ["moments"],
            temporal_accumulate_plain_variance,
            |m: DVec2| (m.y - m.x * m.x).max(0.0),
            (value()
                .and(domains::log_range(1.0, 10.0))
                .map(|(m, spread)| Vec2::new(m, m * m * spread)),),
        )
        // It cancels: the error is absolute, in the mean of the squares.
        .scale_by(|m: DVec2| m.y.max(1e-30))
        .few_ulp(1.0, 1.25)
        .hard(
            [
                Vec2::ZERO,
                Vec2::new(1e4, 1e8),
                Vec2::new(1e4, 99999990.0),
                Vec2::new(0.1, 0.01),
                Vec2::new(0.0, 1.0),
            ]
            .map(|m| (m,)),
        )
        .source("Schied et al. 2017, equation 3")
        .build(),
    ]
}
