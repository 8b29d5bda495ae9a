//! Light on drops on a graphics card: the picture made small and what balls of water show of it are made there each frame; the world's light and what was
//! baked of lamps and lightning are brought there once.
//!
//! Twin: [`super::light`] and [`super::ball`].

use super::eye::Eye;
use super::light::{LightControls, MIRROR_ASYMMETRY, UPHILL_M};
use crate::error::RuntimeError;
use crate::gpu::binding::{Kernel, Slot};
use crate::gpu::clock::Recorder;
use crate::gpu::memory::Held;
use crate::gpu::rain::plain;
use crate::gpu::shader::DROP_TABLES;
use crate::gpu::{Gpu, LARGEST_BINDING};
use crate::medium::Phase;
use crate::wet::card::CardFrame;
use crate::wet::maps::{GroundMap, LightningVolume, WetMaps};
use crate::world::WorldLight;
use glam::{DVec2, DVec3};

/// Pixels along the side of a block of the small picture, tiles across and down a picture, entries of a tile's table.
const BLOCK: u32 = 8;
const TILES: [u32; 2] = [16, 12];
const ENTRIES: u32 = 341;

plain! {
    /// `DropLight` of light.wgsl.
    DropLight {
        right: [f32; 3], is_perspective: u32, up: [f32; 3], is_paper: u32, forward: [f32; 3], flash_0: f32, sun_towards: [f32; 3], flash_1: f32,
        sun_irradiance: [f32; 3], lamp_height: f32, keys: [[f32; 4]; 2], volume_origin: [f32; 3], volume_cell: f32, volume_size: [u32; 3],
        columns: u32, scale: [f32; 2], centre: [f32; 2], size: [u32; 2], overhead_origin: [f32; 2], overhead_size: [u32; 2],
        overhead_cell: f32, uphill: f32,
    }
}

/// Where the light that was baked lies.
#[derive(Default)]
struct Baked {
    overhead: Option<(DVec2, f64, [u32; 2])>,
    lightning: Option<(DVec3, f64, [u32; 3])>,
    keys: [[f32; 4]; 2],
}

/// Light of frames on a card.
pub(crate) struct CardDropLight {
    gpu: Gpu,
    /// Group 2 of shaders that draw drops.
    pub layout: wgpu::BindGroupLayout,
    picture_layout: wgpu::BindGroupLayout,
    shrink: Kernel,
    fill: Kernel,
    uniform: Held<wgpu::Buffer>,
    tables: Held<wgpu::Buffer>,
    world: Held<wgpu::Buffer>,
    known: Option<WorldLight>,
    small: Option<([u32; 2], Held<wgpu::Buffer>)>,
    maps: [Held<wgpu::Buffer>; 2],
    baked: Baked,
    group: Option<wgpu::BindGroup>,
    picture: Option<(wgpu::TextureView, wgpu::BindGroup)>,
}

impl CardDropLight {
    /// The pipelines, and no light yet.
    pub fn new(gpu: &Gpu) -> Self {
        use Slot::{Exact, Read, Uniform, Write};
        let layout = gpu.layout("light on drops", &[Uniform, Write, Write, Read, Read, Read]);
        let picture_layout = gpu.layout("picture of drops", &[Exact]);
        let module = gpu.module(&DROP_TABLES);
        let groups = [None, Some(&picture_layout), Some(&layout)];
        let kernel = |entry| gpu.kernel(&module, entry, &groups);
        let (shrink, fill) = (kernel("shrink_for_drops"), kernel("tables_for_drops"));
        let values =
            |label: &str, count: u32| gpu.buffer(label, 16 * u64::from(count), wgpu::BufferUsages::STORAGE);
        let side = crate::world::InScattering::MAP_SIDE as u32;
        Self {
            layout,
            picture_layout,
            shrink,
            fill,
            uniform: gpu.uniform::<DropLight>("light on drops"),
            tables: values("what drops show", TILES[0] * TILES[1] * ENTRIES),
            world: values("world around drops", side * side),
            known: None,
            small: None,
            maps: ["light from overhead", "light of lightning"].map(|label| values(label, 1)),
            baked: Baked::default(),
            group: None,
            picture: None,
            gpu: gpu.clone(),
        }
    }

