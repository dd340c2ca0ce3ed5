//! What users get from the feature `gpu`, used as they would.

use glam::{UVec2, Vec3};
use raytwin::filter::svgf::{
    SvgfColor, SvgfScalar, SvgfSettings, SvgfSurface, svgf_variance_pixel,
    svgf_variance_scalar_pixel,
};
use raytwin::filter::tiles::{
    tiles_at, tiles_atrous_reach, tiles_color_flags, tiles_count, tiles_reach, tiles_scalar_flags,
};
use raytwin::gpu::{BvhBuffers, BvhSizeError};
use raytwin::pass::svgf::{SvgfGpu, SvgfPass, SvgfSignal};
use raytwin::pass::tiles::TileMask;
use raytwin::random::pcg::{pcg_hash, pcg_unit};
use raytwin::ray::bvh::{BVH_MISS, BvhHit, bvh_closest};
use raytwin::ray::bvh_build::{BuildQuality, Bvh};
use raytwin::ray::ray::Ray;
use raytwin_tests::gpu::{Gpu, adapters};

const RAYS: u32 = 1024;

const MAIN: &str = "
@group(0) @binding(0) var<storage, read_write> results: array<vec4u>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let x = f32(id.x % 32u) / 16.0 - 1.0;
    let y = f32(id.x / 32u) / 16.0 - 1.0;
    let hit = bvh_closest(Ray(vec3f(x, y, 3.0), vec3f(0.0, 0.0, -1.0), 0.0, 100.0));
    results[id.x] = vec4u(bitcast<u32>(hit.t), bitcast<u32>(hit.u), bitcast<u32>(hit.v), hit.primitive);
}";

fn trace(gpu: &Gpu, nodes: &[u32], triangles: &[u32]) -> Vec<u32> {
    let buffers = BvhBuffers::new(gpu.device(), nodes, triangles);
    assert!(buffers.size() >= 80);
    let source =
        raytwin::wgsl::link(&["ray/bvh"]).expect("registered") + BvhBuffers::bindings_wgsl() + MAIN;
    run(gpu, &buffers, source)
}

/// The same for triangles with bit 2.
fn trace_masked(gpu: &Gpu, nodes: &[u32], triangles: &[u32], masks: &[u32]) -> Vec<u32> {
    let buffers = BvhBuffers::with_masks(gpu.device(), nodes, triangles, masks);
    assert!(buffers.size() >= 84);
    let source = raytwin::wgsl::link(&["ray/bvh_filter"]).expect("registered")
        + BvhBuffers::bindings_wgsl()
        + BvhBuffers::mask_bindings_wgsl()
        + &MAIN
            .replace("bvh_closest(", "bvh_closest_of(")
            .replace("100.0));", "100.0), BVH_FACES_BOTH, 2u);");
    run(gpu, &buffers, source)
}

fn run(gpu: &Gpu, buffers: &BvhBuffers, source: String) -> Vec<u32> {
    let device = gpu.device();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let results = gpu.buffer(&vec![0; 4 * RAYS as usize]);
    let own = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: false },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        }],
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &own,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: results.as_entire_binding(),
        }],
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&own), None, Some(buffers.layout())],
        immediate_size: 0,
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: Some(&layout),
        module: &module,
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.set_bind_group(BvhBuffers::GROUP, buffers.bind_group(), &[]);
        pass.dispatch_workgroups(RAYS / 64, 1, 1);
    }
    gpu.queue().submit([encoder.finish()]);
    gpu.read(&results, 4 * RAYS as usize)
}

fn on_the_processor(bvh: &Bvh) -> Vec<BvhHit> {
    let hits: Vec<BvhHit> = (0..RAYS)
        .map(|i| {
            let origin = Vec3::new(
                (i % 32) as f32 / 16.0 - 1.0,
                (i / 32) as f32 / 16.0 - 1.0,
                3.0,
            );
            let ray = Ray {
                origin,
                direction: -Vec3::Z,
                t_min: 0.0,
                t_max: 100.0,
            };
            bvh_closest(&bvh.view(), ray)
        })
        .collect();
    let count = hits.iter().filter(|h| h.primitive != BVH_MISS).count();
    assert!(count > 100, "only {count} rays hit");
    hits
}

