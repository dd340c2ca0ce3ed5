//! The stages on a GPU: one compute program, one pipeline a stage.

use std::time::Instant;

use glam::Vec3;
use raytwin_tests::gpu::Gpu;

use super::cpu::milliseconds;
use super::program::{Parameters, Surface};
use super::{Stage, StageError, StageScene};

/// Most rays in one dispatch. A driver ends a dispatch that runs for seconds;
/// at a million rays a second, slower than any GPU, this takes a quarter of one.
const RAYS_A_DISPATCH: u64 = 1 << 18;

/// Most queries in a set.
const QUERIES: u32 = 4096;

const WORKGROUP: u32 = 8;

/// The modules that `program.wgsl` stands on.
const MODULES: [&str; 8] = [
    "ray/bvh",
    "ray/camera",
    "sample/basis",
    "sample/cone",
    "sample/hemisphere",
    "random/halton",
    "random/pcg",
    "math/exponent",
];

/// The program, compiled for one adapter.
pub struct GpuStages<'a> {
    gpu: &'a Gpu,
    pipelines: Vec<wgpu::ComputePipeline>,
    stage_layout: wgpu::BindGroupLayout,
    tree_layout: wgpu::BindGroupLayout,
}

/// A scene on one adapter, with the surfaces of one view.
pub(super) struct GpuRenderer<'a> {
    stages: &'a GpuStages<'a>,
    parameters: wgpu::Buffer,
    surfaces: wgpu::Buffer,
    sums: wgpu::Buffer,
    stage_group: wgpu::BindGroup,
    tree_group: wgpu::BindGroup,
}

/// The whole program as one WGSL source.
///
/// # Errors
/// If a module is not registered.
pub(super) fn source() -> Result<String, StageError> {
    let mut source = raytwin_wgsl::link(&MODULES)?;
    if let Some(bindings) = raytwin_wgsl::module("ray/bvh").and_then(|m| m.bindings) {
        source += bindings;
    }
    source += include_str!("program.wgsl");
    Ok(source)
}

impl<'a> GpuStages<'a> {
    /// Compiles every stage.
    ///
    /// # Errors
    /// If the adapter does not take the program.
    pub fn new(gpu: &'a Gpu) -> Result<Self, StageError> {
        let device = gpu.device();
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("stages"),
            source: wgpu::ShaderSource::Wgsl(source()?.into()),
        });
        let stage_layout = layout(device, &[true, true, false, false]);
        let tree_layout = layout(device, &[true, true]);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&stage_layout), None, Some(&tree_layout)],
            immediate_size: 0,
        });
        let pipelines = Stage::ALL
            .iter()
            .map(|stage| {
                device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(stage.name()),
                    layout: Some(&pipeline_layout),
                    module: &module,
                    entry_point: Some(entry_point(*stage)),
                    compilation_options: Default::default(),
                    cache: None,
                })
            })
            .collect();
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(StageError::Shader {
                adapter: gpu.label(),
                message: error.to_string(),
            });
        }
        Ok(Self {
            gpu,
            pipelines,
            stage_layout,
            tree_layout,
        })
    }

    /// The adapter.
    #[must_use]
    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }
}

