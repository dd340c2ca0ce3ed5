//! The wgpu passes of all filters, used as users would: over storage buffers and
//! over textures, against the CPU twins pixel by pixel. The precise build must
//! give the CPU's bits; the shipped one, whose error the contracts bound, must
//! be near enough to show that it reads and writes the right things. And broken
//! pixels stay where they are.

use std::cell::Cell;

use glam::{UVec2, Vec2, Vec3};
use raytwin::filter::bilateral_upsample::*;
use raytwin::filter::bilateral_variance::*;
use raytwin::filter::firefly::*;
use raytwin::filter::packed_visibility::*;
use raytwin::filter::separable_blur::*;
use raytwin::filter::spatial_reconstruct::*;
use raytwin::filter::svgf::{
    SvgfColor, SvgfScalar, SvgfSettings, SvgfSurface, svgf_atrous_pixel, svgf_atrous_scalar_pixel,
    svgf_variance_pixel, svgf_variance_scalar_pixel,
};
use raytwin::math::octahedral::{octahedral_encode, octahedral_unpack};
use raytwin::math::vector::{vec3_cross, vec3_dot, vec3_length, vec3_normalize};
use raytwin::pass::image::*;
use raytwin::random::pcg::{pcg_hash, pcg_unit};
use raytwin::ray::camera::{Camera, camera_position_from_depth};
use raytwin::temporal::accumulate::*;
use raytwin::temporal::reproject::*;
use raytwin::temporal::taa::taa_pixel;
use raytwin::temporal::variance_clamp::*;
use raytwin::temporal::visibility_clamp::visibility_clamp_pixel;
use raytwin::wgsl::Images;
use raytwin_tests::gpu::{Build, Gpu, adapters, pass_module};

/// No multiple of a workgroup, a block, or two.
const SIZE: UVec2 = UVec2::new(45, 29);
const LOW: UVec2 = UVec2::new(23, 15);
const REACH: f32 = 0.05;

fn pixels(size: UVec2) -> impl Iterator<Item = UVec2> {
    (0..size.x * size.y).map(move |i| UVec2::new(i % size.x, i / size.x))
}

fn at(image: &[f32], size: UVec2, channels: usize, pixel: UVec2) -> &[f32] {
    let index = (pixel.y * size.x + pixel.x) as usize * channels;
    &image[index..index + channels]
}

fn vec3(texel: &[f32]) -> Vec3 {
    Vec3::new(texel[0], texel[1], texel[2])
}

fn noise(pixel: UVec2, lane: u32) -> f32 {
    pcg_unit(pcg_hash(pixel.x ^ pcg_hash(pixel.y ^ pcg_hash(lane))))
}

/// Four channels, from 0 to 4, with a bright pixel here and there.
fn colors(size: UVec2, lane: u32) -> Vec<f32> {
    let channel = |pixel, i| {
        let bright = if noise(pixel, lane + 9) > 0.97 {
            40.0
        } else {
            1.0
        };
        4.0 * noise(pixel, lane + i) * bright
    };
    pixels(size)
        .flat_map(|p| [0, 1, 2, 3].map(|i| channel(p, i)))
        .collect()
}

fn scalars(size: UVec2, lane: u32) -> Vec<f32> {
    pixels(size).map(|p| noise(p, lane)).collect()
}

fn camera(step: f32) -> Camera {
    Camera {
        origin: Vec3::new(0.1 + step, 0.2, 1.0),
        right: Vec3::new(0.8, 0.0, 0.1 * step),
        up: Vec3::new(0.0, 0.5, 0.0),
        forward: vec3_normalize(Vec3::new(-0.1 * step, 0.0, -1.0)),
        inverse_resolution: Vec2::new(1.0 / SIZE.x as f32, 1.0 / SIZE.y as f32),
    }
}

/// What a G-buffer says of a pixel.
#[derive(Clone, Copy)]
struct Surface {
    depth: f32,
    normal_bits: u32,
    mesh: u32,
    position: Vec3,
    reach: f32,
    normal: Vec3,
}

/// A wall with a step, sky above; `scale` pixels of the full image each.
fn surfaces(size: UVec2, scale: f32, camera: Camera) -> Vec<Surface> {
    let snorm = |x: f32| (x * 32767.0 + 0.5).floor() as i32 as u32 & 0xffff;
    pixels(size)
        .map(|p| {
            let full = (p.as_vec2() + 0.5) * scale;
            let step = if full.x > 30.0 { 2.0 } else { 0.0 };
            let sky = full.y < 4.0;
            let depth = if sky {
                0.0
            } else {
                3.0 + step + 0.01 * noise(p, 1)
            };
            let tilt = Vec3::new(0.2 * noise(p, 2), 0.2 * noise(p, 3), 1.0);
            let oct = octahedral_encode(tilt);
            let normal_bits = snorm(oct.x) | snorm(oct.y) << 16;
            Surface {
                depth,
                normal_bits,
                mesh: if sky { 0 } else { (full.x as u32) / 16 + 7 },
                position: if sky {
                    Vec3::ZERO
                } else {
                    camera_position_from_depth(full, depth, camera)
                },
                reach: REACH * depth,
                normal: if sky {
                    Vec3::Z
                } else {
                    octahedral_unpack(normal_bits)
                },
            }
        })
        .collect()
}

/// Makes and reads images of one kind on one adapter.
struct Lab<'a> {
    gpu: &'a Gpu,
    images: Images,
    build: Build,
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
            Self::GBuffer(planes, camera) => (planes, camera),
        };
        let [depths, normals, meshes] = planes.each_ref().map(|image| match image {
            Image::Texture { view, .. } => view,
            Image::Buffer(_) => unreachable!("a G-buffer has textures"),
        });
        let meshes = Some(meshes);
        let (camera, reach) = (*camera, REACH);
        GBuffer {
            depths,
            normals,
            meshes,
            camera,
            reach,
        }
        .into()
    }
}

