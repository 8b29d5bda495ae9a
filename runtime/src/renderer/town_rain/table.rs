//! Depths of rain that many rays of a town ask for, worked out once: from places around the eye to the sky in all directions, and to the
//! pieces of channels.
//!
//! Rain changes over the cells of its map, a hundred metres and more, and a ray through them costs as much as a thousand lookups.
//! Numbers are found when they are first asked for; each is a function of its place alone, so that it doesn't matter who asks.

use glam::{DVec3, Vec2, Vec3};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU32, Ordering};

/// Distance of the places, m, and how many there are along a side, the eye in their middle.
const CELL_M: f32 = 100.0;
const SIDE: usize = 41;
/// Directions around, and from the horizon up: those stand at squares of even steps, since depth grows with one over the rise.
const AZIMUTHS: usize = 120;
const RISES: usize = 16;
/// Highest place, above the eye's ground, that counts as on it, m: rain is thousands of metres high.
const HIGHEST_M: f32 = 12.0;
/// A number that was not asked for yet; no depth is negative.
const UNKNOWN: u32 = u32::MAX;

/// A medium's depth from a place in a unit direction over some metres, infinite to the sky.
type Depth<'a> = dyn Fn(DVec3, DVec3, f64) -> f64 + 'a;

/// The depths of one frame.
pub struct DepthTable {
    low: Vec2,
    to_sky: Vec<AtomicU32>,
    targets: Vec<Vec3>,
    numbers: HashMap<[u32; 3], usize>,
    to_target: Vec<AtomicU32>,
}

fn unknown(count: usize) -> Vec<AtomicU32> {
    (0..count).map(|_| AtomicU32::new(UNKNOWN)).collect()
}

/// A number of a table, worked out if it was not.
fn get(place: &AtomicU32, make: impl FnOnce() -> f64) -> f32 {
    let bits = place.load(Ordering::Relaxed);
    if bits != UNKNOWN {
        return f32::from_bits(bits);
    }
    let made = make() as f32;
    place.store(made.to_bits(), Ordering::Relaxed);
    made
}

impl DepthTable {
    /// An empty table around `eye`, for channels' pieces at `targets`.
    pub fn new(eye: DVec3, targets: impl Iterator<Item = Vec3>) -> Self {
        let low = eye.truncate().as_vec2() - 0.5 * (SIDE - 1) as f32 * CELL_M;
        let targets: Vec<Vec3> = targets.collect();
        let bits = |(number, target): (usize, &Vec3)| (target.to_array().map(f32::to_bits), number);
        let numbers = targets.iter().enumerate().map(bits).collect();
        let places = SIDE * SIDE;
        Self {
            low,
            to_sky: unknown(places * AZIMUTHS * RISES),
            to_target: unknown(places * targets.len()),
            targets,
            numbers,
        }
    }

    /// The four places around one, with their weights; none far from the eye.
    fn places(&self, from: Vec3) -> Option<[(usize, f32); 4]> {
        let at = (from.truncate() - self.low) / CELL_M;
        // Written so that NaN has none.
        if !(at.min_element() >= 0.0 && at.max_element() < (SIDE - 1) as f32) {
            return None;
        }
        let (x, y) = (at.x as usize, at.y as usize);
        let (u, v) = (at.x - x as f32, at.y - y as f32);
        let place = |dx: usize, dy: usize| (y + dy) * SIDE + x + dx;
        let (left, top) = (1.0 - u, 1.0 - v);
        Some([
            (place(0, 0), left * top),
            (place(1, 0), u * top),
            (place(0, 1), left * v),
            (place(1, 1), u * v),
        ])
    }

    fn place(&self, number: usize) -> DVec3 {
        let at = Vec2::new((number % SIDE) as f32, (number / SIDE) as f32);
        (self.low + at * CELL_M).extend(0.0).as_dvec3()
    }

    /// Depth from a place near the ground to the sky in a unit direction that doesn't fall; none elsewhere.
    pub fn to_sky(&self, from: Vec3, direction: Vec3, depth: &Depth<'_>) -> Option<f32> {
        if !(direction.z >= 0.0 && from.z <= HIGHEST_M) {
            return None;
        }
        let places = self.places(from)?;
        let turn = libm::atan2f(direction.y, direction.x) / std::f32::consts::TAU;
        let around = (turn - turn.floor()) * AZIMUTHS as f32;
        let up = direction.z.min(1.0).sqrt() * (RISES - 1) as f32;
        let (azimuth, rise) = (around as usize % AZIMUTHS, (up as usize).min(RISES - 2));
        let (u, v) = (around - around.floor(), up - rise as f32);
        let mut sum = 0.0;
        for (place, share) in places {
            let at = |da: usize, dr: usize| {
                let (azimuth, rise) = ((azimuth + da) % AZIMUTHS, rise + dr);
                get(&self.to_sky[(place * AZIMUTHS + azimuth) * RISES + rise], || {
                    let t = rise as f64 / (RISES - 1) as f64;
                    let (z, level) = (t * t, (1.0 - t * t * t * t).max(0.0).sqrt());
                    let (sin, cos) = libm::sincos(std::f64::consts::TAU * azimuth as f64 / AZIMUTHS as f64);
                    depth(self.place(place), DVec3::new(level * cos, level * sin, z), f64::INFINITY)
                })
            };
            let low = at(0, 0) + u * (at(1, 0) - at(0, 0));
            let high = at(0, 1) + u * (at(1, 1) - at(0, 1));
            sum += share * (low + v * (high - low));
        }
        Some(sum)
    }

