//! Where a pixel was in the frame before, and what is left of its history.
//!
//! Three questions, each with its own functions. **Where**: the motion of a
//! surface point ([`reproject_motion`]), or that of what a mirror shows there
//! ([`reproject_reflection_motion`]: the image of the hit point, by the
//! equation of a curved mirror). **Whether**: each texel of the footprint is
//! tested for itself against the surface that should be there
//! ([`reproject_matches`]). **What**: the mean of those that pass
//! ([`reproject_gather`]), and the blend of two such histories by how well they
//! agree with the new frame ([`reproject_share`]).
//!
//! Source: Schied et al., *Spatiotemporal Variance-Guided Filtering* (2017),
//! section 4.1, for four taps tested one by one and a fallback of 3 × 3;
//! Deligiannis, Schmid and Uludag, *Hybrid Rendering for Real-Time Ray Tracing*
//! (Ray Tracing Gems, chapter 25) for the blend of two reprojections; Deschamps,
//! *Ray Techniques in Electromagnetics* (1972) for reflection at a curved
//! surface, at normal incidence the equation of the thin mirror.

use glam::{UVec2, Vec2, Vec3, Vec4};

use crate::math::exponent::exp2_poly;
use crate::math::luminance::luminance;
use crate::math::sanitize::{USABLE_BITS, usable_surface};
use crate::math::vector::{vec3_cross, vec3_dot, vec3_normalize};
use crate::ray::camera::Camera;

/// The motion, in pixels, of a point that the frame before did not show.
pub const REPROJECT_NOWHERE: f32 = 16_777_216.0;

/// Motions of this many pixels and more have no history.
pub const REPROJECT_FAR: f32 = 4_194_304.0;

/// Smallest share of a footprint that must pass the tests.
pub const REPROJECT_COVERAGE: f32 = 0.01;

/// How close to its focus a concave mirror is taken at its word: images are at
/// most 1/this times as far away as what they show.
pub const REPROJECT_FOCUS: f32 = 0.015625;

/// Smallest deviation that counts, relative to the signal.
pub const REPROJECT_DEVIATION: f32 = 0.03125;

/// Limits of the tests that suit most scenes.
pub const REPROJECT_TOLERANCE: ReprojectTolerance = ReprojectTolerance {
    plane: 0.01,
    normal: 0.5,
};

/// What a G-buffer knows of a pixel.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::{
///     REPROJECT_TOLERANCE, ReprojectSurface, reproject_matches,
/// };
///
/// let floor = ReprojectSurface {
///     position: Vec3::ZERO,
///     depth: 5.0,
///     normal: Vec3::Y,
///     mesh: 3,
/// };
/// // A surface is what it is expected to be, if it has not changed.
/// assert_eq!(reproject_matches(floor, 0.0, floor, REPROJECT_TOLERANCE), 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReprojectSurface {
    /// Where its surface is, in the world.
    pub position: Vec3,
    /// Distance from the eye, above 0; not above 0 where there is no surface.
    pub depth: f32,
    /// Its unit normal.
    pub normal: Vec3,
    /// Which object it belongs to.
    pub mesh: u32,
}

/// How far a texel may be from the surface that should be there.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::{
///     REPROJECT_TOLERANCE, ReprojectSurface, ReprojectTolerance,
///     reproject_matches,
/// };
///
/// let floor = ReprojectSurface {
///     position: Vec3::ZERO,
///     depth: 5.0,
///     normal: Vec3::Y,
///     mesh: 3,
/// };
/// let raised = ReprojectSurface { position: Vec3::new(0.0, 0.1, 0.0), ..floor };
/// // A step of 2 % of the depth: too far by the usual limits.
/// assert_eq!(reproject_matches(floor, 0.0, raised, REPROJECT_TOLERANCE), 0);
/// let loose = ReprojectTolerance { plane: 0.05, normal: 0.5 };
/// assert_eq!(reproject_matches(floor, 0.0, raised, loose), 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReprojectTolerance {
    /// Distance from the surface, relative to its depth.
    pub plane: f32,
    /// Distance between the unit normals, about the angle in radians; 2 accepts
    /// any.
    pub normal: f32,
}

/// Which texels of the frame before a pixel takes its history from.
///
/// Texel `3j + i` of `0..9` lies at `corner + (i, j)` and weighs
/// `across[i]·down[j]`, if its bit in `valid` is set; [`reproject_tap`] gives
/// both.
///
/// ```
/// use glam::{UVec2, Vec2};
/// use raytwin_cpu::temporal::reproject::reproject_footprint;
///
/// // Outside of the image nothing counts.
/// let outside =
///     reproject_footprint(UVec2::ZERO, UVec2::splat(8), Vec2::new(-3.0, 0.0));
/// assert_eq!(outside.valid, 0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReprojectTaps {
    /// The first texel; left of the image it is 2^32 - 1, as integers wrap.
    pub corner: UVec2,
    /// Weights of the three columns; they sum to one.
    pub across: Vec3,
    /// Weights of the three rows; they sum to one.
    pub down: Vec3,
    /// A bit for each texel that counts; none: no history.
    pub valid: u32,
}

/// No history.
pub const REPROJECT_NO_TAPS: ReprojectTaps = ReprojectTaps {
    corner: UVec2::ZERO,
    across: Vec3::ZERO,
    down: Vec3::ZERO,
    valid: 0,
};

/// A texel and its weight.
///
/// ```
/// use glam::{UVec2, Vec2};
/// use raytwin_cpu::temporal::reproject::{reproject_footprint, reproject_tap};
///
/// let taps = reproject_footprint(UVec2::splat(4), UVec2::splat(8), Vec2::ZERO);
/// let tap = reproject_tap(taps, 0);
/// assert_eq!((tap.at, tap.weight), (UVec2::splat(4), 1.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReprojectTap {
    /// The texel, inside the image if its weight is above 0.
    pub at: UVec2,
    /// Its weight in `[0, 1]`, not normalised over the valid texels.
    pub weight: f32,
}

/// What has been gathered over the frames before, of one or several channels.
///
/// ```
/// use raytwin_cpu::temporal::reproject::{ReprojectHistory, reproject_blend};
///
/// let none = ReprojectHistory { value: 0.0, length: 0.0 };
/// let some = ReprojectHistory { value: 0.5, length: 8.0 };
/// // Where one has no history, the other counts alone.
/// assert_eq!(reproject_blend(none, some, 0.1), some);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReprojectHistory<V> {
    /// The value.
    pub value: V,
    /// How many frames it stands for; not above 0: no history.
    pub length: f32,
}

/// How position and normal change over a surface, along one direction.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::{ReprojectBend, reproject_curvature};
///
/// // Two points of a sphere of radius 2.
/// let bend = ReprojectBend {
///     along: Vec3::new(2.0, 0.0, -2.0),
///     turn: Vec3::new(1.0, 0.0, -1.0),
/// };
/// assert_eq!(reproject_curvature(bend.along, bend.turn), 0.5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ReprojectBend {
    /// Change of the position.
    pub along: Vec3,
    /// Change of the unit normal over it.
    pub turn: Vec3,
}

/// What a history may hold: a scalar or two to four channels, finite and of
/// either sign. In WGSL it is an alias that the program declares.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::ReprojectValue;
///
/// // Mean of two colours, as a history of any number of channels takes it.
/// fn mean<V: ReprojectValue>(a: V, b: V) -> V {
///     V::NOTHING.plus(a, 0.5).plus(b, 0.5)
/// }
/// assert_eq!(mean(Vec3::X, Vec3::Y), Vec3::new(0.5, 0.5, 0.0));
/// assert_eq!(mean(1.0, 2.0), 1.5);
/// ```
pub trait ReprojectValue: Copy {
    /// Zero in each channel.
    const NOTHING: Self;
    /// `self·weight`.
    ///
    /// ```
    /// use glam::Vec2;
    /// use raytwin_cpu::temporal::reproject::ReprojectValue;
    ///
    /// assert_eq!(
    ///     ReprojectValue::times(Vec2::new(1.0, 2.0), 3.0),
    ///     Vec2::new(3.0, 6.0)
    /// );
    /// ```
    #[must_use]
    fn times(self, weight: f32) -> Self;
    /// `self + other·weight`.
    ///
    /// ```
    /// use raytwin_cpu::temporal::reproject::ReprojectValue;
    ///
    /// assert_eq!(ReprojectValue::plus(1.0, 4.0, 0.5), 3.0);
    /// ```
    #[must_use]
    fn plus(self, other: Self, weight: f32) -> Self;
    /// `self / weight`.
    ///
    /// ```
    /// use glam::Vec2;
    /// use raytwin_cpu::temporal::reproject::ReprojectValue;
    ///
    /// assert_eq!(
    ///     ReprojectValue::over(Vec2::new(1.0, 2.0), 2.0),
    ///     Vec2::new(0.5, 1.0)
    /// );
    /// ```
    #[must_use]
    fn over(self, weight: f32) -> Self;
    /// The smaller one, channel by channel.
    ///
    /// ```
    /// use glam::Vec2;
    /// use raytwin_cpu::temporal::reproject::ReprojectValue;
    ///
    /// let (a, b) = (Vec2::new(1.0, 4.0), Vec2::new(3.0, 2.0));
    /// assert_eq!(ReprojectValue::least(a, b), Vec2::new(1.0, 2.0));
    /// ```
    #[must_use]
    fn least(self, other: Self) -> Self;
    /// The larger one, channel by channel.
    ///
    /// ```
    /// use glam::Vec2;
    /// use raytwin_cpu::temporal::reproject::ReprojectValue;
    ///
    /// let (a, b) = (Vec2::new(1.0, 4.0), Vec2::new(3.0, 2.0));
    /// assert_eq!(ReprojectValue::most(a, b), Vec2::new(3.0, 4.0));
    /// ```
    #[must_use]
    fn most(self, other: Self) -> Self;
}

macro_rules! reproject_value {
    ($($ty:ty = $nothing:expr),+) => {$(
        impl ReprojectValue for $ty {
            const NOTHING: Self = $nothing;
            #[inline(always)]
            fn times(self, weight: f32) -> Self {
                self * weight
            }
            #[inline(always)]
            fn plus(self, other: Self, weight: f32) -> Self {
                self + other * weight
            }
            #[inline(always)]
            fn over(self, weight: f32) -> Self {
                self / weight
            }
            #[inline(always)]
            fn least(self, other: Self) -> Self {
                self.min(other)
            }
            #[inline(always)]
            fn most(self, other: Self) -> Self {
                self.max(other)
            }
        }
    )+};
}
reproject_value!(
    f32 = 0.0,
    Vec2 = Vec2::ZERO,
    Vec3 = Vec3::ZERO,
    Vec4 = Vec4::ZERO
);

