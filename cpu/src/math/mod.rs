//! Small numeric building blocks that the other groups stand on.

pub mod exponent;
pub mod luminance;
pub mod octahedral;
pub mod sanitize;
pub mod trig;
pub mod vector;
