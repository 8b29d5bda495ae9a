//! Coherent noise anchored in the world: the same place gives the same value on every machine.
//!
//! Lattice points are hashed from integers, so nothing is stored and nothing repeats; a period can be asked
//! for where a table is filled ([`Lattice::periodic`]).

mod period;

use crate::registers::in_registers;
use glam::Vec3;

/// A seeded integer lattice, unbounded or periodic.
#[derive(Clone, Copy, Debug)]
pub struct Lattice {
    seed: u32,
    /// Bits of a coordinate that count: all of them, or those below the period.
    mask: i32,
}

/// Mixes three lattice coordinates and a seed into 32 bits, every input bit reaching every output bit
/// (multiply, xor-shift rounds with the constants of the PCG family's 3-D hash).
#[inline(always)]
fn scramble(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    let mut a = (x as u32).wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    let mut b = (y as u32).wrapping_mul(1_664_525).wrapping_add(1_013_904_223 ^ seed);
    let mut c = (z as u32).wrapping_mul(1_664_525).wrapping_add(seed.wrapping_mul(0x9E37_79B9));
    a = a.wrapping_add(b.wrapping_mul(c));
    b = b.wrapping_add(c.wrapping_mul(a));
    c = c.wrapping_add(a.wrapping_mul(b));
    a ^= a >> 16;
    b ^= b >> 16;
    c ^= c >> 16;
    a = a.wrapping_add(b.wrapping_mul(c));
    b = b.wrapping_add(c.wrapping_mul(a));
    c = c.wrapping_add(a.wrapping_mul(b));
    c ^ (c >> 15)
}

/// The bits `shift .. shift + 10` of `hash` as a number in [0, 1).
#[inline(always)]
fn tenth(hash: u32, shift: u32) -> f32 {
    ((hash >> shift) & 1023) as f32 * (1.0 / 1024.0)
}

/// The quintic fade 6t⁵ − 15t⁴ + 10t³: no visible lattice in slopes.
#[inline(always)]
fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// 0 below `low`, 1 above `high`, 3t² − 2t³ between; with `low` above `high` it falls.
#[inline]
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[inline(always)]
fn floor_to_i32(value: f32) -> i32 {
    let truncated = value as i32;
    truncated - i32::from((truncated as f32) > value)
}

impl Lattice {
    /// An unbounded lattice.
    pub const fn new(seed: u32) -> Self {
        Self { seed, mask: -1 }
    }

    /// A lattice that repeats after 2^`bits` points along each axis.
    pub const fn periodic(seed: u32, bits: u8) -> Self {
        Self { seed, mask: (1 << bits) - 1 }
    }

    /// The seed.
    #[cfg(feature = "gpu")]
    pub(crate) fn seed(&self) -> u32 {
        self.seed
    }

    #[inline(always)]
    fn hash(&self, x: i32, y: i32, z: i32) -> u32 {
        scramble(x & self.mask, y & self.mask, z & self.mask, self.seed)
    }

    /// Gradient noise: mean 0, within [−1, 1], features one unit wide.
    pub fn gradient(&self, p: Vec3) -> f32 {
        let mut found = 0.0;
        in_registers(
            #[inline(always)]
            || found = self.gradient_in_registers(p),
        );
        found
    }

