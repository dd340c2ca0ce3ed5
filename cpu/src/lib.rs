//! The CPU half of raytwin: ray-tracing kernels as pure functions on glam types.
//!
//! Every function has a WGSL twin of the same name, with the same arguments,
//! operations and constants in the same order (`raytwin-wgsl`; the crate
//! `raytwin` pairs them and says how closely they agree). Nothing here draws
//! random numbers, allocates or keeps state: random numbers come in as `u` in
//! `[0, 1)`, state goes in and comes out.
//!
//! ```
//! use glam::{UVec2, Vec2, Vec3};
//! use raytwin_cpu::random::pcg::{pcg_next, pcg_seed, pcg_unit};
//! use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_world};
//! use raytwin_cpu::sample::hemisphere::hemisphere_cosine_sample;
//!
//! // An ambient-occlusion direction for pixel (3, 5) of frame 7.
//! let first = pcg_next(pcg_seed(UVec2::new(3, 5), 7));
//! let second = pcg_next(first.state);
//! let u = Vec2::new(pcg_unit(first.value), pcg_unit(second.value));
//! let normal = Vec3::Y;
//! let frame = basis_from_normal(normal);
//! let direction = basis_to_world(frame, normal, hemisphere_cosine_sample(u));
//! assert!(direction.y >= 0.0);
//! ```

pub mod brdf;
pub mod filter;
pub mod gi;
pub mod math;
pub mod pass;
pub mod random;
pub mod ray;
pub mod sample;
pub mod simd;
pub mod temporal;
