//! Whole images and many rays: passes built on the techniques of the same name.

pub mod bvh8;
#[cfg(feature = "gpu")]
pub mod image;
pub mod svgf;
pub mod tiles;
