//! How many classes of drops a density table needs: few enough to be small, enough that drops fall as their streaks say.
//!
//! Counts are exact integrals whatever the number of classes. What a class does share out is its frame: drops move from one
//! picture to the next with their class's speed u, while each one's streak is as long as its own speed v makes it. That is an
//! error of first order in a class's width, and where streaks and motion disagree it is seen. The number of classes is chosen by
//! it. The medium's profile over depth is of second order, since a class's shell is right in extinction and in depth as a whole:
//! it is the smaller error for any number of classes, see `tests/src/budget_rain.rs`.
//!
//! | symbol | name                               | unit      |
//! | u      | `Class::fall_speed`                | m/s       |
//! | v      | a drop's own fall speed            | m/s       |
//! | N      | drops per volume and diameter      | 1/(m³ mm) |
//! | L      | length of a streak, D + vT         | m         |

use crate::density::{
    GAUSS_POINTS, GaussRule, MOST_CLASSES, check_spec, default_classes, fewest_nodes, section_bytes,
    smaller_table,
};
use crate::error::BakeError;
use crate::recipe::model::DensitySpec;
use squall_formats::drops;
use squall_formats::section::density::{Class, DensitySection, Mode, Ranges, STENCIL};
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::units::{Millimetres, MillimetresPerHour, Seconds};
use squall_runtime::random::Random;

/// Rates and exposures that a choice looks at, equally spaced in the logarithm, ends included: where the error is largest.
const SEEN: [usize; 2] = [5, 3];
/// Rates and exposures at random that verify it.
const HELD_OUT: usize = 16;
/// Stream of the held-out ones.
const STREAM: u64 = 0x636c_6173_7365_7321;

/// A density table, and the specification as it was carried out.
#[derive(Clone, Debug)]
pub struct ChosenTable {
    /// The specification, with the number of classes in use and no budget for it.
    pub spec: DensitySpec,
    /// The table.
    pub section: DensitySection,
    /// Which held-out rates and exposures verify it: those of an iteration that no earlier choice was verified by.
    iteration: u64,
}

/// Fills a density table: the fewest rate nodes whose measured error is within the budget, and as many classes as the budget
/// for those asks for, where there is one.
///
/// Errors: a range that makes no sense, a budget below what round-off allows, or out of reach of any number of classes.
pub fn bake_density(spec: &DensitySpec) -> Result<DensitySection, BakeError> {
    Ok(bake_chosen(spec)?.section)
}

/// [`bake_density`], with the specification as it was carried out: its number of classes is the one in use.
///
/// Errors: as [`bake_density`].
pub fn bake_chosen(spec: &DensitySpec) -> Result<ChosenTable, BakeError> {
    check_spec(spec)?;
    match spec.class_error {
        Some(asked) => choose_classes(spec, asked),
        None => Ok(ChosenTable { spec: spec.clone(), section: fewest_nodes(spec)?, iteration: 0 }),
    }
}

/// Error of the drops' fall within `classes`: √(∫ N L³ (u/v − 1)² dD / ∫ N L³ dD), –. The root mean square of what a drop's
/// fall from picture to picture is off against its own speed, over the streaks of any picture: those of diameter D number as
/// N L³, whatever lens, size and lengths in pixels.
///
/// Quadrature over continuous diameters, to round-off. At least one class; a positive `rate` and `exposure`.
pub fn speed_error(classes: &[Class], rate: MillimetresPerHour, exposure: Seconds) -> f64 {
    let gauss = GaussRule::new(GAUSS_POINTS);
    let slope = drops::slope(rate);
    let streaks = |d: f64| {
        let diameter = Millimetres(d);
        let speed = drops::fall_speed(diameter);
        let length = drops::streak_length(diameter, speed, exposure).0;
        (drops::density_at(d, slope) * length * length * length, speed.0)
    };
    let (mut off, mut all) = (0.0, 0.0);
    for class in classes {
        let [from, to] = class.diameter;
        let square = |d: f64| {
            let (number, speed) = streaks(d);
            let error = class.fall_speed.0 / speed - 1.0;
            number * error * error
        };
        off += gauss.over_class(from, to, square);
        all += gauss.over_class(from, to, |d| streaks(d).0);
    }
    (off / all).sqrt()
}

