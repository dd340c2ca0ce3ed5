//! A bilateral filter as strong as the variance asks: where a pixel is known
//! well its kernel shrinks, in radius and in taps, down to nothing.
//!
//! Source: Deligiannis, Schmid and Uludag, *Hybrid Rendering for Real-Time Ray
//! Tracing* (Ray Tracing Gems, chapter 25) for a bilateral kernel driven by the
//! variance of `filter/spatial_reconstruct`; Tomasi and Manduchi, *Bilateral
//! Filtering for Gray and Color Images* (1998) for the filter; Schied et al.,
//! *Spatiotemporal Variance-Guided Filtering* (2017) for the edges. The
//! formulas for radius and taps are ours.

use glam::{UVec2, Vec2, Vec3};

use crate::math::exponent::exp2_poly;
use crate::math::sanitize::usable_surface;
use crate::math::trig::sincos_turn;
use crate::math::vector::vec3_dot;

/// Variance over squared value from which the kernel has its full radius: a
/// relative standard deviation of one half.
pub const BILATERAL_VARIANCE_FULL: f32 = 0.25;

/// Weight of the squared distance between unit normals: as `(n·n')^128`.
pub const BILATERAL_VARIANCE_NORMAL: f32 = 64.0;

/// Variances that a squared colour difference may have for a weight of 1/e.
pub const BILATERAL_VARIANCE_COLOR: f32 = 16.0;

/// Golden ratio less one, in units of 2^-32.
const GOLDEN: u32 = 2_654_435_769;

/// log2 e.
const LOG2_E: f32 = 1.442695;

/// Bits of 2^60, from where on a channel is none.
const BILATERAL_VARIANCE_COLOR_BITS: u32 = 0x5d80_0000;

/// Bits of 2^120, from where on a variance is none.
const BILATERAL_VARIANCE_BITS: u32 = 0x7b80_0000;

/// What the filter knows of a pixel.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::bilateral_variance::{
///     BilateralVariancePixel, bilateral_variance_pixel,
/// };
///
/// let known = BilateralVariancePixel {
///     color: Vec3::ONE,
///     variance: 0.0,
///     position: Vec3::ZERO,
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// // Without variance a pixel stays as it is.
/// let color = bilateral_variance_pixel(
///     UVec2::ONE,
///     UVec2::splat(3),
///     8.0,
///     32,
///     0.0,
///     |_| known,
/// );
/// assert_eq!(color, Vec3::ONE);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BilateralVariancePixel {
    /// The value to filter, components `>= 0`.
    pub color: Vec3,
    /// Its variance, as `filter/spatial_reconstruct` gives it.
    pub variance: f32,
    /// Where its surface is, in the world.
    pub position: Vec3,
    /// Distance from its plane at which the weight falls to 1/e, above 0; not
    /// above 0 where there is no surface.
    pub reach: f32,
    /// Its unit normal.
    pub normal: Vec3,
}

/// Squared size of a colour, or of a difference of two, channels weighted as
/// in luminance. `filter/spatial_reconstruct` measures variance in it.
///
/// Error analysis: a sum of positive terms.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::bilateral_variance::bilateral_variance_square;
///
/// // For grey it is the square of the value, up to rounding.
/// assert!((bilateral_variance_square(Vec3::splat(3.0)) - 9.0).abs() < 1e-5);
/// // Channels count as in luminance: green most.
/// assert!(
///     bilateral_variance_square(Vec3::Y) > bilateral_variance_square(Vec3::X)
/// );
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_square(color: Vec3) -> f32 {
    (0.2126 * (color.x * color.x) + 0.7152 * (color.y * color.y)) + 0.0722 * (color.z * color.z)
}

/// 1 if every channel is a number of magnitude below 2^60, else 0: NaN,
/// infinity and what squares to infinity are no colours. Compares bit patterns.
/// Exact.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::bilateral_variance::bilateral_variance_usable;
///
/// assert_eq!(bilateral_variance_usable(Vec3::ONE), 1);
/// assert_eq!(bilateral_variance_usable(Vec3::new(0.0, f32::NAN, 0.0)), 0);
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_usable(color: Vec3) -> u32 {
    u32::from((color.x.to_bits() & 0x7fff_ffff) < BILATERAL_VARIANCE_COLOR_BITS)
        & u32::from((color.y.to_bits() & 0x7fff_ffff) < BILATERAL_VARIANCE_COLOR_BITS)
        & u32::from((color.z.to_bits() & 0x7fff_ffff) < BILATERAL_VARIANCE_COLOR_BITS)
}

