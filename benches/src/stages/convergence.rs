//! Error against samples and against time, by sampler.

use super::{Backend, Image, Job, Renderer, Sampler, Stage, StageError, StageScene, StageSettings};

/// The stages on which samplers are compared.
const STAGES: [Stage; 2] = [Stage::SoftShadow, Stage::AmbientOcclusion];

/// Slopes are fitted from here on: at one or two samples every sampler is
/// white noise.
const FIT_FROM: u32 = 4;

/// One point of the plots.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvergencePoint {
    /// Which stage.
    pub stage: Stage,
    /// Which random numbers.
    pub sampler: Sampler,
    /// `cpu`, or the adapter's name and driver.
    pub backend: String,
    /// Samples of a pixel.
    pub samples: u32,
    /// Root mean squared error against the reference, over the pixels that
    /// trace rays.
    pub rmse: f64,
    /// Milliseconds for the picture.
    pub ms: f64,
    /// Rays traced.
    pub rays: u64,
}

/// The straight line through a sampler's points in the logarithms.
#[derive(Clone, Debug, PartialEq)]
pub struct Slope {
    /// Which stage.
    pub stage: Stage,
    /// Which random numbers.
    pub sampler: Sampler,
    /// `cpu`, or the adapter's name and driver.
    pub backend: String,
    /// Exponent: error falls as `samples^slope`. White noise has -1/2.
    pub slope: f64,
    /// Error at one sample according to the line.
    pub at_one: f64,
}

/// What errors are measured against: Halton points of two other frames,
/// independent of those measured, averaged.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Which stage.
    pub stage: Stage,
    /// Samples of a pixel in all.
    pub samples: u32,
    /// Estimate of its own root mean squared error: half of the distance
    /// between its two halves.
    pub rmse: f64,
    /// Pixels that trace rays, the ones that count.
    pub pixels: usize,
}

/// Everything that the plots show.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Convergence {
    /// The points, by backend, stage, sampler and samples.
    pub points: Vec<ConvergencePoint>,
    /// A line for each backend, stage and sampler with at least three points
    /// from 4 samples on.
    pub slopes: Vec<Slope>,
    /// A reference for each stage.
    pub references: Vec<Reference>,
}

