//! Spacing of the lamps, channels of the rows and error of their coding, where a recipe leaves them to its budget.
//!
//! Candidates are tried on strokes of their own, never on those that judge the result: each spacing's rows that those strokes
//! touch are solved once, coded in several ways and relit from bytes. The cost is the response's bytes, estimated from the
//! tried rows; what a row takes differs little from lamp to lamp. Budgets of bytes and of milliseconds ([`super::cost`]) bound it.

use super::solver::{self, choose_solver};
use super::{SAFETY, cost};
use crate::candidate::{Candidate, Outcome, Whole};
use crate::error::BakeError;
use crate::progress::{Progress, Quiet};
use crate::recipe::{Clouds, Recipe};
use crate::response::evaluate::Scores;
use crate::response::view_region::stand_apart;
use crate::response::{ResponseSettings, TestStroke};
use crate::storm::clouds::{place_lights, reach_of, strokes_for};
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::view_region::MAX_VIEW_DEGREE;
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Cloud;

/// What a recipe asks of its clouds; nothing where a field is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CloudBudget {
    /// L2 error of an unseen stroke, all light, against the stroke solved directly: in the 26 directions, or towards unseen eyes.
    pub stroke_l2: Option<f64>,
    /// L2 error of an unseen stroke's rows, against the same rows before coding.
    pub relit_l2: Option<f64>,
    /// L2 error of a stroke solved with the chosen directions and refinement, against the finest that is tried.
    pub solver_l2: Option<f64>,
    /// Bytes of the response at most.
    pub bytes: Option<u64>,
    /// Milliseconds that relighting a stroke may count for, on one core: [`super::cost`].
    pub relight_ms: Option<f64>,
}

/// Settings that the recipe states itself; a budget leaves them alone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    /// `clouds.lightning.spacing_m`.
    pub spacing: bool,
    /// `clouds.response.channels`.
    pub channels: bool,
    /// `clouds.response.error`.
    pub error: bool,
    /// `clouds.transport.directions` or `refine`.
    pub solver: bool,
}

impl CloudBudget {
    /// The largest ratio of an error to what was asked; 0 where nothing was, without bound for what is no number.
    pub fn over(&self, scores: &Scores) -> f64 {
        let ratio = |asked: Option<f64>, got: f64| match asked {
            Some(asked) if got.is_finite() => got / asked,
            Some(_) => f64::INFINITY,
            None => 0.0,
        };
        ratio(self.stroke_l2, scores.stroke.l2).max(ratio(self.relit_l2, scores.codec.l2))
    }

    /// The larger ratio of a response's bytes and of what a stroke counts for to what was asked; 0 where nothing was.
    pub fn over_cost(&self, bytes: u64, relight_ms: f64) -> f64 {
        let bytes = self.bytes.map_or(0.0, |most| bytes as f64 / most as f64);
        bytes.max(self.relight_ms.map_or(0.0, |most| relight_ms / most))
    }

    /// Whether something has to be chosen beside the solver.
    pub fn chooses(&self) -> bool {
        self.errors() || self.costs()
    }

    fn costs(&self) -> bool {
        self.bytes.is_some() || self.relight_ms.is_some()
    }

    /// Whether anything is asked that strokes have to judge.
    pub fn judges(&self) -> bool {
        self.chooses() || self.solver_l2.is_some()
    }

    fn errors(&self) -> bool {
        self.stroke_l2.is_some() || self.relit_l2.is_some()
    }
}

/// What was chosen, and what stood beside it.
#[derive(Clone, Debug)]
pub struct Choice {
    /// Distance between lamps, m; 0 is the recipe's default.
    pub spacing_m: f64,
    /// How rows are solved and stored.
    pub settings: ResponseSettings,
    /// Candidates that were tried; 0 where there was nothing to choose.
    pub tried: usize,
    /// The cheapest candidate that is better, in words.
    pub next_better: Option<String>,
    /// The best candidate that is cheaper, in words.
    pub next_cheaper: Option<String>,
    /// What was chosen of the solver.
    pub solver: Option<BudgetRecord>,
}

impl Choice {
    /// The setting in words.
    pub fn words(&self) -> String {
        setting(self.spacing_m, self.settings.channels, self.settings.relative_error)
    }
}

/// A candidate and what came of it.
#[derive(Clone, Copy, Debug)]
pub struct Tried {
    /// Distance between lamps, m.
    pub spacing_m: f64,
    /// Channels of the rows.
    pub channels: DirectionalBasis,
    /// Error of coding.
    pub error: f64,
    /// What it gave and took.
    pub outcome: Outcome,
}

