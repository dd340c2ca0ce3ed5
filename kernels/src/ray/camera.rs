//! Camera rays and positions from depth: the pair and its contract.

pub use raytwin_cpu::ray::camera::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::ray::CAMERA;

#[cfg(feature = "contract")]
crate::value_struct!(Camera {
    origin: glam::Vec3,
    right: glam::Vec3,
    up: glam::Vec3,
    forward: glam::Vec3,
    inverse_resolution: glam::Vec2,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Kernel, domains};
    use crate::sample::basis::basis_from_normal;
    use glam::{DMat4, DVec2, DVec3, DVec4, Vec2, Vec3, Vec4};

    const SOURCE: &str = "Physically Based Rendering, 4th ed., 5.2.2";
    const DEPTH: &str = "Ray Tracing Gems ch. 25, section 25.2.1 (clip to world)";
    type WideCamera = (DVec3, DVec3, DVec3, DVec3, DVec2);

    let build = |origin: Vec3, forward: Vec3, tangent: f32, width: f32, height: f32| {
        let frame = basis_from_normal(forward);
        Camera {
            origin,
            right: frame.tangent * (tangent * width / height),
            up: frame.bitangent * tangent,
            forward,
            inverse_resolution: Vec2::new(1.0 / width, 1.0 / height),
        }
    };
    // Full fields of view from 1 to 150 degrees, up to 4096 pixels wide,
    // aspects from 1:4 to 4:1.
    let camera = domains::vec3(domains::range(-10.0, 10.0))
        .and(domains::unit_vector())
        .and(domains::log_range(0.009, 3.7))
        .and(domains::below(4095))
        .and(domains::log_range(0.25, 4.0))
        .map(move |((((origin, forward), tangent), w), aspect)| {
            let width = w as f32 + 1.0;
            build(origin, forward, tangent, width, (width / aspect).ceil())
        });
    let view = camera
        .and(domains::unit_pair())
        .map(|(camera, u)| (u / camera.inverse_resolution, camera));
    let image_point = |pixel: DVec2, (_, right, up, forward, inverse): WideCamera| {
        let p = pixel * inverse * 2.0 - 1.0;
        right * p.x - up * p.y + forward
    };
    let straight = build(Vec3::ZERO, -Vec3::Z, 1.0, 1920.0, 1080.0);

    vec![
        Kernel::new(
            "ray/camera",
            "camera_ray",
            ["pixel", "camera"],
            camera_ray,
            move |pixel: DVec2, camera: WideCamera| {
                (
                    camera.0,
                    image_point(pixel, camera).normalize(),
                    0.0,
                    f64::from(f32::MAX),
                )
            },
            view.clone(),
        )
        // Errors of the image plane's point, over its distance from the eye.
        .scale_by(move |pixel: DVec2, camera: WideCamera| {
            let reach = 1.0 + camera.1.length() + camera.2.length();
            (reach / image_point(pixel, camera).length()).max(0.5)
        })
        .few_ulp(2.0, 10.0)
        .hard([
            (Vec2::ZERO, straight),
            (Vec2::new(960.0, 540.0), straight),
            (Vec2::new(1920.0, 1080.0), straight),
            (
                Vec2::new(0.5, 0.5),
                build(Vec3::ONE, Vec3::X, 3.7, 1.0, 1.0),
            ),
            (
                Vec2::new(4095.5, 0.5),
                build(Vec3::ONE, Vec3::Y, 0.009, 4096.0, 4096.0),
            ),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/camera",
            "camera_position_from_depth",
            ["pixel", "depth", "camera"],
            camera_position_from_depth,
            move |pixel: DVec2, depth: f64, camera: WideCamera| {
                camera.0 + image_point(pixel, camera) * depth
            },
            view.and(domains::log_range(0.01, 1e4))
                .map(|((pixel, camera), depth)| (pixel, depth, camera)),
        )
        .scale_by(|_: DVec2, depth: f64, (o, right, up, _, _): WideCamera| {
            o.abs().max_element() + depth * (1.0 + right.length() + up.length())
        })
        .few_ulp(2.0, 5.5)
        .hard([
            (Vec2::ZERO, 1.0, straight),
            (Vec2::new(960.0, 540.0), 1e4, straight),
            (Vec2::new(1920.0, 1080.0), 0.01, straight),
        ])
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/camera",
            "position_from_depth",
            [
                "uv", "depth", "column_x", "column_y", "column_z", "column_w",
            ],
            position_from_depth,
            |uv: DVec2, depth: f64, x: DVec4, y: DVec4, z: DVec4, w: DVec4| {
                let clip = DVec4::new(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, depth, 1.0);
                let p = DMat4::from_cols(x, y, z, w) * clip;
                p.truncate() / if p.w == 0.0 { 1.0 } else { p.w }
            },
            // Reversed-z, infinite far plane at 0.1 in front of a camera that
            // looks anywhere; depth is near / distance.
            domains::unit_pair()
                .and(domains::log_range(1e-4, 1.0))
                .and(domains::vec3(domains::range(-10.0, 10.0)))
                .and(domains::unit_vector())
                .and(domains::log_range(0.1, 3.0))
                .map(|((((uv, depth), eye), forward), tangent)| {
                    let frame = basis_from_normal(forward);
                    let wide = |v: Vec3, w: f32| Vec4::new(v.x, v.y, v.z, w);
                    // Inverse view-projection: right and up scaled by the
                    // tangent, forward and the eye over the near distance.
                    (
                        uv,
                        depth,
                        wide(frame.tangent * tangent, 0.0),
                        wide(frame.bitangent * tangent, 0.0),
                        wide(eye * 10.0, 10.0),
                        wide(forward, 0.0),
                    )
                }),
        )
        .scale_by(
            |_: DVec2, depth: f64, x: DVec4, y: DVec4, z: DVec4, w: DVec4| {
                let sum = x.abs() + y.abs() + z.abs() * depth + w.abs();
                let p = z.w * depth + w.w;
                sum.truncate().max_element() / if p == 0.0 { 1.0 } else { p.abs() }
            },
        )
        .few_ulp(3.75, 9.0)
        .hard([
            (
                Vec2::splat(0.5),
                0.0,
                Vec4::X,
                Vec4::Y,
                Vec4::new(0.0, 0.0, 0.0, 10.0),
                Vec4::new(0.0, 0.0, -1.0, 0.0),
            ),
            (
                Vec2::ZERO,
                1.0,
                Vec4::X,
                Vec4::Y,
                Vec4::new(0.0, 0.0, 0.0, 10.0),
                Vec4::new(0.0, 0.0, -1.0, 0.0),
            ),
        ])
        .source(DEPTH)
        .build(),
    ]
}
