//! Passes of the filters of one frame.

use glam::UVec2;
use raytwin_wgsl::Images;

use super::core::{
    Bindings, BoundPass, Core, Image, ImageRef, PassError, PassProgram, Plan, Slot, Step, Texel,
    Uniform, image_pass, plain,
};
use super::surfaces::SurfacesRef;
use crate::filter::svgf::SvgfSettings;

use Slot::{Read, ReadUint, Write};
use Texel::{Color, Pair, Scalar};

image_pass! {
    /// [`filter/bilateral_upsample`](crate::filter::bilateral_upsample): a
    /// low-resolution image at full resolution, across no edge.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::BilateralUpsampleGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = BilateralUpsampleGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    BilateralUpsampleGpu
    Plan {
        name: "filter/bilateral_upsample",
        steps: &[Step::new(
            "bilateral_upsample_pass_main",
            &[Read(25), Read(26), Read(88), Slot::Uniform(27), Write(90, Color), Slot::Uniform(91)],
            &[
                Read(25), ReadUint(87), Read(26), Read(88), ReadUint(89), Slot::Uniform(27),
                Write(90, Color), Slot::Uniform(91),
            ],
        )],
        owned: &[],
    },
    target Color
}

/// What [`BilateralUpsampleGpu`] does.
///
/// ```
/// use glam::UVec2;
///
/// use raytwin::pass::image::BilateralUpsampleSettings;
/// // From half resolution to 1920 × 1080.
/// let settings = BilateralUpsampleSettings {
///     low_size: glam::UVec2::new(960, 540),
///     scale: 2,
/// };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BilateralUpsampleSettings {
    /// Width and height of the low-resolution image.
    pub low_size: UVec2,
    /// Pixels of the full image for one of the low, along each side.
    pub scale: u32,
}

/// What [`BilateralUpsampleGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     surfaces: SurfacesRef<'_>,
/// #     low_surfaces: SurfacesRef<'_>,
/// #     colors: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images =
///     BilateralUpsampleImages { surfaces, colors, low_surfaces, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct BilateralUpsampleImages<'a> {
    /// At full resolution.
    pub surfaces: SurfacesRef<'a>,
    /// At low resolution: three channels and a weight.
    pub colors: ImageRef<'a>,
    /// Surfaces at low resolution. A G-buffer's camera is not read: it is that
    /// of the full image.
    pub low_surfaces: SurfacesRef<'a>,
    /// Three channels, and 1.
    pub results: ImageRef<'a>,
}

impl BilateralUpsampleGpu {
    /// Binds it.
    ///
    /// ```no_run
    /// use glam::UVec2;
    ///
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &BilateralUpsampleGpu,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     low_surfaces: SurfacesRef<'_>,
    /// #     colors: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let settings = BilateralUpsampleSettings {
    ///     low_size: glam::UVec2::new(960, 540),
    ///     scale: 2,
    /// };
    /// let images =
    ///     BilateralUpsampleImages { surfaces, colors, low_surfaces, results };
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
        settings: BilateralUpsampleSettings,
        images: BilateralUpsampleImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let words = Uniform::default()
            .uvec2(self.core.size)
            .uvec2(settings.low_size)
            .u32(settings.scale);
        let bindings = Bindings::new(&self.core)
            .surfaces([25, 87], "surfaces", images.surfaces)?
            .image(26, "colors", images.colors)?
            .surfaces([88, 89], "low_surfaces", images.low_surfaces)?
            .scene(27, images.surfaces, &[settings.scale as f32])
            .layout(27, [settings.low_size.x, 0, 0])
            .image(90, "results", images.results)?
            .uniform(91, words);
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}

image_pass! {
    /// [`filter/bilateral_variance`](crate::filter::bilateral_variance): a blur
    /// as wide as the noise is strong.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::BilateralVarianceGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = BilateralVarianceGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    BilateralVarianceGpu
    Plan {
        name: "filter/bilateral_variance",
        steps: &[Step::new(
            "bilateral_variance_pass_main",
            &[Read(5), Read(75), Slot::Uniform(6), Write(77, Color), Slot::Uniform(78)],
            &[
                Read(5), Read(75), ReadUint(76), Slot::Uniform(6), Write(77, Color),
                Slot::Uniform(78),
            ],
        )],
        owned: &[],
    },
    target Color
}

