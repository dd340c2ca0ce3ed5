//! Uniform points on the unit disk: polar and concentric.
//!
//! Source: Shirley and Chiu, *A Low Distortion Map Between Disk and Square*,
//! JGT 2(3), 1997, in the branch form of their figure 6 (angles in turns here).

use glam::Vec2;

use crate::math::trig::{atan2_turn, sincos_turn};

/// 1/π.
const INV_PI: f32 = 0.31830987;
/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// Polar map: radius `√u.x`, angle `u.y` turns.
///
/// Error analysis: a square root and one product on top of the sine and
/// cosine: a few ULP of 1.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::disk::disk_polar_sample;
///
/// assert_eq!(disk_polar_sample(Vec2::ZERO), Vec2::ZERO);
/// // Radius √0.25, a quarter turn from the x axis.
/// assert_eq!(disk_polar_sample(Vec2::new(0.25, 0.25)), Vec2::new(0.0, 0.5));
/// ```
#[inline]
#[must_use]
pub fn disk_polar_sample(u: Vec2) -> Vec2 {
    let r = u.x.sqrt();
    let turn = sincos_turn(u.y);
    Vec2::new(r * turn.y, r * turn.x)
}

/// The `u` that [`disk_polar_sample`] maps to `p`; the centre gives `(0, 0)`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::disk::{disk_polar_invert, disk_polar_sample};
///
/// let u = Vec2::new(0.3, 0.8);
/// let back = disk_polar_invert(disk_polar_sample(u));
/// assert!((back - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn disk_polar_invert(p: Vec2) -> Vec2 {
    let radius_squared = p.x * p.x + p.y * p.y;
    Vec2::new(radius_squared.min(ONE_BELOW), atan2_turn(p.y, p.x))
}

/// Concentric map: squares around the centre become circles, so that strata
/// keep their shape.
///
/// Error analysis: `2u - 1` is exact for multiples of 2^-24; one division, one
/// product and the sine and cosine follow: a few ULP of 1.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::disk::disk_concentric_sample;
///
/// // The square's centre is the disk's; the middle of a side lies on the rim.
/// assert_eq!(disk_concentric_sample(Vec2::splat(0.5)), Vec2::ZERO);
/// let rim = disk_concentric_sample(Vec2::new(0.5, 0.0));
/// assert!((rim - Vec2::NEG_Y).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn disk_concentric_sample(u: Vec2) -> Vec2 {
    let a = 2.0 * u.x - 1.0;
    let b = 2.0 * u.y - 1.0;
    if a == 0.0 && b == 0.0 {
        return Vec2::ZERO;
    }
    let wide = a.abs() > b.abs();
    let r = if wide { a } else { b };
    // The quotient of the smaller by the larger, so neither choice divides by zero.
    let ratio = if wide { b } else { a } / r;
    // ratio is -1 to 1: an eighth of a turn either way.
    let eighth = 0.125 * ratio;
    let turn = sincos_turn(if wide { eighth } else { 0.25 - eighth });
    Vec2::new(r * turn.y, r * turn.x)
}

/// The `u` that [`disk_concentric_sample`] maps to `p`.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::disk::{
///     disk_concentric_invert, disk_concentric_sample,
/// };
///
/// let u = Vec2::new(0.3, 0.8);
/// let back = disk_concentric_invert(disk_concentric_sample(u));
/// assert!((back - u).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn disk_concentric_invert(p: Vec2) -> Vec2 {
    let r = (p.x * p.x + p.y * p.y).sqrt();
    let ax = p.x.abs();
    let ay = p.y.abs();
    let wide = ax > ay;
    // Angle from the nearer axis as a fraction of an eighth turn.
    let fraction = 8.0 * atan2_turn(if wide { ay } else { ax }, if wide { ax } else { ay });
    let major = r;
    let minor = r * fraction;
    let a = if wide { major } else { minor };
    let b = if wide { minor } else { major };
    Vec2::new(
        (0.5 + 0.5 * if p.x < 0.0 { -a } else { a }).clamp(0.0, ONE_BELOW),
        (0.5 + 0.5 * if p.y < 0.0 { -b } else { b }).clamp(0.0, ONE_BELOW),
    )
}

/// Density of both maps per unit area: 1/π on the disk, 0 outside.
///
/// A sample on the rim may round outward by an ULP; the rim is taken 2^-20
/// wide so that no sample has density 0.
///
/// ```
/// use glam::Vec2;
/// use raytwin_cpu::sample::disk::disk_pdf;
///
/// // One over the area on the disk, nothing outside.
/// let inside = disk_pdf(Vec2::new(0.3, 0.4));
/// assert!((inside * std::f32::consts::PI - 1.0).abs() < 1e-6);
/// assert_eq!(disk_pdf(Vec2::new(1.0, 1.0)), 0.0);
/// ```
#[inline]
#[must_use]
pub fn disk_pdf(p: Vec2) -> f32 {
    let radius_squared = p.x * p.x + p.y * p.y;
    if radius_squared > 1.0 + 1.0 / 1_048_576.0 {
        return 0.0;
    }
    INV_PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centre_and_corners() {
        assert_eq!(disk_concentric_sample(Vec2::splat(0.5)), Vec2::ZERO);
        assert_eq!(disk_concentric_sample(Vec2::new(0.0, 0.5)), -Vec2::X);
        assert_eq!(disk_polar_sample(Vec2::new(0.0, 0.7)), Vec2::ZERO);
        assert_eq!(disk_pdf(Vec2::new(1.1, 0.0)), 0.0);
    }
}
