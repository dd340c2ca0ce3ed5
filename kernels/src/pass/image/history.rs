//! Passes of the filters over time.

use glam::UVec2;
use raytwin_wgsl::Images;

use super::core::{
    Bindings, BoundPass, Core, Image, ImageRef, PassError, PassProgram, Plan, Slot, Step, Texel,
    Uniform, image_pass, plain,
};
use super::surfaces::SurfacesRef;
use crate::ray::camera::Camera;
use crate::temporal::reproject::ReprojectTolerance;

use Slot::{Read, ReadUint, Write};
use Texel::{Color, Moments};

image_pass! {
    /// [`temporal/accumulate`](crate::temporal::accumulate): averages with their
    /// variance.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::AccumulateGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = AccumulateGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    AccumulateGpu
    Plan {
        name: "temporal/accumulate",
        steps: &[
            Step::new(
                "temporal_accumulate_pass_color",
                &[
                    Read(109), Read(110), Read(111), Write(112, Color), Write(113, Moments),
                    Slot::Uniform(114), Slot::Uniform(115),
                ],
                &[
                    Read(109), Read(110), Read(111), Write(112, Color), Write(113, Moments),
                    Slot::Uniform(115),
                ],
            ),
            Step::new(
                "temporal_accumulate_pass_scalar",
                &[
                    Read(116), Read(111), Write(113, Moments), Slot::Uniform(114),
                    Slot::Uniform(115),
                ],
                &[Read(116), Read(111), Write(113, Moments), Slot::Uniform(115)],
            ),
        ],
        owned: &[],
    }
}

/// What [`AccumulateGpu`] does.
///
/// ```
/// use raytwin::pass::image::AccumulateSettings;
/// // Colours over 32 frames, their variance over 5.
/// let settings = AccumulateSettings { cap: 32.0, moments_cap: 5.0 };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccumulateSettings {
    /// Frames at which a colour's (or a scalar's) history stops growing.
    pub cap: f32,
    /// The same for the luminance's moments.
    pub moments_cap: f32,
}

/// What [`AccumulateGpu`] reads and writes for colours.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     samples: ImageRef<'_>,
/// #     colors: ImageRef<'_>,
/// #     moments: ImageRef<'_>,
/// #     new_colors: ImageRef<'_>,
/// #     new_moments: ImageRef<'_>,
/// # ) {
/// let images = AccumulateColorImages {
///     samples,
///     colors,
///     moments,
///     new_colors,
///     new_moments,
/// };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct AccumulateColorImages<'a> {
    /// This frame.
    pub samples: ImageRef<'a>,
    /// The average so far, where the surface was, with the history's length.
    pub colors: ImageRef<'a>,
    /// Mean and variance of the luminance so far, and two numbers that colours
    /// do not read.
    pub moments: ImageRef<'a>,
    /// The new average and length.
    pub new_colors: ImageRef<'a>,
    /// The new mean, variance, 0 and length; `rgba32float` in textures.
    pub new_moments: ImageRef<'a>,
}

/// What [`AccumulateGpu`] reads and writes for one channel.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     samples: ImageRef<'_>,
/// #     moments: ImageRef<'_>,
/// #     new_moments: ImageRef<'_>,
/// # ) {
/// let images = AccumulateScalarImages { samples, moments, new_moments };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct AccumulateScalarImages<'a> {
    /// This frame.
    pub samples: ImageRef<'a>,
    /// Mean and variance so far, where the surface was; anything; the history's
    /// length.
    pub moments: ImageRef<'a>,
    /// The new mean, variance, 0 and length; `rgba32float` in textures.
    pub new_moments: ImageRef<'a>,
}

impl AccumulateGpu {
    /// An image for colours and their length.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &AccumulateGpu,
    /// # ) {
    /// // One to read from and one to write to; they change places each frame.
    /// let colors = [pass.target_colors(device), pass.target_colors(device)];
    /// # }
    /// ```
    #[must_use]
    pub fn target_colors(&self, device: &wgpu::Device) -> Image {
        self.core.target(device, Color)
    }

    /// An image for moments.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &AccumulateGpu,
    /// # ) {
    /// let moments = [pass.target_moments(device), pass.target_moments(device)];
    /// # }
    /// ```
    #[must_use]
    pub fn target_moments(&self, device: &wgpu::Device) -> Image {
        self.core.target(device, Moments)
    }

