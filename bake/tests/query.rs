//! `squall query ASSET density` from outside: numbers, exit codes, and which bytes it looks at.

use assert_cmd::Command;
use serde_json::Value;
use squall_bake::density::DensitySpec;
use squall_bake::plan::density::bake_density;
use squall_formats::Tag;
use squall_formats::container::{Directory, OutSection, write};
use squall_formats::section::density::DensitySection;
use std::path::{Path, PathBuf};

/// An asset with density tables and one more section behind them, in a folder of its own.
fn asset(folder: &Path) -> PathBuf {
    let tables = bake_density(&DensitySpec::default()).unwrap().to_section();
    let other = OutSection::small(Tag(*b"ELSE"), 1, false, vec![7; 500]);
    let path = folder.join("rain.squall");
    let mut file = std::fs::File::create(&path).unwrap();
    write(&mut file, &[tables, other]).unwrap();
    path
}

fn query(asset: &Path, arguments: &str) -> (i32, String, String) {
    let mut command = Command::cargo_bin("squall").unwrap();
    let output = command.arg("query").arg(asset).arg("density").args(arguments.split(' ')).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn total(asset: &Path, arguments: &str) -> f64 {
    let (code, out, error) = query(asset, &format!("{arguments} --json"));
    assert_eq!(code, 0, "{arguments}: {error}");
    let answer: Value = serde_json::from_str(&out).unwrap();
    let classes = answer["classes"].as_array().unwrap();
    let sum: f64 = classes.iter().map(|class| class["count"].as_f64().unwrap()).sum();
    let total = answer["total"].as_f64().unwrap();
    assert!((sum / total - 1.0).abs() < 1e-12);
    assert!(classes.iter().all(|class| class["diameter_mm"].as_array().unwrap().len() == 2));
    total
}

#[test]
fn the_counts_table_comes_out_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let asset = asset(folder.path());
    let paper_camera = "--height 1080 --exposure-ms 20 --aspect 16:9 --min-px 30 --max-px 200";
    for (mode, counts) in [
        ("paper-exact", [1090.0, 5184.0, 7646.0, 9558.0]),
        ("paper", [2515.0, 11315.0, 16291.0, 20049.0]),
        ("default", [1012.0, 6690.0, 10630.0, 13802.0]),
    ] {
        for (rate, count) in [2, 25, 50, 75].into_iter().zip(counts) {
            let found = total(&asset, &format!("--rate {rate} --fov 120 {paper_camera} --mode {mode}"));
            assert_eq!(found.round(), count, "{mode} R={rate}");
        }
    }
    for (rate, counts) in [(2, [1471.0, 2090.0, 3037.0]), (75, [20059.0, 28489.0, 41405.0])] {
        for (fov, count) in [100, 80, 60].into_iter().zip(counts) {
            let found = total(&asset, &format!("--rate {rate} --fov {fov} {paper_camera}"));
            assert_eq!(found.round(), count, "R={rate} fov={fov}");
        }
    }
    for (exposure, count) in [(1, 2.0), (5, 118.0), (10, 872.0), (33, 29558.0)] {
        let found = total(&asset, &format!("--rate 25 --fov 120 --exposure-ms {exposure}"));
        assert_eq!(found.round(), count, "T={exposure}");
    }
    // These three were noted to a few digits.
    for (min_px, count) in [(10, 181_218.0), (20, 22_632.0), (40, 2809.0)] {
        let found = total(&asset, &format!("--rate 25 --fov 120 --min-px {min_px}"));
        assert_eq!(found.round(), count, "shortest {min_px} px");
    }
}

#[test]
fn direct_evaluation_stands_beside_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let asset = asset(folder.path());
    let (code, out, _) = query(&asset, "--rate 33.3 --fov 77 --aspect 1.7778 --direct --json");
    assert_eq!(code, 0);
    let answer: Value = serde_json::from_str(&out).unwrap();
    let [table, formula] = ["total", "direct"].map(|key| answer[key].as_f64().unwrap());
    assert!((table / formula - 1.0).abs() < 1e-4, "{table} {formula}");
    let (code, out, _) = query(&asset, "--rate 33.3 --fov 77 --direct");
    assert!(code == 0 && out.contains("formula"));
}

#[test]
fn arguments_out_of_an_assets_range_exit_3_with_one_line_and_those_of_no_picture_exit_2() {
    let folder = tempfile::tempdir().unwrap();
    let asset = asset(folder.path());
    for (arguments, words) in [
        ("--rate 201 --fov 60", "0.1 to 200 mm/h"),
        ("--rate 0.05 --fov 60", "0.1 to 200 mm/h"),
        ("--rate 2 --fov 141", "20 to 140 degrees"),
        ("--rate 2 --fov 19.9", "20 to 140 degrees"),
        ("--rate 2 --exposure-ms 34", "1 to 33 ms"),
        ("--rate 2 --min-px 9", "10 to 200 px"),
        ("--rate 2 --max-px 201", "10 to 200 px"),
        ("--rate 0", "rate"),
    ] {
        let (code, out, error) = query(&asset, &format!("{arguments} --json"));
        assert!(code == 3 && !out.contains("total"), "{arguments}: {out} {error}");
        assert!(error.contains(words) && error.lines().count() == 1, "{arguments}: {error}");
    }
    for (arguments, words) in [
        ("--rate NaN", "rate"),
        ("--rate -3", "rate"),
        ("--rate inf", "rate"),
        ("--rate 2 --fov 0", "fov"),
        ("--rate 2 --fov -60", "fov"),
        ("--rate 2 --height 0", "height"),
        ("--rate 2 --aspect -1.5", "aspect"),
        ("--rate 2 --aspect 16:0", "aspect"),
        ("--rate 2 --exposure-ms 0", "exposure-ms"),
        ("--rate 2 --min-px 100 --max-px 50", "min-px"),
        ("--rate 2 --min-px 50 --max-px 50", "min-px"),
    ] {
        let (code, out, error) = query(&asset, &format!("{arguments} --json"));
        assert!(code == 2 && out.is_empty() && error.contains(words), "{arguments}: {out} {error}");
    }
    assert_eq!(query(&asset, "--rate much").0, 2);
    assert_eq!(query(&asset, "--rate 2 --mode papers").0, 2);
}

#[test]
fn damage_in_the_tables_fails_and_damage_elsewhere_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let asset = asset(folder.path());
    let bytes = std::fs::read(&asset).unwrap();
    let directory = Directory::read(&bytes, &Default::default()).unwrap();
    let spoil = |tag: Tag| {
        let entry = directory.find(tag).unwrap();
        let mut bytes = bytes.clone();
        bytes[(entry.offset + entry.length / 2) as usize] ^= 0x10;
        let path = folder.path().join("spoilt.squall");
        std::fs::write(&path, bytes).unwrap();
        query(&path, "--rate 2 --json")
    };
    let (code, _, error) = spoil(DensitySection::TAG);
    assert_eq!(code, 3);
    assert!(error.contains("DENS") && error.contains("checksum"), "{error}");
    assert_eq!(spoil(Tag(*b"ELSE")).0, 0);

    let empty = folder.path().join("empty.squall");
    write(&mut std::fs::File::create(&empty).unwrap(), &[]).unwrap();
    let (code, _, error) = query(&empty, "--rate 2");
    assert!(code == 3 && error.contains("DENS") && error.contains("rain density tables"), "{error}");
    assert_eq!(query(&folder.path().join("none.squall"), "--rate 2").0, 3);
}
