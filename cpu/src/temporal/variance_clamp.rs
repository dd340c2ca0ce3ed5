//! History held to what the pixel's neighbourhood shows now: a box around the
//! neighbours' mean, as wide as their deviation and never wider than they are.
//!
//! Source: Karis, *High-Quality Temporal Supersampling* (SIGGRAPH 2014), for
//! the neighbourhood's box, YCoCg and clipping instead of clamping; Salvi, *An
//! Excursion in Temporal Supersampling* (GDC 2016), for mean ± γσ; West,
//! *Updating Mean and Variance Estimates* (1979), for the moments. That the
//! clip goes towards the mean, and how thin a box may be for it, are ours.

use glam::{UVec2, Vec3};

/// Radius of the usual 5 × 5 neighbourhood.
pub const VARIANCE_CLAMP_RADIUS: u32 = 2;

/// Largest radius; larger ones count as this.
pub const VARIANCE_CLAMP_RADIUS_MAX: u32 = 8;

/// Largest magnitude of a channel; what is larger counts as a defect, as NaN
/// and infinity do.
pub const VARIANCE_CLAMP_LARGEST: f32 = 1e15;

/// Mode: each channel of RGB clamped for itself.
pub const VARIANCE_CLAMP_RGB: u32 = 0;

/// Bit of the mode: the box is in YCoCg.
pub const VARIANCE_CLAMP_YCOCG: u32 = 1;

/// Bit of the mode: clip towards the mean instead of clamping.
pub const VARIANCE_CLAMP_CLIP: u32 = 2;

/// Thinnest side that a box has when it clips, over its widest.
pub const VARIANCE_CLAMP_THINNEST: f32 = 0.015625;

/// What has been seen of a neighbourhood; starts as [`VARIANCE_CLAMP_EMPTY`].
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::{
///     VARIANCE_CLAMP_EMPTY, VARIANCE_CLAMP_RGB, variance_clamp_add,
/// };
///
/// let one =
///     variance_clamp_add(VARIANCE_CLAMP_EMPTY, Vec3::ONE, VARIANCE_CLAMP_RGB);
/// assert_eq!((one.mean, one.spread, one.count), (Vec3::ONE, Vec3::ZERO, 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct VarianceClampMoments {
    /// Mean colour.
    pub mean: Vec3,
    /// Sum of squared distances from the mean along each axis of the box.
    pub spread: Vec3,
    /// Smallest coordinate along each axis.
    pub low: Vec3,
    /// Largest coordinate along each axis.
    pub high: Vec3,
    /// Number of colours.
    pub count: f32,
}

/// Nothing seen.
pub const VARIANCE_CLAMP_EMPTY: VarianceClampMoments = VarianceClampMoments {
    mean: Vec3::ZERO,
    spread: Vec3::ZERO,
    low: Vec3::ZERO,
    high: Vec3::ZERO,
    count: 0.0,
};

/// A box about a mean: how far it reaches along each axis.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::{
///     VARIANCE_CLAMP_RGB, VarianceClampBox, variance_clamp_limit,
/// };
///
/// // Half a unit to either side, in each channel.
/// let bounds =
///     VarianceClampBox { low: Vec3::splat(-0.5), high: Vec3::splat(0.5) };
/// let held = variance_clamp_limit(
///     Vec3::splat(9.0),
///     Vec3::ONE,
///     bounds,
///     VARIANCE_CLAMP_RGB,
/// );
/// assert_eq!(held, Vec3::splat(1.5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct VarianceClampBox {
    /// Downwards, `<= 0`.
    pub low: Vec3,
    /// Upwards, `>= 0`.
    pub high: Vec3,
}

