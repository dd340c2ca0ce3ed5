//! What the passes of all filters have in common.

use std::fmt;

use glam::UVec2;
use raytwin_wgsl::{Images, LinkError, link_pass};
use wgpu::util::DeviceExt;

/// The bind group of all ready bindings.
const GROUP: u32 = 2;
/// Pixels on a side of a workgroup, but for the ballot's.
const SIDE: UVec2 = UVec2::splat(8);

/// Why a pass could not be made or bound.
///
/// ```no_run
/// # fn demo(
/// #     taa: &raytwin::pass::image::TaaGpu,
/// #     device: &wgpu::Device,
/// #     buffer: &wgpu::Buffer,
/// # ) {
/// use raytwin::pass::image::{TaaImages, TaaSettings};
/// // A pass over textures does not take a buffer; the error names the image.
/// let settings = TaaSettings { alpha: 0.1, exposure: 1.0 };
/// let images = TaaImages {
///     colors: buffer.into(),
///     histories: buffer.into(),
///     results: buffer.into(),
/// };
/// if let Err(error) = taa.bind(device, settings, images) {
///     eprintln!("{error}");
/// }
/// # }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PassError {
    /// Its program does not link.
    Link(LinkError),
    /// An image is of the other kind than the pass was created for.
    Kind {
        /// The image's name in the pass's structure.
        image: &'static str,
        /// What the pass was created for.
        images: Images,
    },
    /// An image is missing.
    Missing {
        /// Its name.
        image: &'static str,
        /// When it is needed.
        needed: &'static str,
    },
    /// A setting cannot be.
    Setting {
        /// Its name.
        setting: &'static str,
        /// What it may be.
        may_be: &'static str,
    },
}

impl fmt::Display for PassError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Link(error) => error.fmt(f),
            Self::Kind { image, images } => {
                let kind = match images {
                    Images::Buffers => "a buffer",
                    _ => "a texture (surfaces: a G-buffer)",
                };
                write!(
                    f,
                    "`{image}` must be {kind}: the pass was created for {images:?}"
                )
            }
            Self::Missing { image, needed } => write!(f, "`{image}` is missing: {needed}"),
            Self::Setting { setting, may_be } => write!(f, "`{setting}` must be {may_be}"),
        }
    }
}

impl std::error::Error for PassError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Link(error) => Some(error),
            _ => None,
        }
    }
}

impl From<LinkError> for PassError {
    fn from(error: LinkError) -> Self {
        Self::Link(error)
    }
}

/// An image that fits a pass.
///
/// ```no_run
/// # use raytwin::pass::image::TaaGpu;
/// # fn demo(device: &wgpu::Device, taa: &TaaGpu) {
/// use raytwin::pass::image::Image;
/// match taa.target(device) {
///     Image::Buffer(buffer) => println!("{} bytes", buffer.size()),
///     Image::Texture { texture, .. } => println!("{:?}", texture.format()),
/// }
/// # }
/// ```
#[derive(Clone, Debug)]
pub enum Image {
    /// Row by row.
    Buffer(wgpu::Buffer),
    /// With one layer and level.
    Texture {
        /// The texture.
        texture: wgpu::Texture,
        /// All of it.
        view: wgpu::TextureView,
    },
}

/// An image of yours, or an [`Image`].
///
/// ```no_run
/// # fn demo(
/// #     buffer: &wgpu::Buffer,
/// #     view: &wgpu::TextureView,
/// #     image: &raytwin::pass::image::Image,
/// # ) {
/// use raytwin::pass::image::ImageRef;
/// // Any of these can be bound.
/// let images: [ImageRef<'_>; 3] = [buffer.into(), view.into(), image.into()];
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub enum ImageRef<'a> {
    /// Row by row.
    Buffer(&'a wgpu::Buffer),
    /// With one layer and level.
    Texture(&'a wgpu::TextureView),
}

impl<'a> From<&'a Image> for ImageRef<'a> {
    fn from(image: &'a Image) -> Self {
        match image {
            Image::Buffer(buffer) => Self::Buffer(buffer),
            Image::Texture { view, .. } => Self::Texture(view),
        }
    }
}

