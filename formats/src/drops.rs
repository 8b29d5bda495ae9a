//! Raindrops: how many there are of each size, how fast they fall, how much light they take away.
//!
//! Bake and runtime both start from these formulas, so they stand where meaning is agreed. The corrected
//! forms are here; the forms that the paper prints are in [`paper`], by the same names; how drops of one
//! size fill a camera's picture is in [`shell`].
//!
//! | symbol | name               | unit        |
//! | D      | `diameter`         | mm          |
//! | R      | `rate`             | mm/h        |
//! | N(D,R) | [`number_density`] | 1/(m³ mm)   |
//! | Λ      | [`slope`]          | 1/mm        |
//! | v      | [`fall_speed`]     | m/s         |
//! | T      | `exposure`         | s           |
//! | L      | [`streak_length`]  | m           |
//! | Q      | `efficiency`       | –           |

pub mod paper;
pub mod shell;

use crate::units::{Metres, MetresPerSecond, Millimetres, MillimetresPerHour, PerKilometre, Seconds};
use std::f64::consts::PI;

pub use shell::View;

/// N0 of Marshall and Palmer: drops per m³ and mm of diameter, continued to D = 0. \[marshall-palmer\]
pub const INTERCEPT: f64 = 8000.0;
/// Λ at R = 1 mm/h, 1/mm.
const SLOPE_AT_ONE: f64 = 4.1;
/// Λ falls with R to this power.
pub const SLOPE_POWER: f64 = -0.21;
/// Below this diameter Atlas' fit, which turns negative under 0.109 mm, gives way to Best's, mm.
pub const BEST_BELOW: Millimetres = Millimetres(0.5);

/// Diameters that the default classes span: Bentley's 1/50 to 1/3 inch. \[bentley-1904\]
pub const DEFAULT_DIAMETERS: [Millimetres; 2] = [Millimetres(25.4 / 50.0), Millimetres(25.4 / 3.0)];

/// Λ(R) = 4.1 R^−0.21, 1/mm. Falls from +∞ at R = 0; a negative R counts as 0. \[marshall-palmer\], \[weber\] eq. 8.
pub fn slope(rate: MillimetresPerHour) -> f64 {
    if rate.0 > 0.0 { SLOPE_AT_ONE * libm::pow(rate.0, SLOPE_POWER) } else { f64::INFINITY }
}

/// The rate whose slope is `slope` (> 0, 1/mm); the inverse of [`slope`], to a few units in the last place.
pub fn rate_of_slope(slope: f64) -> MillimetresPerHour {
    MillimetresPerHour(libm::pow(slope / SLOPE_AT_ONE, 1.0 / SLOPE_POWER))
}

/// N(D, R) = N0 e^{−ΛD}, drops per m³ and mm of diameter; 0 at R = 0. \[marshall-palmer\], \[weber\] eq. 6.
pub fn number_density(diameter: Millimetres, rate: MillimetresPerHour) -> f64 {
    if rate.0 > 0.0 { density_at(diameter.0, slope(rate)) } else { 0.0 }
}

/// [`number_density`] for a slope already in hand: N0 e^{−ΛD}, for inner loops. `slope` finite, `diameter` mm.
#[inline]
pub fn density_at(diameter: f64, slope: f64) -> f64 {
    INTERCEPT * libm::exp(-slope * diameter)
}

/// Drops per m³ with a diameter in [from, to): N0/Λ (e^{−Λ from} − e^{−Λ to}), the exact integral of
/// [`number_density`]. Good to round-off for narrow classes too; 0 for an empty one and at R = 0.
pub fn drops_per_volume(from: Millimetres, to: Millimetres, rate: MillimetresPerHour) -> f64 {
    let slope = slope(rate);
    if !slope.is_finite() || to.0 <= from.0 {
        return 0.0;
    }
    -INTERCEPT / slope * libm::exp(-slope * from.0) * libm::expm1(-slope * (to.0 - from.0))
}

/// Atlas, Srivastava and Sekhon's fit to Gunn and Kinzer's speeds: 9.65 − 10.3 e^{−0.6 D}. \[atlas-1973\]
/// Within 2 % for 0.6 ≤ D ≤ 5.8 mm; negative below 0.109 mm.
pub fn atlas_speed(diameter: Millimetres) -> MetresPerSecond {
    MetresPerSecond(9.65 - 10.3 * libm::exp(-0.6 * diameter.0))
}

