//! Whole images on the processor, as fast as plain Rust allows.
//!
//! A pass gives the bits of the technique of the same name, pixel by pixel; it
//! keeps images as planes and works through them in blocks whose loops the
//! compiler turns into vector code. With the feature `rayon` rows run in
//! parallel.

pub mod bvh8;
pub mod svgf;
