//! Reflection rays: one below the horizon gets an alternative, the sample
//! space may be trimmed toward the mirror, and roughness decides whether a ray
//! is worth it.
//!
//! After PICA PICA (*Hybrid Rendering for Real-Time Ray Tracing*, Ray Tracing
//! Gems 2019, 25.2.2): its reflection rays are drawn from microfacet normals,
//! those below the horizon are detected and replaced, and the sample space is
//! biased a bit toward the mirror direction. Shading frame: normal = +z.

use glam::{Vec2, Vec3};

use super::ggx::{ggx_d_between, ggx_projected_area, ggx_reflect};
use super::ggx_ndf::{ggx_ndf_direction_pdf, ggx_ndf_sample};
use super::ggx_visible::ggx_visible_sample;

/// A mirror: one ray, no density, no denoising.
pub const REFLECTION_MIRROR: u32 = 0;
/// Glossy: a sampled ray.
pub const REFLECTION_SAMPLED: u32 = 1;
/// Rough: no ray, a diffuse lookup.
pub const REFLECTION_DIFFUSE: u32 = 2;

/// A reflection ray.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::reflection::reflection_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let ray = reflection_sample(Vec2::new(0.3, 0.8), wo, Vec2::splat(0.1));
/// assert!(ray.pdf > 0.0 && ray.direction.z >= 0.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReflectionRay {
    /// Toward the light; unit.
    pub direction: Vec3,
    /// Density of the direction, per steradian, however it came about; 0 if
    /// the sample is to be dropped.
    pub pdf: f32,
    /// 1 if the ray first drawn pointed below the horizon, else 0.
    pub below: u32,
}

/// What to do at a surface of this perceptual roughness: below `mirror`
/// [`REFLECTION_MIRROR`], up to `diffuse` [`REFLECTION_SAMPLED`], above it
/// [`REFLECTION_DIFFUSE`].
///
/// ```
/// use raytwin_cpu::brdf::reflection::{
///     REFLECTION_DIFFUSE, REFLECTION_MIRROR, REFLECTION_SAMPLED,
///     reflection_kind,
/// };
///
/// assert_eq!(reflection_kind(0.01, 0.05, 0.7), REFLECTION_MIRROR);
/// assert_eq!(reflection_kind(0.3, 0.05, 0.7), REFLECTION_SAMPLED);
/// assert_eq!(reflection_kind(0.9, 0.05, 0.7), REFLECTION_DIFFUSE);
/// ```
#[inline]
#[must_use]
pub fn reflection_kind(roughness: f32, mirror: f32, diffuse: f32) -> u32 {
    if roughness < mirror {
        return REFLECTION_MIRROR;
    }
    if roughness > diffuse {
        return REFLECTION_DIFFUSE;
    }
    REFLECTION_SAMPLED
}

/// A reflection by visible normals that is never below the horizon: where it
/// would be, the direction mirrored at the surface is the alternative.
///
/// Two directions then end in one, and [`reflection_pdf`] is the sum of their
/// densities: nothing is dropped, and the density integrates to one. Only a
/// view from below (`wo.z <= 0`) is dropped.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::reflection::reflection_sample;
///
/// // Rough and seen from the side, many rays would go below the horizon.
/// let wo = Vec3::new(0.98, 0.0, 0.199);
/// let alpha = Vec2::splat(0.8);
/// for i in 0..16 {
///     let ray = reflection_sample(Vec2::new(i as f32 / 16.0, 0.3), wo, alpha);
///     assert!(ray.direction.z >= 0.0 && ray.pdf > 0.0);
/// }
/// ```
#[inline]
#[must_use]
pub fn reflection_sample(u: Vec2, wo: Vec3, alpha: Vec2) -> ReflectionRay {
    let d = ggx_reflect(wo, ggx_visible_sample(u, wo, alpha));
    let direction = Vec3::new(d.x, d.y, d.z.abs());
    ReflectionRay {
        direction,
        pdf: reflection_pdf(wo, direction, alpha),
        below: u32::from(d.z < 0.0),
    }
}

/// Density of [`reflection_sample`], per steradian: that of `wi` and that of
/// its mirror image below the surface. 0 below the horizon.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::reflection::{reflection_pdf, reflection_sample};
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.5);
/// let ray = reflection_sample(Vec2::new(0.3, 0.8), wo, alpha);
/// assert_eq!(ray.pdf, reflection_pdf(wo, ray.direction, alpha));
/// assert_eq!(reflection_pdf(wo, Vec3::NEG_Z, alpha), 0.0);
/// ```
#[inline]
#[must_use]
pub fn reflection_pdf(wo: Vec3, wi: Vec3, alpha: Vec2) -> f32 {
    if wo.z <= 0.0 || wi.z < 0.0 {
        return 0.0;
    }
    let image = Vec3::new(wi.x, wi.y, -wi.z);
    let d = ggx_d_between(wo, wi, alpha) + ggx_d_between(wo, image, alpha);
    0.25 * d / ggx_projected_area(wo, alpha)
}

