//! Surfels as the light that bounces, beside path-traced references.
//!
//! An open box in the manner of Cornell's, or the kitchen with its sun and sky:
//! diffuse surfaces alone. Light straight from the lamp is traced; the rest
//! comes from [`SurfelPass`]. [`measure`] follows the error after a cut, after
//! the lamp has changed, after it went out, and while the camera flies.

use std::collections::HashMap;
use std::f32::consts::PI;
use std::time::Instant;

use glam::{UVec2, UVec3, Vec2, Vec3, vec3};
use rayon::prelude::*;
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin_cpu::gi::surfel::{Surfel, surfel_colored_occlusion};
use raytwin_cpu::gi::surfel_grid::SurfelGrid;
use raytwin_cpu::gi::surfel_irradiance::surfel_irradiance_outgoing;
use raytwin_cpu::pass::bvh8::Bvh8;
use raytwin_cpu::pass::surfel::{SurfelHit, SurfelPass, SurfelPixel, SurfelSettings, SurfelView};
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_cpu::ray::bvh::BVH_MISS;
use raytwin_cpu::ray::camera::{Camera, camera_ray};
use raytwin_cpu::ray::ray::Ray;
use raytwin_cpu::sample::basis::{basis_from_normal, basis_to_world};
use raytwin_cpu::sample::hemisphere::hemisphere_cosine_sample;
use raytwin_tests::scene::{Camera as SceneCamera, Scene};

use crate::sequence::cache::{self, Fingerprint};
use crate::sequence::metrics::{errors, flip};
use crate::stages::{StageError, srgb8};

/// Shadow rays behind the direct light of a shown pixel.
const SHADOW_RAYS: u32 = 64;
/// Occlusion rays behind a shown pixel.
const OCCLUSION_RAYS: u32 = 64;
/// Bounces of a reference's path, at most; half of a path is left after four.
const BOUNCES: u32 = 24;
/// Area of all surfels of a full pool over that of the scene. A surfel's weight
/// is a third on the mean, the least covered pixel wants 0.8, and what is not
/// seen any more keeps its surfels for a while.
const ROOM_FOR: f32 = 6.0;
/// After a cut, with surfels on both sides of all that there is.
pub const EVERYWHERE: &str = "after a cut, surfels everywhere";
/// Frames at which the error is taken, from 1.
const FRAMES: [u32; 9] = [1, 2, 4, 8, 16, 32, 64, 128, 256];

/// Sizes and counts.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfelReportSettings {
    /// Width and height of what the surfels see.
    pub size: UVec2,
    /// Pixels from one shown pixel to the next.
    pub step: u32,
    /// Frames after a cut; half as many after the lamp has changed.
    pub frames: u32,
    /// Samples of a pixel in the references.
    pub reference_samples: u32,
    /// Numbers of surfels.
    pub budgets: Vec<u32>,
}

impl SurfelReportSettings {
    /// For the quick report.
    #[must_use]
    pub fn quick() -> Self {
        Self {
            size: UVec2::new(384, 288),
            step: 4,
            frames: 64,
            reference_samples: 1024,
            budgets: vec![1_000, 4_000],
        }
    }

    /// For the long run.
    #[must_use]
    pub fn full() -> Self {
        Self {
            size: UVec2::new(960, 720),
            step: 5,
            frames: 256,
            reference_samples: 1024,
            budgets: vec![10_000, 50_000, 250_000],
        }
    }
}

/// What lights a room.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lamp {
    /// A rectangle that shines down; it is not seen.
    Panel {
        corner: Vec3,
        size: Vec2,
        radiance: Vec3,
    },
    /// A direction with the irradiance of what faces it, and a sky.
    Sun {
        direction: Vec3,
        irradiance: Vec3,
        sky: Vec3,
    },
}

/// A scene with diffuse surfaces.
pub struct Room {
    name: String,
    wide: Bvh8,
    corners: Vec<[Vec3; 3]>,
    normals: Vec<Vec3>,
    albedos: Vec<Vec3>,
    lamp: Lamp,
    camera: SceneCamera,
    /// Area of what there is.
    area: f32,
    center: Vec3,
    /// How far ambient occlusion looks.
    reach: f32,
    fingerprint: Fingerprint,
}

const WHITE: Vec3 = vec3(0.75, 0.75, 0.75);
const RED: Vec3 = vec3(0.63, 0.065, 0.05);
const GREEN: Vec3 = vec3(0.14, 0.45, 0.091);

