//! The multiscale mean estimator over time: what it answers to signals that
//! move, beside plain averages and the best window in hindsight; how quiet it
//! is against how fast; what it costs.

use std::collections::BTreeMap;
use std::hint::black_box;

use glam::{UVec4, Vec3};
use raytwin::contract::Kernel;
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_cpu::temporal::accumulate::temporal_accumulate_mean;
use raytwin_cpu::temporal::multiscale_mean::*;
use raytwin_tests::gpu::{Build, Gpu, Program};

use super::error::ReportError;
use super::kernels::median;
use super::materials::{ELEMENTS, in_turns};
use super::schema::{EstimatorCostRow, EstimatorPointRow, EstimatorRow, finite};

/// How much is measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct EstimatorSettings {
    /// Runs behind each response.
    pub runs: u32,
    /// Frames behind a residual variance.
    pub frames: u32,
}

impl EstimatorSettings {
    pub fn quick() -> Self {
        Self {
            runs: 256,
            frames: 300_000,
        }
    }

    pub fn full() -> Self {
        Self {
            runs: 2048,
            frames: 3_000_000,
        }
    }
}

/// An estimator with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Printed { short_blend: f32 },
    Robust { short_blend: f32, longest: f32 },
    Packed,
    Running,
    Exponential(f32),
}

const PRINTED: Kind = Kind::Printed {
    short_blend: MULTISCALE_MEAN_SHORT_BLEND,
};

const ROBUST: Kind = Kind::Robust {
    short_blend: MULTISCALE_MEAN_SHORT_BLEND,
    longest: MULTISCALE_MEAN_LONGEST,
};

/// Weights of the plain averages.
const WEIGHTS: [u32; 6] = [8, 16, 32, 64, 128, 256];

impl Kind {
    fn name(self) -> String {
        match self {
            Self::Printed { .. } => "printed".into(),
            Self::Robust { .. } => "robust".into(),
            Self::Packed => "robust, packed".into(),
            Self::Running => "running mean".into(),
            Self::Exponential(weight) => format!("average, 1/{}", 1.0 / weight),
        }
    }
}

/// The best window in hindsight, in the rows.
const HINDSIGHT: &str = "best window in hindsight";

struct Estimator {
    kind: Kind,
    printed: MultiscaleMeanState,
    robust: MultiscaleMeanRobustState,
    packed: UVec4,
    mean: f32,
    frames: f32,
}

impl Estimator {
    fn new(kind: Kind) -> Self {
        Self {
            kind,
            printed: MULTISCALE_MEAN_EMPTY,
            robust: MULTISCALE_MEAN_ROBUST_EMPTY,
            packed: UVec4::ZERO,
            mean: 0.0,
            frames: 0.0,
        }
    }

    fn answer(&mut self, sample: f32) -> f32 {
        match self.kind {
            Kind::Printed { short_blend } => {
                self.printed = multiscale_mean_step(self.printed, sample, short_blend);
                self.printed.mean
            }
            Kind::Robust {
                short_blend,
                longest,
            } => {
                self.robust =
                    multiscale_mean_robust_step(self.robust, sample, short_blend, longest);
                multiscale_mean_robust_value(self.robust)
            }
            Kind::Packed => {
                let state = multiscale_mean_robust_step(
                    multiscale_mean_robust_unpack(self.packed),
                    sample,
                    MULTISCALE_MEAN_SHORT_BLEND,
                    MULTISCALE_MEAN_LONGEST,
                );
                self.packed = multiscale_mean_robust_pack(state);
                multiscale_mean_robust_value(state)
            }
            Kind::Running | Kind::Exponential(_) => {
                self.frames += 1.0;
                let least = match self.kind {
                    Kind::Exponential(weight) => weight,
                    _ => 0.0,
                };
                // The first sample is the first answer of every average.
                let weight = if self.frames > 1.0 && least > 0.0 {
                    least
                } else {
                    1.0 / self.frames
                };
                self.mean = temporal_accumulate_mean(self.mean, sample, weight);
                self.mean
            }
        }
    }
}

