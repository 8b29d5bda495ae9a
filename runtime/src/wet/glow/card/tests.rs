use super::*;
use crate::assert_layout;
use crate::gpu::test_gpu;
use crate::wet::card::{differences, textures};
use crate::wet::frame::{GBuffer, WetFrame};
use crate::wet::glow::Glow;
use crate::wet::maps::WetMaps;
use glam::DVec3;
use squall_formats::units::Degrees;

/// Sums of single precision in another order, and the card's logarithm and exponential, relative to the root mean square.
const ROUND_OFF: f64 = 5e-6;
/// Share of the light behind that mist hides.
const HIDDEN: f32 = 4e-6;

#[test]
fn structs_lie_as_the_shader_has_them() {
    type Glow = GlowUniform;
    assert_layout!(
        GLOW,
        Glow {
            size,
            half,
            focal,
            middle,
            least,
            extinction,
            mist,
            sky,
            strength,
            is_paper,
            is_parallel,
            across,
            weights
        }
    );
    type Level = LevelUniform;
    assert_layout!(
        GLOW,
        Level { size, finer, coarser, begin, finer_begin, coarser_begin, number, is_coarsest, stride }
    );
}

#[test]
fn the_shaders_classes_are_the_processors() {
    let depths = DEPTHS.map(|depth| format!("{depth:?}")).join(", ");
    for line in [
        format!("array<f32, 6>({depths})"),
        format!("CLASSES: u32 = {}u", DEPTHS.len()),
        format!("LEVELS: u32 = {LEVELS}u"),
        format!("NODES_PX: u32 = {NODES_PX}u"),
    ] {
        assert!(GLOW.says(&line), "{line}");
    }
}

/// Lamps at all distances, in the sky and in holes, over an even dusk.
fn buffer(size: [usize; 2]) -> GBuffer {
    let count = size[0] * size[1];
    let mut buffer = GBuffer {
        size,
        colour: vec![[0.02, 0.03, 0.05]; count],
        depth_m: (0..count).map(|at| 0.3 * libm::powf(1.05, (at % size[0]) as f32)).collect(),
        normal: vec![[0.0, -1.0, 0.0]; count],
        ..GBuffer::default()
    };
    for at in (0..count).filter(|at| at * 7919 % 211 == 0) {
        buffer.colour[at] = [30.0 + (at % 97) as f32, 40.0, 5.0 + (at % 13) as f32 * 20.0];
        match at % 5 {
            0 => buffer.depth_m[at] = f32::INFINITY,
            1 => buffer.depth_m[at] = f32::NAN,
            _ => {}
        }
    }
    if let Some(pixel) = buffer.colour.get_mut(3) {
        *pixel = [f32::NAN, f32::INFINITY, 7.0];
    }
    buffer
}

/// A frame drawn by both.
fn both(gpu: &Gpu, glow: &mut CardGlow, camera: &Camera, rate: f64, controls: &GlowControls) -> [Layer; 2] {
    let size = [camera.width, camera.height];
    let buffer = buffer(size.map(|side| side as usize));
    let mut light = WorldLight::default();
    light.harmonics[0] = [0.1, 0.12, 0.16];
    light.harmonics[2] = [0.03, 0.02, 0.04];
    let frame = WetFrame {
        buffer: &buffer,
        colour: &buffer.colour,
        camera,
        maps: &WetMaps::default(),
        light: &light,
        rate_mm_per_h: rate,
        flux: &[],
        wind: DVec3::ZERO,
        time_s: 0.0,
        seed: 0,
        lightning: [0.0; 2],
    };
    let mut wanted = Layer::default();
    Glow::new().draw((&frame, &buffer.colour), controls, &mut wanted).unwrap();
    let [picture, metres] = textures(gpu, &buffer);
    let views = [&picture.view, &metres.view];
    let frame = CardFrame { rate_mm_per_h: rate, ..CardFrame::new(camera, &light, views) };
    glow.draw(&frame, controls).unwrap();
    [glow.read().unwrap(), wanted]
}

fn camera(size: [u32; 2]) -> Camera {
    Camera::look_at(DVec3::ZERO, DVec3::new(0.2, 1.0, 0.1), Degrees(50.0), size).unwrap()
}

