//! A running mean over frames, with its variance: an average while the history
//! is short, an exponential average once it has reached its cap.
//!
//! With `h` frames of history the newest counts `1/h`, so the first `cap`
//! frames are averaged equally and none of them is favoured; from then on the
//! weight stays `1/cap`. The second moment is kept about the mean, so it never
//! cancels and never turns negative.
//!
//! Source: Schied et al., *Spatiotemporal Variance-Guided Filtering* (2017),
//! section 4.1, for accumulation and moments; West, *Updating Mean and Variance
//! Estimates: An Improved Method* (1979), and Finch, *Incremental Calculation
//! of Weighted Mean and Variance* (2009), section 9, for the update about the
//! mean; Kish, *Survey Sampling* (1965), for effective samples.

use glam::{Vec2, Vec3};

use crate::math::luminance::luminance;

/// Largest magnitude that a sample or a mean may have; what is larger counts
/// as a defect, as NaN and infinity do. Its square is far from overflowing.
pub const TEMPORAL_ACCUMULATE_LARGEST: f32 = 1e15;

/// Largest variance that a history may have: no numbers up to
/// [`TEMPORAL_ACCUMULATE_LARGEST`] have a larger one, rounding included.
pub const TEMPORAL_ACCUMULATE_LARGEST_VARIANCE: f32 = 4e30;

/// Largest history length: beyond it `f32` cannot count by one.
pub const TEMPORAL_ACCUMULATE_LONGEST: f32 = 16777216.0;

/// What is known of a scalar (shadow, ambient occlusion).
///
/// ```
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_EMPTY, temporal_accumulate_step,
/// };
///
/// let state = temporal_accumulate_step(TEMPORAL_ACCUMULATE_EMPTY, 0.5, 32.0);
/// assert_eq!((state.mean, state.variance, state.history), (0.5, 0.0, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct TemporalAccumulateState {
    /// Mean of the history.
    pub mean: f32,
    /// Mean squared distance from the mean, `>= 0`.
    pub variance: f32,
    /// Frames in the history, at most the cap; 0 for none.
    pub history: f32,
}

/// What is known of a colour.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_RGB_EMPTY, temporal_accumulate_rgb_step,
/// };
///
/// let red = Vec3::new(1.0, 0.0, 0.0);
/// let state = temporal_accumulate_rgb_step(
///     TEMPORAL_ACCUMULATE_RGB_EMPTY,
///     red,
///     32.0,
///     5.0,
/// );
/// assert_eq!((state.color, state.history), (red, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct TemporalAccumulateRgbState {
    /// Mean colour of the history. A filter may feed its own result back here
    /// without touching the moments.
    pub color: Vec3,
    /// Mean luminance of the history, as samples came in.
    pub mean_luminance: f32,
    /// Mean squared distance of the luminance from its mean, `>= 0`.
    pub variance: f32,
    /// Frames in the history, at most the larger cap; 0 for none.
    pub history: f32,
}

/// No history.
pub const TEMPORAL_ACCUMULATE_EMPTY: TemporalAccumulateState = TemporalAccumulateState {
    mean: 0.0,
    variance: 0.0,
    history: 0.0,
};

/// No history of a colour.
pub const TEMPORAL_ACCUMULATE_RGB_EMPTY: TemporalAccumulateRgbState = TemporalAccumulateRgbState {
    color: Vec3::ZERO,
    mean_luminance: 0.0,
    variance: 0.0,
    history: 0.0,
};

/// 1 if the magnitude of `value` is at most `largest`, a finite number `>= 0`;
/// 0 if it is larger, infinite or NaN. Compares bit patterns, so no
/// implementation may fold it away. Exact.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_LARGEST, temporal_accumulate_usable,
/// };
///
/// assert_eq!(temporal_accumulate_usable(-3.0, TEMPORAL_ACCUMULATE_LARGEST), 1);
/// assert_eq!(
///     temporal_accumulate_usable(f32::NAN, TEMPORAL_ACCUMULATE_LARGEST),
///     0
/// );
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_usable(value: f32, largest: f32) -> u32 {
    u32::from((value.to_bits() & 0x7fff_ffff) <= largest.to_bits())
}

/// Frames in the history once a new one is added: `history + 1`, at most
/// `cap`, at least 1.
///
/// `history` is 0 or more; one below 1 (a reprojection that found almost
/// nothing) counts as 0. `cap` below 1 counts as 1.
///
/// Error analysis: one sum, exact for whole numbers.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_history;
///
/// assert_eq!(temporal_accumulate_history(0.0, 32.0), 1.0);
/// assert_eq!(temporal_accumulate_history(7.0, 32.0), 8.0);
/// assert_eq!(temporal_accumulate_history(32.0, 32.0), 32.0);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_history(history: f32, cap: f32) -> f32 {
    if history < 1.0 {
        return 1.0;
    }
    (history + 1.0).min(cap.max(1.0))
}

