//! What `report.json` holds. `docs/report.md` explains each field.
//!
//! A measured number that is not finite is `null` in JSON, hence the options.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Version of this layout; goes up when a field changes its meaning or goes.
pub const SCHEMA: u32 = 1;

/// The whole report.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of raytwin.
    pub version: String,
    /// Version of this layout, [`SCHEMA`].
    pub schema: u32,
    /// When the run began, UTC, ISO 8601.
    pub date: String,
    /// Commit of the working tree, where git knows one.
    pub revision: Option<String>,
    /// What it ran on.
    pub machine: Machine,
    /// With which settings.
    pub settings: Settings,
    /// Adapters that were measured; empty with `--cpu`.
    pub adapters: Vec<Adapter>,
    /// Whether the peer was there.
    pub embree: EmbreeInfo,
    /// Version of tinybvh, where it takes part.
    pub tinybvh: Option<String>,
    /// Things that a reader must know before the numbers.
    pub warnings: Vec<String>,
    /// One row a kernel.
    pub kernels: Vec<KernelRow>,
    /// One row a scene, stage, variant and backend.
    pub stages: Vec<StageRow>,
    /// One row a mesh and engine.
    pub bvh: Vec<BvhRow>,
    /// One row a hard family and engine.
    pub families: Vec<FamilyRow>,
    /// What a tree's build costs and buys: one row a mesh and way to build.
    #[serde(default)]
    pub builds: Vec<BuildRow>,
    /// Where the WGSL traversal has its stack: one row an adapter, mesh and place.
    #[serde(default)]
    pub stacks: Vec<StackRow>,
    /// Cost of a ray against the mesh's size: one row a size and engine.
    #[serde(default)]
    pub growth: Vec<GrowthRow>,
    /// Error against samples and time.
    pub convergence: Vec<ConvergenceRow>,
    /// The lines through those points.
    pub slopes: Vec<SlopeRow>,
    /// What their errors are against.
    pub references: Vec<ReferenceRow>,
    /// Reflections at a quarter of a ray a pixel: one row a view, variant and
    /// backend.
    #[serde(default)]
    pub reflections: Vec<ReflectionRow>,
    /// The same by ball: what 16 neighbours are worth.
    #[serde(default)]
    pub reflection_balls: Vec<BallRow>,
    /// Filters over time: one row a sequence and variant.
    #[serde(default)]
    pub sequences: Vec<SequenceRow>,
    /// One row a GGX sampler, roughness and angle.
    #[serde(default)]
    pub samplers: Vec<SamplerRow>,
    /// One row a number of layers.
    #[serde(default)]
    pub layers: Vec<LayerRow>,
    /// Ratios that this house wants to stay below.
    #[serde(default)]
    pub goals: Vec<GoalRow>,
    /// One row an adapter, signal, size and pass of a filter.
    #[serde(default)]
    pub passes: Vec<PassRow>,
    /// Estimators over time: one row a signal and estimator.
    #[serde(default)]
    pub estimators: Vec<EstimatorRow>,
    /// The same: how quiet against how fast.
    #[serde(default)]
    pub estimator_points: Vec<EstimatorPointRow>,
    /// The same: nanoseconds and bytes.
    #[serde(default)]
    pub estimator_costs: Vec<EstimatorCostRow>,
    /// Surfels beside path-traced references: one row a scene, number of slots,
    /// event and frame.
    #[serde(default)]
    pub surfels: Vec<SurfelRow>,
    /// Pictures beside the page.
    pub pictures: Vec<PictureRow>,
    /// Plots beside the page.
    pub plots: Vec<PlotRow>,
    /// Every file of the report, relative to its folder.
    pub files: Vec<String>,
    /// Seconds that the run took.
    pub seconds: f64,
}

/// The computer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Processor, as it names itself.
    pub cpu: String,
    /// Threads that the process may use.
    pub threads: usize,
    /// Operating system.
    pub os: String,
    /// Instruction set.
    pub arch: String,
}

