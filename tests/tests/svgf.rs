//! What `filter/svgf` promises beyond its contract: one source for both
//! signals, presets, constants on any implementation, and images with NaN and
//! infinity on real adapters.

use glam::{UVec2, Vec3};
use raytwin::contract::Value;
use raytwin::filter::svgf::*;
use raytwin_tests::gpu::{Gpu, adapters};
use raytwin_tests::interval::{Program, Table};

/// The text between `// NAME: begin` and `// NAME: end`, without comments.
fn section(name: &str) -> String {
    let text = WGSL
        .split(&format!("// {name}: begin\n"))
        .nth(1)
        .and_then(|t| t.split(&format!("// {name}: end\n")).next())
        .unwrap_or_else(|| panic!("svgf.wgsl has no section {name}"));
    text.lines()
        .filter(|l| !l.trim_start().starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n")
}

#[test]
fn the_scalar_filter_is_the_colour_filter_over_one_channel() {
    let mut expected = section("COLOR");
    for (from, to) in [
        ("svgf_color_", "svgf_scalar_"),
        ("svgf_read_color", "svgf_read_scalar"),
        ("SvgfColor", "SvgfScalar"),
        ("_pixel(", "_scalar_pixel("),
        ("vec3f", "f32"),
    ] {
        expected = expected.replace(from, to);
    }
    assert_eq!(section("SCALAR"), expected);
    assert!(expected.contains("fn svgf_atrous_scalar_pixel(") && !expected.contains("vec3"));
}

#[test]
fn presets_are_the_same_in_both_languages() {
    let source = raytwin::wgsl::link(&["filter/svgf"]).expect("registered")
        + raytwin::wgsl::module("filter/svgf")
            .and_then(|m| m.bindings)
            .expect("has bindings")
        + "fn paper() -> SvgfSettings { return SVGF_PAPER; }
           fn blog() -> SvgfSettings { return SVGF_BLOG; }";
    let program = Program::parse(&source).expect("valid WGSL");
    for (name, preset) in [("paper", SvgfSettings::PAPER), ("blog", SvgfSettings::BLOG)] {
        let mut words = vec![0; SvgfSettings::WORDS];
        preset.write(&mut words);
        let out = program.call(name, &[], Table::Wgsl).expect("runs");
        for (i, (out, word)) in out.iter().zip(&words).enumerate() {
            assert!(out.is_exact() && out.contains(*word), "{name}, member {i}");
        }
    }
}

/// WGSL leaves an implementation no other result for a constant image.
#[test]
fn a_constant_stays_exact_on_any_implementation() {
    for value in ["0.0", "0.1", "3.3", "1000.1", "65000.0"] {
        let source = raytwin::wgsl::link(&["filter/svgf"]).expect("registered")
            + &"
fn hash(at: vec2u) -> f32 {
    let h = (at.x * 0x9e3779b9u) ^ (at.y * 0x85ebca6bu);
    return f32(((h ^ (h >> 16u)) * 0x7feb352du) >> 24u) * 0.00390625;
}
fn svgf_read_surface(at: vec2u) -> SvgfSurface {
    var normal = vec3f(0.0, 0.0, 1.0);
    if at.y > 5u {
        normal = vec3f(0.125, 0.0, 0.9921567);
    }
    return SvgfSurface(vec3f(f32(at.x), f32(at.y), hash(at)), 2.0, normal);
}
fn svgf_read_color(at: vec2u) -> SvgfColor {
    return SvgfColor(vec3f(VALUE, 0.7, 3000.3), 0.015625 + hash(at));
}
fn svgf_read_scalar(at: vec2u) -> SvgfScalar {
    return SvgfScalar(VALUE, 0.25);
}"
            .replace("VALUE", value);
        let program = Program::parse(&source).expect("valid WGSL");
        let red: f32 = value.parse().expect("a number");
        let constant = [red, 0.7, 3000.3];
        let mut settings = vec![0; SvgfSettings::WORDS];
        SvgfSettings::PAPER.write(&mut settings);
        for pixel in [[0, 0], [4, 5], [7, 7], [11, 9]] {
            let call = |name: &str, last: &[u32]| {
                let words = [&pixel[..], &[12, 10], last].concat();
                program.call(name, &words, Table::Wgsl).expect("runs")
            };
            let of = |first: u32| [&[first], &settings[..]].concat();
            let (near, far) = (of(1), of(4));
            for step in [&near, &far] {
                let color = call("svgf_atrous_pixel", step);
                let scalar = call("svgf_atrous_scalar_pixel", step);
                for (got, want) in color.iter().zip(constant).chain(scalar.iter().zip([red])) {
                    assert!(
                        got.is_exact() && got.contains(want.to_bits()),
                        "{value}: {got:?}"
                    );
                }
            }
            let young = of(1f32.to_bits());
            // A colour's luminance may itself differ from pixel to pixel, where
            // an implementation rounds it in two ways; a scalar's cannot.
            for (name, want) in [
                ("svgf_variance_scalar_pixel", 0.0f32),
                ("svgf_gaussian_scalar_pixel", 0.25),
            ] {
                let arguments: &[u32] = if want == 0.0 { &young } else { &[] };
                let got = call(name, arguments)[0];
                assert!(
                    got.is_exact() && got.contains(want.to_bits()),
                    "{name}: {got:?}"
                );
            }
        }
    }
}

const SIZE: UVec2 = UVec2::new(40, 24);

fn hash(at: UVec2, lane: u32) -> f32 {
    let word = at.x ^ (at.y << 10) ^ (lane << 20);
    (raytwin_cpu::random::pcg::pcg_hash(word) >> 8) as f32 / 16_777_216.0
}

/// A pixel in twenty holds something that is no number, or too large for one.
fn color(at: UVec2) -> SvgfColor {
    let mut color = SvgfColor {
        value: Vec3::new(hash(at, 0), hash(at, 1), hash(at, 2)),
        variance: (1.0 + (hash(at, 3) * 63.0).floor()) / 1024.0,
    };
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -f32::NAN];
    let kind = (hash(at, 4) * 100.0) as usize;
    if kind < 5 {
        color.value[(hash(at, 5) * 3.0) as usize] = bad[kind];
    } else if kind == 5 {
        color.variance = f32::NAN;
    }
    color
}