/// Weight of the newest of `history` frames: `1/history`, at least `1/cap`, at
/// most 1. SVGF's least weight of 0.2 is a cap of 5.
///
/// The first frame's weight is a constant, not a quotient: WGSL lets `1.0/1.0`
/// be less than 1, and the first sample would not replace what was there.
///
/// Error analysis: one quotient.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_alpha;
///
/// assert_eq!(temporal_accumulate_alpha(1.0, 32.0), 1.0);
/// assert_eq!(temporal_accumulate_alpha(4.0, 32.0), 0.25);
/// // SVGF's least weight of 0.2.
/// assert_eq!(temporal_accumulate_alpha(100.0, 5.0), 0.2);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_alpha(history: f32, cap: f32) -> f32 {
    let length = history.min(cap);
    if length <= 1.0 {
        return 1.0;
    }
    1.0 / length
}

/// The mean with a sample of weight `alpha` in `[0, 1]` added.
///
/// Never outside `mean` and `sample`: where they are equal, exactly that. At
/// `alpha` 1 the result is the sample, whatever the mean was (NaN too): it is
/// selected, not weighted.
///
/// Error analysis: starts from the end that weighs more, so what is added is
/// never larger than what it is added to (of one sign): at most 2 ULP. Of
/// different signs the sum may cancel; the error is then that of the larger.
/// In the order written the clamp never acts; it holds where a driver
/// rearranges the sum.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_mean;
///
/// assert_eq!(temporal_accumulate_mean(1.0, 2.0, 0.25), 1.25);
/// // The first sample replaces whatever was there.
/// assert_eq!(temporal_accumulate_mean(f32::NAN, 2.0, 1.0), 2.0);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_mean(mean: f32, sample: f32, alpha: f32) -> f32 {
    if alpha >= 1.0 {
        return sample;
    }
    let away = sample - mean;
    let moved = if alpha > 0.5 {
        sample - (1.0 - alpha) * away
    } else {
        mean + alpha * away
    };
    moved.max(mean.min(sample)).min(mean.max(sample))
}

/// The variance with a sample of weight `alpha` in `[0, 1]` added, which lies
/// `difference` away from the mean before it: `(1 - α)(v + α d²)`.
///
/// `variance >= 0`, and so is the result. With `alpha` = 1/h it is the mean
/// squared distance of h samples from their mean. 0 at `alpha` 1, whatever the
/// variance was.
///
/// Error analysis: products and a sum of positive terms, at most 3.25 ULP.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_variance;
///
/// // Two samples, 2 apart: each is 1 away from their mean.
/// assert_eq!(temporal_accumulate_variance(0.0, 2.0, 0.5), 1.0);
/// assert_eq!(temporal_accumulate_variance(0.0, 0.0, 0.5), 0.0);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_variance(variance: f32, difference: f32, alpha: f32) -> f32 {
    if alpha >= 1.0 {
        return 0.0;
    }
    (1.0 - alpha) * (variance + alpha * (difference * difference))
}

/// The history as it may be used: [`TEMPORAL_ACCUMULATE_EMPTY`] if a member is
/// NaN, infinite or too large, and a negative variance or length as 0. Exact.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_EMPTY, TemporalAccumulateState,
///     temporal_accumulate_guard,
/// };
///
/// let broken =
///     TemporalAccumulateState { mean: f32::NAN, variance: 0.1, history: 9.0 };
/// assert_eq!(temporal_accumulate_guard(broken), TEMPORAL_ACCUMULATE_EMPTY);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_guard(state: TemporalAccumulateState) -> TemporalAccumulateState {
    let usable = temporal_accumulate_usable(state.mean, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.variance, TEMPORAL_ACCUMULATE_LARGEST_VARIANCE)
        & temporal_accumulate_usable(state.history, TEMPORAL_ACCUMULATE_LONGEST);
    if usable == 0 {
        return TEMPORAL_ACCUMULATE_EMPTY;
    }
    TemporalAccumulateState {
        mean: state.mean,
        variance: state.variance.max(0.0),
        history: state.history.max(0.0),
    }
}

