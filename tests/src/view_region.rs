//! Light towards viewpoints of a view region: as right there as light all around, in a fraction of the bytes, and refused elsewhere.

use glam::DVec3;
use squall_bake::diff::diff;
use squall_bake::evaluate::cost::stroke_ms;
use squall_bake::pipeline::bake;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_bake::relit::relight;
use squall_formats::container::write;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::provenance::{BudgetRecord, ProvenanceSection};
use squall_formats::section::response::{DirectionalBasis, ResponseSection};
use squall_formats::units::Radians;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::relight::{PointLight, RelightBuffers, Relighter};
use squall_runtime::stroke::Stroke;
use squall_runtime::{Asset, Clouds};
use std::path::Path;

/// A cloud 2 km from the viewpoints, thick enough to hide its far side: 7 × 10 × 5 cells of 100 m, a mean free path of 20 m behind
/// a thin front.
fn write_scene(folder: &Path) {
    let mut bytes = Vec::new();
    for z in 0..5 {
        for y in 0..10 {
            for x in 0..7 {
                let density = if y == 0 { 0.3f32 } else { 4.6 + 0.1 * ((x * 7 + y * 5 + z * 3) % 9) as f32 };
                bytes.extend_from_slice(&density.to_le_bytes());
            }
        }
    }
    std::fs::write(folder.join("cloud.f32"), bytes).unwrap();
    let scene = r#"{"dims_xyz": [7, 10, 5], "cell_m": 100.0, "origin_m": [-350.0, 2000.0, 600.0], "density_file": "cloud.f32",
        "kappa_per_m": 0.01, "albedo": 0.995, "g": 0.8}"#;
    std::fs::write(folder.join("cloud.json"), scene).unwrap();
}

const VIEWPOINTS: &str =
    "[clouds.view_region]\nlow_m = [-100.0, -100.0, 0.0]\nhigh_m = [100.0, 100.0, 40.0]\n";

/// A stroke up through the cloud.
const STROKE: &str = "[[strokes]]\nname = \"own\"\nseed = 3\nfrom_m = [0.0, 2300.0, 650.0]\nto_m = [100.0, 2600.0, 1000.0]\n\
    intensity_W_per_sr = 1e6\n";

fn text(lines: &str) -> String {
    format!("[clouds]\nscene = \"cloud.json\"\n\n[clouds.transport]\ntolerance = 1e-4\n\n{lines}")
}

fn baked(folder: &Path, lines: &str) -> Asset {
    write_scene(folder);
    let path = folder.join("recipe.toml");
    std::fs::write(&path, text(lines)).unwrap();
    let mut bytes = Vec::new();
    write(&mut bytes, &bake(&Recipe::read(&path).unwrap(), &Quiet).unwrap().sections).unwrap();
    Asset::from_bytes(&bytes).unwrap()
}

fn records(asset: &Asset) -> Vec<BudgetRecord> {
    asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read).unwrap().budgets
}

fn figure(asset: &Asset, what: &str) -> f64 {
    let records = records(asset);
    records.iter().find(|record| record.metric.contains(what)).unwrap_or_else(|| panic!("no {what}")).got
}

fn response_bytes(asset: &Asset) -> u64 {
    asset.directory().entries.iter().find(|entry| entry.tag == ResponseSection::TAG).unwrap().length
}

/// Rows hardly coded, so that bases alone differ.
fn fixed(basis: &str, view_region: &str) -> String {
    format!(
        "[clouds.lightning]\nspacing_m = 250.0\n\n[clouds.response]\nbasis = \"{basis}\"\nerror = 0.001\n\
         test_strokes = 6\n\n{view_region}"
    )
}

