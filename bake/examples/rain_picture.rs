//! Rain over a grey scene with a wall and a block in it: `rain_picture OUT.png [RATE] [FOV] [EXPOSURE_MS] [GAIN] [PITCH]`.
//!
//! Bakes the density tables, finds the drops, applies the medium and draws the streaks; prints what each step
//! found. The scene is analytic, so the example needs no input.

use glam::DVec3;
use squall_bake::density::DensitySpec;
use squall_bake::plan::density::bake_density;
use squall_formats::units::{Degrees, Metres, MillimetresPerHour, Seconds};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::depth::{DepthBuffer, DepthKind};
use squall_runtime::medium::{Medium, Outlook};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{Ceiling, Rain, RainVolume, Scene, Shot, SmoothWindow, Weather, Workspace};
use squall_runtime::world::WorldLight;

const SIZE: [u32; 2] = [1280, 720];

/// First surface along a ray, m, and its radiance: ground at z = 0, a block 12 m ahead, a wall at 60 m, sky.
fn look(origin: DVec3, direction: DVec3) -> (f64, f64) {
    let mut hit = (f64::INFINITY, 0.75 + 0.25 * direction.z.max(0.0));
    let mut try_surface = |distance: f64, seen: bool, radiance: f64| {
        if seen && distance > 0.0 && distance < hit.0 {
            hit = (distance, radiance);
        }
    };
    let ground = -origin.z / direction.z;
    let at = origin + direction * ground;
    let tile = ((at.x / 2.0).floor() + (at.y / 2.0).floor()).rem_euclid(2.0);
    try_surface(ground, direction.z < 0.0, 0.035 + 0.01 * tile);
    for (x, from, to, top, radiance) in [(12.0, -6.0, -1.0, 5.0, 0.008), (60.0, -5.0, 60.0, 25.0, 0.02)] {
        let distance = (x - origin.x) / direction.x;
        let at = origin + direction * distance;
        try_surface(distance, at.y > from && at.y < to && at.z < top && at.z > 0.0, radiance);
    }
    hit
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |index: usize, default: f64| arguments.get(index).map_or(Ok(default), |text| text.parse());
    let path = arguments.first().map_or("rain.png", String::as_str);
    let rate = MillimetresPerHour(number(1, 25.0)?);
    let exposure = Seconds(number(3, 20.0)? / 1e3);

    let projection = Projection::Perspective { vertical_fov: Degrees(number(2, 60.0)?).into() };
    let (sin, cos) = libm::sincos(number(5, 4.5)?.to_radians());
    let (forward, up) = (DVec3::new(cos, 0.0, sin), DVec3::new(-sin, 0.0, cos));
    let camera = Camera::new(DVec3::Z * 1.7, forward, up, projection, SIZE)?;
    let mut picture = Picture::new(SIZE[0] as usize, SIZE[1] as usize)?;
    let mut metres = Vec::with_capacity(picture.pixels.len());
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let (distance, radiance) = look(ray.origin, ray.direction);
            metres.push(distance as f32);
            picture.pixels[(y * SIZE[0] + x) as usize] = [radiance as f32; 3];
        }
    }
    let depth = DepthBuffer::new(&metres, picture.width, picture.height, DepthKind::Range)?;
    let world = WorldLight::estimate(&picture, &camera);

    let section = bake_density(&DensitySpec::default())?;
    let rain = Rain::new(&section, 1);
    let shot = Shot::new(&camera, exposure);
    let ceiling = Ceiling { height: Metres(1500.0), softness: Metres(500.0) };
    let weather = Weather {
        volume: RainVolume { ceiling: Some(ceiling), region: None },
        ..Weather::steady(rate, DVec3::new(0.5, -1.0, 0.0), Seconds(100.0))
    };
    let mut workspace = Workspace::new();
    let count = rain.find(&shot, &weather, None, &mut workspace)?.len();

    let medium = Medium::beside_streaks(&section, &shot, rate)?;
    let light = medium.in_scattering(&world);
    let outlook =
        Outlook { camera: &camera, volume: weather.volume, light: &light, depth: Some(depth.clone()) };
    let mut transmittance = vec![0.0; picture.pixels.len()];
    medium.apply(&outlook, &mut picture, &mut transmittance)?;
    let scene = Scene { depth: Some(depth), kernel: &SmoothWindow, light: &light, gain: number(4, 1.0)? };
    workspace.draw(&shot, &scene, &mut picture)?;
    let mask = workspace.mask();
    let mean = mask.iter().map(|&v| f64::from(v)).sum::<f64>() / mask.len() as f64;
    let most = mask.iter().fold(0.0f32, |a, &b| a.max(b));
    println!("{count} streaks; coverage mean {mean:.5}, largest {most:.3}");
    write_png(path, &picture)
}

/// An 8-bit sRGB picture.
fn write_png(path: &str, picture: &Picture) -> Result<(), Box<dyn std::error::Error>> {
    let encode = |value: f32| {
        let value = f64::from(value.clamp(0.0, 1.0));
        let srgb =
            if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * libm::pow(value, 1.0 / 2.4) - 0.055 };
        (srgb * 255.0 + 0.5) as u8
    };
    let bytes: Vec<u8> = picture.pixels.iter().flatten().map(|&value| encode(value)).collect();
    let file = std::io::BufWriter::new(std::fs::File::create(path)?);
    let mut encoder = png::Encoder::new(file, picture.width as u32, picture.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header()?.write_image_data(&bytes)?;
    Ok(())
}
