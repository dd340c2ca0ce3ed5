//! A NaN, an infinity or 1e30 stays where it is, and a constant stays exact:
//! on each adapter as shipped, and on any that WGSL allows.

use std::sync::Arc;

use glam::{UVec2, Vec3};
use raytwin::contract::{Fixture, Kernel, Value};
use raytwin::temporal::accumulate::{
    TEMPORAL_ACCUMULATE_EMPTY, TEMPORAL_ACCUMULATE_RGB_EMPTY, TemporalAccumulateState,
    temporal_accumulate_rgb_step, temporal_accumulate_step,
};
use raytwin::temporal::reproject::{ReprojectSurface, ReprojectTolerance};
use raytwin::temporal::variance_clamp::variance_clamp_pixel;
use raytwin_tests::derive::program;
use raytwin_tests::gpu::{self, Build, Program};
use raytwin_tests::interval::Table;
use raytwin_tests::measure::run_cpu;

/// What no sample may be.
const BAD: [f32; 6] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    -1e30,
    1e30,
];

fn kernel(name: &str) -> Kernel {
    raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .find(|k| k.name == name)
        .expect("registered")
}

fn words(value: impl Value) -> Vec<u32> {
    fn count<T: Value>(_: &T) -> usize {
        T::WORDS
    }
    let mut words = vec![0; count(&value)];
    value.write(&mut words);
    words
}

/// Runs a kernel on every adapter: what it makes of bad input must be finite
/// and what the CPU makes of it.
fn same_everywhere(kernel: &Kernel, input: &[u32]) {
    let cpu = run_cpu(kernel, input);
    assert!(cpu.iter().all(|w| f32::from_bits(*w).is_finite()));
    let gpus = gpu::adapters().expect("an adapter");
    assert!(!gpus.is_empty());
    for gpu in gpus {
        let out = Program::new(gpu, kernel, Build::Plain)
            .expect("valid WGSL")
            .run(input);
        for (a, b) in cpu.iter().zip(&out) {
            let (a, b) = (f32::from_bits(*a), f32::from_bits(*b));
            let apart = (a - b).abs();
            assert!(apart <= 1e-6 * a.abs(), "{}: {a} and {b}", gpu.label());
        }
    }
}

#[test]
fn accumulation_leaves_out_what_is_no_number() {
    let (one, rgb) = (
        kernel("temporal_accumulate_step"),
        kernel("temporal_accumulate_rgb_step"),
    );
    let state = TemporalAccumulateState {
        mean: 1.5,
        variance: 0.5,
        history: 4.0,
    };
    let (mut scalars, mut colors) = (Vec::new(), Vec::new());
    for bad in BAD {
        scalars.extend(words(state));
        scalars.extend(words([bad, 32.0]));
        // Bad members of the history: whatever they are, the sample replaces
        // them. (A variance of 1e30 is one that a history may have.)
        for member in 0..3 {
            if member == 1 && bad.abs() == 1e30 {
                continue;
            }
            let mut broken = words(state);
            broken[member] = bad.to_bits();
            scalars.extend(broken);
            scalars.extend(words([5.0f32, 32.0]));
        }
        let good = temporal_accumulate_rgb_step(TEMPORAL_ACCUMULATE_RGB_EMPTY, Vec3::ONE, 8.0, 5.0);
        for channel in 0..3 {
            let mut sample = Vec3::splat(0.5);
            sample[channel] = bad;
            colors.extend(words(good));
            colors.extend(words(sample));
            colors.extend(words([8.0f32, 5.0]));
            let mut broken = words(good);
            broken[channel] = bad.to_bits();
            colors.extend(broken);
            colors.extend(words(Vec3::splat(0.5)));
            colors.extend(words([8.0f32, 5.0]));
        }
    }
    same_everywhere(&one, &scalars);
    same_everywhere(&rgb, &colors);
    for out in run_cpu(&one, &scalars).chunks_exact(3) {
        let after = TemporalAccumulateState::read(out);
        let anew = temporal_accumulate_step(TEMPORAL_ACCUMULATE_EMPTY, 5.0, 32.0);
        assert!(after == state || after == anew, "{after:?}");
    }
}

