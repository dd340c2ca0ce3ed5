//! A Vulkan driver for the tests: whatever is there, else Mesa's software one.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::packages::{InstallError, Packages};

/// What the children need to know.
pub struct Vulkan {
    /// Environment variables to set.
    pub variables: Vec<(String, String)>,
}

impl Vulkan {
    /// Leaves the extra driver out; whether there was one.
    pub fn leave_out_swiftshader(&mut self) -> bool {
        let before = self.variables.len();
        self.variables.retain(|(name, _)| name != EXTRA_DRIVERS);
        self.variables.len() < before
    }
}

/// The loader's variable for drivers beside the system's.
const EXTRA_DRIVERS: &str = "VK_ADD_DRIVER_FILES";

/// Why there is no driver.
#[derive(Debug)]
pub enum VulkanError {
    /// No package manager that we know.
    NoPackageManager,
    /// The package manager did not succeed.
    Install(String),
    /// It did, and there is still no driver.
    StillMissing,
    /// A file of ours could not be written.
    Write(PathBuf, std::io::Error),
}

const MEND: &str = "install a Vulkan driver yourself (Debian and Ubuntu: mesa-vulkan-drivers and \
                    libvulkan1; Fedora: mesa-vulkan-drivers and vulkan-loader; Arch: \
                    vulkan-swrast and vulkan-icd-loader) and run this again";

impl fmt::Display for VulkanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoPackageManager => {
                write!(f, "no Vulkan driver and no known package manager: {MEND}")
            }
            Self::Install(what) => write!(f, "no Vulkan driver, and `{what}` failed: {MEND}"),
            Self::StillMissing => write!(f, "no Vulkan driver even after installing: {MEND}"),
            Self::Write(path, e) => write!(f, "cannot write {}: {e}", path.display()),
        }
    }
}

/// Finds a driver or installs Mesa's, and adds Chromium's SwiftShader where
/// that is installed.
///
/// # Errors
/// If there is no driver in the end.
pub fn ensure(root: &Path) -> Result<Vulkan, VulkanError> {
    let mut variables = Vec::new();
    // Metal and DX12 come with their systems.
    if cfg!(target_os = "linux") {
        if !present() {
            install()?;
            if !present() {
                return Err(VulkanError::StillMissing);
            }
        }
        if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
            // Mesa complains on stderr without one.
            let folder = root.join("target").join("xdg-runtime");
            std::fs::create_dir_all(&folder).map_err(|e| VulkanError::Write(folder.clone(), e))?;
            variables.push(("XDG_RUNTIME_DIR".into(), folder.display().to_string()));
        }
        if let Some(manifest) = swiftshader(root)? {
            variables.push((EXTRA_DRIVERS.into(), manifest.display().to_string()));
        }
    }
    Ok(Vulkan { variables })
}

/// Whether the loader and at least one driver's manifest are there.
fn present() -> bool {
    if std::env::var_os("VK_DRIVER_FILES").is_some()
        || std::env::var_os("VK_ICD_FILENAMES").is_some()
    {
        return true;
    }
    let manifests = [
        "/usr/share/vulkan/icd.d",
        "/etc/vulkan/icd.d",
        "/usr/local/share/vulkan/icd.d",
        "/run/opengl-driver/share/vulkan/icd.d",
    ];
    let driver = manifests.iter().any(|folder| {
        std::fs::read_dir(folder).is_ok_and(|entries| {
            entries
                .flatten()
                .any(|e| e.path().extension().is_some_and(|x| x == "json"))
        })
    });
    driver && loader()
}

fn loader() -> bool {
    let listed = Command::new("ldconfig")
        .arg("-p")
        .output()
        .or_else(|_| Command::new("/sbin/ldconfig").arg("-p").output());
    match listed {
        Ok(output) => String::from_utf8_lossy(&output.stdout).contains("libvulkan.so.1"),
        // Without ldconfig there is no telling; the tests will.
        Err(_) => true,
    }
}

fn install() -> Result<(), VulkanError> {
    let packages = Packages {
        apt: &["mesa-vulkan-drivers", "libvulkan1"],
        dnf: &["mesa-vulkan-drivers", "vulkan-loader"],
        pacman: &["vulkan-swrast", "vulkan-icd-loader"],
    };
    packages
        .install("no Vulkan driver found; installing Mesa's software driver")
        .map_err(|e| match e {
            InstallError::NoPackageManager => VulkanError::NoPackageManager,
            InstallError::Failed(line) => VulkanError::Install(line),
        })
}

/// A manifest for the SwiftShader that Chromium ships, where it is installed:
/// a second driver and a second opinion, at no cost.
fn swiftshader(root: &Path) -> Result<Option<PathBuf>, VulkanError> {
    let libraries = [
        "/usr/lib/chromium/libvk_swiftshader.so",
        "/usr/lib64/chromium-browser/libvk_swiftshader.so",
        "/usr/lib/chromium-browser/libvk_swiftshader.so",
        "/opt/google/chrome/libvk_swiftshader.so",
    ];
    let Some(library) = libraries.iter().find(|l| Path::new(l).is_file()) else {
        return Ok(None);
    };
    let folder = root.join("target");
    let manifest = folder.join("swiftshader-icd.json");
    let text = format!(
        "{{\"file_format_version\": \"1.0.0\", \"ICD\": \
         {{\"library_path\": \"{library}\", \"api_version\": \"1.3.0\"}}}}\n"
    );
    std::fs::create_dir_all(&folder)
        .and_then(|()| std::fs::write(&manifest, text))
        .map_err(|e| VulkanError::Write(manifest.clone(), e))?;
    Ok(Some(manifest))
}
