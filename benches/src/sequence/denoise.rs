//! The ways in which a sequence is filtered: reprojection, accumulation, clamp
//! and SVGF, each piece of which can be left out.

use std::time::Instant;

use glam::{UVec2, Vec2, Vec3};
use half::f16;
use rayon::prelude::*;
use raytwin::filter::packed_visibility::packed_visibility_horizontal;
use raytwin::filter::svgf::{
    SvgfSample, SvgfSettings, svgf_variance_pixel, svgf_variance_scalar_pixel,
};
use raytwin::math::luminance::luminance;
use raytwin::pass::svgf::SvgfPass;
use raytwin::temporal::accumulate::{
    TemporalAccumulateState, temporal_accumulate_alpha, temporal_accumulate_history,
    temporal_accumulate_mean, temporal_accumulate_plain_moments,
    temporal_accumulate_plain_variance, temporal_accumulate_step,
};
use raytwin::temporal::reproject::{
    REPROJECT_TOLERANCE, ReprojectHistory, ReprojectSurface, ReprojectValue, reproject_bend,
    reproject_blend, reproject_color_distance, reproject_curvature, reproject_find,
    reproject_footprint, reproject_gather, reproject_reflection_motion, reproject_share,
};
use raytwin::temporal::variance_clamp::variance_clamp_pixel;
use raytwin::temporal::visibility_clamp::{VISIBILITY_CLAMP_GAMMA, visibility_clamp_rows_pixel};

use super::film::Frame;

/// Frames that an average over time remembers.
pub(super) const LONG: f32 = 32.0;

/// Where a pixel's history is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Where {
    /// At the same pixel.
    Here,
    /// Where the surface was.
    Surface,
    /// The same without tests for what was hidden.
    SurfaceUntested,
    /// Where what it reflects was.
    HitPoint,
    /// Both, weighed by how well they agree with the frame.
    Blend,
}

/// What a history is held to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clamp {
    /// Nothing.
    Off,
    /// Mean ± deviation of 5 × 5 pixels.
    Near,
    /// The mean of 17 × 17 rays ± half a deviation: of rays of one bit alone.
    Wide,
}

/// A way to filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Where the history is; `None`: there is none.
    pub history: Option<Where>,
    /// Most frames in it.
    pub cap: f32,
    /// What it is held to.
    pub clamp: Clamp,
    /// Whether the variance comes from plain moments, `E[x²] - E[x]²`.
    pub plain: bool,
    /// Whether the passes are guided by the variance of the mean over time
    /// rather than, as in the paper, that of a sample.
    pub of_mean: bool,
    /// Whether the history is kept in `f16`.
    pub half: bool,
    /// Passes of SVGF.
    pub passes: u32,
    /// Whether the first of them is fed back.
    pub feedback: bool,
    /// Whether they leave out the tiles that they cannot change.
    pub tiles: bool,
}

impl Recipe {
    /// Nothing.
    pub const NONE: Self = Self {
        history: None,
        cap: 1.0,
        clamp: Clamp::Off,
        plain: false,
        of_mean: false,
        half: false,
        passes: 0,
        feedback: false,
        tiles: false,
    };
    /// An average over frames.
    pub const AVERAGE: Self = Self {
        history: Some(Where::Surface),
        cap: LONG,
        ..Self::NONE
    };
    /// SVGF as in the paper, with some of its passes.
    #[must_use]
    pub fn svgf(passes: u32) -> Self {
        Self {
            cap: 1.0 / SvgfSettings::PAPER.alpha,
            passes,
            feedback: true,
            ..Self::AVERAGE
        }
    }

    fn settings(&self) -> SvgfSettings {
        SvgfSettings {
            passes: self.passes,
            ..SvgfSettings::PAPER
        }
    }
}

/// What is known of a pixel from the frames before.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Texel<const C: usize> {
    /// The value over time, filtered by the first pass if that is fed back.
    value: [f32; C],
    /// Moments of what was traced. The filtered history may not be among them:
    /// what the filter blurs would count as noise, and be blurred more.
    mean: f32,
    variance: f32,
}

