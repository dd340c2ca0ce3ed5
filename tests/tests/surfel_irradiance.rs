//! What surfels promise over frames: the closed form of a furnace, light that
//! goes when its source does, spawns as often as stated, and a pool that stays
//! whole whatever it is shown.

use glam::{UVec3, Vec2, Vec3};
use raytwin::cpu::pass::surfel::{
    SurfelHit, SurfelPass, SurfelPixel, SurfelSettings, SurfelStatistics, SurfelView,
};
use raytwin::gi::surfel::{SURFEL_WALK, Surfel, surfel_sound};
use raytwin::gi::surfel_grid::SurfelGrid;
use raytwin::gi::surfel_irradiance::SURFEL_IRRADIANCE_ALBEDO;
use raytwin::math::vector::vec3_dot;
use raytwin::ray::bvh::{BVH_MISS, bvh_any, bvh_closest};
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin::ray::camera::{Camera, camera_ray};
use raytwin::ray::ray::Ray;
use raytwin_tests::gpu::{Build, Gpu, adapters, entry_module};
use std::f32::consts::PI;

/// The inside of a box: six walls that see each other.
#[derive(Clone, Copy)]
struct Room {
    low: Vec3,
    size: f32,
}

impl Room {
    /// Where a ray from inside leaves, the wall's inward normal and number.
    fn wall(self, origin: Vec3, direction: Vec3) -> Option<(Vec3, Vec3, u32)> {
        let mut best = (f32::MAX, Vec3::ZERO, 0);
        for axis in 0..3 {
            let d = direction[axis];
            if d == 0.0 {
                continue;
            }
            let plane = self.low[axis] + if d > 0.0 { self.size } else { 0.0 };
            let t = (plane - origin[axis]) / d;
            if t < best.0 {
                let mut normal = Vec3::ZERO;
                normal[axis] = -d.signum();
                best = (t.max(0.0), normal, 2 * axis as u32 + u32::from(d > 0.0));
            }
        }
        (best.0 < f32::MAX).then(|| (origin + direction * best.0, best.1, best.2))
    }

    /// One of six views of 90 degrees from a point inside.
    fn view(self, index: u32, width: u32) -> (Vec<SurfelPixel>, Camera) {
        let middle = self.low + Vec3::new(0.5, 0.5, 0.5) * self.size;
        let forward = [
            Vec3::X,
            Vec3::NEG_X,
            Vec3::Y,
            Vec3::NEG_Y,
            Vec3::Z,
            Vec3::NEG_Z,
        ][index as usize % 6];
        let up = if forward.y == 0.0 { Vec3::Y } else { Vec3::Z };
        let camera = Camera {
            origin: middle,
            right: forward.cross(up),
            up,
            forward,
            inverse_resolution: Vec2::splat(1.0 / width as f32),
        };
        let pixels = (0..width * width)
            .map(|i| {
                let at = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
                let ray = camera_ray(at, camera);
                let (position, normal, mesh) =
                    self.wall(ray.origin, ray.direction).expect("a closed room");
                SurfelPixel {
                    position,
                    normal,
                    mesh,
                }
            })
            .collect();
        (pixels, camera)
    }
}

fn settings(scale: f32) -> SurfelSettings {
    SurfelSettings {
        rate: 1.0,
        radius: 0.125 * scale,
        patience: 60_000,
        ..SurfelSettings::default()
    }
}

fn grid(room: Room) -> SurfelGrid {
    SurfelGrid {
        origin: room.low,
        inverse_cell: 4.0 / room.size,
        size: UVec3::ZERO,
        slots: 1021,
        inverse_reach: 0.0,
    }
}

const UNIT: Room = Room {
    low: Vec3::ZERO,
    size: 1.0,
};

/// A pool that covers a room, before any light. `part` of the room's size is
/// the surfels' radius, an eighth or a quarter.
fn covered(room: Room, part: f32) -> SurfelPass {
    let settings = settings(room.size * part * 8.0);
    let grid = SurfelGrid {
        inverse_cell: 0.5 / (part * room.size),
        ..grid(room)
    };
    let mut pass = SurfelPass::new(settings, grid, 4000, 200_000);
    pass.settings_mut().budget = 0;
    let views: Vec<_> = (0..6).map(|i| room.view(i, 128)).collect();
    for frame in 0..240 {
        let (pixels, camera) = &views[frame % 6];
        let view = SurfelView {
            pixels,
            width: 128,
            camera: *camera,
        };
        let found = pass.frame(view, |_, _| None, |_| Vec3::ZERO);
        assert_eq!(
            (found.dropped, found.homeless, found.entries_dropped),
            (0, 0, 0)
        );
    }
    pass.settings_mut().budget = 250_000;
    pass
}

/// A frame without a camera.
fn light_up(
    pass: &mut SurfelPass,
    room: Room,
    albedo: f32,
    emission: impl Fn(Vec3, u32) -> f32 + Sync + Send,
) {
    pass.recycle();
    pass.build();
    pass.update(
        |origin, direction| {
            let (position, normal, wall) = room.wall(origin, direction)?;
            Some(SurfelHit {
                position,
                normal,
                albedo: Vec3::splat(albedo),
                emission: Vec3::splat(emission(position, wall)),
            })
        },
        |_| Vec3::ZERO,
    );
}

/// Least and largest irradiance of the living.
fn extremes(pass: &SurfelPass) -> (f32, f32) {
    pass.surfels()
        .iter()
        .zip(pass.irradiances())
        .filter(|(s, _)| surfel_sound(**s) == 1)
        .map(|(_, e)| e.x)
        .fold((f32::MAX, 0.0), |(low, high), e| (low.min(e), high.max(e)))
}

