//! Ripples on a graphics card: the lattice stays there, in two buffers, and all steps of a call are one submission.
//!
//! Twin: [`super::Ripples`]. When drops strike, where, and how many steps there are is worked out on the processor by the same code; a step, marks
//! and slopes are the card's. [`Scheme::Paper`] reads what it writes, which two buffers don't allow, and is refused.

mod lists;

use super::stretch::Stretch;
use super::{DropFlux, Impact, RippleReport, RippleSettings, Ripples, Scheme, step};
use crate::error::RuntimeError;
use crate::gpu::binding::{self, Kernel};
use crate::gpu::clock::{Clock, GpuReport};
use crate::gpu::memory::{Held, Image};
use crate::gpu::readback::Readback;
use crate::gpu::shader::RIPPLES;
use crate::gpu::{Gpu, LARGEST_BINDING};
use lists::{ENTRIES, Lists, MARKS, Mark, RippleStep, STEPS, Slot, TILE, TILES};

/// What slopes are kept in.
const SLOPES: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

/// A water surface in motion on a graphics card.
///
/// ```no_run
/// use squall_runtime::gpu::Gpu;
/// use squall_runtime::wet::ripples::card::CardRipples;
/// use squall_runtime::wet::ripples::{DropFlux, RippleSettings, Ripples};
///
/// // The application's own device: `Gpu::with_device(device, queue)`.
/// let gpu = Gpu::open()?;
/// let mut water = CardRipples::new(&gpu, &Ripples::new(RippleSettings::default())?)?;
/// let rain = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 200.0 }];
/// water.advance(1.0 / 30.0, &rain, 7)?;
/// // For a pass of one's own: ∂z/∂x and ∂z/∂y of every cell, a texture of 32-bit floats.
/// let slopes = water.slopes();
/// # let _ = slopes;
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
pub struct CardRipples {
    gpu: Gpu,
    settings: RippleSettings,
    time_s: f64,
    owed_s: f64,
    step_s: f64,
    kernels: Kernels,
    /// Heights, m, x fastest; those of `now` and of a step ago change places.
    fields: [Held<wgpu::Buffer>; 2],
    field_groups: [wgpu::BindGroup; 2],
    now: usize,
    /// Numbers of steps, marks, entries, tiles: step.wgsl's second group.
    buffers: [Held<wgpu::Buffer>; 4],
    slots: Vec<wgpu::BindGroup>,
    slopes: Image,
    slopes_group: wgpu::BindGroup,
    slopes_are_stale: bool,
    lists: Lists,
    clock: Clock,
    is_measured: bool,
    back: Readback,
}

struct Kernels {
    step: Kernel,
    mark: Kernel,
    slope: Kernel,
}

impl CardRipples {
    /// Brings a surface to the card, at rest or in motion, at its time.
    ///
    /// # Errors
    ///
    /// [`Scheme::Paper`]; a lattice of more cells than a binding holds (33 554 432).
    pub fn new(gpu: &Gpu, water: &Ripples) -> Result<Self, RuntimeError> {
        let settings = water.settings;
        if settings.scheme == Scheme::Paper {
            return Err(RuntimeError::argument("scheme", "Nine or Five on a card", "Paper"));
        }
        let [width, height] = settings.cells;
        let most = LARGEST_BINDING as usize / 4;
        if width * height > most {
            return Err(RuntimeError::argument("cells", format!("{most} on a card in all"), width * height));
        }
        use binding::Slot::{Read, Store, Uniform, Write};
        let layouts = [
            gpu.layout("ripples", &[Write, Write]),
            gpu.layout("step of ripples", &[Uniform, Read, Read, Read]),
            gpu.layout("slopes of ripples", &[Store(SLOPES)]),
        ];
        let [field_layout, step_layout, slopes_layout] = &layouts;
        let module = gpu.module(&RIPPLES);
        let groups = [Some(field_layout), Some(step_layout), Some(slopes_layout)];
        let kernels = Kernels {
            step: gpu.kernel(&module, "step_ripples", &groups[..2]),
            mark: gpu.kernel(&module, "mark_ripples", &groups[..2]),
            slope: gpu.kernel(&module, "slope_ripples", &groups),
        };
        let fields = [&water.now, &water.before].map(|heights| field(gpu, settings.cells, heights));
        let field_groups = [[0, 1], [1, 0]].map(|order| {
            let resources = order.map(|k| fields[k].as_entire_binding());
            gpu.group("ripples", field_layout, &resources)
        });
        use wgpu::BufferUsages as Use;
        let list = |label: &str, bytes: usize, usage: Use| gpu.buffer(label, bytes as u64, usage);
        let buffers = [
            list("steps of ripples", STEPS * size_of::<Slot>(), Use::UNIFORM),
            list("marks on ripples", MARKS * size_of::<Mark>(), Use::STORAGE),
            list("marks by tile", ENTRIES * size_of::<[u32; 2]>(), Use::STORAGE),
            list("marked tiles", TILES * size_of::<[u32; 4]>(), Use::STORAGE),
        ];
        gpu.write(&buffers[0], &[lists::numbers(&settings, 0.0, 1.0)]);
        let slots = (0..STEPS).map(|slot| slot_group(gpu, step_layout, &buffers, slot)).collect();
        let slopes = gpu.target("slopes of ripples", [width as u32, height as u32], SLOPES);
        let slopes_group = gpu.group("slopes of ripples", slopes_layout, &[slopes.binding()]);
        Ok(Self {
            settings,
            time_s: water.time_s,
            owed_s: water.owed_s,
            step_s: water.step_s,
            kernels,
            fields,
            field_groups,
            now: 0,
            buffers,
            slots,
            slopes,
            slopes_group,
            slopes_are_stale: true,
            lists: Lists::default(),
            clock: Clock::new(gpu),
            is_measured: false,
            back: Readback::new(gpu),
            gpu: gpu.clone(),
        })
    }

