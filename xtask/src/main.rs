//! Set-up and the two commands: `cargo xtask report` and `cargo xtask test`.

mod compiler;
mod deny;
mod embree;
mod gallery;
mod packages;
mod run;
mod semver;
mod vulkan;
mod web;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use run::{Environment, Failure, Tests};

#[derive(Parser)]
#[command(
    name = "cargo xtask",
    about = "Set-up, tests and the report of raytwin"
)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Build in release and write the speed-against-error report.
    #[command(disable_help_flag = true)]
    Report {
        /// Passed on; `cargo xtask report --help` lists them.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
    /// Install or locate what the tests need, then run all of them.
    Test {
        /// Draw 16 times as many inputs and rays.
        #[arg(long)]
        full: bool,
    },
    /// Only install or locate what the tests and the report need.
    Setup,
    /// Write the contracts' tables into the pages under docs/.
    Docs,
    /// Write each kernel's golden vectors into tests/golden.
    Golden,
    /// Write the npm package into target/npm/raytwin.
    Npm,
    /// Build the gallery into target/gallery and serve it on this machine.
    Gallery {
        /// Where to serve it.
        #[arg(long, default_value_t = 8080)]
        port: u16,
        /// Only build it.
        #[arg(long)]
        build_only: bool,
        /// Test it in headless Chromium instead of serving it.
        #[arg(long)]
        test: bool,
    },
    /// Compile everything with headless Chromium and run each kernel there.
    WebTest,
}

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map_or_else(|| PathBuf::from("."), Path::to_path_buf);
    let result = match Cli::parse().task {
        Task::Report { arguments } => report(&root, &arguments),
        Task::Test { full } => test(&root, full),
        Task::Setup => setup(&root).map(drop),
        Task::Docs => example(&root, "docs"),
        Task::Golden => example(&root, "golden"),
        Task::Npm => web::npm(&Environment::bare(&root)),
        Task::WebTest => web_test(&root),
        Task::Gallery {
            port,
            build_only,
            test,
        } => gallery(&root, port, build_only, test),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

/// Finds a C++ compiler, a Vulkan driver and Embree, or installs them, saying so
/// first.
fn setup(root: &Path) -> Result<Environment, Failure> {
    compiler::ensure().map_err(|e| Failure::Setup(e.to_string()))?;
    let vulkan = vulkan::ensure(root).map_err(|e| Failure::Setup(e.to_string()))?;
    let embree = embree::ensure(root).map_err(|e| Failure::Setup(e.to_string()))?;
    println!("Embree: {embree}");
    Ok(Environment::new(root, vulkan))
}

fn report(root: &Path, arguments: &[String]) -> Result<(), Failure> {
    compiler::ensure().map_err(|e| Failure::Setup(e.to_string()))?;
    let given = |name: &str| arguments.iter().any(|a| a == name);
    // Help needs no driver, and the CPU's half of the report neither.
    let environment = if given("--help") || given("-h") {
        Environment::bare(root)
    } else {
        // Without its peer the report is poorer but not worthless: it says
        // so in every place where Embree's numbers would be.
        match embree::ensure(root) {
            Ok(found) => println!("Embree: {found}"),
            Err(error) => eprintln!("warning: the report will lack Embree: {error}"),
        }
        match vulkan::ensure(root) {
            Ok(mut vulkan) => {
                if !given("--full") && vulkan.leave_out_swiftshader() {
                    println!("SwiftShader would double the quick report's time; --full has it");
                }
                Environment::new(root, vulkan)
            }
            Err(_) if given("--cpu") => Environment::bare(root),
            Err(error) => return Err(Failure::Setup(error.to_string())),
        }
    };
    if !(given("--help") || given("-h")) {
        tinybvh(&environment);
    }
    let mut command = vec![
        "run",
        "--release",
        "--quiet",
        "--package",
        "raytwin-bench",
        "--bin",
        "report",
        "--",
    ];
    command.extend(arguments.iter().map(String::as_str));
    println!("building the report in release mode (a few minutes the first time)");
    environment.cargo("report", &command, &[])
}

/// tinybvh's part of the report is a workspace of its own.
const TINYBVH: [&str; 5] = [
    "--locked",
    "--manifest-path",
    "benches/tinybvh/Cargo.toml",
    "--target-dir",
    "target/tinybvh",
];

/// Why tinybvh's traversal cannot be compiled here.
fn no_tinybvh() -> Option<&'static str> {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        return None;
    }
    Some("its eight-wide traversal needs a processor with AVX2 and FMA")
}

