//! `squall streaks fit` as a script sees it: the JSON's keys, exit codes, files.

use assert_cmd::Command;
use serde_json::Value;
use std::path::{Path, PathBuf};

fn squall(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::cargo_bin("squall").unwrap().args(arguments).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn grey(folder: &Path, name: &str, size: [u32; 2], light: impl Fn(u32, u32) -> f64) -> PathBuf {
    let path = folder.join(name);
    let file = std::fs::File::create(&path).unwrap();
    let mut encoder = png::Encoder::new(file, size[0], size[1]);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let sample = |i: u32| ((light(i % size[0], i / size[0]) * 65_535.0) as u16).to_be_bytes();
    let bytes: Vec<u8> = (0..size[0] * size[1]).flat_map(sample).collect();
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    path
}

/// A streak of light, 12 × 40 pixels.
fn streak(folder: &Path, name: &str) -> PathBuf {
    grey(folder, name, [12, 40], |x, y| {
        let (u, v) = ((f64::from(x) - 5.5) / 3.0, (f64::from(y) - 19.5) / 15.0);
        libm::exp(-u * u * u * u - libm::pow(v, 8.0)) * (0.7 + 0.3 * libm::cos(3.0 * v + u))
    })
}

fn rows(arguments: &[&str]) -> Vec<Value> {
    let (code, out, error) = squall(arguments);
    assert_eq!(code, 0, "{arguments:?}: {error}");
    serde_json::from_str::<Value>(&out).unwrap().as_array().unwrap().clone()
}

#[test]
fn json_has_a_row_per_picture_with_the_contracts_keys() {
    let folder = tempfile::tempdir().unwrap();
    let files = ["a.png", "b.png"].map(|name| streak(folder.path(), name));
    let names = [files[0].to_str().unwrap(), files[1].to_str().unwrap()];
    let list = rows(&["streaks", "fit", names[0], names[1], "--cosines", "3", "--json"]);
    assert_eq!(list.len(), 2);
    for (row, name) in list.iter().zip(names) {
        let mut keys: Vec<&str> = row.as_object().unwrap().keys().map(String::as_str).collect();
        keys.sort_unstable();
        assert_eq!(keys, ["bytes", "file", "method", "psnr_db", "ssim", "terms"]);
        assert_eq!(row["file"], name);
        assert_eq!((&row["method"], row["terms"].as_u64()), (&"edges".into(), Some(3)));
        assert!(row["psnr_db"].as_f64().unwrap() > 25.0 && row["ssim"].as_f64().unwrap() > 0.9, "{row}");
        // A record of 19 bytes, a name of one, four edges, the constant, the terms.
        assert_eq!(row["bytes"], 19 + 1 + 22 + 5 + 3 * 6);
    }
    assert_eq!(rows(&["streaks", "fit", names[0], names[1], "--cosines", "3", "--json"]), list);
}

#[test]
fn every_method_answers_to_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = streak(folder.path(), "a.png");
    let mut quality = vec![];
    for method in ["paper", "fourier", "windowed", "off-grid", "super", "edges", "separable"] {
        let list =
            rows(&["streaks", "fit", file.to_str().unwrap(), "--method", method, "--cosines", "2", "--json"]);
        assert_eq!(list[0]["method"], method);
        assert_eq!(list[0]["terms"], 2);
        quality.push(list[0]["psnr_db"].as_f64().unwrap());
    }
    assert!(quality[5] > quality[0] + 3.0, "the default beats the paper: {quality:?}");
    let sheet = folder.path().join("sheet.png");
    let (code, out, error) =
        squall(&["streaks", "fit", file.to_str().unwrap(), "--preview", sheet.to_str().unwrap()]);
    assert!(code == 0 && out.contains("PSNR dB") && sheet.exists(), "{error}");
}

#[test]
fn bad_pictures_and_settings_have_one_clear_error() {
    let folder = tempfile::tempdir().unwrap();
    let good = streak(folder.path(), "good.png");
    let good = good.to_str().unwrap();
    let black = grey(folder.path(), "black.png", [4, 9], |_, _| 0.0);
    let text = folder.path().join("text.png");
    std::fs::write(&text, "no picture").unwrap();
    let whole = std::fs::read(good).unwrap();
    let cut = folder.path().join("cut.png");
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    let none = folder.path().join("none.png");
    for (file, words) in [(&black, "some light"), (&text, "PNG or OpenEXR"), (&cut, "whole"), (&none, "open")]
    {
        let (code, out, error) = squall(&["streaks", "fit", good, file.to_str().unwrap(), "--json"]);
        assert!(code == 3 && !out.contains("psnr_db"), "{out} {error}");
        assert!(error.contains(words) && error.contains(file.to_str().unwrap()), "{error}");
        assert_eq!(error.trim_end().lines().count(), 1, "{error}");
    }
    let (code, _, error) = squall(&["streaks", "fit", good, "--cosines", "1025"]);
    assert!(code == 2 && error.contains("0..=64"), "{error}");
    let (code, _, error) = squall(&["streaks", "fit", good, "--method", "papers"]);
    assert!(code == 2 && error.contains("paper, fourier"), "{error}");
    assert_eq!(squall(&["streaks", "fit"]).0, 2);
}
