//! SVGF's spatial half: variance-guided à-trous passes over a noisy image,
//! stopped at the edges of depth, normal and luminance.
//!
//! The order of a frame: accumulate over time, [`svgf_variance_pixel`] where
//! the history is short, then [`svgf_atrous_pixel`] with steps 1, 2, 4, 8, 16;
//! the output of pass [`SvgfSettings::feedback`] is the next frame's history.
//! Every function for a pixel has a scalar form (shadow, ambient occlusion),
//! which is the same code over one channel.
//!
//! What counts as data: a value below 2^60 in size, with a variance below
//! 2^121. A pixel with anything else (NaN, an infinity, 1e30) weighs nothing,
//! and is filled from its neighbours by geometry alone.
//!
//! Source: Schied et al., *Spatiotemporal Variance-Guided Filtering* (HPG
//! 2017), section 4; Dammertz et al., *Edge-Avoiding À-Trous Wavelet Transform*
//! (2010) for the passes; West, *Updating Mean and Variance Estimates* (1979)
//! for the spatial variance. The plane distance in place of the depth's
//! gradient, the relative floor of the luminance's scale and the test of the
//! data are ours.

use std::ops::{Add, Div, Mul};

use glam::{UVec2, Vec2, Vec3};

use crate::math::exponent::exp2_poly;
use crate::math::luminance::luminance;
use crate::math::sanitize::{magnitude_bits, usable_surface};
use crate::math::vector::vec3_dot;

/// Part of the luminance that counts as a deviation where the variance is 0.
/// Relative, so that the exposure changes nothing.
pub const SVGF_LUMINANCE_FLOOR: f32 = 1e-4;

/// Part of the depth that counts as a slope where the gradient is 0.
pub const SVGF_DEPTH_FLOOR: f32 = 1e-3;

/// Least scale of a weight, 2^-60; smaller ones count as this.
pub const SVGF_SCALE_MIN: f32 = 8.6736174e-19;

/// From here on, 2^60, a value is no data.
pub const SVGF_VALUE_MAX: f32 = 1152921504606846976.0;

/// Bits of 2^60.
pub(crate) const VALUE_BITS: u32 = 0x5d80_0000;
/// Bits of 2^121.
pub(crate) const VARIANCE_BITS: u32 = 0x7c00_0000;
/// Least sum of weights to divide by, 2^-40.
pub(crate) const TOTAL_MIN: f32 = 9.094947e-13;
/// Where a weight ends: `2^-40`.
pub(crate) const EXPONENT_MAX: f32 = 40.0;
/// 1.5 · 2^23: what is added to it, and is below 2^22, is rounded to an integer,
/// ties to even.
pub(crate) const ROUND: f32 = 12_582_912.0;
/// `2^-f = 1 + f·(F1 + …)`, relative error 2^-23.4 on `|f| <= 1/2`.
pub(crate) const FADE: [f32; 5] = [
    -0.693147,
    0.24022242,
    -0.055507336,
    0.0096715126,
    -0.0013264727,
];
/// `-128·log2(1 - d/2) = d·(N1 + …)`, such that its power of 2 errs by 2^-24.
pub(crate) const NORMAL: [f32; 3] = [92.33254, 23.074078, 8.015964];
/// From here on, the power of 128, [`NORMAL`] is good enough.
pub(crate) const STEEP: u32 = 7;
/// Largest step between taps, in pixels.
const STEP_MAX: u32 = 1 << 20;
/// log2 e.
pub(crate) const LOG2_E: f32 = 1.442695;

/// How strong the filter is. The steps over time are in here too, so that a
/// preset is whole.
///
/// ```
/// use raytwin_cpu::filter::svgf::SvgfSettings;
///
/// // The paper's, with a filter half as sensitive to luminance.
/// let softer = SvgfSettings { sigma_luminance: 8.0, ..SvgfSettings::PAPER };
/// assert_eq!((softer.passes, softer.radius), (5, 2));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SvgfSettings {
    /// Least weight of the new frame's colour in the history.
    pub alpha: f32,
    /// Least weight of the new frame's moments.
    pub moments_alpha: f32,
    /// Frames below which the variance is estimated over the image.
    pub history: f32,
    /// Multiplies a surface's reach: the plane distance for a weight of 1/e.
    pub sigma_depth: f32,
    /// Standard deviations of luminance for a weight of 1/e.
    pub sigma_luminance: f32,
    /// The normals' cosine is raised to 2 to this power.
    pub squarings: u32,
    /// Taps on each side of the centre: 2 for 5 × 5, 1 for 3 × 3.
    pub radius: u32,
    /// Number of passes; pass `i` has a step of 2^i pixels.
    pub passes: u32,
    /// The pass, from 0, whose output becomes the history.
    pub feedback: u32,
}

impl SvgfSettings {
    /// The paper's: five passes of 5 × 5, the first one fed back.
    pub const PAPER: Self = Self {
        alpha: 0.2,
        moments_alpha: 0.2,
        history: 4.0,
        sigma_depth: 1.0,
        sigma_luminance: 4.0,
        squarings: 7,
        radius: 2,
        passes: 5,
        feedback: 0,
    };

    /// The blog's (*Adventures in Hybrid Rendering*): four passes of 3 × 3, a
    /// wider luminance and softer normals, a longer history.
    pub const BLOG: Self = Self {
        alpha: 0.01,
        moments_alpha: 0.2,
        history: 4.0,
        sigma_depth: 1.0,
        sigma_luminance: 10.0,
        squarings: 5,
        radius: 1,
        passes: 4,
        feedback: 1,
    };
}

/// A value and the variance of its luminance.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{SvgfSample, svgf_gaussian_pixel};
///
/// let sample = SvgfSample { value: Vec3::ONE, variance: 0.04 };
/// assert_eq!(svgf_gaussian_pixel(UVec2::ZERO, UVec2::ONE, |_| sample), 0.04);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SvgfSample<V> {
    /// What is filtered.
    pub value: V,
    /// Variance of its luminance; below 0 counts as 0.
    pub variance: f32,
}

/// A colour: reflections, indirect light.
pub type SvgfColor = SvgfSample<Vec3>;

/// A number: shadow, ambient occlusion.
pub type SvgfScalar = SvgfSample<f32>;

/// What the filter knows of a pixel's surface.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{
///     SvgfSample, SvgfSettings, SvgfSurface, svgf_atrous_scalar_pixel,
/// };
///
/// let floor = SvgfSurface { position: Vec3::ZERO, reach: 0.1, normal: Vec3::Y };
/// // Without a surface a pixel keeps its value.
/// let sky = SvgfSurface { reach: 0.0, ..floor };
/// let sample = SvgfSample { value: 0.25, variance: 1.0 };
/// let out = svgf_atrous_scalar_pixel(
///     UVec2::ZERO,
///     UVec2::ONE,
///     1,
///     SvgfSettings::PAPER,
///     |_| sky,
///     |_| sample,
/// );
/// assert_eq!(out.value, 0.25);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SvgfSurface {
    /// Where it is, in the world.
    pub position: Vec3,
    /// Distance from its plane at which the weight falls to 1/e, above 0; not
    /// above 0 where there is no surface.
    pub reach: f32,
    /// Its unit normal.
    pub normal: Vec3,
}

/// What both signals can do: one source for the colour's filter and for the
/// scalar's.
trait Signal:
    Copy + Add<Output = Self> + Mul<Output = Self> + Mul<f32, Output = Self> + Div<f32, Output = Self>
{
    const ZERO: Self;
    fn splat(x: f32) -> Self;
    fn luminance(self) -> f32;
    /// The largest component's bits, without its sign.
    fn size_bits(self) -> u32;
    fn lower(self, other: Self) -> Self;
    fn upper(self, other: Self) -> Self;
}

impl Signal for f32 {
    const ZERO: Self = 0.0;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        x
    }
    #[inline(always)]
    fn luminance(self) -> f32 {
        self
    }
    #[inline(always)]
    fn size_bits(self) -> u32 {
        self.to_bits() & 0x7fff_ffff
    }
    #[inline(always)]
    fn lower(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn upper(self, other: Self) -> Self {
        self.max(other)
    }
}