#[test]
fn a_furnace_reaches_the_closed_form() {
    for albedo in [0.2, 0.5, 0.8] {
        let mut pass = covered(UNIT, 0.125);
        let most = PI / (1.0 - albedo);
        let mut frames = 0;
        for frame in 1..=3000 {
            light_up(&mut pass, UNIT, albedo, |_, _| 1.0);
            let (low, high) = extremes(&pass);
            // Light never grows beyond what the room can hold.
            assert!(high <= most * 1.00001, "{albedo}: {high} in frame {frame}");
            let outgoing = |e: f32| 1.0 + albedo * e / PI;
            let wanted = 1.0 / (1.0 - albedo);
            if outgoing(low) > wanted * 0.99 {
                frames = frame;
                break;
            }
        }
        eprintln!(
            "albedo {albedo}: within 1 % after {frames} frames, {:?}",
            pass.statistics()
        );
        assert!(frames > 0, "{albedo}: {:?} of {most}", extremes(&pass));
        // And stays.
        for _ in 0..500 {
            light_up(&mut pass, UNIT, albedo, |_, _| 1.0);
        }
        let (low, high) = extremes(&pass);
        let outgoing = |e: f32| (1.0 + albedo * e / PI) * (1.0 - albedo);
        assert!(
            outgoing(low) > 0.99 && outgoing(high) < 1.0001,
            "{low} {high}"
        );
    }
}

#[test]
fn a_light_that_is_switched_off_dies_away() {
    for (albedo, longest, frames) in [(0.5f32, 256.0, 2500), (0.8, 64.0, 1000), (1.0, 64.0, 5000)] {
        let mut pass = covered(UNIT, 0.25);
        pass.settings_mut().longest = longest;
        // A lamp in the ceiling: noise, unlike a furnace.
        let lamp = |p: Vec3, wall: u32| {
            f32::from(u8::from(
                wall == 3 && (p - Vec3::splat(0.5)).with_y(0.0).length() < 0.2,
            ))
        };
        let bound = PI / (1.0 - albedo.min(SURFEL_IRRADIANCE_ALBEDO));
        for _ in 0..600 {
            light_up(&mut pass, UNIT, albedo, lamp);
            assert!(extremes(&pass).1 < bound);
        }
        let lit = extremes(&pass);
        let mean = |pass: &SurfelPass| {
            let sum: f64 = pass.irradiances().iter().map(|e| f64::from(e.x)).sum();
            sum / f64::from(pass.statistics().alive)
        };
        let before = mean(&pass);
        let mut halves = Vec::new();
        for frame in 1..=frames {
            light_up(&mut pass, UNIT, albedo, |_, _| 0.0);
            let left = mean(&pass) / before;
            while left < 0.5f64.powi(halves.len() as i32 + 1) && halves.len() < 10 {
                halves.push(frame);
            }
        }
        let after = extremes(&pass);
        eprintln!(
            "albedo {albedo}: lit {lit:?}, mean {before}, halves at {halves:?}, after {after:?}"
        );
        assert!(after.1 < 1e-3 * lit.1, "{albedo}: {after:?} of {lit:?}");
    }
}

/// A wall z = 0 seen from a distance along a tilted axis.
fn wall_view(distance: f32, tilt: f32, width: u32, height: u32) -> (Vec<SurfelPixel>, Camera) {
    let forward = Vec3::new(-tilt.sin(), 0.0, -tilt.cos());
    let right = forward.cross(Vec3::Y);
    let camera = Camera {
        origin: forward * -distance,
        right: right * 0.5 * (width as f32 / height as f32),
        up: Vec3::Y * 0.5,
        forward,
        inverse_resolution: Vec2::new(1.0 / width as f32, 1.0 / height as f32),
    };
    let pixels = (0..width * height)
        .map(|i| {
            let at = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let ray = camera_ray(at, camera);
            let t = -ray.origin.z / ray.direction.z;
            SurfelPixel {
                position: ray.origin + ray.direction * t,
                normal: Vec3::Z,
                mesh: 0,
            }
        })
        .collect();
    (pixels, camera)
}

fn plane_grid(cell: f32) -> SurfelGrid {
    SurfelGrid {
        origin: Vec3::ZERO,
        inverse_cell: 1.0 / cell,
        size: UVec3::ZERO,
        slots: 4093,
        inverse_reach: 0.0,
    }
}

fn look(pass: &mut SurfelPass, pixels: &[SurfelPixel], width: u32, camera: Camera) -> u32 {
    let view = SurfelView {
        pixels,
        width,
        camera,
    };
    pass.frame(view, |_, _| None, |_| Vec3::ZERO).spawned
}

#[test]
fn spawns_follow_the_stated_chance() {
    // Tilted, so that tiles see areas of different size; the last column and
    // row of tiles are cut.
    let (width, height, frames) = (100, 56, 10_000);
    let (pixels, camera) = wall_view(2.0, 0.5, width, height);
    let nothing = vec![
        SurfelPixel {
            position: Vec3::ZERO,
            normal: Vec3::ZERO,
            mesh: 0,
        };
        (width * height) as usize
    ];
    let settings = SurfelSettings {
        rate: 0.05,
        radius: 0.125,
        patience: 0,
        ..SurfelSettings::default()
    };
    let across = width.div_ceil(16);
    let tiles = (across * height.div_ceil(16)) as usize;
    let mut counts = vec![0u32; tiles];
    let mut pass = SurfelPass::new(settings, plane_grid(0.5), 1000, 10_000);
    for _ in 0..frames {
        look(&mut pass, &pixels, width, camera);
        for surfel in pass.surfels().iter().filter(|s| surfel_sound(**s) == 1) {
            let at = pixels
                .iter()
                .position(|p| p.position == surfel.position)
                .expect("on a pixel") as u32;
            counts[(at / width / 16 * across + at % width / 16) as usize] += 1;
        }
        // Two frames that see nothing: whoever is there goes.
        look(&mut pass, &nothing, width, camera);
        look(&mut pass, &nothing, width, camera);
        assert_eq!(pass.statistics().alive, 0);
    }
    // The area on the wall that the tile's first pixel sees, by its corners
    // in double precision; all coverages are 0, so that pixel is the key.
    let on_wall = |x: f64, y: f64| {
        let (right, up) = (camera.right.as_dvec3(), camera.up.as_dvec3());
        let to = right * (2.0 * x / f64::from(width) - 1.0)
            + up * (1.0 - 2.0 * y / f64::from(height))
            + camera.forward.as_dvec3();
        let origin = camera.origin.as_dvec3();
        origin - to * (origin.z / to.z)
    };
    let mut chi = 0.0;
    let mut chances = Vec::new();
    for (tile, count) in counts.iter().enumerate() {
        let (left, top) = (tile as u32 % across * 16, tile as u32 / across * 16);
        let (x, y) = (f64::from(left), f64::from(top));
        let (a, b) = (on_wall(x + 1.0, y), on_wall(x, y + 1.0));
        let (c, d) = (on_wall(x, y), on_wall(x + 1.0, y + 1.0));
        let area = 0.5 * (d - c).cross(a - b).length();
        let pixels = f64::from((width - left).min(16) * (height - top).min(16));
        let disc = std::f64::consts::PI * 0.125 * 0.125;
        let chance = (0.8 * area * pixels / disc * 0.05).min(1.0);
        let (n, k) = (f64::from(frames), f64::from(*count));
        if chance == 1.0 {
            assert_eq!(*count, frames);
            continue;
        }
        chances.push(chance);
        chi += (k - n * chance).powi(2) / (n * chance * (1.0 - chance));
    }
    let low = chances.iter().copied().fold(1.0, f64::min);
    let high = chances.iter().copied().fold(0.0, f64::max);
    // Mean of the distribution, and four and a half of its deviations.
    let freedom = chances.len() as f64;
    let limit = 4.5 * (2.0 * freedom).sqrt();
    eprintln!("{freedom} tiles with chances {low:.4} to {high:.4}: chi-square {chi:.1}");
    assert!(
        high > 4.0 * low && (chi - freedom).abs() < limit,
        "{chi} of {freedom}"
    );
}

