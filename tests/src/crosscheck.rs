//! Counting leaks, false hits and disagreements of traversal engines.
//!
//! A [`Subject`] is a mesh, a [`RaySet`] rays with the answer of the reference
//! in double precision, an [`Engine`] anything that traces, and [`compare`]
//! says how they differ. Every difference gets a named [`Cause`].
//!
//! Whether an answer is wrong is asked backwards: an answer is right if it is
//! the exact answer of a ray moved sideways by no more than [`tolerance`], the
//! rounding of the coordinates on the way. So a ray past the rim of an open
//! mesh may hit or miss, at one `t` any of the triangles may be named, and a
//! surface that no such move gets past must be hit: missing it is a leak.

use std::fmt;

use glam::{DVec3, Vec3};
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use raytwin::gpu::BvhBuffers;
use raytwin::ray::bvh_build::{BuildQuality, Bvh, BvhError};
use raytwin_cpu::pass::bvh8::{Bvh8, Level};
use raytwin_cpu::ray::bvh::{BVH_MISS, BvhHit, BvhView, bvh_any, bvh_closest};
use raytwin_cpu::ray::ray::Ray;

use crate::embree::{EmbreeError, EmbreeOptions, EmbreeRay, EmbreeScene};
use crate::gpu::{Build, Gpu, ProgramError, shader_module};
use crate::rays::meshes::Random;
use crate::rays::reference::{ReferenceHit, reference_closest, reference_triangle};

/// How far an answer may be off, in units of 2^-23 of the distance from the
/// ray's origin to the triangle's farthest vertex plus the triangle's extent.
///
/// Subtracting the origin, shearing and multiplying move an edge by 5.5 such
/// units of the distance, 7 of the extent (docs/ray/triangle.md).
pub const TOLERANCE_UNITS: f64 = 8.0;

const UNIT: f64 = 1.0 / 8_388_608.0;

/// A mesh and its tree.
pub struct Subject {
    /// A short name.
    pub name: String,
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// Triangles.
    pub indices: Vec<[u32; 3]>,
    /// Our tree; the reference walks it too, in double precision.
    pub bvh: Bvh,
}

impl Subject {
    /// Builds the tree.
    ///
    /// # Errors
    /// Those of [`Bvh::build`].
    pub fn new(
        name: impl Into<String>,
        positions: &[Vec3],
        indices: &[[u32; 3]],
        quality: BuildQuality,
    ) -> Result<Self, BvhError> {
        Ok(Self {
            name: name.into(),
            positions: positions.to_vec(),
            indices: indices.to_vec(),
            bvh: Bvh::build(positions, indices, quality)?,
        })
    }

    fn corners(&self, primitive: u32) -> [DVec3; 3] {
        self.indices[primitive as usize].map(|i| self.positions[i as usize].as_dvec3())
    }

    /// `n` rays as a renderer has them: from inside the mesh's box or a little
    /// outside, half of them aimed at a random point of the surface, half of
    /// them with an end.
    #[must_use]
    pub fn random_rays(&self, n: usize, seed: u32) -> Vec<Ray> {
        let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
        for p in self.indices.iter().flatten() {
            low = low.min(self.positions[*p as usize]);
            high = high.max(self.positions[*p as usize]);
        }
        let extent = (high - low).max(Vec3::splat((high - low).max_element() * 1e-3));
        let size = extent.length();
        let mut random = Random::new(seed);
        (0..n)
            .map(|i| {
                let mut part = || 1.2 * random.unit() - 0.1;
                let at = Vec3::new(part(), part(), part());
                let origin = low + extent * at;
                let mut direction = random.direction();
                if i % 2 == 0 {
                    let [a, b, c] = self.indices[random.below(self.indices.len())]
                        .map(|k| self.positions[k as usize]);
                    let (mut u, mut v) = (random.unit(), random.unit());
                    if u + v > 1.0 {
                        (u, v) = (1.0 - u, 1.0 - v);
                    }
                    let aim = a + (b - a) * u + (c - a) * v - origin;
                    if aim.length() > 1e-3 * size {
                        direction = aim / aim.length();
                    }
                }
                let length = 10f32.powf(random.signed());
                let t_max = if i % 4 < 2 {
                    f32::MAX
                } else {
                    0.5 * size * random.unit() / length
                };
                Ray {
                    origin,
                    direction: direction * length,
                    t_min: 0.0,
                    t_max,
                }
            })
            .collect()
    }
}

/// Rays with the reference's answers.
pub struct RaySet {
    /// The rays.
    pub rays: Vec<Ray>,
    /// What the reference says.
    pub truth: Vec<Option<ReferenceHit>>,
    /// The rays start inside a closed mesh: a miss is a leak without a
    /// question.
    pub must_hit: bool,
    /// Rays on which the reference itself found a gap, see [`Self::must_hit`].
    pub gaps: usize,
    /// Trace once more with `t_max` at the hit's own `t`: that must be a hit.
    pub again: bool,
}

impl RaySet {
    /// Asks the reference.
    #[must_use]
    pub fn new(subject: &Subject, rays: Vec<Ray>) -> Self {
        let view = subject.bvh.view();
        let truth = rays
            .par_iter()
            .map(|&r| reference_closest(&view, r))
            .collect();
        Self {
            rays,
            truth,
            must_hit: false,
            gaps: 0,
            again: false,
        }
    }

