//! Rays that lose hits in ordinary tracers, the meshes they need, a double
//! precision reference, and the traversal's arithmetic as a compiler may fuse
//! it.

pub mod families;
pub mod fused;
pub mod meshes;
pub mod reference;

#[cfg(test)]
mod tests;
