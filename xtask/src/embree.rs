//! Embree 4 for the tests: the peer that the traversal is compared with.
//!
//! Looked for in this order: `EMBREE_LIB`, `target/embree`, the system's
//! library, and last the wheel that PyPI has, which needs neither root nor a
//! compiler.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Version of the wheel, and the sha256 of the Linux one.
const WHEEL: &str = "embreex==4.4.0.post1";
const LINUX_SHA256: &str = "2cd0f7d5c6342e6247e31f700761689cae7829454d8c6de0c41e62124a023e1f";

const MEND: &str = "install Embree 4 yourself (Debian 13 and Ubuntu 24.04: libembree-dev; \
                    Homebrew: embree) or set EMBREE_LIB to a libembree4 and run this again";

/// Why there is no Embree.
#[derive(Debug, thiserror::Error)]
pub enum EmbreeSetupError {
    /// `EMBREE_LIB` names no file.
    #[error("EMBREE_LIB is `{}`, which is no file; correct or unset it", .0.display())]
    BadVariable(PathBuf),
    /// No wheel exists for this system.
    #[error("PyPI has no Embree for this system ({0}): {MEND}")]
    NoWheel(String),
    /// A command did not succeed.
    #[error("`{0}` failed: {1}; {MEND}")]
    Command(String, String),
    /// The wheel is not the one expected.
    #[error("the downloaded wheel has sha256 {found}, not {expected}; nothing was kept. {MEND}")]
    Checksum {
        /// What it should be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// The wheel holds no library.
    #[error(
        "{} holds no libembree4; delete it and run this again, or: {MEND}", .0.display()
    )]
    NoLibrary(PathBuf),
    /// A file of ours could not be written.
    #[error("cannot write {}: {error}", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why not.
        #[source]
        error: std::io::Error,
    },
}

/// Where Embree was found.
#[derive(Debug, PartialEq, Eq)]
pub enum Found {
    /// Named by `EMBREE_LIB`.
    Variable(PathBuf),
    /// Under `target/embree`, from an earlier set-up or just now.
    Target(PathBuf),
    /// In the system's library path.
    System(PathBuf),
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variable(path) => write!(f, "{} (EMBREE_LIB)", path.display()),
            Self::Target(path) | Self::System(path) => write!(f, "{}", path.display()),
        }
    }
}

/// Finds Embree 4 or brings it.
///
/// # Errors
/// If it is not there in the end.
pub fn ensure(root: &Path) -> Result<Found, EmbreeSetupError> {
    let named = std::env::var_os("EMBREE_LIB").map(PathBuf::from);
    let folder = root.join("target").join("embree");
    if let Some(found) = find(named, &folder, system)? {
        return Ok(found);
    }
    download(root, &folder)?;
    library_in(&folder, 3)
        .map(Found::Target)
        .ok_or(EmbreeSetupError::NoLibrary(folder))
}

/// What is there already, in the order of precedence.
fn find(
    named: Option<PathBuf>,
    folder: &Path,
    system: impl FnOnce() -> Option<PathBuf>,
) -> Result<Option<Found>, EmbreeSetupError> {
    if let Some(named) = named {
        return if named.is_file() {
            Ok(Some(Found::Variable(named)))
        } else {
            Err(EmbreeSetupError::BadVariable(named))
        };
    }
    if let Some(library) = library_in(folder, 3) {
        return Ok(Some(Found::Target(library)));
    }
    Ok(system().map(Found::System))
}

/// The library in a folder or below it.
fn library_in(folder: &Path, depth: usize) -> Option<PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder)
        .ok()?
        .flatten()
        .map(|e| e.path())
        .collect();
    entries.sort();
    let is_library = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.contains("embree4")
            && (name.contains(".so") || name.ends_with(".dylib") || name.ends_with(".dll"))
    };
    if let Some(found) = entries.iter().find(|p| p.is_file() && is_library(p)) {
        return Some(found.clone());
    }
    if depth == 0 {
        return None;
    }
    entries
        .iter()
        .filter(|p| p.is_dir())
        .find_map(|p| library_in(p, depth - 1))
}

