//! Uniform directions in a cone around the z axis, for disc-like lights.
//!
//! The cone is given by `one_minus_cos`, that is `1 - cos θmax`, in `(0, 2]`:
//! stored as a cosine, the Sun's cone (0.00465 rad) keeps 182 distinct radii of
//! 4096, in this form all of them.
//!
//! Source: Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th ed.,
//! appendix A.5.4, reparametrised.

use glam::{Vec2, Vec3};

use crate::math::trig::{atan2_turn, sincos_turn};

/// 1/2π.
const INV_TWO_PI: f32 = 0.15915494;
/// 1/4π.
const INV_FOUR_PI: f32 = 0.07957747;
/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// `1 - cos` of a half-angle in radians, `[0, π]`, without cancellation.
///
/// ```
/// use raytwin_cpu::sample::cone::cone_one_minus_cos;
///
/// // The half sphere has cos 90° = 0.
/// let half_sphere = cone_one_minus_cos(std::f32::consts::FRAC_PI_2);
/// assert!((half_sphere - 1.0).abs() < 1e-6);
/// // The Sun's 0.00465 rad: θ²/2 keeps its digits, 1 - cos(θ) would not.
/// let sun = cone_one_minus_cos(0.00465);
/// assert!((sun / (0.5 * 0.00465 * 0.00465) - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn cone_one_minus_cos(half_angle: f32) -> f32 {
    // 2 sin²(θ/2), and θ/2 radians are θ/4π turns.
    let s = sincos_turn(half_angle * INV_FOUR_PI).x;
    2.0 * (s * s)
}

/// `1 - cos` of the cone that a sphere fills, from the sine of its half-angle:
/// radius over distance, `[0, 1]`.
///
/// ```
/// use raytwin_cpu::sample::cone::cone_one_minus_cos_from_sin;
///
/// // A sphere of radius 3 seen from distance 5: the cosine is 4/5.
/// let cone = cone_one_minus_cos_from_sin(3.0 / 5.0);
/// assert!((cone - 0.2).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn cone_one_minus_cos_from_sin(sin_half_angle: f32) -> f32 {
    let s = sin_half_angle * sin_half_angle;
    s / (1.0 + ((1.0 - sin_half_angle) * (1.0 + sin_half_angle)).sqrt())
}

/// A uniform direction within the cone around +z.
///
/// Error analysis: with `x = u.x·one_minus_cos` the sine is `√(x(2 - x))`.
/// `2 - x` is summed from `2 - one_minus_cos` (exact from 1 on) and
/// `(1 - u.x)·one_minus_cos` (both positive, `1 - u.x` exact), so no step
/// cancels: the relative error stays a few ULP in the narrowest cone and at
/// the far pole of the widest, where `2 - x` itself loses every digit.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::cone::{cone_one_minus_cos, cone_sample};
///
/// // A shadow ray's direction toward a disc-like sun.
/// let sun = cone_one_minus_cos(0.00465);
/// let direction = cone_sample(Vec2::new(0.3, 0.8), sun);
/// assert!((direction.length() - 1.0).abs() < 1e-6);
/// assert!(direction.x.hypot(direction.y) < 0.00465);
/// ```
#[inline]
#[must_use]
pub fn cone_sample(u: Vec2, one_minus_cos: f32) -> Vec3 {
    let x = u.x * one_minus_cos;
    let rest = (2.0 - one_minus_cos) + (1.0 - u.x) * one_minus_cos;
    let r = (x * rest).sqrt();
    let turn = sincos_turn(u.y);
    Vec3::new(r * turn.y, r * turn.x, 1.0 - x)
}

/// `1 - z` of a unit vector; near the pole from x and y, where z says little.
#[inline]
fn cone_height(direction: Vec3) -> f32 {
    let s = direction.x * direction.x + direction.y * direction.y;
    if direction.z > 0.0 {
        return s / (1.0 + direction.z);
    }
    1.0 - direction.z
}

/// Density per steradian: `1/(2π·one_minus_cos)` in the cone, 0 outside.
///
/// The rim is taken 2^-19 wide (relative), since a sample on it may round
/// outward.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::sample::cone::cone_pdf;
///
/// // The density is one over the cone's solid angle; the half sphere's is 2π.
/// let inside = cone_pdf(Vec3::Z, 1.0);
/// assert!((inside * std::f32::consts::TAU - 1.0).abs() < 1e-6);
/// assert_eq!(cone_pdf(Vec3::NEG_Z, 1.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn cone_pdf(direction: Vec3, one_minus_cos: f32) -> f32 {
    if cone_height(direction) > one_minus_cos * (1.0 + 1.0 / 524_288.0) {
        return 0.0;
    }
    INV_TWO_PI / one_minus_cos
}

/// The `u` that [`cone_sample`] maps to `direction`; the axis' azimuth is 0.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::cone::{cone_invert, cone_sample};
///
/// let u = Vec2::new(0.3, 0.8);
/// let back = cone_invert(cone_sample(u, 0.5), 0.5);
/// assert!((back - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn cone_invert(direction: Vec3, one_minus_cos: f32) -> Vec2 {
    Vec2::new(
        (cone_height(direction) / one_minus_cos).clamp(0.0, ONE_BELOW),
        atan2_turn(direction.y, direction.x),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axis_and_rim() {
        assert_eq!(cone_sample(Vec2::ZERO, 0.5), Vec3::Z);
        assert_eq!(cone_pdf(Vec3::X, 0.5), 0.0);
        assert_eq!(cone_one_minus_cos(0.0), 0.0);
        assert_eq!(cone_one_minus_cos_from_sin(1.0), 1.0);
    }

    #[test]
    fn sun_keeps_every_radius() {
        let omc = cone_one_minus_cos(0.00465);
        let mut radii: Vec<u32> = (0..4096)
            .map(|i| {
                cone_sample(Vec2::new(i as f32 / 4096.0, 0.0), omc)
                    .x
                    .to_bits()
            })
            .collect();
        radii.sort_unstable();
        radii.dedup();
        assert_eq!(radii.len(), 4096);
    }
}
