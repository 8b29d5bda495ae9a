//! The sample's framing: sky, town, wet ground, cloud stand-in, a made-up stroke.

use crate::cloud::{Cloud, Flash};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use squall_bake::picture::write_png8;
use squall_bake::synth::cloud::{CloudKind, synth_cloud};
use squall_bake::synth::town::synth_town;
use squall_formats::GridShape;
use squall_formats::units::Radians;
use squall_runtime::camera::{Camera, Projection, Ray};
use squall_runtime::picture::Picture;
use squall_runtime::random::Random;
use squall_runtime::shade::detail::{Detail, DetailParameters};
use squall_runtime::shade::environment::{Environment, Window};
use squall_runtime::shade::sky::{Sky, SkyParameters};
use squall_runtime::shade::town::Town;
use squall_runtime::shade::town::frame::{Quality, TownFrame};
use squall_runtime::shade::town::light::{GlowLight, Lighting, PointLight};
use squall_runtime::tone::Tone;
use squall_runtime::tone::glow::Glow;

/// A crooked path from `from` to `to` and its branches, as points with a share of the light.
fn stroke(random: &mut Random, from: Vec3, to: Vec3, order: u32, out: &mut Vec<(Vec3, f32)>) {
    let length = (to - from).length();
    let mut path = vec![from, to];
    let mut bend = 0.13 * length;
    while path.len() < 130 {
        let mut finer = vec![path[0]];
        for pair in path.windows(2) {
            let middle =
                (pair[0] + pair[1]) * 0.5 + random.direction().as_vec3() * (bend * random.unit() as f32);
            finer.push(middle);
            finer.push(pair[1]);
        }
        path = finer;
        bend *= 0.52;
    }
    let weight = [1.0, 0.16, 0.05][order as usize];
    for (i, pair) in path.windows(2).enumerate() {
        let pieces = 8;
        for k in 0..pieces {
            let at = pair[0].lerp(pair[1], (k as f32 + 0.5) / pieces as f32);
            let faded = if order == 0 { 1.0 } else { 1.0 - i as f32 / path.len() as f32 };
            out.push((at, weight * faded * (pair[1] - pair[0]).length() / pieces as f32));
        }
    }
    if order < 2 {
        let branches = if order == 0 { 9 } else { 2 };
        for _ in 0..branches {
            let at = (random.range(0.1, 0.85) * (path.len() - 2) as f64) as usize;
            let on = (path[at + 1] - path[at]).normalize();
            let side = random.direction().as_vec3() * 0.75;
            let reach = length * random.range(0.16, 0.45) as f32;
            let mut end = path[at] + (on + side).normalize() * reach;
            end.z = end.z.max(60.0);
            stroke(random, path[at], end, order + 1, out);
        }
    }
}

/// Adds points of light to a picture, each spread over a pixel's blur.
fn draw(
    picture: &mut Picture,
    camera: &Camera,
    points: &[(Vec3, f32)],
    intensity: [f32; 3],
    hidden: &dyn Fn(Vec3) -> bool,
) {
    const SIGMA: f32 = 0.62;
    let per_metre = camera.pixels_per_metre() as f32;
    for &(point, length) in points {
        let Some(place) = camera.project(point.as_dvec3()).filter(|_| !hidden(point)) else { continue };
        let distance = (point.as_dvec3() - camera.position).length() as f32;
        let scale = length * per_metre * per_metre / (distance * distance);
        let (cx, cy) = (place.pixel.x as f32, place.pixel.y as f32);
        let near = |middle: f32, count: usize| {
            (middle - 4.0).max(0.0) as usize..((middle + 4.0).max(0.0) as usize).min(count)
        };
        for y in near(cy, picture.height) {
            for x in near(cx, picture.width) {
                let (dx, dy) = (x as f32 + 0.5 - cx, y as f32 + 0.5 - cy);
                let blur = libm::expf(-(dx * dx + dy * dy) / (2.0 * SIGMA * SIGMA))
                    / (std::f32::consts::TAU * SIGMA * SIGMA);
                for band in 0..3 {
                    picture.pixels[y * picture.width + x][band] += intensity[band] * scale * blur;
                }
            }
        }
    }
}

