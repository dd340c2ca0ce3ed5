//! Placed meshes: the walk against a loop over all instances, against the mesh
//! with its vertices moved, and after moving.

use glam::{Affine3A, DVec3, Mat3A, Vec3};
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin::ray::instance_build::{InstanceError, Instances, Placement};
use raytwin_cpu::pass::bvh8::Level;
use raytwin_cpu::ray::bvh::{BVH_MISS, bvh_closest};
use raytwin_cpu::ray::instance::{
    Instance, InstanceHit, instance_any, instance_closest, instance_point, instance_vector,
};
use raytwin_cpu::ray::ray::Ray;
use raytwin_tests::rays::meshes::{Mesh, Random, displaced_sphere, lattice_cube, terrain};

const REACH: f32 = 40.0;

fn meshes() -> Vec<Mesh> {
    vec![displaced_sphere(500), lattice_cube(4), terrain(200)]
}

fn trees(meshes: &[Mesh]) -> Vec<Bvh> {
    meshes
        .iter()
        .map(|m| Bvh::build(&m.positions, &m.indices, BuildQuality::Medium).expect("a mesh"))
        .collect()
}

/// Turned, scaled by axis, some mirrored, many of them overlapping.
fn placements(n: usize, meshes: usize, seed: u32) -> Vec<Placement> {
    let mut random = Random::new(seed);
    (0..n)
        .map(|i| {
            let turn = Mat3A::from_axis_angle(random.direction(), 3.0 * random.signed());
            let mut size = || 10f32.powf(0.7 * random.signed() - 0.5);
            let size = Vec3::new(size(), size(), if i % 4 == 0 { -size() } else { size() });
            let other = Mat3A::from_axis_angle(random.direction(), 3.0 * random.signed());
            Placement {
                to_scene: Affine3A {
                    matrix3: turn * Mat3A::from_diagonal(size) * other,
                    translation: (random.direction() * 10.0 * random.unit()).into(),
                },
                mesh: random.below(meshes) as u32,
                mask: 1 << (i % 3),
            }
        })
        .collect()
}

/// From anywhere within reach, most of them at a vertex of an instance or near
/// it, where a box that is too small would lose them.
fn rays(n: usize, placements: &[Placement], meshes: &[Mesh], seed: u32) -> Vec<Ray> {
    let mut random = Random::new(seed);
    (0..n)
        .map(|i| {
            let far = if i % 4 == 0 { REACH } else { 6.0 };
            let origin = Vec3::new(random.signed(), random.signed(), random.signed()) * far;
            let place = placements[random.below(placements.len())];
            let mesh = &meshes[place.mesh as usize];
            let target = mesh.positions[random.below(mesh.positions.len())];
            let mut direction = place.to_scene.transform_point3(target) - origin;
            if i % 3 == 0 {
                direction += random.direction() * 0.3;
            }
            if i % 8 == 0 {
                direction[random.below(3)] = 0.0;
            }
            direction *= 10f32.powf(random.signed());
            Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max: if i % 5 == 0 { 0.8 } else { f32::MAX },
            }
        })
        .collect()
}

fn bits(h: InstanceHit) -> [u32; 5] {
    let [t, u, v] = [h.t, h.u, h.v].map(f32::to_bits);
    [t, u, v, h.primitive, h.instance]
}

fn local(instance: &Instance, ray: &Ray) -> Ray {
    let Instance { x, y, z, .. } = *instance;
    Ray {
        origin: instance_point(x, y, z, ray.origin),
        direction: instance_vector(x, y, z, ray.direction),
        ..*ray
    }
}

