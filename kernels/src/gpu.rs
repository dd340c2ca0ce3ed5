//! Ready wgpu pieces: buffers behind the WGSL callbacks.
//!
//! Nothing here owns a queue, submits, or reads back: you create the pieces
//! for your device and put them into your own pipelines and passes.

use wgpu::util::DeviceExt;

/// The two storage buffers that `ray/bvh`'s ready bindings read, with their
/// bind group; a third one with the masks of `ray/bvh_filter` where it is asked
/// for.
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
    masks: Option<wgpu::Buffer>,
    layout: wgpu::BindGroupLayout,
    bind_group: wgpu::BindGroup,
}

impl BvhBuffers {
    /// The bind group index that the ready bindings use.
    pub const GROUP: u32 = 2;

    /// The binding of the masks.
    pub const MASKS: u32 = 125;

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
        Self::build(device, nodes, triangles, None)
    }

    /// As [`Self::new`], with masks for `ray/bvh_filter`: a word for each triangle
    /// of the mesh. A triangle beyond their end has all bits, so an empty slice is
    /// a mesh without masks.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device, bvh: &raytwin::ray::bvh_build::Bvh)
    /// #     -> Result<(), raytwin::wgsl::LinkError> {
    /// use raytwin::gpu::BvhBuffers;
    ///
    /// // Bit 1 for what casts shadows, say.
    /// let masks = vec![1; bvh.triangles.len()];
    /// let buffers = BvhBuffers::with_masks(
    ///     device, &bvh.node_words(), &bvh.triangle_words(), &masks,
    /// );
    /// let source = raytwin::wgsl::link(&["ray/bvh_filter"])?
    ///     + BvhBuffers::bindings_wgsl()
    ///     + BvhBuffers::mask_bindings_wgsl()
    ///     + "@compute @workgroup_size(64) fn main() {
    ///         /* bvh_any_of(ray, BVH_FACES_BOTH, 1u) */
    ///     }";
    /// # Ok(())
    /// # }
    /// ```
    #[must_use]
    pub fn with_masks(
        device: &wgpu::Device,
        nodes: &[u32],
        triangles: &[u32],
        masks: &[u32],
    ) -> Self {
        // A binding may not be empty.
        let masks = if masks.is_empty() { &[u32::MAX] } else { masks };
        Self::build(device, nodes, triangles, Some(masks))
    }

    /// The WGSL that defines `bvh_read_mask` over group [`Self::GROUP`], binding
    /// [`Self::MASKS`].
    ///
    /// ```
    /// use raytwin::gpu::BvhBuffers;
    /// let text = BvhBuffers::mask_bindings_wgsl();
    /// assert!(text.contains(&format!("@binding({})", BvhBuffers::MASKS)));
    /// ```
    #[must_use]
    pub fn mask_bindings_wgsl() -> &'static str {
        raytwin_wgsl::module("ray/bvh_filter")
            .and_then(|module| module.bindings)
            .unwrap_or_default()
    }

    fn build(
        device: &wgpu::Device,
        nodes: &[u32],
        triangles: &[u32],
        masks: Option<&[u32]>,
    ) -> Self {
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
        let masks = masks.map(|masks| upload("raytwin bvh masks", masks, 1));
        let mut bound = vec![(0, &nodes), (1, &triangles)];
        bound.extend(masks.iter().map(|masks| (Self::MASKS, masks)));
        let entries: Vec<_> = bound
            .iter()
            .map(|(binding, _)| wgpu::BindGroupLayoutEntry {
                binding: *binding,
                visibility: wgpu::ShaderStages::COMPUTE | wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: true },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("raytwin bvh"),
            entries: &entries,
        });
        let entries: Vec<_> = bound
            .iter()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: *binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("raytwin bvh"),
            layout: &layout,
            entries: &entries,
        });
        Self {
            nodes,
            triangles,
            masks,
            layout,
            bind_group,
        }
    }

    /// Uploads a tree over the one that is there: after `Bvh::refit`, whose words
    /// are as many as before. The copy is before whatever you submit next.
    ///
    /// ```no_run
    /// # fn demo(
    /// #     queue: &wgpu::Queue,
    /// #     bvh: &mut raytwin::ray::bvh_build::Bvh,
    /// #     buffers: &raytwin::gpu::BvhBuffers,
    /// #     (positions, indices): (&[glam::Vec3], &[[u32; 3]]),
    /// # ) -> Result<(), Box<dyn std::error::Error>> {
    /// bvh.refit(positions, indices)?;
    /// buffers.write(queue, &bvh.node_words(), &bvh.triangle_words())?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If the words are not as many as the buffers hold. Then nothing is written.
    pub fn write(
        &self,
        queue: &wgpu::Queue,
        nodes: &[u32],
        triangles: &[u32],
    ) -> Result<(), BvhSizeError> {
        let words = |buffer: &wgpu::Buffer| (buffer.size() / 4) as usize;
        let held = [words(&self.nodes), words(&self.triangles)];
        let given = [nodes.len(), triangles.len()];
        if given != held {
            return Err(BvhSizeError { given, held });
        }
        for (buffer, words) in [(&self.nodes, nodes), (&self.triangles, triangles)] {
            let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
            queue.write_buffer(buffer, 0, &bytes);
        }
        Ok(())
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
        let masks = self.masks.as_ref().map_or(0, wgpu::Buffer::size);
        self.nodes.size() + self.triangles.size() + masks
    }
}

/// [`BvhBuffers::write`] with a tree of another size.
///
/// ```no_run
/// # fn demo(queue: &wgpu::Queue, buffers: &raytwin::gpu::BvhBuffers) {
/// // No tree has a node of one word.
/// let error = buffers.write(queue, &[0], &[]).unwrap_err();
/// assert_eq!(error.given, [1, 0]);
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BvhSizeError {
    /// Words of the nodes and of the triangles that were given.
    pub given: [usize; 2],
    /// Words that the buffers hold.
    pub held: [usize; 2],
}

impl std::fmt::Display for BvhSizeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (given, held) = (self.given, self.held);
        write!(
            f,
            "{} words of nodes and {} of triangles do not fit into buffers of {} and {}: make \
             new buffers for a tree of another size",
            given[0], given[1], held[0], held[1]
        )
    }
}

impl std::error::Error for BvhSizeError {}
