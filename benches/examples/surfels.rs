//! What each step of a surfel frame costs, from 10,000 surfels to a million at
//! equal density.
//!
//! `RAYON_NUM_THREADS=1 cargo run --release -p raytwin-bench --example surfels -- [--sorted] [--rounds N] [COUNT…]`

use std::hint::black_box;
use std::time::Instant;

use glam::{UVec3, Vec2, Vec3};
use raytwin_cpu::gi::surfel::Surfel;
use raytwin_cpu::gi::surfel_grid::SurfelGrid;
use raytwin_cpu::pass::surfel::{SurfelHit, SurfelPass, SurfelPixel, SurfelSettings, SurfelView};
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_cpu::ray::camera::{Camera, camera_ray};

const RADIUS: f32 = 0.1;
/// Height of the room.
const HEIGHT: f32 = 2.0;
/// Surfels a square metre: three times what covers by 0.8 when spread evenly.
const DENSITY: f32 = 255.0;
const LOOKUPS: u32 = 200_000;
const VIEW: (u32, u32) = (960, 540);

/// Median of the rounds, in seconds.
fn median(rounds: usize, mut work: impl FnMut() -> f64) -> f64 {
    let mut times: Vec<f64> = (0..rounds).map(|_| work()).collect();
    times.sort_by(f64::total_cmp);
    times[rounds / 2]
}

fn timed<T>(work: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    black_box(work());
    start.elapsed().as_secs_f64()
}

fn random(i: u32) -> f32 {
    pcg_unit(pcg_hash(i))
}

/// Floor and ceiling of a hall that `count` surfels cover, in random places.
fn hall(count: u32) -> (f32, SurfelSettings, SurfelGrid) {
    let side = (count as f32 / (2.0 * DENSITY)).sqrt();
    let settings = SurfelSettings {
        radius: RADIUS,
        rays: 1,
        budget: u32::MAX,
        rate: 1.0,
        ..SurfelSettings::default()
    };
    let grid = SurfelGrid {
        origin: Vec3::new(0.0, -1.05, 0.0),
        inverse_cell: 0.5 / RADIUS,
        size: UVec3::ZERO,
        slots: (count / 3).max(64),
        inverse_reach: 0.0,
    };
    (side, settings, grid)
}

/// Bits of a coordinate, every second one.
fn spread(x: u32) -> u64 {
    (0..16).map(|b| u64::from(x >> b & 1) << (2 * b)).sum()
}

/// `sorted`: neighbours in the hall are neighbours in the pool. Else slots are
/// in random places, as after many frames of spawning here and there.
fn filled(count: u32, sorted: bool) -> (f32, SurfelPass) {
    let (side, settings, grid) = hall(count);
    // A third of the pool free: a full one would give up who is not seen.
    let capacity = count + count / 2;
    let mut pass = SurfelPass::new(settings, grid, capacity, count.saturating_mul(24));
    let mut places: Vec<_> = (0..count)
        .map(|i| Vec2::new(random(2 * i), random(2 * i + 1)))
        .collect();
    if sorted {
        places.sort_by_key(|p| {
            let cell = *p * 65_536.0;
            spread(cell.x as u32) | spread(cell.y as u32) << 1
        });
    }
    for (i, place) in places.into_iter().enumerate() {
        let up = i % 2 == 0;
        let surfel = Surfel {
            position: Vec3::new(
                place.x * side,
                if up { 0.0 } else { HEIGHT },
                place.y * side,
            ),
            radius: RADIUS,
            normal: if up { Vec3::Y } else { Vec3::NEG_Y },
            mesh: u32::from(up),
        };
        assert!(pass.insert(surfel).is_some());
    }
    (side, pass)
}

