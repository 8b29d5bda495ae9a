use super::*;
use glam::Vec3;

fn smooth(cells: [usize; 2]) -> GlassSettings {
    GlassSettings { cells, roughness: 0.0, ..GlassSettings::default() }
}

fn conserved(pane: &Glass) {
    assert_eq!(pane.water_ng() + pane.drained_ng(), pane.received_ng());
}

#[test]
fn no_nanogram_is_lost_over_ten_thousand_steps_of_rain_and_wipers() {
    let mut pane = Glass::new(GlassSettings { cells: [96, 64], ..GlassSettings::default() }).unwrap();
    let wiper = Wiper { pivot_m: [0.05, 0.08], inner_m: 0.01, outer_m: 0.07, leaves: 0.02 };
    let (mut steps, mut call) = (0, 0);
    while steps < 10_000 {
        pane.rain(2.5e-3, 3000.0, 0.05).unwrap();
        steps += pane.advance(0.05).unwrap().steps;
        call += 1;
        if call % 5 == 0 {
            pane.wipe(&wiper, -2.8, -0.3).unwrap();
        }
        conserved(&pane);
    }
    assert!(pane.drained_ng() > pane.water_ng() && pane.water_ng() > 0);
}

#[test]
fn a_drop_runs_when_its_weight_is_more_than_what_holds_it() {
    // 3 mm of width on upright glass with hold .2: 12 (.2 σ/g)³/(πρ) = M².
    let settings = smooth([5, 20]);
    let lightest = f64::from(flow::lightest(&settings, 1.0));
    let diameter = |mass: f64| libm::cbrt(mass / NANOGRAMS_PER_M3 * 6.0 / std::f64::consts::PI);
    for (share, runs) in [(0.99, false), (1.01, true)] {
        let mut pane = Glass::new(settings).unwrap();
        pane.wet([2, 3], diameter(share * lightest)).unwrap();
        let before = pane.mass_ng(2, 3);
        pane.advance(0.05).unwrap();
        assert_eq!(pane.mass_ng(2, 3) < before, runs, "{share}");
        conserved(&pane);
    }
    let width = 2.0 * libm::cbrt(1.5 / std::f64::consts::PI * lightest / NANOGRAMS_PER_M3);
    assert!(
        (width - libm::sqrt(12.0 * 0.0728 * 0.2 / (std::f64::consts::PI * 1000.0 * 9.80665))).abs() < 1e-6,
        "{width}"
    );
}

#[test]
fn a_running_drop_comes_to_the_speed_at_which_forces_balance() {
    /// It nears its last speed by e^(−t/τ) with τ below 10 ms, and the film takes a hundredth of it.
    const NEARLY: f64 = 0.02;
    let settings = GlassSettings { wetting: 0.0, ..smooth([3, 400]) };
    let mut pane = Glass::new(settings).unwrap();
    pane.wet([1, 0], 4e-3).unwrap();
    let mass = f64::from(pane.mass_ng(1, 0));
    pane.advance(0.5).unwrap();
    let width = 2.0 * libm::cbrt(1.5 / std::f64::consts::PI * mass / NANOGRAMS_PER_M3);
    let friction = settings.edge_friction * 1e-3 * width;
    let expected = (mass * 1e-12 * 9.80665 - 0.0728 * width * settings.drag) / friction;
    let speed = (0..400)
        .flat_map(|y| (0..3).map(move |x| (x, y)))
        .map(|(x, y)| pane.speed_m_per_s(x, y))
        .fold(0.0, f32::max);
    assert!((f64::from(speed) / expected - 1.0).abs() < NEARLY, "{speed} for {expected}");
}

#[test]
fn no_step_crosses_more_than_a_cell_and_frame_rates_agree() {
    /// Roulettes differ from run to run, speeds do not: a cell of 100.
    const CELL: f64 = 0.03;
    let far = |frames: u32| {
        let mut pane = Glass::new(GlassSettings { wetting: 0.0, ..smooth([3, 600]) }).unwrap();
        pane.wet([1, 0], 4e-3).unwrap();
        for _ in 0..frames {
            pane.advance(0.4 / f64::from(frames)).unwrap();
        }
        (0..600).find(|&y| (0..3).any(|x| pane.mass_ng(x, y) > 0)).unwrap() as f64
    };
    let (few, many) = (far(4), far(400));
    assert!(few > 20.0 && (few / many - 1.0).abs() < CELL, "{few} {many}");
}

