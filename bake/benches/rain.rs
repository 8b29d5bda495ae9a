//! `cargo bench -p squall-bake --bench rain`: what rain costs, beside how right it is.
//!
//! Every line has a time AND an error. Nothing is asserted: machines differ, and tests judge errors.

use glam::DVec3;
use squall_bake::density::{DensitySpec, solve_counts};
use squall_bake::plan::density::bake_density;
use squall_formats::drops::View;
use squall_formats::section::density::Mode;
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::density::{lookup_counts, lookup_counts_into};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{Rain, Scene, Shot, SmoothWindow, Surroundings, Weather, Workspace};
use squall_runtime::random::Random;
use std::hint::black_box;
use std::time::Instant;

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    times[times.len() / 2]
}

fn main() {
    println!("density tables, R .1–200 mm/h");
    println!("{:>9} {:>9} {:>6} {:>8} {:>9}", "asked", "measured", "nodes", "bytes", "bake ms");
    for relative_error in [5e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7] {
        let start = Instant::now();
        let section = bake_density(&DensitySpec { relative_error, ..Default::default() }).unwrap();
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let (nodes, bytes) = (section.rates.len(), section.write().len());
        println!(
            "{relative_error:>9.0e} {:>9.1e} {nodes:>6} {bytes:>8} {milliseconds:>9.1}",
            section.measured_error
        );
    }

    let section = bake_density(&DensitySpec::default()).unwrap();
    let mut random = Random::new(1);
    let questions: Vec<(View, MillimetresPerHour)> = (0..1000)
        .map(|_| {
            let view = View {
                vertical_fov: Degrees(random.range(20.0, 140.0)).into(),
                height_px: 1080.0,
                aspect: 16.0 / 9.0,
                exposure: Seconds(random.range(0.001, 0.033)),
                min_px: random.range(10.0, 50.0),
                max_px: random.range(60.0, 200.0),
            };
            (view, MillimetresPerHour(0.1 * libm::pow(2000.0, random.unit())))
        })
        .collect();
    println!("\nlookup against quadrature, 1000 random questions");
    println!("{:>12} {:>8} {:>9} {:>10} {:>12}", "mode", "classes", "lookup ns", "solve ns", "worst error");
    for mode in Mode::ALL {
        let classes: Vec<_> = section.table(mode).classes.iter().map(|class| class.diameter).collect();
        let mut counts = vec![0.0; classes.len()];
        let lookups = (0..21).map(|_| {
            let start = Instant::now();
            for (view, rate) in &questions {
                black_box(lookup_counts_into(&section, mode, view, *rate, &mut counts).unwrap());
            }
            start.elapsed().as_secs_f64() * 1e9 / questions.len() as f64
        });
        let lookup_ns = median(lookups.collect());
        let start = Instant::now();
        let exact: Vec<_> =
            questions.iter().map(|(view, rate)| solve_counts(mode, &classes, view, *rate).unwrap()).collect();
        let solve_ns = start.elapsed().as_secs_f64() * 1e9 / questions.len() as f64;
        let mut worst = 0.0_f64;
        for ((view, rate), exact) in questions.iter().zip(exact) {
            for (found, exact) in lookup_counts(&section, mode, view, *rate).unwrap().iter().zip(exact) {
                worst = worst.max((found / exact - 1.0).abs());
            }
        }
        println!("{:>12} {:>8} {lookup_ns:>9.0} {solve_ns:>10.0} {worst:>12.1e}", mode.name(), classes.len());
    }

    println!(
        "\nframes at 1920×1080, T 20 ms, 30–200 px, level and pitched poses; mean of 40 against the table"
    );
    println!(
        "{:>4} {:>4} {:>9} {:>9} {:>8} {:>8} {:>9} {:>10} {:>9}",
        "R", "fov", "expected", "mean", "error %", "find ms", "drawn", "draw ms", "kept %"
    );
    for threads in [1, rayon::current_num_threads()] {
        println!("{threads} thread(s)");
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        for (rate, fov) in [(2.0, 120.0), (25.0, 120.0), (75.0, 120.0), (75.0, 60.0)] {
            pool.install(|| frames(&Rain::new(&section, 7), rate, fov));
        }
    }
}

fn frames(rain: &Rain, rate: f64, fov: f64) {
    const POSES: usize = 40;
    let mut random = Random::new(9);
    let mut workspace = Workspace::new();
    let mut picture = Picture::new(1920, 1080).unwrap();
    let light = Surroundings { above: [1.0; 3], below: [0.1; 3], behind: [0.3; 3], ..Default::default() };
    let scene = Scene { depth: None, kernel: &SmoothWindow, light: &light, gain: 1.0 };
    let (mut find, mut draw, mut inside, mut drawn, mut kept) = (vec![], vec![], 0.0, 0, 0.0);
    for _ in 0..POSES {
        let (yaw, pitch) = (random.range(0.0, std::f64::consts::TAU), random.range(-0.5, 0.5));
        let direction = DVec3::new(libm::cos(yaw), libm::sin(yaw), libm::tan(pitch));
        let position = DVec3::new(random.range(-100.0, 100.0), random.range(-100.0, 100.0), 1.7);
        let projection = Projection::Perspective { vertical_fov: Degrees(fov).into() };
        let camera = Camera::new(position, direction, DVec3::Z, projection, [1920, 1080]).unwrap();
        let wind = DVec3::new(random.range(-3.0, 3.0), random.range(-3.0, 3.0), 0.0);
        let time = Seconds(random.range(0.0, 1000.0));
        let weather = Weather::steady(MillimetresPerHour(rate), wind, time);
        let shot = Shot::new(&camera, Seconds(0.02));
        let start = Instant::now();
        let streaks = rain.find(&shot, &weather, None, &mut workspace).unwrap();
        find.push(start.elapsed().as_secs_f64() * 1e3);
        drawn += streaks.len();
        let names: std::collections::HashSet<u64> =
            streaks.iter().filter(|s| s.inside).map(|s| s.id).collect();
        inside += names.len() as f64;
        let start = Instant::now();
        workspace.draw(&shot, &scene, &mut picture).unwrap();
        draw.push(start.elapsed().as_secs_f64() * 1e3);
        let later = Weather::steady(MillimetresPerHour(rate), wind, Seconds(time.0 + 1.0 / 60.0));
        let again = rain.find(&shot, &later, None, &mut workspace).unwrap();
        kept += again.iter().filter(|s| s.inside && names.contains(&s.id)).count() as f64;
    }
    let classes = squall_formats::drops::DEFAULT_DIAMETERS;
    let camera = View {
        vertical_fov: Degrees(fov).into(),
        height_px: 1080.0,
        aspect: 16.0 / 9.0,
        exposure: Seconds(0.02),
        min_px: 30.0,
        max_px: 200.0,
    };
    let exact = solve_counts(Mode::Default, &[classes], &camera, MillimetresPerHour(rate)).unwrap()[0];
    let mean = inside / POSES as f64;
    println!(
        "{rate:>4} {fov:>4} {exact:>9.1} {mean:>9.1} {:>8.2} {:>8.2} {:>9} {:>10.2} {:>9.1}",
        100.0 * (mean / exact - 1.0),
        median(find),
        drawn / POSES,
        median(draw),
        100.0 * kept / inside,
    );
}
