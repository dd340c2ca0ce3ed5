//! From half or quarter resolution to full, without bleeding over edges:
//! bilinear weights times how well each of the four surfaces fits.
//!
//! Source: Kopf et al., *Joint Bilateral Upsampling* (2007); plane distance and
//! the normals' distance as in `filter/bilateral_variance`. Always counting the
//! nearest value a little, so that no sum of weights is zero, is ours.

use glam::{UVec2, Vec2, Vec3};

use crate::math::exponent::exp2_poly;
use crate::math::sanitize::{sanitize_vector, usable_surface};
use crate::math::vector::vec3_dot;

/// Weight that the nearest value has in any case, 2^-24: it decides where
/// nothing else does, and is below rounding where anything does.
pub const BILATERAL_UPSAMPLE_FLOOR: f32 = 5.9604645e-8;

/// Weight of the squared distance between unit normals: as `(n·n')^128`.
pub const BILATERAL_UPSAMPLE_NORMAL: f32 = 64.0;

/// Largest value of a channel; larger ones count as this.
pub const BILATERAL_UPSAMPLE_MAX: f32 = 1e8;

/// log2 e.
const LOG2_E: f32 = 1.442695;

/// A surface at full resolution.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::bilateral_upsample::{
///     BilateralUpsampleSurface, bilateral_upsample_weight,
/// };
///
/// let floor = BilateralUpsampleSurface {
///     position: Vec3::ZERO,
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// // Without a surface a pixel has no reach.
/// let sky = BilateralUpsampleSurface { reach: 0.0, ..floor };
/// let weight = |s: BilateralUpsampleSurface| {
///     bilateral_upsample_weight(s.normal, Vec3::Y, Vec3::X, s.reach)
/// };
/// assert_eq!((weight(floor), weight(sky)), (1.0, 0.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BilateralUpsampleSurface {
    /// Where it is, in the world.
    pub position: Vec3,
    /// Distance from its plane at which a weight falls to 1/e, above 0; not
    /// above 0 where there is no surface.
    pub reach: f32,
    /// Its unit normal.
    pub normal: Vec3,
}

/// A value at low resolution.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::bilateral_upsample::{
///     BilateralUpsampleSurface, BilateralUpsampleTap, bilateral_upsample_pixel,
/// };
///
/// // A ray that gave nothing: it counts nowhere.
/// let none = BilateralUpsampleTap {
///     color: Vec3::ZERO,
///     weight: 0.0,
///     position: Vec3::ZERO,
///     normal: Vec3::Y,
/// };
/// let grey =
///     BilateralUpsampleTap { color: Vec3::splat(0.5), weight: 1.0, ..none };
/// let floor = BilateralUpsampleSurface {
///     position: Vec3::ZERO,
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// let tap = |at: UVec2| if at.x == 0 { none } else { grey };
/// let color =
///     bilateral_upsample_pixel(UVec2::ONE, UVec2::splat(2), 2, |_| floor, tap);
/// assert!((color - grey.color).length() < 1e-5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BilateralUpsampleTap {
    /// The value, channels `>= 0`.
    pub color: Vec3,
    /// How much it counts, in `[0, 1]`; 0 for no value, or no surface.
    pub weight: f32,
    /// Where its surface is, in the world.
    pub position: Vec3,
    /// Its unit normal.
    pub normal: Vec3,
}

/// Where a pixel lies among the pixels of the low resolution.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::bilateral_upsample::bilateral_upsample_place;
///
/// // At the image's corner the far pixel lies outside: -1 in two's complement.
/// let place = bilateral_upsample_place(UVec2::ZERO, 2);
/// assert_eq!((place.near, place.far), (UVec2::ZERO, UVec2::MAX));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct BilateralUpsamplePlace {
    /// The nearest pixel, the one whose block holds it.
    pub near: UVec2,
    /// The next one on the other side, along each axis; 2^32 - 1 for -1.
    pub far: UVec2,
    /// Bilinear weight of `far` along each axis, in `[0, 1/2)`.
    pub share: Vec2,
}

