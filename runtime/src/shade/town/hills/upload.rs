//! Hills as a graphics card reads them.

use super::Hills;
use crate::gpu::town::TownPlace;

impl Hills {
    /// Sets where they are; returns the nodes' heights, m.
    pub fn upload(&self, place: &mut TownPlace) -> &[f32] {
        place.hills = [self.origin.x, self.origin.y, self.cell.x, self.cell.y];
        (place.counts[0], place.counts[1]) = (self.cells[0] as u32, self.cells[1] as u32);
        place.top[0] = self.top;
        &self.heights
    }
}
