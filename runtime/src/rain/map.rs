//! Rain over the ground: a map of its intensity, which the wind carries.
//!
//! Between the map's cells EXTINCTION is interpolated, and with it everything else: extinction grows with Λ⁻³ and Λ with
//! R^−0.21, so that one bilinear field e(x, y) in [0, 1] gives the medium (e times the heaviest rain's extinction), the drops
//! (Λ/∛e) and the rate (R e^{1/0.63}). Along a ray e is a quadratic per patch between four cells, and two Gauss points per patch
//! integrate it exactly, the soft top included.
//!
//! Columns are upright: what falls and what moves the map is carried by the same wind, so that in the air's own frame every drop
//! falls straight down through one place of the map, and belongs to the rain all its life or never.

#[cfg(feature = "gpu")]
mod upload;

use super::field::GAUSS;
use super::volume::Ceiling;
use crate::camera::Ray;
use crate::error::RuntimeError;
use glam::{DVec2, DVec3};
use squall_formats::drops::SLOPE_POWER;
use squall_formats::section::rain_place::RainMapRecord;
use squall_formats::units::{Metres, MillimetresPerHour};
use std::sync::{Arc, OnceLock};

/// Most cells along a side.
const MOST_SIDE: usize = 4096;
/// Patches along a side of a block that rays may step over.
const BLOCK: usize = 8;

/// A map of rain over the ground; outside it the ground stays dry.
#[derive(Clone, Debug, PartialEq)]
pub struct RainMap {
    origin: DVec2,
    cell: f64,
    size: [usize; 2],
    heaviest: MillimetresPerHour,
    /// Extinction over the heaviest rain's, with a border of dry cells around.
    extinction: Arc<[f32]>,
    /// Of each [`BLOCK`] × [`BLOCK`] patches, x fastest, whether rain falls in any: rays step over the others whole.
    wet: Arc<[bool]>,
    /// The extinction in halves of halves, made when a fan first asks.
    levels: Arc<OnceLock<Vec<Level>>>,
    top: Option<Ceiling>,
}

/// A map's extinction with a cell for each 2ˡ × 2ˡ of it.
#[derive(Clone, Debug, PartialEq)]
struct Level {
    width: usize,
    values: Vec<f32>,
}

impl Level {
    /// Each value the mean of four; what is missing at the border is dry.
    fn halved(width: usize, values: &[f32]) -> Self {
        let rows = values.len() / width;
        let (half, below) = (width.div_ceil(2), rows.div_ceil(2));
        let at = |x: usize, y: usize| if x < width && y < rows { values[y * width + x] } else { 0.0 };
        let mean = |i: usize| {
            let (x, y) = (2 * (i % half), 2 * (i / half));
            0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
        };
        Self { width: half, values: (0..half * below).map(mean).collect() }
    }
}

impl RainMap {
    /// A map from rates in mm/h, `size[0] * size[1]` of them, x fastest: each is the rain at the middle of a square of edge `cell`;
    /// `origin` is the grid's lowest corner at time 0. Rain falls from `top`, or from everywhere.
    ///
    /// Errors: an origin that is not finite, an edge that is not positive, sides beyond 1 to 4096, a wrong number of rates, one
    /// that is negative or no number, none above 0, a top that is no number.
    pub fn new(
        origin: DVec2,
        cell: Metres,
        size: [usize; 2],
        rates: &[f32],
        top: Option<Ceiling>,
    ) -> Result<Self, RuntimeError> {
        let field = "rain map";
        if !origin.is_finite() {
            return Err(RuntimeError::argument(field, "a finite origin", origin));
        }
        if !(cell.0 > 0.0 && cell.0.is_finite()) {
            return Err(RuntimeError::argument(field, "cells with a positive edge in metres", cell.0));
        }
        if size.iter().any(|side| !(1..=MOST_SIDE).contains(side)) || rates.len() != size[0] * size[1] {
            let found = format!("{} rates for {} × {}", rates.len(), size[0], size[1]);
            let wanted = format!("a rate for each of 1 to {MOST_SIDE} cells a side");
            return Err(RuntimeError::argument(field, wanted, found));
        }
        if let Some(at) = rates.iter().position(|rate| !(*rate >= 0.0 && rate.is_finite())) {
            let found = format!("{} in cell {} × {}", rates[at], at % size[0], at / size[0]);
            return Err(RuntimeError::argument(field, "finite rates of 0 mm/h and more", found));
        }
        let heaviest = rates.iter().fold(0.0f32, |most, rate| most.max(*rate));
        if heaviest == 0.0 {
            return Err(RuntimeError::argument(field, "rain somewhere", "0 mm/h in every cell"));
        }
        if let Some(top) = top
            && !(top.height.0.is_finite() && top.softness.0 >= 0.0 && top.softness.0.is_finite())
        {
            return Err(RuntimeError::argument(field, "a finite top, its softness from 0", top.height.0));
        }
        let width = size[0] + 2;
        let mut extinction = vec![0.0; width * (size[1] + 2)];
        for (at, rate) in rates.iter().enumerate() {
            let share = f64::from(*rate) / f64::from(heaviest);
            let place = (at / size[0] + 1) * width + at % size[0] + 1;
            extinction[place] = libm::pow(share, -3.0 * SLOPE_POWER) as f32;
        }
        let heaviest = MillimetresPerHour(f64::from(heaviest));
        let wet = Arc::default();
        let levels = Arc::default();
        let extinction = extinction.into();
        let mut map = Self { origin, cell: cell.0, size, heaviest, extinction, wet, levels, top };
        let blocks = map.blocks();
        let mut wet = vec![false; blocks[0] * blocks[1]];
        for y in 0..=size[1] {
            for x in 0..=size[0] {
                wet[y / BLOCK * blocks[0] + x / BLOCK] |= map.corners([x, y]) != [0.0; 4];
            }
        }
        map.wet = wet.into();
        Ok(map)
    }

