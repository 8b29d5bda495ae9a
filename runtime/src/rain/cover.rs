//! Covers that rain does not pass: a town's blocks, and height maps that a user brings.
//!
//! A drop is followed back along its own fall, wind included, to where nothing can be above it: small drops come in flatter
//! than large ones, and get further under the same edge.

use super::Shelter;
use crate::error::RuntimeError;
use glam::{DVec2, DVec3};
use squall_formats::units::Metres;
use std::sync::Arc;

/// Roofs, bridges and trees over a regular grid in x and y.
///
/// Each cell holds what stands in it between an underside and a top. A drop is kept off by the first cell that its way back
/// meets; cells without a number, and everything outside the grid, are open sky.
#[derive(Clone, Debug)]
pub struct CoverMap {
    origin: DVec3,
    cell: f64,
    size: [usize; 2],
    tops: Arc<[f32]>,
    /// `None` where everything is solid down to the ground.
    undersides: Option<Arc<[f32]>>,
    highest: f64,
    holes: usize,
}

/// Bit by bit: a hole, which is no number, is the same hole again.
impl PartialEq for CoverMap {
    fn eq(&self, other: &Self) -> bool {
        let same = |a: &Arc<[f32]>, b: &Arc<[f32]>| {
            Arc::ptr_eq(a, b) || a.iter().map(|z| z.to_bits()).eq(b.iter().map(|z| z.to_bits()))
        };
        let undersides = match (&self.undersides, &other.undersides) {
            (Some(a), Some(b)) => same(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        let numbers = |map: &Self| [map.origin.x, map.origin.y, map.origin.z, map.cell].map(f64::to_bits);
        numbers(self) == numbers(other)
            && self.size == other.size
            && undersides
            && same(&self.tops, &other.tops)
    }
}

impl Eq for CoverMap {}

impl CoverMap {
    /// Houses and hills: solid from their `heights` down to the ground.
    ///
    /// `origin` is the grid's lowest corner, and its z what heights count from, m; cell (i, j) covers i…i+1 by j…j+1 edges of
    /// `cell` from there. `heights` holds `size[0] * size[1]` numbers, x fastest, m; NaN and −∞ are holes.
    ///
    /// Errors: an origin that is not finite, an edge that is not positive, a wrong number of heights, a height of +∞.
    pub fn solid(
        origin: DVec3,
        cell: Metres,
        size: [usize; 2],
        heights: Vec<f32>,
    ) -> Result<Self, RuntimeError> {
        Self::new(origin, cell, size, heights, None)
    }

    /// Roofs and bridges, open below: each cell from `undersides` up to `tops`, both as the heights of [`CoverMap::solid`]. A cell
    /// with a hole in either is open sky.
    ///
    /// Errors: as [`CoverMap::solid`]; an underside above its top.
    pub fn roofs(
        origin: DVec3,
        cell: Metres,
        size: [usize; 2],
        undersides: Vec<f32>,
        tops: Vec<f32>,
    ) -> Result<Self, RuntimeError> {
        Self::new(origin, cell, size, tops, Some(undersides))
    }

    fn new(
        origin: DVec3,
        cell: Metres,
        size: [usize; 2],
        tops: Vec<f32>,
        undersides: Option<Vec<f32>>,
    ) -> Result<Self, RuntimeError> {
        if !origin.is_finite() {
            return Err(RuntimeError::argument("cover origin", "three finite numbers", origin));
        }
        if !(cell.0 > 0.0 && cell.0.is_finite()) {
            return Err(RuntimeError::argument("cover cell", "a positive edge in metres", cell.0));
        }
        let count = size[0].checked_mul(size[1]);
        for (field, heights) in [("cover tops", Some(&tops)), ("cover undersides", undersides.as_ref())] {
            let Some(heights) = heights else { continue };
            if count != Some(heights.len()) {
                let wanted = format!("{} × {} heights", size[0], size[1]);
                return Err(RuntimeError::argument(field, wanted, heights.len()));
            }
            if let Some(at) = heights.iter().position(|height| *height == f32::INFINITY) {
                let found = format!("+∞ in cell {} × {}", at % size[0], at / size[0]);
                return Err(RuntimeError::argument(field, "finite heights, or NaN for a hole", found));
            }
        }
        let (mut highest, mut holes) = (f64::NEG_INFINITY, 0);
        for (at, &top) in tops.iter().enumerate() {
            let under = undersides.as_ref().map_or(f32::NEG_INFINITY, |undersides| undersides[at]);
            if !top.is_finite() || under.is_nan() {
                holes += 1;
                continue;
            }
            if under > top {
                let found = format!("{under} m over {top} m in cell {} × {}", at % size[0], at / size[0]);
                return Err(RuntimeError::argument("cover undersides", "none above its top", found));
            }
            highest = highest.max(f64::from(top));
        }
        let (tops, undersides) = (tops.into(), undersides.map(Into::into));
        Ok(Self { origin, cell: cell.0, size, tops, undersides, highest, holes })
    }

    /// The same covers measured from another point.
    pub(crate) fn measured_from(&self, point: DVec3) -> Self {
        Self { origin: self.origin - point, ..self.clone() }
    }

    /// Cells that are open sky because they hold no number.
    pub fn holes(&self) -> usize {
        self.holes
    }

    /// Underside and top of a cell, m above the origin; nothing for a hole.
    fn span(&self, cell: [usize; 2]) -> Option<[f64; 2]> {
        let at = cell[0] + self.size[0] * cell[1];
        let top = f64::from(self.tops[at]);
        let under = self.undersides.as_ref().map_or(f64::NEG_INFINITY, |heights| f64::from(heights[at]));
        (top.is_finite() && !under.is_nan()).then_some([under, top])
    }

    /// Whether a way from `start` (cells across, metres up) by `way` per metre climbed meets nothing.
    fn is_open(&self, start: DVec2, height: f64, way: DVec2) -> bool {
        let mut climbed = 0.0;
        // As far as anything stands; a way that stays in one cell ends there at once.
        let last = self.highest - height;
        if last < 0.0 {
            return true;
        }
        // Skips to the grid's border.
        for axis in 0..2 {
            let (at, speed, side) = (start[axis], way[axis], self.size[axis] as f64);
            let to_border = if at < 0.0 { -at / speed } else { (side - at) / speed };
            if at < 0.0 || at >= side {
                if !(to_border >= 0.0 && to_border.is_finite()) {
                    return true;
                }
                climbed = f64::max(climbed, to_border);
            }
        }
        while climbed <= last {
            let here = start + way * climbed;
            // At a border, the cell that the way goes on into.
            let index = [0, 1].map(|axis| {
                let nearest = here[axis].round();
                let at_border = (here[axis] - nearest).abs() < 1e-9;
                if at_border && way[axis] != 0.0 {
                    if way[axis] > 0.0 { nearest } else { nearest - 1.0 }
                } else {
                    here[axis].floor()
                }
            });
            if (0..2).any(|axis| index[axis] < 0.0 || index[axis] >= self.size[axis] as f64) {
                return true;
            }
            let leave = (0..2)
                .map(|axis| {
                    let border = if way[axis] > 0.0 { index[axis] + 1.0 } else { index[axis] };
                    if way[axis] == 0.0 { f64::INFINITY } else { (border - start[axis]) / way[axis] }
                })
                .fold(f64::INFINITY, f64::min);
            if let Some([under, top]) = self.span(index.map(|cell| cell as usize))
                && height + climbed < top
                && height + leave > under
            {
                return false;
            }
            // A way along a border advances all the same.
            climbed = leave.max(climbed + 1e-9);
        }
        true
    }
}

impl Shelter for CoverMap {
    /// A drop that does not fall is looked at as if it fell straight down.
    fn reaches(&self, point: DVec3, velocity: DVec3) -> bool {
        let offset = point - self.origin;
        let way = if velocity.z < 0.0 { velocity.truncate() / velocity.z } else { DVec2::ZERO };
        self.is_open(offset.truncate() / self.cell, offset.z, way / self.cell)
    }

    fn top(&self) -> f64 {
        self.origin.z + self.highest
    }
}

/// Several shelters at once: a drop reaches a point that none of them keeps it off.
#[derive(Clone, Copy)]
pub struct Covers<'a> {
    /// Something that answers exactly, a town for one.
    pub first: Option<&'a dyn Shelter>,
    /// Height maps.
    pub maps: &'a [Arc<CoverMap>],
}

impl Covers<'_> {
    /// Whether nothing covers anything.
    pub fn is_empty(&self) -> bool {
        self.first.is_none() && self.maps.is_empty()
    }
}