/// Random numbers, one after the other.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        pcg_unit(pcg_hash(self.0))
    }

    /// Uniform from -1 to 1.
    fn signed(&mut self) -> f32 {
        2.0 * self.next() - 1.0
    }
}

/// A level over time, and noise about it. The signal moves at frame 0.
struct Signal {
    name: &'static str,
    level: fn(i32) -> f32,
    sample: fn(f32, i32, &mut Numbers) -> f32,
    /// The frame from which a step is measured, with its ends.
    step: Option<(f32, f32)>,
    /// Whether the plot shows the answer; else its error.
    shows_answer: bool,
}

fn half_noise(level: f32, _: i32, numbers: &mut Numbers) -> f32 {
    level * (1.0 + 0.5 * numbers.signed())
}

const SIGNALS: [Signal; 7] = [
    Signal {
        name: "step up, 1 to 4",
        level: |frame| if frame < 0 { 1.0 } else { 4.0 },
        sample: half_noise,
        step: Some((1.0, 4.0)),
        shows_answer: true,
    },
    Signal {
        name: "step down, 4 to 1",
        level: |frame| if frame < 0 { 4.0 } else { 1.0 },
        sample: half_noise,
        step: Some((4.0, 1.0)),
        shows_answer: true,
    },
    Signal {
        name: "ramp, 1 to 4 in 256 frames",
        level: |frame| 1.0 + 3.0 * (frame.clamp(0, 256) as f32 / 256.0),
        sample: half_noise,
        step: None,
        shows_answer: true,
    },
    Signal {
        name: "pulse, 1 to 4 for 32 frames",
        level: |frame| if (0..32).contains(&frame) { 4.0 } else { 1.0 },
        sample: half_noise,
        step: None,
        shows_answer: true,
    },
    Signal {
        name: "noise, 10 % to 100 % for 256 frames",
        level: |_| 1.0,
        sample: |level, frame, numbers| {
            let noise = if (0..256).contains(&frame) { 1.0 } else { 0.1 };
            level * (1.0 + noise * numbers.signed())
        },
        step: None,
        shows_answer: false,
    },
    Signal {
        name: "hits of 1 frame in 10",
        level: |_| 1.0,
        sample: |level, _, numbers| {
            if numbers.next() < 0.1 {
                10.0 * level
            } else {
                0.0
            }
        },
        step: None,
        shows_answer: false,
    },
    Signal {
        name: "hits of 1 frame in 100",
        level: |_| 1.0,
        sample: |level, _, numbers| {
            if numbers.next() < 0.01 {
                100.0 * level
            } else {
                0.0
            }
        },
        step: None,
        shows_answer: false,
    },
];

/// Frames before the signal moves, and after.
const BEFORE: i32 = 1024;
const AFTER: usize = 512;

/// Frames after the move that the rows hold, counted from 1.
const SHOWN: [usize; 19] = [
    1, 2, 3, 4, 6, 8, 11, 16, 23, 32, 45, 64, 90, 128, 181, 256, 300, 362, 512,
];

/// Lengths of windows that hindsight chooses from.
const WINDOWS: [usize; 20] = [
    1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024,
];

/// Sums over runs of answers and of squared errors, a frame each.
struct Sums {
    answer: Vec<f64>,
    square: Vec<f64>,
}

impl Sums {
    fn new() -> Self {
        Self {
            answer: vec![0.0; AFTER],
            square: vec![0.0; AFTER],
        }
    }

    fn add(&mut self, frame: usize, answer: f64, level: f64) {
        self.answer[frame] += answer;
        self.square[frame] += (answer - level).powi(2);
    }

