//! The golden asset of a scene's maps: section WETM version 1 is read for ever as it was written.

use crate::root;
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::section::wet_maps::WetMapsSection;
use squall_runtime::Asset;
use squall_runtime::glam::{DVec2, DVec3, Vec3};
use squall_runtime::verify::verify;
use squall_runtime::wet::maps::WetMaps;
use std::path::PathBuf;

/// A step of a height of 2 m, and of a depth of 10 cm.
const STEP_M: f32 = 4e-5;

fn file(name: &str) -> PathBuf {
    root().join("data/golden/v5").join(name)
}

#[test]
fn the_golden_maps_are_those_of_their_scene() {
    let asset = Asset::open(file("wet.squall")).unwrap();
    assert_eq!(verify(&asset).unwrap().sections, 2);
    let maps = WetMaps::of(&asset).unwrap();
    let height = maps.height_m.as_ref().unwrap();
    assert_eq!((height.size, height.cell_m, height.origin_m), ([20, 20], 0.2, DVec2::splat(-2.0)));
    let at = |x: f64, y: f64| height.at(DVec2::new(x, y)).unwrap();
    // The roof, the floor, the basin.
    for (found, wanted) in [(at(0.1, 1.5), 2.05), (at(1.5, 1.5), 0.0), (at(0.1, 0.1), -0.1)] {
        assert!(found >= wanted && found - wanted <= STEP_M, "{found} {wanted}");
    }
    let depth = |x: f64, y: f64| maps.water_m.as_ref().unwrap().at(DVec2::new(x, y)).unwrap();
    assert!((depth(0.1, 0.1) - 0.1).abs() <= STEP_M && depth(1.5, 0.1) == 0.0);
    // The roof drips from its four sides: of its 1.28 m² cells of 20 cm, whose middles lie on two of its edges, have found 1.04.
    let drained: f32 = maps.drips.iter().map(|drip| drip.drains_m2).sum();
    assert!(maps.drips.len() == 4 && (drained - 1.04).abs() < 0.005, "{drained}");
    assert!(maps.drips.iter().flat_map(|drip| drip.ends_m).all(|end| (end.z - 2.05).abs() < 1e-4));
    assert_eq!(maps.fins.len(), 12);
    let [red, _, blue] = maps.overhead.as_ref().unwrap();
    let place = DVec2::new(0.1, 0.6);
    let share = blue.at(place).unwrap() / red.at(place).unwrap();
    assert!(share > 0.59 && share < 0.71, "between the sheet's .6 and the lamp's .7: {share}");
    let lightning = maps.lightning.as_ref().unwrap();
    assert_eq!((lightning.size, lightning.directions.len()), ([5, 5, 4], 2));
    let light = lightning.irradiance(0, DVec3::new(0.0, 0.0, 1.0), Vec3::NEG_Z).unwrap();
    // A floor of albedo ½ under the sine of 40°, part of it in shadow and not endless.
    assert!(light > 0.1 && light < 0.33, "{light}");
}

#[test]
fn baking_the_golden_scene_again_gives_the_same_maps() {
    let recipe = Recipe::read(&file("wet.toml")).unwrap();
    let baked = pipeline::bake(&recipe, &Quiet).unwrap();
    let section = baked.sections.iter().find(|section| section.tag == WetMapsSection::TAG).unwrap();
    let asset = Asset::open(file("wet.squall")).unwrap();
    let stored = asset.directory().section(asset.bytes(), WetMapsSection::TAG, "maps").unwrap();
    // On another kind of machine single precision may round otherwise, and with it a step of a path.
    if cfg!(target_arch = "x86_64") {
        assert!(section.to_bytes() == stored, "the maps of the golden scene have changed");
    }
}
