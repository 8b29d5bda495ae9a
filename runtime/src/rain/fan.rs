//! A map of rain as one eye sees it: sums along spokes over the ground, so that a frame costs the same for a map of any size.
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | θ, r | azimuth and distance over the ground, from the eye | rad, m |
//! | I(θ, r) | ∫₀ʳ e dr', e the map's extinction over that of the rain at the eye | m |
//!
//! Rain is upright in its columns, so that a ray's share of it is I between two distances, over the cosine of its elevation; a top
//! weights it by height. Spokes stand two pixels apart and are summed when a ray first asks, over the map's own cells near by and over
//! larger and larger means of them farther off, as wide as the spokes are apart. A ray takes the two spokes beside it.
//!
//! Small maps are summed exactly, ray by ray ([`RainField::path`]), and so are rays from any other point than the eye.

use super::field::{PlacedMap, RainField, RainPath};
use super::volume::RainVolume;
use crate::camera::{Camera, Ray};
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Cells along both sides of the largest map that is summed ray by ray.
const SMALL: usize = 48;
/// Fewest and most spokes around the eye.
const SPOKES: [f64; 2] = [512.0, 8192.0];
/// Nodes of a spoke between one distance and twice as far; the first stand half a cell apart.
const PER_OCTAVE: usize = 64;
/// Pieces that a soft top is cut into.
const SOFT: usize = 4;
/// A ray whose way over the ground is less than this share of its length stands upright.
const UPRIGHT: f64 = 1e-6;

/// A [`RainField`] before one camera.
#[derive(Debug)]
pub struct RainFan<'a> {
    field: RainField<'a>,
    eye: DVec3,
    /// Sums at the nodes, m of the heaviest rain; empty where the map is small or there is none.
    spokes: Vec<OnceLock<Box<[f32]>>>,
    /// Distance whose double ends the first octave of nodes, m, and how many nodes there are.
    first: f64,
    nodes: usize,
}

/// A ray over two spokes.
struct Over<'s> {
    spokes: [&'s [f32]; 2],
    /// Share of the second.
    share: f64,
    /// Metres over the ground per metre of the ray.
    speed: f64,
}

impl<'a> RainFan<'a> {
    /// The field as `camera` sees it.
    pub fn new(field: RainField<'a>, camera: &Camera) -> Self {
        let eye = camera.position;
        let mut fan = Self { field, eye, spokes: Vec::new(), first: 1.0, nodes: 0 };
        let Some(PlacedMap { map, drift, .. }) = field.map else { return fan };
        let (origin, cell, size) = map.cells();
        if size[0] + size[1] <= SMALL {
            return fan;
        }
        // Two pixels in the middle of the picture.
        let angle = 2.0 * camera.half_extent().x / f64::from(camera.width) * 2.0;
        let spokes = (TAU / angle).clamp(SPOKES[0], SPOKES[1]) as usize;
        fan.first = 0.5 * cell * PER_OCTAVE as f64;
        let middle = origin + drift + DVec2::new(size[0] as f64, size[1] as f64) * (0.5 * cell);
        let radius = (size[0] + size[1] + 4) as f64 * cell;
        let farthest = (eye.truncate() - middle).length() + radius;
        fan.nodes = fan.node(farthest).ceil() as usize + 2;
        fan.spokes.resize_with(spokes, OnceLock::new);
        fan
    }

    /// Where a distance lies among the nodes: evenly between one power of two of 1 + r/first and the next.
    fn node(&self, distance: f64) -> f64 {
        let share = 1.0 + distance / self.first;
        let exponent = ((share.to_bits() >> 52) as i64 - 1023) as f64;
        let mantissa = f64::from_bits(share.to_bits() & ((1 << 52) - 1) | 1023 << 52);
        (exponent + mantissa - 1.0) * PER_OCTAVE as f64
    }

    /// The distance of a node, m.
    fn distance(&self, node: usize) -> f64 {
        let octave = (1u64 << (node / PER_OCTAVE)) as f64;
        (octave * (1.0 + (node % PER_OCTAVE) as f64 / PER_OCTAVE as f64) - 1.0) * self.first
    }

