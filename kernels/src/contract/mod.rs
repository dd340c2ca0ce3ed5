//! What a kernel promises, said once.
//!
//! A [`Kernel`] names a function that exists twice (a Rust function and a WGSL
//! function of the same name), says over which inputs it is defined, what the
//! exact answer is, how far each twin may be from it, and which inputs are
//! hard. The parity tests, truth tests, hard-case tests, microbenchmarks, the
//! report and the tables in the docs are all derived from that description;
//! none of them knows a kernel by name.

mod domain;
mod kernel;
mod value;

pub use domain::{Domain, Domains, domains};
pub use kernel::{
    Baseline, Bounds, Class, Derivation, Fixture, Kernel, KernelBuilder, Technique, TruthFn,
    TwinFn, ulp,
};
pub use value::{Scalar, TypeInfo, Value};
