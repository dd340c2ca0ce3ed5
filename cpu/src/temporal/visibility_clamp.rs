//! Shadow history held to the mean of 17 × 17 shadow rays, and as wide about it
//! as those rays differ.
//!
//! The wide form of [`variance_clamp`](super::variance_clamp) for a signal of
//! one ray a pixel: each ray reached the light or did not, so the mean `p` of
//! [`packed_visibility`](crate::filter::packed_visibility) says everything, and
//! the deviation is `√(p (1 - p))`.
//!
//! Source: AMD, *FidelityFX Denoiser* 1.x (shadows) for the neighbourhood and
//! half a deviation to either side; Bernoulli for the deviation. That the
//! interval ends at no light and full light, and what holds at borders, are
//! ours.

use glam::UVec2;

use crate::filter::packed_visibility::{
    packed_visibility_area, packed_visibility_mean, packed_visibility_sum,
    packed_visibility_variance, packed_visibility_vertical,
};

/// Deviations to either side of the mean that FidelityFX allows.
pub const VISIBILITY_CLAMP_GAMMA: f32 = 0.5;

/// Largest magnitude of a history; what is larger counts as a defect, as NaN
/// and infinity do.
pub const VISIBILITY_CLAMP_LARGEST: f32 = 1e15;

/// A visibility held to `gamma` deviations about the mean of its neighbourhood,
/// and to `[0, 1]`.
///
/// `mean` in `[0, 1]` and `variance >= 0` as `packed_visibility_mean` and
/// `packed_visibility_variance` give them; `gamma >= 0`,
/// [`VISIBILITY_CLAMP_GAMMA`] in use. Inside, exactly the history; outside, the
/// nearer end. Where all rays agree exactly the mean, 0 or 1. A history that is
/// no number gives the mean.
///
/// Error analysis: a root and a product, added to the mean: an ULP or two of
/// one, and exact where the variance is 0.
///
/// ```
/// use raytwin_cpu::temporal::visibility_clamp::{
///     VISIBILITY_CLAMP_GAMMA, visibility_clamp_limit,
/// };
///
/// // Half of the rays reached the light: the deviation is 1/2.
/// assert_eq!(
///     visibility_clamp_limit(1.0, 0.5, 0.25, VISIBILITY_CLAMP_GAMMA),
///     0.75
/// );
/// assert_eq!(
///     visibility_clamp_limit(0.6, 0.5, 0.25, VISIBILITY_CLAMP_GAMMA),
///     0.6
/// );
/// // All agree: no doubt is left.
/// assert_eq!(
///     visibility_clamp_limit(0.6, 0.0, 0.0, VISIBILITY_CLAMP_GAMMA),
///     0.0
/// );
/// ```
#[inline]
#[must_use]
pub fn visibility_clamp_limit(history: f32, mean: f32, variance: f32, gamma: f32) -> f32 {
    if (history.to_bits() & 0x7fff_ffff) > VISIBILITY_CLAMP_LARGEST.to_bits() {
        return mean;
    }
    let reach = gamma * variance.sqrt();
    let low = (mean - reach).max(0.0);
    let high = (mean + reach).min(1.0);
    history.max(low).min(high)
}

/// As [`visibility_clamp_limit`], from `sum` rays that reached the light among
/// `area`.
#[inline(always)]
fn visibility_clamp_counted(history: f32, sum: u32, area: u32, gamma: f32) -> f32 {
    visibility_clamp_limit(
        history,
        packed_visibility_mean(sum, area),
        packed_visibility_variance(sum, area),
        gamma,
    )
}

