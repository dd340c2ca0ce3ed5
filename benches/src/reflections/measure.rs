//! Time, error and variance of every variant, and pictures.

use glam::{DVec3, Vec3};

use super::cpu::CpuReflections;
use super::gpu::{GpuReflections, Pass};
use super::program::{NONE, Parameters};
use super::{BILATERAL, Backend, NEIGHBOURS, ROUGHNESS, ReflectionScene, ReflectionSettings};
use crate::stages::{Image, StageError};

/// Values closer than this count as equal: 2^-10, a quarter of an 8-bit step.
const SAME: f32 = 1.0 / 1024.0;

/// Fewest pixels of a ball that is measured for itself.
const LEAST_PIXELS: usize = 100;

/// Seeds of the reference, away from those of all frames.
const REFERENCE_FRAME: u32 = 1 << 20;

/// One way to get a picture, on one backend.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectionResult {
    /// Name of the scene.
    pub scene: String,
    /// Name of the view.
    pub view: String,
    /// `cpu`, or the adapter's name and driver.
    pub backend: String,
    /// Neighbours that a pixel gathers; 0 for one ray of its own.
    pub neighbours: u32,
    /// Whether the bilateral filter follows.
    pub bilateral: bool,
    /// Milliseconds for the rays, the median of the repetitions.
    pub trace_ms: f64,
    /// Milliseconds for reconstruction and filter.
    pub filter_ms: f64,
    /// Root mean squared error over the pixels with a ball, over all frames,
    /// less the reference's own; on an adapter of one frame.
    pub rmse: f64,
    /// The part of it that does not average out over frames; CPU only.
    pub bias: Option<f64>,
    /// Rays of its own that a pixel would need for as little variance.
    pub rays_by_variance: Option<f64>,
    /// The same for as small an error.
    pub rays_by_error: Option<f64>,
    /// Root mean squared difference to the CPU's picture.
    pub parity_rmse: Option<f64>,
    /// Pixels that differ from the CPU's by more than 2^-10.
    pub differing: Option<usize>,
    /// Pixels with a ball.
    pub pixels: usize,
}

/// What reconstruction is worth on one ball.
#[derive(Clone, Debug, PartialEq)]
pub struct BallResult {
    /// Name of the scene.
    pub scene: String,
    /// Name of the view.
    pub view: String,
    /// Perceptual roughness of the metal.
    pub roughness: f32,
    /// Whether a clear coat lies over it.
    pub coated: bool,
    /// Neighbours.
    pub neighbours: u32,
    /// Whether the bilateral filter follows.
    pub bilateral: bool,
    /// Rays of its own that a pixel would need for as little variance.
    pub rays_by_variance: f64,
    /// The same for as small an error.
    pub rays_by_error: f64,
}

/// A picture of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct ReflectionPicture {
    /// Name of the scene.
    pub scene: String,
    /// `1 ray`, `quarter ray`, `reconstructed`, `filtered`, `reference`.
    pub variant: String,
    /// `cpu`, or the adapter's name and driver.
    pub backend: String,
    /// Whether this is a difference picture.
    pub is_difference: bool,
    /// What one sees.
    pub caption: String,
    /// The picture.
    pub image: Image,
}

/// What [`measure`] gives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReflectionRun {
    /// One row a variant and backend.
    pub results: Vec<ReflectionResult>,
    /// One row a ball, for 16 neighbours.
    pub balls: Vec<BallResult>,
    /// In the order in which to show them.
    pub pictures: Vec<ReflectionPicture>,
}

/// Mean and squared deviation of each pixel over frames, and squared error.
struct Moments {
    count: f64,
    mean: Vec<DVec3>,
    spread: Vec<f64>,
    error: Vec<f64>,
}

impl Moments {
    fn new(pixels: usize) -> Self {
        Self {
            count: 0.0,
            mean: vec![DVec3::ZERO; pixels],
            spread: vec![0.0; pixels],
            error: vec![0.0; pixels],
        }
    }

