use super::*;
use crate::ray::bvh::{BvhNode, BvhTriangle, bvh_any, bvh_closest};
use crate::ray::bvh_filter::{BVH_FACES_BOTH, BVH_FACES_FRONT, bvh_any_of, bvh_closest_of};
use crate::ray::triangle::triangle_intersect_watertight;

struct Random(u32);

impl Random {
    fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let x = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        (x >> 22) ^ x
    }

    fn unit(&mut self) -> f32 {
        (self.word() >> 8) as f32 / 16_777_216.0
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.unit() - 0.5, self.unit() - 0.5, self.unit() - 0.5)
    }
}

struct Tree {
    nodes: Vec<BvhNode>,
    triangles: Vec<BvhTriangle>,
}

impl Tree {
    fn view(&self) -> BvhView<'_> {
        BvhView {
            nodes: &self.nodes,
            triangles: &self.triangles,
        }
    }

    /// Halves the list, which is sorted along x, down to leaves of `leaf`.
    fn new(corners: &[[Vec3; 3]], leaf: usize) -> Self {
        let mut triangles: Vec<BvhTriangle> = corners
            .iter()
            .enumerate()
            .map(|(i, &[a, b, c])| BvhTriangle {
                a,
                b,
                c,
                primitive: i as u32,
            })
            .collect();
        triangles.sort_by(|l, r| l.a.x.total_cmp(&r.a.x));
        let around = |part: &[BvhTriangle]| {
            let boxes = part.iter().map(|t| triangle_box(t.a, t.b, t.c));
            boxes
                .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
                .unwrap_or_default()
        };
        let node = |part: &[BvhTriangle], first: usize, count: usize| BvhNode {
            min: around(part).0,
            first: first as u32,
            max: around(part).1,
            count: count as u32,
        };
        let mut nodes = vec![node(&triangles, 0, triangles.len())];
        let mut at = 0;
        while at < nodes.len() {
            let (first, count) = (nodes[at].first as usize, nodes[at].count as usize);
            if count > leaf {
                let half = count / 2;
                let child = nodes.len();
                nodes.push(node(&triangles[first..first + half], first, half));
                nodes.push(node(
                    &triangles[first + half..first + count],
                    first + half,
                    count - half,
                ));
                (nodes[at].first, nodes[at].count) = (child as u32, 0);
            }
            at += 1;
        }
        Self { nodes, triangles }
    }
}

/// Small triangles in a cube, and a few large ones.
fn soup(n: usize, seed: u32) -> Vec<[Vec3; 3]> {
    let mut random = Random(seed);
    (0..n)
        .map(|i| {
            let size = if i % 50 == 0 { 1.0 } else { 0.2 };
            let at = random.vector();
            [0; 3].map(|_| at + random.vector() * size)
        })
        .collect()
}

/// Random rays; every eighth has zeros in its direction, and every other of
/// those starts at a vertex's coordinate.
fn rays(n: usize, corners: &[[Vec3; 3]], seed: u32) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..n)
        .map(|i| {
            let mut origin = random.vector() * 2.0;
            let mut direction = random.vector();
            if i % 8 == 0 {
                direction[random.word() as usize % 3] = if i % 16 == 0 { 0.0 } else { -0.0 };
            }
            if i % 16 == 0 {
                origin = corners[random.word() as usize % corners.len()][0];
                origin[i / 16 % 3] -= 1.0;
            }
            Ray {
                origin,
                direction,
                t_min: if i % 5 == 0 { 0.1 } else { 0.0 },
                t_max: if i % 3 == 0 { 1.5 } else { f32::MAX },
            }
        })
        .collect()
}

fn bits(hit: BvhHit) -> [u32; 4] {
    [
        hit.t.to_bits(),
        hit.u.to_bits(),
        hit.v.to_bits(),
        hit.primitive,
    ]
}

