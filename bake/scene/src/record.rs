//! Maps into a section's record: what they are rounded to.

use glam::DVec3;
use squall_formats::section::wet_maps::{
    BoxRecord, DripRecords, FinRecords, GroundRecord, LightningRecord, MOST_STEPS, Rounding, WetMapsSection,
};
use squall_runtime::wet::maps::{GroundMap, WetMaps};

/// Steps of light from overhead: their squares keep a ten-thousandth of the brightest within 1 %.
const LIGHT_STEPS: u16 = 4095;
/// Steps of depths: 5 µm of 30 cm.
const WATER_STEPS: u16 = MOST_STEPS;
/// Steps of heights over all that a map holds, of which a city's 60 m have 1 mm.
const HEIGHT_STEPS: u16 = MOST_STEPS;

/// The record of maps. Heights are rounded upwards, as nothing may stand above what is said to be the highest.
pub fn section_of(maps: &WetMaps) -> WetMapsSection {
    let ground = |map: &GroundMap, steps: u16, squared: bool, rounding: Rounding| {
        let grid = (map.origin_m.to_array(), map.cell_m, map.size.map(|side| side as u32));
        GroundRecord::quantise(grid, &map.values, steps, squared, rounding)
    };
    let nearest = Rounding::Nearest;
    let overhead = maps.overhead.iter().flatten().map(|map| ground(map, LIGHT_STEPS, true, nearest));
    WetMapsSection {
        height: maps.height_m.as_ref().map(|map| ground(map, HEIGHT_STEPS, false, Rounding::Up)),
        water: maps.water_m.as_ref().map(|map| ground(map, WATER_STEPS, false, nearest)),
        overhead: overhead.collect(),
        drips: drips(maps),
        fins: fins(maps),
        lightning: maps.lightning.as_ref().map(|volume| {
            let (peaks, steps) = LightningRecord::quantise(&volume.harmonics, volume.directions.len());
            LightningRecord {
                origin_m: volume.origin_m.to_array(),
                cell_m: volume.cell_m,
                size: volume.size.map(|side| side as u32),
                directions: volume.directions.iter().map(|d| d.as_vec3().to_array()).collect(),
                peaks,
                steps,
            }
        }),
    }
}

fn ends(within: &BoxRecord, ends: &[DVec3; 2]) -> [u16; 6] {
    let [[a, b, c], [d, e, f]] = ends.map(|end| within.steps(end.to_array()));
    [a, b, c, d, e, f]
}

fn drips(maps: &WetMaps) -> DripRecords {
    let all = maps.drips.iter();
    let within = BoxRecord::around(all.clone().flat_map(|drip| drip.ends_m).map(|end| end.to_array()));
    DripRecords {
        within,
        ends: all.clone().map(|drip| ends(&within, &drip.ends_m)).collect(),
        drains_m2: all.map(|drip| drip.drains_m2).collect(),
    }
}

fn fins(maps: &WetMaps) -> FinRecords {
    let all = maps.fins.iter();
    let within = BoxRecord::around(all.clone().flat_map(|fin| fin.ends_m).map(|end| end.to_array()));
    let steps = |normal: DVec3| (normal * 127.0).round().to_array().map(|part| part as i8);
    let normals = |fin: &squall_runtime::wet::maps::Fin| {
        let [[a, b, c], [d, e, f]] = fin.normals.map(steps);
        [a, b, c, d, e, f]
    };
    FinRecords {
        within,
        ends: all.clone().map(|fin| ends(&within, &fin.ends_m)).collect(),
        normals: all.map(normals).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{cuboid, quad};
    use crate::{MapSettings, Quiet, Scene, World, bake_maps};

    #[test]
    fn maps_come_back_from_their_record_as_they_went_in_but_for_its_steps() {
        let mut scene = Scene::default();
        quad(&mut scene, [-5.0, -5.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], 0);
        cuboid(&mut scene, [-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], 0);
        let mut settings = MapSettings::default();
        settings.lightning.directions = vec![DVec3::new(0.0, 0.6, 0.8)];
        settings.lightning.paths = 32;
        let maps = bake_maps(&World::new(scene), &settings, None, &Quiet).unwrap().maps;
        let section = section_of(&maps);
        let back = WetMaps::from_section(&section).unwrap();
        let [was, is] = [&maps, &back].map(|maps| maps.height_m.as_ref().unwrap());
        assert_eq!((was.origin_m, was.cell_m, was.size), (is.origin_m, is.cell_m, is.size));
        assert!(was.values.iter().zip(&is.values).all(|(a, b)| b >= a && b - a < 1e-4));
        assert_eq!((maps.drips.len(), maps.fins.len()), (back.drips.len(), back.fins.len()));
        for (a, b) in maps.fins.iter().zip(&back.fins) {
            assert!(a.ends_m[0].distance(b.ends_m[0]) < 1e-3 && a.normals[1].dot(b.normals[1]) > 0.9999);
        }
        let [was, is] = [&maps, &back].map(|maps| maps.lightning.as_ref().unwrap());
        assert!(crate::lightning::relative_l2(is, was) < 1e-4 && is.size == was.size);
        let again = section_of(&back);
        assert_eq!(again.lightning.unwrap().steps, section.lightning.unwrap().steps);
    }
}
