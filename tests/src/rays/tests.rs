use std::time::Duration;

use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use obvhs::{BvhBuildParams, bvh2::Bvh2};
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin_cpu::ray::bvh::{BVH_MISS, BvhHit, BvhView, bvh_any, bvh_closest};
use raytwin_cpu::ray::ray::Ray;
use raytwin_cpu::ray::triangle::triangle_intersect_watertight;

use super::families::{Family, all, leaks, ray};
use super::fused::{Arithmetic, Fuse};
use super::meshes::{
    Mesh, Random, displaced_sphere, lattice_cube, room, sliver_sphere, straight_hall, terrain,
    tilted_hall,
};
use super::reference::reference_closest;

const RAYS: usize = 20_000;

fn build(mesh: &Mesh) -> Bvh {
    let bvh = Bvh::build(&mesh.positions, &mesh.indices, BuildQuality::Medium)
        .expect("generated meshes are sound");
    assert_eq!(bvh.validate(), Ok(()));
    bvh
}

fn hit_of(hit: BvhHit) -> Option<(f32, u32)> {
    (hit.primitive != BVH_MISS).then_some((hit.t, hit.primitive))
}

/// obvhs as its users run it: its traversal with its own triangle test.
struct Plain {
    bvh: Bvh2,
    triangles: Vec<RtTriangle>,
}