    fn row(&self, signal: &Signal, estimator: String, runs: u32) -> EstimatorRow {
        let runs = f64::from(runs);
        let levels = (0..AFTER as i32).map(|f| f64::from((signal.level)(f)));
        let mean: Vec<f64> = self.answer.iter().map(|s| s / runs).collect();
        let reached = |part: f64| {
            let (from, to) = signal.step?;
            let (from, to) = (f64::from(from), f64::from(to));
            crossing(mean.iter().map(|m| (m - from) / (to - from)), part)
        };
        let at = |values: &dyn Fn(usize) -> f64| SHOWN.iter().map(|f| values(f - 1)).collect();
        EstimatorRow {
            signal: signal.name.into(),
            estimator,
            rmse: (self.square.iter().sum::<f64>() / (runs * AFTER as f64)).sqrt(),
            bias: self.answer.iter().sum::<f64>() / runs / levels.sum::<f64>(),
            half_life: reached(0.5),
            ninety: reached(0.9),
            shows_answer: signal.shows_answer,
            frames: SHOWN.iter().map(|f| *f as u32).collect(),
            answer_by_frame: at(&|f| mean[f]),
            rmse_by_frame: at(&|f| (self.square[f] / runs).sqrt()),
        }
    }
}

/// Frames until `done` has passed `part`, interpolated.
fn crossing(done: impl Iterator<Item = f64>, part: f64) -> Option<f64> {
    let mut before = 0.0;
    for (frame, now) in done.enumerate() {
        if now >= part {
            return Some(frame as f64 + (part - before) / (now - before));
        }
        before = now;
    }
    None
}

/// What every estimator answers to every signal.
pub(super) fn responses(settings: &EstimatorSettings) -> Vec<EstimatorRow> {
    let mut kinds = vec![PRINTED, ROBUST, Kind::Packed, Kind::Running];
    kinds.extend(WEIGHTS.map(|w| Kind::Exponential(1.0 / w as f32)));
    let mut rows = Vec::new();
    for signal in &SIGNALS {
        let mut sums: Vec<Sums> = kinds.iter().map(|_| Sums::new()).collect();
        let mut windows: Vec<Sums> = WINDOWS.iter().map(|_| Sums::new()).collect();
        for run in 0..settings.runs {
            let mut numbers = Numbers(pcg_hash(run));
            let frames = -BEFORE..AFTER as i32;
            let samples: Vec<f32> = frames
                .clone()
                .map(|f| (signal.sample)((signal.level)(f), f, &mut numbers))
                .collect();
            let mut total = vec![0.0];
            for sample in &samples {
                total.push(total[total.len() - 1] + f64::from(*sample));
            }
            for (kind, sums) in kinds.iter().zip(&mut sums) {
                let mut estimator = Estimator::new(*kind);
                for (frame, sample) in frames.clone().zip(&samples) {
                    let answer = estimator.answer(*sample);
                    if let Ok(after) = usize::try_from(frame) {
                        sums.add(after, answer.into(), (signal.level)(frame).into());
                    }
                }
            }
            for (length, sums) in WINDOWS.iter().zip(&mut windows) {
                for after in 0..AFTER {
                    let end = BEFORE as usize + after + 1;
                    let mean = (total[end] - total[end - length]) / *length as f64;
                    sums.add(after, mean, (signal.level)(after as i32).into());
                }
            }
        }
        // The window with the least squared error over all runs, frame by frame.
        let mut best = Sums::new();
        for after in 0..AFTER {
            let chosen = windows
                .iter()
                .min_by(|a, b| a.square[after].total_cmp(&b.square[after]));
            if let Some(window) = chosen {
                best.answer[after] = window.answer[after];
                best.square[after] = window.square[after];
            }
        }
        for (kind, sums) in kinds.iter().zip(&sums) {
            rows.push(sums.row(signal, kind.name(), settings.runs));
        }
        rows.push(best.row(signal, HINDSIGHT.into(), settings.runs));
    }
    rows
}

// --------------------------------------------------- quiet against fast

