//! A single light's sweep in four parts that can be worked on side by side, added in order.

use super::one::{Pair, SingleKernel};
use super::{Bundles, Emission, SweepBuffers, Sweeper};
use crate::cloud::Boundary;
use crate::lanes::{Lanes, run};
use crate::parallel::prelude::*;

/// Memory of [`Sweeper::run_parts`].
#[derive(Clone, Debug, Default)]
pub struct SweepParts<const O: usize> {
    parts: [Part<O>; 4],
}

/// Light that goes one way along y and one way along z.
#[derive(Clone, Debug, Default)]
struct Part<const O: usize> {
    result: Vec<[f32; O]>,
    buffers: SweepBuffers<f32>,
}

impl Sweeper {
    /// [`Sweeper::run`] of a single light, directions of four ways each on a thread of the caller's pool; the sums over directions are put
    /// together in a fixed order, so that the same bytes come out for any number of threads. Where only some cells are read
    /// ([`Sweeper::read_in`]) those alone are written.
    ///
    /// Panics when an array is not one grid long.
    pub fn run_parts<const M: usize, const O: usize>(
        &self,
        emission: Emission<'_, f32, M>,
        result: &mut [[f32; O]],
        parts: &mut SweepParts<O>,
    ) {
        if self.boundary == Boundary::PeriodicXy {
            return self.run(emission, result, &mut parts.parts[0].buffers, None);
        }
        let count = self.shape.len();
        assert!(emission.source.len() == count && result.len() == count);
        parts.parts.par_iter_mut().enumerate().for_each(|(way, part)| {
            part.result.resize(count, [0.0; O]);
            let SweepBuffers { four, eight, sixteen, .. } = &mut part.buffers;
            match &self.bundles {
                Bundles::Four(pairs) => self.one_way(way, pairs, emission, &mut part.result, four),
                Bundles::Eight(pairs) => self.one_way(way, pairs, emission, &mut part.result, eight),
                Bundles::Sixteen(pairs) => self.one_way(way, pairs, emission, &mut part.result, sixteen),
            }
        });
        let nx = self.shape.nx as usize;
        let [a, b, c, d] = &parts.parts;
        for (row, sums) in result.chunks_exact_mut(nx).enumerate() {
            let [first, end] = self.spans.as_ref().map_or([0, nx], |spans| spans.wanted(row));
            for x in first..end {
                let at = row * nx + x;
                for m in 0..O {
                    sums[x][m] = a.result[at][m] + b.result[at][m] + c.result[at][m] + d.result[at][m];
                }
            }
        }
    }

    fn one_way<D: Lanes, const M: usize, const O: usize>(
        &self,
        way: usize,
        pairs: &[Pair<D>],
        emission: Emission<'_, f32, M>,
        result: &mut [[f32; O]],
        faces: &mut super::Faces<D>,
    ) {
        let Emission { cells, root_moments, source } = emission;
        // Pairs of one way stand behind one another.
        let first = pairs.iter().position(|pair| pair.way() == way).unwrap_or(pairs.len());
        let count = pairs[first..].iter().take_while(|pair| pair.way() == way).count();
        let kernel = SingleKernel {
            shape: self.shape,
            pairs: &pairs[first..first + count],
            weights: self.weights,
            face_area: self.face_area,
            cells,
            root_moments,
            source,
            result,
            faces,
            leak: None,
            spans: self.spans.as_ref(),
        };
        run(self.level, kernel);
    }
}