/// The state with a frame's sample added; `cap >= 1` is the longest history.
///
/// A sample that is no number, or larger than [`TEMPORAL_ACCUMULATE_LARGEST`],
/// is left out: the state stays as it was. A history that is no number counts
/// as none.
///
/// Error analysis: the weight errs by one quotient, which moves the mean by
/// less than its own rounding does. All relative for samples of one sign.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_EMPTY, temporal_accumulate_step,
/// };
///
/// let mut state = TEMPORAL_ACCUMULATE_EMPTY;
/// for sample in [1.0, 0.0, f32::NAN, 0.0, 1.0] {
///     state = temporal_accumulate_step(state, sample, 32.0);
/// }
/// // The four numbers' mean and variance; the NaN did no harm.
/// assert_eq!(state.history, 4.0);
/// assert!(
///     (state.mean - 0.5).abs() < 1e-6 && (state.variance - 0.25).abs() < 1e-6
/// );
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_step(
    state: TemporalAccumulateState,
    sample: f32,
    cap: f32,
) -> TemporalAccumulateState {
    let kept = temporal_accumulate_guard(state);
    if temporal_accumulate_usable(sample, TEMPORAL_ACCUMULATE_LARGEST) == 0 {
        return kept;
    }
    let history = temporal_accumulate_history(kept.history, cap);
    let alpha = temporal_accumulate_alpha(history, cap);
    let away = sample - kept.mean;
    TemporalAccumulateState {
        mean: temporal_accumulate_mean(kept.mean, sample, alpha),
        variance: temporal_accumulate_variance(kept.variance, away, alpha),
        history,
    }
}

/// As [`temporal_accumulate_guard`], for a colour.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_RGB_EMPTY, TemporalAccumulateRgbState,
///     temporal_accumulate_rgb_guard,
/// };
///
/// let broken = TemporalAccumulateRgbState {
///     history: f32::INFINITY,
///     ..TEMPORAL_ACCUMULATE_RGB_EMPTY
/// };
/// assert_eq!(
///     temporal_accumulate_rgb_guard(broken),
///     TEMPORAL_ACCUMULATE_RGB_EMPTY
/// );
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_rgb_guard(
    state: TemporalAccumulateRgbState,
) -> TemporalAccumulateRgbState {
    let color = temporal_accumulate_usable(state.color.x, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.color.y, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.color.z, TEMPORAL_ACCUMULATE_LARGEST);
    let moments = temporal_accumulate_usable(state.mean_luminance, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(state.variance, TEMPORAL_ACCUMULATE_LARGEST_VARIANCE)
        & temporal_accumulate_usable(state.history, TEMPORAL_ACCUMULATE_LONGEST);
    if (color & moments) == 0 {
        return TEMPORAL_ACCUMULATE_RGB_EMPTY;
    }
    TemporalAccumulateRgbState {
        color: state.color,
        mean_luminance: state.mean_luminance,
        variance: state.variance.max(0.0),
        history: state.history.max(0.0),
    }
}

/// The state with a frame's colour added: `cap` for the colour, `moments_cap`
/// for the moments of its luminance, both `>= 1` (SVGF has 5 for both).
///
/// Bad samples and histories as in [`temporal_accumulate_step`]; a colour with
/// one bad channel is left out whole.
///
/// Error analysis: the colour as there. The luminance errs by 2 ULP before its
/// distance from the mean is taken, so the variance's error is absolute: a few
/// ULP of the squared luminance.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::accumulate::{
///     TEMPORAL_ACCUMULATE_RGB_EMPTY, temporal_accumulate_rgb_step,
/// };
///
/// let mut state = TEMPORAL_ACCUMULATE_RGB_EMPTY;
/// for sample in [Vec3::ONE, Vec3::ZERO] {
///     state = temporal_accumulate_rgb_step(state, sample, 32.0, 5.0);
/// }
/// assert_eq!(state.color, Vec3::splat(0.5));
/// assert!((state.variance - 0.25).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_rgb_step(
    state: TemporalAccumulateRgbState,
    sample: Vec3,
    cap: f32,
    moments_cap: f32,
) -> TemporalAccumulateRgbState {
    let kept = temporal_accumulate_rgb_guard(state);
    let usable = temporal_accumulate_usable(sample.x, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(sample.y, TEMPORAL_ACCUMULATE_LARGEST)
        & temporal_accumulate_usable(sample.z, TEMPORAL_ACCUMULATE_LARGEST);
    if usable == 0 {
        return kept;
    }
    let history = temporal_accumulate_history(kept.history, cap.max(moments_cap));
    let alpha = temporal_accumulate_alpha(history, cap);
    let moments_alpha = temporal_accumulate_alpha(history, moments_cap);
    let light = luminance(sample);
    let away = light - kept.mean_luminance;
    TemporalAccumulateRgbState {
        color: Vec3::new(
            temporal_accumulate_mean(kept.color.x, sample.x, alpha),
            temporal_accumulate_mean(kept.color.y, sample.y, alpha),
            temporal_accumulate_mean(kept.color.z, sample.z, alpha),
        ),
        mean_luminance: temporal_accumulate_mean(kept.mean_luminance, light, moments_alpha),
        variance: temporal_accumulate_variance(kept.variance, away, moments_alpha),
        history,
    }
}

/// Sum of the squared weights of all samples in a history, with one of weight
/// `alpha` in `[0, 1]` added; start from 1. Its inverse is the number of equal
/// samples that would count as much.
///
/// With `alpha` = 1/h it is 1/h; at a fixed `alpha` it tends to `α/(2 - α)`.
///
/// Error analysis: products and a sum of positive terms.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_squares;
///
/// // Two samples, half each: as good as two.
/// assert_eq!(1.0 / temporal_accumulate_squares(1.0, 0.5), 2.0);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_squares(squares: f32, alpha: f32) -> f32 {
    let keep = 1.0 - alpha;
    (keep * keep) * squares + alpha * alpha
}