    /// The same for rays of which each must hit.
    ///
    /// Double precision has gaps of its own, of 1e-16, at vertices: there the
    /// truth is that of a ray moved by a relative 1e-12, without weights.
    #[must_use]
    pub fn must_hit(mut self, subject: &Subject) -> Self {
        let view = subject.bvh.view();
        for (&ray, truth) in self.rays.iter().zip(&mut self.truth) {
            if truth.is_none() {
                self.gaps += 1;
                let size = subject.bvh.nodes[0].max - subject.bvh.nodes[0].min;
                let by = 1e-12 * f64::from(size.length());
                *truth =
                    probes(ray, by, 0.0)
                        .find_map(|p| p.closest(&view))
                        .map(|(t, primitive)| ReferenceHit {
                            t,
                            u: 0.0,
                            v: 0.0,
                            primitive,
                            ties: vec![primitive],
                            margin: 0.0,
                        });
            }
        }
        Self {
            must_hit: true,
            ..self
        }
    }

    /// The same, traced a second time with `t_max` at the hit.
    #[must_use]
    pub fn again(self) -> Self {
        Self {
            again: true,
            ..self
        }
    }
}

/// A closest hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The ray's parameter.
    pub t: f32,
    /// Weights of the second and the third vertex, if the engine gives them.
    pub weights: Option<[f32; 2]>,
    /// The triangle.
    pub primitive: u32,
}

/// What an engine says of one ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// The closest hit.
    pub hit: Option<Hit>,
    /// Whether anything is hit at all: the engine's occlusion query.
    pub any: bool,
}

/// Something that traces rays through one mesh.
pub trait Engine {
    /// Its name, as tables show it.
    fn name(&self) -> String;

    /// Traces a batch.
    fn trace(&self, rays: &[Ray]) -> Vec<Answer>;

    /// Whether its triangle test alone takes this triangle for this ray, if
    /// that can be asked: it tells a lost triangle from a lost box.
    fn takes(&self, _ray: Ray, _primitive: u32) -> Option<bool> {
        None
    }

    /// How the engine's answer is to be judged.
    fn strict(&self) -> bool {
        false
    }
}

fn hit_of(hit: BvhHit) -> Option<Hit> {
    (hit.primitive != BVH_MISS).then_some(Hit {
        t: hit.t,
        weights: Some([hit.u, hit.v]),
        primitive: hit.primitive,
    })
}

/// The CPU twin.
pub struct OursCpu<'a>(pub &'a Bvh);

impl Engine for OursCpu<'_> {
    fn name(&self) -> String {
        "raytwin CPU".into()
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        let view = self.0.view();
        rays.par_iter()
            .map(|&r| Answer {
                hit: hit_of(bvh_closest(&view, r)),
                any: bvh_any(&view, r) != 0,
            })
            .collect()
    }

    fn strict(&self) -> bool {
        true
    }
}

/// The tree of eight, walked with one kind of instructions.
pub struct OursWide(Bvh8);

impl OursWide {
    /// One engine for each level that this processor has.
    ///
    /// # Panics
    /// If the tree is broken.
    #[must_use]
    pub fn all(bvh: &Bvh) -> Vec<Self> {
        let wide = match Bvh8::new(bvh.view()) {
            Ok(wide) => wide,
            Err(fault) => panic!("{fault}"),
        };
        Level::all()
            .into_iter()
            .map(|level| Self(wide.clone().with_level(level)))
            .collect()
    }

    /// The same answers, asked for groups of neighbours.
    #[must_use]
    pub fn trace_coherent(&self, rays: &[Ray]) -> Vec<Answer> {
        let closest = self.0.closest_coherent(rays);
        let any = self.0.any_coherent(rays);
        let both = closest.into_iter().zip(any);
        both.map(|(hit, any)| Answer {
            hit: hit_of(hit),
            any,
        })
        .collect()
    }
}

impl Engine for OursWide {
    fn name(&self) -> String {
        format!("raytwin CPU, eight wide, {}", self.0.level().name())
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        rays.par_iter()
            .map(|r| Answer {
                hit: hit_of(self.0.closest(r)),
                any: self.0.any(r),
            })
            .collect()
    }

    fn strict(&self) -> bool {
        true
    }
}

const SHADER: &str = "
@group(0) @binding(0) var<storage, read> crosscheck_rays: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> crosscheck_answers: array<u32>;

@compute @workgroup_size(64)
fn raytwin_main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let i = id.y * (groups.x * 64u) + id.x;
    if i >= arrayLength(&crosscheck_rays) / 2u {
        return;
    }
    let start = crosscheck_rays[2u * i];
    let along = crosscheck_rays[2u * i + 1u];
    let ray = Ray(start.xyz, along.xyz, start.w, along.w);
    let hit = bvh_closest(ray);
    crosscheck_answers[5u * i] = bitcast<u32>(hit.t);
    crosscheck_answers[5u * i + 1u] = bitcast<u32>(hit.u);
    crosscheck_answers[5u * i + 2u] = bitcast<u32>(hit.v);
    crosscheck_answers[5u * i + 3u] = hit.primitive;
    crosscheck_answers[5u * i + 4u] = bvh_any(ray);
}
";

/// The WGSL twin's pipeline on one adapter.
pub struct GpuTraversal {
    gpu: &'static Gpu,
    build: Build,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Group 1, which nobody uses.
    empty: wgpu::BindGroup,
}

