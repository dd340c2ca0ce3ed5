//! Rays against shapes, and traversal of a bounding volume hierarchy.

pub mod aabb;
pub mod bvh;
#[cfg(feature = "build")]
pub mod bvh_build;
pub mod bvh_filter;
pub mod camera;
pub mod instance;
#[cfg(feature = "build")]
pub mod instance_build;
pub mod plane;
#[allow(clippy::module_inception)]
pub mod ray;
pub mod sphere;
pub mod triangle;
