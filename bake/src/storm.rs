//! From a recipe to an asset, stage by stage, in the order of the data: inputs, streaks, density, cloud response, sections.

pub(crate) mod clouds;

use crate::budget::streaks::{METHODS, choose_pattern, stored_bytes};
use crate::density::{bake_chosen, error_at_nodes};
use crate::error::BakeError;
use crate::input::picture::read_grey;
use crate::input::town::read_town;
use crate::progress::Progress;
use crate::provenance::{self, input_record};
use crate::recipe::{Rain, Recipe};
use crate::streak;
use clouds::bake_clouds;
use squall_formats::container::OutSection;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::provenance::{BudgetRecord, ProvenanceSection};
use squall_formats::section::streak::{Method, StreakPattern, StreakSection};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// One line of the closing table.
#[derive(Clone, Debug, PartialEq)]
pub struct StageReport {
    /// Which stage.
    pub stage: &'static str,
    /// What it made, in words.
    pub made: String,
    /// Wall-clock seconds; never inside the asset.
    pub seconds: f64,
    /// Bytes in the asset.
    pub bytes: u64,
    /// Its error, in words with unit.
    pub error: String,
}

/// An asset ready to be written.
pub struct Baked {
    /// Sections in file order.
    pub sections: Vec<OutSection>,
    /// What each stage made.
    pub stages: Vec<StageReport>,
    /// What it was made from, and the figures measured: as in the sections.
    pub provenance: ProvenanceSection,
}

/// A stage's clock.
struct Stage(Instant);

impl Stage {
    fn done(self, stage: &'static str, made: String, bytes: u64, error: String) -> StageReport {
        StageReport { stage, made, seconds: self.0.elapsed().as_secs_f64(), bytes, error }
    }
}

/// Bakes a recipe.
///
/// Errors: an input that is missing or out of range, a method that cannot reach what was asked, an interruption.
pub fn bake(recipe: &Recipe, progress: &dyn Progress) -> Result<Baked, BakeError> {
    let mut made_from = ProvenanceSection {
        tool: provenance::tool(),
        recipe_hash: provenance::recipe_hash(recipe),
        inputs: Vec::new(),
        budgets: Vec::new(),
    };
    let (mut sections, mut stages) = (Vec::new(), Vec::new());
    if let Some(rain) = &recipe.rain {
        bake_rain(recipe, rain, &mut made_from, &mut sections, &mut stages, progress)?;
    }
    if let Some(path) = &recipe.town {
        let start = Stage(Instant::now());
        let town = read_town(path)?;
        record(recipe, path, &mut made_from)?;
        let made = format!("{} blocks, {} lamps", town.blocks.len(), town.lamps.len());
        let section = town.write();
        stages.push(start.done("town", made, section.length(), "as given".into()));
        sections.push(section);
    }
    if let Some(view) = &recipe.view {
        sections.push(view.write());
    }
    if !recipe.strokes.is_empty() {
        sections.push(BoltSection { strokes: recipe.strokes.clone() }.write());
    }
    if let Some(clouds) = &recipe.clouds {
        bake_clouds(recipe, clouds, &mut made_from, &mut sections, &mut stages, progress)?;
    }
    sections.insert(0, made_from.write());
    Ok(Baked { sections, stages, provenance: made_from })
}

/// Records a file's length and hash under the name that the recipe gives it.
fn record(recipe: &Recipe, path: &Path, provenance: &mut ProvenanceSection) -> Result<(), BakeError> {
    provenance.inputs.push(input_record(recipe, path)?);
    Ok(())
}

