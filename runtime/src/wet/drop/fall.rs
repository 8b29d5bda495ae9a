//! How a drop falls from rest: gravity against drag as the square of its speed, and wind that takes it along.

use glam::DVec3;

/// Gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// Speed at which a drop of a diameter falls at last, m/s, \[atlas-1973\]; for the smallest 2 m/s a millimetre.
pub fn last_speed(diameter_m: f64) -> f64 {
    let diameter_mm = (diameter_m * 1e3).clamp(0.01, 8.0);
    (9.65 - 10.3 * libm::exp(-0.6 * diameter_mm)).max(2.0 * diameter_mm)
}

/// Where a drop is `seconds` after it was let go at rest, from where that was, m, and its velocity, m/s. With terminal speed u it has fallen u²/g ln cosh(g t/u); wind takes
/// it along with the time u/g, by as much as it would at small differences of speed.
pub fn fallen(seconds: f64, last_speed: f64, wind: DVec3) -> (DVec3, DVec3) {
    let (u, t) = (last_speed.max(1e-3), seconds.max(0.0));
    let share = GRAVITY * t / u;
    let low = libm::exp(-share);
    // ln cosh in a form that does not overflow.
    let down = u * u / GRAVITY * (share + libm::log1p(low * low) - std::f64::consts::LN_2);
    let speed = u * (1.0 - low * low) / (1.0 + low * low);
    let side = DVec3::new(wind.x, wind.y, 0.0);
    let taken = 1.0 - low;
    (side * (t - u / GRAVITY * taken) - DVec3::Z * down, side * taken - DVec3::Z * speed)
}

/// Time in which a drop that is let go at rest falls so many metres, s: [`fallen`] the other way round, u/g arcosh e^{g h/u²}. 0 for heights of 0 and less.
pub fn fall_time_s(height_m: f64, last_speed: f64) -> f64 {
    let u = last_speed.max(1e-3);
    let share = GRAVITY * height_m.max(0.0) / (u * u);
    // arcosh eˢ in a form that does not overflow, nor loses the digits of a short fall.
    u / GRAVITY * (share + libm::log1p((-libm::expm1(-2.0 * share)).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drop_falls_freely_at_first_and_at_its_last_speed_in_the_end() {
        // Drag takes a ten-thousandth of the speed in a hundredth of a second.
        let (place, velocity) = fallen(0.01, 9.0, DVec3::ZERO);
        assert!((place.z + 0.5 * GRAVITY * 1e-4).abs() < 1e-7 && (velocity.z + GRAVITY * 0.01).abs() < 1e-5);
        let (_, velocity) = fallen(100.0, 9.0, DVec3::new(3.0, -2.0, 0.0));
        assert!((velocity - DVec3::new(3.0, -2.0, -9.0)).length() < 1e-9);
    }

    #[test]
    fn the_time_of_a_fall_is_the_falls_other_way_round() {
        for height in [1e-4, 0.02, 1.0, 30.0, 400.0] {
            let (place, _) = fallen(fall_time_s(height, 9.0), 9.0, DVec3::ZERO);
            assert!((place.z / -height - 1.0).abs() < 1e-9, "{height} {}", place.z);
        }
        assert_eq!(fall_time_s(-1.0, 9.0), 0.0);
    }

    #[test]
    fn places_are_the_integral_of_velocities_which_obey_the_law_of_drag() {
        /// Central differences over a step of 10⁻⁴ s.
        const DIFFERENCE: f64 = 1e-6;
        let (wind, u, step) = (DVec3::new(4.0, 1.0, 0.0), 7.0, 1e-4);
        for t in [0.05, 0.3, 1.0, 4.0] {
            let ([a, va], [b, vb]) = (fallen(t - step, u, wind).into(), fallen(t + step, u, wind).into());
            let (_, v) = fallen(t, u, wind);
            assert!(((b - a) / (2.0 * step) - v).length() < DIFFERENCE);
            let acceleration = (vb - va) / (2.0 * step);
            assert!((acceleration.z + GRAVITY * (1.0 - v.z * v.z / (u * u))).abs() < DIFFERENCE * 10.0);
            assert!((acceleration.x - (wind.x - v.x) * GRAVITY / u).abs() < DIFFERENCE * 10.0);
        }
    }
}