/// A view of the floor from the ceiling, straight down.
fn view(side: f32) -> (Vec<SurfelPixel>, Camera) {
    let (width, height) = VIEW;
    let camera = Camera {
        origin: Vec3::new(side * 0.5, HEIGHT, side * 0.5),
        right: Vec3::X * 0.8,
        up: Vec3::Z * 0.45,
        forward: Vec3::NEG_Y,
        inverse_resolution: Vec2::new(1.0 / width as f32, 1.0 / height as f32),
    };
    let pixels = (0..width * height)
        .map(|i| {
            let at = Vec2::new((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let ray = camera_ray(at, camera);
            SurfelPixel {
                position: ray.origin + ray.direction * (-HEIGHT / ray.direction.y),
                normal: Vec3::Y,
                mesh: 1,
            }
        })
        .collect();
    (pixels, camera)
}

/// The other plane, mirrored into the hall at its sides; the cheapest of traces.
fn trace(side: f32, origin: Vec3, direction: Vec3) -> Option<SurfelHit> {
    let plane = if direction.y > 0.0 { HEIGHT } else { 0.0 };
    let t = (plane - origin.y) / direction.y;
    let p = origin + direction * t;
    let fold = |x: f32| {
        let x = x.rem_euclid(2.0 * side);
        if x > side { 2.0 * side - x } else { x }
    };
    t.is_finite().then(|| SurfelHit {
        position: Vec3::new(fold(p.x), plane, fold(p.z)),
        normal: Vec3::new(0.0, -direction.y.signum(), 0.0),
        albedo: Vec3::splat(0.5),
        emission: Vec3::ONE,
    })
}

fn main() {
    let mut counts = Vec::new();
    let mut rounds = 5;
    let mut sorted = false;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        if arg == "--sorted" {
            sorted = true;
        } else if arg == "--rounds" {
            rounds = args.next().and_then(|v| v.parse().ok()).expect("a number");
        } else {
            counts.push(arg.parse().expect("a count of surfels"));
        }
    }
    if counts.is_empty() {
        counts = vec![10_000, 50_000, 250_000, 1_000_000];
    }
    println!(
        "| surfels | recycle ns | grid build ns | update ns | list | gather near ns | \
         gather anywhere ns | gather many ns | cover ns/pixel | spawn ns/tile |"
    );
    println!("| ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |");
    let order = if sorted { "sorted" } else { "random" };
    for count in counts {
        let (side, mut pass) = filled(count, sorted);
        let recycle = median(rounds, || timed(|| pass.recycle()));
        let build = median(rounds, || timed(|| pass.build()));
        let lost = pass.statistics();
        assert_eq!((lost.entries_dropped, lost.homeless), (0, 0));
        let update = median(rounds, || {
            timed(|| pass.update(|o, d| trace(side, o, d), |_| Vec3::ZERO))
        });
        assert_eq!(pass.statistics().rays, count);
        // Points in a patch of a square metre, as pixels of a tile are, and
        // points anywhere, as hits of bounced rays are.
        let lookups = |width: f32| {
            let mut sum = 0.0;
            let mut entries = 0u64;
            let time = median(rounds, || {
                timed(|| {
                    for i in 0..LOOKUPS {
                        let at = Vec2::new(random(2 * i), random(2 * i + 1)) - 0.5;
                        let point = Vec3::new(at.x * width, 0.0, at.y * width)
                            + Vec3::new(side, 0.0, side) * 0.5;
                        sum += pass.gather(point, Vec3::Y).weight;
                        entries += u64::from(pass.grid().list(point).y);
                    }
                    sum
                })
            });
            let list = entries as f64 / (f64::from(LOOKUPS) * rounds as f64);
            (time / f64::from(LOOKUPS), list)
        };
        let (near, list) = lookups(1.0);
        let (far, _) = lookups(side - 2.0 * RADIUS);
        let anywhere: Vec<_> = (0..LOOKUPS)
            .map(|i| {
                let at = Vec2::new(random(2 * i), random(2 * i + 1)) * side;
                (Vec3::new(at.x, 0.0, at.y), Vec3::Y)
            })
            .collect();
        let many = median(rounds, || timed(|| pass.gather_many(&anywhere)));
        let (pixels, camera) = view(side);
        let seen = SurfelView {
            pixels: &pixels,
            width: VIEW.0,
            camera,
        };
        let cover = median(rounds, || timed(|| pass.cover(seen)));
        // Tiles whose pixels are all bare.
        let (_, settings, grid) = hall(count);
        let mut bare = SurfelPass::new(settings, grid, count, count);
        bare.cover(seen);
        let spawn = median(rounds, || timed(|| bare.spawn(seen)));
        let tiles = f64::from(VIEW.0.div_ceil(16) * VIEW.1.div_ceil(16));
        let each = 1e9 / f64::from(count);
        println!(
            "| {count} {order} | {:.1} | {:.0} | {:.0} | {list:.1} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} |",
            recycle * each,
            build * each,
            update * each,
            near * 1e9,
            far * 1e9,
            many * 1e9 / f64::from(LOOKUPS),
            cover * 1e9 / pixels.len() as f64,
            spawn * 1e9 / tiles,
        );
    }
}
