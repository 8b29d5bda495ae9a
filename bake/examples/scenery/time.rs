//! How long one call of each piece takes, on one thread.

use glam::Vec3;
use squall_bake::synth::cloud::{CloudKind, synth_cloud};
use squall_bake::synth::town::synth_town;
use squall_runtime::picture::Picture;
use squall_runtime::random::Random;
use squall_runtime::shade::detail::{Detail, DetailParameters};
use squall_runtime::shade::sky::{Sky, SkyParameters};
use squall_runtime::shade::town::Town;
use squall_runtime::tone::Tone;
use std::hint::black_box;
use std::time::Instant;

/// Best of five runs of `count` calls, ns a call.
fn best(count: usize, mut call: impl FnMut(usize)) -> f64 {
    let mut best = f64::MAX;
    for _ in 0..5 {
        let clock = Instant::now();
        (0..count).for_each(&mut call);
        best = best.min(clock.elapsed().as_secs_f64() * 1e9 / count as f64);
    }
    best
}

pub fn time() {
    let mut random = Random::new(1);
    // Neighbouring points, as a marched ray has them.
    let points: Vec<Vec3> = (0..4096)
        .scan(Vec3::new(0.0, 13_000.0, 4_000.0), |at, _| {
            *at += random.direction().as_vec3() * 60.0;
            Some(*at)
        })
        .collect();
    let full = DetailParameters { amplitude: 1.0, ..DetailParameters::default() };
    let detail = Detail::new(&full).expect("detail");
    let icy = Detail::new(&DetailParameters { fibres_from: 0.0, ..full }).expect("detail");
    let sky = Sky::new(&SkyParameters::default()).expect("sky");
    let town = Town::new(&synth_town(11));
    let directions: Vec<Vec3> = (0..4096)
        .map(|_| (random.direction().as_vec3() * Vec3::new(0.4, 0.0, 0.12) + Vec3::Y).normalize())
        .collect();
    let eye = Vec3::new(-1.5, 0.0, 2.4);
    let print = |what: &str, ns: f64| println!("{ns:12.1} ns  {what}");
    print(
        "Detail::modulate, billows",
        best(4096, |i| {
            black_box(detail.modulate(points[i], 0.3, 0.9));
        }),
    );
    print(
        "Detail::modulate, fibres",
        best(4096, |i| {
            black_box(icy.modulate(points[i], 0.3, 0.9));
        }),
    );
    print(
        "Sky::radiance",
        best(4096, |i| {
            black_box(sky.radiance(directions[i]));
        }),
    );
    print(
        "Sky::cloud_light",
        best(4096, |i| {
            black_box(sky.cloud_light(4_000.0, points[i].as_dvec3()));
        }),
    );
    print(
        "Town::trace",
        best(4096, |i| {
            black_box(town.trace(eye, directions[i], f32::MAX));
        }),
    );
    print(
        "Detail::new",
        best(1, |_| {
            black_box(Detail::new(&full).expect("detail"));
        }),
    );
    print(
        "Sky::new",
        best(1, |_| {
            black_box(Sky::new(&SkyParameters::default()).expect("sky"));
        }),
    );
    let section = synth_town(11);
    print(
        "Town::new",
        best(1, |_| {
            black_box(Town::new(&section));
        }),
    );
    let mut picture = Picture::new(1280, 720).expect("picture");
    for (i, pixel) in picture.pixels.iter_mut().enumerate() {
        *pixel = [0.2, 0.1, 0.3].map(|v| v * (i % 977) as f32 * 0.01);
    }
    print(
        "Tone::to_srgb8, 1280 x 720",
        best(1, |_| {
            black_box(Tone::default().to_srgb8(&picture));
        }),
    );
    print(
        "synth_cloud, 96x64x48, all threads",
        best(1, |_| {
            black_box(synth_cloud(CloudKind::Storm, 1, None).expect("cloud"));
        }),
    );
}
