//! The system's package manager, for what cargo cannot build.

use std::process::Command;

/// The packages' names, by package manager.
pub struct Packages {
    /// Debian and Ubuntu.
    pub apt: &'static [&'static str],
    /// Fedora.
    pub dnf: &'static [&'static str],
    /// Arch.
    pub pacman: &'static [&'static str],
}

/// Why nothing was installed.
#[derive(Debug)]
pub enum InstallError {
    /// No package manager that we know.
    NoPackageManager,
    /// This command did not succeed.
    Failed(String),
}

impl Packages {
    /// Installs them; says `why` and with which command first.
    ///
    /// # Errors
    /// If there is no known package manager, or it fails.
    pub fn install(&self, why: &str) -> Result<(), InstallError> {
        let update: &[&str] = &["update"];
        let apt: &[&str] = &["install", "--yes", "--no-install-recommends"];
        let (manager, calls, packages) = if on_path("apt-get") {
            ("apt-get", vec![update, apt], self.apt)
        } else if on_path("dnf") {
            ("dnf", vec![["install", "--assumeyes"].as_slice()], self.dnf)
        } else if on_path("pacman") {
            (
                "pacman",
                vec![["-S", "--noconfirm"].as_slice()],
                self.pacman,
            )
        } else {
            return Err(InstallError::NoPackageManager);
        };
        let sudo = !is_root() && on_path("sudo");
        for (i, call) in calls.iter().enumerate() {
            let mut words = vec![manager];
            words.extend_from_slice(call);
            if i + 1 == calls.len() {
                words.extend_from_slice(packages);
            }
            if sudo {
                words.insert(0, "sudo");
            }
            let line = words.join(" ");
            println!("{why}: {line}");
            let status = Command::new(words[0])
                .args(&words[1..])
                .env("DEBIAN_FRONTEND", "noninteractive")
                .status();
            if !status.is_ok_and(|s| s.success()) {
                return Err(InstallError::Failed(line));
            }
        }
        Ok(())
    }
}

/// Whether a program is there.
pub fn on_path(program: &str) -> bool {
    std::env::var_os("PATH")
        .is_some_and(|path| std::env::split_paths(&path).any(|dir| dir.join(program).is_file()))
}

fn is_root() -> bool {
    Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|o| o.stdout.trim_ascii() == b"0")
}
