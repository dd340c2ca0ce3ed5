//! Embree 4's C interface as `embree4-rs` and our tests use it, resolved at
//! run time.
//!
//! The published crate of this name declares Embree 4.2: its `RTCRayHit` has
//! 80 bytes, and every Embree from 4.3 on writes an instance-primitive id at
//! byte 80, past its end. Here the layouts are those of 4.3 and later (larger
//! is never wrong with 4.0 to 4.2) and asserted at compile time, and nothing
//! is linked: no headers, no bindgen, no link flags. The functions come from a
//! shared library that [`load`] finds; the names that `embree4-rs` calls
//! forward to it.

#![allow(non_camel_case_types, non_snake_case, non_upper_case_globals)]

mod layout;
mod library;

pub use layout::*;
pub use library::*;
