//! A small town from a seed: a skyline on a plain, a wet road that leads to it, lamps, low hills far behind.
//!
//! The viewer stands near the origin and looks along +y (north); the road runs north to the town, whose middle
//! is some 1.2 km away, a little to the right.

use glam::{Vec2, Vec3};
use squall_formats::section::town::{Block, Ground, HeightMap, Road, StreetLamp, TownSection, Windows};
use squall_runtime::noise::Lattice;
use squall_runtime::random::{Random, hash};

/// Middle of the town, m.
const MIDDLE: Vec2 = Vec2::new(250.0, 1_200.0);
/// Turn of the street grid, rad.
const GRID_TURN: f32 = 0.21;
/// Lot and street width, m.
const LOT: f32 = 44.0;
const STREET: f32 = 16.0;
/// Lots along each side of the built square.
const LOTS: i32 = 27;
/// Where the road starts behind the viewer, where it ends in the town, and how wide half of it is, m.
const ROAD_START: Vec2 = Vec2::new(-16.0, -60.0);
const ROAD_END: Vec2 = Vec2::new(180.0, 870.0);
const ROAD_HALF: f32 = 7.0;
/// Distance between lamps along the road, and their height, m.
const LAMP_STEP: f32 = 38.0;
const LAMP_HEIGHT: f32 = 8.5;
/// Lamps nearer to the road's start than this many steps would stand in the picture's way.
const FIRST_LAMP: i32 = 3;
/// Sodium light, W/sr per channel: about 12 klm.
const SODIUM: [f32; 3] = [3.4, 2.0, 0.55];

struct Builder {
    random: Random,
    blocks: Vec<Block>,
    lamps: Vec<StreetLamp>,
}

/// Makes a town; the same seed gives the same town.
pub fn synth_town(seed: u64) -> TownSection {
    let mut builder =
        Builder { random: Random::from_parts(&[seed, 0x7011]), blocks: Vec::new(), lamps: Vec::new() };
    builder.lots();
    builder.road_lamps(ROAD_START, ROAD_END);
    let road = Road {
        from: ROAD_START.into(),
        to: ROAD_END.into(),
        half_width: ROAD_HALF,
        albedo: [0.055, 0.055, 0.06],
    };
    TownSection {
        ground: Ground {
            albedo: [0.10, 0.11, 0.06],
            wetness: 0.9,
            puddles: 0.6,
            puddle_size: 4.0,
            ripple: 0.018,
            seed: hash(&[seed, 0x7012]) as u32,
            roads: vec![road],
        },
        blocks: builder.blocks,
        lamps: builder.lamps,
        hills: Some(hills(seed)),
    }
}

/// Low ridges behind the town, up to 170 m, rising out of the plain and sinking back into it.
fn hills(seed: u64) -> HeightMap {
    let lattice = Lattice::new(hash(&[seed, 0x7013]) as u32);
    let counts = [81u32, 33];
    let (origin, cell) = ([-32_000.0f32, 8_000.0f32], [800.0f32, 700.0f32]);
    let step = 170.0 / 65_535.0;
    let heights = (0..counts[0] * counts[1])
        .map(|i| {
            let (x, y) = (i % counts[0], i / counts[0]);
            let edge = |i: u32, n: u32| (i.min(n - 1 - i) as f32 / 6.0).min(1.0);
            let p = Vec3::new(x as f32 * 0.14, y as f32 * 0.2, 0.5);
            let ridge = 1.0 - 2.2 * lattice.fractal(p, 4, 0.5).abs();
            let broad = 0.5 + 0.9 * lattice.fractal(p * 0.35, 2, 0.5);
            let height =
                ridge.clamp(0.0, 1.0) * broad.clamp(0.0, 1.0) * edge(x, counts[0]) * edge(y, counts[1]);
            (height * 65_535.0) as u16
        })
        .collect();
    HeightMap { origin, cell, counts, step, heights }
}

