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

/// What a solver makes of the same even, isotropic light in every cell of a slab: fluence per cell, the share of the scattered
/// light that neither left nor was absorbed, and how it went.
fn solve_even(cloud: &Cloud, settings: SolveSettings) -> (Vec<f64>, f64, BatchReport) {
    let solver = Solver::<4>::new(cloud, settings).unwrap();
    let source = vec![[1.0f32, 0.0, 0.0, 0.0]; cloud.shape.len()];
    let (mut moments, mut leak) = (Vec::new(), std::array::from_fn(|_| vec![0.0]));
    let report = solver.solve::<f32>(&source, &mut moments, &mut SolveBuffers::default(), Some(&mut leak));
    let fluence: Vec<f64> = moments.iter().map(|row| f64::from(row[0])).collect();
    let y0 = harmonics([0.0, 0.0, 1.0])[0];
    let per_cell = f64::from(cloud.extinction[0]) * cloud.cell_volume() / y0;
    let scattered = cloud.albedo * per_cell * fluence.len() as f64;
    let absorbed = (1.0 - cloud.albedo) * per_cell * fluence.iter().sum::<f64>();
    let left: f64 = leak.iter().map(|side| side[0]).sum();
    (fluence, 1.0 - (left + absorbed) / scattered, report)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    (squares / b.iter().map(|b| b * b).sum::<f64>()).sqrt()
}

#[test]
fn source_iteration_hardly_changes_far_from_the_answer_and_no_solve_goes_by_changes() {
    /// The change from sweep to sweep at which source iteration commonly counts as done.
    const CHANGE: f64 = 1e-3;
    println!(
        "| τ | ω | source iteration: sweeps to a change of 1e-3, light missing, called solved | MINRES: sweeps, light missing |"
    );
    for (depth, albedo) in [(5.0, 1.0), (20.0, 0.99), (20.0, 0.999), (80.0, 1.0), (320.0, 1.0)] {
        let cloud = slab(32, depth, albedo, 0.0);
        let run = |iteration, max_sweeps| {
            let settings =
                SolveSettings { quadrature: Quadrature::Lebedev14, iteration, max_sweeps, ..product(1e-3) };
            solve_even(&cloud, settings)
        };
        let mut sweeps = 16;
        let (missing, report) = loop {
            let ((before, ..), (after, missing, report)) =
                (run(Iteration::Source, sweeps), run(Iteration::Source, sweeps + 1));
            if distance(&before, &after) <= CHANGE {
                break (missing, report);
            }
            sweeps += sweeps / 4;
        };
        let (_, ours, ours_report) = run(Iteration::Minres, 1000);
        let solved = report.lanes[0].converged;
        println!(
            "| {depth} | {albedo} | {sweeps}, {:.1} %, {solved} | {}, {:+.2} % |",
            100.0 * missing,
            ours_report.sweeps,
            100.0 * ours
        );
        assert!(ours_report.lanes[0].converged && ours.abs() < 0.01, "τ {depth}, ω {albedo}: {ours}");
        assert!(!solved || missing < 0.01, "τ {depth}, ω {albedo}: called solved, {missing} missing");
        assert!(depth < 80.0 || missing > 0.3, "τ {depth}: {missing}");
    }
}