#[test]
fn glow_and_mist_on_the_card_are_the_processors() {
    let Some(gpu) = test_gpu() else { return };
    let mut glow = CardGlow::new(&gpu);
    let plain = GlowControls::default();
    for (what, size, rate, controls) in [
        ("rain", [149, 83], 25.0, plain),
        ("heavy rain in mist", [149, 83], 120.0, GlowControls { mist: 8.0, strength: 3.0, ..plain }),
        ("no mist", [64, 200], 5.0, GlowControls { mist: 0.0, threshold: 20.0, ..plain }),
        ("a sky that is near", [33, 2], 25.0, GlowControls { sky: 40.0, ..plain }),
        ("Kawase", [149, 83], 25.0, GlowControls { paper: 1.0, ..plain }),
        ("Kawase, one pass more", [149, 83], 25.0, GlowControls { paper: 1.0, paper_passes: 6.0, ..plain }),
        ("more levels than there are", [1300, 40], 25.0, plain),
    ] {
        let [found, wanted] = both(&gpu, &mut glow, &camera(size), rate, &controls);
        let [light, _] = differences(&found, &wanted);
        let hidden = found.alpha.iter().zip(&wanted.alpha).map(|(found, wanted)| (found - wanted).abs());
        let hidden = hidden.fold(0.0f32, f32::max);
        println!("{what}: light {light:.1e} relative L2, hidden {hidden:.1e}");
        assert!(light < ROUND_OFF && hidden < HIDDEN, "{what}: {light} {hidden}");
    }
}

#[test]
fn without_rain_nothing_glows_whatever_glowed_before() {
    let Some(gpu) = test_gpu() else { return };
    let mut glow = CardGlow::new(&gpu);
    let controls = GlowControls::default();
    let [lit, _] = both(&gpu, &mut glow, &camera([40, 30]), 25.0, &controls);
    assert!(lit.light.iter().any(|light| light[0] > 0.0));
    for rate in [0.0, -1.0, f64::NAN] {
        let [found, wanted] = both(&gpu, &mut glow, &camera([40, 30]), rate, &controls);
        assert_eq!(found, wanted);
    }
}

#[test]
fn frames_hold_no_more_of_the_card_and_what_does_not_fit_is_refused_by_name() {
    let Some(gpu) = test_gpu() else { return };
    let mut glow = CardGlow::new(&gpu);
    glow.set_measured(true);
    let (camera, controls) = (camera([149, 83]), GlowControls::default());
    both(&gpu, &mut glow, &camera, 25.0, &controls);
    let held = gpu.bytes_held();
    both(&gpu, &mut glow, &camera, 30.0, &controls);
    assert_eq!(gpu.bytes_held(), held);
    let passes = glow.report().unwrap().passes;
    let names: Vec<_> = passes.iter().map(|pass| pass.name).collect();
    assert!(names == ["glow", "layer of glow"] || !gpu.has_clock(), "{names:?}");
    let ([picture, _], [_, narrow]) =
        (textures(&gpu, &buffer([149, 83])), textures(&gpu, &buffer([148, 83])));
    let light = WorldLight::default();
    let frame =
        CardFrame { rate_mm_per_h: 25.0, ..CardFrame::new(&camera, &light, [&picture.view, &narrow.view]) };
    let refusal = glow.draw(&frame, &controls).unwrap_err().to_string();
    assert!(refusal.starts_with("depth_m: wanted the camera's 149 × 83, found 148 × 83"), "{refusal}");
    let frame = CardFrame { depth_m: &picture.view, ..frame };
    let refusal = glow.draw(&frame, &GlowControls { sky: 0.0, ..controls }).unwrap_err().to_string();
    assert!(refusal.starts_with("sky"), "{refusal}");
}

#[test]
fn pictures_are_refused_from_the_first_whose_levels_do_not_fit() {
    for (size, fits) in [
        ([3840, 2160], true),
        ([4096, 4096], true),
        ([4096, 4098], false),
        // Halves are rounded up: as many pixels as those of even sides, and more bytes.
        ([5461, 3072], false),
        ([2049, 8188], false),
        ([1, 16_000_000], false),
    ] {
        let refusal = super::check_size(size).err().map(|error| error.to_string());
        assert_eq!(refusal.is_none(), fits, "{size:?}: {refusal:?}");
        assert!(refusal.is_none_or(|refusal| refusal.contains(&format!("{} × {}", size[0], size[1]))));
    }
}
