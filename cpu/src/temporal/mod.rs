//! Filters over time: each pixel against what the frames before knew of it.

pub mod accumulate;
pub mod multiscale_mean;
pub mod reproject;
pub mod taa;
pub mod variance_clamp;
pub mod visibility_clamp;