impl GpuTraversal {
    /// Compiles the traversal over the ready bindings.
    ///
    /// # Errors
    /// If the source does not compile or the adapter has no such build.
    pub fn new(gpu: &'static Gpu, build: Build) -> Result<Self, ProgramError> {
        let library = raytwin::wgsl::link(&["ray/bvh"])?;
        let source = library + BvhBuffers::bindings_wgsl() + SHADER;
        let module = shader_module(gpu, "ray/bvh", &source, build)?;
        let device = gpu.device();
        let entry = |binding, read_only| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[entry(0, true), entry(1, false)],
        });
        let empty = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[],
        });
        let tree = BvhBuffers::new(device, &[], &[]);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout), Some(&empty), Some(tree.layout())],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("crosscheck"),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("raytwin_main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let empty = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &empty,
            entries: &[],
        });
        Ok(Self {
            gpu,
            build,
            pipeline,
            layout,
            empty,
        })
    }

    /// An engine for one tree.
    #[must_use]
    pub fn engine(&self, bvh: &Bvh) -> OursGpu<'_> {
        let device = self.gpu.device();
        OursGpu {
            traversal: self,
            tree: BvhBuffers::new(device, &bvh.node_words(), &bvh.triangle_words()),
        }
    }

    /// Which of the two builds.
    #[must_use]
    pub fn build(&self) -> Build {
        self.build
    }

    /// Whether this build on this adapter must give the CPU's bits.
    #[must_use]
    pub fn is_bit_exact(&self) -> bool {
        self.build == Build::Precise && self.gpu.is_software()
    }
}

/// The WGSL twin over one tree.
pub struct OursGpu<'a> {
    traversal: &'a GpuTraversal,
    tree: BvhBuffers,
}

impl OursGpu<'_> {
    fn batch(&self, rays: &[Ray], out: &mut Vec<Answer>) {
        let gpu = self.traversal.gpu;
        let device = gpu.device();
        let words: Vec<u32> = rays
            .iter()
            .flat_map(|r| {
                let (o, d) = (r.origin, r.direction);
                [o.x, o.y, o.z, r.t_min, d.x, d.y, d.z, r.t_max].map(f32::to_bits)
            })
            .collect();
        let input = gpu.buffer(&words);
        // Poisoned: an answer that is not written is neither a miss nor a hit.
        let output = gpu.buffer(&vec![0xdead_beef; 5 * rays.len()]);
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.traversal.layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: input.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: output.as_entire_binding(),
                },
            ],
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.traversal.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.set_bind_group(1, &self.traversal.empty, &[]);
            pass.set_bind_group(BvhBuffers::GROUP, self.tree.bind_group(), &[]);
            let groups = (rays.len() as u32).div_ceil(64).max(1);
            let rows = groups.div_ceil(65_535);
            pass.dispatch_workgroups(groups.div_ceil(rows), rows, 1);
        }
        gpu.queue().submit([encoder.finish()]);
        let words = gpu.read(&output, 5 * rays.len());
        out.extend(words.chunks_exact(5).map(|w| Answer {
            hit: hit_of(BvhHit {
                t: f32::from_bits(w[0]),
                u: f32::from_bits(w[1]),
                v: f32::from_bits(w[2]),
                primitive: w[3],
            }),
            any: match w[4] {
                0 => false,
                1 => true,
                other => panic!("bvh_any returned {other:#x}"),
            },
        }));
    }
}

impl Engine for OursGpu<'_> {
    fn name(&self) -> String {
        let build = match self.traversal.build {
            Build::Plain => "",
            Build::Precise => ", precise",
        };
        format!("raytwin {}{build}", self.traversal.gpu.info.name)
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        let mut out = Vec::with_capacity(rays.len());
        for part in rays.chunks(1 << 18) {
            self.batch(part, &mut out);
        }
        out
    }

    fn strict(&self) -> bool {
        true
    }
}

/// obvhs as its users run it: its binary tree, its traversal, its triangle
/// test (Möller–Trumbore).
pub struct Obvhs {
    bvh: Bvh2,
    triangles: Vec<RtTriangle>,
    /// Position in `triangles` of each primitive.
    place: Vec<u32>,
}

impl Obvhs {
    /// Builds obvhs's medium tree.
    #[must_use]
    pub fn new(subject: &Subject) -> Self {
        let corner = |i: u32| subject.positions[i as usize].into();
        let all: Vec<Triangle> = subject
            .indices
            .iter()
            .map(|t| Triangle {
                v0: corner(t[0]),
                v1: corner(t[1]),
                v2: corner(t[2]),
            })
            .collect();
        let bvh = build_bvh2_from_tris(
            &all,
            obvhs::BvhBuildParams::medium_build(),
            &mut std::time::Duration::default(),
        );
        let mut place = vec![0; all.len()];
        for (k, &i) in bvh.primitive_indices.iter().enumerate() {
            place[i as usize] = k as u32;
        }
        let triangles = bvh
            .primitive_indices
            .iter()
            .map(|&i| RtTriangle::from(&all[i as usize]))
            .collect();
        Self {
            bvh,
            triangles,
            place,
        }
    }

    fn ray(r: Ray) -> ObvhsRay {
        ObvhsRay::new(r.origin.into(), r.direction.into(), r.t_min, r.t_max)
    }
}

