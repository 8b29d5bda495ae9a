//! What an asset's provenance keeps of a response: what was asked, got and chosen.

use crate::evaluate::{Outcome, Scores};
use crate::plan::Plan;
use crate::recipe::model::CloudBudget;
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::response::{Codec, NO_ROW, ResponseHead, SweepScheme};

/// All records of a response; `measured` is what the written bytes were found to give and take.
pub(super) fn records(
    budget: &CloudBudget,
    head: &ResponseHead,
    plan: &Plan,
    measured: &Outcome,
) -> Vec<BudgetRecord> {
    let mut records = error_records(budget, head, plan, &measured.scores);
    records.extend(cost_records(budget, plan, measured));
    records.extend(sun_record(budget, plan, measured.sun_l2));
    records.extend(cell_record(head));
    records.extend(solver_records(head, plan));
    records
}

/// A record without neighbours.
fn record(
    part: &str,
    metric: impl Into<String>,
    asked: Option<f64>,
    got: f64,
    chosen: String,
) -> BudgetRecord {
    BudgetRecord {
        part: part.into(),
        metric: metric.into(),
        asked,
        got,
        chosen,
        next_better: None,
        next_cheaper: None,
    }
}

/// Gives a record the plan's neighbours where it is what the plan chose by.
fn beside(record: BudgetRecord, plan: &Plan, chose: bool) -> BudgetRecord {
    if !chose {
        return record;
    }
    let (next_better, next_cheaper) = (plan.next_better.clone(), plan.next_cheaper.clone());
    BudgetRecord { next_better, next_cheaper, ..record }
}

fn error_records(
    budget: &CloudBudget,
    head: &ResponseHead,
    plan: &Plan,
    scores: &Scores,
) -> Vec<BudgetRecord> {
    let name = match head.codec {
        Codec::Entropy => "entropy",
        Codec::Bytes => "bytes",
        Codec::Paper => "paper",
    };
    let codec = || format!("codec {name}, error {:.3e}", plan.settings.relative_error);
    let ([nx, ny, nz], baked) = head.sources.light_grid().map_or(([0; 3], 0), |(grid, rows)| {
        (grid.axes().map(<[f64]>::len), rows.iter().filter(|&&row| row != NO_ROW).count())
    });
    let count = head.basis.count();
    let finer: usize = head.finer.iter().map(|level| level.nodes.len()).sum();
    let finer = if finer > 0 { format!(" and {finer} between them") } else { String::new() };
    let grid = || format!("{baked} of {nx} × {ny} × {nz} virtual lights{finer}, {count} coefficients a cell");
    let relit = "relit L2 on held-out strokes, against the same rows uncompressed";
    let chose_codec = budget.relit_l2.is_some() && budget.stroke_l2.is_none();
    let part = "response codec";
    let tail = "99.9th percentile of the relit error, over the peak";
    let views = if head.view_region.is_some() { "held-out viewpoints" } else { "26 directions" };
    let stroke = format!("stroke L2 over {views}, against the stroke solved directly");
    let stroke = record("lightning grid", stroke, budget.stroke_l2, scores.stroke.l2, grid());
    vec![
        beside(record(part, relit, budget.relit_l2, scores.codec.l2, codec()), plan, chose_codec),
        record(part, tail, None, scores.codec.tail, codec()),
        record(part, "median pointwise relit error", None, scores.codec.median, codec()),
        beside(stroke, plan, budget.stroke_l2.is_some()),
        record("lightning grid", "median pointwise stroke error", None, scores.stroke.median, grid()),
    ]
}

fn cost_records(budget: &CloudBudget, plan: &Plan, measured: &Outcome) -> Vec<BudgetRecord> {
    let alone = budget.costs() && !budget.errors();
    let mut records = Vec::new();
    if let Some(most) = budget.bytes {
        let bytes = record("response", "bytes", Some(most as f64), measured.bytes as f64, plan.to_string());
        records.push(beside(bytes, plan, alone));
    }
    let metric = "relighting the most that flashes at once, on one core, ms as counted (docs/recipe.md)";
    let relight = record("relighting", metric, budget.relight_ms, measured.relight_ms, plan.to_string());
    records.push(beside(relight, plan, alone && budget.bytes.is_none()));
    records
}

/// How far the cloud's light is off under suns that no beam was baked for, where that was measured.
pub(super) fn sun_record(budget: &CloudBudget, plan: &Plan, sun_l2: Option<f64>) -> Option<BudgetRecord> {
    let (sun, got) = (plan.sun.as_ref()?, sun_l2?);
    let metric = "L2 under unseen suns, direct light included, against direct solves";
    let [next_better, next_cheaper] = sun.neighbours.clone();
    let bare = record("sun", metric, budget.sun_l2, got, sun.to_string());
    Some(BudgetRecord { next_better, next_cheaper, ..bare })
}

/// How many cells hold light, where not all do.
fn cell_record(head: &ResponseHead) -> Option<BudgetRecord> {
    let cells = head.shape.len();
    let seen = (0..cells).filter(|&cell| head.sees(cell)).count();
    let viewers = if head.view_region.is_some() { "a viewpoint of the recipe" } else { "any viewpoint" };
    let metric = format!("share of cells that {viewers} can shade with");
    let chosen = format!("{seen} of {cells} cells hold light");
    (seen < cells).then(|| record("cells", metric, None, seen as f64 / cells as f64, chosen))
}

/// Records of how light was solved.
pub(super) fn solver_records(head: &ResponseHead, plan: &Plan) -> Vec<BudgetRecord> {
    let settings = &plan.settings;
    let scheme = match head.solver.scheme {
        SweepScheme::Weighted => "weighted",
        SweepScheme::Diamond => "diamond",
        SweepScheme::Step => "step",
    };
    let directions = settings.solve.quadrature.ordinates().map_or(0, |set| set.len());
    let chosen = format!("refinement {}, {directions} directions, {scheme} scheme", settings.refine);
    let solver = &head.solver;
    let residual =
        record("transport", "largest residual", Some(solver.tolerance), solver.worst_residual, chosen);
    std::iter::once(residual).chain(plan.solver.clone()).collect()
}
