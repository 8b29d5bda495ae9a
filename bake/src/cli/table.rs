//! The closing table of a bake.

use squall_bake::storm::StageReport;
use std::path::Path;

/// Prints what each stage made, how long it took, how big it is and how far off.
pub fn stages(stages: &[StageReport], asset: &Path, seconds: f64) -> anyhow::Result<()> {
    let made = stages.iter().map(|s| s.made.chars().count()).max().unwrap_or(0).max(4);
    println!("{:<16} {:<made$} {:>9} {:>12}  error", "stage", "made", "seconds", "bytes");
    for s in stages {
        println!("{:<16} {:<made$} {:>9.2} {:>12}  {}", s.stage, s.made, s.seconds, s.bytes, s.error);
    }
    let bytes = std::fs::metadata(asset)?.len();
    println!("{:<16} {:<made$} {seconds:>9.2} {bytes:>12}", "whole asset", asset.display().to_string());
    Ok(())
}
