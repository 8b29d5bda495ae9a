//! Released assets stay readable: what `data/golden` held when it was written still comes out of it.
//!
//! What the recipe or its inputs say is compared with those; what was computed is compared with `expected.json`, which
//! `write_golden_assets` writes beside the files. How to make both again: data/golden/v1/README.md; v2 has what is newer.

use crate::root;
use glam::DVec3;
use serde_json::{Value, json};
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_bake::{input, pipeline};
use squall_formats::container::{checksum, write};
use squall_formats::drops::View;
use squall_formats::section::KNOWN;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::density::Mode;
use squall_formats::section::provenance::ProvenanceSection;
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis, DistantKind, Stored};
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::TownSection;
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};
use squall_runtime::density::{lookup_counts, read_density};
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::verify::verify;
use squall_runtime::{Asset, StormRenderer};
use std::path::PathBuf;

const NAMES: [&str; 6] = ["golden", "paper", "eyes", "sun", "levels", "fit"];
/// Those that hold a section of the newest version, 5, and are not released.
const NEWER: [&str; 1] = ["fit"];

/// Single precision through some hundred additions, in whatever order a later version makes them; relative to the
/// largest of the numbers compared.
const ROUND_OFF: f64 = 1e-5;

fn file(name: &str) -> PathBuf {
    root().join("data/golden/v1").join(name)
}

/// A file of the asset `name`, beside it.
fn beside(name: &str, file: &str) -> PathBuf {
    let version = match name {
        "eyes" => "v2",
        "sun" => "v3",
        "levels" | "fit" => "v5",
        _ => "v1",
    };
    root().join("data/golden").join(version).join(file)
}

fn asset(name: &str) -> Asset {
    Asset::open(beside(name, &format!("{name}.squall"))).unwrap()
}

fn recipe(name: &str) -> Recipe {
    Recipe::read(&beside(name, &format!("{name}.toml"))).unwrap()
}