/// Where a camera sees a point: in pixels from the upper left corner of its
/// image, `y` down, and the depth along [`Camera::forward`].
///
/// The inverse of `camera_position_from_depth`, for axes that need not be
/// perpendicular. A point behind the eye has a negative depth, and the place
/// where the line through eye and point meets the image. Depth 0 (and place 0)
/// means that there is no such place. Points closer than 1e12 to the eye.
///
/// Error analysis: three triple products, each a sum that may cancel, so the
/// error is that of `|point - eye|` times the length of the reciprocal axis,
/// over the depth: an ULP of the image's width for points inside the image.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::camera::{Camera, camera_position_from_depth};
/// use raytwin_cpu::temporal::reproject::reproject_project;
///
/// let camera = Camera {
///     origin: Vec3::ZERO,
///     right: 2.0 * Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::new(1.0 / 640.0, 1.0 / 320.0),
/// };
/// // Straight ahead is the image's middle; back from there, the point.
/// let seen = reproject_project(Vec3::new(0.0, 0.0, -5.0), camera);
/// assert!((seen - Vec3::new(320.0, 160.0, 5.0)).length() < 1e-3);
/// let point = Vec3::new(3.0, 1.0, -5.0);
/// let seen = reproject_project(point, camera);
/// let back =
///     camera_position_from_depth(Vec2::new(seen.x, seen.y), seen.z, camera);
/// assert!((back - point).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn reproject_project(point: Vec3, camera: Camera) -> Vec3 {
    let to = Vec3::new(
        point.x - camera.origin.x,
        point.y - camera.origin.y,
        point.z - camera.origin.z,
    );
    let across = vec3_cross(camera.right, camera.up);
    let ahead = vec3_dot(to, across);
    let volume = vec3_dot(camera.forward, across);
    if ahead.abs() <= 1e-18 || volume.abs() <= 1e-18 {
        return Vec3::ZERO;
    }
    let x = vec3_dot(to, vec3_cross(camera.up, camera.forward)) / ahead;
    let y = vec3_dot(to, vec3_cross(camera.forward, camera.right)) / ahead;
    Vec3::new(
        (0.5 + 0.5 * x) / camera.inverse_resolution.x,
        (0.5 - 0.5 * y) / camera.inverse_resolution.y,
        ahead / volume,
    )
}

/// Whether two cameras and points are the same, bit by bit or as zeros.
#[inline(always)]
fn reproject_still(point: Vec3, prior_point: Vec3, camera: Camera, prior: Camera) -> bool {
    point == prior_point
        && camera.origin == prior.origin
        && camera.right == prior.right
        && camera.up == prior.up
        && camera.forward == prior.forward
        && camera.inverse_resolution == prior.inverse_resolution
}

/// How many pixels a point has to be moved to where the frame before saw it.
///
/// `prior_point` is where the point was then (the same for what stands still),
/// `prior_camera` the camera then. Exactly 0 where nothing moves, on any
/// driver. [`REPROJECT_NOWHERE`] where one camera has the point before it and
/// the other behind.
///
/// Error analysis: the difference of two [`reproject_project`].
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::camera::Camera;
/// use raytwin_cpu::temporal::reproject::reproject_motion;
///
/// let now = Camera {
///     origin: Vec3::ZERO,
///     right: 2.0 * Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::new(1.0 / 640.0, 1.0 / 320.0),
/// };
/// // The eye has moved to the left, so then the point was more to the left.
/// let before = Camera { origin: Vec3::X, ..now };
/// let point = Vec3::new(0.0, 0.0, -5.0);
/// assert!((reproject_motion(point, point, now, before).x + 32.0).abs() < 1e-3);
/// assert_eq!(reproject_motion(point, point, now, now), Vec2::ZERO);
/// ```
#[inline]
#[must_use]
pub fn reproject_motion(
    point: Vec3,
    prior_point: Vec3,
    camera: Camera,
    prior_camera: Camera,
) -> Vec2 {
    if reproject_still(point, prior_point, camera, prior_camera) {
        return Vec2::ZERO;
    }
    let now = reproject_project(point, camera);
    let then = reproject_project(prior_point, prior_camera);
    let before = now.z > 0.0 && then.z > 0.0;
    let behind = now.z < 0.0 && then.z < 0.0;
    if !before && !behind {
        return Vec2::splat(REPROJECT_NOWHERE);
    }
    Vec2::new(then.x - now.x, then.y - now.y)
}

/// Curvature of a surface from two of its points, one over a length: `along` is
/// the step from one to the other, `turn` the change of the unit normal over it.
///
/// Above 0 for a convex surface. Exact on a sphere (one over its radius) and a
/// plane, for a step of any size. 0 without a step. The step is longer than
/// 1e-15 and shorter than 1e15.
///
/// Error analysis: a dot product that may cancel over a sum of squares. Noise
/// `ε` in the normals gives `ε/|along|`.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::reproject_curvature;
///
/// // From +z to +x of a sphere of radius 2 with centre 0.
/// let along = Vec3::new(2.0, 0.0, -2.0);
/// let turn = Vec3::new(1.0, 0.0, -1.0);
/// assert_eq!(reproject_curvature(along, turn), 0.5);
/// assert_eq!(reproject_curvature(along, Vec3::ZERO), 0.0);
/// ```
#[inline]
#[must_use]
pub fn reproject_curvature(along: Vec3, turn: Vec3) -> f32 {
    let square = vec3_dot(along, along);
    if square <= 1e-30 {
        return 0.0;
    }
    vec3_dot(turn, along) / square
}

/// By how much a mirror adds to the curvature of a wave front that it reflects
/// (one over a length), along one direction over its surface.
///
/// `view` is the unit vector from the eye to the mirror, `along` and `turn` as
/// in [`reproject_curvature`] with curvature κ. With the angle of incidence θ
/// it is 2κ/cos θ for a step in the plane of incidence, 2κ cos θ for one
/// across it, and twice the curvature at θ = 0. 0 for a flat mirror, without a
/// step, and where the mirror is seen from behind.
///
/// Source: Deschamps 1972, the reflected front's curvature: 2 cos θ times the
/// second fundamental form over the step's square as the eye sees it.
///
/// Error analysis: products of two dot products and a cross product, each of
/// which may cancel.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::reproject_power;
///
/// // A convex mirror of radius 2, seen straight on: twice its curvature.
/// let step = Vec3::new(0.02, 0.0, 0.0);
/// let power = reproject_power(Vec3::NEG_Z, Vec3::Z, step, 0.5 * step);
/// assert!((power - 1.0).abs() < 1e-5);
/// assert_eq!(reproject_power(Vec3::NEG_Z, Vec3::Z, step, Vec3::ZERO), 0.0);
/// ```
#[inline]
#[must_use]
pub fn reproject_power(view: Vec3, normal: Vec3, along: Vec3, turn: Vec3) -> f32 {
    let cosine = -vec3_dot(view, normal);
    let seen = vec3_cross(view, along);
    let square = vec3_dot(seen, seen);
    if cosine <= 0.0 || square <= 1e-30 {
        return 0.0;
    }
    (2.0 * cosine) * (vec3_dot(turn, along) / square)
}

/// How far behind a mirror the image of a point lies that is `distance`
/// (`[0, 1e18]`) before it.
///
/// The equation of the thin mirror, 1/image = 1/distance + `power`: the same
/// distance for a flat mirror (`power` 0), less for a convex one (`power`
/// above 0). A concave mirror shows what is beyond its focus as a real image
/// before it: the result is negative. Next to the focus it is limited to
/// `distance`/[`REPROJECT_FOCUS`].
///
/// Error analysis: a quotient; its divisor cancels next to the focus.
///
/// ```
/// use raytwin_cpu::temporal::reproject::reproject_image_distance;
///
/// // A flat mirror, a convex one, and a concave one beyond its focus.
/// assert_eq!(reproject_image_distance(4.0, 0.0), 4.0);
/// assert_eq!(reproject_image_distance(4.0, 0.25), 2.0);
/// assert_eq!(reproject_image_distance(4.0, -0.5), -4.0);
/// ```
#[inline]
#[must_use]
pub fn reproject_image_distance(distance: f32, power: f32) -> f32 {
    let bend = 1.0 + distance * power;
    if bend >= 0.0 {
        distance / bend.max(REPROJECT_FOCUS)
    } else {
        distance / bend.min(-REPROJECT_FOCUS)
    }
}

/// Where a mirror's image of a hit point lies in the world: behind the mirror
/// on the ray from the eye, or (a concave mirror) before it.
///
/// `position` is the mirror's point, not at the `eye`; `distance` that from
/// there to the hit point, `power` as in [`reproject_power`].
///
/// Error analysis: a unit vector, [`reproject_image_distance`], one product and
/// one sum for each component.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::reproject_virtual_point;
///
/// // What a flat mirror shows lies as far behind it.
/// let point =
///     reproject_virtual_point(Vec3::ZERO, Vec3::new(0.0, 0.0, -2.0), 3.0, 0.0);
/// assert_eq!(point, Vec3::new(0.0, 0.0, -5.0));
/// ```
#[inline]
#[must_use]
pub fn reproject_virtual_point(eye: Vec3, position: Vec3, distance: f32, power: f32) -> Vec3 {
    let view = vec3_normalize(Vec3::new(
        position.x - eye.x,
        position.y - eye.y,
        position.z - eye.z,
    ));
    let image = reproject_image_distance(distance, power);
    Vec3::new(
        position.x + view.x * image,
        position.y + view.y * image,
        position.z + view.z * image,
    )
}

/// Whether a motion is a number below [`REPROJECT_FAR`].
#[inline(always)]
fn reproject_near(motion: Vec2) -> bool {
    // By bits: NaN and infinity have the largest ones.
    let far = REPROJECT_FAR.to_bits();
    (motion.x.to_bits() & 0x7fff_ffff) < far && (motion.y.to_bits() & 0x7fff_ffff) < far
}

/// A bit for each of three texels from `corner` on that is inside and weighs
/// something.
#[inline(always)]
fn reproject_bits(corner: u32, size: u32, weights: Vec3) -> u32 {
    let first = u32::from(corner < size && weights.x > 0.0);
    let second = u32::from(corner.wrapping_add(1) < size && weights.y > 0.0);
    let third = u32::from(corner.wrapping_add(2) < size && weights.z > 0.0);
    first | (second << 1) | (third << 2)
}

/// Nine bits from those of three columns and three rows.
#[inline(always)]
fn reproject_square(columns: u32, rows: u32) -> u32 {
    let first = columns * (rows & 1);
    let second = columns * ((rows >> 1) & 1);
    let third = columns * ((rows >> 2) & 1);
    first | (second << 3) | (third << 6)
}

