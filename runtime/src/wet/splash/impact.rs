//! What becomes of a drop that strikes a wet surface.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | We | ρ v² D/σ | – |
//! | Oh | η/√(ρ σ D) | – |
//! | K | We Oh^−0.4 | – |
//! | δ | film's depth over D | – |

use crate::wet::ripples::DropFlux;

/// Water at 10 °C: density kg/m³, surface tension N/m, viscosity Pa s.
const DENSITY: f64 = 1000.0;
const SURFACE_TENSION: f64 = 0.0742;
const VISCOSITY: f64 = 1.307e-3;
/// Gravity, m/s².
pub(crate) const GRAVITY: f64 = 9.80665;
/// Duration of a splash, crown and jet, over √(R/g).
const LIFE: f64 = 5.0;
/// The largest share of a drop's own water that is thrown out.
const THROWN_MOST: f64 = 1.0;

/// Droplets that one drop throws out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Thrown {
    /// How many; 0 where the drop spreads without a splash.
    pub count: f64,
    /// Their diameter, all alike, m.
    pub diameter_m: f64,
}

/// K = We Oh^−0.4, which orders drops by how they splash; 0 for one that has no size or speed.
pub fn splash_number(drop: &DropFlux) -> f64 {
    let (diameter, speed) = (drop.diameter_m, drop.speed_m_per_s);
    if !(diameter > 0.0 && speed > 0.0) {
        return 0.0;
    }
    let weber = DENSITY * speed * speed * diameter / SURFACE_TENSION;
    let ohnesorge = VISCOSITY / libm::sqrt(DENSITY * SURFACE_TENSION * diameter);
    weber * libm::pow(ohnesorge, -0.4)
}

/// Whether a drop splashes on a film of a depth: K > 2100 + 5880 δ^1.44 (\[cossali\]). Drops of 1 mm hardly do, those of 2 mm do.
pub fn splashes(drop: &DropFlux, film_m: f64) -> bool {
    let depth = film_m.max(0.0) / drop.diameter_m.max(1e-9);
    splash_number(drop) > 2100.0 + 5880.0 * libm::pow(depth, 1.44)
}

/// Droplets that a splash throws out: 7.84·10⁻⁶ K^1.8 δ^−0.3 of them, with a share .00156 e^{.000486 K} of the drop's water (\[okawa\]), at most all
/// of it. Films thinner than a tenth of the drop count as that.
pub fn thrown(drop: &DropFlux, film_m: f64) -> Thrown {
    if !splashes(drop, film_m) {
        return Thrown::default();
    }
    let number = splash_number(drop);
    let depth = (film_m / drop.diameter_m).max(0.1);
    let count = (7.84e-6 * libm::pow(number, 1.8) * libm::pow(depth, -0.3)).max(1.0);
    let share = (0.00156 * libm::exp(0.000486 * number)).min(THROWN_MOST);
    Thrown { count, diameter_m: drop.diameter_m * libm::cbrt(share / count) }
}

/// Duration of a splash: the crater opens and closes in a few √(R/g), s.
pub fn life_s(drop: &DropFlux) -> f64 {
    LIFE * libm::sqrt(drop.crater_radius_m() / GRAVITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drop(diameter_m: f64, speed_m_per_s: f64) -> DropFlux {
        DropFlux { diameter_m, speed_m_per_s, impacts_per_m2_s: 1.0 }
    }

    #[test]
    fn large_drops_splash_and_drizzle_does_not() {
        assert!(!splashes(&drop(0.3e-3, 1.2), 1e-4));
        assert!(splashes(&drop(2e-3, 6.6), 1e-4));
        assert!(!splashes(&drop(2e-3, 6.6), 5e-3), "deep water swallows them");
        assert_eq!(thrown(&drop(0.3e-3, 1.2), 1e-4).count, 0.0);
    }

    #[test]
    fn no_splash_throws_out_more_water_than_fell() {
        for tenths in 8..60 {
            let diameter = 1e-4 * f64::from(tenths);
            let speed = 9.65 - 10.3 * libm::exp(-600.0 * diameter);
            let out = thrown(&drop(diameter, speed), 2e-4);
            let volume = out.count * out.diameter_m * out.diameter_m * out.diameter_m;
            assert!(volume <= 1.0001 * diameter * diameter * diameter, "{diameter} {out:?}");
        }
    }

    #[test]
    fn nothing_comes_of_drops_without_size_or_speed() {
        for none in [drop(0.0, 5.0), drop(1e-3, 0.0), drop(f64::NAN, 1.0)] {
            assert_eq!(splash_number(&none), 0.0);
            assert!(!splashes(&none, 1e-4));
        }
    }
}