    /// The same map measured from another point.
    pub(crate) fn measured_from(&self, point: DVec3) -> Self {
        let top = self.top.map(|top| Ceiling { height: Metres(top.height.0 - point.z), ..top });
        Self { origin: self.origin - point.truncate(), top, ..self.clone() }
    }

    /// The map of an asset. Errors: as [`RainMap::new`].
    pub fn from_record(record: &RainMapRecord) -> Result<Self, RuntimeError> {
        let [x, y] = record.origin_m;
        let top = record
            .top_m
            .map(|[height, softness]| Ceiling { height: Metres(height), softness: Metres(softness) });
        let size = record.size.map(|side| side as usize);
        Self::new(DVec2::new(x, y), Metres(record.cell_m), size, &record.rates(), top)
    }

    /// The heaviest rain of the map.
    pub fn heaviest(&self) -> MillimetresPerHour {
        self.heaviest
    }

    /// Where rain falls from.
    pub fn top(&self) -> Option<Ceiling> {
        self.top
    }

    /// Extinction at a place of the ground, over the heaviest rain's: 0 to 1.
    pub(super) fn share(&self, place: DVec2) -> f64 {
        let at = (place - self.origin) / self.cell + 0.5;
        let (x, y) = (at.x.floor(), at.y.floor());
        if !(x >= 0.0 && y >= 0.0 && x <= self.size[0] as f64 && y <= self.size[1] as f64) {
            return 0.0;
        }
        let [a, b, c, d] = self.corners([x as usize, y as usize]);
        let (u, v) = (at.x - x, at.y - y);
        (a + (b - a) * u) * (1.0 - v) + (c + (d - c) * u) * v
    }

    /// Rain at a place of the ground at time 0, mm/h.
    pub fn rate_at(&self, place: DVec2) -> MillimetresPerHour {
        MillimetresPerHour(self.heaviest.0 * libm::pow(self.share(place), -1.0 / (3.0 * SLOPE_POWER)))
    }

    /// The edge of its cells, m.
    pub(crate) fn cell(&self) -> f64 {
        self.cell
    }

    /// Its lowest corner, the edge of its cells, and how many they are.
    pub(super) fn cells(&self) -> (DVec2, f64, [usize; 2]) {
        (self.origin, self.cell, self.size)
    }

