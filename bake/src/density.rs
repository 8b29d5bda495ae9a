//! Density tables: streaks per class of drops for every rate and camera, \[weber\] eq. 5 corrected.
//!
//! `solve_counts` is the slow truth: quadrature over the diameters of a class, each with its own distances
//! and frustum volume. The table's moments replace that; its number of rate nodes is picked by the error that is
//! measured between them, lookup against solve. How many classes there are is the recipe's to say, or chosen by
//! [`crate::plan::density`], where tables are baked.
//!
//! | symbol | name       | unit        |
//! | R      | `rate`     | mm/h        |
//! | D      | `diameter` | mm          |
//! | N      | `number`   | 1/(m³ mm)   |
//! | L      | length of a streak before projection | m |

mod gauss;

use crate::error::BakeError;
pub use crate::recipe::model::DensitySpec;
use squall_formats::drops::{self, View, paper};
use squall_formats::section::density::{Class, DensitySection, MOMENTS, Mode, Table};
use squall_formats::units::{MetresPerSecond, Millimetres, MillimetresPerHour, Radians};
use squall_runtime::RuntimeError;
use squall_runtime::density::{check_view, lookup_counts};

pub(crate) use gauss::GaussRule;

/// Rates outside these have no rain in them: Λ⁻¹ leaves the drops' scale and moments leave a double's range.
const RATE_LIMITS: [f64; 2] = [1e-3, 1e3];
/// Exposures that a camera has, with room for the round-off of milliseconds.
const EXPOSURE_LIMITS_MS: [f64; 2] = [0.999e-3, 1000.001];
/// Diameters outside these are mist, or break up as they fall.
const DIAMETER_LIMITS: [f64; 2] = [0.1, 12.0];
/// Lattice cells hold this many drops at most at the table's largest rate: enough that a cell's own cost is
/// spread over several drops, few enough that cells outside the frustum cost little.
const DROPS_PER_CELL: f64 = 48.0;
/// Classes that hold no more than this share of anything that is counted, at the largest rate and any exposure, need no table:
/// far below what tables are asked for, far above a double's round-off.
const NEGLIGIBLE: f64 = 1e-12;
/// Most classes of the default mode.
pub const MOST_CLASSES: usize = 64;
/// Nodes tried, in this order; each about √2 of the one before.
const NODE_COUNTS: [usize; 16] = [4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768];
/// Gauss points for each of four pieces of a class; more change nothing, see the tests.
pub(crate) const GAUSS_POINTS: usize = 24;
/// Rates between two nodes at which the error is measured.
const PROBES: usize = 8;

/// Counts of one class of `mode` by direct quadrature, one per class in `classes`: ∫ V(L(D, T)) N(D, R) dD
/// with V the volume between the distances at which a streak of D has `max_px` and `min_px` pixels.
///
/// Error: round-off; `GAUSS_POINTS` points for each of four pieces of a class. Errors: an impossible view or rate.
pub fn solve_counts(
    mode: Mode,
    classes: &[[Millimetres; 2]],
    view: &View,
    rate: MillimetresPerHour,
) -> Result<Vec<f64>, BakeError> {
    check_view(view)?;
    if !(rate.0 > 0.0 && rate.0.is_finite()) {
        return Err(RuntimeError::argument("rate", "a positive rainfall in mm/h", rate.0).into());
    }
    let volume = |diameter: f64, speed: fn(Millimetres) -> MetresPerSecond| {
        let diameter = Millimetres(diameter);
        view.shell_volume(drops::streak_length(diameter, speed(diameter), view.exposure))
    };
    let gauss = GaussRule::new(GAUSS_POINTS);
    let slope = drops::slope(rate);
    let count = |[from, to]: [Millimetres; 2]| match mode {
        Mode::Default => {
            gauss.over_class(from, to, |d| volume(d, drops::fall_speed) * drops::density_at(d, slope))
        }
        Mode::PaperExact => volume(from.0, paper::fall_speed) * drops::drops_per_volume(from, to, rate),
        Mode::Paper => volume(from.0, paper::fall_speed) * paper::drops_per_volume(from, to, rate),
    };
    Ok(classes.iter().map(|&class| count(class)).collect())
}

