//! Solving a batch of lights, and what is made of it: coefficients of rows, held-out strokes with their truth.

use super::cache::{JobCache, KeptRow};
use super::directions::{add_direct, in_26_directions};
use super::hidden::HiddenCells;
use super::job::{HeldOutStroke, Job, SolveCells};
use super::region::ViewRegionMap;
use crate::error::BakeError;
use crate::progress::Progress;
use crate::recipe::model::ResponseSettings;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::haar::Haar;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::sphere::{self, MAX_HARMONICS, degree_of};
use squall_runtime::relight::PointLight;
use squall_runtime::single_scatter::{self, DirectSettings};
use squall_runtime::transport::Cloud;
use squall_runtime::transport::cloud::CoarseIndex;
use squall_runtime::transport::direct::{DirectField, DirectMoments, Light, NearCloud, Tracer, distances};
use squall_runtime::transport::fit::HatFit;
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::solve::{BatchReport, GATHERED, Solvable, SolveBuffers, Solver};
use std::sync::Arc;

/// What polynomials towards a view region are made from.
pub(super) const SOLVED: DirectionalBasis = DirectionalBasis::Harmonics { degree: 3 };

/// One light's row, finished.
pub(super) struct Row<R> {
    /// Its number.
    pub(super) number: u32,
    /// What it became.
    pub(super) value: R,
    /// Its coefficients, where they are needed.
    pub(super) uncoded: Option<Vec<f32>>,
    /// Residual that was left.
    pub(super) residual: f64,
    /// Its own sweeps: [`BatchReport::steps`].
    pub(super) steps: Vec<u32>,
}

/// A row to be solved: its number and its lights.
pub(super) type Wanted<'a> = (u32, &'a [Light]);

/// What becomes of rows.
pub(super) struct Finish<'a, R> {
    /// Which rows are needed uncoded.
    pub(super) needed: &'a (dyn Fn(u32) -> bool + Sync),
    /// What codes a row's planes, or keeps them.
    pub(super) code: &'a (dyn Fn(Vec<f32>) -> R + Sync),
}

/// Sweeps that a batch has to be away from its bound for its rows to be kept: those of a batch at its bound depend on their neighbours.
const AWAY_FROM_BOUND: u32 = 4;

/// Share of a ray's light with which it ends: single precision's last digit.
pub(super) const LEAST: f32 = 1e-7;

/// Solves rows of one response: what all its lights have in common.
pub(super) struct RowSolver<'a> {
    settings: &'a ResponseSettings,
    fine: &'a Cloud,
    tracer: Tracer<'a>,
    /// Steps of the solve's cells to cloud, and the most of any whose light is stored.
    distances: Vec<u8>,
    farthest: u8,
    solver: &'a Solver<4>,
    parent: CoarseIndex,
    fit: Option<&'a HatFit>,
    haar: Haar,
    cloud: &'a Cloud,
    /// Cells that no light is stored for.
    hidden: Option<HiddenCells>,
    view_region_map: Option<ViewRegionMap>,
    /// Unit vectors from stored cells to the middle of the view region.
    to_viewers: Option<Vec<[f32; 3]>>,
    directions: [DVec3; 26],
    cache: Option<JobCache<'a>>,
}

/// Memory of a thread.
#[derive(Default)]
pub(super) struct Work<P> {
    direct: Option<DirectField<4>>,
    moments: Option<DirectMoments<4>>,
    sources: Vec<[P; 4]>,
    gathered: Vec<[P; GATHERED]>,
    buffers: SolveBuffers<P, 4>,
    towards: Vec<Vec<f32>>,
    scratch: Vec<f32>,
}

