//! A program that calls every function of a module, for the tests of packagings
//! here and in tests/wesl.

use raytwin::wgsl::{Module, linked};

/// A zero of a type, as WGSL.
fn zero(module: &naga::Module, ty: naga::Handle<naga::Type>) -> String {
    use naga::{ScalarKind, TypeInner};
    let scalar = |kind| match kind {
        ScalarKind::Float => "f32",
        ScalarKind::Uint => "u32",
        ScalarKind::Sint => "i32",
        _ => "bool",
    };
    let ty = &module.types[ty];
    match &ty.inner {
        TypeInner::Scalar(s) => format!("{}()", scalar(s.kind)),
        TypeInner::Vector { size, scalar: s } => {
            format!("vec{}<{}>()", *size as u8, scalar(s.kind))
        }
        _ => format!("{}()", ty.name.as_deref().unwrap_or_default()),
    }
}

/// Calls of all functions of a module, and the names that they take from it and
/// what it requires.
pub fn calls(m: &Module) -> (String, Vec<(String, Vec<String>)>) {
    let all = linked(&[m.name]).expect("registered");
    let mut source = raytwin::wgsl::link(&[m.name]).expect("registered");
    for needed in &all {
        source += needed.bindings.unwrap_or_default();
    }
    let module = naga::front::wgsl::parse_str(&source).expect("tests/wgsl.rs parses it");
    let declared = m.declares();
    let mut body = String::new();
    for (_, function) in module.functions.iter() {
        let name = function.name.as_deref().unwrap_or_default();
        if !declared.contains(&name) {
            continue;
        }
        let arguments: Vec<_> = function
            .arguments
            .iter()
            .map(|a| zero(&module, a.ty))
            .collect();
        let call = format!("{name}({})", arguments.join(", "));
        body += &match function.result {
            Some(_) => format!("    {{ let result = {call}; }}\n"),
            None => format!("    {call};\n"),
        };
    }
    let used: Vec<&str> = body
        .split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'))
        .collect();
    let imports = all
        .iter()
        .map(|m| {
            let names = m.declares().into_iter().filter(|n| used.contains(n));
            (m.import_path(), names.map(str::to_owned).collect())
        })
        .filter(|(_, names): &(_, Vec<String>)| !names.is_empty())
        .collect();
    let main = format!("@compute @workgroup_size(1)\nfn main() {{\n{body}}}\n");
    (main, imports)
}
