//! Prints one WGSL source with the named kernels and all that they stand on.
//!
//! `cargo run -p raytwin --example link_wgsl -- sample/cone random/pcg > cone.wgsl`
//!
//! Without names it lists the modules, what each requires and which functions
//! the program must define for it.

use std::process::ExitCode;

use raytwin::wgsl::{MODULES, link, linked};

fn main() -> ExitCode {
    let names: Vec<String> = std::env::args().skip(1).collect();
    if names.is_empty() {
        for module in MODULES {
            println!("{}", module.name);
            if !module.requires.is_empty() {
                println!("    requires {}", module.requires.join(", "));
            }
            for callback in module.callbacks {
                println!("    asks for {callback}");
            }
        }
        return ExitCode::SUCCESS;
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    match (link(&names), linked(&names)) {
        (Ok(source), Ok(modules)) => {
            for callback in modules.iter().flat_map(|m| m.callbacks) {
                println!("// Define: {callback}");
            }
            println!("{source}");
            ExitCode::SUCCESS
        }
        (Err(error), _) | (_, Err(error)) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
