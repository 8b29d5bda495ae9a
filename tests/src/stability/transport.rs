//! Light transport at the edges of its range: depth, albedo, asymmetry, cells, lamps.

use crate::assert_close;
use crate::transport::{ragged, slab};
use glam::DVec3;
use squall_bake::cloud::{Truth, TruthReport, TruthSettings, solve_light};
use squall_bake::progress::Quiet;
use squall_formats::GridShape;
use squall_formats::section::response::SweepScheme;
use squall_formats::sphere::harmonics;
use squall_runtime::phase::{PreparedHg, henyey_greenstein};
use squall_runtime::random::Random;
use squall_runtime::transport::direct::{DirectField, Light, Tracer};
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::{BatchReport, Iteration, SolveBuffers, SolveSettings, Solver};
use squall_runtime::transport::{Boundary, Cloud};
use std::f64::consts::PI;

const PRODUCT: Quadrature = Quadrature::DoubleGauss { polar: 4, azimuths: 8 };
const OVERHEAD: Light = Light::Beam { direction: DVec3::NEG_Z, irradiance: 1.0 };

fn truth_settings(refine: u32, solve: SolveSettings) -> TruthSettings {
    TruthSettings { refine, samples: 1, high_degree: false, solve }
}

fn product(tolerance: f64) -> SolveSettings {
    SolveSettings { quadrature: PRODUCT, tolerance, ..SolveSettings::default() }
}

/// Shares of a slab's overhead light that come back and go through, and the report.
fn fluxes(cloud: &Cloud, settings: &TruthSettings) -> (f64, f64, TruthReport) {
    let Truth { report, .. } = solve_light(cloud, OVERHEAD, &[], settings, &Quiet).unwrap();
    let down = report.scattered_out_w[4] + report.direct_out_w;
    (report.scattered_out_w[5] / report.power_in_w, down / report.power_in_w, report)
}

/// What a solver makes of the same even, isotropic source in every cell.
fn solve_even(cloud: &Cloud, settings: SolveSettings) -> (Vec<f64>, BatchReport) {
    let solver = Solver::<4>::new(cloud, settings).unwrap();
    let source = vec![[1.0f32, 0.0, 0.0, 0.0]; cloud.shape.len()];
    let mut moments = Vec::new();
    let report = solver.solve::<f32>(&source, &mut moments, &mut SolveBuffers::default(), None);
    (moments.iter().map(|row| f64::from(row[0])).collect(), report)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / b.iter().map(|b| b * b).sum::<f64>()).sqrt()
}

#[test]
fn source_iteration_calls_itself_done_far_from_the_answer_and_the_default_does_not() {
    println!("| τ | ω | source iteration: sweeps, residual, true error | MINRES: sweeps, residual, true error |");
    let mut worst = [0.0f64; 2];
    for (depth, albedo) in [(5.0, 1.0), (20.0, 0.99), (20.0, 0.999), (80.0, 1.0), (320.0, 1.0)] {
        let cloud = slab(32, depth, albedo, 0.0);
        let run = |iteration, tolerance| {
            let settings = SolveSettings { quadrature: Quadrature::Lebedev14, iteration, max_sweeps: 3000, ..product(tolerance) };
            solve_even(&cloud, settings)
        };
        let (exact, report) = run(Iteration::Minres, 1e-5);
        assert!(report.lanes[0].converged, "{report:?}");
        let [source, ours] = [Iteration::Source, Iteration::Minres].map(|iteration| {
            let (found, report) = run(iteration, 1e-3);
            (report.sweeps, report.lanes[0].residual, report.lanes[0].converged, distance(&found, &exact))
        });
        println!("| {depth} | {albedo} | {source:?} | {ours:?} |");
        worst = [worst[0].max(source.3), worst[1].max(ours.3)];
        assert!(ours.2 && ours.3 < 0.02, "{ours:?}");
    }
    println!("{worst:?}");
}

