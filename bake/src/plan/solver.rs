//! Directions and refinement of the sweeps, where a recipe asks for an error of theirs: the cheapest that comes near enough to the
//! finest, on strokes that do not confirm the result.

use super::budget::{SAFETY, TIGHTER};
use super::lights::Site;
use crate::error::BakeError;
use crate::evaluate::root_mean_square;
use crate::evaluate::views::Views;
use crate::progress::{Progress, Quiet};
use crate::recipe::model::ResponseSettings;
use crate::response::{HeldOutStroke, solve_held_out};
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::response::Stored;
use squall_runtime::relight::PointLight;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;

/// Most solve cells of the finest candidate.
const MOST_CELLS: usize = 1 << 22;
/// Iterations of choosing and confirming; after the last the finest is taken.
const ITERATIONS: usize = 4;
/// Finest refinement tried.
const MOST_REFINEMENT: u32 = 4;
/// Strokes that candidates are tried on, and as many held-out ones that confirm the chosen.
const STROKES: usize = 2;
/// Number of the first held-out stroke that confirms what was chosen of the solver: no others reach so far.
const FIRST_HELD_OUT: usize = 1 << 16;

const DIRECTIONS: [(&str, Quadrature); 4] = [
    ("26", Quadrature::Lebedev26),
    ("2x8", Quadrature::DoubleGauss { polar: 2, azimuths: 8 }),
    ("3x12", Quadrature::DoubleGauss { polar: 3, azimuths: 12 }),
    ("4x16", Quadrature::DoubleGauss { polar: 4, azimuths: 16 }),
];

/// What was chosen of the solver.
pub(super) struct SolverChoice {
    /// Settings with it.
    pub(super) settings: ResponseSettings,
    /// What to note of it.
    pub(super) record: BudgetRecord,
    /// Settings tried.
    pub(super) tried: usize,
}

/// A refinement with a direction set.
struct Candidate {
    /// Sub-cells times directions: what a sweep takes, a cell.
    cost: usize,
    refine: u32,
    name: &'static str,
    quadrature: Quadrature,
}

impl std::fmt::Display for Candidate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "refinement {}, {} directions", self.refine, self.name)
    }
}

/// Chooses refinement and directions: of those whose light on a few strokes comes near enough to the finest the cheapest, in
/// sub-cells times directions, which is what a sweep takes. Held-out strokes confirm it, others in every iteration. Where those find
/// it too far off, the next iteration asks the first strokes for as much less of what costs more.
///
/// Errors: a solve that does not converge, no held-out stroke, an interruption.
pub(super) fn choose_solver(
    site: &Site<'_>,
    settings: &ResponseSettings,
    asked: f64,
    progress: &dyn Progress,
) -> Result<SolverChoice, BakeError> {
    let spacing_m = site.usual_spacing_m();
    let lights = site.place_lights(spacing_m)?;
    let tried_on = site.tried_strokes(&lights, spacing_m)?;
    // In every iteration others, which confirm nothing else.
    let held_out = |iteration: usize| {
        let first = FIRST_HELD_OUT + iteration * STROKES;
        site.strokes(&lights, spacing_m, first..first + STROKES)
    };
    let mut search = SolverSearch::new(site, settings, &tried_on, progress)?;
    let (chosen, got) = search.choose(asked, held_out)?;
    let neighbours = search.neighbours(chosen)?;
    let Candidate { refine, quadrature, .. } = search.candidates[chosen];
    let solve = SolveSettings { quadrature, ..settings.solve };
    Ok(SolverChoice {
        settings: ResponseSettings { refine, solve, ..*settings },
        record: record(asked, &search.candidates[chosen], got, neighbours),
        tried: search.errors.iter().flatten().count(),
    })
}

/// Candidates by rising cost, and their errors as far as they are known.
struct SolverSearch<'a> {
    site: &'a Site<'a>,
    settings: &'a ResponseSettings,
    candidates: Vec<Candidate>,
    /// Strokes that candidates are tried on, as the finest solves them.
    truth: Vec<HeldOutStroke>,
    strokes: &'a [Vec<PointLight>],
    /// The error of each candidate on those strokes; each is tried once.
    errors: Vec<Option<f64>>,
    progress: &'a dyn Progress,
}

impl<'a> SolverSearch<'a> {
    fn new(
        site: &'a Site<'a>,
        settings: &'a ResponseSettings,
        strokes: &'a [Vec<PointLight>],
        progress: &'a dyn Progress,
    ) -> Result<Self, BakeError> {
        let cells = |refine: u32| site.cloud.shape.len() * refine.pow(3) as usize;
        let finest = (1..=MOST_REFINEMENT).rev().find(|&r| cells(r) <= MOST_CELLS).unwrap_or(1);
        let mut candidates = Vec::new();
        for refine in 1..=finest {
            for (name, quadrature) in DIRECTIONS {
                let cost = refine.pow(3) as usize * quadrature.ordinates()?.len();
                candidates.push(Candidate { cost, refine, name, quadrature });
            }
        }
        candidates.sort_by_key(|candidate| candidate.cost);
        progress.begin("solver budget", candidates.len() as u64);
        let errors = vec![None; candidates.len()];
        let strokes = &strokes[..strokes.len().min(STROKES)];
        let mut search = Self { site, settings, candidates, truth: Vec::new(), strokes, errors, progress };
        search.truth = search.solve(strokes, search.last())?;
        Ok(search)
    }

