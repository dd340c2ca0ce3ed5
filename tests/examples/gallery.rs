//! Writes the gallery's data: for each technique both sources, its kernels with
//! their contracts, and what the last report measured.
//!
//! `cargo xtask gallery`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use raytwin::contract::{Kernel, Scalar};
use raytwin::wgsl;
use raytwin_tests::golden::hex;
use raytwin_tests::gpu::shader_source;
use serde::Serialize;
use serde_json::Value;

/// Inputs drawn from the domain, for the ranges of the sliders.
const DRAWN: usize = 64;
const SEED: u32 = 0x9a11_e4f0;

#[derive(Serialize)]
struct Entry {
    name: &'static str,
    title: String,
    kernels: usize,
}

#[derive(Serialize)]
struct Technique {
    name: &'static str,
    title: String,
    wgsl: String,
    rust: String,
    /// The module with all that it needs.
    library: String,
    kernels: Vec<GalleryKernel>,
}

#[derive(Serialize)]
struct GalleryKernel {
    name: &'static str,
    signature: String,
    source: &'static str,
    class: char,
    bounds: [f64; 3],
    inputs: Vec<Lane>,
    outputs: Vec<(String, &'static str)>,
    /// Arguments of a few calls, in hexadecimal.
    cases: Vec<String>,
    /// What comes after the library: callbacks, bindings and the entry point.
    entry: String,
    fixture: String,
    measured: Option<Measured>,
}

/// A word of an argument.
#[derive(Serialize)]
struct Lane {
    name: String,
    scalar: &'static str,
    /// From and to, of what was drawn.
    range: [f64; 2],
}

/// From the last report.
#[derive(Serialize)]
struct Measured {
    cpu_ns: Option<f64>,
    cpu_error: Option<f64>,
    gpu_ns: Option<f64>,
    gpu_error: Option<f64>,
    /// The speed-against-error plot, in the report's folder.
    plot: Option<String>,
}

fn scalar(of: Scalar) -> &'static str {
    match of {
        Scalar::F32 => "f32",
        Scalar::U32 => "u32",
    }
}

fn lanes(kernel: &Kernel, drawn: &[u32]) -> Vec<Lane> {
    let words = kernel.words_in();
    let lane = |(i, (name, of)): (usize, (String, Scalar))| {
        let values = drawn.iter().skip(i).step_by(words).map(|&w| match of {
            Scalar::F32 => f64::from(f32::from_bits(w)),
            Scalar::U32 => f64::from(w),
        });
        let (low, high) = values
            .filter(|v| v.is_finite())
            .fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        Lane {
            name,
            scalar: scalar(of),
            range: if low <= high { [low, high] } else { [0.0, 1.0] },
        }
    };
    kernel
        .lanes_in()
        .into_iter()
        .enumerate()
        .map(lane)
        .collect()
}

fn gallery_kernel(kernel: &Kernel, report: Option<&Value>) -> GalleryKernel {
    let drawn = kernel.draw_many(DRAWN, SEED);
    let calls = drawn.chunks_exact(kernel.words_in()).take(4);
    let signature: Vec<String> = kernel
        .inputs
        .iter()
        .map(|(name, ty)| format!("{name}: {}", ty.wgsl()))
        .collect();
    let fixture = kernel.fixture.as_ref();
    let callbacks = fixture.map_or("", |f| f.wgsl);
    GalleryKernel {
        name: kernel.name,
        signature: format!(
            "fn {}({}) -> {}",
            kernel.name,
            signature.join(", "),
            kernel.output.wgsl()
        ),
        source: kernel.source,
        class: kernel.class.letter(),
        bounds: [kernel.bounds.cpu, kernel.bounds.gpu, kernel.bounds.parity()],
        inputs: lanes(kernel, &drawn),
        outputs: kernel
            .lanes_out()
            .into_iter()
            .map(|(name, of)| (name, scalar(of)))
            .collect(),
        cases: calls.map(hex).collect(),
        entry: shader_source(callbacks, kernel.name, &kernel.inputs, &kernel.output),
        fixture: fixture.map_or(String::new(), |f| hex(&f.words)),
        measured: report.and_then(|report| measured(kernel, report)),
    }
}

