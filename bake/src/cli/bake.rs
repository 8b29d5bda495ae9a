//! `squall bake RECIPE -o ASSET`
use super::common::{Common, Memory};
use super::folder;
use super::picture::PictureFile;
use super::table;
use squall_bake::BakeError;
use squall_bake::output::Output;
use squall_bake::progress::Progress;
use squall_bake::{memory, pipeline, recipe::Recipe};
use squall_formats::container;
use squall_runtime::{Asset, StormRenderer};
use std::cell::Cell;
use std::path::{Path, PathBuf};

/// Bakes a recipe into one asset.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The recipe, TOML.
    recipe: PathBuf,
    /// The asset to write; - is standard output.
    #[arg(short, long)]
    out: PathBuf,
    /// Draws the recipe's own view from the bytes just written: .png or .exr.
    #[arg(long)]
    preview: Option<PathBuf>,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    common: Common,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let start = std::time::Instant::now();
    let recipe = Recipe::read(&args.recipe)?;
    let limit = args.memory.limit();
    memory::require_grid(&recipe, limit)?;
    if args.preview.is_some() && recipe.view.is_none() {
        return Err(BakeError::input(&args.recipe, "view", "a table [view] to preview", "none").into());
    }
    let inputs = recipe.inputs()?;
    let outputs: Vec<&Path> = std::iter::once(&args.out).chain(&args.preview).map(PathBuf::as_path).collect();
    folder::check_apart(&outputs, inputs.iter())?;
    let out = Output::prepare(&args.out)?;
    let preview = args.preview.as_deref().map(|path| PictureFile::prepare(path, None)).transpose()?;
    let bars = args.common.start()?;
    memory::require_bake(&recipe, rayon::current_num_threads() as u64, limit)?;
    let baked = pipeline::bake(&recipe, &bars)?;
    bars.check()?;
    let bytes = Cell::new(0);
    out.write(|out| container::write(out, &baked.sections).map(|written| bytes.set(written)))?;
    let seconds = start.elapsed().as_secs_f64();
    bars.say(&table::stages(&baked.stages, (&out.name(), bytes.get()), seconds));
    let Some(preview) = preview else { return Ok(()) };
    let start = std::time::Instant::now();
    bars.begin("preview", 1);
    // What was written need not be a file.
    let mut whole = Vec::with_capacity(bytes.get() as usize);
    container::write(&mut whole, &baked.sections)?;
    let mut renderer = StormRenderer::new(Asset::from_bytes(&whole)?)?;
    let Some(frame) = renderer.frame() else { return Ok(()) };
    renderer.render(&frame)?;
    preview.write(renderer.picture(), &renderer.tone())?;
    bars.say(&preview.words(renderer.picture(), &renderer.report(), start.elapsed().as_secs_f64()));
    Ok(())
}
