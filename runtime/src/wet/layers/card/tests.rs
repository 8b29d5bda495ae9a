use super::*;
use crate::assert_layout;
use crate::gpu::test_gpu;
use crate::wet::card::{differences, textures};
use crate::wet::drop::stage::Stage;
use crate::wet::maps::{GroundMap, LightningVolume};
use crate::world::{Sun, WorldLight};
use glam::{DVec2, DVec3, Vec3};
use squall_formats::units::Radians;

/// Light of the drops of a layer, relative to the root mean square: single precision of a drop's place, where its glint is a few hundredths of its width.
const LIGHT: f64 = 5e-4;
/// Share that drops hide, root mean square: edges of drops in single precision.
const COVER: f64 = 1e-5;

#[test]
fn structs_lie_as_the_shader_has_them() {
    assert_layout!(LAYERS, Sheet { key, fallen, cell, part, depth, radius, way, threshold, blur });
    type Layers = LayersUniform;
    assert_layout!(
        LAYERS,
        Layers {
            along,
            count,
            is_paper,
            edge_strength,
            edge_bias,
            lightning_bias,
            opacity,
            back_light,
            milk,
            sheets
        }
    );
}

/// The stage's box before a sky with a sun and a bright window in the picture.
fn stage(size: [u32; 2]) -> Stage {
    let mut stage = Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(2.0, 5.0, 1.9), size);
    let sky = |d: Vec3| if d.z > 0.0 { [0.3, 0.4, 0.3 + 0.3 * d.x] } else { [0.05; 3] };
    let towards = Vec3::new(0.3, 0.8, 0.4).normalize();
    let sun = Sun { towards, irradiance: [2.0, 1.5, 1.0], angular_radius: Radians(0.0047) };
    stage.light = WorldLight::from_radiance(&sky, Some(sun));
    stage.wind = DVec3::new(2.0, -1.0, 0.0);
    let width = size[0] as usize;
    for (at, colour) in stage.buffer.colour.iter_mut().enumerate() {
        if (at % width) / 20 == 3 && (at / width) / 20 == 2 {
            *colour = [9.0, 6.0, 3.0];
        }
    }
    stage.buffer.depth_m[5] = f32::NAN;
    stage
}

/// A lamp 5 m above the ground, and lightning that the scene sends on.
fn lit(stage: &mut Stage) {
    let (cells, cell_m, origin_m) = ([60, 50], 0.25, DVec2::new(-4.0, -3.0));
    let band = |share: f32| {
        let value = |at: usize| {
            let place = origin_m + cell_m * DVec2::new((at % 60) as f64 + 0.5, (at / 60) as f64 + 0.5);
            let away = 25.0 + (place - DVec2::new(3.5, 4.0)).length_squared();
            share * (400.0 / (away * away.sqrt())) as f32
        };
        GroundMap { origin_m, cell_m, size: cells, values: (0..3000).map(value).collect() }
    };
    stage.maps.overhead = Some([band(1.0), band(0.8), band(0.4)]);
    let harmonics = |at: usize| [0.01 * (at % 11) as f32, 0.2, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0];
    stage.maps.lightning = Some(LightningVolume {
        origin_m: DVec3::new(-2.0, -2.0, 0.0),
        cell_m: 3.0,
        size: [4, 5, 2],
        directions: vec![DVec3::new(0.0, 0.6, 0.8), DVec3::new(-0.8, 0.0, 0.6)],
        harmonics: (0..80).map(harmonics).collect(),
    });
}

fn both(
    gpu: &Gpu,
    card: &mut CardLayers,
    stage: &Stage,
    (time_s, lightning): (f64, [f32; 2]),
    controls: &LayerControls,
) -> [Layer; 2] {
    let mut frame = stage.frame(time_s);
    frame.lightning = lightning;
    let mut wanted = Layer::default();
    Layers::new(5).draw(&frame, controls, &mut wanted).unwrap();
    let [picture, metres] = textures(gpu, &stage.buffer);
    let on_card = CardFrame {
        rate_mm_per_h: frame.rate_mm_per_h,
        flux: frame.flux,
        wind: frame.wind,
        time_s,
        seed: frame.seed,
        lightning,
        ..CardFrame::new(frame.camera, frame.light, [&picture.view, &metres.view])
    };
    card.draw(&on_card, controls).unwrap();
    [card.read().unwrap(), wanted]
}

