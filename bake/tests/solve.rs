//! `squall solve` from outside: files, units, awkward lamps, bad input, exit codes.

use assert_cmd::Command;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub const DIMS: [usize; 3] = [6, 5, 3];
pub const CELLS: usize = DIMS[0] * DIMS[1] * DIMS[2];

/// A ragged little cloud with empty cells, cells that are not cubes, two lamps and two cameras.
pub fn scene() -> Value {
    json!({
        "dims_xyz": DIMS, "cell_m": [40.0, 50.0, 30.0], "origin_m": [-120.0, -100.0, 500.0],
        "density_file": "grid.f32", "kappa_per_m": 0.02, "albedo": 0.99, "g": 0.5,
        "lights": [
            { "name": "inside", "type": "point", "position_m": [3.0, 7.0, 548.0], "intensity_W_per_sr": 2.0 },
            { "name": "below", "type": "point", "position_m": [30.0, -20.0, 400.0], "intensity_W_per_sr": 2.0 },
        ],
        "cameras": [
            { "name": "top", "type": "orthographic", "target_m": [0.0, 0.0, 545.0], "direction": [0.0, 0.0, -1.0],
              "up": [0.0, 1.0, 0.0], "half_width_m": 140.0, "half_height_m": 140.0, "width": 8, "height": 8 },
            { "name": "eye", "type": "perspective", "origin_m": [400.0, -500.0, 300.0], "target_m": [0.0, 0.0, 545.0],
              "up": [0.0, 0.0, 1.0], "vertical_fov_deg": 30.0, "width": 12, "height": 8 },
        ],
    })
}

pub fn density() -> Vec<f32> {
    (0..CELLS).map(|i| if i % 4 == 1 { 0.0 } else { 0.2 + ((i * 37) % 11) as f32 / 10.0 }).collect()
}

pub fn write_scene(folder: &Path, scene: &Value, density: &[f32]) -> PathBuf {
    let bytes: Vec<u8> = density.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.join("grid.f32"), bytes).unwrap();
    let path = folder.join("scene.json");
    std::fs::write(&path, scene.to_string()).unwrap();
    path
}

pub struct Ran {
    pub code: i32,
    pub out: String,
    pub error: String,
}

pub fn solve(scene: &Path, light: &str, out: &Path, more: &[&str]) -> Ran {
    let mut command = Command::cargo_bin("squall").unwrap();
    command.arg("solve").arg(scene).args(["--lamp", light, "-o"]).arg(out).args(more);
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ran { code: output.status.code().unwrap(), out: text(output.stdout), error: text(output.stderr) }
}

pub fn read(path: PathBuf) -> Vec<f32> {
    let bytes = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

pub fn report(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("solve.json")).unwrap()).unwrap()
}

fn sum(values: &[f32]) -> f64 {
    values.iter().map(|&v| f64::from(v)).sum()
}

/// Solves a scene that must solve, and returns the named fields.
fn fields<const N: usize>(
    folder: &Path,
    scene: &Value,
    density: &[f32],
    light: &str,
    names: [&str; N],
    more: &[&str],
) -> [Vec<f32>; N] {
    let (scene, out) = (write_scene(folder, scene, density), folder.join("out"));
    let ran = solve(&scene, light, &out, more);
    assert_eq!(ran.code, 0, "{light}: {}", ran.error);
    let balance = report(&out)["energy_balance"].as_f64().unwrap();
    assert!(balance.abs() < BALANCE, "{light}: energy balance {balance}");
    names.map(|name| {
        let values = read(out.join(name));
        assert!(values.iter().all(|v| v.is_finite()), "{light}: {name}");
        values
    })
}

/// A residual of 1e-4 leaves some 1e-4 of the energy unaccounted for; single precision sums add a little.
const BALANCE: f64 = 1e-3;

