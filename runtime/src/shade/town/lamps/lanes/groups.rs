//! Lamps that stand together: a bound on what they add, and whether any of them may shine in water.

use super::LANES;
use crate::shade::town::line::{Ball, Place};
use glam::Vec3;
use squall_formats::section::town::StreetLamp;
use std::ops::Range;

/// Eights of a group.
const EIGHTS: usize = 4;
/// Bits of a place along each axis of the curve.
const BITS: u32 = 16;

/// Some eights of lamps.
pub(super) struct Group {
    pub eights: Range<usize>,
    low: Vec3,
    high: Vec3,
    ball: Ball,
    /// Sum of the colours of all their intensities, W/sr, with more than round-off.
    light: f32,
}

impl Group {
    /// All lamps in this order.
    pub fn of(order: &[u32], lamps: &[StreetLamp]) -> Vec<Self> {
        let group = |(number, members): (usize, &[u32])| {
            let lamps = || members.iter().map(|&number| &lamps[number as usize]);
            let places: Vec<Vec3> = lamps().map(|lamp| Vec3::from_array(lamp.position)).collect();
            let first = number * EIGHTS;
            Self {
                eights: first..first + members.len().div_ceil(LANES),
                low: places.iter().copied().fold(Vec3::INFINITY, Vec3::min),
                high: places.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max),
                ball: Ball::of(&places),
                light: 1.0001 * lamps().map(|lamp| lamp.intensity.iter().sum::<f32>()).sum::<f32>(),
            }
        };
        order.chunks(EIGHTS * LANES).enumerate().map(group).collect()
    }

    /// What the lamps add to any surface at `point` at most, the sum of the colours, W/m².
    pub fn most_at(&self, point: Vec3) -> f32 {
        let squared = point.clamp(self.low, self.high).distance_squared(point).max(1e-6);
        self.light / squared
    }

    /// Whether any of them may have a highlight at a place of water.
    pub fn may_shine(&self, place: &Place) -> bool {
        !self.ball.has_no_image(place)
    }
}

/// Numbers of the lamps along a curve over the ground that visits neighbours one after the other: bits of x and y by turns.
pub(super) fn along_a_curve(lamps: &[StreetLamp]) -> Vec<u32> {
    let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for lamp in lamps {
        for axis in 0..2 {
            (low[axis], high[axis]) =
                (low[axis].min(lamp.position[axis]), high[axis].max(lamp.position[axis]));
        }
    }
    let edge = (high[0] - low[0]).max(high[1] - low[1]).max(f32::MIN_POSITIVE);
    let key = |number: u32| {
        let place = lamps[number as usize].position;
        let steps = [0, 1].map(|axis: usize| ((place[axis] - low[axis]) / edge * f32::from(u16::MAX)) as u64);
        (0..BITS).fold(0, |key, bit| {
            key | (steps[0] >> bit & 1) << (2 * bit) | (steps[1] >> bit & 1) << (2 * bit + 1)
        })
    };
    let mut order: Vec<u32> = (0..lamps.len() as u32).collect();
    order.sort_by_key(|&number| (key(number), number));
    order
}
