//! Microbenchmarks and the speed-against-error report.

pub mod reflections;
pub mod report;
pub mod sequence;
pub mod stages;
pub mod surfels;
pub mod tinybvh;
