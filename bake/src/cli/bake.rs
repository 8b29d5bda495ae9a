//! `squall bake RECIPE -o ASSET`

mod ahead;
mod report;

use super::common::{CacheArgs, Common, Memory};
use super::limits::{self, Limit};
use super::picture::PictureFile;
use super::progress::Bars;
use super::{asset, depfile, folder, json, table};
use report::Report;
use squall_bake::BakeError;
use squall_bake::estimate::estimate;
use squall_bake::metrics::Figures;
use squall_bake::output::{Output, Place};
use squall_bake::progress::Progress;
use squall_bake::provenance::changes;
use squall_bake::{memory, pipeline, recipe::Recipe};
use squall_formats::container::{self, OutSection};
use squall_formats::section::provenance::ProvenanceSection;
use squall_formats::section::response::ResponseSection;
use squall_formats::section::streak::StreakSection;
use squall_runtime::frame::FrameQuality;
use squall_runtime::{Asset, RuntimeError, StormRenderer, verify};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Bakes a recipe into one asset.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The recipe, TOML.
    recipe: PathBuf,
    /// The asset to write; - is standard output.
    #[arg(short, long, required_unless_present_any = ["check", "dry_run"])]
    out: Option<PathBuf>,
    /// Draws the recipe's own view from the bytes just written, as `render --quality preview` does: .png or .exr.
    #[arg(long)]
    preview: Option<PathBuf>,
    /// Does nothing where the asset is there and whole, and was made from this recipe and these inputs by this version.
    #[arg(long)]
    if_changed: bool,
    /// Writes what the asset depends on, for Make and Ninja.
    #[arg(long, value_name = "FILE")]
    depfile: Option<PathBuf>,
    /// Reads recipe and inputs, and bakes nothing.
    #[arg(long, conflicts_with_all = ["preview", "if_changed", "depfile", "max_error", "dry_run"])]
    check: bool,
    /// Says what would be baked, and what that is likely to take; bakes nothing.
    #[arg(long, conflicts_with_all = ["preview", "if_changed", "depfile", "max_error"])]
    dry_run: bool,
    /// Most that a measured figure may be, such as stroke_l2=0.25; several by giving it again. Above it the exit code is 1 and
    /// nothing is written.
    #[arg(long, value_name = "METRIC=VALUE", value_parser = limits::parse)]
    max_error: Vec<Limit>,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    common: Common,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }

    /// Outputs that files are named for.
    fn outputs(&self) -> Vec<&Path> {
        [&self.out, &self.preview, &self.depfile].into_iter().flatten().map(PathBuf::as_path).collect()
    }

    /// Ends the command (exit code 2) where options do not go together.
    fn check_usage(&self) {
        json::check_stdout(self.json, &self.outputs());
        let is_file = self
            .out
            .as_deref()
            .is_none_or(|out| !matches!(Place::of(out), Ok(Place::Stdout | Place::Stream(_))));
        if !is_file && (self.if_changed || self.depfile.is_some()) {
            json::usage("--if-changed and --depfile need an asset that is a file");
        }
    }
}

pub fn run(args: Args) -> anyhow::Result<()> {
    args.check_usage();
    let start = Instant::now();
    let recipe = Recipe::read(&args.recipe)?;
    memory::require_grid(&recipe, args.memory.limit())?;
    if args.preview.is_some() && recipe.view.is_none() {
        return Err(BakeError::input(&args.recipe, "view", "a table [view] to preview", "none").into());
    }
    let inputs = recipe.inputs()?;
    folder::check_apart(&args.outputs(), inputs.iter())?;
    let Some(out) = args.out.as_deref().filter(|_| !args.check && !args.dry_run) else {
        return ahead::run(&args, &recipe);
    };
    let depends = args.depfile.as_deref().map(|path| {
        let rule = depfile::rule(out, inputs.iter().map(PathBuf::as_path))?;
        Ok::<_, BakeError>((Output::prepare(path)?, rule))
    });
    let depends = depends.transpose()?;
    let unchanged = if args.if_changed { unchanged(&recipe, out)? } else { None };
    let bars = args.common.start()?;
    let mut report = Report::new(&args.recipe, out);
    if let Some(asset) = unchanged {
        keep(&args, &recipe, asset, &bars, &mut report)?;
    } else {
        bake(&args, &recipe, out, &bars, &mut report)?;
    }
    if let Some((file, rule)) = depends {
        file.write(|out| out.write_all(rule.as_bytes()))?;
    }
    report.seconds = start.elapsed().as_secs_f64();
    if args.json { json::answer(&report.in_json()) } else { Ok(()) }
}

