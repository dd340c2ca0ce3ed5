//! Full-resolution reflections from half-resolution rays: each pixel gathers
//! its neighbours' hits and weighs them by its own BRDF over the hit's density.
//!
//! The result is the ratio estimator `Σ w L / Σ w` with `w = f cos / pdf`, that
//! is the mean radiance under the pixel's own lobe, `∫ L f cos / ∫ f cos`. The
//! pixel's reflected radiance is that times its albedo `∫ f cos`, which a table
//! or a fit gives without noise. A ratio of two estimates is biased by `O(1/n)`;
//! it is exact where the radiance is constant.
//!
//! Source: Deligiannis, Schmid and Uludag, *Hybrid Rendering for Real-Time Ray
//! Tracing* (Ray Tracing Gems, chapter 25); Stachowiak, *Stochastic
//! Screen-Space Reflections* (2015); Heitz, Hill and McGuire, *Combining
//! Analytic Direct Illumination and Stochastic Shadows* (2018) for the ratio;
//! West, *Updating Mean and Variance Estimates* (1979) for the moments.

use glam::{UVec2, Vec2, Vec3};

use crate::math::trig::sincos_turn;
use crate::math::vector::vec3_dot;

/// Most neighbours that a pixel gathers, its own hit included.
pub const SPATIAL_RECONSTRUCT_MAX: u32 = 16;

/// Largest weight of one hit; larger ratios count as this.
pub const SPATIAL_RECONSTRUCT_WEIGHT_MAX: f32 = 1e9;

/// Smallest weight of one hit; smaller ratios count as zero.
pub const SPATIAL_RECONSTRUCT_WEIGHT_MIN: f32 = 1e-9;

/// Golden ratio less one, in units of 2^-32.
const GOLDEN: u32 = 2_654_435_769;

/// Bits of infinity, and of 2^60, from where on a channel is none.
const INFINITY_BITS: u32 = 0x7f80_0000;
const RADIANCE_BITS: u32 = 0x5d80_0000;

/// A half-resolution hit.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::{
///     SpatialReconstructHit, spatial_reconstruct_usable,
/// };
///
/// let hit = SpatialReconstructHit {
///     position: Vec3::ZERO,
///     pdf: 0.5,
///     radiance: Vec3::ONE,
/// };
/// assert_eq!(spatial_reconstruct_usable(1.0, hit.pdf, hit.radiance), 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SpatialReconstructHit {
    /// Where the ray hit, in the world; for a miss a point far along the ray.
    pub position: Vec3,
    /// Density with which the ray's direction was drawn, per steradian; 0 for
    /// no ray.
    pub pdf: f32,
    /// Radiance that comes back along the ray, not weighted by anything.
    pub radiance: Vec3,
}

/// What has been gathered so far; starts as [`SPATIAL_RECONSTRUCT_EMPTY`].
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::{
///     SPATIAL_RECONSTRUCT_EMPTY, spatial_reconstruct_add,
/// };
///
/// let state =
///     spatial_reconstruct_add(SPATIAL_RECONSTRUCT_EMPTY, 1.0, 0.5, Vec3::ONE);
/// assert_eq!((state.color, state.weight), (Vec3::ONE, 2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SpatialReconstructState {
    /// Weighted mean radiance.
    pub color: Vec3,
    /// Sum of the weights.
    pub weight: f32,
    /// Sum of the squared weights.
    pub squares: f32,
    /// Sum of the products of the weights of all pairs.
    pub pairs: f32,
    /// Weighted sum of squared distances from the mean, see
    /// [`spatial_reconstruct_finish`].
    pub spread: f32,
}

/// Nothing gathered.
pub const SPATIAL_RECONSTRUCT_EMPTY: SpatialReconstructState = SpatialReconstructState {
    color: Vec3::ZERO,
    weight: 0.0,
    squares: 0.0,
    pairs: 0.0,
    spread: 0.0,
};