    /// Brings what was baked of lamps overhead and lightning to the card.
    ///
    /// Errors: maps of lamps that lie otherwise in one band than in another, or of more than a binding holds.
    pub fn set_maps(&mut self, maps: &WetMaps) -> Result<(), RuntimeError> {
        let mut baked = Baked::default();
        let overhead = maps.overhead.as_ref().map(lamps).transpose()?.unwrap_or_default();
        if let Some([map, ..]) = &maps.overhead {
            baked.overhead = Some((map.origin_m, map.cell_m, map.size.map(|cells| cells as u32)));
        }
        let lightning = maps.lightning.as_ref().map(|volume| sent_on(volume, &mut baked)).unwrap_or_default();
        for (field, bytes) in [("overhead", 16 * overhead.len()), ("lightning", 4 * lightning.len())] {
            if bytes as u64 > LARGEST_BINDING {
                let wanted = format!("at most {LARGEST_BINDING} bytes on a card");
                return Err(RuntimeError::argument(field, wanted, bytes));
            }
        }
        let gpu = &self.gpu;
        self.maps =
            [gpu.storage("light from overhead", &overhead), gpu.storage("light of lightning", &lightning)];
        (self.baked, self.group) = (baked, None);
        Ok(())
    }

    /// What the next submission is told of a frame.
    pub fn prepare(&mut self, frame: &CardFrame<'_>, eye: &Eye, controls: &LightControls) {
        if self.known.as_ref() != Some(frame.light) {
            let world = frame.light.in_scattering(&Phase::HenyeyGreenstein(MIRROR_ASYMMETRY));
            let texels: Vec<[f32; 4]> = world.texels().iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
            self.gpu.write(&self.world, &texels);
            self.known = Some(frame.light.clone());
        }
        let blocks = frame.size().map(|side| side.div_ceil(BLOCK));
        if self.small.as_ref().is_none_or(|(known, _)| *known != blocks) {
            let bytes = 16 * u64::from(blocks[0]) * u64::from(blocks[1]);
            let buffer = self.gpu.buffer("picture made small", bytes, wgpu::BufferUsages::STORAGE);
            (self.small, self.group) = (Some((blocks, buffer)), None);
        }
        self.gpu.write(&self.uniform, &[self.uniform_of(frame, eye, controls, blocks[0])]);
        self.bind(frame.picture);
    }

    fn uniform_of(
        &self,
        frame: &CardFrame<'_>,
        eye: &Eye,
        controls: &LightControls,
        columns: u32,
    ) -> DropLight {
        let [flash_0, flash_1] = frame.lightning.map(|l| l.max(0.0) * controls.flash);
        let mut uniform = DropLight {
            right: eye.right.to_array(),
            is_perspective: u32::from(eye.is_perspective()),
            up: eye.up.to_array(),
            is_paper: u32::from(controls.paper),
            forward: eye.forward.to_array(),
            flash_0,
            flash_1,
            lamp_height: controls.lamp_height_m,
            keys: self.baked.keys,
            volume_cell: 1.0,
            volume_size: [1; 3],
            columns,
            scale: eye.scale.to_array(),
            centre: eye.centre().to_array(),
            size: frame.size(),
            overhead_cell: 1.0,
            ..DropLight::default()
        };
        if let Some(sun) = &frame.light.sun {
            (uniform.sun_towards, uniform.sun_irradiance) = (sun.towards.to_array(), sun.irradiance);
        }
        if let Some((origin, cell, size)) = self.baked.lightning {
            uniform.volume_origin = eye.offset(origin).to_array();
            (uniform.volume_cell, uniform.volume_size) = (cell as f32, size);
        }
        if let Some((origin, cell, size)) = self.baked.overhead {
            uniform.overhead_origin = (origin - eye.position.truncate()).as_vec2().to_array();
            (uniform.overhead_cell, uniform.overhead_size) = (cell as f32, size);
            uniform.uphill = (UPHILL_M / cell).max(1.0) as f32;
        }
        uniform
    }