impl Lab<'_> {
    fn device(&self) -> &wgpu::Device {
        self.gpu.device()
    }

    fn texture(&self, size: UVec2, format: wgpu::TextureFormat, words: &[u32]) -> Image {
        let extent = wgpu::Extent3d {
            width: size.x,
            height: size.y,
            depth_or_array_layers: 1,
        };
        let texture = self.device().create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: extent,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        self.gpu.queue().write_texture(
            texture.as_image_copy(),
            &bytes,
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

    /// An image of floats; the number of channels follows from the sizes.
    fn floats(&self, size: UVec2, values: &[f32]) -> Image {
        let words: Vec<u32> = values.iter().map(|x| x.to_bits()).collect();
        if self.images == Images::Buffers {
            return Image::Buffer(self.gpu.buffer(&words));
        }
        let format = match values.len() / (size.x * size.y) as usize {
            1 => wgpu::TextureFormat::R32Float,
            2 => wgpu::TextureFormat::Rg32Float,
            _ => wgpu::TextureFormat::Rgba32Float,
        };
        self.texture(size, format, &words)
    }

    /// Surfaces as a filter's buffer wants them: a list of words each.
    fn surfaces(
        &self,
        size: UVec2,
        all: &[Surface],
        camera: Camera,
        words: impl Fn(&Surface) -> Vec<u32>,
    ) -> Surfaces {
        if self.images == Images::Buffers {
            let words: Vec<u32> = all.iter().flat_map(words).collect();
            return Surfaces::Buffer(self.gpu.buffer(&words));
        }
        let plane = |format, word: &dyn Fn(&Surface) -> u32| {
            let words: Vec<u32> = all.iter().map(word).collect();
            self.texture(size, format, &words)
        };
        let images = [
            plane(wgpu::TextureFormat::R32Float, &|s| s.depth.to_bits()),
            plane(wgpu::TextureFormat::R32Uint, &|s| s.normal_bits),
            plane(wgpu::TextureFormat::R32Uint, &|s| s.mesh),
        ];
        Surfaces::GBuffer(Box::new(images), camera)
    }

    fn compile(&self, program: &PassProgram<'_>) -> wgpu::ShaderModule {
        pass_module(self.gpu, program, self.build).unwrap_or_else(|e| panic!("{e}"))
    }

    fn run(&self, pass: &BoundPass) {
        let mut encoder = self.device().create_command_encoder(&Default::default());
        pass.encode(&mut encoder);
        self.gpu.queue().submit([encoder.finish()]);
    }

    /// The numbers of an image.
    fn read(&self, image: &Image, channels: usize) -> Vec<f32> {
        let count = (SIZE.x * SIZE.y) as usize * channels;
        let float = |words: Vec<u32>| words.into_iter().map(f32::from_bits).collect();
        let texture = match image {
            Image::Buffer(buffer) => return float(self.gpu.read(buffer, count)),
            Image::Texture { texture, .. } => texture,
        };
        let half = texture.format() == wgpu::TextureFormat::Rgba16Float;
        let row = SIZE.x as usize * channels * if half { 2 } else { 4 };
        let pitch = row.next_multiple_of(256);
        let buffer = self.gpu.buffer(&vec![0; pitch / 4 * SIZE.y as usize]);
        let mut encoder = self.device().create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(pitch as u32),
                    rows_per_image: None,
                },
            },
            texture.size(),
        );
        self.gpu.queue().submit([encoder.finish()]);
        let words = self.gpu.read(&buffer, pitch / 4 * SIZE.y as usize);
        let rows = words.chunks(pitch / 4).map(|r| &r[..row.div_ceil(4)]);
        if !half {
            return float(rows.flatten().copied().collect());
        }
        rows.flat_map(|r| r.iter().flat_map(|w| [*w as u16, (w >> 16) as u16]))
            .map(half_to_f32)
            .collect()
    }
}

/// The number that 16 bits hold.
fn half_to_f32(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, mantissa) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    sign * match exponent {
        0 => mantissa * 2f32.powi(-24),
        31 if mantissa == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + mantissa) * 2f32.powi(exponent - 25),
    }
}

/// Runs a filter over all kinds of images, in both builds, on every adapter, and
/// compares it with the CPU's image.
fn check(name: &str, channels: usize, expected: &[f32], run: impl Fn(&Lab<'_>) -> Vec<f32>) {
    let exact_runs = Cell::new(0);
    let largest = expected.iter().fold(0.0f32, |a, x| a.max(x.abs()));
    assert!(largest > 0.0 && expected.iter().all(|x| x.is_finite()));
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        for images in [Images::Buffers, Images::Textures16, Images::Textures32] {
            for build in [Build::Plain, Build::Precise] {
                if build == Build::Precise && !gpu.has_precise() {
                    continue;
                }
                let found = run(&Lab { gpu, images, build });
                assert_eq!(found.len(), expected.len());
                let exact = build == Build::Precise && gpu.is_software();
                exact_runs.set(exact_runs.get() + usize::from(exact));
                for (i, (x, y)) in found.iter().zip(expected).enumerate() {
                    // A store to 16 bits may round either way.
                    let half = if images == Images::Textures16 {
                        (y.abs() / 1024.0).max(2f32.powi(-24))
                    } else {
                        0.0
                    };
                    let rest = if exact { 0.0 } else { 1e-3 * largest };
                    let pixel = i / channels;
                    assert!(
                        (x - y).abs() <= half + rest,
                        "{name}, {}, {images:?}, {build:?}: {x} instead of {y} at ({}, {}), \
                         channel {}",
                        gpu.label(),
                        pixel % SIZE.x as usize,
                        pixel / SIZE.x as usize,
                        i % channels,
                    );
                }
            }
        }
    }
    assert!(
        exact_runs.get() > 0,
        "no adapter ran the precise build: no bits were compared"
    );
}

fn place_and_shape(s: &Surface) -> Vec<u32> {
    let (p, n) = (s.position, s.normal);
    [p.x, p.y, p.z, s.reach, n.x, n.y, n.z, 0.0]
        .map(f32::to_bits)
        .to_vec()
}

fn opaque(color: Vec3) -> [f32; 4] {
    [color.x, color.y, color.z, 1.0]
}

// -- Filters of one frame

