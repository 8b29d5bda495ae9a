//! Chart `compression`: what coding does to relit light, against bytes and the time of a relighting.

use super::clock::seconds;
use super::scene::chart_scene;
use super::{Cost, Point, Sweep};
use crate::asset::asset_of;
use crate::error::BakeError;
use crate::evaluate::RelitError;
use crate::evaluate::candidate::touched;
use crate::evaluate::views::{ViewFactors, Views};
use crate::progress::{Progress, Quiet};
use crate::response::{Job, ResponseSettings, SolvedRows, Sources, WantedLights, solve_rows};
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis};
use squall_formats::view_region::ViewRegionFrame;
use squall_runtime::relight::{
    RelightBuffers, RelightOptions, Relighter, Relit, SourceWeight, split_lights, view_region_frame,
};
use squall_runtime::transport::Cloud;

const L2: &str = "relit L2";
const TAIL: &str = "relit, 99.9th percentile over the peak";
const MEDIAN: &str = "relit, median pointwise";
pub const BYTES: &str = "bytes a source";
pub const TIME: &str = "relight, CPU µs";

pub const PAIRS: &[(&str, &str)] = &[(L2, BYTES), (L2, TIME), (TAIL, BYTES), (MEDIAN, BYTES)];

pub const REPEATS: usize = 9;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 11 } else { 1 << 14 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let (site, cloud) = (scene.site(), &scene.cloud);
    let lights = site.place_lights(scene.spacing_m)?;
    let strokes = site.strokes(&lights, scene.spacing_m, 0..if task.quick { 2 } else { 4 });
    if strokes.is_empty() {
        return Ok(Vec::new());
    }
    let all = lights.wanted_count();
    let wanted = touched(&lights, &strokes);
    let sources = Sources { lights: WantedLights { wanted, ..lights }, distant: Vec::new(), sun: None };
    let mut errors = if task.quick {
        vec![0.1, 0.01]
    } else {
        vec![0.5, 0.3, 0.2, 0.1, 0.05, 0.03, 0.02, 0.01, 5e-3, 2e-3, 1e-3, 3e-4, 1e-4]
    };
    let own = &scene.settings;
    if !errors.contains(&own.relative_error) {
        errors.push(own.relative_error);
    }
    let mut kinds = vec![
        (DirectionalBasis::Directions26, DirectTerm::InRows),
        (DirectionalBasis::Harmonics { degree: 3 }, DirectTerm::AtRunTime),
        (DirectionalBasis::Harmonics { degree: 1 }, DirectTerm::AtRunTime),
    ];
    if !kinds.contains(&(own.basis, own.direct)) {
        kinds.push((own.basis, own.direct));
    }
    let steps = errors.len() + task.peers.as_ref().map_or(0, |peers| peers.steps(task.quick));
    progress.begin("chart compression", (kinds.len() * steps) as u64);
    let mut points = Vec::new();
    for (basis, direct) in kinds {
        let settings = ResponseSettings { basis, direct, ..*own };
        let job = Job {
            cloud,
            sources: &sources,
            settings: &settings,
            held_out: &strokes,
            known: None,
            shown: None,
            cache: None,
        };
        let solved = solve_rows(&job, &Quiet)?;
        let sight = Sight::new(cloud, &solved);
        let what = match (basis, direct) {
            (DirectionalBasis::Directions26, _) => "26 directions, direct light inside".to_owned(),
            (DirectionalBasis::ViewRegion { .. }, _) => {
                format!("{} coefficients towards the view region, direct light at run time", basis.count())
            }
            (other, _) => format!("{} harmonics, direct light at run time", other.count()),
        };
        let truth = format!("{}: {} strokes, the same rows uncompressed, {what}", scene.words, strokes.len());
        points.push(dense(&solved, &truth, all)?);
        for &error in &errors {
            progress.check()?;
            progress.advance(1);
            for codec in [Codec::Entropy, Codec::Bytes, Codec::Paper] {
                let ambients: &[bool] = if codec == Codec::Paper { &[false, true] } else { &[false] };
                for &ambient in ambients {
                    let chosen = !ambient
                        && codec == own.codec
                        && basis == own.basis
                        && direct == own.direct
                        && error == own.relative_error;
                    let mut point = coded(cloud, &solved, &sight, (basis, codec, error), ambient)?;
                    point.truth = truth.clone();
                    point.bytes =
                        point.bytes.map(|bytes| bytes * all as u64 / solved.planes.len().max(1) as u64);
                    point.chosen = chosen;
                    points.push(point);
                }
            }
        }
        if let Some(peers) = &task.peers {
            points.extend(peers.sweep(&solved, &sight, (&truth, all), task.quick, progress)?);
        }
    }
    Ok(points)
}

/// From where light is compared: the 26 directions, or viewpoints.
pub struct Sight {
    views: Views,
    factors: ViewFactors,
    frame: Option<ViewRegionFrame>,
}