/// The unbiased variance of one sample, from the variance of a history and its
/// [`temporal_accumulate_squares`] in `(0, 1)`: `v/(1 - s)`. Times `squares` it
/// is the variance of the mean.
///
/// 0 where `squares` is 1 or more: one sample says nothing of its error.
///
/// Error analysis: a difference of two exact numbers and a quotient.
///
/// ```
/// use raytwin_cpu::temporal::accumulate::{
///     temporal_accumulate_squares, temporal_accumulate_unbiased,
/// };
///
/// // Two samples, 2 apart, have a variance of 1 about their mean; unbiased, 2.
/// let squares = temporal_accumulate_squares(1.0, 0.5);
/// assert_eq!(temporal_accumulate_unbiased(1.0, squares), 2.0);
/// assert_eq!(temporal_accumulate_unbiased(1.0, 1.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_unbiased(variance: f32, squares: f32) -> f32 {
    if squares >= 1.0 {
        return 0.0;
    }
    variance / (1.0 - squares)
}

/// Plain moments (mean of the values, mean of their squares) with a sample of
/// weight `alpha` in `[0, 1]` added. What others use, to compare with.
///
/// Error analysis: as [`temporal_accumulate_mean`], and one product.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_plain_moments;
///
/// let first = temporal_accumulate_plain_moments(Vec2::ZERO, 1.0, 1.0);
/// let both = temporal_accumulate_plain_moments(first, 3.0, 0.5);
/// assert_eq!(both, Vec2::new(2.0, 5.0));
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_plain_moments(moments: Vec2, sample: f32, alpha: f32) -> Vec2 {
    Vec2::new(
        temporal_accumulate_mean(moments.x, sample, alpha),
        temporal_accumulate_mean(moments.y, sample * sample, alpha),
    )
}

