//! Every WGSL file is what it promises to be: plain, importable, portable.

use naga::back::{glsl, hlsl, msl, spv};
use naga::valid::{
    Capabilities, ModuleInfo, ShaderStages, SubgroupOperationSet, ValidationFlags, Validator,
};
use raytwin::wgsl::{Images, MODULES, Module, Pass};

/// One line that keeps every function of the module alive: back ends drop what
/// no entry point reaches, so the entry point calls them all.
fn with_entry_point(source: &str) -> Result<String, String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))?;
    let mut calls = String::new();
    for (_, function) in module.functions.iter() {
        let name = function.name.as_deref().unwrap_or_default();
        let mut arguments = Vec::new();
        for argument in &function.arguments {
            arguments.push(zero(&module, argument.ty)?);
        }
        let call = format!("{name}({})", arguments.join(", "));
        calls += &match function.result {
            Some(_) => format!("    {{ let result = {call}; }}\n"),
            None => format!("    {call};\n"),
        };
    }
    Ok(format!(
        "{source}\n@compute @workgroup_size(1) fn test_main() {{\n{calls}}}\n"
    ))
}

fn zero(module: &naga::Module, ty: naga::Handle<naga::Type>) -> Result<String, String> {
    use naga::{ScalarKind, TypeInner, VectorSize};
    let ty = &module.types[ty];
    let scalar = |kind: ScalarKind| match kind {
        ScalarKind::Float => Ok("f32"),
        ScalarKind::Uint => Ok("u32"),
        ScalarKind::Sint => Ok("i32"),
        ScalarKind::Bool => Ok("bool"),
        other => Err(format!("parameters of kind {other:?} are not portable")),
    };
    match &ty.inner {
        TypeInner::Scalar(s) => Ok(format!("{}()", scalar(s.kind)?)),
        TypeInner::Vector { size, scalar: s } => {
            let n = match size {
                VectorSize::Bi => 2,
                VectorSize::Tri => 3,
                VectorSize::Quad => 4,
            };
            Ok(format!("vec{n}<{}>()", scalar(s.kind)?))
        }
        TypeInner::Struct { .. } => Ok(format!("{}()", ty.name.as_deref().unwrap_or_default())),
        other => Err(format!("a parameter of type {other:?} cannot be passed on")),
    }
}

fn complete_source(module: &Module) -> String {
    let mut source = raytwin::wgsl::link(&[module.name]).expect("registered names link");
    for needed in raytwin::wgsl::linked(&[module.name]).expect("registered names link") {
        source += needed.bindings.unwrap_or_default();
    }
    source
}

fn validated(source: &str) -> Result<(naga::Module, ModuleInfo), String> {
    let module = naga::front::wgsl::parse_str(source).map_err(|e| e.emit_to_string(source))?;
    // No capability at all: what any WebGPU implementation takes.
    let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
        .validate(&module)
        .map_err(|e| e.emit_to_string(source))?;
    Ok((module, info))
}

