//! A town and the wet ground before it: what a ray meets, what it is made of, how it is lit.
//!
//! Built from a `TOWN` section at load: a tree over a few hundred boxes, the puddles' water line. [`frame`] renders a
//! whole picture with depth; the pieces can be called alone. Light that leaves the town upwards is the caller's: a
//! closure says what a ray sees that meets nothing, so that puddles mirror the sky, the lit cloud and the flash.

pub mod boxes;
pub mod facade;
pub mod frame;
mod grain;
pub mod ground;
pub mod hills;
mod lamps;
pub mod light;
pub mod line;
pub(crate) mod panes;
pub mod rain;
mod shadow;
mod shelter;
#[cfg(feature = "gpu")]
pub(crate) mod upload;

use boxes::{BoxHit, Boxes};
use facade::Wall;
use glam::{Vec2, Vec3};
use ground::Material;
use hills::Hills;
use squall_formats::section::town::{Block, StreetLamp, TownSection};
use std::sync::OnceLock;

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Thing {
    /// The flat ground at z = 0.
    Ground,
    /// A hill of the height map.
    Hill,
    /// Block of this number, with the wall's number (none: roof or underside) and the place on that wall, m.
    Block(usize, Option<u32>, Vec2),
}

/// Where a ray ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Along the ray, m.
    pub distance: f32,
    /// The point itself, m.
    pub point: Vec3,
    /// Unit normal on the side that the ray came from.
    pub normal: Vec3,
    /// What it is.
    pub thing: Thing,
}

/// What a spot is made of and what it sends by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Share of light reflected all around, per colour, in [0, 1].
    pub albedo: [f32; 3],
    /// Radiance that it sends by itself (lit windows), W/(m² sr).
    pub emission: [f32; 3],
    /// Share that is smooth glass, in [0, 1].
    pub glass: f32,
    /// Share under a water surface, in [0, 1].
    pub wet: f32,
    /// Root mean square slope of that water.
    pub slope: f32,
}

impl Surface {
    fn ground(soil: ground::Soil) -> Self {
        Self { albedo: soil.albedo, emission: [0.0; 3], glass: 0.0, wet: soil.wet, slope: soil.slope }
    }
}

/// A town ready for rays.
pub struct Town {
    blocks: Vec<Block>,
    boxes: Boxes,
    hills: Option<Hills>,
    material: Material,
    lamps: Vec<StreetLamp>,
    lanes: lamps::LampLanes,
    reaches: Vec<OnceLock<lamps::LampReach>>,
}

/// Rays start this far off a surface, relative to their distance from the origin, so as not to meet it again.
const LIFT: f32 = 2e-5;

/// Ground farther than this is behind every horizon; the fourth power of a distance, which light from points takes, would leave
/// single precision soon after.
const FARTHEST_GROUND_M: f32 = 1e9;

impl Town {
    /// Prepares a section that was read (and so checked).
    pub fn new(section: &TownSection) -> Self {
        Self {
            blocks: section.blocks.clone(),
            boxes: Boxes::new(&section.blocks),
            hills: section.hills.as_ref().map(Hills::new),
            material: Material::new(&section.ground),
            lamps: section.lamps.clone(),
            lanes: lamps::LampLanes::new(&section.lamps),
            reaches: section.lamps.iter().map(|_| OnceLock::new()).collect(),
        }
    }

    /// The street lamps.
    pub fn lamps(&self) -> &[StreetLamp] {
        &self.lamps
    }

    /// The first thing along a ray from `origin` (m) in unit `direction`, nearer than `limit` m.
    pub fn trace(&self, origin: Vec3, direction: Vec3, limit: f32) -> Option<Hit> {
        let boxes = |limit: f32| self.boxes.meet(origin, direction, limit);
        Self::first_of(self.hills.as_ref(), boxes, (origin, direction, limit))
    }

