//! A beam that has come through rain: what of it still goes straight, and what drops have turned aside on its way.
//!
//! \[weber\] eq. 12 has the sun as bright at every drop as above the rain. Rain of optical depth τ between them takes all but e^−τ of the
//! beam, and absorbs nothing of it: with probability e^−τ τ^k/k! light was scattered k times. Drops scatter forward, so that it still
//! comes from near the beam's direction and over about its way: after k times it is spread by p convolved with itself k times, and once
//! more by the drop that sends it to the eye. Of Henyey and Greenstein's function that is the same function of g^(k+1):
//!
//! p_τ(θ) = Σ_k e^−τ τ^k/k! p(g^(k+1), θ), with moments χ_l = g^l e^−τ(1 − g^l).
//!
//! It loses no light: its integral is 1 at every τ. Left out are longer ways of light that is turned far, and light that comes back
//! from below; along one ray through a layer the integral of p_τ e^−τ' over it is the same series with one more scattering in all, as it must be.
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | τ | optical depth of the rain between a place and the light | – |
//! | p, χ_l | phase function; its Legendre moments | 1/sr; – |
//! | g | asymmetry, χ_1 | – |

use super::Phase;
use crate::phase::henyey_greenstein;
use std::f64::consts::PI;

/// Depth, times 1 − g, up to which lobes are summed one by one; beyond, moments are few.
const DEEP: f64 = 2.0;
/// Depth beyond which lobes are one: below, e^−τ is a number, and they are as many.
const MOST_LOBES: f64 = 300.0;
/// What is left of the weights of lobes when their sum is cut; the rest goes to the last.
const REST: f64 = 1e-7;
/// Most moments, and the smallest that counts.
const MOMENTS: usize = 600;
const SMALLEST: f64 = 1e-7;

impl Phase {
    /// Value for light of a distant source behind rain of this optical depth, all that it still sends here counted, for the cosine between
    /// the directions in which it sets out and in which it is seen to travel; 1/sr per colour. At a depth of 0 the function itself.
    ///
    /// ```
    /// use squall_runtime::medium::Phase;
    ///
    /// let phase = Phase::HenyeyGreenstein(0.77);
    /// assert_eq!(phase.values_behind(0.0, 0.9), phase.values(0.9));
    /// // Right before the sun half a depth of rain takes three tenths of the glare (.294), and the rest of the sky gains it.
    /// assert!(phase.values_behind(0.5, 1.0)[0] < 0.71 * phase.values(1.0)[0]);
    /// assert!(phase.values_behind(0.5, -1.0)[0] > phase.values(-1.0)[0]);
    /// ```
    pub fn values_behind(&self, depth: f64, cos_theta: f64) -> [f64; 3] {
        if depth <= 0.0 {
            return self.values(cos_theta);
        }
        let (straight, again) = (libm::exp(-depth), self.values_again(depth, cos_theta));
        self.values(cos_theta).map(|value| straight * value + again)
    }

    /// The part of [`Phase::values_behind`] that was scattered before, 1/sr; of a table as if it were Henyey and Greenstein's function of
    /// the same mean cosine, since two turns leave nothing of a bow. 0 for \[weber\]'s function as printed, which no more than
    /// eq. 12 goes with.
    pub fn values_again(&self, depth: f64, cos_theta: f64) -> f64 {
        match self {
            Self::Paper(_) => 0.0,
            _ if depth <= 0.0 => 0.0,
            _ => {
                let g = self.moments(1).iter().sum::<f64>() / 3.0;
                if depth * (1.0 - g.abs()) <= DEEP {
                    by_lobes(g, depth, cos_theta)
                } else {
                    by_moments(g, depth, cos_theta)
                }
            }
        }
    }

    /// Legendre moments of [`Phase::values_again`].
    pub fn moments_again(&self, depth: f64, degree: usize) -> f64 {
        match self {
            Self::Paper(_) => 0.0,
            _ if depth <= 0.0 => 0.0,
            _ => {
                let g = self.moments(1).iter().sum::<f64>() / 3.0;
                moment((0..degree).fold(1.0, |product, _| product * g), depth)
            }
        }
    }
}

/// χ (e^−τ(1 − χ) − e^−τ): what is scattered before and then once more keeps of a degree of which p keeps χ.
fn moment(chi: f64, depth: f64) -> f64 {
    let lost = if chi >= 1.0 { 0.0 } else { depth * (1.0 - chi) };
    chi * (libm::exp(-lost) - libm::exp(-depth))
}

/// Σ_{k ≥ 1} e^−τ τ^k/k! p(g^(k+1), θ).
fn by_lobes(g: f64, depth: f64, cos_theta: f64) -> f64 {
    if depth > MOST_LOBES {
        // k is τ to a few √τ, and so many lobes, whose g differ by less than an eighth, are one; an odd and an even count are as likely.
        let wide = g.abs() * libm::exp(depth * libm::log(g.abs()));
        let even = henyey_greenstein(wide, cos_theta);
        return -libm::expm1(-depth) * 0.5 * (even + henyey_greenstein(wide.copysign(g), cos_theta));
    }
    let mut weight = libm::exp(-depth);
    let (mut asymmetry, mut left, mut sum) = (g, -libm::expm1(-depth), 0.0);
    let mut k = 0.0;
    while left > REST {
        k += 1.0;
        weight *= depth / k;
        asymmetry *= g;
        sum += weight.min(left) * henyey_greenstein(asymmetry, cos_theta);
        left -= weight;
    }
    sum + left.max(0.0) * henyey_greenstein(asymmetry, cos_theta)
}

/// The same by its moments: Σ_l (2 l + 1)/4π χ_l P_l(cos θ).
fn by_moments(g: f64, depth: f64, cos_theta: f64) -> f64 {
    let x = cos_theta.clamp(-1.0, 1.0);
    let (mut below, mut own, mut power, mut sum) = (0.0, 1.0, 1.0, 0.0);
    // Of a lobe backwards odd degrees die long before even ones.
    let mut before = f64::INFINITY;
    for l in 0..MOMENTS {
        let degree = l as f64;
        let share = (2.0 * degree + 1.0) * moment(power, depth);
        sum += share * own;
        if share.abs().max(before) < SMALLEST {
            break;
        }
        before = share.abs();
        (below, own) = (own, ((2.0 * degree + 1.0) * x * own - degree * below) / (degree + 1.0));
        power *= g;
    }
    (sum / (4.0 * PI)).max(0.0)
}

#[cfg(test)]
mod tests;