#[test]
fn deep_slabs_transmit_as_diffusion_says_while_their_cells_are_thin() {
    println!("| τ | τ of a cell | T | R + T − 1 | T over closed form − 1 |");
    let settings = truth_settings(1, product(1e-4));
    for (depth, layers) in [(8.0, 32), (32.0, 128), (80.0, 320), (80.0, 160), (80.0, 80), (80.0, 40), (80.0, 20), (320.0, 64), (1000.0, 64)] {
        let (up, down, report) = fluxes(&slab(layers, depth, 1.0, 0.0), &settings);
        // Milne's problem: 4 K(1) / (3 (τ + 2 · .71045)) with K(1) = √3/4 · H(1), H(1) = 2.90781.
        let wanted = 4.0 / 3.0 * 1.259_12 / (depth + 1.420_89);
        let cell = depth / f64::from(layers);
        println!("| {depth} | {cell} | {down:.5} | {:+.1e} | {:+.3} |", up + down - 1.0, down / wanted - 1.0);
        assert!((up + down - 1.0).abs() < 5e-4, "{depth}");
        assert_close(report.deepest_cell, cell, 1e-5, "depth of a cell");
    }
    let far = slab(64, 2000.0, 1.0, 0.0);
    let refused = solve_light(&far, OVERHEAD, &[], &truth_settings(0, product(1e-4)), &Quiet).unwrap_err().to_string();
    println!("{refused}");
}

#[test]
fn a_light_that_is_no_number_is_never_called_solved_and_spoils_no_other() {
    // As deep and as white as the case in which BiCGSTAB gave NaN.
    let cloud = slab(16, 320.0, 1.0, 0.0);
    let solver = Solver::<4>::new(&cloud, product(1e-3)).unwrap();
    let even = |lane: usize, value: f32| {
        let mut batch = vec![[F32x16::splat(0.0); 4]; cloud.shape.len()];
        for cell in &mut batch {
            for other in 0..16 {
                cell[0].set_lane(other, if other == lane { value } else { 1.0 });
            }
        }
        let mut out = Vec::new();
        let report = solver.solve(&batch, &mut out, &mut SolveBuffers::default(), None);
        let lane = |lane: usize| out.iter().map(|cell| cell[0].lane(lane)).collect::<Vec<f32>>();
        (report, lane(3), lane(4))
    };
    let (_, wanted, _) = even(3, 1.0);
    assert!(wanted.iter().all(|v| v.is_finite() && *v > 0.0));
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
        let (report, _, neighbour) = even(3, value);
        assert!(report.lanes.iter().enumerate().all(|(lane, report)| report.converged == (lane != 3 || value == f32::MAX)), "{value}: {report:?}");
        assert!(neighbour == wanted, "{value}");
    }
    // Very dim and very bright light is the same light.
    for power in [-120, -60, 60, 120] {
        let factor = libm::exp2f(power as f32);
        let (report, found, _) = even(3, factor);
        assert!(report.lanes[3].converged);
        for (found, wanted) in found.iter().zip(&wanted) {
            assert_close(f64::from(*found), f64::from(*wanted) * f64::from(factor), 1e-6, "scaled light");
        }
    }
}

#[test]
fn diamond_fluxes_turn_negative_in_thick_cells_and_the_default_schemes_do_not() {
    println!("| τ of a cell | weighted | diamond | step | (share of cells below 0, and of their light)");
    let y0 = harmonics([0.0, 0.0, 1.0])[0];
    for depth in [0.01, 0.1, 1.0, 3.0, 10.0, 100.0, 1000.0] {
        let shape = GridShape::new(8, 8, 8);
        let cloud = Cloud {
            shape, cell_m: [1.0; 3], origin_m: DVec3::ZERO,
            extinction: vec![depth; shape.len()], albedo: 0.9, g: 0.0, boundary: Boundary::Open,
        };
        let shares = [SweepScheme::Weighted, SweepScheme::Diamond, SweepScheme::Step].map(|scheme| {
            let light = Light::Point { position: DVec3::new(3.5, 3.5, -2.0), intensity: 1.0 };
            let solve = SolveSettings { scheme, quadrature: Quadrature::Lebedev26, tolerance: 1e-4, ..SolveSettings::default() };
            let solver = Solver::<4>::new(&cloud, solve).unwrap();
            let mut direct = DirectField::<4>::new(&cloud, &[]);
            let tracer = Tracer::new(&cloud, 1.0);
            tracer.rays(light, 2, |ray| { tracer.trace(ray, &mut direct); });
            let mut moments = Vec::new();
            let report = solver.solve::<f32>(&direct.moments, &mut moments, &mut SolveBuffers::default(), None);
            assert!(report.lanes[0].converged, "{report:?}");
            let values: Vec<f64> = moments.iter().map(|row| f64::from(row[0]) / y0).collect();
            let below = values.iter().filter(|v| **v < 0.0);
            let total: f64 = values.iter().map(|v| v.abs()).sum();
            (below.clone().count() as f64 / 512.0, -below.sum::<f64>() / total)
        });
        println!("| {depth} | {shares:?} |");
    }
}

