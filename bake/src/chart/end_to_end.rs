//! Chart `end-to-end`: how far the picture of a flash is off a path-traced one, against processor time a flash: relit from baked rows,
//! or solved on the spot.

use super::clock::seconds;
use super::scene::{ChartScene, chart_scene};
use super::{Cost, Point, Sweep};
use crate::candidate::{asset_of, touched};
use crate::cloud::automatic_samples;
use crate::error::BakeError;
use crate::monte_carlo::{ChanceSettings, solve_by_chance};
use crate::progress::{Progress, Quiet};
use crate::relit::relight;
use crate::response::{LightGrid, ResponseSettings, Sources, bake_response};
use crate::storm::clouds::place_lights;
use glam::DVec3;
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis};
use squall_formats::units::{Degrees, Radians};
use squall_runtime::Clouds;
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::frame::camera_of;
use squall_runtime::live::LiveSolver;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions};
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::direct::Light;

const RMSE: &str = "picture, relative RMSE";
const TIME: &str = "a flash, CPU ms";
const RELIGHT: &str = "of it relighting or solving scattered light, CPU ms";
const BYTES: &str = "response, bytes";

pub const PAIRS: &[(&str, &str)] = &[(RMSE, RELIGHT), (RMSE, TIME), (RMSE, BYTES)];

/// Points of light that stand for a stroke, in the truth and in what is judged.
const LAMPS: usize = 4;
const SEED: u64 = 2;
const REPEATS: usize = 3;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 10 } else { 1 << 13 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let (clouds, cloud) = (scene.clouds, &scene.cloud);
    let lights = stroke_of(task, &scene);
    let camera = camera(task, &scene)?;
    let (truth, noise) = path_trace(task, &scene, &lights, &camera, progress)?;
    let words = format!(
        "{}, {} × {} px: path traced (its noise {:.1} %)",
        scene.words,
        camera.width,
        camera.height,
        100.0 * noise
    );
    let side = (cloud.far_corner() - cloud.origin_m).max_element();
    let own = scene.spacing_m;
    let steps: &[f64] = if task.quick { &[1.0] } else { &[2.0, 1.41, 1.0, 0.71, 0.5, 0.35, 0.25] };
    let usual = scene.settings.codec;
    let mut kinds = vec![
        (
            "baked for any eye, 16 channels",
            DirectTerm::AtRunTime,
            DirectionalBasis::Harmonics { degree: 3 },
            usual,
        ),
        (
            "baked for any eye, 4 channels",
            DirectTerm::AtRunTime,
            DirectionalBasis::Harmonics { degree: 1 },
            usual,
        ),
        (
            "paper: direct light baked, 26 directions",
            DirectTerm::InRows,
            DirectionalBasis::Directions26,
            Codec::Paper,
        ),
    ];
    let mine = (scene.settings.direct, scene.settings.channels, usual);
    if !kinds.iter().any(|&(_, direct, channels, codec)| (direct, channels, codec) == mine) {
        kinds.push(("baked, the recipe's channels", mine.0, mine.1, mine.2));
    }
    let refinements: &[u32] = if task.quick { &[1] } else { &[1, 2, 3] };
    let tolerances: &[f64] = if task.quick { &[1e-2] } else { &[0.3, 0.1, 3e-2, 1e-2, 1e-3] };
    progress
        .begin("chart end-to-end", (kinds.len() * steps.len() + refinements.len() * tolerances.len()) as u64);
    let mut points = Vec::new();
    for (series, direct, channels, codec) in kinds {
        for &step in steps {
            progress.check()?;
            progress.advance(1);
            let spacing_m = own * step;
            let grid = place_lights(task.recipe, clouds, cloud, spacing_m)?;
            let wanted = touched(&grid, std::slice::from_ref(&lights));
            let all = grid.wanted_count();
            let mut settings = ResponseSettings { direct, channels, codec, ..scene.settings };
            if (direct, channels, codec) != mine {
                // Those are baked for eyes anywhere: what a box of eyes saves is the recipe's own.
                settings.view_region = None;
            }
            let grid = LightGrid { wanted, ..grid };
            let tried = grid.wanted_count();
            let mut point = flash(&scene, grid, &settings, &lights, &camera, &truth)?;
            point.bytes = point.bytes.map(|bytes| bytes * all as u64 / tried.max(1) as u64);
            if let Some(bytes) = point.bytes {
                point.costs.push((BYTES, Cost::exact(bytes as f64)));
            }
            point.series = series.into();
            point.setting = format!("{series}, lamps {spacing_m:.0} m apart");
            point.truth = words.clone();
            point.chosen = step == 1.0 && (direct, channels, codec) == mine;
            point.baseline = direct == DirectTerm::InRows && codec == Codec::Paper;
            points.push(point);
        }
    }
    for &refine in refinements {
        for &tolerance in tolerances {
            progress.check()?;
            progress.advance(1);
            let mut settings = ResponseSettings {
                direct: DirectTerm::AtRunTime,
                channels: DirectionalBasis::Harmonics { degree: 0 },
                refine,
                ..scene.settings
            };
            settings.solve.tolerance = tolerance;
            // One lamp far from the stroke: nothing of it is baked, so all of it is solved for.
            let far = cloud.far_corner() + DVec3::splat(10.0 * side);
            let grid = LightGrid { x_m: vec![far.x], y_m: vec![far.y], z_m: vec![far.z], wanted: vec![true] };
            let mut point = flash(&scene, grid, &settings, &lights, &camera, &truth)?;
            point.series = format!("live solve, refinement {refine}");
            point.setting = format!("live solve, refinement {refine}, residual {tolerance:e}");
            point.truth = words.clone();
            point.bytes = None;
            points.push(point);
        }
    }
    Ok(points)
}

