//! Direction sets for discrete ordinates: which directions light travels in, and how much sphere each stands for.

use crate::error::ArgumentError;

/// A direction set by name.
///
/// ```
/// use squall_transport::quadrature::Quadrature;
///
/// let set = Quadrature::Lebedev26.ordinates()?;
/// // The mean of z² over the sphere is a third.
/// let mean: f64 = set.iter().map(|o| o.weight * o.direction[2] * o.direction[2]).sum();
/// assert!(set.len() == 26 && (mean - 1.0 / 3.0).abs() < 1e-14);
/// # Ok::<(), squall_transport::ArgumentError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quadrature {
    /// Lebedev's set of 14 directions, exact for polynomials up to degree 5.
    Lebedev14,
    /// Lebedev's set of 26 directions, degree 7; the directions of \[dobashi\].
    Lebedev26,
    /// Lebedev's set of 50 directions, degree 11.
    Lebedev50,
    /// Gauss–Legendre on each half range of the vertical cosine times an even ring of azimuths: fluxes through
    /// horizontal planes, which Lebedev sets miss by some per cent, come out right. \[lathrop-carlson\]
    DoubleGauss {
        /// Polar nodes in each hemisphere, 1 to 8.
        polar: u8,
        /// Azimuths on each ring, a multiple of 4.
        azimuths: u8,
    },
}

/// A direction and its share of the sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ordinate {
    /// Unit vector.
    pub direction: [f64; 3],
    /// Share of the sphere; the set's shares sum to 1.
    pub weight: f64,
}

impl Quadrature {
    /// The set's directions. Every set is closed under mirroring each axis, so that octants sweep alike and the
    /// discrete operator keeps reciprocity.
    ///
    /// Errors: a product set outside the ranges that [`Quadrature::DoubleGauss`] names.
    pub fn ordinates(self) -> Result<Vec<Ordinate>, ArgumentError> {
        let third = libm::sqrt(1.0 / 3.0);
        let half = libm::sqrt(0.5);
        Ok(match self {
            Self::Lebedev14 => [orbit([1.0, 0.0, 0.0], 1.0 / 15.0), orbit([third; 3], 3.0 / 40.0)].concat(),
            Self::Lebedev26 => [
                orbit([1.0, 0.0, 0.0], 1.0 / 21.0),
                orbit([half, half, 0.0], 4.0 / 105.0),
                orbit([third; 3], 9.0 / 280.0),
            ]
            .concat(),
            Self::Lebedev50 => {
                let short = libm::sqrt(1.0 / 11.0);
                [
                    orbit([1.0, 0.0, 0.0], 4.0 / 315.0),
                    orbit([half, half, 0.0], 64.0 / 2835.0),
                    orbit([third; 3], 27.0 / 1280.0),
                    orbit([short, short, 3.0 * short], 14_641.0 / 725_760.0),
                ]
                .concat()
            }
            Self::DoubleGauss { polar, azimuths } => {
                if !(1..=8).contains(&polar) || azimuths == 0 || azimuths % 4 != 0 {
                    let found = format!("{polar} × {azimuths}");
                    let wanted = "1 to 8 polar nodes and a multiple of 4 azimuths";
                    return Err(ArgumentError::new("direction set", wanted, found));
                }
                let mut set = Vec::new();
                for (node, weight) in gauss_legendre(usize::from(polar)) {
                    // From [−1, 1] to the half range [0, 1].
                    let (mu, share) = (0.5 * (1.0 + node), 0.25 * weight);
                    let rho = libm::sqrt(1.0 - mu * mu);
                    for i in 0..usize::from(azimuths) {
                        let angle = std::f64::consts::TAU * (i as f64 + 0.5) / f64::from(azimuths);
                        let (sin, cos) = libm::sincos(angle);
                        for sign in [1.0, -1.0] {
                            set.push(Ordinate {
                                direction: [rho * cos, rho * sin, sign * mu],
                                weight: share / f64::from(azimuths),
                            });
                        }
                    }
                }
                set
            }
        })
    }
}

