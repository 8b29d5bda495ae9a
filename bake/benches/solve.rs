//! Time of the transport solver, in one run with what it reaches.
use glam::DVec3;
use squall_formats::GridShape;
use squall_runtime::random::Random;
use squall_runtime::transport::direct::{DirectField, Light, Tracer};
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::{SolveBuffers, SolveSettings, Solver};
use squall_runtime::transport::{Boundary, Cloud};
use std::time::Instant;

fn layer() -> Cloud {
    let shape = GridShape::new(32, 32, 4);
    let mut random = Random::new(1);
    let column: Vec<f64> = (0..1024).map(|_| libm::exp(0.5 * random.normal())).collect();
    let extinction = (0..shape.len()).map(|i| (0.1 * column[i % 1024]) as f32).collect();
    Cloud {
        shape,
        cell_m: [50.0; 3],
        origin_m: DVec3::ZERO,
        extinction,
        albedo: 0.999,
        g: 0.85,
        boundary: Boundary::Open,
    }
    .checked()
    .unwrap()
}

fn main() {
    for (refine, quadrature, tolerance) in [
        (1, Quadrature::Lebedev26, 1e-2),
        (1, Quadrature::Lebedev26, 1e-3),
        (2, Quadrature::Lebedev26, 1e-2),
        (2, Quadrature::Lebedev26, 1e-3),
        (2, Quadrature::Lebedev50, 1e-3),
    ] {
        let cloud = layer().refined([refine; 3]).unwrap();
        let settings = SolveSettings { quadrature, tolerance, ..Default::default() };
        let solver = Solver::<4>::new(&cloud, settings).unwrap();
        let tracer = Tracer::new(&cloud, solver.scaled().extinction_scale);
        let mut random = Random::new(3);
        let mut direct = DirectField::<4>::new(&cloud, &[]);
        let mut sources = vec![[F32x16::splat(0.0); 4]; cloud.shape.len()];
        let t = Instant::now();
        for lane in 0..16 {
            let p =
                DVec3::new(random.range(0.0, 1600.0), random.range(0.0, 1600.0), random.range(-300.0, 200.0));
            direct.clear();
            tracer.rays(Light::Point { position: p, intensity: 1.0 }, 2, |ray| {
                tracer.trace(ray, &mut direct);
            });
            for (s, d) in sources.iter_mut().zip(&direct.moments) {
                for m in 0..4 {
                    s[m].0[lane] = d[m] / cloud.cell_volume() as f32;
                }
            }
        }
        let direct_time = t.elapsed();
        let mut out = Vec::new();
        let mut buffers = SolveBuffers::default();
        solver.solve(&sources, &mut out, &mut buffers, None);
        let mut batch = std::time::Duration::MAX;
        let mut report = None;
        for _ in 0..7 {
            let t = Instant::now();
            report = Some(solver.solve(&sources, &mut out, &mut buffers, None));
            batch = batch.min(t.elapsed());
        }
        let report = report.unwrap();
        let single: Vec<[f32; 4]> = sources.iter().map(|s| s.map(|v| v.0[0])).collect();
        let mut out1 = Vec::new();
        let mut buffers1 = SolveBuffers::default();
        solver.solve::<f32>(&single, &mut out1, &mut buffers1, None);
        let mut one = std::time::Duration::MAX;
        let mut r1 = None;
        for _ in 0..9 {
            let t = Instant::now();
            r1 = Some(solver.solve::<f32>(&single, &mut out1, &mut buffers1, None));
            one = one.min(t.elapsed());
        }
        let r1 = r1.unwrap();
        println!(
            "r{refine} {quadrature:?} tol {tolerance}: direct {:.2} ms/light, batch {:.2} ms/light ({} sweeps), single {:.2} ms ({} sweeps), diff {:e}",
            direct_time.as_secs_f64() * 1e3 / 16.0,
            batch.as_secs_f64() * 1e3 / 16.0,
            report.sweeps,
            one.as_secs_f64() * 1e3,
            r1.sweeps,
            (out[5000 % out.len()][0].0[0] / out1[5000 % out1.len()][0] - 1.0)
        );
    }
}
