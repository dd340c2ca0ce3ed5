//! What the wgpu passes of all filters cost on adapters.

use glam::{UVec2, Vec2, Vec3, vec3};
use raytwin::filter::svgf::SvgfSettings;
use raytwin::math::octahedral::octahedral_encode;
use raytwin::pass::image::*;
use raytwin::ray::camera::{Camera, camera_position_from_depth};
use raytwin::temporal::reproject::REPROJECT_TOLERANCE;
use raytwin::wgsl::Images;
use raytwin_cpu::random::pcg::{pcg_hash, pcg_unit};
use raytwin_tests::gpu::Gpu;

use super::error::ReportError;
use super::filters::{Clock, copy_rate};
use super::kernels::median;
use super::schema::PassRow;
use crate::sequence::{Clamp, Recipe, Where};

/// Taps of the bilateral filter, hits of the reconstruction, radius of the blur.
const TAPS: u32 = 16;
const HITS: u32 = 8;
const RADIUS: u32 = 8;

fn noise(i: u32, lane: u32) -> f32 {
    pcg_unit(pcg_hash(i ^ pcg_hash(lane)))
}

/// Bytes a pixel: as the shader asks for, and if each input were read once and
/// each output written once.
type Bytes = (f64, f64);

/// Bytes of a colour, a surface, one with its mesh, one with GGX's alpha.
struct Texels {
    color: f64,
    surface: f64,
    mesh: f64,
    lobe: f64,
}

impl Texels {
    fn new(images: Images) -> Self {
        let buffers = images == Images::Buffers;
        let of = |texture, buffer| if buffers { buffer } else { texture };
        Self {
            color: if images == Images::Textures16 {
                8.0
            } else {
                16.0
            },
            surface: of(8.0, 32.0),
            mesh: of(12.0, 32.0),
            lobe: of(12.0, 48.0),
        }
    }

    /// Of an entry point.
    fn bytes(&self, step: &str) -> Bytes {
        let Self {
            color: c,
            surface: s,
            mesh: m,
            lobe: l,
        } = *self;
        let (taps, hits, across) = (TAPS.into(), f64::from(HITS), f64::from(2 * RADIUS + 1));
        // A word for 32 pixels.
        let word = 4.0 / 32.0;
        match step {
            "taa_pass_main" => (11.0 * c, 3.0 * c),
            "variance_clamp_pass_main" => (27.0 * c, 3.0 * c),
            "firefly_pass_main" => (10.0 * c, 2.0 * c),
            "temporal_accumulate_pass_color" => (3.0 * c + 32.0, 3.0 * c + 32.0),
            "temporal_accumulate_pass_scalar" => (36.0, 36.0),
            "separable_blur_pass_rows" | "separable_blur_pass_columns" => {
                (across * (s + 4.0) + 4.0, s + 8.0)
            }
            "bilateral_upsample_pass_main" => (s + 5.0 * (c + s) + c, s + (c + s) / 4.0 + c),
            "bilateral_variance_pass_main" => (c + s + f64::mul_add(taps, c + s, c), 2.0 * c + s),
            "spatial_reconstruct_pass_main" => {
                (hits * (16.0 + c + 2.0 * l) + c, (16.0 + c) / 4.0 + l + c)
            }
            "packed_visibility_pass_pack" => (4.0 + word, 4.0 + word),
            "packed_visibility_pass_rows" => (3.0 * 4.0 + 4.0, word + 4.0),
            "packed_visibility_pass_mean" => (17.0 * 4.0 + c, 4.0 + c),
            "visibility_clamp_pass_main" => (15.0 * 4.0 + 8.0, word + 8.0),
            "reproject_pass_surface" => (
                m + 4.0 * m + 4.0 * (m + c) + 16.0 + c,
                2.0 * m + 2.0 * c + 16.0,
            ),
            "reproject_pass_reflection" => (
                9.0 * m + 8.0 * (m + c) + 25.0 * c + 20.0 + c,
                2.0 * m + 3.0 * c + 20.0,
            ),
            "svgf_image_pass_variance_color" => (4.0 + 2.0 * c, 4.0 + 2.0 * c),
            "svgf_image_pass_atrous_color" => (25.0 * (s + c) + 9.0 * c + c, s + 2.0 * c),
            "svgf_image_pass_variance_scalar" => (4.0 + 16.0, 4.0 + 16.0),
            "svgf_image_pass_atrous_scalar" => (25.0 * (s + 8.0) + 9.0 * 8.0 + 8.0, s + 16.0),
            _ => (0.0, 0.0),
        }
    }
}

