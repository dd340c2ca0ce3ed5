//! Visible microfacet normals, fewer of them such as reflect below the horizon.
//!
//! Eto and Tokuyoshi, *Bounding Spherical Caps for Sampling the GGX Visible
//! Normal Distribution*, SIGGRAPH Asia 2023 Technical Communications: the
//! cap's lower rim is lifted to a bound of what can still reflect upward. For
//! reflection only; the best of the three GGX samplers.

use glam::{Vec2, Vec3};

use super::ggx::{GGX_TINY, ggx_d, ggx_d_between, ggx_projected_area, ggx_stretched};
use super::ggx_visible::{ggx_visible_stretch, ggx_visible_unit, ggx_visible_unstretch};
use crate::math::trig::{atan2_turn, sincos_turn};
use crate::math::vector::vec3_dot;

/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// How much of the cap's depth below the equator is left out, in `[0, 1]`:
/// `1 - k` of the paper, as `a² (s² + cos²) / (s² + a² cos²)`, which does not
/// cancel; 0 for a viewer below the surface.
#[inline]
#[must_use]
pub fn ggx_bounded_lift(wo: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 {
        return 0.0;
    }
    let a = alpha.x.min(alpha.y).min(1.0);
    let s = 1.0 + (wo.x * wo.x + wo.y * wo.y).sqrt();
    let square = s * s;
    let az = a * wo.z;
    a * a * (square + wo.z * wo.z) / (square + az * az)
}

/// A visible normal that probably reflects `wo` upward; density
/// [`ggx_bounded_pdf`].
#[inline]
#[must_use]
pub fn ggx_bounded_sample(u: Vec2, wo: Vec3, alpha: Vec2) -> Vec3 {
    let o = ggx_visible_stretch(wo, alpha);
    let lift = ggx_bounded_lift(wo, alpha);
    let span = 1.0 + (1.0 - lift) * o.z;
    let x = u.x * span;
    let r = (x * (2.0 - x)).max(0.0).sqrt();
    let turn = sincos_turn(u.y);
    let m = Vec3::new(
        alpha.x * (r * turn.y + o.x),
        alpha.y * (r * turn.x + o.y),
        (1.0 - u.x) * span + lift * o.z,
    );
    ggx_visible_unit(m)
}

/// The `u` that [`ggx_bounded_sample`] maps to `h`.
#[inline]
#[must_use]
pub fn ggx_bounded_invert(h: Vec3, wo: Vec3, alpha: Vec2) -> Vec2 {
    let o = ggx_visible_stretch(wo, alpha);
    let n = ggx_visible_unstretch(h, alpha);
    let k = 2.0 * vec3_dot(o, n);
    let x = (1.0 + o.z) - k * n.z;
    let u = x / (1.0 + (1.0 - ggx_bounded_lift(wo, alpha)) * o.z);
    Vec2::new(
        u.clamp(0.0, ONE_BELOW),
        atan2_turn(k * n.y - o.y, k * n.x - o.x),
    )
}

/// The area that divides the density: that of all visible normals, less the
/// part of the cap that is left out.
#[inline]
fn ggx_bounded_area(wo: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 {
        return ggx_projected_area(wo, alpha);
    }
    0.5 * ((1.0 - ggx_bounded_lift(wo, alpha)) * wo.z + ggx_stretched(wo, alpha))
}

/// Density of [`ggx_bounded_sample`] over half vectors, per steradian, for
/// those that it can give: `D (wo·h) / area`.
#[inline]
#[must_use]
pub fn ggx_bounded_pdf(h: Vec3, wo: Vec3, alpha: Vec2) -> f32 {
    let area = ggx_bounded_area(wo, alpha);
    if area < GGX_TINY {
        return 0.0;
    }
    ggx_d(h, alpha) * vec3_dot(wo, h).max(0.0) / area
}

/// Density of the reflected directions, per steradian: `D / (4 · area)`.
///
/// 0 if either direction is at or below the horizon: reflections that end
/// there are to be dropped, and the density integrates to one less their part.
#[inline]
#[must_use]
pub fn ggx_bounded_direction_pdf(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    0.25 * ggx_d_between(wo, wi, alpha) / ggx_bounded_area(wo, alpha)
}