/// The smallest table whose classes' [`speed_error`] is within `asked` and whose counts are within the specification's
/// `relative_error`, among all of 1 to 64 classes. Fewer classes may take more rates and so more bytes.
///
/// Errors: no number of classes gets there, with the best; a count error out of reach.
pub fn choose_classes(spec: &DensitySpec, asked: f64) -> Result<ChosenTable, BakeError> {
    let mut least = 1;
    let mut iteration = 0;
    while let Some((spec, section)) = smallest(spec, asked, least)? {
        let chosen = ChosenTable { spec, section, iteration };
        if chosen.speed_error() <= asked {
            return Ok(chosen);
        }
        // Held-out rates or exposures are worse off than the seen ones: more classes, and others to verify them.
        least = chosen.spec.classes + 1;
        iteration += 1;
    }
    let (mut best, mut at) = (f64::INFINITY, 0);
    for classes in 1..=MOST_CLASSES {
        let error = verified(&default_classes(&with_classes(spec, classes)), &spec.ranges, 0);
        if error < best {
            (best, at) = (error, classes);
        }
    }
    Err(BakeError::NotReached {
        what: "rain.density: classes of drops".into(),
        wanted: format!("class_error {asked}"),
        reached: format!("{best:.4} with {at} classes"),
        hint: "ask for less, or narrow rain.density.diameter_mm".into(),
    })
}

/// The smallest table from `least` classes on, by what the choice sees; `None` where no number of classes is within `asked`.
fn smallest(
    spec: &DensitySpec,
    asked: f64,
    least: usize,
) -> Result<Option<(DensitySpec, DensitySection)>, BakeError> {
    let seen = seen(&spec.ranges);
    let mut best: Option<(DensitySpec, DensitySection, u64)> = None;
    for classes in least..=MOST_CLASSES {
        let spec = with_classes(spec, classes);
        let fixed = default_classes(&spec);
        if worst(&fixed, &seen) > asked {
            continue;
        }
        let Some((_, section, bytes)) = &best else {
            let section = fewest_nodes(&spec)?;
            let bytes = bytes_of(&section);
            best = Some((spec, section, bytes));
            continue;
        };
        let paper = [Mode::PaperExact, Mode::Paper].map(|mode| section.table(mode).classes.len());
        if section_bytes(STENCIL, [fixed.len(), paper[0], paper[1]]) >= *bytes {
            break;
        }
        if let Some(section) = smaller_table(&spec, *bytes)? {
            let bytes = bytes_of(&section);
            best = Some((spec, section, bytes));
        }
    }
    Ok(best.map(|(spec, section, _)| (spec, section)))
}

impl ChosenTable {
    /// Largest [`speed_error`] of the classes as the section has them, over rates and exposures that the choice saw and ones
    /// that it did not.
    pub fn speed_error(&self) -> f64 {
        verified(&self.section.table(Mode::Default).classes, &self.section.ranges, self.iteration)
    }

    /// Classes in words.
    pub fn classes(&self) -> String {
        let (all, used) = (self.spec.classes, self.section.table(Mode::Default).classes.len());
        let plural = if all == 1 { "class" } else { "classes" };
        let rest = if used < all { format!(", {used} of them with drops") } else { String::new() };
        format!("{all} {plural}{rest}")
    }

    /// What the table costs, in words: bytes, and how many drops a picture's search looks at per streak that it finds. Counted,
    /// not timed.
    fn cost(&self) -> String {
        let classes = &self.section.table(Mode::Default).classes;
        let looked_at = looked_at(classes, &self.section.ranges);
        format!("{} bytes, {looked_at:.1} drops looked at per streak", bytes_of(&self.section))
    }

    /// What was asked of the classes and measured of them; the neighbouring settings where a budget chose.
    ///
    /// Errors: as for the table.
    pub fn record(&self, asked: Option<f64>) -> Result<BudgetRecord, BakeError> {
        let got = self.speed_error();
        let (mut next_better, mut next_cheaper) = (None, None);
        if asked.is_some() {
            let words = |spec: DensitySpec, section: DensitySection| {
                let other = Self { spec, section, iteration: self.iteration };
                format!("{}: {:.4}, {}", other.classes(), other.speed_error(), other.cost())
            };
            for classes in self.spec.classes + 1..=MOST_CLASSES {
                let spec = with_classes(&self.spec, classes);
                if verified(&default_classes(&spec), &spec.ranges, self.iteration) < got {
                    let section = fewest_nodes(&spec)?;
                    next_better = Some(words(spec, section));
                    break;
                }
            }
            for classes in (1..self.spec.classes).rev() {
                let spec = with_classes(&self.spec, classes);
                if let Some(section) = smaller_table(&spec, bytes_of(&self.section))? {
                    next_cheaper = Some(words(spec, section));
                    break;
                }
            }
        }
        Ok(BudgetRecord {
            part: "density".into(),
            metric: "RMS relative error of drops' fall within their classes, over streaks, largest".into(),
            asked,
            got,
            chosen: format!("{}, {}", self.classes(), self.cost()),
            next_better,
            next_cheaper,
        })
    }
}

