//! A blur along rows, then along columns, for ambient occlusion and other
//! scalars, which stops at edges of depth and normal.
//!
//! Two passes of `2 r + 1` taps stand for one of `(2 r + 1)²`. On one plane
//! that is exact; at edges the product of two one-dimensional weights is not
//! the two-dimensional one, and a value may come around a corner.
//!
//! Source: Tomasi and Manduchi, *Bilateral Filtering for Gray and Color Images*
//! (1998); Pham and van Vliet, *Separable Bilateral Filtering for Fast Video
//! Preprocessing* (2005); plane distance and normals as in
//! `filter/bilateral_variance`.

use glam::{UVec2, Vec3};

use crate::math::exponent::exp2_poly;
use crate::math::sanitize::{sanitize_finite, usable_surface};
use crate::math::vector::vec3_dot;

/// Largest radius in pixels.
pub const SEPARABLE_BLUR_MAX_RADIUS: u32 = 32;

/// Weight of the squared distance between unit normals: as `(n·n')^128`.
pub const SEPARABLE_BLUR_NORMAL: f32 = 64.0;

/// Largest value; larger ones count as this.
pub const SEPARABLE_BLUR_MAX: f32 = 1e8;

/// log2 e.
const LOG2_E: f32 = 1.442695;

/// What the blur knows of a pixel.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::separable_blur::{
///     SeparableBlurPixel, separable_blur_pixel,
/// };
///
/// let pixel = SeparableBlurPixel {
///     position: Vec3::ZERO,
///     reach: 0.1,
///     normal: Vec3::Y,
///     value: 0.25,
/// };
/// // A constant image stays as it is.
/// let blurred =
///     separable_blur_pixel(UVec2::ONE, UVec2::splat(3), 0, 2, |_| pixel);
/// assert_eq!(blurred, 0.25);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SeparableBlurPixel {
    /// Where its surface is, in the world.
    pub position: Vec3,
    /// Distance from its plane at which the weight falls to 1/e, above 0; not
    /// above 0 where there is no surface.
    pub reach: f32,
    /// Its unit normal.
    pub normal: Vec3,
    /// The value to blur, `>= 0`.
    pub value: f32,
}