impl Room {
    /// An open box of 2 units with a red and a green wall and two blocks.
    ///
    /// # Errors
    /// None that this scene has.
    pub fn cornell() -> Result<Self, StageError> {
        let mut positions: Vec<Vec3> = Vec::new();
        let mut indices = Vec::new();
        let mut albedos = Vec::new();
        let mut quad = |corners: [Vec3; 4], albedo: Vec3| {
            let first = positions.len() as u32;
            positions.extend(corners);
            indices.push([first, first + 1, first + 2]);
            indices.push([first, first + 2, first + 3]);
            albedos.extend([albedo; 2]);
        };
        let corner = |x: f32, y: f32, z: f32| vec3(x, y, z);
        let wall = |o: Vec3, u: Vec3, v: Vec3| [o, o + u, o + u + v, o + v];
        let (x, y, z) = (2.0 * Vec3::X, 2.0 * Vec3::Y, 2.0 * Vec3::Z);
        quad(wall(corner(-1.0, 0.0, -1.0), x, z), WHITE);
        quad(wall(corner(-1.0, 2.0, -1.0), x, z), WHITE);
        quad(wall(corner(-1.0, 0.0, -1.0), x, y), WHITE);
        quad(wall(corner(-1.0, 0.0, -1.0), y, z), RED);
        quad(wall(corner(1.0, 0.0, -1.0), y, z), GREEN);
        let blocks = [
            (vec3(-0.35, 0.0, -0.35), vec3(0.3, 1.2, 0.3), 0.3_f32),
            (vec3(0.38, 0.0, 0.3), vec3(0.3, 0.6, 0.3), -0.3),
        ];
        for (foot, half, angle) in blocks {
            let (sin, cos) = angle.sin_cos();
            let u = vec3(cos, 0.0, sin) * half.x;
            let v = vec3(-sin, 0.0, cos) * half.z;
            let up = Vec3::Y * half.y;
            quad(wall(foot - u - v + up, 2.0 * u, 2.0 * v), WHITE);
            for (a, b) in [(u, v), (-u, -v), (v, -u), (-v, u)] {
                quad(wall(foot + a - b, 2.0 * b, up), WHITE);
            }
        }
        let lamp = Lamp::Panel {
            corner: vec3(-0.25, 1.98, -0.25),
            size: Vec2::splat(0.5),
            radiance: vec3(17.0, 13.5, 9.0),
        };
        let camera = SceneCamera {
            eye: vec3(0.0, 1.0, 3.9),
            target: vec3(0.0, 1.0, 0.0),
            up: Vec3::Y,
            fov_degrees: 39.0,
        };
        Self::new("Cornell", &positions, &indices, albedos, lamp, camera, 0.35)
    }

    /// The kitchen: its walls grey, sun and sky through the window.
    ///
    /// # Errors
    /// If it has no tree.
    pub fn kitchen(scene: &Scene) -> Result<Self, StageError> {
        let albedos = vec![Vec3::splat(0.6); scene.mesh.indices.len()];
        let lamp = Lamp::Sun {
            direction: scene.light.direction,
            irradiance: vec3(24.0, 21.0, 17.0),
            sky: vec3(1.5, 2.0, 3.0),
        };
        let (positions, indices) = (&scene.mesh.positions, &scene.mesh.indices);
        let reach = scene.ao_distance;
        Self::new(
            "kitchen",
            positions,
            indices,
            albedos,
            lamp,
            scene.camera,
            reach,
        )
    }

