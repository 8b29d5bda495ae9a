//! `squall verify ASSET`
use squall_bake::BakeError;
use squall_runtime::{RuntimeError, verify};
use std::path::PathBuf;

/// Reads every byte of an asset and says whether it is whole.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The asset.
    asset: PathBuf,
}

/// Exits 1 when the asset is damaged; a file that is no asset, or one of a newer version, is bad input and exits 3.
pub fn run(args: Args) -> anyhow::Result<()> {
    let done = super::asset::open_directory(&args.asset)
        .and_then(|asset| verify::verify(&asset))
        .map_err(evaluate)?;
    let unknown = match done.unknown {
        0 => String::new(),
        count => format!(", and {count} of unknown kind"),
    };
    let line = format!(
        "{}: whole: {} sections{unknown}, {} rows, {} bytes\n",
        args.asset.display(),
        done.sections,
        done.rows,
        done.bytes
    );
    super::table::print(&line)
}

fn evaluate(error: RuntimeError) -> BakeError {
    match &error {
        RuntimeError::Asset { source, .. } if source.is_damage() => BakeError::Damaged(error),
        _ => BakeError::Asset(error),
    }
}