impl<'a> GpuRenderer<'a> {
    pub fn new(
        stages: &'a GpuStages<'a>,
        scene: &StageScene,
        width: u32,
        height: u32,
    ) -> Result<Self, StageError> {
        let gpu = stages.gpu;
        let device = gpu.device();
        let nodes = scene.bvh.node_words();
        let triangles = scene.bvh.triangle_words();
        let mut normals = Vec::with_capacity(4 * scene.normals.len());
        for n in &scene.normals {
            normals.extend(n.to_array().map(f32::to_bits));
            normals.push(0);
        }
        // A binding may not be empty.
        normals.resize(normals.len().max(4), 0);
        let pixels = width as usize * height as usize;
        let limits = device.limits();
        let limit = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        for (what, words) in [
            ("the tree's nodes", nodes.len()),
            ("the triangles", triangles.len()),
            ("the normals", normals.len()),
            ("the picture", 8 * pixels),
        ] {
            let bytes = 4 * words as u64;
            if bytes > limit {
                return Err(StageError::TooLargeForAdapter {
                    adapter: gpu.label(),
                    what,
                    bytes,
                    limit,
                });
            }
        }
        let parameters = gpu.buffer(&[0; 36]);
        let surfaces = gpu.buffer(&vec![0; 8 * pixels]);
        // Poisoned, so that a pixel that is not written is seen.
        let sums = gpu.buffer(&vec![0xdead_beef; 3 * pixels]);
        let stage_group = group(
            device,
            &stages.stage_layout,
            &[&parameters, &gpu.buffer(&normals), &surfaces, &sums],
        );
        let tree_group = group(
            device,
            &stages.tree_layout,
            &[&gpu.buffer(&nodes), &gpu.buffer(&triangles)],
        );
        Ok(Self {
            stages,
            parameters,
            surfaces,
            sums,
            stage_group,
            tree_group,
        })
    }

    /// The surfaces that the primary stage left.
    pub fn surfaces(&self, pixels: usize) -> Vec<Surface> {
        let words = self.stages.gpu.read(&self.surfaces, 8 * pixels);
        let number = |i: usize| f32::from_bits(words[i]);
        (0..pixels)
            .map(|i| 8 * i)
            .map(|i| Surface {
                position: Vec3::new(number(i), number(i + 1), number(i + 2)),
                hit: number(i + 3) != 0.0,
                normal: Vec3::new(number(i + 4), number(i + 5), number(i + 6)),
                distance: number(i + 7),
            })
            .collect()
    }

    /// Runs a stage over the whole picture, in short dispatches: colours in
    /// the primary stage, else sums; and milliseconds.
    ///
    /// Time is that of the dispatches by GPU timestamps; on a software adapter,
    /// or one without timestamps, by the clock from the first submission until
    /// the device is idle.
    pub fn run(&mut self, stage: Stage, p: &Parameters) -> (Vec<f32>, f64) {
        let dispatches = split(p);
        let gpu = self.stages.gpu;
        let device = gpu.device();
        let queue = gpu.queue();
        let timed = gpu.has_timestamps() && !gpu.is_software();
        let mut ticks = 0.0;
        let start = Instant::now();
        for batch in dispatches.chunks(QUERIES as usize / 2) {
            let count = 2 * batch.len() as u32;
            let queries = timed.then(|| {
                device.create_query_set(&wgpu::QuerySetDescriptor {
                    label: None,
                    ty: wgpu::QueryType::Timestamp,
                    count,
                })
            });
            for (i, (part, rows)) in batch.iter().enumerate() {
                queue.write_buffer(&self.parameters, 0, bytemuck::cast_slice(&part.words()));
                let mut encoder = device.create_command_encoder(&Default::default());
                {
                    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                        label: None,
                        timestamp_writes: queries.as_ref().map(|query_set| {
                            wgpu::ComputePassTimestampWrites {
                                query_set,
                                beginning_of_pass_write_index: Some(2 * i as u32),
                                end_of_pass_write_index: Some(2 * i as u32 + 1),
                            }
                        }),
                    });
                    pass.set_pipeline(&self.stages.pipelines[stage as usize]);
                    pass.set_bind_group(0, &self.stage_group, &[]);
                    pass.set_bind_group(2, &self.tree_group, &[]);
                    pass.dispatch_workgroups(
                        p.width.div_ceil(WORKGROUP),
                        rows.div_ceil(WORKGROUP),
                        1,
                    );
                }
                queue.submit([encoder.finish()]);
            }
            if let Some(queries) = &queries {
                let resolved = device.create_buffer(&wgpu::BufferDescriptor {
                    label: None,
                    size: u64::from(count) * 8,
                    usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                });
                let mut encoder = device.create_command_encoder(&Default::default());
                encoder.resolve_query_set(queries, 0..count, &resolved, 0);
                queue.submit([encoder.finish()]);
                let words = self.stages.gpu.read(&resolved, 2 * count as usize);
                let tick = |i: usize| u64::from(words[2 * i]) | u64::from(words[2 * i + 1]) << 32;
                for i in 0..batch.len() {
                    ticks += tick(2 * i + 1).saturating_sub(tick(2 * i)) as f64;
                }
            } else {
                gpu.wait();
            }
        }
        let ms = if timed {
            ticks * f64::from(queue.get_timestamp_period()) * 1e-6
        } else {
            milliseconds(start)
        };
        let values = p.width as usize * p.height as usize * stage.channels();
        let words = self.stages.gpu.read(&self.sums, values);
        (words.into_iter().map(f32::from_bits).collect(), ms)
    }
}

