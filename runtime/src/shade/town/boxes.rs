//! Rays against upright boxes: a tree over their bounds, built once.

pub mod beam;
mod shadow;
#[cfg(feature = "gpu")]
mod upload;

use glam::{Vec2, Vec3};
pub(super) use shadow::stretch as shadow_of_box;
use squall_formats::section::town::Block;

/// A box with its turn worked out.
struct Solid {
    centre: Vec2,
    axis: Vec2,
    half: Vec2,
    foot: f32,
    top: f32,
}

/// A ray's first meeting with a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxHit {
    /// Distance along the ray, m.
    pub distance: f32,
    /// Outward unit normal.
    pub normal: Vec3,
    /// Which block of the section.
    pub block: usize,
    /// Which wall, counter-clockwise from the box's +x; `None` on roof and underside.
    pub wall: Option<u32>,
    /// Place on the wall: along it from its right edge and above its foot, m.
    pub on_wall: Vec2,
}

struct Node {
    low: Vec3,
    high: Vec3,
    /// First of the node's solids, or of its two children when `count` is 0.
    first: u32,
    count: u32,
    /// Axis along which the first child lies below the second.
    along_y: bool,
}

impl Node {
    const NEW: Self = Self { low: Vec3::ZERO, high: Vec3::ZERO, first: 0, count: 0, along_y: false };
}

/// All boxes of a town.
pub struct Boxes {
    solids: Vec<Solid>,
    order: Vec<u32>,
    nodes: Vec<Node>,
}

const LEAF: usize = 4;

impl Solid {
    fn new(block: &Block) -> Self {
        let (sin, cos) = libm::sincosf(block.yaw);
        Self {
            centre: Vec2::from_array(block.centre),
            axis: Vec2::new(cos, sin),
            half: Vec2::from_array(block.half),
            foot: block.foot,
            top: block.foot + block.height,
        }
    }

    fn bounds(&self) -> (Vec3, Vec3) {
        let (x, y) = (self.axis.x.abs(), self.axis.y.abs());
        let half_extent = Vec2::new(x * self.half.x + y * self.half.y, y * self.half.x + x * self.half.y);
        ((self.centre - half_extent).extend(self.foot), (self.centre + half_extent).extend(self.top))
    }

    /// The world's `v` along the box's own axes.
    fn own(&self, v: Vec2) -> Vec2 {
        Vec2::new(v.dot(self.axis), v.dot(self.axis.perp()))
    }

    fn holds(&self, point: Vec3) -> bool {
        let own = self.own(point.truncate() - self.centre).abs();
        own.x <= self.half.x && own.y <= self.half.y && (self.foot..=self.top).contains(&point.z)
    }

