//! `squall relight` from outside: what an asset's rows make of lamps, against the slow truth and against itself.

use assert_cmd::Command;
use glam::DVec3;
use serde_json::{Value, json};
use squall_bake::cloud::{TruthSettings, solve_light};
use squall_bake::fields::{Fields, orthographic};
use squall_bake::input::scene::{Optics, read_scene};
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::Tag;
use squall_formats::container::{self, Directory};
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::quadrature::Quadrature;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

const DIMS: [usize; 3] = [12, 10, 4];
const CELLS: usize = DIMS[0] * DIMS[1] * DIMS[2];
/// A node of the lamp grid inside the cloud, one below it, and a place between nodes.
const NODES: [[f64; 3]; 2] = [[0.0, 40.0, 80.0], [-80.0, 40.0, -80.0]];
const BETWEEN: [f64; 3] = [31.0, -22.0, 55.0];
/// Below everything that was baked.
const OUTSIDE: [f64; 3] = [60.0, 10.0, -400.0];

/// A scene and two assets baked from it: rows with direct light in 26 directions, rows without in harmonics.
struct Baked {
    folder: tempfile::TempDir,
}

impl Baked {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

fn cameras() -> [Value; 2] {
    [
        json!({ "name": "top", "type": "orthographic", "target_m": [0.0, 0.0, 80.0], "direction": [0.0, 0.0, -1.0],
            "up": [0.0, 1.0, 0.0], "half_width_m": 300.0, "half_height_m": 300.0, "width": 12, "height": 12 }),
        json!({ "name": "eye", "type": "perspective", "origin_m": [700.0, -900.0, -300.0], "target_m": [0.0, 0.0, 80.0],
            "up": [0.0, 0.0, 1.0], "vertical_fov_deg": 30.0, "width": 16, "height": 8 }),
    ]
}

fn baked() -> &'static Baked {
    static BAKED: OnceLock<Baked> = OnceLock::new();
    BAKED.get_or_init(|| {
        let baked = Baked { folder: tempfile::tempdir().unwrap() };
        let density = (0..CELLS).map(|i| if i % 5 == 2 { 0.0 } else { 0.1 + ((i * 37) % 11) as f32 / 20.0 });
        let bytes: Vec<u8> = density.flat_map(|v: f32| v.to_le_bytes()).collect();
        std::fs::write(baked.path("grid.f32"), bytes).unwrap();
        let scene = json!({
            "dims_xyz": DIMS, "cell_m": 40.0, "origin_m": [-240.0, -200.0, 0.0], "density_file": "grid.f32",
            "kappa_per_m": 0.02, "albedo": 0.99, "g": 0.5, "cameras": cameras(),
        });
        std::fs::write(baked.path("scene.json"), scene.to_string()).unwrap();
        for (name, channels, direct) in
            [("rows", "directions-26", "rows"), ("late", "harmonics-3", "run-time")]
        {
            let recipe = format!(
                "[clouds]\nscene = \"scene.json\"\n[clouds.lightning]\nlow_m = [-240.0, -200.0, -160.0]\n\
                 high_m = [240.0, 200.0, 160.0]\nspacing_m = 80.0\nlongest_m = 80.0\n[clouds.transport]\n\
                 directions = \"2x8\"\ntolerance = 1e-5\n[clouds.response]\nchannels = \"{channels}\"\n\
                 direct = \"{direct}\"\nerror = {CODEC}\ntest_strokes = 0\n"
            );
            std::fs::write(baked.path("recipe.toml"), recipe).unwrap();
            let recipe = Recipe::read(&baked.path("recipe.toml")).unwrap();
            let sections = pipeline::bake(&recipe, &Quiet).unwrap().sections;
            let path = baked.path(&format!("{name}.squall"));
            container::write(&mut std::fs::File::create(path).unwrap(), &sections).unwrap();
        }
        baked
    })
}

