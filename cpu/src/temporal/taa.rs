//! Temporal anti-aliasing: the history, clipped to what the pixel's neighbours
//! allow, blended with the new frame by weights that tame bright samples.
//!
//! Source: Karis, *High Quality Temporal Supersampling* (SIGGRAPH 2014): box of
//! the 3 x 3 neighbours in YCoCg, history clipped toward the box's centre,
//! weights `1/(1 + luma)`. The margin relative to the neighbours' luma, where
//! others add a constant, is ours.

use glam::{UVec2, Vec3};

use crate::math::sanitize::sanitize_vector;

/// Margin of the box over the largest luma in it, on every side. It keeps the
/// clip well-conditioned where the box is flat, as on a grey wall, and lets
/// pass what rounding in storage makes.
pub const TAA_MARGIN: f32 = 0.00390625;

/// Largest value of a channel; larger ones count as this.
pub const TAA_MAX: f32 = 1e8;

/// Linear RGB as luma, orange less blue, green less purple (YCoCg).
///
/// Error analysis: sums of three terms; `y` has terms of one sign, the others
/// are differences with the error of their largest term.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::taa::taa_ycocg;
///
/// // Grey has luma alone.
/// assert_eq!(taa_ycocg(Vec3::splat(0.5)), Vec3::new(0.5, 0.0, 0.0));
/// ```
#[inline]
#[must_use]
pub fn taa_ycocg(rgb: Vec3) -> Vec3 {
    let purple = rgb.x + rgb.z;
    let green = 2.0 * rgb.y;
    Vec3::new(
        0.25 * (purple + green),
        0.5 * (rgb.x - rgb.z),
        0.25 * (green - purple),
    )
}

/// Linear RGB from YCoCg.
///
/// Error analysis: sums of two and of three terms, with the error of the
/// largest.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::taa::{taa_rgb, taa_ycocg};
///
/// let rgb = Vec3::new(0.8, 0.5, 0.1);
/// assert!((taa_rgb(taa_ycocg(rgb)) - rgb).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn taa_rgb(ycocg: Vec3) -> Vec3 {
    let purple = ycocg.x - ycocg.z;
    Vec3::new(purple + ycocg.y, ycocg.x + ycocg.z, purple - ycocg.y)
}

/// How far along one axis the history may keep of its distance from the
/// centre: 1 inside, less outside.
#[inline(always)]
fn taa_part(away: f32, extent: f32) -> f32 {
    let size = away.abs();
    if size <= extent {
        return 1.0;
    }
    extent / size
}

/// The history (linear RGB, channels in `[0, TAA_MAX]`), moved toward the
/// centre of a box until it lies on its surface; untouched if it lies inside.
///
/// `low` and `high` are corners in YCoCg, `low <= high`, `high.x >= 0`. The box
/// is taken larger by [`TAA_MARGIN`] of `high.x` on each side, so the result is
/// the same for any exposure. Channels that would become negative are 0.
///
/// Error analysis: the distance from the centre has an absolute error of an
/// ULP or two of the largest number that enters; the part that is kept has
/// that error over the smallest extent, and moves the other axes by it times
/// their extents.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::taa::taa_clip;
///
/// // The neighbours are greys from 0.4 to 0.6.
/// let (low, high) = (Vec3::new(0.4, 0.0, 0.0), Vec3::new(0.6, 0.0, 0.0));
/// let inside = Vec3::splat(0.5);
/// assert_eq!(taa_clip(inside, low, high), inside);
/// let clipped = taa_clip(Vec3::splat(3.0), low, high);
/// assert!((clipped - Vec3::splat(0.6)).length() < 0.01);
/// ```
#[inline]
#[must_use]
pub fn taa_clip(history: Vec3, low: Vec3, high: Vec3) -> Vec3 {
    let color = taa_ycocg(history);
    let margin = TAA_MARGIN * high.x;
    let centre = Vec3::new(
        0.5 * (low.x + high.x),
        0.5 * (low.y + high.y),
        0.5 * (low.z + high.z),
    );
    let away = Vec3::new(color.x - centre.x, color.y - centre.y, color.z - centre.z);
    let x = taa_part(away.x, 0.5 * (high.x - low.x) + margin);
    let y = taa_part(away.y, 0.5 * (high.y - low.y) + margin);
    let z = taa_part(away.z, 0.5 * (high.z - low.z) + margin);
    let part = x.min(y).min(z);
    if part >= 1.0 {
        return history;
    }
    let clipped = taa_rgb(Vec3::new(
        centre.x + part * away.x,
        centre.y + part * away.y,
        centre.z + part * away.z,
    ));
    Vec3::new(clipped.x.max(0.0), clipped.y.max(0.0), clipped.z.max(0.0))
}