impl Plain {
    fn new(mesh: &Mesh) -> Self {
        let triangles: Vec<Triangle> = (0..mesh.indices.len())
            .map(|i| {
                let [a, b, c] = mesh.corners(i).map(Into::into);
                Triangle {
                    v0: a,
                    v1: b,
                    v2: c,
                }
            })
            .collect();
        let bvh = build_bvh2_from_tris(
            &triangles,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        let triangles = bvh
            .primitive_indices
            .iter()
            .map(|&i| RtTriangle::from(&triangles[i as usize]))
            .collect();
        Self { bvh, triangles }
    }

    fn closest(&self, ray: Ray) -> Option<(f32, u32)> {
        let mut hit = RayHit::none();
        let r = ObvhsRay::new(
            ray.origin.into(),
            ray.direction.into(),
            ray.t_min,
            ray.t_max,
        );
        self.bvh
            .ray_traverse(r, &mut hit, |r, i| self.triangles[i].intersect(r))
            .then_some((hit.t, hit.primitive_id))
    }
}

#[test]
fn meshes_are_what_they_say() {
    for (mesh, triangles) in [
        (lattice_cube(64), 49_152),
        (displaced_sphere(20_000), 19_200),
        (sliver_sphere(20_000), 16_000),
        (room(), 20_000),
        (tilted_hall(), 12),
        (straight_hall(), 12),
    ] {
        assert!(mesh.is_closed());
        let ratio = mesh.indices.len() as f64 / f64::from(triangles);
        assert!(
            (0.8..1.25).contains(&ratio),
            "{} {triangles}",
            mesh.indices.len()
        );
    }
    assert!(!terrain(1000).is_closed());
    assert_eq!(displaced_sphere(5000), displaced_sphere(5000));
}

#[test]
fn nothing_leaks() {
    let mut report = Vec::new();
    for family in all(RAYS) {
        let bvh = build(&family.mesh);
        let lost = leaks(&family, |r| hit_of(bvh_closest(&bvh.view(), r)));
        let any = family
            .rays
            .iter()
            .filter(|&&r| bvh_any(&bvh.view(), r) == 0)
            .count();
        if lost + any > 0 {
            report.push(format!("{}: {lost} closest, {any} any", family.name));
        }
    }
    assert!(report.is_empty(), "{report:#?}");
}

#[test]
fn the_families_see_leaks() {
    // An ordinary tracer as the live control: the families would be worth
    // nothing if nobody failed them.
    for family in all(RAYS / 4) {
        let plain = Plain::new(&family.mesh);
        let lost = leaks(&family, |r| plain.closest(r));
        let must_fail = [
            "edges, closed",
            "vertices",
            "axes with",
            "diagonals",
            "edges of sl",
        ];
        if must_fail.iter().any(|s| family.name.starts_with(s)) {
            assert!(lost * 50 > family.rays.len(), "{}: {lost}", family.name);
        }
    }
}

fn fused_leaks(arithmetic: Arithmetic, families: &[(Family, Bvh)]) -> Vec<String> {
    families
        .iter()
        .filter_map(|(family, bvh)| {
            let lost = leaks(family, |r| hit_of(arithmetic.closest(&bvh.view(), r)));
            (lost > 0).then(|| format!("{}: {lost}", family.name))
        })
        .collect()
}

fn built(rays: usize) -> Vec<(Family, Bvh)> {
    all(rays)
        .into_iter()
        .map(|f| {
            let bvh = build(&f.mesh);
            (f, bvh)
        })
        .collect()
}

#[test]
fn nothing_leaks_fused() {
    let families = built(RAYS / 10);
    for (edges, rest, division) in [
        (Fuse::No, true, 0),
        (Fuse::No, false, 2),
        (Fuse::First, true, -2),
        (Fuse::First, false, 0),
        (Fuse::Second, true, 2),
        (Fuse::Second, false, -2),
        (Fuse::Mixed, true, 2),
        (Fuse::Mixed, true, -2),
    ] {
        let arithmetic = Arithmetic {
            edges,
            rest,
            division,
            ..Arithmetic::PLAIN
        };
        let lost = fused_leaks(arithmetic, &families);
        assert!(lost.is_empty(), "{arithmetic:?}: {lost:#?}");
    }
}

#[test]
fn canonical_order_and_guard_each_hold_alone() {
    let families = built(RAYS / 10);
    for fuse in [Fuse::First, Fuse::Second] {
        let fused = Arithmetic {
            edges: fuse,
            rest: true,
            ..Arithmetic::PLAIN
        };
        for (canonical, guard) in [(true, false), (false, true)] {
            let lost = fused_leaks(
                Arithmetic {
                    canonical,
                    guard,
                    ..fused
                },
                &families,
            );
            assert!(lost.is_empty(), "{canonical} {guard}: {lost:#?}");
        }
        // With neither, edges leak as soon as a compiler fuses.
        let lost = fused_leaks(
            Arithmetic {
                canonical: false,
                guard: false,
                ..fused
            },
            &families,
        );
        assert!(lost.iter().any(|s| s.starts_with("edges")), "{lost:?}");
    }
}

#[test]
fn the_tree_does_not_matter() {
    // Traversal gives what a loop over all triangles gives, bit for bit.
    for family in all(60) {
        let every: Vec<Bvh> = [BuildQuality::Fastest, BuildQuality::VerySlow]
            .into_iter()
            .map(|q| Bvh::build(&family.mesh.positions, &family.mesh.indices, q).expect("sound"))
            .collect();
        for &r in &family.rays {
            let mut best = hit_of(BvhHit {
                t: 0.0,
                u: 0.0,
                v: 0.0,
                primitive: BVH_MISS,
            });
            for i in 0..family.mesh.indices.len() {
                let [a, b, c] = family.mesh.corners(i);
                let h = triangle_intersect_watertight(r, a, b, c);
                if h.hit != 0 && best.is_none_or(|(t, _)| h.t < t) {
                    best = Some((h.t, i as u32));
                }
            }
            for bvh in &every {
                assert_eq!(
                    hit_of(bvh_closest(&bvh.view(), r)),
                    best,
                    "{} {r:?}",
                    family.name
                );
                assert_eq!(bvh_any(&bvh.view(), r) != 0, best.is_some());
            }
        }
    }
}

/// `(hit or miss differs, wrong surface)` against the reference; rays within
/// 1e-5 of an edge may differ in hit or miss on open meshes.
fn compare(view: &BvhView<'_>, rays: &[Ray], scale: f64) -> (usize, usize) {
    let (mut hits, mut surfaces) = (0, 0);
    for &r in rays {
        let ours = hit_of(bvh_closest(view, r));
        let truth = reference_closest(view, r);
        match (ours, &truth) {
            (None, None) => {}
            (Some((t, _)), Some(h)) => {
                let length = f64::from(r.direction.length());
                let error = (f64::from(t) - h.t).abs() * length;
                if error > 1e-5 * scale.max(h.t.abs() * length) {
                    surfaces += 1;
                }
            }
            _ => hits += 1,
        }
    }
    (hits, surfaces)
}

#[test]
fn the_reference_agrees() {
    for (mesh, scale) in [
        (displaced_sphere(20_000), 1.0f32),
        (terrain(20_000), 10.0),
        (room(), 3.0),
        (sliver_sphere(20_000), 1.0),
    ] {
        let bvh = build(&mesh);
        let mut random = Random::new(77);
        let rays: Vec<_> = (0..RAYS)
            .map(|_| {
                let o = random.direction() * (scale * 2.0 * random.unit());
                ray(o, random.direction())
            })
            .collect();
        assert_eq!(compare(&bvh.view(), &rays, f64::from(scale)), (0, 0));
    }
}
