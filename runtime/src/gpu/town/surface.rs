//! What a town is made of, on the card: walls and windows, ground, lamps with what each of them reaches.

use super::{RAY_SLOTS, TownGroup};
use crate::error::RuntimeError;
use crate::gpu::binding::Slot;
use crate::gpu::memory::Held;
use crate::gpu::rain::plain;
use crate::gpu::{Gpu, LARGEST_BINDING};
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
        pad: u32,
    }
}

/// `MAPS_ACROSS` of lamp_reach.wgsl, maps of lamps that lie side by side in their texture; and the most rows of them, within WebGPU's 8192 texels.
pub const MAPS_ACROSS: usize = 128;
/// Blocks whose numbers fit beside the wall's and the kind in what is kept of a pixel.
const MOST_BLOCKS: usize = 1 << 24;

/// Refuses a town that doesn't fit WebGPU's default limits; asked before anything of it goes to the card.
///
/// Errors: the first of its parts that there are too many of.
pub fn check(town: &Town) -> Result<(), RuntimeError> {
    let room = |size: usize| LARGEST_BINDING as usize / size;
    let [blocks, heights, roads] = town.counts();
    let parts = [
        ("blocks", blocks, room(size_of::<TownWall>()).min(MOST_BLOCKS)),
        ("nodes of the height map", heights, room(size_of::<f32>())),
        ("roads", roads, room(size_of::<TownPart>()) / 2),
        ("lamps", town.lamps().len(), MAPS_ACROSS * MAPS_ACROSS),
    ];
    match parts.into_iter().find(|(_, count, most)| count > most) {
        Some((part, count, most)) => Err(RuntimeError::Device {
            wanted: format!("a town of at most {most} {part}"),
            found: count.to_string(),
        }),
        None => Ok(()),
    }
}

/// Everything that a town's picture asks of it: group 1 of its passes.
pub struct TownSurfaces {
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
    _ground: Held<wgpu::Buffer>,
    _lists: [Held<wgpu::Buffer>; 2],
}

impl TownSurfaces {
    /// Of `town`, whose rays are `rays`.
    ///
    /// Errors: a town that doesn't fit WebGPU's default limits.
    pub fn new(gpu: &Gpu, rays: &TownGroup, town: &Town) -> Result<Self, RuntimeError> {
        check(town)?;
        let materials = town.materials();
        let ground = gpu.uniform::<TownGround>("ground");
        gpu.write(&ground, &[materials.ground]);
        let lists = [gpu.list("walls", materials.walls), gpu.list("roads and lamps", materials.parts)];
        let own = [Slot::Uniform, Slot::Read, Slot::Read];
        let layout = gpu.layout("town's surfaces", &[&RAY_SLOTS[..], &own].concat());
        let [nodes, boxes, heights] = rays.lists.each_ref().map(|list| list.as_entire_binding());
        let [walls, parts] = lists.each_ref().map(|list| list.as_entire_binding());
        let resources = [
            rays.place.as_entire_binding(),
            nodes,
            boxes,
            heights,
            rays.reach.binding(),
            ground.as_entire_binding(),
            walls,
            parts,
        ];
        let group = gpu.group("town's surfaces", &layout, &resources);
        Ok(Self { layout, group, _ground: ground, _lists: lists })
    }
}
