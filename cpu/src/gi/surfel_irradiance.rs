//! The light of surfels: where their rays go, what a ray's light counts, what a
//! hit sends back, and how long a surfel stays.
//!
//! **Radiance** is light along a ray, in watts per square metre and steradian;
//! **irradiance** is what falls on a surface, in watts per square metre. A ray
//! whose density is `cos θ/π` makes one of the other with a factor π alone:
//! the mean of `L cos θ / (cos θ/π)` is `π` times the mean of `L`. A diffuse
//! surface of albedo ρ sends back the radiance `ρ E/π` of an irradiance `E`.
//!
//! A frame of a surfel: [`surfel_irradiance_rays`] rays from
//! [`surfel_irradiance_origin`] in [`surfel_irradiance_direction`]; at each hit
//! [`surfel_irradiance_outgoing`] of direct light and of what the surfels there
//! held a frame ago; the sum of these through [`surfel_irradiance_sample`] into
//! `multiscale_mean_robust_rgb_step`, whose value is the irradiance.
//!
//! Source: Barré-Brisebois et al., *Hybrid Rendering for Real-Time Ray Tracing*
//! (Ray Tracing Gems, chapter 25), section on diffuse global illumination;
//! recycling and limits are ours.

use glam::{UVec3, Vec2, Vec3};

use super::surfel::{SURFEL_LARGEST, Surfel, surfel_sound};
use crate::math::vector::{vec3_dot, vec3_normalize};
use crate::random::pcg::{pcg_unit, pcg3d};
use crate::sample::basis::{basis_from_normal, basis_to_world};
use crate::sample::hemisphere::hemisphere_cosine_sample;

/// π.
const PI: f32 = 3.1415927;
/// 1/π.
const INV_PI: f32 = 0.31830987;

/// Largest albedo that light bounces with, 31/32: without a limit below 1
/// light in a closed room would grow forever. All bounces together are at most
/// 32 times the light of the sources.
pub const SURFEL_IRRADIANCE_ALBEDO: f32 = 0.96875;

/// Where an object is: a rotation as its columns, and a shift.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_irradiance::{
///     SurfelIrradiancePose, surfel_irradiance_follow,
/// };
///
/// // An object as it was modelled.
/// let pose = SurfelIrradiancePose {
///     x: Vec3::X,
///     y: Vec3::Y,
///     z: Vec3::Z,
///     origin: Vec3::ZERO,
/// };
/// let surfel =
///     Surfel { position: Vec3::ONE, radius: 0.2, normal: Vec3::Y, mesh: 0 };
/// assert_eq!(surfel_irradiance_follow(surfel, pose, pose), surfel);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SurfelIrradiancePose {
    /// Where the object's x axis points: a unit vector.
    pub x: Vec3,
    /// Where its y axis points.
    pub y: Vec3,
    /// Where its z axis points.
    pub z: Vec3,
    /// Where its origin is.
    pub origin: Vec3,
}

/// How many rays a surfel wants in a frame: `most` in its first (`age` 0), a
/// half in its second, a third in its third, and 1 from `most` frames on. None
/// if `most` is 0.
///
/// ```
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_rays;
///
/// let rays = [0, 1, 2, 100].map(|age| surfel_irradiance_rays(age, 16));
/// assert_eq!(rays, [16, 8, 5, 1]);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_rays(age: u32, most: u32) -> u32 {
    if most == 0 {
        return 0;
    }
    (most / age.min(0xffff_fffe).wrapping_add(1)).max(1)
}

/// How many of the rays that it wants a surfel gets under a budget, when those
/// before it want `before`: all that are left.
///
/// `before` must not wrap; count it saturating.
///
/// ```
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_allowed;
///
/// // Of a budget of 20 rays those before want 12.
/// assert_eq!(surfel_irradiance_allowed(12, 4, 20), 4);
/// assert_eq!(surfel_irradiance_allowed(12, 16, 20), 8);
/// assert_eq!(surfel_irradiance_allowed(30, 16, 20), 0);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_allowed(before: u32, wanted: u32, budget: u32) -> u32 {
    wanted.min(budget - before.min(budget))
}