/// What `expected.json` beside the asset holds.
fn expected(name: &str) -> Value {
    let text = std::fs::read_to_string(beside(name, "expected.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Light per channel in every 29th cell, under a stroke of three points that touch many sources.
fn relit(asset: &Asset) -> Vec<f64> {
    let relighter = Relighter::new(asset).unwrap();
    let light = |x, y, z, intensity| PointLight { position: DVec3::new(x, y, z), intensity };
    let lights =
        [light(-150.0, -60.0, 680.0, 2e6), light(20.0, 10.0, 650.5, 1e6), light(131.0, 99.0, 700.0, 5e5)];
    let mut buffers = RelightBuffers::default();
    let relit = relighter.relight(&lights, RelightOptions::default(), &mut buffers).unwrap();
    relit.planes.iter().step_by(29).map(|&v| f64::from(v)).collect()
}

/// The same in distant light of each kind.
fn distant(asset: &Asset) -> Vec<f64> {
    let relighter = Relighter::new(asset).unwrap();
    let mut buffers = RelightBuffers::default();
    let mut values = Vec::new();
    for source in relighter.response().head.distant.clone() {
        let relit = relighter.distant(source.kind, &mut buffers).unwrap().unwrap();
        values.extend(relit.planes.iter().step_by(29).map(|&v| f64::from(v)));
    }
    values
}

/// Light of a sun between beams, in every 29th cell towards a viewer.
fn sun(asset: &Asset) -> Vec<f64> {
    let mut clouds = squall_runtime::Clouds::new(asset).unwrap();
    let mut j = vec![0.0; clouds.cloud().shape.len()];
    let source = clouds.sun(DVec3::new(0.48, 0.64, 0.6), DVec3::new(0.0, -400.0, 2.0), &mut j).unwrap();
    assert_eq!(source, squall_runtime::clouds::SunSource::Baked);
    j.iter().step_by(29).map(|&v| f64::from(v)).collect()
}

/// Streaks that a camera sees at 10 mm/h, by mode and class.
fn counts(asset: &Asset) -> Vec<f64> {
    let section = read_density(asset).unwrap();
    let view = View {
        vertical_fov: Degrees(60.0).into(),
        height_px: 1080.0,
        aspect: 16.0 / 9.0,
        exposure: Seconds(0.02),
        min_px: 30.0,
        max_px: 200.0,
    };
    let counts = |mode| lookup_counts(&section, mode, &view, MillimetresPerHour(10.0)).unwrap();
    Mode::ALL.into_iter().flat_map(counts).collect()
}

/// Light of every pattern on a lattice of its picture.
fn streaks(asset: &Asset) -> Vec<f64> {
    let section = asset.section(StreakSection::TAG, "streaks", StreakSection::read).unwrap();
    let at = |i: usize| ((i % 5) as f64 / 4.0, (i / 5) as f64 / 8.0);
    let values =
        |i: usize, pattern: &squall_formats::section::streak::Pattern| pattern.value(at(i).0, at(i).1);
    section.patterns.iter().flat_map(|p| (0..45).map(|i| values(i, &p.pattern)).collect::<Vec<_>>()).collect()
}

/// Everything computed that a golden asset is held to.
fn figures(name: &str) -> Value {
    let asset = asset(name);
    let mut figures = json!({
        "bytes": asset.bytes().len(),
        "checksum": format!("{:08x}", checksum(asset.bytes())),
        "relit": relit(&asset),
    });
    if name == "sun" {
        figures["distant"] = json!(distant(&asset));
        figures["sun"] = json!(sun(&asset));
    }
    if name == "golden" {
        figures["distant"] = json!(distant(&asset));
        figures["counts"] = json!(counts(&asset));
        figures["streaks"] = json!(streaks(&asset));
    }
    figures
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn golden_assets_are_unchanged_whole_and_give_the_numbers_that_they_gave() {
    for name in NAMES {
        verify(&asset(name)).unwrap();
        let (found, expected) = (figures(name), &expected(name)[name]);
        assert_eq!(found.as_object().unwrap().len(), expected.as_object().unwrap().len());
        for (what, wanted) in expected.as_object().unwrap() {
            if !wanted.is_array() {
                assert_eq!(&found[what], wanted, "{name}.squall: {what}: golden files are never edited");
                continue;
            }
            let (found, wanted) = (numbers(&found[what]), numbers(wanted));
            let largest = wanted.iter().fold(0.0f64, |largest, v| largest.max(v.abs()));
            assert!(found.len() == wanted.len() && largest > 0.0, "{name} {what}");
            for (found, wanted) in found.iter().zip(&wanted) {
                assert!((found - wanted).abs() <= ROUND_OFF * largest, "{name} {what}: {found} for {wanted}");
            }
        }
    }
}

#[test]
fn golden_sections_say_what_their_recipe_and_its_inputs_say() {
    let (asset, recipe) = (asset("golden"), recipe("golden"));
    let tags: Vec<_> = NAMES
        .iter()
        .flat_map(|name| {
            self::asset(name).directory().entries.iter().map(|entry| entry.tag).collect::<Vec<_>>()
        })
        // Maps of a scene have a golden asset of their own.
        .chain([squall_formats::section::wet_maps::WetMapsSection::TAG])
        .collect();
    assert!(KNOWN.iter().all(|tag| tags.contains(tag)), "every kind of section has its golden: {tags:?}");

    let provenance = asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read).unwrap();
    assert_eq!(provenance.recipe_hash, *blake3::hash(recipe.text.as_bytes()).as_bytes());
    for input in &provenance.inputs {
        let bytes = std::fs::read(file(&input.name)).unwrap();
        let found = (input.bytes, input.hash);
        assert_eq!(found, (bytes.len() as u64, *blake3::hash(&bytes).as_bytes()), "{}", input.name);
    }
    assert!(provenance.inputs.len() >= 5 && provenance.tool.starts_with("squall "));

    let clouds = recipe.clouds.as_ref().unwrap();
    let scene = input::scene::read_scene(&clouds.scene, clouds.optics).unwrap();
    let grid = asset.section(CloudSection::TAG, "the cloud grid", CloudSection::read).unwrap();
    assert_eq!(grid.head.shape.to_array(), [9, 8, 4]);
    assert_eq!((grid.head.cell_m, grid.head.origin_m), ([50.0, 40.0, 30.0], [-225.0, -160.0, 600.0]));
    assert_eq!((grid.head.albedo, grid.head.g, grid.head.periodic_xy), (0.999, 0.85, false));
    assert_eq!(grid.extinction.values()[..], scene.cloud.extinction[..]);

    let strokes = asset.section(BoltSection::TAG, "strokes", BoltSection::read).unwrap();
    assert_eq!(strokes.strokes, recipe.strokes);
    let density = read_density(&asset).unwrap();
    assert_eq!(density.ranges, recipe.rain.as_ref().unwrap().density.ranges);
    assert!(density.measured_error <= density.asked_error && density.asked_error == 0.01);
    let streaks = asset.section(StreakSection::TAG, "streaks", StreakSection::read).unwrap();
    let names: Vec<_> = streaks.patterns.iter().map(|p| (p.name.as_str(), p.size_px)).collect();
    assert_eq!(names, [("streak0", [12, 60]), ("streak1", [10, 48])]);
    let town = asset.section(TownSection::TAG, "the town", TownSection::read).unwrap();
    assert_eq!(town, input::town::read_town(&file("town.json")).unwrap());
    let renderer = StormRenderer::new(&asset).unwrap();
    assert_eq!(renderer.view(), recipe.view.as_ref());
}

#[test]
fn golden_responses_are_of_the_kinds_that_their_recipes_ask_for() {
    let kind = |name| {
        let asset = asset(name);
        let head = Relighter::new(&asset).unwrap().response().head.clone();
        (head.basis, head.codec, head.direct, head.distant.len())
    };
    let harmonics = DirectionalBasis::Harmonics { degree: 1 };
    assert_eq!(kind("golden"), (harmonics, Codec::Bytes, DirectTerm::AtRunTime, 3));
    assert_eq!(kind("paper"), (DirectionalBasis::Directions26, Codec::Paper, DirectTerm::InRows, 0));
    let asset = asset("golden");
    let distant = Relighter::new(&asset).unwrap().response().head.distant.clone();
    assert_eq!(distant[2].kind, DistantKind::Beam { direction: [0.8, 0.0, -0.6] });
}

#[test]
fn a_golden_asset_still_draws_its_view() {
    let asset = asset("golden");
    let mut renderer = StormRenderer::new(&asset).unwrap();
    let frame = renderer.frame().unwrap();
    let picture = renderer.render(&frame).unwrap();
    assert_eq!((picture.width, picture.height), (64, 36));
    assert!(picture.pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    assert!(picture.pixels.iter().flatten().sum::<f32>() > 0.0);
}

#[test]
fn the_golden_asset_for_eyes_says_which_cells_they_see_and_where_they_stand() {
    let asset = asset("eyes");
    let relighter = Relighter::new(&asset).unwrap();
    let section = relighter.response();
    assert_eq!((section.version, section.head.basis), (2, DirectionalBasis::ViewRegion { degree: 1 }));
    assert_eq!(section.head.view_region, recipe("eyes").clouds.unwrap().response.view_region);
    let seen = relighter.known_cells().iter().filter(|&&seen| seen).count();
    assert_eq!(
        (seen as u64, relighter.cloud().shape.len()),
        (expected("eyes")["seen"].as_u64().unwrap(), 288)
    );
    // Version 1 says nothing of cells: those that rays shade with are known.
    let old = self::asset("golden");
    let old = Relighter::new(&old).unwrap();
    assert_eq!((old.response().version, old.known_cells()), (1, old.cloud().shaded()));
}

#[test]
fn the_golden_asset_of_levels_holds_rows_in_windows_and_codes_them() {
    let asset = asset("levels");
    let relighter = Relighter::new(&asset).unwrap();
    let section = relighter.response();
    assert_eq!((section.version, section.head.codec), (4, Codec::Entropy));
    let [level] = section.head.finer.as_slice() else { panic!("one level") };
    assert!(!level.windows.is_empty() && !level.nodes.is_empty());
    // Rows of the light grid, then those of the level.
    let listed: usize = level.windows.iter().map(|window| window.rows as usize).sum();
    assert_eq!(section.row_count(), level.first_row as usize + listed);
}

#[test]
fn the_golden_asset_of_fitted_light_says_so_and_its_grid_is_that_of_the_scene() {
    let asset = asset("fit");
    let relighter = Relighter::new(&asset).unwrap();
    let section = relighter.response();
    assert_eq!((section.version, section.head.stored), (5, Stored::Fit));
    assert_eq!((section.head.shape.to_array(), relighter.is_coarse()), ([3, 4, 2], true));
    assert_eq!(asset.directory().find(CloudSection::TAG).unwrap().version, 2);
    let clouds = recipe("fit").clouds.unwrap();
    let scene = input::scene::read_scene(&clouds.scene, clouds.optics).unwrap();
    assert_eq!(relighter.cloud().extinction, scene.cloud.extinction);
}

#[test]
fn the_golden_asset_under_the_sun_holds_its_beams_and_light_on_blocks() {
    let asset = asset("sun");
    let relighter = Relighter::new(&asset).unwrap();
    let section = relighter.response();
    assert_eq!((section.version, section.head.shape.to_array()), (3, [3, 4, 2]));
    assert_eq!((relighter.cloud().shape.to_array(), relighter.is_coarse()), ([9, 8, 4], true));
    assert_eq!(section.head.suns().len() + 2, section.head.distant.len());
}

/// Not a test: makes the files again. See data/golden/v1/README.md.
#[test]
#[ignore = "writes data/golden/v5"]
fn write_golden_assets() {
    let mut expected = expected(NEWER[0]);
    // Versions 1 to 4 are kept as they are: these recipes write newer ones now.
    for name in NEWER {
        let baked = pipeline::bake(&recipe(name), &Quiet).unwrap();
        let mut bytes = Vec::new();
        write(&mut bytes, &baked.sections).unwrap();
        assert!(bytes.len() <= 100_000, "{name}: {} bytes", bytes.len());
        std::fs::write(beside(name, &format!("{name}.squall")), bytes).unwrap();
        expected[name] = figures(name);
    }
    std::fs::write(beside(NEWER[0], "expected.json"), format!("{expected:#}\n")).unwrap();
}