fn surface(at: UVec2) -> SvgfSurface {
    let mut surface = SvgfSurface {
        position: Vec3::new(at.x as f32, at.y as f32, hash(at, 6)),
        reach: 2.0,
        normal: if at.x > 20 {
            Vec3::new(0.125, 0.0, 0.992_156_7)
        } else {
            Vec3::Z
        },
    };
    match (hash(at, 7) * 100.0) as u32 {
        0 => surface.position.y = f32::NAN,
        1 => surface.normal.x = f32::INFINITY,
        2 => surface.reach = f32::NAN,
        3 => surface.reach = 0.0,
        _ => {}
    }
    surface
}

const MAIN: &str = "
@group(0) @binding(0) var<storage, read_write> results: array<vec4f>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = svgf_layout.xy;
    let color = svgf_atrous_pixel(id.xy, size, svgf_layout.z, SVGF_PAPER);
    let scalar = svgf_atrous_scalar_pixel(id.xy, size, svgf_layout.z, SVGF_PAPER);
    let variance = svgf_variance_pixel(id.xy, size, 1.0, SVGF_PAPER);
    let at = 2u * (id.y * size.x + id.x);
    results[at] = vec4f(color.value, color.variance);
    results[at + 1u] = vec4f(scalar.value, scalar.variance, variance, 0.0);
}";

