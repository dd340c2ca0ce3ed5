//! What `gi/surfel_grid` promises beyond its contract: the four passes give the
//! lists of the processor, on every adapter, and stay within their buffers.

use glam::{UVec3, Vec3};
use raytwin::cpu::pass::surfel_grid::SurfelGridPass;
use raytwin::gi::surfel::Surfel;
use raytwin::gi::surfel_grid::SurfelGrid;
use raytwin::random::pcg::{pcg_hash, pcg_unit};
use raytwin_tests::gpu::{Gpu, adapters};

const SLOTS: u32 = 1021;
/// Words behind the capacity that must stay as they were.
const GUARD: usize = 64;
const UNTOUCHED: u32 = 0xdead_beef;

fn cloud(count: u32) -> Vec<Surfel> {
    let random = |i: u32| pcg_unit(pcg_hash(i));
    (0..count)
        .map(|i| {
            let at = |k: u32| random(i * 8 + k);
            Surfel {
                position: Vec3::new(at(0), at(1), at(2)) * 6.0 - 3.0,
                // One in 128 too large for its cells, one without a radius.
                radius: match i % 128 {
                    5 => 20.0,
                    6 => 0.0,
                    _ => 0.1 + 0.1 * at(3),
                },
                normal: Vec3::new(at(4) - 0.5, at(5) - 0.5, at(6) + 0.1).normalize(),
                mesh: i,
            }
        })
        .collect()
}

/// First, length, entries (with the guard), and what was lost.
type Lists = (Vec<u32>, Vec<u32>, Vec<u32>, Vec<u32>);

fn build(gpu: &Gpu, surfels: &[Surfel], grid: SurfelGrid, capacity: u32) -> Lists {
    let device = gpu.device();
    let source = raytwin::wgsl::link(&["gi/surfel_grid"]).expect("registered")
        + raytwin::wgsl::module("gi/surfel")
            .and_then(|m| m.bindings)
            .expect("has bindings")
        + raytwin::wgsl::pass::SURFEL_GRID;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let words: Vec<u32> = surfels
        .iter()
        .flat_map(|s| {
            let (p, n) = (s.position, s.normal);
            let bits = [p.x, p.y, p.z, s.radius, n.x, n.y, n.z].map(f32::to_bits);
            bits.into_iter().chain([s.mesh])
        })
        .collect();
    let values = gpu.buffer(&words);
    let o = grid.origin;
    let settings: Vec<u8> = [o.x, o.y, o.z, grid.inverse_cell]
        .map(f32::to_bits)
        .into_iter()
        .chain([grid.size.x, grid.size.y, grid.size.z, grid.slots])
        .chain([grid.inverse_reach.to_bits(), 0, 0, 0])
        .chain([surfels.len() as u32, capacity, 0, 0])
        .flat_map(u32::to_le_bytes)
        .collect();
    let uniform = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: settings.len() as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.queue().write_buffer(&uniform, 0, &settings);
    let slots = grid.slots as usize;
    let room = capacity as usize + GUARD;
    let first = gpu.buffer(&vec![0; slots]);
    let counts = gpu.buffer(&vec![0; slots]);
    let entries = gpu.buffer(&vec![UNTOUCHED; room]);
    let lost = gpu.buffer(&[0; 2]);
    let lengths = gpu.buffer(&vec![0; slots]);
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let buffers = [
        (wgpu::BufferBindingType::Uniform, &uniform),
        (storage(true), &values),
        (storage(false), &first),
        (storage(false), &counts),
        (storage(false), &entries),
        (storage(false), &lost),
        (storage(false), &lengths),
    ];
    let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &(0u32..)
            .zip(&buffers)
            .map(|(binding, b)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: b.0,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect::<Vec<_>>(),
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &(0u32..)
            .zip(&buffers)
            .map(|(binding, b)| wgpu::BindGroupEntry {
                binding,
                resource: b.1.as_entire_binding(),
            })
            .collect::<Vec<_>>(),
    });
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&layout)],
        immediate_size: 0,
    });
    let each = (surfels.len() as u32).div_ceil(64);
    let mut encoder = device.create_command_encoder(&Default::default());
    for (entry, groups) in [
        ("surfel_grid_pass_count", each),
        ("surfel_grid_pass_sum", 1),
        ("surfel_grid_pass_scatter", each),
        ("surfel_grid_pass_sort", grid.slots.div_ceil(64)),
    ] {
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            cache: None,
        });
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(groups, 1, 1);
    }
    gpu.queue().submit([encoder.finish()]);
    (
        gpu.read(&first, slots),
        gpu.read(&lengths, slots),
        gpu.read(&entries, room),
        gpu.read(&lost, 2),
    )
}

#[test]
fn passes_give_the_lists_of_the_processor() {
    let hashed = SurfelGrid {
        origin: Vec3::ZERO,
        inverse_cell: 3.0,
        size: UVec3::ZERO,
        slots: SLOTS,
        inverse_reach: 0.0,
    };
    let levels = SurfelGrid {
        inverse_reach: 1.0,
        ..hashed
    };
    let dense = SurfelGrid {
        origin: Vec3::splat(-3.0),
        size: UVec3::splat(18),
        slots: 18 * 18 * 18,
        ..hashed
    };
    // Hundreds in a list. (Of thousands Mesa would cut the sort: its loops end
    // after 65,535 rounds.)
    let crowded = SurfelGrid {
        slots: 29,
        ..hashed
    };
    let surfels = cloud(5000);
    for gpu in adapters().expect("an adapter") {
        for grid in [hashed, levels, dense, crowded] {
            for capacity in [1 << 18, 9000, 0] {
                let mut cpu = SurfelGridPass::new(grid, capacity);
                cpu.build(&surfels);
                let (first, lengths, entries, lost) = build(gpu, &surfels, grid, capacity);
                let label = format!("{}, {grid:?}, {capacity}", gpu.label());
                assert_eq!(first, cpu.firsts(), "{label}");
                assert_eq!(lengths, cpu.counts(), "{label}");
                for (at, count) in first.iter().zip(&lengths).filter(|l| *l.1 > 0) {
                    let list = *at as usize..(at + count) as usize;
                    assert_eq!(entries[list.clone()], cpu.entries()[list], "{label}");
                }
                let guard = &entries[capacity as usize..];
                assert!(guard.iter().all(|w| *w == UNTOUCHED), "{label}");
                assert_eq!(lost, [cpu.dropped(), cpu.homeless()], "{label}");
                assert_eq!(cpu.dropped() == 0, capacity == 1 << 18, "{label}");
            }
        }
    }
}
