//! The filters as wgpu compute passes over your own images (feature `gpu`); tiles are
//! left out by [`SvgfGpu`](crate::pass::svgf::SvgfGpu), over its own buffers.
//!
//! Create a pass once for a device and a size, bind it to your images, encode
//! it into your command encoder:
//!
//! ```no_run
//! # fn demo(device: &wgpu::Device, queue: &wgpu::Queue, frame: &wgpu::TextureView)
//! #     -> Result<(), raytwin::pass::image::PassError> {
//! use glam::UVec2;
//! use raytwin::pass::image::{TaaGpu, TaaImages, TaaSettings};
//! use raytwin::wgsl::Images;
//!
//! let taa = TaaGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
//! // Its last picture and the new one; they change places each frame.
//! let pictures = [taa.target(device), taa.target(device)];
//! let settings = TaaSettings { alpha: 0.1, exposure: 1.0 };
//! let images = TaaImages {
//!     colors: frame.into(),
//!     histories: (&pictures[0]).into(),
//!     results: (&pictures[1]).into(),
//! };
//! let bound = taa.bind(device, settings, images)?;
//! let mut encoder = device.create_command_encoder(&Default::default());
//! bound.encode(&mut encoder);
//! queue.submit([encoder.finish()]);
//! # Ok(())
//! # }
//! ```
//!
//! A bound pass stays valid: bind again only where an image, a setting or the
//! camera changes, which makes a bind group and a small uniform. Nothing is
//! submitted, no queue is kept, nothing read back.
//!
//! Images are storage buffers, row by row, or textures
//! ([`Images`](crate::wgsl::Images)); the ready bindings beside each WGSL module say what
//! is in which channel. Results in `rgba16float` are held to 65504.

mod core;
mod filters;
mod history;
mod surfaces;
mod visibility;

pub use self::core::{BoundPass, Image, ImageRef, PassError, PassProgram};
pub use filters::{
    BilateralUpsampleGpu, BilateralUpsampleImages, BilateralUpsampleSettings, BilateralVarianceGpu,
    BilateralVarianceImages, BilateralVarianceSettings, FireflyGpu, FireflyImages, FireflyKind,
    SeparableBlurGpu, SeparableBlurImages, SpatialReconstructGpu, SpatialReconstructImages,
    SpatialReconstructSettings, SvgfColorImageGpu, SvgfImages, SvgfScalarImageGpu,
};
pub use history::{
    AccumulateColorImages, AccumulateGpu, AccumulateScalarImages, AccumulateSettings, ReprojectGpu,
    ReprojectImages, ReprojectMirrors, ReprojectSettings, TaaGpu, TaaImages, TaaSettings,
    VarianceClampGpu, VarianceClampImages, VarianceClampSettings,
};
pub use surfaces::{GBuffer, SurfacesRef};
pub use visibility::{
    PackedVisibilityGpu, PackedVisibilityImages, VisibilityClampGpu, VisibilityClampImages,
};
