//! Filters over time: the pairs and their contracts.

pub mod accumulate;
pub mod multiscale_mean;
pub mod reproject;
pub mod taa;
pub mod variance_clamp;
pub mod visibility_clamp;