impl Sight {
    fn new(cloud: &Cloud, solved: &SolvedRows) -> Self {
        let head = &solved.head;
        let frame = head.view_region.as_ref().map(|view_region| view_region_frame(view_region, cloud));
        let views = Views::new(cloud, head.view_region.as_ref(), 0, |cell| head.sees(cell));
        Self { factors: views.factors(head.basis, frame.as_ref()), views, frame }
    }

    /// Errors of one stroke's channels against others of the same kind.
    pub fn errors(&self, basis: DirectionalBasis, found: &[f32], wanted: &[f32]) -> RelitError {
        let light = |planes| Relit { basis, frame: self.frame, cells: found.len() / basis.count(), planes };
        self.views.errors(&light(found), &light(wanted), &self.factors)
    }
}

/// The rows that each stroke touches with their weights, and the time that adding a stroke's rows takes, a mean over strokes.
pub fn timed_sums(solved: &SolvedRows) -> Result<(Vec<Vec<SourceWeight>>, Cost), BakeError> {
    let weights = solved.held_out.iter().map(|stroke| split_lights(&solved.head, &stroke.lights));
    let weights: Vec<Vec<SourceWeight>> = weights.collect::<Result<_, _>>()?;
    // What the values are makes no difference to the time.
    let rows = &solved.planes;
    let mut sum = vec![0.0f32; rows.first().map_or(0, Vec::len)];
    let (_, cost) = seconds(REPEATS, || {
        for weight in weights.iter().flatten() {
            let row = &rows[weight.row as usize];
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight.intensity * value);
        }
    });
    let strokes = weights.len().max(1) as f64;
    Ok((weights, cost.times(1.0 / strokes)))
}

/// The rows as they were solved: four bytes a value, no error, a sum over rows.
fn dense(solved: &SolvedRows, truth: &str, all: usize) -> Result<Point, BakeError> {
    let bytes = solved.planes.first().map_or(0, |row| row.len() * size_of::<f32>()) as f64;
    let (weights, cost) = timed_sums(solved)?;
    let touched = weights.iter().map(Vec::len).sum::<usize>() as f64 / weights.len().max(1) as f64;
    Ok(Point {
        series: "uncompressed, f32".into(),
        setting: format!("a sum over {touched:.0} rows"),
        truth: truth.into(),
        errors: vec![(L2, 0.0), (TAIL, 0.0), (MEDIAN, 0.0)],
        costs: vec![(BYTES, Cost::exact(bytes)), (TIME, cost.times(1e6))],
        bytes: Some((bytes * all as f64) as u64),
        chosen: false,
        baseline: false,
    })
}

/// Errors of strokes as one: [`RelitError::mean`].
pub fn mean_errors(each: &[RelitError]) -> Vec<(&'static str, f64)> {
    let RelitError { l2, tail, median } = RelitError::mean(each);
    vec![(L2, l2), (TAIL, tail), (MEDIAN, median)]
}

fn coded(
    cloud: &Cloud,
    solved: &SolvedRows,
    sight: &Sight,
    (basis, codec, error): (DirectionalBasis, Codec, f64),
    ambient: bool,
) -> Result<Point, BakeError> {
    let baked = solved.encode(basis, codec, error);
    let (strokes, rows) = (baked.held_out.clone(), baked.rows.rows.len().max(1));
    let (asset, bytes) = asset_of(cloud, baked)?;
    let relighter = Relighter::new(&asset)?;
    let options = RelightOptions { paper_ambient: ambient };
    let mut buffers = RelightBuffers::default();
    let mut each = Vec::with_capacity(strokes.len());
    for stroke in &strokes {
        let relit = relighter.relight(&stroke.lights, options, &mut buffers)?;
        each.push(sight.errors(basis, relit.planes, &stroke.uncompressed));
    }
    let count = strokes.len() as f64;
    let (done, cost) = seconds(REPEATS, || -> Result<(), BakeError> {
        for stroke in &strokes {
            relighter.relight(&stroke.lights, options, &mut buffers)?;
        }
        Ok(())
    });
    done?;
    let series = match (codec, ambient) {
        (Codec::Entropy, _) => "Haar, entropy-coded",
        (Codec::Bytes, _) => "Haar, quantised bytes",
        (Codec::Paper, false) => "paper's Haar + ξ, no ambient",
        (Codec::Paper, true) => "paper's Haar + ξ with ambient γ",
    };
    Ok(Point {
        series: series.into(),
        setting: format!("{series}, asked {error:e}"),
        truth: String::new(),
        errors: mean_errors(&each),
        costs: vec![(BYTES, Cost::exact(bytes as f64 / rows as f64)), (TIME, cost.times(1e6 / count))],
        bytes: Some(bytes),
        chosen: false,
        baseline: codec == Codec::Paper,
    })
}