fn system() -> Option<PathBuf> {
    if cfg!(target_os = "macos") {
        return [
            "/opt/homebrew/lib/libembree4.dylib",
            "/usr/local/lib/libembree4.dylib",
        ]
        .iter()
        .map(PathBuf::from)
        .find(|p| p.is_file());
    }
    let output = Command::new("ldconfig")
        .arg("-p")
        .output()
        .or_else(|_| Command::new("/sbin/ldconfig").arg("-p").output())
        .ok()?;
    from_ldconfig(&String::from_utf8_lossy(&output.stdout))
}

/// The path in a line `libembree4.so.4 (libc6,x86-64) => /usr/lib/…`.
fn from_ldconfig(listing: &str) -> Option<PathBuf> {
    listing
        .lines()
        .filter(|line| line.trim_start().starts_with("libembree4.so.4"))
        .filter_map(|line| line.split("=> ").nth(1))
        .map(|path| PathBuf::from(path.trim()))
        .next()
}

/// The wheel's platform tag here.
fn platform() -> Option<&'static str> {
    match (std::env::consts::OS, std::env::consts::ARCH) {
        ("linux", "x86_64") => Some("manylinux_2_28_x86_64"),
        ("macos", "x86_64") => Some("macosx_13_0_x86_64"),
        ("macos", "aarch64") => Some("macosx_14_0_arm64"),
        ("windows", "x86_64") => Some("win_amd64"),
        _ => None,
    }
}

/// Turns an error at this path into ours.
fn writing(path: &Path) -> impl FnOnce(std::io::Error) -> EmbreeSetupError {
    let path = path.to_path_buf();
    |error| EmbreeSetupError::Write { path, error }
}

fn run(command: &mut Command) -> Result<String, EmbreeSetupError> {
    let line = format!("{command:?}").replace('"', "");
    let output = command
        .output()
        .map_err(|e| EmbreeSetupError::Command(line.clone(), e.to_string()))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let reason = String::from_utf8_lossy(&output.stderr).trim().to_string();
    Err(EmbreeSetupError::Command(line, reason))
}

/// A Python that has pip: the system's own, or one in a throw-away
/// environment where the distribution ships Python without it.
fn python(root: &Path) -> Result<PathBuf, EmbreeSetupError> {
    let name = if cfg!(windows) { "python" } else { "python3" };
    let has_pip = |python: &Path| {
        Command::new(python)
            .args(["-m", "pip", "--version"])
            .output()
            .is_ok_and(|o| o.status.success())
    };
    if has_pip(Path::new(name)) {
        return Ok(name.into());
    }
    let apt = std::env::var_os("PATH")
        .is_some_and(|p| std::env::split_paths(&p).any(|dir| dir.join("apt-get").is_file()));
    let root_user = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|o| o.stdout.trim_ascii() == b"0");
    if apt && root_user {
        println!("no pip found; installing it: apt-get install --yes python3-pip");
        run(Command::new("apt-get").arg("update"))?;
        run(Command::new("apt-get")
            .args(["install", "--yes", "--no-install-recommends", "python3-pip"])
            .env("DEBIAN_FRONTEND", "noninteractive"))?;
        if has_pip(Path::new(name)) {
            return Ok(name.into());
        }
    }
    let venv = root.join("target").join("python");
    println!("no pip found; making a virtual environment in target/python");
    run(Command::new(name).args(["-m", "venv"]).arg(&venv))?;
    Ok(venv.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    }))
}

fn download(root: &Path, folder: &Path) -> Result<(), EmbreeSetupError> {
    let platform = platform().ok_or_else(|| {
        EmbreeSetupError::NoWheel(format!(
            "{} {}",
            std::env::consts::OS,
            std::env::consts::ARCH
        ))
    })?;
    println!(
        "no Embree 4 found; downloading the PyPI wheel {WHEEL} (about 35 MB) to target/embree"
    );
    let python = python(root)?;
    // Made under another name and renamed: nothing half-written stays.
    let work = folder.with_file_name(format!("embree-{}.partial", std::process::id()));
    let result = fetch(&python, platform, &work).and_then(|()| {
        if folder.exists() {
            std::fs::remove_dir_all(folder).map_err(writing(folder))?;
        }
        std::fs::rename(&work, folder).map_err(writing(folder))
    });
    if result.is_err() {
        // The error above says more than one from tidying up would.
        let _ = std::fs::remove_dir_all(&work);
    }
    result
}

