//! What rain shows of the world in every direction, from the world's harmonics: they come from the card and stay there.
//!
//! Twin: `crate::world::InScattering`.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Dispatch, Recorder};
use super::memory::Held;
use super::rain::{PHASES, RainGroup, SHOWN_SIDE, plain};
use super::shader::SHOWN;
use crate::medium::Phase;
use crate::world::HIGHEST_DEGREE;
use glam::Vec3;

/// Degrees of harmonics, 0 included.
const DEGREES: usize = HIGHEST_DEGREE + 1;

plain! {
    /// `Moments` of shown.wgsl.
    Moments { left: [[f32; 4]; PHASES * DEGREES], sun: [f32; 4] }
}

/// The pass.
pub struct ShownPass {
    kernel: Kernel,
    moments: Held<wgpu::Buffer>,
    told: Box<Moments>,
    world: wgpu::BindGroup,
    out: wgpu::BindGroup,
    phases: Vec<Phase>,
    _steps: Held<wgpu::Buffer>,
}

impl ShownPass {
    /// A pass that reads `harmonics`: the world's coefficients, four numbers each, in the order l² + l + m.
    pub fn new(gpu: &Gpu, frame: &wgpu::BindGroupLayout, rain: &RainGroup, harmonics: &wgpu::Buffer) -> Self {
        let world_layout = gpu.layout("world's light", &[Slot::Uniform, Slot::Read, Slot::Read]);
        let out_layout = gpu.layout("shown", &[Slot::Store(wgpu::TextureFormat::Rgba32Float)]);
        let moments = gpu.uniform::<Moments>("moments");
        let steps = gpu.storage("harmonics' recurrence", &crate::world::upload::basis_steps());
        let world = gpu.group(
            "world's light",
            &world_layout,
            &[moments.as_entire_binding(), harmonics.as_entire_binding(), steps.as_entire_binding()],
        );
        let shown = wgpu::BindingResource::TextureView(&rain.shown.view);
        let out = gpu.group("shown", &out_layout, &[shown]);
        let module = gpu.module(&SHOWN);
        let kernel =
            gpu.kernel(&module, "show_world", &[Some(frame), Some(&world_layout), Some(&out_layout)]);
        let told = Box::default();
        Self { kernel, moments, told, world, out, phases: Vec::new(), _steps: steps }
    }

    /// Tells the passes how drops, medium and undrawn rain spread light; nothing is sent while they spread it alike.
    pub fn set_phases(&mut self, gpu: &Gpu, rain: &RainGroup, phases: [&Phase; PHASES]) {
        if self.phases.iter().eq(phases) {
            return;
        }
        let (rows, _) = self.told.left.as_chunks_mut::<DEGREES>();
        for (row, phase) in rows.iter_mut().zip(phases) {
            row.iter_mut()
                .zip(phase.weakening())
                .for_each(|(left, own)| left[..3].copy_from_slice(&own[..3]));
        }
        gpu.write(&self.moments, &[*self.told]);
        let bins = rain.phases.texture.width() as usize;
        let row = |phase: &Phase| phase.texels().unwrap_or_else(|| vec![[0.0; 4]; bins]);
        let texels: Vec<[f32; 4]> = phases.into_iter().flat_map(row).collect();
        gpu.fill(&rain.phases, &texels);
        self.phases = phases.map(Phase::clone).to_vec();
    }

    /// Tells the passes, after [`ShownPass::set_phases`], how deep the rain before a sun in unit direction `towards` is for each.
    pub fn set_sun(&mut self, gpu: &Gpu, towards: Vec3, depths: [f64; PHASES]) {
        let mut told = self.told.clone();
        let (rows, _) = told.left.as_chunks_mut::<DEGREES>();
        for ((row, phase), depth) in rows.iter_mut().zip(&self.phases).zip(depths) {
            row.iter_mut().enumerate().for_each(|(l, left)| left[3] = phase.moments_again(depth, l) as f32);
        }
        told.sun = towards.extend(0.0).to_array();
        if told != self.told {
            gpu.write(&self.moments, &[*told]);
            self.told = told;
        }
    }

    /// Works the maps out.
    pub fn record(&self, recorder: &mut Recorder<'_>, frame: &wgpu::BindGroup) {
        let groups = [frame, &self.world, &self.out];
        let side = SHOWN_SIDE.div_ceil(8);
        let size = [side, side, PHASES as u32];
        recorder.compute("light of rain", &[Dispatch { kernel: &self.kernel, groups: &groups, size }]);
    }
}