/// Where a surfel's rays begin: off its middle along the normal, by 1/256 of
/// its radius and by 2^-20 of the position's largest coordinate, which is eight
/// steps of an `f32` there.
///
/// Error analysis: a sum of two products, a product and a sum; relative to the
/// larger of the position and the shift.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_origin;
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 0 };
/// // A little off the surface, so that no ray meets it again.
/// assert_eq!(
///     surfel_irradiance_origin(surfel),
///     Vec3::new(0.0, 0.5 / 256.0, 0.0)
/// );
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_origin(surfel: Surfel) -> Vec3 {
    let p = surfel.position;
    let n = surfel.normal;
    let far = p.x.abs().max(p.y.abs()).max(p.z.abs());
    let off = surfel.radius * 0.00390625 + far * 9.536_743e-7;
    Vec3::new(p.x + n.x * off, p.y + n.y * off, p.z + n.z * off)
}

/// Direction of a surfel's ray: by the cosine about the unit normal, with
/// random numbers that are a function of surfel, frame and ray alone.
///
/// `surfel` is its number. The density is `cos θ/π` per steradian.
///
/// Error analysis: that of the hemisphere's direction and of the basis, both
/// absolute in ULP of 1, and a rotation's three products.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_direction;
///
/// let direction = surfel_irradiance_direction(Vec3::Y, 17, 7, 0);
/// assert!(direction.y >= 0.0 && (direction.length() - 1.0).abs() < 1e-5);
/// // Another ray of the same frame goes elsewhere.
/// assert_ne!(direction, surfel_irradiance_direction(Vec3::Y, 17, 7, 1));
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_direction(normal: Vec3, surfel: u32, frame: u32, ray: u32) -> Vec3 {
    let bits = pcg3d(UVec3::new(surfel, frame, ray));
    let u = Vec2::new(pcg_unit(bits.x), pcg_unit(bits.y));
    let local = hemisphere_cosine_sample(u);
    basis_to_world(basis_from_normal(normal), normal, local)
}

/// What may count as light: 0 for what is negative, NaN, infinite or too large.
/// By bits: all of those lie above the largest usable number.
#[inline(always)]
fn light(x: f32) -> f32 {
    if x.to_bits() > SURFEL_LARGEST.to_bits() {
        return 0.0;
    }
    x
}

#[inline(always)]
fn sample_channel(radiance: f32, rays: f32) -> f32 {
    ((light(radiance) / rays) * PI).min(SURFEL_LARGEST)
}

/// Irradiance by a frame's rays: `π` times the mean of their radiance.
///
/// `radiance` is the sum over the rays, in watts per square metre and
/// steradian, and `rays` how many there were; 0 of none. A channel that is
/// negative, not finite or larger than [`SURFEL_LARGEST`] counts as 0.
///
/// Error analysis: a quotient and a product with the rounded π.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_sample;
///
/// // Four rays that each saw radiance 1: π watts per square metre.
/// let irradiance = surfel_irradiance_sample(Vec3::splat(4.0), 4);
/// assert!((irradiance.x - std::f32::consts::PI).abs() < 1e-6);
/// assert_eq!(surfel_irradiance_sample(Vec3::ZERO, 0), Vec3::ZERO);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_sample(radiance: Vec3, rays: u32) -> Vec3 {
    if rays == 0 {
        return Vec3::ZERO;
    }
    let count = rays as f32;
    Vec3::new(
        sample_channel(radiance.x, count),
        sample_channel(radiance.y, count),
        sample_channel(radiance.z, count),
    )
}

#[inline(always)]
fn outgoing_channel(albedo: f32, emission: f32, direct: f32, gathered: f32) -> f32 {
    let part = light(albedo).min(SURFEL_IRRADIANCE_ALBEDO) * INV_PI;
    (light(emission) + part * (light(direct) + light(gathered))).min(SURFEL_LARGEST)
}

