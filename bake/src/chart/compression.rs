//! Chart `compression`: what coding does to relit light, against bytes and the time of a relighting.

use super::clock::seconds;
use super::scene::chart_scene;
use super::{Cost, Metric, Point, Sweep};
use crate::error::BakeError;
use crate::progress::{Progress, Quiet};
use crate::response::judge::{RelitError, compare, spread};
use crate::response::{LampGrid, ResponseSettings, SolvedRows, Sources, solve_rows};
use crate::storm::clouds::{place_lamps, strokes_for};
use crate::trial::{asset_of, touched};
use squall_formats::section::response::{ChannelBasis, Codec, DirectTerm};
use squall_runtime::relight::{RelightBuffers, RelightOptions, Relighter, Relit};
use squall_runtime::transport::Cloud;

const L2: Metric = Metric::less("relit L2");
const TAIL: Metric = Metric::less("relit, 99.9th percentile over the peak");
const MEDIAN: Metric = Metric::less("relit, median pointwise");
const BYTES: &str = "bytes a source";
const TIME: &str = "relight, CPU µs";

pub const PAIRS: &[(&str, &str)] =
    &[(L2.name, BYTES), (L2.name, TIME), (TAIL.name, BYTES), (MEDIAN.name, BYTES)];

const REPEATS: usize = 9;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 11 } else { 1 << 14 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let (clouds, cloud) = (scene.clouds, &scene.cloud);
    let side = (cloud.far_corner() - cloud.origin_m).max_element();
    let spacing_m = if clouds.lamps.spacing_m > 0.0 { clouds.lamps.spacing_m } else { side / 12.0 };
    let lamps = place_lamps(task.recipe, clouds, cloud, spacing_m)?;
    let strokes =
        strokes_for(task.recipe, clouds, cloud, &lamps, spacing_m, 0..if task.quick { 2 } else { 4 });
    if strokes.is_empty() {
        return Ok(Vec::new());
    }
    let wanted = touched(&lamps, &strokes);
    let sources = Sources { lamps: LampGrid { wanted, ..lamps }, distant: Vec::new() };
    let errors: &[f64] = if task.quick {
        &[0.1, 0.01]
    } else {
        &[0.5, 0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 3e-4, 1e-4]
    };
    let kinds = [
        (ChannelBasis::Directions26, DirectTerm::InRows),
        (ChannelBasis::Harmonics { degree: 3 }, DirectTerm::AtRunTime),
        (ChannelBasis::Harmonics { degree: 1 }, DirectTerm::AtRunTime),
    ];
    progress.begin("chart compression", (kinds.len() * errors.len()) as u64);
    let mut points = Vec::new();
    for (channels, direct) in kinds {
        let settings = ResponseSettings { channels, direct, ..clouds.response };
        let solved = solve_rows(cloud, &sources, &settings, &strokes, None, &Quiet)?;
        let what = match (channels, direct) {
            (ChannelBasis::Directions26, _) => "26 directions, direct light inside".to_owned(),
            (other, _) => format!("{} harmonics, direct light at run time", other.count()),
        };
        let truth = format!("{}: {} strokes, the same rows uncompressed, {what}", scene.words, strokes.len());
        points.push(dense(&solved, &truth));
        for &error in errors {
            progress.check()?;
            progress.advance(1);
            for codec in [Codec::Bytes, Codec::Paper] {
                let ambients: &[bool] = if codec == Codec::Paper { &[false, true] } else { &[false] };
                for &ambient in ambients {
                    let chosen = !ambient
                        && codec == clouds.response.codec
                        && channels == clouds.response.channels
                        && error == clouds.response.relative_error;
                    let mut point = coded(cloud, &solved, (channels, codec, error), ambient)?;
                    point.truth = truth.clone();
                    point.chosen = chosen;
                    points.push(point);
                }
            }
        }
    }
    Ok(points)
}

/// The rows as they were solved: four bytes a value, no error, a sum over rows.
fn dense(solved: &SolvedRows, truth: &str) -> Point {
    let rows = &solved.planes;
    let bytes = rows.first().map_or(0, |row| row.len() * size_of::<f32>()) as f64;
    let touched = (rows.len() / solved.tests.len().max(1)).max(1);
    let mut sum = vec![0.0f32; rows.first().map_or(0, Vec::len)];
    let (_, cost) = seconds(REPEATS, || {
        for row in rows.iter().take(touched) {
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += 0.5 * value);
        }
    });
    Point {
        series: "uncompressed, f32".into(),
        setting: format!("a sum over {touched} rows"),
        truth: truth.into(),
        // No error cannot be drawn on a logarithmic scale: half a unit in the last place of f32.
        errors: vec![(L2, 6e-8), (TAIL, 6e-8), (MEDIAN, 6e-8)],
        costs: vec![(BYTES, Cost::exact(bytes)), (TIME, cost.times(1e6))],
        bytes: Some((bytes * rows.len() as f64) as u64),
        chosen: false,
        baseline: false,
    }
}

fn coded(
    cloud: &Cloud,
    solved: &SolvedRows,
    (channels, codec, error): (ChannelBasis, Codec, f64),
    ambient: bool,
) -> Result<Point, BakeError> {
    let baked = solved.encode(channels, codec, error);
    let (tests, rows) = (baked.tests.clone(), baked.rows.rows.len().max(1));
    let (asset, bytes) = asset_of(cloud, baked)?;
    let relighter = Relighter::new(&asset)?;
    let options = RelightOptions { paper_ambient: ambient };
    let mut buffers = RelightBuffers::default();
    let mut sum = RelitError::default();
    for test in &tests {
        let relit = relighter.relight(&test.lamps, options, &mut buffers)?;
        let wanted = spread(&Relit { planes: &test.uncompressed, ..relit });
        let one = compare(&spread(&relit), &wanted);
        sum.l2 += one.l2 * one.l2;
        sum.tail += one.tail;
        sum.median += one.median;
    }
    let count = tests.len() as f64;
    let (done, cost) = seconds(REPEATS, || -> Result<(), BakeError> {
        for test in &tests {
            relighter.relight(&test.lamps, options, &mut buffers)?;
        }
        Ok(())
    });
    done?;
    let series = match (codec, ambient) {
        (Codec::Bytes, _) => "Haar, quantised bytes",
        (Codec::Paper, false) => "paper's Haar + ξ, no ambient",
        (Codec::Paper, true) => "paper's Haar + ξ with ambient γ",
    };
    Ok(Point {
        series: series.into(),
        setting: format!("{series}, asked {error:e}"),
        truth: String::new(),
        errors: vec![
            (L2, libm::sqrt(sum.l2 / count)),
            (TAIL, sum.tail / count),
            (MEDIAN, sum.median / count),
        ],
        costs: vec![(BYTES, Cost::exact(bytes as f64 / rows as f64)), (TIME, cost.times(1e6 / count))],
        bytes: Some(bytes),
        chosen: false,
        baseline: codec == Codec::Paper,
    })
}
