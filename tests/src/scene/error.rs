//! What can go wrong between a path and a mesh.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Where in the input something was found: the file and, for text formats,
/// the line (counted from 1).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The file as the caller named it.
    pub path: PathBuf,
    /// The line in it, where the format has lines.
    pub line: Option<usize>,
}

impl Place {
    /// A place that is a whole file.
    pub fn file(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            line: None,
        }
    }

    /// A line of a file, counted from 1.
    pub fn line(path: &Path, line: usize) -> Self {
        Self {
            path: path.to_owned(),
            line: Some(line),
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) => write!(f, "{}:{line}", self.path.display()),
            None => write!(f, "{}", self.path.display()),
        }
    }
}

/// An error of the mesh loaders. Every message names the file (and the line
/// where there is one), the value that was found, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// No file has this name.
    #[error("{}: no such file; check the path, which is relative to the current folder", .path.display())]
    Missing {
        /// The file asked for.
        path: PathBuf,
    },

    /// The path names a folder, a device or a pipe.
    #[error("{}: not a regular file; name an .obj, .gltf or .glb file", .path.display())]
    NotAFile {
        /// The path asked for.
        path: PathBuf,
    },

    /// The file exists and the system refuses to read it.
    #[error("{}: cannot be read ({source}); check its permissions and the disk", .path.display())]
    Unreadable {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },

    /// The name ends in nothing that a loader knows.
    #[error("{}: unknown extension `{extension}`; convert the mesh to .obj, .gltf or .glb", .path.display())]
    UnknownExtension {
        /// The file asked for.
        path: PathBuf,
        /// Its extension, empty when it has none.
        extension: String,
    },

    /// The file, or a glTF's buffers together, are above [`Limits::file_bytes`](super::Limits).
    #[error("{}: more than the limit of {limit} bytes; split or simplify the mesh", .path.display())]
    FileTooLarge {
        /// The file, or the buffer file.
        path: PathBuf,
        /// The limit in bytes.
        limit: u64,
    },

    /// An OBJ statement that cannot be understood.
    #[error("{at}: broken OBJ: {problem}; {mend}")]
    BrokenObj {
        /// The file and line.
        at: Place,
        /// What was found.
        problem: String,
        /// What to do about it.
        mend: &'static str,
    },

    /// A glTF or GLB file that contradicts the format.
    #[error("{}: broken glTF: {problem}; export the file again, or run the Khronos glTF validator on it", .path.display())]
    BrokenGltf {
        /// The glTF or GLB file.
        path: PathBuf,
        /// What was found, naming the element.
        problem: String,
    },

    /// A valid glTF that uses what this loader leaves out.
    #[error("{}: unsupported glTF: {problem}; {mend}", .path.display())]
    UnsupportedGltf {
        /// The glTF or GLB file.
        path: PathBuf,
        /// What is used, naming the element.
        problem: String,
        /// What to do about it.
        mend: &'static str,
    },

    /// A buffer file that a glTF refers to is missing or cannot be read.
    #[error("{}: buffer file `{uri}` cannot be read ({source}); put it beside the glTF, or export as .glb", .path.display())]
    Buffer {
        /// The glTF file.
        path: PathBuf,
        /// The reference as it stands in the glTF.
        uri: String,
        /// What the system said.
        source: io::Error,
    },

    /// A coordinate is NaN or infinite, or overflows f32.
    #[error(
        "{at}: vertex {vertex} has a NaN or infinite coordinate ({value}); remove the vertex or export the mesh again"
    )]
    NonFinite {
        /// The file, and line in an OBJ.
        at: Place,
        /// The vertex, counted from 0 (in a glTF within its primitive).
        vertex: usize,
        /// The coordinates as found.
        value: String,
    },

    /// A coordinate is beyond [`MAX_COORDINATE`](super::MAX_COORDINATE).
    #[error(
        "{at}: vertex {vertex} at ({value}) is beyond {limit:e}, where products of three coordinates overflow f32; scale the mesh down"
    )]
    TooFar {
        /// The file, and line in an OBJ.
        at: Place,
        /// The vertex, counted from 0 (in a glTF within its primitive).
        vertex: usize,
        /// The coordinates as found.
        value: String,
        /// The largest magnitude allowed.
        limit: f32,
    },

    /// A face names a vertex that does not exist.
    #[error(
        "{at}: vertex index {index} is out of range ({vertices} vertices, indices {base}); repair the face or export the mesh again"
    )]
    IndexOutOfRange {
        /// The file, and line in an OBJ.
        at: Place,
        /// The index as it stands in the file.
        index: i64,
        /// How many vertices there are to choose from.
        vertices: usize,
        /// How the format counts.
        base: &'static str,
    },

    /// There is not one triangle.
    #[error("{}: the mesh has no triangles ({vertices} vertices, {skipped} points or lines); export it with faces", .path.display())]
    EmptyMesh {
        /// The file.
        path: PathBuf,
        /// Vertices found.
        vertices: usize,
        /// Points and lines found.
        skipped: usize,
    },

    /// More triangles or vertices than [`Limits`](super::Limits) allows.
    #[error("{at}: more than the limit of {limit} {what}; simplify or split the mesh")]
    TooLarge {
        /// The file, and line in an OBJ.
        at: Place,
        /// `triangles`, `vertices` or `nodes`.
        what: &'static str,
        /// How many are allowed.
        limit: usize,
    },

    /// The default scene could not be located.
    #[error("{}: the kitchen scene of the obvhs package was not found ({problem}); run `cargo fetch` in the workspace, or name a mesh with --scene", .path.display())]
    KitchenMissing {
        /// The manifest whose dependencies were searched.
        path: PathBuf,
        /// Why it was not found.
        problem: String,
    },

    /// The default scene could not be unpacked.
    #[error("{}: cannot be decompressed ({problem}); the package is damaged, delete it from the cargo registry and run `cargo fetch`", .path.display())]
    Decompress {
        /// The compressed file.
        path: PathBuf,
        /// What the decoder said.
        problem: String,
    },
}
