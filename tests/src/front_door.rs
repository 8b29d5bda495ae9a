//! The front door: a renderer that an engine can hold, strokes anywhere, light as data, frames that keep what stays the same.

use crate::frame::{RECIPE, asset, bake, sections};
use glam::DVec3;
use squall_bake::cloud::{TruthSettings, solve_light};
use squall_bake::fields::Fields;
use squall_bake::input::scene::{Optics, read_scene};
use squall_bake::pipeline;
use squall_bake::progress::Quiet;
use squall_bake::recipe::Recipe;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::density::DensitySection;
use squall_formats::units::{MillimetresPerHour, Seconds};
use squall_runtime::clouds::{CloudLight, Viewer};
use squall_runtime::relight::PointLight;
use squall_runtime::single_scatter::{DirectRays, DirectSettings, add_direct};
use squall_runtime::transport::direct::Light;
use squall_runtime::{Asset, Camera, Clouds, Flash, Frame, RuntimeError, StormRenderer, Stroke};
use std::sync::Arc;

#[test]
fn an_engine_can_store_every_part_and_hand_it_from_thread_to_thread() {
    // The bounds of a Bevy resource.
    fn assert<T: Send + Sync + 'static>() {}
    assert::<StormRenderer>();
    assert::<Clouds>();
    assert::<CloudLight>();
    assert::<Asset>();
    assert::<Frame>();
    assert::<Flash>();
    assert::<Stroke>();
    assert::<Camera>();
    assert::<RuntimeError>();
}

fn reseeded(record: &StrokeRecord, number: u64) -> StrokeRecord {
    StrokeRecord { seed: record.seed + 1000 * (number + 1), ..record.clone() }
}

#[test]
fn strokes_with_other_seeds_light_a_pruned_cloud_all_of_them() {
    let mut renderer = StormRenderer::new(asset(sections())).unwrap();
    let records: Vec<StrokeRecord> = renderer.strokes().to_vec();
    let frame = renderer.frame().unwrap().dark();
    let clouds = renderer.clouds().unwrap();
    assert!(clouds.share_lit() < 1.0, "the asset is pruned");
    let cells = clouds.cloud().shape.len();
    let mut pruned = 0;
    for number in 0..12 {
        for record in &records {
            let stroke = Stroke::grow(&reseeded(record, number));
            pruned += usize::from(stroke.lights(0.0).iter().any(|light| !clouds.is_lit(light.position)));
            let mut light = vec![[0.0; 4]; cells];
            clouds.radiance(&[Flash::own(stroke)], frame.camera.position, &mut light).unwrap();
            assert!(light.iter().any(|cell| cell[0] > 0.0), "{} {number}", record.name);
        }
    }
    assert!(pruned > 0, "some of the 24 leave what was baked");
}

/// Not a test of small assets: 24 strokes of the sample's, with other seeds.
#[test]
#[ignore = "minutes; wants SQUALL_SAMPLE, an asset baked from data/storm/storm.toml"]
fn strokes_with_other_seeds_light_the_sample_storm_all_of_them() {
    let Some(path) = std::env::var_os("SQUALL_SAMPLE") else {
        println!("skipped: no SQUALL_SAMPLE");
        return;
    };
    let asset = Asset::open(path).unwrap();
    let renderer = StormRenderer::new(&asset).unwrap();
    let mut clouds = Clouds::new(&asset).unwrap();
    clouds.set_rays(squall_runtime::single_scatter::DirectRays::PerPoint(64));
    let mut cells = vec![[0.0; 4]; clouds.cloud().shape.len()];
    let (mut lit, mut from_rows) = (0, 0);
    for number in 0..8 {
        for record in renderer.strokes() {
            let stroke = Stroke::grow(&reseeded(record, number));
            from_rows += usize::from(stroke.lights(0.0).iter().all(|light| clouds.is_lit(light.position)));
            clouds.radiance(&[Flash::own(stroke)], DVec3::new(-1.5, 0.0, 2.4), &mut cells).unwrap();
            lit += usize::from(cells.iter().any(|cell| cell[0] > 0.0));
            println!("{} with another seed, round {number}: {lit} lit so far", record.name);
        }
    }
    println!("{lit} of 24 light the storm; {from_rows} from rows alone");
    assert_eq!(lit, 24);
}