impl<'a> From<&'a wgpu::Buffer> for ImageRef<'a> {
    fn from(buffer: &'a wgpu::Buffer) -> Self {
        Self::Buffer(buffer)
    }
}

impl<'a> From<&'a wgpu::TextureView> for ImageRef<'a> {
    fn from(view: &'a wgpu::TextureView) -> Self {
        Self::Texture(view)
    }
}

impl<'a> ImageRef<'a> {
    pub(super) fn resource(
        self,
        image: &'static str,
        images: Images,
    ) -> Result<wgpu::BindingResource<'a>, PassError> {
        match (self, images) {
            (Self::Buffer(buffer), Images::Buffers) => Ok(buffer.as_entire_binding()),
            (Self::Texture(view), Images::Textures16 | Images::Textures32) => {
                Ok(wgpu::BindingResource::TextureView(view))
            }
            _ => Err(PassError::Kind { image, images }),
        }
    }
}

/// What a pixel of a result holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Texel {
    /// Four numbers, in textures of the chosen width.
    Color,
    /// Four numbers of 32 bits.
    Moments,
    /// One number.
    Scalar,
    /// Two.
    Pair,
    /// A `u32`.
    Count,
}

impl Texel {
    fn format(self, images: Images) -> wgpu::TextureFormat {
        match self {
            Self::Color if images == Images::Textures16 => wgpu::TextureFormat::Rgba16Float,
            Self::Color | Self::Moments => wgpu::TextureFormat::Rgba32Float,
            Self::Scalar => wgpu::TextureFormat::R32Float,
            Self::Pair => wgpu::TextureFormat::Rg32Float,
            Self::Count => wgpu::TextureFormat::R32Uint,
        }
    }

    fn bytes(self) -> u64 {
        match self {
            Self::Color | Self::Moments => 16,
            Self::Pair => 8,
            Self::Scalar | Self::Count => 4,
        }
    }
}

/// A binding of an entry point.
#[derive(Clone, Copy, Debug)]
pub(super) enum Slot {
    Uniform(u32),
    /// Floats: a buffer, or a texture that is not filtered.
    Read(u32),
    /// Whole numbers.
    ReadUint(u32),
    Write(u32, Texel),
}

impl Slot {
    fn entry(self, images: Images) -> wgpu::BindGroupLayoutEntry {
        let buffer = |ty| wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let storage = |read_only| buffer(wgpu::BufferBindingType::Storage { read_only });
        let sampled = |sample_type| wgpu::BindingType::Texture {
            sample_type,
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let buffers = images == Images::Buffers;
        let (binding, ty) = match self {
            Self::Uniform(binding) => (binding, buffer(wgpu::BufferBindingType::Uniform)),
            Self::Read(binding) | Self::ReadUint(binding) if buffers => (binding, storage(true)),
            Self::Read(binding) => {
                let floats = wgpu::TextureSampleType::Float { filterable: false };
                (binding, sampled(floats))
            }
            Self::ReadUint(binding) => (binding, sampled(wgpu::TextureSampleType::Uint)),
            Self::Write(binding, _) if buffers => (binding, storage(false)),
            Self::Write(binding, texel) => {
                let ty = wgpu::BindingType::StorageTexture {
                    access: wgpu::StorageTextureAccess::WriteOnly,
                    format: texel.format(images),
                    view_dimension: wgpu::TextureViewDimension::D2,
                };
                (binding, ty)
            }
        };
        wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        }
    }
}

/// An entry point and its bindings over each kind of image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub entry: &'static str,
    pub side: UVec2,
    pub buffers: &'static [Slot],
    pub textures: &'static [Slot],
}

impl Step {
    pub const fn new(
        entry: &'static str,
        buffers: &'static [Slot],
        textures: &'static [Slot],
    ) -> Self {
        Self {
            entry,
            side: SIDE,
            buffers,
            textures,
        }
    }
}

/// An image that a pass keeps between its steps: what a texel holds, and how
/// many pixels each stands for.
pub(super) type Owned = (Texel, UVec2);

