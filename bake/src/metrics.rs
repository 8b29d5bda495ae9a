//! The figures that were measured of an asset, by short names that stay: what `squall bake --max-error` and `--json` speak of.

use squall_formats::section::provenance::{BudgetRecord, ProvenanceSection};
use squall_formats::section::streak::StreakSection;

/// A figure that an asset may have been measured by. Smaller is better in all of them.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Its name in commands and in JSON.
    pub name: &'static str,
    /// What it is, with its unit.
    pub meaning: &'static str,
    /// What would have it measured where it was not.
    pub measured_with: &'static str,
    /// The part that its record is for, and words that are in the record's own name.
    record: Option<(&'static str, &'static str)>,
}

const STROKES: &str = "clouds with test_strokes above 0";

/// All of them.
pub const METRICS: [Metric; 15] = [
    Metric {
        name: "stroke_l2",
        meaning: "relative L2 error of held-out strokes, all light, against the strokes solved directly",
        measured_with: STROKES,
        record: Some(("lightning grid", "stroke L2")),
    },
    Metric {
        name: "stroke_median",
        meaning: "median pointwise relative error of the same",
        measured_with: STROKES,
        record: Some(("lightning grid", "median pointwise stroke")),
    },
    Metric {
        name: "relit_l2",
        meaning: "relative L2 error that coding costs held-out strokes",
        measured_with: STROKES,
        record: Some(("response codec", "relit L2")),
    },
    Metric {
        name: "relit_tail",
        meaning: "99.9th percentile of that error, over the peak",
        measured_with: STROKES,
        record: Some(("response codec", "99.9th percentile")),
    },
    Metric {
        name: "relit_median",
        meaning: "median pointwise relative error of the same",
        measured_with: STROKES,
        record: Some(("response codec", "median pointwise relit")),
    },
    Metric {
        name: "solver_l2",
        meaning: "relative L2 error of a held-out stroke against the finest solve tried",
        measured_with: "solver_l2 in [clouds.budget]",
        record: Some(("transport", "finest solve")),
    },
    Metric {
        name: "sun_l2",
        meaning: "relative L2 error under suns that no beam was baked for, direct light included, against direct solves",
        measured_with: "sun = \"anywhere\" or a path in [clouds.response]",
        record: Some(("sun", "unseen suns")),
    },
    Metric {
        name: "light_cells_l2",
        meaning: "relative L2 error of a held-out stroke's light on blocks of cells, against a solve on the cells themselves",
        measured_with: "cells in [clouds.response] and test_strokes above 0",
        record: Some(("light cells", "shown cells")),
    },
    Metric {
        name: "residual",
        meaning: "largest residual of a solve, relative to the first scattering",
        measured_with: "clouds",
        record: Some(("transport", "largest residual")),
    },
    Metric {
        name: "relight_ms",
        meaning: "what relighting the most that flashes at once counts for on one core, ms",
        measured_with: STROKES,
        record: Some(("relighting", "relighting the most")),
    },
    Metric {
        name: "density_error",
        meaning: "largest relative error of a class's count between nodes",
        measured_with: "rain",
        record: Some(("density", "largest relative error")),
    },
    Metric {
        name: "class_error",
        meaning: "largest RMS relative error of drops' fall within their classes",
        measured_with: "rain",
        record: Some(("density", "fall within their classes")),
    },
    Metric {
        name: "streak_rms",
        meaning: "RMS error of the worst streak pattern, over white: 10^(-PSNR/20)",
        measured_with: "pictures in [rain.streaks]",
        record: None,
    },
    Metric {
        name: "response_bytes",
        meaning: "bytes of the cloud's response",
        measured_with: "clouds",
        record: None,
    },
    Metric { name: "asset_bytes", meaning: "bytes of the asset", measured_with: "an asset", record: None },
];

/// The metric of a name.
pub fn metric(name: &str) -> Option<&'static Metric> {
    METRICS.iter().find(|metric| metric.name == name)
}

/// What an asset was measured to be.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// Figures kept with the asset.
    pub budgets: Vec<BudgetRecord>,
    /// Largest RMS error of a streak pattern.
    pub streak_rms: Option<f64>,
    /// Bytes of the response.
    pub response_bytes: Option<u64>,
    /// Bytes in all.
    pub asset_bytes: u64,
}

impl Figures {
    /// Figures out of an asset's sections.
    pub fn new(
        provenance: &ProvenanceSection,
        streaks: Option<&StreakSection>,
        response_bytes: Option<u64>,
        asset_bytes: u64,
    ) -> Self {
        let psnr = streaks.map(|section| section.patterns.iter().map(|pattern| pattern.psnr_db));
        let worst = psnr.and_then(|all| all.min_by(f64::total_cmp));
        Self {
            budgets: provenance.budgets.clone(),
            streak_rms: worst.map(|psnr_db| libm::pow(10.0, -psnr_db / 20.0)),
            response_bytes,
            asset_bytes,
        }
    }

    /// The figure, where it was measured.
    pub fn value(&self, metric: &Metric) -> Option<f64> {
        match (metric.record, metric.name) {
            (Some((part, words)), _) => {
                let is_it = |record: &&BudgetRecord| record.part == part && record.metric.contains(words);
                self.budgets.iter().find(is_it).map(|record| record.got)
            }
            (None, "streak_rms") => self.streak_rms,
            (None, "response_bytes") => self.response_bytes.map(|bytes| bytes as f64),
            (None, _) => Some(self.asset_bytes as f64),
        }
    }
}
