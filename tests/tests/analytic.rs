//! Scenes whose filtered picture is known in closed form, through the whole
//! chain: reprojection, accumulation, clamp, SVGF.

use glam::{UVec2, Vec2, Vec3};
use raytwin::filter::svgf::{SvgfSettings, SvgfSurface};
use raytwin::pass::svgf::SvgfPass;
use raytwin::random::halton::halton_radical_inverse;
use raytwin::random::pcg::{pcg_next, pcg_unit};
use raytwin::temporal::accumulate::{
    TEMPORAL_ACCUMULATE_EMPTY, TemporalAccumulateState, temporal_accumulate_step,
};
use raytwin::temporal::reproject::{
    REPROJECT_TOLERANCE, ReprojectHistory, ReprojectSurface, ReprojectTaps, reproject_find,
    reproject_footprint, reproject_gather,
};
use raytwin::temporal::variance_clamp::variance_clamp_pixel;

fn numbers(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        let next = pcg_next(state);
        state = next.state;
        pcg_unit(next.value)
    }
}

fn every(size: UVec2) -> impl Iterator<Item = UVec2> {
    (0..size.element_product()).map(move |i| UVec2::new(i % size.x, i / size.x))
}

fn index(at: UVec2, size: UVec2) -> usize {
    (at.y * size.x + at.x) as usize
}

/// A history of one number a pixel, and what each pixel saw.
struct Film {
    size: UVec2,
    states: Vec<TemporalAccumulateState>,
    surfaces: Vec<ReprojectSurface>,
}

impl Film {
    fn new(size: UVec2) -> Self {
        Self {
            size,
            states: vec![TEMPORAL_ACCUMULATE_EMPTY; size.element_product() as usize],
            surfaces: Vec::new(),
        }
    }

    /// One frame: the surface of a pixel, its motion, its sample. The surfaces
    /// move as the motion says, so that each is expected where it is now.
    fn step(
        &mut self,
        cap: f32,
        tested: bool,
        surface: impl Fn(UVec2) -> (ReprojectSurface, ReprojectSurface, Vec2),
        sample: impl Fn(UVec2) -> f32,
    ) {
        let size = self.size;
        let mut states = Vec::new();
        let mut surfaces = Vec::new();
        for at in every(size) {
            let (now, expected, motion) = surface(at);
            surfaces.push(now);
            let taps: ReprojectTaps = if self.surfaces.is_empty() {
                reproject_footprint(at, UVec2::ZERO, motion)
            } else if tested {
                reproject_find(at, size, motion, expected, 0.0, REPROJECT_TOLERANCE, |at| {
                    self.surfaces[index(at, size)]
                })
            } else {
                reproject_footprint(at, size, motion)
            };
            let known: ReprojectHistory<Vec2> = reproject_gather(taps, |at| {
                let s = self.states[index(at, size)];
                ReprojectHistory {
                    value: Vec2::new(s.mean, s.variance),
                    length: s.history,
                }
            });
            let state = TemporalAccumulateState {
                mean: known.value.x,
                variance: known.value.y,
                history: known.length,
            };
            states.push(temporal_accumulate_step(state, sample(at), cap));
        }
        self.states = states;
        self.surfaces = surfaces;
    }
}

fn plane(x: f32, y: f32, z: f32, mesh: u32) -> ReprojectSurface {
    ReprojectSurface {
        position: Vec3::new(x, y, z),
        depth: 10.0 + z,
        normal: Vec3::NEG_Z,
        mesh,
    }
}

