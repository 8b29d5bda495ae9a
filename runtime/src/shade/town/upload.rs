//! A town as a graphics card traces and lights it.

use super::Town;
use crate::gpu::town::surface::{TownGround, TownPart, TownWall};
use crate::gpu::town::{TownBox, TownNode, TownPlace};
use glam::Vec2;
use squall_formats::section::town::Block;

/// What rays meet, in flat lists, and what lamps reach.
#[derive(Default)]
pub struct TownTables {
    pub place: TownPlace,
    pub nodes: Vec<TownNode>,
    pub boxes: Vec<TownBox>,
    pub heights: Vec<f32>,
    /// Metres and box by direction from each lamp.
    pub reach: Vec<[u32; 2]>,
    pub reach_size: [u32; 2],
}

/// What a town is made of, in flat lists.
pub struct TownMaterials {
    pub ground: TownGround,
    /// In the tree's order.
    pub walls: Vec<TownWall>,
    /// Roads, then lamps.
    pub parts: Vec<TownPart>,
}

fn wall(block: &Block) -> TownWall {
    let mut out = TownWall { albedo: block.albedo, ..TownWall::default() };
    out.counts[3] = block.height;
    let Some(windows) = &block.windows else { return out };
    // Counted here, so that a wall that holds its windows exactly holds as many on any card.
    let count = |half: f32| {
        let size = Vec2::new(2.0 * half, block.height);
        (size / Vec2::from_array(windows.pitch)).floor()
    };
    let ([along_y, along_x], tall) = ([block.half[1], block.half[0]].map(|half| count(half).x), count(1.0).y);
    TownWall {
        glass: windows.glass,
        radiance: windows.radiance,
        seed: windows.seed,
        pitch: windows.pitch,
        lit: windows.lit,
        counts: [along_y, along_x, tall, block.height],
        ..out
    }
}

impl Town {
    /// How many blocks, nodes of the height map and roads there are.
    pub(crate) fn counts(&self) -> [usize; 3] {
        let heights = self.hills.as_ref().map_or(0, |hills| hills.upload(&mut TownPlace::default()).len());
        [self.blocks.len(), heights, self.material.roads()]
    }

    /// What it is made of.
    pub(crate) fn materials(&self) -> TownMaterials {
        let (mut ground, mut parts) = self.material.upload();
        ground.lamps = self.lamps.len() as u32;
        parts.extend(self.lamps.iter().map(|lamp| {
            let ([x, y, z], [r, g, b]) = (lamp.position, lamp.intensity);
            TownPart { a: [x, y, z, 0.0], b: [r, g, b, r + g + b], c: [0.0; 4] }
        }));
        let walls = self.boxes.order().iter().map(|&number| wall(&self.blocks[number as usize])).collect();
        TownMaterials { ground, walls, parts }
    }

    /// What rays meet.
    pub(crate) fn tables(&self) -> TownTables {
        let mut place = TownPlace::default();
        let heights = self.hills.as_ref().map_or_else(Vec::new, |hills| hills.upload(&mut place).to_vec());
        let (nodes, boxes) = (self.boxes.node_list(), self.boxes.box_list());
        (place.counts[2], place.counts[3]) = (nodes.len() as u32, self.lamps.len() as u32);
        place.top[1] = self.boxes.top().unwrap_or(0.0);
        let (reach, reach_size) = self.lamp_texels();
        TownTables { place, nodes, boxes, heights, reach, reach_size }
    }
}
