//! Fills section `CLRT`: the cloud's answer to each virtual light, solved, transformed and compressed.
//!
//! Sixteen lights are solved side by side, batches run in parallel, and what comes out is put together in row order, so that
//! the bytes do not depend on the number of threads. Held-out strokes, which no virtual light was chosen for, go along: solved
//! directly with the same solver, they say what splitting a stroke over virtual lights costs; relit from the very bytes that ship,
//! they say what compression costs.

mod batch;
pub mod directions;
pub mod grid;
pub mod hidden;
mod job;
pub mod region;
mod schedule;
mod solved;
pub mod visibility;

use crate::compress::{CompressedRow, compress_row};
use crate::error::BakeError;
use crate::progress::Progress;
pub use crate::recipe::model::ResponseSettings;
use batch::{Batch, RowSolver, SOLVED, Work};
pub use directions::{add_direct, in_26_directions};
pub use grid::{LightGrid, LightSpacing, light_grid};
pub use job::{BakedResponse, HeldOutStroke, Job, Sources};
use rayon::prelude::*;
pub use schedule::BATCH;
use schedule::{Part, parts, planned_head};
pub use solved::SolvedRows;
use solved::TowardsViewRegion;
use squall_formats::section::response::{ResponseHead, ResponseRows};
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::solve::Solver;

/// Batches between two ordered gatherings: enough for many threads, few enough to bound memory.
const BATCHES_AT_ONCE: usize = 16;

/// Bakes the rows of all wanted nodes, and behind them those of distant light.
///
/// Errors: a solve that does not converge, settings out of range, a view region that sees nothing, an interruption.
pub fn bake_response(job: &Job<'_>, progress: &dyn Progress) -> Result<BakedResponse, BakeError> {
    let settings = job.settings;
    let count = settings.channels.count();
    let code = |planes: Vec<f32>| compress_row(&planes, count, settings.codec, settings.relative_error);
    let (mut rows, mut kept) = (ResponseRows::default(), 0);
    let mut take = |row: CompressedRow| {
        kept += row.kept;
        rows.bounds.extend_from_slice(&row.bounds);
        rows.rows.push(row.bytes);
    };
    let Gathered { head, held_out, sweeps } = solve_each_row(job, &code, &mut take, progress)?;
    Ok(BakedResponse { head, rows, held_out, kept, sweeps })
}

/// [`bake_response`] up to where rows are coded. Takes four bytes a cell, coefficient and row.
///
/// Errors: as [`bake_response`].
pub fn solve_rows(job: &Job<'_>, progress: &dyn Progress) -> Result<SolvedRows, BakeError> {
    let mut planes = Vec::new();
    let keep = |planes: Vec<f32>| planes;
    let Gathered { head, held_out, sweeps } =
        solve_each_row(job, &keep, &mut |row| planes.push(row), progress)?;
    let towards = match (job.settings.channels, &job.settings.view_region) {
        (SOLVED, Some(view_region)) => Some(TowardsViewRegion::new(job.cloud, view_region, &head)),
        _ => None,
    };
    Ok(SolvedRows { head, planes, held_out, sweeps, towards })
}

/// Strokes with their truth: each solved directly, in the same way as rows are.
///
/// Errors: as [`bake_response`].
pub fn solve_held_out(
    cloud: &Cloud,
    settings: &ResponseSettings,
    held_out: &[Vec<PointLight>],
    progress: &dyn Progress,
) -> Result<Vec<HeldOutStroke>, BakeError> {
    let lights = LightGrid { x_m: vec![0.0], y_m: vec![0.0], z_m: vec![0.0], wanted: vec![false] };
    let sources = Sources { lights, distant: Vec::new() };
    let job = Job { cloud, sources: &sources, settings, held_out, known: None };
    Ok(solve_rows(&job, progress)?.held_out)
}

/// What all rows of a job leave behind beside themselves.
struct Gathered {
    head: ResponseHead,
    held_out: Vec<HeldOutStroke>,
    sweeps: u64,
}