fn firefly(lab: &Lab<'_>, input: &[f32], kind: FireflyKind) -> Vec<f32> {
    let pass = FireflyGpu::with_compiler(lab.device(), SIZE, lab.images, |p| lab.compile(p))
        .expect("registered");
    let (input, results) = (lab.floats(SIZE, input), pass.target(lab.device()));
    let images = FireflyImages {
        colors: (&input).into(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(lab.device(), kind, images).expect("fits"));
    lab.read(&results, 4)
}

#[test]
fn firefly_is_its_cpu_twin() {
    let input = colors(SIZE, 10);
    let read = |p| vec3(at(&input, SIZE, 4, p));
    for kind in [FireflyKind::Cap, FireflyKind::Rank, FireflyKind::Clamp(2.0)] {
        let expected: Vec<f32> = pixels(SIZE)
            .flat_map(|p| {
                opaque(match kind {
                    FireflyKind::Cap => firefly_cap_pixel(p, SIZE, read),
                    FireflyKind::Rank => firefly_rank_pixel(p, SIZE, read),
                    FireflyKind::Clamp(gamma) => firefly_clamp_pixel(p, SIZE, gamma, read),
                })
            })
            .collect();
        check(&format!("{kind:?}"), 4, &expected, |lab| {
            firefly(lab, &input, kind)
        });
    }
}

fn blur(lab: &Lab<'_>, input: &[f32]) -> Vec<f32> {
    let pass = SeparableBlurGpu::with_compiler(lab.device(), SIZE, lab.images, |p| lab.compile(p))
        .expect("registered");
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let all = lab.surfaces(SIZE, &all, camera(0.0), place_and_shape);
    let (input, results) = (lab.floats(SIZE, input), pass.target(lab.device()));
    let images = SeparableBlurImages {
        values: (&input).into(),
        surfaces: all.get(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(lab.device(), 4, images).expect("fits"));
    lab.read(&results, 1)
}

#[test]
fn separable_blur_is_its_cpu_twin() {
    let input = scalars(SIZE, 20);
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let axis = |values: &[f32], axis| -> Vec<f32> {
        let read = |p: UVec2| {
            let s = all[(p.y * SIZE.x + p.x) as usize];
            SeparableBlurPixel {
                position: s.position,
                reach: s.reach,
                normal: s.normal,
                value: at(values, SIZE, 1, p)[0],
            }
        };
        pixels(SIZE)
            .map(|p| separable_blur_pixel(p, SIZE, axis, 4, read))
            .collect()
    };
    let expected = axis(&axis(&input, 0), 1);
    check("separable_blur", 1, &expected, |lab| blur(lab, &input));
}

const UPSAMPLE: BilateralUpsampleSettings = BilateralUpsampleSettings {
    low_size: LOW,
    scale: 2,
};

fn upsample(lab: &Lab<'_>, input: &[f32]) -> Vec<f32> {
    let device = lab.device();
    let pass = BilateralUpsampleGpu::with_compiler(device, SIZE, lab.images, |p| lab.compile(p))
        .expect("registered");
    let full = surfaces(SIZE, 1.0, camera(0.0));
    let full = lab.surfaces(SIZE, &full, camera(0.0), place_and_shape);
    let low = surfaces(LOW, 2.0, camera(0.0));
    let low = lab.surfaces(LOW, &low, camera(0.0), place_and_shape);
    let (input, results) = (lab.floats(LOW, input), pass.target(device));
    let images = BilateralUpsampleImages {
        surfaces: full.get(),
        colors: (&input).into(),
        low_surfaces: low.get(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, UPSAMPLE, images).expect("fits"));
    lab.read(&results, 4)
}

/// Colours with a weight where there is a surface.
fn weighted(size: UVec2, scale: f32, lane: u32) -> Vec<f32> {
    let mut all = colors(size, lane);
    for (texel, s) in all.chunks_mut(4).zip(surfaces(size, scale, camera(0.0))) {
        texel[3] = if s.depth > 0.0 { 1.0 } else { 0.0 };
    }
    all
}

#[test]
fn bilateral_upsample_is_its_cpu_twin() {
    let input = weighted(LOW, 2.0, 30);
    let full = surfaces(SIZE, 1.0, camera(0.0));
    let low = surfaces(LOW, 2.0, camera(0.0));
    let surface = |p: UVec2| {
        let s = full[(p.y * SIZE.x + p.x) as usize];
        BilateralUpsampleSurface {
            position: s.position,
            reach: s.reach,
            normal: s.normal,
        }
    };
    let tap = |p: UVec2| {
        let s = low[(p.y * LOW.x + p.x) as usize];
        let texel = at(&input, LOW, 4, p);
        BilateralUpsampleTap {
            color: vec3(texel),
            weight: texel[3],
            position: s.position,
            normal: s.normal,
        }
    };
    let expected: Vec<f32> = pixels(SIZE)
        .flat_map(|p| opaque(bilateral_upsample_pixel(p, LOW, 2, surface, tap)))
        .collect();
    check("bilateral_upsample", 4, &expected, |lab| {
        upsample(lab, &input)
    });
}

const BILATERAL: BilateralVarianceSettings = BilateralVarianceSettings {
    max_radius: 5.0,
    max_taps: 12,
    seed: 77,
};

fn turn(p: UVec2) -> f32 {
    pcg_unit(pcg_hash(p.x ^ pcg_hash(p.y ^ pcg_hash(77))))
}

fn bilateral(lab: &Lab<'_>, input: &[f32]) -> Vec<f32> {
    let device = lab.device();
    let pass = BilateralVarianceGpu::with_compiler(device, SIZE, lab.images, |p| lab.compile(p))
        .expect("registered");
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let all = lab.surfaces(SIZE, &all, camera(0.0), place_and_shape);
    let (input, results) = (lab.floats(SIZE, input), pass.target(device));
    let images = BilateralVarianceImages {
        colors: (&input).into(),
        surfaces: all.get(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, BILATERAL, images).expect("fits"));
    lab.read(&results, 4)
}

#[test]
fn bilateral_variance_is_its_cpu_twin() {
    let input = colors(SIZE, 40);
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let read = |p: UVec2| {
        let s = all[(p.y * SIZE.x + p.x) as usize];
        let texel = at(&input, SIZE, 4, p);
        BilateralVariancePixel {
            color: vec3(texel),
            variance: texel[3],
            position: s.position,
            reach: s.reach,
            normal: s.normal,
        }
    };
    let expected: Vec<f32> = pixels(SIZE)
        .flat_map(|p| opaque(bilateral_variance_pixel(p, SIZE, 5.0, 12, turn(p), read)))
        .collect();
    check("bilateral_variance", 4, &expected, |lab| {
        bilateral(lab, &input)
    });
}

/// Where half-resolution rays hit, and GGX's alpha at full resolution.
fn hits() -> (Vec<f32>, Vec<f32>) {
    let hits = pixels(LOW)
        .flat_map(|p| {
            let pdf = if noise(p, 54) > 0.1 {
                0.2 + noise(p, 55)
            } else {
                0.0
            };
            [noise(p, 51), noise(p, 52), 1.0 + noise(p, 53), pdf]
        })
        .collect();
    let alphas = pixels(SIZE).map(|p| 0.1 + 0.5 * noise(p, 56)).collect();
    (hits, alphas)
}

fn viewer(s: &Surface) -> Vec3 {
    vec3_normalize(camera(0.0).origin - s.position)
}

fn reconstruct(lab: &Lab<'_>, radiances: &[f32]) -> Vec<f32> {
    let device = lab.device();
    let pass = SpatialReconstructGpu::with_compiler(device, SIZE, lab.images, |p| lab.compile(p))
        .expect("registered");
    let (hits, alphas) = hits();
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let turn = Cell::new(0);
    let all = lab.surfaces(SIZE, &all, camera(0.0), |s| {
        let alpha = alphas[turn.replace(turn.get() + 1)];
        let (p, n, v) = (s.position, s.normal, viewer(s));
        [
            p.x, p.y, p.z, s.reach, n.x, n.y, n.z, alpha, v.x, v.y, v.z, 0.0,
        ]
        .map(f32::to_bits)
        .to_vec()
    });
    let (hits, radiances) = (lab.floats(LOW, &hits), lab.floats(LOW, radiances));
    let (alphas, results) = (lab.floats(SIZE, &alphas), pass.target(device));
    let settings = SpatialReconstructSettings {
        low_size: LOW,
        count: 8,
        seed: 77,
    };
    let images = SpatialReconstructImages {
        hits: (&hits).into(),
        radiances: (&radiances).into(),
        surfaces: all.get(),
        alphas: Some((&alphas).into()),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, settings, images).expect("fits"));
    lab.read(&results, 4)
}

#[test]
fn spatial_reconstruct_is_its_cpu_twin() {
    let radiances = colors(LOW, 60);
    let (hits, alphas) = hits();
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let surface = |p: UVec2| {
        let inside = p.x < SIZE.x && p.y < SIZE.y;
        inside.then(|| all[(p.y * SIZE.x + p.x) as usize])
    };
    let read = |p: UVec2| {
        let texel = at(&hits, LOW, 4, p);
        SpatialReconstructHit {
            position: vec3(texel),
            pdf: texel[3],
            radiance: vec3(at(&radiances, LOW, 4, p)),
        }
    };
    // The ready bindings' weight, once more.
    let weight = |p: UVec2, tap: UVec2, hit: SpatialReconstructHit| {
        let (Some(own), Some(other)) = (surface(p), surface(2 * tap)) else {
            return 0.0;
        };
        let away = hit.position - own.position;
        if own.reach <= 0.0 || other.reach <= 0.0 || vec3_dot(away, away) <= 0.0 {
            return 0.0;
        }
        let light = vec3_normalize(away);
        let middle = light + viewer(&own);
        let cos_light = vec3_dot(own.normal, light);
        if cos_light <= 0.0 || vec3_dot(middle, middle) <= 1e-12 {
            return 0.0;
        }
        let h = vec3_normalize(middle);
        let side = vec3_cross(own.normal, h);
        let c = vec3_dot(own.normal, h);
        let alpha = at(&alphas, SIZE, 1, p)[0].max(1e-4);
        let wide = (alpha * alpha) * (c * c) + vec3_dot(side, side);
        let slope = alpha / wide;
        let toward = vec3_dot(light, h).max(1e-3);
        let lobe = (slope * slope) * 0.318_309_87 / (4.0 * (toward * toward));
        let offset = other.position - own.position;
        let edge = spatial_reconstruct_edge(own.normal, other.normal, offset, own.reach);
        (lobe * cos_light) * edge
    };
    let expected: Vec<f32> = pixels(SIZE)
        .flat_map(|p| {
            let found = spatial_reconstruct_pixel(p, LOW, 8, turn(p), read, weight);
            let c = found.color;
            [c.x, c.y, c.z, found.variance]
        })
        .collect();
    assert!(expected.chunks(4).filter(|c| c[3] > 0.0).count() > 200);
    check("spatial_reconstruct", 4, &expected, |lab| {
        reconstruct(lab, &radiances)
    });
}

fn svgf_surface(all: &[Surface], p: UVec2) -> SvgfSurface {
    let s = all[(p.y * SIZE.x + p.x) as usize];
    SvgfSurface {
        position: s.position,
        reach: s.reach,
        normal: s.normal,
    }
}

fn histories() -> Vec<f32> {
    pixels(SIZE).map(|p| (8.0 * noise(p, 70)).floor()).collect()
}

const SVGF: SvgfSettings = SvgfSettings {
    feedback: 1,
    ..SvgfSettings::PAPER
};

fn svgf_color(
    lab: &Lab<'_>,
    settings: SvgfSettings,
    input: &[f32],
    histories: &[f32],
) -> [Vec<f32>; 2] {
    let device = lab.device();
    let pass = SvgfColorImageGpu::with_compiler(device, SIZE, lab.images, |p| lab.compile(p))
        .expect("registered");
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let all = lab.surfaces(SIZE, &all, camera(0.0), place_and_shape);
    let [input, histories] = [input, histories].map(|all| lab.floats(SIZE, all));
    let [feedback, results] = [0, 1].map(|_| pass.target(device));
    let images = SvgfImages {
        input: (&input).into(),
        histories: (&histories).into(),
        surfaces: all.get(),
        feedback: Some((&feedback).into()),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, settings, images).expect("fits"));
    [lab.read(&results, 4), lab.read(&feedback, 4)]
}