#[test]
fn three_coefficients_towards_a_view_region_are_as_good_there_as_sixteen_harmonics_and_take_a_fifth_of_the_bytes()
 {
    /// What a polynomial of degree 1 may add to the error that lamps' distance makes, both as L2.
    const ADDED: f64 = 0.01;
    /// Three coefficients of sixteen are 5.3 times fewer.
    const FEWER: u64 = 5;
    /// Share of this small cloud's cells that its front leaves in sight, three rounds beside what is traced taken in: 0.96.
    const HIDDEN: f64 = 0.97;
    let folder = tempfile::tempdir().unwrap();
    let view_region = baked(folder.path(), &fixed("view-region-1", VIEWPOINTS));
    let all = baked(folder.path(), &fixed("harmonics-3", VIEWPOINTS));
    let (few, many) = (figure(&view_region, "stroke L2"), figure(&all, "stroke L2"));
    println!(
        "stroke L2: {few:.4} in {} bytes, {many:.4} in {}",
        response_bytes(&view_region),
        response_bytes(&all)
    );
    assert!(few <= libm::sqrt(many * many + ADDED * ADDED), "{few} beside {many}");
    assert!(FEWER * response_bytes(&view_region) < response_bytes(&all));
    // Against light all around, deep cells too: what the box alone saves.
    let anywhere = baked(folder.path(), &fixed("harmonics-3", ""));
    let seen = figure(&view_region, "share of cells");
    println!("{seen:.3} of the cells are seen; {} bytes for any viewpoint", response_bytes(&anywhere));
    assert!(seen < HIDDEN && response_bytes(&all) < response_bytes(&anywhere));
}

#[test]
fn a_budget_takes_a_basis_towards_a_view_region_where_that_is_cheapest_and_is_met_by_held_out_viewpoints() {
    let folder = tempfile::tempdir().unwrap();
    let asked = 0.2;
    let budget = format!("[clouds.response]\ntest_strokes = 8\n\n[clouds.budget]\nstroke_l2 = {asked}\n\n");
    let asset = baked(folder.path(), &format!("{budget}{VIEWPOINTS}"));
    let relighter = Relighter::new(&asset).unwrap();
    let head = &relighter.response().head;
    let chosen = records(&asset).into_iter().find(|record| record.asked == Some(asked)).unwrap();
    println!("{chosen:?}, {} bytes", response_bytes(&asset));
    assert!(matches!(head.basis, DirectionalBasis::ViewRegion { .. }), "{:?}", head.basis);
    assert!(chosen.metric.contains("held-out viewpoints") && chosen.got <= asked, "{chosen:?}");
    let anywhere = baked(folder.path(), &budget);
    println!("without a view region {} bytes", response_bytes(&anywhere));
    /// For any viewpoint it takes four coefficients or more where a view region takes one.
    const FEWER: u64 = 2;
    assert!(FEWER * response_bytes(&asset) < response_bytes(&anywhere));
}

#[test]
fn a_budget_in_milliseconds_is_kept_and_buys_error_with_them() {
    let folder = tempfile::tempdir().unwrap();
    /// Apart by a factor of √3 each.
    const ASKED_MS: [f64; 3] = [0.005, 0.0087, 0.015];
    let budget = |ms: f64| {
        let spacing = "[clouds.lightning]\nspacing_m = 150.0\n\n[clouds.response]\ntest_strokes = 8";
        format!("{spacing}\n\n[clouds.budget]\nrelight_ms = {ms}\n\n{VIEWPOINTS}{STROKE}")
    };
    let made = ASKED_MS.map(|ms| {
        let asset = baked(folder.path(), &budget(ms));
        let record = records(&asset).into_iter().find(|record| record.asked == Some(ms)).unwrap();
        println!("{record:?}");
        assert!(record.got <= ms && record.metric.contains("ms as counted"), "{record:?}");
        // The scene's own stroke, whole, is among what is counted.
        let relighter = Relighter::new(&asset).unwrap();
        let own = asset.section(BoltSection::TAG, "strokes", BoltSection::read).unwrap();
        let lights = Stroke::grow(&own.strokes[0]).lights(0.0);
        assert!(stroke_ms(&relighter, &lights, &mut RelightBuffers::default()).unwrap() <= record.got);
        figure(&asset, "stroke L2")
    });
    assert!(made.windows(2).all(|pair| pair[1] < pair[0]), "{made:?}");
}

