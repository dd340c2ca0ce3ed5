//! Surfels: discs that cover what the camera sees and keep its irradiance.
//!
//! Three questions. **How much does a surfel cover a point** ([`surfel_weight`]):
//! a distance that counts more along the normal, a smooth rim, a falloff by
//! angle. **Where is one missing** ([`surfel_coverage`], [`surfel_tile_key`],
//! [`surfel_spawn_chance`]): the pixel of each tile that is covered least, with
//! a chance that follows the area it sees. **What light is there**
//! ([`surfel_gather`]): the weighted mean of the surfels around.
//!
//! Source: Barré-Brisebois et al., *Hybrid Rendering for Real-Time Ray Tracing*
//! (Ray Tracing Gems, chapter 25), section on diffuse global illumination;
//! Lehtinen et al., *A Meshless Hierarchical Representation for Light Transport*
//! (2008) for squashed kernels; Jiménez et al., *Practical Real-Time Strategies
//! for Accurate Indirect Occlusion* (2016) for coloured occlusion.

use glam::{UVec2, Vec3};

use crate::math::vector::{vec3_cross, vec3_dot};
use crate::random::pcg::{pcg_hash, pcg_seed, pcg_unit};
use crate::ray::camera::Camera;

/// How many times farther a distance along the normal counts.
pub const SURFEL_SQUASH: f32 = 4.0;

/// A squared distance that is far for every surfel; none is given larger.
pub const SURFEL_FAR: f32 = 1e6;

/// Largest magnitude of a usable number: positions, irradiance.
pub const SURFEL_LARGEST: f32 = 1e15;

/// Radii of usable surfels.
pub const SURFEL_RADIUS_MIN: f32 = 1e-9;
/// Radii of usable surfels.
pub const SURFEL_RADIUS_MAX: f32 = 1e9;

/// Entries of a list that are looked at; what comes after is left out.
pub const SURFEL_WALK: u32 = 1024;

/// Sum of weights below which nothing counts as covered by a mean.
pub const SURFEL_COVERED: f32 = 0.001;

/// Smallest cosine of the area a pixel sees: grazing ones see no more.
pub const SURFEL_GRAZING: f32 = 0.0625;

/// Key of a pixel without a surface: above every other.
pub const SURFEL_TILE_EMPTY: u32 = 0xffff_ffff;

/// A disc on a surface. Its irradiance is kept apart.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_sound};
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 3 };
/// assert_eq!(surfel_sound(surfel), 1);
/// assert_eq!(surfel_sound(Surfel { radius: 0.0, ..surfel }), 0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Surfel {
    /// Its middle, in the world.
    pub position: Vec3,
    /// Its radius, above 0.
    pub radius: f32,
    /// Its unit normal.
    pub normal: Vec3,
    /// Which object it lies on.
    pub mesh: u32,
}

/// A weighted mean of irradiance.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_gather};
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 3 };
/// // Far from all surfels nothing is known.
/// let far = surfel_gather(
///     10.0 * Vec3::X,
///     Vec3::Y,
///     UVec2::new(0, 1),
///     |_| surfel,
///     |_| Vec3::ONE,
/// );
/// assert_eq!((far.irradiance, far.weight), (Vec3::ZERO, 0.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct SurfelGathered {
    /// The mean, in watts per square metre; 0 where nothing covers.
    pub irradiance: Vec3,
    /// Sum of the weights; 0 where nothing covers.
    pub weight: f32,
}

/// Magnitude as bits: NaN and infinity have the largest ones.
#[inline(always)]
fn surfel_bits(value: f32) -> u32 {
    value.to_bits() & 0x7fff_ffff
}

#[inline(always)]
fn surfel_bits3(v: Vec3) -> u32 {
    surfel_bits(v.x).max(surfel_bits(v.y)).max(surfel_bits(v.z))
}