fn svgf_scalar(
    lab: &Lab<'_>,
    settings: SvgfSettings,
    input: &[f32],
    histories: &[f32],
) -> Vec<f32> {
    let device = lab.device();
    let compile = |p: &PassProgram<'_>| lab.compile(p);
    let pass =
        SvgfScalarImageGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let all = lab.surfaces(SIZE, &all, camera(0.0), place_and_shape);
    let [input, histories] = [input, histories].map(|all| lab.floats(SIZE, all));
    let results = pass.target(device);
    let images = SvgfImages {
        input: (&input).into(),
        histories: (&histories).into(),
        surfaces: all.get(),
        feedback: None,
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, settings, images).expect("fits"));
    lab.read(&results, 2)
}

#[test]
fn svgf_of_colours_is_its_cpu_twin() {
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let surface = |p| svgf_surface(&all, p);
    let histories = histories();
    let mut image = colors(SIZE, 80);
    let input = image.clone();
    let mut feedback = Vec::new();
    for i in 0..=SVGF.passes {
        let read = |p| {
            let texel = at(&image, SIZE, 4, p);
            SvgfColor {
                value: vec3(texel),
                variance: texel[3],
            }
        };
        image = pixels(SIZE)
            .flat_map(|p| {
                let (value, variance) = if i == 0 {
                    let history = at(&histories, SIZE, 1, p)[0];
                    (
                        read(p).value,
                        svgf_variance_pixel(p, SIZE, history, SVGF, surface, read),
                    )
                } else {
                    let out = svgf_atrous_pixel(p, SIZE, 1 << (i - 1), SVGF, surface, read);
                    (out.value, out.variance)
                };
                [value.x, value.y, value.z, variance]
            })
            .collect();
        if i == SVGF.feedback + 1 {
            feedback.clone_from(&image);
        }
    }
    check_deep("svgf, colours", 4, &image, |lab| {
        svgf_color(lab, SVGF, &input, &histories)[0].clone()
    });
    check_deep("svgf, feedback", 4, &feedback, |lab| {
        svgf_color(lab, SVGF, &input, &histories)[1].clone()
    });
}

