//! Rays against shapes: camera rays, planes, spheres, boxes, triangles and a
//! bounding volume hierarchy.
//!
//! A [`Ray`](ray::Ray) runs over `t_min <= t <= t_max`, both ends included,
//! and `t` counts in lengths of its direction, which need not be a unit
//! vector. Flags in results are `u32`, 0 or 1, so that a result has the same
//! flat layout in WGSL.

pub mod aabb;
pub mod bvh;
pub mod bvh_filter;
pub mod camera;
pub mod instance;
pub mod plane;
#[allow(clippy::module_inception)]
pub mod ray;
pub mod sphere;
pub mod triangle;
