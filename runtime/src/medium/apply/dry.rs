//! Which pixels look at something dry: whole blocks of them are asked first.

use super::{BandMedium, FLAT, LANES, Lanes};
use crate::rain::RainPath;

impl<V: RainPath> BandMedium<'_, V> {
    /// A bit for each pixel from (x, y) on whose ray is dry somewhere before its end.
    #[inline(always)]
    pub(super) fn dry(
        &self,
        [x, y]: [usize; 2],
        (tangents, secants): (&Lanes, &Lanes),
        range: &Lanes,
    ) -> u64 {
        if !self.volume.has_covers() {
            return 0;
        }
        let down = f64::from(self.first[1] + (y as f32 + 0.5) * self.per_pixel[1]);
        let ahead = (self.camera.forward - self.camera.up * down).as_vec3();
        let right = self.camera.right.as_vec3();
        let count = LANES.min(self.camera.width as usize - x);
        let way = |i: usize| (ahead + right * tangents[i]) / secants[i];
        let mut bits = 0;
        for first in (0..count).step_by(FLAT) {
            let last = (first + FLAT).min(count) - 1;
            let farthest = range[first..=last].iter().copied().fold(0.0, f32::max);
            // Most blocks of pixels are in the open.
            if self.volume.may_be_dry([way(first), way(last)], farthest) {
                let is_dry = |i: &usize| self.volume.is_dry_before(way(*i), range[*i]);
                bits = (first..=last).filter(is_dry).fold(bits, |bits, i| bits | 1 << i);
            }
        }
        bits
    }
}
