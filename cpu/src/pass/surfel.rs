//! [`gi::surfel`](crate::gi::surfel) over frames: a pool of surfels that follows
//! what the camera sees and keeps its light.
//!
//! A frame is five steps: surfels that nobody needs go, the lists are built, each
//! tile of 16 × 16 pixels finds the pixel that is covered least, some of these
//! spawn, and every surfel's irradiance moves on by a few rays. Nothing depends
//! on the order of threads: free slots are taken in ascending order by tiles in
//! reading order, and a frame's rays see the irradiance of the frame before.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::{UVec2, Vec3};

use super::surfel_grid::SurfelGridPass;
use super::svgf::for_rows;
use crate::gi::surfel::{
    SURFEL_TILE_EMPTY, SURFEL_WALK, Surfel, SurfelGathered, surfel_gather, surfel_pixel_area,
    surfel_sound, surfel_spawn_chance, surfel_spawns, surfel_tile_coverage, surfel_tile_index,
    surfel_tile_key, surfel_weight,
};
use crate::gi::surfel_grid::SurfelGrid;
use crate::gi::surfel_irradiance::{
    SurfelIrradiancePose, surfel_irradiance_allowed, surfel_irradiance_direction,
    surfel_irradiance_follow, surfel_irradiance_origin, surfel_irradiance_outgoing,
    surfel_irradiance_patience, surfel_irradiance_rays, surfel_irradiance_recycle,
    surfel_irradiance_sample,
};
use crate::math::vector::vec3_dot;
use crate::ray::camera::Camera;
use crate::temporal::multiscale_mean::{
    MULTISCALE_MEAN_LONGEST, MULTISCALE_MEAN_ROBUST_RGB_EMPTY, MULTISCALE_MEAN_SHORT_BLEND,
    MultiscaleMeanRobustRgbState, multiscale_mean_robust_rgb_step,
    multiscale_mean_robust_rgb_value,
};

/// Width and height of a tile in pixels.
const TILE: usize = 16;
/// Surfels that one task takes.
const BATCH: usize = 256;
/// A slot without a surfel: no radius, which covers nothing.
const FREE: Surfel = Surfel {
    position: Vec3::ZERO,
    radius: 0.0,
    normal: Vec3::Z,
    mesh: 0,
};

/// What a pixel sees. Without a surface its normal is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelPixel {
    /// Where, in the world.
    pub position: Vec3,
    /// Unit normal, towards the camera.
    pub normal: Vec3,
    /// Which object it is.
    pub mesh: u32,
}

/// What the camera sees: row after row from the upper left.
#[derive(Clone, Copy, Debug)]
pub struct SurfelView<'a> {
    /// The pixels; an incomplete last row is left out.
    pub pixels: &'a [SurfelPixel],
    /// Pixels in a row.
    pub width: u32,
    /// Where they are seen from.
    pub camera: Camera,
}

/// What a ray hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelHit {
    /// Where, in the world.
    pub position: Vec3,
    /// Unit normal, towards the ray's origin.
    pub normal: Vec3,
    /// What part of the light it sends back, for each channel.
    pub albedo: Vec3,
    /// Radiance of its own.
    pub emission: Vec3,
}

/// How a pool behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfelSettings {
    /// Coverage up to which surfels are spawned; 0.8 in the chapter.
    pub target_coverage: f32,
    /// How much of what is missing is spawned in a frame: a rate a second times
    /// the frame's duration.
    pub rate: f32,
    /// Least radius.
    pub radius: f32,
    /// Radius over depth, where that is larger.
    pub radius_per_depth: f32,
    /// Rays of a surfel in its first frame.
    pub rays: u32,
    /// Rays of all surfels in a frame.
    pub budget: u32,
    /// Frames that a surfel may go unseen while there is room.
    pub patience: u32,
    /// Memory of the estimator in frames, at most.
    pub longest: f32,
}

impl Default for SurfelSettings {
    fn default() -> Self {
        Self {
            target_coverage: 0.8,
            rate: 0.25,
            radius: 0.1,
            radius_per_depth: 0.0,
            rays: 16,
            budget: 250_000,
            patience: 600,
            longest: MULTISCALE_MEAN_LONGEST,
        }
    }
}

/// What happened in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfelStatistics {
    /// Surfels in the pool at the end.
    pub alive: u32,
    /// Surfels that are new.
    pub spawned: u32,
    /// Surfels that the pool had no room for.
    pub dropped: u32,
    /// Surfels that were given up.
    pub recycled: u32,
    /// Surfels that are too large for the grid's cells.
    pub homeless: u32,
    /// Entries of lists that had no room.
    pub entries_dropped: u32,
    /// Rays traced.
    pub rays: u32,
}

