//! Noisy sequences through the filters over time: error against milliseconds.
//!
//! The toy room or the kitchen at one shadow ray, or one ambient-occlusion ray,
//! a pixel and frame, for a number of frames; in the middle of a sequence the
//! light may jump. Each frame is accumulated by `temporal/accumulate` and
//! filtered by `filter/svgf` (through `pass/svgf`), whose first pass is fed
//! back. The camera stands still, so that the frame before is the history as it
//! is.
//!
//! [`measure`] renders a sequence and gives a row for each variant: without any
//! filter, accumulated alone, and with 0 to 5 passes.

#[cfg(test)]
mod tests;

use std::time::Instant;

use glam::{UVec2, Vec3};
use image::GrayImage;
use rayon::prelude::*;
use raytwin::filter::svgf::{SvgfScalar, SvgfSettings, SvgfSurface, svgf_variance_scalar_pixel};
use raytwin::pass::svgf::SvgfPass;
use raytwin::temporal::accumulate::{
    TEMPORAL_ACCUMULATE_EMPTY, TemporalAccumulateState, temporal_accumulate_alpha,
    temporal_accumulate_mean, temporal_accumulate_step,
};
use raytwin::temporal::variance_clamp::variance_clamp_pixel;

use crate::stages::{Backend, Image, Job, Renderer, Sampler, Stage, StageError, StageScene, srgb8};

/// Frames that an average over time remembers.
const LONG: f32 = 32.0;

/// A surface's reach over its distance to the eye.
const REACH: f32 = 0.01;

/// Sizes and counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequenceSettings {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames; the light jumps in the middle.
    pub frames: u32,
    /// Samples of a pixel in the references.
    pub reference_samples: u32,
}

impl SequenceSettings {
    /// For a report within a minute and a half on two cores.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            width: 240,
            height: 135,
            frames: 24,
            reference_samples: 128,
        }
    }

    /// For the long run.
    #[must_use]
    pub fn full() -> Self {
        Self {
            width: 640,
            height: 360,
            frames: 64,
            reference_samples: 1024,
        }
    }
}

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Nothing.
    Still,
    /// The light jumps in the middle.
    Jump,
}

impl Event {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Still, Self::Jump];

    /// Name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Still => "still",
            Self::Jump => "light jumps",
        }
    }
}

/// How a frame is filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Variant {
    /// Not at all.
    None,
    /// By an average over many frames.
    Average,
    /// The same, the history clamped to mean ± deviation of 5 × 5 pixels of the
    /// frame.
    Clamped,
    /// By SVGF with this many passes; 0 is its accumulation alone.
    Svgf(u32),
    /// The same without feeding the first pass back.
    SvgfNotFedBack(u32),
}

impl Variant {
    /// All that are compared.
    pub const ALL: [Self; 12] = [
        Self::None,
        Self::Average,
        Self::Clamped,
        Self::Svgf(0),
        Self::Svgf(1),
        Self::Svgf(2),
        Self::Svgf(3),
        Self::Svgf(4),
        Self::Svgf(5),
        Self::SvgfNotFedBack(1),
        Self::SvgfNotFedBack(3),
        Self::SvgfNotFedBack(5),
    ];

    /// Name in tables and legends.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::None => "1 spp".into(),
            Self::Average => format!("average of {LONG} frames"),
            Self::Clamped => format!("average of {LONG} frames, clamped"),
            Self::Svgf(passes) => format!("SVGF, {passes} passes"),
            Self::SvgfNotFedBack(passes) => format!("SVGF, {passes} passes, not fed back"),
        }
    }
}

/// One variant of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceResult {
    /// Name of the scene.
    pub scene: String,
    /// Name of the stage.
    pub signal: String,
    /// Name of the event.
    pub event: String,
    /// Name of the variant.
    pub variant: String,
    /// Milliseconds a frame, the median.
    pub ms: f64,
    /// Root mean squared error of the last frame.
    pub rmse: f64,
    /// That over the reference: `mean((x - r)² / (r² + 0.01))`.
    pub relative_mse: f64,
    /// Peak signal-to-noise ratio in decibels, for a peak of 1.
    pub psnr: f64,
    /// Structural similarity of the last frame as an 8-bit picture.
    pub ssim: f64,
    /// Mean difference between the last two frames.
    pub flicker: f64,
    /// Frames after the jump until half of what it changed has arrived; `None`
    /// without a jump, or if that did not come.
    pub half_life: Option<u32>,
    /// Error by frame.
    pub by_frame: Vec<f64>,
}

/// A picture of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SequencePicture {
    /// Name of the scene.
    pub scene: String,
    /// Name of the stage, the event and the variant.
    pub name: [String; 3],
    /// What one sees.
    pub caption: String,
    /// The picture.
    pub image: Image,
}

/// What [`measure`] gives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SequenceRun {
    /// One row a variant.
    pub results: Vec<SequenceResult>,
    /// In the order in which to show them.
    pub pictures: Vec<SequencePicture>,
}

