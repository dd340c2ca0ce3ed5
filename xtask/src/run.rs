//! Running cargo, and adding up what its test runners say.

use std::fmt;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::vulkan::Vulkan;

/// Why a task ended early.
#[derive(Debug)]
pub enum Failure {
    /// Something that the task needs is missing.
    Setup(String),
    /// A step failed, with this exit code.
    Step(&'static str, u8),
    /// Tests failed.
    Tests(usize),
    /// Nothing was tested, which must not look like a pass.
    NoTests,
    /// A program did not start.
    Start(String, std::io::Error),
}

impl Failure {
    /// The exit code to end with: that of the step, where there is one.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Step(_, code) => *code,
            _ => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Setup(message) => f.write_str(message),
            Self::Step(step, code) => write!(f, "step `{step}` failed with exit code {code}"),
            Self::Tests(count) => write!(f, "{count} tests failed"),
            Self::NoTests => write!(f, "no test was run"),
            Self::Start(program, e) => write!(f, "cannot start `{program}`: {e}"),
        }
    }
}

/// Where cargo runs, and the variables that its children need.
pub struct Environment {
    root: PathBuf,
    variables: Vec<(String, String)>,
}

impl Environment {
    /// Without any system part.
    pub fn bare(root: &Path) -> Self {
        Self {
            root: root.into(),
            variables: Vec::new(),
        }
    }

    /// With the Vulkan drivers that the set-up found.
    pub fn new(root: &Path, vulkan: Vulkan) -> Self {
        let mut environment = Self::bare(root);
        environment.variables = vulkan.variables;
        environment
    }

    fn command(&self, arguments: &[&str], variables: &[(&str, &str)]) -> (String, Command) {
        let program = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
        let mut command = Command::new(&program);
        command.current_dir(&self.root).args(arguments);
        for (name, value) in &self.variables {
            command.env(name, value);
        }
        command.envs(variables.iter().copied());
        (program, command)
    }

    /// Runs a cargo command to its end.
    ///
    /// # Errors
    /// If it does not start or does not succeed.
    pub fn cargo(
        &self,
        step: &'static str,
        arguments: &[&str],
        variables: &[(&str, &str)],
    ) -> Result<(), Failure> {
        println!("$ cargo {}", arguments.join(" "));
        let start = Instant::now();
        let (program, mut command) = self.command(arguments, variables);
        let status = command.status().map_err(|e| Failure::Start(program, e))?;
        took(step, start);
        if status.success() {
            return Ok(());
        }
        let code = status
            .code()
            .and_then(|c| u8::try_from(c).ok())
            .unwrap_or(1);
        Err(Failure::Step(step, code))
    }

    /// Runs a `cargo test` command, shows its output as it comes and counts.
    ///
    /// # Errors
    /// If it does not start, or does not build.
    pub fn cargo_test(
        &self,
        arguments: &[&str],
        variables: &[(&str, &str)],
        tests: &mut Tests,
    ) -> Result<(), Failure> {
        println!("$ cargo {}", arguments.join(" "));
        let (_, command) = self.command(arguments, variables);
        counted(command, "cargo test", tests)
    }
}

/// Says how long a step took: most of a run is compiling, and this shows where.
fn took(step: &str, start: Instant) {
    println!("# {step}: {:.0} s", start.elapsed().as_secs_f64());
}

/// Runs a test runner, shows its output as it comes and counts.
///
/// # Errors
/// If it does not start, or ends badly without a failed test.
pub fn counted(mut command: Command, step: &'static str, tests: &mut Tests) -> Result<(), Failure> {
    let begin = Instant::now();
    let start = |e| Failure::Start(step.into(), e);
    let failed = tests.failed;
    let mut child = command.stdout(Stdio::piped()).spawn().map_err(start)?;
    if let Some(output) = child.stdout.take() {
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            println!("{line}");
            tests.read(&line);
        }
    }
    let status = child.wait().map_err(start)?;
    took(step, begin);
    if !status.success() && tests.failed == failed {
        return Err(Failure::Step(step, 101));
    }
    Ok(())
}

/// The compiler's version, as far as the second number.
///
/// # Errors
/// If it does not start or its answer is not one.
pub fn rust_version() -> Result<(u32, u32), Failure> {
    let program = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    let output = Command::new(&program)
        .arg("--version")
        .output()
        .map_err(|e| Failure::Start(program.clone(), e))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut numbers = text
        .split_whitespace()
        .nth(1)
        .unwrap_or_default()
        .split('.')
        .map_while(|n| n.parse().ok());
    match (numbers.next(), numbers.next()) {
        (Some(major), Some(minor)) => Ok((major, minor)),
        _ => Err(Failure::Setup(format!(
            "`{program} --version` says `{}`, not a version",
            text.trim()
        ))),
    }
}

/// Sums over every test runner that cargo starts.
#[derive(Default)]
pub struct Tests {
    passed: usize,
    failed: usize,
    ignored: usize,
    skipped: Vec<String>,
}

impl Tests {
    /// Notes that a whole part was not run, and why; loudly, here and at the end.
    pub fn skip(&mut self, what: String) {
        println!("SKIPPED: {what}");
        self.skipped.push(what);
    }

    /// Takes a line of output: `test result: ok. 3 passed; 0 failed; 0 ignored; …`.
    fn read(&mut self, line: &str) {
        let Some(result) = line.strip_prefix("test result: ") else {
            return;
        };
        let count = |word: &str| {
            result
                .split([';', '.'])
                .filter_map(|part| part.trim().strip_suffix(word))
                .find_map(|number| number.trim().parse::<usize>().ok())
                .unwrap_or(0)
        };
        self.passed += count("passed");
        self.failed += count("failed");
        self.ignored += count("ignored");
    }

    /// Prints the sum.
    ///
    /// # Errors
    /// If a test failed or none ran.
    pub fn finish(&self) -> Result<(), Failure> {
        println!();
        println!(
            "{} passed, {} failed, {} skipped",
            self.passed,
            self.failed,
            self.ignored + self.skipped.len()
        );
        for what in &self.skipped {
            println!("SKIPPED: {what}");
        }
        match (self.passed, self.failed) {
            (0, 0) => Err(Failure::NoTests),
            (_, 0) => Ok(()),
            (_, failed) => Err(Failure::Tests(failed)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Tests;

    #[test]
    fn sums_over_runners() {
        let mut tests = Tests::default();
        tests.read("running 3 tests");
        tests.read("test result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s");
        tests.read(
            "test result: FAILED. 10 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out",
        );
        assert_eq!((tests.passed, tests.failed, tests.ignored), (13, 2, 1));
        assert!(tests.finish().is_err());
    }

    #[test]
    fn nothing_run_is_no_pass() {
        assert!(Tests::default().finish().is_err());
    }
}
