//! The frames of a sequence, and their references: ray traced on the CPU, with
//! the random numbers of pixel and frame alone.

use glam::{UVec2, Vec2, Vec3};
use rayon::prelude::*;
use raytwin::filter::spatial_reconstruct::SpatialReconstructHit;
use raytwin::filter::svgf::SvgfSurface;
use raytwin::math::vector::vec3_dot;
use raytwin::ray::camera::Camera;
use raytwin::ray::ray::Ray;
use raytwin::sample::basis::{basis_from_normal, basis_to_world};
use raytwin::sample::cone::{cone_one_minus_cos, cone_sample};
use raytwin::temporal::reproject::{ReprojectSurface, reproject_motion};

use super::Signal;
use super::cache::{self, Fingerprint};
use super::path::Moment;
use crate::reflections::ReflectionScene;
use crate::reflections::program::{
    self as reflect, NONE, Surface, World, reflect_albedo, reflect_any, reflect_half,
    reflect_reconstruct, reflect_sum, reflect_surface,
};
use crate::stages::program::{self as stage, stage_ao_ray, stage_offset, stage_random};
use crate::stages::{Sampler, StageError};

/// A surface's reach over its distance to the eye.
const REACH: f32 = 0.01;

/// The ball that moves, in the row in front.
pub(super) const BALL: usize = 8;

/// Neighbours whose reflection rays a pixel gathers.
const NEIGHBOURS: u32 = 16;

/// Beyond this there is no surface.
const FAR: f32 = 999.0;

/// The first frame's random numbers; those of the references are others.
const FIRST_FRAME: u32 = 16;
const REFERENCE_FRAME: u32 = 1 << 20;

/// One frame.
pub(super) struct Frame {
    pub camera: Camera,
    pub prior_camera: Camera,
    pub surfaces: Vec<ReprojectSurface>,
    /// Each surface where it was in the frame before.
    pub expected: Vec<ReprojectSurface>,
    /// Where to, in pixels.
    pub motion: Vec<Vec2>,
    pub filter: Vec<SvgfSurface>,
    /// One sample a pixel; scalars in each channel.
    pub noisy: Vec<Vec3>,
    /// How far the reflection ray went.
    pub distance: Vec<f32>,
    /// What the filtered value is multiplied by.
    pub albedo: Vec<Vec3>,
    /// What pixels without the signal show.
    pub background: Vec<Vec3>,
    /// Where the signal is.
    pub chosen: Vec<bool>,
}

/// A converged frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Reference {
    pub image: Vec<Vec3>,
    /// Its own error: half the difference of two halves, root mean square over
    /// the pixels with the signal.
    pub error: f64,
}

/// A scene, a signal and a size.
pub(super) struct Film<'a> {
    scene: &'a ReflectionScene<'a>,
    signal: Signal,
    size: UVec2,
    mesh: Fingerprint,
    /// Under the balls, for reflections.
    floor: reflect::Ball,
}

/// What all pixels of a moment share.
struct Setting<'a> {
    reflect: reflect::Parameters,
    stage: stage::Parameters,
    world: World<'a>,
}

fn pixels<T: Send>(size: UVec2, pixel: impl Fn(UVec2) -> T + Send + Sync) -> Vec<T> {
    (0..size.x * size.y)
        .into_par_iter()
        .with_min_len(64)
        .map(|i| pixel(UVec2::new(i % size.x, i / size.x)))
        .collect()
}

/// The seen surface as the stages take it.
fn stage_surface(s: &Surface) -> stage::Surface {
    stage::Surface {
        position: s.position,
        hit: true,
        normal: s.normal,
        distance: 0.0,
    }
}

impl<'a> Film<'a> {
    pub fn new(scene: &'a ReflectionScene<'a>, signal: Signal, size: UVec2) -> Self {
        let mesh = &scene.scene.scene.mesh;
        let mut fingerprint = Fingerprint::new();
        for p in &mesh.positions {
            fingerprint = fingerprint.floats(p.as_ref());
        }
        for i in &mesh.indices {
            fingerprint = fingerprint.numbers(i);
        }
        Self {
            scene,
            signal,
            size,
            mesh: fingerprint,
            floor: scene.polished(),
        }
    }