fn with_classes(spec: &DensitySpec, classes: usize) -> DensitySpec {
    DensitySpec { classes, class_error: None, ..spec.clone() }
}

fn bytes_of(section: &DensitySection) -> u64 {
    section.to_section().length()
}

fn worst(classes: &[Class], probes: &[(MillimetresPerHour, Seconds)]) -> f64 {
    probes.iter().map(|&(rate, exposure)| speed_error(classes, rate, exposure)).fold(0.0, f64::max)
}

fn verified(classes: &[Class], ranges: &Ranges, iteration: u64) -> f64 {
    worst(classes, &seen(ranges)).max(worst(classes, &held_out(ranges, iteration)))
}

/// The place at `share` of a range, in the logarithm.
fn between([low, high]: [f64; 2], share: f64) -> f64 {
    (low * libm::pow(high / low, share)).clamp(low, high)
}

fn seen(ranges: &Ranges) -> Vec<(MillimetresPerHour, Seconds)> {
    let [rates, exposures] = SEEN;
    let share = |i: usize, count: usize| i as f64 / (count - 1) as f64;
    let pair = |i: usize| {
        let rate = between(ranges.rate.map(|r| r.0), share(i / exposures, rates));
        (
            MillimetresPerHour(rate),
            Seconds(between(ranges.exposure.map(|t| t.0), share(i % exposures, exposures))),
        )
    };
    (0..rates * exposures).map(pair).collect()
}

fn held_out(ranges: &Ranges, iteration: u64) -> Vec<(MillimetresPerHour, Seconds)> {
    let mut random = Random::from_parts(&[STREAM, iteration]);
    let mut pair = |_| {
        let rate = between(ranges.rate.map(|r| r.0), random.unit());
        (MillimetresPerHour(rate), Seconds(between(ranges.exposure.map(|t| t.0), random.unit())))
    };
    (0..HELD_OUT).map(&mut pair).collect()
}

