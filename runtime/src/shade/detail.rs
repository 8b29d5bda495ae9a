//! Detail below a cell: billows at a cloud's edge that a coarse grid cannot hold, added while a ray is marched.
//!
//! A grid's edge is a ramp one or two cells wide. Here the ramp is cut by noise: where the noise is below the
//! ramp there is cloud, elsewhere air. The noise is made uniform on [0, 1], and the cut is chosen such that its
//! mean over the noise is the ramp again, so the cloud keeps its water; amplitude 0 leaves the grid exactly.
//! Anchored in the world and repeatable.
//!
//! | symbol | name      | unit |
//! | c      | `ramp`    | –, coarse density over the edge's top |
//! | n      | `noise`   | –, uniform on [0, 1] |
//! | w      | `SOFTNESS`| –, noise range over which air turns to cloud |

use crate::error::RuntimeError;
use crate::noise::Lattice;
use crate::parallel::prelude::*;
use crate::random::Random;
use glam::Vec3;
use squall_formats::GridShape;

/// Voxels along each side of the noise table, a power of two.
const SIDE: usize = 64;
const VOXELS: usize = SIDE * SIDE * SIDE;
/// Largest billows per period of the table: 2^3.
const CELL_BITS: u8 = 3;
const CELLS: f32 = (1 << CELL_BITS) as f32;
const SOFTNESS: f32 = 0.25;
/// Share of the local ceiling up to which density counts as edge.
const EDGE_SHARE: f32 = 0.7;
/// Height over which fibres take over from billows, m.
const FIBRE_RISE: f32 = 1_500.0;
/// What stretches billows into fibres.
const FIBRE: Vec3 = Vec3::new(0.28, 1.7, 1.3);
const LEVELS: usize = 512;

/// How much detail, and how large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetailParameters {
    /// 0 leaves the grid as it is, 1 replaces its edges by billows.
    pub amplitude: f32,
    /// Diameter of the largest billows, m: one to three cells.
    pub size: f32,
    /// Altitude above which billows give way to fibres along x, over 1.5 km, m; infinity: nowhere.
    pub fibres_from: f32,
    /// Seed of the pattern.
    pub seed: u32,
}

impl Default for DetailParameters {
    fn default() -> Self {
        Self { amplitude: 0.0, size: 450.0, fibres_from: f32::INFINITY, seed: 1 }
    }
}

/// The noise table of a pattern, 256 kB, built once.
pub struct Detail {
    amplitude: f32,
    fibres_from: f32,
    voxels_per_metre: f32,
    table: Box<[u8; VOXELS]>,
    /// Cumulative distribution of the raw noise, which makes it uniform.
    ranks: Vec<f32>,
}

impl Detail {
    /// Builds the table, some tens of milliseconds; nothing at amplitude 0. Errors: amplitude outside [0, 1], a size not above 0.
    pub fn new(parameters: &DetailParameters) -> Result<Self, RuntimeError> {
        let DetailParameters { amplitude, size, fibres_from, seed } = *parameters;
        if !(0.0..=1.0).contains(&amplitude) {
            return Err(RuntimeError::argument("detail amplitude", "a number in [0, 1]", amplitude));
        }
        if !(size > 0.0 && size.is_finite()) {
            return Err(RuntimeError::argument("detail size", "metres above 0", size));
        }
        if fibres_from.is_nan() {
            return Err(RuntimeError::argument("detail fibre altitude", "metres or infinity", fibres_from));
        }
        let voxels_per_metre = SIDE as f32 / (CELLS * size);
        let mut detail = Self {
            amplitude,
            fibres_from,
            voxels_per_metre,
            table: boxed(vec![0; VOXELS]),
            ranks: vec![0.0, 1.0],
        };
        if amplitude == 0.0 {
            return Ok(detail);
        }
        let (large, small) =
            (Lattice::periodic(seed, CELL_BITS), Lattice::periodic(seed ^ 0x5EED, CELL_BITS + 1));
        let large = large.cells_of_a_period::<{ SIDE >> CELL_BITS }>(CELL_BITS);
        let small = small.cells_of_a_period::<{ SIDE >> (CELL_BITS + 1) }>(CELL_BITS + 1);
        let mut table = vec![0; VOXELS];
        let slab = |(z, slab): (usize, &mut [u8])| {
            let at = z * SIDE * SIDE;
            for (voxel, (large, small)) in slab.iter_mut().zip(large[at..].iter().zip(&small[at..])) {
                *voxel = ((0.6 * large + 0.4 * small) * 212.0).clamp(0.0, 255.0) as u8;
            }
        };
        table.par_chunks_mut(SIDE * SIDE).enumerate().for_each(slab);
        detail.table = boxed(table);
        detail.rank(seed);
        Ok(detail)
    }