fn fetch(python: &Path, platform: &str, work: &Path) -> Result<(), EmbreeSetupError> {
    std::fs::create_dir_all(work).map_err(writing(work))?;
    run(Command::new(python)
        .args(["-m", "pip", "download", "--quiet", "--no-deps"])
        .args(["--only-binary", ":all:", "--implementation", "cp"])
        .args(["--python-version", "311", "--abi", "cp311"])
        .args(["--platform", platform, "--dest"])
        .arg(work)
        .arg(WHEEL))?;
    let wheel = std::fs::read_dir(work)
        .map_err(writing(work))?
        .flatten()
        .map(|e| e.path())
        .find(|p| p.extension().is_some_and(|x| x == "whl"))
        .ok_or_else(|| EmbreeSetupError::NoLibrary(work.into()))?;
    if std::env::consts::OS == "linux" {
        let script =
            "import hashlib,sys;print(hashlib.sha256(open(sys.argv[1],'rb').read()).hexdigest())";
        let found = run(Command::new(python).args(["-c", script]).arg(&wheel))?;
        if found.trim() != LINUX_SHA256 {
            return Err(EmbreeSetupError::Checksum {
                expected: LINUX_SHA256,
                found: found.trim().into(),
            });
        }
    }
    run(Command::new(python)
        .args(["-m", "zipfile", "-e"])
        .arg(&wheel)
        .arg(work))?;
    std::fs::remove_file(&wheel).map_err(writing(&wheel))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder of its own for each test, removed at its end.
    struct Scratch(PathBuf);

    impl Scratch {
        fn new(test: &str) -> Self {
            let name = format!("raytwin-embree-{test}-{}", std::process::id());
            let folder = std::env::temp_dir().join(name);
            std::fs::create_dir_all(&folder).unwrap();
            Self(folder)
        }
    }

    impl Drop for Scratch {
        fn drop(&mut self) {
            // What is left in the temporary folder harms nobody.
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn finds_the_library_below_a_folder() {
        let scratch = Scratch::new("below");
        let folder = &scratch.0;
        let inner = folder.join("embreex.libs");
        std::fs::create_dir_all(&inner).unwrap();
        assert_eq!(library_in(folder, 3), None);
        std::fs::write(inner.join("libtbb.so.12"), "").unwrap();
        assert_eq!(library_in(folder, 3), None);
        let library = inner.join("libembree4-4aef3270.so.4");
        std::fs::write(&library, "").unwrap();
        assert_eq!(library_in(folder, 3), Some(library));
        assert_eq!(library_in(folder, 0), None);
    }

    #[test]
    fn looks_at_the_variable_then_target_then_the_system() {
        let scratch = Scratch::new("order");
        let folder = &scratch.0;
        let system = || Some(PathBuf::from("/usr/lib/libembree4.so.4"));
        assert_eq!(find(None, folder, || None).unwrap(), None);
        assert_eq!(
            find(None, folder, system).unwrap(),
            system().map(Found::System)
        );
        let library = folder.join("libembree4.so.4");
        std::fs::write(&library, "").unwrap();
        assert_eq!(
            find(None, folder, system).unwrap(),
            Some(Found::Target(library))
        );
        let named = folder.join("mine.so");
        std::fs::write(&named, "").unwrap();
        assert_eq!(
            find(Some(named.clone()), folder, system).unwrap(),
            Some(Found::Variable(named))
        );
        // A wrong variable is an error, not a reason to take another library.
        let wrong = folder.join("absent.so");
        let error = find(Some(wrong.clone()), folder, system).unwrap_err();
        assert!(error.to_string().contains(&wrong.display().to_string()));
    }

    #[test]
    fn reads_ldconfig_and_leaves_embree_three() {
        let three = "\tlibembree3.so.3 (libc6,x86-64) => /usr/lib/libembree3.so.3\n";
        assert_eq!(from_ldconfig(three), None);
        let four = format!("{three}\tlibembree4.so.4 (libc6,x86-64) => /usr/lib/libembree4.so.4\n");
        assert_eq!(
            from_ldconfig(&four),
            Some(PathBuf::from("/usr/lib/libembree4.so.4"))
        );
    }
}
