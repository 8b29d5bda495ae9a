//! How far a response is from what its budget asks for.

use crate::evaluate::Scores;
use crate::recipe::model::CloudBudget;

/// A choice aims below its budget by this factor: strokes that it does not see may be a little worse off.
pub(super) const SAFETY: f64 = 0.97;
/// How much further than the last figures tell a later iteration aims.
pub const TIGHTER: f64 = 0.985;

/// How much of each budget a choice may use: less than all where what was baked turned out worse than what was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Of the errors asked for.
    pub errors: f64,
    /// Of the bytes and milliseconds.
    pub costs: f64,
}

impl Default for Margins {
    /// All of it.
    fn default() -> Self {
        Self { errors: 1.0, costs: 1.0 }
    }
}

impl Margins {
    /// What the next iteration may use after a response whose errors are `over` and whose costs are `over_cost` times what was
    /// asked for.
    pub fn tightened(self, over: f64, over_cost: f64) -> Self {
        let tightened = |margin: f64, over: f64| if over > 1.0 { margin * (TIGHTER / over) } else { margin };
        Self { errors: tightened(self.errors, over), costs: tightened(self.costs, over_cost) }
    }
}

/// The largest ratio of an error to what was asked; 0 where nothing was, without bound for what is no number.
pub fn over(budget: &CloudBudget, scores: &Scores) -> f64 {
    let ratio = |asked: Option<f64>, got: f64| match asked {
        Some(asked) if got.is_finite() => got / asked,
        Some(_) => f64::INFINITY,
        None => 0.0,
    };
    ratio(budget.stroke_l2, scores.stroke.l2).max(ratio(budget.relit_l2, scores.codec.l2))
}

/// The larger ratio of a response's bytes and of what a stroke counts for to what was asked; 0 where nothing was.
pub fn over_cost(budget: &CloudBudget, bytes: u64, relight_ms: f64) -> f64 {
    let bytes = budget.bytes.map_or(0.0, |most| bytes as f64 / most as f64);
    bytes.max(budget.relight_ms.map_or(0.0, |most| relight_ms / most))
}

/// What a budget asks for, one wish each.
pub fn wishes(budget: &CloudBudget) -> Vec<String> {
    let asked = |name: &str, value: Option<f64>| value.map(|v| format!("{name} {v}"));
    let wishes = [
        asked("stroke_l2", budget.stroke_l2),
        asked("relit_l2", budget.relit_l2),
        budget.bytes.map(|bytes| format!("{bytes} bytes")),
        asked("relight_ms", budget.relight_ms),
    ];
    wishes.into_iter().flatten().collect()
}