    fn new(
        name: &str,
        positions: &[Vec3],
        indices: &[[u32; 3]],
        albedos: Vec<Vec3>,
        lamp: Lamp,
        camera: SceneCamera,
        reach: f32,
    ) -> Result<Self, StageError> {
        let bvh = Bvh::build(positions, indices, BuildQuality::Medium)?;
        let corners = |t: &[u32; 3]| t.map(|i| positions[i as usize]);
        let cross = |t: &[u32; 3]| {
            let [a, b, c] = corners(t);
            (b - a).cross(c - a)
        };
        let normals = indices
            .iter()
            .map(|t| cross(t).normalize_or(Vec3::Y))
            .collect();
        let (low, high) = positions
            .iter()
            .fold((Vec3::MAX, Vec3::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
        let mut fingerprint = Fingerprint::new();
        for p in positions {
            fingerprint = fingerprint.floats(p.as_ref());
        }
        for (i, a) in indices.iter().zip(&albedos) {
            fingerprint = fingerprint.numbers(i).floats(a.as_ref());
        }
        Ok(Self {
            name: name.into(),
            wide: bvh.wide()?,
            corners: indices.iter().map(corners).collect(),
            normals,
            albedos,
            lamp,
            camera,
            area: indices.iter().map(|t| 0.5 * cross(t).length()).sum(),
            center: 0.5 * (low + high),
            reach,
            fingerprint,
        })
    }

    /// Surfels on both sides of each triangle, as many a side as a random
    /// scatter takes to cover by 1.2 on the mean, whether a pixel sees them or
    /// not.
    fn everywhere(&self, radius: f32) -> Vec<Surfel> {
        let mut out = Vec::new();
        let mut owed = 0.0;
        for (i, [a, b, c]) in self.corners.iter().enumerate() {
            let area = 0.5 * (*b - *a).cross(*c - *a).length();
            owed += 4.0 * area / (PI * radius * radius);
            while owed >= 1.0 {
                owed -= 1.0;
                let seed = pcg_hash(out.len() as u32);
                let (u, v) = (pcg_unit(seed), pcg_unit(pcg_hash(seed)));
                let (u, v) = if u + v > 1.0 {
                    (1.0 - u, 1.0 - v)
                } else {
                    (u, v)
                };
                for normal in [self.normals[i], -self.normals[i]] {
                    out.push(Surfel {
                        position: *a + (*b - *a) * u + (*c - *a) * v,
                        radius,
                        normal,
                        mesh: 0,
                    });
                }
            }
        }
        out
    }

    fn closest(&self, origin: Vec3, direction: Vec3) -> Option<SurfelHit> {
        let ray = Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max: f32::MAX,
        };
        let hit = self.wide.closest(&ray);
        if hit.primitive == BVH_MISS {
            // Far away, and black: what shines there is the sky.
            let Lamp::Sun { sky, .. } = self.lamp else {
                return None;
            };
            return Some(SurfelHit {
                position: origin + direction * 1e4,
                normal: -direction,
                albedo: Vec3::ZERO,
                emission: sky,
            });
        }
        let normal = self.normals[hit.primitive as usize];
        let normal = if normal.dot(direction) > 0.0 {
            -normal
        } else {
            normal
        };
        Some(SurfelHit {
            position: origin + direction * hit.t,
            normal,
            albedo: self.albedos[hit.primitive as usize],
            emission: Vec3::ZERO,
        })
    }

    fn blocked(&self, origin: Vec3, direction: Vec3, t_max: f32) -> bool {
        self.wide.any(&Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max,
        })
    }

    /// Irradiance straight from the lamp, by one shadow ray.
    fn direct(&self, position: Vec3, normal: Vec3, u: Vec2) -> Vec3 {
        let from = position + normal * self.offset();
        match self.lamp {
            Lamp::Panel {
                corner,
                size,
                radiance,
            } => {
                let lamp = corner + vec3(u.x * size.x, 0.0, u.y * size.y);
                let to = lamp - from;
                let square = to.length_squared();
                let direction = to / square.sqrt();
                let cosines = normal.dot(direction).max(0.0) * direction.y.max(0.0);
                if cosines <= 0.0 || self.blocked(from, direction, square.sqrt()) {
                    return Vec3::ZERO;
                }
                radiance * (cosines * size.x * size.y / square)
            }
            Lamp::Sun {
                direction,
                irradiance,
                ..
            } => {
                let cosine = normal.dot(direction);
                if cosine <= 0.0 || self.blocked(from, direction, f32::MAX) {
                    return Vec3::ZERO;
                }
                irradiance * cosine
            }
        }
    }

    fn offset(&self) -> f32 {
        1e-4 * self.reach
    }

    /// A path's light: the reference's sample of a pixel.
    fn path(&self, first: SurfelHit, seed: u32) -> Vec3 {
        let mut state = seed;
        let mut random = || {
            state = pcg_hash(state);
            pcg_unit(state)
        };
        let mut hit = first;
        let mut light = hit.emission;
        let mut through = Vec3::ONE;
        for bounce in 0..BOUNCES {
            if hit.albedo == Vec3::ZERO {
                break;
            }
            let lit = self.direct(hit.position, hit.normal, Vec2::new(random(), random()));
            through *= hit.albedo;
            light += through * lit / PI;
            if bounce >= 4 {
                let stay = through.max_element().min(0.95);
                if random() >= stay {
                    break;
                }
                through /= stay;
            }
            let local = hemisphere_cosine_sample(Vec2::new(random(), random()));
            let frame = basis_from_normal(hit.normal);
            let direction = basis_to_world(frame, hit.normal, local);
            let from = hit.position + hit.normal * self.offset();
            let Some(next) = self.closest(from, direction) else {
                break;
            };
            hit = next;
            light += through * hit.emission;
        }
        light
    }