fn each_module(check: impl Fn(&Module) -> Result<(), String>) {
    let failures: Vec<_> = MODULES
        .iter()
        .filter_map(|m| check(m).err().map(|e| format!("{}: {e}", m.name)))
        .collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_module_validates_with_its_dependencies_alone() {
    each_module(|m| validated(&complete_source(m)).map(drop));
}

/// Each of the passes over each kind of image is a whole program, and back ends
/// take it.
#[test]
fn every_pass_translates_over_all_images() {
    let mut failures = Vec::new();
    for pass in raytwin::wgsl::PASSES {
        for images in [Images::Buffers, Images::Textures16, Images::Textures32] {
            if let Err(e) = translated_pass(pass, images) {
                failures.push(format!("{} over {images:?}: {e}", pass.name));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

fn translated_pass(pass: &Pass, images: Images) -> Result<(), String> {
    let source = raytwin::wgsl::link_pass(pass.name, images).map_err(|e| e.to_string())?;
    let module = naga::front::wgsl::parse_str(&source).map_err(|e| e.emit_to_string(&source))?;
    let (capabilities, subgroups) = if pass.subgroups {
        (Capabilities::SUBGROUP, SubgroupOperationSet::all())
    } else {
        (Capabilities::empty(), SubgroupOperationSet::empty())
    };
    let info = Validator::new(ValidationFlags::all(), capabilities)
        .subgroup_stages(ShaderStages::COMPUTE)
        .subgroup_operations(subgroups)
        .validate(&module)
        .map_err(|e| e.emit_to_string(&source))?;
    if module.entry_points.is_empty() {
        return Err("there is no entry point".into());
    }
    spv::write_vec(&module, &info, &spv::Options::default(), None)
        .map_err(|e| format!("SPIR-V: {e}"))?;
    msl::write_string(
        &module,
        &info,
        &msl::Options {
            lang_version: (2, 1),
            fake_missing_bindings: true,
            ..Default::default()
        },
        &msl::PipelineOptions::default(),
    )
    .map_err(|e| format!("MSL: {e}"))?;
    hlsl::Writer::new(
        &mut String::new(),
        &hlsl::Options {
            fake_missing_bindings: true,
            shader_model: hlsl::ShaderModel::V6_0,
            ..Default::default()
        },
        &hlsl::PipelineOptions::default(),
    )
    .write(&module, &info, None)
    .map_err(|e| format!("HLSL: {e}"))?;
    Ok(())
}

#[test]
fn every_module_translates_to_spirv_msl_hlsl_and_glsl() {
    each_module(|m| {
        let source = with_entry_point(&complete_source(m))?;
        let (module, info) = validated(&source)?;
        let stage = naga::ShaderStage::Compute;
        let entry = "test_main".to_string();

        let words = spv::write_vec(&module, &info, &spv::Options::default(), None)
            .map_err(|e| format!("SPIR-V: {e}"))?;
        let (text, _) = msl::write_string(
            &module,
            &info,
            &msl::Options {
                // reverse_bits came with 2.1; wgpu asks for at least that.
                lang_version: (2, 1),
                fake_missing_bindings: true,
                ..Default::default()
            },
            &msl::PipelineOptions::default(),
        )
        .map_err(|e| format!("MSL: {e}"))?;

        let mut hlsl_text = String::new();
        hlsl::Writer::new(
            &mut hlsl_text,
            &hlsl::Options {
                fake_missing_bindings: true,
                ..Default::default()
            },
            &hlsl::PipelineOptions::default(),
        )
        .write(&module, &info, None)
        .map_err(|e| format!("HLSL: {e}"))?;

        let mut glsl_text = String::new();
        glsl::Writer::new(
            &mut glsl_text,
            &module,
            &info,
            &glsl::Options {
                version: glsl::Version::Embedded {
                    version: 310,
                    is_webgl: false,
                },
                ..Default::default()
            },
            &glsl::PipelineOptions {
                shader_stage: stage,
                entry_point: entry,
                multiview: None,
            },
            naga::proc::BoundsCheckPolicies::default(),
        )
        .and_then(|mut writer| writer.write())
        .map_err(|e| format!("GLSL ES 3.10: {e}"))?;

        // The translations hold the code and not just a shell around it.
        for name in function_names(m.source) {
            for (language, text) in [("MSL", &text), ("HLSL", &hlsl_text), ("GLSL", &glsl_text)] {
                if !text.contains(&name) {
                    return Err(format!("{language} lacks `{name}`"));
                }
            }
        }
        (words.len() > 100)
            .then_some(())
            .ok_or_else(|| "SPIR-V is empty".into())
    });
}

fn code_lines(source: &str) -> impl Iterator<Item = &str> {
    source
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default())
}

fn function_names(source: &str) -> Vec<String> {
    code_lines(source)
        .filter_map(|line| line.strip_prefix("fn "))
        .filter_map(|rest| rest.split('(').next())
        .map(str::to_string)
        .collect()
}

#[test]
fn every_module_is_declarations_only() {
    each_module(|m| {
        for (number, line) in code_lines(m.source).enumerate() {
            let first = line.split_whitespace().next().unwrap_or_default();
            if line.contains('@') {
                return Err(format!("line {}: an attribute", number + 1));
            }
            if [
                "enable",
                "requires",
                "diagnostic",
                "import",
                "#import",
                "override",
            ]
            .contains(&first)
            {
                return Err(format!("line {}: a directive", number + 1));
            }
            // A `var` at the left margin is a module-scope variable.
            if line.starts_with("var") {
                return Err(format!("line {}: a module-scope variable", number + 1));
            }
        }
        Ok(())
    });
}

#[test]
fn no_module_uses_what_drivers_may_change() {
    // Built-ins whose operation order or accuracy is open, and what the twins
    // therefore spell out.
    let banned = [
        "dot",
        "cross",
        "normalize",
        "length",
        "distance",
        "mix",
        "smoothstep",
        "fma",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "exp",
        "exp2",
        "log",
        "log2",
        "pow",
        "sign",
        "inverseSqrt",
        "reflect",
        "refract",
        "fract",
        "faceForward",
        "degrees",
        "radians",
    ];
    each_module(|m| {
        for (number, line) in code_lines(m.source).enumerate() {
            for call in banned {
                let mut rest = line;
                while let Some(at) = rest.find(&format!("{call}(")) {
                    let before = rest[..at].chars().next_back();
                    if !before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
                        return Err(format!("line {}: `{call}`", number + 1));
                    }
                    rest = &rest[at + call.len()..];
                }
            }
        }
        Ok(())
    });
}

#[test]
fn names_are_unique_over_the_whole_kit_and_importable() {
    let mut seen = std::collections::BTreeMap::new();
    for m in MODULES {
        let module = naga::front::wgsl::parse_str(&complete_source(m)).expect("validated above");
        for line in code_lines(m.source) {
            let declared = ["fn ", "const ", "struct ", "alias "]
                .iter()
                .find_map(|k| line.strip_prefix(k));
            if let Some(rest) = declared {
                let name: String = rest
                    .chars()
                    .take_while(|c| c.is_alphanumeric() || *c == '_')
                    .collect();
                let other = seen.insert(name.clone(), m.name);
                assert_eq!(other, None, "`{name}` is declared again in {}", m.name);
            }
        }
        // naga_oil renames members that end in a digit or underscore, and then
        // refuses the module.
        for (_, ty) in module.types.iter() {
            if let naga::TypeInner::Struct { members, .. } = &ty.inner {
                for member in members {
                    let name = member.name.as_deref().unwrap_or_default();
                    assert!(
                        !name.ends_with(|c: char| c.is_ascii_digit() || c == '_'),
                        "{}: struct member `{name}`",
                        m.name
                    );
                }
            }
        }
    }
}

#[test]
fn all_modules_link_into_one_program() {
    let names: Vec<_> = MODULES.iter().map(|m| m.name).collect();
    let mut source = raytwin::wgsl::link(&names).expect("registered names link");
    let linked = source.clone();
    for m in MODULES {
        source += m.bindings.unwrap_or_default();
    }
    if let Err(message) = validated(&source) {
        panic!("{message}");
    }
    // The same with textures where there are some.
    let mut source = linked;
    for m in MODULES {
        source += match m.textures {
            Some(textures) => textures.source,
            None => m.bindings.unwrap_or_default(),
        };
    }
    if let Err(message) = validated(&source) {
        panic!("{message}");
    }
}