/// The weight of a tap against a centre of weight 1, in `[0, 1]`:
/// `e^-(2 (d/r)² + p² + 64·|n - n'|²)`.
///
/// `d` is its distance and `r >= d` the radius in pixels (1 to 64), so that the
/// radius is two standard deviations of the Gaussian. `p` is its distance from
/// the centre's plane over `reach`, `n` and `n'` the unit normals; `offset` is
/// its position less the centre's. 0 if `reach` is not above 0.
///
/// Error analysis: the exponent is a sum of squares, `x·e^-x` never exceeds
/// 0.37, so the absolute error is a few ULP of one; only the distance from the
/// plane may cancel, by `|offset|/reach`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::separable_blur::separable_blur_weight;
///
/// let flat = |d| separable_blur_weight(d, 4, Vec3::Y, Vec3::Y, Vec3::X, 0.1);
/// // A Gaussian along the surface: e^-2 at the radius; nothing around an edge.
/// assert!(flat(0) == 1.0 && (flat(4) - 0.13534).abs() < 1e-5);
/// let edge = separable_blur_weight(1, 4, Vec3::Y, Vec3::X, Vec3::X, 0.1);
/// assert!(edge < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn separable_blur_weight(
    distance: u32,
    radius: u32,
    normal: Vec3,
    other_normal: Vec3,
    offset: Vec3,
    reach: f32,
) -> f32 {
    if reach <= 0.0 {
        return 0.0;
    }
    let height = vec3_dot(normal, offset).abs();
    // e^-64 and less; compared before dividing, so that nothing overflows.
    if height >= 8.0 * reach {
        return 0.0;
    }
    let p = height / reach;
    let d = distance as f32 / radius as f32;
    let turned = Vec3::new(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let shape = (2.0 * (d * d) + p * p) + SEPARABLE_BLUR_NORMAL * vec3_dot(turned, turned);
    exp2_poly(-LOG2_E * shape)
}

/// The value if it is finite and not negative, cut at the largest; else -1.
#[inline(always)]
fn separable_blur_clean(value: f32) -> f32 {
    let v = sanitize_finite(value, -1.0);
    if v < 0.0 {
        return -1.0;
    }
    v.min(SEPARABLE_BLUR_MAX)
}

/// The weight of a tap, 0 if its value or its surface does not count.
#[inline(always)]
fn separable_blur_tap(
    centre: SeparableBlurPixel,
    tap: SeparableBlurPixel,
    distance: u32,
    radius: u32,
) -> f32 {
    if separable_blur_clean(tap.value) < 0.0
        || usable_surface(tap.position, tap.normal, tap.reach) == 0
    {
        return 0.0;
    }
    let offset = Vec3::new(
        tap.position.x - centre.position.x,
        tap.position.y - centre.position.y,
        tap.position.z - centre.position.z,
    );
    separable_blur_weight(
        distance,
        radius,
        centre.normal,
        tap.normal,
        offset,
        centre.reach,
    )
}

/// One pass: a pixel, blurred along a row (`axis` 0) or a column (`axis` 1).
///
/// `size` is the image's, `pixel` inside it; `radius` in pixels, at most
/// [`SEPARABLE_BLUR_MAX_RADIUS`], 0 changes nothing. `read(at)` is only called
/// inside `size`; in WGSL it is a function that the program defines.
///
/// The result lies between its inputs. Pixels outside the image count nowhere,
/// nor do values that are negative or not finite; if that is the centre, the
/// others decide, or it becomes 0. Without a surface, and where no other pixel
/// has any weight, the centre's value stays untouched. A surface with a number
/// that is none (NaN, infinity, 2^60 and more, a normal of 2 and more) is none.
///
/// The two sides are added pair by pair, so that a mirrored image gives the
/// mirrored result to the last bit.
///
/// Error analysis: two sums of positive terms and one quotient: an ULP a step
/// for each sum, and the errors of the weights twice.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::separable_blur::{
///     SeparableBlurPixel, separable_blur_pixel,
/// };
///
/// // Noise on a floor, and a shelf above it that begins at x = 8.
/// let read = |at: UVec2| SeparableBlurPixel {
///     position: Vec3::new(at.x as f32, if at.x < 8 { 0.0 } else { 5.0 }, 0.0),
///     reach: 0.1,
///     normal: Vec3::Y,
///     value: if at.x < 8 { (at.x % 2) as f32 } else { 100.0 },
/// };
/// let blurred =
///     separable_blur_pixel(UVec2::new(6, 0), UVec2::new(16, 1), 0, 6, read);
/// assert!((blurred - 0.5).abs() < 0.15);
/// ```
#[inline]
#[must_use]
pub fn separable_blur_pixel<R>(pixel: UVec2, size: UVec2, axis: u32, radius: u32, read: R) -> f32
where
    R: Fn(UVec2) -> SeparableBlurPixel,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    let centre = read(pixel);
    let own = separable_blur_clean(centre.value);
    if usable_surface(centre.position, centre.normal, centre.reach) == 0 {
        return own.max(0.0);
    }
    let mut sum = 0.0;
    let mut weight = 0.0;
    let mut low = SEPARABLE_BLUR_MAX;
    let mut high = 0.0f32;
    if own >= 0.0 {
        sum = own;
        weight = 1.0;
        low = own;
        high = own;
    }
    let mut along = UVec2::new(1, 0);
    let mut place = pixel.x;
    let mut end = size.x;
    if axis != 0 {
        along = UVec2::new(0, 1);
        place = pixel.y;
        end = size.y;
    }
    let reach = radius.min(SEPARABLE_BLUR_MAX_RADIUS);
    let mut i = 1;
    while i <= reach {
        let mut before = 0.0;
        let mut before_weight = 0.0;
        if i <= place {
            let at = UVec2::new(pixel.x - i * along.x, pixel.y - i * along.y);
            let tap = read(at);
            before_weight = separable_blur_tap(centre, tap, i, reach);
            if before_weight > 0.0 {
                before = separable_blur_clean(tap.value);
                low = low.min(before);
                high = high.max(before);
            }
        }
        let mut after = 0.0;
        let mut after_weight = 0.0;
        if i < end - place {
            let at = UVec2::new(pixel.x + i * along.x, pixel.y + i * along.y);
            let tap = read(at);
            after_weight = separable_blur_tap(centre, tap, i, reach);
            if after_weight > 0.0 {
                after = separable_blur_clean(tap.value);
                low = low.min(after);
                high = high.max(after);
            }
        }
        sum += before * before_weight + after * after_weight;
        weight += before_weight + after_weight;
        i += 1;
    }
    if weight <= 0.0 {
        return 0.0;
    }
    (sum / weight).max(low).min(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    const SIZE: UVec2 = UVec2::new(40, 31);

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    fn flat(at: UVec2, value: f32) -> SeparableBlurPixel {
        SeparableBlurPixel {
            position: Vec3::new(at.x as f32, at.y as f32, 0.0),
            reach: 0.1,
            normal: Vec3::Z,
            value,
        }
    }

    fn pixels(size: UVec2) -> impl Iterator<Item = UVec2> {
        (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
    }

    /// Both passes over an image.
    fn blurred(size: UVec2, radius: u32, read: impl Fn(UVec2) -> SeparableBlurPixel) -> Vec<f32> {
        let rows: Vec<f32> = pixels(size)
            .map(|at| separable_blur_pixel(at, size, 0, radius, &read))
            .collect();
        let half = |at: UVec2| SeparableBlurPixel {
            value: rows[(at.y * size.x + at.x) as usize],
            ..read(at)
        };
        pixels(size)
            .map(|at| separable_blur_pixel(at, size, 1, radius, half))
            .collect()
    }

    /// A bumpy surface with a step.
    fn bumpy(at: UVec2) -> SeparableBlurPixel {
        let mut pixel = flat(at, noise(at, 0));
        pixel.position.z = 0.2 * noise(at, 1) + if at.x > 20 { 1.0 } else { 0.0 };
        pixel
    }

    #[test]
    fn a_constant_image_stays_as_it_is() {
        for value in [0.0, 1e-30, 0.1, 0.7, 1.0, 3.3, 65000.0] {
            for radius in [0, 1, 4, 32, 1000] {
                let result = blurred(SIZE, radius, |at| SeparableBlurPixel { value, ..bumpy(at) });
                assert!(result.iter().all(|v| *v == value), "{value}, {radius}");
            }
        }
    }

    #[test]
    fn it_stays_between_its_inputs_and_noise_falls() {
        let read = |at: UVec2| flat(at, noise(at, 7));
        let result = blurred(UVec2::splat(128), 4, read);
        let spread = |v: &mut dyn Iterator<Item = f32>| -> f64 {
            v.map(|x| (f64::from(x) - 0.5).powi(2)).sum()
        };
        assert!(result.iter().all(|v| (0.0..=1.0).contains(v)));
        let before = spread(&mut pixels(UVec2::splat(128)).map(|at| noise(at, 7)));
        let after = spread(&mut result.iter().copied());
        // For independent noise the sum of the squared weights, twice.
        let weights = |f: fn(f64) -> f64| -> f64 {
            (-4..=4)
                .map(|i| f((-2.0 * f64::from(i * i) / 16.0).exp()))
                .sum()
        };
        let want = (weights(|w| w * w) / weights(|w| w).powi(2)).powi(2);
        println!("variance left: {:.4}, expected {want:.4}", after / before);
        assert!((after / before / want - 1.0).abs() < 0.15);
    }

    #[test]
    fn mirrored_and_transposed_images_give_the_same() {
        let mirror = |at: UVec2| SIZE - 1 - at;
        let turned = UVec2::new(SIZE.y, SIZE.x);
        let swap = |at: UVec2| UVec2::new(at.y, at.x);
        for at in pixels(SIZE) {
            for radius in [1, 5] {
                let plain = separable_blur_pixel(at, SIZE, 0, radius, bumpy);
                let mirrored =
                    separable_blur_pixel(mirror(at), SIZE, 0, radius, |p| bumpy(mirror(p)));
                assert_eq!(plain, mirrored, "{at}");
                let transposed =
                    separable_blur_pixel(swap(at), turned, 1, radius, |p| bumpy(swap(p)));
                assert_eq!(plain, transposed, "{at}");
            }
        }
    }

    #[test]
    fn edges_stop_it() {
        for kind in 0..3 {
            let read = |at: UVec2| {
                let right = at.x >= 16;
                let mut pixel = flat(at, f32::from(u8::from(right)));
                if right && kind == 0 {
                    pixel.position.z = 1.0;
                } else if right && kind == 1 {
                    pixel.normal = Vec3::X;
                    pixel.reach = 1000.0;
                } else if right {
                    pixel.reach = 0.0;
                }
                pixel
            };
            for (at, value) in pixels(SIZE).zip(blurred(SIZE, 6, read)) {
                let want = f32::from(u8::from(at.x >= 16));
                assert!((value - want).abs() < 1e-6, "{kind}, {at}: {value}");
            }
        }
    }

    /// A tilted plane is a plane: a ramp on it stays a ramp away from borders.
    #[test]
    fn a_grazing_plane_is_no_edge() {
        for slope in [0.0f32, 1.0, 20.0] {
            let normal = Vec3::new(slope, 0.0, -1.0).normalize();
            let read = |at: UVec2| SeparableBlurPixel {
                position: Vec3::new(at.x as f32, at.y as f32, slope * at.x as f32),
                reach: 0.01,
                normal,
                value: at.x as f32,
            };
            for x in 6..SIZE.x - 6 {
                let at = UVec2::new(x, 5);
                let value = separable_blur_pixel(at, SIZE, 0, 6, read);
                assert!((value - x as f32).abs() < 1e-4, "{at}: {value}");
            }
            // Trap: by difference of depth each pixel stands alone.
            let apart = read(UVec2::new(8, 5)).position.z - read(UVec2::new(7, 5)).position.z;
            if slope > 0.0 {
                assert!((-(apart / 0.01).powi(2)).exp() < 1e-6);
            }
        }
    }

    /// A bad value is gone, and reaches no further than the radius.
    #[test]
    fn bad_numbers_are_contained() {
        let place = UVec2::new(9, 9);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 1e30] {
            let read = |at: UVec2| {
                let mut pixel = bumpy(at);
                if at == place {
                    pixel.value = bad;
                }
                pixel
            };
            let plain = blurred(SIZE, 3, bumpy);
            for ((at, value), before) in pixels(SIZE).zip(blurred(SIZE, 3, read)).zip(plain) {
                assert!(value.is_finite() && (0.0..=1e8).contains(&value));
                if bad < 1e30 || bad.is_nan() || bad.is_infinite() {
                    assert!(value <= 1.0, "{bad} at {at}: {value}");
                }
                if at.x.abs_diff(place.x) > 3 || at.y.abs_diff(place.y) > 3 {
                    assert_eq!(value, before, "{bad} at {at}");
                }
            }
            let alone = separable_blur_pixel(place, SIZE, 0, 3, |at| SeparableBlurPixel {
                value: bad,
                ..flat(at, 0.0)
            });
            assert!(alone.is_finite());
        }
    }

    /// It is as if it had no surface: 0 pixels of damage, but for what it no
    /// longer gives to its row and column.
    #[test]
    fn a_bad_surface_is_none() {
        let place = UVec2::new(9, 9);
        let plain = blurred(SIZE, 3, bumpy);
        let without = blurred(SIZE, 3, |at| {
            let mut pixel = bumpy(at);
            pixel.reach = if at == place { 0.0 } else { pixel.reach };
            pixel
        });
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            for lane in 0..7 {
                let read = |at: UVec2| {
                    let mut pixel = bumpy(at);
                    match (at == place, lane) {
                        (true, 0..=2) => pixel.position[lane] = bad,
                        (true, 3..=5) => pixel.normal[lane - 3] = bad,
                        (true, _) => pixel.reach = bad,
                        _ => {}
                    }
                    pixel
                };
                for (i, value) in blurred(SIZE, 3, read).into_iter().enumerate() {
                    let at = UVec2::new(i as u32 % SIZE.x, i as u32 / SIZE.x);
                    assert_eq!(value, without[i], "{bad}, lane {lane} at {at}");
                    let apart = at.x.abs_diff(place.x).max(at.y.abs_diff(place.y));
                    assert!(apart <= 3 || value == plain[i], "{bad}, {lane} at {at}");
                }
            }
        }
        let own = without[(place.y * SIZE.x + place.x) as usize];
        assert_eq!(own, bumpy(place).value);
    }

    /// Trap: pixels outside the image read as 0 darken the border.
    #[test]
    fn zeros_beyond_the_border_darken_it() {
        let all: f32 = (-4..=4)
            .map(|i: i32| (-2.0 * (i * i) as f32 / 16.0).exp())
            .sum();
        let inside: f32 = (0..=4)
            .map(|i: i32| (-2.0 * (i * i) as f32 / 16.0).exp())
            .sum();
        assert!(inside / all < 0.62);
        let corner = separable_blur_pixel(UVec2::ZERO, SIZE, 0, 4, |at| flat(at, 1.0));
        assert_eq!(corner, 1.0);
    }

    #[test]
    fn a_farther_surface_never_weighs_more() {
        let mut last = 2.0;
        for i in 0..2000 {
            let offset = Vec3::new(3.0, -2.0, i as f32 * 0.005);
            let w = separable_blur_weight(1, 4, Vec3::Z, Vec3::Z, offset, 1.0);
            assert!(w <= last);
            last = w;
        }
        assert_eq!(last, 0.0);
    }

    #[test]
    fn the_exposure_changes_nothing_but_the_scale() {
        for (power, radius) in (-10..=10).flat_map(|p| [(p, 1), (p, 5)]) {
            let k = 2f32.powi(power);
            let bright = |p| SeparableBlurPixel {
                value: bumpy(p).value * k,
                ..bumpy(p)
            };
            let plain = blurred(SIZE, radius, bumpy);
            for (plain, other) in plain.iter().zip(blurred(SIZE, radius, bright)) {
                assert_eq!(plain * k, other);
            }
        }
    }

    #[test]
    fn the_weights_sum_to_one() {
        // No constant shows it, as results are held between their inputs.
        let more = |p| SeparableBlurPixel {
            value: bumpy(p).value * 2.0 + 3.0,
            ..bumpy(p)
        };
        for at in pixels(SIZE) {
            for axis in [0, 1] {
                let plain = separable_blur_pixel(at, SIZE, axis, 5, bumpy);
                let other = separable_blur_pixel(at, SIZE, axis, 5, more);
                // Two sums of six steps and a quotient: 15 roundings, of values
                // below 1 (twice) and below 8, with what is added.
                let apart = (other - (plain * 2.0 + 3.0)).abs();
                assert!(
                    apart < 16.0 * (2f32.powi(-23) + 2f32.powi(-21)),
                    "{at}: {apart}"
                );
            }
        }
    }
}