/// What was asked for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// `quick` or `full`.
    pub mode: String,
    /// The filter, if any.
    pub only: Option<String>,
    /// Scene file, if any.
    pub scene: Option<String>,
    /// Whether the CPU was measured.
    pub cpu: bool,
    /// Whether adapters were measured.
    pub gpu: bool,
    /// Random inputs behind each error.
    pub kernel_inputs: usize,
    /// Elements in a timed array.
    pub timed_elements: usize,
    /// Timed runs behind each CPU median.
    pub timed_runs: usize,
    /// Rays of each kind behind each rate.
    pub rays: usize,
    /// Rounds over all engines behind each rate.
    pub ray_rounds: usize,
    /// Rays of each hard family.
    pub family_rays: usize,
    /// Pixels of the pictures.
    pub picture: [u32; 2],
}

/// One adapter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Adapter {
    /// Name and driver, as other tables use it.
    pub label: String,
    /// Name.
    pub name: String,
    /// Driver.
    pub driver: String,
    /// Driver's version and more.
    pub driver_info: String,
    /// Kind of device.
    pub device_type: String,
    /// Graphics interface.
    pub backend: String,
    /// Whether the processor does the work.
    pub software: bool,
    /// Whether times come from the device's own clock.
    pub timestamps: bool,
    /// Whether the precise build runs here.
    pub precise: bool,
}

/// The peer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EmbreeInfo {
    /// Whether it was found.
    pub found: bool,
    /// Its version.
    pub version: Option<String>,
    /// What to do where it was not.
    pub mend: Option<String>,
}

/// One kernel.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelRow {
    /// Function, the same in Rust and WGSL.
    pub name: String,
    /// Technique, `group/name`.
    pub module: String,
    /// First part of that.
    pub group: String,
    /// `A` bit-exact, `B` a few ULP, `C` transcendental.
    pub class: String,
    /// Arguments and result as WGSL spells them.
    pub signature: String,
    /// Paper and equation.
    pub source: String,
    /// Nanoseconds a call of the CPU twin, one thread, the median; `null` with
    /// `--gpu`.
    pub cpu_ns: Option<f64>,
    /// The same over the time of the calibration loop of the same runs.
    pub cpu_ratio: Option<f64>,
    /// Nanoseconds an element on the first adapter.
    pub gpu_ns: Option<f64>,
    /// Each adapter's numbers, by label.
    pub adapters: BTreeMap<String, KernelOnAdapter>,
    /// Largest error of the CPU twin against the truth.
    pub cpu_err_ulp_max: Option<f64>,
    /// Its mean.
    pub cpu_err_ulp_mean: Option<f64>,
    /// Its median.
    pub cpu_err_ulp_median: Option<f64>,
    /// Elements whose integer part is wrong.
    pub cpu_wrong: usize,
    /// Declared bound of the CPU twin.
    pub cpu_bound: f64,
    /// Largest error of the WGSL twin on any adapter.
    pub gpu_err_ulp_max: Option<f64>,
    /// Declared bound of the WGSL twin.
    pub gpu_bound: f64,
    /// Largest difference between the twins on any adapter, plain build.
    pub parity_ulp_max: Option<f64>,
    /// Its bound, the sum of the two.
    pub parity_bound: f64,
    /// Hard inputs.
    pub hard_cases: HardCases,
    /// Inputs behind the errors: random ones and the hard cases.
    pub inputs: usize,
    /// Of those, left out since a discrete part is within rounding.
    pub undecided: usize,
    /// Whether every measured error is within its bound.
    pub within: bool,
    /// Other ways to compute the same thing.
    pub baselines: Vec<BaselineRow>,
}

/// Hard inputs of one kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HardCases {
    /// How many there are.
    pub tried: usize,
    /// On how many every twin that ran is within its bound of the truth.
    pub passed: usize,
    /// How many were not compared.
    pub undecided: usize,
}

