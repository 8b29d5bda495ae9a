//! Directions and refinement of the sweeps, where a recipe asks for an error of theirs: the cheapest that comes near enough to the
//! finest, on strokes that do not judge the result.

use super::SAFETY;
use crate::error::BakeError;
use crate::progress::Progress;
use crate::response::judge::compare;
use crate::response::{ResponseSettings, solve_tests};
use squall_formats::section::provenance::BudgetRecord;
use squall_runtime::relight::LampPoint;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::SolveSettings;

/// Most solve cells of the finest candidate.
const MOST_CELLS: usize = 1 << 22;
/// Finest refinement tried.
const MOST_REFINEMENT: u32 = 4;
/// Strokes that candidates are tried on.
const STROKES: usize = 2;

const DIRECTIONS: [(&str, Quadrature); 4] = [
    ("26", Quadrature::Lebedev26),
    ("2x8", Quadrature::DoubleGauss { polar: 2, azimuths: 8 }),
    ("3x12", Quadrature::DoubleGauss { polar: 3, azimuths: 12 }),
    ("4x16", Quadrature::DoubleGauss { polar: 4, azimuths: 16 }),
];

/// Chooses refinement and directions; the settings, what to note of them, and how many were tried. The cost is sub-cells times
/// directions: what a sweep takes.
///
/// Errors: a solve that does not converge, an interruption.
pub fn choose_solver(
    cloud: &Cloud,
    settings: &ResponseSettings,
    [strokes, unseen]: &[Vec<Vec<LampPoint>>; 2],
    asked: f64,
    progress: &dyn Progress,
) -> Result<(ResponseSettings, BudgetRecord, usize), BakeError> {
    // Strokes that choose, and behind them those that judge.
    let (few, judges) = (strokes.len().min(STROKES), unseen.len().min(STROKES));
    let strokes: Vec<Vec<LampPoint>> = strokes[..few].iter().chain(&unseen[..judges]).cloned().collect();
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
    progress.begin("solver budget", candidates.len() as u64);
    let solve = |refine: u32, quadrature: Quadrature| -> Result<Vec<Vec<f32>>, BakeError> {
        let solve = SolveSettings { quadrature, ..settings.solve };
        let settings = ResponseSettings { refine, solve, ..*settings };
        let tests = solve_tests(cloud, &settings, &strokes, &crate::progress::Quiet)?;
        progress.advance(1);
        progress.check()?;
        Ok(tests.into_iter().map(|test| test.truth).collect())
    };
    let (_, refine, _, quadrature) = candidates[candidates.len() - 1];
    let truth = solve(refine, quadrature)?;
    let words = |&(cost, refine, name, _): &(usize, u32, &str, Quadrature), error: f64| {
        format!("refinement {refine}, {name} directions: L2 {:.2} %, cost {cost} a cell", 100.0 * error)
    };
    let error = |found: &[Vec<f32>], range: std::ops::Range<usize>| {
        let count = range.len().max(1) as f64;
        let square: f64 = range.map(|at| compare(&found[at], &truth[at]).l2).map(|l2| l2 * l2).sum();
        libm::sqrt(square / count)
    };
    let last = candidates.len() - 1;
    let mut cheaper: Option<(String, f64)> = None;
    let mut chosen = None;
    for (at, candidate) in candidates.iter().enumerate() {
        let (_, refine, _, quadrature) = *candidate;
        let found = if at == last { truth.clone() } else { solve(refine, quadrature)? };
        let tried = error(&found, 0..few);
        let judged = if judges > 0 { error(&found, few..few + judges) } else { tried };
        match chosen {
            None if at == last || tried <= asked * SAFETY && judged <= asked => {
                chosen = Some((*candidate, judged, at + 1));
            }
            None if cheaper.as_ref().is_none_or(|(_, best)| judged < *best) => {
                cheaper = Some((words(candidate, judged), judged));
            }
            // The first that costs more and is better.
            Some((mine, got, tried)) if judged < got => {
                let better = Some(words(candidate, judged));
                return Ok(finished(settings, asked, (mine, got), [better, cheaper.map(|c| c.0)], tried));
            }
            _ => {}
        }
    }
    let (mine, got, tried) = chosen.unwrap_or((candidates[last], 0.0, candidates.len()));
    Ok(finished(settings, asked, (mine, got), [None, cheaper.map(|c| c.0)], tried))
}

/// Cost a cell, refinement, and directions by name.
type Candidate = (usize, u32, &'static str, Quadrature);

fn finished(
    settings: &ResponseSettings,
    asked: f64,
    ((_, refine, name, quadrature), got): (Candidate, f64),
    [next_better, next_cheaper]: [Option<String>; 2],
    tried: usize,
) -> (ResponseSettings, BudgetRecord, usize) {
    let record = BudgetRecord {
        part: "transport".into(),
        metric: "unseen stroke's L2 over 26 directions, against the finest solve tried".into(),
        asked: Some(asked),
        got,
        chosen: format!("refinement {refine}, {name} directions"),
        next_better,
        next_cheaper,
    };
    let solve = SolveSettings { quadrature, ..settings.solve };
    (ResponseSettings { refine, solve, ..*settings }, record, tried)
}