/// A bright bar moves over a dark wall: what the bar uncovers is dark at once,
/// and its history is no longer than that of the wall beside it.
#[test]
fn a_moving_step_edge_leaves_no_trail() {
    let size = UVec2::new(72, 6);
    for speed in [0.25f32, 1.0, 3.7] {
        let frames = (40.0 / speed.max(1.0)) as u32;
        let bar = |frame: u32, x: f32| {
            let left = 4.3 + speed * frame as f32;
            (left..left + 16.0).contains(&x)
        };
        let run = |tested: bool| {
            let mut film = Film::new(size);
            let mut trail = 0.0f32;
            for frame in 0..frames {
                let before: Vec<f32> = film.states.iter().map(|s| s.history).collect();
                let is_bar = |at: UVec2| bar(frame, at.x as f32 + 0.5);
                film.step(
                    32.0,
                    tested,
                    |at| {
                        let (x, y) = (at.x as f32, at.y as f32);
                        if is_bar(at) {
                            // Where on the bar: it takes its positions along.
                            let now = plane(x, y, -2.0, 1);
                            let then = plane(x - speed, y, -2.0, 1);
                            (now, then, Vec2::new(-speed, 0.0))
                        } else {
                            let wall = plane(x, y, 0.0, 0);
                            (wall, wall, Vec2::ZERO)
                        }
                    },
                    |at| f32::from(u8::from(is_bar(at))),
                );
                for at in every(size) {
                    let i = index(at, size);
                    let wanted = f32::from(u8::from(is_bar(at)));
                    trail = trail.max((film.states[i].mean - wanted).abs());
                    if !tested || frame == 0 || is_bar(at) {
                        continue;
                    }
                    // Uncovered now: at most as long as the wall beside it.
                    let was_bar = |x: u32| bar(frame - 1, x as f32 + 0.5);
                    let longest = (at.x.saturating_sub(1)..=(at.x + 1).min(size.x - 1))
                        .filter(|x| !was_bar(*x))
                        .map(|x| before[index(UVec2::new(x, at.y), size)])
                        .fold(0.0, f32::max);
                    let length = film.states[i].history;
                    assert!(length <= longest + 1.0, "{at}: {length} after {longest}");
                    if !was_bar(at.x) {
                        assert_eq!(length, (before[i] + 1.0).min(32.0), "{at}");
                    }
                }
            }
            trail
        };
        assert_eq!(run(true), 0.0, "{speed} pixels a frame");
        // Without the tests the wall keeps the bar's light.
        let trail = run(false);
        println!("{speed} pixels a frame: without tests {trail:.3}");
        assert!(trail > 0.5, "{trail}");
    }
}

/// After n frames in the dark (1 - 1/cap)^n of the light is left.
#[test]
fn a_light_that_goes_off_decays_as_the_cap_says() {
    let size = UVec2::new(5, 4);
    for cap in [5.0f32, 8.0, 32.0] {
        let mut film = Film::new(size);
        let wall = |at: UVec2| {
            let s = plane(at.x as f32, at.y as f32, 0.0, 0);
            (s, s, Vec2::ZERO)
        };
        for _ in 0..64 {
            film.step(cap, true, wall, |_| 3.3);
        }
        assert!(
            film.states
                .iter()
                .all(|s| s.mean == 3.3 && s.variance == 0.0)
        );
        for n in 1..100 {
            film.step(cap, true, wall, |_| 0.0);
            let wanted = 3.3 * (1.0 - 1.0 / f64::from(cap)).powi(n);
            for s in &film.states {
                let error = (f64::from(s.mean) / wanted - 1.0).abs();
                assert!(error < 1e-7 * f64::from(n) + 1e-7, "{n}: {error:e}");
            }
        }
    }
}

