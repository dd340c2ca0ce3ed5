//! `filter/svgf` over whole images on the CPU.

pub use raytwin_cpu::pass::svgf::*;
