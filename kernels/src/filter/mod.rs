//! Filters over neighbouring pixels: the pairs and their contracts.

pub mod bilateral_variance;
pub mod spatial_reconstruct;
pub mod svgf;
