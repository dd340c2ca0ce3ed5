//! Prints the bounds that a contract should declare.
//!
//! `cargo run --release -p raytwin-tests --example bounds [-- PART_OF_NAME]`
//!
//! For each kernel: the CPU twin's largest error over many inputs, and the
//! bound that interval arithmetic derives for the GPU twin, each beside what
//! is declared now. Round both up; a test holds the declared GPU bound to at
//! most one and a half times the derived one and an ULP.

use raytwin::contract::{Class, Derivation};
use raytwin_tests::derive::derive;
use raytwin_tests::measure::{against_truth, hard_input, run_cpu, truths};

fn main() {
    let only = std::env::args().nth(1).unwrap_or_default();
    println!(
        "{:45} {:>12} {:>9} {:>12} {:>9}",
        "kernel", "CPU measured", "declared", "GPU derived", "declared"
    );
    for kernel in raytwin::registry().into_iter().flat_map(|t| t.kernels) {
        if !kernel.path().contains(&only) || kernel.class == Class::BitExact {
            continue;
        }
        let mut input = hard_input(&kernel);
        input.extend(kernel.draw_many(1 << 21, 0xb0));
        let truth = truths(&kernel, &input);
        let cpu = against_truth(&kernel, &input, &truth, &run_cpu(&kernel, &input)).max;
        let gpu = match kernel.derivation {
            Derivation::Interval | Derivation::ByEnds { .. } => match derive(&kernel, 1 << 16) {
                Ok(derived) => format!("{:.3}", derived.bound),
                Err(error) => error,
            },
            Derivation::Analysis(_) => "analysis".into(),
        };
        println!(
            "{:45} {cpu:>12.3} {:>9} {gpu:>12} {:>9}",
            kernel.path(),
            kernel.bounds.cpu,
            kernel.bounds.gpu
        );
    }
}
