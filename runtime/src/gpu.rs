//! The graphics card: a device of the caller's or one of our own, and what every pass of a frame is made of.
//!
//! A device is used within WebGPU's default limits, and with no optional feature but `timestamp-query`, and that one only to
//! measure. Shaders are WGSL, each beside the Rust file of the same name; `shader.rs` puts them together from parts and
//! compares their structs with Rust's. Pipelines are made once per device; buffers and textures once per asset or per
//! picture size; a frame is one command submission and allocates nothing on the card.
//!
//! The CPU's code is the truth: every pass has a twin there, and a test that compares the two.

pub(crate) mod around;
pub(crate) mod binding;
pub mod clock;
pub(crate) mod cloud;
pub(crate) mod compile;
pub(crate) mod compose;
pub(crate) mod direct;
pub(crate) mod frame;
pub(crate) mod haar;
#[cfg(test)]
pub(crate) mod half;
pub(crate) mod light;
pub(crate) mod march;
pub(crate) mod medium;
pub(crate) mod memory;
pub(crate) mod rain;
pub(crate) mod readback;
pub(crate) mod relief;
pub(crate) mod rows;
pub(crate) mod shader;
pub(crate) mod shown;
pub(crate) mod spots;
pub(crate) mod targets;
pub(crate) mod tone;
pub(crate) mod town;
pub(crate) mod volume;

pub use clock::{GpuReport, PassTime};

use crate::error::RuntimeError;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex};

/// Buffers that one storage binding of WebGPU's default limits may hold, bytes.
pub(crate) const LARGEST_BINDING: u64 = 128 << 20;

/// A graphics card, ready for work. Clones share it.
///
/// ```no_run
/// use squall_runtime::gpu::Gpu;
///
/// // A device of its own, or the application's: `Gpu::with_device(device, queue)`.
/// let gpu = Gpu::open()?;
/// println!("{}", gpu.name());
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    name: Arc<str>,
    /// Bytes of buffers and textures that are held now.
    pub(crate) held: Arc<AtomicU64>,
    /// Every pipeline, made once: another renderer on the same device has the same ones, and drivers are spared pipelines that go while
    /// the device stays, which lavapipe's queue doesn't survive.
    pub(crate) pipelines: Arc<Mutex<binding::Pipelines>>,
    compiler: Arc<compile::Compiler>,
    /// Why the device answers no more, once it doesn't; of a device of our own.
    lost: Option<Arc<Mutex<Option<String>>>>,
}

impl Gpu {
    /// Opens a device of its own on the fastest adapter.
    ///
    /// Errors: no graphics adapter, or none that gives WebGPU's default limits.
    #[cfg(not(target_family = "wasm"))]
    pub fn open() -> Result<Self, RuntimeError> {
        wait(Self::open_async())
    }

    /// [`Gpu::open`] for those who must not wait, as a web page.
    ///
    /// Errors: as [`Gpu::open`].
    pub async fn open_async() -> Result<Self, RuntimeError> {
        if wgpu::Instance::enabled_backend_features().is_empty() {
            let wanted = "a device of the page's own (Gpu::with_device), or a build with feature `webgpu`";
            return Err(RuntimeError::Device { wanted: wanted.to_owned(), found: "neither".to_owned() });
        }
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let wanted = "a graphics adapter (Vulkan, Metal, Direct3D 12 or WebGPU); a software one such as Mesa's lavapipe will do";
        let refused = |error: &dyn std::fmt::Display| RuntimeError::Device {
            wanted: wanted.to_owned(),
            found: error.to_string(),
        };
        let adapter = instance.request_adapter(&options).await.map_err(|error| refused(&error))?;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("squall"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: wgpu::Limits::default(),
            ..Default::default()
        };
        let (device, queue) = adapter.request_device(&descriptor).await.map_err(|error| refused(&error))?;
        let info = adapter.get_info();
        let mut own =
            Self::new(device, queue, format!("{} ({}, {})", info.name, info.backend, info.driver_info));
        own.watch();
        Ok(own)
    }