/// The four texels around where a pixel was, with bilinear weights.
///
/// `motion` as in [`reproject_motion`], in pixels; `size` the image's, each
/// side below 2^30, `pixel` inside it. Texels outside the image do not count,
/// each for itself. Nothing counts where the place itself is outside the image,
/// or where the motion is not finite or [`REPROJECT_FAR`] or more. A motion of
/// whole pixels gives one texel of weight 1.
///
/// Error analysis: floor and the difference from it are exact but where a
/// motion is closer to a whole number than 2^-24: each weight errs by half an
/// ULP of 1.
///
/// ```
/// use glam::{UVec2, Vec2};
/// use raytwin_cpu::temporal::reproject::{reproject_footprint, reproject_tap};
///
/// // A quarter of a pixel to the right: two texels, 3/4 and 1/4.
/// let taps = reproject_footprint(
///     UVec2::splat(4),
///     UVec2::splat(8),
///     Vec2::new(0.25, 0.0),
/// );
/// let weights: Vec<_> = (0..9).map(|i| reproject_tap(taps, i).weight).collect();
/// assert_eq!(&weights[..2], [0.75, 0.25]);
/// assert_eq!(weights.iter().sum::<f32>(), 1.0);
/// ```
#[inline]
#[must_use]
pub fn reproject_footprint(pixel: UVec2, size: UVec2, motion: Vec2) -> ReprojectTaps {
    if !reproject_near(motion) {
        return REPROJECT_NO_TAPS;
    }
    // Of the motion alone, not of pixel plus motion: that would round.
    let base = Vec2::new(motion.x.floor(), motion.y.floor());
    let part = Vec2::new(motion.x - base.x, motion.y - base.y);
    let corner = UVec2::new(
        pixel.x.wrapping_add(base.x as i32 as u32),
        pixel.y.wrapping_add(base.y as i32 as u32),
    );
    let across = Vec3::new(1.0 - part.x, part.x, 0.0);
    let down = Vec3::new(1.0 - part.y, part.y, 0.0);
    // The image ends half a pixel beyond the middle of its last one.
    let next = UVec2::new(corner.x.wrapping_add(1), corner.y.wrapping_add(1));
    let left = corner.x < size.x || (next.x < size.x && part.x >= 0.5);
    let right = next.x < size.x || (corner.x < size.x && part.x <= 0.5);
    let top = corner.y < size.y || (next.y < size.y && part.y >= 0.5);
    let bottom = next.y < size.y || (corner.y < size.y && part.y <= 0.5);
    if !(left && right && top && bottom) {
        return REPROJECT_NO_TAPS;
    }
    ReprojectTaps {
        corner,
        across,
        down,
        valid: reproject_square(
            reproject_bits(corner.x, size.x, across),
            reproject_bits(corner.y, size.y, down),
        ),
    }
}

/// Weights of the quadratic B-spline at `t` pixels from the middle texel.
#[inline(always)]
fn reproject_spline(t: f32) -> Vec3 {
    let low = 0.5 - t;
    let high = 0.5 + t;
    Vec3::new(0.5 * (low * low), 0.75 - t * t, 0.5 * (high * high))
}

/// The nine texels around where a pixel was, for when none of the four nearest
/// is of the same surface. Arguments as in [`reproject_footprint`].
///
/// The weights are those of the quadratic B-spline: they fall to 0 toward a
/// distance of 1.5 pixels, so nothing jumps where the middle texel changes, and
/// an image and its mirror image give mirrored results.
///
/// Error analysis: one difference (exact), a square and a difference of
/// numbers that do not cancel.
///
/// ```
/// use glam::{UVec2, Vec2, Vec3};
/// use raytwin_cpu::temporal::reproject::{
///     reproject_footprint_wide, reproject_tap,
/// };
///
/// // Nothing moves: 3/4 of the weight in the middle, on either axis.
/// let taps =
///     reproject_footprint_wide(UVec2::splat(4), UVec2::splat(8), Vec2::ZERO);
/// assert_eq!(taps.across, Vec3::new(0.125, 0.75, 0.125));
/// assert_eq!(reproject_tap(taps, 4).at, UVec2::splat(4));
/// ```
#[inline]
#[must_use]
pub fn reproject_footprint_wide(pixel: UVec2, size: UVec2, motion: Vec2) -> ReprojectTaps {
    if !reproject_near(motion) {
        return REPROJECT_NO_TAPS;
    }
    let base = Vec2::new((motion.x + 0.5).floor(), (motion.y + 0.5).floor());
    let part = Vec2::new(motion.x - base.x, motion.y - base.y);
    let middle = UVec2::new(
        pixel.x.wrapping_add(base.x as i32 as u32),
        pixel.y.wrapping_add(base.y as i32 as u32),
    );
    let corner = UVec2::new(middle.x.wrapping_sub(1), middle.y.wrapping_sub(1));
    // A place on the very edge belongs to the image on either side.
    let inside_x = middle.x < size.x || (corner.x < size.x && part.x <= -0.5);
    let inside_y = middle.y < size.y || (corner.y < size.y && part.y <= -0.5);
    if !inside_x || !inside_y {
        return REPROJECT_NO_TAPS;
    }
    let across = reproject_spline(part.x);
    let down = reproject_spline(part.y);
    ReprojectTaps {
        corner,
        across,
        down,
        valid: reproject_square(
            reproject_bits(corner.x, size.x, across),
            reproject_bits(corner.y, size.y, down),
        ),
    }
}

/// One of three weights.
#[inline(always)]
fn reproject_pick(weights: Vec3, index: u32) -> f32 {
    if index == 0 {
        weights.x
    } else if index == 1 {
        weights.y
    } else {
        weights.z
    }
}

/// Texel `index` of `0..9` and its weight; a weight of 0 (and texel 0): it does
/// not count. To gather channels of your own, weigh each texel's value by it and
/// divide by the sum of the weights.
///
/// Error analysis: one product.
///
/// ```
/// use glam::{UVec2, Vec2};
/// use raytwin_cpu::temporal::reproject::{reproject_footprint, reproject_tap};
///
/// // Channels of one's own: the weighted mean of what the texels hold.
/// let taps = reproject_footprint(
///     UVec2::splat(4),
///     UVec2::splat(8),
///     Vec2::new(0.25, 0.0),
/// );
/// let (mut sum, mut weights) = (0.0, 0.0);
/// for tap in (0..9).map(|i| reproject_tap(taps, i)) {
///     sum += tap.weight * tap.at.x as f32;
///     weights += tap.weight;
/// }
/// assert_eq!(sum / weights, 4.25);
/// ```
#[inline]
#[must_use]
pub fn reproject_tap(taps: ReprojectTaps, index: u32) -> ReprojectTap {
    if index >= 9 || (taps.valid >> index) & 1 == 0 {
        return ReprojectTap {
            at: UVec2::ZERO,
            weight: 0.0,
        };
    }
    let row = index / 3;
    let column = index - 3 * row;
    ReprojectTap {
        at: UVec2::new(
            taps.corner.x.wrapping_add(column),
            taps.corner.y.wrapping_add(row),
        ),
        weight: reproject_pick(taps.across, column) * reproject_pick(taps.down, row),
    }
}

/// Whether there is a surface, and its numbers are ones.
#[inline(always)]
fn reproject_usable(surface: ReprojectSurface) -> bool {
    usable_surface(surface.position, surface.normal, surface.depth) != 0
}

/// 1 if a texel of the frame before shows the surface that should be there,
/// else 0.
///
/// `expected` is the pixel's own surface, moved back to where it was then (a
/// surface that stands still: the pixel's own); `curvature` as in
/// [`reproject_curvature`], 0 for flat. Same mesh; distance from the surface at
/// most `tolerance.plane` times the depth; distance of its normal from the
/// expected one at most `tolerance.normal`. The surface and its normal are
/// those of a sphere through `expected`, or of its plane: on it both distances
/// are 0, at any angle and step. A surface with a number that is none (NaN,
/// infinity, 2^60 and more, a normal of 2 and more) matches nothing, nor does
/// anything with such a curvature.
///
/// Error analysis: the offset is a difference of positions, so the height errs
/// by an ULP of the offset; a texel within that of the limit may fall on either
/// side.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::{
///     REPROJECT_TOLERANCE, ReprojectSurface, reproject_matches,
/// };
///
/// let floor = ReprojectSurface {
///     position: Vec3::ZERO,
///     depth: 5.0,
///     normal: Vec3::Y,
///     mesh: 3,
/// };
/// // The next texel on the same floor; another mesh.
/// let beside = ReprojectSurface { position: Vec3::X, ..floor };
/// let other = ReprojectSurface { mesh: 4, ..beside };
/// assert_eq!(reproject_matches(floor, 0.0, beside, REPROJECT_TOLERANCE), 1);
/// assert_eq!(reproject_matches(floor, 0.0, other, REPROJECT_TOLERANCE), 0);
/// ```
#[inline]
#[must_use]
pub fn reproject_matches(
    expected: ReprojectSurface,
    curvature: f32,
    found: ReprojectSurface,
    tolerance: ReprojectTolerance,
) -> u32 {
    if !reproject_usable(expected) || !reproject_usable(found) || expected.mesh != found.mesh {
        return 0;
    }
    if (curvature.to_bits() & 0x7fff_ffff) >= USABLE_BITS {
        return 0;
    }
    let to = Vec3::new(
        found.position.x - expected.position.x,
        found.position.y - expected.position.y,
        found.position.z - expected.position.z,
    );
    let fall = 0.5 * curvature * vec3_dot(to, to);
    let height = vec3_dot(expected.normal, to) + fall;
    if height.abs() > tolerance.plane * expected.depth {
        return 0;
    }
    let turned = Vec3::new(
        (found.normal.x - expected.normal.x) - curvature * to.x,
        (found.normal.y - expected.normal.y) - curvature * to.y,
        (found.normal.z - expected.normal.z) - curvature * to.z,
    );
    if vec3_dot(turned, turned) > tolerance.normal * tolerance.normal {
        return 0;
    }
    1
}

/// The taps that pass the test, and whether those are enough; none if not.
#[inline(always)]
fn reproject_tested<P>(
    taps: ReprojectTaps,
    expected: ReprojectSurface,
    curvature: f32,
    tolerance: ReprojectTolerance,
    read_prior: &P,
) -> ReprojectTaps
where
    P: Fn(UVec2) -> ReprojectSurface,
{
    let mut tested = taps;
    let mut coverage = 0.0;
    let mut i = 0;
    while i < 9 {
        let tap = reproject_tap(taps, i);
        if tap.weight > 0.0 {
            let found = read_prior(tap.at);
            if reproject_matches(expected, curvature, found, tolerance) == 1 {
                coverage += tap.weight;
            } else {
                tested.valid &= !(1 << i);
            }
        }
        i += 1;
    }
    if coverage < REPROJECT_COVERAGE {
        return REPROJECT_NO_TAPS;
    }
    tested
}

/// Which texels of the frame before show the same surface as a pixel does now.
///
/// `pixel`, `size` and `motion` as in [`reproject_footprint`]; `expected`,
/// `curvature` and `tolerance` as in [`reproject_matches`]. `read_prior(at)`
/// gives the surface that the frame before had in a texel, only called inside
/// `size`. The four nearest texels, or, where less than
/// [`REPROJECT_COVERAGE`] of them passes, those of the 3 × 3 around; if these
/// do not suffice either, no history. Reads one texel where nothing moves.
///
/// In WGSL `read_prior` is a function that the program defines.
///
/// Error analysis: that of [`reproject_footprint`].
///
/// ```
/// use glam::{UVec2, Vec2, Vec3};
/// use raytwin_cpu::temporal::reproject::{
///     REPROJECT_TOLERANCE, ReprojectSurface, reproject_find, reproject_tap,
/// };
///
/// let floor = ReprojectSurface {
///     position: Vec3::ZERO,
///     depth: 5.0,
///     normal: Vec3::Y,
///     mesh: 3,
/// };
/// // The frame before had another object left of x = 4.
/// let prior = |at: UVec2| ReprojectSurface {
///     mesh: if at.x < 4 { 9 } else { 3 },
///     ..floor
/// };
/// let taps = reproject_find(
///     UVec2::splat(4),
///     UVec2::splat(8),
///     Vec2::new(-0.5, 0.0),
///     floor,
///     0.0,
///     REPROJECT_TOLERANCE,
///     prior,
/// );
/// assert!(
///     (0..9)
///         .map(|i| reproject_tap(taps, i))
///         .all(|t| t.weight == 0.0 || t.at.x >= 4)
/// );
/// ```
#[inline]
#[must_use]
pub fn reproject_find<P>(
    pixel: UVec2,
    size: UVec2,
    motion: Vec2,
    expected: ReprojectSurface,
    curvature: f32,
    tolerance: ReprojectTolerance,
    read_prior: P,
) -> ReprojectTaps
where
    P: Fn(UVec2) -> ReprojectSurface,
{
    if !reproject_usable(expected) {
        return REPROJECT_NO_TAPS;
    }
    let near = reproject_tested(
        reproject_footprint(pixel, size, motion),
        expected,
        curvature,
        tolerance,
        &read_prior,
    );
    if near.valid != 0 {
        return near;
    }
    reproject_tested(
        reproject_footprint_wide(pixel, size, motion),
        expected,
        curvature,
        tolerance,
        &read_prior,
    )
}

