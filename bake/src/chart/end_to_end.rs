//! Chart `end-to-end`: how far the picture of a flash is off a path-traced one, against processor time a flash: relit from baked rows,
//! or solved on the spot.

use super::clock::seconds;
use super::scene::{ChartScene, chart_scene};
use super::{Cost, Point, Sweep};
use crate::asset::asset_of;
use crate::cloud::automatic_samples;
use crate::error::BakeError;
use crate::evaluate::candidate::touched;
use crate::evaluate::{RelativeL2, relative_l2};
use crate::monte_carlo::{MonteCarloSettings, solve_monte_carlo};
use crate::progress::{Progress, Quiet};
use crate::relit::relight;
use crate::response::{Job, ResponseSettings, Sources, WantedLights, bake_response};
use glam::DVec3;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis};
use squall_formats::units::{Degrees, Radians};
use squall_runtime::camera::{Camera, Projection};
use squall_runtime::frame::camera_of;
use squall_runtime::live::LiveSolver;
use squall_runtime::relight::{PointLight, RelightBuffers, RelightOptions, Relighter};
use squall_runtime::shade::cloud::{Billows, CloudMarch, CloudShape, MarchQuality, WideRay, between};
use squall_runtime::shade::detail::{Detail, DetailParameters};
use squall_runtime::single_scatter::DirectRays;
use squall_runtime::stroke::{Segment, Stroke};
use squall_runtime::transport::Cloud;
use squall_runtime::transport::direct::Light;
use squall_runtime::{Clouds, Flash};

const RMSE: &str = "picture, relative RMSE";
const TIME: &str = "a flash, CPU ms";
const RELIGHT: &str = "of it relighting or solving scattered light, CPU ms";
const BYTES: &str = "response, bytes";

pub const PAIRS: &[(&str, &str)] = &[(RMSE, RELIGHT), (RMSE, TIME), (RMSE, BYTES)];

/// Points of light that stand for a stroke, in the truth and in what is compared with it.
const POINTS: usize = 4;
const SEED: u64 = 2;
const REPEATS: usize = 3;

/// Qualities of a frame, and their rays of direct light.
const FRAMES: [(&str, DirectRays); 2] = [("still", DirectRays::STILL), ("preview", DirectRays::PREVIEW)];

/// A way to store light: series, direct light, basis and codec.
type Kind = (&'static str, DirectTerm, DirectionalBasis, Codec);

/// What all pictures of a sweep share.
struct Shot<'a> {
    scene: &'a ChartScene<'a>,
    stroke: Vec<PointLight>,
    camera: Camera,
    /// The path-traced picture, and what it is in words.
    truth: Vec<f32>,
    words: String,
}

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 10 } else { 1 << 13 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let stroke = stroke_of(task, &scene);
    let camera = camera(task, &scene)?;
    let (truth, noise) = path_trace(task, &scene, &stroke, &camera, progress)?;
    let (width, height) = (camera.width, camera.height);
    let words =
        format!("{}, {width} × {height} px: path traced (its noise {:.1} %)", scene.words, 100.0 * noise);
    let shot = Shot { scene: &scene, stroke, camera, truth, words };
    let steps: &[f64] = if task.quick { &[1.0] } else { &[2.0, 1.41, 1.0, 0.71, 0.5, 0.35, 0.25] };
    let kinds = kinds(&scene.settings);
    let refinements: &[u32] = if task.quick { &[1] } else { &[1, 2, 3] };
    let tolerances: &[f64] = if task.quick { &[1e-2] } else { &[0.3, 0.1, 3e-2, 1e-2, 1e-3] };
    let count = kinds.len() * steps.len() + FRAMES.len() + refinements.len() * tolerances.len();
    progress.begin("chart end-to-end", count as u64);
    let mut points = Vec::new();
    for kind in kinds {
        for &step in steps {
            progress.check()?;
            progress.advance(1);
            points.push(shot.baked(kind, step)?);
        }
    }
    for (name, rays) in FRAMES {
        progress.check()?;
        progress.advance(1);
        points.push(shot.frame(name, rays)?);
    }
    for &refine in refinements {
        for &tolerance in tolerances {
            progress.check()?;
            progress.advance(1);
            points.push(shot.live(refine, tolerance)?);
        }
    }
    Ok(points)
}

/// The paper's way, two of ours, and the recipe's own.
fn kinds(own: &ResponseSettings) -> Vec<Kind> {
    let ours = |degree| (DirectTerm::AtRunTime, DirectionalBasis::Harmonics { degree }, own.codec);
    let paper = (DirectTerm::InRows, DirectionalBasis::Directions26, Codec::Paper);
    let mut kinds = vec![
        ("baked for any viewpoint, 16 coefficients", ours(3)),
        ("baked for any viewpoint, 4 coefficients", ours(1)),
        ("paper: direct light baked, 26 directions", paper),
    ];
    let own = (own.direct, own.basis, own.codec);
    if kinds.iter().all(|&(_, kind)| kind != own) {
        kinds.push(("baked, the recipe's basis", own));
    }
    kinds.into_iter().map(|(series, (direct, basis, codec))| (series, direct, basis, codec)).collect()
}

