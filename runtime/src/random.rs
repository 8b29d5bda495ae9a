//! Repeatable random numbers: a seed is an argument, and the same seed gives the same numbers everywhere.

use glam::DVec3;

/// Mixes 64 bits so that every input bit reaches every output bit (the finaliser of SplitMix64).
pub const fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// One hash of several numbers: a bin and a lattice cell, a seed and a stroke's number.
pub fn hash(parts: &[u64]) -> u64 {
    parts.iter().fold(0x5155_414C_4C00_0001, |state, &part| mix(state ^ mix(part)))
}

/// SplitMix64: one add and one [`mix`] a number, period 2⁶⁴, streams told apart by their seed's hash.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
}

impl Random {
    /// A stream for `seed`; neighbouring seeds give unrelated streams.
    pub const fn new(seed: u64) -> Self {
        Self { state: mix(seed) }
    }

    /// A stream for several numbers together.
    pub fn from_parts(parts: &[u64]) -> Self {
        Self { state: hash(parts) }
    }

    /// 64 uniform bits.
    pub fn bits(&mut self) -> u64 {
        let out = mix(self.state);
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        out
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Uniform in 0..count.
    pub fn below(&mut self, count: u64) -> u64 {
        ((u128::from(self.bits()) * u128::from(count)) >> 64) as u64
    }

    /// Normal with mean 0 and variance 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }

    /// Exponential with mean 1.
    pub fn exponential(&mut self) -> f64 {
        -libm::log(1.0 - self.unit())
    }

    /// Poisson with the given mean: products of uniforms, in steps of 16 so that none underflows.
    pub fn poisson(&mut self, mean: f64) -> u32 {
        const STEP: f64 = 16.0;
        let (mut left, mut count) = (mean, 0);
        while left > 0.0 {
            let floor = libm::exp(-left.min(STEP));
            let mut product = self.unit();
            while product > floor {
                product *= self.unit();
                count += 1;
            }
            left -= STEP;
        }
        count
    }

    /// A direction uniform over the sphere.
    pub fn direction(&mut self) -> DVec3 {
        let z = self.range(-1.0, 1.0);
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * self.unit());
        let rho = libm::sqrt((1.0 - z * z).max(0.0));
        DVec3::new(rho * cos, rho * sin, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRAWS: usize = 200_000;
    /// Five standard errors of a mean of `DRAWS` unit-variance numbers.
    const FIVE_SIGMA: f64 = 5.0 / 447.0;

    #[test]
    fn moments_are_those_of_the_named_distributions() {
        let mut random = Random::new(7);
        let mean = |values: &mut dyn FnMut() -> f64| (0..DRAWS).map(|_| values()).sum::<f64>() / DRAWS as f64;
        assert!((mean(&mut || random.unit()) - 0.5).abs() < FIVE_SIGMA);
        assert!(mean(&mut || random.normal()).abs() < FIVE_SIGMA);
        assert!((mean(&mut || random.exponential()) - 1.0).abs() < FIVE_SIGMA);
        for lambda in [0.3, 8.0, 40.0] {
            let scaled = mean(&mut || (f64::from(random.poisson(lambda)) - lambda) / libm::sqrt(lambda));
            assert!(scaled.abs() < FIVE_SIGMA, "Poisson mean {lambda}");
        }
        assert!(mean(&mut || random.direction().z).abs() < FIVE_SIGMA);
    }

    #[test]
    fn the_same_seed_gives_the_same_numbers_and_neighbours_do_not() {
        let draw = |seed| Random::new(seed).bits();
        assert_eq!(draw(3), draw(3));
        assert_ne!(draw(3), draw(4));
        assert_ne!(hash(&[1, 2]), hash(&[2, 1]));
    }
}
