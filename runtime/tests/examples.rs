//! Every example runs on a small asset, and README's program is one of them.
// Each example is a program: its `main` is not called here, and each brings its own copy of what they share.
#![allow(dead_code, clippy::duplicate_mod)]

#[path = "../examples/2_own_camera_own_stroke.rs"]
mod camera_and_stroke;
#[path = "../examples/3_flash_sequence.rs"]
mod flash_sequence;
#[path = "../examples/5_light_per_cell.rs"]
mod light_per_cell;
#[path = "../examples/1_picture.rs"]
mod picture;
#[path = "../examples/4_rain_on_your_frame.rs"]
mod rain_on_your_frame;
#[path = "../examples/readme.rs"]
mod readme;

use std::path::{Path, PathBuf};

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(name)
}

fn asset() -> PathBuf {
    file("data/golden/v1/golden.squall")
}

/// A file in the tests' own folder.
fn out(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// Fails unless `path` is a pixmap of this size that is not all black.
#[track_caller]
fn check_picture(path: &Path, [width, height]: [usize; 2]) {
    let bytes = std::fs::read(path).unwrap();
    let head = format!("P6 {width} {height} 255\n");
    assert!(bytes.starts_with(head.as_bytes()), "{}", path.display());
    let pixels = &bytes[head.len()..];
    assert_eq!(pixels.len(), 3 * width * height);
    assert!(pixels.iter().any(|&value| value > 0), "{} is black", path.display());
}

#[test]
fn a_picture_of_the_assets_view_is_saved() {
    picture::run(&asset(), &out("picture.ppm")).unwrap();
    check_picture(&out("picture.ppm"), [64, 36]);
}

#[test]
fn a_picture_with_an_own_camera_and_stroke_is_saved() {
    camera_and_stroke::run(&asset(), &out("own.ppm")).unwrap();
    check_picture(&out("own.ppm"), [160, 90]);
}

#[test]
fn a_flash_is_drawn_frame_by_frame() {
    assert_eq!(flash_sequence::run(&asset(), &out("flash")).unwrap().len(), 10);
    for number in 0..10 {
        check_picture(&out("flash").join(format!("flash{number}.ppm")), [64, 36]);
    }
}

#[test]
fn rain_falls_on_an_own_frame_whose_depth_has_holes() {
    assert_eq!(rain_on_your_frame::run(&asset(), &out("rain.ppm")).unwrap(), 100);
    check_picture(&out("rain.ppm"), [160, 120]);
}

#[test]
fn light_per_cell_goes_into_a_texture_of_the_grids_size() {
    light_per_cell::run(&asset(), &out("light.ktx2")).unwrap();
    let bytes = std::fs::read(out("light.ktx2")).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let long = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    assert!(bytes.starts_with(b"\xABKTX 20\xBB\r\n\x1A\n"));
    assert_eq!([word(12), word(16), word(20), word(24), word(28)], [97, 2, 9, 8, 4]);
    assert_eq!((long(88), long(80) + long(88)), (9 * 8 * 4 * 8, bytes.len()));
    // The descriptor says its own length and lies where the head says.
    assert_eq!((word(word(48)), word(52)), (word(52), 92));
    let texels = &bytes[long(80)..];
    assert!(texels.chunks_exact(8).any(|texel| texel[..2] != [0, 0]), "no red light");
}

#[test]
fn readmes_program_is_the_example_that_saves_a_picture() {
    readme::run(&asset(), &out("readme.ppm")).unwrap();
    check_picture(&out("readme.ppm"), [640, 360]);
    let text = std::fs::read_to_string(file("README.md")).unwrap();
    let code = text.split("```rust\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let source = std::fs::read_to_string(file("runtime/examples/readme.rs")).unwrap();
    let lines: Vec<&str> = source.lines().map(str::trim).collect();
    let mut at = 0;
    for line in code.lines().map(str::trim).filter(|line| !line.is_empty()) {
        let line = line.replace("\"storm.squall\"", "asset").replace("\"storm.ppm\"", "out");
        let found = lines[at..].iter().position(|own| *own == line);
        at += 1 + found.unwrap_or_else(|| panic!("README's line is not in the example: {line}"));
    }
    assert!(at > 0, "README has no program");
}

#[cfg(not(feature = "live"))]
#[test]
fn without_live_solves_a_stroke_beyond_the_light_grid_is_refused_with_the_reason() {
    use squall_runtime::{Asset, Clouds, relight::PointLight};
    let mut clouds = Clouds::new(&Asset::open(asset()).unwrap()).unwrap();
    let [_, high] = clouds.bounds();
    let light = PointLight { position: 2.0 * high, intensity: 1.0 };
    let text = clouds.light(&[light]).err().unwrap().to_string();
    assert!(text.contains("outside") && text.contains("Feature `live`"), "{text}");
}
