//! Noisy sequences through the filters over time: error against milliseconds.
//!
//! The toy room or the kitchen, with the balls of [`crate::reflections`] on the
//! floor, at one shadow ray, one ambient-occlusion ray or a quarter of a
//! reflection ray a pixel and frame. Camera, ball or light move, or nothing
//! does. Each frame is reprojected by `temporal/reproject`, accumulated by
//! `temporal/accumulate` and filtered by `filter/svgf` (through `pass/svgf`),
//! whose first pass is fed back; variants leave pieces out or put others in.
//!
//! [`measure`] renders a sequence and gives a row for each variant, with
//! pictures; references are kept between runs.

pub(crate) mod cache;
mod denoise;
mod film;
pub(crate) mod metrics;
mod path;
mod show;
#[cfg(test)]
mod tests;

use glam::{UVec2, Vec3};

use crate::reflections::ReflectionScene;
use crate::stages::StageError;

pub use denoise::{Clamp, Recipe, Where};
pub use path::Event;

use denoise::{Denoiser, Filter, LONG};
use film::{Film, Frame, Reference};
use path::{Moment, moment};
use show::{PANEL, Picture};

/// Passes of the SVGF that pieces are left out of.
const BASE: u32 = 3;

/// Sizes and counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequenceSettings {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames; what jumps does so in the middle.
    pub frames: u32,
    /// Samples of a pixel in the references.
    pub reference_samples: u32,
    /// Whether all variants are measured, or only the main ones.
    pub all: bool,
}

impl SequenceSettings {
    /// For the quick report, which has four sequences.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            width: 640,
            height: 360,
            frames: 64,
            reference_samples: 1024,
            all: true,
        }
    }

    /// For the long run, which has all of them.
    #[must_use]
    pub fn full() -> Self {
        Self {
            width: 1920,
            height: 1080,
            ..Self::quick()
        }
    }
}

/// What is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// One ray toward the light's disk.
    SoftShadow,
    /// One cosine-weighted ray.
    AmbientOcclusion,
    /// A quarter of a reflection ray, gathered from 16 neighbours.
    Reflection,
}

impl Signal {
    /// All.
    pub const ALL: [Self; 3] = [Self::SoftShadow, Self::AmbientOcclusion, Self::Reflection];

    /// Name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SoftShadow => "soft_shadow",
            Self::AmbientOcclusion => "ambient_occlusion",
            Self::Reflection => "reflection",
        }
    }

    /// Name in headings.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::SoftShadow => "Soft shadows",
            Self::AmbientOcclusion => "Ambient occlusion",
            Self::Reflection => "Reflections",
        }
    }

    /// Whether an event changes anything that the signal has not in others.
    #[must_use]
    pub fn has(self, event: Event) -> bool {
        match event {
            Event::LightTurns | Event::LightJumps | Event::LightOff => {
                self != Self::AmbientOcclusion
            }
            _ => true,
        }
    }
}

/// The clamps of a history, by name.
const CLAMPS: [(&str, Clamp); 2] = [
    ("clamped", Clamp::Near),
    ("clamped by 17 x 17 rays", Clamp::Wide),
];

/// How a sequence is filtered.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Name in tables and legends.
    pub name: String,
    /// What is done.
    pub recipe: Recipe,
    /// Whether a scalar is filtered as if it were a colour.
    pub as_color: bool,
    /// What is different from SVGF with three passes.
    pub piece: Option<&'static str>,
}

