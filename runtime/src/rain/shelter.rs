//! Where rain does not reach: under roofs, bridges and trees.

use crate::error::RuntimeError;
use glam::DVec3;
use squall_formats::units::Metres;

/// Answers whether falling drops reach a point. Closures of the same shape are shelters too.
pub trait Shelter: Sync {
    /// Whether a drop that falls with `velocity` (m/s) reaches `point` (m) with nothing in between.
    fn reaches(&self, point: DVec3, velocity: DVec3) -> bool;

    /// Height above which nothing keeps rain off, m; +∞ where that is not known.
    fn top(&self) -> f64 {
        f64::INFINITY
    }

    /// Height z, m, below which a drop that falls through `place` with `velocity` (downwards) is kept off everywhere on its way, between
    /// `low` and `high`: −∞ where it reaches `low`, +∞ where it does not reach `high`. As it stands, found by halves, within a
    /// ten-thousandth of what lies between.
    fn lid(&self, place: DVec3, velocity: DVec3, [low, high]: [f64; 2]) -> f64 {
        const HALVES: usize = 14;
        let is_dry = |z: f64| !self.reaches(place + velocity * ((z - place.z) / velocity.z), velocity);
        if !is_dry(low) {
            return f64::NEG_INFINITY;
        }
        if is_dry(high) {
            return f64::INFINITY;
        }
        let (mut dry, mut open) = (low, high);
        for _ in 0..HALVES {
            let middle = 0.5 * (dry + open);
            *(if is_dry(middle) { &mut dry } else { &mut open }) = middle;
        }
        0.5 * (dry + open)
    }
}

impl<F: Fn(DVec3, DVec3) -> bool + Sync> Shelter for F {
    fn reaches(&self, point: DVec3, velocity: DVec3) -> bool {
        self(point, velocity)
    }
}

/// An orthographic height map seen from where the rain comes: the first surface along one fall direction.
///
/// Drops of all sizes share the one direction; with wind, small drops in truth come in flatter than large.
/// Outside the map the sky is open.
#[derive(Clone, Debug, PartialEq)]
pub struct ShelterMap {
    origin: DVec3,
    fall: DVec3,
    across: [DVec3; 2],
    cell: f64,
    size: [usize; 2],
    heights: Vec<f32>,
}

impl ShelterMap {
    /// A map from `heights`, `size[0] * size[1]` numbers with the first axis fastest. Cell (i, j) covers the
    /// points whose offset from `origin` has (i…i+1) × (j…j+1) cells along the map's axes (see
    /// [`ShelterMap::axes`]); its height is that of the first surface a falling drop meets there, in
    /// metres above `origin` AGAINST `fall`; −∞ or NaN where there is none.
    ///
    /// Errors: a fall direction that is zero or not finite, an edge that is not positive, a wrong number of
    /// heights.
    pub fn new(
        origin: DVec3,
        fall: DVec3,
        cell: Metres,
        size: [usize; 2],
        heights: Vec<f32>,
    ) -> Result<Self, RuntimeError> {
        let unit = fall.try_normalize().filter(|v| v.is_finite());
        let fall = unit.ok_or_else(|| RuntimeError::argument("shelter fall", "a finite direction", fall))?;
        if !origin.is_finite() {
            return Err(RuntimeError::argument("shelter origin", "three finite numbers", origin));
        }
        if !(cell.0 > 0.0 && cell.0.is_finite()) {
            return Err(RuntimeError::argument("shelter cell", "a positive edge in metres", cell.0));
        }
        if size[0].checked_mul(size[1]) != Some(heights.len()) {
            let wanted = format!("{} × {} heights", size[0], size[1]);
            return Err(RuntimeError::argument("shelter heights", wanted, heights.len()));
        }
        Ok(Self { origin, fall, across: Self::axes(fall), cell: cell.0, size, heights })
    }

    /// The two unit axes that a map with this (unit) fall direction is laid out along: the world's x and y
    /// for rain that falls straight down, and those two tilted with the rain otherwise.
    pub fn axes(fall: DVec3) -> [DVec3; 2] {
        let guide = if fall.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
        let first = (guide - fall * guide.dot(fall)).normalize();
        [first, first.cross(fall)]
    }
}

impl Shelter for ShelterMap {
    fn reaches(&self, point: DVec3, _velocity: DVec3) -> bool {
        let offset = point - self.origin;
        let mut index = [0; 2];
        for axis in 0..2 {
            let place = (offset.dot(self.across[axis]) / self.cell).floor();
            if !(place >= 0.0 && place < self.size[axis] as f64) {
                return true;
            }
            index[axis] = place as usize;
        }
        let height = f64::from(self.heights[index[0] + self.size[0] * index[1]]);
        height.is_nan() || -offset.dot(self.fall) >= height
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rain_reaches_the_roof_and_not_the_floor_under_it() {
        let mut heights = vec![f32::NEG_INFINITY; 20 * 10];
        heights[3 + 20 * 7] = 5.0;
        heights[4 + 20 * 7] = f32::NAN;
        let map = ShelterMap::new(DVec3::ZERO, -DVec3::Z, Metres(2.0), [20, 10], heights).unwrap();
        let [x, y] = ShelterMap::axes(-DVec3::Z);
        assert_eq!((x, y), (DVec3::X, DVec3::Y));
        let wet = |x, y, z| map.reaches(DVec3::new(x, y, z), -DVec3::Z * 5.0);
        assert!(!wet(7.0, 15.0, 4.9) && wet(7.0, 15.0, 5.1));
        assert!(wet(9.0, 15.0, 1.0) && wet(5.0, 15.0, 1.0));
        assert!(wet(-1.0, 15.0, 1.0) && wet(1e9, 0.0, 1.0));
    }

    #[test]
    fn slanted_rain_is_sheltered_beside_the_roof_and_not_under_its_edge() {
        let fall = DVec3::new(1.0, 0.0, -1.0).normalize();
        let [u, v] = ShelterMap::axes(fall);
        // A roof over x, y in 0…1 at z = 10, drawn into the map point by point.
        let (cell, size) = (0.1, 400);
        let origin = -(u + v) * 20.0;
        let mut heights = vec![f32::NEG_INFINITY; size * size];
        for i in 0..200 {
            for j in 0..200 {
                let point = DVec3::new(f64::from(i) / 200.0, f64::from(j) / 200.0, 10.0) - origin;
                let place = [point.dot(u), point.dot(v)].map(|x| (x / cell) as usize);
                heights[place[0] + size * place[1]] = -point.dot(fall) as f32;
            }
        }
        let map = ShelterMap::new(origin, fall, Metres(cell), [size, size], heights).unwrap();
        assert!(!map.reaches(DVec3::new(5.5, 0.5, 5.0), fall));
        assert!(map.reaches(DVec3::new(0.5, 0.5, 5.0), fall));
    }

    #[test]
    fn closures_are_shelters() {
        let under_ten = |point: DVec3, _: DVec3| point.z > 10.0;
        let shelter: &dyn Shelter = &under_ten;
        assert!(!shelter.reaches(DVec3::ZERO, -DVec3::Z));
    }

    #[test]
    fn impossible_maps_are_refused() {
        let make =
            |fall, cell, count| ShelterMap::new(DVec3::ZERO, fall, Metres(cell), [2, 2], vec![0.0; count]);
        assert!(make(DVec3::ZERO, 1.0, 4).is_err());
        assert!(make(-DVec3::Z, 0.0, 4).is_err());
        assert!(make(-DVec3::Z, 1.0, 5).is_err());
        assert!(make(-DVec3::Z, 1.0, 4).is_ok());
    }
}