/// What rows of four harmonics tell of light that a live solve has in sixteen: near a point it is scattered on so narrowly that four
/// fall below zero in nearly half of the cells, where it is cut off. The codec is .0002 of the sum here, the metre between the two
/// lights .0015, a live solve's own rays .0004.
const NEARLY: f64 = 0.10;
/// The same of rows that have sixteen too: the metre, the codec, and two solves to the same residual.
const SAME: f64 = 0.01;

#[test]
fn a_live_solve_is_the_light_that_rows_hold() {
    let fine = RECIPE.replace("test_strokes = 0", "test_strokes = 0\nbasis = \"harmonics-3\"\nerror = 0.001");
    for (asset, allowed) in [(asset(sections()), NEARLY), (asset(&bake(&fine)), SAME)] {
        let mut clouds = Clouds::new(&asset).unwrap();
        let inside = Stroke::grow(&StormRenderer::new(asset).unwrap().strokes()[0]);
        let lit = inside.lights(0.0);
        let rows = clouds.light(&lit).unwrap();
        assert_eq!((rows.lights_outside(), rows.live_report()), (0, None));
        // A metre past the edge of what rows answer for: light there is nearly the same light.
        let far = clouds.bounds()[0] - DVec3::splat(1e3);
        let edge = clouds.nearest_lit(far).unwrap();
        let past = edge + (far - edge).normalize();
        let [outside, edge] = [past, edge].map(|position| PointLight { position, intensity: 1e6 });
        let live = clouds.light(&[outside]).unwrap();
        assert_eq!(live.lights_outside(), 1);
        let solved = live.live_report().unwrap();
        assert!(solved.sweeps > 0 && solved.residual > 0.0);
        let sum = |light: &CloudLight| -> f64 {
            let mut j = vec![0.0; 12 * 12 * 12];
            light.radiance(DVec3::new(0.0, 0.0, 2.0), &mut j).unwrap();
            j.iter().map(|&v| f64::from(v)).sum()
        };
        let rows = clouds.light(&[edge]).unwrap();
        assert_eq!(rows.lights_outside(), 0);
        let off = sum(&live) / sum(&rows) - 1.0;
        println!("{off:.4} of {allowed}");
        assert!(off.abs() < allowed, "{off}");
    }
}

#[test]
fn light_as_data_has_the_direct_light_of_every_cell() {
    let mut clouds = Clouds::new(&asset(sections())).unwrap();
    let viewer = DVec3::new(0.0, 0.0, 2.0);
    let stroke = StormRenderer::new(asset(sections())).unwrap().stroke("ground").unwrap();
    let cloud = clouds.cloud().clone();
    let cells = cloud.shape.len();
    let way = |cell: usize| (viewer - cloud.centre(cloud.shape.cell(cell))).normalize();
    let ways: Vec<[f32; 3]> = (0..cells).map(|cell| way(cell).as_vec3().to_array()).collect();
    let mut direct = vec![0.0; cells];
    let settings = DirectSettings { rays: DirectRays::STILL, ..DirectSettings::default() };
    let scale = clouds.relighter().extinction_scale();
    add_direct(&cloud, scale, &stroke.lights(0.0), &ways, settings, &mut direct);
    let mut scattered = vec![0.0; cells];
    let light = clouds.light(&stroke.lights(0.0)).unwrap();
    light.in_scattered().towards_each(&cloud, |cell, _| way(cell), &mut scattered);
    let mut found = vec![[0.0; 4]; cells];
    clouds.radiance(&[Flash::named("ground").colored([1.0; 3])], viewer, &mut found).unwrap();
    let most = found.iter().fold(0.0f32, |most, cell| most.max(cell[0]));
    // The ball's middle is 5.5 cells from the sides, and no cloud is farther than 6.5 from it.
    let is_air = |cell: usize| {
        let away = DVec3::from_array(cloud.shape.cell(cell).map(|at| at as f64 - 5.5)).length();
        away > 8.5
    };
    let mut lit = 0;
    for cell in 0..cells {
        let wanted = (scattered[cell] + direct[cell]).max(0.0);
        assert!((found[cell][0] - wanted).abs() <= ROUND_OFF * most, "{cell}: {} {wanted}", found[cell][0]);
        lit += usize::from(is_air(cell) && direct[cell] > 0.0);
    }
    assert!(lit > 20, "{lit} cells of air beyond the first are lit straight");
}

/// Single precision sums of a few thousand terms, relative to a picture's brightest pixel.
const ROUND_OFF: f32 = 1e-5;

