//! The specular microfacet BRDF, and what a sample of it weighs.
//!
//! Shading frame: normal = +z, `wo` toward the viewer, `wi` toward the light.
//! Fresnel is Schlick's, at half the angle between the two.

use glam::{Vec2, Vec3};

use super::fresnel::fresnel_schlick;
use super::ggx::{ggx_d_between, ggx_stretched, ggx_visibility};
use super::ggx_bounded::ggx_bounded_lift;
use crate::math::vector::{vec3_dot, vec3_length};

/// Stands in for zero where something divides.
const TINY: f32 = 1e-30;

/// Schlick's term of two directions: half the length of their sum is the
/// cosine to the half vector.
#[inline]
fn cook_torrance_fresnel(wo: Vec3, wi: Vec3, f0: Vec3) -> Vec3 {
    let m = Vec3::new(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    fresnel_schlick(f0, 0.5 * vec3_length(m))
}

/// `D F G2 / (4 cos cos)` per steradian, without the cosine; 0 if either
/// direction is at or below the horizon. Reciprocal.
///
/// Cook and Torrance, *A Reflectance Model for Computer Graphics*, 1982, with
/// Trowbridge and Reitz's D and Smith's height-correlated G2.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::cook_torrance::cook_torrance_eval;
/// use raytwin_cpu::brdf::ggx::ggx_alpha;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let wi = Vec3::new(-0.48, 0.36, 0.8);
/// let alpha = ggx_alpha(0.5, 0.0);
/// let gold = Vec3::new(1.0, 0.78, 0.34);
/// // Light and viewer may be exchanged.
/// let there = cook_torrance_eval(wo, wi, alpha, gold);
/// let back = cook_torrance_eval(wi, wo, alpha, gold);
/// assert!((there - back).length() < 1e-5 * there.length());
/// ```
#[inline]
#[must_use]
pub fn cook_torrance_eval(wo: Vec3, wi: Vec3, alpha: Vec2, f0: Vec3) -> Vec3 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return Vec3::ZERO;
    }
    let f = cook_torrance_fresnel(wo, wi, f0);
    let dv = ggx_d_between(wo, wi, alpha) * ggx_visibility(wo, wi, alpha);
    Vec3::new(f.x * dv, f.y * dv, f.z * dv)
}

/// `F` times a number; 0 if either direction is at or below the horizon.
#[inline]
fn cook_torrance_scaled(wo: Vec3, wi: Vec3, f0: Vec3, scale: f32) -> Vec3 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return Vec3::ZERO;
    }
    let f = cook_torrance_fresnel(wo, wi, f0);
    Vec3::new(f.x * scale, f.y * scale, f.z * scale)
}

/// Value · cosine / density of a sample of the normal distribution,
/// `F G2 (wo·h) / (cos_o cos_h)`.
///
/// D is in the value and in the density and is left out of both, so a narrow
/// lobe costs no digits. May be large: these weights have the long tail that
/// makes this the worst of the three samplers.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::cook_torrance::{
///     cook_torrance_eval, cook_torrance_weight_ndf,
/// };
/// use raytwin_cpu::brdf::ggx::{ggx_alpha, ggx_reflect};
/// use raytwin_cpu::brdf::ggx_ndf::{ggx_ndf_direction_pdf, ggx_ndf_sample};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = ggx_alpha(0.5, 0.0);
/// let wi = ggx_reflect(wo, ggx_ndf_sample(Vec2::new(0.3, 0.8), alpha));
/// let weight = cook_torrance_weight_ndf(wo, wi, alpha, Vec3::ONE);
/// // The same as value · cosine / density.
/// let density = ggx_ndf_direction_pdf(wo, wi, alpha);
/// let value = cook_torrance_eval(wo, wi, alpha, Vec3::ONE);
/// assert!((weight - value * wi.z / density).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn cook_torrance_weight_ndf(wo: Vec3, wi: Vec3, alpha: Vec2, f0: Vec3) -> Vec3 {
    let m = Vec3::new(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let o = wi.z * ggx_stretched(wo, alpha);
    let i = wo.z * ggx_stretched(wi, alpha);
    let scale = wi.z * vec3_dot(m, m) / (m.z * (o + i)).max(TINY);
    cook_torrance_scaled(wo, wi, f0, scale)
}