/// The history of the texels that count: their weighted mean.
///
/// `read_history(at)` gives a texel's history; it must say length 0 where a
/// value is not finite (`math/sanitize`), and such a texel does not count. Where
/// less than [`REPROJECT_COVERAGE`] is left there is no history. Each
/// channel lies between those of the texels; of one texel alone it is that
/// value itself. The length is the weighted harmonic mean of the texels': the
/// variance of a mean is at most the mean of the variances, whatever they have
/// in common, so a length never promises more than there is, and never more
/// than the longest of the texels.
///
/// In WGSL `read_history` is a function that the program defines.
///
/// Error analysis: sums of at most nine products over a sum of weights; the
/// weights are positive, so the error is a few ULP of the largest value.
///
/// ```
/// use glam::{UVec2, Vec2};
/// use raytwin_cpu::temporal::reproject::{
///     ReprojectHistory, reproject_footprint, reproject_gather,
/// };
///
/// let taps = reproject_footprint(
///     UVec2::splat(4),
///     UVec2::splat(8),
///     Vec2::new(0.25, 0.0),
/// );
/// let read = |at: UVec2| ReprojectHistory { value: at.x as f32, length: 8.0 };
/// let history = reproject_gather(taps, read);
/// assert_eq!((history.value, history.length), (4.25, 8.0));
/// ```
#[inline]
#[must_use]
pub fn reproject_gather<V, R>(taps: ReprojectTaps, read_history: R) -> ReprojectHistory<V>
where
    V: ReprojectValue,
    R: Fn(UVec2) -> ReprojectHistory<V>,
{
    let mut sum = V::NOTHING;
    let mut low = V::NOTHING;
    let mut high = V::NOTHING;
    let mut weight = 0.0;
    let mut rates = 0.0;
    let mut shortest = 0.0f32;
    let mut longest = 0.0f32;
    let mut i = 0;
    while i < 9 {
        let tap = reproject_tap(taps, i);
        i += 1;
        if tap.weight <= 0.0 {
            continue;
        }
        let texel = read_history(tap.at);
        if texel.length <= 0.0 {
            continue;
        }
        if weight <= 0.0 {
            low = texel.value;
            high = texel.value;
            shortest = texel.length;
            longest = texel.length;
        } else {
            low = low.least(texel.value);
            high = high.most(texel.value);
            shortest = shortest.min(texel.length);
            longest = longest.max(texel.length);
        }
        sum = sum.plus(texel.value, tap.weight);
        weight += tap.weight;
        rates += tap.weight / texel.length;
    }
    if weight < REPROJECT_COVERAGE {
        return ReprojectHistory {
            value: V::NOTHING,
            length: 0.0,
        };
    }
    ReprojectHistory {
        value: sum.over(weight).most(low).least(high),
        length: (weight / rates).max(shortest).min(longest),
    }
}

/// The history of a pixel: [`reproject_find`], then [`reproject_gather`].
///
/// In WGSL the two callbacks are functions that the program defines.
///
/// Error analysis: a convex combination; a motion's error moves it by as much
/// of the difference between texels.
///
/// ```
/// use glam::{UVec2, Vec2, Vec3};
/// use raytwin_cpu::temporal::reproject::{
///     REPROJECT_TOLERANCE, ReprojectHistory, ReprojectSurface, reproject_pixel,
/// };
///
/// let floor = ReprojectSurface {
///     position: Vec3::ZERO,
///     depth: 5.0,
///     normal: Vec3::Y,
///     mesh: 3,
/// };
/// let read = |at: UVec2| ReprojectHistory {
///     value: Vec3::splat(at.x as f32),
///     length: 8.0,
/// };
/// let find = |motion| {
///     reproject_pixel(
///         UVec2::splat(4),
///         UVec2::splat(8),
///         motion,
///         floor,
///         0.0,
///         REPROJECT_TOLERANCE,
///         |_| floor,
///         read,
///     )
/// };
/// assert_eq!(find(Vec2::new(2.0, 0.0)).value, Vec3::splat(6.0));
/// // Outside of the image there is no history.
/// assert_eq!(find(Vec2::new(6.0, 0.0)).length, 0.0);
/// ```
#[allow(clippy::too_many_arguments)]
#[inline]
#[must_use]
pub fn reproject_pixel<V, P, R>(
    pixel: UVec2,
    size: UVec2,
    motion: Vec2,
    expected: ReprojectSurface,
    curvature: f32,
    tolerance: ReprojectTolerance,
    read_prior: P,
    read_history: R,
) -> ReprojectHistory<V>
where
    V: ReprojectValue,
    P: Fn(UVec2) -> ReprojectSurface,
    R: Fn(UVec2) -> ReprojectHistory<V>,
{
    let taps = reproject_find(
        pixel, size, motion, expected, curvature, tolerance, read_prior,
    );
    reproject_gather(taps, read_history)
}

/// The step from a pixel's surface to a neighbour's, or 0 if that is another
/// object or none.
#[inline(always)]
fn reproject_step(from: ReprojectSurface, to: ReprojectSurface) -> ReprojectBend {
    if !reproject_usable(to) || to.mesh != from.mesh {
        return ReprojectBend {
            along: Vec3::ZERO,
            turn: Vec3::ZERO,
        };
    }
    ReprojectBend {
        along: to.position - from.position,
        turn: to.normal - from.normal,
    }
}

/// The shorter of the steps to two neighbours on opposite sides, as seen toward
/// the second; of two of the same length the second.
#[inline(always)]
fn reproject_shorter(back: ReprojectBend, ahead: ReprojectBend) -> ReprojectBend {
    let back_square = vec3_dot(back.along, back.along);
    let ahead_square = vec3_dot(ahead.along, ahead.along);
    if back_square > 0.0 && (ahead_square <= 0.0 || back_square < ahead_square) {
        return ReprojectBend {
            along: -back.along,
            turn: -back.turn,
        };
    }
    ahead
}

/// How a pixel's surface bends in the image's direction `parallax` (in pixels,
/// of any length): from the neighbour to the left or right, and that above or
/// below, whichever is nearer in the world. Where there is none across, or none
/// along, the other direction's stands for both.
///
/// `read_surface(at)` gives the surface that this frame has in a pixel, only
/// called inside `size`. Neighbours of another mesh or without a surface do not
/// count; without any, or for parallax 0, both steps are 0. For
/// [`reproject_curvature`] and [`reproject_power`], which see no difference
/// between short and long steps on a sphere.
///
/// In WGSL `read_surface` is a function that the program defines.
///
/// Error analysis: differences of positions and of normals, times two factors.
///
/// ```
/// use glam::{UVec2, Vec2, Vec3};
/// use raytwin_cpu::temporal::reproject::{
///     ReprojectSurface, reproject_bend, reproject_curvature,
/// };
///
/// // A sphere of radius 2, seen from above.
/// let read = |at: UVec2| {
///     let (x, z) = ((at.x as f32 - 4.0) * 0.1, (at.y as f32 - 4.0) * 0.1);
///     let position = Vec3::new(x, (4.0 - x * x - z * z).sqrt(), z);
///     ReprojectSurface { position, depth: 5.0, normal: 0.5 * position, mesh: 3 }
/// };
/// let bend = reproject_bend(UVec2::splat(4), UVec2::splat(9), Vec2::X, read);
/// assert!((reproject_curvature(bend.along, bend.turn) - 0.5).abs() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn reproject_bend<S>(
    pixel: UVec2,
    size: UVec2,
    parallax: Vec2,
    read_surface: S,
) -> ReprojectBend
where
    S: Fn(UVec2) -> ReprojectSurface,
{
    let mut across = ReprojectBend {
        along: Vec3::ZERO,
        turn: Vec3::ZERO,
    };
    let mut down = across;
    if pixel.x >= size.x || pixel.y >= size.y || (parallax.x == 0.0 && parallax.y == 0.0) {
        return across;
    }
    let centre = read_surface(pixel);
    if !reproject_usable(centre) {
        return across;
    }
    let mut left = across;
    let mut above = across;
    if pixel.x > 0 {
        left = reproject_step(centre, read_surface(UVec2::new(pixel.x - 1, pixel.y)));
    }
    if pixel.x + 1 < size.x {
        across = reproject_step(centre, read_surface(UVec2::new(pixel.x + 1, pixel.y)));
    }
    if pixel.y > 0 {
        above = reproject_step(centre, read_surface(UVec2::new(pixel.x, pixel.y - 1)));
    }
    if pixel.y + 1 < size.y {
        down = reproject_step(centre, read_surface(UVec2::new(pixel.x, pixel.y + 1)));
    }
    across = reproject_shorter(left, across);
    down = reproject_shorter(above, down);
    // With a neighbour in one direction only, that one has to speak for both:
    // else the least change of the parallax would turn a curve into a plane.
    let length = parallax.x.abs() + parallax.y.abs();
    let x = if vec3_dot(down.along, down.along) > 0.0 {
        parallax.x
    } else {
        length
    };
    let y = if vec3_dot(across.along, across.along) > 0.0 {
        parallax.y
    } else {
        length
    };
    ReprojectBend {
        along: across.along * x + down.along * y,
        turn: across.turn * x + down.turn * y,
    }
}

