//! The proofs: what the tests, the benches and the report share.
//!
//! - [`gpu`] runs any kernel on any adapter, from its description alone.
//! - [`measure`] says how far results are from the truth and from each other.
//! - [`derive`] and [`interval`] say how far WGSL lets them be.
//! - [`rays`] has the exact intersector, the generated meshes and the hard
//!   rays; [`embree`] the peer.
//! - [`scene`] loads meshes.

pub mod crosscheck;
pub mod derive;
pub mod docs;
pub mod embree;
pub mod gpu;
pub mod interval;
pub mod measure;
pub mod rays;
pub mod scene;
pub mod statistics;

/// The README's Rust code compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
