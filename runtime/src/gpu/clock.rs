//! Passes put on record one after the other, each with the time that it took where the device can tell.

use super::Gpu;
use super::binding::Kernel;
use super::memory::Held;
use crate::error::RuntimeError;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

/// Passes of one frame that are timed, at most.
const MOST_PASSES: u32 = 64;

/// How long a pass took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassTime {
    /// What it is called.
    pub name: &'static str,
    /// Milliseconds between its start and its end on the device's own clock.
    pub ms: f64,
}

/// What a frame took on a graphics card.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct GpuReport {
    /// The adapter.
    pub adapter: String,
    /// The passes in their order; empty where the device has no clock, or measuring was not asked for.
    pub passes: Vec<PassTime>,
    /// Bytes of buffers and textures that are held.
    pub bytes_held: u64,
    /// Whether the device was lost once, and another one took over.
    pub recovered: bool,
}

impl GpuReport {
    /// All passes together, ms.
    #[must_use]
    pub fn ms(&self) -> f64 {
        self.passes.iter().map(|pass| pass.ms).sum()
    }
}

/// A device's clock.
pub(crate) struct Clock {
    gpu: Gpu,
    queries: Option<Queries>,
    names: Vec<&'static str>,
}

struct Queries {
    set: wgpu::QuerySet,
    resolved: Held<wgpu::Buffer>,
    read: Held<wgpu::Buffer>,
}

impl Clock {
    /// A clock, where the device has one.
    pub fn new(gpu: &Gpu) -> Self {
        let queries = gpu.has_clock().then(|| {
            let bytes = u64::from(2 * MOST_PASSES) * 8;
            use wgpu::BufferUsages as Use;
            Queries {
                set: gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                    label: Some("passes"),
                    ty: wgpu::QueryType::Timestamp,
                    count: 2 * MOST_PASSES,
                }),
                resolved: gpu.buffer("times", bytes, Use::QUERY_RESOLVE | Use::COPY_SRC),
                read: gpu.buffer("times to read", bytes, Use::MAP_READ),
            }
        });
        Self { gpu: gpu.clone(), queries, names: Vec::new() }
    }

    /// Begins a frame; its passes are timed if `measured`.
    pub(crate) fn record(&mut self, measured: bool) -> Recorder<'_> {
        self.names.clear();
        let encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Recorder { encoder, clock: self, measured }
    }

    /// Waits for the frame last submitted and reads what its passes took; none where nothing was measured.
    ///
    /// Errors: the device is lost.
    pub fn read(&mut self) -> Result<Vec<PassTime>, RuntimeError> {
        let Some(queries) = self.queries.as_ref().filter(|_| !self.names.is_empty()) else {
            return Ok(Vec::new());
        };
        let bytes = self.names.len() as u64 * 16;
        let ticks: Vec<u64> = map(&self.gpu, &queries.read, bytes, |bytes| {
            bytes.as_chunks::<8>().0.iter().map(|word| u64::from_le_bytes(*word)).collect()
        })?;
        let ms = f64::from(self.gpu.queue.get_timestamp_period()) * 1e-6;
        let pass = |(&name, ends): (&&'static str, &[u64; 2])| PassTime {
            name,
            ms: ends[1].saturating_sub(ends[0]) as f64 * ms,
        };
        Ok(self.names.iter().zip(ticks.as_chunks::<2>().0).map(pass).collect())
    }
}

/// Waits for `buffer` and shows its first `bytes` bytes to `look`.
pub(crate) fn map<T>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    bytes: u64,
    look: impl FnOnce(&[u8]) -> T,
) -> Result<T, RuntimeError> {
    const WAITING: u8 = 0;
    const READY: u8 = 1;
    const FAILED: u8 = 2;
    let state = Arc::new(AtomicU8::new(WAITING));
    let told = state.clone();
    let slice = buffer.slice(..bytes);
    slice.map_async(wgpu::MapMode::Read, move |result| {
        told.store(if result.is_ok() { READY } else { FAILED }, Ordering::Release);
    });
    gpu.wait()?;
    let lost = |found: String| RuntimeError::Device { wanted: "a buffer that can be read".to_owned(), found };
    if state.load(Ordering::Acquire) != READY {
        return Err(lost("a device that does not answer".to_owned()));
    }
    let view = slice.get_mapped_range().map_err(|error| lost(error.to_string()))?;
    let seen = look(&view);
    drop(view);
    buffer.unmap();
    Ok(seen)
}

/// One frame's commands.
pub(crate) struct Recorder<'a> {
    /// The commands so far.
    pub encoder: wgpu::CommandEncoder,
    clock: &'a mut Clock,
    measured: bool,
}

