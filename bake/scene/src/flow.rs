//! Where water stands and where it runs: depressions filled from their rims \[barnes\], areas gathered downhill.

use crate::Progress;
use crate::error::SceneError;
use crate::heights::{Grid, Heights};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A cell without a lower neighbour of its own: water leaves the map there, or through a drain.
pub const AWAY: u32 = u32::MAX;

/// The ground under full puddles.
#[derive(Clone, Debug, PartialEq)]
pub struct Flooded {
    /// Where the cells are.
    pub grid: Grid,
    /// Height of ground or water, m; NaN where there is nothing.
    pub level: Vec<f32>,
    /// Depth of standing water, m, 0 on dry ground and where there is nothing.
    pub depth_m: Vec<f32>,
    /// The cell that a cell's water runs to, or [`AWAY`].
    pub to: Vec<u32>,
    /// Cells in the order in which water reaches them from below: none runs to a later one.
    pub order: Vec<u32>,
    /// Cells that a drain was put into, as what surrounds them would stand deeper than is allowed.
    pub drains: Vec<u32>,
}

/// A cell at the rim of what is flooded; the lowest comes first, then the one that came first.
#[derive(PartialEq)]
struct Rim {
    level: f32,
    number: u32,
    cell: u32,
}

impl Eq for Rim {}

impl Ord for Rim {
    fn cmp(&self, other: &Self) -> Ordering {
        other.level.total_cmp(&self.level).then(other.number.cmp(&self.number))
    }
}