#[test]
fn frames_of_a_flash_are_fresh_pictures_to_round_off_and_keep_their_strokes_light() {
    // One without a town, and one with.
    for asset in [asset(sections()), Asset::open(crate::root().join("data/golden/v1/golden.squall")).unwrap()]
    {
        check_flash(&asset);
    }
}

fn check_flash(asset: &Asset) {
    let mut used = StormRenderer::new(asset).unwrap();
    let names = used.strokes().iter().take(2).map(|record| &record.name);
    let strokes: Vec<Arc<Stroke>> = names.map(|name| used.stroke(name).unwrap()).collect();
    let still = used.frame().unwrap().dark();
    for (number, brightness) in [1.0, 0.3, 2.0, 0.0, 0.7].into_iter().enumerate() {
        let mut frame = still.clone().time(Seconds(number as f64 * 0.03));
        for (stroke, factor) in strokes.iter().zip([1.0, 0.5]) {
            let flash = Flash::own(stroke.clone()).brightness(brightness * factor);
            frame = frame.flash(flash.colored([1.0, 1.0 + brightness as f32, 0.5]));
        }
        let mut fresh = StormRenderer::new(asset).unwrap();
        let wanted = fresh.render(&frame).unwrap();
        let found = used.render(&frame).unwrap();
        let most = wanted.pixels.iter().flatten().fold(0.0f32, |most, &v| most.max(v));
        let pairs = found.pixels.iter().flatten().zip(wanted.pixels.iter().flatten());
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
        assert!(off <= ROUND_OFF * most, "frame {number}: {off} of {most}");
        let kept = if number == 0 || brightness == 0.0 { 0 } else { strokes.len() };
        assert_eq!(used.report().strokes_kept, kept, "frame {number}");
    }
}

#[test]
fn light_per_cell_scales_with_brightness_and_colour_in_both_precisions() {
    let mut clouds = Clouds::new(&asset(sections())).unwrap();
    let cells = clouds.cloud().shape.len();
    let viewer = DVec3::new(0.0, 0.0, 2.0);
    let [mut one, mut two] = [0, 1].map(|_| vec![[0.0f32; 4]; cells]);
    clouds.radiance(&[Flash::named("inside").colored([1.0, 1.0, 1.0])], viewer, &mut one).unwrap();
    let flash = Flash::named("inside").brightness(2.0).colored([0.5, 1.0, 2.0]);
    clouds.radiance(std::slice::from_ref(&flash), viewer, &mut two).unwrap();
    let mut half = vec![[0u16; 4]; cells];
    clouds.radiance_f16(&[flash], viewer, &mut half).unwrap();
    for ((one, two), half) in one.iter().zip(&two).zip(&half) {
        for (band, factor) in [1.0, 2.0, 4.0].into_iter().enumerate() {
            assert!((two[band] - factor * one[band]).abs() <= 1e-6 * two[band], "{one:?} {two:?}");
        }
        assert_eq!(two[3], one[3]);
        assert_eq!(*half, two.map(squall_runtime::clouds::f16_bits));
    }
    assert!(one.iter().any(|cell| cell[0] > 0.0) && one.iter().all(|cell| cell[0] >= 0.0));
    let error = clouds.radiance(&[], viewer, &mut one[1..]).unwrap_err().to_string();
    assert!(error.contains("1728 values"), "{error}");
    let error = clouds.radiance(&[], Viewer::At(DVec3::NAN), &mut one).unwrap_err().to_string();
    assert!(error.contains("viewer"), "{error}");
}

#[test]
fn an_asset_baked_for_a_view_region_says_why_it_has_no_fluence() {
    let asset = Asset::open(crate::root().join("data/golden/v2/eyes.squall")).unwrap();
    let mut clouds = Clouds::new(&asset).unwrap();
    let [low, high] = clouds.bounds();
    let light = clouds.nearest_lit(0.5 * (low + high)).unwrap();
    let light = clouds.light(&[PointLight { position: light, intensity: 1.0 }]).unwrap();
    let mut cells = vec![0.0; clouds.cloud().shape.len()];
    let error = light.fluence(&mut cells).unwrap_err().to_string();
    assert!(error.contains("view region"), "{error}");
    let error = light.radiance(DVec3::splat(1e6), &mut cells).unwrap_err().to_string();
    assert!(error.contains("camera position"), "{error}");
    // Even of no stroke at all: it is refused before light is worked out.
    let error = clouds.fluence(&[], &mut vec![[0.0; 3]; cells.len()]).unwrap_err().to_string();
    assert!(error.contains("view region"), "{error}");
}

