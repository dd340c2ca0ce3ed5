//! From a path to bytes, and where the known scenes lie.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::error::SceneError;
use super::mesh::{Limits, Mesh};
use super::{gltf_file, obj};

/// Loads an `.obj`, `.gltf` or `.glb` file within the default [`Limits`].
///
/// # Errors
/// Every [`SceneError`] but the kitchen's; the message names the file.
pub fn load_path(path: impl AsRef<Path>) -> Result<Mesh, SceneError> {
    load_path_with(path, &Limits::default())
}

/// [`load_path`] within other limits.
///
/// # Errors
/// As [`load_path`].
pub fn load_path_with(path: impl AsRef<Path>, limits: &Limits) -> Result<Mesh, SceneError> {
    let path = path.as_ref();
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let parse = match extension.as_str() {
        "obj" => obj::parse,
        "gltf" | "glb" => gltf_file::parse,
        // A missing file is the better message, whatever its name.
        _ if !path.exists() => {
            return Err(SceneError::Missing {
                path: path.to_owned(),
            });
        }
        _ => {
            return Err(SceneError::UnknownExtension {
                path: path.to_owned(),
                extension,
            });
        }
    };
    let bytes = read_limited(path, limits.file_bytes).map_err(|failure| match failure {
        ReadFailure::TooLarge => SceneError::FileTooLarge {
            path: path.to_owned(),
            limit: limits.file_bytes,
        },
        ReadFailure::NotAFile => SceneError::NotAFile {
            path: path.to_owned(),
        },
        ReadFailure::Io(e) if e.kind() == io::ErrorKind::NotFound => SceneError::Missing {
            path: path.to_owned(),
        },
        ReadFailure::Io(source) => SceneError::Unreadable {
            path: path.to_owned(),
            source,
        },
    })?;
    parse(path, &bytes, limits)
}

/// Why a file was not read.
pub(super) enum ReadFailure {
    TooLarge,
    NotAFile,
    Io(io::Error),
}

/// Reads a regular file of `limit` bytes at most; its size is checked before
/// memory is taken, and again while reading in case the file grows.
pub(super) fn read_limited(path: &Path, limit: u64) -> Result<Vec<u8>, ReadFailure> {
    // Asked of the path first: opening a pipe would wait for its writer.
    let metadata = std::fs::metadata(path).map_err(ReadFailure::Io)?;
    if !metadata.is_file() {
        return Err(ReadFailure::NotAFile);
    }
    if metadata.len() > limit {
        return Err(ReadFailure::TooLarge);
    }
    let file = File::open(path).map_err(ReadFailure::Io)?;
    let mut bytes = Vec::with_capacity(usize::try_from(metadata.len()).unwrap_or(0) + 1);
    file.take(limit.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(ReadFailure::Io)?;
    if bytes.len() as u64 > limit {
        return Err(ReadFailure::TooLarge);
    }
    Ok(bytes)
}

/// The manifest of this crate, whose dependencies hold the kitchen.
fn manifest() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")
}

/// The kitchen of 56,939 triangles that ships inside the obvhs package
/// (`assets/kitchen.obj.zst`), located through `cargo metadata`.
///
/// # Errors
/// [`SceneError::KitchenMissing`], [`SceneError::Decompress`], or those of
/// [`load_path`].
pub fn kitchen() -> Result<Mesh, SceneError> {
    let path = kitchen_path()?;
    let limits = Limits::default();
    let decompress = |problem: String| SceneError::Decompress {
        path: path.clone(),
        problem,
    };
    let file = File::open(&path).map_err(|source| SceneError::Unreadable {
        path: path.clone(),
        source,
    })?;
    let decoder = ruzstd::decoding::StreamingDecoder::new(io::BufReader::new(file))
        .map_err(|e| decompress(e.to_string()))?;
    let mut bytes = Vec::new();
    decoder
        .take(limits.file_bytes)
        .read_to_end(&mut bytes)
        .map_err(|e| decompress(e.to_string()))?;
    obj::parse(&path, &bytes, &limits)
}

/// Where `kitchen.obj.zst` lies on this machine.
///
/// # Errors
/// [`SceneError::KitchenMissing`].
pub fn kitchen_path() -> Result<PathBuf, SceneError> {
    let manifest = manifest();
    let missing = |problem: String| SceneError::KitchenMissing {
        path: manifest.clone(),
        problem,
    };
    // Offline first, and for this platform alone: everything is there once
    // the workspace has been built, and nothing else is fetched for it.
    let mut options = vec!["--locked".to_owned()];
    if let Some(host) = host_triple() {
        options.extend(["--filter-platform".to_owned(), host]);
    }
    let ask = |offline: bool| {
        let mut options = options.clone();
        if offline {
            options.push("--offline".to_owned());
        }
        cargo_metadata::MetadataCommand::new()
            .manifest_path(&manifest)
            .other_options(options)
            .exec()
    };
    let metadata = ask(true)
        .or_else(|_| ask(false))
        .map_err(|e| missing(e.to_string()))?;
    metadata
        .packages
        .iter()
        .filter(|p| p.name.as_str() == "obvhs")
        .filter_map(|p| Some(p.manifest_path.parent()?.join("assets/kitchen.obj.zst")))
        .map(PathBuf::from)
        .find(|p| p.is_file())
        .ok_or_else(|| missing("no version of obvhs in the build has the asset".into()))
}

fn host_triple() -> Option<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = std::process::Command::new(rustc).arg("-vV").output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let host = text.lines().find_map(|l| l.strip_prefix("host: "))?;
    Some(host.trim().to_owned())
}

/// Where the Sponza atrium lies, if it does: the file that the environment
/// variable `RAYTWIN_SPONZA` names, else `../shared/meshes/sponza.obj` beside
/// the workspace. The variable's file is returned even where it does not
/// exist, so that loading it says so.
pub fn sponza_path() -> Option<PathBuf> {
    if let Some(path) = std::env::var_os("RAYTWIN_SPONZA") {
        return Some(path.into());
    }
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent()?;
    let path = workspace.parent()?.join("shared/meshes/sponza.obj");
    path.is_file().then_some(path)
}
