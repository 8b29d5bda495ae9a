//! The shape of a grid; the one place that turns x, y, z into an index.

use serde::{Deserialize, Serialize};

/// Number of cells along x, y and z. Arrays run x fastest, then y, then z.
///
/// ```
/// use squall_formats::GridShape;
///
/// let shape = GridShape::new(4, 3, 2);
/// assert_eq!(shape.len(), 24);
/// assert_eq!(shape.index(1, 2, 1), 1 + 4 * (2 + 3 * 1));
/// assert_eq!(shape.cell(21), [1, 2, 1]);
/// assert_eq!(GridShape::new(4, 0, 2).checked_len(), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct GridShape {
    /// Cells along x.
    pub nx: u32,
    /// Cells along y.
    pub ny: u32,
    /// Cells along z.
    pub nz: u32,
}

impl GridShape {
    /// A shape from its three counts.
    pub const fn new(nx: u32, ny: u32, nz: u32) -> Self {
        Self { nx, ny, nz }
    }

    /// Number of cells, or `None` when any count is zero or the product exceeds `u32::MAX`.
    pub fn checked_len(&self) -> Option<usize> {
        let cells = self.nx.checked_mul(self.ny)?.checked_mul(self.nz)?;
        (cells > 0).then_some(cells as usize)
    }

    /// Number of cells. Shapes that come from outside go through [`GridShape::checked_len`] first.
    pub fn len(&self) -> usize {
        self.nx as usize * self.ny as usize * self.nz as usize
    }

    /// Whether any count is zero.
    pub fn is_empty(&self) -> bool {
        self.nx == 0 || self.ny == 0 || self.nz == 0
    }

    /// Distance in the array between neighbours along y.
    pub fn row_stride(&self) -> usize {
        self.nx as usize
    }

    /// Distance in the array between neighbours along z.
    pub fn slab_stride(&self) -> usize {
        self.nx as usize * self.ny as usize
    }

    /// Index of cell (x, y, z); each must be below its count.
    pub fn index(&self, x: usize, y: usize, z: usize) -> usize {
        debug_assert!(x < self.nx as usize && y < self.ny as usize && z < self.nz as usize);
        x + self.row_stride() * (y + self.ny as usize * z)
    }

    /// Cell (x, y, z) of an index; the inverse of [`GridShape::index`].
    pub fn cell(&self, index: usize) -> [usize; 3] {
        let x = index % self.nx as usize;
        let rest = index / self.nx as usize;
        [x, rest % self.ny as usize, rest / self.ny as usize]
    }

    /// The counts as an array, in x, y, z order.
    pub fn to_array(&self) -> [usize; 3] {
        [self.nx as usize, self.ny as usize, self.nz as usize]
    }

    /// The shape with every cell cut in `factors` along each axis; `None` on overflow or a zero factor.
    pub fn refined(&self, factors: [u32; 3]) -> Option<Self> {
        let shape = Self::new(
            self.nx.checked_mul(factors[0])?,
            self.ny.checked_mul(factors[1])?,
            self.nz.checked_mul(factors[2])?,
        );
        shape.checked_len().map(|_| shape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn index_and_cell_are_inverses_with_x_fastest() {
        let shape = GridShape::new(5, 3, 2);
        assert_eq!(shape.index(1, 0, 0), 1);
        assert_eq!(shape.index(0, 1, 0), 5);
        assert_eq!(shape.index(0, 0, 1), 15);
        for index in 0..shape.len() {
            let [x, y, z] = shape.cell(index);
            assert_eq!(shape.index(x, y, z), index);
        }
    }

    #[test]
    fn a_shape_too_large_to_index_has_no_length() {
        assert_eq!(GridShape::new(u32::MAX, 2, 1).checked_len(), None);
        assert_eq!(GridShape::new(4, 0, 4).checked_len(), None);
        assert_eq!(GridShape::new(4, 4, 4).checked_len(), Some(64));
    }
}
