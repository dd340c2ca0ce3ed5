//! The description itself.

use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use super::domain::Words;
use super::{Domain, Domains, Scalar, TypeInfo, Value};

/// How closely the twins can agree, by the operations that they use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// A: integers and exact conversions. Bit-exact by WGSL's own rules, on
    /// every adapter.
    BitExact,
    /// B: `+ - * /`, square roots and our own polynomials. The same bits where
    /// a driver keeps the operations as written, a few ULP where it does not.
    FewUlp,
    /// C: built-in transcendental functions.
    Transcendental,
}

impl Class {
    /// The letter used in tables.
    #[must_use]
    pub fn letter(self) -> char {
        match self {
            Self::BitExact => 'A',
            Self::FewUlp => 'B',
            Self::Transcendental => 'C',
        }
    }
}

/// How far each twin may be from the truth, in ULP of `max(|truth|, scale)`.
///
/// The parity bound needs no number of its own: two values within `cpu` and
/// `gpu` of one truth are within `cpu + gpu` of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Largest error of the CPU twin: IEEE arithmetic, round to nearest.
    pub cpu: f64,
    /// Largest error of the WGSL twin on any conforming implementation.
    pub gpu: f64,
}

impl Bounds {
    /// Largest difference between the twins as shipped.
    #[must_use]
    pub fn parity(&self) -> f64 {
        self.cpu + self.gpu
    }
}

/// Where the bounds come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Derivation {
    /// The tests run the kernel in interval arithmetic over WGSL's accuracy
    /// table and check that the declared bounds are that result, rounded up.
    Interval,
    /// As [`Self::Interval`], with some variables taken at one end of their
    /// interval at a time, because the result uses them more than once.
    ByEnds {
        /// WGSL functions and variables in them.
        variables: &'static [(&'static str, &'static str)],
        /// Why the result is monotone in each on either side of zero, all else
        /// fixed.
        why: &'static str,
    },
    /// An error analysis in the CPU twin's doc comment, because interval
    /// arithmetic cannot see it; the text says why.
    Analysis(&'static str),
}

/// Data that a kernel reads through callbacks, with bindings for the tests.
#[derive(Clone)]
pub struct Fixture {
    /// WGSL that defines the callbacks over `raytwin_fixture: array<u32>`.
    pub wgsl: &'static str,
    /// The contents of that array.
    pub words: Arc<Vec<u32>>,
}

/// Another way to compute the same thing, measured beside the kernel and
/// against the same truth, but promising nothing.
#[derive(Clone)]
pub struct Baseline {
    /// What it is, in a few words.
    pub name: &'static str,
    /// WGSL source of a function `baseline` with the kernel's signature.
    pub wgsl: &'static str,
    /// Its CPU counterpart over whole arrays, as in [`Kernel::run_cpu`].
    pub cpu: Batch,
}

type Batch = Arc<dyn Fn(&[u32], &mut [u32]) + Send + Sync>;

/// One kernel: a pair of functions and everything known about them.
#[derive(Clone)]
pub struct Kernel {
    /// The technique's path, `group/name`.
    pub module: &'static str,
    /// The function's name, the same in Rust and in WGSL.
    pub name: &'static str,
    /// Argument names and types.
    pub inputs: Vec<(&'static str, TypeInfo)>,
    /// Result type.
    pub output: TypeInfo,
    /// Parity class.
    pub class: Class,
    /// Error bounds.
    pub bounds: Bounds,
    /// Where the bounds come from.
    pub derivation: Derivation,
    /// Paper and equation.
    pub source: &'static str,
    /// Inputs that break naive code, as words.
    pub hard: Vec<Vec<u32>>,
    /// Data behind callbacks, if the kernel reads any.
    pub fixture: Option<Fixture>,
    /// Other ways to compute the same thing.
    pub baselines: Vec<Baseline>,
    cpu: Batch,
    truth: Words<Vec<f64>>,
    scale: Words<f64>,
    undecided: Option<Words<bool>>,
    domain: Domain<Vec<u32>>,
}

impl fmt::Debug for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}::{}", self.module, self.name)
    }
}

