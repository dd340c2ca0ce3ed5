//! The kernel table: speed, error, parity and hard cases from the registry.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Instant;

use rayon::prelude::*;
use raytwin::contract::{Kernel, Scalar};
use raytwin_cpu::random::pcg::pcg_hash;
use raytwin_tests::gpu::{Build, Gpu, Program};
use raytwin_tests::measure::{
    Errors, against_truth, against_twin, differing, hard_input, lane_value, run_cpu,
};

use super::error::ReportError;
use super::schema::{
    BaselineOnAdapter, BaselineRow, HardCases, KernelOnAdapter, KernelRow, finite,
};

/// How much to measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelSettings {
    /// Random inputs behind each error; an eighth of it where the truth walks
    /// a whole mesh.
    pub inputs: usize,
    /// Elements in a timed array.
    pub elements: usize,
    /// Timed runs on the CPU; the median counts.
    pub runs: usize,
    /// Timed dispatches on an adapter; the median counts.
    pub dispatches: usize,
}

impl KernelSettings {
    /// For the quick report.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            inputs: 1 << 13,
            elements: 1 << 16,
            runs: 15,
            dispatches: 7,
        }
    }

    /// For the long run.
    #[must_use]
    pub fn full() -> Self {
        Self {
            inputs: 1 << 17,
            elements: 1 << 16,
            runs: 45,
            dispatches: 25,
        }
    }
}

const SEED: u32 = 0x4e90_4700;

/// Times `run` over an array of `elements`, interleaved with the calibration
/// loop: median nanoseconds an element of both.
fn time_cpu(elements: usize, runs: usize, mut run: impl FnMut()) -> (f64, f64) {
    run();
    let (mut times, mut loops) = (Vec::new(), Vec::new());
    for _ in 0..runs {
        let start = Instant::now();
        run();
        times.push(start.elapsed().as_nanos() as f64);
        let start = Instant::now();
        black_box(calibration_loop(elements));
        loops.push(start.elapsed().as_nanos() as f64);
    }
    let per_element = 1.0 / elements as f64;
    (
        median(&mut times) * per_element,
        median(&mut loops) * per_element,
    )
}

/// A chain of PCG hashes, each of the one before: nothing to vectorise or to
/// load, so its time is the processor's clock.
#[must_use]
pub fn calibration_loop(elements: usize) -> u32 {
    (0..black_box(elements)).fold(0, |state, _| pcg_hash(state))
}

/// The middle of a list, which is sorted by this.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Inputs with their truths, the hard cases first.
struct Cases {
    input: Vec<u32>,
    truth: Vec<Vec<f64>>,
}

impl Cases {
    fn new(kernel: &Kernel, random: usize) -> Self {
        let mut input = hard_input(kernel);
        input.extend(kernel.draw_many(random, SEED));
        let truth = input
            .par_chunks_exact(kernel.words_in())
            .map(|arguments| kernel.truth(arguments))
            .collect();
        Self { input, truth }
    }

    fn errors(&self, kernel: &Kernel, output: &[u32]) -> Errors {
        against_truth(kernel, &self.input, &self.truth, output)
    }

    /// Median error of the float lanes; `None` if there are none or most are
    /// not finite.
    fn typical(&self, kernel: &Kernel, output: &[u32]) -> Option<f64> {
        let lanes = kernel.lanes_out();
        let mut errors = Vec::new();
        let arguments = self.input.chunks_exact(kernel.words_in());
        let results = output.chunks_exact(lanes.len());
        for ((arguments, result), truth) in arguments.zip(results).zip(&self.truth) {
            if kernel.is_undecided(arguments) {
                continue;
            }
            for ((_, scalar), (&word, &truth)) in lanes.iter().zip(result.iter().zip(truth)) {
                if *scalar == Scalar::F32 {
                    let value = lane_value(*scalar, word);
                    errors.push(if value.is_finite() {
                        kernel.ulps(arguments, truth, value, truth)
                    } else {
                        f64::INFINITY
                    });
                }
            }
        }
        finite(median(&mut errors))
    }

    /// Whether each hard case is within `bound` of the truth; `None` where
    /// that is not decided.
    fn hard(&self, kernel: &Kernel, output: &[u32], bound: f64) -> Vec<Option<bool>> {
        let (n, m) = (kernel.words_in(), kernel.words_out());
        (0..kernel.hard.len())
            .map(|i| {
                let one = against_truth(
                    kernel,
                    &self.input[i * n..(i + 1) * n],
                    &self.truth[i..=i],
                    &output[i * m..(i + 1) * m],
                );
                (one.undecided == 0).then(|| one.within(bound))
            })
            .collect()
    }
}

