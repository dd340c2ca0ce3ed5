//! A C++ compiler: the report measures FLIP with NVIDIA's own code.

use std::fmt;

use crate::packages::{InstallError, Packages, on_path};

/// Why there is no compiler.
#[derive(Debug)]
pub enum CompilerError {
    /// No package manager that we know.
    NoPackageManager,
    /// The package manager did not succeed.
    Install(String),
    /// It did, and there is still no `c++`.
    StillMissing,
}

const MEND: &str = "install one yourself (Debian and Ubuntu: g++; Fedora: gcc-c++; Arch: gcc), or \
                    name yours in the variable CXX, and run this again";

impl fmt::Display for CompilerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPackageManager => {
                write!(f, "no C++ compiler and no known package manager: {MEND}")
            }
            Self::Install(what) => write!(f, "no C++ compiler, and `{what}` failed: {MEND}"),
            Self::StillMissing => write!(f, "no C++ compiler even after installing: {MEND}"),
        }
    }
}

/// Finds a C++ compiler or installs GCC's.
///
/// # Errors
/// If there is none in the end.
pub fn ensure() -> Result<(), CompilerError> {
    // Elsewhere Rust itself needs the system's compiler, which has C++.
    if !cfg!(target_os = "linux") || std::env::var_os("CXX").is_some() || on_path("c++") {
        return Ok(());
    }
    let packages = Packages {
        apt: &["g++"],
        dnf: &["gcc-c++"],
        pacman: &["gcc"],
    };
    packages
        .install("no C++ compiler found (for the metric FLIP); installing GCC's")
        .map_err(|e| match e {
            InstallError::NoPackageManager => CompilerError::NoPackageManager,
            InstallError::Failed(line) => CompilerError::Install(line),
        })?;
    if on_path("c++") {
        Ok(())
    } else {
        Err(CompilerError::StillMissing)
    }
}