/// As [`check`] where several passes follow each other, so that images of 16
/// bits between them are not the twin's.
fn check_deep(name: &str, channels: usize, expected: &[f32], run: impl Fn(&Lab<'_>) -> Vec<f32>) {
    let largest = expected.iter().fold(0.0f32, |a, x| a.max(x.abs()));
    check(name, channels, expected, |lab| {
        let found = run(lab);
        if lab.images != Images::Textures16 {
            return found;
        }
        for (x, y) in found.iter().zip(expected) {
            // Six roundings of 2^-11, in values that weights depend on.
            assert!(
                (x - y).abs() <= 0.02 * largest,
                "{name}, 16 bits: {x} not {y}"
            );
        }
        expected.to_vec()
    });
}

#[test]
fn svgf_of_scalars_is_its_cpu_twin() {
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let surface = |p| svgf_surface(&all, p);
    let histories = histories();
    let input = noisy_scalars();
    let mut image = input.clone();
    for i in 0..=SVGF.passes {
        let read = |p| {
            let texel = at(&image, SIZE, 2, p);
            SvgfScalar {
                value: texel[0],
                variance: texel[1],
            }
        };
        image = pixels(SIZE)
            .flat_map(|p| {
                if i == 0 {
                    let history = at(&histories, SIZE, 1, p)[0];
                    let variance =
                        svgf_variance_scalar_pixel(p, SIZE, history, SVGF, surface, read);
                    return [read(p).value, variance];
                }
                let out = svgf_atrous_scalar_pixel(p, SIZE, 1 << (i - 1), SVGF, surface, read);
                [out.value, out.variance]
            })
            .collect();
    }
    check("svgf, scalars", 2, &image, |lab| {
        svgf_scalar(lab, SVGF, &input, &histories)
    });
}

fn noisy_scalars() -> Vec<f32> {
    pixels(SIZE)
        .flat_map(|p| [noise(p, 90), 0.1 * noise(p, 91)])
        .collect()
}

// -- Rays of one bit

fn visible() -> Vec<f32> {
    pixels(SIZE)
        .map(|p| if noise(p, 100) > 0.4 { 1.0 } else { 0.0 })
        .collect()
}

/// A block's word.
fn word(block: UVec2) -> u32 {
    let rays = visible();
    (0..32).fold(0, |word, lane| {
        let p = UVec2::new(8 * block.x + lane % 8, 4 * block.y + lane / 8);
        let lit = p.x < SIZE.x && p.y < SIZE.y && at(&rays, SIZE, 1, p)[0] > 0.0;
        word | u32::from(lit) << lane
    })
}

fn words() -> Vec<u32> {
    let blocks = UVec2::new(SIZE.x.div_ceil(8), SIZE.y.div_ceil(4));
    pixels(blocks).map(word).collect()
}

/// The packed rays, and their means; with subgroups where asked for.
fn packed(lab: &Lab<'_>, rays: &[f32], subgroups: bool) -> (PackedVisibilityGpu, Vec<f32>) {
    let device = lab.device();
    let pass = if subgroups {
        PackedVisibilityGpu::with_subgroups(device, SIZE, lab.images)
    } else {
        let compile = |p: &PassProgram<'_>| lab.compile(p);
        PackedVisibilityGpu::with_compiler(device, SIZE, lab.images, compile)
    };
    let pass = pass.expect("registered");
    let (rays, results) = (lab.floats(SIZE, rays), pass.target(device));
    let images = PackedVisibilityImages {
        visible: (&rays).into(),
        results: Some((&results).into()),
    };
    lab.run(&pass.bind(device, images).expect("fits"));
    (pass, lab.read(&results, 4))
}

fn visibility_clamp(lab: &Lab<'_>, packed: &PackedVisibilityGpu, histories: &[f32]) -> Vec<f32> {
    let device = lab.device();
    let compile = |p: &PassProgram<'_>| lab.compile(p);
    let pass =
        VisibilityClampGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
    let (known, results) = (lab.floats(SIZE, histories), pass.target(device));
    let images = VisibilityClampImages {
        words: packed.words().into(),
        histories: (&known).into(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, 0.5, images).expect("fits"));
    lab.read(&results, 1)
}

#[test]
fn packed_visibility_and_its_clamp_are_their_cpu_twins() {
    let words = words();
    let read = |block: UVec2| words[(block.y * SIZE.x.div_ceil(8) + block.x) as usize];
    let means: Vec<f32> = pixels(SIZE)
        .flat_map(|p| {
            let sum = packed_visibility_sum(p, SIZE, read);
            let area = packed_visibility_area(p, SIZE);
            [
                packed_visibility_mean(sum, area),
                packed_visibility_variance(sum, area),
                sum as f32,
                area as f32,
            ]
        })
        .collect();
    let histories = scalars(SIZE, 101);
    let clamped: Vec<f32> = pixels(SIZE)
        .map(|p| visibility_clamp_pixel(p, SIZE, at(&histories, SIZE, 1, p)[0], 0.5, read))
        .collect();
    let subgroups = Cell::new(0);
    let run = |lab: &Lab<'_>| {
        let has = lab.device().features().contains(wgpu::Features::SUBGROUP);
        let with = lab.build == Build::Plain && has;
        subgroups.set(subgroups.get() + usize::from(with));
        packed(lab, &visible(), with)
    };
    check("packed_visibility", 4, &means, |lab| run(lab).1);
    check("visibility_clamp", 1, &clamped, |lab| {
        visibility_clamp(lab, &run(lab).0, &histories)
    });
    if subgroups.get() == 0 {
        println!("NOT RUN: no adapter here has subgroup operations");
    }
}

// -- Over time

const ACCUMULATE: AccumulateSettings = AccumulateSettings {
    cap: 6.0,
    moments_cap: 4.0,
};

/// Colours with the length of their history, and moments.
fn accumulated() -> [Vec<f32>; 2] {
    let mut known = colors(SIZE, 112);
    let mut moments = vec![0.0; known.len()];
    for (i, p) in pixels(SIZE).enumerate() {
        let length = (9.0 * noise(p, 111)).floor();
        known[4 * i + 3] = length;
        moments[4 * i] = 1.0 + known[4 * i];
        moments[4 * i + 1] = 0.5 * known[4 * i + 1];
        moments[4 * i + 3] = length;
    }
    [known, moments]
}

/// New colours and moments after samples, colours and moments.
fn accumulate_colors(lab: &Lab<'_>, [samples, known, moments]: [&[f32]; 3]) -> [Vec<f32>; 2] {
    let device = lab.device();
    let compile = |p: &PassProgram<'_>| lab.compile(p);
    let pass = AccumulateGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
    let [samples, known, moments] = [samples, known, moments].map(|all| lab.floats(SIZE, all));
    let (colors, kept) = (pass.target_colors(device), pass.target_moments(device));
    let images = AccumulateColorImages {
        samples: (&samples).into(),
        colors: (&known).into(),
        moments: (&moments).into(),
        new_colors: (&colors).into(),
        new_moments: (&kept).into(),
    };
    lab.run(&pass.bind_color(device, ACCUMULATE, images).expect("fits"));
    [lab.read(&colors, 4), lab.read(&kept, 4)]
}

fn accumulate_scalars(lab: &Lab<'_>, samples: &[f32], moments: &[f32]) -> Vec<f32> {
    let device = lab.device();
    let compile = |p: &PassProgram<'_>| lab.compile(p);
    let pass = AccumulateGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
    let [samples, moments] = [samples, moments].map(|all| lab.floats(SIZE, all));
    let kept = pass.target_moments(device);
    let images = AccumulateScalarImages {
        samples: (&samples).into(),
        moments: (&moments).into(),
        new_moments: (&kept).into(),
    };
    lab.run(&pass.bind_scalar(device, ACCUMULATE, images).expect("fits"));
    lab.read(&kept, 4)
}

#[test]
fn accumulate_is_its_cpu_twin() {
    let settings = ACCUMULATE;
    let samples = colors(SIZE, 110);
    let [known, moments] = accumulated();
    let states: Vec<TemporalAccumulateRgbState> = pixels(SIZE)
        .map(|p| {
            let (color, moment) = (at(&known, SIZE, 4, p), at(&moments, SIZE, 4, p));
            let state = TemporalAccumulateRgbState {
                color: vec3(color),
                mean_luminance: moment[0],
                variance: moment[1],
                history: color[3],
            };
            let sample = vec3(at(&samples, SIZE, 4, p));
            temporal_accumulate_rgb_step(state, sample, settings.cap, settings.moments_cap)
        })
        .collect();
    let new_colors: Vec<f32> = states
        .iter()
        .flat_map(|s| [s.color.x, s.color.y, s.color.z, s.history])
        .collect();
    let new_moments: Vec<f32> = states
        .iter()
        .flat_map(|s| [s.mean_luminance, s.variance, 0.0, s.history])
        .collect();
    let run = |lab: &Lab<'_>| accumulate_colors(lab, [&samples, &known, &moments]);
    check("accumulate, colours", 4, &new_colors, |lab| {
        run(lab)[0].clone()
    });
    check("accumulate, moments", 4, &new_moments, |lab| {
        run(lab)[1].clone()
    });

    let samples = scalars(SIZE, 113);
    let expected: Vec<f32> = pixels(SIZE)
        .flat_map(|p| {
            let moment = at(&moments, SIZE, 4, p);
            let state = TemporalAccumulateState {
                mean: moment[0],
                variance: moment[1],
                history: moment[3],
            };
            let sample = at(&samples, SIZE, 1, p)[0];
            let s = temporal_accumulate_step(state, sample, settings.cap);
            [s.mean, s.variance, 0.0, s.history]
        })
        .collect();
    check("accumulate, scalars", 4, &expected, |lab| {
        accumulate_scalars(lab, &samples, &moments)
    });
}