/// What a step of a filter cost.
struct Cost {
    /// As the table shows it.
    filter: &'static str,
    step: String,
    entry: &'static str,
    ms: f64,
}

/// Images and passes for one adapter, size and kind.
struct Lab<'a> {
    gpu: &'a Gpu,
    size: UVec2,
    images: Images,
    repeats: usize,
    costs: Vec<Cost>,
}

/// A surface seen by the pixel.
struct Seen {
    depth: f32,
    normal: Vec3,
    position: Vec3,
}

impl Lab<'_> {
    fn camera(&self) -> Camera {
        Camera {
            origin: Vec3::ZERO,
            right: vec3(0.9, 0.0, 0.0),
            up: vec3(0.0, 0.5, 0.0),
            forward: Vec3::NEG_Z,
            inverse_resolution: Vec2::ONE / self.size.as_vec2(),
        }
    }

    /// A wall of panels with slightly rough normals.
    fn seen(&self, size: UVec2, i: u32) -> Seen {
        let at = UVec2::new(i % size.x, i / size.x);
        let panel = (at.x / 64 + at.y / 64).is_multiple_of(3);
        let depth = if panel { 4.0 } else { 3.0 };
        let pixel = (at.as_vec2() + 0.5) * (self.size.as_vec2() / size.as_vec2()).round();
        Seen {
            depth,
            normal: vec3(0.05 * noise(i, 1), 0.05 * noise(i, 2), 1.0).normalize(),
            position: camera_position_from_depth(pixel, depth, self.camera()),
        }
    }

    /// Numbers as an image; colours take 16 bits where results do.
    fn image(&self, size: UVec2, channels: u32, value: impl Fn(u32, u32) -> f32) -> Image {
        let count = size.x * size.y;
        let numbers = (0..count).flat_map(|i| (0..channels).map(move |c| (i, c)));
        let numbers = numbers.map(|(i, c)| value(i, c));
        let device = self.gpu.device();
        if self.images == Images::Buffers {
            let words: Vec<u32> = numbers.map(f32::to_bits).collect();
            return Image::Buffer(self.gpu.buffer(&words));
        }
        let (format, bytes) = if channels == 4 && self.images == Images::Textures16 {
            let halves = numbers.flat_map(|x| half::f16::from_f32(x).to_bits().to_le_bytes());
            (wgpu::TextureFormat::Rgba16Float, halves.collect())
        } else {
            let format = match channels {
                1 => wgpu::TextureFormat::R32Float,
                2 => wgpu::TextureFormat::Rg32Float,
                _ => wgpu::TextureFormat::Rgba32Float,
            };
            let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
            (format, bytes)
        };
        texture(device, self.gpu.queue(), size, format, &bytes)
    }

    fn words(&self, size: UVec2, word: impl Fn(u32) -> u32) -> Image {
        let bytes: Vec<u8> = (0..size.x * size.y)
            .flat_map(|i| word(i).to_le_bytes())
            .collect();
        let format = wgpu::TextureFormat::R32Uint;
        texture(self.gpu.device(), self.gpu.queue(), size, format, &bytes)
    }

    fn surfaces(&self, size: UVec2, kind: Kind) -> Surfaces {
        let camera = self.camera();
        if self.images == Images::Buffers {
            let words: Vec<u32> = (0..size.x * size.y)
                .flat_map(|i| {
                    let Seen {
                        depth,
                        normal: n,
                        position: p,
                    } = self.seen(size, i);
                    let last = if kind == Kind::Mesh {
                        depth
                    } else {
                        0.01 * depth
                    };
                    let mut words = vec![p.x, p.y, p.z, last, n.x, n.y, n.z, 0.4];
                    if kind == Kind::Lobe {
                        let v = -p.normalize();
                        words.extend([v.x, v.y, v.z, 0.0]);
                    }
                    words.into_iter().map(f32::to_bits)
                })
                .collect();
            return Surfaces::Buffer(self.gpu.buffer(&words));
        }
        let snorm = |x: f32| (x * 32767.0).round() as i32 as u32 & 0xffff;
        let depths = {
            let bytes: Vec<u8> = (0..size.x * size.y)
                .flat_map(|i| self.seen(size, i).depth.to_le_bytes())
                .collect();
            let format = wgpu::TextureFormat::R32Float;
            texture(self.gpu.device(), self.gpu.queue(), size, format, &bytes)
        };
        let normals = self.words(size, |i| {
            let p = octahedral_encode(self.seen(size, i).normal);
            snorm(p.x) | snorm(p.y) << 16
        });
        let meshes = self.words(size, |_| 1);
        Surfaces::GBuffer(Box::new([depths, normals, meshes]), camera)
    }

    /// Times a pass; its steps' names come from the entry points.
    fn time(&mut self, filter: &'static str, pass: &BoundPass) {
        let entries: Vec<_> = pass.steps().collect();
        let clock = Clock::new(self.gpu, 2 * entries.len() as u32);
        let mut times = vec![Vec::new(); entries.len()];
        // The first run compiles.
        for i in 0..=self.repeats {
            let mut encoder = self
                .gpu
                .device()
                .create_command_encoder(&Default::default());
            pass.encode_timed(&mut encoder, Some(&clock.queries));
            let run = clock.run(self.gpu, encoder);
            if i > 0 {
                for (all, ms) in times.iter_mut().zip(run) {
                    all.push(ms);
                }
            }
        }
        let mut seen = 0;
        for (entry, mut times) in entries.into_iter().zip(times) {
            let step = if entry.contains("atrous") {
                seen += 1;
                format!("step {}", 1 << (seen - 1))
            } else {
                let known = entry.rsplit_once("pass_").map_or(entry, |p| p.1);
                known
                    .trim_end_matches("_color")
                    .trim_end_matches("_scalar")
                    .into()
            };
            self.costs.push(Cost {
                filter,
                step,
                entry,
                ms: median(&mut times),
            });
        }
    }

    fn all(&mut self) -> Result<(), PassError> {
        let (device, size, images) = (self.gpu.device(), self.size, self.images);
        let low = UVec2::new(size.x.div_ceil(2), size.y.div_ceil(2));
        let colors = self.image(size, 4, |i, c| noise(i, c + 3));
        let lengths = self.image(size, 4, |i, c| if c == 3 { 8.0 } else { noise(i, c + 7) });
        let moments = self.image(size, 4, |i, c| [noise(i, 11), 0.1, 0.0, 8.0][c as usize]);
        let scalars = self.image(size, 1, |i, _| noise(i, 12));
        let pairs = self.image(size, 2, |i, c| if c == 0 { noise(i, 13) } else { 0.08 });
        let eights = self.image(size, 1, |_, _| 8.0);
        let alphas = self.image(size, 1, |_, _| 0.4);
        let low_colors = self.image(low, 4, |i, c| if c == 3 { 1.0 } else { noise(i, c + 14) });
        let full = self.surfaces(size, Kind::Plain);
        let low_surfaces = self.surfaces(low, Kind::Plain);
        let meshes = self.surfaces(size, Kind::Mesh);
        let lobes = self.surfaces(size, Kind::Lobe);

        let pass = ReprojectGpu::new(device, size, images)?;
        let camera = self.camera();
        // Half a pixel to the side.
        let motions = self.image(size, 4, |_, c| if c == 0 { 0.5 } else { 0.0 });
        let settings = ReprojectSettings {
            camera,
            prior_camera: camera,
            tolerance: REPROJECT_TOLERANCE,
            curved: true,
            moving: false,
        };
        let results = pass.target(device);
        let images_of = ReprojectImages {
            surfaces: meshes.get(),
            prior_surfaces: meshes.get(),
            histories: (&lengths).into(),
            motions: (&motions).into(),
            results: (&results).into(),
        };
        let bound = pass.bind_surface(device, settings, images_of)?;
        self.time("reproject", &bound);
        for (name, blend) in [
            ("reproject, hit point", false),
            ("reproject, blended", true),
        ] {
            let mirrors = ReprojectMirrors {
                distances: (&eights).into(),
                colors: (&colors).into(),
                blend,
            };
            let bound = pass.bind_reflection(device, settings, images_of, mirrors)?;
            self.time(name, &bound);
        }

        let pass = AccumulateGpu::new(device, size, images)?;
        let settings = AccumulateSettings {
            cap: 32.0,
            moments_cap: 32.0,
        };
        let (new_colors, new_moments) = (pass.target_colors(device), pass.target_moments(device));
        let color_images = AccumulateColorImages {
            samples: (&colors).into(),
            colors: (&lengths).into(),
            moments: (&moments).into(),
            new_colors: (&new_colors).into(),
            new_moments: (&new_moments).into(),
        };
        self.time(
            "accumulate, RGB",
            &pass.bind_color(device, settings, color_images)?,
        );
        let scalar_images = AccumulateScalarImages {
            samples: (&scalars).into(),
            moments: (&moments).into(),
            new_moments: (&new_moments).into(),
        };
        let bound = pass.bind_scalar(device, settings, scalar_images)?;
        self.time("accumulate, scalar", &bound);

        let pass = VarianceClampGpu::new(device, size, images)?;
        let settings = VarianceClampSettings {
            radius: 2,
            mode: 0,
            gamma: 1.0,
        };
        let images_of = VarianceClampImages {
            colors: (&colors).into(),
            histories: (&lengths).into(),
            results: (&results).into(),
        };
        self.time("variance_clamp", &pass.bind(device, settings, images_of)?);

        let packed = PackedVisibilityGpu::new(device, size, images)?;
        let images_of = PackedVisibilityImages {
            visible: (&scalars).into(),
            results: Some((&results).into()),
        };
        self.time("packed_visibility", &packed.bind(device, images_of)?);
        let pass = VisibilityClampGpu::new(device, size, images)?;
        let clamped = pass.target(device);
        let images_of = VisibilityClampImages {
            words: packed.words().into(),
            histories: (&scalars).into(),
            results: (&clamped).into(),
        };
        self.time("visibility_clamp", &pass.bind(device, 0.5, images_of)?);

        let paper = SvgfSettings::PAPER;
        let pass = SvgfColorImageGpu::new(device, size, images)?;
        let images_of = SvgfImages {
            input: (&colors).into(),
            histories: (&eights).into(),
            surfaces: full.get(),
            feedback: None,
            results: (&results).into(),
        };
        self.time("svgf, RGB", &pass.bind(device, paper, images_of)?);
        let pass = SvgfScalarImageGpu::new(device, size, images)?;
        let target = pass.target(device);
        let images_of = SvgfImages {
            input: (&pairs).into(),
            results: (&target).into(),
            ..images_of
        };
        self.time("svgf, scalar", &pass.bind(device, paper, images_of)?);

        let pass = TaaGpu::new(device, size, images)?;
        let settings = TaaSettings {
            alpha: 0.1,
            exposure: 1.0,
        };
        let images_of = TaaImages {
            colors: (&colors).into(),
            histories: (&lengths).into(),
            results: (&results).into(),
        };
        self.time("taa", &pass.bind(device, settings, images_of)?);

        let pass = FireflyGpu::new(device, size, images)?;
        let images_of = FireflyImages {
            colors: (&colors).into(),
            results: (&results).into(),
        };
        self.time("firefly", &pass.bind(device, FireflyKind::Cap, images_of)?);

        let pass = SeparableBlurGpu::new(device, size, images)?;
        let images_of = SeparableBlurImages {
            values: (&scalars).into(),
            surfaces: full.get(),
            results: (&clamped).into(),
        };
        self.time("separable_blur", &pass.bind(device, RADIUS, images_of)?);

        let pass = BilateralUpsampleGpu::new(device, size, images)?;
        let settings = BilateralUpsampleSettings {
            low_size: low,
            scale: 2,
        };
        let images_of = BilateralUpsampleImages {
            surfaces: full.get(),
            colors: (&low_colors).into(),
            low_surfaces: low_surfaces.get(),
            results: (&results).into(),
        };
        self.time(
            "bilateral_upsample",
            &pass.bind(device, settings, images_of)?,
        );

        let pass = SpatialReconstructGpu::new(device, size, images)?;
        // Positions and densities do not fit 16 bits.
        let hits = Lab {
            images: match images {
                Images::Textures16 => Images::Textures32,
                other => other,
            },
            costs: Vec::new(),
            ..*self
        }
        .image(low, 4, |i, c| if c == 3 { 0.5 } else { noise(i, c + 18) });
        let settings = SpatialReconstructSettings {
            low_size: low,
            count: HITS,
            seed: 1,
        };
        let images_of = SpatialReconstructImages {
            hits: (&hits).into(),
            radiances: (&low_colors).into(),
            surfaces: lobes.get(),
            alphas: Some((&alphas).into()),
            results: (&results).into(),
        };
        self.time(
            "spatial_reconstruct",
            &pass.bind(device, settings, images_of)?,
        );

        let pass = BilateralVarianceGpu::new(device, size, images)?;
        let settings = BilateralVarianceSettings {
            max_radius: 8.0,
            max_taps: TAPS,
            seed: 1,
        };
        let images_of = BilateralVarianceImages {
            colors: (&colors).into(),
            surfaces: full.get(),
            results: (&results).into(),
        };
        self.time(
            "bilateral_variance",
            &pass.bind(device, settings, images_of)?,
        );
        Ok(())
    }
}