impl Tried {
    fn words(&self) -> String {
        let Outcome { scores, bytes, relight_ms } = self.outcome;
        let setting = setting(self.spacing_m, self.channels, self.error);
        let (stroke, codec) = (100.0 * scores.stroke.l2, 100.0 * scores.codec.l2);
        let megabytes = bytes as f64 / 1e6;
        format!(
            "{setting}: stroke L2 {stroke:.2} %, relit L2 {codec:.2} %, {megabytes:.3} MB, counts for {relight_ms:.3} ms"
        )
    }
}

fn setting(spacing_m: f64, channels: DirectionalBasis, error: f64) -> String {
    let towards = if let DirectionalBasis::ViewRegion { .. } = channels { " towards eyes" } else { "" };
    format!("lamps {spacing_m:.4} m apart, {} channels{towards}, coded to {error:.3e}", channels.count())
}

/// Strokes that candidates are tried on: as many as memory has room for, between these.
pub const STROKES: [usize; 2] = [4, 32];
/// Number of the first stroke that judges what was chosen of the solver: no others reach so far.
const SOLVER_STROKES: usize = 1 << 16;
/// The coarsest spacing is the reach's longest side over this; each next is finer by √2.
const COARSEST: f64 = 2.0;
const SPACINGS: usize = 14;
/// Powers of two by which spacings beside the best are tried after that, from far to near: rows go with the third power.
const NEARER: [f64; 3] = [0.25, 0.125, 0.0625];
/// Errors of coding from the coarsest, each next finer by 2^¼.
const COARSEST_ERROR: f64 = 0.5;
const ERRORS: usize = 40;
/// Most bytes that a candidate's solved rows may take.
const MOST_BYTES: usize = 3 << 29;

/// How much of each budget a choice may use: less than all where what was baked turned out worse than what was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Of the errors asked for.
    pub errors: f64,
    /// Of the bytes and milliseconds.
    pub costs: f64,
}

