//! The tree over boxes as a graphics card walks it: boxes lie in the tree's order.

use super::Boxes;
use crate::gpu::town::{TownBox, TownNode};

/// The bit that says that children lie along y.
const ALONG_Y: u32 = 1 << 31;

impl Boxes {
    /// The tree's nodes, the root first.
    pub fn node_list(&self) -> Vec<TownNode> {
        let node = |node: &super::Node| TownNode {
            low: node.low.to_array(),
            first: node.first,
            high: node.high.to_array(),
            count: node.count | if node.along_y { ALONG_Y } else { 0 },
        };
        self.nodes.iter().map(node).collect()
    }

    /// The boxes in the tree's order.
    pub fn box_list(&self) -> Vec<TownBox> {
        let solid = |&number: &u32| {
            let solid = &self.solids[number as usize];
            TownBox {
                centre: solid.centre.to_array(),
                axis: solid.axis.to_array(),
                half: solid.half.to_array(),
                foot: solid.foot,
                top: solid.top,
            }
        };
        self.order.iter().map(solid).collect()
    }

    /// Number in the section of each box of the tree's order.
    pub fn order(&self) -> &[u32] {
        &self.order
    }
}
