use super::*;
use crate::pipeline::bake_with;
use crate::progress::Quiet;
use squall_runtime::Asset;
use squall_runtime::wet::maps::WetMaps;
use squall_scene::Material;
use squall_scene::write::{GlbWriter, Part};

/// A floor 4 m wide with a basin 10 cm deep in it, and a shining sheet above its edge.
fn room() -> Vec<u8> {
    let mut writer = GlbWriter::new(683.0);
    let floor = writer.material(&Material { base: [0.5; 3], ..Material::default() });
    let glow = writer.material(&Material { emission: [5.0, 4.0, 3.0], ..Material::default() });
    let square = |[x0, y0, x1, y1]: [f32; 4], z: f32, material: u32, up: bool| Part {
        places: vec![[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]],
        corners: if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] },
        material,
        ..Part::default()
    };
    let floors =
        [[-2.0, -2.0, 2.0, -1.0], [-2.0, 1.0, 2.0, 2.0], [-2.0, -1.0, -1.0, 1.0], [1.0, -1.0, 2.0, 1.0]];
    let mut parts: Vec<Part> = floors.iter().map(|at| square(*at, 0.0, floor, true)).collect();
    parts.push(square([-1.0, -1.0, 1.0, 1.0], -0.1, floor, true));
    parts.push(square([-0.5, 1.2, 0.5, 1.8], 2.0, glow, false));
    let mesh = writer.mesh("room", &parts);
    writer.place("room", mesh, glam::DVec3::ZERO, 0.0);
    writer.finish("test")
}

fn folder(recipe: &str, files: &[(&str, &[u8])]) -> (tempfile::TempDir, Result<Recipe, BakeError>) {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let path = folder.path().join("recipe.toml");
    std::fs::write(&path, recipe).unwrap();
    let recipe = Recipe::read(&path);
    (folder, recipe)
}

fn maps_of(recipe: &Recipe, cache: Option<&ResponseCache>) -> (WetMaps, Vec<u8>) {
    let baked = bake_with(recipe, cache, &Quiet).unwrap();
    let mut bytes = Vec::new();
    squall_formats::container::write(&mut bytes, &baked.sections).unwrap();
    (WetMaps::of(&Asset::from_bytes(&bytes).unwrap()).unwrap(), bytes)
}

const QUICK: &str = "[scene]\nfile = \"room.glb\"\n[scene.lightning]\npaths = 16\n";

#[test]
fn a_basin_fills_and_what_shines_lights_the_floor_before_it() {
    let (_folder, recipe) = folder(QUICK, &[("room.glb", &room())]);
    let recipe = recipe.unwrap();
    let (maps, _) = maps_of(&recipe, None);
    let water = maps.water_m.unwrap();
    let at = |x: f64, y: f64| water.at(DVec2::new(x, y)).unwrap();
    // Quantised to 0.1 m over 65534.
    assert!((at(0.05, 0.05) - 0.1).abs() < 1e-4 && at(1.55, 0.05) == 0.0);
    let [red, _, blue] = maps.overhead.unwrap();
    let light = red.at(DVec2::new(0.1, 0.1)).unwrap();
    assert!(light > 0.1 && (blue.at(DVec2::new(0.1, 0.1)).unwrap() / light - 0.6).abs() < 0.02, "{light}");
    assert_eq!(maps.lightning.unwrap().directions.len(), 2);
    let files = recipe.inputs().unwrap();
    assert!(files.iter().any(|file| file.ends_with("room.glb")));
}