/// The variance behind plain moments, `max(E[x²] - E[x]², 0)`. It cancels:
/// what it has lost before shows in the docs.
///
/// Error analysis: the difference errs by an ULP or two of `E[x²]`, however
/// small the variance is.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::temporal::accumulate::temporal_accumulate_plain_variance;
///
/// assert_eq!(temporal_accumulate_plain_variance(Vec2::new(2.0, 5.0)), 1.0);
/// // A variance of 1 about a mean of 10000 is lost.
/// assert_eq!(
///     temporal_accumulate_plain_variance(Vec2::new(1e4, 1e8 + 1.0)),
///     0.0
/// );
/// ```
#[inline]
#[must_use]
pub fn temporal_accumulate_plain_variance(moments: Vec2) -> f32 {
    (moments.y - moments.x * moments.x).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_next, pcg_unit};

    fn numbers(seed: u32) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            let next = pcg_next(state);
            state = next.state;
            pcg_unit(next.value)
        }
    }

    /// A normal number from twelve uniform ones.
    fn normal(next: &mut impl FnMut() -> f32) -> f64 {
        (0..12).map(|_| f64::from(next())).sum::<f64>() - 6.0
    }

    /// `x` in a format with this many fraction bits, least and largest
    /// exponent: round to nearest even, to infinity beyond the largest.
    fn stored(x: f64, fraction: i32, least: i32, largest: i32) -> f64 {
        if x == 0.0 || !x.is_finite() {
            return x;
        }
        let exponent = (x.abs().log2().floor() as i32).max(least);
        let step = f64::from(exponent - fraction).exp2();
        let rounded = (x / step).round_ties_even() * step;
        if rounded.abs() >= f64::from(largest + 1).exp2() {
            return rounded.signum() * f64::INFINITY;
        }
        rounded
    }

    fn half(x: f32) -> f32 {
        stored(f64::from(x), 10, -14, 15) as f32
    }

    fn run(samples: impl IntoIterator<Item = f32>, cap: f32) -> TemporalAccumulateState {
        samples
            .into_iter()
            .fold(TEMPORAL_ACCUMULATE_EMPTY, |state, x| {
                temporal_accumulate_step(state, x, cap)
            })
    }

    #[test]
    fn a_constant_stays_exactly_that_with_no_variance() {
        for value in [0.0, 1e-30, 0.1, 3.3, 256.0, 1000.1, 65000.0, 1e15] {
            for cap in [1.0, 2.0, 5.0, 7.3, 32.0, 1024.0] {
                let mut state = TEMPORAL_ACCUMULATE_EMPTY;
                let mut rgb = TEMPORAL_ACCUMULATE_RGB_EMPTY;
                let color = Vec3::new(value, value * 0.7, value * 0.3);
                for _ in 0..300 {
                    state = temporal_accumulate_step(state, value, cap);
                    rgb = temporal_accumulate_rgb_step(rgb, color, cap, 5.0);
                    assert_eq!((state.mean, state.variance), (value, 0.0));
                    assert_eq!((rgb.color, rgb.variance), (color, 0.0));
                    assert_eq!(rgb.mean_luminance, luminance(color));
                }
            }
        }
    }

    #[test]
    fn the_first_frames_are_a_plain_average() {
        let mut next = numbers(1);
        let samples: Vec<f32> = (0..64).map(|_| 1e3 * next() * next()).collect();
        let mut state = TEMPORAL_ACCUMULATE_EMPTY;
        for (i, x) in samples.iter().enumerate() {
            state = temporal_accumulate_step(state, *x, 64.0);
            let n = (i + 1) as f64;
            let seen = || samples[..=i].iter().map(|x| f64::from(*x));
            let mean = seen().sum::<f64>() / n;
            let variance = seen().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
            assert_eq!(state.history, n as f32);
            assert!((f64::from(state.mean) - mean).abs() < 1e-6 * mean);
            assert!((f64::from(state.variance) - variance).abs() <= 4e-6 * variance);
        }
    }

    #[test]
    fn the_error_falls_like_one_over_the_frames() {
        // Mean squared error of the mean of uniform noise, times the frames.
        let mut next = numbers(2);
        let runs = 4000;
        for frames in [4, 16, 64] {
            let mut error = 0.0;
            for _ in 0..runs {
                let state = run((0..frames).map(|_| next()), 64.0);
                error += (f64::from(state.mean) - 0.5).powi(2);
            }
            let scaled = error / f64::from(runs) * f64::from(frames) * 12.0;
            assert!((scaled - 1.0).abs() < 0.1, "{frames} frames: {scaled}");
        }
    }

    #[test]
    fn exposure_changes_nothing_but_the_scale() {
        let mut next = numbers(3);
        let samples: Vec<Vec3> = (0..100)
            .map(|_| Vec3::new(next(), next(), next()))
            .collect();
        let accumulate = |k: f32| {
            samples
                .iter()
                .fold(TEMPORAL_ACCUMULATE_RGB_EMPTY, |state, c| {
                    temporal_accumulate_rgb_step(state, *c * k, 32.0, 5.0)
                })
        };
        let one = accumulate(1.0);
        for power in -10..=10 {
            let k = (power as f32).exp2();
            let other = accumulate(k);
            assert_eq!(other.color, one.color * k);
            assert_eq!(other.mean_luminance, one.mean_luminance * k);
            assert_eq!(other.variance, one.variance * k * k);
        }
    }

    #[test]
    fn the_mean_never_leaves_its_samples_and_the_variance_never_their_range() {
        let mut next = numbers(4);
        for _ in 0..20_000 {
            let (a, b) = (next(), next());
            let of = |x: f32| 10f32.powf(30.0 * x - 15.0) * (if x < 0.3 { -1.0 } else { 1.0 });
            let (mean, sample) = (of(a), of(b));
            for alpha in [0.0, 1e-7, next(), 0.5, 0.999_999_94, 1.0] {
                let got = temporal_accumulate_mean(mean, sample, alpha);
                assert!(got >= mean.min(sample) && got <= mean.max(sample));
            }
        }
        for _ in 0..200 {
            let mut state = TEMPORAL_ACCUMULATE_EMPTY;
            let cap = 1.0 + (next() * 40.0).floor();
            for _ in 0..100 {
                // Mostly black, with sparse bright hits.
                let x = if next() < 0.05 { 1e4 * next() } else { 0.0 };
                state = temporal_accumulate_step(state, x, cap);
                assert!((0.0..=1e4).contains(&state.mean));
                assert!((0.0..=2.500_01e7).contains(&state.variance));
                assert!(state.history <= cap);
            }
        }
    }

    #[test]
    fn what_is_no_number_gets_no_further() {
        let good = run([1.0, 2.0, 3.0], 32.0);
        for bad in [
            f32::NAN,
            -f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MAX,
            1e30,
            -1e30,
            f32::from_bits(0x7f80_0001),
        ] {
            // In one sample: as if the frame had not been.
            assert_eq!(temporal_accumulate_step(good, bad, 32.0), good);
            // In the history: as if there were none.
            for i in 0..3 {
                let mut members = [good.mean, good.variance, good.history];
                members[i] = bad;
                let [mean, variance, history] = members;
                let broken = TemporalAccumulateState {
                    mean,
                    variance,
                    history,
                };
                let huge_variance_is_legal = i == 1 && bad.abs() <= 4e30;
                let after = temporal_accumulate_step(broken, 5.0, 32.0);
                if huge_variance_is_legal {
                    assert!(after.variance.is_finite() && after.variance >= 0.0);
                } else {
                    assert_eq!(after, run([5.0], 32.0));
                }
                let again = temporal_accumulate_step(broken, bad, 32.0);
                assert!(again.mean.is_finite() && again.variance.is_finite());
            }
            // The same of a colour; one bad channel is enough.
            let rgb =
                temporal_accumulate_rgb_step(TEMPORAL_ACCUMULATE_RGB_EMPTY, Vec3::ONE, 32.0, 5.0);
            let sample = Vec3::new(0.5, bad, 0.5);
            assert_eq!(temporal_accumulate_rgb_step(rgb, sample, 32.0, 5.0), rgb);
            let broken = TemporalAccumulateRgbState {
                color: sample,
                ..rgb
            };
            assert_eq!(
                temporal_accumulate_rgb_step(broken, Vec3::ONE, 32.0, 5.0),
                rgb
            );
            // Selected, not weighted: no history survives a weight of 1, even
            // unguarded. The usual blend lets it (a trap).
            assert_eq!(temporal_accumulate_mean(bad, 5.0, 1.0), 5.0);
            assert_eq!(temporal_accumulate_variance(bad, bad, 1.0), 0.0);
            if bad.is_nan() || bad.is_infinite() {
                let alpha = 1.0;
                assert!((bad * (1.0 - alpha) + 5.0 * alpha).is_nan());
            }
        }
    }

    #[test]
    fn a_history_that_starts_late_starts_anew() {
        // A reprojection that found next to nothing, or a length below zero.
        for history in [0.0, 0.3, 0.999, -1.0, -1e6] {
            let state = TemporalAccumulateState {
                mean: 100.0,
                variance: 7.0,
                history,
            };
            assert_eq!(temporal_accumulate_step(state, 1.0, 32.0), run([1.0], 32.0));
        }
        // Trap: a fixed weight on a fresh pixel keeps a fifth of the value and
        // four fifths of whatever was there.
        assert_eq!(temporal_accumulate_mean(0.0, 1.0, 0.2), 0.2);
        assert_eq!(
            temporal_accumulate_step(TEMPORAL_ACCUMULATE_EMPTY, 1.0, 5.0).mean,
            1.0
        );
    }

    #[test]
    fn a_switched_light_is_forgotten_at_the_rate_of_the_cap() {
        for cap in [5.0f32, 32.0] {
            let mut state = run((0..500).map(|_| 1.0), cap);
            for frame in 1..=60 {
                state = temporal_accumulate_step(state, 0.0, cap);
                let want = (1.0 - 1.0 / f64::from(cap)).powi(frame);
                assert!((f64::from(state.mean) - want).abs() < 1e-5 * want);
            }
        }
    }

    /// Worst relative error of the variance over the frames after the start,
    /// against `f64`: plain and about the mean, in `f32` and stored in `f16`;
    /// and the part of the frames whose plain `f32` variance is below zero.
    fn variance_errors(mean: f64, cap: f64) -> ([f64; 4], f64) {
        let mut next = numbers(7);
        let mut exact = (0.0f64, 0.0f64);
        let [mut plain, mut plain_half] = [Vec2::ZERO; 2];
        let [mut west, mut west_half] = [TEMPORAL_ACCUMULATE_EMPTY; 2];
        let (mut errors, mut negative) = ([0f64; 4], 0);
        for frame in 1..=2000 {
            let x = (mean + normal(&mut next)) as f32;
            let alpha = (1.0 / f64::from(frame)).max(1.0 / cap);
            let d = f64::from(x) - exact.0;
            exact = (
                exact.0 + alpha * d,
                (1.0 - alpha) * (exact.1 + alpha * d * d),
            );
            let weight = temporal_accumulate_alpha(frame as f32, cap as f32);
            // As they are written: a blend, and no clamp.
            let blend = |m: Vec2| m * (1.0 - weight) + Vec2::new(x, x * x) * weight;
            plain = blend(plain);
            let mixed = blend(plain_half);
            plain_half = Vec2::new(half(mixed.x), half(mixed.y));
            west = temporal_accumulate_step(west, x, cap as f32);
            let stepped = temporal_accumulate_step(west_half, x, cap as f32);
            west_half = TemporalAccumulateState {
                mean: half(stepped.mean),
                variance: half(stepped.variance),
                history: half(stepped.history),
            };
            if frame < 20 {
                continue;
            }
            let difference = plain.y - plain.x * plain.x;
            negative += i32::from(difference < 0.0);
            let found = [
                difference,
                west.variance,
                plain_half.y - plain_half.x * plain_half.x,
                west_half.variance,
            ];
            for (error, v) in errors.iter_mut().zip(found) {
                let e = (f64::from(v) - exact.1).abs() / exact.1;
                *error = error.max(if e.is_nan() { f64::INFINITY } else { e });
            }
        }
        (errors, f64::from(negative) / 1981.0)
    }

    #[test]
    fn moments_about_the_mean_do_not_cancel() {
        println!("mean  plain f32  ours f32  plain f16  ours f16  plain f32 negative");
        for (mean, ours, ours_half) in [
            (1.0, 2e-6, 0.02),
            (10.0, 4e-6, 0.05),
            (100.0, 3e-5, 0.2),
            (1000.0, 3e-4, 3.0),
            (1e4, 3e-3, f64::INFINITY),
        ] {
            let ([plain, west, plain_half, west_half], negative) = variance_errors(mean, 5.0);
            println!(
                "{mean:6} {plain:.2e} {west:.2e} {plain_half:.2e} {west_half:.2e} {negative:.3}"
            );
            assert!(west < ours, "mean {mean}: {west}");
            assert!(west_half <= ours_half, "mean {mean}: {west_half}");
            // Traps: the plain form errs, turns negative, and overflows f16.
            assert!(mean < 10.0 || plain > 5.0 * west);
            assert!(mean < 1e4 || negative > 0.1);
            assert!(mean < 256.0 || plain_half.is_infinite());
        }
    }

    #[test]
    fn the_plain_variance_of_a_constant_is_not_zero() {
        // Trap: what E[x²] - E[x]² makes of a constant in f32, and what its
        // absolute value then passes off as a deviation.
        let mut false_deviation = 0f32;
        let mut below_zero = 0;
        for i in 0..1000 {
            let value = 1000.0 + 0.37 * i as f32;
            let mut moments = Vec2::ZERO;
            for frame in 1..=64 {
                let alpha = temporal_accumulate_alpha(frame as f32, 5.0);
                moments = temporal_accumulate_plain_moments(moments, value, alpha);
            }
            // Even with means that keep a constant.
            assert_eq!(moments, Vec2::new(value, value * value));
            let sums = (0..25).fold(Vec2::ZERO, |s, _| s + Vec2::new(value, value * value)) / 25.0;
            let difference = sums.y - sums.x * sums.x;
            below_zero += i32::from(difference < 0.0);
            false_deviation = false_deviation.max(difference.abs().sqrt());
            assert_eq!(run((0..64).map(|_| value), 5.0).variance, 0.0);
            assert!(temporal_accumulate_plain_variance(sums) >= 0.0);
        }
        assert!(false_deviation > 0.3, "{false_deviation}");
        assert!(below_zero > 100, "{below_zero}");
    }

    /// Where an exponential average of a constant target stops moving, stored
    /// with `fraction` bits after each frame.
    fn stuck_at(start: f32, target: f32, cap: f32, fraction: i32) -> f32 {
        let mut value = start;
        let alpha = temporal_accumulate_alpha(cap, cap);
        for _ in 0..1_000_000 {
            let moved = temporal_accumulate_mean(value, target, alpha);
            let next = stored(f64::from(moved), fraction, -14, 15) as f32;
            if next == value {
                return value;
            }
            value = next;
        }
        panic!("it never stops");
    }

    #[test]
    fn low_precision_storage_stalls_where_the_page_says() {
        // f16, and the 11- and 10-bit channels of a packed r11g11b10 format.
        // From 0.5 towards 1, and from 1 towards 0.5.
        let table = [
            (
                8.0,
                [0.998_046_9, 0.501_953_1],
                [0.96875, 0.53125],
                [0.9375, 0.5625],
            ),
            (
                32.0,
                [0.992_187_5, 0.507_812_5],
                [0.875, 0.625],
                [0.75, 0.75],
            ),
            (64.0, [0.984_375, 0.515_625], [0.75, 0.75], [0.5, 1.0]),
            (256.0, [0.9375, 0.5625], [0.5, 1.0], [0.5, 1.0]),
            (1024.0, [0.75, 0.75], [0.5, 1.0], [0.5, 1.0]),
        ];
        for (cap, half, eleven, ten) in table {
            for (fraction, want) in [(10, half), (6, eleven), (5, ten)] {
                let got = [
                    stuck_at(0.5, 1.0, cap, fraction),
                    stuck_at(1.0, 0.5, cap, fraction),
                ];
                println!("cap {cap}, {fraction} bits: {got:?}");
                for (got, want) in got.into_iter().zip(want) {
                    assert!(
                        (got - want).abs() < 1e-6,
                        "cap {cap}, {fraction} bits: {got}"
                    );
                }
                // The rule: half a step from where it was, times the cap.
                let rule = (cap * (-2.0 - fraction as f32).exp2()).min(0.5);
                assert!((1.0 - got[0] - rule).abs() < 1e-6);
                assert!((got[1] - 0.5 - rule).abs() < 1e-6);
            }
        }
        // f32 has 13 more bits than f16.
        let full = stuck_at(0.5, 1.0, 1024.0, 23);
        println!("f32, cap 1024: {full}");
        assert!(full > 0.9999);
        // A history length in f16 counts to 2048 and no further.
        let mut length = 0.0;
        for _ in 0..5000 {
            length = half(length + 1.0);
        }
        assert_eq!(length, 2048.0);
        // Plain second moments overflow f16 from a luminance of 256 on; the
        // variance about the mean from a deviation of 256 on.
        assert!(half(255.9f32 * 255.9).is_finite() && half(256.0 * 256.0).is_infinite());
        let steady = run((0..100).map(|i| 1e4 + 100.0 * (i % 2) as f32), 32.0);
        assert!(half(steady.variance).is_finite() && half(steady.mean * steady.mean).is_infinite());
    }

    #[test]
    fn the_effective_number_of_samples_makes_the_variance_unbiased() {
        for (cap, expected) in [(5.0f64, 0.888_89), (20.0, 0.974_36)] {
            let mut next = numbers(11);
            let (mut state, mut squares) = (TEMPORAL_ACCUMULATE_EMPTY, 1.0);
            let (mut raw, mut unbiased, mut of_mean) = (0.0, 0.0, 0.0);
            let frames = 200_000;
            let mut spread = 0.0;
            for frame in 0..frames {
                let x = normal(&mut next) as f32;
                state = temporal_accumulate_step(state, x, cap as f32);
                let alpha = temporal_accumulate_alpha(state.history, cap as f32);
                squares = temporal_accumulate_squares(squares, alpha);
                if f64::from(state.history) < cap {
                    // Equal weights so far.
                    assert!((squares * state.history - 1.0).abs() < 1e-6);
                }
                if frame < 200 {
                    continue;
                }
                let sample = temporal_accumulate_unbiased(state.variance, squares);
                raw += f64::from(state.variance);
                unbiased += f64::from(sample);
                of_mean += f64::from(sample * squares);
                spread += f64::from(state.mean).powi(2);
            }
            let n = f64::from(frames - 200);
            println!(
                "cap {cap}: {} {} {}",
                raw / n,
                unbiased / n,
                of_mean / spread
            );
            // The known factor, and its cure.
            assert!((raw / n - expected).abs() < 0.01, "{}", raw / n);
            assert!((unbiased / n - 1.0).abs() < 0.01, "{}", unbiased / n);
            // The variance of the mean is what the mean really has.
            assert!((of_mean / spread - 1.0).abs() < 0.05);
            let limit = 1.0 / (2.0 * cap - 1.0);
            assert!((f64::from(squares) - limit).abs() < 1e-6);
        }
        assert_eq!(temporal_accumulate_unbiased(3.0, 1.0), 0.0);
    }

    #[test]
    fn trap_a_history_of_another_exposure() {
        // The exposure falls to an eighth, and with it what the frames hold.
        let k = 0.125;
        let mut next = numbers(21);
        let frames: Vec<f32> = (0..100).map(|_| 1.0 + next()).collect();
        let (before, after) = frames.split_at(80);
        let cap = 32.0;
        let old = run(before.iter().copied(), cap);
        let rescaled = TemporalAccumulateState {
            mean: old.mean * k,
            variance: old.variance * k * k,
            ..old
        };
        let on = |start| {
            after.iter().fold(start, |state, x| {
                temporal_accumulate_step(state, x * k, cap)
            })
        };
        // As if all had been taken at the new exposure.
        assert_eq!(on(rescaled), run(frames.iter().map(|x| x * k), cap));
        // As it is, half of the old brightness stays for 22 frames.
        let (ghost, want) = (on(old).mean, on(rescaled).mean);
        let left = (ghost - want) / (old.mean * (1.0 - k));
        assert!(ghost > 4.0 * want && (left - 0.53).abs() < 0.01, "{left}");
    }
}