/// Shares of a plane-parallel slab's overhead light that come back: photons, one by one.
fn photons(depth: f64, g: f64, count: usize) -> f64 {
    let mut random = Random::new(23);
    let mut back = 0.0;
    for _ in 0..count {
        let (mut at, mut mu) = (0.0f64, 1.0f64);
        loop {
            at -= mu * libm::log(1.0 - random.unit());
            if at < 0.0 || at > depth {
                back += if at < 0.0 { 1.0 } else { 0.0 };
                break;
            }
            let part = (1.0 - g * g) / (1.0 - g + 2.0 * g * random.unit());
            let cosine = ((1.0 + g * g - part * part) / (2.0 * g)).clamp(-1.0, 1.0);
            let sine = ((1.0 - cosine * cosine) * (1.0 - mu * mu)).max(0.0).sqrt();
            mu = (mu * cosine + sine * libm::cos(std::f64::consts::TAU * random.unit())).clamp(-1.0, 1.0);
        }
    }
    back / count as f64
}

#[test]
fn raw_moments_of_a_peaked_phase_function_mislead_and_delta_scaled_ones_do_not() {
    let g = 0.85;
    let depth = 2.0 / (1.0 - g);
    let exact = photons(depth, g, 40_000);
    println!("photons: R {exact:.4}");
    println!("| set | degree | delta R | raw R |");
    let cloud = slab(64, depth, 1.0, g);
    for (name, quadrature) in [("Lebedev 14", Quadrature::Lebedev14), ("Lebedev 26", Quadrature::Lebedev26), ("Lebedev 50", Quadrature::Lebedev50), ("4 × 8", PRODUCT)] {
        for high_degree in [false, true] {
            let [scaled, raw] = [true, false].map(|delta| {
                let settings = TruthSettings { high_degree, ..truth_settings(1, SolveSettings { quadrature, delta, ..product(1e-4) }) };
                match solve_light(&cloud, OVERHEAD, &[], &settings, &Quiet) {
                    Ok(truth) => format!("{:.4} {:.1e}", truth.report.scattered_out_w[5] / truth.report.power_in_w, truth.report.energy_balance),
                    Err(error) => error.to_string(),
                }
            });
            println!("| {name} | {high_degree} | {scaled} | {raw} |");
        }
    }
}

#[test]
fn asymmetry_up_to_its_ends_keeps_energy_and_reflects_as_photons_do() {
    println!("| g | τ | photons R | degree 1 R | degree 3 R |");
    let mut similar = 0.0;
    for g in [-0.999, -0.9, -0.5, 0.5, 0.9, 0.99, 0.9999, 0.999_999, 1.0 - 1e-9] {
        // The same transport depth for all forward ones, which then reflect alike.
        let depth = if g > 0.0 { 2.0 / (1.0 - g) } else { 2.0 };
        if g < 0.95 {
            similar = photons(depth, g, 20_000);
        }
        let cloud = slab(64, depth, 1.0, g);
        let found = [false, true].map(|high_degree| {
            let settings = TruthSettings { high_degree, ..truth_settings(1, product(1e-4)) };
            let (up, down, _) = fluxes(&cloud, &settings);
            assert!((up + down - 1.0).abs() < 5e-4, "{g}: {up} {down}");
            up
        });
        println!("| {g} | {depth:.0} | {similar:.4} | {:.4} | {:.4} |", found[0], found[1]);
        assert!((found[1] - similar).abs() < 0.025, "{g}: {found:?} {similar}");
    }
}