/// The table of `spec.classes` classes with the fewest nodes within the budget.
pub(crate) fn fewest_nodes(spec: &DensitySpec) -> Result<DensitySection, BakeError> {
    let mut best = f64::INFINITY;
    for nodes in NODE_COUNTS {
        let mut section = fill_section(spec, nodes);
        section.measured_error = measure_error(&section, f64::INFINITY)?;
        if section.measured_error <= spec.relative_error {
            return Ok(section);
        }
        // Four-point interpolation gains a factor of four from √2 times the nodes until round-off rules.
        if section.measured_error > 0.7 * best {
            break;
        }
        best = section.measured_error;
    }
    Err(BakeError::NotReached {
        what: "rain density table".into(),
        wanted: format!("relative error {:e}", spec.relative_error),
        reached: format!("{best:e}"),
        hint: "narrow the range of rates, or use more classes".into(),
    })
}

/// The smallest table of `spec.classes` classes within the budget and below `bytes`; `None` where there is none.
///
/// From the largest that is small enough downward: one that misses the budget rules out all with fewer nodes.
pub(crate) fn smaller_table(spec: &DensitySpec, bytes: u64) -> Result<Option<DensitySection>, BakeError> {
    let counts = Mode::ALL.map(|mode| classes_of(spec, mode).len());
    let mut smallest = None;
    for nodes in NODE_COUNTS.into_iter().rev().filter(|&nodes| section_bytes(nodes, counts) < bytes) {
        let mut section = fill_section(spec, nodes);
        section.measured_error = measure_error(&section, spec.relative_error)?;
        if section.measured_error > spec.relative_error {
            break;
        }
        smallest = Some(section);
    }
    Ok(smallest)
}

/// Bytes of a section with `nodes` rates and tables of so many classes, as SPEC.md, "DENS", counts them.
pub(crate) fn section_bytes(nodes: usize, classes: [usize; 3]) -> u64 {
    let table = |classes: usize| 4 + 8 + 36 * classes + 8 + 8 * MOMENTS * nodes * classes;
    (4 * 16 + 2 * 8 + 8 + 8 * nodes + 8 + classes.map(table).iter().sum::<usize>()) as u64
}

/// Nodes and measured error of the table that lies `step` places from the one with `nodes` in the order of those tried; `None`
/// where there is none.
///
/// Errors: a range that makes no sense.
pub fn error_at_nodes(
    spec: &DensitySpec,
    nodes: usize,
    step: isize,
) -> Result<Option<(usize, f64)>, BakeError> {
    check_spec(spec)?;
    let place = NODE_COUNTS.iter().position(|&count| count == nodes);
    let Some(other) = place.and_then(|place| NODE_COUNTS.get(place.checked_add_signed(step)?)) else {
        return Ok(None);
    };
    Ok(Some((*other, measure_error(&fill_section(spec, *other), f64::INFINITY)?)))
}

/// The classes that `mode` counts in, by ascending diameter. The largest drops of the default mode have none where the
/// largest rate has next to no such drops: they stay with the medium, which holds drops of all sizes.
pub fn classes_of(spec: &DensitySpec, mode: Mode) -> Vec<[Millimetres; 2]> {
    match mode {
        Mode::Default => {
            let mut classes = drops::log_classes(spec.diameter[0], spec.diameter[1], spec.classes);
            drop_negligible(&mut classes, spec.ranges.rate[1]);
            classes
        }
        Mode::PaperExact | Mode::Paper => paper::CLASSES.to_vec(),
    }
}

/// The default mode's classes with all that is fixed of them.
pub(crate) fn default_classes(spec: &DensitySpec) -> Vec<Class> {
    let largest = spec.ranges.rate[1];
    let edges = classes_of(spec, Mode::Default).into_iter();
    edges.map(|edges| fixed_class(Mode::Default, edges, largest)).collect()
}

