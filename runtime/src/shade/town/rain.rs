//! The rain between two places of a town, as mirrors, panes and lamps look through it.

use glam::Vec3;

/// What rain does on a way that does not begin at the eye; drops on it are never drawn, so all of them belong to the medium.
pub trait RainBetween: Sync {
    /// Share of light that gets from one place to the other, m.
    fn left(&self, from: Vec3, to: Vec3) -> f32;
    /// The same to a piece of a channel, far from the town: near enough, where that is quicker.
    fn left_far(&self, from: Vec3, to: Vec3) -> f32 {
        self.left(from, to)
    }
    /// The same along a ray that ends after `metres`, which may be infinite, and the radiance that rain adds on it, W/(m² sr).
    fn along(&self, from: Vec3, direction: Vec3, metres: f32) -> (f32, [f32; 3]);
    /// Of a distant light in unit direction `towards`: the share that gets to `from`, and the irradiance, for 1 W/m² across its beam,
    /// that rain sends on to a surface whose normal's angle to that direction has the given cosine.
    fn of_beam(&self, from: Vec3, towards: Vec3, cosine: f32) -> [f32; 2];
}

/// Dry weather.
pub struct NoRain;

impl RainBetween for NoRain {
    fn left(&self, _: Vec3, _: Vec3) -> f32 {
        1.0
    }

    fn along(&self, _: Vec3, _: Vec3, _: f32) -> (f32, [f32; 3]) {
        (1.0, [0.0; 3])
    }

    fn of_beam(&self, _: Vec3, _: Vec3, _: f32) -> [f32; 2] {
        [1.0, 0.0]
    }
}
