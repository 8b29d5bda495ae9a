//! Sky, town, wet ground, clouds from seeds, picture files: rooms against each other.

use glam::{DVec3, Vec3};
use squall_bake::input::town::{read_town, town_json};
use squall_bake::picture::{write_exr, write_png8};
use squall_bake::synth::cloud::{CloudKind, synth_cloud};
use squall_bake::synth::town::synth_town;
use squall_formats::section::town::TownSection;
use squall_formats::units::Radians;
use squall_formats::{GridShape, container};
use squall_runtime::Asset;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::picture::Picture;
use squall_runtime::random::Random;
use squall_runtime::shade::detail::{Detail, DetailParameters, ceilings};
use squall_runtime::shade::sky::{Sky, SkyParameters};
use squall_runtime::shade::town::Town;
use squall_runtime::shade::town::frame::{Quality, TownFrame};
use squall_runtime::shade::town::light::Lighting;
use squall_runtime::shade::town::rain::NoRain;
use squall_runtime::tone::Tone;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../data").join(name)
}

/// The dusk over a town at 64 × 36, sky included.
fn dusk(town: &Town) -> Picture {
    let sky = Sky::new(&SkyParameters::default()).unwrap();
    let projection = Projection::Perspective { vertical_fov: Radians(1.0) };
    let eye = DVec3::new(0.0, 0.0, 2.0);
    let camera = Camera::new(eye, DVec3::new(0.1, 1.0, 0.2), DVec3::Z, projection, [64, 36]).unwrap();
    let lighting = Lighting {
        ambient: &|normal| sky.ambient_irradiance(normal),
        points: &[],
        images: squall_runtime::shade::town::line::Images::NONE,
        strokes: &[],
        glows: &[],
        leaves: &|_, direction| sky.radiance(direction),
        sun: sky.sun(),
        rain: &NoRain,
    };
    let mut frame = TownFrame::default();
    town.render(&camera, &lighting, Quality { samples: 2, facets: 2, ..Quality::default() }, &mut frame);
    let mut picture = Picture::new(frame.width, frame.height).unwrap();
    for (i, (pixel, seen)) in picture.pixels.iter_mut().zip(&frame.pixels).enumerate() {
        let ray = camera.ray((i % 64) as f64 + 0.5, (i / 64) as f64 + 0.5);
        let behind = sky.radiance(ray.direction.as_vec3());
        *pixel = std::array::from_fn(|band| seen.radiance[band] + (1.0 - seen.cover) * behind[band]);
    }
    picture
}

fn asset_of(town: &TownSection) -> Vec<u8> {
    let mut bytes = Vec::new();
    container::write(&mut bytes, &[town.write()]).unwrap();
    bytes
}

fn town_of(asset: &Asset) -> Result<TownSection, squall_runtime::RuntimeError> {
    asset.section(TownSection::TAG, "the ground and what stands on it", TownSection::read)
}

#[test]
fn a_town_looks_the_same_from_the_asset_as_from_memory_on_any_number_of_threads() {
    let town = synth_town(2);
    let asset = Asset::from_bytes(&asset_of(&town)).unwrap();
    let read = town_of(&asset).unwrap();
    let on = |threads: usize, town: &TownSection| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| dusk(&Town::new(town)))
    };
    let picture = on(1, &town);
    assert_eq!(picture, on(8, &read));
    assert!(picture.pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    let brightest = picture.pixels.iter().map(|p| p[0]).fold(0.0, f32::max);
    let darkest = picture.pixels.iter().map(|p| p[0]).fold(f32::MAX, f32::min);
    assert!(brightest > 10.0 * darkest, "lamps against wet ground: {brightest} {darkest}");
}

#[test]
fn a_town_section_damaged_anywhere_is_refused_or_still_valid() {
    let mut town = synth_town(2);
    town.blocks.truncate(6);
    town.hills = None;
    let section = town.write().to_bytes();
    let mut random = Random::new(3);
    for _ in 0..500 {
        let mut bytes = section.clone();
        for _ in 0..1 + random.below(3) {
            let at = random.below(bytes.len() as u64) as usize;
            bytes[at] = random.bits() as u8;
        }
        // The checksum would catch this; the section must not rely on it.
        if let Ok(read) = TownSection::read(&bytes, 1, &Default::default()) {
            let down = Vec3::new(0.01, 0.01, -1.0).normalize();
            let hit = Town::new(&read).trace(Vec3::new(3.0, 5.0, 50.0), down, 1e6);
            assert!(hit.is_some_and(|hit| hit.distance.is_finite()));
        }
    }
    let mut bytes = asset_of(&town);
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    assert!(Asset::from_bytes(&bytes).is_err(), "the container's checksum");
}