/// A kernel on one adapter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KernelOnAdapter {
    /// Nanoseconds an element, plain build.
    pub ns: f64,
    /// Largest error against the truth.
    pub err_ulp_max: Option<f64>,
    /// Its mean.
    pub err_ulp_mean: Option<f64>,
    /// Its median.
    pub err_ulp_median: Option<f64>,
    /// Elements whose integer part is wrong.
    pub wrong: usize,
    /// Largest difference to the CPU twin.
    pub parity_ulp_max: Option<f64>,
    /// Elements whose integer part differs from the CPU twin's.
    pub parity_wrong: usize,
    /// Elements whose bits differ from the CPU twin's in the precise build;
    /// `null` where that does not run.
    pub precise_differing: Option<usize>,
    /// Whether all of it is within the bounds.
    pub within: bool,
}

/// Another way to compute what a kernel computes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BaselineRow {
    /// What it is.
    pub name: String,
    /// Nanoseconds a call on the CPU.
    pub cpu_ns: Option<f64>,
    /// Largest error on the CPU.
    pub cpu_err_ulp_max: Option<f64>,
    /// Its mean.
    pub cpu_err_ulp_mean: Option<f64>,
    /// Its median.
    pub cpu_err_ulp_median: Option<f64>,
    /// Elements whose integer part is wrong on the CPU.
    pub cpu_wrong: usize,
    /// Each adapter's numbers, by label.
    pub adapters: BTreeMap<String, BaselineOnAdapter>,
}

/// A baseline on one adapter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BaselineOnAdapter {
    /// Nanoseconds an element.
    pub ns: f64,
    /// Largest error against the truth.
    pub err_ulp_max: Option<f64>,
    /// Its mean.
    pub err_ulp_mean: Option<f64>,
    /// Its median.
    pub err_ulp_median: Option<f64>,
    /// Elements whose integer part is wrong.
    pub wrong: usize,
}

/// One stage on one backend.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageRow {
    /// Stage.
    pub name: String,
    /// Scene.
    pub scene: String,
    /// `1 spp`, `reference`, or `exact`.
    pub variant: String,
    /// `cpu`, or the adapter's label.
    pub backend: String,
    /// Samples of a pixel.
    pub samples: u32,
    /// Milliseconds for the picture.
    pub ms: f64,
    /// Rays traced.
    pub rays: u64,
    /// Error against the CPU's reference; `null` for that itself.
    pub rmse: Option<f64>,
    /// Difference to the CPU's picture of the same samples.
    pub parity_rmse: Option<f64>,
    /// Pixels that differ from that.
    pub differing: Option<usize>,
    /// Pixels of the picture.
    pub pixels: usize,
}

/// One variant of the reflections in one view on one backend.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReflectionRow {
    /// Scene.
    pub scene: String,
    /// `above` or `grazing`.
    pub view: String,
    /// `cpu`, or the adapter's label.
    pub backend: String,
    /// Neighbours gathered from half-resolution rays; 0 for a ray of the
    /// pixel's own.
    pub neighbours: u32,
    /// Whether the bilateral filter follows.
    pub bilateral: bool,
    /// Milliseconds for the rays.
    pub trace_ms: f64,
    /// Milliseconds for reconstruction and filter.
    pub filter_ms: f64,
    /// Error over the pixels with a ball.
    pub rmse: f64,
    /// The part of it that does not average out.
    pub bias: Option<f64>,
    /// Rays a pixel with the same variance.
    pub rays_by_variance: Option<f64>,
    /// Rays a pixel with the same error.
    pub rays_by_error: Option<f64>,
    /// Difference to the CPU's picture.
    pub parity_rmse: Option<f64>,
    /// Pixels that differ from that.
    pub differing: Option<usize>,
    /// Pixels with a ball.
    pub pixels: usize,
}

/// What reconstruction is worth on one ball.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BallRow {
    /// Scene.
    pub scene: String,
    /// `above` or `grazing`.
    pub view: String,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Whether a clear coat lies over it.
    pub coated: bool,
    /// Neighbours.
    pub neighbours: u32,
    /// Whether the bilateral filter follows.
    pub bilateral: bool,
    /// Rays a pixel with the same variance.
    pub rays_by_variance: f64,
    /// Rays a pixel with the same error.
    pub rays_by_error: f64,
}

