//! What lamps reach as a graphics card reads it.

use super::{NO_BLOCK, SIDE};
use crate::gpu::town::surface::MAPS_ACROSS;
use crate::shade::town::Town;

impl Town {
    /// Maps of all lamps side by side: metres as bits and the box's number in the tree's order; then the texture's size.
    pub(in crate::shade::town) fn lamp_texels(&self) -> (Vec<[u32; 2]>, [u32; 2]) {
        let across = self.lamps.len().clamp(1, MAPS_ACROSS);
        let down = self.lamps.len().div_ceil(across).max(1);
        let mut in_tree = vec![NO_BLOCK; self.blocks.len()];
        for (place, &block) in self.boxes.order().iter().enumerate() {
            in_tree[block as usize] = place as u32;
        }
        let width = across * SIDE;
        let mut texels = vec![[f32::MAX.to_bits(), NO_BLOCK]; width * down * SIDE];
        for number in 0..self.lamps.len() {
            let reach = self.traced(number);
            let corner = (number / across) * SIDE * width + (number % across) * SIDE;
            for i in 0..SIDE * SIDE {
                let texel = reach.texel(self, [i % SIDE, i / SIDE]);
                let block = in_tree.get(texel.block as usize).copied().unwrap_or(NO_BLOCK);
                texels[corner + i / SIDE * width + i % SIDE] = [texel.metres.to_bits(), block];
            }
        }
        (texels, [width as u32, (down * SIDE) as u32])
    }
}
