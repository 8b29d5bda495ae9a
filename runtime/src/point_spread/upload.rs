//! The tables as a graphics card reads them: logarithms.

use super::{ANGLES, PointSpread, RADII, SEEN};

impl PointSpread {
    /// Angles along x and depths along y of the source and of what is seen of it.
    pub(crate) const SIZES: [[u32; 2]; 2] = [[ANGLES as u32, RADII as u32], [SEEN as u32, RADII as u32]];

    /// ln f and ln M; darkness where there is no light at all.
    pub(crate) fn texels(&self) -> [Vec<[f32; 4]>; 2] {
        let lists = [&self.source, &self.seen].into_iter().zip(Self::SIZES);
        let mut all = lists.map(|(list, [columns, rows])| {
            let mut texels: Vec<[f32; 4]> = list.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
            texels.resize((columns * rows) as usize, [super::logarithm(0.0); 4]);
            texels
        });
        [all.next().unwrap_or_default(), all.next().unwrap_or_default()]
    }
}
