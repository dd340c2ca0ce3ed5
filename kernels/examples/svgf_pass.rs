//! SVGF over a program's own textures, with wgpu alone: a noisy image and its
//! G-buffer go in, a filtered one comes out.
//!
//! `cargo run --release --example svgf_pass --features gpu [FILE.png]`

use std::error::Error;
use std::sync::mpsc;

use glam::{UVec2, Vec2, Vec3};
use raytwin::filter::svgf::SvgfSettings;
use raytwin::math::octahedral::octahedral_encode;
use raytwin::pass::image::{GBuffer, Image, SvgfColorImageGpu, SvgfImages};
use raytwin::random::pcg::{pcg_hash, pcg_unit};
use raytwin::ray::camera::{Camera, camera_ray};
use raytwin::wgsl::Images;

const SIZE: UVec2 = UVec2::new(512, 288);

/// What your renderer's first pass leaves behind.
struct Frame {
    depths: Vec<f32>,
    normals: Vec<u32>,
    /// Light with its variance.
    noisy: Vec<f32>,
    clean: Vec<f32>,
}

/// A ball over a floor under a sky that is lighter above, a ray a pixel.
fn render(camera: Camera) -> Frame {
    let mut frame = Frame {
        depths: Vec::new(),
        normals: Vec::new(),
        noisy: Vec::new(),
        clean: Vec::new(),
    };
    let centre = Vec3::new(0.0, 0.0, -4.0);
    for y in 0..SIZE.y {
        for x in 0..SIZE.x {
            let pixel = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
            let ray = camera_ray(pixel, camera);
            let away = ray.origin - centre;
            let b = away.dot(ray.direction);
            let root = b * b - (away.length_squared() - 1.0);
            let (t, normal) = if root > 0.0 && -b - root.sqrt() > 0.0 {
                let t = -b - root.sqrt();
                (t, ray.origin + ray.direction * t - centre)
            } else if ray.direction.y < 0.0 {
                ((-1.0 - ray.origin.y) / ray.direction.y, Vec3::Y)
            } else {
                (f32::INFINITY, Vec3::Y)
            };
            let sky = t >= 40.0;
            let depth = if sky {
                0.0
            } else {
                t * ray.direction.dot(camera.forward)
            };
            let packed = octahedral_encode(normal);
            let snorm = |v: f32| (v * 32767.0).round() as i32 as u32 & 0xffff;
            frame.depths.push(depth);
            frame.normals.push(snorm(packed.x) | snorm(packed.y) << 16);
            // A ray is lit or not.
            let chance = if sky {
                1.0
            } else {
                0.25 + 0.5 * (0.5 + 0.5 * normal.y)
            };
            let lit = pcg_unit(pcg_hash(x ^ pcg_hash(y))) < chance;
            let light = if lit { 1.0 } else { 0.0 };
            let variance = chance * (1.0 - chance);
            frame
                .noisy
                .extend([0.9 * light, 0.95 * light, light, variance]);
            frame.clean.extend([0.9 * chance, 0.95 * chance, chance]);
        }
    }
    frame
}

fn texture(
    (device, queue): (&wgpu::Device, &wgpu::Queue),
    format: wgpu::TextureFormat,
    bytes: &[u8],
) -> wgpu::TextureView {
    let size = wgpu::Extent3d {
        width: SIZE.x,
        height: SIZE.y,
        depth_or_array_layers: 1,
    };
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(bytes.len() as u32 / SIZE.y),
        rows_per_image: None,
    };
    queue.write_texture(texture.as_image_copy(), bytes, layout, size);
    texture.create_view(&Default::default())
}

fn bytes(words: impl Iterator<Item = u32>) -> Vec<u8> {
    words.flat_map(u32::to_le_bytes).collect()
}

