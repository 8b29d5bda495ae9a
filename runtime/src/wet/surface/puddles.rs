//! Where water stands: by a baked map of its depth, or by a noise that stands in the world, on flat ground.

use crate::noise::Lattice;
use crate::wet::maps::{GroundMap, WetMaps};
use crate::wet::surface::SurfaceControls;
use glam::{DVec2, Vec3};

/// Nodes along the side of the noise's tile, which repeats.
const SIDE: usize = 256;
/// Puddles along the side of a tile.
const PUDDLES: u8 = 4;
/// Octaves of the noise: shores have detail down to an eighth of a puddle.
const OCTAVES: u32 = 4;
/// Cosine of the steepest ground that water stands on: 5°.
const FLAT: f32 = 0.996;

/// How low flat ground lies, 0 to 1 by rank: a share s of it is lower than 1 − s.
pub struct Hollows {
    /// By node of a tile.
    ranks: Vec<f32>,
    basins: Option<Basins>,
}

/// What a map of standing water says of each of its puddles.
struct Basins {
    of: GroundMap,
    /// Depth of the puddle that a cell belongs to or lies beside, where it is deepest; 0 where there is none.
    deepest: Vec<f32>,
}

impl Basins {
    fn new(of: GroundMap) -> Self {
        let [width, height] = of.size;
        let holds = |at: usize| of.values.get(at).is_some_and(|depth| *depth > 0.0);
        let mut own = vec![0.0f32; width * height];
        let (mut puddle, mut open) = (Vec::new(), Vec::new());
        for first in 0..own.len() {
            if own[first] > 0.0 || !holds(first) {
                continue;
            }
            // All cells of one puddle: those that touch, by a side or a corner.
            puddle.clear();
            own[first] = of.values[first];
            open.push(first);
            let mut deepest = 0.0f32;
            while let Some(at) = open.pop() {
                puddle.push(at);
                deepest = deepest.max(of.values[at]);
                for next in around(at, [width, height]) {
                    if own[next] == 0.0 && holds(next) {
                        own[next] = of.values[next];
                        open.push(next);
                    }
                }
            }
            puddle.iter().for_each(|&at| own[at] = deepest);
        }
        // Between the middles of a wet and a dry cell there is water as well.
        let beside =
            |at: usize| around(at, [width, height]).map(|next| own[next]).fold(0.0f32, f32::max).max(own[at]);
        let deepest = (0..own.len()).map(|at| if own[at] > 0.0 { own[at] } else { beside(at) }).collect();
        Self { of, deepest }
    }

    /// Whether it is of this map, bit by bit: what isn't there, NaN, counts as equal.
    fn is_of(&self, map: &GroundMap) -> bool {
        let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits();
        (self.of.origin_m, self.of.cell_m, self.of.size) == (map.origin_m, map.cell_m, map.size)
            && self.of.values.len() == map.values.len()
            && self.of.values.iter().zip(&map.values).all(same)
    }

    fn at(&self, place: DVec2) -> f32 {
        let cell = self.of.cell(place).and_then(|[x, y]| self.deepest.get(y * self.of.size[0] + x));
        cell.copied().unwrap_or(0.0)
    }
}