/// A pixel's reconstructed value.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::{
///     SPATIAL_RECONSTRUCT_EMPTY, spatial_reconstruct_finish,
/// };
///
/// // Nothing was gathered: the centre's own value.
/// let result = spatial_reconstruct_finish(SPATIAL_RECONSTRUCT_EMPTY, Vec3::ONE);
/// assert_eq!((result.color, result.samples), (Vec3::ONE, 0.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SpatialReconstruction {
    /// Mean radiance under the pixel's lobe.
    pub color: Vec3,
    /// Estimated variance of `color`, see [`spatial_reconstruct_finish`].
    pub variance: f32,
    /// How many hits of equal weight would count as much; 0 for none.
    pub samples: f32,
}

/// Squared length of a colour difference, channels weighted as in luminance:
/// a sum of terms of one sign, so it never cancels.
#[inline(always)]
fn spatial_reconstruct_square(color: Vec3) -> f32 {
    (0.2126 * (color.x * color.x) + 0.7152 * (color.y * color.y)) + 0.0722 * (color.z * color.z)
}

/// Weighted mean of two numbers `>= 0`, never outside them.
#[inline(always)]
fn spatial_reconstruct_mix(a: f32, a_weight: f32, b: f32, b_weight: f32, total: f32) -> f32 {
    let mixed = (a * a_weight + b * b_weight) / total;
    mixed.max(a.min(b)).min(a.max(b))
}

/// Where the neighbour `index` lies, in half-resolution pixels from the
/// pixel's own; round each component to the nearest integer.
///
/// Neighbour 0 is the pixel's own. The others lie on a spiral of golden-angle
/// steps, at distance `√index`: one in each π pixels, so any first few of them
/// cover a disc evenly, and no two of the first 16 round to one pixel, whatever
/// the turn. `turn` in `[0, 1)` rotates all of them and should differ from
/// pixel to pixel.
///
/// Source: Vogel, *A Better Way to Construct the Sunflower Head* (1979).
///
/// Error analysis: the spiral's angle is kept in 2^-32 turns, so it errs by
/// 2^-24 turns for any index; adding `turn` rounds by half as much again. That
/// is 6e-7 of the distance, and most of the bound.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::filter::spatial_reconstruct::spatial_reconstruct_offset;
///
/// assert_eq!(spatial_reconstruct_offset(0, 0.3), Vec2::ZERO);
/// let ninth = spatial_reconstruct_offset(9, 0.3);
/// assert!((ninth.length() - 3.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_offset(index: u32, turn: f32) -> Vec2 {
    let angle = (index.wrapping_mul(GOLDEN) >> 8) as f32 * 5.9604645e-8 + turn;
    let around = sincos_turn(angle);
    let r = (index as f32).sqrt();
    Vec2::new(r * around.y, r * around.x)
}

/// How far a neighbour's surface may stand in for the pixel's: from 1 (the
/// same plane) to 0.
///
/// `offset` is the neighbour's position less the pixel's, `reach` (above 0, in
/// units of the world) the distance from the pixel's plane at which the weight
/// becomes 0; normals are unit vectors. Multiply it into the BRDF's weight.
///
/// Error analysis: the distance from the plane is a dot product that may
/// cancel: its error is that of `|offset|/reach`. The rest is products.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::spatial_reconstruct_edge;
///
/// // On the same plane all, one reach above it nothing.
/// let along = spatial_reconstruct_edge(Vec3::Y, Vec3::Y, Vec3::X, 0.1);
/// let above = spatial_reconstruct_edge(Vec3::Y, Vec3::Y, 0.1 * Vec3::Y, 0.1);
/// assert_eq!((along, above), (1.0, 0.0));
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_edge(normal: Vec3, other_normal: Vec3, offset: Vec3, reach: f32) -> f32 {
    let plane = vec3_dot(normal, offset).abs();
    if plane >= reach {
        return 0.0;
    }
    let c = vec3_dot(normal, other_normal).clamp(0.0, 1.0);
    let c_2 = c * c;
    let c_4 = c_2 * c_2;
    (c_4 * c_4) * (1.0 - plane / reach)
}

