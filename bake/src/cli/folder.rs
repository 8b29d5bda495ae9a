//! A folder for results: checked before the work, gone again if nothing comes of it.

use squall_bake::BakeError;
use std::path::{Path, PathBuf};

/// A folder that exists and takes files. Folders made for it disappear with this value unless it is kept.
pub struct OutputFolder {
    path: PathBuf,
    /// Folders made here, outermost first.
    made: Vec<PathBuf>,
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
        let mut folder = Self { path: path.to_owned(), made: Vec::new() };
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

    /// Leaves the folder where it is.
    pub fn keep(mut self) {
        self.made.clear();
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        for folder in self.made.iter().rev() {
            // A folder that got files after all stays, and what is above it.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// Checks before the work that a file can be put where `path` says.
///
/// Errors (exit code 4): no such folder, no permission, no space.
pub fn check_parent(path: &Path) -> Result<(), BakeError> {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(parent).map_err(refused(parent, "write into the folder"))?;
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