    /// Every `step`-th pixel, converged; kept between runs.
    fn reference(&self, view: &View, settings: &SurfelReportSettings) -> Vec<Vec3> {
        let samples = settings.reference_samples;
        let picture = |samples: u32| -> Vec<Vec3> {
            let shown: Vec<_> = view.shown.clone();
            shown
                .into_par_iter()
                .map(|i| match view.hits[i] {
                    Some(hit) => {
                        let seed = |s| pcg_hash(pcg_hash(i as u32) ^ pcg_hash(s ^ 0x5eed));
                        let sum: Vec3 = (0..samples).map(|s| self.path(hit, seed(s))).sum();
                        sum / samples as f32
                    }
                    None => Vec3::ZERO,
                })
                .collect()
        };
        let lamp = match self.lamp {
            Lamp::Panel {
                corner,
                size,
                radiance,
            } => [
                corner.to_array(),
                [size.x, size.y, 0.0],
                radiance.to_array(),
            ],
            Lamp::Sun {
                direction,
                irradiance,
                sky,
            } => [direction.to_array(), irradiance.to_array(), sky.to_array()],
        };
        // The program itself counts through a few samples of a pixel.
        let probe = view
            .shown
            .get(view.shown.len() / 2)
            .and_then(|i| view.hits[*i]);
        let probe = probe.map_or(Vec3::ZERO, |hit| {
            (0..16).map(|s| self.path(hit, pcg_hash(s))).sum()
        });
        let key = self
            .fingerprint
            .numbers(&[settings.size.x, settings.size.y, settings.step, samples])
            .floats(lamp.as_flattened())
            .floats(view.camera.origin.as_ref())
            .floats(view.camera.forward.as_ref())
            .floats(probe.as_ref());
        let folder = cache::folder();
        let count = 3 * view.shown.len();
        let kept = cache::load(&folder, key, count);
        let numbers = kept.unwrap_or_else(|| {
            let numbers: Vec<f32> = picture(samples).iter().flat_map(|v| v.to_array()).collect();
            if let Err(error) = cache::store(&folder, key, &numbers) {
                eprintln!(
                    "warning: the reference is not kept: {}: {error}",
                    folder.display()
                );
            }
            numbers
        });
        numbers.chunks_exact(3).map(Vec3::from_slice).collect()
    }

    fn view(&self, camera: SceneCamera, settings: &SurfelReportSettings) -> View {
        let size = settings.size;
        let forward = (camera.target - camera.eye).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let half = (0.5 * camera.fov_degrees.to_radians()).tan();
        let camera = Camera {
            origin: camera.eye,
            right: right * (half * size.x as f32 / size.y as f32),
            up: up * half,
            forward,
            inverse_resolution: Vec2::ONE / size.as_vec2(),
        };
        let hits: Vec<Option<SurfelHit>> = (0..size.x * size.y)
            .into_par_iter()
            .map(|i| {
                let at = Vec2::new((i % size.x) as f32 + 0.5, (i / size.x) as f32 + 0.5);
                let ray = camera_ray(at, camera);
                self.closest(ray.origin, ray.direction)
            })
            .collect();
        let pixels = hits.iter().map(|hit| match hit {
            Some(hit) if hit.albedo != Vec3::ZERO => SurfelPixel {
                position: hit.position,
                normal: hit.normal,
                mesh: 0,
            },
            _ => SurfelPixel {
                position: Vec3::ZERO,
                normal: Vec3::ZERO,
                mesh: 0,
            },
        });
        let pixels = pixels.collect();
        let (w, step) = (size.x as usize, settings.step as usize);
        let rows = (step / 2..size.y as usize).step_by(step);
        let shown = rows.flat_map(|y| (step / 2..w).step_by(step).map(move |x| y * w + x));
        View {
            camera,
            pixels,
            shown: shown.collect(),
            hits,
            width: size.x,
        }
    }

    /// What the lamp alone gives the shown pixels, as irradiance.
    fn lit(&self, view: &View) -> Vec<Vec3> {
        view.shown
            .par_iter()
            .map(|&i| {
                let Some(hit) = view.hits[i] else {
                    return Vec3::ZERO;
                };
                let side = SHADOW_RAYS.isqrt();
                let ray = |s: u32| {
                    let jitter = |k| pcg_unit(pcg_hash(pcg_hash(i as u32 ^ k) ^ s));
                    let cell = Vec2::new((s % side) as f32, (s / side) as f32);
                    (cell + Vec2::new(jitter(1), jitter(2))) / side as f32
                };
                let sum: Vec3 = (0..side * side)
                    .map(|s| self.direct(hit.position, hit.normal, ray(s)))
                    .sum();
                sum / (side * side) as f32
            })
            .collect()
    }

