//! Inputs as people hand them in: typing errors, foreign formats, marks and names that editors leave, files without end.

use assert_cmd::Command;
use squall_bake::progress::Progress;
use squall_bake::{pipeline, recipe::Recipe};
use squall_formats::section::provenance::ProvenanceSection;
use squall_formats::section::streak::StreakSection;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A scene with the golden keys, of 3 × 2 × 2 cells, with `more` keys in front.
fn scene(more: &str) -> String {
    format!(
        r#"{{{more}"dims_xyz": [3, 2, 2], "cell_m": 50.0, "origin_m": [0, 0, 0], "density_file": "grid.f32",
        "kappa_per_m": 0.02, "albedo": 0.9, "g": 0.5,
        "lights": [{{"name": "in", "position_m": [70, 40, 30], "intensity_W_per_sr": 1.0}}],
        "cameras": [{{"origin_m": [0, -500, 50], "target_m": [75, 50, 50], "horizontal_fov_deg": 40, "width": 4, "height": 4}}]}}"#
    )
}

fn write_grid(folder: &Path, values: impl Iterator<Item = f32>) {
    std::fs::write(folder.join("grid.f32"), values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>()).unwrap();
}

/// Exit code, output and errors of the command, run in `folder`.
fn squall(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let run = Command::cargo_bin("squall").unwrap().current_dir(folder).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (run.status.code().unwrap(), text(&run.stdout), text(&run.stderr))
}

/// The scattered light of a scene with these keys and this grid.
fn solved(more: &str, values: &[f32]) -> Result<Vec<u8>, String> {
    let folder = tempfile::tempdir().unwrap();
    write_grid(folder.path(), values.iter().copied());
    std::fs::write(folder.path().join("s.json"), scene(more)).unwrap();
    let (code, _, error) = squall(folder.path(), &["solve", "s.json", "--lamp", "in", "-o", "out"]);
    if code != 0 {
        assert_eq!((code, error.lines().count()), (3, 1), "{error}");
        return Err(error);
    }
    Ok(std::fs::read(folder.path().join("out/phi_sc.f32")).unwrap())
}

const VALUES: [f32; 12] = [0.1, 0.9, 0.3, 0.0, 0.5, 1.0, 0.2, 0.8, 0.7, 0.4, 0.6, 0.05];

