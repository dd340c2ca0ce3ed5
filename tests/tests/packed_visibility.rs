//! The bindings of filter/packed_visibility as a user runs them: a workgroup
//! makes its word, then rows, then columns.

use glam::UVec2;
use raytwin::filter::packed_visibility::{
    packed_visibility_area, packed_visibility_mean, packed_visibility_sum,
};
use raytwin::random::pcg::pcg_hash;
use raytwin_tests::gpu::{Gpu, adapters};

const SIZE: UVec2 = UVec2::new(45, 30);
const BLOCKS: UVec2 = UVec2::new(6, 8);

// Packs twice, so that a word left over from the first call would show.
const PACK: &str = "
@group(0) @binding(0) var<storage, read_write> results: array<u32>;

@compute @workgroup_size(8, 4)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) block: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let other = packed_visibility_ballot(lane, (lane & 1u) == 0u);
    let ray = pcg_hash(id.x ^ pcg_hash(id.y));
    let word = packed_visibility_ballot(lane, (ray & 1u) == 1u);
    if lane == 31u {
        let index = block.y * packed_visibility_layout.x + block.x;
        results[index] = select(0u, word, other == 0x55555555u);
    }
}";

const ROWS: &str = "
@group(0) @binding(0) var<storage, read_write> results: array<u32>;

@compute @workgroup_size(8, 4)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = packed_visibility_layout.zw;
    if all(id.xy < size) {
        results[id.y * size.x + id.x] = packed_visibility_horizontal(id.xy, size);
    }
}";

const COLUMNS: &str = "
@group(0) @binding(0) var<storage, read_write> results: array<u32>;

@compute @workgroup_size(8, 4)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let size = packed_visibility_layout.zw;
    if all(id.xy < size) {
        let sum = packed_visibility_vertical(id.xy, size);
        let mean = packed_visibility_mean(sum, packed_visibility_area(id.xy, size));
        results[id.y * size.x + id.x] = bitcast<u32>(mean);
    }
}";

fn buffer_entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}

fn run(gpu: &Gpu, main: &str, words: &[u32], rows: &[u32], count: usize) -> Vec<u32> {
    use wgpu::util::DeviceExt;
    let device = gpu.device();
    let names = ["filter/packed_visibility", "random/pcg"];
    let mut source = raytwin::wgsl::link(&names).expect("registered");
    let module = raytwin::wgsl::module(names[0]).expect("registered");
    source += module.bindings.expect("has bindings");
    source += main;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let layouts = [
        vec![buffer_entry(0, storage(false))],
        vec![
            buffer_entry(20, storage(true)),
            buffer_entry(21, storage(true)),
            buffer_entry(22, wgpu::BufferBindingType::Uniform),
        ],
    ]
    .map(|entries| {
        device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &entries,
        })
    });
    let results = gpu.buffer(&vec![0; count]);
    let (words, rows) = (gpu.buffer(words), gpu.buffer(rows));
    let sizes = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: None,
        contents: &[BLOCKS.x, BLOCKS.y, SIZE.x, SIZE.y]
            .map(u32::to_le_bytes)
            .concat(),
        usage: wgpu::BufferUsages::UNIFORM,
    });
    let group = |layout: &wgpu::BindGroupLayout, buffers: &[(u32, &wgpu::Buffer)]| {
        let entries: Vec<_> = buffers
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &entries,
        })
    };
    let own = group(&layouts[0], &[(0, &results)]);
    let data = group(&layouts[1], &[(20, &words), (21, &rows), (22, &sizes)]);
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&layouts[0]), None, Some(&layouts[1])],
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
        pass.set_bind_group(0, &own, &[]);
        pass.set_bind_group(2, &data, &[]);
        pass.dispatch_workgroups(BLOCKS.x, BLOCKS.y, 1);
    }
    gpu.queue().submit([encoder.finish()]);
    gpu.read(&results, count)
}

#[test]
fn a_workgroup_packs_and_two_passes_give_the_cpus_mean() {
    let ray = |at: UVec2| pcg_hash(at.x ^ pcg_hash(at.y)) & 1;
    let expected: Vec<u32> = (0..BLOCKS.x * BLOCKS.y)
        .map(|i| {
            let start = UVec2::new(i % BLOCKS.x * 8, i / BLOCKS.x * 4);
            (0..32)
                .map(|k| ray(start + UVec2::new(k % 8, k / 8)) << k)
                .sum()
        })
        .collect();
    let pixels = (SIZE.x * SIZE.y) as usize;
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        let words = run(gpu, PACK, &[], &[], expected.len());
        assert_eq!(words, expected, "{}", gpu.label());
        let rows = run(gpu, ROWS, &words, &[], pixels);
        let means = run(gpu, COLUMNS, &words, &rows, pixels);
        let read = |block: UVec2| expected[(block.y * BLOCKS.x + block.x) as usize];
        for (i, mean) in means.iter().enumerate() {
            let at = UVec2::new(i as u32 % SIZE.x, i as u32 / SIZE.x);
            let sum = packed_visibility_sum(at, SIZE, read);
            let want = packed_visibility_mean(sum, packed_visibility_area(at, SIZE));
            let apart = (f32::from_bits(*mean) - want).abs();
            assert!(apart <= 2.5 * f32::EPSILON * want, "{}: {at}", gpu.label());
        }
    }
}
