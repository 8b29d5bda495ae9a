//! Opening assets for the command.

use squall_runtime::{Asset, RuntimeError};
use std::path::Path;

/// Longest asset that is read into memory, bytes. Longer ones are mapped: a program that truncates one meanwhile, in place, then ends
/// this process with SIGBUS.
const LONGEST_READ: u64 = 1 << 30;

/// Opens an asset, all heads checked. Errors: as [`Asset::read`].
pub fn open(path: &Path) -> Result<Asset, RuntimeError> {
    if is_long(path) { Asset::open(path) } else { Asset::read(path) }
}

/// Opens an asset, its header and section table alone checked. Errors: as [`Asset::read_directory`].
pub fn open_directory(path: &Path) -> Result<Asset, RuntimeError> {
    if is_long(path) { Asset::open_directory(path) } else { Asset::read_directory(path) }
}

fn is_long(path: &Path) -> bool {
    path.metadata().is_ok_and(|file| file.len() > LONGEST_READ)
}