    /// How much of the nearby hemisphere is open at the shown pixels.
    fn open(&self, view: &View) -> Vec<f32> {
        view.shown
            .par_iter()
            .map(|&i| {
                let Some(hit) = view.hits[i] else {
                    return 1.0;
                };
                let frame = basis_from_normal(hit.normal);
                let from = hit.position + hit.normal * self.offset();
                let free = (0..OCCLUSION_RAYS).filter(|s| {
                    let u = |k| pcg_unit(pcg_hash(pcg_hash(i as u32 ^ k) ^ s));
                    let local = hemisphere_cosine_sample(Vec2::new(u(3), u(4)));
                    let direction = basis_to_world(frame, hit.normal, local);
                    !self.blocked(from, direction, self.reach)
                });
                free.count() as f32 / OCCLUSION_RAYS as f32
            })
            .collect()
    }
}

/// What a camera sees.
struct View {
    camera: Camera,
    pixels: Vec<SurfelPixel>,
    hits: Vec<Option<SurfelHit>>,
    /// The pixels that pictures have.
    shown: Vec<usize>,
    width: u32,
}

impl View {
    fn surfel_view(&self) -> SurfelView<'_> {
        SurfelView {
            pixels: &self.pixels,
            width: self.width,
            camera: self.camera,
        }
    }

    /// The picture, from the lamp's irradiance and what the surfels add.
    fn picture(
        &self,
        lit: &[Vec3],
        bounced: impl Fn(usize, &SurfelHit) -> Vec3 + Sync,
    ) -> Vec<Vec3> {
        let shown = self.shown.par_iter().enumerate();
        shown
            .map(|(k, &i)| match &self.hits[i] {
                Some(hit) => {
                    surfel_irradiance_outgoing(hit.albedo, hit.emission, lit[k], bounced(k, hit))
                }
                None => Vec3::ZERO,
            })
            .collect()
    }
}

/// The error at a frame after something happened.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfelError {
    /// `Cornell` or `kitchen`.
    pub scene: String,
    /// Slots of the pool.
    pub budget: u32,
    /// `after a cut`, [`EVERYWHERE`], `after the lamp changed`, `after the lamp
    /// went out`, `while the camera flies`.
    pub event: &'static str,
    /// Frames since, from 1.
    pub frame: u32,
    /// Surfels in the pool.
    pub alive: u32,
    /// Root mean squared error of the picture, and without surfels.
    pub rmse: f64,
    /// The same without any light that bounces.
    pub direct_rmse: f64,
    /// Mean FLIP.
    pub flip: f64,
    /// Part of the shown surfaces that no surfel covers.
    pub bare: f64,
    /// Mean of the picture over that of the reference; of the light that is
    /// left over that before, where the reference is black.
    pub mean: f64,
    /// Milliseconds of the frame: all steps of the pass, its rays too.
    pub ms: f64,
}

/// A picture of the section.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfelPicture {
    /// `Cornell` or `kitchen`.
    pub scene: String,
    /// In the file's name.
    pub name: String,
    /// What one sees.
    pub caption: String,
    /// Width and height.
    pub size: UVec2,
    /// Linear colours.
    pub pixels: Vec<Vec3>,
}

impl SurfelPicture {
    /// As PNG, each pixel three wide.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn png(&self) -> Result<Vec<u8>, StageError> {
        const TIMES: u32 = 3;
        let colour = |x: u32, y: u32| {
            let pixel = self.pixels[(y / TIMES * self.size.x + x / TIMES) as usize];
            image::Rgb(pixel.to_array().map(srgb8))
        };
        let picture = image::RgbImage::from_fn(TIMES * self.size.x, TIMES * self.size.y, colour);
        let mut out = std::io::Cursor::new(Vec::new());
        picture
            .write_to(&mut out, image::ImageFormat::Png)
            .map_err(|e| StageError::Png(e.to_string()))?;
        Ok(out.into_inner())
    }
}

/// All of a scene.
pub struct SurfelResults {
    /// The errors, in the order of events and frames.
    pub errors: Vec<SurfelError>,
    /// The pictures.
    pub pictures: Vec<SurfelPicture>,
}

