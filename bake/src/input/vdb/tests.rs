use super::*;
use crate::input::npy::read_npy_box;
use crate::output::vdb::{VdbGrid, write_vdb};
use std::path::Path;

/// What OpenVDB wrote (data/vdb/make.py), and what it read of it.
fn fixture(name: &str) -> Input {
    Input::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/vdb").join(name), 1 << 24).unwrap()
}

fn truth(name: &str) -> Vec<f32> {
    read_npy_box(&fixture(name), 1 << 24).unwrap().values
}

#[test]
fn every_voxel_is_what_openvdb_itself_reads() {
    // Blosc and masks; float, half; one, two and many inactive values; tiles in each.
    for (file, grid) in [
        ("float", "density"),
        ("half", "density"),
        ("inactive", "one"),
        ("inactive", "two"),
        ("inactive", "many"),
    ] {
        let read = read_vdb(&fixture(&format!("{file}.vdb")), Some(grid), Up::Z, 1.0);
        let read = read.unwrap_or_else(|error| panic!("{file} {grid}: {error}"));
        assert_eq!(read.shape.to_array(), [24, 16, 20], "{file} {grid}");
        assert_eq!(read.values, truth(&format!("{file}.{grid}.npy")), "{file} {grid}");
    }
}

#[test]
fn voxels_stand_where_the_transform_puts_their_middles() {
    let read = read_vdb(&fixture("float.vdb"), None, Up::Z, 1.0).unwrap();
    assert_eq!(read.cell_m, [25.0; 3]);
    // Voxel (−10, 0, 2) is the box's first.
    let middle = DVec3::new(100.0 - 250.0, -50.0, 700.0 + 50.0);
    assert_eq!(read.origin_m, middle - 12.5);
    let scaled = read_vdb(&fixture("float.vdb"), None, Up::Z, 0.5).unwrap();
    assert_eq!((scaled.cell_m, scaled.origin_m), ([12.5; 3], 0.5 * read.origin_m));
}

#[test]
fn a_file_whose_y_is_up_is_turned_about_x() {
    let given = read_vdb(&fixture("float.vdb"), None, Up::Z, 1.0).unwrap();
    let turned = read_vdb(&fixture("float.vdb"), None, Up::Y, 1.0).unwrap();
    assert_eq!(turned.shape.to_array(), [24, 20, 16]);
    let at = |volume: &Volume, place: DVec3| {
        let [i, j, k] =
            ((place - volume.origin_m) / volume.cell_m[0]).floor().to_array().map(|at| at as usize);
        let [nx, ny, _] = volume.shape.to_array();
        volume.values[i + nx * (j + ny * k)]
    };
    let [nx, ny, nz] = given.shape.to_array();
    for (i, j, k) in (0..nx * ny * nz).map(|at| (at % nx, at / nx % ny, at / nx / ny)) {
        let middle = given.origin_m + 25.0 * (DVec3::new(i as f64, j as f64, k as f64) + 0.5);
        let there = DVec3::new(middle.x, -middle.z, middle.y);
        assert_eq!(at(&given, middle), at(&turned, there), "{i} {j} {k}");
    }
}

