//! Both twins against the golden vectors.

use std::path::{Path, PathBuf};

use raytwin::contract::{Kernel, Scalar};
use raytwin_tests::golden::{self, Golden};
use raytwin_tests::gpu::{Build, Program, adapters};
use raytwin_tests::measure::{lane_value, run_cpu};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn kernels() -> impl Iterator<Item = Kernel> {
    raytwin::registry().into_iter().flat_map(|t| t.kernels)
}

fn read(kernel: &Kernel) -> Result<Golden, String> {
    let path = golden::path(kernel);
    let at = |e: &dyn std::fmt::Display| format!("{}: {e}; run cargo xtask golden", path.display());
    let text = std::fs::read_to_string(root().join(&path)).map_err(|e| at(&e))?;
    serde_json::from_str(&text).map_err(|e| at(&e))
}

fn all(texts: impl Iterator<Item = String>) -> Vec<u32> {
    texts
        .flat_map(|t| golden::words(&t).unwrap_or_else(|e| panic!("{e}")))
        .collect()
}

#[test]
fn the_files_are_those_of_the_contracts() {
    let mut expected = Vec::new();
    for kernel in kernels() {
        let file = read(&kernel).unwrap_or_else(|e| panic!("{e}"));
        let made = golden::golden(&kernel);
        // What is allowed hangs on the truth, which other mathematical libraries
        // may round otherwise.
        let mut same = made.clone();
        assert_eq!(same.cases.len(), file.cases.len(), "{}", kernel.path());
        for (case, of_file) in same.cases.iter_mut().zip(&file.cases) {
            assert_eq!(
                case.allowed.len(),
                of_file.allowed.len(),
                "{}",
                kernel.path()
            );
            for (a, b) in case.allowed.iter().zip(&of_file.allowed) {
                assert!((a - b).abs() <= 1e-6 * a, "{}: {a} and {b}", kernel.path());
            }
            case.allowed.clone_from(&of_file.allowed);
        }
        assert!(
            same == file,
            "{} has changed: run cargo xtask golden",
            kernel.path()
        );
        expected.push(golden::path(&kernel));
    }
    let mut found = Vec::new();
    let mut folders = vec![root().join("tests/golden")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("written above") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push(path);
            }
        }
    }
    assert_eq!(found.len(), expected.len(), "a file has no kernel");
}

#[test]
fn the_cpu_gives_their_bits() {
    for kernel in kernels() {
        let file = read(&kernel).unwrap_or_else(|e| panic!("{e}"));
        let input = all(file.cases.iter().map(|c| c.input.clone()));
        let expected = all(file.cases.iter().map(|c| c.out.clone()));
        assert_eq!(run_cpu(&kernel, &input), expected, "{}", kernel.path());
    }
}

#[test]
fn adapters_give_what_is_allowed() {
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        let mut compared = 0;
        for kernel in kernels() {
            let file = read(&kernel).unwrap_or_else(|e| panic!("{e}"));
            let input = all(file.cases.iter().map(|c| c.input.clone()));
            let program = Program::new(gpu, &kernel, Build::Plain);
            let output = program.unwrap_or_else(|e| panic!("{e}")).run(&input);
            let lanes = kernel.lanes_out();
            for (case, found) in file.cases.iter().zip(output.chunks_exact(lanes.len())) {
                if case.undecided {
                    continue;
                }
                let expected = golden::words(&case.out).unwrap_or_else(|e| panic!("{e}"));
                for (l, (name, scalar)) in lanes.iter().enumerate() {
                    let (x, y) = (
                        lane_value(*scalar, found[l]),
                        lane_value(*scalar, expected[l]),
                    );
                    let right = match scalar {
                        Scalar::U32 => found[l] == expected[l],
                        Scalar::F32 => (x - y).abs() <= case.allowed[l],
                    };
                    assert!(
                        right,
                        "{}, {}: {name} is {x}, not {y} within {}, of {}",
                        gpu.label(),
                        kernel.path(),
                        case.allowed[l],
                        case.input
                    );
                    compared += 1;
                }
            }
        }
        println!("{}: {compared} numbers", gpu.label());
        assert!(compared > 10_000);
    }
}

#[test]
fn a_changed_vector_is_noticed() {
    let kernel = kernels()
        .find(|k| k.name == "cone_sample")
        .expect("there is one");
    let file = read(&kernel).unwrap_or_else(|e| panic!("{e}"));
    let mut input = all(file.cases.iter().map(|c| c.input.clone()));
    let expected = all(file.cases.iter().map(|c| c.out.clone()));
    // Arguments of the last case in place of the first one's.
    let n = kernel.words_in();
    let last = input[input.len() - n..].to_vec();
    input[..n].copy_from_slice(&last);
    assert_ne!(run_cpu(&kernel, &input), expected);
}
