//! The program of README.md, "In your own program": a test holds the two against each other.
//!
//! Usage: `cargo run --release --example readme -- [ASSET] [PICTURE.ppm]`

#[path = "shared/files.rs"]
mod files;

use squall_runtime::{Camera, StormRenderer, Stroke, formats::units::Degrees, glam::DVec3};
use std::error::Error;
use std::path::Path;

/// Draws `asset` with a camera and a stroke of its own and saves `out`.
pub fn run(asset: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let mut renderer = StormRenderer::open(asset)?;
    let clouds = renderer.clouds().ok_or("no cloud")?;
    let place = clouds.nearest_lit(DVec3::new(0.0, 12e3, 4e3)).ok_or("no light")?;
    let camera = Camera::look_at(DVec3::new(0.0, 0.0, 2.0), place, Degrees(60.0), [640, 360])?;
    let stroke = Stroke::from_points(&[place], 2e7, [0.80, 0.75, 1.28])?;
    let frame = renderer.frame_from(camera).flash(stroke);
    renderer.render(&frame)?;
    let pixels = renderer.tone().to_srgb8(renderer.picture());
    std::fs::write(out, [b"P6 640 360 255\n".as_slice(), pixels.as_flattened()].concat())?;
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let [asset, out] = files::arguments("storm.ppm");
    run(&asset, &out)
}
