//! The multiscale mean estimator: an average that is long while the signal is
//! still and short while it moves.
//!
//! A short exponential average and a variance follow the samples. Where the
//! long average and the short one are apart by more than the noise explains,
//! and have been for some frames, the long one takes larger steps. Twice:
//! [`multiscale_mean_step`] as printed in the chapter, and
//! [`multiscale_mean_robust_step`], which keeps the idea and mends what breaks.
//! Every function has a form for colours (`_rgb_`), which is the same code over
//! three channels.
//!
//! What the robust form does otherwise, and why:
//! - Thresholds are fractions of the signal, so the exposure changes nothing:
//!   a factor of a power of two comes out of every result exactly.
//! - What the clamp against fireflies cuts off is averaged on its own, slowly,
//!   and added to the answer. No light is lost, however sparse it is.
//! - The weight of a sample depends on what came before it and never on the
//!   sample itself: otherwise bright samples would weigh more than dark ones.
//! - The least weight is one over the frames since the signal last moved, not
//!   a constant: after a change, frames count as equals again.
//! - Both averages are noisy, and the distance between them is measured by the
//!   noise of both. By the short one's alone, a mean that takes large steps is
//!   noisy, looks inconsistent, and takes large steps forever.
//! - The first sample is the answer to the first frame. A sample or a state
//!   that is no number counts as none.
//!
//! Source: Barré-Brisebois et al., *Hybrid Rendering for Real-Time Ray Tracing*,
//! Ray Tracing Gems (2019), chapter 25, `MultiscaleMeanEstimator`; the robust
//! form is ours.

use std::ops::{Add, Div, Mul, Sub};

use glam::{UVec4, Vec3};

/// The chapter's blend of the short average.
pub const MULTISCALE_MEAN_SHORT_BLEND: f32 = 0.08;

/// Frames after which the robust form forgets, at most: a weight of 1/256, as
/// the chapter's least.
pub const MULTISCALE_MEAN_LONGEST: f32 = 256.0;

/// Largest magnitude of a sample, or of an average, in the robust form; what is
/// larger is no data. Its square is far from overflowing.
pub const MULTISCALE_MEAN_LARGEST: f32 = 1e15;

/// Largest variance in a state of the robust form.
pub const MULTISCALE_MEAN_LARGEST_VARIANCE: f32 = 4e30;

/// Largest count of frames in a state of the robust form: beyond it `f32`
/// cannot count by one.
pub const MULTISCALE_MEAN_LARGEST_COUNT: f32 = 16777216.0;

/// What is smaller counts as 0 in the robust form, 2^-100: an average that
/// decays forever never becomes subnormal.
pub const MULTISCALE_MEAN_TINY: f32 = 7.8886091e-31;

/// Part of the signal that counts as a deviation where the variance is 0.
const FLOOR: f32 = 0.00390625;
/// Standard errors that the averages may be apart and count as still.
const CALM: f32 = 2.125;
/// How fast the weight grows beyond that.
const EAGER: f32 = 0.34375;
/// The smallest normal number: a smaller variance is 0.
const LEAST: f32 = f32::MIN_POSITIVE;

/// What the printed estimator knows of a number. The chapter starts from
/// zeros, [`MULTISCALE_MEAN_EMPTY`].
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_EMPTY, MULTISCALE_MEAN_SHORT_BLEND, multiscale_mean_step,
/// };
///
/// let state = multiscale_mean_step(
///     MULTISCALE_MEAN_EMPTY,
///     1.0,
///     MULTISCALE_MEAN_SHORT_BLEND,
/// );
/// // It starts from zeros: after a frame only the short average has moved.
/// assert!(state.mean == 0.0 && state.short_mean > 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct MultiscaleMeanState {
    /// The answer.
    pub mean: f32,
    /// The short average.
    pub short_mean: f32,
    /// What the variance leaves of the blend, smoothed.
    pub vbbr: f32,
    /// Variance about the short average.
    pub variance: f32,
    /// How far apart both averages are, in deviations, smoothed.
    pub inconsistency: f32,
}

/// What the printed estimator knows of a colour.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_RGB_EMPTY, MULTISCALE_MEAN_SHORT_BLEND,
///     multiscale_mean_rgb_step,
/// };
///
/// let state = multiscale_mean_rgb_step(
///     MULTISCALE_MEAN_RGB_EMPTY,
///     Vec3::X,
///     MULTISCALE_MEAN_SHORT_BLEND,
/// );
/// assert!(state.short_mean.x > 0.0 && state.short_mean.y == 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct MultiscaleMeanRgbState {
    /// The answer.
    pub mean: Vec3,
    /// The short average.
    pub short_mean: Vec3,
    /// What the variance leaves of the blend, smoothed.
    pub vbbr: f32,
    /// Variance about the short average.
    pub variance: Vec3,
    /// How far apart both averages are, in deviations, smoothed.
    pub inconsistency: f32,
}

/// What the robust estimator knows of a number;
/// [`multiscale_mean_robust_value`] is its answer.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_LONGEST, MULTISCALE_MEAN_ROBUST_EMPTY,
///     MULTISCALE_MEAN_SHORT_BLEND, multiscale_mean_robust_step,
/// };
///
/// let state = multiscale_mean_robust_step(
///     MULTISCALE_MEAN_ROBUST_EMPTY,
///     1.0,
///     MULTISCALE_MEAN_SHORT_BLEND,
///     MULTISCALE_MEAN_LONGEST,
/// );
/// // The first sample is the first answer.
/// assert_eq!((state.mean, state.length, state.age), (1.0, 1.0, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct MultiscaleMeanRobustState {
    /// Average of the samples as far as they are no fireflies.
    pub mean: f32,
    /// The short average of the same.
    pub short_mean: f32,
    /// Average of what was cut off, `>= 0`.
    pub excess: f32,
    /// Variance about the short average, `>= 0`.
    pub variance: f32,
    /// How far apart both averages are, in standard errors, smoothed; `>= 0`.
    pub inconsistency: f32,
    /// Frames in the mean: since the signal moved.
    pub length: f32,
    /// Frames in all, as far as counted; 0 for none.
    pub age: f32,
}

/// What the robust estimator knows of a colour.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_LONGEST, MULTISCALE_MEAN_ROBUST_RGB_EMPTY,
///     MULTISCALE_MEAN_SHORT_BLEND, multiscale_mean_robust_rgb_step,
/// };
///
/// let state = multiscale_mean_robust_rgb_step(
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY,
///     Vec3::X,
///     MULTISCALE_MEAN_SHORT_BLEND,
///     MULTISCALE_MEAN_LONGEST,
/// );
/// assert_eq!((state.mean, state.age), (Vec3::X, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct MultiscaleMeanRobustRgbState {
    /// Average of the samples as far as they are no fireflies.
    pub mean: Vec3,
    /// The short average of the same.
    pub short_mean: Vec3,
    /// Average of what was cut off, `>= 0`.
    pub excess: Vec3,
    /// Variance about the short average, `>= 0`.
    pub variance: Vec3,
    /// How far apart both averages are, in standard errors, smoothed; `>= 0`.
    pub inconsistency: f32,
    /// Frames in the mean: since the signal moved.
    pub length: f32,
    /// Frames in all, as far as counted; 0 for none.
    pub age: f32,
}

