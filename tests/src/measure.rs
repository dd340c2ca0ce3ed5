//! How far values are from the truth and from each other.

use raytwin::contract::{Kernel, Scalar};

/// What a comparison over an array found.
#[derive(Clone, Debug, Default)]
pub struct Errors {
    /// Elements compared.
    pub count: usize,
    /// Largest error of a float lane, in ULP of `max(|truth|, scale)`;
    /// infinite where a value is not finite.
    pub max: f64,
    /// Mean over all float lanes.
    pub mean: f64,
    /// Element with the largest error.
    pub worst: usize,
    /// Elements with an integer lane that differs.
    pub wrong: usize,
    /// The first of those.
    pub first_wrong: Option<usize>,
    /// Elements left out because a discrete choice is within rounding.
    pub undecided: usize,
}

impl Errors {
    /// Whether everything is within `bound` and every integer right.
    #[must_use]
    pub fn within(&self, bound: f64) -> bool {
        self.max <= bound && self.wrong == 0
    }

    /// The element to look at first, if anything is off.
    #[must_use]
    pub fn culprit(&self) -> usize {
        self.first_wrong.unwrap_or(self.worst)
    }
}

/// The CPU twin's results for an array of argument lists.
#[must_use]
pub fn run_cpu(kernel: &Kernel, input: &[u32]) -> Vec<u32> {
    let count = input.len() / kernel.words_in();
    let mut output = vec![0xdead_beef; count * kernel.words_out()];
    kernel.run_cpu(input, &mut output);
    output
}

/// The truth for an array of argument lists: one list of lanes each.
#[must_use]
pub fn truths(kernel: &Kernel, input: &[u32]) -> Vec<Vec<f64>> {
    input
        .chunks_exact(kernel.words_in())
        .map(|arguments| kernel.truth(arguments))
        .collect()
}

/// A lane as a number: floats by value, integers exactly.
#[must_use]
pub fn lane_value(scalar: Scalar, word: u32) -> f64 {
    match scalar {
        Scalar::F32 => f64::from(f32::from_bits(word)),
        Scalar::U32 => f64::from(word),
    }
}

/// Compares `output` with `reference`, both a list of numbers an element, in
/// ULP of the truth.
fn compare(
    kernel: &Kernel,
    input: &[u32],
    truth: &[Vec<f64>],
    output: impl Fn(usize, usize) -> f64,
    reference: impl Fn(usize, usize) -> f64,
) -> Errors {
    let lanes = kernel.lanes_out();
    let mut errors = Errors::default();
    let mut sum = 0.0;
    let mut floats = 0usize;
    for (i, arguments) in input.chunks_exact(kernel.words_in()).enumerate() {
        errors.count += 1;
        if kernel.is_undecided(arguments) {
            errors.undecided += 1;
            continue;
        }
        for (l, (_, scalar)) in lanes.iter().enumerate() {
            let (value, reference) = (output(i, l), reference(i, l));
            if *scalar == Scalar::U32 {
                if value != reference && errors.first_wrong != Some(i) {
                    errors.wrong += 1;
                    errors.first_wrong.get_or_insert(i);
                }
                continue;
            }
            let error = if value.is_finite() {
                kernel.ulps(arguments, truth[i][l], value, reference)
            } else {
                f64::INFINITY
            };
            floats += 1;
            sum += error;
            if error > errors.max {
                errors.max = error;
                errors.worst = i;
            }
        }
    }
    errors.mean = if floats == 0 {
        0.0
    } else {
        sum / floats as f64
    };
    errors
}

/// Error of one twin's results.
#[must_use]
pub fn against_truth(kernel: &Kernel, input: &[u32], truth: &[Vec<f64>], output: &[u32]) -> Errors {
    let lanes = kernel.lanes_out();
    let n = lanes.len();
    compare(
        kernel,
        input,
        truth,
        |i, l| lane_value(lanes[l].1, output[i * n + l]),
        |i, l| truth[i][l],
    )
}

/// Difference between the twins' results.
#[must_use]
pub fn against_twin(
    kernel: &Kernel,
    input: &[u32],
    truth: &[Vec<f64>],
    cpu: &[u32],
    gpu: &[u32],
) -> Errors {
    let lanes = kernel.lanes_out();
    let n = lanes.len();
    compare(
        kernel,
        input,
        truth,
        |i, l| lane_value(lanes[l].1, gpu[i * n + l]),
        |i, l| lane_value(lanes[l].1, cpu[i * n + l]),
    )
}

/// Elements whose bits differ. A zero's sign and a flushed subnormal do not
/// count: WGSL lets both go.
#[must_use]
pub fn differing(kernel: &Kernel, cpu: &[u32], gpu: &[u32]) -> Vec<usize> {
    let lanes = kernel.lanes_out();
    let tiny = |word: u32| f32::from_bits(word).abs() < f32::MIN_POSITIVE;
    cpu.chunks_exact(lanes.len())
        .zip(gpu.chunks_exact(lanes.len()))
        .enumerate()
        .filter(|(_, (a, b))| {
            lanes
                .iter()
                .zip(a.iter().zip(*b))
                .any(|((_, scalar), (a, b))| {
                    a != b && !(*scalar == Scalar::F32 && tiny(*a) && tiny(*b))
                })
        })
        .map(|(i, _)| i)
        .collect()
}

/// An argument list or result, readable: `u.x = 0.5 (3f000000), …`.
#[must_use]
pub fn show(lanes: &[(String, Scalar)], words: &[u32]) -> String {
    lanes
        .iter()
        .zip(words)
        .map(|((path, scalar), word)| match scalar {
            Scalar::F32 => format!("{path} = {:e} ({word:08x})", f32::from_bits(*word)),
            Scalar::U32 => format!("{path} = {word} ({word:08x})"),
        })
        .collect::<Vec<_>>()
        .join(", ")
}

/// One element of a comparison, in full: for failure messages.
#[must_use]
pub fn show_case(kernel: &Kernel, input: &[u32], outputs: &[(&str, &[u32])], i: usize) -> String {
    let (n, m) = (kernel.words_in(), kernel.words_out());
    let arguments = &input[i * n..(i + 1) * n];
    let mut text = format!("\n  input {}", show(&kernel.lanes_in(), arguments));
    for (name, words) in outputs {
        let lanes = kernel.lanes_out();
        text += &format!("\n  {name:5} {}", show(&lanes, &words[i * m..(i + 1) * m]));
    }
    text += &format!("\n  truth {:?}", kernel.truth(arguments));
    text
}

/// The hard cases as one array.
#[must_use]
pub fn hard_input(kernel: &Kernel) -> Vec<u32> {
    kernel.hard.concat()
}