/// Drops that a search looks at over streaks that it finds, at the largest rate, longest exposure and full range of lengths:
/// a class is searched between its smallest drop's nearest and its largest drop's farthest distance, as densely as its smallest
/// drops are. Whole cells at the frustum's sides come on top.
fn looked_at(classes: &[Class], ranges: &Ranges) -> f64 {
    let gauss = GaussRule::new(GAUSS_POINTS);
    let slope = drops::slope(ranges.rate[1]);
    let cube = |d: f64| {
        let diameter = Millimetres(d);
        let length = drops::streak_length(diameter, drops::fall_speed(diameter), ranges.exposure[1]).0;
        length * length * length
    };
    let [longest, shortest] = [ranges.length_px[1], ranges.length_px[0]].map(|px| 1.0 / (px * px * px));
    let (mut looked_at, mut found) = (0.0, 0.0);
    for Class { diameter: [from, to], .. } in classes {
        let shell = cube(to.0) * shortest - cube(from.0) * longest;
        looked_at += drops::density_at(from.0, slope) * (to.0 - from.0) * shell;
        found +=
            gauss.over_class(*from, *to, |d| drops::density_at(d, slope) * cube(d)) * (shortest - longest);
    }
    looked_at / found
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::units::MetresPerSecond;

    /// One class of all drops between two diameters, u at their geometric mean.
    fn one_class(from: f64, to: f64) -> Class {
        let representative = Millimetres(libm::sqrt(from * to));
        let fall_speed = drops::fall_speed(representative);
        Class { diameter: [from, to].map(Millimetres), representative, fall_speed, edge_log2: 0 }
    }

    #[test]
    fn one_class_of_long_exposures_errs_as_its_closed_form_says() {
        // After 10⁹ s a streak is v T long to 12 digits, and ∫ N v³ (u/v − 1)² = ∫ N v (u − v)²; with v = A − B e^{−cD} and
        // N ~ e^{−ΛD} all is a sum of ∫ e^{−sD}.
        const EXPOSURE: Seconds = Seconds(1e9);
        const ROUND_OFF: f64 = 1e-10;
        let [from, to] = [0.5, 6.0];
        let class = one_class(from, to);
        for rate in [0.1, 5.0, 200.0].map(MillimetresPerHour) {
            let slope = drops::slope(rate);
            let exponential = |s: f64| (libm::exp(-s * from) - libm::exp(-s * to)) / s;
            // ∫ N vⁿ by the binomial theorem.
            let moment = |n: i32| -> f64 {
                let choose =
                    [[1.0, 1.0, 0.0, 0.0], [1.0, 2.0, 1.0, 0.0], [1.0, 3.0, 3.0, 1.0]][n as usize - 1];
                (0..=n)
                    .map(|k| {
                        let factor = choose[k as usize]
                            * libm::pow(9.65, f64::from(n - k))
                            * libm::pow(-10.3, f64::from(k));
                        factor * exponential(slope + 0.6 * f64::from(k))
                    })
                    .sum()
            };
            let u = class.fall_speed.0;
            let square = (u * u * moment(1) - 2.0 * u * moment(2) + moment(3)) / moment(3);
            let found = speed_error(&[class], rate, EXPOSURE);
            assert!((found / libm::sqrt(square) - 1.0).abs() < ROUND_OFF, "{rate:?}: {found} {square}");
        }
    }

    #[test]
    fn a_speed_that_is_off_by_a_share_for_every_drop_errs_by_that_share() {
        // A class of nearly one diameter, its frame 3 % too fast.
        let mut class = one_class(2.0, 2.0 + 1e-9);
        class.fall_speed = MetresPerSecond(1.03 * class.fall_speed.0);
        let found = speed_error(&[class], MillimetresPerHour(10.0), Seconds(0.02));
        assert!((found - 0.03).abs() < 1e-8, "{found}");
    }

    #[test]
    fn the_error_halves_with_twice_the_classes() {
        // First order; the second order is a few per cent at 32 classes.
        const SECOND_ORDER: f64 = 0.05;
        let spec = DensitySpec::default();
        let error = |classes| verified(&default_classes(&with_classes(&spec, classes)), &spec.ranges, 0);
        assert!((error(32) / error(64) / 2.0 - 1.0).abs() < SECOND_ORDER);
    }

    #[test]
    fn a_loose_budget_takes_few_nodes_and_a_tight_one_more_and_both_hold() {
        let bake =
            |relative_error| bake_density(&DensitySpec { relative_error, ..Default::default() }).unwrap();
        let [loose, tight] = [5e-3, 1e-7].map(bake);
        assert!(loose.rates.len() < tight.rates.len());
        for section in [loose, tight] {
            assert!(section.measured_error <= section.asked_error);
            let read = DensitySection::read(&section.write(), 1, &Default::default()).unwrap();
            assert_eq!(read, section);
        }
    }

    #[test]
    fn classes_down_to_mist_have_positive_speeds_and_hold_their_budget() {
        let diameter = [Millimetres(0.1), Millimetres(10.0)];
        for classes in [1, 8] {
            let spec = DensitySpec { diameter, classes, ..Default::default() };
            let section = bake_density(&spec).unwrap();
            assert!(section.table(Mode::Default).classes.iter().all(|class| class.fall_speed.0 > 0.0));
            DensitySection::read(&section.write(), 1, &Default::default()).unwrap();
        }
    }

    #[test]
    fn an_unreachable_budget_or_a_senseless_range_is_refused() {
        let spec = DensitySpec { relative_error: 1e-17, ..Default::default() };
        assert!(bake_density(&spec).unwrap_err().to_string().contains("rain.density.error"));
        let mut spec = DensitySpec::default();
        spec.ranges.rate[0].0 = 300.0;
        assert!(bake_density(&spec).unwrap_err().to_string().contains("rain.density.rate_mm_per_h"));
        let spec = DensitySpec { classes: 0, ..Default::default() };
        assert!(bake_density(&spec).is_err());
        for class_error in [0.0, 0.6, f64::NAN].map(Some) {
            let spec = DensitySpec { class_error, ..Default::default() };
            assert!(bake_density(&spec).unwrap_err().to_string().contains("rain.density.class_error"));
        }
    }

    #[test]
    fn baking_twice_gives_the_same_bytes() {
        let bytes = || bake_density(&DensitySpec::default()).unwrap().write();
        assert_eq!(bytes(), bytes());
    }
}