/// What a pass is made of.
#[derive(Debug)]
pub(super) struct Plan {
    pub name: &'static str,
    pub steps: &'static [Step],
    pub owned: &'static [Owned],
}

#[derive(Debug)]
struct Entry {
    step: Step,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::ComputePipeline,
}

/// Pipelines and images of a pass.
#[derive(Debug)]
pub(super) struct Core {
    pub images: Images,
    pub size: UVec2,
    pub owned: Vec<Image>,
    plan: &'static Plan,
    entries: Vec<Entry>,
}

impl Core {
    pub fn new(
        device: &wgpu::Device,
        size: UVec2,
        images: Images,
        plan: &'static Plan,
        compile: impl Fn(&PassProgram<'_>) -> wgpu::ShaderModule,
    ) -> Result<Self, PassError> {
        let source = link_pass(plan.name, images)?;
        let entries = plan
            .steps
            .iter()
            .map(|&step| {
                let slots = match images {
                    Images::Buffers => step.buffers,
                    _ => step.textures,
                };
                let layout_entries: Vec<_> = slots.iter().map(|s| s.entry(images)).collect();
                let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                    label: Some(step.entry),
                    entries: &layout_entries,
                });
                let mut bindings: Vec<_> = layout_entries.iter().map(|e| e.binding).collect();
                bindings.sort_unstable();
                let module = compile(&PassProgram {
                    source: &source,
                    entry: step.entry,
                    bindings: &bindings,
                });
                let pipeline_layout =
                    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                        label: Some(step.entry),
                        bind_group_layouts: &[None, None, Some(&layout)],
                        immediate_size: 0,
                    });
                let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(step.entry),
                    layout: Some(&pipeline_layout),
                    module: &module,
                    entry_point: Some(step.entry),
                    compilation_options: Default::default(),
                    cache: None,
                });
                Entry {
                    step,
                    layout,
                    pipeline,
                }
            })
            .collect();
        let mut core = Self {
            images,
            size,
            owned: Vec::new(),
            plan,
            entries,
        };
        core.resize(device, size);
        Ok(core)
    }

    pub fn resize(&mut self, device: &wgpu::Device, size: UVec2) {
        self.size = size.max(UVec2::ONE);
        self.owned = self
            .plan
            .owned
            .iter()
            .map(|&(texel, pixels)| {
                let size = (self.size + pixels - UVec2::ONE) / pixels;
                image(device, self.images, texel, size)
            })
            .collect();
    }

    /// A fitting image of the pass's size.
    pub fn target(&self, device: &wgpu::Device, texel: Texel) -> Image {
        image(device, self.images, texel, self.size)
    }

    /// Binds one step. What is bound may be more than the step's slots.
    pub fn step(&self, device: &wgpu::Device, index: usize, bindings: &Bindings) -> BoundStep {
        let entry = &self.entries[index];
        let slots = match self.images {
            Images::Buffers => entry.step.buffers,
            _ => entry.step.textures,
        };
        let uniforms: Vec<_> = bindings
            .uniforms
            .iter()
            .map(|(binding, uniform)| (*binding, uniform.buffer(device)))
            .collect();
        let bound = uniforms
            .iter()
            .map(|(binding, buffer)| (*binding, buffer.as_entire_binding()))
            .chain(bindings.resources.iter().cloned());
        let entries: Vec<_> = bound
            .filter(|(binding, _)| {
                slots.iter().any(|slot| match slot {
                    Slot::Uniform(b) | Slot::Read(b) | Slot::ReadUint(b) | Slot::Write(b, _) => {
                        b == binding
                    }
                })
            })
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(entry.step.entry),
            layout: &entry.layout,
            entries: &entries,
        });
        BoundStep {
            name: entry.step.entry,
            pipeline: entry.pipeline.clone(),
            group,
            workgroups: (self.size + entry.step.side - UVec2::ONE) / entry.step.side,
        }
    }
}

