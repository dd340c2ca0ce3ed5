//! Directions over the hemisphere around +z: uniform, or by the cosine.
//!
//! Source: Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th ed.,
//! appendix A.5.2 and A.5.3 (Malley's method over the concentric disk map).

use glam::{Vec2, Vec3};

use super::disk::{disk_concentric_invert, disk_concentric_sample};
use crate::math::trig::{atan2_turn, sincos_turn};

/// 1/π.
const INV_PI: f32 = 0.31830987;
/// 1/2π.
const INV_TWO_PI: f32 = 0.15915494;
/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// A direction with density cos θ/π.
///
/// `z` is 0 only when a component of `u` is 0 (one in 2^24); its density is
/// then 0 too, so weigh by `π`, the ratio, and never divide one by the other.
///
/// Error analysis: the concentric map's radius `r` is `2u - 1` and exact, so
/// `√((1 - r)(1 + r))` keeps `z` to a few ULP down to the horizon.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::sample::hemisphere::hemisphere_cosine_sample;
///
/// // The middle of the square is the pole.
/// assert_eq!(hemisphere_cosine_sample(Vec2::splat(0.5)), Vec3::Z);
/// let direction = hemisphere_cosine_sample(Vec2::new(0.3, 0.8));
/// assert!((direction.length() - 1.0).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn hemisphere_cosine_sample(u: Vec2) -> Vec3 {
    let p = disk_concentric_sample(u);
    let r = (2.0 * u.x - 1.0).abs().max((2.0 * u.y - 1.0).abs());
    Vec3::new(p.x, p.y, ((1.0 - r) * (1.0 + r)).sqrt())
}

/// Density of [`hemisphere_cosine_sample`] per steradian: cos θ/π above the
/// horizon, 0 below.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::hemisphere::hemisphere_cosine_pdf;
///
/// let up = hemisphere_cosine_pdf(Vec3::Z);
/// assert!((up * std::f32::consts::PI - 1.0).abs() < 1e-6);
/// assert_eq!(hemisphere_cosine_pdf(Vec3::X), 0.0);
/// assert_eq!(hemisphere_cosine_pdf(Vec3::NEG_Z), 0.0);
/// ```
#[inline]
#[must_use]
pub fn hemisphere_cosine_pdf(direction: Vec3) -> f32 {
    direction.z.max(0.0) * INV_PI
}

/// The `u` that [`hemisphere_cosine_sample`] maps to `direction`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::hemisphere::{
///     hemisphere_cosine_invert, hemisphere_cosine_sample,
/// };
///
/// let u = Vec2::new(0.3, 0.8);
/// let back = hemisphere_cosine_invert(hemisphere_cosine_sample(u));
/// assert!((back - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn hemisphere_cosine_invert(direction: Vec3) -> Vec2 {
    disk_concentric_invert(Vec2::new(direction.x, direction.y))
}

/// A direction with the same density everywhere: `z = 1 - u.x`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::sample::hemisphere::hemisphere_uniform_sample;
///
/// assert_eq!(hemisphere_uniform_sample(Vec2::ZERO), Vec3::Z);
/// // Equal shares of u.x are equal shares of the height.
/// assert_eq!(hemisphere_uniform_sample(Vec2::new(0.75, 0.1)).z, 0.25);
/// ```
#[inline]
#[must_use]
pub fn hemisphere_uniform_sample(u: Vec2) -> Vec3 {
    let r = (u.x * (2.0 - u.x)).sqrt();
    let turn = sincos_turn(u.y);
    Vec3::new(r * turn.y, r * turn.x, 1.0 - u.x)
}

/// Density of [`hemisphere_uniform_sample`] per steradian: 1/2π above the
/// horizon, 0 below.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::hemisphere::hemisphere_uniform_pdf;
///
/// let up = hemisphere_uniform_pdf(Vec3::Z);
/// assert!((up * std::f32::consts::TAU - 1.0).abs() < 1e-6);
/// assert_eq!(hemisphere_uniform_pdf(Vec3::NEG_Z), 0.0);
/// ```
#[inline]
#[must_use]
pub fn hemisphere_uniform_pdf(direction: Vec3) -> f32 {
    if direction.z < 0.0 {
        return 0.0;
    }
    INV_TWO_PI
}

/// The `u` that [`hemisphere_uniform_sample`] maps to `direction`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::hemisphere::{
///     hemisphere_uniform_invert, hemisphere_uniform_sample,
/// };
///
/// let u = Vec2::new(0.3, 0.8);
/// let back = hemisphere_uniform_invert(hemisphere_uniform_sample(u));
/// assert!((back - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn hemisphere_uniform_invert(direction: Vec3) -> Vec2 {
    Vec2::new(
        (1.0 - direction.z).clamp(0.0, ONE_BELOW),
        atan2_turn(direction.y, direction.x),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pole_and_horizon() {
        assert_eq!(hemisphere_cosine_sample(Vec2::splat(0.5)), Vec3::Z);
        assert_eq!(hemisphere_uniform_sample(Vec2::ZERO), Vec3::Z);
        assert_eq!(hemisphere_cosine_pdf(-Vec3::Z), 0.0);
        assert_eq!(hemisphere_uniform_pdf(-Vec3::Z), 0.0);
        assert_eq!(hemisphere_cosine_sample(Vec2::new(0.0, 0.5)).z, 0.0);
    }
}
