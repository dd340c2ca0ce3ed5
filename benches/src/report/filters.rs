//! What filters cost on whole images.

use std::time::Instant;

use glam::{UVec2, Vec3, vec3};
use rayon::prelude::*;
use raytwin::filter::svgf::{SvgfColor, SvgfScalar, SvgfSettings, SvgfSurface};
use raytwin::filter::svgf::{svgf_atrous_pixel, svgf_atrous_scalar_pixel};
use raytwin::pass::svgf::{SvgfGpu, SvgfPass, SvgfSignal};
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_cpu::simd::SimdLevel;
use raytwin_tests::gpu::{Gpu, ProgramError};

use super::error::ReportError;
use super::kernels::median;
use super::schema::{GoalRow, PassRow};

/// Where the time a pixel is compared: from 480p to 4K.
const SIZES: [UVec2; 3] = [
    UVec2::new(854, 480),
    UVec2::new(1920, 1080),
    UVec2::new(3840, 2160),
];

/// Where the straightforward loop is timed, which is slow.
const SMALL: UVec2 = UVec2::new(640, 360);

fn noise(at: UVec2, lane: u32) -> f32 {
    pcg_unit(pcg_hash(at.x ^ pcg_hash(at.y ^ pcg_hash(lane))))
}

/// A wall of panels with slightly rough normals.
fn surface(at: UVec2) -> SvgfSurface {
    let step = if (at.x / 64 + at.y / 64).is_multiple_of(3) {
        1.0
    } else {
        0.0
    };
    let tilt = vec3(0.05 * noise(at, 1), 0.05 * noise(at, 2), 1.0);
    SvgfSurface {
        position: vec3(at.x as f32, at.y as f32, step) * 0.01,
        reach: 0.01,
        normal: tilt.normalize(),
    }
}

fn value(at: UVec2) -> [f32; 3] {
    std::array::from_fn(|c| noise(at, 3 + c as u32))
}

const VARIANCE: f32 = 0.08;

