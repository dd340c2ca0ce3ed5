//! Bounds from WGSL's own accuracy table.
//!
//! The interval interpreter ([`crate::interval`]) runs the WGSL text that we
//! ship and returns, for one argument list, every value that a conforming
//! implementation may give. From that follow the bound that a contract has to
//! declare, and a check of each single GPU result that no tolerance enters.

use raytwin::contract::{Derivation, Kernel, Scalar as Lane};

use crate::interval::{Interval, IntervalError, Program, Scalar, Table};
use crate::measure::{hard_input, run_cpu, show_case};

/// Argument lists drawn to derive a bound. Fixed, so that the derived number
/// is the same on every run.
const DRAWN: usize = 4096;
const SEED: u32 = 0x0de1_17ed;
/// Most argument lists that [`allowed`] looks at.
const CHECKED: usize = 2048;

/// What interval arithmetic says of a kernel over its domain and hard cases.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Argument lists run.
    pub count: usize,
    /// Largest possible error of a float lane, in ULP of `max(|truth|, scale)`.
    pub bound: f64,
    /// Argument list with that error.
    pub worst: Vec<u32>,
    /// Argument lists left out as undecided.
    pub undecided: usize,
    /// Argument lists for which some lane may be anything, or an integer lane
    /// has more than one value.
    pub open: Vec<Vec<u32>>,
}

/// The WGSL of a kernel, ready for the interpreter.
///
/// # Errors
/// If the text does not parse.
pub fn program(kernel: &Kernel) -> Result<Program, String> {
    let mut source = raytwin::wgsl::link(&[kernel.module]).map_err(|e| e.to_string())?;
    // Callbacks that compute what they give are run with the kernel; those that
    // read the buffer, which is not here, cannot be.
    if let Some(fixture) = &kernel.fixture {
        source += "@group(0) @binding(2) var<storage, read> raytwin_fixture: array<u32>;";
        source += fixture.wgsl;
    }
    let mut program = Program::parse(&source).map_err(|e| e.to_string())?;
    if let Derivation::ByEnds { variables, .. } = kernel.derivation {
        for (function, variable) in variables {
            program
                .take_by_ends(function, variable)
                .map_err(|e| format!("{}: {e}", kernel.path()))?;
        }
    }
    Ok(program)
}

fn derivation_input(kernel: &Kernel, drawn: usize) -> Vec<u32> {
    let mut input = hard_input(kernel);
    input.extend(kernel.draw_many(drawn, SEED));
    input
}

/// Runs the interpreter over the domain and the hard cases.
///
/// # Errors
/// If the interpreter cannot run the kernel.
pub fn derive(kernel: &Kernel, drawn: usize) -> Result<Derived, String> {
    let program = program(kernel)?;
    let lanes = kernel.lanes_out();
    let mut derived = Derived::default();
    for arguments in derivation_input(kernel, drawn).chunks_exact(kernel.words_in()) {
        derived.count += 1;
        if kernel.is_undecided(arguments) {
            derived.undecided += 1;
            continue;
        }
        let values = match program.call(kernel.name, arguments, Table::Wgsl) {
            Ok(values) => values,
            Err(IntervalError::TooAmbiguous { .. }) => {
                derived.open.push(arguments.to_vec());
                continue;
            }
            Err(error) => return Err(format!("{}: {error}", kernel.path())),
        };
        let truth = kernel.truth(arguments);
        let mut open = false;
        for ((value, truth), (_, lane)) in values.iter().zip(&truth).zip(&lanes) {
            match (lane, value.interval()) {
                (Lane::F32, Some(interval)) if interval.is_bounded() => {
                    let error = error_ulps(kernel, arguments, interval, *truth);
                    if error > derived.bound {
                        derived.bound = error;
                        derived.worst = arguments.to_vec();
                    }
                }
                (Lane::F32, _) => open = true,
                (Lane::U32, _) => open |= !value.is_exact(),
            }
        }
        if open {
            derived.open.push(arguments.to_vec());
        }
    }
    Ok(derived)
}

/// Largest error of any value in the interval.
fn error_ulps(kernel: &Kernel, arguments: &[u32], interval: Interval, truth: f64) -> f64 {
    let low = kernel.ulps(arguments, truth, interval.lo, truth);
    let high = kernel.ulps(arguments, truth, interval.hi, truth);
    low.max(high)
}

