//! A stack of 1 to 4 layers over a diffuse base: clear coat, tinted varnish,
//! metal or dielectric, paint.
//!
//! Each layer is a rough interface with its own Fresnel reflectance, and below
//! it a medium that absorbs; under the last interface lies a Lambertian base
//! (black under a metal). Light reflects once, at one interface or at the
//! base, and is refracted and attenuated on its way there and back: Weidlich
//! and Wilkie, *Arbitrarily Layered Micro-Facet Surfaces*, GRAPHITE 2007, with
//! three differences.
//!
//! - Directions are refracted about the geometric normal, once per interface,
//!   and not about a microfacet's: the value is reciprocal and has no choice
//!   to make.
//! - The solid angle that an interface compresses is accounted for: 1/η² in
//!   the value, cos θ / (η² cos θ') in the density. Without it the paper's
//!   model gains energy and its density is not one.
//! - What an interface lets through is one minus what it reflects as a whole,
//!   its directional albedo ([`layered_reflectance`]), not one minus the
//!   Fresnel term of one direction; so no stack reflects more than it gets.
//!
//! Between interfaces light does not bounce, except that [`layered_diffuse`]
//! sums the reflections between base and last interface in closed form, once
//! per material.
//!
//! Vectors are in the shading frame, normal = +z, both directions point away
//! from the surface. The number of layers is a constant of the type (in WGSL
//! of the linked program): a material of one layer pays for one. Nothing here
//! is random beyond `u`.

use glam::{Vec2, Vec3};

use super::fresnel::fresnel_schlick;
use super::ggx::{ggx_d_between, ggx_reflect, ggx_visibility};
use super::ggx_bounded::{ggx_bounded_direction_pdf, ggx_bounded_sample};
use super::medium::medium_transmittance;
use crate::math::luminance::luminance;
use crate::math::vector::vec3_length;
use crate::sample::hemisphere::{hemisphere_cosine_pdf, hemisphere_cosine_sample};

/// 1/π.
const INV_PI: f32 = 0.31830987;

/// A rough interface and the medium under it.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::fresnel::fresnel_f0;
/// use raytwin_cpu::brdf::ggx::ggx_alpha;
/// use raytwin_cpu::brdf::layered::{LayeredLayer, layered_reflectance};
///
/// // Clear coat: a smooth dielectric over a medium that absorbs nothing.
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(fresnel_f0(1.5)),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: ggx_alpha(0.1, 0.0),
/// };
/// assert!((layered_reflectance(coat, 1.0).x - 0.04).abs() < 1e-3);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct LayeredLayer {
    /// Reflectance at normal incidence, in `[0, 1]`: from `fresnel_f0` for a
    /// dielectric, a colour for a metal.
    pub reflectance: Vec3,
    /// Refractive index of the medium below over that above, at least 1. What
    /// is under a metal is never seen: 1 will do.
    pub eta: f32,
    /// Optical depth of the medium below when crossed straight: absorption
    /// coefficient times thickness, at least 0.
    pub depth: Vec3,
    /// GGX roughness along x and y, at least `GGX_ALPHA_MIN`.
    pub alpha: Vec2,
}

/// `N` layers, the outermost first, over a Lambertian base.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::fresnel::fresnel_f0;
/// use raytwin_cpu::brdf::ggx::ggx_alpha;
/// use raytwin_cpu::brdf::layered::{
///     LayeredLayer, LayeredStack, layered_diffuse, layered_eval,
/// };
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(fresnel_f0(1.5)),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: ggx_alpha(0.1, 0.0),
/// };
/// // Red paint under clear coat.
/// let paint = Vec3::new(0.7, 0.05, 0.05);
/// let stack =
///     LayeredStack { layers: [coat], diffuse: layered_diffuse(paint, coat) };
/// let seen = layered_eval(&stack, Vec3::new(0.6, 0.0, 0.8), Vec3::Z);
/// assert!(seen.x > seen.y);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct LayeredStack<const N: usize> {
    /// From the outside in.
    pub layers: [LayeredLayer; N],
    /// Albedo of the base as [`layered_diffuse`] makes it; black for a metal.
    pub diffuse: Vec3,
}

/// How probable each lobe is.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{LayeredLayer, LayeredStack, layered_pmf};
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.1),
/// };
/// let stack = LayeredStack { layers: [coat], diffuse: Vec3::splat(0.5) };
/// let pmf = layered_pmf(&stack, Vec3::Z);
/// assert!((pmf.layers[0] + pmf.diffuse - 1.0).abs() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct LayeredPmf<const N: usize> {
    /// Of each interface.
    pub layers: [f32; N],
    /// Of the base.
    pub diffuse: f32,
}

