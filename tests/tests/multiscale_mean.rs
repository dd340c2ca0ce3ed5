//! What `temporal/multiscale_mean` promises beyond its contract: one source for
//! both signals, the same start in both languages, and whole sequences of
//! frames on real adapters, bit for bit where nothing is rearranged.

use raytwin::contract::{Kernel, Value};
use raytwin::temporal::multiscale_mean::*;
use raytwin_cpu::random::pcg::pcg_hash;
use raytwin_tests::gpu::{Build, Program as GpuProgram, adapters};
use raytwin_tests::interval::{Program, Table};

/// The text between `// NAME: begin` and `// NAME: end`, without comments.
fn section(name: &str) -> String {
    let text = WGSL
        .split(&format!("// {name}: begin\n"))
        .nth(1)
        .and_then(|t| t.split(&format!("// {name}: end\n")).next())
        .unwrap_or_else(|| panic!("multiscale_mean.wgsl has no section {name}"));
    text.lines()
        .filter(|l| !l.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n")
}

#[test]
fn the_estimator_for_numbers_is_that_for_colours_over_one_channel() {
    let mut expected = section("COLOR");
    for (from, to) in [
        ("_rgb_", "_"),
        ("RgbState", "State"),
        ("_RGB_", "_"),
        ("vec3f", "f32"),
    ] {
        expected = expected.replace(from, to);
    }
    assert_eq!(section("SCALAR"), expected);
    assert!(expected.contains("fn multiscale_mean_robust_step(") && !expected.contains("vec3"));
}

#[test]
fn empty_states_and_settings_are_the_same_in_both_languages() {
    let source = raytwin::wgsl::link(&["temporal/multiscale_mean"]).expect("registered")
        + "fn a() -> MultiscaleMeanState { return MULTISCALE_MEAN_EMPTY; }
           fn b() -> MultiscaleMeanRgbState { return MULTISCALE_MEAN_RGB_EMPTY; }
           fn c() -> MultiscaleMeanRobustState { return MULTISCALE_MEAN_ROBUST_EMPTY; }
           fn d() -> MultiscaleMeanRobustRgbState { return MULTISCALE_MEAN_ROBUST_RGB_EMPTY; }
           fn e() -> vec3f { return vec3f(
               MULTISCALE_MEAN_SHORT_BLEND, MULTISCALE_MEAN_LONGEST, MULTISCALE_MEAN_LARGEST); }
           fn f() -> vec3f { return vec3f(MULTISCALE_MEAN_LARGEST_VARIANCE,
               MULTISCALE_MEAN_LARGEST_COUNT, MULTISCALE_MEAN_TINY); }";
    fn words<V: Value>(value: V) -> Vec<u32> {
        let mut words = vec![0; V::WORDS];
        value.write(&mut words);
        words
    }
    let program = Program::parse(&source).expect("valid WGSL");
    for (name, expected) in [
        ("a", words(MULTISCALE_MEAN_EMPTY)),
        ("b", words(MULTISCALE_MEAN_RGB_EMPTY)),
        ("c", words(MULTISCALE_MEAN_ROBUST_EMPTY)),
        ("d", words(MULTISCALE_MEAN_ROBUST_RGB_EMPTY)),
        (
            "e",
            words([
                MULTISCALE_MEAN_SHORT_BLEND,
                MULTISCALE_MEAN_LONGEST,
                MULTISCALE_MEAN_LARGEST,
            ]),
        ),
        (
            "f",
            words([
                MULTISCALE_MEAN_LARGEST_VARIANCE,
                MULTISCALE_MEAN_LARGEST_COUNT,
                MULTISCALE_MEAN_TINY,
            ]),
        ),
    ] {
        let out = program.call(name, &[], Table::Wgsl).expect("runs");
        assert_eq!(out.len(), expected.len(), "{name}");
        for (i, (out, word)) in out.iter().zip(&expected).enumerate() {
            assert!(out.is_exact() && out.contains(*word), "{name}, member {i}");
        }
    }
}

/// A constant gives WGSL no other choice than that constant, whatever the
/// driver does to the sums.
#[test]
fn a_constant_stays_exact_on_any_implementation() {
    let source = raytwin::wgsl::link(&["temporal/multiscale_mean"]).expect("registered");
    let program = Program::parse(&source).expect("valid WGSL");
    let settings = [MULTISCALE_MEAN_SHORT_BLEND, MULTISCALE_MEAN_LONGEST].map(f32::to_bits);
    for value in [0.0f32, 0.1, 3.3, 1000.1, 65000.0] {
        let mut state = vec![0; MultiscaleMeanRobustState::WORDS];
        for frame in 0..20 {
            let input = [&state[..], &[value.to_bits()], &settings].concat();
            let out = program
                .call("multiscale_mean_robust_step", &input, Table::Wgsl)
                .expect("runs");
            for (member, lane) in [(0, value), (1, value), (2, 0.0), (3, 0.0)] {
                assert!(
                    out[member].is_exact() && out[member].contains(lane.to_bits()),
                    "{value}, frame {frame}, member {member}: {:?}",
                    out[member]
                );
            }
            let next = multiscale_mean_robust_step(
                MultiscaleMeanRobustState::read(&state),
                value,
                MULTISCALE_MEAN_SHORT_BLEND,
                MULTISCALE_MEAN_LONGEST,
            );
            next.write(&mut state);
        }
    }
}

const PIXELS: u32 = 4096;
const FRAMES: u32 = 64;

fn unit(word: u32) -> f32 {
    (pcg_hash(word) >> 8) as f32 / 16_777_216.0
}

/// Noise whose level jumps at a frame of the pixel's own; sparse light in a
/// quarter of the pixels, fireflies anywhere; and, for the form that must bear
/// it, now and then what is no number.
fn sample(pixel: u32, frame: u32, channel: u32, with_bad: bool) -> f32 {
    let at = |lane: u32| unit((pixel * FRAMES + frame) * 16 + 4 * channel + lane);
    let jump = (unit(pixel ^ 0x5555) * 64.0) as u32;
    let level = if frame < jump { 0.5 } else { 3.0 * unit(pixel) };
    let kind = at(0);
    if with_bad && kind < 0.01 {
        let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -f32::NAN];
        return bad[(at(1) * 5.0) as usize];
    }
    if pixel.is_multiple_of(4) {
        return if at(1) < 0.1 { 10.0 * level } else { 0.0 };
    }
    if kind > 0.99 {
        return 1000.0 * level;
    }
    level * (0.25 + 1.5 * at(2))
}

