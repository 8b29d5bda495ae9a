//! `squall page`: the folder that it makes, and what it refuses. What a browser makes of it: tests/src/page.rs.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SQUALL: &str = env!("CARGO_BIN_EXE_squall");

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.squall")
}

fn page(asset: &Path, out: &Path, more: &[&str]) -> Output {
    Command::new(SQUALL).arg("page").arg(asset).arg("-o").arg(out).args(more).output().unwrap()
}

fn refused(done: &Output, words: &str) {
    let error = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.code() == Some(3) && error.contains(words), "{:?} {error}", done.status.code());
}

#[test]
fn a_page_is_a_folder_of_its_files_the_module_and_the_asset() {
    let folder = tempfile::tempdir().unwrap();
    let [module, out] = ["module.wasm", "page"].map(|name| folder.path().join(name));
    std::fs::write(&module, b"\0asm\x01\0\0\0").unwrap();
    let done = page(&golden(), &out, &["--module", module.to_str().unwrap(), "--json"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let answer: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    let asset = std::fs::read(golden()).unwrap();
    assert_eq!((&answer["command"], &answer["asset_bytes"]), (&"page".into(), &asset.len().into()));
    assert!(std::fs::read(out.join("asset.squall")).unwrap() == asset);
    assert!(std::fs::read(out.join("squall_page.wasm")).unwrap() == std::fs::read(&module).unwrap());
    let index = std::fs::read_to_string(out.join("index.html")).unwrap();
    for name in ["page.css", "page.js"] {
        assert!(index.contains(name) && out.join(name).is_file(), "{name}");
    }
    assert!(!index.contains("http"), "the page wants the network");
}

#[test]
fn what_makes_no_page_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [module, out, cut] = ["module.wasm", "page", "cut.squall"].map(|name| folder.path().join(name));
    std::fs::write(&module, b"<!DOCTYPE html>").unwrap();
    let named = ["--module", module.to_str().unwrap()];
    refused(&page(&golden(), &out, &named), "module: wanted a whole WebAssembly module, found 15 bytes");
    // A section of five bytes that ends after one.
    std::fs::write(&module, b"\0asm\x01\0\0\0\0\x05\0").unwrap();
    refused(&page(&golden(), &out, &named), "cut off in the section at byte 8");
    std::fs::write(&module, b"\0asm\x01\0\0\0").unwrap();
    std::fs::write(&cut, &std::fs::read(golden()).unwrap()[..5000]).unwrap();
    refused(&page(&cut, &out, &named), "file length");
    refused(&page(&golden(), &out, &["--module", "absent.wasm"]), "absent.wasm");
    assert!(!out.exists());
}
