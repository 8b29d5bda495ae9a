//! Virtual lights of finer levels: where they stand, which light of coarser levels they are measured against, and which of them are solved
//! for together.

use super::schedule::BATCH;
use glam::DVec3;
use squall_formats::GridShape;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::Window;
use squall_runtime::transport::Cloud;
use std::collections::{BTreeMap, BTreeSet};

/// Longest side of a batch's box, in intervals of its level.
const WIDEST: usize = 4;
/// Reach of surplus light at a spacing of one transport mean free path's [`SPACING`]th part, in such paths, and the power of the spacing that
/// it goes with: 2000, 1250 and 750 m at 500, 250 and 125 m were measured to hold all but some per cent of it, in a cloud whose
/// transport mean free path is 553 m.
const REACH: f64 = 3.6;
const SPACING: f64 = 0.9;
const POWER: f64 = 0.7;
/// Shares of lamps below this are round-off.
const NOTHING: f64 = 1e-9;

/// Levels of virtual lights, coarse to fine, as far as they are decided.
pub(super) struct Levels {
    levels: Vec<(LightGrid, BTreeSet<usize>)>,
}

/// Lights and their intensities, W/sr, by the bits of their places.
type Lamps = BTreeMap<[u64; 3], f64>;

impl Levels {
    /// The light grid alone; `wanted` are the nodes that have rows.
    pub(super) fn new(grid: &LightGrid, wanted: impl Iterator<Item = usize>) -> Self {
        Self { levels: vec![(grid.clone(), wanted.collect())] }
    }

    /// The grid of the next level, and its nodes in and beside cloud that coarser virtual lights stand around, neighbours together.
    pub(super) fn next(&self, cloud: &Cloud) -> (LightGrid, Vec<usize>) {
        let Some((coarse, _)) = self.levels.last() else { return Default::default() };
        let [x_m, y_m, z_m] = coarse.axes().map(with_middles);
        let grid = LightGrid { x_m, y_m, z_m };
        let place = |node: usize| {
            let (nx, ny) = (grid.x_m.len(), grid.y_m.len());
            [node % nx, node / nx % ny, node / nx / ny]
        };
        let new = |&node: &usize| place(node).iter().any(|at| at % 2 == 1);
        let (first, rows) = &self.levels[0];
        let reached = |&node: &usize| {
            first
                .nodes_around(grid.position(node))
                .is_some_and(|around| around.iter().all(|node| rows.contains(node)))
        };
        let beside = |&node: &usize| {
            let at = place(node);
            let end = |axis: usize, up: bool| {
                let coordinates = grid.axes()[axis];
                let last = coordinates.len() - 1;
                coordinates[if up { (at[axis] + 1).min(last) } else { at[axis].saturating_sub(1) }]
            };
            let corner = |up: bool| DVec3::from_array([0, 1, 2].map(|axis| end(axis, up)));
            holds_cloud(cloud, corner(false), corner(true))
        };
        let mut nodes: Vec<usize> = (0..grid.len()).filter(new).filter(reached).filter(beside).collect();
        nodes.sort_by_key(|&node| interleaved(place(node)));
        (grid, nodes)
    }

    /// Takes in a level whose rows are those of `nodes`.
    pub(super) fn push(&mut self, grid: LightGrid, nodes: impl Iterator<Item = usize>) {
        self.levels.push((grid, nodes.collect()));
    }

    /// A light of 1 W/sr at `place` less what stands for it on the levels so far, as lights.
    pub(super) fn surplus(&self, place: [f64; 3]) -> Vec<(DVec3, f64)> {
        let mut lamps = Lamps::new();
        add(&mut lamps, place, 1.0);
        self.take(self.levels.len(), place, -1.0, &mut lamps);
        let strong = lamps.into_iter().filter(|(_, share)| share.abs() > NOTHING);
        strong.map(|(bits, share)| (DVec3::from_array(bits.map(f64::from_bits)), share)).collect()
    }

    /// Adds `factor` times the lights that `count` levels have for one at `place`.
    fn take(&self, count: usize, place: [f64; 3], factor: f64, lamps: &mut Lamps) {
        for (level, (grid, rows)) in self.levels[..count].iter().enumerate() {
            for (node, share) in grid.split(place).into_iter().flatten() {
                if share > 0.0 && rows.contains(&node) {
                    let own = grid.position(node);
                    add(lamps, own, factor * share);
                    if level > 0 {
                        // Its row is a surplus.
                        self.take(level, own, -factor * share, lamps);
                    }
                }
            }
        }
    }
}