/// What [`BilateralVarianceGpu`] does.
///
/// ```
/// use raytwin::pass::image::BilateralVarianceSettings;
/// // For frame 7.
/// let settings =
///     BilateralVarianceSettings { max_radius: 8.0, max_taps: 32, seed: 7 };
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BilateralVarianceSettings {
    /// Radius in pixels where the noise is strongest.
    pub max_radius: f32,
    /// Most taps a pixel.
    pub max_taps: u32,
    /// Changes each pixel's turn: the frame's number.
    pub seed: u32,
}

/// What [`BilateralVarianceGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     surfaces: SurfacesRef<'_>,
/// #     colors: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = BilateralVarianceImages { colors, surfaces, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct BilateralVarianceImages<'a> {
    /// Three channels and their variance.
    pub colors: ImageRef<'a>,
    /// The surfaces.
    pub surfaces: SurfacesRef<'a>,
    /// Three channels, and 1.
    pub results: ImageRef<'a>,
}

impl BilateralVarianceGpu {
    /// Binds it.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &BilateralVarianceGpu,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     colors: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let settings =
    ///     BilateralVarianceSettings { max_radius: 8.0, max_taps: 32, seed: 7 };
    /// let images = BilateralVarianceImages { colors, surfaces, results };
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
        settings: BilateralVarianceSettings,
        images: BilateralVarianceImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let words = Uniform::default()
            .uvec2(self.core.size)
            .f32(settings.max_radius)
            .u32(settings.max_taps)
            .u32(settings.seed);
        let bindings = Bindings::new(&self.core)
            .image(5, "colors", images.colors)?
            .surfaces([75, 76], "surfaces", images.surfaces)?
            .scene(6, images.surfaces, &[])
            .layout(6, [0; 3])
            .image(77, "results", images.results)?
            .uniform(78, words);
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}

image_pass! {
    /// [`filter/firefly`](crate::filter::firefly): lone bright pixels, held to
    /// their neighbours.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::FireflyGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = FireflyGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    FireflyGpu
    Plan {
        name: "filter/firefly",
        steps: &[Step::new(
            "firefly_pass_main",
            &[Read(23), Slot::Uniform(24), Write(85, Color), Slot::Uniform(86)],
            &[Read(23), Write(85, Color), Slot::Uniform(86)],
        )],
        owned: &[],
    },
    target Color
}

/// How [`FireflyGpu`] holds a pixel to its neighbours.
///
/// ```
/// use raytwin::pass::image::FireflyKind;
/// // At most three standard deviations above the mean of its neighbours.
/// let kind = FireflyKind::Clamp(3.0);
/// assert_ne!(kind, FireflyKind::Cap);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FireflyKind {
    /// Each channel at most the largest of the 8 around.
    Cap,
    /// The same, and at least the smallest.
    Rank,
    /// Each channel at most so many deviations above the mean of the 24 around.
    Clamp(f32),
}

/// What [`FireflyGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     colors: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = FireflyImages { colors, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FireflyImages<'a> {
    /// Three channels.
    pub colors: ImageRef<'a>,
    /// Three channels, and 1.
    pub results: ImageRef<'a>,
}

impl FireflyGpu {
    /// Binds it.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &FireflyGpu,
    /// #     colors: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images = FireflyImages { colors, results };
    /// pass.bind(device, FireflyKind::Clamp(3.0), images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        kind: FireflyKind,
        images: FireflyImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let (kind, gamma) = match kind {
            FireflyKind::Cap => (0, 0.0),
            FireflyKind::Rank => (1, 0.0),
            FireflyKind::Clamp(gamma) => (2, gamma),
        };
        let words = Uniform::default()
            .uvec2(self.core.size)
            .u32(kind)
            .f32(gamma);
        let bindings = Bindings::new(&self.core)
            .image(23, "colors", images.colors)?
            .layout(24, [0; 3])
            .image(85, "results", images.results)?
            .uniform(86, words);
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}

image_pass! {
    /// [`filter/separable_blur`](crate::filter::separable_blur): rows, then
    /// columns.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::SeparableBlurGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = SeparableBlurGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    SeparableBlurGpu
    Plan {
        name: "filter/separable_blur",
        steps: &[
            Step::new("separable_blur_pass_rows", BLUR_BUFFERS, BLUR_TEXTURES),
            Step::new("separable_blur_pass_columns", BLUR_BUFFERS, BLUR_TEXTURES),
        ],
        owned: &[(Scalar, UVec2::ONE)],
    },
    target Scalar
}