    /// Works on a device and a queue of the caller's, and never opens another.
    ///
    /// The device needs WebGPU's default limits and no feature; with `TIMESTAMP_QUERY` passes can be measured.
    ///
    /// Errors: limits below WebGPU's defaults, by name.
    pub fn with_device(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, RuntimeError> {
        let mut below = None;
        wgpu::Limits::default().check_limits_with_fail_fn(&device.limits(), false, |name, wanted, found| {
            below.get_or_insert((name, wanted, found));
        });
        if let Some((name, wanted, found)) = below {
            let wanted = format!("a device with WebGPU's default limits: {name} {wanted}");
            return Err(RuntimeError::Device { wanted, found: found.to_string() });
        }
        let info = device.adapter_info();
        let name = format!("{} ({}, {})", info.name, info.backend, info.driver_info);
        Ok(Self::new(device, queue, name))
    }

    fn new(device: wgpu::Device, queue: wgpu::Queue, name: String) -> Self {
        Self {
            compiler: Arc::new(compile::Compiler::new(&device)),
            device,
            queue,
            name: name.into(),
            held: Arc::new(AtomicU64::new(0)),
            pipelines: Arc::default(),
            lost: None,
        }
    }

    /// Has a device of our own say when it is lost.
    fn watch(&mut self) {
        let lost = Arc::new(Mutex::new(None));
        let told = lost.clone();
        self.device.set_device_lost_callback(move |reason, words| {
            if let Ok(mut told) = told.lock() {
                *told = Some(format!("{reason:?}: {words}"));
            }
        });
        self.lost = Some(lost);
    }

    /// Why the device answers no more; nothing while it does, or where it is the caller's, who is told by wgpu.
    #[must_use]
    pub fn lost(&self) -> Option<String> {
        self.lost.as_ref()?.lock().ok()?.clone()
    }

    /// What the adapter calls itself, with its interface and driver.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Its queue.
    #[must_use]
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Bytes of buffers and textures that are held on it now, by everything that shares this.
    #[must_use]
    pub fn bytes_held(&self) -> u64 {
        self.held.load(std::sync::atomic::Ordering::Relaxed)
    }

    /// Whether passes can be measured.
    pub(crate) fn has_clock(&self) -> bool {
        self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY)
    }

    /// Waits until everything that was submitted is done. A web page never waits: there this only lets callbacks run.
    ///
    /// Errors: the device is lost.
    pub fn wait(&self) -> Result<(), RuntimeError> {
        self.device.poll(wgpu::PollType::wait_indefinitely()).map(drop).map_err(|error| {
            RuntimeError::Device { wanted: "an answer of the device".to_owned(), found: error.to_string() }
        })
    }
}

/// The WGSL of every pass by its name, for whoever compiles it elsewhere.
pub fn shaders() -> impl Iterator<Item = (&'static str, String)> {
    shader::ALL.iter().map(|shader| (shader.name, shader.source()))
}

/// Runs a future that makes progress whenever it is asked, as wgpu's are outside of a browser.
#[cfg(not(target_family = "wasm"))]
pub(crate) fn wait<T>(future: impl std::future::Future<Output = T>) -> T {
    let mut future = std::pin::pin!(future);
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    loop {
        if let std::task::Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
        std::thread::yield_now();
    }
}

/// The adapter for tests, one device for all of them: `None`, said aloud, where there is none. A software driver's devices do not all
/// outlive their pipelines, and each test would compile its own.
#[cfg(test)]
pub(crate) fn test_gpu() -> Option<Gpu> {
    static SHARED: std::sync::OnceLock<Option<Gpu>> = std::sync::OnceLock::new();
    let gpu = SHARED.get_or_init(own_test_gpu).clone();
    // Bytes are counted a test.
    gpu.map(|gpu| Gpu { held: Arc::default(), ..gpu })
}

/// A device of a test's own, which it may destroy.
#[cfg(test)]
pub(crate) fn own_test_gpu() -> Option<Gpu> {
    match Gpu::open() {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            let required = std::env::var_os("SQUALL_REQUIRE_GPU").is_some();
            assert!(!required, "SQUALL_REQUIRE_GPU is set, and {error}");
            println!("skipped: no graphics adapter");
            None
        }
    }
}

/// Its square, in double precision.
#[cfg(test)]
pub(crate) fn square(value: f32) -> f64 {
    f64::from(value) * f64::from(value)
}
