//! Dry air around an eye, for rays that begin anywhere: what mirrors, panes and lamps look through.
//!
//! As under covers ([`super::under`]) there is one height on each line of fall below which it is dry. It is kept for squares of the
//! ground, leaned against the fall, around the eye; each tile of squares when a ray first needs it. A ray passes over tiles without dry air.

use super::Shelter;
use super::cover::{CoverMap, Covers};
use glam::{DVec2, DVec3};
use std::sync::{Arc, OnceLock};

/// Edge of a square, m; squares along a tile's edge; tiles along an edge of all, the eye in their middle.
const CELL_M: f64 = 2.0;
const CELLS: usize = 16;
const TILES: usize = 16;
const TILE_M: f64 = CELL_M * CELLS as f64;
/// Squares along the edge of a block of them, and blocks along a tile's edge.
const BLOCK: usize = 4;
const BLOCKS: usize = CELLS / BLOCK;
const BLOCK_M: f64 = CELL_M * BLOCK as f64;
/// Heights from the eye between which covers that do not say how high they are are looked for, m.
const HEIGHTS_M: [f64; 2] = [-100.0, 2000.0];

/// Squares of ground.
struct Tile {
    /// Height below which it is dry, m, x fastest.
    lids: Vec<f64>,
    /// The highest of each block's.
    blocks: [f64; BLOCKS * BLOCKS],
    highest: f64,
}

/// What is known of dry air, kept from frame to frame.
pub struct DryTiles {
    fall: DVec3,
    /// Lowest corner of all tiles, on the ground at z = 0.
    low: DVec2,
    heights: [f64; 2],
    has_first: bool,
    maps: Vec<Arc<CoverMap>>,
    tiles: Box<[OnceLock<Tile>]>,
}

/// Air that covers keep dry.
pub struct DryAir<'a> {
    covers: Covers<'a>,
    /// Metres across for a metre of height.
    lean: DVec2,
    tiles: DryTiles,
}

impl<'a> DryAir<'a> {
    /// Air around `eye` under `covers` in rain whose drops fall with the mean velocity `fall`, m/s; `kept` is what an earlier frame of the
    /// same scene knew.
    pub fn new(covers: Covers<'a>, fall: DVec3, eye: DVec3, kept: Option<DryTiles>) -> Self {
        // What does not fall is looked at as if it fell straight down.
        let fall = if fall.z < 0.0 { fall } else { DVec3::NEG_Z };
        let lean = fall.truncate() / fall.z;
        let middle = eye.truncate() - lean * eye.z;
        let low = ((middle / TILE_M).floor() - (TILES / 2) as f64) * TILE_M;
        let top = covers.top();
        let top = if top.is_finite() { top } else { eye.z + HEIGHTS_M[1] };
        // Below eye and covers both, in steps, so that an eye that rises a little finds what it knew.
        let step = -HEIGHTS_M[0];
        let heights = [(eye.z.min(top) / step).floor() * step - step, top];
        let same_maps = |maps: &[Arc<CoverMap>]| {
            maps.len() == covers.maps.len() && maps.iter().zip(covers.maps).all(|(a, b)| Arc::ptr_eq(a, b))
        };
        let is_known = |known: &DryTiles| {
            known.fall == fall
                && known.low == low
                && known.heights == heights
                && known.has_first == covers.first.is_some()
                && same_maps(&known.maps)
        };
        let tiles = kept.filter(is_known).unwrap_or_else(|| DryTiles {
            fall,
            low,
            heights,
            has_first: covers.first.is_some(),
            maps: covers.maps.to_vec(),
            tiles: (0..TILES * TILES).map(|_| OnceLock::new()).collect(),
        });
        Self { covers, lean, tiles }
    }

    /// What a later frame may begin with.
    pub fn into_tiles(self) -> DryTiles {
        self.tiles
    }

