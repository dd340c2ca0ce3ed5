//! Traversal of a bounding volume hierarchy: the pair and its contract.

pub use raytwin_cpu::ray::bvh::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::ray::BVH;

#[cfg(feature = "contract")]
crate::value_struct!(BvhHit {
    t: f32,
    u: f32,
    v: f32,
    primitive: u32,
});

/// What this contract shares with that of `ray/bvh_filter`: a mesh, its tree, and
/// the truth about a line through it.
#[cfg(feature = "contract")]
pub(super) mod parts {
    use super::super::bvh_build::{BuildQuality, Bvh};
    use super::super::ray::{Ray, WideRay};
    use super::super::triangle::exact_line;
    use crate::contract::{Domain, domains};
    use glam::Vec3;
    use std::sync::OnceLock;

    macro_rules! fixture {
        () => {
            "
fn bvh_read_node(index: u32) -> BvhNode {
    let at = 2u + 8u * index;
    return BvhNode(
        vec3f(raytwin_float(at), raytwin_float(at + 1u), raytwin_float(at + 2u)),
        raytwin_fixture[at + 3u],
        vec3f(raytwin_float(at + 4u), raytwin_float(at + 5u), raytwin_float(at + 6u)),
        raytwin_fixture[at + 7u],
    );
}
fn bvh_read_triangle(index: u32) -> BvhTriangle {
    let at = 2u + 8u * raytwin_fixture[1] + 12u * index;
    return BvhTriangle(
        vec3f(raytwin_float(at), raytwin_float(at + 1u), raytwin_float(at + 2u)),
        vec3f(raytwin_float(at + 4u), raytwin_float(at + 5u), raytwin_float(at + 6u)),
        vec3f(raytwin_float(at + 8u), raytwin_float(at + 9u), raytwin_float(at + 10u)),
        raytwin_fixture[at + 3u],
    );
}
fn raytwin_float(at: u32) -> f32 {
    return bitcast<f32>(raytwin_fixture[at]);
}
"
        };
    }
    pub(crate) use fixture;