#[test]
fn a_cloud_that_scatters_straight_on_is_no_cloud() {
    // g → 1 without absorption: every scattering goes on straight, so that all light together is that of empty space.
    let block = |extinction: f32, g: f64| {
        let shape = GridShape::new(6, 6, 6);
        let cloud = Cloud { shape, cell_m: [1.0; 3], origin_m: DVec3::ZERO, extinction: vec![extinction; 216], albedo: 1.0, g, boundary: Boundary::Open };
        let light = Light::Point { position: DVec3::new(3.2, 2.9, 3.4), intensity: 1.0 };
        let truth = solve_light(&cloud, light, &[DVec3::X], &truth_settings(1, product(1e-4)), &Quiet).unwrap();
        let towards = truth.towards(0, DVec3::X);
        assert!(towards.iter().all(|v| v.is_finite()));
        truth.phi_scattered().iter().zip(truth.phi_direct()).map(|(a, b)| f64::from(a + b)).collect::<Vec<f64>>()
    };
    let empty = block(0.0, 0.0);
    for (depth, gap) in [(1.0, 1e-6), (1.0, 1e-7), (1.0, 1e-9), (1.0, 1e-12), (0.03, 1e-6), (100.0, 1e-9)] {
        let found = block(depth, 1.0 - gap);
        let error = distance(&found, &empty);
        println!("τ {depth}, 1 − g {gap:e}: {error:.1e}");
        assert!(error < 1e-3, "τ {depth}, 1 − g {gap:e}: {error}");
    }
}

#[test]
fn narrow_phase_functions_keep_their_digits_at_the_peak() {
    for gap in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8] {
        for sign in [1.0, -1.0] {
            let g = sign * (1.0 - gap);
            for off in [0.0, 1e-6, 1e-4, 0.01, 0.5, 2.0] {
                let cosine = (sign * (1.0 - off)) as f32;
                let (found, exact) = (f64::from(PreparedHg::new(g).value(cosine)), henyey_greenstein(g, f64::from(cosine)));
                assert_close(found, exact, 2e-6, &format!("g {g}, cosine {cosine}"));
            }
        }
    }
}

#[test]
fn a_cloud_of_one_cell_keeps_its_books_for_any_depth_and_any_place_of_the_lamp() {
    let half = 0.5;
    // Seen from straight below its middle, a square of half edge a fills 4 atan(a² / (d √(2a² + d²))).
    let square = |d: f64| 4.0 * libm::atan(half * half / (d * (2.0 * half * half + d * d).sqrt()));
    let places = [
        ("centre", DVec3::ZERO, 4.0 * PI),
        ("face", DVec3::new(0.0, 0.0, -half), 2.0 * PI),
        ("edge", DVec3::new(0.0, -half, -half), PI),
        ("corner", DVec3::splat(-half), 0.5 * PI),
        ("1 mm below", DVec3::new(0.0, 0.0, -half - 1e-3), square(1e-3)),
        ("far below", DVec3::new(0.0, 0.0, -half - 100.0), square(100.0)),
    ];
    println!("| τ | lamp | power in over closed form | leaves unscattered | closed form | energy balance |");
    for depth in [0.01f32, 0.1, 1.0, 10.0, 100.0, 1000.0] {
        for (albedo, (name, position, solid_angle)) in [1.0, 0.9].into_iter().flat_map(|a| places.map(|p| (a, p))) {
            let cloud = Cloud {
                shape: GridShape::new(1, 1, 1), cell_m: [1.0; 3], origin_m: DVec3::splat(-half),
                extinction: vec![depth], albedo, g: 0.0, boundary: Boundary::Open,
            };
            let light = Light::Point { position, intensity: 2.0 };
            let settings = TruthSettings { samples: 8, ..truth_settings(1, product(1e-4)) };
            let truth = solve_light(&cloud, light, &[DVec3::X], &settings, &Quiet).unwrap();
            let values = [truth.phi_scattered(), truth.phi_direct(), truth.towards(0, DVec3::X)];
            assert!(values.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name} {depth}: {values:?}");
            let TruthReport { power_in_w, direct_out_w, energy_balance, .. } = truth.report;
            assert_close(power_in_w, 2.0 * solid_angle, 1e-5, name);
            assert!(energy_balance.abs() < 1e-3, "{name} {depth}: {energy_balance}");
            // Out of a cube of edge 1: from the middle a ray goes ½ over its largest component, from a corner 1 over it.
            let reach = match name { "centre" => 0.5, "corner" => 1.0, _ => continue };
            let count = 20_000;
            let mean = (0..count).map(|i| {
                let d = squall_runtime::transport::direct::fibonacci(i, count).abs().max_element();
                libm::exp(-f64::from(depth) * reach / d)
            }).sum::<f64>() / count as f64;
            let found = direct_out_w / power_in_w;
            println!("| {depth} | {name} | {:.6} | {found:.3e} | {mean:.3e} | {energy_balance:+.1e} |", power_in_w / (2.0 * solid_angle));
            if depth <= 10.0 {
                assert_close(found, mean, 0.02, name);
            }
        }
    }
}