/// Takes away classes from the largest down while all of them together hold at most [`NEGLIGIBLE`] of every moment at
/// `largest`. Counts at any exposure are sums of moments, so their share is no larger; and the share of large drops falls with
/// the rate.
fn drop_negligible(classes: &mut Vec<[Millimetres; 2]>, largest: MillimetresPerHour) {
    let Some(&[_, end]) = classes.last() else { return };
    let gauss = GaussRule::new(GAUSS_POINTS);
    let moments = |from: Millimetres| solve_moments(&gauss, Mode::Default, [from, end], largest);
    let all = moments(classes[0][0]);
    while let [_, .., [from, _]] = classes[..] {
        if moments(from).iter().zip(&all).any(|(part, all)| *part > NEGLIGIBLE * all) {
            return;
        }
        classes.pop();
    }
}

pub(crate) fn check_spec(spec: &DensitySpec) -> Result<(), BakeError> {
    let refused = |field, wanted: String, found: String| Err(BakeError::Setting { field, wanted, found });
    let within = |field, [low, high]: [f64; 2], [least, most]: [f64; 2], unit: &str| {
        if least <= low && low < high && high <= most {
            return Ok(());
        }
        refused(field, format!("low < high within {least} to {most} {unit}"), format!("{low} to {high}"))
    };
    let ranges = &spec.ranges;
    within("rain.density.rate_mm_per_h", ranges.rate.map(|r| r.0), RATE_LIMITS, "mm/h")?;
    within("rain.density.vertical_fov_deg", ranges.vertical_fov.map(|v| v.0), [1.0, 179.0], "degrees")?;
    within("rain.density.exposure_ms", ranges.exposure.map(|t| t.0 * 1e3), EXPOSURE_LIMITS_MS, "ms")?;
    within("rain.density.streak_px", ranges.length_px, [1.0, 1e4], "px")?;
    within("rain.density.diameter_mm", spec.diameter.map(|d| d.0), DIAMETER_LIMITS, "mm")?;
    if !(1..=MOST_CLASSES).contains(&spec.classes) {
        return refused("rain.density.classes", format!("1 to {MOST_CLASSES}"), spec.classes.to_string());
    }
    if let Some(found) = spec.class_error.filter(|error| !(1e-3..=0.5).contains(error)) {
        return refused("rain.density.class_error", "0.001 to 0.5".into(), found.to_string());
    }
    // Below, round-off of quadrature and logarithms takes over.
    if !(1e-9..1.0).contains(&spec.relative_error) {
        return refused("rain.density.error", "1e-9 to 1".into(), spec.relative_error.to_string());
    }
    Ok(())
}

/// A table with `nodes` rates, equally spaced in ln R, along which what is stored is nearly straight.
fn fill_section(spec: &DensitySpec, nodes: usize) -> DensitySection {
    let [low, high] = spec.ranges.rate;
    let ratio = libm::log(high.0 / low.0);
    let rates: Vec<_> = (0..nodes)
        .map(|i| match i {
            0 => low,
            i if i == nodes - 1 => high,
            i => MillimetresPerHour(low.0 * libm::exp(ratio * i as f64 / (nodes - 1) as f64)),
        })
        .collect();
    let tables = Mode::ALL.map(|mode| fill_table(spec, mode, &rates)).to_vec();
    DensitySection {
        ranges: spec.ranges,
        asked_error: spec.relative_error,
        measured_error: f64::INFINITY,
        rates,
        tables,
    }
}

fn fill_table(spec: &DensitySpec, mode: Mode, rates: &[MillimetresPerHour]) -> Table {
    let edges = classes_of(spec, mode);
    let gauss = GaussRule::new(GAUSS_POINTS);
    let mut log_moments = Vec::with_capacity(rates.len() * edges.len() * MOMENTS);
    for &rate in rates {
        for &class in &edges {
            let edge_factor = drops::slope(rate) * class[0].0;
            let moments = solve_moments(&gauss, mode, class, rate);
            log_moments.extend(moments.map(|moment| libm::log(moment) + edge_factor));
        }
    }
    let largest = spec.ranges.rate[1];
    let classes = edges.into_iter().map(|edges| fixed_class(mode, edges, largest)).collect();
    Table { mode, classes, log_moments }
}

