//! Uniform directions on the unit sphere.
//!
//! Source: Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th ed.,
//! appendix A.5.2, with the sine in a form that does not cancel at the poles.

use glam::{Vec2, Vec3};

use crate::math::trig::{atan2_turn, sincos_turn};

/// 1/4π.
const INV_FOUR_PI: f32 = 0.07957747;
/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// A uniform direction: `z` falls from 1 with `u.x`, the azimuth is `u.y` turns.
///
/// Error analysis: `1 - u.x` is exact for multiples of 2^-24, so the sine
/// `2√(u.x(1 - u.x))` keeps its relative accuracy at both poles.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::sample::sphere::sphere_sample;
///
/// assert_eq!(sphere_sample(Vec2::ZERO), Vec3::Z);
/// // Half of the square, half of the sphere.
/// assert_eq!(sphere_sample(Vec2::new(0.5, 0.25)), Vec3::Y);
/// ```
#[inline]
#[must_use]
pub fn sphere_sample(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = 2.0 * (u.x * (1.0 - u.x)).sqrt();
    let turn = sincos_turn(u.y);
    Vec3::new(r * turn.y, r * turn.x, z)
}

/// Density per steradian: 1/4π, everywhere.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::sphere::sphere_pdf;
///
/// // One over the whole solid angle, 4π.
/// let density = sphere_pdf(Vec3::X);
/// assert!((density * 4.0 * std::f32::consts::PI - 1.0).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn sphere_pdf(_direction: Vec3) -> f32 {
    INV_FOUR_PI
}

/// The `u` that [`sphere_sample`] maps to `direction`; a pole's azimuth is 0.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::sphere::{sphere_invert, sphere_sample};
///
/// let u = Vec2::new(0.3, 0.8);
/// let back = sphere_invert(sphere_sample(u));
/// assert!((back - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn sphere_invert(direction: Vec3) -> Vec2 {
    Vec2::new(
        (0.5 - 0.5 * direction.z).clamp(0.0, ONE_BELOW),
        atan2_turn(direction.y, direction.x),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poles_and_equator() {
        assert_eq!(sphere_sample(Vec2::ZERO), Vec3::Z);
        assert_eq!(sphere_sample(Vec2::new(0.5, 0.25)), Vec3::Y);
        assert_eq!(sphere_invert(Vec3::Y), Vec2::new(0.5, 0.25));
    }
}