/// What [`layered_sample`] drew.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{
///     LayeredLayer, LayeredStack, layered_sample,
/// };
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.1),
/// };
/// let stack = LayeredStack { layers: [coat], diffuse: Vec3::splat(0.5) };
/// // A large `u.z` draws the base, which is numbered after the layers.
/// let drawn = layered_sample(&stack, Vec3::Z, Vec3::new(0.3, 0.8, 0.9));
/// assert_eq!(drawn.lobe, 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct LayeredSample {
    /// Toward the light; unit.
    pub direction: Vec3,
    /// Density of the direction under the whole stack, per steradian; 0 if
    /// the sample is to be dropped.
    pub pdf: f32,
    /// Value · cosine / density; black if the sample is to be dropped.
    pub weight: Vec3,
    /// The lobe that drew it: the layer's number, or their count for the base.
    pub lobe: u32,
}

/// What GGX of this roughness reflects of light from direction `cos` if its
/// Fresnel term is `(1 - wo·h)⁵`: the second of the two numbers by which a
/// Schlick interface's albedo is `f0 · A + B`.
///
/// `x⁵ / ((1 + 8α)⁻² + 19 α x²)` with `x = 1 - cos`: our own fit to quadrature
/// in double precision, made to err upward: never more than 5.3e-4 below, and
/// above by up to 0.16 at the horizon of smooth surfaces (α = 0.03), 0.06 at
/// α = 0.1 and 0.02 from α = 0.2 on. `cos` in `[0, 1]`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::brdf::layered::layered_grazing;
///
/// // None straight on, all of it along a surface.
/// let alpha = Vec2::splat(0.1);
/// assert_eq!(layered_grazing(1.0, alpha), 0.0);
/// assert!(layered_grazing(0.05, alpha) > layered_grazing(0.5, alpha));
/// ```
#[inline]
#[must_use]
pub fn layered_grazing(cos: f32, alpha: Vec2) -> f32 {
    let a = (alpha.x * alpha.y).sqrt();
    let x = 1.0 - cos;
    let x2 = x * x;
    let root = 1.0 + 8.0 * a;
    let q = root * root;
    (x2 * x2 * x) * q / (1.0 + 19.0 * (a * x2 * q))
}

/// The part of the light from a direction that an interface reflects, as an
/// upper bound: `f0 + (1 - f0) · layered_grazing`. One minus this goes through.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{LayeredLayer, layered_reflectance};
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.1),
/// };
/// assert_eq!(layered_reflectance(coat, 1.0), coat.reflectance);
/// assert!(layered_reflectance(coat, 0.1).x > 0.3);
/// ```
#[inline]
#[must_use]
pub fn layered_reflectance(layer: LayeredLayer, cos: f32) -> Vec3 {
    let g = layered_grazing(cos, layer.alpha);
    let f = layer.reflectance;
    Vec3::new(
        f.x + (1.0 - f.x) * g,
        f.y + (1.0 - f.y) * g,
        f.z + (1.0 - f.z) * g,
    )
}

/// A direction above an interface as it goes on below, turned so that it still
/// points up: Snell's law about the normal. `eta >= 1`, so it always exists.
///
/// `z = √(η² - 1 + z²) / η` is a sum of positive terms; `√(1 - x² - y²)` would
/// cancel at the horizon.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::layered::layered_refract;
///
/// // Under glass a direction is steeper: the sine is divided by 1.5.
/// let below = layered_refract(Vec3::new(0.6, 0.0, 0.8), 1.5);
/// assert!((below.x - 0.4).abs() < 1e-6);
/// assert!((below.length() - 1.0).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn layered_refract(w: Vec3, eta: f32) -> Vec3 {
    let z = ((eta - 1.0) * (eta + 1.0) + w.z * w.z).sqrt();
    Vec3::new(w.x / eta, w.y / eta, z / eta)
}

