//! Rain under roofs: where along the rays of one eye it does not fall, so that the medium is left out there as drops are.
//!
//! A drop falls along a line that wind leans. On each such line there is one height below which it is dry: the top of the highest thing
//! on it. Over the ground that rain comes down on as if it fell upright, rays of the eye stay rays, and those heights are a relief: a
//! point of a ray is dry where it lies below the relief. The relief is asked for along spokes around the eye, eight pixels apart, at
//! nodes that stand farther apart the farther they are, each when a ray first needs it; a ray takes the two spokes beside it. What a ray costs
//! does not depend on what covers it: one look at a table where nothing is dry before its end, a walk over the nodes where something is.
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | v | how drops fall, the mean over what they cover | m/s |
//! | r | distance over the ground from the eye, leaned against the fall | m |
//! | H | height over the eye below which it is dry | m |

use super::cover::Covers;
use super::field::RainPath;
use super::shelter::Shelter;
use crate::camera::{Camera, Ray};
use glam::{DVec2, DVec3, Vec3};
use std::sync::OnceLock;

/// Pixels between spokes in the middle of a picture, and the fewest and most spokes around the eye.
const SPACING_PX: f64 = 8.0;
const SPOKES: [f64; 2] = [256.0, 4096.0];
/// Nodes between one distance and about twice as far; the first stand half a metre apart, the last one 65 km from the eye.
const PER_OCTAVE: usize = 16;
const OCTAVES: usize = 13;
const NODES: usize = PER_OCTAVE * OCTAVES;
const FIRST_M: f64 = 8.0;
/// Steepest ray that a relief is asked for, metres up for one over the ground.
const STEEPEST: f64 = 50.0;
/// Most dry stretches of a ray that are told apart; what lies beyond them counts as rained on.
const STRETCHES: usize = 8;

/// A [`RainPath`] under covers, before one camera.
pub struct CoveredRain<'a, V> {
    rain: V,
    relief: Option<Relief<'a>>,
}

/// What is dry around an eye.
struct Relief<'a> {
    covers: Covers<'a>,
    eye: DVec3,
    fall: DVec3,
    /// Metres across for a metre of height.
    lean: DVec2,
    /// Metres up for one over the ground that rays of the camera go, at least and at most.
    slopes: [f64; 2],
    spokes: Vec<OnceLock<Spoke>>,
}

/// The relief along one spoke.
struct Spoke {
    /// H from each node to the next.
    heights: Box<[f32]>,
    /// Rays as steep as this or steeper meet nothing dry up to the end of each node's stretch.
    open_from: Box<[f32]>,
}

/// Dry stretches of a ray, m, ascending.
struct Stretches {
    ends: [[f64; 2]; STRETCHES],
    count: usize,
}

/// Where a distance lies among the nodes, in whole nodes.
fn node_of(distance: f64) -> usize {
    let share = 1.0 + distance / FIRST_M;
    let bits = share.to_bits();
    let octave = (bits >> 52) as i64 - 1023;
    let within = (bits >> 48) & 15;
    // Sixteen nodes an octave are the first four bits of the mantissa.
    ((octave.max(0) as usize * PER_OCTAVE) + within as usize).min(NODES - 1)
}

/// Where a node's stretch begins, m.
fn begin_of(node: usize) -> f64 {
    let octave = (1u64 << (node / PER_OCTAVE)) as f64;
    (octave * (1.0 + (node % PER_OCTAVE) as f64 / PER_OCTAVE as f64) - 1.0) * FIRST_M
}

/// A direction over the ground as a number from 0 to 4 that grows with its azimuth.
fn turn_of(way: DVec2) -> f64 {
    let share = way.y / (way.x.abs() + way.y.abs());
    match (way.x >= 0.0, share >= 0.0) {
        (true, true) => share,
        (true, false) => 4.0 + share,
        (false, _) => 2.0 - share,
    }
}

