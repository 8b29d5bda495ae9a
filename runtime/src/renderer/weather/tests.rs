//! Whole pictures of the card against the processor's.

use crate::camera::Camera;
use crate::frame::{Flash, Frame};
use crate::gpu::test_gpu;
use crate::load::Asset;
use crate::picture::Picture;
use crate::rain::Ceiling;
use crate::renderer::{Backend, StormRenderer};
use crate::stroke::Stroke;
use crate::tone::Tone;
use glam::DVec3;
use squall_formats::container::{OutSection, write};
use squall_formats::section::town::TownSection;
use squall_formats::tag::Tag;
use squall_formats::units::{Degrees, Metres, MillimetresPerHour, Seconds};

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
/// sight, the same dry, and in a layer of rain that the sun comes through.
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
    let mut layer = day.clone();
    layer.weather.volume.ceiling = Some(Ceiling { height: Metres(700.0), softness: Metres(200.0) });
    vec![
        ("dusk with a flash", dusk),
        ("night", night),
        ("day", day),
        ("a dry day", dry),
        ("a day of rain from a low cloud", layer),
    ]
}

#[test]
fn a_dusk_with_a_flash_on_the_card_is_the_processors_as_a_display_shows_it() {
    let Some(gpu) = test_gpu() else { return };
    for asset in [without(&golden("v1/golden.squall"), TownSection::TAG)] {
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

#[test]
fn a_lost_device_is_replaced_once_and_the_second_loss_is_said() {
    let Some(gpu) = crate::gpu::own_test_gpu() else { return };
    let mut renderer = StormRenderer::new(golden("v4/rain.squall")).unwrap();
    let (_, frame) = frames(&renderer).swap_remove(2);
    renderer.set_backend(Backend::Gpu(gpu)).unwrap();
    let before = renderer.render(&frame).unwrap().clone();
    // A software driver's queue may not outlive its pipelines: those of the lost devices stay for as long as the tests.
    std::mem::forget(renderer.device().unwrap().clone());
    renderer.device().unwrap().device().destroy();
    let after = renderer.render(&frame).unwrap().clone();
    assert!(renderer.gpu_report().unwrap().recovered && renderer.device().unwrap().lost().is_none());
    let (rmse, _) = apart(&renderer.tone(), &before, &after);
    assert!(rmse < RMSE, "{rmse}");
    std::mem::forget(renderer.device().unwrap().clone());
    renderer.device().unwrap().device().destroy();
    let error = renderer.render(&frame).unwrap_err().to_string();
    assert!(error.contains("graphics device"), "{error}");
}

#[test]
fn a_picture_developed_onto_a_texture_of_the_callers_is_the_one_that_is_read_back() {
    use crate::gpu::readback::Readback;
    /// Levels of 255: half precision of what bloom spreads.
    const LEVELS: f64 = 0.5;
    let Some(gpu) = test_gpu() else { return };
    let mut renderer = StormRenderer::new(golden("v4/rain.squall")).unwrap();
    let (_, frame) = frames(&renderer).swap_remove(1);
    renderer.set_backend(Backend::Gpu(gpu.clone())).unwrap();
    let picture = renderer.render(&frame).unwrap().clone();
    let tone = Tone { exposure: Tone::exposure_for(&picture), ..renderer.tone() };
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let kind = (wgpu::TextureDimension::D2, format);
    let shown = gpu.texture("surface", [160, 90, 1], kind, wgpu::TextureUsages::RENDER_ATTACHMENT);
    renderer.develop_into(&frame, &tone, &shown.view, format).unwrap();
    let mut back = Readback::new(&gpu);
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    back.copy(&mut encoder, &shown);
    gpu.queue().submit([encoder.finish()]);
    let texels: Vec<[u8; 4]> = back.values().unwrap();
    let wanted = tone.to_srgb8(&picture);
    let off = texels
        .iter()
        .zip(&wanted)
        .flat_map(|(a, b)| (0..3).map(move |band| f64::from(a[band]) - f64::from(b[band])));
    let rmse = (off.map(|off| off * off).sum::<f64>() / (3 * wanted.len()) as f64).sqrt();
    println!("{rmse:.3} of 255");
    assert!(rmse < LEVELS, "{rmse}");
}
