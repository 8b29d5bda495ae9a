//! `squall render --backend` from outside.

use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

const ASSET: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");

fn squall(folder: &Path, words: &str) -> (i32, String) {
    let mut call = Command::cargo_bin("squall").unwrap();
    let words = words.replace("ASSET", ASSET);
    let output = call.current_dir(folder).args(words.split_whitespace()).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("report.json")).unwrap()).unwrap()
}

#[test]
fn the_processor_reports_its_parts_and_is_no_graphics_card() {
    let folder = tempfile::tempdir().unwrap();
    let (code, said) = squall(folder.path(), "render ASSET -o a.png --report report.json");
    assert_eq!(code, 0, "{said}");
    let told = report(folder.path());
    assert_eq!((&told["backend"], &told["adapter"]), (&Value::from("cpu"), &Value::Null));
    let parts = told["passes"].as_array().unwrap();
    assert!(parts.iter().any(|part| part["name"] == "streaks" && part["ms"].as_f64().unwrap() > 0.0));
}

#[test]
fn a_card_that_is_not_there_is_an_error_and_auto_says_who_drew() {
    let folder = tempfile::tempdir().unwrap();
    let (code, said) = squall(folder.path(), "render ASSET -o a.png --backend gpu");
    let is_there = code == 0;
    assert!(is_there || code == 4 && said.contains("graphics device"), "{code} {said}");
    assert!(is_there == folder.path().join("a.png").exists());
    if !cfg!(feature = "gpu") {
        assert!(said.contains("built without"), "{said}");
    }
    let (code, said) = squall(folder.path(), "render ASSET -o b.png --backend auto --report report.json");
    assert_eq!(code, 0, "{said}");
    let told = report(folder.path());
    assert_eq!(told["backend"] == "gpu", is_there && told["instead"].is_null());
    assert_eq!(said.contains("drawn by the processor"), told["backend"] == "cpu", "{said}");
}

#[test]
fn layers_are_the_processors_whatever_auto_finds() {
    let folder = tempfile::tempdir().unwrap();
    let (code, said) = squall(folder.path(), "render ASSET -o a.exr --layers depth --backend auto");
    assert!(code == 0 && said.contains("layers"), "{code} {said}");
}
