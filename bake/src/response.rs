//! Fills section `CLRT`: the cloud's answer to each virtual light, solved, transformed and compressed.
//!
//! Sixteen lights are solved side by side, batches run in parallel, and what comes out is put together in row order, so that
//! the bytes do not depend on the number of threads. Held-out strokes, which no virtual light was chosen for, go along: solved
//! directly with the same solver, they say what splitting a stroke over virtual lights costs; relit from the very bytes that ship,
//! they say what compression costs.

mod batch;
pub mod cache;
pub mod directions;
mod finer;
pub mod grid;
pub mod hidden;
mod job;
mod nodes;
pub mod region;
mod schedule;
mod solved;
pub mod visibility;

use crate::compress::{CompressedRow, compress_weighted_row};
use crate::error::BakeError;
use crate::progress::Progress;
pub use crate::recipe::model::ResponseSettings;
use batch::{Finish, Row, RowSolver, SOLVED, Wanted, Work};
use cache::ResponseCache;
pub use directions::{add_direct, in_26_directions};
use finer::{Baked, bake_finer};
pub use grid::{LightSpacing, WantedLights, light_grid};
use job::SolveCells;
pub use job::{BakedResponse, HeldOutStroke, Job, Sources};
use rayon::prelude::*;
pub use schedule::BATCH;
use schedule::{Part, parts, planned_head};
pub use solved::SolvedRows;
use solved::TowardsViewRegion;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{ResponseHead, ResponseRows};
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::solve::{Solver, sweeps_together};

/// Batches between two ordered gatherings: enough for many threads, few enough to bound memory.
const BATCHES_AT_ONCE: usize = 16;

/// Bakes the rows of all wanted nodes, and behind them those of distant light.
///
/// Errors: a solve that does not converge, settings out of range, a view region that sees nothing, an interruption.
pub fn bake_response(job: &Job<'_>, progress: &dyn Progress) -> Result<BakedResponse, BakeError> {
    let settings = job.settings;
    let count = settings.basis.count();
    let weights = job.plane_weights();
    let code = |planes: Vec<f32>| {
        compress_weighted_row(&planes, &weights, count, settings.codec, settings.relative_error)
    };
    let (mut rows, mut kept, mut thresholds) = (ResponseRows::default(), 0, Vec::new());
    let mut take = |row: CompressedRow| {
        kept += row.kept;
        thresholds.push(row.threshold);
        rows.bounds.extend_from_slice(&row.bounds);
        rows.rows.push(row.bytes);
    };
    let Gathered { mut head, mut held_out, sweeps } = solve_each_row(job, &code, &mut take, progress)?;
    // Those of virtual lights, which stand in front.
    thresholds.truncate(job.sources.lights.wanted_count());
    thresholds.sort_unstable_by(f32::total_cmp);
    let threshold = thresholds.get(thresholds.len() / 2).copied().unwrap_or_default();
    let mut baked = Baked { head: &mut head, rows: &mut rows, held_out: &mut held_out, kept, sweeps };
    bake_finer(job, threshold, &mut baked, progress)?;
    let Baked { kept, sweeps, .. } = baked;
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
    let towards = match (job.settings.basis, &job.settings.view_region) {
        (SOLVED, Some(view_region)) => Some(TowardsViewRegion::new(job.cloud, view_region, &head)),
        _ => None,
    };
    let weights = job.plane_weights();
    Ok(SolvedRows { head, planes, held_out, sweeps, weights, towards })
}

/// Strokes with their truth: each solved directly, in the same way as rows are.
///
/// Errors: as [`bake_response`].
pub fn solve_held_out(
    cloud: &Cloud,
    settings: &ResponseSettings,
    held_out: &[Vec<PointLight>],
    cache: Option<&ResponseCache>,
    progress: &dyn Progress,
) -> Result<Vec<HeldOutStroke>, BakeError> {
    let grid = LightGrid { x_m: vec![0.0], y_m: vec![0.0], z_m: vec![0.0] };
    let lights = WantedLights { grid, wanted: vec![false] };
    let sources = Sources { lights, distant: Vec::new(), sun: None };
    let job = Job { cloud, sources: &sources, settings, held_out, known: None, shown: None, cache };
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
    let cells = SolveCells::new(job)?;
    let mut solver = Solver::<4>::new(&cells.fine, job.settings.solve)?;
    if job.settings.seen_only {
        // Light is stored where rays shade at most: sweeps step over the air around.
        solver = solver.read_in(&cells.fine, &cells.read);
    }
    let rows = RowSolver::new(job, &cells, &solver);
    rows.check_visible()?;
    let head = planned_head((job, &cells), solver.scaled().extinction_scale, rows.seen());
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
        let needed = |row: u32| gathering.weights.iter().any(|list| list.iter().any(|&(r, _)| r == row));
        let group = solve_group(&rows, group, &Finish { needed: &needed, code: finish }, progress)?;
        group.into_iter().for_each(|part| gathering.add(part, take));
    }
    let Gathering { head, held_out, sweeps, .. } = gathering;
    Ok(Gathered { head, held_out, sweeps })
}

