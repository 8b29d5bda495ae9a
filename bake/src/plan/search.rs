//! Spacing of the virtual lights, basis of the rows and error of their coding, where a recipe leaves them to its budget.
//!
//! Candidates are tried on strokes of their own, never on the held-out ones that confirm the result: each spacing's rows that those
//! strokes touch are solved once, coded in several ways and relit from bytes. The cost is the response's bytes, estimated from the
//! tried rows; what a row takes differs little from one virtual light to the next. Budgets of bytes and of milliseconds
//! ([`crate::evaluate::cost`]) bound it.

use super::budget::{Excess, Margins, SAFETY, wishes};
use super::candidates::{Tried, bases, errors, spacings};
use super::lights::{Site, TRIED_STROKES};
use crate::error::BakeError;
use crate::evaluate::candidate::Candidate;
use crate::progress::{Progress, Quiet};
use crate::recipe::model::{CloudBudget, ResponseSettings};
use crate::response::{HeldOutStroke, Job, Sources};
use squall_formats::section::response::DirectionalBasis;
use squall_runtime::relight::PointLight;

/// Powers of two by which spacings beside the best are tried after that, from far to near: rows go with the third power.
const NEARER: [f64; 3] = [0.25, 0.125, 0.0625];
/// Most bytes that a candidate's solved rows may take.
const MOST_BYTES: usize = 3 << 29;

/// The search for the cheapest setting that meets a budget.
pub(super) struct Search<'a> {
    site: &'a Site<'a>,
    settings: ResponseSettings,
    margins: Margins,
    bases: Vec<DirectionalBasis>,
    errors: Vec<f64>,
    tried: Vec<Tried>,
    /// Whether a spacing was left out for want of memory or time.
    full: bool,
    /// Strokes that do not depend on the spacing are solved for once.
    known: Vec<HeldOutStroke>,
}

impl<'a> Search<'a> {
    /// `settings` are what the recipe states, and what was chosen of the solver.
    pub(super) fn new(site: &'a Site<'a>, settings: &ResponseSettings, margins: Margins) -> Self {
        Self {
            site,
            settings: *settings,
            margins: Margins { errors: margins.errors * SAFETY, costs: margins.costs * SAFETY, ..margins },
            bases: bases(site),
            errors: errors(site.clouds),
            tried: Vec::new(),
            full: false,
            known: Vec::new(),
        }
    }

    /// Settings that were tried.
    pub(super) fn tried(&self) -> usize {
        self.tried.len()
    }