impl Engine for Obvhs {
    fn name(&self) -> String {
        "obvhs".into()
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        rays.par_iter()
            .map(|&r| {
                let mut hit = RayHit::none();
                let test = |r: &ObvhsRay, i: usize| self.triangles[i].intersect(r);
                let found = self.bvh.ray_traverse(Self::ray(r), &mut hit, test);
                let any = !self.bvh.ray_traverse_miss(Self::ray(r), test);
                Answer {
                    hit: found.then(|| Hit {
                        t: hit.t,
                        weights: None,
                        primitive: self.bvh.primitive_indices[hit.primitive_id as usize],
                    }),
                    any,
                }
            })
            .collect()
    }

    fn takes(&self, ray: Ray, primitive: u32) -> Option<bool> {
        let triangle = &self.triangles[self.place[primitive as usize] as usize];
        Some(triangle.intersect(&Self::ray(ray)) < ray.t_max)
    }
}

/// Embree, default or robust.
pub struct EmbreeEngine {
    scene: EmbreeScene,
    robust: bool,
}

impl EmbreeEngine {
    /// Builds Embree's tree of medium quality.
    ///
    /// # Errors
    /// If Embree is missing or refuses.
    pub fn new(subject: &Subject, robust: bool) -> Result<Self, EmbreeError> {
        let positions: Vec<[f32; 3]> = subject.positions.iter().map(|p| p.to_array()).collect();
        let options = EmbreeOptions {
            robust,
            ..Default::default()
        };
        Ok(Self {
            scene: EmbreeScene::new(&positions, &subject.indices, options)?,
            robust,
        })
    }

    /// The library's version.
    #[must_use]
    pub fn version(&self) -> String {
        self.scene.version()
    }
}

impl Engine for EmbreeEngine {
    fn name(&self) -> String {
        if self.robust {
            "Embree robust".into()
        } else {
            "Embree".into()
        }
    }

    fn trace(&self, rays: &[Ray]) -> Vec<Answer> {
        rays.par_iter()
            .map(|r| {
                let ray = EmbreeRay {
                    origin: r.origin.to_array(),
                    direction: r.direction.to_array(),
                    t_min: r.t_min,
                    t_max: r.t_max,
                };
                Answer {
                    hit: self.scene.intersect(&ray).map(|h| Hit {
                        t: h.t,
                        weights: Some([h.u, h.v]),
                        primitive: h.primitive,
                    }),
                    any: self.scene.occluded(&ray),
                }
            })
            .collect()
    }
}

/// Why an answer differs from the reference's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Another triangle at the same `t`, within rounding. No error.
    Tie,
    /// The ray passes a rim or silhouette within rounding. No error.
    Rim,
    /// The hit is within rounding of `t_min` or `t_max`. No error, unless the
    /// engine gave that `t` itself and then misses with it as `t_max`.
    RangeEnd,
    /// Lost: through an edge, within rounding.
    Edge,
    /// Lost: through a vertex, within rounding.
    Vertex,
    /// The triangle's shortest height is below a hundredth of its longest
    /// edge, in space or as the ray sees it.
    Sliver,
    /// The triangle spans a volume below 1e-17 with the direction: products
    /// near the limit at which Embree sets the weights to zero.
    Underflow,
    /// Lost: the triangle test takes the triangle, so a box was dropped, and
    /// a direction component is zero.
    SlabParallel,
    /// Lost: a box was dropped; the direction is shorter than 1e-3 or longer
    /// than 1e3.
    SlabLength,
    /// Lost: a box was dropped that the ray only touches, its triangle being
    /// met at an edge or vertex within rounding.
    SlabTouch,
    /// Lost: the sine of the angle between ray and surface is below 1e-3.
    Grazing,
    /// Lost: the coordinates are a thousand times larger than the distance.
    FarFromOrigin,
    /// None of these.
    Unexplained,
}

impl Cause {
    /// All of them.
    pub const ALL: [Self; 13] = [
        Self::Tie,
        Self::Rim,
        Self::RangeEnd,
        Self::Edge,
        Self::Vertex,
        Self::Sliver,
        Self::Underflow,
        Self::SlabParallel,
        Self::SlabLength,
        Self::SlabTouch,
        Self::Grazing,
        Self::FarFromOrigin,
        Self::Unexplained,
    ];
}

/// A count for each [`Cause`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Causes([usize; Cause::ALL.len()]);

impl Causes {
    /// How often this cause was found.
    #[must_use]
    pub fn of(&self, cause: Cause) -> usize {
        self.0[cause as usize]
    }
}

impl fmt::Display for Causes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut first = true;
        for cause in Cause::ALL {
            if self.of(cause) > 0 {
                let space = if first { "" } else { ", " };
                write!(f, "{space}{cause:?} {}", self.of(cause))?;
                first = false;
            }
        }
        Ok(())
    }
}

