//! In-scattered radiance J: the light that a cell of cloud scatters towards a viewer, per unit of scattering coefficient.
//!
//! J(ω) = ∫ p(ω·ω') L(ω') dω', W/(m² sr). Its parts are what an asset's rows say of the light in a direction, what was solved for on the
//! spot, and the direct light of single scattering. They are put together here and nowhere else: pictures of the runtime, and
//! measurements of the bake, read the same J.

use crate::parallel::prelude::*;
use crate::relight::Relit;
use crate::transport::Cloud;
use glam::DVec3;
use squall_formats::sphere::{self, MAX_HARMONICS};

/// Cells that one thread takes at a time.
const CELLS_AT_ONCE: usize = 4096;

/// Everything that J is made of, per cell.
#[derive(Clone, Copy, Debug)]
pub struct InScattered<'a> {
    /// What the asset's rows sum to.
    pub rows: Relit<'a>,
    /// 16 harmonic coefficients of J a cell, of light that was solved for on the spot; empty: none.
    pub live: &'a [f32],
    /// J of direct light towards the viewer, a cell; empty: none, or followed exactly along each ray.
    pub direct: &'a [f32],
}

/// What turns an asset's coefficients into J in one direction; planes that do not count are left out.
#[derive(Clone, Debug)]
pub struct DirectionFactors {
    planes: Vec<(usize, f32)>,
    live: [f32; MAX_HARMONICS],
}

impl<'a> InScattered<'a> {
    /// The light of rows alone.
    pub fn of(rows: Relit<'a>) -> Self {
        Self { rows, live: &[], direct: &[] }
    }

    /// Factors in direction `towards` at a cell whose middle is `cell_m`, m; the place matters only to coefficients towards a view
    /// region.
    pub fn factors(&self, cell_m: DVec3, towards: DVec3) -> DirectionFactors {
        let mut factors = DirectionFactors { planes: Vec::new(), live: [0.0; MAX_HARMONICS] };
        self.set_factors(cell_m, towards, &mut Vec::new(), &mut factors);
        factors
    }

    /// [`InScattered::factors`] into memory that is used again.
    fn set_factors(&self, cell_m: DVec3, towards: DVec3, all: &mut Vec<f32>, factors: &mut DirectionFactors) {
        self.rows.factors(cell_m, towards, all);
        let planes = all.iter().copied().enumerate().filter(|(_, factor)| *factor != 0.0);
        factors.planes.clear();
        factors.planes.extend(planes);
        if !self.live.is_empty() {
            factors.live = sphere::harmonics(towards.to_array()).map(|value| value as f32);
        }
    }

    /// J in cell `cell`, W/(m² sr).
    #[inline]
    pub fn value(&self, cell: usize, factors: &DirectionFactors) -> f32 {
        let Relit { cells, planes, .. } = self.rows;
        let rows: f32 = factors.planes.iter().map(|(plane, f)| f * planes[plane * cells + cell]).sum();
        let live = self.live.get(cell * MAX_HARMONICS..(cell + 1) * MAX_HARMONICS);
        let live: f32 = live.map_or(0.0, |row| row.iter().zip(&factors.live).map(|(a, b)| a * b).sum());
        rows + live + self.direct.get(cell).copied().unwrap_or_default()
    }

    /// [`InScattered::towards_each`] in the cells that are `known` alone, 0 elsewhere.
    ///
    /// Panics when `j` or `known` is longer than the grid.
    pub(crate) fn towards_known(
        &self,
        cloud: &Cloud,
        known: &[bool],
        towards: impl Fn(DVec3) -> DVec3 + Sync + Send,
        j: &mut [f32],
    ) {
        let piece = |(number, values): (usize, &mut [f32])| {
            let mut factors = DirectionFactors { planes: Vec::new(), live: [0.0; MAX_HARMONICS] };
            let mut all = Vec::new();
            for (at, value) in values.iter_mut().enumerate() {
                let cell = number * CELLS_AT_ONCE + at;
                *value = 0.0;
                if known[cell] {
                    let middle = cloud.centre(cloud.shape.cell(cell));
                    self.set_factors(middle, towards(middle), &mut all, &mut factors);
                    *value = self.value(cell, &factors);
                }
            }
        };
        j.par_chunks_mut(CELLS_AT_ONCE).enumerate().for_each(piece);
    }

    /// J in every cell into `j`, each in the direction that `towards(cell, its middle in m)` says.
    ///
    /// Panics when `j` is longer than the grid.
    pub fn towards_each(
        &self,
        cloud: &Cloud,
        towards: impl Fn(usize, DVec3) -> DVec3 + Sync + Send,
        j: &mut [f32],
    ) {
        let piece = |(number, values): (usize, &mut [f32])| {
            let mut factors = DirectionFactors { planes: Vec::new(), live: [0.0; MAX_HARMONICS] };
            let mut all = Vec::new();
            for (at, value) in values.iter_mut().enumerate() {
                let cell = number * CELLS_AT_ONCE + at;
                let middle = cloud.centre(cloud.shape.cell(cell));
                self.set_factors(middle, towards(cell, middle), &mut all, &mut factors);
                *value = self.value(cell, &factors);
            }
        };
        j.par_chunks_mut(CELLS_AT_ONCE).enumerate().for_each(piece);
    }

    /// Fluence rate of rows and live light in cell `cell`, W/m²: J summed over the sphere. 0 of rows that only know light towards a
    /// view region.
    pub fn fluence(&self, cell: usize) -> f32 {
        let rows = self.rows.fluence(cell).unwrap_or_default();
        let live = self.live.get(cell * MAX_HARMONICS).copied().unwrap_or_default();
        rows + live * libm::sqrtf(4.0 * std::f32::consts::PI)
    }
}
