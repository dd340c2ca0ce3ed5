//! Global illumination: the pairs and their contracts.

pub mod surfel;
pub mod surfel_grid;
pub mod surfel_irradiance;