/// Measures one kernel and its baselines.
///
/// # Errors
/// If an adapter does not take the kernel.
pub fn measure(
    kernel: &Kernel,
    settings: &KernelSettings,
    with_cpu: bool,
    gpus: &[&Gpu],
) -> Result<KernelRow, ReportError> {
    let random = if kernel.fixture.is_some() {
        settings.inputs / 8
    } else {
        settings.inputs
    };
    let cases = Cases::new(kernel, random);
    let timed = kernel.draw_many(settings.elements, SEED ^ 1);
    let cpu = run_cpu(kernel, &cases.input);
    let cpu_errors = cases.errors(kernel, &cpu);
    let mut row = describe(kernel);
    row.inputs = cpu_errors.count;
    row.undecided = cpu_errors.undecided;
    let mut hard = vec![cases.hard(kernel, &cpu, kernel.bounds.cpu)];
    row.within = true;
    if with_cpu {
        let mut output = vec![0; settings.elements * kernel.words_out()];
        let (ns, loop_ns) = time_cpu(settings.elements, settings.runs, || {
            kernel.run_cpu(black_box(&timed), black_box(&mut output));
        });
        row.cpu_ns = finite(ns);
        row.cpu_ratio = finite(ns / loop_ns);
        row.cpu_err_ulp_max = finite(cpu_errors.max);
        row.cpu_err_ulp_mean = finite(cpu_errors.mean);
        row.cpu_err_ulp_median = cases.typical(kernel, &cpu);
        row.cpu_wrong = cpu_errors.wrong;
        row.within = cpu_errors.within(kernel.bounds.cpu);
    }
    for gpu in gpus {
        let program = Program::new(gpu, kernel, Build::Plain)?;
        let output = program.run(&cases.input);
        let errors = cases.errors(kernel, &output);
        let parity = against_twin(kernel, &cases.input, &cases.truth, &cpu, &output);
        hard.push(cases.hard(kernel, &output, kernel.bounds.gpu));
        let precise_differing = if gpu.has_precise() {
            let precise = Program::new(gpu, kernel, Build::Precise)?.run(&cases.input);
            Some(differing(kernel, &cpu, &precise).len())
        } else {
            None
        };
        let within = errors.within(kernel.bounds.gpu) && parity.within(kernel.bounds.parity());
        row.within &= within;
        row.gpu_err_ulp_max = largest(row.adapters.is_empty(), row.gpu_err_ulp_max, errors.max);
        row.parity_ulp_max = largest(row.adapters.is_empty(), row.parity_ulp_max, parity.max);
        let ns = program.time(&timed, settings.dispatches);
        row.gpu_ns = row.gpu_ns.or(finite(ns));
        row.adapters.insert(
            gpu.label(),
            KernelOnAdapter {
                ns,
                err_ulp_max: finite(errors.max),
                err_ulp_mean: finite(errors.mean),
                err_ulp_median: cases.typical(kernel, &output),
                wrong: errors.wrong,
                parity_ulp_max: finite(parity.max),
                parity_wrong: parity.wrong,
                precise_differing,
                within,
            },
        );
    }
    row.hard_cases = count_hard(&hard);
    row.baselines = baselines(kernel, settings, with_cpu, gpus, &cases, &timed)?;
    Ok(row)
}

/// The larger of a list's maximum so far and one more; `None` stands for a
/// value that is not finite, which is larger than any.
fn largest(first: bool, so_far: Option<f64>, next: f64) -> Option<f64> {
    if first {
        return finite(next);
    }
    Some(so_far?.max(finite(next)?))
}

/// A case counts as passed when each twin that ran is within its bound.
fn count_hard(twins: &[Vec<Option<bool>>]) -> HardCases {
    let mut out = HardCases::default();
    for case in 0..twins.first().map_or(0, Vec::len) {
        out.tried += 1;
        let results: Vec<_> = twins.iter().map(|t| t[case]).collect();
        if results.iter().any(Option::is_none) {
            out.undecided += 1;
        } else if results.iter().all(|r| *r == Some(true)) {
            out.passed += 1;
        }
    }
    out
}