    /// What the surface was made with.
    pub const fn settings(&self) -> &RippleSettings {
        &self.settings
    }

    /// Time since the water was at rest, s.
    pub const fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The longest step that is stable, s, less a twentieth: [`Ripples::longest_step_s`].
    pub fn longest_step_s(&self) -> f64 {
        super::longest_step(&self.settings)
    }

    /// Lets `seconds` go by as [`Ripples::advance`] does, with the same steps and the same drops, and works out the slopes: one submission, or as many
    /// as there are sixty-fours of steps and two thousands of drops.
    ///
    /// # Errors
    ///
    /// As [`Ripples::advance`]. Nothing has moved then.
    pub fn advance(
        &mut self,
        seconds: f64,
        rain: &[DropFlux],
        seed: u64,
    ) -> Result<RippleReport, RuntimeError> {
        let clock = (self.time_s, &mut self.owed_s);
        let Some(stretch) = Stretch::new(&self.settings, clock, seconds, (rain, seed))? else {
            return Ok(RippleReport::default());
        };
        let mut coming = stretch.arrivals.iter().peekable();
        for step in 0..stretch.steps {
            let until = stretch.end_of(step);
            while let Some((_, impact)) = coming.next_if(|(time, _)| *time < until) {
                self.strike(impact);
            }
            let seconds = until - self.time_s;
            let ratio = seconds / self.step_s;
            // As the processor has it: round-off of times is no other length.
            let ratio = if (ratio - 1.0).abs() > 1e-9 { ratio } else { 1.0 };
            self.step_s = if ratio == 1.0 { self.step_s } else { seconds };
            self.end(lists::numbers(&self.settings, seconds, ratio), true);
            self.time_s = until;
        }
        self.slopes_are_stale = true;
        self.submit(true);
        Ok(stretch.report())
    }

    /// One drop strikes now: it is seen from the next call on that steps, or asks for slopes or heights.
    pub fn strike(&mut self, impact: &Impact) {
        self.mark(Mark::ring(&self.settings, impact));
    }

    /// A body has moved, as [`Ripples::push`] says.
    pub fn push(&mut self, from_m: [f32; 2], to_m: [f32; 2], radius_m: f32, draught_m: f32) {
        let settings = self.settings;
        for (kernel, sum) in step::moved(&settings, [from_m, to_m], radius_m, draught_m).into_iter().flatten()
        {
            if let Some(mark) = Mark::moved(&settings, &kernel, sum) {
                self.mark(mark);
            }
        }
    }

    /// Slopes (∂z/∂x, ∂z/∂y) of every cell by Sobel's filter, as rg32float, for passes on the same queue.
    pub fn slopes(&mut self) -> &wgpu::TextureView {
        self.flush();
        self.submit(true);
        &self.slopes.view
    }

    /// Heights of every cell, m, x fastest, for passes on the same queue. Two buffers take turns: ask after every call.
    pub fn heights(&mut self) -> &wgpu::Buffer {
        self.flush();
        &self.fields[self.now]
    }