/// Albedo of a Lambertian base under an interface, with the light that the
/// interface throws back at it again and again: `ρ / (1 - ρ r)`.
///
/// `r` is what the interface reflects of diffuse light from below,
/// `1 - (1 - f0)(1 - b) / η²` (from reciprocity), and `b = 1/(21 + 175 α)` a
/// lower bound of the hemispherical mean of [`layered_grazing`], exact (1/21)
/// for a smooth one. To be called once per material.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{LayeredLayer, layered_diffuse};
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.1),
/// };
/// // The light thrown back by the coat makes bright paint brighter.
/// let base = layered_diffuse(Vec3::new(0.8, 0.1, 0.0), coat);
/// assert!(base.x > 0.8 && base.y > 0.1 && base.z == 0.0);
/// ```
#[inline]
#[must_use]
pub fn layered_diffuse(albedo: Vec3, layer: LayeredLayer) -> Vec3 {
    let a = (layer.alpha.x * layer.alpha.y).sqrt();
    let through = (1.0 - 1.0 / (21.0 + 175.0 * a)) / (layer.eta * layer.eta);
    let f = layer.reflectance;
    Vec3::new(
        albedo.x / (1.0 - albedo.x * (1.0 - (1.0 - f.x) * through)),
        albedo.y / (1.0 - albedo.y * (1.0 - (1.0 - f.y) * through)),
        albedo.z / (1.0 - albedo.z * (1.0 - (1.0 - f.z) * through)),
    )
}

/// What goes through an interface and its medium both ways, over η².
#[inline]
fn layered_through(layer: LayeredLayer, o: Vec3, i: Vec3, below_o: Vec3, below_i: Vec3) -> Vec3 {
    let ro = layered_reflectance(layer, o.z);
    let ri = layered_reflectance(layer, i.z);
    let path = 1.0 / below_o.z + 1.0 / below_i.z;
    let t = medium_transmittance(layer.depth, path);
    let scale = 1.0 / (layer.eta * layer.eta);
    Vec3::new(
        (1.0 - ro.x) * (1.0 - ri.x) * (t.x * scale),
        (1.0 - ro.y) * (1.0 - ri.y) * (t.y * scale),
        (1.0 - ro.z) * (1.0 - ri.z) * (t.z * scale),
    )
}

/// The stack's BRDF, per steradian, without the cosine; 0 if either direction
/// is at or below the horizon. Reciprocal.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{LayeredLayer, LayeredStack, layered_eval};
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.3),
/// };
/// let stack = LayeredStack { layers: [coat], diffuse: Vec3::splat(0.5) };
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = Vec3::new(-0.48, 0.36, 0.8);
/// // Light and viewer may be exchanged.
/// let there = layered_eval(&stack, wo, wi);
/// let back = layered_eval(&stack, wi, wo);
/// assert!((there - back).length() < 1e-5 * there.length());
/// ```
#[inline]
#[must_use]
pub fn layered_eval<const N: usize>(stack: &LayeredStack<N>, wo: Vec3, wi: Vec3) -> Vec3 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return Vec3::ZERO;
    }
    let mut o = wo;
    let mut i = wi;
    let mut through = Vec3::ONE;
    let mut sum = Vec3::ZERO;
    for layer in stack.layers {
        let m = Vec3::new(o.x + i.x, o.y + i.y, o.z + i.z);
        // Half the length of the sum is the cosine to the half vector.
        let f = fresnel_schlick(layer.reflectance, 0.5 * vec3_length(m));
        let dv = ggx_d_between(o, i, layer.alpha) * ggx_visibility(o, i, layer.alpha);
        sum = Vec3::new(
            sum.x + through.x * (f.x * dv),
            sum.y + through.y * (f.y * dv),
            sum.z + through.z * (f.z * dv),
        );
        let below_o = layered_refract(o, layer.eta);
        let below_i = layered_refract(i, layer.eta);
        let t = layered_through(layer, o, i, below_o, below_i);
        through = Vec3::new(through.x * t.x, through.y * t.y, through.z * t.z);
        o = below_o;
        i = below_i;
    }
    Vec3::new(
        sum.x + through.x * (stack.diffuse.x * INV_PI),
        sum.y + through.y * (stack.diffuse.y * INV_PI),
        sum.z + through.z * (stack.diffuse.z * INV_PI),
    )
}

