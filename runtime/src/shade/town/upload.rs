//! A town as a graphics card traces and lights it.

use super::Town;
use crate::gpu::town::{TownBox, TownNode, TownPlace};

/// What rays meet, in flat lists.
pub struct TownTables {
    pub place: TownPlace,
    pub nodes: Vec<TownNode>,
    pub boxes: Vec<TownBox>,
    pub heights: Vec<f32>,
}

impl Town {
    /// What rays meet.
    pub(crate) fn tables(&self) -> TownTables {
        let mut place = TownPlace::default();
        let heights = self.hills.as_ref().map_or_else(Vec::new, |hills| hills.upload(&mut place).to_vec());
        let (nodes, boxes) = (self.boxes.node_list(), self.boxes.box_list());
        (place.counts[2], place.counts[3]) = (nodes.len() as u32, self.lamps.len() as u32);
        TownTables { place, nodes, boxes, heights }
    }
}
