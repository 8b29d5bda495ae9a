//! The airlight's table as a graphics card reads it.

use super::{Airlight, PLACES, THICKNESSES};

impl Airlight {
    /// Thicknesses along x, places along y.
    pub(crate) const SIZE: [u32; 2] = [THICKNESSES as u32, PLACES as u32];

    /// F at every node.
    pub(crate) fn texels(&self) -> Vec<[f32; 4]> {
        self.table.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect()
    }
}
