//! A kernel's description as a compute pipeline.

use std::collections::BTreeMap;

use raytwin::contract::{Kernel, TypeInfo};

use super::{Gpu, spirv};

/// Which of the two pipelines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Build {
    /// The WGSL as users run it: the driver may rewrite float algebra.
    Plain,
    /// The same program with `NoContraction` on every float operation.
    Precise,
}

/// A kernel ready to run on one adapter.
pub struct Program<'a> {
    gpu: &'a Gpu,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    fixture: wgpu::Buffer,
    words_in: usize,
    words_out: usize,
}

/// Why a kernel's shader was not made.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    /// The WGSL module of the kernel is not registered.
    #[error(transparent)]
    Link(#[from] raytwin::wgsl::LinkError),
    /// naga does not take the source.
    #[error("{kernel}: {message}")]
    Shader {
        /// Which kernel.
        kernel: String,
        /// naga's message with the place.
        message: String,
    },
    /// The adapter takes no SPIR-V directly.
    #[error("{adapter} has no passthrough for SPIR-V, which the precise build needs")]
    NoPassthrough {
        /// Which adapter.
        adapter: String,
    },
}

const WORKGROUP: u32 = 64;

/// The generated compute shader that runs `function` over arrays of `inputs`.
///
/// `library` must define the function (and its callbacks, which may read
/// `raytwin_fixture`).
#[must_use]
pub fn shader_source(
    library: &str,
    function: &str,
    inputs: &[(&'static str, TypeInfo)],
    output: &TypeInfo,
) -> String {
    let words_in: usize = inputs.iter().map(|i| i.1.words()).sum();
    let words_out = output.words();
    let mut next = 0;
    let arguments: Vec<_> = inputs
        .iter()
        .map(|(_, ty)| ty.construct(&|i| format!("raytwin_input[raytwin_at + {i}u]"), &mut next))
        .collect();
    let stores: String = output
        .lanes("raytwin_result")
        .iter()
        .enumerate()
        .map(|(i, (path, _))| {
            format!("    raytwin_output[raytwin_i * {words_out}u + {i}u] = bitcast<u32>({path});\n")
        })
        .collect();
    format!(
        "{library}
@group(0) @binding(0) var<storage, read> raytwin_input: array<u32>;
@group(0) @binding(1) var<storage, read_write> raytwin_output: array<u32>;
@group(0) @binding(2) var<storage, read> raytwin_fixture: array<u32>;

@compute @workgroup_size({WORKGROUP})
fn raytwin_main(
    @builtin(global_invocation_id) raytwin_id: vec3u,
    @builtin(num_workgroups) raytwin_groups: vec3u,
) {{
    let raytwin_i = raytwin_id.y * (raytwin_groups.x * {WORKGROUP}u) + raytwin_id.x;
    if raytwin_i >= arrayLength(&raytwin_output) / {words_out}u {{
        return;
    }}
    let raytwin_at = raytwin_i * {words_in}u + min(raytwin_fixture[0], 0u);
    let raytwin_result = {function}({});
{stores}}}
",
        arguments.join(", ")
    )
}

impl<'a> Program<'a> {
    /// Compiles a kernel.
    ///
    /// # Errors
    /// If the source does not link or compile, or the build is not available.
    pub fn new(gpu: &'a Gpu, kernel: &Kernel, build: Build) -> Result<Self, ProgramError> {
        Self::with_function(gpu, kernel, build, kernel.name, "")
    }

    /// Compiles another function of the kernel's signature, from `extra`
    /// source after the kernel's own: a [baseline].
    ///
    /// [baseline]: raytwin::contract::Baseline
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_function(
        gpu: &'a Gpu,
        kernel: &Kernel,
        build: Build,
        function: &str,
        extra: &str,
    ) -> Result<Self, ProgramError> {
        let mut library = raytwin::wgsl::link(&[kernel.module])?;
        if let Some(fixture) = &kernel.fixture {
            library += fixture.wgsl;
        }
        library += extra;
        let source = shader_source(&library, function, &kernel.inputs, &kernel.output);
        let module = shader_module(gpu, &kernel.path(), &source, build)?;
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
        let layout = gpu
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: None,
                entries: &[entry(0, true), entry(1, false), entry(2, true)],
            });
        let pipeline_layout = gpu
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
        let pipeline = gpu
            .device
            .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(kernel.name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some("raytwin_main"),
                compilation_options: Default::default(),
                cache: None,
            });
        let fixture = gpu.buffer(kernel.fixture.as_ref().map_or(&[], |f| &f.words[..]));
        Ok(Self {
            gpu,
            pipeline,
            layout,
            fixture,
            words_in: kernel.words_in(),
            words_out: kernel.words_out(),
        })
    }

    /// Runs the kernel over an array of argument lists and reads the results.
    #[must_use]
    pub fn run(&self, input: &[u32]) -> Vec<u32> {
        let per_batch = self.batch();
        let mut out = Vec::with_capacity(input.len() / self.words_in * self.words_out);
        for chunk in input.chunks(per_batch * self.words_in) {
            let count = chunk.len() / self.words_in;
            let (group, output) = self.bind(chunk, count);
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            self.encode(&mut encoder, &group, count, None);
            self.gpu.queue.submit([encoder.finish()]);
            out.extend(self.gpu.read(&output, count * self.words_out));
        }
        out
    }

    /// Nanoseconds for one element, the median of `repeats` dispatches over
    /// the same array: by GPU timestamps where the adapter has them, else by
    /// wall clock around submit and wait.
    #[must_use]
    pub fn time(&self, input: &[u32], repeats: usize) -> f64 {
        let count = (input.len() / self.words_in).min(self.batch());
        let (group, _output) = self.bind(&input[..count * self.words_in], count);
        let mut times: Vec<f64> = (0..=repeats)
            .map(|_| self.time_once(&group, count))
            .collect();
        // The first one compiles.
        times.remove(0);
        times.sort_by(f64::total_cmp);
        times[times.len() / 2] / count as f64
    }

    /// How many elements fit one dispatch and one binding.
    fn batch(&self) -> usize {
        let widest = self.words_in.max(self.words_out) * 4;
        let limit = self.gpu.device.limits().max_storage_buffer_binding_size;
        (usize::try_from(limit).unwrap_or(usize::MAX) / widest).min(1 << 24)
    }

    fn bind(&self, input: &[u32], count: usize) -> (wgpu::BindGroup, wgpu::Buffer) {
        let input = self.gpu.buffer(input);
        // Poisoned, so that an element that is not written is seen.
        let output = self
            .gpu
            .buffer(&vec![0xdead_beef_u32; count * self.words_out]);
        let buffers = [&input, &output, &self.fixture];
        let entries = [0, 1, 2].map(|i| wgpu::BindGroupEntry {
            binding: i as u32,
            resource: buffers[i].as_entire_binding(),
        });
        let group = self
            .gpu
            .device
            .create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &self.layout,
                entries: &entries,
            });
        (group, output)
    }

    fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        group: &wgpu::BindGroup,
        count: usize,
        timestamps: Option<&wgpu::QuerySet>,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes: timestamps.map(|query_set| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            }),
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        let groups = (count as u32).div_ceil(WORKGROUP).max(1);
        // One row holds at most 65535 groups.
        let rows = groups.div_ceil(65_535);
        pass.dispatch_workgroups(groups.div_ceil(rows), rows, 1);
    }

    fn time_once(&self, group: &wgpu::BindGroup, count: usize) -> f64 {
        let device = &self.gpu.device;
        let mut encoder = device.create_command_encoder(&Default::default());
        if !self.gpu.timestamps {
            self.encode(&mut encoder, group, count, None);
            let start = std::time::Instant::now();
            self.gpu.queue.submit([encoder.finish()]);
            self.gpu.wait();
            return start.elapsed().as_nanos() as f64;
        }
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        let resolved = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 16,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        self.encode(&mut encoder, group, count, Some(&queries));
        encoder.resolve_query_set(&queries, 0..2, &resolved, 0);
        self.gpu.queue.submit([encoder.finish()]);
        let words = self.gpu.read(&resolved, 4);
        let tick = |i: usize| u64::from(words[2 * i]) | u64::from(words[2 * i + 1]) << 32;
        tick(1).saturating_sub(tick(0)) as f64 * f64::from(self.gpu.queue.get_timestamp_period())
    }
}