fn image(device: &wgpu::Device, images: Images, texel: Texel, size: UVec2) -> Image {
    if images == Images::Buffers {
        return Image::Buffer(device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("raytwin image"),
            size: u64::from(size.x) * u64::from(size.y) * texel.bytes(),
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        }));
    }
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("raytwin image"),
        size: wgpu::Extent3d {
            width: size.x,
            height: size.y,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: texel.format(images),
        usage: wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC
            | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let view = texture.create_view(&Default::default());
    Image::Texture { texture, view }
}

/// The words of a uniform, laid out as WGSL does.
#[derive(Clone, Debug, Default)]
pub(super) struct Uniform(Vec<u32>);

impl Uniform {
    pub fn align(mut self, words: usize) -> Self {
        self.0.resize(self.0.len().next_multiple_of(words), 0);
        self
    }

    pub fn u32(mut self, value: u32) -> Self {
        self.0.push(value);
        self
    }

    pub fn f32(self, value: f32) -> Self {
        self.u32(value.to_bits())
    }

    pub fn uvec2(self, value: UVec2) -> Self {
        self.align(2).u32(value.x).u32(value.y)
    }

    pub fn vec3(self, value: glam::Vec3) -> Self {
        self.align(4).f32(value.x).f32(value.y).f32(value.z)
    }

    pub fn camera(self, camera: crate::ray::camera::Camera) -> Self {
        let size = camera.inverse_resolution;
        self.vec3(camera.origin)
            .vec3(camera.right)
            .vec3(camera.up)
            .vec3(camera.forward)
            .align(2)
            .f32(size.x)
            .f32(size.y)
            .align(4)
    }

    fn buffer(&self, device: &wgpu::Device) -> wgpu::Buffer {
        // Uniforms take whole 16 bytes.
        let words = self.clone().align(4).0;
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("raytwin settings"),
            contents: &bytes,
            usage: wgpu::BufferUsages::UNIFORM,
        })
    }
}

/// What is bound where.
#[derive(Clone, Debug)]
pub(super) struct Bindings<'a> {
    images: Images,
    size: UVec2,
    resources: Vec<(u32, wgpu::BindingResource<'a>)>,
    uniforms: Vec<(u32, Uniform)>,
}

impl<'a> Bindings<'a> {
    pub fn new(core: &Core) -> Self {
        Self {
            images: core.images,
            size: core.size,
            resources: Vec::new(),
            uniforms: Vec::new(),
        }
    }

    pub fn buffers(&self) -> bool {
        self.images == Images::Buffers
    }

    pub fn image(
        mut self,
        binding: u32,
        name: &'static str,
        image: ImageRef<'a>,
    ) -> Result<Self, PassError> {
        self.resources
            .push((binding, image.resource(name, self.images)?));
        Ok(self)
    }

    pub fn uniform(mut self, binding: u32, uniform: Uniform) -> Self {
        self.uniforms.push((binding, uniform));
        self
    }

    /// The layout of storage buffers: the image's width, and what is `beside`.
    /// Textures know theirs.
    pub fn layout(self, binding: u32, beside: [u32; 3]) -> Self {
        if !self.buffers() {
            return self;
        }
        let width = self.size.x;
        let words = beside
            .into_iter()
            .fold(Uniform::default().u32(width), Uniform::u32);
        self.uniform(binding, words)
    }
}

#[derive(Clone, Debug)]
pub(super) struct BoundStep {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    workgroups: UVec2,
}

/// A pass with its images and settings: encode it as often as you like.
///
/// ```no_run
/// # use raytwin::pass::image::BoundPass;
/// # fn demo(
/// #     device: &wgpu::Device,
/// #     queue: &wgpu::Queue,
/// #     bound: &[BoundPass],
/// # ) {
/// // Passes of a frame, one after the other in one encoder.
/// let mut encoder = device.create_command_encoder(&Default::default());
/// for pass in bound {
///     pass.encode(&mut encoder);
/// }
/// queue.submit([encoder.finish()]);
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct BoundPass {
    pub(super) steps: Vec<BoundStep>,
}

