use super::*;
use std::f64::consts::TAU;

/// Single precision over a few hundred steps.
const ROUND_OFF: f64 = 2e-4;

fn undamped(scheme: Scheme) -> RippleSettings {
    RippleSettings {
        cells: [32, 24],
        spacing_m: 0.01,
        damping_per_s: 0.0,
        scheme,
        ..RippleSettings::default()
    }
}

/// A standing wave of `waves` wavelengths over the lattice, at its crest half a step ago and half a step ahead.
fn standing(settings: RippleSettings, waves: [f64; 2]) -> Ripples {
    let mut water = Ripples::new(settings).unwrap();
    let [width, height] = settings.cells;
    for y in 0..height {
        for x in 0..width {
            let phase =
                |cell: usize, cells: usize, waves: f64| libm::cos(TAU * waves * cell as f64 / cells as f64);
            let place = water.index(x, y);
            water.now[place] = (1e-3 * phase(x, width, waves[0]) * phase(y, height, waves[1])) as f32;
        }
    }
    water.before.clone_from(&water.now);
    water
}

/// −μ of the wave under the Laplacian.
fn eigenvalue(settings: &RippleSettings, waves: [f64; 2]) -> f64 {
    let [a, b] = [0, 1].map(|axis| libm::cos(TAU * waves[axis] / settings.cells[axis] as f64));
    match settings.scheme {
        Scheme::Nine => (20.0 - 8.0 * a - 8.0 * b - 4.0 * a * b) / 6.0,
        _ => 4.0 - 2.0 * a - 2.0 * b,
    }
}

#[test]
fn a_standing_wave_swings_as_the_schemes_closed_form() {
    for scheme in [Scheme::Nine, Scheme::Five] {
        for waves in [[1.0, 0.0], [3.0, 2.0], [16.0, 12.0]] {
            let settings = undamped(scheme);
            let mut water = standing(settings, waves);
            let step = 0.9 * water.longest_step_s();
            water.step_s = step;
            let courant = f64::from(settings.speed_m_per_s) * step / f64::from(settings.spacing_m);
            let half = 0.5 * libm::acos(1.0 - 0.5 * courant * courant * eigenvalue(&settings, waves));
            let first = f64::from(water.height(0, 0));
            for n in 1..200 {
                water.step(step);
                let expected = first * libm::cos((2.0 * f64::from(n) + 1.0) * half) / libm::cos(half);
                let error = (f64::from(water.height(0, 0)) - expected).abs();
                assert!(
                    error < ROUND_OFF * 50.0 * first,
                    "{scheme:?} {waves:?} step {n}: {error} of {first}"
                );
            }
        }
    }
}

#[test]
fn long_waves_travel_at_the_speed_that_was_asked_for() {
    /// (kΔx)²/24 of the Laplacian and the step's own: 32 cells a wave.
    const DISPERSION: f64 = 2e-3;
    let settings = undamped(Scheme::Nine);
    let mut water = standing(settings, [1.0, 0.0]);
    let period = 32.0 * 0.01 / f64::from(settings.speed_m_per_s);
    let first = water.height(0, 0);
    water.advance(period, &[], 0).unwrap();
    assert!((f64::from(water.height(0, 0) / first) - 1.0).abs() < 20.0 * DISPERSION);
    water.advance(period * 0.25, &[], 0).unwrap();
    assert!(f64::from(water.height(0, 0) / first).abs() < 20.0 * DISPERSION * TAU);
}

#[test]
fn heights_fall_as_half_the_damping() {
    /// The swing's phase moves by (λ/4ω)² and a step by round-off.
    const PHASE: f64 = 0.02;
    let mut settings = undamped(Scheme::Nine);
    settings.damping_per_s = 1.0;
    let mut water = standing(settings, [2.0, 2.0]);
    let before = water.mean_square_m2();
    let [kx, ky] = [0, 1].map(|axis| TAU * 2.0 / (settings.cells[axis] as f64 * 0.01));
    let period = TAU / (0.25 * libm::sqrt(kx * kx + ky * ky));
    water.advance(4.0 * period, &[], 0).unwrap();
    let share = water.mean_square_m2() / before / libm::exp(-4.0 * period);
    assert!((share - 1.0).abs() < 10.0 * PHASE, "{share}");
}

#[test]
fn a_step_within_the_bound_stays_and_one_beyond_it_grows() {
    for (scheme, damping) in
        [(Scheme::Nine, 0.0), (Scheme::Nine, 20.0), (Scheme::Five, 0.0), (Scheme::Five, 20.0)]
    {
        let settings = RippleSettings { damping_per_s: damping, ..undamped(scheme) };
        for (share, bounded) in [(1.0, true), (1.12, false)] {
            let mut water = standing(settings, [16.0, 12.0]);
            if scheme == Scheme::Nine {
                water.now.fill(0.0);
            }
            water.strike(&Impact { at_m: [0.1, 0.1], radius_m: 0.02, depth_m: 1e-3 });
            let step = water.longest_step_s() * share;
            water.step_s = step;
            (0..600).for_each(|_| water.step(step));
            let grown = water.mean_square_m2().is_nan() || water.mean_square_m2() > 1e-2;
            assert_eq!(grown, !bounded, "{scheme:?} damping {damping} {share}: {}", water.mean_square_m2());
        }
    }
}

