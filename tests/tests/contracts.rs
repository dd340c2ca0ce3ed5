//! Every promise of every kernel's contract, one named test each.
//!
//! The tests are made from the registry: a new technique is tested as soon as
//! it is registered. For each kernel:
//!
//! - `truth`: the CPU twin is within its bound of the truth;
//! - `derived`: the declared bounds are what interval arithmetic over WGSL's
//!   accuracy table gives;
//! - `hard`: both twins give finite, right answers on the hard cases;
//! - `same program` (each adapter that takes SPIR-V): with contraction off
//!   the GPU gives the CPU's bits, and each value is one that WGSL's accuracy
//!   table allows for the text as written;
//! - `as shipped` (each adapter): the plain pipeline is within its bounds of
//!   the truth and of the CPU twin, whatever the driver made of the algebra;
//! - `property` (each adapter): the same, on inputs that proptest draws and
//!   shrinks.
//!
//! `RAYTWIN_FULL=1` draws 16 times as many inputs.

use std::sync::Arc;

use libtest_mimic::{Arguments, Failed, Trial};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestCaseError, TestError, TestRunner};
use raytwin::contract::{Class, Derivation, Kernel};
use raytwin_tests::derive;
use raytwin_tests::gpu::{self, Build, Gpu, Program};
use raytwin_tests::measure::{
    Errors, against_truth, against_twin, differing, hard_input, run_cpu, show_case, truths,
};

fn main() {
    let arguments = Arguments::from_args();
    let full = std::env::var_os("RAYTWIN_FULL").is_some();
    let count = if full { 1 << 20 } else { 1 << 16 };
    let kernels: Vec<Arc<Kernel>> = raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .map(Arc::new)
        .collect();

    let mut trials = Vec::new();
    let mut add = |kind: &str, kernel: &Arc<Kernel>, at: Option<&Gpu>, run: Check| {
        let kernel = kernel.clone();
        let place = at.map_or(String::new(), |g| format!(" @ {}", g.info.name));
        trials.push(Trial::test(
            format!("{kind}: {}{place}", kernel.path()),
            move || run(&kernel),
        ));
    };
    for kernel in &kernels {
        add("truth", kernel, None, Box::new(move |k| truth(k, count)));
        add("hard", kernel, None, Box::new(hard_cpu));
        add("derived", kernel, None, Box::new(derived));
    }
    match gpu::adapters() {
        Ok(gpus) => {
            for gpu in gpus {
                println!("adapter: {}", gpu.label());
                for kernel in &kernels {
                    if gpu.has_precise() && kernel.class != Class::Transcendental {
                        let check = move |k: &Kernel| same_program(gpu, k, count);
                        add("same program", kernel, Some(gpu), Box::new(check));
                    }
                    let check = move |k: &Kernel| as_shipped(gpu, k, count);
                    add("as shipped", kernel, Some(gpu), Box::new(check));
                    let check = move |k: &Kernel| hard_gpu(gpu, k);
                    add("hard", kernel, Some(gpu), Box::new(check));
                    let check = move |k: &Kernel| property(gpu, k);
                    add("property", kernel, Some(gpu), Box::new(check));
                }
            }
        }
        // A missing driver is a failure, never a pass.
        Err(error) => trials.push(Trial::test("an adapter is present", move || {
            Err(Failed::from(error.to_string()))
        })),
    }
    libtest_mimic::run(&arguments, trials).exit();
}

type Check = Box<dyn FnOnce(&Kernel) -> Result<(), Failed> + Send>;

const SEED: u32 = 0x5eed_0001;

fn check(ok: bool, message: impl FnOnce() -> String) -> Result<(), Failed> {
    if ok { Ok(()) } else { Err(message().into()) }
}

fn describe(what: &str, bound: f64, e: &Errors) -> String {
    format!(
        "{what}: largest error {:.4} ULP, bound {bound}; {} of {} elements with a wrong integer",
        e.max, e.wrong, e.count
    )
}

/// Too many inputs left out would make the comparison empty.
fn mostly_decided(errors: &Errors) -> Result<(), Failed> {
    check(errors.undecided * 10 <= errors.count, || {
        format!(
            "{} of {} inputs count as undecided",
            errors.undecided, errors.count
        )
    })
}

fn truth(kernel: &Kernel, count: usize) -> Result<(), Failed> {
    let input = kernel.draw_many(count, SEED);
    let truth = truths(kernel, &input);
    let cpu = run_cpu(kernel, &input);
    let e = against_truth(kernel, &input, &truth, &cpu);
    mostly_decided(&e)?;
    check(e.within(kernel.bounds.cpu), || {
        describe("CPU against truth", kernel.bounds.cpu, &e)
            + &show_case(kernel, &input, &[("cpu", &cpu)], e.culprit())
    })
}

