//! Boxes that rays of a narrow bundle may meet: a tile of a picture walks the tree once for all its rays.

use super::{BoxHit, Boxes};
use glam::Vec3;

/// Most leaves of a bundle; with more of them the tree finds a ray's box sooner.
const MOST_LEAVES: usize = 24;
/// Share by which a bundle is taken wider than it is: more than round-off.
const WIDER: f32 = 1e-5;

/// Rays from one point whose directions, times any positive number, lie between two corners of a box.
#[derive(Clone, Copy, Debug)]
pub struct Bundle {
    origin: Vec3,
    low: Vec3,
    high: Vec3,
}

impl Bundle {
    /// The rays from `origin` between these directions, all of the same length along one axis of theirs.
    pub fn new(origin: Vec3, ways: &[Vec3]) -> Self {
        let low = ways.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = ways.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let margin = Vec3::splat(WIDER * low.abs().max(high.abs()).max_element());
        Self { origin, low: low - margin, high: high + margin }
    }

    /// Whether any of its rays may meet the upright box between two corners. Where it says no, none does.
    ///
    /// A ray's coordinate after t is between those of the bundle's two ends; it is within the box's for the t of an interval, and all
    /// three intervals have to have some t in common.
    pub fn may_meet(&self, low: Vec3, high: Vec3) -> bool {
        let (low, high) = (low - self.origin, high - self.origin);
        let margin = WIDER * (low.abs().max(high.abs()) + self.origin.abs());
        let (low, high) = (low - margin, high + margin);
        let (mut enter, mut leave) = (0.0f32, f32::INFINITY);
        for axis in 0..3 {
            // t · least ≤ high and t · most ≥ low.
            for (way, limit) in [(self.low[axis], high[axis]), (-self.high[axis], -low[axis])] {
                if way > 0.0 {
                    leave = leave.min(limit / way);
                } else if way < 0.0 {
                    enter = enter.max(limit / way);
                } else if limit < 0.0 {
                    return false;
                }
            }
        }
        enter <= leave * (1.0 + WIDER)
    }
}

/// The leaves of a tree that a bundle may meet, nearest first, each with a distance that none of its boxes is nearer than.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ahead {
    leaves: Vec<(f32, u32)>,
    /// Whether there are so many that rays had better walk the tree.
    is_tree: bool,
}

impl Boxes {
    /// What rays of a bundle may meet.
    pub fn ahead(&self, bundle: &Bundle) -> Ahead {
        let (mut stack, mut leaves) = (Vec::with_capacity(48), Vec::new());
        stack.extend((!self.nodes.is_empty()).then_some(0u32));
        while let Some(number) = stack.pop() {
            let node = &self.nodes[number as usize];
            if !bundle.may_meet(node.low, node.high) {
                continue;
            }
            if node.count == 0 {
                stack.extend([node.first + 1, node.first]);
                continue;
            }
            if leaves.len() == MOST_LEAVES {
                return Ahead { leaves: Vec::new(), is_tree: true };
            }
            let nearest = bundle.origin.clamp(node.low, node.high).distance(bundle.origin);
            leaves.push((nearest * (1.0 - WIDER), number));
        }
        leaves.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Ahead { leaves, is_tree: false }
    }

    /// [`Boxes::meet`] for a ray of the bundle that `ahead` was found for.
    pub fn meet_ahead(&self, ahead: &Ahead, origin: Vec3, direction: Vec3, limit: f32) -> Option<BoxHit> {
        if ahead.is_tree {
            return self.meet(origin, direction, limit);
        }
        let (mut found, mut nearest) = (None, limit);
        for &(least, number) in &ahead.leaves {
            if least > nearest {
                break;
            }
            let node = &self.nodes[number as usize];
            for &block in &self.order[node.first as usize..(node.first + node.count) as usize] {
                if let Some((distance, normal, wall, on_wall)) =
                    self.solids[block as usize].meet(origin, direction, nearest)
                {
                    nearest = distance;
                    found = Some(BoxHit { distance, normal, block: block as usize, wall, on_wall });
                }
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use squall_formats::section::town::Block;

    #[test]
    fn a_bundle_finds_what_the_tree_finds_ray_by_ray() {
        let mut random = Random::new(8);
        let mut draw = |low: f64, high: f64| random.range(low, high) as f32;
        let blocks: Vec<Block> = (0..150)
            .map(|_| Block {
                centre: [draw(-500.0, 500.0), draw(-500.0, 500.0)],
                half: [draw(1.0, 30.0), draw(1.0, 30.0)],
                foot: draw(0.0, 5.0),
                height: draw(5.0, 150.0),
                yaw: draw(-3.0, 3.0),
                albedo: [0.3; 3],
                windows: None,
            })
            .collect();
        let boxes = Boxes::new(&blocks);
        let (mut met, mut short, mut missed) = (0, 0, 0);
        for i in 0..600 {
            let origin = Vec3::new(draw(-700.0, 700.0), draw(-700.0, 700.0), draw(0.5, 250.0));
            let aim = Vec3::new(draw(-600.0, 600.0), draw(-600.0, 600.0), draw(0.0, 200.0));
            let ahead = (aim - origin).normalize();
            let (right, up) = ahead.any_orthonormal_pair();
            let width = [0.003, 0.03, 0.3][i % 3];
            let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0f32]];
            let way = |[x, y]: [f32; 2]| ahead + (right * x + up * y) * width;
            let known = boxes.ahead(&Bundle::new(origin, &corners.map(way)));
            short += usize::from(!known.is_tree);
            missed += usize::from(!known.is_tree && known.leaves.is_empty());
            for _ in 0..20 {
                let direction = way([draw(-1.0, 1.0), draw(-1.0, 1.0)]).normalize();
                let wanted = boxes.meet(origin, direction, 1e5);
                let found = boxes.meet_ahead(&known, origin, direction, 1e5);
                assert_eq!(found.map(|hit| hit.distance), wanted.map(|hit| hit.distance));
                met += usize::from(wanted.is_some());
            }
        }
        assert!(met > 3000 && short > 300 && missed > 30, "{met} {short} {missed}");
    }
}