    /// Depth from a place to a channel's piece; none far from the eye, or of another target.
    pub fn to_target(&self, from: Vec3, target: Vec3, depth: &Depth<'_>) -> Option<f32> {
        let number = *self.numbers.get(&target.to_array().map(f32::to_bits))?;
        let mut per_metre = 0.0;
        for (place, share) in self.places(from)? {
            // Columns of rain are upright: a way that begins higher crosses the same ones, over its own length.
            per_metre += share
                * get(&self.to_target[place * self.targets.len() + number], || {
                    let way = target.as_dvec3() - self.place(place);
                    let metres = way.length().max(1e-3);
                    depth(self.place(place), way / metres, metres) / metres
                });
        }
        Some(per_metre * from.distance(target))
    }
}

#[cfg(test)]
mod tests {
    use crate::medium::Medium;
    use crate::rain::{Ceiling, RainField, RainMap};
    use crate::random::Random;
    use crate::renderer::town_rain::TownRain;
    use crate::shade::town::rain::RainBetween;
    use crate::world::WorldLight;
    use glam::{DVec2, DVec3, Vec3};
    use squall_formats::units::Metres;

    #[test]
    fn tabulated_rain_lets_through_what_the_rain_itself_does() {
        /// Near the horizon through a cloudburst's border, between places 100 m and directions 3° apart: shares of light, the worst and in
        /// the mean.
        const WORST: f32 = 0.1;
        const MEAN: f32 = 0.002;
        let shower = |at: usize| {
            let [x, y] = [at % 40, at / 40].map(|cell| (cell as f32 * 150.0 - 2_925.0) / 1_200.0);
            60.0 * libm::expf(-(x - 1.0) * (x - 1.0) - y * y)
        };
        let rates: Vec<f32> = (0..1600).map(shower).collect();
        let top = Ceiling { height: Metres(1_500.0), softness: Metres(300.0) };
        let origin = DVec2::splat(-3_000.0);
        let map = RainMap::new(origin, Metres(150.0), [40, 40], &rates, Some(top)).unwrap();
        let eye = DVec3::new(30.0, -20.0, 2.0);
        let field = RainField::default().with_map(&map, DVec3::ZERO, eye);
        let medium = Medium::geometric(field.rate(map.heaviest()));
        let light = medium.in_scattering(&WorldLight::uniform([1.0; 3]));
        let mut random = Random::new(5);
        let mut draw = |low: f64, high: f64| random.range(low, high) as f32;
        let targets: Vec<Vec3> =
            (0..20).map(|_| Vec3::new(draw(-4e3, 4e3), draw(2e3, 6e3), draw(200.0, 3e3))).collect();
        let exact = TownRain::new(medium.clone(), field, &light);
        let quick = TownRain::new(medium, field, &light).tabulated(eye, targets.iter().copied());
        let (mut sum, mut worst, mut least) = (0.0, 0.0f32, 1.0f32);
        for i in 0..2000 {
            let from = Vec3::new(draw(-1.9e3, 1.9e3), draw(-1.9e3, 1.9e3), draw(0.0, 10.0));
            let up = draw(0.02, 1.0);
            let way = Vec3::new(draw(-1.0, 1.0), draw(-1.0, 1.0), up * up).normalize();
            let target = targets[i % 20];
            for (found, wanted) in [
                (quick.left_far(from, target), exact.left(from, target)),
                (quick.along(from, way, f32::INFINITY).0, exact.along(from, way, f32::INFINITY).0),
            ] {
                (worst, least) = (worst.max((found - wanted).abs()), least.min(wanted));
                sum += (found - wanted).abs() / 4000.0;
            }
        }
        println!("worst {worst:.4}, mean {sum:.5}, darkest {least:.3}");
        assert!(least < 0.5 && worst < WORST && sum < MEAN, "{worst} {sum} {least}");
        // Far from the eye, high up and of other lights nothing is tabulated.
        for (from, to) in [(Vec3::X * 5e3, targets[0]), (Vec3::ZERO, Vec3::Z * 900.0)] {
            assert_eq!(quick.left_far(from, to), exact.left(from, to));
        }
        let high = Vec3::Z * 50.0;
        assert_eq!(quick.along(high, Vec3::Z, f32::INFINITY), exact.along(high, Vec3::Z, f32::INFINITY));
    }
}
