//! The rendered stages of the report, each on the CPU and on every adapter.
//!
//! Primary visibility, hard shadows, soft shadows and ambient occlusion of one
//! scene, by one program in two languages (`program.rs` and `program.wgsl`):
//! the same random integers, the same operations in the same order. The sums
//! over samples are divided on the CPU for both, so what differs between a CPU
//! picture and a GPU picture is float contraction at edges and nothing else.
//!
//! - [`StageScene::new`] builds the tree and the normals of a scene.
//! - [`GpuStages::new`] compiles the program for an adapter.
//! - [`run_stages`] renders every stage on every backend at one sample a pixel
//!   and as reference, compares them and gives timings and [`Picture`]s.
//! - [`convergence`] measures error against samples and time for white noise,
//!   rotated Halton points and a regular grid, and fits slopes.
//! - [`render`] runs a single job, for microbenchmarks.
//!
//! Source of the stages: *Ray Tracing Gems*, chapter 25, sections 25.2.1
//! (shadows) and 25.2.3 (ambient occlusion).

mod convergence;
mod cpu;
pub(crate) mod gpu;
mod image;
mod pictures;
pub(crate) mod program;
#[cfg(test)]
mod tests;

use std::time::Instant;

use glam::{DVec3, Vec2, Vec3};
use raytwin::ray::bvh_build::{BuildQuality, Bvh, BvhError};
use raytwin_cpu::pass::bvh8::Bvh8;
use raytwin_cpu::random::halton::HALTON_PERIOD;
use raytwin_cpu::ray::camera::Camera;
use raytwin_cpu::sample::cone::cone_one_minus_cos;
use raytwin_tests::scene::{self, Scene};

pub use convergence::{Convergence, ConvergencePoint, Reference, Slope, convergence};
pub use gpu::GpuStages;
pub use image::Image;
pub(crate) use image::srgb8;
pub(crate) use pictures::slug;
pub use pictures::{Picture, StageResult, StageRun, run_stages};

use cpu::CpuRenderer;
use gpu::GpuRenderer;
use program::{FRAME_LOOP, Parameters, Surface, stage_traces};

/// Most pixels in a picture: 2^26.
pub const PIXELS_MAX: u64 = 1 << 26;

/// Most pixels in a row or column: what one dispatch can span.
pub const SIDE_MAX: u32 = 1 << 16;

/// Most samples of a pixel in one run: so many that the Halton index does not
/// repeat within the frames that are used.
pub const SAMPLES_MAX: u32 = HALTON_PERIOD / FRAME_LOOP;

/// Why a stage does not run.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StageError {
    /// A picture without pixels, or with too many.
    #[error(
        "a picture of {width} x {height} pixels cannot be rendered: \
         choose a width and a height from 1 to {SIDE_MAX}, and at most {PIXELS_MAX} pixels in all"
    )]
    Size {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Too few or too many samples a pixel.
    #[error("{samples} samples a pixel: choose from 1 to {SAMPLES_MAX}")]
    Samples {
        /// What was asked for.
        samples: u32,
    },
    /// The camera looks nowhere, or with an impossible field of view.
    #[error(
        "the camera at {eye:?} looks at {target:?} with up {up:?} and a field of view of \
         {fov_degrees} degrees: all must be finite, the view not along up, the field between 0 and 180"
    )]
    Camera {
        /// Where it stands.
        eye: [f32; 3],
        /// What it looks at.
        target: [f32; 3],
        /// Which way is up.
        up: [f32; 3],
        /// Vertical field of view.
        fov_degrees: f32,
    },
    /// The mesh has no tree.
    #[error(transparent)]
    Bvh(#[from] BvhError),
    /// The tree has no form for vector instructions.
    #[error(transparent)]
    Wide(#[from] raytwin_cpu::pass::bvh8::Bvh8Fault),
    /// A module of the GPU program is not registered.
    #[error(transparent)]
    Link(#[from] raytwin_wgsl::LinkError),
    /// The adapter does not take the program.
    #[error("{adapter} does not take the stages' program: {message}")]
    Shader {
        /// Which adapter.
        adapter: String,
        /// What it said.
        message: String,
    },
    /// A buffer does not fit the adapter.
    #[error(
        "{what} take {bytes} bytes, and {adapter} binds at most {limit}: \
         use a smaller mesh or picture, or run with --cpu"
    )]
    TooLargeForAdapter {
        /// Which adapter.
        adapter: String,
        /// What does not fit.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The adapter's limit.
        limit: u64,
    },
    /// A picture was not encoded.
    #[error("a picture could not be encoded as PNG: {0}")]
    Png(String),
}

