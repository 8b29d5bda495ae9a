//! Directions and refinement of the sweeps, where a recipe asks for an error of theirs: the cheapest that comes near enough to the
//! finest, on strokes that do not judge the result.

use super::SAFETY;
use crate::error::BakeError;
use crate::progress::{Progress, Quiet};
use crate::response::evaluate::Views;
use crate::response::{ResponseSettings, TestStroke, solve_tests};
use squall_formats::section::provenance::BudgetRecord;
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;

/// Most solve cells of the finest candidate.
const MOST_CELLS: usize = 1 << 22;
/// Rounds of choosing and judging; after the last the finest is taken.
const ROUNDS: usize = 4;
/// How much further than the last figures tell a later round aims.
const TIGHTER: f64 = 0.985;
/// Finest refinement tried.
const MOST_REFINEMENT: u32 = 4;
/// Strokes that candidates are tried on, and as many others that judge the chosen.
pub const STROKES: usize = 2;

const DIRECTIONS: [(&str, Quadrature); 4] = [
    ("26", Quadrature::Lebedev26),
    ("2x8", Quadrature::DoubleGauss { polar: 2, azimuths: 8 }),
    ("3x12", Quadrature::DoubleGauss { polar: 3, azimuths: 12 }),
    ("4x16", Quadrature::DoubleGauss { polar: 4, azimuths: 16 }),
];

/// What was chosen of the solver.
pub struct SolverChoice {
    /// Settings with it.
    pub settings: ResponseSettings,
    /// What to note of it.
    pub record: BudgetRecord,
    /// Settings tried.
    pub tried: usize,
}

/// Chooses refinement and directions: of those that `strokes` find near enough to the finest the cheapest, in sub-cells times
/// directions, which is what a sweep takes. Others judge it: `hidden` gives new ones for each number. Where those find it too far
/// off, the next round asks the first for as much less of what costs more.
///
/// Errors: a solve that does not converge, no unseen stroke, an interruption.
pub fn choose_solver(
    cloud: &Cloud,
    settings: &ResponseSettings,
    (strokes, hidden): (&[Vec<PointLight>], &dyn Fn(usize) -> Vec<Vec<PointLight>>),
    asked: f64,
    progress: &dyn Progress,
) -> Result<SolverChoice, BakeError> {
    let cells = |refine: u32| cloud.shape.len() * refine.pow(3) as usize;
    let finest = (1..=MOST_REFINEMENT).rev().find(|&r| cells(r) <= MOST_CELLS).unwrap_or(1);
    let mut candidates = Vec::new();
    for refine in 1..=finest {
        for (name, quadrature) in DIRECTIONS {
            candidates.push((
                refine.pow(3) as usize * quadrature.ordinates()?.len(),
                refine,
                name,
                quadrature,
            ));
        }
    }
    candidates.sort_by_key(|&(cost, ..)| cost);
    let last = candidates.len() - 1;
    progress.begin("solver budget", candidates.len() as u64);
    let solve = |strokes: &[Vec<PointLight>], at: usize| -> Result<Vec<TestStroke>, BakeError> {
        let (_, refine, _, quadrature) = candidates[at];
        let solve = SolveSettings { quadrature, ..settings.solve };
        let settings = ResponseSettings { refine, solve, ..*settings };
        progress.check()?;
        solve_tests(cloud, &settings, strokes, &Quiet)
    };
    // The error of each candidate, tried once, on strokes that choose.
    let few = &strokes[..strokes.len().min(STROKES)];
    let truth = solve(few, last)?;
    let mut errors: Vec<Option<f64>> = vec![None; candidates.len()];
    let mut tried_on_few = |at: usize| -> Result<f64, BakeError> {
        if let Some(error) = errors[at] {
            return Ok(error);
        }
        progress.advance(1);
        let error = if at == last { 0.0 } else { error_of(cloud, settings, &solve(few, at)?, &truth, 0) };
        errors[at] = Some(error);
        Ok(error)
    };
    // Where no round is content it is the finest, the measure itself.
    let (mut chosen, mut got) = (last, 0.0);
    let (mut goal, mut from) = (asked * SAFETY, 0);
    for round in 0..ROUNDS {
        let mut at = from;
        while at < last && tried_on_few(at)? > goal {
            at += 1;
        }
        if at == last {
            break;
        }
        let others = hidden(round);
        if others.is_empty() {
            return Err(BakeError::NotReached {
                what: "clouds.budget.solver_l2".into(),
                wanted: "unseen strokes to judge by".into(),
                reached: "none that the lamps reach".into(),
                hint: "strokes in the recipe, or a larger reach without prune, would give some".into(),
            });
        }
        let found = solve(&others, at)?;
        let judged = error_of(cloud, settings, &found, &solve(&others, last)?, 1 + round as u64);
        if judged <= asked {
            (chosen, got) = (at, judged);
            break;
        }
        // What unseen strokes refused once is not offered to others.
        from = at + 1;
        goal *= TIGHTER * asked / judged;
    }
    // The neighbours' figures are those of the strokes that choose.
    let mut next_better = None;
    for at in chosen + 1..candidates.len() {
        let error = tried_on_few(at)?;
        if error < tried_on_few(chosen)? {
            next_better = Some(words(&candidates[at], error));
            break;
        }
    }
    let mut cheaper: Option<(usize, f64)> = None;
    for at in 0..chosen {
        let error = tried_on_few(at)?;
        if cheaper.is_none_or(|(_, best)| error < best) {
            cheaper = Some((at, error));
        }
    }
    let neighbours = [next_better, cheaper.map(|(at, error)| words(&candidates[at], error))];
    let record = record(asked, &candidates[chosen], got, neighbours);
    let (_, refine, _, quadrature) = candidates[chosen];
    let solve = SolveSettings { quadrature, ..settings.solve };
    let settings = ResponseSettings { refine, solve, ..*settings };
    Ok(SolverChoice { settings, record, tried: errors.iter().flatten().count() })
}

/// Error of strokes' light against the same strokes' by the finest, root mean square over strokes; eyes are those of `number`.
fn error_of(
    cloud: &Cloud,
    settings: &ResponseSettings,
    found: &[TestStroke],
    truth: &[TestStroke],
    number: u64,
) -> f64 {
    let seen = truth.first().map(|test| test.seen.clone()).unwrap_or_default();
    let known = |cell: usize| seen.is_empty() || seen[cell];
    let views = Views::new(cloud, settings.view_region.as_ref(), number, known);
    let light = |test: &TestStroke| views.truth(test, settings.direct).0;
    let square: f64 =
        found.iter().zip(truth).map(|(x, r)| views.compare(&light(x), &light(r)).l2).map(|l2| l2 * l2).sum();
    libm::sqrt(square / found.len().max(1) as f64)
}

fn words(&(cost, refine, name, _): &Candidate, error: f64) -> String {
    format!("refinement {refine}, {name} directions: L2 {:.2} %, cost {cost} a cell", 100.0 * error)
}

/// Cost a cell, refinement, and directions by name.
type Candidate = (usize, u32, &'static str, Quadrature);

fn record(
    asked: f64,
    &(_, refine, name, _): &Candidate,
    got: f64,
    [next_better, next_cheaper]: [Option<String>; 2],
) -> BudgetRecord {
    BudgetRecord {
        part: "transport".into(),
        metric: "unseen stroke's L2, all light, against the finest solve tried".into(),
        asked: Some(asked),
        got,
        chosen: format!("refinement {refine}, {name} directions"),
        next_better,
        next_cheaper,
    }
}
