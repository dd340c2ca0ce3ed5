//! `cargo xtask report`: measures everything and writes the report.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use raytwin_bench::report::{Options, run, summary};

/// Measures every kernel, traversal engine and rendered stage, and writes
/// index.html, report.json, pictures and plots.
#[derive(Parser)]
#[command(name = "cargo xtask report", version)]
struct Cli {
    /// Ten to fifteen minutes on two cores (the default)
    #[arg(long, conflicts_with = "full")]
    quick: bool,
    /// The long run: more inputs, rays, samples and pixels
    #[arg(long)]
    full: bool,
    /// An OBJ, glTF or GLB file in place of the built-in scenes
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    /// Only kernels, stages and meshes with this in their name, such as
    /// `math/trig`, `stages/kitchen`, `toy/sequences/soft-shadow/light-jumps` or
    /// `bvh/families`
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
    /// Leave out the GPU
    #[arg(long, conflicts_with = "gpu")]
    cpu: bool,
    /// Leave out the CPU twins (Embree stays, for the ratios)
    #[arg(long)]
    gpu: bool,
    /// Size of the pictures and sequences
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Folder to write
    #[arg(long, value_name = "DIR", default_value = "target/report")]
    out: PathBuf,
}

fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X']);
    let number = |s: &str| s.parse::<u32>().ok();
    parts
        .and_then(|(w, h)| number(w).zip(number(h)))
        .ok_or_else(|| "give width and height in pixels, as in 320x180".into())
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let options = Options {
        full: cli.full,
        scene: cli.scene,
        only: cli.only,
        cpu_only: cli.cpu,
        gpu_only: cli.gpu,
        size: cli.size,
        out: cli.out,
    };
    match run(&options) {
        Ok(written) => {
            print!("{}", summary(&written));
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