/// Milliseconds of all passes, the median.
fn passes<const C: usize>(size: UVec2, repeats: usize, level: SimdLevel) -> f64 {
    let mut pass = SvgfPass::<C>::new(size, SvgfSettings::PAPER).with_level(level);
    // Made by all threads: a 4K image takes longer than its filter.
    let index = |at: UVec2| (at.y * size.x + at.x) as usize;
    let surfaces: Vec<SvgfSurface> = pixels(size).map(surface).collect();
    let values: Vec<[f32; 3]> = pixels(size).map(value).collect();
    pass.set_surfaces(|at| surfaces[index(at)]);
    let mut times: Vec<f64> = (0..repeats)
        .map(|_| {
            pass.set_image(|at| (std::array::from_fn(|c| values[index(at)][c]), VARIANCE));
            let start = Instant::now();
            pass.filter(|_| ());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    median(&mut times)
}

/// A shadow of which this share, from the left, is full light beyond doubt: the
/// medians in milliseconds of filtering all of it and of leaving out tiles, and
/// the part of the tiles that was filtered.
fn tiled(size: UVec2, share: f64, repeats: usize) -> (f64, f64, f64) {
    let edge = (f64::from(size.x) * share) as u32;
    let mut pass = SvgfPass::<1>::new(size, SvgfSettings::PAPER);
    let index = |at: UVec2| (at.y * size.x + at.x) as usize;
    let surfaces: Vec<SvgfSurface> = pixels(size).map(surface).collect();
    let values: Vec<f32> = pixels(size).map(|at| value(at)[0]).collect();
    pass.set_surfaces(|at| surfaces[index(at)]);
    let (mut whole, mut some, mut part) = (Vec::new(), Vec::new(), 0.0);
    for _ in 0..repeats {
        let image = |at: UVec2| {
            if at.x < edge {
                ([1.0], 0.0)
            } else {
                ([values[index(at)]], VARIANCE)
            }
        };
        pass.set_image(image);
        let start = Instant::now();
        pass.filter(|_| ());
        whole.push(start.elapsed().as_secs_f64() * 1e3);
        pass.set_image(image);
        let start = Instant::now();
        let mask = pass.filter_tiles(|_| ());
        some.push(start.elapsed().as_secs_f64() * 1e3);
        part = mask.count() as f64 / f64::from(mask.tiles().element_product());
    }
    (median(&mut whole), median(&mut some), part)
}

fn pixels(size: UVec2) -> impl IndexedParallelIterator<Item = UVec2> {
    (0..size.x * size.y)
        .into_par_iter()
        .map(move |i| UVec2::new(i % size.x, i / size.x))
}

/// The readable way: the function for a pixel, over every pixel, in parallel.
fn loops(size: UVec2) -> (f64, f64) {
    let settings = SvgfSettings::PAPER;
    let index = |at: UVec2| (at.y * size.x + at.x) as usize;
    let surfaces: Vec<SvgfSurface> = pixels(size).map(surface).collect();
    let read_surface = |at: UVec2| surfaces[index(at)];
    let mut colours: Vec<SvgfColor> = pixels(size)
        .map(|at| SvgfColor {
            value: Vec3::from_array(value(at)),
            variance: VARIANCE,
        })
        .collect();
    let start = Instant::now();
    for i in 0..settings.passes {
        let read = |at: UVec2| colours[index(at)];
        colours = pixels(size)
            .map(|at| svgf_atrous_pixel(at, size, 1 << i, settings, read_surface, read))
            .collect();
    }
    let colour = start.elapsed().as_secs_f64() * 1e3;
    let mut scalars: Vec<SvgfScalar> = pixels(size)
        .map(|at| SvgfScalar {
            value: value(at)[0],
            variance: VARIANCE,
        })
        .collect();
    let start = Instant::now();
    for i in 0..settings.passes {
        let read = |at: UVec2| scalars[index(at)];
        scalars = pixels(size)
            .map(|at| svgf_atrous_scalar_pixel(at, size, 1 << i, settings, read_surface, read))
            .collect();
    }
    (colour, start.elapsed().as_secs_f64() * 1e3)
}

/// The speed goals of the filters on the CPU.
///
/// `all`: also with the vectors that the processor's best ones include.
pub(super) fn goals(repeats: usize, all: bool) -> Vec<GoalRow> {
    let mut out = Vec::new();
    let threads = rayon::current_num_threads();
    let mut goal = |name: String, measured: f64, limit: f64, detail: String| {
        out.push(GoalRow {
            name,
            backend: "cpu".into(),
            measured,
            limit,
            detail,
            shader: None,
        });
    };
    let best = SimdLevel::best();
    let colours = SIZES.map(|size| {
        // The largest takes a second.
        let repeats = if size == SIZES[2] { 3 } else { repeats };
        (size, passes::<3>(size, repeats, best))
    });
    let wanted = |l: &SimdLevel| l.is_available() && (all || *l == best);
    for level in SimdLevel::ALL.into_iter().filter(wanted) {
        let name = match level {
            SimdLevel::Baseline => "the build's vectors",
            SimdLevel::Avx2 => "AVX2",
            SimdLevel::Avx512 => "AVX-512",
        };
        // What users get is the goal's row; the others say what the level buys.
        let colour = if level == best {
            colours[1].1
        } else {
            passes::<3>(SIZES[1], repeats, level)
        };
        let scalar = passes::<1>(SIZES[1], repeats, level);
        for (signal, ms, limit) in [("RGB", colour, 200.0), ("scalar", scalar, 80.0)] {
            goal(
                format!("SVGF, five passes, {signal} at 1080p with {name}, over {limit} ms"),
                ms / limit,
                1.0,
                format!("{ms:.0} ms on {threads} threads"),
            );
        }
    }
    for (share, limit) in [(0.5, 0.7), (0.9, 0.3)] {
        let (whole, some, part) = tiled(SIZES[1], share, repeats);
        goal(
            format!(
                "SVGF, shadow at 1080p, {:.0} % full light: tiles over the whole",
                100.0 * share
            ),
            some / whole,
            limit,
            format!(
                "{some:.0} ms over {whole:.0} ms on {threads} threads, {:.0} % of the tiles filtered",
                100.0 * part
            ),
        );
    }
    let (loop_colour, loop_scalar) = loops(SMALL);
    let small_colour = passes::<3>(SMALL, repeats, best);
    let small_scalar = passes::<1>(SMALL, repeats, best);
    for (what, ours, theirs) in [
        ("RGB", small_colour, loop_colour),
        ("scalar", small_scalar, loop_scalar),
    ] {
        goal(
            format!("SVGF, {what}, over an eighth of the loop over pixels"),
            8.0 * ours / theirs,
            1.0,
            format!("{ours:.0} ms over {theirs:.0} ms at 360p, both on {threads} threads"),
        );
    }
    let scalars = SIZES.map(|size| {
        let repeats = if size == SIZES[2] { 3 } else { repeats };
        (size, passes::<1>(size, repeats, best))
    });
    for (signal, times) in [("RGB", colours), ("scalar", scalars)] {
        let a_pixel = times.map(|(size, ms)| ms * 1e6 / f64::from(size.x * size.y));
        let mean = a_pixel.iter().sum::<f64>() / 3.0;
        let worst = a_pixel
            .iter()
            .map(|t| (t / mean - 1.0).abs())
            .fold(0.0, f64::max);
        goal(
            format!("SVGF, {signal}, time a pixel from 480p to 4K, away from the mean"),
            worst,
            0.15,
            format!(
                "{:.0}, {:.0} and {:.0} ns",
                a_pixel[0], a_pixel[1], a_pixel[2]
            ),
        );
    }
    out
}

/// Where the passes on adapters are timed; a software adapter takes seconds for
/// the larger ones.
pub(super) const GPU_SIZES: [UVec2; 3] = [
    UVec2::new(480, 270),
    UVec2::new(1920, 1080),
    UVec2::new(3840, 2160),
];

/// A copy is a kernel that does nothing else, over `vec4f`s.
const COPY: &str = "
@group(0) @binding(0) var<storage, read> source: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> target_: array<vec4f>;
@compute @workgroup_size(64)
fn copy(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let index = id.y * groups.x * 64u + id.x;
    if index < arrayLength(&source) {
        target_[index] = source[index];
    }
}
";

/// Timestamps, and where they can be read.
pub(super) struct Clock {
    pub(super) queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    count: u32,
}

impl Clock {
    pub(super) fn new(gpu: &Gpu, count: u32) -> Self {
        Self {
            queries: gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count,
            }),
            resolved: gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: u64::from(count) * 8,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            count,
        }
    }

    /// Writes a timestamp here.
    fn mark(&self, encoder: &mut wgpu::CommandEncoder, index: u32) {
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: &self.queries,
                beginning_of_pass_write_index: (index == 0).then_some(0),
                end_of_pass_write_index: (index == 1).then_some(1),
            }),
        });
    }

    /// Milliseconds from each even timestamp to the next.
    pub(super) fn run(&self, gpu: &Gpu, mut encoder: wgpu::CommandEncoder) -> Vec<f64> {
        encoder.resolve_query_set(&self.queries, 0..self.count, &self.resolved, 0);
        gpu.queue().submit([encoder.finish()]);
        let words = gpu.read(&self.resolved, 2 * self.count as usize);
        let ticks: Vec<u64> = words
            .chunks_exact(2)
            .map(|w| u64::from(w[0]) | u64::from(w[1]) << 32)
            .collect();
        let period = f64::from(gpu.queue().get_timestamp_period());
        ticks
            .chunks_exact(2)
            .map(|t| t[1].saturating_sub(t[0]) as f64 * period * 1e-6)
            .collect()
    }
}

