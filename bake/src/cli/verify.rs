//! `squall verify ASSET`
use super::json;
use serde_json::json;
use squall_bake::BakeError;
use squall_bake::provenance::tool;
use squall_formats::ReadError;
use squall_runtime::{RuntimeError, verify};
use std::path::PathBuf;

/// Reads every byte of an asset and says whether it is whole.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub struct Args {
    /// The asset.
    asset: PathBuf,
    /// Print one JSON object instead of words: docs/json.md.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// Whether the answer is to be JSON.
    pub fn json(&self) -> bool {
        self.json
    }
}

/// Exits 1 when the asset is damaged; a file that is no asset, or one of a newer version, is bad input and exits 3.
pub fn run(args: Args) -> anyhow::Result<()> {
    let done =
        super::asset::open_directory(&args.asset).and_then(|asset| verify::verify(&asset)).map_err(as_damage);
    if args.json {
        let mut answer =
            json!({ "command": "verify", "tool": tool(), "asset": args.asset.to_string_lossy() });
        match &done {
            Ok(done) => {
                answer["whole"] = json!(true);
                answer["bytes"] = json!(done.bytes);
                answer["sections"] = json!(done.sections);
                answer["unknown"] = json!(done.unknown);
                answer["rows"] = json!(done.rows);
                answer["damage"] = json!(null);
            }
            Err(error) if error.exit_code() == 1 => {
                answer["whole"] = json!(false);
                answer["damage"] = json!(error.to_string());
                for unread in ["bytes", "sections", "unknown", "rows"] {
                    answer[unread] = json!(null);
                }
            }
            Err(_) => return Ok(done.map(|_| ())?),
        }
        json::answer(&answer)?;
        return Ok(done.map(|_| ())?);
    }
    let done = done?;
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

/// An asset that came to harm, apart from one that this build cannot read. A section that another one stands on is missing only
/// where somebody took it out.
fn as_damage(error: RuntimeError) -> BakeError {
    match &error {
        RuntimeError::Asset { source: ReadError::Missing { .. }, .. } => BakeError::Damaged(error),
        RuntimeError::Asset { source, .. } if source.is_damage() => BakeError::Damaged(error),
        _ => BakeError::Asset(error),
    }
}
