//! The table of traversal engines: build, speed, and what they get wrong.

use std::cell::RefCell;
use std::hint::black_box;
use std::rc::Rc;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use embree4_sys::RTCBuildQuality;
use glam::{Vec2, Vec3};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin_cpu::pass::bvh8::Bvh8;
use raytwin_cpu::random::pcg::pcg_hash;
use raytwin_cpu::ray::bvh::{BVH_MISS, bvh_any, bvh_closest};
use raytwin_cpu::ray::camera::{Camera, camera_ray};
use raytwin_cpu::ray::ray::{Ray, ray_at};
use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_world};
use raytwin_cpu::sample::hemisphere::hemisphere_cosine_sample;
use raytwin_tests::crosscheck::{self, Answer, Counts, RaySet, Subject, compare};
use raytwin_tests::embree::{EmbreeOptions, EmbreeRay, EmbreeScene};
use raytwin_tests::gpu::Gpu;
use raytwin_tests::rays::families::{Expectation, Family};
use raytwin_tests::rays::meshes;
use raytwin_tests::scene::{Mesh, Scene};

use crate::tinybvh::{Ray8, Tinybvh, TinybvhError, TinybvhTree, Traced};

use super::error::ReportError;
use super::kernels::median;
use super::schema::{BuildRow, BvhRow, FamilyRow, GrowthRow, Rates, StackRow};
use super::traversal::{SMALL_WORKGROUP, Stack, Traversal, TraversalMesh, WORKGROUP};

/// How much to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BvhSettings {
    /// Rays of each kind.
    pub rays: usize,
    /// Rounds over all engines; the median counts.
    pub rounds: usize,
    /// Rays of each mesh that are checked against the f64 intersector.
    pub checked: usize,
    /// Rays of each hard family.
    pub family_rays: usize,
    /// Rays of each mesh that are aimed at its edges and vertices.
    pub aimed: usize,
    /// Triangles of the largest sphere whose rays' cost is measured.
    pub largest: usize,
}

impl BvhSettings {
    /// For the quick report.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            rays: 1 << 14,
            rounds: 3,
            checked: 1 << 12,
            family_rays: 1_000,
            aimed: 1 << 12,
            largest: 1 << 18,
        }
    }

    /// For the long run.
    #[must_use]
    pub fn full() -> Self {
        Self {
            rays: 1 << 18,
            rounds: 9,
            checked: 1 << 18,
            family_rays: 50_000,
            aimed: 1 << 16,
            largest: 1 << 22,
        }
    }
}

/// Which engines take part. The peers always do, where they are there.
pub(super) struct Engines<'a> {
    /// Ours and obvhs's on the CPU.
    pub cpu: bool,
    /// Whether Embree was found.
    pub embree: bool,
    /// tinybvh, where it was built.
    pub tinybvh: Option<Tinybvh>,
    /// Where tinybvh gave up, and why.
    pub failures: Rc<RefCell<Vec<String>>>,
    /// Ours on adapters.
    pub(super) gpu: Vec<Traversal<'a>>,
}

impl Engines<'_> {
    fn fails(&self, mesh: &str, why: &str) {
        let failure = format!("tinybvh is left out in {mesh}: {why}.");
        self.failures.borrow_mut().push(failure);
    }

    /// Whether what the engine said counts; if not, that is noted.
    fn counts(&self, mesh: &str, engine: &Engine<'_>) -> bool {
        match engine.failure() {
            Some(why) => {
                self.fails(mesh, &why);
                false
            }
            None => true,
        }
    }
}

/// Names of the generated meshes.
pub const GENERATED: [&str; 5] = ["sphere", "slivers", "terrain", "room", "hare"];

/// Names of those that the long run has besides.
pub const GENERATED_FULL: [&str; 5] = [
    "sphere-10k",
    "sphere-100k",
    "sphere-1m",
    "terrain-10k",
    "terrain-1m",
];

