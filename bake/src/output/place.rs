//! Where an output goes: standard output, a device or pipe, or a file; and whether it can, asked before the work.

use super::part::{Part, sweep};
use super::pour;
use crate::error::BakeError;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};

/// Links in a row that an output may lead through, as many as Linux allows.
const MOST_LINKS: usize = 40;

/// Where an output goes.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// This process's standard output, whatever it is.
    Stdout,
    /// A device, a pipe or another open file: written to as it is, since it cannot be replaced.
    Stream(PathBuf),
    /// A file, to be replaced or made; links are followed.
    File(PathBuf),
}

impl Place {
    /// What `path` stands for: `-` and the names of standard output, a device or pipe, or a file at the end of all links.
    ///
    /// Errors: a folder, a name that ends like one, links that lead in a circle (exit code 3); a name that the system refuses (4).
    pub fn of(path: &Path) -> Result<Self, BakeError> {
        if path == Path::new("-") { Ok(Self::Stdout) } else { Self::of_name(path) }
    }

    /// [`Place::of`], for which `-` is a file's name like any other.
    pub(super) fn of_name(path: &Path) -> Result<Self, BakeError> {
        if path.as_os_str().to_string_lossy().ends_with(['/', std::path::MAIN_SEPARATOR]) {
            return Err(BakeError::input(path, "output", "a file name", "a name that ends like a folder's"));
        }
        let mut at = path.to_owned();
        for _ in 0..MOST_LINKS {
            match descriptor(&at) {
                Some(1) => return Ok(Self::Stdout),
                Some(_) => return Ok(Self::Stream(path.to_owned())),
                None => {}
            }
            match at.symlink_metadata() {
                Ok(found) if found.is_symlink() => {
                    let link = at.read_link().map_err(BakeError::io(path, "follow the link"))?;
                    at = folder_of(&at).join(link);
                }
                Ok(found) if found.is_dir() => {
                    return Err(BakeError::input(path, "output", "a file name", "a folder"));
                }
                Ok(found) if !found.is_file() => return Ok(Self::Stream(path.to_owned())),
                Ok(_) => return Ok(Self::File(at)),
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::File(at)),
                Err(error) => return Err(BakeError::io(path, "write")(error)),
            }
        }
        Err(BakeError::input(path, "output", "a file name", "a link that leads in a circle"))
    }

    /// Tries what writing will do, without a trace: makes and fills a temporary file where the part will stand, and asks whether
    /// the file in its place may be replaced. Sweeps parts that dead processes left there.
    ///
    /// Errors: a terminal (exit code 3); no folder (3), no permission, no space (4).
    pub fn check(&self, path: &Path) -> Result<(), BakeError> {
        match self {
            Self::Stdout if io::stdout().is_terminal() => {
                let found = "standard output on a terminal";
                Err(BakeError::input(path, "output", "a file, a pipe or a redirection", found))
            }
            Self::Stdout => Ok(()),
            Self::Stream(_) => writable(path).map_err(BakeError::io(path, "write")),
            Self::File(target) => {
                check_file(target).map_err(|error| BakeError::io(path, "write")(through(path, target, error)))
            }
        }
    }
}

fn check_file(target: &Path) -> io::Result<()> {
    let folder = folder_of(target);
    sweep(folder);
    let old = target.symlink_metadata().ok();
    if old.is_some() {
        replaceable(target)?;
    }
    let mut part = Part::make(folder, old.as_ref())?;
    pour(part.file(), |out| out.write_all(b"?"))
}

/// Whether the file may be renamed over. Asked by removing it as a folder: the system first checks whether this process may take the
/// name out of its folder (rights, another user's file in a sticky folder, immutable files), then says that it is no folder.
fn replaceable(file: &Path) -> io::Result<()> {
    match std::fs::remove_dir(file) {
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => Ok(()),
        Err(error) => Err(error),
        Ok(()) => Ok(()),
    }
}

/// Whether results called `names` can be put into `folder`, which takes new files: whether files that stand there may be replaced.
///
/// Errors: as [`Place::check`].
pub fn check_replaceable<'a>(
    folder: &Path,
    names: impl IntoIterator<Item = &'a str>,
) -> Result<(), BakeError> {
    for name in names {
        let path = folder.join(name);
        if let Place::File(target) = Place::of_name(&path)?
            && target.symlink_metadata().is_ok()
        {
            replaceable(&target).map_err(BakeError::io(&path, "write"))?;
        }
    }
    Ok(())
}

/// Adds to a refusal where a link leads.
pub(super) fn through(path: &Path, target: &Path, error: io::Error) -> io::Error {
    if path == target {
        return error;
    }
    io::Error::new(error.kind(), format!("{error} (a link to {})", target.display()))
}

/// The folder that a file is in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Number of the open file that a name such as /dev/stdout or /dev/fd/3 stands for.
fn descriptor(path: &Path) -> Option<u32> {
    let name = path.to_str()?;
    match name {
        "/dev/stdout" => return Some(1),
        "/dev/stderr" => return Some(2),
        _ => {}
    }
    let own = format!("/proc/{}/fd/", std::process::id());
    let number = ["/dev/fd/", "/proc/self/fd/", "/proc/thread-self/fd/", &own].into_iter();
    number.filter_map(|folder| name.strip_prefix(folder)).find_map(|number| number.parse().ok())
}

#[cfg(unix)]
fn writable(path: &Path) -> io::Result<()> {
    use rustix::fs::{Access, AtFlags, CWD, accessat};
    Ok(accessat(CWD, path, Access::WRITE_OK, AtFlags::EACCESS)?)
}

#[cfg(not(unix))]
fn writable(_: &Path) -> io::Result<()> {
    Ok(())
}