/// The variants of a signal; `moves`: camera or ball do.
#[must_use]
pub fn variants(signal: Signal, moves: bool, all: bool) -> Vec<Variant> {
    let mut out = Vec::new();
    let mut add = |name: String, recipe, as_color, piece| {
        out.push(Variant {
            name,
            recipe,
            as_color,
            piece,
        });
    };
    let one = match signal {
        Signal::Reflection => "quarter ray",
        _ => "1 spp",
    };
    let average = Recipe::AVERAGE;
    add(one.into(), Recipe::NONE, false, None);
    add(format!("average of {LONG} frames"), average, false, None);
    for (name, clamp) in CLAMPS {
        if clamp == Clamp::Wide && signal == Signal::Reflection {
            continue;
        }
        let recipe = Recipe { clamp, ..average };
        add(
            format!("average of {LONG} frames, {name}"),
            recipe,
            false,
            None,
        );
    }
    if signal == Signal::Reflection {
        for (name, place) in [("hit point", Where::HitPoint), ("blended", Where::Blend)] {
            let recipe = Recipe {
                history: Some(place),
                ..average
            };
            add(
                format!("average of {LONG} frames, {name}"),
                recipe,
                false,
                None,
            );
        }
    }
    for passes in 0..=5 {
        if all || [0, 1, BASE, 5].contains(&passes) {
            let piece = match passes {
                BASE => Some("all of it"),
                0 => Some("no passes over the image"),
                _ => None,
            };
            add(
                format!("SVGF, {passes} passes"),
                Recipe::svgf(passes),
                false,
                piece,
            );
        }
    }
    let base = Recipe::svgf(BASE);
    let mut piece = |name: &'static str, recipe, as_color| {
        add(
            format!("SVGF, {BASE} passes, {name}"),
            recipe,
            as_color,
            Some(name),
        );
    };
    piece(
        "not fed back",
        Recipe {
            feedback: false,
            ..base
        },
        false,
    );
    for (name, clamp) in CLAMPS {
        if clamp == Clamp::Near || signal != Signal::Reflection {
            piece(name, Recipe { clamp, ..base }, false);
        }
    }
    let of_mean = Recipe {
        of_mean: true,
        ..base
    };
    piece("variance of the mean", of_mean, false);
    if signal == Signal::Reflection {
        for (name, place) in [("hit point", Where::HitPoint), ("blended", Where::Blend)] {
            let recipe = Recipe {
                history: Some(place),
                ..base
            };
            piece(name, recipe, false);
        }
    }
    if !all {
        return out;
    }
    piece(
        "no history",
        Recipe {
            history: None,
            cap: 1.0,
            ..base
        },
        false,
    );
    piece(
        "plain variance",
        Recipe {
            plain: true,
            ..base
        },
        false,
    );
    piece("history in f16", Recipe { half: true, ..base }, false);
    if signal != Signal::Reflection {
        piece("as RGB", base, true);
    }
    let tiles = true;
    piece("tiles left out", Recipe { tiles, ..base }, false);
    if moves {
        for (name, place) in [
            ("not reprojected", Where::Here),
            ("reprojected without tests", Where::SurfaceUntested),
        ] {
            let recipe = Recipe {
                history: Some(place),
                ..base
            };
            piece(name, recipe, false);
        }
    }
    out
}

/// One variant of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceResult {
    /// Name of the scene.
    pub scene: String,
    /// Name of the signal.
    pub signal: String,
    /// Name of the event.
    pub event: String,
    /// Pixels in a row, and rows.
    pub size: [u32; 2],
    /// Name of the variant.
    pub variant: String,
    /// What is different from SVGF with three passes.
    pub piece: Option<String>,
    /// What was done, and whether over three channels.
    pub recipe: (Recipe, bool),
    /// Milliseconds a frame, the median.
    pub ms: f64,
    /// Root mean squared error of the last frame.
    pub rmse: f64,
    /// The reference's own error.
    pub reference_rmse: f64,
    /// Squared error over the reference's: `mean((x - r)² / (r² + 0.01))`.
    pub relative_mse: f64,
    /// Peak signal-to-noise ratio in decibels, for a peak of 1.
    pub psnr: f64,
    /// Structural similarity of the last frame as an 8-bit picture.
    pub ssim: f64,
    /// FLIP of it, the mean.
    pub flip: f64,
    /// Mean change of the error between the last two frames.
    pub flicker: f64,
    /// Frames after a jump until half of what it changed has arrived; `None`
    /// without a jump, or if that did not come.
    pub half_life: Option<u32>,
    /// Frame and error, where there is a reference.
    pub by_frame: Vec<(u32, f64)>,
}

/// A picture of a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct SequencePicture {
    /// Name of the scene.
    pub scene: String,
    /// Name of the signal, the event and what is shown.
    pub name: [String; 3],
    /// What one sees.
    pub caption: String,
    /// The file.
    pub png: Vec<u8>,
}

/// What [`measure`] gives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SequenceRun {
    /// One row a variant.
    pub results: Vec<SequenceResult>,
    /// In the order in which to show them.
    pub pictures: Vec<SequencePicture>,
}

/// A variant as it goes through the frames.
struct Track {
    variant: Variant,
    filter: Box<dyn Filter>,
    times: Vec<f64>,
    by_frame: Vec<(u32, f64)>,
    half_life: Option<u32>,
    /// The last two frames.
    shown: [Vec<Vec3>; 2],
    panels: Vec<Picture>,
}

/// References, each rendered once.
struct Truth<'a> {
    film: &'a Film<'a>,
    samples: u32,
    known: Vec<(Moment, Reference)>,
}

impl Truth<'_> {
    fn at(&mut self, moment: &Moment) -> Result<usize, StageError> {
        if let Some(i) = self.known.iter().position(|(m, _)| m == moment) {
            return Ok(i);
        }
        let reference = self.film.reference(moment, self.samples)?;
        self.known.push((*moment, reference));
        Ok(self.known.len() - 1)
    }

    fn image(&self, index: usize) -> &[Vec3] {
        &self.known[index].1.image
    }
}