/// The motion of what a mirror shows in a pixel, as [`reproject_motion`]:
/// of the image of the hit point, `distance` from the mirror along the
/// reflected ray.
///
/// The mirror and what it shows stand still. Its curvature is taken from
/// neighbouring pixels, in the direction in which the eye's own movement (not
/// its turning) shifts them. Exactly 0 where the camera stands still.
/// [`REPROJECT_NOWHERE`] without a surface. `read_surface` as in
/// [`reproject_bend`].
///
/// Error analysis: [`reproject_bend`], [`reproject_power`],
/// [`reproject_virtual_point`] and [`reproject_motion`] one after the other.
///
/// ```
/// use glam::{UVec2, Vec2, Vec3};
/// use raytwin_cpu::ray::camera::{Camera, camera_position_from_depth};
/// use raytwin_cpu::temporal::reproject::{
///     ReprojectSurface, reproject_reflection_motion,
/// };
///
/// let now = Camera {
///     origin: Vec3::ZERO,
///     right: Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::splat(1.0 / 64.0),
/// };
/// let before = Camera { origin: Vec3::X, ..now };
/// // A flat mirror at distance 2, and something 3 before it.
/// let mirror = |at: UVec2| {
///     let pixel = Vec2::new(at.x as f32 + 0.5, at.y as f32 + 0.5);
///     ReprojectSurface {
///         position: camera_position_from_depth(pixel, 2.0, now),
///         depth: 2.0,
///         normal: Vec3::Z,
///         mesh: 3,
///     }
/// };
/// // It moves as if it were 5 away: by 32/5 pixels, not 32/2.
/// let motion = reproject_reflection_motion(
///     UVec2::splat(32),
///     UVec2::splat(64),
///     3.0,
///     now,
///     before,
///     mirror,
/// );
/// assert!((motion - Vec2::new(-6.4, 0.0)).length() < 0.01);
/// ```
#[inline]
#[must_use]
pub fn reproject_reflection_motion<S>(
    pixel: UVec2,
    size: UVec2,
    distance: f32,
    camera: Camera,
    prior_camera: Camera,
    read_surface: S,
) -> Vec2
where
    S: Fn(UVec2) -> ReprojectSurface,
{
    if pixel.x >= size.x || pixel.y >= size.y {
        return Vec2::splat(REPROJECT_NOWHERE);
    }
    let mirror = read_surface(pixel);
    if !reproject_usable(mirror) {
        return Vec2::splat(REPROJECT_NOWHERE);
    }
    // The camera of now at the place of then: movement without turning.
    let moved = Camera {
        origin: prior_camera.origin,
        ..camera
    };
    let parallax = reproject_motion(mirror.position, mirror.position, camera, moved);
    let bend = reproject_bend(pixel, size, parallax, read_surface);
    let view = vec3_normalize(Vec3::new(
        mirror.position.x - camera.origin.x,
        mirror.position.y - camera.origin.y,
        mirror.position.z - camera.origin.z,
    ));
    let power = reproject_power(view, mirror.normal, bend.along, bend.turn);
    let point = reproject_virtual_point(camera.origin, mirror.position, distance, power);
    reproject_motion(point, point, camera, prior_camera)
}

/// One channel's distance in deviations.
#[inline(always)]
fn reproject_deviations(value: f32, mean: f32, deviation: f32, floor: f32) -> f32 {
    let unit = deviation.max(floor);
    if unit <= 0.0 {
        return 0.0;
    }
    (value - mean).abs() / unit
}

/// How far a colour is from what a neighbourhood of the new frame shows:
/// luminance of the distances from its mean in each channel, in standard
/// deviations.
///
/// A deviation counts as at least [`REPROJECT_DEVIATION`] times the luminance
/// of colour or mean, whichever is brighter: so nothing divides by 0, and a
/// factor on the exposure changes nothing. At most 96. Arguments are `>= 0`.
///
/// Source: Ray Tracing Gems, chapter 25; its listing has no absolute value and
/// no floor.
///
/// Error analysis: differences of arguments, quotients, a sum of positive
/// terms.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::reproject_color_distance;
///
/// let mean = Vec3::splat(0.5);
/// assert_eq!(reproject_color_distance(mean, mean, Vec3::ZERO), 0.0);
/// // One deviation off in every channel.
/// let off =
///     reproject_color_distance(Vec3::splat(0.75), mean, Vec3::splat(0.25));
/// assert!((off - 1.0).abs() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn reproject_color_distance(color: Vec3, mean: Vec3, deviation: Vec3) -> f32 {
    let floor = REPROJECT_DEVIATION * luminance(color).max(luminance(mean));
    luminance(Vec3::new(
        reproject_deviations(color.x, mean.x, deviation.x, floor),
        reproject_deviations(color.y, mean.y, deviation.y, floor),
        reproject_deviations(color.z, mean.z, deviation.z, floor),
    ))
}

/// The chapter's weight of a reprojected colour, in `[0, 1]`: 2 to the power
/// of -10 times [`reproject_color_distance`].
///
/// To blend two, [`reproject_share`] gives the quotient of their weights even
/// where both are too small for an `f32`.
///
/// Error analysis: `x·2^-x` is below 0.54, so a few ULP of 1.
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::temporal::reproject::reproject_color_weight;
///
/// let mean = Vec3::splat(0.5);
/// assert_eq!(reproject_color_weight(mean, mean, Vec3::splat(0.25)), 1.0);
/// let off = reproject_color_weight(Vec3::splat(0.75), mean, Vec3::splat(0.25));
/// assert!((off - 1.0 / 1024.0).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn reproject_color_weight(color: Vec3, mean: Vec3, deviation: Vec3) -> f32 {
    exp2_poly(-10.0 * reproject_color_distance(color, mean, deviation))
}

/// The second one's share of a blend, in `[0, 1]`, from the distances of both
/// ([`reproject_color_distance`], or any other, `>= 0`): its weight over the
/// sum of the weights.
///
/// Error analysis: the exponent is a difference of arguments; the divisor is
/// between 1 and 2.
///
/// ```
/// use raytwin_cpu::temporal::reproject::reproject_share;
///
/// assert_eq!(reproject_share(1.0, 1.0), 0.5);
/// // The first one fits, the second is far off.
/// assert!(reproject_share(0.0, 2.0) < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn reproject_share(first: f32, second: f32) -> f32 {
    let ratio = exp2_poly(-10.0 * (second - first).abs());
    if second > first {
        ratio / (1.0 + ratio)
    } else {
        1.0 / (1.0 + ratio)
    }
}