/// A pixel's visibility history held to the 17 × 17 rays around it.
///
/// `size` is the image's; rays outside it do not count, so a border in full
/// light stays at exactly 1. A pixel outside is lit. `gamma` as in
/// [`visibility_clamp_limit`]; `read(block)` gives a block's word, as in
/// `packed_visibility_sum`: up to 15 of them. In WGSL it is the function
/// `packed_visibility_read` that the program defines.
///
/// Error analysis: sums are exact; that of [`visibility_clamp_limit`].
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::temporal::visibility_clamp::{
///     VISIBILITY_CLAMP_GAMMA, visibility_clamp_pixel,
/// };
///
/// // Every ray around is dark, so a history of light is over.
/// let size = UVec2::new(64, 32);
/// let held = visibility_clamp_pixel(
///     UVec2::new(20, 15),
///     size,
///     0.8,
///     VISIBILITY_CLAMP_GAMMA,
///     |_| 0,
/// );
/// assert_eq!(held, 0.0);
/// ```
#[inline]
#[must_use]
pub fn visibility_clamp_pixel<R>(
    pixel: UVec2,
    size: UVec2,
    history: f32,
    gamma: f32,
    read: R,
) -> f32
where
    R: Fn(UVec2) -> u32,
{
    let sum = packed_visibility_sum(pixel, size, read);
    visibility_clamp_counted(history, sum, packed_visibility_area(pixel, size), gamma)
}

/// The same as second of two passes, the same bits: `read_row(pixel)` gives
/// what `packed_visibility_horizontal` gave. In WGSL it is the function
/// `packed_visibility_read_row` that the program defines.
///
/// Error analysis: as [`visibility_clamp_pixel`].
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::packed_visibility::packed_visibility_horizontal;
/// use raytwin_cpu::temporal::visibility_clamp::{
///     visibility_clamp_pixel, visibility_clamp_rows_pixel,
/// };
///
/// let (pixel, size) = (UVec2::new(20, 15), UVec2::new(64, 32));
/// let read = |block: UVec2| 0x1234_5678 ^ block.x;
/// let row = |at: UVec2| packed_visibility_horizontal(at, size, read);
/// let two_passes = visibility_clamp_rows_pixel(pixel, size, 1.0, 0.5, row);
/// assert_eq!(two_passes, visibility_clamp_pixel(pixel, size, 1.0, 0.5, read));
/// ```
#[inline]
#[must_use]
pub fn visibility_clamp_rows_pixel<R>(
    pixel: UVec2,
    size: UVec2,
    history: f32,
    gamma: f32,
    read_row: R,
) -> f32
where
    R: Fn(UVec2) -> u32,
{
    let sum = packed_visibility_vertical(pixel, size, read_row);
    visibility_clamp_counted(history, sum, packed_visibility_area(pixel, size), gamma)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::packed_visibility::{
        PackedVisibilityRays, packed_visibility_horizontal, packed_visibility_pack,
    };
    use crate::random::pcg::{pcg_hash, pcg_unit};

    const SIZE: UVec2 = UVec2::new(45, 30);
    const GAMMAS: [f32; 5] = [0.0, 0.5, 1.0, 3.0, 1e9];

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    /// A ray past a soft edge.
    fn ray(at: UVec2) -> bool {
        noise(at, 0) < (at.x as f32 - 10.0) / 20.0
    }

    /// Words of an image whose bits beyond it are `beyond`, and how to read
    /// them.
    fn packed(size: UVec2, ray: impl Fn(UVec2) -> bool, beyond: bool) -> impl Fn(UVec2) -> u32 {
        let blocks = UVec2::new(size.x.div_ceil(8), size.y.div_ceil(4));
        let words: Vec<u32> = (0..blocks.x * blocks.y)
            .map(|i| {
                let start = UVec2::new(i % blocks.x * 8, i / blocks.x * 4);
                packed_visibility_pack(PackedVisibilityRays {
                    visible: std::array::from_fn(|k| {
                        let at = start + UVec2::new(k as u32 % 8, k as u32 / 8);
                        let inside = at.cmplt(size).all();
                        u32::from(if inside { ray(at) } else { beyond })
                    }),
                })
            })
            .collect();
        move |block| {
            assert!(block.cmplt(blocks).all(), "{block} is outside");
            words[(block.y * blocks.x + block.x) as usize]
        }
    }

    fn everywhere(size: UVec2) -> impl Iterator<Item = UVec2> {
        (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
    }

    #[test]
    fn a_constant_image_comes_out_exactly() {
        for size in [SIZE, UVec2::ONE, UVec2::new(8, 4), UVec2::new(3, 70)] {
            for lit in [false, true] {
                let read = packed(size, |_| lit, !lit);
                let value = f32::from(u8::from(lit));
                for at in everywhere(size) {
                    for gamma in GAMMAS {
                        for history in [0.0, 1.0, 0.5, -3.0, 7.0, f32::NAN, f32::INFINITY] {
                            let got = visibility_clamp_pixel(at, size, history, gamma, &read);
                            assert_eq!(got, value, "{at} of {size}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn both_forms_agree_and_hold_the_history() {
        for beyond in [false, true] {
            let read = packed(SIZE, ray, beyond);
            let rows: Vec<u32> = everywhere(SIZE)
                .map(|at| packed_visibility_horizontal(at, SIZE, &read))
                .collect();
            for at in everywhere(SIZE) {
                // By hand, from the rays themselves.
                let near: Vec<f64> = everywhere(SIZE)
                    .filter(|p| p.x.abs_diff(at.x) <= 8 && p.y.abs_diff(at.y) <= 8)
                    .map(|p| f64::from(u8::from(ray(p))))
                    .collect();
                let n = near.len() as f64;
                let mean = near.iter().sum::<f64>() / n;
                let deviation = (near.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
                for gamma in GAMMAS {
                    let history = 1.4 * noise(at, 1) - 0.2;
                    let got = visibility_clamp_pixel(at, SIZE, history, gamma, &read);
                    let again = visibility_clamp_rows_pixel(at, SIZE, history, gamma, |p| {
                        rows[(p.y * SIZE.x + p.x) as usize]
                    });
                    assert_eq!(got.to_bits(), again.to_bits());
                    let low = (mean - f64::from(gamma) * deviation).max(0.0);
                    let high = (mean + f64::from(gamma) * deviation).min(1.0);
                    let want = f64::from(history).clamp(low, high);
                    assert!((f64::from(got) - want).abs() < 1e-6, "{at}: {got} {want}");
                    if f64::from(history) > low + 1e-6 && f64::from(history) < high - 1e-6 {
                        assert_eq!(got, history);
                    }
                }
            }
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_the_same() {
        let turned = UVec2::new(SIZE.y, SIZE.x);
        let mirror = |at: UVec2| UVec2::new(SIZE.x - 1 - at.x, SIZE.y - 1 - at.y);
        let read = packed(SIZE, ray, true);
        let mirrored = packed(SIZE, |at| ray(mirror(at)), false);
        let transposed = packed(turned, |at| ray(UVec2::new(at.y, at.x)), false);
        for at in everywhere(SIZE) {
            let history = noise(at, 1);
            let got = visibility_clamp_pixel(at, SIZE, history, 0.5, &read);
            for other in [
                visibility_clamp_pixel(mirror(at), SIZE, history, 0.5, &mirrored),
                visibility_clamp_pixel(UVec2::new(at.y, at.x), turned, history, 0.5, &transposed),
            ] {
                assert_eq!(got.to_bits(), other.to_bits());
            }
        }
    }

    #[test]
    fn what_is_no_number_gives_the_mean_and_nothing_is_read_outside() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            assert_eq!(visibility_clamp_limit(bad, 0.25, 0.1875, 0.5), 0.25);
        }
        let none = |_: UVec2| -> u32 { panic!("a word was read") };
        for (at, size) in [
            (UVec2::ZERO, UVec2::ZERO),
            (SIZE, SIZE),
            (UVec2::splat(u32::MAX), SIZE),
        ] {
            assert_eq!(visibility_clamp_pixel(at, size, 0.3, 0.5, none), 1.0);
            assert_eq!(visibility_clamp_rows_pixel(at, size, 0.3, 0.5, none), 1.0);
        }
    }

    /// Trap: rays outside counted as dark, the sum divided by 289 all the same.
    #[test]
    fn rays_outside_that_count_darken_the_border() {
        let read = packed(SIZE, |_| true, true);
        let naive = |at: UVec2, history: f32| {
            let mean = packed_visibility_sum(at, SIZE, &read) as f32 / 289.0;
            visibility_clamp_limit(history, mean, mean * (1.0 - mean), 0.5)
        };
        assert!(naive(UVec2::ZERO, 1.0) < 0.51);
        let dark = everywhere(SIZE).filter(|at| naive(*at, 1.0) < 1.0).count();
        println!("{dark} of {} pixels in full light darken", SIZE.x * SIZE.y);
        assert!(dark > 600);
        for at in everywhere(SIZE) {
            assert_eq!(visibility_clamp_pixel(at, SIZE, 1.0, 0.5, &read), 1.0);
        }
    }

    /// Trap: a mean added up from parts of 1/289 is not 1, and its variance,
    /// as the mean of squares less the squared mean, not 0.
    #[test]
    fn a_mean_in_floating_point_finds_noise_in_full_light() {
        let (mut mean, mut squares) = (0f32, 0f32);
        for _ in 0..289 {
            mean += 1.0 / 289.0;
            squares += 1.0 / 289.0;
        }
        assert_ne!(mean, 1.0);
        let variance = (squares - mean * mean).abs();
        let kept = mean - 0.4 * variance.sqrt();
        println!("289 parts of 1/289: mean {mean:?}, variance {variance:e}, keeps {kept}");
        assert!(variance > 0.0 && kept < 1.0);
        assert_eq!(visibility_clamp_limit(kept, mean, variance, 0.5), kept);
        // Counted, the same light leaves nothing open.
        let (mean, variance) = (
            packed_visibility_mean(289, 289),
            packed_visibility_variance(289, 289),
        );
        assert_eq!(visibility_clamp_limit(kept, mean, variance, 0.5), 1.0);
    }

    /// Trap: half a deviation about a mean near 0 reaches below it.
    #[test]
    fn an_interval_that_ends_nowhere_lets_light_be_negative() {
        let mean = packed_visibility_mean(1, 289);
        let variance = packed_visibility_variance(1, 289);
        let naive = (-1f32).max(mean - 0.5 * variance.sqrt());
        assert!(naive < -0.02);
        assert_eq!(visibility_clamp_limit(-1.0, mean, variance, 0.5), 0.0);
    }

    /// An exponential average behind a shadow edge that jumps.
    #[test]
    fn a_ghost_is_gone_at_once_and_a_penumbra_stays() {
        let at = UVec2::new(22, 15);
        let run = |clamped: bool, light: &dyn Fn(u32) -> f32| {
            let (mut mean, mut half, mut squares) = (light(0), 0, 0f64);
            for frame in 1..400 {
                let ray = |p: UVec2| noise(p, 10 + frame) < light(frame);
                if clamped {
                    let read = packed(SIZE, ray, false);
                    mean = visibility_clamp_pixel(at, SIZE, mean, 0.5, read);
                }
                mean += 0.05 * (f32::from(u8::from(ray(at))) - mean);
                if half == 0 && mean < 0.5 {
                    half = frame;
                }
                if frame >= 100 {
                    squares += f64::from(mean - light(frame)).powi(2);
                }
            }
            (half, (squares / 300.0).sqrt())
        };
        let step = |frame| if frame == 0 { 1.0 } else { 0.0 };
        let ((without, _), (with, _)) = (run(false, &step), run(true, &step));
        let half_shadow = |_| 0.5;
        let ((_, plain), (_, left)) = (run(false, &half_shadow), run(true, &half_shadow));
        println!("half-life {without} frames, clamped {with}; noise {plain:.4}, clamped {left:.4}");
        assert!(without >= 12 && with == 1);
        assert!(left <= plain && plain < 0.1);
    }
}
