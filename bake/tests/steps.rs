//! `squall bake` as a step of a build: no work where nothing changed, dependency files, looks ahead, bounds on what was measured.

use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

const STROKES: &str = "[[strokes]]\nname = \"a\"\nseed = 1\nfrom_m = [-150.0, -60.0, 680.0]\n\
    to_m = [140.0, 80.0, 640.0]\nintensity_W_per_sr = 2.0e6\n";

/// A folder with a small recipe beside the golden cloud: clouds alone, as quick as a bake gets.
pub struct Workplace(tempfile::TempDir);

impl Workplace {
    pub fn new(response: &str) -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1");
        for name in ["cloud.json", "cloud.f32", "town.json", "streak0.png"] {
            std::fs::copy(golden.join(name), place.path(name)).unwrap();
        }
        place.write(response, STROKES);
        place
    }

    pub fn write(&self, response: &str, strokes: &str) {
        let recipe = format!(
            "[clouds]\nscene = \"cloud.json\"\n[clouds.lightning]\nlow_m = [-225.0, -160.0, 300.0]\n\
             high_m = [225.0, 160.0, 720.0]\nspacing_m = 150.0\nlongest_m = 300.0\n[clouds.response]\n{response}\n\
             [rain.density]\nrate_mm_per_h = [1.0, 100.0]\nclasses = 3\nerror = 0.01\n[rain.streaks]\n\
             pictures = [\"streak0.png\"]\ncosines = 1\n[town]\nfile = \"town.json\"\n\
             [view]\nposition_m = [0.0, -400.0, 2.0]\nheading_deg = 90.0\nsize_px = [32, 18]\n{strokes}"
        );
        std::fs::write(self.path("r.toml"), recipe).unwrap();
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Exit code, standard output and standard error of `squall WORDS`, run in this folder.
    pub fn squall(&self, words: &[&str]) -> (i32, String, String) {
        let output = Command::cargo_bin("squall").unwrap().current_dir(self.0.path()).args(words).output();
        let output = output.unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    /// Bakes r.toml to r.squall with more options; it has to go well. What it said.
    #[track_caller]
    pub fn bake(&self, more: &[&str]) -> String {
        let (code, _, said) = self.squall(&[&["bake", "r.toml", "-o", "r.squall"], more].concat());
        assert_eq!(code, 0, "{said}");
        said
    }

    fn written(&self, name: &str) -> SystemTime {
        std::fs::metadata(self.path(name)).unwrap().modified().unwrap()
    }
}

#[test]
fn an_asset_that_is_what_a_bake_would_make_is_left_alone_and_one_that_is_not_is_baked() {
    let place = Workplace::new("test_strokes = 1");
    let said = place.bake(&["--if-changed"]);
    assert!(!said.contains("unchanged"), "{said}");
    let (bytes, written) = (std::fs::read(place.path("r.squall")).unwrap(), place.written("r.squall"));
    let said = place.bake(&["--if-changed"]);
    assert!(said.contains("r.squall: unchanged"), "{said}");
    assert_eq!(place.written("r.squall"), written);

    // Every input, the recipe, the asset itself.
    let changed = |what: &str| {
        let said = place.bake(&["--if-changed"]);
        assert!(!said.contains("unchanged"), "{what}: {said}");
        assert!(place.bake(&["--if-changed"]).contains("unchanged"), "{what}, twice");
    };
    for name in ["cloud.json", "town.json", "r.toml"] {
        let text = std::fs::read_to_string(place.path(name)).unwrap();
        std::fs::write(place.path(name), text + "\n").unwrap();
        changed(name);
    }
    let mut grid = std::fs::read(place.path("cloud.f32")).unwrap();
    grid[..4].copy_from_slice(&0.125f32.to_le_bytes());
    std::fs::write(place.path("cloud.f32"), grid).unwrap();
    changed("cloud.f32");
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/streak1.png");
    std::fs::copy(golden, place.path("streak0.png")).unwrap();
    changed("streak0.png");
    for (what, spoilt) in [("cut", bytes[..bytes.len() - 1].to_vec()), ("other", b"no asset".to_vec()), {
        let mut flipped = bytes.clone();
        let last = flipped.len() - 1;
        flipped[last] ^= 1;
        ("flipped", flipped)
    }] {
        std::fs::write(place.path("r.squall"), spoilt).unwrap();
        changed(what);
    }
    std::fs::remove_file(place.path("r.squall")).unwrap();
    changed("no asset");
}

#[test]
fn an_unchanged_asset_is_still_held_to_bounds_and_its_missing_preview_is_drawn() {
    let place = Workplace::new("test_strokes = 1");
    place.bake(&[]);
    let words = ["bake", "r.toml", "-o", "r.squall", "--if-changed", "--max-error", "stroke_l2=0"];
    let (code, _, said) = place.squall(&words);
    assert!(code == 1 && said.contains("stroke_l2 is"), "{said}");
    let said = place.bake(&["--if-changed", "--preview", "p.png"]);
    assert!(said.contains("unchanged") && said.contains("p.png: 32 × 18"), "{said}");
    let said = place.bake(&["--if-changed", "--preview", "p.png"]);
    assert!(!said.contains("p.png: 32 × 18"), "{said}");
}

#[test]
fn make_reads_the_dependency_file_whatever_the_names() {
    let place = Workplace::new("test_strokes = 0");
    let folder = "a b#c$d";
    std::fs::create_dir(place.path(folder)).unwrap();
    for name in ["cloud.json", "cloud.f32", "town.json", "streak0.png", "r.toml"] {
        std::fs::copy(place.path(name), place.path(folder).join(name)).unwrap();
    }
    let (recipe, out) = (format!("{folder}/r.toml"), format!("{folder}/out.squall"));
    let (code, _, said) = place.squall(&["bake", &recipe, "-o", &out, "--depfile", "r.d"]);
    assert_eq!(code, 0, "{said}");
    let rule = std::fs::read_to_string(place.path("r.d")).unwrap();
    let names: Vec<&str> = rule.split(" \\\n  ").map(str::trim_end).collect();
    let wanted = ["out.squall:", "r.toml", "town.json", "streak0.png", "cloud.json", "cloud.f32"];
    assert_eq!(names, wanted.map(|name| format!("a\\ b\\#c$$d/{name}")));

    if std::process::Command::new("make").arg("--version").output().is_err() {
        println!("skipped: no make");
        return;
    }
    let makefile = "include r.d\na\\ b\\#c$$d/out.squall:\n\t@echo baked\n";
    std::fs::write(place.path("Makefile"), makefile).unwrap();
    let make = |what: &str| {
        let out = format!("{folder}/{what}");
        let output =
            std::process::Command::new("make").current_dir(place.0.path()).arg(out).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let later = |seconds| SystemTime::now() + std::time::Duration::from_secs(seconds);
    let touch = |name: &str, seconds| {
        let file = std::fs::File::options().append(true).open(place.path(folder).join(name)).unwrap();
        file.set_modified(later(seconds)).unwrap();
    };
    touch("out.squall", 10);
    assert!(make("out.squall").contains("up to date"));
    for name in ["r.toml", "town.json", "streak0.png", "cloud.json", "cloud.f32"] {
        touch(name, 20);
        assert_eq!(make("out.squall"), "baked\n", "{name}");
        touch(name, 0);
    }
}

#[test]
fn a_check_reads_everything_and_a_dry_run_foresees_the_work_and_neither_bakes() {
    let place = Workplace::new("test_strokes = 2");
    let before = std::fs::read_dir(place.0.path()).unwrap().count();
    let (code, out, said) = place.squall(&["bake", "r.toml", "--check"]);
    assert!(code == 0 && out.is_empty() && said.contains("r.toml: sound, with 4 inputs"), "{said}");
    let (code, out, said) = place.squall(&["bake", "r.toml", "--dry-run"]);
    assert!(code == 0 && said.is_empty(), "{said}");
    for words in
        ["9 × 8 × 4 cells", "64 of 4 × 4 × 4 virtual lights", "2 held-out strokes", "s of processor time"]
    {
        assert!(out.contains(words), "{words}: {out}");
    }
    let (_, out, _) = place.squall(&["bake", "r.toml", "--dry-run", "--json"]);
    let json: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(json["estimate"]["clouds"]["virtual_lights"], 64);
    assert!(json["estimate"]["memory_bytes"].as_u64().unwrap() > 1 << 20);
    assert_eq!(std::fs::read_dir(place.0.path()).unwrap().count(), before);
    // Each input that is not what it should be.
    for (name, bytes) in [("cloud.f32", &b"short"[..]), ("town.json", b"{}"), ("streak0.png", b"no picture")]
    {
        let good = std::fs::read(place.path(name)).unwrap();
        std::fs::write(place.path(name), bytes).unwrap();
        for mode in ["--check", "--dry-run"] {
            let (code, _, said) = place.squall(&["bake", "r.toml", mode]);
            assert!(code == 3 && said.contains(name), "{name} {mode}: {code} {said}");
        }
        std::fs::write(place.path(name), good).unwrap();
    }
}

#[test]
fn a_figure_above_its_bound_ends_the_bake_with_1_and_leaves_what_was_there() {
    let place = Workplace::new("test_strokes = 1");
    std::fs::write(place.path("r.squall"), b"old").unwrap();
    let bake = |bounds: &[&str]| {
        let bounds: Vec<&str> = bounds.iter().flat_map(|bound| ["--max-error", bound]).collect();
        place.squall(&[&["bake", "r.toml", "-o", "r.squall"], &bounds[..]].concat())
    };
    let (code, _, said) = bake(&["stroke_l2=1e-6", "residual=0.5", "relit_l2=1e-9"]);
    assert_eq!(code, 1, "{said}");
    assert!(said.contains("stroke_l2 is") && said.contains("relit_l2 is"), "{said}");
    assert!(!said.contains("residual is"), "{said}");
    assert_eq!(std::fs::read(place.path("r.squall")).unwrap(), b"old");
    let (code, _, said) = bake(&["stroke=0.3"]);
    assert_eq!(code, 2, "{said}");
    assert!(squall_bake::metrics::METRICS.iter().all(|metric| said.contains(metric.name)), "{said}");
    let (code, _, said) = bake(&["solver_l2=0.3"]);
    assert!(code == 1 && said.contains("was not measured"), "{said}");
    let (code, _, said) = bake(&["stroke_l2=10", "asset_bytes=1e9", "streak_rms=1", "density_error=0.02"]);
    assert_eq!(code, 0, "{said}");
}

#[test]
fn every_metric_of_a_full_bake_is_found_under_its_name() {
    // With what other bakes do not measure: a budget of the solver, suns, and light on blocks of cells.
    let place = Workplace::new("test_strokes = 1\nsun = \"anywhere\"\ncells = [3, 4, 2]");
    let recipe = std::fs::read_to_string(place.path("r.toml")).unwrap();
    std::fs::write(place.path("r.toml"), recipe + "[clouds.budget]\nsolver_l2 = 0.5\n").unwrap();
    let (code, out, said) = place.squall(&["bake", "r.toml", "-o", "r.squall", "--json", "--quiet"]);
    assert_eq!(code, 0, "{said}");
    let json: Value = serde_json::from_str(&out).unwrap();
    for metric in squall_bake::metrics::METRICS {
        assert!(json["metrics"][metric.name].is_number(), "{}: {out}", metric.name);
    }
}

#[test]
fn a_stroke_error_that_is_large_or_not_measured_is_warned_of_even_to_the_quiet() {
    let place = Workplace::new("test_strokes = 0");
    let said = place.bake(&["--quiet"]);
    assert!(said.starts_with("warning: the stroke error was not measured; test_strokes above 0"), "{said}");
    place.write("basis = \"harmonics-0\"\ntest_strokes = 2", STROKES);
    // Virtual lights at the corners of the cloud alone.
    let recipe = std::fs::read_to_string(place.path("r.toml")).unwrap();
    let coarse =
        recipe.replace("spacing_m = 150.0\nlongest_m = 300.0", "spacing_m = 450.0\nlongest_m = 450.0");
    std::fs::write(place.path("r.toml"), coarse).unwrap();
    let said = place.bake(&["--quiet"]);
    assert!(said.contains("warning: the measured stroke error of") && said.contains("spacing_m"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[test]
fn options_that_do_not_go_together_are_bad_usage() {
    let place = Workplace::new("test_strokes = 0");
    for words in [
        &["bake", "r.toml"][..],
        &["bake", "r.toml", "-o", "-", "--json"],
        &["bake", "r.toml", "-o", "-", "--if-changed"],
        &["bake", "r.toml", "-o", "-", "--depfile", "r.d"],
        &["bake", "r.toml", "--check", "--dry-run"],
        &["bake", "r.toml", "-o", "r.squall", "--check", "--if-changed"],
        &["bake", "r.toml", "-o", "r.squall", "--cache", "c", "--no-cache"],
        &["bake", "r.toml", "-o", "r.squall", "--max-error", "stroke_l2"],
        &["render", "r.squall", "-o", "-", "--json"],
        &["synth", "town", "-o", "-", "--json"],
    ] {
        let (code, out, said) = place.squall(words);
        assert!(code == 2 && out.is_empty(), "{words:?}: {code} {said}");
    }
    // An output that would replace an input.
    let (code, _, said) = place.squall(&["bake", "r.toml", "-o", "r.squall", "--depfile", "town.json"]);
    assert_eq!(code, 3, "{said}");
}