/// A Rust function whose arguments and result are [`Value`]s.
pub trait TwinFn<Args>: Copy + Send + Sync + 'static {
    /// What it returns.
    type Out: Value;
    /// Argument types.
    fn inputs() -> Vec<TypeInfo>;
    /// Calls it on flat words.
    fn call(&self, words: &[u32]) -> Self::Out;
    /// Flattens an argument list.
    fn flatten(args: &Args) -> Vec<u32>;
}

/// The truth for a [`TwinFn`]: the same arguments, widened.
pub trait TruthFn<Args, Out: ?Sized>: Send + Sync + 'static {
    /// Calls it on flat words.
    fn call(&self, words: &[u32]) -> Out;
}

macro_rules! function_arity {
    ($($t:ident $i:tt),+) => {
        impl<Func, Ret, $($t),+> TwinFn<($($t,)+)> for Func
        where
            Func: Fn($($t),+) -> Ret + Copy + Send + Sync + 'static,
            Ret: Value,
            $($t: Value),+
        {
            type Out = Ret;
            fn inputs() -> Vec<TypeInfo> {
                vec![$($t::info()),+]
            }
            #[inline(always)]
            #[allow(non_snake_case, unused_assignments)]
            fn call(&self, words: &[u32]) -> Ret {
                let mut at = 0;
                $(
                    let $t = $t::read(&words[at..]);
                    at += $t::WORDS;
                )+
                self($($t),+)
            }
            fn flatten(args: &($($t,)+)) -> Vec<u32> {
                let mut words = Vec::new();
                $({
                    let mut part = vec![0; $t::WORDS];
                    args.$i.write(&mut part);
                    words.extend(part);
                })+
                words
            }
        }

        impl<Func, Ret, $($t),+> TruthFn<($($t,)+), Ret> for Func
        where
            Func: Fn($($t::Wide),+) -> Ret + Send + Sync + 'static,
            $($t: Value),+
        {
            #[allow(non_snake_case, unused_assignments)]
            fn call(&self, words: &[u32]) -> Ret {
                let mut at = 0;
                $(
                    let $t = $t::read(&words[at..]).widen();
                    at += $t::WORDS;
                )+
                self($($t),+)
            }
        }
    };
}
function_arity!(A 0);
function_arity!(A 0, B 1);
function_arity!(A 0, B 1, C 2);
function_arity!(A 0, B 1, C 2, D 3);
function_arity!(A 0, B 1, C 2, D 3, E 4);
function_arity!(A 0, B 1, C 2, D 3, E 4, F 5);
function_arity!(A 0, B 1, C 2, D 3, E 4, F 5, G 6);
function_arity!(A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7);

fn batch<Args, F: TwinFn<Args>>(f: F) -> Batch {
    Arc::new(move |input, output| {
        let stride_in: usize = F::inputs().iter().map(TypeInfo::words).sum();
        let stride_out = F::Out::info().words();
        for (i, o) in input
            .chunks_exact(stride_in)
            .zip(output.chunks_exact_mut(stride_out))
        {
            f.call(i).write(o);
        }
    })
}

/// A [`Kernel`] in the making; knows the argument types.
pub struct KernelBuilder<Args, F> {
    kernel: Kernel,
    types: PhantomData<fn(Args) -> F>,
}

