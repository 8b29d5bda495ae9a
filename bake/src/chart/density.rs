//! Chart `density`: how far looked-up counts are off, against the table's bytes and the time of a lookup; how far drops fall
//! apart from their streaks within a class, against the section's bytes.

use super::clock::seconds;
use super::{Cost, Point, Sweep};
use crate::density::solve_counts;
use crate::error::BakeError;
use crate::plan::density::{ChosenTable, bake_chosen, bake_density};
use crate::progress::Progress;
use crate::recipe::model::DensitySpec;
use squall_formats::drops::{View, paper};
use squall_formats::section::density::{DensitySection, MOMENTS, Mode};
use squall_formats::units::{Degrees, Millimetres, MillimetresPerHour, Seconds};
use squall_runtime::density::lookup_counts_into;
use squall_runtime::random::Random;

const ERROR: &str = "count of drops, mean relative error";
const WORST: &str = "count of drops, largest relative error";
const BYTES: &str = "table, bytes";
const FALL: &str = "fall of drops within their classes, RMS relative error";
const SECTION: &str = "section, bytes";
const TIME: &str = "lookup, ns";

pub const PAIRS: &[(&str, &str)] = &[(WORST, BYTES), (WORST, TIME), (ERROR, BYTES), (FALL, SECTION)];

const SEED: u64 = 1;
const REPEATS: usize = 11;

pub fn sweep(task: &Sweep<'_>, progress: &dyn Progress) -> Result<Vec<Point>, BakeError> {
    let Some(rain) = &task.recipe.rain else { return Ok(Vec::new()) };
    let own = &rain.density;
    let questions = questions(own, if task.quick { 60 } else { 400 });
    let asked: &[f64] =
        if task.quick { &[2e-2, 1e-4] } else { &[0.3, 0.1, 2e-2, 5e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7] };
    let classes: &[usize] = if task.quick { &[16] } else { &[4, 16, 32] };
    let counts: &[usize] = if task.quick { &[4, 16] } else { &[1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64] };
    progress.begin("chart density", (asked.len() * classes.len() + counts.len() + 3) as u64);
    let mut points = Vec::new();
    let measured = |section: &DensitySection, mode| measure(section, mode, own.diameter, &questions);
    for &classes in classes {
        for &relative_error in asked {
            progress.check()?;
            let spec = DensitySpec { relative_error, classes, class_error: None, ..own.clone() };
            let section = bake_density(&spec)?;
            let setting = format!("asked {relative_error:e}: {} rates", section.rates.len());
            let series = format!("{classes} classes");
            points.push(Point { series, setting, ..measured(&section, Mode::Default)? });
            progress.advance(1);
        }
    }
    let chosen = bake_chosen(own)?;
    let (section, series) = (&chosen.section, chosen.classes());
    let setting = format!("the recipe's: {} rates, {series}", section.rates.len());
    points.push(Point { series, setting, chosen: true, ..measured(section, Mode::Default)? });
    progress.advance(1);
    for mode in [Mode::PaperExact, Mode::Paper] {
        let (series, setting) = (format!("mode {}", mode.name()), "Bentley's classes".into());
        points.push(Point { series, setting, ..measured(section, mode)? });
    }
    progress.advance(1);
    for &classes in counts {
        progress.check()?;
        let spec = DensitySpec { classes, class_error: None, ..own.clone() };
        points.push(fall(&bake_chosen(&spec)?, false));
        progress.advance(1);
    }
    points.push(fall(&chosen, true));
    progress.advance(1);
    Ok(points)
}

/// How far a mode's looked-up counts are off, and what a lookup takes; series and setting are left empty.
fn measure(
    section: &DensitySection,
    mode: Mode,
    diameter: [Millimetres; 2],
    questions: &[(View, MillimetresPerHour)],
) -> Result<Point, BakeError> {
    let table = section.table(mode);
    let bytes = (table.classes.len() * section.rates.len() * MOMENTS * size_of::<f64>()) as u64;
    let mut counts = vec![0.0; table.classes.len()];
    let (done, cost) = seconds(REPEATS, || -> Result<Vec<f64>, BakeError> {
        let ask = |(view, rate): &(View, MillimetresPerHour)| {
            lookup_counts_into(section, mode, view, *rate, &mut counts)?;
            Ok(counts.iter().sum())
        };
        questions.iter().map(ask).collect()
    });
    let totals = done?;
    // Rain's drops fall as they fall, whatever a mode makes of it: contiguous diameters, measured speeds. Bentley's
    // classes have gaps between them; the drops there are part of the truth too.
    let span = match mode {
        Mode::Default => diameter,
        _ => span_of(&paper::CLASSES),
    };
    let (mut sum, mut worst) = (0.0, 0.0f64);
    for ((view, rate), found) in questions.iter().zip(totals) {
        let wanted = solve_counts(Mode::Default, &[span], view, *rate)?[0];
        if wanted == 0.0 {
            continue;
        }
        let error = (found / wanted - 1.0).abs();
        sum += error;
        worst = worst.max(error);
    }
    let [from, to] = span.map(|diameter| diameter.0);
    let asked = questions.len() as f64;
    Ok(Point {
        series: String::new(),
        setting: String::new(),
        truth: format!("quadrature over drops of {from} to {to} mm, measured fall speeds"),
        errors: vec![(ERROR, sum / asked), (WORST, worst)],
        costs: vec![(BYTES, Cost::exact(bytes as f64)), (TIME, cost.times(1e9 / asked))],
        bytes: Some(bytes),
        chosen: false,
        baseline: mode != Mode::Default,
    })
}

/// How far drops of a table's classes fall apart from their streaks.
fn fall(table: &ChosenTable, chosen: bool) -> Point {
    let bytes = table.section.to_section().length();
    let [from, to] = table.spec.diameter.map(|diameter| diameter.0);
    Point {
        series: "classes of drops".into(),
        setting: format!("{}{}", if chosen { "the recipe's: " } else { "" }, table.classes()),
        truth: format!("quadrature over drops of {from} to {to} mm, each falling with its own speed"),
        errors: vec![(FALL, table.speed_error())],
        costs: vec![(SECTION, Cost::exact(bytes as f64))],
        bytes: Some(bytes),
        chosen,
        baseline: false,
    }
}

fn span_of(classes: &[[Millimetres; 2]]) -> [Millimetres; 2] {
    let first = classes.first().map_or(Millimetres(0.0), |class| class[0]);
    let last = classes.last().map_or(Millimetres(0.0), |class| class[1]);
    [first, last]
}

/// Views and rates inside the recipe's ranges.
fn questions(spec: &DensitySpec, count: usize) -> Vec<(View, MillimetresPerHour)> {
    let mut random = Random::new(SEED);
    let ranges = &spec.ranges;
    let ask = |_| {
        let [narrow, wide] = ranges.vertical_fov.map(|fov| fov.0);
        let [short, long] = ranges.exposure.map(|time| time.0);
        let [low, high] = ranges.rate.map(|rate| rate.0);
        let [least, most] = ranges.length_px;
        let middle = libm::sqrt(least * most);
        let view = View {
            vertical_fov: Degrees(random.range(narrow, wide)).into(),
            height_px: 1080.0,
            aspect: 16.0 / 9.0,
            exposure: Seconds(random.range(short, long)),
            min_px: random.range(least, middle),
            max_px: random.range(middle, most),
        };
        (view, MillimetresPerHour((low * libm::pow(high / low, random.unit())).clamp(low, high)))
    };
    (0..count).map(ask).collect()
}