/// One pass over the image through the ready bindings.
fn pass(gpu: &Gpu, step: u32) -> Vec<f32> {
    let device = gpu.device();
    let source = raytwin::wgsl::link(&["filter/svgf"]).expect("registered")
        + raytwin::wgsl::module("filter/svgf")
            .and_then(|m| m.bindings)
            .expect("has bindings")
        + MAIN;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pixels = || (0..SIZE.x * SIZE.y).map(|i| UVec2::new(i % SIZE.x, i / SIZE.x));
    let bits = |numbers: Vec<f32>| {
        let words: Vec<u32> = numbers.iter().map(|x| x.to_bits()).collect();
        gpu.buffer(&words)
    };
    let surfaces = bits(
        pixels()
            .flat_map(|at| {
                let s = surface(at);
                let (p, n) = (s.position, s.normal);
                [p.x, p.y, p.z, s.reach, n.x, n.y, n.z, 0.0]
            })
            .collect(),
    );
    let colors = bits(
        pixels()
            .flat_map(|at| {
                let c = color(at);
                [c.value.x, c.value.y, c.value.z, c.variance]
            })
            .collect(),
    );
    let scalars = bits(
        pixels()
            .flat_map(|at| [color(at).value.x, color(at).variance])
            .collect(),
    );
    let layout = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 16,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let words: Vec<u8> = [SIZE.x, SIZE.y, step, 0]
        .iter()
        .flat_map(|w| w.to_le_bytes())
        .collect();
    gpu.queue().write_buffer(&layout, 0, &words);
    let count = (8 * SIZE.x * SIZE.y) as usize;
    let results = gpu.buffer(&vec![0; count]);

    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let group = |buffers: &[(u32, wgpu::BufferBindingType, &wgpu::Buffer)]| {
        let entries: Vec<_> = buffers.iter().map(|b| entry(b.0, b.1)).collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &entries,
        });
        let entries: Vec<_> = buffers
            .iter()
            .map(|b| wgpu::BindGroupEntry {
                binding: b.0,
                resource: b.2.as_entire_binding(),
            })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &entries,
        });
        (layout, group)
    };
    let (own, own_group) = group(&[(0, storage(false), &results)]);
    let (data, data_group) = group(&[
        (7, storage(true), &surfaces),
        (8, storage(true), &colors),
        (9, storage(true), &scalars),
        (10, wgpu::BufferBindingType::Uniform, &layout),
    ]);
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&own), None, Some(&data)],
        immediate_size: 0,
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: Some(&pipeline_layout),
        module: &module,
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &own_group, &[]);
        pass.set_bind_group(2, &data_group, &[]);
        pass.dispatch_workgroups(SIZE.x / 8, SIZE.y / 8, 1);
    }
    gpu.queue().submit([encoder.finish()]);
    gpu.read(&results, count)
        .into_iter()
        .map(f32::from_bits)
        .collect()
}

#[test]
fn bad_pixels_stop_at_the_filter_on_every_adapter() {
    let parity = raytwin::registry()
        .into_iter()
        .flat_map(|t| t.kernels)
        .filter(|k| k.module == "filter/svgf" && k.name.ends_with("_pixel"))
        .map(|k| k.bounds.parity())
        .fold(0.0, f64::max);
    // ULP of values up to 1.
    let tolerance = (parity * 2f64.powi(-23)) as f32;
    let settings = SvgfSettings::PAPER;
    let gray = |at| SvgfScalar {
        value: color(at).value.x,
        variance: color(at).variance,
    };
    for gpu in adapters().expect("an adapter") {
        for step in [1, 2, 4, 8, 16] {
            let out = pass(gpu, step);
            for (i, got) in out.chunks_exact(8).enumerate() {
                let at = UVec2::new(i as u32 % SIZE.x, i as u32 / SIZE.x);
                let c = svgf_atrous_pixel(at, SIZE, step, settings, surface, color);
                let s = svgf_atrous_scalar_pixel(at, SIZE, step, settings, surface, gray);
                let v = svgf_variance_pixel(at, SIZE, 1.0, settings, surface, color);
                let want = [
                    c.value.x, c.value.y, c.value.z, c.variance, s.value, s.variance, v, 0.0,
                ];
                for (lane, (got, want)) in got.iter().zip(want).enumerate() {
                    assert!(
                        want.is_finite() && (got - want).abs() <= tolerance,
                        "{}, step {step}, {at}, lane {lane}: {got}, the twin has {want}",
                        gpu.label()
                    );
                }
            }
        }
    }
}