/// Chooses what the recipe leaves open.
///
/// Errors: channels towards eyes that stand too near; a budget that no candidate meets, with the best; a solve that does not converge; an interruption.
pub fn choose(
    recipe: &Recipe,
    clouds: &Clouds,
    cloud: &Cloud,
    margins: Margins,
    progress: &dyn Progress,
) -> Result<Choice, BakeError> {
    if let (DirectionalBasis::ViewRegion { .. }, Some(view_region)) =
        (clouds.response.channels, &clouds.response.view_region)
        && !stand_apart(cloud, view_region)
    {
        let wanted =
            "harmonics: the box of [clouds.eyes] is too near the cloud, or the cloud repeats without end";
        let found =
            format!("channels towards eyes between {:?} and {:?} m", view_region.low_m, view_region.high_m);
        return Err(BakeError::input(&recipe.file, "clouds.response.channels", wanted, found));
    }
    let mut choice = Choice {
        spacing_m: clouds.lights.spacing_m,
        settings: clouds.response,
        tried: 0,
        next_better: None,
        next_cheaper: None,
        solver: None,
    };
    let side = {
        let [low, high] = reach_of(recipe, clouds, cloud);
        (high - low).max_element()
    };
    if choice.spacing_m == 0.0 {
        choice.spacing_m = side / 12.0;
    }
    let strokes = |spacing_m: f64| -> Result<Vec<Vec<PointLight>>, BakeError> {
        let lights = place_lights(recipe, clouds, cloud, spacing_m)?;
        let found = strokes_for(recipe, clouds, cloud, &lights, spacing_m, 0..STROKES[1]);
        if found.is_empty() {
            return Err(BakeError::NotReached {
                what: "clouds.budget".into(),
                wanted: "a stroke to judge settings by".into(),
                reached: "none that the lamps reach".into(),
                hint: "strokes in the recipe, or a larger reach without prune, would give some".into(),
            });
        }
        Ok(found)
    };
    if let (Some(asked), false) = (clouds.budget.solver_l2, clouds.given.solver) {
        let lights = place_lights(recipe, clouds, cloud, choice.spacing_m)?;
        // Each time that the chosen is judged by others, which judge nothing else.
        let hidden = |round: usize| {
            let first = SOLVER_STROKES + round * solver::STROKES;
            strokes_for(recipe, clouds, cloud, &lights, choice.spacing_m, first..first + solver::STROKES)
        };
        let tried_on = strokes(choice.spacing_m)?;
        let found = choose_solver(cloud, &choice.settings, (&tried_on, &hidden), asked, progress)?;
        choice.settings = found.settings;
        choice.solver = Some(found.record);
        choice.tried += found.tried;
    }
    if !clouds.budget.chooses() {
        return Ok(choice);
    }
    let spacings: Vec<f64> =
        if clouds.given.spacing || clouds.budget.stroke_l2.is_none() && !clouds.budget.costs() {
            vec![choice.spacing_m]
        } else {
            (0..SPACINGS).map(|i| side / COARSEST * libm::exp2(-0.5 * i as f64)).collect()
        };
    let mut search = Search {
        clouds,
        margins: Margins { errors: margins.errors * SAFETY, costs: margins.costs * SAFETY },
        channels: channels(clouds, cloud),
        errors: errors(clouds),
        tried: Vec::new(),
    };
    progress.begin("budgets", spacings.len() as u64);
    let mut full = false;
    let flashes = cost::flashes(recipe);
    // Strokes that do not depend on the spacing are solved once.
    let mut solved: Option<Vec<TestStroke>> = None;
    // The best candidate at one spacing; none where its rows would take too much memory either.
    let mut attempt = |search: &mut Search, spacing_m: f64| -> Result<Option<Tried>, BakeError> {
        progress.check()?;
        // More lamps than days allow: the recipe did not name the spacing, so it is no mistake of its.
        let Ok(lights) = place_lights(recipe, clouds, cloud, spacing_m) else {
            full = true;
            return Ok(None);
        };
        let mut strokes = strokes(spacing_m)?;
        let widest = search.channels.last().copied().unwrap_or(choice.settings.channels);
        while strokes.len() > STROKES[0] && Candidate::bytes(&lights, &strokes, widest, cloud) > MOST_BYTES {
            strokes.truncate(strokes.len() / 2);
        }
        if Candidate::bytes(&lights, &strokes, widest, cloud) > MOST_BYTES {
            full = true;
            return Ok(None);
        }
        let settings = ResponseSettings { channels: widest, ..choice.settings };
        let same = solved.as_ref().filter(|tests| tests.iter().map(|t| &t.lights).eq(strokes.iter()));
        let known = same.map(Vec::as_slice);
        let whole = Whole { distant: clouds.distant.len(), flashes: &flashes };
        let candidate = Candidate::new(cloud, &lights, whole, &settings, (&strokes, known), &Quiet)?;
        solved = Some(candidate.tests());
        progress.advance(1);
        search.at(spacing_m, &candidate)
    };
    let mut best: Option<Tried> = None;
    for &spacing_m in &spacings {
        let before = search.tried.len();
        let found = attempt(&mut search, spacing_m)?;
        if search.tried.len() == before {
            // No memory or time for this one; finer ones take more.
            break;
        }
        match (&best, found) {
            (None, found) => best = found,
            (Some(known), Some(found)) if search.prefers(&found, known) => best = Some(found),
            // Past the cheapest, finer lamps only take more.
            _ => break,
        }
    }
    if let (Some(mut known), true) = (best, spacings.len() > 1) {
        for step in NEARER {
            for factor in [libm::exp2(step), libm::exp2(-step)] {
                if let Some(found) = attempt(&mut search, known.spacing_m * factor)?
                    && search.prefers(&found, &known)
                {
                    known = found;
                    break;
                }
            }
        }
        best = Some(known);
    }
    let Some(best) = best else { return Err(search.not_reached(full)) };
    choice.tried += search.tried.len();
    choice.spacing_m = best.spacing_m;
    choice.settings.channels = best.channels;
    choice.settings.relative_error = best.error;
    // In the measures that were asked for, the one that is nearest to what was asked.
    let error = |tried: &&Tried| {
        let scores = tried.outcome.scores;
        if clouds.budget.errors() { clouds.budget.over(&scores) } else { scores.stroke.l2 }
    };
    // In what binds: bytes, or milliseconds where those alone are asked for.
    let in_ms =
        clouds.budget.relight_ms.is_some() && clouds.budget.bytes.is_none() && !clouds.budget.errors();
    let cost = |tried: &&Tried| if in_ms { tried.outcome.relight_ms } else { tried.outcome.bytes as f64 };
    let better = search.tried.iter().filter(|t| error(t) < error(&&best) && cost(t) > cost(&&best));
    choice.next_better = better.min_by(|a, b| cost(a).total_cmp(&cost(b))).map(Tried::words);
    let cheaper = search.tried.iter().filter(|t| cost(t) < cost(&&best));
    choice.next_cheaper = cheaper.min_by(|a, b| error(a).total_cmp(&error(b))).map(Tried::words);
    Ok(choice)
}

/// Channels that may be chosen, from few to many.
fn channels(clouds: &Clouds, cloud: &Cloud) -> Vec<DirectionalBasis> {
    // Direct light inside the rows is too sharp for harmonics: whoever wants it there says in what channels.
    let fixed = clouds.given.channels
        || clouds.response.direct == DirectTerm::InRows
        || clouds.budget.stroke_l2.is_none() && !clouds.budget.costs();
    if fixed {
        return vec![clouds.response.channels];
    }
    // Towards eyes only where they stand apart; last the widest, which the others are made from.
    let view_region = clouds.response.view_region.filter(|view_region| stand_apart(cloud, view_region));
    let view_region = view_region
        .iter()
        .flat_map(|_| (0..=MAX_VIEW_DEGREE).map(|degree| DirectionalBasis::ViewRegion { degree }));
    view_region.chain((0..=3).map(|degree| DirectionalBasis::Harmonics { degree })).collect()
}