/// How an engine's answers differ from the reference's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counts {
    /// Rays traced.
    pub rays: usize,
    /// Rays that the reference says hit.
    pub hits: usize,
    /// Surfaces lost: a miss, or a hit behind a surface that no ray within
    /// rounding gets past.
    pub leaks: usize,
    /// Hits where the ray passes the triangle by more than rounding, or
    /// outside the ray's range.
    pub false_hits: usize,
    /// The right triangle, but `t` puts the point farther from it than
    /// rounding, grown by the triangle's aspect.
    pub t_off: usize,
    /// Barycentric weights that give a point farther from the ray than
    /// rounding, grown by the aspect of the triangle as the ray sees it.
    pub weights_off: usize,
    /// `t` farther off than rounding, but not than the aspect explains: a
    /// needle's plane is uncertain. No errors.
    pub t_poor: usize,
    /// The same of the weights.
    pub weights_poor: usize,
    /// Another triangle at the same `t` within rounding: no errors.
    pub prim_ties: usize,
    /// Hit or miss differs where a ray within rounding does as the engine
    /// says: rims, silhouettes and the ends of the range. No errors.
    pub rims: usize,
    /// The occlusion query differs from the reference, whatever the cause.
    pub occlusion_mismatches: usize,
    /// Those of them that are errors.
    pub occlusion_errors: usize,
    /// Occlusion and closest hit of the engine contradict each other.
    pub contradictions: usize,
    /// Differences by cause, those of the closest hit.
    pub causes: Causes,
    /// Differences of any kind that have no name.
    pub unexplained: usize,
    /// A few of the errors, for the message of a failing test.
    pub examples: Vec<String>,
}

impl Counts {
    /// Errors of any kind.
    #[must_use]
    pub fn errors(&self) -> usize {
        self.leaks + self.false_hits + self.t_off + self.weights_off + self.occlusion_errors
    }

    /// Differences of the closest hit from the reference, ties left out.
    #[must_use]
    pub fn disagreements(&self) -> usize {
        self.leaks
            + self.false_hits
            + self.t_off
            + self.weights_off
            + self.rims
            + self.t_poor
            + self.weights_poor
    }

    /// Adds another count.
    pub fn add(&mut self, other: &Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.leaks += other.leaks;
        self.false_hits += other.false_hits;
        self.t_off += other.t_off;
        self.weights_off += other.weights_off;
        self.t_poor += other.t_poor;
        self.weights_poor += other.weights_poor;
        self.prim_ties += other.prim_ties;
        self.rims += other.rims;
        self.occlusion_mismatches += other.occlusion_mismatches;
        self.occlusion_errors += other.occlusion_errors;
        self.contradictions += other.contradictions;
        for (a, b) in self.causes.0.iter_mut().zip(other.causes.0) {
            *a += b;
        }
        self.unexplained += other.unexplained;
        self.examples.extend(other.examples.iter().cloned());
        // Those without a name first.
        self.examples.sort_by_key(|e| !e.contains("Unexplained"));
        self.examples.truncate(4);
    }
}

/// What one difference is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Agree,
    Leak(Cause),
    FalseHit(Cause),
    TOff(Cause),
    WeightsOff(Cause),
    TPoor,
    WeightsPoor,
    Harmless(Cause),
}

/// A triangle as a ray sees it, in double precision.
struct Seen {
    corners: [DVec3; 3],
    /// See [`tolerance`].
    tolerance: f64,
    /// The same in the ray's parameter, along the ray.
    along: f64,
    /// Sine of the angle between ray and plane.
    slope: f64,
    /// Longest edge over shortest height: by how much rounding grows in the
    /// normal.
    aspect: f64,
    /// The same for the triangle as the ray sees it: by how much rounding
    /// grows in the weights.
    seen_aspect: f64,
    /// Six times the volume that the triangle spans with the direction.
    volume: f64,
}

/// How far rounding may move the line against this triangle, in units of the
/// mesh: [`TOLERANCE_UNITS`].
#[must_use]
pub fn tolerance(origin: DVec3, corners: [DVec3; 3]) -> f64 {
    let far = corners.map(|p| (p - origin).length());
    let [a, b, c] = corners;
    let extent = [b - a, c - b, a - c].map(DVec3::length);
    let max = |v: [f64; 3]| v[0].max(v[1]).max(v[2]);
    TOLERANCE_UNITS * UNIT * (max(far) + max(extent))
}

fn see(ray: Ray, corners: [DVec3; 3]) -> Seen {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let slope = normal.dot(d.normalize_or_zero()).abs();
    let tolerance = tolerance(o, corners);
    let extent = [b - a, c - b, a - c].map(DVec3::length);
    let longest = extent[0].max(extent[1]).max(extent[2]);
    // Inside the triangle t cannot vary by more than its extent.
    let along = (tolerance / slope.max(1e-300)).min(longest + tolerance) / d.length();
    let aspect = longest * longest / (b - a).cross(c - a).length().max(1e-300);
    let flat = [a, b, c].map(|p| across(p - o, d));
    let flat_extent = [flat[1] - flat[0], flat[2] - flat[1], flat[0] - flat[2]].map(DVec3::length);
    let flat_longest = flat_extent[0].max(flat_extent[1]).max(flat_extent[2]);
    let flat_area = (flat[1] - flat[0]).cross(flat[2] - flat[0]).length();
    Seen {
        corners,
        tolerance,
        along,
        slope,
        aspect,
        seen_aspect: flat_longest * flat_longest / flat_area.max(1e-300),
        volume: (b - a).cross(c - a).dot(d).abs(),
    }
}

/// Distance of a point from a segment.
fn segment_distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let ab = b - a;
    let s = if ab.length_squared() > 0.0 {
        ((p - a).dot(ab) / ab.length_squared()).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (p - (a + ab * s)).length()
}