    fn meet(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<(f32, Vec3, Option<u32>, Vec2)> {
        let start = self.own(origin.truncate() - self.centre);
        let way = self.own(direction.truncate());
        let (mut enter, mut leave, mut side) = (0.0f32, limit, None);
        let slabs = [
            (start.x, way.x, -self.half.x, self.half.x),
            (start.y, way.y, -self.half.y, self.half.y),
            (origin.z, direction.z, self.foot, self.top),
        ];
        for (axis, (at, speed, low, high)) in slabs.into_iter().enumerate() {
            if speed == 0.0 {
                if at < low || at > high {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - at) / speed, (high - at) / speed);
            let (near, far) = if a < b { (a, b) } else { (b, a) };
            if near > enter {
                (enter, side) = (near, Some((axis, speed > 0.0)));
            }
            leave = leave.min(far);
            if enter > leave {
                return None;
            }
        }
        // A ray that starts inside meets nothing: viewpoints are outside, and a wall's own light starts on it.
        let (axis, from_low) = side?;
        let sign = if from_low { -1.0 } else { 1.0 };
        let at = start + way * enter;
        let height = origin.z + direction.z * enter - self.foot;
        let (normal, wall, along) = match (axis, from_low) {
            (0, false) => (self.axis, Some(0), at.y + self.half.y),
            (1, false) => (self.axis.perp(), Some(1), self.half.x - at.x),
            (0, true) => (-self.axis, Some(2), self.half.y - at.y),
            (1, true) => (-self.axis.perp(), Some(3), at.x + self.half.x),
            _ => return Some((enter, Vec3::Z * sign, None, Vec2::ZERO)),
        };
        Some((enter, normal.extend(0.0), wall, Vec2::new(along, height)))
    }
}

impl Boxes {
    /// Builds the tree: median splits along the longest side.
    pub fn new(blocks: &[Block]) -> Self {
        let solids: Vec<Solid> = blocks.iter().map(Solid::new).collect();
        let mut order: Vec<u32> = (0..solids.len() as u32).collect();
        let mut nodes = Vec::new();
        if !solids.is_empty() {
            nodes.push(Node::NEW);
            let mut open = vec![(0usize, 0usize, solids.len())];
            while let Some((node, start, end)) = open.pop() {
                let bounds = order[start..end].iter().map(|&i| solids[i as usize].bounds());
                let (low, high) = bounds.fold((Vec3::MAX, Vec3::MIN), |(l, h), (a, b)| (l.min(a), h.max(b)));
                if end - start <= LEAF {
                    let count = (end - start) as u32;
                    nodes[node] = Node { low, high, first: start as u32, count, along_y: false };
                    continue;
                }
                let along_y = high.y - low.y > high.x - low.x;
                let key = |i: &u32| {
                    let centre = solids[*i as usize].centre;
                    if along_y { centre.y } else { centre.x }
                };
                // Equal keys keep the section's order, so that the tree is the same everywhere.
                order[start..end].sort_by(|a, b| key(a).total_cmp(&key(b)));
                let middle = start.midpoint(end);
                let children = nodes.len();
                nodes[node] = Node { low, high, first: children as u32, count: 0, along_y };
                for (child, range) in [(children, (start, middle)), (children + 1, (middle, end))] {
                    nodes.push(Node::NEW);
                    open.push((child, range.0, range.1));
                }
            }
        }
        Self { solids, order, nodes }
    }

    /// The first box along a ray, nearer than `limit` m.
    pub fn meet(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<BoxHit> {
        self.walk(origin, direction, limit, false)
    }

    /// Whether any box stands on a ray nearer than `limit` m.
    pub fn is_met(&self, origin: Vec3, direction: Vec3, limit: f32) -> bool {
        self.walk(origin, direction, limit, true).is_some()
    }

    /// The first box, or with `any` whichever is found first.
    #[inline]
    fn walk(&self, origin: Vec3, direction: Vec3, limit: f32, any: bool) -> Option<BoxHit> {
        if self.nodes.is_empty() {
            return None;
        }
        let inverse = direction.recip();
        let mut found: Option<BoxHit> = None;
        let mut nearest = limit;
        // Median splits of at most 2²⁰ blocks are at most 20 deep.
        let mut stack = [0u32; 48];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let node = &self.nodes[stack[depth] as usize];
            let (a, b) = ((node.low - origin) * inverse, (node.high - origin) * inverse);
            // A zero component gives NaN on a face, which min and max pass over.
            let near = a.x.min(b.x).max(a.y.min(b.y)).max(a.z.min(b.z)).max(0.0);
            let far = a.x.max(b.x).min(a.y.max(b.y)).min(a.z.max(b.z));
            if near > far || near > nearest {
                continue;
            }
            if node.count == 0 {
                // The child that the ray reaches first is taken from the stack first.
                let forward = if node.along_y { direction.y > 0.0 } else { direction.x > 0.0 };
                stack[depth] = node.first + u32::from(forward);
                stack[depth + 1] = node.first + u32::from(!forward);
                depth += 2;
                continue;
            }
            for &block in &self.order[node.first as usize..(node.first + node.count) as usize] {
                let met = self.solids[block as usize].meet(origin, direction, nearest);
                if let Some((distance, normal, wall, on_wall)) = met {
                    nearest = distance;
                    found = Some(BoxHit { distance, normal, block: block as usize, wall, on_wall });
                    if any {
                        return found;
                    }
                }
            }
        }
        found
    }

    /// Whether any box stands on a ray without end, the one that it starts in too.
    pub fn is_covered(&self, origin: Vec3, direction: Vec3) -> bool {
        self.is_met(origin, direction, f32::MAX) || self.holds(origin)
    }