/// Radiance that a diffuse surface sends towards everybody:
/// `emission + albedo/π · (direct + gathered)`.
///
/// `emission` is a radiance, `direct` and `gathered` are irradiances: of the
/// lights, and of everything else ([`surfel_gather`](super::surfel::surfel_gather)).
/// The albedo counts to [`SURFEL_IRRADIANCE_ALBEDO`] at most. A channel that is
/// negative, not finite or larger than [`SURFEL_LARGEST`] counts as 0, so one
/// broken material does not spread.
///
/// Error analysis: sums and products of numbers that are not negative.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_outgoing;
///
/// // A grey surface in irradiance π sends back its albedo as radiance.
/// let light = Vec3::splat(std::f32::consts::PI);
/// let back = surfel_irradiance_outgoing(
///     Vec3::splat(0.5),
///     Vec3::ZERO,
///     light,
///     Vec3::ZERO,
/// );
/// assert!((back.x - 0.5).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_outgoing(
    albedo: Vec3,
    emission: Vec3,
    direct: Vec3,
    gathered: Vec3,
) -> Vec3 {
    Vec3::new(
        outgoing_channel(albedo.x, emission.x, direct.x, gathered.x),
        outgoing_channel(albedo.y, emission.y, direct.y, gathered.y),
        outgoing_channel(albedo.z, emission.z, direct.z, gathered.z),
    )
}

#[inline(always)]
fn into_pose(pose: SurfelIrradiancePose, v: Vec3) -> Vec3 {
    Vec3::new(
        vec3_dot(pose.x, v),
        vec3_dot(pose.y, v),
        vec3_dot(pose.z, v),
    )
}

#[inline(always)]
fn out_of_pose(pose: SurfelIrradiancePose, v: Vec3) -> Vec3 {
    Vec3::new(
        (pose.x.x * v.x + pose.y.x * v.y) + pose.z.x * v.z,
        (pose.x.y * v.x + pose.y.y * v.y) + pose.z.y * v.z,
        (pose.x.z * v.x + pose.y.z * v.y) + pose.z.z * v.z,
    )
}

/// A surfel of an object that moved from one pose to another: where it is on
/// the object stays the same.
///
/// For sound surfels and rotations whose columns have unit length and right
/// angles between them. The normal is brought back to unit length, so that
/// thousands of frames do not shorten it.
///
/// Error analysis: two rotations and two shifts; absolute, a few ULP of the
/// distance from the object's origin and of both origins.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_irradiance::{
///     SurfelIrradiancePose, surfel_irradiance_follow,
/// };
///
/// let old = SurfelIrradiancePose {
///     x: Vec3::X,
///     y: Vec3::Y,
///     z: Vec3::Z,
///     origin: Vec3::ZERO,
/// };
/// // The object has moved and has been turned about y by 90 degrees.
/// let new = SurfelIrradiancePose {
///     x: Vec3::NEG_Z,
///     y: Vec3::Y,
///     z: Vec3::X,
///     origin: Vec3::Y,
/// };
/// let surfel =
///     Surfel { position: Vec3::X, radius: 0.2, normal: Vec3::X, mesh: 0 };
/// let moved = surfel_irradiance_follow(surfel, old, new);
/// assert!((moved.position - Vec3::new(0.0, 1.0, -1.0)).length() < 1e-6);
/// assert!((moved.normal - Vec3::NEG_Z).length() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_follow(
    surfel: Surfel,
    old: SurfelIrradiancePose,
    new_pose: SurfelIrradiancePose,
) -> Surfel {
    let p = surfel.position;
    let away = Vec3::new(p.x - old.origin.x, p.y - old.origin.y, p.z - old.origin.z);
    let moved = out_of_pose(new_pose, into_pose(old, away));
    let normal = out_of_pose(new_pose, into_pose(old, surfel.normal));
    Surfel {
        position: Vec3::new(
            new_pose.origin.x + moved.x,
            new_pose.origin.y + moved.y,
            new_pose.origin.z + moved.z,
        ),
        radius: surfel.radius,
        normal: vec3_normalize(normal),
        mesh: surfel.mesh,
    }
}

