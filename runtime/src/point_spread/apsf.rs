//! The baseline of \[narasimhan-nayar\]: what their series says of light of all orders around a point in an even medium.
//!
//! I(T, μ) = Σ (g_m(T) + g_{m+1}(T)) P_m(μ), m = 0, 1, …, P_m Legendre's polynomials, g_0 = 0 and
//! g_m(T) = e^{−β_m T} T^{−(m+1)}, β_m = (2m + 1)/m · (1 − q^{m−1}): theirs for any phase function, 1 − W_{m−1}/(2m − 1) in place of
//! 1 − q^{m−1}, with Henyey and Greenstein's W_m = (2m + 1) q^m. β_1 = 0: g_1 falls as T^−2, and no light is lost.
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | T | optical depth from the light to the eye, above 1: below, the series runs away | – |
//! | μ | cosine of the angle beside the light at which one looks | – |
//! | q | asymmetry, from 0; g of Henyey and Greenstein's function, up to which theirs agree | – |

use std::f64::consts::PI;

/// Most terms; the series ends where they no longer change it.
const TERMS: u32 = 400;
/// Share of the sum below which terms change nothing.
const NOTHING: f64 = 1e-12;

fn growth(m: u32, depth: f64, asymmetry: f64) -> f64 {
    if m == 0 {
        return 0.0;
    }
    let m = f64::from(m);
    let rate = (2.0 * m + 1.0) / m * (1.0 - libm::pow(asymmetry, m - 1.0));
    libm::exp(-rate * depth - (m + 1.0) * libm::log(depth))
}

/// ρ-free radiance of all light, scattered and not, of a point of 1 W/sr in a medium of extinction 1 that scatters all it takes, by the
/// series, 1/sr: brought to the scale at which all light passes a far sphere, ∮ I μ dω = 1/T². `depth` > 1; `cosine` in [−1, 1];
/// `asymmetry` in [0, 1).
///
/// Where the series says less than nothing it is left so.
pub fn series(depth: f64, cosine: f64, asymmetry: f64) -> f64 {
    let (mut sum, mut before, mut polynomial) = (0.0, 0.0, 1.0);
    let mut own = growth(0, depth, asymmetry);
    for m in 0..TERMS {
        let next = growth(m + 1, depth, asymmetry);
        sum += (own + next) * polynomial;
        if m > 2 && next <= NOTHING * f64::abs(sum) {
            break;
        }
        // (m + 1) P_{m+1} = (2m + 1) μ P_m − m P_{m−1}.
        let m = f64::from(m);
        let after = ((2.0 * m + 1.0) * cosine * polynomial - m * before) / (m + 1.0);
        (before, polynomial, own) = (polynomial, after, next);
    }
    // P_1 alone carries light through the sphere: ∮ P_1 μ dω = 4π/3.
    let carried = (growth(1, depth, asymmetry) + growth(2, depth, asymmetry)) * 4.0 * PI / 3.0;
    sum / (carried * depth * depth)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airlight::{Airlight, PointBeside};
    use crate::medium::Phase;
    use crate::point_spread::PointSpread;

    #[test]
    fn the_series_sends_all_light_through_a_sphere() {
        /// Midpoint sums of a smooth function.
        const STEPS: f64 = 1e-4;
        for (depth, asymmetry) in [(1.2, 0.2), (2.0, 0.5), (4.0, 0.77), (4.0, 0.9)] {
            let steps = 4000;
            let part = |i: u32| {
                let cosine = (f64::from(i) + 0.5) / f64::from(steps) * 2.0 - 1.0;
                series(depth, cosine, asymmetry) * cosine * 4.0 * PI / f64::from(steps)
            };
            let sum: f64 = (0..steps).map(part).sum();
            assert!((sum * depth * depth - 1.0).abs() < STEPS, "{depth} {asymmetry}: {sum}");
        }
    }

    /// Scattered light of all orders by our tables, the same units.
    fn ours(depth: f64, angle: f64, (once, more): (&Airlight, &PointSpread)) -> f64 {
        let (sin, cos) = libm::sincos(angle);
        let beside = PointBeside { h: depth * sin, foot: depth * cos, end: f64::INFINITY };
        once.of_point(1.0, &beside)[1] + more.lookup_seen(depth, libm::sin(0.5 * angle))[1]
    }

    #[test]
    fn the_series_is_wider_than_light_is_that_photons_carry() {
        let mut widest = 0.0f64;
        for asymmetry in [0.2, 0.77, 0.9] {
            let phase = Phase::HenyeyGreenstein(asymmetry);
            let tables = (&Airlight::new(&phase), &PointSpread::new(&phase));
            for depth in [1.2, 2.0, 4.0] {
                let of =
                    |angle: f64| (ours(depth, angle, tables), series(depth, libm::cos(angle), asymmetry));
                let row: Vec<String> = [0.02, 0.1, 0.3, 0.6, 1.0, 2.0]
                    .into_iter()
                    .map(|angle| {
                        let (photons, series) = of(angle);
                        format!("{angle}: {photons:.4} {series:.4}")
                    })
                    .collect();
                println!("g {asymmetry} T {depth}: {}", row.join(", "));
                let fall = |of: &dyn Fn(f64) -> f64| of(0.1) / of(1.0);
                let (photons, theirs) = (fall(&|a| of(a).0), fall(&|a| of(a).1));
                widest = widest.max(photons / theirs);
            }
        }
        println!("{widest}");
        assert!(widest > 2.0, "{widest}");
    }
}
