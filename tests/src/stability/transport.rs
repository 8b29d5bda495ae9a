//! Light transport at the edges of its range: depth, albedo, asymmetry, cells, lamps.

use crate::transport::{ragged, slab, slab_fluxes};
use glam::DVec3;
use squall_bake::cloud::{Truth, TruthSettings, solve_light};
use squall_bake::error::BakeError;
use squall_bake::progress::Quiet;
use squall_formats::GridShape;
use squall_formats::section::response::SweepScheme;
use squall_runtime::random::Random;
use squall_runtime::transport::direct::{DirectField, Light, Tracer};
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::{BatchReport, Iteration, SolveBuffers, SolveSettings, Solver};
use squall_runtime::transport::{Boundary, Cloud};

const PRODUCT: Quadrature = Quadrature::DoubleGauss { polar: 4, azimuths: 8 };

const OVERHEAD: Light = Light::Beam { direction: DVec3::NEG_Z, irradiance: 1.0 };

/// What a solver makes of a light from above: moments of scattered light, and how it went.
fn solve(cloud: &Cloud, light: Light, settings: SolveSettings) -> (Vec<[f32; 16]>, BatchReport) {
    let solver = Solver::<4>::new(cloud, settings).unwrap();
    let mut direct = DirectField::<4>::new(cloud, &[]);
    let tracer = Tracer::new(cloud, solver.scaled().extinction_scale);
    tracer.rays(light, 1, |ray| {
        tracer.trace(ray, &mut direct);
    });
    let share = 1.0 / cloud.cell_volume() as f32;
    let sources: Vec<[f32; 4]> = direct.moments.iter().map(|row| row.map(|sum| sum * share)).collect();
    let mut moments = Vec::new();
    let report = solver.solve::<f32>(&sources, &mut moments, &mut SolveBuffers::default(), None);
    (moments, report)
}

/// ‖a − b‖ / ‖b‖ over the cells' fluence.
fn distance(a: &[[f32; 16]], b: &[[f32; 16]]) -> f64 {
    let sum = |f: &dyn Fn(usize) -> f64| (0..a.len()).map(|i| f(i) * f(i)).sum::<f64>();
    (sum(&|i| f64::from(a[i][0] - b[i][0])) / sum(&|i| f64::from(b[i][0]))).sqrt()
}

#[test]
fn source_iteration_calls_itself_done_far_from_the_answer_and_the_default_does_not() {
    println!("| τ | ω | source: sweeps, residual, error | default: sweeps, residual, error |");
    for (depth, albedo) in [(1.0, 1.0), (5.0, 1.0), (20.0, 0.99), (20.0, 0.999), (20.0, 1.0), (80.0, 1.0), (320.0, 1.0)] {
        let cloud = slab(64, depth, albedo, 0.0);
        let settings = |iteration, tolerance| SolveSettings { quadrature: PRODUCT, tolerance, iteration, max_sweeps: 20000, ..SolveSettings::default() };
        let (exact, r) = solve(&cloud, OVERHEAD, settings(Iteration::Minres, 1e-6));
        println!("exact {:?}", r);
        for t in [1e-3, 1e-4] {
        let [source, ours] = [Iteration::Source, Iteration::Minres].map(|iteration| {
            let (found, report) = solve(&cloud, OVERHEAD, settings(iteration, t));
            (distance(&found, &exact), report.sweeps, report.lanes[0])
        });
        println!("| {depth} | {albedo} | {source:?} | {ours:?} |");
        }
    }
}

#[test]
fn deep_clouds_without_absorption_transmit_as_diffusion_says() {
    println!("| layers | τ | R | T | R + T − 1 | T over closed form |");
    for (layers, depth) in [(32, 0.32), (64, 0.64), (64,8.0), (64, 32.0), (64, 80.0), (128, 80.0), (64, 320.0), (64, 1000.0), (64, 6400.0), (64, 64000.0)] {
        for hd in [false] {
        let cloud = slab(layers, depth, 1.0, 0.0);
        let mut settings = TruthSettings { refine: 1, samples: 1, high_degree: hd, ..TruthSettings::default() };
        settings.solve.quadrature = Quadrature::DoubleGauss { polar: 4, azimuths: 8 };
        match solve_light(&cloud, OVERHEAD, &[], &settings, &Quiet) {
            Ok(Truth { report, .. }) => {
                let (up, down) = (report.scattered_out_w[5] / report.power_in_w, (report.scattered_out_w[4] + report.direct_out_w) / report.power_in_w);
                let wanted = 1.6788 / (depth + 1.4209);
                println!("| {layers} | {depth} | {up:.5} | {down:.6} | {:.1e} | {:.4} | sweeps {} res {:.1e}", up + down - 1.0, down / wanted, report.sweeps, report.residual);
            }
            Err(e) => println!("{depth}: {e}"),
        }
        }
    }
}

/// Shares of a plane-parallel slab's overhead light that come back and go through: photons, one by one.
fn photons(depth: f64, albedo: f64, g: f64, count: usize) -> (f64, f64) {
    let mut random = Random::new(23);
    let (mut back, mut through) = (0.0, 0.0);
    for _ in 0..count {
        let (mut at, mut mu, mut weight) = (0.0f64, 1.0f64, 1.0f64);
        loop {
            at -= mu * libm::log(1.0 - random.unit());
            if at < 0.0 || at > depth {
                *(if at < 0.0 { &mut back } else { &mut through }) += weight;
                break;
            }
            weight *= albedo;
            let xi = random.unit();
            let cosine = if g == 0.0 { 2.0 * xi - 1.0 } else {
                let part = (1.0 - g * g) / (1.0 - g + 2.0 * g * xi);
                (1.0 + g * g - part * part) / (2.0 * g)
            };
            let sine = (1.0 - cosine * cosine).max(0.0).sqrt() * (1.0 - mu * mu).max(0.0).sqrt();
            mu = (mu * cosine + sine * libm::cos(std::f64::consts::TAU * random.unit())).clamp(-1.0, 1.0);
        }
    }
    (back / count as f64, through / count as f64)
}

#[test]
fn asymmetry_probe() {
    println!("| τ* | g | photons R | degree 1 | degree 3 |");
    for g in [-0.999999, -0.99, -0.9, -0.5, -0.3, 0.5, 0.85, 0.95, 0.99, 0.999, 0.9999, 0.99999, 0.999999, 1.0 - 1e-9] {
        // The same transport depth for all.
        let depth = if g > 0.0 { 2.0 / (1.0 - g) } else { 2.0 };
        let exact = if depth < 1000.0 { photons(depth, 1.0, g, 20_000) } else { (0.0, 0.0) };
        let cloud = slab(64, depth, 1.0, g);
        for hd in [false, true] {
            let mut settings = TruthSettings { refine: 1, samples: 1, high_degree: hd, ..TruthSettings::default() };
            settings.solve.quadrature = Quadrature::DoubleGauss { polar: 4, azimuths: 8 };
            let report = solve_light(&cloud, OVERHEAD, &[], &settings, &Quiet).map(|t| t.report);
            match report { Ok(report) => {
            let (up, down) = (report.scattered_out_w[5] / report.power_in_w, (report.scattered_out_w[4] + report.direct_out_w) / report.power_in_w);
            println!("| {depth} | {g} | {exact:?} | {hd} R {up:.4} T {down:.4} bal {:.1e}| sweeps {}", report.energy_balance, report.sweeps); }
            Err(e) => println!("{g} {hd} {e}") }
        }
    }
}