/// What a buffer of surfaces holds.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Plain,
    Mesh,
    Lobe,
}

/// Surfaces on the device.
enum Surfaces {
    Buffer(wgpu::Buffer),
    GBuffer(Box<[Image; 3]>, Camera),
}

impl Surfaces {
    fn get(&self) -> SurfacesRef<'_> {
        let (planes, camera) = match self {
            Self::Buffer(buffer) => return buffer.into(),
            Self::GBuffer(planes, camera) => (planes, *camera),
        };
        let [
            Image::Texture { view: depths, .. },
            Image::Texture { view: normals, .. },
            Image::Texture { view: meshes, .. },
        ] = planes.as_ref()
        else {
            unreachable!("a G-buffer has textures");
        };
        GBuffer {
            depths,
            normals,
            meshes: Some(meshes),
            camera,
            reach: 0.01,
        }
        .into()
    }
}

fn texture(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    size: UVec2,
    format: wgpu::TextureFormat,
    bytes: &[u8],
) -> Image {
    let extent = wgpu::Extent3d {
        width: size.x,
        height: size.y,
        depth_or_array_layers: 1,
    };
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: extent,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    queue.write_texture(
        texture.as_image_copy(),
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes.len() as u32 / size.y),
            rows_per_image: None,
        },
        extent,
    );
    let view = texture.create_view(&Default::default());
    Image::Texture { texture, view }
}

