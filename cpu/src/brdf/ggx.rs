//! The Trowbridge–Reitz (GGX) microfacet distribution: density, masking and
//! visibility, isotropic and anisotropic.
//!
//! Shading frame: normal = +z. `wo` points toward the viewer, `wi` toward the
//! light, both away from the surface; `alpha` is the roughness along x and y.
//!
//! Sources: Walter et al., *Microfacet Models for Refraction*, EGSR 2007;
//! Heitz, *Understanding the Masking-Shadowing Function*, JCGT 3(2), 2014.

use glam::{Vec2, Vec3};

use crate::math::vector::vec3_dot;

/// 1/π.
const INV_PI: f32 = 0.31830987;
/// Stands in for zero where something divides.
pub(crate) const GGX_TINY: f32 = 1e-30;

/// Smallest roughness that these functions take: with less, `D` at its peak
/// and its square leave the range that is safe in `f32`.
pub const GGX_ALPHA_MIN: f32 = 1e-4;

/// Below this roughness along both axes a surface is a mirror: one ray, no
/// density ([`ggx_is_mirror`]). The lobe is then narrower than 0.06°.
pub const GGX_MIRROR_ALPHA: f32 = 1e-3;

/// Roughness along x and y from perceptual roughness and anisotropy, both in
/// `[0, 1]`: `α = roughness²`, stretched by `√(1 - 0.9 anisotropy)` (Burley,
/// *Physically-Based Shading at Disney*, 2012), at least [`GGX_ALPHA_MIN`].
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::brdf::ggx::ggx_alpha;
///
/// assert_eq!(ggx_alpha(0.5, 0.0), Vec2::splat(0.25));
/// // Brushed metal: the highlight is longer along x.
/// let brushed = ggx_alpha(0.5, 0.8);
/// assert!(brushed.x > brushed.y);
/// ```
#[inline]
#[must_use]
pub fn ggx_alpha(roughness: f32, anisotropy: f32) -> Vec2 {
    let square = roughness * roughness;
    let aspect = (1.0 - 0.9 * anisotropy).sqrt();
    Vec2::new(
        (square / aspect).max(GGX_ALPHA_MIN),
        (square * aspect).max(GGX_ALPHA_MIN),
    )
}

/// 1 if the surface is to be treated as a mirror, else 0.
///
/// ```
/// use raytwin_cpu::brdf::ggx::{ggx_alpha, ggx_is_mirror};
///
/// assert_eq!(ggx_is_mirror(ggx_alpha(0.0, 0.0)), 1);
/// assert_eq!(ggx_is_mirror(ggx_alpha(0.1, 0.0)), 0);
/// ```
#[inline]
#[must_use]
pub fn ggx_is_mirror(alpha: Vec2) -> u32 {
    u32::from(alpha.x < GGX_MIRROR_ALPHA && alpha.y < GGX_MIRROR_ALPHA)
}

/// The half vector of two unit directions; +z if they are opposite.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::ggx::ggx_half;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let mirrored = Vec3::new(-0.6, 0.0, 0.8);
/// assert!((ggx_half(wo, mirrored) - Vec3::Z).length() < 1e-6);
/// assert_eq!(ggx_half(wo, -wo), Vec3::Z);
/// ```
#[inline]
#[must_use]
pub fn ggx_half(wo: Vec3, wi: Vec3) -> Vec3 {
    let m = Vec3::new(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let square = vec3_dot(m, m);
    if square < GGX_TINY {
        return Vec3::Z;
    }
    let scale = 1.0 / square.sqrt();
    Vec3::new(m.x * scale, m.y * scale, m.z * scale)
}

/// `wo` mirrored about `h`, `2 (wo·h) h - wo`: unit if both are.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::ggx::{ggx_half, ggx_reflect};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = ggx_reflect(wo, Vec3::Z);
/// assert!((wi - Vec3::new(-0.6, 0.0, 0.8)).length() < 1e-6);
/// // The half vector of the two is the normal again.
/// assert!((ggx_half(wo, wi) - Vec3::Z).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn ggx_reflect(wo: Vec3, h: Vec3) -> Vec3 {
    let k = 2.0 * vec3_dot(wo, h);
    Vec3::new(k * h.x - wo.x, k * h.y - wo.y, k * h.z - wo.z)
}

/// Density of microfacet normals: area per area of the surface and steradian;
/// 0 where `h.z <= 0`.
///
/// Error analysis: `1 / (π αx αy ((x/αx)² + (y/αy)² + z²)²)`, a sum of positive
/// terms. Rounded to nearest, a quotient has 1 unit of 2^-24, its square 3, the
/// sum 5, its square 11, with αx αy 13, divided 15 with that of 1/π: 9e-7 at
/// most, down to α = 1e-4. The usual `1 - (n·h)²` errs by 12 % at α = 0.001.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_d;
///
/// // The peak is 1/(π αx αy).
/// let peak = ggx_d(Vec3::Z, Vec2::new(0.1, 0.2));
/// assert!((peak * std::f32::consts::PI * 0.02 - 1.0).abs() < 1e-5);
/// assert_eq!(ggx_d(Vec3::NEG_Z, Vec2::splat(0.1)), 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_d(h: Vec3, alpha: Vec2) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let x = h.x / alpha.x;
    let y = h.y / alpha.y;
    let s = (x * x + y * y) + h.z * h.z;
    INV_PI / ((alpha.x * alpha.y) * (s * s))
}

