//! A folder for results: checked before the work, gone again if nothing comes of it.

use squall_bake::BakeError;
use std::path::{Path, PathBuf};

/// A folder that exists and takes files. Folders made for it disappear with this value unless it is kept.
pub struct OutputFolder {
    path: PathBuf,
    /// Folders made here, outermost first.
    made: Vec<PathBuf>,
    /// Names of results that may lie in it, and were not there before.
    results: Vec<String>,
    kept: bool,
}

impl OutputFolder {
    /// Makes `path` and what is missing above it, and tries to write there.
    ///
    /// Errors (exit code 4): a file stands in the way, no permission, no space.
    pub fn prepare(path: &Path) -> Result<Self, BakeError> {
        let mut missing: Vec<PathBuf> = Vec::new();
        for folder in path.ancestors().filter(|folder| !folder.as_os_str().is_empty()) {
            if folder.exists() {
                break;
            }
            missing.push(folder.to_owned());
        }
        let mut folder = Self { path: path.to_owned(), made: Vec::new(), results: Vec::new(), kept: false };
        for missing in missing.into_iter().rev() {
            std::fs::create_dir(&missing).map_err(refused(&missing, "make the folder"))?;
            folder.made.push(missing);
        }
        tempfile::tempfile_in(path).map_err(refused(path, "write into the folder"))?;
        Ok(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Announces results that are about to be written: they go again unless all are kept, other files never.
    pub fn expect<'a>(&mut self, names: impl IntoIterator<Item = &'a str>) {
        let new = names.into_iter().filter(|name| !self.path.join(name).exists());
        self.results.extend(new.map(str::to_owned));
    }

    /// Leaves the folder and everything in it.
    pub fn keep(mut self) {
        self.kept = true;
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if self.kept {
            return;
        }
        // Half a set of results is nothing.
        for name in &self.results {
            let _ = std::fs::remove_file(self.path.join(name));
        }
        for folder in self.made.iter().rev() {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// Refuses outputs that would replace an input or each other.
pub fn check_apart<'a>(
    outputs: &[&Path],
    inputs: impl Iterator<Item = &'a PathBuf>,
) -> Result<(), BakeError> {
    let inputs: Vec<PathBuf> = inputs.map(|path| same_place(path)).collect();
    for (at, output) in outputs.iter().enumerate() {
        let place = same_place(output);
        // A device takes what is written and replaces nothing.
        if place.exists() && !place.is_file() {
            continue;
        }
        if inputs.contains(&place) {
            return Err(BakeError::input(output, "output", "a file that is not read", "one of the inputs"));
        }
        if outputs[..at].iter().any(|other| same_place(other) == place) {
            return Err(BakeError::input(output, "output", "a file of its own", "another output"));
        }
    }
    Ok(())
}

/// A path by which two names of one file are the same; the file need not be there.
fn same_place(path: &Path) -> PathBuf {
    if let Ok(path) = path.canonicalize() {
        return path;
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (folder.canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

/// Checks before the work that a file can be put where `path` says.
///
/// Errors: a folder there, no folder above it (exit code 3), no permission, no space (4).
pub fn check_parent(path: &Path) -> Result<(), BakeError> {
    if path.is_dir() {
        return Err(BakeError::input(path, "output", "a file name", "a folder"));
    }
    // A device or a pipe is written to as it is.
    if path.exists() && !path.is_file() {
        return Ok(());
    }
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(parent).map_err(BakeError::io(path, "write"))?;
    Ok(())
}

/// Output that the system refuses, whatever its reason, is not the input's fault.
fn refused(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> BakeError {
    move |error| {
        let plain = match error.kind() {
            std::io::ErrorKind::NotFound | std::io::ErrorKind::IsADirectory => {
                std::io::Error::other(error.to_string())
            }
            _ => error,
        };
        BakeError::io(path, action)(plain)
    }
}