fn add(lamps: &mut Lamps, place: [f64; 3], share: f64) {
    // −0 and 0 are one place.
    *lamps.entry(place.map(|v| (v + 0.0).to_bits())).or_default() += share;
}

/// An axis with the middles of its intervals.
fn with_middles(axis: &[f64]) -> Vec<f64> {
    let pairs = axis.windows(2).flat_map(|pair| [pair[0], 0.5 * (pair[0] + pair[1])]);
    pairs.chain(axis.last().copied()).collect()
}

/// Bits of three numbers in turns: what is near stands near.
fn interleaved(place: [usize; 3]) -> u64 {
    (0..21)
        .map(|bit| (0..3).map(|axis| (place[axis] as u64 >> bit & 1) << (3 * bit + axis)).sum::<u64>())
        .sum()
}

/// Cells that a box of metres touches: the first, and the one behind the last, along x, y, z; at least one.
fn cells_of(cloud: &Cloud, low: DVec3, high: DVec3) -> [[usize; 2]; 3] {
    let counts = cloud.shape.to_array();
    [0, 1, 2].map(|axis: usize| {
        let at = |metres: f64| {
            ((metres - cloud.origin_m[axis]) / cloud.cell_m[axis]).clamp(0.0, counts[axis] as f64)
        };
        let first = (at(low[axis]).floor() as usize).min(counts[axis] - 1);
        [first, (at(high[axis]).ceil() as usize).max(first + 1)]
    })
}

fn holds_cloud(cloud: &Cloud, low: DVec3, high: DVec3) -> bool {
    let [x, y, z] = cells_of(cloud, low, high);
    (z[0]..z[1]).any(|k| {
        (y[0]..y[1]).any(|j| {
            let row = cloud.shape.index(0, j, k);
            cloud.extinction[row + x[0]..row + x[1]].iter().any(|&extinction| extinction > 0.0)
        })
    })
}

/// How far surplus light of virtual lights `spacing_m` apart reaches, m.
pub(super) fn reach_m(cloud: &Cloud, spacing_m: f64) -> f64 {
    let dense = cloud.extinction.iter().filter(|&&extinction| extinction > 0.0);
    let (mut sum, mut count) = (0.0f64, 0.0f64);
    for &extinction in dense {
        sum += f64::from(extinction);
        count += 1.0;
    }
    let path = 1.0 / (sum / count.max(1.0) * (1.0 - cloud.albedo * cloud.g)).max(f64::MIN_POSITIVE);
    (REACH * path * libm::pow(spacing_m / (SPACING * path), POWER)).max(2.0 * spacing_m)
}

/// Nodes that are solved for side by side.
pub(super) struct Batch {
    pub(super) nodes: Vec<usize>,
    /// Their lights: [`Levels::surplus`].
    pub(super) lamps: Vec<Vec<(DVec3, f64)>>,
    /// Cells that their light is solved for in.
    pub(super) window: Window,
}