#[test]
fn a_budget_in_milliseconds_out_of_reach_says_the_best_there_is_and_what_helps() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let path = folder.path().join("recipe.toml");
    // Transforming one channel of 350 cells counts for 0.00105 ms already.
    let budget = "[clouds.lightning]\nspacing_m = 250.0\n\n[clouds.budget]\nrelight_ms = 0.001\n\n";
    std::fs::write(&path, text(&format!("{budget}{VIEWPOINTS}"))).unwrap();
    let error = bake(&Recipe::read(&path).unwrap(), &Quiet).map(|_| ()).unwrap_err().to_string();
    for word in ["relight_ms 0.001", "counts for 0.00", "allow more milliseconds", "spacing_m"] {
        assert!(error.contains(word), "{word}: {error}");
    }
}

#[test]
fn pictures_from_outside_the_box_and_fields_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let asset = baked(folder.path(), &fixed("view-region-0", VIEWPOINTS));
    let mut clouds = Clouds::new(&asset).unwrap();
    let lights = [PointLight { position: DVec3::new(0.0, 2400.0, 900.0), intensity: 1.0 }];
    let mut shown = |position: DVec3, cells: bool| {
        let way = DVec3::new(0.0, 2400.0, 900.0) - position;
        let perspective = Projection::Perspective { vertical_fov: Radians(0.5) };
        let camera = Camera::new(position, way, DVec3::Z, perspective, [16, 12]).unwrap();
        let drawn = relight(&mut clouds, &lights, ("eye", &camera), None, cells, &Quiet);
        drawn.map(|(fields, _)| fields.images[0].2.mean.clone()).map_err(|error| error.to_string())
    };
    let picture = shown(DVec3::new(0.0, 0.0, 2.0), false).unwrap();
    assert!(picture.iter().any(|&pixel| pixel > 0.0), "a lit cloud in the middle of the picture");
    for outside in [DVec3::new(0.0, 0.0, 500.0), DVec3::new(0.0, 101.0, 2.0)] {
        let error = shown(outside, false).unwrap_err();
        assert!(error.contains("camera position") && error.contains(&outside.to_string()), "{error}");
    }
    let error = shown(DVec3::new(0.0, 0.0, 2.0), true).unwrap_err();
    assert!(error.contains("fields") && error.contains("towards its view region alone"), "{error}");
    let flat = Projection::Orthographic { half_width: 100.0, half_height: 100.0 };
    let flat = Camera::new(DVec3::ZERO, DVec3::Y, DVec3::Z, flat, [4, 4]).unwrap();
    let error = clouds.relighter().check_camera(&flat).unwrap_err().to_string();
    assert!(error.contains("an orthographic camera"), "{error}");
}

#[test]
fn assets_for_a_view_region_and_for_anyone_are_compared_where_both_can_be_seen() {
    /// Degree 1 against degree 3, coding, and cells that only one of them knows left out.
    const NEAR: f64 = 0.05;
    let folder = tempfile::tempdir().unwrap();
    let [few, all] = [("view-region-1", VIEWPOINTS), ("harmonics-3", "")]
        .map(|(basis, view_region)| baked(folder.path(), &fixed(basis, view_region)));
    let found = diff(&few, &all).unwrap();
    let l2 = found
        .parts
        .iter()
        .find(|error| error.metric.contains("relative L2") && error.metric.contains("relit"));
    let value = l2.and_then(|error| error.value).unwrap();
    assert!(value > 0.0 && value < NEAR, "{value}");
    let away = VIEWPOINTS
        .replace("[-100.0, -100.0, 0.0]", "[-100.0, -900.0, 0.0]")
        .replace("[100.0, 100.0, 40.0]", "[100.0, -500.0, 40.0]");
    let other = baked(folder.path(), &fixed("view-region-1", &away));
    let found = diff(&few, &other).unwrap();
    assert!(found.parts.iter().any(|error| error.value.is_none() && error.metric.contains("do not meet")));
}

