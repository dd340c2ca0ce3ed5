//! Rays per second through the tree of eight, beside Embree and the scalar twin.
//!
//! `cargo run --release -p raytwin-bench --example rays -- MESH… [--rays N] [--rounds N]
//! [--threads N]`, beside tinybvh too where `cargo xtask report` has built it.
//!
//! With `--growth MOST` instead of meshes: spheres and terrains of a thousand
//! up to MOST triangles, the cost of a ray fitted to the logarithm of their
//! number, build time and memory a triangle.

use std::hint::black_box;
use std::time::Instant;

use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin_bench::report::bvh::{RaySets, generated, ray8};
use raytwin_bench::tinybvh::{Tinybvh, TinybvhTree};
use raytwin_cpu::pass::bvh8::{Bvh8, Level};
use raytwin_cpu::ray::bvh::{BVH_MISS, bvh_any, bvh_closest};
use raytwin_cpu::ray::ray::Ray;
use raytwin_tests::embree::{EmbreeOptions, EmbreeRay, EmbreeScene};
use raytwin_tests::rays::meshes;
use raytwin_tests::scene::{Mesh, Scene, sponza_path};

fn load(name: &str) -> Scene {
    let whole = |mesh: meshes::Mesh, like: &str| {
        let mut scene = generated(like).expect("generated");
        scene.name = name.into();
        scene.mesh = Mesh {
            positions: mesh.positions,
            indices: mesh.indices,
            skipped: 0,
        };
        scene
    };
    match name {
        "kitchen" => Scene::kitchen().expect("kitchen"),
        "toy" => Scene::toy_room(),
        "sponza" => Scene::load(sponza_path().expect("sponza")).expect("sponza"),
        "sphere10k" => whole(meshes::displaced_sphere(10_000), "sphere"),
        "sphere1m" => whole(meshes::displaced_sphere(1_000_000), "sphere"),
        "hare" => whole(meshes::hare(70_000), "sphere"),
        "terrain10k" => whole(meshes::terrain(10_000), "terrain"),
        "terrain1m" => whole(meshes::terrain(1_000_000), "terrain"),
        _ => generated(name).expect("a mesh"),
    }
}

fn time(rays: &[Ray], f: &(dyn Fn(&[Ray]) -> usize + Sync)) -> (f64, usize) {
    time_on(rays, f, 1)
}

/// Each thread takes as many neighbouring rays as the others.
fn time_on(rays: &[Ray], f: &(dyn Fn(&[Ray]) -> usize + Sync), threads: usize) -> (f64, usize) {
    let start = Instant::now();
    let rays = black_box(rays);
    let n = if threads <= 1 {
        f(rays)
    } else {
        let part = rays.len().div_ceil(threads).max(1);
        std::thread::scope(|scope| {
            let parts: Vec<_> = rays
                .chunks(part)
                .map(|rays| scope.spawn(|| f(rays)))
                .collect();
            parts.into_iter().map(|p| p.join().expect("a thread")).sum()
        })
    };
    (start.elapsed().as_secs_f64(), black_box(n))
}

type Sweep<'a> = Box<dyn Fn(&[Ray]) -> usize + Sync + 'a>;

enum Way<'a> {
    /// Closest and any hit.
    Here([Sweep<'a>; 2]),
    /// In its own process.
    Tinybvh(TinybvhTree),
}

impl Way<'_> {
    fn time(&self, rays: &[Ray], any: bool, threads: usize) -> (f64, usize) {
        match self {
            Way::Here(sweeps) => time_on(rays, &sweeps[usize::from(any)], threads),
            Way::Tinybvh(tree) => {
                let rays: Vec<_> = rays.iter().map(ray8).collect();
                let traced = tree.trace(&rays, any, false, threads).expect("tinybvh");
                (traced.seconds, traced.hits)
            }
        }
    }
}