    fn setting<'b>(
        &'b self,
        moment: &Moment,
        size: UVec2,
        balls: &'b [reflect::Ball],
    ) -> Result<Setting<'b>, StageError> {
        let stage_scene = self.scene.scene;
        let scene = &stage_scene.scene;
        let reflect = reflect::Parameters {
            light_direction: moment.light,
            balls: balls.len() as u32,
            neighbours: NEIGHBOURS,
            ..self.scene.seen_by(&moment.camera, size.x, size.y)?
        };
        Ok(Setting {
            reflect,
            stage: stage::Parameters {
                camera: reflect.camera,
                light_direction: moment.light,
                light_one_minus_cos: cone_one_minus_cos(scene.light.angular_radius),
                offset: stage_scene.offset,
                ao_distance: scene.ao_distance,
                ao_power: 1.0,
                width: size.x,
                height: size.y,
                sampler: Sampler::White,
                samples: 1,
                grid_side: 1,
                frame: 0,
                first_row: 0,
                first_sample: 0,
                sample_count: 1,
            },
            world: World {
                bvh: &stage_scene.wide,
                normals: &stage_scene.normals,
                balls,
            },
        })
    }

    fn balls(&self, moment: &Moment) -> Vec<reflect::Ball> {
        let mut balls = self.scene.balls.clone();
        if let Some(ball) = balls.get_mut(BALL) {
            ball.center += moment.ball;
        }
        if self.signal == Signal::Reflection {
            balls.push(self.floor);
        }
        balls
    }

    /// Whether a pixel traces rays for the signal.
    fn traces(&self, setting: &Setting<'_>, s: &Surface) -> bool {
        if !seen(setting, s) {
            return false;
        }
        match self.signal {
            Signal::SoftShadow => vec3_dot(s.normal, setting.stage.light_direction) > 0.0,
            Signal::AmbientOcclusion => true,
            Signal::Reflection => s.ball != NONE,
        }
    }

    /// One sample of a signal with one channel.
    fn scalar(
        &self,
        x: &Setting<'_>,
        p: &stage::Parameters,
        s: &Surface,
        at: UVec2,
        i: u32,
    ) -> f32 {
        let u = stage_random(p, at, i);
        let ray = if self.signal == Signal::SoftShadow {
            let light = p.light_direction;
            let local = cone_sample(u, p.light_one_minus_cos);
            let direction = basis_to_world(basis_from_normal(light), light, local);
            if vec3_dot(s.normal, direction) <= 0.0 {
                return 0.0;
            }
            Ray {
                origin: s.position,
                direction,
                t_min: stage_offset(p, s.position),
                t_max: f32::MAX,
            }
        } else {
            stage_ao_ray(p, &stage_surface(s), u)
        };
        if reflect_any(x.reflect.balls, &x.world, ray) {
            0.0
        } else {
            1.0
        }
    }

    /// The sum of some samples of a pixel.
    fn sum(&self, x: &Setting<'_>, s: &Surface, at: UVec2, half: u32, samples: u32) -> Vec3 {
        if self.signal == Signal::Reflection {
            let p = reflect::Parameters {
                frame: REFERENCE_FRAME + half * samples,
                sample_count: samples,
                ..x.reflect
            };
            return if x.world.balls[s.ball as usize].count == 1 {
                reflect_sum::<1>(&p, &x.world, s, at)
            } else {
                reflect_sum::<2>(&p, &x.world, s, at)
            };
        }
        let p = stage::Parameters {
            sampler: Sampler::Halton,
            samples,
            frame: half,
            ..x.stage
        };
        let mut sum = 0.0;
        for i in 0..samples {
            sum += self.scalar(x, &p, s, at, i);
        }
        Vec3::splat(sum)
    }

    /// Renders a frame; `prior` is the moment before.
    pub fn frame(&self, moment: &Moment, prior: &Moment, number: u32) -> Result<Frame, StageError> {
        let size = self.size;
        let balls = self.balls(moment);
        let mut x = self.setting(moment, size, &balls)?;
        (x.reflect.frame, x.stage.frame) = (FIRST_FRAME + number, FIRST_FRAME + number);
        let prior_camera = self.setting(prior, size, &balls)?.reflect.camera;
        let (seen_surfaces, background): (Vec<Surface>, Vec<Vec3>) =
            pixels(size, |at| reflect_surface(&x.reflect, &x.world, at))
                .into_iter()
                .unzip();
        let index = |at: UVec2| (at.y * size.x + at.x) as usize;
        let known = |at: UVec2, eye: Vec3, shift: Vec3| {
            let s = &seen_surfaces[index(at)];
            let position = if s.ball == BALL as u32 {
                s.position - shift
            } else {
                s.position
            };
            ReprojectSurface {
                position,
                depth: if seen(&x, s) {
                    position.distance(eye)
                } else {
                    0.0
                },
                normal: s.normal,
                mesh: s.ball.wrapping_add(1),
            }
        };
        let surfaces = pixels(size, |at| known(at, moment.camera.eye, Vec3::ZERO));
        let shift = moment.ball - prior.ball;
        let expected = pixels(size, |at| known(at, prior.camera.eye, shift));
        let motion = pixels(size, |at| {
            let i = index(at);
            reproject_motion(
                surfaces[i].position,
                expected[i].position,
                x.reflect.camera,
                prior_camera,
            )
        });
        let chosen: Vec<bool> = seen_surfaces.iter().map(|s| self.traces(&x, s)).collect();
        let filter = surfaces
            .iter()
            .zip(&chosen)
            .map(|(s, chosen)| SvgfSurface {
                position: s.position,
                // Only pixels with reflections filter each other.
                reach: if *chosen || self.signal != Signal::Reflection {
                    REACH * s.depth
                } else {
                    0.0
                },
                normal: s.normal,
            })
            .collect();
        let (noisy, distance) = if self.signal == Signal::Reflection {
            self.reflections(&x, &seen_surfaces)
        } else {
            let noisy = pixels(size, |at| {
                let s = &seen_surfaces[index(at)];
                Vec3::splat(if chosen[index(at)] {
                    self.scalar(&x, &x.stage, s, at, 0)
                } else {
                    untraced(&x, s)
                })
            });
            (noisy, vec![0.0; seen_surfaces.len()])
        };
        let albedo = seen_surfaces
            .iter()
            .map(|s| match self.signal {
                Signal::Reflection if s.ball != NONE => {
                    reflect_albedo(&balls[s.ball as usize], vec3_dot(s.normal, s.viewer))
                }
                Signal::Reflection => Vec3::ZERO,
                _ => Vec3::ONE,
            })
            .collect();
        Ok(Frame {
            camera: x.reflect.camera,
            prior_camera,
            surfaces,
            expected,
            motion,
            filter,
            noisy,
            distance,
            albedo,
            background: if self.signal == Signal::Reflection {
                background
            } else {
                vec![Vec3::ZERO; seen_surfaces.len()]
            },
            chosen,
        })
    }

    /// Quarter-ray reflections, and how far they went.
    fn reflections(&self, x: &Setting<'_>, surfaces: &[Surface]) -> (Vec<Vec3>, Vec<f32>) {
        let size = self.size;
        let half = (size + 1) / 2;
        let p = &x.reflect;
        let of = |at: UVec2| &surfaces[(at.y * size.x + at.x) as usize];
        let count = |s: &Surface| match s.ball {
            NONE => 0,
            ball => x.world.balls[ball as usize].count,
        };
        let hits = pixels(half, |at| {
            let s = of(2 * at);
            match count(s) {
                0 => SpatialReconstructHit {
                    position: s.position,
                    pdf: 0.0,
                    radiance: Vec3::ZERO,
                },
                1 => reflect_half::<1>(p, &x.world, s, at),
                _ => reflect_half::<2>(p, &x.world, s, at),
            }
        });
        let noisy = pixels(size, |at| match count(of(at)) {
            0 => Vec3::ZERO,
            1 => reflect_reconstruct::<1>(p, &x.world, surfaces, &hits, at).color,
            _ => reflect_reconstruct::<2>(p, &x.world, surfaces, &hits, at).color,
        });
        // The harmonic mean over 3 by 3 of them: what is far says little of
        // where what is near seems to be.
        let distance = pixels(size, |at| {
            let (mut inverse, mut number) = (0.0, 0.0);
            let low = (at / 2).saturating_sub(UVec2::ONE);
            let high = (at / 2 + 1).min(half - 1);
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let at_half = UVec2::new(x, y);
                    let hit = hits[(y * half.x + x) as usize];
                    let s = of(2 * at_half);
                    let away = hit.position.distance(s.position);
                    if hit.pdf > 0.0 && s.ball == of(at).ball && away > 0.0 {
                        inverse += 1.0 / away;
                        number += 1.0;
                    }
                }
            }
            if number > 0.0 { number / inverse } else { 0.0 }
        });
        (noisy, distance)
    }

    fn converge(
        &self,
        moment: &Moment,
        size: UVec2,
        samples: u32,
    ) -> Result<Reference, StageError> {
        let balls = self.balls(moment);
        let x = self.setting(moment, size, &balls)?;
        let half = samples.div_ceil(2);
        let halves = pixels(size, |at| {
            let (s, _) = reflect_surface(&x.reflect, &x.world, at);
            if !self.traces(&x, &s) {
                let value = if self.signal == Signal::Reflection {
                    0.0
                } else {
                    untraced(&x, &s)
                };
                return (Vec3::splat(value), None);
            }
            let [a, b] = [0, 1].map(|k| self.sum(&x, &s, at, k, half) / half as f32);
            (0.5 * (a + b), Some(0.5 * (a - b).as_dvec3()))
        });
        let (mut squares, mut count) = (0.0, 0.0);
        for (_, difference) in &halves {
            if let Some(d) = difference {
                squares += d.length_squared() / 3.0;
                count += 1.0;
            }
        }
        Ok(Reference {
            image: halves.into_iter().map(|(v, _)| v).collect(),
            error: (squares / f64::max(count, 1.0)).sqrt(),
        })
    }

    /// The reference of a moment, rendered or as it was kept.
    pub fn reference(&self, moment: &Moment, samples: u32) -> Result<Reference, StageError> {
        let scene = &self.scene.scene.scene;
        let camera = &moment.camera;
        let mut key = self
            .mesh
            .bytes(self.signal.name().as_bytes())
            .numbers(&[self.size.x, self.size.y, samples])
            .floats(&[
                camera.fov_degrees,
                scene.light.angular_radius,
                scene.ao_distance,
                self.scene.scene.offset,
            ]);
        for v in [
            camera.eye,
            camera.target,
            camera.up,
            moment.light,
            moment.ball,
        ] {
            key = key.floats(&v.to_array());
        }
        // The program's own fingerprint: a few of its pixels.
        for v in self.converge(moment, UVec2::new(24, 14), 4)?.image {
            key = key.floats(&v.to_array());
        }
        let pixels = self.size.element_product() as usize;
        let folder = cache::folder();
        if let Some(kept) = cache::load(&folder, key, 3 * pixels + 1) {
            let (image, error) = kept.split_at(3 * pixels);
            return Ok(Reference {
                image: image.chunks_exact(3).map(Vec3::from_slice).collect(),
                error: f64::from(error[0]),
            });
        }
        let found = self.converge(moment, self.size, samples)?;
        let mut values: Vec<f32> = found.image.iter().flat_map(|v| v.to_array()).collect();
        values.push(found.error as f32);
        // A full disk costs time at the next run, nothing else.
        let _ = cache::store(&folder, key, &values);
        Ok(Reference {
            error: f64::from(found.error as f32),
            ..found
        })
    }
}

/// The value of a pixel that traces no rays.
fn untraced(x: &Setting<'_>, s: &Surface) -> f32 {
    if seen(x, s) { 0.0 } else { 1.0 }
}

/// Whether there is a surface.
fn seen(x: &Setting<'_>, s: &Surface) -> bool {
    s.position.distance(x.reflect.camera.origin) < FAR
}
