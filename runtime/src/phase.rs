//! Phase functions: how scattered light spreads over directions, per steradian.
//!
//! The argument is the cosine between the TRAVEL directions before and after; +1 is forward. Every function
//! here integrates to 1 over the sphere but for the one that is named `paper`.

use std::f64::consts::PI;

/// Henyey and Greenstein's function, 1/sr: (1−g²) / (4π (1 + g² − 2g cos θ)^{3/2}), for −1 < g < 1.
pub fn henyey_greenstein(g: f64, cos_theta: f64) -> f64 {
    // 1 + g² − 2g cos θ, in a form that keeps its digits at the peak of a narrow function.
    let narrow = 1.0 - g.abs();
    let base =
        narrow * narrow + 2.0 * g.abs() * (1.0 - if g < 0.0 { -cos_theta } else { cos_theta }).max(0.0);
    (1.0 - g * g) / (4.0 * PI * base * libm::sqrt(base))
}

/// The same as the rain paper prints it, with (1−g)² in place of 1−g²: integrates to (1−g)/(1+g), 0.053 at
/// g = 0.9, and so loses most of the light. \[weber\] eq. 10; kept as the baseline that charts compare with.
pub fn paper_henyey_greenstein(g: f64, cos_theta: f64) -> f64 {
    henyey_greenstein(g, cos_theta) * (1.0 - g) / (1.0 + g)
}

/// Henyey and Greenstein's function prepared for one g, in single precision.
#[derive(Clone, Copy, Debug)]
pub struct PreparedHg {
    scale: f32,
    /// (1 − |g|)²: the base at its peak.
    narrow: f32,
    /// 2|g|.
    twice: f32,
    /// 1 for forward scattering, −1 for backward.
    sign: f32,
}

impl PreparedHg {
    /// Prepares for asymmetry parameter `g`, −1 < g < 1.
    pub fn new(g: f64) -> Self {
        Self {
            scale: ((1.0 - g * g) / (4.0 * PI)) as f32,
            narrow: ((1.0 - g.abs()) * (1.0 - g.abs())) as f32,
            twice: (2.0 * g.abs()) as f32,
            sign: if g < 0.0 { -1.0 } else { 1.0 },
        }
    }

    /// The function's value, 1/sr.
    #[inline(always)]
    pub fn value(self, cos_theta: f32) -> f32 {
        // 1 + g² − 2g cos θ = (1 − |g|)² + 2|g| (1 ∓ cos θ): at the peak of a narrow function the first form is a difference
        // of numbers near 2. A cosine that round-off carried beyond 1 counts as 1.
        let base = self.narrow + self.twice * (1.0 - self.sign * cos_theta).max(0.0);
        self.scale / (base * base.sqrt()).max(f32::MIN_POSITIVE)
    }
}

/// A phase function cut for discrete ordinates: the forward peak `forward` counts as unscattered, the rest has
/// Legendre moments `moments` up to the solver's degree.
///
/// Delta-M of Wiscombe for Henyey–Greenstein: with degree L, f = g^{L+1} and χ_l = (g^l − f)/(1 − f); for L = 1
/// that is f = g², χ_1 = g/(1+g), and the second moment of what is left vanishes exactly. Backward scattering
/// (g ≤ 0) has no forward peak to cut: f = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeltaM {
    /// Share f of scattering that counts as unscattered.
    pub forward: f64,
    /// Extinction after scaling over extinction before: 1 − ωf.
    pub extinction_scale: f64,
    /// Single-scattering albedo after scaling.
    pub albedo: f64,
    /// Legendre moments χ_0…χ_3 after scaling; those above the degree are zero.
    pub moments: [f64; 4],
}

impl DeltaM {
    /// Scales albedo ω in [0, 1] and asymmetry −1 < g < 1 for a solver of degree 0 to 3.
    pub fn new(albedo: f64, g: f64, degree: usize) -> Self {
        let power = |n: usize| (0..n).fold(1.0, |product, _| product * g);
        let forward = if g > 0.0 { power(degree + 1) } else { 0.0 };
        Self::with_forward(albedo, g, degree, forward)
    }