/// 1 if a surfel can cover anything: its numbers are finite, its radius between
/// [`SURFEL_RADIUS_MIN`] and [`SURFEL_RADIUS_MAX`], its normal has (about) unit length.
///
/// By bit pattern, as WGSL lets an implementation assume that no NaN occurs.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_sound};
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 3 };
/// assert_eq!(surfel_sound(surfel), 1);
/// assert_eq!(
///     surfel_sound(Surfel { position: Vec3::splat(f32::NAN), ..surfel }),
///     0
/// );
/// ```
#[inline]
#[must_use]
pub fn surfel_sound(surfel: Surfel) -> u32 {
    let radius = surfel.radius.to_bits();
    if surfel_bits3(surfel.position) > SURFEL_LARGEST.to_bits()
        || surfel_bits3(surfel.normal) > 0x4000_0000
        || radius < SURFEL_RADIUS_MIN.to_bits()
        || radius > SURFEL_RADIUS_MAX.to_bits()
    {
        return 0;
    }
    u32::from(vec3_dot(surfel.normal, surfel.normal) > 0.98)
}

/// Squared distance of a point from a surfel, in radii, with the part along the
/// normal [`SURFEL_SQUASH`] times as long: 1 on the rim, at most [`SURFEL_FAR`].
///
/// For a sound surfel and a finite point.
///
/// Source: Lehtinen et al. 2008 (the Mahalanobis metric of a flat ellipsoid).
///
/// Error analysis: the part within the plane comes from a cross product, not
/// from a difference of squares, so it may cancel only where the part along the
/// normal is larger. The sum of squares errs by a few ULP.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_distance_squared};
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 3 };
/// assert_eq!(surfel_distance_squared(surfel, Vec3::new(0.5, 0.0, 0.0)), 1.0);
/// // Above the surface the rim is four times as near.
/// assert_eq!(surfel_distance_squared(surfel, Vec3::new(0.0, 0.125, 0.0)), 1.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_distance_squared(surfel: Surfel, point: Vec3) -> f32 {
    let x = point.x - surfel.position.x;
    let y = point.y - surfel.position.y;
    let z = point.z - surfel.position.z;
    // Squares of what is farther may be infinite.
    if x.abs().max(y.abs()).max(z.abs()) >= 1024.0 * surfel.radius {
        return SURFEL_FAR;
    }
    let to = Vec3::new(x / surfel.radius, y / surfel.radius, z / surfel.radius);
    let across = vec3_cross(surfel.normal, to);
    let along = SURFEL_SQUASH * vec3_dot(surfel.normal, to);
    (vec3_dot(across, across) + along * along).min(SURFEL_FAR)
}

/// How much of a surfel is left at a squared distance: 1 in its middle, 0 from
/// the rim (1) on, smoothly at both: `(1 - m)²(1 + 2m)`.
///
/// Error analysis: `1 - m` is taken as `(1 - m²)/(1 + m)`, where only the
/// argument's own error is left at the rim.
///
/// ```
/// use raytwin_cpu::gi::surfel::surfel_attenuation;
///
/// assert_eq!(surfel_attenuation(0.0), 1.0);
/// assert_eq!(surfel_attenuation(0.25), 0.5);
/// assert_eq!(surfel_attenuation(1.0), 0.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_attenuation(distance_squared: f32) -> f32 {
    if distance_squared >= 1.0 {
        return 0.0;
    }
    let m = distance_squared.max(0.0).sqrt();
    let rest = ((1.0 - distance_squared) / (1.0 + m)).min(1.0);
    ((rest * rest) * (1.0 + 2.0 * m)).min(1.0)
}

/// How much two unit normals agree: the square of their cosine, 0 from a right
/// angle on. Symmetric, and smooth at the right angle.
///
/// Error analysis: the dot product may cancel: absolute, an ULP or two of 1.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::surfel_facing;
///
/// assert_eq!(surfel_facing(Vec3::Y, Vec3::Y), 1.0);
/// assert!(
///     (surfel_facing(Vec3::Y, Vec3::new(0.6, 0.8, 0.0)) - 0.64).abs() < 1e-6
/// );
/// assert_eq!(surfel_facing(Vec3::Y, Vec3::NEG_Y), 0.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_facing(normal: Vec3, other: Vec3) -> f32 {
    let cosine = vec3_dot(normal, other).clamp(0.0, 1.0);
    cosine * cosine
}

