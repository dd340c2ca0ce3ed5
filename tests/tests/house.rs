//! The house rules that a machine can check.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .to_path_buf()
}

/// `group/name` of each file `folder/group/name.ext`.
fn techniques(folder: &str, extension: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let base = root().join(folder);
    let entries = |path: &Path| {
        std::fs::read_dir(path)
            .unwrap_or_else(|e| panic!("{}: {e}", path.display()))
            .map(|entry| entry.expect("directory entry").path())
            .collect::<Vec<_>>()
    };
    for group in entries(&base) {
        let group_name = group
            .file_name()
            .expect("name")
            .to_string_lossy()
            .into_owned();
        // Passes over whole images are built on the techniques.
        if !group.is_dir() || ["contract", "gpu", "pass"].contains(&group_name.as_str()) {
            continue;
        }
        for file in entries(&group) {
            let name = file
                .file_name()
                .expect("name")
                .to_string_lossy()
                .into_owned();
            let Some(stem) = name.strip_suffix(extension) else {
                continue;
            };
            // `bvh.bindings.wgsl` and `bvh_build.rs` belong to `bvh`; the page on
            // Embree belongs to the whole group.
            let part = stem.contains('.') || stem.ends_with("_build");
            if !part && !["mod", "README", "embree"].contains(&stem) {
                found.insert(format!("{group_name}/{stem}"));
            }
        }
    }
    found
}

#[test]
fn every_technique_has_all_its_rooms() {
    let cpu = techniques("cpu/src", ".rs");
    assert!(cpu.len() >= 13, "only {cpu:?}");
    let registered: BTreeSet<_> = raytwin::registry()
        .iter()
        .map(|t| t.name.to_string())
        .collect();
    let modules: BTreeSet<_> = raytwin::wgsl::MODULES
        .iter()
        .map(|m| m.name.to_string())
        .collect();
    for (what, have) in [
        ("a WGSL twin in wgsl/src", techniques("wgsl/src", ".wgsl")),
        ("a line in raytwin_wgsl::MODULES", modules),
        ("a pair in kernels/src", techniques("kernels/src", ".rs")),
        ("a line in kernels/src/registry.rs", registered),
        ("a page in docs", techniques("docs", ".md")),
    ] {
        let missing: Vec<_> = cpu.difference(&have).collect();
        assert!(missing.is_empty(), "without {what}: {missing:?}");
        let extra: Vec<_> = have.difference(&cpu).collect();
        assert!(extra.is_empty(), "{what} but no CPU twin: {extra:?}");
    }
}

/// Names of the public functions in a Rust file, tests left out.
fn rust_functions(path: &Path) -> BTreeSet<String> {
    let text = std::fs::read_to_string(path).expect("a CPU twin");
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    code.lines()
        .filter_map(|l| l.strip_prefix("pub fn "))
        .map(|l| l.split(['(', '<']).next().unwrap_or_default().to_string())
        .collect()
}

#[test]
fn every_function_has_a_twin_and_a_contract() {
    for technique in raytwin::registry() {
        let module = raytwin::wgsl::module(technique.name).expect("registered");
        let cpu = rust_functions(&root().join(format!("cpu/src/{}.rs", technique.name)));
        let wgsl: BTreeSet<_> = module
            .source
            .lines()
            .filter_map(|l| l.strip_prefix("fn "))
            .map(|l| l.split('(').next().unwrap_or_default().to_string())
            .collect();
        let contracts: BTreeSet<_> = technique
            .kernels
            .iter()
            .map(|k| k.name.to_string())
            .collect();
        assert!(!contracts.is_empty(), "{} has no kernel", technique.name);
        assert!(
            cpu.is_subset(&wgsl),
            "{}: without a WGSL twin: {:?}",
            technique.name,
            cpu.difference(&wgsl)
        );
        assert_eq!(
            cpu, contracts,
            "{}: CPU functions and contracts differ",
            technique.name
        );
        for kernel in &technique.kernels {
            assert_eq!(
                kernel.module, technique.name,
                "{kernel:?} names another module"
            );
            assert!(!kernel.source.is_empty(), "{kernel:?} names no source");
            assert!(!kernel.hard.is_empty(), "{kernel:?} lists no hard case");
        }
    }
}

#[test]
fn every_kernel_has_a_bench_row() {
    // The benches walk the registry: what they list is what they run.
    let text = std::fs::read_to_string(root().join("benches/benches/kernels.rs"))
        .expect("the microbenchmarks");
    assert!(
        text.contains("raytwin::registry()"),
        "benches/benches/kernels.rs no longer walks the registry"
    );
}

#[test]
fn docs_tables_are_those_of_the_contracts() {
    for technique in raytwin::registry() {
        let path = root().join(format!("docs/{}.md", technique.name));
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path:?}: {e}"));
        let table = raytwin_tests::docs::contract_table(&technique);
        assert!(
            text.contains(&table),
            "{} does not hold the contract's table; run `cargo xtask docs`. Expected:\n{table}",
            path.display()
        );
    }
}