impl Signal for Vec3 {
    const ZERO: Self = Vec3::ZERO;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Vec3::splat(x)
    }
    #[inline(always)]
    fn luminance(self) -> f32 {
        luminance(self)
    }
    #[inline(always)]
    fn size_bits(self) -> u32 {
        magnitude_bits(self)
    }
    #[inline(always)]
    fn lower(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn upper(self, other: Self) -> Self {
        self.max(other)
    }
}

/// One over a scale, which counts as 2^-60 at least: never infinite.
///
/// Error analysis: one quotient.
///
/// ```
/// use raytwin_cpu::filter::svgf::svgf_falloff;
///
/// assert_eq!(svgf_falloff(0.25), 4.0);
/// assert!(svgf_falloff(0.0).is_finite());
/// ```
#[inline]
#[must_use]
pub fn svgf_falloff(scale: f32) -> f32 {
    1.0 / scale.max(SVGF_SCALE_MIN)
}

/// The luminance difference at which a weight falls to 1/e:
/// `sigma·√variance + 1e-4·|luminance|`.
///
/// `variance` is the centre's, after [`svgf_gaussian_pixel`] (below 0 counts as
/// 0), `luminance` the centre's. The second term stands for the paper's
/// absolute ε, which would make the filter depend on the exposure.
///
/// Error analysis: a sum of two terms of one sign.
///
/// ```
/// use raytwin_cpu::filter::svgf::svgf_luminance_scale;
///
/// // Four standard deviations, and a little of the luminance.
/// assert_eq!(svgf_luminance_scale(0.25, 0.0, 4.0), 2.0);
/// assert!(svgf_luminance_scale(0.0, 1.0, 4.0) > 0.0);
/// ```
#[inline]
#[must_use]
pub fn svgf_luminance_scale(variance: f32, luminance: f32, sigma: f32) -> f32 {
    sigma * variance.max(0.0).sqrt() + SVGF_LUMINANCE_FLOOR * luminance.abs()
}

/// `e^-(|difference|/scale)`: the weight of a tap whose luminance differs by
/// `difference`, with [`svgf_luminance_scale`]. No difference gives exactly 1,
/// whatever the scale.
///
/// Error analysis: `x·e^-x` is at most 0.37, so the errors of the quotient
/// leave an ULP or two of one.
///
/// ```
/// use raytwin_cpu::filter::svgf::svgf_luminance_weight;
///
/// assert_eq!(svgf_luminance_weight(0.0, 2.0), 1.0);
/// // The scale is where it falls to 1/e.
/// assert!((svgf_luminance_weight(2.0, 2.0) - 0.3679).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn svgf_luminance_weight(difference: f32, scale: f32) -> f32 {
    exp2_poly(-LOG2_E * (difference.abs() * svgf_falloff(scale)))
}

/// `e^-(|n·offset|/reach)`: the weight of a tap by its distance from the
/// centre's plane.
///
/// `normal` is the centre's, `offset` the tap's position less the centre's,
/// `reach` in the same unit, above 0. On a plane the weight is 1 at any angle.
///
/// Error analysis: the distance may cancel, which costs `|offset|/reach` ULP of
/// one.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::svgf::svgf_depth_weight;
///
/// // Along the plane nothing is lost, off it 1/e a reach.
/// assert_eq!(svgf_depth_weight(Vec3::Y, Vec3::X, 0.1), 1.0);
/// assert!(
///     (svgf_depth_weight(Vec3::Y, 0.1 * Vec3::Y, 0.1) - 0.3679).abs() < 1e-4
/// );
/// ```
#[inline]
#[must_use]
pub fn svgf_depth_weight(normal: Vec3, offset: Vec3, reach: f32) -> f32 {
    exp2_poly(-LOG2_E * (vec3_dot(normal, offset).abs() * svgf_falloff(reach)))
}

/// The paper's depth weight, `e^-(|z - z'|/(sigma·|∇z·offset| + ε))`.
///
/// `difference` is the tap's depth less the centre's, `depth` the centre's,
/// `gradient` the depth's change a pixel at the centre, `offset` the tap's
/// distance in pixels. ε is a thousandth of the depth: with an absolute one the
/// noise of the depth itself stops the filter on a wall that faces the camera.
///
/// It takes the depth as linear across the image. On a plane seen at a grazing
/// angle that fails: the far taps weigh too little, and all but the centre
/// weigh 1/e at most. [`svgf_depth_weight`] does better from the same data.
///
/// Error analysis: the predicted difference may cancel, if the gradient is
/// across the offset, down to ε.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::filter::svgf::svgf_depth_weight_gradient;
///
/// let slope = Vec2::new(0.5, 0.0);
/// // A difference that the slope predicts still weighs 1/e; one that it does
/// // not predict weighs nothing.
/// let predicted = svgf_depth_weight_gradient(0.5, 10.0, slope, Vec2::X, 1.0);
/// let step = svgf_depth_weight_gradient(0.5, 10.0, slope, Vec2::Y, 1.0);
/// assert!(predicted > 0.36 && step < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn svgf_depth_weight_gradient(
    difference: f32,
    depth: f32,
    gradient: Vec2,
    offset: Vec2,
    sigma: f32,
) -> f32 {
    let predicted = (gradient.x * offset.x + gradient.y * offset.y).abs();
    let scale = sigma * predicted + SVGF_DEPTH_FLOOR * depth.abs();
    exp2_poly(-LOG2_E * (difference.abs() * svgf_falloff(scale)))
}

/// `max(n·n', 0)^(2^squarings)`: the weight of a tap by its normal; 7 squarings
/// are the paper's power of 128.
///
/// Both are unit vectors; equal ones give exactly 1.
///
/// Error analysis: what is squared is not the cosine but its distance from 1,
/// `|n - n'|²/2`, which is exact to an ULP where the cosine has lost its
/// digits: if `c = 1 - y` then `c² = 1 - y(2 - y)`. A step leaves the relative
/// error of `y` as it is and adds 1.5 ULP. Squaring the cosine itself doubles
/// its error at each step, to 128 ULP, and a rounded `n·n` may exceed 1.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::svgf::svgf_normal_weight;
///
/// assert_eq!(svgf_normal_weight(Vec3::Y, Vec3::Y, 7), 1.0);
/// // A cosine of 0.8, squared once.
/// let tilted = svgf_normal_weight(Vec3::Y, Vec3::new(0.6, 0.8, 0.0), 1);
/// assert!((tilted - 0.64).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn svgf_normal_weight(normal: Vec3, other_normal: Vec3, squarings: u32) -> f32 {
    let turned = Vec3::new(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let mut below = (0.5 * vec3_dot(turned, turned)).min(1.0);
    let mut i = 0;
    while i < squarings.min(16) {
        let y = below;
        below = y * (2.0 - y);
        i += 1;
    }
    1.0 - below
}

/// `2^-exponent`, for `exponent >= 0`; 0 above 40.
#[inline(always)]
pub(crate) fn svgf_fade(exponent: f32) -> f32 {
    if exponent > EXPONENT_MAX {
        return 0.0;
    }
    let k = (exponent + ROUND) - ROUND;
    let f = exponent - k;
    let p = 1.0 + f * (FADE[0] + f * (FADE[1] + f * (FADE[2] + f * (FADE[3] + f * FADE[4]))));
    p * f32::from_bits((127 - k as i32 as u32) << 23)
}

