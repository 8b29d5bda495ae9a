//! What the examples share: their arguments, and the plainest of picture files.
#![allow(dead_code)]

use squall_runtime::picture::Picture;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The asset that examples read unless told otherwise: a small one that comes with the project.
pub const ASSET: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../data/golden/v1/golden.squall");

/// The asset and the file to write: the first and the second argument, or defaults.
pub fn arguments(out: &str) -> [PathBuf; 2] {
    let mut given = std::env::args_os().skip(1).map(PathBuf::from);
    [given.next().unwrap_or_else(|| ASSET.into()), given.next().unwrap_or_else(|| out.into())]
}

/// Writes sRGB pixels as a binary portable pixmap, which most viewers open.
pub fn save_ppm(path: &Path, size: &Picture, pixels: &[[u8; 3]]) -> std::io::Result<()> {
    let mut file = std::io::BufWriter::new(std::fs::File::create(path)?);
    writeln!(file, "P6 {} {} 255", size.width, size.height)?;
    file.write_all(pixels.as_flattened())?;
    file.flush()
}
