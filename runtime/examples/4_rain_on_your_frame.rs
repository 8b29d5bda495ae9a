//! Rain over a frame of one's own: its colours, its depth.
//!
//! Concept: [`Rain`] finds the drops that a camera's picture shows and [`Medium`] is all rain too far or too fine for that. The
//! picture is linear radiance; the depth is planar, in metres, and may have holes, which the medium leaves alone, or takes
//! from their neighbours as here. The medium goes over the picture first, the streaks over both.
//!
//! Usage: `cargo run --release --example 4_rain_on_your_frame -- [ASSET] [PICTURE.ppm]`

#[path = "shared/files.rs"]
mod files;

use squall_runtime::camera::Intrinsics;
use squall_runtime::density::read_density;
use squall_runtime::depth::{DepthBuffer, DepthHoles, DepthKind};
use squall_runtime::formats::units::{MillimetresPerHour, Seconds};
use squall_runtime::glam::DVec3;
use squall_runtime::medium::{Medium, Outlook};
use squall_runtime::picture::Picture;
use squall_runtime::rain::{Scene, Shot, SmoothWindow, Workspace};
use squall_runtime::tone::Tone;
use squall_runtime::{Asset, Camera, Rain, Weather, WorldLight};
use std::error::Error;
use std::path::Path;

const SIZE: [usize; 2] = [160, 120];

/// Rains on a made-up frame with the tables of `asset`; answers how many pixels had no depth.
pub fn run(asset: &Path, out: &Path) -> Result<usize, Box<dyn Error>> {
    let asset = Asset::open(asset)?;
    let tables = read_density(&asset)?;
    let (mut picture, metres) = your_frame()?;

    // The camera that took the frame, by its calibration.
    let lens = Intrinsics { fx: 120.0, fy: 120.0, cx: 81.5, cy: 59.0 };
    let camera =
        Camera::pinhole(DVec3::new(0.0, 0.0, 1.6), DVec3::Y, DVec3::Z, lens, SIZE.map(|n| n as u32))?;
    let exposure = Seconds(0.008);
    let shot = Shot { min_px: 10.0, ..Shot::new(&camera, exposure) };
    let weather = Weather::steady(MillimetresPerHour(40.0), DVec3::new(2.0, 0.0, 0.0), Seconds(5.0));

    // What light the rain is in: a guess from the frame itself, once per sequence.
    let world = WorldLight::estimate(&picture, &camera);

    let depth = DepthBuffer::new(&metres, SIZE[0], SIZE[1], DepthKind::Planar)?;
    let depth = depth.with_holes(DepthHoles::FillFromNeighbours);
    let medium = Medium::beside_streaks(&tables, &shot, weather.rate)?;
    let light = medium.in_scattering(&world);
    let outlook =
        Outlook { camera: &camera, volume: weather.volume, light: &light, depth: Some(depth.clone()) };
    let mut transmittance = vec![0.0; metres.len()];
    let holes = medium.apply(&outlook, &mut picture, &mut transmittance)?;

    let mut workspace = Workspace::new();
    let streaks = Rain::new(&tables, 1).find(&shot, &weather, None, &mut workspace)?.len();
    let scene = Scene { depth: Some(depth), kernel: &SmoothWindow, light: &light, gain: 1.0 };
    workspace.draw(&shot, &scene, &mut picture)?;

    files::save_ppm(out, &picture, &Tone::default().to_srgb8(&picture))?;
    println!("{}: {streaks} streaks; {holes} pixels had no depth", out.display());
    Ok(holes)
}

/// A wall 12 m away on wet ground under a grey sky; the depth camera saw nothing in a patch of the wall.
fn your_frame() -> Result<(Picture, Vec<f32>), Box<dyn Error>> {
    let [width, height] = SIZE;
    let mut picture = Picture::new(width, height)?;
    let mut metres = vec![f32::INFINITY; width * height];
    for y in 0..height {
        for x in 0..width {
            let (light, far) = match (x, y) {
                (_, 60..) => ([0.08; 3], 1.6 * 120.0 / (y as f32 - 58.5)),
                (40..120, 30..60) => ([0.3, 0.2, 0.15], 12.0),
                _ => ([0.5, 0.55, 0.6], f32::INFINITY),
            };
            let hole = (60..70).contains(&x) && (40..50).contains(&y);
            picture.pixels[y * width + x] = light;
            metres[y * width + x] = if hole { 0.0 } else { far };
        }
    }
    Ok((picture, metres))
}

fn main() -> Result<(), Box<dyn Error>> {
    let [asset, out] = files::arguments("rain.ppm");
    run(&asset, &out).map(|_| ())
}
