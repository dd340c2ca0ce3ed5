//! The tables in the docs, made from the contracts and measurements.

use std::fmt::Write;

use raytwin::contract::{Class, Derivation, Kernel, Technique};

use crate::measure::{against_truth, hard_input, run_cpu, truths};

/// Marks around the generated part of a page.
pub const BEGIN: &str = "<!-- contract: begin -->";
/// End of the generated part.
pub const END: &str = "<!-- contract: end -->";

/// Inputs behind the measured column. Fixed, as is their seed, so that the
/// table is the same on every machine: the CPU twin has one answer everywhere.
const MEASURED: usize = 1 << 15;
const SEED: u32 = 0xd0c5;

fn row(kernel: &Kernel) -> String {
    let arguments: Vec<_> = kernel
        .inputs
        .iter()
        .map(|(name, ty)| format!("{name}: {}", ty.wgsl()))
        .collect();
    let signature = format!(
        "`{}({}) -> {}`",
        kernel.name,
        arguments.join(", "),
        kernel.output.wgsl()
    );
    let mut input = hard_input(kernel);
    let hard = kernel.hard.len();
    input.extend(kernel.draw_many(MEASURED, SEED));
    let truth = truths(kernel, &input);
    let errors = against_truth(kernel, &input, &truth, &run_cpu(kernel, &input));
    let (cpu, gpu, parity) = if kernel.class == Class::BitExact {
        ("exact".into(), "exact".into(), "exact".into())
    } else {
        let derived = match kernel.derivation {
            Derivation::Interval | Derivation::ByEnds { .. } => "derived",
            Derivation::Analysis(_) => "analysis",
        };
        (
            format!("{} ({:.2} measured)", kernel.bounds.cpu, errors.max),
            format!("{} ({derived})", kernel.bounds.gpu),
            format!("{}", kernel.bounds.parity()),
        )
    };
    format!(
        "| {signature} | {} | {cpu} | {gpu} | {parity} | {hard} | {} |",
        kernel.class.letter(),
        kernel.source
    )
}

/// The generated part of a technique's page, marks included.
#[must_use]
pub fn contract_table(technique: &Technique) -> String {
    let mut text = format!("{BEGIN}\n\n");
    text += "Errors in ULP of `max(|truth|, scale)`; the scale is in the contract. \
             Class A is bit-exact, B a few ULP.\n\n";
    text += "| function | class | CPU bound | GPU bound | parity bound | hard cases | source |\n";
    text += "| --- | --- | --- | --- | --- | --- | --- |\n";
    for kernel in &technique.kernels {
        let _ = writeln!(text, "{}", row(kernel));
    }
    text + "\n" + END
}

/// The page with its generated part made anew, or `None` if it lacks the marks.
#[must_use]
pub fn updated(page: &str, technique: &Technique) -> Option<String> {
    let begin = page.find(BEGIN)?;
    let end = page[begin..].find(END)? + begin + END.len();
    Some(format!(
        "{}{}{}",
        &page[..begin],
        contract_table(technique),
        &page[end..]
    ))
}