#[test]
fn a_slab_reflects_the_same_whatever_the_width_of_its_columns() {
    println!("| column width / layer | set | R | T | R + T − 1 | sweeps |");
    for quadrature in [Quadrature::Lebedev26, PRODUCT] {
        let mut wanted = None;
        for width in [1e4, 10.0, 1.0, 0.1, 1e-3] {
            let plane = slab(16, 2.0, 1.0, 0.0);
            let shape = GridShape::new(2, 2, 16);
            let layer = plane.cell_m[2];
            let cloud = Cloud { shape, cell_m: [width * layer, width * layer, layer], extinction: vec![2.0; shape.len()], ..plane };
            let settings = SolveSettings { quadrature, ..product(1e-5) };
            let truth = match solve_light(&cloud, OVERHEAD, &[], &truth_settings(1, settings), &Quiet) {
                Ok(truth) => truth.report,
                Err(error) => { println!("| {width} | {quadrature:?} | {error} |"); continue; }
            };
            let (up, down) = (truth.scattered_out_w[5] / truth.power_in_w, (truth.scattered_out_w[4] + truth.direct_out_w) / truth.power_in_w);
            println!("| {width} | {quadrature:?} | {up:.5} | {down:.5} | {:+.1e} | {} |", up + down - 1.0, truth.sweeps);
            let wanted = *wanted.get_or_insert(up);
            if (up - wanted).abs() > 2e-3 { println!("OFF"); }
        }
    }
}

#[test]
fn cells_a_hundred_times_longer_than_wide_describe_the_same_block() {
    println!("| cells | cell, m | R | balance |");
    for dims in [[16, 16, 16], [4, 4, 64], [64, 64, 4], [64, 4, 4], [2, 2, 160], [160, 2, 2]] {
        let shape = GridShape::new(dims[0], dims[1], dims[2]);
        let cell_m = dims.map(|n| 80.0 / f64::from(n));
        let cloud = Cloud { shape, cell_m, origin_m: DVec3::ZERO, extinction: vec![0.05; shape.len()], albedo: 1.0, g: 0.0, boundary: Boundary::Open };
        let (up, _, report) = fluxes(&cloud, &truth_settings(1, product(1e-4)));
        println!("| {dims:?} | {cell_m:?} | {up:.4} | {:+.1e} |", report.energy_balance);
    }
}

#[test]
fn vacuum_between_cells_is_no_trouble_to_any_scheme() {
    let cloud = ragged(1.0, 0.85);
    for scheme in [SweepScheme::Weighted, SweepScheme::Diamond, SweepScheme::Step] {
        let settings = SolveSettings { scheme, ..product(1e-4) };
        let (_, _, report) = fluxes(&cloud, &truth_settings(1, settings));
        assert!(report.energy_balance.abs() < 5e-4, "{scheme:?}: {report:?}");
    }
}