/// The image over time of one variant.
struct Denoiser {
    variant: Variant,
    size: UVec2,
    surfaces: Vec<SvgfSurface>,
    /// Moments of what was traced. The filtered history may not be among them:
    /// what the filter blurs would count as noise, and be blurred more.
    states: Vec<TemporalAccumulateState>,
    /// The value over time, filtered by the first pass.
    values: Vec<f32>,
    pass: SvgfPass<1>,
}

impl Denoiser {
    fn new(variant: Variant, size: UVec2, surfaces: &[SvgfSurface]) -> Self {
        let mut pass = SvgfPass::new(size, settings(variant));
        pass.set_surfaces(|at| surfaces[(at.y * size.x + at.x) as usize]);
        Self {
            variant,
            size,
            surfaces: surfaces.to_vec(),
            states: vec![TEMPORAL_ACCUMULATE_EMPTY; surfaces.len()],
            values: vec![0.0; surfaces.len()],
            pass,
        }
    }

    /// Holds the history within what the frame's neighbourhoods allow.
    fn clamp(&mut self, noisy: &[f32]) {
        let size = self.size;
        let read = |at: UVec2| Vec3::splat(noisy[(at.y * size.x + at.x) as usize]);
        self.values
            .par_iter_mut()
            .enumerate()
            .for_each(|(i, value)| {
                let at = UVec2::new(i as u32 % size.x, i as u32 / size.x);
                let history = Vec3::splat(*value);
                *value = variance_clamp_pixel(at, size, 2, history, 1.0, 0, read).x;
            });
    }

    /// Takes a frame, gives the filtered one and milliseconds.
    fn step(&mut self, noisy: &[f32]) -> (Vec<f32>, f64) {
        let start = Instant::now();
        let ms = |start: Instant| start.elapsed().as_secs_f64() * 1e3;
        let settings = settings(self.variant);
        let cap = match self.variant {
            Variant::None => return (noisy.to_vec(), 0.0),
            Variant::Average | Variant::Clamped => LONG,
            Variant::Svgf(_) | Variant::SvgfNotFedBack(_) => 1.0 / settings.alpha,
        };
        if self.variant == Variant::Clamped {
            self.clamp(noisy);
        }
        self.states
            .par_iter_mut()
            .zip(&mut self.values)
            .zip(noisy)
            .for_each(|((state, value), sample)| {
                *state = temporal_accumulate_step(*state, *sample, cap);
                let alpha = temporal_accumulate_alpha(state.history, cap);
                *value = temporal_accumulate_mean(*value, *sample, alpha);
            });
        if settings.passes == 0 {
            return (self.values.clone(), ms(start));
        }
        let (states, values) = (&self.states, &self.values);
        let (surfaces, size) = (&self.surfaces, self.size);
        let index = |at: UVec2| (at.y * size.x + at.x) as usize;
        let read = |at: UVec2| SvgfScalar {
            value: values[index(at)],
            variance: states[index(at)].variance,
        };
        self.pass.set_image(|at| {
            let variance = svgf_variance_scalar_pixel(
                at,
                size,
                states[index(at)].history,
                settings,
                |at| surfaces[index(at)],
                read,
            );
            ([read(at).value], variance)
        });
        let mut fed = Vec::new();
        self.pass.filter(|image| {
            for y in 0..size.y {
                fed.extend_from_slice(image.row(y, 0));
            }
        });
        if !matches!(self.variant, Variant::SvgfNotFedBack(_)) {
            self.values = fed;
        }
        let mut out = Vec::with_capacity(noisy.len());
        for y in 0..size.y {
            out.extend_from_slice(self.pass.row(y, 0));
        }
        (out, ms(start))
    }
}

fn settings(variant: Variant) -> SvgfSettings {
    SvgfSettings {
        passes: match variant {
            Variant::Svgf(passes) | Variant::SvgfNotFedBack(passes) => passes,
            _ => 0,
        },
        ..SvgfSettings::PAPER
    }
}

fn errors(image: &[f32], reference: &[f32], chosen: &[bool]) -> (f64, f64) {
    let (mut squared, mut relative, mut count) = (0.0, 0.0, 0.0);
    for i in (0..image.len()).filter(|i| chosen[*i]) {
        let (x, r) = (f64::from(image[i]), f64::from(reference[i]));
        squared += (x - r).powi(2);
        relative += (x - r).powi(2) / (r * r + 0.01);
        count += 1.0;
    }
    let count = f64::max(count, 1.0);
    (squared / count, relative / count)
}

fn grey(size: UVec2, values: &[f32]) -> GrayImage {
    GrayImage::from_fn(size.x, size.y, |x, y| {
        image::Luma([srgb8(values[(y * size.x + x) as usize])])
    })
}

/// Structural similarity as the library has it; `NaN` if it has none, as for
/// a picture of a few pixels.
fn similarity(size: UVec2, image: &[f32], reference: &[f32]) -> f64 {
    use image_compare::{Algorithm, gray_similarity_structure};
    let (image, reference) = (grey(size, image), grey(size, reference));
    gray_similarity_structure(&Algorithm::MSSIMSimple, &image, &reference)
        .map_or(f64::NAN, |s| s.score)
}

