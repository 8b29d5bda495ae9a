//! The runtime as a WebAssembly module: it builds without maps and threads, and Node gets the light that a native program gets.

use crate::layering::{cargo, rustc, usual_rustc};
use crate::{root, skip};
use glam::DVec3;
use serde_json::Value;
use squall_runtime::relight::PointLight;
use squall_runtime::{Asset, Clouds};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const TARGET: &str = "wasm32-unknown-unknown";

/// How far a cell's light may differ between the module and this build, relative to the brightest cell. Nothing: both do the same
/// IEEE operations in the same order, transcendental functions come from `libm` on either, and work spread over threads is summed
/// in an order of its own. Other architectures may add four lanes in another order, which is single precision's round-off.
const DIFFERENCE: f64 = if cfg!(target_arch = "x86_64") { 0.0 } else { 1e-5 };

/// A compiler for wasm32 where the usual one cannot: what `.ci/wasm-target` prints.
const COMPILER: &str = "SQUALL_WASM_RUSTC";

/// The module of a crate, built in profile `profile`; `None` (said aloud) without the target.
pub fn module(package: &str, profile: &str) -> Option<PathBuf> {
    let compiler = std::env::var_os(COMPILER).unwrap_or_else(usual_rustc);
    let library = rustc(&compiler, &["--print", "target-libdir", "--target", TARGET]);
    if library.is_empty() || !Path::new(&library).is_dir() {
        skip("SQUALL_REQUIRE_WASM", "no wasm32 target");
        return None;
    }
    // A folder of its own, since whoever runs the tests may hold the lock of the usual one.
    let folder = root().join("target/wasm32");
    let output = cargo()
        .args(["build", "--profile", profile, "--locked", "--quiet", "-p", package])
        .args(["--target", TARGET, "--target-dir"])
        .arg(&folder)
        .env("RUSTC", compiler)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(folder.join(TARGET).join(profile).join(package.replace('-', "_")).with_extension("wasm"))
}

/// Oldest Node that runs what rustc makes: older ones lack parts of WebAssembly that it takes for granted.
const NODE: u32 = 18;

/// Node; `None` (said aloud) without it.
fn node() -> Option<PathBuf> {
    for name in ["node", "nodejs"] {
        // It says "v18.20.4".
        let Ok(output) = Command::new(name).arg("--version").output() else { continue };
        let version = String::from_utf8_lossy(&output.stdout);
        let major = version.trim_start_matches('v').split('.').next().and_then(|major| major.parse().ok());
        if major.is_some_and(|major: u32| major >= NODE) {
            return Some(name.into());
        }
    }
    skip("SQUALL_REQUIRE_NODE", "no Node of version 18 or later (Debian package nodejs)");
    None
}

fn golden(name: &str) -> PathBuf {
    root().join("data/golden").join(name)
}