#[test]
fn layers_of_rain_on_the_card_are_the_processors() {
    let Some(gpu) = test_gpu() else { return };
    let mut card = CardLayers::new(&gpu, &Layers::new(5));
    let plain = LayerControls::default();
    let many = LayerControls { layers: 6.0, size: 4.0, near_m: 0.4, exposure_ms: 1.0, ..plain };
    for (what, size, time, flash, controls) in [
        ("three layers", [320, 240], 3.0, [0.0; 2], plain),
        ("six of large drops", [149, 83], 123_456.78, [0.0; 2], many),
        ("no beams", [149, 83], 3.0, [0.0; 2], LayerControls { back_light: 0.0, ..many }),
        ("before time began", [149, 83], -7.25, [0.0; 2], many),
        ("one texture", [320, 240], 3.0, [0.0; 2], LayerControls { shift: 0.0, ..plain }),
        ("the paper's water", [149, 83], 3.0, [0.0; 2], LayerControls { paper: 1.0, ..many }),
        ("lightning", [149, 83], 3.0, [0.7, 0.2], many),
    ] {
        let [found, wanted] = both(&gpu, &mut card, &stage(size), (time, flash), &controls);
        let [light, cover] = differences(&found, &wanted);
        println!("{what}: light {light:.1e} relative L2, cover {cover:.1e}");
        assert!(light < LIGHT && cover < COVER, "{what}: {light} {cover}");
    }
}

#[test]
fn lamps_overhead_and_lightning_that_the_scene_sends_on_light_drops_as_on_the_processor() {
    let Some(gpu) = test_gpu() else { return };
    let mut card = CardLayers::new(&gpu, &Layers::new(5));
    let controls = LayerControls {
        layers: 5.0,
        size: 4.0,
        exposure_ms: 1.0,
        back_light: 20.0,
        ..LayerControls::default()
    };
    let mut stage = stage([320, 240]);
    let dark = both(&gpu, &mut card, &stage, (3.0, [0.0; 2]), &controls);
    lit(&mut stage);
    card.set_maps(&stage.maps).unwrap();
    for flash in [[0.0; 2], [0.7, 0.2]] {
        let [found, wanted] = both(&gpu, &mut card, &stage, (3.0, flash), &controls);
        let [light, cover] = differences(&found, &wanted);
        println!("lamps, lightning {flash:?}: light {light:.1e} relative L2, cover {cover:.1e}");
        assert!(light < LIGHT && cover < COVER, "{light} {cover}");
        assert!(differences(&found, &dark[1])[0] > 100.0 * LIGHT, "lamps are seen");
    }
    let maps = stage.maps.overhead.as_mut().unwrap();
    maps[1].cell_m = 0.5;
    let refusal = card.set_maps(&stage.maps).unwrap_err().to_string();
    assert!(refusal.starts_with("overhead: wanted three maps of the same cells"), "{refusal}");
}

#[test]
fn without_rain_a_layer_is_empty_and_frames_hold_no_more_of_the_card() {
    let Some(gpu) = test_gpu() else { return };
    let mut card = CardLayers::new(&gpu, &Layers::new(5));
    card.set_measured(true);
    let controls = LayerControls::default();
    let mut stage = stage([149, 83]);
    both(&gpu, &mut card, &stage, (1.0, [0.0; 2]), &controls);
    let held = gpu.bytes_held();
    both(&gpu, &mut card, &stage, (2.0, [0.0; 2]), &controls);
    assert_eq!(gpu.bytes_held(), held);
    let passes = card.report().unwrap().passes;
    let names: Vec<_> = passes.iter().map(|pass| pass.name).collect();
    assert!(names == ["light on drops", "layers of rain"] || !gpu.has_clock(), "{names:?}");
    stage.flux.clear();
    let [found, wanted] = both(&gpu, &mut card, &stage, (2.0, [0.0; 2]), &controls);
    assert_eq!(found, wanted);
    let [picture, metres] = textures(&gpu, &stage.buffer);
    let frame = CardFrame::new(&stage.camera, &stage.light, [&picture.view, &metres.view]);
    let wind = CardFrame { wind: DVec3::splat(f64::NAN), ..frame };
    assert!(card.draw(&wind, &controls).unwrap_err().to_string().starts_with("wind"));
    let refusal = card.draw(&frame, &LayerControls { layers: 40.0, ..controls }).unwrap_err().to_string();
    assert!(refusal.starts_with("layers"), "{refusal}");
}
