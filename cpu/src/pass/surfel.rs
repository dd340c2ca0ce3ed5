//! [`gi::surfel`](crate::gi::surfel) over frames: a pool of surfels that follows
//! what the camera sees and keeps its light.
//!
//! A frame is five steps: surfels that nobody needs go, the lists are built, each
//! tile of 16 × 16 pixels finds the pixel that is covered least, some of these
//! spawn, and every surfel's irradiance moves on by a few rays. Nothing depends
//! on the order of threads: free slots are taken in ascending order by tiles in
//! reading order, and a frame's rays see the irradiance of the frame before.
//!
//! What lies side by side in the world may be anywhere in the pool. So the build
//! copies what a gather reads, in the order of a Morton curve, and rays are
//! traced in that order. It is memory alone: lists, random numbers and sums go
//! by slot, and the bits are the same.

use std::sync::atomic::{AtomicU32, Ordering};

use glam::{UVec2, UVec3, Vec3};

use super::surfel_grid::SurfelGridPass;
use super::svgf::for_rows;
use crate::gi::surfel::{
    SURFEL_TILE_EMPTY, SURFEL_WALK, Surfel, SurfelGathered, surfel_gather, surfel_pixel_area,
    surfel_sound, surfel_spawn_chance, surfel_spawns, surfel_tile_coverage, surfel_tile_index,
    surfel_tile_key, surfel_weight,
};
use crate::gi::surfel_grid::{
    SURFEL_GRID_NOWHERE, SurfelGrid, surfel_grid_coordinate, surfel_grid_find,
};
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
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::surfel::SurfelPixel;
///
/// // A pixel of the sky has no surface, so no normal.
/// let sky = SurfelPixel { position: Vec3::ZERO, normal: Vec3::ZERO, mesh: 0 };
/// assert_eq!(sky.normal.length(), 0.0);
/// ```
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
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raytwin_cpu::pass::surfel::{SurfelPixel, SurfelView};
/// use raytwin_cpu::ray::camera::Camera;
///
/// // One pixel that looks straight down to a floor.
/// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
/// let camera = Camera {
///     origin: 2.0 * Vec3::Y,
///     right: Vec3::X,
///     up: Vec3::NEG_Z,
///     forward: Vec3::NEG_Y,
///     inverse_resolution: Vec2::ONE,
/// };
/// let view = SurfelView { pixels: &[pixel], width: 1, camera };
/// assert_eq!(view.pixels.len() % view.width as usize, 0);
/// ```
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
///
/// ```
/// use glam::Vec3;
/// use raytwin_cpu::pass::surfel::SurfelHit;
///
/// // A lamp; and a white wall without light of its own.
/// let lamp = SurfelHit {
///     position: Vec3::Y,
///     normal: Vec3::NEG_Y,
///     albedo: Vec3::ZERO,
///     emission: Vec3::splat(10.0),
/// };
/// let wall =
///     SurfelHit { albedo: Vec3::splat(0.8), emission: Vec3::ZERO, ..lamp };
/// assert!(lamp.emission.x > 0.0 && wall.albedo.x < 1.0);
/// ```
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
///
/// ```
/// use raytwin_cpu::pass::surfel::SurfelSettings;
///
/// // Larger surfels, and half of the rays.
/// let settings = SurfelSettings {
///     radius: 0.3,
///     budget: 125_000,
///     ..SurfelSettings::default()
/// };
/// assert_eq!(settings.target_coverage, 0.8);
/// ```
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
///
/// ```
/// use glam::{UVec3, Vec2, Vec3};
/// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
/// use raytwin_cpu::pass::surfel::{
///     SurfelPass, SurfelPixel, SurfelSettings, SurfelView,
/// };
/// use raytwin_cpu::ray::camera::Camera;
///
/// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
/// let camera = Camera {
///     origin: 2.0 * Vec3::Y,
///     right: Vec3::X,
///     up: Vec3::NEG_Z,
///     forward: Vec3::NEG_Y,
///     inverse_resolution: Vec2::ONE,
/// };
/// let view = SurfelView { pixels: &[pixel], width: 1, camera };
/// let grid = SurfelGrid {
///     origin: Vec3::splat(-2.0),
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
/// // The floor is not covered yet, so a surfel is spawned.
/// let what = pool.frame(view, |_, _| None, |_| Vec3::ZERO);
/// assert_eq!((what.spawned, what.alive, what.dropped), (1, 1, 0));
/// ```
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

/// What a gather reads of a surfel.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Near {
    surfel: Surfel,
    irradiance: Vec3,
}

/// A surfel in a list: its place, and [`Lattice::code`] of where it is.
#[derive(Clone, Copy, Debug)]
struct Entry {
    place: u32,
    code: u32,
}

