//! Passes over shadow rays of one bit each.

use glam::UVec2;
use raytwin_wgsl::Images;

use super::core::{
    Bindings, BoundPass, Core, Image, ImageRef, PassError, PassProgram, Plan, Slot, Step, Texel,
    Uniform, image_pass, plain,
};

use Slot::{Read, ReadUint, Write};
use Texel::{Color, Count, Scalar};

/// Pixels of a word.
const BLOCK: UVec2 = UVec2::new(8, 4);

const fn pack(entry: &'static str) -> Step {
    Step {
        entry,
        side: BLOCK,
        buffers: &[
            Slot::Uniform(22),
            Read(80),
            Write(81, Count),
            Slot::Uniform(84),
        ],
        textures: &[Read(80), Write(81, Count), Slot::Uniform(84)],
    }
}

const ROWS: Step = Step::new(
    "packed_visibility_pass_rows",
    &[
        Read(20),
        Slot::Uniform(22),
        Write(82, Count),
        Slot::Uniform(84),
    ],
    &[ReadUint(20), Write(82, Count), Slot::Uniform(84)],
);

const MEAN: Step = Step::new(
    "packed_visibility_pass_mean",
    &[
        Read(21),
        Slot::Uniform(22),
        Write(83, Color),
        Slot::Uniform(84),
    ],
    &[ReadUint(21), Write(83, Color), Slot::Uniform(84)],
);

const OWNED: &[(Texel, UVec2)] = &[(Count, BLOCK), (Count, UVec2::ONE)];

const SUBGROUPS: Plan = Plan {
    name: "filter/packed_visibility_subgroups",
    steps: &[pack("packed_visibility_pass_pack_subgroups"), ROWS, MEAN],
    owned: OWNED,
};

image_pass! {
    /// [`filter/packed_visibility`](crate::filter::packed_visibility): 32 rays a
    /// word, and their mean over 17 × 17 pixels.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::PackedVisibilityGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = PackedVisibilityGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    PackedVisibilityGpu
    Plan {
        name: "filter/packed_visibility",
        steps: &[pack("packed_visibility_pass_pack"), ROWS, MEAN],
        owned: OWNED,
    },
    target Color
}

/// What [`PackedVisibilityGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     visible: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = PackedVisibilityImages { visible, results: Some(results) };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PackedVisibilityImages<'a> {
    /// One channel: above 0 where a pixel's ray reached the light.
    pub visible: ImageRef<'a>,
    /// Mean, variance, sum and number of the rays around each pixel; not written
    /// without.
    pub results: Option<ImageRef<'a>>,
}

impl PackedVisibilityGpu {
    /// As [`Self::new`], with subgroup operations: the device must have
    /// [`wgpu::Features::SUBGROUP`]. The same bits.
    ///
    /// ```no_run
    /// use glam::UVec2;
    ///
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::wgsl::Images;
    /// // Where the device cannot do it, `new` gives the same bits.
    /// let size = UVec2::new(1920, 1080);
    /// let pass = PackedVisibilityGpu::with_subgroups(device, size, Images::Buffers)
    ///     .or_else(|_| PackedVisibilityGpu::new(device, size, Images::Buffers))?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If a module that it stands on is not registered, or the device lacks the
    /// feature.
    pub fn with_subgroups(
        device: &wgpu::Device,
        size: UVec2,
        images: Images,
    ) -> Result<Self, PassError> {
        if !device.features().contains(wgpu::Features::SUBGROUP) {
            return Err(PassError::Setting {
                setting: "device",
                may_be: "one with the feature SUBGROUP; `new` does without",
            });
        }
        let core = Core::new(device, size, images, &SUBGROUPS, plain(device))?;
        Ok(Self { core })
    }

    /// The words of the blocks, row by row: `u32`, or `r32uint`. What
    /// [`VisibilityClampGpu`] reads.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     pass: &PackedVisibilityGpu,
    /// #     histories: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// # ) {
    /// // They go on to the clamp.
    /// let images =
    ///     VisibilityClampImages { words: pass.words().into(), histories, results };
    /// # }
    /// ```
    #[must_use]
    pub fn words(&self) -> &Image {
        &self.core.owned[0]
    }