const BLUR_BUFFERS: &[Slot] = &[
    Read(28),
    Read(29),
    Slot::Uniform(30),
    Write(93, Scalar),
    Slot::Uniform(94),
];
const BLUR_TEXTURES: &[Slot] = &[
    Read(28),
    ReadUint(92),
    Read(29),
    Slot::Uniform(30),
    Write(93, Scalar),
    Slot::Uniform(94),
];

/// What [`SeparableBlurGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     surfaces: SurfacesRef<'_>,
/// #     values: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = SeparableBlurImages { values, surfaces, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SeparableBlurImages<'a> {
    /// One channel.
    pub values: ImageRef<'a>,
    /// The surfaces.
    pub surfaces: SurfacesRef<'a>,
    /// One channel, `r32float` in textures.
    pub results: ImageRef<'a>,
}

impl SeparableBlurGpu {
    /// Binds it; `radius` in pixels.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &SeparableBlurGpu,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     values: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images = SeparableBlurImages { values, surfaces, results };
    /// pass.bind(device, 4, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        radius: u32,
        images: SeparableBlurImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let between = ImageRef::from(&self.core.owned[0]);
        let words = Uniform::default().uvec2(self.core.size).u32(radius);
        let shared = Bindings::new(&self.core)
            .surfaces([28, 92], "surfaces", images.surfaces)?
            .scene(30, images.surfaces, &[])
            .layout(30, [0; 3])
            .uniform(94, words);
        let rows = shared
            .clone()
            .image(29, "values", images.values)?
            .image(93, "results", between)?;
        let columns = shared
            .image(29, "values", between)?
            .image(93, "results", images.results)?;
        Ok(BoundPass {
            steps: vec![
                self.core.step(device, 0, &rows),
                self.core.step(device, 1, &columns),
            ],
        })
    }
}

image_pass! {
    /// [`filter/spatial_reconstruct`](crate::filter::spatial_reconstruct) with
    /// the ready bindings' GGX weight: reflections traced at half resolution,
    /// at full resolution.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::SpatialReconstructGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = SpatialReconstructGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    SpatialReconstructGpu
    Plan {
        name: "filter/spatial_reconstruct",
        steps: &[Step::new(
            "spatial_reconstruct_pass_main",
            &[Read(2), Read(70), Read(3), Slot::Uniform(4), Write(73, Color), Slot::Uniform(74)],
            &[
                Read(2), Read(70), Read(3), ReadUint(71), Read(72), Slot::Uniform(4),
                Write(73, Color), Slot::Uniform(74),
            ],
        )],
        owned: &[],
    },
    target Color
}

/// What [`SpatialReconstructGpu`] does.
///
/// ```
/// use glam::UVec2;
///
/// use raytwin::pass::image::SpatialReconstructSettings;
/// // Eight hits of a half-resolution image a pixel, in frame 7.
/// let settings = SpatialReconstructSettings {
///     low_size: glam::UVec2::new(960, 540),
///     count: 8,
///     seed: 7,
/// };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpatialReconstructSettings {
    /// Width and height of the half-resolution image.
    pub low_size: UVec2,
    /// Hits that each pixel looks at.
    pub count: u32,
    /// Changes each pixel's turn: the frame's number.
    pub seed: u32,
}

/// What [`SpatialReconstructGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     surfaces: SurfacesRef<'_>,
/// #     hits: ImageRef<'_>,
/// #     radiances: ImageRef<'_>,
/// #     alphas: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = SpatialReconstructImages {
///     hits,
///     radiances,
///     surfaces,
///     alphas: Some(alphas),
///     results,
/// };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SpatialReconstructImages<'a> {
    /// At half resolution: where each ray hit, and its direction's density.
    /// `rgba32float` in textures.
    pub hits: ImageRef<'a>,
    /// At half resolution: what it brought.
    pub radiances: ImageRef<'a>,
    /// At full resolution.
    pub surfaces: SurfacesRef<'a>,
    /// GGX's alpha at full resolution: beside a G-buffer alone.
    pub alphas: Option<ImageRef<'a>>,
    /// Three channels and their variance.
    pub results: ImageRef<'a>,
}

