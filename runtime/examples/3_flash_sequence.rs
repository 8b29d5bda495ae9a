//! A flash, frame by frame.
//!
//! Concept: light is linear. The first frame of a flash works out what its strokes do to the cloud; while strokes and viewer stand
//! still, later frames scale that by each stroke's brightness and cost what dark frames cost. Rain falls on as time goes on.
//!
//! Usage: `cargo run --release --example 3_flash_sequence -- [ASSET] [FOLDER]`

#[path = "shared/files.rs"]
mod files;

use squall_runtime::{Flash, StormRenderer, formats::units::Seconds};
use std::error::Error;
use std::path::Path;

/// Two return strokes in a third of a second, and what each frame of 1/30 s sees of them.
const BRIGHTNESS: [f64; 10] = [0.2, 1.0, 0.5, 0.2, 0.1, 0.8, 0.4, 0.15, 0.05, 0.0];
const FRAME_S: f64 = 1.0 / 30.0;

/// Draws ten frames of a flash of all of `asset`'s strokes into `folder`; answers each frame's seconds.
pub fn run(asset: &Path, folder: &Path) -> Result<Vec<f64>, Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    let mut renderer = StormRenderer::open(asset)?;
    let tone = renderer.tone();
    let still = renderer.frame().ok_or("the asset brings no view")?.dark();
    let strokes: Vec<String> = renderer.strokes().iter().map(|stroke| stroke.name.clone()).collect();
    let start = still.weather.time.0;
    let mut seconds = Vec::new();
    for (number, brightness) in BRIGHTNESS.into_iter().enumerate() {
        let mut frame = still.clone().time(Seconds(start + number as f64 * FRAME_S));
        for stroke in &strokes {
            frame = frame.flash(Flash::named(stroke).brightness(brightness));
        }
        let clock = std::time::Instant::now();
        renderer.render(&frame)?;
        seconds.push(clock.elapsed().as_secs_f64());
        let pixels = tone.to_srgb8(renderer.picture());
        files::save_ppm(&folder.join(format!("flash{number}.ppm")), renderer.picture(), &pixels)?;
        let kept = renderer.report().strokes_kept;
        println!(
            "frame {number}: brightness {brightness}, {kept} strokes' light kept, {:.3} s",
            seconds[number]
        );
    }
    Ok(seconds)
}

fn main() -> Result<(), Box<dyn Error>> {
    let [asset, out] = files::arguments("flash");
    run(&asset, &out).map(|_| ())
}