#[test]
fn detail_keeps_the_water_of_a_whole_storm() {
    /// Interpolation is the same on both sides; what is left is sampling of 60 000 edge points.
    const SAMPLING: f64 = 0.02;
    let cloud = synth_cloud(CloudKind::Storm, 1, Some(GridShape::new(64, 48, 32))).unwrap();
    let (shape, inside) = (cloud.shape, ceilings(cloud.shape, &cloud.density));
    let full = DetailParameters { amplitude: 1.0, fibres_from: 7_000.0, ..DetailParameters::default() };
    let detail = Detail::new(&full).unwrap();
    let mut random = Random::new(9);
    let (mut coarse_sum, mut fine_sum) = (0.0, 0.0);
    for _ in 0..400_000 {
        let at = [0; 3].map(|_| random.unit());
        let cell: [usize; 3] = std::array::from_fn(|a| (at[a] * shape.to_array()[a] as f64) as usize);
        let index = shape.index(cell[0], cell[1], cell[2]);
        let point: [f32; 3] = std::array::from_fn(|a| {
            (cloud.origin[a] + at[a] * cloud.cell[a] * shape.to_array()[a] as f64) as f32
        });
        let coarse = cloud.density[index];
        coarse_sum += f64::from(coarse);
        fine_sum += f64::from(detail.modulate(Vec3::from_array(point), coarse, inside[index]));
    }
    assert!((fine_sum / coarse_sum - 1.0).abs() < SAMPLING, "{fine_sum} against {coarse_sum}");
}

#[test]
fn the_committed_inputs_are_what_their_commands_make() {
    let bytes = |density: &[f32]| density.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let storm = synth_cloud(CloudKind::Storm, 1, Some(GridShape::new(96, 64, 48))).unwrap();
    assert!(std::fs::read(data("storm/cloud.f32")).unwrap() == bytes(&storm.density), "storm/cloud.f32");
    let layer = synth_cloud(CloudKind::Layer, 1, None).unwrap();
    assert!(std::fs::read(data("input/layer32.f32")).unwrap() == bytes(&layer.density), "input/layer32.f32");
    let text = std::fs::read_to_string(data("storm/town.json")).unwrap();
    assert!(text == town_json(&synth_town(11), "squall synth town --seed 11"), "storm/town.json");
    read_town(&data("storm/town.json")).unwrap();
}

#[test]
fn the_sun_reaches_the_anvil_of_the_samples_storm_and_not_its_base() {
    let sky = Sky::new(&SkyParameters {
        sun_elevation: Radians((-3.2f64).to_radians()),
        ..SkyParameters::default()
    })
    .unwrap();
    let over = DVec3::new(0.0, 13_000.0, 0.0);
    assert_eq!(sky.cloud_light(1_600.0, over).sun_irradiance, [0.0; 3]);
    let anvil = sky.cloud_light(9_700.0, over);
    assert!(anvil.sun_irradiance[0] > 3.0 * anvil.sun_irradiance[2], "red: {anvil:?}");
    assert!(anvil.sun_irradiance[0] > anvil.upper[0], "brighter than the sky above it: {anvil:?}");
}

#[test]
fn an_exr_is_read_by_the_reference_tools() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.exr");
    let picture = dusk(&Town::new(&synth_town(2)));
    write_exr(&path, &picture).unwrap();
    write_png8(&folder.path().join("picture.png"), &picture, &Tone::default()).unwrap();
    match std::process::Command::new("exrinfo").arg(&path).output() {
        Err(_) => crate::skip("SQUALL_REQUIRE_OPENEXR", "no exrinfo (Debian package openexr)"),
        Ok(output) => {
            let text = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
            for part in ["dataWindow: [ 0, 0 - 63 35 ]", "3 channels", "'R': float"] {
                assert!(text.contains(part), "{part}: {text}");
            }
        }
    }
}