#[test]
fn no_flood_close_to_a_wall() {
    let settings = SurfelSettings {
        rate: 1.0,
        ..SurfelSettings::default()
    };
    // 0.8 of coverage take 0.8/(0.3 pi r^2) surfels a square metre if they are
    // spread evenly, and up to three times as many for every pixel to have it.
    for distance in [0.05f32, 0.5, 5.0] {
        let (width, height) = (320, 180);
        let (pixels, camera) = wall_view(distance, 0.0, width, height);
        let mut pass = SurfelPass::new(settings, plane_grid(0.25), 20_000, 400_000);
        let mut worst = 0;
        for _ in 0..100 {
            worst = look(&mut pass, &pixels, width, camera).max(worst);
        }
        let alive = pass.statistics().alive;
        let area = distance * distance * 640.0 / 360.0;
        let most = 4 + (3.0 * 0.8 * area / (0.3 * PI * 0.01)) as u32;
        eprintln!("{distance} m: {alive} surfels for {area:.4} m2, {worst} in a frame");
        assert!(alive > 0 && alive <= most, "{distance}: {alive}");
        // Once covered, no more.
        let mut more = 0;
        for _ in 0..100 {
            more += look(&mut pass, &pixels, width, camera);
        }
        assert!(
            more * 10 <= alive.max(20),
            "{distance}: {more} after {alive}"
        );
    }
}

#[test]
fn a_full_pool_drops_and_goes_on() {
    let views: Vec<_> = (0..6).map(|i| UNIT.view(i, 128)).collect();
    for (capacity, entries) in [(0, 1000), (1, 1000), (100, 100_000), (400, 0), (400, 1500)] {
        let settings = settings(1.0);
        let mut pass = SurfelPass::new(settings, grid(UNIT), capacity, entries);
        let (mut dropped, mut lists) = (0, 0);
        for frame in 0..300 {
            let (pixels, camera) = &views[frame % 6];
            let view = SurfelView {
                pixels,
                width: 128,
                camera: *camera,
            };
            let found = pass.frame(view, |_, _| None, |_| Vec3::ZERO);
            dropped += found.dropped;
            lists += found.entries_dropped;
            assert!(found.alive <= capacity && found.rays <= 250_000);
            let sound = pass.surfels().iter().filter(|s| surfel_sound(**s) == 1);
            assert_eq!(sound.count(), found.alive as usize);
            assert!(pass.grid().entries().len() <= entries as usize);
            // What is in view stays: a full pool gives up the unseen alone.
            if capacity == 100 && frame > 30 {
                assert!(found.alive > 0);
            }
        }
        assert!(dropped > 0 || lists > 0, "{capacity} {entries}");
        assert_eq!(lists > 0, entries < 2000 && capacity == 400);
    }
}

#[test]
fn a_camera_that_jumps_finds_its_surfels_again() {
    let far = Room {
        low: Vec3::new(900.0, -300.0, 50.0),
        size: 1.0,
    };
    let views: Vec<Vec<_>> = [UNIT, far]
        .iter()
        .map(|room| (0..6).map(|i| room.view(i, 128)).collect())
        .collect();
    // Room for one of the rooms, not for both.
    let settings = SurfelSettings {
        patience: 30,
        ..settings(1.0)
    };
    let mut pass = SurfelPass::new(settings, grid(UNIT), 800, 200_000);
    let mut recycled = 0;
    for jump in 0..8 {
        let room = [UNIT, far][jump % 2];
        for frame in 0..150 {
            let (pixels, camera) = &views[jump % 2][frame % 6];
            let view = SurfelView {
                pixels,
                width: 128,
                camera: *camera,
            };
            let found = pass.frame(
                view,
                |origin, direction| {
                    let (position, normal, _) = room.wall(origin, direction)?;
                    Some(SurfelHit {
                        position,
                        normal,
                        albedo: Vec3::splat(0.5),
                        emission: Vec3::ONE,
                    })
                },
                |_| Vec3::ZERO,
            );
            recycled += found.recycled;
            assert!(found.alive <= 800);
        }
        // What is seen now is covered and lit.
        let mut bare = 0;
        for p in views[jump % 2].iter().flat_map(|v| &v.0) {
            let light = pass.gather(p.position, p.normal);
            bare += u32::from(light.weight == 0.0);
            assert!(light.irradiance.is_finite() && light.irradiance.x <= 2.0 * PI * 1.00001);
        }
        assert!(bare < 6 * 128 * 128 / 100, "{jump}: {bare}");
    }
    assert!(recycled > 1000, "{recycled}");
}