#[test]
fn fields_and_pictures_have_the_scenes_dims_and_the_report_says_how_they_came_about() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), &scene(), &density());
    let out = folder.path().join("new/folder");
    let ran = solve(&scene, "inside", &out, &[]);
    assert_eq!((ran.code, ran.out.as_str()), (0, ""), "words go to standard error");
    assert!(ran.error.contains("residual") && ran.error.contains("energy balance"), "{}", ran.error);
    let mut names: Vec<String> =
        std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let wanted =
        ["image_eye.exr", "image_eye.f32", "image_top.exr", "image_top.f32", "jcam_top.f32", "phi_dir.f32"];
    assert_eq!(names, [&wanted[..], &["phi_sc.f32", "solve.json"]].concat());
    for name in ["phi_sc.f32", "phi_dir.f32", "jcam_top.f32"] {
        let field = read(out.join(name));
        assert_eq!(field.len(), CELLS);
        // Empty cells are filled like all others.
        assert!(field.iter().all(|&v| v.is_finite() && v > 0.0), "{name}");
    }
    for (name, width, pixels) in [("image_top", 8, 64), ("image_eye", 12, 96)] {
        let image = read(out.join(format!("{name}.f32")));
        assert_eq!(image.len(), pixels);
        assert!(image.iter().all(|&v| v.is_finite() && v >= 0.0) && sum(&image) > 0.0);
        let exr = exr::prelude::read_first_flat_layer_from_file(out.join(format!("{name}.exr"))).unwrap();
        assert_eq!(exr.layer_data.size.0, width);
        for channel in &exr.layer_data.channel_data.list {
            let values: Vec<f32> = channel.sample_data.values_as_f32().collect();
            assert_eq!(values, image, "{name}");
        }
    }
    let report = report(&out);
    assert_eq!(report["method"], "sweep");
    assert_eq!(report["directions"], 128);
    assert_eq!(report["dims_xyz"], json!(DIMS));
    assert!(report["residual"].as_f64().unwrap() <= 1e-4);
    assert!(report["energy_balance"].as_f64().unwrap().abs() < BALANCE);
    assert!(report["sweeps"].as_u64().unwrap() > 1 && report["seconds"].as_f64().unwrap() > 0.0);
    // The densest cell is 1.2 × .02 × 50 = 1.2 deep before delta scaling, 1.13 after it: four parts are .28 each.
    assert_eq!(report["refinement"], 4);
    let power = report["power_in_w"].as_f64().unwrap();
    assert!((power / (8.0 * std::f64::consts::PI) - 1.0).abs() < 1e-9, "4π × 2 W/sr, not {power} W");
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_scene(folder.path(), &scene(), &density());
    let bytes = |threads: &str| {
        let out = folder.path().join(threads);
        let mut command = Command::cargo_bin("squall").unwrap();
        command.env("RAYON_NUM_THREADS", threads).arg("solve").arg(&path).args(["--lamp", "inside", "-o"]);
        command.arg(&out).args(["--refine", "2"]).assert().success();
        ["phi_sc.f32", "phi_dir.f32", "jcam_top.f32", "image_top.f32", "image_eye.f32", "image_eye.exr"]
            .map(|name| std::fs::read(out.join(name)).unwrap())
    };
    let one = bytes("1");
    assert!(one == bytes("2") && one == bytes("8"));
}

#[test]
fn a_beam_through_a_periodic_layer_obeys_beer_and_lambert() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene();
    scene["boundary"] = json!("periodic_xy");
    scene["lights"] =
        json!([{ "name": "sun", "type": "beam", "direction": [0.6, 0.0, -0.8], "irradiance_W_per_m2": 5.0 }]);
    let [direct] = fields(folder.path(), &scene, &[0.5; CELLS], "sun", ["phi_dir.f32"], &["--refine", "1"]);
    // Extinction .01, cells 30 m high: .375 per layer along the beam. Chords in single precision.
    const ROUND_OFF: f64 = 1e-5;
    for (cell, value) in direct.iter().enumerate() {
        let above = (DIMS[2] - 1 - cell / (DIMS[0] * DIMS[1])) as f64 * 0.375;
        let wanted = 5.0 * libm::exp(-above) * (1.0 - libm::exp(-0.375)) / 0.375;
        assert!((f64::from(*value) / wanted - 1.0).abs() < ROUND_OFF, "cell {cell}: {value} for {wanted}");
    }
}

