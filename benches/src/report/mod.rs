//! The speed-against-error report.
//!
//! [`run`] measures what [`Options`] ask for and writes a folder: `index.html`
//! (self-contained), `report.json` ([`schema`]), `measured.md` (tables for a page
//! of text), and the pictures and plots as files. Kernels come from the registry,
//! traversal engines from `bvh`, pictures and convergence from
//! [`crate::stages`].

pub mod bvh;
mod error;
mod estimator;
mod filters;
pub mod kernels;
mod machine;
mod materials;
mod measured;
mod names;
mod output;
mod page;
mod passes;
pub mod plot;
mod plots;
mod progress;
pub mod schema;
mod terminal;
mod traversal;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::rc::Rc;

use raytwin::contract::Kernel;
use raytwin_tests::embree::{EmbreeError, EmbreeOptions, EmbreeScene};
use raytwin_tests::gpu::{self, Gpu};
use raytwin_tests::rays::families;
use raytwin_tests::scene::{Scene, sponza_path};

use crate::reflections::{self, ReflectionGpu, ReflectionScene, ReflectionSettings};
use crate::sequence::{self, SequenceSettings};
use crate::stages::{self, Backend, GpuStages, PIXELS_MAX, StageError, StageScene, StageSettings};
use crate::tinybvh::Tinybvh;
use passes::PassCosts;

pub use error::ReportError;

use names::Only;
use output::Output;
use progress::Progress;
use schema::{
    BallRow, ConvergenceRow, EmbreeInfo, PictureRow, PlotRow, ReferenceRow, ReflectionRow, Report,
    SequenceRow, Settings, SlopeRow, StageRow, SurfelRow,
};
use traversal::{Stack, Traversal, WORKGROUP};

/// What to measure and where to write.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The long run.
    pub full: bool,
    /// A mesh file in place of the kitchen, the toy room and Sponza.
    pub scene: Option<PathBuf>,
    /// Only what has this in its name.
    pub only: Option<String>,
    /// Leave out the GPU.
    pub cpu_only: bool,
    /// Leave out the CPU.
    pub gpu_only: bool,
    /// Pixels of the pictures.
    pub size: Option<(u32, u32)>,
    /// The folder.
    pub out: PathBuf,
}

/// What a run gave.
#[derive(Clone, Debug)]
pub struct Written {
    /// The numbers.
    pub report: Report,
    /// Where everything is.
    pub folder: PathBuf,
}

/// A picture with its PNG.
struct Shown {
    row: PictureRow,
    png: Vec<u8>,
}

/// A plot with its SVG.
struct Drawn {
    row: PlotRow,
    svg: String,
}

/// Measures and writes the report, showing progress on standard error.
///
/// # Errors
/// Bad input, before anything is measured or written: a scene that does not
/// load, a size of zero, a filter without match, a folder that cannot be
/// written to, no adapter. Later: a program that an adapter does not take.
pub fn run(options: &Options) -> Result<Written, ReportError> {
    let progress = Progress::new();
    let result = Run::new(options, &progress).and_then(Run::measure);
    progress.finish();
    result
}

struct Run<'a> {
    options: &'a Options,
    progress: &'a Progress,
    only: Only,
    kernels: Vec<Kernel>,
    scenes: Vec<Scene>,
    meshes: Vec<Scene>,
    gpus: Vec<&'static Gpu>,
    stage_settings: StageSettings,
    reflection_settings: ReflectionSettings,
    kernel_settings: kernels::KernelSettings,
    bvh_settings: bvh::BvhSettings,
    output: Output,
    tinybvh: Option<Tinybvh>,
    report: Report,
}

fn stage_entry(scene: &str, stage: &str) -> String {
    format!("stages/{scene}/{stage}")
}

/// The stage that `crate::reflections` renders.
const REFLECTIONS: &str = "reflections";

/// What `crate::sequence` measures.
const SEQUENCES: &str = "sequences";

/// Samplers, layers and the goals.
const MATERIALS: &str = "materials";

/// Estimators over time.
const ESTIMATOR: &str = "estimator";

