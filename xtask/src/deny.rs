//! `cargo deny`: licences, sources, and advisories where their list can be had.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::packages::on_path;
use crate::run::{Environment, Failure, Tests};

const VERSION: &str = "0.20.2";

/// Checks what the workspace is built from against `deny.toml`.
///
/// # Errors
/// If cargo-deny cannot be installed, or finds something.
pub fn check(root: &Path, environment: &Environment, tests: &mut Tests) -> Result<(), Failure> {
    let program = ensure(root, environment, "cargo-deny", VERSION)?;
    let call = |what: &[&str]| {
        println!("$ cargo deny check {}", what.join(" "));
        let mut command = Command::new(&program);
        command
            .current_dir(root)
            .args(["--color", "never", "check"]);
        let output = command.args(what).output();
        output.map_err(|e| Failure::Start(program.display().to_string(), e))
    };
    let output = call(&["--hide-inclusion-graph", "licenses", "bans", "sources"])?;
    if !output.status.success() {
        eprintln!("{}", String::from_utf8_lossy(&output.stderr));
        return Err(Failure::Step("deny", 1));
    }
    let output = call(&["advisories"])?;
    let said = String::from_utf8_lossy(&output.stderr);
    if said.contains("failed to fetch advisory database") {
        tests.skip("advisories: their list is on github.com, which cannot be reached".into());
    } else if !output.status.success() {
        eprintln!("{said}");
        return Err(Failure::Step("advisories", 1));
    }
    Ok(())
}

/// A program of cargo's: on the path, else built below `target/`.
///
/// # Errors
/// If it does not build.
pub fn ensure(
    root: &Path,
    environment: &Environment,
    name: &'static str,
    version: &str,
) -> Result<PathBuf, Failure> {
    if on_path(name) {
        return Ok(name.into());
    }
    let tools = root.join("target").join("tools");
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let program = tools.join("bin").join(file);
    if !program.is_file() {
        println!("{name} is missing; cargo builds it (a few minutes)");
        let folder = tools.display().to_string();
        let what = ["install", name, "--locked", "--quiet"];
        let which = ["--version", version, "--root", &folder];
        environment.cargo(name, &[what, which].concat(), &[])?;
    }
    Ok(program)
}