/// The declared bounds are the derived ones, rounded up, and not looser.
///
/// # Errors
/// If they are smaller than derived (wrong) or more than half as large again
/// and an ULP (lazy), or if the derivation leaves too much open.
pub fn declared_is_derived(kernel: &Kernel) -> Result<(), String> {
    let derived = derive(kernel, DRAWN)?;
    let declared = kernel.bounds.gpu;
    let show = |arguments: &[u32]| show_case(kernel, arguments, &[], 0);
    if derived.open.len() * 100 > derived.count {
        return Err(format!(
            "{} of {} argument lists stay open in interval arithmetic, the first: {}",
            derived.open.len(),
            derived.count,
            show(&derived.open[0])
        ));
    }
    if derived.bound > declared {
        return Err(format!(
            "declared GPU bound {declared} ULP is below the derived {:.4}, reached at {}",
            derived.bound,
            show(&derived.worst)
        ));
    }
    if declared > 1.5 * derived.bound + 1.0 {
        return Err(format!(
            "declared GPU bound {declared} ULP is loose: {:.4} is derived",
            derived.bound
        ));
    }
    if kernel.bounds.cpu > declared {
        return Err(format!(
            "the CPU bound {} exceeds the GPU bound {declared}, though IEEE arithmetic \
             is one of those that WGSL allows",
            kernel.bounds.cpu
        ));
    }
    Ok(())
}

/// A class A kernel leaves an implementation no choice at all.
///
/// # Errors
/// If interval arithmetic finds a lane with more than one possible value, or
/// one that is not the CPU's.
pub fn bit_exact(kernel: &Kernel) -> Result<(), String> {
    let program = program(kernel)?;
    let input = derivation_input(kernel, DRAWN);
    let cpu = run_cpu(kernel, &input);
    for (i, (arguments, expected)) in input
        .chunks_exact(kernel.words_in())
        .zip(cpu.chunks_exact(kernel.words_out()))
        .enumerate()
    {
        let values = program
            .call(kernel.name, arguments, Table::Wgsl)
            .map_err(|e| e.to_string())?;
        let exact = values
            .iter()
            .zip(expected)
            .all(|(value, word)| value.is_exact() && value.contains(*word));
        if !exact {
            return Err(format!(
                "an implementation may return {values:?}{}",
                show_case(kernel, &input, &[("cpu", &cpu)], i)
            ));
        }
    }
    Ok(())
}

/// Each of the first results is one that the specification allows, and the
/// CPU's is the one that IEEE arithmetic gives for the WGSL text.
///
/// # Errors
/// The first element that is not, and why.
pub fn allowed(
    kernel: &Kernel,
    input: &[u32],
    cpu: &[u32],
    gpu: &[u32],
) -> Result<(), (usize, String)> {
    if matches!(kernel.derivation, Derivation::Analysis(_)) {
        return Ok(());
    }
    let program = program(kernel).map_err(|e| (0, e))?;
    let n = kernel.words_out();
    for (i, arguments) in input
        .chunks_exact(kernel.words_in())
        .take(CHECKED)
        .enumerate()
    {
        let words = i * n..(i + 1) * n;
        for (table, who, values) in [
            (Table::Wgsl, "GPU", &gpu[words.clone()]),
            (Table::Ieee, "CPU", &cpu[words]),
        ] {
            let possible = match program.call(kernel.name, arguments, table) {
                Ok(possible) => possible,
                Err(IntervalError::TooAmbiguous { .. }) => continue,
                Err(error) => return Err((i, error.to_string())),
            };
            if let Some(lane) = outside(&possible, values) {
                return Err((
                    i,
                    format!(
                        "the {who}'s word {lane} is {:08x} ({:e}), but the WGSL text allows {:?}",
                        values[lane],
                        f32::from_bits(values[lane]),
                        possible[lane]
                    ),
                ));
            }
        }
    }
    Ok(())
}

fn outside(possible: &[Scalar], words: &[u32]) -> Option<usize> {
    possible
        .iter()
        .zip(words)
        .position(|(p, w)| !p.contains(*w))
}