/// Compiles WGSL in one of the two builds. The precise one is also given to
/// wgpu as plain WGSL first, since passthrough skips wgpu's validation.
pub(crate) fn shader_module(
    gpu: &Gpu,
    name: &str,
    source: &str,
    build: Build,
) -> Result<wgpu::ShaderModule, ProgramError> {
    entry_module(gpu, name, source, build, "raytwin_main")
}

/// Compiles one entry point of a WGSL program in one of the two builds. Each of
/// its groups must have its bindings numbered from 0 on.
///
/// # Errors
/// If the program does not compile, or the adapter takes no SPIR-V.
pub fn entry_module(
    gpu: &Gpu,
    name: &str,
    source: &str,
    build: Build,
    entry: &str,
) -> Result<wgpu::ShaderModule, ProgramError> {
    placed_module(gpu, name, source, entry, BTreeMap::new(), build)
}

/// A pass of the feature `gpu` in one of the two builds: give it to the pass's
/// `with_compiler`.
///
/// # Errors
/// If the program does not compile, or the adapter takes no SPIR-V.
pub fn pass_module(
    gpu: &Gpu,
    program: &raytwin::pass::image::PassProgram<'_>,
    build: Build,
) -> Result<wgpu::ShaderModule, ProgramError> {
    let places = (0..).zip(program.bindings).map(|(place, &binding)| {
        let known = naga::ResourceBinding { group: 2, binding };
        let seen = naga::back::spv::BindingInfo {
            descriptor_set: 2,
            binding: place,
            binding_array_size: None,
        };
        (known, seen)
    });
    let name = program.entry;
    placed_module(gpu, name, program.source, name, places.collect(), build)
}

