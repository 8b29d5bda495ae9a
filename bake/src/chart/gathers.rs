//! Chart `gathers`: how far a stroke's light is off the same stroke solved directly, against the time that it takes: from rows, solved for on
//! the spot in the rows' cells or in larger ones, each with so many transport sweeps behind it.

use super::clock::seconds;
use super::scene::{ChartScene, chart_scene};
use super::{Cost, Point, Sweep};
use crate::asset::asset_of;
use crate::error::BakeError;
use crate::evaluate::RelitError;
use crate::evaluate::candidate::touched;
use crate::evaluate::held_out::grown_strokes;
use crate::progress::{Progress, Quiet};
use crate::response::{
    Job, LightSpacing, ResponseSettings, Sources, WantedLights, bake_response, in_26_directions, light_grid,
};
use glam::DVec3;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{DirectTerm, DirectionalBasis, SolverRecord};
use squall_formats::sphere;
use squall_runtime::Clouds;
use squall_runtime::clouds::{CloudLight, LightQuality};
use squall_runtime::live::LiveSolver;
use squall_runtime::relight::PointLight;

const L2: &str = "stroke L2, all light";
const MEDIAN: &str = "stroke, median pointwise";
const TIME: &str = "scattered light of a stroke, CPU ms";
const BYTES: &str = "response, bytes";

pub const PAIRS: &[(&str, &str)] = &[(L2, TIME), (MEDIAN, TIME), (L2, BYTES)];

/// Residual of the solves that are taken for true.
const TRUE_RESIDUAL: f64 = 1e-4;
/// Points along the longest side of the cloud's box.
const POINTS: f64 = 48.0;

/// A stroke with its light in 26 directions, solved directly: all of it, and the part that is direct.
struct Truth {
    lights: Vec<PointLight>,
    whole: Vec<f32>,
    direct: Vec<f32>,
}

/// What all points of a sweep share.
struct Shot<'a> {
    scene: &'a ChartScene<'a>,
    truths: Vec<Truth>,
    gathers: &'a [u32],
    words: String,
}

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 10 } else { 1 << 16 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let (cloud, count) = (&scene.cloud, if task.quick { 2 } else { 8 });
    let bounds = [cloud.origin_m, cloud.far_corner()];
    let inside = |point: DVec3| point.cmpge(bounds[0]).all() && point.cmple(bounds[1]).all();
    let spacing = (bounds[1] - bounds[0]).max_element() / POINTS;
    let strokes = grown_strokes(cloud, bounds, inside, spacing, 0..count);
    if strokes.is_empty() {
        return Ok(Vec::new());
    }
    let steps: &[f64] = if task.quick { &[1.0] } else { &[2.0, 1.0] };
    let cells: &[u32] = if task.quick { &[1, 2] } else { &[1, 2, 4] };
    progress.begin("chart gathers", (1 + 2 * steps.len() + cells.len()) as u64);
    let truths = truths(&scene, strokes)?;
    progress.advance(1);
    let gathers: &[u32] = if task.quick { &[0, 1] } else { &[0, 1, 2, 3] };
    let words =
        format!("{}: {} held-out strokes, each solved directly, in 26 directions", scene.words, truths.len());
    let shot = Shot { scene: &scene, truths, gathers, words };
    let mut points = Vec::new();
    for &step in steps {
        for degree in [1, 3] {
            progress.check()?;
            progress.advance(1);
            points.extend(shot.rows(step, degree)?);
        }
    }
    for &live_cells in cells {
        progress.check()?;
        progress.advance(1);
        points.extend(shot.live(live_cells)?);
    }
    Ok(points)
}

fn truths(scene: &ChartScene<'_>, strokes: Vec<Vec<PointLight>>) -> Result<Vec<Truth>, BakeError> {
    let record = SolverRecord {
        tolerance: TRUE_RESIDUAL,
        ..any_asset(scene)?.relighter().response().head.solver.clone()
    };
    let solver = LiveSolver::new(&scene.cloud, &record)?;
    let directions = sphere::directions_26().map(DVec3::from_array);
    let one = |lights: Vec<PointLight>| -> Result<Truth, BakeError> {
        let direct = solver.direct(&lights, &directions, 1);
        let scattered = solver.solve(&direct, &mut |_| true)?.coefficients;
        let mut whole = in_26_directions(&scattered);
        whole.iter_mut().zip(&direct.towards).for_each(|(sum, value)| *sum += value);
        Ok(Truth { lights, whole, direct: direct.towards })
    };
    strokes.into_iter().map(one).collect()
}

/// The cloud with one row, of a light far away: nothing of a stroke is baked.
fn any_asset(scene: &ChartScene<'_>) -> Result<Clouds, BakeError> {
    let cloud = &scene.cloud;
    let far = cloud.far_corner() + 10.0 * (cloud.far_corner() - cloud.origin_m);
    let grid = LightGrid { x_m: vec![far.x], y_m: vec![far.y], z_m: vec![far.z] };
    let lights = WantedLights { grid, wanted: vec![true] };
    Ok(baked(scene, lights, 0)?.0)
}