/// For how many frames a surfel may go unseen: `patience` while a quarter of
/// the pool is free, then less in 256 steps, and 0 when it is full.
///
/// `patience` counts to 65,535 at most. Exact, for a pool of any size: the steps
/// are the first ten binary digits of the free part, by long division that does
/// not overflow.
///
/// ```
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_patience;
///
/// // Half of the pool is free, an eighth, nothing.
/// assert_eq!(surfel_irradiance_patience(32_768, 65_536, 600), 600);
/// assert_eq!(surfel_irradiance_patience(57_344, 65_536, 600), 300);
/// assert_eq!(surfel_irradiance_patience(65_536, 65_536, 600), 0);
/// // A small pool gives up no earlier.
/// assert_eq!(surfel_irradiance_patience(48, 64, 600), 600);
/// assert_eq!(surfel_irradiance_patience(56, 64, 600), 300);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_patience(used: u32, capacity: u32, patience: u32) -> u32 {
    let free = capacity - used.min(capacity);
    if free == 0 {
        return 0;
    }
    // floor(1024 free/capacity), 1023 for a pool without surfels.
    let mut parts = 0;
    let mut rest = free;
    for _ in 0..10 {
        let more = capacity - rest;
        parts *= 2;
        if rest >= more {
            rest -= more;
            parts += 1;
        } else {
            rest += rest;
        }
    }
    (patience.min(65_535) * parts.min(256)) >> 8
}