/// A colour's state in 40 bytes: [`multiscale_mean_robust_rgb_pack`]. Zeros are
/// [`MULTISCALE_MEAN_ROBUST_RGB_EMPTY`].
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY, MultiscaleMeanRobustRgbPacked,
///     multiscale_mean_robust_rgb_pack,
/// };
///
/// let none = multiscale_mean_robust_rgb_pack(MULTISCALE_MEAN_ROBUST_RGB_EMPTY);
/// assert_eq!(none, MultiscaleMeanRobustRgbPacked::default());
/// assert_eq!(std::mem::size_of_val(&none), 40);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct MultiscaleMeanRobustRgbPacked {
    /// Bits of the mean.
    pub mean_x: u32,
    /// Bits of the mean.
    pub mean_y: u32,
    /// Bits of the mean.
    pub mean_z: u32,
    /// What was cut off, and the age.
    pub excess_x: u32,
    /// What was cut off.
    pub excess_y: u32,
    /// What was cut off.
    pub excess_z: u32,
    /// From the mean to the short one, and the variance.
    pub spread_x: u32,
    /// From the mean to the short one, and the variance.
    pub spread_y: u32,
    /// From the mean to the short one, and the variance.
    pub spread_z: u32,
    /// Inconsistency and length.
    pub counts: u32,
}

/// The chapter's start.
pub const MULTISCALE_MEAN_EMPTY: MultiscaleMeanState = Printed::<f32>::EMPTY.scalar();

/// The chapter's start, for a colour.
pub const MULTISCALE_MEAN_RGB_EMPTY: MultiscaleMeanRgbState = Printed::<Vec3>::EMPTY.color();

/// No sample yet.
pub const MULTISCALE_MEAN_ROBUST_EMPTY: MultiscaleMeanRobustState = Robust::<f32>::EMPTY.scalar();

/// No colour yet.
pub const MULTISCALE_MEAN_ROBUST_RGB_EMPTY: MultiscaleMeanRobustRgbState =
    Robust::<Vec3>::EMPTY.color();

/// What both signals can do: one source for colours and numbers.
trait Signal:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Mul<f32, Output = Self>
{
    fn splat(x: f32) -> Self;
    /// One number for all channels: the chapter's luma.
    fn luma(self) -> f32;
    fn by_channel(self, f: impl Fn(f32) -> f32) -> Self;
    fn lower(self, other: Self) -> Self;
    fn upper(self, other: Self) -> Self;
    /// Whether every channel is a number of at most this magnitude, by bits.
    fn usable(self, largest: f32) -> bool;
}

impl Signal for f32 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn luma(self) -> f32 {
        self
    }
    #[inline(always)]
    fn by_channel(self, f: impl Fn(f32) -> f32) -> Self {
        f(self)
    }
    #[inline(always)]
    fn lower(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn upper(self, other: Self) -> Self {
        self.max(other)
    }
    #[inline(always)]
    fn usable(self, largest: f32) -> bool {
        (self.to_bits() & 0x7fff_ffff) <= largest.to_bits()
    }
}

impl Signal for Vec3 {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Vec3::splat(x)
    }
    #[inline(always)]
    fn luma(self) -> f32 {
        0.299 * self.x + 0.587 * self.y + 0.114 * self.z
    }
    #[inline(always)]
    fn by_channel(self, f: impl Fn(f32) -> f32) -> Self {
        Vec3::new(f(self.x), f(self.y), f(self.z))
    }
    #[inline(always)]
    fn lower(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn upper(self, other: Self) -> Self {
        self.max(other)
    }
    #[inline(always)]
    fn usable(self, largest: f32) -> bool {
        self.x.usable(largest) & self.y.usable(largest) & self.z.usable(largest)
    }
}

/// A state of the printed form over any signal.
#[derive(Clone, Copy)]
struct Printed<V> {
    mean: V,
    short_mean: V,
    vbbr: f32,
    variance: V,
    inconsistency: f32,
}

/// A state of the robust form over any signal.
#[derive(Clone, Copy)]
struct Robust<V> {
    mean: V,
    short_mean: V,
    excess: V,
    variance: V,
    inconsistency: f32,
    length: f32,
    age: f32,
}

/// Conversions between a state over any signal and a public one.
macro_rules! states {
    ($generic:ident, $signal:ty, $public:ident, $back:ident, $zero:expr,
     [$($value:ident),*], [$($number:ident),*]) => {
        impl $generic<$signal> {
            const EMPTY: Self = Self { $($value: $zero,)* $($number: 0.0,)* };
            #[inline(always)]
            const fn $back(self) -> $public {
                $public { $($value: self.$value,)* $($number: self.$number,)* }
            }
            #[inline(always)]
            fn from_public(state: $public) -> Self {
                Self { $($value: state.$value,)* $($number: state.$number,)* }
            }
        }
    };
}

states!(
    Printed,
    f32,
    MultiscaleMeanState,
    scalar,
    0.0,
    [mean, short_mean, variance],
    [vbbr, inconsistency]
);
states!(
    Printed,
    Vec3,
    MultiscaleMeanRgbState,
    color,
    Vec3::ZERO,
    [mean, short_mean, variance],
    [vbbr, inconsistency]
);
states!(
    Robust,
    f32,
    MultiscaleMeanRobustState,
    scalar,
    0.0,
    [mean, short_mean, excess, variance],
    [inconsistency, length, age]
);
states!(
    Robust,
    Vec3,
    MultiscaleMeanRobustRgbState,
    color,
    Vec3::ZERO,
    [mean, short_mean, excess, variance],
    [inconsistency, length, age]
);

/// `smoothstep(0, 1, x)`.
#[inline(always)]
fn smooth(x: f32) -> f32 {
    let t = x.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The printed weight of a sample before it is reduced by the variance, in
/// `[1/256, 1]`: `clamp(smoothstep(0, 1, d·max(0.02, i - 0.2)), 1/256, 1)`.
///
/// `relative` is how far apart the averages are, in deviations; `inconsistency`
/// the same, smoothed. Both `>= 0`.
///
/// Error analysis: the slope of the smoothstep is at most 1.5 and its argument
/// errs by 2 ULP; `i - 0.2` cancels only where 0.02 is larger.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::multiscale_mean_blend;
///
/// // Still: the least weight. Apart, and so for some frames: large steps.
/// assert_eq!(multiscale_mean_blend(0.0, 0.0), 1.0 / 256.0);
/// assert_eq!(multiscale_mean_blend(2.0, 2.0), 1.0);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_blend(relative: f32, inconsistency: f32) -> f32 {
    let lead = (inconsistency - 0.2).max(0.02);
    smooth(relative * lead).clamp(1.0 / 256.0, 1.0)
}

/// The robust form's weight of a sample while the signal moves, in `[0, 1]`:
/// `reduction · smoothstep(0, 1, 11/32·d·max(0, i - 17/8))`.
///
/// `relative` is how far apart the averages are, in standard errors of that
/// distance; `inconsistency` the same, smoothed; `reduction` in `[1/32, 1]`. In
/// a still signal `i` stays about 0.8, so the result is 0.
///
/// Error analysis: as [`multiscale_mean_blend`]; where `i - 17/8` cancels it is
/// exact.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::multiscale_mean_robust_blend;
///
/// assert_eq!(multiscale_mean_robust_blend(0.8, 0.8, 1.0), 0.0);
/// assert!(multiscale_mean_robust_blend(4.0, 4.0, 1.0) > 0.9);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_blend(relative: f32, inconsistency: f32, reduction: f32) -> f32 {
    let lead = (inconsistency - CALM).max(0.0);
    smooth(EAGER * relative * lead) * reduction
}

