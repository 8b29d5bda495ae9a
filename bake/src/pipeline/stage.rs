//! What a stage hands over.

use squall_formats::container::OutSection;
use squall_formats::section::provenance::{BudgetRecord, InputRecord};
use std::time::Instant;

/// One line of the closing table.
#[derive(Clone, Debug, PartialEq)]
pub struct StageReport {
    /// Which stage.
    pub stage: &'static str,
    /// What it made, in words.
    pub made: String,
    /// Wall-clock seconds; never inside the asset.
    pub seconds: f64,
    /// Bytes in the asset.
    pub bytes: u64,
    /// Its error, in words with unit.
    pub error: String,
}

/// Everything that a stage leaves behind; what an asset is assembled from.
#[derive(Default)]
pub(super) struct StageOutput {
    /// Sections in file order.
    pub(super) sections: Vec<OutSection>,
    /// Files that were read.
    pub(super) inputs: Vec<InputRecord>,
    /// What was asked, got and chosen.
    pub(super) budgets: Vec<BudgetRecord>,
    /// Lines of the closing table.
    pub(super) reports: Vec<StageReport>,
}

impl StageOutput {
    /// Puts another stage's output behind this one.
    pub(super) fn append(&mut self, mut next: Self) {
        self.sections.append(&mut next.sections);
        self.inputs.append(&mut next.inputs);
        self.budgets.append(&mut next.budgets);
        self.reports.append(&mut next.reports);
    }
}

/// A stage's clock.
pub(super) struct Clock(Instant);

impl Clock {
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    /// The line of the closing table for what was made since the start.
    pub(super) fn report(&self, stage: &'static str, made: String, bytes: u64, error: String) -> StageReport {
        StageReport { stage, made, seconds: self.0.elapsed().as_secs_f64(), bytes, error }
    }
}
