//! A map of rain as a graphics card reads it.

use super::RainMap;
use glam::DVec2;

impl RainMap {
    /// Columns and rows of cells with the dry border around them, and their extinction over the heaviest rain's.
    pub(crate) fn texels(&self) -> ([u32; 2], &[f32]) {
        (self.size.map(|side| side as u32 + 2), &self.extinction)
    }

    /// Lowest corner at time 0, m; edge of a cell, m; cells along each side.
    pub(crate) fn grid(&self) -> (DVec2, f64, [u32; 2]) {
        (self.origin, self.cell, self.size.map(|side| side as u32))
    }
}