    /// The sums of a spoke at its nodes.
    fn spoke(&self, number: usize) -> &[f32] {
        self.spokes[number].get_or_init(|| {
            let Some(PlacedMap { map, drift, .. }) = self.field.map else { return Box::default() };
            let (origin, cell, size) = map.cells();
            let angle = TAU / self.spokes.len() as f64;
            let (sin, cos) = libm::sincos(angle * number as f64);
            let ahead = DVec2::new(cos, sin);
            let start = (self.eye.truncate() - drift - origin) / cell + 0.5;
            let region = RainVolume { ceiling: None, region: self.field.volume.region };
            let mut sum = 0.0;
            let mut sums = Vec::with_capacity(self.nodes);
            sums.push(0.0);
            for node in 1..self.nodes {
                let ends = [self.distance(node - 1), self.distance(node)];
                // Past the border by half of the widest mean there.
                let near = start + ahead * (ends[0] / cell);
                let reach = (ends[1] - ends[0] + ends[1] * angle * 2.0) / cell + 2.0;
                let misses = |at: f64, side: usize| at < -reach || at > side as f64 + 1.0 + reach;
                if !misses(near.x, size[0]) && !misses(near.y, size[1]) {
                    // As wide as two spokes are apart, two samples to each mean.
                    let width = (2.0 * ends[0] * angle / cell).max(1.0);
                    let level = libm::floor(libm::log2(width)) as usize;
                    let count = libm::ceil(2.0 * (ends[1] - ends[0]) / (cell * width)).max(1.0) as usize;
                    let step = (ends[1] - ends[0]) / count as f64;
                    for sample in 0..count {
                        let way = ends[0] + step * (sample as f64 + 0.5);
                        let share = map.share_of_level(level, start + ahead * (way / cell));
                        if share > 0.0 {
                            sum += step * share * region.density(self.eye + ahead.extend(0.0) * way);
                        }
                    }
                }
                sums.push(sum as f32);
            }
            sums.into()
        })
    }

    /// The spokes under a ray; nothing where it has to be summed exactly.
    fn over(&self, ray: &Ray) -> Option<Over<'_>> {
        let way = ray.direction.truncate();
        let speed = way.length();
        if self.spokes.is_empty() || ray.origin != self.eye || speed < UPRIGHT {
            return None;
        }
        let count = self.spokes.len();
        let turn = libm::atan2(way.y, way.x) / TAU;
        let place = (turn - turn.floor()) * count as f64;
        let number = place as usize;
        let spokes = [number % count, (number + 1) % count].map(|number| self.spoke(number));
        Some(Over { spokes, share: place - number as f64, speed })
    }

    /// I at a distance of the ray.
    fn sum(&self, over: &Over, distance: f64) -> f64 {
        let place = self.node(distance * over.speed).min((self.nodes - 1) as f64);
        let node = (place as usize).min(self.nodes - 2);
        let [near, far] = over.spokes.map(|sums| {
            let (low, high) = (f64::from(sums[node]), f64::from(sums[node + 1]));
            low + (high - low) * (place - node as f64)
        });
        near + (far - near) * over.share
    }

    /// [`RainPath::path`] over two spokes.
    fn path_over(&self, over: &Over, ray: &Ray, from: f64, to: f64) -> f64 {
        let Some(PlacedMap { map, reference, .. }) = self.field.map else { return 0.0 };
        let to = to.min(self.field.farthest());
        if from.is_nan() || to.is_nan() || from >= to {
            return 0.0;
        }
        let tops = [map.top(), self.field.volume.ceiling];
        // Beyond its last node there is no map; a weight needs a place.
        let end = to.min(self.distance(self.nodes - 1) / over.speed);
        // Below every top nothing is weighted.
        let highest = ray.origin.z.max(ray.origin.z + ray.direction.z * end);
        if tops.iter().flatten().all(|top| highest <= top.height.0) {
            let sum = self.sum(over, end.max(from)) - self.sum(over, from);
            return sum.max(0.0) / (over.speed * reference);
        }
        let mut cuts = [f64::INFINITY; 4];
        for (k, top) in tops.into_iter().enumerate() {
            let Some(top) = top else { continue };
            for (soft, cut) in cuts[2 * k..2 * k + 2].iter_mut().enumerate() {
                *cut = (top.height.0 + soft as f64 * top.softness.0 - ray.origin.z) / ray.direction.z;
            }
        }
        let weight = |s: f64| {
            let point = ray.origin + ray.direction * s;
            let density = |ceiling| RainVolume { ceiling, region: None }.density(point);
            density(tops[0]) * density(tops[1])
        };
        let (mut sum, mut here, mut before) = (0.0, from, self.sum(over, from));
        while here < end {
            let next = cuts.iter().copied().filter(|cut| *cut > here).fold(end, f64::min);
            let ends = [here + 1e-9 * (next - here), next - 1e-9 * (next - here)].map(weight);
            let pieces = if (ends[0] - ends[1]).abs() < 1e-6 { 1 } else { SOFT };
            let step = (next - here) / pieces as f64;
            for piece in 0..pieces {
                let after = self.sum(over, here + step * (piece + 1) as f64);
                sum += (after - before) * weight(here + step * (piece as f64 + 0.5));
                before = after;
            }
            here = next;
        }
        sum.max(0.0) / (over.speed * reference)
    }
}

