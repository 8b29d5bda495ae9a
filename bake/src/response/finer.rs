//! Rows of finer virtual lights: each the answer to a light less what coarser ones have for it, solved in a window of cells.
//!
//! Within a window nothing is known of the cloud around it: walls are empty space. Direct light is exact even so, because it goes straight
//! from lights in the window; what is scattered back from beyond is missing, and little for light whose intensities sum to
//! nothing. Memory: per thread some sixty values a cell of the largest window and light of a batch, and the coded rows.

use super::hidden::HiddenCells;
use super::job::{HeldOutStroke, Job, SolveCells};
use super::nodes::{Batch, Levels, batches, reach_m};
use crate::compress::{CompressedRow, PlaneWeights, compress_row_at};
use crate::error::BakeError;
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::GridShape;
use squall_formats::haar::Haar;
use squall_formats::light_grid::LightGrid;
use squall_formats::section::response::{
    DirectTerm, DirectionalBasis, FinerLevel, NO_ROW, ResponseHead, ResponseRows, Window,
};
use squall_formats::sphere::degree_of;
use squall_runtime::transport::cloud::CoarseIndex;
use squall_runtime::transport::direct::{DirectMoments, Light, NearCloud, Tracer, distances};
use squall_runtime::transport::fit::FitWindow;
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::solve::{GATHERED, SolveBuffers, Solver};
use squall_runtime::transport::{Boundary, Cloud};
use std::collections::BTreeMap;

/// Batches between two ordered gatherings.
const BATCHES_AT_ONCE: usize = 32;

/// What a level's rows are added to.
pub(super) struct Baked<'a> {
    pub(super) head: &'a mut ResponseHead,
    pub(super) rows: &'a mut ResponseRows,
    pub(super) held_out: &'a mut [HeldOutStroke],
    /// Coefficients kept.
    pub(super) kept: usize,
    /// Sweeps times sixteen lights.
    pub(super) sweeps: u64,
}

/// A batch's rows: of the nodes that have any light worth keeping.
struct Done {
    window: Window,
    nodes: Vec<u32>,
    rows: Vec<CompressedRow>,
    /// Planes of cells of nodes that a held-out stroke is split over, with their nodes.
    uncoded: Vec<(u32, Vec<f32>)>,
    residual: f64,
    sweeps: u32,
}

/// Bakes the job's finer levels behind the rows that there are. `threshold` is that of a row in all cells; it doubles with every level,
/// since a light is split over twice as many of them with half the share each.
///
/// Errors: as [`super::bake_response`].
pub(super) fn bake_finer(
    job: &Job<'_>,
    threshold: f32,
    baked: &mut Baked<'_>,
    progress: &dyn Progress,
) -> Result<(), BakeError> {
    if job.settings.finer == 0 {
        return Ok(());
    }
    check(job)?;
    let Some((grid, node_rows)) = baked.head.sources.light_grid() else { return Ok(()) };
    let with_rows = node_rows.iter().enumerate().filter(|(_, row)| **row != NO_ROW).map(|(node, _)| node);
    let mut levels = Levels::new(grid, with_rows);
    let cells = SolveCells::new(job)?;
    for level in 1..=job.settings.finer {
        let (grid, nodes) = levels.next(job.cloud);
        let spacing_m = job.settings.spacing_m / f64::from(1u32 << level);
        let batches = batches(&levels, job.cloud, (&grid, &nodes), reach_m(job.cloud, spacing_m));
        progress.begin(&format!("virtual lights {spacing_m:.0} m apart"), nodes.len() as u64);
        let level_threshold = threshold * (1u32 << level) as f32;
        let one = Level::new((job, &cells), &grid, level_threshold, baked)?;
        let mut finer = FinerLevel {
            first_row: baked.rows.rows.len() as u32,
            grid: grid.clone(),
            windows: Vec::new(),
            nodes: Vec::new(),
        };
        for group in batches.chunks(BATCHES_AT_ONCE) {
            let done: Vec<Result<Done, BakeError>> = group
                .par_iter()
                .map_init(Work::default, |work, batch| {
                    progress.check()?;
                    let done = one.solve(batch, work)?;
                    progress.advance(batch.nodes.len() as u64);
                    Ok(done)
                })
                .collect();
            for done in done {
                one.take(done?, &mut finer, baked);
            }
        }
        levels.push(grid, finer.nodes.iter().map(|&node| node as usize));
        if !finer.nodes.is_empty() {
            baked.head.finer.push(finer);
        }
    }
    Ok(())
}