/// The unit direction of such a number.
fn way_of(turn: f64) -> DVec2 {
    let share = turn % 4.0;
    let y = if share <= 1.0 {
        share
    } else if share <= 3.0 {
        2.0 - share
    } else {
        share - 4.0
    };
    let x = (1.0 - y.abs()) * if (1.0..3.0).contains(&share) { -1.0 } else { 1.0 };
    DVec2::new(x, y).normalize_or(DVec2::X)
}

impl<'a, V: RainPath> CoveredRain<'a, V> {
    /// Rain that `covers` keep off, as `camera` sees it; its drops fall with the mean velocity `fall`, m/s.
    pub fn new(rain: V, covers: Covers<'a>, fall: DVec3, camera: &Camera) -> Self {
        let relief = (!covers.is_empty()).then(|| Relief::new(covers, fall, camera));
        Self { rain, relief }
    }

    /// Adds up `path` over what is rained on of the stretch between two distances.
    fn over(&self, dry: &Stretches, [from, to]: [f64; 2], ray: &Ray) -> f64 {
        let (mut sum, mut here) = (0.0, from);
        for [begin, end] in &dry.ends[..dry.count] {
            if *end <= here {
                continue;
            }
            if *begin >= to {
                break;
            }
            if *begin > here {
                sum += self.rain.path(ray, here, *begin);
            }
            here = *end;
        }
        if here < to { sum + self.rain.path(ray, here, to) } else { sum }
    }

    /// [`CoveredRain::over`] of the two spokes beside a ray, each with its share.
    fn mixed(&self, dry: &[(f64, Stretches); 2], ends: [f64; 2], ray: &Ray) -> f64 {
        // No share of an endless way is endless; what is none counts as nothing.
        let part = |(share, dry): &(f64, Stretches)| {
            if *share > 0.0 { share * self.over(dry, ends, ray) } else { 0.0 }
        };
        dry.iter().map(part).sum()
    }
}

impl<'a> Relief<'a> {
    fn new(covers: Covers<'a>, fall: DVec3, camera: &Camera) -> Self {
        // What does not fall is looked at as if it fell straight down.
        let fall = if fall.z < 0.0 { fall } else { DVec3::NEG_Z };
        let lean = fall.truncate() / fall.z;
        let mut relief = Self {
            covers,
            eye: camera.position,
            fall,
            lean,
            slopes: [f64::MAX, f64::MIN],
            spokes: Vec::new(),
        };
        const SIDE: u32 = 9;
        for i in 0..SIDE * SIDE {
            let share = |at: u32, size: u32| f64::from(at) / f64::from(SIDE - 1) * f64::from(size);
            let ray = camera.ray(share(i % SIDE, camera.width), share(i / SIDE, camera.height));
            let slope = relief.slope(ray.direction).clamp(-STEEPEST, STEEPEST);
            // Between the rays of this grid slopes are steeper by less.
            let slack = 0.2 * (1.0 + slope.abs());
            relief.slopes[0] = relief.slopes[0].min(slope - slack);
            relief.slopes[1] = relief.slopes[1].max(slope + slack);
        }
        let angle = 2.0 * camera.half_extent().x / f64::from(camera.width) * SPACING_PX;
        relief.spokes.resize_with((4.0 / angle).clamp(SPOKES[0], SPOKES[1]) as usize, OnceLock::new);
        relief
    }

    /// A direction over the ground, leaned against the fall.
    fn level(&self, direction: DVec3) -> DVec2 {
        direction.truncate() - self.lean * direction.z
    }

    fn slope(&self, direction: DVec3) -> f64 {
        direction.z / self.level(direction).length().max(1e-12)
    }