#[test]
fn broken_pixels_spawn_nothing_and_broken_hits_light_nothing() {
    let (mut pixels, camera) = UNIT.view(0, 128);
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30];
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let b = bad[i % 4];
        match i / 4 % 5 {
            0 => pixel.normal = Vec3::ZERO,
            1 => pixel.normal = Vec3::new(b, 0.0, 0.0),
            2 => pixel.normal.y = b,
            3 => pixel.position.z = b,
            _ => pixel.position = Vec3::splat(b),
        }
    }
    let mut pass = SurfelPass::new(settings(1.0), grid(UNIT), 1000, 100_000);
    for _ in 0..50 {
        assert_eq!(look(&mut pass, &pixels, 128, camera), 0);
    }
    // Cameras that are none.
    let (good, _) = UNIT.view(0, 128);
    for b in bad {
        for member in 0..4 {
            let mut broken = camera;
            match member {
                0 => broken.origin.x = b,
                1 => broken.right.y = b,
                2 => broken.forward = Vec3::splat(b),
                _ => broken.inverse_resolution.x = b,
            }
            look(&mut pass, &good, 128, broken);
        }
    }
    for s in pass.surfels() {
        assert!(s.position.is_finite() && s.normal.is_finite() && s.radius.is_finite());
    }
    assert_eq!(look(&mut pass, &[], 0, camera), 0);
    assert_eq!(look(&mut pass, &good[..100], 128, camera), 0);
    // Surfaces whose numbers are broken.
    let mut pass = covered(UNIT, 0.125);
    for frame in 0..20 {
        pass.recycle();
        pass.build();
        pass.update(
            |origin, direction| {
                let (position, normal, wall) = UNIT.wall(origin, direction)?;
                let b = bad[frame % 4];
                let of = |w: u32, v: Vec3| if wall == w { Vec3::splat(b) } else { v };
                Some(SurfelHit {
                    position: of(0, position),
                    normal: of(1, normal),
                    albedo: of(2, Vec3::splat(0.5)),
                    emission: of(3, Vec3::ONE),
                })
            },
            |hit| {
                if hit.normal.z > 0.5 {
                    Vec3::NAN
                } else {
                    Vec3::ZERO
                }
            },
        );
        for e in pass.irradiances() {
            assert!(
                e.is_finite() && e.min_element() >= 0.0 && e.max_element() < 10.0,
                "{e}"
            );
        }
    }
    assert!(extremes(&pass).0 > 1.0);
}

#[test]
fn a_scene_of_any_scale_has_the_same_light() {
    let run = |room: Room| {
        let mut pass = covered(room, 0.125);
        for _ in 0..60 {
            light_up(&mut pass, room, 0.5, |p, wall| {
                let up = (p - room.low) / room.size;
                if wall == 3 && up.x < 0.5 { 2.0 } else { 0.1 }
            });
        }
        pass
    };
    let unit = run(UNIT);
    // By a power of two: the same bits.
    for power in [-10, 10] {
        let size = 2f32.powi(power);
        let scaled = run(Room { size, ..UNIT });
        for (a, b) in unit.surfels().iter().zip(scaled.surfels()) {
            assert_eq!(a.position * size, b.position);
        }
        assert_eq!(unit.irradiances(), scaled.irradiances());
    }
    // By a thousand: other random choices may be made, the light is the same.
    let mean = |pass: &SurfelPass| {
        let sum: f64 = pass.irradiances().iter().map(|e| f64::from(e.x)).sum();
        sum / f64::from(pass.statistics().alive)
    };
    for size in [1e-3, 1e3] {
        let scaled = run(Room { size, ..UNIT });
        let (a, b) = (mean(&unit), mean(&scaled));
        eprintln!(
            "scale {size}: {} surfels, mean {b} of {a}",
            scaled.statistics().alive
        );
        assert!((a / b - 1.0).abs() < 0.02, "{size}: {a} {b}");
    }
}

#[test]
fn a_million_lookups_in_the_worst_cell() {
    let mut pass = SurfelPass::new(settings(1.0), grid(UNIT), 20_000, 1 << 20);
    // Far more in one place than a lookup walks.
    for i in 0..20_000 {
        let off = Vec3::new((i % 100) as f32, (i / 100) as f32, 0.0) * 1e-4;
        let slot = pass.insert(Surfel {
            position: Vec3::splat(0.12) + off,
            radius: 0.1,
            normal: Vec3::Z,
            mesh: 0,
        });
        assert_eq!(slot, Some(i));
    }
    assert_eq!(pass.insert(pass.surfels()[0]), None);
    pass.build();
    let point = Vec3::new(0.125, 0.13, 0.12);
    assert!(pass.grid().list(point).y > 10 * SURFEL_WALK);
    std::thread::scope(|scope| {
        for part in 0..4u32 {
            let pass = &pass;
            scope.spawn(move || {
                for i in part * 250_000..(part + 1) * 250_000 {
                    let at = point + Vec3::X * (i as f32 * 1e-9);
                    let weight = pass.gather(at, Vec3::Z).weight;
                    assert!(weight > 1.0 && weight < SURFEL_WALK as f32);
                }
            });
        }
    });
}

/// A pool on an adapter: the passes of `gi/surfel` and `gi/surfel_grid`.
struct GpuPool<'a> {
    gpu: &'a Gpu,
    capacity: u32,
    entries: u32,
    settings: SurfelSettings,
    grid: SurfelGrid,
    /// Pass, its bind group and its pipeline.
    passes: Vec<Pass>,
    uniform: wgpu::Buffer,
    grid_uniform: wgpu::Buffer,
    pixels: wgpu::Buffer,
    surfels: wgpu::Buffer,
    unseen: wgpu::Buffer,
    free: wgpu::Buffer,
    counts: wgpu::Buffer,
    lost: wgpu::Buffer,
    first: wgpu::Buffer,
    lengths: wgpu::Buffer,
    list: wgpu::Buffer,
}

const GRID_PASSES: [&str; 4] = ["count", "sum", "scatter", "sort"];