    fn bind(&mut self, picture: &wgpu::TextureView) {
        if self.picture.as_ref().is_none_or(|(known, _)| known != picture) {
            let resource = wgpu::BindingResource::TextureView(picture);
            let group = self.gpu.group("picture of drops", &self.picture_layout, &[resource]);
            self.picture = Some((picture.clone(), group));
        }
        if let (None, Some((_, small))) = (&self.group, &self.small) {
            let [overhead, lightning] = &self.maps;
            let buffers = [&self.uniform, small, &self.tables, &self.world, overhead, lightning];
            let resources = buffers.map(|buffer| buffer.as_entire_binding());
            self.group = Some(self.gpu.group("light on drops", &self.layout, &resources));
        }
    }

    /// Puts the tables on record; answers group 2, once a frame was prepared.
    pub fn record(&self, recorder: &mut Recorder<'_>) -> Option<&wgpu::BindGroup> {
        let ((_, picture), group, (blocks, _)) =
            (self.picture.as_ref()?, self.group.as_ref()?, self.small.as_ref()?);
        let groups = [None, Some(picture), Some(group)];
        recorder.pass("light on drops", |pass| {
            pass.run(&self.shrink, &groups, [blocks[0].div_ceil(8), blocks[1].div_ceil(8), 1]);
            pass.run(&self.fill, &groups, [TILES[0], TILES[1], 1]);
        });
        Some(group)
    }
}

/// Light of lamps, red, green and blue of each cell.
fn lamps(maps: &[GroundMap; 3]) -> Result<Vec<[f32; 4]>, RuntimeError> {
    let [red, green, blue] = maps;
    let lies = |map: &GroundMap| (map.origin_m, map.cell_m, map.size, map.values.len());
    if lies(red) != lies(green) || lies(red) != lies(blue) {
        return Err(RuntimeError::argument("overhead", "three maps of the same cells on a card", "others"));
    }
    let values = red.values.iter().zip(&green.values).zip(&blue.values);
    Ok(values.map(|((&r, &g), &b)| [r, g, b, 0.0]).collect())
}

/// What a scene sends on of lightning: the even harmonic of each key direction's nodes.
fn sent_on(volume: &LightningVolume, baked: &mut Baked) -> Vec<f32> {
    for (key, towards) in baked.keys.iter_mut().zip(&volume.directions) {
        let [x, y, z] = towards.as_vec3().to_array();
        *key = [x, y, z, 1.0];
    }
    let count: usize = volume.size.iter().product();
    if count > 0 {
        baked.lightning = Some((volume.origin_m, volume.cell_m, volume.size.map(|nodes| nodes as u32)));
    }
    // Of a key direction whose nodes are not all there nothing is known.
    let whole = volume.harmonics.len().checked_div(count).unwrap_or(0) * count;
    volume.harmonics[..whole].iter().map(|harmonics| harmonics[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assert_layout;
    use crate::wet::material::WATER_INDEX;

    #[test]
    fn the_lights_numbers_lie_as_the_shader_has_them() {
        assert_layout!(
            DROP_TABLES,
            DropLight {
                right,
                is_perspective,
                up,
                is_paper,
                forward,
                flash_0,
                sun_towards,
                flash_1,
                sun_irradiance,
                lamp_height,
                keys,
                volume_origin,
                volume_cell,
                volume_size,
                columns,
                scale,
                centre,
                size,
                overhead_origin,
                overhead_size,
                overhead_cell,
                uphill
            }
        );
    }

    #[test]
    fn the_shaders_constants_are_the_processors() {
        for line in [
            format!("WATER_INDEX: f32 = {WATER_INDEX}"),
            format!("SMALL_BLOCK: u32 = {BLOCK}u"),
            format!("TILES: vec2u = vec2u({}u, {}u)", TILES[0], TILES[1]),
            format!("ENTRIES: u32 = {ENTRIES}u"),
            format!("WORLD_STEPS: u32 = {}u", crate::world::InScattering::MAP_SIDE - 1),
        ] {
            assert!(DROP_TABLES.says(&line), "{line}");
        }
    }
}