/// Weighted mean of two numbers `>= 0`, never outside them.
#[inline(always)]
fn bilateral_variance_mix(a: f32, a_weight: f32, b: f32, b_weight: f32, total: f32) -> f32 {
    let mixed = (a * a_weight + b * b_weight) / total;
    mixed.max(a.min(b)).min(a.max(b))
}

/// Radius of the kernel in pixels: proportional to the relative standard
/// deviation, `max_radius` from one half of it on, 0 for no variance.
///
/// `square` is [`bilateral_variance_square`] of the value; a factor on the
/// image's exposure changes nothing. Arguments are `>= 0`.
///
/// Error analysis: one quotient, one root, one product.
///
/// ```
/// use raytwin_cpu::filter::bilateral_variance::bilateral_variance_radius;
///
/// // A relative deviation of a half opens the kernel fully, a quarter half.
/// assert_eq!(bilateral_variance_radius(1.0, 4.0, 8.0), 8.0);
/// assert_eq!(bilateral_variance_radius(0.25, 4.0, 8.0), 4.0);
/// assert_eq!(bilateral_variance_radius(0.0, 4.0, 8.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_radius(variance: f32, square: f32, max_radius: f32) -> f32 {
    if variance <= 0.0 {
        return 0.0;
    }
    let full = BILATERAL_VARIANCE_FULL * square;
    if variance >= full {
        return max_radius;
    }
    max_radius * (variance / full).sqrt()
}

/// How many neighbours a kernel of this radius (in pixels, `[0, 1024]`) reads:
/// the radius squared, rounded down, at most `max_taps`; below one pixel none.
///
/// Error analysis: one product; where it is within an ULP of an integer the
/// twins may differ by one.
///
/// ```
/// use raytwin_cpu::filter::bilateral_variance::bilateral_variance_taps;
///
/// assert_eq!(bilateral_variance_taps(4.0, 32), 16);
/// assert_eq!(bilateral_variance_taps(8.0, 32), 32);
/// assert_eq!(bilateral_variance_taps(0.9, 32), 0);
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_taps(radius: f32, max_taps: u32) -> u32 {
    ((radius * radius) as u32).min(max_taps)
}

/// Where tap `index` of `1..=taps` lies, in pixels from the centre; round each
/// component to the nearest integer. `turn` in `[0, 1)` rotates the kernel.
///
/// Golden-angle steps at `radius·√(index/taps)`: evenly over the disc.
///
/// Error analysis: the angle errs by 2^-23 turns, the radius by a quotient, a
/// root and a product.
///
/// ```
/// use raytwin_cpu::filter::bilateral_variance::bilateral_variance_offset;
///
/// // The last tap lies on the rim, the first quarter within half the radius.
/// let rim = bilateral_variance_offset(16, 16, 8.0, 0.3);
/// let inner = bilateral_variance_offset(4, 16, 8.0, 0.3);
/// assert!((rim.length() - 8.0).abs() < 1e-4);
/// assert!((inner.length() - 4.0).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_offset(index: u32, taps: u32, radius: f32, turn: f32) -> Vec2 {
    let angle = (index.wrapping_mul(GOLDEN) >> 8) as f32 * 5.9604645e-8 + turn;
    let around = sincos_turn(angle);
    let r = radius * (index as f32 / taps.max(1) as f32).sqrt();
    Vec2::new(r * around.y, r * around.x)
}

