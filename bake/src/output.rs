//! Files that appear whole or not at all: temporary file beside the target, fsync, rename. Nothing is ever written in place, so
//! that whoever has an asset mapped keeps the bytes that it opened.

pub mod ktx2;
pub mod npy;
mod part;
pub mod pending;
mod place;
pub mod vdb;

use crate::error::BakeError;
use part::Part;
pub use part::sweep;
pub use place::{Place, check_replaceable, folder_of};
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// What a file's bytes go through.
pub type Out<'a> = BufWriter<Limited<'a>>;

/// Writes `path` through `fill`: into a temporary file in the same folder, flushed to the disk and renamed into place. On any error
/// the temporary file is gone and `path` is as it was. A link is followed; a device or a pipe, which cannot be replaced, is written to
/// as it is. A file that is replaced hands down its mode, and its owner and group where this process may set them.
///
/// Errors: a folder in the way, links in a circle (exit code 3), what the system refuses (4).
pub fn write_atomically(path: &Path, fill: impl FnOnce(&mut Out) -> io::Result<()>) -> Result<(), BakeError> {
    let io = || BakeError::io(path, "write");
    match Place::of_name(path)? {
        Place::File(target) => {
            let part = fill_part(&target, fill).map_err(|e| io()(place::through(path, &target, e)))?;
            part.rename(&target).map_err(|(error, _)| BakeError::io(path, "rename into place")(error))?;
            sync_folder(&target);
            Ok(())
        }
        place => stream(&place, fill).map_err(io()),
    }
}

/// Writes a file that can be made again: whole or not at all as [`write_atomically`] does, but not waited for until it is on the disk.
///
/// Errors: what the system refuses.
pub fn write_scratch(path: &Path, parts: &[&[u8]]) -> io::Result<()> {
    let mut part = Part::make(folder_of(path), None)?;
    pour(part.file(), |out| parts.iter().try_for_each(|bytes| out.write_all(bytes)))?;
    part.rename(path).map_err(|(error, _)| error)
}

/// An output of the command: found and tried before the work, written after it. `-` is standard output.
#[derive(Clone, Debug)]
pub struct Output {
    path: PathBuf,
    place: Place,
}

impl Output {
    /// Finds out where `path` leads and tries what [`Output::write`] will do there.
    ///
    /// Errors: as [`Place::of`] and [`Place::check`].
    pub fn prepare(path: &Path) -> Result<Self, BakeError> {
        let place = Place::of(path)?;
        place.check(path)?;
        Ok(Self { path: path.to_owned(), place })
    }

    /// Whether the bytes go to standard output.
    pub fn is_stdout(&self) -> bool {
        self.place == Place::Stdout
    }

    /// What the output is called in words.
    pub fn name(&self) -> String {
        if self.is_stdout() { "standard output".into() } else { self.path.display().to_string() }
    }

    /// Writes as [`write_atomically`] does. Where the system refuses all the same, the finished bytes are kept, under another name in
    /// the same folder or in the folder for temporary files, and the error says where.
    ///
    /// Errors: what the system refuses (exit code 4).
    pub fn write(&self, fill: impl Fn(&mut Out) -> io::Result<()>) -> Result<(), BakeError> {
        let error = match &self.place {
            Place::File(target) => match fill_part(target, &fill) {
                Ok(part) => match part.rename(target) {
                    Ok(()) => {
                        sync_folder(target);
                        return Ok(());
                    }
                    Err((error, part)) => match keep_beside(part, target) {
                        Some(kept) => return Err(self.kept(error, &kept)),
                        None => error,
                    },
                },
                Err(error) => error,
            },
            place => match stream(place, &fill) {
                Ok(()) => return Ok(()),
                Err(error) => error,
            },
        };
        match worth_keeping(&error).then(|| keep_elsewhere(&self.path, &fill)).flatten() {
            Some(kept) => Err(self.kept(error, &kept)),
            None => Err(BakeError::io(&self.path, "write")(error)),
        }
    }

    fn kept(&self, error: io::Error, kept: &Path) -> BakeError {
        kept_error(&self.path, error, kept)
    }
}