/// Which variants have pictures.
fn is_shown(name: &str) -> bool {
    let shown = [
        "1 spp",
        "quarter ray",
        "average of 32 frames",
        "average of 32 frames, hit point",
        "SVGF, 1 passes",
        "SVGF, 3 passes",
        "SVGF, 5 passes",
        "SVGF, 3 passes, variance of the mean",
        "SVGF, 3 passes, clamped",
        "SVGF, 3 passes, blended",
        "SVGF, 3 passes, not reprojected",
    ];
    shown.contains(&name)
}

/// Renders a sequence of one signal on the CPU and filters it in every way.
///
/// `progress` is told each frame.
///
/// # Errors
/// If the settings are out of range.
pub fn measure(
    scene: &ReflectionScene<'_>,
    signal: Signal,
    event: Event,
    settings: &SequenceSettings,
    progress: &dyn Fn(&str),
) -> Result<SequenceRun, StageError> {
    let (width, height, frames) = (settings.width, settings.height, settings.frames);
    crate::stages::check_size(width, height)?;
    let size = UVec2::new(width, height);
    let room = &scene.scene.scene;
    let near = signal == Signal::Reflection || event == Event::Ball;
    let camera = if near { scene.views[0].1 } else { room.camera };
    let at = |frame| moment(event, camera, room, scene.back, frame, frames);
    let film = Film::new(scene, signal, size);
    let mut truth = Truth {
        film: &film,
        samples: settings.reference_samples,
        known: Vec::new(),
    };
    let moves = matches!(event, Event::Pan | Event::Dolly | Event::Turn | Event::Ball);
    let mut tracks: Vec<Track> = variants(signal, moves, settings.all)
        .into_iter()
        .map(|variant| Track {
            filter: if signal == Signal::Reflection || variant.as_color {
                Box::new(Denoiser::<3>::new(variant.recipe, size))
            } else {
                Box::new(Denoiser::<1>::new(variant.recipe, size))
            },
            variant,
            times: Vec::new(),
            by_frame: Vec::new(),
            half_life: None,
            shown: [Vec::new(), Vec::new()],
            panels: Vec::new(),
        })
        .collect();
    let jump = frames / 2;
    // The parts of the change that a jump makes.
    let change = if event.jumps() && frames > 1 {
        Some([truth.at(&at(0))?, truth.at(&at(frames - 1))?])
    } else {
        None
    };
    let mut chosen = vec![false; size.element_product() as usize];
    let mut prior = at(0);
    let mut last = None;
    for number in 0..frames {
        progress(&format!("frame {} of {frames}", number + 1));
        let now = at(number);
        let frame = film.frame(&now, &prior, number)?;
        // Something that moves has a reference at the end only.
        let still = now == prior && (number > 0 || at(1) == now) || event.jumps();
        let reference = if still || number + 2 >= frames {
            Some(truth.at(&now)?)
        } else {
            None
        };
        if event.jumps() {
            // What the light reached before counts too.
            for (c, n) in chosen.iter_mut().zip(&frame.chosen) {
                *c |= n;
            }
        } else {
            chosen.clone_from(&frame.chosen);
        }
        for track in &mut tracks {
            let (image, ms) = track.filter.step(&frame);
            let image: Vec<Vec3> = image
                .iter()
                .zip(&frame.albedo)
                .map(|(v, albedo)| *v * *albedo)
                .collect();
            track.times.push(ms);
            if let Some(reference) = reference {
                let (squared, _) = metrics::errors(&image, truth.image(reference), &chosen);
                track.by_frame.push((number, squared.sqrt()));
            }
            if let (Some([before, after]), None) = (change, track.half_life)
                && number >= jump
                && metrics::ghost(&image, truth.image(before), truth.image(after)) <= 0.5
            {
                track.half_life = Some(number - jump);
            }
            if is_shown(&track.variant.name) {
                track.panels.push(panel(size, &image, &frame));
            }
            track.shown = [std::mem::take(&mut track.shown[1]), image];
        }
        prior = now;
        last = Some((frame, reference));
    }
    let Some((frame, Some(reference))) = last else {
        return Ok(SequenceRun::default());
    };
    let before = truth.at(&at(frames.saturating_sub(2)))?;
    let mut out = SequenceRun::default();
    // Where the signal is the same everywhere there is nothing to filter: no
    // light gets to the balls, say.
    let mut values = (0..chosen.len())
        .filter(|i| chosen[*i])
        .map(|i| truth.image(reference)[i]);
    let first = values.next();
    if !event.jumps() && values.all(|v| Some(v) == first) {
        return Ok(out);
    }
    for track in &mut tracks {
        let image = &track.shown[1];
        let expected = truth.image(reference);
        let (squared, relative_mse) = metrics::errors(image, expected, &chosen);
        track.times.sort_by(f64::total_cmp);
        out.results.push(SequenceResult {
            scene: room.name.clone(),
            signal: signal.name().into(),
            event: event.name().into(),
            size: [width, height],
            variant: track.variant.name.clone(),
            piece: track.variant.piece.map(Into::into),
            recipe: (
                track.variant.recipe,
                signal == Signal::Reflection || track.variant.as_color,
            ),
            ms: track.times[track.times.len() / 2],
            rmse: squared.sqrt(),
            reference_rmse: truth.known[reference].1.error,
            relative_mse,
            psnr: -10.0 * squared.max(1e-12).log10(),
            ssim: metrics::similarity(size, image, expected),
            flip: metrics::flip(size, image, expected).0,
            flicker: if frames > 1 {
                metrics::flicker(
                    [&track.shown[0], image],
                    [truth.image(before), expected],
                    &chosen,
                )
            } else {
                0.0
            },
            half_life: track.half_life,
            by_frame: track.by_frame.clone(),
        });
    }
    pictures(
        &mut out,
        [signal.title(), signal.name(), event.name()],
        &tracks,
        (&frame, truth.image(reference)),
        &chosen,
        settings,
    )?;
    Ok(out)
}