impl Kernel {
    /// Describes the function `name` of the technique `module`.
    ///
    /// `twin` is the CPU function itself, `truth` computes the exact answer
    /// for the same arguments in double precision (independently: from the
    /// paper, not from the twin), and `domain` says where both are defined.
    ///
    /// The description starts as class B with bounds of zero ULP; the methods
    /// below complete it.
    #[allow(clippy::new_ret_no_self)]
    pub fn new<Args, F, T, D, const N: usize>(
        module: &'static str,
        name: &'static str,
        arguments: [&'static str; N],
        twin: F,
        truth: T,
        domain: D,
    ) -> KernelBuilder<Args, F>
    where
        Args: 'static,
        F: TwinFn<Args>,
        T: TruthFn<Args, <F::Out as Value>::Wide>,
        D: Domains<Args>,
    {
        let types = F::inputs();
        assert_eq!(types.len(), N, "{module}: {name} names {N} arguments");
        let kernel = Self {
            module,
            name,
            inputs: arguments.into_iter().zip(types).collect(),
            output: F::Out::info(),
            class: Class::FewUlp,
            bounds: Bounds { cpu: 0.0, gpu: 0.0 },
            derivation: Derivation::Interval,
            source: "",
            hard: Vec::new(),
            fixture: None,
            baselines: Vec::new(),
            cpu: batch(twin),
            truth: Arc::new(move |words| {
                let mut lanes = Vec::new();
                F::Out::lanes(truth.call(words), &mut lanes);
                lanes
            }),
            scale: Arc::new(|_| f64::from(f32::MIN_POSITIVE)),
            undecided: None,
            domain: domain.joint().map(|args| F::flatten(&args)),
        };
        KernelBuilder {
            kernel,
            types: PhantomData,
        }
    }
}

impl<Args: 'static, F: TwinFn<Args>> KernelBuilder<Args, F> {
    /// Class A: the twins agree bit by bit, and with the truth.
    #[must_use]
    pub fn bit_exact(mut self) -> Self {
        self.kernel.class = Class::BitExact;
        self
    }

    /// Class B with these bounds, in ULP of `max(|truth|, scale)`.
    #[must_use]
    pub fn few_ulp(mut self, cpu: f64, gpu: f64) -> Self {
        self.kernel.class = Class::FewUlp;
        self.kernel.bounds = Bounds { cpu, gpu };
        self
    }

    /// The size below which errors count as absolute: an error is measured in
    /// ULP of `max(|truth|, scale)`. The default is the smallest normal
    /// number, which makes every error relative.
    #[must_use]
    pub fn scale(mut self, scale: f64) -> Self {
        self.kernel.scale = Arc::new(move |_| scale);
        self
    }

    /// As [`Self::scale`], as a function of the (widened) arguments.
    #[must_use]
    pub fn scale_by(mut self, scale: impl TruthFn<Args, f64>) -> Self {
        self.kernel.scale = Arc::new(move |words| scale.call(words));
        self
    }

    /// Says for which (widened) arguments a discrete part of the answer (hit
    /// or miss, which side) is within rounding of the other choice. Such
    /// inputs are counted and shown, and not compared.
    #[must_use]
    pub fn undecided(mut self, undecided: impl TruthFn<Args, bool>) -> Self {
        self.kernel.undecided = Some(Arc::new(move |words| undecided.call(words)));
        self
    }

    /// The bounds are derived with these WGSL variables, `(function, variable)`,
    /// taken at one end of their interval at a time; see
    /// [`Derivation::ByEnds`].
    #[must_use]
    pub fn by_ends(
        mut self,
        variables: &'static [(&'static str, &'static str)],
        why: &'static str,
    ) -> Self {
        self.kernel.derivation = Derivation::ByEnds { variables, why };
        self
    }

    /// The bounds come from an error analysis, for the reason given.
    #[must_use]
    pub fn by_analysis(mut self, why: &'static str) -> Self {
        self.kernel.derivation = Derivation::Analysis(why);
        self
    }

    /// Paper and equation.
    #[must_use]
    pub fn source(mut self, source: &'static str) -> Self {
        self.kernel.source = source;
        self
    }

    /// Adds inputs that break naive code.
    #[must_use]
    pub fn hard(mut self, cases: impl IntoIterator<Item = Args>) -> Self {
        self.kernel
            .hard
            .extend(cases.into_iter().map(|args| F::flatten(&args)));
        self
    }

    /// The kernel reads through callbacks; see [`Fixture`].
    #[must_use]
    pub fn fixture(mut self, wgsl: &'static str, words: Vec<u32>) -> Self {
        self.kernel.fixture = Some(Fixture {
            wgsl,
            words: Arc::new(words),
        });
        self
    }