impl<'a> RowSolver<'a> {
    pub(super) fn new(job: &Job<'a>, cells: &'a SolveCells, solver: &'a Solver<4>) -> Self {
        let Job { cloud, settings, .. } = *job;
        let fine = &cells.fine;
        let hidden =
            if settings.seen_only { HiddenCells::new(cloud, settings.view_region.as_ref()) } else { None };
        let seen = hidden.as_ref().map(HiddenCells::seen);
        let cache = JobCache::new(job, seen);
        let steps = distances(fine.shape, fine.extinction.iter().map(|&extinction| extinction > 0.0));
        let parent = CoarseIndex::new(fine.shape, cells.factors);
        Self {
            settings,
            fine,
            tracer: Tracer::new(fine, solver.scaled().extinction_scale),
            farthest: steps
                .iter()
                .enumerate()
                .filter(|(cell, _)| seen.is_none_or(|seen| seen[parent.of(*cell)]))
                .map(|(_, steps)| *steps)
                .max()
                .unwrap_or(0),
            distances: steps,
            solver,
            parent,
            fit: cells.fit.as_ref(),
            haar: Haar::new(cloud.shape),
            cloud,
            view_region_map: match (settings.basis, &settings.view_region) {
                (DirectionalBasis::ViewRegion { degree }, Some(view_region)) => {
                    Some(ViewRegionMap::new(cloud, view_region, degree, seen))
                }
                _ => None,
            },
            hidden,
            to_viewers: settings.view_region.map(|view_region| {
                let centre = DVec3::from_array(view_region.centre());
                let towards = |cell| (centre - cloud.centre(cloud.shape.cell(cell))).normalize_or(DVec3::Z);
                (0..cloud.shape.len()).map(|cell| towards(cell).as_vec3().to_array()).collect()
            }),
            directions: sphere::directions_26().map(DVec3::from_array),
            cache,
        }
    }

    /// Cells that light is stored for; all where `None`.
    pub(super) fn seen(&self) -> Option<&[bool]> {
        self.hidden.as_ref().map(HiddenCells::seen)
    }

    /// Refuses a cloud that is hidden from every viewpoint. A grid without density has nothing to see for anyone.
    pub(super) fn check_visible(&self) -> Result<(), BakeError> {
        let all_hidden = self.seen().is_some_and(|seen| !seen.contains(&true));
        if !all_hidden || self.cloud.extinction.iter().all(|&extinction| extinction <= 0.0) {
            return Ok(());
        }
        Err(BakeError::NotReached {
            what: "the cloud's response".into(),
            wanted: "cells that a viewpoint can see".into(),
            reached: "none".into(),
            hint: "a view region that the cloud is not hidden from".into(),
        })
    }

    pub(super) fn in_rows(&self) -> bool {
        self.settings.direct == DirectTerm::InRows
    }

    /// Follows a lane's lights to where cloud scatters them.
    fn trace<P: Lanes>(&self, lane: usize, lights: &[Light], work: &mut Work<P>) {
        let cells = self.fine.shape.len();
        let kept = work.moments.take().filter(|direct| direct.moments.len() == cells);
        let mut direct = kept.unwrap_or_else(|| DirectMoments::new(cells));
        direct.clear();
        let near = NearCloud { distances: &self.distances, around: 0, least: LEAST };
        for &light in lights {
            self.tracer.add_moments(light, self.settings.samples, &near, &mut direct);
        }
        self.set_lane(lane, &direct.moments, &mut work.sources);
        work.moments = Some(direct);
    }

    /// [`Self::trace`] through every cell whose light is stored, with what is scattered once towards the stored directions.
    fn trace_towards<P: Lanes>(&self, lane: usize, lights: &[Light], work: &mut Work<P>) {
        let fits = |field: &DirectField<4>| field.moments.len() == self.fine.shape.len();
        let mut direct = match work.direct.take() {
            Some(field) if fits(&field) => field,
            _ => DirectField::new(self.fine, &self.directions),
        };
        direct.clear();
        // Light that is compared with what was stored is followed as far as [`Tracer::trace`] follows it.
        let near = NearCloud { distances: &self.distances, around: self.farthest, least: 1e-13 };
        for &light in lights {
            self.tracer.add_field(light, self.settings.samples, &near, &mut direct);
        }
        self.set_lane(lane, &direct.moments, &mut work.sources);
        let share = 1.0 / self.fine.cell_volume() as f32;
        let coarse = self.parent.means(&direct.towards, self.directions.len());
        work.towards.push(coarse.into_iter().map(|v| v * share).collect());
        work.direct = Some(direct);
    }

