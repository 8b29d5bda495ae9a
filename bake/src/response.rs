//! Fills section `CLRT`: the cloud's answer to each virtual lamp, solved, transformed and compressed.
//!
//! Sixteen lamps are solved side by side, batches run in parallel, and what comes out is put together in row order, so that
//! the bytes do not depend on the number of threads. Test strokes that no lamp was chosen for go along: solved directly
//! with the same solver, they say what splitting a stroke over lamps costs; relit from the very bytes that ship, they say
//! what compression costs.

mod context;
pub mod directions;
pub mod evaluate;
pub mod hidden;
pub mod lights;
mod solved;
pub mod view_region;

use crate::compress::{CompressedRow, compress_row};
use crate::error::BakeError;
use crate::progress::Progress;
use context::{Batch, Context, Work};
pub use directions::{add_direct, in_26_directions};
use glam::DVec3;
pub use lights::{LightSpacing, WantedLights, light_grid};
use rayon::prelude::*;
pub use solved::SolvedRows;
use solved::TowardsViewRegion;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{
    Codec, DirectTerm, DirectionalBasis, DistantKind, DistantSource, NO_ROW, ResponseHead, ResponseRows,
    SolverRecord, SourceBasis, pack_seen,
};
use squall_formats::view_region::ViewRegion;
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::{SolveSettings, Solver};
use std::sync::Arc;

/// What polynomials towards eyes are made from.
const SOLVED: DirectionalBasis = DirectionalBasis::Harmonics { degree: 3 };

/// Lamps solved side by side.
pub const BATCH: usize = 16;
/// Batches between two ordered gatherings: enough for many threads, few enough to bound memory.
const BATCHES_AT_ONCE: usize = 16;

/// How to bake a response.
#[derive(Clone, Copy, Debug)]
pub struct ResponseSettings {
    /// Directions, harmonics, or polynomials towards eyes.
    pub channels: DirectionalBasis,
    /// Direct light in the rows or left to the runtime.
    pub direct: DirectTerm,
    /// How coefficients are stored.
    pub codec: Codec,
    /// How far a source may be off, relative to its own L2 norm.
    pub relative_error: f64,
    /// Leave out the light of cells that no ray shades with: [`hidden`].
    pub seen_only: bool,
    /// Where eyes may stand; anywhere where absent. With `seen_only`, cells that none of them sees are left out too.
    pub view_region: Option<ViewRegion>,
    /// Solve cells per stored cell and axis.
    pub refine: u32,
    /// Direct rays per boundary face of the solve grid and axis.
    pub samples: u32,
    /// The sweeps.
    pub solve: SolveSettings,
}

/// What to bake rows for.
#[derive(Clone, Debug, PartialEq)]
pub struct Sources {
    /// Virtual lamps.
    pub lights: WantedLights,
    /// Distant light.
    pub distant: Vec<DistantKind>,
}

/// What a bake of a response made.
pub struct BakedResponse {
    /// The section's head.
    pub head: ResponseHead,
    /// The section's rows.
    pub rows: ResponseRows,
    /// Test strokes, for judging the written bytes.
    pub tests: Vec<TestStroke>,
    /// Coefficients kept, means not counted.
    pub kept: usize,
    /// Sweeps times sixteen lamps.
    pub sweeps: u64,
}

/// A stroke that the lamps were not chosen for, with its truth.
#[derive(Clone, Debug)]
pub struct TestStroke {
    /// The stroke's points.
    pub lights: Vec<PointLight>,
    /// J in the 26 directions, cells outermost: the stroke solved directly, all light.
    pub truth: Vec<f32>,
    /// The direct part of that, which the runtime adds itself with [`DirectTerm::AtRunTime`].
    pub direct: Vec<f32>,
    /// J of direct light, cell means, towards the middle of the eyes' box; empty without eyes. It is what stroke errors towards eyes are
    /// relative to, beside what was scattered: 26 directions are too few to read a narrow phase function between.
    pub direct_to_viewers: Vec<f32>,
    /// Σ e_l b_l from the solved rows before compression, in the response's channels, one plane a channel.
    pub uncompressed: Vec<f32>,
    /// Which cells are judged; all where empty.
    pub seen: Arc<[bool]>,
}