/// Refuses what finer levels cannot be solved for.
fn check(job: &Job<'_>) -> Result<(), BakeError> {
    let refused = |wanted: &str, reached: String| {
        let (wanted, hint) = (wanted.to_owned(), "levels = 0 bakes the light grid alone".to_owned());
        Err(BakeError::NotReached { what: "clouds.lightning.levels".into(), wanted, reached, hint })
    };
    if job.cloud.boundary == Boundary::PeriodicXy {
        return refused(
            "a cloud with air around it: surplus light is solved for in windows",
            "one that repeats".into(),
        );
    }
    match (job.settings.basis, job.settings.direct) {
        (DirectionalBasis::Harmonics { .. }, DirectTerm::AtRunTime) => Ok(()),
        (basis, direct) => refused("harmonics without direct light", format!("{}, {direct:?}", basis.name())),
    }
}

/// What the batches of one level have in common.
struct Level<'a> {
    job: &'a Job<'a>,
    cells: &'a SolveCells,
    seen: Option<Vec<bool>>,
    threshold: f32,
    weights: PlaneWeights,
    /// Of each held-out stroke the share of each node.
    shares: Vec<BTreeMap<u32, f32>>,
}

/// Memory of a thread.
#[derive(Default)]
struct Work {
    sources: Vec<[F32x16; 4]>,
    gathered: Vec<[F32x16; GATHERED]>,
    buffers: SolveBuffers<F32x16, 4>,
    scratch: Vec<f32>,
}