    fn settings(&self, settings: AccumulateSettings) -> Bindings<'_> {
        let words = Uniform::default()
            .uvec2(self.core.size)
            .f32(settings.cap)
            .f32(settings.moments_cap);
        Bindings::new(&self.core)
            .layout(114, [0; 3])
            .uniform(115, words)
    }

    /// Binds it for three channels.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &AccumulateGpu,
    /// #     samples: ImageRef<'_>,
    /// #     colors: ImageRef<'_>,
    /// #     moments: ImageRef<'_>,
    /// #     new_colors: ImageRef<'_>,
    /// #     new_moments: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let settings = AccumulateSettings { cap: 32.0, moments_cap: 5.0 };
    /// let images = AccumulateColorImages {
    ///     samples,
    ///     colors,
    ///     moments,
    ///     new_colors,
    ///     new_moments,
    /// };
    /// pass.bind_color(device, settings, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind_color(
        &self,
        device: &wgpu::Device,
        settings: AccumulateSettings,
        images: AccumulateColorImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let bindings = self
            .settings(settings)
            .image(109, "samples", images.samples)?
            .image(110, "colors", images.colors)?
            .image(111, "moments", images.moments)?
            .image(112, "new_colors", images.new_colors)?
            .image(113, "new_moments", images.new_moments)?;
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }

    /// Binds it for one channel.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &AccumulateGpu,
    /// #     samples: ImageRef<'_>,
    /// #     moments: ImageRef<'_>,
    /// #     new_moments: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let settings = AccumulateSettings { cap: 32.0, moments_cap: 5.0 };
    /// let images = AccumulateScalarImages { samples, moments, new_moments };
    /// pass.bind_scalar(device, settings, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind_scalar(
        &self,
        device: &wgpu::Device,
        settings: AccumulateSettings,
        images: AccumulateScalarImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let bindings = self
            .settings(settings)
            .image(116, "samples", images.samples)?
            .image(111, "moments", images.moments)?
            .image(113, "new_moments", images.new_moments)?;
        Ok(BoundPass {
            steps: vec![self.core.step(device, 1, &bindings)],
        })
    }
}

image_pass! {
    /// [`temporal/reproject`](crate::temporal::reproject): each pixel's history,
    /// from where its surface was, or what it mirrors.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::ReprojectGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = ReprojectGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    ReprojectGpu
    Plan {
        name: "temporal/reproject",
        steps: &[
            Step::new(
                "reproject_pass_surface",
                &[
                    Read(33), Read(34), Read(35), Slot::Uniform(36), Read(102), Write(104, Color),
                    Slot::Uniform(105),
                ],
                &[
                    Read(33), ReadUint(98), ReadUint(99), Read(34), ReadUint(100), ReadUint(101),
                    Read(35), Slot::Uniform(36), Read(102), Write(104, Color), Slot::Uniform(105),
                ],
            ),
            Step::new(
                "reproject_pass_reflection",
                &[
                    Read(33), Read(34), Read(35), Slot::Uniform(36), Read(37), Slot::Uniform(38),
                    Read(102), Read(103), Write(104, Color), Slot::Uniform(105),
                ],
                &[
                    Read(33), ReadUint(98), ReadUint(99), Read(34), ReadUint(100), ReadUint(101),
                    Read(35), Slot::Uniform(36), Read(37), Read(102), Read(103),
                    Write(104, Color), Slot::Uniform(105),
                ],
            ),
        ],
        owned: &[],
    },
    target Color
}

/// What [`ReprojectGpu`] does.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     camera: raytwin::ray::camera::Camera,
/// #     prior_camera: raytwin::ray::camera::Camera,
/// # ) {
/// use raytwin::temporal::reproject::REPROJECT_TOLERANCE;
/// // Flat surfaces that stand still, and a camera that moves.
/// let settings = ReprojectSettings {
///     camera,
///     prior_camera,
///     tolerance: REPROJECT_TOLERANCE,
///     curved: false,
///     moving: false,
/// };
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReprojectSettings {
    /// The camera that sees this frame. (A G-buffer holds it too; they should
    /// be the same.)
    pub camera: Camera,
    /// That of the frame before.
    pub prior_camera: Camera,
    /// When a texel shows another surface.
    pub tolerance: ReprojectTolerance,
    /// Whether surfaces are curved, and are expected to bend.
    pub curved: bool,
    /// Whether surfaces move: then a motion's third channel counts.
    pub moving: bool,
}

