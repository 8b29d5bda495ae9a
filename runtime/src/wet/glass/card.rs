//! A pane with its water on a graphics card: cells stay there, and so does the length of steps, which follows the fastest drop; nothing is read back.
//!
//! Twin: [`super::Glass`]. Water is whole nanograms on both, so no water is lost on either. Forces are in single precision on the card: a drop at its threshold
//! may begin to run a step sooner or later, and the roulette may find another cell, so the two panes agree step by step, and over long times by their means.
//! Wipers and what a pane shows are the processor's.

use super::{FLOW_MOST, Glass, GlassSettings, flow};
use crate::error::RuntimeError;
use crate::gpu::binding::{Kernel, Slot};
use crate::gpu::clock::{Clock, GpuReport};
use crate::gpu::memory::Held;
use crate::gpu::readback::Readback;
use crate::gpu::shader::GLASS;
use crate::gpu::{Gpu, LARGEST_BINDING};
use uniforms::{Pane, State};

mod uniforms {
    use crate::gpu::rain::plain;

    plain! {
        /// `Pane` of flow.wgsl.
        Pane {
            cells: [u32; 2], spacing: f32, hold: f32, pull: [f32; 2], drag: f32, edge_friction: f32, wetting: f32, wet_preference: f32,
            speed_most: f32, lightest: u32, seed: [u32; 2],
        }
    }
    plain! {
        /// `State` of flow.wgsl.
        State {
            left: f32, step: f32, steps: [u32; 2], salt: [u32; 2], fastest: u32, drained_low: u32, drained_high: u32, flows_low: u32,
            flows_high: u32, pad0: u32,
        }
    }
}

/// Steps of one submission, and drops that land before it, at most.
const STEPS: u32 = 256;
const LANDINGS: usize = 16_384;
/// Cells of a pane at most: a binding holds 16 bytes of each.
const CELLS: usize = LARGEST_BINDING as usize / 16;

/// What has become of a pane's water.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CardGlassReport {
    /// Steps taken, of both kinds of pane together.
    pub steps: u64,
    /// Flows from a cell to one below, on the card.
    pub flows: u64,
    /// Water that ran off the pane, ng.
    pub drained_ng: u64,
}

/// A pane with its water on a graphics card.
///
/// ```no_run
/// use squall_runtime::gpu::Gpu;
/// use squall_runtime::wet::glass::card::CardGlass;
/// use squall_runtime::wet::glass::{Glass, GlassSettings};
///
/// // The application's own device: `Gpu::with_device(device, queue)`.
/// let gpu = Gpu::open()?;
/// let mut pane = CardGlass::new(&gpu, Glass::new(GlassSettings::default())?)?;
/// pane.rain(2.5e-3, 300.0, 1.0 / 60.0)?;
/// pane.advance(1.0 / 60.0)?;
/// // For a pass of one's own: whole nanograms of every cell, x fastest.
/// let water: &wgpu::Buffer = pane.water();
/// # let _ = water;
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
pub struct CardGlass {
    gpu: Gpu,
    /// The pane as it came, whose surface stays and whose arrivals go on; its water is the card's.
    pane: Glass,
    kernels: [Kernel; 4],
    /// The pane's numbers, its surface, water, water between halves of a step, motion, flows, state.
    buffers: [Held<wgpu::Buffer>; 7],
    group: wgpu::BindGroup,
    groups: Held<wgpu::Buffer>,
    plan_group: wgpu::BindGroup,
    landings: Held<wgpu::Buffer>,
    landings_group: wgpu::BindGroup,
    /// Drops that landed since the last submission: cell and ng.
    landed: Vec<[u32; 2]>,
    received: u64,
    clock: Clock,
    is_measured: bool,
    back: Readback,
}

