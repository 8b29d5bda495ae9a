//! Speed against accuracy: every knob swept, error against an independent truth beside cost, measured in one run.
//!
//! A row is one setting's error in one measure beside its cost in one measure. Times are processor time of one thread, so that
//! other work on the machine shows little; the median over repeats is given with the 10th and 90th percentile. Which setting is the
//! recipe's own and which is a paper's is marked, and so is the Pareto front: settings that nothing beats in both.

mod clock;
mod compression;
mod density;
mod end_to_end;
mod frame;
mod gathers;
mod lightning;
mod peers;
pub mod picture_kernel;
pub mod rain_baselines;
pub mod rain_frame;
mod rain_table;
mod scene;
mod streaks;
mod transport;

use crate::error::BakeError;
use crate::progress::Progress;
use crate::recipe::Recipe;
pub use peers::{Peer, Peers};
use serde::{Deserialize, Deserializer, Serialize};
use std::path::PathBuf;

/// Charts by their ids, in the order of the page, each with the question that it answers.
pub const CHARTS: [(&str, &str); 10] = [
    ("streaks", "How many cosines does a streak need?"),
    ("density", "How large must the table of counts be?"),
    ("transport", "How finely must light be solved for?"),
    ("lightning-grid", "How many virtual lights does a stroke need?"),
    ("gathers", "What do sweeps at run time bring?"),
    ("compression", "How many bytes does a response need?"),
    ("end-to-end", "Where does baking start to pay?"),
    ("frame", "What does a frame cost, and for which part?"),
    ("rain-frame", "What does rain cost a frame?"),
    ("rain-table", "What do rain and lens make of that?"),
];

/// Measures of likeness, of which more is better; of all others less is. They are read on an even scale, the others on a
/// logarithmic one.
const LIKENESS: [&str; 2] = [streaks::PSNR, streaks::SSIM];

/// Whether more of the measure called `name` is better.
pub fn rises(name: &str) -> bool {
    LIKENESS.contains(&name)
}

/// Median, 10th and 90th percentile of a cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Median.
    pub median: f64,
    /// 10th percentile.
    pub p10: f64,
    /// 90th percentile.
    pub p90: f64,
}

impl Cost {
    /// A cost that is counted, not timed.
    pub fn exact(value: f64) -> Self {
        Self { median: value, p10: value, p90: value }
    }
}

/// One point of a chart.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Chart id.
    pub chart: String,
    /// The line it lies on.
    pub series: String,
    /// The setting, in words.
    pub setting: String,
    /// What the error is measured against.
    pub truth: String,
    /// What the error is, with unit.
    pub error_metric: String,
    /// The error; no number where a paper gives a cost alone.
    #[serde(deserialize_with = "number_or_none")]
    pub error: f64,
    /// What the cost is, with unit.
    pub cost_metric: String,
    /// Median cost.
    pub cost_median: f64,
    /// 10th percentile of the cost.
    pub cost_p10: f64,
    /// 90th percentile of the cost.
    pub cost_p90: f64,
    /// Bytes in the asset, where the setting has any.
    pub bytes: Option<u64>,
    /// Whether no other point of its panel is both cheaper and better.
    pub pareto: bool,
    /// Whether it is the recipe's own setting.
    pub chosen: bool,
    /// Whether it is a paper's method or setting.
    pub baseline: bool,
}

/// JSON has no word for what is no number but null.
fn number_or_none<'de, D: Deserializer<'de>>(value: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(value)?.unwrap_or(f64::NAN))
}