impl BoundPass {
    /// Encodes it.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::BoundPass;
    /// # fn demo(bound: &BoundPass, encoder: &mut wgpu::CommandEncoder) {
    /// bound.encode(encoder);
    /// # }
    /// ```
    pub fn encode(&self, encoder: &mut wgpu::CommandEncoder) {
        self.encode_timed(encoder, None);
    }

    /// As [`Self::encode`]; step `i` of [`Self::steps`] writes its beginning and
    /// its end to the timestamps `2 * i` and `2 * i + 1`.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::BoundPass;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     bound: &BoundPass,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) {
    /// let timestamps = device.create_query_set(&wgpu::QuerySetDescriptor {
    ///     label: None,
    ///     ty: wgpu::QueryType::Timestamp,
    ///     count: 2 * bound.steps().count() as u32,
    /// });
    /// bound.encode_timed(encoder, Some(&timestamps));
    /// # }
    /// ```
    pub fn encode_timed(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timestamps: Option<&wgpu::QuerySet>,
    ) {
        for (i, step) in (0..).zip(&self.steps) {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some(step.name),
                timestamp_writes: timestamps.map(|query_set| wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(2 * i),
                    end_of_pass_write_index: Some(2 * i + 1),
                }),
            });
            pass.set_pipeline(&step.pipeline);
            pass.set_bind_group(GROUP, &step.group, &[]);
            pass.dispatch_workgroups(step.workgroups.x, step.workgroups.y, 1);
        }
    }

    /// The entry points that it dispatches, in order.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::BoundPass;
    /// # fn demo(bound: &BoundPass) {
    /// let names: Vec<_> = bound.steps().collect();
    /// println!("{}", names.join(", "));
    /// # }
    /// ```
    pub fn steps(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.steps.iter().map(|step| step.name)
    }
}

/// A program for one entry point of a pass.
///
/// ```no_run
/// use glam::UVec2;
///
/// # fn demo(
/// #     device: &wgpu::Device,
/// # ) -> Result<(), raytwin::pass::image::PassError> {
/// use glam::UVec2;
/// use raytwin::pass::image::{PassProgram, TaaGpu};
/// use raytwin::wgsl::Images;
/// // A compiler of your own, here one that only says what it compiles.
/// let compile = |program: &PassProgram<'_>| {
///     println!("{}: bindings {:?}", program.entry, program.bindings);
///     device.create_shader_module(wgpu::ShaderModuleDescriptor {
///         label: Some(program.entry),
///         source: wgpu::ShaderSource::Wgsl(program.source.into()),
///     })
/// };
/// let taa = TaaGpu::with_compiler(
///     device,
///     UVec2::new(1920, 1080),
///     Images::Buffers,
///     compile,
/// )?;
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PassProgram<'a> {
    /// All of its WGSL: the same for all entry points of a pass.
    pub source: &'a str,
    /// The entry point.
    pub entry: &'static str,
    /// Its bindings in group 2, in ascending order. (Vulkan drivers see their
    /// places in this list: what a compiler to SPIR-V must map them to.)
    pub bindings: &'a [u32],
}

/// The program as wgpu compiles it, once.
pub(super) fn plain(device: &wgpu::Device) -> impl Fn(&PassProgram<'_>) -> wgpu::ShaderModule {
    let made = std::cell::OnceCell::new();
    move |program| {
        made.get_or_init(|| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("raytwin"),
                source: wgpu::ShaderSource::Wgsl(program.source.into()),
            })
        })
        .clone()
    }
}