impl Shot<'_> {
    /// Relit from rows of lights `step` times as far apart as the recipe's.
    fn baked(&self, (series, direct, basis, codec): Kind, step: f64) -> Result<Point, BakeError> {
        let own = &self.scene.settings;
        let is_own = (direct, basis, codec) == (own.direct, own.basis, own.codec);
        let spacing_m = self.scene.spacing_m * step;
        let grid = self.scene.site().place_lights(spacing_m)?;
        let wanted = touched(&grid, std::slice::from_ref(&self.stroke));
        let all = grid.wanted_count();
        let mut settings = ResponseSettings { direct, basis, codec, ..*own };
        if !is_own {
            // Those are baked for viewpoints anywhere: what a view region saves is the recipe's own.
            settings.view_region = None;
        }
        let grid = WantedLights { wanted, ..grid };
        let tried = grid.wanted_count();
        let mut point = self.flash(grid, &settings)?;
        point.bytes = point.bytes.map(|bytes| bytes * all as u64 / tried.max(1) as u64);
        if let Some(bytes) = point.bytes {
            point.costs.push((BYTES, Cost::exact(bytes as f64)));
        }
        point.series = series.into();
        point.setting = format!("{series}, virtual lights {spacing_m:.0} m apart");
        point.chosen = step == 1.0 && is_own;
        point.baseline = direct == DirectTerm::InRows && codec == Codec::Paper;
        Ok(point)
    }

    /// Lit as a frame of the runtime is, from the recipe's own rows: direct light by so many rays, read between cells as scattered
    /// light is.
    fn frame(&self, name: &str, rays: DirectRays) -> Result<Point, BakeError> {
        let (cloud, camera) = (&self.scene.cloud, &self.camera);
        let grid = self.scene.site().place_lights(self.scene.spacing_m)?;
        let wanted = touched(&grid, std::slice::from_ref(&self.stroke));
        let lights = WantedLights { wanted, ..grid };
        let sources = Sources { lights, distant: Vec::new(), sun: None };
        let settings = &ResponseSettings { direct: DirectTerm::AtRunTime, ..self.scene.settings };
        let job =
            Job { cloud, sources: &sources, settings, held_out: &[], known: None, shown: None, cache: None };
        let (asset, bytes) = asset_of(cloud, bake_response(&job, &Quiet)?)?;
        let one = |light: &PointLight| Segment {
            from: light.position,
            to: light.position,
            order: 0,
            intensity: light.intensity,
        };
        let flash = [Flash::own(Stroke::from_segments(self.stroke.iter().map(one).collect(), [1.0; 3])?)];
        let shape = CloudShape::new(cloud);
        let detail = Detail::new(&DetailParameters::default())?;
        let density = Billows { shape: &shape, detail: &detail, billow: None };
        let march = CloudMarch::new(cloud, density, MarchQuality::PICTURE);
        let mut cells = vec![[0.0; 4]; cloud.shape.len()];
        let draw = || -> Result<Vec<f32>, BakeError> {
            // One that has kept nothing.
            let mut clouds = Clouds::new(&asset)?;
            clouds.set_rays(rays);
            clouds.radiance(&flash, camera, &mut cells)?;
            let j: Vec<f32> = cells.iter().map(|cell| cell[0]).collect();
            let pixel = |at: u32| {
                let [x, y] = [at % camera.width, at / camera.width].map(|at| f64::from(at) + 0.5);
                let ray = WideRay::thin(camera.ray(x, y));
                march.march(&ray, |point| f64::from(between(cloud, &j, point))).radiance as f32
            };
            Ok((0..camera.width * camera.height).map(pixel).collect())
        };
        let (done, cost) = seconds(REPEATS, draw);
        let rows = relight_cost(Clouds::new(&asset)?.relighter(), &self.stroke)?;
        Ok(Point {
            series: format!("frame, {name}"),
            setting: format!("frame of quality {name}, {rays:?}"),
            truth: self.words.clone(),
            errors: vec![(RMSE, relative_l2(&done?, &self.truth))],
            costs: vec![(TIME, cost.times(1e3)), (RELIGHT, rows.times(1e3))],
            bytes: Some(bytes),
            chosen: false,
            baseline: false,
        })
    }

    /// Solved on the spot.
    fn live(&self, refine: u32, tolerance: f64) -> Result<Point, BakeError> {
        let cloud = &self.scene.cloud;
        let mut settings = ResponseSettings {
            direct: DirectTerm::AtRunTime,
            basis: DirectionalBasis::Harmonics { degree: 0 },
            refine,
            ..self.scene.settings
        };
        settings.solve.tolerance = tolerance;
        // One virtual light far from the stroke: nothing of it is baked, so all of it is solved for.
        let side = (cloud.far_corner() - cloud.origin_m).max_element();
        let far = cloud.far_corner() + DVec3::splat(10.0 * side);
        let grid = LightGrid { x_m: vec![far.x], y_m: vec![far.y], z_m: vec![far.z] };
        let grid = WantedLights { grid, wanted: vec![true] };
        let mut point = self.flash(grid, &settings)?;
        point.series = format!("live solve, refinement {refine}");
        point.setting = format!("live solve, refinement {refine}, residual {tolerance:e}");
        point.bytes = None;
        Ok(point)
    }

    /// Draws the flash from the bytes of a response and says how far it is off, and what it takes.
    fn flash(&self, lights: WantedLights, settings: &ResponseSettings) -> Result<Point, BakeError> {
        let (cloud, stroke) = (&self.scene.cloud, self.stroke.as_slice());
        let sources = Sources { lights, distant: Vec::new(), sun: None };
        let job =
            Job { cloud, sources: &sources, settings, held_out: &[], known: None, shown: None, cache: None };
        let (asset, bytes) = asset_of(cloud, bake_response(&job, &Quiet)?)?;
        let mut clouds = Clouds::new(&asset)?;
        let (done, cost) =
            seconds(REPEATS, || relight(&mut clouds, stroke, ("camera", &self.camera), None, false, &Quiet));
        let (fields, report) = done?;
        let inner = match report.live {
            Some(_) => live_cost(cloud, clouds.relighter(), stroke, settings.refine)?,
            None => relight_cost(clouds.relighter(), stroke)?,
        };
        Ok(Point {
            series: String::new(),
            setting: String::new(),
            truth: self.words.clone(),
            errors: vec![(RMSE, relative_l2(&fields.images[0].2.mean, &self.truth))],
            costs: vec![(TIME, cost.times(1e3)), (RELIGHT, inner.times(1e3))],
            bytes: Some(bytes),
            chosen: false,
            baseline: false,
        })
    }
}