    /// What a ray meets first of the ground, these hills and the boxes that `boxes` finds nearer than a limit.
    fn first_of(
        hills: Option<&Hills>,
        boxes: impl FnOnce(f32) -> Option<BoxHit>,
        (origin, direction, limit): (Vec3, Vec3, f32),
    ) -> Option<Hit> {
        let mut found = None;
        let mut nearest = limit;
        if direction.z < 0.0 && origin.z > 0.0 {
            let distance = -origin.z / direction.z;
            if distance < nearest.min(FARTHEST_GROUND_M) {
                (nearest, found) = (distance, Some((Vec3::Z, Thing::Ground)));
            }
        }
        if let Some((distance, normal)) = hills.and_then(|hills| hills.meet(origin, direction, nearest)) {
            (nearest, found) = (distance, Some((normal, Thing::Hill)));
        }
        if let Some(hit) = boxes(nearest) {
            (nearest, found) =
                (hit.distance, Some((hit.normal, Thing::Block(hit.block, hit.wall, hit.on_wall))));
        }
        found.map(|(normal, thing)| Hit {
            distance: nearest,
            point: origin + direction * nearest,
            normal,
            thing,
        })
    }

    /// Whether anything stands between two points.
    pub fn is_blocked(&self, from: Vec3, to: Vec3) -> bool {
        let way = to - from;
        let length = way.length();
        if length == 0.0 {
            return false;
        }
        let (direction, limit) = (way / length, length * (1.0 - 1e-4));
        let under = from.z > 0.0 && from.z + direction.z * limit < 0.0;
        under
            || self.boxes.is_met(from, direction, limit)
            || self.hills.as_ref().is_some_and(|hills| hills.meet(from, direction, limit).is_some())
    }

    /// A point just off the surface, where rays may start.
    fn lifted(hit: &Hit) -> Vec3 {
        hit.point + hit.normal * (LIFT * (1.0 + hit.point.abs().max_element()))
    }

    /// The same of ground that is made of one thing for `extent` m around; none elsewhere.
    fn even_surface(&self, hit: &Hit, footprint: f32, extent: f32) -> Option<Surface> {
        let soil = match hit.thing {
            Thing::Ground => self.material.sample_even(hit.point.truncate(), footprint, extent)?,
            _ => return None,
        };
        Some(Surface::ground(soil))
    }

    /// What the spot is made of, averaged over `footprint` m.
    pub fn surface(&self, hit: &Hit, footprint: f32) -> Surface {
        match hit.thing {
            Thing::Ground => Surface::ground(self.material.sample(hit.point.truncate(), footprint)),
            Thing::Hill => {
                let soil = self.material.sample(hit.point.truncate(), footprint);
                Surface { albedo: soil.albedo, emission: [0.0; 3], glass: 0.0, wet: 0.0, slope: 1.0 }
            }
            Thing::Block(number, wall, on_wall) => {
                let block = &self.blocks[number];
                let seen = match (&block.windows, wall) {
                    (Some(windows), Some(wall)) => {
                        let length = 2.0 * block.half[1 - wall as usize % 2];
                        Wall::sample(windows, wall, on_wall, Vec2::new(length, block.height), footprint)
                    }
                    _ => Wall::default(),
                };
                // What a room behind glass reflects is little and dark.
                let albedo = block.albedo.map(|value| value * (1.0 - 0.9 * seen.glass));
                Surface { albedo, emission: seen.emission, glass: seen.glass, wet: 0.0, slope: 1.0 }
            }
        }
    }

