//! Where the sun may stand over a cloud, and how the beams baked for it are mixed. Bytes: SPEC.md, "CLRT", "Sun".

use super::head::{ResponseHead, invalid};
use crate::error::ReadError;
use serde::{Deserialize, Serialize};

/// Directions that the sun's beams were baked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SunDirections {
    /// Rings of even azimuths, from the lowest elevation to the highest: all that lies between the lowest ring and the highest.
    Rings {
        /// Elevation of each ring, rad, rising.
        elevations_rad: Vec<f64>,
        /// Beams of each ring: evenly in azimuth, the first from +x.
        counts: Vec<u32>,
    },
    /// One after the other along a line in the sky, or one alone.
    Path,
}

/// How far beside its beams the sun may stand, rad: its disc is half a degree wide.
pub const SUN_TOLERANCE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Most rings.
const MOST_RINGS: usize = 1024;

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Angle between unit vectors, rad; good to the last digits where they are near.
fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    libm::atan2(libm::sqrt(dot(cross, cross)), dot(a, b))
}

/// Unit vector towards a sun.
pub fn towards_sun(azimuth_rad: f64, elevation_rad: f64) -> [f64; 3] {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (libm::sincos(azimuth_rad), libm::sincos(elevation_rad));
    [cos_e * cos_a, cos_e * sin_a, sin_e]
}

impl SunDirections {
    /// Unit vectors towards the suns of rings, in the order of their beams; nothing of a path, whose beams say it themselves.
    pub fn of_rings(&self) -> Vec<[f64; 3]> {
        let Self::Rings { elevations_rad, counts } = self else { return Vec::new() };
        let ring = |(&elevation, &count): (&f64, &u32)| {
            let step = 2.0 * std::f64::consts::PI / f64::from(count);
            (0..count).map(move |i| towards_sun(step * f64::from(i), elevation))
        };
        elevations_rad.iter().zip(counts).flat_map(ring).collect()
    }

    /// The beams whose light mixes to that of a sun in direction `towards` (unit), by their place among `suns` (unit vectors towards
    /// those baked), with weights that sum to 1; `None` for a sun that they do not cover.
    ///
    /// Between rings and within each it is linear in the angle, along a path too.
    pub fn weights(&self, suns: &[[f64; 3]], towards: [f64; 3]) -> Option<Vec<(usize, f64)>> {
        let mut weights: Vec<(usize, f64)> = match self {
            Self::Rings { elevations_rad, counts } => ring_weights(elevations_rad, counts, towards)?,
            Self::Path => path_weights(suns, towards)?,
        };
        weights.retain(|&(beam, weight)| weight > 0.0 && beam < suns.len());
        Some(weights)
    }
}

fn ring_weights(elevations: &[f64], counts: &[u32], towards: [f64; 3]) -> Option<Vec<(usize, f64)>> {
    let flat = libm::sqrt(towards[0] * towards[0] + towards[1] * towards[1]);
    let elevation = libm::atan2(towards[2], flat);
    let (lowest, highest) = (*elevations.first()?, *elevations.last()?);
    if elevation < lowest - SUN_TOLERANCE_RAD || elevation > highest + SUN_TOLERANCE_RAD {
        return None;
    }
    let elevation = elevation.clamp(lowest, highest);
    let upper = elevations.iter().position(|&ring| ring >= elevation)?;
    let lower = upper.saturating_sub(1);
    let share = match upper {
        0 => 0.0,
        _ => (elevation - elevations[lower]) / (elevations[upper] - elevations[lower]),
    };
    let azimuth = libm::atan2(towards[1], towards[0]) / (2.0 * std::f64::consts::PI);
    let mut weights = Vec::with_capacity(4);
    for (ring, weight) in [(lower, 1.0 - share), (upper, share)] {
        let first: usize = counts[..ring].iter().map(|&count| count as usize).sum();
        let count = counts[ring] as usize;
        let at = (azimuth - azimuth.floor()) * count as f64;
        // A turn less nearly nothing rounds to a whole one: the first beam again.
        let (low, part) = (at as usize % count, at - at.floor());
        weights.push((first + low, weight * (1.0 - part)));
        weights.push((first + (low + 1) % count, weight * part));
    }
    Some(weights)
}

fn path_weights(suns: &[[f64; 3]], towards: [f64; 3]) -> Option<Vec<(usize, f64)>> {
    let near = |sun: &[f64; 3]| angle(*sun, towards) <= SUN_TOLERANCE_RAD;
    for (at, pair) in suns.windows(2).enumerate() {
        let (a, b) = (pair[0], pair[1]);
        let step = angle(a, b);
        // Across the great circle through both, and along it.
        let normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let size = libm::sqrt(dot(normal, normal));
        if size <= 0.0 {
            continue;
        }
        let aside = libm::asin((dot(normal, towards) / size).clamp(-1.0, 1.0));
        let ahead = [0, 1, 2].map(|axis: usize| b[axis] - a[axis] * dot(a, b));
        let along = libm::atan2(dot(ahead, towards) / libm::sqrt(dot(ahead, ahead)), dot(a, towards));
        if aside.abs() <= SUN_TOLERANCE_RAD && (0.0..=step).contains(&along) {
            let share = along / step;
            return Some(vec![(at, 1.0 - share), (at + 1, share)]);
        }
    }
    suns.iter().position(near).map(|at| vec![(at, 1.0)])
}

