//! The reflections on the CPU: one task a row.

use std::time::Instant;

use glam::{UVec2, Vec3};
use rayon::prelude::*;
use raytwin_cpu::filter::spatial_reconstruct::{SpatialReconstructHit, SpatialReconstruction};

use super::ReflectionScene;
use super::program::{
    NONE, Parameters, Surface, World, reflect_finish, reflect_half, reflect_reconstruct,
    reflect_sum, reflect_surface,
};

/// One view with what its passes left.
pub(super) struct CpuReflections<'a> {
    world: World<'a>,
    counts: Vec<u32>,
    pub surfaces: Vec<Surface>,
    /// Colours of the pixels without a ball.
    pub background: Vec<Vec3>,
    hits: Vec<SpatialReconstructHit>,
    means: Vec<SpatialReconstruction>,
}

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// A value for each pixel, row by row.
fn rows<T: Send>(width: u32, height: u32, pixel: impl Fn(UVec2) -> T + Send + Sync) -> Vec<T> {
    let pixel = &pixel;
    (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| pixel(UVec2::new(x, y))))
        .collect()
}

impl<'a> CpuReflections<'a> {
    pub fn new(scene: &'a ReflectionScene<'a>, p: &Parameters) -> Self {
        let world = World {
            bvh: &scene.scene.wide,
            normals: &scene.scene.normals,
            balls: &scene.balls,
        };
        let (surfaces, background) = rows(p.width, p.height, |at| reflect_surface(p, &world, at))
            .into_iter()
            .unzip();
        Self {
            world,
            counts: scene.balls.iter().map(|b| b.count).collect(),
            surfaces,
            background,
            hits: Vec::new(),
            means: Vec::new(),
        }
    }

    fn count(&self, s: &Surface) -> u32 {
        if s.ball == NONE {
            return 0;
        }
        self.counts[s.ball as usize]
    }

    /// Sums over `p.sample_count` samples of every pixel with a ball.
    pub fn sum(&self, p: &Parameters) -> (Vec<Vec3>, f64) {
        let start = Instant::now();
        let out = rows(p.width, p.height, |at| {
            let s = &self.surfaces[(at.y * p.width + at.x) as usize];
            match self.count(s) {
                0 => Vec3::ZERO,
                1 => reflect_sum::<1>(p, &self.world, s, at),
                _ => reflect_sum::<2>(p, &self.world, s, at),
            }
        });
        (out, ms(start))
    }

    /// Traces a ray for each half-resolution pixel.
    pub fn half(&mut self, p: &Parameters) -> f64 {
        let start = Instant::now();
        self.hits = rows(p.width.div_ceil(2), p.height.div_ceil(2), |at| {
            let s = &self.surfaces[(2 * at.y * p.width + 2 * at.x) as usize];
            match self.count(s) {
                0 => SpatialReconstructHit {
                    position: s.position,
                    pdf: 0.0,
                    radiance: Vec3::ZERO,
                },
                1 => reflect_half::<1>(p, &self.world, s, at),
                _ => reflect_half::<2>(p, &self.world, s, at),
            }
        });
        ms(start)
    }

    /// Gathers neighbours.
    pub fn reconstruct(&mut self, p: &Parameters) -> f64 {
        let start = Instant::now();
        self.means = rows(p.width, p.height, |at| {
            let s = &self.surfaces[(at.y * p.width + at.x) as usize];
            let (world, surfaces, hits) = (&self.world, &self.surfaces, &self.hits);
            match self.count(s) {
                0 => SpatialReconstruction {
                    color: Vec3::ZERO,
                    variance: 0.0,
                    samples: 0.0,
                },
                1 => reflect_reconstruct::<1>(p, world, surfaces, hits, at),
                _ => reflect_reconstruct::<2>(p, world, surfaces, hits, at),
            }
        });
        ms(start)
    }

    /// Filters, and multiplies by the albedo.
    pub fn finish(&self, p: &Parameters) -> (Vec<Vec3>, f64) {
        let start = Instant::now();
        let out = rows(p.width, p.height, |at| {
            let s = &self.surfaces[(at.y * p.width + at.x) as usize];
            if s.ball == NONE {
                return Vec3::ZERO;
            }
            reflect_finish(p, &self.world, &self.surfaces, &self.means, at)
        });
        (out, ms(start))
    }
}