#[test]
fn drops_that_meet_are_one_with_their_momentum() {
    let mut pane = Glass::new(GlassSettings { wetting: 0.0, ..smooth([3, 6]) }).unwrap();
    /// Single precision.
    const ROUND_OFF: f64 = 1e-6;
    let momentum = |pane: &Glass| -> f64 {
        (0..6)
            .flat_map(|y| (0..3).map(move |x| (x, y)))
            .map(|(x, y)| f64::from(pane.mass_ng(x, y)) * f64::from(pane.speed_m_per_s(x, y)))
            .sum()
    };
    pane.wet([1, 2], 3e-3).unwrap();
    pane.cells.speed[2 * 3 + 1] = 0.3;
    let before = momentum(&pane);
    // Another drop falls onto the running one, then a running one flows into it.
    pane.wet([1, 2], 2e-3).unwrap();
    assert!((momentum(&pane) / before - 1.0).abs() < ROUND_OFF);
    let came = flow::Flow { to: Some(2 * 3 + 1), mass: 5_000_000, speed: 0.8, crossed: 0.1 };
    pane.arrive(came);
    assert!((momentum(&pane) / (before + 5e6 * 0.8) - 1.0).abs() < ROUND_OFF);
    assert!(pane.speed_m_per_s(1, 2) > 0.0 && pane.speed_m_per_s(1, 2) < 0.8);
}

#[test]
fn a_running_drop_leaves_a_film_that_draws_the_next_one() {
    let settings = GlassSettings { wetting: 1.0, wet_preference: 100.0, ..smooth([41, 120]) };
    let mut pane = Glass::new(settings).unwrap();
    let track = |pane: &Glass| -> Vec<usize> {
        (1..110).map(|y| (0..41).max_by_key(|&x| (pane.mass_ng(x, y), x)).unwrap()).collect()
    };
    pane.wet([20, 0], 5e-3).unwrap();
    pane.advance(3.0).unwrap();
    let first = track(&pane);
    let wet = first.iter().zip(1..).filter(|&(&x, y)| pane.mass_ng(x, y) > 0).count();
    assert!(wet > 100, "{wet} rows are wet");
    let before: Vec<u32> = first.iter().zip(1..).map(|(&x, y)| pane.mass_ng(x, y)).collect();
    pane.wet([20, 0], 5e-3).unwrap();
    pane.advance(3.0).unwrap();
    let thicker =
        first.iter().zip(1..).zip(&before).filter(|&((&x, y), &was)| pane.mass_ng(x, y) > was).count();
    // Without a film to follow, a second drop would share a tenth of the way or so.
    assert!(thicker > 60, "{thicker} rows of the first track took the second drop");
    conserved(&pane);
}

#[test]
fn obstacles_are_not_entered_and_a_shelf_holds_water() {
    let mut pane = Glass::new(smooth([9, 30])).unwrap();
    let mut obstacles = vec![false; 270];
    obstacles[10 * 9..11 * 9].fill(true);
    pane.set_obstacles(&obstacles).unwrap();
    (0..5).for_each(|_| pane.wet([4, 2], 5e-3).unwrap());
    pane.advance(5.0).unwrap();
    assert_eq!(pane.drained_ng(), 0);
    assert!((0..9).all(|x| (10..30).all(|y| pane.mass_ng(x, y) == 0)));
    assert!((0..9).any(|x| pane.mass_ng(x, 9) > 0));
    conserved(&pane);
}

#[test]
fn a_wiper_clears_its_sector_and_puts_the_water_before_it() {
    let mut pane = Glass::new(smooth([60, 60])).unwrap();
    for x in 0..60 {
        (0..60).for_each(|y| pane.wet([x, y], 0.5e-3).unwrap());
    }
    let wiper = Wiper { pivot_m: [0.03, 0.06], inner_m: 0.01, outer_m: 0.05, leaves: 0.0 };
    let moved = pane.wipe(&wiper, -2.5, -1.0).unwrap();
    assert!(moved > 0);
    conserved(&pane);
    // Straight above the pivot, 3 cm up.
    assert_eq!(pane.mass_ng(30, 30), 0);
    assert!(pane.mass_ng(2, 58) > 0);
    assert_eq!(pane.wipe(&wiper, -2.5, -1.0).unwrap(), 0);
}