/// Cells around one.
fn around(at: usize, [width, height]: [usize; 2]) -> impl Iterator<Item = usize> {
    let (x, y) = (at % width, at / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    rows.flat_map(move |y| columns.clone().map(move |x| y * width + x)).filter(move |next| *next != at)
}

impl Hollows {
    /// Draws the ground of a seed.
    pub fn new(seed: u64) -> Self {
        let lattice = Lattice::periodic(seed as u32 ^ 0x5EED, PUDDLES.ilog2() as u8);
        let step = f32::from(PUDDLES) / SIDE as f32;
        let levels: Vec<f32> = (0..SIDE * SIDE)
            .map(|i| {
                let spot = Vec3::new((i % SIDE) as f32 * step, (i / SIDE) as f32 * step, 0.5);
                lattice.fractal(spot, OCTAVES, 0.5)
            })
            .collect();
        let mut order: Vec<u32> = (0..levels.len() as u32).collect();
        order.sort_by(|&a, &b| levels[a as usize].total_cmp(&levels[b as usize]));
        let mut ranks = vec![0.0; levels.len()];
        let last = (levels.len() - 1) as f32;
        for (rank, node) in order.into_iter().enumerate() {
            ranks[node as usize] = rank as f32 / last;
        }
        Self { ranks, basins: None }
    }

    /// Looks at a map of standing water, where it is another than the last one: how deep each of its puddles is.
    pub fn know(&mut self, map: Option<&GroundMap>) {
        if map.is_none_or(|map| self.basins.as_ref().is_none_or(|basins| !basins.is_of(map))) {
            self.basins = map.cloned().map(Basins::new);
        }
    }

    /// How low a place lies; `size` m is a puddle's.
    fn rank(&self, place: DVec2, size: f32) -> f32 {
        let tile = f64::from(size) * f64::from(PUDDLES);
        let within = |value: f64| {
            let turns = value / tile;
            ((turns - libm::floor(turns)) * SIDE as f64) as f32
        };
        let (x, y) = (within(place.x), within(place.y));
        let (left, top) = (x as usize % SIDE, y as usize % SIDE);
        let (right, bottom) = ((left + 1) % SIDE, (top + 1) % SIDE);
        let (u, v) = (x - libm::floorf(x), y - libm::floorf(y));
        let node = |x: usize, y: usize| self.ranks[y * SIDE + x];
        let above = node(left, top) + u * (node(right, top) - node(left, top));
        let below = node(left, bottom) + u * (node(right, bottom) - node(left, bottom));
        above + v * (below - above)
    }

    /// Depth of water at a place when puddles are full, and where its own puddle is deepest, m; [`depth_m`] has it at other times. Of a baked map that
    /// [`Self::know`] was told of.
    pub fn basin(
        &self,
        (place, normal): (DVec2, Vec3),
        maps: &WetMaps,
        controls: &SurfaceControls,
    ) -> [f32; 2] {
        if normal.z < FLAT {
            return [0.0; 2];
        }
        match &maps.water_m {
            Some(map) => {
                let depth = map.between(place).filter(|depth| *depth > 0.0).unwrap_or(0.0);
                [depth, self.basins.as_ref().map_or(depth, |basins| basins.at(place))]
            }
            None => {
                let share = controls.puddles;
                if share <= 0.0 {
                    return [0.0; 2];
                }
                let low = self.rank(place, controls.puddle_size) - (1.0 - share);
                [controls.puddle_depth * low / share, controls.puddle_depth]
            }
        }
    }
}

/// Depth of water over a basin, m, where puddles are full to a share `full`: each one's level sinks with it, from its own deepest place's, and shores draw back.
pub fn depth_m([when_full, deepest]: [f32; 2], full: f32) -> f32 {
    if full <= 0.0 {
        return 0.0;
    }
    (when_full - (1.0 - full) * deepest).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::maps::GroundMap;

    fn controls(puddles: f32) -> SurfaceControls {
        SurfaceControls { puddles, ..SurfaceControls::default() }
    }

    #[test]
    fn puddles_cover_the_share_that_was_asked_for_and_stand_still_in_the_world() {
        /// Nodes lie finer than the looks; between them ranks are means.
        const SAMPLING: f32 = 0.02;
        let (hollows, maps) = (Hollows::new(4), WetMaps::default());
        for share in [0.0f32, 0.2, 0.7] {
            let controls = controls(share);
            let depth = |place: DVec2| depth_m(hollows.basin((place, Vec3::Z), &maps, &controls), 1.0);
            let wet = (0..10_000)
                .filter(|i| depth(DVec2::new(f64::from(i % 100), f64::from(i / 100)) * 0.121) > 0.0);
            let found = wet.count() as f32 / 10_000.0;
            assert!((found - share).abs() < SAMPLING, "{share}: {found}");
        }
        let far = DVec2::new(3.0e5, -5.0e6);
        let tile = f64::from(controls(0.5).puddle_size) * f64::from(PUDDLES);
        let near = DVec2::new(1.3, 2.4);
        let [a, b] = [near, near + (far / tile).round() * tile]
            .map(|place| depth_m(hollows.basin((place, Vec3::Z), &maps, &controls(0.5)), 1.0));
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }

    #[test]
    fn a_baked_map_says_where_water_stands_and_slopes_have_none() {
        let map = GroundMap {
            origin_m: DVec2::ZERO,
            cell_m: 1.0,
            size: [2, 2],
            values: vec![0.0, 0.03, 0.0, 0.03],
        };
        let maps = WetMaps { water_m: Some(map), ..WetMaps::default() };
        let mut hollows = Hollows::new(1);
        hollows.know(maps.water_m.as_ref());
        let controls = SurfaceControls::default();
        let depth = |x: f64, normal: Vec3, full: f32| {
            depth_m(hollows.basin((DVec2::new(x, 1.0), normal), &maps, &controls), full)
        };
        assert_eq!((depth(0.3, Vec3::Z, 1.0), depth(1.7, Vec3::Z, 1.0)), (0.0, 0.03));
        assert_eq!(depth(1.7, Vec3::new(0.2, 0.0, 0.98).normalize(), 1.0), 0.0);
        assert_eq!((depth(1.7, Vec3::Z, 0.0), depth(9.0, Vec3::Z, 1.0)), (0.0, 0.0));
        assert!((depth(1.7, Vec3::Z, 0.5) - 0.015).abs() < 1e-6);
    }

    #[test]
    fn a_shallow_puddle_and_a_deep_one_fill_together_each_to_its_own_brim() {
        let mut map = GroundMap { origin_m: DVec2::ZERO, cell_m: 1.0, size: [9, 3], values: vec![0.0; 27] };
        // Two of 2 cm, four metres beside one of 30 cm.
        for (at, depth) in [(9 + 1, 0.02), (9 + 2, 0.01), (9 + 6, 0.3), (9 + 7, 0.15)] {
            map.values[at] = depth;
        }
        map.values[0] = f32::NAN;
        let maps = WetMaps { water_m: Some(map), ..WetMaps::default() };
        let mut hollows = Hollows::new(1);
        for _ in 0..2 {
            hollows.know(maps.water_m.as_ref());
        }
        let depth = |x: f64, full: f32| {
            let place = DVec2::new(x + 0.5, 1.5);
            depth_m(hollows.basin((place, Vec3::Z), &maps, &SurfaceControls::default()), full)
        };
        for (x, deepest) in [(1.0, 0.02), (6.0, 0.3)] {
            for full in [0.1f32, 0.5, 0.9, 1.0] {
                assert!((depth(x, full) - full * deepest).abs() < 1e-6, "{x} {full}: {}", depth(x, full));
            }
            // Half as deep beside it: dry until half of the way to the brim.
            assert_eq!(depth(x + 1.0, 0.4), 0.0);
            assert!((depth(x + 1.0, 0.75) - 0.25 * deepest).abs() < 1e-6);
        }
    }
}