/// Every instance asked.
fn ask_all(instances: &[Instance], trees: &[Bvh], ray: &Ray, mask: u32) -> InstanceHit {
    let mut best = InstanceHit {
        t: ray.t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
        instance: BVH_MISS,
    };
    for instance in instances.iter().filter(|i| i.mask & mask != 0) {
        let hit = bvh_closest(&trees[instance.mesh as usize].view(), local(instance, ray));
        let closer = hit.t < best.t || hit.t == best.t && instance.index < best.instance;
        if hit.primitive != BVH_MISS && closer {
            best = InstanceHit {
                t: hit.t,
                u: hit.u,
                v: hit.v,
                primitive: hit.primitive,
                instance: instance.index,
            };
        }
    }
    best
}

#[test]
fn the_walk_is_every_instance_asked() {
    let meshes = meshes();
    let trees = trees(&meshes);
    let parts: Vec<&Bvh> = trees.iter().collect();
    for n in [1, 2, 60] {
        let mut places = placements(n, meshes.len(), 5);
        let scene = Instances::build(&parts, &places, REACH, BuildQuality::Medium).expect("sound");
        assert_eq!(scene.validate(), Ok(()));
        let mut wide = scene.wide(&parts).expect("sound");
        let check = |scene: &Instances, wide: &_, places: &[Placement], seed| {
            let wide: &raytwin_cpu::pass::bvh8::instances::Instances8 = wide;
            let levels: Vec<_> = Level::all()
                .into_iter()
                .map(|l| wide.clone().with_level(l))
                .collect();
            let view = scene.view();
            let mut hits = 0;
            for (i, ray) in rays(6_000, places, &meshes, seed).iter().enumerate() {
                let mask = if i % 2 == 0 { u32::MAX } else { i as u32 % 8 };
                let truth = ask_all(view.instances, &trees, ray, mask);
                let found = truth.primitive != BVH_MISS;
                assert_eq!(
                    bits(instance_closest(&view, *ray, mask)),
                    bits(truth),
                    "{ray:?}"
                );
                assert_eq!(instance_any(&view, *ray, mask) != 0, found, "{ray:?}");
                for wide in &levels {
                    assert_eq!(bits(wide.closest(ray, mask)), bits(truth), "{ray:?}");
                    assert_eq!(wide.any(ray, mask), found, "{ray:?}");
                }
                hits += usize::from(found);
            }
            assert!(hits > 1_000, "{hits}");
        };
        check(&scene, &wide, &places, 1);
        // Moving: the same hits as of a scene built anew.
        let mut moved = scene.clone();
        for (place, other) in places.iter_mut().zip(placements(n, meshes.len(), 77)) {
            place.to_scene = other.to_scene;
        }
        moved.refit(&places).expect("the same instances");
        assert_eq!(moved.validate(), Ok(()));
        moved.refit_wide(&mut wide).expect("the same instances");
        check(&moved, &wide, &places, 2);
        assert!(moved.refit(&places[1..]).is_err());
    }
}

/// Small instances far from where the rays start, aimed at what is outermost of
/// them along the axes: there the rounding of the mapped ray is larger than the
/// margin of the mesh's own boxes, so only the instance's pad keeps them.
#[test]
fn rims_of_small_instances_are_kept() {
    const FAR: f32 = 1_000.0;
    let meshes = meshes();
    let trees = trees(&meshes);
    let parts: Vec<&Bvh> = trees.iter().collect();
    let mut random = Random::new(3);
    let mut hits = 0;
    for seed in 0..40 {
        let mut place = placements(1, meshes.len(), 300 + seed)[0];
        place.to_scene.matrix3 *= 0.05;
        let scene = Instances::build(&parts, &[place], FAR, BuildQuality::Medium).expect("sound");
        let wide = scene.wide(&parts).expect("sound");
        let view = scene.view();
        let vertices = meshes[place.mesh as usize].positions.iter();
        let vertices: Vec<Vec3> = vertices
            .map(|&p| place.to_scene.transform_point3(p))
            .collect();
        for i in 0..600 {
            let axis = i % 3;
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            let outermost = vertices
                .iter()
                .max_by(|a, b| (sign * a[axis]).total_cmp(&(sign * b[axis])))
                .expect("a vertex");
            let mut origin = Vec3::new(random.signed(), random.signed(), random.signed()) * FAR;
            // Along the box's face, so that the ray enters it nowhere else.
            origin[axis] = outermost[axis];
            let ray = Ray {
                origin,
                direction: *outermost - origin,
                t_min: 0.0,
                t_max: f32::MAX,
            };
            let truth = ask_all(view.instances, &trees, &ray, u32::MAX);
            hits += usize::from(truth.primitive != BVH_MISS);
            assert_eq!(
                bits(instance_closest(&view, ray, u32::MAX)),
                bits(truth),
                "{ray:?}"
            );
            assert_eq!(bits(wide.closest(&ray, u32::MAX)), bits(truth), "{ray:?}");
        }
    }
    assert!(hits > 2_000, "{hits}");
}