/// Probability of each lobe for a view direction: its approximate visibility,
/// that is the luminance of what gets there and is reflected.
///
/// Depends on `wo` alone, so the density of a direction is a plain sum.
/// `wo.z > 0`. If nothing reflects, the base takes all.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{LayeredLayer, LayeredStack, layered_pmf};
///
/// let metal = LayeredLayer {
///     reflectance: Vec3::splat(0.9),
///     eta: 1.0,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.1),
/// };
/// let stack = LayeredStack { layers: [metal], diffuse: Vec3::ZERO };
/// // Nothing lies under a metal, so it is always drawn.
/// let pmf = layered_pmf(&stack, Vec3::Z);
/// assert_eq!((pmf.layers[0], pmf.diffuse), (1.0, 0.0));
/// ```
#[inline]
#[must_use]
pub fn layered_pmf<const N: usize>(stack: &LayeredStack<N>, wo: Vec3) -> LayeredPmf<N> {
    let mut layers = [0.0; N];
    let mut total = 0.0;
    let mut o = wo;
    let mut through = Vec3::ONE;
    for (layer, weight) in stack.layers.into_iter().zip(&mut layers) {
        let r = layered_reflectance(layer, o.z);
        let w = luminance(Vec3::new(through.x * r.x, through.y * r.y, through.z * r.z));
        *weight = w;
        total += w;
        let below = layered_refract(o, layer.eta);
        let t = medium_transmittance(layer.depth, 2.0 / below.z);
        let scale = 1.0 / (layer.eta * layer.eta);
        through = Vec3::new(
            through.x * ((1.0 - r.x) * (t.x * scale)),
            through.y * ((1.0 - r.y) * (t.y * scale)),
            through.z * ((1.0 - r.z) * (t.z * scale)),
        );
        o = below;
    }
    let base = luminance(Vec3::new(
        through.x * stack.diffuse.x,
        through.y * stack.diffuse.y,
        through.z * stack.diffuse.z,
    ));
    total += base;
    if total <= 0.0 {
        return LayeredPmf {
            layers: [0.0; N],
            diffuse: 1.0,
        };
    }
    LayeredPmf {
        layers: layers.map(|w| w / total),
        diffuse: base / total,
    }
}

/// Density of a direction under the whole stack, per steradian: the sum over
/// the lobes, each probability times its density, whichever lobe drew it. 0 if
/// either direction is at or below the horizon.
///
/// It integrates to one less the samples that [`layered_sample`] drops.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{
///     LayeredLayer, LayeredStack, layered_pdf, layered_sample,
/// };
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.3),
/// };
/// let stack = LayeredStack { layers: [coat], diffuse: Vec3::splat(0.5) };
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let drawn = layered_sample(&stack, wo, Vec3::new(0.3, 0.8, 0.9));
/// assert_eq!(drawn.pdf, layered_pdf(&stack, wo, drawn.direction));
/// assert_eq!(layered_pdf(&stack, wo, Vec3::NEG_Z), 0.0);
/// ```
#[inline]
#[must_use]
pub fn layered_pdf<const N: usize>(stack: &LayeredStack<N>, wo: Vec3, wi: Vec3) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let pmf = layered_pmf(stack, wo);
    let mut o = wo;
    let mut i = wi;
    let mut jacobian = 1.0;
    let mut sum = pmf.diffuse * hemisphere_cosine_pdf(wi);
    for (layer, p) in stack.layers.into_iter().zip(pmf.layers) {
        sum += p * (jacobian * ggx_bounded_direction_pdf(o, i, layer.alpha));
        let below = layered_refract(i, layer.eta);
        jacobian *= i.z / (layer.eta * layer.eta * below.z);
        o = layered_refract(o, layer.eta);
        i = below;
    }
    sum
}