/// Numbers of `data/storm/view.json` by their JSON pointer, unless given on the command line.
struct View<'a> {
    file: serde_json::Value,
    given: &'a dyn Fn(&str) -> Option<f64>,
}

impl View<'_> {
    fn number(&self, pointer: &str) -> f64 {
        let stored = || self.file.pointer(pointer).and_then(|value| value.as_f64());
        (self.given)(pointer).or_else(stored).unwrap_or_else(|| panic!("no number {pointer}"))
    }

    fn degrees(&self, pointer: &str) -> Radians {
        Radians(self.number(pointer).to_radians())
    }

    fn numbers<const N: usize>(&self, pointer: &str) -> [f64; N] {
        std::array::from_fn(|i| self.number(&format!("{pointer}/{i}")))
    }

    fn point(&self, pointer: &str) -> Vec3 {
        DVec3::from_array(self.numbers(pointer)).as_vec3()
    }
}

pub fn compose(out: &str, given: &dyn Fn(&str) -> Option<f64>) {
    let clock = std::time::Instant::now();
    let lap = |what: &str| println!("{:6.2} s {what}", clock.elapsed().as_secs_f64());
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/storm/view.json");
    let text = std::fs::read_to_string(path).expect(path);
    let view = View { file: serde_json::from_str(&text).expect(path), given };
    let sky = Sky::new(&SkyParameters {
        sun_azimuth: view.degrees("/sky/sun_azimuth_deg"),
        sun_elevation: view.degrees("/sky/sun_elevation_deg"),
        haze: view.number("/sky/haze"),
        overcast: view.number("/sky/overcast"),
        high_cloud: view.number("/sky/high_cloud"),
        sun_irradiance: view.numbers("/sky/sun_irradiance_W_per_m2"),
        tint: view.numbers("/sky/tint"),
        ground_albedo: view.number("/sky/ground_albedo"),
        seed: view.number("/sky/seed") as u32,
    })
    .expect("sky");
    lap("sky");
    let [nx, ny, nz] = view.numbers("/storm/cells").map(|count| count as u32);
    let made =
        synth_cloud(CloudKind::Storm, view.number("/storm/seed") as u64, Some(GridShape::new(nx, ny, nz)))
            .expect("cloud")
            .centred_on(view.numbers("/storm/centre_m"));
    lap("cloud");
    let colour = view.numbers::<3>("/stroke/colour").map(|v| v as f32);
    let flashes: Vec<Flash> = (0..4)
        .map(|i| {
            let [x, y, z, intensity] = view.numbers(&format!("/flash/points/{i}"));
            Flash { position: DVec3::new(x, y, z).as_vec3(), intensity: colour.map(|v| v * intensity as f32) }
        })
        .collect();
    let detail = DetailParameters {
        amplitude: view.number("/detail/amplitude") as f32,
        size: view.number("/detail/size_m") as f32,
        fibres_from: view.number("/detail/fibres_from_m") as f32,
        seed: view.number("/detail/seed") as u32,
    };
    let cloud = Cloud::new(&made, Detail::new(&detail).expect("detail"), sky.sun_direction(), &flashes);
    lap("stand-in light");
    let town = Town::new(&synth_town(view.number("/town/seed") as u64));
    let eye = DVec3::from_array(view.numbers("/camera/position_m"));
    let heading = view.degrees("/camera/heading_deg");
    let (sin_h, cos_h) = libm::sincos(heading.0);
    let (sin_p, cos_p) = libm::sincos(view.degrees("/camera/pitch_deg").0);
    let projection = Projection::Perspective { vertical_fov: view.degrees("/camera/vertical_fov_deg") };
    let size = [view.number("/camera/width") as u32, view.number("/camera/height") as u32];
    let camera =
        Camera::new(eye, DVec3::new(cos_h * cos_p, sin_h * cos_p, sin_p), DVec3::Z, projection, size)
            .expect("camera");

    let beyond = |origin: Vec3, direction: Vec3| {
        let ray = Ray { origin: origin.as_dvec3(), direction: direction.as_dvec3() };
        let mut light = sky.radiance(direction);
        let (own, through, distance) = cloud.look(ray, &sky);
        let air = sky.air_view(2.0, 4_000.0, f64::from(distance));
        for band in 0..3 {
            light[band] = light[band] * through
                + own[band] * air.transmittance[band]
                + air.added[band] * (1.0 - through);
        }
        light
    };
    let window = Window {
        heading,
        half_width: view.degrees("/mirror/half_width_deg"),
        top: view.degrees("/mirror/top_deg"),
        size: view.numbers("/mirror/size").map(|count| count as usize),
    };
    let environment = Environment::new(window, &|direction| beyond(eye.as_vec3(), direction));
    lap("environment");

    let mut random = Random::new(view.number("/stroke/seed") as u64);
    let mut bolt = Vec::new();
    let (from, to) = (view.point("/stroke/from_m"), view.point("/stroke/to_m"));
    stroke(&mut random, from, to, 0, &mut bolt);
    let strength = view.number("/stroke/intensity_W_per_sr_per_m") as f32;
    let light = |position: Vec3, length: f32| PointLight {
        position,
        intensity: colour.map(|v| v * length * strength),
        visibility: 1.0,
    };
    // The main path comes first, 8 · 128 points; what it loses by thinning out, each point gains.
    let thin = |part: &[(Vec3, f32)], step: usize| -> Vec<PointLight> {
        let kept = part.iter().skip(step / 2).step_by(step);
        kept.map(|&(position, length)| light(position, length * step as f32)).collect()
    };
    let mut images = thin(&bolt[..1024], 16);
    images.extend(thin(&bolt[1024..], 400));
    let total: f32 = bolt.iter().map(|p| p.1).sum();
    let points: Vec<PointLight> =
        (0..4).map(|i| light(from.lerp(to, (i as f32 + 0.5) / 4.0), total / 4.0)).collect();
    let glows = [GlowLight {
        centre: view.point("/flash/glow_centre_m"),
        radius: view.number("/flash/glow_radius_m") as f32,
        radiance: colour.map(|v| v * view.number("/flash/glow_radiance") as f32),
    }];
    let ambient = |normal: Vec3| sky.ambient_irradiance(normal);
    let leaves = |_: Vec3, direction: Vec3| environment.lookup(direction);
    let lighting =
        Lighting { ambient: &ambient, points: &points, images: &images, glows: &glows, leaves: &leaves };
    let quality = Quality {
        samples: view.number("/quality/samples") as u32,
        facets: view.number("/quality/facets") as u32,
    };
    let mut frame = TownFrame::default();
    town.render(&camera, &lighting, quality, &mut frame);
    lap("town");

    let mut picture = Picture::new(size[0] as usize, size[1] as usize).expect("picture");
    let width = picture.width;
    picture.pixels.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let town = frame.pixels[y * width + x];
            if town.cover < 1.0 {
                let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                *pixel =
                    beyond(ray.origin.as_vec3(), ray.direction.as_vec3()).map(|v| v * (1.0 - town.cover));
            }
            let air = sky.air_view(2.0, 10.0, f64::from(town.distance.min(4e4)));
            for band in 0..3 {
                pixel[band] += town.radiance[band] * air.transmittance[band] + air.added[band] * town.cover;
            }
        }
    });
    lap("cloud and sky");
    let hidden = |point: Vec3| town.is_blocked(eye.as_vec3(), point);
    draw(&mut picture, &camera, &bolt, colour.map(|v| v * strength), &hidden);
    let tone = Tone {
        exposure: view.number("/tone/exposure") as f32,
        contrast: view.number("/tone/contrast") as f32,
        glow: Glow {
            amount: view.number("/tone/glow_amount") as f32,
            levels: view.number("/tone/glow_levels") as u32,
            reach: view.number("/tone/glow_reach") as f32,
        },
        ..Tone::default()
    };
    write_png8(out.as_ref(), &picture, &tone).expect("picture file");
    lap("picture");
}