    /// [`RainMap::share`] averaged over about 2ˡ cells a side, at a place in cells from the middle of the dry border's first.
    pub(super) fn share_of_level(&self, level: usize, place: DVec2) -> f64 {
        let levels = self.levels.get_or_init(|| {
            let mut levels = vec![Level::halved(self.size[0] + 2, &self.extinction)];
            while let Some(last) = levels.last().filter(|last| last.values.len() > 1) {
                levels.push(Level::halved(last.width, &last.values));
            }
            levels
        });
        let level = level.min(levels.len());
        let (width, values) = match level {
            0 => (self.size[0] + 2, &self.extinction[..]),
            _ => (levels[level - 1].width, &levels[level - 1].values[..]),
        };
        let edge = (1u64 << level) as f64;
        let at = (place - 0.5 * (edge - 1.0)) / edge;
        let (x, y) = (at.x.floor(), at.y.floor());
        let rows = values.len() / width;
        if !(x >= -1.0 && y >= -1.0 && x < width as f64 && y < rows as f64) {
            return 0.0;
        }
        let (x, y, u, v) = (x as i64, y as i64, at.x - x, at.y - y);
        let value = |x: i64, y: i64| {
            let inside = x >= 0 && y >= 0 && x < width as i64 && y < rows as i64;
            if inside { f64::from(values[y as usize * width + x as usize]) } else { 0.0 }
        };
        let [a, b] = [y, y + 1].map(|y| value(x, y) + (value(x + 1, y) - value(x, y)) * u);
        a + (b - a) * v
    }

    /// Blocks of patches along x and y.
    fn blocks(&self) -> [usize; 2] {
        self.size.map(|cells| (cells + 1).div_ceil(BLOCK))
    }

    /// How many patches there are along a side, and where they begin, in what a ray at `patch` may cross in one step: its patch, or
    /// its block where that is dry.
    fn step(&self, patch: [f64; 2]) -> (f64, [f64; 2]) {
        let block = patch.map(|patch| patch as usize / BLOCK);
        if self.wet[block[1] * self.blocks()[0] + block[0]] {
            (1.0, patch)
        } else {
            (BLOCK as f64, block.map(|block| (block * BLOCK) as f64))
        }
    }

    /// The four cells around a patch, whose lowest is `patch` counted from the dry border.
    fn corners(&self, patch: [usize; 2]) -> [f64; 4] {
        let width = self.size[0] + 2;
        let at = patch[1] * width + patch[0];
        [at, at + 1, at + width, at + width + 1].map(|at| f64::from(self.extinction[at]))
    }