fn shown(image: &[Vec3], frame: &Frame) -> Vec<Vec3> {
    image
        .iter()
        .zip(&frame.background)
        .map(|(v, b)| *v + *b)
        .collect()
}

/// The middle of a frame, as an animation shows it.
fn panel(size: UVec2, image: &[Vec3], frame: &Frame) -> Picture {
    let part = PANEL.min(size);
    Picture::of(size, &shown(image, frame)).part((size - part) / 2, part, 1)
}

/// The whole last frames; crops and maps of FLIP; an animation.
fn pictures(
    out: &mut SequenceRun,
    [title, signal, event]: [&str; 3],
    tracks: &[Track],
    (frame, reference): (&Frame, &[Vec3]),
    chosen: &[bool],
    settings: &SequenceSettings,
) -> Result<(), StageError> {
    let size = UVec2::new(settings.width, settings.height);
    let scene = out.results.first().map_or("", |r| &r.scene).to_owned();
    let mut add = |what: &str, caption: String, frames: &[Picture]| {
        out.pictures.push(SequencePicture {
            scene: scene.clone(),
            name: [signal.into(), event.into(), what.into()],
            caption,
            png: show::png(frames)?,
        });
        Ok::<_, StageError>(())
    };
    let chosen_tracks: Vec<&Track> = tracks.iter().filter(|t| !t.panels.is_empty()).collect();
    let Some(base) = chosen_tracks
        .iter()
        .find(|t| t.variant.name == format!("SVGF, {BASE} passes"))
    else {
        return Ok(());
    };
    let corner = show::worst(size, &base.shown[1], reference, chosen);
    let whole = Picture::of(size, &shown(reference, frame));
    let mut rows = [Vec::new(), Vec::new()];
    let mut names = Vec::new();
    for track in &chosen_tracks {
        let image = &track.shown[1];
        rows[0].push(Picture::of(size, &shown(image, frame)).crop(corner));
        let (_, rgb) = metrics::flip(size, image, reference);
        rows[1].push(Picture { size, rgb }.crop(corner));
        names.push(track.variant.name.as_str());
    }
    rows[0].push(whole.crop(corner));
    add(
        "crops",
        format!(
            "{title}, {event}: where SVGF errs most, in the last of {} frames, four times as large; from left to right {}, reference. Below it FLIP, from black (none) to white.",
            settings.frames,
            names.join(", "),
        ),
        &[show::sheet(&rows)],
    )?;
    let [first, third] = [chosen_tracks[0], base];
    let [noisy, filtered] = [first, third].map(|t| Picture::of(size, &shown(&t.shown[1], frame)));
    let (_, rgb) = metrics::flip(size, &third.shown[1], reference);
    let wrong = Picture { size, rgb };
    add(
        "frames",
        format!(
            "{title}, {event}: the last frame, {} and {}; below them the reference of {} samples a pixel, and FLIP of the filtered one.",
            first.variant.name, third.variant.name, settings.reference_samples
        ),
        &[show::sheet(&[vec![noisy, filtered], vec![whole, wrong]])],
    )?;
    let animation: Vec<Picture> = first
        .panels
        .iter()
        .zip(&third.panels)
        .map(|(a, b)| show::sheet(&[vec![a.clone(), b.clone()]]))
        .collect();
    add(
        "animation",
        format!(
            "{title}, {event}: {} frames, {} beside {}.",
            animation.len(),
            first.variant.name,
            third.variant.name,
        ),
        &animation,
    )
}