/// Surfels beside path-traced references.
pub(crate) const SURFELS: &str = "surfels";

/// Meshes in which the places of the WGSL traversal's stack are compared.
const STACKS: [&str; 2] = ["kitchen", "terrain"];

/// Name of the cost of a ray against the mesh's size.
const GROWTH: &str = "bvh/growth";

/// Entries of a scene that need it loaded.
fn scene_entries(scene: &str) -> Vec<String> {
    let stages = stages::Stage::ALL.map(stages::Stage::name);
    let others = ["convergence", REFLECTIONS];
    let stages = stages.into_iter().chain(others);
    let mut entries: Vec<_> = stages.map(|stage| stage_entry(scene, stage)).collect();
    for signal in sequence::Signal::ALL {
        let events = sequence::Event::ALL.into_iter();
        entries.extend(events.map(|event| sequence_entry(scene, signal, event)));
    }
    entries
}

/// What `--only` calls a sequence: `stages/toy/sequences/soft-shadow/light-jumps`,
/// with hyphens, so that the name of a stage does not ask for its sequences.
fn sequence_entry(scene: &str, signal: sequence::Signal, event: sequence::Event) -> String {
    let name = format!("{}/{}", signal.name(), event.name()).replace(['_', ' '], "-");
    stage_entry(scene, &format!("{SEQUENCES}/{name}"))
}