/// Distance of a point from a triangle.
fn point_distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let inside = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(normal) >= 0.0;
    if normal.length_squared() > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        return (p - a).dot(normal.normalize()).abs();
    }
    segment_distance(p, a, b)
        .min(segment_distance(p, b, c))
        .min(segment_distance(p, c, a))
}

/// The part of a vector that is perpendicular to the direction.
fn across(v: DVec3, d: DVec3) -> DVec3 {
    let d = d.normalize();
    v - d * v.dot(d)
}

/// Distance of the ray's line from a segment, both seen along the ray.
fn edge_distance(o: DVec3, d: DVec3, a: DVec3, b: DVec3) -> f64 {
    segment_distance(DVec3::ZERO, across(a - o, d), across(b - o, d))
}

/// A ray in double precision, moved sideways.
struct Probe {
    origin: DVec3,
    direction: DVec3,
    t_min: f64,
    t_max: f64,
}

impl Probe {
    fn crosses(&self, [a, b, c]: [Vec3; 3]) -> Option<f64> {
        let [a, b, c] = [a, b, c].map(|p| p.as_dvec3() - self.origin);
        let volume = |a: DVec3, b: DVec3| self.direction.dot(a.cross(b));
        let e = [volume(b, c), volume(c, a), volume(a, b)];
        let below = e.iter().any(|v| *v < 0.0);
        let above = e.iter().any(|v| *v > 0.0);
        let normal = (b - a).cross(c - a);
        let slope = normal.dot(self.direction);
        if below == above || slope == 0.0 {
            return None;
        }
        let t = normal.dot(a) / slope;
        (t >= self.t_min && t <= self.t_max).then_some(t)
    }

    fn touches(&self, low: Vec3, high: Vec3) -> bool {
        let (mut near, mut far) = (self.t_min, self.t_max);
        for k in 0..3 {
            let (o, d) = (self.origin[k], self.direction[k]);
            let (l, h) = (f64::from(low[k]) - o, f64::from(high[k]) - o);
            if d == 0.0 {
                if l > 0.0 || h < 0.0 {
                    return false;
                }
            } else {
                near = near.max((l / d).min(h / d));
                far = far.min((l / d).max(h / d));
            }
        }
        near <= far * (1.0 + 1e-12)
    }

    fn closest(&self, view: &BvhView<'_>) -> Option<(f64, u32)> {
        let mut best: Option<(f64, u32)> = None;
        let mut todo = vec![0u32];
        while let Some(i) = todo.pop() {
            let Some(node) = view.nodes.get(i as usize) else {
                continue;
            };
            if !self.touches(node.min, node.max) {
                continue;
            }
            if node.count == 0 {
                todo.extend([node.first, node.first + 1]);
                continue;
            }
            let first = node.first as usize;
            for t in &view.triangles[first..first + node.count as usize] {
                if let Some(at) = self.crosses([t.a, t.b, t.c])
                    && best.is_none_or(|b| at < b.0)
                {
                    best = Some((at, t.primitive));
                }
            }
        }
        best
    }
}

/// The ray moved sideways by `by`, in sixteen directions and half as far in
/// eight, its range longer by `along` at both ends.
fn probes(ray: Ray, by: f64, along: f64) -> impl Iterator<Item = Probe> {
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (x, y) = direction.normalize().any_orthonormal_pair();
    (0..24).map(move |i| {
        let (angle, by) = if i < 16 {
            (f64::from(i) / 16.0, by)
        } else {
            (f64::from(i) / 8.0 + 0.04, 0.5 * by)
        };
        let (s, c) = (angle * std::f64::consts::TAU).sin_cos();
        Probe {
            origin: origin + (x * c + y * s) * by,
            direction,
            t_min: f64::from(ray.t_min) - along,
            t_max: f64::from(ray.t_max) + along,
        }
    })
}

fn at_range_end(ray: Ray, t: f64, along: f64) -> bool {
    (t - f64::from(ray.t_min)).abs() <= along || (t - f64::from(ray.t_max)).abs() <= along
}

struct Judge<'a> {
    subject: &'a Subject,
    engine: &'a (dyn Engine + Sync),
    must_hit: bool,
}