/// One frame's arguments: states, a sample of `channels` numbers, settings.
fn arguments(
    kernel: &Kernel,
    states: &[u32],
    frame: u32,
    channels: u32,
    settings: &[f32],
    with_bad: bool,
) -> Vec<u32> {
    let words = kernel.words_out();
    let mut input = Vec::with_capacity(PIXELS as usize * kernel.words_in());
    for (pixel, state) in (0..).zip(states.chunks_exact(words)) {
        input.extend(state);
        input.extend((0..channels).map(|c| sample(pixel, frame, c, with_bad).to_bits()));
        input.extend(settings.iter().map(|s| s.to_bits()));
    }
    input
}

#[test]
fn sixty_four_frames_of_4096_pixels_are_the_cpus_bit_for_bit() {
    let kernels: Vec<Kernel> = raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .filter(|k| k.module == "temporal/multiscale_mean" && k.name.ends_with("_step"))
        .collect();
    assert_eq!(kernels.len(), 4);
    let mut ran = false;
    for gpu in adapters().expect("an adapter") {
        if !gpu.has_precise() || !gpu.is_software() {
            continue;
        }
        ran = true;
        for kernel in &kernels {
            let robust = kernel.name.contains("robust");
            let channels = if kernel.name.contains("rgb") { 3 } else { 1 };
            let settings: &[f32] = if robust {
                &[MULTISCALE_MEAN_SHORT_BLEND, MULTISCALE_MEAN_LONGEST]
            } else {
                &[MULTISCALE_MEAN_SHORT_BLEND]
            };
            let program = GpuProgram::new(gpu, kernel, Build::Precise).expect("compiles");
            let mut states = vec![0; PIXELS as usize * kernel.words_out()];
            let mut expected = states.clone();
            let mut mean = 0.0;
            for frame in 0..FRAMES {
                let of =
                    |states: &[u32]| arguments(kernel, states, frame, channels, settings, robust);
                states = program.run(&of(&states));
                let input = of(&expected);
                kernel.run_cpu(&input, &mut expected);
                let differ = states.iter().zip(&expected).filter(|(a, b)| a != b).count();
                assert_eq!(
                    differ,
                    0,
                    "{} on {}, frame {frame}: {differ} words differ",
                    kernel.name,
                    gpu.label()
                );
                assert!(states.iter().all(|w| f32::from_bits(*w).is_finite()));
                mean = f64::from(f32::from_bits(states[kernel.words_out()]));
            }
            assert!(mean > 0.0, "{}: nothing was averaged", kernel.name);
        }
    }
    assert!(ran, "no software adapter with the precise build");
}

