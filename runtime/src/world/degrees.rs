//! Real spherical harmonics to a degree at which a horizon, blurred by rain, is told from a smooth one.
//!
//! Order: number l² + l + m, m from −l to l; the first nine are [`crate::shade::sky::harmonics`]'. Of a black
//! ground under an even sky, degree 20 leaves out .0007 of the step's height at g = .77 and .012 at g = .884: the next odd
//! degree's own, .165 g²¹.

#[cfg(feature = "gpu")]
mod upload;

use glam::{DVec3, Vec3};
use std::f64::consts::{PI, SQRT_2};

/// Highest degree.
pub const DEGREE: usize = 20;
/// Harmonics up to it.
pub const COUNT: usize = (DEGREE + 1) * (DEGREE + 1);
/// Rings at Gauss and Legendre's heights and directions on each that a world is sampled at.
pub(crate) const RINGS: usize = 64;
pub(crate) const SPOKES: usize = 128;

/// Degree of the i-th harmonic.
pub fn degree_of(i: usize) -> usize {
    i.isqrt()
}

/// Factors of the recurrence in l, once for many directions.
pub struct Basis {
    /// a and a·b of Q_l = a z Q_{l−1} − a b Q_{l−2}, by number l² + l + m, m ≥ 0.
    steps: [[f64; 2]; COUNT],
    /// Q_mm.
    starts: [f64; DEGREE + 1],
}

impl Basis {
    pub fn new() -> Self {
        let mut basis = Self { steps: [[0.0; 2]; COUNT], starts: [0.0; DEGREE + 1] };
        let mut start = (1.0 / (4.0 * PI)).sqrt();
        for m in 0..=DEGREE {
            if m > 0 {
                start *= ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
            }
            basis.starts[m] = start;
            for l in m + 1..=DEGREE {
                let (lf, mf) = (l as f64, m as f64);
                let a = ((4.0 * lf * lf - 1.0) / (lf * lf - mf * mf)).sqrt();
                let below = lf - 1.0;
                let b = ((below * below - mf * mf) / (4.0 * below * below - 1.0)).max(0.0).sqrt();
                basis.steps[l * l + l + m] = [a, a * b];
            }
        }
        basis
    }

    /// The factors a and a·b of Q_l = a z Q_{l−1} − a b Q_{l−2} for the pair of degree `l` and order `m`, and Q_mm.
    #[cfg(feature = "gpu")]
    pub(crate) fn step(&self, l: usize, m: usize) -> ([f64; 2], f64) {
        (self.steps[l * l + l + m], self.starts[m])
    }

    /// The value of every harmonic in unit direction `d`.
    pub fn values(&self, d: DVec3) -> [f64; COUNT] {
        let mut values = [0.0; COUNT];
        // Real and imaginary part of (x + iy)^m.
        let (mut re, mut im) = (1.0, 0.0);
        for m in 0..=DEGREE {
            if m > 0 {
                (re, im) = (re * d.x - im * d.y, re * d.y + im * d.x);
            }
            let (mut below, mut own) = (0.0, self.starts[m]);
            for l in m..=DEGREE {
                let middle = l * l + l;
                if l > m {
                    let [a, ab] = self.steps[middle + m];
                    (below, own) = (own, a * d.z * own - ab * below);
                }
                if m == 0 {
                    values[middle] = own;
                } else {
                    values[middle + m] = SQRT_2 * own * re;
                    values[middle - m] = SQRT_2 * own * im;
                }
            }
        }
        values
    }

    /// The function with these coefficients in unit direction `d`.
    pub fn sum(&self, coefficients: &[[f32; 3]], d: DVec3) -> [f32; 3] {
        let mut sum = [0.0f64; 3];
        for (value, coefficient) in self.values(d).iter().zip(coefficients) {
            (0..3).for_each(|band| sum[band] += value * f64::from(coefficient[band]));
        }
        sum.map(|value| value as f32)
    }
}

/// Heights and weights of Gauss and Legendre's rule, by Newton's steps from its asymptotic nodes. (The transport's own needs a
/// feature that a runtime may lack.)
pub(crate) fn rings() -> impl Iterator<Item = [f64; 2]> {
    let count = RINGS as f64;
    (0..RINGS).map(move |ring| {
        let mut z = libm::cos(PI * (ring as f64 + 0.75) / (count + 0.5));
        let mut slope = 0.0;
        for _ in 0..6 {
            let (mut below, mut own) = (1.0, z);
            for l in 2..=RINGS {
                let l = l as f64;
                (below, own) = (own, ((2.0 * l - 1.0) * z * own - (l - 1.0) * below) / l);
            }
            slope = count * (z * own - below) / (z * z - 1.0);
            z -= own / slope;
        }
        [z, 2.0 / ((1.0 - z * z) * slope * slope)]
    })
}

/// Coefficients of a function on the sphere, exact for harmonics up to the highest degree. What is not finite counts as 0.
pub fn project(value: &dyn Fn(Vec3) -> [f32; 3]) -> Vec<[f32; 3]> {
    let basis = Basis::new();
    let mut sums = vec![[0.0f64; 3]; COUNT];
    for [z, weight] in rings() {
        let share = weight * 2.0 * PI / SPOKES as f64;
        let rho = (1.0 - z * z).sqrt();
        for spoke in 0..SPOKES {
            let (sin, cos) = libm::sincos(2.0 * PI * (spoke as f64 + 0.5) / SPOKES as f64);
            let direction = DVec3::new(rho * cos, rho * sin, z);
            let radiance = value(direction.as_vec3()).map(|v| if v.is_finite() { f64::from(v) } else { 0.0 });
            if radiance == [0.0; 3] {
                continue;
            }
            for (sum, value) in sums.iter_mut().zip(basis.values(direction)) {
                (0..3).for_each(|band| sum[band] += value * share * radiance[band]);
            }
        }
    }
    sums.iter().map(|sum| sum.map(|value| value as f32)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::shade::sky::harmonics;

    #[test]
    fn harmonics_are_orthonormal_and_begin_as_the_skys_do() {
        /// Round-off of f32 coefficients, and of the sky's own equal-area midpoints.
        const ROUND_OFF: f32 = 1e-5;
        const MIDPOINTS: f32 = 1e-2;
        let mut random = Random::new(2);
        let basis = Basis::new();
        for i in [0, 1, 3, 7, 8, 12, 40, 100, COUNT - 1] {
            let own = project(&|d| [basis.values(d.as_dvec3())[i] as f32; 3]);
            for (k, value) in own.iter().enumerate() {
                let wanted = if k == i { 1.0 } else { 0.0 };
                assert!((value[0] - wanted).abs() < ROUND_OFF, "{i} {k} {value:?}");
            }
        }
        let lit = |d: Vec3| [(d.x + 2.0 * d.z).max(0.0), 1.0 + d.y * d.z, 0.3];
        let (ours, theirs) = (project(&lit), harmonics::project(lit));
        for (a, b) in ours.iter().zip(theirs) {
            assert!((0..3).all(|band| (a[band] - b[band]).abs() < MIDPOINTS), "{a:?} {b:?}");
        }
        let d = random.direction();
        let sum: f64 = basis.values(d).iter().map(|v| v * v).sum();
        // Unsöld: the squares of a degree sum to (2l + 1)/4π, whatever the direction.
        assert!((sum - COUNT as f64 / (4.0 * PI)).abs() < 1e-10);
    }
}
