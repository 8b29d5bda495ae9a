//! Chart `lightning-grid`: how far a stroke split over virtual lamps is off the same stroke solved directly, against lamps and bytes.

use super::clock::seconds;
use super::scene::chart_scene;
use super::{Cost, Metric, Point, Sweep};
use crate::error::BakeError;
use crate::progress::{Progress, Quiet};
use crate::response::ResponseSettings;
use crate::storm::clouds::{place_lamps, reach_of, strokes_for};
use crate::trial::Trial;
use squall_formats::section::response::{ChannelBasis, DirectTerm};

const L2: Metric = Metric::less("stroke L2 over 26 directions");
const MEDIAN: Metric = Metric::less("stroke, median pointwise");
const LAMPS: &str = "lamps";
const BYTES: &str = "response, bytes";
const BAKE: &str = "bake, CPU s";

pub const PAIRS: &[(&str, &str)] =
    &[(L2.name, LAMPS), (L2.name, BYTES), (MEDIAN.name, BYTES), (L2.name, BAKE)];

/// Bytes of solved rows at which finer lamps are left out.
const MOST_BYTES: usize = 1 << 31;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 10 } else { 1 << 14 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let (clouds, cloud) = (scene.clouds, &scene.cloud);
    let side = {
        let [low, high] = reach_of(task.recipe, clouds, cloud);
        (high - low).max_element()
    };
    let own = if clouds.lamps.spacing_m > 0.0 { clouds.lamps.spacing_m } else { side / 12.0 };
    let steps: &[f64] = if task.quick { &[2.0, 1.0] } else { &[4.0, 2.83, 2.0, 1.41, 1.0, 0.71, 0.5, 0.35] };
    let kinds = [
        ("direct light at run time", DirectTerm::AtRunTime, ChannelBasis::Harmonics { degree: 3 }, false),
        (
            "direct light at run time, 4 channels",
            DirectTerm::AtRunTime,
            ChannelBasis::Harmonics { degree: 1 },
            false,
        ),
        ("paper: direct light in the rows", DirectTerm::InRows, ChannelBasis::Directions26, true),
    ];
    let count = if task.quick { 2 } else { 6 };
    progress.begin("chart lightning-grid", (kinds.len() * steps.len()) as u64);
    let mut points = Vec::new();
    for (series, direct, channels, baseline) in kinds {
        for &step in steps {
            progress.check()?;
            progress.advance(1);
            let spacing_m = own * step;
            let lamps = place_lamps(task.recipe, clouds, cloud, spacing_m)?;
            let strokes = strokes_for(task.recipe, clouds, cloud, &lamps, spacing_m, 0..count);
            if strokes.is_empty() || Trial::bytes(&lamps, &strokes, channels, cloud) > MOST_BYTES {
                continue;
            }
            let settings = ResponseSettings { direct, channels, ..clouds.response };
            let solve = || Trial::new(cloud, &lamps, 0, &settings, &strokes, None, &Quiet);
            let (trial, cost) = seconds(1, solve);
            let trial = trial?;
            let outcome = trial.code(channels, settings.codec, settings.relative_error)?;
            let share = trial.lamps as f64 / trial.rows().max(1) as f64;
            points.push(Point {
                series: series.into(),
                setting: format!("{spacing_m:.0} m apart, {} lamps", trial.lamps),
                truth: format!("{}: {} unseen strokes, each solved directly", scene.words, strokes.len()),
                errors: vec![(L2, outcome.verdict.stroke.l2), (MEDIAN, outcome.verdict.stroke.median)],
                costs: vec![
                    (LAMPS, Cost::exact(trial.lamps as f64)),
                    (BYTES, Cost::exact(outcome.bytes as f64)),
                    // Of the rows that the strokes touch, scaled to all.
                    (BAKE, cost.times(share)),
                ],
                bytes: Some(outcome.bytes),
                chosen: step == 1.0
                    && direct == clouds.response.direct
                    && channels == clouds.response.channels,
                baseline,
            });
        }
    }
    Ok(points)
}