/// Pixels beside a lamp get more rays than others, and where density jumps within a pixel wider than a cell, as here, a few
/// hundred rays and a few thousand differ by this.
const PICTURES: f64 = 0.01;
/// Light that the codec may lose, relative to all of a lamp's light.
const CODEC: f64 = 0.002;

struct Relit {
    code: i32,
    error: String,
    folder: tempfile::TempDir,
}

impl Relit {
    fn read(&self, name: &str) -> Vec<f32> {
        let bytes = std::fs::read(self.folder.path().join("field").join(name)).unwrap();
        let values: Vec<f32> =
            bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        assert!(values.iter().all(|v| v.is_finite()), "{name}");
        values
    }

    fn report(&self) -> Value {
        serde_json::from_slice(&std::fs::read(self.folder.path().join("field/relight.json")).unwrap())
            .unwrap()
    }
}

fn light(position: [f64; 3], intensity: f64) -> Value {
    json!({ "position_m": position, "intensity_W_per_sr": intensity, "name": "x", "type": "stroke", "note": 3 })
}

fn run(asset: &Path, lights: &str, camera: &str, out: &str, more: &[&str]) -> Relit {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let (lights, camera) = (file("lamps.json", lights), file("camera.json", camera));
    let mut command = Command::cargo_bin("squall").unwrap();
    command.arg("relight").arg(asset).arg("--lamps").arg(lights).arg("--camera").arg(camera);
    command.arg("-o").arg(folder.path().join(out)).arg("--field").arg(folder.path().join("field")).args(more);
    let output = command.output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    Relit { code: output.status.code().unwrap(), error, folder }
}

fn relight(asset: &str, lights: &[Value], camera: usize, more: &[&str]) -> Relit {
    let asset = baked().path(&format!("{asset}.squall"));
    let relit = run(&asset, &json!(lights).to_string(), &cameras()[camera].to_string(), "image.exr", more);
    assert_eq!(relit.code, 0, "{}", relit.error);
    relit
}

/// √Σ(a − b)² / √Σb².
fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let square =
        |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v) * f64::from(v)).sum::<f64>();
    (square(&mut a.iter().zip(b).map(|(x, y)| x - y)) / square(&mut b.iter().copied())).sqrt()
}

/// The slow truth with the discretisation that the assets were baked with.
fn solve(position: [f64; 3], intensity: f64, samples: u32) -> Fields {
    let scene = read_scene(&baked().path("scene.json"), Optics::default()).unwrap();
    let mut settings = TruthSettings { refine: 1, samples, high_degree: false, ..TruthSettings::default() };
    settings.solve.quadrature = Quadrature::DoubleGauss { polar: 2, azimuths: 8 };
    settings.solve.tolerance = 1e-5;
    let towards: Vec<DVec3> = orthographic(&scene.cameras).map(|(_, camera)| -camera.forward).collect();
    let light = Light::Point { position: DVec3::from_array(position), intensity };
    let truth = solve_light(&scene.cloud, light, &towards, &settings, &Quiet).unwrap();
    Fields::of_truth(&truth, &scene.cameras, &Quiet).unwrap()
}