impl CardGlass {
    /// Brings a pane to the card, dry or with its water in motion.
    ///
    /// # Errors
    ///
    /// A pane of more cells than a binding holds (8 388 608).
    pub fn new(gpu: &Gpu, pane: Glass) -> Result<Self, RuntimeError> {
        let count = pane.cells.mass.len();
        if count > CELLS {
            return Err(RuntimeError::argument("cells", format!("{CELLS} on a card in all"), count));
        }
        use Slot::{Read, Uniform, Write};
        let layouts = [
            gpu.layout("pane", &[Uniform, Read, Write, Write, Write, Write, Write]),
            gpu.layout("plan of a pane", &[Write]),
            gpu.layout("landings on a pane", &[Read]),
        ];
        let module = gpu.module(&GLASS);
        let with = |other: Option<usize>| {
            let mut groups = vec![None, Some(&layouts[0])];
            groups.resize(other.map_or(2, |number| number + 2), None);
            if let Some(number) = other {
                groups[number + 1] = Some(&layouts[number]);
            }
            groups
        };
        let kernels =
            [("plan_flow", Some(1)), ("run_drops", None), ("drops_arrive", None), ("drops_land", Some(2))]
                .map(|(entry, other)| gpu.kernel(&module, entry, &with(other)));
        let buffers = buffers_of(gpu, &pane);
        let group =
            gpu.group("pane", &layouts[0], &buffers.each_ref().map(|buffer| buffer.as_entire_binding()));
        use wgpu::BufferUsages as Use;
        let groups = gpu.buffer("plan of a pane", 12, Use::STORAGE | Use::INDIRECT);
        let plan_group = gpu.group("plan of a pane", &layouts[1], &[groups.as_entire_binding()]);
        let landings = gpu.buffer("landings on a pane", 8 * (LANDINGS as u64 + 1), Use::STORAGE);
        let landings_group = gpu.group("landings on a pane", &layouts[2], &[landings.as_entire_binding()]);
        Ok(Self {
            received: pane.received,
            pane,
            kernels,
            buffers,
            group,
            groups,
            plan_group,
            landings,
            landings_group,
            landed: Vec::new(),
            clock: Clock::new(gpu),
            is_measured: false,
            back: Readback::new(gpu),
            gpu: gpu.clone(),
        })
    }

    /// What the pane was made with.
    pub const fn settings(&self) -> &GlassSettings {
        &self.pane.settings
    }

    /// A drop of a diameter, m, lands in a cell.
    ///
    /// # Errors
    ///
    /// As [`Glass::wet`].
    pub fn wet(&mut self, cell: [usize; 2], diameter_m: f64) -> Result<(), RuntimeError> {
        let (cell, mass) = super::landing(&self.pane.settings, cell, diameter_m)?;
        self.land(cell, mass);
        Ok(())
    }

    /// Drops of one diameter arrive as [`Glass::rain`] has them: the same ones.
    ///
    /// # Errors
    ///
    /// As [`Glass::rain`].
    pub fn rain(
        &mut self,
        diameter_m: f64,
        impacts_per_m2_s: f64,
        seconds: f64,
    ) -> Result<u32, RuntimeError> {
        let settings = self.pane.settings;
        let cells =
            super::arrivals(&settings, &mut self.pane.arrivals, (diameter_m, impacts_per_m2_s, seconds))?;
        for &(cell, mass) in &cells {
            self.land(cell, mass);
        }
        Ok(cells.len() as u32)
    }

    fn land(&mut self, cell: usize, mass: u32) {
        self.received += u64::from(mass);
        self.landed.push([cell as u32, mass]);
        if self.landed.len() == LANDINGS {
            self.submit(0);
        }
    }

    /// Lets time go by as [`Glass::advance`] does, in steps in which no drop crosses more than a cell. How long those are the card finds out; as many
    /// are sent off as the fastest drop that there can be would take, and those that are too many do nothing.
    ///
    /// # Errors
    ///
    /// As [`Glass::advance`]. Nothing has moved then.
    pub fn advance(&mut self, seconds: f64) -> Result<(), RuntimeError> {
        let most = self.pane.longest_call_s();
        if !(0.0..=most).contains(&seconds) {
            return Err(RuntimeError::argument("seconds", format!("0 to {most:.3}"), seconds));
        }
        // No drop is heavier than all water that there was.
        let heaviest = self.received.min(u64::from(FLOW_MOST)) as u32;
        let fastest = flow::last_speed(&self.pane.settings, heaviest, self.pane.slipperiest());
        let shortest =
            self.pane.step_beside(fastest.max(f64::from(self.pane.fastest)).min(self.pane.speed_most()));
        // One more, for round-off.
        let mut steps = if seconds > 0.0 { libm::ceil(seconds / shortest) as u32 + 1 } else { 0 };
        // Drops that land do so before the first step, in its submission.
        self.gpu.write(&self.buffers[6], &[seconds as f32]);
        if steps == 0 {
            self.submit(0);
        }
        while steps > 0 {
            let now = steps.min(STEPS);
            self.submit(now);
            steps -= now;
        }
        Ok(())
    }

    /// Water of every cell, ng, 32 bits each, x fastest, for passes on the same queue.
    pub fn water(&mut self) -> &wgpu::Buffer {
        self.submit(0);
        &self.buffers[2]
    }

    /// Water that has landed, ng. What is on the pane and what has left it come to this, to the nanogram.
    pub const fn received_ng(&self) -> u64 {
        self.received
    }

