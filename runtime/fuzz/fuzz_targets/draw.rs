//! Drawing, entered directly: a small storm with any camera, sky, rain, flashes and town in range.

#![no_main]

use arbitrary::{Result, Unstructured};
use libfuzzer_sys::fuzz_target;
use squall_formats::Limits;
use squall_formats::container::{Directory, OutSection};
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::density::DensitySection;
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::{Block, Ground, HeightMap, Road, StreetLamp, TownSection, Windows};
use squall_formats::section::view::{ViewFlash, ViewSection};
use squall_runtime::frame::FrameQuality;
use squall_runtime::{Asset, Frame, RuntimeError, StormRenderer};
use squall_runtime_fuzz::{asset, cloud, cloud_section, number, numbers, response, stroke};

/// Draws `view` and gives the picture's pixels: the one place that knows how frames are asked for.
fn draw_frame(asset: &Asset, view: &ViewSection) -> std::result::Result<Vec<[f32; 3]>, RuntimeError> {
    let mut renderer = StormRenderer::new(asset)?;
    let quality = FrameQuality {
        town: squall_runtime::shade::town::frame::Quality { samples: 1, facets: 1, ..Default::default() },
        rays: squall_runtime::single_scatter::DirectRays::PerPoint(8),
        ..FrameQuality::STILL
    };
    Ok(renderer.render(&Frame::from(view).quality(quality))?.pixels.clone())
}

/// Sections of the golden asset that are tables: how dense rain is, what streaks look like.
fn rain() -> Vec<OutSection> {
    const GOLDEN: &[u8] = include_bytes!("../../../data/golden/v1/golden.squall");
    let directory = Directory::read(GOLDEN, &Limits::default()).expect("the golden asset is whole");
    let wanted =
        directory.entries.iter().filter(|e| [DensitySection::TAG, StreakSection::TAG].contains(&e.tag));
    wanted
        .map(|e| OutSection::small(e.tag, e.version, e.required, e.bytes(GOLDEN).expect("whole").to_vec()))
        .collect()
}

fn view(u: &mut Unstructured<'_>, strokes: &BoltSection) -> Result<ViewSection> {
    let mut view = ViewSection::default();
    view.camera.position_m = numbers(u, -3000.0, 3000.0)?;
    view.camera.position_m[2] = number(u, 0.0, 3000.0)?;
    view.camera.heading_rad = number(u, -100.0, 100.0)?;
    view.camera.pitch_rad = number(u, -std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2)?;
    view.camera.vertical_fov_rad = number(u, 1e-3, 3.13)?;
    view.camera.size_px = [u.int_in_range(1..=16)?, u.int_in_range(1..=9)?];
    view.camera.exposure_s = number(u, 1e-6, 0.1)?;
    if u.arbitrary()? {
        view.rain.rate_mm_per_h = number(u, 0.0, 50.0)?;
        view.rain.wind_m_per_s = numbers(u, -20.0, 20.0)?;
        view.rain.time_s = number(u, -1e6, 1e6)?;
        view.rain.seed = u.arbitrary()?;
        view.rain.streak_px = [number(u, 3.0, 10.0)?, number(u, 11.0, 300.0)?];
        view.rain.gain = number(u, 0.0, 10.0)?;
        if u.arbitrary()? {
            view.rain.ceiling_m = Some([number(u, -100.0, 3000.0)?, number(u, 0.0, 1000.0)?]);
        }
        if u.arbitrary()? {
            let [x, y, radius] = numbers(u, -3000.0, 3000.0)?;
            view.rain.region_m = Some([x, y, radius.abs(), number(u, 0.0, 1000.0)?]);
        }
    }
    view.sky.sun_azimuth_rad = number(u, -100.0, 100.0)?;
    view.sky.sun_elevation_rad = number(u, -0.2967, std::f64::consts::FRAC_PI_2)?;
    view.sky.haze = number(u, 0.0, 50.0)?;
    view.sky.overcast = number(u, 0.0, 1.0)?;
    view.sky.high_cloud = number(u, 0.0, 1.0)?;
    view.sky.ground_albedo = number(u, 0.0, 1.0)?;
    view.detail.amplitude = if u.ratio(1, 4)? { number(u, 0.0, 1.0)? } else { 0.0 };
    view.detail.size_m = number(u, 1.0, 1000.0)?;
    for record in &strokes.strokes {
        if u.arbitrary()? {
            view.flashes.push(ViewFlash { stroke: record.name.clone(), brightness: number(u, 0.0, 10.0)? });
        }
    }
    Ok(view)
}

