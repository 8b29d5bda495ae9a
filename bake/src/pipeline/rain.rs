//! Rain's part of a bake: streak patterns fitted to pictures, and tables of how many there are.

use super::stage::{Clock, StageOutput};
use crate::density::error_at_nodes;
use crate::error::BakeError;
use crate::input::Fingerprint;
use crate::input::picture::{Grey, grey_of, picture_file};
use crate::input::streak_notes::StreakNotes;
use crate::plan::density::bake_chosen;
use crate::plan::streaks::{COUNTS, ChosenPattern, METHODS, choose_pattern, stored_bytes};
use crate::progress::Progress;
use crate::provenance::input_record;
use crate::recipe::model::{FitSettings, Rain, Recipe};
use crate::streak::{Source, fit};
use rayon::prelude::*;
use squall_formats::container::OutSection;
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::streak::{Method, StreakPattern, StreakSection};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Sections of rain, if the recipe has any.
///
/// Errors: a picture that is missing or damaged, a budget out of reach, an interruption.
pub(super) fn rain(recipe: &Recipe, progress: &dyn Progress) -> Result<StageOutput, BakeError> {
    let Some(rain) = &recipe.rain else { return Ok(StageOutput::default()) };
    let mut output = streaks(recipe, rain, progress)?;
    output.append(density(rain, progress)?);
    output.append(super::rain_map::place(recipe, rain)?);
    Ok(output)
}

fn streaks(recipe: &Recipe, rain: &Rain, progress: &dyn Progress) -> Result<StageOutput, BakeError> {
    if rain.pictures.is_empty() {
        return Ok(StageOutput::default());
    }
    let clock = Clock::start();
    progress.begin("streaks", rain.pictures.len() as u64);
    let (fitted, worst_picture) = fit_streaks(rain, progress)?;
    let inputs = fitted.iter().map(|one| input_record(recipe, &one.input)).collect();
    let nearest = fitted.iter().filter_map(|one| one.chosen.cheaper.as_ref());
    // The first of those that are as near.
    let nearest = nearest.reduce(|best, next| if next.psnr_db > best.psnr_db { next } else { best });
    let next_cheaper = nearest.map(pattern_words);
    let patterns: Vec<StreakPattern> = fitted.into_iter().map(|one| one.chosen.pattern).collect();
    let worst = patterns.iter().map(|p| p.psnr_db).fold(f64::INFINITY, f64::min);
    let mean = patterns.iter().map(|p| p.psnr_db).sum::<f64>() / patterns.len() as f64;
    let terms: usize = patterns.iter().map(|pattern| pattern.pattern.terms()).sum();
    let budget = match rain.psnr_db {
        Some(asked) => BudgetRecord {
            part: "streaks".into(),
            metric: "least PSNR of a pattern after quantisation, dB".into(),
            asked: Some(asked),
            got: worst,
            chosen: format!("{}, {terms} cosines in {} patterns", methods_of(&patterns), patterns.len()),
            next_better: streaks_beyond(worst_picture, &patterns)?,
            next_cheaper,
        },
        None => BudgetRecord {
            part: "streaks".into(),
            metric: "mean PSNR after quantisation, dB".into(),
            asked: None,
            got: mean,
            chosen: format!("{}, {} cosines", rain.fit.method.name(), rain.fit.cosines),
            next_better: None,
            next_cheaper: None,
        },
    };
    let made = format!("{} patterns of {terms} cosines in all", patterns.len());
    let section = StreakSection { patterns };
    let section = OutSection::small(StreakSection::TAG, section.version(), false, section.write());
    let error = format!("PSNR {mean:.1} dB, worst {worst:.1} dB");
    let report = clock.report("streaks", made, section.length(), error);
    Ok(StageOutput { sections: vec![section], inputs, budgets: vec![budget], reports: vec![report] })
}

fn density(rain: &Rain, progress: &dyn Progress) -> Result<StageOutput, BakeError> {
    let clock = Clock::start();
    progress.begin("density tables", 1);
    let chosen = bake_chosen(&rain.density)?;
    let fall = chosen.record(rain.density.class_error)?;
    let classes = chosen.classes();
    let table = &chosen.section;
    progress.advance(1);
    let neighbour = |step: isize| -> Result<Option<String>, BakeError> {
        let found = error_at_nodes(&chosen.spec, table.rates.len(), step)?;
        Ok(found.map(|(nodes, error)| format!("{nodes} rates: {error:.2e}")))
    };
    let counts = BudgetRecord {
        part: "density".into(),
        metric: "largest relative error of a class's count between nodes".into(),
        asked: Some(rain.density.relative_error),
        got: table.measured_error,
        chosen: format!("{} rates, {classes}", table.rates.len()),
        next_better: neighbour(1)?,
        next_cheaper: neighbour(-1)?,
    };
    let error =
        format!("counts within {:.4} %, fall {:.1} %", 100.0 * table.measured_error, 100.0 * fall.got);
    let section = table.to_section();
    let made = format!("{classes}, {} modes", table.tables.len());
    let report = clock.report("density tables", made, section.length(), error);
    let budgets = vec![counts, fall];
    Ok(StageOutput { sections: vec![section], budgets, reports: vec![report], ..StageOutput::default() })
}

