//! tinybvh as a peer: its eight-wide AVX2 traversal in a process of its own.
//!
//! The program is `benches/tinybvh`, a workspace of its own since all of it is
//! compiled for the processor's instructions; `cargo xtask report` builds it.
//! A tree lives in one process, which waits while others are timed.
//!
//! Needs nothing but the standard library: the program's test takes this file.

use std::fmt;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, PoisonError};

/// Why tinybvh does not take part.
#[derive(Debug)]
pub enum TinybvhError {
    /// Nobody has built it.
    Missing(PathBuf),
    /// It does not start.
    Start(PathBuf, std::io::Error),
    /// It ended in the middle of an answer.
    Ended(String),
}

impl fmt::Display for TinybvhError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing(path) => write!(
                f,
                "{} is not there; `cargo xtask report` builds it where the processor has AVX2",
                path.display()
            ),
            Self::Start(path, error) => write!(f, "cannot start {}: {error}", path.display()),
            Self::Ended(how) => write!(f, "it ended with {how}"),
        }
    }
}

impl std::error::Error for TinybvhError {}

/// Origin, direction, `t_min` (which tinybvh takes as 0) and `t_max`.
pub type Ray8 = [f32; 8];

/// What came of some rays.
#[derive(Clone, Debug)]
pub struct Traced {
    /// How long they took.
    pub seconds: f64,
    /// How many hit.
    pub hits: usize,
    /// The closest hit of each, `t` and triangle, if they were asked for.
    pub closest: Vec<Option<(f32, u32)>>,
}

/// Where the program is.
#[derive(Clone, Debug)]
pub struct Tinybvh {
    program: PathBuf,
    /// Version of tinybvh.
    pub version: String,
}

impl Tinybvh {
    /// The program that `RAYTWIN_TINYBVH` names, or that of `cargo xtask report`.
    ///
    /// # Errors
    /// If it is not there or does not run.
    pub fn find() -> Result<Self, TinybvhError> {
        let program = std::env::var_os("RAYTWIN_TINYBVH").map_or_else(
            || {
                let file = format!("raytwin-tinybvh{}", std::env::consts::EXE_SUFFIX);
                Path::new(env!("CARGO_MANIFEST_DIR"))
                    .join("../target/tinybvh/release")
                    .join(file)
            },
            PathBuf::from,
        );
        Self::at(program)
    }

    /// The program at a path.
    ///
    /// # Errors
    /// If it is not there or does not run.
    pub fn at(program: PathBuf) -> Result<Self, TinybvhError> {
        if !program.is_file() {
            return Err(TinybvhError::Missing(program));
        }
        let (_, version) = Pipes::start(&program)?;
        let version = version.map(|v| v.to_string()).join(".");
        Ok(Self { program, version })
    }

    /// Builds a tree, on one thread: binned, or if `high` with splits.
    ///
    /// # Errors
    /// If the program does not start or gives up on the mesh.
    pub fn tree(
        &self,
        positions: &[[f32; 3]],
        indices: &[[u32; 3]],
        high: bool,
    ) -> Result<TinybvhTree, TinybvhError> {
        let (mut pipes, _) = Pipes::start(&self.program)?;
        let build_ms = pipes.mesh(positions, indices, high);
        match build_ms {
            Ok(build_ms) => Ok(TinybvhTree {
                pipes: Mutex::new(pipes),
                build_ms,
            }),
            Err(_) => Err(pipes.end()),
        }
    }
}

/// A tree of one mesh, in its process.
pub struct TinybvhTree {
    pipes: Mutex<Pipes>,
    /// How long it took to build.
    pub build_ms: f64,
}

impl TinybvhTree {
    /// Traces rays one by one, and tells the closest hits if `listed`.
    ///
    /// # Errors
    /// If the process ended.
    pub fn trace(
        &self,
        rays: &[Ray8],
        any: bool,
        listed: bool,
        threads: usize,
    ) -> Result<Traced, TinybvhError> {
        let mut pipes = self.pipes.lock().unwrap_or_else(PoisonError::into_inner);
        let traced = pipes.trace(rays, any, listed, threads);
        traced.map_err(|_| pipes.end())
    }
}

struct Pipes {
    child: Child,
    input: BufWriter<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Drop for Pipes {
    fn drop(&mut self) {
        // It has ended by itself, or holds nothing that is worth waiting for.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Pipes {
    fn start(program: &Path) -> Result<(Self, [u32; 3]), TinybvhError> {
        let failed = |error| TinybvhError::Start(program.into(), error);
        let mut child = Command::new(program)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(failed)?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(failed(std::io::ErrorKind::BrokenPipe.into()));
        };
        let mut pipes = Self {
            child,
            input: BufWriter::with_capacity(1 << 20, input),
            output: BufReader::with_capacity(1 << 20, output),
        };
        let mut version = [0; 3];
        for number in &mut version {
            match pipes.read() {
                Ok(bytes) => *number = u32::from_le_bytes(bytes),
                Err(_) => return Err(pipes.end()),
            }
        }
        Ok((pipes, version))
    }

    /// How it ended.
    fn end(&mut self) -> TinybvhError {
        // It ends by itself once nothing more comes; what fails says so below.
        let _ = self.input.flush();
        let how = match self.child.wait() {
            Ok(status) => status.to_string(),
            Err(error) => error.to_string(),
        };
        TinybvhError::Ended(how)
    }

    fn read<const N: usize>(&mut self) -> std::io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.output.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn integers(&mut self, numbers: &[u32]) -> std::io::Result<()> {
        numbers
            .iter()
            .try_for_each(|n| self.input.write_all(&n.to_le_bytes()))
    }

    fn floats(&mut self, numbers: &[f32]) -> std::io::Result<()> {
        numbers
            .iter()
            .try_for_each(|n| self.input.write_all(&n.to_le_bytes()))
    }

    fn mesh(
        &mut self,
        positions: &[[f32; 3]],
        indices: &[[u32; 3]],
        high: bool,
    ) -> std::io::Result<f64> {
        self.input.write_all(b"M")?;
        let (vertices, triangles) = (positions.len() as u32, indices.len() as u32);
        self.integers(&[u32::from(high), vertices, triangles])?;
        positions.iter().try_for_each(|p| self.floats(p))?;
        indices.iter().try_for_each(|t| self.integers(t))?;
        self.input.flush()?;
        Ok(f64::from_le_bytes(self.read()?))
    }

    fn trace(
        &mut self,
        rays: &[Ray8],
        any: bool,
        listed: bool,
        threads: usize,
    ) -> std::io::Result<Traced> {
        self.input.write_all(b"T")?;
        self.integers(&[u32::from(any), u32::from(listed)])?;
        self.integers(&[threads as u32, rays.len() as u32])?;
        rays.iter().try_for_each(|r| self.floats(r))?;
        self.input.flush()?;
        let seconds = f64::from_le_bytes(self.read()?);
        let hits = u32::from_le_bytes(self.read()?) as usize;
        let mut closest = Vec::new();
        for _ in 0..if listed { rays.len() } else { 0 } {
            let t = f32::from_le_bytes(self.read()?);
            let primitive = u32::from_le_bytes(self.read()?);
            closest.push((!t.is_nan()).then_some((t, primitive)));
        }
        Ok(Traced {
            seconds,
            hits,
            closest,
        })
    }
}