/// A run with one budget.
struct Run<'a> {
    settings: &'a SurfelReportSettings,
    room: Room,
    pass: SurfelPass,
    budget: u32,
    frame: u32,
    ms: f64,
}

impl Run<'_> {
    fn step(&mut self, view: &View) {
        let (room, frame) = (&self.room, self.frame);
        let start = Instant::now();
        self.pass.frame(
            view.surfel_view(),
            |origin, direction| room.closest(origin, direction),
            |hit| {
                let bits = hit.position.to_array().map(f32::to_bits);
                let seed = bits.iter().fold(pcg_hash(frame), |s, b| pcg_hash(s ^ b));
                let u = Vec2::new(pcg_unit(seed), pcg_unit(pcg_hash(seed)));
                room.direct(hit.position, hit.normal, u)
            },
        );
        self.ms = start.elapsed().as_secs_f64() * 1e3;
        self.frame += 1;
    }

    fn picture(&self, view: &View, lit: &[Vec3]) -> Vec<Vec3> {
        view.picture(lit, |_, hit| {
            self.pass.gather(hit.position, hit.normal).irradiance
        })
    }

    fn error(
        &self,
        event: &'static str,
        frame: u32,
        view: &View,
        lit: &[Vec3],
        reference: &[Vec3],
    ) -> SurfelError {
        let image = self.picture(view, lit);
        let chosen: Vec<bool> = view.shown.iter().map(|i| view.hits[*i].is_some()).collect();
        let direct = view.picture(lit, |_, _| Vec3::ZERO);
        let rmse = |image: &[Vec3]| errors(image, reference, &chosen).0.sqrt();
        let total = |v: &[Vec3]| f64::from(v.iter().copied().sum::<Vec3>().element_sum());
        let hits = view.shown.iter().filter_map(|i| view.hits[*i].as_ref());
        let surfaces: Vec<&SurfelHit> = hits.filter(|h| h.albedo != Vec3::ZERO).collect();
        let bare = surfaces
            .iter()
            .filter(|h| self.pass.gather(h.position, h.normal).weight == 0.0);
        SurfelError {
            scene: self.room.name.clone(),
            budget: self.budget,
            event,
            frame,
            alive: self.pass.statistics().alive,
            rmse: rmse(&image),
            direct_rmse: rmse(&direct),
            flip: flip(shown_size(self.settings), &image, reference).0,
            bare: bare.count() as f64 / surfaces.len().max(1) as f64,
            mean: total(&image) / total(reference).max(1e-9),
            ms: self.ms,
        }
    }
}

fn shown_size(settings: &SurfelReportSettings) -> UVec2 {
    let across = |n: u32| (n - settings.step / 2).div_ceil(settings.step);
    UVec2::new(across(settings.size.x), across(settings.size.y))
}

/// A colour of its own for each surfel, by how much they cover.
fn surfel_colours(view: &View, surfels: &[Surfel], pass: &SurfelPass) -> Vec<Vec3> {
    use raytwin_cpu::gi::surfel::{SURFEL_WALK, surfel_weight};
    view.shown
        .par_iter()
        .map(|&i| {
            let Some(hit) = view.hits[i] else {
                return Vec3::ZERO;
            };
            let grid = pass.grid();
            let list = grid.list(hit.position);
            let (mut most, mut colour) = (0.0, Vec3::splat(0.02));
            for entry in 0..list.y.min(SURFEL_WALK) {
                let slot = grid.entry(list.x + entry);
                let weight = surfel_weight(surfels[slot as usize], hit.position, hit.normal);
                if weight > most {
                    most = weight;
                    let part = |k| 0.1 + 0.8 * pcg_unit(pcg_hash(pcg_hash(slot) ^ k));
                    // Darker toward the rim.
                    colour = vec3(part(1), part(2), part(3)) * (0.35 + 0.65 * weight);
                }
            }
            colour
        })
        .collect()
}