/// [`ggx_d`] of the half vector of two directions, without normalising it:
/// cheaper than both, and with fewer roundings. 0 if the half vector points
/// below the surface or the directions are opposite.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::{ggx_d, ggx_d_between, ggx_half};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = Vec3::new(-0.48, 0.36, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let d = ggx_d(ggx_half(wo, wi), alpha);
/// assert!((ggx_d_between(wo, wi, alpha) / d - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn ggx_d_between(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    let m = Vec3::new(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let square = vec3_dot(m, m);
    if m.z <= 0.0 || square < GGX_TINY {
        return 0.0;
    }
    let x = m.x / alpha.x;
    let y = m.y / alpha.y;
    let k = square / ((x * x + y * y) + m.z * m.z);
    INV_PI * (k * k) / (alpha.x * alpha.y)
}

/// [`ggx_d`] with one roughness.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::{ggx_d, ggx_d_isotropic};
///
/// let h = Vec3::new(0.36, 0.48, 0.8);
/// let d = ggx_d(h, Vec2::splat(0.3));
/// assert!((ggx_d_isotropic(h, 0.3) / d - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn ggx_d_isotropic(h: Vec3, alpha: f32) -> f32 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let z = alpha * h.z;
    let p = (h.x * h.x + h.y * h.y) + z * z;
    INV_PI * (alpha * alpha) / (p * p)
}

/// Length of a direction as the stretched surface sees it,
/// `√((αx x)² + (αy y)² + z²)`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_stretched;
///
/// // Roughness 1 stretches nothing; along the normal none counts.
/// assert_eq!(ggx_stretched(Vec3::X, Vec2::ONE), 1.0);
/// assert_eq!(ggx_stretched(Vec3::X, Vec2::splat(0.25)), 0.25);
/// assert_eq!(ggx_stretched(Vec3::Z, Vec2::splat(0.25)), 1.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_stretched(w: Vec3, alpha: Vec2) -> f32 {
    let x = alpha.x * w.x;
    let y = alpha.y * w.y;
    ((x * x + y * y) + w.z * w.z).sqrt()
}

/// Area of the microfacets that face a direction, as seen from there and per
/// area of the surface: `(z + √((αx x)² + (αy y)² + z²)) / 2`.
///
/// From below the surface (`w.z < 0`) too, where that sum would cancel: there
/// the product with its conjugate is divided.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_projected_area;
///
/// // Seen from above, every microfacet counts with its projected area.
/// let alpha = Vec2::splat(0.3);
/// assert_eq!(ggx_projected_area(Vec3::Z, alpha), 1.0);
/// assert_eq!(ggx_projected_area(Vec3::X, alpha), 0.15);
/// assert_eq!(ggx_projected_area(Vec3::NEG_Z, alpha), 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_projected_area(w: Vec3, alpha: Vec2) -> f32 {
    let x = alpha.x * w.x;
    let y = alpha.y * w.y;
    let side = x * x + y * y;
    let length = (side + w.z * w.z).sqrt();
    if w.z >= 0.0 {
        return 0.5 * (w.z + length);
    }
    0.5 * side / (length - w.z)
}

/// Smith's Λ, the hidden area over the area of the surface as seen from `w`:
/// `(√(1 + α² tan² θ) - 1) / 2` above, and `Λ(-w) = 1 + Λ(w)`.
///
/// Computed as `side / (2 z (z + length))`, which does not cancel. `|w.z|` counts
/// as at least 1e-7, so the result is finite.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_lambda;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// assert_eq!(ggx_lambda(Vec3::Z, alpha), 0.0);
/// let (above, below) = (ggx_lambda(wo, alpha), ggx_lambda(-wo, alpha));
/// assert!((below - (1.0 + above)).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn ggx_lambda(w: Vec3, alpha: Vec2) -> f32 {
    let x = alpha.x * w.x;
    let y = alpha.y * w.y;
    let side = x * x + y * y;
    let z = w.z.abs().max(1e-7);
    let length = (side + z * z).sqrt();
    let up = side / (2.0 * z * (z + length));
    if w.z < 0.0 { 1.0 + up } else { up }
}

/// Smith's masking, `1 / (1 + Λ)`: the visible part of the surface. The same
/// from both sides, 0 along the surface.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_g1;
///
/// let alpha = Vec2::splat(0.3);
/// assert_eq!(ggx_g1(Vec3::Z, alpha), 1.0);
/// // The flatter the view, the more is hidden.
/// let flat = Vec3::new(0.98, 0.0, 0.199);
/// assert!(ggx_g1(flat, alpha) < ggx_g1(Vec3::new(0.6, 0.0, 0.8), alpha));
/// ```
#[inline]
#[must_use]
pub fn ggx_g1(w: Vec3, alpha: Vec2) -> f32 {
    let z = w.z.abs();
    2.0 * z / (z + ggx_stretched(w, alpha))
}