/// The ready pass, as users run it, over packed states. A driver may round
/// otherwise, so answers are compared as a whole: their error is that of a
/// packed state.
#[test]
fn the_ready_pass_follows_the_cpu_on_every_adapter() {
    let source = raytwin::wgsl::link(&["temporal/multiscale_mean"]).expect("registered")
        + raytwin::wgsl::pass::MULTISCALE_MEAN_COLOR;
    let color = |pixel, frame| [0, 1, 2].map(|channel| sample(pixel, frame, channel, true));
    let mut states = vec![MultiscaleMeanRobustRgbPacked::default(); PIXELS as usize];
    let mut expected = vec![[0.0f32; 4]; PIXELS as usize];
    for frame in 0..FRAMES {
        for (pixel, (state, answer)) in (0..).zip(states.iter_mut().zip(&mut expected)) {
            let next = multiscale_mean_robust_rgb_step(
                multiscale_mean_robust_rgb_unpack(*state),
                color(pixel, frame).into(),
                MULTISCALE_MEAN_SHORT_BLEND,
                MULTISCALE_MEAN_LONGEST,
            );
            *state = multiscale_mean_robust_rgb_pack(next);
            *answer = multiscale_mean_robust_rgb_value(next)
                .extend(next.age)
                .into();
        }
    }
    for gpu in adapters().expect("an adapter") {
        let device = gpu.device();
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(source.as_str().into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("multiscale_mean_pass_step"),
            compilation_options: Default::default(),
            cache: None,
        });
        let settings = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 16,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let words = [
            PIXELS,
            MULTISCALE_MEAN_SHORT_BLEND.to_bits(),
            MULTISCALE_MEAN_LONGEST.to_bits(),
            0,
        ];
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        gpu.queue().write_buffer(&settings, 0, &bytes);
        let stored = gpu.buffer(&vec![0; 10 * PIXELS as usize]);
        let answers = gpu.buffer(&vec![0; 4 * PIXELS as usize]);
        for frame in 0..FRAMES {
            let words: Vec<u32> = (0..PIXELS)
                .flat_map(|pixel| {
                    let [r, g, b] = color(pixel, frame).map(f32::to_bits);
                    [r, g, b, 0]
                })
                .collect();
            let samples = gpu.buffer(&words);
            let buffers = [&settings, &samples, &stored, &answers];
            let entries: Vec<_> = (0..)
                .zip(buffers)
                .map(|(binding, buffer)| wgpu::BindGroupEntry {
                    binding,
                    resource: buffer.as_entire_binding(),
                })
                .collect();
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            let mut encoder = device.create_command_encoder(&Default::default());
            {
                let mut pass = encoder.begin_compute_pass(&Default::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &group, &[]);
                pass.dispatch_workgroups(PIXELS / 64, 1, 1);
            }
            gpu.queue().submit([encoder.finish()]);
        }
        let got = gpu.read(&answers, 4 * PIXELS as usize);
        let (mut apart, mut whole) = (0.0, 0.0);
        for (got, want) in got.chunks_exact(4).zip(&expected) {
            assert_eq!(f32::from_bits(got[3]), want[3], "ages differ");
            for (got, want) in got.iter().zip(want).take(3) {
                let got = f64::from(f32::from_bits(*got));
                assert!(got.is_finite());
                apart += (got - f64::from(*want)).powi(2);
                whole += f64::from(*want).powi(2);
            }
        }
        let error = (apart / whole).sqrt();
        assert!(error < 0.005, "{}: {error}", gpu.label());
    }
}
