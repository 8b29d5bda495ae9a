//! Chart `lightning-grid`: how far a stroke split over virtual lights is off the same stroke solved directly, against virtual lights and bytes.

use super::clock::seconds;
use super::scene::{ChartScene, chart_scene};
use super::{Cost, Point, Sweep};
use crate::error::BakeError;
use crate::evaluate::candidate::Candidate;
use crate::plan::lights::Site;
use crate::progress::{Progress, Quiet};
use crate::response::{HeldOutStroke, Job, ResponseSettings, Sources, WantedLights, solve_held_out};
use squall_formats::section::response::{Codec, DirectTerm, DirectionalBasis};
use squall_runtime::relight::PointLight;

const L2: &str = "stroke L2, all light";
const MEDIAN: &str = "stroke, median pointwise";
const LIGHTS: &str = "virtual lights";
const BYTES: &str = "response, bytes";
const BAKE: &str = "bake, CPU s";

pub const PAIRS: &[(&str, &str)] = &[(L2, LIGHTS), (L2, BYTES), (MEDIAN, BYTES), (L2, BAKE)];

/// Bytes of solved rows at which finer grids are left out.
const MOST_BYTES: usize = 1 << 31;

/// A way to store light: series, direct light, basis and codec.
type Kind = (&'static str, DirectTerm, DirectionalBasis, Codec);

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let most = if task.quick { 1 << 10 } else { 1 << 14 };
    let Some(scene) = chart_scene(task.recipe, most)? else { return Ok(Vec::new()) };
    let site = scene.site();
    let steps: &[f64] = if task.quick { &[2.0, 1.0] } else { &[4.0, 2.83, 2.0, 1.41, 1.0, 0.71, 0.5, 0.35] };
    let grids = steps.iter().map(|step| site.place_lights(scene.spacing_m * step));
    let grids = grids.collect::<Result<Vec<WantedLights>, _>>()?;
    let strokes = common_strokes(&site, scene.spacing_m, &grids, if task.quick { 2 } else { 6 });
    if strokes.is_empty() {
        return Ok(Vec::new());
    }
    let kinds = kinds(&scene.settings);
    progress.begin("chart lightning-grid", (kinds.len() * (steps.len() + 1)) as u64);
    let mut points = Vec::new();
    for kind in kinds {
        progress.check()?;
        let (_, direct, basis, codec) = kind;
        let settings = ResponseSettings { direct, basis, codec, ..scene.settings };
        let known = solve_held_out(&scene.cloud, &settings, &strokes, None, &Quiet)?;
        progress.advance(1);
        for (&step, lights) in steps.iter().zip(&grids) {
            progress.check()?;
            progress.advance(1);
            if Candidate::bytes(lights, &strokes, basis, &scene.cloud) <= MOST_BYTES {
                let sources = Sources { lights: lights.clone(), distant: Vec::new(), sun: None };
                points.push(point(&scene, kind, step, &sources, (&strokes, &known))?);
            }
        }
    }
    Ok(points)
}

/// The paper's way, two of ours, and the recipe's own.
fn kinds(own: &ResponseSettings) -> Vec<Kind> {
    let ours = |degree| (DirectTerm::AtRunTime, DirectionalBasis::Harmonics { degree }, own.codec);
    let paper = (DirectTerm::InRows, DirectionalBasis::Directions26, Codec::Paper);
    let mut kinds = vec![
        ("16 coefficients", ours(3)),
        ("4 coefficients", ours(1)),
        ("paper: direct light in 26 directions", paper),
    ];
    let own = (own.direct, own.basis, own.codec);
    if kinds.iter().all(|&(_, kind)| kind != own) {
        kinds.push(("the recipe's basis", own));
    }
    kinds.into_iter().map(|(series, (direct, basis, codec))| (series, direct, basis, codec)).collect()
}

/// One grid's rows in one way, scored by strokes whose truth is `known`.
fn point(
    scene: &ChartScene<'_>,
    (series, direct, basis, codec): Kind,
    step: f64,
    sources: &Sources,
    (strokes, known): (&[Vec<PointLight>], &[HeldOutStroke]),
) -> Result<Point, BakeError> {
    let settings = ResponseSettings { direct, basis, codec, ..scene.settings };
    let error = settings.relative_error;
    let job = Job {
        cloud: &scene.cloud,
        sources,
        settings: &settings,
        held_out: strokes,
        known: Some(known),
        shown: None,
        cache: None,
    };
    let (done, cost) = seconds(1, || -> Result<_, BakeError> {
        let candidate = Candidate::new(&job, &[], &Quiet)?;
        let coded = candidate.encode(basis, codec, error);
        Ok((candidate, coded))
    });
    let (candidate, _) = done?;
    let outcome = candidate.code(basis, codec, error)?;
    let share = candidate.lights as f64 / candidate.rows().max(1) as f64;
    let own = &scene.settings;
    let towards_region = own.view_region.is_some();
    let views = if towards_region { "towards the recipe's view region" } else { "in 26 directions" };
    let count = strokes.len();
    Ok(Point {
        series: series.into(),
        setting: format!("{:.0} m apart, {} virtual lights", scene.spacing_m * step, candidate.lights),
        truth: format!("{}: {count} held-out strokes, each solved directly, {views}", scene.words),
        errors: vec![(L2, outcome.scores.stroke.l2), (MEDIAN, outcome.scores.stroke.median)],
        costs: vec![
            (LIGHTS, Cost::exact(candidate.lights as f64)),
            (BYTES, Cost::exact(outcome.bytes as f64)),
            // Of the rows that the strokes touch, scaled to all.
            (BAKE, cost.times(share)),
        ],
        bytes: Some(outcome.bytes),
        chosen: step == 1.0 && (direct, basis, codec) == (own.direct, own.basis, own.codec),
        baseline: direct == DirectTerm::InRows && codec == Codec::Paper,
    })
}

/// Strokes of the finest grid, with the points alone that all grids light: every grid is compared by the same light.
fn common_strokes(
    site: &Site<'_>,
    spacing_m: f64,
    grids: &[WantedLights],
    count: usize,
) -> Vec<Vec<PointLight>> {
    let Some(finest) = grids.last() else { return Vec::new() };
    let spacing = finest.grid.x_m.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let spacing = if spacing.is_finite() { spacing } else { spacing_m };
    let strokes = site.strokes(finest, spacing, 0..count);
    let common = |stroke: Vec<PointLight>| -> Vec<PointLight> {
        stroke.into_iter().filter(|point| grids.iter().all(|grid| grid.reaches(point.position))).collect()
    };
    strokes.into_iter().map(common).filter(|stroke| !stroke.is_empty()).collect()
}
