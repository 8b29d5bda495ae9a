//! A picture with a camera and a stroke of one's own.
//!
//! Concept: a [`Frame`] takes any [`Camera`] and any [`Stroke`], in the weather and under the sky of the asset's own view. A
//! stroke may stand where the asset's virtual point lights were baked; anywhere else with feature `live`.
//!
//! Usage: `cargo run --release --example 2_own_camera_own_stroke [--features live] -- [ASSET] [PICTURE.ppm]`
//!
//! [`Frame`]: squall_runtime::Frame

#[path = "shared/files.rs"]
mod files;

use squall_runtime::{Camera, Clouds, StormRenderer, Stroke, formats::units::Degrees, glam::DVec3};
use std::error::Error;
use std::path::Path;

/// Draws `asset` from the ground south of its cloud, with a stroke of its own across the middle of where light was baked.
pub fn run(asset: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let mut renderer = StormRenderer::open(asset)?;
    let [from, to] = ends(renderer.clouds().ok_or("the asset has no cloud")?);
    let eye = DVec3::new(from.x, from.y - 1500.0, 2.0);
    let camera = Camera::look_at(eye, 0.5 * (from + to), Degrees(60.0), [160, 90])?;
    let stroke = Stroke::between(from, to, 7, 2e6)?.colored([0.8, 0.75, 1.28]);
    let frame = renderer.frame_from(camera).flash(stroke);
    renderer.render(&frame)?;
    let pixels = renderer.tone().to_srgb8(renderer.picture());
    files::save_ppm(out, renderer.picture(), &pixels)?;
    println!("{}: a stroke from {from} to {to} m", out.display());
    Ok(())
}

/// Two points near the middle of the box of virtual point lights, each where light was baked.
fn ends(clouds: &Clouds) -> [DVec3; 2] {
    let [low, high] = clouds.bounds();
    [0.35, 0.65].map(|share| {
        let wanted = low + (high - low) * share;
        clouds.nearest_lit(wanted).unwrap_or(wanted)
    })
}

fn main() -> Result<(), Box<dyn Error>> {
    let [asset, out] = files::arguments("own.ppm");
    run(&asset, &out)
}