#[test]
fn accumulation_keeps_a_constant_on_any_implementation() {
    let kernel = kernel("temporal_accumulate_step");
    let program = program(&kernel).expect("valid WGSL");
    for value in [0.0f32, 0.1, 3.3, 1000.1, 65000.0] {
        for history in [0.0, 1.0, 2.0, 6.0, 31.0, 32.0] {
            let mut input = words([value, 0.0, history]);
            input.extend(words([value, 32.0]));
            let out = program
                .call(kernel.name, &input, Table::Wgsl)
                .expect("the interpreter runs it");
            for (lane, want) in [value, 0.0].into_iter().enumerate() {
                assert!(
                    out[lane].is_exact() && out[lane].contains(want.to_bits()),
                    "{value} after {history}, lane {lane}: {:?}",
                    out[lane]
                );
            }
        }
    }
}

/// An 8 x 8 image out of the test's buffer.
const IMAGE: &str = "
fn variance_clamp_read(at: vec2u) -> vec3f {
    let i = 3u * (at.y * 8u + at.x);
    return vec3f(
        bitcast<f32>(raytwin_fixture[i]),
        bitcast<f32>(raytwin_fixture[i + 1u]),
        bitcast<f32>(raytwin_fixture[i + 2u]),
    );
}
";

#[test]
fn the_variance_clamp_leaves_out_what_is_no_number() {
    let size = UVec2::splat(8);
    for bad in BAD {
        let read = move |at: UVec2| {
            let level = ((at.x * 5 + at.y * 3) % 7) as f32 * 0.125;
            if at == UVec2::new(3, 4) {
                return Vec3::new(0.5, 0.5, bad);
            }
            Vec3::new(level, 1.0 - level, 0.25 + 0.5 * level)
        };
        let mut kernel = kernel("variance_clamp_pixel");
        let image = (0..64).flat_map(|i| words(read(UVec2::new(i % 8, i / 8))));
        kernel.fixture = Some(Fixture {
            wgsl: IMAGE,
            words: Arc::new(image.collect()),
        });
        let (mut input, mut cpu) = (Vec::new(), Vec::new());
        for i in 0..64 {
            let at = UVec2::new(i % 8, i / 8);
            for mode in 0..4u32 {
                for old in [Vec3::new(1.5, 0.2, 0.9), Vec3::new(0.5, bad, 0.5)] {
                    input.extend(words([at, size]));
                    input.extend(words(2u32));
                    input.extend(words(old));
                    input.extend(words(1.0f32));
                    input.extend(words(mode));
                    cpu.push(variance_clamp_pixel(at, size, 2, old, 1.0, mode, read));
                }
            }
        }
        for gpu in gpu::adapters().expect("an adapter") {
            let out = Program::new(gpu, &kernel, Build::Plain)
                .expect("valid WGSL")
                .run(&input);
            for (want, got) in cpu.iter().zip(out.chunks_exact(3)) {
                let got = Vec3::read(got);
                let apart = (*want - got).abs().max_element();
                assert!(
                    want.is_finite() && apart < 1e-4,
                    "{}: {want} and {got}",
                    gpu.label()
                );
            }
        }
    }
}