impl PartialOrd for Rim {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Eight neighbours, and the distance to each in cells.
const AROUND: [(isize, isize, f32); 8] = [
    (1, 0, 1.0),
    (0, 1, 1.0),
    (-1, 0, 1.0),
    (0, -1, 1.0),
    (1, 1, std::f32::consts::SQRT_2),
    (-1, 1, std::f32::consts::SQRT_2),
    (-1, -1, std::f32::consts::SQRT_2),
    (1, -1, std::f32::consts::SQRT_2),
];

impl Grid {
    /// Neighbours of a cell, and the distance to each in cells.
    fn around(&self, cell: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let (x, y) = ((cell % self.size[0]) as isize, (cell / self.size[0]) as isize);
        AROUND.iter().filter_map(move |&(dx, dy, far)| {
            let (x, y) = (x + dx, y + dy);
            let inside = x >= 0 && y >= 0 && (x as usize) < self.size[0] && (y as usize) < self.size[1];
            inside.then(|| (y as usize * self.size[0] + x as usize, far))
        })
    }
}

/// Slope beyond which the ground is a wall: some 76°.
const CLIFF: f32 = 4.0;
/// Rounds of putting drains into what would stand too deep. Each puts one into every such water.
const MOST_ROUNDS: usize = 24;
/// Shallower water than this is none, m: rounding of heights, and less than wets a road.
const LEAST_DEPTH_M: f32 = 2e-4;

/// Fills every depression to its rim. Water leaves over the map's edge and where there is no ground. What would stand deeper than
/// `deepest_m` has a drain at its lowest cell, as yards and basements have, and is filled without: it may leave shallower puddles.
///
/// Errors: an interruption. Work is at most 25 fillings of the map.
pub fn bake_flooded(
    heights: &Heights,
    deepest_m: f32,
    progress: &dyn Progress,
) -> Result<Flooded, SceneError> {
    let mut drains: Vec<u32> = Vec::new();
    let mut flooded = flood(heights, &drains, progress)?;
    for _ in 0..MOST_ROUNDS {
        let more = too_deep(&flooded, deepest_m);
        if more.is_empty() {
            break;
        }
        drains.extend(more);
        flooded = flood(heights, &drains, progress)?;
    }
    for depth in &mut flooded.depth_m {
        *depth = if *depth < LEAST_DEPTH_M { 0.0 } else { depth.min(deepest_m) };
    }
    flooded.drains = drains;
    Ok(flooded)
}

/// Cells between two looks at whether somebody wants to stop.
const CELLS_A_LOOK: usize = 1 << 16;

fn flood(heights: &Heights, drains: &[u32], progress: &dyn Progress) -> Result<Flooded, SceneError> {
    progress.check()?;
    let (grid, ground) = (heights.grid, &heights.middle);
    let cells = grid.cells();
    let (mut level, mut to) = (vec![f32::NAN; cells], vec![AWAY; cells]);
    let mut order = Vec::with_capacity(cells);
    let mut rim = BinaryHeap::new();
    let mut number = 0;
    let mut put = |rim: &mut BinaryHeap<Rim>, level: f32, cell: usize| {
        rim.push(Rim { level, number, cell: cell as u32 });
        number += 1;
    };
    let [width, height] = grid.size;
    for cell in 0..cells {
        let (x, y) = (cell % width, cell / width);
        let outer = x == 0 || y == 0 || x + 1 == width || y + 1 == height;
        let open = outer || grid.around(cell).any(|(next, _)| ground[next].is_nan());
        if open && !ground[cell].is_nan() {
            level[cell] = ground[cell];
            put(&mut rim, level[cell], cell);
        }
    }
    for &cell in drains {
        if level[cell as usize].is_nan() {
            level[cell as usize] = ground[cell as usize];
            put(&mut rim, ground[cell as usize], cell as usize);
        }
    }
    while let Some(Rim { cell, .. }) = rim.pop() {
        order.push(cell);
        if order.len() % CELLS_A_LOOK == 0 {
            progress.check()?;
        }
        let here = level[cell as usize];
        for (next, _) in grid.around(cell as usize) {
            if level[next].is_nan() && !ground[next].is_nan() {
                level[next] = ground[next].max(here);
                to[next] = cell;
                put(&mut rim, level[next], next);
            }
        }
    }
    // Where the ground falls, water takes the steepest way rather than the one by which the cell was found. So does what the map's
    // edge would let go. It runs down a roof rather than over the wall beside it.
    let cliff = CLIFF * grid.cell_m as f32;
    let drained = marked(drains, cells);
    for cell in (0..cells).filter(|cell| !drained[*cell]) {
        if cell % CELLS_A_LOOK == 0 {
            progress.check()?;
        }
        let falls = grid.around(cell).map(|(next, far)| ((level[cell] - level[next]) / far, next));
        let steepest = falls
            .filter(|(fall, _)| *fall > 0.0)
            .max_by(|a, b| (a.0 <= cliff).cmp(&(b.0 <= cliff)).then(a.0.total_cmp(&b.0)).then(b.1.cmp(&a.1)));
        if let Some((_, next)) = steepest {
            to[cell] = next as u32;
        }
    }
    let depth = |(level, ground): (&f32, &f32)| if level > ground { level - ground } else { 0.0 };
    let depth_m = level.iter().zip(ground).map(depth).collect();
    Ok(Flooded { grid, level, depth_m, to, order, drains: Vec::new() })
}

/// Which of so many cells are listed.
pub(crate) fn marked(listed: &[u32], cells: usize) -> Vec<bool> {
    let mut marks = vec![false; cells];
    listed.iter().for_each(|cell| marks[*cell as usize] = true);
    marks
}

/// The lowest cell of every water that is deeper than allowed.
fn too_deep(flooded: &Flooded, deepest_m: f32) -> Vec<u32> {
    let mut seen = vec![false; flooded.depth_m.len()];
    let (mut found, mut stack) = (Vec::new(), Vec::new());
    for start in 0..seen.len() {
        if seen[start] || flooded.depth_m[start] <= 0.0 {
            continue;
        }
        let mut lowest = start;
        seen[start] = true;
        stack.push(start);
        while let Some(cell) = stack.pop() {
            if flooded.depth_m[cell] > flooded.depth_m[lowest] {
                lowest = cell;
            }
            for (next, _) in flooded.grid.around(cell) {
                if !seen[next] && flooded.depth_m[next] > 0.0 {
                    seen[next] = true;
                    stack.push(next);
                }
            }
        }
        if flooded.depth_m[lowest] > deepest_m {
            found.push(lowest as u32);
        }
    }
    found
}

/// Area that drains through each cell, its own included, m².
pub fn gathered_m2(flooded: &Flooded) -> Vec<f64> {
    let own = flooded.grid.cell_m * flooded.grid.cell_m;
    let mut area = vec![0.0; flooded.to.len()];
    for &cell in flooded.order.iter().rev() {
        area[cell as usize] += own;
        if flooded.to[cell as usize] != AWAY {
            area[flooded.to[cell as usize] as usize] += area[cell as usize];
        }
    }
    area
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quiet;
    use crate::testing::StopsAfter;
    use glam::DVec2;

    fn heights(side: usize, cell_m: f64, ground: impl Fn(DVec2) -> f64) -> Heights {
        let half = 0.5 * cell_m * side as f64;
        let grid = Grid::over(DVec2::splat(-half), DVec2::splat(half), cell_m).unwrap();
        let at = |cell: usize| ground(grid.middle(cell % side, cell / side)) as f32;
        let middle: Vec<f32> = (0..side * side).map(at).collect();
        Heights { grid, highest: middle.clone(), middle }
    }

    /// Single precision at heights of some metres.
    const ROUND_OFF: f32 = 1e-6;

    #[test]
    fn a_bowl_fills_to_its_rim() {
        // A paraboloid 1 m across and 8 cm deep in flat ground.
        let bowl = |at: DVec2| (0.32 * at.length_squared() - 0.08).min(0.0);
        let found = bake_flooded(&heights(60, 0.04, bowl), 1.0, &Quiet).unwrap();
        for (cell, depth) in found.depth_m.iter().enumerate() {
            let deep = -bowl(found.grid.middle(cell % 60, cell / 60)) as f32;
            let wanted = if deep < LEAST_DEPTH_M { 0.0 } else { deep };
            assert!((depth - wanted).abs() < ROUND_OFF, "{depth} {wanted}");
        }
        // The volume is half of the cylinder's around it: π r² h / 2 with r = ½.
        let volume: f64 = found.depth_m.iter().map(|d| f64::from(*d)).sum::<f64>() * 0.04 * 0.04;
        let wanted = std::f64::consts::PI * 0.25 * 0.08 * 0.5;
        assert!((volume / wanted - 1.0).abs() < 0.01, "{volume} {wanted}");
    }

    #[test]
    fn a_bowl_with_a_notch_fills_to_the_notch() {
        let notched = |at: DVec2| {
            let ground = (0.32 * at.length_squared() - 0.08).min(0.0);
            if at.y.abs() < 0.05 && at.x > 0.0 { ground.min(-0.03) } else { ground }
        };
        let found = bake_flooded(&heights(60, 0.04, notched), 1.0, &Quiet).unwrap();
        let deepest = found.depth_m.iter().copied().fold(0.0, f32::max);
        let bottom = 0.32 * 2.0 * 0.02 * 0.02;
        assert!((deepest - (0.05 - bottom as f32)).abs() < ROUND_OFF, "{deepest}");
    }

    #[test]
    fn a_plane_holds_no_water_and_all_of_it_drains_over_its_lower_edge() {
        let slope = heights(40, 0.25, |at| 1.0 - 0.02 * at.y);
        let found = bake_flooded(&slope, 1.0, &Quiet).unwrap();
        assert!(found.depth_m.iter().all(|depth| *depth == 0.0));
        let area = gathered_m2(&found);
        for x in 0..40 {
            assert!((area[39 * 40 + x] - 0.25 * 10.0).abs() < 1e-9, "{}", area[39 * 40 + x]);
        }
        let away: f64 = (0..1600).filter(|cell| found.to[*cell] == AWAY).map(|cell| area[cell]).sum();
        assert!((away - 100.0).abs() < 1e-9, "{away}");
    }

    #[test]
    fn a_yard_between_walls_has_a_drain_and_keeps_the_puddle_beside_it() {
        // Walls of 5 m around a floor that falls to one side, with a hollow of 3 cm in it.
        let yard = |at: DVec2| {
            if at.abs().max_element() > 3.0 {
                return 5.0;
            }
            let hollow = (0.03 - 0.3 * (at - DVec2::new(1.0, 1.0)).length_squared()).max(0.0);
            0.01 * at.x - hollow
        };
        let found = bake_flooded(&heights(80, 0.1, yard), 0.3, &Quiet).unwrap();
        assert!(!found.drains.is_empty());
        let deepest = found.depth_m.iter().copied().fold(0.0, f32::max);
        assert!((0.02..=0.03).contains(&deepest), "{deepest}");
        let wet = found.depth_m.iter().filter(|depth| **depth > 0.0).count();
        assert!((10..60).contains(&wet), "{wet} cells");
    }

    #[test]
    fn many_yards_have_a_drain_each_and_filling_stops_when_it_is_told_to() {
        // A chessboard of pits 1 m deep: some 20 000 drains on 2¹⁶ cells and more.
        let side = 300;
        let pits = |at: DVec2| {
            let (x, y) = ((at.x + 150.0) as usize, (at.y + 150.0) as usize);
            if x % 2 == 1 && y % 2 == 1 { -1.0 } else { 0.0 }
        };
        let ground = heights(side, 1.0, pits);
        let found = bake_flooded(&ground, 0.3, &Quiet).unwrap();
        assert_eq!(found.drains.len(), 149 * 149);
        assert!(found.depth_m.iter().all(|depth| *depth == 0.0));
        // One look before each filling, then one within it.
        for looks in [0, 1] {
            let stopped = bake_flooded(&ground, 0.3, &StopsAfter::new(looks));
            assert_eq!(stopped.unwrap_err(), SceneError::Interrupted, "{looks}");
        }
    }
}