/// How much a surfel covers a point with a unit normal, in `[0, 1]`.
///
/// 0 for surfels that are not sound, and for points and normals that are not
/// finite.
///
/// Error analysis: the product of [`surfel_attenuation`] and
/// [`surfel_facing`]; absolute, a few ULP of 1.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_weight};
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 3 };
/// assert_eq!(surfel_weight(surfel, Vec3::ZERO, Vec3::Y), 1.0);
/// // At the rim, and on a wall.
/// assert_eq!(surfel_weight(surfel, 0.5 * Vec3::X, Vec3::Y), 0.0);
/// assert_eq!(surfel_weight(surfel, Vec3::ZERO, Vec3::X), 0.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_weight(surfel: Surfel, point: Vec3, normal: Vec3) -> f32 {
    if surfel_sound(surfel) == 0
        || surfel_bits3(point) > SURFEL_LARGEST.to_bits()
        || surfel_bits3(normal) > 0x4000_0000
    {
        return 0.0;
    }
    let distance = surfel_distance_squared(surfel, point);
    surfel_attenuation(distance) * surfel_facing(surfel.normal, normal)
}

/// How much the surfels of a list cover a point: the sum of their weights.
///
/// `list` is the first entry and how many there are, of which the first
/// [`SURFEL_WALK`] count; `read` gives an entry's surfel.
///
/// Error analysis: a sum of terms that are not negative.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_coverage};
///
/// let surfel =
///     Surfel { position: Vec3::ZERO, radius: 0.5, normal: Vec3::Y, mesh: 3 };
/// let surfels = [surfel, surfel];
/// // Both of the list, whose first entry is 0.
/// let read = |entry: u32| surfels[entry as usize];
/// assert_eq!(surfel_coverage(Vec3::ZERO, Vec3::Y, UVec2::new(0, 2), read), 2.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_coverage(
    point: Vec3,
    normal: Vec3,
    list: UVec2,
    read: impl Fn(u32) -> Surfel,
) -> f32 {
    let count = list.y.min(SURFEL_WALK);
    let mut sum = 0.0;
    for i in 0..count {
        sum += surfel_weight(read(list.x.wrapping_add(i)), point, normal);
    }
    sum
}

/// Area in the world that a pixel sees.
///
/// `depth` is along [`Camera::forward`]; `cosine` that between the surface's
/// normal and the ray to the eye, over that between the ray and the axis (for
/// narrow views just the first). Cosines below [`SURFEL_GRAZING`] count as it.
///
/// Error analysis: a cross product, its length and five factors.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::gi::surfel::surfel_pixel_area;
/// use raytwin_cpu::ray::camera::Camera;
///
/// // The image plane at depth 1 is 2 by 2, of 64 by 64 pixels.
/// let camera = Camera {
///     origin: Vec3::ZERO,
///     right: Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::splat(1.0 / 64.0),
/// };
/// assert_eq!(surfel_pixel_area(1.0, 1.0, camera), 4.0 / 4096.0);
/// assert_eq!(surfel_pixel_area(8.0, 0.5, camera), 128.0 * 4.0 / 4096.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_pixel_area(depth: f32, cosine: f32, camera: Camera) -> f32 {
    let image = vec3_cross(camera.right, camera.up);
    let square = vec3_dot(image, image);
    let pixel = camera.inverse_resolution.x * camera.inverse_resolution.y;
    let ahead = depth.max(0.0);
    let plane = (4.0 * square.sqrt()) * pixel;
    ((plane * ahead) * ahead) / cosine.max(SURFEL_GRAZING)
}

