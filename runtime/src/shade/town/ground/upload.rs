//! The ground's material as a graphics card reads it.

use super::Material;
use crate::gpu::town::surface::{TownGround, TownPart};
use glam::Vec2;
use squall_formats::section::town::Road;

/// What stands for a water line that nothing reaches.
const DRY: f32 = 1e9;

impl Material {
    /// How many roads there are.
    pub fn roads(&self) -> usize {
        self.ground.roads.len()
    }

    /// Its numbers, and its roads.
    pub fn upload(&self) -> (TownGround, Vec<TownPart>) {
        let ground = TownGround {
            albedo: self.ground.albedo,
            wetness: self.ground.wetness,
            shores: self.shores.map(|shore| shore.min(DRY)),
            puddle_size: self.ground.puddle_size,
            ripple: self.ground.ripple,
            seed: self.ground.seed,
            roads: self.ground.roads.len() as u32,
            ..TownGround::default()
        };
        let part = |road: &Road| {
            let (from, to) = (Vec2::from_array(road.from), Vec2::from_array(road.to));
            let along = (to - from).normalize_or_zero();
            let [r, g, b] = road.albedo;
            TownPart {
                a: [from.x, from.y, along.x, along.y],
                b: [r, g, b, road.half_width],
                c: [(to - from).length(), 0.0, 0.0, 0.0],
            }
        };
        (ground, self.ground.roads.iter().map(part).collect())
    }
}
