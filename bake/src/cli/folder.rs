//! A folder for results: checked before the work, gone again if nothing comes of it.

use squall_bake::BakeError;
use squall_bake::output::{self, Place, folder_of, pending};
use std::path::{Path, PathBuf};

/// A folder that exists and takes files. Folders made for it disappear with this value unless it is kept.
pub struct OutputFolder {
    path: PathBuf,
    /// Folders made here, outermost first.
    made: Vec<PathBuf>,
    /// Names of results that will lie in it.
    names: Vec<String>,
    /// Results that are being written, and were not there before.
    results: Vec<PathBuf>,
    kept: bool,
}

impl OutputFolder {
    /// Makes `path` and what is missing above it, and tries to write there.
    ///
    /// Errors: standard output, which is no folder (exit code 3); a file stands in the way, no permission, no space (4).
    pub fn prepare(path: &Path) -> Result<Self, BakeError> {
        if matches!(Place::of(path), Ok(Place::Stdout)) {
            return Err(BakeError::input(path, "output", "a folder for several files", "standard output"));
        }
        let mut missing: Vec<PathBuf> = Vec::new();
        for folder in path.ancestors().filter(|folder| !folder.as_os_str().is_empty()) {
            if folder.exists() {
                break;
            }
            missing.push(folder.to_owned());
        }
        let mut folder = Self {
            path: path.to_owned(),
            made: Vec::new(),
            names: Vec::new(),
            results: Vec::new(),
            kept: false,
        };
        for missing in missing.into_iter().rev() {
            std::fs::create_dir(&missing).map_err(refused(&missing, "make the folder"))?;
            pending::expect_folder(std::slice::from_ref(&missing), &[]);
            folder.made.push(missing);
        }
        output::sweep(path);
        tempfile::tempfile_in(path).map_err(refused(path, "write into the folder"))?;
        Ok(folder)
    }

    /// Announces results before the work.
    ///
    /// Errors: one that stands there may not be replaced (exit code 4).
    pub fn expect<'a>(&mut self, names: impl IntoIterator<Item = &'a str>) -> Result<(), BakeError> {
        self.names.extend(names.into_iter().map(str::to_owned));
        output::check_replaceable(&self.path, self.names.iter().map(String::as_str))
    }

    /// Something came of the work: folders made for it stay.
    pub fn keep(&mut self) {
        self.kept = true;
    }

    /// Writes the results with `write`, which is given a folder, and keeps them all, or none of those that are new. Where the system
    /// refuses after the work all the same, they are written into a new folder among the temporary ones, and the error says where.
    ///
    /// Errors: those of `write`.
    pub fn write<T>(mut self, write: impl Fn(&Path) -> anyhow::Result<T>) -> anyhow::Result<T> {
        let paths = self.names.iter().map(|name| self.path.join(name));
        self.results = paths.filter(|path| path.symlink_metadata().is_err()).collect();
        pending::expect_folder(&[], &self.results);
        let error = match write(&self.path) {
            Ok(done) => {
                self.kept = true;
                return Ok(done);
            }
            Err(error) => error,
        };
        match error.downcast::<BakeError>()? {
            BakeError::Io { file, action, source } if output::worth_keeping(&source) => {
                let elsewhere = tempfile::Builder::new().prefix("squall-kept-").tempdir();
                match elsewhere.ok().filter(|folder| write(folder.path()).is_ok()) {
                    Some(folder) => Err(output::kept_error(&file, source, &folder.keep()).into()),
                    None => Err(BakeError::Io { file, action, source }.into()),
                }
            }
            error => Err(error.into()),
        }
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.kept {
            // Half a set of results is nothing.
            for result in &self.results {
                let _ = std::fs::remove_file(result);
            }
            for folder in self.made.iter().rev() {
                let _ = std::fs::remove_dir(folder);
            }
        }
        pending::forget_folder(&self.made, &self.results);
    }
}

/// Refuses outputs that would replace an input or each other.
pub fn check_apart<'a>(
    outputs: &[&Path],
    inputs: impl Iterator<Item = &'a PathBuf>,
) -> Result<(), BakeError> {
    let inputs: Vec<PathBuf> = inputs.map(|path| same_place(path)).collect();
    for (at, output) in outputs.iter().enumerate() {
        let place = match Place::of(output)? {
            Place::File(place) => same_place(&place),
            // A device takes what is written and replaces nothing, but two outputs at once would mix.
            Place::Stdout => PathBuf::from("-"),
            Place::Stream(_) => continue,
        };
        if inputs.contains(&place) {
            return Err(BakeError::input(output, "output", "a file that is not read", "one of the inputs"));
        }
        let other_place = |other: &&Path| match Place::of(other) {
            Ok(Place::File(other)) => same_place(&other),
            Ok(Place::Stdout) => PathBuf::from("-"),
            _ => PathBuf::new(),
        };
        if outputs[..at].iter().any(|other| other_place(other) == place) {
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
    match (folder_of(path).canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
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
