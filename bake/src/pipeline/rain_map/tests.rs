use super::*;
use crate::pipeline::bake;
use crate::progress::Quiet;

/// A recipe in a folder of its own, with the files that it names.
fn place_of(map: &str, files: &[(&str, &[u8])]) -> Result<RainPlaceSection, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let file = folder.path().join("recipe.toml");
    let text = format!("[rain]\nfarthest_m = 20000.0\n[rain.map]\n{map}");
    std::fs::write(&file, text).unwrap();
    let recipe = Recipe::read(&file).map_err(|error| error.to_string())?;
    let baked = bake(&recipe, &Quiet).map_err(|error| error.to_string())?;
    let section = baked.sections.iter().find(|section| section.tag == RainPlaceSection::TAG).unwrap();
    let mut bytes = Vec::new();
    squall_formats::container::write(&mut bytes, std::slice::from_ref(section)).unwrap();
    let asset = squall_runtime::Asset::from_bytes(&bytes).unwrap();
    Ok(asset.section(RainPlaceSection::TAG, "place", RainPlaceSection::read).unwrap())
}

fn numbers(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[test]
fn a_map_of_numbers_is_stored_as_it_is_and_scaled_where_a_rate_is_given() {
    let file = numbers(&[0.0, 5.0, 40.0, 10.0, 0.0, 20.0]);
    let keys = "file = \"map.f32\"\ncells = [3, 2]\norigin_m = [-100.0, 50.0]\ncell_m = 25.0\n";
    let place = place_of(keys, &[("map.f32", &file)]).unwrap();
    assert_eq!(place.farthest_m, Some(20000.0));
    let map = place.map.unwrap();
    assert_eq!((map.size, map.cell_m, map.top_m, map.heaviest_mm_per_h), ([3, 2], 25.0, None, 40.0));
    assert!((map.rates()[1] - 5.0).abs() < 1e-3 && map.rates()[2] == 40.0);
    let scaled = place_of(&format!("{keys}rate_mm_per_h = 80.0\ntop_m = 900.0\n"), &[("map.f32", &file)]);
    let scaled = scaled.unwrap().map.unwrap();
    assert_eq!((scaled.heaviest_mm_per_h, scaled.top_m), (80.0, Some([900.0, 100.0])));
    assert_eq!(scaled.steps, map.steps);
}

/// A NumPy file of one shape and its numbers' bytes.
fn npy(descr: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values);
    bytes
}

#[test]
fn a_map_of_a_numpy_array_is_that_of_the_same_numbers() {
    let rates = [0.0f32, 5.0, 40.0, 10.0, 0.0, 20.0];
    let keys = "origin_m = [-100.0, 50.0]\ncell_m = 25.0\n";
    let plain = format!("file = \"map.f32\"\ncells = [3, 2]\n{keys}");
    let plain = place_of(&plain, &[("map.f32", &numbers(&rates))]).unwrap().map.unwrap();
    let array = format!("file = \"map.npy\"\n{keys}");
    let singles = npy("<f4", "(2, 3)", &numbers(&rates));
    let doubles: Vec<u8> = rates.iter().flat_map(|rate| f64::from(*rate).to_be_bytes()).collect();
    for file in [singles, npy(">f8", "(2, 3)", &doubles)] {
        assert_eq!(place_of(&array, &[("map.npy", &file)]).unwrap().map.unwrap(), plain);
    }
    for (file, words) in [
        (npy("<f4", "(2, 3)", &numbers(&[-1.0; 6])), "cell 0 × 0"),
        (npy("<f4", "(2, 3)", &numbers(&[0.0; 6])), "0 mm/h in every cell"),
        (npy("<u2", "(1, 5000)", &[0; 10_000]), "at most 4096 cells a side"),
        (numbers(&rates), "NumPy's .npy"),
    ] {
        let error = place_of(&array, &[("map.npy", &file)]).unwrap_err();
        assert!(error.contains(words), "{error}");
    }
    let cells = place_of(&format!("{array}cells = [3, 2]\n"), &[("map.npy", &numbers(&rates))]).unwrap_err();
    assert!(cells.contains("only a .f32 file leaves its size open"), "{cells}");
}