/// Bakes the rows of all wanted nodes, and behind them those of distant light.
///
/// `strokes` are judged, not baked for. Errors: a solve that does not converge, settings out of range, an interruption.
pub fn bake_response(
    cloud: &Cloud,
    sources: &Sources,
    settings: &ResponseSettings,
    strokes: &[Vec<PointLight>],
    progress: &dyn Progress,
) -> Result<BakedResponse, BakeError> {
    let count = settings.channels.count();
    let code = |planes: Vec<f32>| compress_row(&planes, count, settings.codec, settings.relative_error);
    let (mut rows, mut kept) = (ResponseRows::default(), 0);
    let tests = (strokes, None);
    let mut take = |row: CompressedRow| {
        kept += row.kept;
        rows.bounds.extend_from_slice(&row.bounds);
        rows.rows.push(row.bytes);
    };
    let solved = solve_each_row(cloud, sources, settings, tests, progress, (&code, &mut take))?;
    let (head, tests, sweeps) = solved;
    Ok(BakedResponse { head, rows, tests, kept, sweeps })
}

/// [`bake_response`] up to where rows are coded. Takes four bytes a cell, channel and row.
///
/// `known` are `strokes` with their truth where an earlier call solved them: it depends on the cloud and on how light is solved,
/// not on lamps, channels or coding.
pub fn solve_rows(
    cloud: &Cloud,
    sources: &Sources,
    settings: &ResponseSettings,
    strokes: &[Vec<PointLight>],
    known: Option<&[TestStroke]>,
    progress: &dyn Progress,
) -> Result<SolvedRows, BakeError> {
    let mut planes = Vec::new();
    let keep = |planes: Vec<f32>| planes;
    let tests = (strokes, known);
    let solved =
        solve_each_row(cloud, sources, settings, tests, progress, (&keep, &mut |row| planes.push(row)))?;
    let (head, tests, sweeps) = solved;
    let towards = match (settings.channels, &settings.view_region) {
        (SOLVED, Some(view_region)) => Some(TowardsViewRegion::new(cloud, view_region, &head)),
        _ => None,
    };
    Ok(SolvedRows { head, planes, tests, sweeps, towards })
}

/// Strokes with their truth: each solved directly, in the same way as rows are.
///
/// Errors: as [`bake_response`].
pub fn solve_tests(
    cloud: &Cloud,
    settings: &ResponseSettings,
    strokes: &[Vec<PointLight>],
    progress: &dyn Progress,
) -> Result<Vec<TestStroke>, BakeError> {
    let lights = WantedLights {
        grid: LightGrid { x_m: vec![0.0], y_m: vec![0.0], z_m: vec![0.0] },
        wanted: vec![false],
    };
    let sources = Sources { lights, distant: Vec::new() };
    Ok(solve_rows(cloud, &sources, settings, strokes, None, progress)?.tests)
}