#[test]
fn deep_slabs_transmit_as_diffusion_says_while_their_cells_are_thin() {
    println!("| τ | τ of a cell | T | R + T − 1 | T over closed form − 1 |");
    let settings = truth_settings(1, product(1e-4));
    for (depth, layers) in [
        (8.0, 32),
        (32.0, 128),
        (80.0, 320),
        (80.0, 160),
        (80.0, 80),
        (80.0, 40),
        (80.0, 20),
        (320.0, 64),
        (1000.0, 64),
    ] {
        let (up, down, report) = fluxes(&slab(layers, depth, 1.0, 0.0), &settings);
        // Milne's problem: 4 K(1) / (3 (τ + 2 · .71045)) with K(1) = √3/4 · H(1), H(1) = 2.90781.
        let wanted = 4.0 / 3.0 * 1.259_12 / (depth + 1.420_89);
        let cell = depth / f64::from(layers);
        println!("| {depth} | {cell} | {down:.5} | {:+.1e} | {:+.3} |", up + down - 1.0, down / wanted - 1.0);
        assert!((up + down - 1.0).abs() < 5e-4, "{depth}");
        assert_close(report.deepest_cell, cell, 1e-5, "depth of a cell");
        let error = down / wanted - 1.0;
        // About a tenth of the square of a cell's depth, as second-order schemes err, and less in the deepest.
        assert!(
            if cell <= 0.25 { error.abs() < 0.015 } else { error > 0.0 && error < 0.3 * cell * cell },
            "{depth} {cell}: {error}"
        );
    }
    let far = slab(64, 2000.0, 1.0, 0.0);
    let refused =
        solve_light(&far, OVERHEAD, &[], &truth_settings(0, product(1e-4)), &Quiet).unwrap_err().to_string();
    println!("{refused}");
    assert!(refused.contains("optical depth of a cell") && refused.contains("--refine 8"), "{refused}");
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
        assert!(
            report
                .lanes
                .iter()
                .enumerate()
                .all(|(lane, report)| report.converged == (lane != 3 || value == f32::MAX)),
            "{value}: {report:?}"
        );
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
            shape,
            cell_m: [1.0; 3],
            origin_m: DVec3::ZERO,
            extinction: vec![depth; shape.len()],
            albedo: 0.9,
            g: 0.0,
            boundary: Boundary::Open,
        };
        let shares = [SweepScheme::Weighted, SweepScheme::Diamond, SweepScheme::Step].map(|scheme| {
            let light = Light::Point { position: DVec3::new(3.5, 3.5, -2.0), intensity: 1.0 };
            let solve = SolveSettings {
                scheme,
                quadrature: Quadrature::Lebedev26,
                tolerance: 1e-4,
                ..SolveSettings::default()
            };
            let solver = Solver::<4>::new(&cloud, solve).unwrap();
            let mut direct = DirectField::<4>::new(&cloud, &[]);
            let tracer = Tracer::new(&cloud, 1.0);
            tracer.rays(light, 2, |ray| {
                tracer.trace(ray, &mut direct);
            });
            let mut moments = Vec::new();
            let report =
                solver.solve::<f32>(&direct.moments, &mut moments, &mut SolveBuffers::default(), None);
            assert!(report.lanes[0].converged, "{report:?}");
            let values: Vec<f64> = moments.iter().map(|row| f64::from(row[0]) / y0).collect();
            let below = values.iter().filter(|v| **v < 0.0);
            let total: f64 = values.iter().map(|v| v.abs()).sum();
            (below.clone().count() as f64 / 512.0, -below.sum::<f64>() / total)
        });
        println!("| {depth} | {shares:?} |");
        let [(_, weighted), (_, diamond), (step_cells, _)] = shares;
        assert!(weighted < 1e-4 && step_cells == 0.0, "τ {depth}: {shares:?}");
        assert!(depth < 10.0 || diamond > 100.0 * weighted, "τ {depth}: {shares:?}");
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
    const G: f64 = 0.85;
    println!("| τ | set | degree | photons R | delta-scaled: R off | raw: R off |");
    let mut worst = [0.0f64; 2];
    for depth in [1.0, 13.333] {
        let exact = photons(depth, G, 100_000);
        let cloud = slab(32, depth, 1.0, G);
        for (name, quadrature) in [
            ("Lebedev 14", Quadrature::Lebedev14),
            ("Lebedev 26", Quadrature::Lebedev26),
            ("Lebedev 50", Quadrature::Lebedev50),
            ("4 × 8", PRODUCT),
        ] {
            for high_degree in [false, true] {
                let off = [true, false].map(|delta| {
                    let solve = SolveSettings { quadrature, delta, ..product(1e-4) };
                    let (up, down, _) =
                        fluxes(&cloud, &TruthSettings { high_degree, ..truth_settings(1, solve) });
                    assert!((up + down - 1.0).abs() < 1e-3, "{name}: {up} {down}");
                    up / exact - 1.0
                });
                let degree = if high_degree { 3 } else { 1 };
                println!(
                    "| {depth} | {name} | {degree} | {exact:.4} | {:+.1} % | {:+.1} % |",
                    100.0 * off[0],
                    100.0 * off[1]
                );
                worst = [worst[0].max(off[0].abs()), worst[1].max(off[1].abs())];
            }
        }
    }
    assert!(worst[0] < 0.25 && worst[1] > 1.0, "{worst:?}");
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
        // Backward peaks cannot count as unscattered: 2 and 16 moments cut their series short.
        assert!((found[1] - similar).abs() < if g < -0.5 { 0.02 } else { 0.01 }, "{g}: {found:?} {similar}");
        assert!((found[0] - similar).abs() < 0.03, "{g}: {found:?} {similar}");
    }
}

