//! The npm package, and the test in a real browser: Node, headless Chromium.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::packages::{InstallError, Packages, on_path};
use crate::run::{self, Environment, Failure, Tests};

/// Writes the npm package into `target/npm/raytwin`.
///
/// # Errors
/// If a file cannot be written.
pub fn npm(environment: &Environment) -> Result<(), Failure> {
    environment.cargo("npm", &example("npm", &[]), &[])
}

/// Links the npm package's modules, compiles every program with the browser's
/// compiler and runs every kernel over its golden vectors. Skipped, loudly,
/// without Node or Chromium.
///
/// # Errors
/// If a step does not run.
pub fn test(root: &Path, environment: &Environment, tests: &mut Tests) -> Result<(), Failure> {
    let Some(browser) = Browser::ready(root, tests)? else {
        return Ok(());
    };
    let data = root.join("target").join("web").join("data");
    let written = data.display().to_string();
    environment.cargo("web", &example("web", &[&written]), &[])?;
    npm(environment)?;
    let package = root.join("target").join("npm").join("raytwin");
    browser.node("npm.mjs", &[&package, &data], tests)?;
    browser.node("driver.mjs", &[&data, &browser.chromium], tests)
}

/// Headless Chromium, and a folder with its driver.
pub struct Browser {
    /// Chromium's program.
    pub chromium: PathBuf,
    folder: PathBuf,
}

impl Browser {
    /// Finds or installs what is needed; `None`, loudly, without Node or Chromium.
    ///
    /// # Errors
    /// If a file cannot be copied or npm fails.
    pub fn ready(root: &Path, tests: &mut Tests) -> Result<Option<Self>, Failure> {
        let mut skip = |why: &str| {
            tests.skip(format!("what runs in a browser: {why}"));
            Ok(None)
        };
        if !(on_path("node") && on_path("npm")) {
            return skip("Node (20 or newer) with npm is not here");
        }
        let chromium = match chromium() {
            Ok(path) => path,
            Err(why) => return skip(&why),
        };
        let folder = root.join("target").join("web").join("node");
        std::fs::create_dir_all(&folder).map_err(|e| cannot(&folder, &e))?;
        let from = root.join("tests").join("web");
        let files = std::fs::read_dir(&from).map_err(|e| cannot(&from, &e))?;
        for file in files.flatten() {
            let to = folder.join(file.file_name());
            std::fs::copy(file.path(), &to).map_err(|e| cannot(&to, &e))?;
        }
        println!(
            "the browser's driver and the linker wesl-js go into {}",
            folder.display()
        );
        let mut install = program("npm");
        install.args([
            "ci",
            "--ignore-scripts",
            "--no-audit",
            "--no-fund",
            "--silent",
        ]);
        let status = install.current_dir(&folder).status();
        let status = status.map_err(|e| Failure::Start("npm".into(), e))?;
        if !status.success() {
            return Err(Failure::Step("npm ci", 1));
        }
        Ok(Some(Self { chromium, folder }))
    }

    /// Runs one of the folder's scripts and counts what it tests.
    ///
    /// # Errors
    /// If it does not start, or ends badly without a failed test.
    pub fn node(
        &self,
        script: &'static str,
        arguments: &[&Path],
        tests: &mut Tests,
    ) -> Result<(), Failure> {
        let mut command = program("node");
        command.arg(script).args(arguments);
        command.current_dir(&self.folder);
        run::counted(command, script, tests)
    }
}

/// npm is a script on Windows.
fn program(name: &str) -> Command {
    if cfg!(windows) && name == "npm" {
        Command::new("npm.cmd")
    } else {
        Command::new(name)
    }
}

pub fn cannot(path: &Path, error: &std::io::Error) -> Failure {
    Failure::Setup(format!("{}: {error}", path.display()))
}

pub fn example<'a>(name: &'a str, arguments: &[&'a str]) -> Vec<&'a str> {
    let run = ["run", "--quiet", "--package", "raytwin-tests"];
    let mut all = [run.as_slice(), &["--example", name, "--"]].concat();
    all.extend(arguments);
    all
}

/// Chromium or Chrome: `CHROMIUM`, or on the path, or installed now.
fn chromium() -> Result<PathBuf, String> {
    if let Some(given) = std::env::var_os("CHROMIUM") {
        return Ok(given.into());
    }
    let find = || {
        let names = [
            "chromium",
            "chromium-browser",
            "google-chrome",
            "google-chrome-stable",
        ];
        let path = std::env::var_os("PATH")?;
        let folders: Vec<_> = std::env::split_paths(&path).collect();
        let mut places = names
            .iter()
            .flat_map(|n| folders.iter().map(move |f| f.join(n)));
        places.find(|p| p.is_file())
    };
    if let Some(found) = find() {
        return Ok(found);
    }
    let packages = Packages {
        apt: &["chromium"],
        dnf: &["chromium"],
        pacman: &["chromium"],
    };
    let mend = "install Chromium or Chrome, or name one in CHROMIUM";
    match packages.install("Chromium is missing, which compiles WGSL with Tint") {
        Ok(()) => find().ok_or_else(|| format!("no Chromium even after installing it: {mend}")),
        Err(InstallError::NoPackageManager) => Err(format!("no Chromium: {mend}")),
        Err(InstallError::Failed(what)) => Err(format!("no Chromium, and `{what}` failed: {mend}")),
    }
}