/// A surfel's light.
#[derive(Clone, Copy, Debug)]
struct Light {
    state: MultiscaleMeanRobustRgbState,
    /// Rays in this frame.
    rays: u32,
    /// Frames with rays.
    age: u32,
}

const DARK: Light = Light {
    state: MULTISCALE_MEAN_ROBUST_RGB_EMPTY,
    rays: 0,
    age: 0,
};

/// A pool of surfels.
#[derive(Debug)]
pub struct SurfelPass {
    settings: SurfelSettings,
    surfels: Vec<Surfel>,
    /// Frames since a pixel last saw it; threads set it to 0.
    unseen: Vec<AtomicU32>,
    lights: Vec<Light>,
    /// By slot, of the frame before.
    irradiance: Vec<Vec3>,
    grid: SurfelGridPass,
    /// Free slots, the lowest one last.
    free: Vec<u32>,
    keys: Vec<u32>,
    frame: u32,
    statistics: SurfelStatistics,
}

impl SurfelPass {
    /// A pool of `capacity` slots whose lists hold `entries` in all; a surfel
    /// takes about eight.
    #[must_use]
    pub fn new(settings: SurfelSettings, grid: SurfelGrid, capacity: u32, entries: u32) -> Self {
        let slots = capacity as usize;
        Self {
            settings,
            surfels: vec![FREE; slots],
            unseen: std::iter::repeat_with(AtomicU32::default)
                .take(slots)
                .collect(),
            lights: vec![DARK; slots],
            irradiance: vec![Vec3::ZERO; slots],
            grid: SurfelGridPass::new(grid, entries),
            free: (0..capacity).rev().collect(),
            keys: Vec::new(),
            frame: 0,
            statistics: SurfelStatistics::default(),
        }
    }

    /// All of a frame: [`Self::recycle`], [`Self::build`], [`Self::cover`],
    /// [`Self::spawn`], [`Self::update`]. Before it, [`Self::follow`] what moved.
    pub fn frame(
        &mut self,
        view: SurfelView<'_>,
        trace: impl Fn(Vec3, Vec3) -> Option<SurfelHit> + Sync + Send,
        direct: impl Fn(&SurfelHit) -> Vec3 + Sync + Send,
    ) -> SurfelStatistics {
        self.recycle();
        self.build();
        self.cover(view);
        self.spawn(view);
        self.update(trace, direct);
        self.statistics
    }

    /// Moves the surfels of an object with it.
    pub fn follow(&mut self, mesh: u32, old: SurfelIrradiancePose, new: SurfelIrradiancePose) {
        for surfel in &mut self.surfels {
            if surfel.mesh == mesh && surfel_sound(*surfel) == 1 {
                *surfel = surfel_irradiance_follow(*surfel, old, new);
            }
        }
    }

    /// Starts a frame: gives up who went unseen for too long, or is broken.
    pub fn recycle(&mut self) {
        let capacity = self.surfels.len() as u32;
        let used = capacity - self.free.len() as u32;
        let patience = surfel_irradiance_patience(used, capacity, self.settings.patience);
        self.free.clear();
        let mut recycled = 0;
        for slot in (0..self.surfels.len()).rev() {
            let unseen = self.unseen[slot].get_mut();
            if taken(self.surfels[slot])
                && surfel_irradiance_recycle(self.surfels[slot], *unseen, patience) == 1
            {
                recycled += 1;
                self.surfels[slot] = FREE;
            }
            *unseen = unseen.saturating_add(1);
            if !taken(self.surfels[slot]) {
                self.free.push(slot as u32);
            }
        }
        self.statistics = SurfelStatistics {
            recycled,
            alive: capacity - self.free.len() as u32,
            ..SurfelStatistics::default()
        };
    }

    /// Builds the lists.
    pub fn build(&mut self) {
        self.grid.build(&self.surfels);
        self.statistics.homeless = self.grid.homeless() - self.free.len() as u32;
        self.statistics.entries_dropped = self.grid.dropped();
    }

    /// Finds the least covered pixel of each tile, and who is seen.
    pub fn cover(&mut self, view: SurfelView<'_>) {
        let width = view.width as usize;
        let height = view.pixels.len().checked_div(width).unwrap_or(0);
        let across = width.div_ceil(TILE);
        self.keys.clear();
        self.keys
            .resize(across * height.div_ceil(TILE), SURFEL_TILE_EMPTY);
        if self.keys.is_empty() {
            return;
        }
        let (surfels, unseen, grid) = (&self.surfels, &self.unseen, &self.grid);
        for_rows(&mut self.keys, across, |row, keys| {
            for y in row * TILE..((row + 1) * TILE).min(height) {
                for x in 0..width {
                    let pixel = view.pixels[y * width + x];
                    if !has_surface(pixel) {
                        continue;
                    }
                    let coverage = cover_pixel(pixel, surfels, grid, unseen);
                    let index = (y % TILE * TILE + x % TILE) as u32;
                    let key = &mut keys[x / TILE];
                    *key = (*key).min(surfel_tile_key(coverage, index));
                }
            }
        });
    }

