//! The rain's medium over a picture, with the halos of lamps and channels.
//!
//! Twins: `crate::medium`, `crate::airlight`, `crate::renderer::halos`.

use super::Gpu;
use super::binding::{Kernel, Slot};
use super::clock::{Dispatch, Recorder};
use super::memory::{Held, Image};
use super::rain::{RainGroup, plain};
use super::shader::MEDIUM;
use super::targets::{LIGHT, METRES};
use crate::airlight::Airlight;
use crate::error::RuntimeError;
use crate::medium::{Medium, Phase};
use crate::point_spread::PointSpread;
use crate::renderer::halos::Spreading;
use crate::renderer::rain_sun::SunTable;

/// Most shells of drawn drops.
pub const SHELLS: usize = 256;
/// Lights with halos that there is room for at first.
const FEW_HALOS: usize = 64;

plain! {
    /// `MediumFrame` of medium_depth.wgsl.
    MediumFrame { medium: [f32; 4], counts: [u32; 4], relief: [f32; 4], shells: [[f32; 4]; SHELLS] }
}
plain! {
    /// `HaloLight` of medium.wgsl.
    HaloLight {
        start: [f32; 3],
        radius: f32,
        end: [f32; 3],
        shape: f32,
        intensity: [f32; 3],
        extinction: f32,
        most: [f32; 2],
        number: u32,
        pad: u32,
    }
}

/// The pass.
pub struct MediumPass {
    kernel: Kernel,
    own_layout: wgpu::BindGroupLayout,
    target_layout: wgpu::BindGroupLayout,
    pub uniform: Held<wgpu::Buffer>,
    /// What is scattered once; the source of what is scattered more often, and what is seen of that.
    tables: [Image; 3],
    /// Means of the sun's light along rays, and their rows; none where rain shows the sun as it shows the world.
    sun_means: Image,
    sun_rows: u32,
    /// The function that they were made for.
    phase: Option<Phase>,
    halos: Held<wgpu::Buffer>,
    /// What is dry under covers, and what lamps reach.
    others: [wgpu::TextureView; 2],
    own: wgpu::BindGroup,
    targets: Option<wgpu::BindGroup>,
    /// What is left of the light behind, per pixel.
    pub left: Option<Image>,
    size: [u32; 2],
}

impl MediumPass {
    /// The pipeline; `others` are what is dry under covers and what lamps reach.
    pub fn new(
        gpu: &Gpu,
        frame: &wgpu::BindGroupLayout,
        rain: &RainGroup,
        others: [&wgpu::TextureView; 2],
    ) -> Self {
        let exact = Slot::Exact;
        let own_layout = gpu
            .layout("medium", &[Slot::Uniform, exact, Slot::Read, exact, exact, exact, Slot::Whole, exact]);
        let target_layout = gpu
            .layout("medium's pictures", &[Slot::Flat, Slot::Exact, Slot::Store(LIGHT), Slot::Store(METRES)]);
        let module = gpu.module(&MEDIUM);
        let groups = [Some(frame), Some(&own_layout), Some(&rain.layout), Some(&target_layout)];
        let kernel = gpu.kernel(&module, "apply_medium", &groups);
        let uniform = gpu.uniform::<MediumFrame>("medium");
        let exact = wgpu::TextureFormat::Rgba32Float;
        let [source, seen] = PointSpread::SIZES;
        let tables = [("airlight", Airlight::SIZE), ("scattered light", source), ("seen of it", seen)];
        let tables = tables.map(|(name, size)| gpu.target(name, size, exact));
        let halos = gpu.storage("halos", &[HaloLight::default(); FEW_HALOS]);
        let others = others.map(Clone::clone);
        let sun_means = gpu.target("sun along rays", SunTable::SIZE, exact);
        let own = own_group(gpu, &own_layout, (&uniform, &halos), (&tables, &sun_means), &others);
        let (phase, targets, left, size) = (None, None, None, [0; 2]);
        Self {
            kernel,
            own_layout,
            target_layout,
            uniform,
            tables,
            sun_means,
            sun_rows: 0,
            phase,
            halos,
            others,
            own,
            targets,
            left,
            size,
        }
    }