/// 1 if weight and density are numbers and every channel is one of magnitude
/// below 2^60, else 0: NaN, infinity and what squares to infinity say nothing.
/// Compares bit patterns. Exact.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::spatial_reconstruct_usable;
///
/// assert_eq!(spatial_reconstruct_usable(1.0, 0.5, Vec3::ONE), 1);
/// assert_eq!(spatial_reconstruct_usable(1.0, 0.5, Vec3::splat(f32::NAN)), 0);
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_usable(weight: f32, pdf: f32, radiance: Vec3) -> u32 {
    u32::from((weight.to_bits() & 0x7fff_ffff) < INFINITY_BITS)
        & u32::from((pdf.to_bits() & 0x7fff_ffff) < INFINITY_BITS)
        & u32::from((radiance.x.to_bits() & 0x7fff_ffff) < RADIANCE_BITS)
        & u32::from((radiance.y.to_bits() & 0x7fff_ffff) < RADIANCE_BITS)
        & u32::from((radiance.z.to_bits() & 0x7fff_ffff) < RADIANCE_BITS)
}

/// The weight of a hit: the pixel's `f cos` for its direction over the density
/// with which it was drawn.
///
/// 0 if either is not above 0, or the ratio below
/// [`SPATIAL_RECONSTRUCT_WEIGHT_MIN`]; at most
/// [`SPATIAL_RECONSTRUCT_WEIGHT_MAX`]. `pdf <= 1e20`.
///
/// Error analysis: one quotient, or a constant.
///
/// ```
/// use raytwin_cpu::filter::spatial_reconstruct::spatial_reconstruct_ratio;
///
/// assert_eq!(spatial_reconstruct_ratio(1.0, 0.5), 2.0);
/// // Density 0 means no ray.
/// assert_eq!(spatial_reconstruct_ratio(1.0, 0.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_ratio(weight: f32, pdf: f32) -> f32 {
    if weight <= 0.0 || pdf <= 0.0 {
        return 0.0;
    }
    // Compared before dividing, so that nothing overflows or underflows.
    if weight >= SPATIAL_RECONSTRUCT_WEIGHT_MAX * pdf {
        return SPATIAL_RECONSTRUCT_WEIGHT_MAX;
    }
    if weight < SPATIAL_RECONSTRUCT_WEIGHT_MIN * pdf {
        return 0.0;
    }
    weight / pdf
}

/// Adds a hit: `weight` is the pixel's own `f cos` for its direction, times
/// any edge weight; `radiance` has components in `[0, 1e8]`.
///
/// A hit without weight leaves the state as it was.
///
/// Error analysis: every sum has terms of one sign (the mean too, as weights
/// and radiance are `>= 0`), so each member gains a few ULP and nothing
/// cancels; the mean is clamped between what it was and the hit.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::{
///     SPATIAL_RECONSTRUCT_EMPTY, spatial_reconstruct_add,
/// };
///
/// let one =
///     spatial_reconstruct_add(SPATIAL_RECONSTRUCT_EMPTY, 1.0, 0.5, Vec3::ONE);
/// let two = spatial_reconstruct_add(one, 1.0, 0.5, Vec3::ZERO);
/// // Two hits of equal weight: their mean.
/// assert_eq!(two.color, Vec3::splat(0.5));
/// // One without weight changes nothing.
/// assert_eq!(spatial_reconstruct_add(two, 0.0, 0.5, Vec3::ONE), two);
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_add(
    state: SpatialReconstructState,
    weight: f32,
    pdf: f32,
    radiance: Vec3,
) -> SpatialReconstructState {
    let w = spatial_reconstruct_ratio(weight, pdf);
    if w <= 0.0 {
        return state;
    }
    if state.weight <= 0.0 {
        return SpatialReconstructState {
            color: radiance,
            weight: w,
            squares: w * w,
            pairs: 0.0,
            spread: 0.0,
        };
    }
    let before = state.weight;
    let total = before + w;
    let cross = before * w;
    let old = state.color;
    let away = Vec3::new(radiance.x - old.x, radiance.y - old.y, radiance.z - old.z);
    SpatialReconstructState {
        color: Vec3::new(
            spatial_reconstruct_mix(old.x, before, radiance.x, w, total),
            spatial_reconstruct_mix(old.y, before, radiance.y, w, total),
            spatial_reconstruct_mix(old.z, before, radiance.z, w, total),
        ),
        weight: total,
        squares: state.squares + w * w,
        pairs: state.pairs + cross,
        spread: state.spread + (cross / total) * spatial_reconstruct_square(away),
    }
}

