//! The table of traversal engines: build, speed, and what they get wrong.

use std::hint::black_box;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec2, Vec3};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin_cpu::random::pcg::pcg_hash;
use raytwin_cpu::ray::bvh::{BVH_MISS, bvh_any, bvh_closest};
use raytwin_cpu::ray::camera::{Camera, camera_ray};
use raytwin_cpu::ray::ray::{Ray, ray_at};
use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_world};
use raytwin_cpu::sample::hemisphere::hemisphere_cosine_sample;
use raytwin_tests::embree::{EmbreeOptions, EmbreeRay, EmbreeScene};
use raytwin_tests::rays::families::{Expectation, Family};
use raytwin_tests::rays::meshes;
use raytwin_tests::rays::reference::reference_closest;
use raytwin_tests::scene::{Mesh, Scene};

use super::error::ReportError;
use super::kernels::median;
use super::schema::{BvhRow, FamilyRow, Rates};
use super::traversal::{Traversal, TraversalMesh};

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
}

impl BvhSettings {
    /// For a report within a minute and a half on two cores.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            rays: 1 << 14,
            rounds: 3,
            checked: 1 << 12,
            family_rays: 1_000,
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
        }
    }
}

/// Which engines take part. The peers always do, where they are there.
pub struct Engines<'a> {
    /// Ours and obvhs's on the CPU.
    pub cpu: bool,
    /// Whether Embree was found.
    pub embree: bool,
    /// Ours on adapters.
    pub gpu: Vec<Traversal<'a>>,
}

/// Names of the generated meshes.
pub const GENERATED: [&str; 4] = ["sphere", "slivers", "terrain", "room"];

/// A generated mesh with a view of it.
#[must_use]
pub fn generated(name: &str) -> Option<Scene> {
    let mesh = match name {
        "sphere" => meshes::displaced_sphere(80_000),
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
        "terrain" => ([8.0, 4.0, 9.0], [0.0, -2.0, 0.0], 45.0),
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
    Obvhs(Obvhs),
    Embree(EmbreeScene),
    Gpu(TraversalMesh<'a>),
}

struct Engine<'a> {
    name: String,
    build_ms: Option<f64>,
    kind: Kind<'a>,
}

/// Runs `f` over all rays: seconds, and how many hit.
fn sweep(rays: &[Ray], f: impl Fn(&Ray) -> bool) -> (f64, usize) {
    let start = Instant::now();
    let hits = black_box(rays).iter().filter(|r| f(r)).count();
    (start.elapsed().as_secs_f64(), black_box(hits))
}

impl Engine<'_> {
    fn time(&self, rays: &[Ray], any: bool) -> (f64, usize) {
        match (&self.kind, any) {
            (Kind::Cpu(bvh), false) => {
                let view = bvh.view();
                sweep(rays, |r| bvh_closest(&view, *r).primitive != BVH_MISS)
            }
            (Kind::Cpu(bvh), true) => {
                let view = bvh.view();
                sweep(rays, |r| bvh_any(&view, *r) != 0)
            }
            (Kind::Obvhs(o), false) => sweep(rays, |r| o.closest(r).is_some()),
            (Kind::Obvhs(o), true) => sweep(rays, |r| o.any(r)),
            (Kind::Embree(e), false) => sweep(rays, |r| e.intersect(&embree_ray(r)).is_some()),
            (Kind::Embree(e), true) => sweep(rays, |r| e.occluded(&embree_ray(r))),
            (Kind::Gpu(g), any) => g.time(rays, any),
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
            Kind::Obvhs(o) => rays.iter().map(|r| o.closest(r)).collect(),
            Kind::Embree(e) => rays
                .iter()
                .map(|r| e.intersect(&embree_ray(r)).map(|h| (h.t, h.primitive)))
                .collect(),
            Kind::Gpu(g) => g.closest(rays),
        }
    }
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// Name of our traversal on the CPU.
pub const RAYTWIN_CPU: &str = "raytwin cpu";
/// Name of the peer that ratios are to.
pub const EMBREE: &str = "Embree";

fn open<'a>(
    with: &'a Engines<'a>,
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
    for traversal in &with.gpu {
        let name = format!("raytwin @ {}", traversal.gpu().label());
        add(name, None, Kind::Gpu(traversal.mesh(bvh)));
    }
    Ok(out)
}