impl SunDirections {
    /// Checks the directions against the beams of their head.
    pub(super) fn check(&self, suns: &[[f64; 3]]) -> Result<(), ReadError> {
        if suns.is_empty() {
            return Err(invalid(None, "sun", "at least one beam of it", "none".into()));
        }
        let Self::Rings { elevations_rad, counts } = self else { return Ok(()) };
        let rising = elevations_rad.windows(2).all(|pair| pair[0] < pair[1]);
        // A quarter turn, rounded up.
        const STEEPEST_RAD: f64 = std::f64::consts::FRAC_PI_2 + 4e-6;
        let within = elevations_rad.iter().all(|elevation| elevation.abs() <= STEEPEST_RAD);
        let as_many = elevations_rad.len() == counts.len() && counts.len() <= MOST_RINGS;
        if !(rising && within && as_many) {
            let found = format!("{} elevations, {} counts", elevations_rad.len(), counts.len());
            return Err(invalid(
                None,
                "sun's rings",
                "rising elevations within 90 degrees, a count each",
                found,
            ));
        }
        let beams: u64 = counts.iter().map(|&count| u64::from(count)).sum();
        if counts.contains(&0) || beams != suns.len() as u64 {
            let found = format!("{beams} for {}", suns.len());
            return Err(invalid(None, "sun's rings", "as many beams as the head has of the sun", found));
        }
        let off = |(ring, beam): (&[f64; 3], &[f64; 3])| angle(*ring, *beam) > 1e-6;
        match self.of_rings().iter().zip(suns).position(off) {
            None => Ok(()),
            Some(at) => Err(invalid(None, "sun's beams", "those of its rings", format!("{:?}", suns[at]))),
        }
    }
}

impl ResponseHead {
    /// Unit vectors towards the suns whose beams were baked, in their order.
    pub fn suns(&self) -> Vec<[f64; 3]> {
        let sun = |source: &super::DistantSource| match source.kind {
            super::DistantKind::Sun { direction } => Some(direction.map(|value| -value)),
            _ => None,
        };
        self.distant.iter().filter_map(sun).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_whole_turn_is_the_first_beam_again() {
        let rings = SunDirections::Rings { elevations_rad: vec![0.5], counts: vec![12] };
        let suns = rings.of_rings();
        for turns in [0.0, 1.0, -1.0, 2.0, 29.0] {
            let azimuth = turns * 2.0 * std::f64::consts::PI;
            let (up, flat) = (libm::sin(0.5), libm::cos(0.5));
            let towards = [flat * libm::cos(azimuth), flat * libm::sin(azimuth), up];
            let weights = rings.weights(&suns, towards).unwrap();
            let first: f64 = weights.iter().filter(|(beam, _)| *beam == 0).map(|(_, weight)| weight).sum();
            assert!((first - 1.0).abs() < 1e-9, "{turns} turns: {weights:?}");
        }
    }

    fn rings() -> SunDirections {
        let elevations_rad = [-4.0f64, 27.0, 58.0, 90.0].map(f64::to_radians).to_vec();
        SunDirections::Rings { elevations_rad, counts: vec![12, 11, 6, 1] }
    }

    /// Round-off of angles.
    const ROUND_OFF: f64 = 1e-9;

    #[test]
    fn a_baked_sun_is_its_own_beam_and_weights_sum_to_one_between_them() {
        let rings = rings();
        let suns = rings.of_rings();
        assert_eq!(suns.len(), 30);
        for (at, &sun) in suns.iter().enumerate() {
            let weights = rings.weights(&suns, sun).unwrap();
            let own: f64 = weights.iter().filter(|(beam, _)| *beam == at).map(|(_, weight)| weight).sum();
            assert!((own - 1.0).abs() < ROUND_OFF, "{at}: {weights:?}");
        }
        for i in 0..500 {
            let (azimuth, elevation) = (0.7 * f64::from(i), -0.06 + 1.6 * f64::from(i) / 500.0);
            let weights = rings.weights(&suns, towards_sun(azimuth, elevation)).unwrap();
            let sum: f64 = weights.iter().map(|(_, weight)| weight).sum();
            assert!((sum - 1.0).abs() < ROUND_OFF && weights.iter().all(|(beam, _)| *beam < 30));
        }
    }

    #[test]
    fn a_sun_below_the_lowest_ring_or_beside_a_path_is_not_covered() {
        let rings = rings();
        let suns = rings.of_rings();
        assert!(rings.weights(&suns, towards_sun(1.0, (-4.4f64).to_radians())).is_some());
        assert!(rings.weights(&suns, towards_sun(1.0, (-6.0f64).to_radians())).is_none());
        let path = [0.0, 0.1, 0.2].map(|azimuth| towards_sun(azimuth, 0.3));
        let at = |azimuth, elevation| SunDirections::Path.weights(&path, towards_sun(azimuth, elevation));
        let own: Vec<_> =
            at(0.1, 0.3).unwrap().into_iter().filter(|(_, weight)| *weight > ROUND_OFF).collect();
        assert!(own.len() == 1 && own[0].0 == 1, "{own:?}");
        let between = at(0.05, 0.3).unwrap();
        assert!((between[0].1 - 0.5).abs() < 1e-3 && between.len() == 2, "{between:?}");
        assert_eq!((at(0.05, 0.4), at(0.4, 0.3), at(-0.1, 0.3)), (None, None, None));
        assert_eq!(SunDirections::Path.weights(&path[..1], path[0]), Some(vec![(0, 1.0)]));
    }
}
