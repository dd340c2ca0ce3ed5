//! Writes each kernel's golden vectors into tests/golden.
//!
//! `cargo xtask golden`

use std::io::Error;
use std::path::Path;
use std::process::ExitCode;

use raytwin_tests::golden;

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace");
    match write(root) {
        Ok((files, bytes)) => {
            println!("{files} files, {} kB in tests/golden", bytes / 1000);
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// All files into a folder beside, which then takes the old one's place: no file
/// of a kernel that is gone stays.
fn write(root: &Path) -> Result<(usize, usize), String> {
    let (fresh, old, last) = (
        root.join("tests/golden.new"),
        root.join("tests/golden.old"),
        root.join("tests/golden"),
    );
    let at = |path: &Path, e: Error| format!("{}: {e}", path.display());
    for folder in [&fresh, &old] {
        if folder.exists() {
            std::fs::remove_dir_all(folder).map_err(|e| at(folder, e))?;
        }
    }
    let (mut files, mut bytes) = (0, 0);
    for kernel in raytwin::registry().into_iter().flat_map(|t| t.kernels) {
        let name = golden::path(&kernel);
        let name = name.strip_prefix("tests/golden").unwrap_or(&name);
        let path = fresh.join(name);
        let folder = path.parent().unwrap_or(&fresh);
        std::fs::create_dir_all(folder).map_err(|e| at(folder, e))?;
        let text = golden::text(&golden::golden(&kernel));
        bytes += text.len();
        files += 1;
        std::fs::write(&path, text).map_err(|e| at(&path, e))?;
    }
    if last.exists() {
        std::fs::rename(&last, &old).map_err(|e| at(&last, e))?;
    }
    std::fs::rename(&fresh, &last).map_err(|e| at(&fresh, e))?;
    if old.exists() {
        std::fs::remove_dir_all(&old).map_err(|e| at(&old, e))?;
    }
    Ok((files, bytes))
}