    fn set_lane<P: Lanes>(&self, lane: usize, moments: &[[f32; 4]], sources: &mut [[P; 4]]) {
        let share = 1.0 / self.fine.cell_volume() as f32;
        for (source, moments) in sources.iter_mut().zip(moments) {
            for m in 0..4 {
                source[m].set_lane(lane, moments[m] * share);
            }
        }
    }

    /// Traces lights, one list a lane, and solves for what they scatter.
    fn solve_lanes<P: Solvable<4>>(
        &self,
        lanes: &[Vec<Light>],
        towards: bool,
        work: &mut Work<P>,
    ) -> Result<BatchReport, BakeError> {
        work.sources.clear();
        work.sources.resize(self.fine.shape.len(), [P::splat(0.0); 4]);
        work.towards.clear();
        for (lane, lights) in lanes.iter().enumerate() {
            if towards { self.trace_towards(lane, lights, work) } else { self.trace(lane, lights, work) }
        }
        let report = self.solver.solve(&work.sources, &mut work.gathered, &mut work.buffers, None);
        for (lane, lights) in report.lanes.iter().zip(lanes) {
            if !lane.converged {
                return Err(BakeError::NotReached {
                    what: format!("transport of {:?}", lights.first()),
                    wanted: format!("residual {:e}", self.settings.solve.tolerance),
                    reached: format!("{:e} after {} sweeps", lane.residual, report.sweeps),
                    hint: "a larger tolerance or more sweeps help".into(),
                });
            }
        }
        Ok(report)
    }

    /// The first `count` of J's harmonic coefficients of one lane's scattered light in the stored cells.
    fn coefficients<P: Lanes>(&self, lane: usize, count: usize, work: &Work<P>) -> Vec<f32> {
        let powers = [1.0, self.fine.g, self.fine.g * self.fine.g, self.fine.g * self.fine.g * self.fine.g];
        let scale: [f32; MAX_HARMONICS] = std::array::from_fn(|m| powers[degree_of(m)] as f32);
        let mut fine = Vec::with_capacity(work.gathered.len() * count);
        for moments in &work.gathered {
            fine.extend((0..count).map(|m| moments[m].lane(lane) * scale[m]));
        }
        match self.fit {
            Some(fit) => fit.fit(&fine, count),
            None if self.parent.coarse() == self.fine.shape => fine,
            None => self.parent.means(&fine, count),
        }
    }

    /// One lane's coefficients in the stored basis, one plane each.
    fn planes<P: Lanes>(&self, lane: usize, in_rows: bool, work: &Work<P>) -> Vec<f32> {
        let basis = if self.view_region_map.is_some() { SOLVED } else { self.settings.basis };
        let count = basis.count();
        let solved = if basis == DirectionalBasis::Directions26 { MAX_HARMONICS } else { count };
        let coefficients = self.coefficients(lane, solved, work);
        let cells = coefficients.len() / solved;
        let mut planes = vec![0.0f32; cells * count];
        let directions;
        let (values, stride): (&[f32], usize) = match basis {
            DirectionalBasis::Directions26 => {
                directions = in_26_directions(&coefficients);
                (&directions, 26)
            }
            DirectionalBasis::Harmonics { .. } | DirectionalBasis::ViewRegion { .. } => {
                (&coefficients, solved)
            }
        };
        for (cell, values) in values.chunks_exact(stride).enumerate() {
            for plane in 0..count {
                planes[plane * cells + cell] = values[plane];
            }
        }
        if in_rows {
            add_direct(basis, &work.towards[lane], 1.0, &mut planes);
        }
        match &self.view_region_map {
            Some(map) => map.apply(&planes),
            None => planes,
        }
    }

    /// Whether so many sweeps of a batch left its rows what they are without their neighbours.
    pub(super) fn is_away_from_bound(&self, sweeps: u32) -> bool {
        sweeps.saturating_add(AWAY_FROM_BOUND) <= self.settings.solve.max_sweeps
    }

