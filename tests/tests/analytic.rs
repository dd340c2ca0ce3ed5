//! Scenes whose filtered picture is known in closed form, through parts of the
//! chain and through the whole of it: reprojection, clamp, accumulation, SVGF
//! with its feedback. And what a bad sample leaves behind there.

use glam::{UVec2, Vec2, Vec3};
use raytwin::filter::svgf::{SvgfScalar, SvgfSettings, SvgfSurface, svgf_variance_scalar_pixel};
use raytwin::pass::svgf::SvgfPass;
use raytwin::random::halton::halton_radical_inverse;
use raytwin::random::pcg::{pcg_next, pcg_unit};
use raytwin::temporal::accumulate::{
    TEMPORAL_ACCUMULATE_EMPTY, TEMPORAL_ACCUMULATE_RGB_EMPTY, TemporalAccumulateRgbState,
    TemporalAccumulateState, temporal_accumulate_mean, temporal_accumulate_rgb_step,
    temporal_accumulate_step,
};
use raytwin::temporal::reproject::{
    REPROJECT_TOLERANCE, ReprojectHistory, ReprojectSurface, ReprojectTaps, reproject_find,
    reproject_footprint, reproject_gather,
};
use raytwin::temporal::taa::taa_pixel;
use raytwin::temporal::variance_clamp::{VARIANCE_CLAMP_RGB, variance_clamp_pixel};

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
    /// Deviations to which the new frame holds the history.
    gamma: Option<f32>,
}

