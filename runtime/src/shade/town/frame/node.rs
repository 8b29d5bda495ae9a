//! Light at a node of a picture, and where it may stand for that of a pixel beside it.

use super::super::light::{Parts, Shading};
use super::super::{Hit, Surface, Thing};

/// Cosine between normals, and distance from each other's plane as a share of the distance to the eye, within which two places of a
/// bent surface are one's neighbours.
const BENT: (f32, f32) = (0.97, 0.02);
/// The same of flat ones, which differ by round-off alone.
const FLAT: (f32, f32) = (0.9999, 1e-4);
/// Share by which the slopes of two places' water may differ.
pub(super) const ROUGHNESS: f32 = 0.2;

/// What was worked out at a node.
pub(super) struct Node<const N: usize> {
    pub hit: Hit,
    pub surface: Surface,
    pub irradiance: Parts<N>,
    pub pane: Option<Parts<N>>,
    pub mirrored: Option<(Parts<N>, f32)>,
}

impl<const N: usize> Node<N> {
    pub fn shading(&self) -> Shading<N> {
        Shading { irradiance: self.irradiance, pane: self.pane, mirrored: self.mirrored }
    }

    /// Whether water here mirrors as that of `surface` does.
    pub fn is_as_rough(&self, surface: &Surface) -> bool {
        self.surface.is_as_rough(surface)
    }
}

impl Surface {
    /// Whether water on both has nearly the same slope.
    pub(super) fn is_as_rough(&self, other: &Self) -> bool {
        (self.slope - other.slope).abs() <= ROUGHNESS * self.slope.min(other.slope)
    }

    /// What several samples show together; the slope is that of their water.
    pub(super) fn mean(samples: impl Iterator<Item = Self>) -> Self {
        let mut sum = Self { albedo: [0.0; 3], emission: [0.0; 3], glass: 0.0, wet: 0.0, slope: 0.0 };
        let (mut count, mut slope) = (0.0f32, 0.0);
        for one in samples {
            for band in 0..3 {
                sum.albedo[band] += one.albedo[band];
                sum.emission[band] += one.emission[band];
            }
            sum.glass += one.glass;
            sum.wet += one.wet;
            sum.slope += one.wet * one.slope;
            slope += one.slope;
            count += 1.0;
        }
        let share = 1.0 / count.max(1.0);
        Self {
            albedo: sum.albedo.map(|value| value * share),
            emission: sum.emission.map(|value| value * share),
            glass: sum.glass * share,
            wet: sum.wet * share,
            slope: if sum.wet > 0.0 { sum.slope / sum.wet } else { slope * share },
        }
    }
}

/// Whether two places are on one surface of the town, flat or nearly so.
pub(super) fn same_surface(a: &Hit, b: &Hit) -> bool {
    let (cosine, off) = match (a.thing, b.thing) {
        (Thing::Ground, Thing::Ground) => return true,
        (Thing::Hill, Thing::Hill) => BENT,
        (Thing::Block(one, ..), Thing::Block(other, ..)) if one == other => FLAT,
        _ => return false,
    };
    a.normal.dot(b.normal) > cosine
        && (b.point - a.point).dot(a.normal).abs() <= off * (1.0 + a.distance.max(b.distance))
}

/// Whether two lights differ by `tolerance` of the brighter at most, each stroke's own too.
pub(super) fn similar<const N: usize>(low: &Parts<N>, high: &Parts<N>, tolerance: f32) -> bool {
    let near = |low: &[f32; 3], high: &[f32; 3]| {
        let [low, high] = [low, high].map(|light| light[0] + light[1] + light[2]);
        high - low <= tolerance * high
    };
    tolerance == f32::INFINITY
        || near(&low.base, &high.base) && low.strokes.iter().zip(&high.strokes).all(|(a, b)| near(a, b))
}
