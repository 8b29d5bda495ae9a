//! The grid at whose nodes a cloud's virtual point lights stand, and how a point light between nodes is split over them.
//!
//! Bake decides with it which nodes a stroke needs, the runtime which rows it sums and by what weights: one home, so that
//! the two cannot disagree. \[dobashi\] §5 and eq. 6. Bytes: SPEC.md, "CLRT".

use serde::{Deserialize, Serialize};

/// A node's index and its share of a point light, in [0, 1].
pub type NodeShare = (usize, f64);

/// Nodes of a rectilinear grid, x fastest, then y, then z.
///
/// ```
/// use squall_formats::light_grid::LightGrid;
///
/// let grid = LightGrid { x_m: vec![0.0, 100.0], y_m: vec![0.0, 50.0], z_m: vec![0.0, 10.0, 30.0] };
/// assert_eq!(grid.len(), 12);
/// assert_eq!(grid.position(11), [100.0, 50.0, 30.0]);
///
/// // A quarter of the way along x, on a node along y and z: two nodes have light, 3/4 and 1/4 of it.
/// let lit: Vec<(usize, f64)> =
///     grid.split([25.0, 50.0, 10.0]).unwrap().into_iter().filter(|(_, share)| *share > 0.0).collect();
/// assert_eq!(lit, [(6, 0.75), (7, 0.25)]);
/// assert_eq!(grid.nodes_around([25.0, 50.0, 10.0]), Some(vec![6, 7]));
/// assert_eq!(grid.split([25.0, 50.0, 31.0]), None);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LightGrid {
    /// Node coordinates along x, rising, m.
    pub x_m: Vec<f64>,
    /// Node coordinates along y, rising, m.
    pub y_m: Vec<f64>,
    /// Node coordinates along z, rising, m.
    pub z_m: Vec<f64>,
}

impl LightGrid {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.x_m.len() * self.y_m.len() * self.z_m.len()
    }

    /// Whether there is no node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The three axes, in the order x, y, z.
    pub fn axes(&self) -> [&[f64]; 3] {
        [&self.x_m, &self.y_m, &self.z_m]
    }

    /// Corners of the box that the nodes span, smallest then largest coordinates, m; zeros for an axis without nodes.
    pub fn bounds(&self) -> [[f64; 3]; 2] {
        let axes = self.axes();
        [
            axes.map(|axis| axis.first().copied().unwrap_or(0.0)),
            axes.map(|axis| axis.last().copied().unwrap_or(0.0)),
        ]
    }

    /// Position of node `index`, m. Panics when the grid has no such node.
    pub fn position(&self, index: usize) -> [f64; 3] {
        let (nx, ny) = (self.x_m.len(), self.y_m.len());
        [self.x_m[index % nx], self.y_m[index / nx % ny], self.z_m[index / nx / ny]]
    }

    /// The eight nodes around `point`, m, and their shares of a light there by trilinear interpolation. \[dobashi\] eq. 6.
    ///
    /// Shares are not negative and sum to 1. A node of share 0 takes no part; where an axis has one node, or the point
    /// lies on one, nodes of share 0 may repeat others. `None` outside the box of the nodes, and for what is no number.
    pub fn split(&self, point: [f64; 3]) -> Option<[NodeShare; 8]> {
        let [x, y, z] =
            [between(&self.x_m, point[0])?, between(&self.y_m, point[1])?, between(&self.z_m, point[2])?];
        let mut parts = [(0, 0.0); 8];
        for (corner, part) in parts.iter_mut().enumerate() {
            let pick = |side: usize, (low, high, share): (usize, usize, f64)| {
                if corner >> side & 1 == 0 { (low, 1.0 - share) } else { (high, share) }
            };
            let (i, a) = pick(0, x);
            let (j, b) = pick(1, y);
            let (k, c) = pick(2, z);
            *part = (i + self.x_m.len() * (j + self.y_m.len() * k), a * b * c);
        }
        Some(parts)
    }

    /// The nodes that a light at `point`, m, is split over: those of [`LightGrid::split`] with a share above 0, each once.
    pub fn nodes_around(&self, point: [f64; 3]) -> Option<Vec<usize>> {
        Some(self.split(point)?.into_iter().filter(|(_, share)| *share > 0.0).map(|(node, _)| node).collect())
    }
}

/// The interval of a rising axis that holds `value`, and how far into it; `None` outside.
fn between(axis: &[f64], value: f64) -> Option<(usize, usize, f64)> {
    let (first, last) = (*axis.first()?, *axis.last()?);
    if !(first <= value && value <= last) {
        return None;
    }
    let high =
        axis.partition_point(|&node| node <= value).clamp(1, axis.len().max(2) - 1).min(axis.len() - 1);
    let low = high.saturating_sub(1);
    if low == high {
        return Some((low, low, 0.0));
    }
    Some((low, high, (value - axis[low]) / (axis[high] - axis[low])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Round-off of eight products of three numbers up to 1.
    const ROUND_OFF: f64 = 1e-14;

    fn grid() -> LightGrid {
        LightGrid { x_m: vec![-10.0, 0.0, 5.0, 90.0], y_m: vec![7.0], z_m: vec![0.0, 300.0, 310.0] }
    }

    #[test]
    fn a_light_on_a_node_is_that_nodes_alone() {
        let grid = grid();
        for node in 0..grid.len() {
            assert_eq!(grid.nodes_around(grid.position(node)), Some(vec![node]));
        }
    }

    #[test]
    fn a_point_outside_the_box_or_no_point_is_split_over_nothing() {
        let grid = grid();
        for point in [[-10.1, 7.0, 1.0], [0.0, 7.1, 1.0], [0.0, 7.0, 311.0], [f64::NAN, 7.0, 1.0]] {
            assert_eq!(grid.split(point), None, "{point:?}");
            assert_eq!(grid.nodes_around(point), None, "{point:?}");
        }
        assert_eq!(LightGrid::default().split([0.0; 3]), None);
        assert_eq!(grid.bounds(), [[-10.0, 7.0, 0.0], [90.0, 7.0, 310.0]]);
    }

    proptest! {
        #[test]
        fn shares_sum_to_one_and_their_mean_position_is_the_point(x in -10.0..90.0, z in 0.0..310.0) {
            let (grid, point) = (grid(), [x, 7.0, z]);
            let parts = grid.split(point).unwrap();
            let sum: f64 = parts.iter().map(|(_, share)| share).sum();
            prop_assert!((sum - 1.0).abs() < ROUND_OFF);
            for axis in 0..3 {
                let mean: f64 = parts.iter().map(|&(node, share)| share * grid.position(node)[axis]).sum();
                prop_assert!((mean - point[axis]).abs() < 400.0 * ROUND_OFF);
            }
            let around = grid.nodes_around(point).unwrap();
            let mut once = around.clone();
            once.sort_unstable();
            once.dedup();
            prop_assert_eq!(once.len(), around.len());
        }
    }
}