fn town(u: &mut Unstructured<'_>) -> Result<TownSection> {
    let single = |u: &mut Unstructured<'_>, low: f64, high: f64| number(u, low, high).map(|v| v as f32);
    let mut town = TownSection { ground: Ground::default(), ..TownSection::default() };
    town.ground.wetness = single(u, 0.0, 1.0)?;
    town.ground.puddles = single(u, 0.0, 1.0)?;
    town.ground.ripple = single(u, 0.0, 1.0)?;
    for _ in 0..u.int_in_range(0..=2)? {
        town.ground.roads.push(Road {
            from: [single(u, -1e3, 1e3)?, single(u, -1e3, 1e3)?],
            to: [single(u, -1e3, 1e3)?, single(u, -1e3, 1e3)?],
            half_width: single(u, 0.001, 20.0)?,
            albedo: [0.05; 3],
        });
    }
    for _ in 0..u.int_in_range(0..=3)? {
        let windows =
            Windows { pitch: [3.0, 3.5], glass: 0.4, lit: 0.3, radiance: [0.3; 3], seed: u.arbitrary()? };
        town.blocks.push(Block {
            centre: [single(u, -1e3, 1e3)?, single(u, -1e3, 1e3)?],
            half: [single(u, 0.001, 100.0)?, single(u, 0.001, 100.0)?],
            foot: single(u, 0.0, 50.0)?,
            height: single(u, 0.0, 200.0)?,
            yaw: single(u, -7.0, 7.0)?,
            albedo: [0.3; 3],
            windows: if u.arbitrary()? { Some(windows) } else { None },
        });
    }
    for _ in 0..u.int_in_range(0..=2)? {
        let position = [single(u, -1e3, 1e3)?, single(u, -1e3, 1e3)?, single(u, 0.0, 20.0)?];
        town.lamps.push(StreetLamp { position, intensity: [single(u, 0.0, 1e3)?; 3] });
    }
    if u.arbitrary()? {
        let heights = (0..6).map(|_| u.arbitrary()).collect::<Result<_>>()?;
        let (origin, cell) = ([-2e3, 1e3], [single(u, 1.0, 1e3)?, single(u, 1.0, 1e3)?]);
        town.hills = Some(HeightMap { origin, cell, counts: [3, 2], step: single(u, 0.0, 0.15)?, heights });
    }
    Ok(town)
}

fn draw(u: &mut Unstructured<'_>) -> Result<()> {
    let (head, extinction) = cloud(u)?;
    let mut sections = vec![cloud_section(&head, &extinction), response(u, &head)?];
    let strokes = BoltSection { strokes: vec![stroke(u, "one", &head)?, stroke(u, "two", &head)?] };
    if strokes.strokes.iter().any(|record| record.check().is_err()) {
        return Ok(());
    }
    sections.push(strokes.write());
    sections.extend(rain());
    if u.arbitrary()? {
        sections.push(town(u)?.write());
    }
    let view = view(u, &strokes)?;
    sections.push(view.write());
    let asset = asset(&sections);
    if let Ok(pixels) = draw_frame(&asset, &view) {
        let sound = |value: &f32| value.is_finite() && *value >= 0.0;
        assert!(pixels.iter().flatten().all(sound), "a pixel that is no light: {pixels:?}");
    }
    Ok(())
}

fuzz_target!(|data: &[u8]| {
    let _ = draw(&mut Unstructured::new(data));
});
