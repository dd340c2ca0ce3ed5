//! The reflections on a GPU: the program once for each number of layers.

use std::time::Instant;

use glam::Vec3;
use raytwin_tests::gpu::Gpu;

use super::ReflectionScene;
use super::program::{Ball, Parameters};
use crate::stages::StageError;
use crate::stages::gpu::{group, layout};

const WORKGROUP: u32 = 8;

/// Words of `ReflectParameters`.
const PARAMETERS: usize = 36;

/// The modules that `program.wgsl` stands on.
const MODULES: [&str; 8] = [
    "ray/bvh",
    "ray/camera",
    "ray/sphere",
    "sample/basis",
    "random/pcg",
    "brdf/layered",
    "filter/spatial_reconstruct",
    "filter/bilateral_variance",
];

/// The passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pass {
    Surface,
    Half,
    Sum,
    Reconstruct,
    Finish,
}

impl Pass {
    const ALL: [Self; 5] = [
        Self::Surface,
        Self::Half,
        Self::Sum,
        Self::Reconstruct,
        Self::Finish,
    ];

    fn entry_point(self) -> &'static str {
        match self {
            Self::Surface => "reflect_surface",
            Self::Half => "reflect_half",
            Self::Sum => "reflect_sum",
            Self::Reconstruct => "reflect_reconstruct",
            Self::Finish => "reflect_finish",
        }
    }

    /// Whether each number of layers has its own.
    fn by_layers(self) -> bool {
        matches!(self, Self::Half | Self::Sum | Self::Reconstruct)
    }
}

/// The program, compiled for one adapter.
pub struct ReflectionGpu<'a> {
    gpu: &'a Gpu,
    /// By number of layers less one, then by pass; the passes that do not look
    /// at layers only once.
    pipelines: [Vec<Option<wgpu::ComputePipeline>>; 2],
    layout: wgpu::BindGroupLayout,
    tree_layout: wgpu::BindGroupLayout,
}

/// The whole program for this many layers as one WGSL source.
///
/// # Errors
/// If a module is not registered.
pub(super) fn source(layers: u32) -> Result<String, StageError> {
    let mut source = raytwin_wgsl::link(&MODULES)?;
    if let Some(bindings) = raytwin_wgsl::module("ray/bvh").and_then(|m| m.bindings) {
        source += bindings;
    }
    source += &format!("\nconst LAYERED_COUNT: u32 = {layers}u;\n");
    source += include_str!("program.wgsl");
    Ok(source)
}

impl<'a> ReflectionGpu<'a> {
    /// Compiles every pass.
    ///
    /// # Errors
    /// If the adapter does not take the program.
    pub fn new(gpu: &'a Gpu) -> Result<Self, StageError> {
        let device = gpu.device();
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let layout_0 = layout(device, &[true, true, true, false, false, false, false]);
        let tree_layout = layout(device, &[true, true]);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout_0), None, Some(&tree_layout)],
            immediate_size: 0,
        });
        let mut pipelines = [Vec::new(), Vec::new()];
        for (layers, pipelines) in (1..).zip(&mut pipelines) {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("reflections"),
                source: wgpu::ShaderSource::Wgsl(source(layers)?.into()),
            });
            for pass in Pass::ALL {
                let needed = layers == 1 || pass.by_layers();
                pipelines.push(needed.then(|| {
                    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                        label: Some(pass.entry_point()),
                        layout: Some(&pipeline_layout),
                        module: &module,
                        entry_point: Some(pass.entry_point()),
                        compilation_options: Default::default(),
                        cache: None,
                    })
                }));
            }
        }
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(StageError::Shader {
                adapter: gpu.label(),
                message: error.to_string(),
            });
        }
        Ok(Self {
            gpu,
            pipelines,
            layout: layout_0,
            tree_layout,
        })
    }

    /// The adapter.
    #[must_use]
    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }
}

impl Ball {
    fn words(&self) -> Vec<u32> {
        let mut out = Vec::new();
        let mut put = |v: Vec3, w: f32| {
            out.extend(v.to_array().map(f32::to_bits));
            out.push(w.to_bits());
        };
        put(self.center, self.radius);
        for layer in self.stack.layers {
            put(layer.reflectance, layer.eta);
            put(layer.depth, layer.alpha.x);
        }
        put(self.stack.diffuse, self.count as f32);
        put(self.tint, 0.0);
        for albedo in self.albedo {
            put(albedo, 0.0);
        }
        out
    }
}

