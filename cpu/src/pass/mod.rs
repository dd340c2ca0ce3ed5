//! Whole images and many rays on the processor, as fast as Rust allows.
//!
//! A pass gives the bits of the technique it is built on (`filter/svgf`, and
//! `ray/bvh` for `bvh8`), pixel by pixel and ray by ray. A filter keeps images as planes and works through them in blocks whose loops the
//! compiler turns into vector code. With the feature `rayon` rows run in
//! parallel.

pub mod bvh8;
pub mod surfel;
pub mod surfel_grid;
pub mod svgf;
pub mod tiles;