    /// ∫ e · `weight`(s) ds along a ray over the map, between two distances; exact where the weight is linear in s between the
    /// patches' borders and the `cuts`.
    pub(super) fn integrate(
        &self,
        ray: &Ray,
        [from, to]: [f64; 2],
        cuts: &[f64],
        weight: impl Fn(f64) -> f64,
    ) -> f64 {
        let start = (ray.origin.truncate() - self.origin) / self.cell + 0.5;
        let way = ray.direction.truncate() / self.cell;
        let (mut enter, mut leave) = (from, to);
        for axis in 0..2 {
            let (at, speed, side) = (start[axis], way[axis], self.size[axis] as f64 + 1.0);
            if speed == 0.0 {
                if !(at >= 0.0 && at <= side) {
                    return 0.0;
                }
                continue;
            }
            let (a, b) = (-at / speed, (side - at) / speed);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        // A ray that never leaves the map stands upright over it, and its weight must end it.
        if !(enter < leave && leave.is_finite()) {
            return if enter < leave { self.upright(ray, [enter, leave], cuts, weight) } else { 0.0 };
        }
        let mut sum = 0.0;
        let mut here = enter;
        while here < leave {
            let place = start + way * (here + 1e-9 * (1.0 + here.abs()));
            let patch = [0, 1].map(|axis| place[axis].floor().clamp(0.0, self.size[axis] as f64));
            let (side, low) = self.step(patch);
            let mut next = leave;
            for axis in 0..2 {
                if way[axis] != 0.0 {
                    let border = low[axis] + if way[axis] > 0.0 { side } else { 0.0 };
                    let at = (border - start[axis]) / way[axis];
                    if at > here {
                        next = next.min(at);
                    }
                }
            }
            if side > 1.0 {
                here = next;
                continue;
            }
            for &cut in cuts {
                if cut > here {
                    next = next.min(cut);
                }
            }
            let corners = self.corners(patch.map(|cell| cell as usize));
            if corners != [0.0; 4] {
                let (middle, half) = (0.5 * (here + next), 0.5 * (next - here));
                for s in [middle - GAUSS * half, middle + GAUSS * half] {
                    let at = start + way * s - DVec2::from_array(patch);
                    let [a, b, c, d] = corners;
                    let share = (a + (b - a) * at.x) * (1.0 - at.y) + (c + (d - c) * at.x) * at.y;
                    sum += half * share.max(0.0) * weight(s).max(0.0);
                }
            }
            here = next;
        }
        sum
    }

    /// The same for an upright ray.
    fn upright(&self, ray: &Ray, [from, to]: [f64; 2], cuts: &[f64], weight: impl Fn(f64) -> f64) -> f64 {
        let share = self.share(ray.origin.truncate());
        let mut sum = 0.0;
        let mut here = from;
        while here < to && share > 0.0 {
            let next = cuts.iter().copied().filter(|cut| *cut > here).fold(to, f64::min);
            if next.is_finite() {
                sum += (next - here) * weight(0.5 * (here + next)).max(0.0);
            } else if weight(here + 1.0) > 0.0 {
                return f64::INFINITY;
            }
            here = next;
        }
        share * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rain::{Ceiling, RainField, RainPath, RainVolume, Region};
    use crate::random::Random;
    use glam::DVec3;

    fn ceiling(height: f64, softness: f64) -> Ceiling {
        Ceiling { height: Metres(height), softness: Metres(softness) }
    }

    fn map(top: Option<Ceiling>) -> RainMap {
        let mut random = Random::new(4);
        let rates: Vec<f32> =
            (0..56).map(|_| if random.unit() < 0.4 { 0.0 } else { random.range(0.0, 60.0) as f32 }).collect();
        RainMap::new(DVec2::new(-300.0, 100.0), Metres(100.0), [8, 7], &rates, top).unwrap()
    }

    #[test]
    fn the_extinction_and_the_slope_that_a_place_has_are_those_of_its_rate() {
        use squall_formats::drops;
        /// Rates are kept in single precision, as shares of extinction.
        const ROUND_OFF: f64 = 1e-5;
        let map = map(None);
        let mut random = Random::new(5);
        let mut wet = 0;
        for _ in 0..300 {
            let place = DVec2::new(random.range(-400.0, 600.0), random.range(0.0, 900.0));
            let (share, rate) = (map.share(place), map.rate_at(place));
            let extinction = |rate| drops::extinction(rate, 1.0).0;
            if share > 1e-3 {
                wet += 1;
                assert!((extinction(rate) / extinction(map.heaviest()) / share - 1.0).abs() < ROUND_OFF);
                let slope = drops::slope(map.heaviest()) / libm::cbrt(share);
                assert!((drops::slope(rate) / slope - 1.0).abs() < ROUND_OFF);
            }
        }
        assert!(wet > 100);
        assert_eq!(map.rate_at(DVec2::new(-1e6, 0.0)).0, 0.0);
    }

    #[test]
    fn lengths_of_rain_are_the_integral_for_rays_of_every_kind() {
        let mut random = Random::new(6);
        let drift = DVec3::new(1e4, -2e4, 0.0);
        let region = Region { centre: [1e4, -2e4 + 400.0], radius: Metres(200.0), softness: Metres(100.0) };
        for i in 0..300 {
            let map = map(match i % 3 {
                0 => None,
                1 => Some(ceiling(120.0, 0.0)),
                _ => Some(ceiling(150.0, 80.0)),
            });
            let volume = match i % 4 {
                0 => RainVolume { ceiling: Some(ceiling(140.0, 30.0)), region: Some(region) },
                _ => RainVolume::default(),
            };
            let eye =
                DVec3::new(random.range(-500.0, 700.0), random.range(0.0, 900.0), random.range(0.0, 160.0))
                    + drift;
            let field = RainField::from(volume).with_map(&map, drift, eye);
            let direction = match i % 7 {
                0 => DVec3::Z,
                1 => DVec3::X,
                2 => -DVec3::Y,
                _ => (random.direction() * DVec3::new(1.0, 1.0, 0.2)).normalize(),
            };
            let ray = Ray { origin: eye, direction };
            let (from, to) = (random.range(0.0, 50.0), random.range(60.0, 1500.0));
            let reference = if map.share(eye.truncate() - drift.truncate()) > 0.0 {
                map.share(eye.truncate() - drift.truncate())
            } else {
                1.0
            };
            let count = 40_000;
            let step = (to - from) / f64::from(count);
            let wanted: f64 = (0..count)
                .map(|i| {
                    let point = eye + direction * (from + step * (f64::from(i) + 0.5));
                    let Some([within, slope]) = field.thinning(point) else { return 0.0 };
                    within / (slope * slope * slope) / reference
                })
                .sum::<f64>()
                * step;
            let found = field.path(&ray, from, to);
            // A hard top costs the sum half a step, 0.02 m of the heaviest rain; the region's edge is a root, two points a
            // patch near enough.
            let allowed = 0.05 / reference + 3e-3 * wanted;
            assert!((found - wanted).abs() < allowed, "{i}: {found} for {wanted}");
        }
    }

    #[test]
    fn a_short_way_over_a_map_is_the_integral_of_the_rain_between_its_cells() {
        /// Double precision, over borders found by a hair.
        const ROUND_OFF: f64 = 1e-6;
        /// Two places where a way bends over a border: a share of what rain changes by along half a cell.
        const BENT: f64 = 0.1;
        let (map, drift) = (map(Some(ceiling(300.0, 50.0))), DVec3::new(40.0, -70.0, 0.0));
        let (mut random, mut curved) = (Random::new(8), 0);
        for i in 0..2000 {
            let from = drift + DVec3::new(random.range(-290.0, 480.0), random.range(110.0, 780.0), 5.0);
            let field = RainField::default().with_map(&map, drift, from);
            let (direction, metres) =
                (random.direction() * DVec3::new(1.0, 1.0, 0.05), random.range(1.0, 50.0));
            let direction = direction.normalize();
            let wanted = field.path(&Ray { origin: from, direction }, 0.0, metres);
            let found = field.short_path(from, direction, metres).unwrap();
            let at =
                |share: f64| from.truncate() - drift.truncate() + direction.truncate() * (share * metres);
            let patch = |place: DVec2| ((place - map.origin) / map.cell + 0.5).floor();
            let reference = field.map.unwrap().reference;
            let [first, middle, last] = [0.0, 0.5, 1.0].map(|share| map.share(at(share)) / reference);
            if patch(at(0.0)) == patch(at(1.0)) {
                assert!((found - wanted).abs() <= ROUND_OFF * wanted.max(1.0), "{i}: {found} {wanted}");
                curved += u32::from((metres * middle - wanted).abs() > 1e-3 * wanted);
            } else {
                let most = first.max(middle).max(last).max(found / metres);
                assert!((found - wanted).abs() <= BENT * metres * most, "{i}: {found} {wanted}");
            }
        }
        assert!(curved > 200, "the middle alone tells {curved} of them wrong");
        let far = RainField::default().with_map(&map, DVec3::ZERO, DVec3::ZERO);
        assert!(far.short_path(DVec3::ZERO, DVec3::X, 51.0).is_none());
        assert!(far.short_path(DVec3::Z * 290.0, DVec3::Z, 20.0).is_none());
    }

    #[test]
    fn a_shaft_is_as_deep_from_outside_as_its_two_parts_are_from_inside() {
        /// Products of double precision, over borders found by a hair.
        const ROUND_OFF: f64 = 1e-6;
        let map = map(Some(ceiling(500.0, 100.0)));
        let direction = DVec3::new(0.9, 0.35, 0.05).normalize();
        let outside = Ray { origin: DVec3::new(-600.0, 0.0, 20.0), direction };
        let inside = Ray { origin: outside.origin + direction * 700.0, direction };
        let back = Ray { origin: inside.origin, direction: -direction };
        // Counted in the heaviest rain: seen from the dry.
        let field = RainField::default().with_map(&map, DVec3::ZERO, outside.origin);
        let whole = field.path(&outside, 0.0, f64::INFINITY);
        let parts = field.path(&inside, 0.0, f64::INFINITY) + field.path(&back, 0.0, f64::INFINITY);
        assert!(whole > 50.0 && (whole / parts - 1.0).abs() < ROUND_OFF, "{whole} {parts}");
        // The sphere of the sky ends it.
        let near = field.with_farthest(Some(Metres(700.0)));
        let first = near.path(&outside, 0.0, f64::INFINITY);
        assert!((first / field.path(&outside, 0.0, 700.0) - 1.0).abs() < ROUND_OFF && first < whole);
    }

    #[test]
    fn maps_that_make_no_sense_are_refused_by_name() {
        let make = |cell, size, rates: &[f32]| RainMap::new(DVec2::ZERO, Metres(cell), size, rates, None);
        for (map, words) in [
            (make(0.0, [1, 1], &[1.0]), "positive edge"),
            (make(1.0, [2, 1], &[1.0]), "1 rates for 2 × 1"),
            (make(1.0, [0, 1], &[]), "1 to 4096"),
            (make(1.0, [2, 1], &[1.0, -1.0]), "-1 in cell 1 × 0"),
            (make(1.0, [2, 1], &[1.0, f32::NAN]), "NaN in cell 1 × 0"),
            (make(1.0, [2, 1], &[0.0, 0.0]), "rain somewhere"),
        ] {
            let error = map.unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("rain map"), "{error}");
        }
    }
}
