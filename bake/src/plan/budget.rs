//! How far a response is from what its budget asks for.

use crate::error::BakeError;
use crate::evaluate::Outcome;
use crate::recipe::model::CloudBudget;
use std::fmt::Display;

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
    /// Of the error under unseen suns.
    pub sun: f64,
}

impl Default for Margins {
    /// All of it.
    fn default() -> Self {
        Self { errors: 1.0, costs: 1.0, sun: 1.0 }
    }
}

impl Margins {
    /// What the next iteration may use after a response that exceeds what was asked for.
    pub fn tightened(self, excess: Excess) -> Self {
        let tightened = |margin: f64, over: f64| if over > 1.0 { margin * (TIGHTER / over) } else { margin };
        Self {
            errors: tightened(self.errors, excess.errors),
            costs: tightened(self.costs, excess.costs),
            sun: tightened(self.sun, excess.sun),
        }
    }
}

/// How many times what was asked for a response is; 0 where nothing was asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Excess {
    /// Of the errors the largest ratio; without bound for what is no number.
    pub errors: f64,
    /// Of bytes and milliseconds the larger ratio.
    pub costs: f64,
    /// Of the error under unseen suns.
    pub sun: f64,
}

impl Excess {
    /// The excess of `outcome` over `budget`.
    pub fn of(budget: &CloudBudget, outcome: &Outcome) -> Self {
        let ratio = |asked: Option<f64>, got: f64| match asked {
            Some(asked) if got.is_finite() => got / asked,
            Some(_) => f64::INFINITY,
            None => 0.0,
        };
        let Outcome { scores, bytes, relight_ms, .. } = outcome;
        let errors = ratio(budget.stroke_l2, scores.stroke.l2).max(ratio(budget.relit_l2, scores.codec.l2));
        let bytes = budget.bytes.map_or(0.0, |most| *bytes as f64 / most as f64);
        let costs = bytes.max(budget.relight_ms.map_or(0.0, |most| relight_ms / most));
        Self { errors, costs, sun: ratio(budget.sun_l2, outcome.sun_l2.unwrap_or(0.0)) }
    }

    /// Whether the outcome keeps within these margins of its budget.
    pub fn within(self, margins: Margins) -> bool {
        self.errors <= margins.errors && self.costs <= margins.costs && self.sun <= margins.sun
    }
}

/// What a budget asks for, one wish each.
pub(super) fn wishes(budget: &CloudBudget) -> Vec<String> {
    let asked = |name: &str, value: Option<f64>| value.map(|v| format!("{name} {v}"));
    let wishes = [
        asked("stroke_l2", budget.stroke_l2),
        asked("relit_l2", budget.relit_l2),
        asked("sun_l2", budget.sun_l2),
        budget.bytes.map(|bytes| format!("{bytes} bytes")),
        asked("relight_ms", budget.relight_ms),
    ];
    wishes.into_iter().flatten().collect()
}

/// What is said where the last `setting` that was tried does not meet the budget.
pub fn not_met(budget: &CloudBudget, measured: &Outcome, setting: &dyn Display) -> BakeError {
    let Outcome { scores, bytes, relight_ms, .. } = measured;
    BakeError::NotReached {
        what: "clouds.budget on held-out strokes".into(),
        wanted: wishes(budget).join(" and "),
        reached: format!(
            "stroke_l2 {:.4}, relit_l2 {:.4}, {bytes} bytes, relight_ms {relight_ms:.3} with {setting}",
            scores.stroke.l2, scores.codec.l2
        ),
        hint: "ask for less, or leave more of spacing_m, basis and error to the budget".into(),
    }
}