    /// The heights, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read_heights(&mut self) -> Result<Vec<f32>, RuntimeError> {
        self.flush();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.back.copy_buffer(&mut encoder, &self.fields[self.now]);
        self.gpu.queue.submit([encoder.finish()]);
        let mut heights = self.back.values()?;
        heights.truncate(self.settings.cells[0] * self.settings.cells[1]);
        Ok(heights)
    }

    /// The slopes, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read_slopes(&mut self) -> Result<Vec<[f32; 2]>, RuntimeError> {
        self.slopes();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.back.copy(&mut encoder, &self.slopes);
        self.gpu.queue.submit([encoder.finish()]);
        self.back.values()
    }

    /// Has every submission's passes timed, where the device has a clock.
    pub const fn set_measured(&mut self, is_measured: bool) {
        self.is_measured = is_measured;
    }

    /// What the last submission took, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn report(&mut self) -> Result<GpuReport, RuntimeError> {
        crate::wet::card::report(&self.gpu, &mut self.clock)
    }

    fn mark(&mut self, mark: Mark) {
        self.slopes_are_stale = true;
        if !self.lists.mark(&self.settings, mark) {
            self.flush();
            self.lists.mark(&self.settings, mark);
        }
    }

    /// Ends a step's marks; sends everything off where that is full.
    fn end(&mut self, step: RippleStep, steps: bool) {
        if self.lists.end(&self.settings, step, steps) {
            self.submit(false);
        }
    }

    /// Sends off what was marked since the last step.
    fn flush(&mut self) {
        self.end(lists::numbers(&self.settings, 0.0, 1.0), false);
        self.submit(false);
    }

    /// Sends off what is listed, and the slopes of what comes of it where they are asked for and aren't known.
    fn submit(&mut self, with_slopes: bool) {
        let slopes = with_slopes && self.slopes_are_stale;
        let lists = &self.lists;
        if lists.jobs.is_empty() && !slopes {
            return;
        }
        if !lists.jobs.is_empty() {
            self.gpu.write(&self.buffers[0], &lists.slots);
        }
        if !lists.tiles.is_empty() {
            self.gpu.write(&self.buffers[1], &lists.marks);
            self.gpu.write(&self.buffers[2], &lists.entries);
            self.gpu.write(&self.buffers[3], &lists.tiles);
        }
        let [x, y] = self.settings.cells.map(|cells| cells.div_ceil(TILE) as u32);
        let (kernels, field_groups, now) = (&self.kernels, &self.field_groups, &mut self.now);
        let mut recorder = self.clock.record(self.is_measured);
        if !lists.jobs.is_empty() {
            recorder.pass("ripples", |pass| {
                for (job, slot) in lists.jobs.iter().zip(&self.slots) {
                    let groups = [Some(&field_groups[*now]), Some(slot)];
                    if job.tiles > 0 {
                        pass.run(&kernels.mark, &groups, [job.tiles, 1, 1]);
                    }
                    if job.steps {
                        pass.run(&kernels.step, &groups, [x, y, 1]);
                        *now = 1 - *now;
                    }
                }
            });
        }
        if slopes {
            let groups = [Some(&field_groups[*now]), Some(&self.slots[0]), Some(&self.slopes_group)];
            recorder.pass("slopes of ripples", |pass| pass.run(&kernels.slope, &groups, [x, y, 1]));
            self.slopes_are_stale = false;
        }
        recorder.submit();
        self.lists.clear();
    }
}

/// A field without the margins that it has in memory.
fn field(gpu: &Gpu, [width, height]: [usize; 2], heights: &[f32]) -> Held<wgpu::Buffer> {
    let inner = heights.chunks_exact(width + 2).skip(1).take(height).flat_map(|row| &row[1..=width]);
    let inner: Vec<f32> = inner.copied().collect();
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu.buffer("ripples", 4 * inner.len() as u64, usage);
    gpu.write(&buffer, &inner);
    buffer
}

/// The group of a submission's step of this number.
fn slot_group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    [steps, marks, entries, tiles]: &[Held<wgpu::Buffer>; 4],
    slot: usize,
) -> wgpu::BindGroup {
    let own = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer: steps,
        offset: (slot * size_of::<Slot>()) as u64,
        size: std::num::NonZeroU64::new(size_of::<RippleStep>() as u64),
    });
    let lists = [marks, entries, tiles].map(|buffer| buffer.as_entire_binding());
    let [marks, entries, tiles] = lists;
    gpu.group("step of ripples", layout, &[own, marks, entries, tiles])
}

#[cfg(test)]
mod tests;
