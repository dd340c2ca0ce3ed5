//! The WGSL traversal over arrays of rays.

use std::time::Instant;

use raytwin::gpu::BvhBuffers;
use raytwin::ray::bvh_build::Bvh;
use raytwin_cpu::ray::bvh::BVH_MISS;
use raytwin_cpu::ray::ray::Ray;
use raytwin_tests::gpu::Gpu;

use super::error::ReportError;

/// Rays in one dispatch: a driver ends one that runs for seconds.
const RAYS_A_DISPATCH: usize = 1 << 18;

/// Where a ray's stack lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stack {
    /// In the function, as the kernel has it.
    Function,
    /// In variables of the invocation.
    Private,
    /// In the workgroup's memory.
    Workgroup,
}

impl Stack {
    pub const ALL: [Self; 3] = [Self::Function, Self::Private, Self::Workgroup];

    pub fn name(self) -> &'static str {
        match self {
            Self::Function => "function",
            Self::Private => "private",
            Self::Workgroup => "workgroup",
        }
    }

    /// The kernel's text with its stack there; `None` if it has changed so that
    /// its stack is not found.
    fn place(self, kernel: &str, workgroup: u32) -> Option<String> {
        const NODE: &str = "    var stack_node: array<u32, BVH_STACK>;\n";
        const ENTER: &str = "    var stack_enter: array<f32, BVH_STACK>;\n";
        if !kernel.contains(NODE) || !kernel.contains(ENTER) {
            return None;
        }
        let without = || kernel.replace(NODE, "").replace(ENTER, "");
        Some(match self {
            Self::Function => kernel.into(),
            Self::Private => {
                without()
                    + "var<private> stack_node: array<u32, BVH_STACK>;\n\
                       var<private> stack_enter: array<f32, BVH_STACK>;\n"
            }
            Self::Workgroup => {
                without()
                    .replace("stack_node[", "stack_node[traversal_lane][")
                    .replace("stack_enter[", "stack_enter[traversal_lane][")
                    + &format!(
                        "var<workgroup> stack_node: array<array<u32, BVH_STACK>, {workgroup}>;\n\
                         var<workgroup> stack_enter: array<array<f32, BVH_STACK>, {workgroup}>;\n"
                    )
            }
        })
    }
}

/// Rays of a workgroup.
pub(super) const WORKGROUP: u32 = 64;

/// Rays of a workgroup whose stacks fit 16 KiB, the least that WebGPU promises.
pub(super) const SMALL_WORKGROUP: u32 = 32;

/// Both pipelines, compiled for one adapter.
pub(super) struct Traversal<'a> {
    gpu: &'a Gpu,
    closest: wgpu::ComputePipeline,
    any: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    workgroup: u32,
}

/// A mesh on one adapter.
pub(super) struct TraversalMesh<'a> {
    traversal: &'a Traversal<'a>,
    buffers: BvhBuffers,
}

impl<'a> Traversal<'a> {
    /// With the stack there, and so many rays a workgroup.
    pub fn new(gpu: &'a Gpu, stack: Stack, workgroup: u32) -> Result<Self, ReportError> {
        let failed = |message: String| ReportError::Traversal {
            adapter: gpu.label(),
            message,
        };
        let device = gpu.device();
        let kernel = raytwin_wgsl::link(&["ray/bvh"]).map_err(|e| failed(e.to_string()))?;
        let kernel = stack
            .place(&kernel, workgroup)
            .ok_or_else(|| failed("the stack of ray/bvh is not where it was".into()))?;
        let source = kernel
            + BvhBuffers::bindings_wgsl()
            + &format!("const TRAVERSAL_WORKGROUP: u32 = {workgroup}u;\n")
            + include_str!("traversal.wgsl");
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("traversal"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let entry = |binding, read_only| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &[entry(0, true), entry(1, false)],
        });
        // The tree's layout is the same for every mesh.
        let tree = BvhBuffers::new(device, &[], &[]);
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout), None, Some(tree.layout())],
            immediate_size: 0,
        });
        let pipeline = |entry_point| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let (closest, any) = (pipeline("traversal_closest"), pipeline("traversal_any"));
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(failed(error.to_string()));
        }
        Ok(Self {
            gpu,
            closest,
            any,
            layout,
            workgroup,
        })
    }

    pub fn gpu(&self) -> &'a Gpu {
        self.gpu
    }

    pub fn mesh(&'a self, bvh: &Bvh) -> TraversalMesh<'a> {
        TraversalMesh {
            traversal: self,
            buffers: BvhBuffers::new(self.gpu.device(), &bvh.node_words(), &bvh.triangle_words()),
        }
    }
}