/// Draws the flash from the bytes of a response and says how far it is off, and what it takes.
fn flash(
    scene: &ChartScene<'_>,
    lights: LightGrid,
    settings: &ResponseSettings,
    stroke: &[PointLight],
    camera: &Camera,
    truth: &[f32],
) -> Result<Point, BakeError> {
    let sources = Sources { lights, distant: Vec::new() };
    let baked = bake_response(&scene.cloud, &sources, settings, &[], &Quiet)?;
    let (asset, bytes) = asset_of(&scene.cloud, baked)?;
    let mut clouds = Clouds::new(&asset)?;
    let (done, cost) =
        seconds(REPEATS, || relight(&mut clouds, stroke, ("camera", camera), None, false, &Quiet));
    let (fields, report) = done?;
    let relighter = clouds.relighter();
    let inner = match report.live {
        Some(_) => {
            let solver = LiveSolver::new(&scene.cloud, &relighter.response().head.solver)?;
            let samples = automatic_samples(settings.refine);
            // Direct light comes on top either way.
            let direct = solver.direct(stroke, &[], samples);
            let (done, cost) = seconds(4 * REPEATS, || solver.solve(&direct, &mut |_| true));
            done?;
            cost
        }
        None => {
            let mut buffers = RelightBuffers::default();
            let mut relight = || -> Result<(), BakeError> {
                relighter.relight(stroke, RelightOptions::default(), &mut buffers)?;
                Ok(())
            };
            relight()?;
            let (done, cost) = seconds(4 * REPEATS, relight);
            done?;
            cost
        }
    };
    let image = &fields.images[0].2.mean;
    let (mut square, mut size) = (0.0, 0.0);
    for (&x, &r) in image.iter().zip(truth) {
        square += f64::from(x - r) * f64::from(x - r);
        size += f64::from(r) * f64::from(r);
    }
    Ok(Point {
        series: String::new(),
        setting: String::new(),
        truth: String::new(),
        errors: vec![(RMSE, libm::sqrt(square / size))],
        costs: vec![(TIME, cost.times(1e3)), (RELIGHT, inner.times(1e3))],
        bytes: Some(bytes),
        chosen: false,
        baseline: false,
    })
}

/// A few points of the recipe's first stroke in the cloud, or one lamp inside it.
fn stroke_of(task: &Sweep<'_>, scene: &ChartScene<'_>) -> Vec<PointLight> {
    let cloud = &scene.cloud;
    let inside =
        |p: &PointLight| p.position.cmpge(cloud.origin_m).all() && p.position.cmple(cloud.far_corner()).all();
    let points: Vec<PointLight> = task
        .recipe
        .strokes
        .first()
        .map(|record| Stroke::grow(record).lights(0.0).into_iter().filter(inside).collect())
        .unwrap_or_default();
    if points.is_empty() {
        return vec![scene.light(task.recipe)];
    }
    let step = points.len().div_ceil(LAMPS);
    points.iter().step_by(step).map(|p| PointLight { intensity: 1.0, ..*p }).collect()
}

/// The recipe's own camera on few pixels, or one that sees the whole cloud from its side.
fn camera(task: &Sweep<'_>, scene: &ChartScene<'_>) -> Result<Camera, BakeError> {
    let size = if task.quick { [16, 9] } else { [48, 27] };
    if let Some(view) = &task.recipe.view {
        let mut camera = view.camera.clone();
        camera.size_px = size;
        return Ok(camera_of(&camera)?);
    }
    let (low, high) = (scene.cloud.origin_m, scene.cloud.far_corner());
    let (middle, extent) = (0.5 * (low + high), (high - low).length());
    let eye = match scene.settings.view_region {
        Some(view_region) => DVec3::from_array(view_region.centre()),
        None => middle - DVec3::Y * 1.2 * extent - DVec3::Z * 0.2 * extent,
    };
    let projection = Projection::Perspective { vertical_fov: Radians::from(Degrees(40.0)) };
    Ok(Camera::new(eye, middle - eye, DVec3::Z, projection, size)?)
}

/// The flash by chance: radiance per pixel, and its standard errors' share of it.
fn path_trace(
    task: &Sweep<'_>,
    scene: &ChartScene<'_>,
    lights: &[PointLight],
    camera: &Camera,
    progress: &dyn Progress,
) -> Result<(Vec<f32>, f64), BakeError> {
    let photons: u64 = if task.quick { 100_000 } else { 2_000_000 };
    let cameras = [("camera".to_owned(), camera.clone())];
    let (mut sum, mut square): (Vec<f32>, f64) = (Vec::new(), 0.0);
    for (at, light) in lights.iter().enumerate() {
        let light = Light::Point { position: light.position, intensity: light.intensity };
        let settings = ChanceSettings { photons, seed: SEED + at as u64 };
        let (fields, _) = solve_by_chance(&scene.cloud, light, &cameras, &settings, progress)?;
        let image = &fields.images[0].2;
        sum.resize(image.mean.len(), 0.0);
        sum.iter_mut().zip(&image.mean).for_each(|(sum, value)| *sum += value);
        let errors = image.error.iter().flatten();
        square += errors.map(|&error| f64::from(error) * f64::from(error)).sum::<f64>();
    }
    let size: f64 = sum.iter().map(|&value| f64::from(value) * f64::from(value)).sum();
    Ok((sum, libm::sqrt(square / size)))
}