/// All images of `point` under permuting and mirroring the axes, each with `weight`, in a fixed order.
fn orbit(point: [f64; 3], weight: f64) -> Vec<Ordinate> {
    let mut set: Vec<Ordinate> = Vec::new();
    for [i, j, k] in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [1, 0, 2], [2, 1, 0]] {
        for signs in 0..8 {
            let sign = |bit: usize| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            // Adding 0 turns −0 into 0, so that images on an axis compare equal.
            let direction = [point[i] * sign(0) + 0.0, point[j] * sign(1) + 0.0, point[k] * sign(2) + 0.0];
            if set.iter().all(|o| o.direction != direction) {
                set.push(Ordinate { direction, weight });
            }
        }
    }
    set
}

/// Nodes and weights of Gauss–Legendre quadrature on [−1, 1], weights summing to 2 (Newton on the recurrence).
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    (0..count)
        .map(|i| {
            let mut x = libm::cos(std::f64::consts::PI * (i as f64 + 0.75) / (n + 0.5));
            let mut slope = 1.0;
            // Quadratic convergence from an asymptotic start: six steps reach round-off for any count used here.
            for _ in 0..8 {
                let (mut below, mut value) = (1.0, x);
                for k in 2..=count {
                    let k = k as f64;
                    (below, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * below) / k);
                }
                if count == 1 {
                    below = 1.0;
                }
                slope = n * (x * value - below) / (x * x - 1.0);
                x -= value / slope;
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROUND_OFF: f64 = 1e-13;

    const SETS: [(Quadrature, usize, i32); 5] = [
        (Quadrature::Lebedev14, 14, 5),
        (Quadrature::Lebedev26, 26, 7),
        (Quadrature::Lebedev50, 50, 11),
        (Quadrature::DoubleGauss { polar: 2, azimuths: 8 }, 32, 3),
        (Quadrature::DoubleGauss { polar: 4, azimuths: 16 }, 128, 7),
    ];

    /// Mean of x^i y^j z^k over the sphere: products of double factorials.
    fn exact(powers: [i32; 3]) -> f64 {
        let double_factorial = |n: i32| (1..=n).rev().step_by(2).map(f64::from).product::<f64>();
        if powers.iter().any(|p| p % 2 == 1) {
            return 0.0;
        }
        powers.iter().map(|p| double_factorial(p - 1)).product::<f64>()
            / double_factorial(powers.iter().sum::<i32>() + 1)
    }

    #[test]
    fn each_set_integrates_polynomials_up_to_its_degree() {
        for (set, count, degree) in SETS {
            let ordinates = set.ordinates().unwrap();
            assert_eq!(ordinates.len(), count);
            for (i, j, k) in (0..=degree)
                .flat_map(|i| (0..=degree).flat_map(move |j| (0..=degree).map(move |k| (i, j, k))))
            {
                if i + j + k > degree {
                    continue;
                }
                let power = |x: f64, n: i32| (0..n).map(|_| x).product::<f64>();
                let mean: f64 = ordinates
                    .iter()
                    .map(|o| {
                        o.weight
                            * power(o.direction[0], i)
                            * power(o.direction[1], j)
                            * power(o.direction[2], k)
                    })
                    .sum();
                assert!((mean - exact([i, j, k])).abs() < ROUND_OFF, "{set:?}: x^{i} y^{j} z^{k}: {mean}");
            }
        }
    }

    #[test]
    fn double_gauss_carries_half_range_fluxes_that_lebedev_sets_miss() {
        let upward = |set: Quadrature| -> f64 {
            set.ordinates().unwrap().iter().map(|o| o.weight * o.direction[2].max(0.0)).sum()
        };
        // Isotropic light crosses a plane with a quarter of its speed.
        assert!((upward(Quadrature::DoubleGauss { polar: 3, azimuths: 12 }) - 0.25).abs() < ROUND_OFF);
        assert!((upward(Quadrature::Lebedev26) - 0.25).abs() > 0.005);
    }

    #[test]
    fn every_set_is_closed_under_mirroring_an_axis() {
        for (set, ..) in SETS {
            let ordinates = set.ordinates().unwrap();
            for o in &ordinates {
                for axis in 0..3 {
                    let mut mirrored = o.direction;
                    mirrored[axis] = -mirrored[axis];
                    let found = ordinates.iter().any(|p| {
                        (0..3).all(|a| (p.direction[a] - mirrored[a]).abs() < ROUND_OFF)
                            && p.weight == o.weight
                    });
                    assert!(found, "{set:?} {o:?}");
                }
            }
        }
    }
}
