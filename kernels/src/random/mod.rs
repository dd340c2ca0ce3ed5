//! Where random numbers come from. The kernels themselves only take `u`.

pub mod halton;
pub mod pcg;