    /// Adds another way to compute the same thing; see [`Baseline`].
    #[must_use]
    pub fn baseline<B: TwinFn<Args, Out = F::Out>>(
        mut self,
        name: &'static str,
        wgsl: &'static str,
        cpu: B,
    ) -> Self {
        self.kernel.baselines.push(Baseline {
            name,
            wgsl,
            cpu: batch(cpu),
        });
        self
    }

    /// The finished description.
    #[must_use]
    pub fn build(self) -> Kernel {
        self.kernel
    }
}

impl Kernel {
    /// `group/name::function`.
    #[must_use]
    pub fn path(&self) -> String {
        format!("{}::{}", self.module, self.name)
    }

    /// Words of one argument list.
    #[must_use]
    pub fn words_in(&self) -> usize {
        self.inputs.iter().map(|i| i.1.words()).sum()
    }

    /// Words of one result.
    #[must_use]
    pub fn words_out(&self) -> usize {
        self.output.words()
    }

    /// Type of each result word, with its path (`.x`, `.t`).
    #[must_use]
    pub fn lanes_out(&self) -> Vec<(String, Scalar)> {
        self.output.lanes("")
    }

    /// Type of each argument word, with its path (`n.x`).
    #[must_use]
    pub fn lanes_in(&self) -> Vec<(String, Scalar)> {
        self.inputs.iter().flat_map(|(n, t)| t.lanes(n)).collect()
    }

    /// Runs the CPU twin over whole arrays: `words_in` words an element in,
    /// `words_out` words an element out.
    pub fn run_cpu(&self, input: &[u32], output: &mut [u32]) {
        (self.cpu)(input, output);
    }

    /// The exact answer for one argument list, one number for each result
    /// word.
    #[must_use]
    pub fn truth(&self, input: &[u32]) -> Vec<f64> {
        (self.truth)(input)
    }

    /// The size below which errors count as absolute, for these arguments.
    #[must_use]
    pub fn scale_at(&self, input: &[u32]) -> f64 {
        (self.scale)(input)
    }

    /// Whether a discrete part of the answer is within rounding of the other
    /// choice.
    #[must_use]
    pub fn is_undecided(&self, input: &[u32]) -> bool {
        self.undecided.as_ref().is_some_and(|u| u(input))
    }

    /// Uniform words that one argument list takes.
    #[must_use]
    pub fn domain_words(&self) -> usize {
        self.domain.words()
    }

    /// The argument list that these uniform words stand for.
    #[must_use]
    pub fn draw(&self, words: &[u32]) -> Vec<u32> {
        self.domain.make(words)
    }

    /// `count` argument lists, the same for the same `seed`.
    #[must_use]
    pub fn draw_many(&self, count: usize, seed: u32) -> Vec<u32> {
        let n = self.domain_words();
        let mut words = vec![0; n];
        let mut state = raytwin_cpu::random::pcg::pcg_hash(seed);
        let mut out = Vec::with_capacity(count * self.words_in());
        for _ in 0..count {
            for word in &mut words {
                state = state.wrapping_add(0x9e37_79b9);
                *word = raytwin_cpu::random::pcg::pcg_hash(state);
            }
            out.extend(self.draw(&words));
        }
        out
    }

    /// Distance between `value` and `reference` in ULP of
    /// `max(|truth|, scale)`.
    #[must_use]
    pub fn ulps(&self, input: &[u32], truth: f64, value: f64, reference: f64) -> f64 {
        if value == reference {
            return 0.0;
        }
        (value - reference).abs() / ulp(truth.abs().max(self.scale_at(input)))
    }
}

/// Spacing of `f32` at `x`: the distance between the two numbers around it.
#[must_use]
pub fn ulp(x: f64) -> f64 {
    let x = x.abs().max(f64::from(f32::MIN_POSITIVE));
    let exponent = ((x.to_bits() >> 52) & 0x7ff) as i32 - 1023;
    f64::from(exponent - 23).exp2()
}

/// A technique: one file in each crate, one or more kernels.
#[derive(Clone, Debug)]
pub struct Technique {
    /// `group/name`.
    pub name: &'static str,
    /// What it promises, function by function.
    pub kernels: Vec<Kernel>,
}
