//! Whole images: passes built on the techniques of the same name.

pub mod svgf;