    /// Tetrahedra of a turning grid: closed, disjoint, at all angles.
    fn mesh() -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let (mut positions, mut indices) = (Vec::new(), Vec::new());
        for i in 0..64u32 {
            let cell = Vec3::new((i % 4) as f32, (i / 4 % 4) as f32, (i / 16) as f32);
            let center = cell * 2.0 - 3.0;
            let turn = i as f32 / 64.0;
            let first = positions.len() as u32;
            for corner in 0..4 {
                let sc = crate::math::trig::sincos_turn(turn + corner as f32 / 3.0);
                let offset = if corner == 3 {
                    Vec3::Z * 0.9
                } else {
                    Vec3::new(sc.y, sc.x, -0.4) * 0.8
                };
                positions.push(center + offset);
            }
            for face in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
                indices.push(face.map(|k| first + k));
            }
        }
        (positions, indices)
    }
    static BVH: OnceLock<Bvh> = OnceLock::new();

    /// Its tree.
    pub fn bvh() -> &'static Bvh {
        BVH.get_or_init(|| {
            let (positions, indices) = mesh();
            Bvh::build(&positions, &indices, BuildQuality::Medium).expect("a plain mesh")
        })
    }

    pub struct Line {
        pub t: f64,
        pub weights: [f64; 3],
        pub shape: f64,
        /// Whether the triangle is seen from the front.
        pub front: bool,
        pub primitive: u32,
    }

    /// The line against every triangle.
    pub fn lines((o, d, _, _): WideRay) -> Vec<Line> {
        let wide = |v: Vec3| v.as_dvec3();
        bvh()
            .triangles
            .iter()
            .filter_map(|x| {
                let (a, b, c) = (wide(x.a), wide(x.b), wide(x.c));
                let (t, weights, shape) = exact_line(o, d, a, b, c)?;
                Some(Line {
                    t,
                    weights,
                    shape,
                    front: (b - a).cross(c - a).dot(d) < 0.0,
                    primitive: x.primitive,
                })
            })
            .collect()
    }

    /// On no edge, and within the ray's range.
    pub fn inside(ray: WideRay, line: &Line) -> bool {
        line.weights.iter().all(|w| *w >= 0.0) && line.t >= ray.2 && line.t <= ray.3
    }

    /// On an edge, too flat, or at an end of the range.
    pub fn open(ray: WideRay, l: &Line) -> bool {
        let least = l.weights.iter().copied().fold(f64::INFINITY, f64::min);
        let reached = l.t > ray.2 - 1e-3 && l.t < ray.3 + 1e-3;
        reached && least > -1e-3 && (least < 1e-3 || l.shape < 0.02)
            || least > -1e-3 && ((l.t - ray.2).abs() < 1e-3 || (l.t - ray.3).abs() < 1e-3)
    }

    /// The size of a ray's errors, by the hit that it would have without an end:
    /// as for a single triangle, distance over size and tilt.
    pub fn scale((o, d, _, _): WideRay, first: Option<Line>) -> f64 {
        let (t, shape) = first.map_or((0.0, 1.0), |l| (l.t, l.shape));
        let far = (o.length() + 5.0).max(t * d.length());
        far / shape.max(0.02) / d.length().min(1.0)
    }

    /// The tree as the fixture reads it.
    pub fn words() -> Vec<u32> {
        let (nodes, triangles) = (bvh().node_words(), bvh().triangle_words());
        // The first word is read by the generated shader; the second counts.
        let mut words = vec![0, (nodes.len() / 8) as u32];
        words.extend(nodes);
        words.extend(triangles);
        words
    }

    /// Rays through the mesh.
    pub fn rays() -> Domain<Ray> {
        domains::vec3(domains::range(-5.0, 5.0))
            .and(domains::unit_vector())
            .and(domains::log_range(0.1, 10.0))
            .and(domains::log_range(0.5, 100.0))
            .map(|(((origin, direction), length), reach)| Ray {
                origin,
                direction: direction * length,
                t_min: 0.0,
                t_max: reach / length,
            })
    }

    /// Along axes and diagonals, with either zero, of no length to speak of.
    pub fn hard() -> [Ray; 6] {
        let ray = |origin: Vec3, direction: Vec3, t_max: f32| Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max,
        };
        let start = Vec3::new(-5.0, -3.1, -3.1);
        [
            ray(start, Vec3::X, 100.0),
            ray(start, Vec3::new(1.0, -0.0, 0.0), 100.0),
            ray(Vec3::splat(-5.0), Vec3::ONE, 100.0),
            ray(Vec3::splat(50.0), Vec3::ONE, 100.0),
            ray(Vec3::new(-3.05, -3.0, -3.02), Vec3::Z, 0.1),
            ray(start, Vec3::X * 1e-8, 1e10),
        ]
    }
}

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::ray::{Ray, WideRay};
    use crate::contract::Kernel;
    use parts::{Line, bvh, inside, lines, open};

    const SOURCE: &str = "Aila and Laine 2009 (ordered stack); tests of ray/aabb and ray/triangle";
    const WHY: &str = "the kernel reads a tree through callbacks and loops over it; its t, u and v \
                       are those of ray/triangle's watertight test, whose bounds hold here, and \
                       which triangle is hit is checked against every triangle in f64";
    fn closest(ray: Ray) -> BvhHit {
        bvh_closest(&bvh().view(), ray)
    }
    fn any(ray: Ray) -> u32 {
        bvh_any(&bvh().view(), ray)
    }
    fn first(ray: WideRay) -> Option<Line> {
        lines(ray)
            .into_iter()
            .filter(|l| inside(ray, l))
            .min_by(|a, b| a.t.total_cmp(&b.t))
    }
    fn undecided(ray: WideRay) -> bool {
        lines(ray).iter().any(|l| open(ray, l))
    }

    let words = parts::words();
    let rays = parts::rays().map(|ray| (ray,));
    let hard = parts::hard().map(|ray| (ray,));

    vec![
        Kernel::new(
            "ray/bvh",
            "bvh_closest",
            ["ray"],
            closest,
            |ray: WideRay| match first(ray) {
                Some(line) => (line.t, line.weights[1], line.weights[2], line.primitive),
                None => (ray.3, 0.0, 0.0, BVH_MISS),
            },
            rays.clone(),
        )
        .scale_by(|ray: WideRay| parts::scale(ray, first((ray.0, ray.1, 0.0, f64::MAX))))
        .undecided(undecided)
        .few_ulp(2.75, 13.5)
        .by_analysis(WHY)
        .hard(hard)
        .fixture(parts::fixture!(), words.clone())
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/bvh",
            "bvh_any",
            ["ray"],
            any,
            |ray: WideRay| u32::from(first(ray).is_some()),
            rays,
        )
        .undecided(undecided)
        .few_ulp(0.0, 0.0)
        .by_analysis(WHY)
        .hard(hard)
        .fixture(parts::fixture!(), words)
        .source(SOURCE)
        .build(),
    ]
}