    fn add(&mut self, image: &[Vec3], reference: &[Vec3]) {
        self.count += 1.0;
        for (i, value) in image.iter().enumerate() {
            let value = value.as_dvec3();
            let before = value - self.mean[i];
            self.mean[i] += before / self.count;
            self.spread[i] += before.dot(value - self.mean[i]);
            self.error[i] += (value - reference[i].as_dvec3()).length_squared();
        }
    }

    /// Variance and squared error over the chosen pixels, a channel and frame.
    fn over(&self, chosen: &[bool]) -> (f64, f64) {
        let (mut variance, mut error, mut pixels) = (0.0, 0.0, 0.0);
        for i in (0..chosen.len()).filter(|i| chosen[*i]) {
            variance += self.spread[i] / (self.count - 1.0);
            error += self.error[i] / self.count;
            pixels += 1.0;
        }
        let channels = 3.0 * f64::max(pixels, 1.0);
        (variance / channels, error / channels)
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Neighbours and whether the bilateral filter follows.
fn variants() -> impl Iterator<Item = (u32, bool)> {
    NEIGHBOURS.into_iter().flat_map(|n| [(n, false), (n, true)])
}

fn with(p: &Parameters, neighbours: u32, bilateral: bool) -> Parameters {
    Parameters {
        neighbours,
        max_taps: if bilateral { BILATERAL.1 } else { 0 },
        ..*p
    }
}

/// Renders a view on every backend and measures it. The CPU always renders,
/// since errors and variances are its; it has rows and pictures of its own if
/// it is among the backends.
///
/// # Errors
/// If the size is zero or too large.
pub fn measure(
    scene: &ReflectionScene<'_>,
    view: usize,
    settings: &ReflectionSettings,
    backends: &[Backend<'_>],
    progress: &dyn Fn(&str),
) -> Result<ReflectionRun, StageError> {
    let (width, height) = (settings.width, settings.height);
    crate::stages::check_size(width, height)?;
    let p = scene.parameters(view, width, height)?;
    let name = format!("{}, {}", scene.scene.scene.name, scene.views[view].0);
    progress(&format!("reflections in {name}: reference"));
    let mut cpu = CpuReflections::new(scene, &p);
    let covered: Vec<bool> = cpu.surfaces.iter().map(|s| s.ball != NONE).collect();
    let pixels = covered.iter().filter(|c| **c).count();
    let reference = {
        let samples = settings.reference_samples;
        let (mut sum, _) = cpu.sum(&Parameters {
            frame: REFERENCE_FRAME,
            sample_count: samples,
            ..p
        });
        for v in &mut sum {
            *v /= samples as f32;
        }
        sum
    };

    progress(&format!("reflections in {name}: variance over frames"));
    let mut plain = Moments::new(covered.len());
    let mut found: Vec<Moments> = variants().map(|_| Moments::new(covered.len())).collect();
    let mut firsts: Vec<Vec<Vec3>> = Vec::new();
    let mut first_plain = Vec::new();
    for frame in 0..settings.frames {
        let p = Parameters { frame, ..p };
        let (image, _) = cpu.sum(&p);
        plain.add(&image, &reference);
        if frame == 0 {
            first_plain = image;
        }
        cpu.half(&p);
        for (k, (neighbours, bilateral)) in variants().enumerate() {
            let p = with(&p, neighbours, bilateral);
            if !bilateral {
                cpu.reconstruct(&p);
            }
            let (image, _) = cpu.finish(&p);
            found[k].add(&image, &reference);
            if frame == 0 {
                firsts.push(image);
            }
        }
    }
    // Of independent samples, the reference is one too.
    let own = |chosen: &[bool]| plain.over(chosen).0 / f64::from(settings.reference_samples);
    let squared = |m: &Moments, chosen: &[bool]| {
        let (variance, error) = m.over(chosen);
        (variance, (error - own(chosen)).max(1e-12))
    };

    let mut out = ReflectionRun::default();
    let row = |backend: &str, neighbours, bilateral| ReflectionResult {
        scene: scene.scene.scene.name.clone(),
        view: scene.views[view].0.into(),
        backend: backend.into(),
        neighbours,
        bilateral,
        trace_ms: 0.0,
        filter_ms: 0.0,
        rmse: 0.0,
        bias: None,
        rays_by_variance: None,
        rays_by_error: None,
        parity_rmse: None,
        differing: None,
        pixels,
    };
    let with_cpu = backends.iter().any(|b| matches!(b, Backend::Cpu));
    let (one_variance, one_error) = squared(&plain, &covered);
    let background = cpu.background.clone();
    let picture = |values: &[Vec3]| Image {
        width,
        height,
        channels: 3,
        data: values
            .iter()
            .zip(&background)
            .flat_map(|(v, b)| (*v + *b).to_array())
            .collect(),
    };
    let mut pictures = Vec::new();
    if with_cpu {
        progress(&format!("reflections in {name}: times on cpu"));
        let times = |pass: &mut dyn FnMut() -> f64| {
            let mut times: Vec<f64> = (0..settings.repeats).map(|_| pass()).collect();
            median(&mut times)
        };
        let trace_ms = times(&mut || cpu.sum(&p).1);
        out.results.push(ReflectionResult {
            trace_ms,
            rmse: one_error.sqrt(),
            bias: Some(0.0),
            rays_by_variance: Some(1.0),
            rays_by_error: Some(1.0),
            ..row("cpu", 0, false)
        });
        let trace_ms = times(&mut || cpu.half(&p));
        let mut gather_ms = 0.0;
        for (k, (neighbours, bilateral)) in variants().enumerate() {
            let p = with(&p, neighbours, bilateral);
            if !bilateral {
                gather_ms = times(&mut || cpu.reconstruct(&p));
            }
            let finish_ms = times(&mut || cpu.finish(&p).1);
            let (variance, error) = squared(&found[k], &covered);
            out.results.push(ReflectionResult {
                trace_ms,
                filter_ms: gather_ms + finish_ms,
                rmse: error.sqrt(),
                bias: Some((error - variance).max(0.0).sqrt()),
                rays_by_variance: Some(one_variance / variance),
                rays_by_error: Some(one_error / error),
                ..row("cpu", neighbours, bilateral)
            });
        }
        pictures.push(("1 ray", "cpu".to_owned(), first_plain.clone()));
        for (k, variant) in [(0, "quarter ray"), (6, "reconstructed"), (7, "filtered")] {
            pictures.push((variant, "cpu".to_owned(), firsts[k].clone()));
        }
    }
    let last = NEIGHBOURS[NEIGHBOURS.len() - 1];
    for (index, ball) in scene.balls.iter().enumerate() {
        let chosen: Vec<bool> = cpu
            .surfaces
            .iter()
            .map(|s| s.ball == index as u32)
            .collect();
        // A ball that another hides says nothing.
        if chosen.iter().filter(|c| **c).count() < LEAST_PIXELS {
            continue;
        }
        let (one_variance, one_error) = squared(&plain, &chosen);
        for (k, (neighbours, bilateral)) in variants().enumerate() {
            if neighbours != last {
                continue;
            }
            let (variance, error) = squared(&found[k], &chosen);
            out.balls.push(BallResult {
                scene: scene.scene.scene.name.clone(),
                view: scene.views[view].0.into(),
                roughness: ROUGHNESS[index % ROUGHNESS.len()],
                coated: ball.count > 1,
                neighbours,
                bilateral,
                rays_by_variance: one_variance / variance,
                rays_by_error: one_error / error,
            });
        }
    }

    for backend in backends {
        let Backend::Gpu(program) = backend else {
            continue;
        };
        let label = program.gpu().label();
        progress(&format!("reflections in {name}: {label}"));
        let gpu = GpuReflections::new(program, scene, &p);
        let rms = |a: &[Vec3], b: &[Vec3]| {
            let sum: f64 = (0..covered.len())
                .filter(|i| covered[*i])
                .map(|i| (a[i] - b[i]).as_dvec3().length_squared())
                .sum();
            (sum / (3 * pixels.max(1)) as f64).sqrt()
        };
        let times = |pass, p: &Parameters| {
            let mut times: Vec<f64> = (0..settings.repeats).map(|_| gpu.run(pass, p)).collect();
            median(&mut times)
        };
        let mut add = |mut r: ReflectionResult, image: Vec<Vec3>, twin: &[Vec3]| {
            // Where there is no ball the adapter's image holds the room.
            let image: Vec<Vec3> = image
                .into_iter()
                .zip(&covered)
                .map(|(v, c)| if *c { v } else { Vec3::ZERO })
                .collect();
            r.rmse = rms(&image, &reference);
            r.parity_rmse = Some(rms(&image, twin));
            let differing = (0..covered.len())
                .filter(|i| (image[*i] - twin[*i]).abs().max_element() > SAME)
                .count();
            r.differing = Some(differing);
            out.results.push(r);
            image
        };
        let trace_ms = times(Pass::Sum, &p);
        let image = gpu.image(&p);
        let r = ReflectionResult {
            trace_ms,
            ..row(&label, 0, false)
        };
        add(r, image, &first_plain);
        let trace_ms = times(Pass::Half, &p);
        let mut gather_ms = 0.0;
        for (k, (neighbours, bilateral)) in variants().enumerate() {
            let p = with(&p, neighbours, bilateral);
            if !bilateral {
                gather_ms = times(Pass::Reconstruct, &p);
            }
            let finish_ms = times(Pass::Finish, &p);
            let r = ReflectionResult {
                trace_ms,
                filter_ms: gather_ms + finish_ms,
                ..row(&label, neighbours, bilateral)
            };
            let image = add(r, gpu.image(&p), &firsts[k]);
            if (neighbours, bilateral) == (last, true) {
                pictures.push(("filtered", label.clone(), image));
            }
        }
    }
    pictures.push(("reference", "cpu".to_owned(), reference.clone()));

    for (variant, backend, values) in pictures {
        let of = |neighbours, bilateral| {
            out.results.iter().find(|r| {
                r.backend == backend && r.neighbours == neighbours && r.bilateral == bilateral
            })
        };
        let (what, row) = match variant {
            "1 ray" => ("one ray a pixel".into(), of(0, false)),
            "quarter ray" => (
                "a quarter of a ray a pixel, each shared by four pixels".into(),
                of(1, false),
            ),
            "reconstructed" => (
                format!("a quarter of a ray a pixel, {last} neighbours"),
                of(last, false),
            ),
            "filtered" => (
                format!("a quarter of a ray a pixel, {last} neighbours and the bilateral filter"),
                of(last, true),
            ),
            _ => (
                format!("reference, {} rays a pixel", settings.reference_samples),
                None,
            ),
        };
        let numbers = row.map_or(String::new(), |r| {
            format!(
                ": {:.1} ms for rays, {:.1} ms for filters, RMSE {:.3}",
                r.trace_ms, r.filter_ms, r.rmse
            )
        });
        out.pictures.push(ReflectionPicture {
            scene: scene.scene.scene.name.clone(),
            variant: variant.into(),
            backend: backend.clone(),
            is_difference: false,
            caption: format!("{name}, on {backend}: {what}{numbers}."),
            image: picture(&values),
        });
        if variant == "filtered" && backend != "cpu" {
            let difference = picture(&values).difference(&picture(&firsts[7]), 16.0);
            let differing = row.and_then(|r| r.differing).unwrap_or(0);
            out.pictures.push(ReflectionPicture {
                scene: scene.scene.scene.name.clone(),
                variant: variant.into(),
                caption: format!(
                    "{name}, the same: difference between cpu and {backend}, times 16. \
                     {differing} of {pixels} pixels differ."
                ),
                backend,
                is_difference: true,
                image: difference,
            });
        }
    }
    Ok(out)
}