/// 1 if a surfel is to be given up: it is not sound, or has gone unseen for
/// more than `patience` frames.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::Surfel;
/// use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_recycle;
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 0 };
/// assert_eq!(surfel_irradiance_recycle(surfel, 600, 600), 0);
/// assert_eq!(surfel_irradiance_recycle(surfel, 601, 600), 1);
/// ```
#[inline]
#[must_use]
pub fn surfel_irradiance_recycle(surfel: Surfel, unseen: u32, patience: u32) -> u32 {
    u32::from(surfel_sound(surfel) == 0 || unseen > patience)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_surfels_get_more_rays() {
        let rays = |age| surfel_irradiance_rays(age, 16);
        assert_eq!([0, 1, 2, 3, 7, 15, 16].map(rays), [16, 8, 5, 4, 2, 1, 1]);
        assert_eq!(rays(u32::MAX), 1);
        assert_eq!(surfel_irradiance_rays(3, 0), 0);
        assert_eq!(surfel_irradiance_rays(0, u32::MAX), u32::MAX);
        assert_eq!(surfel_irradiance_allowed(7, 5, 10), 3);
        assert_eq!(surfel_irradiance_allowed(u32::MAX, 5, 10), 0);
    }

    #[test]
    fn mean_of_a_white_sky_is_pi_and_of_a_lit_half_is_half() {
        let n = Vec3::new(0.6, 0.0, 0.8);
        let sideways = Vec3::Y;
        let mut half = 0u32;
        let mut cosine = 0.0;
        for ray in 0..100_000 {
            let d = surfel_irradiance_direction(n, 7, 3, ray);
            assert!((vec3_dot(d, d) - 1.0).abs() < 1e-6 && vec3_dot(d, n) >= -1e-6);
            cosine += f64::from(vec3_dot(d, n));
            half += u32::from(vec3_dot(d, sideways) > 0.0);
        }
        // Mean cosine of the density: 2/3.
        assert!((cosine / 1e5 - 2.0 / 3.0).abs() < 0.003, "{cosine}");
        let found = surfel_irradiance_sample(Vec3::splat(half as f32), 100_000);
        assert!((found.x - PI / 2.0).abs() < 0.02, "{found}");
        let all = surfel_irradiance_sample(Vec3::splat(3.0), 3);
        assert_eq!(all, Vec3::splat(PI));
    }

    #[test]
    fn broken_light_counts_as_none_and_bounces_lose_energy() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -0.0, 1e30] {
            let b = Vec3::new(bad, 1.0, 1.0);
            assert_eq!(surfel_irradiance_sample(b, 2).x.to_bits(), 0);
            let one = Vec3::ONE;
            for sum in [
                surfel_irradiance_outgoing(b, one, one, one),
                surfel_irradiance_outgoing(one, one, one, b),
                surfel_irradiance_outgoing(one, one, b, one),
                surfel_irradiance_outgoing(one, b, one, one),
            ] {
                assert!(sum.is_finite() && sum.x < sum.y && sum.x >= 0.0, "{sum}");
            }
        }
        let mut e = Vec3::splat(1e14);
        for _ in 0..100 {
            let next = surfel_irradiance_sample(
                surfel_irradiance_outgoing(Vec3::splat(7.0), Vec3::ZERO, Vec3::ZERO, e),
                1,
            );
            assert!(next.x < e.x * 0.97);
            e = next;
        }
        let most = Vec3::splat(SURFEL_LARGEST);
        assert_eq!(surfel_irradiance_outgoing(most, most, most, most), most);
    }

    #[test]
    fn follows_a_turning_object_for_thousands_of_frames() {
        let pose = |i: u32| {
            let turn = f64::from(i) * 0.013;
            let (s, c) = (turn.sin() as f32, turn.cos() as f32);
            SurfelIrradiancePose {
                x: Vec3::new(c, s, 0.0),
                y: Vec3::new(-s, c, 0.0),
                z: Vec3::Z,
                origin: Vec3::new(0.001 * i as f32, 2.0, -0.5),
            }
        };
        let start = Surfel {
            position: Vec3::new(0.4, 2.3, 0.2),
            radius: 0.1,
            normal: Vec3::new(0.0, 0.6, 0.8),
            mesh: 3,
        };
        let mut s = start;
        for i in 0..5000 {
            s = surfel_irradiance_follow(s, pose(i), pose(i + 1));
        }
        let direct = surfel_irradiance_follow(start, pose(0), pose(5000));
        assert!(
            (s.position - direct.position).length() < 1e-4,
            "{s:?} {direct:?}"
        );
        assert!((s.normal - direct.normal).length() < 1e-4);
        assert_eq!((s.radius, s.mesh), (0.1, 3));
        assert_eq!(surfel_sound(s), 1);
    }

    #[test]
    fn patience_ends_as_the_pool_fills() {
        let p = |used| surfel_irradiance_patience(used, 250_000, 600);
        assert_eq!([0, 180_000, 250_000, 300_000].map(p), [600, 600, 0, 0]);
        let mut last = 600;
        for used in 0..=250_000 {
            assert!(p(used) <= last);
            last = p(used);
        }
        assert_eq!(surfel_irradiance_patience(0, 0, 600), 0);
        // A quarter is free, an eighth, a part too small for a step: whatever
        // the size of the pool.
        for capacity in (8..4096).step_by(8).chain([1 << 20, u32::MAX - 7]) {
            let p = |free: u32| surfel_irradiance_patience(capacity - free, capacity, 256);
            let eighth = capacity / 8;
            assert_eq!([capacity, 2 * eighth, eighth].map(p), [256, 256, 128]);
            let below = p(2 * eighth - 1);
            assert!(below < 256, "{capacity}");
        }
        let s = Surfel {
            position: Vec3::ZERO,
            radius: 0.1,
            normal: Vec3::Z,
            mesh: 0,
        };
        assert_eq!(surfel_irradiance_recycle(s, 0, 0), 0);
        assert_eq!(surfel_irradiance_recycle(s, 1, 0), 1);
        let broken = Surfel { radius: 0.0, ..s };
        assert_eq!(surfel_irradiance_recycle(broken, 0, 600), 1);
    }
}
