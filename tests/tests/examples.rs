//! The examples, run as a user runs them.

use std::path::PathBuf;
use std::process::Command;

/// Runs `name`, which `cargo test --workspace` has built beside this test.
fn run(name: &str, arguments: &[&str]) -> String {
    let this = std::env::current_exe().expect("the path of this test");
    let folder = this.ancestors().nth(2).map(|f| f.join("examples"));
    let program: PathBuf = folder.expect("target/debug").join(name);
    let output = Command::new(&program).args(arguments).output();
    let output = output.unwrap_or_else(|e| {
        let build = "cargo build --workspace --examples";
        panic!("{}: {e}; `{build}` builds it", program.display())
    });
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "{name}: {}\n{text}{errors}",
        output.status
    );
    text
}

#[test]
fn cone_cpu() {
    assert!(!run("cone_cpu", &[]).is_empty());
}

#[test]
fn link_wgsl() {
    let source = run("link_wgsl", &["sample/cone", "random/pcg"]);
    assert!(source.contains("fn cone_sample("));
    naga::front::wgsl::parse_str(&source).expect("what it prints is a program");
    assert!(run("link_wgsl", &[]).contains("sample/cone"));
}

#[test]
fn wgpu_compute() {
    assert!(run("wgpu_compute", &[]).contains("farthest apart"));
}

#[test]
fn svgf_pass() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = folder.path().join("svgf.png");
    run("svgf_pass", &[&picture.to_string_lossy()]);
    assert!(image::open(&picture).is_ok());
}

#[test]
fn bake_ao() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mesh = folder.path().join("ball.ply");
    run("bake_ao", &[&mesh.to_string_lossy()]);
    let text = std::fs::read_to_string(&mesh).expect("the mesh");
    assert!(text.starts_with("ply\n"));
}
