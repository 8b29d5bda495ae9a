//! Passes over all cells: residual of a solution, and the last sweep that gathers its moments.

use super::{GATHERED, SolveBuffers, Solver};
use crate::lanes::{Lanes, SimdKernel};
use crate::sweep::Leak;
use fearless_simd::Simd;

/// Sums over the grid, one a lane: single precision inside a cell, double across cells, in index order.
pub(super) struct Sums {
    total: [f64; 16],
}

impl Sums {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self { total: [0.0; 16] }
    }

    #[inline(always)]
    pub(super) fn add<S: Simd, P: Lanes, const M: usize>(&mut self, simd: S, a: &[P; M], b: &[P; M]) {
        let mut sum = a[0].load(simd) * b[0].load(simd);
        for m in 1..M {
            sum = sum + a[m].load(simd) * b[m].load(simd);
        }
        let sum = P::store(sum);
        for lane in 0..P::COUNT {
            self.total[lane] += f64::from(sum.lane(lane));
        }
    }

    #[inline(always)]
    pub(super) fn lanes<P: Lanes>(&self) -> Vec<f64> {
        self.total[..P::COUNT].to_vec()
    }
}

/// Leaves E (K (z + direct) − z) in `newest`; its norm per lane comes back.
pub(super) struct Residual<'a, P, const M: usize> {
    pub(super) solver: &'a Solver<M>,
    pub(super) buffers: &'a mut SolveBuffers<P, M>,
}

impl<P: Lanes, const M: usize> SimdKernel for Residual<'_, P, M> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Vec<f64> {
        let SolveBuffers { faces, direct, solution, swept, before, newest, .. } = self.buffers;
        let solver = self.solver;
        for (sum, (z, d)) in before.iter_mut().zip(solution.iter().zip(direct.iter())) {
            for m in 0..M {
                sum[m] = P::store(z[m].load(simd) + d[m].load(simd));
            }
        }
        solver.sweeper.run(solver.emission(before), swept, faces, None);
        let mut norm = Sums::new();
        for cell in 0..solution.len() {
            let root = solver.root(cell);
            for m in 0..M {
                let left = swept[cell][m].load(simd) * root[m] - solution[cell][m].load(simd);
                newest[cell][m] = P::store(left * solver.flip[m]);
            }
            norm.add(simd, &newest[cell], &newest[cell]);
        }
        norm.lanes::<P>().into_iter().map(f64::sqrt).collect()
    }
}

/// One last sweep, from the solution to all gathered moments; returns the norm of the residual that it shows.
pub(super) struct Gather<'a, P, const M: usize> {
    pub(super) solver: &'a Solver<M>,
    pub(super) buffers: &'a mut SolveBuffers<P, M>,
    pub(super) gathered: &'a mut [[P; GATHERED]],
    pub(super) leak: Option<&'a mut Leak>,
}

impl<P: Lanes, const M: usize> SimdKernel for Gather<'_, P, M> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Vec<f64> {
        let solver = self.solver;
        let SolveBuffers { faces, direct, solution, before, .. } = self.buffers;
        for (sum, (z, d)) in before.iter_mut().zip(solution.iter().zip(direct.iter())) {
            for m in 0..M {
                sum[m] = P::store(z[m].load(simd) + d[m].load(simd));
            }
        }
        solver.sweeper.run(solver.emission(before), self.gathered, faces, self.leak);
        let mut norm = Sums::new();
        for cell in 0..solution.len() {
            let root = solver.root(cell);
            let mut left = [P::splat(0.0); M];
            for m in 0..M {
                left[m] =
                    P::store(self.gathered[cell][m].load(simd) * root[m] - solution[cell][m].load(simd));
            }
            norm.add(simd, &left, &left);
        }
        norm.lanes::<P>().into_iter().map(f64::sqrt).collect()
    }
}
