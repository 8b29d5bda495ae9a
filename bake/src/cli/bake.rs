//! `squall bake RECIPE -o ASSET`
use super::folder;
use super::picture;
use super::progress::Bars;
use squall_bake::BakeError;
use squall_bake::{output, recipe::Recipe, storm};
use squall_formats::container;
use squall_runtime::StormRenderer;
use std::path::{Path, PathBuf};

/// Bakes a recipe into one asset.
#[derive(clap::Args)]
pub struct Args {
    /// The recipe, TOML.
    recipe: PathBuf,
    /// The asset to write.
    #[arg(short, long)]
    out: PathBuf,
    /// Draws the recipe's own view from the bytes just written: .png or .exr.
    #[arg(long)]
    preview: Option<PathBuf>,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let start = std::time::Instant::now();
    let recipe = Recipe::read(&args.recipe)?;
    if args.preview.is_some() && recipe.view.is_none() {
        return Err(BakeError::input(&args.recipe, "view", "a table [view] to preview", "none").into());
    }
    let inputs = recipe.inputs()?;
    let outputs: Vec<&Path> = std::iter::once(&args.out).chain(&args.preview).map(PathBuf::as_path).collect();
    folder::check_apart(&outputs, inputs.iter())?;
    for path in &outputs {
        folder::check_parent(path)?;
    }
    if let Some(preview) = &args.preview {
        picture::check_name(preview)?;
    }
    let bars = Bars::new()?;
    let baked = storm::bake(&recipe, &bars)?;
    bars.finish();
    output::write_atomically(&args.out, |out| container::write(out, &baked.sections).map(|_| ()))?;
    super::table::stages(&baked.stages, &args.out, start.elapsed().as_secs_f64())?;
    let Some(preview) = &args.preview else { return Ok(()) };
    let start = std::time::Instant::now();
    let mut renderer = StormRenderer::open(&args.out)?;
    let Some(frame) = renderer.frame() else { return Ok(()) };
    renderer.render(&frame)?;
    picture::write(preview, renderer.picture(), &renderer.tone())?;
    picture::say(preview, renderer.picture(), &renderer.report(), start.elapsed().as_secs_f64())
}
