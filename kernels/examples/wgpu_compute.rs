//! One kernel in a bare wgpu program: a shader of your own that calls
//! `cone_sample`, and the CPU twin's answer beside it.
//!
//! `cargo run --example wgpu_compute --features gpu`

use std::error::Error;
use std::sync::mpsc;

use glam::{Vec2, Vec3};
use raytwin::sample::cone::{cone_one_minus_cos, cone_sample};

const COUNT: u32 = 256;
const HALF_ANGLE: f32 = 0.00465;

/// Your shader: a binding, an entry point, and calls of what is linked before it.
const MAIN: &str = "
@group(0) @binding(0) var<storage, read_write> directions: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let u = halton_pair(id.x);
    directions[id.x] = vec4f(cone_sample(u, cone_one_minus_cos(0.00465)), 0.0);
}

fn halton_pair(i: u32) -> vec2f {
    return vec2f(halton_radical_inverse(i, 2u), halton_radical_inverse(i, 3u));
}
";

/// The same on the CPU.
fn twin(i: u32) -> Vec3 {
    use raytwin::random::halton::halton_radical_inverse;
    let u = Vec2::new(halton_radical_inverse(i, 2), halton_radical_inverse(i, 3));
    cone_sample(u, cone_one_minus_cos(HALF_ANGLE))
}

async fn run() -> Result<(), Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = instance.request_adapter(&Default::default()).await?;
    println!("adapter: {}", adapter.get_info().name);
    let (device, queue) = adapter.request_device(&Default::default()).await?;

    // The kit's part: the text of both modules with all that they need.
    let library = raytwin::wgsl::link(&["sample/cone", "random/halton"])?;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("directions"),
        source: wgpu::ShaderSource::Wgsl((library + MAIN).into()),
    });

    // The rest is any compute pass.
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("directions"),
        layout: None,
        module: &module,
        entry_point: Some("main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let size = u64::from(COUNT) * 16;
    let buffer = |usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    let directions = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let readback = buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: directions.as_entire_binding(),
        }],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(COUNT / 64, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&directions, 0, &readback, 0, size);
    queue.submit([encoder.finish()]);

    let (sender, receiver) = mpsc::channel();
    readback.map_async(wgpu::MapMode::Read, .., move |result| {
        let _ = sender.send(result);
    });
    device.poll(wgpu::PollType::wait_indefinitely())?;
    receiver.recv()??;
    let bytes = readback.get_mapped_range(..)?;
    let lane = |i: usize| f32::from_le_bytes([0, 1, 2, 3].map(|b| bytes[i * 4 + b]));

    let mut farthest = 0.0_f32;
    for i in 0..COUNT {
        let at = i as usize * 4;
        let gpu = Vec3::new(lane(at), lane(at + 1), lane(at + 2));
        farthest = farthest.max((gpu - twin(i)).abs().max_element());
        if i < 4 {
            println!("{i}: GPU {gpu}, CPU {}", twin(i));
        }
    }
    println!("farthest apart: {farthest:e} of {COUNT} directions");
    // The contract of `cone_sample`: docs/sample/cone.md.
    if farthest > 2e-6 {
        return Err("the twins differ by more than the contract allows".into());
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    pollster::block_on(run())
}