    fn tile(&self, number: usize) -> &Tile {
        let DryTiles { fall, low, heights, tiles, .. } = &self.tiles;
        tiles[number].get_or_init(|| {
            let corner = *low + DVec2::new((number % TILES) as f64, (number / TILES) as f64) * TILE_M;
            let lid = |cell: usize| {
                let place = DVec2::new((cell % CELLS) as f64 + 0.5, (cell / CELLS) as f64 + 0.5);
                self.covers.lid((corner + place * CELL_M).extend(0.0), *fall, *heights)
            };
            let lids: Vec<f64> = (0..CELLS * CELLS).map(lid).collect();
            let mut blocks = [f64::NEG_INFINITY; BLOCKS * BLOCKS];
            for (cell, &lid) in lids.iter().enumerate() {
                let block = &mut blocks[cell / CELLS / BLOCK * BLOCKS + cell % CELLS / BLOCK];
                *block = block.max(lid);
            }
            let highest = blocks.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            Tile { lids, blocks, highest }
        })
    }

    /// Calls `dry` with both ends, m, of each dry stretch of a ray that ends after `metres`, ascending.
    pub fn stretches(&self, from: DVec3, direction: DVec3, metres: f64, dry: &mut dyn FnMut(f64, f64)) {
        let [_, top] = self.tiles.heights;
        let mut ends = [0.0, metres];
        clip_below(&mut ends, (from.z, direction.z), top);
        if ends[0] >= ends[1] {
            return;
        }
        let start = from.truncate() - self.lean * from.z - self.tiles.low;
        let way = direction.truncate() - self.lean * direction.z;
        let mut open: Option<[f64; 2]> = None;
        let lower_end = |a: f64, b: f64| (from.z + direction.z * a).min(from.z + direction.z * b);
        walk((start, way), (TILE_M, TILES), ends, &mut |[x, y], a, b| {
            let tile = self.tile(y * TILES + x);
            if lower_end(a, b) >= tile.highest {
                return;
            }
            let start = start - DVec2::new(x as f64, y as f64) * TILE_M;
            walk((start, way), (BLOCK_M, BLOCKS), [a, b], &mut |[block_x, block_y], a, b| {
                if lower_end(a, b) >= tile.blocks[block_y * BLOCKS + block_x] {
                    return;
                }
                let start = start - DVec2::new(block_x as f64, block_y as f64) * BLOCK_M;
                walk((start, way), (CELL_M, BLOCK), [a, b], &mut |[x, y], a, b| {
                    let mut own = [a, b];
                    let lid = tile.lids[(block_y * BLOCK + y) * CELLS + block_x * BLOCK + x];
                    clip_below(&mut own, (from.z, direction.z), lid);
                    if own[0] >= own[1] {
                        return;
                    }
                    match &mut open {
                        Some(open) if own[0] <= open[1] + 1e-6 => open[1] = own[1],
                        found => {
                            if let Some([a, b]) = found.replace(own) {
                                dry(a, b);
                            }
                        }
                    }
                });
            });
        });
        if let Some([a, b]) = open {
            dry(a, b);
        }
    }
}

/// Leaves of a stretch what lies below `top` of a ray that begins at height z and climbs so much a metre.
fn clip_below(ends: &mut [f64; 2], (z, climb): (f64, f64), top: f64) {
    let cut = (top - z) / climb;
    if climb > 0.0 {
        ends[1] = ends[1].min(cut);
    } else if climb < 0.0 {
        ends[0] = ends[0].max(cut);
    } else if z >= top {
        ends[1] = ends[0];
    }
}