#[test]
fn rain_that_cannot_be_drawn_is_refused_before_anything_is() {
    let golden = Asset::open(crate::root().join("data/golden/v1/golden.squall")).unwrap();
    let without_rain: Vec<_> =
        sections().iter().filter(|section| section.tag != DensitySection::TAG).cloned().collect();
    for (asset, words) in [(asset(&without_rain), "no rain"), (golden, "raise the shortest of streak_px")] {
        let mut renderer = StormRenderer::new(asset).unwrap();
        // Streaks down to two pixels in a long exposure: hundreds of millions of drops.
        let mut frame = renderer.frame().unwrap().rain(MillimetresPerHour(50.0)).exposure(Seconds(0.04));
        frame.streaks.length_px = [2.0, 200.0];
        frame.camera = frame.camera.resized([640, 360]).unwrap();
        let error = renderer.render(&frame).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
        let size = [renderer.picture().width, renderer.picture().height];
        assert_eq!(size, [1, 1], "nothing was drawn");
    }
}

const LAMPS: [[f64; 3]; 3] = [[210.0, -130.0, -150.0], [-175.0, 225.0, -5.0], [-175.0, 225.0, 75.0]];

#[test]
fn fluence_is_that_of_a_solve_in_the_mean_and_never_negative() {
    /// Three per cent: light between virtual point lights, and the codec.
    const MEAN: f64 = 0.03;
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.json");
    let density = crate::root().join("data/input/layer32.f32");
    std::fs::copy(density, folder.path().join("layer32.f32")).unwrap();
    let text = r#"{"dims_xyz": [32, 32, 4], "cell_m": 50.0, "origin_m": [-800.0, -800.0, 0.0],
        "density_file": "layer32.f32", "kappa_per_m": 0.03, "albedo": 0.999, "g": 0.5}"#;
    std::fs::write(&scene, text).unwrap();
    let recipe = folder.path().join("recipe.toml");
    // Virtual point lights 25 m apart around the lamps alone: sparks there are what the grid is pruned to.
    let mut text = "[clouds]\nscene = \"scene.json\"\n[clouds.lightning]\nlow_m = [-225.0, -175.0, -175.0]\n\
        high_m = [225.0, 275.0, 125.0]\nspacing_m = 25.0\nlongest_m = 25.0\nprune = true\n[clouds.transport]\n\
        directions = \"4x16\"\nrefine = 3\n[clouds.response]\nchannels = \"harmonics-1\"\ndirect = \"run-time\"\n\
        error = 0.02\ntest_strokes = 0\n"
        .to_owned();
    for (number, [x, y, z]) in LAMPS.into_iter().enumerate() {
        text += &format!(
            "[[strokes]]\nname = \"{number}\"\nseed = 1\nfrom_m = [{x:?}, {y:?}, {z:?}]\nto_m = [{:?}, {y:?}, {z:?}]\n\
             intensity_W_per_sr = 1.0\n",
            x + 2.0
        );
    }
    std::fs::write(&recipe, text).unwrap();
    let baked = asset(&pipeline::bake(&Recipe::read(&recipe).unwrap(), &Quiet).unwrap().sections);
    let mut clouds = Clouds::new(&baked).unwrap();
    let cloud = read_scene(&scene, Optics::default()).unwrap().cloud;
    // The settings of `squall solve` itself.
    let settings = TruthSettings { high_degree: false, ..TruthSettings::default() };
    for position in LAMPS.map(DVec3::from_array) {
        let truth = solve_light(&cloud, Light::Point { position, intensity: 1.0 }, &[], &settings, &Quiet);
        let fields = Fields::of_truth(&truth.unwrap(), &[], &Quiet).unwrap();
        let (direct, scattered) = (&fields.phi_direct.mean, &fields.phi_scattered.mean);
        let wanted: Vec<f32> = direct.iter().zip(scattered).map(|(a, b)| a + b).collect();
        let mut found = vec![0.0; cloud.shape.len()];
        clouds.light(&[PointLight { position, intensity: 1.0 }]).unwrap().fluence(&mut found).unwrap();
        let mean = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
        let off = mean(&found) / mean(&wanted) - 1.0;
        println!("lamp {position}: mean fluence off by {:.2} %", 100.0 * off);
        assert!(off.abs() < MEAN, "{position}: {off}");
        assert!(found.iter().all(|&value| value >= 0.0), "{position}");
    }
}