/// The colours of a texture of four 32-bit floats.
fn read(
    (device, queue): (&wgpu::Device, &wgpu::Queue),
    texture: &wgpu::Texture,
) -> Result<Vec<f32>, Box<dyn Error>> {
    // Rows of 512 pixels are multiples of 256 bytes, as copies want them.
    let row = SIZE.x * 16;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * SIZE.y),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let to = wgpu::TexelCopyBufferInfo {
        buffer: &buffer,
        layout: wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row),
            rows_per_image: None,
        },
    };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    queue.submit([encoder.finish()]);
    let (sender, receiver) = mpsc::channel();
    buffer.map_async(wgpu::MapMode::Read, .., move |result| {
        let _ = sender.send(result);
    });
    device.poll(wgpu::PollType::wait_indefinitely())?;
    receiver.recv()??;
    let view = buffer.get_mapped_range(..)?;
    let numbers = view.chunks_exact(4);
    Ok(numbers
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect())
}

/// Root mean squared error of three channels of four.
fn error(image: &[f32], clean: &[f32]) -> f32 {
    let pixels = image.chunks_exact(4).zip(clean.chunks_exact(3));
    let squares = pixels.flat_map(|(a, b)| (0..3).map(move |c| (a[c] - b[c]) * (a[c] - b[c])));
    (squares.sum::<f32>() / clean.len() as f32).sqrt()
}

async fn run() -> Result<(), Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = instance.request_adapter(&Default::default()).await?;
    println!("adapter: {}", adapter.get_info().name);
    let (device, queue) = adapter.request_device(&Default::default()).await?;
    let at = (&device, &queue);

    // Your frame.
    let camera = Camera {
        origin: Vec3::new(0.0, 0.5, 0.0),
        right: Vec3::new(0.89, 0.0, 0.0),
        up: Vec3::new(0.0, 0.5, 0.0),
        forward: Vec3::NEG_Z,
        inverse_resolution: Vec2::ONE / SIZE.as_vec2(),
    };
    let frame = render(camera);
    let floats = |all: &[f32]| bytes(all.iter().map(|x| x.to_bits()));
    let depths = texture(at, wgpu::TextureFormat::R32Float, &floats(&frame.depths));
    let normals = bytes(frame.normals.iter().copied());
    let normals = texture(at, wgpu::TextureFormat::R32Uint, &normals);
    let input = texture(at, wgpu::TextureFormat::Rgba32Float, &floats(&frame.noisy));
    // Accumulated long enough for its variance to be believed.
    let lengths = vec![8.0; frame.depths.len()];
    let histories = texture(at, wgpu::TextureFormat::R32Float, &floats(&lengths));

    // Once: the pass, its result, and what they are bound to.
    let svgf = SvgfColorImageGpu::new(&device, SIZE, Images::Textures32)?;
    let results = svgf.target(&device);
    let surfaces = GBuffer {
        depths: &depths,
        normals: &normals,
        meshes: None,
        camera,
        reach: 0.01,
    };
    let images = SvgfImages {
        input: (&input).into(),
        histories: (&histories).into(),
        surfaces: surfaces.into(),
        feedback: None,
        results: (&results).into(),
    };
    let bound = svgf.bind(&device, SvgfSettings::PAPER, images)?;

    // Each frame.
    let mut encoder = device.create_command_encoder(&Default::default());
    bound.encode(&mut encoder);
    queue.submit([encoder.finish()]);

    let Image::Texture { texture, .. } = &results else {
        return Err("the pass was created for textures".into());
    };
    let filtered = read(at, texture)?;
    let (before, after) = (
        error(&frame.noisy, &frame.clean),
        error(&filtered, &frame.clean),
    );
    println!("error: {before:.3} noisy, {after:.4} filtered");
    if let Some(path) = std::env::args().nth(1) {
        let both = frame.noisy.chunks_exact(SIZE.x as usize * 4);
        let both = both.zip(filtered.chunks_exact(SIZE.x as usize * 4));
        let rows = both.flat_map(|(a, b)| a.iter().chain(b));
        let channels: Vec<u8> = rows
            .enumerate()
            .filter(|(i, _)| i % 4 < 3)
            .map(|(_, x)| (x.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8)
            .collect();
        image::save_buffer(&path, &channels, 2 * SIZE.x, SIZE.y, image::ColorType::Rgb8)?;
        println!("{path}: noisy and filtered, side by side");
    }
    if after > 0.2 * before {
        return Err("the filter left more noise than it should".into());
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    pollster::block_on(run())
}