/// What [`ReprojectGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     surfaces: SurfacesRef<'_>,
/// #     prior_surfaces: SurfacesRef<'_>,
/// #     histories: ImageRef<'_>,
/// #     motions: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images =
///     ReprojectImages { surfaces, prior_surfaces, histories, motions, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ReprojectImages<'a> {
    /// Of this frame, with meshes.
    pub surfaces: SurfacesRef<'a>,
    /// Of the frame before, with meshes.
    pub prior_surfaces: SurfacesRef<'a>,
    /// Three channels and the history's length.
    pub histories: ImageRef<'a>,
    /// In pixels, from now to then; the third is the change of view depth.
    pub motions: ImageRef<'a>,
    /// The history of each pixel and its length, 0 where there is none.
    pub results: ImageRef<'a>,
}

/// What [`ReprojectGpu`] needs besides for mirrors.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     distances: ImageRef<'_>,
/// #     colors: ImageRef<'_>,
/// # ) {
/// let mirrors = ReprojectMirrors { distances, colors, blend: true };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ReprojectMirrors<'a> {
    /// From the mirror to what it shows.
    pub distances: ImageRef<'a>,
    /// This frame, whose 5 × 5 pixels judge the histories.
    pub colors: ImageRef<'a>,
    /// Whether the surface's own history is blended in.
    pub blend: bool,
}

impl ReprojectGpu {
    fn shared<'a>(
        &'a self,
        settings: ReprojectSettings,
        images: ReprojectImages<'a>,
        blend: bool,
    ) -> Result<Bindings<'a>, PassError> {
        let words = Uniform::default()
            .camera(settings.camera)
            .camera(settings.prior_camera)
            .f32(settings.tolerance.plane)
            .f32(settings.tolerance.normal)
            .align(4)
            .uvec2(self.core.size)
            .u32(settings.curved.into())
            .u32(settings.moving.into())
            .u32(blend.into());
        let mut bindings = Bindings::new(&self.core)
            .surfaces_of_meshes([33, 98, 99], "surfaces", images.surfaces)?
            .surfaces_of_meshes([34, 100, 101], "prior_surfaces", images.prior_surfaces)?
            .image(35, "histories", images.histories)?
            .layout(36, [0; 3])
            .layout(38, [0; 3])
            .image(102, "motions", images.motions)?
            .image(104, "results", images.results)?
            .uniform(105, words);
        if !bindings.buffers() {
            let cameras = Uniform::default()
                .camera(settings.camera)
                .camera(settings.prior_camera);
            bindings = bindings.uniform(36, cameras);
        }
        Ok(bindings)
    }

    /// Binds it for surfaces.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &ReprojectGpu,
    /// #     settings: ReprojectSettings,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     prior_surfaces: SurfacesRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     motions: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images =
    ///     ReprojectImages { surfaces, prior_surfaces, histories, motions, results };
    /// pass.bind_surface(device, settings, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind, or a G-buffer is without meshes.
    pub fn bind_surface(
        &self,
        device: &wgpu::Device,
        settings: ReprojectSettings,
        images: ReprojectImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let bindings = self.shared(settings, images, false)?;
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }

    /// Binds it for what surfaces mirror.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &ReprojectGpu,
    /// #     settings: ReprojectSettings,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     prior_surfaces: SurfacesRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     motions: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     distances: ImageRef<'_>,
    /// #     colors: ImageRef<'_>,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images =
    ///     ReprojectImages { surfaces, prior_surfaces, histories, motions, results };
    /// let mirrors = ReprojectMirrors { distances, colors, blend: true };
    /// pass.bind_reflection(device, settings, images, mirrors)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind, or a G-buffer is without meshes.
    pub fn bind_reflection(
        &self,
        device: &wgpu::Device,
        settings: ReprojectSettings,
        images: ReprojectImages<'_>,
        mirrors: ReprojectMirrors<'_>,
    ) -> Result<BoundPass, PassError> {
        let bindings = self
            .shared(settings, images, mirrors.blend)?
            .image(103, "distances", mirrors.distances)?
            .image(37, "colors", mirrors.colors)?;
        Ok(BoundPass {
            steps: vec![self.core.step(device, 1, &bindings)],
        })
    }
}

image_pass! {
    /// [`temporal/taa`](crate::temporal::taa): Karis's temporal antialiasing.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::TaaGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = TaaGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    TaaGpu
    Plan {
        name: "temporal/taa",
        steps: &[Step::new(
            "taa_pass_main",
            &[Read(31), Slot::Uniform(32), Read(95), Write(96, Color), Slot::Uniform(97)],
            &[Read(31), Read(95), Write(96, Color), Slot::Uniform(97)],
        )],
        owned: &[],
    },
    target Color
}