    /// No scaling: raw moments g^l. Kept so that charts can show what scaling buys.
    pub fn unscaled(albedo: f64, g: f64, degree: usize) -> Self {
        Self::with_forward(albedo, g, degree, 0.0)
    }

    fn with_forward(albedo: f64, g: f64, degree: usize, forward: f64) -> Self {
        let extinction_scale = 1.0 - albedo * forward;
        let mut moments = [0.0; 4];
        let mut power = 1.0;
        for moment in moments.iter_mut().take(degree + 1) {
            *moment = (power - forward) / (1.0 - forward);
            power *= g;
        }
        Self { forward, extinction_scale, albedo: (1.0 - forward) * albedo / extinction_scale, moments }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 400 000 midpoint intervals over a peak of width 1 − g = .05 leave an error far below this.
    const QUADRATURE_ERROR: f64 = 1e-5;

    fn sphere_integral(phase: impl Fn(f64) -> f64) -> f64 {
        let count = 400_000;
        let step = 2.0 / f64::from(count);
        (0..count).map(|i| phase(-1.0 + (f64::from(i) + 0.5) * step)).sum::<f64>() * step * 2.0 * PI
    }

    #[test]
    fn henyey_greenstein_integrates_to_one_with_mean_cosine_g() {
        for g in [-0.9, -0.3, 0.0, 0.5, 0.85, 0.95] {
            assert!((sphere_integral(|c| henyey_greenstein(g, c)) - 1.0).abs() < QUADRATURE_ERROR);
            assert!((sphere_integral(|c| c * henyey_greenstein(g, c)) - g).abs() < QUADRATURE_ERROR);
        }
    }

    #[test]
    fn the_printed_function_integrates_to_one_minus_g_over_one_plus_g() {
        for g in [0.0, 0.5, 0.9] {
            let found = sphere_integral(|c| paper_henyey_greenstein(g, c));
            assert!((found - (1.0 - g) / (1.0 + g)).abs() < QUADRATURE_ERROR);
            let printed = (1.0 - g) * (1.0 - g) / (4.0 * PI * libm::pow(1.0 + g * g - 1.2 * g, 1.5));
            assert!((paper_henyey_greenstein(g, 0.6) - printed).abs() < 1e-15);
        }
        assert!((sphere_integral(|c| paper_henyey_greenstein(0.9, c)) - 0.053).abs() < 5e-4);
    }

    #[test]
    fn prepared_values_are_the_formulas_in_single_precision() {
        for g in [-0.5, 0.0, 0.85, 0.99] {
            for c in [-1.0, -0.2, 0.7, 1.0] {
                let exact = henyey_greenstein(g, c);
                // Cancellation in 1 + g² − 2gc near the peak costs up to (1−g)⁻² of the last bits.
                let tolerance = 4e-7 / ((1.0 - g.abs()) * (1.0 - g.abs())).min(1.0) * exact;
                assert!((f64::from(PreparedHg::new(g).value(c as f32)) - exact).abs() <= tolerance);
            }
        }
    }

    #[test]
    fn delta_scaling_keeps_absorption_and_transport_extinction() {
        for (albedo, g, degree) in [(0.999, 0.85, 1), (0.9, 0.5, 3), (1.0, -0.4, 1), (0.5, 0.99, 3)] {
            let scaled = DeltaM::new(albedo, g, degree);
            let absorption = scaled.extinction_scale * (1.0 - scaled.albedo);
            let transport = scaled.extinction_scale * (1.0 - scaled.albedo * scaled.moments[1]);
            assert!((absorption - (1.0 - albedo)).abs() < 1e-14);
            assert!((transport - (1.0 - albedo * g)).abs() < 1e-14);
            assert_eq!(scaled.moments[0], 1.0);
        }
        assert!((DeltaM::new(1.0, 0.85, 1).moments[1] - 0.85 / 1.85).abs() < 1e-15);
    }
}
