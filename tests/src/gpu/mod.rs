//! Running kernels on every GPU adapter that is present.
//!
//! [`adapters`] finds them, [`Program`] turns a kernel's description into a
//! compute pipeline (the shader is generated from the types) and runs it over
//! arrays, in one of two builds: [`Build::Plain`], the WGSL as users run it,
//! and [`Build::Precise`], the same program with `NoContraction` on every
//! float operation.

mod program;
mod spirv;

use std::sync::OnceLock;
use std::sync::mpsc;

pub(crate) use program::shader_module;
pub use program::{Build, Program, ProgramError, entry_module, pass_module, shader_source};

/// Names of the environment variables that choose adapters and drivers.
pub const ADAPTER_VARIABLE: &str = "RAYTWIN_ADAPTER";

/// One opened adapter.
pub struct Gpu {
    /// Name, driver and version, as the driver reports them.
    pub info: wgpu::AdapterInfo,
    device: wgpu::Device,
    queue: wgpu::Queue,
    precise: bool,
    timestamps: bool,
}

/// Why there is no GPU to test on.
#[derive(Clone, Debug, thiserror::Error)]
pub enum GpuError {
    /// The system has no Vulkan driver at all.
    #[error(
        "no GPU adapter was found; install a driver (Mesa's software one will do: \
         `cargo xtask setup`, or `apt-get install mesa-vulkan-drivers`)"
    )]
    NoAdapter,
    /// `RAYTWIN_ADAPTER` names none of those present.
    #[error("RAYTWIN_ADAPTER is `{wanted}`, but the adapters present are: {present}")]
    NoSuchAdapter {
        /// What was asked for.
        wanted: String,
        /// What there is.
        present: String,
    },
    /// An adapter is present and does not open.
    #[error("adapter `{adapter}` does not open: {reason}")]
    Device {
        /// Its name.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
}

/// Every adapter, opened once: all Vulkan adapters (Metal and DX12 where those
/// are the system's), or the one whose name contains `RAYTWIN_ADAPTER`.
///
/// # Errors
/// If none is present, none has the wanted name, or one does not open.
pub fn adapters() -> Result<&'static [Gpu], GpuError> {
    static GPUS: OnceLock<Result<Vec<Gpu>, GpuError>> = OnceLock::new();
    GPUS.get_or_init(open_adapters)
        .as_ref()
        .map(Vec::as_slice)
        .map_err(Clone::clone)
}

fn open_adapters() -> Result<Vec<Gpu>, GpuError> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    descriptor.flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(descriptor);
    let mut found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    // Hardware first; the order of the rest must not depend on the loader.
    found.sort_by_key(|a| {
        let info = a.get_info();
        let name = info.name.to_lowercase();
        (info.device_type == wgpu::DeviceType::Cpu, name)
    });
    found.dedup_by_key(|a| {
        let info = a.get_info();
        (info.name, info.driver_info, info.device_pci_bus_id)
    });
    if found.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    if let Ok(wanted) = std::env::var(ADAPTER_VARIABLE) {
        let names: Vec<_> = found.iter().map(|a| a.get_info().name).collect();
        let lower = wanted.to_lowercase();
        found.retain(|a| a.get_info().name.to_lowercase().contains(&lower));
        if found.is_empty() {
            return Err(GpuError::NoSuchAdapter {
                wanted,
                present: names.join(", "),
            });
        }
    }
    found.iter().map(Gpu::open).collect()
}

impl Gpu {
    fn open(adapter: &wgpu::Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let failed = |reason: &dyn std::fmt::Display| GpuError::Device {
            adapter: info.name.clone(),
            reason: reason.to_string(),
        };
        let has = adapter.features();
        let timestamps = has.contains(wgpu::Features::TIMESTAMP_QUERY);
        // The precise build is SPIR-V, which only Vulkan takes.
        let precise = has.contains(wgpu::Features::PASSTHROUGH_SHADERS)
            && info.backend == wgpu::Backend::Vulkan;
        let mut features = wgpu::Features::empty();
        features.set(wgpu::Features::TIMESTAMP_QUERY, timestamps);
        let subgroups = has.contains(wgpu::Features::SUBGROUP);
        features.set(wgpu::Features::SUBGROUP, subgroups);
        features.set(wgpu::Features::PASSTHROUGH_SHADERS, precise);
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("raytwin"),
            required_features: features,
            required_limits: adapter.limits(),
            // SAFETY: passthrough takes SPIR-V that naga generated and
            // validated; we only add NoContraction decorations to it.
            experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|e| failed(&e))?;
        Ok(Self {
            info,
            device,
            queue,
            precise,
            timestamps,
        })
    }

    /// Adapter name and driver, as tables show it.
    #[must_use]
    pub fn label(&self) -> String {
        match self.info.driver_info.as_str() {
            "" => self.info.name.clone(),
            driver => format!("{} ({driver})", self.info.name),
        }
    }

    /// Whether this is a processor pretending: there the precise build must
    /// give the CPU's bits. A hardware GPU divides to 2.5 ULP.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Whether [`Build::Precise`] can run here.
    #[must_use]
    pub fn has_precise(&self) -> bool {
        self.precise
    }

    /// Whether GPU timestamps can be taken.
    #[must_use]
    pub fn has_timestamps(&self) -> bool {
        self.timestamps
    }

    /// The device, for passes that the harness does not know.
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Its queue.
    #[must_use]
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// A storage buffer with these words.
    #[must_use]
    pub fn buffer(&self, words: &[u32]) -> wgpu::Buffer {
        use wgpu::util::DeviceExt;
        let one = [0u32];
        // Bindings may not be empty.
        let words = if words.is_empty() { &one[..] } else { words };
        self.device
            .create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: None,
                contents: bytemuck::cast_slice(words),
                usage: wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC
                    | wgpu::BufferUsages::COPY_DST,
            })
    }

    /// Copies a buffer back, waiting for everything submitted before.
    ///
    /// # Panics
    /// If the device is lost: there is nothing left to test on.
    #[must_use]
    pub fn read(&self, buffer: &wgpu::Buffer, words: usize) -> Vec<u32> {
        let bytes = (words * 4) as u64;
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.max(4),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, bytes);
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            let _ = sender.send(result);
        });
        self.wait();
        receiver
            .recv()
            .expect("the map callback runs before the wait ends")
            .expect("mapping a staging buffer");
        let view = staging.get_mapped_range(..).expect("the buffer is mapped");
        let out = bytemuck::cast_slice(&view)[..words].to_vec();
        drop(view);
        out
    }

    /// Waits until the device is idle.
    ///
    /// # Panics
    /// If the device is lost.
    pub fn wait(&self) {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .expect("the device is lost");
    }
}