/// A refusal to write `path` that says where the finished bytes are.
pub fn kept_error(path: &Path, error: io::Error, kept: &Path) -> BakeError {
    let words = format!("{error}; the finished bytes are kept in {}", kept.display());
    // Never bad input: the work is done.
    let kind = match error.kind() {
        io::ErrorKind::NotFound | io::ErrorKind::IsADirectory => io::ErrorKind::Other,
        kind => kind,
    };
    BakeError::io(path, "write")(io::Error::new(kind, words))
}

/// Whether an error is the place's fault and not the bytes': then another place may take them. A reader of a pipe that has gone
/// wants them nowhere.
pub fn worth_keeping(error: &io::Error) -> bool {
    error.kind() != io::ErrorKind::BrokenPipe
        && (error.raw_os_error().is_some() || error.kind() == io::ErrorKind::FileTooLarge)
}

/// Names tried for bytes that could not get their own.
const KEPT_NAMES: u32 = 100;

fn keep_beside(mut part: Part, target: &Path) -> Option<PathBuf> {
    let name = target.file_name()?.to_string_lossy().into_owned();
    for number in 1..KEPT_NAMES {
        let kept = folder_of(target).join(format!("{name}.kept-{number}"));
        match part.rename_to_new(&kept) {
            Ok(()) => return Some(kept),
            Err(back) => part = back,
        }
    }
    None
}

fn keep_elsewhere(path: &Path, fill: impl Fn(&mut Out) -> io::Result<()>) -> Option<PathBuf> {
    let extension = path.extension().and_then(|name| name.to_str()).filter(|name| name.len() < 16);
    let suffix = extension.map_or(String::new(), |name| format!(".{name}"));
    let mut file = tempfile::Builder::new().prefix("squall-kept-").suffix(&suffix).tempfile().ok()?;
    pour(file.as_file_mut(), fill).and_then(|()| file.as_file().sync_all()).ok()?;
    file.keep().ok().map(|(_, kept)| kept)
}

fn fill_part(target: &Path, fill: impl FnOnce(&mut Out) -> io::Result<()>) -> io::Result<Part> {
    let old = target.symlink_metadata().ok();
    let mut part = Part::make(folder_of(target), old.as_ref())?;
    pour(part.file(), fill)?;
    if let Some(old) = &old {
        part.take_after(old)?;
    }
    part.file().sync_all()?;
    Ok(part)
}

fn pour(file: &mut File, fill: impl FnOnce(&mut Out) -> io::Result<()>) -> io::Result<()> {
    let left = most_bytes();
    let mut out = BufWriter::with_capacity(1 << 20, Limited { file, left });
    fill(&mut out).and_then(|()| out.flush())
}

/// All bytes are there before the first goes into a pipe: an error on the way leaves it empty.
fn stream(place: &Place, fill: impl FnOnce(&mut Out) -> io::Result<()>) -> io::Result<()> {
    let mut whole = tempfile::tempfile()?;
    pour(&mut whole, fill)?;
    whole.rewind()?;
    match place {
        Place::Stdout => {
            let mut out = io::stdout().lock();
            io::copy(&mut whole, &mut out)?;
            out.flush()
        }
        Place::Stream(path) | Place::File(path) => {
            let mut device = File::options().write(true).open(path)?;
            io::copy(&mut whole, &mut device).map(|_| ())
        }
    }
}

/// The rename itself reaches the disk with its folder; where folders cannot be synced, the rename stands.
fn sync_folder(target: &Path) {
    if let Ok(folder) = File::open(folder_of(target)) {
        let _ = folder.sync_all();
    }
}

/// A file that takes so many bytes at most as this process may write into one: the system would end the process beyond.
pub struct Limited<'a> {
    file: &'a mut File,
    left: u64,
}

impl Write for Limited<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.len() as u64 > self.left {
            return Err(io::Error::new(
                io::ErrorKind::FileTooLarge,
                "File too large for this process's limit",
            ));
        }
        let written = self.file.write(bytes)?;
        self.left -= written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[cfg(unix)]
fn most_bytes() -> u64 {
    rustix::process::getrlimit(rustix::process::Resource::Fsize).current.unwrap_or(u64::MAX)
}

#[cfg(not(unix))]
fn most_bytes() -> u64 {
    u64::MAX
}

#[cfg(test)]
mod tests;
