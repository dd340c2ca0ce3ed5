//! Diffuse reflection: the same radiance in all directions.

use glam::{Vec2, Vec3};

use crate::sample::hemisphere::{
    hemisphere_cosine_invert, hemisphere_cosine_pdf, hemisphere_cosine_sample,
};

/// 1/π.
const INV_PI: f32 = 0.31830987;

/// The BRDF, `albedo / π` per steradian, without the cosine; `albedo` in
/// `[0, 1]`.
#[inline]
#[must_use]
pub fn lambert_eval(albedo: Vec3) -> Vec3 {
    Vec3::new(albedo.x * INV_PI, albedo.y * INV_PI, albedo.z * INV_PI)
}

/// A direction toward the light by the cosine: value · cosine / density is
/// the albedo, so weigh by that and divide nothing.
#[inline]
#[must_use]
pub fn lambert_sample(u: Vec2) -> Vec3 {
    hemisphere_cosine_sample(u)
}

/// Density of [`lambert_sample`] per steradian, 0 below the horizon.
#[inline]
#[must_use]
pub fn lambert_pdf(wi: Vec3) -> f32 {
    hemisphere_cosine_pdf(wi)
}

/// The `u` that [`lambert_sample`] maps to `wi`.
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
