//! Light solved for on the spot: what point lights do that no row was baked for, and the exact direct light of those that were.
//!
//! The discretisation is that of the asset's rows, so that what comes of a light here and what its row would have held differ
//! by the codec alone. A live solve costs many times a relighting; it is the yardstick that baking is measured by.
//!
//! | symbol | name | unit |
//! | φ | fluence rate ∫ L dΩ | W/m² |
//! | J | in-scattered radiance, [`squall_formats::basis`] | W/(m² sr) |

use crate::Cloud;
use crate::cloud::CoarseIndex;
use crate::direct::{DirectField, Light, Tracer};
use crate::error::ArgumentError;
use crate::fit::{HatFit, weights};
use crate::lanes::SimdLevel;
use crate::light::PointLight;
use crate::parallel::map_chunks;
use crate::quadrature::Quadrature;
use crate::solve::{Iteration, SolveBuffers, SolveSettings, Solver};
use glam::DVec3;
use squall_formats::section::response::SolverRecord;
use squall_formats::sphere::{MAX_HARMONICS, degree_of, harmonics};
use squall_formats::view_region::ViewRegion;

/// Sweeps after which a live solve gives up.
const MAX_SWEEPS: u32 = 2000;
/// Lights traced in one piece; pieces run in parallel and are added in order.
const LIGHTS_PER_PIECE: usize = 8;

/// A cloud prepared for live solving.
pub struct LiveSolver {
    pub(crate) fine: Cloud,
    pub(crate) parent: CoarseIndex,
    pub(crate) solver: Solver<4>,
    /// Cells of the solve grid whose light is read; all where `None`.
    pub(crate) read: Option<Vec<bool>>,
    /// What fits light of the solve grid to the cloud's cells; means where `None`.
    pub(crate) fit: Option<HatFit>,
}

/// Direct light of point lights per cell.
#[derive(Clone, Debug)]
pub struct DirectCells {
    /// φ of light never scattered, W/m².
    pub unscattered: Vec<f32>,
    /// φ of light that was scattered forward and counts as unscattered in the delta-scaled medium, W/m².
    pub forward: Vec<f32>,
    /// J towards each direction asked for, directions innermost, W/(m² sr).
    pub towards: Vec<f32>,
    /// Moments of both together on the solve grid.
    pub(crate) moments: Vec<[f32; 4]>,
}

impl DirectCells {
    /// Adds the light of other point lights, collected towards the same directions or towards none.
    pub fn add(&mut self, other: &Self) {
        let pairs = [
            (&mut self.unscattered, &other.unscattered),
            (&mut self.forward, &other.forward),
            (&mut self.towards, &other.towards),
        ];
        for (sums, values) in pairs {
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
        let sums = self.moments.as_flattened_mut().iter_mut();
        sums.zip(other.moments.as_flattened()).for_each(|(sum, value)| *sum += value);
    }
}

/// Scattered light of point lights per cell, beyond the direct part.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveLight {
    /// J's 16 harmonic coefficients per cell.
    pub coefficients: Vec<f32>,
    /// Residual that was left.
    pub residual: f64,
    /// Sweeps that it took.
    pub sweeps: u32,
}

/// The direction set that a [`SolverRecord`] names. Errors: none has that name.
pub fn quadrature_of(record: &SolverRecord) -> Result<Quadrature, ArgumentError> {
    let set = match record.directions {
        [0, 14] => Quadrature::Lebedev14,
        [0, 26] => Quadrature::Lebedev26,
        [0, 50] => Quadrature::Lebedev50,
        [polar, azimuths] => Quadrature::DoubleGauss { polar, azimuths },
    };
    set.ordinates().map(|_| set)
}

impl LiveSolver {
    /// Prepares `cloud` for solving as `record` says that its rows were.
    ///
    /// Errors: a record that no solver can follow.
    pub fn new(cloud: &Cloud, record: &SolverRecord) -> Result<Self, ArgumentError> {
        Self::on(cloud.refined(record.refine)?, record)
    }