impl RainPath for RainFan<'_> {
    fn is_everywhere(&self) -> bool {
        self.field.is_everywhere()
    }

    fn fills(&self, centre: DVec3, radius: f64) -> bool {
        self.field.fills(centre, radius)
    }

    fn filled_radius(&self, centre: DVec3) -> f64 {
        self.field.filled_radius(centre)
    }

    fn farthest(&self) -> f64 {
        self.field.farthest()
    }

    fn is_costly(&self) -> bool {
        self.field.is_costly()
    }

    fn path(&self, ray: &Ray, from: f64, to: f64) -> f64 {
        match self.over(ray) {
            Some(over) => self.path_over(&over, ray, from, to),
            None => self.field.path(ray, from, to),
        }
    }

    fn weighted(&self, ray: &Ray, pieces: &mut dyn Iterator<Item = [f64; 3]>) -> f64 {
        match self.over(ray) {
            Some(over) => {
                pieces.map(|[factor, from, to]| factor * self.path_over(&over, ray, from, to)).sum()
            }
            None => self.field.weighted(ray, pieces),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Projection;
    use crate::rain::{Ceiling, RainMap, Region};
    use crate::random::Random;
    use squall_formats::units::{Metres, Radians};

    fn camera(eye: DVec3) -> Camera {
        let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
        Camera::new(eye, DVec3::X, DVec3::Z, projection, [480, 270]).unwrap()
    }

    /// Showers some cells wide, over a map with sides of so many cells of 20 m.
    fn showers(side: usize, top: Option<Ceiling>) -> RainMap {
        let mut random = Random::new(8);
        let middles: Vec<[f64; 3]> =
            (0..30).map(|_| [random.unit(), random.unit(), random.range(2.0, 9.0)]).collect();
        let rate = |x: usize, y: usize| -> f32 {
            let heavy = middles.iter().map(|[mx, my, radius]| {
                let [dx, dy] = [x as f64 - mx * side as f64, y as f64 - my * side as f64];
                40.0 * libm::exp(-(dx * dx + dy * dy) / (radius * radius))
            });
            heavy.sum::<f64>() as f32
        };
        let rates: Vec<f32> = (0..side * side).map(|i| rate(i % side, i / side)).collect();
        RainMap::new(DVec2::new(-900.0, 400.0), Metres(20.0), [side, side], &rates, top).unwrap()
    }

    #[test]
    fn spokes_hold_what_exact_sums_along_each_ray_do() {
        /// Of the longest way through rain that any ray has, root mean square: what lies between two spokes and between two nodes.
        const BETWEEN: f64 = 2e-3;
        let soft = Some(Ceiling { height: Metres(300.0), softness: Metres(80.0) });
        let region = Region { centre: [200.0, 1500.0], radius: Metres(800.0), softness: Metres(200.0) };
        let drift = DVec3::new(3e4, -1e4, 0.0);
        for (case, top) in [None, soft, soft].into_iter().enumerate() {
            let map = showers(96, top);
            let volume = match case {
                2 => RainVolume {
                    ceiling: None,
                    region: Some(Region { centre: [30_200.0, -8500.0], ..region }),
                },
                _ => RainVolume::default(),
            };
            let mut random = Random::new(9);
            for eye in [DVec3::new(100.0, 1300.0, 2.0), DVec3::new(-3000.0, 900.0, 60.0)] {
                let eye = eye + drift;
                let field = RainField::from(volume)
                    .with_map(&map, drift, eye)
                    .with_farthest((case == 1).then_some(Metres(2500.0)));
                let fan = RainFan::new(field, &camera(eye));
                assert!(!fan.spokes.is_empty());
                let (mut squares, mut longest, mut count) = (0.0, 0.0_f64, 0);
                for _ in 0..1500 {
                    let direction = (random.direction() * DVec3::new(1.0, 1.0, 0.3)).normalize();
                    let ray = Ray { origin: eye, direction };
                    let (from, to) = (random.range(0.0, 300.0), random.range(400.0, 6000.0));
                    let (exact, found) = (field.path(&ray, from, to), fan.path(&ray, from, to));
                    squares += (found - exact) * (found - exact);
                    longest = longest.max(exact);
                    count += 1;
                }
                let error = libm::sqrt(squares / f64::from(count)) / longest;
                assert!(longest > 100.0 && error < BETWEEN, "case {case}, eye {eye}: {error} of {longest}");
            }
        }
    }

    #[test]
    fn pieces_of_a_ray_add_up_and_rays_from_elsewhere_are_exact() {
        let map = showers(64, None);
        let eye = DVec3::new(-300.0, 900.0, 10.0);
        let field = RainField::default().with_map(&map, DVec3::ZERO, eye);
        let fan = RainFan::new(field, &camera(eye));
        let ray = Ray { origin: eye, direction: DVec3::new(0.8, 0.6, 0.0) };
        let whole = fan.path(&ray, 0.0, f64::INFINITY);
        let pieces = [[1.0, 0.0, 333.0], [1.0, 333.0, 1234.5], [1.0, 1234.5, f64::INFINITY]];
        assert!(whole > 10.0 && (fan.weighted(&ray, &mut pieces.into_iter()) / whole - 1.0).abs() < 1e-9);
        let other = Ray { origin: eye + DVec3::X, ..ray };
        assert_eq!(fan.path(&other, 5.0, 900.0), field.path(&other, 5.0, 900.0));
        let up = Ray { origin: eye, direction: DVec3::Z };
        assert_eq!(fan.path(&up, 5.0, 900.0), field.path(&up, 5.0, 900.0));
    }

    #[test]
    fn a_spoke_reads_a_bounded_number_of_places_whatever_the_map() {
        // Nodes grow with the logarithm of the map's side: a map of twice the side has an octave more.
        let nodes = |side: usize| {
            let rates = vec![1.0; side * side];
            let map = RainMap::new(DVec2::ZERO, Metres(1.0), [side, side], &rates, None).unwrap();
            let field = RainField::default().with_map(&map, DVec3::ZERO, DVec3::ZERO);
            RainFan::new(field, &camera(DVec3::ZERO)).nodes
        };
        let [small, large] = [nodes(256), nodes(1024)];
        assert!(large - small <= 2 * PER_OCTAVE + 1, "{small} {large}");
    }

    #[test]
    fn nodes_and_distances_are_each_others_inverse() {
        let fan = RainFan {
            field: RainField::default(),
            eye: DVec3::ZERO,
            spokes: Vec::new(),
            first: 320.0,
            nodes: 700,
        };
        for node in 0..700 {
            assert!((fan.node(fan.distance(node)) - node as f64).abs() < 1e-9, "{node}");
        }
    }
}