/// Every triangle asked that the filter leaves.
fn ask_all<'a>(corners: &[[Vec3; 3]], ray: &Ray, filter: impl Into<Filter<'a>>) -> BvhHit {
    let filter = filter.into();
    let mut best = BvhHit {
        t: ray.t_max,
        u: 0.0,
        v: 0.0,
        primitive: BVH_MISS,
    };
    for (i, &[a, b, c]) in corners.iter().enumerate() {
        let normal = (b - a).cross(c - a);
        if filter.faces == Faces::Front && normal.dot(ray.direction) >= 0.0 {
            continue;
        }
        let own = filter.masks.get(i).copied().unwrap_or(u32::MAX);
        if own & filter.mask == 0 {
            continue;
        }
        let hit = triangle_intersect_watertight(*ray, a, b, c);
        if hit.hit != 0 && (hit.t < best.t || hit.t == best.t && (i as u32) < best.primitive) {
            best = BvhHit {
                t: hit.t,
                u: hit.u,
                v: hit.v,
                primitive: i as u32,
            };
        }
    }
    best
}

fn levels(tree: &Tree) -> Vec<Bvh8> {
    let wide = Bvh8::new(tree.view()).expect("a sound tree");
    Level::all()
        .into_iter()
        .map(|level| wide.clone().with_level(level))
        .collect()
}

/// Rays from triangles, from a little before or behind them, or far ahead: what
/// is behind a ray is left out early, and must be behind it in every bit.
#[test]
fn what_is_left_out_as_behind_is_behind() {
    for scale in [1e-30, 1e-13, 1e-6, 1.0, 1e6, 1e10] {
        let mut corners = soup(60, 5);
        for (i, triangle) in corners.iter_mut().enumerate() {
            if i % 4 == 0 {
                // A needle; every other one is no wider than its rounding, so that
                // its normal says nothing of where it is.
                let width = if i % 8 == 0 { 1e-6 } else { 1e-8 };
                triangle[2] = triangle[0].lerp(triangle[1], 0.4) + triangle[2] * width;
            }
            *triangle = triangle.map(|p| p * scale);
        }
        let tree = Tree::new(&corners, 4);
        let wides = levels(&tree);
        let mut random = Random(29);
        let mut begins = 0;
        for i in 0..12_000 {
            let [a, b, c] = corners[random.word() as usize % corners.len()];
            let weights = random.vector().abs();
            let weights = weights / (weights.x + weights.y + weights.z);
            let on = a * weights.x + b * weights.y + c * weights.z;
            let direction = random.vector();
            let steps = [0.0, 1e-8, -1e-8, 1e-6, -1e-6, 1e-4, 1e-2, -1e-3, -1e2];
            let ray = Ray {
                origin: on + direction * (steps[i % 9] * scale),
                direction,
                t_min: [0.0, -0.0, -0.5 * scale, 1e-4 * scale, 1e-38][i % 5],
                t_max: f32::MAX,
            };
            let truth = ask_all(&corners, &ray, Faces::Both);
            for wide in &wides {
                let name = wide.level().name();
                assert_eq!(
                    bits(wide.closest(&ray)),
                    bits(truth),
                    "{name} {scale} {ray:?}"
                );
                assert_eq!(wide.any(&ray), truth.primitive != BVH_MISS, "{name}");
            }
            begins += usize::from(truth.t.abs() < 1e-3 * scale);
        }
        // At the smallest scale products are zero, and nothing is hit.
        assert!(
            scale < 1e-20 || begins > 100,
            "{begins} hits at the start of rays"
        );
    }
}

