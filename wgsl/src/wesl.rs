//! All modules as one WESL package for cargo (feature `wesl`; wesl 0.6 or later).
//!
//! ```
//! use raytwin_wgsl::wesl::PACKAGE;
//!
//! // In a build script: resolver.add_package(&PACKAGE);
//! // In a shader: import raytwin::sample::cone::cone_sample;
//! let groups: Vec<_> = PACKAGE.root.submodules.iter().map(|m| m.name).collect();
//! assert!(groups.contains(&"sample"));
//! ```
//!
//! Everything is `public`, so that it works whether the compiler looks at
//! visibility or not. wesl 0.4 knows neither this type nor the word: give its
//! resolver [`Module::wesl`] under [`Module::import_path`].

use std::sync::LazyLock;

use wesl_core::{StaticPackage, StaticPackageModule};

use super::{MODULES, Module};

/// The package `raytwin`: a module a technique, `raytwin::sample::cone`. A module
/// that calls back comes with its ready bindings.
pub static PACKAGE: LazyLock<StaticPackage> = LazyLock::new(|| StaticPackage {
    crate_name: "raytwin_wgsl",
    root: module("raytwin", String::new(), groups()),
    dependencies: &[],
});

/// The modules by the first part of their names, in the registry's order.
fn groups() -> Vec<&'static StaticPackageModule> {
    let mut names: Vec<&str> = Vec::new();
    for (group, _) in MODULES.iter().filter_map(|m| m.name.split_once('/')) {
        if !names.contains(&group) {
            names.push(group);
        }
    }
    let members = |group: &str| {
        let parts = MODULES
            .iter()
            .filter_map(|m| Some((m, m.name.split_once('/')?)));
        parts
            .filter(|(_, (of, _))| *of == group)
            .map(|(m, (_, name))| module(name, public(m), Vec::new()))
            .collect()
    };
    names
        .into_iter()
        .map(|group| module(group, String::new(), members(group)))
        .collect()
}

/// Kept for good: the package is a static.
fn module(
    name: &'static str,
    source: String,
    submodules: Vec<&'static StaticPackageModule>,
) -> &'static StaticPackageModule {
    Box::leak(Box::new(StaticPackageModule {
        name,
        source: source.leak(),
        submodules: submodules.leak(),
    }))
}

/// The module's text with each declaration `public`. It imports from its own
/// package, which has no name of its own there.
fn public(m: &Module) -> String {
    let mut out = String::new();
    for line in m.wesl().lines() {
        let line = line.replacen("import raytwin::", "import package::", 1);
        let known = ["fn ", "const ", "struct ", "alias ", "var<"];
        // What is bound comes after its place.
        let at = if line.starts_with("@group") {
            line.find(" var<").map(|i| i + 1)
        } else {
            known.iter().any(|k| line.starts_with(k)).then_some(0)
        };
        match at {
            Some(at) => out += &format!("{}public {}\n", &line[..at], &line[at..]),
            None => out += &format!("{line}\n"),
        }
    }
    out
}