#[test]
fn at_a_node_of_the_lamp_grid_relighting_is_solving_but_for_the_codec() {
    // Scattered light is a part of what the codec's budget is relative to, a third here at the least. Rows hold direct
    // light as means per cell, which pictures show; the truth follows it ray by ray.
    const SCATTERED: f64 = 5.0 * CODEC;
    const CELL_MEANS: f64 = 0.25;
    // Rows were traced with one ray through each face, which leaves 3 % of scattered light for the lamp below.
    const RAYS_OF_ROWS: f64 = 0.03;
    const ROUND_OFF: f64 = 1e-5;
    for node in NODES {
        let (as_baked, fine) = (solve(node, 3.0, 1), solve(node, 3.0, 0));
        for (asset, direct) in [("rows", "rows"), ("rows", "lamps"), ("late", "lamps")] {
            for camera in 0..2 {
                let relit = relight(asset, &[light(node, 3.0)], camera, &["--direct", direct]);
                let case = format!("{asset} {direct} {node:?}");
                let report = relit.report();
                assert_eq!(report["sources"], 1, "{case}");
                assert!(report["error_bound"].as_f64().unwrap() < 2.0 * CODEC, "{case}: {report}");
                let close = |name: &str, wanted: &[f32], tolerance: f64| {
                    let off = distance(&relit.read(name), wanted);
                    assert!(off < tolerance, "{case} {name}: {off}");
                };
                let rows = direct == "rows";
                let truth = if rows { &as_baked } else { &fine };
                let scattered = if rows { SCATTERED } else { SCATTERED + RAYS_OF_ROWS };
                close("phi_sc.f32", &truth.phi_scattered.mean, scattered);
                close("phi_dir.f32", &truth.phi_direct.mean, ROUND_OFF);
                let (name, _, image) = &truth.images[camera];
                close(&format!("image_{name}.f32"), &image.mean, if rows { CELL_MEANS } else { scattered });
                if camera == 0 {
                    close("jcam_top.f32", &truth.towards[0].1.mean, scattered);
                }
            }
        }
    }
}

#[test]
fn light_adds_up_and_grows_with_intensity() {
    // Single precision over some thirty additions.
    const ROUND_OFF: f64 = 1e-5;
    for asset in ["rows", "late"] {
        for camera in 0..2 {
            let name = ["image_top.f32", "image_eye.f32"][camera];
            let (a, b) = (light(BETWEEN, 2.0), light(NODES[1], 7.0));
            let one = |lights: &[Value]| relight(asset, lights, camera, &[]).read(name);
            let (first, second, both) =
                (one(std::slice::from_ref(&a)), one(std::slice::from_ref(&b)), one(&[a, b]));
            let sum: Vec<f32> = first.iter().zip(&second).map(|(x, y)| x + y).collect();
            let off = distance(&both, &sum);
            assert!(off < PICTURES, "{asset} {name}: {off}");
            let brighter: Vec<f32> = first.iter().map(|x| x * 5.0).collect();
            assert!(distance(&one(&[light(BETWEEN, 10.0)]), &brighter) < ROUND_OFF, "{asset} {name}");
        }
    }
    let dark = relight("late", &[], 1, &[]).read("image_eye.f32");
    assert!(dark.iter().all(|&v| v == 0.0));
}

#[test]
fn lamps_beyond_what_was_baked_are_solved_for_and_it_is_said() {
    // The same equations in another order of sums; residuals of 1e-5 each.
    const ROUND_OFF: f64 = 1e-4;
    let truth = solve(OUTSIDE, 3.0, 0);
    for asset in ["rows", "late"] {
        let far = relight(asset, &[light(OUTSIDE, 3.0)], 0, &[]);
        assert!(
            far.error.starts_with("note: 1 of 1 lamps lie outside")
                && far.error.matches("note:").count() == 1,
            "{}",
            far.error
        );
        assert!(distance(&far.read("phi_sc.f32"), &truth.phi_scattered.mean) < ROUND_OFF);
        assert!(distance(&far.read("phi_dir.f32"), &truth.phi_direct.mean) < ROUND_OFF);
        assert!(distance(&far.read("jcam_top.f32"), &truth.towards[0].1.mean) < ROUND_OFF);
        assert!(distance(&far.read("image_top.f32"), &truth.images[0].2.mean) < 10.0 * ROUND_OFF);
        let report = far.report();
        assert_eq!((&report["lamps_outside"], &report["sources"]), (&json!(1), &json!(0)));
        assert!(report["live"]["sweeps"].as_u64().unwrap() > 1);

        let mixed = relight(asset, &[light(OUTSIDE, 3.0), light(NODES[0], 1.0)], 0, &[]);
        let near = relight(asset, &[light(NODES[0], 1.0)], 0, &[]);
        assert!(!near.error.contains("note:"), "{}", near.error);
        for name in ["phi_sc.f32", "phi_dir.f32", "jcam_top.f32", "image_top.f32"] {
            let sum: Vec<f32> = far.read(name).iter().zip(near.read(name)).map(|(x, y)| x + y).collect();
            let tolerance = if name == "image_top.f32" { PICTURES } else { ROUND_OFF };
            let off = distance(&mixed.read(name), &sum);
            assert!(off < tolerance, "{asset} {name}: {off}");
        }
    }
}