/// Renders a sequence of one signal on the CPU and filters it in every way.
///
/// # Errors
/// If the settings are out of range.
pub fn measure(
    scene: &StageScene,
    stage: Stage,
    event: Event,
    settings: &SequenceSettings,
) -> Result<SequenceRun, StageError> {
    let (width, height) = (settings.width, settings.height);
    let size = UVec2::new(width, height);
    let mut renderer = Renderer::new(scene, Backend::Cpu, width, height, 2.0)?;
    let eye = scene.scene.camera.eye;
    let surfaces: Vec<SvgfSurface> = renderer
        .seen()
        .map(|(position, normal, hit)| SvgfSurface {
            position,
            reach: if hit {
                REACH * position.distance(eye)
            } else {
                0.0
            },
            normal,
        })
        .collect();
    let jump = settings.frames / 2;
    let first_light = scene.scene.light;
    let turned = glam::Quat::from_rotation_y(0.35) * first_light.direction;
    let reference = |renderer: &mut Renderer<'_>| -> Result<Vec<f32>, StageError> {
        let job = Job {
            frame: 1,
            ..Job::samples(stage, settings.reference_samples)
        };
        Ok(renderer.render(&job)?.image.data)
    };
    let mut chosen = renderer.traced(stage);
    let before = reference(&mut renderer)?;
    let mut noisy = Vec::new();
    let mut after = None;
    for frame in 0..settings.frames {
        if event == Event::Jump && frame == jump {
            renderer.turn_light(turned);
            for (c, t) in chosen.iter_mut().zip(renderer.traced(stage)) {
                *c |= t;
            }
            after = Some(reference(&mut renderer)?);
        }
        let job = Job {
            sampler: Sampler::White,
            frame: 16 + frame,
            ..Job::frame(stage)
        };
        noisy.push(renderer.render(&job)?.image.data);
    }
    let truth = |frame: u32| match &after {
        Some(after) if frame >= jump => after,
        _ => &before,
    };

    let name = &scene.scene.name;
    let mut out = SequenceRun::default();
    let picture = |what: &str, caption: String, data: Vec<f32>| SequencePicture {
        scene: name.clone(),
        name: [stage.name().into(), event.name().into(), what.into()],
        caption,
        image: Image {
            width,
            height,
            channels: 1,
            data,
        },
    };
    let last = truth(settings.frames - 1);
    for variant in Variant::ALL {
        let mut denoiser = Denoiser::new(variant, size, &surfaces);
        let (mut by_frame, mut times) = (Vec::new(), Vec::new());
        let mut half_life = None;
        let mut shown = [Vec::new(), Vec::new()];
        for (frame, noisy) in (0..).zip(&noisy) {
            let (image, ms) = denoiser.step(noisy);
            times.push(ms);
            by_frame.push(errors(&image, truth(frame), &chosen).0.sqrt());
            if let (Some(after), None) = (&after, half_life)
                && frame >= jump
                && ghost(&image, &before, after) <= 0.5
            {
                half_life = Some(frame - jump);
            }
            shown = [std::mem::take(&mut shown[1]), image];
        }
        let [previous, image] = shown;
        let (squared, relative_mse) = errors(&image, last, &chosen);
        let difference: f64 = (0..image.len())
            .filter(|i| chosen[*i])
            .map(|i| f64::from((image[i] - previous[i]).abs()))
            .sum();
        times.sort_by(f64::total_cmp);
        let result = SequenceResult {
            scene: name.clone(),
            signal: stage.name().into(),
            event: event.name().into(),
            variant: variant.name(),
            ms: times[times.len() / 2],
            rmse: squared.sqrt(),
            relative_mse,
            psnr: -10.0 * squared.max(1e-12).log10(),
            ssim: similarity(size, &image, last),
            flicker: difference / chosen.iter().filter(|c| **c).count().max(1) as f64,
            half_life,
            by_frame,
        };
        if matches!(
            variant,
            Variant::None
                | Variant::Average
                | Variant::Clamped
                | Variant::Svgf(1)
                | Variant::Svgf(5)
        ) {
            out.pictures.push(picture(
                &result.variant,
                format!(
                    "{}, {}, the last of {} frames, {}: {:.2} ms a frame, RMSE {:.4}, SSIM {:.3}.",
                    stage.title(),
                    event.name(),
                    settings.frames,
                    result.variant,
                    result.ms,
                    result.rmse,
                    result.ssim,
                ),
                image,
            ));
        }
        out.results.push(result);
    }
    out.pictures.push(picture(
        "reference",
        format!(
            "{}, {}: reference, {} samples a pixel.",
            stage.title(),
            event.name(),
            settings.reference_samples
        ),
        last.clone(),
    ));
    Ok(out)
}

/// How much of the picture before a jump is left in one after it: 1 all, 0
/// nothing. The noise of single pixels averages out.
fn ghost(image: &[f32], before: &[f32], after: &[f32]) -> f64 {
    let (mut left, mut all) = (0.0, 0.0);
    for ((x, b), a) in image.iter().zip(before).zip(after) {
        let change = f64::from(b - a);
        left += f64::from(x - a) * change;
        all += change * change;
    }
    left / f64::max(all, 1e-12)
}