/// 1 if every channel is a number of magnitude at most
/// [`VARIANCE_CLAMP_LARGEST`], else 0. Compares bit patterns. Exact.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::variance_clamp_usable;
///
/// assert_eq!(variance_clamp_usable(Vec3::ONE), 1);
/// assert_eq!(variance_clamp_usable(Vec3::new(0.0, f32::INFINITY, 0.0)), 0);
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_usable(color: Vec3) -> u32 {
    let largest = VARIANCE_CLAMP_LARGEST.to_bits();
    u32::from((color.x.to_bits() & 0x7fff_ffff) <= largest)
        & u32::from((color.y.to_bits() & 0x7fff_ffff) <= largest)
        & u32::from((color.z.to_bits() & 0x7fff_ffff) <= largest)
}

/// Luma, orange-blue and green-purple of a colour, or of a difference of two.
///
/// Source: Malvar and Sullivan, *YCoCg-R* (2003), the form that is not
/// rounded to integers.
///
/// Error analysis: halves are exact, two sums a channel; the sums may cancel,
/// so the error is that of the largest channel.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::variance_clamp_ycocg;
///
/// assert_eq!(variance_clamp_ycocg(Vec3::splat(0.5)), Vec3::new(0.5, 0.0, 0.0));
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_ycocg(rgb: Vec3) -> Vec3 {
    let side = 0.5 * (rgb.x + rgb.z);
    Vec3::new(
        0.5 * (rgb.y + side),
        0.5 * (rgb.x - rgb.z),
        0.5 * (rgb.y - side),
    )
}

/// The colour, or difference of two, from luma, orange-blue and green-purple:
/// undoes [`variance_clamp_ycocg`], to rounding.
///
/// Error analysis: two sums a channel, which may cancel.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::{
///     variance_clamp_rgb, variance_clamp_ycocg,
/// };
///
/// let rgb = Vec3::new(0.8, 0.5, 0.1);
/// assert!(
///     (variance_clamp_rgb(variance_clamp_ycocg(rgb)) - rgb).length() < 1e-6
/// );
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_rgb(ycocg: Vec3) -> Vec3 {
    let side = ycocg.x - ycocg.z;
    Vec3::new(side + ycocg.y, ycocg.x + ycocg.z, side - ycocg.y)
}

/// A colour or a difference along the axes of the box.
#[inline(always)]
fn variance_clamp_axes(rgb: Vec3, mode: u32) -> Vec3 {
    if (mode & VARIANCE_CLAMP_YCOCG) == 0 {
        return rgb;
    }
    variance_clamp_ycocg(rgb)
}

/// The mean of `count` numbers, of the last one and the mean before it; never
/// outside them.
#[inline(always)]
fn variance_clamp_mean(mean: f32, sample: f32, count: f32) -> f32 {
    let moved = mean + (sample - mean) / count;
    moved.max(mean.min(sample)).min(mean.max(sample))
}

/// The moments with a colour added, the box's axes as `mode` says.
///
/// A colour with a channel that is no number, or too large, is left out.
///
/// Error analysis: the mean moves by a part of its distance from the colour, a
/// few ULP of the larger; the spread is a sum of squares, so it does not
/// cancel and a constant has none.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::{
///     VARIANCE_CLAMP_EMPTY, VARIANCE_CLAMP_RGB, variance_clamp_add,
/// };
///
/// let mut moments = VARIANCE_CLAMP_EMPTY;
/// for value in [1.0, f32::NAN, 3.0] {
///     moments =
///         variance_clamp_add(moments, Vec3::splat(value), VARIANCE_CLAMP_RGB);
/// }
/// assert_eq!(
///     (moments.mean.x, moments.spread.x, moments.count),
///     (2.0, 2.0, 2.0)
/// );
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_add(
    moments: VarianceClampMoments,
    color: Vec3,
    mode: u32,
) -> VarianceClampMoments {
    if variance_clamp_usable(color) == 0 {
        return moments;
    }
    let place = variance_clamp_axes(color, mode);
    if moments.count <= 0.0 {
        return VarianceClampMoments {
            mean: color,
            spread: Vec3::ZERO,
            low: place,
            high: place,
            count: 1.0,
        };
    }
    let count = moments.count + 1.0;
    let part = moments.count / count;
    let mean = moments.mean;
    let away = Vec3::new(color.x - mean.x, color.y - mean.y, color.z - mean.z);
    let along = variance_clamp_axes(away, mode);
    VarianceClampMoments {
        mean: Vec3::new(
            variance_clamp_mean(mean.x, color.x, count),
            variance_clamp_mean(mean.y, color.y, count),
            variance_clamp_mean(mean.z, color.z, count),
        ),
        spread: Vec3::new(
            moments.spread.x + part * (along.x * along.x),
            moments.spread.y + part * (along.y * along.y),
            moments.spread.z + part * (along.z * along.z),
        ),
        low: moments.low.min(place),
        high: moments.high.max(place),
        count,
    }
}