/// Bakes, and writes what was baked where its figures are within bounds.
fn bake(args: &Args, recipe: &Recipe, file: &Path, bars: &Bars, report: &mut Report) -> anyhow::Result<()> {
    let start = Instant::now();
    let out = Output::prepare(file)?;
    let preview = args.preview.as_deref().map(|path| PictureFile::prepare(path, None)).transpose()?;
    memory::require_bake(recipe, rayon::current_num_threads() as u64, args.memory.limit())?;
    let cache =
        args.cache.open(file, || Ok(estimate(recipe)?.clouds.map_or(0.0, |clouds| clouds.cpu_seconds)))?;
    let baked = pipeline::bake_with(recipe, cache.as_ref(), bars)?;
    bars.check()?;
    let length = container::write(&mut std::io::sink(), &baked.sections)?;
    report.figures = figures(&baked.sections, &baked.provenance, length)?;
    let seconds = start.elapsed().as_secs_f64();
    let table = table::stages(&baked.stages, (&out.name(), length), seconds);
    // A build that goes on with what lies in the asset's place must not find there what was refused.
    if let Err(over) = limits::check(&args.max_error, &report.figures, &out.name()) {
        bars.say(&table);
        return Err(over.into());
    }
    out.write(|out| container::write(out, &baked.sections).map(|_| ()))?;
    bars.say(&table);
    if let Some(cache) = &cache {
        report.cached(cache, bars);
    }
    report.warn(recipe, bars);
    report.stages = baked.stages;
    let Some(preview) = preview else { return Ok(()) };
    // What was written need not be a file.
    let mut whole = Vec::with_capacity(length as usize);
    container::write(&mut whole, &baked.sections)?;
    draw(Asset::from_bytes(&whole)?, &preview, bars, report)
}

/// Keeps an asset that a bake would only make again.
fn keep(args: &Args, recipe: &Recipe, asset: Asset, bars: &Bars, report: &mut Report) -> anyhow::Result<()> {
    report.unchanged = true;
    report.figures = figures_of(&asset)?;
    let name = asset.path().display().to_string();
    bars.say(&format!(
        "{name}: unchanged, nothing to do: made from this recipe and these inputs by this version"
    ));
    report.warn(recipe, bars);
    limits::check(&args.max_error, &report.figures, &name)?;
    match args.preview.as_deref().filter(|path| !path.exists()) {
        Some(missing) => draw(asset, &PictureFile::prepare(missing, None)?, bars, report),
        None => Ok(()),
    }
}

/// Draws an asset's own view.
fn draw(asset: Asset, preview: &PictureFile, bars: &Bars, report: &mut Report) -> anyhow::Result<()> {
    let start = Instant::now();
    bars.begin("preview", 1);
    let mut renderer = StormRenderer::new(asset)?;
    let Some(frame) = renderer.frame() else { return Ok(()) };
    renderer.render(&frame.quality(FrameQuality::PREVIEW))?;
    preview.write(renderer.picture(), &renderer.tone())?;
    bars.say(&preview.words(renderer.picture(), &renderer.report(), start.elapsed().as_secs_f64()));
    report.preview = Some(preview.name());
    Ok(())
}

/// The asset that stands at `out`, if a bake would only make it again.
///
/// Errors: an input that cannot be read; the asset may be anything.
fn unchanged(recipe: &Recipe, out: &Path) -> Result<Option<Asset>, BakeError> {
    let read = || -> Result<(Asset, ProvenanceSection), RuntimeError> {
        let asset = asset::open(out)?;
        let provenance = asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read)?;
        Ok((asset, provenance))
    };
    // What cannot be read has to be baked.
    let Ok((asset, provenance)) = read() else { return Ok(None) };
    let same = changes(recipe, &provenance)?.is_empty() && verify::verify(&asset).is_ok();
    Ok(same.then_some(asset))
}

/// Figures of what is about to be written.
fn figures(
    sections: &[OutSection],
    provenance: &ProvenanceSection,
    length: u64,
) -> Result<Figures, BakeError> {
    let find = |tag| sections.iter().find(|section| section.tag == tag);
    let streaks = find(StreakSection::TAG).map(|section| {
        StreakSection::read(&section.to_bytes(), section.version, &Default::default())
            .map_err(|error| BakeError::bytes(Path::new("(memory)"), error))
    });
    let response = find(ResponseSection::TAG).map(OutSection::length);
    Ok(Figures::new(provenance, streaks.transpose()?.as_ref(), response, length))
}

/// Figures of an asset.
fn figures_of(asset: &Asset) -> Result<Figures, RuntimeError> {
    let find = |tag| asset.directory().find(tag);
    let provenance = asset.section(ProvenanceSection::TAG, "provenance", ProvenanceSection::read)?;
    let streaks = find(StreakSection::TAG)
        .map(|_| asset.section(StreakSection::TAG, "streak patterns", StreakSection::read));
    let response = find(ResponseSection::TAG).map(|entry| entry.length);
    Ok(Figures::new(&provenance, streaks.transpose()?.as_ref(), response, asset.bytes().len() as u64))
}
