//! Golden vectors: inputs and results of each kernel as bits, so that a port to
//! another language can check itself without Rust or a GPU.
//!
//! `cargo xtask golden` writes a JSON for each kernel under `tests/golden`;
//! `tests/tests/golden.rs` holds both twins to the files. The format is on the
//! page `docs/golden.md`.

use std::path::PathBuf;

use raytwin::contract::{Kernel, Scalar};
use serde::{Deserialize, Serialize};

use crate::measure::{hard_input, run_cpu};

/// The format's number.
pub const FORMAT: u32 = 1;

/// Cases besides the hard ones.
const DRAWN: usize = 12;
const SEED: u32 = 0x901d_0001;

/// A kernel's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Golden {
    /// [`FORMAT`].
    pub format: u32,
    /// The technique: `wgsl/src/MODULE.wgsl`, `cpu/src/MODULE.rs`.
    pub module: String,
    /// The function.
    pub function: String,
    /// `A`, `B` or `C`.
    pub class: String,
    /// Paper and equation.
    pub source: String,
    /// Argument names and WGSL types.
    pub arguments: Vec<(String, String)>,
    /// Result type.
    pub result: String,
    /// Each argument word: its path and `f32` or `u32`.
    pub input: Vec<(String, String)>,
    /// Each result word.
    pub output: Vec<(String, String)>,
    /// Bounds of CPU, GPU and between the twins, in ULP of `max(|truth|, scale)`.
    pub bounds: [f64; 3],
    /// What the kernel's callbacks give, if it has any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fixture: Option<GoldenFixture>,
    /// The vectors.
    pub cases: Vec<Case>,
}

/// Callbacks, in WGSL, over an array of words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoldenFixture {
    /// Defines them over `raytwin_fixture: array<u32>`.
    pub wgsl: String,
    /// That array, in hexadecimal.
    pub words: String,
}

/// One vector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Bits of the argument words, in hexadecimal.
    #[serde(rename = "in")]
    pub input: String,
    /// Bits of the CPU twin's result.
    pub out: String,
    /// How far each result word may be from that, as a number: 0 for integers.
    pub allowed: Vec<f64>,
    /// Whether a discrete choice is within rounding of the other one: then any
    /// result may be right.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undecided: bool,
}

/// Words in hexadecimal, parted by spaces.
#[must_use]
pub fn hex(words: &[u32]) -> String {
    let all: Vec<String> = words.iter().map(|w| format!("{w:08x}")).collect();
    all.join(" ")
}

/// The words of such a text.
///
/// # Errors
/// Names what is not a word.
pub fn words(text: &str) -> Result<Vec<u32>, String> {
    text.split_whitespace()
        .map(|w| u32::from_str_radix(w, 16).map_err(|_| format!("`{w}` is no word of 32 bits")))
        .collect()
}

/// Where a kernel's file is, from the root of the workspace.
#[must_use]
pub fn path(kernel: &Kernel) -> PathBuf {
    PathBuf::from(format!(
        "tests/golden/{}/{}.json",
        kernel.module, kernel.name
    ))
}

/// The number with three digits that is not below this one.
fn upwards(x: f64) -> f64 {
    let digits = |x: f64| format!("{x:.2e}").parse().unwrap_or(x);
    let near = digits(x);
    if near >= x { near } else { digits(x * 1.005) }
}

/// The vectors of a kernel.
#[must_use]
pub fn golden(kernel: &Kernel) -> Golden {
    let mut input = hard_input(kernel);
    input.extend(kernel.draw_many(DRAWN, SEED));
    let output = run_cpu(kernel, &input);
    let lanes = kernel.lanes_out();
    let cases = input
        .chunks_exact(kernel.words_in())
        .zip(output.chunks_exact(kernel.words_out()))
        .map(|(arguments, result)| {
            let truth = kernel.truth(arguments);
            let allowed = lanes.iter().zip(&truth).map(|((_, scalar), truth)| {
                match scalar {
                    Scalar::U32 => 0.0,
                    // Of a difference of 1 the ULPs are one over one ULP.
                    Scalar::F32 => {
                        upwards(kernel.bounds.parity() / kernel.ulps(arguments, *truth, 1.0, 0.0))
                    }
                }
            });
            Case {
                input: hex(arguments),
                out: hex(result),
                allowed: allowed.collect(),
                undecided: kernel.is_undecided(arguments),
            }
        })
        .collect();
    let named = |all: Vec<(String, Scalar)>| -> Vec<(String, String)> {
        all.into_iter()
            .map(|(name, scalar)| {
                let scalar = match scalar {
                    Scalar::F32 => "f32",
                    Scalar::U32 => "u32",
                };
                (name, scalar.to_owned())
            })
            .collect()
    };
    Golden {
        format: FORMAT,
        module: kernel.module.into(),
        function: kernel.name.into(),
        class: kernel.class.letter().into(),
        source: kernel.source.into(),
        arguments: kernel
            .inputs
            .iter()
            .map(|(name, ty)| ((*name).to_owned(), ty.wgsl()))
            .collect(),
        result: kernel.output.wgsl(),
        input: named(kernel.lanes_in()),
        output: named(kernel.lanes_out()),
        bounds: [kernel.bounds.cpu, kernel.bounds.gpu, kernel.bounds.parity()],
        fixture: kernel.fixture.as_ref().map(|f| GoldenFixture {
            wgsl: f.wgsl.into(),
            words: hex(&f.words),
        }),
        cases,
    }
}

/// The file's text: a case a line.
#[must_use]
pub fn text(golden: &Golden) -> String {
    let head = Golden {
        cases: Vec::new(),
        ..golden.clone()
    };
    let head = json(&head);
    let cases: Vec<String> = golden.cases.iter().map(json).collect();
    let head = head.trim_end_matches("[]}");
    format!("{head}[\n{}\n]}}\n", cases.join(",\n"))
}

/// What becomes JSON; these types always do.
fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("plain numbers and texts have a JSON")
}
