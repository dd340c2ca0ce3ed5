//! Why there is no report.

use std::path::PathBuf;

use raytwin::pass::bvh8::Bvh8Fault;
use raytwin::pass::image::PassError;
use raytwin::ray::bvh_build::BvhError;
use raytwin_tests::embree::EmbreeError;
use raytwin_tests::gpu::{GpuError, ProgramError};
use raytwin_tests::scene::SceneError;

use crate::stages::StageError;

/// Why there is no report. Messages are one line: what, where, and the mend.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A mesh does not load.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A mesh loads and has no tree.
    #[error("{mesh}: {source}")]
    Bvh {
        /// Which mesh.
        mesh: String,
        /// What is wrong.
        source: BvhError,
    },
    /// A tree cannot be collapsed: a fault of the builder.
    #[error("{mesh}: {source}")]
    Wide {
        /// Which mesh.
        mesh: String,
        /// What is wrong.
        source: Bvh8Fault,
    },
    /// A stage does not run.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// `--only` matches nothing.
    #[error("--only {wanted} matches no kernel, stage or mesh; there are for example {some}")]
    Nothing {
        /// What was asked for.
        wanted: String,
        /// A few names.
        some: String,
    },
    /// No adapter, or not the one asked for.
    #[error("{0}; or leave the GPU out with --cpu")]
    Gpu(GpuError),
    /// A kernel does not compile for an adapter.
    #[error(transparent)]
    Program(#[from] ProgramError),
    /// A pass cannot be made or bound.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// The traversal shader is not taken.
    #[error("{adapter} does not take the traversal program: {message}")]
    Traversal {
        /// Which adapter.
        adapter: String,
        /// What it said.
        message: String,
    },
    /// Embree is there and refuses.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// The output folder.
    #[error(
        "{}: the report cannot be written there ({source}); choose a folder that you may write to \
         with --out DIR",
        path.display()
    )]
    Output {
        /// The folder or file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The folder is a file.
    #[error("{}: is a file, not a folder; choose another with --out DIR", path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// A plot is not drawn.
    #[error("the plot `{title}` could not be drawn: {message}")]
    Plot {
        /// Which plot.
        title: String,
        /// What the library said.
        message: String,
    },
    /// `report.json` is not written.
    #[error("report.json could not be encoded: {0}")]
    Json(#[from] serde_json::Error),
}

impl ReportError {
    /// 2 for what the caller can mend, 1 for what only we can.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Program(_) | Self::Traversal { .. } | Self::Plot { .. } | Self::Json(_) => 1,
            Self::Stage(StageError::Link(_) | StageError::Shader { .. } | StageError::Png(_)) => 1,
            _ => 2,
        }
    }
}