/// Key of a pixel in its tile of 16 × 16: the smallest of a tile's keys is that
/// of the pixel that is covered least, and among equals of the first one.
///
/// The coverage counts in steps of 2^-20, to 16; `index` in `0..256`. Exact.
///
/// ```
/// use raytwin_cpu::gi::surfel::{SURFEL_TILE_EMPTY, surfel_tile_key};
///
/// // The smallest key: least covered, and of two such the first pixel.
/// let keys =
///     [(0.5, 0), (0.25, 1), (0.25, 2)].map(|(c, i)| surfel_tile_key(c, i));
/// assert_eq!(keys.into_iter().min(), Some(keys[1]));
/// assert!(keys[0] < SURFEL_TILE_EMPTY);
/// ```
#[inline]
#[must_use]
pub fn surfel_tile_key(coverage: f32, index: u32) -> u32 {
    // The largest key is left for tiles without a surface.
    let steps = (coverage.clamp(0.0, 15.999_998) * 1_048_576.0) as u32;
    (steps << 8) | (index & 255)
}

/// Which pixel of its tile a key is that of.
///
/// ```
/// use raytwin_cpu::gi::surfel::{surfel_tile_index, surfel_tile_key};
///
/// assert_eq!(surfel_tile_index(surfel_tile_key(0.25, 77)), 77);
/// ```
#[inline]
#[must_use]
pub fn surfel_tile_index(key: u32) -> u32 {
    key & 255
}

/// The coverage that a key holds, in steps of 2^-20.
///
/// ```
/// use raytwin_cpu::gi::surfel::{surfel_tile_coverage, surfel_tile_key};
///
/// assert_eq!(surfel_tile_coverage(surfel_tile_key(0.25, 77)), 0.25);
/// ```
#[inline]
#[must_use]
pub fn surfel_tile_coverage(key: u32) -> f32 {
    (key >> 8) as f32 * (1.0 / 1_048_576.0)
}

/// The chance that a tile spawns a surfel in a frame, in `[0, 1]`.
///
/// What is missing to `target_coverage`, times how many surfels of that
/// radius the tile has room for, times `rate`: per frame, so a rate per second
/// times the frame's duration. A wall that fills the view from up close gets as
/// many as from afar, since its tiles are small in the world.
///
/// `pixel_area` as in [`surfel_pixel_area`], `tile_pixels` how many pixels the
/// tile has. Areas below 1e18, radii as of sound surfels; 0 for others.
///
/// Error analysis: a difference and five factors.
///
/// ```
/// use raytwin_cpu::gi::surfel::surfel_spawn_chance;
///
/// // A tile of 256 pixels of 4 mm², radius 10 cm, a rate of 1 a second at 60 Hz.
/// let chance = |coverage| {
///     surfel_spawn_chance(coverage, 0.8, 4e-6, 256.0, 0.1, 1.0 / 60.0)
/// };
/// assert!(chance(0.0) > chance(0.4) && chance(0.4) > 0.0);
/// assert_eq!(chance(0.8), 0.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_spawn_chance(
    coverage: f32,
    target_coverage: f32,
    pixel_area: f32,
    tile_pixels: f32,
    radius: f32,
    rate: f32,
) -> f32 {
    const INV_PI: f32 = 0.318_309_9;
    if coverage >= target_coverage || !(SURFEL_RADIUS_MIN..=SURFEL_RADIUS_MAX).contains(&radius) {
        return 0.0;
    }
    let room = (((pixel_area / radius) / radius) * tile_pixels) * INV_PI;
    (((target_coverage - coverage) * room) * rate).clamp(0.0, 1.0)
}

