//! One sweep from any light: what it scatters, and how far it was from agreeing with that.

use super::{GATHERED, Solver};
use crate::sweep::{Emission, SweepParts};

/// Memory of [`Solver::sweep_once`].
#[derive(Clone, Debug, Default)]
pub struct OneSweep {
    source: Vec<[f32; 4]>,
    parts: SweepParts<GATHERED>,
}

/// ‖T S (φ + φ_direct) − φ‖ and ‖T S (φ + φ_direct)‖, in the norm weighted by √S.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepNorms {
    /// Of what the sweep changed: the residual of the light that it started from.
    pub change: f64,
    /// Of what it left.
    pub size: f64,
}

impl Solver<4> {
    /// T S (φ + φ_direct): one transport sweep from moments φ of scattered light and those of direct light, of a single light, both mean
    /// per cell, into `result`. The same bytes come out for any number of threads.
    ///
    /// Of φ the moments up to degree 1 are used, in cells with cloud. Where this solver's sweeps are read in some cells alone
    /// ([`Solver::read_in`]) those alone are written.
    ///
    /// Panics when an array is not one grid long.
    pub fn sweep_once(
        &self,
        moments: &[[f32; GATHERED]],
        direct: &[[f32; 4]],
        result: &mut Vec<[f32; GATHERED]>,
        memory: &mut OneSweep,
    ) -> SweepNorms {
        let count = self.cells.extinction.len();
        assert!(moments.len() == count && direct.len() == count);
        memory.source.resize(count, [0.0; 4]);
        for (cell, source) in memory.source.iter_mut().enumerate() {
            if self.cells.root_scattering[cell] > 0.0 {
                let root = self.root(cell);
                for m in 0..4 {
                    source[m] = root[m] * (moments[cell][m] + direct[cell][m]);
                }
            }
        }
        result.resize(count, [0.0; GATHERED]);
        let emission: Emission<'_, f32, 4> = self.emission(&memory.source);
        self.sweeper.run_parts(emission, result, &mut memory.parts);
        let (mut change, mut size) = (0.0f64, 0.0f64);
        for cell in (0..count).filter(|&cell| self.cells.root_scattering[cell] > 0.0) {
            let root = self.root(cell);
            for m in 0..4 {
                let after = f64::from(root[m] * result[cell][m]);
                let before = f64::from(root[m] * moments[cell][m]);
                change += (after - before) * (after - before);
                size += after * after;
            }
        }
        SweepNorms { change: change.sqrt(), size: size.sqrt() }
    }
}