/// Where a pixel lies among pixels that stand for `scale` x `scale` each and
/// have their values in the middle.
///
/// `scale` is 1 to 64, 2 for half and 4 for quarter resolution. `pixel` is
/// below 2^30.
///
/// Error analysis: one quotient of exact numbers.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::bilateral_upsample::bilateral_upsample_place;
///
/// // Pixel 5 is the right half of block 2, a quarter of the way to block 3.
/// let place = bilateral_upsample_place(UVec2::new(5, 5), 2);
/// assert_eq!((place.near.x, place.far.x, place.share.x), (2, 3, 0.25));
/// ```
#[inline]
#[must_use]
pub fn bilateral_upsample_place(pixel: UVec2, scale: u32) -> BilateralUpsamplePlace {
    let near = UVec2::new(pixel.x / scale, pixel.y / scale);
    // Twice the distance from the middle of the block, either side.
    let x = 2 * (pixel.x - near.x * scale) + 1;
    let y = 2 * (pixel.y - near.y * scale) + 1;
    let mut far = UVec2::new(near.x.wrapping_sub(1), near.y.wrapping_sub(1));
    if x > scale {
        far.x = near.x + 1;
    }
    if y > scale {
        far.y = near.y + 1;
    }
    let size = (2 * scale) as f32;
    BilateralUpsamplePlace {
        near,
        far,
        share: Vec2::new(
            (x.max(scale) - x.min(scale)) as f32 / size,
            (y.max(scale) - y.min(scale)) as f32 / size,
        ),
    }
}

/// How well a surface fits, in `[0, 1]`: `e^-(p² + 64·|n - n'|²)`.
///
/// `p` is its distance from the pixel's plane over `reach`, `n` and `n'` the
/// unit normals; `offset` is its position less the pixel's. A plane fits itself
/// fully, however it is tilted. 0 if `reach` is not above 0.
///
/// Error analysis: the exponent is a sum of squares, `x·e^-x` never exceeds
/// 0.37, so the absolute error is a few ULP of one; only the distance from the
/// plane may cancel, by `|offset|/reach`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::bilateral_upsample::bilateral_upsample_weight;
///
/// // One plane: any distance along it. A step, or an edge: next to nothing.
/// let along = bilateral_upsample_weight(Vec3::Y, Vec3::Y, Vec3::X, 0.1);
/// let step = bilateral_upsample_weight(Vec3::Y, Vec3::Y, Vec3::Y, 0.1);
/// let edge = bilateral_upsample_weight(Vec3::Y, Vec3::X, Vec3::X, 0.1);
/// assert!(along == 1.0 && step < 1e-6 && edge < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn bilateral_upsample_weight(
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
    let turned = Vec3::new(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let shape = p * p + BILATERAL_UPSAMPLE_NORMAL * vec3_dot(turned, turned);
    exp2_poly(-LOG2_E * shape)
}

/// What has been summed up so far.
#[derive(Clone, Copy)]
struct BilateralUpsampleSum {
    color: Vec3,
    weight: f32,
    low: Vec3,
    high: Vec3,
}

/// Adds a colour; none of what is not finite or negative.
#[inline(always)]
fn bilateral_upsample_add(
    sum: BilateralUpsampleSum,
    color: Vec3,
    weight: f32,
) -> BilateralUpsampleSum {
    let c = sanitize_vector(color, Vec3::splat(-1.0));
    if weight <= 0.0 || c.x < 0.0 || c.y < 0.0 || c.z < 0.0 {
        return sum;
    }
    let x = c.x.min(BILATERAL_UPSAMPLE_MAX);
    let y = c.y.min(BILATERAL_UPSAMPLE_MAX);
    let z = c.z.min(BILATERAL_UPSAMPLE_MAX);
    BilateralUpsampleSum {
        color: Vec3::new(
            sum.color.x + weight * x,
            sum.color.y + weight * y,
            sum.color.z + weight * z,
        ),
        weight: sum.weight + weight,
        low: Vec3::new(sum.low.x.min(x), sum.low.y.min(y), sum.low.z.min(z)),
        high: Vec3::new(sum.high.x.max(x), sum.high.y.max(y), sum.high.z.max(z)),
    }
}