/// A camera that is jittered over a ramp: bilinear history of something linear
/// is exact, so the average is the ramp, without blur and without drift.
#[test]
fn jitter_neither_blurs_nor_shifts_a_ramp() {
    // At the image's edge the taps outside are left out and the rest leans; a
    // random walk of 64 steps brings little of that 40 pixels inward.
    let (size, margin) = (UVec2::splat(96), 40);
    let mut film = Film::new(size);
    let ramp = |p: Vec2| 0.5 + 0.03 * p.x - 0.02 * p.y;
    let jitter = |frame: u32| {
        Vec2::new(
            halton_radical_inverse(2, frame + 1),
            halton_radical_inverse(3, frame + 1),
        ) - 0.5
    };
    let mut worst = 0.0f32;
    for frame in 0..64u32 {
        let here = jitter(frame);
        let motion = if frame == 0 {
            Vec2::ZERO
        } else {
            here - jitter(frame - 1)
        };
        film.step(
            64.0,
            true,
            |at| {
                let p = at.as_vec2() + here;
                let s = plane(p.x, p.y, 0.0, 0);
                (s, s, motion)
            },
            |at| ramp(at.as_vec2() + here),
        );
        let inside = |at: &UVec2| at.min_element() >= margin && (size - *at).min_element() > margin;
        for at in every(size).filter(inside) {
            let wanted = ramp(at.as_vec2() + here);
            worst = worst.max((film.states[index(at, size)].mean - wanted).abs());
        }
    }
    println!("after 64 frames of jitter: {worst:e}");
    assert!(worst < 64.0 * f32::EPSILON, "{worst:e}");
    // A motion that is cut off at whole pixels shifts it.
    let cut = ramp(Vec2::new(1.0, 0.0)) - ramp(Vec2::ZERO);
    assert!(0.25 * cut > 100.0 * worst);
}

fn surfaces(
    size: UVec2,
    surface: impl Fn(UVec2) -> SvgfSurface + Sync + Send,
    passes: u32,
) -> SvgfPass<1> {
    let settings = SvgfSettings {
        passes,
        // Luminance stops nothing: what is left is geometry.
        sigma_luminance: 1e15,
        ..SvgfSettings::PAPER
    };
    let mut pass = SvgfPass::new(size, settings);
    pass.set_surfaces(surface);
    pass
}

fn wall(at: UVec2) -> SvgfSurface {
    SvgfSurface {
        position: Vec3::new(at.x as f32, at.y as f32, 0.0),
        reach: 0.1,
        normal: Vec3::NEG_Z,
    }
}

/// Sparse bright light: the passes spread it and lose nothing of it; a clamp
/// of 5 × 5 leaves (1 + √24)/25 of a lone one.
#[test]
fn sparse_bright_light_keeps_its_energy() {
    // As far from the edge as the light gets, and the taps of what it reaches.
    let size = UVec2::new(256, 256);
    let mut pass = surfaces(size, wall, 5);
    let lone = UVec2::new(129, 127);
    let bright = 4096.0f32;
    pass.set_image(|at| ([if at == lone { bright } else { 0.0 }], 1.0));
    pass.filter(|_| {});
    let sum: f64 = every(size).map(|at| f64::from(pass.at(at).0[0])).sum();
    assert!((sum / f64::from(bright) - 1.0).abs() < 1e-5, "{sum}");

    let read = |at: UVec2| Vec3::splat(if at == lone { bright } else { 0.0 });
    let kept = variance_clamp_pixel(lone, size, 2, Vec3::splat(bright), 1.0, 0, read);
    let wanted = f64::from(bright) * (1.0 + 24f64.sqrt()) / 25.0;
    assert!((f64::from(kept.x) / wanted - 1.0).abs() < 1e-6, "{kept}");

    // Light that one frame in 64 brings, 64 times as bright: one on average.
    let size = UVec2::new(64, 64);
    let mut film = Film::new(size);
    let mut next = numbers(7);
    let still = |at: UVec2| {
        let s = plane(at.x as f32, at.y as f32, 0.0, 0);
        (s, s, Vec2::ZERO)
    };
    for _ in 0..256 {
        let light: Vec<f32> = every(size)
            .map(|_| if next() < 1.0 / 64.0 { 64.0 } else { 0.0 })
            .collect();
        film.step(1024.0, true, still, |at| light[index(at, size)]);
    }
    let count = f64::from(size.element_product());
    let mean = film.states.iter().map(|s| f64::from(s.mean)).sum::<f64>() / count;
    // Variance of a sample is 63.
    let sigma = (63.0 / (count * 256.0)).sqrt();
    assert!((mean - 1.0).abs() < 4.0 * sigma, "{mean} ± {sigma}");
}