/// One stage of the pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Primary visibility: a camera ray through the middle of each pixel.
    Primary,
    /// One shadow ray towards the middle of the light.
    HardShadow,
    /// Shadow rays over the light's cone.
    SoftShadow,
    /// Cosine-weighted rays up to a maximum distance: the fraction of misses.
    AmbientOcclusion,
    /// The same, but a hit counts `(distance / maximum)^power`.
    AmbientOcclusionPower,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 5] = [
        Self::Primary,
        Self::HardShadow,
        Self::SoftShadow,
        Self::AmbientOcclusion,
        Self::AmbientOcclusionPower,
    ];

    /// Name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::HardShadow => "hard_shadow",
            Self::SoftShadow => "soft_shadow",
            Self::AmbientOcclusion => "ambient_occlusion",
            Self::AmbientOcclusionPower => "ambient_occlusion_power",
        }
    }

    /// Name in headings.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Primary => "Primary visibility",
            Self::HardShadow => "Hard shadows",
            Self::SoftShadow => "Soft shadows",
            Self::AmbientOcclusion => "Ambient occlusion",
            Self::AmbientOcclusionPower => "Ambient occlusion, weighted by distance",
        }
    }

    /// Whether it draws random numbers.
    #[must_use]
    pub fn is_sampled(self) -> bool {
        !matches!(self, Self::Primary | Self::HardShadow)
    }

    fn channels(self) -> usize {
        if self == Self::Primary { 3 } else { 1 }
    }
}

/// Where the random numbers come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Sampler {
    /// Independent numbers by PCG.
    White = 0,
    /// Halton points, each pixel's rotated by its own shift.
    Halton = 1,
    /// The same square grid in every pixel.
    Grid = 2,
}

impl Sampler {
    /// Every sampler.
    pub const ALL: [Self; 3] = [Self::White, Self::Halton, Self::Grid];

    /// Name in files, tables and legends.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "white noise (PCG)",
            Self::Halton => "Halton + rotation",
            Self::Grid => "regular grid",
        }
    }
}

/// What runs a stage.
#[derive(Clone, Copy)]
pub enum Backend<'a> {
    /// `raytwin-cpu` on all threads of rayon's pool.
    Cpu,
    /// `raytwin-wgsl` on an adapter.
    Gpu(&'a GpuStages<'a>),
}

impl Backend<'_> {
    /// `cpu`, or the adapter's name and driver.
    #[must_use]
    pub fn label(&self) -> String {
        match self {
            Self::Cpu => "cpu".into(),
            Self::Gpu(stages) => stages.gpu().label(),
        }
    }

    /// Whether the processor does the work: there the GPU program takes fewer
    /// samples where [`StageSettings`] says so.
    #[must_use]
    pub fn is_software_gpu(&self) -> bool {
        matches!(self, Self::Gpu(stages) if stages.gpu().is_software())
    }
}

/// Sizes and sample counts of one report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageSettings {
    /// Pixels in a row of the pictures.
    pub width: u32,
    /// Rows of the pictures.
    pub height: u32,
    /// Samples of a pixel in the reference pictures.
    pub reference_samples: u32,
    /// The same on a software adapter; its difference picture is to a CPU
    /// picture of as many.
    pub reference_samples_software: u32,
    /// Exponent of the weighted ambient occlusion.
    pub ao_power: f32,
    /// How often a short job is timed; the median counts.
    pub repeats: usize,
    /// Pixels in a row of the view on which error is measured.
    pub convergence_width: u32,
    /// Its rows.
    pub convergence_height: u32,
    /// Largest number of samples at which error is measured, a power of 4.
    pub convergence_samples: u32,
    /// Samples of each of the two halves of the reference for it.
    pub convergence_reference: u32,
    /// Largest number of samples at which error is measured on a software
    /// adapter.
    pub convergence_samples_software: u32,
}

impl StageSettings {
    /// For the quick report.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            width: 320,
            height: 180,
            reference_samples: 128,
            reference_samples_software: 32,
            ao_power: 2.0,
            repeats: 3,
            convergence_width: 96,
            convergence_height: 54,
            convergence_samples: 256,
            convergence_reference: 1024,
            convergence_samples_software: 64,
        }
    }

    /// For the long run.
    #[must_use]
    pub fn full() -> Self {
        Self {
            width: 640,
            height: 360,
            reference_samples: 1024,
            reference_samples_software: 256,
            repeats: 5,
            convergence_width: 160,
            convergence_height: 90,
            convergence_samples: 1024,
            convergence_reference: 4096,
            convergence_samples_software: 256,
            ..Self::quick()
        }
    }

    fn check(&self) -> Result<(), StageError> {
        for (width, height) in [
            (self.width, self.height),
            (self.convergence_width, self.convergence_height),
        ] {
            check_size(width, height)?;
        }
        for samples in [
            self.reference_samples,
            self.reference_samples_software,
            self.convergence_samples,
            self.convergence_reference,
            self.convergence_samples_software,
        ] {
            check_samples(samples)?;
        }
        Ok(())
    }
}

