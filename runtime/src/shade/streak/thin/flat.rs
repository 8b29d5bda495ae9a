//! The tables of thin streaks as a graphics card reads them: three products of light and the coverage's side by side, nothing padded.

use super::{BLOCK, LENGTHS, LIGHTS, PHASES, RANK, SHIFTS, Thin, WIDTHS, half_of};

/// Half of a picture, which light reaches at most.
const WHOLE: f64 = 0.5;

/// Where the tables of a width, and of a length, begin in a pattern's; the same for every pattern.
#[derive(Clone, Copy, Debug)]
pub struct TableSizes {
    /// First packet of the width's tables, and pixels on each side of its middle.
    pub across: [[u32; 2]; WIDTHS],
    /// First packet of the length's table, counted from the first of them, and its intervals.
    pub along: [[u32; 2]; LENGTHS],
}

impl Thin {
    /// How large a pattern's tables are.
    pub fn sizes(&self) -> TableSizes {
        let mut first = 0;
        let across = std::array::from_fn(|class| {
            let half = half_of(class, WHOLE) as u32;
            let own = [first, half];
            first += (SHIFTS.len() * (PHASES + 1)) as u32 * 2 * half;
            own
        });
        let mut first = 0;
        let along = std::array::from_fn(|class| {
            let count = self.along[class].len() as u32;
            let own = [first, count - 1];
            first += count;
            own
        });
        TableSizes { across, along }
    }

    /// Adds the tables across: by width, shift, node, pixel.
    pub fn add_across(&self, out: &mut Vec<[f32; RANK]>) {
        for (at, table) in self.across.iter().enumerate() {
            let class = at / SHIFTS.len();
            let half = half_of(class, WHOLE);
            // A pattern may have light in fewer pixels than others.
            let own = usize::from(self.halves[class]);
            for node in 0..=PHASES {
                let at = |k: usize, pixel: usize| {
                    (node * table.blocks * BLOCK + pixel + own - half) * table.rank + k
                };
                // A narrow width has one table for light and coverage, and no more products.
                let value = |k: usize, pixel: usize| match (k, table.rank) {
                    _ if pixel + own < half || pixel >= half + own => 0.0,
                    (0, _) | (_, RANK) => table.values[at(k, pixel)],
                    (LIGHTS, _) => table.values[at(0, pixel)],
                    _ => 0.0,
                };
                out.extend((0..2 * half).map(|pixel| std::array::from_fn(|k| value(k, pixel))));
            }
        }
    }

    /// Adds the tables along: by length, place.
    pub fn add_along(&self, out: &mut Vec<[f32; RANK]>) {
        self.along.iter().for_each(|table| out.extend(table.iter().map(|[value, _]| *value)));
    }
}
