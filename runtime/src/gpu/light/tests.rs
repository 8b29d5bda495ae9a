//! The volumes against the processor's light per cell.

use super::*;
use crate::assert_layout;
use crate::clouds::f16_value as half;
use crate::frame::Flash;
use crate::gpu::clock::Clock;
use crate::gpu::readback::Readback;
use crate::gpu::test_gpu;
use crate::load::Asset;
use crate::renderer::light::{Ambient, light_cells};
use crate::stroke::Stroke;
use glam::Vec4;

#[test]
fn lights_uniforms_lie_as_the_shader_has_them() {
    assert_layout!(PACK, Quiet { upper, has_beam, lower, pad0, travel, pad1 });
    assert_layout!(PACK, Strokes { steps, scales });
}

/// Half precision of the volumes beside rows' and direct light's round-off, as a share of the root mean square.
const HALF: f64 = 1e-3;
/// What the codec leaves below zero is cut off a stroke at a time here, and of all strokes of one colour in sum there.
const CUT: f64 = 1e-2;

/// The light of every cell as the volumes hold it.
fn cells(gpu: &Gpu, lights: &mut CloudLights) -> Vec<Vec3> {
    let (mut clock, mut back) = (Clock::new(gpu), Readback::new(gpu));
    let mut read = |image: &Image, recorder: Option<Recorder<'_>>| -> Vec<[u16; 4]> {
        let mut own = Clock::new(gpu);
        let mut recorder = recorder.unwrap_or_else(|| own.record(false));
        back.copy(&mut recorder.encoder, image);
        recorder.submit();
        back.values().unwrap()
    };
    let mut recorder = clock.record(true);
    lights.record(&mut recorder);
    let quiet = read(&lights.quiet_volume, Some(recorder));
    let strokes = read(&lights.stroke_volume, None);
    let tints = lights.tints;
    let one = |(quiet, strokes): (&[u16; 4], &[u16; 4])| {
        let mut sum = Vec3::new(half(quiet[0]), half(quiet[1]), half(quiet[2])) * tints.quiet;
        for (tint, channel) in tints.strokes.iter().zip(strokes) {
            sum += Vec4::from_array(*tint).truncate() * half(*channel);
        }
        sum
    };
    quiet.iter().zip(&strokes).map(one).collect()
}

/// A frame that looks at the cloud from where the asset allows.
pub fn frame_of(asset: &Asset, clouds: &Clouds) -> Frame {
    let own = crate::StormRenderer::new(asset.clone()).unwrap().frame();
    let cloud = clouds.cloud();
    let middle = 0.5 * (cloud.origin_m + cloud.far_corner());
    let eye = match clouds.relighter().view_region() {
        Some(region) => DVec3::from_array(region.centre()),
        None => middle - DVec3::new(1200.0, 900.0, 300.0),
    };
    let camera =
        crate::Camera::look_at(eye, middle, squall_formats::units::Degrees(60.0), [160, 90]).unwrap();
    own.unwrap_or_else(|| Frame::new(camera.clone())).camera(camera)
}

/// The asset's strokes, or two sparks where its light was baked.
pub fn flashes_of(asset: &Asset, clouds: &Clouds) -> Vec<Flash> {
    let strokes = crate::stroke::Strokes::of(asset).unwrap();
    let named: Vec<Flash> =
        strokes.records().iter().map(|record| Flash::named(record.name.as_str())).collect();
    if !named.is_empty() {
        return named;
    }
    let [low, high] = clouds.bounds();
    let spark = |share: f64| {
        let at = clouds.nearest_lit(low + (high - low) * share).unwrap();
        Flash::own(Stroke::from_points(&[at], 1e6, [0.8, 0.7, 1.2]).unwrap())
    };
    vec![spark(0.3), spark(0.6)]
}

#[test]
fn volumes_hold_the_processors_light_of_strokes_sky_and_sun() {
    let Some(gpu) = test_gpu() else { return };
    for name in ["v1/golden.squall", "v2/eyes.squall", "v3/sun.squall"] {
        let path = format!("{}/../data/golden/{name}", env!("CARGO_MANIFEST_DIR"));
        let asset = Asset::open(path).unwrap();
        let mut clouds = Clouds::new(&asset).unwrap();
        let place = Place::of(&asset).unwrap();
        let mut lights = CloudLights::new(&gpu, &clouds).unwrap();
        let grid = CloudUniform::new(clouds.relighter(), place.origin);
        let mut frame = frame_of(&asset, &clouds);
        let flashes = flashes_of(&asset, &clouds);
        // By day, at dusk, and with all strokes flashing, some more often than there are channels.
        for (elevation, times) in [(0.9, 1), (-0.06, 1), (-0.06, 0), (-0.06, 3)] {
            frame.sky.sun_elevation.0 = elevation;
            frame.flashes.clear();
            for i in 0..times {
                let tint = [1.0 + 0.2 * i as f32, 0.8, 0.5 + 0.1 * i as f32];
                let lit = if times == 1 { &flashes[..1] } else { &flashes[..] };
                frame.flashes.extend(lit.iter().map(|flash| {
                    let flash = flash.clone().brightness(0.3 + 0.7 * f64::from(i));
                    if times > 1 { flash.colored(tint) } else { flash }
                }));
            }
            let sky = Sky::new(&frame.sky).unwrap();
            let (mut wanted, mut flashes) = (Vec::new(), Vec::new());
            let wanted_report = light_cells(
                &mut clouds,
                &frame,
                (&sky, place),
                &mut Ambient::default(),
                (&mut wanted, &mut flashes),
            );
            let report = lights.set(&gpu, &mut clouds, &frame, (&sky, place), grid);
            let (Ok(wanted_report), Ok(report)) = (wanted_report, report) else { panic!("{name}") };
            assert_eq!((report.sun, report.sky_missing), (wanted_report.sun, wanted_report.sky_missing));
            let found = cells(&gpu, &mut lights);
            // Cells that a march reads.
            let mut known = clouds.relighter().known_cells();
            let distances = clouds.relighter().cloud_distances();
            known.iter_mut().zip(distances).for_each(|(known, &steps)| *known &= steps <= 1);
            let (mut off, mut all) = (0.0, 0.0);
            for cell in (0..found.len()).filter(|&cell| known[cell]) {
                off += f64::from((found[cell] - wanted[cell].truncate()).length_squared());
                all += f64::from(wanted[cell].truncate().length_squared());
            }
            let error = libm::sqrt(off / all);
            let most = if times > 1 { CUT } else { HALF };
            assert!(all > 0.0 && error < most, "{name} {elevation} {times}: {error}");
        }
    }
}