/// Draws a direction: chooses a lobe by `u.z` and its direction by `u.xy`.
///
/// A layer's microfacet normal is drawn from the bounded visible ones, the
/// reflected direction is refracted out through the layers above. Where it
/// lies below the horizon or is reflected back inside, the sample is dropped:
/// `pdf` and `weight` are 0 and `direction` is +z. The base is drawn by the
/// cosine outside, which drops nothing.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::layered::{
///     LayeredLayer, LayeredStack, layered_eval, layered_sample,
/// };
///
/// let coat = LayeredLayer {
///     reflectance: Vec3::splat(0.04),
///     eta: 1.5,
///     depth: Vec3::ZERO,
///     alpha: Vec2::splat(0.3),
/// };
/// let stack = LayeredStack { layers: [coat], diffuse: Vec3::splat(0.5) };
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let drawn = layered_sample(&stack, wo, Vec3::new(0.3, 0.8, 0.9));
/// // The weight is value · cosine / density.
/// let value = layered_eval(&stack, wo, drawn.direction);
/// let weight = value * drawn.direction.z / drawn.pdf;
/// assert!((drawn.weight - weight).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn layered_sample<const N: usize>(stack: &LayeredStack<N>, wo: Vec3, u: Vec3) -> LayeredSample {
    let none = LayeredSample {
        direction: Vec3::Z,
        pdf: 0.0,
        weight: Vec3::ZERO,
        lobe: N as u32,
    };
    if wo.z <= 0.0 {
        return none;
    }
    let pmf = layered_pmf(stack, wo);
    let mut lobe = 0;
    let mut below = pmf.layers[0];
    while lobe < N && u.z >= below {
        lobe += 1;
        if lobe < N {
            below += pmf.layers[lobe];
        }
    }
    let mut direction = hemisphere_cosine_sample(Vec2::new(u.x, u.y));
    if lobe < N {
        let mut o = wo;
        for layer in &stack.layers[..lobe] {
            o = layered_refract(o, layer.eta);
        }
        let h = ggx_bounded_sample(Vec2::new(u.x, u.y), o, stack.layers[lobe].alpha);
        direction = ggx_reflect(o, h);
        let mut k = lobe;
        while k > 0 {
            k -= 1;
            let eta = stack.layers[k].eta;
            let s = eta * direction.z;
            let square = s * s - (eta - 1.0) * (eta + 1.0);
            // Otherwise reflected back inside.
            let leaves = direction.z > 0.0 && square > 0.0;
            let z = if leaves { square.sqrt() } else { -1.0 };
            direction = Vec3::new(eta * direction.x, eta * direction.y, z);
        }
    }
    if direction.z <= 0.0 {
        return LayeredSample {
            lobe: lobe as u32,
            ..none
        };
    }
    let pdf = layered_pdf(stack, wo, direction);
    let f = layered_eval(stack, wo, direction);
    let scale = if pdf > 0.0 { direction.z / pdf } else { 0.0 };
    LayeredSample {
        direction,
        pdf,
        weight: Vec3::new(f.x * scale, f.y * scale, f.z * scale),
        lobe: lobe as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plastic(alpha: f32) -> LayeredStack<1> {
        let coat = LayeredLayer {
            reflectance: Vec3::splat(0.04),
            eta: 1.5,
            depth: Vec3::ZERO,
            alpha: Vec2::splat(alpha),
        };
        LayeredStack {
            layers: [coat],
            diffuse: layered_diffuse(Vec3::ONE, coat),
        }
    }

    /// What the stack reflects of a uniform sky, by its own sampler.
    fn albedo<const N: usize>(stack: &LayeredStack<N>, wo: Vec3) -> f64 {
        const SIDE: u32 = 512;
        let mut sum = 0.0;
        for i in 0..SIDE * SIDE {
            let at = |k: u32| (k as f32 + 0.5) / SIDE as f32;
            // The lobe by a golden-ratio walk over the grid.
            let w = (i as f32 * 0.618_034).fract();
            let s = layered_sample(stack, wo, Vec3::new(at(i % SIDE), at(i / SIDE), w));
            sum += f64::from(s.weight.y);
        }
        sum / f64::from(SIDE * SIDE)
    }

    #[test]
    fn the_fit_errs_upward() {
        use crate::brdf::cook_torrance::cook_torrance_weight_visible;
        use crate::brdf::ggx::ggx_reflect;
        use crate::brdf::ggx_visible::ggx_visible_sample;
        const SIDE: u16 = 128;
        let at = |k: u16| (f32::from(k) + 0.5) / f32::from(SIDE);
        for (alpha, above) in [
            (0.003, 0.16),
            (0.01, 0.16),
            (0.03, 0.16),
            (0.1, 0.06),
            (0.2, 0.02),
            (0.5, 0.02),
            (1.0, 0.02),
        ] {
            for cos in [0.005f32, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0] {
                let wo = Vec3::new(((1.0 - cos) * (1.0 + cos)).sqrt(), 0.0, cos);
                let alpha = Vec2::splat(alpha);
                // With f0 = 0 a sample's weight is the fifth power times G2/G1.
                let mut sum = 0.0;
                for i in 0..SIDE {
                    for j in 0..SIDE {
                        let h = ggx_visible_sample(Vec2::new(at(i), at(j)), wo, alpha);
                        let wi = ggx_reflect(wo, h);
                        sum += f64::from(cook_torrance_weight_visible(wo, wi, alpha, Vec3::ZERO).x);
                    }
                }
                let truth = sum / f64::from(SIDE).powi(2);
                let off = f64::from(layered_grazing(cos, alpha)) - truth;
                assert!(off > -6e-4 && off < above, "{alpha} {cos}: {off}");
            }
        }
    }

    #[test]
    fn white_plastic_reflects_everything_and_no_more() {
        for alpha in [0.02, 0.05, 0.1, 0.25, 0.5, 1.0] {
            for degrees in [0.0f32, 30.0, 60.0, 75.0, 85.0] {
                let (s, c) = degrees.to_radians().sin_cos();
                let a = albedo(&plastic(alpha), Vec3::new(s, 0.0, c));
                assert!(a <= 1.0, "{alpha} {degrees}: {a}");
                // Only single scattering is lost.
                assert!(a > 0.95, "{alpha} {degrees}: {a}");
            }
        }
    }
}