/// The weight of a tap against a centre of weight 1, in `[0, 1]`.
///
/// `e^-(p² + 64·|n - n'|² + d²/16v)`: `p` is the tap's distance from the
/// centre's plane over `reach`, `n` and `n'` the unit normals, `d²` the
/// [`bilateral_variance_square`] of `difference` (tap's colour less centre's),
/// `v` the centre's variance. `offset` is the tap's position less the centre's.
/// 0 if `variance` or `reach` is not above 0.
///
/// Error analysis: the exponent is a sum of squares, `x·e^-x` never exceeds
/// 0.37, so the absolute error is a few ULP of one; only the distance from the
/// plane may cancel, by `|offset|/reach`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::bilateral_variance::bilateral_variance_weight;
///
/// let grey = Vec3::ZERO;
/// let same =
///     bilateral_variance_weight(Vec3::Y, Vec3::Y, Vec3::X, 0.1, grey, 0.01);
/// let edge =
///     bilateral_variance_weight(Vec3::Y, Vec3::X, Vec3::X, 0.1, grey, 0.01);
/// // A difference of 4 standard deviations weighs 1/e.
/// let far = bilateral_variance_weight(
///     Vec3::Y,
///     Vec3::Y,
///     Vec3::X,
///     0.1,
///     Vec3::splat(0.4),
///     0.01,
/// );
/// assert!(same == 1.0 && edge < 1e-6 && (far - 0.3679).abs() < 1e-3);
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_weight(
    normal: Vec3,
    other_normal: Vec3,
    offset: Vec3,
    reach: f32,
    difference: Vec3,
    variance: f32,
) -> f32 {
    if variance <= 0.0 || reach <= 0.0 {
        return 0.0;
    }
    let height = vec3_dot(normal, offset).abs();
    let apart = bilateral_variance_square(difference);
    // e^-64 and less; compared before dividing, so that nothing overflows.
    if height >= 8.0 * reach || apart >= 1024.0 * variance {
        return 0.0;
    }
    let p = height / reach;
    let turned = Vec3::new(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let shape = p * p + BILATERAL_VARIANCE_NORMAL * vec3_dot(turned, turned);
    exp2_poly(-LOG2_E * (shape + apart / (BILATERAL_VARIANCE_COLOR * variance)))
}

/// A pixel, filtered as far as its variance asks.
///
/// `size` is the image's (each side below 2^30, `pixel` inside it); `max_radius`
/// in pixels and `max_taps` bound the kernel, `turn` in `[0, 1)` rotates it and
/// should differ from pixel to pixel. `read(at)` is only called inside `size`.
/// The result lies between its inputs, channel by channel; no variance or no
/// surface: the pixel's own value, untouched.
///
/// A colour that is none ([`bilateral_variance_usable`]) weighs nothing and is
/// filled from within `max_radius`, by geometry alone; black where nothing is
/// there. A variance that is not finite counts as 0. A surface with a number
/// that is none (NaN, infinity, 2^60 and more, a normal of 2 and more) is none.
///
/// In WGSL `read` is a function that the program defines.
///
/// Error analysis: a convex combination of at most `max_taps` colours, so the
/// errors of the weights and of the steps add: 4 ULP a step on the CPU.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::bilateral_variance::{
///     BilateralVariancePixel, bilateral_variance_pixel,
/// };
///
/// // A noisy floor: every other pixel has 1.2 in the place of 0.8.
/// let read = |at: UVec2| {
///     let value = if (at.x + at.y) % 2 == 0 { 0.8 } else { 1.2 };
///     BilateralVariancePixel {
///         color: Vec3::splat(value),
///         variance: 0.04,
///         position: Vec3::new(at.x as f32, 0.0, at.y as f32),
///         reach: 0.1,
///         normal: Vec3::Y,
///     }
/// };
/// let size = UVec2::splat(16);
/// let color =
///     bilateral_variance_pixel(UVec2::splat(8), size, 8.0, 32, 0.3, read);
/// assert!((color.x - 1.0).abs() < 0.1);
/// ```
#[inline]
#[must_use]
pub fn bilateral_variance_pixel<R>(
    pixel: UVec2,
    size: UVec2,
    max_radius: f32,
    max_taps: u32,
    turn: f32,
    read: R,
) -> Vec3
where
    R: Fn(UVec2) -> BilateralVariancePixel,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return Vec3::ZERO;
    }
    let centre = read(pixel);
    let mut color = centre.color;
    // A variance that is none (by bits: NaN has the largest) counts as 0.
    let mut variance = if centre.variance.to_bits() < BILATERAL_VARIANCE_BITS {
        centre.variance
    } else {
        0.0
    };
    let mut radius = bilateral_variance_radius(
        variance,
        bilateral_variance_square(centre.color),
        max_radius,
    );
    let mut sum = 1.0;
    let sound = bilateral_variance_usable(centre.color) != 0;
    if !sound {
        // Its neighbours fill it, by geometry alone.
        color = Vec3::ZERO;
        variance = 1.0;
        radius = max_radius;
        sum = 0.0;
    }
    let mut taps = bilateral_variance_taps(radius, max_taps);
    if usable_surface(centre.position, centre.normal, centre.reach) == 0 {
        taps = 0;
    }
    let mut i = 1;
    while i <= taps {
        let offset = bilateral_variance_offset(i, taps, radius, turn);
        let x = pixel.x as i32 + (offset.x + 0.5).floor() as i32;
        let y = pixel.y as i32 + (offset.y + 0.5).floor() as i32;
        i += 1;
        if x < 0 || y < 0 || x >= size.x as i32 || y >= size.y as i32 {
            continue;
        }
        let tap = read(UVec2::new(x as u32, y as u32));
        if (usable_surface(tap.position, tap.normal, tap.reach)
            & bilateral_variance_usable(tap.color))
            == 0
        {
            continue;
        }
        let to = tap.position - centre.position;
        let difference = if sound {
            tap.color - centre.color
        } else {
            Vec3::ZERO
        };
        let w = bilateral_variance_weight(
            centre.normal,
            tap.normal,
            to,
            centre.reach,
            difference,
            variance,
        );
        if w <= 0.0 {
            continue;
        }
        // The first of a broken pixel, exactly.
        if sum <= 0.0 {
            color = tap.color;
        }
        let total = sum + w;
        color = Vec3::new(
            bilateral_variance_mix(color.x, sum, tap.color.x, w, total),
            bilateral_variance_mix(color.y, sum, tap.color.y, w, total),
            bilateral_variance_mix(color.z, sum, tap.color.z, w, total),
        );
        sum = total;
    }
    color
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    fn flat(at: UVec2, color: Vec3, variance: f32) -> BilateralVariancePixel {
        BilateralVariancePixel {
            color,
            variance,
            position: Vec3::new(at.x as f32, at.y as f32, 0.0),
            reach: 0.1,
            normal: Vec3::Z,
        }
    }

    const SIZE: UVec2 = UVec2::splat(32);

    fn everywhere(mut check: impl FnMut(UVec2, f32)) {
        for i in 0..SIZE.x * SIZE.y {
            let at = UVec2::new(i % SIZE.x, i / SIZE.x);
            check(at, noise(at, 99));
        }
    }

    #[test]
    fn a_constant_image_stays_as_it_is() {
        for value in [0.0, 1e-30, 0.1, 3.3, 1000.1, 1e4] {
            let color = Vec3::new(value, value * 0.7, value * 0.3);
            everywhere(|at, turn| {
                let read = |at| flat(at, color, noise(at, 3) * value * value);
                assert_eq!(
                    bilateral_variance_pixel(at, SIZE, 6.0, 32, turn, read),
                    color
                );
            });
        }
    }

    #[test]
    fn no_variance_and_no_surface_touch_nothing() {
        let color = |at| Vec3::new(noise(at, 0), noise(at, 1), noise(at, 2)) * 1e4;
        everywhere(|at, turn| {
            let still = |at| flat(at, color(at), 0.0);
            assert_eq!(
                bilateral_variance_pixel(at, SIZE, 8.0, 64, turn, still),
                color(at)
            );
            let nowhere = |at| BilateralVariancePixel {
                reach: 0.0,
                ..flat(at, color(at), 1e9)
            };
            assert_eq!(
                bilateral_variance_pixel(at, SIZE, 8.0, 64, turn, nowhere),
                color(at)
            );
        });
    }

    #[test]
    fn the_result_lies_between_its_inputs_and_noise_falls() {
        let color = |at: UVec2| {
            // A third of it black, some of it at 1e4 nits.
            let bright = if noise(at, 5) < 0.1 { 1e4 } else { 1.0 };
            Vec3::new(noise(at, 0), noise(at, 1), noise(at, 2)).map(|c| (c - 0.3).max(0.0)) * bright
        };
        everywhere(|at, turn| {
            let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::ZERO);
            let seen = std::cell::RefCell::new(Vec::new());
            let read = |at| {
                seen.borrow_mut().push(color(at));
                flat(at, color(at), 1e9 * noise(at, 6))
            };
            let result = bilateral_variance_pixel(at, SIZE, 5.0, 24, turn, read);
            for c in seen.borrow().iter() {
                low = low.min(*c);
                high = high.max(*c);
            }
            assert!(result.is_finite());
            assert!(result.cmpge(low).all() && result.cmple(high).all());
        });

        // Independent noise of known variance around 0.5: what is left of it.
        let (mut before, mut after) = (0.0f64, 0.0f64);
        everywhere(|at, turn| {
            let read = |at: UVec2| flat(at, Vec3::splat(noise(at, 7)), 1.0 / 12.0);
            let result = bilateral_variance_pixel(at, SIZE, 4.0, 16, turn, read);
            before += (f64::from(noise(at, 7)) - 0.5).powi(2);
            after += (f64::from(result.x) - 0.5).powi(2);
        });
        println!("variance left: {:.4}", after / before);
        assert!(after < 0.15 * before, "{after} of {before}");
    }

    #[test]
    fn edges_stop_it() {
        // Left black, right white, apart in depth or turned away.
        for step in 0..2 {
            everywhere(|at, turn| {
                let read = |at: UVec2| {
                    let right = at.x >= 16;
                    let mut p = flat(at, Vec3::splat(f32::from(u8::from(right))), 10.0);
                    if right && step == 0 {
                        p.position.z = 1.0;
                    } else if right {
                        p.normal = Vec3::X;
                    }
                    p
                };
                let got = bilateral_variance_pixel(at, SIZE, 6.0, 32, turn, read).x;
                let want = f32::from(u8::from(at.x >= 16));
                assert!((got - want).abs() < 1e-6, "{at}: {got}");
            });
        }
    }

    /// A bad surface is none; a bad colour is filled, a bad variance counts as
    /// 0. No pixel farther away than the radius changes.
    #[test]
    fn a_bad_pixel_weighs_nothing() {
        let place = UVec2::new(13, 17);
        let sound = |at: UVec2| flat(at, Vec3::splat(0.5 + noise(at, 7)), 1.0);
        let filter = |at, turn, read: &dyn Fn(UVec2) -> BilateralVariancePixel| {
            bilateral_variance_pixel(at, SIZE, 4.0, 16, turn, read)
        };
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            for lane in 0..11 {
                let broken = |at: UVec2| {
                    let mut pixel = sound(at);
                    match (at == place, lane) {
                        (true, 0..=2) => pixel.position[lane] = bad,
                        (true, 3..=5) => pixel.normal[lane - 3] = bad,
                        (true, 6) => pixel.reach = bad,
                        (true, 7..=9) => pixel.color[lane - 7] = bad,
                        (true, _) => pixel.variance = bad,
                        _ => {}
                    }
                    pixel
                };
                let without = |at: UVec2| BilateralVariancePixel {
                    reach: if at == place { 0.0 } else { 0.1 },
                    ..sound(at)
                };
                everywhere(|at, turn| {
                    let got = filter(at, turn, &broken);
                    let case = format!("{bad}, lane {lane} at {at}: {got}");
                    assert!(got.cmpge(Vec3::splat(0.5)).all(), "{case}");
                    assert!(got.cmple(Vec3::splat(1.5)).all(), "{case}");
                    let far = at.as_vec2().distance(place.as_vec2()) > 4.0 + 0.75;
                    if far || (lane == 10 && at != place) {
                        assert_eq!(got, filter(at, turn, &sound), "{case}");
                    } else if lane < 7 || (lane < 10 && at != place) {
                        assert_eq!(got, filter(at, turn, &without), "{case}");
                    }
                });
            }
        }
    }

    #[test]
    fn the_kernel_follows_the_variance_and_not_the_exposure() {
        let mut last = 0.0;
        for i in 0..100 {
            let variance = i as f32 / 200.0;
            let radius = bilateral_variance_radius(variance, 1.0, 8.0);
            let bright = bilateral_variance_radius(variance * 65536.0, 65536.0, 8.0);
            assert!(radius >= last && radius == bright);
            assert!(bilateral_variance_taps(radius, 32) >= bilateral_variance_taps(last, 32));
            last = radius;
        }
        assert_eq!(last, 8.0);
        assert_eq!(bilateral_variance_taps(last, 32), 32);
    }

    /// A noisy image on a rough surface.
    fn rough(at: UVec2) -> BilateralVariancePixel {
        let color = Vec3::new(noise(at, 0), noise(at, 1), noise(at, 2));
        BilateralVariancePixel {
            position: Vec3::new(at.x as f32, at.y as f32, 0.2 * noise(at, 4)),
            ..flat(at, color, 0.3 * noise(at, 3))
        }
    }

    #[test]
    fn the_exposure_changes_nothing_but_the_scale() {
        for power in -10..=10 {
            let k = 2f32.powi(power);
            let bright = |p| {
                let pixel = rough(p);
                BilateralVariancePixel {
                    color: pixel.color * k,
                    variance: pixel.variance * k * k,
                    ..pixel
                }
            };
            everywhere(|at, turn| {
                let plain = bilateral_variance_pixel(at, SIZE, 6.0, 32, turn, rough);
                let other = bilateral_variance_pixel(at, SIZE, 6.0, 32, turn, bright);
                assert_eq!(other, plain * k, "{at}, {k}");
            });
        }
    }

    #[test]
    fn turned_images_give_turned_results() {
        // The spiral's symmetry: a quarter turn, which swaps no two taps, so
        // exactly; unless an offset is rounded the other way.
        let mut seen = 0;
        let turned = |p: UVec2| UVec2::new(SIZE.x - 1 - p.y, p.x);
        let back = |p: UVec2| UVec2::new(p.y, SIZE.x - 1 - p.x);
        everywhere(|at, turn| {
            let turn = 0.25 * turn;
            let pixel = rough(at);
            let square = bilateral_variance_square(pixel.color);
            let radius = bilateral_variance_radius(pixel.variance, square, 6.0);
            let taps = bilateral_variance_taps(radius, 32);
            let halfway = |x: f32| (x - x.floor() - 0.5).abs() < 1e-4;
            if (1..=taps)
                .map(|i| bilateral_variance_offset(i, taps, radius, turn))
                .any(|o| halfway(o.x) || halfway(o.y))
            {
                return;
            }
            seen += u32::from(taps > 8);
            let plain = bilateral_variance_pixel(at, SIZE, 6.0, 32, turn, rough);
            let (mut place, mut times) = (at, 0);
            for quarter in [0.25, 0.5, 0.75] {
                place = turned(place);
                times += 1;
                let read = |p| rough((0..times).fold(p, |p, _| back(p)));
                let other = bilateral_variance_pixel(place, SIZE, 6.0, 32, turn + quarter, read);
                assert_eq!(other, plain, "{at}, {quarter}");
            }
        });
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn the_weights_sum_to_one() {
        // No constant shows it, as results are held between their inputs. With
        // the full radius and the variance scaled too, weights are the same.
        everywhere(|at, turn| {
            let line = |p, scale: f32, more: f32| {
                let pixel = rough(p);
                BilateralVariancePixel {
                    color: pixel.color * scale + more,
                    variance: scale * scale,
                    ..pixel
                }
            };
            let plain = bilateral_variance_pixel(at, SIZE, 4.0, 32, turn, |p| line(p, 4.0, 0.0));
            let other = bilateral_variance_pixel(at, SIZE, 4.0, 32, turn, |p| line(p, 4.0, 3.0));
            // 16 steps of 4 ULP, of values below 4 and below 8.
            let apart = (other - (plain + 3.0)).abs().max_element();
            assert!(
                apart < 64.0 * (2f32.powi(-22) + 2f32.powi(-21)),
                "{at}: {apart}"
            );
        });
    }

    #[test]
    fn a_farther_surface_never_weighs_more() {
        let mut last = 2.0;
        for i in 0..2000 {
            let offset = Vec3::new(3.0, -2.0, i as f32 * 0.005);
            let w = bilateral_variance_weight(Vec3::Z, Vec3::Z, offset, 1.0, Vec3::ZERO, 1.0);
            assert!(w <= last);
            last = w;
        }
        assert_eq!(last, 0.0);
    }
}