impl Judge<'_> {
    /// Why a surface that cannot be missed was missed.
    fn loss(&self, ray: Ray, truth: &ReferenceHit, seen: &Seen) -> Cause {
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let [a, b, c] = seen.corners;
        let taken = truth
            .ties
            .iter()
            .filter_map(|&p| self.engine.takes(ray, p))
            .reduce(|x, y| x || y);
        let parallel = ray.direction.to_array().contains(&0.0);
        let length = d.length();
        let odd_length = !(1e-3..1e3).contains(&length);
        let grazing = seen.slope < 1e-3;
        let sliver = seen.aspect > 1e2 || (seen.seen_aspect > 1e2 && !grazing);
        let far = o.abs().max_element() > 1e3 * truth.t * length;
        let vertex = [a, b, c]
            .map(|p| edge_distance(o, d, p, p))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        let edge = [(a, b), (b, c), (c, a)]
            .map(|(p, q)| edge_distance(o, d, p, q))
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        if taken == Some(true) {
            // A box was lost on the way.
            return if odd_length {
                Cause::SlabLength
            } else if parallel {
                Cause::SlabParallel
            } else if far {
                Cause::FarFromOrigin
            } else if grazing {
                Cause::Grazing
            } else if sliver {
                Cause::Sliver
            } else if edge <= seen.tolerance {
                Cause::SlabTouch
            } else {
                Cause::Unexplained
            };
        }
        if at_range_end(ray, truth.t, seen.along) {
            return Cause::RangeEnd;
        }
        if sliver {
            Cause::Sliver
        } else if grazing {
            Cause::Grazing
        } else if vertex <= seen.tolerance {
            Cause::Vertex
        } else if edge <= seen.tolerance {
            Cause::Edge
        } else if far {
            Cause::FarFromOrigin
        } else {
            Cause::Unexplained
        }
    }

    /// The surface at `truth` was not reported.
    fn lost(&self, ray: Ray, truth: &ReferenceHit, behind: Option<f64>) -> Verdict {
        let seen = see(ray, self.subject.corners(truth.primitive));
        if !(self.must_hit && behind.is_none()) {
            if at_range_end(ray, truth.t, seen.along) {
                return Verdict::Harmless(Cause::RangeEnd);
            }
            let view = self.subject.bvh.view();
            let passes = probes(ray, seen.tolerance, 0.0).any(|p| match p.closest(&view) {
                None => true,
                Some((t, primitive)) => {
                    // The same surface, met elsewhere, is no way past it.
                    let other = see(ray, self.subject.corners(primitive));
                    primitive != truth.primitive && t > truth.t + seen.along + other.along
                }
            });
            if passes {
                return Verdict::Harmless(Cause::Rim);
            }
        }
        Verdict::Leak(self.loss(ray, truth, &seen))
    }

    fn closest(&self, ray: Ray, truth: Option<&ReferenceHit>, hit: Option<Hit>) -> Verdict {
        let Some(hit) = hit else {
            return truth.map_or(Verdict::Agree, |h| self.lost(ray, h, None));
        };
        if !(hit.t >= ray.t_min && hit.t <= ray.t_max)
            || hit.primitive as usize >= self.subject.indices.len()
        {
            return Verdict::FalseHit(Cause::Unexplained);
        }
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let corners = self.subject.corners(hit.primitive);
        let [a, b, c] = corners;
        let seen = see(ray, corners);
        let single = self.subject.indices[hit.primitive as usize]
            .map(|i| self.subject.positions[i as usize]);
        let crossed = reference_triangle(ray, single[0], single[1], single[2]);
        let odd = if seen.aspect.max(seen.seen_aspect) > 1e2 {
            Cause::Sliver
        } else if seen.volume < 1e-17 {
            Cause::Underflow
        } else if seen.slope < 1e-3 {
            Cause::Grazing
        } else if o.abs().max_element() > 1e3 * f64::from(hit.t) * d.length() {
            Cause::FarFromOrigin
        } else {
            Cause::Unexplained
        };
        if crossed.is_none() {
            let edge = [(a, b), (b, c), (c, a)]
                .map(|(p, q)| edge_distance(o, d, p, q))
                .into_iter()
                .fold(f64::INFINITY, f64::min);
            if edge > seen.tolerance {
                return Verdict::FalseHit(odd);
            }
        }
        let t = f64::from(hit.t);
        // t itself has half a unit of rounding.
        let point = o + d * t;
        let mut t_error = point_distance(point, corners);
        if seen.aspect < 1e3 && t_error <= seen.along * d.length() {
            // Met flatly, the point leaves the triangle within its plane.
            let normal = (b - a).cross(c - a).normalize_or_zero();
            t_error = t_error.min((point - a).dot(normal).abs());
        }
        if t_error > seen.tolerance * seen.aspect.max(1.0) {
            return Verdict::TOff(odd);
        }
        let weights_error = hit.weights.map_or(0.0, |[u, v]| {
            let p = a + (b - a) * f64::from(u) + (c - a) * f64::from(v);
            edge_distance(o, d, p, p)
        });
        if weights_error > seen.tolerance * seen.seen_aspect.max(1.0) {
            return Verdict::WeightsOff(odd);
        }
        if t_error > seen.tolerance {
            return Verdict::TPoor;
        }
        if weights_error > seen.tolerance {
            return Verdict::WeightsPoor;
        }
        let Some(truth) = truth else {
            return Verdict::Harmless(match crossed {
                Some(_) => Cause::RangeEnd,
                None => Cause::Rim,
            });
        };
        if truth.primitive == hit.primitive {
            return Verdict::Agree;
        }
        let expected = see(ray, self.subject.corners(truth.primitive));
        if truth.ties.contains(&hit.primitive) || (t - truth.t).abs() <= seen.along + expected.along
        {
            return Verdict::Harmless(Cause::Tie);
        }
        if t > truth.t {
            return self.lost(ray, truth, Some(t));
        }
        Verdict::Harmless(match crossed {
            Some(_) => Cause::RangeEnd,
            None => Cause::Rim,
        })
    }

    /// What the occlusion query's difference is, if there is one.
    fn any(&self, ray: Ray, truth: Option<&ReferenceHit>, any: bool) -> Verdict {
        match (truth, any) {
            (None, false) | (Some(_), true) => Verdict::Agree,
            (Some(h), false) => {
                let seen = see(ray, self.subject.corners(h.primitive));
                if !self.must_hit {
                    if at_range_end(ray, h.t, seen.along) {
                        return Verdict::Harmless(Cause::RangeEnd);
                    }
                    let view = self.subject.bvh.view();
                    let misses =
                        probes(ray, seen.tolerance, 0.0).any(|p| p.closest(&view).is_none());
                    if misses {
                        return Verdict::Harmless(Cause::Rim);
                    }
                }
                Verdict::Leak(self.loss(ray, h, &seen))
            }
            (None, true) => {
                // The nearest thing that a ray moved by the coarsest rounding
                // meets must then be within its own.
                let size = self.subject.bvh.nodes[0].max - self.subject.bvh.nodes[0].min;
                let by = TOLERANCE_UNITS * UNIT * 2.0 * f64::from(size.length());
                let along = by / ray.direction.as_dvec3().length();
                let view = self.subject.bvh.view();
                for scale in [1.0, 0.1, 0.01] {
                    for p in probes(ray, by * scale, along) {
                        if let Some((t, _)) = p.closest(&view) {
                            return Verdict::Harmless(if at_range_end(ray, t, along) {
                                Cause::RangeEnd
                            } else {
                                Cause::Rim
                            });
                        }
                    }
                }
                Verdict::FalseHit(Cause::Unexplained)
            }
        }
    }

    fn count(&self, ray: Ray, truth: Option<&ReferenceHit>, answer: Answer) -> Counts {
        let mut counts = Counts {
            rays: 1,
            hits: usize::from(truth.is_some()),
            contradictions: usize::from(answer.any != answer.hit.is_some()),
            ..Default::default()
        };
        let closest = self.closest(ray, truth, answer.hit);
        let cause = match closest {
            Verdict::Agree => None,
            Verdict::Leak(cause) => {
                counts.leaks = 1;
                Some(cause)
            }
            Verdict::FalseHit(cause) => {
                counts.false_hits = 1;
                Some(cause)
            }
            Verdict::TOff(cause) => {
                counts.t_off = 1;
                Some(cause)
            }
            Verdict::WeightsOff(cause) => {
                counts.weights_off = 1;
                Some(cause)
            }
            Verdict::TPoor => {
                counts.t_poor = 1;
                Some(Cause::Sliver)
            }
            Verdict::WeightsPoor => {
                counts.weights_poor = 1;
                Some(Cause::Sliver)
            }
            Verdict::Harmless(Cause::Tie) => {
                counts.prim_ties = 1;
                Some(Cause::Tie)
            }
            Verdict::Harmless(cause) => {
                counts.rims = 1;
                Some(cause)
            }
        };
        if let Some(cause) = cause {
            counts.causes.0[cause as usize] = 1;
            counts.unexplained += usize::from(cause == Cause::Unexplained);
        }
        let mut any = self.any(ray, truth, answer.any);
        if let Verdict::FalseHit(_) = any {
            // The closest hit names the triangle that is taken.
            any = match closest {
                Verdict::FalseHit(cause) | Verdict::TOff(cause) => Verdict::FalseHit(cause),
                Verdict::TPoor => Verdict::Harmless(Cause::Sliver),
                _ => any,
            };
        }
        match any {
            Verdict::Agree => {}
            Verdict::Harmless(_) => counts.occlusion_mismatches = 1,
            Verdict::Leak(cause) | Verdict::FalseHit(cause) => {
                counts.occlusion_mismatches = 1;
                counts.occlusion_errors = 1;
                counts.unexplained += usize::from(cause == Cause::Unexplained);
            }
            Verdict::TOff(_) | Verdict::WeightsOff(_) | Verdict::TPoor | Verdict::WeightsPoor => {
                unreachable!("not of an occlusion query")
            }
        }
        if counts.errors() + counts.unexplained > 0 {
            counts.examples.push(format!(
                "{closest:?}, any {any:?}: {ray:?} gave {answer:?}, not {truth:?}"
            ));
        }
        counts
    }
}

