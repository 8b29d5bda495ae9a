//! Whole pictures with a town, the card's against the processor's.

use crate::camera::Camera;
use crate::frame::Frame;
use crate::gpu::test_gpu;
use crate::picture::Picture;
use crate::renderer::{Backend, StormRenderer};
use crate::tone::Tone;
use glam::DVec3;
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};

/// Of the display's 255 levels: root mean square, and share of bands that are at most two levels off.
const RMSE: f64 = 0.5;
const WITHIN_TWO: f64 = 0.999;

/// Frames of an asset with a town: dusk with a flash in rain, night under its lamp in rain and dry, a dry day with the sun low before
/// the eye, night with the flash.
fn frames(renderer: &StormRenderer) -> Vec<(&'static str, Frame)> {
    let camera = renderer.frame().unwrap().camera.resized([160, 90]).unwrap();
    let base = renderer.frame_from(camera.clone()).time(Seconds(2.5)).wind(DVec3::new(4.0, 1.0, 0.0));
    let flash = renderer.frame().unwrap().flashes[0].clone();
    let mut dusk = base.clone().rain(MillimetresPerHour(20.0));
    dusk.sky.sun_elevation.0 = -0.05;
    dusk.flashes = vec![flash.clone()];
    let mut night = base.clone().rain(MillimetresPerHour(20.0)).dark();
    night.sky.sun_elevation.0 = -0.28;
    let mut day = base.rain(MillimetresPerHour(0.0)).dark();
    day.sky.sun_azimuth.0 = libm::atan2(camera.forward.y, camera.forward.x) + 0.2;
    day.sky.sun_elevation.0 = 0.2;
    let lit = Frame { flashes: vec![flash.brightness(0.4)], ..night.clone() };
    // In sight of the lamp, whose light is a thousand times what half precision loses of the sky's.
    let (eye, target) = (DVec3::new(7.0, 12.0, 2.0), DVec3::new(14.0, 90.0, 5.0));
    let near = Camera::look_at(eye, target, Degrees(60.0), [160, 90]).unwrap();
    let night = night.camera(near);
    let clear = night.clone().rain(MillimetresPerHour(0.0));
    vec![
        ("dusk with a flash", dusk),
        ("night under a lamp", night),
        ("a dry night", clear),
        ("a dry day", day),
        ("night with a flash", lit),
    ]
}

/// How far two pictures are apart as a display shows them, and the share of bands within two levels.
fn apart(tone: &Tone, a: &Picture, b: &Picture) -> (f64, f64) {
    let (a, b) = (tone.to_srgb8(a), tone.to_srgb8(b));
    let off = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| f64::from(a.abs_diff(*b)));
    let count = (3 * a.len()) as f64;
    let near = off.clone().filter(|off| *off <= 2.0).count() as f64;
    ((off.map(|off| off * off).sum::<f64>() / count).sqrt(), near / count)
}

#[test]
fn whole_pictures_with_a_town_are_the_processors_as_a_display_shows_them() {
    let Some(gpu) = test_gpu() else { return };
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");
    let mut renderer = StormRenderer::open(path).unwrap();
    let frames = frames(&renderer);
    let wanted: Vec<Picture> =
        frames.iter().map(|(_, frame)| renderer.render(frame).unwrap().clone()).collect();
    renderer.set_backend(Backend::Gpu(gpu)).unwrap();
    renderer.measure(true);
    for ((name, frame), wanted) in frames.iter().zip(&wanted) {
        let found = renderer.render(frame).unwrap().clone();
        let tone = Tone { exposure: Tone::exposure_for(wanted), ..renderer.tone() };
        let (rmse, near) = apart(&tone, &found, wanted);
        println!("{name}: {rmse:.3} of 255, {near:.5} within 2");
        assert!(rmse <= RMSE && near >= WITHIN_TWO, "{name}: {rmse} {near}");
        let drawn = |renderer: &StormRenderer| {
            renderer.gpu_report().unwrap().passes.iter().any(|pass| pass.name.starts_with("town"))
        };
        assert!(drawn(&renderer) || renderer.gpu_report().unwrap().passes.is_empty(), "{name}");
        // Nothing moves: what is kept is shown again.
        let again = renderer.render(frame).unwrap().clone();
        assert!(!drawn(&renderer) && apart(&tone, &again, &found).0 < RMSE, "{name}");
    }
}