/// Best's fit: 9.58 (1 − e^{−(D/1.77)^1.147}); 0 at D = 0 and positive above. \[best-1950\]
pub fn best_speed(diameter: Millimetres) -> MetresPerSecond {
    MetresPerSecond(-9.58 * libm::expm1(-libm::pow(diameter.0.max(0.0) / 1.77, 1.147)))
}

/// Terminal fall speed in still air at sea level: Atlas from 0.5 mm up, Best below.
/// The two differ by 0.8 % where they meet.
pub fn fall_speed(diameter: Millimetres) -> MetresPerSecond {
    if diameter < BEST_BELOW { best_speed(diameter) } else { atlas_speed(diameter) }
}

/// Length that a drop sweeps while the shutter is open: D + vT. \[weber\] eq. 3.
pub fn streak_length(diameter: Millimetres, speed: MetresPerSecond, exposure: Seconds) -> Metres {
    Metres(diameter.0 / 1000.0 + speed.0 * exposure.0)
}

/// How a cloud of drops takes light out of a beam and where it sends it: efficiency Q and the asymmetry g
/// that belongs to it. The two come in pairs only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Extinction cross-section over the drop's disc, –.
    pub efficiency: f64,
    /// Mean cosine of scattering, –.
    pub asymmetry: f64,
}

impl Optics {
    /// All scattering, diffraction included: what a distant, narrow beam loses.
    pub const WHOLE: Self = Self { efficiency: 2.0, asymmetry: 0.884 };
    /// Reflection and refraction alone. Diffraction around a drop of a millimetre stays within 0.04° of the
    /// beam and so inside its pixel; this is also what drawn streaks cover.
    pub const GEOMETRIC: Self = Self { efficiency: 1.0, asymmetry: 0.77 };
}

/// Extinction of drops of all sizes, ∫₀^∞ Q π/4 D² N(D, R) dD = Q π N0 / (2 Λ³): 0.365 R^0.63 per km at Q = 2.
pub fn extinction(rate: MillimetresPerHour, efficiency: f64) -> PerKilometre {
    let slope = slope(rate);
    // mm² per m³ is 1e-6 per metre is 1e-3 per kilometre; at R = 0 the slope is infinite and the result 0.
    PerKilometre(efficiency * PI * INTERCEPT / (2.0 * slope * slope * slope) * 1e-3)
}

