//! Street lamps on a town: where each one's light reaches, and which of them a spot can leave out.
//!
//! A lamp stands still and so does the town, so what it reaches is traced once: the nearest box or hill in 64 × 64 directions, tile by
//! tile as they are asked for, each between four of them. A box is convex: its own faces never shade themselves, whatever the map's steps say.

mod lanes;
#[cfg(feature = "gpu")]
mod upload;

pub(super) use lanes::LampLanes;

use super::boxes::beam::Bundle;
use super::{Hit, Thing, Town};
use crate::octahedron::{fold, unfold};
use crate::shade::town::light::{Lighting, SceneLight};
use glam::Vec3;
use squall_formats::section::town::StreetLamp;
use std::sync::OnceLock;

/// Directions along each side of a lamp's map.
pub(super) const SIDE: usize = 64;
/// Edge of a tile of the map, and tiles along each side: a fourth of the side is a whole number of them, so that the octahedron's edges
/// run along borders and diagonals.
const EDGE: usize = 8;
const ACROSS: usize = SIDE / EDGE;
/// A thing this much nearer than a spot is before it, as a share of the distance.
const NEARER: f32 = 0.02;
/// Lamps that add less than this share of what a spot has are left out.
const LEAST: f32 = 1e-4;
/// A texel without a block.
const NO_BLOCK: u32 = u32::MAX;

/// What stands nearest to a lamp in one direction.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    metres: f32,
    block: u32,
}

/// What one lamp reaches, tile by tile of its map; each is traced when it is first asked for.
#[derive(Debug)]
pub struct LampReach {
    place: Vec3,
    tiles: Vec<OnceLock<Box<[Nearest; EDGE * EDGE]>>>,
}

impl LampReach {
    /// A lamp at `place` whose reach is not known yet.
    fn new(place: Vec3) -> Self {
        Self { place, tiles: (0..ACROSS * ACROSS).map(|_| OnceLock::new()).collect() }
    }

    /// A tile of the map.
    fn tile(&self, town: &Town, number: usize) -> &[Nearest; EDGE * EDGE] {
        self.tiles[number].get_or_init(|| {
            let (left, top) = (number % ACROSS * EDGE, number / ACROSS * EDGE);
            let bundle = Bundle::new(self.place, &corners([left, top].map(|at| at as f32)));
            let (boxes, has_hills) = (town.boxes.ahead(&bundle), town.has_hills_ahead(&bundle));
            let texel = |i: usize| {
                let at = [left + i % EDGE, top + i / EDGE];
                let [x, y] = at.map(|at| (2 * at + 1) as f64 / SIDE as f64 - 1.0);
                let direction = unfold(x, y).as_vec3();
                let hills = town.hills.as_ref().filter(|_| has_hills);
                let hill = hills.and_then(|hills| hills.meet(self.place, direction, f32::MAX));
                let metres = hill.map_or(f32::MAX, |(metres, _)| metres);
                match town.boxes.meet_ahead(&boxes, self.place, direction, metres) {
                    Some(hit) => Nearest { metres: hit.distance, block: hit.block as u32 },
                    None => Nearest { metres, block: NO_BLOCK },
                }
            };
            Box::new(std::array::from_fn(texel))
        })
    }

    /// A texel of the map.
    fn texel(&self, town: &Town, [x, y]: [usize; 2]) -> Nearest {
        self.tile(town, y / EDGE * ACROSS + x / EDGE)[y % EDGE * EDGE + x % EDGE]
    }

    /// Share of the lamp that reaches a spot `way` from it, in [0, 1]; `block` is what the spot is on.
    fn share(&self, town: &Town, way: Vec3, block: u32) -> f32 {
        let near = way.length() * (1.0 - NEARER);
        let place = |v: f32| {
            let at = (v * 0.5 + 0.5) * SIDE as f32 - 0.5;
            let at = if at > 0.0 { at } else { 0.0 };
            if at < (SIDE - 1) as f32 { at } else { (SIDE - 1) as f32 }
        };
        let [x, y] = fold(way);
        let (x, y) = (place(x), place(y));
        let (column, row) = ((x as usize).min(SIDE - 2), (y as usize).min(SIDE - 2));
        let (u, v) = (x - column as f32, y - row as f32);
        let lit =
            |texel: Nearest| f32::from(texel.metres >= near || (texel.block == block && block != NO_BLOCK));
        let (within_x, within_y) = (column % EDGE, row % EDGE);
        let tile = self.tile(town, row / EDGE * ACROSS + column / EDGE);
        let at = within_y * EDGE + within_x;
        let (a, b, c, d) = if within_x + 1 < EDGE && within_y + 1 < EDGE {
            (lit(tile[at]), lit(tile[at + 1]), lit(tile[at + EDGE]), lit(tile[at + EDGE + 1]))
        } else {
            let beside = |x: usize, y: usize| lit(self.texel(town, [x, y]));
            let (right, below) = (column + 1, row + 1);
            (lit(tile[at]), beside(right, row), beside(column, below), beside(right, below))
        };
        let (top, bottom) = (a + u * (b - a), c + u * (d - c));
        top + v * (bottom - top)
    }
}

/// Directions to the corners of a tile whose first texel is at (x, y): between them directions of this length are linear, or are on
/// either side of one of the tile's diagonals, so that a box around the corners holds them all.
fn corners([x, y]: [f32; 2]) -> [Vec3; 4] {
    let edge = EDGE as f32;
    let place = |at: f32| 2.0 * at / SIDE as f32 - 1.0;
    let signs = [x, y].map(|at| place(at + 0.5 * edge).signum());
    [[0.0, 0.0], [edge, 0.0], [0.0, edge], [edge, edge]].map(|[dx, dy]| {
        let [x, y] = [place(x + dx), place(y + dy)];
        let z = 1.0 - x.abs() - y.abs();
        match z >= 0.0 {
            true => Vec3::new(x, y, z),
            false => Vec3::new((1.0 - y.abs()) * signs[0], (1.0 - x.abs()) * signs[1], z),
        }
    })
}

