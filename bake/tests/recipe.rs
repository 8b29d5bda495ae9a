//! Recipes that are wrong: one clear error with its place, exit code 3, nothing written.

use assert_cmd::Command;
use std::path::Path;

const SCENE: &str = r#"{"dims_xyz": [2, 2, 2], "cell_m": 100.0, "origin_m": [0, 0, 0],
    "density_file": "cloud.f32", "kappa_per_m": 0.01, "albedo": 0.9, "g": 0.5}"#;
const CLOUD: &str = "[clouds]\nscene = \"cloud.json\"\n";
const STROKE: &str = "[[strokes]]\nname = \"a\"\nseed = 1\nfrom_m = [0.0, 0.0, 100.0]\n\
    to_m = [100.0, 100.0, 100.0]\nintensity_W_per_sr = 1.0\n";
const VIEW: &str = "[view]\nposition_m = [0.0, -300.0, 0.0]\nheading_deg = 90.0\n";

fn write_inputs(folder: &Path) {
    std::fs::write(folder.join("cloud.json"), SCENE).unwrap();
    std::fs::write(folder.join("cloud.f32"), [0u8; 32]).unwrap();
}

/// Bakes `recipe` beside sound inputs; the exit code and what it said.
fn bake(folder: &Path, recipe: &str) -> (Option<i32>, String) {
    std::fs::write(folder.join("r.toml"), recipe).unwrap();
    let run = Command::cargo_bin("squall")
        .unwrap()
        .current_dir(folder)
        .args(["bake", "r.toml", "-o", "r.squall"])
        .output();
    let run = run.unwrap();
    (run.status.code(), String::from_utf8_lossy(&run.stderr).into_owned())
}

fn refused(recipe: &str, words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    write_inputs(folder.path());
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    let (code, said) = bake(folder.path(), recipe);
    assert_eq!(code, Some(3), "{said}");
    for word in words {
        assert!(said.contains(word), "no `{word}` in: {said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before + 1, "only the recipe came");
}

#[test]
fn a_typo_is_answered_with_the_nearest_key_and_its_place() {
    refused(
        &format!("{CLOUD}[clouds.response]\nchanels = \"harmonics-1\"\n"),
        &["r.toml:4:1", "chanels", "channels"],
    );
    refused(&format!("{STROKE}[veiw]\n"), &["veiw", "view"]);
}

#[test]
fn a_wrong_unit_is_an_unknown_key() {
    refused("[rain.density]\nexposure_s = [0.001, 0.03]\n", &["r.toml:2:1", "exposure_s", "exposure_ms"]);
    refused(&format!("{VIEW}pitch_rad = 0.3\n{STROKE}"), &["pitch_rad", "pitch_deg"]);
}

#[test]
fn absurd_numbers_are_refused_where_they_stand() {
    refused(&format!("{CLOUD}albedo = 1.5\n"), &["r.toml:3:10", "albedo", "0 to 1", "1.5"]);
    refused(&format!("{CLOUD}g = 1.0\n"), &["r.toml:3:5", "g"]);
    refused(&format!("{CLOUD}g = -1.0\n"), &["g"]);
    refused("[rain.density]\nrate_mm_per_h = [200.0, 0.1]\n", &["r.toml:2:17", "rising"]);
    for value in ["0.0", "0.6", "nan"] {
        let words = ["r.toml:2:15", "rain.density.class_error", "0.001 to 0.5"];
        refused(&format!("[rain.density]\nclass_error = {value}\n"), &words);
    }
    refused(&format!("{STROKE}turn_deg = 400.0\n"), &["r.toml:7:12", "turn_deg", "400.0"]);
    refused(
        &format!("{VIEW}vertical_fov_deg = 200.0\n{STROKE}"),
        &["r.toml:4:20", "vertical_fov_deg", "200.0"],
    );
    refused(&format!("{VIEW}[view.rain]\nrate_mm_per_h = 1e9\n{STROKE}"), &["r.toml:5:17", "rate_mm_per_h"]);
    refused(&format!("{VIEW}size_px = [0, 720]\n{STROKE}"), &["size_px"]);
    refused(&format!("{CLOUD}[clouds.lightning]\nspacing_m = 0.001\n"), &["clouds.lightning.spacing_m"]);
}

#[test]
fn names_that_lead_nowhere_are_refused() {
    refused("[clouds]\nscene = \"nowhere.json\"\n", &["r.toml:2:9", "nowhere.json"]);
    refused(&format!("{VIEW}flashes = [\"b\"]\n{STROKE}"), &["r.toml:4:12", "view.flashes", "`b`", "a"]);
    refused(&format!("{STROKE}{STROKE}"), &["each name once"]);
    refused("", &["at least one of"]);
}

#[test]
fn grids_that_are_missing_empty_cut_or_no_numbers_are_refused() {
    let check = |bytes: Option<&[u8]>, words: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        write_inputs(folder.path());
        match bytes {
            Some(bytes) => std::fs::write(folder.path().join("cloud.f32"), bytes).unwrap(),
            None => std::fs::remove_file(folder.path().join("cloud.f32")).unwrap(),
        }
        let (code, said) = bake(folder.path(), CLOUD);
        assert_eq!(code, Some(3), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{words:?} in: {said}");
        assert!(!folder.path().join("r.squall").exists());
    };
    let grid = |last: f32| -> Vec<u8> {
        [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, last].iter().flat_map(|v: &f32| v.to_le_bytes()).collect()
    };
    check(None, &["cloud.f32"]);
    check(Some(&[]), &["cloud.f32", "32"]);
    check(Some(&grid(0.5)[..31]), &["cloud.f32", "31"]);
    check(Some(&grid(f32::NAN)), &["cloud.f32"]);
    check(Some(&grid(-0.1)), &["cloud.f32"]);
}

#[test]
fn air_costs_next_to_nothing_by_default_and_the_papers_layout_has_every_cell() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    // One cloudy cell in 12 × 12 × 6.
    let (cells, cloudy) = (12 * 12 * 6, 3 * 144 + 6 * 12 + 6);
    let grid: Vec<u8> = (0..cells).flat_map(|at| f32::from(u8::from(at == cloudy)).to_le_bytes()).collect();
    std::fs::write(path.join("cloud.f32"), grid).unwrap();
    std::fs::write(path.join("cloud.json"), SCENE.replace("[2, 2, 2]", "[12, 12, 6]")).unwrap();
    let bytes = |keys: &str| {
        let recipe = format!(
            "{CLOUD}[clouds.lightning]\nspacing_m = 300.0\n[clouds.response]\ntest_strokes = 0\n{keys}"
        );
        let (code, said) = bake(path, &recipe);
        assert_eq!(code, Some(0), "{said}");
        std::fs::metadata(path.join("r.squall")).unwrap().len()
    };
    let plain = bytes("codec = \"bytes\"\n");
    assert_eq!(plain, bytes("codec = \"bytes\"\nseen_only = true\n"));
    // 27 of 864 cells are read: a tenth of the bytes, heads included.
    assert!(10 * plain < bytes("codec = \"bytes\"\nseen_only = false\n"), "{plain}");
    assert_eq!(bytes(""), bytes("codec = \"entropy\"\nseen_only = true\n"));
    let paper = bytes("codec = \"paper\"\n");
    assert_eq!(paper, bytes("codec = \"paper\"\nseen_only = false\n"));
}