#[test]
fn the_variance_clamp_keeps_a_constant_on_any_implementation() {
    // The fixture's right side is constant.
    let kernel = kernel("variance_clamp_pixel");
    let program = program(&kernel).expect("valid WGSL");
    let want = [0.7f32, 0.3, 0.1];
    for at in [UVec2::new(13, 5), UVec2::new(15, 11), UVec2::new(12, 0)] {
        for mode in 0..4u32 {
            for old in [
                Vec3::ONE,
                Vec3::new(0.7, 0.3, 0.100001),
                Vec3::from_array(want),
                Vec3::X * 1e4,
            ] {
                let mut input = words([at, UVec2::new(16, 12)]);
                input.extend(words(2u32));
                input.extend(words(old));
                input.extend(words(1.5f32));
                input.extend(words(mode));
                let out = program
                    .call(kernel.name, &input, Table::Wgsl)
                    .expect("the interpreter runs it");
                for (lane, want) in out.iter().zip(want) {
                    assert!(
                        lane.is_exact() && lane.contains(want.to_bits()),
                        "mode {mode}, history {old}: {out:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_bad_surface_matches_nothing_on_any_adapter() {
    let wall = ReprojectSurface {
        position: Vec3::new(1.0, 2.0, 0.0),
        depth: 4.0,
        normal: Vec3::Z,
        mesh: 0,
    };
    let (mut input, mut want) = (Vec::new(), Vec::new());
    let mut add = |expected: Vec<u32>, found: Vec<u32>, same: u32| {
        input.extend(expected);
        input.extend(words(0.0f32));
        input.extend(found);
        input.extend(words(ReprojectTolerance {
            plane: 1e9,
            normal: 2.0,
        }));
        want.push(same);
    };
    add(words(wall), words(wall), 1);
    for (bad, lane) in BAD.into_iter().flat_map(|b| (0..7).map(move |l| (b, l))) {
        let mut broken = words(wall);
        broken[lane] = bad.to_bits();
        add(words(wall), broken.clone(), 0);
        add(broken.clone(), words(wall), 0);
        add(broken.clone(), broken, 0);
    }
    let kernel = kernel("reproject_matches");
    assert_eq!(run_cpu(&kernel, &input), want);
    for gpu in gpu::adapters().expect("an adapter") {
        let program = Program::new(gpu, &kernel, Build::Plain).expect("valid WGSL");
        assert_eq!(program.run(&input), want, "{}", gpu.label());
    }
}

/// One pixel in 9 x 9 is broken, each in another way.
const WALL: UVec2 = UVec2::new(9 * BAD.len() as u32, 9 * 7);

/// A wall out of the test's buffer: place, reach (or depth, or weight), normal,
/// colour of each pixel.
macro_rules! wall {
    ($callbacks:literal) => {
        concat!(
            "
fn test_number(at: vec2u, i: u32) -> f32 {
    return bitcast<f32>(raytwin_fixture[10u * (at.y * 54u + at.x) + i]);
}
fn test_vector(at: vec2u, i: u32) -> vec3f {
    return vec3f(test_number(at, i), test_number(at, i + 1u), test_number(at, i + 2u));
}
",
            $callbacks
        )
    };
}

const BLUR: &str = wall!(
    "
fn separable_blur_read(at: vec2u) -> SeparableBlurPixel {
    return SeparableBlurPixel(
        test_vector(at, 0u), test_number(at, 3u), test_vector(at, 4u), test_number(at, 7u),
    );
}
"
);
const VARIANCE: &str = wall!(
    "
fn bilateral_variance_read(at: vec2u) -> BilateralVariancePixel {
    return BilateralVariancePixel(
        test_vector(at, 7u), 1.0, test_vector(at, 0u), test_number(at, 3u), test_vector(at, 4u),
    );
}
"
);
const UPSAMPLE: &str = wall!(
    "
fn bilateral_upsample_read_surface(at: vec2u) -> BilateralUpsampleSurface {
    let low = vec2u(at.x / 2u, at.y / 2u);
    return BilateralUpsampleSurface(
        test_vector(low, 0u), test_number(low, 3u), test_vector(low, 4u),
    );
}
fn bilateral_upsample_read_tap(at: vec2u) -> BilateralUpsampleTap {
    return BilateralUpsampleTap(
        test_vector(at, 7u), test_number(at, 3u), test_vector(at, 0u), test_vector(at, 4u),
    );
}
"
);
const REPROJECT: &str = wall!(
    "
alias ReprojectValue = vec3f;
fn reproject_read_surface(at: vec2u) -> ReprojectSurface {
    return ReprojectSurface(
        test_vector(at, 0u), test_number(at, 3u), test_vector(at, 4u), 0u,
    );
}
fn reproject_read_prior(at: vec2u) -> ReprojectSurface {
    return reproject_read_surface(at);
}
fn reproject_read_history(at: vec2u) -> ReprojectHistory {
    return ReprojectHistory(test_vector(at, 7u), 1.0);
}
"
);

/// Bit for bit what the same adapter makes of the wall with no surface there.
#[test]
fn a_bad_surface_is_none_on_any_adapter() {
    let surface = |at: UVec2| ReprojectSurface {
        position: Vec3::new(at.x as f32, at.y as f32, ((at.x + at.y) % 3) as f32 * 0.25),
        depth: 1.0,
        normal: Vec3::Z,
        mesh: 0,
    };
    let pixels = || (0..WALL.x * WALL.y).map(|i| UVec2::new(i % WALL.x, i / WALL.x));
    // Sound, without the broken pixels' surfaces, with these broken.
    let wall = |kind: u32| -> Vec<u32> {
        let pixel = |at: UVec2| {
            let mut out = words(surface(at));
            out.pop();
            if kind > 0 && at % 9 == UVec2::splat(4) {
                let place = at / 9;
                out[3] = if kind == 1 { 0 } else { out[3] };
                if kind == 2 {
                    out[place.y as usize] = BAD[place.x as usize].to_bits();
                }
            }
            let level = ((at.x * 5 + at.y * 3) % 7) as f32 * 0.125;
            out.extend(words(Vec3::new(0.25 + level, 1.0, 2.0 - level)));
            out
        };
        pixels().flat_map(pixel).collect()
    };
    type Arguments<'a> = Vec<(&'a str, &'static str, &'a dyn Fn(UVec2) -> Vec<u32>)>;
    let reprojected = |at: UVec2| {
        let motion = [0.25f32, -0.5];
        let limits = [0.0f32, 1.0, 0.5];
        [
            words([at, WALL]),
            words(motion),
            words(surface(at)),
            words(limits),
        ]
        .concat()
    };
    let kernels: Arguments<'_> = vec![
        ("separable_blur_pixel", BLUR, &|at| {
            [words([at, WALL]), vec![at.x & 1, 3]].concat()
        }),
        ("bilateral_variance_pixel", VARIANCE, &|at| {
            [words([at, WALL]), words(3.5f32), vec![9], words(0.3f32)].concat()
        }),
        ("bilateral_upsample_pixel", UPSAMPLE, &|at| {
            [words([2 * at + (at & 1), WALL]), vec![2]].concat()
        }),
        ("reproject_pixel", REPROJECT, &reprojected),
        ("reproject_bend", REPROJECT, &|at| {
            [words([at, WALL]), words([1.0f32, 0.5])].concat()
        }),
    ];
    for (name, wgsl, arguments) in kernels {
        let input: Vec<u32> = pixels().flat_map(arguments).collect();
        for gpu in gpu::adapters().expect("an adapter") {
            let [sound, without, broken] = [0, 1, 2].map(|kind| {
                let mut kernel = kernel(name);
                kernel.fixture = Some(Fixture {
                    wgsl,
                    words: Arc::new(wall(kind)),
                });
                let program = Program::new(gpu, &kernel, Build::Plain).expect("valid WGSL");
                program.run(&input)
            });
            assert!(sound != without, "{}: {name} reads no surface", gpu.label());
            let each = without.len() / (WALL.x * WALL.y) as usize;
            let other = without.iter().zip(&broken).position(|(a, b)| a != b);
            let at = other.and_then(|i| pixels().nth(i / each));
            assert_eq!(at, None, "{}: {name}", gpu.label());
        }
    }
}