/// 1 if a pixel spawns a surfel in a frame, with the chance given: the same on
/// every machine.
///
/// ```
/// use glam::UVec2;
/// use raytwin_cpu::gi::surfel::surfel_spawns;
///
/// let pixel = UVec2::new(3, 5);
/// assert_eq!(
///     (surfel_spawns(pixel, 7, 0.0), surfel_spawns(pixel, 7, 1.0)),
///     (0, 1)
/// );
/// // About one frame in four.
/// let often: u32 =
///     (0..1000).map(|frame| surfel_spawns(pixel, frame, 0.25)).sum();
/// assert!((200..300).contains(&often));
/// ```
#[inline]
#[must_use]
pub fn surfel_spawns(pixel: UVec2, frame: u32, chance: f32) -> u32 {
    u32::from(pcg_unit(pcg_hash(pcg_seed(pixel, frame))) < chance)
}

/// A mean of weight `sum` with a value of weight `w` added, between the two.
#[inline(always)]
fn surfel_mix(mean: f32, sum: f32, value: f32, w: f32, total: f32) -> f32 {
    let mixed = (mean * sum + value * w) / total;
    mixed.max(mean.min(value)).min(mean.max(value))
}

/// Irradiance at a point: the mean over a list's surfels by how much they cover
/// it. It lies between the irradiances that count; 0 with weight 0 where the
/// weights sum to less than [`SURFEL_COVERED`].
///
/// `list` and `read` as in [`surfel_coverage`]; `read_irradiance` gives an
/// entry's irradiance. One that is not finite is left out.
///
/// Error analysis: each weight errs by a few ULP of 1, so the mean does by
/// that, over the sum of the weights, times the spread of the irradiances.
///
/// ```
/// use glam::{UVec2, Vec3};
/// use raytwin_cpu::gi::surfel::{Surfel, surfel_gather};
///
/// let at = |x| Surfel {
///     position: Vec3::new(x, 0.0, 0.0),
///     radius: 0.5,
///     normal: Vec3::Y,
///     mesh: 3,
/// };
/// let (surfels, light) = ([at(-0.25), at(0.25)], [Vec3::ONE, Vec3::splat(3.0)]);
/// // In the middle of the two their mean.
/// let found = surfel_gather(
///     Vec3::ZERO,
///     Vec3::Y,
///     UVec2::new(0, 2),
///     |i| surfels[i as usize],
///     |i| light[i as usize],
/// );
/// assert!((found.irradiance - Vec3::splat(2.0)).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn surfel_gather(
    point: Vec3,
    normal: Vec3,
    list: UVec2,
    read: impl Fn(u32) -> Surfel,
    read_irradiance: impl Fn(u32) -> Vec3,
) -> SurfelGathered {
    let count = list.y.min(SURFEL_WALK);
    let mut sum = 0.0;
    let mut mean = Vec3::ZERO;
    for i in 0..count {
        let entry = list.x.wrapping_add(i);
        let w = surfel_weight(read(entry), point, normal);
        if w <= 0.0 {
            continue;
        }
        let value = read_irradiance(entry);
        if surfel_bits3(value) > SURFEL_LARGEST.to_bits() {
            continue;
        }
        let total = sum + w;
        if sum <= 0.0 {
            mean = value;
        } else {
            mean = Vec3::new(
                surfel_mix(mean.x, sum, value.x, w, total),
                surfel_mix(mean.y, sum, value.y, w, total),
                surfel_mix(mean.z, sum, value.z, w, total),
            );
        }
        sum = total;
    }
    if sum < SURFEL_COVERED {
        return SurfelGathered {
            irradiance: Vec3::ZERO,
            weight: 0.0,
        };
    }
    SurfelGathered {
        irradiance: mean,
        weight: sum,
    }
}

#[inline(always)]
fn surfel_occlusion_channel(v: f32, albedo: f32) -> f32 {
    let a = 2.0404 * albedo - 0.3324;
    let b = -4.7951 * albedo + 0.6417;
    let c = 2.7552 * albedo + 0.6903;
    (((v * a + b) * v + c) * v).max(v).min(1.0)
}