/// Measures every sampler on soft shadows and ambient occlusion, at powers of
/// two up to the settings' number of samples (a grid at its squares), on every
/// backend. The reference is the CPU's.
///
/// # Errors
/// If the settings are out of range or an adapter does not take the scene.
pub fn convergence(
    scene: &StageScene,
    settings: &StageSettings,
    backends: &[Backend<'_>],
    progress: &dyn Fn(&str),
) -> Result<Convergence, StageError> {
    settings.check()?;
    let (width, height) = (settings.convergence_width, settings.convergence_height);
    let mut cpu = Renderer::new(scene, Backend::Cpu, width, height, settings.ao_power)?;
    let mut out = Convergence::default();
    let mut truths = Vec::new();
    // At least as many as are measured: a shorter frame would share points.
    let half = settings
        .convergence_reference
        .max(settings.convergence_samples);
    for stage in STAGES {
        progress(&format!(
            "{}: reference of {}",
            scene.scene.name,
            stage.title()
        ));
        let (truth, reference) = reference(&mut cpu, stage, half)?;
        truths.push((stage, truth, cpu.traced(stage)));
        out.references.push(reference);
    }
    for &backend in backends {
        let mut own;
        let renderer = match backend {
            Backend::Cpu => &mut cpu,
            Backend::Gpu(_) => {
                own = Renderer::new(scene, backend, width, height, settings.ao_power)?;
                &mut own
            }
        };
        let most = if backend.is_software_gpu() {
            settings.convergence_samples_software
        } else {
            settings.convergence_samples
        };
        for (stage, truth, traced) in &truths {
            for sampler in Sampler::ALL {
                progress(&format!(
                    "{}: {} with {} on {}",
                    scene.scene.name,
                    stage.title(),
                    sampler.name(),
                    renderer.label()
                ));
                let mut line = Vec::new();
                for samples in counts(sampler, most) {
                    let job = Job {
                        stage: *stage,
                        sampler,
                        samples,
                        frame: 0,
                    };
                    // Long runs need no repetition to be timed.
                    let repeats = if samples <= 16 { settings.repeats } else { 1 };
                    let rendered = renderer.render_timed(&job, repeats)?;
                    let rmse = rendered.image.rmse(truth, Some(traced));
                    line.push((samples, rmse));
                    out.points.push(ConvergencePoint {
                        stage: *stage,
                        sampler,
                        backend: renderer.label().into(),
                        samples,
                        rmse,
                        ms: rendered.ms,
                        rays: rendered.rays,
                    });
                }
                line.retain(|(samples, _)| *samples >= FIT_FROM);
                if let Some((slope, at_one)) = fit(&line) {
                    out.slopes.push(Slope {
                        stage: *stage,
                        sampler,
                        backend: renderer.label().into(),
                        slope,
                        at_one,
                    });
                }
            }
        }
    }
    Ok(out)
}

/// The mean of two frames, and what their distance says about its error.
fn reference(
    renderer: &mut Renderer<'_>,
    stage: Stage,
    half: u32,
) -> Result<(Image, Reference), StageError> {
    let job = |frame| Job {
        stage,
        sampler: Sampler::Halton,
        samples: half,
        frame,
    };
    let mut truth = renderer.render(&job(1))?.image;
    let other = renderer.render(&job(2))?.image;
    let traced = renderer.traced(stage);
    let rmse = 0.5 * truth.rmse(&other, Some(&traced));
    for (a, b) in truth.data.iter_mut().zip(&other.data) {
        *a = 0.5 * (*a + b);
    }
    let reference = Reference {
        stage,
        samples: 2 * half,
        rmse,
        pixels: traced.iter().filter(|t| **t).count(),
    };
    Ok((truth, reference))
}

/// Numbers of samples to measure: powers of 2, for a grid powers of 4.
fn counts(sampler: Sampler, most: u32) -> Vec<u32> {
    let step = if sampler == Sampler::Grid { 4 } else { 2 };
    std::iter::successors(Some(1u32), |n| n.checked_mul(step))
        .take_while(|n| *n <= most)
        .collect()
}

/// Least squares in the logarithms: slope and value at 1. Needs three points
/// with an error above zero.
fn fit(line: &[(u32, f64)]) -> Option<(f64, f64)> {
    let points: Vec<(f64, f64)> = line
        .iter()
        .filter(|(_, rmse)| *rmse > 0.0)
        .map(|&(n, rmse)| (f64::from(n).ln(), rmse.ln()))
        .collect();
    if points.len() < 3 {
        return None;
    }
    let count = points.len() as f64;
    let mean_x = points.iter().map(|p| p.0).sum::<f64>() / count;
    let mean_y = points.iter().map(|p| p.1).sum::<f64>() / count;
    let xy: f64 = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    let xx: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    let slope = xy / xx;
    Some((slope, (mean_y - slope * mean_x).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fit_finds_a_power_law() {
        let line: Vec<_> = [4u32, 16, 64]
            .iter()
            .map(|&n| (n, 0.3 * f64::from(n).powf(-0.75)))
            .collect();
        let (slope, at_one) = fit(&line).unwrap();
        assert!((slope + 0.75).abs() < 1e-12 && (at_one - 0.3).abs() < 1e-12);
        assert_eq!(fit(&line[..2]), None);
        assert_eq!(fit(&[(4, 0.0), (8, 0.0), (16, 0.0)]), None);
    }

    #[test]
    fn grids_are_square() {
        assert_eq!(counts(Sampler::Grid, 256), [1, 4, 16, 64, 256]);
        assert_eq!(counts(Sampler::White, 16), [1, 2, 4, 8, 16]);
    }
}