#[test]
fn a_lamp_on_a_face_an_edge_a_corner_or_a_centre_gives_what_its_neighbourhood_gives() {
    // Five centimetres change little, a per cent and a half where three sides are passed at once; a lamp counted in the wrong
    // cell, twice or not at all would show as a jump.
    const CONTINUITY: f64 = 0.03;
    let folder = tempfile::tempdir().unwrap();
    let places = [
        ("face", [0.0, 25.0, 545.0]),
        ("edge", [0.0, 0.0, 545.0]),
        ("corner", [0.0, 0.0, 530.0]),
        ("centre", [-20.0, 25.0, 545.0]),
        ("grid face", [-120.0, 25.0, 545.0]),
        ("grid corner", [-120.0, -100.0, 500.0]),
        ("base", [20.0, 25.0, 500.0]),
    ];
    for (name, place) in places {
        let at = |shift: f64| {
            let mut scene = scene();
            scene["lights"][0]["position_m"] = json!(place.map(|v: f64| v + shift));
            let names = ["phi_sc.f32", "phi_dir.f32", "image_top.f32"];
            fields(folder.path(), &scene, &density(), "inside", names, &["--refine", "2"])
        };
        let (exact, beside) = (at(0.0), at(0.05));
        for (a, b) in exact.iter().zip(&beside) {
            let share = sum(a) / sum(b);
            assert!((share - 1.0).abs() < CONTINUITY, "{name}: {share}");
            assert!(a.iter().all(|&v| v >= 0.0), "{name}");
        }
    }
}

#[test]
fn a_lamp_outside_lights_the_cloud_by_the_inverse_square() {
    let folder = tempfile::tempdir().unwrap();
    let at = |position: [f64; 3]| {
        let mut scene = scene();
        scene["lights"][1]["position_m"] = json!(position);
        let names = ["phi_sc.f32", "phi_dir.f32", "image_eye.f32"];
        fields(folder.path(), &scene, &density(), "below", names, &["--refine", "1"])
    };
    let (near, far) = (at([0.0, 0.0, 545.0 - 20_000.0]), at([0.0, 0.0, 545.0 - 60_000.0]));
    for (near, far) in near.iter().zip(&far) {
        // The cloud is 250 m across: a per cent of the nearer distance.
        assert!((sum(near) / sum(far) / 9.0 - 1.0).abs() < 0.01, "{}", sum(near) / sum(far));
    }
    // A millimetre under the base, and a metre: the light of the layer as a whole hardly changes.
    let (touching, under) = (at([20.0, 25.0, 500.0 - 1e-3]), at([20.0, 25.0, 499.0]));
    for (a, b) in touching.iter().zip(&under) {
        assert!((sum(a) / sum(b) - 1.0).abs() < 0.1, "{}", sum(a) / sum(b));
    }
}

#[test]
fn a_camera_inside_the_cloud_sees_what_one_beside_it_sees() {
    let folder = tempfile::tempdir().unwrap();
    let from = |origin: [f64; 3]| {
        let mut scene = scene();
        scene["cameras"] = json!([{ "name": "eye", "origin_m": origin, "direction": [1.0, 0.3, 0.1],
            "horizontal_fov_deg": 90.0, "width": 8, "height": 6 }]);
        let names = ["image_eye.f32"];
        let [image] = fields(folder.path(), &scene, &density(), "inside", names, &["--refine", "2"]);
        image
    };
    // On a cell's corner, and a centimetre off: no pixel may jump.
    let (corner, beside) = (from([-40.0, 0.0, 530.0]), from([-39.99, 0.01, 530.01]));
    for (a, b) in corner.iter().zip(&beside) {
        assert!(*a > 0.0 && (a / b - 1.0).abs() < 0.01, "{a} {b}");
    }
}

#[test]
fn cells_of_any_shape_describe_the_same_cloud() {
    // A homogeneous block, once in cubes and once in plates and posts: solved at the same sub-cells it is the same problem.
    const ROUND_OFF: f64 = 1e-4;
    let folder = tempfile::tempdir().unwrap();
    let with = |dims: [usize; 3], cell: Value, refine: &str| {
        let mut scene = scene();
        scene["dims_xyz"] = json!(dims);
        scene["cell_m"] = cell;
        let density = vec![0.4; dims.iter().product()];
        let names = ["phi_sc.f32", "jcam_top.f32"];
        fields(folder.path(), &scene, &density, "inside", names, &["--refine", refine])
    };
    let fine = with([12, 12, 6], json!(20.0), "1");
    let coarse = with([6, 6, 3], json!([40.0, 40.0, 40.0]), "2");
    for (fine, coarse) in fine.iter().zip(&coarse) {
        assert!((sum(fine) / sum(coarse) / 8.0 - 1.0).abs() < ROUND_OFF);
    }
    let plates = with([6, 6, 12], json!([40.0, 40.0, 10.0]), "2");
    // Sub-cells of 20 × 20 × 5 m against cubes of 20 m: the discretisation's own error.
    assert!((sum(&plates[0]) / sum(&coarse[0]) / 4.0 - 1.0).abs() < 0.02);
}

