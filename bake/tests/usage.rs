//! What the command line refuses before any work, and that it destroys none of what it reads.

use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Width and height of the pictures here, px.
const SIZE: [u32; 2] = [12, 40];

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A grey picture of a streak, moved down by `shift` px.
    fn streak(&self, name: &str, shift: u32) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        let file = std::fs::File::create(self.path(name)).unwrap();
        let mut encoder = png::Encoder::new(file, SIZE[0], SIZE[1]);
        encoder.set_color(png::ColorType::Grayscale);
        let light = |i: u32| {
            let (x, y) = (i % SIZE[0], i / SIZE[0]);
            if (4..8).contains(&x) && (5 + shift..25 + shift).contains(&y) { 200 } else { 10 }
        };
        let bytes: Vec<u8> = (0..SIZE[0] * SIZE[1]).map(light).collect();
        encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    }

    fn squall(&self, words: &str) -> (i32, String, String) {
        let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
        let mut call = Command::cargo_bin("squall").unwrap();
        let words = words.split_whitespace().map(|word| word.replace("ASSET", golden));
        let output = call.current_dir(self.folder.path()).args(words).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }

    #[track_caller]
    fn refused(&self, words: &str, code: i32, because: &str) {
        let (found, _, said) = self.squall(words);
        assert!(found == code && said.contains(because), "{words}: {found} {said}");
    }

    #[track_caller]
    fn done(&self, words: &str) -> (String, String) {
        let (code, out, said) = self.squall(words);
        assert_eq!(code, 0, "{words}: {said}");
        (out, said)
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }
}

#[test]
fn no_output_of_streaks_replaces_a_picture_that_is_read() {
    let place = Place::new();
    (0..3).for_each(|at| place.streak(&format!("ex/streak{at:02}.png"), 2 * at));
    let before: Vec<Vec<u8>> = (0..3).map(|at| place.bytes(&format!("ex/streak{at:02}.png"))).collect();
    let same = "wanted a file that is not read";
    place.refused("streaks fit ex/streak00.png --cosines 1 --preview ex/../ex/streak00.png", 3, same);
    place.refused("streaks extract ex -o ex", 3, same);
    place.refused("streaks extract ex -o out --preview ex/streak01.png", 3, same);
    place.refused("streaks extract ex -o out --preview out/streak00.png", 3, "a file of its own");
    let after: Vec<Vec<u8>> = (0..3).map(|at| place.bytes(&format!("ex/streak{at:02}.png"))).collect();
    assert!(before == after && !place.path("out").exists());
}

#[test]
fn a_preview_of_streaks_is_tried_before_the_fit_and_is_a_png() {
    let place = Place::new();
    place.streak("a.png", 0);
    place.refused("streaks fit a.png --preview none/x.png", 3, "none/x.png");
    place.refused("streaks fit a.png --preview x.exr", 3, "ends in .png");
    place.refused("streaks fit a.png --cosines 65", 2, "--cosines");
}

#[test]
fn a_bad_value_of_an_option_is_bad_usage_that_names_the_option() {
    let place = Place::new();
    let rain = "rain c.png --depth d.npy -o r.png";
    for (words, option) in [
        ("render ASSET -o a.png --size 64 36 --size 2 2", "--size"),
        ("render ASSET -o a.png --size 0 9", "--size"),
        ("render ASSET -o a.png --rate -1", "--rate"),
        ("render ASSET -o a.png --report - --json", "--json prints to standard output"),
        ("render ASSET -o - --report -", "standard output takes one output"),
        ("render ASSET -o a.png --fov 0", "--fov"),
        ("render ASSET -o a.png --g 1", "--g"),
        ("render ASSET -o a.png --exposure-ms -5", "--exposure-ms"),
        ("render ASSET -o a.png --sun-irradiance nan", "--sun-irradiance"),
        ("render ASSET -o a.png --sun-irradiance 1,2", "--sun-irradiance"),
        ("render ASSET -o a##.png --frames 0..2 --fps 1e9", "a million at most"),
        ("render ASSET -o a##.png --frames -2..1 --fps 1", "two whole numbers"),
        ("render ASSET -o a##.png --frames 0..2 --fps 9 --flash-at nan", "--flash-at"),
        ("render ASSET -o a.exr --stops 1", "--stops"),
        ("render ASSET -o a.png --flash none --flash root", "--flash none"),
        ("render ASSET -o a.png --flash root --flash root", "--flash root"),
        ("render ASSET -o a.exr --layers depth,depth", "depth twice"),
        (&format!("{rain} --vertical-fov 0"), "--vertical-fov"),
        (&format!("{rain} --vertical-fov 60 --depth-scale 0 --rate 5"), "--depth-scale"),
        (&format!("{rain} --vertical-fov 60 --rate -1"), "--rate"),
        (&format!("{rain} --vertical-fov 60 --rate 5 --gain 1e9"), "--gain"),
        (&format!("{rain} --vertical-fov 60 --rate 5 --wind 1000,0,0"), "--wind"),
        (&format!("{rain} --vertical-fov 60 --rate 5 --baseline 1"), "--baseline"),
        (&format!("{rain} --vertical-fov 60 --rate 5 --pose-up -y"), "--pose"),
        (&format!("{rain} --intrinsics -525,1,1,1 --rate 5"), "FX and FY above 0"),
        (&format!("{rain} --rate 5"), "--vertical-fov"),
        ("relight ASSET --lamps l.json -o a.png", "--view"),
        ("export ASSET --density --viewer -5,0,0 -o e.npy", "--viewer"),
        ("export ASSET --light crown,crown -o e.npy", "every stroke once"),
        ("solve s.json --lamp a -o s --max-sweeps 0", "--max-sweeps"),
        ("query ASSET density --rate 5 --min-px -1", "--min-px"),
    ] {
        place.refused(words, 2, option);
    }
    assert_eq!(place.folder.path().read_dir().unwrap().count(), 0, "nothing was written");
}