impl Town {
    /// What lamp `number` reaches.
    fn traced(&self, number: usize) -> &LampReach {
        self.reaches[number].get_or_init(|| LampReach::new(Vec3::from_array(self.lamps[number].position)))
    }

    /// Share of lamp `number` that reaches a spot, past boxes and hills.
    pub(super) fn lamp_share(&self, number: usize, hit: &Hit) -> f32 {
        let block = match hit.thing {
            Thing::Block(number, ..) => number as u32,
            _ => NO_BLOCK,
        };
        self.traced(number).share(self, hit.point - Vec3::from_array(self.lamps[number].position), block)
    }

    /// Share of lamp `number` that reaches a place in the air, past boxes and hills.
    pub(crate) fn lamp_reaches(&self, number: usize, place: Vec3) -> f32 {
        self.traced(number).share(self, place - Vec3::from_array(self.lamps[number].position), NO_BLOCK)
    }

    /// Irradiance of the street lamps on a spot that has `so_far` from other lights, W/m²: each dimmed by the rain on its own way,
    /// shadowed, and left out where it can't add a ten-thousandth.
    pub(super) fn lamp_irradiance(&self, hit: &Hit, lighting: &Lighting, so_far: [f32; 3]) -> [f32; 3] {
        let total = |light: [f32; 3]| light[0] + light[1] + light[2];
        let mut sum = [0.0; 3];
        self.lanes.each_above((hit.point, hit.normal), (LEAST, total(so_far)), |number, own| {
            let (reach, lamp) = (self.lamp_share(number, hit), &self.lamps[number]);
            if reach > 0.0 {
                let share = reach * lighting.rain.left(hit.point, Vec3::from_array(lamp.position));
                let share = share * own / total(lamp.intensity);
                (0..3).for_each(|band| sum[band] += share * lamp.intensity[band]);
            }
        });
        sum
    }

    /// Calls `shown` for the lamps that may have a highlight on rippled water of this slope at a spot, with their numbers.
    pub(super) fn each_lamp_in_water(
        &self,
        hit: &Hit,
        to_viewer: Vec3,
        slope: f32,
        mut shown: impl FnMut(usize, SceneLight),
    ) {
        self.lanes.each_in_water((hit.point, hit.normal), to_viewer, slope, |number| {
            shown(number, Self::street_light(&self.lamps[number]));
        });
    }

    fn street_light(lamp: &StreetLamp) -> SceneLight {
        SceneLight { position: Vec3::from_array(lamp.position), intensity: lamp.intensity, visibility: 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::town::tests::small_town;

    #[test]
    fn every_direction_of_a_lamps_map_has_what_its_own_ray_meets() {
        let town = small_town();
        for place in [Vec3::new(3.0, 70.0, 7.0), Vec3::new(-40.0, 130.0, 30.0)] {
            let reach = LampReach::new(place);
            let mut met = 0;
            for at in 0..SIDE * SIDE {
                let [x, y] = [at % SIDE, at / SIDE].map(|at| (2 * at + 1) as f64 / SIDE as f64 - 1.0);
                let direction = unfold(x, y).as_vec3();
                let hill = town.hills.as_ref().and_then(|hills| hills.meet(place, direction, f32::MAX));
                let limit = hill.map_or(f32::MAX, |(metres, _)| metres);
                let wanted = town.boxes.meet(place, direction, limit).map_or(limit, |hit| hit.distance);
                let (x, y) = (at % SIDE, at / SIDE);
                let found = reach.tile(&town, y / EDGE * ACROSS + x / EDGE)[y % EDGE * EDGE + x % EDGE];
                assert_eq!(found.metres, wanted, "{direction}");
                met += usize::from(wanted < f32::MAX);
            }
            assert!(met > 40, "{met}");
        }
    }

    #[test]
    fn a_lamp_reaches_what_rays_reach() {
        let town = small_town();
        let lamp = Vec3::from_array(town.lamps[0].position);
        let spot = |target: Vec3, eye: Vec3| town.trace(eye, (target - eye).normalize(), 1e4).unwrap();
        let (mut same, mut all) = (0, 0);
        for i in 0..60 {
            for k in 0..60 {
                let on = Vec3::new(i as f32 * 4.0 - 118.0, k as f32 * 5.0 - 20.0, 0.0);
                let hit = spot(on, on + Vec3::new(0.0, 0.0, 300.0));
                if hit.thing != Thing::Ground {
                    continue;
                }
                let traced = !town.is_blocked(Town::lifted(&hit), lamp);
                let share = town.lamp_share(0, &hit);
                all += 1;
                same += usize::from((share > 0.5) == traced);
            }
        }
        // The map's steps are 3° wide: only spots at a shadow's edge may differ.
        assert!(same as f64 > 0.98 * f64::from(all), "{same} of {all}");
        let wall = spot(Vec3::new(2.0, 100.0, 20.0), Vec3::new(0.0, 0.0, 2.0));
        assert_eq!(town.lamp_share(0, &wall), 1.0, "the lit face of a box doesn't shade itself");
        let behind = spot(Vec3::new(0.0, 125.0, 0.0), Vec3::new(0.0, 200.0, 100.0));
        assert!(town.lamp_share(0, &behind) < 0.05, "behind the tower");
    }
}