    /// The same for cells that are blocks of `shown`'s, solved for in those or in equal parts of them and fitted as rows of light that was
    /// are ([`crate::fit`]) for a view region or for all.
    ///
    /// Errors: a record that no solver can follow, or that is not of such blocks.
    pub fn fitted(
        (cloud, shown): (&Cloud, &Cloud),
        record: &SolverRecord,
        view_region: Option<&ViewRegion>,
    ) -> Result<Self, ArgumentError> {
        let (large, small) = (cloud.shape.to_array(), shown.shape.to_array());
        let parts = |axis: usize| record.refine[axis] as usize * large[axis] / small[axis].max(1);
        let fine = shown.refined([0, 1, 2].map(|axis| parts(axis) as u32))?;
        let fit = HatFit::new(&fine, record.refine, weights(&fine, view_region))?;
        if fit.coarse() != cloud.shape {
            let wanted = format!("cells of {:?} solve cells", record.refine);
            return Err(ArgumentError::new("fitted light", wanted, format!("{large:?} of {small:?}")));
        }
        let read: Vec<bool> = fit.weights().iter().map(|&weight| weight > 0.0).collect();
        let Self { fine, parent, solver, .. } = Self::on(fine, record)?;
        let solver = solver.read_in(&fine, &read);
        Ok(Self { solver, fine, parent, read: Some(read), fit: Some(fit) })
    }

    fn on(fine: Cloud, record: &SolverRecord) -> Result<Self, ArgumentError> {
        let settings = SolveSettings {
            quadrature: quadrature_of(record)?,
            scheme: record.scheme,
            delta: record.extinction_scale != 1.0,
            tolerance: record.tolerance,
            max_sweeps: MAX_SWEEPS,
            iteration: Iteration::Minres,
            level: SimdLevel::Best,
        };
        let solver = Solver::new(&fine, settings)?;
        Ok(Self { parent: CoarseIndex::new(fine.shape, record.refine), fine, solver, read: None, fit: None })
    }

    /// The same where only the cells `wanted` are read, one a cell of the cloud that it was made for: sweeps step over empty cells that
    /// no light to one of those crosses. Light is the same in wanted cells, and none elsewhere.
    ///
    /// Panics when `wanted` is not one grid long.
    #[must_use]
    pub fn read_in(self, wanted: &[bool]) -> Self {
        let mut read: Vec<bool> =
            (0..self.fine.shape.len()).map(|cell| wanted[self.parent.of(cell)]).collect();
        let Self { fine, parent, solver, fit, .. } = self;
        if let Some(fit) = &fit {
            read.iter_mut().zip(fit.weights()).for_each(|(read, &weight)| *read &= weight > 0.0);
        }
        Self { solver: solver.read_in(&fine, &read), fine, parent, read: Some(read), fit }
    }

    /// The grid that is solved on.
    pub fn solve_grid(&self) -> &Cloud {
        &self.fine
    }

    /// Extinction of the delta-scaled medium over extinction.
    pub fn extinction_scale(&self) -> f64 {
        self.solver.scaled().extinction_scale
    }

    /// Share of all cells that a sweep visits, 0 to 1.
    pub fn share_visited(&self) -> f64 {
        self.solver.share_visited()
    }

    /// Follows the lights' direct light, `samples`² rays through every boundary face of the solve grid, and collects it
    /// towards `directions`. The same bytes come out for any number of threads.
    pub fn direct(&self, lights: &[PointLight], directions: &[DVec3], samples: u32) -> DirectCells {
        let lights: Vec<Light> = lights.iter().map(|&light| light.into()).collect();
        self.direct_of(&lights, directions, samples)
    }

