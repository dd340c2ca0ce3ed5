//! Microfacet normals by the area that the viewer sees of them.
//!
//! Two samplers of one density: spherical caps (Dupuy and Benyoub, *Sampling
//! Visible GGX Normals with Spherical Caps*, HPG 2023), the faster, and Heitz's
//! disk (*Sampling the GGX Distribution of Visible Normals*, JCGT 7(4), 2018),
//! whose map has no seam at the pole. Prefer `ggx_bounded` for reflection.

use glam::{Vec2, Vec3};

use super::ggx::{GGX_TINY, ggx_d, ggx_d_between, ggx_projected_area};
use crate::math::trig::{atan2_turn, sincos_turn};
use crate::math::vector::vec3_dot;
use crate::sample::disk::{disk_polar_invert, disk_polar_sample};

/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// Unit vector along `v`, or +x if it has no length: the visible normals of a
/// viewer straight below the surface lie on its horizon.
#[inline]
pub(crate) fn ggx_visible_unit(v: Vec3) -> Vec3 {
    let square = vec3_dot(v, v);
    if square < GGX_TINY {
        return Vec3::X;
    }
    let scale = 1.0 / square.sqrt();
    Vec3::new(v.x * scale, v.y * scale, v.z * scale)
}

/// The view direction in the space in which the surface is a hemisphere.
#[inline]
pub(crate) fn ggx_visible_stretch(wo: Vec3, alpha: Vec2) -> Vec3 {
    ggx_visible_unit(Vec3::new(alpha.x * wo.x, alpha.y * wo.y, wo.z))
}

/// The stretched normal of a half vector.
#[inline]
pub(crate) fn ggx_visible_unstretch(h: Vec3, alpha: Vec2) -> Vec3 {
    ggx_visible_unit(Vec3::new(
        alpha.y * h.x,
        alpha.x * h.y,
        alpha.x * alpha.y * h.z,
    ))
}

/// `1 - o.z` of a unit vector, without cancelling where it points up.
#[inline]
pub(crate) fn ggx_visible_drop(o: Vec3) -> f32 {
    if o.z > 0.0 {
        return (o.x * o.x + o.y * o.y) / (1.0 + o.z);
    }
    1.0 - o.z
}

/// A visible normal by spherical caps; density [`ggx_visible_pdf`].
///
/// `wo` may lie below the surface. Error analysis: the cap's height is `1 - x`
/// with `x = u.x (1 + z)`, its radius `√(x (2 - x))` with `2 - x` summed from
/// `1 - z` and `(1 - u.x)(1 + z)`, which is also the height of the sum with the
/// view direction: nothing cancels but where the normal is at a right angle to
/// the view.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_visible::ggx_visible_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let h = ggx_visible_sample(Vec2::new(0.3, 0.8), wo, Vec2::splat(0.3));
/// // A unit normal on the viewer's side.
/// assert!((h.length() - 1.0).abs() < 1e-6 && h.dot(wo) > 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_visible_sample(u: Vec2, wo: Vec3, alpha: Vec2) -> Vec3 {
    let o = ggx_visible_stretch(wo, alpha);
    let up = 1.0 + o.z;
    let x = u.x * up;
    let height = (1.0 - u.x) * up;
    let r = (x * (ggx_visible_drop(o) + height)).sqrt();
    let turn = sincos_turn(u.y);
    let m = Vec3::new(
        alpha.x * (r * turn.y + o.x),
        alpha.y * (r * turn.x + o.y),
        height,
    );
    ggx_visible_unit(m)
}

/// The `u` that [`ggx_visible_sample`] maps to `h`; `wo.z >= 0`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_visible::{
///     ggx_visible_invert, ggx_visible_sample,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let u = Vec2::new(0.3, 0.8);
/// let back = ggx_visible_invert(ggx_visible_sample(u, wo, alpha), wo, alpha);
/// assert!((back - u).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn ggx_visible_invert(h: Vec3, wo: Vec3, alpha: Vec2) -> Vec2 {
    let o = ggx_visible_stretch(wo, alpha);
    let n = ggx_visible_unstretch(h, alpha);
    let k = 2.0 * vec3_dot(o, n);
    let u = 1.0 - k * n.z / (1.0 + o.z);
    Vec2::new(
        u.clamp(0.0, ONE_BELOW),
        atan2_turn(k * n.y - o.y, k * n.x - o.x),
    )
}