/// GB a second that a copy of so many bytes reaches, reads and writes.
pub(super) fn copy_rate(gpu: &Gpu, bytes: u64, repeats: usize) -> f64 {
    let buffer = || {
        gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("copy"),
            size: bytes,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: false,
        })
    };
    2.0 * bytes as f64 * 1e-6 / copy_ms(gpu, &buffer(), &buffer(), repeats)
}

/// Milliseconds of copying a buffer, the median.
fn copy_ms(gpu: &Gpu, from: &wgpu::Buffer, to: &wgpu::Buffer, repeats: usize) -> f64 {
    let device = gpu.device();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("copy"),
        source: wgpu::ShaderSource::Wgsl(COPY.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("copy"),
        layout: None,
        module: &module,
        entry_point: Some("copy"),
        compilation_options: Default::default(),
        cache: None,
    });
    let entries = [(0, from), (1, to)].map(|(binding, buffer)| wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("copy"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &entries,
    });
    let clock = Clock::new(gpu, 2);
    let groups = (from.size() / 16).div_ceil(64) as u32;
    let rows = groups.div_ceil(65_535);
    let mut times: Vec<f64> = (0..repeats)
        .map(|_| {
            let mut encoder = device.create_command_encoder(&Default::default());
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("copy"),
                    timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                        query_set: &clock.queries,
                        beginning_of_pass_write_index: Some(0),
                        end_of_pass_write_index: Some(1),
                    }),
                });
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &group, &[]);
                pass.dispatch_workgroups(groups.div_ceil(rows), rows, 1);
            }
            clock.run(gpu, encoder)[0]
        })
        .collect();
    median(&mut times)
}

/// Numbers of each pixel, as bytes.
fn words(size: UVec2, of: &(dyn Fn(UVec2) -> Vec<f32> + Sync)) -> Vec<u8> {
    let all: Vec<UVec2> = pixels(size).collect();
    let numbers: Vec<f32> = all.par_iter().flat_map_iter(|at| of(*at)).collect();
    bytemuck::cast_slice(&numbers).to_vec()
}

/// The surfaces, and histories that are long enough.
fn write_frame(gpu: &Gpu, filter: &SvgfGpu) {
    let surfaces = words(filter.size(), &|at| {
        let s = surface(at);
        let (p, n) = (s.position, s.normal);
        vec![p.x, p.y, p.z, s.reach, n.x, n.y, n.z, 0.0]
    });
    gpu.queue().write_buffer(filter.surfaces(), 0, &surfaces);
    let history = words(filter.size(), &|_| vec![8.0]);
    gpu.queue().write_buffer(filter.history(), 0, &history);
}