/// A reflection by the normal distribution with its sample space trimmed to
/// the part `trim`, in `(0, 1]`, nearest to the mirror direction.
///
/// Narrower lobes make less noise and are wrong: the light of the tail is
/// missing. A filter that divides by the sum of weights
/// (`spatial_reconstruct`) puts the energy back, not the tail's shape. Below
/// the horizon the sample is dropped.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::reflection::reflection_trimmed_sample;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let mirror = Vec3::new(-0.6, 0.0, 0.8);
/// let (u, alpha) = (Vec2::new(0.9, 0.8), Vec2::splat(0.3));
/// // Trimmed, the same numbers give a ray nearer to the mirror direction.
/// let all = reflection_trimmed_sample(u, wo, alpha, 1.0);
/// let trimmed = reflection_trimmed_sample(u, wo, alpha, 0.5);
/// assert!(trimmed.direction.dot(mirror) > all.direction.dot(mirror));
/// ```
#[inline]
#[must_use]
pub fn reflection_trimmed_sample(u: Vec2, wo: Vec3, alpha: Vec2, trim: f32) -> ReflectionRay {
    let d = ggx_reflect(wo, ggx_ndf_sample(Vec2::new(u.x * trim, u.y), alpha));
    let below = d.z <= 0.0;
    ReflectionRay {
        direction: d,
        pdf: if below {
            0.0
        } else {
            ggx_ndf_direction_pdf(wo, d, alpha) / trim
        },
        below: u32::from(below),
    }
}

/// Density of [`reflection_trimmed_sample`], per steradian; 0 outside of the
/// trimmed part, whose rim counts as 2^-18 wide, and at or below the horizon.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::brdf::reflection::reflection_trimmed_pdf;
///
/// let wo = Vec3::new(0.6, 0.0, 0.8);
/// let mirror = Vec3::new(-0.6, 0.0, 0.8);
/// let alpha = Vec2::splat(0.3);
/// // Half of the sample space, so twice as dense, and nothing far off.
/// let all = reflection_trimmed_pdf(wo, mirror, alpha, 1.0);
/// assert_eq!(reflection_trimmed_pdf(wo, mirror, alpha, 0.5), 2.0 * all);
/// assert_eq!(reflection_trimmed_pdf(wo, Vec3::X, alpha, 0.5), 0.0);
/// ```
#[inline]
#[must_use]
pub fn reflection_trimmed_pdf(wo: Vec3, wi: Vec3, alpha: Vec2, trim: f32) -> f32 {
    let m = Vec3::new(wo.x + wi.x, wo.y + wi.y, wo.z + wi.z);
    let x = alpha.y * m.x;
    let y = alpha.x * m.y;
    let z = alpha.x * alpha.y * m.z;
    let side = x * x + y * y;
    // The radius that the normal was drawn with, side / (side + z²).
    if side > trim * (1.0 + 1.0 / 262_144.0) * (side + z * z) {
        return 0.0;
    }
    ggx_ndf_direction_pdf(wo, wi, alpha) / trim
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: u16) -> impl Iterator<Item = Vec2> {
        let at = move |k: u16| (f32::from(k) + 0.5) / f32::from(n);
        (0..n).flat_map(move |i| (0..n).map(move |j| Vec2::new(at(i), at(j))))
    }

    #[test]
    fn kinds() {
        assert_eq!(reflection_kind(0.01, 0.05, 0.75), REFLECTION_MIRROR);
        assert_eq!(reflection_kind(0.05, 0.05, 0.75), REFLECTION_SAMPLED);
        assert_eq!(reflection_kind(0.9, 0.05, 0.75), REFLECTION_DIFFUSE);
    }

    #[test]
    fn no_ray_points_below_and_the_density_knows_the_alternative() {
        for alpha in [0.1, 0.5, 1.0] {
            let alpha = Vec2::splat(alpha);
            for z in [0.05f32, 0.4, 1.0] {
                let wo = Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z);
                // ∫ 1 over the hemisphere, by the sampler's own density: 2π if
                // that density is right.
                let (mut sum, mut below) = (0.0, 0);
                for u in grid(512) {
                    let r = reflection_sample(u, wo, alpha);
                    assert!(r.direction.z >= 0.0 && r.pdf.is_finite());
                    // Where the density is tiny nothing was drawn.
                    sum += f64::from(r.direction.z / r.pdf);
                    below += r.below;
                }
                let cosine = sum / (512.0 * 512.0) / std::f64::consts::PI;
                if alpha.x == 1.0 {
                    assert!((cosine - 1.0).abs() < 0.02, "{z}: {cosine}");
                    assert!(below > 0);
                }
            }
        }
    }

    #[test]
    fn trimmed_rays_are_where_their_density_is() {
        let alpha = Vec2::new(0.5, 0.3);
        let wo = Vec3::new(0.6, 0.0, 0.8);
        for u in grid(64) {
            let r = reflection_trimmed_sample(u, wo, alpha, 0.7);
            let p = reflection_trimmed_pdf(wo, r.direction, alpha, 0.7);
            assert!((r.pdf - p).abs() <= 1e-5 * p, "{u}: {} {p}", r.pdf);
            let outside =
                reflection_trimmed_sample(Vec2::new(1.2 + 0.2 * u.x, u.y), wo, alpha, 0.7);
            assert_eq!(
                reflection_trimmed_pdf(wo, outside.direction, alpha, 0.7),
                0.0
            );
        }
    }
}
