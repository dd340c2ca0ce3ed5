//! Microbenchmarks and the speed-against-error report.

pub mod report;
pub mod stages;
