//! `squall synth` as a script sees it: files, exit codes, messages.

use assert_cmd::Command;
use std::path::Path;

fn squall(arguments: &[&str]) -> std::process::Output {
    Command::cargo_bin("squall").unwrap().args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn the_same_seed_writes_the_same_files_with_or_without_an_extension() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b.json"] {
        let out = folder.path().join(name);
        let made = squall(&["synth", "cloud", "-o", text(&out), "--kind", "layer", "--seed", "5"]);
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    }
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert_eq!(read("a.f32").len(), 32 * 32 * 4 * 4);
    assert_eq!(read("a.f32"), read("b.f32"));
    let scene: serde_json::Value = serde_json::from_slice(&read("b.json")).unwrap();
    assert_eq!(scene["density_file"], "b.f32");
    assert_eq!(scene["cell_m"], serde_json::json!([50.0, 50.0, 50.0]));
    assert_eq!((&scene["albedo"], &scene["g"]), (&serde_json::json!(0.999), &serde_json::json!(0.85)));
}

#[test]
fn a_storm_goes_where_it_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("storm.json");
    let made = squall(&["synth", "cloud", "-o", text(&out), "--cells", "16x16x16", "--centre", "-400,13000"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let scene: serde_json::Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
    assert_eq!(scene["origin_m"], serde_json::json!([-8800.0, 8200.0, 1400.0]));
}

#[test]
fn streaks_are_made_by_number_and_say_what_fell() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/streaks");
    let made = squall(&["synth", "streaks", "-o", text(&out), "--seed", "48", "--count", "1"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let path = out.join("drop00.png");
    assert_eq!(String::from_utf8_lossy(&made.stdout).trim(), text(&path));
    let reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&path).unwrap())).read_info();
    let reader = reader.unwrap();
    let info = reader.info();
    assert_eq!(
        (info.width, info.color_type, info.bit_depth),
        (32, png::ColorType::Grayscale, png::BitDepth::Sixteen)
    );
    let note = &info.uncompressed_latin1_text[0];
    assert!(note.text.contains("mm in") && note.text.contains("--seed 48, picture 0"), "{}", note.text);
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 1);
}

#[test]
fn mistakes_have_their_exit_codes() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x");
    let code = |arguments: &[&str]| squall(arguments).status.code();
    assert_eq!(code(&["synth", "cloud"]), Some(2), "no output");
    assert_eq!(code(&["synth", "cloud", "-o", text(&out), "--cells", "9x9"]), Some(2));
    assert_eq!(code(&["synth", "cloud", "-o", text(&out), "--cells", "9x9x9"]), Some(3));
    assert_eq!(code(&["synth", "town", "-o", text(folder.path())]), Some(3), "a folder");
    assert_eq!(code(&["synth", "streaks", "-o", text(folder.path()), "--count", "0"]), Some(3));
    assert_eq!(code(&["synth", "streaks"]), Some(2), "no output");
    assert_eq!(code(&["synth", "point-spread", "-o", text(&out), "--photons", "5"]), Some(3));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_strokes_lamps_carry_its_whole_light() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("lamps.json");
    let ends = ["--from", "-10,0,3000", "--to", "500,-300,0"];
    let made = squall(&[&["synth", "stroke", "-o", text(&out), "--intensity", "7e5"][..], &ends].concat());
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let lights: Vec<serde_json::Value> = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
    let sum: f64 = lights.iter().map(|light| light["intensity_W_per_sr"].as_f64().unwrap()).sum();
    // Round-off of some hundred additions.
    assert!((sum / 7e5 - 1.0).abs() < 1e-12 && lights.len() > 50);
    let refused = squall(&["synth", "stroke", "-o", text(&out), "--from", "0,0,0", "--to", "0,0,0"]);
    assert_eq!(refused.status.code(), Some(3));
}

#[test]
fn the_table_of_scattered_light_has_its_size_and_other_bytes_for_another_seed() {
    let folder = tempfile::tempdir().unwrap();
    let made = |name: &str, seed: &str| {
        let out = folder.path().join(name);
        let done = squall(&["synth", "point-spread", "-o", text(&out), "--photons", "320", "--seed", seed]);
        assert_eq!(done.status.code(), Some(0));
        std::fs::read(out).unwrap()
    };
    let one = made("a", "1");
    // Thirteen phase functions, 56 distances, 33 angles, four bytes each.
    assert_eq!(one.len(), 13 * 56 * 33 * 4);
    assert!(one == made("b", "1") && one != made("c", "2"));
}