fn measured(kernel: &Kernel, report: &Value) -> Option<Measured> {
    let row = report["kernels"]
        .as_array()?
        .iter()
        .find(|row| row["name"] == kernel.name)?;
    let plot = format!("plots/speed-error-{}.svg", kernel.name.replace('_', "-"));
    let has = report["plots"]
        .as_array()
        .is_some_and(|all| all.iter().any(|p| p["file"] == plot.as_str()));
    Some(Measured {
        cpu_ns: row["cpu_ns"].as_f64(),
        cpu_error: row["cpu_err_ulp_max"].as_f64(),
        gpu_ns: row["gpu_ns"].as_f64(),
        gpu_error: row["gpu_err_ulp_max"].as_f64(),
        plot: has.then_some(plot),
    })
}

/// The libraries of the demonstrations that use more than one technique.
fn libraries() -> Result<BTreeMap<&'static str, String>, String> {
    let link = |names: &[&str]| wgsl::link(names).map_err(|e| e.to_string());
    let svgf = wgsl::link_pass("filter/svgf", wgsl::Images::Buffers).map_err(|e| e.to_string())?;
    Ok([
        ("patterns", link(&["random/halton", "random/pcg"])?),
        (
            "lobes",
            link(&["brdf/cook_torrance", "brdf/ggx_bounded", "random/halton"])?,
        ),
        (
            "layered",
            link(&[
                "brdf/layered",
                "sample/basis",
                "random/halton",
                "random/pcg",
            ])?,
        ),
        ("mean", link(&["temporal/multiscale_mean", "random/pcg"])?),
        (
            "noise",
            link(&[
                "temporal/accumulate",
                "temporal/variance_clamp",
                "ray/sphere",
                "sample/disk",
                "random/pcg",
            ])?,
        ),
        ("svgf", svgf),
        ("surfels", link(&["gi/surfel", "ray/sphere"])?),
    ]
    .into())
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn save(path: &Path, value: &impl Serialize) -> Result<(), String> {
    let at = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|e| at(&e))?;
    }
    let text = serde_json::to_string(value).map_err(|e| at(&e))?;
    std::fs::write(path, text).map_err(|e| at(&e))
}

/// The first paragraph of the technique's page.
fn title(page: &str) -> String {
    let mut lines = page.lines().skip(1).skip_while(|l| l.trim().is_empty());
    let first: Vec<&str> = lines
        .by_ref()
        .take_while(|l| !l.trim().is_empty())
        .collect();
    first.join(" ").replace('`', "")
}

fn write(root: &Path, folder: &Path) -> Result<(), String> {
    let report = root.join("target/report/report.json");
    let report: Option<Value> = if report.is_file() {
        Some(serde_json::from_str(&read(&report)?).map_err(|e| e.to_string())?)
    } else {
        println!("no report yet: `cargo xtask report` makes one, and this again shows its plots");
        None
    };
    let mut entries = Vec::new();
    for technique in raytwin::registry() {
        let name = technique.name;
        let library = wgsl::link(&[name]).map_err(|e| e.to_string())?;
        let title = title(&read(&root.join(format!("docs/{name}.md")))?);
        let kernels = technique.kernels.iter();
        let kernels: Vec<_> = kernels
            .map(|k| gallery_kernel(k, report.as_ref()))
            .collect();
        entries.push(Entry {
            name,
            title: title.clone(),
            kernels: kernels.len(),
        });
        let rust = read(&root.join(format!("cpu/src/{name}.rs")))?;
        // The tests are no part of what one would copy.
        let end = rust.find("\n#[cfg(test)]").unwrap_or(rust.len());
        let data = Technique {
            name,
            title,
            wgsl: read(&root.join(format!("wgsl/src/{name}.wgsl")))?,
            rust: rust[..end].to_owned(),
            library,
            kernels,
        };
        save(&folder.join(format!("{name}.json")), &data)?;
    }
    save(&folder.join("libraries.json"), &libraries()?)?;
    let about = report.as_ref().map(|r| {
        let part = |key: &str| r[key].as_str().unwrap_or_default().to_owned();
        [part("date"), part("revision")]
    });
    let index = serde_json::json!({ "report": about, "techniques": entries });
    save(&folder.join("index.json"), &index)?;
    println!("{} techniques in {}", entries.len(), folder.display());
    Ok(())
}

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = std::env::args().nth(1).map(PathBuf::from);
    let written = folder
        .ok_or_else(|| "name the folder to write to".to_owned())
        .and_then(|folder| write(&root, &folder));
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