#[test]
fn pictures_and_fields_are_the_same_bytes_for_any_number_of_threads() {
    let baked = baked();
    let write = |name: &str, value: Value| {
        let path = baked.path(name);
        std::fs::write(&path, value.to_string()).unwrap();
        path
    };
    // Enough lamps and pixels that direct light becomes means per cell.
    let lights: Vec<Value> =
        (0..70).map(|i| light([f64::from(i) * 6.0 - 196.0, 20.0, f64::from(i) - 20.0], 0.1)).collect();
    let mut camera = cameras()[1].clone();
    (camera["width"], camera["height"]) = (json!(80), json!(60));
    let (lights, camera) = (write("many.json", json!(lights)), write("eye.json", camera));
    let bytes = |threads: &str| {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::cargo_bin("squall").unwrap();
        command.env("RAYON_NUM_THREADS", threads).arg("relight").arg(baked.path("late.squall"));
        command.arg("--lamps").arg(&lights).arg("--camera").arg(&camera).arg("-o");
        command.arg(folder.path().join("a.png")).arg("--field").arg(folder.path()).assert().success();
        ["a.png", "image_eye.exr", "phi_sc.f32", "phi_dir.f32"]
            .map(|f| std::fs::read(folder.path().join(f)).unwrap())
    };
    let one = bytes("1");
    assert!(one == bytes("2") && one == bytes("5"));
    let pixels = png::Decoder::new(std::io::Cursor::new(&one[0])).read_info().unwrap();
    assert_eq!((pixels.info().width, pixels.info().height), (80, 60));
}

#[test]
fn bad_lamps_cameras_assets_and_names_are_one_line_and_exit_3() {
    let asset = baked().path("late.squall");
    let (good_lamp, good_camera) = (json!([light(NODES[0], 1.0)]).to_string(), cameras()[0].to_string());
    let refused = |asset: &Path, lights: &str, camera: &str, out: &str, more: &[&str], words: &str| {
        let relit = run(asset, lights, camera, out, more);
        assert_eq!(relit.code, 3, "{words}: {}", relit.error);
        assert!(relit.error.contains(words) && relit.error.lines().count() == 1, "{words}: {}", relit.error);
        assert!(
            !relit.folder.path().join("field").exists() && !relit.folder.path().join(out).exists(),
            "{words}"
        );
    };
    for (lights, words) in [
        ("", "line 1"),
        ("{}", "a list of lamps"),
        ("[{\"position_m\": [0, 0]}]", "line 1"),
        ("[{\"intensity_W_per_sr\": 1}]", "[0].position_m"),
        ("[{\"position_m\": [0, 0, 0]}]", "[0].intensity_W_per_sr"),
        ("[{\"position_m\": [0, 0, 0], \"intensity_W_per_sr\": -2}]", "not negative"),
        ("[{\"position_m\": [0, 0, 1e999], \"intensity_W_per_sr\": 1}]", "line 1"),
    ] {
        refused(&asset, lights, &good_camera, "a.exr", &[], words);
    }
    for (key, value, words) in [
        ("width", json!(0), "picture size"),
        ("type", json!("fisheye"), "\"perspective\" or \"orthographic\""),
        ("direction", json!([0.0, 0.0, 0.0]), "direction"),
        ("half_width_m", json!(-1.0), "half width"),
        ("name", json!("../up"), "part of a file's name"),
    ] {
        let mut camera = cameras()[0].clone();
        camera[key] = value;
        refused(&asset, &good_lamp, &camera.to_string(), "a.exr", &[], words);
    }
    refused(&asset, &good_lamp, &good_camera, "a.jpg", &[], ".png or .exr");
    refused(
        &asset,
        &good_lamp,
        &good_camera,
        "a.exr",
        &["--direct", "rows"],
        "the asset's rows hold no direct light",
    );
    refused(&baked().path("none.squall"), &good_lamp, &good_camera, "a.exr", &[], "none.squall");
    refused(&baked().path("scene.json"), &good_lamp, &good_camera, "a.exr", &[], "scene.json");

    let bytes = std::fs::read(&asset).unwrap();
    let directory = Directory::read(&bytes, &Default::default()).unwrap();
    let rows = directory.find(Tag(*b"CLRT")).unwrap();
    let mut damaged = bytes.clone();
    // Every row: in the middle of the bulk, one byte in each hundred.
    for at in (rows.offset + rows.length / 2..rows.offset + rows.length).step_by(100) {
        damaged[at as usize] ^= 1;
    }
    std::fs::write(baked().path("damaged.squall"), damaged).unwrap();
    let every: Vec<Value> =
        (0..7).map(|i| light([-200.0 + 70.0 * f64::from(i), 190.0, 150.0], 1.0)).collect();
    let every = json!(every).to_string();
    refused(&baked().path("damaged.squall"), &every, &good_camera, "a.exr", &[], "checksum");
}