impl SpatialReconstructGpu {
    /// Binds it.
    ///
    /// ```no_run
    /// use glam::UVec2;
    ///
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &SpatialReconstructGpu,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     hits: ImageRef<'_>,
    /// #     radiances: ImageRef<'_>,
    /// #     alphas: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let settings = SpatialReconstructSettings {
    ///     low_size: glam::UVec2::new(960, 540),
    ///     count: 8,
    ///     seed: 7,
    /// };
    /// let images = SpatialReconstructImages {
    ///     hits,
    ///     radiances,
    ///     surfaces,
    ///     alphas: Some(alphas),
    ///     results,
    /// };
    /// pass.bind(device, settings, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind, or `alphas` is missing beside a
    /// G-buffer.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        settings: SpatialReconstructSettings,
        images: SpatialReconstructImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let words = Uniform::default()
            .uvec2(self.core.size)
            .uvec2(settings.low_size)
            .u32(settings.count)
            .u32(settings.seed);
        let mut bindings = Bindings::new(&self.core)
            .image(2, "hits", images.hits)?
            .image(70, "radiances", images.radiances)?
            .surfaces([3, 71], "surfaces", images.surfaces)?
            .scene(4, images.surfaces, &[])
            .image(73, "results", images.results)?
            .uniform(74, words);
        if bindings.buffers() {
            // This one has the low image's width first.
            let widths = [settings.low_size.x, self.core.size.x, 0, 0];
            let layout = widths.into_iter().fold(Uniform::default(), Uniform::u32);
            bindings = bindings.uniform(4, layout);
        } else {
            let Some(alphas) = images.alphas else {
                return Err(PassError::Missing {
                    image: "alphas",
                    needed: "a G-buffer does not hold GGX's alpha",
                });
            };
            bindings = bindings.image(72, "alphas", alphas)?;
        }
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}

const SVGF_COLOR: Plan = Plan {
    name: "filter/svgf",
    steps: &[
        Step::new(
            "svgf_image_pass_variance_color",
            &[
                Read(7),
                Read(8),
                Slot::Uniform(10),
                Read(121),
                Write(122, Color),
                Slot::Uniform(124),
            ],
            &[
                Read(7),
                ReadUint(79),
                Read(8),
                Slot::Uniform(10),
                Read(121),
                Write(122, Color),
                Slot::Uniform(124),
            ],
        ),
        Step::new(
            "svgf_image_pass_atrous_color",
            &[
                Read(7),
                Read(8),
                Slot::Uniform(10),
                Write(122, Color),
                Slot::Uniform(124),
            ],
            &[
                Read(7),
                ReadUint(79),
                Read(8),
                Slot::Uniform(10),
                Write(122, Color),
                Slot::Uniform(124),
            ],
        ),
    ],
    owned: &[(Color, UVec2::ONE), (Color, UVec2::ONE)],
};

const SVGF_SCALAR: Plan = Plan {
    name: "filter/svgf",
    steps: &[
        Step::new(
            "svgf_image_pass_variance_scalar",
            &[
                Read(7),
                Read(9),
                Slot::Uniform(10),
                Read(121),
                Write(123, Pair),
                Slot::Uniform(124),
            ],
            &[
                Read(7),
                ReadUint(79),
                Read(9),
                Slot::Uniform(10),
                Read(121),
                Write(123, Pair),
                Slot::Uniform(124),
            ],
        ),
        Step::new(
            "svgf_image_pass_atrous_scalar",
            &[
                Read(7),
                Read(9),
                Slot::Uniform(10),
                Write(123, Pair),
                Slot::Uniform(124),
            ],
            &[
                Read(7),
                ReadUint(79),
                Read(9),
                Slot::Uniform(10),
                Write(123, Pair),
                Slot::Uniform(124),
            ],
        ),
    ],
    owned: &[(Pair, UVec2::ONE), (Pair, UVec2::ONE)],
};

image_pass! {
    /// [`filter/svgf`](crate::filter::svgf) for three channels over your own
    /// images. [`SvgfGpu`](crate::pass::svgf::SvgfGpu) owns its buffers instead
    /// and can leave tiles out.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::SvgfColorImageGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = SvgfColorImageGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    SvgfColorImageGpu SVGF_COLOR, target Color
}

image_pass! {
    /// [`filter/svgf`](crate::filter::svgf) for one channel over your own
    /// images; results are `rg32float` in textures.
    SvgfScalarImageGpu SVGF_SCALAR, target Pair
}