/// The cloud with rows of `lights`, harmonics of `degree`, and their bytes.
fn baked(scene: &ChartScene<'_>, lights: WantedLights, degree: u8) -> Result<(Clouds, u64), BakeError> {
    let settings = ResponseSettings {
        basis: DirectionalBasis::Harmonics { degree },
        direct: DirectTerm::AtRunTime,
        view_region: None,
        refine: 1,
        seen_only: true,
        ..scene.settings
    };
    let sources = Sources { lights, distant: Vec::new(), sun: None };
    let cloud = &scene.cloud;
    let job = Job {
        cloud,
        sources: &sources,
        settings: &settings,
        held_out: &[],
        known: None,
        shown: None,
        cache: None,
    };
    let (asset, bytes) = asset_of(cloud, bake_response(&job, &Quiet)?)?;
    Ok((Clouds::new(&asset)?, bytes))
}

impl Shot<'_> {
    /// Rows of virtual lights `step` times as far apart as the recipe's, everywhere in the cloud's box.
    fn rows(&self, step: f64, degree: u8) -> Result<Vec<Point>, BakeError> {
        let (cloud, spacing_m) = (&self.scene.cloud, self.scene.spacing_m * step);
        let spacing = LightSpacing { base_m: spacing_m, epsilon: 0.0, longest_m: spacing_m };
        let grid = light_grid(cloud.origin_m, cloud.far_corner(), cloud.origin_m.z, spacing);
        let strokes: Vec<Vec<PointLight>> = self.truths.iter().map(|truth| truth.lights.clone()).collect();
        let wanted = touched(&grid, &strokes);
        let (all, tried) = (grid.len() as u64, wanted.iter().filter(|&&wanted| wanted).count().max(1) as u64);
        let (mut clouds, bytes) = baked(self.scene, WantedLights { wanted, ..grid }, degree)?;
        let bytes = bytes * all / tried;
        let count = (degree + 1) * (degree + 1);
        let name = format!("baked, {count} coefficients, virtual lights {spacing_m:.0} m apart");
        let mut points = self.points(&mut clouds, &name, 1)?;
        for point in &mut points {
            point.bytes = Some(bytes);
            point.costs.push((BYTES, Cost::exact(bytes as f64)));
            point.chosen = step == 1.0 && degree == 1 && point.chosen;
        }
        Ok(points)
    }

    /// Solved for on the spot, in cells so many times as long as the rows'.
    fn live(&self, live_cells: u32) -> Result<Vec<Point>, BakeError> {
        let mut clouds = any_asset(self.scene)?;
        let name = match live_cells {
            1 => "live solve".to_owned(),
            _ => format!("live solve in cells {live_cells} times as large"),
        };
        let mut points = self.points(&mut clouds, &name, live_cells)?;
        points.iter_mut().for_each(|point| point.chosen = false);
        Ok(points)
    }

    /// One series, a point for each number of gathers.
    fn points(&self, clouds: &mut Clouds, name: &str, live_cells: u32) -> Result<Vec<Point>, BakeError> {
        self.gathers
            .iter()
            .map(|&gathers| self.point(clouds, name, LightQuality { gathers, live_cells }))
            .collect()
    }

    fn point(&self, clouds: &mut Clouds, name: &str, quality: LightQuality) -> Result<Point, BakeError> {
        clouds.set_quality(quality)?;
        // Planned once, as for the strokes of a scene.
        clouds.light(&self.truths[0].lights)?;
        let (lit, cost) = seconds(1, || -> Result<Vec<CloudLight>, BakeError> {
            Ok(self.truths.iter().map(|truth| clouds.light(&truth.lights)).collect::<Result<_, _>>()?)
        });
        let lit = lit?;
        let errors: Vec<RelitError> =
            lit.iter().zip(&self.truths).map(|(light, truth)| self.error(light, truth)).collect();
        let RelitError { l2, median, .. } = RelitError::mean(&errors);
        let residual =
            lit.iter().filter_map(|light| Some(light.gather_report()?.residual)).fold(0.0, f64::max);
        let setting = match quality.gathers {
            0 => format!("{name}, no gather"),
            n => format!("{name}, {n} gathers; residual found {:.1} % at most", 100.0 * residual),
        };
        Ok(Point {
            series: name.to_owned(),
            setting,
            truth: self.words.clone(),
            errors: vec![(L2, l2), (MEDIAN, median)],
            costs: vec![(TIME, cost.times(1e3 / self.truths.len() as f64))],
            bytes: None,
            chosen: quality.gathers == 0,
            baseline: false,
        })
    }

    fn error(&self, light: &CloudLight, truth: &Truth) -> RelitError {
        let cloud = &self.scene.cloud;
        let lit = light.in_scattered();
        let shaded = cloud.shaded();
        let cells: Vec<usize> = (0..shaded.len()).filter(|&cell| shaded[cell]).collect();
        let mut found = vec![0.0f32; cells.len() * 26];
        let mut j = vec![0.0; shaded.len()];
        for (number, direction) in sphere::directions_26().map(DVec3::from_array).into_iter().enumerate() {
            lit.towards_each(cloud, |_, _| direction, &mut j);
            for (place, &cell) in cells.iter().enumerate() {
                found[26 * place + number] = j[cell] + truth.direct[26 * cell + number];
            }
        }
        let wanted: Vec<f32> =
            cells.iter().flat_map(|&cell| &truth.whole[26 * cell..26 * cell + 26]).copied().collect();
        RelitError::of(&found, &wanted, &sphere::weights_26())
    }
}
