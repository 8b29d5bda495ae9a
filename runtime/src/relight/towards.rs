//! Cells as one viewer sees them: directions and factors that all lights share, worked out once a viewer.

use super::{Relighter, basis_factors};
use crate::clouds::Viewer;
use crate::parallel::prelude::*;
use crate::single_scatter::WantedCells;
use glam::DVec3;
use squall_formats::basis::DirectionalBasis;
use std::sync::{Arc, Mutex, PoisonError};

/// Cells that one thread takes at a time.
const CELLS_AT_ONCE: usize = 4096;
/// Steps from cloud within which cells are read between their middles.
const AROUND: u8 = 1;

/// What all lights of a cloud share towards one viewer.
#[derive(Debug)]
pub(crate) struct Towards {
    viewer: Viewer,
    /// The unit direction to the viewer from each of [`Relighter::near_cells`].
    pub ways: Vec<[f32; 3]>,
    /// A known cell's factors, one a coefficient, of rows towards a view region; empty of others.
    factors: Vec<f32>,
}

/// The last viewer's.
#[derive(Debug, Default)]
pub(super) struct LastTowards(Mutex<Option<Arc<Towards>>>);

/// Cells whose light means something, of the grid that the light is known on.
#[derive(Debug)]
pub(super) struct KnownCells {
    cells: Vec<u32>,
    /// Where those of each [`CELLS_AT_ONCE`] cells begin, and the end.
    starts: Vec<usize>,
}

impl Relighter {
    /// Cells of the cloud that a lookup between the centres of cells reads.
    pub(crate) fn near_cells(&self) -> &WantedCells {
        self.near.get_or_init(|| WantedCells::new(self.cloud_distances(), AROUND))
    }

    fn known(&self) -> &KnownCells {
        self.known.get_or_init(|| {
            let is_known = self.known_light_cells();
            let (mut cells, mut starts) = (Vec::new(), vec![0]);
            for (number, known) in is_known.chunks(CELLS_AT_ONCE).enumerate() {
                let first = number * CELLS_AT_ONCE;
                cells.extend(
                    known.iter().enumerate().filter(|(_, known)| **known).map(|(at, _)| (first + at) as u32),
                );
                starts.push(cells.len());
            }
            KnownCells { cells, starts }
        })
    }

    /// What lights share towards a viewer, kept for the last.
    pub(crate) fn seen_by(&self, viewer: Viewer) -> Arc<Towards> {
        // Not while the work below is done, which other threads of the pool may join in, this lock's holder among those that they wait for.
        let last = || self.towards.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = last().as_ref().filter(|kept| kept.viewer == viewer) {
            return kept.clone();
        }
        let new = Arc::new(self.new_towards(viewer));
        *last() = Some(new.clone());
        new
    }

    fn new_towards(&self, viewer: Viewer) -> Towards {
        let near = self.near_cells().cells();
        let mut ways = vec![[0.0; 3]; near.len()];
        ways.par_chunks_mut(CELLS_AT_ONCE).zip(near.par_chunks(CELLS_AT_ONCE)).for_each(|(ways, cells)| {
            for (way, &cell) in ways.iter_mut().zip(cells) {
                let middle = self.cloud.centre(self.cloud.shape.cell(cell as usize));
                *way = viewer.direction_from(middle).as_vec3().to_array();
            }
        });
        let (basis, light) = (self.response.head.basis, self.light_cloud());
        let DirectionalBasis::ViewRegion { .. } = basis else {
            return Towards { viewer, ways, factors: Vec::new() };
        };
        let (cells, count) = (&self.known().cells, basis.count());
        let mut factors = vec![0.0; cells.len() * count];
        let pieces = factors.par_chunks_mut(CELLS_AT_ONCE * count).zip(cells.par_chunks(CELLS_AT_ONCE));
        pieces.for_each(|(factors, cells)| {
            let mut own = Vec::with_capacity(count);
            for (factors, &cell) in factors.chunks_exact_mut(count).zip(cells) {
                let middle: DVec3 = light.centre(light.shape.cell(cell as usize));
                let view = self.frame.as_ref().map(|frame| (frame, middle));
                basis_factors(basis, view, viewer.direction_from(middle), &mut own);
                factors.copy_from_slice(&own);
            }
        });
        Towards { viewer, ways, factors }
    }

    /// J towards a viewer in the known cells of [`Relighter::light_cloud`] of rows towards a view region, whose sums are `planes`; 0 elsewhere.
    /// False, and nothing done, of other rows.
    pub(crate) fn known_towards(&self, seen: &Towards, planes: &[f32], j: &mut [f32]) -> bool {
        if seen.factors.is_empty() {
            return false;
        }
        let (known, count, cells) = (self.known(), self.response.head.basis.count(), j.len());
        j.par_chunks_mut(CELLS_AT_ONCE).enumerate().for_each(|(number, values)| {
            values.fill(0.0);
            let range = known.starts[number]..known.starts[number + 1];
            let factors = &seen.factors[range.start * count..range.end * count];
            for (&cell, factors) in known.cells[range].iter().zip(factors.chunks_exact(count)) {
                let cell = cell as usize;
                let parts =
                    factors.iter().enumerate().map(|(plane, factor)| factor * planes[plane * cells + cell]);
                values[cell - number * CELLS_AT_ONCE] = parts.sum();
            }
        });
        true
    }
}