/// n, A, M_0 … M_3 of one class; see the section's own table for the symbols.
fn solve_moments(
    gauss: &GaussRule,
    mode: Mode,
    [from, to]: [Millimetres; 2],
    rate: MillimetresPerHour,
) -> [f64; MOMENTS] {
    let weights = |diameter: f64, speed: f64| {
        let metres = diameter / 1000.0;
        let (d2, v2) = (metres * metres, speed * speed);
        [1.0, diameter * diameter, d2 * metres, d2 * speed, metres * v2, v2 * speed]
    };
    let at_left_edge = |number: f64| weights(from.0, paper::fall_speed(from).0).map(|w| w * number);
    let slope = drops::slope(rate);
    match mode {
        Mode::Default => std::array::from_fn(|i| {
            gauss.over_class(from, to, |d| {
                drops::density_at(d, slope) * weights(d, drops::fall_speed(Millimetres(d)).0)[i]
            })
        }),
        Mode::PaperExact => at_left_edge(drops::drops_per_volume(from, to, rate)),
        Mode::Paper => at_left_edge(paper::drops_per_volume(from, to, rate)),
    }
}

/// What must not change with rate, exposure or field of view: the drop that stands for the class, its
/// speed, and the largest power-of-two cell that stays within [`DROPS_PER_CELL`].
fn fixed_class(mode: Mode, diameter: [Millimetres; 2], largest: MillimetresPerHour) -> Class {
    let [from, to] = diameter;
    let (representative, fall_speed) = match mode {
        Mode::Default => {
            let middle = Millimetres((from.0 * to.0).sqrt());
            (middle, drops::fall_speed(middle))
        }
        Mode::PaperExact | Mode::Paper => (from, paper::fall_speed(from)),
    };
    let mut class = Class { diameter, representative, fall_speed, edge_log2: 2 };
    while class.edge_log2 > -4 && class.candidates_per_cell(largest) > DROPS_PER_CELL {
        class.edge_log2 -= 1;
    }
    class
}

