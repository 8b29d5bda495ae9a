//! MINRES: of all combinations of the sweeps so far that with the smallest residual (Paige and Saunders 1975).

use super::passes::Sums;
use super::{SolveBuffers, Solver};
use crate::lanes::{Lanes, SimdKernel};
use fearless_simd::Simd;

/// MINRES on E(I − K) e = r with r in `newest`, of norm `residual`; adds e to the solution. Ends when every lane's
/// estimate is below its goal or `budget` sweeps are spent, and returns the sweeps that each lane was at work in.
pub(super) struct Minres<'a, P, const M: usize> {
    pub(super) solver: &'a Solver<M>,
    pub(super) buffers: &'a mut SolveBuffers<P, M>,
    pub(super) residual: &'a [f64],
    pub(super) goals: &'a [f64],
    pub(super) budget: u32,
    pub(super) watch: &'a mut dyn FnMut(f64) -> bool,
}

/// The rotations of one lane's recurrence.
#[derive(Clone, Copy)]
struct Recurrence {
    active: bool,
    beta: f64,
    eta: f64,
    cos: f64,
    cos_before: f64,
    sin: f64,
    sin_before: f64,
    /// Of this step: share of the two last search directions, and of the vector, in the new one; length of the step.
    from_search: f64,
    from_before: f64,
    from_vector: f64,
    step: f64,
}

impl Recurrence {
    fn new(residual: f64, goal: f64) -> Self {
        Self {
            // A residual that is not a number is nothing that this lane could work on.
            active: residual > goal && residual.is_finite(),
            beta: 0.0,
            eta: residual,
            cos: 1.0,
            cos_before: 1.0,
            sin: 0.0,
            sin_before: 0.0,
            from_search: 0.0,
            from_before: 0.0,
            from_vector: 0.0,
            step: 0.0,
        }
    }

    /// Takes in the Lanczos step's α and β and prepares the search step.
    fn advance(&mut self, alpha: f64, beta_next: f64, goal: f64) {
        let delta = self.cos * alpha - self.cos_before * self.sin * self.beta;
        let rho = (delta * delta + beta_next * beta_next).sqrt();
        if !self.active || !rho.is_finite() || rho == 0.0 {
            // Nothing more to gain from this lane; its solution stays as it is.
            self.active = false;
            (self.from_search, self.from_before, self.from_vector, self.step) = (0.0, 0.0, 0.0, 0.0);
            return;
        }
        self.from_search = -(self.sin * alpha + self.cos_before * self.cos * self.beta) / rho;
        self.from_before = -(self.sin_before * self.beta) / rho;
        self.from_vector = 1.0 / rho;
        let (cos, sin) = (delta / rho, beta_next / rho);
        self.step = cos * self.eta;
        self.eta *= -sin;
        (self.cos_before, self.cos, self.sin_before, self.sin) = (self.cos, cos, self.sin, sin);
        self.beta = beta_next;
        self.active = self.eta.abs() > goal && beta_next > 0.0;
    }
}

impl<P: Lanes, const M: usize> SimdKernel for Minres<'_, P, M> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Vec<u32> {
        let solver = self.solver;
        let SolveBuffers { faces, solution, swept, before, newest, search, search_before, .. } = self.buffers;
        let mut lanes: Vec<Recurrence> =
            self.residual.iter().zip(self.goals).map(|(&r, &goal)| Recurrence::new(r, goal)).collect();
        let pack = |lanes: &[Recurrence], f: &dyn Fn(&Recurrence) -> f64| P::from_fn(|l| f(&lanes[l]) as f32);
        let zero = [P::splat(0.0); M];
        before.fill(zero);
        search.fill(zero);
        search_before.fill(zero);
        let unit = P::from_fn(|l| if lanes[l].active { (1.0 / self.residual[l]) as f32 } else { 0.0 });
        let unit = unit.load(simd);
        for v in newest.iter_mut() {
            for m in 0..M {
                v[m] = P::store(v[m].load(simd) * unit);
            }
        }
        let (mut used, mut steps) = (0, vec![0; lanes.len()]);
        while used < self.budget && lanes.iter().any(|lane| lane.active) {
            solver.sweeper.run(solver.emission(newest), swept, faces, None);
            used += 1;
            for (steps, lane) in steps.iter_mut().zip(&lanes) {
                *steps += u32::from(lane.active);
            }
            let mut alpha = Sums::new();
            for cell in 0..solution.len() {
                let root = solver.root(cell);
                for m in 0..M {
                    let left = newest[cell][m].load(simd) - swept[cell][m].load(simd) * root[m];
                    swept[cell][m] = P::store(left * solver.flip[m]);
                }
                alpha.add(simd, &newest[cell], &swept[cell]);
            }
            let alpha = alpha.lanes::<P>();
            let along = P::from_fn(|l| alpha[l] as f32).load(simd);
            let along_before = pack(&lanes, &|lane| lane.beta).load(simd);
            let mut beta = Sums::new();
            for cell in 0..solution.len() {
                for m in 0..M {
                    let rest = swept[cell][m].load(simd)
                        - newest[cell][m].load(simd) * along
                        - before[cell][m].load(simd) * along_before;
                    swept[cell][m] = P::store(rest);
                }
                beta.add(simd, &swept[cell], &swept[cell]);
            }
            let beta: Vec<f64> = beta.lanes::<P>().into_iter().map(f64::sqrt).collect();
            for (l, lane) in lanes.iter_mut().enumerate() {
                lane.advance(alpha[l], beta[l], self.goals[l]);
            }
            let from_vector = pack(&lanes, &|lane| lane.from_vector).load(simd);
            let from_search = pack(&lanes, &|lane| lane.from_search).load(simd);
            let from_before = pack(&lanes, &|lane| lane.from_before).load(simd);
            let step = pack(&lanes, &|lane| lane.step).load(simd);
            let unit = P::from_fn(|l| if lanes[l].active { (1.0 / beta[l]) as f32 } else { 0.0 });
            let unit = unit.load(simd);
            for cell in 0..solution.len() {
                for m in 0..M {
                    let w = newest[cell][m].load(simd) * from_vector
                        + search[cell][m].load(simd) * from_search
                        + search_before[cell][m].load(simd) * from_before;
                    search_before[cell][m] = P::store(w);
                    solution[cell][m] = P::store(solution[cell][m].load(simd) + w * step);
                    swept[cell][m] = P::store(swept[cell][m].load(simd) * unit);
                }
            }
            std::mem::swap(search, search_before);
            // The newest vector becomes the one before, the swept one the newest.
            std::mem::swap(before, newest);
            std::mem::swap(newest, swept);
            let over =
                |(lane, goal): (&Recurrence, &f64)| if lane.active { lane.eta.abs() / goal } else { 0.0 };
            if !(self.watch)(lanes.iter().zip(self.goals).map(over).fold(0.0, f64::max)) {
                break;
            }
        }
        steps
    }
}