/// A generated mesh with a view of it.
#[must_use]
pub fn generated(name: &str) -> Option<Scene> {
    let mesh = match name {
        "sphere" => meshes::displaced_sphere(80_000),
        "sphere-10k" => meshes::displaced_sphere(10_000),
        "sphere-100k" => meshes::displaced_sphere(100_000),
        "sphere-1m" => meshes::displaced_sphere(1_000_000),
        "hare" => meshes::hare(70_000),
        "terrain-10k" => meshes::terrain(10_000),
        "terrain-1m" => meshes::terrain(1_000_000),
        "slivers" => meshes::sliver_sphere(40_000),
        "terrain" => meshes::terrain(100_000),
        "room" => meshes::room(),
        _ => return None,
    };
    let mesh = Mesh {
        positions: mesh.positions,
        indices: mesh.indices,
        skipped: 0,
    };
    let mut scene = Scene::seen_whole(name.into(), mesh);
    // Near enough to fill the picture: rays into the sky measure nothing. The
    // room is closed and seen from inside.
    let (eye, target, fov_degrees) = match name {
        "terrain" | "terrain-10k" | "terrain-1m" => ([8.0, 4.0, 9.0], [0.0, -2.0, 0.0], 45.0),
        "room" => ([3.7, 1.2, 2.7], [-1.0, -0.4, -0.6], 70.0),
        _ => ([0.96, 0.72, 1.6], [0.0, 0.0, 0.0], 50.0),
    };
    scene.camera.eye = Vec3::from_array(eye);
    scene.camera.target = Vec3::from_array(target);
    scene.camera.fov_degrees = fov_degrees;
    Some(scene)
}

type Hit = Option<(f32, u32)>;

/// obvhs as its users run it: its traversal with its own triangle test.
struct Obvhs {
    bvh: Bvh2,
    triangles: Vec<RtTriangle>,
}

