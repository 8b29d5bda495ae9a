//! The places of a run's outputs, before anything is written there.

use super::plan::Plan;
use crate::error::BakeError;
use crate::input::json::read_json;
use crate::output::{folder_of, sweep};
use std::path::{Path, PathBuf};

/// Refuses to replace a manifest.json that is somebody else's.
pub fn check_manifest(path: &Path) -> Result<(), BakeError> {
    if !path.exists() {
        return Ok(());
    }
    let own = read_json::<serde_json::Value>(path, "a manifest").ok().is_some_and(|value| {
        value.get("tool").and_then(|tool| tool.as_str()).is_some_and(|tool| tool.starts_with("squall "))
    });
    let (wanted, found) = ("a place for the manifest", "a file that is no manifest of squall rain");
    if own { Ok(()) } else { Err(BakeError::input(path, "manifest", wanted, found)) }
}

/// Folders that were made for a run; those that nothing came into go again with this value.
pub struct NewFolders {
    /// Outermost first.
    made: Vec<PathBuf>,
}

impl NewFolders {
    /// Something came of the run: its folders stay.
    pub fn keep(&mut self) {
        self.made.clear();
    }

    /// Makes the folders of every output, and tries to write there. Errors: what the system refuses (exit code 4).
    pub fn make(plan: &Plan<'_>) -> Result<Self, BakeError> {
        let mut wanted = vec![plan.folder.clone()];
        wanted.extend(plan.all_places()?.iter().map(|(_, path)| folder_of(path).to_owned()));
        wanted.sort();
        wanted.dedup();
        let mut folders = Self { made: Vec::new() };
        for folder in wanted {
            let missing =
                folder.ancestors().take_while(|above| !above.as_os_str().is_empty() && !above.exists());
            let missing: Vec<PathBuf> = missing.map(Path::to_owned).collect();
            for above in missing.into_iter().rev() {
                std::fs::create_dir(&above).map_err(|error| {
                    // A place that takes no folder is the system's to refuse, whatever stands there.
                    BakeError::io(&above, "make the folder")(std::io::Error::other(error.to_string()))
                })?;
                folders.made.push(above);
            }
            sweep(&folder);
            tempfile::tempfile_in(&folder).map_err(BakeError::io(&folder, "write into the folder"))?;
        }
        Ok(folders)
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        for folder in self.made.iter().rev() {
            let _ = std::fs::remove_dir(folder);
        }
    }
}