/// Nanoseconds a ray as `a + b · log2(triangles)`, and how much of their spread
/// that explains.
fn fit(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let n = points.len() as f64;
    let mean = |f: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(&|p| p.0), mean(&|p| p.1));
    let xx = mean(&|p| (p.0 - mx).powi(2));
    let xy = mean(&|p| (p.0 - mx) * (p.1 - my));
    let yy = mean(&|p| (p.1 - my).powi(2));
    let b = xy / xx;
    (my - b * mx, b, xy * xy / (xx * yy))
}

/// Memory of this process in bytes, where the system tells it. Its growth is
/// rough: what was freed before and is used again does not show.
fn resident() -> f64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = text.split(' ').nth(1).and_then(|v| v.parse::<f64>().ok());
    pages.unwrap_or(f64::NAN) * 4096.0
}

fn growth(most: usize, count: usize, rounds: usize) {
    for kind in ["sphere", "terrain"] {
        println!("{kind}: ns a ray, primary shadow diffuse AO");
        let mut curves: [[Vec<(f64, f64)>; 4]; 2] = Default::default();
        let mut size = 1_000;
        while size <= most {
            let mesh = match kind {
                "sphere" => meshes::displaced_sphere(size),
                _ => meshes::terrain(size),
            };
            let mut scene = generated(kind).expect("generated");
            scene.mesh = Mesh {
                positions: mesh.positions,
                indices: mesh.indices,
                skipped: 0,
            };
            let mesh = &scene.mesh;
            let n = mesh.indices.len() as f64;
            let start = Instant::now();
            let bvh = Bvh::build(&mesh.positions, &mesh.indices, BuildQuality::Fast).expect("tree");
            let wide = bvh.wide().expect("a tree");
            let ours_ms = start.elapsed().as_secs_f64() * 1e3;
            let positions: Vec<_> = mesh.positions.iter().map(|p| p.to_array()).collect();
            let options = EmbreeOptions {
                threads: 1,
                ..EmbreeOptions::default()
            };
            let before = resident();
            let embree = EmbreeScene::new(&positions, &mesh.indices, options).expect("Embree");
            let theirs = resident() - before;
            let sets = RaySets::new(&scene, &bvh, count);
            let ray = |r: &Ray| EmbreeRay {
                origin: r.origin.to_array(),
                direction: r.direction.to_array(),
                t_min: r.t_min,
                t_max: r.t_max,
            };
            let mut best = [[f64::INFINITY; 4]; 2];
            for _ in 0..rounds {
                for (k, (rays, any)) in sets.all().into_iter().enumerate() {
                    let ours = |rs: &[Ray]| {
                        let hit = |r: &&Ray| {
                            if any {
                                wide.any(r)
                            } else {
                                wide.closest(r).primitive != BVH_MISS
                            }
                        };
                        rs.iter().filter(hit).count()
                    };
                    let other = |rs: &[Ray]| {
                        let hit = |r: &&Ray| {
                            if any {
                                embree.occluded(&ray(r))
                            } else {
                                embree.intersect(&ray(r)).is_some()
                            }
                        };
                        rs.iter().filter(hit).count()
                    };
                    best[0][k] = best[0][k].min(time(rays, &ours).0);
                    best[1][k] = best[1][k].min(time(rays, &other).0);
                }
            }
            let ns = best.map(|row| row.map(|s| s * 1e9 / count as f64));
            println!(
                "{n:8} ours {:5.0} {:5.0} {:5.0} {:5.0}, build {ours_ms:7.1} ms, {:3.0} bytes a \
                 triangle; Embree {:5.0} {:5.0} {:5.0} {:5.0}, build {:7.1} ms, {:3.0} bytes",
                ns[0][0],
                ns[0][1],
                ns[0][2],
                ns[0][3],
                wide.bytes() as f64 / n,
                ns[1][0],
                ns[1][1],
                ns[1][2],
                ns[1][3],
                embree.build_time().as_secs_f64() * 1e3,
                theirs / n,
            );
            for (curve, row) in curves.iter_mut().zip(ns) {
                for (points, ns) in curve.iter_mut().zip(row) {
                    points.push((n.log2(), ns));
                }
            }
            size *= 4;
        }
        for (name, curve) in ["ours", "Embree"].iter().zip(&curves) {
            for (ray, points) in ["primary", "shadow", "diffuse", "AO"].iter().zip(curve) {
                let (a, b, r2) = fit(points);
                println!("  {name} {ray}: {a:.0} + {b:.1} log2(n) ns, R2 {r2:.3}");
            }
        }
    }
}

