//! Pinhole camera: pixel to ray, and depth back to a world position.

use glam::{Vec2, Vec3, Vec4};

use super::ray::Ray;
use crate::math::vector::vec3_normalize;

/// A pinhole camera in world space.
///
/// For a vertical field of view `f` and an aspect ratio `w/h`, `up` is the
/// unit up vector times `tan(f/2)` and `right` the unit right vector times
/// `tan(f/2)·w/h`. From a view-projection matrix: unproject the corners.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::camera::Camera;
///
/// // 90 degrees high, twice as wide as high: tan 45° is 1.
/// let camera = Camera {
///     origin: Vec3::ZERO,
///     right: 2.0 * Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::new(1.0 / 640.0, 1.0 / 320.0),
/// };
/// assert_eq!(camera.right.cross(camera.up).normalize(), -camera.forward);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Camera {
    /// The eye.
    pub origin: Vec3,
    /// From the middle of the image plane at depth 1 to its right edge.
    pub right: Vec3,
    /// From the middle of the image plane at depth 1 to its upper edge.
    pub up: Vec3,
    /// Unit vector along which depth is measured.
    pub forward: Vec3,
    /// One over the image's width and height in pixels.
    pub inverse_resolution: Vec2,
}

/// From the eye through a pixel to the image plane at depth 1.
#[inline]
fn camera_image_point(pixel: Vec2, camera: Camera) -> Vec3 {
    let x = (pixel.x * camera.inverse_resolution.x) * 2.0 - 1.0;
    let y = 1.0 - (pixel.y * camera.inverse_resolution.y) * 2.0;
    Vec3::new(
        (camera.right.x * x + camera.up.x * y) + camera.forward.x,
        (camera.right.y * x + camera.up.y * y) + camera.forward.y,
        (camera.right.z * x + camera.up.z * y) + camera.forward.z,
    )
}

/// The ray from the eye through a point of the image, with a unit direction
/// and no limit.
///
/// `pixel` counts in pixels from the image's upper left corner, `y` down: the
/// middle of pixel `(i, j)` is `(i + 0.5, j + 0.5)`. Each component of the
/// direction errs by a few ULP of 1; that is below a thousandth of a pixel up
/// to 8192 pixels.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::camera::{Camera, camera_ray};
///
/// let camera = Camera {
///     origin: Vec3::ZERO,
///     right: 2.0 * Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::new(1.0 / 640.0, 1.0 / 320.0),
/// };
/// let middle = camera_ray(Vec2::new(320.0, 160.0), camera);
/// assert!((middle.direction - camera.forward).length() < 1e-6);
/// // The upper edge is 45 degrees up.
/// let top = camera_ray(Vec2::new(320.0, 0.0), camera);
/// assert!((top.direction.y - 0.5_f32.sqrt()).abs() < 1e-6);
/// ```
#[inline]
#[must_use]
pub fn camera_ray(pixel: Vec2, camera: Camera) -> Ray {
    Ray {
        origin: camera.origin,
        direction: vec3_normalize(camera_image_point(pixel, camera)),
        t_min: 0.0,
        t_max: f32::MAX,
    }
}

/// World position of a pixel at a linear view depth.
///
/// `depth` is the distance along [`Camera::forward`], not along the ray, in
/// world units. `pixel` as in [`camera_ray`].
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::ray::camera::{Camera, camera_position_from_depth};
///
/// let camera = Camera {
///     origin: Vec3::ZERO,
///     right: 2.0 * Vec3::X,
///     up: Vec3::Y,
///     forward: Vec3::NEG_Z,
///     inverse_resolution: Vec2::new(1.0 / 640.0, 1.0 / 320.0),
/// };
/// // Depth is measured along the view's axis, also at the image's corner.
/// let corner = camera_position_from_depth(Vec2::ZERO, 5.0, camera);
/// assert!((corner - Vec3::new(-10.0, 5.0, -5.0)).length() < 1e-5);
/// ```
#[inline]
#[must_use]
pub fn camera_position_from_depth(pixel: Vec2, depth: f32, camera: Camera) -> Vec3 {
    let point = camera_image_point(pixel, camera);
    Vec3::new(
        camera.origin.x + point.x * depth,
        camera.origin.y + point.y * depth,
        camera.origin.z + point.z * depth,
    )
}