    /// The finest candidate, the measure of the others.
    fn last(&self) -> usize {
        self.candidates.len() - 1
    }

    fn solve(&self, strokes: &[Vec<PointLight>], at: usize) -> Result<Vec<HeldOutStroke>, BakeError> {
        let Candidate { refine, quadrature, .. } = self.candidates[at];
        let solve = SolveSettings { quadrature, ..self.settings.solve };
        // Settings are compared by what every cell of theirs holds.
        let settings = ResponseSettings { refine, solve, stored: Stored::Means, ..*self.settings };
        self.progress.check()?;
        solve_held_out(self.site.cloud, &settings, strokes, self.site.cache, &Quiet)
    }

    /// The error of a candidate on the strokes that choose.
    fn tried(&mut self, at: usize) -> Result<f64, BakeError> {
        if let Some(error) = self.errors[at] {
            return Ok(error);
        }
        self.progress.advance(1);
        let error = match at == self.last() {
            true => 0.0,
            false => self.distance(&self.solve(self.strokes, at)?, &self.truth, 0),
        };
        self.errors[at] = Some(error);
        Ok(error)
    }

    /// The cheapest candidate that held-out strokes confirm, and their error; the finest with 0 where they confirm none.
    fn choose(
        &mut self,
        asked: f64,
        held_out: impl Fn(usize) -> Vec<Vec<PointLight>>,
    ) -> Result<(usize, f64), BakeError> {
        let last = self.last();
        let (mut goal, mut at) = (asked * SAFETY, 0);
        for iteration in 0..ITERATIONS {
            while at < last && self.tried(at)? > goal {
                at += 1;
            }
            if at == last {
                break;
            }
            let strokes = held_out(iteration);
            if strokes.is_empty() {
                return Err(BakeError::NotReached {
                    what: "clouds.budget.solver_l2".into(),
                    wanted: "held-out strokes to confirm the choice".into(),
                    reached: "none that the virtual lights cover".into(),
                    hint: "strokes in the recipe, or larger bounds without prune, would give some".into(),
                });
            }
            let (found, truth) = (self.solve(&strokes, at)?, self.solve(&strokes, last)?);
            let error = self.distance(&found, &truth, 1 + iteration as u64);
            if error <= asked {
                return Ok((at, error));
            }
            // What held-out strokes refused once is not offered to others.
            at += 1;
            goal *= TIGHTER * asked / error;
        }
        Ok((last, 0.0))
    }

    /// The next candidate that is better, and the best that is cheaper, in words; their figures are those of the strokes that choose.
    fn neighbours(&mut self, chosen: usize) -> Result<[Option<String>; 2], BakeError> {
        let mut better = None;
        for at in chosen + 1..self.candidates.len() {
            let error = self.tried(at)?;
            if error < self.tried(chosen)? {
                better = Some((at, error));
                break;
            }
        }
        let mut cheaper: Option<(usize, f64)> = None;
        for at in 0..chosen {
            let error = self.tried(at)?;
            if cheaper.is_none_or(|(_, best)| error < best) {
                cheaper = Some((at, error));
            }
        }
        let words = |(at, error): (usize, f64)| {
            let candidate = &self.candidates[at];
            format!("{candidate}: L2 {:.2} %, cost {} a cell", 100.0 * error, candidate.cost)
        };
        Ok([better.map(words), cheaper.map(words)])
    }

    /// Error of strokes' light against the same strokes' by the finest, root mean square over strokes; viewpoints are those of
    /// `number`.
    fn distance(&self, found: &[HeldOutStroke], truth: &[HeldOutStroke], number: u64) -> f64 {
        let seen = truth.first().map(|stroke| stroke.seen.clone()).unwrap_or_default();
        let known = |cell: usize| seen.is_empty() || seen[cell];
        let views = Views::new(self.site.cloud, self.settings.view_region.as_ref(), number, known);
        let light = |stroke: &HeldOutStroke| views.truth(stroke, self.settings.direct).0;
        root_mean_square(found.iter().zip(truth).map(|(x, r)| views.compare(&light(x), &light(r)).l2))
    }
}

fn record(
    asked: f64,
    chosen: &Candidate,
    got: f64,
    [next_better, next_cheaper]: [Option<String>; 2],
) -> BudgetRecord {
    BudgetRecord {
        part: "transport".into(),
        metric: "held-out strokes' L2, all light, against the finest solve tried".into(),
        asked: Some(asked),
        got,
        chosen: chosen.to_string(),
        next_better,
        next_cheaper,
    }
}
