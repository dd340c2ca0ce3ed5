//! `cargo semver-checks`: what a release may not break.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::deny::ensure;
use crate::run::{Environment, Failure, Tests};

const CRATES: [&str; 3] = ["raytwin-cpu", "raytwin-wgsl", "raytwin"];

/// Compares each published crate with its last release; skipped, loudly, while
/// there is none.
///
/// # Errors
/// If cargo-semver-checks cannot be installed, or finds a break that the version
/// does not say.
pub fn check(root: &Path, environment: &Environment, tests: &mut Tests) -> Result<(), Failure> {
    for name in CRATES {
        if !released(name)? {
            tests.skip(format!(
                "semver of {name}: crates.io has no release of it to compare with, or is not reached"
            ));
            continue;
        }
        let program = ensure(root, environment, "cargo-semver-checks", "0.51.0")?;
        println!("$ cargo semver-checks --package {name}");
        let mut command = Command::new(&program);
        command.args(["semver-checks", "--package", name]);
        let status = command.current_dir(root).status();
        let status = status.map_err(|e| Failure::Start(program.display().to_string(), e))?;
        if !status.success() {
            return Err(Failure::Step("semver", 1));
        }
    }
    Ok(())
}

/// Whether crates.io knows the crate.
fn released(name: &str) -> Result<bool, Failure> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let mut command = Command::new(&cargo);
    command.args(["info", name, "--registry", "crates-io"]);
    let silent = command.stdout(Stdio::null()).stderr(Stdio::null());
    let status = silent.status().map_err(|e| Failure::Start(cargo, e))?;
    Ok(status.success())
}