impl<'a> Run<'a> {
    /// Checks everything that the caller gave before any work.
    fn new(options: &'a Options, progress: &'a Progress) -> Result<Self, ReportError> {
        let mut stage_settings = if options.full {
            StageSettings::full()
        } else {
            StageSettings::quick()
        };
        let mut reflection_settings = if options.full {
            ReflectionSettings::full()
        } else {
            ReflectionSettings::quick()
        };
        if let Some((width, height)) = options.size {
            let pixels = u64::from(width) * u64::from(height);
            if pixels == 0 || pixels > PIXELS_MAX {
                return Err(StageError::Size { width, height }.into());
            }
            (stage_settings.width, stage_settings.height) = (width, height);
            (reflection_settings.width, reflection_settings.height) = (width, height);
        }
        let kernels: Vec<Kernel> = raytwin::registry()
            .into_iter()
            .flat_map(|t| t.kernels)
            .collect();
        let (scene_names, given) = match &options.scene {
            Some(path) => {
                let scene = Scene::load(path)?;
                (vec![scene.name.clone()], Some(scene))
            }
            None => (vec!["kitchen".into(), "toy".into()], None),
        };
        let sponza = sponza_path().filter(|_| given.is_none());
        let mut mesh_names = scene_names.clone();
        mesh_names.extend(sponza.is_some().then(|| "sponza".into()));
        mesh_names.extend(bvh::GENERATED.map(String::from));
        if options.full {
            mesh_names.extend(bvh::GENERATED_FULL.map(String::from));
        }

        let mut names: Vec<String> = kernels.iter().map(Kernel::path).collect();
        for scene in &scene_names {
            names.extend(scene_entries(scene));
        }
        names.push(MATERIALS.into());
        names.push(ESTIMATOR.into());
        names.push(SURFELS.into());
        names.extend(mesh_names.iter().map(|mesh| format!("bvh/{mesh}")));
        names.push("bvh/families".into());
        names.extend(mesh_names.iter().map(|mesh| format!("bvh/builds/{mesh}")));
        names.extend(STACKS.map(|mesh| format!("bvh/stacks/{mesh}")));
        names.push(GROWTH.into());
        let only = Only::new(options.only.as_deref(), &names)?;

        let output = Output::prepare(&options.out)?;
        let mut warnings = Vec::new();
        let gpus = if options.cpu_only {
            Vec::new()
        } else {
            gpu::adapters().map_err(ReportError::Gpu)?.iter().collect()
        };

        let load = |name: &str| -> Result<Scene, ReportError> {
            Ok(match (&given, &sponza) {
                (Some(scene), _) => scene.clone(),
                (None, Some(path)) if name == "sponza" => Scene::load(path)?,
                _ if name == "kitchen" => Scene::kitchen()?,
                _ => Scene::toy_room(),
            })
        };
        let mut scenes = Vec::new();
        for name in &scene_names {
            if scene_entries(name).iter().any(|e| only.takes(e)) {
                scenes.push(load(name)?);
            }
        }
        let mut meshes = Vec::new();
        for name in mesh_names {
            let builds = only.takes(&format!("bvh/builds/{name}"));
            let stacks =
                STACKS.contains(&name.as_str()) && only.takes(&format!("bvh/stacks/{name}"));
            if only.takes(&format!("bvh/{name}")) || builds || stacks {
                // The given scene comes first, whatever its name.
                let is_given = given.is_some() && meshes.is_empty() && name == scene_names[0];
                meshes.push(match bvh::generated(&name) {
                    Some(scene) if !is_given => scene,
                    _ => load(&name)?,
                });
            }
        }

        let embree = embree();
        if let Some(mend) = &embree.mend {
            warnings.push(format!(
                "Embree was not found, so nothing here is compared with it. {mend}"
            ));
        }
        let tinybvh = Tinybvh::find();
        if let Err(error) = &tinybvh {
            warnings.push(format!(
                "tinybvh takes no part, so nothing here is compared with it: {error}."
            ));
        }
        let tinybvh = tinybvh.ok();
        if !options.cpu_only && gpus.iter().all(|g| g.is_software()) {
            warnings.push(
                "Every adapter here is a software driver: the processor runs the GPU's programs, \
                 so their times say nothing about graphics hardware."
                    .into(),
            );
        }
        for warning in &warnings {
            progress.warn(warning);
        }
        let (kernel_settings, bvh_settings) = if options.full {
            (kernels::KernelSettings::full(), bvh::BvhSettings::full())
        } else {
            (kernels::KernelSettings::quick(), bvh::BvhSettings::quick())
        };
        let report = Report {
            version: env!("CARGO_PKG_VERSION").into(),
            schema: schema::SCHEMA,
            date: machine::date(),
            revision: machine::revision(),
            machine: machine::machine(),
            settings: Settings {
                mode: if options.full { "full" } else { "quick" }.into(),
                only: options.only.clone(),
                scene: options.scene.as_ref().map(|p| p.display().to_string()),
                cpu: !options.gpu_only,
                gpu: !options.cpu_only,
                kernel_inputs: kernel_settings.inputs,
                timed_elements: kernel_settings.elements,
                timed_runs: kernel_settings.runs,
                rays: bvh_settings.rays,
                ray_rounds: bvh_settings.rounds,
                family_rays: bvh_settings.family_rays,
                picture: [stage_settings.width, stage_settings.height],
            },
            adapters: gpus.iter().map(|g| machine::adapter(g)).collect(),
            embree,
            tinybvh: tinybvh.as_ref().map(|t| t.version.clone()),
            warnings,
            ..Report::default()
        };
        Ok(Self {
            options,
            progress,
            only,
            kernels,
            scenes,
            meshes,
            gpus,
            stage_settings,
            reflection_settings,
            kernel_settings,
            bvh_settings,
            output,
            tinybvh,
            report,
        })
    }

    fn measure(mut self) -> Result<Written, ReportError> {
        self.measure_kernels()?;
        self.measure_bvh()?;
        self.measure_materials()?;
        self.measure_estimator()?;
        let mut pictures = self.measure_stages()?;
        pictures.extend(self.measure_surfels()?);
        let plots = plots::all(&self.report)?;
        let Self {
            mut report,
            output,
            progress,
            ..
        } = self;
        report.pictures = pictures.iter().map(|p| p.row.clone()).collect();
        report.plots = plots.iter().map(|p| p.row.clone()).collect();
        report.seconds = progress.seconds();
        let mut files = BTreeMap::new();
        for picture in &pictures {
            files.insert(picture.row.file.clone(), picture.png.clone());
        }
        for plot in &plots {
            files.insert(plot.row.file.clone(), plot.svg.clone().into_bytes());
        }
        report.files = files.keys().cloned().collect();
        report
            .files
            .extend([output::PAGE, output::JSON, output::TABLES].map(String::from));
        let tables = measured::measured(&report);
        files.insert(output::TABLES.into(), tables.into_bytes());
        let page = page::page(&report, &pictures, &plots);
        files.insert(output::PAGE.into(), page.into_bytes());
        files.insert(output::JSON.into(), serde_json::to_vec_pretty(&report)?);
        let folder = output.write(&files)?;
        Ok(Written { report, folder })
    }