/// Errors and pictures of a room. `make` gives it afresh: its lamp changes.
///
/// # Errors
/// Those of `make`.
pub fn measure(
    make: impl Fn() -> Result<Room, StageError>,
    settings: &SurfelReportSettings,
    mut progress: impl FnMut(&str),
) -> Result<SurfelResults, StageError> {
    let mut out = SurfelResults {
        errors: Vec::new(),
        pictures: Vec::new(),
    };
    let room = make()?;
    let still = room.view(room.camera, settings);
    progress("reference");
    let before = room.reference(&still, settings);
    let lit = room.lit(&still);
    let mut changed = make()?;
    changed.lamp = moved(room.lamp);
    progress("reference, the lamp changed");
    let after = changed.reference(&still, settings);
    let lit_after = changed.lit(&still);
    let flown = flight(&room, settings);
    let mut references = HashMap::new();
    for (frame, at) in &flown {
        if landmarks(settings).contains(frame) {
            progress(&format!("reference, camera at {frame}"));
            let view = room.view(*at, settings);
            references.insert(*frame, (room.reference(&view, settings), room.lit(&view)));
        }
    }
    let size = shown_size(settings);
    let mut show = |name: &str, caption: String, pixels: Vec<Vec3>| {
        out.pictures.push(SurfelPicture {
            scene: room.name.clone(),
            name: name.into(),
            caption,
            size,
            pixels,
        });
    };
    let direct = still.picture(&lit, |_, _| Vec3::ZERO);
    show("direct", "light straight from the lamp".into(), direct);
    let samples = settings.reference_samples;
    show(
        "reference",
        format!("path traced, {samples} samples a pixel"),
        before.clone(),
    );
    let open = room.open(&still);
    for (b, &budget) in settings.budgets.iter().enumerate() {
        progress(&format!("{budget} surfels"));
        let radius = (ROOM_FOR * room.area / (PI * budget as f32))
            .sqrt()
            .max(1e-3);
        let pool = SurfelSettings {
            radius,
            rate: 1.0,
            ..SurfelSettings::default()
        };
        let grid = SurfelGrid {
            origin: room.center,
            inverse_cell: 0.5 / radius,
            size: UVec3::ZERO,
            slots: budget.max(64),
            inverse_reach: 0.0,
        };
        let mut run = Run {
            settings,
            room: make()?,
            pass: SurfelPass::new(pool, grid, budget, budget.saturating_mul(24)),
            budget,
            frame: 0,
            ms: 0.0,
        };
        for frame in 1..=settings.frames {
            run.step(&still);
            if FRAMES.contains(&frame) {
                let error = run.error("after a cut", frame, &still, &lit, &before);
                let caption = format!("{budget} surfels, frame {frame}: RMSE {:.3}", error.rmse);
                out.errors.push(error);
                if b == 0 && frame.ilog2().is_multiple_of(2) {
                    let picture = run.picture(&still, &lit);
                    show(&format!("frame {frame}"), caption, picture);
                }
            }
        }
        // How much of what is missing is on surfaces that no pixel sees?
        if b == 0 {
            let surfels = room.everywhere(radius);
            let capacity = (surfels.len() as u32).saturating_mul(2);
            let mut all = Run {
                settings,
                room: make()?,
                pass: SurfelPass::new(pool, grid, capacity, capacity.saturating_mul(24)),
                budget,
                frame: 0,
                ms: 0.0,
            };
            for surfel in surfels {
                all.pass.insert(surfel);
            }
            for frame in 1..=settings.frames {
                all.step(&still);
                if FRAMES.contains(&frame) {
                    out.errors
                        .push(all.error(EVERYWHERE, frame, &still, &lit, &before));
                }
            }
        }
        let colours = surfel_colours(&still, run.pass.surfels(), &run.pass);
        let alive = run.pass.statistics().alive;
        show(
            &format!("surfels {budget}"),
            format!("{alive} surfels, each in a colour of its own"),
            colours,
        );
        let picture = run.picture(&still, &lit);
        show(
            &format!("gi {budget}"),
            format!("{alive} surfels after {} frames", settings.frames),
            picture,
        );
        let occluded = still.picture(&lit, |k, hit| {
            let seen = run.pass.gather(hit.position, hit.normal).irradiance;
            seen * surfel_colored_occlusion(open[k], hit.albedo)
        });
        show(
            &format!("gi ao {budget}"),
            format!("{alive} surfels, with ambient occlusion"),
            occluded,
        );
        // The camera flies from where it stood: after the lamp went out the light
        // would still be on its way back, which is no fault of the flight.
        for (frame, at) in &flown {
            let view = room.view(*at, settings);
            run.step(&view);
            if let Some((reference, lit)) = references.get(frame) {
                let event = "while the camera flies";
                out.errors
                    .push(run.error(event, *frame, &view, lit, reference));
            }
        }
        for _ in 0..settings.frames / 2 {
            run.step(&still);
        }
        run.room.lamp = changed.lamp;
        for frame in 1..=settings.frames / 2 {
            run.step(&still);
            if FRAMES.contains(&frame) {
                out.errors.push(run.error(
                    "after the lamp changed",
                    frame,
                    &still,
                    &lit_after,
                    &after,
                ));
            }
        }
        out.errors.extend(dark(&mut run, changed.lamp));
    }
    Ok(out)
}