fn words_of_surfels(surfels: &[Surfel]) -> Vec<u32> {
    surfels
        .iter()
        .flat_map(|s| {
            let (p, n) = (s.position, s.normal);
            let bits = [p.x, p.y, p.z, s.radius, n.x, n.y, n.z].map(f32::to_bits);
            bits.into_iter().chain([s.mesh])
        })
        .collect()
}

fn uniform(gpu: &Gpu, size: u64) -> wgpu::Buffer {
    gpu.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

fn words_of_grid(g: SurfelGrid) -> Vec<u32> {
    let mut words: Vec<u32> = g.origin.to_array().map(f32::to_bits).into();
    words.push(g.inverse_cell.to_bits());
    words.extend([g.size.x, g.size.y, g.size.z, g.slots]);
    words.extend([g.inverse_reach.to_bits(), 0, 0, 0]);
    words
}

fn bytes(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// Bind groups by number, and a pipeline.
type Pass = (Vec<(u32, wgpu::BindGroup)>, wgpu::ComputePipeline);

impl<'a> GpuPool<'a> {
    fn new(
        gpu: &'a Gpu,
        settings: SurfelSettings,
        grid: SurfelGrid,
        capacity: u32,
        entries: u32,
        (width, height): (u32, u32),
    ) -> Self {
        let link = |names: &[&str]| raytwin::wgsl::link(names).expect("registered");
        let pool = link(&["gi/surfel_irradiance", "gi/surfel_grid"]) + raytwin::wgsl::pass::SURFEL;
        let lists = link(&["gi/surfel_grid"])
            + raytwin::wgsl::module("gi/surfel")
                .and_then(|m| m.bindings)
                .expect("has bindings")
            + raytwin::wgsl::pass::SURFEL_GRID;
        let slots = grid.slots as usize;
        let empty = Surfel {
            position: Vec3::ZERO,
            radius: 0.0,
            normal: Vec3::Z,
            mesh: 0,
        };
        let mut made = Self {
            gpu,
            capacity,
            entries,
            settings,
            grid,
            passes: Vec::new(),
            uniform: uniform(gpu, 176),
            grid_uniform: uniform(gpu, 64),
            pixels: gpu.buffer(&vec![0; (width * height * 8) as usize]),
            surfels: gpu.buffer(&words_of_surfels(&vec![empty; capacity as usize])),
            unseen: gpu.buffer(&vec![0; capacity as usize]),
            free: gpu.buffer(&vec![0; capacity as usize + 4]),
            counts: gpu.buffer(&vec![0; slots]),
            lost: gpu.buffer(&[0; 2]),
            first: gpu.buffer(&vec![0; slots]),
            lengths: gpu.buffer(&vec![0; slots]),
            list: gpu.buffer(&vec![0; entries as usize]),
        };
        let tiles = width.div_ceil(16) * height.div_ceil(16);
        let keys = gpu.buffer(&vec![0; tiles as usize]);
        // True: read only. The uniform comes first.
        let of_pool = [
            (&made.uniform, true),
            (&made.pixels, true),
            (&made.surfels, false),
            (&made.unseen, false),
            (&made.free, false),
            (&keys, false),
            (&made.first, true),
            (&made.lengths, true),
            (&made.list, true),
        ];
        let of_lists = [
            (&made.grid_uniform, true),
            (&made.surfels, true),
            (&made.first, false),
            (&made.counts, false),
            (&made.list, false),
            (&made.lost, false),
            (&made.lengths, false),
        ];
        let mut passes = vec![made.pass(&pool, "surfel_pass_recycle", &of_pool, &[])];
        for name in GRID_PASSES {
            let name = format!("surfel_grid_pass_{name}");
            passes.push(made.pass(&lists, &name, &of_lists, &[]));
        }
        passes.push(made.pass(&pool, "surfel_pass_cover", &of_pool, &[]));
        passes.push(made.pass(&pool, "surfel_pass_spawn", &of_pool, &[]));
        made.passes = passes;
        made
    }

    /// An entry point; what its uniform and its pool are, and in group 2 the
    /// scene that it reads.
    fn pass(
        &self,
        source: &str,
        entry: &str,
        buffers: &[(&wgpu::Buffer, bool)],
        scene: &[(&wgpu::Buffer, bool)],
    ) -> Pass {
        let device = self.gpu.device();
        // Where there is no precise build, the processor's bits are not promised.
        let module = entry_module(self.gpu, entry, source, Build::Precise, entry)
            .unwrap_or_else(|e| panic!("{entry}: {e}"));
        let layout = |buffers: &[(&wgpu::Buffer, bool)], first_uniform: bool| {
            let entries: Vec<_> = (0u32..)
                .zip(buffers)
                .map(|(binding, b)| wgpu::BindGroupLayoutEntry {
                    binding,
                    visibility: wgpu::ShaderStages::COMPUTE,
                    ty: wgpu::BindingType::Buffer {
                        ty: if first_uniform && binding == 0 {
                            wgpu::BufferBindingType::Uniform
                        } else {
                            wgpu::BufferBindingType::Storage { read_only: b.1 }
                        },
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                    count: None,
                })
                .collect();
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: None,
                entries: &entries,
            })
        };
        let group = |layout: &wgpu::BindGroupLayout, buffers: &[(&wgpu::Buffer, bool)]| {
            let entries: Vec<_> = (0u32..)
                .zip(buffers)
                .map(|(binding, b)| wgpu::BindGroupEntry {
                    binding,
                    resource: b.0.as_entire_binding(),
                })
                .collect();
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout,
                entries: &entries,
            })
        };
        let of_pool = layout(buffers, true);
        let mut groups = vec![(0, group(&of_pool, buffers))];
        let mut layouts = vec![Some(&of_pool)];
        let (nothing, of_scene) = (layout(&[], false), layout(scene, false));
        if !scene.is_empty() {
            groups.push((1, group(&nothing, &[])));
            groups.push((2, group(&of_scene, scene)));
            layouts.extend([Some(&nothing), Some(&of_scene)]);
        }
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &layouts,
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            cache: None,
        });
        (groups, pipeline)
    }

    /// One frame; free slots at its start, recycled, spawned, dropped.
    fn frame(&self, frame: u32, view: SurfelView<'_>) -> Vec<u32> {
        let queue = self.gpu.queue();
        let (g, c, s) = (self.grid, view.camera, self.settings);
        let vector = |v: Vec3| [v.x.to_bits(), v.y.to_bits(), v.z.to_bits()];
        let mut lists = words_of_grid(g);
        let height = view.pixels.len() as u32 / view.width;
        let mut words = Vec::new();
        for v in [c.origin, c.right, c.up, c.forward] {
            words.extend(vector(v));
            words.push(0);
        }
        words.extend(c.inverse_resolution.to_array().map(f32::to_bits));
        words.extend([0, 0]);
        words.extend(&lists);
        words.extend([view.width, height, frame, self.capacity]);
        let numbers = [s.target_coverage, s.rate, s.radius, s.radius_per_depth];
        words.extend(numbers.map(f32::to_bits));
        words.extend([s.patience, 0, 0, 0]);
        lists.extend([self.capacity, self.entries, 0, 0]);
        queue.write_buffer(&self.uniform, 0, &bytes(&words));
        queue.write_buffer(&self.grid_uniform, 0, &bytes(&lists));
        let pixels: Vec<u32> = view
            .pixels
            .iter()
            .flat_map(|p| {
                let (a, b) = (vector(p.position), vector(p.normal));
                [a[0], a[1], a[2], p.mesh, b[0], b[1], b[2], 0]
            })
            .collect();
        queue.write_buffer(&self.pixels, 0, &bytes(&pixels));
        let mut encoder = self
            .gpu
            .device()
            .create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.counts, 0, None);
        encoder.clear_buffer(&self.lost, 0, None);
        let each = self.capacity.div_ceil(64);
        let groups = [
            (1, 1),
            (each, 1),
            (1, 1),
            (each, 1),
            (g.slots.div_ceil(64), 1),
            (view.width.div_ceil(16), height.div_ceil(16)),
            (1, 1),
        ];
        dispatch(&mut encoder, &self.passes, &groups);
        queue.submit([encoder.finish()]);
        self.gpu.read(&self.free, 4)
    }
}