    fn measure_kernels(&mut self) -> Result<(), ReportError> {
        let chosen: Vec<&Kernel> = self
            .kernels
            .iter()
            .filter(|k| self.only.takes(&k.path()))
            .collect();
        self.progress.part("kernels", chosen.len());
        for kernel in chosen {
            self.progress.step(&kernel.path());
            self.report.kernels.push(kernels::measure(
                kernel,
                &self.kernel_settings,
                !self.options.gpu_only,
                &self.gpus,
            )?);
        }
        Ok(())
    }

    fn measure_materials(&mut self) -> Result<(), ReportError> {
        if !self.only.takes(MATERIALS) {
            return Ok(());
        }
        let runs = self.kernel_settings.runs;
        let with_cpu = !self.options.gpu_only;
        self.progress.part("materials", 4);
        self.progress.step("samplers");
        if with_cpu {
            self.report.samplers = materials::samplers(runs);
        }
        self.progress.step("layers");
        self.report.layers = materials::layers(runs, with_cpu, &self.gpus)?;
        self.progress.step("goals");
        if with_cpu {
            self.report.goals = materials::goals(runs, &self.report.layers);
        }
        self.progress.step("filters over whole images");
        if with_cpu {
            self.report.goals.extend(filters::goals(
                self.stage_settings.repeats,
                self.options.full,
            ));
        }
        self.report
            .goals
            .extend(filters::gpu_tiles(&self.gpus, self.stage_settings.repeats)?);
        self.report.passes = filters::gpu_passes(&self.gpus, self.stage_settings.repeats)?;
        for gpu in self.gpus.iter().filter(|g| g.has_timestamps()) {
            let sizes = if gpu.is_software() {
                &filters::GPU_SIZES[..1]
            } else {
                &filters::GPU_SIZES[1..]
            };
            for size in sizes {
                let repeats = self.stage_settings.repeats.min(3);
                let costs = PassCosts::measure(gpu, *size, repeats)?;
                self.report.passes.extend(costs.rows());
            }
        }
        let by_hand = materials::by_hand(&self.kernels, runs, &self.gpus)?;
        self.report.goals.extend(by_hand);
        Ok(())
    }

    fn measure_estimator(&mut self) -> Result<(), ReportError> {
        if !self.only.takes(ESTIMATOR) {
            return Ok(());
        }
        let settings = if self.options.full {
            estimator::EstimatorSettings::full()
        } else {
            estimator::EstimatorSettings::quick()
        };
        let with_cpu = !self.options.gpu_only;
        self.progress.part("estimator", 3);
        self.progress.step("responses");
        if with_cpu {
            self.report.estimators = estimator::responses(&settings);
        }
        self.progress.step("quiet against fast");
        if with_cpu {
            self.report.estimator_points = estimator::points(&settings);
        }
        self.progress.step("costs");
        self.report.estimator_costs = estimator::costs(
            &self.kernels,
            &settings,
            self.kernel_settings.runs,
            with_cpu,
            &self.gpus,
        )?;
        Ok(())
    }

    fn measure_reflections(
        &mut self,
        scene: &StageScene,
        progress: &dyn Fn(&str),
    ) -> Result<Vec<Shown>, ReportError> {
        let mut shown = Vec::new();
        let Some(scene) = ReflectionScene::new(scene) else {
            return Ok(shown);
        };
        let compiled: Result<Vec<_>, _> = self.gpus.iter().map(|g| ReflectionGpu::new(g)).collect();
        let compiled = compiled?;
        let mut backends = Vec::new();
        if !self.options.gpu_only {
            backends.push(reflections::Backend::Cpu);
        }
        backends.extend(compiled.iter().map(reflections::Backend::Gpu));
        for view in 0..scene.views().len() {
            let run =
                reflections::measure(&scene, view, &self.reflection_settings, &backends, progress)?;
            self.report
                .reflections
                .extend(run.results.into_iter().map(reflection_row));
            self.report
                .reflection_balls
                .extend(run.balls.into_iter().map(ball_row));
            for picture in run.pictures {
                shown.push(show_reflection(scene.views()[view], picture)?);
            }
        }
        Ok(shown)
    }