impl<const C: usize> Texel<C> {
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self {
            value: std::array::from_fn(|c| f(self.value[c], other.value[c])),
            mean: f(self.mean, other.mean),
            variance: f(self.variance, other.variance),
        }
    }
}

impl<const C: usize> ReprojectValue for Texel<C> {
    const NOTHING: Self = Self {
        value: [0.0; C],
        mean: 0.0,
        variance: 0.0,
    };
    fn times(self, weight: f32) -> Self {
        self.zip(self, |a, _| a * weight)
    }
    fn plus(self, other: Self, weight: f32) -> Self {
        self.zip(other, |a, b| a + b * weight)
    }
    fn over(self, weight: f32) -> Self {
        self.zip(self, |a, _| a / weight)
    }
    fn least(self, other: Self) -> Self {
        self.zip(other, f32::min)
    }
    fn most(self, other: Self) -> Self {
        self.zip(other, f32::max)
    }
}

fn color<const C: usize>(value: [f32; C]) -> Vec3 {
    if C == 1 {
        Vec3::splat(value[0])
    } else {
        Vec3::new(value[0], value[1 % C], value[2 % C])
    }
}

fn channels<const C: usize>(color: Vec3) -> [f32; C] {
    std::array::from_fn(|c| color[c])
}

/// What is compared: brightness.
fn light<const C: usize>(value: [f32; C]) -> f32 {
    if C == 1 {
        value[0]
    } else {
        luminance(color(value))
    }
}

/// Something that takes frames and gives filtered ones.
pub(super) trait Filter {
    /// The filtered frame, and milliseconds.
    fn step(&mut self, frame: &Frame) -> (Vec<Vec3>, f64);
}

/// The image over time of one recipe.
pub(super) struct Denoiser<const C: usize> {
    recipe: Recipe,
    size: UVec2,
    texels: Vec<Texel<C>>,
    lengths: Vec<f32>,
    /// What the frame before saw.
    priors: Vec<ReprojectSurface>,
    pass: SvgfPass<C>,
}

/// Mean and deviation of 5 × 5 pixels.
fn neighbourhood(noisy: &[Vec3], at: UVec2, size: UVec2) -> (Vec3, Vec3) {
    let low = at.saturating_sub(UVec2::splat(2));
    let high = (at + 2).min(size - 1);
    let taps = || {
        (low.y..=high.y)
            .flat_map(move |y| (low.x..=high.x).map(move |x| noisy[(y * size.x + x) as usize]))
    };
    let count = ((high - low) + 1).element_product() as f32;
    let mean = taps().sum::<Vec3>() / count;
    let square = taps().map(|v| (v - mean) * (v - mean)).sum::<Vec3>() / count;
    (mean, square.map(f32::sqrt))
}

impl<const C: usize> Denoiser<C> {
    pub fn new(recipe: Recipe, size: UVec2) -> Self {
        let pixels = size.element_product() as usize;
        Self {
            recipe,
            size,
            texels: vec![Texel::NOTHING; pixels],
            lengths: vec![0.0; pixels],
            priors: Vec::new(),
            pass: SvgfPass::new(size, recipe.settings()),
        }
    }

