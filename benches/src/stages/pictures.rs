//! Every stage as pictures, with times and errors.

use super::program::stage_shade;
use super::{Backend, Image, Job, Renderer, Sampler, Stage, StageError, StageScene, StageSettings};

/// Difference pictures are brightened by this factor.
const AMPLIFICATION: f32 = 16.0;

/// Samples of a pixel in the pictures that compare samplers.
const SAMPLER_SAMPLES: u32 = 16;

/// Values closer than this count as equal: half a step of an 8-bit picture's
/// darkest tones, 2^-13.
const SAME: f32 = 1.0 / 8192.0;

/// A picture for the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Unique, in file-name characters: scene, stage, variant, backend.
    pub id: String,
    /// Name of the scene.
    pub scene: String,
    /// The stage, or `None` for all of them together.
    pub stage: Option<Stage>,
    /// `1 spp`, `reference`, `exact` where nothing is random, or a sampler's
    /// name in the pictures that compare samplers.
    pub variant: String,
    /// `cpu`, or the adapter's name and driver.
    pub backend: String,
    /// Whether this is a difference picture.
    pub is_difference: bool,
    /// What one sees, with the numbers, in plain text.
    pub caption: String,
    /// The picture, linear.
    pub image: Image,
}

/// One row of the table of stages.
#[derive(Clone, Debug, PartialEq)]
pub struct StageResult {
    /// Name of the scene.
    pub scene: String,
    /// Which stage.
    pub stage: Stage,
    /// `1 spp`, `reference`, or `exact` where nothing is random.
    pub variant: String,
    /// `cpu`, or the adapter's name and driver.
    pub backend: String,
    /// Samples of a pixel.
    pub samples: u32,
    /// Milliseconds for the picture, the median of the repetitions.
    pub ms: f64,
    /// Rays traced.
    pub rays: u64,
    /// Root mean squared error over the pixels that trace rays, against the
    /// CPU's reference; `None` for that itself. A software adapter's reference
    /// may have fewer samples; this is then its noise.
    pub rmse: Option<f64>,
    /// Root mean squared difference to the CPU's picture of the same samples,
    /// over the whole picture; `None` on the CPU.
    pub parity_rmse: Option<f64>,
    /// Pixels that differ from the CPU's by more than 2^-13; `None` on the CPU.
    pub differing: Option<usize>,
    /// Pixels in the picture.
    pub pixels: usize,
}

/// What [`run_stages`] gives for one scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageRun {
    /// The table.
    pub results: Vec<StageResult>,
    /// The pictures, in the order in which to show them.
    pub pictures: Vec<Picture>,
}