impl Obvhs {
    fn new(positions: &[Vec3], indices: &[[u32; 3]]) -> Self {
        let triangles: Vec<Triangle> = indices
            .iter()
            .map(|t| {
                let [v0, v1, v2] = t.map(|i| positions[i as usize].into());
                Triangle { v0, v1, v2 }
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

    fn ray(ray: &Ray) -> ObvhsRay {
        ObvhsRay::new(
            ray.origin.into(),
            ray.direction.into(),
            ray.t_min,
            ray.t_max,
        )
    }

    fn closest(&self, ray: &Ray) -> Hit {
        let mut hit = RayHit::none();
        self.bvh
            .ray_traverse(Self::ray(ray), &mut hit, |r, i| {
                self.triangles[i].intersect(r)
            })
            .then(|| (hit.t, self.bvh.primitive_indices[hit.primitive_id as usize]))
    }

    fn any(&self, ray: &Ray) -> bool {
        !self
            .bvh
            .ray_traverse_miss(Self::ray(ray), |r, i| self.triangles[i].intersect(r))
    }
}

fn embree_ray(ray: &Ray) -> EmbreeRay {
    EmbreeRay {
        origin: ray.origin.to_array(),
        direction: ray.direction.to_array(),
        t_min: ray.t_min,
        t_max: ray.t_max,
    }
}

enum Kind<'a> {
    Cpu(&'a Bvh),
    Wide(Bvh8),
    Obvhs(Obvhs),
    Embree(EmbreeScene),
    Tinybvh(Peer),
    Gpu(TraversalMesh<'a>),
}

/// A tree of tinybvh, and whether its process has ended.
struct Peer {
    tree: TinybvhTree,
    failure: OnceLock<TinybvhError>,
}

impl Peer {
    fn new(tree: TinybvhTree) -> Self {
        Self {
            tree,
            failure: OnceLock::new(),
        }
    }

    /// What came of the rays; nothing once the process has ended.
    fn trace(&self, rays: &[Ray], any: bool, listed: bool, threads: usize) -> Option<Traced> {
        if self.failure.get().is_some() {
            return None;
        }
        let rays: Vec<Ray8> = rays.iter().map(ray8).collect();
        match self.tree.trace(&rays, any, listed, threads) {
            Ok(traced) => Some(traced),
            Err(error) => {
                // One that was there before says as much.
                let _ = self.failure.set(error);
                None
            }
        }
    }
}

/// tinybvh has no `t_min`: a ray starts where it is that far along, which a
/// rounding may move.
#[must_use]
pub fn ray8(ray: &Ray) -> Ray8 {
    let (o, d) = (ray.origin + ray.direction * ray.t_min, ray.direction);
    let t_max = ray.t_max - ray.t_min;
    [o.x, o.y, o.z, d.x, d.y, d.z, 0.0, t_max]
}

struct Engine<'a> {
    name: String,
    build_ms: Option<f64>,
    kind: Kind<'a>,
}

/// Runs `f` over all rays: seconds, and how many hit.
fn sweep(rays: &[Ray], threads: usize, f: impl Fn(&Ray) -> bool + Sync) -> (f64, usize) {
    let count = |rays: &[Ray]| black_box(rays).iter().filter(|r| f(r)).count();
    let start = Instant::now();
    let hits = match threads {
        1 => count(rays),
        _ => rays.par_chunks(RAYS_A_PIECE).map(count).sum(),
    };
    (start.elapsed().as_secs_f64(), black_box(hits))
}

/// Rays that a thread takes at a time.
const RAYS_A_PIECE: usize = 512;

/// All threads: those of rayon's pool, as the batch functions use them.
fn all_threads() -> usize {
    rayon::current_num_threads()
}

impl Engine<'_> {
    /// Seconds for all rays, on one thread or on all of them, and how many hit.
    fn time(&self, rays: &[Ray], any: bool, threads: usize) -> (f64, usize) {
        match (&self.kind, any) {
            (Kind::Cpu(bvh), false) => {
                let view = bvh.view();
                sweep(rays, threads, |r| {
                    bvh_closest(&view, *r).primitive != BVH_MISS
                })
            }
            (Kind::Cpu(bvh), true) => {
                let view = bvh.view();
                sweep(rays, threads, |r| bvh_any(&view, *r) != 0)
            }
            (Kind::Wide(w), false) => sweep(rays, threads, |r| w.closest(r).primitive != BVH_MISS),
            (Kind::Wide(w), true) => sweep(rays, threads, |r| w.any(r)),
            (Kind::Obvhs(o), false) => sweep(rays, threads, |r| o.closest(r).is_some()),
            (Kind::Obvhs(o), true) => sweep(rays, threads, |r| o.any(r)),
            (Kind::Embree(e), false) => {
                sweep(rays, threads, |r| e.intersect(&embree_ray(r)).is_some())
            }
            (Kind::Embree(e), true) => sweep(rays, threads, |r| e.occluded(&embree_ray(r))),
            (Kind::Tinybvh(t), any) => t
                .trace(rays, any, false, threads)
                .map_or((f64::NAN, 0), |t| (t.seconds, t.hits)),
            (Kind::Gpu(g), any) => g.time(rays, any),
        }
    }

    /// Bytes of what is walked, where that is known.
    fn bytes(&self) -> Option<usize> {
        match &self.kind {
            Kind::Cpu(bvh) => Some(size_of_val(&*bvh.nodes) + size_of_val(&*bvh.triangles)),
            Kind::Wide(w) => Some(w.bytes()),
            Kind::Obvhs(o) => Some(
                size_of_val(&*o.bvh.nodes)
                    + size_of_val(&*o.bvh.primitive_indices)
                    + size_of_val(&*o.triangles),
            ),
            Kind::Embree(e) => Some(e.memory()),
            Kind::Tinybvh(_) | Kind::Gpu(_) => None,
        }
    }

    /// Why nothing that the engine says counts.
    fn failure(&self) -> Option<String> {
        match &self.kind {
            Kind::Tinybvh(t) => t.failure.get().map(TinybvhError::to_string),
            _ => None,
        }
    }

    fn closest(&self, rays: &[Ray]) -> Vec<Hit> {
        match &self.kind {
            Kind::Cpu(bvh) => {
                let view = bvh.view();
                rays.iter()
                    .map(|r| {
                        let hit = bvh_closest(&view, *r);
                        (hit.primitive != BVH_MISS).then_some((hit.t, hit.primitive))
                    })
                    .collect()
            }
            Kind::Wide(w) => rays
                .iter()
                .map(|r| {
                    let hit = w.closest(r);
                    (hit.primitive != BVH_MISS).then_some((hit.t, hit.primitive))
                })
                .collect(),
            Kind::Obvhs(o) => rays.iter().map(|r| o.closest(r)).collect(),
            Kind::Embree(e) => rays
                .iter()
                .map(|r| e.intersect(&embree_ray(r)).map(|h| (h.t, h.primitive)))
                .collect(),
            Kind::Tinybvh(t) => match t.trace(rays, false, true, 1) {
                Some(traced) => {
                    let hits = traced.closest.into_iter().zip(rays);
                    hits.map(|(hit, ray)| hit.map(|(t, i)| (t + ray.t_min, i)))
                        .collect()
                }
                None => vec![None; rays.len()],
            },
            Kind::Gpu(g) => g.closest(rays),
        }
    }
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// Name of our traversal on the CPU.
pub const RAYTWIN_CPU: &str = "raytwin cpu";
/// Name of our traversal with eight children a node, before its instructions.
pub const RAYTWIN_WIDE: &str = "raytwin cpu, eight wide";
/// Name of the peer that ratios are to.
pub const EMBREE: &str = "Embree";
/// Name of the other peer, its eight-wide tree for AVX2.
pub const TINYBVH: &str = "tinybvh";

fn open<'a>(
    with: &'a Engines<'a>,
    mesh: &str,
    positions: &[Vec3],
    indices: &[[u32; 3]],
    bvh: &'a Bvh,
    build_ms: f64,
) -> Result<Vec<Engine<'a>>, ReportError> {
    let mut out = Vec::new();
    let mut add = |name: String, build_ms, kind| {
        out.push(Engine {
            name,
            build_ms,
            kind,
        });
    };
    if with.cpu {
        add(RAYTWIN_CPU.into(), Some(build_ms), Kind::Cpu(bvh));
        let start = Instant::now();
        let wide = bvh.wide().map_err(|source| ReportError::Wide {
            mesh: mesh.into(),
            source,
        })?;
        let name = format!("{RAYTWIN_WIDE}, {}", wide.level().name());
        add(name, Some(build_ms + milliseconds(start)), Kind::Wide(wide));
        let start = Instant::now();
        let engine = Obvhs::new(positions, indices);
        add(
            "obvhs".into(),
            Some(milliseconds(start)),
            Kind::Obvhs(engine),
        );
    }
    if with.embree {
        let positions: Vec<_> = positions.iter().map(|p| p.to_array()).collect();
        for (name, robust) in [(EMBREE, false), ("Embree robust", true)] {
            let options = EmbreeOptions {
                robust,
                threads: 1,
                ..EmbreeOptions::default()
            };
            let scene = EmbreeScene::new(&positions, indices, options)?;
            let build_ms = scene.build_time().as_secs_f64() * 1e3;
            add(name.into(), Some(build_ms), Kind::Embree(scene));
        }
    }
    if let Some(tinybvh) = &with.tinybvh {
        let positions: Vec<_> = positions.iter().map(|p| p.to_array()).collect();
        match tinybvh.tree(&positions, indices, false) {
            Ok(tree) => {
                let build_ms = Some(tree.build_ms);
                add(TINYBVH.into(), build_ms, Kind::Tinybvh(Peer::new(tree)));
            }
            Err(error) => with.fails(mesh, &error.to_string()),
        }
    }
    for traversal in &with.gpu {
        let name = format!("raytwin @ {}", traversal.gpu().label());
        add(name, None, Kind::Gpu(traversal.mesh(bvh)));
    }
    Ok(out)
}

/// The four sets of rays behind the rates.
pub struct RaySets {
    primary: Vec<Ray>,
    shadow: Vec<Ray>,
    diffuse: Vec<Ray>,
    ao: Vec<Ray>,
}

/// A random number in `[0, 1)` and the next state.
fn unit(state: &mut u32) -> f32 {
    *state = pcg_hash(state.wrapping_add(0x9e37_79b9));
    (*state >> 8) as f32 / 16_777_216.0
}

impl RaySets {
    /// Camera rays in scan order of a picture of `count` pixels, and from the
    /// points that they hit one ray of each other kind; where fewer hit, the
    /// points are taken again.
    #[must_use]
    pub fn new(scene: &Scene, bvh: &Bvh, count: usize) -> Self {
        let width = ((count as f64).sqrt() * (4.0f64 / 3.0).sqrt()).max(1.0) as usize;
        let height = count.div_ceil(width);
        let camera = camera(scene, width, height);
        let primary: Vec<Ray> = (0..count)
            .map(|i| {
                let pixel = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                camera_ray(pixel, camera)
            })
            .collect();
        let diagonal = scene.mesh.bounds().map_or(1.0, |b| b.diagonal());
        let view = bvh.view();
        let mut points = Vec::new();
        for &ray in &primary {
            let hit = bvh_closest(&view, ray);
            if hit.primitive == BVH_MISS {
                continue;
            }
            let Some(normal) = scene.mesh.geometric_normal(hit.primitive as usize) else {
                continue;
            };
            let towards = ray.direction.as_dvec3().dot(normal.as_dvec3()) > 0.0;
            let normal = if towards { -normal } else { normal };
            points.push((ray_at(ray, hit.t) + normal * (1e-4 * diagonal), normal));
        }
        let mut out = Self {
            primary,
            shadow: Vec::new(),
            diffuse: Vec::new(),
            ao: Vec::new(),
        };
        let mut state = 0x5eed_0b0e;
        for &(origin, normal) in points.iter().cycle().take(count) {
            let ray = |direction, t_max| Ray {
                origin,
                direction,
                t_min: 0.0,
                t_max,
            };
            let mut cosine = || {
                let u = Vec2::new(unit(&mut state), unit(&mut state));
                basis_to_world(
                    basis_from_normal(normal),
                    normal,
                    hemisphere_cosine_sample(u),
                )
            };
            out.diffuse.push(ray(cosine(), f32::MAX));
            out.ao.push(ray(cosine(), scene.ao_distance));
            out.shadow.push(ray(scene.light.direction, f32::MAX));
        }
        out
    }