/// Traces the rays with the engine and judges every answer.
///
/// # Panics
/// If the engine answers another number of rays.
#[must_use]
pub fn compare(subject: &Subject, set: &RaySet, engine: &(dyn Engine + Sync)) -> Counts {
    let answers = engine.trace(&set.rays);
    assert_eq!(answers.len(), set.rays.len(), "{}", engine.name());
    let judge = Judge {
        subject,
        engine,
        must_hit: set.must_hit,
    };
    let mut counts = set
        .rays
        .par_iter()
        .zip(&set.truth)
        .zip(&answers)
        .map(|((&ray, truth), &answer)| judge.count(ray, truth.as_ref(), answer))
        .reduce(Counts::default, |mut a, b| {
            a.add(&b);
            a
        });
    if set.again {
        // The hit's own t as the end of the range: the hit must stay.
        let (shorter, found): (Vec<_>, Vec<_>) = set
            .rays
            .iter()
            .zip(&answers)
            .filter_map(|(&ray, a)| a.hit.map(|h| (Ray { t_max: h.t, ..ray }, h)))
            .unzip();
        for ((again, first), ray) in engine.trace(&shorter).iter().zip(found).zip(&shorter) {
            if again.hit.is_none() || !again.any {
                counts.leaks += 1;
                counts.causes.0[Cause::RangeEnd as usize] += 1;
                if counts.examples.len() < 4 {
                    counts
                        .examples
                        .push(format!("again: {ray:?} gave {again:?}, not {first:?}"));
                }
            }
        }
    }
    counts
}