    fn spoke(&self, number: usize) -> &Spoke {
        self.spokes[number].get_or_init(|| {
            let way = way_of(4.0 * number as f64 / self.spokes.len() as f64);
            let (mut heights, mut open_from) = (Vec::with_capacity(NODES), Vec::with_capacity(NODES));
            let mut steepest = f64::NEG_INFINITY;
            for node in 0..NODES {
                let [begin, end] = [begin_of(node), begin_of(node + 1)];
                let middle = 0.5 * (begin + end);
                let place = self.eye + (way * middle).extend(0.0);
                let [low, high] = self.slopes;
                let range = [(low * begin).min(low * end), (high * begin).max(high * end)];
                let lid = self.covers.lid(place, self.fall, range.map(|height| self.eye.z + height));
                let height = lid - self.eye.z;
                heights.push(height as f32);
                let slope = if height > 0.0 { height / begin } else { height / end };
                steepest = f64::max(steepest, slope);
                open_from.push(steepest as f32);
            }
            Spoke { heights: heights.into(), open_from: open_from.into() }
        })
    }

    /// The two spokes beside a direction over the ground, and the second one's share.
    fn beside(&self, way: DVec2) -> ([&Spoke; 2], f64) {
        let count = self.spokes.len();
        let turn = if way == DVec2::ZERO { 0.0 } else { turn_of(way) };
        let place = turn * 0.25 * count as f64;
        let number = place as usize;
        ([number % count, (number + 1) % count].map(|number| self.spoke(number)), place - number as f64)
    }

    /// Whether something is dry before the end of a ray of the eye.
    fn is_dry_before(&self, direction: DVec3, metres: f64) -> bool {
        let way = self.level(direction);
        let speed = way.length();
        // The stretch that a thing stands in has that thing for a cover.
        let last = node_of(metres * speed).saturating_sub(1);
        let slope = (direction.z / speed.max(1e-12)) as f32;
        let (spokes, _) = self.beside(way);
        spokes.iter().any(|spoke| slope < spoke.open_from[last])
    }

    /// Dry stretches of a ray of the eye up to a distance, by each of the two spokes beside it, with its share.
    fn dry(&self, direction: DVec3, metres: f64, found: &mut [(f64, Stretches); 2]) {
        let way = self.level(direction);
        let speed = way.length().max(1e-12);
        let (spokes, share) = self.beside(way);
        let last = node_of(metres * speed);
        for (own, spoke) in spokes.iter().enumerate() {
            let (weight, dry) = &mut found[own];
            *weight = if own == 0 { 1.0 - share } else { share };
            dry.fill(spoke, (direction.z, speed), last);
        }
    }

    /// Whether anything may be dry on rays of the eye between two that are some pixels apart, before they end after `metres`.
    fn may_be_dry(&self, ends: [DVec3; 2], metres: f64) -> bool {
        /// More than a ray between two others may be steeper or longer over the ground than both: a share, and metres a metre.
        const SLACK: f64 = 0.01;
        /// More spokes than stand between pixels of a block.
        const MOST: usize = 16;
        let ways = [self.level(ends[0]), self.level(ends[1])];
        let speeds = [ways[0].length(), ways[1].length()];
        let slope = |end: usize| ends[end].z / speeds[end].max(1e-12);
        let (low, high) = (slope(0).min(slope(1)), slope(0).max(slope(1)));
        let slope = low - SLACK * (high - low) - 1e-6 * (1.0 + low.abs());
        let last = node_of(metres * speeds[0].max(speeds[1]) * (1.0 + SLACK)).saturating_sub(1);
        let count = self.spokes.len();
        let place = |way: DVec2| {
            let turn = if way == DVec2::ZERO { 0.0 } else { turn_of(way) };
            (turn * 0.25 * count as f64) as usize % count
        };
        let (a, b) = (place(ways[0]), place(ways[1]));
        // The shorter way around, and the spoke beyond.
        let forth = (b + count - a) % count;
        let (first, steps) = if forth <= count / 2 { (a, forth) } else { (b, count - forth) };
        let is_below = |step: usize| slope < f64::from(self.spoke((first + step) % count).open_from[last]);
        steps > MOST || (0..=steps + 1).any(is_below)
    }
}

impl Stretches {
    const NONE: Self = Self { ends: [[0.0; 2]; STRETCHES], count: 0 };

