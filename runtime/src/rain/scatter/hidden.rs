//! What of a streak the scene hides: tile by tile where that is all or nothing, pixel by pixel elsewhere.

use crate::camera::Secants;
use crate::depth::{DepthBuffer, DepthKind};
use crate::rain::kernel::{Clip, Footprint};
use crate::rain::streak::Streak;

/// Planar depths between which all of the scene in a tile stands.
#[derive(Clone, Copy)]
pub(super) struct Reach([f32; 2]);

/// Where in a tile a streak may be seen.
pub(super) enum Seen {
    Everywhere,
    InPlaces,
    Nowhere,
}

impl Reach {
    /// Open sky.
    pub const OPEN: Self = Self([f32::INFINITY; 2]);
    /// What round-off of a depth may be.
    const SLACK: f32 = 1e-5;

    pub fn new(buffer: &DepthBuffer, secants: &Secants, clip: Clip) -> Self {
        let Clip { left, top, right, bottom } = clip;
        let [near, far] = buffer.range(left as usize..right as usize, top as usize..bottom as usize);
        if buffer.kind() == DepthKind::Planar {
            return Self([near, far]);
        }
        // A secant is largest in a corner of the tile, and nowhere below 1.
        let corners = [left, right].into_iter().flat_map(|x| [top, bottom].map(|y| (x, y)));
        let most = corners.map(|(x, y)| secants.at(f64::from(x), f64::from(y))).fold(1.0, f64::max);
        Self([near / most as f32, far])
    }

    pub fn of(&self, streak: &Streak) -> Seen {
        let [near, far] = [f32::min, f32::max].map(|end| end(streak.end_depths[0], streak.end_depths[1]));
        if far * (1.0 + Self::SLACK) <= self.0[0] {
            Seen::Everywhere
        } else if near * (1.0 - Self::SLACK) > self.0[1] {
            Seen::Nowhere
        } else {
            Seen::InPlaces
        }
    }
}

/// Inverse depth along a streak: linear in the picture.
pub(super) struct DepthLine {
    centre: [f64; 2],
    axis: [f64; 2],
    half: f64,
    middle: f64,
    rise: f64,
}

impl DepthLine {
    pub fn new(streak: &Streak, footprint: &Footprint) -> Self {
        let Footprint { centre, axis, length, .. } = *footprint;
        let [a, b] = streak.end_depths.map(|depth| 1.0 / f64::from(depth));
        let rise = if length > 0.0 { (b - a) / length } else { 0.0 };
        Self { centre, axis, half: 0.5 * length, middle: 0.5 * (a + b), rise }
    }

    pub fn hidden(&self, secants: &Secants, buffer: &DepthBuffer, x: usize, y: usize) -> bool {
        let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
        let along = (px - self.centre[0]) * self.axis[0] + (py - self.centre[1]) * self.axis[1];
        let inverse = self.middle + self.rise * along.clamp(-self.half, self.half);
        buffer.planar(x, y, || secants.at(px, py)) * inverse < 1.0
    }
}
