//! Writes what the browser test compiles and runs: every module and pass, and
//! each kernel's compute shader beside its golden vectors.
//!
//! `cargo run -p raytwin-tests --example web -- FOLDER`

#[path = "../tests/packaging/calls.rs"]
mod calls;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use raytwin::wgsl::{self, Images, LinkError, MODULES, PASSES};
use raytwin_tests::golden::{self, Golden};
use raytwin_tests::gpu::shader_source;
use serde::Serialize;

/// A program that has to compile.
#[derive(Serialize)]
struct Program {
    name: String,
    source: String,
    /// Whether it wants the browser's feature `subgroups`.
    subgroups: bool,
}

/// A kernel as a compute shader, and what it has to give.
#[derive(Serialize)]
struct Kernel {
    shader: String,
    golden: Golden,
}

/// A module with an entry point that calls all its functions.
#[derive(Serialize)]
struct Calls {
    name: &'static str,
    main: String,
    /// Paths, and the names taken from each.
    imports: Vec<(String, Vec<String>)>,
    /// The module with all that it needs.
    source: String,
}

fn all_calls() -> Result<Vec<Calls>, LinkError> {
    let all = MODULES.iter().map(|m| {
        let (main, imports) = calls::calls(m);
        Ok(Calls {
            name: m.name,
            main,
            imports,
            source: wgsl::link(&[m.name])?,
        })
    });
    all.collect()
}

fn programs() -> Result<Vec<Program>, LinkError> {
    let program = |name: String, source: String| Program {
        name,
        source,
        subgroups: false,
    };
    let bindings = |name: &str| {
        let module = wgsl::module(name).and_then(|m| m.bindings);
        module.unwrap_or_default()
    };
    let mut all = Vec::new();
    for module in MODULES {
        let needed = wgsl::linked(&[module.name])?;
        let bindings = needed.iter().filter_map(|m| m.bindings);
        let source = wgsl::link(&[module.name])? + &bindings.collect::<String>();
        all.push(program(module.name.into(), source));
    }
    for pass in PASSES {
        for images in [Images::Buffers, Images::Textures16, Images::Textures32] {
            // naga 30 does not take the directive that browsers ask for.
            let enable = if pass.subgroups {
                "enable subgroups;\n"
            } else {
                ""
            };
            all.push(Program {
                name: format!("{} over {images:?}", pass.name),
                source: enable.to_owned() + &wgsl::link_pass(pass.name, images)?,
                subgroups: pass.subgroups,
            });
        }
    }
    let svgf = ["filter/svgf", "filter/tiles"];
    for (name, pass) in [
        ("color", wgsl::pass::SVGF_COLOR),
        ("scalar", wgsl::pass::SVGF_SCALAR),
    ] {
        let whole = wgsl::link(&svgf[..1])? + pass;
        all.push(program(format!("pass svgf {name}"), whole));
        let tiles = wgsl::link(&svgf)? + pass + bindings("filter/tiles") + wgsl::pass::SVGF_TILES;
        all.push(program(format!("pass svgf {name} tiles"), tiles));
    }
    let mean = wgsl::link(&["temporal/multiscale_mean"])? + wgsl::pass::MULTISCALE_MEAN_COLOR;
    all.push(program("pass multiscale_mean".into(), mean));
    let surfels = wgsl::link(&["gi/surfel_irradiance", "gi/surfel_grid"])? + wgsl::pass::SURFEL;
    all.push(program("pass surfel".into(), surfels));
    let grid = wgsl::link(&["gi/surfel_grid"])? + bindings("gi/surfel") + wgsl::pass::SURFEL_GRID;
    all.push(program("pass surfel_grid".into(), grid));
    // Rays through ray/bvh.
    let sky = "
fn surfel_irradiance_trace(origin: vec3f, direction: vec3f) -> SurfelIrradianceHit {
    let hit = bvh_closest(Ray(origin, direction, 0.0, 1e30));
    let found = select(0u, 1u, hit.primitive != BVH_MISS);
    let half = vec3f(0.5, 0.5, 0.5);
    return SurfelIrradianceHit(origin + direction * hit.t, found, -direction, half, half);
}
fn surfel_irradiance_direct(hit: SurfelIrradianceHit) -> vec3f {
    let lit = bvh_any(Ray(hit.position, vec3f(0.0, 1.0, 0.0), 0.001, 1e30)) == 0u;
    return select(vec3f(0.0, 0.0, 0.0), hit.albedo, lit);
}
";
    let light = [
        "gi/surfel_irradiance",
        "gi/surfel_grid",
        "temporal/multiscale_mean",
        "ray/bvh",
    ];
    let light = wgsl::link(&light)? + bindings("ray/bvh") + wgsl::pass::SURFEL_IRRADIANCE + sky;
    all.push(program("pass surfel_irradiance".into(), light));
    Ok(all)
}

fn kernels() -> Result<Vec<Kernel>, LinkError> {
    let mut all = Vec::new();
    for kernel in raytwin::registry().into_iter().flat_map(|t| t.kernels) {
        let mut library = wgsl::link(&[kernel.module])?;
        if let Some(fixture) = &kernel.fixture {
            library += fixture.wgsl;
        }
        all.push(Kernel {
            shader: shader_source(&library, kernel.name, &kernel.inputs, &kernel.output),
            golden: golden::golden(&kernel),
        });
    }
    Ok(all)
}

fn write(folder: &Path) -> Result<(), String> {
    let at = |path: &Path, e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    std::fs::create_dir_all(folder).map_err(|e| at(folder, &e))?;
    let save = |name: &str, text: serde_json::Result<String>| {
        let path = folder.join(name);
        let text = text.map_err(|e| at(&path, &e))?;
        let fresh = path.with_extension("new");
        std::fs::write(&fresh, text).map_err(|e| at(&fresh, &e))?;
        std::fs::rename(&fresh, &path).map_err(|e| at(&path, &e))
    };
    let programs = programs().map_err(|e| e.to_string())?;
    let kernels = kernels().map_err(|e| e.to_string())?;
    println!("{} programs, {} kernels", programs.len(), kernels.len());
    let calls = all_calls().map_err(|e| e.to_string())?;
    save("calls.json", serde_json::to_string(&calls))?;
    save("programs.json", serde_json::to_string(&programs))?;
    save("kernels.json", serde_json::to_string(&kernels))
}

fn main() -> ExitCode {
    let folder = std::env::args().nth(1).map(PathBuf::from);
    let written = folder
        .ok_or_else(|| "name the folder to write to".to_owned())
        .and_then(|folder| write(&folder));
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