/// Storage buffers, each read-only or not.
pub(crate) fn layout(device: &wgpu::Device, read_only: &[bool]) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = read_only
        .iter()
        .enumerate()
        .map(|(i, &read_only)| wgpu::BindGroupLayoutEntry {
            binding: i as u32,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &entries,
    })
}

pub(crate) fn group(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    buffers: &[&wgpu::Buffer],
) -> wgpu::BindGroup {
    let entries: Vec<_> = buffers
        .iter()
        .enumerate()
        .map(|(i, buffer)| wgpu::BindGroupEntry {
            binding: i as u32,
            resource: buffer.as_entire_binding(),
        })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout,
        entries: &entries,
    })
}

/// The parameters of each dispatch and its number of rows: bands of rows, and
/// in each band runs of samples, in order.
fn split(p: &Parameters) -> Vec<(Parameters, u32)> {
    let row = u64::from(p.width);
    let rows = (RAYS_A_DISPATCH / row / u64::from(WORKGROUP))
        .max(1)
        .min(u64::from(p.height.div_ceil(WORKGROUP))) as u32
        * WORKGROUP;
    let samples = (RAYS_A_DISPATCH / (row * u64::from(rows))).max(1) as u32;
    let mut out = Vec::new();
    for first_row in (0..p.height).step_by(rows as usize) {
        for first_sample in (0..p.sample_count).step_by(samples as usize) {
            out.push((
                Parameters {
                    first_row,
                    first_sample,
                    sample_count: samples.min(p.sample_count - first_sample),
                    ..*p
                },
                rows.min(p.height - first_row),
            ));
        }
    }
    out
}

fn entry_point(stage: Stage) -> &'static str {
    match stage {
        Stage::Primary => "stage_primary",
        Stage::HardShadow => "stage_hard_shadow",
        Stage::SoftShadow => "stage_soft_shadow",
        Stage::AmbientOcclusion => "stage_ao",
        Stage::AmbientOcclusionPower => "stage_ao_power",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::{Backend, Renderer, Sampler, StageScene};
    use raytwin_tests::scene::Scene;

    /// Every sample of every row is in one dispatch, in order, and none of
    /// them is long.
    #[test]
    fn dispatches_cover_the_picture_once() {
        let scene = StageScene::new(Scene::toy_room()).unwrap();
        let any = Renderer::new(&scene, Backend::Cpu, 1, 1, 1.0).unwrap();
        for (width, height, samples) in [
            (1, 1, 1),
            (320, 180, 300),
            (77, 41, 256),
            (40_000, 21, 3),
            (9, 4000, 5),
        ] {
            let p = Parameters {
                width,
                height,
                sampler: Sampler::Halton,
                samples,
                sample_count: samples,
                ..any.parameters
            };
            let mut next = vec![0; height as usize];
            for (part, rows) in split(&p) {
                let rays = u64::from(width) * u64::from(rows) * u64::from(part.sample_count);
                let least = u64::from(width) * u64::from(WORKGROUP);
                assert!(rays <= RAYS_A_DISPATCH.max(least), "{rays} rays");
                assert!(rows % WORKGROUP == 0 || part.first_row + rows == height);
                for row in &mut next[part.first_row as usize..(part.first_row + rows) as usize] {
                    assert_eq!(*row, part.first_sample);
                    *row += part.sample_count;
                }
            }
            assert!(next.iter().all(|n| *n == samples));
        }
    }
}