/// What all passes cost on an adapter at a size, over buffers and over textures.
pub(super) struct PassCosts {
    backend: String,
    size: UVec2,
    copy_gb_s: f64,
    kinds: Vec<(Images, Vec<Cost>)>,
}

impl PassCosts {
    /// Times them; the adapter must have a clock.
    pub(super) fn measure(gpu: &Gpu, size: UVec2, repeats: usize) -> Result<Self, ReportError> {
        let mut kinds = Vec::new();
        for images in [Images::Buffers, Images::Textures16] {
            let mut lab = Lab {
                gpu,
                size,
                images,
                repeats,
                costs: Vec::new(),
            };
            lab.all()?;
            kinds.push((images, lab.costs));
        }
        Ok(Self {
            backend: gpu.label(),
            size,
            copy_gb_s: copy_rate(gpu, u64::from(size.x * size.y) * 32, repeats.max(5)),
            kinds,
        })
    }

    pub(super) fn backend(&self) -> &str {
        &self.backend
    }

    /// A row for each step.
    pub(super) fn rows(&self) -> Vec<PassRow> {
        let pixels = f64::from(self.size.x) * f64::from(self.size.y);
        let mut out = Vec::new();
        for (images, costs) in &self.kinds {
            let texels = Texels::new(*images);
            for cost in costs {
                let (counted, ideal) = texels.bytes(cost.entry);
                out.push(PassRow {
                    backend: self.backend.clone(),
                    signal: cost.filter.into(),
                    images: format!("{images:?}"),
                    size: self.size.to_array(),
                    pass: cost.step.clone(),
                    ms: cost.ms,
                    counted: (counted * pixels) as u64,
                    ideal: (ideal * pixels) as u64,
                    gb_s: ideal * pixels * 1e-6 / cost.ms,
                    copy_gb_s: self.copy_gb_s,
                });
            }
        }
        out
    }