#[test]
fn empty_black_and_dark_scenes_are_answered() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["phi_sc.f32", "phi_dir.f32", "image_top.f32"];
    // Direct light is summed twice, with and without what was scattered forward; where nothing was, the two differ by round-off.
    const ROUND_OFF: f32 = 1e-6;
    let unscattered = |[scattered, direct, image]: [Vec<f32>; 3]| {
        assert!(scattered.iter().zip(&direct).all(|(&s, &d)| s >= 0.0 && s < ROUND_OFF * d));
        assert!(image.iter().all(|&v| v == 0.0));
    };
    unscattered(fields(folder.path(), &scene(), &[0.0; CELLS], "inside", names, &[]));
    let mut black = scene();
    black["albedo"] = json!(0.0);
    unscattered(fields(folder.path(), &black, &density(), "inside", names, &[]));
    let mut dark = scene();
    dark["lights"][0]["intensity_W_per_sr"] = json!(0.0);
    let all = fields(folder.path(), &dark, &density(), "inside", names, &["--refine", "1"]);
    assert!(all.iter().flatten().all(|&v| v == 0.0));
    let mut bare = scene();
    bare.as_object_mut().unwrap().remove("cameras");
    fields(folder.path(), &bare, &density(), "inside", ["phi_sc.f32"], &["--refine", "1"]);
}

/// Keys of a scene with values that are refused, and words of the refusal.
fn bad_values() -> Vec<(&'static str, Value, &'static str)> {
    vec![
        ("albedo", json!(1.01), "albedo: wanted 0 to 1, found 1.01"),
        ("albedo", json!(-0.1), "albedo"),
        ("g", json!(1.0), "g: wanted between -1 and 1"),
        ("g", json!(-1.0), "g: wanted between -1 and 1"),
        ("kappa_per_m", json!(-1.0), "kappa_per_m"),
        ("kappa_per_m", Value::Null, "kappa_per_m"),
        ("dims_xyz", json!([6, 0, 3]), "dims_xyz"),
        ("dims_xyz", json!([6, 5, 4]), "grid.f32: length: wanted 480 bytes"),
        ("dims_xyz", json!([60000, 60000, 60000]), "dims_xyz"),
        ("dims_xyz", json!([6, 5]), "line 1"),
        ("cell_m", json!(0.0), "cell"),
        ("cell_m", json!([40.0, -50.0, 30.0]), "cell"),
        ("boundary", json!("periodic"), "boundary"),
        ("density_file", json!("none.f32"), "none.f32"),
        ("density_file", Value::Null, "density_file"),
        ("extinction_file", json!("grid.f32"), "both"),
        ("lights", json!([]), "a scene with lights"),
        ("lights", json!([{ "name": "inside", "intensity_W_per_sr": 1.0 }]), "lights[0].position_m"),
        ("lights", json!([{ "name": "inside", "position_m": [0, 0, 0] }]), "lights[0].intensity_W_per_sr"),
        (
            "lights",
            json!([{ "name": "inside", "position_m": [0, 0, 0], "intensity_W_per_sr": -1.0 }]),
            "not negative, found -1",
        ),
        (
            "lights",
            json!([{ "name": "inside", "type": "beam", "direction": [0, 0, 0], "irradiance_W_per_m2": 1.0 }]),
            "a vector that is not zero",
        ),
        ("lights", json!([{ "name": "inside", "type": "area" }]), "\"point\" or \"beam\""),
        (
            "cameras",
            json!([{ "name": "a", "width": 0, "height": 8, "origin_m": [0, 0, 0], "direction": [1, 0, 0],
            "vertical_fov_deg": 40.0 }]),
            "picture size",
        ),
        (
            "cameras",
            json!([{ "name": "a/b", "width": 8, "height": 8, "origin_m": [0, 0, 0], "direction": [1, 0, 0],
            "vertical_fov_deg": 40.0 }]),
            "cameras[0].name",
        ),
        (
            "cameras",
            json!([{ "name": "a", "width": 8, "height": 8, "origin_m": [0, 0, 0], "direction": [1, 0, 0] }]),
            "vertical_fov_deg",
        ),
    ]
}

