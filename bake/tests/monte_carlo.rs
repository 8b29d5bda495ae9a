//! `squall solve --method monte-carlo` from outside: files, report, options that do not go together, interruption.

use crate::solve::{CELLS, DIMS, density, read, report, scene, solve, write_scene};
use serde_json::json;

#[test]
fn every_field_and_picture_comes_with_its_standard_error() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), &scene(), &density());
    let out = folder.path().join("out");
    let ran =
        solve(&scene, "inside", &out, &["--method", "monte-carlo", "--samples", "20000", "--seed", "7"]);
    assert_eq!((ran.code, ran.out.as_str()), (0, ""), "words go to standard error");
    assert!(ran.error.contains("20000 photons, seed 7"), "{}", ran.error);
    for (name, count) in
        [("phi_sc", CELLS), ("phi_dir", CELLS), ("jcam_top", CELLS), ("image_top", 64), ("image_eye", 96)]
    {
        let (mean, error) = (read(out.join(format!("{name}.f32"))), read(out.join(format!("{name}_se.f32"))));
        assert_eq!((mean.len(), error.len()), (count, count), "{name}");
        assert!(mean.iter().chain(&error).all(|v| v.is_finite() && *v >= 0.0), "{name}");
        // Every cell is filled, the empty ones too; what was never hit has no error either.
        assert!(count != CELLS || mean.iter().zip(&error).all(|(m, e)| *m > 0.0 && e < m), "{name}");
        assert!(error.iter().sum::<f32>() > 0.0, "{name}");
    }
    assert!(out.join("image_top.exr").exists() && out.join("image_eye.exr").exists());
    let report = report(&out);
    assert_eq!(report["method"], "monte-carlo");
    assert_eq!((&report["samples"], &report["seed"]), (&json!(20_000), &json!(7)));
    assert_eq!((&report["refinement"], &report["dims_xyz"]), (&json!(1), &json!(DIMS)));
    assert!(report["residual"].is_null() && report["sweeps"].is_null());
    assert!(report["seconds"].as_f64().unwrap() > 0.0);
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    // Round-off of some 10⁵ additions beside the noise of the roulette.
    let balance = number(&report["energy_balance"]).abs();
    assert!(balance <= 1e-11 + 5.0 * number(&report["energy_balance_se"]), "{balance}");
    for name in ["phi_sc", "phi_dir", "jcam_top", "image_top", "image_eye"] {
        let mean = &report["means"][name];
        assert!(number(&mean["mean"]) > 0.0 && number(&mean["standard_error"]) < 0.2 * number(&mean["mean"]));
    }
}

#[test]
fn options_of_the_other_method_and_counts_out_of_range_are_bad_usage() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), &scene(), &density());
    let out = folder.path().join("out");
    let refused = |more: &[&str], words: &str| {
        let ran = solve(&scene, "inside", &out, more);
        assert_eq!(ran.code, 2, "{more:?}: {}", ran.error);
        assert!(ran.error.contains(words) && !out.exists(), "{more:?}: {}", ran.error);
    };
    let chance = ["--method", "monte-carlo"];
    refused(&[&chance[..], &["--refine", "2"]].concat(), "--refine does not go with --method monte-carlo");
    refused(&[&chance[..], &["--directions", "26"]].concat(), "--directions does not go");
    refused(&[&chance[..], &["--tolerance", "1e-3"]].concat(), "--tolerance does not go");
    refused(&[&chance[..], &["--max-sweeps", "9"]].concat(), "--max-sweeps does not go");
    refused(&["--samples", "1000"], "--samples does not go with --method sweep");
    refused(&["--seed", "2"], "--seed does not go");
    refused(&[&chance[..], &["--samples", "99"]].concat(), "--samples");
    refused(&[&chance[..], &["--samples", "100000000001"]].concat(), "--samples");
    refused(&[&chance[..], &["--seed=-1"]].concat(), "--seed");
}

#[test]
fn a_perspective_picture_of_a_grid_without_sides_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene();
    scene["boundary"] = json!("periodic_xy");
    let out = folder.path().join("out");
    let ran =
        solve(&write_scene(folder.path(), &scene, &density()), "inside", &out, &["--method", "monte-carlo"]);
    assert_eq!(ran.code, 3);
    assert!(
        ran.error.contains("\"eye\", a perspective one") && ran.error.lines().count() == 1,
        "{}",
        ran.error
    );
    assert!(!out.exists());
}

#[cfg(unix)]
#[test]
fn an_interrupted_monte_carlo_leaves_nothing_and_exits_130() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), &scene(), &density());
    let out = folder.path().join("out");
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("squall"))
        .args(["solve", scene.to_str().unwrap(), "--lamp", "inside", "-o", out.to_str().unwrap()])
        .args(["--method", "monte-carlo", "--samples", "100000000000"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while !out.exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
        assert!(child.try_wait().unwrap().is_none());
    }
    std::thread::sleep(std::time::Duration::from_millis(300));
    let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(130), "{}", String::from_utf8_lossy(&ended.stderr));
    assert!(!out.exists());
}