/// Noise of mean 1.
struct Noise {
    name: &'static str,
    draw: fn(&mut Numbers) -> f32,
}

const NOISES: [Noise; 4] = [
    Noise {
        name: "uniform, 50 %",
        draw: |numbers| 1.0 + 0.5 * numbers.signed(),
    },
    Noise {
        name: "exponential",
        draw: |numbers| -(1.0 - numbers.next()).ln(),
    },
    Noise {
        name: "hits of 1 in 2",
        draw: |numbers| if numbers.next() < 0.5 { 2.0 } else { 0.0 },
    },
    Noise {
        name: "hits of 1 in 10",
        draw: |numbers| if numbers.next() < 0.1 { 10.0 } else { 0.0 },
    },
];

const STEPS: [(f32, f32); 4] = [(1.0, 2.0), (1.0, 10.0), (1.0, 0.5), (1.0, 0.1)];

/// Settings on the plot: the name of the line, the setting, the estimator.
fn settings_shown() -> Vec<(&'static str, String, Kind)> {
    let mut out = Vec::new();
    for short_blend in [0.02, 0.04, 0.08, 0.16, 0.32] {
        out.push((
            "printed, by short blend",
            short_blend.to_string(),
            Kind::Printed { short_blend },
        ));
    }
    let memories = [
        (
            "robust, memory 256, by short blend",
            MULTISCALE_MEAN_LONGEST,
        ),
        ("robust, memory 1024, by short blend", 1024.0),
    ];
    for (line, longest) in memories {
        for short_blend in [0.02, 0.04, 0.08, 0.16, 0.32] {
            let kind = Kind::Robust {
                short_blend,
                longest,
            };
            out.push((line, short_blend.to_string(), kind));
        }
    }
    for weight in [4, 8, 16, 32, 64, 128, 256, 512] {
        out.push((
            "exponential average, by weight",
            format!("1/{weight}"),
            Kind::Exponential(1.0 / weight as f32),
        ));
    }
    out
}

/// Variance of the answers to a still signal over that of its samples, and
/// their mean.
fn residual(kind: Kind, noise: &Noise, frames: u32) -> (f64, f64) {
    let mut numbers = Numbers(77);
    let mut estimator = Estimator::new(kind);
    for _ in 0..10_000 {
        estimator.answer((noise.draw)(&mut numbers));
    }
    let (mut sum, mut square, mut samples) = (0.0, 0.0, 0.0);
    for _ in 0..frames {
        let sample = (noise.draw)(&mut numbers);
        let answer = f64::from(estimator.answer(sample)) - 1.0;
        sum += answer;
        square += answer * answer;
        samples += f64::from(sample - 1.0).powi(2);
    }
    let mean = sum / f64::from(frames);
    (
        (square / f64::from(frames) - mean * mean) / (samples / f64::from(frames)),
        1.0 + mean,
    )
}

/// Frames until half of a step has arrived, in the mean over runs.
fn half_life(kind: Kind, noise: &Noise, (from, to): (f32, f32), runs: u32) -> Option<f64> {
    const LONG: usize = 2048;
    let mut sums = vec![0.0; LONG];
    for run in 0..runs {
        let mut numbers = Numbers(pcg_hash(run ^ 0x5bd1));
        let mut estimator = Estimator::new(kind);
        for _ in 0..1500 {
            estimator.answer(from * (noise.draw)(&mut numbers));
        }
        let start = estimator.answer(from * (noise.draw)(&mut numbers));
        for sum in &mut sums {
            let answer = estimator.answer(to * (noise.draw)(&mut numbers));
            *sum += f64::from(answer - start);
        }
    }
    let whole = f64::from(to - from) * f64::from(runs);
    crossing(sums.iter().map(|s| s / whole), 0.5)
}