    /// The sequences of a scene: for the long run all, at full size, for the quick
    /// report four.
    fn measure_sequences(
        &mut self,
        scene: &StageScene,
        progress: &dyn Fn(&str),
    ) -> Result<Vec<Shown>, ReportError> {
        use sequence::{Event, Signal};
        let mut shown = Vec::new();
        let mut costs: Vec<([u32; 2], Vec<PassCosts>)> = Vec::new();
        let balls = ReflectionScene::new(scene).unwrap_or_else(|| ReflectionScene::bare(scene));
        let full = self.options.full;
        let possible = |signal: Signal, event| {
            let needs_balls = signal == Signal::Reflection || event == Event::Ball;
            let name = sequence_entry(&scene.scene.name, signal, event);
            signal.has(event) && (balls.has_balls() || !needs_balls) && self.only.takes(&name)
        };
        let mut jobs = Vec::new();
        for signal in Signal::ALL {
            for event in Event::ALL.into_iter().filter(|e| possible(signal, *e)) {
                // What is asked for more closely than all sequences is wanted at
                // any length.
                let named = !self.only.takes(&stage_entry(&scene.scene.name, SEQUENCES));
                let quick = named
                    || matches!(
                        (signal, event),
                        (Signal::SoftShadow, Event::LightJumps | Event::Ball)
                            | (Signal::AmbientOcclusion | Signal::Reflection, Event::Pan)
                    );
                if full {
                    jobs.push((signal, event, SequenceSettings::full()));
                } else if quick {
                    jobs.push((signal, event, SequenceSettings::quick()));
                }
            }
        }
        for (signal, event, mut settings) in jobs {
            if let Some(size) = self.options.size {
                (settings.width, settings.height) = size;
            }
            let name = &scene.scene.name;
            let what = format!(
                "{name}: {}, {}, {} x {}",
                signal.title(),
                event.name(),
                settings.width,
                settings.height
            );
            progress(&what);
            let within = |frame: &str| self.progress.within(&format!("{what}, {frame}"));
            let run = sequence::measure(&balls, signal, event, &settings, &within)?;
            let size = run.results.first().map_or([0; 2], |r| r.size);
            if !costs.iter().any(|(s, _)| *s == size) && size[0] > 0 {
                let of = glam::UVec2::from_array(size);
                let clocks = self.gpus.iter().filter(|g| g.has_timestamps());
                let all: Result<Vec<_>, _> =
                    clocks.map(|gpu| PassCosts::measure(gpu, of, 3)).collect();
                costs.push((size, all?));
            }
            let of_size = costs.iter().find(|(s, _)| *s == size);
            let of_size = of_size.map_or(&[][..], |c| &c.1);
            let rows = run.results.into_iter().map(|r| sequence_row(r, of_size));
            self.report.sequences.extend(rows);
            shown.extend(run.pictures.into_iter().map(|p| show_sequence(p, size)));
        }
        Ok(shown)
    }

    fn measure_surfels(&mut self) -> Result<Vec<Shown>, ReportError> {
        use crate::surfels::{Room, SurfelReportSettings, measure};
        let mut shown = Vec::new();
        if self.options.gpu_only || !self.only.takes(SURFELS) {
            return Ok(shown);
        }
        let full = self.options.full;
        let settings = if full {
            SurfelReportSettings::full()
        } else {
            SurfelReportSettings::quick()
        };
        self.progress.part("surfels", 1);
        let progress = self.progress;
        let mut all = vec![measure(Room::cornell, &settings, |what| {
            progress.step(&format!("Cornell: {what}"));
        })?];
        // The quick report has no time for its references.
        if full {
            let kitchen = Scene::kitchen()?;
            all.push(measure(
                || Room::kitchen(&kitchen),
                &settings,
                |what| progress.step(&format!("kitchen: {what}")),
            )?);
        }
        for results in all {
            self.report
                .surfels
                .extend(results.errors.into_iter().map(surfel_row));
            for picture in results.pictures {
                shown.push(show_surfels(picture)?);
            }
        }
        Ok(shown)
    }