fn dispatch(encoder: &mut wgpu::CommandEncoder, passes: &[Pass], groups: &[(u32, u32)]) {
    for ((bound, pipeline), (x, y)) in passes.iter().zip(groups) {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(pipeline);
        for (at, group) in bound {
            pass.set_bind_group(*at, group, &[]);
        }
        pass.dispatch_workgroups(*x, *y, 1);
    }
}

/// The light of a pool: the passes of `gi/surfel_irradiance`, which trace rays
/// through `ray/bvh`.
struct GpuLight {
    passes: Vec<Pass>,
    uniform: wgpu::Buffer,
    irradiances: wgpu::Buffer,
}

impl GpuLight {
    /// In the hall, or without a tree in the bare room.
    fn new(pool: &GpuPool<'_>, tree: Option<&Bvh>) -> Self {
        let gpu = pool.gpu;
        let mut modules = vec![
            "gi/surfel_irradiance",
            "gi/surfel_grid",
            "temporal/multiscale_mean",
        ];
        if tree.is_some() {
            modules.push("ray/bvh");
        }
        let mut source = raytwin::wgsl::link(&modules).expect("registered");
        if tree.is_some() {
            let module = raytwin::wgsl::module("ray/bvh");
            source += module.and_then(|m| m.bindings).expect("has bindings");
        }
        source += raytwin::wgsl::pass::SURFEL_IRRADIANCE;
        source += LAMP_WGSL;
        source += if tree.is_some() { HALL_WGSL } else { BARE_WGSL };
        let capacity = pool.capacity as usize;
        let uniform = uniform(gpu, 80);
        let lights = gpu.buffer(&vec![0; capacity * 24]);
        let irradiances = gpu.buffer(&vec![0; capacity * 4]);
        let words = tree.map(|t| [t.node_words(), t.triangle_words()]);
        let scene_buffers = words.map(|w| w.map(|words| gpu.buffer(&words)));
        let buffers = [
            (&uniform, true),
            (&pool.surfels, true),
            (&pool.free, true),
            (&lights, false),
            (&irradiances, false),
            (&pool.first, true),
            (&pool.lengths, true),
            (&pool.list, true),
        ];
        let scene: Vec<_> = scene_buffers.iter().flatten().map(|b| (b, true)).collect();
        let passes = ["begin", "share", "trace", "end"].map(|name| {
            let entry = format!("surfel_irradiance_pass_{name}");
            pool.pass(&source, &entry, &buffers, &scene)
        });
        Self {
            passes: passes.into(),
            uniform,
            irradiances,
        }
    }

    /// The light of a frame, after the pool's.
    fn frame(&self, pool: &GpuPool<'_>, frame: u32) -> Vec<u32> {
        let s = pool.settings;
        let mut words = words_of_grid(pool.grid);
        words.extend([pool.capacity, frame, s.rays, s.budget]);
        words.extend([s.longest.to_bits(), 0, 0, 0]);
        let queue = pool.gpu.queue();
        queue.write_buffer(&self.uniform, 0, &bytes(&words));
        let mut encoder = pool
            .gpu
            .device()
            .create_command_encoder(&Default::default());
        let each = pool.capacity.div_ceil(64);
        dispatch(
            &mut encoder,
            &self.passes,
            &[(each, 1), (1, 1), (each, 1), (each, 1)],
        );
        queue.submit([encoder.finish()]);
        pool.gpu.read(&self.irradiances, pool.capacity as usize * 4)
    }
}

/// The room's six walls and a block in it, two triangles a face.
fn hall() -> Bvh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let boxes = [
        (Vec3::ZERO, Vec3::ONE),
        (Vec3::new(0.375, 0.125, 0.375), Vec3::new(0.625, 0.25, 0.75)),
    ];
    for (low, high) in boxes {
        for face in 0..6 {
            let (axis, side) = (face / 2, face % 2);
            let base = positions.len() as u32;
            for corner in 0..4 {
                let mut at = if side == 0 { low } else { high };
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                at[u] = if corner & 1 == 0 { low[u] } else { high[u] };
                at[v] = if corner & 2 == 0 { low[v] } else { high[v] };
                positions.push(at);
            }
            triangles.push([base, base + 1, base + 2]);
            triangles.push([base + 1, base + 3, base + 2]);
        }
    }
    Bvh::build(&positions, &triangles, BuildQuality::Medium).expect("a mesh")
}

