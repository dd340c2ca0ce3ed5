//! Warps from the unit square to disks, spheres, cones and hemispheres, each
//! as sample / pdf / invert.
//!
//! `u` always has components in `[0, 1)`, densities are per steradian (per
//! unit area for the disk), and directions are in a frame whose z axis is the
//! axis of the cone or hemisphere; [`basis`] turns them into the world.

pub mod basis;
pub mod cone;
pub mod disk;
pub mod hemisphere;
pub mod sphere;
