//! `squall bake RECIPE -o ASSET`
use super::progress::Bars;
use squall_bake::{output, recipe::Recipe, storm};
use squall_formats::container;
use std::path::PathBuf;

/// Bakes a recipe into one asset.
#[derive(clap::Args)]
pub struct Args {
    /// The recipe, TOML.
    recipe: PathBuf,
    /// The asset to write.
    #[arg(short, long)]
    out: PathBuf,
}

pub fn run(args: Args) -> anyhow::Result<()> {
    let start = std::time::Instant::now();
    let recipe = Recipe::read(&args.recipe)?;
    let bars = Bars::new()?;
    let baked = storm::bake(&recipe, &bars)?;
    bars.finish();
    output::write_atomically(&args.out, |out| container::write(out, &baked.sections).map(|_| ()))?;
    super::table::stages(&baked.stages, &args.out, start.elapsed().as_secs_f64())
}
