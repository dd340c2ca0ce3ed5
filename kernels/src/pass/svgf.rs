//! `filter/svgf` over whole images: on the CPU, and with the feature `gpu` as
//! wgpu passes.

pub use raytwin_cpu::pass::svgf::*;

#[cfg(feature = "gpu")]
pub use gpu::{SvgfGpu, SvgfGpuPass, SvgfSignal};

#[cfg(feature = "gpu")]
mod gpu {
    use glam::UVec2;
    use wgpu::util::DeviceExt;

    use crate::filter::svgf::SvgfSettings;

    const WORKGROUP: u32 = 8;

    /// What is filtered.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum SvgfSignal {
        /// Three channels: `vec4f` a pixel, the variance last.
        Color,
        /// One channel: `vec2f` a pixel, the variance last.
        Scalar,
    }

    impl SvgfSignal {
        fn texel(self) -> u64 {
            match self {
                Self::Color => 16,
                Self::Scalar => 8,
            }
        }
    }

    /// SVGF's spatial half as compute passes, for a device and a size.
    ///
    /// It owns its buffers. Your own passes (or `Queue::write_buffer`) fill
    /// [`Self::surfaces`], [`Self::history`] and [`Self::input`];
    /// [`Self::encode`] puts the filter into your command encoder; your passes
    /// read [`Self::output`], and next frame's accumulation reads
    /// [`Self::feedback`]. Nothing is submitted and nothing read back.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device, queue: &wgpu::Queue)
    /// #     -> Result<(), raytwin::wgsl::LinkError> {
    /// use glam::UVec2;
    /// use raytwin::filter::svgf::SvgfSettings;
    /// use raytwin::pass::svgf::{SvgfGpu, SvgfSignal};
    ///
    /// let size = UVec2::new(1920, 1080);
    /// let filter = SvgfGpu::new(device, size, SvgfSettings::PAPER, SvgfSignal::Color)?;
    /// let mut encoder = device.create_command_encoder(&Default::default());
    /// // ... your passes write filter.surfaces(), filter.history(), filter.input() ...
    /// filter.encode(&mut encoder);
    /// // ... and read filter.output() ...
    /// queue.submit([encoder.finish()]);
    /// # Ok(())
    /// # }
    /// ```
    #[derive(Debug)]
    pub struct SvgfGpu {
        size: UVec2,
        settings: SvgfSettings,
        signal: SvgfSignal,
        variance: wgpu::ComputePipeline,
        atrous: wgpu::ComputePipeline,
        layout: wgpu::BindGroupLayout,
        buffers: Buffers,
    }

    #[derive(Debug)]
    struct Buffers {
        surfaces: wgpu::Buffer,
        history: wgpu::Buffer,
        /// The image, and the one that passes write in turn with it.
        images: [wgpu::Buffer; 2],
        feedback: wgpu::Buffer,
        /// The variance's, then one for each pass.
        groups: Vec<wgpu::BindGroup>,
    }

    impl SvgfGpu {
        /// Compiles the passes and makes the buffers. Each side of `size` counts
        /// as 1 at least; at most 16 passes.
        ///
        /// # Errors
        /// If a module that the passes stand on is not registered.
        pub fn new(
            device: &wgpu::Device,
            size: UVec2,
            settings: SvgfSettings,
            signal: SvgfSignal,
        ) -> Result<Self, raytwin_wgsl::LinkError> {
            let source = raytwin_wgsl::link(&["filter/svgf"])?
                + match signal {
                    SvgfSignal::Color => raytwin_wgsl::pass::SVGF_COLOR,
                    SvgfSignal::Scalar => raytwin_wgsl::pass::SVGF_SCALAR,
                };
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("raytwin svgf"),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
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
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("raytwin svgf"),
                entries: &[
                    entry(0, wgpu::BufferBindingType::Uniform),
                    entry(1, storage(true)),
                    entry(2, storage(true)),
                    entry(3, storage(true)),
                    entry(4, storage(false)),
                ],
            });
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("raytwin svgf"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            let pipeline = |name| {
                device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(name),
                    layout: Some(&pipeline_layout),
                    module: &module,
                    entry_point: Some(name),
                    compilation_options: Default::default(),
                    cache: None,
                })
            };
            let size = size.max(UVec2::ONE);
            let settings = SvgfSettings {
                passes: settings.passes.min(16),
                ..settings
            };
            Ok(Self {
                size,
                settings,
                signal,
                variance: pipeline("svgf_pass_variance"),
                atrous: pipeline("svgf_pass_atrous"),
                buffers: Buffers::new(device, &layout, size, settings, signal),
                layout,
            })
        }

        /// New buffers for another size; the pipelines stay.
        pub fn resize(&mut self, device: &wgpu::Device, size: UVec2) {
            self.size = size.max(UVec2::ONE);
            self.buffers =
                Buffers::new(device, &self.layout, self.size, self.settings, self.signal);
        }

        /// Width and height.
        #[must_use]
        pub fn size(&self) -> UVec2 {
            self.size
        }

        /// Two `vec4f` a pixel: position and reach, normal and 0. A reach of 0
        /// says that there is no surface.
        #[must_use]
        pub fn surfaces(&self) -> &wgpu::Buffer {
            &self.buffers.surfaces
        }

        /// Frames that each pixel has accumulated, an `f32`: where they are
        /// fewer than the settings' `history` the variance is estimated over the
        /// image.
        #[must_use]
        pub fn history(&self) -> &wgpu::Buffer {
            &self.buffers.history
        }

        /// The noisy image, with the variance of its luminance last.
        #[must_use]
        pub fn input(&self) -> &wgpu::Buffer {
            &self.buffers.images[0]
        }

        /// The filtered image and its variance. It may be the same buffer as
        /// [`Self::input`].
        #[must_use]
        pub fn output(&self) -> &wgpu::Buffer {
            // The variance's pass is one more.
            &self.buffers.images[(self.settings.passes as usize + 1) % 2]
        }

        /// The image after the pass whose output becomes the history.
        #[must_use]
        pub fn feedback(&self) -> &wgpu::Buffer {
            &self.buffers.feedback
        }

        /// Encodes the variance and all passes.
        pub fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
            self.encode_timed(encoder, None);
        }

        /// As [`Self::encode`]; pass `i` of [`Self::passes`] writes its beginning
        /// and its end to the timestamps `2 * i` and `2 * i + 1`.
        pub fn encode_timed(
            &self,
            encoder: &mut wgpu::CommandEncoder,
            timestamps: Option<&wgpu::QuerySet>,
        ) {
            for (i, group) in self.buffers.groups.iter().enumerate() {
                {
                    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                        label: Some("raytwin svgf"),
                        timestamp_writes: timestamps.map(|query_set| {
                            wgpu::ComputePassTimestampWrites {
                                query_set,
                                beginning_of_pass_write_index: Some(2 * i as u32),
                                end_of_pass_write_index: Some(2 * i as u32 + 1),
                            }
                        }),
                    });
                    pass.set_pipeline(if i == 0 { &self.variance } else { &self.atrous });
                    pass.set_bind_group(0, group, &[]);
                    pass.dispatch_workgroups(
                        self.size.x.div_ceil(WORKGROUP),
                        self.size.y.div_ceil(WORKGROUP),
                        1,
                    );
                }
                if i as u32 == self.settings.feedback + 1 {
                    let written = &self.buffers.images[(i + 1) % 2];
                    let bytes = written.size();
                    encoder.copy_buffer_to_buffer(written, 0, &self.buffers.feedback, 0, bytes);
                }
            }
        }
    }

    /// A pass of a frame, and the memory it moves.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct SvgfGpuPass {
        /// `variance`, or `step 4`.
        pub name: String,
        /// Bytes that the shader asks for, each tap counted. The variance's pass
        /// is counted where every history is long enough.
        pub counted: u64,
        /// Bytes if each input were read once and each output written once.
        pub ideal: u64,
    }

    impl SvgfGpu {
        /// The passes that [`Self::encode`] encodes, in order.
        #[must_use]
        pub fn passes(&self) -> Vec<SvgfGpuPass> {
            const SURFACE: u64 = 32;
            const HISTORY: u64 = 4;
            let texel = self.signal.texel();
            let pixels = u64::from(self.size.x) * u64::from(self.size.y);
            // Taps that lie inside, over all pixels.
            let taps = |radius: u64, step: u64| -> u64 {
                let along = |side: u32| -> u64 {
                    let at = |d: u64| u64::from(side).saturating_sub(d * step);
                    at(0) + 2 * (1..=radius).map(at).sum::<u64>()
                };
                along(self.size.x) * along(self.size.y)
            };
            let variance = SvgfGpuPass {
                name: "variance".into(),
                counted: pixels * (HISTORY + texel + texel),
                ideal: pixels * (HISTORY + texel + texel),
            };
            let radius = u64::from(self.settings.radius.min(2));
            let atrous = (0..self.settings.passes).map(|i| SvgfGpuPass {
                name: format!("step {}", 1 << i),
                // Its own data, the variance around, the taps, the result.
                counted: pixels * (SURFACE + texel + texel)
                    + taps(1, 1) * texel
                    + taps(radius, 1 << i) * (SURFACE + texel),
                ideal: pixels * (SURFACE + texel + texel),
            });
            std::iter::once(variance).chain(atrous).collect()
        }
    }

    impl Buffers {
        fn new(
            device: &wgpu::Device,
            layout: &wgpu::BindGroupLayout,
            size: UVec2,
            settings: SvgfSettings,
            signal: SvgfSignal,
        ) -> Self {
            let pixels = u64::from(size.x) * u64::from(size.y);
            let buffer = |label, bytes| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    size: pixels * bytes,
                    usage: wgpu::BufferUsages::STORAGE
                        | wgpu::BufferUsages::COPY_SRC
                        | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            };
            let surfaces = buffer("raytwin svgf surfaces", 32);
            let history = buffer("raytwin svgf history", 4);
            let images = [
                buffer("raytwin svgf image", signal.texel()),
                buffer("raytwin svgf image", signal.texel()),
            ];
            let feedback = buffer("raytwin svgf feedback", signal.texel());
            let groups = (0..=settings.passes)
                .map(|i| {
                    let step = if i == 0 { 1 } else { 1u32 << (i - 1) };
                    let words = [
                        size.x,
                        size.y,
                        step,
                        0,
                        settings.alpha.to_bits(),
                        settings.moments_alpha.to_bits(),
                        settings.history.to_bits(),
                        settings.sigma_depth.to_bits(),
                        settings.sigma_luminance.to_bits(),
                        settings.squarings,
                        settings.radius,
                        settings.passes,
                        settings.feedback,
                        // Uniforms take whole 16 bytes.
                        0,
                        0,
                        0,
                    ];
                    let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
                    let uniform = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                        label: Some("raytwin svgf settings"),
                        contents: &bytes,
                        usage: wgpu::BufferUsages::UNIFORM,
                    });
                    let (from, to) = (i as usize % 2, (i as usize + 1) % 2);
                    let bound = [&uniform, &surfaces, &history, &images[from], &images[to]];
                    let entries: Vec<_> = (0..)
                        .zip(bound)
                        .map(|(binding, buffer)| wgpu::BindGroupEntry {
                            binding,
                            resource: buffer.as_entire_binding(),
                        })
                        .collect();
                    device.create_bind_group(&wgpu::BindGroupDescriptor {
                        label: Some("raytwin svgf"),
                        layout,
                        entries: &entries,
                    })
                })
                .collect();
            Self {
                surfaces,
                history,
                images,
                feedback,
                groups,
            }
        }
    }
}
