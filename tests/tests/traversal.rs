//! Our traversal, on the CPU and on every adapter, against the reference in
//! double precision, with Embree and obvhs beside it.
//!
//! `RAYTWIN_FULL` makes it a million rays a mesh; the tables are printed with
//! `--nocapture`.

use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use glam::Vec3;
use raytwin::ray::bvh_build::{BuildQuality, Bvh, BvhFault};
use raytwin_cpu::ray::bvh::{BVH_MISS, BvhNode, bvh_closest};
use raytwin_cpu::ray::ray::Ray;
use raytwin_tests::crosscheck::{
    Answer, Cause, Counts, EmbreeEngine, Engine, GpuTraversal, Obvhs, OursCpu, OursWide, RaySet,
    Subject, compare,
};
use raytwin_tests::gpu::{Build, adapters};
use raytwin_tests::rays::families::{Expectation, Family, all, ray};
use raytwin_tests::rays::meshes::{
    Mesh, Random, displaced_sphere, lattice_cube, room, sliver_sphere, straight_hall, terrain,
    tilted_hall,
};
use raytwin_tests::scene::{Scene, kitchen, sponza_path, toy_room};

fn full() -> bool {
    std::env::var_os("RAYTWIN_FULL").is_some()
}

/// `quick` rays, or `long` with `RAYTWIN_FULL`.
fn number(quick: usize, long: usize) -> usize {
    if full() { long } else { quick }
}

/// The WGSL twin on every adapter: the plain build, and the precise one where
/// it can run.
fn traversals() -> &'static [GpuTraversal] {
    static ALL: OnceLock<Result<Vec<GpuTraversal>, String>> = OnceLock::new();
    let all = ALL.get_or_init(|| {
        let mut out = Vec::new();
        for gpu in adapters().map_err(|e| e.to_string())? {
            out.push(GpuTraversal::new(gpu, Build::Plain).map_err(|e| e.to_string())?);
            if gpu.has_precise() {
                out.push(GpuTraversal::new(gpu, Build::Precise).map_err(|e| e.to_string())?);
            }
        }
        Ok(out)
    });
    match all {
        Ok(all) => all,
        Err(message) => panic!("{message}"),
    }
}

fn subject(name: &str, mesh: &Mesh) -> Subject {
    let built = Subject::new(name, &mesh.positions, &mesh.indices, BuildQuality::Medium);
    let subject = built.expect("generated meshes are sound");
    assert_eq!(subject.bvh.validate(), Ok(()));
    subject
}

fn embree(subject: &Subject, robust: bool) -> EmbreeEngine {
    match EmbreeEngine::new(subject, robust) {
        Ok(engine) => engine,
        Err(error) => panic!("{error}"),
    }
}

const HEADER: &str = "| rays | engine | n | leaks | false | t off | weights off | t poor | \
                      weights poor | rims | ties | occlusion (errors) | causes |\n\
                      |---|---|---|---|---|---|---|---|---|---|---|---|---|";

fn row(name: &str, engine: &str, c: &Counts) -> String {
    format!(
        "| {name} | {engine} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} ({}) | {} |",
        c.rays,
        c.leaks,
        c.false_hits,
        c.t_off,
        c.weights_off,
        c.t_poor,
        c.weights_poor,
        c.rims,
        c.prim_ties,
        c.occlusion_mismatches,
        c.occlusion_errors,
        c.causes
    )
}

/// Ours must be without an error, a difference without a name, or an occlusion
/// query that contradicts the closest hit.
fn must_be_clean(name: &str, engine: &str, counts: &Counts, faults: &mut Vec<String>) {
    if counts.errors() + counts.unexplained + counts.contradictions > 0 {
        let examples = counts.examples.join("\n    ");
        faults.push(format!("{}\n    {examples}", row(name, engine, counts)));
    }
}

