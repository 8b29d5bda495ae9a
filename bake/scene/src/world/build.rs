//! Building the hierarchy: halves by the surface area heuristic over 16 bins \[wald\], large parts on several threads.

use super::Node;
use glam::Vec3;

/// Most triangles of a leaf.
const LEAF: usize = 4;
/// Bins that a split is looked for in.
const BINS: usize = 16;
/// Below this a part is built on one thread.
const ALONE: usize = 1 << 13;
/// From this depth on parts are halved by number, so that walks stay short of [`super::STACK`].
const DEEPEST_BY_AREA: usize = 56;

/// A triangle's box while it is sorted.
#[derive(Clone, Copy)]
struct Item {
    low: Vec3,
    high: Vec3,
    index: u32,
}

impl Item {
    /// Twice the box's middle.
    fn middle(&self) -> Vec3 {
        self.low + self.high
    }
}

/// Boxes, and the triangles in their order.
pub(super) fn build(triangles: &[[Vec3; 3]]) -> (Vec<Node>, Vec<u32>) {
    let mut items: Vec<Item> = triangles
        .iter()
        .enumerate()
        .map(|(index, [a, b, c])| Item {
            low: a.min(*b).min(*c),
            high: a.max(*b).max(*c),
            index: index as u32,
        })
        .collect();
    let nodes = if items.is_empty() { Vec::new() } else { part(&mut items, 0, 0) };
    (nodes, items.iter().map(|item| item.index).collect())
}

fn part(items: &mut [Item], first: usize, depth: usize) -> Vec<Node> {
    let [low, high] = bounds(items.iter().map(|item| (item.low, item.high)));
    if items.len() <= LEAF {
        return vec![Node { low, high, link: first as u32, count: items.len() as u32 }];
    }
    let half = split(items, depth);
    let (left, right) = items.split_at_mut(half);
    let (mut before, mut behind) = if left.len() + right.len() > ALONE {
        rayon::join(|| part(left, first, depth + 1), || part(right, first + half, depth + 1))
    } else {
        (part(left, first, depth + 1), part(right, first + half, depth + 1))
    };
    let mut nodes = Vec::with_capacity(1 + before.len() + behind.len());
    nodes.push(Node { low, high, link: 1 + before.len() as u32, count: 0 });
    nodes.append(&mut before);
    nodes.append(&mut behind);
    nodes
}

fn bounds(boxes: impl Iterator<Item = (Vec3, Vec3)>) -> [Vec3; 2] {
    boxes.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], (a, b)| [low.min(a), high.max(b)])
}

fn area([low, high]: [Vec3; 2]) -> f32 {
    let side = (high - low).max(Vec3::ZERO);
    side.x * side.y + side.y * side.z + side.z * side.x
}

/// Sorts the items in two, and says where the second half begins.
fn split(items: &mut [Item], depth: usize) -> usize {
    let [low, high] = bounds(items.iter().map(|item| (item.middle(), item.middle())));
    let side = high - low;
    let axis = if side.x >= side.y && side.x >= side.z { 0 } else { usize::from(side.y < side.z) + 1 };
    let middle = items.len() / 2;
    if side[axis] > 0.0 && depth < DEEPEST_BY_AREA {
        let scale = BINS as f32 / side[axis];
        let bin = |item: &Item| (((item.middle()[axis] - low[axis]) * scale) as usize).min(BINS - 1);
        let mut boxes = [[Vec3::INFINITY, Vec3::NEG_INFINITY]; BINS];
        let mut counts = [0usize; BINS];
        for item in items.iter() {
            let bin = bin(item);
            boxes[bin] = [boxes[bin][0].min(item.low), boxes[bin][1].max(item.high)];
            counts[bin] += 1;
        }
        let (mut best, mut cheapest) = (0, f32::INFINITY);
        for cut in 1..BINS {
            let half = |bins: std::ops::Range<usize>| {
                let count: usize = counts[bins.clone()].iter().sum();
                let whole = bounds(boxes[bins].iter().map(|b| (b[0], b[1])));
                if count == 0 { None } else { Some(count as f32 * area(whole)) }
            };
            if let (Some(left), Some(right)) = (half(0..cut), half(cut..BINS))
                && left + right < cheapest
            {
                (best, cheapest) = (cut, left + right);
            }
        }
        if best > 0 {
            // The order within halves is kept, and with it the same bytes everywhere.
            let mut sorted: Vec<Item> = items.iter().filter(|item| bin(item) < best).copied().collect();
            let half = sorted.len();
            sorted.extend(items.iter().filter(|item| bin(item) >= best));
            items.copy_from_slice(&sorted);
            return half;
        }
    }
    // Middles that coincide, or a chain that is too deep: any order halves them.
    items.select_nth_unstable_by(middle, |a, b| {
        a.middle()[axis].total_cmp(&b.middle()[axis]).then(a.index.cmp(&b.index))
    });
    middle
}