const LAMP: Vec3 = Vec3::new(0.5, 0.875, 0.25);

fn hall_trace(tree: &Bvh, origin: Vec3, direction: Vec3) -> Option<SurfelHit> {
    let ray = Ray {
        origin,
        direction,
        t_min: 0.0,
        t_max: 100.0,
    };
    let hit = bvh_closest(&tree.view(), ray);
    if hit.primitive == BVH_MISS {
        return None;
    }
    let face = hit.primitive / 2 % 6;
    let inward = face.is_multiple_of(2) == (hit.primitive < 12);
    let mut normal = Vec3::ZERO;
    normal[face as usize / 2] = if inward { 1.0 } else { -1.0 };
    let glow = if hit.primitive == 6 { 0.25 } else { 0.0 };
    Some(SurfelHit {
        position: origin + direction * hit.t,
        normal,
        albedo: Vec3::new(0.5 + 0.0625 * face as f32, 0.5, 0.75),
        emission: Vec3::new(glow, glow, 0.0),
    })
}

fn hall_direct(tree: &Bvh, hit: &SurfelHit) -> Vec3 {
    let shadow = Ray {
        origin: hit.position + hit.normal * 0.0009765625,
        direction: LAMP - hit.position,
        t_min: 0.0,
        t_max: 1.0,
    };
    if bvh_any(&tree.view(), shadow) == 1 {
        return Vec3::ZERO;
    }
    bare_direct(hit)
}

/// What a ray meets in the bare room.
fn bare_trace(origin: Vec3, direction: Vec3) -> Option<SurfelHit> {
    let mut t = 100.0;
    let mut normal = Vec3::ZERO;
    for axis in 0..3 {
        let forward = direction[axis] > 0.0;
        let wall = if forward { 1.0 } else { 0.0 };
        if direction[axis] != 0.0 {
            let away = (wall - origin[axis]) / direction[axis];
            if away < t {
                t = away;
                normal = Vec3::ZERO;
                normal[axis] = if forward { -1.0 } else { 1.0 };
            }
        }
    }
    let glow = if normal.y > 0.5 { 0.25 } else { 0.0 };
    Some(SurfelHit {
        position: origin + direction * t,
        normal,
        albedo: Vec3::new(0.5625, 0.5, 0.75),
        emission: Vec3::new(glow, glow, 0.0),
    })
}

/// The lamp's light there: nothing is in its way.
fn bare_direct(hit: &SurfelHit) -> Vec3 {
    let to = LAMP - hit.position;
    let cosine = vec3_dot(to, hit.normal);
    if cosine <= 0.0 {
        return Vec3::ZERO;
    }
    let squared = vec3_dot(to, to);
    Vec3::splat(cosine / (squared * squared.sqrt()))
}

/// The lamp for an adapter.
const LAMP_WGSL: &str = "
fn lamp(hit: SurfelIrradianceHit) -> vec3f {
    let to = vec3f(0.5, 0.875, 0.25) - hit.position;
    let cosine = vec3_dot(to, hit.normal);
    if cosine <= 0.0 {
        return vec3f(0.0, 0.0, 0.0);
    }
    let squared = vec3_dot(to, to);
    return vec3f(cosine / (squared * sqrt(squared)));
}
";

/// The same for an adapter.
const BARE_WGSL: &str = "
fn surfel_irradiance_trace(origin: vec3f, direction: vec3f) -> SurfelIrradianceHit {
    var t = 100.0;
    var normal = vec3f(0.0, 0.0, 0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        let forward = direction[axis] > 0.0;
        let wall = select(0.0, 1.0, forward);
        if direction[axis] != 0.0 {
            let away = (wall - origin[axis]) / direction[axis];
            if away < t {
                t = away;
                normal = vec3f(0.0, 0.0, 0.0);
                normal[axis] = select(1.0, -1.0, forward);
            }
        }
    }
    let glow = select(0.0, 0.25, normal.y > 0.5);
    return SurfelIrradianceHit(
        origin + direction * t,
        1u,
        normal,
        vec3f(0.5625, 0.5, 0.75),
        vec3f(glow, glow, 0.0),
    );
}

fn surfel_irradiance_direct(hit: SurfelIrradianceHit) -> vec3f {
    return lamp(hit);
}
";

/// The hall for an adapter.
const HALL_WGSL: &str = "
fn surfel_irradiance_trace(origin: vec3f, direction: vec3f) -> SurfelIrradianceHit {
    let hit = bvh_closest(Ray(origin, direction, 0.0, 100.0));
    if hit.primitive == BVH_MISS {
        let zero = vec3f(0.0, 0.0, 0.0);
        return SurfelIrradianceHit(zero, 0u, zero, zero, zero);
    }
    let face = (hit.primitive / 2u) % 6u;
    let inward = (face % 2u == 0u) == (hit.primitive < 12u);
    let side = select(-1.0, 1.0, inward);
    let axis = face / 2u;
    let normal = vec3f(
        select(0.0, side, axis == 0u),
        select(0.0, side, axis == 1u),
        select(0.0, side, axis == 2u),
    );
    let glow = select(0.0, 0.25, hit.primitive == 6u);
    return SurfelIrradianceHit(
        origin + direction * hit.t,
        1u,
        normal,
        vec3f(0.5 + 0.0625 * f32(face), 0.5, 0.75),
        vec3f(glow, glow, 0.0),
    );
}

fn surfel_irradiance_direct(hit: SurfelIrradianceHit) -> vec3f {
    let to = vec3f(0.5, 0.875, 0.25) - hit.position;
    let shadow = Ray(hit.position + hit.normal * 0.0009765625, to, 0.0, 1.0);
    if bvh_any(shadow) == 1u {
        return vec3f(0.0, 0.0, 0.0);
    }
    return lamp(hit);
}
";

