//! Where boxes keep a distant light from a ray: exact stretches, one a box.
//!
//! A place o + d t of the ray is in a box's shadow if o + d t + s u lies in the box for some u ≥ 0, s the direction to the light. Each of
//! the box's slabs bounds u from below and from above by a line in t; that some u satisfies all of them leaves linear bounds on t
//! alone: every lower bound lies below every upper one.

use super::Boxes;
use glam::Vec3;

/// Component of a direction below which a light counts as level with a box's side.
const LEVEL: f32 = 1e-7;

/// A line c + m t.
type Bound = [f32; 2];

/// Leaves of `t` what has c + m t ≤ 0.
fn clip(t: &mut [f32; 2], [c, m]: Bound) {
    if m > 0.0 {
        t[1] = t[1].min(-c / m);
    } else if m < 0.0 {
        t[0] = t[0].max(-c / m);
    } else if c > 0.0 {
        t[1] = f32::NEG_INFINITY;
    }
}

/// The stretch of a ray up to `limit` that an upright box between two corners keeps the light from `towards` off; none where it is empty.
pub(in crate::shade::town) fn stretch(
    [start, way, towards]: [Vec3; 3],
    [low, high]: [Vec3; 2],
    limit: f32,
) -> Option<[f32; 2]> {
    let mut t = [0.0, limit];
    let (mut least, mut most) = ([[0.0f32; 2]; 4], [[0.0f32; 2]; 3]);
    let mut count = 0;
    for axis in 0..3 {
        let (from_low, from_high) = (low[axis] - start[axis], high[axis] - start[axis]);
        if towards[axis].abs() < LEVEL {
            clip(&mut t, [-from_high, way[axis]]);
            clip(&mut t, [from_low, -way[axis]]);
            continue;
        }
        let inverse = towards[axis].recip();
        let slope = -way[axis] * inverse;
        let (a, b) = (from_low * inverse, from_high * inverse);
        // The first lower bound is 0: light comes from one side.
        (least[count + 1], most[count]) = ([a.min(b), slope], [a.max(b), slope]);
        count += 1;
    }
    for [c, m] in &least[..=count] {
        for [d, n] in &most[..count] {
            clip(&mut t, [c - d, m - n]);
        }
    }
    (t[0] < t[1]).then_some(t)
}

impl Boxes {
    /// Adds the stretches of a ray from `origin` up to `limit` m, one for each box that keeps the light from unit direction `towards` off.
    pub fn add_shadows(&self, [origin, direction, towards]: [Vec3; 3], limit: f32, out: &mut Vec<[f32; 2]>) {
        let (mut stack, mut depth) = ([0u32; 48], usize::from(!self.nodes.is_empty()));
        while depth > 0 {
            depth -= 1;
            let node = &self.nodes[stack[depth] as usize];
            if stretch([origin, direction, towards], [node.low, node.high], limit).is_none() {
                continue;
            }
            if node.count == 0 {
                stack[depth] = node.first;
                stack[depth + 1] = node.first + 1;
                depth += 2;
                continue;
            }
            for &number in &self.order[node.first as usize..(node.first + node.count) as usize] {
                let solid = &self.solids[number as usize];
                let own = |v: Vec3| solid.own(v.truncate()).extend(v.z);
                let start = solid.own(origin.truncate() - solid.centre).extend(origin.z);
                let corners = [(-solid.half).extend(solid.foot), solid.half.extend(solid.top)];
                out.extend(stretch([start, own(direction), own(towards)], corners, limit));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use squall_formats::section::town::Block;

    #[test]
    fn stretches_in_shadow_are_those_that_rays_to_the_light_find() {
        /// Distance from a shadow's edge within which single precision may say either, m.
        const EDGE_M: f32 = 0.05;
        let mut random = Random::new(31);
        let mut draw = |low: f64, high: f64| random.range(low, high) as f32;
        let blocks: Vec<Block> = (0..60)
            .map(|_| Block {
                centre: [draw(-200.0, 200.0), draw(-200.0, 200.0)],
                half: [draw(2.0, 20.0), draw(2.0, 20.0)],
                foot: draw(0.0, 8.0),
                height: draw(5.0, 90.0),
                yaw: draw(-3.0, 3.0),
                albedo: [0.3; 3],
                windows: None,
            })
            .collect();
        let boxes = Boxes::new(&blocks);
        let (mut dark, mut light) = (0, 0);
        for i in 0..300 {
            let origin = Vec3::new(draw(-250.0, 250.0), draw(-250.0, 250.0), draw(0.5, 120.0));
            let direction = Vec3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(-0.3, 0.6)).normalize();
            // Now and then the light stands along a box's side, overhead, or where the ray goes.
            let towards = match i % 10 {
                0 => Vec3::Z,
                1 => direction,
                _ => Vec3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), draw(0.05, 1.0)).normalize(),
            };
            let mut found = Vec::new();
            boxes.add_shadows([origin, direction, towards], 400.0, &mut found);
            for _ in 0..40 {
                let t = draw(0.0, 400.0);
                if found.iter().flatten().any(|end| (end - t).abs() < EDGE_M) {
                    continue;
                }
                let place = origin + direction * t;
                let wanted = boxes.is_covered(place, towards);
                let is_dark = found.iter().any(|&[a, b]| (a..b).contains(&t));
                assert_eq!(is_dark, wanted, "{origin} {direction} {towards} {t}");
                dark += u32::from(wanted);
                light += u32::from(!wanted);
            }
        }
        assert!(dark > 500 && light > 3000, "{dark} {light}");
    }
}
