//! Phase functions: how scattered light spreads over directions, per steradian.
//!
//! The argument is the cosine between the TRAVEL directions before and after; +1 is forward. Every function
//! here integrates to 1 over the sphere but for the one that is named `paper`.

use std::f64::consts::PI;

/// Henyey and Greenstein's function, 1/sr: (1−g²) / (4π (1 + g² − 2g cos θ)^{3/2}), for −1 < g < 1.
pub fn henyey_greenstein(g: f64, cos_theta: f64) -> f64 {
    let base = 1.0 + g * g - 2.0 * g * cos_theta;
    (1.0 - g * g) / (4.0 * PI * base * libm::sqrt(base))
}

/// The same as the rain paper prints it, with (1−g)² in place of 1−g²: integrates to (1−g)/(1+g), 0.053 at
/// g = 0.9, and so loses most of the light. [weber] eq. 10; kept as the baseline that charts compare with.
pub fn paper_henyey_greenstein(g: f64, cos_theta: f64) -> f64 {
    henyey_greenstein(g, cos_theta) * (1.0 - g) / (1.0 + g)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 400 000 midpoint intervals leave 5e-7 of a peak as sharp as that of g = .95.
    const QUADRATURE_ERROR: f64 = 1e-5;

    fn sphere_integral(phase: impl Fn(f64) -> f64) -> f64 {
        let count = 400_000;
        let step = 2.0 / f64::from(count);
        (0..count).map(|i| phase(-1.0 + (f64::from(i) + 0.5) * step)).sum::<f64>() * step * 2.0 * PI
    }

    #[test]
    fn henyey_greenstein_integrates_to_one_with_mean_cosine_g() {
        for g in [-0.9, -0.3, 0.0, 0.5, 0.77, 0.884, 0.95] {
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
}