/// Solves all rows; each goes through `finish` on the thread that solved it and then, in row order, to `take`.
fn solve_each_row<R: Send>(
    cloud: &Cloud,
    sources: &Sources,
    settings: &ResponseSettings,
    (strokes, known): (&[Vec<PointLight>], Option<&[TestStroke]>),
    progress: &dyn Progress,
    (finish, take): (&(dyn Fn(Vec<f32>) -> R + Sync), &mut dyn FnMut(R)),
) -> Result<(ResponseHead, Vec<TestStroke>, u64), BakeError> {
    let factors = [settings.refine; 3];
    let fine = cloud.refined(factors)?;
    let solver = Solver::<4>::new(&fine, settings.solve)?;
    let context = Context::new(cloud, &fine, &solver, settings);
    // A grid without density has nothing to see for anyone; one with some is not to be hidden from all eyes.
    let hidden = context.hidden.as_ref().is_some_and(|hidden| !hidden.seen().contains(&true));
    if hidden && cloud.extinction.iter().any(|&extinction| extinction > 0.0) {
        return Err(BakeError::NotReached {
            what: "the cloud's response".into(),
            wanted: "cells that an eye can see".into(),
            reached: "none".into(),
            hint: "eyes in [clouds.eyes] that it does not hide from".into(),
        });
    }
    let grid = &sources.lights;
    let nodes: Vec<usize> = (0..grid.len()).filter(|&node| grid.is_wanted(node)).collect();
    let mut node_rows = vec![NO_ROW; grid.len()];
    for (row, &node) in nodes.iter().enumerate() {
        node_rows[node] = row as u32;
    }
    let mut head = ResponseHead {
        shape: cloud.shape,
        sources: SourceBasis::LightGrid { grid: grid.grid.clone(), rows: node_rows },
        distant: (nodes.len()..)
            .zip(&sources.distant)
            .map(|(row, &kind)| DistantSource { kind, row: row as u32 })
            .collect(),
        basis: settings.channels,
        direct: settings.direct,
        codec: settings.codec,
        solver: SolverRecord {
            refine: factors,
            directions: directions_record(settings.solve.quadrature),
            scheme: settings.solve.scheme,
            extinction_scale: solver.scaled().extinction_scale,
            tolerance: settings.solve.tolerance,
            worst_residual: 0.0,
            most_sweeps: 0,
        },
        view_region: settings.view_region,
        seen: context.hidden.as_ref().map(|hidden| pack_seen(hidden.seen())),
    };
    let weights: Vec<Vec<(u32, f32)>> = strokes.iter().map(|lights| split_stroke(&head, lights)).collect();

    let mut tests = match known {
        Some(known) => known.to_vec(),
        None => {
            progress.begin("test strokes", strokes.len() as u64);
            context.solve_strokes(strokes, progress)?
        }
    };

    // Lamps first, then distant light, in batches of their own: only the latter always keep their direct light.
    let light = |&node: &usize| vec![Light::Point { position: grid.position(node), intensity: 1.0 }];
    let lights: Vec<Vec<Light>> = nodes.iter().map(light).collect();
    let distant: Vec<Vec<Light>> =
        sources.distant.iter().map(|&kind| distant_lights(kind)).collect::<Result<_, _>>()?;
    progress.begin("cloud response", (lights.len() + distant.len()) as u64);
    let (mut row_number, mut sweeps) = (0u32, 0u64);
    let mut batches: Vec<(u32, &[Vec<Light>], bool)> = Vec::new();
    for (lights, first, in_rows) in [(&lights, 0, context.in_rows()), (&distant, lights.len(), true)] {
        batches.extend(
            lights.chunks(BATCH).enumerate().map(|(i, part)| ((first + i * BATCH) as u32, part, in_rows)),
        );
    }
    for group in batches.chunks(BATCHES_AT_ONCE) {
        let solved: Vec<Result<Batch<R>, BakeError>> = group
            .par_iter()
            .map_init(Work::default, |work, &(first, lights, in_rows)| {
                progress.check()?;
                let needed = |row: u32| weights.iter().any(|list| list.iter().any(|&(r, _)| r == row));
                let needed = |lane: usize| needed(first + lane as u32);
                let done = context.solve_batch(lights, in_rows, needed, finish, work);
                progress.advance(lights.len() as u64);
                done
            })
            .collect();
        for batch in solved {
            let batch = batch?;
            head.solver.most_sweeps = head.solver.most_sweeps.max(batch.report.sweeps);
            sweeps += u64::from(batch.report.sweeps);
            for lane in &batch.report.lanes {
                head.solver.worst_residual = head.solver.worst_residual.max(lane.residual);
            }
            for (row, values) in batch.rows {
                if let Some(values) = values {
                    add_to_tests(&mut tests, &weights, row_number, &values);
                }
                row_number += 1;
                take(row);
            }
        }
    }
    Ok((head, tests, sweeps))
}

/// Beams that together are distant light of unit strength: for a hemisphere, one a direction of a fine set.
fn distant_lights(kind: DistantKind) -> Result<Vec<Light>, BakeError> {
    let downward = match kind {
        DistantKind::Beam { direction } => {
            return Ok(vec![Light::Beam { direction: DVec3::from_array(direction), irradiance: 1.0 }]);
        }
        DistantKind::UpperSky => true,
        DistantKind::LowerSky => false,
    };
    let set = Quadrature::DoubleGauss { polar: 3, azimuths: 12 }.ordinates()?;
    let mine = set.iter().filter(|o| (o.direction[2] < 0.0) == downward);
    Ok(mine
        .map(|o| Light::Beam {
            direction: DVec3::from_array(o.direction),
            irradiance: 4.0 * std::f64::consts::PI * o.weight,
        })
        .collect())
}

/// How [`SolverRecord`] writes a direction set down.
pub fn directions_record(set: Quadrature) -> [u8; 2] {
    match set {
        Quadrature::Lebedev14 => [0, 14],
        Quadrature::Lebedev26 => [0, 26],
        Quadrature::Lebedev50 => [0, 50],
        Quadrature::DoubleGauss { polar, azimuths } => [polar, azimuths],
    }
}

fn add_to_tests(tests: &mut [TestStroke], weights: &[Vec<(u32, f32)>], row: u32, values: &[f32]) {
    for (test, weights) in tests.iter_mut().zip(weights) {
        if let Some(&(_, weight)) = weights.iter().find(|(r, _)| *r == row) {
            test.uncompressed.resize(values.len(), 0.0);
            for (sum, value) in test.uncompressed.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
    }
}

/// The weights that the runtime will give the stroke; none for a stroke that leaves the grid.
fn split_stroke(head: &ResponseHead, lights: &[PointLight]) -> Vec<(u32, f32)> {
    squall_runtime::relight::split_lights(head, lights)
        .map(|weights| weights.iter().map(|w| (w.row, w.intensity)).collect())
        .unwrap_or_default()
}