/// A pass: its type, what it is made of, and what all of them can do.
macro_rules! image_pass {
    ($(#[$doc:meta])* $name:ident $plan:expr) => {
        $(#[$doc])*
        #[derive(Debug)]
        pub struct $name {
            core: Core,
        }

        impl $name {
            const PLAN: &'static Plan = &$plan;

            /// Compiles the pass and makes what it keeps. Each side of `size`
            /// counts as 1 at least.
            ///
            /// ```no_run
            /// use glam::UVec2;
            ///
            /// # use raytwin::pass::image::PassError;
            /// # fn demo(
            /// #     device: &wgpu::Device,
            /// # ) -> Result<(), raytwin::pass::image::PassError> {
            /// use glam::UVec2;
            /// use raytwin::pass::image::TaaGpu;
            /// use raytwin::wgsl::Images;
            /// let taa = TaaGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
            /// # Ok(())
            /// # }
            /// ```
            ///
            /// # Errors
            /// If a module that it stands on is not registered.
            pub fn new(
                device: &wgpu::Device,
                size: UVec2,
                images: Images,
            ) -> Result<Self, PassError> {
                Self::with_compiler(device, size, images, plain(device))
            }

            /// As [`Self::new`], with a compiler of your own, asked once for each
            /// entry point: without bounds checks, say, or with a cache.
            ///
            /// ```no_run
            /// use glam::UVec2;
            ///
            /// # use raytwin::pass::image::PassError;
            /// # fn demo(
            /// #     device: &wgpu::Device,
            /// # ) -> Result<(), raytwin::pass::image::PassError> {
            /// use glam::UVec2;
            /// use raytwin::pass::image::{PassProgram, TaaGpu};
            /// use raytwin::wgsl::Images;
            /// let compile = |program: &PassProgram<'_>| {
            ///     device.create_shader_module(wgpu::ShaderModuleDescriptor {
            ///         label: None,
            ///         source: wgpu::ShaderSource::Wgsl(program.source.into()),
            ///     })
            /// };
            /// let taa = TaaGpu::with_compiler(
            ///     device,
            ///     UVec2::new(1920, 1080),
            ///     Images::Buffers,
            ///     compile,
            /// )?;
            /// # Ok(())
            /// # }
            /// ```
            ///
            /// # Errors
            /// If a module that it stands on is not registered.
            pub fn with_compiler(
                device: &wgpu::Device,
                size: UVec2,
                images: Images,
                compile: impl Fn(&PassProgram<'_>) -> wgpu::ShaderModule,
            ) -> Result<Self, PassError> {
                let core = Core::new(device, size, images, Self::PLAN, compile)?;
                Ok(Self { core })
            }

            /// For images of another size; the pipelines stay. Bind anew.
            ///
            /// ```no_run
            /// use glam::UVec2;
            ///
            /// # use raytwin::pass::image::TaaGpu;
            /// # fn demo(
            /// #     device: &wgpu::Device,
            /// #     taa: &mut TaaGpu,
            /// # ) {
            /// taa.resize(device, glam::UVec2::new(1280, 720));
            /// # }
            /// ```
            pub fn resize(&mut self, device: &wgpu::Device, size: UVec2) {
                self.core.resize(device, size);
            }

            /// Width and height of the results.
            ///
            /// ```no_run
            /// # use raytwin::pass::image::TaaGpu;
            /// # fn demo(
            /// #     taa: &TaaGpu,
            /// # ) {
            /// println!("{} pixels", taa.size().x * taa.size().y);
            /// # }
            /// ```
            #[must_use]
            pub fn size(&self) -> UVec2 {
                self.core.size
            }

            /// The kind of images that it was created for.
            ///
            /// ```no_run
            /// # use raytwin::pass::image::TaaGpu;
            /// # fn demo(
            /// #     taa: &TaaGpu,
            /// # ) {
            /// use raytwin::wgsl::Images;
            /// let buffers = taa.images() == Images::Buffers;
            /// # }
            /// ```
            #[must_use]
            pub fn images(&self) -> Images {
                self.core.images
            }
        }
    };
    ($(#[$doc:meta])* $name:ident $plan:expr, target $texel:expr) => {
        image_pass! { $(#[$doc])* $name $plan }

        impl $name {
            /// An image that fits its results.
            ///
            /// ```no_run
            /// # use raytwin::pass::image::TaaGpu;
            /// # fn demo(
            /// #     device: &wgpu::Device,
            /// #     taa: &TaaGpu,
            /// # ) {
            /// // The last picture and the new one; they change places each frame.
            /// let pictures = [taa.target(device), taa.target(device)];
            /// # }
            /// ```
            #[must_use]
            pub fn target(&self, device: &wgpu::Device) -> Image {
                self.core.target(device, $texel)
            }
        }
    };
}

pub(super) use image_pass;
