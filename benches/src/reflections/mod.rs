//! Reflections at a quarter of a ray a pixel: balls of six roughnesses, bare
//! and under a clear coat, on the floor of a room.
//!
//! Each half-resolution pixel traces one ray through `brdf/layered`; each
//! full-resolution pixel gathers its neighbours' hits by
//! `filter/spatial_reconstruct`, and `filter/bilateral_variance` smooths what
//! is left, both with their callbacks over the surfaces of the picture. The
//! mean radiance times the material's albedo is the reflected light. One
//! program in two languages, `program.rs` and `program.wgsl`.
//!
//! - [`ReflectionScene::new`] puts the balls into a scene that has a place.
//! - [`ReflectionGpu::new`] compiles the program for an adapter.
//! - [`measure`] renders a view on every backend, with 1, 4, 8 and 16
//!   neighbours, and measures time, error, and how many rays a pixel would
//!   have as little variance, or error.
//!
//! Source: *Ray Tracing Gems*, chapter 25, section 25.2.2.

mod cpu;
mod gpu;
mod measure;
pub(crate) mod program;
#[cfg(test)]
mod tests;

use glam::{Vec2, Vec3, vec3};
use raytwin_cpu::brdf::fresnel::fresnel_f0;
use raytwin_cpu::brdf::layered::{LayeredLayer, LayeredStack, layered_sample};
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_tests::scene;

use crate::stages::{StageError, StageScene};

pub use gpu::ReflectionGpu;
pub use measure::{BallResult, ReflectionPicture, ReflectionResult, ReflectionRun, measure};

use program::{ALBEDOS, Ball, Parameters};

/// Perceptual roughness of the balls, from left to right.
pub const ROUGHNESS: [f32; 6] = [0.1, 0.25, 0.4, 0.55, 0.7, 0.85];

/// Numbers of neighbours that are compared.
pub const NEIGHBOURS: [u32; 4] = [1, 4, 8, 16];

/// Largest kernel of the bilateral filter: pixels, and taps.
const BILATERAL: (f32, u32) = (6.0, 16);

/// Perceptual roughness of a polished floor.
const FLOOR_ROUGHNESS: f32 = 0.15;

/// GGX roughness of the clear coat.
const COAT: f32 = 0.02;

/// What runs the program.
#[derive(Clone, Copy)]
pub enum Backend<'a> {
    /// `raytwin-cpu` on all threads of rayon's pool.
    Cpu,
    /// `raytwin-wgsl` on an adapter.
    Gpu(&'a ReflectionGpu<'a>),
}

/// Sizes and sample counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReflectionSettings {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples of a pixel in the reference.
    pub reference_samples: u32,
    /// Frames over which variance is measured.
    pub frames: u32,
    /// How often a pass is timed; the median counts.
    pub repeats: usize,
}

impl ReflectionSettings {
    /// For the quick report.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            width: 320,
            height: 180,
            reference_samples: 256,
            frames: 12,
            repeats: 3,
        }
    }

    /// For the long run.
    #[must_use]
    pub fn full() -> Self {
        Self {
            width: 640,
            height: 360,
            reference_samples: 1024,
            frames: 32,
            repeats: 5,
        }
    }
}