pub(crate) fn check_size(width: u32, height: u32) -> Result<(), StageError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > PIXELS_MAX || width.max(height) > SIDE_MAX {
        return Err(StageError::Size { width, height });
    }
    Ok(())
}

fn check_samples(samples: u32) -> Result<(), StageError> {
    if samples == 0 || samples > SAMPLES_MAX {
        return Err(StageError::Samples { samples });
    }
    Ok(())
}

/// A scene with its tree, ready to render.
pub struct StageScene {
    /// Mesh, camera, light, and reach of ambient occlusion.
    pub scene: Scene,
    /// The tree over the mesh.
    pub bvh: Bvh,
    /// The same tree with eight children a node, for what traces many rays.
    pub wide: Bvh8,
    /// Unit geometric normal of each triangle; +y where it has no area.
    pub normals: Vec<Vec3>,
    /// How long the tree took.
    pub build_ms: f64,
    /// Least offset of secondary rays: a thousandth of an eighth of the
    /// diagonal, 1 mm in a room of 8 m.
    pub offset: f32,
}

impl StageScene {
    /// Builds the tree and the normals.
    ///
    /// # Errors
    /// If the mesh has no tree, or the camera looks nowhere.
    pub fn new(scene: Scene) -> Result<Self, StageError> {
        camera(&scene.camera, 1, 1)?;
        let start = Instant::now();
        let bvh = Bvh::build(
            &scene.mesh.positions,
            &scene.mesh.indices,
            BuildQuality::default(),
        )?;
        let build_ms = cpu::milliseconds(start);
        let normals = (0..scene.mesh.indices.len())
            .map(|i| scene.mesh.geometric_normal(i).unwrap_or(Vec3::Y))
            .collect();
        let diagonal = scene.mesh.bounds().map_or(1.0, |b| b.diagonal());
        Ok(Self {
            offset: 1e-3 * (diagonal / 8.0),
            scene,
            wide: bvh.wide()?,
            bvh,
            normals,
            build_ms,
        })
    }
}

/// A scene's camera for a picture of this size.
pub(crate) fn camera(c: &scene::Camera, width: u32, height: u32) -> Result<Camera, StageError> {
    let forward = (c.target.as_dvec3() - c.eye.as_dvec3()).normalize_or_zero();
    let right = forward.cross(c.up.as_dvec3()).normalize_or_zero();
    let half = (0.5 * f64::from(c.fov_degrees)).to_radians().tan();
    let sound = c.eye.is_finite()
        && c.target.is_finite()
        && forward != DVec3::ZERO
        && right != DVec3::ZERO
        && c.fov_degrees > 0.0
        && c.fov_degrees < 180.0;
    if !sound {
        return Err(StageError::Camera {
            eye: c.eye.to_array(),
            target: c.target.to_array(),
            up: c.up.to_array(),
            fov_degrees: c.fov_degrees,
        });
    }
    let aspect = f64::from(width) / f64::from(height);
    Ok(Camera {
        origin: c.eye,
        right: (right * (half * aspect)).as_vec3(),
        up: (right.cross(forward) * half).as_vec3(),
        forward: forward.as_vec3(),
        inverse_resolution: Vec2::new(1.0 / width as f32, 1.0 / height as f32),
    })
}

/// One picture to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Job {
    /// Which stage.
    pub stage: Stage,
    /// With which random numbers.
    pub sampler: Sampler,
    /// Samples of a pixel; for [`Sampler::Grid`] a square number. Primary
    /// visibility and hard shadows take 1.
    pub samples: u32,
    /// Frames differ in their random numbers.
    pub frame: u32,
}

impl Job {
    /// One sample a pixel, as a frame of the chapter's renderer takes it.
    #[must_use]
    pub fn frame(stage: Stage) -> Self {
        Self::samples(stage, 1)
    }

    /// Several Halton samples a pixel.
    #[must_use]
    pub fn samples(stage: Stage, samples: u32) -> Self {
        Self {
            stage,
            sampler: Sampler::Halton,
            samples,
            frame: 0,
        }
    }
}

/// What a job gave.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// Colours in the primary stage, else visibility in `[0, 1]`.
    pub image: Image,
    /// Time in milliseconds: tracing and shading, without transfers.
    pub ms: f64,
    /// Rays that were traced.
    pub rays: u64,
}