#[test]
fn a_comparison_finds_the_assets_light_right_and_single_scattering_too_dark() {
    // Rows were solved with a fourth of the directions and coded; a node has no error of splitting.
    const ROWS: f64 = 0.1;
    let folder = tempfile::tempdir().unwrap();
    let beside = folder.path().join("beside");
    let place = beside.to_str().unwrap();
    let relit = relight("late", &[light(NODES[0], 3.0)], 1, &["--compare", place]);
    let report: Value = serde_json::from_slice(&std::fs::read(beside.join("compare.json")).unwrap()).unwrap();
    let number = |of: &str, what: &str| report[of][what].as_f64().unwrap();
    for of in ["whole", "scattered_again", "fluence"] {
        assert!(number(of, "l2") < ROWS && number(of, "median") < ROWS, "{of}: {report}");
    }
    assert!(number("single", "mean") < -0.2 && number("single", "l2") > number("whole", "l2"), "{report}");
    for name in report["files"].as_array().unwrap() {
        let bytes = std::fs::read(beside.join(name.as_str().unwrap())).unwrap();
        assert!(!bytes.is_empty(), "{name}");
    }
    assert!(relit.error.contains("single scattering alone"), "{}", relit.error);
    assert_eq!(report["section"]["across"], "y");
}

#[test]
fn a_comparison_replaces_neither_what_is_read_nor_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    let lamps = json!([light(NODES[0], 3.0)]).to_string();
    put("compare.json", lamps.clone());
    put("camera.json", cameras()[1].to_string());
    let run = |lamps: &str, out: &str| {
        let mut command = Command::cargo_bin("squall").unwrap();
        command.current_dir(folder.path()).arg("relight").arg(baked().path("late.squall"));
        command.args(["--lamps", lamps, "--camera", "camera.json", "--compare", ".", "-o", out]);
        let output = command.output().unwrap();
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    };
    let (code, error) = run("compare.json", "image.png");
    assert!(code == Some(3) && error.contains("compare.json"), "{code:?} {error}");
    assert_eq!(std::fs::read_to_string(folder.path().join("compare.json")).unwrap(), lamps);
    put("lamps.json", lamps);
    let (code, error) = run("lamps.json", "single.png");
    assert!(code == Some(3) && error.contains("single.png"), "{code:?} {error}");
    assert!(!folder.path().join("single.png").exists());
}