#[test]
fn what_an_asset_cannot_do_is_told_in_the_options_own_words_before_the_work() {
    let place = Place::new();
    place.refused("render ASSET -o a.png --rate 1e4", 3, "--rate: wanted 0 to");
    place.refused("render ASSET -o big.png --layers beauty", 3, "ends in .exr");
    place.refused("render ASSET -o frames/a.##.txt --frames 0..1 --fps 1", 3, "ends in .png");
    place.refused("rain rgb/*.png --depth d --vertical-fov 60 --rate 5 -o o5", 3, "rgb/*.png: cannot read");
    assert_eq!(place.folder.path().read_dir().unwrap().count(), 0, "nothing was written");
}

#[test]
fn numbers_below_zero_stand_behind_every_option_of_numbers() {
    let place = Place::new();
    place.done("export ASSET --light inside --viewer -50,0,0 -o e.npy");
    place.refused(
        "rain c.png --depth d --vertical-fov 9 --rate 5 --wind -3,0,0 -o r.png",
        3,
        "c.png: cannot read",
    );
}

#[test]
fn one_file_goes_to_standard_output_whatever_its_form() {
    let place = Place::new();
    let (code, _, said) = place.squall("export ASSET --density -o -");
    assert!(code == 3 && said.contains("--format"), "{said}");
    let output = |words: &[&str]| {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.squall");
        let [command, more @ ..] = words else { panic!() };
        let mut call = Command::cargo_bin("squall").unwrap();
        let output = call.arg(command).arg(golden).args(more).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output
    };
    let found = output(&["export", "--density", "-o", "-", "--format", "npy", "--quiet"]);
    assert!(found.stdout.starts_with(b"\x93NUMPY") && found.stderr.is_empty());
    let exr = ["render", "--size", "8", "4", "--layers", "depth", "--format", "exr", "-o", "-"];
    assert_eq!(output(&exr).stdout[..4], [0x76, 0x2f, 0x31, 0x01]);
}

#[test]
fn commands_that_make_files_are_quiet_where_that_is_asked_for() {
    let place = Place::new();
    place.streak("a.png", 0);
    for words in [
        "export ASSET --density -o e.vdb --quiet --threads 1",
        "synth stroke -o l.json --from 0,0,1 --to -1,0,0 --quiet --threads 1",
    ] {
        assert_eq!(place.done(words), (String::new(), String::new()), "{words}");
    }
    assert_eq!(place.done("streaks fit a.png --cosines 1 --quiet --threads 1").1, "");
}

#[test]
fn a_view_may_stand_in_a_whole_recipe() {
    let place = Place::new();
    let recipe = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml");
    place.done(&format!("render ASSET --scene {} --size 8 4 -o a.png", recipe.display()));
}

#[test]
fn a_picture_of_more_rain_than_the_recipes_tables_hold_is_refused_with_its_place() {
    let place = Place::new();
    let text = "[rain]\n[rain.density]\nrate_mm_per_h = [1, 50]\n\
                [view]\nposition_m = [0, 0, 2]\nheading_deg = 0\n[view.rain]\nrate_mm_per_h = ";
    std::fs::write(place.path("r.toml"), format!("{text}60\n")).unwrap();
    for words in ["bake r.toml --check", "bake r.toml -o r.squall"] {
        place.refused(words, 3, "r.toml:8:17: view.rain.rate_mm_per_h: wanted 0 to 50 mm/h");
    }
    std::fs::write(place.path("r.toml"), format!("{text}50\n")).unwrap();
    place.done("bake r.toml --check");
}

#[test]
fn frames_of_other_settings_are_drawn_again_and_that_is_said() {
    let place = Place::new();
    let words = "render ASSET --size 16 9 --quality preview --frames 0..2 --fps 10 --json -o new/f.##";
    for form in ["png", "exr"] {
        let kept = |more: &str| {
            let (out, said) = place.done(&format!("{words}.{form} {more}"));
            (serde_json::from_str::<Value>(&out).unwrap()["kept"].as_u64(), said)
        };
        assert_eq!(kept("--rate 5").0, Some(0));
        let first = place.bytes(&format!("new/f.00.{form}"));
        let (count, said) = kept("--rate 5 --resume --report r.json");
        assert!(
            count == Some(2) && said.contains("nothing was drawn") && !place.path("r.json").exists(),
            "{said}"
        );
        let (count, said) = kept("--rate 20 --resume");
        assert!(
            count == Some(0) && said.contains("2 frames were there, not drawn with these settings"),
            "{said}"
        );
        assert!(place.bytes(&format!("new/f.00.{form}")) != first);
    }
}

#[test]
fn an_existing_file_goes_before_the_pattern_that_its_name_could_be() {
    let place = Place::new();
    place.streak("a####.png", 0);
    place.streak("b#1#.png", 0);
    place.streak("c.png", 0);
    // Three files are three frames: none is a pattern, and what they show stands still.
    place.done("streaks extract a####.png b#1#.png c.png -o out");
}