/// The four sets of rays behind the rates.
struct RaySets {
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
    fn new(scene: &Scene, bvh: &Bvh, count: usize) -> Self {
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
    fn all(&self) -> [(&[Ray], bool); 4] {
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

/// Measures every engine on one mesh.
///
/// # Errors
/// If the mesh has no tree or Embree refuses it.
pub fn measure(
    scene: &Scene,
    settings: &BvhSettings,
    with: &Engines<'_>,
) -> Result<Vec<BvhRow>, ReportError> {
    let mesh = &scene.mesh;
    let start = Instant::now();
    let bvh = build(&scene.name, &mesh.positions, &mesh.indices)?;
    let build_ms = milliseconds(start);
    let engines = open(with, &mesh.positions, &mesh.indices, &bvh, build_ms)?;
    let sets = RaySets::new(scene, &bvh, settings.rays);

    let mut times = vec![[const { Vec::new() }; 4]; engines.len()];
    for round in 0..=settings.rounds {
        for (engine, times) in engines.iter().zip(&mut times) {
            for ((rays, any), times) in sets.all().into_iter().zip(times) {
                let (seconds, _) = engine.time(rays, any);
                // The first round warms up.
                if round > 0 {
                    times.push(seconds);
                }
            }
        }
    }
    let rates: Vec<Rates> = times
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
        .collect();
    let embree = engines
        .iter()
        .position(|e| e.name == EMBREE)
        .map(|i| rates[i]);

    let half = settings.checked / 2;
    let mut rays: Vec<Ray> = sets.primary.iter().take(half).copied().collect();
    rays.extend(sets.diffuse.iter().take(half));
    let truth = Truth::new(&bvh, &mesh.positions, &mesh.indices, &rays, false);
    Ok(engines
        .iter()
        .zip(rates)
        .map(|(engine, mrays)| {
            let count = truth.count(&rays, &engine.closest(&rays), None);
            BvhRow {
                mesh: scene.name.clone(),
                triangles: mesh.indices.len(),
                engine: engine.name.clone(),
                build_ms: engine.build_ms,
                mrays,
                to_embree: embree.map(|e| Rates {
                    primary: mrays.primary / e.primary,
                    shadow: mrays.shadow / e.shadow,
                    diffuse: mrays.diffuse / e.diffuse,
                    ao: mrays.ao / e.ao,
                }),
                checked: rays.len(),
                leaks: count.leaks,
                false_hits: count.false_hits,
                disagreements: count.disagreements,
                ties: count.ties,
            }
        })
        .collect())
}

fn build(name: &str, positions: &[Vec3], indices: &[[u32; 3]]) -> Result<Bvh, ReportError> {
    Bvh::build(positions, indices, BuildQuality::Medium).map_err(|source| ReportError::Bvh {
        mesh: name.into(),
        source,
    })
}

/// Counts what every engine gets wrong on one hard family.
///
/// # Errors
/// If Embree refuses the mesh.
pub fn measure_family(family: &Family, with: &Engines<'_>) -> Result<Vec<FamilyRow>, ReportError> {
    let mesh = &family.mesh;
    let bvh = build(&family.name, &mesh.positions, &mesh.indices)?;
    let engines = open(with, &mesh.positions, &mesh.indices, &bvh, 0.0)?;
    let truth = Truth::new(&bvh, &mesh.positions, &mesh.indices, &family.rays, true);
    Ok(engines
        .iter()
        .map(|engine| {
            let hits = engine.closest(&family.rays);
            let again = (family.expect == Expectation::MustHitAgain).then(|| {
                let shortened: Vec<Ray> = family
                    .rays
                    .iter()
                    .zip(&hits)
                    .map(|(&ray, hit)| Ray {
                        t_max: hit.map_or(ray.t_max, |h| h.0),
                        ..ray
                    })
                    .collect();
                engine.closest(&shortened)
            });
            let count = truth.count(&family.rays, &hits, again.as_deref());
            FamilyRow {
                family: family.name.clone(),
                engine: engine.name.clone(),
                rays: family.rays.len(),
                leaks: count.leaks,
                false_hits: count.false_hits,
                disagreements: count.disagreements,
                ties: count.ties,
            }
        })
        .collect())
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Count {
    leaks: usize,
    false_hits: usize,
    disagreements: usize,
    ties: usize,
}

/// What the f64 intersector finds for some rays.
struct Truth<'a> {
    positions: &'a [Vec3],
    indices: &'a [[u32; 3]],
    hits: Vec<Option<TrueHit>>,
    closed: bool,
}

struct TrueHit {
    t: f64,
    margin: f64,
    primitives: Vec<u32>,
}

/// Positions are right to a few roundings of the largest coordinate that the
/// arithmetic meets: eight.
const TOLERANCE: f64 = 8.0 / 16_777_216.0;

/// Nearer to an edge than this, in barycentric weight, an open mesh's hit is
/// a matter of rounding.
const ON_EDGE: f64 = 1e-6;

impl<'a> Truth<'a> {
    fn new(
        bvh: &Bvh,
        positions: &'a [Vec3],
        indices: &'a [[u32; 3]],
        rays: &[Ray],
        closed: bool,
    ) -> Self {
        use rayon::prelude::*;
        let hits = rays
            .par_iter()
            .map(|&ray| {
                let hit = reference_closest(&bvh.view(), ray)?;
                Some(TrueHit {
                    t: hit.t,
                    margin: hit.margin,
                    primitives: hit.ties,
                })
            })
            .collect();
        Self {
            positions,
            indices,
            hits,
            closed,
        }
    }

    /// `again` is a second trace that must find the same.
    fn count(&self, rays: &[Ray], found: &[Hit], again: Option<&[Hit]>) -> Count {
        let mut out = Count::default();
        for (i, (ray, hit)) in rays.iter().zip(found).enumerate() {
            let truth = self.hits[i].as_ref();
            let Some((t, primitive)) = *hit else {
                let lost = self.closed || truth.is_some_and(|h| h.margin > ON_EDGE);
                out.leaks += usize::from(lost);
                continue;
            };
            if again.is_some_and(|a| a[i] != *hit) {
                out.leaks += 1;
                continue;
            }
            let near = self.nearness(ray, f64::from(t), primitive);
            if near.line > near.tolerance {
                out.false_hits += 1;
                continue;
            }
            let Some(truth) = truth else {
                // It touches the triangle to rounding: a silhouette.
                continue;
            };
            if truth.primitives.contains(&primitive) {
                out.disagreements += usize::from(near.plane > near.tolerance);
                continue;
            }
            // Along a grazing ray a small step off the surface is a long one
            // in distance: the difference counts across the flatter surface.
            let slope = truth
                .primitives
                .iter()
                .map(|&p| self.nearness(ray, truth.t, p).slope)
                .fold(near.slope, f64::min);
            let length = ray.direction.as_dvec3().length();
            if (truth.t - f64::from(t)).abs() * length * slope <= near.tolerance {
                out.ties += 1;
            } else {
                out.disagreements += 1;
            }
        }
        out
    }

    /// How a reported hit lies to its triangle.
    fn nearness(&self, ray: &Ray, t: f64, primitive: u32) -> Nearness {
        let Some(triangle) = self.indices.get(primitive as usize) else {
            return Nearness {
                line: f64::INFINITY,
                plane: f64::INFINITY,
                slope: 1.0,
                tolerance: 0.0,
            };
        };
        let origin = ray.origin.as_dvec3();
        let corners = triangle.map(|i| self.positions[i as usize].as_dvec3());
        let direction = ray.direction.as_dvec3();
        let point = origin + direction * t;
        let largest = corners
            .iter()
            .map(|c| c.abs().max_element())
            .fold(point.abs().max_element(), f64::max)
            .max(origin.abs().max_element());
        let along = direction.normalize();
        // Seen along the ray, the line is the origin.
        let flat = corners.map(|c| (c - origin) - along * (c - origin).dot(along));
        let normal = (corners[1] - corners[0])
            .cross(corners[2] - corners[0])
            .normalize_or_zero();
        let on_triangle = nearest_on_triangle(point, corners);
        Nearness {
            line: nearest_on_triangle(DVec3::ZERO, flat).length(),
            plane: if normal == DVec3::ZERO {
                point.distance(on_triangle)
            } else {
                normal.dot(point - corners[0]).abs()
            },
            slope: normal.dot(along).abs(),
            tolerance: TOLERANCE * largest,
        }
    }
}

/// Distances in the mesh's units.
struct Nearness {
    /// From the ray's line to the triangle.
    line: f64,
    /// From the reported point to the triangle's plane.
    plane: f64,
    /// Sine of the angle between ray and plane.
    slope: f64,
    /// What rounding explains.
    tolerance: f64,
}

/// The point of a triangle that is nearest to `p`.
fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    if area > 0.0 {
        let weight = |q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) / area;
        let (wa, wb, wc) = (weight(b, c), weight(c, a), weight(a, b));
        if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
            return a * wa + b * wb + c * wc;
        }
    }
    let on_edge = |q: DVec3, r: DVec3| {
        let side = r - q;
        let length = side.length_squared();
        let s = if length > 0.0 {
            ((p - q).dot(side) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        q + side * s
    };
    [on_edge(a, b), on_edge(b, c), on_edge(c, a)]
        .into_iter()
        .min_by(|q, r| p.distance(*q).total_cmp(&p.distance(*r)))
        .unwrap_or(a)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> (Vec<Vec3>, Vec<[u32; 3]>, Vec<Ray>) {
        let positions = vec![
            Vec3::ZERO,
            Vec3::X,
            Vec3::Y,
            Vec3::Z,
            Vec3::X + Vec3::Z,
            Vec3::Y + Vec3::Z,
        ];
        let rays = vec![
            Ray {
                origin: Vec3::new(0.25, 0.25, 5.0),
                direction: -Vec3::Z,
                t_min: 0.0,
                t_max: f32::MAX,
            };
            4
        ];
        (positions, vec![[0, 1, 2], [3, 4, 5]], rays)
    }

    #[test]
    fn every_kind_of_mistake_is_counted() {
        let (positions, indices, rays) = truth();
        let bvh = build("two", &positions, &indices).unwrap();
        let truth = Truth::new(&bvh, &positions, &indices, &rays, false);
        let right = Some((4.0, 1));
        // Right, lost, behind the first, at a wrong distance.
        let found = [right, None, Some((5.0, 0)), Some((4.5, 1))];
        let expected = Count {
            leaks: 1,
            disagreements: 2,
            ..Count::default()
        };
        assert_eq!(truth.count(&rays, &found, None), expected);
        let beside = Ray {
            origin: Vec3::new(0.6, 0.6, 5.0),
            ..rays[0]
        };
        let none = Truth::new(&bvh, &positions, &indices, &[beside], false);
        assert_eq!(none.count(&[beside], &[right], None).false_hits, 1);
        assert_eq!(none.count(&[beside], &[None], None), Count::default());
        assert_eq!(truth.count(&rays, &[right; 4], None), Count::default());
        let again = [right, right, None, right];
        let lost = truth.count(&rays, &[right; 4], Some(&again));
        assert_eq!(lost.leaks, 1);
    }

    #[test]
    fn nearest_points() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let near = |x, y, z| nearest_on_triangle(DVec3::new(x, y, z), triangle);
        assert_eq!(near(0.25, 0.25, 3.0), DVec3::new(0.25, 0.25, 0.0));
        assert_eq!(near(-1.0, 0.5, 1.0), DVec3::new(0.0, 0.5, 0.0));
        assert_eq!(near(3.0, -1.0, 0.0), DVec3::X);
        let line = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        assert_eq!(
            nearest_on_triangle(DVec3::new(1.5, 1.0, 0.0), line),
            DVec3::X * 1.5
        );
    }

    #[test]
    fn generated_meshes_are_seen() {
        for name in GENERATED {
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