/// Errors of coding that may be chosen, from coarse to fine.
fn errors(clouds: &Clouds) -> Vec<f64> {
    if clouds.given.error {
        return vec![clouds.response.relative_error];
    }
    (0..ERRORS).map(|i| COARSEST_ERROR * libm::exp2(-0.25 * i as f64)).collect()
}

struct Search<'a> {
    clouds: &'a Clouds,
    margins: Margins,
    channels: Vec<DirectionalBasis>,
    errors: Vec<f64>,
    tried: Vec<Tried>,
}

impl Search<'_> {
    /// The best candidate at one spacing, if any meets the budget.
    fn at(&mut self, spacing_m: f64, candidate: &Candidate<'_>) -> Result<Option<Tried>, BakeError> {
        let mut best: Option<Tried> = None;
        for channels in self.channels.clone() {
            // The figures fall with the error and bytes rise: where they begin or cease to be met is found by halving.
            let (mut low, mut high) = (0, self.errors.len());
            let by_error = self.clouds.budget.errors();
            while low < high {
                let middle = (low + high) / 2;
                let error = self.errors[middle];
                let outcome = candidate.code(channels, self.clouds.response.codec, error)?;
                let tried = Tried { spacing_m, channels, error, outcome };
                self.tried.push(tried);
                let budget = &self.clouds.budget;
                let good = budget.over(&outcome.scores) <= self.margins.errors;
                let fits = budget.over_cost(outcome.bytes, outcome.relight_ms) <= self.margins.costs;
                if good && fits && best.is_none_or(|best| self.prefers(&tried, &best)) {
                    best = Some(tried);
                }
                // By error the coarsest that is good enough, by bytes alone the finest that fits.
                if if by_error { good } else { !fits } {
                    high = middle;
                } else {
                    low = middle + 1;
                }
            }
        }
        Ok(best)
    }

    /// Whether `a`, which meets the budget, is to be preferred to `b`, which does too.
    fn prefers(&self, a: &Tried, b: &Tried) -> bool {
        if self.clouds.budget.errors() {
            a.outcome.bytes < b.outcome.bytes
        } else {
            a.outcome.scores.stroke.l2 < b.outcome.scores.stroke.l2
        }
    }

    fn not_reached(&self, full: bool) -> BakeError {
        let budget = &self.clouds.budget;
        let wanted = [
            budget.stroke_l2.map(|v| format!("stroke_l2 {v}")),
            budget.relit_l2.map(|v| format!("relit_l2 {v}")),
            budget.bytes.map(|v| format!("{v} bytes")),
            budget.relight_ms.map(|v| format!("relight_ms {v}")),
            (self.margins.errors < SAFETY)
                .then(|| format!("on the tried strokes {:.3} of that", self.margins.errors)),
        ];
        let worst = |tried: &&Tried| budget.over(&tried.outcome.scores);
        let cost = |tried: &Tried| budget.over_cost(tried.outcome.bytes, tried.outcome.relight_ms);
        let fits = |tried: &&Tried| cost(tried) <= 1.0;
        let best = self.tried.iter().filter(fits).min_by(|a, b| worst(a).total_cmp(&worst(b)));
        let smallest = self.tried.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let given = &self.clouds.given;
        let mut hints = Vec::new();
        for (is_given, key) in [
            (given.spacing, "clouds.lightning.spacing_m"),
            (given.channels, "clouds.response.channels"),
            (given.error, "clouds.response.error"),
        ] {
            if is_given {
                hints.push(format!("leave {key} to the budget"));
            }
        }
        if full {
            hints.push("a coarser cloud grid, or a smaller reach, leaves memory for finer lamps".into());
        }
        if budget.bytes.is_some() {
            hints.push("allow more bytes".into());
        }
        if budget.relight_ms.is_some() {
            hints.push("allow more milliseconds".into());
        }
        if self.clouds.response.view_region.is_none() {
            hints.push("say in [clouds.eyes] where it is looked at from".into());
        }
        hints.push("ask for less".into());
        BakeError::NotReached {
            what: "clouds.budget".into(),
            wanted: wanted.into_iter().flatten().collect::<Vec<_>>().join(", "),
            reached: best.or(smallest).map_or("nothing".into(), |tried| tried.words()),
            hint: format!("what helps: {}", hints.join("; ")),
        }
    }
}