/// A setting with everything that was measured of it; becomes one row for each pair of an error and a cost.
#[derive(Clone, Debug)]
pub struct Point {
    /// The line it lies on.
    pub series: String,
    /// The setting, in words.
    pub setting: String,
    /// What errors are measured against.
    pub truth: String,
    /// Errors.
    pub errors: Vec<(&'static str, f64)>,
    /// Costs.
    pub costs: Vec<(&'static str, Cost)>,
    /// Bytes in the asset.
    pub bytes: Option<u64>,
    /// Whether it is the recipe's own.
    pub chosen: bool,
    /// Whether it is a paper's.
    pub baseline: bool,
}

impl Point {
    fn rows(&self, chart: &str, pairs: &[(&str, &str)], rows: &mut Vec<Row>) {
        for &(error_name, cost_name) in pairs {
            let error = self.errors.iter().find(|(name, _)| *name == error_name);
            let cost = self.costs.iter().find(|(name, _)| *name == cost_name);
            let (Some((_, error)), Some((_, cost))) = (error, cost) else { continue };
            rows.push(Row {
                chart: chart.into(),
                series: self.series.clone(),
                setting: self.setting.clone(),
                truth: self.truth.clone(),
                error_metric: error_name.into(),
                error: *error,
                cost_metric: cost_name.into(),
                cost_median: cost.median,
                cost_p10: cost.p10,
                cost_p90: cost.p90,
                bytes: self.bytes,
                pareto: false,
                chosen: self.chosen,
                baseline: self.baseline,
            });
        }
    }
}

/// What to sweep, and how thoroughly.
pub struct Sweep<'a> {
    /// The recipe.
    pub recipe: &'a Recipe,
    /// Fewer settings on smaller scenes: minutes become seconds.
    pub quick: bool,
    /// Folder with independent reference data, laid out as the reference's README says; those series are left out without it.
    pub reference: Option<PathBuf>,
    /// Codecs from outside that `compression` shows beside ours; none where none are asked for.
    pub peers: Option<Peers>,
    /// Charts to make; all where empty.
    pub only: Vec<String>,
}

/// Sweeps, chart by chart in the order of [`CHARTS`]. Charts of parts that the recipe does not have are left out.
///
/// Errors: an input that is missing or damaged, a solve that does not converge, an interruption.
pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Row>, BakeError> {
    let mut rows = Vec::new();
    for (id, _) in CHARTS {
        if !task.only.is_empty() && !task.only.iter().any(|only| only == id) {
            continue;
        }
        progress.check()?;
        let (points, pairs): (Vec<Point>, &[(&str, &str)]) = match id {
            "streaks" => (streaks::sweep(task, progress)?, streaks::PAIRS),
            "density" => (density::sweep(task, progress)?, density::PAIRS),
            "transport" => (transport::sweep(task, progress)?, transport::PAIRS),
            "lightning-grid" => (lightning::sweep(task, progress)?, lightning::PAIRS),
            "gathers" => (gathers::sweep(task, progress)?, gathers::PAIRS),
            "compression" => (compression::sweep(task, progress)?, compression::PAIRS),
            "end-to-end" => (end_to_end::sweep(task, progress)?, end_to_end::PAIRS),
            "frame" => (frame::sweep(task, progress)?, frame::PAIRS),
            "rain-frame" => (rain_frame::sweep(task, progress)?, rain_frame::PAIRS),
            _ => (rain_table::sweep(task, progress)?, rain_table::PAIRS),
        };
        for point in &points {
            point.rows(id, pairs, &mut rows);
        }
    }
    mark_front(&mut rows);
    Ok(rows)
}

/// Marks in every panel (chart, truth, error and cost measure) the points that no other point beats or equals in both.
fn mark_front(rows: &mut [Row]) {
    let same = |a: &Row, b: &Row| {
        a.error_metric == b.error_metric
            && a.cost_metric == b.cost_metric
            && a.truth == b.truth
            && a.chart == b.chart
    };
    // Larger is worse, whatever the measure.
    let badness = |row: &Row| if rises(&row.error_metric) { -row.error } else { row.error };
    for at in 0..rows.len() {
        let (error, cost) = (badness(&rows[at]), rows[at].cost_median);
        let beaten = rows.iter().enumerate().any(|(other, row)| {
            other != at
                && same(row, &rows[at])
                && badness(row) <= error
                && row.cost_median <= cost
                && (badness(row) < error || row.cost_median < cost || other < at)
        });
        // Where a chart is read along a setting, nothing is better than anything.
        rows[at].pareto = !beaten && error.is_finite() && rows[at].error_metric != rain_table::RATE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(metric: &str, cost: f64, error: f64) -> Row {
        Row {
            chart: "c".into(),
            series: "s".into(),
            setting: String::new(),
            truth: "t".into(),
            error_metric: metric.into(),
            error,
            cost_metric: "ms".into(),
            cost_median: cost,
            cost_p10: cost,
            cost_p90: cost,
            bytes: None,
            pareto: false,
            chosen: false,
            baseline: false,
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats_in_both_whichever_way_the_measure_runs() {
        let front = |metric: &str, points: &[(f64, f64)]| {
            let mut rows: Vec<Row> = points.iter().map(|&(cost, error)| row(metric, cost, error)).collect();
            mark_front(&mut rows);
            rows.iter().map(|row| row.pareto).collect::<Vec<_>>()
        };
        assert_eq!(
            front("L2", &[(1.0, 0.5), (2.0, 0.1), (3.0, 0.1), (2.0, 0.6)]),
            [true, true, false, false]
        );
        assert_eq!(front("PSNR, dB", &[(1.0, 20.0), (2.0, 30.0), (3.0, 25.0)]), [true, true, false]);
        assert_eq!(front("L2", &[(1.0, 0.5), (1.0, 0.5)]), [true, false]);
        assert_eq!(front("L2", &[(1.0, f64::NAN), (2.0, 0.5)]), [false, true]);
    }

    #[test]
    fn panels_do_not_judge_each_other() {
        let mut rows = vec![row("L2", 1.0, 0.1), row("L2", 2.0, 0.2)];
        rows[1].truth = "another".into();
        mark_front(&mut rows);
        assert!(rows.iter().all(|row| row.pareto));
    }
}