/// World position from what a depth buffer holds, by the inverse of the
/// view-projection matrix, given as its four columns.
///
/// `uv` is `(0, 0)` at the upper left corner of the image and `(1, 1)` at the
/// lower right one; `depth` is the buffer's value, whatever the convention of
/// the matrix: with reversed z, 1 is the near plane and 0 the far plane. With
/// an infinite far plane depth 0 is a direction, not a position: the fourth
/// coordinate is zero then, and the direction is returned undivided.
///
/// ```
/// use glam::{Mat4, Vec2, Vec3, Vec4};
/// use raytwin_cpu::ray::camera::position_from_depth;
///
/// // Reversed z, 90 degrees: 1 is the near plane at 0.1, 0 infinitely far.
/// let projection =
///     Mat4::from_cols(Vec4::X, Vec4::Y, Vec4::NEG_W, 0.1 * Vec4::Z);
/// let seen = projection.project_point3(Vec3::new(0.3, -0.2, -4.0));
/// let uv = Vec2::new(0.5 + 0.5 * seen.x, 0.5 - 0.5 * seen.y);
/// let m = projection.inverse();
/// let p =
///     position_from_depth(uv, seen.z, m.x_axis, m.y_axis, m.z_axis, m.w_axis);
/// assert!((p - Vec3::new(0.3, -0.2, -4.0)).length() < 1e-4);
/// ```
#[inline]
#[must_use]
pub fn position_from_depth(
    uv: Vec2,
    depth: f32,
    column_x: Vec4,
    column_y: Vec4,
    column_z: Vec4,
    column_w: Vec4,
) -> Vec3 {
    let x = uv.x * 2.0 - 1.0;
    let y = 1.0 - uv.y * 2.0;
    let px = ((column_x.x * x + column_y.x * y) + column_z.x * depth) + column_w.x;
    let py = ((column_x.y * x + column_y.y * y) + column_z.y * depth) + column_w.y;
    let pz = ((column_x.z * x + column_y.z * y) + column_z.z * depth) + column_w.z;
    let pw = ((column_x.w * x + column_y.w * y) + column_z.w * depth) + column_w.w;
    let w = if pw == 0.0 { 1.0 } else { pw };
    Vec3::new(px / w, py / w, pz / w)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat4;

    /// Perspective with reversed z and an infinite far plane.
    fn projection(k: f32, aspect: f32, near: f32) -> Mat4 {
        Mat4::from_cols(
            Vec4::X / (k * aspect),
            Vec4::Y / k,
            -Vec4::W,
            Vec4::Z * near,
        )
    }

    fn camera() -> (Camera, Mat4) {
        let eye = Vec3::new(1.0, 2.0, 3.0);
        let target = Vec3::new(-4.0, 1.0, 0.5);
        let (k, aspect) = (0.6f32, 1.5f32);
        let forward = (target - eye).normalize();
        let right = forward.cross(Vec3::Y).normalize();
        let up = right.cross(forward);
        let world = Mat4::from_cols(
            right.extend(0.0),
            up.extend(0.0),
            (-forward).extend(0.0),
            eye.extend(1.0),
        );
        (
            Camera {
                origin: eye,
                right: right * (k * aspect),
                up: up * k,
                forward,
                inverse_resolution: Vec2::new(1.0 / 600.0, 1.0 / 400.0),
            },
            projection(k, aspect, 0.1) * world.inverse(),
        )
    }

    #[test]
    fn middle_looks_forward() {
        let (c, _) = camera();
        let r = camera_ray(Vec2::new(300.0, 200.0), c);
        assert!((r.direction - c.forward).length() < 1e-6);
        let upper_left = camera_ray(Vec2::ZERO, c).direction;
        assert!(upper_left.dot(c.up) > 0.0 && upper_left.dot(c.right) < 0.0);
    }

    #[test]
    fn projecting_back_gives_the_pixel() {
        let (c, m) = camera();
        for pixel in [
            Vec2::new(0.5, 0.5),
            Vec2::new(599.5, 10.5),
            Vec2::new(33.25, 399.0),
        ] {
            let world = camera_position_from_depth(pixel, 7.0, c);
            let clip = m * world.extend(1.0);
            let ndc = clip / clip.w;
            let back = Vec2::new((ndc.x + 1.0) * 300.0, (1.0 - ndc.y) * 200.0);
            assert!((back - pixel).length() < 1e-3, "{pixel} {back}");
            assert!((clip.w - 7.0).abs() < 1e-5);
            // The depth buffer's value leads to the same place.
            let i = m.inverse();
            let uv = pixel * c.inverse_resolution;
            let p = position_from_depth(uv, ndc.z, i.x_axis, i.y_axis, i.z_axis, i.w_axis);
            assert!((p - world).length() < 1e-4, "{p} {world}");
        }
    }

    #[test]
    fn infinite_far_plane_is_finite() {
        let m = projection(0.5, 1.0, 0.1).inverse();
        let p = position_from_depth(
            Vec2::splat(0.5),
            0.0,
            m.x_axis,
            m.y_axis,
            m.z_axis,
            m.w_axis,
        );
        assert!(p.is_finite());
    }
}