/// The distance of a point from a triangle.
fn distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let n = (b - a).cross(c - a).normalize();
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|&(s, e)| (e - s).cross(p - s).dot(n) >= 0.0);
    let plane = (p - a).dot(n).abs();
    if inside { plane } else { rim(p, [a, b, c]) }
}

/// The distance of a point from a triangle's edges.
fn rim(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let edges = [(a, b), (b, c), (c, a)].map(|(s, e)| {
        let along = ((p - s).dot(e - s) / (e - s).length_squared()).clamp(0.0, 1.0);
        (p - s - (e - s) * along).length()
    });
    edges.into_iter().fold(f64::INFINITY, f64::min)
}

/// An instance against the mesh with its vertices moved in double precision
/// and then rounded. See docs/ray/instance.md for the bound.
#[test]
fn an_instance_is_the_moved_mesh() {
    const BOUND: f64 = 1.0 / 524_288.0;
    let meshes = meshes();
    let trees = trees(&meshes);
    let parts: Vec<&Bvh> = trees.iter().collect();
    let (mut worst, mut worst_t) = (0f64, 0f64);
    let (mut lost, mut others, mut both) = (0, 0, 0);
    for seed in 0..12 {
        let places = placements(1, meshes.len(), 100 + seed);
        let mesh = &meshes[places[0].mesh as usize];
        let scene = Instances::build(&parts, &places, REACH, BuildQuality::Medium).expect("sound");
        let instance = scene.view().instances[0];
        let rows = [instance.x, instance.y, instance.z].map(|r| r.as_dvec4());
        let linear = glam::DMat3::from_cols_array_2d(&std::array::from_fn(|c| {
            std::array::from_fn(|r| rows[r][c])
        }));
        let shift = DVec3::from(rows.map(|r| r.w));
        let back = linear.inverse();
        let moved: Vec<Vec3> = mesh
            .positions
            .iter()
            .map(|p| (back * (p.as_dvec3() - shift)).as_vec3())
            .collect();
        let baked = Bvh::build(&moved, &mesh.indices, BuildQuality::Medium).expect("a mesh");
        let own = mesh
            .positions
            .iter()
            .fold(Vec3::ZERO, |m, p| m.max(p.abs()))
            .as_dvec3();
        for ray in rays(10_000, &places, &meshes, 9 + seed) {
            let hit = instance_closest(&scene.view(), ray, u32::MAX);
            let flat = bvh_closest(&baked.view(), ray);
            let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
            // What the numbers on the way are made of, for a hit at t.
            let at = |t: f32, primitive: u32| {
                let p = o + d * f64::from(t);
                let size = |k: usize| {
                    rows[k].truncate().abs().dot(o.abs() + p.abs()) + rows[k].w.abs() + own[k]
                };
                let a = DVec3::new(size(0), size(1), size(2)).length();
                let corners =
                    mesh.indices[primitive as usize].map(|i| mesh.positions[i as usize].as_dvec3());
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let tilt = normal.normalize().dot(linear * d).abs();
                (linear * p + shift, corners, a, tilt)
            };
            let length = (linear * d).length();
            if hit.primitive != BVH_MISS {
                let (p, corners, a, tilt) = at(hit.t, hit.primitive);
                let off = distance(p, corners) * tilt / length / a;
                worst = worst.max(off);
                assert!(off <= BOUND, "{off:e} {ray:?}");
            }
            if hit.primitive != flat.primitive {
                // The nearer one is at an edge, or the other would have it too.
                let flat_first = flat.primitive != BVH_MISS && flat.t < hit.t;
                let (t, primitive) = if hit.primitive == BVH_MISS || flat_first {
                    (flat.t, flat.primitive)
                } else {
                    (hit.t, hit.primitive)
                };
                let (p, corners, a, tilt) = at(t, primitive);
                let off = rim(p, corners) * tilt / length / a;
                assert!(off <= 2.0 * BOUND, "{off:e} {ray:?}");
                let miss = hit.primitive == BVH_MISS || flat.primitive == BVH_MISS;
                lost += usize::from(miss);
                others += usize::from(!miss);
                continue;
            }
            if hit.primitive == BVH_MISS {
                continue;
            }
            both += 1;
            let (_, _, a, tilt) = at(hit.t, hit.primitive);
            // Along the ray: the same over the cosine.
            let t = (f64::from(hit.t) - f64::from(flat.t)).abs() * tilt / a;
            worst_t = worst_t.max(t);
            // The moved mesh has errors of its own, of the same kind.
            assert!(t <= 2.0 * BOUND, "{t:e} {ray:?}");
        }
    }
    println!(
        "{both} rays: off by at most {:.2} of the bound, t {:.2} of twice the bound; \
         {others} with a neighbour, {lost} past a rim",
        worst / BOUND,
        worst_t / BOUND / 2.0
    );
    assert!(both > 50_000, "{both}");
}