#[test]
fn a_mask_is_the_water_and_kept_maps_give_the_same_bytes() {
    let mut mask = Vec::new();
    let mut encoder = png::Encoder::new(&mut mask, 2, 2);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    // Linear, so that 255 is 1 and half of it would be half.
    encoder.set_source_gamma(png::ScaledFloat::from_scaled(100_000));
    encoder.write_header().unwrap().write_image_data(&[255, 0, 0, 0]).unwrap();
    let text = QUICK
        .replace("[scene.lightning]", "puddles = \"mask.png\"\npuddles_white_m = 0.05\n[scene.lightning]");
    let (home, recipe) = folder(&text, &[("room.glb", &room()), ("mask.png", &mask)]);
    let recipe = recipe.unwrap();
    let (maps, bytes) = maps_of(&recipe, None);
    let water = maps.water_m.unwrap();
    let depth = |x: f64, y: f64| water.at(DVec2::new(x, y)).unwrap();
    // The picture's first row is on top, where y is greatest.
    assert!((depth(-1.9, 1.9) - 0.05).abs() < 1e-3 && depth(-1.9, -1.9) == 0.0 && depth(1.9, 1.9) == 0.0);
    let cache = ResponseCache::new(&home.path().join("cache"), 1 << 20);
    for _ in 0..2 {
        assert!(maps_of(&recipe, Some(&cache)).1 == bytes);
    }
    let kept = std::fs::read_dir(home.path().join("cache")).unwrap().count();
    assert!(kept > 0, "nothing was kept");
}

#[test]
fn wrong_scenes_and_keys_are_refused_by_file_and_field() {
    let refused = |text: &str, files: &[(&str, &[u8])], words: &str| {
        let (_folder, recipe) = folder(text, files);
        let error = match recipe {
            Err(error) => error,
            Ok(recipe) => match bake_with(&recipe, None, &Quiet) {
                Err(error) => error,
                Ok(_) => panic!("{words}: baked"),
            },
        };
        assert!(error.to_string().contains(words), "{words}: {error}");
        assert_eq!(error.exit_code(), 3);
    };
    let glb = room();
    let with = |key: &str| QUICK.replace("[scene.lightning]", &format!("{key}\n[scene.lightning]"));
    let scene = [("room.glb", glb.as_slice())];
    refused(QUICK, &[("room.glb", b"no scene at all")], "room.glb: file: wanted glTF 2.0");
    refused(QUICK, &[("room.glb", &glb[..200])], "room.glb: glb");
    refused(&with("cell_m = 1e-3"), &[("other.glb", &glb)], "room.glb");
    refused(&with("cell_m = 0.0009765"), &scene, "scene.cell_m");
    refused(&with("cell_m = -1.0"), &scene, "scene.cell_m");
    refused(&with("region_m = [1.0, 0.0, 0.0, 1.0]"), &scene, "scene.region_m");
    refused(&with("puddles_white_m = 0.1"), &scene, "`puddles` beside it");
    refused(&with("celll_m = 0.1"), &scene, "the nearest is `cell_m`");
    refused(&with("[scene.overhead]\npoints = 0"), &scene, "scene.overhead.points");
    refused(&with("[scene.overhead]\ncell_m = 0.0009"), &scene, "scene.overhead.cell_m");
    let from = |count: usize| {
        let one = "{ azimuth_deg = 10.0, elevation_deg = 40.0 }";
        QUICK.replace("paths = 16", &format!("paths = 16\ndirections = [{}]", vec![one; count].join(", ")))
    };
    for count in [1, 3] {
        let words = format!(
            "scene.lightning.directions: wanted two key directions, of L1 and of L2, or none, found {count}"
        );
        refused(&from(count), &scene, &words);
    }
    for count in [0, 2] {
        let (_folder, recipe) = folder(&from(count), &scene);
        assert_eq!(recipe.unwrap().scene.unwrap().directions.len(), count);
    }
}

#[test]
fn edges_that_the_maps_leave_out_are_said_and_kept() {
    let record = WetMapsSection::default();
    let said = words(&record, 7, [12, 0], Some("3 triangles without area left out".into()));
    let wanted = "7 triangles, 0 edges drip (12 lesser ones left out), 0 silhouettes, 3 triangles without area left out";
    assert_eq!(said, wanted);
    let bytes = packed([12, 5], &record.write().to_bytes());
    assert_eq!(unpacked(&bytes), Some((record, [12, 5])));
    assert!((0..bytes.len()).all(|cut| unpacked(&bytes[..cut]).is_none()));
}