    /// Milliseconds of a way to filter a sequence: the sum of the passes that it
    /// is made of; `None` for what no pass does.
    pub(super) fn of(&self, recipe: &Recipe, color: bool) -> Option<f64> {
        let kind = usize::from(recipe.half);
        let costs = &self.kinds[kind].1;
        let sum = |filter: &str, chosen: &dyn Fn(&Cost) -> bool| -> f64 {
            costs
                .iter()
                .filter(|c| c.filter == filter && chosen(c))
                .map(|c| c.ms)
                .sum()
        };
        if recipe.plain || recipe.tiles {
            return None;
        }
        let mut ms = 0.0;
        // Moments have to come along; a scalar that is not fed back is its own.
        let images = if color || recipe.feedback { 2.0 } else { 1.0 };
        ms += match recipe.history {
            None | Some(Where::Here) => 0.0,
            Some(Where::Surface) => images * sum("reproject", &|_| true),
            Some(Where::HitPoint) => images * sum("reproject, hit point", &|_| true),
            Some(Where::Blend) => images * sum("reproject, blended", &|_| true),
            // The pass always tests.
            Some(Where::SurfaceUntested) => return None,
        };
        ms += match recipe.clamp {
            Clamp::Off => 0.0,
            Clamp::Near => sum("variance_clamp", &|_| true),
            Clamp::Wide => {
                sum("packed_visibility", &|c| c.step == "pack") + sum("visibility_clamp", &|_| true)
            }
        };
        let [accumulate, svgf] = if color {
            ["accumulate, RGB", "svgf, RGB"]
        } else {
            ["accumulate, scalar", "svgf, scalar"]
        };
        if recipe.history.is_some() || recipe.passes > 0 {
            ms += sum(accumulate, &|_| true);
        }
        if recipe.passes > 0 {
            ms += sum(svgf, &|c| c.step == "variance");
            let steps: Vec<String> = (0..recipe.passes)
                .map(|i| format!("step {}", 1 << i))
                .collect();
            ms += sum(svgf, &|c| steps.contains(&c.step));
        }
        Some(ms)
    }
}
