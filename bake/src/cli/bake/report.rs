//! What `squall bake --json` answers.

use super::super::limits;
use super::super::progress::Bars;
use serde_json::{Map, Value, json};
use squall_bake::metrics::{Figures, METRICS};
use squall_bake::pipeline::StageReport;
use squall_bake::provenance::tool;
use squall_bake::recipe::Recipe;
use std::path::{Path, PathBuf};

/// A bake that came to its end.
pub struct Report {
    recipe: PathBuf,
    asset: PathBuf,
    pub(super) unchanged: bool,
    pub(super) seconds: f64,
    pub(super) figures: Figures,
    pub(super) stages: Vec<StageReport>,
    pub(super) preview: Option<String>,
    warnings: Vec<String>,
}

impl Report {
    pub(super) fn new(recipe: &Path, asset: &Path) -> Self {
        Self {
            recipe: recipe.to_owned(),
            asset: asset.to_owned(),
            unchanged: false,
            seconds: 0.0,
            figures: Figures::default(),
            stages: Vec::new(),
            preview: None,
            warnings: Vec::new(),
        }
    }

    /// Says what is worth knowing of the figures, and keeps it for the answer.
    pub(super) fn warn(&mut self, recipe: &Recipe, bars: &Bars) {
        self.warnings = limits::warnings(recipe, &self.figures);
        self.warnings.iter().for_each(|warning| bars.warn(warning));
    }

    pub(super) fn in_json(&self) -> Value {
        let stage = |stage: &StageReport| {
            json!({
                "stage": stage.stage,
                "made": stage.made,
                "seconds": stage.seconds,
                "bytes": stage.bytes,
                "error": stage.error,
            })
        };
        json!({
            "command": "bake",
            "tool": tool(),
            "mode": "bake",
            "recipe": self.recipe.to_string_lossy(),
            "asset": self.asset.to_string_lossy(),
            "bytes": self.figures.asset_bytes,
            "seconds": self.seconds,
            "unchanged": self.unchanged,
            "stages": self.stages.iter().map(stage).collect::<Vec<_>>(),
            "metrics": metrics(&self.figures),
            "warnings": self.warnings,
            "preview": self.preview,
        })
    }
}

/// Every metric with its figure; null where it was not measured, or is no number.
fn metrics(figures: &Figures) -> Value {
    let all = METRICS.iter().map(|metric| (metric.name.to_owned(), json!(figures.value(metric))));
    Value::Object(all.collect::<Map<_, _>>())
}
