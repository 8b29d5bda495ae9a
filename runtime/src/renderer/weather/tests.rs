//! Whole pictures of the card against the processor's.

use crate::camera::Camera;
use crate::frame::{Flash, Frame};
use crate::gpu::test_gpu;
use crate::load::Asset;
use crate::picture::Picture;
use crate::renderer::{Backend, StormRenderer};
use crate::stroke::Stroke;
use crate::tone::Tone;
use glam::DVec3;
use squall_formats::container::{OutSection, write};
use squall_formats::section::town::TownSection;
use squall_formats::tag::Tag;
use squall_formats::units::{Degrees, MillimetresPerHour, Seconds};

/// Of the display's 255 levels: root mean square, and share of bands that are at most two levels off.
const RMSE: f64 = 0.5;
const WITHIN_TWO: f64 = 0.999;

fn golden(name: &str) -> Asset {
    Asset::open(format!("{}/../data/golden/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// An asset without one of its sections.
fn without(asset: &Asset, tag: Tag) -> Asset {
    let sections: Vec<OutSection> = asset
        .directory()
        .entries
        .iter()
        .filter(|entry| entry.tag != tag)
        .map(|entry| OutSection {
            tag: entry.tag,
            version: entry.version,
            required: entry.required,
            head_length: entry.head_length,
            parts: vec![asset.bytes()[entry.offset as usize..][..entry.length as usize].to_vec()],
        })
        .collect();
    let mut bytes = Vec::new();
    write(&mut bytes, &sections).unwrap();
    Asset::from_bytes(&bytes).unwrap()
}

/// How far two pictures are apart as a display shows them, and the share of bands within two levels.
pub fn apart(tone: &Tone, a: &Picture, b: &Picture) -> (f64, f64) {
    let (a, b) = (tone.to_srgb8(a), tone.to_srgb8(b));
    let off = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| f64::from(*a) - f64::from(*b));
    let (mut squares, mut near) = (0.0, 0);
    off.for_each(|off| {
        squares += off * off;
        near += usize::from(off.abs() <= 2.0);
    });
    let count = (3 * a.len()) as f64;
    ((squares / count).sqrt(), near as f64 / count)
}

/// Frames of an asset without a town: dusk with a flash in rain, night with a near stroke in rain, day in rain with the sun in
/// sight, the same dry.
fn frames(renderer: &StormRenderer) -> Vec<(&'static str, Frame)> {
    let size = [160, 90];
    let view = renderer.frame();
    let camera = match &view {
        Some(frame) => frame.camera.clone().resized(size).unwrap(),
        None => {
            Camera::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::new(0.0, 900.0, 160.0), Degrees(60.0), size)
                .unwrap()
        }
    };
    let base = renderer.frame_from(camera.clone()).time(Seconds(2.5)).wind(DVec3::new(4.0, 1.0, 0.0));
    let mut base = base.rain(MillimetresPerHour(20.0));
    base.streaks.length_px = [8.0, 120.0];
    let mut dusk = base.clone();
    dusk.sky.sun_elevation.0 = -0.05;
    if let Some(frame) = &view {
        dusk.flashes = frame.flashes.clone();
    }
    let mut night = base.clone();
    night.sky.sun_elevation.0 = -0.28;
    let foot = camera.position + camera.forward * 700.0 + camera.right * 60.0;
    let ends = [
        DVec3::new(foot.x, foot.y, camera.position.z + 500.0),
        DVec3::new(foot.x + 40.0, foot.y, camera.position.z),
    ];
    if renderer.scene.cloud.is_none() {
        night.flashes = vec![Flash::own(Stroke::between(ends[0], ends[1], 5, 3e5).unwrap())];
    }
    let mut day = base;
    day.sky.sun_azimuth.0 = libm::atan2(camera.forward.y, camera.forward.x) + 0.2;
    day.sky.sun_elevation.0 = libm::asin(camera.forward.z).max(0.05) + 0.15;
    let dry = day.clone().rain(MillimetresPerHour(0.0));
    vec![("dusk with a flash", dusk), ("night", night), ("day", day), ("a dry day", dry)]
}

#[test]
fn whole_pictures_of_the_card_are_the_processors_as_a_display_shows_them() {
    let Some(gpu) = test_gpu() else { return };
    for asset in [
        without(&golden("v1/golden.squall"), TownSection::TAG),
        golden("v3/sun.squall"),
        golden("v4/rain.squall"),
    ] {
        let mut renderer = StormRenderer::new(asset).unwrap();
        for (name, frame) in frames(&renderer) {
            renderer.set_backend(Backend::Cpu).unwrap();
            let wanted = renderer.render(&frame).unwrap().clone();
            let streaks = renderer.report().streaks;
            renderer.set_backend(Backend::Gpu(gpu.clone())).unwrap();
            renderer.measure(true);
            let found = renderer.render(&frame).unwrap().clone();
            let tone = Tone { exposure: Tone::exposure_for(&wanted), ..renderer.tone() };
            let (rmse, near) = apart(&tone, &found, &wanted);
            println!("{name}: {rmse:.3} of 255, {near:.5} within 2, {streaks} streaks");
            let off = renderer.report().streaks.abs_diff(streaks);
            assert!(off <= 1 + streaks / 10_000, "{name}: {} for {streaks}", renderer.report().streaks);
            assert!(rmse <= RMSE && near >= WITHIN_TWO, "{name}: {rmse} {near}");
        }
    }
}
