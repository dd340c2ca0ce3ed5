//! Ready wgpu pieces: buffers behind the WGSL callbacks.
//!
//! Nothing here owns a queue, submits, or reads back: you create the pieces
//! for your device and put them into your own pipelines and passes.

use wgpu::util::DeviceExt;

/// The two storage buffers that `ray/bvh`'s ready bindings read, with their
/// bind group.
///
/// ```no_run
/// # fn demo(device: &wgpu::Device, bvh: &raytwin::ray::bvh_build::Bvh)
/// #     -> Result<(), raytwin::wgsl::LinkError> {
/// use raytwin::gpu::BvhBuffers;
///
/// let buffers = BvhBuffers::new(device, &bvh.node_words(), &bvh.triangle_words());
/// let source = raytwin::wgsl::link(&["ray/bvh"])?
///     + BvhBuffers::bindings_wgsl()
///     + "@compute @workgroup_size(64) fn main() { /* bvh_closest(ray) */ }";
/// // In the pipeline layout: buffers.layout() at index BvhBuffers::GROUP.
/// // In the pass: pass.set_bind_group(BvhBuffers::GROUP, buffers.bind_group(), &[]).
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct BvhBuffers {
    nodes: wgpu::Buffer,
    triangles: wgpu::Buffer,
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
}

impl BvhBuffers {
    /// The bind group index that the ready bindings use.
    pub const GROUP: u32 = 2;

    /// The WGSL of the ready bindings: it defines `bvh_read_node` and
    /// `bvh_read_triangle` over group [`Self::GROUP`], bindings 0 and 1.
    ///
    /// ```
    /// use raytwin::gpu::BvhBuffers;
    /// let text = BvhBuffers::bindings_wgsl();
    /// assert!(text.contains("fn bvh_read_node(") && text.contains("@group(2)"));
    /// ```
    #[must_use]
    pub fn bindings_wgsl() -> &'static str {
        raytwin_wgsl::module("ray/bvh")
            .and_then(|module| module.bindings)
            .unwrap_or_default()
    }

    /// Uploads a tree: `Bvh::node_words` and `Bvh::triangle_words`. Empty
    /// slices make an empty tree, which every ray misses.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device, bvh: &raytwin::ray::bvh_build::Bvh) {
    /// use raytwin::gpu::BvhBuffers;
    /// let buffers =
    ///     BvhBuffers::new(device, &bvh.node_words(), &bvh.triangle_words());
    /// # }
    /// ```
    #[must_use]
    pub fn new(device: &wgpu::Device, nodes: &[u32], triangles: &[u32]) -> Self {
        // A binding may not be empty: a node of zeros has no child and no
        // triangle, a triangle of zeros has no area.
        let upload = |label, words: &[u32], least: usize| {
            let mut bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
            bytes.resize(bytes.len().max(4 * least), 0);
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents: &bytes,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
            })
        };
        let nodes = upload("raytwin bvh nodes", nodes, 8);
        let triangles = upload("raytwin bvh triangles", triangles, 12);
        let entry = |binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE | wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only: true },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("raytwin bvh"),
            entries: &[entry(0), entry(1)],
        });
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raytwin bvh"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: nodes.as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: triangles.as_entire_binding(),
                },
            ],
        });
        Self {
            nodes,
            triangles,
            layout,
            bind_group,
        }
    }

    /// Layout for your pipeline layout, at index [`Self::GROUP`].
    ///
    /// ```no_run
    /// # use raytwin::gpu::BvhBuffers;
    /// # fn demo(device: &wgpu::Device, buffers: &BvhBuffers) {
    /// // In a pipeline layout, after two groups of your own.
    /// let layouts = [None, None, Some(buffers.layout())];
    /// let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
    ///     label: None,
    ///     bind_group_layouts: &layouts,
    ///     immediate_size: 0,
    /// });
    /// # }
    /// ```
    #[must_use]
    pub fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// The bind group for your pass, at index [`Self::GROUP`].
    ///
    /// ```no_run
    /// # use raytwin::gpu::BvhBuffers;
    /// # fn demo(pass: &mut wgpu::ComputePass<'_>, buffers: &BvhBuffers) {
    /// pass.set_bind_group(BvhBuffers::GROUP, buffers.bind_group(), &[]);
    /// # }
    /// ```
    #[must_use]
    pub fn bind_group(&self) -> &wgpu::BindGroup {
        &self.bind_group
    }

    /// Bytes that the tree takes on the device.
    ///
    /// ```no_run
    /// # use raytwin::gpu::BvhBuffers;
    /// # fn demo(buffers: &BvhBuffers) {
    /// println!("{} MiB", buffers.size() >> 20);
    /// # }
    /// ```
    #[must_use]
    pub fn size(&self) -> u64 {
        self.nodes.size() + self.triangles.size()
    }
}