    /// Voxels along each side of the table, its values (x fastest) and how many voxels there are a metre.
    #[cfg(feature = "gpu")]
    pub(crate) fn table(&self) -> (u32, &[u8], f32) {
        (SIDE as u32, self.table.as_slice(), self.voxels_per_metre)
    }

    /// The raw noise's cumulative distribution: [`Detail::noise`] at even steps of it; two values where there is no detail.
    #[cfg(feature = "gpu")]
    pub(crate) fn ranks(&self) -> &[f32] {
        &self.ranks
    }

    /// Measures how often each raw value occurs, so that [`Detail::noise`] is uniform.
    fn rank(&mut self, seed: u32) {
        const DRAWS: usize = 1 << 16;
        let mut random = Random::from_parts(&[u64::from(seed), 0xDE7A]);
        let period = SIDE as f32 / self.voxels_per_metre;
        let mut draws: Vec<(Vec3, u16)> = (0..DRAWS)
            .map(|_| (Vec3::from_array([0; 3].map(|_| random.range(0.0, 64.0) as f32 * period)), 0))
            .collect();
        draws.par_chunks_mut(DRAWS / 32).for_each(|draws| {
            for (point, level) in draws {
                *level = (self.raw(*point) * (LEVELS - 1) as f32) as u16;
            }
        });
        let mut counts = vec![0u32; LEVELS];
        draws.iter().for_each(|(_, level)| counts[usize::from(*level).min(LEVELS - 1)] += 1);
        let mut below = 0;
        self.ranks = std::iter::once(0)
            .chain(counts.into_iter().map(|count| {
                below += count;
                below
            }))
            .map(|count| count as f32 / DRAWS as f32)
            .collect();
    }

    /// The table at `p` voxels, trilinear and periodic. `floor` is spelled out: without SSE 4.1 it is a call.
    #[inline]
    fn voxel(&self, p: Vec3) -> f32 {
        let split = |v: f32| {
            let cut = v as i32;
            let low = cut - i32::from(cut as f32 > v);
            (low, v - low as f32)
        };
        let ((x, u), (y, v), (z, w)) = (split(p.x), split(p.y), split(p.z));
        let wrap = |low: i32, step: usize| {
            let low = low as usize;
            [(low & (SIDE - 1)) * step, (low.wrapping_add(1) & (SIDE - 1)) * step]
        };
        let ([x0, x1], [y0, y1], [z0, z1]) = (wrap(x, 1), wrap(y, SIDE), wrap(z, SIDE * SIDE));
        let table = &*self.table;
        let row = |start: usize| {
            let (a, b) = (f32::from(table[start | x0]), f32::from(table[start | x1]));
            a + u * (b - a)
        };
        let slab = |start: usize| {
            let (a, b) = (row(start | y0), row(start | y1));
            a + v * (b - a)
        };
        let (a, b) = (slab(z0), slab(z1));
        a + w * (b - a)
    }

    /// Two scales of the table, the finer turned (by the rotation 1/3 [2 2 −1; −1 2 2; 2 −1 2]) so that no
    /// period shows; in [0, 1].
    fn raw(&self, position: Vec3) -> f32 {
        let p = position * self.voxels_per_metre;
        let turned =
            Vec3::new(2.0 * p.x + 2.0 * p.y - p.z, -p.x + 2.0 * p.y + 2.0 * p.z, 2.0 * p.x - p.y + 2.0 * p.z)
                * (3.1 / 3.0);
        (0.78 * self.voxel(p) + 0.22 * self.voxel(turned)) * (1.0 / 255.0)
    }

    /// The pattern at `position` (m), uniform on [0, 1]: low in the middle of a billow, high between billows.
    pub fn noise(&self, position: Vec3) -> f32 {
        let level = self.raw(position) * (LEVELS - 1) as f32;
        let low = (level as usize).min(LEVELS - 1);
        self.ranks[low] + (level - low as f32) * (self.ranks[low + 1] - self.ranks[low])
    }

    /// Density at `position` (m) whose grid value, interpolated, is `coarse`.
    ///
    /// `ceiling` is the largest density nearby ([`ceilings`], interpolated the same way); density above 70 % of
    /// it is the cloud's inside and stays as it is. Over all positions the mean is `coarse`, within .013 of density 1.
    #[inline]
    pub fn modulate(&self, position: Vec3, coarse: f32, ceiling: f32) -> f32 {
        let edge = ceiling * EDGE_SHARE;
        if self.amplitude == 0.0 || coarse <= 0.0 || coarse >= edge {
            return coarse;
        }
        let ramp = coarse / edge;
        let threshold = threshold(ramp);
        let cut = |at: Vec3| ((threshold - self.noise(at)) / SOFTNESS + 0.5).clamp(0.0, 1.0);
        // Mixing two cuts keeps the mean, since each has it.
        let icy = ((position.z - self.fibres_from) / FIBRE_RISE).clamp(0.0, 1.0);
        let cut = if icy == 0.0 {
            cut(position)
        } else if icy == 1.0 {
            cut(position * FIBRE)
        } else {
            let billow = cut(position);
            billow + icy * (cut(position * FIBRE) - billow)
        };
        edge * (ramp + self.amplitude * (cut - ramp))
    }
}

