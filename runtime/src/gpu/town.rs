//! The town on the card: what rays meet, for shelter, shadows, mirrors and the first hit of every pixel; and its picture.
//!
//! Twin: `crate::shade::town`. [`passes`] draws it: what pixels see is kept while camera and town stand still; light is worked out at
//! nodes and interpolated within surfaces, as the processor does it.

pub mod light;
pub mod passes;
pub mod surface;
#[cfg(test)]
mod tests;

use super::Gpu;
use super::binding::Slot;
use super::memory::{Held, Image};
use super::rain::plain;
use crate::shade::town::Town;
use crate::shade::town::upload::TownTables;

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
    pub place: Held<wgpu::Buffer>,
    /// The tree's nodes, boxes, heights of hills.
    pub lists: [Held<wgpu::Buffer>; 3],
    /// Metres and box by direction from each lamp.
    pub reach: Image,
}

/// Slots of what rays meet.
pub const RAY_SLOTS: [Slot; 5] = [Slot::Uniform, Slot::Read, Slot::Read, Slot::Read, Slot::Whole];

impl TownGroup {
    /// Of a town, or of none: then rays meet the flat ground alone.
    pub fn new(gpu: &Gpu, town: Option<&Town>) -> Self {
        let layout = gpu.layout("town", &RAY_SLOTS);
        let place = gpu.uniform::<TownPlace>("town");
        let tables = town.map(Town::tables).unwrap_or_default();
        let TownTables { place: own, nodes, boxes, heights, reach: texels, reach_size: [across, down] } =
            tables;
        let kind = (wgpu::TextureDimension::D2, wgpu::TextureFormat::Rg32Uint);
        let reach = gpu.texture("what lamps reach", [across, down, 1], kind, wgpu::TextureUsages::empty());
        if !texels.is_empty() {
            gpu.fill(&reach, &texels);
        }
        let lists =
            [gpu.list("tree over boxes", nodes), gpu.list("boxes", boxes), gpu.list("hills", heights)];
        gpu.write(&place, &[own]);
        let [nodes, boxes, heights] = lists.each_ref().map(|list| list.as_entire_binding());
        let resources = [place.as_entire_binding(), nodes, boxes, heights, reach.binding()];
        let group = gpu.group("town", &layout, &resources);
        Self { layout, group, place, lists, reach }
    }
}

impl Gpu {
    /// A storage buffer of one value at least: a shader's array has no fewer.
    fn list<T: bytemuck::NoUninit + Default>(&self, label: &str, mut values: Vec<T>) -> Held<wgpu::Buffer> {
        if values.is_empty() {
            values.push(T::default());
        }
        self.storage(label, &values)
    }
}