/// A camera that flies through the room and turns; some of what it sees is no
/// surface, some is broken.
fn flight(frame: u32) -> (Vec<SurfelPixel>, Camera) {
    let t = frame as f32 * 0.11;
    let forward = Vec3::new(t.cos(), 0.3 * (1.7 * t).sin(), t.sin()).normalize();
    let right = forward.cross(Vec3::Y).normalize();
    let (width, height) = FLIGHT;
    let camera = Camera {
        origin: Vec3::new(0.5, 0.4, 0.5) + Vec3::new(t.sin(), 0.3 * t.cos(), t.cos()) * 0.3,
        right: right * 0.9,
        up: right.cross(forward) * 0.5,
        forward,
        inverse_resolution: Vec2::new(1.0 / width as f32, 1.0 / height as f32),
    };
    let pixels = (0..width * height)
        .map(|i| {
            let at = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let ray = camera_ray(at, camera);
            let wall = UNIT.wall(ray.origin, ray.direction);
            let (position, normal, mesh) = wall.expect("a closed room");
            let odd = match i % 97 {
                0 => Vec3::ZERO,
                1 => Vec3::splat(f32::NAN),
                _ => normal,
            };
            SurfelPixel {
                position,
                normal: odd,
                mesh,
            }
        })
        .collect();
    (pixels, camera)
}

/// Not whole tiles.
const FLIGHT: (u32, u32) = (150, 90);

#[test]
fn an_adapter_has_the_same_surfels_after_64_frames() {
    for gpu in adapters()
        .expect("an adapter")
        .iter()
        .filter(|g| g.has_precise())
    {
        // Room for all; and too little, so that surfels are given up and dropped.
        for (capacity, patience) in [(2000, 60_000), (2000, 6), (60, 20)] {
            let settings = SurfelSettings {
                patience,
                ..settings(1.0)
            };
            let entries = 60_000;
            let mut cpu = SurfelPass::new(settings, grid(UNIT), capacity, entries);
            cpu.settings_mut().budget = 0;
            let pool = GpuPool::new(gpu, settings, grid(UNIT), capacity, entries, FLIGHT);
            let mut total = [0; 3];
            for frame in 0..64 {
                let (pixels, camera) = flight(frame);
                let view = SurfelView {
                    pixels: &pixels,
                    width: FLIGHT.0,
                    camera,
                };
                let s = cpu.frame(view, |_, _| None, |_| Vec3::ZERO);
                let counts = pool.frame(frame, view);
                let label = format!("{}, {capacity}, {patience}, frame {frame}", gpu.label());
                let ours = [s.recycled, s.spawned, s.dropped];
                assert_eq!(&counts[1..], ours, "{label}");
                for (sum, count) in total.iter_mut().zip(ours) {
                    *sum += count;
                }
            }
            let words = gpu.read(&pool.surfels, capacity as usize * 8);
            assert_eq!(words, words_of_surfels(cpu.surfels()), "{}", gpu.label());
            let unseen = gpu.read(&pool.unseen, capacity as usize);
            assert_eq!(unseen, cpu.unseen(), "{}", gpu.label());
            let alive = cpu.statistics().alive;
            eprintln!("{capacity} slots: {alive} alive; recycled, spawned, dropped {total:?}");
            assert!(alive > 30 && total[1] >= alive);
            assert_eq!(
                (total[0] > 0, total[2] > 0),
                (patience < 100, capacity == 60)
            );
        }
    }
}

#[test]
fn an_adapter_has_the_same_light_after_64_frames() {
    let tree = hall();
    for gpu in adapters()
        .expect("an adapter")
        .iter()
        .filter(|g| g.has_precise())
    {
        // SwiftShader compiles two walks of a tree in one program for longer than
        // ten minutes: it has a room whose walls are found without one.
        let bare = gpu.label().contains("SwiftShader");
        let tree = (!bare).then_some(&tree);
        if bare {
            eprintln!("{}: the bare room, not the hall", gpu.label());
        }
        // Rays for all; a budget that is shared out; slots that change hands.
        for (capacity, patience, budget) in [
            (2000, 60_000, 250_000),
            (2000, 60_000, 300),
            (60, 20, u32::MAX),
        ] {
            let settings = SurfelSettings {
                patience,
                budget,
                ..settings(1.0)
            };
            let entries = 60_000;
            let mut cpu = SurfelPass::new(settings, grid(UNIT), capacity, entries);
            let pool = GpuPool::new(gpu, settings, grid(UNIT), capacity, entries, FLIGHT);
            let light = GpuLight::new(&pool, tree);
            let (mut total, mut scarce) = (SurfelStatistics::default(), 0);
            for frame in 0..64 {
                let (pixels, camera) = flight(frame);
                let view = SurfelView {
                    pixels: &pixels,
                    width: FLIGHT.0,
                    camera,
                };
                let trace = |origin, direction| match tree {
                    Some(tree) => hall_trace(tree, origin, direction),
                    None => bare_trace(origin, direction),
                };
                let s = cpu.frame(view, trace, |hit| match tree {
                    Some(tree) => hall_direct(tree, hit),
                    None => bare_direct(hit),
                });
                total.rays += s.rays;
                total.recycled += s.recycled;
                scarce += u32::from(s.rays == budget);
                pool.frame(frame, view);
                let words = light.frame(&pool, frame);
                let label = format!("{}, {capacity}, {budget}, frame {frame}", gpu.label());
                let slots = words.chunks(4).zip(cpu.irradiances()).zip(cpu.surfels());
                for (slot, ((found, expected), surfel)) in slots.enumerate() {
                    if surfel.radius > 0.0 {
                        let bits = expected.to_array().map(f32::to_bits);
                        assert_eq!(found[..3], bits, "{label}, slot {slot}");
                    }
                }
            }
            let lit = cpu
                .surfels()
                .iter()
                .zip(cpu.irradiances())
                .filter(|(s, e)| s.radius > 0.0 && e.min_element() > 0.0)
                .count();
            let alive = cpu.statistics().alive as usize;
            eprintln!("{capacity} slots, {budget} rays: {lit} of {alive} lit, {total:?}");
            assert!(lit > alive / 2 && alive > 30);
            assert_eq!(total.recycled > 0, capacity == 60);
            assert_eq!(scarce > 0, budget == 300);
        }
    }
}
