//! A scene may stand anywhere on its map: moving all of it by one vector changes nothing but round-off.

use crate::root;
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::container::write;
use squall_runtime::picture::Picture;
use squall_runtime::{Asset, StormRenderer};
use std::path::Path;

/// Eastings, northings and heights of a map grid.
const FAR: [f64; 3] = [3e5, -5e6, 200.0];

/// The golden recipe, everything moved by `offset`; its town, if it is to have one, by its place.
fn moved_recipe(folder: &Path, offset: [f64; 3], town: bool) -> Recipe {
    let golden = root().join("data/golden/v1");
    for name in ["cloud.f32", "streak0.png", "streak1.png", "town.json"] {
        std::fs::copy(golden.join(name), folder.join(name)).unwrap();
    }
    let read = |name: &str| std::fs::read_to_string(golden.join(name)).unwrap();
    let mut scene: serde_json::Value = serde_json::from_str(&read("cloud.json")).unwrap();
    for axis in 0..3 {
        let moved = scene["origin_m"][axis].as_f64().unwrap() + offset[axis];
        scene["origin_m"][axis] = moved.into();
    }
    std::fs::write(folder.join("cloud.json"), scene.to_string()).unwrap();
    let mut text = String::new();
    for line in read("golden.toml").lines() {
        let (key, value) = line.split_once(" = ").unwrap_or_default();
        match key {
            "low_m" | "high_m" | "from_m" | "to_m" | "position_m" => {
                let numbers = value.trim_matches(['[', ']']).split(", ").map(|v| v.parse::<f64>().unwrap());
                let moved: Vec<f64> = numbers.zip(offset).map(|(value, by)| value + by).collect();
                text += &format!("{key} = {moved:?}\n");
            }
            "ceiling_m" => text += &format!("{key} = {:?}\n", value.parse::<f64>().unwrap() + offset[2]),
            "radius_m" => text += &format!("{line}\ncentre_m = {:?}\n", [offset[0] + 30.0, offset[1]]),
            "file" if !town => {}
            _ if line == "[town]" && !town => {}
            _ if line == "[town]" => text += &format!("[place]\norigin_m = {offset:?}\n[town]\n"),
            _ => text += &format!("{line}\n"),
        }
    }
    text += "sun_azimuth_deg = 180.0\n[view.detail]\namplitude = 1.0\nsize_m = 90.0\n";
    text += &format!("fibres_from_m = {:?}\n", 660.0 + offset[2]);
    std::fs::write(folder.join("recipe.toml"), text).unwrap();
    Recipe::read(&folder.join("recipe.toml")).unwrap()
}

/// The scene moved by `offset`, under a low sun and under one that lights its cloud from the side.
fn pictures(offset: [f64; 3], town: bool) -> [Picture; 2] {
    let folder = tempfile::tempdir().unwrap();
    let baked = pipeline::bake(&moved_recipe(folder.path(), offset, town), &Quiet).unwrap();
    let mut bytes = Vec::new();
    write(&mut bytes, &baked.sections).unwrap();
    let mut renderer = StormRenderer::new(Asset::from_bytes(&bytes).unwrap()).unwrap();
    [-0.6f64, 36.869_897_6].map(|elevation| {
        let mut frame = renderer.frame().unwrap();
        frame.sky.sun_elevation.0 = elevation.to_radians();
        renderer.render(&frame).unwrap().clone()
    })
}

#[test]
fn moving_a_whole_scene_changes_nothing_but_round_off() {
    /// Share of a picture's mean light by which a pixel's may change: single precision through a march of some hundred steps, whose
    /// edges fall on the other side of a billow where coordinates round otherwise.
    const ROUND_OFF: f64 = 2e-3;
    /// The same of the whole picture.
    const MEAN: f64 = 1e-5;
    let both = |town| pictures([0.0; 3], town).into_iter().zip(pictures(FAR, town));
    for (here, there) in both(false).chain(both(true)) {
        let light = |picture: &Picture| -> Vec<f64> {
            picture.pixels.iter().flatten().map(|&value| f64::from(value)).collect()
        };
        let (here, there) = (light(&here), light(&there));
        let mean = here.iter().sum::<f64>() / here.len() as f64;
        let most = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let whole = here.iter().zip(&there).map(|(a, b)| a - b).sum::<f64>() / here.len() as f64;
        println!("largest change {most:e}, of the mean {whole:e}, of {mean:e}");
        assert!(mean > 0.0 && most < ROUND_OFF * mean, "{most} of {mean}");
        assert!(whole.abs() < MEAN * mean, "{whole} of {mean}");
    }
}
