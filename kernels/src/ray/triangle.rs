//! Ray against triangle: the pair and its contract.

pub use raytwin_cpu::ray::triangle::*;

/// The WGSL twin, without what it requires.
pub const WGSL: &str = raytwin_wgsl::ray::TRIANGLE;

#[cfg(feature = "contract")]
crate::value_struct!(TriangleHit {
    hit: u32,
    t: f32,
    u: f32,
    v: f32,
});

/// The exact intersection of the line: `t`, the three barycentric weights, and
/// the sine-like size of the determinant that says how well it is defined.
#[cfg(feature = "contract")]
pub(crate) fn exact_line(
    origin: glam::DVec3,
    direction: glam::DVec3,
    a: glam::DVec3,
    b: glam::DVec3,
    c: glam::DVec3,
) -> Option<(f64, [f64; 3], f64)> {
    let normal = (b - a).cross(c - a);
    let facing = normal.dot(direction);
    if facing == 0.0 {
        return None;
    }
    let t = normal.dot(a - origin) / facing;
    let p = origin + direction * t;
    // Areas of the three parts, signed along the normal.
    let part = |x: glam::DVec3, y: glam::DVec3| (x - p).cross(y - p).dot(normal);
    let whole = normal.length_squared();
    let weights = [part(b, c) / whole, part(c, a) / whole, part(a, b) / whole];
    let longest = (b - a).length().max((c - b).length()).max((a - c).length());
    let shape = facing.abs() / (longest * longest * direction.length());
    Some((t, weights, shape))
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ray::{Ray, RayShear, WideRay, ray_shear};
    use crate::contract::{Domain, Kernel, domains};
    use glam::{DVec2, DVec3, Vec3};

    const WATERTIGHT: &str = "Woop, Benthin and Wald 2013, JCGT 2(1); edges in one canonical order";
    // The weights move the plane's point within the plane, so their errors do
    // not reach t; plain intervals, which forget that the normal is upright on
    // both edges, count them once more.
    const WEIGHTS: &[(&str, &str)] = &[
        ("triangle_intersect_sheared", "u"),
        ("triangle_intersect_sheared", "v"),
    ];
    const AFFINE: &str = "t is affine in u and v, all else fixed";
    type WideShear = (DVec3, DVec3, DVec3, DVec2, u32, u32, f64);

    fn sheared(shear: RayShear, t_min: f32, t_max: f32, a: Vec3, b: Vec3, c: Vec3) -> TriangleHit {
        triangle_intersect_sheared(&shear, t_min, t_max, a, b, c)
    }
    fn truth((o, d, t_min, t_max): WideRay, a: DVec3, b: DVec3, c: DVec3) -> (u32, f64, f64, f64) {
        match exact_line(o, d, a, b, c) {
            Some((t, w, _)) if w.iter().all(|w| *w >= 0.0) && t >= t_min && t <= t_max => {
                (1, t, w[1], w[2])
            }
            _ => (0, 0.0, 0.0, 0.0),
        }
    }
    // Errors are those of positions as seen from the ray's origin, over the
    // size and tilt of the triangle; the weights have size one, t is in units
    // of the direction.
    fn condition((o, d, _, _): WideRay, a: DVec3, b: DVec3, c: DVec3) -> f64 {
        let size = (b - a).length().max((c - a).length()).max((c - b).length());
        let (t, shape) = match exact_line(o, d, a, b, c) {
            Some((t, _, shape)) => (t, shape.max(1e-9)),
            None => (0.0, 1e-9),
        };
        let vertices = [a, b, c].map(|v| (v - o).length());
        let far = vertices
            .iter()
            .copied()
            .fold(t.abs() * d.length(), f64::max);
        far / shape / size.min(d.length())
    }
    // On an edge, at an end of the range, or seen too flat.
    fn undecided(ray: WideRay, a: DVec3, b: DVec3, c: DVec3) -> bool {
        let Some((t, w, shape)) = exact_line(ray.0, ray.1, a, b, c) else {
            return true;
        };
        let close = 1e-5 * condition(ray, a, b, c);
        shape < 0.02
            || w.iter().any(|w| w.abs() < close)
            || (t - ray.2).abs() < close
            || (t - ray.3).abs() < close
    }

    // A triangle, a point around it, and a ray from a few lengths away.
    let case: Domain<(Ray, Vec3, Vec3, Vec3)> = domains::vec3(domains::range(-1.0, 1.0))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::unit_vector())
        .and(domains::log_range(0.3, 10.0))
        .and(domains::log_range(0.1, 10.0))
        .and(domains::unit_pair())
        .map(|((((((a, b), c), toward), distance), length), u)| {
            let target = a + (b - a) * (1.2 * u.x - 0.1) + (c - a) * (1.2 * u.y - 0.1);
            let ray = Ray {
                origin: target - toward * distance,
                direction: toward * length,
                t_min: 0.0,
                t_max: 1e4,
            };
            (ray, a, b, c)
        });
    let down = |x: f32, y: f32| Ray {
        origin: Vec3::new(x, y, 2.0),
        direction: -Vec3::Z,
        t_min: 0.0,
        t_max: 100.0,
    };
    let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
    let hard = [
        (down(0.25, 0.25), a, b, c),
        (down(0.25, 0.25), a, c, b),
        (down(0.75, 0.75), a, b, c),
        (down(-0.25, 0.25), a, b, c),
        // Far and small, far and large, a zero-area triangle.
        (down(0.3, 0.3), a * 1e-3, b * 1e3, c * 1e3),
        (down(0.25, 0.25), a, a, a),
        (down(0.25, 0.25), a, b, b),
        (
            Ray {
                origin: Vec3::new(0.25, 0.25, 2e-10),
                direction: -Vec3::Z * 1e-10,
                t_min: 0.0,
                t_max: 100.0,
            },
            a,
            b,
            c,
        ),
        // In the triangle's plane.
        (
            Ray {
                origin: Vec3::new(-1.0, 0.25, 0.0),
                direction: Vec3::X,
                t_min: 0.0,
                t_max: 100.0,
            },
            a,
            b,
            c,
        ),
    ];
    let prepared =
        |(ray, a, b, c): (Ray, Vec3, Vec3, Vec3)| (ray_shear(ray), ray.t_min, ray.t_max, a, b, c);

    // One over the sine of the two shorter edges, times how much rounding the
    // differences of the vertices turns them.
    fn turned(a: DVec3, b: DVec3, c: DVec3) -> f64 {
        let edges = [b - a, c - b, a - c];
        let mut lengths = edges.map(DVec3::length);
        lengths.sort_by(f64::total_cmp);
        let area = (b - a).cross(c - a).length();
        let far = a.length().max(b.length()).max(c.length());
        let sine = (area / (lengths[0] * lengths[1])).max(1e-9);
        (1.0 + far / lengths[0].max(1e-30)) / sine
    }
    let corners: Domain<(Vec3, Vec3, Vec3)> = domains::vec3(domains::range(-1.0, 1.0))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::vec3(domains::range(-1.0, 1.0)))
        .and(domains::log_range(1e-9, 1e9))
        .map(|(((a, b), c), size)| (a * size, b * size, c * size));

    vec![
        Kernel::new(
            "ray/triangle",
            "triangle_normal",
            ["a", "b", "c"],
            triangle_normal,
            |a: DVec3, b: DVec3, c: DVec3| {
                let n = (b - a).cross(c - a);
                if n == DVec3::ZERO { n } else { n.normalize() }
            },
            corners,
        )
        .scale_by(turned)
        .few_ulp(1.75, 40.0)
        .hard([
            (a, b, c),
            (a, c, b),
            (a * 1e-20, b * 1e-20, c * 1e-20),
            (a, b * 5e11, c * 5e11),
            // Needles.
            (a, b, Vec3::new(0.5, 1e-5, 1e-5)),
            (a, b, Vec3::new(1.0, 1e-5, 0.0)),
            // No area.
            (a, a, a),
            (a, b, b),
            (a, b, b * 2.0),
        ])
        .source("cross product of the two shorter edges, as in t of triangle_intersect_watertight")
        .build(),
        Kernel::new(
            "ray/triangle",
            "triangle_intersect_moller_trumbore",
            ["ray", "a", "b", "c"],
            triangle_intersect_moller_trumbore,
            truth,
            case.clone(),
        )
        .scale_by(condition)
        .undecided(undecided)
        .few_ulp(2.75, 11.0)
        .hard(hard)
        .source("Moeller and Trumbore 1997, JGT 2(1)")
        .build(),
        Kernel::new(
            "ray/triangle",
            "triangle_intersect_sheared",
            ["shear", "t_min", "t_max", "a", "b", "c"],
            sheared,
            |(o, d, ..): WideShear, t_min: f64, t_max: f64, a: DVec3, b: DVec3, c: DVec3| {
                truth((o, d, t_min, t_max), a, b, c)
            },
            case.clone().map(prepared),
        )
        .scale_by(
            |(o, d, ..): WideShear, t_min: f64, t_max: f64, a: DVec3, b: DVec3, c: DVec3| {
                condition((o, d, t_min, t_max), a, b, c)
            },
        )
        .undecided(
            |(o, d, ..): WideShear, t_min: f64, t_max: f64, a: DVec3, b: DVec3, c: DVec3| {
                undecided((o, d, t_min, t_max), a, b, c)
            },
        )
        .few_ulp(2.75, 13.5)
        .by_ends(WEIGHTS, AFFINE)
        .hard(hard.map(prepared))
        .source(WATERTIGHT)
        .build(),
        Kernel::new(
            "ray/triangle",
            "triangle_intersect_watertight",
            ["ray", "a", "b", "c"],
            triangle_intersect_watertight,
            truth,
            case,
        )
        .scale_by(condition)
        .undecided(undecided)
        .few_ulp(2.75, 13.5)
        .by_ends(WEIGHTS, AFFINE)
        .hard(hard)
        .source(WATERTIGHT)
        .build(),
    ]
}