    /// Solves rows side by side.
    pub(super) fn solve_batch<R>(
        &self,
        wanted: &[Wanted<'_>],
        in_rows: bool,
        finish: &Finish<'_, R>,
        work: &mut Work<F32x16>,
    ) -> Result<Vec<Row<R>>, BakeError> {
        let lanes: Vec<Vec<Light>> = wanted.iter().map(|(_, lights)| lights.to_vec()).collect();
        let report = self.solve_lanes(&lanes, in_rows, work)?;
        let mut rows = Vec::with_capacity(wanted.len());
        for (lane, (&(number, lights), steps)) in wanted.iter().zip(report.steps).enumerate() {
            let planes = self.planes(lane, in_rows, work);
            let residual = report.lanes[lane].residual;
            if let Some(cache) = self.cache.as_ref().filter(|_| self.is_away_from_bound(report.sweeps)) {
                cache.keep_row(lights, in_rows, residual, &steps, &planes);
            }
            let (value, uncoded) = self.finish(number, planes, finish, &mut work.scratch);
            rows.push(Row { number, value, uncoded, residual, steps });
        }
        Ok(rows)
    }

    /// A row that was solved before, if it was.
    pub(super) fn kept<R>(
        &self,
        (number, lights): Wanted<'_>,
        in_rows: bool,
        finish: &Finish<'_, R>,
        scratch: &mut Vec<f32>,
    ) -> Option<Row<R>> {
        let KeptRow { residual, steps, values } = self.cache.as_ref()?.row(lights, in_rows)?;
        let (value, uncoded) = self.finish(number, values, finish, scratch);
        Some(Row { number, value, uncoded, residual, steps })
    }

    /// Fills what nobody reads, transforms and codes.
    fn finish<R>(
        &self,
        number: u32,
        mut planes: Vec<f32>,
        finish: &Finish<'_, R>,
        scratch: &mut Vec<f32>,
    ) -> (R, Option<Vec<f32>>) {
        if let Some(hidden) = &self.hidden {
            planes.chunks_exact_mut(self.haar.len()).for_each(|plane| hidden.fill(plane));
        }
        let uncoded = (finish.needed)(number).then(|| planes.clone());
        planes.chunks_exact_mut(self.haar.len()).for_each(|plane| self.haar.forward(plane, scratch));
        ((finish.code)(planes), uncoded)
    }

    fn direct_to_viewers(&self, lights: &[PointLight]) -> Vec<f32> {
        let Some(to_viewers) = &self.to_viewers else { return Vec::new() };
        let mut j = vec![0.0; to_viewers.len()];
        let scale = self.solver.scaled().extinction_scale;
        single_scatter::add_direct(self.cloud, scale, lights, to_viewers, DirectSettings::default(), &mut j);
        j
    }

    /// Held-out strokes with their truth.
    pub(super) fn solve_strokes(
        &self,
        strokes: &[Vec<PointLight>],
        progress: &dyn Progress,
    ) -> Result<Vec<HeldOutStroke>, BakeError> {
        let seen: Arc<[bool]> = self.seen().map_or_else(Default::default, Into::into);
        // One stroke a task: tracing its many points is most of the work.
        let solved: Vec<Result<HeldOutStroke, BakeError>> = strokes
            .par_iter()
            .map_init(Work::<f32>::default, |work, lights| {
                progress.check()?;
                let to_viewers = self.to_viewers.is_some();
                let kept = self.cache.as_ref().and_then(|cache| cache.stroke(lights, to_viewers, &seen));
                if let Some(stroke) = kept {
                    progress.advance(1);
                    return Ok(stroke);
                }
                let light = |l: &PointLight| Light::Point { position: l.position, intensity: l.intensity };
                self.solve_lanes(&[lights.iter().map(light).collect()], true, work)?;
                let mut truth = in_26_directions(&self.coefficients(0, MAX_HARMONICS, work));
                let direct = std::mem::take(&mut work.towards[0]);
                for (sum, value) in truth.iter_mut().zip(&direct) {
                    *sum += value;
                }
                progress.advance(1);
                let direct_to_viewers = self.direct_to_viewers(lights);
                let seen = seen.clone();
                let stroke = HeldOutStroke {
                    lights: lights.clone(),
                    truth,
                    direct,
                    direct_to_viewers,
                    uncompressed: Vec::new(),
                    seen,
                };
                if let Some(cache) = &self.cache {
                    cache.keep_stroke(&stroke, to_viewers);
                }
                Ok(stroke)
            })
            .collect();
        solved.into_iter().collect()
    }
}
