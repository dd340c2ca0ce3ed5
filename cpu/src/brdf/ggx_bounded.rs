//! Visible microfacet normals, fewer of them such as reflect below the horizon.
//!
//! Eto and Tokuyoshi, *Bounding Spherical Caps for Sampling the GGX Visible
//! Normal Distribution*, SIGGRAPH Asia 2023 Technical Communications: the
//! cap's lower rim is lifted to a bound of what can still reflect upward. For
//! reflection only; the best of the three GGX samplers.

use glam::{Vec2, Vec3};

use super::ggx::{GGX_TINY, ggx_d, ggx_d_between, ggx_projected_area, ggx_stretched};
use super::ggx_visible::{
    ggx_visible_drop, ggx_visible_stretch, ggx_visible_unit, ggx_visible_unstretch,
};
use crate::math::trig::{atan2_turn, sincos_turn};
use crate::math::vector::vec3_dot;

/// Largest `f32` below one: what `invert` may return at most.
const ONE_BELOW: f32 = 0.99999994;

/// How much of the cap's depth below the equator is left out, in `[0, 1]`:
/// `1 - k` of the paper, as `a² (s² + cos²) / (s² + a² cos²)`, which does not
/// cancel; 0 for a viewer below the surface.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_bounded::ggx_bounded_lift;
///
/// // From above a fair part of the normals need not be drawn.
/// let alpha = Vec2::splat(0.3);
/// let lift = ggx_bounded_lift(Vec3::new(0.6, 0.0, 0.8), alpha);
/// assert!(lift > 0.0 && lift <= 1.0);
/// assert_eq!(ggx_bounded_lift(Vec3::NEG_Z, alpha), 0.0);
/// ```
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
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_bounded::ggx_bounded_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let h = ggx_bounded_sample(Vec2::new(0.3, 0.8), wo, Vec2::splat(0.3));
/// // A unit normal on the viewer's side.
/// assert!((h.length() - 1.0).abs() < 1e-6 && h.dot(wo) > 0.0);
/// ```
#[inline]
#[must_use]
pub fn ggx_bounded_sample(u: Vec2, wo: Vec3, alpha: Vec2) -> Vec3 {
    let o = ggx_visible_stretch(wo, alpha);
    let lift = ggx_bounded_lift(wo, alpha);
    let span = 1.0 + (1.0 - lift) * o.z;
    let x = u.x * span;
    let deep = lift * o.z;
    let height = (1.0 - u.x) * span;
    let r = (x * ((ggx_visible_drop(o) + deep) + height)).sqrt();
    let turn = sincos_turn(u.y);
    let m = Vec3::new(
        alpha.x * (r * turn.y + o.x),
        alpha.y * (r * turn.x + o.y),
        height + deep,
    );
    ggx_visible_unit(m)
}

/// The `u` that [`ggx_bounded_sample`] maps to `h`.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_bounded::{
///     ggx_bounded_invert, ggx_bounded_sample,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let u = Vec2::new(0.3, 0.8);
/// let back = ggx_bounded_invert(ggx_bounded_sample(u, wo, alpha), wo, alpha);
/// assert!((back - u).length() < 1e-4);
/// ```
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
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_bounded::{ggx_bounded_pdf, ggx_bounded_sample};
/// use raytwin_cpu::brdf::ggx_visible::ggx_visible_pdf;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let h = ggx_bounded_sample(Vec2::new(0.3, 0.8), wo, alpha);
/// // Fewer normals are drawn, so each is denser.
/// assert!(ggx_bounded_pdf(h, wo, alpha) > ggx_visible_pdf(h, wo, alpha));
/// ```
#[inline]
#[must_use]
pub fn ggx_bounded_pdf(h: Vec3, wo: Vec3, alpha: Vec2) -> f32 {
    let area = ggx_bounded_area(wo, alpha);
    if area < GGX_TINY {
        return 0.0;
    }
    ggx_d(h, alpha) * vec3_dot(wo, h).max(0.0) / area
}

/// 1/2π.
const INV_TWO_PI: f32 = 0.15915494;

/// A reflected direction with its density.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_bounded::ggx_bounded_direction_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let ray =
///     ggx_bounded_direction_sample(Vec2::new(0.3, 0.8), wo, Vec2::splat(0.3));
/// assert!(ray.pdf > 0.0 && ray.direction.z > 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct GgxBoundedDirection {
    /// Toward the light; unit.
    pub direction: Vec3,
    /// [`ggx_bounded_direction_pdf`] of it, per steradian; 0 for a sample that
    /// is to be dropped.
    pub pdf: f32,
}