/// A visible normal by Heitz's disk; density [`ggx_visible_pdf`]. `wo.z >= 0`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_visible::ggx_visible_sample_heitz;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let h = ggx_visible_sample_heitz(Vec2::new(0.3, 0.8), wo, Vec2::splat(0.3));
/// assert!((h.length() - 1.0).abs() < 1e-6 && h.dot(wo) > 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_visible_sample_heitz(u: Vec2, wo: Vec3, alpha: Vec2) -> Vec3 {
    let o = ggx_visible_stretch(wo, alpha);
    let p = disk_polar_sample(u);
    let frame = ggx_visible_frame(o);
    let s = 0.5 * (1.0 + o.z);
    let rim = ((1.0 - p.x) * (1.0 + p.x)).max(0.0).sqrt();
    let y = (1.0 - s) * rim + s * p.y;
    let z = ((rim - y) * (rim + y)).max(0.0).sqrt();
    // o × t for the tangent t = (c, d, 0).
    let c = frame.x;
    let d = frame.y;
    let n = Vec3::new(
        (p.x * c - y * (o.z * d)) + z * o.x,
        (p.x * d + y * (o.z * c)) + z * o.y,
        y * (o.x * d - o.y * c) + z * o.z,
    );
    let m = Vec3::new(alpha.x * n.x, alpha.y * n.y, n.z.max(0.0));
    ggx_visible_unit(m)
}

/// The tangent across the view direction, its two horizontal components.
#[inline]
fn ggx_visible_frame(o: Vec3) -> Vec2 {
    let square = o.x * o.x + o.y * o.y;
    if square < GGX_TINY {
        return Vec2::X;
    }
    let scale = 1.0 / square.sqrt();
    Vec2::new(-o.y * scale, o.x * scale)
}

/// The `u` that [`ggx_visible_sample_heitz`] maps to `h`; `wo.z >= 0`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_visible::{
///     ggx_visible_invert_heitz, ggx_visible_sample_heitz,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let u = Vec2::new(0.3, 0.8);
/// let h = ggx_visible_sample_heitz(u, wo, alpha);
/// assert!((ggx_visible_invert_heitz(h, wo, alpha) - u).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn ggx_visible_invert_heitz(h: Vec3, wo: Vec3, alpha: Vec2) -> Vec2 {
    let o = ggx_visible_stretch(wo, alpha);
    let n = ggx_visible_unstretch(h, alpha);
    let frame = ggx_visible_frame(o);
    let c = frame.x;
    let d = frame.y;
    let x = n.x * c + n.y * d;
    let y = (n.y * c - n.x * d) * o.z + n.z * (o.x * d - o.y * c);
    let s = 0.5 * (1.0 + o.z);
    let rim = ((1.0 - x) * (1.0 + x)).max(0.0).sqrt();
    disk_polar_invert(Vec2::new(x, (y - (1.0 - s) * rim) / s))
}

/// Density of visible normals over half vectors, per steradian:
/// `D (wo·h) / projected area`, 0 for normals that face away.
///
/// Finite for a viewer below the surface; 0 straight below it.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_d;
/// use raytwin_cpu::brdf::ggx_visible::ggx_visible_pdf;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// // Straight on it is the distribution itself; normals turned away have none.
/// assert_eq!(ggx_visible_pdf(Vec3::Z, Vec3::Z, alpha), ggx_d(Vec3::Z, alpha));
/// assert_eq!(ggx_visible_pdf(Vec3::new(-0.96, 0.0, 0.28), wo, alpha), 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_visible_pdf(h: Vec3, wo: Vec3, alpha: Vec2) -> f32 {
    let area = ggx_projected_area(wo, alpha);
    if area < GGX_TINY {
        return 0.0;
    }
    ggx_d(h, alpha) * vec3_dot(wo, h).max(0.0) / area
}

/// Density of the directions reflected by visible normals, per steradian:
/// `D / (4 · projected area)`.
///
/// 0 if either direction is at or below the horizon: reflections that end
/// there are to be dropped, and the density integrates to one less their part.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_reflect;
/// use raytwin_cpu::brdf::ggx_visible::{
///     ggx_visible_direction_pdf, ggx_visible_pdf, ggx_visible_sample,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let h = ggx_visible_sample(Vec2::new(0.3, 0.8), wo, alpha);
/// let pdf = ggx_visible_pdf(h, wo, alpha) / (4.0 * wo.dot(h));
/// let wi = ggx_reflect(wo, h);
/// assert!((ggx_visible_direction_pdf(wo, wi, alpha) / pdf - 1.0).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn ggx_visible_direction_pdf(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    0.25 * ggx_d_between(wo, wi, alpha) / ggx_projected_area(wo, alpha)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn below_and_straight_below() {
        let alpha = Vec2::splat(0.3);
        for wo in [-Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec3::X] {
            let h = ggx_visible_sample(Vec2::new(0.3, 0.7), wo, alpha);
            assert!((h.length() - 1.0).abs() < 1e-6, "{wo} {h}");
            let p = ggx_visible_pdf(h, wo, alpha);
            assert!(p.is_finite(), "{wo} {h} {p}");
        }
    }
}
