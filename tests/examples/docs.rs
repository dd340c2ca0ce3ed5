//! Writes the contracts' tables into the pages under docs/.
//!
//! `cargo xtask docs`

use std::path::Path;

fn main() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace");
    let mut failed = false;
    for technique in raytwin::registry() {
        let path = root.join(format!("docs/{}.md", technique.name));
        let result = std::fs::read_to_string(&path)
            .map_err(|e| e.to_string())
            .and_then(|page| {
                raytwin_tests::docs::updated(&page, &technique)
                    .ok_or_else(|| format!("lacks the mark {}", raytwin_tests::docs::BEGIN))
            })
            .and_then(|page| {
                let temporary = path.with_extension("md.new");
                std::fs::write(&temporary, page)
                    .and_then(|()| std::fs::rename(&temporary, &path))
                    .map_err(|e| e.to_string())
            });
        match result {
            Ok(()) => println!("docs/{}.md", technique.name),
            Err(error) => {
                eprintln!("docs/{}.md: {error}", technique.name);
                failed = true;
            }
        }
    }
    if failed {
        std::process::exit(1);
    }
}
