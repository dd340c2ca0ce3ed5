//! Microfacet normals by their distribution, as PICA PICA's reflections draw
//! them.
//!
//! Needs no view direction; wastes samples on normals that the viewer does not
//! see (see `ggx_visible`). Source: Walter et al., *Microfacet Models for
//! Refraction*, EGSR 2007, equations 35 and 36, stretched for anisotropy.

use glam::{Vec2, Vec3};

use super::ggx::{ggx_d, ggx_d_between};
use crate::math::trig::{atan2_turn, sincos_turn};
use crate::math::vector::vec3_dot;

/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// A microfacet normal with density [`ggx_ndf_pdf`]; `u.x` is the radius,
/// `u.x = 0` the surface's normal, `u.y` the azimuth.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_ndf::ggx_ndf_sample;
///
/// let alpha = Vec2::splat(0.3);
/// assert_eq!(ggx_ndf_sample(Vec2::ZERO, alpha), Vec3::Z);
/// let h = ggx_ndf_sample(Vec2::new(0.3, 0.8), alpha);
/// assert!((h.length() - 1.0).abs() < 1e-6 && h.z > 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_ndf_sample(u: Vec2, alpha: Vec2) -> Vec3 {
    let r = u.x.sqrt();
    let turn = sincos_turn(u.y);
    let x = alpha.x * (r * turn.y);
    let y = alpha.y * (r * turn.x);
    let z2 = 1.0 - u.x;
    let scale = 1.0 / ((x * x + y * y) + z2).sqrt();
    Vec3::new(x * scale, y * scale, z2.sqrt() * scale)
}

/// Density of [`ggx_ndf_sample`] over half vectors, per steradian: `D cos`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::brdf::ggx::ggx_d;
/// use raytwin_cpu::brdf::ggx_ndf::{ggx_ndf_pdf, ggx_ndf_sample};
///
/// let alpha = Vec2::splat(0.3);
/// let h = ggx_ndf_sample(Vec2::new(0.3, 0.8), alpha);
/// assert!((ggx_ndf_pdf(h, alpha) / (ggx_d(h, alpha) * h.z) - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn ggx_ndf_pdf(h: Vec3, alpha: Vec2) -> f32 {
    ggx_d(h, alpha) * h.z
}

/// Density of the reflected directions, per steradian: `D cos / (4 wo·h)`.
///
/// 0 if either direction is at or below the horizon: reflections that end
/// there are to be dropped, and the density integrates to one less their part.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_reflect;
/// use raytwin_cpu::brdf::ggx_ndf::{
///     ggx_ndf_direction_pdf, ggx_ndf_pdf, ggx_ndf_sample,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let h = ggx_ndf_sample(Vec2::new(0.3, 0.8), alpha);
/// let pdf = ggx_ndf_pdf(h, alpha) / (4.0 * wo.dot(h));
/// let wi = ggx_reflect(wo, h);
/// assert!((ggx_ndf_direction_pdf(wo, wi, alpha) / pdf - 1.0).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn ggx_ndf_direction_pdf(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    let m = Vec3::new(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    // cos / (4 wo·h) = m.z / (2 |m|²), since |m| = 2 wo·h.
    ggx_d_between(wo, wi, alpha) * m.z / (2.0 * vec3_dot(m, m))
}

/// The `u` that [`ggx_ndf_sample`] maps to `h`, `h.z >= 0`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::brdf::ggx_ndf::{ggx_ndf_invert, ggx_ndf_sample};
///
/// let alpha = Vec2::splat(0.3);
/// let u = Vec2::new(0.3, 0.8);
/// let back = ggx_ndf_invert(ggx_ndf_sample(u, alpha), alpha);
/// assert!((back - u).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn ggx_ndf_invert(h: Vec3, alpha: Vec2) -> Vec2 {
    let x = alpha.y * h.x;
    let y = alpha.x * h.y;
    let z = alpha.x * alpha.y * h.z;
    let side = x * x + y * y;
    let u = side / (side + z * z);
    Vec2::new(u.min(ONE_BELOW), atan2_turn(y, x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_is_the_normal() {
        assert_eq!(ggx_ndf_sample(Vec2::ZERO, Vec2::splat(0.3)), Vec3::Z);
        assert_eq!(ggx_ndf_invert(Vec3::Z, Vec2::splat(0.3)).x, 0.0);
    }
}