#[test]
fn a_cloud_that_scatters_straight_on_is_no_cloud() {
    // g → 1 without absorption: every scattering goes on straight, so that all light together is that of empty space.
    let block = |extinction: f32, g: f64| {
        let shape = GridShape::new(6, 6, 6);
        let cloud = Cloud {
            shape,
            cell_m: [1.0; 3],
            origin_m: DVec3::ZERO,
            extinction: vec![extinction; 216],
            albedo: 1.0,
            g,
            boundary: Boundary::Open,
        };
        let light = Light::Point { position: DVec3::new(3.2, 2.9, 3.4), intensity: 1.0 };
        let truth =
            solve_light(&cloud, light, &[DVec3::X], &truth_settings(1, product(1e-4)), &Quiet).unwrap();
        let towards = truth.towards(0, DVec3::X);
        assert!(towards.iter().all(|v| v.is_finite()));
        truth
            .phi_scattered()
            .iter()
            .zip(truth.phi_direct())
            .map(|(a, b)| f64::from(a + b))
            .collect::<Vec<f64>>()
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
                // Both forms of 1 + g² − 2g cos θ agree; this one holds its digits.
                let base = gap * gap + 2.0 * (1.0 - gap) * (1.0 - sign * f64::from(cosine));
                let exact = gap * (2.0 - gap) / (4.0 * PI * base * base.sqrt());
                let what = format!("g {g}, cosine {cosine}");
                assert_close(henyey_greenstein(g, f64::from(cosine)), exact, 1e-7, &what);
                assert_close(f64::from(PreparedHg::new(g).value(cosine)), exact, 2e-6, &what);
            }
        }
    }
}