fn placed_module(
    gpu: &Gpu,
    name: &str,
    source: &str,
    entry: &str,
    places: naga::back::spv::BindingMap,
    build: Build,
) -> Result<wgpu::ShaderModule, ProgramError> {
    let shader_error = |message: String| ProgramError::Shader {
        kernel: name.into(),
        message,
    };
    let module =
        naga::front::wgsl::parse_str(source).map_err(|e| shader_error(e.emit_to_string(source)))?;
    let info = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::empty(),
    )
    .validate(&module)
    .map_err(|e| shader_error(e.emit_to_string(source)))?;
    if build == Build::Plain {
        return Ok(gpu
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            }));
    }
    if !gpu.precise {
        return Err(ProgramError::NoPassthrough {
            adapter: gpu.label(),
        });
    }
    let entry = module
        .entry_points
        .iter()
        .find(|e| e.name == entry)
        .ok_or_else(|| shader_error(format!("there is no entry point `{entry}`")))?;
    let words = naga::back::spv::write_vec(
        &module,
        &info,
        &naga::back::spv::Options {
            lang_version: (1, 3),
            binding_map: places,
            ..Default::default()
        },
        Some(&naga::back::spv::PipelineOptions {
            shader_stage: naga::ShaderStage::Compute,
            entry_point: entry.name.clone(),
        }),
    )
    .map_err(|e| shader_error(e.to_string()))?;
    let words = spirv::no_contraction(&words);
    // SAFETY: naga validated the module and wrote the SPIR-V; the decorations
    // added since change no instruction.
    Ok(unsafe {
        gpu.device
            .create_shader_module_passthrough(wgpu::ShaderModuleDescriptorPassthrough {
                label: Some(name),
                entry_points: std::borrow::Cow::Owned(vec![wgpu::PassthroughShaderEntryPoint {
                    name: entry.name.clone().into(),
                    workgroup_size: entry.workgroup_size.into(),
                }]),
                spirv: Some(words.into()),
                ..Default::default()
            })
    })
}