/// Where the balls stand, and from where they are seen.
struct Place {
    /// The first ball of the front row touches the floor here.
    origin: Vec3,
    /// From ball to ball, and from the front row to the one behind.
    right: Vec3,
    back: Vec3,
    radius: f32,
    views: [(&'static str, scene::Camera); 2],
}

fn place(name: &str) -> Option<Place> {
    let camera = |eye, target, fov_degrees| scene::Camera {
        eye,
        target,
        up: Vec3::Y,
        fov_degrees,
    };
    match name {
        "toy" => Some(Place {
            origin: vec3(1.4, 0.0, 4.35),
            right: vec3(0.66, 0.0, 0.0),
            back: vec3(0.18, 0.0, -0.75),
            radius: 0.27,
            views: [
                (
                    "above",
                    camera(vec3(3.05, 1.45, 7.2), vec3(3.05, 0.40, 3.9), 43.0),
                ),
                (
                    "grazing",
                    camera(vec3(3.0, 0.34, 6.9), vec3(3.05, 0.92, 3.9), 50.0),
                ),
            ],
        }),
        "kitchen" => Some(Place {
            origin: vec3(-0.62, 0.002, 0.3),
            right: vec3(0.3, 0.0, 0.0),
            back: vec3(0.08, 0.0, -0.32),
            radius: 0.12,
            views: [
                (
                    "above",
                    camera(vec3(0.13, 0.62, 1.4), vec3(0.13, 0.1, 0.2), 46.0),
                ),
                (
                    "grazing",
                    camera(vec3(0.1, 0.15, 1.35), vec3(0.13, 0.19, 0.2), 52.0),
                ),
            ],
        }),
        _ => None,
    }
}

/// Balls in a room.
pub struct ReflectionScene<'a> {
    pub(crate) scene: &'a StageScene,
    pub(crate) balls: Vec<Ball>,
    ground: f32,
    checker: f32,
    /// Middle of the balls' feet.
    middle: Vec3,
    /// From the row in front to the one behind.
    pub(crate) back: Vec3,
    pub(crate) views: [(&'static str, scene::Camera); 2],
}

impl<'a> ReflectionScene<'a> {
    /// Puts the balls into the toy room or the kitchen; `None` for a scene
    /// without a place for them.
    #[must_use]
    pub fn new(scene: &'a StageScene) -> Option<Self> {
        let place = place(&scene.scene.name)?;
        let mut balls = Vec::new();
        for coated in [false, true] {
            for (k, roughness) in (0u8..).zip(ROUGHNESS) {
                let foot = place.origin
                    + place.right * f32::from(k)
                    + if coated { Vec3::ZERO } else { place.back };
                balls.push(ball(
                    foot + Vec3::Y * place.radius,
                    place.radius,
                    roughness,
                    coated,
                ));
            }
        }
        Some(Self {
            scene,
            balls,
            ground: place.origin.y + 0.05 * place.radius,
            checker: 0.7 / place.radius,
            middle: place.origin + 2.5 * place.right + 0.5 * place.back,
            back: place.back,
            views: place.views,
        })
    }

    /// Any scene, without balls, seen by its own camera.
    #[must_use]
    pub fn bare(scene: &'a StageScene) -> Self {
        let camera = scene.scene.camera;
        Self {
            scene,
            balls: Vec::new(),
            ground: f32::MIN,
            checker: 1.0,
            middle: Vec3::ZERO,
            back: Vec3::ZERO,
            views: [("scene", camera), ("scene", camera)],
        }
    }

    /// Whether there are balls to look at.
    #[must_use]
    pub fn has_balls(&self) -> bool {
        !self.balls.is_empty()
    }

    /// Names of the views.
    #[must_use]
    pub fn views(&self) -> [&'static str; 2] {
        self.views.map(|v| v.0)
    }

    /// A polished floor for the balls to stand on: the top of a ball so large
    /// that it rises by 4 mm in a room of 8 m, and sinks into the floor as far
    /// away as the room is wide.
    pub(crate) fn polished(&self) -> Ball {
        let rise = 4.0 * self.scene.offset;
        let radius = 5e5 * rise;
        let mut out = ball(
            self.middle + Vec3::Y * (rise - radius),
            radius,
            FLOOR_ROUGHNESS,
            false,
        );
        out.tint = Vec3::splat(0.6);
        out
    }

    fn parameters(&self, view: usize, width: u32, height: u32) -> Result<Parameters, StageError> {
        self.seen_by(&self.views[view].1, width, height)
    }

    pub(crate) fn seen_by(
        &self,
        camera: &scene::Camera,
        width: u32,
        height: u32,
    ) -> Result<Parameters, StageError> {
        Ok(Parameters {
            camera: crate::stages::camera(camera, width, height)?,
            light_direction: self.scene.scene.light.direction,
            offset: self.scene.offset,
            floor: self.ground,
            checker: self.checker,
            width,
            height,
            balls: self.balls.len() as u32,
            frame: 0,
            first_row: 0,
            first_sample: 0,
            sample_count: 1,
            neighbours: 1,
            max_taps: 0,
            max_radius: BILATERAL.0,
        })
    }
}

/// Copper, bare or under a faintly tinted coat of lacquer.
fn ball(center: Vec3, radius: f32, roughness: f32, coated: bool) -> Ball {
    let copper = LayeredLayer {
        reflectance: vec3(0.955, 0.638, 0.538),
        eta: 1.0,
        depth: Vec3::ZERO,
        alpha: Vec2::splat(roughness * roughness),
    };
    let coat = LayeredLayer {
        reflectance: Vec3::splat(fresnel_f0(1.5)),
        eta: 1.5,
        depth: vec3(0.10, 0.05, 0.02),
        alpha: Vec2::splat(COAT),
    };
    let stack = LayeredStack {
        layers: if coated {
            [coat, copper]
        } else {
            [copper, copper]
        },
        diffuse: Vec3::ZERO,
    };
    let albedo = std::array::from_fn(|k| {
        let cos = k as f32 / (ALBEDOS - 1) as f32;
        if coated {
            albedo(&stack, cos)
        } else {
            let bare = LayeredStack {
                layers: [copper],
                diffuse: Vec3::ZERO,
            };
            albedo(&bare, cos)
        }
    });
    Ball {
        center,
        radius,
        stack,
        count: if coated { 2 } else { 1 },
        tint: vec3(0.75, 0.42, 0.30),
        albedo,
    }
}

/// What a stack reflects of light from everywhere toward a viewer at this
/// cosine: the mean weight of a sample, over a grid turned by a golden ratio.
fn albedo<const N: usize>(stack: &LayeredStack<N>, cos: f32) -> Vec3 {
    const SIDE: u16 = 48;
    // At the horizon itself there is no lobe to draw from.
    let z = cos.max(1e-3);
    let wo = vec3(((1.0 - z) * (1.0 + z)).sqrt(), 0.0, z);
    let mut sum = glam::DVec3::ZERO;
    for i in 0..SIDE {
        for j in 0..SIDE {
            let index = u32::from(i) * u32::from(SIDE) + u32::from(j);
            let u = vec3(
                (f32::from(i) + pcg_unit(pcg_hash(2 * index))) / f32::from(SIDE),
                (f32::from(j) + pcg_unit(pcg_hash(2 * index + 1))) / f32::from(SIDE),
                pcg_unit(index.wrapping_mul(2_654_435_769)),
            );
            sum += layered_sample(stack, wo, u.min(Vec3::splat(0.999_999_94)))
                .weight
                .as_dvec3();
        }
    }
    (sum / f64::from(SIDE).powi(2)).as_vec3()
}
