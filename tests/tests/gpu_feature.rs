//! What users get from the feature `gpu`, used as they would.

use glam::Vec3;
use raytwin::gpu::BvhBuffers;
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
    let device = gpu.device();
    let buffers = BvhBuffers::new(device, nodes, triangles);
    assert!(buffers.size() >= 80);
    let source =
        raytwin::wgsl::link(&["ray/bvh"]).expect("registered") + BvhBuffers::bindings_wgsl() + MAIN;
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
    let expected: Vec<BvhHit> = (0..RAYS)
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
    let hits = expected.iter().filter(|h| h.primitive != BVH_MISS).count();
    assert!(hits > 100, "only {hits} rays hit");
    for gpu in gpus {
        let words = trace(gpu, &bvh.node_words(), &bvh.triangle_words());
        let mut off = 0;
        for (hit, word) in expected.iter().zip(words.chunks_exact(4)) {
            let t = f32::from_bits(word[0]);
            off += usize::from(hit.primitive != word[3] || (hit.t - t).abs() > 1e-5 * hit.t);
        }
        // Rays along an edge may change sides where the driver fuses.
        assert!(off <= 8, "{}: {off} of {RAYS} rays differ", gpu.label());

        let nothing = trace(gpu, &[], &[]);
        assert!(
            nothing.chunks_exact(4).all(|w| w[3] == BVH_MISS),
            "{}: an empty tree was hit",
            gpu.label()
        );
    }
}