    fn budget(&self) -> &'a CloudBudget {
        &self.site.clouds.budget
    }

    /// The cheapest candidate that meets the budget; where bytes or milliseconds alone are asked for, the best that fits.
    ///
    /// Errors: nothing does, with what came nearest; a solve that does not converge; an interruption.
    pub(super) fn best(&mut self, progress: &dyn Progress) -> Result<Tried, BakeError> {
        let spacings = spacings(self.site);
        progress.begin("budgets", spacings.len() as u64);
        let mut best: Option<Tried> = None;
        for &spacing_m in &spacings {
            let before = self.tried.len();
            let found = self.at_spacing(spacing_m, progress)?;
            if self.tried.len() == before {
                // No memory or time for this one; finer ones take more.
                break;
            }
            match (&best, found) {
                (None, found) => best = found,
                (Some(known), Some(found)) if self.prefers(&found, known) => best = Some(found),
                // Past the cheapest, finer grids only take more.
                _ => break,
            }
        }
        match best {
            Some(best) if spacings.len() > 1 => self.beside(best, progress),
            Some(best) => Ok(best),
            None => Err(self.not_reached()),
        }
    }

    /// The best of `known` and candidates at spacings beside its own.
    fn beside(&mut self, mut known: Tried, progress: &dyn Progress) -> Result<Tried, BakeError> {
        for step in NEARER {
            for factor in [libm::exp2(step), libm::exp2(-step)] {
                if let Some(found) = self.at_spacing(known.spacing_m * factor, progress)?
                    && self.prefers(&found, &known)
                {
                    known = found;
                    break;
                }
            }
        }
        Ok(known)
    }

    /// The best candidate at one spacing; none where its rows would take too much memory either.
    fn at_spacing(&mut self, spacing_m: f64, progress: &dyn Progress) -> Result<Option<Tried>, BakeError> {
        progress.check()?;
        let (site, cloud) = (self.site, self.site.cloud);
        // More virtual lights than days allow: the recipe did not name the spacing, so it is no mistake of its.
        let Ok(lights) = site.place_lights(spacing_m) else {
            self.full = true;
            return Ok(None);
        };
        let widest = self.bases.last().copied().unwrap_or(self.settings.basis);
        let mut strokes = site.tried_strokes(&lights, spacing_m)?;
        let bytes = |strokes: &[Vec<PointLight>]| Candidate::bytes(&lights, strokes, widest, cloud);
        while strokes.len() > TRIED_STROKES[0] && bytes(&strokes) > MOST_BYTES {
            strokes.truncate(strokes.len() / 2);
        }
        if bytes(&strokes) > MOST_BYTES {
            self.full = true;
            return Ok(None);
        }
        let settings = ResponseSettings { basis: widest, ..self.settings };
        let known = std::mem::take(&mut self.known);
        let same = known.iter().map(|stroke| &stroke.lights).eq(strokes.iter());
        let known = same.then_some(known.as_slice());
        let sources = Sources { lights, distant: site.clouds.distant.clone(), sun: None };
        let job = Job {
            cloud,
            sources: &sources,
            settings: &settings,
            held_out: &strokes,
            known,
            shown: Some(site.shown),
            cache: site.cache,
        };
        let candidate = Candidate::new(&job, &site.flashes, &Quiet)?;
        self.known = candidate.held_out();
        progress.advance(1);
        self.code(spacing_m, &candidate)
    }

    /// The best way to code one candidate's rows, if any meets the budget.
    fn code(&mut self, spacing_m: f64, candidate: &Candidate<'_>) -> Result<Option<Tried>, BakeError> {
        let budget = self.budget();
        let mut best: Option<Tried> = None;
        for basis in self.bases.clone() {
            // The figures fall with the error and bytes rise: where they begin or cease to be met is found by halving.
            let (mut low, mut high) = (0, self.errors.len());
            while low < high {
                let middle = (low + high) / 2;
                let error = self.errors[middle];
                let outcome = candidate.code(basis, self.settings.codec, error)?;
                let tried = Tried { spacing_m, basis, error, outcome };
                self.tried.push(tried);
                let excess = Excess::of(budget, &outcome);
                let (good, fits) = (excess.errors <= self.margins.errors, excess.costs <= self.margins.costs);
                if good && fits && best.is_none_or(|best| self.prefers(&tried, &best)) {
                    best = Some(tried);
                }
                // By error the coarsest that is good enough, by bytes alone the finest that fits.
                if if budget.errors() { good } else { !fits } {
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
        if self.budget().errors() {
            a.outcome.bytes < b.outcome.bytes
        } else {
            a.outcome.scores.stroke.l2 < b.outcome.scores.stroke.l2
        }
    }

    /// The cheapest candidate that is better than `best`, and the best that is cheaper, in words.
    pub(super) fn neighbours(&self, best: &Tried) -> [Option<String>; 2] {
        let budget = self.budget();
        // In the measures that were asked for, the one that is nearest to what was asked.
        let error = |tried: &Tried| match budget.errors() {
            true => Excess::of(budget, &tried.outcome).errors,
            false => tried.outcome.scores.stroke.l2,
        };
        // In what binds: bytes, or milliseconds where those alone are asked for.
        let in_ms = budget.relight_ms.is_some() && budget.bytes.is_none() && !budget.errors();
        let cost = |tried: &Tried| if in_ms { tried.outcome.relight_ms } else { tried.outcome.bytes as f64 };
        let better = self.tried.iter().filter(|t| error(t) < error(best) && cost(t) > cost(best));
        let cheaper = self.tried.iter().filter(|t| cost(t) < cost(best));
        [
            better.min_by(|a, b| cost(a).total_cmp(&cost(b))).map(Tried::to_string),
            cheaper.min_by(|a, b| error(a).total_cmp(&error(b))).map(Tried::to_string),
        ]
    }

    fn not_reached(&self) -> BakeError {
        let budget = self.budget();
        let mut wanted = wishes(budget);
        if self.margins.errors < SAFETY {
            wanted.push(format!("on the tried strokes {:.3} of that", self.margins.errors));
        }
        let excess = |tried: &Tried| Excess::of(budget, &tried.outcome);
        let fits = self.tried.iter().filter(|tried| excess(tried).costs <= 1.0);
        let best = fits.min_by(|a, b| excess(a).errors.total_cmp(&excess(b).errors));
        let smallest = self.tried.iter().min_by(|a, b| excess(a).costs.total_cmp(&excess(b).costs));
        BakeError::NotReached {
            what: "clouds.budget".into(),
            wanted: wanted.join(", "),
            reached: best.or(smallest).map_or("nothing".into(), Tried::to_string),
            hint: format!("what helps: {}", self.hints().join("; ")),
        }
    }

    /// What would help where no candidate meets the budget.
    fn hints(&self) -> Vec<String> {
        let (clouds, budget) = (self.site.clouds, self.budget());
        let mut hints = Vec::new();
        for (is_given, key) in [
            (clouds.given.spacing, "clouds.lightning.spacing_m"),
            (clouds.given.basis, clouds.keys.basis),
            (clouds.given.error, "clouds.response.error"),
        ] {
            if is_given {
                hints.push(format!("leave {key} to the budget"));
            }
        }
        if self.full {
            let words = "a coarser cloud grid, or smaller bounds, leaves memory for finer virtual lights";
            hints.push(words.into());
        }
        if budget.bytes.is_some() {
            hints.push("allow more bytes".into());
        }
        if budget.relight_ms.is_some() {
            hints.push("allow more milliseconds".into());
        }
        if clouds.response.view_region.is_none() {
            hints.push(format!("say in [{}] where it is looked at from", clouds.keys.view_region));
        }
        hints.push("ask for less".into());
        hints
    }
}