/// Two frames of a moving camera, with histories, motions, mirrors.
struct Frames {
    cameras: [Camera; 2],
    surfaces: [Vec<Surface>; 2],
    histories: Vec<f32>,
    motions: Vec<f32>,
    distances: Vec<f32>,
    colors: Vec<f32>,
}

impl Frames {
    fn new() -> Self {
        let cameras = [camera(0.0), camera(0.02)];
        let all = cameras.map(|c| surfaces(SIZE, 1.0, c));
        let motions = all[0]
            .iter()
            .zip(pixels(SIZE))
            .flat_map(|(s, p)| {
                let m = if s.depth > 0.0 {
                    reproject_motion(s.position, s.position, cameras[0], cameras[1])
                } else {
                    Vec2::ZERO
                };
                [m.x, m.y, 0.02 * noise(p, 120), 0.0]
            })
            .collect();
        let mut histories = colors(SIZE, 121);
        for (i, p) in pixels(SIZE).enumerate() {
            histories[4 * i + 3] = (9.0 * noise(p, 122)).floor();
        }
        Self {
            cameras,
            surfaces: all,
            histories,
            motions,
            distances: pixels(SIZE).map(|p| 0.5 + 2.0 * noise(p, 123)).collect(),
            colors: colors(SIZE, 124),
        }
    }

    fn surface(&self, frame: usize, p: UVec2) -> ReprojectSurface {
        let s = self.surfaces[frame][(p.y * SIZE.x + p.x) as usize];
        ReprojectSurface {
            position: s.position,
            depth: if s.depth > 0.0 {
                vec3_length(s.position - self.cameras[frame].origin)
            } else {
                0.0
            },
            normal: s.normal,
            mesh: s.mesh,
        }
    }

    fn history(
        &self,
        p: UVec2,
        surface: ReprojectSurface,
        motion: Vec2,
        place: Vec3,
        curved: bool,
    ) -> ReprojectHistory<Vec3> {
        let mut curvature = 0.0;
        if curved && motion != Vec2::ZERO && motion.abs().max_element() < REPROJECT_FAR {
            let bend = reproject_bend(p, SIZE, motion, |p| self.surface(0, p));
            curvature = reproject_curvature(bend.along, bend.turn);
        }
        let mut expected = surface;
        if surface.depth > 0.0 {
            expected.position = place;
            expected.depth = vec3_length(place - self.cameras[1].origin);
        }
        let read = |p| {
            let texel = at(&self.histories, SIZE, 4, p);
            ReprojectHistory {
                value: vec3(texel),
                length: texel[3],
            }
        };
        reproject_pixel(
            p,
            SIZE,
            motion,
            expected,
            curvature,
            REPROJECT_TOLERANCE,
            |p| self.surface(1, p),
            read,
        )
    }

    /// The surface's own history.
    fn own(&self, p: UVec2, curved: bool) -> ReprojectHistory<Vec3> {
        let surface = self.surface(0, p);
        let m = at(&self.motions, SIZE, 4, p);
        let mut place = surface.position;
        if surface.depth > 0.0 {
            let from = surface.position - self.cameras[0].origin;
            let depth = vec3_dot(from, self.cameras[0].forward);
            let then = Vec2::new((p.x as f32 + 0.5) + m[0], (p.y as f32 + 0.5) + m[1]);
            place = camera_position_from_depth(then, depth + m[2], self.cameras[1]);
        }
        self.history(p, surface, Vec2::new(m[0], m[1]), place, curved)
    }

    fn mirrored(&self, p: UVec2) -> ReprojectHistory<Vec3> {
        let distance = at(&self.distances, SIZE, 1, p)[0];
        let [now, then] = self.cameras;
        let read = |p| self.surface(0, p);
        let motion = reproject_reflection_motion(p, SIZE, distance, now, then, read);
        let surface = self.surface(0, p);
        let found = self.history(p, surface, motion, surface.position, true);
        let own = self.own(p, true);
        let mut seen = VARIANCE_CLAMP_EMPTY;
        for y in p.y.saturating_sub(2)..=(p.y + 2).min(SIZE.y - 1) {
            for x in p.x.saturating_sub(2)..=(p.x + 2).min(SIZE.x - 1) {
                let color = vec3(at(&self.colors, SIZE, 4, UVec2::new(x, y)));
                seen = variance_clamp_add(seen, color, 0);
            }
        }
        let part = seen.spread / seen.count.max(1.0);
        let deviation = Vec3::new(part.x.sqrt(), part.y.sqrt(), part.z.sqrt());
        let share = reproject_share(
            reproject_color_distance(own.value, seen.mean, deviation),
            reproject_color_distance(found.value, seen.mean, deviation),
        );
        reproject_blend(own, found, share)
    }

    fn run(&self, lab: &Lab<'_>, mirrors: bool) -> Vec<f32> {
        let device = lab.device();
        let compile = |p: &PassProgram<'_>| lab.compile(p);
        let pass =
            ReprojectGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
        let mut surfaces = [0, 1].map(|frame| {
            let camera = self.cameras[frame];
            lab.surfaces(SIZE, &self.surfaces[frame], camera, |s| {
                let (p, n) = (s.position, s.normal);
                let depth = if s.depth > 0.0 {
                    vec3_length(p - camera.origin)
                } else {
                    0.0
                };
                let mut words = [p.x, p.y, p.z, depth, n.x, n.y, n.z]
                    .map(f32::to_bits)
                    .to_vec();
                words.push(s.mesh);
                words
            })
        });
        let [now, then] = &mut surfaces;
        let histories = lab.floats(SIZE, &self.histories);
        let motions = lab.floats(SIZE, &self.motions);
        let distances = lab.floats(SIZE, &self.distances);
        let colors = lab.floats(SIZE, &self.colors);
        let results = pass.target(device);
        let settings = ReprojectSettings {
            camera: self.cameras[0],
            prior_camera: self.cameras[1],
            tolerance: REPROJECT_TOLERANCE,
            curved: true,
            moving: true,
        };
        let images = ReprojectImages {
            surfaces: now.get(),
            prior_surfaces: then.get(),
            histories: (&histories).into(),
            motions: (&motions).into(),
            results: (&results).into(),
        };
        let bound = if mirrors {
            let mirrors = ReprojectMirrors {
                distances: (&distances).into(),
                colors: (&colors).into(),
                blend: true,
            };
            pass.bind_reflection(device, settings, images, mirrors)
        } else {
            pass.bind_surface(device, settings, images)
        };
        lab.run(&bound.expect("fits"));
        lab.read(&results, 4)
    }
}

fn with_length(found: ReprojectHistory<Vec3>) -> [f32; 4] {
    let v = found.value;
    [v.x, v.y, v.z, found.length]
}