/// The box of a neighbourhood: `gamma` deviations about the mean along each
/// axis, and no farther than the smallest and the largest coordinate.
///
/// `gamma >= 0`, 0.75 to 1.5 in use; a large one leaves the plain box of
/// minimum and maximum. `mode` as the moments had it. Without any colour the
/// box is empty.
///
/// Error analysis: a quotient, a root and a product of numbers `>= 0`; the
/// distances of minimum and maximum from the mean have its absolute error.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::{
///     VARIANCE_CLAMP_EMPTY, VARIANCE_CLAMP_RGB, variance_clamp_add,
///     variance_clamp_box,
/// };
///
/// let mut moments = VARIANCE_CLAMP_EMPTY;
/// for value in [1.0, 3.0] {
///     moments =
///         variance_clamp_add(moments, Vec3::splat(value), VARIANCE_CLAMP_RGB);
/// }
/// // Half a deviation; and never beyond the smallest and the largest.
/// assert_eq!(variance_clamp_box(moments, 0.5, VARIANCE_CLAMP_RGB).high.x, 0.5);
/// assert_eq!(variance_clamp_box(moments, 9.0, VARIANCE_CLAMP_RGB).high.x, 1.0);
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_box(
    moments: VarianceClampMoments,
    gamma: f32,
    mode: u32,
) -> VarianceClampBox {
    let count = moments.count.max(1.0);
    let middle = variance_clamp_axes(moments.mean, mode);
    let x = gamma * (moments.spread.x / count).sqrt();
    let y = gamma * (moments.spread.y / count).sqrt();
    let z = gamma * (moments.spread.z / count).sqrt();
    VarianceClampBox {
        low: Vec3::new(
            (-x).max((moments.low.x - middle.x).min(0.0)),
            (-y).max((moments.low.y - middle.y).min(0.0)),
            (-z).max((moments.low.z - middle.z).min(0.0)),
        ),
        high: Vec3::new(
            x.min((moments.high.x - middle.x).max(0.0)),
            y.min((moments.high.y - middle.y).max(0.0)),
            z.min((moments.high.z - middle.z).max(0.0)),
        ),
    }
}

/// How much of an offset along one axis is inside: 1, or the part at which it
/// leaves. A box thinner than `least` counts as that thick.
#[inline(always)]
fn variance_clamp_share(offset: f32, low: f32, high: f32, least: f32) -> f32 {
    let reach = (if offset > 0.0 { high } else { -low }).max(least);
    let length = offset.abs();
    if length <= reach {
        return 1.0;
    }
    reach / length
}

/// `value`, but not outside `a` and `b`.
#[inline(always)]
fn variance_clamp_between(value: f32, a: f32, b: f32) -> f32 {
    value.max(a.min(b)).min(a.max(b))
}

