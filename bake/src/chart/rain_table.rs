//! Chart `rain-table`: a frame's time by rain and field of view, \[weber\]'s Table 1 beside ours.
//!
//! The paper's frames are whole ones on a GeForce GTX 980, of a size that it does not say, by horizontal field of view; ours are the
//! streaks of a 1920 × 1080 frame on one thread of a processor, by vertical field of view, which is more of them.

use super::rain_frame::{RATES, TABLE_1, View};
use super::{Cost, Point, Sweep};
use crate::error::BakeError;
use crate::input::picture::read_grey;
use crate::plan::density::bake_density;
use crate::progress::Progress;
use crate::streak::{Source, fit_all};
use squall_formats::section::streak::StreakSection;
use squall_runtime::shade::streak::StreakSet;

/// What the chart is read along; no error, and nothing that could be better or worse.
pub const RATE: &str = "rain, mm/h";
const TIME: &str = "a frame's streaks, CPU ms";

/// What is read against what.
pub const PAIRS: &[(&str, &str)] = &[(RATE, TIME)];

const REPEATS: usize = 5;
/// The paper's streaks, px.
const LENGTHS_PX: [f64; 2] = [30.0, 200.0];

/// The chart's points.
///
/// Errors: a picture that is missing or damaged, an interruption.
pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let Some(rain) = &task.recipe.rain else { return Ok(Vec::new()) };
    if rain.pictures.is_empty() {
        return Ok(Vec::new());
    }
    let most = if task.quick { 1 } else { rain.pictures.len() };
    let files = &rain.pictures[..most];
    let pictures = files.iter().map(|file| read_grey(file)).collect::<Result<Vec<_>, _>>()?;
    let sources: Vec<Source> =
        files.iter().zip(&pictures).map(|(file, picture)| Source { file, picture, notes: None }).collect();
    let set = StreakSet::new(&StreakSection { patterns: fit_all(&sources, rain.fit)? });
    let section = bake_density(&rain.density)?;
    let size = if task.quick { [480, 270] } else { [1920, 1080] };
    progress.begin("chart rain-table", (RATES.len() * TABLE_1.len()) as u64);
    let mut points = Vec::new();
    for (fov, frames_per_second) in TABLE_1 {
        for (rate, paper) in RATES.into_iter().zip(frames_per_second) {
            progress.check()?;
            let mut add = |series: String, setting: String, cost: Cost, baseline: bool| {
                points.push(Point {
                    series,
                    setting,
                    truth: "rain and field of view as in the paper's table 1".into(),
                    errors: vec![(RATE, rate)],
                    costs: vec![(TIME, cost)],
                    bytes: None,
                    chosen: !baseline,
                    baseline,
                });
            };
            let setting = format!("{paper} fps on a GTX 980, whole frame");
            add(format!("table 1, {fov}°"), setting, Cost::exact(1e3 / paper), true);
            let in_range = (section.ranges.rate[0].0..=section.ranges.rate[1].0).contains(&rate);
            if in_range {
                let view = View { section: &section, rate, fov, size, lengths_px: LENGTHS_PX };
                let drawn = view.time(&set, REPEATS)?;
                let setting = format!(
                    "{} streaks, find {:.1} ms, draw {:.1} ms",
                    drawn.streaks, drawn.find_ms, drawn.draw_ms
                );
                add(format!("ours, {fov}°"), setting, Cost::exact(drawn.find_ms + drawn.draw_ms), false);
            }
            progress.advance(1);
        }
    }
    Ok(points)
}
