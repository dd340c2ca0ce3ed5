//! The stages' per-pixel program on the CPU: the twin of `program.wgsl`.
//!
//! The primary stage fills a buffer of surfaces (position and geometric
//! normal), as the chapter's rasteriser fills its G-buffer; the others start
//! from there.

use glam::{UVec2, Vec2, Vec3};
use raytwin_cpu::math::exponent::pow_poly;
use raytwin_cpu::math::vector::{vec3_dot, vec3_length};
use raytwin_cpu::random::halton::{halton_init, halton_next, halton_rotate};
use raytwin_cpu::random::pcg::{pcg_next, pcg_seed, pcg_unit};
use raytwin_cpu::ray::bvh::{BVH_MISS, BvhView, bvh_any, bvh_closest};
use raytwin_cpu::ray::camera::{Camera, camera_ray};
use raytwin_cpu::ray::ray::{Ray, ray_at};
use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_world};
use raytwin_cpu::sample::cone::cone_sample;
use raytwin_cpu::sample::hemisphere::hemisphere_cosine_sample;

use super::{Sampler, Stage};

/// Frames after which the Halton points repeat. The index has room for 23,014
/// samples of a pixel: `4 · samples` must stay below.
pub(crate) const FRAME_LOOP: u32 = 4;

/// Least offset as a fraction of the distance from the origin, 2^-18: 32 ULP,
/// where a hit point is wrong by two or three.
const OFFSET_PRECISION: f32 = 1.0 / 262_144.0;

/// What every pixel of one run shares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parameters {
    pub camera: Camera,
    pub light_direction: Vec3,
    pub light_one_minus_cos: f32,
    pub offset: f32,
    pub ao_distance: f32,
    pub ao_power: f32,
    pub width: u32,
    pub height: u32,
    pub sampler: Sampler,
    pub samples: u32,
    pub grid_side: u32,
    pub frame: u32,
    pub first_row: u32,
    pub first_sample: u32,
    pub sample_count: u32,
}

impl Parameters {
    /// The layout of `StageParameters`: 36 words.
    pub fn words(&self) -> Vec<u32> {
        let mut words = Vec::with_capacity(36);
        let c = &self.camera;
        for v in [c.origin, c.right, c.up, c.forward] {
            words.extend(v.to_array().map(f32::to_bits));
            words.push(0);
        }
        words.extend(c.inverse_resolution.to_array().map(f32::to_bits));
        words.extend([0, 0]);
        words.extend(self.light_direction.to_array().map(f32::to_bits));
        words.extend(
            [
                self.light_one_minus_cos,
                self.offset,
                self.ao_distance,
                self.ao_power,
            ]
            .map(f32::to_bits),
        );
        words.extend([
            self.width,
            self.height,
            self.sampler as u32,
            self.samples,
            self.grid_side,
            self.frame,
            self.first_row,
            self.first_sample,
            self.sample_count,
        ]);
        words
    }
}

/// What a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Surface {
    /// Where; without a surface the view direction.
    pub position: Vec3,
    pub hit: bool,
    /// Geometric, towards the eye.
    pub normal: Vec3,
    pub distance: f32,
}

/// Two numbers in `[0, 1)` for one sample of one pixel.
///
/// Halton as in the chapter's ray-generation shader: the point of this path of
/// this frame, rotated by random numbers of this pixel and frame. All samples
/// of a frame share one rotation. (Read as pseudocode for one path a frame,
/// the chapter draws the shift beside the point; a fresh shift for each of
/// several points would turn the sequence into white noise.) White noise is
/// what a renderer gets that seeds by pixel and frame and takes one sample a
/// frame.
#[inline]
pub(crate) fn stage_random(p: &Parameters, pixel: UVec2, sample: u32) -> Vec2 {
    match p.sampler {
        Sampler::White => {
            let a = pcg_next(pcg_seed(
                pixel,
                p.frame.wrapping_mul(p.samples).wrapping_add(sample),
            ));
            let b = pcg_next(a.state);
            Vec2::new(pcg_unit(a.value), pcg_unit(b.value))
        }
        Sampler::Halton => {
            let state = halton_init(pixel.x, pixel.y, sample, p.samples, p.frame, FRAME_LOOP);
            let x = halton_next(state);
            let y = halton_next(x.state);
            let a = pcg_next(pcg_seed(pixel, p.frame));
            let b = pcg_next(a.state);
            Vec2::new(
                halton_rotate(x.value, pcg_unit(a.value)),
                halton_rotate(y.value, pcg_unit(b.value)),
            )
        }
        Sampler::Grid => {
            let side = p.grid_side as f32;
            Vec2::new(
                ((sample % p.grid_side) as f32 + 0.5) / side,
                ((sample / p.grid_side) as f32 + 0.5) / side,
            )
        }
    }
}

/// Where secondary rays start, so that they do not meet the surface that they
/// leave.
///
/// The chapter takes `max(1, |position|)·1e-3` metres, for a room, because its
/// positions come from a depth buffer. Here the 1 is an eighth of the scene's
/// diagonal, so that the scene's unit does not matter; positions come from the
/// ray itself, so far from the origin only the spacing of `f32` counts: a
/// thousandth of `|position|` would swallow a small model far away.
#[inline]
pub(crate) fn stage_offset(p: &Parameters, position: Vec3) -> f32 {
    p.offset.max(vec3_length(position) * OFFSET_PRECISION)
}