    /// Binds it.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &PackedVisibilityGpu,
    /// #     visible: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images = PackedVisibilityImages { visible, results: Some(results) };
    /// pass.bind(device, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        images: PackedVisibilityImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let [words, rows] = [0, 1].map(|i| ImageRef::from(&self.core.owned[i]));
        let bindings = Bindings::new(&self.core)
            .image(80, "visible", images.visible)?
            .uniform(84, Uniform::default().uvec2(self.core.size));
        let bindings = visibility_layout(&self.core, bindings);
        let pack = bindings.clone().image(81, "words", words)?;
        let mut steps = vec![self.core.step(device, 0, &pack)];
        if let Some(results) = images.results {
            let sums = bindings
                .clone()
                .image(20, "words", words)?
                .image(82, "rows", rows)?;
            let means = bindings
                .image(21, "rows", rows)?
                .image(83, "results", results)?;
            steps.push(self.core.step(device, 1, &sums));
            steps.push(self.core.step(device, 2, &means));
        }
        Ok(BoundPass { steps })
    }
}

/// Blocks, then pixels.
fn visibility_layout<'a>(core: &Core, bindings: Bindings<'a>) -> Bindings<'a> {
    if !bindings.buffers() {
        return bindings;
    }
    let blocks = (core.size + BLOCK - UVec2::ONE) / BLOCK;
    bindings.uniform(22, Uniform::default().uvec2(blocks).uvec2(core.size))
}

image_pass! {
    /// [`temporal/visibility_clamp`](crate::temporal::visibility_clamp): a
    /// shadow's history, held to the 17 × 17 rays around each pixel.
    ///
    /// ```no_run
    /// # fn demo(device: &wgpu::Device) -> Result<(), raytwin::pass::image::PassError> {
    /// use glam::UVec2;
    /// use raytwin::pass::image::VisibilityClampGpu;
    /// use raytwin::wgsl::Images;
    ///
    /// let pass = VisibilityClampGpu::new(device, UVec2::new(1920, 1080), Images::Textures16)?;
    /// # Ok(())
    /// # }
    /// ```
    VisibilityClampGpu
    Plan {
        name: "temporal/visibility_clamp",
        steps: &[Step::new(
            "visibility_clamp_pass_main",
            &[
                Read(20), Slot::Uniform(22), Read(118), Write(119, Scalar), Slot::Uniform(120),
            ],
            &[ReadUint(20), Read(118), Write(119, Scalar), Slot::Uniform(120)],
        )],
        owned: &[],
    },
    target Scalar
}

/// What [`VisibilityClampGpu`] reads and writes.
///
/// ```no_run
/// # use raytwin::pass::image::*;
/// # fn demo(
/// #     words: ImageRef<'_>,
/// #     histories: ImageRef<'_>,
/// #     results: ImageRef<'_>,
/// # ) {
/// let images = VisibilityClampImages { words, histories, results };
/// # }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct VisibilityClampImages<'a> {
    /// [`PackedVisibilityGpu::words`].
    pub words: ImageRef<'a>,
    /// One channel: the visibility so far.
    pub histories: ImageRef<'a>,
    /// One channel, `r32float` in textures.
    pub results: ImageRef<'a>,
}

impl VisibilityClampGpu {
    /// Binds it; `gamma` deviations are allowed.
    ///
    /// ```no_run
    /// # use raytwin::pass::image::*;
    /// # fn demo(
    /// #     device: &wgpu::Device,
    /// #     pass: &VisibilityClampGpu,
    /// #     words: ImageRef<'_>,
    /// #     histories: ImageRef<'_>,
    /// #     results: ImageRef<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), raytwin::pass::image::PassError> {
    /// let images = VisibilityClampImages { words, histories, results };
    /// pass.bind(device, 0.5, images)?.encode(encoder);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// If an image is of the wrong kind.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        gamma: f32,
        images: VisibilityClampImages<'_>,
    ) -> Result<BoundPass, PassError> {
        let words = Uniform::default().uvec2(self.core.size).f32(gamma);
        let bindings = Bindings::new(&self.core)
            .image(20, "words", images.words)?
            .image(118, "histories", images.histories)?
            .image(119, "results", images.results)?
            .uniform(120, words);
        let bindings = visibility_layout(&self.core, bindings);
        Ok(BoundPass {
            steps: vec![self.core.step(device, 0, &bindings)],
        })
    }
}