/// What [`SvgfColorImageGpu`] and [`SvgfScalarImageGpu`] read and write.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     surfaces: SurfacesRef<'_>,
/// #     input: ImageRef<'_>,
/// #     histories: ImageRef<'_>,
/// #     feedback: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = SvgfImages {
///     input,
///     histories,
///     surfaces,
///     feedback: Some(feedback),
///     results,
/// };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SvgfImages<'a> {
    /// The noisy image, with the variance of its luminance last.
    pub input: ImageRef<'a>,
    /// Frames that each pixel has accumulated: where they are fewer than the
    /// settings' `history` the variance is estimated over the image.
    pub histories: ImageRef<'a>,
    /// The surfaces.
    pub surfaces: SurfacesRef<'a>,
    /// The image after the pass whose output becomes the history
    /// (`settings.feedback`), if that is not the last: then `results` is it.
    pub feedback: Option<ImageRef<'a>>,
    /// The filtered image and its variance.
    pub results: ImageRef<'a>,
}

impl SvgfColorImageGpu {
    /// Binds the variance and all passes (16 at most).
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &SvgfColorImageGpu,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     input: ImageRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     feedback: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images = SvgfImages {
    ///     input,
    ///     histories,
    ///     surfaces,
    ///     feedback: Some(feedback),
    ///     results,
    /// };
    /// pass.bind(device, raytwin::filter::svgf::SvgfSettings::PAPER, images)?
    ///     .encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind, or `feedback` is given and the last
    /// pass is the one fed back.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        settings: SvgfSettings,
        images: SvgfImages<'_>,
    ) -> Result<BoundPass, PassError> {
        bind_svgf(&self.core, device, settings, images, [8, 122])
    }
}

impl SvgfScalarImageGpu {
    /// As [`SvgfColorImageGpu::bind`].
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &SvgfScalarImageGpu,
    /// #     surfaces: SurfacesRef<'_>,
    /// #     input: ImageRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     feedback: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images = SvgfImages {
    ///     input,
    ///     histories,
    ///     surfaces,
    ///     feedback: Some(feedback),
    ///     results,
    /// };
    /// pass.bind(device, raytwin::filter::svgf::SvgfSettings::PAPER, images)?
    ///     .encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As there.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        settings: SvgfSettings,
        images: SvgfImages<'_>,
    ) -> Result<BoundPass, PassError> {
        bind_svgf(&self.core, device, settings, images, [9, 123])
    }
}

fn bind_svgf(
    core: &Core,
    device: &wgpu::Device,
    settings: SvgfSettings,
    images: SvgfImages<'_>,
    [from, to]: [u32; 2],
) -> Result<BoundPass, PassError> {
    let passes = settings.passes.min(16);
    if images.feedback.is_some() && settings.feedback + 1 >= passes {
        return Err(PassError::Setting {
            setting: "settings.feedback",
            may_be: "less than the last pass where an image for it is given",
        });
    }
    let shared = Bindings::new(core)
        .surfaces([7, 79], "surfaces", images.surfaces)?
        .scene(10, images.surfaces, &[])
        .layout(10, [0; 3])
        .image(121, "histories", images.histories)?;
    let mut source = images.input;
    let mut steps = Vec::new();
    for i in 0..=passes {
        // Step 0 is the variance, step i pass i - 1.
        let target = if i == passes {
            images.results
        } else if let Some(feedback) = images.feedback
            && i == settings.feedback + 1
        {
            feedback
        } else {
            (&core.owned[i as usize % 2]).into()
        };
        let words = Uniform::default()
            .uvec2(core.size)
            .u32(1 << i.saturating_sub(1))
            .u32(0)
            .f32(settings.alpha)
            .f32(settings.moments_alpha)
            .f32(settings.history)
            .f32(settings.sigma_depth)
            .f32(settings.sigma_luminance)
            .u32(settings.squarings)
            .u32(settings.radius)
            .u32(settings.passes)
            .u32(settings.feedback);
        let bindings = shared
            .clone()
            .image(from, "input", source)?
            .image(to, "results", target)?
            .uniform(124, words);
        steps.push(core.step(device, usize::from(i > 0), &bindings));
        source = target;
    }
    Ok(BoundPass { steps })
}