/// Every engine over one set: ours first, `(name, counts, ours)`.
fn run(subject: &Subject, set: &RaySet) -> Vec<(String, Counts, bool)> {
    let cpu = OursCpu(&subject.bvh);
    let wides = OursWide::all(&subject.bvh);
    let gpus: Vec<_> = traversals()
        .iter()
        .map(|t| t.engine(&subject.bvh))
        .collect();
    let plain = Obvhs::new(subject);
    let (fast, robust) = (embree(subject, false), embree(subject, true));
    let mut engines: Vec<&(dyn Engine + Sync)> = vec![&cpu];
    engines.extend(wides.iter().map(|w| w as &(dyn Engine + Sync)));
    engines.extend(gpus.iter().map(|g| g as &(dyn Engine + Sync)));
    engines.extend([&plain as &(dyn Engine + Sync), &fast, &robust]);
    engines
        .into_iter()
        .map(|e| (e.name(), compare(subject, set, e), e.strict()))
        .collect()
}

/// From inside a finely divided cube at points of its lattice edges, far away
/// compared with a square: the triangles' boxes end at the very edges that the
/// rays are aimed at, and have no thickness, so only the slab test's own margin
/// keeps them.
fn across_a_lattice(n: usize) -> Vec<Family> {
    [(64, Vec3::ZERO), (256, Vec3::new(0.3, -0.7, 0.1))]
        .into_iter()
        .map(|(size, offset)| {
            let mesh = lattice_cube(size).placed(1.0, offset);
            let mut random = Random::new(31);
            let rays = (0..n)
                .map(|_| {
                    let half = 0.45 * size as f32;
                    let mut part = || half * random.signed();
                    let origin = Vec3::new(part(), part(), part());
                    let c = mesh.corners(random.below(mesh.indices.len()));
                    let k = random.below(3);
                    let target = c[k] + (c[(k + 1) % 3] - c[k]) * random.unit();
                    ray(origin, target - origin)
                })
                .collect();
            Family {
                name: format!("edges across a cube of {size} squares"),
                mesh,
                rays,
                expect: Expectation::MustHit,
            }
        })
        .collect()
}