    /// Spawns surfels where [`Self::cover`], with the same view, found them
    /// missing.
    pub fn spawn(&mut self, view: SurfelView<'_>) {
        let across = (view.width as usize).div_ceil(TILE);
        if across == 0 {
            return;
        }
        for tile in 0..self.keys.len() {
            let Some(surfel) = self.candidate(view, tile, across) else {
                continue;
            };
            if self.insert(surfel).is_some() {
                self.statistics.spawned += 1;
            } else {
                self.statistics.dropped += 1;
            }
        }
    }

    /// The surfel that a tile spawns in this frame.
    fn candidate(&self, view: SurfelView<'_>, tile: usize, across: usize) -> Option<Surfel> {
        let key = self.keys[tile];
        if key == SURFEL_TILE_EMPTY {
            return None;
        }
        let width = view.width as usize;
        let height = view.pixels.len() / width;
        let (left, top) = (tile % across * TILE, tile / across * TILE);
        let index = surfel_tile_index(key) as usize;
        let (x, y) = (left + index % TILE, top + index / TILE);
        // Another view than that of the keys.
        if x >= width || y >= height {
            return None;
        }
        let pixel = view.pixels[y * width + x];
        let eye = Vec3::new(
            view.camera.origin.x - pixel.position.x,
            view.camera.origin.y - pixel.position.y,
            view.camera.origin.z - pixel.position.z,
        );
        let depth = -vec3_dot(eye, view.camera.forward);
        if depth <= 0.0 {
            return None;
        }
        let settings = self.settings;
        let area = surfel_pixel_area(depth, vec3_dot(eye, pixel.normal) / depth, view.camera);
        let radius = settings.radius.max(depth * settings.radius_per_depth);
        let pixels = (width - left).min(TILE) * (height - top).min(TILE);
        let chance = surfel_spawn_chance(
            surfel_tile_coverage(key),
            settings.target_coverage,
            area,
            pixels as f32,
            radius,
            settings.rate,
        );
        let at = UVec2::new(x as u32, y as u32);
        if surfel_spawns(at, self.frame, chance) == 0 {
            return None;
        }
        Some(Surfel {
            position: pixel.position,
            radius,
            normal: pixel.normal,
            mesh: pixel.mesh,
        })
    }

    /// Puts a surfel into the lowest free slot and gives its number; `None` if
    /// the pool is full or the surfel is not sound.
    pub fn insert(&mut self, surfel: Surfel) -> Option<u32> {
        if surfel_sound(surfel) == 0 {
            return None;
        }
        let slot = self.free.pop()?;
        let at = slot as usize;
        self.surfels[at] = surfel;
        *self.unseen[at].get_mut() = 0;
        self.lights[at] = DARK;
        self.irradiance[at] = Vec3::ZERO;
        self.statistics.alive += 1;
        Some(slot)
    }

    /// Ends a frame: traces rays and moves every surfel's irradiance on.
    ///
    /// `trace` gives the first hit of a ray from a point in a unit direction;
    /// `direct` the irradiance that a hit has from lights, the cosine included.
    /// With the feature `rayon` both are called from several threads.
    pub fn update(
        &mut self,
        trace: impl Fn(Vec3, Vec3) -> Option<SurfelHit> + Sync + Send,
        direct: impl Fn(&SurfelHit) -> Vec3 + Sync + Send,
    ) {
        self.statistics.rays = self.allow_rays();
        let (surfels, irradiance, grid) = (&self.surfels, &self.irradiance, &self.grid);
        let (frame, longest) = (self.frame, self.settings.longest);
        if !self.lights.is_empty() {
            for_rows(&mut self.lights, BATCH, |batch, lights| {
                for (at, light) in lights.iter_mut().enumerate() {
                    if light.rays == 0 {
                        continue;
                    }
                    let slot = batch * BATCH + at;
                    let surfel = surfels[slot];
                    let origin = surfel_irradiance_origin(surfel);
                    let mut sum = Vec3::ZERO;
                    for ray in 0..light.rays {
                        let direction =
                            surfel_irradiance_direction(surfel.normal, slot as u32, frame, ray);
                        if let Some(hit) = trace(origin, direction) {
                            let found = gather(hit.position, hit.normal, surfels, irradiance, grid);
                            sum += surfel_irradiance_outgoing(
                                hit.albedo,
                                hit.emission,
                                direct(&hit),
                                found.irradiance,
                            );
                        }
                    }
                    light.state = multiscale_mean_robust_rgb_step(
                        light.state,
                        surfel_irradiance_sample(sum, light.rays),
                        MULTISCALE_MEAN_SHORT_BLEND,
                        longest,
                    );
                    light.age = light.age.saturating_add(1);
                }
            });
        }
        for (irradiance, light) in self.irradiance.iter_mut().zip(&self.lights) {
            if light.rays > 0 {
                *irradiance = multiscale_mean_robust_rgb_value(light.state);
            }
        }
        self.frame = self.frame.wrapping_add(1);
    }