/// The result, or `centre` if no hit had any weight.
///
/// `variance` is that of the mean, from the differences between hits: the
/// unbiased variance of weighted samples, over their effective number. It is
/// squared radiance, with the channels weighted as in luminance (for grey it
/// is the variance of the luminance). One hit alone says nothing about its
/// error: the variance is then taken as the square of the value itself, as
/// noisy as can be.
///
/// Error analysis: products and quotients of positive numbers. The sum over
/// pairs stands for `(Σw)² - Σw²`, which would cancel.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::spatial_reconstruct::{
///     SPATIAL_RECONSTRUCT_EMPTY, spatial_reconstruct_add,
///     spatial_reconstruct_finish,
/// };
///
/// let mut state = SPATIAL_RECONSTRUCT_EMPTY;
/// for radiance in [1.0, 3.0] {
///     state = spatial_reconstruct_add(state, 1.0, 0.5, Vec3::splat(radiance));
/// }
/// let result = spatial_reconstruct_finish(state, Vec3::ZERO);
/// // Two samples of variance 2, so their mean has variance 1.
/// assert_eq!((result.color.x, result.samples), (2.0, 2.0));
/// assert!((result.variance - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_finish(
    state: SpatialReconstructState,
    centre: Vec3,
) -> SpatialReconstruction {
    if state.weight <= 0.0 {
        return SpatialReconstruction {
            color: centre,
            variance: spatial_reconstruct_square(centre),
            samples: 0.0,
        };
    }
    if state.pairs <= 0.0 {
        return SpatialReconstruction {
            color: state.color,
            variance: spatial_reconstruct_square(state.color),
            samples: 1.0,
        };
    }
    SpatialReconstruction {
        color: state.color,
        variance: (state.spread / state.weight) * (state.squares / (2.0 * state.pairs)),
        samples: ((state.weight * state.weight) / state.squares).max(1.0),
    }
}

