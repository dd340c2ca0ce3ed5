//! Kernels by path on either side, for tests of what they do together.

use glam::UVec2;
use raytwin::contract::Kernel;
use raytwin::random::pcg::{pcg_next, pcg_seed, pcg_unit};

use crate::gpu::{self, Build, Gpu, Program};
use crate::measure::run_cpu;

/// Half an ULP of 1: the rounding step of 24-bit random numbers.
pub const EPS: f64 = 1.0 / 16_777_216.0;

/// Where a kernel runs.
#[derive(Clone, Copy)]
pub enum Twin {
    /// The Rust function.
    Cpu,
    /// The WGSL function as shipped, on this adapter.
    Gpu(&'static Gpu),
}

/// A function from an array of argument lists to an array of results.
pub type Run<'a> = Box<dyn Fn(&[u32]) -> Vec<u32> + 'a>;

impl Twin {
    /// As tests print it.
    #[must_use]
    pub fn label(self) -> String {
        match self {
            Self::Cpu => "CPU".into(),
            Self::Gpu(gpu) => gpu.label(),
        }
    }

    /// The kernel, ready for arrays of argument lists.
    ///
    /// # Panics
    /// If the shader does not compile.
    #[must_use]
    pub fn prepare(self, kernel: &Kernel) -> Run<'_> {
        match self {
            Self::Cpu => Box::new(move |input| run_cpu(kernel, input)),
            Self::Gpu(gpu) => {
                let program = Program::new(gpu, kernel, Build::Plain)
                    .unwrap_or_else(|e| panic!("{}: {e}", gpu.label()));
                Box::new(move |input| program.run(input))
            }
        }
    }

    /// The contract's bound, in ULP of `max(|truth|, scale)`.
    #[must_use]
    pub fn bound(self, kernel: &Kernel) -> f64 {
        match self {
            Self::Cpu => kernel.bounds.cpu,
            Self::Gpu(_) => kernel.bounds.gpu,
        }
    }

    /// Largest relative error of one `+`, `-` or `*` in units of [`EPS`]: to
    /// nearest on the CPU, either neighbour in WGSL.
    #[must_use]
    pub fn rounding(self) -> f64 {
        match self {
            Self::Cpu => 1.0,
            Self::Gpu(_) => 2.0,
        }
    }

    /// The same for a division: WGSL allows 2.5 ULP.
    #[must_use]
    pub fn division(self) -> f64 {
        match self {
            Self::Cpu => 1.0,
            Self::Gpu(_) => 5.0,
        }
    }

    /// The same for a square root: WGSL inherits it from `1 / inverseSqrt(x)`,
    /// 2 ULP and 2.5 ULP.
    #[must_use]
    pub fn square_root(self) -> f64 {
        match self {
            Self::Cpu => 1.0,
            Self::Gpu(_) => 9.0,
        }
    }
}

/// Every adapter.
///
/// # Panics
/// If there is none; the message says what to install.
#[must_use]
pub fn gpu_twins() -> Vec<Twin> {
    let gpus = gpu::adapters().unwrap_or_else(|e| panic!("{e}"));
    gpus.iter().map(Twin::Gpu).collect()
}

/// The registry, flat.
#[must_use]
pub fn all_kernels() -> Vec<Kernel> {
    raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .collect()
}

/// The kernel of this path, `sample/cone::cone_sample`.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn kernel(path: &str) -> Kernel {
    all_kernels()
        .into_iter()
        .find(|k| k.path() == path)
        .unwrap_or_else(|| panic!("the registry has no kernel {path}"))
}

/// A test of each function on the CPU twin, and one on every adapter.
#[macro_export]
macro_rules! on_both_twins {
    ($($name:ident)*) => {$(
        mod $name {
            #[test]
            fn cpu() {
                super::$name($crate::twin::Twin::Cpu);
            }
            #[test]
            fn gpu() {
                for twin in $crate::twin::gpu_twins() {
                    super::$name(twin);
                }
            }
        }
    )*};
}

/// Numbers as words, rounded to `f32`.
pub fn f32_words(values: impl IntoIterator<Item = f64>) -> impl Iterator<Item = u32> {
    values.into_iter().map(|v| (v as f32).to_bits())
}

/// A point's two or three components, the third 0 if there is none.
#[must_use]
pub fn components(words: &[u32]) -> [f64; 3] {
    let mut p = [0.0; 3];
    for (p, &word) in p.iter_mut().zip(words) {
        *p = float(word);
    }
    p
}

/// A word as a number.
#[must_use]
pub fn float(word: u32) -> f64 {
    f64::from(f32::from_bits(word))
}

/// Pairs of random numbers as a renderer draws them, as words.
#[must_use]
pub fn random_pairs(count: usize, seed: u32) -> Vec<u32> {
    let mut state = pcg_seed(UVec2::new(seed, 0), 0x5eed);
    (0..2 * count)
        .map(|_| {
            let draw = pcg_next(state);
            state = draw.state;
            pcg_unit(draw.value).to_bits()
        })
        .collect()
}