    /// The history of a pixel.
    fn history(&self, frame: &Frame, place: Where, at: UVec2) -> ReprojectHistory<Texel<C>> {
        let size = self.size;
        let index = |at: UVec2| (at.y * size.x + at.x) as usize;
        let i = index(at);
        let read = |at: UVec2| ReprojectHistory {
            value: self.texels[index(at)],
            length: self.lengths[index(at)],
        };
        if place == Where::Here || self.priors.is_empty() {
            return read(at);
        }
        if place == Where::SurfaceUntested {
            return reproject_gather(reproject_footprint(at, size, frame.motion[i]), read);
        }
        let surface = |at: UVec2| frame.surfaces[index(at)];
        let expected = frame.expected[i];
        let at_motion = |motion: Vec2| {
            // The meshes are flat, the balls are not.
            let mut curvature = 0.0;
            if expected.mesh != 0 && motion != Vec2::ZERO {
                let bend = reproject_bend(at, size, motion, surface);
                curvature = reproject_curvature(bend.along, bend.turn);
            }
            let taps = reproject_find(
                at,
                size,
                motion,
                expected,
                curvature,
                REPROJECT_TOLERANCE,
                |at| self.priors[index(at)],
            );
            reproject_gather(taps, read)
        };
        let reflected = || {
            at_motion(reproject_reflection_motion(
                at,
                size,
                frame.distance[i],
                frame.camera,
                frame.prior_camera,
                surface,
            ))
        };
        match place {
            Where::HitPoint => reflected(),
            Where::Blend => {
                let first = at_motion(frame.motion[i]);
                let second = reflected();
                let (mean, deviation) = neighbourhood(&frame.noisy, at, size);
                let distance = |h: &ReprojectHistory<Texel<C>>| {
                    reproject_color_distance(color(h.value.value), mean, deviation)
                };
                let share = reproject_share(distance(&first), distance(&second));
                reproject_blend(first, second, share)
            }
            _ => at_motion(frame.motion[i]),
        }
    }

    /// A pixel's new state and length.
    fn accumulate(&self, frame: &Frame, rays: &Rays, at: UVec2) -> (Texel<C>, f32) {
        let recipe = &self.recipe;
        let sample = channels::<C>(frame.noisy[(at.y * self.size.x + at.x) as usize]);
        let mut known = match recipe.history {
            Some(place) => self.history(frame, place, at),
            None => ReprojectHistory {
                value: Texel::NOTHING,
                length: 0.0,
            },
        };
        if known.length > 0.0 {
            let kept = known.value.value;
            known.value.value = match recipe.clamp {
                Clamp::Off => kept,
                Clamp::Near => {
                    let read = |at: UVec2| frame.noisy[(at.y * self.size.x + at.x) as usize];
                    let kept = color(kept);
                    channels(variance_clamp_pixel(at, self.size, 2, kept, 1.0, 0, read))
                }
                Clamp::Wide => kept.map(|kept| {
                    let gamma = VISIBILITY_CLAMP_GAMMA;
                    visibility_clamp_rows_pixel(at, self.size, kept, gamma, |at| rays.row(at))
                }),
            };
        }
        let now = light(sample);
        let (mean, variance, length) = if recipe.plain {
            let length = temporal_accumulate_history(known.length, recipe.cap);
            let alpha = temporal_accumulate_alpha(length, recipe.cap);
            let moments = Vec2::new(known.value.mean, known.value.variance);
            let moments = temporal_accumulate_plain_moments(moments, now, alpha);
            (moments.x, moments.y, length)
        } else {
            let state = TemporalAccumulateState {
                mean: known.value.mean,
                variance: known.value.variance,
                history: known.length,
            };
            let state = temporal_accumulate_step(state, now, recipe.cap);
            (state.mean, state.variance, state.history)
        };
        let alpha = temporal_accumulate_alpha(length, recipe.cap);
        let value = std::array::from_fn(|c| {
            temporal_accumulate_mean(known.value.value[c], sample[c], alpha)
        });
        let texel = Texel {
            value,
            mean,
            variance,
        };
        (self.stored(texel), length)
    }

    fn stored(&self, texel: Texel<C>) -> Texel<C> {
        if self.recipe.half {
            texel.zip(texel, |a, _| f16::from_f32(a).to_f32())
        } else {
            texel
        }
    }

    /// The variance that guides the passes.
    fn variance(&self, frame: &Frame, at: UVec2) -> f32 {
        let size = self.size;
        let index = |at: UVec2| (at.y * size.x + at.x) as usize;
        let read = |at: UVec2| {
            let t = self.texels[index(at)];
            let variance = if self.recipe.plain {
                temporal_accumulate_plain_variance(Vec2::new(t.mean, t.variance))
            } else {
                t.variance
            };
            (t.value, variance)
        };
        let surface = |at: UVec2| frame.filter[index(at)];
        let (length, settings) = (self.lengths[index(at)], self.recipe.settings());
        let variance = if C == 1 {
            svgf_variance_scalar_pixel(at, size, length, settings, surface, |at| {
                let (value, variance) = read(at);
                SvgfSample {
                    value: value[0],
                    variance,
                }
            })
        } else {
            svgf_variance_pixel(at, size, length, settings, surface, |at| {
                let (value, variance) = read(at);
                SvgfSample {
                    value: color(value),
                    variance,
                }
            })
        };
        if self.recipe.of_mean {
            variance / length.max(1.0)
        } else {
            variance
        }
    }
}

