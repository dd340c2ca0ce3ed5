//! Filters over time: the pairs and their contracts.

pub mod accumulate;
