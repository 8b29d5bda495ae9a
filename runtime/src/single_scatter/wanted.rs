//! Cells that direct light is summed in: a few of a grid's, so that the many sums of a stroke's parts are short.

/// Cells whose direct light is asked for.
#[derive(Clone, Debug)]
pub(crate) struct WantedCells {
    pub(super) cells: Vec<u32>,
    pub(super) places: Vec<u32>,
}

/// No place.
const NONE: u32 = u32::MAX;

impl WantedCells {
    /// Those up to `farthest` steps from cloud, `distances` being steps to the nearest with cloud.
    pub fn new(distances: &[u8], farthest: u8) -> Self {
        let wanted = |cell: &u32| distances[*cell as usize] <= farthest;
        let cells: Vec<u32> = (0..distances.len() as u32).filter(wanted).collect();
        let mut places = vec![NONE; distances.len()];
        for (place, &cell) in cells.iter().enumerate() {
            places[cell as usize] = place as u32;
        }
        Self { cells, places }
    }

    /// The cells, rising.
    pub fn cells(&self) -> &[u32] {
        &self.cells
    }
}
