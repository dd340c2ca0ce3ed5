//! Every module of the WESL package through wesl 0.6, with every function
//! called, with visibility on and off.
#![cfg(test)]

#[path = "../../tests/packaging/calls.rs"]
mod calls;

use std::fs;
use std::path::Path;

use calls::calls;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use raytwin::wgsl::wesl::PACKAGE;
use raytwin::wgsl::{MODULES, Module};
use wesl::{CompileOptions, Compiler};

/// As a build script does: a shader in a file, the package as a dependency.
fn check(m: &Module, folder: &Path, visibility: bool) -> Result<(), String> {
    let (main, imports) = calls(m);
    let head: String = imports
        .iter()
        .map(|(path, names)| format!("import {path}::{{{}}};\n", names.join(", ")))
        .collect();
    let file = folder.join(format!("{}.wesl", m.name.replace('/', "_")));
    fs::write(&file, head + &main).map_err(|e| format!("{}: {e}", file.display()))?;
    let options = CompileOptions {
        visibility,
        dependencies: vec![&PACKAGE],
        ..Default::default()
    };
    let compiled = Compiler::new(options)
        .compile(&file)
        .map_err(|e| e.to_string())?;
    let text = compiled.to_string();
    let module = naga::front::wgsl::parse_str(&text).map_err(|e| e.emit_to_string(&text))?;
    Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .map_err(|e| e.emit_to_string(&text))?;
    if module.entry_points.len() != 1 {
        return Err("the entry point is gone".into());
    }
    Ok(())
}

fn each_module(visibility: bool) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let failures: Vec<_> = MODULES
        .iter()
        .filter_map(|m| {
            check(m, folder.path(), visibility)
                .err()
                .map(|e| format!("{}: {e}", m.name))
        })
        .collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_module_compiles_with_visibility() {
    each_module(true);
}

#[test]
fn every_module_compiles_without_visibility() {
    each_module(false);
}
