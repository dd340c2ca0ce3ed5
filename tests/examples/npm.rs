//! Writes the npm package: plain `.wgsl` files, a bundle a module for wesl-js,
//! and JavaScript that links the plain ones.
//!
//! `cargo xtask npm`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use raytwin::wgsl::{MODULES, Module, link, linked};
use serde::Serialize;

#[derive(Serialize)]
struct ModuleJson {
    name: &'static str,
    source: &'static str,
    requires: &'static [&'static str],
    callbacks: &'static [&'static str],
    bindings: Option<&'static str>,
}

fn manifest() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!(
        r#"{{
  "name": "raytwin",
  "version": "{version}",
  "description": "Ray-tracing kernels as plain WGSL, each tested against its Rust twin",
  "type": "module",
  "license": "MIT OR Apache-2.0",
  "repository": "github:raytwin/raytwin",
  "keywords": ["webgpu", "wgsl", "wesl", "raytracing", "sampling", "denoising"],
  "sideEffects": false,
  "exports": {{
    ".": {{ "types": "./index.d.ts", "default": "./index.js" }},
    "./wgsl/*": "./wgsl/*",
    "./*": {{ "types": "./weslBundle.d.ts", "default": "./dist/*/weslBundle.js" }}
  }}
}}
"#
    )
}

/// A text as a JavaScript literal.
fn literal(text: &str) -> String {
    serde_json::to_string(text).expect("a text has a JSON")
}

/// The module's bundle, which brings those of the modules that it uses.
fn bundle(module: &Module) -> Result<String, String> {
    let needed = linked(&[module.name]).map_err(|e| e.to_string())?;
    let needed = needed.iter().filter(|m| m.name != module.name);
    let names: Vec<&str> = needed.map(|m| m.name).collect();
    let (mut imports, mut dependencies) = (String::new(), Vec::new());
    for name in names {
        let local = name.replace('/', "_");
        imports += &format!("import {local} from \"../../{name}/weslBundle.js\";\n");
        dependencies.push(local);
    }
    Ok(format!(
        "{imports}
export const weslBundle = {{
  name: \"raytwin\",
  edition: \"unstable_2025_1\",
  modules: {{ \"{}.wesl\": {} }},
  dependencies: [{}],
}};

export default weslBundle;
",
        module.name,
        literal(&module.wesl()),
        dependencies.join(", ")
    ))
}

/// All files, by their path in the package.
fn files(root: &Path) -> Result<BTreeMap<String, String>, String> {
    let mut all = BTreeMap::new();
    let read = |path: &str| {
        let path = root.join(path);
        std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))
    };
    for name in ["index.js", "index.d.ts", "weslBundle.d.ts", "README.md"] {
        all.insert(name.to_owned(), read(&format!("wgsl/npm/{name}"))?);
    }
    for name in ["LICENSE-MIT", "LICENSE-APACHE"] {
        all.insert(name.to_owned(), read(name)?);
    }
    all.insert("package.json".into(), manifest());
    let mut modules = Vec::new();
    for m in MODULES {
        let name = m.name;
        modules.push(ModuleJson {
            name,
            source: m.source,
            requires: m.requires,
            callbacks: m.callbacks,
            bindings: m.bindings,
        });
        all.insert(format!("wgsl/{name}.wgsl"), m.source.into());
        let whole = link(&[name]).map_err(|e| e.to_string())?;
        all.insert(format!("wgsl/{name}.linked.wgsl"), whole);
        if let Some(bindings) = m.bindings {
            all.insert(format!("wgsl/{name}.bindings.wgsl"), bindings.into());
        }
        all.insert(format!("dist/{name}/weslBundle.js"), bundle(m)?);
    }
    let modules = serde_json::to_string_pretty(&modules).map_err(|e| e.to_string())?;
    all.insert(
        "modules.js".into(),
        format!("export const modules = {modules};\n"),
    );
    Ok(all)
}

/// Into a folder beside, which then takes the old one's place.
fn write(folder: &Path, files: &BTreeMap<String, String>) -> Result<(), String> {
    let at = |path: &Path, e: std::io::Error| format!("{}: {e}", path.display());
    let fresh = folder.with_extension("new");
    if fresh.exists() {
        std::fs::remove_dir_all(&fresh).map_err(|e| at(&fresh, e))?;
    }
    for (name, text) in files {
        let path = fresh.join(name);
        let parent = path.parent().unwrap_or(&fresh);
        std::fs::create_dir_all(parent).map_err(|e| at(parent, e))?;
        std::fs::write(&path, text).map_err(|e| at(&path, e))?;
    }
    if folder.exists() {
        std::fs::remove_dir_all(folder).map_err(|e| at(folder, e))?;
    }
    std::fs::rename(&fresh, folder).map_err(|e| at(folder, e))
}

fn main() -> ExitCode {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let folder = std::env::args().nth(1).map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| root.join("target/npm/raytwin"));
    let written = files(&root).and_then(|files| write(&folder, &files).map(|()| files.len()));
    match written {
        Ok(count) => {
            println!("{count} files in {}", folder.display());
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
