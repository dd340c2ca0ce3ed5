//! What a pass knows about the surfaces of an image.

use super::core::{Bindings, ImageRef, PassError, Uniform};
use crate::ray::camera::Camera;

/// A G-buffer.
///
/// ```no_run
/// # fn demo(
/// #     depths: &wgpu::TextureView,
/// #     normals: &wgpu::TextureView,
/// #     camera: raytwin::ray::camera::Camera,
/// # ) {
/// use raytwin::pass::image::GBuffer;
/// let surfaces = GBuffer { depths, normals, meshes: None, camera, reach: 0.01 };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct GBuffer<'a> {
    /// Depths along the camera's axis, `r32float` (any float format is read);
    /// not above 0, or not finite, says that there is no surface.
    pub depths: &'a wgpu::TextureView,
    /// Unit normals in `r32uint`: `pack2x16snorm` of
    /// [`octahedral_encode`](crate::math::octahedral::octahedral_encode).
    pub normals: &'a wgpu::TextureView,
    /// Each surface's mesh, `r32uint`: for reprojection alone.
    pub meshes: Option<&'a wgpu::TextureView>,
    /// The camera that saw it; its resolution is the image's.
    pub camera: Camera,
    /// Plane distance at which a neighbour's weight falls to 1/e, over the
    /// depth. Reprojection has its own limits.
    pub reach: f32,
}

/// The surfaces of an image.
///
/// ```no_run
/// # use raytwin::pass::image::GBuffer;
/// # fn demo(buffer: &wgpu::Buffer, g_buffer: GBuffer<'_>) {
/// use raytwin::pass::image::SurfacesRef;
/// // Over buffers, and over textures.
/// let surfaces: [SurfacesRef<'_>; 2] = [buffer.into(), g_buffer.into()];
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub enum SurfacesRef<'a> {
    /// For passes over buffers: as the ready bindings of the filter say.
    Buffer(&'a wgpu::Buffer),
    /// For passes over textures.
    GBuffer(GBuffer<'a>),
}

impl<'a> From<&'a wgpu::Buffer> for SurfacesRef<'a> {
    fn from(buffer: &'a wgpu::Buffer) -> Self {
        Self::Buffer(buffer)
    }
}

impl<'a> From<GBuffer<'a>> for SurfacesRef<'a> {
    fn from(surfaces: GBuffer<'a>) -> Self {
        Self::GBuffer(surfaces)
    }
}

impl<'a> Bindings<'a> {
    /// Depths or buffer at the first place, normals at the second.
    pub fn surfaces(
        self,
        [places, normals]: [u32; 2],
        name: &'static str,
        surfaces: SurfacesRef<'a>,
    ) -> Result<Self, PassError> {
        match surfaces {
            SurfacesRef::Buffer(buffer) => self.image(places, name, buffer.into()),
            SurfacesRef::GBuffer(all) => self.image(places, name, all.depths.into())?.image(
                normals,
                name,
                all.normals.into(),
            ),
        }
    }

    /// As [`Self::surfaces`], with meshes at the third place.
    pub fn surfaces_of_meshes(
        self,
        [places, normals, meshes]: [u32; 3],
        name: &'static str,
        surfaces: SurfacesRef<'a>,
    ) -> Result<Self, PassError> {
        let SurfacesRef::GBuffer(all) = surfaces else {
            return self.surfaces([places, normals], name, surfaces);
        };
        let Some(view) = all.meshes else {
            return Err(PassError::Missing {
                image: "meshes",
                needed: "reprojection tells surfaces apart by them",
            });
        };
        self.surfaces([places, normals], name, surfaces)?.image(
            meshes,
            name,
            ImageRef::Texture(view),
        )
    }

    /// The camera and reach of textures, with what comes `beside`.
    pub fn scene(self, binding: u32, surfaces: SurfacesRef<'a>, beside: &[f32]) -> Self {
        let SurfacesRef::GBuffer(all) = surfaces else {
            return self;
        };
        let words = Uniform::default().camera(all.camera).f32(all.reach);
        let words = beside.iter().fold(words, |words, &x| words.f32(x));
        self.uniform(binding, words)
    }
}