#[inline(always)]
fn lerp<V: Signal>(from: V, to: V, t: f32) -> V {
    from + (to - from) * t
}

/// The chapter's listing, line by line.
#[inline(always)]
fn printed_step<V: Signal>(state: Printed<V>, sample: V, short_blend: f32) -> Printed<V> {
    // Fireflies.
    let early = state.variance.upper(V::splat(1e-5)).by_channel(f32::sqrt);
    let high = V::splat(0.1) + state.short_mean + early * 8.0;
    let overflow = (sample - high).upper(V::splat(0.0));
    let y = sample - overflow;
    // Short-term mean and variance.
    let delta = y - state.short_mean;
    let short_mean = lerp(state.short_mean, y, short_blend);
    let delta2 = y - short_mean;
    let variance = lerp(state.variance, delta * delta2, short_blend * 0.5);
    let root = variance.upper(V::splat(1e-5)).by_channel(f32::sqrt);
    let deviation = root.upper(V::splat(1e-5));
    // How far the long-term mean lags behind.
    let short_diff = state.mean - short_mean;
    let relative = (short_diff.by_channel(f32::abs) / deviation).luma();
    let inconsistency = state.inconsistency + (relative - state.inconsistency) * 0.08;
    let reduction = (short_mean * 0.5 / deviation).luma().clamp(1.0 / 32.0, 1.0);
    // The reduction of the frame before.
    let blend = multiscale_mean_blend(relative, inconsistency) * state.vbbr;
    let vbbr = state.vbbr + (reduction - state.vbbr) * 0.1;
    Printed {
        mean: lerp(state.mean, y, blend.clamp(0.0, 1.0)),
        short_mean,
        vbbr,
        variance,
        inconsistency,
    }
}

/// The printed estimator with a frame's sample added; `mean` is its answer.
///
/// `short_blend` in `(0, 1]`, [`MULTISCALE_MEAN_SHORT_BLEND`] in the chapter.
/// Constants and order are the chapter's, the defects too: thresholds of 0.1
/// and 1e-5 make it depend on the exposure, its clamp eats sparse light (of one
/// hit of 100 in 100 frames 0.2 % is left), and one infinite sample poisons the
/// state. [`multiscale_mean_robust_step`] has none of these.
///
/// Error analysis: `relative` divides a difference by a deviation of 1/316 or
/// more: its error is that of the averages over the deviation, and all else
/// follows it with slopes of order one.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_EMPTY, MULTISCALE_MEAN_SHORT_BLEND, multiscale_mean_step,
/// };
///
/// let mut state = MULTISCALE_MEAN_EMPTY;
/// for _ in 0..200 {
///     state = multiscale_mean_step(state, 0.5, MULTISCALE_MEAN_SHORT_BLEND);
/// }
/// assert!((state.mean - 0.5).abs() < 0.05);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_step(
    state: MultiscaleMeanState,
    sample: f32,
    short_blend: f32,
) -> MultiscaleMeanState {
    printed_step(Printed::<f32>::from_public(state), sample, short_blend).scalar()
}

/// As [`multiscale_mean_step`], for a colour: one weight for all channels.
///
/// Error analysis: as there.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_RGB_EMPTY, MULTISCALE_MEAN_SHORT_BLEND,
///     multiscale_mean_rgb_step,
/// };
///
/// let color = Vec3::new(0.5, 0.2, 0.1);
/// let mut state = MULTISCALE_MEAN_RGB_EMPTY;
/// for _ in 0..200 {
///     state =
///         multiscale_mean_rgb_step(state, color, MULTISCALE_MEAN_SHORT_BLEND);
/// }
/// assert!((state.mean - color).length() < 0.1);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_rgb_step(
    state: MultiscaleMeanRgbState,
    sample: Vec3,
    short_blend: f32,
) -> MultiscaleMeanRgbState {
    printed_step(Printed::<Vec3>::from_public(state), sample, short_blend).color()
}

/// From `from` toward `to`, never beyond either; what is below `least` is 0.
#[inline(always)]
fn toward<V: Signal>(from: V, to: V, t: f32, least: f32) -> V {
    let moved = (from + (to - from) * t)
        .upper(from.lower(to))
        .lower(from.upper(to));
    moved.by_channel(|x| if x.abs() < least { 0.0 } else { x })
}

#[inline(always)]
fn robust_guard<V: Signal>(state: Robust<V>, empty: Robust<V>) -> Robust<V> {
    let values = state.mean.usable(MULTISCALE_MEAN_LARGEST)
        & state.short_mean.usable(MULTISCALE_MEAN_LARGEST)
        & state.excess.usable(MULTISCALE_MEAN_LARGEST)
        & state.variance.usable(MULTISCALE_MEAN_LARGEST_VARIANCE);
    let numbers = state.inconsistency.usable(MULTISCALE_MEAN_LARGEST_COUNT)
        & state.length.usable(MULTISCALE_MEAN_LARGEST_COUNT)
        & state.age.usable(MULTISCALE_MEAN_LARGEST_COUNT);
    if !(values & numbers) {
        return empty;
    }
    Robust {
        mean: state.mean,
        short_mean: state.short_mean,
        excess: state.excess.upper(V::splat(0.0)),
        variance: state.variance.upper(V::splat(0.0)),
        inconsistency: state.inconsistency.max(0.0),
        length: state.length.max(0.0),
        age: state.age.max(0.0),
    }
}

#[inline(always)]
fn robust_step<V: Signal>(
    state: Robust<V>,
    empty: Robust<V>,
    sample: V,
    short_blend: f32,
    longest: f32,
) -> Robust<V> {
    let kept = robust_guard(state, empty);
    if !sample.usable(MULTISCALE_MEAN_LARGEST) {
        return kept;
    }
    if kept.age < 1.0 {
        return Robust {
            mean: sample,
            short_mean: sample,
            length: 1.0,
            age: 1.0,
            ..empty
        };
    }
    // What is known before the sample decides how much it weighs.
    let size = kept
        .mean
        .by_channel(f32::abs)
        .upper(kept.short_mean.by_channel(f32::abs));
    let deviation = kept.variance.by_channel(f32::sqrt).upper(size * FLOOR);
    let divisor = deviation.upper(V::splat(MULTISCALE_MEAN_TINY));
    // The variances of both averages over that of the samples; half of the
    // mean's, for the newest samples are in both.
    let of_short = short_blend / (2.0 - short_blend);
    let of_mean = 0.5 / (2.0 * kept.length.max(1.0) - 1.0);
    let spread = (of_short + of_mean).sqrt();
    let apart = (kept.mean - kept.short_mean).by_channel(f32::abs);
    let relative = (apart / divisor).luma() / spread;
    let inconsistency = toward(kept.inconsistency, relative, short_blend, LEAST);
    let level = kept
        .short_mean
        .by_channel(f32::abs)
        .upper(V::splat(MULTISCALE_MEAN_TINY));
    let reduction = (level * 0.5 / divisor).luma().clamp(1.0 / 32.0, 1.0);
    let catch_up = multiscale_mean_robust_blend(relative, inconsistency, reduction);
    let cap = longest.max(1.0);
    let length = (kept.length + 1.0).min(cap);
    let age = (kept.age + 1.0).min(cap);
    let even = 1.0 / length;
    let young = 1.0 / age;
    let blend = catch_up.max(even);
    // Fireflies: cut off, but kept.
    let whole = kept.short_mean + kept.excess;
    let high = whole + (whole.by_channel(f32::abs) * 0.1 + deviation * 8.0);
    let clipped = sample.lower(high);
    let short = short_blend.max(young);
    let delta = clipped - kept.short_mean;
    Robust {
        mean: toward(kept.mean, clipped, blend, MULTISCALE_MEAN_TINY),
        short_mean: toward(kept.short_mean, clipped, short, MULTISCALE_MEAN_TINY),
        excess: toward(kept.excess, sample - clipped, young, MULTISCALE_MEAN_TINY),
        variance: toward(
            kept.variance,
            delta * delta * (1.0 - short),
            (short_blend * 0.5).max(young),
            LEAST,
        ),
        inconsistency,
        length: if catch_up > even {
            1.0 / catch_up
        } else {
            length
        },
        age,
    }
}