/// A light and a viewer: the light as x, y, z in m and W/sr.
type Case = (&'static str, [f64; 4], Option<[f64; 3]>);

/// Both kinds of rows and of light, towards viewers near and far; and of rows for a view region, which know no fluence.
const CASES: [Case; 5] = [
    ("v1/golden.squall", [20.0, 10.0, 650.5, 1e6], None),
    ("v1/golden.squall", [-131.7, 77.1, 703.3, 3.3e5], Some([0.0, -400.0, 2.0])),
    ("v1/paper.squall", [20.0, 10.0, 650.5, 1e6], None),
    ("v1/paper.squall", [-150.0, -60.0, 680.0, 2e6], Some([-3e4, 2e4, 900.0])),
    ("v2/eyes.squall", [131.0, 99.0, 700.0, 5e5], Some([10.0, -400.0, 2.0])),
];

/// What the module's users run, with `arguments` after the asset.
fn relight(node: &Path, module: &Path, asset: &Path, arguments: &[String]) -> Output {
    let script = root().join("runtime/wasm/relight.mjs");
    Command::new(node).arg(script).arg(module).arg(asset).args(arguments).output().unwrap()
}

fn words(numbers: impl IntoIterator<Item = f64>) -> Vec<String> {
    numbers.into_iter().map(|number| number.to_string()).collect()
}

/// The same light by this build, one value a cell.
fn native((name, [x, y, z, intensity], viewer): Case) -> Vec<f32> {
    let mut clouds = Clouds::new(&Asset::open(golden(name)).unwrap()).unwrap();
    let mut values = vec![0.0; clouds.cloud().shape.len()];
    let light = clouds.light(&[PointLight { position: DVec3::new(x, y, z), intensity }]).unwrap();
    match viewer {
        Some(viewer) => light.radiance(DVec3::from_array(viewer), &mut values).unwrap(),
        None => light.fluence(&mut values).unwrap(),
    }
    values
}

#[test]
fn the_runtime_builds_for_wasm32_without_map_and_threads_and_imports_nothing() {
    let Some(module) = module("squall-wasm", "release") else { return };
    let bytes = std::fs::read(module).unwrap();
    assert!(bytes.starts_with(b"\0asm\x01\0\0\0"));
    // Sections are an identifier and a length; imports have identifier 2.
    let mut at = 8;
    while at < bytes.len() {
        let identifier = bytes[at];
        let (mut length, mut shift) = (0usize, 0);
        loop {
            at += 1;
            length |= usize::from(bytes[at] & 0x7F) << shift;
            shift += 7;
            if bytes[at] < 0x80 {
                break;
            }
        }
        assert_ne!(identifier, 2, "the module asks its host for functions");
        at += 1 + length;
    }
}

#[test]
fn light_that_the_module_gives_in_node_is_that_of_a_native_program_cell_by_cell() {
    let Some(node) = node() else { return };
    let Some(module) = module("squall-wasm", "release") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("values.f32");
    for case in CASES {
        let (name, light, viewer) = case;
        let mut arguments = words(light.into_iter().chain(viewer.into_iter().flatten()));
        arguments.extend(["--values".to_owned(), file.to_str().unwrap().to_owned()]);
        let output = relight(&node, &module, &golden(name), &arguments);
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));

        let wanted = native(case);
        let bytes = std::fs::read(&file).unwrap();
        let found: Vec<f32> =
            bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        assert_eq!(found.len(), wanted.len(), "{name}");
        let largest = wanted.iter().fold(0.0f64, |most, &value| most.max(f64::from(value)));
        assert!(largest > 0.0, "{name} is dark");
        for (cell, (&found, &wanted)) in found.iter().zip(&wanted).enumerate() {
            let off = (f64::from(found) - f64::from(wanted)).abs();
            assert!(off <= DIFFERENCE * largest, "{name}, cell {cell}: {found} for {wanted}");
        }
        // What is printed is of those values.
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["cells"], found.len());
        assert_eq!(report["sum"].as_f64(), Some(found.iter().map(|&value| f64::from(value)).sum()));
        let brightest = found.iter().fold(0.0f64, |most, &value| most.max(f64::from(value)));
        assert_eq!(report["max"].as_f64(), Some(brightest));
    }
}

#[test]
fn what_the_module_refuses_node_says_in_the_runtimes_words() {
    let Some(node) = node() else { return };
    let Some(module) = module("squall-wasm", "release") else { return };
    let text = root().join("Cargo.toml");
    let cut = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(cut.path(), &std::fs::read(golden("v1/golden.squall")).unwrap()[..9000]).unwrap();
    let empty = tempfile::NamedTempFile::new().unwrap();
    let (lit, region) = ([20.0, 10.0, 650.5, 1e6], golden("v2/eyes.squall"));
    let outside = [0.0, -4000.0, 2.0];
    let refused: [(&Path, Vec<f64>, &str); 6] = [
        (&golden("v1/golden.squall"), vec![1e6, 0.0, 0.0, 1e6], "point light's position"),
        (&region, lit.to_vec(), "baked for a view region"),
        (&region, lit.into_iter().chain(outside).collect(), "camera position"),
        (&text, lit.to_vec(), "found TOML text"),
        (cut.path(), lit.to_vec(), "file length"),
        (empty.path(), lit.to_vec(), "found 0"),
    ];
    for (asset, numbers, wanted) in refused {
        let output = relight(&node, &module, asset, &words(numbers));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains(wanted) && said.contains(asset.to_str().unwrap()), "{wanted}: {said}");
        assert!(output.stdout.is_empty() && said.lines().count() == 1, "{said}");
    }
    for wrong in [&["1", "2", "x", "4"][..], &["1", "2", "3"], &["1", "2", "3", "4", "--values"]] {
        let arguments: Vec<String> = wrong.iter().map(|&word| word.to_owned()).collect();
        let output = relight(&node, &module, &golden("v1/golden.squall"), &arguments);
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
    }
}
