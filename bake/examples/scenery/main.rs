//! Pictures to judge the scenery by, with a stand-in for the cloud's light; and how long the pieces take.
//!
//! `cargo run --release -p squall-bake --example scenery -- cloud OUT.png [key=value …]`: the storm by day;
//! `… -- compose OUT.png [/camera/pitch_deg=15 …]`: the sample's framing from `data/storm/view.json`;
//! `… -- time`: microseconds a call.

mod cloud;
mod compose;
mod time;

use cloud::Cloud;
use glam::DVec3;
use rayon::prelude::*;
use squall_bake::picture::write_png8;
use squall_bake::synth::cloud::{CloudKind, synth_cloud};
use squall_formats::GridShape;
use squall_formats::units::Radians;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::picture::Picture;
use squall_runtime::shade::detail::{Detail, DetailParameters};
use squall_runtime::shade::sky::{Sky, SkyParameters};
use squall_runtime::tone::Tone;
use std::collections::HashMap;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mode = arguments.next().unwrap_or_default();
    let out = arguments.next().unwrap_or_default();
    let options: HashMap<String, String> = arguments
        .filter_map(|argument| argument.split_once('=').map(|(key, value)| (key.into(), value.into())))
        .collect();
    let given = |key: &str| options.get(key).map(|value| value.parse::<f64>().expect(key));
    match mode.as_str() {
        "cloud" => day(&out, &|key, usual| given(key).unwrap_or(usual)),
        "compose" => compose::compose(&out, &given),
        "time" => time::time(),
        _ => eprintln!("usage: scenery cloud OUT.png | compose OUT.png | time"),
    }
}

/// The cloud alone in daylight: azimuth of the viewer, distance, sun, cells, detail.
fn day(out: &str, number: &dyn Fn(&str, f64) -> f64) {
    let cells =
        GridShape::new(number("nx", 96.0) as u32, number("ny", 64.0) as u32, number("nz", 48.0) as u32);
    let started = std::time::Instant::now();
    let made = synth_cloud(CloudKind::Storm, number("seed", 1.0) as u64, Some(cells)).expect("cloud");
    println!("cloud {:.1} s", started.elapsed().as_secs_f64());
    let sky = Sky::new(&SkyParameters {
        sun_azimuth: Radians(number("sun_az", 225.0).to_radians()),
        sun_elevation: Radians(number("sun_el", 30.0).to_radians()),
        high_cloud: 0.0,
        ..SkyParameters::default()
    })
    .expect("sky");
    let detail = DetailParameters {
        amplitude: number("detail", 1.0) as f32,
        size: number("size", 450.0) as f32,
        fibres_from: number("fibres", 7_800.0) as f32,
        seed: 1,
    };
    let cloud = Cloud::new(&made, Detail::new(&detail).expect("detail"), sky.sun_direction(), &[]);
    println!("light {:.1} s", started.elapsed().as_secs_f64());
    let (sin, cos) = libm::sincos(number("view", 270.0).to_radians());
    let distance = number("distance", 16_000.0);
    let eye = DVec3::new(distance * cos, distance * sin, number("eye", 30.0));
    let target = DVec3::new(0.0, 0.0, number("target", 5_200.0));
    let projection = Projection::Perspective { vertical_fov: Radians(number("fov", 48.0).to_radians()) };
    let size = [number("width", 960.0) as u32, number("height", 540.0) as u32];
    let camera = Camera::new(eye, target - eye, DVec3::Z, projection, size).expect("camera");
    let mut picture = Picture::new(size[0] as usize, size[1] as usize).expect("picture");
    let started = std::time::Instant::now();
    picture.pixels.par_chunks_mut(size[0] as usize).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
            let behind = sky.radiance(ray.direction.as_vec3());
            let (light, through, distance) = cloud.look(ray, &sky);
            let air = sky.air_view(ray.origin.z, 4_000.0, f64::from(distance));
            for band in 0..3 {
                let seen = light[band] * air.transmittance[band] + air.added[band] * (1.0 - through);
                pixel[band] = seen + behind[band] * through;
            }
        }
    });
    println!("{:.1} s", started.elapsed().as_secs_f64());
    let tone = Tone { exposure: number("exposure", 0.02) as f32, ..Tone::default() };
    write_png8(out.as_ref(), &picture, &tone).expect("picture file");
}