    fn measure_bvh(&mut self) -> Result<(), ReportError> {
        let with_families = self.only.takes("bvh/families");
        let families = if with_families {
            families::all(self.bvh_settings.family_rays)
        } else {
            Vec::new()
        };
        let cpu = !self.options.gpu_only;
        let with_growth = cpu && self.only.takes(GROWTH);
        if self.meshes.is_empty() && families.is_empty() && !with_growth {
            return Ok(());
        }
        let traversals: Result<Vec<_>, _> = self
            .gpus
            .iter()
            .map(|g| Traversal::new(g, Stack::Function, WORKGROUP))
            .collect();
        let engines = bvh::Engines {
            cpu,
            embree: self.report.embree.found,
            tinybvh: self.tinybvh.take(),
            failures: Rc::default(),
            gpu: traversals?,
        };
        let rates = |mesh: &Scene| self.only.takes(&format!("bvh/{}", mesh.name));
        let builds = |mesh: &Scene| cpu && self.only.takes(&format!("bvh/builds/{}", mesh.name));
        let stacks = |mesh: &Scene| {
            STACKS.contains(&mesh.name.as_str())
                && self.only.takes(&format!("bvh/stacks/{}", mesh.name))
        };
        let parts = self.meshes.iter().map(|m| {
            usize::from(rates(m))
                + usize::from(builds(m))
                + self.gpus.len() * usize::from(stacks(m))
        });
        let sizes = bvh::sizes(&self.bvh_settings).filter(|_| with_growth);
        self.progress.part(
            "bvh",
            parts.sum::<usize>() + families.len() + sizes.clone().count(),
        );
        for mesh in self.meshes.iter().filter(|m| rates(m)) {
            self.progress.step(&format!("rays in {}", mesh.name));
            let rows = bvh::measure(mesh, &self.bvh_settings, &engines)?;
            self.report.bvh.extend(rows);
        }
        for mesh in self.meshes.iter().filter(|m| builds(m)) {
            self.progress.step(&format!("ways to build {}", mesh.name));
            let rows = bvh::measure_builds(mesh, &self.bvh_settings, &engines)?;
            self.report.builds.extend(rows);
        }
        for mesh in self.meshes.iter().filter(|m| stacks(m)) {
            for gpu in &self.gpus {
                self.progress
                    .step(&format!("stacks of rays in {}", mesh.name));
                let rows = bvh::measure_stacks(mesh, &self.bvh_settings, gpu)?;
                self.report.stacks.extend(rows);
            }
        }
        for triangles in sizes {
            self.progress
                .step(&format!("rays in {triangles} triangles"));
            let rows = bvh::measure_growth(triangles, &self.bvh_settings, &engines)?;
            self.report.growth.extend(rows);
        }
        for family in &families {
            self.progress.step(&format!("hard rays: {}", family.name));
            let rows = bvh::measure_family(family, &engines)?;
            self.report.families.extend(rows);
        }
        for failure in engines.failures.take() {
            self.progress.warn(&failure);
            self.report.warnings.push(failure);
        }
        Ok(())
    }