/// Largest relative error of a class's count between the nodes, over the corners of the ranges that matter:
/// both ends of the exposure (fov, height, aspect and lengths only scale a count, alike in both). Above `enough` it stops at the
/// first place with more.
fn measure_error(section: &DensitySection, enough: f64) -> Result<f64, BakeError> {
    let [narrow, wide] = section.ranges.vertical_fov.map(Radians::from);
    let [short, long] = section.ranges.exposure;
    let [min_px, max_px] = section.ranges.length_px;
    let view = |vertical_fov, exposure| View {
        vertical_fov,
        height_px: 1080.0,
        aspect: 16.0 / 9.0,
        exposure,
        min_px,
        max_px,
    };
    let mut worst = 0.0_f64;
    for pair in section.rates.windows(2) {
        for probe in 0..PROBES {
            let share = (probe as f64 + 0.5) / PROBES as f64;
            let rate = MillimetresPerHour(pair[0].0 * libm::exp(share * libm::log(pair[1].0 / pair[0].0)));
            for view in [view(narrow, short), view(wide, long)] {
                for mode in Mode::ALL {
                    let table = section.table(mode);
                    let edges: Vec<_> = table.classes.iter().map(|class| class.diameter).collect();
                    let exact = solve_counts(mode, &edges, &view, rate)?;
                    let found = lookup_counts(section, mode, &view, rate)?;
                    for (found, exact) in found.iter().zip(&exact) {
                        worst = worst.max((found / exact - 1.0).abs());
                    }
                }
                if worst > enough {
                    return Ok(worst);
                }
            }
        }
    }
    Ok(worst)
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::units::{Degrees, Seconds};

    fn view(fov: f64, exposure_ms: f64, min_px: f64) -> View {
        View {
            vertical_fov: Degrees(fov).into(),
            height_px: 1080.0,
            aspect: 16.0 / 9.0,
            exposure: Seconds(exposure_ms / 1e3),
            min_px,
            max_px: 200.0,
        }
    }

    fn total(mode: Mode, rate: f64, view: View) -> f64 {
        let classes = classes_of(&DensitySpec::default(), mode);
        solve_counts(mode, &classes, &view, MillimetresPerHour(rate)).unwrap().iter().sum()
    }

    #[test]
    fn twice_the_gauss_points_change_nothing_even_for_one_class_of_all_sizes() {
        let [from, to] = [Millimetres(0.1), Millimetres(12.0)];
        for rate in [1e-3, 0.1, 200.0].map(MillimetresPerHour) {
            let integrand = |d| {
                let diameter = Millimetres(d);
                let speed = drops::fall_speed(diameter).0;
                drops::number_density(diameter, rate) * speed * speed * speed
            };
            let [some, more] =
                [GAUSS_POINTS, 2 * GAUSS_POINTS].map(|n| GaussRule::new(n).over_class(from, to, integrand));
            assert!((some / more - 1.0).abs() < 1e-13, "{rate:?}: {some} {more}");
        }
    }

    #[test]
    fn quadrature_reproduces_the_corrected_and_the_printed_counts() {
        let counts =
            |mode| [2.0, 25.0, 50.0, 75.0].map(|rate| total(mode, rate, view(120.0, 20.0, 30.0)).round());
        assert_eq!(counts(Mode::PaperExact), [1090.0, 5184.0, 7646.0, 9558.0]);
        assert_eq!(counts(Mode::Paper), [2515.0, 11315.0, 16291.0, 20049.0]);
        assert_eq!(counts(Mode::Default), [1012.0, 6690.0, 10630.0, 13802.0]);
    }

    #[test]
    fn a_rate_that_is_no_number_is_refused() {
        let classes = classes_of(&DensitySpec::default(), Mode::Default);
        let nan = MillimetresPerHour(f64::NAN);
        assert!(solve_counts(Mode::Default, &classes, &view(60.0, 20.0, 30.0), nan).is_err());
    }

    #[test]
    fn a_sections_bytes_are_as_many_as_its_numbers_of_nodes_and_classes_say() {
        for (classes, nodes) in [(1, 4), (16, 12)] {
            let section = fill_section(&DensitySpec { classes, ..Default::default() }, nodes);
            let section = DensitySection { measured_error: 0.0, ..section };
            assert_eq!(section.write().len() as u64, section_bytes(nodes, [classes, 5, 5]));
        }
    }

    #[test]
    fn drops_that_no_rate_of_the_table_brings_have_no_class_and_no_count_misses_them() {
        let mut spec = DensitySpec { diameter: [Millimetres(0.5), Millimetres(12.0)], ..Default::default() };
        assert_eq!(classes_of(&spec, Mode::Default).len(), spec.classes);
        spec.ranges.rate = [0.01, 0.5].map(MillimetresPerHour);
        let classes = classes_of(&spec, Mode::Default);
        assert!(classes.len() < spec.classes, "{}", classes.len());
        for rate in spec.ranges.rate {
            for exposure_ms in [0.01, 1.0, 1000.0] {
                let view = view(60.0, exposure_ms, 10.0);
                let kept: f64 = solve_counts(Mode::Default, &classes, &view, rate).unwrap().iter().sum();
                let all = solve_counts(Mode::Default, &[spec.diameter], &view, rate).unwrap()[0];
                // What is left out, and the round-off of two sums.
                assert!(
                    (kept / all - 1.0).abs() < 2.0 * NEGLIGIBLE,
                    "{rate:?} {exposure_ms} ms: {kept} {all}"
                );
            }
        }
    }
}