/// Height-correlated masking and shadowing, `1 / (1 + Λ(wo) + Λ(wi))`; both
/// directions above the surface.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::{ggx_g1, ggx_g2};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = Vec3::new(-0.48, 0.36, 0.8);
/// let alpha = Vec2::splat(0.3);
/// // More than were hiding and shadowing unrelated, less than either alone.
/// let g2 = ggx_g2(wo, wi, alpha);
/// assert!(g2 > ggx_g1(wo, alpha) * ggx_g1(wi, alpha));
/// assert!(g2 < ggx_g1(wo, alpha));
/// ```
#[inline]
#[must_use]
pub fn ggx_g2(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    let o = wi.z * ggx_stretched(wo, alpha);
    let i = wo.z * ggx_stretched(wi, alpha);
    2.0 * (wo.z * wi.z) / (o + i).max(GGX_TINY)
}

/// `G2 / (4 cos cos)`, that is `1 / (2 (cos_i |wo|ₛ + cos_o |wi|ₛ))`: finite
/// down to the horizon. Both directions above the surface.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::{ggx_g2, ggx_visibility};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = Vec3::new(-0.48, 0.36, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let textbook = ggx_g2(wo, wi, alpha) / (4.0 * wo.z * wi.z);
/// assert!((ggx_visibility(wo, wi, alpha) / textbook - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn ggx_visibility(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    let o = wi.z * ggx_stretched(wo, alpha);
    let i = wo.z * ggx_stretched(wi, alpha);
    0.5 / (o + i).max(GGX_TINY)
}

/// [`ggx_visibility`] with one roughness, from the two cosines.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::{ggx_visibility, ggx_visibility_isotropic};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = Vec3::new(-0.48, 0.36, 0.8);
/// let v = ggx_visibility(wo, wi, Vec2::splat(0.3));
/// assert!((ggx_visibility_isotropic(wo.z, wi.z, 0.3) / v - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn ggx_visibility_isotropic(cos_o: f32, cos_i: f32, alpha: f32) -> f32 {
    let a = alpha * alpha;
    let o = cos_i * (a * ((1.0 - cos_o) * (1.0 + cos_o)) + cos_o * cos_o).sqrt();
    let i = cos_o * (a * ((1.0 - cos_i) * (1.0 + cos_i)) + cos_i * cos_i).sqrt();
    0.5 / (o + i).max(GGX_TINY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_directions_have_a_half_vector() {
        let w = Vec3::new(0.6, 0.0, 0.8);
        assert_eq!(ggx_half(w, -w), Vec3::Z);
        assert_eq!(ggx_reflect(Vec3::Z, Vec3::Z), Vec3::Z);
    }

    #[test]
    fn nothing_below_and_nothing_infinite() {
        let least = Vec2::splat(GGX_ALPHA_MIN);
        assert_eq!(ggx_d(Vec3::X, least), 0.0);
        assert_eq!(ggx_d(-Vec3::Z, least), 0.0);
        assert!(ggx_d(Vec3::Z, least).is_finite());
        assert!(ggx_lambda(Vec3::X, Vec2::ONE).is_finite());
        assert!(ggx_visibility(Vec3::X, -Vec3::X, Vec2::ONE).is_finite());
        assert_eq!(ggx_g1(Vec3::X, Vec2::ONE), 0.0);
        assert_eq!(ggx_projected_area(-Vec3::Z, Vec2::ONE), 0.0);
    }

    #[test]
    fn d_is_within_a_millionth() {
        for alpha in [1e-4f32, 1e-3, 1e-2, 0.1, 0.5, 1.0] {
            for i in 0..4000u16 {
                // To four widths of the lobe and on to the horizon.
                let tan = alpha * 1.003f32.powi(i32::from(i)) * 1e-2;
                let z = 1.0 / (1.0 + tan * tan).sqrt();
                let h = Vec3::new(0.6 * tan * z, 0.8 * tan * z, z);
                let (x, y, z) = (f64::from(h.x), f64::from(h.y), f64::from(h.z));
                let a = f64::from(alpha);
                let s = (x * x + y * y) / (a * a) + z * z;
                let truth = 1.0 / (std::f64::consts::PI * a * a * s * s);
                for found in [ggx_d(h, Vec2::splat(alpha)), ggx_d_isotropic(h, alpha)] {
                    let error = (f64::from(found) / truth - 1.0).abs();
                    assert!(error < 1e-6, "alpha {alpha}, {h}: off by {error:e}");
                }
            }
        }
    }

    #[test]
    fn mirror_threshold() {
        assert_eq!(ggx_is_mirror(ggx_alpha(0.03, 0.0)), 1);
        assert_eq!(ggx_is_mirror(ggx_alpha(0.04, 0.0)), 0);
        assert_eq!(ggx_alpha(0.0, 1.0), Vec2::splat(GGX_ALPHA_MIN));
    }
}