/// A scene on one backend at one size. Making one renders the primary stage,
/// whose surfaces the other stages start from.
pub struct Renderer<'a> {
    label: String,
    parameters: Parameters,
    surfaces: Vec<Surface>,
    engine: Engine<'a>,
}

enum Engine<'a> {
    Cpu(CpuRenderer<'a>),
    Gpu(Box<GpuRenderer<'a>>),
}

impl<'a> Renderer<'a> {
    /// Makes buffers and pipelines and finds what each pixel sees.
    ///
    /// # Errors
    /// If the size is zero, or the adapter does not take the scene.
    pub fn new(
        scene: &'a StageScene,
        backend: Backend<'a>,
        width: u32,
        height: u32,
        ao_power: f32,
    ) -> Result<Self, StageError> {
        check_size(width, height)?;
        let light = &scene.scene.light;
        let parameters = Parameters {
            camera: camera(&scene.scene.camera, width, height)?,
            light_direction: light.direction,
            light_one_minus_cos: cone_one_minus_cos(light.angular_radius),
            offset: scene.offset,
            ao_distance: scene.scene.ao_distance,
            ao_power,
            width,
            height,
            sampler: Sampler::Halton,
            samples: 1,
            grid_side: 1,
            frame: 0,
            first_row: 0,
            first_sample: 0,
            sample_count: 1,
        };
        let mut out = Self {
            label: backend.label(),
            parameters,
            surfaces: Vec::new(),
            engine: match backend {
                Backend::Cpu => Engine::Cpu(CpuRenderer::new(scene)),
                Backend::Gpu(stages) => {
                    Engine::Gpu(Box::new(GpuRenderer::new(stages, scene, width, height)?))
                }
            },
        };
        out.render(&Job::frame(Stage::Primary))?;
        out.surfaces = match &out.engine {
            Engine::Cpu(cpu) => cpu.surfaces().to_vec(),
            Engine::Gpu(gpu) => gpu.surfaces(width as usize * height as usize),
        };
        Ok(out)
    }

    /// `cpu`, or the adapter's name and driver.
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// Which pixels trace rays in a stage; the others are constant.
    #[must_use]
    pub fn traced(&self, stage: Stage) -> Vec<bool> {
        self.surfaces
            .iter()
            .map(|s| stage_traces(stage, &self.parameters, s))
            .collect()
    }

    /// Renders one picture.
    ///
    /// # Errors
    /// If the number of samples is 0, above [`SAMPLES_MAX`], or not a square
    /// where it must be.
    pub fn render(&mut self, job: &Job) -> Result<Rendered, StageError> {
        let samples = if job.stage.is_sampled() {
            job.samples
        } else {
            1
        };
        check_samples(samples)?;
        let grid_side = samples.isqrt();
        if job.sampler == Sampler::Grid && grid_side * grid_side != samples {
            return Err(StageError::Samples { samples });
        }
        let parameters = Parameters {
            sampler: job.sampler,
            samples,
            grid_side,
            frame: job.frame,
            sample_count: samples,
            ..self.parameters
        };
        let (mut data, ms) = match &mut self.engine {
            Engine::Cpu(cpu) => cpu.run(job.stage, &parameters),
            Engine::Gpu(gpu) => gpu.run(job.stage, &parameters),
        };
        for value in &mut data {
            *value /= samples as f32;
        }
        let pixels = if job.stage == Stage::Primary {
            data.len() / 3
        } else {
            self.traced(job.stage).iter().filter(|t| **t).count()
        };
        Ok(Rendered {
            image: Image {
                width: parameters.width,
                height: parameters.height,
                channels: job.stage.channels(),
                data,
            },
            ms,
            rays: pixels as u64 * u64::from(samples),
        })
    }

    /// Renders one picture several times: the picture and the median time.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn render_timed(&mut self, job: &Job, repeats: usize) -> Result<Rendered, StageError> {
        let mut out = self.render(job)?;
        let mut times = vec![out.ms];
        for _ in 1..repeats {
            times.push(self.render(job)?.ms);
        }
        times.sort_by(f64::total_cmp);
        out.ms = times[times.len() / 2];
        Ok(out)
    }
}

/// Renders a single picture of a scene.
///
/// # Errors
/// As [`Renderer::new`] and [`Renderer::render`].
pub fn render(
    scene: &StageScene,
    backend: Backend<'_>,
    width: u32,
    height: u32,
    job: &Job,
) -> Result<Rendered, StageError> {
    Renderer::new(
        scene,
        backend,
        width,
        height,
        StageSettings::quick().ao_power,
    )?
    .render(job)
}
