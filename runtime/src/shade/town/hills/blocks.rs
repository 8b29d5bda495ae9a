//! Which parts of hills may stand in a ray's way: the highest of 1, 2 × 2, 4 × 4, … cells.

use super::Hills;
use crate::shade::town::boxes::shadow_of_box;
use glam::{Vec2, Vec3};

/// One level: blocks of cells and the height of the highest node of each, m.
struct Level {
    counts: [usize; 2],
    tops: Vec<f32>,
}

/// Levels, from single cells to one block that holds all.
pub struct Blocks {
    levels: Vec<Level>,
}

impl Blocks {
    /// Of nodes' heights, `counts` of them along x and y, at least two.
    pub fn new(heights: &[f32], counts: [usize; 2]) -> Self {
        let cells = counts.map(|count| count - 1);
        let top = |i: usize| {
            let at = i % cells[0] + i / cells[0] * counts[0];
            heights[at].max(heights[at + 1]).max(heights[at + counts[0]]).max(heights[at + counts[0] + 1])
        };
        let mut last = Level { counts: cells, tops: (0..cells[0] * cells[1]).map(top).collect() };
        let mut levels = Vec::new();
        while last.counts != [1, 1] {
            let counts = last.counts.map(|count| count.div_ceil(2));
            let top = |i: usize| {
                let low = [2 * (i % counts[0]), 2 * (i / counts[0])];
                let high = [0, 1].map(|axis| (low[axis] + 2).min(last.counts[axis]));
                let below = (low[1]..high[1]).flat_map(|y| (low[0]..high[0]).map(move |x| [x, y]));
                below.map(|[x, y]| last.tops[y * last.counts[0] + x]).fold(0.0, f32::max)
            };
            let next = Level { counts, tops: (0..counts[0] * counts[1]).map(top).collect() };
            levels.push(std::mem::replace(&mut last, next));
        }
        levels.push(last);
        Self { levels }
    }
}

impl Hills {
    /// Whether any place of a ray (its origin, its unit direction and the unit direction towards a light) between two distances can be in
    /// the shadow of hills, taking each cell for as high as its highest node: where this says no, none is.
    pub fn may_shade(&self, ray: [Vec3; 3], between: [f32; 2]) -> bool {
        let [origin, direction, towards] = ray;
        let own = [origin + direction * between[0], direction, towards];
        self.block_may_shade(self.blocks.levels.len() - 1, [0, 0], own, between[1] - between[0])
    }

    fn block_may_shade(&self, level: usize, [x, y]: [usize; 2], ray: [Vec3; 3], length: f32) -> bool {
        let Level { counts, tops } = &self.blocks.levels[level];
        let top = tops[y * counts[0] + x];
        // Where the map is as low as what surrounds it there is no hill.
        if top == 0.0 {
            return false;
        }
        let edge = |x: usize, y: usize| {
            let cells = [x, y].map(|at| at << level);
            let cells = [cells[0].min(self.cells[0] as usize), cells[1].min(self.cells[1] as usize)];
            self.origin + self.cell * Vec2::new(cells[0] as f32, cells[1] as f32)
        };
        let corners = [edge(x, y).extend(0.0), edge(x + 1, y + 1).extend(top)];
        if shadow_of_box(ray, corners, length).is_none() {
            return false;
        }
        let Some(below) = level.checked_sub(1) else { return true };
        let counts = self.blocks.levels[below].counts;
        let parts = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[dx, dy]| [2 * x + dx, 2 * y + dy]);
        let mut parts = parts.into_iter().filter(|part| part[0] < counts[0] && part[1] < counts[1]);
        parts.any(|part| self.block_may_shade(below, part, ray, length))
    }
}