#[test]
fn view_regions_that_make_no_sense_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let path = folder.path().join("recipe.toml");
    let refused = |lines: &str, words: [&str; 2]| {
        std::fs::write(&path, text(lines)).unwrap();
        let error = match Recipe::read(&path) {
            Err(error) => error.to_string(),
            Ok(recipe) => bake(&recipe, &Quiet).map(|_| ()).unwrap_err().to_string(),
        };
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    let view_region =
        |low: &str, high: &str| format!("[clouds.view_region]\nlow_m = {low}\nhigh_m = {high}\n");
    let basis = "[clouds.response]\nbasis = \"view-region-1\"\n";
    refused(basis, ["clouds.response.basis", "[clouds.view_region]"]);
    refused(&format!("{basis}direct = \"rows\"\n{VIEWPOINTS}"), ["clouds.response.basis", "run-time"]);
    refused(
        &view_region("[0.0, 0.0, 9.0]", "[1.0, 1.0, 8.0]"),
        ["clouds.view_region.high_m", "no less than low_m"],
    );
    refused(
        &view_region("[0.0, nan, 0.0]", "[1.0, 1.0, 8.0]"),
        ["clouds.view_region.low_m", "three numbers"],
    );
    let near = view_region("[-400.0, 1000.0, 0.0]", "[400.0, 1900.0, 300.0]");
    refused(&format!("{basis}{near}"), ["clouds.response.basis", "too near"]);
    let view = "[view]\nposition_m = [0.0, 0.0, 99.0]\nheading_deg = 90.0\n";
    refused(&format!("{VIEWPOINTS}{view}"), ["view.position_m", "[clouds.view_region]"]);
}

/// Names that keys had before, and have still.
const OLD_NAMES: [(&str, &str); 3] =
    [("[clouds.view_region]", "[clouds.eyes]"), ("basis = ", "channels = "), ("view-region-1", "eyes-1")];

fn in_old_names(lines: &str) -> String {
    OLD_NAMES.iter().fold(lines.to_owned(), |lines, (new, old)| lines.replace(new, old))
}

#[test]
fn a_recipe_with_the_old_names_of_keys_bakes_to_the_same_sections() {
    let folder = tempfile::tempdir().unwrap();
    let lines = fixed("view-region-1", VIEWPOINTS);
    let [new, old] = [lines.clone(), in_old_names(&lines)].map(|lines| baked(folder.path(), &lines));
    assert_eq!(new.directory().entries.len(), old.directory().entries.len());
    for (a, b) in new.directory().entries.iter().zip(&old.directory().entries) {
        // Provenance has the recipe's hash.
        let same = a.bytes(new.bytes()).unwrap() == b.bytes(old.bytes()).unwrap();
        assert_eq!((a.tag, same), (b.tag, a.tag != ProvenanceSection::TAG));
    }
}

#[test]
fn messages_name_keys_as_the_recipe_has_them_and_two_names_of_one_key_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path());
    let path = folder.path().join("recipe.toml");
    let refused = |lines: &str, words: [&str; 2]| {
        std::fs::write(&path, text(lines)).unwrap();
        let error = Recipe::read(&path).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    let basis = "[clouds.response]\nbasis = \"view-region-1\"\n";
    let rows = format!("{basis}direct = \"rows\"\n{VIEWPOINTS}");
    refused(&in_old_names(&rows), ["clouds.response.channels", "run-time"]);
    refused(
        &in_old_names(&VIEWPOINTS.replace("-100.0, 0.0", "nan, 0.0")),
        ["clouds.eyes.low_m", "three numbers"],
    );
    refused(&format!("{VIEWPOINTS}{}", in_old_names(VIEWPOINTS)), ["clouds.eyes", "both"]);
    refused(&format!("{basis}channels = \"harmonics-1\"\n"), ["clouds.response.channels", "both"]);
}