/// Rays that have another hit than on the processor.
fn differing(expected: &[BvhHit], words: &[u32]) -> usize {
    let pairs = expected.iter().zip(words.chunks_exact(4));
    pairs
        .filter(|(hit, word)| {
            let t = f32::from_bits(word[0]);
            hit.primitive != word[3] || (hit.t - t).abs() > 1e-5 * hit.t
        })
        .count()
}

#[test]
fn a_refitted_tree_is_written_over_the_first() {
    let gpus = adapters().unwrap_or_else(|e| panic!("{e}"));
    let at =
        |i: u32, j: u32, height: f32| Vec3::new(i as f32 / 4.0 - 1.0, j as f32 / 4.0 - 1.0, height);
    let sheet = |bend: f32| -> Vec<Vec3> {
        (0..81)
            .map(|k| (k % 9, k / 9))
            .map(|(i, j)| at(i, j, bend * (i * j % 5) as f32))
            .collect()
    };
    let indices: Vec<[u32; 3]> = (0..64)
        .map(|k| k / 8 * 9 + k % 8)
        .flat_map(|k| [[k, k + 1, k + 10], [k, k + 10, k + 9]])
        .collect();
    let flat = Bvh::build(&sheet(0.0), &indices, BuildQuality::Medium).expect("a sheet");
    let mut bent = flat.clone();
    bent.refit(&sheet(0.3), &indices).expect("the same mesh");
    let expected = on_the_processor(&bent);
    for gpu in gpus {
        let buffers = BvhBuffers::new(gpu.device(), &flat.node_words(), &flat.triangle_words());
        let source = || {
            raytwin::wgsl::link(&["ray/bvh"]).expect("registered")
                + BvhBuffers::bindings_wgsl()
                + MAIN
        };
        let before = differing(&expected, &run(gpu, &buffers, source()));
        assert!(before > 500, "{}: {before} rays differ", gpu.label());
        let (nodes, triangles) = (bent.node_words(), bent.triangle_words());
        buffers
            .write(gpu.queue(), &nodes, &triangles)
            .expect("as many words");
        let off = differing(&expected, &run(gpu, &buffers, source()));
        // Rays along an edge may change sides where the driver fuses.
        assert!(off <= 40, "{}: {off} of {RAYS} rays differ", gpu.label());
        let error = buffers.write(gpu.queue(), &nodes[8..], &triangles);
        let given = [nodes.len() - 8, triangles.len()];
        let held = [nodes.len(), triangles.len()];
        assert_eq!(error, Err(BvhSizeError { given, held }));
    }
}

#[test]
fn buffers_and_bindings_trace_what_the_cpu_traces() {
    let gpus = adapters().unwrap_or_else(|e| panic!("{e}"));
    let positions = [
        Vec3::new(-0.7, -0.7, 0.0),
        Vec3::new(0.8, -0.6, 0.3),
        Vec3::new(0.1, 0.9, -0.2),
        Vec3::new(-0.9, 0.5, 1.0),
    ];
    let indices = [[0, 1, 2], [0, 2, 3]];
    let bvh = Bvh::build(&positions, &indices, BuildQuality::Medium).expect("a plain mesh");
    let expected = on_the_processor(&bvh);
    for gpu in gpus {
        let words = trace(gpu, &bvh.node_words(), &bvh.triangle_words());
        let off = differing(&expected, &words);
        // Rays along an edge may change sides where the driver fuses.
        assert!(off <= 8, "{}: {off} of {RAYS} rays differ", gpu.label());

        let nothing = trace(gpu, &[], &[]);
        assert!(
            nothing.chunks_exact(4).all(|w| w[3] == BVH_MISS),
            "{}: an empty tree was hit",
            gpu.label()
        );

        // All bits beyond the masks, and where there are none.
        let (nodes, triangles) = (bvh.node_words(), bvh.triangle_words());
        let masked = |masks: &[u32]| trace_masked(gpu, &nodes, &triangles, masks);
        let primitives =
            |words: &[u32]| -> Vec<u32> { words.chunks_exact(4).map(|w| w[3]).collect() };
        let all = primitives(&words);
        assert_eq!(primitives(&masked(&[])), all, "{}", gpu.label());
        for hidden in [0, 1] {
            let masks = if hidden == 0 { vec![1] } else { vec![2, 1] };
            let found = primitives(&masked(&masks));
            let wanted = all.iter().map(|&p| if p == hidden { BVH_MISS } else { p });
            // The two triangles lie side by side as the rays see them.
            let off = found.iter().zip(wanted).filter(|(f, w)| *f != w).count();
            assert!(off <= 8, "{}: {off} of {RAYS} rays differ", gpu.label());
            assert!(found.contains(&(1 - hidden)), "{}", gpu.label());
        }
    }
}