/// The history held to a box about `mean`.
///
/// Inside, exactly the history. Outside, clamped along each axis, or (mode
/// [`VARIANCE_CLAMP_CLIP`]) moved straight towards the mean until it is
/// inside; sides thinner than [`VARIANCE_CLAMP_THINNEST`] of the widest count
/// as that wide then, so that a grey neighbourhood does not throw away the
/// history of a hardly coloured pixel. No channel of the result is outside
/// history and mean. A box without extent gives exactly the mean, as does a
/// history that is no number.
///
/// Error analysis: clamping, a few ULP of the larger of history and mean. The
/// clip divides by an offset with that error, and the side that it compares
/// with is no thinner than 1/64 of the widest: at most 64 times as much.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::variance_clamp::{
///     VARIANCE_CLAMP_RGB, VarianceClampBox, variance_clamp_limit,
/// };
///
/// let bounds =
///     VarianceClampBox { low: Vec3::splat(-0.5), high: Vec3::splat(0.5) };
/// let history = Vec3::new(9.0, 1.0, 1.0);
/// // Clamped, only the channel that is outside moves.
/// let clamped =
///     variance_clamp_limit(history, Vec3::ONE, bounds, VARIANCE_CLAMP_RGB);
/// assert_eq!(clamped, Vec3::new(1.5, 1.0, 1.0));
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_limit(
    history: Vec3,
    mean: Vec3,
    bounds: VarianceClampBox,
    mode: u32,
) -> Vec3 {
    if variance_clamp_usable(history) == 0 {
        return mean;
    }
    let away = Vec3::new(history.x - mean.x, history.y - mean.y, history.z - mean.z);
    let offset = variance_clamp_axes(away, mode);
    let (low, high) = (bounds.low, bounds.high);
    let moved = if (mode & VARIANCE_CLAMP_CLIP) == 0 {
        let held = Vec3::new(
            offset.x.max(low.x).min(high.x),
            offset.y.max(low.y).min(high.y),
            offset.z.max(low.z).min(high.z),
        );
        if held.x == offset.x && held.y == offset.y && held.z == offset.z {
            return history;
        }
        if (mode & VARIANCE_CLAMP_YCOCG) == 0 {
            held
        } else {
            variance_clamp_rgb(held)
        }
    } else {
        let widest = (high.x - low.x).max(high.y - low.y).max(high.z - low.z);
        let least = VARIANCE_CLAMP_THINNEST * widest;
        let share = variance_clamp_share(offset.x, low.x, high.x, least)
            .min(variance_clamp_share(offset.y, low.y, high.y, least))
            .min(variance_clamp_share(offset.z, low.z, high.z, least));
        if share >= 1.0 {
            return history;
        }
        Vec3::new(share * away.x, share * away.y, share * away.z)
    };
    Vec3::new(
        variance_clamp_between(mean.x + moved.x, history.x, mean.x),
        variance_clamp_between(mean.y + moved.y, history.y, mean.y),
        variance_clamp_between(mean.z + moved.z, history.z, mean.z),
    )
}