fn describe(kernel: &Kernel) -> KernelRow {
    let arguments: Vec<_> = kernel
        .inputs
        .iter()
        .map(|(name, ty)| format!("{name}: {}", ty.wgsl()))
        .collect();
    KernelRow {
        name: kernel.name.into(),
        module: kernel.module.into(),
        group: kernel.module.split('/').next().unwrap_or_default().into(),
        class: kernel.class.letter().to_string(),
        signature: format!("({}) -> {}", arguments.join(", "), kernel.output.wgsl()),
        source: kernel.source.into(),
        cpu_bound: kernel.bounds.cpu,
        gpu_bound: kernel.bounds.gpu,
        parity_bound: kernel.bounds.parity(),
        ..KernelRow::default()
    }
}

fn baselines(
    kernel: &Kernel,
    settings: &KernelSettings,
    with_cpu: bool,
    gpus: &[&Gpu],
    cases: &Cases,
    timed: &[u32],
) -> Result<Vec<BaselineRow>, ReportError> {
    let mut rows = Vec::new();
    for baseline in &kernel.baselines {
        let mut row = BaselineRow {
            name: baseline.name.into(),
            ..BaselineRow::default()
        };
        if with_cpu {
            let mut output = vec![0; cases.truth.len() * kernel.words_out()];
            (baseline.cpu)(&cases.input, &mut output);
            let errors = cases.errors(kernel, &output);
            let typical = cases.typical(kernel, &output);
            let mut output = vec![0; settings.elements * kernel.words_out()];
            let (ns, _) = time_cpu(settings.elements, settings.runs, || {
                (baseline.cpu)(black_box(timed), black_box(&mut output));
            });
            row.cpu_ns = finite(ns);
            row.cpu_err_ulp_max = finite(errors.max);
            row.cpu_err_ulp_mean = finite(errors.mean);
            row.cpu_err_ulp_median = typical;
            row.cpu_wrong = errors.wrong;
        }
        let mut adapters = BTreeMap::new();
        for gpu in gpus {
            let program =
                Program::with_function(gpu, kernel, Build::Plain, "baseline", baseline.wgsl)?;
            let output = program.run(&cases.input);
            let errors = cases.errors(kernel, &output);
            adapters.insert(
                gpu.label(),
                BaselineOnAdapter {
                    ns: program.time(timed, settings.dispatches),
                    err_ulp_max: finite(errors.max),
                    err_ulp_mean: finite(errors.mean),
                    err_ulp_median: cases.typical(kernel, &output),
                    wrong: errors.wrong,
                },
            );
        }
        row.adapters = adapters;
        rows.push(row);
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hard_cases_need_every_twin() {
        let cpu = vec![Some(true), Some(true), None, Some(false)];
        let gpu = vec![Some(true), Some(false), None, Some(true)];
        let counted = count_hard(&[cpu, gpu]);
        let expected = HardCases {
            tried: 4,
            passed: 1,
            undecided: 1,
        };
        assert_eq!(counted, expected);
    }

    #[test]
    fn infinite_errors_stay_visible() {
        let mut max = largest(true, None, 2.0);
        assert_eq!(max, Some(2.0));
        max = largest(false, max, 3.0);
        assert_eq!(max, Some(3.0));
        max = largest(false, max, f64::INFINITY);
        assert_eq!(max, None);
        assert_eq!(largest(false, max, 1.0), None);
    }

    #[test]
    fn a_wrong_twin_is_seen() {
        use raytwin::contract::{Kernel, domains};
        fn wrong(x: f32) -> f32 {
            if x > 0.9 { x * 1.001 } else { x }
        }
        let kernel = Kernel::new(
            "math/none",
            "wrong",
            ["x"],
            wrong,
            |x: f64| x,
            (domains::unit(),),
        )
        .few_ulp(1.0, 1.0)
        .hard([(0.95,), (0.5,)])
        .baseline("right", "", |x: f32| x)
        .build();
        let settings = KernelSettings {
            inputs: 1000,
            elements: 64,
            runs: 1,
            dispatches: 1,
        };
        let row = measure(&kernel, &settings, true, &[]).unwrap();
        assert!(!row.within);
        assert!(row.cpu_err_ulp_max.unwrap() > 1000.0);
        assert_eq!((row.hard_cases.tried, row.hard_cases.passed), (2, 1));
        assert_eq!(row.baselines[0].cpu_err_ulp_max, Some(0.0));
        // One input in ten is wrong: the median is not.
        assert_eq!(row.cpu_err_ulp_median, Some(0.0));
        assert_eq!(row.gpu_ns, None);
    }
}
