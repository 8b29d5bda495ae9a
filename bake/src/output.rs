//! Files that appear whole or not at all: temporary file beside the target, fsync, rename.

use crate::error::BakeError;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes `path` through `fill`: into a temporary file in the same folder, flushed to the disk and renamed
/// into place. On any error the temporary file is gone and `path` is as it was. A link is followed; a device or a pipe,
/// which cannot be replaced, is written to as it is.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), BakeError> {
    let io = || BakeError::io(path, "write");
    if path.is_dir() {
        return Err(BakeError::input(path, "output", "a file name", "a folder"));
    }
    if path.exists() && !path.is_file() {
        let mut device = File::options().write(true).open(path).map_err(io())?;
        let mut out = BufWriter::new(&mut device);
        return fill(&mut out).and_then(|()| out.flush()).map_err(io());
    }
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    // Opened by hand: the file gets the mode of an ordinary one, and errors do not name the temporary path.
    let mut file = tempfile::Builder::new()
        .prefix(".squall-")
        .suffix(".part")
        .make_in(folder, |part| File::options().write(true).create_new(true).open(part))
        .map_err(io())?;
    {
        let mut out = BufWriter::with_capacity(1 << 20, file.as_file_mut());
        fill(&mut out).and_then(|()| out.flush()).map_err(io())?;
    }
    file.as_file().sync_all().map_err(io())?;
    file.persist(&target).map_err(|error| BakeError::io(path, "rename into place")(error.error))?;
    // The rename itself reaches the disk with its folder; where folders cannot be synced, the rename stands.
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("asset");
        write_atomically(&path, |out| out.write_all(b"old")).unwrap();
        let failed = write_atomically(&path, |out| {
            out.write_all(b"half")?;
            Err(std::io::Error::other("disk full"))
        });
        assert_eq!(failed.unwrap_err().exit_code(), 4);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_refusal_names_the_file_asked_for_once_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none/asset");
        let message = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
        assert_eq!(message.matches(&path.display().to_string()).count(), 1, "{message}");
        assert!(!message.contains(".part"), "{message}");
    }
}
