//! Global illumination: the pairs and their contracts.

pub mod surfel;