    /// Height of the highest thing over the centre of every cell of a grid, m: what keeps rain off. `origin` is
    /// the grid's lowest corner, cells run x fastest.
    pub fn roof_heights(&self, origin: Vec2, cell: f32, counts: [usize; 2]) -> Vec<f32> {
        (0..counts[0] * counts[1])
            .map(|i| {
                let at = Vec2::new((i % counts[0]) as f32, (i / counts[0]) as f32);
                let spot = origin + (at + 0.5) * cell;
                let ground = self.hills.as_ref().map_or(0.0, |hills| hills.height(spot));
                self.boxes.roof(spot).unwrap_or(0.0).max(ground)
            })
            .collect()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use squall_formats::section::town::{Ground, HeightMap, Road, Windows};

    /// A flooded square of asphalt, one tower 100 m north with one mast on it, one lamp, a ridge behind.
    pub(crate) fn small_town() -> Town {
        let windows = Windows { pitch: [3.0, 3.0], glass: 0.5, lit: 1.0, radiance: [0.3, 0.2, 0.1], seed: 1 };
        let tower = Block {
            centre: [0.0, 110.0],
            half: [10.0, 10.0],
            foot: 0.0,
            height: 60.0,
            yaw: 0.0,
            albedo: [0.3; 3],
            windows: Some(windows),
        };
        let mast = Block { half: [0.2, 0.2], foot: 60.0, height: 10.0, windows: None, ..tower.clone() };
        let road = Road { from: [0.0, -900.0], to: [0.0, 900.0], half_width: 900.0, albedo: [0.05; 3] };
        Town::new(&TownSection {
            ground: Ground {
                wetness: 1.0,
                puddles: 1.0,
                ripple: 0.01,
                roads: vec![road],
                ..Ground::default()
            },
            blocks: vec![tower, mast],
            lamps: vec![StreetLamp { position: [4.0, 30.0, 8.0], intensity: [10.0, 8.0, 5.0] }],
            hills: Some(HeightMap {
                origin: [-1_000.0, 2_000.0],
                cell: [2_000.0, 100.0],
                counts: [2, 3],
                step: 0.1,
                heights: vec![0, 0, 500, 500, 0, 0],
            }),
        })
    }

    impl Town {
        /// The same with other lamps, and with more blocks.
        pub(crate) fn with(mut self, lamps: Vec<StreetLamp>, more: &[Block]) -> Self {
            self.blocks.extend_from_slice(more);
            self.boxes = Boxes::new(&self.blocks);
            self.lanes = lamps::LampLanes::new(&lamps);
            let reaches = lamps.iter().map(|_| OnceLock::new()).collect();
            Self { lamps, reaches, ..self }
        }
    }

    #[test]
    fn rays_end_on_what_stands_first() {
        let town = small_town();
        let eye = Vec3::new(0.0, 0.0, 2.0);
        let towards = |target: Vec3| town.trace(eye, (target - eye).normalize(), 1e5);
        let wall = towards(Vec3::new(0.0, 100.0, 20.0)).unwrap();
        assert!(matches!(wall.thing, Thing::Block(0, Some(3), _)), "{wall:?}");
        assert!((wall.point - Vec3::new(0.0, 100.0, 20.0)).length() < 1e-3);
        assert_eq!(towards(Vec3::new(5.0, 40.0, 0.0)).unwrap().thing, Thing::Ground);
        assert_eq!(towards(Vec3::new(300.0, 2_090.0, 30.0)).unwrap().thing, Thing::Hill);
        assert!(towards(Vec3::new(300.0, 2_000.0, 300.0)).is_none());
        assert!(town.is_blocked(eye, Vec3::new(0.0, 200.0, 10.0)));
        assert!(!town.is_blocked(eye, Vec3::new(50.0, 200.0, 10.0)));
    }

    #[test]
    fn roofs_and_hills_keep_rain_off_the_ground_below() {
        let heights = small_town().roof_heights(Vec2::new(-1.0, 99.0), 2.0, [1, 1_000]);
        assert_eq!(heights[0], 0.0, "before the wall");
        assert_eq!(heights[2], 60.0, "on the roof");
        assert_eq!(heights[5], 70.0, "on the mast");
        assert!((heights[999] - 48.5).abs() < 1.0, "on the ridge: {}", heights[999]);
    }
}