/// Residual variance and half-life of every setting, noise and step.
pub(super) fn points(settings: &EstimatorSettings) -> Vec<EstimatorPointRow> {
    let mut rows = Vec::new();
    for noise in &NOISES {
        for (line, setting, kind) in settings_shown() {
            let (residual, mean) = residual(kind, noise, settings.frames);
            for step in STEPS {
                let frames = half_life(kind, noise, step, settings.runs / 4);
                // What an exponential average of that half-life leaves.
                let frontier = frames.map(|frames| {
                    let weight = 1.0 - 0.5f64.powf(1.0 / frames);
                    weight / (2.0 - weight)
                });
                rows.push(EstimatorPointRow {
                    estimator: line.into(),
                    setting: setting.clone(),
                    noise: noise.name.into(),
                    from: step.0,
                    to: step.1,
                    half_life: frames,
                    residual,
                    mean,
                    to_frontier: frontier.and_then(|f| finite(residual / f)),
                });
            }
        }
    }
    rows
}

// ------------------------------------------------------------------ cost

/// A frame over arrays, the loop that a user has.
#[inline(never)]
fn frame<S: Copy, Y: Copy>(states: &mut [S], samples: &[Y], step: impl Fn(S, Y) -> S) {
    for (state, sample) in states.iter_mut().zip(samples) {
        *state = step(*state, *sample);
    }
    black_box(states);
}

/// Largest and root-mean-square difference of packed and whole states' answers
/// to the signals that move, over the peak of the answer so far.
fn packed_error(runs: u32) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for signal in SIGNALS.iter().filter(|s| s.shows_answer) {
        for run in 0..runs {
            let mut numbers = Numbers(pcg_hash(run ^ 0x77));
            let [mut whole, mut packed] = [ROBUST, Kind::Packed].map(Estimator::new);
            for f in -BEFORE..AFTER as i32 {
                let level = (signal.level)(f);
                let sample = (signal.sample)(level, f, &mut numbers);
                let (a, b) = (whole.answer(sample), packed.answer(sample));
                square += f64::from((a - b) / level).powi(2);
                count += 1.0;
            }
        }
    }
    (square / count).sqrt()
}

/// WGSL that steps and goes through the packed form.
const THROUGH_PACKED: &str = "
fn baseline(
    state: MultiscaleMeanRobustRgbState, sample: vec3f, short_blend: f32, longest: f32,
) -> MultiscaleMeanRobustRgbState {
    let kept = multiscale_mean_robust_rgb_unpack(multiscale_mean_robust_rgb_pack(state));
    return multiscale_mean_robust_rgb_step(kept, sample, short_blend, longest);
}";
const THROUGH_PACKED_SCALAR: &str = "
fn baseline(
    state: MultiscaleMeanRobustState, sample: f32, short_blend: f32, longest: f32,
) -> MultiscaleMeanRobustState {
    let kept = multiscale_mean_robust_unpack(multiscale_mean_robust_pack(state));
    return multiscale_mean_robust_step(kept, sample, short_blend, longest);
}";