/// What is left of the light that bounces, after the lamp went out.
fn dark(run: &mut Run<'_>, lamp: Lamp) -> Vec<SurfelError> {
    run.room.lamp = match lamp {
        Lamp::Panel { corner, size, .. } => Lamp::Panel {
            corner,
            size,
            radiance: Vec3::ZERO,
        },
        Lamp::Sun { direction, .. } => Lamp::Sun {
            direction,
            irradiance: Vec3::ZERO,
            sky: Vec3::ZERO,
        },
    };
    // Seen anew: the sky behind a window is as dark as the lamp.
    let view = &run.room.view(run.room.camera, run.settings);
    let black = vec![Vec3::ZERO; view.shown.len()];
    let total = |run: &Run<'_>| -> f64 {
        let picture = run.picture(view, &black);
        f64::from(picture.into_iter().sum::<Vec3>().element_sum())
    };
    let before = total(run).max(1e-9);
    let mut out = Vec::new();
    for frame in 1..=run.settings.frames {
        run.step(view);
        if FRAMES.contains(&frame) {
            let error = run.error("after the lamp went out", frame, view, &black, &black);
            out.push(SurfelError {
                mean: total(run) / before,
                ..error
            });
        }
    }
    out
}

/// The lamp elsewhere, in another colour.
fn moved(lamp: Lamp) -> Lamp {
    match lamp {
        Lamp::Panel { size, radiance, .. } => Lamp::Panel {
            corner: vec3(0.35, 1.98, -0.6),
            size,
            radiance: vec3(radiance.z, radiance.y, radiance.x) * 0.6,
        },
        Lamp::Sun {
            direction,
            irradiance,
            sky,
        } => Lamp::Sun {
            direction,
            irradiance: irradiance * 0.3,
            sky: sky * 0.6,
        },
    }
}

/// Frames of the flight at which it is compared, from 1.
fn landmarks(settings: &SurfelReportSettings) -> [u32; 3] {
    let frames = settings.frames / 2;
    [frames / 4, frames / 2, frames]
}

/// The camera moves sideways and forward and turns.
fn flight(room: &Room, settings: &SurfelReportSettings) -> Vec<(u32, SceneCamera)> {
    let frames = settings.frames / 2;
    let camera = room.camera;
    let view = camera.target - camera.eye;
    let right = view.cross(camera.up).normalize();
    (1..=frames)
        .map(|frame| {
            let t = frame as f32 / frames as f32;
            let mut at = camera;
            at.eye += right * (0.25 * t * view.length()) + view * (0.2 * t);
            at.target -= right * (0.1 * t * view.length());
            (frame, at)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light that bounces is most of the error, and surfels take most of it away;
    /// without a lamp their light dies.
    #[test]
    fn surfels_come_close_to_the_reference() {
        let settings = SurfelReportSettings {
            size: UVec2::new(192, 144),
            step: 6,
            frames: 64,
            reference_samples: 128,
            budgets: vec![1_500],
        };
        let results = measure(Room::cornell, &settings, |_| {}).expect("a closed scene");
        let at = |event: &str| -> Vec<&SurfelError> {
            results.errors.iter().filter(|e| e.event == event).collect()
        };
        // Surfaces that no pixel saw have no surfels: their light is missing.
        for (event, share, least) in [
            ("after a cut", 0.4, 0.85),
            ("while the camera flies", 0.4, 0.85),
        ] {
            let all = at(event);
            let last = all.last().expect("frames");
            println!("{event}: {last:?}");
            assert!(last.rmse < share * last.direct_rmse, "{event}: {last:?}");
            assert!((least..1.05).contains(&last.mean), "{event}: {last:?}");
        }
        // The old light stays for a while.
        let changed = at("after the lamp changed");
        println!("after the lamp changed: {changed:?}");
        assert!(changed.windows(2).all(|w| w[1].rmse < w[0].rmse));
        let first = &at("after a cut")[0];
        assert!(first.rmse > 2.0 * at("after a cut").last().expect("frames").rmse);
        let dark = at("after the lamp went out");
        assert!(dark.windows(2).all(|w| w[1].mean < w[0].mean));
        assert!(dark.last().expect("frames").mean < 0.5);
        let size = shown_size(&settings);
        let whole = |p: &SurfelPicture| p.pixels.len() == (size.x * size.y) as usize;
        assert!(results.pictures.iter().all(whole));
    }
}