/// The same of a sample of the visible normals, `F G2 / G1(wo)`: at most F.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::cook_torrance::cook_torrance_weight_visible;
/// use raytwin_cpu::brdf::ggx::{ggx_alpha, ggx_reflect};
/// use raytwin_cpu::brdf::ggx_visible::ggx_visible_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = ggx_alpha(0.5, 0.0);
/// let wi = ggx_reflect(wo, ggx_visible_sample(Vec2::new(0.3, 0.8), wo, alpha));
/// let weight = cook_torrance_weight_visible(wo, wi, alpha, Vec3::ONE);
/// // No sample ever weighs more than the Fresnel term, 1 here.
/// assert!(weight.max_element() <= 1.0 + 1e-6);
/// ```
#[inline]
#[must_use]
pub fn cook_torrance_weight_visible(wo: Vec3, wi: Vec3, alpha: Vec2, f0: Vec3) -> Vec3 {
    let length = ggx_stretched(wo, alpha);
    let o = wi.z * length;
    let i = wo.z * ggx_stretched(wi, alpha);
    let scale = wi.z * (wo.z + length) / (o + i).max(TINY);
    cook_torrance_scaled(wo, wi, f0, scale)
}

/// The same of a sample of the bounded visible normals: at most F.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::cook_torrance::{
///     cook_torrance_eval, cook_torrance_weight_bounded,
/// };
/// use raytwin_cpu::brdf::ggx::ggx_alpha;
/// use raytwin_cpu::brdf::ggx_bounded::ggx_bounded_direction_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = ggx_alpha(0.5, 0.0);
/// let ray = ggx_bounded_direction_sample(Vec2::new(0.3, 0.8), wo, alpha);
/// let weight =
///     cook_torrance_weight_bounded(wo, ray.direction, alpha, Vec3::ONE);
/// // The same as value · cosine / density.
/// let value = cook_torrance_eval(wo, ray.direction, alpha, Vec3::ONE);
/// assert!((weight - value * ray.direction.z / ray.pdf).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn cook_torrance_weight_bounded(wo: Vec3, wi: Vec3, alpha: Vec2, f0: Vec3) -> Vec3 {
    let length = ggx_stretched(wo, alpha);
    let o = wi.z * length;
    let i = wo.z * ggx_stretched(wi, alpha);
    let kept = (1.0 - ggx_bounded_lift(wo, alpha)) * wo.z;
    let scale = wi.z * (kept + length) / (o + i).max(TINY);
    cook_torrance_scaled(wo, wi, f0, scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::ggx::ggx_reflect;
    use crate::brdf::ggx_bounded::{ggx_bounded_direction_pdf, ggx_bounded_sample};
    use crate::brdf::ggx_ndf::{ggx_ndf_direction_pdf, ggx_ndf_sample};
    use crate::brdf::ggx_visible::{ggx_visible_direction_pdf, ggx_visible_sample};

    #[test]
    fn weights_are_value_times_cosine_over_density() {
        let f0 = Vec3::new(0.04, 0.5, 1.0);
        for alpha in [Vec2::splat(0.05), Vec2::splat(0.5), Vec2::new(0.9, 0.2)] {
            for z in [0.05f32, 0.5, 1.0] {
                let wo = Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z);
                for i in 0..64 {
                    let u = Vec2::new((i % 8) as f32 / 8.0, (i / 8) as f32 / 8.0);
                    let ndf = ggx_reflect(wo, ggx_ndf_sample(u, alpha));
                    let visible = ggx_reflect(wo, ggx_visible_sample(u, wo, alpha));
                    let bounded = ggx_reflect(wo, ggx_bounded_sample(u, wo, alpha));
                    for (wi, weight, pdf) in [
                        (
                            ndf,
                            cook_torrance_weight_ndf(wo, ndf, alpha, f0),
                            ggx_ndf_direction_pdf(wo, ndf, alpha),
                        ),
                        (
                            visible,
                            cook_torrance_weight_visible(wo, visible, alpha, f0),
                            ggx_visible_direction_pdf(wo, visible, alpha),
                        ),
                        (
                            bounded,
                            cook_torrance_weight_bounded(wo, bounded, alpha, f0),
                            ggx_bounded_direction_pdf(wo, bounded, alpha),
                        ),
                    ] {
                        if wi.z <= 1e-4 {
                            continue;
                        }
                        let direct = cook_torrance_eval(wo, wi, alpha, f0) * wi.z / pdf;
                        let off = (weight - direct).abs().max_element();
                        assert!(off <= 1e-5 * direct.max_element(), "{weight} {direct}");
                    }
                }
            }
        }
    }

    #[test]
    fn nothing_below() {
        let alpha = Vec2::splat(0.3);
        assert_eq!(
            cook_torrance_eval(Vec3::Z, -Vec3::Z, alpha, Vec3::ONE),
            Vec3::ZERO
        );
        assert_eq!(
            cook_torrance_weight_ndf(Vec3::Z, -Vec3::Z, alpha, Vec3::ONE),
            Vec3::ZERO
        );
    }
}
