//! `filter/tiles` over whole images, on the CPU.

pub use raytwin_cpu::pass::tiles::*;
