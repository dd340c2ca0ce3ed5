//! Diffuse reflection: the same radiance in all directions.

use glam::{Vec2, Vec3};

use crate::sample::hemisphere::{
    hemisphere_cosine_invert, hemisphere_cosine_pdf, hemisphere_cosine_sample,
};

/// 1/π.
const INV_PI: f32 = 0.31830987;

/// The BRDF, `albedo / π` per steradian, without the cosine; `albedo` in
/// `[0, 1]`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::lambert::lambert_eval;
///
/// // Under a sky of radiance 1, whose cosine integral is π, the albedo is seen.
/// let albedo = Vec3::new(0.8, 0.5, 0.2);
/// let seen = lambert_eval(albedo) * std::f32::consts::PI;
/// assert!((seen - albedo).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn lambert_eval(albedo: Vec3) -> Vec3 {
    Vec3::new(albedo.x * INV_PI, albedo.y * INV_PI, albedo.z * INV_PI)
}

/// A direction toward the light by the cosine: value · cosine / density is
/// the albedo, so weigh by that and divide nothing.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::lambert::{lambert_eval, lambert_pdf, lambert_sample};
///
/// // Value · cosine / density is the albedo, whatever the direction.
/// let wi = lambert_sample(Vec2::new(0.3, 0.8));
/// let weight = lambert_eval(Vec3::splat(0.5)) * wi.z / lambert_pdf(wi);
/// assert!((weight.x - 0.5).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn lambert_sample(u: Vec2) -> Vec3 {
    hemisphere_cosine_sample(u)
}

/// Density of [`lambert_sample`] per steradian, 0 below the horizon.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::brdf::lambert::lambert_pdf;
///
/// let up = lambert_pdf(Vec3::Z);
/// assert!((up * std::f32::consts::PI - 1.0).abs() < 1e-6);
/// assert_eq!(lambert_pdf(Vec3::NEG_Z), 0.0);
/// ```
#[inline]
#[must_use]
pub fn lambert_pdf(wi: Vec3) -> f32 {
    hemisphere_cosine_pdf(wi)
}

/// The `u` that [`lambert_sample`] maps to `wi`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::brdf::lambert::{lambert_invert, lambert_sample};
///
/// let u = Vec2::new(0.3, 0.8);
/// assert!((lambert_invert(lambert_sample(u)) - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn lambert_invert(wi: Vec3) -> Vec2 {
    hemisphere_cosine_invert(wi)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weight_is_the_albedo() {
        let wi = lambert_sample(Vec2::new(0.3, 0.8));
        let weight = lambert_eval(Vec3::splat(0.5)).x * wi.z / lambert_pdf(wi);
        assert!((weight - 0.5).abs() < 1e-6);
    }
}
