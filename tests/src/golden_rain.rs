//! The golden asset of rain's place: sections RPLC version 1 and STRK version 2 are read for ever as they were written.

use serde_json::{Value, json};
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_bake::synth::streak::scene::Scene;
use squall_bake::synth::streak::write_streaks;
use squall_formats::container::{checksum, write};
use squall_formats::section::rain_place::RainPlaceSection;
use squall_formats::section::streak::StreakSection;
use squall_runtime::Asset;
use squall_runtime::glam::DVec2;
use squall_runtime::rain::RainMap;
use squall_runtime::verify::verify;
use std::path::PathBuf;

/// Of the picture against the light.
const SEED: u64 = 8;

fn file(name: &str) -> PathBuf {
    crate::root().join("data/golden/v4").join(name)
}

/// Everything that the asset is held to.
fn figures() -> Value {
    let asset = Asset::open(file("rain.squall")).unwrap();
    let place = asset.section(RainPlaceSection::TAG, "place", RainPlaceSection::read).unwrap();
    let map = RainMap::from_record(place.map.as_ref().unwrap()).unwrap();
    let rates: Vec<f64> = (0..40)
        .map(|i| map.rate_at(DVec2::new(f64::from(i) * 150.0 - 2500.0, f64::from(i % 7) * 400.0 - 1500.0)).0)
        .collect();
    let streaks = asset.section(StreakSection::TAG, "streaks", StreakSection::read).unwrap();
    let values: Vec<f64> = (0..20)
        .map(|i| streaks.patterns[0].pattern.value(0.4 + 0.01 * f64::from(i), 0.3 + 0.02 * f64::from(i)))
        .collect();
    let scene = streaks.patterns[0].scene.unwrap();
    json!({
        "bytes": asset.bytes().len(),
        "checksum": format!("{:08x}", checksum(asset.bytes())),
        "farthest_m": place.farthest_m,
        "heaviest_mm_per_h": map.heaviest().0,
        "rates": rates,
        "values": values,
        "scene": [scene.view_elevation_deg, scene.light_share, scene.light_azimuth_deg, scene.light_elevation_deg],
        "silent": streaks.patterns[1].scene.is_none(),
    })
}

#[test]
fn the_golden_asset_of_rain_is_unchanged_and_says_where_it_rains_and_what_streaks_show() {
    /// Of the largest number of a list.
    const ROUND_OFF: f64 = 1e-9;
    verify(&Asset::open(file("rain.squall")).unwrap()).unwrap();
    let expected: Value =
        serde_json::from_str(&std::fs::read_to_string(file("expected.json")).unwrap()).unwrap();
    let found = figures();
    for (what, wanted) in expected.as_object().unwrap() {
        let Some(wanted) = wanted.as_array() else {
            assert_eq!(&found[what], wanted, "{what}: golden files are never edited");
            continue;
        };
        let numbers = |list: &[Value]| list.iter().map(|v| v.as_f64().unwrap()).collect::<Vec<f64>>();
        let (found, wanted) = (numbers(found[what].as_array().unwrap()), numbers(wanted));
        let largest = wanted.iter().fold(0.0f64, |largest, v| largest.max(v.abs()));
        assert_eq!(found.len(), wanted.len());
        assert!(
            found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() <= ROUND_OFF * largest),
            "{what}: {found:?}"
        );
    }
    // The map's own rates where they were given, and the shower beside it.
    let asset = Asset::open(file("rain.squall")).unwrap();
    let place = asset.section(RainPlaceSection::TAG, "place", RainPlaceSection::read).unwrap();
    let map = RainMap::from_record(&place.map.unwrap()).unwrap();
    for (x, y, rate) in
        [(-1500.0, -1000.0, 0.0), (-500.0, -1000.0, 5.0), (1500.0, 1000.0, 55.0), (-500.0, 0.0, 25.0)]
    {
        assert!((map.rate_at(DVec2::new(x, y)).0 - rate).abs() < 1e-2, "{x} {y}");
    }
}

#[test]
#[ignore = "writes data/golden/v4"]
fn write_golden_rain() {
    let numbers: Vec<u8> = (0..12).flat_map(|i| (5.0 * i as f32).to_le_bytes()).collect();
    std::fs::write(file("map.f32"), numbers).unwrap();
    write_streaks(&file(""), Scene::Backlit, SEED, 1, &Quiet).unwrap();
    let baked = pipeline::bake(&Recipe::read(&file("rain.toml")).unwrap(), &Quiet).unwrap();
    let mut bytes = Vec::new();
    write(&mut bytes, &baked.sections).unwrap();
    assert!(bytes.len() <= 100_000, "{} bytes", bytes.len());
    std::fs::write(file("rain.squall"), bytes).unwrap();
    std::fs::write(file("expected.json"), format!("{:#}\n", figures())).unwrap();
}
