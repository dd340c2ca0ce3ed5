//! The WGSL files in other module systems: every module through naga_oil's
//! composer and through WESL's compiler, with every function called.

#[path = "packaging/calls.rs"]
mod calls;

use calls::calls;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga_oil::compose::{ComposableModuleDescriptor, Composer, NagaModuleDescriptor};
use raytwin::wgsl::{MODULES, Module, linked};
use wesl::{CompileOptions, EscapeMangler, ModulePath, VirtualResolver, compile};

fn each_module(check: impl Fn(&Module) -> Result<(), String>) {
    let failures: Vec<_> = MODULES
        .iter()
        .filter_map(|m| check(m).err().map(|e| format!("{}: {e}", m.name)))
        .collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn naga_oil_composes_every_module() {
    each_module(|m| {
        let mut composer = Composer::default();
        for needed in linked(&[m.name]).map_err(|e| e.to_string())? {
            let (source, as_name) = (needed.naga_oil(), Some(needed.import_path()));
            let added = composer.add_composable_module(ComposableModuleDescriptor {
                source: &source,
                file_path: needed.name,
                as_name,
                ..Default::default()
            });
            if let Err(e) = added {
                let text = e.emit_to_string(&composer);
                return Err(format!("{}: {text}", needed.name));
            }
        }
        let (main, imports) = calls(m);
        let head: String = imports
            .iter()
            .map(|(path, names)| format!("#import {path}::{{{}}}\n", names.join(", ")))
            .collect();
        let source = head + &main;
        let composed = composer
            .make_naga_module(NagaModuleDescriptor {
                source: &source,
                file_path: "main.wgsl",
                ..Default::default()
            })
            .map_err(|e| e.to_string())?;
        if composed.entry_points.len() != 1 {
            return Err("the entry point is gone".into());
        }
        Ok(())
    });
}

#[test]
fn wesl_compiles_every_module() {
    each_module(|m| {
        let mut resolver = VirtualResolver::new();
        let path = |text: &str| text.parse::<ModulePath>().map_err(|e| e.to_string());
        for needed in linked(&[m.name]).map_err(|e| e.to_string())? {
            resolver.add_module(path(&needed.import_path())?, needed.wesl().into());
        }
        let (main, imports) = calls(m);
        let head: String = imports
            .iter()
            .map(|(path, names)| format!("import {path}::{{{}}};\n", names.join(", ")))
            .collect();
        resolver.add_module(path("package::main")?, (head + &main).into());
        let options = CompileOptions::default();
        let compiled = compile(&path("package::main")?, &resolver, &EscapeMangler, &options)
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
    });
}