    #[inline(always)]
    fn gradient_in_registers(&self, p: Vec3) -> f32 {
        let (x, y, z) = (floor_to_i32(p.x), floor_to_i32(p.y), floor_to_i32(p.z));
        let f = Vec3::new(p.x - x as f32, p.y - y as f32, p.z - z as f32);
        // The eight corners side by side, x fastest.
        let mut own = [0.0; 8];
        for (corner, own) in own.iter_mut().enumerate() {
            let (dx, dy, dz) = ((corner & 1) as i32, (corner >> 1 & 1) as i32, (corner >> 2) as i32);
            let h = self.hash(x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz));
            let along_x = (tenth(h, 0) * 2.0 - 1.0) * (f.x - dx as f32);
            let along_y = (tenth(h, 10) * 2.0 - 1.0) * (f.y - dy as f32);
            let along_z = (tenth(h, 20) * 2.0 - 1.0) * (f.z - dz as f32);
            *own = along_x + along_y + along_z;
        }
        let (u, v, w) = (fade(f.x), fade(f.y), fade(f.z));
        let (a, b) = (own[0] + u * (own[1] - own[0]), own[2] + u * (own[3] - own[2]));
        let (c, d) = (own[4] + u * (own[5] - own[4]), own[6] + u * (own[7] - own[6]));
        let (low, high) = (a + v * (b - a), c + v * (d - c));
        (low + w * (high - low)).clamp(-1.0, 1.0)
    }

    /// Distance to the nearest of one random point per lattice cell, about 0 to 1.2 (Worley's F₁).
    pub fn cells(&self, p: Vec3) -> f32 {
        let (x, y, z) = (floor_to_i32(p.x), floor_to_i32(p.y), floor_to_i32(p.z));
        let f = Vec3::new(p.x - x as f32, p.y - y as f32, p.z - z as f32);
        let mut nearest = f32::MAX;
        // Own cell first: most of the others are then farther away than its point. The squared way to each, below a point's by round-off
        // at most.
        let way = |step: i32, at: f32| match step {
            -1 => at * at,
            0 => 0.0,
            _ => (1.0 - at) * (1.0 - at),
        };
        let is_behind = |way: f32, nearest: f32| way > 1.0001 * nearest;
        for dz in [0, -1, 1] {
            for dy in [0, -1, 1] {
                let beside = way(dz, f.z) + way(dy, f.y);
                if is_behind(beside, nearest) {
                    continue;
                }
                for dx in [0, -1, 1] {
                    if is_behind(beside + way(dx, f.x), nearest) {
                        continue;
                    }
                    let h = self.hash(x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz));
                    let point = Vec3::new(tenth(h, 0), tenth(h, 10), tenth(h, 20));
                    let offset = point + Vec3::new(dx as f32, dy as f32, dz as f32) - f;
                    nearest = nearest.min(offset.length_squared());
                }
            }
        }
        nearest.sqrt()
    }

    /// Gradient noise summed over `octaves`, each twice as fine and `gain` as strong; mean 0, within [−1, 1].
    pub fn fractal(&self, p: Vec3, octaves: u32, gain: f32) -> f32 {
        let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
        in_registers(
            #[inline(always)]
            || {
                for octave in 0..octaves {
                    let seed = self.seed.wrapping_add(octave.wrapping_mul(0x85EB_CA6B));
                    // Twice as fine, twice as many points per period.
                    let mask = (self.mask << octave) | ((1 << octave) - 1);
                    let layer = Self { seed, mask };
                    sum += weight * layer.gradient_in_registers(p * (1u32 << octave) as f32);
                    total += weight;
                    weight *= gain;
                }
            },
        );
        sum / total
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const DRAWS: usize = 20_000;
    /// Five standard errors of a mean of `DRAWS` values of deviation below .3.
    const FIVE_SIGMA: f64 = 5.0 * 0.3 / 141.0;

    fn points() -> impl Iterator<Item = Vec3> {
        let mut random = Random::new(11);
        (0..DRAWS).map(move |_| Vec3::from_array([0; 3].map(|_| random.range(-500.0, 500.0) as f32)))
    }

    #[test]
    fn gradient_noise_has_mean_zero_and_vanishes_on_the_lattice() {
        let lattice = Lattice::new(3);
        let mean = points().map(|p| f64::from(lattice.fractal(p, 3, 0.5))).sum::<f64>() / DRAWS as f64;
        assert!(mean.abs() < FIVE_SIGMA, "mean {mean}");
        assert_eq!(lattice.gradient(Vec3::new(-4.0, 7.0, 2.0)), 0.0);
    }

    #[test]
    fn a_periodic_lattice_repeats_and_an_unbounded_one_does_not() {
        let p = Vec3::new(1.25, -0.5, 3.75);
        let shifted = p + Vec3::new(8.0, -16.0, 24.0);
        let periodic = Lattice::periodic(5, 3);
        assert_eq!(periodic.cells(p), periodic.cells(shifted));
        assert_eq!(periodic.fractal(p, 3, 0.5), periodic.fractal(shifted, 3, 0.5));
        assert_ne!(Lattice::new(5).cells(p), Lattice::new(5).cells(shifted));
    }

    #[test]
    fn noise_is_continuous_across_lattice_planes() {
        /// The slope of either noise is below 4 per unit.
        const STEP: f32 = 1e-3;
        let lattice = Lattice::new(9);
        for p in points().take(200) {
            let at = Vec3::new(p.x.round(), p.y, p.z);
            let (low, high) = (at - Vec3::X * STEP, at + Vec3::X * STEP);
            assert!((lattice.gradient(low) - lattice.gradient(high)).abs() < 8.0 * STEP);
            assert!((lattice.cells(low) - lattice.cells(high)).abs() < 8.0 * STEP);
        }
    }
}