/// The primary ray through the middle of a pixel.
#[inline]
pub(crate) fn stage_surface(
    p: &Parameters,
    bvh: &BvhView<'_>,
    normals: &[Vec3],
    pixel: UVec2,
) -> Surface {
    let ray = camera_ray(
        Vec2::new(pixel.x as f32 + 0.5, pixel.y as f32 + 0.5),
        p.camera,
    );
    let hit = bvh_closest(bvh, ray);
    if hit.primitive == BVH_MISS {
        return Surface {
            position: ray.direction,
            hit: false,
            normal: Vec3::ZERO,
            distance: 0.0,
        };
    }
    let n = normals[hit.primitive as usize];
    let away = vec3_dot(n, ray.direction) > 0.0;
    Surface {
        position: ray_at(ray, hit.t),
        hit: true,
        normal: if away { -n } else { n },
        distance: hit.t,
    }
}

/// A neutral look: a sky above and a floor below, of which the fraction `open`
/// is seen, and the light, of which the fraction `light` is.
#[inline]
pub(crate) fn stage_shade(p: &Parameters, s: &Surface, light: f32, open: f32) -> Vec3 {
    if !s.hit {
        let up = 0.5 + 0.5 * s.position.y;
        return Vec3::new(0.60 - 0.34 * up, 0.68 - 0.30 * up, 0.78 - 0.22 * up);
    }
    let up = 0.5 + 0.5 * s.normal.y;
    let key = vec3_dot(s.normal, p.light_direction).max(0.0) * light;
    Vec3::new(
        (0.18 + 0.13 * up) * open + 0.62 * key,
        (0.16 + 0.17 * up) * open + 0.55 * key,
        (0.15 + 0.22 * up) * open + 0.45 * key,
    )
}

#[inline]
pub(crate) fn stage_faces_light(p: &Parameters, s: &Surface) -> bool {
    s.hit && vec3_dot(s.normal, p.light_direction) > 0.0
}

#[inline]
fn stage_light_visible(p: &Parameters, bvh: &BvhView<'_>, s: &Surface, direction: Vec3) -> f32 {
    let ray = Ray {
        origin: s.position,
        direction,
        t_min: stage_offset(p, s.position),
        t_max: f32::MAX,
    };
    if bvh_any(bvh, ray) != 0 { 0.0 } else { 1.0 }
}

#[inline]
fn stage_soft_shadow_sample(p: &Parameters, bvh: &BvhView<'_>, s: &Surface, u: Vec2) -> f32 {
    let light = p.light_direction;
    let local = cone_sample(u, p.light_one_minus_cos);
    let direction = basis_to_world(basis_from_normal(light), light, local);
    // The part of the light below the surface's horizon gives it nothing.
    if vec3_dot(s.normal, direction) <= 0.0 {
        return 0.0;
    }
    stage_light_visible(p, bvh, s, direction)
}

#[inline]
pub(crate) fn stage_ao_ray(p: &Parameters, s: &Surface, u: Vec2) -> Ray {
    let local = hemisphere_cosine_sample(u);
    let direction = basis_to_world(basis_from_normal(s.normal), s.normal, local);
    let t_min = stage_offset(p, s.position);
    Ray {
        origin: s.position,
        direction,
        t_min,
        t_max: p.ao_distance.max(t_min),
    }
}

#[inline]
fn stage_ao_sample(p: &Parameters, bvh: &BvhView<'_>, s: &Surface, u: Vec2) -> f32 {
    if bvh_any(bvh, stage_ao_ray(p, s, u)) != 0 {
        0.0
    } else {
        1.0
    }
}

#[inline]
fn stage_ao_power_sample(p: &Parameters, bvh: &BvhView<'_>, s: &Surface, u: Vec2) -> f32 {
    let hit = bvh_closest(bvh, stage_ao_ray(p, s, u));
    if hit.primitive == BVH_MISS {
        return 1.0;
    }
    pow_poly(hit.t / p.ao_distance, p.ao_power)
}

/// Whether a pixel's samples are rays in this stage.
#[inline]
pub(crate) fn stage_traces(stage: Stage, p: &Parameters, s: &Surface) -> bool {
    match stage {
        Stage::Primary => true,
        Stage::HardShadow | Stage::SoftShadow => stage_faces_light(p, s),
        Stage::AmbientOcclusion | Stage::AmbientOcclusionPower => s.hit,
    }
}

/// The sum over a pixel's samples, in a stage that has one channel.
#[inline]
pub(crate) fn stage_sum(
    stage: Stage,
    p: &Parameters,
    bvh: &BvhView<'_>,
    s: &Surface,
    pixel: UVec2,
) -> f32 {
    let traces = stage_traces(stage, p, s);
    let untraced = if s.hit { 0.0 } else { 1.0 };
    let mut sum = 0.0;
    for i in 0..p.sample_count {
        let sample = p.first_sample + i;
        sum += if !traces {
            untraced
        } else {
            match stage {
                Stage::Primary => 0.0,
                Stage::HardShadow => stage_light_visible(p, bvh, s, p.light_direction),
                Stage::SoftShadow => {
                    stage_soft_shadow_sample(p, bvh, s, stage_random(p, pixel, sample))
                }
                Stage::AmbientOcclusion => {
                    stage_ao_sample(p, bvh, s, stage_random(p, pixel, sample))
                }
                Stage::AmbientOcclusionPower => {
                    stage_ao_power_sample(p, bvh, s, stage_random(p, pixel, sample))
                }
            }
        };
    }
    sum
}
