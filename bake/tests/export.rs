//! `squall export`, and scenes whose grid another program wrote: what goes out comes back, and OpenVDB itself reads it.

use squall_bake::input::scene::{Optics, read_scene};
use squall_runtime::{Asset, Clouds, Flash};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SQUALL: &str = env!("CARGO_BIN_EXE_squall");

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/golden/v1/golden.squall")
}

fn export(args: &[&str], out: &Path) -> Output {
    Command::new(SQUALL).arg("export").arg(golden()).args(args).arg("-o").arg(out).output().unwrap()
}

fn exported(args: &[&str], out: &Path) {
    let done = export(args, out);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

fn refused(done: &Output, words: &str) {
    let error = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.code() == Some(3) && error.contains(words), "{:?} {error}", done.status.code());
}

fn clouds() -> Clouds {
    Clouds::new(&Asset::open(golden()).unwrap()).unwrap()
}

/// A scene of a grid's file with more keys.
fn scene(folder: &Path, grid: &str, keys: &str) -> PathBuf {
    let path = folder.join("scene.json");
    let text = format!(r#"{{"extinction_file": "{grid}", "albedo": 0.9, "g": 0.5{keys}}}"#);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn exported_density_is_the_grid_of_a_scene_again_as_openvdb_and_as_numpy() {
    let folder = tempfile::tempdir().unwrap();
    let clouds = clouds();
    let cloud = clouds.cloud();
    exported(&["--density"], &folder.path().join("cloud.vdb"));
    exported(&["--density"], &folder.path().join("cloud.npy"));

    let array = format!(r#", "cell_m": {:?}, "origin_m": {:?}"#, cloud.cell_m, cloud.origin_m.to_array());
    let read = read_scene(&scene(folder.path(), "cloud.npy", &array), Optics::default()).unwrap();
    assert_eq!((read.cloud.shape, &read.cloud.extinction), (cloud.shape, &cloud.extinction));
    assert_eq!(read.grid_made, "as given");

    // OpenVDB's box is that of cells with something in them.
    let read = read_scene(&scene(folder.path(), "cloud.vdb", ""), Optics::default()).unwrap().cloud;
    assert_eq!(read.cell_m, cloud.cell_m);
    let [nx, ny, _] = cloud.shape.to_array();
    let [mx, my, mz] = read.shape.to_array();
    let shift = ((read.origin_m - cloud.origin_m) / glam::DVec3::from_array(cloud.cell_m)).round().to_array();
    let [dx, dy, dz] = shift.map(|steps| steps as usize);
    let mut held = 0.0;
    for at in 0..mx * my * mz {
        let (x, y, z) = (at % mx + dx, at / mx % my + dy, at / (mx * my) + dz);
        let wanted = cloud.extinction[x + nx * (y + ny * z)];
        assert_eq!(read.extinction[at], wanted);
        held += f64::from(wanted);
    }
    assert_eq!(held, cloud.extinction.iter().map(|&value| f64::from(value)).sum::<f64>());
}

#[test]
fn a_grid_in_other_cells_keeps_its_mass_and_says_what_was_done() {
    let folder = tempfile::tempdir().unwrap();
    exported(&["--density"], &folder.path().join("cloud.vdb"));
    let given = read_scene(&scene(folder.path(), "cloud.vdb", ""), Optics::default()).unwrap().cloud;
    let keys = r#", "resample_to": [5, 3, 2]"#;
    let read = read_scene(&scene(folder.path(), "cloud.vdb", keys), Optics::default()).unwrap();
    let mass = |cloud: &squall_runtime::transport::Cloud| {
        cloud.cell_volume() * cloud.extinction.iter().map(|&value| f64::from(value)).sum::<f64>()
    };
    assert_eq!(read.cloud.shape.to_array(), [5, 3, 2]);
    // Thirty sums in single precision.
    const ROUNDING: f64 = 1e-6;
    assert!((mass(&read.cloud) / mass(&given) - 1.0).abs() < ROUNDING);
    assert!(read.grid_made.contains("cloud.vdb") && read.grid_made.contains("mass"), "{}", read.grid_made);
}

#[test]
fn light_goes_out_as_the_library_gives_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut clouds = clouds();
    let stroke =
        squall_runtime::StormRenderer::new(Asset::open(golden()).unwrap()).unwrap().strokes()[0].name.clone();
    let count = clouds.cloud().shape.len();
    let mut wanted = vec![[0.0; 4]; count];
    clouds.radiance(&[Flash::named(&stroke)], glam::DVec3::new(10.0, -400.0, 30.0), &mut wanted).unwrap();
    let out = folder.path().join("light.npy");
    exported(&["--light", &stroke, "--viewer", "10,-400,30"], &out);
    let bytes = std::fs::read(&out).unwrap();
    let values: Vec<f32> = bytes[bytes.len() - count * 12..]
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect();
    for (cell, light) in wanted.iter().enumerate() {
        assert_eq!([values[cell], values[count + cell], values[2 * count + cell]], light[..3]);
    }
    assert!(values.iter().any(|&value| value > 0.0));
    // A texture: a head, a texel of four halves a cell.
    let out = folder.path().join("light.ktx2");
    exported(&["--light", &stroke, "--viewer", "10,-400,30"], &out);
    let texture = std::fs::read(&out).unwrap();
    assert!(
        texture.starts_with(b"\xABKTX 20") && texture.len() > 8 * count && texture.len() < 8 * count + 400
    );
}

#[test]
fn openvdb_itself_reads_what_is_exported() {
    const SCRIPT: &str = "
import sys, numpy
try:
    import pyopenvdb as vdb
except ImportError:
    import openvdb as vdb
grid = vdb.read(sys.argv[1], 'density')
light = vdb.read(sys.argv[2], 'light')
array = numpy.load(sys.argv[3])
out = numpy.zeros(array.shape, numpy.float32)
grid.copyToArray(out, (0, 0, 0))
assert (out == array).all() and grid.activeVoxelCount() == (array != 0).sum()
assert grid.gridClass == vdb.GridClass.FOG_VOLUME
wanted = numpy.load(sys.argv[4])
out = numpy.zeros(wanted.shape, numpy.float32)
light.copyToArray(out, (0, 0, 0))
assert (out == wanted).all() and wanted.max() > 0
print('read', grid.transform.indexToWorld((0, 0, 0)))
";
    let python = ["/usr/bin/python3", "python3"].into_iter().find(|python| {
        let script = "import numpy\ntry:\n import pyopenvdb\nexcept ImportError:\n import openvdb";
        Command::new(python).args(["-c", script]).output().is_ok_and(|done| done.status.success())
    });
    let Some(python) = python else {
        eprintln!("skipped: no Python with OpenVDB and numpy (Debian: python3-openvdb)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let files = ["d.vdb", "l.vdb", "d.npy", "l.npy"].map(|name| folder.path().join(name));
    let stroke =
        squall_runtime::StormRenderer::new(Asset::open(golden()).unwrap()).unwrap().strokes()[0].name.clone();
    let light = ["--light", &stroke, "--viewer", "10,-400,30"];
    for (args, out) in [(&["--density"][..], 0), (&light, 1), (&["--density"], 2), (&light, 3)] {
        exported(args, &files[out]);
    }
    let done = Command::new(python).arg("-c").arg(SCRIPT).args(&files).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let clouds = clouds();
    let middle = clouds.cloud().origin_m + 0.5 * glam::DVec3::from_array(clouds.cloud().cell_m);
    let said = String::from_utf8_lossy(&done.stdout).replace(['(', ')'], "");
    let said: Vec<f64> =
        said.trim_start_matches("read ").trim().split(", ").map(|n| n.parse().unwrap()).collect();
    assert_eq!(said, middle.to_array());
}

#[test]
fn what_cannot_be_exported_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    refused(&export(&["--density"], &out("cloud.obj")), ".vdb, .npy or .ktx2");
    refused(&export(&["--light", "nobody", "--viewer", "0,0,0"], &out("a.vdb")), "nobody");
    assert_eq!(export(&["--density", "--light", "a"], &out("a.vdb")).status.code(), Some(2));
    assert_eq!(export(&[], &out("a.vdb")).status.code(), Some(2));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_scene_of_another_programs_grid_is_held_to_what_that_says() {
    let folder = tempfile::tempdir().unwrap();
    exported(&["--density"], &folder.path().join("cloud.vdb"));
    exported(&["--density"], &folder.path().join("cloud.npy"));
    let error = |grid: &str, keys: &str| {
        read_scene(&scene(folder.path(), grid, keys), Optics::default()).unwrap_err().to_string()
    };
    let place = r#", "cell_m": 10.0, "origin_m": [0, 0, 0]"#;
    for (found, words) in [
        (error("cloud.vdb", r#", "cell_m": 10.0"#), "cell_m: wanted nothing: the OpenVDB file says it"),
        (error("cloud.vdb", r#", "grid": "smoke""#), "a grid called \"smoke\", found \"density\""),
        (error("cloud.vdb", r#", "metres_per_unit": 0"#), "metres_per_unit: wanted above 0"),
        (error("cloud.vdb", r#", "up": "x""#), "y, z, found `x`"),
        (
            error("cloud.vdb", r#", "resample_to": [0, 2, 2]"#),
            "resample_to: wanted 1 to 2^28 cells, found 0 × 2 × 2",
        ),
        (error("cloud.npy", ""), "cell_m: wanted an edge"),
        (
            error("cloud.npy", &format!(r#"{place}, "dims_xyz": [1, 2, 3]"#)),
            "as the array has, found 1 × 2 × 3",
        ),
        (error("cloud.npy", &format!(r#"{place}, "up": "y""#)), "up: wanted nothing"),
        (error("cloud.npy", &format!(r#"{place}, "index": "x + nx*(y + ny*z)""#)), "index: wanted nothing"),
    ] {
        assert!(found.contains(words), "{found}");
    }
}