/// Builds the report's other peer. The report says where it is missing.
fn tinybvh(environment: &Environment) {
    if let Some(why) = no_tinybvh() {
        eprintln!("warning: the report will lack tinybvh: {why}");
        return;
    }
    println!("building tinybvh, a peer of the report, for this processor (half a minute)");
    let command = [&["build", "--release", "--quiet"], &TINYBVH[..]].concat();
    if let Err(failure) = environment.cargo("tinybvh", &command, &[]) {
        eprintln!("warning: the report will lack tinybvh: {failure}");
    }
}

fn test(root: &Path, full: bool) -> Result<(), Failure> {
    let environment = setup(root)?;
    environment.cargo("format", &["fmt", "--all", "--check"], &[])?;
    environment.cargo(
        "lint",
        &[
            "clippy",
            "--workspace",
            "--all-targets",
            "--",
            "--deny",
            "warnings",
        ],
        &[],
    )?;
    environment.cargo(
        "documentation",
        &["doc", "--workspace", "--no-deps", "--quiet"],
        &[("RUSTDOCFLAGS", "--deny warnings")],
    )?;
    // What users build: without features, and each feature alone.
    for features in ["", "build", "gpu", "rayon", "contract"] {
        environment.cargo(
            "features",
            &[
                "check",
                "--quiet",
                "--package",
                "raytwin",
                "--features",
                features,
            ],
            &[],
        )?;
    }
    // What crates.io would get, built from the packed files.
    environment.cargo(
        "package",
        &[
            "package",
            "--quiet",
            "--allow-dirty",
            "--package",
            "raytwin-cpu",
            "--package",
            "raytwin-wgsl",
            "--package",
            "raytwin",
        ],
        &[],
    )?;
    let mut tests = Tests::default();
    let full = if full {
        Some(("RAYTWIN_FULL", "1"))
    } else {
        None
    };
    environment.cargo_test(
        &["test", "--workspace", "--no-fail-fast"],
        full.as_slice(),
        &mut tests,
    )?;
    deny::check(root, &environment, &mut tests)?;
    semver::check(root, &environment, &mut tests)?;
    match no_tinybvh() {
        Some(why) => tests.skip(format!("tinybvh, a peer of the report: {why}")),
        None => {
            let arguments = [&["test"], &TINYBVH[..]].concat();
            environment.cargo_test(&arguments, &[], &mut tests)?;
        }
    }
    packagings(&environment, &mut tests)?;
    web::test(root, &environment, &mut tests)?;
    gallery::test(root, &environment, &mut tests)?;
    tests.finish()
}

/// The packagings whose libraries (wesl 0.6, Bevy 0.20) ask for Rust 1.97.1, and
/// build with 1.95 too. Each is a workspace of its own.
fn packagings(environment: &Environment, tests: &mut Tests) -> Result<(), Failure> {
    let version = run::rust_version()?;
    if version < (1, 95) {
        let (major, minor) = version;
        tests.skip(format!(
            "the WESL package and the Bevy plugin: wesl 0.6 and Bevy 0.20 do not build with Rust {major}.{minor}"
        ));
        return Ok(());
    }
    let wesl: &[&str] = &["--manifest-path", "tests/wesl/Cargo.toml"];
    let pages: &[&str] = &["--package", "raytwin-wgsl", "--features", "wesl"];
    let bevy: &[&str] = &["--manifest-path", "kernels/examples/bevy/Cargo.toml"];
    for (which, folder) in [(wesl, "wesl"), (pages, "wesl"), (bevy, "bevy")] {
        let folder = format!("target/{folder}");
        let apart = ["--ignore-rust-version", "--target-dir", &folder];
        let arguments = [&["test"], which, &apart].concat();
        environment.cargo_test(&arguments, &[], tests)?;
    }
    Ok(())
}

fn gallery(root: &Path, port: u16, build_only: bool, test: bool) -> Result<(), Failure> {
    let environment = Environment::bare(root);
    if test {
        let mut tests = Tests::default();
        gallery::test(root, &environment, &mut tests)?;
        return tests.finish();
    }
    let folder = gallery::build(root, &environment)?;
    if build_only {
        return Ok(());
    }
    gallery::serve(&folder, port)
}

fn web_test(root: &Path) -> Result<(), Failure> {
    let mut tests = Tests::default();
    web::test(root, &Environment::bare(root), &mut tests)?;
    tests.finish()
}

/// Runs an example of the tests' crate.
fn example(root: &Path, name: &'static str) -> Result<(), Failure> {
    let environment = Environment::bare(root);
    let arguments = [
        "run",
        "--quiet",
        "--package",
        "raytwin-tests",
        "--example",
        name,
    ];
    environment.cargo(name, &arguments, &[])?;
    Ok(())
}