#[test]
fn a_dry_pane_is_the_picture_behind_it_and_a_drop_is_not() {
    let mut pane = Glass::new(smooth([16, 12])).unwrap();
    let behind: Vec<Vec3> = (0..64 * 48).map(|k| Vec3::splat((k % 64) as f32)).collect();
    let front = vec![Vec3::splat(1000.0); 64 * 48];
    let seen = Seen { size: [64, 48], behind: &behind, front: &front, distance: 0.3 };
    let mut out = vec![Vec3::ZERO; 64 * 48];
    pane.refract(&seen, &mut out).unwrap();
    assert_eq!(out, behind);
    pane.wet([8, 6], 4e-3).unwrap();
    pane.refract(&seen, &mut out).unwrap();
    let changed = out.iter().zip(&behind).filter(|(a, b)| a != b).count();
    assert!(changed > 50 && changed < 64 * 24, "{changed}");
    // Fresnel's shares lie between: no pixel is darker than black or brighter than the brighter world.
    assert!(out.iter().all(|light| light.min_element() >= 0.0 && light.max_element() <= 1000.0));
}

#[test]
fn a_drop_shows_the_world_behind_it_upside_down() {
    let mut pane = Glass::new(smooth([16, 12])).unwrap();
    pane.wet([8, 6], 4e-3).unwrap();
    let front = vec![Vec3::ZERO; 64 * 48];
    let (across, down): (Vec<Vec3>, Vec<Vec3>) =
        (0..64 * 48).map(|k| (Vec3::splat((k % 64) as f32), Vec3::splat((k / 64) as f32))).unzip();
    let mut out = vec![Vec3::ZERO; 64 * 48];
    for (behind, step) in [(&across, 1), (&down, 64)] {
        pane.refract(&Seen { size: [64, 48], behind, front: &front, distance: 1.0 }, &mut out).unwrap();
        // The drop's middle lies at (34, 26); beside it on one side lies what is far on the other.
        let middle = 26 * 64 + 34;
        assert!(out[middle - 5 * step].x > out[middle].x && out[middle].x > out[middle + 5 * step].x);
    }
}

#[test]
fn a_drop_shows_its_own_volume() {
    /// Pixels at the rim of a half ball 12 pixels across.
    const RIM: f64 = 0.03;
    let mut pane = Glass::new(smooth([16, 16])).unwrap();
    pane.wet([8, 8], 3e-3).unwrap();
    let mut heights = vec![0.0; 64 * 64];
    pane.heights(4, &mut heights).unwrap();
    let shown = heights.iter().map(|&height| f64::from(height)).sum::<f64>() * 0.25e-3 * 0.25e-3;
    let volume = pane.water_ng() as f64 / NANOGRAMS_PER_M3;
    assert!((shown / volume - 1.0).abs() < RIM, "{shown} {volume}");
}

#[test]
fn nonsense_is_refused_in_words() {
    for settings in [
        GlassSettings { cells: [2, 9], ..GlassSettings::default() },
        GlassSettings { spacing_m: f64::NAN, ..GlassSettings::default() },
        GlassSettings { pull_m_per_s2: [0.0, -1.0], ..GlassSettings::default() },
        GlassSettings { drag: 0.9, ..GlassSettings::default() },
    ] {
        assert!(Glass::new(settings).is_err());
    }
    let mut pane = Glass::new(smooth([8, 8])).unwrap();
    assert!(
        pane.wet([8, 0], 1e-3).is_err()
            && pane.wet([0, 0], 0.5).is_err()
            && pane.wet([0, 0], f64::NAN).is_err()
    );
    assert!(pane.rain(1e-3, f64::INFINITY, 1.0).is_err() && pane.rain(1e-3, -1.0, 1.0).is_err());
    pane.wet([3, 3], 6e-3).unwrap();
    let before = pane.clone().water_ng();
    for seconds in [86_400.0 * 365.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(pane.advance(seconds).unwrap_err().to_string().starts_with("seconds: wanted 0 to"));
    }
    assert_eq!(pane.water_ng(), before);
    assert!(pane.set_surface(&[1.0], &[1.0]).is_err() && pane.set_obstacles(&[true]).is_err());
    // More water than a cell holds runs off.
    (0..20).for_each(|_| pane.wet([0, 0], 8e-3).unwrap());
    conserved(&pane);
}
