//! The stages on the CPU: one task a row.

use std::time::Instant;

use glam::UVec2;
use rayon::prelude::*;

use super::program::{Parameters, Surface, stage_shade, stage_sum, stage_surface};
use super::{Stage, StageScene};

/// The surfaces of one view, and what they cost.
pub(super) struct CpuRenderer<'a> {
    scene: &'a StageScene,
    surfaces: Vec<Surface>,
}

impl<'a> CpuRenderer<'a> {
    pub fn new(scene: &'a StageScene) -> Self {
        Self {
            scene,
            surfaces: Vec::new(),
        }
    }

    pub fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }

    /// Runs a stage over the whole picture: colours in the primary stage, else
    /// sums; and milliseconds.
    pub fn run(&mut self, stage: Stage, p: &Parameters) -> (Vec<f32>, f64) {
        let bvh = self.scene.bvh.view();
        let width = p.width as usize;
        let start = Instant::now();
        if stage == Stage::Primary {
            let rows: Vec<(Vec<Surface>, Vec<f32>)> = (0..p.height)
                .into_par_iter()
                .map(|y| {
                    let mut surfaces = Vec::with_capacity(width);
                    let mut colours = Vec::with_capacity(3 * width);
                    for x in 0..p.width {
                        let s = stage_surface(p, &bvh, &self.scene.normals, UVec2::new(x, y));
                        colours.extend(stage_shade(p, &s, 1.0, 1.0).to_array());
                        surfaces.push(s);
                    }
                    (surfaces, colours)
                })
                .collect();
            let ms = milliseconds(start);
            let mut out = Vec::with_capacity(3 * width * p.height as usize);
            self.surfaces.clear();
            for (surfaces, colours) in rows {
                self.surfaces.extend(surfaces);
                out.extend(colours);
            }
            return (out, ms);
        }
        let mut out = vec![0.0; self.surfaces.len()];
        out.par_chunks_mut(width)
            .zip(self.surfaces.par_chunks(width))
            .enumerate()
            .for_each(|(y, (row, surfaces))| {
                for (x, (sum, s)) in row.iter_mut().zip(surfaces).enumerate() {
                    *sum = stage_sum(stage, p, &bvh, s, UVec2::new(x as u32, y as u32));
                }
            });
        (out, milliseconds(start))
    }
}

pub(super) fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