/// Rows and weights of one stroke.
type Weights = Vec<(u32, f32)>;

/// Finds or solves the rows of some batches in parallel; they come back in their own order.
fn solve_group<R: Send>(
    rows: &RowSolver<'_>,
    group: &[Part],
    finish: &Finish<'_, R>,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Row<R>>>, BakeError> {
    let wanted = |part: &Part| -> Vec<(u32, Vec<Light>, bool)> {
        let numbered = (part.first..).zip(part.lights.clone());
        numbered.map(|(number, lights)| (number, lights, part.in_rows)).collect()
    };
    let all: Vec<_> = group.iter().flat_map(wanted).collect();
    let found: Vec<Option<Row<R>>> = all
        .par_iter()
        .map_init(Vec::new, |scratch, (number, lights, in_rows)| {
            let row = rows.kept((*number, lights.as_slice()), *in_rows, finish, scratch);
            progress.advance(u64::from(row.is_some()));
            row
        })
        .collect();
    // What is missing is solved in full batches, wherever it stands.
    let mut batches: Vec<(Vec<Wanted<'_>>, bool)> = Vec::new();
    for ((number, lights, in_rows), _) in all.iter().zip(&found).filter(|(_, found)| found.is_none()) {
        match batches.last_mut() {
            Some((batch, kind)) if kind == in_rows && batch.len() < BATCH => batch.push((*number, lights)),
            _ => batches.push((vec![(*number, lights)], *in_rows)),
        }
    }
    let solved: Vec<Result<Vec<Row<R>>, BakeError>> = batches
        .par_iter()
        .map_init(Work::default, |work, (batch, in_rows)| {
            progress.check()?;
            let done = rows.solve_batch(batch, *in_rows, finish, work);
            progress.advance(batch.len() as u64);
            done
        })
        .collect();
    let mut done: Vec<Row<R>> = found.into_iter().flatten().collect();
    for batch in solved {
        done.extend(batch?);
    }
    done.sort_by_key(|row| row.number);
    let (mut done, mut parts) = (done.into_iter(), Vec::with_capacity(group.len()));
    for part in group {
        let mut batch: Vec<Row<R>> = done.by_ref().take(part.lights.len()).collect();
        if !rows.is_away_from_bound(sweeps_of(&batch)) {
            // Neighbours matter: these have to be solved with their own.
            let wanted: Vec<Wanted<'_>> = (part.first..).zip(part.lights.iter().map(Vec::as_slice)).collect();
            batch = rows.solve_batch(&wanted, part.in_rows, finish, &mut Work::default())?;
        }
        parts.push(batch);
    }
    Ok(parts)
}

/// Sweeps that these rows take when they are solved side by side.
fn sweeps_of<R>(batch: &[Row<R>]) -> u32 {
    sweeps_together(batch.iter().map(|row| row.steps.as_slice()))
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
    fn add<R>(&mut self, batch: Vec<Row<R>>, take: &mut dyn FnMut(R)) {
        let record = &mut self.head.solver;
        // As if all of them had been solved now.
        let sweeps = sweeps_of(&batch);
        record.most_sweeps = record.most_sweeps.max(sweeps);
        self.sweeps += u64::from(sweeps);
        for Row { value, uncoded, residual, .. } in batch {
            let record = &mut self.head.solver;
            record.worst_residual = record.worst_residual.max(residual);
            if let Some(values) = uncoded {
                self.add_to_strokes(&values);
            }
            self.row += 1;
            take(value);
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

#[cfg(test)]
mod test_scene {
    use glam::DVec3;
    use squall_formats::GridShape;
    use squall_formats::view_region::ViewRegion;
    use squall_runtime::transport::{Boundary, Cloud};

    pub const VIEWPOINTS: ViewRegion =
        ViewRegion { low_m: [-150.0, -150.0, 0.0], high_m: [150.0, 150.0, 60.0] };

    /// A cloud a kilometre north of [`VIEWPOINTS`], with this extinction, 1/m, in each cell.
    pub fn cloud(extinction: impl Fn([usize; 3]) -> f32) -> Cloud {
        let shape = GridShape::new(12, 20, 9);
        let (cell_m, origin_m) = ([50.0, 60.0, 40.0], DVec3::new(-250.0, 900.0, 300.0));
        let extinction = (0..shape.len()).map(|cell| extinction(shape.cell(cell))).collect();
        Cloud { shape, cell_m, origin_m, extinction, albedo: 0.99, g: 0.85, boundary: Boundary::Open }
    }
}
