//! Solving a batch of lights, and what is made of it: coefficients of rows, held-out strokes with their truth.

use super::directions::{add_direct, in_26_directions};
use super::hidden::HiddenCells;
use super::job::HeldOutStroke;
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
use squall_runtime::transport::direct::{DirectField, Light, Tracer};
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::solve::{BatchReport, GATHERED, Solvable, SolveBuffers, Solver};
use std::sync::Arc;

/// What polynomials towards a view region are made from.
pub(super) const SOLVED: DirectionalBasis = DirectionalBasis::Harmonics { degree: 3 };

/// Lights that were solved side by side.
pub(super) struct Batch<R> {
    pub(super) report: BatchReport,
    /// What each light's row became, and its coefficients where they are needed.
    pub(super) rows: Vec<(R, Option<Vec<f32>>)>,
}

/// Solves rows of one response: what all its lights have in common.
pub(super) struct RowSolver<'a> {
    settings: &'a ResponseSettings,
    fine: &'a Cloud,
    tracer: Tracer<'a>,
    solver: &'a Solver<4>,
    parent: CoarseIndex,
    haar: Haar,
    cloud: &'a Cloud,
    /// Cells that no light is stored for.
    hidden: Option<HiddenCells>,
    view_region_map: Option<ViewRegionMap>,
    /// Unit vectors from stored cells to the middle of the view region.
    to_viewers: Option<Vec<[f32; 3]>>,
    directions: [DVec3; 26],
}

/// Memory of a thread.
#[derive(Default)]
pub(super) struct Work<P> {
    direct: Option<DirectField<4>>,
    sources: Vec<[P; 4]>,
    gathered: Vec<[P; GATHERED]>,
    buffers: SolveBuffers<P, 4>,
    towards: Vec<Vec<f32>>,
    scratch: Vec<f32>,
}

impl<'a> RowSolver<'a> {
    pub(super) fn new(
        cloud: &'a Cloud,
        fine: &'a Cloud,
        solver: &'a Solver<4>,
        settings: &'a ResponseSettings,
    ) -> Self {
        let hidden =
            if settings.seen_only { HiddenCells::new(cloud, settings.view_region.as_ref()) } else { None };
        let seen = hidden.as_ref().map(HiddenCells::seen);
        Self {
            settings,
            fine,
            tracer: Tracer::new(fine, solver.scaled().extinction_scale),
            solver,
            parent: CoarseIndex::new(fine.shape, [settings.refine; 3]),
            haar: Haar::new(cloud.shape),
            cloud,
            view_region_map: match (settings.channels, &settings.view_region) {
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

    /// Traces lights, one list a lane, and solves for what they scatter.
    fn solve_lanes<P: Solvable<4>>(
        &self,
        lanes: &[Vec<Light>],
        towards: bool,
        work: &mut Work<P>,
    ) -> Result<BatchReport, BakeError> {
        let directions: &[DVec3] = if towards { &self.directions } else { &[] };
        let fits = |field: &DirectField<4>| field.towards.len() == self.fine.shape.len() * directions.len();
        let mut direct = match work.direct.take() {
            Some(field) if fits(&field) => field,
            _ => DirectField::new(self.fine, directions),
        };
        let share = 1.0 / self.fine.cell_volume() as f32;
        work.sources.clear();
        work.sources.resize(self.fine.shape.len(), [P::splat(0.0); 4]);
        work.towards.clear();
        for (lane, lights) in lanes.iter().enumerate() {
            direct.clear();
            for &light in lights {
                self.tracer.rays(light, self.settings.samples, |ray| {
                    self.tracer.trace(ray, &mut direct);
                });
            }
            for (source, moments) in work.sources.iter_mut().zip(&direct.moments) {
                for m in 0..4 {
                    source[m].set_lane(lane, moments[m] * share);
                }
            }
            if towards {
                let coarse = self.parent.means(&direct.towards, directions.len());
                work.towards.push(coarse.into_iter().map(|v| v * share).collect());
            }
        }
        work.direct = Some(direct);
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

    /// J's harmonic coefficients of one lane's scattered light in the stored cells, 16 a cell.
    fn coefficients<P: Lanes>(&self, lane: usize, work: &Work<P>) -> Vec<f32> {
        let powers = [1.0, self.fine.g, self.fine.g * self.fine.g, self.fine.g * self.fine.g * self.fine.g];
        let scale: [f32; MAX_HARMONICS] = std::array::from_fn(|m| powers[degree_of(m)] as f32);
        let mut fine = Vec::with_capacity(work.gathered.len() * MAX_HARMONICS);
        for moments in &work.gathered {
            fine.extend((0..MAX_HARMONICS).map(|m| moments[m].lane(lane) * scale[m]));
        }
        if self.settings.refine == 1 { fine } else { self.parent.means(&fine, MAX_HARMONICS) }
    }

    /// One lane's coefficients in the stored basis, one plane each.
    fn planes<P: Lanes>(&self, lane: usize, in_rows: bool, work: &Work<P>) -> Vec<f32> {
        let coefficients = self.coefficients(lane, work);
        let cells = coefficients.len() / MAX_HARMONICS;
        let basis = if self.view_region_map.is_some() { SOLVED } else { self.settings.channels };
        let count = basis.count();
        let mut planes = vec![0.0f32; cells * count];
        let directions;
        let (values, stride): (&[f32], usize) = match basis {
            DirectionalBasis::Directions26 => {
                directions = in_26_directions(&coefficients);
                (&directions, 26)
            }
            DirectionalBasis::Harmonics { .. } | DirectionalBasis::ViewRegion { .. } => {
                (&coefficients, MAX_HARMONICS)
            }
        };
        for (cell, values) in values.chunks_exact(stride).enumerate() {
            for channel in 0..count {
                planes[channel * cells + cell] = values[channel];
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

    /// Solves lights side by side; each row goes through `finish`, and comes along uncoded where `needed`.
    pub(super) fn solve_batch<R>(
        &self,
        lanes: &[Vec<Light>],
        in_rows: bool,
        needed: impl Fn(usize) -> bool,
        finish: &(dyn Fn(Vec<f32>) -> R + Sync),
        work: &mut Work<F32x16>,
    ) -> Result<Batch<R>, BakeError> {
        let report = self.solve_lanes(lanes, in_rows, work)?;
        let mut rows = Vec::with_capacity(lanes.len());
        for lane in 0..lanes.len() {
            let mut planes = self.planes(lane, in_rows, work);
            if let Some(hidden) = &self.hidden {
                planes.chunks_exact_mut(self.haar.len()).for_each(|plane| hidden.fill(plane));
            }
            let kept = needed(lane).then(|| planes.clone());
            for plane in planes.chunks_exact_mut(self.haar.len()) {
                self.haar.forward(plane, &mut work.scratch);
            }
            rows.push((finish(planes), kept));
        }
        Ok(Batch { report, rows })
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
                let light = |l: &PointLight| Light::Point { position: l.position, intensity: l.intensity };
                self.solve_lanes(&[lights.iter().map(light).collect()], true, work)?;
                let mut truth = in_26_directions(&self.coefficients(0, work));
                let direct = std::mem::take(&mut work.towards[0]);
                for (sum, value) in truth.iter_mut().zip(&direct) {
                    *sum += value;
                }
                progress.advance(1);
                let direct_to_viewers = self.direct_to_viewers(lights);
                let seen = seen.clone();
                Ok(HeldOutStroke {
                    lights: lights.clone(),
                    truth,
                    direct,
                    direct_to_viewers,
                    uncompressed: Vec::new(),
                    seen,
                })
            })
            .collect();
        solved.into_iter().collect()
    }
}