    /// Name, rays, and whether any hit will do, in the order of [`Rates`].
    #[must_use]
    pub fn all(&self) -> [(&[Ray], bool); 4] {
        [
            (&self.primary, false),
            (&self.shadow, true),
            (&self.diffuse, false),
            (&self.ao, true),
        ]
    }
}

fn camera(scene: &Scene, width: usize, height: usize) -> Camera {
    let c = &scene.camera;
    let forward = (c.target.as_dvec3() - c.eye.as_dvec3()).normalize_or_zero();
    let right = forward.cross(c.up.as_dvec3()).normalize_or_zero();
    let half = (0.5 * f64::from(c.fov_degrees)).to_radians().tan();
    let aspect = width as f64 / height as f64;
    Camera {
        origin: c.eye,
        right: (right * (half * aspect)).as_vec3(),
        up: (right.cross(forward) * half).as_vec3(),
        forward: forward.as_vec3(),
        inverse_resolution: Vec2::new(1.0 / width as f32, 1.0 / height as f32),
    }
}

/// How fast each engine is, in turn so that all see the same machine.
fn rates(engines: &[Engine<'_>], sets: &RaySets, rounds: usize, threads: usize) -> Vec<Rates> {
    let mut times = vec![[const { Vec::new() }; 4]; engines.len()];
    for round in 0..=rounds {
        for (engine, times) in engines.iter().zip(&mut times) {
            // An adapter has threads of its own.
            if threads != 1 && matches!(engine.kind, Kind::Gpu(_)) {
                continue;
            }
            for ((rays, any), times) in sets.all().into_iter().zip(times) {
                let (seconds, _) = engine.time(rays, any, threads);
                // The first round warms up.
                if round > 0 {
                    times.push(seconds);
                }
            }
        }
    }
    times
        .iter_mut()
        .map(|times| {
            let mut rate = |k: usize| {
                let rays = sets.all()[k].0.len() as f64;
                let seconds = median(&mut times[k]);
                if rays > 0.0 && seconds > 0.0 {
                    rays / seconds * 1e-6
                } else {
                    0.0
                }
            };
            Rates {
                primary: rate(0),
                shadow: rate(1),
                diffuse: rate(2),
                ao: rate(3),
            }
        })
        .collect()
}

/// Measures every engine on one mesh.
///
/// # Errors
/// If the mesh has no tree or Embree refuses it.
pub(super) fn measure(
    scene: &Scene,
    settings: &BvhSettings,
    with: &Engines<'_>,
) -> Result<Vec<BvhRow>, ReportError> {
    let mesh = &scene.mesh;
    let start = Instant::now();
    let bvh = build(&scene.name, &mesh.positions, &mesh.indices)?;
    let build_ms = milliseconds(start);
    let engines = open(
        with,
        &scene.name,
        &mesh.positions,
        &mesh.indices,
        &bvh,
        build_ms,
    )?;
    let sets = RaySets::new(scene, &bvh, settings.rays);
    let one = rates(&engines, &sets, settings.rounds, 1);
    let threads = all_threads();
    let all = rates(&engines, &sets, settings.rounds, threads);
    let embree = engines.iter().position(|e| e.name == EMBREE);
    let over = |own: Rates, rates: &[Rates]| {
        embree.map(|i| rates[i]).map(|e| Rates {
            primary: own.primary / e.primary,
            shadow: own.shadow / e.shadow,
            diffuse: own.diffuse / e.diffuse,
            ao: own.ao / e.ao,
        })
    };

    let half = settings.checked / 2;
    let mut rays: Vec<Ray> = sets.primary.iter().take(half).copied().collect();
    rays.extend(sets.diffuse.iter().take(half));
    let subject = Subject {
        name: scene.name.clone(),
        positions: mesh.positions.clone(),
        indices: mesh.indices.clone(),
        bvh: bvh.clone(),
    };
    let set = RaySet::new(&subject, rays);
    Ok(engines
        .iter()
        .zip(one.iter().zip(&all))
        .filter_map(|(engine, (&mrays, &every))| {
            let counts = compare(&subject, &set, &Judged(engine));
            // An adapter has threads of its own.
            let on_cpu = !matches!(engine.kind, Kind::Gpu(_));
            with.counts(&scene.name, engine).then(|| BvhRow {
                mesh: scene.name.clone(),
                triangles: mesh.indices.len(),
                engine: engine.name.clone(),
                build_ms: engine.build_ms,
                mrays,
                to_embree: over(mrays, &one),
                threads,
                all_threads: on_cpu.then_some(every),
                all_to_embree: on_cpu.then(|| over(every, &all)).flatten(),
                bytes: engine
                    .bytes()
                    .map(|bytes| bytes as f64 / mesh.indices.len() as f64),
                checked: set.rays.len(),
                leaks: counts.leaks,
                false_hits: counts.false_hits,
                disagreements: disagreements(&counts),
                ties: counts.prim_ties,
            })
        })
        .collect())
}

fn build(name: &str, positions: &[Vec3], indices: &[[u32; 3]]) -> Result<Bvh, ReportError> {
    Bvh::build(positions, indices, BuildQuality::Medium).map_err(|source| ReportError::Bvh {
        mesh: name.into(),
        source,
    })
}

/// Name of a build quality.
fn quality_name(quality: BuildQuality) -> &'static str {
    match quality {
        BuildQuality::Fastest => "Fastest",
        BuildQuality::Fast => "Fast",
        BuildQuality::Medium => "Medium",
        BuildQuality::Slow => "Slow",
        BuildQuality::VerySlow => "VerySlow",
    }
}

/// Rays from the eye to vertices and to points on edges: what an ordinary test
/// of triangles loses.
fn aimed(scene: &Scene, count: usize) -> Vec<Ray> {
    let mesh = &scene.mesh;
    let mut state = 0x0a1e_d001;
    let place = |t: usize, k: usize| mesh.positions[mesh.indices[t][k % 3] as usize];
    (0..count)
        .map(|i| {
            let t = (unit(&mut state) * mesh.indices.len() as f32) as usize;
            let t = t.min(mesh.indices.len() - 1);
            let (a, b) = (place(t, i), place(t, i + 1));
            let target = match i % 2 {
                0 => a,
                _ => a + (b - a) * unit(&mut state),
            };
            Ray {
                origin: scene.camera.eye,
                direction: target - scene.camera.eye,
                t_min: 0.0,
                t_max: f32::MAX,
            }
        })
        .filter(|r| r.direction.length_squared() > 0.0)
        .collect()
}

/// What each way to build a tree costs, and what its rays then cost and lose.
///
/// # Errors
/// If the mesh has no tree or Embree refuses it.
pub(super) fn measure_builds(
    scene: &Scene,
    settings: &BvhSettings,
    with: &Engines<'_>,
) -> Result<Vec<BuildRow>, ReportError> {
    let (positions, indices) = (&scene.mesh.positions, &scene.mesh.indices);
    let mut engines: Vec<Engine<'_>> = Vec::new();
    let mut qualities = Vec::new();
    let mut reference = None;
    for quality in BuildQuality::ALL {
        let start = Instant::now();
        let bvh = Bvh::build(positions, indices, quality).map_err(|source| ReportError::Bvh {
            mesh: scene.name.clone(),
            source,
        })?;
        let wide = bvh.wide().map_err(|source| ReportError::Wide {
            mesh: scene.name.clone(),
            source,
        })?;
        engines.push(Engine {
            name: RAYTWIN_WIDE.into(),
            build_ms: Some(milliseconds(start)),
            kind: Kind::Wide(wide),
        });
        qualities.push(Some(quality_name(quality).to_owned()));
        if quality == BuildQuality::Medium {
            reference = Some(bvh);
        }
    }
    let Some(reference) = reference else {
        return Ok(Vec::new());
    };
    let start = Instant::now();
    let obvhs = Obvhs::new(positions, indices);
    engines.push(Engine {
        name: "obvhs".into(),
        build_ms: Some(milliseconds(start)),
        kind: Kind::Obvhs(obvhs),
    });
    qualities.push(Some("Medium".into()));
    if with.embree {
        let positions: Vec<_> = positions.iter().map(|p| p.to_array()).collect();
        for (name, robust, quality) in [
            (EMBREE, false, RTCBuildQuality::MEDIUM),
            (EMBREE, false, RTCBuildQuality::HIGH),
            ("Embree robust", true, RTCBuildQuality::MEDIUM),
        ] {
            let options = EmbreeOptions {
                robust,
                quality,
                threads: 1,
            };
            let scene = EmbreeScene::new(&positions, indices, options)?;
            engines.push(Engine {
                name: name.into(),
                build_ms: Some(scene.build_time().as_secs_f64() * 1e3),
                kind: Kind::Embree(scene),
            });
            let name = match quality {
                RTCBuildQuality::HIGH => "High",
                _ => "Medium",
            };
            qualities.push(Some(name.into()));
        }
    }
    if let Some(tinybvh) = &with.tinybvh {
        let positions: Vec<_> = positions.iter().map(|p| p.to_array()).collect();
        for (name, high) in [("Medium", false), ("High", true)] {
            match tinybvh.tree(&positions, indices, high) {
                Ok(tree) => {
                    engines.push(Engine {
                        name: TINYBVH.into(),
                        build_ms: Some(tree.build_ms),
                        kind: Kind::Tinybvh(Peer::new(tree)),
                    });
                    qualities.push(Some(name.into()));
                }
                Err(error) => with.fails(&scene.name, &error.to_string()),
            }
        }
    }
    let sets = RaySets::new(scene, &reference, settings.rays);
    let rates = rates(&engines, &sets, settings.rounds, 1);
    let subject = Subject {
        name: scene.name.clone(),
        positions: positions.clone(),
        indices: indices.clone(),
        bvh: reference.clone(),
    };
    let set = RaySet::new(&subject, aimed(scene, settings.aimed));
    let rows = engines.iter().zip(rates).zip(qualities);
    Ok(rows
        .filter_map(|((engine, mrays), quality)| {
            let counts = compare(&subject, &set, &Judged(engine));
            with.counts(&scene.name, engine).then(|| BuildRow {
                mesh: scene.name.clone(),
                triangles: indices.len(),
                engine: engine.name.clone(),
                quality,
                build_ms: engine.build_ms.unwrap_or_default(),
                mrays,
                mean: mrays.mean(),
                aimed: set.rays.len(),
                leaks: counts.leaks,
                false_hits: counts.false_hits,
            })
        })
        .collect())
}

/// The WGSL traversal with its stack in each place, in workgroups of two sizes;
/// the first is the kernel as it is.
///
/// # Errors
/// If the mesh has no tree or an adapter refuses a program.
pub(super) fn measure_stacks(
    scene: &Scene,
    settings: &BvhSettings,
    gpu: &Gpu,
) -> Result<Vec<StackRow>, ReportError> {
    let bvh = build(&scene.name, &scene.mesh.positions, &scene.mesh.indices)?;
    let mut places = vec![(Stack::Function, WORKGROUP)];
    places.extend(Stack::ALL.map(|stack| (stack, SMALL_WORKGROUP)));
    let traversals: Result<Vec<_>, _> = places
        .iter()
        .map(|(stack, workgroup)| Traversal::new(gpu, *stack, *workgroup))
        .collect();
    let traversals = traversals?;
    let engines: Vec<_> = traversals
        .iter()
        .map(|t| Engine {
            name: gpu.label(),
            build_ms: None,
            kind: Kind::Gpu(t.mesh(&bvh)),
        })
        .collect();
    let sets = RaySets::new(scene, &bvh, settings.rays);
    let rates = rates(&engines, &sets, settings.rounds, 1);
    let hits: Vec<_> = engines.iter().map(|e| e.closest(&sets.primary)).collect();
    let rows = places.iter().zip(&rates).zip(&hits);
    Ok(rows
        .map(|(((stack, workgroup), mrays), found)| StackRow {
            mesh: scene.name.clone(),
            adapter: gpu.label(),
            stack: stack.name().into(),
            workgroup: *workgroup,
            mrays: *mrays,
            ratio: mrays.mean() / rates[0].mean(),
            differing: found.iter().zip(&hits[0]).filter(|(a, b)| a != b).count(),
        })
        .collect())
}

/// Triangles of the spheres whose rays' cost is measured.
pub(super) fn sizes(settings: &BvhSettings) -> impl Iterator<Item = usize> + Clone + use<> {
    let largest = settings.largest;
    std::iter::successors(Some(1 << 10), |n| Some(4 * n)).take_while(move |n| *n <= largest)
}

/// What a ray costs in a sphere.
///
/// # Errors
/// If it has no tree or Embree refuses it.
pub(super) fn measure_growth(
    triangles: usize,
    settings: &BvhSettings,
    with: &Engines<'_>,
) -> Result<Vec<GrowthRow>, ReportError> {
    let with = Engines {
        cpu: true,
        embree: with.embree,
        tinybvh: with.tinybvh.clone(),
        failures: with.failures.clone(),
        gpu: Vec::new(),
    };
    let scene = sphere(triangles);
    let (positions, indices) = (&scene.mesh.positions, &scene.mesh.indices);
    let bvh = build(&scene.name, positions, indices)?;
    let engines = open(&with, &scene.name, positions, indices, &bvh, 0.0)?;
    let sets = RaySets::new(&scene, &bvh, settings.rays);
    let rates = rates(&engines, &sets, settings.rounds, 1);
    let rows = engines.iter().zip(rates);
    let rows = rows.filter(|(engine, _)| with.counts(&scene.name, engine));
    Ok(rows
        .map(|(engine, mrays)| GrowthRow {
            triangles: indices.len(),
            engine: engine.name.clone(),
            ns: 1e3 / mrays.mean(),
        })
        .collect())
}

/// A displaced sphere that fills the picture.
fn sphere(triangles: usize) -> Scene {
    let mesh = meshes::displaced_sphere(triangles);
    let mesh = Mesh {
        positions: mesh.positions,
        indices: mesh.indices,
        skipped: 0,
    };
    let mut scene = Scene::seen_whole("sphere".into(), mesh);
    scene.camera.eye = Vec3::new(0.96, 0.72, 1.6);
    scene.camera.target = Vec3::ZERO;
    scene.camera.fov_degrees = 50.0;
    scene
}

/// Counts what every engine gets wrong on one hard family.
///
/// # Errors
/// If Embree refuses the mesh.
pub(super) fn measure_family(
    family: &Family,
    with: &Engines<'_>,
) -> Result<Vec<FamilyRow>, ReportError> {
    let mesh = &family.mesh;
    let bvh = build(&family.name, &mesh.positions, &mesh.indices)?;
    let engines = open(
        with,
        &family.name,
        &mesh.positions,
        &mesh.indices,
        &bvh,
        0.0,
    )?;
    let subject = Subject {
        name: family.name.clone(),
        positions: mesh.positions.clone(),
        indices: mesh.indices.clone(),
        bvh: bvh.clone(),
    };
    let mut set = RaySet::new(&subject, family.rays.clone()).must_hit(&subject);
    if family.expect == Expectation::MustHitAgain {
        set = set.again();
    }
    Ok(engines
        .iter()
        .filter_map(|engine| {
            let counts = compare(&subject, &set, &Judged(engine));
            with.counts(&family.name, engine).then(|| FamilyRow {
                family: family.name.clone(),
                engine: engine.name.clone(),
                rays: family.rays.len(),
                leaks: counts.leaks,
                false_hits: counts.false_hits,
                disagreements: disagreements(&counts),
                ties: counts.prim_ties,
            })
        })
        .collect())
}

/// An engine of the report, for the judge of the tests.
struct Judged<'e, 'a>(&'e Engine<'a>);

impl crosscheck::Engine for Judged<'_, '_> {
    fn name(&self) -> String {
        self.0.name.clone()
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        self.0
            .closest(rays)
            .into_iter()
            .map(|hit| Answer {
                hit: hit.map(|(t, primitive)| crosscheck::Hit {
                    t,
                    weights: None,
                    primitive,
                }),
                // The report asks for the closest hit alone.
                any: hit.is_some(),
            })
            .collect()
    }
}

/// Hits with another `t` than the truth, also where a needle explains it.
fn disagreements(counts: &Counts) -> usize {
    counts.t_off + counts.t_poor
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generated_meshes_are_seen() {
        for name in GENERATED.into_iter().chain(GENERATED_FULL) {
            let scene = generated(name).unwrap();
            let bvh = build(name, &scene.mesh.positions, &scene.mesh.indices).unwrap();
            let sets = RaySets::new(&scene, &bvh, 1000);
            let hits = sets
                .primary
                .iter()
                .filter(|r| bvh_any(&bvh.view(), **r) != 0)
                .count();
            assert!(hits > 500, "{name}: {hits} of 1000 camera rays hit");
            assert_eq!(sets.all().map(|s| s.0.len()), [1000; 4]);
        }
        assert!(generated("none").is_none());
    }
}
