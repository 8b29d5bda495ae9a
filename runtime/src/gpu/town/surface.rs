//! What a town is made of, on the card: walls and windows, ground, lamps with what each of them reaches.

use super::{RAY_SLOTS, TownGroup};
use crate::error::RuntimeError;
use crate::gpu::Gpu;
use crate::gpu::binding::Slot;
use crate::gpu::memory::{Held, Image};
use crate::gpu::rain::plain;
use crate::shade::town::Town;

plain! {
    /// `TownWall` of town_surface.wgsl.
    TownWall {
        albedo: [f32; 3],
        glass: f32,
        radiance: [f32; 3],
        seed: u32,
        pitch: [f32; 2],
        lit: f32,
        pad: f32,
        counts: [f32; 4],
    }
}
plain! {
    /// `TownPart` of town_surface.wgsl: a road or a lamp.
    TownPart { a: [f32; 4], b: [f32; 4], c: [f32; 4] }
}
plain! {
    /// `TownGround` of town_surface.wgsl.
    TownGround {
        albedo: [f32; 3],
        wetness: f32,
        shores: [f32; 2],
        puddle_size: f32,
        ripple: f32,
        seed: u32,
        roads: u32,
        lamps: u32,
        maps_across: u32,
    }
}

/// Maps of lamps that lie side by side in their texture; and the most rows of them, within WebGPU's 8192 texels.
pub const MAPS_ACROSS: usize = 128;

/// Everything that a town's picture asks of it: group 1 of its passes.
pub struct TownSurfaces {
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
    _ground: Held<wgpu::Buffer>,
    _lists: [Held<wgpu::Buffer>; 2],
    _reach: Image,
}

impl TownSurfaces {
    /// Of `town`, whose rays are `rays`.
    ///
    /// Errors: more lamps than one texture holds maps of.
    pub fn new(gpu: &Gpu, rays: &TownGroup, town: &Town) -> Result<Self, RuntimeError> {
        let lamps = town.lamps().len();
        let most = MAPS_ACROSS * MAPS_ACROSS;
        if lamps > most {
            let wanted = format!("a town of at most {most} lamps");
            return Err(RuntimeError::Device { wanted, found: lamps.to_string() });
        }
        let materials = town.materials();
        let ground = gpu.uniform::<TownGround>("ground");
        gpu.write(&ground, &[materials.ground]);
        let lists = [gpu.list("walls", materials.walls), gpu.list("roads and lamps", materials.parts)];
        let format = wgpu::TextureFormat::Rg32Uint;
        let kind = (wgpu::TextureDimension::D2, format);
        let [width, height] = materials.reach_size;
        let reach = gpu.texture("what lamps reach", [width, height, 1], kind, wgpu::TextureUsages::empty());
        if !materials.reach.is_empty() {
            gpu.fill(&reach, &materials.reach);
        }
        let own = [Slot::Uniform, Slot::Read, Slot::Read, Slot::Whole];
        let layout = gpu.layout("town's surfaces", &[RAY_SLOTS, own].concat());
        let [nodes, boxes, heights] = rays.lists.each_ref().map(|list| list.as_entire_binding());
        let [walls, parts] = lists.each_ref().map(|list| list.as_entire_binding());
        let resources = [
            rays.place.as_entire_binding(),
            nodes,
            boxes,
            heights,
            ground.as_entire_binding(),
            walls,
            parts,
            wgpu::BindingResource::TextureView(&reach.view),
        ];
        let group = gpu.group("town's surfaces", &layout, &resources);
        Ok(Self { layout, group, _ground: ground, _lists: lists, _reach: reach })
    }
}