/// One way to filter a sequence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SequenceRow {
    /// Scene.
    pub scene: String,
    /// What is traced and filtered.
    pub signal: String,
    /// What moves.
    pub event: String,
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    /// How it is filtered.
    pub variant: String,
    /// What is different from SVGF with three passes; `null` for what is no
    /// piece of it.
    pub piece: Option<String>,
    /// Milliseconds a frame on the CPU.
    pub ms: f64,
    /// The same by adapter: the sum of the passes that the variant is made of.
    pub gpu_ms: BTreeMap<String, Option<f64>>,
    /// Error of the last frame.
    pub rmse: f64,
    /// The reference's own error.
    pub reference_rmse: f64,
    /// Its square over the reference's.
    pub relative_mse: f64,
    /// Peak signal-to-noise ratio in decibels.
    pub psnr: f64,
    /// Structural similarity.
    pub ssim: Option<f64>,
    /// Mean of FLIP.
    pub flip: f64,
    /// Mean change of the error between the last two frames.
    pub flicker: f64,
    /// Frames until half of a jump has arrived.
    pub half_life: Option<u32>,
    /// Frame and error, where there is a reference.
    pub by_frame: Vec<(u32, f64)>,
}

/// One GGX sampler at one roughness and angle.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SamplerRow {
    /// Sampler.
    pub sampler: String,
    /// GGX roughness.
    pub alpha: f32,
    /// Angle of the view from the normal.
    pub degrees: f32,
    /// Variance of value times cosine over density, over its squared mean.
    pub variance: f64,
    /// Nanoseconds for a direction with its density, on the CPU.
    pub ns: f64,
    /// One over variance times nanoseconds, over that of the normal
    /// distribution.
    pub efficiency: f64,
}

/// A stack with this many of the four layers of a paint.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerRow {
    /// Layers above the diffuse base.
    pub layers: u32,
    /// Which of the four err least.
    pub kept: String,
    /// Misplaced light over all that the four reflect.
    pub error: f64,
    /// Nanoseconds of `layered_pdf`, `layered_eval`, `layered_sample`.
    pub cpu_ns: [Option<f64>; 3],
    /// The same by adapter.
    pub gpu_ns: BTreeMap<String, [Option<f64>; 3]>,
}

/// A ratio and the limit that it should stay below.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GoalRow {
    /// What is compared with what.
    pub name: String,
    /// `cpu`, or the adapter's label.
    pub backend: String,
    /// The ratio.
    pub measured: f64,
    /// Its limit.
    pub limit: f64,
    /// The two numbers.
    pub detail: String,
    /// What a kernel is compared with, where that is a shader.
    pub shader: Option<String>,
}

/// A pass of SVGF on an adapter, and the memory it moves.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PassRow {
    /// The adapter's label.
    pub backend: String,
    /// The filter, and what it filters where there is a choice.
    pub signal: String,
    /// Where the images are: `Buffers`, `Textures16`, `its own buffers`.
    pub images: String,
    /// Width and height.
    pub size: [u32; 2],
    /// `variance`, or `step 4`.
    pub pass: String,
    /// Milliseconds by the device's clock, the median.
    pub ms: f64,
    /// Bytes that the shader asks for, each tap counted.
    pub counted: u64,
    /// Bytes if each input were read once and each output written once.
    pub ideal: u64,
    /// Those over the time, GB a second.
    pub gb_s: f64,
    /// What a copy of a buffer reaches in the same run, reads and writes.
    pub copy_gb_s: f64,
}