/// One dispatch of a compute pass.
pub struct Dispatch<'a> {
    /// What runs.
    pub kernel: &'a Kernel,
    /// Bind groups by number.
    pub groups: &'a [&'a wgpu::BindGroup],
    /// Workgroups along each axis; none of 0 or above 65 535.
    pub size: [u32; 3],
}

/// A compute pass on record.
pub struct Pass<'a>(wgpu::ComputePass<'a>);

impl Pass<'_> {
    /// Puts one dispatch on record: `size` workgroups of `kernel` with these groups.
    pub fn run(&mut self, kernel: &Kernel, groups: &[Option<&wgpu::BindGroup>], size: [u32; 3]) {
        self.0.set_pipeline(kernel.pipeline());
        for (number, group) in groups.iter().enumerate().filter(|(_, group)| group.is_some()) {
            self.0.set_bind_group(number as u32, *group, &[]);
        }
        let [x, y, z] = size;
        self.0.dispatch_workgroups(x, y, z);
    }
}

impl Pass<'_> {
    /// The same with as many workgroups as `counts` says where it begins.
    pub fn run_indirect(
        &mut self,
        kernel: &Kernel,
        groups: &[Option<&wgpu::BindGroup>],
        counts: &wgpu::Buffer,
    ) {
        self.0.set_pipeline(kernel.pipeline());
        for (number, group) in groups.iter().enumerate().filter(|(_, group)| group.is_some()) {
            self.0.set_bind_group(number as u32, *group, &[]);
        }
        self.0.dispatch_workgroups_indirect(counts, 0);
    }
}

impl Recorder<'_> {
    /// The queries of the next pass, which is called `name`.
    fn times(&mut self, name: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let clock = &mut *self.clock;
        let queries = clock.queries.as_ref().filter(|_| self.measured)?;
        let at = clock.names.len() as u32;
        if at >= MOST_PASSES {
            return None;
        }
        clock.names.push(name);
        Some((&queries.set, 2 * at))
    }

    /// A compute pass of some dispatches, timed together; each sees what those before it wrote.
    pub fn compute(&mut self, name: &'static str, dispatches: &[Dispatch<'_>]) {
        self.pass(name, |pass| {
            for Dispatch { kernel, groups, size } in dispatches {
                let groups: Vec<_> = groups.iter().map(|group| Some(*group)).collect();
                pass.run(kernel, &groups, *size);
            }
        });
    }

    /// A compute pass whose dispatches `work` names, timed together.
    pub fn pass(&mut self, name: &'static str, work: impl FnOnce(&mut Pass<'_>)) {
        let times = self.times(name).map(|(set, at)| (set.clone(), at));
        let timestamp_writes = times.as_ref().map(|(set, at)| wgpu::ComputePassTimestampWrites {
            query_set: set,
            beginning_of_pass_write_index: Some(*at),
            end_of_pass_write_index: Some(*at + 1),
        });
        let descriptor = wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes };
        let pass = self.encoder.begin_compute_pass(&descriptor);
        work(&mut Pass(pass));
    }

    /// A render pass onto `targets`, timed.
    pub fn draw(
        &mut self,
        name: &'static str,
        targets: &[Option<wgpu::RenderPassColorAttachment<'_>>],
        draw: impl FnOnce(&mut wgpu::RenderPass<'_>),
    ) {
        let times = self.times(name).map(|(set, at)| (set.clone(), at));
        let timestamp_writes = times.as_ref().map(|(set, at)| wgpu::RenderPassTimestampWrites {
            query_set: set,
            beginning_of_pass_write_index: Some(*at),
            end_of_pass_write_index: Some(*at + 1),
        });
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(name),
            color_attachments: targets,
            timestamp_writes,
            ..Default::default()
        });
        draw(&mut pass);
    }

    /// Sends the frame off: its one submission.
    pub fn submit(mut self) -> wgpu::SubmissionIndex {
        let count = self.clock.names.len() as u32;
        if let Some(queries) = self.clock.queries.as_ref().filter(|_| count > 0) {
            self.encoder.resolve_query_set(&queries.set, 0..2 * count, &queries.resolved, 0);
            let bytes = u64::from(count) * 16;
            self.encoder.copy_buffer_to_buffer(&queries.resolved, 0, &queries.read, 0, bytes);
        }
        self.clock.gpu.queue.submit([self.encoder.finish()])
    }
}

/// Workgroups of `size` that cover `count`, along one axis or, where that would be too many, two.
pub(crate) fn groups_of(count: u32, size: u32) -> [u32; 3] {
    const MOST: u32 = 65_535;
    let groups = count.div_ceil(size).max(1);
    if groups <= MOST { [groups, 1, 1] } else { [MOST, groups.div_ceil(MOST), 1] }
}