/// `count` contiguous classes between two diameters, equal in the logarithm; the outer edges are exact.
pub fn log_classes(from: Millimetres, to: Millimetres, count: usize) -> Vec<[Millimetres; 2]> {
    let ratio = libm::log(to.0 / from.0);
    let edge = |i: usize| match i {
        0 => from,
        i if i == count => to,
        i => Millimetres(from.0 * libm::exp(ratio * i as f64 / count as f64)),
    };
    (0..count).map(|i| [edge(i), edge(i + 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIGHT: MillimetresPerHour = MillimetresPerHour(2.0);
    const RATES: [f64; 4] = [2.0, 5.0, 25.0, 75.0];

    /// Composite Simpson over 20 000 intervals leaves less than 1e-9 of these smooth integrands.
    const QUADRATURE: f64 = 1e-8;

    fn integrate(from: f64, to: f64, f: impl Fn(f64) -> f64) -> f64 {
        let count = 20_000;
        let step = (to - from) / f64::from(count);
        let weight = |i| match i {
            0 => 1.0,
            i if i == count => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        (0..=count).map(|i| weight(i) * f(from + step * f64::from(i))).sum::<f64>() * step / 3.0
    }

    fn assert_close(found: f64, wanted: f64, relative: f64) {
        let scale = found.abs().max(wanted.abs());
        assert!((found - wanted).abs() <= relative * scale, "found {found}, wanted {wanted} ± {relative}");
    }

    #[test]
    fn class_integrals_are_exact_and_add_up() {
        let [from, to] = DEFAULT_DIAMETERS;
        for rate in RATES.map(MillimetresPerHour) {
            let exact = integrate(from.0, to.0, |d| number_density(Millimetres(d), rate));
            assert_close(drops_per_volume(from, to, rate), exact, QUADRATURE);
            let classes = log_classes(from, to, 16);
            let sum: f64 = classes.iter().map(|[a, b]| drops_per_volume(*a, *b, rate)).sum();
            assert_close(sum, drops_per_volume(from, to, rate), 1e-14);
        }
    }

    #[test]
    fn light_rain_has_2257_drops_a_cubic_metre_and_1884_of_them_under_half_a_millimetre() {
        let all = drops_per_volume(Millimetres(0.0), Millimetres(1e3), LIGHT);
        let small = drops_per_volume(Millimetres(0.0), DEFAULT_DIAMETERS[0], LIGHT);
        assert_eq!((all.round(), small.round()), (2257.0, 1884.0));
    }

    #[test]
    fn no_rain_has_no_drops_and_takes_no_light() {
        for rate in [MillimetresPerHour(0.0), MillimetresPerHour(-1.0)] {
            assert_eq!(drops_per_volume(Millimetres(0.0), Millimetres(9.0), rate), 0.0);
            assert_eq!(number_density(Millimetres(0.0), rate), 0.0);
            assert_eq!(extinction(rate, 2.0).0, 0.0);
        }
    }

    #[test]
    fn slope_and_rate_are_inverses() {
        for rate in [1e-3, 0.1, 2.0, 200.0] {
            assert_close(rate_of_slope(slope(MillimetresPerHour(rate))).0, rate, 1e-13);
        }
    }

    #[test]
    fn fall_speeds_are_those_of_gunn_and_kinzer() {
        // [gunn-kinzer] table 2; 2.5 % is the fits' own error at these diameters.
        for (diameter, speed) in [(0.5, 2.06), (1.0, 4.03), (2.0, 6.49), (3.0, 8.06), (5.8, 9.17)] {
            assert_close(fall_speed(Millimetres(diameter)).0, speed, 0.025);
            assert_close(best_speed(Millimetres(diameter)).0, speed, 0.04);
        }
        assert!(atlas_speed(Millimetres(0.108)).0 < 0.0 && best_speed(Millimetres(0.01)).0 > 0.0);
        let [below, above] = [0.499_999, 0.5].map(|d| fall_speed(Millimetres(d)).0);
        assert!((above / below - 1.0).abs() < 0.009);
    }

    #[test]
    fn extinction_is_the_integral_over_all_sizes() {
        for (rate, printed) in RATES.into_iter().zip([0.564, 1.005, 2.771, 5.536]) {
            let rate = MillimetresPerHour(rate);
            let disc = |d: f64| PI / 4.0 * d * d * number_density(Millimetres(d), rate) * 1e-3;
            assert_close(extinction(rate, 2.0).0, 2.0 * integrate(0.0, 60.0, disc), QUADRATURE);
            // Three printed decimals.
            assert!((extinction(rate, 2.0).0 - printed).abs() < 5e-4);
            assert_close(extinction(rate, 1.0).0, 0.1823 * libm::pow(rate.0, 0.63), 2e-4);
        }
        let share =
            integrate(DEFAULT_DIAMETERS[0].0, 60.0, |d| d * d * number_density(Millimetres(d), LIGHT));
        let all = integrate(0.0, 60.0, |d| d * d * number_density(Millimetres(d), LIGHT));
        assert_eq!((100.0 * share / all).round(), 73.0);
    }

    #[test]
    fn the_rain_that_falls_is_not_quite_the_rate_that_named_it() {
        // The distribution and the fall speeds come from different measurements; nothing ties them.
        for (rate, flux) in [(2.0, 2.37), (25.0, 28.2), (75.0, 80.2)] {
            let rate = MillimetresPerHour(rate);
            // mm³ per m² and second, to mm per hour.
            let fall = |d: f64| {
                let d = Millimetres(d);
                number_density(d, rate) * PI / 6.0 * d.0 * d.0 * d.0 * atlas_speed(d).0 * 3600.0 * 1e-6
            };
            let found = integrate(0.109, 40.0, fall);
            // Three printed digits.
            assert_close(found, flux, 2e-3);
        }
    }
}
