//! A run that is made again from its manifest: everything that it reads has to be what it was.

use super::{Work, key};
use crate::error::BakeError;
use crate::frames::manifest::{FileRecord, FrameRecord, Inputs, Manifest};
use crate::frames::plan::Plan;
use std::collections::HashSet;
use std::path::Path;

/// Most frames that an error names.
const MOST_NAMED: usize = 5;

/// Refuses a plan with other frames than the manifest's.
pub fn check_frames(again: &Manifest, plan: &Plan<'_>) -> Result<(), BakeError> {
    let told: HashSet<_> = again.frames.iter().map(key).collect();
    let planned: HashSet<_> = plan.cells().map(|cell| cell.key()).collect();
    let missing = names(again.frames.iter().map(key).filter(|key| !planned.contains(key)));
    let extra = names(plan.cells().map(|cell| cell.key()).filter(|key| !told.contains(key)));
    let found = match (missing, extra) {
        (None, None) => return Ok(()),
        (Some(missing), None) => format!("none of {missing}"),
        (None, Some(extra)) => format!("{extra} beside them"),
        (Some(missing), Some(extra)) => format!("none of {missing}, and {extra} beside them"),
    };
    let wanted = format!("the {} frames that the manifest names", again.frames.len());
    Err(BakeError::input(plan.colour(), "frames", wanted, found))
}

/// Frames' names, each once and a few of them; `None` of none.
fn names(keys: impl Iterator<Item = super::Key>) -> Option<String> {
    let mut all: Vec<String> = keys
        .map(|(frame, rate, camera)| {
            let rate = f64::from_bits(rate);
            let camera = camera.map_or_else(String::new, |camera| format!(" {camera}"));
            format!("{frame}{camera} at {rate} mm/h")
        })
        .collect();
    let more = all.len().saturating_sub(MOST_NAMED);
    all.truncate(MOST_NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    (!all.is_empty()).then(|| all.join(", ") + &more)
}

/// Refuses poses, times and an environment that are not those of the manifest.
pub fn check_inputs(again: &Manifest, now: &Inputs, manifest: &Path) -> Result<(), BakeError> {
    let told = &again.inputs;
    for (field, known, now) in [
        ("pose", &told.pose, &now.pose),
        ("times", &told.times, &now.times),
        ("environment", &told.environment, &now.environment),
    ] {
        match (known, now) {
            (None, None) => {}
            (Some(known), Some(now)) => same(known, now)?,
            (None, Some(_)) => {
                return Err(BakeError::input(
                    manifest,
                    field,
                    "the file's name and hash in `inputs`",
                    "none",
                ));
            }
            (Some(_), None) => {
                return Err(BakeError::input(manifest, field, "the file of `inputs` in `settings`", "none"));
            }
        }
    }
    Ok(())
}

fn same(known: &FileRecord, now: &FileRecord) -> Result<(), BakeError> {
    if known.blake3 == now.blake3 {
        return Ok(());
    }
    let wanted = format!("the file that the manifest names, BLAKE3 {}", known.blake3);
    Err(BakeError::input(&now.name, "bytes", wanted, &now.blake3))
}

impl Work<'_> {
    /// Refuses a frame that is not the one that the manifest which is made again names.
    pub fn check_again(&self, record: &FrameRecord) -> Result<(), BakeError> {
        let Some(again) = &self.given.again else { return Ok(()) };
        let Some(known) = again.frames.iter().find(|known| key(known) == key(record)) else { return Ok(()) };
        for (known_file, now) in [(&known.colour, &record.colour), (&known.depth, &record.depth)] {
            match (known_file, now) {
                (Some(known), Some(now)) => same(known, now)?,
                (None, Some(now)) => {
                    let told = known.error.as_deref().unwrap_or("no such file");
                    let wanted = format!("a frame that fails as the manifest says ({told})");
                    return Err(BakeError::input(&now.name, "frame", wanted, "one that can be read"));
                }
                (_, None) => {}
            }
        }
        if known.time_s.to_bits() != record.time_s.to_bits() {
            let wanted = format!("{} s, the frame's time in the manifest", known.time_s);
            return Err(BakeError::input(
                Path::new(&record.frame),
                "time",
                wanted,
                format!("{} s", record.time_s),
            ));
        }
        Ok(())
    }
}