fn noise(at: UVec2, lane: u32) -> f32 {
    pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
}

fn wall(at: UVec2) -> SvgfSurface {
    let depth = if at.x > 30 { 2.0 } else { 0.0 };
    SvgfSurface {
        position: Vec3::new(at.x as f32, at.y as f32, depth + 0.1 * noise(at, 1)),
        reach: if at.y < 4 { 0.0 } else { 0.5 },
        normal: Vec3::new(0.1 * noise(at, 2), 0.1 * noise(at, 3), 1.0).normalize(),
    }
}

fn frames(at: UVec2) -> f32 {
    (at.x % 9) as f32
}

fn color(at: UVec2) -> SvgfColor {
    SvgfColor {
        value: Vec3::new(noise(at, 4), noise(at, 5), noise(at, 6)),
        variance: 0.1 * noise(at, 7),
    }
}

fn scalar(at: UVec2) -> SvgfScalar {
    SvgfScalar {
        value: noise(at, 8),
        variance: 0.1 * noise(at, 9),
    }
}

/// The filter on an adapter: what it leaves, and what it feeds back.
fn svgf_on(gpu: &Gpu, filter: &SvgfGpu, signal: SvgfSignal) -> [Vec<f32>; 2] {
    let size = filter.size();
    let pixels = || (0..size.x * size.y).map(|i| UVec2::new(i % size.x, i / size.x));
    let write = |buffer: &wgpu::Buffer, values: Vec<f32>| {
        gpu.queue()
            .write_buffer(buffer, 0, bytemuck::cast_slice(&values));
    };
    let surfaces = pixels().map(wall).flat_map(|s| {
        let (p, n) = (s.position, s.normal);
        [p.x, p.y, p.z, s.reach, n.x, n.y, n.z, 0.0]
    });
    write(filter.surfaces(), surfaces.collect());
    write(filter.history(), pixels().map(frames).collect());
    let image = pixels().flat_map(|at| match signal {
        SvgfSignal::Color => {
            let c = color(at);
            vec![c.value.x, c.value.y, c.value.z, c.variance]
        }
        SvgfSignal::Scalar => {
            let s = scalar(at);
            vec![s.value, s.variance]
        }
    });
    write(filter.input(), image.collect());
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    filter.encode(&mut encoder);
    gpu.queue().submit([encoder.finish()]);
    [filter.output(), filter.feedback()].map(|buffer| {
        let words = gpu.read(buffer, buffer.size() as usize / 4);
        words.into_iter().map(f32::from_bits).collect()
    })
}

/// The same on the CPU.
fn svgf_here<const C: usize>(
    size: UVec2,
    settings: SvgfSettings,
    image: impl Fn(UVec2) -> ([f32; C], f32) + Sync + Send,
) -> [Vec<f32>; 2] {
    let mut pass = SvgfPass::<C>::new(size, settings);
    pass.set_surfaces(wall);
    pass.set_image(image);
    let texels = |pass: &SvgfPass<C>| {
        let mut out = Vec::new();
        for i in 0..size.x * size.y {
            let (value, variance) = pass.at(UVec2::new(i % size.x, i / size.x));
            out.extend(value.into_iter().chain([variance]));
        }
        out
    };
    let mut feedback = Vec::new();
    pass.filter(|image| feedback = texels(image));
    [texels(&pass), feedback]
}