impl Shelter for Covers<'_> {
    fn reaches(&self, point: DVec3, velocity: DVec3) -> bool {
        self.maps.iter().all(|map| map.reaches(point, velocity))
            && self.first.is_none_or(|first| first.reaches(point, velocity))
    }

    fn top(&self) -> f64 {
        let first = self.first.map_or(f64::NEG_INFINITY, Shelter::top);
        self.maps.iter().map(|map| map.top()).fold(first, f64::max)
    }

    fn lid(&self, place: DVec3, velocity: DVec3, range: [f64; 2]) -> f64 {
        let first = self.first.map_or(f64::NEG_INFINITY, |first| first.lid(place, velocity, range));
        self.maps.iter().map(|map| map.lid(place, velocity, range)).fold(first, f64::max)
    }
}

#[cfg(feature = "gpu")]
mod upload;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const DOWN: DVec3 = DVec3::new(0.0, 0.0, -5.0);

    #[test]
    fn a_solid_block_keeps_rain_off_behind_it_and_a_roof_lets_slanted_rain_in_under_its_edge() {
        // Everything over x in 4…6 m is 3 m high; the roof begins at 2.5 m.
        let cells = |full: f32, empty: f32| -> Vec<f32> {
            (0..100).map(|i| if (4..6).contains(&(i % 10)) { full } else { empty }).collect()
        };
        let solid = CoverMap::solid(DVec3::ZERO, Metres(1.0), [10, 10], cells(3.0, f32::NAN)).unwrap();
        let roof = CoverMap::roofs(
            DVec3::ZERO,
            Metres(1.0),
            [10, 10],
            cells(2.5, f32::NAN),
            cells(3.0, f32::NEG_INFINITY),
        )
        .unwrap();
        assert_eq!((solid.holes(), roof.holes()), (80, 80));
        // Rain that comes from −x by 45°: at height z it has passed x − (3 − z) at the roof's top.
        let slanted = DVec3::new(5.0, 0.0, -5.0);
        for (x, z, behind_solid, under_roof) in [
            (5.0, 1.0, false, true),
            (4.4, 2.6, false, false),
            (7.0, 1.0, false, false),
            (8.5, 1.0, true, true),
            (6.2, 0.5, false, false),
            (3.0, 1.0, true, true),
            (5.0, 3.1, true, true),
        ] {
            let point = DVec3::new(x, 5.0, z);
            assert_eq!(solid.reaches(point, slanted), behind_solid, "solid {x} {z}");
            assert_eq!(roof.reaches(point, slanted), under_roof, "roof {x} {z}");
        }
        for map in [&solid, &roof] {
            assert!(!map.reaches(DVec3::new(5.0, 5.0, 1.0), DOWN));
            assert!(map.reaches(DVec3::new(3.9, 5.0, 1.0), DOWN));
            assert!(map.reaches(DVec3::new(-50.0, 5.0, 1.0), DOWN) && map.reaches(DVec3::splat(1e12), DOWN));
            // Rising drops count as falling straight.
            assert!(!map.reaches(DVec3::new(5.0, 5.0, 1.0), DVec3::new(3.0, 0.0, 1.0)));
        }
    }

    #[test]
    fn the_walk_through_cells_finds_what_many_small_steps_find() {
        let mut random = Random::new(3);
        let size = [17, 11];
        let tops: Vec<f32> = (0..187)
            .map(|_| if random.unit() < 0.6 { f32::NAN } else { random.range(1.0, 9.0) as f32 })
            .collect();
        let undersides: Vec<f32> = tops.iter().map(|top| top - random.range(0.0, 2.0) as f32).collect();
        let origin = DVec3::new(-1e6, 2e6, 40.0);
        let map = CoverMap::roofs(origin, Metres(2.0), size, undersides.clone(), tops.clone()).unwrap();
        let mut kept = 0;
        for _ in 0..2000 {
            let start =
                DVec3::new(random.range(-6.0, 40.0), random.range(-6.0, 28.0), random.range(0.0, 9.0));
            let velocity =
                DVec3::new(random.range(-9.0, 9.0), random.range(-9.0, 9.0), -random.range(2.0, 9.0));
            let (mut met, mut near) = (false, false);
            for step in 0..40_000 {
                let point = start + velocity * (f64::from(step) * -2.5e-4);
                let [x, y] = [(point.x / 2.0).floor(), (point.y / 2.0).floor()];
                if !(0.0..17.0).contains(&x) || !(0.0..11.0).contains(&y) || point.z > 9.5 {
                    continue;
                }
                let at = x as usize + 17 * y as usize;
                let [under, top] = [undersides[at], tops[at]].map(f64::from);
                met |= point.z > under && point.z < top;
                // A hair from a border, steps and walk may differ.
                near |= (point.z - under).abs() < 5e-3 || (point.z - top).abs() < 5e-3;
            }
            let found = map.reaches(origin + start, velocity);
            assert!(found != met || near, "{start} {velocity}");
            kept += usize::from(!found);
        }
        assert!((200..1800).contains(&kept), "{kept}");
    }

    #[test]
    fn maps_that_make_no_sense_are_refused_by_name() {
        let solid = |cell, heights| CoverMap::solid(DVec3::ZERO, Metres(cell), [2, 2], heights);
        for (map, words) in [
            (solid(0.0, vec![0.0; 4]), "cover cell"),
            (solid(1.0, vec![0.0; 3]), "2 × 2 heights"),
            (solid(1.0, vec![0.0, 0.0, f32::INFINITY, 0.0]), "+∞ in cell 0 × 1"),
            (CoverMap::solid(DVec3::NAN, Metres(1.0), [1, 1], vec![0.0]), "cover origin"),
            (
                CoverMap::roofs(DVec3::ZERO, Metres(1.0), [1, 1], vec![3.0], vec![2.0]),
                "3 m over 2 m in cell 0 × 0",
            ),
        ] {
            let error = map.unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