/// Ambient occlusion with the light that bounces around in the crevice: between
/// `visibility` (in `[0, 1]`) and 1, for each channel of `albedo` (`[0, 1]`).
///
/// Source: Jiménez et al. 2016, the cubic fit of equation 10.
///
/// Error analysis: the cubic's terms are below 5 and may cancel: absolute.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::gi::surfel::surfel_colored_occlusion;
///
/// // A red crevice throws red light at itself, so it gets less dark in red.
/// let v = surfel_colored_occlusion(0.5, Vec3::new(0.8, 0.1, 0.1));
/// assert!(v.x > v.y && v.y >= 0.5 && v.x <= 1.0);
/// ```
#[inline]
#[must_use]
pub fn surfel_colored_occlusion(visibility: f32, albedo: Vec3) -> Vec3 {
    Vec3::new(
        surfel_occlusion_channel(visibility, albedo.x),
        surfel_occlusion_channel(visibility, albedo.y),
        surfel_occlusion_channel(visibility, albedo.z),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc() -> Surfel {
        Surfel {
            position: Vec3::new(1.0, 2.0, 3.0),
            radius: 0.5,
            normal: Vec3::new(0.6, 0.0, 0.8),
            mesh: 0,
        }
    }

    fn random(i: u32, lane: u32) -> f32 {
        pcg_unit(pcg_hash(pcg_seed(UVec2::new(i, lane), 77)))
    }

    #[test]
    fn symmetric_squashed_and_zero_outside() {
        let s = disc();
        for i in 0..20_000 {
            let d = Vec3::new(random(i, 0), random(i, 1), random(i, 2)) - 0.5;
            let (a, b) = (s.position + d, s.position - d);
            let w = surfel_weight(s, a, s.normal);
            assert!((w - surfel_weight(s, b, s.normal)).abs() < 3e-6);
            assert!((0.0..=1.0).contains(&w));
            if (a - s.position).length() > 0.500_01 {
                assert_eq!(w, 0.0);
            }
            // Mirrored at the plane through the middle.
            let m = a - s.normal * (2.0 * s.normal.dot(a - s.position));
            assert!((w - surfel_weight(s, m, s.normal)).abs() < 3e-6);
        }
        let plane = Vec3::new(0.8, 0.0, -0.6);
        let near = surfel_distance_squared(s, s.position + plane * 0.25);
        let above = surfel_distance_squared(s, s.position + s.normal * 0.25);
        assert!((near - 0.25).abs() < 1e-5 && (above - 4.0).abs() < 1e-4);
        assert_eq!(
            surfel_facing(s.normal, plane),
            surfel_facing(plane, s.normal)
        );
    }

    #[test]
    fn rim_and_middle_are_smooth_to_first_order() {
        // In distance, not its square: slopes vanish at both ends.
        let at = |m: f64| f64::from(surfel_attenuation((m * m) as f32));
        for h in [1e-2, 1e-3] {
            assert!((at(1.0 - h) - at(1.0)) / h < 4.0 * h);
            assert!((at(0.0) - at(h)) / h < 4.0 * h);
        }
        assert_eq!(surfel_attenuation(1.0), 0.0);
        assert_eq!(surfel_attenuation(0.0), 1.0);
        assert!(surfel_attenuation(1.0f32.next_down()) > 0.0);
        let mut last = 1.0;
        for i in 0..=100_000 {
            let w = surfel_attenuation(i as f32 / 1e5);
            assert!(w <= last);
            last = w;
        }
    }

    #[test]
    fn broken_surfels_and_points_weigh_nothing() {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30];
        let s = disc();
        let none = |s: Surfel, p: Vec3, n: Vec3| assert_eq!(surfel_weight(s, p, n), 0.0, "{s:?}");
        let good = s.position;
        assert!(surfel_weight(s, good, s.normal) > 0.99);
        for b in bad {
            for axis in 0..3 {
                let mut t = s;
                t.position[axis] = b;
                none(t, good, s.normal);
                let mut t = s;
                t.normal[axis] = b;
                none(t, good, s.normal);
                let mut p = good;
                p[axis] = b;
                none(s, p, s.normal);
                let mut n = s.normal;
                n[axis] = b;
                none(s, good, n);
            }
        }
        for radius in [0.0, -0.0, -1.0, f32::NAN, f32::INFINITY, 1e-30, 1e30] {
            none(Surfel { radius, ..s }, good, s.normal);
        }
        // Without a normal every distance would be 0: an endless surfel.
        let normal = Vec3::ZERO;
        none(Surfel { normal, ..s }, good, s.normal);
        assert_eq!(
            surfel_distance_squared(Surfel { normal, ..s }, good + 0.4),
            0.0
        );
    }

    #[test]
    fn scale_changes_nothing() {
        let s = disc();
        for power in -10..=10 {
            let k = 2.0f32.powi(power);
            let big = Surfel {
                position: s.position * k,
                radius: s.radius * k,
                ..s
            };
            let d = Vec3::new(0.1, 0.2, -0.1);
            assert_eq!(
                surfel_weight(s, s.position + d, Vec3::Z),
                surfel_weight(big, (s.position + d) * k, Vec3::Z)
            );
            assert_eq!(
                surfel_spawn_chance(0.2, 0.8, 0.01, 256.0, s.radius, 0.01),
                surfel_spawn_chance(0.2, 0.8, 0.01 * k * k, 256.0, big.radius, 0.01)
            );
        }
    }

    #[test]
    fn mean_stays_between_its_inputs() {
        let at = |i: u32| Surfel {
            position: Vec3::new(random(i, 0), random(i, 1), 0.0),
            radius: 0.7,
            normal: Vec3::Z,
            mesh: 0,
        };
        for i in 0..2000 {
            let p = Vec3::new(random(i, 8), random(i, 9), 0.0);
            let list = UVec2::new(i, 30);
            let same = surfel_gather(p, Vec3::Z, list, at, |_| Vec3::new(0.1, 0.3, 1e9));
            assert_eq!(same.irradiance, Vec3::new(0.1, 0.3, 1e9));
            assert_eq!(same.weight, surfel_coverage(p, Vec3::Z, list, at));
            let light = |j: u32| Vec3::splat(2.0 + random(j, 5));
            let mixed = surfel_gather(p, Vec3::Z, list, at, light).irradiance;
            assert!(mixed.x >= 2.0 && mixed.x <= 3.0 && mixed.y == mixed.x);
            // What is not finite is left out, whatever its place.
            let some = |j: u32| {
                if j.is_multiple_of(3) {
                    Vec3::new(f32::NAN, f32::INFINITY, 0.0)
                } else {
                    Vec3::ONE
                }
            };
            assert_eq!(
                surfel_gather(p, Vec3::Z, list, at, some).irradiance,
                Vec3::ONE
            );
        }
        let nothing = surfel_gather(Vec3::splat(50.0), Vec3::Z, UVec2::new(0, 30), at, |_| {
            Vec3::ONE
        });
        assert_eq!((nothing.irradiance, nothing.weight), (Vec3::ZERO, 0.0));
        // A count that is garbage ends.
        let _ = surfel_coverage(Vec3::ZERO, Vec3::Z, UVec2::MAX, at);
    }

    #[test]
    fn weights_of_a_lattice_sum_to_their_area() {
        // A disc holds 0.3 of its area as coverage: 2π ∫ a(m) m dm = 0.3π.
        let (step, radius) = (0.1, 0.5);
        let per_point = 0.3 * std::f32::consts::PI * radius * radius / (step * step);
        let side = 31;
        let at = |i: u32| Surfel {
            position: Vec3::new((i % side) as f32 * step, (i / side) as f32 * step, 0.0),
            radius,
            normal: Vec3::Z,
            mesh: 0,
        };
        for i in 0..200 {
            let p = Vec3::new(1.2 + 0.5 * random(i, 0), 1.2 + 0.5 * random(i, 1), 0.0);
            let c = surfel_coverage(p, Vec3::Z, UVec2::new(0, side * side), at);
            assert!((c / per_point - 1.0).abs() < 0.02, "{c} of {per_point}");
        }
    }

    #[test]
    fn keys_order_by_coverage_then_by_place() {
        assert!(surfel_tile_key(0.25, 200) < surfel_tile_key(0.25, 201));
        assert!(surfel_tile_key(0.25, 255) < surfel_tile_key(0.250_01, 0));
        assert!(surfel_tile_key(1e30, 255) < SURFEL_TILE_EMPTY);
        assert_eq!(surfel_tile_key(0.0, 0), 0);
        assert_eq!(surfel_tile_index(surfel_tile_key(3.5, 77)), 77);
        assert_eq!(surfel_tile_coverage(surfel_tile_key(3.5, 77)), 3.5);
        let coverage: Vec<f32> = (0..256).map(|i| (random(i, 3) * 8.0).floor()).collect();
        let least = (0..256u32)
            .map(|i| surfel_tile_key(coverage[i as usize], i))
            .min()
            .map(surfel_tile_index);
        let first = coverage.iter().position(|c| *c == 0.0);
        assert_eq!(least.map(|i| i as usize), first);
    }

    #[test]
    fn spawn_counts_follow_the_chance() {
        // Chi-square over 64 cells of 4096 draws each, for each chance.
        for chance in [0.001f32, 0.02, 0.3, 0.9] {
            let p = f64::from(chance);
            let expected = 4096.0 * p;
            let mut chi = 0.0;
            for frame in 0..64 {
                let hits = (0..4096)
                    .filter(|i| surfel_spawns(UVec2::new(i % 64, i / 64), frame, chance) == 1)
                    .count() as f64;
                chi += (hits - expected).powi(2) / (expected * (1.0 - p));
            }
            // 64 degrees of freedom: mean 64, deviation 11.3.
            assert!((25.0..130.0).contains(&chi), "{chance}: {chi}");
        }
        for i in 0..10_000 {
            let pixel = UVec2::new(i, 3 * i);
            assert_eq!(surfel_spawns(pixel, i, 0.0), 0);
            assert_eq!(surfel_spawns(pixel, i, 1.0), 1);
        }
    }

    #[test]
    fn a_wall_gets_as_many_from_near_as_from_afar() {
        // Expected surfels a square metre of wall in a frame, at any distance
        // where the chance is not yet 1.
        let camera = Camera {
            origin: Vec3::ZERO,
            right: Vec3::X * 0.8,
            up: Vec3::Y * 0.45,
            forward: Vec3::NEG_Z,
            inverse_resolution: glam::Vec2::new(1.0 / 1920.0, 1.0 / 1080.0),
        };
        let density = |depth: f32| {
            let area = surfel_pixel_area(depth, 1.0, camera);
            let chance = surfel_spawn_chance(0.0, 0.8, area, 256.0, 0.1, 0.1);
            (chance / (256.0 * area), chance * 120.0 * 67.5)
        };
        let (reference, _) = density(1.0);
        for depth in [0.001, 0.01, 0.1, 0.5, 2.0, 4.0] {
            assert!((density(depth).0 / reference - 1.0).abs() < 1e-5);
        }
        // All of a view uncovered, 5 cm from a wall: no flood.
        assert!(density(0.05).1 < 0.02);
        // The naive chance, by what is missing alone, asks for hundreds.
        let naive = 0.8 * 0.1 * 120.0 * 67.5;
        assert!(naive > 500.0);
    }

    #[test]
    fn coloured_occlusion_lies_between_visibility_and_one() {
        for i in 0..=100 {
            for j in 0..=100 {
                let (v, a) = (i as f32 / 100.0, j as f32 / 100.0);
                let o = surfel_colored_occlusion(v, Vec3::new(a, 1.0, 0.0));
                assert!(o.cmpge(Vec3::splat(v)).all() && o.cmple(Vec3::ONE).all());
                assert!(o.y >= o.x && o.x >= o.z);
            }
        }
        assert_eq!(surfel_colored_occlusion(0.0, Vec3::ONE), Vec3::ZERO);
    }
}