#[test]
fn bad_scenes_are_refused() {
    let meshes = meshes();
    let trees = trees(&meshes);
    let parts: Vec<&Bvh> = trees.iter().collect();
    let good = placements(4, meshes.len(), 3);
    let build = |places: &[Placement], reach| {
        Instances::build(&parts, places, reach, BuildQuality::Fast).map(|_| ())
    };
    assert_eq!(build(&good, REACH), Ok(()));
    let with = |change: &dyn Fn(&mut Placement)| {
        let mut places = good.clone();
        change(&mut places[2]);
        build(&places, REACH).expect_err("a bad scene")
    };
    let map = InstanceError::Map { instance: 2 };
    assert_eq!(with(&|p| p.to_scene.translation.y = f32::NAN), map);
    assert_eq!(with(&|p| p.to_scene.matrix3 = Mat3A::ZERO), map);
    assert_eq!(with(&|p| p.to_scene.matrix3.z_axis.x = f32::INFINITY), map);
    assert_eq!(with(&|p| p.to_scene.translation.x = 1e12), map);
    assert_eq!(
        with(&|p| p.mesh = 3),
        InstanceError::Mesh {
            instance: 2,
            mesh: 3,
            meshes: 3
        }
    );
    for reach in [-1.0, f32::NAN, f32::INFINITY] {
        let error = build(&good, reach).expect_err("no distance");
        assert!(matches!(error, InstanceError::Reach { .. }), "{error}");
    }
    // Nothing at all, and an empty mesh.
    let ray = rays(1, &good, &meshes, 1)[0];
    let none = Instances::build(&[], &[], 1.0, BuildQuality::Fast).expect("an empty scene");
    assert_eq!(instance_closest(&none.view(), ray, 1).instance, BVH_MISS);
    assert_eq!(none.validate(), Ok(()));
    let empty = Bvh::default();
    let place = Placement { mesh: 0, ..good[0] };
    let hollow = Instances::build(&[&empty], &[place; 3], 1.0, BuildQuality::Fast);
    let hollow = hollow.expect("a scene of nothing");
    assert_eq!(hollow.validate(), Ok(()));
    assert_eq!(instance_closest(&hollow.view(), ray, 1).instance, BVH_MISS);
}
