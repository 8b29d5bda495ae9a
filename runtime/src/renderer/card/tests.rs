//! Pictures and maps of the card against the processor's.

use super::super::draw::{Clouds as Marched, cover};
use super::super::light::{Ambient, glow_of, light_cells};
use super::super::lit_stroke::{CLOUD_M, eye_height};
use super::super::world::{light_of, look_around, spacing_of, sun_of};
use super::*;
use crate::camera::Ray;
use crate::frame::FrameQuality;
use crate::gpu::around::Around;
use crate::gpu::light::tests::{flashes_of, frame_of};
use crate::gpu::test_gpu;
use crate::load::Asset;
use glam::Vec3;

/// The march's steps begin elsewhere where half precision and the filter's 256 steps say so: as a share of the picture's root mean
/// square, and of its brightest pixel.
const MARCH: f64 = 5e-3;
const MARCH_PIXEL: f32 = 1.6e-2;

fn open(name: &str) -> (Asset, StormRenderer) {
    let asset = Asset::open(format!("{}/../data/golden/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let renderer = StormRenderer::new(asset.clone()).unwrap();
    (asset, renderer)
}

/// Frames that differ in their light: by day with the sun in sight, at dusk with strokes and billows, at night.
fn frames(asset: &Asset, renderer: &mut StormRenderer) -> Vec<Frame> {
    let clouds = renderer.clouds().unwrap();
    let base = frame_of(asset, clouds);
    let flashes = flashes_of(asset, clouds);
    let way = base.camera.forward;
    let mut day = base.clone();
    day.sky.sun_azimuth.0 = libm::atan2(way.y, way.x) + 0.6;
    day.sky.sun_elevation.0 = libm::asin(way.z).max(0.1) + 0.12;
    let mut dusk = base.clone();
    dusk.detail = DetailParameters { amplitude: 0.8, size: 150.0, fibres_from: 700.0, seed: 4 };
    dusk.sky.sun_elevation.0 = -0.06;
    dusk.flashes = flashes.clone();
    let mut night = base;
    night.sky.sun_elevation.0 = -0.28;
    night.sky.overcast = 0.4;
    night.flashes = flashes[..1].to_vec();
    vec![day, dusk, night]
}

/// What the processor makes of a frame's sky and cloud.
struct Processor {
    frame: Frame,
    sky: Sky,
    detail: Detail,
    cells: Vec<glam::Vec4>,
    flash_cells: Vec<glam::Vec4>,
}

impl Processor {
    fn of(renderer: &mut StormRenderer, asked: &Frame) -> Self {
        let place = renderer.scene.place;
        let frame = place.frame(asked);
        let sky = Sky::new(&frame.sky).unwrap();
        let detail = Detail::new(&frame.detail).unwrap();
        let (mut cells, mut flash_cells) = (Vec::new(), Vec::new());
        let clouds = renderer.memory.clouds.as_mut().unwrap();
        let out = (&mut cells, &mut flash_cells);
        light_cells(clouds, asked, (&sky, place), &mut Ambient::default(), out).unwrap();
        Self { frame, sky, detail, cells, flash_cells }
    }

    fn with<T>(&self, scene: &Scene, look: impl FnOnce(&super::super::draw::Beyond<'_>) -> T) -> T {
        let clouds = Marched { scene, frame: &self.frame, detail: &self.detail };
        let cloud = clouds.marched(&self.cells).unwrap();
        let eye = self.frame.camera.position;
        look(&|ray: &Ray| {
            let mut light = self.sky.radiance(ray.direction.as_vec3());
            cover(&mut light, cloud.march(ray), &self.sky.air_between(eye_height(eye), CLOUD_M));
            light
        })
    }
}

/// Distance as a share of the wanted values' root mean square, and the largest as a share of the largest wanted one.
fn distance(found: &[[f32; 3]], wanted: &[[f32; 3]]) -> (f64, f32) {
    let (mut off, mut all, mut worst, mut peak) = (0.0, 0.0, 0.0f32, 0.0f32);
    assert_eq!(found.len(), wanted.len());
    for (found, wanted) in found.iter().flatten().zip(wanted.iter().flatten()) {
        off += crate::gpu::square(found - wanted);
        all += crate::gpu::square(*wanted);
        (worst, peak) = (worst.max((found - wanted).abs()), peak.max(*wanted));
    }
    (libm::sqrt(off / all), worst / peak)
}

/// Sky and cloud of the last frame, before anything stands in front of them.
fn beyond_of(card: &mut Card) -> Vec<[f32; 3]> {
    let mut recorder = card.clock.record(false);
    card.back.copy(&mut recorder.encoder, &card.targets.as_ref().unwrap().beyond);
    recorder.submit();
    let texels: Vec<[u16; 4]> = card.back.values().unwrap();
    let unit = card.seen.as_ref().unwrap().unit;
    texels.iter().map(|texel| std::array::from_fn(|band| f16_value(texel[band]) * unit)).collect()
}

#[test]
fn sky_and_cloud_on_the_card_are_the_processors() {
    let Some(gpu) = test_gpu() else { return };
    for name in ["v2/eyes.squall", "v3/sun.squall"] {
        let (asset, mut renderer) = open(name);
        for (number, frame) in frames(&asset, &mut renderer).iter().enumerate() {
            let processor = Processor::of(&mut renderer, frame);
            let camera = &processor.frame.camera;
            let pixels = (0..90).flat_map(|y| (0..160).map(move |x| (x, y)));
            let clouds =
                Marched { scene: &renderer.scene, frame: &processor.frame, detail: &processor.detail };
            let cloud = clouds.marched(&processor.cells).unwrap();
            let wanted: Vec<[f32; 3]> = processor.with(&renderer.scene, |beyond| {
                pixels
                    .map(|(x, y): (usize, usize)| {
                        let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5);
                        let (light, open) = (beyond(&ray), cloud.march(&ray).transmittance);
                        let disc = processor.sky.disc_in_pixel(camera, x, y);
                        std::array::from_fn(|band| light[band] + disc[band] * open)
                    })
                    .collect()
            });
            renderer.set_backend(Backend::Gpu(gpu.clone())).unwrap();
            renderer.render(frame).unwrap();
            let found = beyond_of(renderer.card.as_mut().unwrap());
            renderer.set_backend(Backend::Cpu).unwrap();
            // The sun's own pixels would be all that counts: they are looked at by themselves.
            let (mut sun, mut rest) = ((Vec::new(), Vec::new()), (Vec::new(), Vec::new()));
            for (i, pair) in found.iter().zip(&wanted).enumerate() {
                let is_sun = processor.sky.disc_in_pixel(camera, i % 160, i / 160) != [0.0; 3];
                let (found, wanted) = if is_sun { &mut sun } else { &mut rest };
                found.push(*pair.0);
                wanted.push(*pair.1);
            }
            assert_eq!(sun.0.is_empty(), number > 0, "the sun is in sight by day");
            for (found, wanted) in [sun, rest].iter().filter(|(found, _)| !found.is_empty()) {
                let (off, worst) = distance(found, wanted);
                println!("{name} {number}: {off} {worst}");
                assert!(off < MARCH && worst < MARCH_PIXEL, "{name} {number}: {off} {worst}");
            }
        }
    }
}

#[test]
fn what_is_around_the_eye_comes_to_what_the_processor_makes_of_it() {
    /// The cloud's light within the march's tolerance; sums of thousands of directions in half precision.
    const SUMS: f64 = 3e-3;
    let Some(gpu) = test_gpu() else { return };
    let (asset, mut renderer) = open("v2/eyes.squall");
    for frame in frames(&asset, &mut renderer) {
        let processor = Processor::of(&mut renderer, &frame);
        let eye = processor.frame.camera.position;
        let scene = &renderer.scene;
        let clouds = Marched { scene, frame: &processor.frame, detail: &processor.detail };
        let sun = sun_of(&processor.sky, clouds.marched(&processor.cells).as_ref(), eye);
        let world = processor.with(scene, |beyond| {
            light_of(&look_around(eye, spacing_of(FrameQuality::STILL.sky), beyond), sun)
        });
        let glow =
            clouds.marched(&processor.flash_cells).map(|cloud| glow_of(&cloud, eye)).unwrap_or_default();
        let mut card = Card::new(&gpu, scene, &renderer.memory).unwrap();
        let mut memory = std::mem::replace(&mut renderer.memory, Memory::empty().unwrap());
        // A dry scene's passes, asked for as rain would.
        card.draw(scene, &frame, &mut memory, &Onto::Memory).unwrap();
        card.around.set(&gpu, &processor.frame.camera);
        let mut recorder = card.clock.record(true);
        card.around.record(&mut recorder, (&card.frame, &card.volumes), true);
        card.back.copy_buffer(&mut recorder.encoder, &card.around.told);
        recorder.submit();
        let told: Around = card.back.values().unwrap()[0];
        let (off, _) = distance(&[told.mean], &[world.mean_radiance()]);
        assert!(off < SUMS, "{:?} {:?}", told.mean, world.mean_radiance());
        let wanted_sun = processor
            .sky
            .sun()
            .map_or(0.0, |all| sun.map_or(0.0, |sun| sun.irradiance[1] / all.irradiance[1]));
        assert!(processor.sky.sun().is_none() || (told.sun_open - wanted_sun).abs() < MARCH_PIXEL);
        match glow.first() {
            Some(glow) => {
                let (off, _) = distance(&[told.glow_radiance], &[glow.radiance]);
                let away = Vec3::from_array(told.glow_centre).distance(glow.centre)
                    / glow.centre.distance(eye.as_vec3());
                assert!(
                    off < 3.0 * SUMS && away < SUMS as f32,
                    "{told:?} {:?} {:?}",
                    glow.radiance,
                    glow.centre
                );
                assert!((told.glow_radius / glow.radius - 1.0).abs() < SUMS as f32);
            }
            None => assert_eq!(told.glow_radiance, [0.0; 3]),
        }
        let mut recorder = card.clock.record(false);
        card.back.copy_buffer(&mut recorder.encoder, &card.around.harmonics);
        recorder.submit();
        let three = |all: Vec<[f32; 4]>| all.into_iter().map(|[r, g, b, _]| [r, g, b]).collect::<Vec<_>>();
        let (off, _) = distance(&three(card.back.values().unwrap()), &three(world.all_coefficients()));
        assert!(off < SUMS, "harmonics: {off}");
        renderer.memory = memory;
    }
}

#[test]
fn a_frame_drawn_again_from_what_is_kept_is_the_same_and_a_flicker_only_scales() {
    let Some(gpu) = test_gpu() else { return };
    let (asset, mut renderer) = open("v2/eyes.squall");
    let frame = frames(&asset, &mut renderer).remove(1);
    renderer.set_backend(Backend::Gpu(gpu)).unwrap();
    let first = renderer.render(&frame).unwrap().pixels.clone();
    let bytes = renderer.gpu_report().unwrap().bytes_held;
    assert_eq!(renderer.render(&frame).unwrap().pixels, first);
    assert_eq!(renderer.report().strokes_kept, frame.flashes.len());
    // Half as bright, and dark: the cloud's own light is the difference, which a brightness scales.
    let mut with = |factor: f64| {
        let mut other = frame.clone();
        other.flashes.iter_mut().for_each(|flash| flash.brightness = factor);
        let light: Vec<[f32; 3]> = renderer.render(&other).unwrap().pixels.clone();
        light
    };
    let (dark, half, whole) = (with(1e-9), with(0.5), with(1.0));
    let mixed: Vec<[f32; 3]> = dark
        .iter()
        .zip(&whole)
        .map(|(dark, whole)| std::array::from_fn(|band| 0.5 * (dark[band] + whole[band])))
        .collect();
    let (off, worst) = distance(&half, &mixed);
    /// Half precision of three pictures.
    const HALF: f64 = 2e-3;
    assert!(off < HALF && f64::from(worst) < HALF, "{off} {worst}");
    assert_eq!(renderer.gpu_report().unwrap().bytes_held, bytes, "a frame allocates nothing");
}