/// `nodes`, neighbours together, in batches whose windows reach `reach_m` beyond their nodes.
pub(super) fn batches(
    levels: &Levels,
    cloud: &Cloud,
    (grid, nodes): (&LightGrid, &[usize]),
    reach_m: f64,
) -> Vec<Batch> {
    let counts = grid.axes().map(<[f64]>::len);
    let place = |node: usize| [node % counts[0], node / counts[0] % counts[1], node / counts[0] / counts[1]];
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut extent = [[0usize; 2]; 3];
    for &node in nodes {
        let at = place(node);
        let wider =
            [0, 1, 2].map(|axis: usize| [extent[axis][0].min(at[axis]), extent[axis][1].max(at[axis])]);
        match groups.last_mut() {
            Some(group) if group.len() < BATCH && wider.iter().all(|[low, high]| high - low <= WIDEST) => {
                group.push(node);
                extent = wider;
            }
            _ => {
                groups.push(vec![node]);
                extent = at.map(|at| [at, at]);
            }
        }
    }
    let batch = |nodes: Vec<usize>| {
        let places: Vec<[f64; 3]> = nodes.iter().map(|&node| grid.position(node)).collect();
        let lamps: Vec<Vec<(DVec3, f64)>> = places.iter().map(|&place| levels.surplus(place)).collect();
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for place in places.into_iter().map(DVec3::from_array) {
            (low, high) = (low.min(place - reach_m), high.max(place + reach_m));
        }
        // Light goes straight from all of them to every cell, through cells of the window.
        for (place, _) in lamps.iter().flatten() {
            (low, high) = (low.min(*place), high.max(*place));
        }
        let cells = cells_of(cloud, low, high);
        let [nx, ny, nz] = cells.map(|[first, end]| (end - first) as u32);
        let window = Window {
            low: cells.map(|[first, _]| first as u32),
            shape: GridShape::new(nx, ny, nz),
            rows: nodes.len() as u32,
        };
        Batch { nodes, lamps, window }
    };
    groups.into_iter().map(batch).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_runtime::transport::Boundary;

    fn cloud() -> Cloud {
        let shape = GridShape::new(16, 16, 16);
        let extinction = (0..shape.len()).map(|i| if shape.cell(i)[0] < 9 { 0.02 } else { 0.0 }).collect();
        let (cell_m, origin_m) = ([50.0; 3], DVec3::ZERO);
        Cloud { shape, cell_m, origin_m, extinction, albedo: 0.99, g: 0.85, boundary: Boundary::Open }
    }

    fn levels() -> (Levels, LightGrid) {
        let axis = || vec![0.0, 200.0, 400.0, 600.0, 800.0];
        let grid = LightGrid { x_m: axis(), y_m: axis(), z_m: axis() };
        (Levels::new(&grid, 0..grid.len()), grid)
    }

    #[test]
    fn the_surplus_of_a_light_on_a_node_is_nothing_and_that_of_any_other_gives_no_light_in_sum() {
        /// Products of a few shares.
        const ROUND_OFF: f64 = 1e-12;
        let (mut levels, _) = levels();
        assert!(levels.surplus([200.0, 400.0, 0.0]).is_empty());
        let middle = levels.surplus([300.0, 400.0, 0.0]);
        assert_eq!(middle.len(), 3);
        let (grid, nodes) = levels.next(&cloud());
        levels.push(grid.clone(), nodes.iter().copied());
        assert!(nodes.iter().all(|&node| levels.surplus(grid.position(node)).is_empty()));
        for place in [[130.0, 250.0, 70.0], [300.0, 50.0, 50.0], [799.0, 3.0, 420.0]] {
            let lamps = levels.surplus(place);
            let sum: f64 = lamps.iter().map(|(_, share)| share).sum();
            assert!(sum.abs() < ROUND_OFF && lamps.len() > 1, "{sum}");
            // Nor does it move its middle.
            let moment: DVec3 = lamps.iter().map(|&(at, share)| at * share).sum();
            assert!(moment.length() < 1e3 * ROUND_OFF, "{moment}");
        }
    }

    #[test]
    fn nodes_of_the_next_level_stand_in_and_beside_cloud_and_batches_hold_each_once() {
        let (cloud, (levels, coarse)) = (cloud(), levels());
        let (grid, nodes) = levels.next(&cloud);
        assert_eq!(grid.axes().map(<[f64]>::len), [9; 3]);
        for &node in &nodes {
            let place = grid.position(node);
            assert!(place[0] < 550.0 && coarse.nodes_around(place).unwrap().len() > 1, "{place:?}");
        }
        // All but the coarse grid's own among the first six planes of nodes: those beyond touch no cloud.
        assert_eq!(nodes.len(), 6 * 81 - 3 * 25);
        let mut seen = Vec::new();
        for batch in batches(&levels, &cloud, (&grid, &nodes), 120.0) {
            assert!(batch.nodes.len() <= BATCH && batch.window.rows as usize == batch.nodes.len());
            for (node, lamps) in batch.nodes.iter().zip(&batch.lamps) {
                assert!(lamps.contains(&(DVec3::from_array(grid.position(*node)), 1.0)));
            }
            seen.extend(batch.nodes);
        }
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), nodes.len());
    }
}