/// Calls `visit` for each square of a grid of `count` × `count` squares that a ray passes between two distances, with what of it lies
/// in the square.
fn walk(
    (start, way): (DVec2, DVec2),
    (size, count): (f64, usize),
    [mut enter, mut leave]: [f64; 2],
    visit: &mut dyn FnMut([usize; 2], f64, f64),
) {
    let extent = size * count as f64;
    for axis in 0..2 {
        if way[axis] == 0.0 {
            if !(0.0..extent).contains(&start[axis]) {
                return;
            }
            continue;
        }
        let [a, b] = [0.0, extent].map(|side| (side - start[axis]) / way[axis]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    if enter.partial_cmp(&leave).is_none_or(|order| order.is_ge()) {
        return;
    }
    let place = (start + way * enter) / size;
    let mut at = [0, 1].map(|axis: usize| (place[axis].floor() as i64).clamp(0, count as i64 - 1));
    let mut here = enter;
    // A ray crosses a border of each axis at most once a square.
    for _ in 0..2 * count + 2 {
        let border = |axis: usize| match way[axis] {
            0.0 => f64::INFINITY,
            speed => ((at[axis] + i64::from(speed > 0.0)) as f64 * size - start[axis]) / speed,
        };
        let borders = [border(0), border(1)];
        let end = borders[0].min(borders[1]).min(leave).max(here);
        visit(at.map(|index| index as usize), here, end);
        let axis = usize::from(borders[1] < borders[0]);
        at[axis] += if way[axis] > 0.0 { 1 } else { -1 };
        if end >= leave || !(0..count as i64).contains(&at[axis]) {
            return;
        }
        here = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use squall_formats::units::Metres;

    #[test]
    fn dry_stretches_of_rays_from_anywhere_are_those_that_many_points_find() {
        /// Squares of two metres: a slab's edges fall anywhere in them, and so much on either side is found or missed on a ray across both.
        const HALF_SQUARE_M: f64 = 1.2;
        /// The same in the mean of some hundred rays.
        const ALL: f64 = 0.02;
        let slab = (0..60 * 60).map(|i| if (20..45).contains(&(i % 60)) { 6.0 } else { f32::NAN });
        let under = (0..60 * 60).map(|i| if (20..45).contains(&(i % 60)) { 5.0 } else { f32::NAN });
        let origin = DVec3::new(-60.0, -60.0, 0.0);
        let roof = CoverMap::roofs(origin, Metres(2.0), [60, 60], under.collect(), slab.collect()).unwrap();
        let maps = [Arc::new(roof)];
        let covers = Covers { first: None, maps: &maps };
        let mut random = Random::new(6);
        let (mut met, mut sums) = (0, [0.0; 2]);
        for fall in [DVec3::new(0.0, 0.0, -6.0), DVec3::new(5.0, 2.0, -6.0)] {
            let air = DryAir::new(covers, fall, DVec3::new(3.0, -7.0, 2.0), None);
            for _ in 0..300 {
                let from =
                    DVec3::new(random.range(-50.0, 50.0), random.range(-50.0, 50.0), random.range(0.1, 9.0));
                let mut direction = random.direction();
                direction.z *= 0.2;
                let direction = direction.normalize();
                let metres = random.range(5.0, 120.0);
                let (mut found, mut last) = (0.0, 0.0);
                air.stretches(from, direction, metres, &mut |a, b| {
                    assert!(a >= last && b > a && b <= metres);
                    (found, last) = (found + b - a, b);
                });
                let steps = 4000;
                let step = metres / f64::from(steps);
                let dry = (0..steps)
                    .filter(|i| {
                        let point = from + direction * (f64::from(*i) + 0.5) * step;
                        // Within the slab and below the ground nothing is asked.
                        point.z < 6.0 && !covers.reaches(point, fall)
                    })
                    .count();
                let wanted = dry as f64 * step;
                let level = (direction.truncate() - fall.truncate() / fall.z * direction.z).abs();
                let slanted = HALF_SQUARE_M * (1.0 / level.x.max(0.01) + 1.0 / level.y.max(0.01));
                assert!((found - wanted).abs() < slanted, "{from} {direction} {metres}: {found} {wanted}");
                sums = [sums[0] + found, sums[1] + wanted];
                met += u32::from(wanted > 5.0);
            }
        }
        assert!(met > 100 && (sums[0] / sums[1] - 1.0).abs() < ALL, "{met} {sums:?}");
    }

    #[test]
    fn what_is_known_is_kept_for_the_same_air_alone() {
        let asked = std::sync::atomic::AtomicUsize::new(0);
        let roof = |point: DVec3, _: DVec3| {
            asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            point.z > 5.0
        };
        let covers = Covers { first: Some(&roof), maps: &[] };
        let count = |kept: Option<DryTiles>, fall: DVec3| {
            let before = asked.load(std::sync::atomic::Ordering::Relaxed);
            let air = DryAir::new(covers, fall, DVec3::Z * 2.0, kept);
            air.stretches(DVec3::Z, DVec3::X, 50.0, &mut |_, _| ());
            (asked.load(std::sync::atomic::Ordering::Relaxed) - before, air.into_tiles())
        };
        let (first, tiles) = count(None, DVec3::NEG_Z);
        let (again, tiles) = count(Some(tiles), DVec3::NEG_Z);
        let (other, _) = count(Some(tiles), DVec3::new(1.0, 0.0, -1.0));
        assert!(first > 0 && again == 0 && other > 0, "{first} {again} {other}");
    }
}
