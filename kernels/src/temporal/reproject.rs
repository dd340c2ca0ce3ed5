//! Reprojection: the pair and its contract.

pub use raytwin_cpu::temporal::reproject::*;

/// The WGSL twin, without what it requires and without what it calls back.
pub const WGSL: &str = raytwin_wgsl::temporal::REPROJECT;

#[cfg(feature = "contract")]
use glam::{DVec2, DVec3, UVec2, Vec2, Vec3};

#[cfg(feature = "contract")]
crate::value_struct!(ReprojectSurface {
    position: Vec3,
    depth: f32,
    normal: Vec3,
    mesh: u32,
});

#[cfg(feature = "contract")]
crate::value_struct!(ReprojectTolerance {
    plane: f32,
    normal: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(ReprojectTaps {
    corner: UVec2,
    across: Vec3,
    down: Vec3,
    valid: u32,
});

#[cfg(feature = "contract")]
crate::value_struct!(ReprojectTap {
    at: UVec2,
    weight: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!([] ReprojectHistory = ReprojectHistory<Vec3> {
    value: Vec3,
    length: f32,
});

#[cfg(feature = "contract")]
crate::value_struct!(ReprojectBend {
    along: Vec3,
    turn: Vec3,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use crate::contract::{Domain, Kernel, domains};
    use crate::ray::camera::Camera;
    use crate::sample::basis::basis_from_normal;
    use glam::DMat3;

    const MODULE: &str = "temporal/reproject";
    const PINHOLE: &str = "Physically Based Rendering, 4th ed., 5.2.2 (inverted)";
    const SVGF: &str = "Schied et al. 2017, section 4.1";
    const CHAPTER: &str = "Ray Tracing Gems, ch. 25 (blend of two reprojections)";
    const FRONT: &str = "Deschamps 1972 (reflected wave front)";
    const SIZE: UVec2 = UVec2::new(16, 12);
    // Images from a hash of the place, in exact fractions, so that interval
    // arithmetic sees the whole kernel. This frame: a bowl and a dome, with
    // holes. The frame before: floors of two objects, rough, a strip of it
    // tilted, with holes.
    const FIXTURE: &str = "
alias ReprojectValue = vec3f;
fn raytwin_hash(at: vec2u, lane: u32) -> u32 {
    var h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu) ^ (lane * 0xc2b2ae35u);
    h = (h ^ (h >> 16u)) * 0x7feb352du;
    h = (h ^ (h >> 15u)) * 0x846ca68bu;
    return (h ^ (h >> 16u)) & 255u;
}
fn reproject_read_surface(at: vec2u) -> ReprojectSurface {
    let x = (f32(at.x) - 7.5) * 0.25;
    let y = (5.5 - f32(at.y)) * 0.25;
    let square = x * x + y * y;
    var bend = 0.125;
    var mesh = 0u;
    if at.x >= 8u {
        bend = -0.0625;
        mesh = 1u;
    }
    var depth = 4.0;
    if raytwin_hash(at, 1u) < 16u {
        depth = 0.0;
    }
    return ReprojectSurface(
        vec3f(x, y, -0.5 * bend * square),
        depth,
        vec3f(bend * x, bend * y, 1.0 - 0.5 * (bend * bend) * square),
        mesh,
    );
}
fn reproject_read_prior(at: vec2u) -> ReprojectSurface {
    var normal = vec3f(0.0, 0.0, 1.0);
    if at.y > 8u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    var depth = 4.0;
    if raytwin_hash(at, 2u) < 40u {
        depth = 0.0;
    }
    return ReprojectSurface(
        vec3f(f32(at.x), f32(at.y), f32(raytwin_hash(at, 3u)) * 0.00390625),
        depth,
        normal,
        select(0u, 1u, at.x > 9u),
    );
}
fn reproject_read_history(at: vec2u) -> ReprojectHistory {
    return ReprojectHistory(
        vec3f(
            f32(raytwin_hash(at, 4u)) * 0.00390625,
            f32(raytwin_hash(at, 5u)) * 0.00390625,
            f32(raytwin_hash(at, 6u)) * 0.00390625,
        ),
        f32(raytwin_hash(at, 7u) & 15u),
    );
}
";
    fn hash(at: UVec2, lane: u32) -> u32 {
        let mut h = at.x.wrapping_mul(0x9e37_79b9)
            ^ at.y.wrapping_mul(0x85eb_ca6b)
            ^ lane.wrapping_mul(0xc2b2_ae35);
        h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
        h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
        (h ^ (h >> 16)) & 255
    }
    fn read_surface(at: UVec2) -> ReprojectSurface {
        let x = (at.x as f32 - 7.5) * 0.25;
        let y = (5.5 - at.y as f32) * 0.25;
        let square = x * x + y * y;
        let (bend, mesh) = if at.x >= 8 { (-0.0625, 1) } else { (0.125, 0) };
        ReprojectSurface {
            position: Vec3::new(x, y, -0.5 * bend * square),
            depth: if hash(at, 1) < 16 { 0.0 } else { 4.0 },
            normal: Vec3::new(bend * x, bend * y, 1.0 - 0.5 * (bend * bend) * square),
            mesh,
        }
    }
    fn read_prior(at: UVec2) -> ReprojectSurface {
        ReprojectSurface {
            position: Vec3::new(at.x as f32, at.y as f32, hash(at, 3) as f32 * 0.00390625),
            depth: if hash(at, 2) < 40 { 0.0 } else { 4.0 },
            normal: if at.y > 8 {
                Vec3::new(0.125, 0.0, 0.9921567)
            } else {
                Vec3::Z
            },
            mesh: u32::from(at.x > 9),
        }
    }
    fn read_history(at: UVec2) -> ReprojectHistory<Vec3> {
        let lane = |i: u32| hash(at, i) as f32 * 0.00390625;
        ReprojectHistory {
            value: Vec3::new(lane(4), lane(5), lane(6)),
            length: (hash(at, 7) & 15) as f32,
        }
    }
    fn find(
        pixel: UVec2,
        size: UVec2,
        motion: Vec2,
        expected: ReprojectSurface,
        curvature: f32,
        tolerance: ReprojectTolerance,
    ) -> ReprojectTaps {
        reproject_find(
            pixel, size, motion, expected, curvature, tolerance, read_prior,
        )
    }
    fn gather(taps: ReprojectTaps) -> ReprojectHistory<Vec3> {
        reproject_gather(taps, read_history)
    }
    fn whole_pixel(
        pixel: UVec2,
        size: UVec2,
        motion: Vec2,
        expected: ReprojectSurface,
        curvature: f32,
        tolerance: ReprojectTolerance,
    ) -> ReprojectHistory<Vec3> {
        reproject_pixel(
            pixel,
            size,
            motion,
            expected,
            curvature,
            tolerance,
            read_prior,
            read_history,
        )
    }
    fn bend(pixel: UVec2, size: UVec2, parallax: Vec2) -> ReprojectBend {
        reproject_bend(pixel, size, parallax, read_surface)
    }
    fn reflection_motion(
        pixel: UVec2,
        size: UVec2,
        distance: f32,
        camera: Camera,
        prior_camera: Camera,
    ) -> Vec2 {
        reproject_reflection_motion(pixel, size, distance, camera, prior_camera, read_surface)
    }

    type WideCamera = (DVec3, DVec3, DVec3, DVec3, DVec2);
    type WideSurface = (DVec3, f64, DVec3, u32);
    type WideTaps = (UVec2, DVec3, DVec3, u32);
    type WideHistory = (DVec3, f64);

    // Place and depth by inverting the matrix of the camera's axes, and how
    // far an ULP of the point's offset moves them.
    fn exact_project(point: DVec3, (o, right, up, forward, inverse): WideCamera) -> (DVec3, f64) {
        let to = point - o;
        let axes = DMat3::from_cols(right, up, forward).inverse();
        let image = axes * to;
        let (x, y) = (image.x / image.z, image.y / image.z);
        let place = DVec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y) / inverse;
        let row = |i: usize| axes.row(i).length();
        let reach = to.length() / image.z.abs();
        let width = row(0) + x.abs() * row(2);
        let height = row(1) + y.abs() * row(2);
        let scale = 0.5 * (DVec2::ONE + DVec2::new(width, height) * reach) / inverse;
        (place.extend(image.z), scale.max_element())
    }
    fn exact_motion(p: DVec3, q: DVec3, now: WideCamera, then: WideCamera) -> (DVec2, f64) {
        if p == q && now == then {
            return (DVec2::ZERO, 1.0);
        }
        let (a, a_scale) = exact_project(p, now);
        let (b, b_scale) = exact_project(q, then);
        if a.z * b.z > 0.0 {
            (b.truncate() - a.truncate(), a_scale + b_scale)
        } else {
            (DVec2::splat(16_777_216.0), 1.0)
        }
    }
    // Whether a point is in the plane of a camera's eye, to rounding.
    fn beside(point: DVec3, camera: WideCamera) -> bool {
        let (image, _) = exact_project(point, camera);
        image.z.abs() < 1e-5 * (point - camera.0).length()
    }
    fn exact_image(distance: f64, power: f64) -> f64 {
        let bend = 1.0 + distance * power;
        let limit = 1.0 / 64.0;
        if bend >= 0.0 {
            distance / bend.max(limit)
        } else {
            -distance / (-bend).max(limit)
        }
    }
    fn image_scale(distance: f64, power: f64) -> f64 {
        let bend = (1.0 + distance * power).abs().max(1.0 / 64.0);
        distance / bend * (1.0 + (distance * power).abs()) / bend
    }
    fn at_focus(distance: f64, power: f64) -> bool {
        (1.0 + distance * power).abs() < 1e-5 * (1.0 + (distance * power).abs())
    }
    fn exact_power(view: DVec3, normal: DVec3, along: DVec3, turn: DVec3) -> f64 {
        // The step as the eye sees it, without its part along the ray.
        let seen = along - view * (along.dot(view) / view.length_squared());
        if view.dot(normal) >= 0.0 || along == DVec3::ZERO {
            return 0.0;
        }
        -2.0 * view.dot(normal) * turn.dot(along) / seen.length_squared()
    }

    // Weights by the kernels' definitions, texel by texel: a tent of half-width
    // 1, a quadratic B-spline.
    fn tent(t: f64) -> f64 {
        (1.0 - t.abs()).max(0.0)
    }
    fn spline(t: f64) -> f64 {
        let t = t.abs();
        if t < 0.5 {
            0.75 - t * t
        } else {
            0.5 * (1.5 - t).max(0.0).powi(2)
        }
    }
    // Along one axis: first texel, weights, whether the place is inside.
    fn axis(pixel: u32, motion: f64, wide: bool) -> (i64, [f64; 3], f64) {
        let place = f64::from(pixel) + motion;
        let first = if wide {
            (motion + 0.5).floor() - 1.0
        } else {
            motion.floor()
        } as i64
            + i64::from(pixel);
        let weights = [0, 1, 2].map(|i| {
            let t = (first + i) as f64 - place;
            if wide { spline(t) } else { tent(t) }
        });
        (first, weights, place)
    }
    fn exact_taps(pixel: UVec2, size: UVec2, motion: DVec2, wide: bool) -> WideTaps {
        let nothing = (UVec2::ZERO, DVec3::ZERO, DVec3::ZERO, 0);
        if motion.abs().max_element() >= 4_194_304.0 {
            return nothing;
        }
        let x = axis(pixel.x, motion.x, wide);
        let y = axis(pixel.y, motion.y, wide);
        let outside = |place: f64, size: u32| place < -0.5 || place > f64::from(size) - 0.5;
        if outside(x.2, size.x) || outside(y.2, size.y) {
            return nothing;
        }
        let inside = |at: i64, size: u32| at >= 0 && at < i64::from(size);
        let mut valid = 0;
        for j in 0..3 {
            for i in 0..3 {
                let ok = inside(x.0 + i, size.x) && inside(y.0 + j, size.y);
                if ok && x.1[i as usize] * y.1[j as usize] > 0.0 {
                    valid |= 1 << (3 * j + i);
                }
            }
        }
        let corner = UVec2::new(x.0 as u32, y.0 as u32);
        (corner, x.1.into(), y.1.into(), valid)
    }
    // Whether rounding may move a place to another texel or off the image.
    fn taps_open(motion: DVec2) -> bool {
        motion.to_array().iter().any(|m| {
            let part = m - m.floor();
            (part > 1.0 - 1.2e-7) || ((part - 0.5).abs() < 1.2e-7 && part != 0.5)
        })
    }
    // How far inside (above 0) or outside the limits a texel is, relative to
    // the rounding of the test.
    fn margin(
        (p, depth, n, _): WideSurface,
        curvature: f64,
        (q, found_depth, m, _): WideSurface,
        (plane, normal): (f64, f64),
    ) -> f64 {
        if found_depth <= 0.0 {
            return -1.0;
        }
        let to = q - p;
        let height = n.dot(to) + 0.5 * curvature * to.length_squared();
        let turned = m - (n + to * curvature);
        let size = to.length() * (1.0 + curvature.abs() * to.length());
        let by_plane = (plane * depth - height.abs()) / (plane * depth + size);
        let bent = 2.0 + to.length() * curvature.abs();
        let by_normal = (normal - turned.length()) / (normal + bent);
        by_plane.min(by_normal)
    }
    fn exact_matches(e: WideSurface, curvature: f64, f: WideSurface, t: (f64, f64)) -> u32 {
        u32::from(e.1 > 0.0 && e.3 == f.3 && margin(e, curvature, f, t) >= 0.0)
    }
    fn matches_open(e: WideSurface, curvature: f64, f: WideSurface, t: (f64, f64)) -> bool {
        e.1 > 0.0 && e.3 == f.3 && margin(e, curvature, f, t).abs() < 2e-6
    }
    fn wide_prior(at: UVec2) -> WideSurface {
        use crate::contract::Value;
        read_prior(at).widen()
    }
    // The tested taps, and whether a test is open.
    fn tested(
        (corner, across, down, mut valid): WideTaps,
        expected: WideSurface,
        curvature: f64,
        tolerance: (f64, f64),
    ) -> (WideTaps, bool) {
        let (mut sum, mut open) = (0.0, false);
        for i in (0..9).filter(|i| valid >> i & 1 == 1).collect::<Vec<u32>>() {
            let at = UVec2::new(corner.x.wrapping_add(i % 3), corner.y.wrapping_add(i / 3));
            let found = wide_prior(at);
            open |= matches_open(expected, curvature, found, tolerance);
            if exact_matches(expected, curvature, found, tolerance) == 1 {
                sum += across.to_array()[i as usize % 3] * down.to_array()[i as usize / 3];
            } else {
                valid &= !(1 << i);
            }
        }
        open |= (sum - 0.01).abs() < 1e-6;
        if sum < 0.01 {
            return ((UVec2::ZERO, DVec3::ZERO, DVec3::ZERO, 0), open);
        }
        ((corner, across, down, valid), open)
    }
    fn exact_find(
        pixel: UVec2,
        size: UVec2,
        motion: DVec2,
        expected: WideSurface,
        curvature: f64,
        tolerance: (f64, f64),
    ) -> (WideTaps, bool) {
        if expected.1 <= 0.0 {
            return ((UVec2::ZERO, DVec3::ZERO, DVec3::ZERO, 0), false);
        }
        let taps = |wide| exact_taps(pixel, size, motion, wide);
        let (near, near_open) = tested(taps(false), expected, curvature, tolerance);
        if near.3 != 0 {
            return (near, near_open);
        }
        let (far, far_open) = tested(taps(true), expected, curvature, tolerance);
        (far, near_open || far_open)
    }
    // The history, and which part of the footprint it is.
    fn gathered((corner, across, down, valid): WideTaps) -> (WideHistory, f64) {
        let (mut sum, mut weights, mut rates) = (DVec3::ZERO, 0.0, 0.0);
        for i in (0..9).filter(|i| valid >> i & 1 == 1) {
            let at = UVec2::new(corner.x.wrapping_add(i % 3), corner.y.wrapping_add(i / 3));
            let w = across.to_array()[i as usize % 3] * down.to_array()[i as usize / 3];
            let texel = read_history(at);
            if texel.length > 0.0 && w > 0.0 {
                sum += texel.value.as_dvec3() * w;
                weights += w;
                rates += w / f64::from(texel.length);
            }
        }
        if weights < 0.01 {
            ((DVec3::ZERO, 0.0), weights)
        } else {
            ((sum / weights, weights / rates), weights)
        }
    }
    fn exact_gather(taps: WideTaps) -> WideHistory {
        gathered(taps).0
    }
    fn gather_open(taps: WideTaps) -> bool {
        (gathered(taps).1 - 0.01).abs() < 1e-6
    }
    // The nearer neighbour on an axis, as a step in its positive direction.
    fn exact_step(pixel: UVec2, size: UVec2, direction: UVec2) -> (DVec3, DVec3) {
        let centre = read_surface(pixel);
        let mut best: Option<(DVec3, DVec3)> = None;
        for sign in [1.0, -1.0] {
            let at = pixel.as_dvec2() + direction.as_dvec2() * sign;
            if at.min_element() < 0.0 || at.cmpge(size.as_dvec2()).any() {
                continue;
            }
            let other = read_surface(at.as_uvec2());
            if other.depth <= 0.0 || other.mesh != centre.mesh {
                continue;
            }
            let along = (other.position.as_dvec3() - centre.position.as_dvec3()) * sign;
            let turn = (other.normal.as_dvec3() - centre.normal.as_dvec3()) * sign;
            if best.is_none_or(|b| along.length_squared() < b.0.length_squared()) {
                best = Some((along, turn));
            }
        }
        best.unwrap_or((DVec3::ZERO, DVec3::ZERO))
    }
    fn exact_bend(pixel: UVec2, size: UVec2, parallax: DVec2) -> (DVec3, DVec3) {
        let outside = pixel.cmpge(size).any();
        if outside || parallax == DVec2::ZERO || read_surface(pixel).depth <= 0.0 {
            return (DVec3::ZERO, DVec3::ZERO);
        }
        let (x, y) = (
            exact_step(pixel, size, UVec2::X),
            exact_step(pixel, size, UVec2::Y),
        );
        let any = parallax.x.abs() + parallax.y.abs();
        match (x.0 == DVec3::ZERO, y.0 == DVec3::ZERO) {
            (false, false) => (
                x.0 * parallax.x + y.0 * parallax.y,
                x.1 * parallax.x + y.1 * parallax.y,
            ),
            (false, true) => (x.0 * any, x.1 * any),
            (true, _) => (y.0 * any, y.1 * any),
        }
    }
    struct Reflection {
        motion: DVec2,
        scale: f64,
        open: bool,
    }
    fn exact_reflection(
        pixel: UVec2,
        size: UVec2,
        distance: f64,
        now: WideCamera,
        then: WideCamera,
    ) -> Reflection {
        let nowhere = Reflection {
            motion: DVec2::splat(16_777_216.0),
            scale: 1.0,
            open: false,
        };
        if pixel.cmpge(size).any() || read_surface(pixel).depth <= 0.0 {
            return nowhere;
        }
        let mirror = read_surface(pixel);
        let p = mirror.position.as_dvec3();
        let n = mirror.normal.as_dvec3();
        let moved = (then.0, now.1, now.2, now.3, now.4);
        let (parallax, parallax_scale) = exact_motion(p, p, now, moved);
        let view = (p - now.0).normalize();
        // The image's distance, and what an ULP of all that it depends on, but
        // for the parallax, moves it by.
        let at = |parallax: DVec2| {
            let (along, turn) = exact_bend(pixel, size, parallax);
            let power = exact_power(view, n, along, turn);
            let seen = view.cross(along).length().max(1e-30);
            let bent = 2.0 * turn.length() * along.length() / (seen * seen);
            let power_scale = bent * (1.0 + along.length() / seen);
            let image = exact_image(distance, power);
            let shift = image * image * power_scale + image_scale(distance, power);
            (image, shift, power)
        };
        let (image, shift, power) = at(parallax);
        let motion_at = |image: f64| {
            let point = p + view * image;
            exact_motion(point, point, now, then)
        };
        let (motion, scale) = motion_at(image);
        if now == then {
            return Reflection {
                motion,
                scale: 1.0,
                open: false,
            };
        }
        let step = 1e-4 * image.abs().max(1e-4);
        let slope = (motion_at(image + step).0 - motion).length() / step;
        // The parallax gives the direction in which the curvature counts.
        let h = 1e-3 * parallax.length();
        let turned = [DVec2::X, DVec2::Y].map(|d| (at(parallax + d * h).0 - image).abs() / h);
        let focus = 1.0 + distance * power;
        let point = p + view * image;
        Reflection {
            motion,
            scale: scale + slope * (shift + parallax_scale * (turned[0] + turned[1])),
            // Without parallax there is no direction, at the focus no image.
            open: parallax.length() < 0.02
                || focus.abs() < 0.02 * (1.0 + (distance * power).abs())
                || beside(point, now)
                || beside(point, then),
        }
    }
    const LUMA: DVec3 = DVec3::new(0.2126, 0.7152, 0.0722);
    fn exact_distance(color: DVec3, mean: DVec3, deviation: DVec3) -> f64 {
        let floor = color.dot(LUMA).max(mean.dot(LUMA)) / 32.0;
        let unit = deviation.max(DVec3::splat(floor));
        let one = |a: f64, b: f64, unit: f64| if a == b { 0.0 } else { (a - b).abs() / unit };
        LUMA.dot(DVec3::new(
            one(color.x, mean.x, unit.x),
            one(color.y, mean.y, unit.y),
            one(color.z, mean.z, unit.z),
        ))
    }

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
    let straight = build(Vec3::ZERO, -Vec3::Z, 0.5, 1920.0, 1080.0);
    let tilted = |n: Vec3, by: Vec3| (n.as_dvec3() + by.as_dvec3()).normalize().as_vec3();
    let cameras = domains::vec3(domains::range(-10.0, 10.0))
        .and(domains::unit_vector())
        .and(domains::log_range(0.1, 2.0))
        .and(domains::below(2048))
        .and(domains::log_range(0.5, 2.0))
        .map(move |((((origin, forward), tangent), w), aspect)| {
            let width = w as f32 + 256.0;
            build(origin, forward, tangent, width, (width / aspect).ceil())
        });
    // Points in view or up to an image beside it, some of them behind the eye.
    let seen = cameras
        .and(domains::range(-1.0, 2.0))
        .and(domains::range(-1.0, 2.0))
        .and(domains::signed_log_range(0.1, 1e3))
        .map(|(((camera, u), v), depth)| {
            let (x, y) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
            let depth = if depth == 0.0 { 1.0 } else { depth };
            let to = camera.right * x + camera.up * y + camera.forward;
            (camera.origin + to * depth, camera)
        });
    let moving = seen
        .clone()
        .and(domains::vec3(domains::range(-0.5, 0.5)))
        .and(domains::vec3(domains::range(-0.1, 0.1)))
        .and(domains::vec3(domains::range(-0.1, 0.1)))
        .map(move |((((point, camera), step), turn), moved)| {
            let prior = Camera {
                origin: camera.origin + step,
                right: camera.right + camera.forward * turn.x * camera.right.length(),
                up: camera.up + camera.forward * turn.y * camera.up.length(),
                forward: tilted(camera.forward, turn),
                ..camera
            };
            (point, point + moved, camera, prior)
        });
    let bends = domains::unit_vector()
        .and(domains::log_range(1e-3, 1.0))
        .and(domains::signed_log_range(1e-3, 10.0))
        .and(domains::vec3(domains::range(-0.01, 0.01)))
        .map(|(((direction, length), curvature), noise)| {
            let along = direction * length;
            (along, along * curvature + noise * length)
        });
    let mirrors = domains::unit_vector()
        .and(domains::unit_vector())
        .and(bends.clone())
        .map(|((view, normal), (along, turn))| (view, normal, along, turn));
    let component = || {
        domains::below(4)
            .and(domains::range(-20.0, 20.0))
            .and(domains::signed_log_range(1e-9, 10.0))
            .map(|((kind, wide), small)| match kind {
                0 => wide.round(),
                1 => wide.round() + 0.5,
                2 => wide,
                _ => small,
            })
    };
    let motions: Domain<(UVec2, UVec2, Vec2)> = domains::below(SIZE.x)
        .and(domains::below(SIZE.y))
        .and(component())
        .and(component())
        .map(|(((x, y), dx), dy)| (UVec2::new(x, y), SIZE, Vec2::new(dx, dy)));
    let weights = domains::vec3(domains::unit());
    let taps = domains::any_uvec2()
        .and(weights.clone())
        .and(weights)
        .and(domains::any_u32())
        .map(|(((corner, across), down), valid)| ReprojectTaps {
            corner,
            across,
            down,
            valid,
        });
    let inside = motions
        .clone()
        .and(domains::below(2))
        .and(domains::any_u32())
        .map(|(((pixel, size, motion), kind), mask)| {
            let taps = if kind == 1 {
                reproject_footprint_wide(pixel, size, motion / 4.0)
            } else {
                reproject_footprint(pixel, size, motion / 4.0)
            };
            (ReprojectTaps {
                valid: taps.valid & !(mask & mask >> 9),
                ..taps
            },)
        });
    let tolerance = || {
        domains::log_range(1e-3, 0.2)
            .and(domains::range(0.05, 1.0))
            .map(|(plane, normal)| ReprojectTolerance { plane, normal })
    };
    let pairs = domains::vec3(domains::range(-10.0, 10.0))
        .and(domains::log_range(0.1, 100.0))
        .and(domains::unit_vector())
        .and(domains::signed_log_range(1e-3, 2.0))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::vec3(domains::range(-0.3, 0.3)))
        .and(domains::below(4))
        .and(tolerance())
        .map(
            move |(((((((position, depth), normal), curvature), to), noise), mesh), tolerance)| {
                // A step over the surface, and some way off it.
                let flat = to - normal * normal.dot(to);
                let fall = -0.5 * curvature * flat.length_squared();
                let off = tolerance.plane * depth * noise.x * 5.0;
                let expected = ReprojectSurface {
                    position,
                    depth,
                    normal,
                    mesh: mesh / 3,
                };
                let found = ReprojectSurface {
                    position: position + flat + normal * (fall + off),
                    depth,
                    normal: tilted(normal, flat * curvature + noise * tolerance.normal),
                    mesh: mesh / 3 * (mesh & 1),
                };
                (expected, curvature, found, tolerance)
            },
        );
    let lookups = motions
        .clone()
        .and(domains::range(0.0, 1.0))
        .and(domains::vec3(domains::range(-0.1, 0.1)))
        .and(domains::range(-0.05, 0.05))
        .and(domains::log_range(0.02, 0.3))
        .and(domains::range(0.05, 0.5))
        .map(
            move |((((((pixel, size, motion), z), tilt), curvature), plane), normal)| {
                let motion = motion / 4.0;
                let at = pixel.as_vec2() + motion;
                let expected = ReprojectSurface {
                    position: at.extend(z),
                    depth: 4.0,
                    normal: tilted(Vec3::Z, tilt),
                    mesh: u32::from(at.x > 9.5),
                };
                let tolerance = ReprojectTolerance { plane, normal };
                (pixel, size, motion, expected, curvature, tolerance)
            },
        );
    let bend_inputs = domains::below(SIZE.x)
        .and(domains::below(SIZE.y))
        .and(domains::range(-20.0, 20.0))
        .and(domains::range(-20.0, 20.0))
        .map(|(((x, y), dx), dy)| (UVec2::new(x, y), SIZE, Vec2::new(dx, dy)));
    // Cameras that look at the mirrors from above.
    let reflections = domains::below(SIZE.x)
        .and(domains::below(SIZE.y))
        .and(domains::log_range(0.1, 100.0))
        .and(domains::vec3(domains::range(-2.0, 2.0)))
        .and(domains::vec3(domains::range(-0.2, 0.2)))
        .and(domains::vec3(domains::range(-0.05, 0.05)))
        .map(move |(((((x, y), distance), place), step), turn)| {
            let eye = place + Vec3::Z * 4.0;
            let now = build(eye, tilted(-Vec3::Z, turn * 2.0), 0.5, 640.0, 360.0);
            let then = build(eye + step, tilted(now.forward, turn), 0.5, 640.0, 360.0);
            (UVec2::new(x, y), SIZE, distance, now, then)
        });
    let shade = || {
        domains::log_range(1e-4, 1e4)
            .and(domains::below(16))
            .map(|(c, k)| if k == 1 { 0.0 } else { c })
    };
    let colors = shade()
        .and(domains::vec3(domains::range(0.0, 1.0)))
        .and(domains::vec3(domains::range(0.0, 1.0)))
        .and(domains::vec3(shade()))
        .and(domains::below(3))
        .map(|((((level, color), mean), deviation), kind)| {
            let near = mean + (color - mean) * 0.02;
            match kind {
                0 => (color * level, mean * level, deviation),
                1 => (near * level, mean * level, Vec3::ZERO),
                _ => (near * level, mean * level, color * (0.02 * level)),
            }
        });
    let history = || {
        domains::vec3(shade())
            .and(domains::log_range(0.5, 1000.0))
            .and(domains::below(16))
            .map(|((value, length), kind)| ReprojectHistory {
                value,
                length: if kind == 1 { 0.0 } else { length },
            })
    };
    let of = |value: f32, length: f32| ReprojectHistory {
        value: Vec3::splat(value),
        length,
    };
    let surface = |x: f32, y: f32, z: f32| ReprojectSurface {
        position: Vec3::new(x, y, z),
        depth: 4.0,
        normal: Vec3::Z,
        mesh: 0,
    };
    let still_place = surface(3.0, 4.0, 0.5);
    let loose = ReprojectTolerance {
        plane: 0.3,
        normal: 0.5,
    };
    let tight = ReprojectTolerance {
        plane: 1e-6,
        normal: 0.5,
    };
    let looks = build(Vec3::new(0.5, 0.25, 4.0), -Vec3::Z, 0.5, 640.0, 360.0);
    let steps_aside = Camera {
        origin: Vec3::new(0.625, 0.25, 4.0),
        ..looks
    };
    // A pixel of the bowl that has a surface, and a hole.
    let find_pixel = |wanted: &dyn Fn(&ReprojectSurface) -> bool| {
        (0..SIZE.x * SIZE.y)
            .map(|i| UVec2::new(i % SIZE.x, i / SIZE.x))
            .find(|at| wanted(&read_surface(*at)))
            .expect("the image has such a pixel")
    };
    let hole = find_pixel(&|s| s.depth <= 0.0);
    let dome = find_pixel(&|s| s.depth > 0.0 && s.mesh == 0);
    let last = SIZE - UVec2::ONE;
    let some_taps = reproject_footprint(UVec2::new(5, 5), SIZE, Vec2::new(0.25, -0.5));

    vec![
        Kernel::new(
            MODULE,
            "reproject_project",
            ["point", "camera"],
            reproject_project,
            |point: DVec3, camera: WideCamera| exact_project(point, camera).0,
            seen,
        )
        .scale_by(|point: DVec3, camera: WideCamera| {
            let (image, scale) = exact_project(point, camera);
            // The depth is a length, the place in pixels.
            scale.max(image.z.abs() + (point - camera.0).length())
        })
        .few_ulp(2.5, 6.5)
        .hard([
            (Vec3::new(0.0, 0.0, -5.0), straight),
            (Vec3::new(0.0, 0.0, 5.0), straight),
            (Vec3::new(0.3, -0.2, -1e6), straight),
            (Vec3::new(1e-3, 0.0, -1e-3), straight),
        ])
        .fixture(FIXTURE, vec![0])
        .source(PINHOLE)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_motion",
            ["point", "prior_point", "camera", "prior_camera"],
            reproject_motion,
            |p: DVec3, q: DVec3, now: WideCamera, then: WideCamera| exact_motion(p, q, now, then).0,
            moving,
        )
        .scale_by(|p: DVec3, q: DVec3, now: WideCamera, then: WideCamera| {
            exact_motion(p, q, now, then).1
        })
        .undecided(|p: DVec3, q: DVec3, now: WideCamera, then: WideCamera| {
            beside(p, now) || beside(q, then)
        })
        .few_ulp(2.25, 6.25)
        .hard([
            // Nothing moves: exactly 0.
            (
                Vec3::new(0.3, 0.1, -5.0),
                Vec3::new(0.3, 0.1, -5.0),
                straight,
                straight,
            ),
            (
                Vec3::new(0.3, 0.1, -1e6),
                Vec3::new(0.3, 0.1, -1e6),
                straight,
                straight,
            ),
            // Behind one of the cameras.
            (
                Vec3::new(0.0, 0.0, -5.0),
                Vec3::new(0.0, 0.0, 5.0),
                straight,
                straight,
            ),
            (
                Vec3::new(0.0, 0.0, 5.0),
                Vec3::new(0.1, 0.0, 5.0),
                straight,
                straight,
            ),
            (
                Vec3::new(0.0, 0.0, -5.0),
                Vec3::new(1e-6, 0.0, -5.0),
                straight,
                straight,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(PINHOLE)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_curvature",
            ["along", "turn"],
            reproject_curvature,
            |along: DVec3, turn: DVec3| {
                if along == DVec3::ZERO {
                    return 0.0;
                }
                turn.dot(along.normalize()) / along.length()
            },
            bends,
        )
        .scale_by(|along: DVec3, turn: DVec3| {
            if along == DVec3::ZERO {
                1.0
            } else {
                turn.length() / along.length()
            }
        })
        .few_ulp(4.75, 11.5)
        .hard([
            (Vec3::ZERO, Vec3::X),
            (Vec3::X, Vec3::ZERO),
            (Vec3::X, Vec3::Y),
            (Vec3::splat(1e-12), Vec3::splat(1e-12)),
        ])
        .fixture(FIXTURE, vec![0])
        .source("second fundamental form over the first")
        .build(),
        Kernel::new(
            MODULE,
            "reproject_power",
            ["view", "normal", "along", "turn"],
            reproject_power,
            exact_power,
            mirrors,
        )
        // Cosine, product and the step that is seen: each may cancel.
        .scale_by(|view: DVec3, _: DVec3, along: DVec3, turn: DVec3| {
            let seen = view.cross(along).length();
            if seen == 0.0 {
                return 1.0;
            }
            2.0 * turn.length() * along.length() / (seen * seen) * (1.0 + along.length() / seen)
        })
        .undecided(|view: DVec3, _: DVec3, along: DVec3, _: DVec3| {
            let seen = view.cross(along).length();
            seen < 1e-3 * along.length()
        })
        .few_ulp(3.5, 7.25)
        .hard([
            (-Vec3::Z, Vec3::Z, Vec3::X, Vec3::X),
            (-Vec3::Z, Vec3::Z, Vec3::X, Vec3::ZERO),
            (-Vec3::Z, Vec3::Z, Vec3::ZERO, Vec3::ZERO),
            (Vec3::Z, Vec3::Z, Vec3::X, Vec3::X),
            (-Vec3::Z, Vec3::X, Vec3::X, Vec3::X),
        ])
        .fixture(FIXTURE, vec![0])
        .source(FRONT)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_image_distance",
            ["distance", "power"],
            reproject_image_distance,
            exact_image,
            (
                domains::log_range(1e-3, 1e4),
                domains::signed_log_range(1e-3, 1e2),
            ),
        )
        .scale_by(image_scale)
        .undecided(at_focus)
        .few_ulp(2.25, 4.75)
        .hard([
            (0.0, 1.0),
            (3.0, 0.0),
            (1e18, 0.0),
            (1e18, 2.0),
            (1.0, -0.5),
            (1.0, -2.0),
            (2.0, -0.4921875),
        ])
        .fixture(FIXTURE, vec![0])
        .source("thin mirror, 1/image = 1/distance + power")
        .build(),
        Kernel::new(
            MODULE,
            "reproject_virtual_point",
            ["eye", "position", "distance", "power"],
            reproject_virtual_point,
            |eye: DVec3, position: DVec3, distance: f64, power: f64| {
                position + (position - eye).normalize() * exact_image(distance, power)
            },
            domains::vec3(domains::range(-10.0, 10.0))
                .and(domains::unit_vector())
                .and(domains::log_range(0.1, 100.0))
                .and(domains::log_range(1e-3, 1e3))
                .and(domains::signed_log_range(1e-3, 10.0))
                .map(|((((eye, toward), depth), distance), power)| {
                    (eye, eye + toward * depth, distance, power)
                }),
        )
        .scale_by(|_: DVec3, position: DVec3, distance: f64, power: f64| {
            position.abs().max_element() + image_scale(distance, power)
        })
        .undecided(|_: DVec3, _: DVec3, distance: f64, power: f64| at_focus(distance, power))
        .few_ulp(3.5, 16.0)
        .hard([
            (Vec3::ZERO, -Vec3::Z, 0.0, 0.0),
            (Vec3::ZERO, Vec3::new(0.0, 0.0, -4.0), 1e18, 0.0),
            (Vec3::ZERO, Vec3::new(0.0, 0.0, -4.0), 2.0, -1.0),
            (Vec3::ZERO, Vec3::new(0.0, 0.0, -4.0), 2.0, 1.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(FRONT)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_footprint",
            ["pixel", "size", "motion"],
            reproject_footprint,
            |pixel: UVec2, size: UVec2, motion: DVec2| exact_taps(pixel, size, motion, false),
            motions.clone(),
        )
        .scale(1.0)
        .undecided(|_: UVec2, _: UVec2, motion: DVec2| taps_open(motion))
        .few_ulp(0.5, 0.75)
        .hard([
            (UVec2::ZERO, SIZE, Vec2::ZERO),
            (UVec2::ZERO, SIZE, Vec2::splat(-0.0)),
            (UVec2::ZERO, SIZE, Vec2::splat(-0.5)),
            (UVec2::ZERO, SIZE, Vec2::new(-0.75, 0.0)),
            (UVec2::ZERO, SIZE, Vec2::splat(-0.25)),
            (last, SIZE, Vec2::splat(0.5)),
            (last, SIZE, Vec2::splat(0.75)),
            (last, SIZE, Vec2::splat(0.25)),
            (last, SIZE, Vec2::new(-1.0, 1.0)),
            (UVec2::ZERO, UVec2::ONE, Vec2::splat(-0.5)),
            (UVec2::ZERO, SIZE, Vec2::splat(4_194_304.0)),
            (UVec2::ZERO, SIZE, Vec2::splat(REPROJECT_NOWHERE)),
            (UVec2::new(7, 7), SIZE, Vec2::new(-4e6, 4e6)),
            (
                UVec2::splat(1 << 20),
                UVec2::splat(1 << 21),
                Vec2::new(0.125, -0.375),
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_footprint_wide",
            ["pixel", "size", "motion"],
            reproject_footprint_wide,
            |pixel: UVec2, size: UVec2, motion: DVec2| exact_taps(pixel, size, motion, true),
            motions,
        )
        .scale(1.0)
        .undecided(|_: UVec2, _: UVec2, motion: DVec2| taps_open(motion))
        .few_ulp(0.5, 0.75)
        .hard([
            (UVec2::ZERO, SIZE, Vec2::ZERO),
            (UVec2::ZERO, SIZE, Vec2::splat(-0.5)),
            (UVec2::ZERO, SIZE, Vec2::new(-0.75, 0.0)),
            (last, SIZE, Vec2::splat(0.5)),
            (last, SIZE, Vec2::splat(0.75)),
            (UVec2::ZERO, UVec2::ONE, Vec2::splat(0.5)),
            (UVec2::ZERO, SIZE, Vec2::splat(REPROJECT_NOWHERE)),
        ])
        .fixture(FIXTURE, vec![0])
        .source("quadratic B-spline; 3 x 3 as in Schied et al. 2017")
        .build(),
        Kernel::new(
            MODULE,
            "reproject_tap",
            ["taps", "index"],
            reproject_tap,
            |(corner, across, down, valid): WideTaps, index: u32| {
                if index > 8 || valid >> index & 1 == 0 {
                    return (UVec2::ZERO, 0.0);
                }
                let (i, j) = (index % 3, index / 3);
                (
                    UVec2::new(corner.x.wrapping_add(i), corner.y.wrapping_add(j)),
                    across.to_array()[i as usize] * down.to_array()[j as usize],
                )
            },
            (taps, domains::below(12)),
        )
        .few_ulp(0.75, 1.25)
        .hard([
            (REPROJECT_NO_TAPS, 0),
            (some_taps, 0),
            (some_taps, 8),
            (some_taps, 9),
            (some_taps, 0xffff_ffff),
        ])
        .fixture(FIXTURE, vec![0])
        .source("product of the axes' weights")
        .build(),
        Kernel::new(
            MODULE,
            "reproject_matches",
            ["expected", "curvature", "found", "tolerance"],
            reproject_matches,
            exact_matches,
            pairs,
        )
        .undecided(matches_open)
        .few_ulp(0.0, 0.0)
        .hard([
            (still_place, 0.0, still_place, REPROJECT_TOLERANCE),
            (
                still_place,
                0.0,
                surface(1e3, 1e3, 0.5),
                REPROJECT_TOLERANCE,
            ),
            (
                still_place,
                0.0,
                surface(3.0, 4.0, 1.5),
                REPROJECT_TOLERANCE,
            ),
            // From behind: the cosine's square would be 1.
            (
                still_place,
                0.0,
                ReprojectSurface {
                    normal: -Vec3::Z,
                    ..still_place
                },
                REPROJECT_TOLERANCE,
            ),
            (
                still_place,
                0.0,
                ReprojectSurface {
                    depth: 0.0,
                    ..still_place
                },
                REPROJECT_TOLERANCE,
            ),
            (
                ReprojectSurface {
                    depth: 0.0,
                    ..still_place
                },
                0.0,
                still_place,
                REPROJECT_TOLERANCE,
            ),
            (
                still_place,
                0.0,
                ReprojectSurface {
                    mesh: 1,
                    ..still_place
                },
                REPROJECT_TOLERANCE,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_find",
            [
                "pixel",
                "size",
                "motion",
                "expected",
                "curvature",
                "tolerance",
            ],
            find,
            |p: UVec2, s: UVec2, m: DVec2, e: WideSurface, k: f64, t: (f64, f64)| {
                exact_find(p, s, m, e, k, t).0
            },
            lookups.clone(),
        )
        .scale(1.0)
        .undecided(
            |p: UVec2, s: UVec2, m: DVec2, e: WideSurface, k: f64, t: (f64, f64)| {
                taps_open(m) || exact_find(p, s, m, e, k, t).1
            },
        )
        .few_ulp(0.5, 0.75)
        .hard([
            (UVec2::new(3, 4), SIZE, Vec2::ZERO, still_place, 0.0, loose),
            (UVec2::new(3, 4), SIZE, Vec2::ZERO, still_place, 0.0, tight),
            (
                UVec2::ZERO,
                SIZE,
                Vec2::splat(-0.25),
                surface(0.0, 0.0, 0.5),
                0.0,
                loose,
            ),
            (
                UVec2::ZERO,
                SIZE,
                Vec2::splat(-2.0),
                surface(0.0, 0.0, 0.5),
                0.0,
                loose,
            ),
            (
                last,
                SIZE,
                Vec2::splat(REPROJECT_NOWHERE),
                still_place,
                0.0,
                loose,
            ),
            (
                UVec2::new(3, 4),
                SIZE,
                Vec2::splat(0.5),
                ReprojectSurface {
                    depth: 0.0,
                    ..still_place
                },
                0.0,
                loose,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_gather",
            ["taps"],
            gather,
            exact_gather,
            inside,
        )
        .undecided(gather_open)
        .few_ulp(6.25, 18.5)
        .hard([
            (REPROJECT_NO_TAPS,),
            (some_taps,),
            (reproject_footprint(UVec2::new(5, 5), SIZE, Vec2::ZERO),),
            (reproject_footprint(UVec2::ZERO, SIZE, Vec2::splat(-0.25)),),
            (reproject_footprint(last, SIZE, Vec2::splat(0.25)),),
            (reproject_footprint_wide(last, SIZE, Vec2::splat(0.25)),),
        ])
        .fixture(FIXTURE, vec![0])
        .source("renormalised weights; harmonic mean of lengths, our form")
        .build(),
        Kernel::new(
            MODULE,
            "reproject_pixel",
            [
                "pixel",
                "size",
                "motion",
                "expected",
                "curvature",
                "tolerance",
            ],
            whole_pixel,
            |p: UVec2, s: UVec2, m: DVec2, e: WideSurface, k: f64, t: (f64, f64)| {
                exact_gather(exact_find(p, s, m, e, k, t).0)
            },
            lookups,
        )
        // A weight errs by an ULP of 1, so what is left of a footprint counts:
        // of a hundredth of it the error is a hundredfold. Lengths are up to 15
        // here, values below 1.
        .scale_by(
            |p: UVec2, s: UVec2, m: DVec2, e: WideSurface, k: f64, t: (f64, f64)| {
                15.0 / gathered(exact_find(p, s, m, e, k, t).0).1.max(0.01)
            },
        )
        .undecided(
            |p: UVec2, s: UVec2, m: DVec2, e: WideSurface, k: f64, t: (f64, f64)| {
                let (taps, open) = exact_find(p, s, m, e, k, t);
                taps_open(m) || open || gather_open(taps)
            },
        )
        .few_ulp(7.0, 26.0)
        .hard([
            // Almost all of the weight is one long history's: the worst of
            // many.
            (
                UVec2::new(3, 1),
                SIZE,
                Vec2::new(-3.2794321e-6, 4.2912147e-6),
                ReprojectSurface {
                    position: Vec3::new(2.9999967, 1.0000043, 5.28984e-1),
                    depth: 4.0,
                    normal: Vec3::new(2.4987781e-2, 1.4853169e-2, 9.995774e-1),
                    mesh: 0,
                },
                2.749946e-2,
                ReprojectTolerance {
                    plane: 1.3891675e-1,
                    normal: 4.3064326e-1,
                },
            ),
            (UVec2::new(3, 4), SIZE, Vec2::ZERO, still_place, 0.0, loose),
            (UVec2::new(3, 4), SIZE, Vec2::ZERO, still_place, 0.0, tight),
            (
                UVec2::ZERO,
                SIZE,
                Vec2::splat(-0.25),
                surface(0.0, 0.0, 0.5),
                0.0,
                loose,
            ),
            (
                UVec2::ZERO,
                SIZE,
                Vec2::splat(-2.0),
                surface(0.0, 0.0, 0.5),
                0.0,
                loose,
            ),
            (
                last,
                SIZE,
                Vec2::splat(REPROJECT_NOWHERE),
                still_place,
                0.0,
                loose,
            ),
        ])
        .fixture(FIXTURE, vec![0])
        .source(SVGF)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_bend",
            ["pixel", "size", "parallax"],
            bend,
            exact_bend,
            bend_inputs,
        )
        // Sums of two terms: absolute, in units of the parallax.
        .scale_by(|_: UVec2, _: UVec2, parallax: DVec2| parallax.length().max(1e-30))
        .few_ulp(0.5, 0.5)
        .hard([
            (dome, SIZE, Vec2::ZERO),
            (dome, SIZE, Vec2::X),
            (hole, SIZE, Vec2::X),
            (UVec2::ZERO, SIZE, Vec2::ONE),
            (last, SIZE, Vec2::ONE),
            (UVec2::new(2, 2), UVec2::ZERO, Vec2::ONE),
            (UVec2::ZERO, UVec2::ONE, Vec2::ONE),
            (UVec2::splat(0xffff_ffff), SIZE, Vec2::ONE),
        ])
        .fixture(FIXTURE, vec![0])
        .source("differences to the nearer neighbours; our form")
        .build(),
        Kernel::new(
            MODULE,
            "reproject_reflection_motion",
            ["pixel", "size", "distance", "camera", "prior_camera"],
            reflection_motion,
            |p: UVec2, s: UVec2, d: f64, now: WideCamera, then: WideCamera| {
                exact_reflection(p, s, d, now, then).motion
            },
            reflections,
        )
        .scale_by(
            |p: UVec2, s: UVec2, d: f64, now: WideCamera, then: WideCamera| {
                exact_reflection(p, s, d, now, then).scale
            },
        )
        .undecided(
            |p: UVec2, s: UVec2, d: f64, now: WideCamera, then: WideCamera| {
                exact_reflection(p, s, d, now, then).open
            },
        )
        .by_analysis(
            "the sum of the derived bounds of its parts (bend, power, image's distance, virtual \
             point, motion), each in its own part of the scale; plain intervals take what the \
             parts share, the mirror's place and the camera, as different each time",
        )
        .few_ulp(1.5, 33.0)
        .hard([
            (dome, SIZE, 2.0, looks, looks),
            (dome, SIZE, 2.0, looks, steps_aside),
            (hole, SIZE, 2.0, looks, steps_aside),
            (UVec2::splat(0xffff_ffff), SIZE, 2.0, looks, steps_aside),
            (dome, SIZE, 1e6, looks, steps_aside),
        ])
        .fixture(FIXTURE, vec![0])
        .source(FRONT)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_color_distance",
            ["color", "mean", "deviation"],
            reproject_color_distance,
            exact_distance,
            colors.clone(),
        )
        .few_ulp(5.0, 11.5)
        .hard([
            (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO),
            (Vec3::ONE, Vec3::ONE, Vec3::ZERO),
            (Vec3::ZERO, Vec3::ONE, Vec3::ZERO),
            (Vec3::ONE, Vec3::ZERO, Vec3::ZERO),
            (Vec3::splat(1e8), Vec3::splat(1e-8), Vec3::ZERO),
            (Vec3::Z, Vec3::X, Vec3::ZERO),
            (Vec3::ONE, Vec3::splat(0.99999994), Vec3::ZERO),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_color_weight",
            ["color", "mean", "deviation"],
            reproject_color_weight,
            |color: DVec3, mean: DVec3, deviation: DVec3| {
                (-10.0 * exact_distance(color, mean, deviation)).exp2()
            },
            colors,
        )
        .scale(1.0)
        .few_ulp(1.0, 3.25)
        .hard([
            (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO),
            (Vec3::ONE, Vec3::ONE, Vec3::ZERO),
            // Darker than the mean, and brighter.
            (Vec3::splat(0.5), Vec3::ONE, Vec3::ONE),
            (Vec3::splat(1.5), Vec3::ONE, Vec3::ONE),
            (Vec3::ONE, Vec3::ZERO, Vec3::ZERO),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .baseline(
            "as printed: no absolute value, no floor (0/0 left out), built-in exp2",
            "fn baseline(color: vec3f, mean: vec3f, deviation: vec3f) -> f32 {
                if any(deviation <= vec3f(0.0)) {
                    return 1.0;
                }
                let d = (color - mean) / deviation;
                return min(exp2(min(-10.0 * dot(d, vec3f(0.2126, 0.7152, 0.0722)), 100.0)), 1e30);
            }",
            |color: Vec3, mean: Vec3, deviation: Vec3| {
                if deviation.min_element() <= 0.0 {
                    return 1.0;
                }
                let d = (color - mean) / deviation;
                let power = -10.0 * d.dot(Vec3::new(0.2126, 0.7152, 0.0722));
                power.min(100.0).exp2().min(1e30)
            },
        )
        .build(),
        Kernel::new(
            MODULE,
            "reproject_share",
            ["first", "second"],
            reproject_share,
            |first: f64, second: f64| 1.0 / (1.0 + (10.0 * (second - first)).exp2()),
            (
                domains::log_range(1e-4, 96.0),
                domains::log_range(1e-4, 96.0),
            ),
        )
        .scale(1.0)
        .few_ulp(1.0, 2.5)
        .hard([
            (0.0, 0.0),
            (96.0, 96.0),
            (0.0, 96.0),
            (96.0, 0.0),
            (1.0, 1.0000001),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
        Kernel::new(
            MODULE,
            "reproject_blend",
            ["first", "second", "share"],
            reproject_blend::<Vec3>,
            |first: WideHistory, second: WideHistory, share: f64| {
                if second.1 <= 0.0 {
                    first
                } else if first.1 <= 0.0 {
                    second
                } else {
                    let rate = (1.0 - share) / first.1 + share / second.1;
                    (first.0 * (1.0 - share) + second.0 * share, 1.0 / rate)
                }
            },
            (history(), history(), domains::range(0.0, 1.0)),
        )
        .few_ulp(3.5, 10.5)
        .hard([
            (of(0.1, 7.0), of(0.1, 7.0), 0.3),
            (of(1.0, 0.0), of(2.0, 5.0), 0.3),
            (of(1.0, 4.0), of(2.0, 0.0), 0.3),
            (of(1.0, 0.0), of(2.0, 0.0), 0.3),
            (of(1.0, 1.0), of(1e8, 1e6), 1.0),
            (of(1.0, 1.0), of(1e8, 1e6), 0.0),
        ])
        .fixture(FIXTURE, vec![0])
        .source(CHAPTER)
        .build(),
    ]
}
