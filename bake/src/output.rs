//! Files that appear whole or not at all: temporary file beside the target, fsync, rename.

use crate::error::BakeError;
use std::io::Write;
use std::path::Path;

/// Writes `path` through `fill`: into a temporary file in the same folder, flushed to the disk and renamed
/// into place. On any error the temporary file is gone and `path` is as it was.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut std::io::BufWriter<&mut tempfile::NamedTempFile>) -> std::io::Result<()>,
) -> Result<(), BakeError> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let io = || BakeError::io(path, "write");
    if path.is_dir() {
        return Err(BakeError::input(path, "output", "a file name", "a folder"));
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".squall-").suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // What an ordinary file gets (the umask still applies), not the private mode of a temporary one.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder).map_err(io())?;
    {
        let mut out = std::io::BufWriter::with_capacity(1 << 20, &mut file);
        fill(&mut out).and_then(|()| out.flush()).map_err(io())?;
    }
    file.as_file().sync_all().map_err(io())?;
    file.persist(path).map_err(|error| BakeError::io(path, "rename into place")(error.error))?;
    // The rename itself reaches the disk with its folder; where folders cannot be synced, the rename stands.
    if let Ok(folder) = std::fs::File::open(folder) {
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
}
