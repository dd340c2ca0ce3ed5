//! Acceptance intervals: what a WGSL function may return.
//!
//! [`Program`] reads WGSL text through naga and runs a function on intervals
//! instead of numbers. Every floating-point operation yields the smallest
//! interval that holds all results the accuracy table of the WGSL
//! specification (section "Floating Point Accuracy") allows, so the interval of
//! an output bounds what a conforming implementation may return for the given
//! input. The method is that of the WebGPU conformance suite; nothing has to be
//! written per kernel.
//!
//! # How branches are taken
//!
//! A comparison of overlapping intervals may go either way. The function is then
//! run once for every combination of such decisions and the results are joined,
//! so integers stay exact within each run. A decision also narrows the compared
//! value for the rest of its run: after `x > 0` came out true, `sqrt(x)` is
//! defined. `floor`, `ceil`, `round`, `trunc` and conversions to integers split
//! in the same way when their argument covers few integers.
//!
//! # What is assumed beyond the specification
//!
//! The specification leaves more open than any implementation uses. These
//! readings keep the intervals useful, and a caller who reports bounds should
//! repeat them:
//!
//! 1. Operations are evaluated as written, apart from fusing `a * b + c`, which
//!    only narrows the result. Reassociation is also legal WGSL but has no error
//!    bound.
//! 2. A literal or const-expression has the value naga gives it, which is the
//!    nearest `f32`.
//! 3. `sqrt(0)` is 0. The table derives `sqrt(x)` from `1 / inverseSqrt(x)`,
//!    which passes through infinity there.
//! 4. A quotient has the sign of the exact quotient, and `0 / y` is 0. The
//!    table's 2.5 ULP would let both cross zero by two subnormal steps.
//! 5. An implementation that flushes a subnormal number in a comparison, in
//!    `floor` or in a conversion also flushes it where the value is used next.
//!    [`Scalar::contains`] therefore takes a subnormal result for a zero.
//!
//! Overflow, division by a range that holds zero, and arguments outside the
//! table's ranges give [`Interval::UNBOUNDED`], which stands for any value,
//! NaN included, and stays unbounded through later arithmetic.

mod arith;
mod machine;
#[cfg(test)]
mod tests;

use machine::Machine;
pub use machine::Program;

/// The accuracy every floating-point operation is held to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Table {
    /// The accuracy table of the WGSL specification: either rounding direction,
    /// subnormal numbers kept or flushed, 2.5 ULP for division and so on.
    Wgsl,
    /// `+ - * / sqrt` rounded to nearest even, subnormal numbers kept, nothing
    /// fused: what the CPU twin computes. On exact inputs this is one value.
    /// Transcendental built-ins, which IEEE 754 does not bound, get one ULP.
    Ieee,
}

/// A closed interval of real numbers; both ends are `f32` values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end, `-inf` when unbounded.
    pub lo: f64,
    /// Upper end, `inf` when unbounded.
    pub hi: f64,
}

impl Interval {
    /// Any value, NaN included.
    pub const UNBOUNDED: Self = Self {
        lo: f64::NEG_INFINITY,
        hi: f64::INFINITY,
    };

    /// Whether both ends are finite.
    #[must_use]
    pub fn is_bounded(&self) -> bool {
        self.lo.is_finite() && self.hi.is_finite()
    }

    /// `hi - lo`; infinite when unbounded.
    #[must_use]
    pub fn width(&self) -> f64 {
        self.hi - self.lo
    }

    /// Whether `x` lies inside. NaN and infinities only lie in an unbounded
    /// interval.
    #[must_use]
    pub fn contains(&self, x: f64) -> bool {
        if self.is_bounded() {
            self.lo <= x && x <= self.hi
        } else {
            true
        }
    }

    /// The largest distance from `x` to a point of the interval: the bound on
    /// the error of a result against the true value `x`.
    #[must_use]
    pub fn distance(&self, x: f64) -> f64 {
        (x - self.lo).abs().max((self.hi - x).abs())
    }

    fn hull(self, other: Self) -> Self {
        Self {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
        }
    }
}

/// A truth value that may be open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tri {
    /// Certainly false.
    False,
    /// Certainly true.
    True,
    /// May be either.
    Either,
}

impl From<bool> for Tri {
    fn from(value: bool) -> Self {
        if value { Self::True } else { Self::False }
    }
}

/// What one 32-bit word of a result may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// Values of an `f32`.
    F32(Interval),
    /// Values of a `u32`, both ends included.
    U32 {
        /// Smallest.
        lo: u32,
        /// Largest.
        hi: u32,
    },
    /// Values of an `i32`, both ends included.
    I32 {
        /// Smallest.
        lo: i32,
        /// Largest.
        hi: i32,
    },
    /// Values of a `bool`.
    Bool(Tri),
}

