//! Dependencies run one way: formats ← transport ← runtime ← bake; and what the runtime drags along is little.

use crate::root;
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::process::Command;

/// What the runtime needs at most, everything optional included.
const RUNTIME_NEEDS: [&str; 10] = [
    "bytemuck",
    "fearless_simd",
    "glam",
    "libm",
    "memmap2",
    "rayon",
    "squall-formats",
    "squall-transport",
    "thiserror",
    // With feature `gpu` alone; once for each system, whose interfaces differ.
    "wgpu",
];
/// The same of light transport in clouds.
const TRANSPORT_NEEDS: [&str; 7] =
    ["bytemuck", "fearless_simd", "glam", "libm", "rayon", "squall-formats", "thiserror"];
/// What the formats need.
const FORMATS_NEEDS: [&str; 7] = ["bincode", "bytemuck", "crc32fast", "glam", "libm", "serde", "thiserror"];

/// Licences that ask for no more than a notice.
const LICENCES: [&str; 11] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "Unicode-3.0",
    "Zlib",
];

/// A command of cargo in the workspace.
pub fn cargo() -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or("cargo".into()));
    // What this test was built with must not leak into builds that it starts.
    for (name, _) in std::env::vars_os() {
        let name = name.to_string_lossy().into_owned();
        if name.starts_with("CARGO_PROFILE") || name == "RUSTFLAGS" || name == "CARGO_ENCODED_RUSTFLAGS" {
            cargo.env_remove(name);
        }
    }
    cargo.current_dir(root());
    cargo
}

/// The rustc that cargo uses here.
pub fn usual_rustc() -> OsString {
    std::env::var_os("RUSTC").unwrap_or("rustc".into())
}

/// What `rustc` says to `arguments`.
pub fn rustc(rustc: &OsStr, arguments: &[&str]) -> String {
    let output = Command::new(rustc).args(arguments).current_dir(root()).output().unwrap();
    String::from_utf8(output.stdout).unwrap().trim().to_owned()
}

fn metadata(arguments: &[&str]) -> Value {
    let output = cargo()
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Names of a crate's dependencies; of its tests' and benches' too, if asked.
fn needs<'a>(workspace: &'a Value, name: &str, dev: bool) -> Vec<&'a str> {
    let package = workspace["packages"].as_array().unwrap().iter().find(|p| p["name"] == name).unwrap();
    let all = package["dependencies"].as_array().unwrap().iter();
    let mut names: Vec<&str> =
        all.filter(|d| dev || d["kind"] != "dev").map(|d| d["name"].as_str().unwrap()).collect();
    names.sort_unstable();
    names.dedup();
    names
}

#[test]
fn dependencies_run_from_bake_to_runtime_to_transport_to_formats_and_never_back() {
    let workspace = metadata(&["--no-deps"]);
    let own = |name: &str| -> Vec<&str> {
        let mut names = needs(&workspace, name, true);
        names.retain(|need| need.starts_with("squall"));
        names
    };
    assert_eq!(own("squall-formats"), [""; 0]);
    assert_eq!(own("squall-transport"), ["squall-formats"]);
    assert_eq!(own("squall-runtime"), ["squall-formats", "squall-transport"]);
    assert_eq!(own("squall-wasm"), ["squall-runtime"]);
    assert_eq!(own("squall-page"), ["squall-runtime"]);
    assert_eq!(own("squall-scene"), ["squall-formats", "squall-runtime"]);
    assert_eq!(own("squall-bake"), ["squall-formats", "squall-runtime", "squall-scene"]);
    assert_eq!(own("squall-tests"), ["squall-bake", "squall-formats", "squall-page", "squall-runtime"]);
    assert_eq!(workspace["packages"].as_array().unwrap().len(), 8);
}

#[test]
fn what_the_runtime_needs_is_few_and_named_here() {
    let workspace = metadata(&["--no-deps"]);
    assert_eq!(needs(&workspace, "squall-runtime", false), RUNTIME_NEEDS);
    assert_eq!(needs(&workspace, "squall-transport", false), TRANSPORT_NEEDS);
    assert_eq!(needs(&workspace, "squall-formats", false), FORMATS_NEEDS);
}

#[test]
fn a_runtime_that_only_reads_and_shades_is_built_without_the_solver() {
    // The names of all crates that are compiled for the runtime with these features.
    let built = |features: &[&str]| -> String {
        let output = cargo()
            .args([
                "tree",
                "--locked",
                "--offline",
                "-p",
                "squall-runtime",
                "--edges",
                "normal",
                "--prefix",
                "none",
            ])
            .args(features)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    for features in [&[][..], &["--no-default-features"]] {
        assert!(!built(features).contains("fearless_simd"), "{features:?}");
    }
    for features in ["live", "simd"] {
        assert!(built(&["--features", features]).contains("fearless_simd"));
    }
}

#[test]
fn every_dependency_may_ship_under_our_licences() {
    let host = rustc(&usual_rustc(), &["-vV"]);
    let host = host.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    let all = metadata(&["--filter-platform", host]);
    let used: Vec<&str> =
        all["resolve"]["nodes"].as_array().unwrap().iter().map(|node| node["id"].as_str().unwrap()).collect();
    assert!(used.len() > 20);
    for package in all["packages"].as_array().unwrap() {
        if !used.contains(&package["id"].as_str().unwrap()) {
            continue;
        }
        let licence = package["license"].as_str().unwrap_or("");
        let allowed = |one: &str| LICENCES.contains(&one.trim().trim_matches(['(', ')']));
        let choice = |choice: &str| choice.split(" AND ").all(allowed);
        // "A/B" is the old way to write "A OR B".
        let fine = licence.split(" OR ").flat_map(|part| part.split('/')).any(choice);
        assert!(fine, "{} has licence {licence:?}", package["name"]);
        if package["name"].as_str().unwrap().starts_with("squall") {
            assert_eq!(licence, "MIT OR Apache-2.0");
        }
    }
    for (file, words) in [("LICENSE-MIT", "MIT License"), ("LICENSE-APACHE", "Version 2.0, January 2004")] {
        assert!(std::fs::read_to_string(root().join(file)).unwrap().contains(words), "{file}");
    }
}