/// One estimator's answers to one signal, after the frame in which it moves.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorRow {
    /// Signal.
    pub signal: String,
    /// Estimator.
    pub estimator: String,
    /// Root-mean-square error over 512 frames and all runs.
    pub rmse: f64,
    /// Mean of the answers over that of the signal.
    pub bias: f64,
    /// Frames until half of a step has arrived.
    pub half_life: Option<f64>,
    /// Frames until nine tenths have.
    pub ninety: Option<f64>,
    /// Whether the plot shows the answer; else its error.
    pub shows_answer: bool,
    /// Frames of the lists below, counted from 1.
    pub frames: Vec<u32>,
    /// Mean answer.
    pub answer_by_frame: Vec<f64>,
    /// Root-mean-square error.
    pub rmse_by_frame: Vec<f64>,
}

/// One estimator with one setting: how quiet and how fast.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorPointRow {
    /// Estimator, and what its setting is.
    pub estimator: String,
    /// The setting.
    pub setting: String,
    /// Noise of the samples.
    pub noise: String,
    /// Level before the step.
    pub from: f32,
    /// Level after it.
    pub to: f32,
    /// Frames until half of the step has arrived; `null` beyond 2048.
    pub half_life: Option<f64>,
    /// Variance of the answers to a still signal over that of the samples.
    pub residual: f64,
    /// Mean of those answers; 1 is right.
    pub mean: f64,
    /// The residual over that of an exponential average of this half-life.
    pub to_frontier: Option<f64>,
}

/// What an estimator costs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EstimatorCostRow {
    /// Estimator.
    pub estimator: String,
    /// Bytes of a state.
    pub bytes: usize,
    /// Nanoseconds of a frame, on the CPU.
    pub cpu_ns: Option<f64>,
    /// The same by adapter.
    pub gpu_ns: BTreeMap<String, Option<f64>>,
    /// Difference of the packed state's answers from the whole one's, root
    /// mean square, over the signal.
    pub packed_error: Option<f64>,
}

/// How far a picture with surfels is from its reference, at a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfelRow {
    /// `Cornell` or `kitchen`.
    pub scene: String,
    /// What happened.
    pub event: String,
    /// Slots of the pool.
    pub slots: u32,
    /// Frames since, from 1.
    pub frame: u32,
    /// Surfels in the pool.
    pub alive: u32,
    /// Root mean squared error.
    pub rmse: f64,
    /// The same without light that bounces.
    pub direct_rmse: f64,
    /// Mean FLIP.
    pub flip: f64,
    /// Part of the shown surfaces that no surfel covers.
    pub bare: f64,
    /// Mean of the picture over that of the reference; after the lamp went out,
    /// the light that is left over that before.
    pub mean: f64,
    /// Milliseconds of the frame, its rays too.
    pub ms: f64,
}

/// Millions of rays a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// Camera rays, closest hit.
    pub primary: f64,
    /// Rays towards the light, any hit.
    pub shadow: f64,
    /// Cosine-distributed rays, closest hit.
    pub diffuse: f64,
    /// Cosine-distributed rays of limited length, any hit.
    pub ao: f64,
}

impl Rates {
    /// Geometric mean of the four.
    #[must_use]
    pub fn mean(&self) -> f64 {
        (self.primary * self.shadow * self.diffuse * self.ao)
            .sqrt()
            .sqrt()
    }
}

/// One engine on one mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BvhRow {
    /// Mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: usize,
    /// Engine.
    pub engine: String,
    /// Milliseconds for the build, one thread; `null` where the engine takes
    /// another one's tree.
    pub build_ms: Option<f64>,
    /// Rates, one thread on the CPU.
    pub mrays: Rates,
    /// The same over Embree default's of the same run.
    pub to_embree: Option<Rates>,
    /// Threads of the processor.
    pub threads: usize,
    /// Rates with all of them; `null` on an adapter.
    pub all_threads: Option<Rates>,
    /// The same over Embree default's with all threads.
    pub all_to_embree: Option<Rates>,
    /// Bytes a triangle of what is walked; `null` where that is not known.
    pub bytes: Option<f64>,
    /// Rays that were checked against the truth.
    pub checked: usize,
    /// Hits that it loses.
    pub leaks: usize,
    /// Hits that are none.
    pub false_hits: usize,
    /// Hits of another triangle at another distance than the truth.
    pub disagreements: usize,
    /// Hits of another triangle at the same distance; not an error.
    pub ties: usize,
}