/// How many rays of each row of 17 reached the light.
struct Rays {
    width: u32,
    rows: Vec<u32>,
}

impl Rays {
    /// Of a recipe that does not look at them: none.
    fn new(recipe: &Recipe, noisy: &[Vec3], size: UVec2) -> Self {
        let width = size.x;
        if recipe.clamp != Clamp::Wide {
            let rows = Vec::new();
            return Self { width, rows };
        }
        let across = size.x.div_ceil(8);
        let words: Vec<u32> = (0..across * size.y.div_ceil(4))
            .map(|i| {
                let corner = UVec2::new(8 * (i % across), 4 * (i / across));
                (0..32).fold(0, |word, lane| {
                    let at = corner + UVec2::new(lane % 8, lane / 8);
                    let lit = at.cmplt(size).all() && noisy[(at.y * width + at.x) as usize].x > 0.0;
                    word | u32::from(lit) << lane
                })
            })
            .collect();
        let read = |block: UVec2| words[(block.y * across + block.x) as usize];
        let rows = (0..size.element_product())
            .map(|i| packed_visibility_horizontal(UVec2::new(i % width, i / width), size, read))
            .collect();
        Self { width, rows }
    }

    fn row(&self, at: UVec2) -> u32 {
        self.rows[(at.y * self.width + at.x) as usize]
    }
}

impl<const C: usize> Filter for Denoiser<C> {
    fn step(&mut self, frame: &Frame) -> (Vec<Vec3>, f64) {
        if self.recipe.history.is_none() && self.recipe.passes == 0 {
            return (frame.noisy.clone(), 0.0);
        }
        let start = Instant::now();
        let size = self.size;
        let at = |i: usize| UVec2::new(i as u32 % size.x, i as u32 / size.x);
        let rays = Rays::new(&self.recipe, &frame.noisy, size);
        (self.texels, self.lengths) = (0..self.texels.len())
            .into_par_iter()
            .with_min_len(64)
            .map(|i| self.accumulate(frame, &rays, at(i)))
            .unzip();
        let mut out: Vec<Vec3> = Vec::with_capacity(self.texels.len());
        if self.recipe.passes == 0 {
            out.extend(self.texels.iter().map(|t| color(t.value)));
        } else {
            let mut pass = std::mem::replace(
                &mut self.pass,
                SvgfPass::new(UVec2::ZERO, self.recipe.settings()),
            );
            pass.set_surfaces(|at| frame.filter[(at.y * size.x + at.x) as usize]);
            pass.set_image(|at| {
                let value = self.texels[(at.y * size.x + at.x) as usize].value;
                (value, self.variance(frame, at))
            });
            let mut fed = Vec::new();
            let feed = |image: &SvgfPass<C>| {
                for y in 0..size.y {
                    let rows: [&[f32]; C] = std::array::from_fn(|c| image.row(y, c));
                    fed.extend((0..size.x as usize).map(|x| rows.map(|row| row[x])));
                }
            };
            if self.recipe.tiles {
                pass.filter_tiles(feed);
            } else {
                pass.filter(feed);
            }
            for y in 0..size.y {
                let rows: [&[f32]; C] = std::array::from_fn(|c| pass.row(y, c));
                out.extend((0..size.x as usize).map(|x| color(rows.map(|row| row[x]))));
            }
            self.pass = pass;
            if self.recipe.feedback {
                for (i, value) in fed.into_iter().enumerate() {
                    self.texels[i] = self.stored(Texel {
                        value,
                        ..self.texels[i]
                    });
                }
            }
        }
        let ms = start.elapsed().as_secs_f64() * 1e3;
        self.priors.clone_from(&frame.surfaces);
        (out, ms)
    }
}
