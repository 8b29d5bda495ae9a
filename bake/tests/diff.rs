//! `squall diff` from outside: exit codes, words, keys, and distances that are what was done to the bytes.

use assert_cmd::Command;
use serde_json::Value;
use squall_bake::recipe::Recipe;
use squall_bake::{pipeline, progress::Quiet};
use squall_formats::container::{OutSection, write};
use squall_formats::section::bolt::BoltSection;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The golden recipe with its response coded to a given error.
fn bake(error: f64) -> Vec<OutSection> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.toml");
    let mut recipe = Recipe::read(&path).unwrap();
    recipe.clouds.as_mut().unwrap().response.relative_error = error;
    pipeline::bake(&recipe, &Quiet).unwrap().sections
}

fn fine() -> &'static [OutSection] {
    static BAKED: OnceLock<Vec<OutSection>> = OnceLock::new();
    BAKED.get_or_init(|| bake(1e-4))
}

fn run(a: &[OutSection], b: &[OutSection], json: bool) -> (i32, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let paths: [PathBuf; 2] = ["a.squall", "b.squall"].map(|name| folder.path().join(name));
    for (path, sections) in paths.iter().zip([a, b]) {
        let mut bytes = Vec::new();
        write(&mut bytes, sections).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let mut call = Command::cargo_bin("squall").unwrap();
    call.arg("diff").args(&paths);
    if json {
        call.arg("--json");
    }
    let output = call.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn an_asset_does_not_differ_from_itself() {
    assert_eq!(run(fine(), fine(), false), (0, "the same bytes\n".into(), String::new()));
    let (code, out, _) = run(fine(), fine(), true);
    let json: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &json["identical"], json["sections"].as_array().unwrap().len()), (0, &true.into(), 0));
}

#[test]
fn coarser_coding_shows_as_another_section_budget_and_distance_of_about_its_size() {
    /// What the coarser response may be off, L2: each row's error is below it, and rows of one stroke do not add up to more.
    const CODED: f64 = 0.1;
    /// What it is off at least, of that: coding uses up its budget but for the steps of its threshold.
    const USED: f64 = 0.1;
    let (code, out, error) = run(&bake(CODED), fine(), true);
    assert_eq!(code, 1);
    assert!(error.contains("sections differ"), "{error}");
    let json: Value = serde_json::from_str(&out).unwrap();
    let tags: Vec<&str> =
        json["sections"].as_array().unwrap().iter().map(|s| s["tag"].as_str().unwrap()).collect();
    assert!(tags.contains(&"CLRT") && tags.contains(&"PROV") && !tags.contains(&"CLDG"), "{tags:?}");
    let part = json["parts"].as_array().unwrap().iter().find(|p| p["part"] == "CLRT").unwrap();
    let l2 = part["value"].as_f64().unwrap();
    assert!(l2 > USED * CODED && l2 < 1.1 * CODED, "{l2}");
    assert!(
        json["budgets"].as_array().unwrap().iter().any(|b| b["name"].as_str().unwrap().contains("relit L2"))
    );
}

#[test]
fn an_asset_without_light_is_not_called_near() {
    let sections = fine();
    let dark: Vec<OutSection> = sections
        .iter()
        .map(|section| {
            let mut section = section.clone();
            if section.tag.to_string() == "CLDG" {
                // The bulk of the grid: extinction, f32.
                let head = section.head_length as usize;
                let mut bytes: Vec<u8> = section.parts.concat();
                bytes[head..].fill(0);
                section.parts = vec![bytes];
            }
            section
        })
        .collect();
    let (code, out, error) = run(sections, &dark, false);
    assert_eq!(code, 1, "{error}");
    let line = out.lines().find(|line| line.starts_with("CLDG") && line.contains("relative L2")).unwrap();
    assert!(line.contains("inf"), "{line}");
}

#[test]
fn a_section_in_one_asset_alone_is_named() {
    let without: Vec<OutSection> = fine().iter().filter(|s| s.tag != BoltSection::TAG).cloned().collect();
    let (code, out, error) = run(&without, fine(), false);
    assert_eq!(code, 1, "{error}");
    let line = out.lines().find(|line| line.starts_with("BOLT")).unwrap();
    assert!(line.contains('–'), "{line}");
}

#[test]
fn a_file_that_is_no_asset_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("no.squall");
    std::fs::write(&path, "nothing").unwrap();
    let mut call = Command::cargo_bin("squall").unwrap();
    let output = call.arg("diff").arg(&path).arg(&path).output().unwrap();
    assert_eq!(output.status.code(), Some(3));
}