#[test]
fn hard_set_leaks_nothing() {
    let mut faults = Vec::new();
    let mut sums: Vec<(String, Counts)> = Vec::new();
    let mut controls: Vec<(String, String, usize, usize)> = Vec::new();
    println!("{HEADER}");
    let n = number(1_000, 20_000);
    for family in all(n).into_iter().chain(across_a_lattice(n)) {
        let subject = subject(&family.name, &family.mesh);
        let mut set = RaySet::new(&subject, family.rays).must_hit(&subject);
        if family.expect == Expectation::MustHitAgain {
            set = set.again();
        }
        let lost = set.truth.iter().filter(|t| t.is_none()).count();
        assert_eq!(lost, 0, "{}: is the mesh closed?", family.name);
        assert!(
            set.gaps * 1000 <= set.rays.len(),
            "{}: the reference itself has {} gaps",
            family.name,
            set.gaps
        );
        for (engine, counts, ours) in run(&subject, &set) {
            println!("{}", row(&family.name, &engine, &counts));
            if ours {
                must_be_clean(&family.name, &engine, &counts, &mut faults);
            } else if counts.unexplained > 0 {
                faults.push(format!(
                    "without a named cause: {}\n    {}",
                    row(&family.name, &engine, &counts),
                    counts.examples.join("\n    ")
                ));
            }
            match sums.iter_mut().find(|s| s.0 == engine) {
                Some(sum) => sum.1.add(&counts),
                None => sums.push((engine.clone(), counts.clone())),
            }
            controls.push((family.name.clone(), engine, counts.leaks, counts.rays));
        }
    }
    for (engine, counts) in &sums {
        println!("{}", row("all of the hard set", engine, counts));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    // The families are worth nothing if nobody fails them: what these tracers
    // are known to lose, at least.
    for (family, engine, least) in [
        ("edges, closed sphere", "obvhs", 0.03),
        ("vertices, closed sphere", "obvhs", 0.15),
        ("axes with either zero, lattice vertices", "obvhs", 0.4),
        ("diagonals with zeros, lattice vertices", "obvhs", 0.4),
        ("edges of slivers", "obvhs", 0.1),
        ("direction length 1e-10", "obvhs", 0.9),
        ("t_max at the hit, random", "obvhs", 0.9),
        ("edges, closed sphere", "Embree", 0.03),
        ("vertices, closed sphere", "Embree", 0.1),
        ("edges of slivers", "Embree", 0.04),
        ("vertices, closed sphere", "Embree robust", 0.001),
    ] {
        let seen = controls.iter().find(|c| c.0 == family && c.1 == engine);
        let (_, _, leaks, rays) = seen.unwrap_or_else(|| panic!("no row {family}, {engine}"));
        assert!(
            *leaks as f64 > least * *rays as f64,
            "{engine} loses only {leaks} of {rays} in `{family}`: do the families still see leaks?"
        );
    }
}

/// Random rays through one mesh, all engines.
fn random_rays_agree(subject: &Subject) {
    let n = number(20_000, 1_000_000);
    let mut faults = Vec::new();
    println!("{HEADER}");
    let mut sums: Vec<(String, Counts, bool)> = Vec::new();
    let mut left = n;
    let mut seed = 40;
    while left > 0 {
        let part = left.min(250_000);
        let set = RaySet::new(subject, subject.random_rays(part, seed));
        for (engine, counts, ours) in run(subject, &set) {
            match sums.iter_mut().find(|s| s.0 == engine) {
                Some(sum) => sum.1.add(&counts),
                None => sums.push((engine, counts, ours)),
            }
        }
        left -= part;
        seed += 1;
    }
    for (engine, counts, ours) in &sums {
        println!("{}", row(&subject.name, engine, counts));
        assert!(
            counts.hits > n / 10 && counts.hits < n,
            "{} of {n} rays hit: the set tests little",
            counts.hits
        );
        if *ours {
            must_be_clean(&subject.name, engine, counts, &mut faults);
        } else if counts.unexplained > 0 {
            faults.push(format!(
                "without a named cause: {}\n    {}",
                row(&subject.name, engine, counts),
                counts.examples.join("\n    ")
            ));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

fn scene_subject(name: &str, mesh: &raytwin_tests::scene::Mesh) -> Subject {
    Subject::new(name, &mesh.positions, &mesh.indices, BuildQuality::Medium)
        .unwrap_or_else(|e| panic!("{name}: {e}"))
}

#[test]
fn random_rays_kitchen() {
    let mesh = kitchen().unwrap_or_else(|e| panic!("{e}"));
    random_rays_agree(&scene_subject("kitchen", &mesh));
}

/// The file is not part of the repository. Where it is absent nothing is
/// tested, and the output says so.
#[test]
fn random_rays_sponza_if_present() {
    let Some(path) = sponza_path() else {
        eprintln!(
            "NOT RUN: no Sponza; put it at ../shared/meshes/sponza.obj or name it in \
             RAYTWIN_SPONZA"
        );
        return;
    };
    let scene = Scene::load(&path).unwrap_or_else(|e| panic!("{e}"));
    random_rays_agree(&scene_subject("sponza", &scene.mesh));
}

#[test]
fn random_rays_toy_room() {
    random_rays_agree(&scene_subject("toy room", &toy_room()));
}

#[test]
fn random_rays_generated_meshes() {
    for (name, mesh) in [
        ("displaced sphere, 100k", displaced_sphere(100_000)),
        ("terrain, 100k", terrain(100_000)),
        ("room with rods", room()),
        ("needle sphere", sliver_sphere(20_000)),
        ("lattice cube", lattice_cube(32)),
        ("tilted hall", tilted_hall()),
        ("straight hall", straight_hall()),
    ] {
        random_rays_agree(&subject(name, &mesh));
    }
}

/// The hit's words. WGSL lets `max(-0, 0)` be either zero, so a zero has no
/// sign here.
fn bits(a: &Answer) -> Option<[u32; 4]> {
    a.hit.map(|h| {
        let [u, v] = h.weights.expect("ours has weights");
        let [t, u, v] = [h.t, u, v].map(|x| if x == 0.0 { 0 } else { x.to_bits() });
        [t, u, v, h.primitive]
    })
}

/// Distance in representable numbers, both not negative.
fn ulp(a: f32, b: f32) -> u32 {
    a.to_bits().abs_diff(b.to_bits())
}

/// The two twins: the same bits in the precise build on a processor; in the
/// plain build, where a driver may rewrite float algebra, the same triangle,
/// and `t` within 4 ULP but for one ray in a thousand.
#[test]
fn twins_agree() {
    let mut sets: Vec<(Subject, Vec<Ray>)> = all(number(200, 20_000))
        .into_iter()
        .map(|f| (subject(&f.name, &f.mesh), f.rays))
        .collect();
    let rooms = scene_subject("kitchen", &kitchen().unwrap_or_else(|e| panic!("{e}")));
    let rays = rooms.random_rays(number(5_000, 500_000), 60);
    sets.push((rooms, rays));
    for traversal in traversals() {
        let mut name = String::new();
        let (mut rays, mut hit_or_miss, mut primitive, mut far) = (0, 0, 0, 0);
        let mut worst = 0;
        for (subject, set) in &sets {
            let gpu = traversal.engine(&subject.bvh);
            name = gpu.name();
            let cpu = OursCpu(&subject.bvh);
            for ((ray, a), b) in set.iter().zip(cpu.trace(set)).zip(gpu.trace(set)) {
                rays += 1;
                if traversal.is_bit_exact() {
                    assert_eq!(
                        (bits(&a), a.any),
                        (bits(&b), b.any),
                        "{name}, {}: {ray:?}",
                        subject.name
                    );
                }
                assert_eq!(b.any, b.hit.is_some(), "{name}, {}: {ray:?}", subject.name);
                match (a.hit, b.hit) {
                    (None, None) => {}
                    (Some(x), Some(y)) => {
                        primitive += usize::from(x.primitive != y.primitive);
                        if x.primitive == y.primitive {
                            worst = worst.max(ulp(x.t, y.t));
                            far += usize::from(ulp(x.t, y.t) > 4);
                        }
                    }
                    _ => hit_or_miss += 1,
                }
            }
        }
        println!(
            "{name}: {rays} rays, hit or miss differs {hit_or_miss}, primitive differs \
             {primitive} (each judged in the other tests), t beyond 4 ULP {far}, worst {worst}"
        );
        assert!(
            hit_or_miss * 100_000 <= rays,
            "{name}: {hit_or_miss} of {rays}"
        );
        assert!(far * 1000 <= rays, "{name}: t beyond 4 ULP {far} of {rays}");
    }
}

/// The tree of eight gives the scalar twin's answers, every bit of them, with
/// every kind of instructions.
#[test]
fn wide_levels_agree() {
    let mut sets: Vec<(Subject, Vec<Ray>)> = all(number(1_000, 50_000))
        .into_iter()
        .chain(across_a_lattice(number(20_000, 50_000)))
        .map(|f| (subject(&f.name, &f.mesh), f.rays))
        .collect();
    let rooms = scene_subject("kitchen", &kitchen().unwrap_or_else(|e| panic!("{e}")));
    let rays = rooms.random_rays(number(20_000, 1_000_000), 61);
    sets.push((rooms, rays));
    let word = |a: &Answer| {
        a.hit.map(|h| {
            let [u, v] = h.weights.expect("ours has weights");
            [h.t, u, v].map(f32::to_bits)
        })
    };
    let mut count = 0;
    for (subject, rays) in &sets {
        let truth = OursCpu(&subject.bvh).trace(rays);
        for wide in OursWide::all(&subject.bvh) {
            for ((ray, a), b) in rays.iter().zip(&truth).zip(wide.trace(rays)) {
                let (name, mesh) = (wide.name(), &subject.name);
                assert_eq!(word(a), word(&b), "{name}, {mesh}: {ray:?}");
                assert_eq!(a, &b, "{name}, {mesh}: {ray:?}");
                count += 1;
            }
            for (i, (a, b)) in truth.iter().zip(wide.trace_coherent(rays)).enumerate() {
                assert_eq!(word(a), word(&b), "{}: {:?}", wide.name(), rays[i]);
                assert_eq!(a, &b, "{}: {:?}", wide.name(), rays[i]);
            }
        }
    }
    println!("{count} rays with the scalar twin's bits");
}

fn sheet() -> Subject {
    let mesh = terrain(128);
    subject("terrain of 128", &mesh)
}

const LONG_LEAF: &str = "a leaf of four thousand million triangles";
const LONG_WALK: &str = "as many paths as 2^200";

/// A name, a broken tree, and whether a fault is the right one.
type Broken = (&'static str, Bvh, fn(&BvhFault) -> bool);

/// Broken trees, each with the fault that validation must name.
fn broken() -> Vec<Broken> {
    let good = sheet().bvh;
    let inner: Vec<usize> = (0..good.nodes.len())
        .filter(|&i| good.nodes[i].count == 0)
        .collect();
    let leaf = good.nodes.iter().position(|n| n.count > 0).expect("a leaf");
    let last = *inner.last().expect("an inner node");
    let mut out: Vec<Broken> = Vec::new();
    let mut edit = |name, change: &dyn Fn(&mut Bvh), fault| {
        let mut bvh = good.clone();
        change(&mut bvh);
        out.push((name, bvh, fault));
    };
    edit(
        "the root is its own child",
        &|b| b.nodes[0].first = 0,
        |f| matches!(f, BvhFault::Child { node: 0, child: 0 }),
    );
    edit(
        "a cycle through the last inner node",
        &|b| b.nodes[last].first = 1,
        |f| matches!(f, BvhFault::Child { child: 1, .. }),
    );
    edit(
        "every node its own child",
        &|b| {
            for (i, n) in b.nodes.iter_mut().enumerate() {
                (n.first, n.count) = (i as u32, 0);
            }
        },
        |f| matches!(f, BvhFault::Child { node: 0, .. }),
    );
    edit(
        "a child past the end",
        &|b| b.nodes[0].first = u32::MAX,
        |f| {
            matches!(
                f,
                BvhFault::Child {
                    node: 0,
                    child: u32::MAX
                }
            )
        },
    );
    edit(
        "triangles past the end",
        &|b| b.nodes[leaf].first = u32::MAX - 1,
        |f| matches!(f, BvhFault::Range { .. }),
    );
    edit(LONG_LEAF, &|b| b.nodes[leaf].count = u32::MAX, |f| {
        matches!(
            f,
            BvhFault::Range {
                count: u32::MAX,
                ..
            }
        )
    });
    edit(
        "NaN in every box",
        &|b| {
            for n in &mut b.nodes {
                n.min = Vec3::NAN;
            }
        },
        |f| matches!(f, BvhFault::Box { node: 0, .. }),
    );
    edit("NaN in one box", &|b| b.nodes[last].max.y = f32::NAN, |f| {
        matches!(f, BvhFault::Box { .. })
    });
    edit(
        "infinite boxes",
        &|b| b.nodes[leaf].min = Vec3::INFINITY,
        |f| matches!(f, BvhFault::Box { .. }),
    );
    edit(
        "one triangle twice",
        &|b| b.triangles[0].primitive = b.triangles[1].primitive,
        |f| matches!(f, BvhFault::Primitive { .. }),
    );
    // Both children of each pair are inner and lead to the pairs after it: the
    // number of paths doubles with each level.
    let root = good.nodes[0];
    edit(
        LONG_WALK,
        &|b| {
            b.nodes = (0..401u32)
                .map(|i| BvhNode {
                    first: if i == 0 { 1 } else { ((i + 1) & !1) | 1 },
                    count: 0,
                    ..root
                })
                .collect();
        },
        |f| matches!(f, BvhFault::Child { .. } | BvhFault::Parents { .. }),
    );
    // A comb: each left child is an empty leaf far away, so only depth counts.
    edit(
        "a hundred levels",
        &|b| {
            b.nodes = vec![BvhNode {
                first: 1,
                count: 0,
                ..root
            }];
            for level in 0..100u32 {
                let next = if level == 99 { 1 } else { 2 * level + 3 };
                b.nodes.push(BvhNode {
                    first: next,
                    count: u32::from(level == 99),
                    ..root
                });
                b.nodes.push(BvhNode {
                    first: level % 100,
                    count: 1,
                    ..root
                });
            }
        },
        |_| true,
    );
    out
}

#[test]
fn broken_trees_end() {
    let subject = sheet();
    let rays = subject.random_rays(64, 70);
    // Four rays down to a triangle of the first leaf.
    let leaf = subject.bvh.nodes.iter().find(|n| n.count > 0);
    let target = subject.bvh.triangles[leaf.expect("a leaf").first as usize];
    let into_leaf: Vec<_> = (1..5)
        .map(|i| Ray {
            origin: (target.a + target.b + target.c) / 3.0 + Vec3::Y * i as f32,
            direction: -Vec3::Y,
            t_min: 0.0,
            t_max: f32::MAX,
        })
        .collect();
    let check = |name: &str, engine: &str, answers: &[Answer], start: Instant| {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "{engine}, {name}: {:?}",
            start.elapsed()
        );
        for a in answers {
            if let Some(h) = a.hit {
                assert!(
                    (h.primitive as usize) < subject.indices.len(),
                    "{engine}, {name}: {h:?}"
                );
            }
        }
    };
    for (name, bvh, named) in broken() {
        let fault = bvh.validate().expect_err(name);
        assert!(named(&fault), "{name}: {fault}");
        let start = Instant::now();
        let answers = OursCpu(&bvh).trace(&rays);
        check(name, "CPU", &answers, start);
        // Where each ray takes all of the 2^22 steps, a slow processor that
        // plays the GPU needs seconds for each: four rays, and one build.
        let long = [LONG_LEAF, LONG_WALK].contains(&name);
        let rays = if long { &into_leaf } else { &rays };
        for traversal in traversals() {
            if long && traversal.build() == Build::Precise {
                continue;
            }
            let start = Instant::now();
            let gpu = traversal.engine(&bvh);
            let answers = gpu.trace(rays);
            println!("{name}, {}: {:?}, {fault}", gpu.name(), start.elapsed());
            check(name, &gpu.name(), &answers, start);
        }
    }
}

#[test]
fn no_triangles_no_hits() {
    let empty = Bvh::default();
    assert_eq!(empty.validate(), Ok(()));
    let rays = sheet().random_rays(64, 71);
    for &ray in &rays {
        assert_eq!(bvh_closest(&empty.view(), ray).primitive, BVH_MISS);
    }
    for traversal in traversals() {
        for answer in traversal.engine(&empty).trace(&rays) {
            assert_eq!((answer.hit, answer.any), (None, false));
        }
    }
}

/// The reference walks our tree; on these rays it also asks every triangle.
#[test]
fn the_reference_needs_no_tree() {
    use raytwin_tests::rays::reference::reference_triangle;
    for family in all(20) {
        let subject = subject(&family.name, &family.mesh);
        let set = RaySet::new(&subject, family.rays);
        for (&ray, truth) in set.rays.iter().zip(&set.truth) {
            let best = (0..family.mesh.indices.len())
                .filter_map(|i| {
                    let [a, b, c] = family.mesh.corners(i);
                    reference_triangle(ray, a, b, c)
                })
                .map(|(t, _, _)| t)
                .filter(|&t| t >= f64::from(ray.t_min) && t <= f64::from(ray.t_max))
                .reduce(f64::min);
            // Among ties the reference takes the lowest index.
            let (best, found) = (best.expect("a hit"), truth.as_ref().expect("a hit").t);
            assert!(
                (best - found).abs() <= 1e-12 * best,
                "{}: {ray:?}: {best} {found}",
                family.name
            );
        }
    }
}

/// An engine that answers wrongly on purpose: each kind must be counted.
struct Wrong<'a>(OursCpu<'a>, fn(usize, &mut Answer));

impl Engine for Wrong<'_> {
    fn name(&self) -> String {
        "wrong".into()
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        let mut answers = self.0.trace(rays);
        for (i, a) in answers.iter_mut().enumerate().filter(|(i, _)| i % 10 == 0) {
            self.1(i, a);
        }
        answers
    }
}

#[test]
fn every_kind_of_error_is_counted() {
    let subject = subject("sphere", &displaced_sphere(2_000));
    let rays = all(1_000).swap_remove(0).rays;
    let set = RaySet::new(&subject, rays);
    let count = |change| compare(&subject, &set, &Wrong(OursCpu(&subject.bvh), change));
    let none = count(|_, _| {});
    assert_eq!(
        (none.errors(), none.disagreements(), none.hits),
        (0, 0, 1000)
    );
    assert_eq!(count(|_, a| a.hit = None).leaks, 100);
    assert_eq!(count(|_, a| a.hit = None).contradictions, 100);
    assert_eq!(count(|_, a| a.any = false).occlusion_errors, 100);
    let behind = count(|_, a| a.hit.as_mut().expect("a hit").t *= 1.001);
    assert!(behind.t_off > 95, "{behind:?}");
    let other = count(|i, a| a.hit.as_mut().expect("a hit").primitive = i as u32);
    assert!(other.false_hits > 90, "{other:?}");
    assert!(other.unexplained > 90, "{other:?}");
    let weights = count(|_, a| {
        a.hit
            .as_mut()
            .expect("a hit")
            .weights
            .as_mut()
            .expect("weights")[0] += 0.01;
    });
    assert_eq!(weights.weights_off, 100);
    let outside = count(|_, a| a.hit.as_mut().expect("a hit").t *= -1.0);
    assert_eq!(outside.false_hits, 100);
    // Rays that go away from a sphere: everything that hits is false.
    let away: Vec<_> = (0..1_000)
        .map(|i| Ray {
            origin: Vec3::new(3.0, 0.001 * i as f32, 0.0),
            direction: Vec3::X,
            t_min: 0.0,
            t_max: f32::MAX,
        })
        .collect();
    let set = RaySet::new(&subject, away);
    let false_any = compare(
        &subject,
        &set,
        &Wrong(OursCpu(&subject.bvh), |_, a| a.any = true),
    );
    assert_eq!((false_any.hits, false_any.occlusion_errors), (0, 100));
    assert_eq!(false_any.causes.of(Cause::Unexplained), 0);
    assert_eq!(false_any.unexplained, 100);
}

/// Runs one of the tests above in a process of its own, in an environment
/// where it must fail, and returns what it printed.
fn failing(test: &str, variable: &str, value: &str) -> String {
    let this = std::env::current_exe().expect("the test's own path");
    let output = Command::new(this)
        .args(["--exact", test, "--nocapture"])
        .env_remove("RAYTWIN_FULL")
        .env(variable, value)
        .output()
        .expect("the test runs");
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success(),
        "{test} passed with {variable}={value}: {text}"
    );
    text.into_owned()
}

#[test]
fn a_missing_adapter_fails_with_the_mend() {
    let text = failing("no_triangles_no_hits", "RAYTWIN_ADAPTER", "no such adapter");
    assert!(
        text.contains("RAYTWIN_ADAPTER is `no such adapter`, but the adapters present are"),
        "{text}"
    );
    if cfg!(target_os = "linux") {
        let text = failing(
            "no_triangles_no_hits",
            "VK_DRIVER_FILES",
            "/no/such/driver.json",
        );
        assert!(text.contains("cargo xtask setup"), "{text}");
    }
}

#[test]
fn a_missing_embree_fails_with_the_mend() {
    let text = failing(
        "random_rays_toy_room",
        "EMBREE_LIB",
        "/no/such/libembree4.so",
    );
    assert!(text.contains("Embree 4 was not found"), "{text}");
    assert!(text.contains("cargo xtask setup"), "{text}");
}