impl Scalar {
    /// Whether the word an implementation returned is acceptable: `f32` bits,
    /// an integer, or a boolean as 0 or 1. A subnormal `f32` counts as itself
    /// or as zero.
    #[must_use]
    pub fn contains(&self, word: u32) -> bool {
        match *self {
            Self::F32(interval) => {
                let x = f32::from_bits(word);
                interval.contains(f64::from(x)) || (x.is_subnormal() && interval.contains(0.0))
            }
            Self::U32 { lo, hi } => (lo..=hi).contains(&word),
            Self::I32 { lo, hi } => (lo..=hi).contains(&word.cast_signed()),
            Self::Bool(Tri::False) => word == 0,
            Self::Bool(Tri::True) => word == 1,
            Self::Bool(Tri::Either) => word <= 1,
        }
    }

    /// The interval of an `f32`, none for other types.
    #[must_use]
    pub fn interval(&self) -> Option<Interval> {
        match *self {
            Self::F32(interval) => Some(interval),
            _ => None,
        }
    }

    /// Whether exactly one value is possible (zero of either sign counts as one).
    #[must_use]
    pub fn is_exact(&self) -> bool {
        match *self {
            Self::F32(interval) => interval.lo == interval.hi,
            Self::U32 { lo, hi } => lo == hi,
            Self::I32 { lo, hi } => lo == hi,
            Self::Bool(tri) => tri != Tri::Either,
        }
    }

    fn hull(self, other: Self) -> Self {
        match (self, other) {
            (Self::F32(a), Self::F32(b)) => Self::F32(a.hull(b)),
            (Self::U32 { lo: a, hi: b }, Self::U32 { lo: c, hi: d }) => Self::U32 {
                lo: a.min(c),
                hi: b.max(d),
            },
            (Self::I32 { lo: a, hi: b }, Self::I32 { lo: c, hi: d }) => Self::I32 {
                lo: a.min(c),
                hi: b.max(d),
            },
            (Self::Bool(a), Self::Bool(b)) if a == b => self,
            _ => Self::Bool(Tri::Either),
        }
    }
}

/// How much work one call may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Runs of the function, one for each combination of open decisions.
    pub paths: u32,
    /// Open decisions within one run.
    pub depth: u32,
    /// Statements and expressions evaluated, over all runs.
    pub steps: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            paths: 4096,
            depth: 64,
            steps: 20_000_000,
        }
    }
}

/// Why a function could not be evaluated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IntervalError {
    /// The text is not valid WGSL.
    #[error("the WGSL text is not valid: {0}")]
    Parse(String),
    /// No function of that name.
    #[error("the WGSL text has no function `{0}`; check the name")]
    UnknownFunction(String),
    /// No variable of that name.
    #[error("`{function}` has no variable `{name}`; check the name")]
    UnknownVariable {
        /// Function searched.
        function: String,
        /// Name asked for.
        name: String,
    },
    /// The arguments do not fill the parameters.
    #[error("`{function}` takes {expected} argument words, {found} were given")]
    ArgumentCount {
        /// Function called.
        function: String,
        /// Words its parameters take.
        expected: usize,
        /// Words given.
        found: usize,
    },
    /// A part of WGSL that this interpreter does not run.
    #[error("`{function}` uses {what}, which interval evaluation does not support")]
    Unsupported {
        /// Function being run.
        function: String,
        /// The construct.
        what: String,
    },
    /// An array or vector was indexed past its end.
    #[error("`{function}` reads element {index} of {length}")]
    IndexOutOfBounds {
        /// Function being run.
        function: String,
        /// Index used.
        index: i64,
        /// Number of elements.
        length: usize,
    },
    /// Too many decisions are open for this input.
    #[error(
        "`{function}` has more open decisions than the limit ({paths} runs, {depth} deep) \
         for this input; choose an input away from its branches or raise the limits"
    )]
    TooAmbiguous {
        /// Function called.
        function: String,
        /// Limit on runs.
        paths: u32,
        /// Limit on decisions in one run.
        depth: u32,
    },
    /// The step budget is used up.
    #[error("`{function}` did not finish within {steps} steps; raise the limit")]
    TooManySteps {
        /// Function called.
        function: String,
        /// Limit on steps.
        steps: u64,
    },
}

impl Program {
    /// Evaluates `function` on exact arguments and returns, for each 32-bit word
    /// of the result, what it may be.
    ///
    /// Arguments and results are flattened in declaration order: vectors by
    /// component, structs by member, arrays by element, `bool` as 0 or 1.
    ///
    /// # Errors
    /// See [`IntervalError`]; nothing about the input makes this panic.
    pub fn call(
        &self,
        function: &str,
        args: &[u32],
        table: Table,
    ) -> Result<Vec<Scalar>, IntervalError> {
        Machine::call(self, function, args, table)
    }
}
