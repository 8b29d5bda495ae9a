//! A picture of an asset's own view.
//!
//! Concept: a [`StormRenderer`] holds the asset; the frame that its author wrote comes from [`StormRenderer::frame`]; what
//! `render` answers is linear radiance, which [`StormRenderer::tone`] develops for a display.
//!
//! Usage: `cargo run --release --example 1_picture -- [ASSET] [PICTURE.ppm]`

#[path = "shared/files.rs"]
mod files;

use squall_runtime::StormRenderer;
use std::error::Error;
use std::path::Path;

/// Draws `asset`'s view and saves it as `out`, a binary portable pixmap.
pub fn run(asset: &Path, out: &Path) -> Result<(), Box<dyn Error>> {
    let mut renderer = StormRenderer::open(asset)?;
    let frame = renderer.frame().ok_or("the asset brings no view")?;
    renderer.render(&frame)?;
    let pixels = renderer.tone().to_srgb8(renderer.picture());
    files::save_ppm(out, renderer.picture(), &pixels)?;
    let report = renderer.report();
    println!("{}: {} points of lightning, {} streaks", out.display(), report.lights, report.streaks);
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let [asset, out] = files::arguments("picture.ppm");
    run(&asset, &out)
}
