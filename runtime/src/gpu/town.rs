//! The town on the card: what rays meet, for shelter, shadows, mirrors and the first hit of every pixel.
//!
//! Twin: `crate::shade::town`.

use super::Gpu;
use super::binding::Slot;
use super::memory::Held;
use super::rain::plain;
use crate::shade::town::Town;

plain! {
    /// `TownPlace` of town_rays.wgsl.
    TownPlace { hills: [f32; 4], counts: [u32; 4], top: [f32; 4] }
}
plain! {
    /// `TownNode` of town_rays.wgsl.
    TownNode { low: [f32; 3], first: u32, high: [f32; 3], count: u32 }
}
plain! {
    /// `TownBox` of town_rays.wgsl.
    TownBox { centre: [f32; 2], axis: [f32; 2], half: [f32; 2], foot: f32, top: f32 }
}

/// What rays meet: group 1 of whatever traces.
pub struct TownGroup {
    pub layout: wgpu::BindGroupLayout,
    pub group: wgpu::BindGroup,
    _held: (Held<wgpu::Buffer>, [Held<wgpu::Buffer>; 3]),
}

impl TownGroup {
    /// Of a town, or of none: then rays meet the flat ground alone.
    pub fn new(gpu: &Gpu, town: Option<&Town>) -> Self {
        let layout = gpu.layout("town", &[Slot::Uniform, Slot::Read, Slot::Read, Slot::Read]);
        let place = gpu.uniform::<TownPlace>("town");
        let (own, lists) = match town.map(Town::tables) {
            Some(tables) => (
                tables.place,
                [
                    gpu.storage("tree over boxes", &tables.nodes),
                    gpu.storage("boxes", &tables.boxes),
                    gpu.storage("hills", &tables.heights),
                ],
            ),
            None => (
                TownPlace::default(),
                [
                    gpu.storage::<TownNode>("tree over boxes", &[]),
                    gpu.storage::<TownBox>("boxes", &[]),
                    gpu.storage::<f32>("hills", &[]),
                ],
            ),
        };
        gpu.write(&place, &[own]);
        let [nodes, boxes, heights] = lists.each_ref().map(|list| list.as_entire_binding());
        let group = gpu.group("town", &layout, &[place.as_entire_binding(), nodes, boxes, heights]);
        Self { layout, group, _held: (place, lists) }
    }
}