/// Copies of the surfels where neighbours in the world are neighbours in memory,
/// as of the last build.
#[derive(Debug)]
struct Neighbours {
    /// By place along the curve.
    near: Vec<Near>,
    /// By place: how far along the curve, and the slot.
    order: Vec<(u64, u32)>,
    /// By slot: how far along the curve, or [`NOWHERE`].
    curve: Vec<u64>,
    /// By slot: its place, [`FRESH`] or [`NO_PLACE`].
    places: Vec<u32>,
    /// The grid's lists, as places in place of slots, in the curve's order too.
    entries: Vec<Entry>,
    /// By slot of the grid: where its list is, and how long it is.
    lists: Vec<UVec2>,
    /// By place, while lists are copied: where the surfel is.
    codes: Vec<u32>,
    lattice: Lattice,
    /// Whether a surfel is no more where its entries say it is.
    stale: bool,
    /// Slots without a place that were filled since.
    fresh: Vec<u32>,
}

/// Longest list that [`Neighbours::narrow`] takes.
const NARROW: usize = 128;

/// Points that look up their surfels at the same time.
const ABREAST: usize = 16;

/// What a gather finds where no surfel is.
const NOTHING: SurfelGathered = SurfelGathered {
    irradiance: Vec3::ZERO,
    weight: 0.0,
};

/// Points that are sorted together.
const MANY: usize = 1 << 18;

/// Entries in a line of the cache.
const LINE: usize = 8;

/// Steps of a lattice to the side of a cell.
const STEPS: f64 = 64.0;

/// Positions in ten bits a coordinate, modulo 1024 steps: enough to see that a
/// surfel cannot cover a point, without reading the surfel.
#[derive(Clone, Copy, Debug, Default)]
struct Lattice {
    /// Steps a unit of length.
    scale: f64,
    /// Square of the largest distance, in steps, at which a surfel may cover.
    reach: i32,
}

impl Lattice {
    /// For surfels up to a radius.
    fn new(inverse_cell: f32, radius: f32) -> Self {
        let scale = STEPS * f64::from(inverse_cell.abs());
        // A surfel covers to its radius over its normal's length, which may be
        // 0.99; the grid's cells have the same margin.
        let reach = f64::from(radius) * 1.03125 * scale;
        Self {
            scale,
            reach: (reach * reach).ceil() as i32,
        }
    }

    #[inline(always)]
    fn code(self, point: Vec3) -> u32 {
        // In double precision: of a product in f32 the last steps are lost.
        let axis = |x: f32| (f64::from(x) * self.scale) as i64 as u32 & 1023;
        axis(point.x) | axis(point.y) << 10 | axis(point.z) << 20
    }

    /// Whether two positions may be as near as a surfel reaches. Modulo 1024 a
    /// distance is never longer than it is, and by its rounding to whole steps
    /// longer by less than one.
    #[inline(always)]
    fn reaches(self, a: u32, b: u32) -> bool {
        let axis = |shift: u32| {
            // The ten bits with their sign, from the top of the word.
            let steps = ((a >> shift).wrapping_sub(b >> shift) << 22) as i32 >> 22;
            let least = (steps.abs() - 1).max(0);
            least * least
        };
        axis(0) + axis(10) + axis(20) <= self.reach
    }
}

/// On no curve: of 63 bits.
const NOWHERE: u64 = u64::MAX;

/// The slot had no surfel when the copies were made.
const NO_PLACE: u32 = u32::MAX;
/// The slot waits for a place.
const FRESH: u32 = u32::MAX - 1;

/// A surfel's frame: its light while rays are traced.
#[derive(Clone, Copy, Debug)]
struct Job {
    slot: u32,
    rays: u32,
    surfel: Surfel,
    state: MultiscaleMeanRobustRgbState,
}