#[test]
fn cpu_crate_needs_glam_only_and_wgsl_crate_nothing() {
    let metadata = cargo_metadata::MetadataCommand::new()
        .manifest_path(root().join("Cargo.toml"))
        .no_deps()
        .other_options(vec!["--offline".into()])
        .exec()
        .expect("cargo metadata");
    let dependencies = |name: &str, optional: bool| {
        let package = metadata
            .packages
            .iter()
            .find(|p| p.name.as_str() == name)
            .expect("a workspace member");
        package
            .dependencies
            .iter()
            .filter(|d| d.kind == cargo_metadata::DependencyKind::Normal && d.optional == optional)
            .map(|d| d.name.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(dependencies("raytwin-cpu", false), ["glam"]);
    // Rows of whole images in parallel, for those who ask.
    assert_eq!(dependencies("raytwin-cpu", true), ["rayon"]);
    assert!(dependencies("raytwin-wgsl", false).is_empty());
    // The type of a WESL package, for those who ask.
    assert_eq!(dependencies("raytwin-wgsl", true), ["wesl-core"]);
    // Both halves, and glam for the types that they share.
    assert!(dependencies("raytwin", false).len() <= 3);
}

#[test]
fn the_cpu_crate_has_unsafe_where_vectors_are_chosen_and_nowhere_else() {
    fn walk(folder: &Path, found: &mut BTreeSet<String>) {
        for entry in std::fs::read_dir(folder).expect("a folder of the CPU crate") {
            let path = entry.expect("directory entry").path();
            if path.is_dir() {
                walk(&path, found);
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("a source file");
            let code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
            if code.into_iter().any(|l| l.contains("unsafe")) {
                found.insert(
                    path.strip_prefix(root())
                        .expect("inside")
                        .display()
                        .to_string(),
                );
            }
        }
    }
    let mut found = BTreeSet::new();
    walk(&root().join("cpu/src"), &mut found);
    let allowed = [
        "cpu/src/pass/bvh8/lanes.rs",
        "cpu/src/pass/bvh8/mod.rs",
        "cpu/src/pass/bvh8/walk.rs",
        "cpu/src/simd.rs",
    ];
    assert_eq!(found, BTreeSet::from(allowed.map(String::from)));
}

/// A trap without its test would be a claim.
#[test]
fn every_trap_has_its_test() {
    fn functions(folder: &Path, found: &mut BTreeSet<String>) {
        for entry in std::fs::read_dir(folder).expect("a folder of sources") {
            let path = entry.expect("directory entry").path();
            if path.is_dir() {
                functions(&path, found);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = std::fs::read_to_string(&path).expect("a source file");
                let after_test = text.split("#[test]").skip(1);
                let names = after_test.filter_map(|t| t.split_once("fn ")?.1.split_once('('));
                found.extend(names.map(|(name, _)| name.to_string()));
            }
        }
    }
    let mut found = BTreeSet::new();
    for folder in ["cpu/src", "tests/tests"] {
        functions(&root().join(folder), &mut found);
    }
    let page = std::fs::read_to_string(root().join("docs/traps.md")).expect("docs/traps.md");
    let rows = page.lines().filter(|l| l.starts_with("| ")).skip(2);
    let mut count = 0;
    for row in rows {
        let tests = row.split(" | ").nth(2).expect("three columns");
        for name in tests.split('`').skip(1).step_by(2) {
            assert!(
                found.contains(name),
                "docs/traps.md names {name}, no test has it"
            );
            count += 1;
        }
    }
    assert!(count > 30, "{count} tests");
}

/// Code that the README shows but rustdoc cannot compile here is a quotation of
/// what is compiled elsewhere.
#[test]
fn the_readme_quotes_what_is_tested() {
    let read = |path: &str| {
        let path = root().join(path);
        std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    let plugin = read("kernels/examples/bevy/src/lib.rs");
    let readme = read("README.md");
    let mut blocks = readme.split("```rust,ignore\n").skip(1);
    let bevy = blocks.next().expect("the Bevy plugin").split("```").next();
    assert!(
        plugin.contains(bevy.expect("an end")),
        "the plugin has changed"
    );
    assert!(blocks.next().is_none(), "an untested block");
    let web = |text: &str| -> Option<String> {
        let code = text.split("```js\n").nth(1)?.split("```").next()?;
        Some(code.to_owned())
    };
    // tests/web/npm.mjs runs what that page shows.
    assert!(web(&readme).is_some());
    assert_eq!(web(&readme), web(&read("wgsl/npm/README.md")));
}

/// What a reader of the CPU crate's documentation can copy and run.
#[test]
fn every_public_item_of_the_cpu_crate_has_an_example() {
    fn walk(folder: &Path, count: &mut usize, without: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).expect("a folder of the CPU crate") {
            let path = entry.expect("directory entry").path();
            if path.is_dir() {
                walk(&path, count, without);
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("a source file");
            let code = text.split("#[cfg(test)]\nmod tests").next();
            let mut example = false;
            for line in code.unwrap_or_default().lines().map(str::trim) {
                if line.starts_with("///") {
                    example |= line.contains("```");
                    continue;
                }
                let mut words = line.split(|c: char| !c.is_alphanumeric() && c != '_');
                let public = words.next() == Some("pub") && !line.starts_with("pub(");
                let kind = words.find(|w| !["const", "unsafe"].contains(w));
                if public && ["fn", "struct", "enum", "trait"].map(Some).contains(&kind) {
                    *count += 1;
                    if !example {
                        let name = words.next().unwrap_or_default();
                        without.push(format!("{}: {name}", path.display()));
                    }
                }
                // Attributes and comments stand between an item and its documentation.
                example &= line.starts_with("#[") || line.starts_with("//");
            }
        }
    }
    let (mut count, mut without) = (0, Vec::new());
    walk(&root().join("cpu/src"), &mut count, &mut without);
    assert!(
        without.is_empty(),
        "without an example in the documentation: {without:#?}"
    );
    assert!(count > 440, "{count} items");
}