#[test]
fn reprojection_is_its_cpu_twin() {
    let frames = Frames::new();
    let own: Vec<f32> = pixels(SIZE)
        .flat_map(|p| with_length(frames.own(p, true)))
        .collect();
    let kept = own.chunks(4).filter(|t| t[3] > 0.0).count();
    assert!((400..1300).contains(&kept), "{kept} pixels have a history");
    check("reproject, surfaces", 4, &own, |lab| frames.run(lab, false));
    let mirrored: Vec<f32> = pixels(SIZE)
        .flat_map(|p| with_length(frames.mirrored(p)))
        .collect();
    check("reproject, mirrors", 4, &mirrored, |lab| {
        frames.run(lab, true)
    });
}

fn taa(lab: &Lab<'_>, input: &[f32], histories: &[f32]) -> Vec<f32> {
    let device = lab.device();
    let compile = |p: &PassProgram<'_>| lab.compile(p);
    let pass = TaaGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
    let [input, histories] = [input, histories].map(|all| lab.floats(SIZE, all));
    let results = pass.target(device);
    let settings = TaaSettings {
        alpha: 0.1,
        exposure: 0.5,
    };
    let images = TaaImages {
        colors: (&input).into(),
        histories: (&histories).into(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, settings, images).expect("fits"));
    lab.read(&results, 4)
}

#[test]
fn taa_is_its_cpu_twin() {
    let (input, histories) = (colors(SIZE, 130), weighted(SIZE, 1.0, 131));
    let read = |p| vec3(at(&input, SIZE, 4, p));
    let expected: Vec<f32> = pixels(SIZE)
        .flat_map(|p| {
            let known = at(&histories, SIZE, 4, p);
            let alpha = if known[3] <= 0.0 { 1.0 } else { 0.1 };
            opaque(taa_pixel(p, SIZE, vec3(known), alpha, 0.5, read))
        })
        .collect();
    check("taa", 4, &expected, |lab| taa(lab, &input, &histories));
}

fn variance_clamp(lab: &Lab<'_>, input: &[f32], histories: &[f32], mode: u32) -> Vec<f32> {
    let device = lab.device();
    let compile = |p: &PassProgram<'_>| lab.compile(p);
    let pass =
        VarianceClampGpu::with_compiler(device, SIZE, lab.images, compile).expect("registered");
    let [input, histories] = [input, histories].map(|all| lab.floats(SIZE, all));
    let results = pass.target(device);
    let settings = VarianceClampSettings {
        radius: 2,
        mode,
        gamma: 1.0,
    };
    let images = VarianceClampImages {
        colors: (&input).into(),
        histories: (&histories).into(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(device, settings, images).expect("fits"));
    lab.read(&results, 4)
}

#[test]
fn variance_clamp_is_its_cpu_twin() {
    let (input, histories) = (colors(SIZE, 140), colors(SIZE, 141));
    let read = |p| vec3(at(&input, SIZE, 4, p));
    for mode in 0..4 {
        let expected: Vec<f32> = pixels(SIZE)
            .flat_map(|p| {
                let known = at(&histories, SIZE, 4, p);
                let c = variance_clamp_pixel(p, SIZE, 2, vec3(known), 1.0, mode, read);
                [c.x, c.y, c.z, known[3]]
            })
            .collect();
        check(
            &format!("variance_clamp, mode {mode}"),
            4,
            &expected,
            |lab| variance_clamp(lab, &input, &histories, mode),
        );
    }
}

// -- Broken pixels

/// Broken pixels next to each other: one with all channels broken, or for each
/// channel one where it alone is.
fn breaks(channels: usize) -> Vec<Vec<Vec<usize>>> {
    let all = vec![(0..channels).collect()];
    let each: Vec<Vec<usize>> = (0..channels).map(|c| vec![c]).collect();
    if channels == 1 {
        return vec![all];
    }
    vec![all, each]
}

/// Runs a filter over a sound image and over the same with broken pixels, over
/// all kinds of images: what lies farther than `radius` from them (in pixels of
/// the input) is the same bit by bit, and nothing is NaN or infinite.
fn contained(
    name: &str,
    input: &[f32],
    size: UVec2,
    radius: u32,
    run: impl Fn(&Lab<'_>, &[f32]) -> Vec<f32>,
) {
    let scale = SIZE.x.div_ceil(size.x);
    let corner = UVec2::new(size.x / 2 - 2, size.y / 2 + 1);
    let channels = input.len() / (size.x * size.y) as usize;
    let cases: Vec<(f32, Vec<Vec<usize>>)> =
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30]
            .into_iter()
            .flat_map(|value| breaks(channels).into_iter().map(move |b| (value, b)))
            .collect();
    for gpu in adapters().unwrap_or_else(|e| panic!("{e}")) {
        for images in [Images::Buffers, Images::Textures16, Images::Textures32] {
            let build = Build::Plain;
            let lab = Lab { gpu, images, build };
            let sound = run(&lab, input);
            let per_pixel = sound.len() / (SIZE.x * SIZE.y) as usize;
            for (value, broken) in &cases {
                let mut image = input.to_vec();
                for (i, lanes) in broken.iter().enumerate() {
                    let first = (corner.y * size.x + corner.x) as usize + i;
                    lanes
                        .iter()
                        .for_each(|c| image[first * channels + c] = *value);
                }
                let found = run(&lab, &image);
                let last = corner.x + broken.len() as u32 - 1;
                let mut beyond = 0;
                for (i, p) in pixels(SIZE).enumerate() {
                    let texel = i * per_pixel..(i + 1) * per_pixel;
                    let (x, y) = (&found[texel.clone()], &sound[texel]);
                    let q = p / scale;
                    let nearest = UVec2::new(q.x.clamp(corner.x, last), corner.y);
                    let far = q.x.abs_diff(nearest.x).max(q.y.abs_diff(nearest.y));
                    let case = || {
                        let lanes = broken.len();
                        format!(
                            "{name}, {}, {images:?}, {value} in {lanes} at {p}",
                            gpu.label()
                        )
                    };
                    assert!(x.iter().all(|c| c.is_finite()), "{}: {x:?}", case());
                    if far > radius {
                        beyond += 1;
                        let same = x.iter().zip(y).all(|(a, b)| a.to_bits() == b.to_bits());
                        assert!(same, "{}: {far} pixels away, {x:?}, not {y:?}", case());
                    }
                }
                assert!(beyond > 100, "{name}: nothing lies beyond {radius} pixels");
            }
        }
    }
}

#[test]
fn broken_pixels_stay_where_they_are() {
    let image = colors(SIZE, 150);
    for (kind, radius) in [
        (FireflyKind::Cap, 1),
        (FireflyKind::Rank, 1),
        (FireflyKind::Clamp(2.0), 2),
    ] {
        let name = format!("firefly, {kind:?}");
        contained(&name, &image, SIZE, radius, |lab, input| {
            firefly(lab, input, kind)
        });
    }
    let values = scalars(SIZE, 151);
    contained("separable_blur", &values, SIZE, 4, blur);
    let low = weighted(LOW, 2.0, 152);
    contained("bilateral_upsample", &low, LOW, 1, upsample);
    contained("bilateral_variance", &image, SIZE, 5, bilateral);
    let low = colors(LOW, 153);
    contained("spatial_reconstruct", &low, LOW, 4, reconstruct);
}

#[test]
fn broken_pixels_and_histories_stay_where_they_are() {
    let image = colors(SIZE, 150);
    let histories = weighted(SIZE, 1.0, 154);
    contained("taa, frame", &image, SIZE, 1, |lab, input| {
        taa(lab, input, &histories)
    });
    contained("taa, history", &histories, SIZE, 0, |lab, known| {
        taa(lab, &image, known)
    });
    for mode in 0..4 {
        let clamp = |lab: &Lab<'_>, input: &[f32], known: &[f32]| {
            let mut out = variance_clamp(lab, input, known, mode);
            drop_lengths(&mut out);
            out
        };
        let name = format!("variance_clamp {mode}");
        contained(&format!("{name}, frame"), &image, SIZE, 2, |lab, input| {
            clamp(lab, input, &histories)
        });
        contained(
            &format!("{name}, history"),
            &histories,
            SIZE,
            0,
            |lab, known| clamp(lab, &image, known),
        );
    }
    let frames = Frames::new();
    let known = &frames.histories;
    contained("reproject, history", known, SIZE, 3, |lab, known| {
        let broken = Frames {
            histories: known.to_vec(),
            ..Frames::new()
        };
        broken.run(lab, false)
    });
    let values = scalars(SIZE, 101);
    contained("visibility_clamp", &values, SIZE, 0, |lab, known| {
        visibility_clamp(lab, &packed(lab, &visible(), false).0, known)
    });
    let rays = visible();
    contained("packed_visibility", &rays, SIZE, 8, |lab, rays| {
        packed(lab, rays, false).1
    });
}