    /// Whether a point lies in a box.
    pub(super) fn holds(&self, point: Vec3) -> bool {
        let within = |node: &Node| point.cmpge(node.low).all() && point.cmple(node.high).all();
        let (mut stack, mut depth) = ([0u32; 48], usize::from(!self.nodes.is_empty()));
        while depth > 0 {
            depth -= 1;
            let node = &self.nodes[stack[depth] as usize];
            if !within(node) {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.first;
                stack[depth + 1] = node.first + 1;
                depth += 2;
                continue;
            }
            let solids = &self.order[node.first as usize..(node.first + node.count) as usize];
            if solids.iter().any(|&solid| self.solids[solid as usize].holds(point)) {
                return true;
            }
        }
        false
    }

    /// Height of the highest roof of all, m; `None` where there is no box.
    pub fn top(&self) -> Option<f32> {
        self.nodes.first().map(|node| node.high.z)
    }

    /// Height of the highest roof over a spot, m; `None` where no box stands.
    pub fn roof(&self, spot: Vec2) -> Option<f32> {
        let above = self.meet(spot.extend(2e4), Vec3::NEG_Z, f32::MAX)?;
        Some(2e4 - above.distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Single-precision products of numbers below 1000.
    const ROUND_OFF: f32 = 1e-3;

    fn block(centre: [f32; 2], half: [f32; 2], yaw: f32, height: f32) -> Block {
        Block { centre, half, foot: 0.0, height, yaw, albedo: [0.3; 3], windows: None }
    }

    #[test]
    fn a_ray_meets_a_box_where_geometry_says() {
        let boxes = Boxes::new(&[block([100.0, 0.0], [10.0, 20.0], 0.0, 50.0)]);
        let hit = boxes.meet(Vec3::new(0.0, 5.0, 7.0), Vec3::X, 1e4).unwrap();
        assert_eq!((hit.distance, hit.normal, hit.wall), (90.0, Vec3::NEG_X, Some(2)));
        assert_eq!(hit.on_wall, Vec2::new(15.0, 7.0));
        assert!(boxes.meet(Vec3::new(0.0, 5.0, 51.0), Vec3::X, 1e4).is_none());
        assert!(boxes.meet(Vec3::new(0.0, 5.0, 7.0), Vec3::X, 80.0).is_none());
        assert!(boxes.meet(Vec3::new(0.0, 5.0, 7.0), Vec3::NEG_X, 1e4).is_none());
        assert_eq!(boxes.roof(Vec2::new(95.0, 3.0)), Some(50.0));
        assert_eq!(boxes.roof(Vec2::new(50.0, 3.0)), None);
    }

    #[test]
    fn a_box_turned_by_45_degrees_shows_its_edge() {
        let yaw = std::f32::consts::FRAC_PI_4;
        let boxes = Boxes::new(&[block([100.0, 0.0], [10.0, 10.0], yaw, 50.0)]);
        let hit = boxes.meet(Vec3::new(0.0, 0.1, 7.0), Vec3::X, 1e4).unwrap();
        assert!((hit.distance - (100.0 - 10.0 * 2f32.sqrt() + 0.1)).abs() < ROUND_OFF, "{hit:?}");
        assert!((hit.normal.x + 0.5f32.sqrt()).abs() < ROUND_OFF);
    }

    #[test]
    fn the_tree_finds_what_a_search_through_all_boxes_finds() {
        let mut random = crate::random::Random::new(4);
        let mut draw = |low: f64, high: f64| random.range(low, high) as f32;
        let blocks: Vec<Block> = (0..200)
            .map(|_| {
                block(
                    [draw(-500.0, 500.0), draw(-500.0, 500.0)],
                    [draw(2.0, 30.0), draw(2.0, 30.0)],
                    draw(-3.0, 3.0),
                    draw(5.0, 150.0),
                )
            })
            .collect();
        let boxes = Boxes::new(&blocks);
        let mut met = 0;
        for _ in 0..2000 {
            let origin = Vec3::new(draw(-900.0, 900.0), draw(-900.0, 900.0), draw(160.0, 300.0));
            let aim = Vec3::new(draw(-500.0, 500.0), draw(-500.0, 500.0), draw(0.0, 150.0));
            let direction = (aim - origin).normalize();
            let slow = boxes
                .solids
                .iter()
                .filter_map(|solid| solid.meet(origin, direction, 1e5))
                .map(|met| met.0)
                .fold(f32::MAX, f32::min);
            let fast = boxes.meet(origin, direction, 1e5).map_or(f32::MAX, |hit| hit.distance);
            assert_eq!(slow, fast);
            met += usize::from(fast < f32::MAX);
        }
        assert!(met > 500, "{met}");
    }
}
