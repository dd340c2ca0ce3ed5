//! The multiscale mean estimator: the pair and its contract.

pub use raytwin_cpu::temporal::multiscale_mean::*;

/// The WGSL twin.
pub const WGSL: &str = raytwin_wgsl::temporal::MULTISCALE_MEAN;

#[cfg(feature = "contract")]
use glam::{DVec3, UVec4, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(MultiscaleMeanState {
    mean: f32,
    short_mean: f32,
    vbbr: f32,
    variance: f32,
    inconsistency: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(MultiscaleMeanRgbState {
    mean: Vec3,
    short_mean: Vec3,
    vbbr: f32,
    variance: Vec3,
    inconsistency: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(MultiscaleMeanRobustState {
    mean: f32,
    short_mean: f32,
    excess: f32,
    variance: f32,
    inconsistency: f32,
    length: f32,
    age: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(MultiscaleMeanRobustRgbState {
    mean: Vec3,
    short_mean: Vec3,
    excess: Vec3,
    variance: Vec3,
    inconsistency: f32,
    length: f32,
    age: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(MultiscaleMeanRobustRgbPacked {
    mean_x: u32,
    mean_y: u32,
    mean_z: u32,
    excess_x: u32,
    excess_y: u32,
    excess_z: u32,
    spread_x: u32,
    spread_y: u32,
    spread_z: u32,
    counts: u32,
});

/// The exact estimators, over a list of channels.
#[cfg(feature = "contract")]
mod exact {
    use super::DVec3;

    /// Weights of one channel, and of red, green and blue.
    pub const ONE: [f64; 1] = [1.0];
    pub const LUMA: [f64; 3] = [0.299, 0.587, 0.114];

    /// A weighted sum, not a step.
    fn blend(from: f64, to: f64, t: f64) -> f64 {
        from * (1.0 - t) + to * t
    }

    /// `3x² - 2x³` up to 1.
    pub fn smooth(x: f64) -> f64 {
        let x = x.clamp(0.0, 1.0);
        3.0 * x.powi(2) - 2.0 * x.powi(3)
    }

    pub fn printed_blend(relative: f64, inconsistency: f64) -> f64 {
        smooth(relative * (inconsistency - 0.2).max(0.02)).max(1.0 / 256.0)
    }

    pub fn robust_blend(relative: f64, inconsistency: f64, reduction: f64) -> f64 {
        reduction * smooth(relative * (inconsistency - 2.125).max(0.0) * 11.0 / 32.0)
    }

    #[derive(Clone, Copy)]
    pub struct Printed<const N: usize> {
        pub mean: [f64; N],
        pub short: [f64; N],
        pub vbbr: f64,
        pub variance: [f64; N],
        pub inconsistency: f64,
    }

    fn printed_parts<const N: usize>(
        s: &Printed<N>,
        sample: [f64; N],
        a: f64,
    ) -> ([f64; N], [f64; N], [f64; N]) {
        let y: [f64; N] = std::array::from_fn(|k| {
            sample[k].min(0.1 + s.short[k] + 8.0 * s.variance[k].max(1e-5).sqrt())
        });
        let short: [f64; N] = std::array::from_fn(|k| blend(s.short[k], y[k], a));
        let variance = std::array::from_fn(|k| {
            blend(
                s.variance[k],
                (y[k] - s.short[k]) * (y[k] - short[k]),
                a / 2.0,
            )
        });
        (y, short, variance)
    }

    pub fn printed<const N: usize>(
        s: &Printed<N>,
        sample: [f64; N],
        a: f64,
        weights: [f64; N],
    ) -> Printed<N> {
        let (y, short, variance) = printed_parts(s, sample, a);
        let (mut relative, mut reduction) = (0.0, 0.0);
        for k in 0..N {
            let deviation = variance[k].max(1e-5).sqrt();
            relative += weights[k] * (s.mean[k] - short[k]).abs() / deviation;
            reduction += weights[k] * short[k] / (2.0 * deviation);
        }
        let inconsistency = blend(s.inconsistency, relative, 0.08);
        let c = (printed_blend(relative, inconsistency) * s.vbbr).clamp(0.0, 1.0);
        Printed {
            mean: std::array::from_fn(|k| blend(s.mean[k], y[k], c)),
            short,
            vbbr: blend(s.vbbr, reduction.clamp(1.0 / 32.0, 1.0), 0.1),
            variance,
            inconsistency,
        }
    }

    /// How many ULP of 1 a result moves when its arguments round, about: the
    /// averages over their deviation, through the weight to the mean.
    pub fn printed_scale<const N: usize>(
        s: &Printed<N>,
        sample: [f64; N],
        a: f64,
        weights: [f64; N],
    ) -> f64 {
        let (y, short, variance) = printed_parts(s, sample, a);
        let (mut relative, mut error, mut move_by, mut size) = (0.0, 0.0, 0.0f64, 1.0f64);
        for k in 0..N {
            let deviation = variance[k].max(1e-5).sqrt();
            // The listing clamps by taking the overflow away, which leaves the
            // rounding of the sample itself.
            let value = s.mean[k].abs().max(short[k].abs()).max(sample[k].abs());
            let apart = (s.mean[k] - short[k]).abs() / deviation;
            relative += weights[k] * apart;
            // The deviation errs as well: half as much as the variance, whose
            // term is the rounded distance from the mean, squared.
            let of_variance = (y[k] - s.short[k]).abs() * value * a / variance[k].max(1e-5);
            error += weights[k] * (value / deviation + apart * of_variance);
            move_by = move_by.max((y[k] - s.mean[k]).abs());
            size = size.max(value).max(variance[k]).max(a * value * value);
        }
        let inconsistency = blend(s.inconsistency, relative, 0.08);
        let lead = (inconsistency - 0.2).max(0.02);
        let slope = if relative * lead > 1.01 {
            0.0
        } else {
            1.5 * (lead + 0.08 * relative) * s.vbbr
        };
        size.max(relative).max(error).max(error * slope * move_by)
    }

    #[derive(Clone, Copy)]
    pub struct Robust<const N: usize> {
        pub mean: [f64; N],
        pub short: [f64; N],
        pub excess: [f64; N],
        pub variance: [f64; N],
        pub inconsistency: f64,
        pub length: f64,
        pub age: f64,
    }

    // 1e15 and 4e30 as the f32 next to them.
    fn within(values: &[f64], largest: f32) -> bool {
        values.iter().all(|x| x.abs() <= f64::from(largest))
    }

    pub fn guarded<const N: usize>(s: &Robust<N>) -> Robust<N> {
        let sound = within(&s.mean, 1e15)
            && within(&s.short, 1e15)
            && within(&s.excess, 1e15)
            && within(&s.variance, 4e30)
            && within(&[s.inconsistency, s.length, s.age], 16777216.0);
        if !sound {
            return Robust {
                mean: [0.0; N],
                short: [0.0; N],
                excess: [0.0; N],
                variance: [0.0; N],
                inconsistency: 0.0,
                length: 0.0,
                age: 0.0,
            };
        }
        let positive = |x: [f64; N]| x.map(|x| x.max(0.0));
        Robust {
            excess: positive(s.excess),
            variance: positive(s.variance),
            inconsistency: s.inconsistency.max(0.0),
            length: s.length.max(0.0),
            age: s.age.max(0.0),
            ..*s
        }
    }

    struct Parts<const N: usize> {
        clipped: [f64; N],
        relative: f64,
        inconsistency: f64,
        catch_up: f64,
        reduction: f64,
        error: f64,
    }

    fn parts<const N: usize>(
        s: &Robust<N>,
        sample: [f64; N],
        a: f64,
        weights: [f64; N],
    ) -> Parts<N> {
        let spread = (a / (2.0 - a) + 0.5 / (2.0 * s.length.max(1.0) - 1.0)).sqrt();
        let (mut relative, mut reduction, mut error) = (0.0, 0.0, 0.0);
        let mut clipped = sample;
        for k in 0..N {
            let value = s.mean[k].abs().max(s.short[k].abs());
            let deviation = s.variance[k].sqrt().max(value / 256.0);
            if deviation > 0.0 {
                relative += weights[k] * (s.mean[k] - s.short[k]).abs() / (deviation * spread);
                reduction += weights[k] * s.short[k].abs() / (2.0 * deviation);
                error += weights[k] * value / (deviation * spread);
            } else {
                reduction += weights[k] / 2.0;
            }
            let whole = s.short[k] + s.excess[k];
            clipped[k] = sample[k].min(whole + 0.1 * whole.abs() + 8.0 * deviation);
        }
        let inconsistency = blend(s.inconsistency, relative, a);
        let reduction = reduction.clamp(1.0 / 32.0, 1.0);
        Parts {
            clipped,
            relative,
            inconsistency,
            catch_up: robust_blend(relative, inconsistency, reduction),
            reduction,
            error,
        }
    }

    pub fn robust<const N: usize>(
        state: &Robust<N>,
        sample: [f64; N],
        a: f64,
        longest: f64,
        weights: [f64; N],
    ) -> Robust<N> {
        let s = guarded(state);
        if !within(&sample, 1e15) {
            return s;
        }
        if s.age < 1.0 {
            return Robust {
                mean: sample,
                short: sample,
                excess: [0.0; N],
                variance: [0.0; N],
                inconsistency: 0.0,
                length: 1.0,
                age: 1.0,
            };
        }
        let p = parts(&s, sample, a, weights);
        let y = p.clipped;
        let cap = longest.max(1.0);
        let (length, age) = ((s.length + 1.0).min(cap), (s.age + 1.0).min(cap));
        let of_short = a.max(1.0 / age);
        let short: [f64; N] = std::array::from_fn(|k| blend(s.short[k], y[k], of_short));
        Robust {
            mean: std::array::from_fn(|k| blend(s.mean[k], y[k], p.catch_up.max(1.0 / length))),
            short,
            excess: std::array::from_fn(|k| blend(s.excess[k], sample[k] - y[k], 1.0 / age)),
            variance: std::array::from_fn(|k| {
                let squared = (y[k] - s.short[k]) * (y[k] - short[k]);
                blend(s.variance[k], squared, (a / 2.0).max(1.0 / age))
            }),
            inconsistency: p.inconsistency,
            length: length.min(1.0 / p.catch_up),
            age,
        }
    }

    /// As [`printed_scale`].
    pub fn robust_scale<const N: usize>(
        state: &Robust<N>,
        sample: [f64; N],
        a: f64,
        longest: f64,
        weights: [f64; N],
    ) -> f64 {
        let s = guarded(state);
        if !within(&sample, 1e15) || s.age < 1.0 {
            return f64::from(f32::MIN_POSITIVE);
        }
        let p = parts(&s, sample, a, weights);
        let length = (s.length + 1.0).min(longest.max(1.0));
        let lead = (p.inconsistency - 2.125).max(0.0);
        let x = p.relative * lead * 11.0 / 32.0;
        let error = p.error.max(p.inconsistency);
        let slope = if x > 1.01 {
            0.0
        } else {
            0.52 * (lead + a * p.relative) * p.reduction
        };
        let weight = p.catch_up.max(1.0 / length);
        let (mut size, mut move_by): (f64, f64) = (1.0, 0.0);
        for (k, y) in sample.into_iter().enumerate() {
            let value = [s.mean[k], s.short[k], y, p.clipped[k]]
                .into_iter()
                .fold(0.0, |a: f64, b| a.max(b.abs()));
            move_by = move_by.max((p.clipped[k] - s.mean[k]).abs());
            let square = (p.clipped[k] - s.short[k]).abs() * value;
            size = size.max(value).max(square).max(s.variance[k]);
        }
        // The mean moves by the weight's error, the length by its square.
        let of_weight = error * slope;
        size.max(error)
            .max(of_weight * move_by)
            .max(of_weight / weight.powi(2))
            .max(length)
    }

    pub fn array(v: DVec3) -> [f64; 3] {
        v.to_array()
    }
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use exact::{LUMA, ONE, Printed, Robust};

    const MODULE: &str = "temporal/multiscale_mean";
    const LISTING: &str = "Ray Tracing Gems 2019, chapter 25, MultiscaleMeanEstimator";
    const OURS: &str = "ours, after Ray Tracing Gems 2019, chapter 25";
    const NOT_A_NUMBER: &str = "WGSL defines no f32 parameter that holds a NaN, so no table \
                                covers this signature; the tests are on bits and exact";
    const SMOOTH: [(&str, &str); 1] = [("multiscale_mean_smooth", "t")];
    const SMOOTH_WHY: &str = "t²(3 - 2t) rises with t over [0, 1]; plain intervals take \
                              its factors for independent, and miss that it is flat at 1";
    const BAD: [f32; 6] = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        -1e30,
        2e15,
    ];
    type WidePrinted = (f64, f64, f64, f64, f64);
    type WidePrintedRgb = (DVec3, DVec3, f64, DVec3, f64);
    type WidePacked = (u32, u32, u32, u32, u32, u32, u32, u32, u32, u32);
    type WideRobust = (f64, f64, f64, f64, f64, f64, f64);
    type WideRobustRgb = (DVec3, DVec3, DVec3, DVec3, f64, f64, f64);

    fn printed(s: WidePrinted) -> Printed<1> {
        Printed {
            mean: [s.0],
            short: [s.1],
            vbbr: s.2,
            variance: [s.3],
            inconsistency: s.4,
        }
    }
    fn printed_rgb(s: WidePrintedRgb) -> Printed<3> {
        Printed {
            mean: exact::array(s.0),
            short: exact::array(s.1),
            vbbr: s.2,
            variance: exact::array(s.3),
            inconsistency: s.4,
        }
    }
    fn robust(s: WideRobust) -> Robust<1> {
        Robust {
            mean: [s.0],
            short: [s.1],
            excess: [s.2],
            variance: [s.3],
            inconsistency: s.4,
            length: s.5,
            age: s.6,
        }
    }
    fn robust_rgb(s: WideRobustRgb) -> Robust<3> {
        Robust {
            mean: exact::array(s.0),
            short: exact::array(s.1),
            excess: exact::array(s.2),
            variance: exact::array(s.3),
            inconsistency: s.4,
            length: s.5,
            age: s.6,
        }
    }
    fn wide(s: Robust<1>) -> WideRobust {
        (
            s.mean[0],
            s.short[0],
            s.excess[0],
            s.variance[0],
            s.inconsistency,
            s.length,
            s.age,
        )
    }
    fn wide_rgb(s: Robust<3>) -> WideRobustRgb {
        (
            DVec3::from_array(s.mean),
            DVec3::from_array(s.short),
            DVec3::from_array(s.excess),
            DVec3::from_array(s.variance),
            s.inconsistency,
            s.length,
            s.age,
        )
    }

    let value = || domains::log_range(0.01, 10.0);
    let sample = || {
        value().and(domains::below(8)).map(|(x, kind)| match kind {
            0 => 0.0,
            1 => 30.0 * x,
            _ => x,
        })
    };
    let variance = || domains::log_range(1e-4, 10.0);
    let vec = |x: Domain<f32>| domains::vec3(x);
    let blend = || domains::range(0.02, 0.5);
    let frames = || {
        domains::range(1.0, 512.0)
            .and(domains::below(4))
            .map(|(x, kind)| if kind == 0 { x } else { x.round() })
    };
    let longest = || domains::range(2.0, 512.0);
    let printed_state = || -> Domain<MultiscaleMeanState> {
        (value().and(value()))
            .and(domains::range(0.03125, 1.0).and(variance()))
            .and(domains::range(0.0, 4.0))
            .map(
                |(((mean, short_mean), (vbbr, variance)), inconsistency)| MultiscaleMeanState {
                    mean,
                    short_mean,
                    vbbr,
                    variance,
                    inconsistency,
                },
            )
    };
    let printed_rgb_state = || -> Domain<MultiscaleMeanRgbState> {
        (vec(value()).and(vec(value())))
            .and(domains::range(0.03125, 1.0).and(vec(variance())))
            .and(domains::range(0.0, 4.0))
            .map(
                |(((mean, short_mean), (vbbr, variance)), inconsistency)| MultiscaleMeanRgbState {
                    mean,
                    short_mean,
                    vbbr,
                    variance,
                    inconsistency,
                },
            )
    };
    // Excess and counts as they occur: an excess is often 0.
    let excess = || {
        value()
            .and(domains::below(2))
            .map(|(x, kind)| if kind == 0 { 0.0 } else { x })
    };
    let robust_state = || -> Domain<MultiscaleMeanRobustState> {
        (value().and(value()))
            .and(excess().and(variance()))
            .and(domains::range(0.0, 8.0))
            .and(frames().and(frames()))
            .map(
                |((((mean, short_mean), (excess, variance)), inconsistency), (length, age))| {
                    MultiscaleMeanRobustState {
                        mean,
                        short_mean,
                        excess,
                        variance,
                        inconsistency,
                        length,
                        age,
                    }
                },
            )
    };
    let robust_rgb_state = || -> Domain<MultiscaleMeanRobustRgbState> {
        (vec(value()).and(vec(value())))
            .and(vec(excess()).and(vec(variance())))
            .and(domains::range(0.0, 8.0))
            .and(frames().and(frames()))
            .map(
                |((((mean, short_mean), (excess, variance)), inconsistency), (length, age))| {
                    MultiscaleMeanRobustRgbState {
                        mean,
                        short_mean,
                        excess,
                        variance,
                        inconsistency,
                        length,
                        age,
                    }
                },
            )
    };
    let state_of = |mean: f32, short_mean: f32, variance: f32, inconsistency: f32, age: f32| {
        MultiscaleMeanRobustState {
            mean,
            short_mean,
            excess: 0.0,
            variance,
            inconsistency,
            length: age,
            age,
        }
    };
    let rgb_of = |s: MultiscaleMeanRobustState| MultiscaleMeanRobustRgbState {
        mean: Vec3::splat(s.mean),
        short_mean: Vec3::splat(s.short_mean),
        excess: Vec3::splat(s.excess),
        variance: Vec3::splat(s.variance),
        inconsistency: s.inconsistency,
        length: s.length,
        age: s.age,
    };
    let still = state_of(1.0, 1.0, 0.0, 0.0, 256.0);
    let dark = state_of(0.0, 0.0, 0.0, 0.0, 256.0);
    let moved = state_of(1.0, 3.0, 0.5, 4.0, 256.0);
    // State and sample that break naive code.
    let hard_steps = [
        (MULTISCALE_MEAN_ROBUST_EMPTY, 1.0),
        (MULTISCALE_MEAN_ROBUST_EMPTY, 0.0),
        (MULTISCALE_MEAN_ROBUST_EMPTY, 1e30),
        (still, 1.0),
        (still, 0.0),
        (still, 1e15),
        (still, 1e30),
        (still, -1.0),
        (dark, 0.0),
        (dark, 1.0),
        (moved, 3.0),
        (moved, 0.0),
        (state_of(1e15, 1e15, 4e30, 0.0, 256.0), 1e15),
        (state_of(2e15, 1.0, 1.0, 0.0, 256.0), 0.5),
        (state_of(1.0, 1.0, -1.0, -1.0, 256.0), 0.5),
        (state_of(1.0, 1.0, 1.0, 0.0, 0.5), 0.5),
        (state_of(1.0, 2.0, 1.0, 2.125, 1.0), 0.5),
        (state_of(1.0, 1.0, 1.0, 0.0, 16777216.0), 0.5),
    ];
    let broken: Vec<MultiscaleMeanRobustState> = BAD
        .iter()
        .flat_map(|bad| {
            let s = still;
            let b = *bad;
            [
                MultiscaleMeanRobustState { mean: b, ..s },
                MultiscaleMeanRobustState { short_mean: b, ..s },
                MultiscaleMeanRobustState { excess: b, ..s },
                MultiscaleMeanRobustState { variance: b, ..s },
                MultiscaleMeanRobustState {
                    inconsistency: b,
                    ..s
                },
                MultiscaleMeanRobustState { length: b, ..s },
                MultiscaleMeanRobustState { age: b, ..s },
            ]
        })
        .collect();
    let broken_domain = |x: Domain<MultiscaleMeanRobustState>| {
        x.and(domains::any_u32()).map(|(mut s, kind)| {
            let bad = BAD[(kind >> 8) as usize % BAD.len()];
            match kind % 16 {
                0 => s.mean = bad,
                1 => s.short_mean = bad,
                2 => s.excess = bad,
                3 => s.variance = bad,
                4 => s.inconsistency = bad,
                5 => s.length = bad,
                6 => s.age = bad,
                7 => s.variance = -s.variance,
                8 => s.excess = -s.excess,
                _ => {}
            }
            s
        })
    };
    let printed_of = |mean: f32, short_mean: f32, vbbr: f32, variance: f32, inconsistency: f32| {
        MultiscaleMeanState {
            mean,
            short_mean,
            vbbr,
            variance,
            inconsistency,
        }
    };
    let printed_hard = [
        (MULTISCALE_MEAN_EMPTY, 1.0, 0.08),
        (MULTISCALE_MEAN_EMPTY, 0.0, 0.08),
        (MULTISCALE_MEAN_EMPTY, 1000.0, 0.08),
        (printed_of(1.0, 1.0, 1.0, 0.0, 0.0), 1.0, 0.08),
        (printed_of(1.0, 1.0, 1.0, 1e-5, 0.2), 1.0, 0.08),
        (printed_of(1.0, 0.0, 1.0, 1e-6, 4.0), 0.0, 0.08),
        (printed_of(0.0, 1.0, 1.0, 1.0, 4.0), 20.0, 0.08),
        (printed_of(1.0, 1.0, 0.03125, 100.0, 0.0), 0.0, 0.08),
        (printed_of(1.0, 1.0, 1.0, 1.0, 0.22), 1.0, 1.0),
    ];
    // The packed form's numbers.
    fn rounded(x: f64, bits: i32) -> f64 {
        if x.abs() < 2f64.powi(-100) {
            return 0.0;
        }
        let step = 2f64.powi(x.abs().log2().floor() as i32 + 1 - bits);
        (x / step).round_ties_even() * step
    }
    fn top(x: f64) -> u32 {
        (rounded(x, 8) as f32).to_bits() >> 16
    }
    fn with_age(x: f64, age: f64) -> u32 {
        let bits = if x < 2f64.powi(-126) {
            (x as f32).to_bits()
        } else {
            (rounded(x, 16) as f32).to_bits()
        };
        bits | age.min(255.0).floor() as u32
    }
    // The difference of two f32, rounded once.
    fn away(short: f64, mean: f64) -> f64 {
        f64::from((short - mean) as f32)
    }
    fn whole(word: u32) -> f64 {
        f64::from(f32::from_bits(word))
    }
    fn low(word: u32) -> f64 {
        f64::from(f32::from_bits(word << 16))
    }
    fn high(word: u32) -> f64 {
        f64::from(f32::from_bits(word >> 16 << 16))
    }
    fn cut(word: u32) -> f64 {
        f64::from(f32::from_bits(word >> 8 << 8))
    }
    let packed_words = || broken_domain(robust_state()).map(multiscale_mean_robust_pack);
    let packed_rgb_words = || robust_rgb_state().map(multiscale_mean_robust_rgb_pack);

    vec![
        Kernel::new(
            MODULE,
            "multiscale_mean_blend",
            ["relative", "inconsistency"],
            multiscale_mean_blend,
            exact::printed_blend,
            (domains::log_range(1e-3, 100.0), domains::range(0.0, 8.0)),
        )
        // The inconsistency less 0.2: errors are those of 0.2.
        .scale_by(|relative: f64, inconsistency: f64| {
            let x = relative * (inconsistency - 0.2).max(0.02);
            let near = if x > 1.01 { 0.0 } else { relative * 0.2 * x };
            exact::printed_blend(relative, inconsistency).max(near)
        })
        .few_ulp(5.0, 9.0)
        .by_ends(&SMOOTH, SMOOTH_WHY)
        .hard([
            (0.0, 0.0),
            (0.0, 8.0),
            (1000.0, 8.0),
            (1.0, 0.2),
            (1.0, 0.22),
            (1.0, 1.2),
            (50.0, 0.0),
        ])
        .source(LISTING)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_blend",
            ["relative", "inconsistency", "reduction"],
            multiscale_mean_robust_blend,
            exact::robust_blend,
            (
                domains::log_range(1e-3, 100.0),
                domains::range(0.0, 16.0),
                domains::range(0.03125, 1.0),
            ),
        )
        .few_ulp(5.5, 10.25)
        .by_ends(&SMOOTH, SMOOTH_WHY)
        .hard([
            (0.0, 0.0, 1.0),
            (0.0, 8.0, 1.0),
            (1000.0, 8.0, 1.0),
            (1.0, 2.125, 1.0),
            (1.0, 2.1250002, 1.0),
            (4.0, 2.8522727, 1.0),
            (1e5, 1e5, 0.03125),
        ])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_step",
            ["state", "sample", "short_blend"],
            multiscale_mean_step,
            |s: WidePrinted, y: f64, a: f64| {
                let s = exact::printed(&printed(s), [y], a, ONE);
                (
                    s.mean[0],
                    s.short[0],
                    s.vbbr,
                    s.variance[0],
                    s.inconsistency,
                )
            },
            (printed_state(), sample(), blend()),
        )
        // Averages over their deviation, through the weight to the mean.
        .scale_by(|s: WidePrinted, y: f64, a: f64| exact::printed_scale(&printed(s), [y], a, ONE))
        .few_ulp(3.5, 11.25)
        .by_ends(&SMOOTH, SMOOTH_WHY)
        .hard(printed_hard)
        .source(LISTING)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_rgb_step",
            ["state", "sample", "short_blend"],
            multiscale_mean_rgb_step,
            |s: WidePrintedRgb, y: DVec3, a: f64| {
                let s = exact::printed(&printed_rgb(s), y.to_array(), a, LUMA);
                (
                    DVec3::from_array(s.mean),
                    DVec3::from_array(s.short),
                    s.vbbr,
                    DVec3::from_array(s.variance),
                    s.inconsistency,
                )
            },
            (printed_rgb_state(), vec(sample()), blend()),
        )
        .scale_by(|s: WidePrintedRgb, y: DVec3, a: f64| {
            exact::printed_scale(&printed_rgb(s), y.to_array(), a, LUMA)
        })
        .few_ulp(3.5, 11.25)
        .by_ends(&SMOOTH, SMOOTH_WHY)
        .hard(printed_hard.map(|(s, y, a)| {
            let state = MultiscaleMeanRgbState {
                mean: Vec3::new(s.mean, 0.0, s.mean),
                short_mean: Vec3::splat(s.short_mean),
                vbbr: s.vbbr,
                variance: Vec3::new(s.variance, 0.0, s.variance),
                inconsistency: s.inconsistency,
            };
            (state, Vec3::new(y, 0.5 * y, 0.0), a)
        }))
        .source(LISTING)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_step",
            ["state", "sample", "short_blend", "longest"],
            multiscale_mean_robust_step,
            |s: WideRobust, y: f64, a: f64, longest: f64| {
                wide(exact::robust(&robust(s), [y], a, longest, ONE))
            },
            (robust_state(), sample(), blend(), longest()),
        )
        // As the printed form's; the length is one over the weight.
        .scale_by(|s: WideRobust, y: f64, a: f64, longest: f64| {
            exact::robust_scale(&robust(s), [y], a, longest, ONE)
        })
        .few_ulp(5.5, 26.0)
        .by_ends(&SMOOTH, SMOOTH_WHY)
        .hard(hard_steps.map(|(s, y)| (s, y, 0.08, 256.0)))
        .hard([(moved, 2.0, 1.0, 256.0), (moved, 2.0, 0.08, 1.0)])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_rgb_step",
            ["state", "sample", "short_blend", "longest"],
            multiscale_mean_robust_rgb_step,
            |s: WideRobustRgb, y: DVec3, a: f64, longest: f64| {
                wide_rgb(exact::robust(
                    &robust_rgb(s),
                    y.to_array(),
                    a,
                    longest,
                    LUMA,
                ))
            },
            (robust_rgb_state(), vec(sample()), blend(), longest()),
        )
        .scale_by(|s: WideRobustRgb, y: DVec3, a: f64, longest: f64| {
            exact::robust_scale(&robust_rgb(s), y.to_array(), a, longest, LUMA)
        })
        .few_ulp(5.5, 24.5)
        .by_ends(&SMOOTH, SMOOTH_WHY)
        .hard(hard_steps.map(|(s, y)| (rgb_of(s), Vec3::new(y, 0.5, 0.0), 0.08, 256.0)))
        .hard([(
            rgb_of(moved),
            Vec3::new(3.0, 1.0, 0.5),
            MULTISCALE_MEAN_SHORT_BLEND,
            MULTISCALE_MEAN_LONGEST,
        )])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_guard",
            ["state"],
            multiscale_mean_robust_guard,
            |s: WideRobust| wide(exact::guarded(&robust(s))),
            (broken_domain(robust_state()),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(broken.iter().map(|s| (*s,)))
        .hard([(MULTISCALE_MEAN_ROBUST_EMPTY,), (still,)])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_rgb_guard",
            ["state"],
            multiscale_mean_robust_rgb_guard,
            |s: WideRobustRgb| wide_rgb(exact::guarded(&robust_rgb(s))),
            (broken_domain(robust_state())
                .and(robust_rgb_state())
                .map(move |(s, mut rgb)| {
                    rgb.mean.y = s.mean;
                    rgb.short_mean.z = s.short_mean;
                    rgb.excess.x = s.excess;
                    rgb.variance.y = s.variance;
                    (rgb.inconsistency, rgb.length, rgb.age) = (s.inconsistency, s.length, s.age);
                    rgb
                }),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(broken.iter().map(|s| (rgb_of(*s),)))
        .hard([(MULTISCALE_MEAN_ROBUST_RGB_EMPTY,), (rgb_of(still),)])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_value",
            ["state"],
            multiscale_mean_robust_value,
            |s: WideRobust| s.0 + s.2,
            (robust_state(),),
        )
        .few_ulp(0.5, 1.0)
        .hard([(MULTISCALE_MEAN_ROBUST_EMPTY,), (still,), (moved,)])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_rgb_value",
            ["state"],
            multiscale_mean_robust_rgb_value,
            |s: WideRobustRgb| s.0 + s.2,
            (robust_rgb_state(),),
        )
        .few_ulp(0.5, 1.0)
        .hard([(MULTISCALE_MEAN_ROBUST_RGB_EMPTY,), (rgb_of(still),)])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_upper_half",
            ["x"],
            multiscale_mean_upper_half,
            |x: f64| {
                let bits = top(x);
                if x == 0.0 { 0 } else { bits }
            },
            (domains::signed_log_range(1e-32, 1e32),),
        )
        .bit_exact()
        .hard(
            [
                0.0,
                -0.0,
                1.0,
                1.00390625,
                1.01171875,
                255.0,
                256.0,
                257.0,
                7.8886091e-31,
                1e-31,
                1e30,
                -3.3,
            ]
            .map(|x| (x,)),
        )
        .source("IEEE 754, round to nearest, ties to even")
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_pack",
            ["state"],
            multiscale_mean_robust_pack,
            |s: WideRobust| {
                let s = exact::guarded(&robust(s));
                UVec4::new(
                    (s.mean[0] as f32).to_bits(),
                    with_age(s.excess[0], s.age),
                    top(away(s.short[0], s.mean[0])) | top(s.variance[0]) << 16,
                    top(s.inconsistency) | top(s.length) << 16,
                )
            },
            (broken_domain(robust_state()),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(broken.iter().map(|s| (*s,)))
        .hard([
            (MULTISCALE_MEAN_ROBUST_EMPTY,),
            (still,),
            (moved,),
            (state_of(1.0, 1.0, 1e-31, 0.0, 1000.0),),
        ])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_unpack",
            ["words"],
            multiscale_mean_robust_unpack,
            |w: UVec4| {
                let mean = f64::from(f32::from_bits(w.x));
                (
                    mean,
                    mean + low(w.z),
                    cut(w.y),
                    high(w.z),
                    low(w.w),
                    high(w.w),
                    f64::from(w.y & 255),
                )
            },
            (packed_words(),),
        )
        .scale_by(|w: UVec4| f64::from(f32::from_bits(w.x)).abs().max(1e-30))
        .few_ulp(0.5, 1.0)
        .hard([
            (UVec4::ZERO,),
            (multiscale_mean_robust_pack(still),),
            (multiscale_mean_robust_pack(moved),),
            (multiscale_mean_robust_pack(dark),),
        ])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_rgb_pack",
            ["state"],
            multiscale_mean_robust_rgb_pack,
            |s: WideRobustRgb| {
                let s = exact::guarded(&robust_rgb(s));
                let pair = |k: usize| top(away(s.short[k], s.mean[k])) | top(s.variance[k]) << 16;
                (
                    (s.mean[0] as f32).to_bits(),
                    (s.mean[1] as f32).to_bits(),
                    (s.mean[2] as f32).to_bits(),
                    with_age(s.excess[0], s.age),
                    with_age(s.excess[1], 0.0),
                    with_age(s.excess[2], 0.0),
                    pair(0),
                    pair(1),
                    pair(2),
                    top(s.inconsistency) | top(s.length) << 16,
                )
            },
            (robust_rgb_state(),),
        )
        .bit_exact()
        .by_analysis(NOT_A_NUMBER)
        .hard(broken.iter().map(|s| (rgb_of(*s),)))
        .hard([(MULTISCALE_MEAN_ROBUST_RGB_EMPTY,), (rgb_of(moved),)])
        .source(OURS)
        .build(),
        Kernel::new(
            MODULE,
            "multiscale_mean_robust_rgb_unpack",
            ["words"],
            multiscale_mean_robust_rgb_unpack,
            |w: WidePacked| {
                let mean = DVec3::new(whole(w.0), whole(w.1), whole(w.2));
                (
                    mean,
                    mean + DVec3::new(low(w.6), low(w.7), low(w.8)),
                    DVec3::new(cut(w.3), cut(w.4), cut(w.5)),
                    DVec3::new(high(w.6), high(w.7), high(w.8)),
                    low(w.9),
                    high(w.9),
                    f64::from(w.3 & 255),
                )
            },
            (packed_rgb_words(),),
        )
        .scale_by(|w: WidePacked| {
            [w.0, w.1, w.2]
                .into_iter()
                .map(|w| whole(w).abs())
                .fold(1e-30, f64::max)
        })
        .few_ulp(0.5, 1.0)
        .hard([
            (MultiscaleMeanRobustRgbPacked::default(),),
            (multiscale_mean_robust_rgb_pack(rgb_of(still)),),
            (multiscale_mean_robust_rgb_pack(rgb_of(moved)),),
        ])
        .source(OURS)
        .build(),
    ]
}