impl<'a> Level<'a> {
    fn new(
        (job, cells): (&'a Job<'a>, &'a SolveCells),
        grid: &LightGrid,
        threshold: f32,
        baked: &Baked<'_>,
    ) -> Result<Self, BakeError> {
        let shares = |stroke: &HeldOutStroke| {
            let mut shares = BTreeMap::new();
            for light in stroke.lights.iter().filter(|_| !stroke.uncompressed.is_empty()) {
                for (node, share) in grid.split(light.position.to_array()).into_iter().flatten() {
                    if share > 0.0 {
                        *shares.entry(node as u32).or_default() += (share * light.intensity) as f32;
                    }
                }
            }
            shares
        };
        let head = &*baked.head;
        Ok(Self {
            job,
            cells,
            seen: head.seen.as_ref().map(|_| (0..head.shape.len()).map(|cell| head.sees(cell)).collect()),
            threshold,
            weights: job.plane_weights(),
            shares: baked.held_out.iter().map(shares).collect(),
        })
    }

    /// The window's cells of values of a grid of `factors` cells to a stored one.
    fn cut<T: Copy>(&self, window: &Window, factors: [u32; 3], values: &[T]) -> Vec<T> {
        let many = |count: usize, axis: usize| count * factors[axis] as usize;
        let [sx, sy, _] = self.job.cloud.shape.to_array();
        let shape = [many(sx, 0), many(sy, 1)];
        let [low_x, low_y, low_z] = [0, 1, 2].map(|axis| many(window.low[axis] as usize, axis));
        let [nx, ny, nz] = [0, 1, 2].map(|axis| many(window.shape.to_array()[axis], axis));
        let row = |(z, y): (usize, usize)| {
            let start = low_x + shape[0] * (low_y + y + shape[1] * (low_z + z));
            &values[start..start + nx]
        };
        (0..nz).flat_map(|z| (0..ny).map(move |y| (z, y))).flat_map(row).copied().collect()
    }

    /// The solve cells of a window.
    fn fine_in(&self, window: &Window) -> Cloud {
        let (cloud, SolveCells { fine, factors, .. }) = (self.job.cloud, self.cells);
        let corner = [0, 1, 2].map(|axis: usize| f64::from(window.low[axis]) * cloud.cell_m[axis]);
        let [nx, ny, nz] = [0, 1, 2].map(|axis: usize| window.shape.to_array()[axis] as u32 * factors[axis]);
        Cloud {
            shape: GridShape::new(nx, ny, nz),
            cell_m: fine.cell_m,
            origin_m: cloud.origin_m + DVec3::from_array(corner),
            extinction: self.cut(window, *factors, &fine.extinction),
            albedo: fine.albedo,
            g: fine.g,
            boundary: fine.boundary,
        }
    }

    fn solve(&self, batch: &Batch, work: &mut Work) -> Result<Done, BakeError> {
        let (settings, window) = (self.job.settings, &batch.window);
        let fine = self.fine_in(window);
        let seen = self.seen.as_ref().map(|seen| self.cut(window, [1; 3], seen));
        let mut solver = Solver::<4>::new(&fine, settings.solve)?;
        if let Some(seen) = &seen {
            let parent = CoarseIndex::new(fine.shape, self.cells.factors);
            let mut read = self.cut(window, self.cells.factors, &self.cells.read);
            read.iter_mut().enumerate().for_each(|(cell, read)| *read &= seen[parent.of(cell)]);
            solver = solver.read_in(&fine, &read);
        }
        let fit = self.cells.fit.as_ref().map(|fit| {
            let low = window.low.map(|cell| cell as usize);
            fit.within(low, window.shape)
        });
        self.trace(&fine, solver.scaled().extinction_scale, batch, work);
        let report = solver.solve(&work.sources, &mut work.gathered, &mut work.buffers, None);
        if let Some(at) = report.lanes.iter().position(|lane| !lane.converged) {
            return Err(BakeError::NotReached {
                what: format!("transport of surplus light at {:?}", batch.lamps.get(at)),
                wanted: format!("residual {:e}", settings.solve.tolerance),
                reached: format!("{:e} after {} sweeps", report.lanes[at].residual, report.sweeps),
                hint: "a larger tolerance or more sweeps help".into(),
            });
        }
        let hidden = seen.and_then(|seen| HiddenCells::of(window.shape, seen));
        let haar = Haar::new(window.shape);
        let mut done = Done {
            window: Window { rows: 0, ..*window },
            nodes: Vec::new(),
            rows: Vec::new(),
            uncoded: Vec::new(),
            residual: report.lanes.iter().map(|lane| lane.residual).fold(0.0, f64::max),
            sweeps: report.sweeps,
        };
        for (lane, &node) in batch.nodes.iter().enumerate() {
            let mut planes = self.planes(lane, &fine, fit.as_ref(), work);
            let grids = |planes: &mut Vec<f32>, each: &mut dyn FnMut(&mut [f32])| {
                planes.chunks_exact_mut(window.shape.len()).for_each(each);
            };
            if let Some(hidden) = &hidden {
                grids(&mut planes, &mut |plane| hidden.fill(plane));
            }
            let node = node as u32;
            if self.shares.iter().any(|shares| shares.contains_key(&node)) {
                done.uncoded.push((node, planes.clone()));
            }
            grids(&mut planes, &mut |plane| haar.forward(plane, &mut work.scratch));
            let (count, codec) = (settings.basis.count(), settings.codec);
            let row = compress_row_at(&planes, &self.weights, count, codec, self.threshold);
            if row.kept > 0 {
                done.nodes.push(node);
                done.rows.push(row);
            }
        }
        done.window.rows = done.nodes.len() as u32;
        Ok(done)
    }

    /// Follows every light of the batch once, and gives each lane its share.
    fn trace(&self, fine: &Cloud, extinction_scale: f64, batch: &Batch, work: &mut Work) {
        let mut lanes: BTreeMap<[u64; 3], Vec<(usize, f32)>> = BTreeMap::new();
        for (lane, lamps) in batch.lamps.iter().enumerate() {
            for (place, intensity) in lamps {
                let bits = place.to_array().map(f64::to_bits);
                lanes.entry(bits).or_default().push((lane, *intensity as f32));
            }
        }
        let tracer = Tracer::new(fine, extinction_scale);
        let steps = distances(fine.shape, fine.extinction.iter().map(|&extinction| extinction > 0.0));
        let near = NearCloud { distances: &steps, around: 0, least: super::batch::LEAST };
        let mut field = DirectMoments::<4>::new(fine.shape.len());
        let volume = 1.0 / fine.cell_volume() as f32;
        work.sources.clear();
        work.sources.resize(fine.shape.len(), [F32x16::splat(0.0); 4]);
        for (bits, lanes) in lanes {
            field.clear();
            let light =
                Light::Point { position: DVec3::from_array(bits.map(f64::from_bits)), intensity: 1.0 };
            tracer.add_moments(light, self.job.settings.samples, &near, &mut field);
            let mut factors = [0.0f32; 16];
            lanes.into_iter().for_each(|(lane, share)| factors[lane] += share * volume);
            // Light in empty cells is scattered by nothing.
            let cells = work.sources.iter_mut().zip(&field.moments).zip(&fine.extinction);
            for ((sums, moments), _) in cells.filter(|(_, extinction)| **extinction > 0.0) {
                for m in 0..4 {
                    for (sum, factor) in sums[m].0.iter_mut().zip(&factors) {
                        *sum += moments[m] * factor;
                    }
                }
            }
        }
    }

    /// One lane's coefficients, one plane of the window's cells each.
    fn planes(&self, lane: usize, fine: &Cloud, fit: Option<&FitWindow<'_>>, work: &Work) -> Vec<f32> {
        let (count, g) = (self.job.settings.basis.count(), fine.g);
        let powers = [1.0, g, g * g, g * g * g];
        let mut values = Vec::with_capacity(work.gathered.len() * count);
        for moments in &work.gathered {
            values.extend((0..count).map(|m| moments[m].lane(lane) * powers[degree_of(m)] as f32));
        }
        let means = match fit {
            Some(fit) => fit.fit(&values, count),
            None => CoarseIndex::new(fine.shape, self.cells.factors).means(&values, count),
        };
        let cells = means.len() / count;
        let mut planes = vec![0.0; means.len()];
        for (cell, row) in means.chunks_exact(count).enumerate() {
            for (plane, value) in row.iter().enumerate() {
                planes[plane * cells + cell] = *value;
            }
        }
        planes
    }

    fn take(&self, done: Done, finer: &mut FinerLevel, baked: &mut Baked<'_>) {
        let record = &mut baked.head.solver;
        record.worst_residual = record.worst_residual.max(done.residual);
        record.most_sweeps = record.most_sweeps.max(done.sweeps);
        baked.sweeps += u64::from(done.sweeps);
        for (node, planes) in &done.uncoded {
            for (stroke, shares) in baked.held_out.iter_mut().zip(&self.shares) {
                if let Some(&share) = shares.get(node) {
                    self.add(&done.window, planes, share, &mut stroke.uncompressed);
                }
            }
        }
        if done.nodes.is_empty() {
            return;
        }
        finer.windows.push(done.window);
        finer.nodes.extend(done.nodes);
        for row in done.rows {
            baked.kept += row.kept;
            baked.rows.bounds.extend_from_slice(&row.bounds);
            baked.rows.rows.push(row.bytes);
        }
    }

    /// Adds planes of a window to planes of the grid.
    fn add(&self, window: &Window, planes: &[f32], share: f32, sums: &mut [f32]) {
        let shape = self.job.cloud.shape;
        let [low_x, low_y, low_z] = window.low.map(|cell| cell as usize);
        let [nx, ny, _] = window.shape.to_array();
        let grids = sums.chunks_exact_mut(shape.len()).zip(planes.chunks_exact(window.shape.len()));
        for (sums, plane) in grids {
            for (row, values) in plane.chunks_exact(nx).enumerate() {
                let start = shape.index(low_x, low_y + row % ny, low_z + row / ny);
                sums[start..start + nx].iter_mut().zip(values).for_each(|(sum, value)| *sum += share * value);
            }
        }
    }
}