#[test]
fn every_level_is_every_triangle_asked() {
    for (n, leaf) in [
        (1, 1),
        (7, 3),
        (8, 1),
        (9, 20),
        (300, 4),
        (300, 100),
        (300, 1000),
    ] {
        let corners = soup(n, 7);
        let tree = Tree::new(&corners, leaf);
        for wide in levels(&tree) {
            let mut hits = 0;
            for ray in rays(3000, &corners, 11) {
                let truth = ask_all(&corners, &ray, Faces::Both);
                let name = wide.level().name();
                assert_eq!(bits(wide.closest(&ray)), bits(truth), "{name} {n} {ray:?}");
                assert_eq!(wide.any(&ray), truth.primitive != BVH_MISS, "{name}");
                assert_eq!(bits(bvh_closest(&tree.view(), ray)), bits(truth));
                assert_eq!(bvh_any(&tree.view(), ray) != 0, truth.primitive != BVH_MISS);
                let front = ask_all(&corners, &ray, Faces::Front);
                assert_eq!(bits(wide.closest_of(&ray, Faces::Front)), bits(front));
                assert_eq!(wide.any_of(&ray, Faces::Front), front.primitive != BVH_MISS);
                let scalar = bvh_closest_of(&tree.view(), &[], ray, BVH_FACES_FRONT, 1);
                assert_eq!(bits(scalar), bits(front), "{n} {ray:?}");
                hits += usize::from(truth.primitive != BVH_MISS);
            }
            assert!(n < 100 || hits > 200, "{hits}");
        }
    }
}

#[test]
fn the_order_of_triangles_changes_no_t() {
    let corners = soup(200, 3);
    let mut turned = corners.clone();
    turned.reverse();
    turned.swap(3, 77);
    let (a, b) = (Tree::new(&corners, 2), Tree::new(&turned, 2));
    let (a, b) = (levels(&a).pop().unwrap(), levels(&b).pop().unwrap());
    for ray in rays(2000, &corners, 5) {
        assert_eq!(a.closest(&ray).t.to_bits(), b.closest(&ray).t.to_bits());
    }
}

#[test]
fn equal_hits_take_the_lowest_index() {
    let one = soup(1, 1)[0];
    let corners = vec![one; 40];
    let ray = Ray {
        origin: (one[0] + one[1] + one[2]) / 3.0 + Vec3::new(0.3, 0.2, 2.0),
        direction: Vec3::new(-0.3, -0.2, -2.0),
        t_min: 0.0,
        t_max: f32::MAX,
    };
    for leaf in [1, 8, 64] {
        for wide in levels(&Tree::new(&corners, leaf)) {
            assert_eq!(wide.closest(&ray).primitive, 0);
        }
    }
}

#[test]
fn batches_are_single_rays() {
    let corners = soup(300, 9);
    let tree = Tree::new(&corners, 4);
    // As from a camera, some with zeros in their direction or a range; then
    // any rays.
    let eye = Vec3::new(0.1, 0.2, 2.0);
    let mut rays: Vec<Ray> = (0..4000)
        .map(|i| {
            let (x, y) = ((i % 64) as f32 / 64.0 - 0.5, (i / 64) as f32 / 64.0 - 0.5);
            Ray {
                origin: eye,
                direction: Vec3::new(x, y, -2.0),
                t_min: if i % 7 == 0 { 0.9 } else { 0.0 },
                t_max: if i % 5 == 0 { 1.0 } else { f32::MAX },
            }
        })
        .collect();
    // At vertices: on the edges of several triangles.
    rays.extend(corners.iter().flatten().map(|&v| Ray {
        origin: eye,
        direction: v - eye,
        t_min: 0.0,
        t_max: f32::MAX,
    }));
    rays.extend(self::rays(3001, &corners, 2));
    for wide in levels(&tree) {
        let single: Vec<_> = rays.iter().map(|r| bits(wide.closest(r))).collect();
        let hits = single.iter().filter(|h| h[3] != BVH_MISS).count();
        assert!(hits > 500, "{hits}");
        for many in [wide.closest_many(&rays), wide.closest_coherent(&rays)] {
            let many: Vec<_> = many.into_iter().map(bits).collect();
            assert_eq!(many, single, "{}", wide.level().name());
        }
        for many in [wide.any_many(&rays), wide.any_coherent(&rays)] {
            let any: Vec<_> = single.iter().map(|h| h[3] != BVH_MISS).collect();
            assert_eq!(many, any, "{}", wide.level().name());
        }
    }
    let none = levels(&tree).pop().unwrap().closest_coherent(&[]);
    assert!(none.is_empty());
}