/// What solving for a stroke's scattered light takes; direct light comes on top either way.
fn live_cost(
    cloud: &Cloud,
    relighter: &Relighter,
    stroke: &[PointLight],
    refine: u32,
) -> Result<Cost, BakeError> {
    let solver = LiveSolver::new(cloud, &relighter.response().head.solver)?;
    let direct = solver.direct(stroke, &[], automatic_samples(refine));
    let (done, cost) = seconds(4 * REPEATS, || solver.solve(&direct, &mut |_| true));
    done?;
    Ok(cost)
}

/// What relighting a stroke from rows takes.
fn relight_cost(relighter: &Relighter, stroke: &[PointLight]) -> Result<Cost, BakeError> {
    let mut buffers = RelightBuffers::default();
    let mut relight = || -> Result<(), BakeError> {
        relighter.relight(stroke, RelightOptions::default(), &mut buffers)?;
        Ok(())
    };
    relight()?;
    let (done, cost) = seconds(4 * REPEATS, relight);
    done?;
    Ok(cost)
}

/// A few points of the recipe's first stroke in the cloud, or one point inside it.
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
        return vec![scene.light()];
    }
    let step = points.len().div_ceil(POINTS);
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
    let viewpoint = match scene.settings.view_region {
        Some(view_region) => DVec3::from_array(view_region.centre()),
        None => middle - DVec3::Y * 1.2 * extent - DVec3::Z * 0.2 * extent,
    };
    let projection = Projection::Perspective { vertical_fov: Radians::from(Degrees(40.0)) };
    Ok(Camera::new(viewpoint, middle - viewpoint, DVec3::Z, projection, size)?)
}

/// The flash by Monte Carlo: radiance per pixel, and its standard errors' share of it.
fn path_trace(
    task: &Sweep<'_>,
    scene: &ChartScene<'_>,
    lights: &[PointLight],
    camera: &Camera,
    progress: &dyn Progress,
) -> Result<(Vec<f32>, f64), BakeError> {
    let photons: u64 = if task.quick { 100_000 } else { 2_000_000 };
    let cameras = [("camera".to_owned(), camera.clone())];
    let (mut sum, mut square): (Vec<f32>, Vec<f32>) = (Vec::new(), Vec::new());
    for (at, light) in lights.iter().enumerate() {
        let light = Light::Point { position: light.position, intensity: light.intensity };
        let settings = MonteCarloSettings { photons, seed: SEED + at as u64 };
        let (fields, _) = solve_monte_carlo(&scene.cloud, light, &cameras, &settings, progress)?;
        let image = &fields.images[0].2;
        sum.resize(image.mean.len(), 0.0);
        sum.iter_mut().zip(&image.mean).for_each(|(sum, value)| *sum += value);
        square.resize(image.mean.len(), 0.0);
        let errors = image.error.iter().flatten();
        square.iter_mut().zip(errors).for_each(|(square, error)| *square += error * error);
    }
    let mut noise = RelativeL2::default();
    for (&square, &value) in square.iter().zip(&sum) {
        noise.add(libm::sqrt(f64::from(square)), f64::from(value), 1.0);
    }
    Ok((sum, noise.value()))
}
