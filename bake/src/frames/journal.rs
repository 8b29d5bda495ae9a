//! What a run has done so far, a line a frame, so that one that was stopped can go on: `manifest.json.partial` beside the manifest that it
//! becomes. A line counts when it is whole and the files that it names hold the bytes that it says.

use super::job::Job;
use super::manifest::{AssetRecord, FrameRecord, Inputs, StoredLight};
use crate::error::BakeError;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Longest journal read, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The first line: a run with another one is another run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heading {
    /// Program and version.
    pub tool: String,
    /// What it was told.
    pub settings: Job,
    /// Whose rain it is.
    pub asset: AssetRecord,
    /// What it read beside frames.
    pub inputs: Inputs,
    /// The light.
    pub light: StoredLight,
}

/// A frame that is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// What happened to it.
    pub record: FrameRecord,
    /// Length of the shared list of streaks behind it, bytes; `null` where frames have their own.
    pub stream_bytes: Option<u64>,
}

/// A journal that is being written.
pub struct Journal {
    file: File,
    path: PathBuf,
}

/// Name of the journal of a manifest.
pub fn path_of(manifest: &Path) -> PathBuf {
    let mut name = manifest.as_os_str().to_owned();
    name.push(".partial");
    PathBuf::from(name)
}

impl Journal {
    /// Begins anew with what is known already. Errors: what the system refuses.
    pub fn begin(path: PathBuf, heading: &Heading, entries: &[Entry]) -> Result<Self, BakeError> {
        let mut text = line(&path, heading)?;
        for entry in entries {
            text += &line(&path, entry)?;
        }
        super::layers::write(&path, text.as_bytes())?;
        let file = File::options().append(true).open(&path).map_err(BakeError::io(&path, "append to"))?;
        Ok(Self { file, path })
    }

    /// Adds a frame. Errors: what the system refuses.
    pub fn add(&mut self, entry: &Entry) -> Result<(), BakeError> {
        let line = line(&self.path, entry)?;
        self.file.write_all(line.as_bytes()).map_err(BakeError::io(&self.path, "append to"))
    }
}

fn line(path: &Path, value: &impl Serialize) -> Result<String, BakeError> {
    let text = serde_json::to_string(value).map_err(|error| BakeError::io(path, "write")(error.into()))?;
    Ok(text + "\n")
}

/// Entries of an earlier run with the same heading, as far as its lines are whole; none where there is no such journal.
pub fn read(path: &Path, heading: &Heading) -> Vec<Entry> {
    let Ok(file) = File::open(path) else { return Vec::new() };
    let mut text = String::new();
    if file.take(MAX_BYTES).read_to_string(&mut text).is_err() {
        return Vec::new();
    }
    // What follows the last line's end was not written to its end.
    let whole = text.rfind('\n').map_or("", |end| &text[..end]);
    let mut lines = whole.lines();
    let same = lines.next().and_then(|first| serde_json::from_str::<Heading>(first).ok());
    if same.as_ref() != Some(heading) {
        return Vec::new();
    }
    lines.map_while(|line| serde_json::from_str(line).ok()).collect()
}