    /// [`LiveSolver::direct`] of lights of any kind.
    pub fn direct_of(&self, lights: &[Light], directions: &[DVec3], samples: u32) -> DirectCells {
        let tracer = Tracer::new(&self.fine, self.solver.scaled().extinction_scale);
        let piece = |_: usize, lights: &[Light]| -> DirectField<4> {
            let mut field = DirectField::new(&self.fine, directions);
            for &light in lights {
                tracer.rays(light, samples, |ray| {
                    tracer.trace(ray, &mut field);
                });
            }
            field
        };
        let mut whole = DirectField::<4>::new(&self.fine, directions);
        let add = |part: DirectField<4>| {
            let sums =
                whole.fluence.iter_mut().chain(&mut whole.towards).chain(whole.moments.as_flattened_mut());
            let values = part.fluence.iter().chain(&part.towards).chain(part.moments.as_flattened());
            sums.zip(values).for_each(|(sum, value)| *sum += value);
        };
        map_chunks(lights, LIGHTS_PER_PIECE, piece, add);

        let share = 1.0 / self.fine.cell_volume() as f32;
        let means = |sums: &[f32], width: usize| -> Vec<f32> {
            let mut values = self.parent.means(sums, width);
            values.iter_mut().for_each(|value| *value *= share);
            values
        };
        let y0 = harmonics([0.0, 0.0, 1.0])[0] as f32;
        let scaled = whole.moments.iter().zip(&whole.fluence);
        // At least nothing: what is below is round-off between two sums of the same rays.
        let forward: Vec<f32> =
            scaled.map(|(moments, unscattered)| (moments[0] / y0 - unscattered).max(0.0)).collect();
        DirectCells {
            unscattered: means(&whole.fluence, 1),
            forward: means(&forward, 1),
            towards: if directions.is_empty() { Vec::new() } else { means(&whole.towards, directions.len()) },
            moments: whole.moments.iter().map(|row| row.map(|sum| sum * share)).collect(),
        }
    }

    /// Solves for what direct light scatters, any number of times. `watch` sees the residual over its goal after each sweep
    /// and stops with `false`.
    ///
    /// Errors: a residual above the record's tolerance.
    pub fn solve(
        &self,
        direct: &DirectCells,
        watch: &mut dyn FnMut(f64) -> bool,
    ) -> Result<LiveLight, ArgumentError> {
        self.solve_moments(&direct.moments, watch)
    }

    /// [`LiveSolver::solve`] of direct light given by its moments ∫ Y_m L dΩ up to degree 1, mean per cell of
    /// [`LiveSolver::solve_grid`], of light that the delta-scaled medium counts as unscattered, W/m².
    ///
    /// Errors: as there. Panics when `direct` is not one grid long.
    pub fn solve_moments(
        &self,
        direct: &[[f32; 4]],
        watch: &mut dyn FnMut(f64) -> bool,
    ) -> Result<LiveLight, ArgumentError> {
        let mut moments = Vec::new();
        let mut buffers = SolveBuffers::default();
        let report = self.solver.solve_watched::<f32>(direct, &mut moments, &mut buffers, None, watch);
        let lane = report.lanes[0];
        if !lane.converged {
            let found = format!("{:e} after {} sweeps", lane.residual, report.sweeps);
            return Err(ArgumentError::new("live solve", "the residual that the rows were solved to", found));
        }
        let coefficients = self.coefficients(&mut moments);
        Ok(LiveLight { coefficients, residual: lane.residual, sweeps: report.sweeps })
    }

    /// J's harmonic coefficients, 16 a cell of the cloud, of moments of light in the solve grid's, which are scaled for it.
    pub(crate) fn coefficients(&self, moments: &mut [[f32; MAX_HARMONICS]]) -> Vec<f32> {
        let g = self.fine.g;
        let powers = [1.0, g, g * g, g * g * g];
        let scale: [f32; MAX_HARMONICS] = std::array::from_fn(|m| powers[degree_of(m)] as f32);
        for row in &mut *moments {
            for (value, factor) in row.iter_mut().zip(scale) {
                *value *= factor;
            }
        }
        match &self.fit {
            Some(fit) => fit.fit(moments.as_flattened(), MAX_HARMONICS),
            None if self.parent.coarse() == self.fine.shape => moments.as_flattened().to_vec(),
            None => self.parent.means(moments.as_flattened(), MAX_HARMONICS),
        }
    }
}