/// Mean of two numbers `>= 0` with weights `>= 0`, never outside them.
#[inline(always)]
fn taa_mix(a: f32, a_weight: f32, b: f32, b_weight: f32) -> f32 {
    let mixed = (a * a_weight + b * b_weight) / (a_weight + b_weight);
    mixed.max(a.min(b)).min(a.max(b))
}

/// History and new frame, blended: the new one with `alpha` in `[0, 1]`, each
/// over `1 + exposure · luma`.
///
/// Channels in `[0, TAA_MAX]`. `exposure >= 0` is what the picture will be
/// multiplied by; 0 blends without luma. An image `k` times as bright with an
/// exposure `k` times less gives a result `k` times as bright. `alpha` 1
/// selects the new frame, 0 the history: neither reaches into the other.
///
/// Bright samples count less, so the result is too dark where a pixel flickers:
/// this is for what is seen, not for radiance that is used again.
///
/// Error analysis: sums and products of numbers of one sign and one quotient.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::taa::taa_blend;
///
/// let (history, current) = (Vec3::ONE, Vec3::splat(2.0));
/// // Without exposure the plain mean; with it a bright sample counts less.
/// assert_eq!(taa_blend(history, current, 0.5, 0.0), Vec3::splat(1.5));
/// assert!(taa_blend(history, current, 0.5, 1.0).x < 1.5);
/// ```
#[inline]
#[must_use]
pub fn taa_blend(history: Vec3, current: Vec3, alpha: f32, exposure: f32) -> Vec3 {
    if alpha >= 1.0 {
        return current;
    }
    if alpha <= 0.0 {
        return history;
    }
    // The weights times both denominators.
    let old_weight = (1.0 - alpha) * (1.0 + exposure * taa_ycocg(current).x);
    let new_weight = alpha * (1.0 + exposure * taa_ycocg(history).x);
    Vec3::new(
        taa_mix(history.x, old_weight, current.x, new_weight),
        taa_mix(history.y, old_weight, current.y, new_weight),
        taa_mix(history.z, old_weight, current.z, new_weight),
    )
}

/// A colour to reckon with, or -1 for one that is not finite or negative.
#[inline(always)]
fn taa_clean(color: Vec3) -> Vec3 {
    let c = sanitize_vector(color, Vec3::splat(-1.0));
    if c.x < 0.0 || c.y < 0.0 || c.z < 0.0 {
        return Vec3::splat(-1.0);
    }
    Vec3::new(c.x.min(TAA_MAX), c.y.min(TAA_MAX), c.z.min(TAA_MAX))
}