/// The robust estimator with a frame's sample added.
///
/// `short_blend` in `(0, 1]`, as in [`multiscale_mean_step`]; `longest >= 1` is
/// the longest memory in frames. A sample that is no number, or larger than
/// [`MULTISCALE_MEAN_LARGEST`], is left out: the state stays as it was. A state
/// with such a member counts as none, and the sample starts a new one.
///
/// All samples times a power of two give all averages times the same, exactly,
/// as long as they stay between 2^-45 and 2^49. A constant gives exactly that
/// constant.
///
/// Error analysis: `relative` divides the averages' difference by a deviation of
/// at least 1/256 of them: its error is that of their rounding over the
/// deviation. The weight follows it with a slope of 1.5 times the inconsistency;
/// every average is a blend of two numbers and adds less than 2 ULP of the
/// larger.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_LONGEST, MULTISCALE_MEAN_ROBUST_EMPTY,
///     MULTISCALE_MEAN_SHORT_BLEND, multiscale_mean_robust_step,
///     multiscale_mean_robust_value,
/// };
///
/// let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
/// for frame in 0..100 {
///     // Sparse light: one hit of 100 in 10 frames, 10 on average.
///     let sample = if frame % 10 == 9 { 100.0 } else { 0.0 };
///     state = multiscale_mean_robust_step(
///         state,
///         sample,
///         MULTISCALE_MEAN_SHORT_BLEND,
///         MULTISCALE_MEAN_LONGEST,
///     );
/// }
/// assert!((multiscale_mean_robust_value(state) - 10.0).abs() < 3.0);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_step(
    state: MultiscaleMeanRobustState,
    sample: f32,
    short_blend: f32,
    longest: f32,
) -> MultiscaleMeanRobustState {
    let (state, empty) = (Robust::<f32>::from_public(state), Robust::<f32>::EMPTY);
    robust_step(state, empty, sample, short_blend, longest).scalar()
}

/// As [`multiscale_mean_robust_step`], for a colour: one weight for all
/// channels. A colour with one bad channel is left out whole.
///
/// Error analysis: as there.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_LONGEST, MULTISCALE_MEAN_ROBUST_RGB_EMPTY,
///     MULTISCALE_MEAN_SHORT_BLEND, multiscale_mean_robust_rgb_step,
///     multiscale_mean_robust_rgb_value,
/// };
///
/// // A constant gives exactly that constant.
/// let color = Vec3::new(0.5, 0.2, 0.1);
/// let mut state = MULTISCALE_MEAN_ROBUST_RGB_EMPTY;
/// for _ in 0..50 {
///     state = multiscale_mean_robust_rgb_step(
///         state,
///         color,
///         MULTISCALE_MEAN_SHORT_BLEND,
///         MULTISCALE_MEAN_LONGEST,
///     );
/// }
/// assert_eq!(multiscale_mean_robust_rgb_value(state), color);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_rgb_step(
    state: MultiscaleMeanRobustRgbState,
    sample: Vec3,
    short_blend: f32,
    longest: f32,
) -> MultiscaleMeanRobustRgbState {
    let (state, empty) = (Robust::<Vec3>::from_public(state), Robust::<Vec3>::EMPTY);
    robust_step(state, empty, sample, short_blend, longest).color()
}

/// The state as it may be used: [`MULTISCALE_MEAN_ROBUST_EMPTY`] if a member is
/// NaN, infinite or too large; members below 0 that cannot be count as 0.
/// Exact.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_EMPTY, MultiscaleMeanRobustState,
///     multiscale_mean_robust_guard,
/// };
///
/// let broken = MultiscaleMeanRobustState {
///     mean: f32::NAN,
///     age: 9.0,
///     ..MULTISCALE_MEAN_ROBUST_EMPTY
/// };
/// assert_eq!(
///     multiscale_mean_robust_guard(broken),
///     MULTISCALE_MEAN_ROBUST_EMPTY
/// );
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_guard(state: MultiscaleMeanRobustState) -> MultiscaleMeanRobustState {
    let (state, empty) = (Robust::<f32>::from_public(state), Robust::<f32>::EMPTY);
    robust_guard(state, empty).scalar()
}

/// As [`multiscale_mean_robust_guard`], for a colour. Exact.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY, MultiscaleMeanRobustRgbState,
///     multiscale_mean_robust_rgb_guard,
/// };
///
/// let broken = MultiscaleMeanRobustRgbState {
///     length: f32::INFINITY,
///     ..MULTISCALE_MEAN_ROBUST_RGB_EMPTY
/// };
/// assert_eq!(
///     multiscale_mean_robust_rgb_guard(broken),
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY
/// );
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_rgb_guard(
    state: MultiscaleMeanRobustRgbState,
) -> MultiscaleMeanRobustRgbState {
    let (state, empty) = (Robust::<Vec3>::from_public(state), Robust::<Vec3>::EMPTY);
    robust_guard(state, empty).color()
}

/// The robust estimator's answer: the mean with what was cut off.
///
/// Error analysis: one sum.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_EMPTY, MultiscaleMeanRobustState,
///     multiscale_mean_robust_value,
/// };
///
/// let state = MultiscaleMeanRobustState {
///     mean: 1.0,
///     excess: 0.25,
///     ..MULTISCALE_MEAN_ROBUST_EMPTY
/// };
/// assert_eq!(multiscale_mean_robust_value(state), 1.25);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_value(state: MultiscaleMeanRobustState) -> f32 {
    state.mean + state.excess
}

/// As [`multiscale_mean_robust_value`], for a colour.
///
/// Error analysis: one sum a channel.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY, MultiscaleMeanRobustRgbState,
///     multiscale_mean_robust_rgb_value,
/// };
///
/// let state = MultiscaleMeanRobustRgbState {
///     mean: Vec3::ONE,
///     excess: Vec3::X,
///     ..MULTISCALE_MEAN_ROBUST_RGB_EMPTY
/// };
/// assert_eq!(multiscale_mean_robust_rgb_value(state), Vec3::new(2.0, 1.0, 1.0));
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_rgb_value(state: MultiscaleMeanRobustRgbState) -> Vec3 {
    state.mean + state.excess
}