/// The three weights in one, with one exponential: [`svgf_depth_weight`] ·
/// [`svgf_luminance_weight`] · [`svgf_normal_weight`].
///
/// `depth_falloff` and `luminance_falloff` are [`svgf_falloff`] of the reach
/// (times `sigma_depth`) and of [`svgf_luminance_scale`], the same for all taps
/// of a pixel; 0 leaves that weight out. `difference` is the tap's luminance
/// less the centre's. The centre itself weighs exactly 1.
///
/// Below 2^-40 a weight counts as 0: it would add nothing to a sum, and
/// its square, with which variances are weighed, would be subnormal, which is
/// slow on many processors.
///
/// Error analysis: that of its parts; the exponents have one sign. From 7
/// squarings on the normals' weight is in the exponent too, as three terms of
/// `-log2(1 - y)` with `y = |n - n'|²/2`: where they are not enough, the weight
/// is small, and it never errs by more than 2^-24. `x·2^-x` is at most 0.54, so
/// an exponent's own error leaves less than it is.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::filter::svgf::{
///     svgf_depth_weight, svgf_falloff, svgf_luminance_weight,
///     svgf_normal_weight, svgf_weight,
/// };
///
/// let tilted = Vec3::new(0.28, 0.96, 0.0);
/// let offset = Vec3::new(1.0, 0.05, 0.0);
/// let all = svgf_weight(
///     Vec3::Y,
///     tilted,
///     offset,
///     svgf_falloff(0.1),
///     1.0,
///     svgf_falloff(2.0),
///     5,
/// );
/// let product = svgf_depth_weight(Vec3::Y, offset, 0.1)
///     * svgf_luminance_weight(1.0, 2.0)
///     * svgf_normal_weight(Vec3::Y, tilted, 5);
/// assert!((all - product).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn svgf_weight(
    normal: Vec3,
    other_normal: Vec3,
    offset: Vec3,
    depth_falloff: f32,
    difference: f32,
    luminance_falloff: f32,
    squarings: u32,
) -> f32 {
    // All that is the centre's comes first: a loop over taps takes it out.
    let steep = LOG2_E * depth_falloff;
    let across = Vec3::new(normal.x * steep, normal.y * steep, normal.z * steep);
    let plane = vec3_dot(across, offset).abs();
    let apart = difference.abs() * (LOG2_E * luminance_falloff);
    let exponent = plane + apart;
    if squarings < STEEP {
        return svgf_normal_weight(normal, other_normal, squarings) * svgf_fade(exponent);
    }
    let turned = Vec3::new(
        other_normal.x - normal.x,
        other_normal.y - normal.y,
        other_normal.z - normal.z,
    );
    let d = vec3_dot(turned, turned);
    let power = (1 << (squarings.min(16) - STEEP)) as f32;
    let bent = d * (power * NORMAL[0] + d * (power * NORMAL[1] + d * (power * NORMAL[2])));
    svgf_fade(exponent + bent)
}

/// B3 spline: 3/8, 1/4, 1/16.
#[inline(always)]
fn svgf_spline(offset: i32) -> f32 {
    let far = if offset.abs() == 1 { 0.25 } else { 0.0625 };
    if offset == 0 { 0.375 } else { far }
}

/// Whether a tap at this place exists.
#[inline(always)]
fn svgf_inside(x: i32, y: i32, size: UVec2) -> bool {
    x >= 0 && y >= 0 && x < size.x as i32 && y < size.y as i32
}

/// Whether there is a surface, and its numbers are ones.
#[inline(always)]
fn svgf_surface_usable(surface: SvgfSurface) -> bool {
    usable_surface(surface.position, surface.normal, surface.reach) != 0
}

/// Whether a variance is data.
#[inline(always)]
fn svgf_variance_usable(variance: f32) -> bool {
    variance.size_bits() < VARIANCE_BITS
}

/// Whether a sample is data.
#[inline(always)]
fn svgf_usable<V: Signal>(sample: SvgfSample<V>) -> bool {
    sample.value.size_bits() < VALUE_BITS && svgf_variance_usable(sample.variance)
}

#[inline(always)]
fn gaussian<V: Signal>(pixel: UVec2, size: UVec2, read: &impl Fn(UVec2) -> SvgfSample<V>) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    let mut sum = 0.0;
    let mut total = 0.0;
    let mut low = f32::MAX;
    let mut high = 0.0f32;
    let mut dy = -1;
    while dy <= 1 {
        let mut dx = -1;
        while dx <= 1 {
            let x = pixel.x as i32 + dx;
            let y = pixel.y as i32 + dy;
            let w = (if dx == 0 { 0.5 } else { 0.25 }) * (if dy == 0 { 0.5 } else { 0.25 });
            dx += 1;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let found = read(UVec2::new(x as u32, y as u32)).variance;
            if !svgf_variance_usable(found) {
                continue;
            }
            let variance = found.max(0.0);
            sum += w * variance;
            total += w;
            low = low.min(variance);
            high = high.max(variance);
        }
        dy += 1;
    }
    if total <= 0.0 {
        return 0.0;
    }
    (sum / total).max(low).min(high)
}

#[inline(always)]
fn variance<V: Signal>(
    pixel: UVec2,
    size: UVec2,
    history: f32,
    settings: SvgfSettings,
    read_surface: &impl Fn(UVec2) -> SvgfSurface,
    read: &impl Fn(UVec2) -> SvgfSample<V>,
) -> f32 {
    if pixel.x >= size.x || pixel.y >= size.y {
        return 0.0;
    }
    let own = read(pixel).variance;
    let known = svgf_variance_usable(own);
    if known && history >= settings.history {
        return own.max(0.0);
    }
    let centre = read_surface(pixel);
    if !svgf_surface_usable(centre) {
        return if known { own.max(0.0) } else { 0.0 };
    }
    let depth_falloff = svgf_falloff(settings.sigma_depth * centre.reach);
    let mut mean = 0.0;
    let mut total = 0.0;
    let mut pairs = 0.0;
    let mut spread = 0.0;
    let mut dy = -3;
    while dy <= 3 {
        let mut dx = -3;
        while dx <= 3 {
            let x = pixel.x as i32 + dx;
            let y = pixel.y as i32 + dy;
            dx += 1;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let at = UVec2::new(x as u32, y as u32);
            let surface = read_surface(at);
            let tap = read(at);
            if !svgf_surface_usable(surface) || tap.value.size_bits() >= VALUE_BITS {
                continue;
            }
            let to = surface.position - centre.position;
            let w = svgf_weight(
                centre.normal,
                surface.normal,
                to,
                depth_falloff,
                0.0,
                0.0,
                settings.squarings,
            );
            if w < TOTAL_MIN {
                continue;
            }
            let before = total;
            total = before + w;
            let light = tap.value.luminance();
            if before <= 0.0 {
                mean = light;
                continue;
            }
            let part = w / total;
            let away = light - mean;
            pairs += before * w;
            spread += (before * part) * (away * away);
            let moved = (mean * before + light * w) / total;
            mean = moved.max(mean.min(light)).min(mean.max(light));
        }
        dy += 1;
    }
    if total <= 0.0 {
        return 0.0;
    }
    let square = total * total;
    (spread / total) * (square / (2.0 * pairs).max(0.5 * square))
}

