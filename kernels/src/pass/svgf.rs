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
    use crate::filter::tiles::{TILES_SIZE, tiles_atrous_reach, tiles_count, tiles_reach};

    /// Pixels on a side of a workgroup: a tile's.
    const WORKGROUP: u32 = TILES_SIZE;

    /// Where the bindings of `filter/tiles` are, and how many.
    const TILES_GROUP: u32 = 2;
    const TILES_BINDINGS: [u32; 4] = [41, 42, 43, 44];

    /// Bytes of the list before its tiles: the dispatch's groups, whether the
    /// list is left aside, the count.
    const LIST_HEAD: u64 = 20;

    /// What is filtered.
    ///
    /// ```no_run
    /// use glam::UVec2;
    ///
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// # ) -> Result<(), raytwin::wgsl::LinkError> {
    /// use glam::UVec2;
    /// use raytwin::filter::svgf::SvgfSettings;
    /// use raytwin::pass::svgf::{SvgfGpu, SvgfSignal};
    /// // A shadow has one channel.
    /// let (size, signal) = (UVec2::new(1920, 1080), SvgfSignal::Scalar);
    /// let filter = SvgfGpu::new(device, size, SvgfSettings::BLOG, signal)?;
    /// # Ok(())
    /// # }
    /// ```
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
        tiles: Option<Tiles>,
    }

    /// How tiles are left out.
    #[derive(Debug)]
    struct Tiles {
        /// Most tiles in the list.
        most: u32,
        layout: wgpu::BindGroupLayout,
        classify: wgpu::ComputePipeline,
        rows: wgpu::ComputePipeline,
        list: wgpu::ComputePipeline,
        arguments: wgpu::ComputePipeline,
        buffers: TileBuffers,
    }

    #[derive(Debug)]
    struct TileBuffers {
        list: wgpu::Buffer,
        arguments: wgpu::Buffer,
        group: wgpu::BindGroup,
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
        /// ```no_run
        /// use glam::UVec2;
        ///
        /// # fn demo(
        /// #     device: &wgpu::Device,
        /// # ) -> Result<(), raytwin::wgsl::LinkError> {
        /// use glam::UVec2;
        /// use raytwin::filter::svgf::SvgfSettings;
        /// use raytwin::pass::svgf::{SvgfGpu, SvgfSignal};
        /// let (size, signal) = (UVec2::new(1920, 1080), SvgfSignal::Color);
        /// let filter = SvgfGpu::new(device, size, SvgfSettings::PAPER, signal)?;
        /// assert_eq!(filter.size(), size);
        /// # Ok(())
        /// # }
        /// ```
        ///
        /// # Errors
        /// If a module that the passes stand on is not registered.
        pub fn new(
            device: &wgpu::Device,
            size: UVec2,
            settings: SvgfSettings,
            signal: SvgfSignal,
        ) -> Result<Self, raytwin_wgsl::LinkError> {
            Self::build(device, size, settings, signal, None)
        }

        /// As [`Self::new`], but leaves out the tiles of 8 × 8 pixels that the
        /// filter cannot change (`filter/tiles`): the same bits, sooner where
        /// much of the image is exactly 1 or exactly 0 with a variance of 0, or
        /// has no surface.
        ///
        /// The list of the others holds `most` tiles (at least 3; a `u32` each,
        /// and never more than there are). If more are needed, all are filtered.
        /// The device must support indirect dispatch.
        ///
        /// ```no_run
        /// use glam::UVec2;
        ///
        /// # fn demo(
        /// #     device: &wgpu::Device,
        /// # ) -> Result<(), raytwin::wgsl::LinkError> {
        /// use glam::UVec2;
        /// use raytwin::filter::svgf::SvgfSettings;
        /// use raytwin::pass::svgf::{SvgfGpu, SvgfSignal};
        /// let (size, signal) = (UVec2::new(1920, 1080), SvgfSignal::Scalar);
        /// // A list for half of the 240 × 135 tiles.
        /// let filter =
        ///     SvgfGpu::with_tiles(device, size, SvgfSettings::PAPER, signal, 16200)?;
        /// assert!(filter.tiles().is_some());
        /// # Ok(())
        /// # }
        /// ```
        ///
        /// # Errors
        /// If a module that the passes stand on is not registered.
        pub fn with_tiles(
            device: &wgpu::Device,
            size: UVec2,
            settings: SvgfSettings,
            signal: SvgfSignal,
            most: u32,
        ) -> Result<Self, raytwin_wgsl::LinkError> {
            Self::build(device, size, settings, signal, Some(most))
        }

        fn build(
            device: &wgpu::Device,
            size: UVec2,
            settings: SvgfSettings,
            signal: SvgfSignal,
            most: Option<u32>,
        ) -> Result<Self, raytwin_wgsl::LinkError> {
            let names = ["filter/svgf", "filter/tiles"];
            let used = if most.is_some() { 2 } else { 1 };
            let mut source = raytwin_wgsl::link(&names[..used])?;
            source += match signal {
                SvgfSignal::Color => raytwin_wgsl::pass::SVGF_COLOR,
                SvgfSignal::Scalar => raytwin_wgsl::pass::SVGF_SCALAR,
            };
            if most.is_some() {
                source += raytwin_wgsl::module("filter/tiles")
                    .and_then(|module| module.bindings)
                    .unwrap_or_default();
                source += raytwin_wgsl::pass::SVGF_TILES;
            }
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
            let tiles_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("raytwin svgf tiles"),
                entries: &TILES_BINDINGS.map(|binding| match binding {
                    44 => entry(binding, wgpu::BufferBindingType::Uniform),
                    _ => entry(binding, storage(false)),
                }),
            });
            let groups = [Some(&layout), None, Some(&tiles_layout)];
            let used = if most.is_some() { 3 } else { 1 };
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("raytwin svgf"),
                bind_group_layouts: &groups[..used],
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
            let (variance, atrous) = match most {
                None => ("svgf_pass_variance", "svgf_pass_atrous"),
                Some(_) => ("svgf_pass_variance_listed", "svgf_pass_atrous_listed"),
            };
            let tiles = most.map(|most| Tiles {
                most,
                classify: pipeline("svgf_pass_classify"),
                rows: pipeline("svgf_pass_rows"),
                list: pipeline("svgf_pass_list"),
                arguments: pipeline("svgf_pass_arguments"),
                buffers: TileBuffers::new(device, &tiles_layout, size, settings, most),
                layout: tiles_layout.clone(),
            });
            Ok(Self {
                size,
                settings,
                signal,
                variance: pipeline(variance),
                atrous: pipeline(atrous),
                buffers: Buffers::new(device, &layout, size, settings, signal),
                layout,
                tiles,
            })
        }

        /// New buffers for another size; the pipelines stay.
        ///
        /// ```no_run
        /// use glam::UVec2;
        ///
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(device: &wgpu::Device, filter: &mut SvgfGpu) {
        /// use glam::UVec2;
        /// filter.resize(device, UVec2::new(1280, 720));
        /// assert_eq!(filter.size(), UVec2::new(1280, 720));
        /// # }
        /// ```
        pub fn resize(&mut self, device: &wgpu::Device, size: UVec2) {
            self.size = size.max(UVec2::ONE);
            self.buffers =
                Buffers::new(device, &self.layout, self.size, self.settings, self.signal);
            if let Some(tiles) = &mut self.tiles {
                tiles.buffers =
                    TileBuffers::new(device, &tiles.layout, self.size, self.settings, tiles.most);
            }
        }

        /// Width and height.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(filter: &SvgfGpu) {
        /// let pixels = filter.size().x * filter.size().y;
        /// # }
        /// ```
        #[must_use]
        pub fn size(&self) -> UVec2 {
            self.size
        }

        /// Two `vec4f` a pixel: position and reach, normal and 0. A reach of 0
        /// says that there is no surface.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(queue: &wgpu::Queue, filter: &SvgfGpu, floats: &[f32]) {
        /// // Eight numbers a pixel: position and reach, normal and 0.
        /// let bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
        /// queue.write_buffer(filter.surfaces(), 0, &bytes);
        /// # }
        /// ```
        #[must_use]
        pub fn surfaces(&self) -> &wgpu::Buffer {
            &self.buffers.surfaces
        }

        /// Frames that each pixel has accumulated, an `f32`: where they are
        /// fewer than the settings' `history` the variance is estimated over the
        /// image.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(queue: &wgpu::Queue, filter: &SvgfGpu) {
        /// // Every pixel has only this frame: the variance comes from the image.
        /// let pixels = (filter.size().x * filter.size().y) as usize;
        /// queue.write_buffer(
        ///     filter.history(),
        ///     0,
        ///     &1.0_f32.to_le_bytes().repeat(pixels),
        /// );
        /// # }
        /// ```
        #[must_use]
        pub fn history(&self) -> &wgpu::Buffer {
            &self.buffers.history
        }

        /// The noisy image, with the variance of its luminance last.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(queue: &wgpu::Queue, filter: &SvgfGpu, floats: &[f32]) {
        /// // Three channels and the variance of the luminance.
        /// let bytes: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
        /// queue.write_buffer(filter.input(), 0, &bytes);
        /// # }
        /// ```
        #[must_use]
        pub fn input(&self) -> &wgpu::Buffer {
            &self.buffers.images[0]
        }

        /// The filtered image and its variance. It may be the same buffer as
        /// [`Self::input`].
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(
        /// #     filter: &SvgfGpu,
        /// #     encoder: &mut wgpu::CommandEncoder,
        /// #     mine: &wgpu::Buffer,
        /// # ) {
        /// filter.encode(encoder);
        /// let from = filter.output();
        /// encoder.copy_buffer_to_buffer(from, 0, mine, 0, from.size());
        /// # }
        /// ```
        #[must_use]
        pub fn output(&self) -> &wgpu::Buffer {
            // The variance's pass is one more.
            &self.buffers.images[(self.settings.passes as usize + 1) % 2]
        }

        /// The image after the pass whose output becomes the history.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(
        /// #     filter: &SvgfGpu,
        /// #     encoder: &mut wgpu::CommandEncoder,
        /// #     mine: &wgpu::Buffer,
        /// # ) {
        /// // The next frame's accumulation starts from this.
        /// filter.encode(encoder);
        /// let from = filter.feedback();
        /// encoder.copy_buffer_to_buffer(from, 0, mine, 0, from.size());
        /// # }
        /// ```
        #[must_use]
        pub fn feedback(&self) -> &wgpu::Buffer {
            &self.buffers.feedback
        }

        /// With [`Self::with_tiles`], what the last frame filtered: five `u32`
        /// (workgroups in three dimensions; not 0 if the list was too short;
        /// tiles to filter), then their indices, row by row, in no order.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(filter: &SvgfGpu) {
        /// // Made by `SvgfGpu::new`, it filters every tile and keeps no list.
        /// if let Some(list) = filter.tiles() {
        ///     println!("{} bytes", list.size());
        /// }
        /// # }
        /// ```
        #[must_use]
        pub fn tiles(&self) -> Option<&wgpu::Buffer> {
            self.tiles.as_ref().map(|tiles| &tiles.buffers.list)
        }

        /// Encodes the variance and all passes.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(
        /// #     device: &wgpu::Device,
        /// #     queue: &wgpu::Queue,
        /// #     filter: &SvgfGpu,
        /// # ) {
        /// let mut encoder = device.create_command_encoder(&Default::default());
        /// filter.encode(&mut encoder);
        /// queue.submit([encoder.finish()]);
        /// # }
        /// ```
        pub fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
            self.encode_timed(encoder, None);
        }

        /// As [`Self::encode`]; pass `i` of [`Self::passes`] writes its beginning
        /// and its end to the timestamps `2 * i` and `2 * i + 1`.
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(
        /// #     device: &wgpu::Device,
        /// #     filter: &SvgfGpu,
        /// #     encoder: &mut wgpu::CommandEncoder,
        /// # ) {
        /// let timestamps = device.create_query_set(&wgpu::QuerySetDescriptor {
        ///     label: None,
        ///     ty: wgpu::QueryType::Timestamp,
        ///     count: 2 * filter.passes().len() as u32,
        /// });
        /// filter.encode_timed(encoder, Some(&timestamps));
        /// # }
        /// ```
        pub fn encode_timed(
            &self,
            encoder: &mut wgpu::CommandEncoder,
            timestamps: Option<&wgpu::QuerySet>,
        ) {
            if let Some(tiles) = &self.tiles {
                self.encode_list(encoder, tiles);
            }
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
                    if let Some(tiles) = &self.tiles {
                        pass.set_bind_group(TILES_GROUP, &tiles.buffers.group, &[]);
                        pass.dispatch_workgroups_indirect(&tiles.buffers.arguments, 0);
                    } else {
                        let across = tiles_count(self.size);
                        pass.dispatch_workgroups(across.x, across.y, 1);
                    }
                }
                if i as u32 == self.settings.feedback + 1 {
                    let written = &self.buffers.images[(i + 1) % 2];
                    let bytes = written.size();
                    encoder.copy_buffer_to_buffer(written, 0, &self.buffers.feedback, 0, bytes);
                }
            }
        }

        /// Lists the tiles to filter.
        fn encode_list(&self, encoder: &mut wgpu::CommandEncoder, tiles: &Tiles) {
            let buffers = &tiles.buffers;
            encoder.clear_buffer(&buffers.list, 0, Some(LIST_HEAD));
            let across = tiles_count(self.size);
            let few = UVec2::new(across.x.div_ceil(WORKGROUP), across.y.div_ceil(WORKGROUP));
            for (pipeline, groups) in [
                (&tiles.classify, across),
                (&tiles.rows, few),
                (&tiles.list, across),
                (&tiles.arguments, UVec2::ONE),
            ] {
                let mut pass = begin(encoder);
                pass.set_pipeline(pipeline);
                // The input, and the image that the variance's pass writes.
                pass.set_bind_group(0, &self.buffers.groups[0], &[]);
                pass.set_bind_group(TILES_GROUP, &buffers.group, &[]);
                pass.dispatch_workgroups(groups.x, groups.y, 1);
            }
            encoder.copy_buffer_to_buffer(&buffers.list, 0, &buffers.arguments, 0, 12);
        }
    }

    fn begin(encoder: &mut wgpu::CommandEncoder) -> wgpu::ComputePass<'_> {
        encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("raytwin svgf"),
            timestamp_writes: None,
        })
    }

    impl TileBuffers {
        fn new(
            device: &wgpu::Device,
            layout: &wgpu::BindGroupLayout,
            size: UVec2,
            settings: SvgfSettings,
            most: u32,
        ) -> Self {
            let tiles = tiles_count(size);
            let count = u64::from(tiles.x) * u64::from(tiles.y);
            let buffer = |label, bytes, usage| {
                device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(label),
                    size: bytes,
                    usage,
                    mapped_at_creation: false,
                })
            };
            let storage = wgpu::BufferUsages::STORAGE;
            let flags = buffer("raytwin svgf tiles", 4 * count, storage);
            let rows = buffer("raytwin svgf tiles", 4 * count, storage);
            // WGSL takes no smaller one.
            let room = count.min(u64::from(most)).max(3);
            let list = buffer(
                "raytwin svgf tiles",
                LIST_HEAD + 4 * room,
                storage | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
            );
            let arguments = buffer(
                "raytwin svgf tiles",
                12,
                wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_DST,
            );
            // The spatial variance looks 3 pixels farther than the passes.
            let pixels = tiles_atrous_reach(settings.radius, settings.passes) + 3;
            let words = [size.x, size.y, tiles.x, tiles_reach(pixels)];
            let uniform = device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some("raytwin svgf tiles"),
                contents: &words.map(u32::to_le_bytes).concat(),
                usage: wgpu::BufferUsages::UNIFORM,
            });
            let bound = [&flags, &rows, &list, &uniform];
            let entries: Vec<_> = TILES_BINDINGS
                .into_iter()
                .zip(bound)
                .map(|(binding, buffer)| wgpu::BindGroupEntry {
                    binding,
                    resource: buffer.as_entire_binding(),
                })
                .collect();
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("raytwin svgf tiles"),
                layout,
                entries: &entries,
            });
            Self {
                list,
                arguments,
                group,
            }
        }
    }

    /// A pass of a frame, and the memory it moves.
    ///
    /// ```no_run
    /// # use raytwin::pass::svgf::SvgfGpu;
    /// # fn demo(filter: &SvgfGpu) {
    /// let moved: u64 = filter.passes().iter().map(|pass| pass.ideal).sum();
    /// println!("at least {} MiB a frame", moved >> 20);
    /// # }
    /// ```
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
        ///
        /// ```no_run
        /// # use raytwin::pass::svgf::SvgfGpu;
        /// # fn demo(filter: &SvgfGpu) {
        /// // The variance first, then the steps.
        /// for pass in filter.passes() {
        ///     println!("{}: {} bytes", pass.name, pass.counted);
        /// }
        /// # }
        /// ```
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