/// The blend of two histories of one pixel, `share` in `[0, 1]` of it from the
/// second; where one has no history, the other.
///
/// Between the two in each channel, exactly so; the length is the weighted
/// harmonic mean, as in [`reproject_gather`].
///
/// Error analysis: a sum of two products, clamped; three quotients.
///
/// ```
/// use raytwin_cpu::temporal::reproject::{ReprojectHistory, reproject_blend};
///
/// let old = ReprojectHistory { value: 1.0, length: 8.0 };
/// let new = ReprojectHistory { value: 2.0, length: 8.0 };
/// let blend = reproject_blend(old, new, 0.25);
/// assert_eq!((blend.value, blend.length), (1.25, 8.0));
/// ```
#[inline]
#[must_use]
pub fn reproject_blend<V: ReprojectValue>(
    first: ReprojectHistory<V>,
    second: ReprojectHistory<V>,
    share: f32,
) -> ReprojectHistory<V> {
    if second.length <= 0.0 {
        return first;
    }
    if first.length <= 0.0 {
        return second;
    }
    let rest = 1.0 - share;
    let mixed = first.value.times(rest).plus(second.value, share);
    let rate = rest / first.length + share / second.length;
    ReprojectHistory {
        value: mixed
            .most(first.value.least(second.value))
            .least(first.value.most(second.value)),
        length: (1.0 / rate)
            .max(first.length.min(second.length))
            .min(first.length.max(second.length)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::{pcg_next, pcg_unit};
    use crate::ray::camera::{camera_position_from_depth, camera_ray};
    use glam::{DVec2, DVec3};

    fn numbers(seed: u32) -> impl FnMut() -> f32 {
        let mut state = seed;
        move || {
            let next = pcg_next(state);
            state = next.state;
            pcg_unit(next.value)
        }
    }

    const SIZE: UVec2 = UVec2::new(320, 180);

    fn camera(origin: Vec3, target: Vec3) -> Camera {
        let forward = (target - origin).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let (width, height) = (SIZE.x as f32, SIZE.y as f32);
        Camera {
            origin,
            right: right * (0.5 * width / height),
            up: right.cross(forward) * 0.5,
            forward,
            inverse_resolution: Vec2::new(1.0 / width, 1.0 / height),
        }
    }

    fn middle(pixel: UVec2) -> Vec2 {
        pixel.as_vec2() + 0.5
    }

    fn flat(at: UVec2) -> ReprojectSurface {
        ReprojectSurface {
            position: Vec3::new(at.x as f32, at.y as f32, 0.0),
            depth: 1.0,
            normal: Vec3::Z,
            mesh: 0,
        }
    }

    fn every(size: UVec2) -> impl Iterator<Item = UVec2> {
        (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
    }

    fn listed(taps: ReprojectTaps) -> Vec<(UVec2, f32)> {
        (0..9)
            .map(|i| reproject_tap(taps, i))
            .filter(|t| t.weight > 0.0)
            .map(|t| (t.at, t.weight))
            .collect()
    }

    fn weight(taps: ReprojectTaps) -> f32 {
        listed(taps).iter().map(|t| t.1).sum()
    }

    /// What no number of a surface may be, in each of them.
    fn broken(surface: ReprojectSurface) -> impl Iterator<Item = ReprojectSurface> {
        let numbers = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30];
        numbers.into_iter().flat_map(move |bad| {
            (0..7).map(move |lane| {
                let mut s = surface;
                match lane {
                    0..=2 => s.position[lane] = bad,
                    3..=5 => s.normal[lane - 3] = bad,
                    _ => s.depth = bad,
                }
                s
            })
        })
    }

    #[test]
    fn a_bad_surface_matches_nothing() {
        let wall = flat(UVec2::ONE);
        let loose = ReprojectTolerance {
            plane: 1e9,
            normal: 2.0,
        };
        for tolerance in [REPROJECT_TOLERANCE, loose] {
            assert_eq!(reproject_matches(wall, 0.1, wall, tolerance), 1);
            for bad in broken(wall) {
                for curvature in [0.0, 0.1] {
                    let found = reproject_matches(wall, curvature, bad, tolerance);
                    let expected = reproject_matches(bad, curvature, wall, tolerance);
                    let both = reproject_matches(bad, curvature, bad, tolerance);
                    assert_eq!((found, expected, both), (0, 0, 0), "{bad:?}");
                }
            }
            for bent in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
                assert_eq!(reproject_matches(wall, bent, wall, tolerance), 0);
            }
        }
    }

    /// As if it had no surface, in either frame: no history of its own, and a
    /// texel less for those whose footprint holds it.
    #[test]
    fn a_bad_surface_is_none() {
        let (place, size) = (UVec2::new(4, 3), UVec2::new(9, 7));
        let read = |at: UVec2| ReprojectHistory {
            value: (at.x + 10 * at.y) as f32,
            length: 8.0,
        };
        let history = |at, motion, expected, prior: &dyn Fn(UVec2) -> ReprojectSurface| {
            reproject_pixel(
                at,
                size,
                motion,
                expected,
                0.0,
                REPROJECT_TOLERANCE,
                prior,
                read,
            )
        };
        let swap = |s: ReprojectSurface| move |at| if at == place { s } else { flat(at) };
        let none = ReprojectSurface {
            depth: 0.0,
            ..flat(place)
        };
        let motions = [Vec2::ZERO, Vec2::new(0.25, -0.5), Vec2::new(-1.0, 1.0)];
        for (bad, motion) in broken(flat(place)).flat_map(|b| motions.map(|m| (b, m))) {
            for at in every(size) {
                let found = history(at, motion, flat(at), &swap(bad));
                let case = format!("{bad:?}, {motion} at {at}");
                assert_eq!(found, history(at, motion, flat(at), &swap(none)), "{case}");
                // Where the footprint misses it (3 x 3 at most) nothing changes.
                let apart = (at.as_vec2() + motion - place.as_vec2()).abs();
                if apart.max_element() >= 1.5 {
                    assert_eq!(found, history(at, motion, flat(at), &flat), "{case}");
                }
                let bend = reproject_bend(at, size, Vec2::new(1.0, 0.5), swap(bad));
                let want = reproject_bend(at, size, Vec2::new(1.0, 0.5), swap(none));
                assert_eq!(bend, want, "{case}");
            }
            assert_eq!(history(place, motion, bad, &flat).length, 0.0);
            let now = camera(Vec3::new(4.0, 3.0, 5.0), Vec3::new(4.0, 3.5, 0.0));
            let then = camera(Vec3::new(4.1, 3.0, 5.0), Vec3::new(4.0, 3.5, 0.0));
            let moved = reproject_reflection_motion(place, size, 1.0, now, then, swap(bad));
            assert_eq!(moved, Vec2::splat(REPROJECT_NOWHERE));
        }
    }

    #[test]
    fn a_point_is_projected_to_the_pixel_that_shows_it() {
        let camera = camera(Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 1.0, 0.5));
        for pixel in every(SIZE).step_by(37) {
            let point = camera_position_from_depth(middle(pixel), 7.0, camera);
            let found = reproject_project(point, camera);
            assert!((found.truncate() - middle(pixel)).length() < 2e-4);
            assert!((found.z - 7.0).abs() < 1e-5);
            // Through the eye to the other side: the same place.
            let behind = reproject_project(2.0 * camera.origin - point, camera);
            assert!((behind.truncate() - middle(pixel)).length() < 2e-4);
            assert!((behind.z + 7.0).abs() < 1e-5);
        }
    }

    /// The point of a spherical mirror that reflects `eye` to `hit`: where the
    /// path is stationary, by Newton steps in two coordinates.
    fn mirror_point(eye: DVec3, hit: DVec3, centre: DVec3, radius: f64, start: DVec3) -> DVec3 {
        let mut p = start;
        for _ in 0..60 {
            let n = (p - centre) / radius;
            let t = n.any_orthonormal_vector();
            let b = n.cross(t);
            let at = |u: DVec2| centre + (n + t * u.x + b * u.y).normalize() * radius;
            let length = |u: DVec2| (at(u) - eye).length() + (at(u) - hit).length();
            let h = 1e-4;
            let (x, y) = (DVec2::X * h, DVec2::Y * h);
            let slope = DVec2::new(length(x) - length(-x), length(y) - length(-y)) / (2.0 * h);
            let at_zero = 2.0 * length(DVec2::ZERO);
            let xx = (length(x) + length(-x) - at_zero) / (h * h);
            let yy = (length(y) + length(-y) - at_zero) / (h * h);
            let xy =
                (length(x + y) + length(-x - y) - length(x - y) - length(y - x)) / (4.0 * h * h);
            let step = DVec2::new(yy * slope.x - xy * slope.y, xx * slope.y - xy * slope.x)
                / (xx * yy - xy * xy);
            p = at(-step.clamp_length_max(0.02));
        }
        p
    }

    /// Worst and mean error in pixels of the surface's motion, of a flat
    /// mirror's and of a curved mirror's, over the pixels of a mirror ball
    /// (`radius` above 0) or of the inside of one.
    fn mirror_errors(radius: f64, step: Vec3) -> [(f64, f64); 4] {
        let eye = Vec3::new(0.0, 0.0, 5.0);
        let now = camera(eye, Vec3::ZERO);
        let then = camera(eye + step, Vec3::ZERO);
        let centre = DVec3::new(0.0, 0.0, -radius);
        let surface = |at: UVec2| {
            let ray = camera_ray(middle(at), now);
            let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
            let oc = o - centre;
            let half = oc.dot(d);
            let root = (half * half - oc.length_squared() + radius * radius)
                .max(0.0)
                .sqrt();
            // The near side of a ball, the far side of a hollow one.
            let t = -half - root * radius.signum();
            let p = o + d * t;
            (p, (p - centre) / radius, d)
        };
        let read = |at: UVec2| {
            let (p, n, _) = surface(at);
            ReprojectSurface {
                position: p.as_vec3(),
                depth: (p - eye.as_dvec3()).length() as f32,
                normal: n.as_vec3(),
                mesh: 0,
            }
        };
        let mut found = [(0.0f64, 0.0f64); 4];
        let mut count = 0;
        for pixel in every(SIZE).step_by(11) {
            let (p, n, view) = surface(pixel);
            // Up to 66 degrees off the normal, and on the ball at all.
            if -view.dot(n) < 0.4 || ((p - centre).length() - radius.abs()).abs() > 1e-6 {
                continue;
            }
            let out = view - n * (2.0 * view.dot(n));
            let distance = 1.5 + 2.0 * f64::from(pixel.x % 7) / 7.0;
            let hit = p + out * distance;
            let prior_eye = (eye + step).as_dvec3();
            let seen = mirror_point(prior_eye, hit, centre, radius.abs(), p);
            let truth = reproject_project(seen.as_vec3(), then).truncate() - middle(pixel);
            let point = reproject_virtual_point(eye, p.as_vec3(), distance as f32, 0.0);
            let twice = 2.0 / radius as f32;
            let thin = reproject_virtual_point(eye, p.as_vec3(), distance as f32, twice);
            for (found, motion) in found.iter_mut().zip([
                reproject_motion(p.as_vec3(), p.as_vec3(), now, then),
                reproject_motion(point, point, now, then),
                reproject_motion(thin, thin, now, then),
                reproject_reflection_motion(pixel, SIZE, distance as f32, now, then, read),
            ]) {
                let error = f64::from((motion - truth).length());
                found.0 = found.0.max(error);
                found.1 += error;
            }
            count += 1;
        }
        found.map(|(worst, sum)| (worst, sum / f64::from(count)))
    }

    #[test]
    fn a_curved_mirror_moves_its_image_as_a_ray_tracer_finds_it() {
        for (radius, name) in [
            (1.0, "ball of 1"),
            (4.0, "ball of 4"),
            (-20.0, "hollow of 20"),
        ] {
            for step in [Vec3::X * 0.05, Vec3::Y * 0.05, Vec3::new(0.03, 0.03, 0.02)] {
                let [surface, flat, thin, curved] = mirror_errors(radius, step);
                println!(
                    "{name}, {step}: surface {surface:.3?}, flat {flat:.3?}, thin {thin:.3?}, curved {curved:.3?}"
                );
                // Means: better than either form without curvature, by far; and
                // than the thin mirror, which knows no angle.
                assert!(curved.1 < 0.2 * surface.1.max(flat.1));
                assert!(curved.1 < 0.25 * surface.1.min(flat.1));
                assert!(curved.1 < 0.75 * thin.1);
                assert!(curved.0 < 0.35 * flat.0);
            }
        }
    }

    #[test]
    fn nothing_moves_where_nothing_moves() {
        let camera = camera(Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 1.0, 0.5));
        let mut next = numbers(1);
        for _ in 0..1000 {
            let point = Vec3::new(next(), next(), next()) * 40.0 - 20.0;
            assert_eq!(reproject_motion(point, point, camera, camera), Vec2::ZERO);
        }
        let beside = Camera {
            origin: camera.origin + Vec3::X,
            ..camera
        };
        let ahead = camera.origin + camera.forward;
        assert_ne!(reproject_motion(ahead, ahead, camera, beside), Vec2::ZERO);
        let behind = camera.origin - camera.forward;
        assert_eq!(
            reproject_motion(ahead, behind, camera, camera),
            Vec2::splat(REPROJECT_NOWHERE)
        );
    }

    #[test]
    fn footprints_weigh_one_and_lie_around_the_place() {
        let size = UVec2::new(16, 12);
        let mut next = numbers(2);
        for k in 0..20_000u32 {
            let pixel = UVec2::new(k % 16, k / 16 % 12);
            let motion = Vec2::new(next(), next()) * 12.0 - 6.0;
            let place = middle(pixel) + motion;
            let inside = place.min_element() >= 0.0 && place.cmple(size.as_vec2()).all();
            let border = place.min((size.as_vec2() - place).abs()).min_element();
            for (wide, reach) in [(false, 1.0), (true, 1.5)] {
                let taps = if wide {
                    reproject_footprint_wide(pixel, size, motion)
                } else {
                    reproject_footprint(pixel, size, motion)
                };
                assert_eq!(taps.valid != 0, inside, "{pixel} {motion}");
                for (at, w) in listed(taps) {
                    assert!(at.cmplt(size).all() && w > 0.0);
                    assert!((middle(at) - place).abs().max_element() <= reach + 1e-5);
                }
                if inside && border > reach {
                    assert!((weight(taps) - 1.0).abs() < 1e-6);
                    // Linear in the place: a ramp comes out as a ramp.
                    let mean: Vec2 = listed(taps).iter().map(|(at, w)| middle(*at) * *w).sum();
                    assert!((mean - place).length() < 1e-5);
                }
            }
        }
        for bad in [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e30,
            REPROJECT_NOWHERE,
        ] {
            for motion in [Vec2::new(bad, 0.0), Vec2::new(0.0, bad)] {
                let pixel = UVec2::new(3, 3);
                assert_eq!(reproject_footprint(pixel, size, motion).valid, 0);
                assert_eq!(reproject_footprint_wide(pixel, size, motion).valid, 0);
            }
        }
    }

    #[test]
    fn mirrored_motions_have_mirrored_footprints() {
        let size = UVec2::new(16, 12);
        let sorted = |taps: ReprojectTaps, mirror: bool| {
            let mut list: Vec<(u32, u32, u32)> = listed(taps)
                .iter()
                .map(|(at, w)| {
                    let x = if mirror { size.x - 1 - at.x } else { at.x };
                    (x, at.y, (w * 1e5).round() as u32)
                })
                .collect();
            list.sort_unstable();
            list
        };
        // Dyadic, so that nothing rounds; also from the first column and row,
        // which some implementations leave without history.
        for k in 0..16 * 12 * 80u32 {
            let pixel = UVec2::new(k % 16, k / 16 % 12);
            let step = (k / 192) as f32;
            let motion = Vec2::new(step * 0.125 - 5.0, 2.375 - step * 0.0625);
            let other = UVec2::new(size.x - 1 - pixel.x, pixel.y);
            let back = Vec2::new(-motion.x, motion.y);
            for footprint in [reproject_footprint, reproject_footprint_wide] {
                assert_eq!(
                    sorted(footprint(pixel, size, motion), true),
                    sorted(footprint(other, size, back), false),
                    "{pixel} {motion}"
                );
            }
        }
    }

    #[test]
    fn trap_truncation_toward_zero() {
        // A quarter of a pixel left of the first column's middle.
        let taps = reproject_footprint(UVec2::ZERO, UVec2::splat(8), Vec2::new(-0.25, 0.0));
        assert_eq!(listed(taps), [(UVec2::ZERO, 0.75)]);
        // Truncated, the first texel is 0 and the second 1, with the fraction
        // that belongs to texels -1 and 0.
        let place = -0.25f32;
        assert_eq!((place as i32, place - place.floor()), (0, 0.75));
        assert_ne!(place as i32, place.floor() as i32);
    }

    #[test]
    fn trap_one_test_for_four_taps() {
        // An edge between two objects, two columns each.
        let size = UVec2::new(4, 4);
        let prior = |at: UVec2| ReprojectSurface {
            mesh: u32::from(at.x >= 2),
            ..flat(at)
        };
        let read = |at: UVec2| ReprojectHistory {
            value: if at.x >= 2 { 1.0f32 } else { 0.0 },
            length: 7.0,
        };
        for k in 1..=16u8 {
            let motion = Vec2::new(0.0625 * f32::from(k), 0.0);
            let pixel = UVec2::new(1, 1);
            let expected = ReprojectSurface {
                mesh: 1,
                ..flat(UVec2::new(2, 1))
            };
            let found = reproject_pixel(
                pixel,
                size,
                motion,
                expected,
                0.0,
                REPROJECT_TOLERANCE,
                prior,
                read,
            );
            // Of the object, never a mixture.
            assert_eq!((found.value, found.length), (1.0, 7.0), "{motion}");
            // The filtered fetch that tests only the place itself mixes them.
            let mixed = reproject_gather(reproject_footprint(pixel, size, motion), read);
            assert!(k == 16 || (mixed.value > 0.0 && mixed.value < 1.0));
        }
    }

    #[test]
    fn three_by_three_only_where_none_of_the_four_fits() {
        let size = UVec2::new(8, 8);
        let lone = UVec2::new(3, 3);
        let reads = std::cell::Cell::new(0);
        let find = |pixel: UVec2, motion: Vec2| {
            reads.set(0);
            let found = reproject_find(
                pixel,
                size,
                motion,
                flat(pixel),
                0.0,
                REPROJECT_TOLERANCE,
                |at| {
                    reads.set(reads.get() + 1);
                    ReprojectSurface {
                        mesh: u32::from(at != lone),
                        ..flat(at)
                    }
                },
            );
            (listed(found), reads.get())
        };
        assert_eq!(find(lone, Vec2::ZERO), (vec![(lone, 1.0)], 1));
        assert_eq!(find(lone, Vec2::splat(0.25)).0, [(lone, 0.75 * 0.75)]);
        // A pixel beside it: nothing at its place, the neighbour by the spline.
        let found = find(UVec2::new(4, 3), Vec2::ZERO);
        assert_eq!(found, (vec![(lone, 0.125 * 0.75)], 1 + 9));
        assert_eq!(find(UVec2::new(6, 6), Vec2::ZERO).0, []);
    }

    #[test]
    fn a_texel_counts_if_it_lies_on_the_surface_that_is_expected() {
        let here = flat(UVec2::new(4, 4));
        let test = |found: ReprojectSurface, curvature: f32| {
            reproject_matches(here, curvature, found, REPROJECT_TOLERANCE)
        };
        assert_eq!(test(here, 0.0), 1);
        // Far along the plane, near off it.
        let moved = |by: Vec3| ReprojectSurface {
            position: here.position + by,
            ..here
        };
        assert_eq!(test(moved(Vec3::new(50.0, -80.0, 0.0)), 0.0), 1);
        assert_eq!(test(moved(Vec3::new(0.0, 0.0, 0.011)), 0.0), 0);
        assert_eq!(test(moved(Vec3::new(0.0, 0.0, -0.009)), 0.0), 1);
        let turned = |normal: Vec3| ReprojectSurface { normal, ..here };
        assert_eq!(test(turned(Vec3::new(0.6, 0.0, 0.8)), 0.0), 0);
        // Trap: the square of the cosine accepts the back.
        assert_eq!(test(turned(-Vec3::Z), 0.0), 0);
        assert_eq!(here.normal.dot(-Vec3::Z).powi(2), 1.0);
        assert_eq!(test(ReprojectSurface { mesh: 3, ..here }, 0.0), 0);
        assert_eq!(test(ReprojectSurface { depth: 0.0, ..here }, 0.0), 0);
        // On a ball of radius 1, a fifth of a radian aside.
        let (sin, cos) = 0.2f32.sin_cos();
        let ball = ReprojectSurface {
            position: here.position + Vec3::new(sin, 0.0, cos - 1.0),
            normal: Vec3::new(sin, 0.0, cos),
            ..here
        };
        assert_eq!((test(ball, 1.0), test(ball, 0.0)), (1, 0));
    }

    #[test]
    fn gathered_history_is_between_its_texels_and_never_longer() {
        let size = UVec2::new(9, 7);
        let mut next = numbers(5);
        let values: Vec<f32> = every(size).map(|_| next()).collect();
        let lengths: Vec<f32> = every(size).map(|_| (next() * 40.0).floor()).collect();
        let index = |at: UVec2| (at.y * size.x + at.x) as usize;
        let most = |v: &[f32]| v.iter().copied().fold(f32::MIN, f32::max);
        let least = |v: &[f32]| v.iter().copied().fold(f32::MAX, f32::min);
        for k in 0..5000u32 {
            let pixel = UVec2::new(k % 9, k / 9 % 7);
            let motion = Vec2::new(next(), next()) * 4.0 - 2.0;
            let taps = reproject_footprint(pixel, size, motion);
            let found = reproject_gather(taps, |at| ReprojectHistory {
                value: values[index(at)],
                length: lengths[index(at)],
            });
            if found.length == 0.0 {
                continue;
            }
            let used: Vec<usize> = listed(taps)
                .iter()
                .map(|t| index(t.0))
                .filter(|i| lengths[*i] > 0.0)
                .collect();
            let of = |v: &[f32]| used.iter().map(|i| v[*i]).collect::<Vec<_>>();
            let (v, l) = (of(&values), of(&lengths));
            assert!(found.value <= most(&v) && found.value >= least(&v));
            assert!(found.length <= most(&l) && found.length >= least(&l));
            // A constant comes out as it is.
            let constant = reproject_gather(taps, |at| ReprojectHistory {
                value: Vec3::new(0.1, 3.3, 1000.1),
                length: lengths[index(at)].min(1.0) * 5.0,
            });
            assert_eq!(constant.value, Vec3::new(0.1, 3.3, 1000.1));
            assert_eq!(constant.length, 5.0);
            // Exposure: exact for powers of two.
            for factor in [1024.0, 1.0 / 1024.0] {
                let scaled = reproject_gather(taps, |at| ReprojectHistory {
                    value: values[index(at)] * factor,
                    length: lengths[index(at)],
                });
                assert_eq!(scaled.value, found.value * factor);
            }
        }
        // A texel without history may hold anything.
        let taps = reproject_footprint(UVec2::ONE, size, Vec2::splat(0.5));
        let found = reproject_gather(taps, |at| ReprojectHistory {
            value: if at.x == 1 { f32::NAN } else { 2.0 },
            length: if at.x == 1 { 0.0 } else { 3.0 },
        });
        assert_eq!((found.value, found.length), (2.0, 3.0));
    }

    #[test]
    fn colours_are_weighed_by_their_distance_either_way() {
        let mean = Vec3::new(0.5, 0.25, 0.75);
        let deviation = Vec3::splat(0.125);
        let weight = |color: Vec3| reproject_color_weight(color, mean, deviation);
        assert_eq!(weight(mean), 1.0);
        assert!((weight(mean + 0.125) - 2f32.powi(-10)).abs() < 1e-7);
        assert_eq!(weight(mean + 0.125), weight(mean - 0.125));
        // Traps of the printed form: a darker pixel has a weight above 1, a
        // deviation of 0 none at all.
        let printed =
            |color: Vec3, deviation: Vec3| (-10.0 * luminance((color - mean) / deviation)).exp2();
        assert!(printed(mean - 0.125, deviation) > 1000.0);
        assert!(printed(mean, Vec3::ZERO).is_nan());
        assert_eq!(reproject_color_weight(mean, mean, Vec3::ZERO), 1.0);
        // Exposure changes nothing, neither with nor without a deviation.
        for k in [1.0 / 1024.0, 64.0] {
            for deviation in [deviation, Vec3::ZERO] {
                let color = mean * 1.01;
                assert_eq!(
                    reproject_color_distance(color * k, mean * k, deviation * k),
                    reproject_color_distance(color, mean, deviation)
                );
            }
        }
    }

    #[test]
    fn shares_sum_to_one_and_blends_keep_what_there_is() {
        for (a, b) in [(0.0, 0.0), (0.3, 0.1), (90.0, 96.0), (0.0, 96.0)] {
            let sum = reproject_share(a, b) + reproject_share(b, a);
            assert!((sum - 1.0).abs() < 1e-6);
            assert!((a <= b) == (reproject_share(a, b) <= 0.5));
        }
        let of = |value: f32, length: f32| ReprojectHistory { value, length };
        let kept = of(0.7, 3.0);
        assert_eq!(reproject_blend(kept, of(f32::NAN, 0.0), 0.5), kept);
        assert_eq!(reproject_blend(of(f32::NAN, 0.0), kept, 0.5), kept);
        for k in 0..=64u8 {
            let share = f32::from(k) / 64.0;
            assert_eq!(
                reproject_blend(of(0.1, 7.0), of(0.1, 7.0), share),
                of(0.1, 7.0)
            );
            let blend = reproject_blend(of(1.0, 4.0), of(2.0, 16.0), share);
            assert!((blend.value - (1.0 + share)).abs() < 1e-6);
            assert!((4.0..=16.0).contains(&blend.length));
        }
    }

    #[test]
    fn one_neighbour_speaks_for_both_directions() {
        // A column of pixels of a ball of radius 4: none across.
        let size = UVec2::new(1, 5);
        let read = |at: UVec2| {
            let (sin, cos) = ((at.y as f32 - 2.0) * 0.05).sin_cos();
            ReprojectSurface {
                position: Vec3::new(0.0, -4.0 * sin, 4.0 * cos),
                depth: 9.0,
                normal: Vec3::new(0.0, -sin, cos),
                mesh: 1,
            }
        };
        for parallax in [Vec2::X, Vec2::Y, Vec2::new(1.0, 1e-9), Vec2::new(-2.0, 1.0)] {
            let bend = reproject_bend(UVec2::new(0, 2), size, parallax, read);
            let curvature = reproject_curvature(bend.along, bend.turn);
            assert!((curvature - 0.25).abs() < 1e-5, "{parallax}: {curvature}");
        }
    }

    #[test]
    fn every_exposure_changes_nothing_but_the_scale() {
        let size = UVec2::new(9, 7);
        let mut next = numbers(15);
        let texels: Vec<ReprojectHistory<Vec3>> = every(size)
            .map(|_| ReprojectHistory {
                value: Vec3::new(next(), next(), next()),
                length: (next() * 9.0).floor(),
            })
            .collect();
        let scaled = |history: ReprojectHistory<Vec3>, k: f32| ReprojectHistory {
            value: history.value * k,
            ..history
        };
        for i in 0..500u32 {
            let pixel = UVec2::new(i % 9, i / 9 % 7);
            let gathered = |k: f32, motion: Vec2| {
                let taps = reproject_footprint(pixel, size, motion);
                reproject_gather(taps, |at| scaled(texels[(at.y * 9 + at.x) as usize], k))
            };
            let motions = [0, 1].map(|_| Vec2::new(next(), next()) * 2.0 - 1.0);
            let plain = motions.map(|motion| gathered(1.0, motion));
            let (share, deviation) = (next(), Vec3::new(next(), 0.0, next()));
            let blended = reproject_blend(plain[0], plain[1], share);
            let [a, b] = plain.map(|history| history.value);
            let distance = reproject_color_distance(a, b, deviation);
            for power in -10..=10 {
                let k = 2f32.powi(power);
                let bright = motions.map(|motion| gathered(k, motion));
                assert_eq!(bright, plain.map(|history| scaled(history, k)));
                let blend = reproject_blend(bright[0], bright[1], share);
                assert_eq!(blend, scaled(blended, k));
                let other = reproject_color_distance(a * k, b * k, deviation * k);
                assert_eq!(other, distance);
            }
        }
    }

    #[test]
    fn mirrored_and_transposed_images_give_mirrored_histories() {
        let size = UVec2::splat(12);
        type Flip = (fn(UVec2) -> UVec2, fn(Vec2) -> Vec2);
        let flips: [Flip; 3] = [
            (|p| UVec2::new(11 - p.x, p.y), |m| Vec2::new(-m.x, m.y)),
            (|p| UVec2::new(p.x, 11 - p.y), |m| Vec2::new(m.x, -m.y)),
            (|p| UVec2::new(p.y, p.x), |m| Vec2::new(m.y, m.x)),
        ];
        let mut next = numbers(16);
        let surfaces: Vec<ReprojectSurface> = every(size)
            .map(|_| ReprojectSurface {
                position: Vec3::Z * if next() < 0.2 { 1.0 } else { 0.0 },
                depth: if next() < 0.1 { 0.0 } else { 1.0 },
                normal: if next() < 0.2 { Vec3::X } else { Vec3::Z },
                mesh: u32::from(next() < 0.5),
            })
            .collect();
        let histories: Vec<ReprojectHistory<Vec3>> = every(size)
            .map(|_| ReprojectHistory {
                value: Vec3::new(next(), next(), next()),
                length: (next() * 9.0).floor(),
            })
            .collect();
        let index = |at: UVec2| (at.y * 12 + at.x) as usize;
        let expected = flat(UVec2::ZERO);
        let (mut found, mut none) = (0, 0);
        for (flip, turn) in flips {
            for i in 0..144 * 40u32 {
                let pixel = UVec2::new(i % 12, i / 12 % 12);
                // In eighths, so that weights and their sums are exact.
                let motion = ((Vec2::new(next(), next()) * 6.0 - 3.0) * 8.0).round() / 8.0;
                let pixel_of = |pixel, motion, source: &dyn Fn(UVec2) -> UVec2| {
                    reproject_pixel(
                        pixel,
                        size,
                        motion,
                        expected,
                        0.0,
                        REPROJECT_TOLERANCE,
                        |at| surfaces[index(source(at))],
                        |at| histories[index(source(at))],
                    )
                };
                let a = pixel_of(pixel, motion, &|at| at);
                let b = pixel_of(flip(pixel), turn(motion), &flip);
                // Nine terms added in another order, twice, and a quotient.
                let close = |a: f32, b: f32| (a - b).abs() <= 20.0 * f32::EPSILON * a.max(b);
                assert!(close(a.length, b.length), "{pixel} {motion}");
                for channel in 0..3 {
                    assert!(
                        close(a.value[channel], b.value[channel]),
                        "{pixel} {motion}"
                    );
                }
                found += u32::from(a.length > 0.0);
                none += u32::from(a.length == 0.0);
            }
        }
        assert!(found > 1000 && none > 1000, "{found} {none}");
    }

    #[test]
    fn the_weights_of_a_history_sum_to_one() {
        // No constant shows it, as results are held between their inputs.
        let size = UVec2::new(9, 7);
        let mut next = numbers(17);
        let values: Vec<f32> = every(size).map(|_| next()).collect();
        let lengths: Vec<f32> = every(size).map(|_| (next() * 9.0).floor()).collect();
        for i in 0..5000u32 {
            let pixel = UVec2::new(i % 9, i / 9 % 7);
            let motion = Vec2::new(next(), next()) * 4.0 - 2.0;
            for footprint in [reproject_footprint, reproject_footprint_wide] {
                let line = |scale: f32, more: f32| {
                    reproject_gather(footprint(pixel, size, motion), |at| {
                        let index = (at.y * 9 + at.x) as usize;
                        ReprojectHistory {
                            value: values[index] * scale + more,
                            length: lengths[index],
                        }
                    })
                };
                let (plain, other) = (line(1.0, 0.0), line(2.0, 3.0));
                if plain.length > 0.0 {
                    // Two sums of nine and a quotient: 20 roundings, of values
                    // below 1 (twice) and below 8, with what is added.
                    let apart = (other.value - (plain.value * 2.0 + 3.0)).abs();
                    assert!(apart < 21.0 * (2f32.powi(-23) + 2f32.powi(-21)), "{apart}");
                }
            }
        }
    }

    #[test]
    fn trap_texels_outside_that_count_as_black() {
        let size = UVec2::splat(8);
        let mut darkened = 0;
        for i in 0..64 * 33u32 {
            let pixel = UVec2::new(i % 8, i / 8 % 8);
            let step = 0.125 * (i / 64) as f32;
            let motion = Vec2::new(step - 2.0, 2.0 - step);
            let ours = reproject_pixel(
                pixel,
                size,
                motion,
                flat(pixel),
                0.0,
                REPROJECT_TOLERANCE,
                flat,
                |at| {
                    assert!(at.cmplt(size).all(), "{at}");
                    ReprojectHistory {
                        value: 1.0,
                        length: 7.0,
                    }
                },
            );
            // Inside by its nearest texel alone; the others are read as they
            // come, and what lies outside comes as zero.
            let place = pixel.as_vec2() + motion;
            let inside = |p: Vec2| p.cmpge(Vec2::ZERO).all() && p.cmplt(size.as_vec2()).all();
            if !inside((place + 0.5).floor()) {
                continue;
            }
            assert_eq!((ours.value, ours.length), (1.0, 7.0), "{pixel} {motion}");
            let (base, part) = (place.floor(), place - place.floor());
            let mut naive = 0.0;
            for tap in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE] {
                let weight = (1.0 - (tap - part).abs()).element_product();
                naive += weight * f32::from(u8::from(inside(base + tap)));
            }
            darkened += u32::from(naive < 1.0);
        }
        assert!(darkened > 100, "{darkened}");
    }

    #[test]
    fn trap_one_place_for_the_depths_of_four_texels() {
        // A floor in a small image, its depths from row to row far apart.
        let size = UVec2::new(32, 18);
        let camera = Camera {
            inverse_resolution: 1.0 / size.as_vec2(),
            ..camera(Vec3::new(0.0, 1.5, 0.0), Vec3::new(3.0, 0.5, 1.0))
        };
        let depth = |place: Vec2| {
            let one = camera_position_from_depth(place, 1.0, camera);
            1.5 / (1.5 - one.y)
        };
        let floor = |place: Vec2, depth: f32| ReprojectSurface {
            position: camera_position_from_depth(place, depth, camera),
            depth,
            normal: Vec3::Y,
            mesh: 0,
        };
        let motion = Vec2::new(0.25, -0.5);
        let (mut ours, mut naive) = (0, 0);
        for pixel in every(size).filter(|p| (8..17).contains(&p.y) && p.x < 31) {
            let place = middle(pixel) + motion;
            let expected = floor(place, depth(place));
            let find = |at_own_place: bool| {
                let read = |at: UVec2| {
                    let own = if at_own_place { middle(at) } else { place };
                    floor(own, depth(middle(at)))
                };
                let taps = reproject_footprint(pixel, size, motion);
                reproject_tested(taps, expected, 0.0, REPROJECT_TOLERANCE, &read)
            };
            assert_eq!(listed(find(true)).len(), 4, "{pixel}");
            ours += 4;
            naive += listed(find(false)).len();
        }
        println!("on the floor: {ours} texels, {naive} by one place for all");
        assert!(2 * naive < ours);
    }

    #[test]
    fn trap_an_absolute_threshold_of_the_plane() {
        let mut next = numbers(18);
        let mut changed = 0;
        let mut passed = 0;
        for _ in 0..2000 {
            let here = ReprojectSurface {
                depth: 2.0,
                ..flat(UVec2::ZERO)
            };
            let found = ReprojectSurface {
                position: Vec3::new(next(), next(), 0.1 * next() - 0.05),
                ..here
            };
            let at = |k: f32| {
                let scaled = |surface: ReprojectSurface| ReprojectSurface {
                    position: surface.position * k,
                    depth: surface.depth * k,
                    ..surface
                };
                let (here, found) = (scaled(here), scaled(found));
                let height = here.normal.dot(found.position - here.position);
                (
                    reproject_matches(here, 0.0, found, REPROJECT_TOLERANCE),
                    u32::from(height.abs() < 5.0),
                )
            };
            let (ours, absolute) = at(1.0);
            for k in [0.001, 1000.0] {
                assert_eq!(at(k).0, ours);
                changed += u32::from(at(k).1 != absolute);
            }
            passed += ours;
        }
        assert!((500..1500).contains(&passed), "{passed}");
        assert!(changed > 1000, "{changed}");
    }

    #[test]
    fn trap_a_normal_test_that_never_rejects() {
        let here = flat(UVec2::ZERO);
        // The distance of the normals over their change from pixel to pixel.
        let naive =
            |other: Vec3, change: f32| (other - here.normal).length() / (change + 0.01) < 16.0;
        let ours = |other: Vec3, curvature: f32| {
            let found = ReprojectSurface {
                normal: other,
                position: here.position + Vec3::X * 1e-3,
                ..here
            };
            reproject_matches(here, curvature, found, REPROJECT_TOLERANCE) == 1
        };
        // Where they change by an eighth, as on a ball far away, even the back
        // counts.
        assert!(naive(-Vec3::Z, 0.12) && naive(Vec3::X, 0.12));
        for curvature in [0.0, 0.125, 1.0, 100.0] {
            for other in [-Vec3::Z, Vec3::X, Vec3::new(0.8, 0.0, 0.6)] {
                assert!(!ours(other, curvature), "{other}, {curvature}");
            }
            assert!(ours(Vec3::Z, curvature));
        }
    }

    #[test]
    fn trap_neither_of_two_histories() {
        // Weights over their sum, both of them 0 that far from the frame.
        let weight = |distance: f32| exp2_poly(-10.0 * distance);
        assert!((weight(96.0) / (weight(96.0) + weight(96.0))).is_nan());
        let none = reproject_gather(REPROJECT_NO_TAPS, |_| ReprojectHistory {
            value: f32::NAN,
            length: 9.0,
        });
        assert_eq!((none.value, none.length), (0.0, 0.0));
        let other = ReprojectHistory {
            value: 5.0,
            length: 0.0,
        };
        for (a, b) in [(0.0, 0.0), (1.0, 96.0), (96.0, 96.0), (1e30, 1e30)] {
            let share = reproject_share(a, b);
            assert!((0.0..=1.0).contains(&share));
            assert_eq!(reproject_blend(none, none, share), none);
            // Never a mixture, nor a length.
            let blend = reproject_blend(none, other, share);
            assert!(blend == none || blend == other, "{blend:?}");
        }
    }
}