#[inline(always)]
fn atrous<V: Signal>(
    pixel: UVec2,
    size: UVec2,
    step: u32,
    settings: SvgfSettings,
    read_surface: &impl Fn(UVec2) -> SvgfSurface,
    read: &impl Fn(UVec2) -> SvgfSample<V>,
) -> SvgfSample<V> {
    let nothing = SvgfSample {
        value: V::ZERO,
        variance: 0.0,
    };
    if pixel.x >= size.x || pixel.y >= size.y {
        return nothing;
    }
    let own = read(pixel);
    let known = svgf_usable(own);
    let centre = read_surface(pixel);
    if !svgf_surface_usable(centre) {
        if !known {
            return nothing;
        }
        return SvgfSample {
            value: own.value,
            variance: own.variance.max(0.0),
        };
    }
    let depth_falloff = svgf_falloff(settings.sigma_depth * centre.reach);
    let mut light = 0.0;
    let mut luminance_falloff = 0.0;
    if known {
        light = own.value.luminance();
        let smooth = gaussian(pixel, size, read);
        luminance_falloff = svgf_falloff(svgf_luminance_scale(
            smooth,
            light,
            settings.sigma_luminance,
        ));
    }
    let spacing = step.min(STEP_MAX) as i32;
    let radius = settings.radius.min(2) as i32;
    let mut value = V::ZERO;
    let mut variance = 0.0;
    let mut total = 0.0;
    let mut low = V::splat(SVGF_VALUE_MAX);
    let mut high = V::splat(-SVGF_VALUE_MAX);
    let mut dy = -radius;
    while dy <= radius {
        let mut dx = -radius;
        while dx <= radius {
            let x = pixel.x as i32 + dx * spacing;
            let y = pixel.y as i32 + dy * spacing;
            let spline = svgf_spline(dx) * svgf_spline(dy);
            dx += 1;
            if !svgf_inside(x, y, size) {
                continue;
            }
            let at = UVec2::new(x as u32, y as u32);
            let surface = read_surface(at);
            let tap = read(at);
            if !svgf_surface_usable(surface) || !svgf_usable(tap) {
                continue;
            }
            let to = surface.position - centre.position;
            let difference = if known {
                tap.value.luminance() - light
            } else {
                0.0
            };
            let w = spline
                * svgf_weight(
                    centre.normal,
                    surface.normal,
                    to,
                    depth_falloff,
                    difference,
                    luminance_falloff,
                    settings.squarings,
                );
            value = value + tap.value * w;
            variance += (w * w) * tap.variance.max(0.0);
            total += w;
            low = low.lower(tap.value);
            high = high.upper(tap.value);
        }
        dy += 1;
    }
    if total < TOTAL_MIN {
        return nothing;
    }
    SvgfSample {
        value: (value / total).upper(low).lower(high),
        variance: (variance / total) / total,
    }
}

/// The 3 × 3 Gaussian of the variance around a pixel, the weights of those that
/// exist and are data; 0 if none are.
///
/// `size` is the image's (each side below 2^30), `pixel` inside it, `read(at)`
/// is only called inside `size`. [`svgf_atrous_pixel`] calls it for itself. The
/// result lies between its inputs.
///
/// In WGSL `read` is the function `svgf_read_color` that the program defines.
///
/// Error analysis: a weighted mean of numbers `>= 0` with exact weights.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{SvgfSample, svgf_gaussian_pixel};
///
/// // One pixel of variance 16 among known ones: the centre's share is 4/16.
/// let read = |at: UVec2| SvgfSample {
///     value: Vec3::ONE,
///     variance: if at == UVec2::ONE { 16.0 } else { 0.0 },
/// };
/// assert_eq!(svgf_gaussian_pixel(UVec2::ONE, UVec2::splat(3), read), 4.0);
/// ```
#[inline]
#[must_use]
pub fn svgf_gaussian_pixel<R>(pixel: UVec2, size: UVec2, read: R) -> f32
where
    R: Fn(UVec2) -> SvgfColor,
{
    gaussian(pixel, size, &read)
}

/// [`svgf_gaussian_pixel`] of a scalar; in WGSL it reads `svgf_read_scalar`.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::filter::svgf::{SvgfSample, svgf_gaussian_scalar_pixel};
///
/// // Next to the centre the share is 2/16, at the corner 1/16.
/// let read = |at: UVec2| SvgfSample {
///     value: 1.0,
///     variance: if at == UVec2::ONE { 16.0 } else { 0.0 },
/// };
/// assert_eq!(
///     svgf_gaussian_scalar_pixel(UVec2::new(2, 1), UVec2::splat(5), read),
///     2.0
/// );
/// ```
#[inline]
#[must_use]
pub fn svgf_gaussian_scalar_pixel<R>(pixel: UVec2, size: UVec2, read: R) -> f32
where
    R: Fn(UVec2) -> SvgfScalar,
{
    gaussian(pixel, size, &read)
}

/// A pixel's variance: its own where `history` frames are enough, else that of
/// the luminance over 7 × 7 pixels, weighted by depth and normal.
///
/// `history` is the pixel's number of accumulated frames; from
/// [`SvgfSettings::history`] on the result is the variance that `read` gives.
/// Where there is no surface it is that too, and 0 if it is no data. The
/// callbacks are only called inside `size` (each side below 2^30).
///
/// The estimate is unbiased where the weights amount to two pixels or more, and
/// falls to 0 where a pixel stands alone. It is never negative, and exactly 0
/// for a constant.
///
/// In WGSL the callbacks are the functions `svgf_read_surface` and
/// `svgf_read_color` that the program defines.
///
/// Error analysis: the spread is a sum of squares of distances from a running
/// mean, which is kept between its inputs. Those distances cancel, so the error
/// is a few ULP of the luminance squared; where they are 0 it is 0.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{
///     SvgfSample, SvgfSettings, SvgfSurface, svgf_variance_pixel,
/// };
///
/// let floor = |at: UVec2| SvgfSurface {
///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// let read = |at: UVec2| SvgfSample {
///     value: Vec3::splat(((at.x + at.y) % 2) as f32),
///     variance: 7.0,
/// };
/// let (pixel, size, paper) =
///     (UVec2::splat(4), UVec2::splat(9), SvgfSettings::PAPER);
/// // Black and white pixels: 1/4, from the image. With a history its variance.
/// let young = svgf_variance_pixel(pixel, size, 1.0, paper, floor, read);
/// let old = svgf_variance_pixel(pixel, size, 9.0, paper, floor, read);
/// assert!((young - 0.25).abs() < 0.02 && old == 7.0);
/// ```
#[inline]
#[must_use]
pub fn svgf_variance_pixel<S, R>(
    pixel: UVec2,
    size: UVec2,
    history: f32,
    settings: SvgfSettings,
    read_surface: S,
    read: R,
) -> f32
where
    S: Fn(UVec2) -> SvgfSurface,
    R: Fn(UVec2) -> SvgfColor,
{
    variance(pixel, size, history, settings, &read_surface, &read)
}

/// [`svgf_variance_pixel`] of a scalar; in WGSL it reads `svgf_read_scalar`.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{
///     SvgfSample, SvgfSettings, SvgfSurface, svgf_variance_scalar_pixel,
/// };
///
/// let floor = SvgfSurface { position: Vec3::ZERO, reach: 0.1, normal: Vec3::Y };
/// let constant = SvgfSample { value: 0.3, variance: 7.0 };
/// let variance = svgf_variance_scalar_pixel(
///     UVec2::splat(4),
///     UVec2::splat(9),
///     1.0,
///     SvgfSettings::PAPER,
///     |_| floor,
///     |_| constant,
/// );
/// assert_eq!(variance, 0.0);
/// ```
#[inline]
#[must_use]
pub fn svgf_variance_scalar_pixel<S, R>(
    pixel: UVec2,
    size: UVec2,
    history: f32,
    settings: SvgfSettings,
    read_surface: S,
    read: R,
) -> f32
where
    S: Fn(UVec2) -> SvgfSurface,
    R: Fn(UVec2) -> SvgfScalar,
{
    variance(pixel, size, history, settings, &read_surface, &read)
}

/// One à-trous pass for a pixel: a 5 × 5 B3 spline (3 × 3 with a radius of 1)
/// with `step` pixels between taps, each weighted by [`svgf_weight`].
///
/// `step` is 1 in the first pass and doubles (at most 2^20). The callbacks are
/// only called inside `size` (each side below 2^30); taps outside are left out
/// and the weights renormalised. Each channel of the value lies between its
/// inputs; the variance is that of the weighted mean, `Σw²v/(Σw)²`.
///
/// A pixel without a surface keeps its value. A pixel whose own value is no
/// data is filled by geometry alone, and is 0 where its neighbours weigh
/// nothing. Such a tap weighs nothing.
///
/// In WGSL the callbacks are the functions `svgf_read_surface` and
/// `svgf_read_color` that the program defines.
///
/// Error analysis: each weight errs by a few ULP of one. So does their sum, of
/// which the centre is 9/64; the mean is a convex combination.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{
///     SvgfSample, SvgfSettings, SvgfSurface, svgf_atrous_pixel,
/// };
///
/// // A noisy floor: each pass brings a pixel nearer to the mean of 1.
/// let floor = |at: UVec2| SvgfSurface {
///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// let noisy = |at: UVec2| SvgfSample {
///     value: Vec3::splat(0.5 + ((at.x + at.y) % 2) as f32),
///     variance: 0.25,
/// };
/// let out = svgf_atrous_pixel(
///     UVec2::splat(4),
///     UVec2::splat(9),
///     1,
///     SvgfSettings::PAPER,
///     floor,
///     noisy,
/// );
/// assert!((out.value.x - 1.0).abs() < 0.2 && out.variance < 0.25);
/// ```
#[inline]
#[must_use]
pub fn svgf_atrous_pixel<S, R>(
    pixel: UVec2,
    size: UVec2,
    step: u32,
    settings: SvgfSettings,
    read_surface: S,
    read: R,
) -> SvgfColor
where
    S: Fn(UVec2) -> SvgfSurface,
    R: Fn(UVec2) -> SvgfColor,
{
    atrous(pixel, size, step, settings, &read_surface, &read)
}