/// What leaving out tiles saves on each adapter with a clock of its own: a scalar
/// of which a part is full light, finding and listing the tiles included.
pub(super) fn gpu_tiles(gpus: &[&Gpu], repeats: usize) -> Result<Vec<GoalRow>, ReportError> {
    let mut out = Vec::new();
    for gpu in gpus.iter().filter(|g| g.has_timestamps()) {
        let size = GPU_SIZES[usize::from(!gpu.is_software())];
        let new = |tiles: Option<u32>| {
            let (device, settings) = (gpu.device(), SvgfSettings::PAPER);
            let signal = SvgfSignal::Scalar;
            match tiles {
                Some(most) => SvgfGpu::with_tiles(device, size, settings, signal, most),
                None => SvgfGpu::new(device, size, settings, signal),
            }
            .map_err(ProgramError::from)
        };
        let filters = [new(None)?, new(Some(size.element_product()))?];
        for filter in &filters {
            write_frame(gpu, filter);
        }
        let clock = Clock::new(gpu, 2);
        for (share, limit) in [(0.5, 0.8), (0.9, 0.5)] {
            let edge = (f64::from(size.x) * share) as u32;
            let image = words(size, &|at| match at.x < edge {
                true => vec![1.0, 0.0],
                false => vec![value(at)[0], VARIANCE],
            });
            let mut times = [Vec::new(), Vec::new()];
            for _ in 0..repeats.max(3) {
                for (filter, times) in filters.iter().zip(&mut times) {
                    gpu.queue().write_buffer(filter.input(), 0, &image);
                    let mut encoder = gpu.device().create_command_encoder(&Default::default());
                    clock.mark(&mut encoder, 0);
                    filter.encode(&mut encoder);
                    clock.mark(&mut encoder, 1);
                    times.extend(clock.run(gpu, encoder));
                }
            }
            let [whole, some] = times.map(|mut t| median(&mut t));
            out.push(GoalRow {
                name: format!(
                    "SVGF, shadow, {:.0} % full light: tiles over the whole",
                    100.0 * share
                ),
                backend: gpu.label(),
                measured: some / whole,
                limit,
                detail: format!("{some:.1} ms over {whole:.1} ms at {} x {}", size.x, size.y),
                shader: None,
            });
        }
    }
    Ok(out)
}

/// Each pass of `SvgfGpu` on each adapter with a clock of its own, beside a
/// copy of its surfaces.
pub(super) fn gpu_passes(gpus: &[&Gpu], repeats: usize) -> Result<Vec<PassRow>, ReportError> {
    let mut out = Vec::new();
    for gpu in gpus.iter().filter(|g| g.has_timestamps()) {
        let sizes = if gpu.is_software() {
            &GPU_SIZES[..1]
        } else {
            &GPU_SIZES[1..]
        };
        for (size, (signal, name)) in sizes.iter().flat_map(|size| {
            [(SvgfSignal::Color, "RGB"), (SvgfSignal::Scalar, "scalar")].map(|s| (*size, s))
        }) {
            let filter = SvgfGpu::new(gpu.device(), size, SvgfSettings::PAPER, signal)
                .map_err(ProgramError::from)?;
            let image = words(size, &|at| match signal {
                SvgfSignal::Color => value(at).into_iter().chain([VARIANCE]).collect(),
                SvgfSignal::Scalar => vec![value(at)[0], VARIANCE],
            });
            write_frame(gpu, &filter);
            let passes = filter.passes();
            let clock = Clock::new(gpu, 2 * passes.len() as u32);
            let mut times = vec![Vec::new(); passes.len()];
            for _ in 0..repeats {
                gpu.queue().write_buffer(filter.input(), 0, &image);
                let mut encoder = gpu.device().create_command_encoder(&Default::default());
                filter.encode_timed(&mut encoder, Some(&clock.queries));
                for (times, ms) in times.iter_mut().zip(clock.run(gpu, encoder)) {
                    times.push(ms);
                }
            }
            let copy = copy_rate(gpu, filter.surfaces().size(), repeats.max(5));
            for (pass, mut times) in passes.into_iter().zip(times) {
                let ms = median(&mut times);
                out.push(PassRow {
                    backend: gpu.label(),
                    signal: format!("svgf, {name}"),
                    images: "its own buffers".into(),
                    size: size.to_array(),
                    pass: pass.name,
                    ms,
                    counted: pass.counted,
                    ideal: pass.ideal,
                    gb_s: pass.ideal as f64 * 1e-6 / ms,
                    copy_gb_s: copy,
                });
            }
        }
    }
    Ok(out)
}