/// The upper half of an `f32` (8 bits of significand), rounded to nearest, ties
/// to even; what is below 2^-100 is 0. `x` is finite and below 2^127.
///
/// Error analysis: at most 2^-8 of the number. Exact in that the twins agree:
/// integers alone.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::multiscale_mean_upper_half;
///
/// assert_eq!(multiscale_mean_upper_half(1.0), 0x3f80);
/// // Eight bits of significand: 1 + 1/1024 is rounded to 1.
/// assert_eq!(multiscale_mean_upper_half(1.0 + 1.0 / 1024.0), 0x3f80);
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_upper_half(x: f32) -> u32 {
    let bits = x.to_bits();
    if (bits & 0x7fff_ffff) < MULTISCALE_MEAN_TINY.to_bits() {
        return 0;
    }
    (bits + 0x7fff + ((bits >> 16) & 1)) >> 16
}

#[inline(always)]
fn pair(low: f32, high: f32) -> u32 {
    multiscale_mean_upper_half(low) | (multiscale_mean_upper_half(high) << 16)
}

#[inline(always)]
fn low(word: u32) -> f32 {
    f32::from_bits(word << 16)
}

#[inline(always)]
fn high(word: u32) -> f32 {
    f32::from_bits(word & 0xffff_0000)
}

/// The upper 24 bits of a number's bits, rounded to nearest, ties to even, with
/// a count of at most 255 below them.
#[inline(always)]
fn with_count(x: f32, count: f32) -> u32 {
    let bits = x.to_bits();
    ((bits + 0x7f + ((bits >> 8) & 1)) & 0xffff_ff00) | (count.min(255.0) as u32)
}

#[inline(always)]
fn without_count(word: u32) -> f32 {
    f32::from_bits(word & 0xffff_ff00)
}

#[inline(always)]
fn count(word: u32) -> f32 {
    (word & 0xff) as f32
}

/// A state in 16 bytes of 28: the mean as it is, what was cut off in 24 bits
/// with the age in the 8 below, all else as [`multiscale_mean_upper_half`], the
/// short average by its distance from the mean. Frames are counted to 255, so
/// `longest` should be at most 256.
///
/// Error analysis: 2^-8 of each number, of the distance for the short average;
/// 2^-16 of what was cut off, whose average moves by 1/256 a frame and would
/// stall in fewer bits. A state that holds no numbers is packed as none.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_EMPTY, multiscale_mean_robust_pack,
///     multiscale_mean_robust_step, multiscale_mean_robust_unpack,
/// };
///
/// let state = multiscale_mean_robust_step(
///     MULTISCALE_MEAN_ROBUST_EMPTY,
///     0.3,
///     0.08,
///     256.0,
/// );
/// // The mean keeps all of its bits.
/// let back = multiscale_mean_robust_unpack(multiscale_mean_robust_pack(state));
/// assert_eq!((back.mean, back.age), (state.mean, state.age));
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_pack(state: MultiscaleMeanRobustState) -> UVec4 {
    let s = multiscale_mean_robust_guard(state);
    UVec4::new(
        s.mean.to_bits(),
        with_count(s.excess, s.age),
        pair(s.short_mean - s.mean, s.variance),
        pair(s.inconsistency, s.length),
    )
}

/// The state behind [`multiscale_mean_robust_pack`]'s words; for any other
/// words one that may hold no numbers.
///
/// Error analysis: one sum, for the short average.
///
/// ```
/// use glam::UVec4;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_EMPTY, multiscale_mean_robust_unpack,
/// };
///
/// assert_eq!(
///     multiscale_mean_robust_unpack(UVec4::ZERO),
///     MULTISCALE_MEAN_ROBUST_EMPTY
/// );
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_unpack(words: UVec4) -> MultiscaleMeanRobustState {
    let mean = f32::from_bits(words.x);
    MultiscaleMeanRobustState {
        mean,
        short_mean: mean + low(words.z),
        excess: without_count(words.y),
        variance: high(words.z),
        inconsistency: low(words.w),
        length: high(words.w),
        age: count(words.y),
    }
}

/// As [`multiscale_mean_robust_pack`], for a colour: 40 bytes of 60.
///
/// Error analysis: as there.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY, multiscale_mean_robust_rgb_pack,
///     multiscale_mean_robust_rgb_step, multiscale_mean_robust_rgb_unpack,
/// };
///
/// let color = Vec3::new(0.5, 0.2, 0.1);
/// let state = multiscale_mean_robust_rgb_step(
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY,
///     color,
///     0.08,
///     256.0,
/// );
/// let back =
///     multiscale_mean_robust_rgb_unpack(multiscale_mean_robust_rgb_pack(state));
/// assert_eq!((back.mean, back.age), (color, 1.0));
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_rgb_pack(
    state: MultiscaleMeanRobustRgbState,
) -> MultiscaleMeanRobustRgbPacked {
    let s = multiscale_mean_robust_rgb_guard(state);
    let away = s.short_mean - s.mean;
    MultiscaleMeanRobustRgbPacked {
        mean_x: s.mean.x.to_bits(),
        mean_y: s.mean.y.to_bits(),
        mean_z: s.mean.z.to_bits(),
        excess_x: with_count(s.excess.x, s.age),
        excess_y: with_count(s.excess.y, 0.0),
        excess_z: with_count(s.excess.z, 0.0),
        spread_x: pair(away.x, s.variance.x),
        spread_y: pair(away.y, s.variance.y),
        spread_z: pair(away.z, s.variance.z),
        counts: pair(s.inconsistency, s.length),
    }
}