#[test]
fn a_mask_without_a_bit_sees_nothing() {
    let corners = soup(60, 13);
    let tree = Tree::new(&corners, 4);
    let rays = rays(600, &corners, 4);
    let none = Filter {
        mask: 0,
        ..Filter::ALL
    };
    for wide in levels(&tree) {
        assert!(wide.any_many(&rays).contains(&true));
        assert!(!wide.any_many_of(&rays, none).contains(&true));
        assert!(!wide.any_coherent_of(&rays, none).contains(&true));
        for ray in &rays {
            let hit = bvh_closest_of(&tree.view(), &[], *ray, BVH_FACES_BOTH, 0);
            assert_eq!(bits(wide.closest_of(ray, none)), bits(hit));
            assert_eq!(hit.primitive, BVH_MISS);
        }
    }
}

#[test]
fn filters_leave_out_triangles() {
    let corners = soup(300, 13);
    let tree = Tree::new(&corners, 4);
    let mut random = Random(6);
    // A quarter has no bit at all, and the last twenty have no mask.
    let masks: Vec<u32> = (0..280)
        .map(|_| random.word() & random.word() & 7)
        .collect();
    let eye = Vec3::new(0.1, 0.2, 2.0);
    let mut rays = rays(3000, &corners, 4);
    rays.extend((0..2000).map(|i| Ray {
        origin: eye,
        direction: Vec3::new(
            (i % 50) as f32 / 50.0 - 0.49,
            (i / 50) as f32 / 40.0 - 0.49,
            -2.0,
        ),
        t_min: 0.0,
        t_max: f32::MAX,
    }));
    let filters = [0, 1, 2, 6, u32::MAX]
        .into_iter()
        .flat_map(|mask| [Faces::Both, Faces::Front].map(|faces| (faces, mask)));
    for (faces, mask) in filters {
        let filter = Filter {
            faces,
            mask,
            masks: &masks,
        };
        let truth: Vec<_> = rays.iter().map(|r| ask_all(&corners, r, filter)).collect();
        let hit = |h: &BvhHit| h.primitive != BVH_MISS;
        let other = rays
            .iter()
            .zip(&truth)
            .filter(|(r, t)| ask_all(&corners, r, Faces::Both) != **t);
        assert!(other.count() > 200);
        let sides = match faces {
            Faces::Both => BVH_FACES_BOTH,
            Faces::Front => BVH_FACES_FRONT,
        };
        for (&ray, truth) in rays.iter().zip(&truth) {
            let scalar = bvh_closest_of(&tree.view(), &masks, ray, sides, mask);
            assert_eq!(bits(scalar), bits(*truth), "{faces:?} {mask} {ray:?}");
            let any = bvh_any_of(&tree.view(), &masks, ray, sides, mask);
            assert_eq!(any != 0, hit(truth), "{faces:?} {mask} {ray:?}");
        }
        let (words, any): (Vec<_>, Vec<_>) = truth.iter().map(|t| (bits(*t), hit(t))).unzip();
        for wide in levels(&tree) {
            let name = wide.level().name();
            let all = |hits: Vec<BvhHit>| hits.into_iter().map(bits).collect::<Vec<_>>();
            let one = rays.iter().map(|r| wide.closest_of(r, filter)).collect();
            assert!(all(one) == words, "{name} {faces:?} {mask}");
            assert!(all(wide.closest_many_of(&rays, filter)) == words, "{name}");
            assert!(
                all(wide.closest_coherent_of(&rays, filter)) == words,
                "{name}"
            );
            let one: Vec<_> = rays.iter().map(|r| wide.any_of(r, filter)).collect();
            assert!(one == any, "{name} {faces:?} {mask}");
            assert!(wide.any_many_of(&rays, filter) == any, "{name}");
            assert!(wide.any_coherent_of(&rays, filter) == any, "{name}");
        }
    }
}