/// A table of the right length, which the compiler then knows.
fn boxed(values: Vec<u8>) -> Box<[u8; VOXELS]> {
    values.into_boxed_slice().try_into().unwrap_or_else(|_| unreachable!("{VOXELS} voxels"))
}

/// Where to cut so that the mean of clamp((cut − n)/w + ½, 0, 1) over uniform n is `ramp`: inside, `ramp`
/// itself; within w/2 of either end the square root that makes up for what the clamp takes.
fn threshold(ramp: f32) -> f32 {
    let from_end = |share: f32| (2.0 * SOFTNESS * share).sqrt() - 0.5 * SOFTNESS;
    if ramp < 0.5 * SOFTNESS {
        from_end(ramp)
    } else if ramp > 1.0 - 0.5 * SOFTNESS {
        1.0 - from_end(1.0 - ramp)
    } else {
        ramp
    }
}

/// Largest density among each cell and its 26 neighbours: what [`Detail::modulate`] takes for the inside.
pub fn ceilings(shape: GridShape, density: &[f32]) -> Vec<f32> {
    let mut values = density.to_vec();
    let mut before = values.clone();
    let counts = shape.to_array();
    for (count, stride) in counts.into_iter().zip([1, shape.row_stride(), shape.slab_stride()]) {
        before.copy_from_slice(&values);
        let lines = (count * stride).max(1);
        for (values, before) in values.chunks_exact_mut(lines).zip(before.chunks_exact(lines)) {
            let larger =
                |(value, other): (&mut f32, &f32)| *value = if *other > *value { *other } else { *value };
            values[stride..].iter_mut().zip(before).for_each(larger);
            values.iter_mut().zip(&before[stride..]).for_each(larger);
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detail(amplitude: f32) -> Detail {
        Detail::new(&DetailParameters { amplitude, ..DetailParameters::default() }).unwrap()
    }

    fn positions() -> impl Iterator<Item = Vec3> {
        let mut random = Random::new(5);
        (0..100_000).map(move |_| Vec3::from_array([0; 3].map(|_| random.range(-2e4, 2e4) as f32)))
    }

    #[test]
    fn the_cloud_keeps_its_water_at_every_density() {
        /// Five standard errors of 100 000 values between 0 and 1, and a CDF of 65 536 draws.
        const SAMPLING: f64 = 5.0 * 0.5 / 316.0 + 0.005;
        let detail = detail(1.0);
        for coarse in [0.02, 0.1, 0.3, 0.5, 0.6, 0.68, 0.9] {
            let sum: f64 = positions().map(|p| f64::from(detail.modulate(p, coarse, 1.0))).sum();
            let mean = sum / 100_000.0;
            assert!((mean - f64::from(coarse)).abs() < SAMPLING, "{coarse}: {mean}");
        }
    }

    #[test]
    fn amplitude_zero_is_the_grid_and_air_stays_air() {
        let exact = detail(0.0);
        let full = detail(1.0);
        for p in positions().take(100) {
            assert_eq!(exact.modulate(p, 0.25, 1.0), 0.25);
            assert_eq!(full.modulate(p, 0.0, 1.0), 0.0);
            assert_eq!(full.modulate(p, 0.8, 1.0), 0.8);
            assert!((0.0..=0.7).contains(&full.modulate(p, 0.4, 1.0)));
        }
    }

    #[test]
    fn edges_become_billows_not_haze() {
        let detail = detail(1.0);
        let sharp = positions().filter(|&p| {
            let density = detail.modulate(p, 0.35, 1.0);
            !(0.05..=0.65).contains(&density)
        });
        // With softness w, the share of noise outside the ramp is 1 − w for a cut at one half.
        assert!(sharp.count() > 50_000);
    }

    #[test]
    fn a_ceiling_is_the_largest_of_the_neighbourhood() {
        let shape = GridShape::new(5, 4, 3);
        let mut density = vec![0.0; shape.len()];
        density[shape.index(2, 1, 1)] = 0.7;
        let ceilings = ceilings(shape, &density);
        for index in 0..shape.len() {
            let [x, y, _] = shape.cell(index);
            let near = (1..=3).contains(&x) && y <= 2;
            assert_eq!(ceilings[index], if near { 0.7 } else { 0.0 });
        }
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        for (amplitude, size) in [(1.5, 100.0), (f32::NAN, 100.0), (1.0, 0.0), (1.0, f32::INFINITY)] {
            assert!(
                Detail::new(&DetailParameters { amplitude, size, ..DetailParameters::default() }).is_err()
            );
        }
    }
}