/// As [`multiscale_mean_robust_unpack`], for a colour.
///
/// Error analysis: as there.
///
/// ```
/// use raytwin_cpu::temporal::multiscale_mean::{
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY, MultiscaleMeanRobustRgbPacked,
///     multiscale_mean_robust_rgb_unpack,
/// };
///
/// let zeros = MultiscaleMeanRobustRgbPacked::default();
/// assert_eq!(
///     multiscale_mean_robust_rgb_unpack(zeros),
///     MULTISCALE_MEAN_ROBUST_RGB_EMPTY
/// );
/// ```
#[inline]
#[must_use]
pub fn multiscale_mean_robust_rgb_unpack(
    words: MultiscaleMeanRobustRgbPacked,
) -> MultiscaleMeanRobustRgbState {
    let w = words;
    let mean = Vec3::new(
        f32::from_bits(w.mean_x),
        f32::from_bits(w.mean_y),
        f32::from_bits(w.mean_z),
    );
    let away = Vec3::new(low(w.spread_x), low(w.spread_y), low(w.spread_z));
    MultiscaleMeanRobustRgbState {
        mean,
        short_mean: mean + away,
        excess: Vec3::new(
            without_count(w.excess_x),
            without_count(w.excess_y),
            without_count(w.excess_z),
        ),
        variance: Vec3::new(high(w.spread_x), high(w.spread_y), high(w.spread_z)),
        inconsistency: low(w.counts),
        length: high(w.counts),
        age: count(w.excess_x),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_next, pcg_unit};

    const SHORT: f32 = MULTISCALE_MEAN_SHORT_BLEND;
    const LONGEST: f32 = MULTISCALE_MEAN_LONGEST;

    fn numbers(seed: u32) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            let next = pcg_next(state);
            state = next.state;
            pcg_unit(next.value)
        }
    }

    fn robust(state: &mut MultiscaleMeanRobustState, sample: f32) -> f32 {
        *state = multiscale_mean_robust_step(*state, sample, SHORT, LONGEST);
        multiscale_mean_robust_value(*state)
    }

    fn printed(state: &mut MultiscaleMeanState, sample: f32) -> f32 {
        *state = multiscale_mean_step(*state, sample, SHORT);
        state.mean
    }

    /// The listing in double precision: mean, short mean, reduction, variance,
    /// inconsistency. Blends as weighted sums.
    fn printed_f64(state: &mut [f64; 5], sample: f64) -> f64 {
        let [mean, short, vbbr, variance, inconsistency] = *state;
        let blend = |from: f64, to: f64, t: f64| from * (1.0 - t) + to * t;
        let y = sample.min(0.1 + short + 8.0 * variance.max(1e-5).sqrt());
        let short_after = blend(short, y, 0.08);
        let variance_after = blend(variance, (y - short) * (y - short_after), 0.04);
        let deviation = variance_after.max(1e-5).sqrt();
        let relative = (mean - short_after).abs() / deviation;
        let inconsistency_after = blend(inconsistency, relative, 0.08);
        let x = (relative * (inconsistency_after - 0.2).max(0.02)).min(1.0);
        let weight = (3.0 * x * x - 2.0 * x * x * x).max(1.0 / 256.0) * vbbr;
        let reduction = (0.5 * short_after / deviation).clamp(1.0 / 32.0, 1.0);
        *state = [
            blend(mean, y, weight.min(1.0)),
            short_after,
            blend(vbbr, reduction, 0.1),
            variance_after,
            inconsistency_after,
        ];
        state[0]
    }

    /// The robust form in double precision, as one would write it down: mean,
    /// short mean, excess, variance, inconsistency, length, age.
    fn robust_f64(state: &mut [f64; 7], sample: f64) -> f64 {
        let [mean, short, excess, variance, inconsistency, length, age] = *state;
        if age == 0.0 {
            *state = [sample, sample, 0.0, 0.0, 0.0, 1.0, 1.0];
            return sample;
        }
        let blend = |from: f64, to: f64, t: f64| from * (1.0 - t) + to * t;
        let a = f64::from(SHORT);
        let deviation = variance
            .sqrt()
            .max(mean.abs().max(short.abs()) / 256.0)
            .max(2f64.powi(-100));
        let error = deviation * (a / (2.0 - a) + 0.5 / (2.0 * length - 1.0)).sqrt();
        let relative = (mean - short).abs() / error;
        let inconsistency = blend(inconsistency, relative, a);
        let x = (relative * (inconsistency - 2.125).max(0.0) * 11.0 / 32.0).min(1.0);
        let reduction = (short.abs() / (2.0 * deviation)).clamp(1.0 / 32.0, 1.0);
        let catch_up = (3.0 * x * x - 2.0 * x * x * x) * reduction;
        let (length, age) = ((length + 1.0).min(256.0), (age + 1.0).min(256.0));
        let high = short + excess + 0.1 * (short + excess).abs() + 8.0 * deviation;
        let clipped = sample.min(high);
        let of_short = a.max(1.0 / age);
        let short_after = blend(short, clipped, of_short);
        *state = [
            blend(mean, clipped, catch_up.max(1.0 / length)),
            short_after,
            blend(excess, sample - clipped, 1.0 / age),
            blend(
                variance,
                (clipped - short) * (clipped - short_after),
                (a / 2.0).max(1.0 / age),
            ),
            inconsistency,
            length.min(1.0 / catch_up),
            age,
        ];
        state[0] + state[2]
    }

    /// Noise whose level jumps, with dark spells and fireflies.
    fn scene(next: &mut impl FnMut() -> f32, frame: u32) -> f32 {
        let level = [1.0, 0.2, 3.0, 0.01][(frame / 700 % 4) as usize];
        let firefly = if next() < 0.002 { 50.0 } else { 1.0 };
        level * firefly * (0.5 + next())
    }

    #[test]
    fn the_printed_form_gives_hand_computed_numbers() {
        // From zeros: the clamp lets 0.1 + 8·√1e-5 through, the blend is 0.
        let first = multiscale_mean_step(MULTISCALE_MEAN_EMPTY, 1.0, 0.08);
        let expected = [0.0, 0.010_023_86, 0.020_851_3, 5.777_51e-4, 0.033_362_1];
        let got = [
            first.mean,
            first.short_mean,
            first.vbbr,
            first.variance,
            first.inconsistency,
        ];
        for (got, expected) in got.into_iter().zip(expected) {
            assert!(
                (f64::from(got) - expected).abs() <= 2e-5 * expected,
                "{got} {expected}"
            );
        }
        // The second frame's weight is 1/256 of the first one's reduction.
        let second = multiscale_mean_step(first, 1.0, 0.08);
        let y = 0.1 + first.short_mean + 8.0 * first.variance.sqrt();
        assert!((second.mean - y * first.vbbr / 256.0).abs() < 1e-9);
    }

    #[test]
    fn the_printed_form_follows_the_oracle() {
        let mut next = numbers(1);
        let (mut state, mut wide) = (MULTISCALE_MEAN_EMPTY, [0.0; 5]);
        for frame in 0..20_000 {
            let y = scene(&mut next, frame);
            let (got, want) = (printed(&mut state, y), printed_f64(&mut wide, y.into()));
            assert!(
                (f64::from(got) - want).abs() < 2e-5 * want.max(0.01),
                "{frame}: {got} {want}"
            );
        }
    }

    #[test]
    fn the_printed_form_has_the_known_figures() {
        let reach = |level: f32, part: f32| {
            let mut state = MULTISCALE_MEAN_EMPTY;
            (1..2000).find(|_| printed(&mut state, level) >= part * level)
        };
        assert_eq!((reach(1.0, 0.9), reach(1.0, 0.99)), (Some(52), Some(154)));
        assert_eq!((reach(0.01, 0.9), reach(0.01, 0.99)), (Some(79), Some(666)));
    }

    /// Mean of the answers to hits of probability `p` whose true mean is
    /// `scale`, over that mean.
    fn bias(p: f32, scale: f32, answer: &mut dyn FnMut(f32) -> f32) -> f64 {
        let (settle, frames) = (20_000, 2_000_000);
        let mut next = numbers(7);
        let mut sum = 0.0;
        for frame in 0..settle + frames {
            let y = if next() < p { scale / p } else { 0.0 };
            let value = f64::from(answer(y));
            if frame >= settle {
                sum += value;
            }
        }
        sum / (f64::from(frames) * f64::from(scale))
    }

    #[test]
    fn sparse_light_is_kept_and_the_printed_form_loses_it() {
        for (p, most) in [(0.5, 0.005), (0.1, 0.02), (0.01, 0.02), (0.001, 0.03)] {
            for scale in [1.0, 1e-3, 1e6] {
                let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
                let ours = bias(p, scale, &mut |y| robust(&mut state, y));
                assert!((ours - 1.0).abs() < most, "{p}, {scale}: {ours}");
            }
        }
        for (p, low, high) in [(0.1, 0.85, 0.97), (0.01, 0.0, 0.003), (0.001, 0.0, 0.001)] {
            let mut state = MULTISCALE_MEAN_EMPTY;
            let theirs = bias(p, 1.0, &mut |y| printed(&mut state, y));
            assert!(theirs > low && theirs < high, "{p}: {theirs}");
        }
    }

    #[test]
    fn exposure_changes_nothing_but_the_scale() {
        for power in [-35, -20, -1, 1, 7, 40] {
            let scale = 2f32.powi(power);
            let mut next = numbers(3);
            let mut one = MULTISCALE_MEAN_ROBUST_EMPTY;
            let mut other = one;
            for frame in 0..6000 {
                let y = scene(&mut next, frame);
                let (a, b) = (robust(&mut one, y), robust(&mut other, scale * y));
                assert_eq!(scale * a, b, "2^{power}, frame {frame}");
                assert_eq!(one.inconsistency, other.inconsistency);
                assert_eq!(one.length, other.length);
            }
        }
        // The printed form answers a dim signal otherwise.
        let (mut one, mut other) = (MULTISCALE_MEAN_EMPTY, MULTISCALE_MEAN_EMPTY);
        let scale = 2f32.powi(-7);
        let apart = (0..60).any(|_| {
            let (a, b) = (printed(&mut one, 1.0), printed(&mut other, scale));
            (scale * a - b).abs() > 0.1 * b
        });
        assert!(apart);
    }

    const BAD: [f32; 7] = [
        f32::NAN,
        -f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        1e30,
        -1e30,
    ];

    #[test]
    fn nothing_poisons_a_state_and_infinity_poisons_the_printed_one() {
        let mut start = MULTISCALE_MEAN_ROBUST_EMPTY;
        let mut next = numbers(5);
        for _ in 0..100 {
            robust(&mut start, 0.5 + next());
        }
        for bad in BAD {
            // As a sample: left out.
            let mut state = start;
            robust(&mut state, bad);
            assert_eq!(state, start, "{bad}");
            // In the state: none, and the next sample is the answer.
            for member in 0..7 {
                let mut broken = start;
                *[
                    &mut broken.mean,
                    &mut broken.short_mean,
                    &mut broken.excess,
                    &mut broken.variance,
                    &mut broken.inconsistency,
                    &mut broken.length,
                    &mut broken.age,
                ][member] = bad;
                if member == 3 && bad.abs() <= MULTISCALE_MEAN_LARGEST_VARIANCE {
                    continue;
                }
                assert_eq!(
                    multiscale_mean_robust_guard(broken),
                    MULTISCALE_MEAN_ROBUST_EMPTY
                );
                assert_eq!(robust(&mut broken, 0.75), 0.75);
            }
            let mut color = MULTISCALE_MEAN_ROBUST_RGB_EMPTY;
            color = multiscale_mean_robust_rgb_step(color, Vec3::ONE, SHORT, LONGEST);
            let sample = Vec3::new(1.0, bad, 1.0);
            let after = multiscale_mean_robust_rgb_step(color, sample, SHORT, LONGEST);
            assert_eq!(after, color);
        }
        // The largest sample that counts, and a return to 1 after it.
        let mut state = start;
        robust(&mut state, MULTISCALE_MEAN_LARGEST);
        for _ in 0..20_000 {
            let value = robust(&mut state, 1.0);
            assert!(value.is_finite() && value >= 0.0);
        }
        assert!((multiscale_mean_robust_value(state) - 1.0).abs() < 0.01);

        let mut theirs = MULTISCALE_MEAN_EMPTY;
        printed(&mut theirs, 1.0);
        printed(&mut theirs, f32::INFINITY);
        for _ in 0..1000 {
            assert!(printed(&mut theirs, 1.0).is_nan());
        }
    }

    #[test]
    fn a_constant_stays_exactly_that() {
        for value in [0.0, 1e-12, 0.1, 3.3, 256.0, 1000.1, 65000.0, 1e15] {
            let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
            let mut color = MULTISCALE_MEAN_ROBUST_RGB_EMPTY;
            let shade = Vec3::new(value, value * 0.7, value * 0.3);
            for _ in 0..1000 {
                assert_eq!(robust(&mut state, value), value);
                color = multiscale_mean_robust_rgb_step(color, shade, SHORT, LONGEST);
                assert_eq!(multiscale_mean_robust_rgb_value(color), shade);
            }
            assert_eq!((state.variance, state.excess), (0.0, 0.0));
            assert_eq!((state.length, state.age), (LONGEST, LONGEST));
        }
        // Zeros for long, and light again: no state is a dead end.
        let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
        for _ in 0..100_000 {
            robust(&mut state, 0.0);
        }
        assert!((0..200).any(|_| robust(&mut state, 2.0) > 1.98));
        // Light off for long: nothing subnormal is left.
        for _ in 0..100_000 {
            robust(&mut state, 0.0);
        }
        assert_eq!(multiscale_mean_robust_value(state), 0.0);
    }

    #[test]
    fn first_frames_are_a_plain_average() {
        let mut next = numbers(11);
        let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
        let mut sum = 0.0;
        for frame in 1..=256 {
            let y = 0.5 + next();
            sum += f64::from(y);
            let value = f64::from(robust(&mut state, y));
            assert!((value - sum / f64::from(frame)).abs() < 0.02 * value);
            assert_eq!(state.age, frame as f32);
        }
    }

    /// Frames until nine tenths of a step are done, as a mean over runs.
    fn frames_to_follow(
        from: f32,
        to: f32,
        noise: f32,
        make: impl Fn() -> Box<dyn FnMut(f32) -> f32>,
    ) -> usize {
        let (runs, warm, frames) = (64, 1000, 600);
        let mut response = vec![0.0; frames];
        for run in 0..runs {
            let mut next = numbers(100 + run);
            let mut answer = make();
            let mut sample = |level: f32| level * (1.0 + noise * (2.0 * next() - 1.0));
            for _ in 0..warm {
                answer(sample(from));
            }
            for sum in &mut response {
                *sum += f64::from(answer(sample(to)));
            }
        }
        let (from, to) = (f64::from(from), f64::from(to));
        response
            .iter()
            .position(|sum| {
                let left = (sum / f64::from(runs) - to) / (from - to);
                left < 0.1
            })
            .unwrap_or(frames)
    }

    #[test]
    fn a_step_is_caught_up_with() {
        let ours = || -> Box<dyn FnMut(f32) -> f32> {
            let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
            Box::new(move |y| robust(&mut state, y))
        };
        let theirs = || -> Box<dyn FnMut(f32) -> f32> {
            let mut state = MULTISCALE_MEAN_EMPTY;
            Box::new(move |y| printed(&mut state, y))
        };
        for (from, to) in [(1.0, 2.0), (0.2, 2.0), (1.0, 0.5), (1.0, 0.1)] {
            for noise in [0.2, 0.5, 0.9] {
                let (a, b) = (
                    frames_to_follow(from, to, noise, ours),
                    frames_to_follow(from, to, noise, theirs),
                );
                // An average over 256 frames takes 589.
                assert!(
                    a <= 100 && a < b,
                    "{from} to {to}, noise {noise}: {a} frames, printed {b}"
                );
            }
        }
    }

    #[test]
    fn a_still_signal_is_as_quiet_as_the_longest_average() {
        let mut next = numbers(21);
        let mut ours = MULTISCALE_MEAN_ROBUST_EMPTY;
        let mut theirs = MULTISCALE_MEAN_EMPTY;
        let (mut quiet, mut loud, mut noise) = (0.0, 0.0, 0.0);
        for frame in 0..400_000 {
            let y = 0.5 + next();
            let (a, b) = (robust(&mut ours, y), printed(&mut theirs, y));
            if frame > 2000 {
                quiet += f64::from(a - 1.0).powi(2);
                loud += f64::from(b - 1.0).powi(2);
                noise += f64::from(y - 1.0).powi(2);
            }
        }
        // Weights of 1/256 leave 1/511.
        assert!(quiet / noise < 1.35 / 511.0, "{}", 511.0 * quiet / noise);
        assert!(quiet < loud);
    }

    #[test]
    fn catching_up_ends() {
        // As if the mean had followed every sample for long, which makes it as
        // noisy as they are.
        for short_blend in [0.01, 0.02, 0.04, 0.08, 0.16, 0.32] {
            for noise in [0.01, 0.1, 0.3, 0.5, 1.0] {
                let mut next = numbers(71);
                let mut state = MULTISCALE_MEAN_ROBUST_EMPTY;
                let mut sample = || 1.0 + noise * (2.0 * next() - 1.0);
                for _ in 0..2000 {
                    state = multiscale_mean_robust_step(state, sample(), short_blend, LONGEST);
                }
                (state.mean, state.inconsistency, state.length) = (sample(), 20.0, 1.0);
                let frames = (0..2000).find(|_| {
                    state = multiscale_mean_robust_step(state, sample(), short_blend, LONGEST);
                    state.length > 64.0
                });
                assert!(
                    frames.is_some_and(|f| f < 600),
                    "short blend {short_blend}, noise {noise}: {frames:?}"
                );
            }
        }
    }

    #[test]
    fn a_million_steps_do_not_drift() {
        let mut next = numbers(31);
        let (mut state, mut wide) = (MULTISCALE_MEAN_ROBUST_EMPTY, [0.0; 7]);
        // Just after a fall an error is that of what was there before it. While
        // the mean catches up with a noisy signal a rounding error may grow a
        // thousandfold, and is gone a few frames later: so root mean squares,
        // which must not grow.
        let (mut peak, mut worst, mut sums): (f64, f64, [f64; 2]) = (0.0, 0.0, [0.0; 2]);
        for frame in 0..1_000_000u32 {
            let y = scene(&mut next, frame);
            let (got, want) = (robust(&mut state, y), robust_f64(&mut wide, y.into()));
            peak = want.max(0.98 * peak);
            let error = (f64::from(got) - want) / peak;
            worst = worst.max(error.abs());
            sums[(frame / 500_000) as usize] += error * error;
        }
        let [first, second] = sums.map(|s| (s / 5e5).sqrt());
        assert!(
            first < 1e-5 && second < 1e-5 && worst < 5e-3,
            "{first} {second} {worst}"
        );
        for _ in 0..6000 {
            robust(&mut state, 0.75);
            robust_f64(&mut wide, 0.75);
        }
        let left = f64::from(multiscale_mean_robust_value(state)) - (wide[0] + wide[2]);
        // Where a step of 1/256 rounds to none.
        assert!(left.abs() < 0.75 * 2f64.powi(-16), "{left}");
    }

    #[test]
    fn gray_is_the_scalar() {
        let mut next = numbers(41);
        let mut scalar = MULTISCALE_MEAN_ROBUST_EMPTY;
        let mut color = MULTISCALE_MEAN_ROBUST_RGB_EMPTY;
        for frame in 0..5000 {
            let y = scene(&mut next, frame);
            let value = robust(&mut scalar, y);
            color = multiscale_mean_robust_rgb_step(color, Vec3::splat(y), SHORT, LONGEST);
            let shade = multiscale_mean_robust_rgb_value(color);
            assert!((shade - Vec3::splat(value)).abs().max_element() <= 2e-5 * value);
        }
    }

    #[test]
    fn a_packed_state_gives_nearly_the_same_answers() {
        let mut next = numbers(51);
        let mut whole = MULTISCALE_MEAN_ROBUST_EMPTY;
        let mut packed = multiscale_mean_robust_pack(whole);
        let mut color = multiscale_mean_robust_rgb_pack(MULTISCALE_MEAN_ROBUST_RGB_EMPTY);
        let (mut worst, mut peak, mut square, mut sums) = (0.0f32, 0.0f32, 0.0, [0.0; 3]);
        for frame in 0..100_000 {
            let y = scene(&mut next, frame);
            let value = robust(&mut whole, y);
            let mut state = multiscale_mean_robust_unpack(packed);
            let stored = robust(&mut state, y);
            packed = multiscale_mean_robust_pack(state);
            let shade = multiscale_mean_robust_rgb_step(
                multiscale_mean_robust_rgb_unpack(color),
                Vec3::splat(y),
                SHORT,
                LONGEST,
            );
            color = multiscale_mean_robust_rgb_pack(shade);
            sums[0] += f64::from(value);
            sums[1] += f64::from(stored);
            sums[2] += f64::from(multiscale_mean_robust_rgb_value(shade).y);
            peak = value.max(0.98 * peak);
            worst = worst.max((stored - value).abs() / peak);
            square += f64::from((stored - value) / peak).powi(2);
        }
        let ratios = [sums[1] / sums[0], sums[2] / sums[0]];
        let error = (square / 1e5).sqrt();
        // Where a firefly meets a mean that catches up, the two forms may
        // take steps of different sizes, for a frame or two.
        assert!(worst < 2.0 && error < 0.02, "{worst} {error}");
        assert!(ratios.iter().all(|r| (r - 1.0).abs() < 0.001), "{ratios:?}");
        // A state that is no number is none.
        for bad in BAD {
            let state = MultiscaleMeanRobustState { mean: bad, ..whole };
            let words = multiscale_mean_robust_pack(state);
            assert_eq!(
                multiscale_mean_robust_unpack(words),
                MULTISCALE_MEAN_ROBUST_EMPTY
            );
        }
    }

    #[test]
    fn upper_halves_round_to_nearest() {
        for (x, expected) in [
            (0.0, 0.0),
            (-0.0, 0.0),
            (1.0, 1.0),
            (256.0, 256.0),
            (255.0, 255.0),
            (1.00390625, 1.0),
            (1.01171875, 1.015625),
            (-3.3, -3.296875),
            (1e-32, 0.0),
            (1e30, 1.000_255_55e30),
        ] {
            assert_eq!(low(multiscale_mean_upper_half(x)), expected, "{x}");
        }
        let mut next = numbers(61);
        for _ in 0..100_000 {
            let x = (next() - 0.5) * 10f32.powf(40.0 * next() - 20.0);
            let error = f64::from(low(multiscale_mean_upper_half(x))) - f64::from(x);
            assert!(error.abs() <= 2f64.powi(-8) * f64::from(x.abs()));
        }
    }
}