fn main() {
    let mut names = Vec::new();
    let (mut count, mut rounds) = (1usize << 16, 7usize);
    let (mut most, mut threads) = (0usize, 1usize);
    let (mut only, mut quality) = (String::new(), BuildQuality::Medium);
    let mut args = std::env::args().skip(1);
    while let Some(a) = args.next() {
        match a.as_str() {
            "--rays" => count = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--rounds" => rounds = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--threads" => threads = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--growth" => most = args.next().and_then(|v| v.parse().ok()).expect("a number"),
            "--only" => only = args.next().expect("a name"),
            "--fast" => quality = BuildQuality::Fast,
            "--fastest" => quality = BuildQuality::Fastest,
            "--slow" => quality = BuildQuality::VerySlow,
            _ => names.push(a),
        }
    }
    if most > 0 {
        growth(most, count, rounds);
        return;
    }
    let tinybvh = Tinybvh::find();
    match &tinybvh {
        Ok(t) => println!("tinybvh {}", t.version),
        Err(error) => println!("without tinybvh: {error}"),
    }
    let mut sums: Vec<(String, [f64; 4], usize)> = Vec::new();
    for name in names {
        let scene = load(&name);
        let mesh = &scene.mesh;
        let start = Instant::now();
        let bvh = Bvh::build(&mesh.positions, &mesh.indices, quality).expect("a tree");
        let binary_ms = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        let wide = bvh.wide().expect("a tree");
        let collapse_ms = start.elapsed().as_secs_f64() * 1e3;
        let positions: Vec<_> = mesh.positions.iter().map(|p| p.to_array()).collect();
        let embree = |robust| {
            let options = EmbreeOptions {
                robust,
                threads: 1,
                ..EmbreeOptions::default()
            };
            EmbreeScene::new(&positions, &mesh.indices, options).expect("Embree")
        };
        let (plain, robust) = (embree(false), embree(true));
        println!(
            "{name}: {} triangles, binary {binary_ms:.1} ms, collapse {collapse_ms:.1} ms, \
             Embree {:.1} ms, {:.0} bytes a triangle, {:.2} children a node, \
             {:.2} triangles a block",
            mesh.indices.len(),
            plain.build_time().as_secs_f64() * 1e3,
            wide.bytes() as f64 / mesh.indices.len() as f64,
            wide.fill().0,
            wide.fill().1,
        );
        let sets = RaySets::new(&scene, &bvh, count);
        let ray = |r: &Ray| EmbreeRay {
            origin: r.origin.to_array(),
            direction: r.direction.to_array(),
            t_min: r.t_min,
            t_max: r.t_max,
        };
        let view = bvh.view();
        let wides: Vec<(String, Bvh8)> = Level::all()
            .into_iter()
            .map(|l| (format!("wide {}", l.name()), wide.clone().with_level(l)))
            .collect();
        // Without a place on the heap for each packet.
        let packet = |rs: &[Ray]| -> [EmbreeRay; 16] {
            std::array::from_fn(|i| ray(&rs[i.min(rs.len() - 1)]))
        };
        let mut engines: Vec<(String, Way)> = vec![
            (
                "Embree".into(),
                Way::Here([
                    Box::new(|rs| {
                        rs.iter()
                            .filter(|r| plain.intersect(&ray(r)).is_some())
                            .count()
                    }),
                    Box::new(|rs| rs.iter().filter(|r| plain.occluded(&ray(r))).count()),
                ]),
            ),
            (
                "Embree robust".into(),
                Way::Here([
                    Box::new(|rs| {
                        rs.iter()
                            .filter(|r| robust.intersect(&ray(r)).is_some())
                            .count()
                    }),
                    Box::new(|rs| rs.iter().filter(|r| robust.occluded(&ray(r))).count()),
                ]),
            ),
            (
                "binary".into(),
                Way::Here([
                    Box::new(|rs| {
                        rs.iter()
                            .filter(|r| bvh_closest(&view, **r).primitive != BVH_MISS)
                            .count()
                    }),
                    Box::new(|rs| rs.iter().filter(|r| bvh_any(&view, **r) != 0).count()),
                ]),
            ),
        ];
        for (name, wide) in &wides {
            engines.push((
                name.clone(),
                Way::Here([
                    Box::new(|rs| {
                        rs.iter()
                            .filter(|r| wide.closest(r).primitive != BVH_MISS)
                            .count()
                    }),
                    Box::new(|rs| rs.iter().filter(|r| wide.any(r)).count()),
                ]),
            ));
        }
        engines.push((
            "coherent".into(),
            Way::Here([
                Box::new(|rs| {
                    let hits = wide.closest_coherent(rs);
                    hits.iter().filter(|h| h.primitive != BVH_MISS).count()
                }),
                Box::new(|rs| wide.any_coherent(rs).iter().filter(|h| **h).count()),
            ]),
        ));
        engines.push((
            "Embree packets".into(),
            Way::Here([
                Box::new(|rs| {
                    rs.chunks(16)
                        .map(|rs| {
                            let hits = plain.intersect16(&packet(rs)[..rs.len()], true);
                            hits.iter().flatten().count()
                        })
                        .sum()
                }),
                Box::new(|rs| {
                    rs.chunks(16)
                        .map(|rs| {
                            let hits = plain.occluded16(&packet(rs)[..rs.len()], true);
                            hits.iter().filter(|h| **h).count()
                        })
                        .sum()
                }),
            ]),
        ));
        if let Ok(tinybvh) = &tinybvh {
            for (name, high) in [("tinybvh", false), ("tinybvh HQ", true)] {
                let tree = tinybvh
                    .tree(&positions, &mesh.indices, high)
                    .expect("a tree");
                println!("  {name} {:.1} ms", tree.build_ms);
                engines.push((name.into(), Way::Tinybvh(tree)));
            }
        }
        engines.retain(|e| {
            e.0 == "Embree" || only.is_empty() || only.split(',').any(|o| e.0.contains(o))
        });
        let mut best = vec![[f64::INFINITY; 4]; engines.len()];
        for _ in 0..rounds {
            for (k, (rays, any)) in sets.all().into_iter().enumerate() {
                for ((_, f), best) in engines.iter().zip(&mut best) {
                    best[k] = best[k].min(f.time(rays, any, threads).0);
                }
            }
        }
        for ((name, _), b) in engines.iter().zip(&best) {
            let ratio: [f64; 4] = std::array::from_fn(|k| best[0][k] / b[k]);
            let mrays = b.map(|s| count as f64 / s * 1e-6);
            println!(
                "  {name:16} {:6.2} {:6.2} {:6.2} {:6.2} Mrays/s   {:.2} {:.2} {:.2} {:.2}  mean {:.2}",
                mrays[0],
                mrays[1],
                mrays[2],
                mrays[3],
                ratio[0],
                ratio[1],
                ratio[2],
                ratio[3],
                ratio.iter().product::<f64>().powf(0.25)
            );
            let sum = match sums.iter_mut().position(|s| s.0 == *name) {
                Some(i) => &mut sums[i],
                None => {
                    sums.push((name.clone(), [0.0; 4], 0));
                    sums.last_mut().expect("just pushed")
                }
            };
            for (log, r) in sum.1.iter_mut().zip(ratio) {
                *log += r.ln();
            }
            sum.2 += 1;
        }
    }
    for (name, logs, n) in sums {
        let m = logs.map(|l| (l / n as f64).exp());
        println!(
            "{name:18} primary {:.2} shadow {:.2} diffuse {:.2} ao {:.2}  all {:.3}",
            m[0],
            m[1],
            m[2],
            m[3],
            m.iter().product::<f64>().powf(0.25)
        );
    }
}
