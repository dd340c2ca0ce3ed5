//! Ray-tracing kernels that ship twice: as Rust functions and as WGSL.
//!
//! Every technique is a module that holds the pair. Call the CPU twin, or take
//! the WGSL text and its requirements:
//!
//! ```
//! use glam::Vec2;
//! use raytwin::sample::cone;
//!
//! // On the CPU.
//! let one_minus_cos = cone::cone_one_minus_cos(0.00465); // the Sun
//! let direction = cone::cone_sample(Vec2::new(0.3, 0.7), one_minus_cos);
//!
//! // In a shader: the same function under the same name.
//! let source = raytwin::wgsl::link(&["sample/cone"])?;
//! assert!(source.contains("fn cone_sample(u: vec2f, one_minus_cos: f32) -> vec3f"));
//! # Ok::<(), raytwin::wgsl::LinkError>(())
//! ```
//!
//! # Features
//! - `build`: BVH building through obvhs.
//! - `gpu`: ready wgpu pieces.
//! - `rayon`: passes over whole images on the CPU work on rows in parallel.
//! - `wesl`: the WGSL as a WESL package for cargo (`wgsl::wesl::PACKAGE`); asks for
//!   Rust 1.97.1.
//! - `contract`: what each kernel promises (module `contract`), for tests, benches
//!   and reports.

pub use raytwin_cpu as cpu;
pub use raytwin_wgsl as wgsl;

pub mod brdf;
#[cfg(feature = "contract")]
pub mod contract;

pub mod filter;
pub mod gi;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod math;
pub mod pass;
pub mod random;
pub mod ray;
pub mod sample;
pub mod temporal;

#[cfg(feature = "contract")]
mod registry;
#[cfg(feature = "contract")]
pub use registry::registry;