#[test]
fn a_cloud_of_one_cell_keeps_its_energy_for_any_depth_and_any_place_of_the_lamp() {
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
        for (albedo, (name, position, solid_angle)) in
            [1.0, 0.9].into_iter().flat_map(|a| places.map(|p| (a, p)))
        {
            let cloud = Cloud {
                shape: GridShape::new(1, 1, 1),
                cell_m: [1.0; 3],
                origin_m: DVec3::splat(-half),
                extinction: vec![depth],
                albedo,
                g: 0.0,
                boundary: Boundary::Open,
            };
            let light = Light::Point { position, intensity: 2.0 };
            // Round-off of single precision is the floor of a residual, and deep in such a cell it is above 1e-4.
            let tolerance = if depth > 100.0 { 1e-3 } else { 1e-4 };
            let settings = TruthSettings { samples: 8, ..truth_settings(1, product(tolerance)) };
            let truth = solve_light(&cloud, light, &[DVec3::X], &settings, &Quiet).unwrap();
            let values = [truth.phi_scattered(), truth.phi_direct(), truth.towards(0, DVec3::X)];
            assert!(
                values.iter().flatten().all(|v| v.is_finite() && *v >= 0.0),
                "{name} {depth}: {values:?}"
            );
            let TruthReport { power_in_w, direct_out_w, energy_balance, .. } = truth.report;
            assert_close(power_in_w, 2.0 * solid_angle, 1e-5, name);
            assert!(energy_balance.abs() < 1e-3, "{name} {depth}: {energy_balance}");
            // Out of a cube of edge 1: from the middle a ray goes ½ over its largest component, from a corner 1 over it.
            let reach = match name {
                "centre" => 0.5,
                "corner" => 1.0,
                _ => continue,
            };
            let count = 20_000;
            let mean = (0..count)
                .map(|i| {
                    let d = squall_runtime::transport::direct::fibonacci(i, count).abs().max_element();
                    libm::exp(-f64::from(depth) * reach / d)
                })
                .sum::<f64>()
                / count as f64;
            let found = direct_out_w / power_in_w;
            println!(
                "| {depth} | {name} | {:.6} | {found:.3e} | {mean:.3e} | {energy_balance:+.1e} |",
                power_in_w / (2.0 * solid_angle)
            );
            if depth <= 10.0 {
                assert_close(found, mean, 0.02, name);
            }
        }
    }
}

#[test]
fn a_slab_reflects_the_same_whatever_the_width_of_its_columns_or_is_refused() {
    println!("| column width over layer height | set | R, or refusal |");
    for quadrature in [Quadrature::Lebedev26, PRODUCT] {
        let mut wanted = None;
        for width in [1e4, 10.0, 1.0, 0.1, 1e-3] {
            let plane = slab(8, 2.0, 1.0, 0.0);
            let shape = GridShape::new(2, 2, 8);
            let layer = plane.cell_m[2];
            let cell_m = [width * layer, width * layer, layer];
            let cloud = Cloud { shape, cell_m, extinction: vec![2.0; shape.len()], ..plane };
            let settings = SolveSettings { quadrature, max_sweeps: 40, ..product(1e-3) };
            let found = solve_light(&cloud, OVERHEAD, &[], &truth_settings(1, settings), &Quiet);
            match found.map(|truth| truth.report) {
                Ok(report) => {
                    let up = report.scattered_out_w[5] / report.power_in_w;
                    println!("| {width} | {quadrature:?} | {up:.5} |");
                    assert_close(up, *wanted.get_or_insert(up), 2e-3, &format!("width {width}"));
                }
                Err(error) => {
                    println!("| {width} | {quadrature:?} | {error} |");
                    assert!(width < 0.1, "width {width}: {error}");
                }
            }
        }
    }
}

#[test]
fn cells_eighty_times_longer_than_wide_describe_the_same_block() {
    println!("| cells | edges of a cell, m | R | off | energy balance |");
    let mut wanted = None;
    for dims in [[16, 16, 16], [4, 4, 64], [40, 40, 4], [2, 2, 160], [160, 2, 2]] {
        let shape = GridShape::new(dims[0], dims[1], dims[2]);
        let cell_m = dims.map(|n| 80.0 / f64::from(n));
        let (extinction, origin_m) = (vec![0.05; shape.len()], DVec3::ZERO);
        let cloud =
            Cloud { shape, cell_m, origin_m, extinction, albedo: 1.0, g: 0.0, boundary: Boundary::Open };
        let (up, _, report) = fluxes(&cloud, &truth_settings(1, product(1e-3)));
        let wanted = *wanted.get_or_insert(up);
        println!(
            "| {dims:?} | {cell_m:?} | {up:.4} | {:+.1} % | {:+.1e} |",
            100.0 * (up / wanted - 1.0),
            report.energy_balance
        );
        assert!(report.energy_balance.abs() < 1e-3, "{dims:?}: {report:?}");
        // Two cells of optical depth 2 across cannot tell the sides from the middle.
        assert_close(up, wanted, if dims.contains(&2) { 0.25 } else { 0.05 }, &format!("{dims:?}"));
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
