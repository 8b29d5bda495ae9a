//! Where virtual point lights stand: the nodes of a lightning grid. \[dobashi\] §5.

use glam::DVec3;
use squall_formats::light_grid::LightGrid;

/// The light grid of a bake: where virtual lights stand, and which of them get a row.
#[derive(Clone, Debug, PartialEq)]
pub struct WantedLights {
    /// The nodes.
    pub grid: LightGrid,
    /// Which nodes to bake, x fastest; all where empty.
    pub wanted: Vec<bool>,
}

impl WantedLights {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.grid.len()
    }

    /// Whether there is no node.
    pub fn is_empty(&self) -> bool {
        self.grid.is_empty()
    }

    /// The nodes that a point light at `point` is split over; `None` outside the grid.
    pub fn around(&self, point: DVec3) -> Option<Vec<usize>> {
        self.grid.nodes_around(point.to_array())
    }

    /// Whether node `index` is to be baked.
    pub fn is_wanted(&self, index: usize) -> bool {
        self.wanted.is_empty() || self.wanted[index]
    }

    /// Number of nodes to be baked.
    pub fn wanted_count(&self) -> usize {
        (0..self.len()).filter(|&index| self.is_wanted(index)).count()
    }

    /// Whether a point light at `point` is split over nodes that are all to be baked.
    pub fn reaches(&self, point: DVec3) -> bool {
        self.around(point).is_some_and(|nodes| nodes.iter().all(|&node| self.is_wanted(node)))
    }

    /// Position of node `index`, m.
    pub fn position(&self, index: usize) -> DVec3 {
        DVec3::from_array(self.grid.position(index))
    }
}

/// Node coordinates of a light grid over a cloud. \[dobashi\] §5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSpacing {
    /// Distance between nodes sideways and above the cloud's base, h_usr, m.
    pub base_m: f64,
    /// ε of eq. 4, 1/m²: how much 1/r² may fall from one node below the base to the next.
    pub epsilon: f64,
    /// Longest interval below the base, m. Eq. 4 alone lets it grow without end once 1/r² < ε.
    pub longest_m: f64,
}

/// Nodes over the box `low`…`high`: even steps of at most `base_m` sideways and above `base_height`; below it the longest
/// intervals that eq. 4 allows, no shorter than `base_m` and no longer than `longest_m`, down to `low.z`.
///
/// Eq. 4 as printed is singular at the base itself (r = 0) and unbounded far below; the first interval here is `base_m`.
pub fn light_grid(low: DVec3, high: DVec3, base_height: f64, spacing: LightSpacing) -> WantedLights {
    let even = |from: f64, to: f64| -> Vec<f64> {
        let count = ((to - from) / spacing.base_m - 1e-9).ceil().max(0.0) as usize;
        (0..=count).map(|i| from + (to - from) * i as f64 / count.max(1) as f64).collect()
    };
    let base = base_height.clamp(low.z, high.z);
    let mut below = Vec::new();
    let (mut r, deepest) = (0.0f64, base - low.z);
    while deepest - r > 1e-6 {
        let longest = if r == 0.0 {
            spacing.base_m
        } else {
            let left = 1.0 / (r * r) - spacing.epsilon;
            if left > 0.0 { 1.0 / left.sqrt() - r } else { f64::INFINITY }
        };
        r = (r + longest.clamp(spacing.base_m, spacing.longest_m.max(spacing.base_m))).min(deepest);
        below.push(base - r);
    }
    below.reverse();
    let mut z_m = below;
    z_m.extend(even(base, high.z));
    let grid = LightGrid { x_m: even(low.x, high.x), y_m: even(low.y, high.y), z_m };
    WantedLights { grid, wanted: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPACING: LightSpacing = LightSpacing { base_m: 100.0, epsilon: 2e-6, longest_m: 1000.0 };

    #[test]
    fn intervals_are_even_above_the_base_and_widen_below_it_within_eq_4() {
        let grid =
            light_grid(DVec3::new(0.0, 0.0, -4000.0), DVec3::new(1000.0, 500.0, 400.0), 0.0, SPACING).grid;
        assert_eq!(grid.x_m.len(), 11);
        assert_eq!(grid.y_m.len(), 6);
        assert_eq!((grid.z_m[0], *grid.z_m.last().unwrap()), (-4000.0, 400.0));
        let below: Vec<f64> = grid.z_m.iter().filter(|&&z| z <= 0.0).rev().map(|z| -z).collect();
        let steps: Vec<f64> = below.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(steps.windows(2).rev().skip(1).all(|w| w[1] >= w[0] - 1e-9), "{steps:?}");
        for (pair, step) in below.windows(2).zip(&steps) {
            let fall = 1.0 / (pair[0] * pair[0]) - 1.0 / (pair[1] * pair[1]);
            assert!(fall <= SPACING.epsilon * (1.0 + 1e-9) || *step <= SPACING.base_m + 1e-9, "{pair:?}");
            assert!(*step <= SPACING.longest_m + 1e-9);
        }
    }

    #[test]
    fn a_box_above_the_base_or_of_no_height_still_has_nodes() {
        let grid = light_grid(DVec3::new(0.0, 0.0, 100.0), DVec3::new(0.0, 0.0, 100.0), 0.0, SPACING).grid;
        assert_eq!((grid.x_m.len(), grid.y_m.len(), grid.z_m.len()), (1, 1, 1));
    }
}