/// A full-resolution pixel from `count` half-resolution hits around it.
///
/// `size` is that of the half-resolution image (each side below 2^30), `count`
/// 1, 4, 8 or 16 (any number to [`SPATIAL_RECONSTRUCT_MAX`] works; the first is
/// the pixel's own), `turn` in `[0, 1)` rotates the pattern. `read_hit(at)`
/// gives the hit of a half-resolution pixel, always inside `size`;
/// `weight(pixel, at, hit)` the pixel's `f cos` toward that hit, times any edge
/// weight ([`spatial_reconstruct_edge`]). Without any weight the result is the
/// own hit's radiance. A hit that is none ([`spatial_reconstruct_usable`])
/// counts nowhere.
///
/// In WGSL the two callbacks are functions that the program defines.
///
/// Error analysis: [`spatial_reconstruct_add`] `count` times. Its mean is a
/// convex combination, so the errors of the steps add: 4 ULP a step on the
/// CPU. The distances that the spread is made of are differences from a mean
/// with that error, so its error is absolute: that of the radiance squared.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::spatial_reconstruct::{
///     SpatialReconstructHit, spatial_reconstruct_pixel,
/// };
///
/// // Rays of different density that all saw the same: no noise is left.
/// let hit = |at: UVec2| SpatialReconstructHit {
///     position: Vec3::ZERO,
///     pdf: 0.1 + at.x as f32,
///     radiance: Vec3::splat(3.0),
/// };
/// let brdf = |_: UVec2, at: UVec2, _: SpatialReconstructHit| 0.1 + at.y as f32;
/// let result = spatial_reconstruct_pixel(
///     UVec2::splat(8),
///     UVec2::splat(8),
///     8,
///     0.3,
///     hit,
///     brdf,
/// );
/// assert_eq!((result.color, result.variance), (Vec3::splat(3.0), 0.0));
/// ```
#[inline]
#[must_use]
pub fn spatial_reconstruct_pixel<R, W>(
    pixel: UVec2,
    size: UVec2,
    count: u32,
    turn: f32,
    read_hit: R,
    weight: W,
) -> SpatialReconstruction
where
    R: Fn(UVec2) -> SpatialReconstructHit,
    W: Fn(UVec2, UVec2, SpatialReconstructHit) -> f32,
{
    let mut state = SPATIAL_RECONSTRUCT_EMPTY;
    if size.x == 0 || size.y == 0 {
        return spatial_reconstruct_finish(state, Vec3::ZERO);
    }
    let own = UVec2::new((pixel.x / 2).min(size.x - 1), (pixel.y / 2).min(size.y - 1));
    let centre = read_hit(own);
    let own_weight = weight(pixel, own, centre);
    if spatial_reconstruct_usable(own_weight, centre.pdf, centre.radiance) != 0 {
        state = spatial_reconstruct_add(state, own_weight, centre.pdf, centre.radiance);
    }
    let end = count.min(SPATIAL_RECONSTRUCT_MAX);
    let mut i = 1;
    while i < end {
        let offset = spatial_reconstruct_offset(i, turn);
        let x = own.x as i32 + (offset.x + 0.5).floor() as i32;
        let y = own.y as i32 + (offset.y + 0.5).floor() as i32;
        i += 1;
        if x < 0 || y < 0 || x >= size.x as i32 || y >= size.y as i32 {
            continue;
        }
        let at = UVec2::new(x as u32, y as u32);
        let hit = read_hit(at);
        let hit_weight = weight(pixel, at, hit);
        if spatial_reconstruct_usable(hit_weight, hit.pdf, hit.radiance) != 0 {
            state = spatial_reconstruct_add(state, hit_weight, hit.pdf, hit.radiance);
        }
    }
    let mut fallback = centre.radiance;
    if spatial_reconstruct_usable(0.0, 0.0, fallback) == 0 {
        fallback = Vec3::ZERO;
    }
    spatial_reconstruct_finish(state, fallback)
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

    fn hit(radiance: Vec3, pdf: f32) -> SpatialReconstructHit {
        SpatialReconstructHit {
            position: Vec3::ZERO,
            pdf,
            radiance,
        }
    }

    #[test]
    fn neighbours_are_different_pixels_at_any_turn() {
        for turn in 0..4096 {
            let turn = turn as f32 / 4096.0;
            let mut seen: Vec<_> = (0..SPATIAL_RECONSTRUCT_MAX)
                .map(|i| {
                    let o = spatial_reconstruct_offset(i, turn) + 0.5;
                    (o.x.floor() as i32, o.y.floor() as i32)
                })
                .collect();
            assert_eq!(seen[0], (0, 0));
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), 16, "turn {turn}");
        }
    }

    #[test]
    fn a_constant_image_stays_as_it_is() {
        let mut next = numbers(1);
        for count in [1, 4, 8, 16] {
            for value in [0.0, 1e-30, 0.1, 3.3, 1000.1, 1e4] {
                let color = Vec3::new(value, value * 0.7, value * 0.3);
                for _ in 0..200 {
                    let (a, b, turn) = (next(), next(), next());
                    let result = spatial_reconstruct_pixel(
                        UVec2::new((a * 32.0) as u32, (b * 32.0) as u32),
                        UVec2::splat(16),
                        count,
                        turn,
                        |at| hit(color, 0.01 + (at.x * 7 + at.y * 3) as f32),
                        |p, at, _| ((p.x + at.x * 5 + at.y) % 11) as f32 * a,
                    );
                    assert_eq!(result.color, color);
                    if result.samples > 1.0 {
                        assert_eq!(result.variance, 0.0);
                    }
                }
            }
        }
    }

    #[test]
    fn the_result_lies_between_its_inputs_and_is_finite() {
        let mut next = numbers(2);
        for _ in 0..20_000 {
            let mut state = SPATIAL_RECONSTRUCT_EMPTY;
            let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::ZERO);
            for _ in 0..16 {
                // Black, ordinary, and 1e4 nits; weights and densities over
                // sixty powers of ten, or zero.
                let mut number = |zero: f32, power: f32| {
                    let (a, b) = (next(), next());
                    if a < zero {
                        0.0
                    } else {
                        10f32.powf((b - 0.5) * power)
                    }
                };
                let color = Vec3::new(number(0.2, 8.0), number(0.2, 8.0), number(0.2, 8.0));
                let (weight, pdf) = (number(0.2, 60.0), number(0.2, 40.0));
                if spatial_reconstruct_ratio(weight, pdf) > 0.0 {
                    low = low.min(color);
                    high = high.max(color);
                }
                state = spatial_reconstruct_add(state, weight, pdf, color);
            }
            let r = spatial_reconstruct_finish(state, Vec3::ONE);
            assert!(r.color.is_finite() && r.variance.is_finite() && r.variance >= 0.0);
            assert!((0.0..=16.001).contains(&r.samples));
            if r.samples > 0.0 {
                assert!(r.color.cmpge(low).all() && r.color.cmple(high).all());
            } else {
                assert_eq!(r.color, Vec3::ONE);
            }
        }
    }

    #[test]
    fn without_any_weight_the_centre_stays() {
        let own = Vec3::new(0.25, 1e4, 0.0);
        let read = |pdf: f32| {
            move |at: UVec2| {
                let mine = at == UVec2::new(3, 3);
                hit(if mine { own } else { Vec3::ONE }, pdf)
            }
        };
        let at = |pdf, weight: f32| {
            spatial_reconstruct_pixel(
                UVec2::new(6, 7),
                UVec2::splat(8),
                16,
                0.2,
                read(pdf),
                |_, _, _| weight,
            )
        };
        for (pdf, weight) in [(1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (-1.0, 1.0), (1.0, -1.0)] {
            let r = at(pdf, weight);
            assert_eq!((r.color, r.samples), (own, 0.0));
        }
        assert_ne!(at(1.0, 1.0).color, own);
        // Every neighbour off the screen: the one pixel is all there is.
        let alone = spatial_reconstruct_pixel(
            UVec2::new(1, 0),
            UVec2::ONE,
            16,
            0.2,
            |_| hit(own, 0.3),
            |_, _, _| 2.0,
        );
        assert_eq!((alone.color, alone.samples), (own, 1.0));
    }

    /// `n` samples of density `2x` estimate the mean of `L` under `f`:
    /// the average of many estimates.
    fn average(n: u32, runs: u32, seed: u32) -> (f64, f64, f64) {
        let mut next = numbers(seed);
        let (mut mean, mut square, mut variance) = (0.0, 0.0, 0.0);
        for _ in 0..runs {
            let mut state = SPATIAL_RECONSTRUCT_EMPTY;
            for _ in 0..n {
                // Density 2x: never zero where it matters, far from f.
                let x = (1.0 - next()).sqrt();
                let f = (1.0 - x) * x;
                state = spatial_reconstruct_add(state, f, 2.0 * x, Vec3::splat(x * x));
            }
            let r = spatial_reconstruct_finish(state, Vec3::ZERO);
            mean += f64::from(r.color.x);
            square += f64::from(r.color.x).powi(2);
            variance += f64::from(r.variance);
        }
        let runs = f64::from(runs);
        mean /= runs;
        (mean, square / runs - mean * mean, variance / runs)
    }

    // The integral of x²·x(1-x) over that of x(1-x): (1/20) / (1/6).
    const EXACT: f64 = 0.3;

    #[test]
    fn converges_to_the_integral() {
        let mut errors = Vec::new();
        for n in [64, 1024, 16_384, 262_144] {
            let (mean, variance, _) = average(n, 64, 77);
            let error = (mean - EXACT).abs();
            let noise = (variance / 64.0).sqrt();
            // Bias of order 1/n, and four standard errors.
            assert!(error < 0.2 / f64::from(n) + 4.0 * noise, "{n}: {error}");
            errors.push(error);
        }
        assert!(errors[3] < 2e-4, "{errors:?}");
    }

    #[test]
    fn the_ratio_is_biased_by_one_over_n() {
        let runs = 1 << 19;
        let bias = [4, 8, 16].map(|n| average(n, runs, n).0 - EXACT);
        println!("bias with 4, 8, 16 samples: {bias:?}");
        // Measured above its noise, and halved by twice the samples.
        assert!(bias[0].abs() > 1e-3, "{bias:?}");
        for pair in bias.windows(2) {
            let fall = pair[1] / pair[0];
            assert!((0.35..0.65).contains(&fall), "{bias:?}");
        }
    }

    #[test]
    fn the_variance_is_that_of_the_result() {
        for n in [4, 8, 16, 64] {
            let (_, real, estimate) = average(n, 1 << 16, 3 * n + 1);
            let ratio = estimate / real;
            println!("{n} samples: estimated over real variance {ratio:.3}");
            assert!((0.7..1.5).contains(&ratio), "{n}: {ratio}");
        }
    }

    #[test]
    fn a_bright_constant_has_no_false_variance() {
        // Moments kept as E[x²] - E[x]² give a sigma of 16 here.
        let state = (0..25).fold(SPATIAL_RECONSTRUCT_EMPTY, |s, i| {
            spatial_reconstruct_add(s, 0.3 + i as f32, 0.7, Vec3::splat(65000.0))
        });
        let r = spatial_reconstruct_finish(state, Vec3::ZERO);
        assert_eq!((r.color, r.variance), (Vec3::splat(65000.0), 0.0));
    }

    fn speckle(at: UVec2) -> SpatialReconstructHit {
        let mut next = numbers(at.x * 64 + at.y);
        let radiance = Vec3::new(next(), next(), next());
        hit(radiance, 0.01 + 4.0 * next())
    }

    fn lobe(at: UVec2) -> f32 {
        ((at.x * 5 + at.y * 3) % 11) as f32
    }

    const HALF: UVec2 = UVec2::splat(24);

    fn everywhere() -> impl Iterator<Item = (UVec2, f32)> {
        let mut next = numbers(12);
        (0..HALF.x * HALF.y).map(move |i| (UVec2::new(i % HALF.x, i / HALF.x), next()))
    }

    fn reconstructed(
        at: UVec2,
        turn: f32,
        read: impl Fn(UVec2) -> SpatialReconstructHit,
        weight: impl Fn(UVec2) -> f32,
    ) -> SpatialReconstruction {
        spatial_reconstruct_pixel(at * 2, HALF, 16, turn, read, |_, at, _| weight(at))
    }

    #[test]
    fn the_exposure_changes_nothing_but_the_scale() {
        for (at, turn) in everywhere() {
            let plain = reconstructed(at, turn, speckle, lobe);
            for power in -10..=10 {
                let k = 2f32.powi(power);
                let bright = |p| {
                    let found = speckle(p);
                    hit(found.radiance * k, found.pdf)
                };
                let other = reconstructed(at, turn, bright, lobe);
                assert_eq!(other.color, plain.color * k);
                assert_eq!(other.variance, plain.variance * k * k);
                assert_eq!(other.samples, plain.samples);
            }
        }
    }

    #[test]
    fn turned_images_give_turned_results() {
        // The spiral's symmetry: a quarter turn, which swaps no two hits, so
        // exactly; unless an offset is rounded the other way.
        let mut seen = 0;
        let turned = |p: UVec2| UVec2::new(HALF.x - 1 - p.y, p.x);
        let back = |p: UVec2| UVec2::new(p.y, HALF.x - 1 - p.x);
        for (at, turn) in everywhere() {
            let turn = 0.25 * turn;
            let halfway = |x: f32| (x - x.floor() - 0.5).abs() < 1e-4;
            if (1..16)
                .map(|i| spatial_reconstruct_offset(i, turn))
                .any(|o| halfway(o.x) || halfway(o.y))
            {
                continue;
            }
            seen += 1;
            let plain = reconstructed(at, turn, speckle, lobe);
            let (mut place, mut times) = (at, 0);
            for quarter in [0.25, 0.5, 0.75] {
                place = turned(place);
                times += 1;
                let source = |p| (0..times).fold(p, |p, _| back(p));
                let other = reconstructed(
                    place,
                    turn + quarter,
                    |p| speckle(source(p)),
                    |p| lobe(source(p)),
                );
                assert_eq!(other, plain, "{at}, {quarter}");
            }
        }
        assert!(seen > 500, "{seen}");
    }

    #[test]
    fn the_weights_sum_to_one() {
        // No constant shows it, as results are held between their inputs.
        for (at, turn) in everywhere() {
            let more = |p| {
                let found = speckle(p);
                hit(found.radiance * 2.0 + 3.0, found.pdf)
            };
            let plain = reconstructed(at, turn, speckle, lobe).color;
            let other = reconstructed(at, turn, more, lobe).color;
            // 16 steps of 4 ULP, of values below 1 (twice) and below 8.
            let apart = (other - (plain * 2.0 + 3.0)).abs().max_element();
            assert!(
                apart < 64.0 * (2f32.powi(-23) + 2f32.powi(-21)),
                "{at}: {apart}"
            );
        }
    }
}