    fn measure_stages(&mut self) -> Result<Vec<Shown>, ReportError> {
        let compiled: Result<Vec<_>, _> = self.gpus.iter().map(|g| GpuStages::new(g)).collect();
        let compiled = if self.scenes.is_empty() {
            Vec::new()
        } else {
            compiled?
        };
        let mut backends = Vec::new();
        if !self.options.gpu_only {
            backends.push(Backend::Cpu);
        }
        backends.extend(compiled.iter().map(Backend::Gpu));
        let mut shown = Vec::new();
        let scenes = std::mem::take(&mut self.scenes);
        self.progress.part("stages", scenes.len());
        let shown_progress = self.progress;
        let progress = |what: &str| shown_progress.step(what);
        for scene in scenes {
            let name = scene.name.clone();
            let scene = StageScene::new(scene)?;
            let wanted = |stage: stages::Stage| self.only.takes(&stage_entry(&name, stage.name()));
            if stages::Stage::ALL.into_iter().any(wanted) {
                let run = stages::run_stages(&scene, &self.stage_settings, &backends, &progress)?;
                let rows = run.results.into_iter().filter(|r| wanted(r.stage));
                self.report.stages.extend(rows.map(stage_row));
                for picture in run.pictures {
                    if picture.stage.is_none_or(wanted) {
                        shown.push(show(picture)?);
                    }
                }
            }
            if self.only.takes(&stage_entry(&name, REFLECTIONS)) {
                shown.extend(self.measure_reflections(&scene, &progress)?);
            }
            // The quick report has the toy room's, or those that were asked for.
            let asked = self.options.scene.is_some() || self.options.only.is_some();
            let is_wanted = self.options.full || asked || name == "toy";
            if is_wanted && !self.options.gpu_only {
                shown.extend(self.measure_sequences(&scene, &progress)?);
            }
            // Only the first scene: the sampler's slope is what counts, and it
            // takes half of the time.
            let first = self.report.convergence.is_empty();
            if first && self.only.takes(&stage_entry(&name, "convergence")) {
                let data = stages::convergence(&scene, &self.stage_settings, &backends, &progress)?;
                add_convergence(&mut self.report, &name, data);
            }
        }
        Ok(shown)
    }
}

fn embree() -> EmbreeInfo {
    let corners = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    match EmbreeScene::new(&corners, &[[0, 1, 2]], EmbreeOptions::default()) {
        Ok(scene) => EmbreeInfo {
            found: true,
            version: Some(scene.version()),
            mend: None,
        },
        Err(error) => EmbreeInfo {
            found: false,
            version: None,
            mend: Some(match error {
                // Without the list of places, which is long.
                EmbreeError::Load(embree4_sys::LoadError::NotFound(_)) => format!(
                    "Run `cargo xtask setup`, or set {} to the library's path.",
                    embree4_sys::LIBRARY_VARIABLE
                ),
                other => format!("{other}."),
            }),
        },
    }
}

fn stage_row(r: stages::StageResult) -> StageRow {
    StageRow {
        name: r.stage.name().into(),
        scene: r.scene,
        variant: r.variant,
        backend: r.backend,
        samples: r.samples,
        ms: r.ms,
        rays: r.rays,
        rmse: r.rmse,
        parity_rmse: r.parity_rmse,
        differing: r.differing,
        pixels: r.pixels,
    }
}

fn show(picture: stages::Picture) -> Result<Shown, ReportError> {
    Ok(Shown {
        png: picture.image.to_png()?,
        row: PictureRow {
            file: format!("pictures/{}.png", picture.id),
            scene: picture.scene,
            stage: picture.stage.map(|s| s.name().into()),
            variant: picture.variant,
            backend: picture.backend,
            difference: picture.is_difference,
            caption: picture.caption,
        },
    })
}

fn reflection_row(r: reflections::ReflectionResult) -> ReflectionRow {
    ReflectionRow {
        scene: r.scene,
        view: r.view,
        backend: r.backend,
        neighbours: r.neighbours,
        bilateral: r.bilateral,
        trace_ms: r.trace_ms,
        filter_ms: r.filter_ms,
        rmse: r.rmse,
        bias: r.bias,
        rays_by_variance: r.rays_by_variance,
        rays_by_error: r.rays_by_error,
        parity_rmse: r.parity_rmse,
        differing: r.differing,
        pixels: r.pixels,
    }
}

fn ball_row(b: reflections::BallResult) -> BallRow {
    BallRow {
        scene: b.scene,
        view: b.view,
        roughness: b.roughness,
        coated: b.coated,
        neighbours: b.neighbours,
        bilateral: b.bilateral,
        rays_by_variance: b.rays_by_variance,
        rays_by_error: b.rays_by_error,
    }
}

