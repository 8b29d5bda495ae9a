//! Directions and refinement of the sweeps, where a recipe asks for an error of theirs: the cheapest that comes near enough to the
//! finest, on strokes that do not judge the result.

use super::SAFETY;
use crate::error::BakeError;
use crate::progress::Progress;
use crate::response::judge::compare;
use crate::response::{LampGrid, ResponseSettings, Sources, bake_response};
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
    strokes: &[Vec<LampPoint>],
    asked: f64,
    progress: &dyn Progress,
) -> Result<(ResponseSettings, BudgetRecord, usize), BakeError> {
    let strokes = &strokes[..strokes.len().min(STROKES)];
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
        let lamps = LampGrid { x_m: vec![0.0], y_m: vec![0.0], z_m: vec![0.0], wanted: vec![false] };
        let sources = Sources { lamps, distant: Vec::new() };
        let baked = bake_response(cloud, &sources, &settings, strokes, &crate::progress::Quiet)?;
        progress.advance(1);
        progress.check()?;
        Ok(baked.tests.into_iter().map(|test| test.truth).collect())
    };
    let (_, refine, _, quadrature) = candidates[candidates.len() - 1];
    let truth = solve(refine, quadrature)?;
    let words = |&(cost, refine, name, _): &(usize, u32, &str, Quadrature), error: f64| {
        format!("refinement {refine}, {name} directions: L2 {:.2} %, cost {cost} a cell", 100.0 * error)
    };
    let (mut cheaper, mut chosen) = (None, None);
    for (at, candidate) in candidates.iter().enumerate() {
        let (_, refine, _, quadrature) = *candidate;
        let found = if at + 1 == candidates.len() { truth.clone() } else { solve(refine, quadrature)? };
        let square = found.iter().zip(&truth).map(|(x, r)| compare(x, r).l2.powi(2)).sum::<f64>();
        let error = libm::sqrt(square / truth.len().max(1) as f64);
        if chosen.is_none() && error <= asked * SAFETY {
            chosen = Some((*candidate, error, at));
        } else if let Some((candidate_chosen, got, _)) = chosen {
            let (_, refine, name, quadrature) = candidate_chosen;
            let solve = SolveSettings { quadrature, ..settings.solve };
            let record = BudgetRecord {
                part: "transport".into(),
                metric: "stroke L2 over 26 directions, against the finest solve tried".into(),
                asked: Some(asked),
                got,
                chosen: format!("refinement {refine}, {name} directions"),
                next_better: Some(words(candidate, error)),
                next_cheaper: cheaper,
            };
            return Ok((ResponseSettings { refine, solve, ..*settings }, record, at + 1));
        } else {
            cheaper = Some(words(candidate, error));
        }
    }
    let (_, refine, name, quadrature) = candidates[candidates.len() - 1];
    let record = BudgetRecord {
        part: "transport".into(),
        metric: "stroke L2 over 26 directions, against the finest solve tried".into(),
        asked: Some(asked),
        got: 0.0,
        chosen: format!("refinement {refine}, {name} directions: the finest"),
        next_better: None,
        next_cheaper: cheaper,
    };
    let solve = SolveSettings { quadrature, ..settings.solve };
    Ok((ResponseSettings { refine, solve, ..*settings }, record, candidates.len()))
}
