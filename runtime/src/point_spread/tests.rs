use super::*;
use crate::airlight::Airlight;
use crate::medium::PhaseTable;
use crate::random::Random;
use std::f64::consts::PI;
use std::sync::Arc;

fn drops() -> Phase {
    Phase::Table(Arc::new(PhaseTable::drops()))
}

/// Where a light stands at optical depth `depth` in a medium of extinction 1, beside a ray without end.
fn beside(depth: f64, half_sine: f64) -> PointBeside {
    let cos = 1.0 - 2.0 * half_sine * half_sine;
    let across = 2.0 * half_sine * (1.0 - half_sine * half_sine).sqrt();
    PointBeside { h: depth * across.max(1e-6), foot: depth * cos, end: f64::INFINITY }
}

#[test]
fn what_is_looked_up_is_the_integral_along_the_ray() {
    /// Logarithms between nodes a third of a depth and a ninth of an angle apart.
    const OF_RAY: f64 = 0.015;
    let mut random = Random::new(9);
    for phase in
        [Phase::HenyeyGreenstein(0.0), Phase::HenyeyGreenstein(0.77), Phase::HenyeyGreenstein(0.9), drops()]
    {
        let spread = PointSpread::new(&phase);
        let mut worst = 0.0f64;
        for i in 0..200 {
            let extinction = 1e-4 * libm::pow(1e3, random.unit());
            let distance = libm::pow(1e3, random.unit()).min(10.0 / extinction).max(0.01 / extinction);
            let angle = 0.003 * libm::pow(600.0, random.unit());
            let (sin, cos) = libm::sincos(angle);
            let (h, foot) = (distance * sin, distance * cos);
            // Not cut, cut behind the light, before it, and next to the eye.
            let end = [f64::INFINITY, 1.5 * distance, 0.6 * distance, 0.02 / extinction][i % 4];
            let cut = PointBeside { h, foot, end };
            let [found, wanted] = [spread.of_point(extinction, &cut), spread.solve_point(extinction, &cut)];
            let whole = spread.solve_point(extinction, &PointBeside { end: f64::INFINITY, ..cut });
            for band in 0..3 {
                let off = (found[band] - wanted[band]).abs() / whole[band];
                worst = worst.max(off);
                assert!(off < OF_RAY, "{phase:?} {extinction} {cut:?}: {found:?} {wanted:?} of {whole:?}");
            }
        }
        println!("worst {worst:.1e}");
    }
}

#[test]
fn light_of_all_orders_carries_what_no_longer_goes_straight() {
    /// Of the flux: light near the source is known to a per cent or two; far from it a flux is a small difference of light from all sides.
    const NEAR: f64 = 0.01;
    const FAR: f64 = 0.06;
    let asymmetries = [0.0, 0.4, 0.77, 0.86, 0.884, 0.95].map(Phase::HenyeyGreenstein);
    for phase in asymmetries.into_iter().chain([drops()]) {
        let (airlight, spread) = (Airlight::new(&phase), PointSpread::new(&phase));
        for depth in [0.02, 0.1, 0.5, 1.0, 2.0, 4.0, 8.0] {
            // ∫ L cos α dω over the sphere, times its area over 4π: of 1 W/sr, 1 − e^−T is scattered on the way and passes it so.
            let steps = 3000;
            let flux = |i: i32| {
                let (sin, cos) = libm::sincos(PI * (f64::from(i) + 0.5) / f64::from(steps));
                let half = ((1.0 - cos) / 2.0).sqrt();
                let light =
                    airlight.of_point(1.0, &beside(depth, half))[1] + spread.lookup_seen(depth, half)[1];
                light * cos * sin
            };
            let passed = (0..steps).map(flux).sum::<f64>() * 2.0 * PI * PI / f64::from(steps) * depth * depth;
            let wanted = -libm::expm1(-depth);
            let allowed = if depth <= 1.0 { NEAR } else { FAR };
            println!("χ₁ {:.3} T {depth}: {:+.4}", phase.moments(1)[1], passed / wanted - 1.0);
            assert!((passed / wanted - 1.0).abs() < allowed, "{depth}: {passed} {wanted}");
        }
    }
}

#[test]
fn thin_rain_scatters_once_and_fog_over_and_over() {
    for phase in [Phase::HenyeyGreenstein(0.77), drops()] {
        let (airlight, spread) = (Airlight::new(&phase), PointSpread::new(&phase));
        let share = |depth: f64| {
            let beside = beside(depth, 0.05);
            spread.lookup_seen(depth, 0.05)[1] / airlight.of_point(1.0, &beside)[1]
        };
        let shares = [0.01, 0.1, 1.0, 3.0].map(share);
        println!("{shares:?}");
        assert!(shares.windows(2).all(|pair| pair[1] > 2.0 * pair[0]), "{shares:?}");
        assert!(shares[0] < 0.01 && shares[3] > 1.0, "{shares:?}");
    }
}

#[test]
fn what_no_light_can_come_from_is_dark_rather_than_no_number() {
    let spread = PointSpread::new(&Phase::HenyeyGreenstein(0.77));
    let lamp = PointBeside { h: 3.0, foot: 20.0, end: 60.0 };
    let dark = |spread: &PointSpread, extinction: f64, lamp: PointBeside| {
        assert_eq!(spread.of_point(extinction, &lamp), [0.0; 3], "{extinction} {lamp:?}");
    };
    dark(&spread, 0.0, lamp);
    dark(&spread, f64::NAN, lamp);
    dark(&spread, 1e-2, PointBeside { end: 0.0, ..lamp });
    dark(&spread, 1e-2, PointBeside { foot: -1e9, ..lamp });
    dark(&spread, 1e-2, PointBeside { h: 1e9, ..lamp });
    dark(&PointSpread::new(&Phase::Paper(0.9)), 1e-2, lamp);
    for foot in [-20.0, 0.0, 1e-9, 1e3] {
        for end in [1e-3, 5.0, f64::INFINITY] {
            let found = spread.of_point(1e-2, &PointBeside { h: 1e-9, foot, end });
            assert!(found.iter().all(|light| light.is_finite() && *light >= 0.0), "{foot} {end}: {found:?}");
        }
    }
}

#[test]
fn asymmetries_beyond_the_table_are_those_at_its_ends_and_its_own_are_exact() {
    let at = |g: f64| PointSpread::new(&Phase::HenyeyGreenstein(g)).source;
    assert_eq!(at(-0.9), at(ASYMMETRIES[0]));
    assert_eq!(at(0.999), at(0.95));
    for (index, &g) in ASYMMETRIES.iter().enumerate() {
        for (i, value) in at(g).iter().enumerate().step_by(97) {
            assert!((value[0] - logarithm(stored(index * RADII * ANGLES + i))).abs() < 1e-5, "{g} {i}");
        }
    }
}