fn words(rays: &[Ray]) -> Vec<u32> {
    rays.iter()
        .flat_map(|r| {
            let [ox, oy, oz] = r.origin.to_array();
            let [dx, dy, dz] = r.direction.to_array();
            [ox, oy, oz, r.t_min, dx, dy, dz, r.t_max].map(f32::to_bits)
        })
        .collect()
}

impl TraversalMesh<'_> {
    /// The closest hit of each ray.
    pub fn closest(&self, rays: &[Ray]) -> Vec<Option<(f32, u32)>> {
        self.run(rays, false)
            .0
            .chunks_exact(2)
            .map(|w| (w[1] != BVH_MISS).then(|| (f32::from_bits(w[0]), w[1])))
            .collect()
    }

    /// Seconds for all rays, and how many of them hit something.
    pub fn time(&self, rays: &[Ray], any: bool) -> (f64, usize) {
        let (hits, seconds) = self.run(rays, any);
        let miss = if any { 0 } else { BVH_MISS };
        (
            seconds,
            hits.chunks_exact(2).filter(|w| w[1] != miss).count(),
        )
    }

    fn run(&self, rays: &[Ray], any: bool) -> (Vec<u32>, f64) {
        let gpu = self.traversal.gpu;
        let (mut hits, mut seconds) = (Vec::with_capacity(2 * rays.len()), 0.0);
        for rays in rays.chunks(RAYS_A_DISPATCH) {
            let input = gpu.buffer(&words(rays));
            let output = gpu.buffer(&vec![0xdead_beef; 2 * rays.len()]);
            seconds += self.dispatch(&input, &output, rays.len() as u32, any);
            hits.extend(gpu.read(&output, 2 * rays.len()));
        }
        (hits, seconds)
    }

    /// Seconds of one dispatch, by the device's clock where it has one.
    fn dispatch(&self, input: &wgpu::Buffer, output: &wgpu::Buffer, count: u32, any: bool) -> f64 {
        let Traversal {
            gpu,
            closest,
            any: any_pipeline,
            layout,
            workgroup,
        } = self.traversal;
        let device = gpu.device();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: input.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: output.as_entire_binding(),
                },
            ],
        });
        let queries = gpu.has_timestamps().then(|| {
            device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            })
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: None,
                timestamp_writes: queries.as_ref().map(|query_set| {
                    wgpu::ComputePassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: Some(0),
                        end_of_pass_write_index: Some(1),
                    }
                }),
            });
            pass.set_pipeline(if any { any_pipeline } else { closest });
            pass.set_bind_group(0, &group, &[]);
            pass.set_bind_group(BvhBuffers::GROUP, self.buffers.bind_group(), &[]);
            let groups = count.div_ceil(*workgroup).max(1);
            let rows = groups.div_ceil(65_535);
            pass.dispatch_workgroups(groups.div_ceil(rows), rows, 1);
        }
        let Some(queries) = queries else {
            gpu.wait();
            let start = Instant::now();
            gpu.queue().submit([encoder.finish()]);
            gpu.wait();
            return start.elapsed().as_secs_f64();
        };
        let resolved = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 16,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        encoder.resolve_query_set(&queries, 0..2, &resolved, 0);
        gpu.queue().submit([encoder.finish()]);
        let words = gpu.read(&resolved, 4);
        let tick = |i: usize| u64::from(words[2 * i]) | u64::from(words[2 * i + 1]) << 32;
        let ticks = tick(1).saturating_sub(tick(0)) as f64;
        ticks * f64::from(gpu.queue().get_timestamp_period()) * 1e-9
    }
}
