//! Rays against shapes, and traversal of a bounding volume hierarchy.

#[cfg(feature = "build")]
pub mod bvh_build;