/// Distance of a spot from the road's middle line, m.
fn road_distance(spot: Vec2) -> f32 {
    let along = ROAD_END - ROAD_START;
    let share = ((spot - ROAD_START).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    (spot - ROAD_START - along * share).length()
}

impl Builder {
    fn range(&mut self, low: f32, high: f32) -> f32 {
        self.random.range(f64::from(low), f64::from(high)) as f32
    }

    fn chance(&mut self, share: f64) -> bool {
        self.random.unit() < share
    }

    /// Every lot of the street grid that is built on.
    fn lots(&mut self) {
        let (sin, cos) = libm::sincosf(GRID_TURN);
        for row in 0..LOTS {
            for column in 0..LOTS {
                let own = (Vec2::new(column as f32, row as f32) - 0.5 * (LOTS - 1) as f32) * (LOT + STREET);
                let centre = MIDDLE + Vec2::new(own.x * cos - own.y * sin, own.x * sin + own.y * cos);
                // Wider than deep, as seen by the viewer.
                let out = Vec2::new((centre.x - MIDDLE.x) / 1.35, centre.y - MIDDLE.y).length();
                let built = libm::expf(-(out / 420.0) * (out / 420.0));
                if !self.chance(0.12 + 0.85 * f64::from(built)) || out > 700.0 || road_distance(centre) < LOT
                {
                    continue;
                }
                let core = libm::expf(-(out / 190.0) * (out / 190.0));
                let luck = self.range(0.0, 1.0);
                let height = 7.0 + 22.0 * built * luck + 190.0 * core * luck * luck * luck.sqrt();
                if height < 26.0 {
                    self.houses(centre, height);
                } else {
                    self.tower(centre, height);
                }
                if self.chance(0.3) {
                    let corner = centre + Vec2::new(0.5 * (LOT + STREET), 0.5 * (LOT + STREET));
                    let warm = if self.chance(0.7) { SODIUM } else { [2.2, 2.1, 1.9] };
                    self.lamps
                        .push(StreetLamp { position: corner.extend(LAMP_HEIGHT).into(), intensity: warm });
                }
            }
        }
    }

    fn windows(&mut self, lit: f32) -> Windows {
        // From incandescent to office tubes.
        let cold = self.range(0.0, 1.0);
        let cold = cold * cold;
        let level = self.range(0.11, 0.28);
        Windows {
            pitch: [self.range(2.6, 4.4), self.range(3.2, 3.9)],
            glass: self.range(0.28, 0.6),
            lit,
            radiance: [level * (1.3 - 0.35 * cold), level * (0.74 + 0.2 * cold), level * (0.30 + 0.6 * cold)],
            seed: self.random.bits() as u32,
        }
    }

    fn block(&mut self, centre: Vec2, half: Vec2, foot: f32, height: f32) -> Block {
        let shade = self.range(0.12, 0.34);
        let warm = self.range(-0.03, 0.05);
        Block {
            centre: centre.into(),
            half: half.into(),
            foot,
            height,
            yaw: GRID_TURN,
            albedo: [shade + warm, shade, shade - 0.6 * warm],
            windows: None,
        }
    }

    /// A few low houses on one lot.
    fn houses(&mut self, centre: Vec2, height: f32) {
        for _ in 0..1 + self.random.below(2) {
            let half = Vec2::new(self.range(7.0, 16.0), self.range(7.0, 14.0));
            let spread = (0.5 * LOT - half).max(Vec2::ZERO);
            let at = centre + Vec2::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0)) * spread;
            let height = height * self.range(0.7, 1.1);
            let mut house = self.block(at, half, 0.0, height);
            let lit = self.range(0.08, 0.3);
            house.windows = Some(self.windows(lit));
            self.blocks.push(house);
        }
    }

    /// A tower: podium, shaft, perhaps a set-back crown, and something on the roof.
    fn tower(&mut self, centre: Vec2, height: f32) {
        let lit = self.range(0.14, 0.42);
        let windows = self.windows(lit);
        let half = Vec2::new(self.range(10.0, 19.0), self.range(10.0, 19.0));
        let mut shaft = self.block(centre, half, 0.0, height);
        shaft.windows = Some(windows.clone());
        let albedo = shaft.albedo;
        if self.chance(0.4) {
            let tall = self.range(9.0, 18.0);
            let mut podium = self.block(centre, (half * 1.25).min(Vec2::splat(0.5 * LOT)), 0.0, tall);
            podium.windows = Some(Windows { lit: 0.5, ..windows.clone() });
            self.blocks.push(podium);
        }
        let (mut top, mut upper) = (height, half);
        if height > 60.0 && self.chance(0.65) {
            // The upper part steps back once or twice.
            shaft.height = height * self.range(0.62, 0.85);
            top = shaft.height;
            for _ in 0..1 + self.random.below(2) {
                upper *= self.range(0.62, 0.85);
                let tall = (height - top).max(8.0) * self.range(0.5, 1.0);
                let mut crown = self.block(centre, upper, top, tall);
                (crown.albedo, crown.windows) = (albedo, Some(windows.clone()));
                self.blocks.push(crown);
                top += tall;
            }
        }
        self.blocks.push(shaft);
        // Plant room.
        let (room, tall) = (upper * self.range(0.35, 0.6), self.range(2.5, 6.0));
        let plant = self.block(centre, room, top, tall);
        let roof = top + plant.height;
        self.blocks.push(plant);
        if height > 75.0 && self.chance(0.7) {
            self.mast(centre, roof, height);
        }
    }

    /// A mast that tapers in three steps, with a red light on top.
    fn mast(&mut self, centre: Vec2, foot: f32, height: f32) {
        let tall = height * self.range(0.18, 0.4);
        let mut top = foot;
        for (width, share) in [(1.1, 0.45), (0.6, 0.35), (0.25, 0.2)] {
            let piece = self.block(centre, Vec2::splat(width), top, tall * share);
            top += piece.height;
            self.blocks.push(piece);
        }
        self.lamps
            .push(StreetLamp { position: centre.extend(top + 0.5).into(), intensity: [5.0, 0.25, 0.15] });
    }

    /// Lamps on masts along both sides of a road, in turn.
    fn road_lamps(&mut self, from: Vec2, to: Vec2) {
        let along = (to - from).normalize();
        let aside = along.perp();
        let count = ((to - from).length() / LAMP_STEP) as i32;
        for i in FIRST_LAMP..count {
            for side in [-1.0, 1.0] {
                let step = (i as f32 + if side > 0.0 { 0.5 } else { 0.0 }) * LAMP_STEP;
                let foot = from + along * step + aside * (side * (ROAD_HALF + 1.6));
                let mut pole = self.block(foot, Vec2::splat(0.09), 0.0, LAMP_HEIGHT);
                pole.albedo = [0.12; 3];
                self.blocks.push(pole);
                let head = foot - aside * (side * 1.3);
                let mut arm =
                    self.block(foot - aside * (side * 0.65), Vec2::new(0.7, 0.05), LAMP_HEIGHT - 0.1, 0.1);
                arm.yaw = libm::atan2f(aside.y, aside.x);
                arm.albedo = [0.12; 3];
                self.blocks.push(arm);
                self.lamps
                    .push(StreetLamp { position: head.extend(LAMP_HEIGHT - 0.25).into(), intensity: SODIUM });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::Limits;

    #[test]
    fn a_town_is_valid_and_the_same_for_the_same_seed() {
        for seed in 0..8 {
            let town = synth_town(seed);
            town.validate(&Limits::default()).unwrap();
            assert_eq!(town, synth_town(seed));
            assert!((200..1_500).contains(&town.blocks.len()), "{} blocks", town.blocks.len());
        }
        assert_ne!(synth_town(1), synth_town(2));
    }

    #[test]
    fn towers_stand_in_the_middle_and_nothing_stands_on_the_road() {
        let town = synth_town(1);
        let tall = |block: &&Block| block.foot + block.height > 70.0;
        assert!(town.blocks.iter().filter(tall).count() > 8);
        for block in town.blocks.iter().filter(tall) {
            assert!((Vec2::from_array(block.centre) - MIDDLE).length() < 500.0);
        }
        let built = squall_runtime::shade::town::Town::new(&town);
        let road = &town.ground.roads[0];
        let (from, to) = (Vec2::from_array(road.from), Vec2::from_array(road.to));
        for i in 0..200 {
            let spot = from + (to - from) * (i as f32 / 200.0);
            assert_eq!(built.roof_heights(spot - 0.5, 1.0, [1, 1]), [0.0], "{spot}");
        }
    }
}
