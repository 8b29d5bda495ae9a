//! Which cells have light that means something, and how far each is from the cloud.

use super::Relighter;
use crate::transport::cloud::CoarseIndex;
use crate::transport::direct::distances;

impl Relighter {
    /// Steps from each of the cloud's cells to the nearest with cloud in it, of which the largest along an axis counts.
    pub(crate) fn cloud_distances(&self) -> &[u8] {
        let (shape, filled) = (self.cloud.shape, self.cloud.extinction.iter().map(|&value| value > 0.0));
        self.distances.get_or_init(|| distances(shape, filled))
    }

    /// Cells of the cloud whose light means something.
    pub fn known_cells(&self) -> Vec<bool> {
        let known = self.known_light_cells();
        let Some(blocks) = &self.blocks else { return known };
        let factors = [0, 1, 2]
            .map(|axis: usize| (self.cloud.shape.to_array()[axis] / blocks.shape.to_array()[axis]) as u32);
        let index = CoarseIndex::new(self.cloud.shape, factors);
        (0..self.cloud.shape.len()).map(|cell| known[index.of(cell)]).collect()
    }

    /// Cells of [`Relighter::light_cloud`] whose light means something.
    pub fn known_light_cells(&self) -> Vec<bool> {
        let head = &self.response.head;
        // Version 1 does not say: whoever baked may have left out what no ray shades with.
        if self.response.version == 1 {
            return self.light_cloud().shaded();
        }
        (0..head.shape.len()).map(|cell| head.sees(cell)).collect()
    }
}