#[test]
fn the_papers_forward_euler_grows_where_nothing_damps_it() {
    let mut water = Ripples::new(undamped(Scheme::Paper)).unwrap();
    water.strike(&Impact { at_m: [0.1, 0.1], radius_m: 0.02, depth_m: 1e-3 });
    let before = water.mean_square_m2();
    water.advance(1.0, &[], 0).unwrap();
    assert!(water.mean_square_m2().is_nan() || water.mean_square_m2() > 1e6 * before);
}

#[test]
fn the_papers_forward_euler_settles_where_damping_is_eight_courant_squares() {
    let settings = RippleSettings { damping_per_s: 400.0, ..undamped(Scheme::Paper) };
    let mut water = Ripples::new(settings).unwrap();
    let crossing = f64::from(settings.spacing_m / settings.speed_m_per_s);
    let step = 0.15 * crossing;
    assert!(step::damping(&settings, step) > 8.0 * 0.15 * 0.15);
    water.step_s = step;
    water.strike(&Impact { at_m: [0.1, 0.1], radius_m: 0.02, depth_m: 1e-3 });
    let before = water.mean_square_m2();
    (0..400).for_each(|_| water.step(step));
    assert!(water.mean_square_m2() < before);
}

#[test]
fn rings_of_nine_points_are_rounder_than_those_of_five() {
    let spread = |scheme| {
        let settings = RippleSettings {
            cells: [128, 128],
            spacing_m: 0.01,
            damping_per_s: 0.0,
            scheme,
            ..RippleSettings::default()
        };
        let mut water = Ripples::new(settings).unwrap();
        water.strike(&Impact { at_m: [0.645, 0.645], radius_m: 0.02, depth_m: 1e-3 });
        water.advance(1.6, &[], 0).unwrap();
        // The same distance along an axis and along a diagonal: 35.36 of 25 × 25 lies between cells 35 and 36.
        let along = (0..40).map(|d| water.height(64 + d, 64)).collect::<Vec<_>>();
        (10..28)
            .map(|d| {
                let distance = d as f32 * std::f32::consts::SQRT_2;
                let (low, part) = (distance as usize, distance.fract());
                let axis = along[low] + part * (along[low + 1] - along[low]);
                f64::from((axis - water.height(64 + d, 64 + d)).abs())
            })
            .sum::<f64>()
    };
    assert!(
        spread(Scheme::Nine) < 0.7 * spread(Scheme::Five),
        "{} {}",
        spread(Scheme::Nine),
        spread(Scheme::Five)
    );
}

#[test]
fn drops_and_bodies_bring_no_water() {
    for edges in [Edges::Repeat, Edges::Reflect] {
        let mut water =
            Ripples::new(RippleSettings { edges, cells: [64, 64], ..RippleSettings::default() }).unwrap();
        let rain = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 2000.0 }];
        water.advance(0.5, &rain, 3).unwrap();
        water.push([0.0, 0.2], [0.05, 0.2], 0.05, 0.01);
        water.push([0.05, 0.2], [0.1, 0.2], 0.05, 0.01);
        water.advance(0.5, &[], 3).unwrap();
        let moved = libm::sqrt(water.mean_square_m2()) * stretch::area_m2(water.settings());
        assert!(moved > 0.0);
        assert!(water.volume_m3().abs() < ROUND_OFF * moved, "{} of {moved}", water.volume_m3());
    }
}

#[test]
fn a_body_at_a_wall_moves_no_more_water_than_its_draught() {
    let mut water =
        Ripples::new(RippleSettings { edges: Edges::Reflect, cells: [64, 64], ..RippleSettings::default() })
            .unwrap();
    // It leaves a place of which the lattice holds the outermost rim alone.
    water.push([-0.049, 0.2], [0.1, 0.2], 0.05, 0.01);
    let highest = water.now.iter().fold(0.0f32, |most, height| most.max(height.abs()));
    assert!(highest <= 0.01, "{highest}");
}

#[test]
fn times_too_short_for_a_step_wait_for_more_and_lose_no_motion() {
    let run = |crumb: f64| {
        let mut water = standing(undamped(Scheme::Nine), [2.0, 1.0]);
        for _ in 0..40 {
            water.advance(0.01, &[], 0).unwrap();
            water.advance(crumb, &[], 0).unwrap();
        }
        water
    };
    let (none, crumbs) = (run(0.0), run(1e-17));
    assert_eq!(fingerprint(&none), fingerprint(&crumbs));
    assert!(none.mean_square_m2() > 0.0 && run(1e-9).mean_square_m2().is_finite());
}