#[test]
fn accumulation_keeps_broken_pixels_where_they_are() {
    let samples = colors(SIZE, 110);
    let [known, moments] = accumulated();
    let inputs = [samples.as_slice(), &known, &moments];
    for (i, name) in ["samples", "colours", "moments"].into_iter().enumerate() {
        let name = format!("accumulate, {name}");
        contained(&name, inputs[i], SIZE, 0, |lab, input| {
            let mut inputs = inputs;
            inputs[i] = input;
            let [colors, moments] = accumulate_colors(lab, inputs);
            let texels = colors.chunks(4).zip(moments.chunks(4));
            texels.flat_map(|(c, m)| [c, m].concat()).collect()
        });
    }
    let samples = scalars(SIZE, 113);
    contained("accumulate, scalars", &samples, SIZE, 0, |lab, input| {
        accumulate_scalars(lab, input, &moments)
    });
    contained("accumulate, means", &moments, SIZE, 0, |lab, known| {
        accumulate_scalars(lab, &samples, known)
    });
}

/// 3 pixels by the variance, 2 by the first pass, 4 by the second. What is
/// broken leaves nothing of itself: no value is larger than the sound ones.
#[test]
fn svgf_keeps_broken_pixels_where_they_are() {
    let two = SvgfSettings {
        passes: 2,
        feedback: 0,
        ..SVGF
    };
    let reach = 2 + 4;
    let lengths = histories();
    let held = |lab: &Lab<'_>, found: &[f32], values: usize, sound: &[f32]| {
        assert!(found.iter().all(|c| c.is_finite()), "{:?}", lab.images);
        let largest = |image: &[f32]| {
            let texels = image.chunks(values + 1);
            let values = texels.flat_map(|t| t[..values].iter().map(|c| c.abs()));
            values.fold(0.0, f32::max)
        };
        // Sixteen bits round up by at most 2^-11.
        let (found, sound) = (largest(found), 1.001 * largest(sound));
        assert!(found <= sound, "{:?}: {found}, not {sound}", lab.images);
    };
    let image = colors(SIZE, 150);
    let run = |lab: &Lab<'_>, input: &[f32], known: &[f32]| {
        let [results, feedback] = svgf_color(lab, two, input, known);
        held(lab, &results, 3, &image);
        held(lab, &feedback, 3, &image);
        results
    };
    contained("svgf", &image, SIZE, 3 + reach, |lab, input| {
        run(lab, input, &lengths)
    });
    contained("svgf, frames", &lengths, SIZE, reach, |lab, known| {
        run(lab, &image, known)
    });
    let image = noisy_scalars();
    contained("svgf, scalars", &image, SIZE, 3 + reach, |lab, input| {
        let results = svgf_scalar(lab, two, input, &lengths);
        held(lab, &results, 1, &image);
        results
    });
}

/// Lengths go through as they are.
fn drop_lengths(image: &mut [f32]) {
    for texel in image.chunks_mut(4) {
        texel[3] = 0.0;
    }
}

// -- Use

#[test]
fn what_does_not_fit_is_named() {
    let gpu = &adapters().unwrap_or_else(|e| panic!("{e}"))[0];
    let buffers = Lab {
        gpu,
        images: Images::Buffers,
        build: Build::Plain,
    };
    let textures = Lab {
        images: Images::Textures16,
        ..buffers
    };
    let device = gpu.device();
    let taa = TaaGpu::new(device, SIZE, Images::Buffers).expect("registered");
    let (buffer, texture) = (
        buffers.floats(SIZE, &colors(SIZE, 0)),
        textures.floats(SIZE, &colors(SIZE, 0)),
    );
    let images = TaaImages {
        colors: (&buffer).into(),
        histories: (&texture).into(),
        results: (&buffer).into(),
    };
    let settings = TaaSettings {
        alpha: 0.1,
        exposure: 1.0,
    };
    let error = taa.bind(device, settings, images).expect_err("a texture");
    assert_eq!(
        error.to_string(),
        "`histories` must be a buffer: the pass was created for Buffers"
    );
    let svgf = SvgfColorImageGpu::new(device, SIZE, Images::Buffers).expect("registered");
    let surfaces = surfaces(SIZE, 1.0, camera(0.0));
    let surfaces = buffers.surfaces(SIZE, &surfaces, camera(0.0), place_and_shape);
    let images = SvgfImages {
        input: (&buffer).into(),
        histories: (&buffer).into(),
        surfaces: surfaces.get(),
        feedback: Some((&buffer).into()),
        results: (&buffer).into(),
    };
    let settings = SvgfSettings {
        feedback: 4,
        ..SvgfSettings::PAPER
    };
    let error = svgf.bind(device, settings, images).expect_err("the last");
    assert!(error.to_string().contains("settings.feedback"), "{error}");
}

#[test]
fn a_pass_takes_another_size() {
    let gpu = &adapters().unwrap_or_else(|e| panic!("{e}"))[0];
    let lab = Lab {
        gpu,
        images: Images::Textures32,
        build: Build::Plain,
    };
    let input = scalars(SIZE, 20);
    let expected = blur(&lab, &input);
    let mut pass =
        SeparableBlurGpu::new(gpu.device(), UVec2::new(7, 5), lab.images).expect("registered");
    pass.resize(gpu.device(), SIZE);
    assert_eq!(pass.size(), SIZE);
    let all = surfaces(SIZE, 1.0, camera(0.0));
    let all = lab.surfaces(SIZE, &all, camera(0.0), place_and_shape);
    let (input, results) = (lab.floats(SIZE, &input), pass.target(gpu.device()));
    let images = SeparableBlurImages {
        values: (&input).into(),
        surfaces: all.get(),
        results: (&results).into(),
    };
    lab.run(&pass.bind(gpu.device(), 4, images).expect("fits"));
    assert_eq!(lab.read(&results, 1), expected);
}
