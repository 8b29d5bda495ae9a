//! What `squall bake --json` answers.

use super::super::limits;
use super::super::progress::Bars;
use serde_json::{Map, Value, json};
use squall_bake::metrics::{Figures, METRICS};
use squall_bake::pipeline::StageReport;
use squall_bake::provenance::tool;
use squall_bake::recipe::Recipe;
use squall_bake::response::cache::{CacheReport, ResponseCache};
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
    cache: Option<(PathBuf, CacheReport)>,
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
            cache: None,
        }
    }

    /// Says what the cache was good for, and keeps it for the answer.
    pub(super) fn cached(&mut self, cache: &ResponseCache, bars: &Bars) {
        let (folder, report) = (cache.folder(), cache.report());
        let CacheReport { rows_found, rows_solved, strokes_found, strokes_solved, .. } = report;
        bars.say(&format!(
            "{}: {rows_found} of {} rows and {strokes_found} of {} held-out strokes had been solved before",
            folder.display(),
            rows_found + rows_solved,
            strokes_found + strokes_solved
        ));
        if let Some(trouble) = &report.trouble {
            self.warning(format!("{}: solved light cannot be kept there: {trouble}", folder.display()), bars);
        }
        self.cache = Some((folder.to_owned(), report));
    }

    fn warning(&mut self, words: String, bars: &Bars) {
        bars.warn(&words);
        self.warnings.push(words);
    }

    /// Says what is worth knowing of the figures, and keeps it for the answer.
    pub(super) fn warn(&mut self, recipe: &Recipe, bars: &Bars) {
        for words in limits::warnings(recipe, &self.figures) {
            self.warning(words, bars);
        }
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
        let cache = self.cache.as_ref().map(|(folder, report)| {
            json!({
                "folder": folder.to_string_lossy(),
                "rows_found": report.rows_found,
                "rows_solved": report.rows_solved,
                "strokes_found": report.strokes_found,
                "strokes_solved": report.strokes_solved,
            })
        });
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
            "cache": cache,
        })
    }
}

/// Every metric with its figure; null where it was not measured, or is no number.
fn metrics(figures: &Figures) -> Value {
    let all = METRICS.iter().map(|metric| (metric.name.to_owned(), json!(figures.value(metric))));
    Value::Object(all.collect::<Map<_, _>>())
}
