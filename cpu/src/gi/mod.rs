//! Global illumination: light that has bounced before, kept in the scene.

pub mod surfel;
pub mod surfel_grid;
pub mod surfel_irradiance;