fn bake_rain(
    recipe: &Recipe,
    rain: &Rain,
    provenance: &mut ProvenanceSection,
    sections: &mut Vec<OutSection>,
    stages: &mut Vec<StageReport>,
    progress: &dyn Progress,
) -> Result<(), BakeError> {
    if !rain.pictures.is_empty() {
        let start = Stage(Instant::now());
        progress.begin("streaks", rain.pictures.len() as u64);
        let (patterns, next_cheaper) = fit_streaks(rain, progress)?;
        for path in &rain.pictures {
            record(recipe, path, provenance)?;
        }
        let worst = patterns.iter().map(|p| p.psnr_db).fold(f64::INFINITY, f64::min);
        let mean = patterns.iter().map(|p| p.psnr_db).sum::<f64>() / patterns.len() as f64;
        let terms: usize = patterns.iter().map(|pattern| pattern.pattern.terms()).sum();
        let method = rain.fit.method.name();
        provenance.budgets.push(match rain.psnr_db {
            Some(asked) => BudgetRecord {
                part: "streaks".into(),
                metric: "least PSNR of a pattern after quantisation, dB".into(),
                asked: Some(asked),
                got: worst,
                chosen: format!("{}, {terms} cosines in {} patterns", methods_of(&patterns), patterns.len()),
                next_better: streaks_beyond(rain, &patterns)?,
                next_cheaper: next_cheaper.map(|pattern| pattern_words(&pattern)),
            },
            None => BudgetRecord {
                part: "streaks".into(),
                metric: "mean PSNR after quantisation, dB".into(),
                asked: None,
                got: mean,
                chosen: format!("{method}, {} cosines", rain.fit.cosines),
                next_better: None,
                next_cheaper: None,
            },
        });
        let made = format!("{} patterns of {terms} cosines in all", patterns.len());
        let section = StreakSection { patterns };
        let section = OutSection::small(StreakSection::TAG, StreakSection::VERSION, false, section.write());
        let error = format!("PSNR {mean:.1} dB, worst {worst:.1} dB");
        stages.push(start.done("streaks", made, section.length(), error));
        sections.push(section);
    }
    let start = Stage(Instant::now());
    progress.begin("density tables", 1);
    let chosen = bake_chosen(&rain.density)?;
    let classes_record = chosen.record(rain.density.class_error)?;
    let classes = chosen.classes();
    let density = &chosen.section;
    progress.advance(1);
    let neighbour = |step: isize| -> Result<Option<String>, BakeError> {
        let found = error_at_nodes(&chosen.spec, density.rates.len(), step)?;
        Ok(found.map(|(nodes, error)| format!("{nodes} rates: {error:.2e}")))
    };
    provenance.budgets.push(BudgetRecord {
        part: "density".into(),
        metric: "largest relative error of a class's count between nodes".into(),
        asked: Some(rain.density.relative_error),
        got: density.measured_error,
        chosen: format!("{} rates, {classes}", density.rates.len()),
        next_better: neighbour(1)?,
        next_cheaper: neighbour(-1)?,
    });
    let error = format!(
        "counts within {:.4} %, fall {:.1} %",
        100.0 * density.measured_error,
        100.0 * classes_record.got
    );
    provenance.budgets.push(classes_record);
    let section = density.to_section();
    let made = format!("{classes}, {} modes", density.tables.len());
    stages.push(start.done("density tables", made, section.length(), error));
    sections.push(section);
    Ok(())
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

/// The patterns, and where a PSNR chose them the one that came nearest to it with fewer bytes.
type Fitted = (Vec<StreakPattern>, Option<StreakPattern>);

fn fit_streaks(rain: &Rain, progress: &dyn Progress) -> Result<Fitted, BakeError> {
    use rayon::prelude::*;
    let methods = if rain.method_given { std::slice::from_ref(&rain.fit.method) } else { &METHODS };
    let fit = |path: &PathBuf| -> Result<(StreakPattern, Option<StreakPattern>), BakeError> {
        progress.check()?;
        let picture = read_grey(path)?;
        let source = streak::Source { file: path, picture: &picture, notes: None };
        let fitted = match rain.psnr_db {
            None => (streak::fit(&source, rain.fit)?, None),
            Some(asked) => {
                let chosen = choose_pattern(&source, methods, asked)?;
                (chosen.pattern, chosen.cheaper)
            }
        };
        progress.advance(1);
        Ok(fitted)
    };
    let fitted: Vec<Result<_, BakeError>> = rain.pictures.par_iter().map(fit).collect();
    let (mut patterns, mut nearest) = (Vec::new(), None::<StreakPattern>);
    for one in fitted {
        let (pattern, cheaper) = one?;
        if let Some(cheaper) = cheaper
            && nearest.as_ref().is_none_or(|best| cheaper.psnr_db > best.psnr_db)
        {
            nearest = Some(cheaper);
        }
        patterns.push(pattern);
    }
    Ok((patterns, nearest))
}

/// What the next number of cosines would make of the worst pattern.
fn streaks_beyond(rain: &Rain, patterns: &[StreakPattern]) -> Result<Option<String>, BakeError> {
    let worst = patterns.iter().zip(&rain.pictures).min_by(|(a, _), (b, _)| a.psnr_db.total_cmp(&b.psnr_db));
    let Some((pattern, path)) = worst else { return Ok(None) };
    let more = crate::budget::streaks::COUNTS.into_iter().find(|&count| count > pattern.pattern.terms());
    let Some(cosines) = more else { return Ok(None) };
    let picture = read_grey(path)?;
    let source = streak::Source { file: path, picture: &picture, notes: None };
    let better = streak::fit(&source, streak::FitSettings { cosines, method: pattern.method })?;
    Ok((better.psnr_db > pattern.psnr_db).then(|| pattern_words(&better)))
}
