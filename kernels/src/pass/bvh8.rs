//! `ray/bvh` with eight children a node, on the CPU.

pub use raytwin_cpu::pass::bvh8::*;