#[test]
fn as_many_drops_strike_as_the_flux_says() {
    let mut water = Ripples::new(RippleSettings { cells: [16, 16], ..RippleSettings::default() }).unwrap();
    let rain = [
        DropFlux { diameter_m: 1e-3, speed_m_per_s: 4.0, impacts_per_m2_s: 30_000.0 },
        DropFlux { diameter_m: 3e-3, speed_m_per_s: 8.0, impacts_per_m2_s: 10_000.0 },
    ];
    let expected = 40_000.0 * stretch::area_m2(water.settings()) * 10.0;
    let count = f64::from(water.advance(10.0, &rain, 11).unwrap().impacts);
    // Four standard deviations of a Poisson number.
    assert!((count - expected).abs() < 4.0 * libm::sqrt(expected), "{count} for {expected}");
}

#[test]
fn other_frame_rates_meet_the_same_drops() {
    let rain = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 3000.0 }];
    let count = |frames: u32| {
        let mut water = Ripples::new(RippleSettings::default()).unwrap();
        (0..frames).map(|_| water.advance(2.0 / f64::from(frames), &rain, 5).unwrap().impacts).sum::<u32>()
    };
    let whole = count(1);
    assert!(whole > 100);
    // The last frame's end is round-off away from the whole's: a drop within it may fall to either side.
    assert!(whole.abs_diff(count(60)) <= 1 && whole.abs_diff(count(7)) <= 1);
}

#[test]
fn the_same_calls_give_the_same_bits() {
    let run = |seed| {
        let mut water = Ripples::new(RippleSettings::default()).unwrap();
        let rain = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 500.0 }];
        for _ in 0..5 {
            water.advance(0.1, &rain, seed).unwrap();
        }
        fingerprint(&water)
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn a_tile_moved_by_whole_cells_ripples_alike() {
    let run = |shift: [f32; 2]| {
        let mut water =
            Ripples::new(RippleSettings { cells: [40, 40], spacing_m: 0.01, ..RippleSettings::default() })
                .unwrap();
        let at_m = [0.105 + shift[0] * 0.01, 0.105 + shift[1] * 0.01];
        water.strike(&Impact { at_m, radius_m: 0.021, depth_m: 1e-3 });
        water.advance(1.0, &[], 0).unwrap();
        water
    };
    let (here, there) = (run([0.0, 0.0]), run([33.0, 21.0]));
    for y in 0..40 {
        for x in 0..40 {
            let moved = there.height((x + 33) % 40, (y + 21) % 40);
            assert!((here.height(x, y) - moved).abs() < 1e-3 * 2e-4, "{x} {y}");
        }
    }
}

#[test]
fn slopes_are_those_of_a_plane_and_of_the_cells_around() {
    let settings = RippleSettings {
        cells: [12, 10],
        spacing_m: 0.5,
        edges: Edges::Reflect,
        ..RippleSettings::default()
    };
    let mut water = Ripples::new(settings).unwrap();
    for y in 0..10 {
        for x in 0..12 {
            let place = water.index(x, y);
            water.now[place] = 0.3 * x as f32 - 0.1 * y as f32;
        }
    }
    let mut slopes = vec![[0.0; 2]; 120];
    water.slopes(&mut slopes);
    for (slope, place) in [(slopes[5 * 12 + 6], [3.25, 2.75]), (slopes[2 * 12 + 3], [1.75, 1.25])] {
        let between = water.slope_at(place);
        for (k, wanted) in [0.6, -0.2].iter().enumerate() {
            assert!(
                (slope[k] - wanted).abs() < 1e-5 && (between[k] - wanted).abs() < 1e-5,
                "{slope:?} {between:?}"
            );
        }
    }
    assert!(water.slope_at([1e30, -1e30]).iter().all(|slope| slope.is_finite()));
}

#[test]
fn a_time_step_of_a_day_and_other_nonsense_are_refused_in_words() {
    let mut water = Ripples::new(RippleSettings::default()).unwrap();
    for seconds in [86_400.0, -1.0, f64::NAN, f64::INFINITY] {
        let refusal = water.advance(seconds, &[], 0).unwrap_err().to_string();
        assert!(refusal.starts_with("seconds: wanted 0 to"), "{refusal}");
    }
    let rain = [DropFlux { diameter_m: 2e-3, speed_m_per_s: 6.5, impacts_per_m2_s: 1e9 }];
    assert!(water.advance(1.0, &rain, 0).unwrap_err().to_string().starts_with("impacts_per_m2_s"));
    for settings in [
        RippleSettings { cells: [2, 8], ..RippleSettings::default() },
        RippleSettings { spacing_m: 0.0, ..RippleSettings::default() },
        RippleSettings { speed_m_per_s: f32::NAN, ..RippleSettings::default() },
        RippleSettings { damping_per_s: -1.0, ..RippleSettings::default() },
    ] {
        assert!(Ripples::new(settings).is_err());
    }
    water.strike(&Impact { at_m: [f32::NAN, 0.0], radius_m: f32::INFINITY, depth_m: 1.0 });
    water.push([0.0, 0.0], [f32::NAN, 0.0], 0.1, 0.1);
    assert_eq!(water.mean_square_m2(), 0.0);
}