/// What [`TaaGpu`] does.
///
/// ```
/// use raytwin::pass::image::TaaSettings;
/// // A tenth of each new frame; the exposure is what the picture gets later.
/// let settings = TaaSettings { alpha: 0.1, exposure: 1.0 };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaaSettings {
    /// Part of the new frame in the result, in `[0, 1]`.
    pub alpha: f32,
    /// What colours are multiplied with before they are weighed.
    pub exposure: f32,
}

/// What [`TaaGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     colors: ImageRef<'_>,
/// #     histories: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = TaaImages { colors, histories, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct TaaImages<'a> {
    /// The new frame.
    pub colors: ImageRef<'a>,
    /// The last picture, where the surface was; its fourth channel is 0 where
    /// there is none.
    pub histories: ImageRef<'a>,
    /// The new picture, and 1.
    pub results: ImageRef<'a>,
}

impl TaaGpu {
    /// Binds it.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &TaaGpu,
    /// #     colors: ImageRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let settings = TaaSettings { alpha: 0.1, exposure: 1.0 };
    /// let images = TaaImages { colors, histories, results };
    /// pass.bind(device, settings, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        settings: TaaSettings,
        images: TaaImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let words = Uniform::default()
            .uvec2(self.core.size)
            .f32(settings.alpha)
            .f32(settings.exposure);
        let bindings = Bindings::new(&self.core)
            .image(31, "colors", images.colors)?
            .layout(32, [0; 3])
            .image(95, "histories", images.histories)?
            .image(96, "results", images.results)?
            .uniform(97, words);
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}

image_pass! {
    /// [`temporal/variance_clamp`](crate::temporal::variance_clamp): the history,
    /// held to the colours around each pixel.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::VarianceClampGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = VarianceClampGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    VarianceClampGpu
    Plan {
        name: "temporal/variance_clamp",
        steps: &[Step::new(
            "variance_clamp_pass_main",
            &[Read(37), Slot::Uniform(38), Read(106), Write(107, Color), Slot::Uniform(108)],
            &[Read(37), Read(106), Write(107, Color), Slot::Uniform(108)],
        )],
        owned: &[],
    },
    target Color
}

/// What [`VarianceClampGpu`] does.
///
/// ```
/// use raytwin::pass::image::VarianceClampSettings;
/// use raytwin::temporal::variance_clamp::{
///     VARIANCE_CLAMP_CLIP, VARIANCE_CLAMP_YCOCG,
/// };
/// // 5 × 5 pixels, clipped in YCoCg.
/// let settings = VarianceClampSettings {
///     radius: 2,
///     mode: VARIANCE_CLAMP_YCOCG | VARIANCE_CLAMP_CLIP,
///     gamma: 1.0,
/// };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceClampSettings {
    /// Pixels around the middle one: 2 looks at 5 × 5.
    pub radius: u32,
    /// Bits of the mode, as for
    /// [`variance_clamp_pixel`](crate::temporal::variance_clamp::variance_clamp_pixel).
    pub mode: u32,
    /// Deviations that are allowed.
    pub gamma: f32,
}

/// What [`VarianceClampGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     colors: ImageRef<'_>,
/// #     histories: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = VarianceClampImages { colors, histories, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct VarianceClampImages<'a> {
    /// This frame.
    pub colors: ImageRef<'a>,
    /// Three channels and the history's length.
    pub histories: ImageRef<'a>,
    /// The same, held.
    pub results: ImageRef<'a>,
}

impl VarianceClampGpu {
    /// Binds it.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &VarianceClampGpu,
    /// #     colors: ImageRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// use raytwin::temporal::variance_clamp::{
    ///     VARIANCE_CLAMP_CLIP, VARIANCE_CLAMP_YCOCG,
    /// };
    /// let settings = VarianceClampSettings {
    ///     radius: 2,
    ///     mode: VARIANCE_CLAMP_YCOCG | VARIANCE_CLAMP_CLIP,
    ///     gamma: 1.0,
    /// };
    /// let images = VarianceClampImages { colors, histories, results };
    /// pass.bind(device, settings, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        settings: VarianceClampSettings,
        images: VarianceClampImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let words = Uniform::default()
            .uvec2(self.core.size)
            .u32(settings.radius)
            .u32(settings.mode)
            .f32(settings.gamma);
        let bindings = Bindings::new(&self.core)
            .image(37, "colors", images.colors)?
            .layout(38, [0; 3])
            .image(106, "histories", images.histories)?
            .image(107, "results", images.results)?
            .uniform(108, words);
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}