    /// The sun as the rays of the frames that are set from now on have it; without a table it is among what rain shows of the world.
    pub fn set_sun(&mut self, gpu: &Gpu, table: Option<&SunTable>) {
        self.sun_rows = table.map_or(0, |table| table.counts[1] as u32);
        if let Some(table) = table {
            gpu.fill(&self.sun_means, &table.texels());
        }
    }

    /// The medium of the next frame, dry without one; lights with halos in it, and how it spreads their light; what covers leave out of it
    /// ([`super::relief::ReliefPass::set`]).
    ///
    /// Errors: more shells of drawn drops than a uniform buffer holds.
    pub fn set(
        &mut self,
        gpu: &Gpu,
        medium: Option<&Medium>,
        (lights, spreading): (&[HaloLight], Option<&Spreading>),
        relief: [f32; 4],
    ) -> Result<(), RuntimeError> {
        let mut uniform = Box::<MediumFrame>::default();
        let Some(medium) = medium else {
            gpu.write(&self.uniform, &[*uniform]);
            return Ok(());
        };
        let count = medium.shells().count();
        if count > SHELLS {
            let wanted = format!("at most {SHELLS} shells of drawn drops on a graphics card");
            return Err(RuntimeError::argument("rain", wanted, count));
        }
        uniform.shells.iter_mut().zip(medium.shells()).for_each(|(slot, shell)| *slot = shell);
        if let Some(spreading) = spreading
            && self.phase.as_ref() != Some(medium.phase())
        {
            let texels = spreading.texels();
            self.tables.iter().zip(&texels).for_each(|(table, texels)| gpu.fill(table, texels));
            self.phase = Some(medium.phase().clone());
        }
        let farthest = medium.shells().map(|shell| shell[2]).fold(0.0, f32::max);
        uniform.medium = [medium.extinction().0 as f32, farthest, 0.0, 0.0];
        uniform.relief = relief;
        uniform.counts = [count as u32, lights.len() as u32, 1, self.sun_rows];
        gpu.write(&self.uniform, &[*uniform]);
        if size_of_val(lights) as u64 > self.halos.size() {
            let mut room = lights.to_vec();
            room.resize(lights.len().next_power_of_two(), HaloLight::default());
            self.halos = gpu.storage("halos", &room);
            let buffers = (&*self.uniform, &*self.halos);
            let tables = (&self.tables, &self.sun_means);
            self.own = own_group(gpu, &self.own_layout, buffers, tables, &self.others);
        } else {
            gpu.write(&self.halos, lights);
        }
        Ok(())
    }

    /// Binds a picture to look at, the metres to what it shows, and the picture to make.
    pub fn set_targets(
        &mut self,
        gpu: &Gpu,
        [picture, metres, shown]: [&wgpu::TextureView; 3],
        size: [u32; 2],
    ) {
        use wgpu::BindingResource::TextureView;
        let left = gpu.target("left by the medium", size, METRES);
        self.targets = Some(gpu.group(
            "medium's pictures",
            &self.target_layout,
            &[TextureView(picture), TextureView(metres), TextureView(shown), TextureView(&left.view)],
        ));
        (self.left, self.size) = (Some(left), size);
    }

    /// Composites the medium.
    pub fn record(&self, recorder: &mut Recorder<'_>, [frame, rain]: [&wgpu::BindGroup; 2]) {
        let Some(targets) = &self.targets else { return };
        let groups = [frame, &self.own, rain, targets];
        let size = [self.size[0].div_ceil(8), self.size[1].div_ceil(8), 1];
        recorder.compute("medium", &[Dispatch { kernel: &self.kernel, groups: &groups, size }]);
    }
}

fn own_group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    (uniform, halos): (&wgpu::Buffer, &wgpu::Buffer),
    ([once, source, seen], sun_means): (&[Image; 3], &Image),
    [relief, reach]: &[wgpu::TextureView; 2],
) -> wgpu::BindGroup {
    use wgpu::BindingResource::TextureView;
    let resources = [
        uniform.as_entire_binding(),
        TextureView(&once.view),
        halos.as_entire_binding(),
        TextureView(&source.view),
        TextureView(&seen.view),
        TextureView(relief),
        TextureView(reach),
        TextureView(&sun_means.view),
    ];
    gpu.group("medium", layout, &resources)
}

#[cfg(test)]
mod tests;