impl Film {
    fn new(size: UVec2) -> Self {
        Self {
            size,
            states: vec![TEMPORAL_ACCUMULATE_EMPTY; size.element_product() as usize],
            surfaces: Vec::new(),
            gamma: None,
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
            let read = |p| Vec3::splat(sample(p));
            let held = self.gamma.map(|gamma| {
                let mean = Vec3::splat(known.value.x);
                variance_clamp_pixel(at, size, 2, mean, gamma, VARIANCE_CLAMP_RGB, read).x
            });
            let state = TemporalAccumulateState {
                mean: held.unwrap_or(known.value.x),
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

/// A strip, and the pixel of it that goes bad in frame [`BAD_FRAME`].
const STRIP: UVec2 = UVec2::new(400, 16);
const SPOT: UVec2 = UVec2::new(50, 8);
const BAD_FRAME: u32 = 3;

/// What a frame leaves of a pixel: value and variance filtered, mean and length
/// of the history.
type Left = [f32; 4];

/// Frames of noise through the whole chain: history found again, held to the
/// new frame, sample taken in, variance, all passes, the first of them fed back.
/// `spoil` may change the history and the samples before each frame.
fn chain(
    settings: SvgfSettings,
    moving: bool,
    frames: u32,
    spoil: impl Fn(u32, &mut Film, &mut [f32]),
) -> Vec<Vec<Left>> {
    let size = STRIP;
    let mut film = Film::new(size);
    film.gamma = Some(1.0);
    let mut pass = SvgfPass::<1>::new(size, settings);
    pass.set_surfaces(wall);
    // To and fro by parts of a pixel: each history is a mean of four.
    let away = |frame: u32| Vec2::new(0.5, 0.25) * (frame % 2 * u32::from(moving)) as f32;
    (0..frames)
        .map(|frame| {
            let mut next = numbers(100 + frame);
            let mut samples: Vec<f32> = every(size).map(|_| next()).collect();
            spoil(frame, &mut film, &mut samples);
            let (here, before) = (away(frame), away(frame.saturating_sub(1)));
            let surface = |at: UVec2| {
                let p = at.as_vec2() + here;
                let s = plane(p.x, p.y, 0.0, 0);
                (s, s, here - before)
            };
            film.step(1.0 / settings.alpha, true, surface, |at| {
                samples[index(at, size)]
            });
            let read = |at: UVec2| {
                let s = film.states[index(at, size)];
                let (value, variance) = (s.mean, s.variance);
                SvgfScalar { value, variance }
            };
            pass.set_image(|at| {
                let length = film.states[index(at, size)].history;
                let variance = svgf_variance_scalar_pixel(at, size, length, settings, wall, read);
                ([read(at).value], variance)
            });
            let mut means = Vec::new();
            pass.filter(|image| {
                for y in 0..size.y {
                    means.extend_from_slice(&image.row(y, 0)[..size.x as usize]);
                }
            });
            for (state, mean) in film.states.iter_mut().zip(means) {
                state.mean = mean;
            }
            let left = |at| {
                let ([value], variance) = pass.at(at);
                let state = film.states[index(at, size)];
                [value, variance, state.mean, state.history]
            };
            every(size).map(left).collect()
        })
        .collect()
}

fn same(a: &Left, b: &Left) -> bool {
    a.map(f32::to_bits) == b.map(f32::to_bits)
}

/// One sample of one frame is no number: nothing is ever NaN or infinite, the
/// damage is that of a sample that is missing, it grows as far as the filter
/// and its feedback reach, and fades as the history forgets.
#[test]
fn a_bad_sample_is_a_missing_one_and_is_forgotten() {
    const FRAMES: u32 = 160;
    // With luminance that stops nothing the filter is a weighted mean with
    // weights of its own, and the chain can be followed; then as in use.
    for (sigma_luminance, moving) in [(1e15, false), (1e15, true), (4.0, false), (4.0, true)] {
        let settings = SvgfSettings {
            sigma_luminance,
            ..SvgfSettings::PAPER
        };
        let spoiled = |bad: f32, frames| {
            chain(settings, moving, frames, |frame, _, samples| {
                if frame == BAD_FRAME {
                    samples[index(SPOT, STRIP)] = bad;
                }
            })
        };
        let sound = chain(settings, moving, FRAMES, |_, _, _| {});
        let broken = spoiled(f32::NAN, FRAMES);
        for other in [f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            for (a, b) in spoiled(other, 24).iter().zip(&broken) {
                assert!(a.iter().zip(b).all(|(a, b)| same(a, b)), "{other}");
            }
        }
        let (mut before, mut last, mut beyond) = (0.0f32, 0, 0);
        for (frame, (a, b)) in (0..).zip(broken.iter().zip(&sound)) {
            // The clamp's neighbours (2), the variance's (3), all passes (62);
            // then each frame the pass that is fed back (2), and if the image
            // moves four texels (1) and the variance at its young rim (3).
            let after = u32::saturating_sub(frame, BAD_FRAME);
            let reach = 2 + 3 + 62 + after * if moving { 6 } else { 2 };
            let (mut apart, mut farthest) = (0.0f32, None);
            for ((at, a), b) in every(STRIP).zip(a).zip(b) {
                let far = at.x.abs_diff(SPOT.x).max(at.y.abs_diff(SPOT.y));
                assert!(a.iter().all(|x| x.is_finite()), "{frame}, {at}: {a:?}");
                apart = apart.max((a[2] - b[2]).abs());
                if !same(a, b) {
                    farthest = farthest.max(Some(far));
                    last = frame;
                }
            }
            beyond += u32::from(reach + SPOT.x < STRIP.x);
            assert!(
                farthest <= Some(reach),
                "{frame}: {farthest:?}, not {reach}"
            );
            match frame.cmp(&BAD_FRAME) {
                std::cmp::Ordering::Less => assert_eq!(farthest, None),
                std::cmp::Ordering::Equal => assert!(farthest >= Some(2) && apart > 1e-3),
                std::cmp::Ordering::Greater => {}
            }
            // From frame 5 on every history is as long as in the sound run, and
            // a frame leaves 1 - alpha of the difference, but for roundings.
            if sigma_luminance > 1e3 && frame > 5 {
                let most = (1.0 - settings.alpha) * before + 32.0 * f32::EPSILON;
                assert!(apart <= most, "{frame}: {apart:e} after {before:e}");
            }
            // 0.8^35 of a thousandth, and what roundings add: 1 / alpha times.
            // With weights by luminance that is no proof; it holds all the same.
            assert!(frame < 40 || apart < 2e-5, "{frame}: {apart:e}");
            if [3, 5, 10, 20, 40, 80].contains(&frame) {
                println!(
                    "{sigma_luminance}, {moving}, {frame}: {apart:e}, {farthest:?} of {reach}"
                );
            }
            before = apart;
        }
        println!("{sigma_luminance}, {moving}: the last difference in frame {last}");
        assert!(beyond > 40, "{beyond} frames with pixels beyond");
        // Two ways that weights do not tell apart meet. Where weights follow the
        // values, an ULP of one wanders on through the feedback.
        if sigma_luminance > 1e3 {
            assert!(last < FRAMES / 2, "still there in frame {last}");
        } else {
            assert!(before < 4.0 * f32::EPSILON, "{before:e} in the end");
        }
    }
}

/// A history that is no number is none: the sample replaces it, and with
/// alpha = 1 nothing of any history is left.
#[test]
fn a_nan_in_the_history_does_not_survive_alpha_1() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
        assert_eq!(temporal_accumulate_mean(bad, 0.25, 1.0), 0.25);
        for lane in 0..3 {
            let mut numbers = [0.5, 0.5, 4.0];
            numbers[lane] = bad;
            let [mean, variance, history] = numbers;
            let state = TemporalAccumulateState {
                mean,
                variance,
                history,
            };
            let after = temporal_accumulate_step(state, 0.25, 1.0);
            assert_eq!(
                (after.mean, after.variance, after.history),
                (0.25, 0.0, 1.0)
            );
        }
        let state = TemporalAccumulateRgbState {
            color: Vec3::new(0.5, bad, 0.5),
            history: 4.0,
            ..TEMPORAL_ACCUMULATE_RGB_EMPTY
        };
        let sample = Vec3::new(0.1, 0.2, 0.3);
        assert_eq!(
            temporal_accumulate_rgb_step(state, sample, 1.0, 1.0).color,
            sample
        );
        let read = |_| sample;
        let taa = taa_pixel(
            UVec2::ONE,
            UVec2::splat(3),
            Vec3::splat(bad),
            1.0,
            1.0,
            read,
        );
        assert!((taa - sample).abs().max_element() < 1e-6, "{taa}");

        // In the chain, of a history of one frame: the next one is as without.
        let run = |alpha: f32, bad: Option<f32>| {
            let settings = SvgfSettings {
                alpha,
                ..SvgfSettings::PAPER
            };
            chain(settings, true, 8, |frame, film, _| {
                if let (BAD_FRAME, Some(bad)) = (frame, bad) {
                    let state = &mut film.states[index(SPOT, STRIP)];
                    (state.mean, state.variance) = (bad, bad);
                }
            })
        };
        let (with, without) = (run(1.0, Some(bad)), run(1.0, None));
        for (a, b) in with.iter().zip(&without) {
            assert!(a.iter().zip(b).all(|(a, b)| same(a, b)), "{bad}");
        }
        for frame in run(SvgfSettings::PAPER.alpha, Some(bad)) {
            assert!(frame.iter().flatten().all(|x| x.is_finite()), "{bad}");
        }
    }
}