    /// The water, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read_water(&mut self) -> Result<Vec<u32>, RuntimeError> {
        let mut water = self.read(2)?;
        water.truncate(self.pane.cells.mass.len());
        Ok(water)
    }

    /// Speed of every cell's drop down the pane, m/s, and the share of its cell that it has crossed, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read_motion(&mut self) -> Result<Vec<[f32; 2]>, RuntimeError> {
        let mut motion = self.read(4)?;
        motion.truncate(self.pane.cells.mass.len());
        Ok(motion)
    }

    /// What has become of the water, waited for.
    ///
    /// # Errors
    ///
    /// The device is lost.
    pub fn read_report(&mut self) -> Result<CardGlassReport, RuntimeError> {
        let state: Vec<State> = self.read(6)?;
        let both = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
        Ok(state.first().map_or_else(CardGlassReport::default, |state| CardGlassReport {
            steps: both(state.steps[0], state.steps[1]),
            flows: both(state.flows_low, state.flows_high),
            drained_ng: both(state.drained_low, state.drained_high),
        }))
    }

    fn read<T: bytemuck::AnyBitPattern>(&mut self, buffer: usize) -> Result<Vec<T>, RuntimeError> {
        self.submit(0);
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.back.copy_buffer(&mut encoder, &self.buffers[buffer]);
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

    /// Sends off what landed, and so many steps.
    fn submit(&mut self, steps: u32) {
        if self.landed.is_empty() && steps == 0 {
            return;
        }
        let count = self.landed.len() as u32;
        if count > 0 {
            // Stable: drops of one cell land in their order.
            self.landed.sort_by_key(|landing| landing[0]);
            self.landed.insert(0, [count, 0]);
            self.gpu.write(&self.landings, &self.landed);
            self.landed.clear();
        }
        let [plan, run, arrive, land] = &self.kernels;
        let own = Some(&self.group);
        let mut recorder = self.clock.record(self.is_measured);
        recorder.pass("pane", |pass| {
            if count > 0 {
                let groups = [None, own, None, Some(&self.landings_group)];
                pass.run(land, &groups, [count.div_ceil(64), 1, 1]);
            }
            for _ in 0..steps {
                pass.run(plan, &[None, own, Some(&self.plan_group)], [1, 1, 1]);
                pass.run_indirect(run, &[None, own], &self.groups);
                pass.run_indirect(arrive, &[None, own], &self.groups);
            }
        });
        recorder.submit();
    }
}

/// A pane's buffers, in the order of the shader's bindings.
fn buffers_of(gpu: &Gpu, pane: &Glass) -> [Held<wgpu::Buffer>; 7] {
    use wgpu::BufferUsages as Use;
    let (settings, cells) = (&pane.settings, &pane.cells);
    let halves = |bits: u64| [bits as u32, (bits >> 32) as u32];
    let [across, down] = settings.pull_m_per_s2;
    let numbers = Pane {
        cells: settings.cells.map(|cells| cells as u32),
        spacing: settings.spacing_m as f32,
        hold: settings.hold as f32,
        pull: [across as f32, down as f32],
        drag: settings.drag as f32,
        edge_friction: settings.edge_friction as f32,
        wetting: settings.wetting as f32,
        wet_preference: settings.wet_preference as f32,
        speed_most: pane.speed_most() as f32,
        lightest: cells.lightest,
        seed: halves(settings.seed),
    };
    let uniform = gpu.uniform::<Pane>("pane");
    gpu.write(&uniform, &[numbers]);
    let kinds = cells.affinity.iter().zip(&cells.friction).zip(&cells.blocked);
    let kinds: Vec<[f32; 4]> = kinds
        .map(|((&affinity, &friction), &blocked)| [affinity, friction, f32::from(u8::from(blocked)), 0.0])
        .collect();
    let values = |label: &str, bytes: usize| {
        gpu.buffer(label, (bytes * cells.mass.len()) as u64, Use::STORAGE | Use::COPY_SRC)
    };
    let (water, kept) = (values("water of a pane", 4), values("water between halves of a step", 4));
    let (motion, flows) = (values("motion of drops", 8), values("flows", 16));
    let moving: Vec<[f32; 2]> =
        cells.speed.iter().zip(&cells.crossed).map(|(&speed, &crossed)| [speed, crossed]).collect();
    gpu.write(&water, &cells.mass);
    gpu.write(&motion, &moving);
    let state = gpu.buffer("state of a pane", size_of::<State>() as u64, Use::STORAGE | Use::COPY_SRC);
    let [drained_low, drained_high] = halves(pane.drained);
    let (steps, fastest) = (halves(pane.steps), pane.fastest.to_bits());
    gpu.write(&state, &[State { steps, fastest, drained_low, drained_high, ..State::default() }]);
    [uniform, gpu.storage("surface of a pane", &kinds), water, kept, motion, flows, state]
}

#[cfg(test)]
mod tests;
