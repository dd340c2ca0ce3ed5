//! Compiles the header of tinybvh-rs for this processor, as that crate does.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=Cargo.lock");
    println!("cargo:rerun-if-changed=src/shim.cpp");
    cc::Build::new()
        .cpp(true)
        .std("c++20")
        .include(header()?)
        .flag_if_supported("-march=native")
        // Build times are one thread's, as those of the other engines.
        .define("NO_THREADED_BUILDS", None)
        .opt_level(3)
        .warnings(false)
        .file("src/shim.cpp")
        .try_compile("raytwin_tinybvh_shim")?;
    Ok(())
}

/// Where cargo has unpacked the crate.
fn header() -> Result<PathBuf, Box<dyn Error>> {
    let output = Command::new(std::env::var("CARGO")?)
        .args(["metadata", "--format-version", "1", "--locked"])
        .current_dir(std::env::var("CARGO_MANIFEST_DIR")?)
        .output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into());
    }
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout)?;
    let packages = metadata["packages"].as_array().ok_or("no packages")?;
    let package = packages.iter().find(|p| p["name"] == "tinybvh-rs");
    let manifest = package.and_then(|p| p["manifest_path"].as_str());
    let folder = Path::new(manifest.ok_or("no tinybvh-rs")?).parent();
    Ok(folder.ok_or("no folder")?.join("ffi").join("tinybvh"))
}