/// A full-resolution pixel from the four low-resolution ones around it.
///
/// `low_size` is that of the low-resolution image, each side at least 1 and
/// below 2^30; `scale` as in [`bilateral_upsample_place`].
/// `read_surface(pixel)` gives the surface at full resolution and is called
/// once; `read_tap(at)` a value at low resolution, always inside `low_size`.
/// In WGSL both are functions that the program defines.
///
/// The result lies between its inputs, channel by channel. Where no value fits
/// it is the nearest one, whatever its weight. Values that are not finite or
/// have a negative channel count nowhere; black if there are no others. A
/// surface or a weight with a number that is none (NaN, infinity, 2^60 and more,
/// a normal of 2 and more) fits nowhere.
///
/// Error analysis: sums of positive terms and one quotient, so the errors are
/// those of the weights, twice. A small weight's relative error is that of its
/// exponent, up to 17 times an ULP's before the floor takes over.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::bilateral_upsample::{
///     BilateralUpsampleSurface, BilateralUpsampleTap, bilateral_upsample_pixel,
/// };
///
/// // A wall at x >= 1 in front of a floor; red values lie on it, blue ones below.
/// let place = |wall: bool| Vec3::new(0.0, if wall { 1.0 } else { 0.0 }, 0.0);
/// let surface = |at: UVec2| BilateralUpsampleSurface {
///     position: place(at.x >= 2),
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// let tap = |at: UVec2| BilateralUpsampleTap {
///     color: if at.x >= 1 { Vec3::X } else { Vec3::Z },
///     weight: 1.0,
///     position: place(at.x >= 1),
///     normal: Vec3::Y,
/// };
/// // Pixel 1 is the floor's last; no red comes over the edge.
/// let color =
///     bilateral_upsample_pixel(UVec2::ONE, UVec2::splat(2), 2, surface, tap);
/// assert!((color - Vec3::Z).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn bilateral_upsample_pixel<S, T>(
    pixel: UVec2,
    low_size: UVec2,
    scale: u32,
    read_surface: S,
    read_tap: T,
) -> Vec3
where
    S: Fn(UVec2) -> BilateralUpsampleSurface,
    T: Fn(UVec2) -> BilateralUpsampleTap,
{
    if low_size.x == 0 || low_size.y == 0 {
        return Vec3::ZERO;
    }
    let place = bilateral_upsample_place(pixel, scale);
    let surface = read_surface(pixel);
    let sound = usable_surface(surface.position, surface.normal, surface.reach);
    let nearest = UVec2::new(
        place.near.x.min(low_size.x - 1),
        place.near.y.min(low_size.y - 1),
    );
    let mut sum = BilateralUpsampleSum {
        color: Vec3::ZERO,
        weight: 0.0,
        low: Vec3::splat(BILATERAL_UPSAMPLE_MAX),
        high: Vec3::ZERO,
    };
    sum = bilateral_upsample_add(sum, read_tap(nearest).color, BILATERAL_UPSAMPLE_FLOOR);
    let mut i = 0;
    while i < 4 {
        let mut at = place.near;
        let mut share_x = 1.0 - place.share.x;
        let mut share_y = 1.0 - place.share.y;
        if (i & 1) != 0 {
            at.x = place.far.x;
            share_x = place.share.x;
        }
        if (i & 2) != 0 {
            at.y = place.far.y;
            share_y = place.share.y;
        }
        i += 1;
        if at.x >= low_size.x || at.y >= low_size.y {
            continue;
        }
        let tap = read_tap(at);
        if (sound & usable_surface(tap.position, tap.normal, tap.weight)) == 0 {
            continue;
        }
        let offset = Vec3::new(
            tap.position.x - surface.position.x,
            tap.position.y - surface.position.y,
            tap.position.z - surface.position.z,
        );
        let fit = bilateral_upsample_weight(surface.normal, tap.normal, offset, surface.reach);
        sum = bilateral_upsample_add(sum, tap.color, ((share_x * share_y) * fit) * tap.weight);
    }
    if sum.weight <= 0.0 {
        return Vec3::ZERO;
    }
    Vec3::new(
        (sum.color.x / sum.weight).max(sum.low.x).min(sum.high.x),
        (sum.color.y / sum.weight).max(sum.low.y).min(sum.high.y),
        (sum.color.z / sum.weight).max(sum.low.z).min(sum.high.z),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    const SIZE: UVec2 = UVec2::new(36, 28);

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    fn floor(x: f32, y: f32) -> BilateralUpsampleSurface {
        BilateralUpsampleSurface {
            position: Vec3::new(x, y, 0.0),
            reach: 0.1,
            normal: Vec3::Z,
        }
    }

    /// The middle of a low-resolution pixel.
    fn middle(at: UVec2, scale: u32) -> Vec2 {
        (at.as_vec2() + 0.5) * scale as f32 - 0.5
    }

    fn tap(color: Vec3, surface: BilateralUpsampleSurface) -> BilateralUpsampleTap {
        BilateralUpsampleTap {
            color,
            weight: 1.0,
            position: surface.position,
            normal: surface.normal,
        }
    }

    fn pixels(size: UVec2) -> impl Iterator<Item = UVec2> {
        (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
    }

    #[test]
    fn a_constant_image_stays_as_it_is() {
        for scale in [1, 2, 4] {
            for value in [0.0, 1e-30, 0.1, 3.3, 1000.1, 1e4] {
                let color = Vec3::new(value, value * 0.7, value * 0.3);
                for at in pixels(SIZE) {
                    let result = bilateral_upsample_pixel(
                        at,
                        SIZE / scale,
                        scale,
                        |p| floor(p.x as f32, p.y as f32 + noise(p, 1)),
                        |p| BilateralUpsampleTap {
                            weight: noise(p, 2),
                            ..tap(color, floor(0.0, noise(p, 3)))
                        },
                    );
                    assert_eq!(result, color);
                }
            }
        }
    }

    /// On one plane it is bilinear interpolation, which keeps a ramp a ramp;
    /// and a tilted plane is a plane, even at a grazing angle.
    #[test]
    fn a_ramp_on_a_tilted_plane_stays_a_ramp() {
        for scale in [2, 4] {
            for slope in [0.0f32, 1.0, 20.0] {
                let normal = Vec3::new(slope, 0.0, -1.0).normalize();
                let surface = |x: f32, y: f32| BilateralUpsampleSurface {
                    position: Vec3::new(x, y, slope * x),
                    reach: 0.01,
                    normal,
                };
                let low_size = SIZE / scale;
                for at in pixels(SIZE) {
                    let inside =
                        at.cmpge(UVec2::splat(scale)).all() && (at + scale).cmplt(SIZE).all();
                    if !inside {
                        continue;
                    }
                    let result = bilateral_upsample_pixel(
                        at,
                        low_size,
                        scale,
                        |p| surface(p.x as f32, p.y as f32),
                        |p| {
                            let m = middle(p, scale);
                            tap(Vec3::new(m.x, m.y, 1.0), surface(m.x, m.y))
                        },
                    );
                    let want = Vec3::new(at.x as f32, at.y as f32, 1.0);
                    assert!((result - want).abs().max_element() < 1e-4, "{at}: {result}");
                }
            }
        }
    }

    /// Two surfaces meet anywhere between the low-resolution pixels: each pixel
    /// gets its own surface's colour wherever one of the four taps has it.
    #[test]
    fn nothing_bleeds_over_an_edge() {
        for scale in [2u32, 4] {
            for edge in 1..SIZE.x {
                for kind in 0..2 {
                    let surface = |x: f32, y: f32| {
                        let mut s = floor(x, y);
                        s.reach = 100.0;
                        if x >= edge as f32 - 0.5 {
                            if kind == 0 {
                                s.position.z = 1e3;
                            } else {
                                s.normal = Vec3::X;
                            }
                        }
                        s
                    };
                    let read_tap = |p: UVec2| {
                        let m = middle(p, scale);
                        let right = m.x >= edge as f32 - 0.5;
                        tap(Vec3::splat(f32::from(u8::from(right))), surface(m.x, m.y))
                    };
                    for at in pixels(UVec2::new(SIZE.x, scale)) {
                        let read = |p: UVec2| surface(p.x as f32, p.y as f32);
                        let got = bilateral_upsample_pixel(at, SIZE / scale, scale, read, read_tap);
                        let want = f32::from(u8::from(at.x >= edge));
                        let place = bilateral_upsample_place(at, scale);
                        let seen = [place.near.x, place.far.x]
                            .into_iter()
                            .filter(|x| *x < SIZE.x / scale)
                            .any(|x| read_tap(UVec2::new(x, 0)).color.x == want);
                        if seen {
                            assert!((got.x - want).abs() < 1e-6, "{at}, edge {edge}: {got}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn where_nothing_fits_it_is_the_nearest() {
        for scale in [2, 4] {
            for at in pixels(SIZE) {
                let color = |p: UVec2| Vec3::new(noise(p, 0), noise(p, 1), noise(p, 2));
                let far = |p: UVec2| BilateralUpsampleTap {
                    position: Vec3::Z * 100.0,
                    ..tap(color(p), floor(0.0, 0.0))
                };
                let want = color(at / scale);
                let read = |p: UVec2| floor(p.x as f32, p.y as f32);
                let got = bilateral_upsample_pixel(at, SIZE / scale, scale, read, far);
                assert_eq!(got, want);
                // No surface, and values that do not count.
                let nowhere = |p: UVec2| BilateralUpsampleSurface {
                    reach: 0.0,
                    ..read(p)
                };
                let got = bilateral_upsample_pixel(at, SIZE / scale, scale, nowhere, far);
                assert_eq!(got, want);
                let nothing = |p: UVec2| BilateralUpsampleTap {
                    weight: 0.0,
                    ..tap(color(p), floor(0.0, 0.0))
                };
                let got = bilateral_upsample_pixel(at, SIZE / scale, scale, read, nothing);
                assert_eq!(got, want);
            }
        }
    }

    fn noisy(p: UVec2, scale: u32) -> BilateralUpsampleTap {
        let m = middle(p, scale);
        let mut surface = floor(m.x, m.y);
        surface.position.z = noise(p, 4) * 0.2;
        tap(
            Vec3::new(noise(p, 0), noise(p, 1), noise(p, 2)) * 10.0,
            surface,
        )
    }

    #[test]
    fn a_turned_image_gives_the_turned_result_exactly() {
        for scale in [2, 4] {
            let low_size = SIZE / scale;
            let low_mirror = |p: UVec2| low_size - 1 - p;
            let mirror = |p: UVec2| SIZE - 1 - p;
            // Heights alone decide, so that the places need no mirror.
            let read = |p: UVec2| floor(p.x as f32, p.y as f32);
            for at in pixels(SIZE) {
                let plain =
                    bilateral_upsample_pixel(at, low_size, scale, read, |p| noisy(p, scale));
                let mirrored = bilateral_upsample_pixel(mirror(at), low_size, scale, read, |p| {
                    noisy(low_mirror(p), scale)
                });
                assert_eq!(plain, mirrored, "{at}");
            }
        }
    }

    /// A bad value reaches the pixels of its own block and half of the next.
    #[test]
    fn bad_numbers_are_contained() {
        let scale = 2;
        let place = UVec2::new(7, 5);
        let read = |p: UVec2| floor(p.x as f32, p.y as f32);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
            for at in pixels(SIZE) {
                let taps = |p: UVec2| {
                    let mut tap = noisy(p, scale);
                    if p == place {
                        tap.color.y = bad;
                    }
                    tap
                };
                let got = bilateral_upsample_pixel(at, SIZE / scale, scale, read, taps);
                assert!(got.is_finite() && got.max_element() <= 1e8);
                let apart = (at.as_vec2() - middle(place, scale)).abs().max_element();
                if apart > 1.5 {
                    let plain = bilateral_upsample_pixel(at, SIZE / scale, scale, read, |p| {
                        noisy(p, scale)
                    });
                    assert_eq!(got, plain, "{bad} at {at}");
                }
            }
        }
    }

    /// A low-resolution surface that is none reaches as far as a bad value; one
    /// of full resolution only its own pixel, which takes the nearest value.
    #[test]
    fn a_bad_surface_fits_nowhere() {
        let place = UVec2::new(7, 5);
        let (low_size, scale) = (SIZE / 2, 2);
        let read = |p: UVec2| floor(p.x as f32, p.y as f32);
        let taps = |p: UVec2| noisy(p, scale);
        let without = |p: UVec2| BilateralUpsampleTap {
            weight: if p == place { 0.0 } else { 1.0 },
            ..taps(p)
        };
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            for (at, lane) in pixels(SIZE).flat_map(|at| (0..7).map(move |lane| (at, lane))) {
                let broken = |p: UVec2| {
                    let mut tap = taps(p);
                    match (p == place, lane) {
                        (true, 0..=2) => tap.position[lane] = bad,
                        (true, 3..=5) => tap.normal[lane - 3] = bad,
                        (true, _) => tap.weight = bad,
                        _ => {}
                    }
                    tap
                };
                let got = bilateral_upsample_pixel(at, low_size, scale, read, broken);
                let want = bilateral_upsample_pixel(at, low_size, scale, read, without);
                assert_eq!(got, want, "{bad}, lane {lane} at {at}");
                let apart = (at.as_vec2() - middle(place, scale)).abs().max_element();
                let plain = bilateral_upsample_pixel(at, low_size, scale, read, taps);
                assert!(apart <= 1.5 || got == plain, "{bad}, lane {lane} at {at}");
                let own = |p: UVec2| {
                    let mut surface = read(p);
                    match lane {
                        0..=2 => surface.position[lane] = bad,
                        3..=5 => surface.normal[lane - 3] = bad,
                        _ => surface.reach = bad,
                    }
                    surface
                };
                let got = bilateral_upsample_pixel(at, low_size, scale, own, taps);
                assert_eq!(got, taps(at / scale).color, "{bad}, lane {lane} at {at}");
            }
        }
    }

    /// Trap: two exponentials, one of them inside the other, weigh a farther
    /// surface more, as a well-known sample does. Ours only ever falls.
    #[test]
    fn a_farther_surface_never_weighs_more() {
        let twice = |height: f32| (-(-height).exp()).exp();
        assert!(twice(10.0) > twice(0.0));
        let mut last = 2.0;
        for i in 0..2000 {
            let offset = Vec3::new(3.0, -2.0, i as f32 * 0.005);
            let w = bilateral_upsample_weight(Vec3::Z, Vec3::Z, offset, 1.0);
            assert!(w <= last);
            last = w;
        }
        assert_eq!(last, 0.0);
    }

    /// Trap: the difference of depths takes a grazing floor for many surfaces.
    #[test]
    fn depth_differences_tear_a_grazing_floor() {
        let normal = Vec3::new(0.0, 0.05, 1.0).normalize();
        // Along the floor, which falls away in depth (here -y).
        let offset = Vec3::new(0.0, 20.0, -1.0);
        let by_depth = (-(offset.y / 0.5).powi(2)).exp();
        assert!(by_depth < 1e-6);
        let w = bilateral_upsample_weight(normal, normal, offset, 0.5);
        assert!(w > 0.999_99, "{w}");
    }

    #[test]
    fn every_exposure_changes_nothing_but_the_scale() {
        let read = |p: UVec2| floor(p.x as f32, p.y as f32);
        for (scale, at) in [2, 4]
            .into_iter()
            .flat_map(|s| pixels(SIZE).map(move |p| (s, p)))
        {
            let low_size = SIZE / scale;
            let plain = bilateral_upsample_pixel(at, low_size, scale, read, |p| noisy(p, scale));
            for power in -10..=10 {
                let k = 2f32.powi(power);
                let bright = bilateral_upsample_pixel(at, low_size, scale, read, |p| {
                    let mut tap = noisy(p, scale);
                    tap.color *= k;
                    tap
                });
                assert_eq!(bright, plain * k);
            }
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_mirrored_results() {
        let size = UVec2::splat(24);
        let flips: [fn(UVec2, u32) -> UVec2; 3] = [
            |p, n| UVec2::new(n - 1 - p.x, p.y),
            |p, n| UVec2::new(p.x, n - 1 - p.y),
            |p, _| UVec2::new(p.y, p.x),
        ];
        // Heights alone decide, so that the places need no mirror.
        let read = |p: UVec2| BilateralUpsampleSurface {
            reach: 0.1 + 0.1 * noise(p, 6),
            ..floor(0.0, 0.0)
        };
        for (flip, scale) in flips.into_iter().flat_map(|f| [(f, 2), (f, 4)]) {
            let low = size / scale;
            for at in pixels(size) {
                let a =
                    bilateral_upsample_pixel(flip(at, 24), low, scale, read, |p| noisy(p, scale));
                let b = bilateral_upsample_pixel(
                    at,
                    low,
                    scale,
                    |p| read(flip(p, 24)),
                    |p| noisy(flip(p, low.x), scale),
                );
                // Transposed, two of the taps are added in the other order: two
                // sums of five and a quotient, each twice.
                let apart = (a - b).abs().max_element();
                assert!(
                    apart <= 9.0 * f32::EPSILON * a.max_element(),
                    "{at}: {a} {b}"
                );
            }
        }
    }

    #[test]
    fn the_weights_sum_to_one() {
        // No constant shows it, as results are held between their inputs.
        let read = |p: UVec2| floor(p.x as f32, p.y as f32);
        for (at, scale) in pixels(SIZE).flat_map(|p| [(p, 2), (p, 4)]) {
            let line = |scaled: f32, more: f32| {
                bilateral_upsample_pixel(at, SIZE / scale, scale, read, |p| {
                    let mut tap = noisy(p, scale);
                    tap.color = tap.color * (0.1 * scaled) + more;
                    tap
                })
            };
            let (plain, other) = (line(1.0, 0.0), line(2.0, 3.0));
            // Two sums of five and a quotient: 12 roundings, of values below 1
            // (twice) and below 8, with what is added.
            let apart = (other - (plain * 2.0 + 3.0)).abs().max_element();
            assert!(
                apart < 13.0 * (2f32.powi(-23) + 2f32.powi(-21)),
                "{at}: {apart}"
            );
        }
    }
}