/// The compute passes give what the CPU's give, for both signals, with an even
/// and an odd number of passes, and after a change of size.
#[test]
fn svgf_passes_give_what_the_cpu_gives() {
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        for settings in [SvgfSettings::PAPER, SvgfSettings::BLOG] {
            for signal in [SvgfSignal::Color, SvgfSignal::Scalar] {
                let mut filter = SvgfGpu::new(gpu.device(), UVec2::new(65, 38), settings, signal)
                    .expect("registered");
                for size in [UVec2::new(65, 38), UVec2::new(17, 50)] {
                    if filter.size() != size {
                        filter.resize(gpu.device(), size);
                    }
                    let found = svgf_on(gpu, &filter, signal);
                    let want = match signal {
                        SvgfSignal::Color => svgf_here::<3>(size, settings, |at| {
                            let history = frames(at);
                            let variance =
                                svgf_variance_pixel(at, size, history, settings, wall, color);
                            (color(at).value.to_array(), variance)
                        }),
                        SvgfSignal::Scalar => svgf_here::<1>(size, settings, |at| {
                            let history = frames(at);
                            let variance = svgf_variance_scalar_pixel(
                                at, size, history, settings, wall, scalar,
                            );
                            ([scalar(at).value], variance)
                        }),
                    };
                    let mut worst = 0.0f32;
                    for (found, want) in found.iter().zip(&want) {
                        assert_eq!(found.len(), want.len());
                        for (f, w) in found.iter().zip(want) {
                            worst = worst.max((f - w).abs());
                        }
                    }
                    println!("{}: {signal:?} {size}: {worst:e}", gpu.label());
                    // Some ULP of one a pass, which the next one averages.
                    assert!(
                        worst < 2e-5,
                        "{}: {signal:?} {size}: {worst:e}",
                        gpu.label()
                    );
                }
            }
        }
    }
}

/// A shadow's edge over a floor below a sky, with a pixel of doubt in full
/// light, one in full shadow, and one that is no number.
fn edge(at: UVec2) -> SvgfScalar {
    let lit = if at.x < 200 { 1.0 } else { 0.0 };
    let (value, variance) = match (at.x, at.y) {
        (195..205, 300..) => (noise(at, 8), 0.1 * noise(at, 9)),
        (21, 187) => (lit, 1e-9),
        // Where the spatial variance and the passes reach the ninth tile.
        (423, 143) => (0.001, 0.0),
        (399, 330) => (f32::NAN, 0.0),
        (30..60, 0..40) => (noise(at, 10), 0.1),
        _ => (lit, 0.0),
    };
    SvgfScalar { value, variance }
}

fn edge_color(at: UVec2) -> SvgfColor {
    let s = edge(at);
    let tint = if s.variance > 1e-6 { 0.7 } else { 1.0 };
    SvgfColor {
        value: Vec3::new(s.value, tint * s.value, s.value),
        variance: s.variance,
    }
}

fn floor(at: UVec2) -> SvgfSurface {
    SvgfSurface {
        reach: if at.y < 50 { 0.0 } else { 0.5 },
        ..wall(at)
    }
}

