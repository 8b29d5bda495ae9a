//! Chart `lightning-grid`: how far a stroke split over virtual lamps is off the same stroke solved directly, against lamps and bytes.

use super::clock::seconds;
use super::scene::{ChartScene, chart_scene};
use super::{Cost, Point, Sweep};
use crate::candidate::{Candidate, Whole};
use crate::error::BakeError;
use crate::progress::{Progress, Quiet};
use crate::response::{ResponseSettings, WantedLights, solve_tests};
use crate::storm::clouds::{place_lights, strokes_for};
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis};
use squall_runtime::relight::PointLight;

const L2: &str = "stroke L2, all light";
const MEDIAN: &str = "stroke, median pointwise";
const LAMPS: &str = "lamps";
const BYTES: &str = "response, bytes";
const BAKE: &str = "bake, CPU s";

pub const PAIRS: &[(&str, &str)] = &[(L2, LAMPS), (L2, BYTES), (MEDIAN, BYTES), (L2, BAKE)];

/// Bytes of solved rows at which finer lamps are left out.
const MOST_BYTES: usize = 1 << 31;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 10 } else { 1 << 14 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let (clouds, cloud) = (scene.clouds, &scene.cloud);
    let steps: &[f64] = if task.quick { &[2.0, 1.0] } else { &[4.0, 2.83, 2.0, 1.41, 1.0, 0.71, 0.5, 0.35] };
    let own = (scene.settings.direct, scene.settings.channels);
    let mut kinds = vec![
        (
            "16 channels",
            DirectTerm::AtRunTime,
            DirectionalBasis::Harmonics { degree: 3 },
            scene.settings.codec,
        ),
        (
            "4 channels",
            DirectTerm::AtRunTime,
            DirectionalBasis::Harmonics { degree: 1 },
            scene.settings.codec,
        ),
        (
            "paper: direct light in 26 directions",
            DirectTerm::InRows,
            DirectionalBasis::Directions26,
            Codec::Paper,
        ),
    ];
    if !kinds.iter().any(|&(_, direct, channels, codec)| {
        (direct, channels, codec) == (own.0, own.1, scene.settings.codec)
    }) {
        kinds.push(("the recipe's channels", own.0, own.1, scene.settings.codec));
    }
    let grids = steps.iter().map(|step| place_lights(task.recipe, clouds, cloud, scene.spacing_m * step));
    let grids = grids.collect::<Result<Vec<WantedLights>, _>>()?;
    let strokes = common_strokes(task, &scene, &grids, if task.quick { 2 } else { 6 });
    if strokes.is_empty() {
        return Ok(Vec::new());
    }
    let views =
        if scene.settings.view_region.is_some() { "towards the recipe's eyes" } else { "in 26 directions" };
    progress.begin("chart lightning-grid", (kinds.len() * (steps.len() + 1)) as u64);
    let mut points = Vec::new();
    for (series, direct, channels, codec) in kinds {
        progress.check()?;
        let settings = ResponseSettings { direct, channels, codec, ..scene.settings };
        let tests = solve_tests(cloud, &settings, &strokes, &Quiet)?;
        progress.advance(1);
        for (&step, lights) in steps.iter().zip(&grids) {
            progress.check()?;
            progress.advance(1);
            if Candidate::bytes(lights, &strokes, channels, cloud) > MOST_BYTES {
                continue;
            }
            let error = settings.relative_error;
            let (done, cost) = seconds(1, || -> Result<_, BakeError> {
                let candidate = Candidate::new(
                    cloud,
                    lights,
                    Whole::default(),
                    &settings,
                    (&strokes, Some(&tests)),
                    &Quiet,
                )?;
                let coded = candidate.encode(channels, codec, error);
                Ok((candidate, coded))
            });
            let (candidate, _) = done?;
            let outcome = candidate.code(channels, codec, error)?;
            let share = candidate.lights as f64 / candidate.rows().max(1) as f64;
            points.push(Point {
                series: series.into(),
                setting: format!("{:.0} m apart, {} lamps", scene.spacing_m * step, candidate.lights),
                truth: format!(
                    "{}: {} unseen strokes, each solved directly, {views}",
                    scene.words,
                    strokes.len()
                ),
                errors: vec![(L2, outcome.scores.stroke.l2), (MEDIAN, outcome.scores.stroke.median)],
                costs: vec![
                    (LAMPS, Cost::exact(candidate.lights as f64)),
                    (BYTES, Cost::exact(outcome.bytes as f64)),
                    // Of the rows that the strokes touch, scaled to all.
                    (BAKE, cost.times(share)),
                ],
                bytes: Some(outcome.bytes),
                chosen: step == 1.0 && (direct, channels) == own && codec == scene.settings.codec,
                baseline: direct == DirectTerm::InRows && codec == Codec::Paper,
            });
        }
    }
    Ok(points)
}

/// Strokes of the finest lamps, with the points alone that all lamps reach: every grid is judged by the same light.
fn common_strokes(
    task: &Sweep<'_>,
    scene: &ChartScene<'_>,
    grids: &[WantedLights],
    count: usize,
) -> Vec<Vec<PointLight>> {
    let Some(finest) = grids.last() else { return Vec::new() };
    let spacing = finest.grid.x_m.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let spacing = if spacing.is_finite() { spacing } else { scene.spacing_m };
    let strokes = strokes_for(task.recipe, scene.clouds, &scene.cloud, finest, spacing, 0..count);
    let common = |stroke: Vec<PointLight>| -> Vec<PointLight> {
        stroke.into_iter().filter(|point| grids.iter().all(|grid| grid.reaches(point.position))).collect()
    };
    strokes.into_iter().map(common).filter(|stroke| !stroke.is_empty()).collect()
}