/// A pattern's setting, error and cost.
fn pattern_words(pattern: &StreakPattern) -> String {
    let (method, terms) = (pattern.method.name(), pattern.pattern.terms());
    let (name, psnr, bytes) = (&pattern.name, pattern.psnr_db, stored_bytes(pattern));
    format!("{method}, {terms} cosines in {name}: {psnr:.2} dB, {bytes} bytes")
}

/// Names of the methods that patterns were fitted by.
fn methods_of(patterns: &[StreakPattern]) -> String {
    let used = Method::ALL.into_iter().filter(|method| patterns.iter().any(|p| p.method == *method));
    used.map(Method::name).collect::<Vec<_>>().join(" and ")
}

/// A picture's pattern, with the nearest that takes fewer bytes where a PSNR chose it, and the file as it was read.
struct Fitted {
    chosen: ChosenPattern,
    input: Fingerprint,
}

/// The picture whose pattern is worst, with its place: the first of those that are as bad.
struct Worst {
    psnr_db: f64,
    at: usize,
    picture: Grey,
}

/// Patterns of all pictures, in their order; where a PSNR chose them, the picture whose pattern is worst too.
fn fit_streaks(rain: &Rain, progress: &dyn Progress) -> Result<(Vec<Fitted>, Option<Worst>), BakeError> {
    let methods = if rain.method_given { std::slice::from_ref(&rain.fit.method) } else { &METHODS };
    let worst: Mutex<Option<Worst>> = Mutex::new(None);
    let fit_one = |(at, path): (usize, &PathBuf)| -> Result<Fitted, BakeError> {
        progress.check()?;
        let input = picture_file(path)?;
        let picture = grey_of(&input, rain.layer.as_deref())?.picture;
        let shown = StreakNotes::of(&input)?;
        let input = input.fingerprint();
        let told = |mut pattern: StreakPattern| {
            if let Some(StreakNotes { drop, scene }) = shown {
                (pattern.notes, pattern.scene) = (Some(drop), Some(scene));
                pattern = pattern.quantised();
            }
            pattern
        };
        let source = Source { file: path, picture: &picture, notes: None };
        let Some(asked) = rain.psnr_db else {
            let pattern = told(fit(&source, rain.fit)?);
            progress.advance(1);
            return Ok(Fitted { chosen: ChosenPattern { pattern, cheaper: None }, input });
        };
        let mut chosen = choose_pattern(&source, methods, asked)?;
        chosen.pattern = told(chosen.pattern);
        progress.advance(1);
        let psnr_db = chosen.pattern.psnr_db;
        let mut worst = worst.lock().unwrap_or_else(PoisonError::into_inner);
        let worse = |other: &Worst| psnr_db.total_cmp(&other.psnr_db).then(at.cmp(&other.at)).is_lt();
        if worst.as_ref().is_none_or(worse) {
            *worst = Some(Worst { psnr_db, at, picture });
        }
        Ok(Fitted { chosen, input })
    };
    let fitted: Vec<Result<_, BakeError>> = rain.pictures.par_iter().enumerate().map(fit_one).collect();
    let fitted = fitted.into_iter().collect::<Result<_, _>>()?;
    Ok((fitted, worst.into_inner().unwrap_or_else(PoisonError::into_inner)))
}

/// What the next number of cosines would make of the worst pattern.
fn streaks_beyond(worst: Option<Worst>, patterns: &[StreakPattern]) -> Result<Option<String>, BakeError> {
    let Some(Worst { at, picture, .. }) = worst else { return Ok(None) };
    let pattern = &patterns[at];
    let more = COUNTS.into_iter().find(|&count| count > pattern.pattern.terms());
    let Some(cosines) = more else { return Ok(None) };
    // Its name is the pattern's; nothing is read again.
    let source = Source { file: Path::new(&pattern.name), picture: &picture, notes: None };
    let better = fit(&source, FitSettings { cosines, method: pattern.method })?;
    Ok((better.psnr_db > pattern.psnr_db).then(|| pattern_words(&better)))
}