/// Renders every stage on every backend, at one sample a pixel and as
/// reference, with the difference of each GPU picture to the CPU's, and
/// compares the samplers at 16 samples a pixel on the first backend. The CPU
/// always renders too, since errors are against it; it only has rows and
/// pictures of its own if it is among the backends.
///
/// # Errors
/// If the settings are out of range or an adapter does not take the scene.
pub fn run_stages(
    scene: &StageScene,
    settings: &StageSettings,
    backends: &[Backend<'_>],
    progress: &dyn Fn(&str),
) -> Result<StageRun, StageError> {
    settings.check()?;
    let new = |backend| {
        Renderer::new(
            scene,
            backend,
            settings.width,
            settings.height,
            settings.ao_power,
        )
    };
    let mut cpu = new(Backend::Cpu)?;
    let with_cpu = backends.iter().any(|b| matches!(b, Backend::Cpu));
    let mut gpus = Vec::new();
    for &backend in backends {
        if let Backend::Gpu(_) = backend {
            gpus.push((new(backend)?, backend.is_software_gpu()));
        }
    }
    let name = &scene.scene.name;
    let mut out = StageRun::default();
    let mut references = Vec::new();
    for stage in Stage::ALL {
        let reference_job = Job {
            frame: 1,
            ..Job::samples(
                stage,
                if stage.is_sampled() {
                    settings.reference_samples
                } else {
                    1
                },
            )
        };
        let traced = cpu.traced(stage);
        progress(&format!("{name}: {}, reference on cpu", stage.title()));
        let repeats = if stage.is_sampled() {
            1
        } else {
            settings.repeats
        };
        let reference = cpu.render_timed(&reference_job, repeats)?;
        let mut jobs = vec![(reference_job, repeats)];
        if stage.is_sampled() {
            jobs.insert(0, (Job::frame(stage), settings.repeats));
        }
        for (job, repeats) in jobs {
            let is_reference = job == reference_job;
            let variant = match (stage.is_sampled(), is_reference) {
                (false, _) => "exact",
                (true, true) => "reference",
                (true, false) => "1 spp",
            };
            let truth = if is_reference {
                reference.clone()
            } else {
                cpu.render_timed(&job, repeats)?
            };
            let row = |backend: &str, r: &super::Rendered| StageResult {
                scene: name.clone(),
                stage,
                variant: variant.into(),
                backend: backend.into(),
                samples: job.samples,
                ms: r.ms,
                rays: r.rays,
                rmse: Some(r.image.rmse(&reference.image, Some(&traced))),
                parity_rmse: None,
                differing: None,
                pixels: traced.len(),
            };
            let picture = |backend: &str, is_difference, caption: String, image| Picture {
                id: slug(&[
                    name,
                    stage.name(),
                    variant,
                    backend,
                    if is_difference { "difference" } else { "" },
                ]),
                scene: name.clone(),
                stage: Some(stage),
                variant: variant.into(),
                backend: backend.into(),
                is_difference,
                caption,
                image,
            };
            if with_cpu {
                let mut result = row("cpu", &truth);
                if is_reference {
                    result.rmse = None;
                }
                out.pictures.push(picture(
                    "cpu",
                    false,
                    caption(stage, &result),
                    truth.image.clone(),
                ));
                out.results.push(result);
            }
            for (gpu, is_software) in &mut gpus {
                let mut job = job;
                let fewer;
                let mut truth = &truth;
                if is_reference && *is_software && stage.is_sampled() {
                    job.samples = job.samples.min(settings.reference_samples_software);
                    fewer = cpu.render(&job)?;
                    truth = &fewer;
                }
                progress(&format!(
                    "{name}: {}, {variant} on {}",
                    stage.title(),
                    gpu.label()
                ));
                let rendered = gpu.render_timed(&job, repeats)?;
                let mut result = StageResult {
                    samples: job.samples,
                    ..row(gpu.label(), &rendered)
                };
                let parity = rendered.image.rmse(&truth.image, None);
                let differing = rendered.image.differing(&truth.image, SAME);
                result.parity_rmse = Some(parity);
                result.differing = Some(differing);
                let difference = rendered.image.difference(&truth.image, AMPLIFICATION);
                out.pictures.push(picture(
                    gpu.label(),
                    false,
                    caption(stage, &result),
                    rendered.image,
                ));
                out.pictures.push(picture(
                    gpu.label(),
                    true,
                    format!(
                        "{}{}: difference between cpu and {}, times {AMPLIFICATION}. \
                         {differing} of {} pixels differ; RMSE {parity:.2e}.",
                        stage.title(),
                        samples_text(&result),
                        gpu.label(),
                        traced.len(),
                    ),
                    difference,
                ));
                out.results.push(result);
            }
        }
        references.push(reference.image);
    }
    let first = match backends.first() {
        Some(Backend::Gpu(_)) => gpus.first_mut().map(|(gpu, _)| gpu),
        Some(Backend::Cpu) => Some(&mut cpu),
        None => None,
    };
    if let Some(renderer) = first {
        progress(&format!("{name}: samplers on {}", renderer.label()));
        for (stage, reference) in Stage::ALL.iter().zip(&references) {
            if matches!(stage, Stage::SoftShadow | Stage::AmbientOcclusion) {
                let compared = samplers(name, renderer, *stage, reference)?;
                out.pictures.extend(compared);
            }
        }
    }
    out.pictures.insert(0, together(scene, &cpu, &references));
    Ok(out)
}

/// One picture a sampler, all with the same number of samples.
fn samplers(
    scene: &str,
    renderer: &mut Renderer<'_>,
    stage: Stage,
    reference: &Image,
) -> Result<Vec<Picture>, StageError> {
    let traced = renderer.traced(stage);
    Sampler::ALL
        .iter()
        .map(|&sampler| {
            let rendered = renderer.render(&Job {
                sampler,
                ..Job::samples(stage, SAMPLER_SAMPLES)
            })?;
            Ok(Picture {
                id: slug(&[scene, stage.name(), sampler.name(), renderer.label()]),
                scene: scene.into(),
                stage: Some(stage),
                variant: sampler.name().into(),
                backend: renderer.label().into(),
                is_difference: false,
                caption: format!(
                    "{}, {SAMPLER_SAMPLES} samples a pixel by {}: RMSE to the reference {:.3}.",
                    stage.title(),
                    sampler.name(),
                    rendered.image.rmse(reference, Some(&traced)),
                ),
                image: rendered.image,
            })
        })
        .collect()
}

fn caption(stage: Stage, r: &StageResult) -> String {
    let rate = r.rays as f64 / r.ms.max(1e-6) * 1e-3;
    let mut text = format!(
        "{}{}, on {}: {:.1} ms, {rate:.1} Mrays/s.",
        stage.title(),
        samples_text(r),
        r.backend,
        r.ms
    );
    if r.variant == "1 spp"
        && let Some(rmse) = r.rmse
    {
        text += &format!(" RMSE to the reference {rmse:.3}.");
    }
    text
}

fn samples_text(r: &StageResult) -> String {
    match (r.stage.is_sampled(), r.samples) {
        (false, _) => String::new(),
        (true, 1) => ", 1 sample a pixel".into(),
        (true, n) => format!(", {n} samples a pixel"),
    }
}

/// The stages together, from the references: sky times occlusion and light
/// times soft shadow.
fn together(scene: &StageScene, cpu: &Renderer<'_>, references: &[Image]) -> Picture {
    let [first, _, shadow, open, _] = references else {
        unreachable!("a reference for each stage")
    };
    let data = cpu
        .surfaces
        .iter()
        .zip(shadow.data.iter().zip(&open.data))
        .flat_map(|(s, (&light, &open))| stage_shade(&cpu.parameters, s, light, open).to_array())
        .collect();
    Picture {
        id: slug(&[&scene.scene.name, "together"]),
        scene: scene.scene.name.clone(),
        stage: None,
        variant: "reference".into(),
        backend: "cpu".into(),
        is_difference: false,
        caption: "All stages together: the sky times ambient occlusion, the light times its soft \
                  shadow."
            .into(),
        image: Image {
            data,
            ..first.clone()
        },
    }
}

/// Lower-case words with hyphens, from several parts.
pub(crate) fn slug(parts: &[&str]) -> String {
    let mut out = String::new();
    for c in parts.join(" ").chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_lowercase());
        } else if !out.ends_with('-') && !out.is_empty() {
            out.push('-');
        }
    }
    out.trim_end_matches('-').into()
}

#[cfg(test)]
mod tests {
    use super::slug;

    #[test]
    fn slugs_are_file_names() {
        assert_eq!(slug(&["My scene/é", "1 spp", ""]), "my-scene-1-spp");
    }
}