#[test]
fn what_is_no_fog_is_refused_with_what_is_there() {
    let input = fixture("refused.vdb");
    for (name, words) in [
        (Some("surface"), "level set"),
        (Some("wind"), "Tree_vec3s_5_4_3"),
        (Some("rain"), "\"surface\" (Tree_float_5_4_3), \"wind\" (Tree_vec3s_5_4_3)"),
        (None, "level set"),
    ] {
        let error = read_vdb(&input, name, Up::Z, 1.0).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    // Two grids that could be meant, neither called "density".
    let error = read_vdb(&fixture("inactive.vdb"), None, Up::Z, 1.0).unwrap_err().to_string();
    assert!(error.contains("key grid") && error.contains("\"many\""), "{error}");
}

/// A grid with holes that crosses nodes, as our own writer writes it.
fn written() -> (Vec<[f32; 1]>, GridShape, Vec<u8>) {
    let shape = GridShape::new(140, 9, 20);
    let mut values: Vec<[f32; 1]> =
        (0..shape.len()).map(|at| [(at * 31 % 7 / 4) as f32 * 0.125 * at as f32]).collect();
    // The first and the last hold something: what is read is the box around what does.
    (values[0], values[shape.len() - 1]) = ([0.5], [0.25]);
    let grid = VdbGrid {
        name: "density",
        shape,
        cell_m: [10.0, 20.0, 40.0],
        origin_m: DVec3::new(5.0, -7.0, 90.0),
        values: &values,
    };
    let mut bytes = Vec::new();
    write_vdb(&grid, &mut bytes).unwrap();
    (values, shape, bytes)
}

#[test]
fn what_is_written_reads_back_to_the_bit() {
    let (values, shape, bytes) = written();
    let input = Input { path: "own.vdb".into(), bytes };
    let read = read_vdb(&input, Some("density"), Up::Z, 1.0).unwrap();
    assert_eq!(read.shape, shape);
    assert_eq!(read.values, values.as_flattened());
    let placed = (read.cell_m, read.origin_m);
    assert_eq!(placed, ([10.0, 20.0, 40.0], DVec3::new(5.0, -7.0, 90.0)));
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    for bytes in [fixture("half.vdb").bytes, written().2] {
        for length in (0..bytes.len()).step_by(37) {
            let input = Input { path: "cut.vdb".into(), bytes: bytes[..length].to_vec() };
            assert!(read_vdb(&input, None, Up::Z, 1.0).is_err(), "{length}");
        }
    }
}

#[test]
fn spoilt_bytes_end_in_an_answer() {
    for whole in [fixture("half.vdb").bytes, fixture("inactive.vdb").bytes, written().2] {
        let mut state = 1u64;
        for _ in 0..300 {
            let mut bytes = whole.clone();
            for _ in 0..4 {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                // Half of them where the structure lies.
                let within = if state >> 13 & 1 == 0 { 1200 } else { bytes.len() };
                let at = (state >> 33) as usize % within;
                bytes[at] = (state >> 20) as u8;
            }
            let _ = read_vdb(&Input { path: "spoilt.vdb".into(), bytes }, Some("one"), Up::Z, 1.0);
        }
    }
}

#[test]
fn a_transform_that_turns_is_refused_and_one_that_swaps_axes_is_followed() {
    // World is (2 z, −3 x, 4 y) and then moved, by rows.
    let mut bytes = Vec::new();
    let affine = |rows: [[f64; 4]; 4]| {
        let mut bytes = 9u32.to_le_bytes().to_vec();
        bytes.extend(b"AffineMap");
        rows.as_flattened().iter().for_each(|value| bytes.extend(value.to_le_bytes()));
        bytes
    };
    bytes.extend(affine([
        [0.0, -3.0, 0.0, 0.0],
        [0.0, 0.0, 4.0, 0.0],
        [2.0, 0.0, 0.0, 0.0],
        [7.0, 8.0, 9.0, 1.0],
    ]));
    let read =
        |bytes: &[u8]| transform::Transform::read(&mut Bytes::new(bytes, 0).ok().unwrap()).ok().unwrap();
    let world = read(&bytes).to_world(Up::Z, 1.0).ok().unwrap();
    let wanted = transform::ToWorld { axes: [2, 0, 1], scale: [2.0, -3.0, 4.0], offset: [7.0, 8.0, 9.0] };
    assert_eq!(world, wanted);
    let turned =
        affine([[0.6, 0.8, 0.0, 0.0], [-0.8, 0.6, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
    assert!(read(&turned).to_world(Up::Z, 1.0).is_err());
    let flat = affine([[1.0, 0.0, 0.0, 0.0], [0.0; 4], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
    assert!(read(&flat).to_world(Up::Z, 1.0).is_err());
}

#[test]
fn a_box_too_large_is_refused_before_memory_is_taken() {
    // Two voxels in two nodes below the root; then the second node is moved far away, in all three directions.
    let shape = GridShape::new(4200, 1, 1);
    let mut values = vec![[0.0f32]; shape.len()];
    (values[0], values[4199]) = ([1.0], [1.0]);
    let mut bytes = Vec::new();
    let grid = VdbGrid { name: "density", shape, cell_m: [1.0; 3], origin_m: DVec3::ZERO, values: &values };
    write_vdb(&grid, &mut bytes).unwrap();
    let mut input = Input { path: "far.vdb".into(), bytes };
    assert_eq!(read_vdb(&input, None, Up::Z, 1.0).unwrap().values.len(), 4200);
    let place: Vec<u8> = [4096u32, 0, 0].iter().flat_map(|word| word.to_le_bytes()).collect();
    let at = input.bytes.windows(12).position(|window| window == place).unwrap();
    (0..3).for_each(|axis| input.bytes[at + 4 * axis..][..4].copy_from_slice(&(1i32 << 20).to_le_bytes()));
    let error = read_vdb(&input, None, Up::Z, 1.0).unwrap_err().to_string();
    assert!(error.contains("2^28 voxels") && error.contains("1048680"), "{error}");
}