fn show_reflection(
    view: &str,
    picture: reflections::ReflectionPicture,
) -> Result<Shown, ReportError> {
    let difference = if picture.is_difference {
        "difference"
    } else {
        ""
    };
    let id = stages::slug(&[
        &picture.scene,
        REFLECTIONS,
        view,
        &picture.variant,
        &picture.backend,
        difference,
    ]);
    Ok(Shown {
        png: picture.image.to_png()?,
        row: PictureRow {
            file: format!("pictures/{id}.png"),
            scene: picture.scene,
            stage: Some(format!("{REFLECTIONS}_{view}")),
            variant: picture.variant,
            backend: picture.backend,
            difference: picture.is_difference,
            caption: picture.caption,
        },
    })
}

fn sequence_row(r: sequence::SequenceResult, costs: &[PassCosts]) -> SequenceRow {
    let (recipe, color) = r.recipe;
    let on = |c: &PassCosts| (c.backend().to_owned(), c.of(&recipe, color));
    SequenceRow {
        gpu_ms: costs.iter().map(on).collect(),
        scene: r.scene,
        signal: r.signal,
        event: r.event,
        size: r.size,
        variant: r.variant,
        piece: r.piece,
        ms: r.ms,
        rmse: r.rmse,
        reference_rmse: r.reference_rmse,
        flip: r.flip,
        relative_mse: r.relative_mse,
        psnr: r.psnr,
        ssim: schema::finite(r.ssim),
        flicker: r.flicker,
        half_life: r.half_life,
        by_frame: r.by_frame,
    }
}

fn show_sequence(picture: sequence::SequencePicture, [width, height]: [u32; 2]) -> Shown {
    let [signal, event, what] = &picture.name;
    let size = format!("{width}x{height}");
    let id = stages::slug(&[&picture.scene, SEQUENCES, signal, event, &size, what]);
    Shown {
        png: picture.png,
        row: PictureRow {
            file: format!("pictures/{id}.png"),
            scene: picture.scene,
            stage: Some(format!("{SEQUENCES}_{signal}, {event}, {size}")),
            variant: what.clone(),
            backend: "cpu".into(),
            difference: false,
            caption: picture.caption,
        },
    }
}

fn surfel_row(e: crate::surfels::SurfelError) -> SurfelRow {
    SurfelRow {
        scene: e.scene,
        event: e.event.into(),
        slots: e.budget,
        frame: e.frame,
        alive: e.alive,
        rmse: e.rmse,
        direct_rmse: e.direct_rmse,
        flip: e.flip,
        bare: e.bare,
        mean: e.mean,
        ms: e.ms,
    }
}

fn show_surfels(picture: crate::surfels::SurfelPicture) -> Result<Shown, ReportError> {
    let id = stages::slug(&[&picture.scene, SURFELS, &picture.name]);
    Ok(Shown {
        png: picture.png()?,
        row: PictureRow {
            file: format!("pictures/{id}.png"),
            scene: picture.scene,
            stage: Some(SURFELS.into()),
            variant: picture.name,
            backend: "cpu".into(),
            difference: false,
            caption: picture.caption,
        },
    })
}

fn add_convergence(report: &mut Report, scene: &str, data: stages::Convergence) {
    report
        .convergence
        .extend(data.points.into_iter().map(|p| ConvergenceRow {
            scene: scene.into(),
            stage: p.stage.name().into(),
            sampler: p.sampler.name().into(),
            backend: p.backend,
            samples: p.samples,
            rmse: p.rmse,
            ms: p.ms,
            rays: p.rays,
        }));
    report
        .slopes
        .extend(data.slopes.into_iter().map(|s| SlopeRow {
            scene: scene.into(),
            stage: s.stage.name().into(),
            sampler: s.sampler.name().into(),
            backend: s.backend,
            slope: s.slope,
            at_one: s.at_one,
        }));
    report
        .references
        .extend(data.references.into_iter().map(|r| ReferenceRow {
            scene: scene.into(),
            stage: r.stage.name().into(),
            samples: r.samples,
            rmse: r.rmse,
            pixels: r.pixels,
        }));
}

pub use terminal::summary;
