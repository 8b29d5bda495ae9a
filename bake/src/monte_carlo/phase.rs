//! Henyey and Greenstein's phase function, sampled: its value, and directions drawn from it.
//!
//! With ξ uniform in [0, 1), the inverse of the cumulative function is written so that nothing cancels and nothing divides by
//! g: 1 − cos θ = 2 (1−g)² (1−ξ)((1+g)−g(1−ξ)) / (1−g+2gξ)², and 1 + cos θ = 2 (1+g)² ξ ((1−g)+gξ) / (1−g+2gξ)². Their product is
//! sin² θ, right to the last digits in the narrowest peak and at g = 0 alike.

use glam::DVec3;
use squall_runtime::random::Random;

/// Henyey and Greenstein's function for one g, −1 < g < 1. \[henyey-greenstein\]
#[derive(Clone, Copy, Debug)]
pub struct Phase {
    g: f64,
    scale: f64,
}

impl Phase {
    /// For asymmetry parameter `g`.
    pub fn new(g: f64) -> Self {
        Self { g, scale: (1.0 - g) * (1.0 + g) / (4.0 * std::f64::consts::PI) }
    }

    /// Value at the cosine between two unit directions of travel, 1/sr.
    #[inline]
    pub fn value(&self, from: DVec3, to: DVec3) -> f64 {
        // 1 − cos θ from the difference of the directions: near the peak of a large g it must not be a difference of ones.
        let less = 0.5 * (from - to).length_squared();
        let base = (1.0 - self.g) * (1.0 - self.g) + 2.0 * self.g * less;
        // Round-off must not carry the base below its least value, (1 − |g|)².
        let least = (1.0 - self.g.abs()) * (1.0 - self.g.abs());
        let base = base.max(least);
        self.scale / (base * base.sqrt())
    }

    /// Cosine and sine of a scattering angle, for ξ in [0, 1).
    fn angle(&self, xi: f64) -> (f64, f64) {
        let g = self.g;
        let root = (1.0 - g) * (1.0 - xi) + (1.0 + g) * xi;
        let (narrow, wide) = ((1.0 - g) / root, (1.0 + g) / root);
        let less = 2.0 * narrow * narrow * (1.0 - xi) * ((1.0 + g) - g * (1.0 - xi));
        let more = 2.0 * wide * wide * xi * ((1.0 - g) + g * xi);
        (0.5 * (more - less), (less * more).max(0.0).sqrt())
    }

    /// A new direction of travel for light that travelled along unit `direction`.
    #[inline]
    pub fn scatter(&self, direction: DVec3, random: &mut Random) -> DVec3 {
        let (cos, sin) = self.angle(random.unit());
        let (x, y) = azimuth(random);
        let turned = around(direction, cos, sin * x, sin * y);
        // One step towards unit length: round-off must not add up over a million scatterings.
        turned * (1.5 - 0.5 * turned.length_squared())
    }
}

/// Cosine and sine of a uniform angle: a point in the unit disc, its angle doubled.
pub fn azimuth(random: &mut Random) -> (f64, f64) {
    loop {
        let (x, y) = (2.0 * random.unit() - 1.0, 2.0 * random.unit() - 1.0);
        let square = x * x + y * y;
        if square <= 1.0 && square > 1e-30 {
            return ((x * x - y * y) / square, 2.0 * x * y / square);
        }
    }
}

/// `cos` along unit `axis` and x, y along two unit vectors across it.
///
/// [duff]: the sign keeps the two vectors exact at both poles.
#[inline]
pub fn around(axis: DVec3, cos: f64, x: f64, y: f64) -> DVec3 {
    let sign = 1f64.copysign(axis.z);
    let a = -1.0 / (sign + axis.z);
    let b = axis.x * axis.y * a;
    let first = DVec3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x);
    let second = DVec3::new(b, sign + axis.y * axis.y * a, -axis.y);
    axis * cos + first * x + second * y
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn drawn_angles_have_the_cumulative_distribution_of_the_function() {
        /// Round-off, in an angle's cosine as ξ comes back from it.
        const ROUND_OFF: f64 = 1e-9;
        for g in [-0.99, -0.5, -1e-9, 0.0, 1e-12, 0.3, 0.85, 0.9999] {
            let phase = Phase::new(g);
            for k in 0..=1000 {
                let xi = f64::from(k) / 1000.0;
                let (cos, sin) = phase.angle(xi);
                assert!((cos * cos + sin * sin - 1.0).abs() < 1e-14, "{g} {xi}");
                // ∫ p dΩ from cos θ = −1: (1−g²)/2g (1/√(1+g²−2gc) − 1/(1+g)), written without the division by g.
                let root = (1.0 + g * g - 2.0 * g * cos).max(0.0).sqrt();
                let found = (1.0 - g) * (1.0 + cos) / (root * (1.0 + g + root));
                let tolerance = ROUND_OFF / ((1.0 - g.abs()) * (1.0 - g.abs())).min(1.0);
                assert!((found - xi).abs() < tolerance.min(1e-4), "{g} {xi}: {found}");
            }
        }
    }

    #[test]
    fn the_function_integrates_to_one_with_mean_cosine_g() {
        /// 200 000 midpoints over a peak whose 1 − cosine is .001 wide.
        const QUADRATURE: f64 = 1e-5;
        for g in [-0.95, 0.0, 0.5, 0.95] {
            let phase = Phase::new(g);
            let count = 200_000;
            let (mut sum, mut mean) = (0.0, 0.0);
            for i in 0..count {
                let cos = -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(count);
                let to = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                let share = phase.value(DVec3::Z, to) * 4.0 * PI / f64::from(count);
                sum += share;
                mean += share * cos;
            }
            assert!((sum - 1.0).abs() < QUADRATURE && (mean - g).abs() < QUADRATURE, "{g}: {sum} {mean}");
        }
    }

    #[test]
    fn scattered_directions_are_unit_vectors_with_mean_cosine_g_about_any_axis() {
        const DRAWS: u32 = 100_000;
        /// Five standard errors of a mean of so many numbers within ±1.
        const FIVE_SIGMA: f64 = 5.0 / 316.0;
        let mut random = Random::new(4);
        for axis in [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::new(-0.6, 0.0, -0.8)] {
            for g in [-0.7, 0.0, 0.9] {
                let phase = Phase::new(g);
                let mut sum = DVec3::ZERO;
                for _ in 0..DRAWS {
                    let direction = phase.scatter(axis, &mut random);
                    assert!((direction.length() - 1.0).abs() < 1e-14);
                    sum += direction;
                }
                let mean = sum / f64::from(DRAWS);
                assert!((mean - axis * g).length() < FIVE_SIGMA, "{axis} {g}: {mean}");
            }
        }
    }
}
