//! `cargo bench -p squall-runtime --bench flash -- ASSET [WIDTH HEIGHT]`: what the frames of a flash take beside dark frames.
//!
//! Processor seconds of the whole process, from /proc (skipped elsewhere); hundredths of a second are what that file counts.

use squall_runtime::formats::units::Seconds;
use squall_runtime::{Flash, Frame, StormRenderer};

const FRAMES: usize = 10;

/// Processor seconds of all threads so far.
fn processor_seconds() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let mut fields = text.rsplit(')').next()?.split_whitespace();
    let [user, system] = [fields.nth(11)?, fields.next()?];
    Some((user.parse::<f64>().ok()? + system.parse::<f64>().ok()?) / 100.0)
}

/// Seconds of every frame: the flashes of the asset's view at another brightness each time, or none.
fn frames(renderer: &mut StormRenderer, still: &Frame, lit: bool) -> Option<Vec<f64>> {
    let mut seconds = Vec::new();
    for number in 0..FRAMES {
        let flashes = if lit { still.flashes.clone() } else { Vec::new() };
        let mut frame = still.clone().dark().time(Seconds(number as f64 / 30.0));
        for flash in flashes {
            let brightness = flash.brightness * (1.0 - 0.08 * number as f64);
            frame = frame.flash(Flash { brightness, ..flash });
        }
        let before = processor_seconds()?;
        renderer.render(&frame).unwrap();
        seconds.push(processor_seconds()? - before);
    }
    Some(seconds)
}

fn main() {
    let given: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let usual = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
    let asset = given.first().map_or(usual, String::as_str);
    let side = |at: usize, usual: u32| given.get(at).and_then(|text| text.parse().ok()).unwrap_or(usual);
    let size = [side(1, 640), side(2, 360)];
    for (name, lit) in [("dark", false), ("flash", true)] {
        let mut renderer = StormRenderer::open(asset).unwrap();
        let mut still = renderer.frame().unwrap();
        still.camera = still.camera.resized(size).unwrap();
        let Some(seconds) = frames(&mut renderer, &still, lit) else {
            println!("skipped: no /proc/self/stat");
            return;
        };
        let later = seconds[1..].iter().sum::<f64>() / (FRAMES - 1) as f64;
        println!("{name}: first frame {:.2} CPU-s, frames 2 to {FRAMES} {later:.3} CPU-s each", seconds[0]);
    }
}