/// Nanoseconds of a frame and bytes of a state.
pub(super) fn costs(
    kernels: &[Kernel],
    settings: &EstimatorSettings,
    runs: usize,
    with_cpu: bool,
    gpus: &[&Gpu],
) -> Result<Vec<EstimatorCostRow>, ReportError> {
    const A: f32 = MULTISCALE_MEAN_SHORT_BLEND;
    const L: f32 = MULTISCALE_MEAN_LONGEST;
    let mut numbers = Numbers(5);
    let gray: Vec<f32> = (0..ELEMENTS).map(|_| 0.5 + numbers.next()).collect();
    let colors: Vec<Vec3> = (0..ELEMENTS)
        .map(|_| Vec3::new(numbers.next(), numbers.next(), numbers.next()))
        .collect();
    let mut printed = vec![MULTISCALE_MEAN_EMPTY; ELEMENTS];
    let mut printed_rgb = vec![MULTISCALE_MEAN_RGB_EMPTY; ELEMENTS];
    let mut robust = vec![MULTISCALE_MEAN_ROBUST_EMPTY; ELEMENTS];
    let mut robust_rgb = vec![MULTISCALE_MEAN_ROBUST_RGB_EMPTY; ELEMENTS];
    let mut packed = vec![UVec4::ZERO; ELEMENTS];
    let mut packed_rgb = vec![MultiscaleMeanRobustRgbPacked::default(); ELEMENTS];
    let mut mean = vec![0.0f32; ELEMENTS];
    let ns = if with_cpu {
        in_turns(
            16 * runs,
            &mut [
                &mut || {
                    frame(&mut mean, &gray, |m, y| {
                        temporal_accumulate_mean(m, y, 0.03125)
                    })
                },
                &mut || frame(&mut printed, &gray, |s, y| multiscale_mean_step(s, y, A)),
                &mut || {
                    frame(&mut robust, &gray, |s, y| {
                        multiscale_mean_robust_step(s, y, A, L)
                    });
                },
                &mut || {
                    frame(&mut packed, &gray, |s, y| {
                        let s = multiscale_mean_robust_unpack(s);
                        multiscale_mean_robust_pack(multiscale_mean_robust_step(s, y, A, L))
                    });
                },
                &mut || {
                    frame(&mut printed_rgb, &colors, |s, y| {
                        multiscale_mean_rgb_step(s, y, A)
                    });
                },
                &mut || {
                    frame(&mut robust_rgb, &colors, |s, y| {
                        multiscale_mean_robust_rgb_step(s, y, A, L)
                    });
                },
                &mut || {
                    frame(&mut packed_rgb, &colors, |s, y| {
                        let s = multiscale_mean_robust_rgb_unpack(s);
                        let s = multiscale_mean_robust_rgb_step(s, y, A, L);
                        multiscale_mean_robust_rgb_pack(s)
                    });
                },
            ],
        )
    } else {
        vec![f64::NAN; 7]
    };
    let error = with_cpu.then(|| packed_error(settings.runs / 8));
    // Name, bytes, the kernel, and whether its state is packed in between.
    type Entry = (&'static str, usize, &'static str, Option<&'static str>);
    let entries: [Entry; 7] = [
        ("exponential average", 4, "temporal_accumulate_mean", None),
        ("printed", 20, "multiscale_mean_step", None),
        ("robust", 28, "multiscale_mean_robust_step", None),
        (
            "robust, packed",
            16,
            "multiscale_mean_robust_step",
            Some(THROUGH_PACKED_SCALAR),
        ),
        ("printed, colour", 44, "multiscale_mean_rgb_step", None),
        (
            "robust, colour",
            60,
            "multiscale_mean_robust_rgb_step",
            None,
        ),
        (
            "robust, colour, packed",
            40,
            "multiscale_mean_robust_rgb_step",
            Some(THROUGH_PACKED),
        ),
    ];
    let mut rows = Vec::new();
    for ((name, bytes, kernel, through), ns) in entries.into_iter().zip(ns) {
        let mut gpu_ns = BTreeMap::new();
        if let Some(kernel) = kernels.iter().find(|k| k.name == kernel) {
            let input = kernel.draw_many(1 << 16, 80);
            for gpu in gpus {
                let program = match through {
                    None => Program::new(gpu, kernel, Build::Plain)?,
                    Some(source) => {
                        Program::with_function(gpu, kernel, Build::Plain, "baseline", source)?
                    }
                };
                let mut times: Vec<f64> = (0..5).map(|_| program.time(&input, 1)).collect();
                gpu_ns.insert(gpu.label(), finite(median(&mut times)));
            }
        }
        rows.push(EstimatorCostRow {
            estimator: name.into(),
            bytes,
            cpu_ns: finite(ns),
            gpu_ns,
            packed_error: error.filter(|_| through.is_some()),
        });
    }
    Ok(rows)
}
