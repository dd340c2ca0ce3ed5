//! Placed meshes: the pair and its contract.

pub use raytwin_cpu::ray::instance::*;

/// The WGSL twin, without what it requires and without its callbacks.
pub const WGSL: &str = raytwin_wgsl::ray::INSTANCE;

#[cfg(feature = "contract")]
crate::value_struct!(InstanceHit {
    t: f32,
    u: f32,
    v: f32,
    primitive: u32,
    instance: u32,
});

/// What the pair promises.
#[cfg(feature = "contract")]
#[must_use]
pub fn contract() -> Vec<crate::contract::Kernel> {
    use super::bvh::BVH_MISS;
    use super::bvh_build::{BuildQuality, Bvh};
    use super::instance_build::{Instances, Placement};
    use super::ray::{Ray, WideRay};
    use super::triangle::exact_line;
    use crate::contract::{Domain, Kernel, domains};
    use glam::{Affine3A, DMat3, DVec3, DVec4, Mat3A, Vec3, Vec4};
    use std::sync::OnceLock;

    const AFFINE: &str = "an affine map by rows; sums in one order";
    const SOURCE: &str = "two levels of ray/bvh, the ray mapped and not made a unit vector";
    const WHY: &str = "the kernel reads trees through callbacks and loops over them; its t, u and v \
                       are those of ray/triangle's watertight test for the mapped ray, and which \
                       triangle is hit is checked against every triangle of every instance in f64";
    const FIXTURE: &str = "
fn bvh_read_node(index: u32) -> BvhNode {
    let at = 3u + 8u * index;
    return BvhNode(
        vec3f(raytwin_float(at), raytwin_float(at + 1u), raytwin_float(at + 2u)),
        raytwin_fixture[at + 3u],
        vec3f(raytwin_float(at + 4u), raytwin_float(at + 5u), raytwin_float(at + 6u)),
        raytwin_fixture[at + 7u],
    );
}
fn bvh_read_triangle(index: u32) -> BvhTriangle {
    let at = 3u + 8u * raytwin_fixture[1] + 12u * index;
    return BvhTriangle(
        vec3f(raytwin_float(at), raytwin_float(at + 1u), raytwin_float(at + 2u)),
        vec3f(raytwin_float(at + 4u), raytwin_float(at + 5u), raytwin_float(at + 6u)),
        vec3f(raytwin_float(at + 8u), raytwin_float(at + 9u), raytwin_float(at + 10u)),
        raytwin_fixture[at + 3u],
    );
}
fn instance_read(index: u32) -> Instance {
    let at = 3u + 8u * raytwin_fixture[1] + 12u * raytwin_fixture[2] + 16u * index;
    return Instance(
        vec4f(raytwin_float(at), raytwin_float(at + 1u), raytwin_float(at + 2u), raytwin_float(at + 3u)),
        vec4f(raytwin_float(at + 4u), raytwin_float(at + 5u), raytwin_float(at + 6u), raytwin_float(at + 7u)),
        vec4f(raytwin_float(at + 8u), raytwin_float(at + 9u), raytwin_float(at + 10u), raytwin_float(at + 11u)),
        raytwin_fixture[at + 12u],
        raytwin_fixture[at + 13u],
        raytwin_fixture[at + 14u],
        raytwin_fixture[at + 15u],
    );
}
fn raytwin_float(at: u32) -> f32 {
    return bitcast<f32>(raytwin_fixture[at]);
}
";

    // A tetrahedron and an octahedron, each in 20 places.
    fn scene() -> &'static Instances {
        static SCENE: OnceLock<Instances> = OnceLock::new();
        SCENE.get_or_init(|| {
            let build = |positions: &[Vec3], indices: &[[u32; 3]]| {
                Bvh::build(positions, indices, BuildQuality::Medium).expect("a plain mesh")
            };
            let four = build(
                &[Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
                &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
            );
            let six = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
            let eight: Vec<_> = (0..8u32)
                .map(|i| [3 * (i & 1), 1 + 3 * (i >> 1 & 1), 2 + 3 * (i >> 2)])
                .collect();
            let eight = build(&six, &eight);
            let placements: Vec<_> = (0..40u32)
                .map(|i| {
                    let cell = Vec3::new((i % 4) as f32, (i / 4 % 4) as f32, (i / 16) as f32);
                    let turn = i as f32 * 0.7;
                    let size = Vec3::new(0.5, 0.6, if i % 5 == 0 { -0.4 } else { 0.7 });
                    let matrix = Mat3A::from_rotation_y(turn)
                        * Mat3A::from_rotation_x(2.0 * turn)
                        * Mat3A::from_diagonal(size);
                    Placement {
                        to_scene: Affine3A {
                            matrix3: matrix,
                            translation: (cell * 2.0 - 3.0).into(),
                        },
                        mesh: i % 2,
                        mask: if i % 3 == 0 { 1 } else { 2 },
                    }
                })
                .collect();
            Instances::build(&[&four, &eight], &placements, 8.0, BuildQuality::Medium)
                .expect("a plain scene")
        })
    }
    fn closest(_top: u32, ray: Ray, mask: u32) -> InstanceHit {
        instance_closest(&scene().view(), ray, mask)
    }
    fn any(_top: u32, ray: Ray, mask: u32) -> u32 {
        instance_any(&scene().view(), ray, mask)
    }
    struct Line {
        t: f64,
        weights: [f64; 3],
        shape: f64,
        far: f64,
        primitive: u32,
        instance: u32,
    }
    // The mapped line against every triangle of every instance.
    fn lines((o, d, ..): WideRay, mask: u32) -> Vec<Line> {
        let view = scene().view();
        let mut out = Vec::new();
        for instance in view.instances.iter().filter(|i| i.mask & mask != 0) {
            let rows = [instance.x, instance.y, instance.z].map(|r| r.as_dvec4());
            let map = |p: DVec3, w: f64| DVec3::from(rows.map(|r| r.dot(p.extend(w))));
            let (o, d) = (map(o, 1.0), map(d, 0.0));
            let mut todo = vec![instance.root];
            while let Some(node) = todo.pop() {
                let node = view.bvh.nodes[node as usize];
                if node.count == 0 {
                    todo.extend([node.first, node.first + 1]);
                }
                for k in node.first..node.first + node.count {
                    let x = view.bvh.triangles[k as usize];
                    let [a, b, c] = [x.a, x.b, x.c].map(|v| v.as_dvec3());
                    if let Some((t, weights, shape)) = exact_line(o, d, a, b, c) {
                        out.push(Line {
                            t,
                            weights,
                            shape,
                            far: (o.length() + 4.0).max(t * d.length()) / d.length().min(1.0),
                            primitive: x.primitive,
                            instance: instance.index,
                        });
                    }
                }
            }
        }
        out
    }
    fn first(ray: WideRay, mask: u32) -> Option<Line> {
        lines(ray, mask)
            .into_iter()
            .filter(|l| l.weights.iter().all(|w| *w >= 0.0) && l.t >= ray.2 && l.t <= ray.3)
            .min_by(|a, b| a.t.total_cmp(&b.t))
    }
    // Some triangle is met on an edge, too flat, or at an end of the range;
    // or two at nearly one t, since instances may touch.
    fn undecided(_: u32, ray: WideRay, mask: u32) -> bool {
        let lines = lines(ray, mask);
        let best = first(ray, mask).map_or(f64::MAX, |l| l.t);
        lines.iter().any(|l| {
            let least = l.weights.iter().copied().fold(f64::INFINITY, f64::min);
            let reached = l.t > ray.2 - 1e-3 && l.t < ray.3 + 1e-3;
            reached && least > -1e-3 && (least < 1e-3 || l.shape < 0.02)
                || least > -1e-3 && ((l.t - ray.2).abs() < 1e-3 || (l.t - ray.3).abs() < 1e-3)
                || least > -1e-3 && l.t != best && (l.t - best).abs() < 1e-4 * best.max(1e-3)
        })
    }
    fn truth(_: u32, ray: WideRay, mask: u32) -> (f64, f64, f64, u32, u32) {
        match first(ray, mask) {
            Some(l) => (l.t, l.weights[1], l.weights[2], l.primitive, l.instance),
            None => (ray.3, 0.0, 0.0, BVH_MISS, BVH_MISS),
        }
    }

    let words = {
        let trees = scene().trees();
        let mut words = vec![0, trees.nodes.len() as u32, trees.triangles.len() as u32];
        words.extend(trees.node_words());
        words.extend(trees.triangle_words());
        words.extend(scene().instance_words());
        words
    };
    let top = scene().top();
    let rays = domains::vec3(domains::range(-5.0, 5.0))
        .and(domains::unit_vector())
        .and(domains::log_range(0.1, 10.0))
        .and(domains::log_range(0.5, 100.0))
        .and(domains::range(0.0, 4.0))
        .map(move |((((origin, direction), length), reach), mask)| {
            let ray = Ray {
                origin,
                direction: direction * length,
                t_min: 0.0,
                t_max: reach / length,
            };
            (top, ray, mask as u32)
        });
    let ray = |origin: Vec3, direction: Vec3| Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: 100.0,
    };
    let hard = [
        (top, ray(Vec3::new(-5.0, -3.1, -3.1), Vec3::X), 3),
        (
            top,
            ray(Vec3::new(-5.0, -3.1, -3.1), Vec3::new(1.0, -0.0, 0.0)),
            1,
        ),
        (top, ray(Vec3::splat(-5.0), Vec3::ONE), 2),
        (top, ray(Vec3::splat(50.0), Vec3::ONE), 3),
        (top, ray(Vec3::new(-2.9, -3.0, 0.9), Vec3::Z), 0),
    ];

    type Map = (Vec4, Vec4, Vec4, Vec3);
    let row = || {
        domains::vec3(domains::signed_log_range(1e-3, 1e3))
            .and(domains::signed_log_range(1e-3, 1e3))
    };
    let map: Domain<Map> = row()
        .and(row())
        .and(row())
        .and(domains::vec3(domains::signed_log_range(1e-3, 1e3)))
        .map(|(((x, y), z), p)| {
            let row = |(v, w): (Vec3, f32)| v.extend(w);
            (row(x), row(y), row(z), p)
        });
    // Rotations with a scale for each axis.
    let turned: Domain<Map> = domains::unit_vector()
        .and(domains::unit_vector())
        .and(domains::vec3(domains::log_range(0.01, 100.0)))
        .and(domains::unit_vector())
        .map(|(((axis, other), size), n)| {
            let across = axis.cross(other);
            let across = if across.length() < 1e-3 {
                axis.any_orthonormal_vector()
            } else {
                across.normalize()
            };
            let third = axis.cross(across);
            (
                (axis * size.x).extend(1.0),
                (across * size.y).extend(-2.0),
                (third * size.z).extend(0.5),
                n,
            )
        });
    let hard_maps = || {
        [
            (Vec4::X, Vec4::Y, Vec4::Z, Vec3::ONE),
            (Vec4::Y, Vec4::Z, Vec4::X, Vec3::new(1.0, -2.0, 3.0)),
            // The translation takes the point away.
            (
                Vec4::new(1.0, 0.0, 0.0, -1e3),
                Vec4::new(0.0, 1.0, 0.0, -1e3),
                Vec4::new(0.0, 0.0, 1.0, -1e3),
                Vec3::splat(1000.0001),
            ),
        ]
    };
    let sizes = |x: DVec4, y: DVec4, z: DVec4, p: DVec4| {
        [x, y, z]
            .map(|r| r.abs().dot(p.abs()))
            .into_iter()
            .fold(0.0, f64::max)
    };

    vec![
        Kernel::new(
            "ray/instance",
            "instance_point",
            ["x", "y", "z", "p"],
            instance_point,
            |x: DVec4, y: DVec4, z: DVec4, p: DVec3| {
                DVec3::from([x, y, z].map(|r| r.dot(p.extend(1.0))))
            },
            map.clone(),
        )
        .scale_by(move |x: DVec4, y: DVec4, z: DVec4, p: DVec3| sizes(x, y, z, p.extend(1.0)))
        .few_ulp(2.5, 4.5)
        .hard(hard_maps())
        .fixture(FIXTURE, words.clone())
        .source(AFFINE)
        .build(),
        Kernel::new(
            "ray/instance",
            "instance_vector",
            ["x", "y", "z", "v"],
            instance_vector,
            |x: DVec4, y: DVec4, z: DVec4, v: DVec3| {
                DVec3::from([x, y, z].map(|r| r.dot(v.extend(0.0))))
            },
            map,
        )
        .scale_by(move |x: DVec4, y: DVec4, z: DVec4, v: DVec3| sizes(x, y, z, v.extend(0.0)))
        .few_ulp(2.0, 3.5)
        .hard(hard_maps())
        .fixture(FIXTURE, words.clone())
        .source(AFFINE)
        .build(),
        Kernel::new(
            "ray/instance",
            "instance_normal",
            ["x", "y", "z", "n"],
            instance_normal,
            |x: DVec4, y: DVec4, z: DVec4, n: DVec3| {
                let rows = DMat3::from_cols(x.truncate(), y.truncate(), z.truncate());
                (rows * n).normalize()
            },
            turned,
        )
        // Terms that cancel.
        .scale_by(|x: DVec4, y: DVec4, z: DVec4, n: DVec3| {
            let rows = DMat3::from_cols(x.truncate(), y.truncate(), z.truncate());
            let terms = DMat3::from_cols(rows.x_axis.abs(), rows.y_axis.abs(), rows.z_axis.abs());
            ((terms * n.abs()).length() / (rows * n).length()).max(1.0)
        })
        .few_ulp(1.75, 9.5)
        .hard(hard_maps())
        .fixture(FIXTURE, words.clone())
        .source("a covector under an affine map: Turkowski, Graphics Gems I, 1990")
        .build(),
        Kernel::new(
            "ray/instance",
            "instance_closest",
            ["top", "ray", "mask"],
            closest,
            truth,
            rays.clone(),
        )
        .scale_by(|_: u32, ray: WideRay, mask: u32| {
            let reached = (ray.0, ray.1, 0.0, f64::MAX);
            first(reached, mask).map_or(1.0, |l| l.far / l.shape.max(0.02))
        })
        .undecided(undecided)
        .few_ulp(2.75, 13.5)
        .by_analysis(WHY)
        .hard(hard)
        .fixture(FIXTURE, words.clone())
        .source(SOURCE)
        .build(),
        Kernel::new(
            "ray/instance",
            "instance_any",
            ["top", "ray", "mask"],
            any,
            |_: u32, ray: WideRay, mask: u32| u32::from(first(ray, mask).is_some()),
            rays,
        )
        .undecided(undecided)
        .few_ulp(0.0, 0.0)
        .by_analysis(WHY)
        .hard(hard)
        .fixture(FIXTURE, words)
        .source(SOURCE)
        .build(),
    ]
}