#[test]
fn bad_input_is_one_line_that_names_file_field_wanted_and_found() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let refused = |scene: &Path, words: &str| {
        let ran = solve(scene, "inside", &out, &[]);
        assert_eq!((ran.code, ran.out.as_str()), (3, ""), "{words}: {}", ran.error);
        assert!(ran.error.contains(words) && ran.error.lines().count() == 1, "{words}: {}", ran.error);
        assert!(!out.exists(), "{words}: nothing is left behind");
    };
    for (key, value, words) in bad_values() {
        let mut scene = scene();
        scene[key] = value;
        refused(&write_scene(folder.path(), &scene, &density()), words);
    }
    let mut twice = scene();
    twice["lights"][1]["name"] = json!("inside");
    refused(&write_scene(folder.path(), &twice, &density()), "a name of its own");
    let mut dense = scene();
    dense["kappa_per_m"] = json!(1e10);
    refused(&write_scene(folder.path(), &dense, &density()), "extinction: wanted at most 100000, 1/m");
    dense["kappa_per_m"] = json!(10.0);
    refused(&write_scene(folder.path(), &dense, &[1e30; CELLS]), "extinction: wanted at most 100000, 1/m");
    let good = write_scene(folder.path(), &dense, &[9e3; CELLS]);
    refused(&good, "extinction: wanted cells of optical depth up to 10000");
    for (bad, words) in [(f32::NAN, "value 7"), (f32::INFINITY, "value 7"), (-0.5, "value 7")] {
        let mut grid = density();
        grid[7] = bad;
        refused(&write_scene(folder.path(), &scene(), &grid), words);
    }
    refused(&write_scene(folder.path(), &scene(), &[]), "length");
    refused(&write_scene(folder.path(), &scene(), &density()[..CELLS - 1]), "length");
    let mut shape = scene();
    shape["density_file"] = Value::Null;
    shape["analytic_shape"] = json!({ "type": "sphere", "radius_m": 100.0 });
    refused(&write_scene(folder.path(), &shape, &density()), "an analytic shape and no grid");
    std::fs::write(&good, "{\"dims_xyz\": [6, 5,").unwrap();
    refused(&good, "line 1");
    std::fs::write(&good, "").unwrap();
    refused(&good, "line 1");
    refused(&folder.path().join("none.json"), "none.json");
}

#[test]
fn an_unknown_lamp_is_answered_with_the_names_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), &scene(), &density());
    let ran = solve(&scene, "above", &folder.path().join("out"), &[]);
    assert_eq!(ran.code, 3);
    assert!(ran.error.contains("wanted \"inside\" or \"below\", found \"above\""), "{}", ran.error);
    assert!(!folder.path().join("out").exists());
    assert_eq!(solve(&scene, "inside", &folder.path().join("out"), &["--method", "guess"]).code, 2);
    assert_eq!(solve(&scene, "inside", &folder.path().join("out"), &["--refine", "0"]).code, 2);
    let huge = solve(&scene, "inside", &folder.path().join("out"), &["--refine", "64"]);
    assert_eq!(huge.code, 3, "{}", huge.error);
    assert!(huge.error.contains("solve grid"), "{}", huge.error);
    let stuck = solve(&scene, "inside", &folder.path().join("out"), &["--refine", "1", "--max-sweeps", "4"]);
    assert_eq!(stuck.code, 1);
    assert!(stuck.error.contains("residual") && !folder.path().join("out").exists(), "{}", stuck.error);
}

#[test]
fn an_output_folder_that_the_system_refuses_exits_4() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), &scene(), &density());
    let file = folder.path().join("file");
    std::fs::write(&file, "keep me").unwrap();
    for out in [file.clone(), file.join("below"), PathBuf::from("/proc/nowhere/at/all")] {
        let ran = solve(&scene, "inside", &out, &["--refine", "1"]);
        assert_eq!(ran.code, 4, "{}: {}", out.display(), ran.error);
        assert_eq!(ran.error.lines().count(), 1, "{}", ran.error);
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"keep me");
}

#[cfg(unix)]
#[test]
fn an_interruption_leaves_nothing_and_exits_130() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene();
    scene["dims_xyz"] = json!([40, 40, 40]);
    let scene = write_scene(folder.path(), &scene, &vec![1.0; 64_000]);
    let out = folder.path().join("out");
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("squall"))
        .args(["solve", scene.to_str().unwrap(), "--lamp", "inside", "-o", out.to_str().unwrap()])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // The folder is there once the inputs are read; the solve itself takes minutes.
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