#[test]
fn an_unknown_key_of_a_json_input_is_refused_with_the_nearest() {
    for (typo, near) in [("boundry", "boundary"), ("albdo", "albedo"), ("orign_m", "origin_m")] {
        let error = solved(&format!("\"{typo}\": 1,"), &VALUES).unwrap_err();
        assert!(error.contains(&format!("nearest is `{near}`")) && error.contains("s.json"), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    for (file, text, near) in [
        ("lamp.json", r#"[{"position_m": [0, 0, 1], "intensty_W_per_sr": 1}]"#, "intensity_W_per_sr"),
        ("camera.json", r#"{"origin_m": [0,0,1], "targt_m": [0,1,1], "width": 4, "height": 4}"#, "target_m"),
    ] {
        std::fs::write(folder.path().join(file), text).unwrap();
        let path = folder.path().join(file);
        let error = match file {
            "lamp.json" => squall_bake::input::scene::read_lights(&path).unwrap_err(),
            _ => squall_bake::input::scene::read_camera(&path).unwrap_err(),
        };
        assert!(error.to_string().contains(near) && error.exit_code() == 3, "{error}");
    }
}

#[test]
fn descriptive_keys_stay_and_facts_in_words_are_obeyed_or_refused() {
    let plain = solved("", &VALUES).unwrap();
    let words = r#""name": "a", "note": "b", "units": "metres; sigma_t in 1/m", "interpolation": "nearest, zero outside",
        "index": "x + nx*(y + ny*z), x fastest, little-endian float32", "sigma_t_max_per_m": 0.02, "#;
    assert!(solved(words, &VALUES).unwrap() == plain);
    // The same cloud, written with z fastest.
    let turned: Vec<f32> = (0..12).map(|i| VALUES[i / 4 + 3 * (i / 2 % 2 + 2 * (i % 2))]).collect();
    assert!(
        turned != VALUES && solved("\"index\": \"z + nz*(y + ny*x), z fastest\",", &turned).unwrap() == plain
    );
    for (more, word) in [
        ("\"index\": \"y fastest\",", "index"),
        ("\"units\": \"kilometres\",", "units"),
        ("\"interpolation\": \"trilinear\",", "interpolation"),
        ("\"sigma_t_max_per_m\": 0.2,", "sigma_t_max_per_m"),
    ] {
        let error = solved(more, &VALUES).unwrap_err();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn extinction_is_bounded_and_density_may_have_any_unit() {
    let plain = solved("", &VALUES).unwrap();
    // kg/m³ and m²/kg in place of shares and 1/m.
    let folder = tempfile::tempdir().unwrap();
    let light = |kappa: &str, factor: f32| {
        write_grid(folder.path(), VALUES.iter().map(|v| v * factor));
        let text = scene("").replace("\"kappa_per_m\": 0.02", &format!("\"kappa_per_m\": {kappa}"));
        std::fs::write(folder.path().join("s.json"), text).unwrap();
        squall(folder.path(), &["solve", "s.json", "--lamp", "in", "-o", "out"])
    };
    let (code, _, error) = light("163.84", 0.02 / 163.84);
    assert_eq!(code, 0, "{error}");
    let found = std::fs::read(folder.path().join("out/phi_sc.f32")).unwrap();
    /// Single precision of density times kappa, through a solve to 10⁻⁴.
    const ROUND_OFF: f32 = 1e-3;
    for (a, b) in plain.chunks_exact(4).zip(found.chunks_exact(4)) {
        let [a, b] = [a, b].map(|v| f32::from_le_bytes(v.try_into().unwrap()));
        assert!((a - b).abs() <= ROUND_OFF * a.abs(), "{a} {b}");
    }
    for kappa in ["1e9", "1e308"] {
        let (code, _, error) = light(kappa, 1.0);
        assert!(code == 3 && error.contains("extinction") && error.contains("kappa_per_m"), "{error}");
    }
    assert!(light("-1", 1.0).2.contains("kappa_per_m"));
}

#[test]
fn a_foreign_format_is_named_by_its_magic_number_wherever_it_is_handed_in() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("s.json"), scene("")).unwrap();
    std::fs::write(path.join("r.toml"), "[town]\nfile = \"t.json\"\n").unwrap();
    std::fs::write(path.join("c.toml"), "[clouds]\nscene = \"s.json\"\n").unwrap();
    let files: [(&str, &[u8]); 5] = [
        ("an OpenVDB file", b"\x20BDV\0\0\0\0\xe0\0\0\0\0\0\0\0"),
        ("a NumPy array", b"\x93NUMPY\x01\0v\0{'descr': '<f4', 'fortran_order': False}"),
        ("an OpenEXR picture", b"\x76\x2f\x31\x01\x02\0\0\0"),
        ("a zip archive", b"PK\x03\x04\x14\0\0\0\x08\0"),
        ("a gzip file", b"\x1f\x8b\x08\0\0\0\0\0\0\xff"),
    ];
    for (kind, bytes) in files {
        for name in ["x", "t.json", "grid.f32"] {
            std::fs::write(path.join(name), bytes).unwrap();
        }
        let calls: [&[&str]; 8] = [
            &["inspect", "x"],
            &["verify", "x"],
            &["render", "x", "-o", "x.png"],
            &["bake", "x", "-o", "x.squall"],
            &["bake", "r.toml", "-o", "x.squall"],
            &["bake", "c.toml", "-o", "x.squall"],
            &["solve", "x", "--lamp", "in", "-o", "out"],
            &["streaks", "fit", "x"],
        ];
        // Where a kind is read, it is refused for what it lacks: pictures as streaks, two kinds of grids.
        let read = |call: &[&str]| match kind {
            "an OpenEXR picture" => call[0] == "streaks",
            "an OpenVDB file" | "a NumPy array" => call[1] == "c.toml",
            _ => false,
        };
        for call in calls.iter().filter(|call| !read(call)) {
            let (code, _, error) = squall(path, call);
            assert!(
                code == 3 && error.contains(kind) && error.lines().count() == 1,
                "{call:?} {code}: {error}"
            );
        }
    }
    std::fs::write(path.join("x"), scene("")).unwrap();
    assert!(squall(path, &["bake", "x", "-o", "x.squall"]).2.contains("JSON"));
    assert!(squall(path, &["inspect", "x"]).2.contains("JSON"));
    assert!(squall(path, &["solve", "r.toml", "--lamp", "in", "-o", "out"]).2.contains("TOML"));
    assert!(!path.join("x.squall").exists() && !path.join("out").exists());
}

#[test]
fn a_byte_order_mark_is_skipped_and_text_that_is_no_utf8_is_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    write_grid(path, VALUES.into_iter());
    std::fs::write(path.join("s.json"), format!("\u{feff}{}", scene(""))).unwrap();
    let (code, _, error) = squall(path, &["solve", "s.json", "--lamp", "in", "-o", "out"]);
    assert_eq!(code, 0, "{error}");
    let stroke = "[[strokes]]\nname = \"a\"\nseed = 1\nfrom_m = [0.0, 0.0, 100.0]\nto_m = [9.0, 9.0, 99.0]\n\
        intensity_W_per_sr = 1.0\n";
    std::fs::write(path.join("r.toml"), format!("\u{feff}{stroke}")).unwrap();
    assert_eq!(squall(path, &["bake", "r.toml", "-o", "r.squall"]).0, 0);
    std::fs::write(path.join("t.toml"), "[town]\nfile = \"t.json\"\n").unwrap();
    std::fs::write(path.join("t.json"), b"{\"note\": \"caf\xe9\"}").unwrap();
    let (code, _, error) = squall(path, &["bake", "t.toml", "-o", "t.squall"]);
    assert!(code == 3 && error.contains("t.json") && error.contains("UTF-8"), "{code} {error}");
}

/// Time within which a file without end is refused, reading at most 64 MiB of it.
const AT_ONCE: Duration = Duration::from_secs(10);

#[test]
#[cfg(unix)]
fn files_without_end_are_refused_at_once() {
    if !Path::new("/dev/zero").exists() {
        println!("skipped: no /dev/zero here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("s.json"), scene("").replace("grid.f32", "/dev/zero")).unwrap();
    // Sparse: nothing of it is on the disk.
    std::fs::File::create(path.join("huge.toml")).unwrap().set_len(3 << 30).unwrap();
    let calls: [&[&str]; 8] = [
        &["bake", "/dev/zero", "-o", "x.squall"],
        &["bake", "huge.toml", "-o", "x.squall"],
        &["inspect", "/dev/zero"],
        &["verify", "/dev/zero"],
        &["solve", "/dev/zero", "--lamp", "in", "-o", "out"],
        &["solve", "s.json", "--lamp", "in", "-o", "out"],
        &["streaks", "fit", "/dev/zero"],
        &["streaks", "fit", "/dev/urandom"],
    ];
    for call in calls {
        let start = Instant::now();
        let (code, _, error) = squall(path, call);
        assert!(code == 3 && error.lines().count() == 1, "{call:?} {code}: {error}");
        assert!(start.elapsed() < AT_ONCE, "{call:?} took {:?}", start.elapsed());
    }
}

#[test]
fn documented_ends_of_the_view_are_inside_and_messages_use_the_recipes_units() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |view: &str| {
        std::fs::write(
            folder.path().join("r.toml"),
            format!(
                "[view]\nposition_m = [0.0, 0.0, 2.0]\n{view}\n[[strokes]]\nname = \"a\"\nseed = 1\nfrom_m = [0.0, 0.0, 100.0]\n\
                 to_m = [9.0, 9.0, 99.0]\nintensity_W_per_sr = 1.0\n"
            ),
        )
        .unwrap();
        squall(folder.path(), &["bake", "r.toml", "-o", "r.squall"])
    };
    for view in [
        "heading_deg = 0\n[view.sky]\nsun_elevation_deg = -17.0",
        "heading_deg = 0\n[view.sky]\nsun_elevation_deg = 90",
        "heading_deg = 0\npitch_deg = -90",
        "heading_deg = 0\npitch_deg = 90",
        "heading_deg = 0\nvertical_fov_deg = 0.06",
        "heading_deg = 0\nvertical_fov_deg = 179.3",
        "heading_deg = 0\nexposure_ms = 0.001",
        "heading_deg = 0\nexposure_ms = 10000",
        "heading_deg = -5729.5",
        "heading_deg = 5729.5",
    ] {
        let (code, _, error) = bake(view);
        assert_eq!(code, 0, "{view}: {error}");
    }
    for (view, words) in [
        ("heading_deg = 5730.0", ["view.heading_deg", "5729.5 degrees"]),
        ("heading_deg = 0\npitch_deg = 91", ["view.pitch_deg", "90 degrees"]),
        ("heading_deg = 0\nexposure_ms = 1e5", ["view.exposure_ms", "10000 ms"]),
        (
            "heading_deg = 0\n[view.sky]\nsun_elevation_deg = -18",
            ["view.sky.sun_elevation_deg", "-17 to 90 degrees"],
        ),
        ("heading_deg = 0\n[view.sky]\nsun_azimuth_deg = 1e5", ["view.sky.sun_azimuth_deg", "degrees"]),
        ("heading_deg = 0\n[view.rain]\nradius_m = -1", ["view.rain.radius_m", "0 to 1e7 m"]),
        (
            "heading_deg = 0\n[view.rain]\nceiling_m = 9\nceiling_softness_m = -1",
            ["view.rain.ceiling_softness_m", "0 to 1e6 m"],
        ),
    ] {
        let (code, _, error) = bake(view);
        assert!(code == 3 && words.iter().all(|word| error.contains(word)), "{view}: {error}");
        assert!(!error.contains("_rad") && !error.contains("pi/2"), "{error}");
    }
}

#[test]
fn negative_numbers_are_numbers_on_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("x"), b"no asset").unwrap();
    for flag in ["--time", "--stops"] {
        let (code, _, error) = squall(folder.path(), &["render", "x", "-o", "x.png", flag, "-5"]);
        assert!(code == 3 && error.contains("squall asset"), "{flag} {code}: {error}");
    }
    let (code, _, error) = squall(folder.path(), &["render", "x", "-o", "x.png", "--rate", "-5"]);
    assert!(code == 2 && !error.contains("unexpected argument"), "{code}: {error}");
    let (code, _, error) = squall(folder.path(), &["query", "x", "density", "--rate", "5", "--aspect", "-1"]);
    assert!(
        code == 2 && error.contains("above 0") && !error.contains("unexpected argument"),
        "{code}: {error}"
    );
}

#[test]
#[cfg(unix)]
fn json_names_a_file_whose_name_is_no_utf8() {
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::tempdir().unwrap();
    let name = PathBuf::from(std::ffi::OsStr::from_bytes(b"dr\xffop.png"));
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/streak1.png");
    if std::fs::copy(golden, folder.path().join(&name)).is_err() {
        println!("skipped: this file system has no such names");
        return;
    }
    let run = Command::cargo_bin("squall")
        .unwrap()
        .current_dir(folder.path())
        .args(["streaks", "fit"])
        .arg(&name)
        .args(["--json", "--method", "fourier"])
        .output()
        .unwrap();
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let list: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert!(list[0]["file"].as_str().unwrap().starts_with("dr\u{fffd}op"), "{list}");
}

/// Puts another picture in the place of the first as soon as anything is fitted.
struct Swap {
    place: PathBuf,
    by: Vec<u8>,
}

impl Progress for Swap {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {
        std::fs::write(&self.place, &self.by).unwrap();
    }
    fn interrupted(&self) -> bool {
        false
    }
}

#[test]
fn what_is_hashed_is_what_was_used() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1");
    let read = |name: &str| std::fs::read(golden.join(name)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("drop.png");
    std::fs::write(&place, read("streak0.png")).unwrap();
    let recipe = folder.path().join("r.toml");
    let text = "[rain.density]\nrate_mm_per_h = [1.0, 9.0]\nclasses = 1\n[rain.streaks]\npictures = [\"drop.png\"]\n\
        method = \"fourier\"\npsnr_db = 12.0\n";
    std::fs::write(&recipe, text).unwrap();
    let recipe = Recipe::read(&recipe).unwrap();
    let swap = Swap { place, by: read("streak1.png") };
    let baked = pipeline::bake(&recipe, &swap).unwrap();
    let head = |tag| baked.sections.iter().find(|section| section.tag == tag).unwrap().parts.concat();
    let limits = Default::default();
    let provenance = ProvenanceSection::read(&head(ProvenanceSection::TAG), 1, &limits).unwrap();
    assert_eq!(provenance.inputs[0].hash, *blake3::hash(&read("streak0.png")).as_bytes());
    assert_eq!(provenance.inputs[0].bytes, read("streak0.png").len() as u64);
    let streaks = StreakSection::read(&head(StreakSection::TAG), 1, &limits).unwrap();
    assert_eq!(streaks.patterns[0].size_px, [12, 60], "the first picture's size");
}