#[test]
fn a_cloud_rains_where_its_columns_hold_water_and_from_its_base() {
    let scene = br#"{"dims_xyz":[3,2,4],"cell_m":[100.0,50.0,200.0],"origin_m":[-150.0,0.0,600.0],
        "density_file":"c.f32","kappa_per_m":0.01,"albedo":0.999,"g":0.85}"#;
    // One wet column, one with a third of its water, the others without any; empty below the second layer.
    let grid: Vec<f32> = (0..24)
        .map(|i| match (i % 6, i / 6) {
            (0, 1..) => 1.0,
            (4, 2) => 1.0,
            _ => 0.0,
        })
        .collect();
    let grid = numbers(&grid);
    let files: [(&str, &[u8]); 2] = [("c.json", scene), ("c.f32", &grid)];
    let clouds = "[clouds]\nscene = \"c.json\"\n[clouds.lightning]\nspacing_m = 400.0\n[clouds.transport]\ndirections = \"2x8\"\n\
        [clouds.response]\ntest_strokes = 0\n";
    let of =
        |keys: &str| place_of(&format!("from = \"cloud\"\nrate_mm_per_h = 60.0\n{keys}\n{clouds}"), &files);
    let map = of("least_water = 0.0").unwrap().map.unwrap();
    // Square cells of the shorter edge: two for each column along x.
    assert_eq!((map.size, map.cell_m, map.origin_m), ([6, 2], 50.0, [-150.0, 0.0]));
    let rates = map.rates();
    assert!((rates[0] - 60.0).abs() < 1e-3 && (rates[1] - 60.0).abs() < 1e-3 && rates[4] == 0.0);
    assert!((rates[8] - 20.0).abs() < 1e-2, "{rates:?}");
    // Nine tenths of the rain fall from the second layer or below the third.
    assert_eq!(map.top_m, Some([1000.0, 100.0]));
    let dry = of("least_water = 0.5").unwrap().map.unwrap();
    assert_eq!((dry.rates()[8], dry.top_m), (0.0, Some([800.0, 100.0])));
}

#[test]
fn a_shower_beside_a_map_makes_it_larger_and_the_heavier_rain_wins() {
    let file = numbers(&[8.0, 8.0, 8.0, 8.0]);
    let keys = "file = \"map.f32\"\ncells = [2, 2]\norigin_m = [0.0, 0.0]\ncell_m = 10.0\n\
        showers = [{ centre_m = [-25.0, 5.0], radius_m = 8.0, softness_m = 20.0, rate_mm_per_h = 40.0 }]";
    let map = place_of(keys, &[("map.f32", &file)]).unwrap().map.unwrap();
    // The shower reaches from −53 to 3 along x and from −23 to 33 along y.
    assert_eq!((map.origin_m, map.size, map.heaviest_mm_per_h), ([-60.0, -30.0], [8, 7], 40.0));
    let at = |x: usize, y: usize| map.rates()[y * 8 + x];
    assert!((at(3, 3) - 40.0).abs() < 1e-2 && (at(7, 4) - 8.0).abs() < 1e-2 && at(7, 6) == 0.0);
    // Its edge, 12 m out of 20: 16 mm/h beside the map's own 8.
    assert!((at(5, 3) - 16.0).abs() < 1e-2, "{}", at(5, 3));
}

#[test]
fn maps_that_make_no_sense_are_refused_with_the_key() {
    let file = numbers(&[0.0, 5.0, -1.0, 10.0]);
    let whole = "file = \"map.f32\"\ncells = [2, 2]\norigin_m = [0.0, 0.0]\ncell_m = 25.0\n";
    let black = numbers(&[0.0; 4]);
    for (keys, bytes, words) in [
        (whole, &file, "a rate of 0 mm/h or more"),
        (whole, &black, "rain somewhere"),
        (&whole.replace("[2, 2]", "[2, 3]"), &file, "rain.map.cells"),
        (&whole.replace("cells = [2, 2]\n", ""), &file, "rain.map.cells"),
        (&whole.replace("cell_m = 25.0\n", ""), &file, "rain.map.cell_m"),
        (&whole.replace("cell_m = 25.0", "cell_m = 0.0"), &file, "rain.map.cell_m"),
        (&whole.replace("origin_m = [0.0, 0.0]\n", ""), &file, "rain.map.origin_m"),
        (&format!("{whole}from = \"cloud\""), &file, "both"),
        (&format!("{whole}least_water = 0.5"), &file, "rain.map.least_water"),
        ("rate_mm_per_h = 4.0", &file, "neither"),
        ("from = \"sky\"", &file, "rain.map.from"),
        ("from = \"cloud\"\nrate_mm_per_h = 4.0", &file, "[clouds]"),
    ] {
        let error = place_of(keys, &[("map.f32", bytes.as_slice())]).unwrap_err();
        assert!(error.contains(words), "{keys}: {error}");
    }
}