/// Bits of a coordinate, every third one; 21 of them.
fn spread(x: u32) -> u64 {
    let mut bits = u64::from(x & 0x1f_ffff);
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

/// How far along a Morton curve a cell is.
fn curve(cell: UVec3) -> u64 {
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

impl Neighbours {
    fn new(slots: usize) -> Self {
        Self {
            near: Vec::new(),
            order: Vec::new(),
            curve: Vec::new(),
            places: vec![NO_PLACE; slots],
            entries: Vec::new(),
            lists: Vec::new(),
            codes: Vec::new(),
            lattice: Lattice::default(),
            stale: false,
            fresh: Vec::new(),
        }
    }

    /// Copies the pool, and what the lists of `grid` name. The order of the
    /// build before is nearly right, which the sort makes use of.
    fn build(&mut self, surfels: &[Surfel], irradiance: &[Vec3], grid: &SurfelGridPass) {
        let cells = grid.grid();
        for slot in self.fresh.drain(..) {
            self.order.push((0, slot));
        }
        // One after the other in memory; in the curve's order each would be
        // waited for.
        self.curve.clear();
        self.curve.extend(surfels.iter().map(|surfel| {
            if surfel_sound(*surfel) == 0 {
                return NOWHERE;
            }
            curve(surfel_grid_coordinate(surfel.position, 0, cells))
        }));
        self.order.retain_mut(|(at, slot)| {
            *at = self.curve[*slot as usize];
            *at != NOWHERE
        });
        self.order.sort();
        self.places.fill(NO_PLACE);
        self.near.clear();
        // Reads from anywhere, with little work between them: many at a time.
        self.near.extend(self.order.iter().map(|(_, slot)| Near {
            surfel: surfels[*slot as usize],
            irradiance: irradiance[*slot as usize],
        }));
        for (place, (_, slot)) in (0u32..).zip(&self.order) {
            self.places[*slot as usize] = place;
        }
        let positions = || self.near.iter().map(|near| &near.surfel);
        let widest = positions().fold(0.0, |widest: f32, s| widest.max(s.radius));
        let lattice = Lattice::new(cells.inverse_cell, widest);
        self.codes.clear();
        self.codes
            .extend(positions().map(|s| lattice.code(s.position)));
        self.lattice = lattice;
        self.stale = false;
        self.lists.clear();
        self.lists.resize(grid.firsts().len(), UVec2::ZERO);
        self.entries.clear();
        for place in 0..self.near.len() {
            let home = surfel_grid_find(self.near[place].surfel.position, cells);
            if home != SURFEL_GRID_NOWHERE {
                self.copy_list(home as usize, grid);
            }
        }
        // Cells in which no surfel's middle is.
        for slot in 0..self.lists.len() {
            self.copy_list(slot, grid);
        }
    }

    fn copy_list(&mut self, slot: usize, grid: &SurfelGridPass) {
        if self.lists[slot].y > 0 {
            return;
        }
        let count = grid.counts()[slot];
        self.lists[slot] = UVec2::new(self.entries.len() as u32, count);
        let first = grid.firsts()[slot] as usize;
        if count > 0 {
            let list = &grid.entries()[first..first + count as usize];
            let (places, codes) = (&self.places, &self.codes);
            self.entries.extend(list.iter().map(|slot| {
                let place = places[*slot as usize];
                let code = codes[place as usize];
                Entry { place, code }
            }));
        }
    }

    /// The list that a point looks up, in `entries`.
    fn list(&self, point: Vec3, grid: &SurfelGridPass) -> UVec2 {
        let slot = surfel_grid_find(point, grid.grid());
        // Before the first build there are none.
        self.lists
            .get(slot as usize)
            .copied()
            .unwrap_or(UVec2::ZERO)
    }

    /// The copy of a slot's surfel, if there is one.
    fn copy(&mut self, slot: usize) -> Option<&mut Near> {
        self.near.get_mut(self.places[slot] as usize)
    }

    /// A slot has another surfel now.
    fn set(&mut self, slot: usize, surfel: Surfel) {
        if let Some(near) = self.copy(slot) {
            near.surfel = surfel;
            self.stale = true;
        }
    }

    /// A free slot has been filled, with a surfel that has no light.
    fn insert(&mut self, slot: u32, surfel: Surfel) {
        if let Some(near) = self.copy(slot as usize) {
            near.irradiance = Vec3::ZERO;
            self.set(slot as usize, surfel);
        } else if self.places[slot as usize] == NO_PLACE {
            self.places[slot as usize] = FRESH;
            self.fresh.push(slot);
        }
    }

    fn gather(&self, point: Vec3, normal: Vec3, grid: &SurfelGridPass) -> SurfelGathered {
        let list = self.list(point, grid);
        let mut kept = [0; NARROW];
        let count = self.narrow(point, list, &mut kept);
        self.gather_narrow(point, normal, list, count.map(|n| &kept[..n as usize]))
    }

    /// Of what [`Self::narrow`] kept, or of all.
    fn gather_narrow(
        &self,
        point: Vec3,
        normal: Vec3,
        list: UVec2,
        kept: Option<&[u32]>,
    ) -> SurfelGathered {
        let Some(kept) = kept else {
            return surfel_gather(
                point,
                normal,
                list,
                |entry| self.read(entry).surfel,
                |entry| self.read(entry).irradiance,
            );
        };
        let near = |i: u32| &self.near[kept[i as usize] as usize];
        surfel_gather(
            point,
            normal,
            UVec2::new(0, kept.len() as u32),
            |i| near(i).surfel,
            |i| near(i).irradiance,
        )
    }

    /// [`Self::gather`] at up to [`ABREAST`] points, step by step for all of
    /// them: one point alone would wait for the memory four times in turn.
    fn gather_abreast(
        &self,
        points: &[(Vec3, Vec3)],
        grid: &SurfelGridPass,
        mut give: impl FnMut(usize, SurfelGathered),
    ) {
        let mut lists = [UVec2::ZERO; ABREAST];
        for (list, (point, _)) in lists.iter_mut().zip(points) {
            *list = self.list(*point, grid);
        }
        // What is read here is needed in the next step; the sums keep the
        // compiler from leaving it out.
        let mut bits = 0;
        for list in &lists[..points.len()] {
            let entries = &self.entries[list.x as usize..(list.x + list.y) as usize];
            bits ^= entries
                .iter()
                .step_by(LINE)
                .fold(0, |bits, e| bits ^ e.place);
        }
        let mut kept = [[0; NARROW]; ABREAST];
        let mut counts = [None; ABREAST];
        for (i, (point, _)) in points.iter().enumerate() {
            counts[i] = self.narrow(*point, lists[i], &mut kept[i]);
            for place in &kept[i][..counts[i].unwrap_or(0) as usize] {
                let near = &self.near[*place as usize];
                bits ^= near.surfel.position.x.to_bits();
            }
        }
        std::hint::black_box(bits);
        for (i, (point, normal)) in points.iter().enumerate() {
            let kept = counts[i].map(|n| &kept[i][..n as usize]);
            give(i, self.gather_narrow(*point, *normal, lists[i], kept));
        }
    }

    /// [`Self::gather`] at any number of points, by list, and lists are in the
    /// order of their cells: points that share surfels come one after the other.
    fn gather_sorted(
        &self,
        points: &[(Vec3, Vec3)],
        found: &mut [SurfelGathered],
        grid: &SurfelGridPass,
    ) {
        let mut order: Vec<u64> = (0u64..)
            .zip(points)
            .map(|(i, (point, _))| u64::from(self.list(*point, grid).x) << 32 | i)
            .collect();
        order.sort_unstable();
        let mut some = [(Vec3::ZERO, Vec3::ZERO); ABREAST];
        for order in order.chunks(ABREAST) {
            for (point, i) in some.iter_mut().zip(order) {
                *point = points[*i as u32 as usize];
            }
            self.gather_abreast(&some[..order.len()], grid, |i, one| {
                found[order[i] as u32 as usize] = one;
            });
        }
    }

    /// The places of a list's surfels that may cover a point, in their order;
    /// none for a list that is too long.
    #[inline]
    fn narrow(&self, point: Vec3, list: UVec2, kept: &mut [u32; NARROW]) -> Option<u32> {
        let entries = self.entries[list.x as usize..].get(..list.y as usize)?;
        if entries.len() > NARROW || self.stale {
            return None;
        }
        let here = self.lattice.code(point);
        let mut count = 0;
        for Entry { place, code } in entries {
            kept[count] = *place;
            count += usize::from(self.lattice.reaches(here, *code));
        }
        Some(count as u32)
    }

    #[inline]
    fn read(&self, entry: u32) -> &Near {
        &self.near[self.entries[entry as usize].place as usize]
    }
}

/// A pool of surfels.
///
/// ```
/// use glam::{UVec3, Vec2, Vec3};
/// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
/// use raytwin_cpu::pass::surfel::{
///     SurfelHit, SurfelPass, SurfelPixel, SurfelSettings, SurfelView,
/// };
/// use raytwin_cpu::ray::camera::Camera;
///
/// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
/// let camera = Camera {
///     origin: 2.0 * Vec3::Y,
///     right: Vec3::X,
///     up: Vec3::NEG_Z,
///     forward: Vec3::NEG_Y,
///     inverse_resolution: Vec2::ONE,
/// };
/// let view = SurfelView { pixels: &[pixel], width: 1, camera };
/// let grid = SurfelGrid {
///     origin: Vec3::splat(-2.0),
///     inverse_cell: 2.0,
///     size: UVec3::splat(8),
///     slots: 512,
///     inverse_reach: 0.0,
/// };
/// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
/// // A sky of radiance 1 in all directions.
/// let sky = SurfelHit {
///     position: 100.0 * Vec3::Y,
///     normal: Vec3::NEG_Y,
///     albedo: Vec3::ZERO,
///     emission: Vec3::ONE,
/// };
/// for _ in 0..4 {
///     pool.frame(view, |_, _| Some(sky), |_| Vec3::ZERO);
/// }
/// // The cosine integral of radiance 1 is π.
/// let light = pool.gather(Vec3::ZERO, Vec3::Y).irradiance;
/// assert!((light.x - std::f32::consts::PI).abs() < 1e-4);
/// ```
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
    neighbours: Neighbours,
    jobs: Vec<Job>,
    /// Free slots, the lowest one last.
    free: Vec<u32>,
    keys: Vec<u32>,
    frame: u32,
    statistics: SurfelStatistics,
}

impl SurfelPass {
    /// A pool of `capacity` slots whose lists hold `entries` in all; a surfel
    /// takes about eight.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// assert_eq!(pool.surfels().len(), 64);
    /// assert_eq!(pool.statistics().alive, 0);
    /// ```
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
            neighbours: Neighbours::new(slots),
            jobs: Vec::new(),
            free: (0..capacity).rev().collect(),
            keys: Vec::new(),
            frame: 0,
            statistics: SurfelStatistics::default(),
        }
    }

    /// All of a frame: [`Self::recycle`], [`Self::build`], [`Self::cover`],
    /// [`Self::spawn`], [`Self::update`]. Before it, [`Self::follow`] what moved.
    ///
    /// ```
    /// use glam::{UVec3, Vec2, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{
    ///     SurfelPass, SurfelPixel, SurfelSettings, SurfelView,
    /// };
    /// use raytwin_cpu::ray::camera::Camera;
    ///
    /// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
    /// let camera = Camera {
    ///     origin: 2.0 * Vec3::Y,
    ///     right: Vec3::X,
    ///     up: Vec3::NEG_Z,
    ///     forward: Vec3::NEG_Y,
    ///     inverse_resolution: Vec2::ONE,
    /// };
    /// let view = SurfelView { pixels: &[pixel], width: 1, camera };
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let first = pool.frame(view, |_, _| None, |_| Vec3::ZERO);
    /// assert_eq!(first.spawned, 1);
    /// // What is covered stays as it is.
    /// let second = pool.frame(view, |_, _| None, |_| Vec3::ZERO);
    /// assert_eq!((second.spawned, second.alive), (0, 1));
    /// ```
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
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::gi::surfel_irradiance::SurfelIrradiancePose;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let slot = pool.insert(surfel).unwrap();
    /// // Object 0 moves up by 1.
    /// let old = SurfelIrradiancePose {
    ///     x: Vec3::X,
    ///     y: Vec3::Y,
    ///     z: Vec3::Z,
    ///     origin: Vec3::ZERO,
    /// };
    /// pool.follow(0, old, SurfelIrradiancePose { origin: Vec3::Y, ..old });
    /// assert_eq!(pool.surfels()[slot as usize].position, Vec3::Y);
    /// ```
    pub fn follow(&mut self, mesh: u32, old: SurfelIrradiancePose, new: SurfelIrradiancePose) {
        for (slot, surfel) in self.surfels.iter_mut().enumerate() {
            if surfel.mesh == mesh && surfel_sound(*surfel) == 1 {
                *surfel = surfel_irradiance_follow(*surfel, old, new);
                self.neighbours.set(slot, *surfel);
            }
        }
    }

    /// Starts a frame: gives up who went unseen for too long, or is broken.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let settings = SurfelSettings { patience: 2, ..SurfelSettings::default() };
    /// let mut pool = SurfelPass::new(settings, grid, 1024, 8192);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// pool.insert(surfel);
    /// for _ in 0..4 {
    ///     pool.recycle();
    /// }
    /// // It has gone unseen for more than two frames.
    /// assert_eq!((pool.statistics().recycled, pool.statistics().alive), (1, 0));
    /// ```
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
                self.neighbours.set(slot, FREE);
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
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// pool.insert(surfel);
    /// // It touches some of the cells around the origin.
    /// pool.build();
    /// assert!(!pool.grid().entries().is_empty());
    /// ```
    pub fn build(&mut self) {
        self.grid.build(&self.surfels);
        self.neighbours
            .build(&self.surfels, &self.irradiance, &self.grid);
        self.statistics.homeless = self.grid.homeless() - self.free.len() as u32;
        self.statistics.entries_dropped = self.grid.dropped();
    }

    /// Finds the least covered pixel of each tile, and who is seen.
    ///
    /// ```
    /// use glam::{UVec3, Vec2, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{
    ///     SurfelPass, SurfelPixel, SurfelSettings, SurfelView,
    /// };
    /// use raytwin_cpu::ray::camera::Camera;
    ///
    /// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
    /// let camera = Camera {
    ///     origin: 2.0 * Vec3::Y,
    ///     right: Vec3::X,
    ///     up: Vec3::NEG_Z,
    ///     forward: Vec3::NEG_Y,
    ///     inverse_resolution: Vec2::ONE,
    /// };
    /// let view = SurfelView { pixels: &[pixel], width: 1, camera };
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let slot = pool.insert(surfel).unwrap();
    /// pool.recycle();
    /// pool.build();
    /// // The pixel sees the surfel.
    /// pool.cover(view);
    /// assert_eq!(pool.unseen()[slot as usize], 0);
    /// ```
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
        let (near, unseen, grid) = (&self.neighbours, &self.unseen, &self.grid);
        for_rows(&mut self.keys, across, |row, keys| {
            for y in row * TILE..((row + 1) * TILE).min(height) {
                for x in 0..width {
                    let pixel = view.pixels[y * width + x];
                    if !has_surface(pixel) {
                        continue;
                    }
                    let coverage = cover_pixel(pixel, near, grid, unseen);
                    let index = (y % TILE * TILE + x % TILE) as u32;
                    let key = &mut keys[x / TILE];
                    *key = (*key).min(surfel_tile_key(coverage, index));
                }
            }
        });
    }

    /// Spawns surfels where [`Self::cover`], with the same view, found them
    /// missing.
    ///
    /// ```
    /// use glam::{UVec3, Vec2, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{
    ///     SurfelPass, SurfelPixel, SurfelSettings, SurfelView,
    /// };
    /// use raytwin_cpu::ray::camera::Camera;
    ///
    /// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
    /// let camera = Camera {
    ///     origin: 2.0 * Vec3::Y,
    ///     right: Vec3::X,
    ///     up: Vec3::NEG_Z,
    ///     forward: Vec3::NEG_Y,
    ///     inverse_resolution: Vec2::ONE,
    /// };
    /// let view = SurfelView { pixels: &[pixel], width: 1, camera };
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// pool.recycle();
    /// pool.build();
    /// pool.cover(view);
    /// pool.spawn(view);
    /// assert_eq!(pool.surfels()[0].position, pixel.position);
    /// ```
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
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// assert_eq!(pool.insert(surfel), Some(0));
    /// assert_eq!(pool.insert(surfel), Some(1));
    /// // Without a radius it is none.
    /// assert_eq!(pool.insert(Surfel { radius: 0.0, ..surfel }), None);
    /// ```
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
        self.neighbours.insert(slot, surfel);
        self.statistics.alive += 1;
        Some(slot)
    }

    /// Ends a frame: traces rays and moves every surfel's irradiance on.
    ///
    /// `trace` gives the first hit of a ray from a point in a unit direction;
    /// `direct` the irradiance that a hit has from lights, the cosine included.
    /// With the feature `rayon` both are called from several threads.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelHit, SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let slot = pool.insert(surfel).unwrap();
    /// // A sky of radiance 1 in all directions.
    /// let sky = SurfelHit {
    ///     position: 100.0 * Vec3::Y,
    ///     normal: Vec3::NEG_Y,
    ///     albedo: Vec3::ZERO,
    ///     emission: Vec3::ONE,
    /// };
    /// pool.update(|_, _| Some(sky), |_| Vec3::ZERO);
    /// let light = pool.irradiances()[slot as usize];
    /// assert!((light.x - std::f32::consts::PI).abs() < 1e-4);
    /// ```
    pub fn update(
        &mut self,
        trace: impl Fn(Vec3, Vec3) -> Option<SurfelHit> + Sync + Send,
        direct: impl Fn(&SurfelHit) -> Vec3 + Sync + Send,
    ) {
        self.statistics.rays = self.allow_rays();
        let (near, grid) = (&self.neighbours, &self.grid);
        let (frame, longest) = (self.frame, self.settings.longest);
        self.jobs.clear();
        let built = near.order.iter().zip(&near.near);
        let built = built.map(|((_, slot), near)| (*slot, near.surfel));
        let fresh = near.fresh.iter();
        let fresh = fresh.map(|slot| (*slot, self.surfels[*slot as usize]));
        for (slot, surfel) in built.chain(fresh) {
            let Light { state, rays, .. } = self.lights[slot as usize];
            if rays > 0 {
                self.jobs.push(Job {
                    slot,
                    rays,
                    surfel,
                    state,
                });
            }
        }
        if !self.jobs.is_empty() {
            for_rows(&mut self.jobs, BATCH, |_, jobs| {
                let mut hits: Vec<(usize, SurfelHit)> = Vec::with_capacity(jobs.len());
                for (index, job) in jobs.iter().enumerate() {
                    let origin = surfel_irradiance_origin(job.surfel);
                    for ray in 0..job.rays {
                        let direction =
                            surfel_irradiance_direction(job.surfel.normal, job.slot, frame, ray);
                        if let Some(hit) = trace(origin, direction) {
                            hits.push((index, hit));
                        }
                    }
                }
                let points: Vec<_> = hits.iter().map(|(_, h)| (h.position, h.normal)).collect();
                let mut found = vec![NOTHING; hits.len()];
                near.gather_sorted(&points, &mut found, grid);
                let mut sums = [Vec3::ZERO; BATCH];
                for ((job, hit), found) in hits.iter().zip(found) {
                    sums[*job] += surfel_irradiance_outgoing(
                        hit.albedo,
                        hit.emission,
                        direct(hit),
                        found.irradiance,
                    );
                }
                for (job, sum) in jobs.iter_mut().zip(sums) {
                    job.state = multiscale_mean_robust_rgb_step(
                        job.state,
                        surfel_irradiance_sample(sum, job.rays),
                        MULTISCALE_MEAN_SHORT_BLEND,
                        longest,
                    );
                }
            });
        }
        for job in &self.jobs {
            let slot = job.slot as usize;
            let irradiance = multiscale_mean_robust_rgb_value(job.state);
            let light = &mut self.lights[slot];
            light.state = job.state;
            light.age = light.age.saturating_add(1);
            self.irradiance[slot] = irradiance;
            if let Some(near) = self.neighbours.copy(slot) {
                near.irradiance = irradiance;
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
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// pool.insert(surfel);
    /// pool.build();
    /// // Covered, but no ray has brought light yet.
    /// let found = pool.gather(Vec3::ZERO, Vec3::Y);
    /// assert_eq!((found.irradiance, found.weight), (Vec3::ZERO, 1.0));
    /// ```
    #[must_use]
    pub fn gather(&self, point: Vec3, normal: Vec3) -> SurfelGathered {
        self.neighbours.gather(point, normal, &self.grid)
    }

    /// [`Self::gather`] at many points with their normals, in any order: the
    /// same results, sooner where the points are far from each other. In
    /// parallel with the feature `rayon`.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// pool.insert(surfel);
    /// pool.build();
    /// let points = [(Vec3::ZERO, Vec3::Y), (Vec3::X, Vec3::Y)];
    /// let found = pool.gather_many(&points);
    /// assert_eq!((found[0].weight, found[1].weight), (1.0, 0.0));
    /// ```
    #[must_use]
    pub fn gather_many(&self, points: &[(Vec3, Vec3)]) -> Vec<SurfelGathered> {
        let mut found = vec![NOTHING; points.len()];
        if !points.is_empty() {
            for_rows(&mut found, MANY, |row, found| {
                let points = &points[row * MANY..][..found.len()];
                self.neighbours.gather_sorted(points, found, &self.grid);
            });
        }
        found
    }

    /// The surfels by slot; a free slot's has no radius.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// pool.insert(surfel);
    /// let taken = pool.surfels().iter().filter(|s| s.radius > 0.0);
    /// assert_eq!(taken.count(), 1);
    /// ```
    #[must_use]
    pub fn surfels(&self) -> &[Surfel] {
        &self.surfels
    }

    /// Frames since each slot was last seen, as of the last [`Self::cover`].
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// let slot = pool.insert(surfel).unwrap() as usize;
    /// pool.recycle();
    /// assert_eq!(pool.unseen()[slot], 1);
    /// ```
    #[must_use]
    pub fn unseen(&self) -> Vec<u32> {
        let get = |u: &AtomicU32| u.load(Ordering::Relaxed);
        self.unseen.iter().map(get).collect()
    }

    /// Their irradiances.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// // One for each slot, dark at first.
    /// assert_eq!(pool.irradiances(), [Vec3::ZERO; 64]);
    /// ```
    #[must_use]
    pub fn irradiances(&self) -> &[Vec3] {
        &self.irradiance
    }

    /// Their lists.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel::Surfel;
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let surfel =
    ///     Surfel { position: Vec3::ZERO, radius: 0.2, normal: Vec3::Y, mesh: 0 };
    /// pool.insert(surfel);
    /// pool.build();
    /// let list = pool.grid().list(surfel.position);
    /// assert_eq!((list.y, pool.grid().entry(list.x)), (1, 0));
    /// ```
    #[must_use]
    pub fn grid(&self) -> &SurfelGridPass {
        &self.grid
    }

    /// How it behaves, from the next step on.
    ///
    /// ```
    /// use glam::{UVec3, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{SurfelPass, SurfelSettings};
    ///
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// // Fewer rays while the frame rate is low.
    /// pool.settings_mut().budget = 50_000;
    /// assert_eq!(pool.settings_mut().budget, 50_000);
    /// ```
    pub fn settings_mut(&mut self) -> &mut SurfelSettings {
        &mut self.settings
    }

    /// What happened since [`Self::recycle`] last ran.
    ///
    /// ```
    /// use glam::{UVec3, Vec2, Vec3};
    /// use raytwin_cpu::gi::surfel_grid::SurfelGrid;
    /// use raytwin_cpu::pass::surfel::{
    ///     SurfelPass, SurfelPixel, SurfelSettings, SurfelView,
    /// };
    /// use raytwin_cpu::ray::camera::Camera;
    ///
    /// let pixel = SurfelPixel { position: Vec3::ZERO, normal: Vec3::Y, mesh: 0 };
    /// let camera = Camera {
    ///     origin: 2.0 * Vec3::Y,
    ///     right: Vec3::X,
    ///     up: Vec3::NEG_Z,
    ///     forward: Vec3::NEG_Y,
    ///     inverse_resolution: Vec2::ONE,
    /// };
    /// let view = SurfelView { pixels: &[pixel], width: 1, camera };
    /// let grid = SurfelGrid {
    ///     origin: Vec3::splat(-2.0),
    ///     inverse_cell: 2.0,
    ///     size: UVec3::splat(8),
    ///     slots: 512,
    ///     inverse_reach: 0.0,
    /// };
    /// let mut pool = SurfelPass::new(SurfelSettings::default(), grid, 64, 512);
    /// let what = pool.frame(view, |_, _| None, |_| Vec3::ZERO);
    /// assert_eq!(pool.statistics(), what);
    /// ```
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
    near: &Neighbours,
    grid: &SurfelGridPass,
    unseen: &[AtomicU32],
) -> f32 {
    let list = near.list(pixel.position, grid);
    let mut sum = 0.0;
    let mut add = |place: u32| {
        let surfel = near.near[place as usize].surfel;
        let weight = surfel_weight(surfel, pixel.position, pixel.normal);
        if weight > 0.0 {
            sum += weight;
            let slot = near.order[place as usize].1 as usize;
            if unseen[slot].load(Ordering::Relaxed) != 0 {
                unseen[slot].store(0, Ordering::Relaxed);
            }
        }
    };
    let mut kept = [0; NARROW];
    if let Some(count) = near.narrow(pixel.position, list, &mut kept) {
        kept[..count as usize].iter().copied().for_each(add);
    } else {
        let entries = list.x..list.x + list.y.min(SURFEL_WALK);
        entries.for_each(|entry| add(near.entries[entry as usize].place));
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::pcg::pcg_hash;

    fn random(i: u32) -> f32 {
        (pcg_hash(i) >> 8) as f32 / 16_777_216.0
    }

    fn surfel(i: u32) -> Surfel {
        Surfel {
            position: Vec3::new(random(3 * i), random(3 * i + 1), random(3 * i + 2)),
            radius: 0.1,
            normal: if i.is_multiple_of(2) {
                Vec3::Y
            } else {
                Vec3::X
            },
            mesh: i % 2,
        }
    }

    /// What the copies give is what the pool and the grid's lists give.
    fn compare(pass: &SurfelPass) -> usize {
        let grid = pass.grid();
        let slot = |entry| grid.entry(entry) as usize;
        let mut lit = 0;
        for i in 0..300 {
            let near = surfel(i);
            let point = near.position + Vec3::splat(0.03);
            let expected = surfel_gather(
                point,
                near.normal,
                grid.list(point),
                |entry| pass.surfels()[slot(entry)],
                |entry| pass.irradiances()[slot(entry)],
            );
            let found = pass.gather(point, near.normal);
            assert_eq!(found.irradiance, expected.irradiance);
            assert_eq!(found.weight.to_bits(), expected.weight.to_bits());
            lit += usize::from(found.irradiance.x > 0.0);
        }
        // Many at a time, in the order of their lists: the same.
        let points: Vec<_> = (0..300)
            .map(|i| (surfel(i).position + Vec3::splat(0.03), surfel(i).normal))
            .collect();
        let bits = |g: SurfelGathered| (g.irradiance.to_array().map(f32::to_bits), g.weight);
        for (one, (point, normal)) in pass.gather_many(&points).into_iter().zip(points) {
            assert_eq!(bits(one), bits(pass.gather(point, normal)));
        }
        lit
    }

    #[test]
    fn what_covers_a_point_is_kept() {
        let near_by = |i: u32, scale: f32| Surfel {
            position: Vec3::new(random(8 * i), random(8 * i + 1), random(8 * i + 2)) * scale,
            radius: scale * (0.001 + 0.05 * random(8 * i + 3)),
            // As short as a sound normal is.
            normal: Vec3::new(random(8 * i + 4), random(8 * i + 5), 0.1).normalize() * 0.99,
            mesh: 0,
        };
        let (mut covered, mut kept, mut left_out) = (0, 0, 0);
        for scale in [1e-3f32, 1.0, 37.0, 1e5] {
            // From cells smaller than a surfel to cells that hold all of them.
            for cell in [0.002, 0.008, 0.1, 3.0] {
                for i in 0..20_000 {
                    let surfel = near_by(i, scale);
                    let lattice = Lattice::new(1.0 / (cell * scale), surfel.radius);
                    // Along the disc, where it reaches farthest, around the rim.
                    let along = surfel.normal.cross(Vec3::new(0.3, random(8 * i + 6), 1.0));
                    let far = 0.96 + 0.06 * random(8 * i + 7);
                    let point = surfel.position + along.normalize() * (far * surfel.radius);
                    let code = lattice.code(surfel.position);
                    let reaches = lattice.reaches(lattice.code(point), code);
                    let covers = surfel_weight(surfel, point, surfel.normal) > 0.0;
                    assert!(reaches || !covers, "{surfel:?} {point} cell {cell}");
                    covered += usize::from(covers);
                    let other = near_by(i + 20_000, scale).position - Vec3::splat(0.5 * scale);
                    let reaches = lattice.reaches(lattice.code(other), code);
                    kept += usize::from(reaches);
                    left_out += usize::from(!reaches);
                }
            }
        }
        println!("{covered} cover; of others {kept} kept, {left_out} left out");
        assert!(covered > 100_000 && left_out > 100_000);
    }

    #[test]
    fn copies_follow_the_pool() {
        let settings = SurfelSettings {
            patience: 3,
            budget: 1000,
            ..SurfelSettings::default()
        };
        let sky = |_, _| {
            Some(SurfelHit {
                position: Vec3::splat(9.0),
                normal: Vec3::NEG_Y,
                albedo: Vec3::ZERO,
                emission: Vec3::ONE,
            })
        };
        let pose = SurfelIrradiancePose {
            x: Vec3::X,
            y: Vec3::Y,
            z: Vec3::Z,
            origin: Vec3::ZERO,
        };
        // Dense, hashed, with levels; and one whose lists have no room.
        for (size, reach, entries) in [
            (UVec3::splat(8), 0.0, 100_000),
            (UVec3::ZERO, 0.0, 100_000),
            (UVec3::ZERO, 2.0, 100_000),
            (UVec3::ZERO, 0.0, 900),
        ] {
            let grid = SurfelGrid {
                origin: Vec3::splat(-0.3),
                inverse_cell: 5.0,
                size,
                slots: 512,
                inverse_reach: reach,
            };
            let mut pass = SurfelPass::new(settings, grid, 600, entries);
            assert_eq!(compare(&pass), 0);
            let mut lit = 0;
            for frame in 0..12 {
                pass.recycle();
                compare(&pass);
                for i in 0..60 {
                    pass.insert(surfel(60 * (frame % 5) + i));
                }
                compare(&pass);
                pass.build();
                compare(&pass);
                let moved = Vec3::splat(0.01);
                pass.follow(
                    1,
                    pose,
                    SurfelIrradiancePose {
                        origin: moved,
                        ..pose
                    },
                );
                compare(&pass);
                pass.update(sky, |_| Vec3::ZERO);
                lit = compare(&pass);
            }
            assert!(lit > if entries < 1000 { 5 } else { 30 }, "{lit}");
            assert!(pass.statistics().recycled > 0);
        }
    }
}