/// The filter's output and feedback on an adapter, as bits.
fn bits_on(gpu: &Gpu, filter: &SvgfGpu, signal: SvgfSignal) -> [Vec<u32>; 2] {
    let size = filter.size();
    let pixels = || (0..size.x * size.y).map(|i| UVec2::new(i % size.x, i / size.x));
    let write = |buffer: &wgpu::Buffer, values: Vec<f32>| {
        gpu.queue()
            .write_buffer(buffer, 0, bytemuck::cast_slice(&values));
    };
    let surfaces = pixels().map(floor).flat_map(|s| {
        let (p, n) = (s.position, s.normal);
        [p.x, p.y, p.z, s.reach, n.x, n.y, n.z, 0.0]
    });
    write(filter.surfaces(), surfaces.collect());
    write(filter.history(), pixels().map(frames).collect());
    let image = pixels().flat_map(|at| match signal {
        SvgfSignal::Color => {
            let c = edge_color(at);
            vec![c.value.x, c.value.y, c.value.z, c.variance]
        }
        SvgfSignal::Scalar => {
            let s = edge(at);
            vec![s.value, s.variance]
        }
    });
    write(filter.input(), image.collect());
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    filter.encode(&mut encoder);
    gpu.queue().submit([encoder.finish()]);
    [filter.output(), filter.feedback()].map(|buffer| gpu.read(buffer, buffer.size() as usize / 4))
}

/// Indirect dispatch over the listed tiles gives the bits of the full dispatch,
/// and the list is the CPU's; a list that is too short is not used.
#[test]
fn svgf_over_tiles_gives_the_bits_of_the_whole() {
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        for settings in [SvgfSettings::PAPER, SvgfSettings::BLOG] {
            for signal in [SvgfSignal::Color, SvgfSignal::Scalar] {
                let sizes = [UVec2::new(517, 401), UVec2::new(300, 190)];
                let device = gpu.device();
                let mut whole = SvgfGpu::new(device, sizes[0], settings, signal).expect("linked");
                let tiled = |most| {
                    SvgfGpu::with_tiles(device, sizes[0], settings, signal, most).expect("linked")
                };
                let (mut enough, mut short) = (tiled(u32::MAX), tiled(5));
                for size in sizes {
                    for filter in [&mut whole, &mut enough, &mut short] {
                        if filter.size() != size {
                            filter.resize(device, size);
                        }
                    }
                    let want = bits_on(gpu, &whole, signal);
                    let label = format!("{}: {signal:?} {size}", gpu.label());
                    // Twice: the second run's list may not hold the first's.
                    for _ in 0..2 {
                        let same = bits_on(gpu, &enough, signal) == want;
                        assert!(same, "{label}: tiles change bits");
                        let same = bits_on(gpu, &short, signal) == want;
                        assert!(same, "{label}: a short list changes bits");
                    }
                    // The list, in whatever order, is the CPU's.
                    let pixels = tiles_atrous_reach(settings.radius, settings.passes) + 3;
                    let mask = TileMask::new(size, tiles_reach(pixels), |at| {
                        let surface = u32::from(floor(at).reach > 0.0);
                        match signal {
                            SvgfSignal::Color => {
                                let c = edge_color(at);
                                tiles_color_flags(c.value, c.variance, surface)
                            }
                            SvgfSignal::Scalar => {
                                let s = edge(at);
                                tiles_scalar_flags(s.value, s.variance, surface)
                            }
                        }
                    });
                    let buffer = enough.tiles().expect("made with tiles");
                    let words = gpu.read(buffer, buffer.size() as usize / 4);
                    let count = words[4] as usize;
                    let mut listed: Vec<_> = words[5..5 + count].to_vec();
                    listed.sort_unstable();
                    let across = tiles_count(size).x;
                    let listed: Vec<_> = listed.iter().map(|i| tiles_at(*i, across)).collect();
                    let same = listed == mask.iter().collect::<Vec<_>>();
                    assert!(same, "{label}: the list is not the CPU's");
                    assert_eq!((words[2], words[3]), (1, 0), "{label}");
                    let all = tiles_count(size).element_product() as usize;
                    println!("{label}: {count} of {all} tiles");
                    assert!(count > all / 20 && count < 9 * all / 10, "{label}: {count}");
                    let buffer = short.tiles().expect("made with tiles");
                    let words = gpu.read(buffer, 4);
                    assert_eq!(words[3], 1, "{label}: a list of 5 was used");
                }
            }
        }
    }
}