#[test]
fn refit_is_rebuild() {
    let before = soup(300, 9);
    let tree = Tree::new(&before, 4);
    let mut random = Random(4);
    let after: Vec<_> = before
        .iter()
        .map(|t| t.map(|v| v * 3.0 + random.vector() * 0.2))
        .collect();
    let positions: Vec<_> = after.iter().flatten().copied().collect();
    let indices: Vec<_> = (0..300).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let rebuilt = Tree::new(&after, 4);
    for mut wide in levels(&tree) {
        wide.refit(&positions, &indices).unwrap();
        let mut hits = 0;
        for mut ray in rays(3000, &before, 8) {
            ray.origin *= 3.0;
            let truth = bvh_closest(&rebuilt.view(), ray);
            assert_eq!(bits(wide.closest(&ray)), bits(truth));
            hits += usize::from(truth.primitive != BVH_MISS);
        }
        assert!(hits > 100, "{hits}");
        // A mesh that does not fit changes nothing.
        let ray = rays(1, &before, 8)[0];
        let was = bits(wide.closest(&ray));
        let mut bad = positions.clone();
        bad[30].y = f32::NAN;
        assert_eq!(
            wide.refit(&bad, &indices),
            Err(RefitError { primitive: 10 })
        );
        assert!(wide.refit(&positions, &indices[..299]).is_err());
        assert!(wide.refit(&positions[..899], &indices).is_err());
        assert_eq!(bits(wide.closest(&ray)), was);
    }
}

#[test]
fn no_triangles_no_hits() {
    let wide = Bvh8::new(BvhView {
        nodes: &[],
        triangles: &[],
    })
    .unwrap();
    for ray in rays(16, &soup(1, 1), 1) {
        assert_eq!(wide.closest(&ray).primitive, BVH_MISS);
        assert!(!wide.any(&ray));
    }
}

#[test]
fn broken_trees_are_refused() {
    let corners = soup(100, 9);
    let refuse = |change: &dyn Fn(&mut Tree)| {
        let mut tree = Tree::new(&corners, 4);
        change(&mut tree);
        Bvh8::new(tree.view()).expect_err("a broken tree")
    };
    let leaf = |t: &Tree| t.nodes.iter().position(|n| n.count > 0).unwrap();
    assert_eq!(
        refuse(&|t| t.nodes[1].first = 0),
        Bvh8Fault::Child { node: 1, child: 0 }
    );
    assert_eq!(
        refuse(&|t| t.nodes[0].first = u32::MAX),
        Bvh8Fault::Child {
            node: 0,
            child: u32::MAX
        }
    );
    assert!(matches!(
        refuse(&|t| t.nodes[1].first = t.nodes[2].first),
        Bvh8Fault::Parents { .. } | Bvh8Fault::Box { .. }
    ));
    assert!(matches!(
        refuse(&|t| {
            let leaf = leaf(t);
            t.nodes[leaf].count = u32::MAX;
        }),
        Bvh8Fault::Range { .. }
    ));
    assert_eq!(
        refuse(&|t| t.nodes[2].max.y = f32::NAN),
        Bvh8Fault::Box { node: 2 }
    );
    assert_eq!(
        refuse(&|t| t.nodes[2].min.x = f32::NEG_INFINITY),
        Bvh8Fault::Box { node: 2 }
    );
    assert!(matches!(
        refuse(&|t| t.nodes[0].max.x -= 0.5),
        Bvh8Fault::Box { .. }
    ));
    assert!(
        refuse(&|t| {
            let last = t.nodes[0];
            t.nodes.push(last);
        })
        .to_string()
        .contains("no parent")
    );
    // A comb of a hundred levels.
    let one = Tree::new(&corners[..1], 1);
    let root = one.nodes[0];
    let mut nodes = vec![BvhNode {
        first: 1,
        count: 0,
        ..root
    }];
    for level in 0..100u32 {
        nodes.push(root);
        nodes.push(BvhNode {
            first: if level < 99 { 2 * level + 3 } else { 0 },
            count: u32::from(level == 99),
            ..root
        });
    }
    let fault = Bvh8::new(BvhView {
        nodes: &nodes,
        triangles: &one.triangles,
    })
    .expect_err("too deep");
    assert!(matches!(fault, Bvh8Fault::Depth { .. }), "{fault}");
}