/// [`svgf_atrous_pixel`] of a scalar; in WGSL it reads `svgf_read_scalar`.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::filter::svgf::{
///     SvgfSample, SvgfSettings, SvgfSurface, svgf_atrous_scalar_pixel,
/// };
///
/// // A shadow's edge without noise stays sharp.
/// let floor = |at: UVec2| SvgfSurface {
///     position: Vec3::new(at.x as f32, 0.0, at.y as f32),
///     reach: 0.1,
///     normal: Vec3::Y,
/// };
/// let shadow = |at: UVec2| SvgfSample {
///     value: if at.x < 4 { 0.0 } else { 1.0 },
///     variance: 0.0,
/// };
/// let out = svgf_atrous_scalar_pixel(
///     UVec2::splat(4),
///     UVec2::splat(9),
///     1,
///     SvgfSettings::PAPER,
///     floor,
///     shadow,
/// );
/// assert_eq!(out.value, 1.0);
/// ```
#[inline]
#[must_use]
pub fn svgf_atrous_scalar_pixel<S, R>(
    pixel: UVec2,
    size: UVec2,
    step: u32,
    settings: SvgfSettings,
    read_surface: S,
    read: R,
) -> SvgfScalar
where
    S: Fn(UVec2) -> SvgfSurface,
    R: Fn(UVec2) -> SvgfScalar,
{
    atrous(pixel, size, step, settings, &read_surface, &read)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_hash, pcg_unit};

    const SIZE: UVec2 = UVec2::new(48, 40);
    const PAPER: SvgfSettings = SvgfSettings::PAPER;

    fn noise(at: UVec2, lane: u32) -> f32 {
        pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
    }

    fn wall(at: UVec2) -> SvgfSurface {
        SvgfSurface {
            position: Vec3::new(at.x as f32, at.y as f32, 0.0),
            reach: 0.1,
            normal: Vec3::Z,
        }
    }

    /// Two walls, one of them tilted, with a step between them.
    fn corner(at: UVec2) -> SvgfSurface {
        if at.x < 20 {
            return wall(at);
        }
        SvgfSurface {
            position: Vec3::new(at.x as f32, at.y as f32, 3.0 + 0.75 * at.y as f32),
            reach: 0.1,
            normal: Vec3::new(0.0, -0.6, 0.8),
        }
    }

    fn speckle(at: UVec2) -> SvgfColor {
        let bright = if noise(at, 5) < 0.1 { 8.0 } else { 1.0 };
        SvgfColor {
            value: Vec3::new(noise(at, 0), noise(at, 1), noise(at, 2)) * bright,
            variance: noise(at, 3) * bright,
        }
    }

    fn gray(at: UVec2) -> SvgfScalar {
        let color = speckle(at);
        SvgfScalar {
            value: color.value.x,
            variance: color.variance,
        }
    }

    fn everywhere(size: UVec2) -> impl Iterator<Item = UVec2> {
        (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
    }

    /// An image of what a function gives at each pixel.
    struct Image<T>(UVec2, Vec<T>);

    impl<T: Copy> Image<T> {
        fn new(size: UVec2, f: impl Fn(UVec2) -> T) -> Self {
            Self(size, everywhere(size).map(f).collect())
        }
        fn at(&self, at: UVec2) -> T {
            assert!(at.x < self.0.x && at.y < self.0.y, "read outside at {at}");
            self.1[(at.y * self.0.x + at.x) as usize]
        }
    }

    fn pass<V: Signal>(
        image: &Image<SvgfSample<V>>,
        step: u32,
        settings: SvgfSettings,
        surface: impl Fn(UVec2) -> SvgfSurface,
    ) -> Image<SvgfSample<V>> {
        Image::new(image.0, |at| {
            atrous(at, image.0, step, settings, &surface, &|at| image.at(at))
        })
    }

    fn filtered<V: Signal>(
        image: Image<SvgfSample<V>>,
        settings: SvgfSettings,
        surface: impl Fn(UVec2) -> SvgfSurface + Copy,
    ) -> Image<SvgfSample<V>> {
        (0..settings.passes).fold(image, |image, i| pass(&image, 1 << i, settings, surface))
    }

    #[test]
    fn a_constant_image_stays_as_it_is() {
        for settings in [PAPER, SvgfSettings::BLOG] {
            for value in [0.0, 1e-30, 0.1, 3.3, 1000.1, 65000.0, 1e18] {
                let color = Vec3::new(value, value * 0.7, value * 0.3);
                for noisy in [0.0, 1.0] {
                    let image = Image::new(SIZE, |at| SvgfColor {
                        value: color,
                        variance: noisy * noise(at, 3) * value * value,
                    });
                    for result in &filtered(image, settings, corner).1 {
                        assert_eq!(result.value, color);
                        assert!(noisy == 1.0 || result.variance == 0.0);
                    }
                    for at in everywhere(SIZE) {
                        let read = |_| SvgfColor {
                            value: color,
                            variance: 7.0,
                        };
                        assert_eq!(
                            svgf_variance_pixel(at, SIZE, 1.0, settings, corner, read),
                            0.0
                        );
                        assert_eq!(svgf_gaussian_pixel(at, SIZE, read), 7.0);
                    }
                }
            }
        }
    }

    #[test]
    fn a_scalar_is_a_grey_of_one_channel() {
        // Exactly: a colour whose luminance is its red channel alone.
        for at in everywhere(SIZE) {
            for (step, settings) in [(1, PAPER), (4, SvgfSettings::BLOG)] {
                let scalar = svgf_atrous_scalar_pixel(at, SIZE, step, settings, corner, gray);
                let wide = |at| SvgfColor {
                    value: Vec3::splat(gray(at).value),
                    variance: gray(at).variance,
                };
                let color = svgf_atrous_pixel(at, SIZE, step, settings, corner, wide);
                assert_eq!(color.value.x, color.value.z);
                assert!((color.value.x - scalar.value).abs() <= 4e-6 * scalar.value.abs());
                let (a, b) = (
                    svgf_variance_scalar_pixel(at, SIZE, 1.0, settings, corner, gray),
                    svgf_variance_pixel(at, SIZE, 1.0, settings, corner, wide),
                );
                assert!((a - b).abs() <= 1e-5 * a, "{a} {b}");
                assert_eq!(
                    svgf_gaussian_scalar_pixel(at, SIZE, gray),
                    svgf_gaussian_pixel(at, SIZE, wide)
                );
            }
        }
    }

    #[test]
    fn the_weights_of_a_flat_scene_are_the_spline() {
        // One bright pixel in an image of known, large variance: what is left of
        // it at each place is the kernel's weight there. They sum to one.
        for (radius, want) in [
            (2, [36.0, 24.0, 6.0, 16.0, 4.0, 1.0].map(|k| k / 256.0)),
            (1, [9.0, 6.0, 0.0, 4.0, 0.0, 0.0].map(|k| k / 49.0)),
        ] {
            let settings = SvgfSettings { radius, ..PAPER };
            let middle = UVec2::new(16, 16);
            for step in [1, 2, 4] {
                let image = Image::new(UVec2::splat(33), |at| SvgfScalar {
                    value: f32::from(u8::from(at == middle)),
                    variance: 1e14,
                });
                let out = pass(&image, step, settings, wall);
                let mut sum = 0.0;
                for at in everywhere(out.0) {
                    let got = out.at(at).value;
                    sum += f64::from(got);
                    let dx = (at.x as i32 - 16).unsigned_abs();
                    let dy = (at.y as i32 - 16).unsigned_abs();
                    let tap = UVec2::new(dx, dy) / step;
                    let on = tap * step == UVec2::new(dx, dy) && tap.max_element() <= 2;
                    let expect = if on {
                        let (a, b) = (tap.min_element(), tap.max_element());
                        want[[[0, 1, 2], [9, 3, 4], [9, 9, 5]][a as usize][b as usize]]
                    } else {
                        0.0
                    };
                    assert!((got - expect).abs() < 1e-7, "{at}: {got}, not {expect}");
                }
                assert!((sum - 1.0).abs() < 1e-6, "{sum}");
            }
        }
    }

    #[test]
    fn results_lie_between_their_inputs() {
        for step in [1, 2, 8] {
            for at in everywhere(SIZE) {
                let seen = std::cell::RefCell::new((Vec3::splat(f32::MAX), Vec3::MIN));
                // The gaussian reads too, but only pixels of the first pass.
                let read = |at| {
                    let tap = speckle(at);
                    let mut seen = seen.borrow_mut();
                    *seen = (seen.0.min(tap.value), seen.1.max(tap.value));
                    tap
                };
                let out = svgf_atrous_pixel(at, SIZE, step, PAPER, corner, read);
                let (low, high) = seen.into_inner();
                assert!(out.value.cmpge(low).all() && out.value.cmple(high).all());
                assert!(out.variance >= 0.0 && out.variance.is_finite());
            }
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_mirrored_results() {
        let size = UVec2::splat(24);
        let flips: [fn(UVec2) -> UVec2; 3] = [
            |p| UVec2::new(23 - p.x, p.y),
            |p| UVec2::new(p.x, 23 - p.y),
            |p| UVec2::new(p.y, p.x),
        ];
        for flip in flips {
            for step in [1, 2, 4, 8, 16] {
                for at in everywhere(size) {
                    let close = |a: f32, b: f32| (a - b).abs() <= 1e-5 * a.abs().max(b.abs());
                    let surface = |at: UVec2| SvgfSurface {
                        normal: Vec3::new(0.0, 0.0, 1.0),
                        reach: 0.2 + noise(at, 9),
                        position: Vec3::new(0.0, 0.0, noise(at, 8)),
                    };
                    let a = svgf_atrous_pixel(flip(at), size, step, PAPER, surface, speckle);
                    let b = svgf_atrous_pixel(
                        at,
                        size,
                        step,
                        PAPER,
                        |p| surface(flip(p)),
                        |p| speckle(flip(p)),
                    );
                    for (a, b) in [
                        (a.value.x, b.value.x),
                        (a.value.y, b.value.y),
                        (a.value.z, b.value.z),
                        (a.variance, b.variance),
                    ] {
                        assert!(close(a, b), "{at}: {a} {b}");
                    }
                    let a = svgf_variance_pixel(flip(at), size, 0.0, PAPER, surface, speckle);
                    let b = svgf_variance_pixel(
                        at,
                        size,
                        0.0,
                        PAPER,
                        |p| surface(flip(p)),
                        |p| speckle(flip(p)),
                    );
                    assert!(close(a, b), "{at}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn the_exposure_changes_nothing() {
        for power in -10..=10 {
            let k = 2f32.powi(power);
            let scaled = |at| {
                let tap = speckle(at);
                SvgfColor {
                    value: tap.value * k,
                    variance: tap.variance * k * k,
                }
            };
            for settings in [PAPER, SvgfSettings::BLOG] {
                let a = filtered(Image::new(SIZE, speckle), settings, corner);
                let b = filtered(Image::new(SIZE, scaled), settings, corner);
                for (a, b) in a.1.iter().zip(&b.1) {
                    assert_eq!(a.value * k, b.value);
                    assert_eq!(a.variance * k * k, b.variance);
                }
            }
            for at in everywhere(SIZE) {
                assert_eq!(
                    svgf_variance_pixel(at, SIZE, 0.0, PAPER, corner, speckle) * k * k,
                    svgf_variance_pixel(at, SIZE, 0.0, PAPER, corner, scaled)
                );
            }
        }
    }

    #[test]
    fn a_bad_pixel_weighs_nothing_and_is_filled() {
        let bad = UVec2::new(30, 12);
        for number in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            for lane in 0..11 {
                let read = |at: UVec2| {
                    let mut tap = SvgfColor {
                        value: Vec3::new(1.0, 2.0, 3.0),
                        variance: 4.0,
                    };
                    if at == bad && lane < 3 {
                        tap.value[lane] = number;
                    }
                    if at == bad && lane == 3 {
                        tap.variance = if number == 1e30 { f32::MAX } else { number };
                    }
                    tap
                };
                let surface = |at: UVec2| {
                    let mut surface = wall(at);
                    match (at == bad, lane) {
                        (true, 4..=6) => surface.position[lane - 4] = number,
                        (true, 7..=9) => surface.normal[lane - 7] = number,
                        (true, 10) => surface.reach = number,
                        _ => {}
                    }
                    surface
                };
                let image = filtered(Image::new(SIZE, read), PAPER, surface);
                for at in everywhere(SIZE) {
                    let out = image.at(at);
                    // -1e30 as a variance is finite and counts as 0.
                    assert_eq!(out.value, Vec3::new(1.0, 2.0, 3.0), "{lane} {number} {at}");
                    assert!(out.variance.is_finite() && out.variance >= 0.0);
                    for history in [0.0, 9.0] {
                        let v = svgf_variance_pixel(at, SIZE, history, PAPER, surface, read);
                        assert!(v.is_finite() && v >= 0.0);
                    }
                }
            }
        }
    }

    #[test]
    fn without_any_weight_the_centre_stays() {
        let at = UVec2::new(10, 10);
        let lone = |p: UVec2| SvgfSurface {
            position: Vec3::Z * if p == at { 0.0 } else { 100.0 },
            ..wall(p)
        };
        let out = svgf_atrous_pixel(at, SIZE, 1, PAPER, lone, speckle);
        assert_eq!(out.value, speckle(at).value);
        // A pixel with neither data nor neighbours is black.
        let none = |p| SvgfColor {
            value: if p == at {
                Vec3::splat(f32::NAN)
            } else {
                Vec3::ONE
            },
            variance: 1.0,
        };
        let out = svgf_atrous_pixel(at, SIZE, 1, PAPER, lone, none);
        assert_eq!((out.value, out.variance), (Vec3::ZERO, 0.0));
        // The sky passes through, and gives nothing to its neighbours.
        let sky = |p: UVec2| SvgfSurface {
            reach: if p.y < 12 { 0.0 } else { 0.1 },
            ..wall(p)
        };
        let image = Image::new(SIZE, |p| SvgfScalar {
            value: if p.y < 12 { noise(p, 1) + 100.0 } else { 1.0 },
            variance: 1e9,
        });
        for (p, out) in everywhere(SIZE).zip(&filtered(Image(SIZE, image.1.clone()), PAPER, sky).1)
        {
            assert_eq!(out.value, image.at(p).value);
        }
    }

    #[test]
    fn outside_the_image_is_nothing() {
        for pixel in [UVec2::new(48, 0), UVec2::new(0, 40), UVec2::splat(u32::MAX)] {
            let out = svgf_atrous_pixel(pixel, SIZE, 1, PAPER, wall, speckle);
            assert_eq!((out.value, out.variance), (Vec3::ZERO, 0.0));
            assert_eq!(svgf_gaussian_pixel(pixel, SIZE, speckle), 0.0);
            assert_eq!(
                svgf_variance_pixel(pixel, SIZE, 0.0, PAPER, wall, speckle),
                0.0
            );
        }
        let big = SvgfSettings { radius: 9, ..PAPER };
        let a = svgf_atrous_pixel(UVec2::ONE, SIZE, u32::MAX, big, wall, speckle);
        assert_eq!(a.value, speckle(UVec2::ONE).value);
    }

    #[test]
    fn noise_falls_and_its_variance_is_known() {
        // Uniform noise of variance 1/12 around 0.5: what each pass leaves.
        let size = UVec2::splat(96);
        let loose = SvgfSettings {
            sigma_luminance: 1e4,
            ..PAPER
        };
        let mut image = Image::new(size, |at| SvgfScalar {
            value: noise(at, 7),
            variance: 1.0 / 12.0,
        });
        for i in 0..2 {
            image = pass(&image, 1 << i, loose, wall);
            let inner: Vec<_> = everywhere(size)
                .filter(|p| p.min_element() >= 8 && p.max_element() < 88)
                .map(|p| image.at(p))
                .collect();
            let n = inner.len() as f64;
            let real = inner
                .iter()
                .map(|s| (f64::from(s.value) - 0.5).powi(2))
                .sum::<f64>()
                / n;
            let said = inner.iter().map(|s| f64::from(s.variance)).sum::<f64>() / n;
            println!("pass {i}: variance {real:.6}, estimated {said:.6}");
            if i == 0 {
                // (70/256)², the spline's sum of squares.
                assert!((said * 12.0 - 0.074_768).abs() < 1e-4);
                assert!((real / said - 1.0).abs() < 0.1, "{real} {said}");
            } else {
                // Neighbours are no longer independent: an underestimate.
                assert!(real > said && real < 4.0 * said, "{real} {said}");
            }
        }
        let all = filtered(
            Image::new(size, |at| SvgfScalar {
                value: noise(at, 7),
                variance: 1.0 / 12.0,
            }),
            PAPER,
            wall,
        );
        let left = all
            .1
            .iter()
            .map(|s| (f64::from(s.value) - 0.5).powi(2))
            .sum::<f64>()
            / (96.0 * 96.0)
            * 12.0;
        println!("the paper's five passes leave {left:.5} of the variance");
        assert!(left < 0.01);
    }

    #[test]
    fn the_spatial_variance_is_that_of_the_noise() {
        let size = UVec2::splat(256);
        let read = |at| SvgfScalar {
            value: 1000.0 + noise(at, 7),
            variance: 0.0,
        };
        let mut mean = 0.0;
        for at in everywhere(size) {
            mean += f64::from(svgf_variance_scalar_pixel(at, size, 3.0, PAPER, wall, read));
            // A long history's own variance stands.
            let known = svgf_variance_scalar_pixel(at, size, 4.0, PAPER, wall, read);
            assert_eq!(known, 0.0);
        }
        mean /= 256.0 * 256.0;
        println!("spatial variance over true: {:.4}", mean * 12.0);
        // The biased form, over n instead of n - 1, is 2 % below.
        assert!((mean * 12.0 - 1.0).abs() < 0.01);
    }

    #[test]
    fn edges_stop_it() {
        // Left black, right white; apart in depth, turned away, or known well.
        for kind in 0..3 {
            let surface = |at: UVec2| match (kind, at.x < 24) {
                (0, false) => SvgfSurface {
                    position: wall(at).position + Vec3::Z * 2.0,
                    ..wall(at)
                },
                (1, false) => SvgfSurface {
                    normal: Vec3::X,
                    ..wall(at)
                },
                _ => wall(at),
            };
            let image = Image::new(SIZE, |at| SvgfScalar {
                value: f32::from(u8::from(at.x >= 24)),
                variance: if kind == 2 { 1e-6 } else { 100.0 },
            });
            for (at, out) in everywhere(SIZE).zip(&filtered(image, PAPER, surface).1) {
                let want = f32::from(u8::from(at.x >= 24));
                assert!(
                    (out.value - want).abs() < 1e-6,
                    "{kind} {at}: {}",
                    out.value
                );
            }
        }
    }

    // Below: what known implementations get wrong. Each test shows the wrong
    // form failing the property that ours has.

    #[test]
    fn trap_the_exponential_taken_twice() {
        let ours = |far: f32| svgf_depth_weight(Vec3::Z, Vec3::Z * far, 1.0);
        let twice = |far: f32| (-(-far).exp()).exp();
        let falls = |w: &dyn Fn(f32) -> f32| {
            w(0.0) == 1.0 && (0..100).all(|i| w(i as f32 * 0.1 + 0.1) < w(i as f32 * 0.1))
        };
        assert!(falls(&ours));
        assert!(!falls(&twice) && (twice(0.0) - 0.3679).abs() < 1e-4 && twice(10.0) > 0.9999);
    }

    #[test]
    fn trap_the_gradient_at_a_grazing_angle() {
        // A floor 1.5 m below the camera, 60° over 1080 rows; 32 rows farther.
        let row = |slope: f32| slope / ((30f32.to_radians()).tan() / 540.0);
        for (slope, printed) in [(0.05, 0.042), (0.1, 0.219), (0.2, 0.299)] {
            let depth = |rows: f32| 1.5 * row(1.0) / rows;
            let at = row(slope);
            let gradient = 0.5 * (depth(at + 0.5) - depth(at - 0.5)).abs() * 2.0;
            let difference = depth(at - 32.0) - depth(at);
            let paper = (-difference / (gradient * 32.0)).exp();
            assert!((paper - printed).abs() < 0.01, "{slope}: {paper}");
            let ours = svgf_depth_weight_gradient(
                difference,
                depth(at),
                Vec2::new(0.0, gradient),
                Vec2::new(0.0, 32.0),
                1.0,
            );
            assert!(ours < 0.45, "{ours}");
            // The same two points, by their distance from the floor's plane.
            let plane =
                svgf_depth_weight(Vec3::Y, Vec3::new(0.0, 0.0, difference), 0.001 * depth(at));
            assert_eq!(plane, 1.0);
        }
    }

    #[test]
    fn trap_a_wall_that_faces_the_camera() {
        // Gradient 0, and depth known to one part in 4096 (f16).
        let (depth, difference) = (10.0f32, 10.0 / 4096.0);
        let absolute = (-difference / (0.0f32.max(1e-8) * 2.0)).exp();
        assert_eq!(absolute, 0.0);
        let ours = svgf_depth_weight_gradient(difference, depth, Vec2::ZERO, Vec2::ONE, 1.0);
        assert!(ours > 0.7, "{ours}");
    }

    #[test]
    fn trap_an_absolute_epsilon() {
        let ours = |k: f32| {
            svgf_luminance_weight(
                2e-4 * k,
                svgf_luminance_scale(1e-10 * k * k, 0.5 * k, PAPER.sigma_luminance),
            )
        };
        let absolute = |k: f32| (-(2e-4 * k) / (4.0 * (1e-10 * k * k).sqrt() + 1e-4)).exp();
        let k = 2f32.powi(10);
        assert_eq!(ours(k), ours(1.0));
        assert!(absolute(1.0) > 0.1 && absolute(k) < 0.05);
    }

    #[test]
    fn trap_squared_weights_on_moments() {
        // Four equal taps of luminance 1: a moment must stay 1, a variance falls
        // to a quarter.
        let w = [0.25f32; 4];
        assert_eq!(w.iter().map(|w| w * w * 1.0).sum::<f32>(), 0.25);
        let image = Image::new(SIZE, |_| SvgfScalar {
            value: 1.0,
            variance: 1.0,
        });
        let out = pass(&image, 1, PAPER, wall).at(UVec2::splat(20));
        assert_eq!(out.value, 1.0);
        assert!((out.variance - 0.074_768).abs() < 1e-6);
    }

    #[test]
    fn trap_variance_filtered_like_a_value() {
        // The weighted mean of the variances claims that filtering gains
        // nothing: 13 times what is left of independent noise.
        let size = UVec2::splat(64);
        let image = Image::new(size, |at| SvgfScalar {
            value: noise(at, 1),
            variance: 1.0 / 12.0,
        });
        let loose = SvgfSettings {
            sigma_luminance: 1e4,
            ..PAPER
        };
        let out = pass(&image, 1, loose, wall);
        let real = out
            .1
            .iter()
            .map(|s| (f64::from(s.value) - 0.5).powi(2))
            .sum::<f64>()
            / (64.0 * 64.0);
        let linear = 1.0 / 12.0;
        assert!(linear / real > 10.0);
        let ours = out.1.iter().map(|s| f64::from(s.variance)).sum::<f64>() / (64.0 * 64.0);
        assert!((ours / real - 1.0).abs() < 0.15, "{ours} {real}");
    }

    #[test]
    fn trap_moments_that_cancel() {
        // The mean of squares less the squared mean, on a constant.
        let false_sigma = |c: f32| {
            let (mut first, mut second) = (0.0f32, 0.0f32);
            for _ in 0..49 {
                first += c / 49.0;
                second += c * c / 49.0;
            }
            second - first * first
        };
        assert!(
            [0.1f32, 3.3, 1000.1, 65000.0]
                .iter()
                .any(|c| false_sigma(*c).abs() > 0.1)
        );
        assert!(
            [0.1f32, 3.3, 1000.1, 65000.0]
                .iter()
                .any(|c| false_sigma(*c) < 0.0)
        );
        for c in [0.1f32, 3.3, 1000.1, 65000.0] {
            let read = |_| SvgfScalar {
                value: c,
                variance: 1.0,
            };
            let at = UVec2::splat(10);
            assert_eq!(
                svgf_variance_scalar_pixel(at, SIZE, 0.0, PAPER, wall, read),
                0.0
            );
        }
    }

    #[test]
    fn trap_a_cosine_above_one() {
        let (mut above, mut worst) = (0, 0.0f32);
        for i in 0..10_000 {
            let at = UVec2::new(i, 7);
            let z = 1.0 - 2.0 * noise(at, 0);
            let (s, c) = (std::f32::consts::TAU * noise(at, 1)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let n = Vec3::new(r * c, r * s, z);
            assert_eq!(svgf_normal_weight(n, n, 7), 1.0);
            let plain = (0..7).fold(vec3_dot(n, n).max(0.0), |c, _| c * c);
            above += u32::from(plain > 1.0);
            worst = worst.max((plain - 1.0).abs());
        }
        println!("squared cosines: {above} of 10000 above 1, off by up to {worst:e}");
        assert!(above > 100 && worst > 1e-5);
    }

    #[test]
    fn trap_zero_times_nan() {
        let taps = [(1.0f32, 2.0f32), (0.0, f32::NAN)];
        let naive: f32 = taps.iter().map(|(w, c)| w * c).sum();
        assert!(naive.is_nan());
        let behind = UVec2::new(21, 20);
        let surface = |at: UVec2| SvgfSurface {
            position: wall(at).position + Vec3::Z * if at == behind { 1e6 } else { 0.0 },
            ..wall(at)
        };
        let read = |at| SvgfScalar {
            value: if at == behind { f32::NAN } else { 2.0 },
            variance: 1.0,
        };
        let out = svgf_atrous_scalar_pixel(UVec2::splat(20), SIZE, 1, PAPER, surface, read);
        assert_eq!(out.value, 2.0);
    }

    #[test]
    fn trap_a_negative_variance() {
        let naive = 4.0 * (-1e-3f32).sqrt();
        assert!(naive.is_nan());
        assert_eq!(svgf_luminance_scale(-1e-3, 0.0, 4.0), 0.0);
        let read = |at| SvgfScalar {
            value: noise(at, 0),
            variance: -0.5,
        };
        let out = svgf_atrous_scalar_pixel(UVec2::splat(20), SIZE, 1, PAPER, wall, read);
        assert!(out.value.is_finite() && out.variance == 0.0);
    }

    #[test]
    fn trap_a_border_that_darkens() {
        // Taps outside read as 0, with the divisor of the whole kernel.
        let naive: f32 = (-2..=2)
            .flat_map(|y| (0..=2).map(move |x| svgf_spline(x) * svgf_spline(y)))
            .sum();
        assert!(naive < 0.7);
        let read = |_| SvgfScalar {
            value: 1.0,
            variance: 1.0,
        };
        let out = svgf_atrous_scalar_pixel(UVec2::new(0, 20), SIZE, 1, PAPER, wall, read);
        assert_eq!(out.value, 1.0);
    }

    #[test]
    fn a_farther_surface_never_weighs_more() {
        let gradient = Vec2::new(0.25, -0.5);
        let weights: [&dyn Fn(f32) -> f32; 2] = [
            &|far| svgf_depth_weight(Vec3::Z, Vec3::new(3.0, -2.0, far), 0.05),
            &|far| svgf_depth_weight_gradient(far, 2.0, gradient, Vec2::new(0.5, 0.25), 1.0),
        ];
        for weight in weights {
            let mut last = weight(0.0);
            assert_eq!(last, 1.0);
            for i in 1..2000 {
                let w = weight(i as f32 * 0.005);
                assert!(w <= last && w == weight(i as f32 * -0.005));
                last = w;
            }
            assert!(last < 1e-20, "{last}");
        }
    }

    /// A coordinate in `[-1, 1]` as a signed number of so many bits holds it.
    fn quantised(x: f32, bits: i32) -> f32 {
        let most = 2f32.powi(bits - 1) - 1.0;
        (x * most).round() / most
    }

    #[test]
    fn trap_quantised_normals() {
        use crate::math::octahedral::{octahedral_decode, octahedral_encode};
        let mut least = [1.0f32; 4];
        let mut plain = [1.0f32; 2];
        for i in 0..40_000 {
            let at = UVec2::new(i, 3);
            let z = 1.0 - 2.0 * noise(at, 0);
            let (s, c) = (std::f32::consts::TAU * noise(at, 1)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let n = Vec3::new(r * c, r * s, z);
            // A neighbour a thousandth of a radian aside.
            let side = n.any_orthonormal_vector();
            let near = (n + 1e-3 * side).normalize();
            let octahedral = |n: Vec3, bits| {
                let p = octahedral_encode(n);
                octahedral_decode(Vec2::new(quantised(p.x, bits), quantised(p.y, bits)))
            };
            for (worst, bits) in least.iter_mut().zip([8, 10, 12, 16]) {
                let (a, b) = (octahedral(n, bits), octahedral(near, bits));
                *worst = worst.min(svgf_normal_weight(a, b, 7));
            }
            // Three components, not normalised again: the cosine's power gives
            // even two equal ones little, ours all.
            for (worst, bits) in plain.iter_mut().zip([8, 10]) {
                let a = Vec3::from_array(n.to_array().map(|x| quantised(x, bits)));
                *worst = worst.min((0..7).fold(vec3_dot(a, a), |c, _| c * c));
                assert_eq!(svgf_normal_weight(a, a, 7), 1.0);
            }
        }
        println!("octahedral, 8 10 12 16 bits: {least:?}; three plain, 8 10: {plain:?}");
        // Exact normals have 0.99994.
        for (least, want) in least.into_iter().zip([0.976, 0.9985, 0.9996, 0.9999]) {
            assert!((want..want + 1e-3).contains(&least), "{least}");
        }
        assert!(plain[0] < 0.25 && plain[1] < 0.7, "{plain:?}");
    }

    #[test]
    fn trap_zero_to_the_power_of_zero() {
        use crate::math::exponent::pow_poly;
        // As WGSL defines it, and what the cosine of a right angle gives there.
        let naive = |x: f32, y: f32| (y * x.log2()).exp2();
        assert!(naive(0.0, 0.0).is_nan());
        assert_eq!(pow_poly(0.0, 0.0), 1.0);
        // The weight of normals is made without a power.
        for squarings in 0..=16 {
            assert_eq!(svgf_normal_weight(Vec3::X, Vec3::Y, squarings), 0.0);
            let w = svgf_weight(Vec3::X, Vec3::Y, Vec3::ZERO, 1.0, 0.0, 0.0, squarings);
            assert_eq!(w, 0.0);
        }
    }
}
