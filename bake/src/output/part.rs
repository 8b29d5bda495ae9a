//! Temporary files: `.squall-XXXXXX.part` beside the file that they become, locked while their process lives.
//!
//! The lock tells a dead process's part from a live one's on any machine that shares the folder. A file system without locks keeps
//! dead parts, and no live one is lost.

use super::pending::PendingFile;
use std::fs::{File, Metadata, OpenOptions, TryLockError};
use std::io;
use std::path::Path;
use tempfile::NamedTempFile;

const PREFIX: &str = ".squall-";
const SUFFIX: &str = ".part";
/// A part that another process swept between its making and its locking is made again; so often in a row means something else.
const ATTEMPTS: usize = 16;

/// A file in the making. Dropped, it is gone.
pub(super) struct Part {
    temporary: NamedTempFile<File>,
    pending: PendingFile,
}

impl Part {
    /// Makes a part in `folder`, for its owner alone where it will take the place of `old`. Errors: what the system says.
    pub(super) fn make(folder: &Path, old: Option<&Metadata>) -> io::Result<Self> {
        for _ in 0..ATTEMPTS {
            let open = |part: &Path| options(old.is_some()).open(part);
            let make = || tempfile::Builder::new().prefix(PREFIX).suffix(SUFFIX).make_in(folder, open);
            let (temporary, pending) = PendingFile::make(make, NamedTempFile::path)?;
            let swept = matches!(temporary.as_file().try_lock(), Err(TryLockError::WouldBlock));
            if !swept && is_linked(temporary.as_file())? {
                return Ok(Self { temporary, pending });
            }
        }
        Err(io::Error::other("its temporary file vanishes as soon as it is made"))
    }

    pub(super) fn file(&mut self) -> &mut File {
        self.temporary.as_file_mut()
    }

    /// Gives the part the mode of `old`, and its owner and group as far as this process may.
    pub(super) fn take_after(&self, old: &Metadata) -> io::Result<()> {
        take_after(self.temporary.as_file(), old)
    }

    /// Renames the part to `target`. Errors: what the system says, with the part back.
    pub(super) fn rename(self, target: &Path) -> Result<(), (io::Error, Self)> {
        let Self { temporary, pending } = self;
        let renamed = pending.end(|| temporary.persist(target));
        renamed.map(|_| ()).map_err(|error| (error.error, Self { temporary: error.file, pending }))
    }

    /// Renames the part to `target` where nothing is. Errors: what the system says, with the part back.
    pub(super) fn rename_to_new(self, target: &Path) -> Result<(), Self> {
        let Self { temporary, pending } = self;
        let renamed = pending.end(|| temporary.persist_noclobber(target));
        renamed.map(|_| ()).map_err(|error| Self { temporary: error.file, pending })
    }
}

fn options(private: bool) -> OpenOptions {
    let mut options = File::options();
    options.read(true).write(true).create_new(true);
    #[cfg(unix)]
    if private {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    }
    #[cfg(not(unix))]
    let _ = private;
    options
}

#[cfg(unix)]
fn is_linked(file: &File) -> io::Result<bool> {
    Ok(std::os::unix::fs::MetadataExt::nlink(&file.metadata()?) > 0)
}

#[cfg(not(unix))]
fn is_linked(_: &File) -> io::Result<bool> {
    Ok(true)
}

#[cfg(unix)]
fn take_after(file: &File, old: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    let own = file.metadata()?;
    // Only the superuser may give files away; a group may be kept by its members.
    let owner = (own.uid() != old.uid()).then(|| old.uid());
    let group = (own.gid() != old.gid()).then(|| old.gid());
    let mut mode = old.mode() & 0o7777;
    if owner.is_some() && fchown(file, owner, None).is_err() {
        mode &= 0o3777;
    }
    if group.is_some() && fchown(file, None, group).is_err() {
        // What the old group might do is nothing that the new one may do, unless everyone may.
        mode = (mode & 0o5707) | (mode & ((mode & 0o7) << 3));
    }
    file.set_permissions(std::fs::Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn take_after(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Removes parts that dead processes left in `folder`. What cannot be read, locked or removed stays.
pub fn sweep(folder: &Path) {
    let Ok(entries) = folder.read_dir() else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_part = name.starts_with(PREFIX) && name.ends_with(SUFFIX);
        if !is_part || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // Locked before it is removed: its maker sees either, and makes another.
        if let Ok(file) = File::open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}