/// [`ggx_bounded_sample`], reflected, with [`ggx_bounded_direction_pdf`]: both
/// from the same lengths, at less than half the price of the three calls.
///
/// With the cap's point plus the view `n` and its stretch `m`, `wo·m` is
/// `|wo|ₛ n²/2`, so the mirrored view is `m |wo|ₛ n²/m² - wo` without a root,
/// and `D` is `(m²/n²)²/(π αx αy)`. A direction at or below the horizon has
/// density 0, as has any for a viewer there.
///
/// Error analysis: lengths are sums of squares; what cancels is the direction
/// itself where it meets the horizon, and `n` where the normal is at a right
/// angle to the view.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx_bounded::{
///     ggx_bounded_direction_pdf, ggx_bounded_direction_sample,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let ray = ggx_bounded_direction_sample(Vec2::new(0.3, 0.8), wo, alpha);
/// let pdf = ggx_bounded_direction_pdf(wo, ray.direction, alpha);
/// assert!((ray.pdf / pdf - 1.0).abs() < 1e-4);
/// ```
// Always: called, a loop over it would not vectorise, which is worth a factor
// of three.
#[inline(always)]
#[must_use]
pub fn ggx_bounded_direction_sample(u: Vec2, wo: Vec3, alpha: Vec2) -> GgxBoundedDirection {
    // From below nothing is drawn; computed all the same, so that a loop over
    // this has no branch.
    let z = wo.z.max(0.0);
    let wide = Vec2::new(alpha.x * wo.x, alpha.y * wo.y);
    let side = wide.x * wide.x + wide.y * wide.y;
    let length = (side + z * z).sqrt();
    let up = length + z;
    // One quotient for 1/length and for 1 - oz.
    let inverse = 1.0 / (length * up).max(GGX_TINY);
    let scale = inverse * up;
    let ox = wide.x * scale;
    let oy = wide.y * scale;
    let oz = z * scale;
    // ggx_bounded_lift.
    let a = alpha.x.min(alpha.y).min(1.0);
    let s = 1.0 + (wo.x * wo.x + wo.y * wo.y).sqrt();
    let square = s * s;
    let az = a * z;
    let lift = a * a * (square + z * z) / (square + az * az);
    let kept = 1.0 - lift;
    let span = 1.0 + kept * oz;
    let x = u.x * span;
    let deep = lift * oz;
    let height = (1.0 - u.x) * span;
    let drop = side * inverse;
    let r = (x * ((drop + deep) + height)).sqrt();
    let turn = sincos_turn(u.y);
    let n = Vec3::new(r * turn.y + ox, r * turn.x + oy, height + deep);
    let m = Vec3::new(alpha.x * n.x, alpha.y * n.y, n.z);
    let ratio = vec3_dot(n, n) / vec3_dot(m, m).max(GGX_TINY);
    let to = length * ratio;
    let direction = Vec3::new(to * m.x - wo.x, to * m.y - wo.y, to * m.z - wo.z);
    let area = alpha.x * alpha.y * (kept * z + length);
    let pdf = INV_TWO_PI / (ratio * ratio * area).max(GGX_TINY);
    let drawn = wo.z > 0.0 && direction.z > 0.0;
    GgxBoundedDirection {
        direction,
        pdf: if drawn { pdf } else { 0.0 },
    }
}

/// Density of the reflected directions, per steradian: `D / (4 · area)`.
///
/// 0 if either direction is at or below the horizon: reflections that end
/// there are to be dropped, and the density integrates to one less their part.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::ggx::ggx_reflect;
/// use raytwin_cpu::brdf::ggx_bounded::{
///     ggx_bounded_direction_pdf, ggx_bounded_pdf, ggx_bounded_sample,
/// };
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// let h = ggx_bounded_sample(Vec2::new(0.3, 0.8), wo, alpha);
/// // Density of the normal over 4 (wo·h), as for any reflected half vector.
/// let pdf = ggx_bounded_pdf(h, wo, alpha) / (4.0 * wo.dot(h));
/// let wi = ggx_reflect(wo, h);
/// assert!((ggx_bounded_direction_pdf(wo, wi, alpha) / pdf - 1.0).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn ggx_bounded_direction_pdf(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 || wi.z <= 0.0 {
        return 0.0;
    }
    0.25 * ggx_d_between(wo, wi, alpha) / ggx_bounded_area(wo, alpha)
}