fn hard_cpu(kernel: &Kernel) -> Result<(), Failed> {
    let input = hard_input(kernel);
    check(!input.is_empty(), || "no hard case is listed".into())?;
    let truth = truths(kernel, &input);
    let cpu = run_cpu(kernel, &input);
    let e = against_truth(kernel, &input, &truth, &cpu);
    check(e.within(kernel.bounds.cpu), || {
        describe("CPU against truth", kernel.bounds.cpu, &e)
            + &show_case(kernel, &input, &[("cpu", &cpu)], e.culprit())
    })
}

fn hard_gpu(gpu: &Gpu, kernel: &Kernel) -> Result<(), Failed> {
    compare_as_shipped(gpu, kernel, &hard_input(kernel), false)
}

fn derived(kernel: &Kernel) -> Result<(), Failed> {
    match kernel.derivation {
        Derivation::Interval if kernel.class == Class::BitExact => {
            derive::bit_exact(kernel).map_err(Failed::from)
        }
        Derivation::Interval | Derivation::ByEnds { .. } => {
            derive::declared_is_derived(kernel).map_err(Failed::from)
        }
        Derivation::Analysis(why) => check(why.len() > 20, || {
            "a bound by analysis must say why and where".into()
        }),
    }
}

fn same_program(gpu: &Gpu, kernel: &Kernel, count: usize) -> Result<(), Failed> {
    let mut input = kernel.draw_many(count, SEED ^ 1);
    input.extend(hard_input(kernel));
    let cpu = run_cpu(kernel, &input);
    let out = Program::new(gpu, kernel, Build::Precise)?.run(&input);
    derive::allowed(kernel, &input, &cpu, &out).map_err(|(i, why)| {
        let case = show_case(kernel, &input, &[("cpu", &cpu), ("gpu", &out)], i);
        Failed::from(why + &case)
    })?;
    if !gpu.is_software() && kernel.class == Class::FewUlp {
        // Vulkan lets hardware divide to 2.5 ULP: bounds instead of bits.
        let truth = truths(kernel, &input);
        let e = against_twin(kernel, &input, &truth, &cpu, &out);
        return check(e.within(kernel.bounds.parity()), || {
            describe("precise GPU against CPU", kernel.bounds.parity(), &e)
                + &show_case(kernel, &input, &[("cpu", &cpu), ("gpu", &out)], e.culprit())
        });
    }
    let differ = differing(kernel, &cpu, &out);
    check(differ.is_empty(), || {
        format!("{} elements differ in bits", differ.len())
            + &show_case(kernel, &input, &[("cpu", &cpu), ("gpu", &out)], differ[0])
    })
}

fn as_shipped(gpu: &Gpu, kernel: &Kernel, count: usize) -> Result<(), Failed> {
    compare_as_shipped(gpu, kernel, &kernel.draw_many(count, SEED ^ 2), true)
}

fn compare_as_shipped(
    gpu: &Gpu,
    kernel: &Kernel,
    input: &[u32],
    random: bool,
) -> Result<(), Failed> {
    let truth = truths(kernel, input);
    let cpu = run_cpu(kernel, input);
    let out = Program::new(gpu, kernel, Build::Plain)?.run(input);
    let case = |i| show_case(kernel, input, &[("cpu", &cpu), ("gpu", &out)], i);
    let e = against_truth(kernel, input, &truth, &out);
    if random {
        mostly_decided(&e)?;
    }
    check(e.within(kernel.bounds.gpu), || {
        describe("GPU against truth", kernel.bounds.gpu, &e) + &case(e.culprit())
    })?;
    let e = against_twin(kernel, input, &truth, &cpu, &out);
    check(e.within(kernel.bounds.parity()), || {
        describe("GPU against CPU", kernel.bounds.parity(), &e) + &case(e.culprit())
    })
}

fn property(gpu: &Gpu, kernel: &Kernel) -> Result<(), Failed> {
    let program = Program::new(gpu, kernel, Build::Plain)?;
    let words = prop::collection::vec(any::<u32>(), kernel.domain_words());
    let lists = prop::collection::vec(words, 1..256);
    let mut runner = TestRunner::new(Config {
        cases: 48,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(u64::from(SEED)),
        ..Config::default()
    });
    let result = runner.run(&lists, |lists| {
        let input: Vec<u32> = lists.iter().flat_map(|words| kernel.draw(words)).collect();
        let truth = truths(kernel, &input);
        let cpu = run_cpu(kernel, &input);
        let out = program.run(&input);
        let e = against_twin(kernel, &input, &truth, &cpu, &out);
        if e.within(kernel.bounds.parity()) {
            return Ok(());
        }
        Err(TestCaseError::fail(
            describe("GPU against CPU", kernel.bounds.parity(), &e)
                + &show_case(kernel, &input, &[("cpu", &cpu), ("gpu", &out)], e.culprit()),
        ))
    });
    match result {
        Ok(()) => Ok(()),
        Err(TestError::Fail(reason, _)) => Err(reason.message().to_string().into()),
        Err(abort) => Err(abort.to_string().into()),
    }
}