/// Solves all rows; each goes through `finish` on the thread that solved it and then, in row order, to `take`.
fn solve_each_row<R: Send>(
    job: &Job<'_>,
    finish: &(dyn Fn(Vec<f32>) -> R + Sync),
    take: &mut dyn FnMut(R),
    progress: &dyn Progress,
) -> Result<Gathered, BakeError> {
    let fine = job.cloud.refined([job.settings.refine; 3])?;
    let solver = Solver::<4>::new(&fine, job.settings.solve)?;
    let rows = RowSolver::new(job.cloud, &fine, &solver, job.settings);
    rows.check_visible()?;
    let head = planned_head(job, solver.scaled().extinction_scale, rows.seen());
    let weights = job.held_out.iter().map(|lights| split_stroke(&head, lights)).collect();
    let held_out = match job.known {
        Some(known) => known.to_vec(),
        None => {
            progress.begin("held-out strokes", job.held_out.len() as u64);
            rows.solve_strokes(job.held_out, progress)?
        }
    };
    let parts = parts(job.sources, rows.in_rows())?;
    progress.begin("cloud response", parts.iter().map(|part| part.lights.len() as u64).sum());
    let mut gathering = Gathering { head, held_out, weights, row: 0, sweeps: 0 };
    for group in parts.chunks(BATCHES_AT_ONCE) {
        for batch in solve_group(&rows, group, &gathering.weights, finish, progress) {
            gathering.add(batch?, take);
        }
    }
    let Gathering { head, held_out, sweeps, .. } = gathering;
    Ok(Gathered { head, held_out, sweeps })
}

/// Rows and weights of one stroke.
type Weights = Vec<(u32, f32)>;

/// Solves some batches in parallel; they come back in their own order.
fn solve_group<R: Send>(
    rows: &RowSolver<'_>,
    group: &[Part],
    weights: &[Weights],
    finish: &(dyn Fn(Vec<f32>) -> R + Sync),
    progress: &dyn Progress,
) -> Vec<Result<Batch<R>, BakeError>> {
    group
        .par_iter()
        .map_init(Work::default, |work, part| {
            progress.check()?;
            let needed = |row: u32| weights.iter().any(|list| list.iter().any(|&(r, _)| r == row));
            let needed = |lane: usize| needed(part.first + lane as u32);
            let done = rows.solve_batch(&part.lights, part.in_rows, needed, finish, work);
            progress.advance(part.lights.len() as u64);
            done
        })
        .collect()
}

/// Batches put together in row order.
struct Gathering {
    head: ResponseHead,
    held_out: Vec<HeldOutStroke>,
    /// Those of the held-out strokes.
    weights: Vec<Weights>,
    /// The next row.
    row: u32,
    sweeps: u64,
}

impl Gathering {
    fn add<R>(&mut self, batch: Batch<R>, take: &mut dyn FnMut(R)) {
        let record = &mut self.head.solver;
        record.most_sweeps = record.most_sweeps.max(batch.report.sweeps);
        self.sweeps += u64::from(batch.report.sweeps);
        for lane in &batch.report.lanes {
            record.worst_residual = record.worst_residual.max(lane.residual);
        }
        for (row, values) in batch.rows {
            if let Some(values) = values {
                self.add_to_strokes(&values);
            }
            self.row += 1;
            take(row);
        }
    }

    /// Adds the present row's light to the strokes that are split over it.
    fn add_to_strokes(&mut self, values: &[f32]) {
        for (stroke, weights) in self.held_out.iter_mut().zip(&self.weights) {
            if let Some(&(_, weight)) = weights.iter().find(|(row, _)| *row == self.row) {
                stroke.uncompressed.resize(values.len(), 0.0);
                for (sum, value) in stroke.uncompressed.iter_mut().zip(values) {
                    *sum += weight * value;
                }
            }
        }
    }
}

/// The weights that the runtime will give the stroke; none for a stroke that leaves the grid.
fn split_stroke(head: &ResponseHead, lights: &[PointLight]) -> Weights {
    squall_runtime::relight::split_lights(head, lights)
        .map(|weights| weights.iter().map(|w| (w.row, w.intensity)).collect())
        .unwrap_or_default()
}