/// A pixel's history held to its neighbourhood in the current frame.
///
/// `size` is the image's (each side below 2^30, `pixel` inside it), `radius`
/// [`VARIANCE_CLAMP_RADIUS`] for 5 × 5; taps outside the image are left out,
/// those that are no numbers too. `gamma` as in [`variance_clamp_box`]; `mode`
/// is [`VARIANCE_CLAMP_RGB`] or a sum of [`VARIANCE_CLAMP_YCOCG`] and
/// [`VARIANCE_CLAMP_CLIP`]. `read(at)` gives the current frame's colour and is
/// only called inside `size`. On a constant neighbourhood the result is exactly
/// its colour; without any usable tap the history, or black if it is no number.
///
/// In WGSL `read` is a function that the program defines.
///
/// Error analysis: the moments' errors add over the taps, and all the rest is
/// that of [`variance_clamp_limit`]: absolute, in the largest colour.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::temporal::variance_clamp::{
///     VARIANCE_CLAMP_RADIUS, VARIANCE_CLAMP_RGB, variance_clamp_pixel,
/// };
///
/// // Neighbours between 0.4 and 0.6; a history far off is held to them.
/// let read = |at: UVec2| Vec3::splat(0.4 + 0.1 * (at.x % 3) as f32);
/// let held = variance_clamp_pixel(
///     UVec2::splat(4),
///     UVec2::splat(9),
///     VARIANCE_CLAMP_RADIUS,
///     Vec3::splat(5.0),
///     1.0,
///     VARIANCE_CLAMP_RGB,
///     read,
/// );
/// assert!(held.x > 0.5 && held.x <= 0.6);
/// ```
#[inline]
#[must_use]
pub fn variance_clamp_pixel<R>(
    pixel: UVec2,
    size: UVec2,
    radius: u32,
    history: Vec3,
    gamma: f32,
    mode: u32,
    read: R,
) -> Vec3
where
    R: Fn(UVec2) -> Vec3,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return Vec3::ZERO;
    }
    let r = radius.min(VARIANCE_CLAMP_RADIUS_MAX) as i32;
    let mut moments = VARIANCE_CLAMP_EMPTY;
    let mut dy = -r;
    while dy <= r {
        let y = pixel.y as i32 + dy;
        dy += 1;
        if y < 0 || y >= size.y as i32 {
            continue;
        }
        let mut dx = -r;
        while dx <= r {
            let x = pixel.x as i32 + dx;
            dx += 1;
            if x < 0 || x >= size.x as i32 {
                continue;
            }
            moments = variance_clamp_add(moments, read(UVec2::new(x as u32, y as u32)), mode);
        }
    }
    if moments.count <= 0.0 {
        if variance_clamp_usable(history) == 0 {
            return Vec3::ZERO;
        }
        return history;
    }
    let bounds = variance_clamp_box(moments, gamma, mode);
    variance_clamp_limit(history, moments.mean, bounds, mode)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    const SIZE: UVec2 = UVec2::new(24, 17);
    const MODES: [u32; 4] = [0, 1, 2, 3];

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    fn color(at: UVec2) -> Vec3 {
        Vec3::new(noise(at, 0), noise(at, 1), noise(at, 2))
    }

    fn history(at: UVec2) -> Vec3 {
        1.5 * Vec3::new(noise(at, 3), noise(at, 4), noise(at, 5))
    }

    fn everywhere(mut check: impl FnMut(UVec2)) {
        for i in 0..SIZE.x * SIZE.y {
            check(UVec2::new(i % SIZE.x, i / SIZE.x));
        }
    }

    fn axes(c: Vec3, mode: u32) -> Vec3 {
        variance_clamp_axes(c, mode)
    }

    /// The moments of a pixel's 5 × 5 neighbourhood.
    fn moments(pixel: UVec2, mode: u32, read: impl Fn(UVec2) -> Vec3) -> VarianceClampMoments {
        let mut m = VARIANCE_CLAMP_EMPTY;
        everywhere(|at| {
            if at.x.abs_diff(pixel.x) <= 2 && at.y.abs_diff(pixel.y) <= 2 {
                m = variance_clamp_add(m, read(at), mode);
            }
        });
        m
    }

    #[test]
    fn a_constant_image_comes_out_exactly() {
        for value in [0.0, 1e-30, 0.1, 3.3, 1000.1, 65000.0, 1e14] {
            let constant = Vec3::new(value, value * 0.7, value * 0.3);
            for mode in MODES {
                for radius in [0, 1, 2, 8] {
                    everywhere(|at| {
                        for old in [constant, 3.0 * value * history(at), history(at), Vec3::ZERO] {
                            let got = variance_clamp_pixel(
                                at,
                                SIZE,
                                radius,
                                old,
                                noise(at, 6) * 3.0,
                                mode,
                                |_| constant,
                            );
                            assert_eq!(got, constant, "mode {mode} at {at}");
                        }
                    });
                }
            }
        }
    }

    #[test]
    fn plain_moments_find_noise_in_a_constant() {
        // Trap: sqrt |E[x²] - E[x]²| over 25 equal numbers.
        for (value, deviation) in [(0.1f32, 1e-5), (3.3, 1e-4), (1000.1, 0.1), (65000.0, 4.0)] {
            let (mut sum, mut squares) = (0f32, 0f32);
            for _ in 0..25 {
                sum += value;
                squares += value * value;
            }
            let mean = sum / 25.0;
            let found = (squares / 25.0 - mean * mean).abs().sqrt();
            println!("constant {value}: a deviation of {found}");
            assert!(found > deviation);
            let m = moments(UVec2::new(9, 9), 0, |_| Vec3::splat(value));
            assert_eq!(m.spread, Vec3::ZERO);
            assert_eq!(m.mean, Vec3::splat(value));
        }
    }

    #[test]
    fn the_moments_are_those_of_two_passes() {
        for mode in [0, 1] {
            for (offset, tolerance) in [(0.0, 2e-6), (1000.0, 1e-3), (1e4, 1e-2)] {
                everywhere(|at| {
                    let read = |at| color(at) + offset;
                    let m = moments(at, mode, read);
                    let mut seen = Vec::new();
                    everywhere(|q| {
                        if q.x.abs_diff(at.x) <= 2 && q.y.abs_diff(at.y) <= 2 {
                            seen.push(axes(read(q) - offset, mode).as_dvec3());
                        }
                    });
                    let n = seen.len() as f64;
                    let mean = seen.iter().sum::<glam::DVec3>() / n;
                    let spread: glam::DVec3 = seen.iter().map(|c| (c - mean) * (c - mean)).sum();
                    assert_eq!(m.count, n as f32);
                    let apart = (m.spread.as_dvec3() - spread).abs() / spread;
                    assert!(apart.max_element() < tolerance, "{offset}: {apart}");
                });
            }
        }
    }

    #[test]
    fn inside_the_box_the_history_is_untouched() {
        let mut kept = [0; 4];
        for mode in MODES {
            everywhere(|at| {
                let m = moments(at, mode, color);
                let bounds = variance_clamp_box(m, 1.0, mode);
                // Halfway to a corner.
                let corner = bounds.high.with_y(bounds.low.y) * (0.4 * noise(at, 7));
                let away = if mode & VARIANCE_CLAMP_YCOCG == 0 {
                    corner
                } else {
                    variance_clamp_rgb(corner)
                };
                let old = m.mean + away;
                let got = variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, color);
                kept[mode as usize] += u32::from(got == old);
            });
        }
        assert_eq!(kept, [SIZE.x * SIZE.y; 4]);
    }

    #[test]
    fn outside_it_the_result_is_on_the_box_and_between_history_and_mean() {
        for mode in MODES {
            everywhere(|at| {
                let gamma = 0.5 + noise(at, 8);
                let m = moments(at, mode, color);
                let bounds = variance_clamp_box(m, gamma, mode);
                assert!(bounds.low.cmple(Vec3::ZERO).all() && bounds.high.cmpge(Vec3::ZERO).all());
                let old = history(at);
                let got = variance_clamp_pixel(at, SIZE, 2, old, gamma, mode, color);
                assert!(got.cmpge(old.min(m.mean)).all() && got.cmple(old.max(m.mean)).all());
                let offset = axes(got - m.mean, mode);
                if mode & VARIANCE_CLAMP_CLIP != 0 {
                    let widest = (bounds.high - bounds.low).max_element();
                    let slack = 1e-5 + widest * VARIANCE_CLAMP_THINNEST;
                    assert!(offset.cmpge(bounds.low - slack).all());
                    assert!(offset.cmple(bounds.high + slack).all());
                    // On the segment from the mean.
                    let off = (got - m.mean).cross(old - m.mean).length();
                    assert!(off < 1e-5);
                } else if mode == VARIANCE_CLAMP_RGB {
                    assert!(offset.cmpge(bounds.low - 1e-6).all());
                    assert!(offset.cmple(bounds.high + 1e-6).all());
                }
            });
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_the_same() {
        let turned = UVec2::new(SIZE.y, SIZE.x);
        for mode in MODES {
            everywhere(|at| {
                let old = history(at);
                let plain = variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, color);
                let mirror = |p: UVec2| UVec2::new(SIZE.x - 1 - p.x, p.y);
                let flip = |p: UVec2| UVec2::new(p.x, SIZE.y - 1 - p.y);
                let swap = |p: UVec2| UVec2::new(p.y, p.x);
                for other in [
                    variance_clamp_pixel(mirror(at), SIZE, 2, old, 1.0, mode, |p| color(mirror(p))),
                    variance_clamp_pixel(flip(at), SIZE, 2, old, 1.0, mode, |p| color(flip(p))),
                    variance_clamp_pixel(swap(at), turned, 2, old, 1.0, mode, |p| color(swap(p))),
                ] {
                    assert!((plain - other).abs().max_element() < 2e-5);
                }
            });
        }
    }

    #[test]
    fn taps_outside_the_image_do_not_count() {
        // Trap: reading zero outside and still dividing by 25 darkens borders.
        let m = moments(UVec2::ZERO, 0, |_| Vec3::splat(0.5));
        assert_eq!((m.count, m.mean), (9.0, Vec3::splat(0.5)));
        let dark = 9.0 * 0.5 / 25.0;
        assert!(dark < 0.2);
        let seen = std::cell::RefCell::new(Vec::new());
        everywhere(|at| {
            let _ = variance_clamp_pixel(at, SIZE, 2, Vec3::ONE, 1.0, 0, |p| {
                assert!(p.x < SIZE.x && p.y < SIZE.y);
                seen.borrow_mut().push(p);
                color(p)
            });
        });
        // 5 taps a row but for 2 + 1 missing at either end.
        let taps = (5 * SIZE.x - 6) * (5 * SIZE.y - 6);
        assert_eq!(seen.borrow().len() as u32, taps);
        assert_eq!(
            variance_clamp_pixel(SIZE, SIZE, 2, Vec3::ONE, 1.0, 0, color),
            Vec3::ZERO
        );
    }

    #[test]
    fn exposure_changes_nothing_but_the_scale() {
        for mode in MODES {
            for power in -10..=10 {
                let k = (power as f32).exp2();
                everywhere(|at| {
                    let run = |k: f32| {
                        let old = history(at) * k;
                        variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, |p| color(p) * k)
                    };
                    assert_eq!(run(k), run(1.0) * k);
                });
            }
        }
        // Trap: a box widened by an absolute 0.001 keeps any history in the
        // dark.
        let dim = |p| color(p) * 1e-5;
        let old = Vec3::splat(8e-4);
        let m = moments(UVec2::new(8, 8), 0, dim);
        let bounds = variance_clamp_box(m, 1.0, 0);
        assert!((old - m.mean).cmple(bounds.high + 0.001).all());
        let got = variance_clamp_pixel(UVec2::new(8, 8), SIZE, 2, old, 1.0, 3, dim);
        assert!(got.max_element() < 1e-5);
    }

    #[test]
    fn what_is_no_number_gets_no_further() {
        let spot = UVec2::new(11, 8);
        for bad in [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MAX,
            -1e30,
            1e30,
        ] {
            let broken = |p: UVec2| {
                if p == spot {
                    Vec3::new(0.5, bad, 0.5)
                } else {
                    color(p)
                }
            };
            for mode in MODES {
                everywhere(|at| {
                    let old = history(at);
                    let clean = variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, color);
                    let got = variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, broken);
                    assert!(got.cmpge(Vec3::ZERO).all() && got.cmple(Vec3::splat(1.5)).all());
                    // It reaches two pixels, and only as a tap that is missing.
                    let far = at.x.abs_diff(spot.x) > 2 || at.y.abs_diff(spot.y) > 2;
                    if far {
                        assert_eq!(got, clean);
                    } else {
                        assert_eq!(
                            moments(at, mode, broken).count,
                            moments(at, mode, color).count - 1.0
                        );
                    }
                    // A bad history: the mean of what is there now.
                    let old = Vec3::new(0.5, 0.5, bad);
                    let got = variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, color);
                    assert_eq!(got, moments(at, mode, color).mean);
                    // Nothing usable at all.
                    let got = variance_clamp_pixel(at, SIZE, 2, old, 1.0, mode, |_| old);
                    assert_eq!(got, Vec3::ZERO);
                    let got = variance_clamp_pixel(at, SIZE, 2, color(at), 1.0, mode, |_| old);
                    assert_eq!(got, color(at));
                });
            }
        }
    }

    #[test]
    fn a_grey_neighbourhood_keeps_the_luma_of_a_hardly_coloured_history() {
        let grey = |p| Vec3::splat(noise(p, 0));
        let at = UVec2::new(9, 9);
        let m = moments(at, 3, grey);
        let bounds = variance_clamp_box(m, 1.0, 3);
        assert_eq!((bounds.high.y, bounds.high.z), (0.0, 0.0));
        let old = m.mean + Vec3::new(0.1, 0.1, 0.1 + 1e-6);
        assert!(0.1 < bounds.high.x);
        // Trap: the plain clip divides an extent of zero by the trace of colour
        // and gives up the luma, which is inside.
        let offset = variance_clamp_ycocg(old - m.mean);
        let plain = bounds.high.y / offset.y.abs();
        assert_eq!(m.mean + (old - m.mean) * plain, m.mean);
        let got = variance_clamp_pixel(at, SIZE, 2, old, 1.0, 3, grey);
        assert_eq!(got, old);
        // Real colour goes.
        let old = m.mean + Vec3::new(0.4, -0.2, -0.2);
        let got = variance_clamp_pixel(at, SIZE, 2, old, 1.0, 3, grey);
        assert!((got - m.mean).abs().max_element() < 0.02);
    }

    #[test]
    fn sparse_light_gives_no_box_below_black() {
        // One bright pixel: mean - σ is far below zero, the box is not.
        let at = UVec2::new(9, 9);
        let read = |p| {
            if p == at {
                Vec3::splat(100.0)
            } else {
                Vec3::ZERO
            }
        };
        let m = moments(at, 0, read);
        let sigma = (m.spread / m.count).map(f32::sqrt);
        assert!(m.mean.x - sigma.x < -10.0);
        for mode in MODES {
            let got = variance_clamp_pixel(at, SIZE, 2, Vec3::splat(-50.0), 1.0, mode, read);
            assert!(got.abs().max_element() < 1e-5, "{got}");
            let got = variance_clamp_pixel(at, SIZE, 2, Vec3::splat(1e3), 1.0, mode, read);
            assert!((got.x - m.mean.x - sigma.x).abs() < 1e-3, "{got}");
        }
    }

    #[test]
    fn a_ghost_is_gone_at_once_and_still_noise_falls() {
        // An exponential average of grey noise, newest weight 0.05: frames
        // until a light that goes from 1 to 0.1 is halfway gone, and the
        // deviation that is left later on.
        let run = |clamped: bool, gamma: f32, light: &dyn Fn(u32) -> f32| {
            let at = UVec2::new(9, 9);
            let mut mean = Vec3::splat(light(0));
            let mut squares = 0f64;
            let mut half = 0;
            for frame in 1..400 {
                let level = light(frame);
                let read = |p: UVec2| {
                    let n = noise(p, 100 + frame) + noise(p, 1000 + frame);
                    Vec3::splat(level * n)
                };
                if clamped {
                    mean = variance_clamp_pixel(at, SIZE, 2, mean, gamma, 3, read);
                }
                mean += 0.05 * (read(at) - mean);
                if half == 0 && mean.x < 0.55 {
                    half = frame;
                }
                if frame >= 100 {
                    squares += f64::from(mean.x / level - 1.0).powi(2);
                }
            }
            (half, (squares / 300.0).sqrt())
        };
        let step = |frame| if frame == 0 { 1.0 } else { 0.1 };
        let (without, _) = run(false, 1.0, &step);
        let (with, left) = run(true, 1.0, &step);
        let (_, plain) = run(false, 1.0, &|_| 0.1);
        println!("half-life {without} frames, clamped {with}; noise {plain:.4}, clamped {left:.4}");
        assert!(without >= 12 && with == 1);
        assert!(left < 1.2 * plain && plain < 0.1);
    }
}