/// One engine on one hard family.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FamilyRow {
    /// What the rays do.
    pub family: String,
    /// Engine.
    pub engine: String,
    /// How many rays.
    pub rays: usize,
    /// Hits that it loses.
    pub leaks: usize,
    /// Hits that are none.
    pub false_hits: usize,
    /// Hits of another triangle at another distance than the truth.
    pub disagreements: usize,
    /// Hits of another triangle at the same distance; not an error.
    pub ties: usize,
}

/// One way to build one mesh's tree.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BuildRow {
    /// Mesh.
    pub mesh: String,
    /// Its triangles.
    pub triangles: usize,
    /// Engine; our quality is in `quality`.
    pub engine: String,
    /// Quality of the build, where the engine has several.
    pub quality: Option<String>,
    /// Milliseconds for the build and what follows it, one thread.
    pub build_ms: f64,
    /// Rates, one thread.
    pub mrays: Rates,
    /// Their geometric mean.
    pub mean: f64,
    /// Rays from the eye to points on edges and to vertices that were checked.
    pub aimed: usize,
    /// Hits that it loses of those.
    pub leaks: usize,
    /// Hits that are none, of those.
    pub false_hits: usize,
}

/// The WGSL traversal with its stack in one place.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StackRow {
    /// Mesh.
    pub mesh: String,
    /// Adapter.
    pub adapter: String,
    /// `function` (as the kernel has it), `private` or `workgroup`.
    pub stack: String,
    /// Rays a workgroup.
    pub workgroup: u32,
    /// Rates.
    pub mrays: Rates,
    /// Their geometric mean over that of the kernel as it is.
    pub ratio: f64,
    /// Camera rays with another hit than those of the kernel as it is.
    pub differing: usize,
}

/// One engine on a sphere of one size.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GrowthRow {
    /// Triangles of the displaced sphere.
    pub triangles: usize,
    /// Engine.
    pub engine: String,
    /// Nanoseconds a ray: geometric mean of the four kinds, one thread.
    pub ns: f64,
}

/// One point of a convergence plot.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConvergenceRow {
    /// Scene.
    pub scene: String,
    /// Stage.
    pub stage: String,
    /// Source of random numbers.
    pub sampler: String,
    /// `cpu`, or the adapter's label.
    pub backend: String,
    /// Samples of a pixel.
    pub samples: u32,
    /// Error against the reference.
    pub rmse: f64,
    /// Milliseconds for the picture.
    pub ms: f64,
    /// Rays traced.
    pub rays: u64,
}

/// The line through a sampler's points.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SlopeRow {
    /// Scene.
    pub scene: String,
    /// Stage.
    pub stage: String,
    /// Source of random numbers.
    pub sampler: String,
    /// `cpu`, or the adapter's label.
    pub backend: String,
    /// Exponent of the error in the number of samples.
    pub slope: f64,
    /// Error at one sample according to the line.
    pub at_one: f64,
}

/// A converged picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceRow {
    /// Scene.
    pub scene: String,
    /// Stage.
    pub stage: String,
    /// Samples of a pixel.
    pub samples: u32,
    /// Estimate of its own error.
    pub rmse: f64,
    /// Pixels that count.
    pub pixels: usize,
}

/// A picture file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureRow {
    /// Its path in the report's folder.
    pub file: String,
    /// Scene.
    pub scene: String,
    /// Stage; `null` for all together.
    pub stage: Option<String>,
    /// Variant, or the sampler's name.
    pub variant: String,
    /// `cpu`, or the adapter's label.
    pub backend: String,
    /// Whether it shows a difference.
    pub difference: bool,
    /// What one sees.
    pub caption: String,
}

/// A plot file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PlotRow {
    /// Its path in the report's folder.
    pub file: String,
    /// What it shows.
    pub title: String,
}

/// `None` for what JSON cannot say.
#[must_use]
pub fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}