    /// What of a ray that climbs and goes so much a metre is below a spoke's relief, up to node `last`.
    fn fill(&mut self, spoke: &Spoke, (climb, speed): (f64, f64), last: usize) {
        self.count = 0;
        for (node, height) in spoke.heights[..=last].iter().enumerate() {
            let height = f64::from(*height);
            if height == f64::NEG_INFINITY {
                continue;
            }
            let begin = begin_of(node) / speed;
            let end = if node + 1 < NODES { begin_of(node + 1) / speed } else { f64::INFINITY };
            // Where the ray is as high as the relief.
            let cut = if climb == 0.0 { f64::NAN } else { height / climb };
            let own = if climb > 0.0 {
                [begin, end.min(cut)]
            } else if climb < 0.0 {
                [begin.max(cut), end]
            } else if height > 0.0 {
                [begin, end]
            } else {
                continue;
            };
            // What a ray ends on stands in the last stretch, and has itself for a cover.
            let goes_on = self.count > 0 && self.ends[self.count - 1][1] >= begin;
            if own[0] < own[1] && (node < last || node == 0 || goes_on) {
                self.add(own);
            }
        }
    }

    fn add(&mut self, [begin, end]: [f64; 2]) {
        match self.ends[..self.count].last_mut() {
            Some(before) if begin <= before[1] => before[1] = before[1].max(end),
            _ if self.count < STRETCHES => {
                self.ends[self.count] = [begin, end];
                self.count += 1;
            }
            _ => {}
        }
    }
}

impl<V: RainPath> RainPath for CoveredRain<'_, V> {
    fn is_everywhere(&self) -> bool {
        self.relief.is_none() && self.rain.is_everywhere()
    }

    fn fills(&self, centre: DVec3, radius: f64) -> bool {
        self.relief.is_none() && self.rain.fills(centre, radius)
    }

    /// Of the rain without its covers: [`RainPath::is_dry_before`] tells those of each ray.
    fn filled_radius(&self, centre: DVec3) -> f64 {
        self.rain.filled_radius(centre)
    }

    fn farthest(&self) -> f64 {
        self.rain.farthest()
    }

    fn is_costly(&self) -> bool {
        self.rain.is_costly()
    }

    fn without_covers(&self) -> Option<&dyn RainPath> {
        self.relief.is_some().then_some(&self.rain)
    }

    fn is_reached(&self, place: DVec3) -> bool {
        self.relief.as_ref().is_none_or(|relief| relief.covers.reaches(place, relief.fall))
    }

    fn is_dry_before(&self, direction: Vec3, metres: f32) -> bool {
        let look = |relief: &Relief| relief.is_dry_before(direction.as_dvec3(), f64::from(metres));
        self.relief.as_ref().is_some_and(look)
    }

    fn may_be_dry(&self, ends: [Vec3; 2], metres: f32) -> bool {
        let look = |relief: &Relief| relief.may_be_dry(ends.map(|end| end.as_dvec3()), f64::from(metres));
        self.relief.as_ref().is_some_and(look)
    }

    fn path(&self, ray: &Ray, from: f64, to: f64) -> f64 {
        self.weighted(ray, &mut std::iter::once([1.0, from, to]))
    }

    fn weighted(&self, ray: &Ray, pieces: &mut dyn Iterator<Item = [f64; 3]>) -> f64 {
        let Some(relief) = self.relief.as_ref().filter(|relief| relief.eye == ray.origin) else {
            return self.rain.weighted(ray, pieces);
        };
        let mut dry = [(0.0, Stretches::NONE), (0.0, Stretches::NONE)];
        let mut known = f64::NEG_INFINITY;
        let mut sum = 0.0;
        for [factor, from, to] in pieces {
            // Pieces end no later than the ray: the first that ends farthest finds all dry stretches.
            if known < to {
                relief.dry(ray.direction, to, &mut dry);
                known = to;
            }
            if from < to {
                sum += factor * self.mixed(&dry, [from, to], ray);
            }
        }
        sum
    }
}

#[cfg(feature = "gpu")]
mod upload;
#[cfg(feature = "gpu")]
pub(crate) use upload::relief_of;

#[cfg(test)]
mod tests;