impl Parameters {
    fn words(&self) -> Vec<u32> {
        let mut words = Vec::with_capacity(PARAMETERS);
        let c = &self.camera;
        for v in [c.origin, c.right, c.up, c.forward] {
            words.extend(v.to_array().map(f32::to_bits));
            words.push(0);
        }
        words.extend(c.inverse_resolution.to_array().map(f32::to_bits));
        words.extend([0, 0]);
        words.extend(self.light_direction.to_array().map(f32::to_bits));
        words.extend([self.offset, self.floor, self.checker].map(f32::to_bits));
        words.extend([
            self.width,
            self.height,
            self.balls,
            self.frame,
            self.first_row,
            self.first_sample,
            self.sample_count,
            self.neighbours,
            self.max_taps,
            self.max_radius.to_bits(),
        ]);
        words
    }
}

/// One view on one adapter.
pub(super) struct GpuReflections<'a> {
    program: &'a ReflectionGpu<'a>,
    parameters: wgpu::Buffer,
    image: wgpu::Buffer,
    bindings: wgpu::BindGroup,
    tree: wgpu::BindGroup,
}

impl<'a> GpuReflections<'a> {
    pub fn new(
        program: &'a ReflectionGpu<'a>,
        scene: &ReflectionScene<'_>,
        p: &Parameters,
    ) -> Self {
        let gpu = program.gpu;
        let device = gpu.device();
        let mut normals = Vec::with_capacity(4 * scene.scene.normals.len());
        for n in &scene.scene.normals {
            normals.extend(n.to_array().map(f32::to_bits));
            normals.push(0);
        }
        let balls: Vec<u32> = scene.balls.iter().flat_map(Ball::words).collect();
        let pixels = p.width as usize * p.height as usize;
        let half = p.width.div_ceil(2) as usize * p.height.div_ceil(2) as usize;
        let parameters = gpu.buffer(&[0; PARAMETERS]);
        let image = gpu.buffer(&vec![0; 4 * pixels]);
        let bindings = group(
            device,
            &program.layout,
            &[
                &parameters,
                &gpu.buffer(&normals),
                &gpu.buffer(&balls),
                &gpu.buffer(&vec![0; 12 * pixels]),
                // Poisoned, so that a hit that is not written is seen.
                &gpu.buffer(&vec![0x7fc0_0000; 8 * half]),
                &gpu.buffer(&vec![0; 4 * pixels]),
                &image,
            ],
        );
        let tree = group(
            device,
            &program.tree_layout,
            &[
                &gpu.buffer(&scene.scene.bvh.node_words()),
                &gpu.buffer(&scene.scene.bvh.triangle_words()),
            ],
        );
        let out = Self {
            program,
            parameters,
            image,
            bindings,
            tree,
        };
        out.run(Pass::Surface, p);
        out
    }

    /// Runs a pass, for every number of layers: milliseconds.
    pub fn run(&self, pass: Pass, p: &Parameters) -> f64 {
        let gpu = self.program.gpu;
        let (device, queue) = (gpu.device(), gpu.queue());
        let timed = gpu.has_timestamps() && !gpu.is_software();
        queue.write_buffer(&self.parameters, 0, bytemuck::cast_slice(&p.words()));
        let queries = timed.then(|| {
            device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            })
        });
        let (width, height) = if pass == Pass::Half {
            (p.width.div_ceil(2), p.height.div_ceil(2))
        } else {
            (p.width, p.height)
        };
        gpu.wait();
        let start = Instant::now();
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: None,
                timestamp_writes: queries.as_ref().map(|query_set| {
                    wgpu::ComputePassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: Some(0),
                        end_of_pass_write_index: Some(1),
                    }
                }),
            });
            compute.set_bind_group(0, &self.bindings, &[]);
            compute.set_bind_group(2, &self.tree, &[]);
            for pipelines in &self.program.pipelines {
                if let Some(pipeline) = &pipelines[pass as usize] {
                    compute.set_pipeline(pipeline);
                    compute.dispatch_workgroups(
                        width.div_ceil(WORKGROUP),
                        height.div_ceil(WORKGROUP),
                        1,
                    );
                }
            }
        }
        queue.submit([encoder.finish()]);
        let Some(queries) = queries else {
            gpu.wait();
            return start.elapsed().as_secs_f64() * 1e3;
        };
        let resolved = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 16,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.resolve_query_set(&queries, 0..2, &resolved, 0);
        queue.submit([encoder.finish()]);
        let words = gpu.read(&resolved, 4);
        let tick = |i: usize| u64::from(words[2 * i]) | u64::from(words[2 * i + 1]) << 32;
        let ticks = tick(1).saturating_sub(tick(0)) as f64;
        ticks * f64::from(queue.get_timestamp_period()) * 1e-6
    }

    /// The image, linear.
    pub fn image(&self, p: &Parameters) -> Vec<Vec3> {
        let words = self
            .program
            .gpu
            .read(&self.image, 4 * p.width as usize * p.height as usize);
        words
            .chunks_exact(4)
            .map(|c| {
                Vec3::new(
                    f32::from_bits(c[0]),
                    f32::from_bits(c[1]),
                    f32::from_bits(c[2]),
                )
            })
            .collect()
    }
}