/// Sum of the squared weights of passes of 5 × 5 on a plane: what they leave of
/// the variance of white noise.
fn squares(passes: u32) -> f64 {
    let mut kernel = vec![1.0f64];
    for i in 0..passes {
        let step = 1usize << i;
        let mut next = vec![0.0; kernel.len() + 4 * step];
        for (j, k) in kernel.iter().enumerate() {
            for (tap, b) in [0.0625, 0.25, 0.375, 0.25, 0.0625].into_iter().enumerate() {
                next[j + tap * step] += k * b;
            }
        }
        kernel = next;
    }
    kernel.iter().map(|k| k * k).sum::<f64>().powi(2)
}

/// A floor seen at a grazing angle is filtered like a wall that faces the
/// camera: the noise that is left is that of the plain kernel.
#[test]
fn a_grazing_floor_is_filtered_like_a_wall() {
    let size = UVec2::new(220, 160);
    let passes = 3;
    let margin = 14;
    // 1.5 m above the floor, 60 degrees over 1080 rows, from 6 rows below the
    // horizon on.
    let focal = 540.0 / 30f32.to_radians().tan();
    let floor = |at: UVec2| {
        let below = at.y as f32 + 6.5;
        let depth = 1.5 * focal / below;
        let x = (at.x as f32 - 110.0) * depth / focal;
        SvgfSurface {
            position: Vec3::new(x, 0.0, depth),
            reach: 0.01 * depth,
            normal: Vec3::Y,
        }
    };
    let mut next = numbers(11);
    let noise: Vec<f32> = every(size).map(|_| next() + next() + next()).collect();
    let left = |pass: &mut SvgfPass<1>| {
        pass.set_image(|at| ([noise[index(at, size)]], 0.25));
        pass.filter(|_| {});
        let inside = every(size)
            .filter(|at| at.min_element() >= margin && (size - at).min_element() > margin);
        let values: Vec<f64> = inside.map(|at| f64::from(pass.at(at).0[0])).collect();
        values.iter().map(|v| (v - 1.5).powi(2)).sum::<f64>() / values.len() as f64
    };
    let on_floor = left(&mut surfaces(size, floor, passes));
    let on_wall = left(&mut surfaces(size, wall, passes));
    // Three uniform numbers have a variance of a quarter.
    let wanted = 0.25 * squares(passes);
    println!("floor {on_floor:.6}, wall {on_wall:.6}, kernel {wanted:.6}");
    assert!((on_floor / on_wall - 1.0).abs() < 1e-3);
    assert!((on_wall / wanted - 1.0).abs() < 0.15);
}

/// Two planes of one colour, of which one is noisy: the other stays the number
/// that it was to an ULP or two, without variance, whatever the passes.
#[test]
fn planes_of_one_colour_keep_their_noise_apart() {
    let size = UVec2::new(96, 64);
    let behind = |at: UVec2| at.x >= 41;
    let surface = |at: UVec2| SvgfSurface {
        position: Vec3::new(at.x as f32, at.y as f32, if behind(at) { 5.0 } else { 0.0 }),
        reach: 0.1,
        normal: Vec3::NEG_Z,
    };
    for passes in 1..=5 {
        let mut pass = surfaces(size, surface, passes);
        let mut next = numbers(3);
        let noise: Vec<f32> = every(size).map(|_| 0.7 + 0.4 * (next() - 0.5)).collect();
        pass.set_image(|at| {
            if behind(at) {
                ([noise[index(at, size)]], 0.0133)
            } else {
                ([0.7], 0.0)
            }
        });
        pass.filter(|_| {});
        for at in every(size) {
            let ([value], variance) = pass.at(at);
            if behind(at) {
                assert!(variance < 0.0133 && (0.5..0.9).contains(&value));
            } else {
                assert_eq!(variance, 0.0, "{at}, {passes} passes");
                assert!((value - 0.7).abs() < 2.0 * f32::EPSILON, "{at}: {value}");
            }
        }
    }
}
