//! Filters over neighbouring pixels.
//!
//! Each is a set of pure steps and a function for a whole pixel that reads its
//! neighbours through callbacks. Results stay between the smallest and the
//! largest of their inputs, channel by channel, on any driver.

pub mod bilateral_upsample;
pub mod bilateral_variance;
pub mod firefly;
pub mod packed_visibility;
pub mod separable_blur;
pub mod spatial_reconstruct;
pub mod svgf;
pub mod tiles;