    /// Shares the budget out: first come, first served, and who comes first
    /// rotates with the frame.
    fn allow_rays(&mut self) -> u32 {
        let SurfelSettings { rays, budget, .. } = self.settings;
        let slots = self.surfels.len() as u64;
        if slots == 0 {
            return 0;
        }
        let start = (u64::from(self.frame) * u64::from(budget) % slots) as usize;
        let mut before = 0u32;
        let mut total = 0;
        for slot in (start..self.surfels.len()).chain(0..start) {
            let light = &mut self.lights[slot];
            light.rays = 0;
            if surfel_sound(self.surfels[slot]) == 1 {
                let wanted = surfel_irradiance_rays(light.age, rays);
                light.rays = surfel_irradiance_allowed(before, wanted, budget);
                before = before.saturating_add(wanted);
                total += light.rays;
            }
        }
        total
    }

    /// Irradiance at a point, of the lists that were built last.
    #[must_use]
    pub fn gather(&self, point: Vec3, normal: Vec3) -> SurfelGathered {
        gather(point, normal, &self.surfels, &self.irradiance, &self.grid)
    }

    /// The surfels by slot; a free slot's has no radius.
    #[must_use]
    pub fn surfels(&self) -> &[Surfel] {
        &self.surfels
    }

    /// Frames since each slot was last seen, as of the last [`Self::cover`].
    #[must_use]
    pub fn unseen(&self) -> Vec<u32> {
        let get = |u: &AtomicU32| u.load(Ordering::Relaxed);
        self.unseen.iter().map(get).collect()
    }

    /// Their irradiances.
    #[must_use]
    pub fn irradiances(&self) -> &[Vec3] {
        &self.irradiance
    }

    /// Their lists.
    #[must_use]
    pub fn grid(&self) -> &SurfelGridPass {
        &self.grid
    }

    /// How it behaves, from the next step on.
    pub fn settings_mut(&mut self) -> &mut SurfelSettings {
        &mut self.settings
    }

    /// What happened since [`Self::recycle`] last ran.
    #[must_use]
    pub fn statistics(&self) -> SurfelStatistics {
        self.statistics
    }
}

/// Whether a slot has a surfel, sound or not.
fn taken(surfel: Surfel) -> bool {
    surfel.radius != 0.0
}

/// Whether a pixel has a surface that a surfel can lie on.
fn has_surface(pixel: SurfelPixel) -> bool {
    let disc = Surfel {
        position: pixel.position,
        radius: 1.0,
        normal: pixel.normal,
        mesh: pixel.mesh,
    };
    surfel_sound(disc) == 1
}

/// [`surfel_coverage`](crate::gi::surfel::surfel_coverage), and who takes part.
fn cover_pixel(
    pixel: SurfelPixel,
    surfels: &[Surfel],
    grid: &SurfelGridPass,
    unseen: &[AtomicU32],
) -> f32 {
    let list = grid.list(pixel.position);
    let mut sum = 0.0;
    for i in 0..list.y.min(SURFEL_WALK) {
        let slot = grid.entry(list.x + i) as usize;
        let weight = surfel_weight(surfels[slot], pixel.position, pixel.normal);
        if weight > 0.0 {
            sum += weight;
            if unseen[slot].load(Ordering::Relaxed) != 0 {
                unseen[slot].store(0, Ordering::Relaxed);
            }
        }
    }
    sum
}

fn gather(
    point: Vec3,
    normal: Vec3,
    surfels: &[Surfel],
    irradiance: &[Vec3],
    grid: &SurfelGridPass,
) -> SurfelGathered {
    surfel_gather(
        point,
        normal,
        grid.list(point),
        |entry| surfels[grid.entry(entry) as usize],
        |entry| irradiance[grid.entry(entry) as usize],
    )
}