/// A pixel of the new picture.
///
/// `history` is what the last picture has where the surface was
/// (`alpha` 1 if it has nothing); `read(at)` gives the new frame's colour and
/// is only called inside `size` (each side below 2^31). In WGSL it is a
/// function that the program defines. `alpha` and `exposure` as in
/// [`taa_blend`]; 0.1 is usual for `alpha`.
///
/// Colours that are not finite or have a negative channel count nowhere: as
/// history they mean `alpha` 1, as the pixel itself the clipped history; black
/// if there is neither.
///
/// Error analysis: that of [`taa_clip`] and [`taa_blend`].
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::temporal::taa::taa_pixel;
///
/// // What was there is gone: a bright history on a grey wall is let go at once.
/// let wall = Vec3::splat(0.5);
/// let color = taa_pixel(
///     UVec2::ONE,
///     UVec2::splat(3),
///     Vec3::splat(5.0),
///     0.1,
///     1.0,
///     |_| wall,
/// );
/// assert!((color - wall).length() < 0.01);
/// ```
#[inline]
#[must_use]
pub fn taa_pixel<R>(
    pixel: UVec2,
    size: UVec2,
    history: Vec3,
    alpha: f32,
    exposure: f32,
    read: R,
) -> Vec3
where
    R: Fn(UVec2) -> Vec3,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return Vec3::ZERO;
    }
    let old = taa_clean(history);
    let current = taa_clean(read(pixel));
    if old.x < 0.0 || alpha >= 1.0 {
        return Vec3::new(current.x.max(0.0), current.y.max(0.0), current.z.max(0.0));
    }
    let mut low = Vec3::splat(TAA_MAX);
    let mut high = Vec3::splat(-TAA_MAX);
    let mut y = pixel.y.max(1) - 1;
    while y <= (pixel.y + 1).min(size.y - 1) {
        let mut x = pixel.x.max(1) - 1;
        while x <= (pixel.x + 1).min(size.x - 1) {
            let color = taa_clean(read(UVec2::new(x, y)));
            if color.x >= 0.0 {
                let c = taa_ycocg(color);
                low = Vec3::new(low.x.min(c.x), low.y.min(c.y), low.z.min(c.z));
                high = Vec3::new(high.x.max(c.x), high.y.max(c.y), high.z.max(c.z));
            }
            x += 1;
        }
        y += 1;
    }
    // Nothing to clip to: none of the neighbours is usable.
    if high.x < 0.0 {
        return old;
    }
    let clipped = taa_clip(old, low, high);
    if current.x < 0.0 {
        return clipped;
    }
    taa_blend(clipped, current, alpha, exposure)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    const SIZE: UVec2 = UVec2::new(20, 15);

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    fn color(at: UVec2) -> Vec3 {
        Vec3::new(noise(at, 0), noise(at, 1), noise(at, 2))
    }

    fn history(at: UVec2) -> Vec3 {
        Vec3::new(noise(at, 3), noise(at, 4), noise(at, 5)) * 3.0
    }

    fn pixels() -> impl Iterator<Item = UVec2> {
        (0..SIZE.x * SIZE.y).map(|i| UVec2::new(i % SIZE.x, i / SIZE.x))
    }

    #[test]
    fn a_constant_image_stays_as_it_is() {
        for value in [0.0, 1e-30, 0.1, 3.3, 1000.1, 65000.0] {
            let color = Vec3::new(value, value * 0.7, value * 0.3);
            for at in pixels() {
                for alpha in [0.0, 0.1, 0.5, 1.0] {
                    assert_eq!(taa_pixel(at, SIZE, color, alpha, 1.0, |_| color), color);
                }
            }
        }
    }

    /// The clip leaves what is inside, puts the rest on the surface and, along
    /// the line to the centre, no further.
    #[test]
    fn the_clip_ends_on_the_box() {
        for at in pixels() {
            let (a, b) = (taa_ycocg(color(at)), taa_ycocg(color(at + 100)));
            let (low, high) = (a.min(b), a.max(b));
            let margin = TAA_MARGIN * high.x;
            let old = history(at);
            let got = taa_clip(old, low, high);
            let inside = |c: Vec3, slack: f32| {
                c.cmpge(low - margin - slack).all() && c.cmple(high + margin + slack).all()
            };
            if inside(taa_ycocg(old), -1e-6) {
                assert_eq!(got, old);
            }
            // Where no channel was cut at 0 the result lies in the box.
            if got.min_element() > 0.0 {
                assert!(inside(taa_ycocg(got), 1e-5), "{at}");
            }
        }
    }

    /// Trap: a constant margin never clips in the dark. A ghost a hundred times
    /// as bright as a dark scene has to go in any exposure.
    #[test]
    fn a_ghost_in_the_dark_goes_too() {
        for k in [1.0f32, 1e-3, 1e-6] {
            let scene = Vec3::splat(0.01 * k);
            let ghost = Vec3::splat(k);
            let got = taa_pixel(UVec2::splat(5), SIZE, ghost, 0.0, 1.0, |_| scene);
            assert!(got.max_element() < 0.0102 * k, "{k}: {got}");
        }
        // The usual form: extents and 0.001. The ghost of 1e-4 stays whole.
        let usual = |history: Vec3, low: Vec3, high: Vec3| {
            let centre = (low + high) * 0.5;
            let extent = (high - low) * 0.5 + 0.001;
            let away = taa_ycocg(history) - centre;
            let over = (away / extent).abs().max_element();
            taa_rgb(centre + away / over.max(1.0))
        };
        let dark = taa_ycocg(Vec3::splat(1e-6));
        let ghost = Vec3::splat(1e-4);
        assert!((usual(ghost, dark, dark) / ghost - 1.0).abs().max_element() < 1e-5);
        assert!(taa_clip(ghost, dark, dark).max_element() < 1.02e-6);
    }

    /// Trap: a flat box without a margin throws the whole history away for a
    /// rounding error in one channel; and 0/0 where both are 0.
    #[test]
    fn rounding_in_storage_is_not_clipped() {
        let grey = Vec3::splat(0.5);
        let stored = Vec3::new(0.5, 0.500_244, 0.5);
        let got = taa_pixel(UVec2::splat(5), SIZE, stored, 0.0, 1.0, |_| grey);
        assert_eq!(got, stored);
        let black = taa_pixel(UVec2::splat(5), SIZE, Vec3::ZERO, 0.1, 1.0, |_| Vec3::ZERO);
        assert_eq!(black, Vec3::ZERO);
        let dark = taa_pixel(UVec2::splat(5), SIZE, Vec3::ONE, 0.1, 1.0, |_| Vec3::ZERO);
        assert_eq!(dark, Vec3::ZERO);
    }

    #[test]
    fn bad_numbers_are_contained() {
        let place = UVec2::new(9, 7);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 1e30] {
            let bad_color = Vec3::new(0.5, bad, 0.5);
            let read = |at: UVec2| if at == place { bad_color } else { color(at) };
            for at in pixels() {
                let got = taa_pixel(at, SIZE, history(at), 0.1, 1.0, read);
                assert!(got.is_finite() && got.min_element() >= 0.0);
                if at.x.abs_diff(place.x).max(at.y.abs_diff(place.y)) > 1 {
                    assert_eq!(got, taa_pixel(at, SIZE, history(at), 0.1, 1.0, color));
                }
            }
            // In the history it is gone at once, or with alpha 1.
            let got = taa_pixel(place, SIZE, bad_color, 0.1, 1.0, color);
            assert!(got.is_finite() && got.max_element() < 2.0, "{bad}: {got}");
            assert_eq!(
                taa_pixel(place, SIZE, bad_color, 1.0, 1.0, color),
                color(place)
            );
            // Nothing but bad numbers.
            let got = taa_pixel(place, SIZE, bad_color, 0.1, 1.0, |_| bad_color);
            assert!(got.is_finite());
        }
    }

    /// A pixel that flickers between 0 and `v` comes out darker than its mean:
    /// the fixed point of the weighted average is a harmonic one.
    #[test]
    fn a_flickering_pixel_is_as_dark_as_the_weights_say() {
        for v in [0.1f64, 1.0, 10.0] {
            let (alpha, frames) = (0.02f32, 40_000);
            let mut state = Vec3::ZERO;
            let mut sum = 0.0;
            for i in 0..frames {
                let lit = pcg_unit(pcg_hash(i)) < 0.5;
                let new = Vec3::splat(if lit { v as f32 } else { 0.0 });
                state = taa_blend(state, new, alpha, 1.0);
                if i >= 4000 {
                    sum += f64::from(state.x);
                }
            }
            let mean = sum / f64::from(frames - 4000);
            // E[w c] / E[w] with w = 1/(1 + c) and c is 0 or v.
            let w = 1.0 / (1.0 + v);
            let want = w * v / (w + 1.0);
            println!(
                "0 or {v}: mean {mean:.4}, expected {want:.4}, true {:.4}",
                v / 2.0
            );
            assert!((mean / want - 1.0).abs() < 0.05, "{v}: {mean}, {want}");
        }
    }

    /// An edge that moves on: what the history still has is gone at once.
    #[test]
    fn a_moving_edge_leaves_no_trail() {
        let frame = |edge: u32| move |at: UVec2| Vec3::splat(if at.x < edge { 1.0 } else { 0.1 });
        for at in pixels() {
            let got = taa_pixel(at, SIZE, frame(15)(at), 0.1, 1.0, frame(5)).x;
            let want = frame(5)(at).x;
            // Beside the edge the box holds both.
            if at.x.abs_diff(5) > 1 {
                assert!((got / want - 1.0).abs() < 0.005, "{at}: {got}");
            }
        }
    }

    #[test]
    fn every_exposure_changes_nothing_but_the_scale() {
        for at in pixels() {
            let plain = taa_pixel(at, SIZE, history(at), 0.1, 1.0, color);
            for power in -10..=10 {
                let k = 2f32.powi(power);
                let bright = taa_pixel(at, SIZE, history(at) * k, 0.1, 1.0 / k, |p| color(p) * k);
                assert_eq!(plain * k, bright, "{at}, {k}");
            }
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_mirrored_results() {
        let size = UVec2::splat(16);
        let flips: [fn(UVec2) -> UVec2; 3] = [
            |p| UVec2::new(15 - p.x, p.y),
            |p| UVec2::new(p.x, 15 - p.y),
            |p| UVec2::new(p.y, p.x),
        ];
        for flip in flips {
            for at in (0..256).map(|i| UVec2::new(i % 16, i / 16)) {
                let plain = taa_pixel(flip(at), size, history(at), 0.1, 1.0, color);
                let other = taa_pixel(at, size, history(at), 0.1, 1.0, |p| color(flip(p)));
                assert_eq!(plain, other, "{at}");
            }
        }
    }

    #[test]
    fn the_weights_of_a_blend_sum_to_one() {
        // No constant shows it, as results are held between their inputs.
        for at in pixels() {
            let (old, new, alpha) = (color(at), color(at + 100), noise(at, 6));
            let plain = taa_blend(old, new, alpha, 0.0);
            let other = taa_blend(old * 2.0 + 3.0, new * 2.0 + 3.0, alpha, 0.0);
            // Five roundings, of values below 1 (twice) and below 8, with what
            // is added.
            let apart = (other - (plain * 2.0 + 3.0)).abs().max_element();
            assert!(
                apart < 6.0 * (2f32.powi(-23) + 2f32.powi(-21)),
                "{at}: {apart}"
            );
        }
    }
}
