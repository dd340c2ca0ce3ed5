//! Filters over neighbouring pixels: the pairs and their contracts.

pub mod bilateral_upsample;
pub mod bilateral_variance;
pub mod firefly;
pub mod packed_visibility;
pub mod separable_blur;
pub mod spatial_reconstruct;
pub mod svgf;
pub mod tiles;
