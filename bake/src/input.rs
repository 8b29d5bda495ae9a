//! Readers of what people hand in: scenes, lamps, cameras, grids. Each refuses with file, field, wanted, found.

pub mod picture;
pub mod scene;
pub mod town;

use crate::error::BakeError;
use std::path::Path;

/// Largest text input read, bytes; a scene or a lamp list is far smaller.
const MAX_TEXT_BYTES: u64 = 64 << 20;

/// Reads a whole text file of at most 64 MiB.
pub fn read_text(path: &Path) -> Result<String, BakeError> {
    let length = std::fs::metadata(path).map_err(BakeError::io(path, "read"))?.len();
    if length > MAX_TEXT_BYTES {
        return Err(BakeError::input(path, "file", format!("at most {MAX_TEXT_BYTES} bytes"), length));
    }
    let bytes = std::fs::read(path).map_err(BakeError::io(path, "read"))?;
    String::from_utf8(bytes).map_err(|e| BakeError::input(path, "file", "UTF-8 text", e))
}

/// Reads a JSON file as `T`; what does not fit is refused with line and column.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, what: &str) -> Result<T, BakeError> {
    let text = read_text(path)?;
    serde_json::from_str(&text).map_err(|error| {
        let place = format!("line {} column {}", error.line(), error.column());
        let found = error.to_string();
        let found = found.split(" at line ").next().unwrap_or_default().to_owned();
        BakeError::input(path, place, what, found)
    })
}

/// Reads a raw little-endian f32 array of exactly `count` finite values.
///
/// Errors: a missing file, another length, a value that is not finite or below zero; the message names the value's
/// index.
pub fn read_grid(path: &Path, count: usize) -> Result<Vec<f32>, BakeError> {
    let length = std::fs::metadata(path).map_err(BakeError::io(path, "read"))?.len();
    let wanted = count as u64 * 4;
    if length != wanted {
        let wanted = format!("{wanted} bytes ({count} little-endian f32 values, as the scene's dims say)");
        return Err(BakeError::input(path, "length", wanted, format!("{length} bytes")));
    }
    let bytes = std::fs::read(path).map_err(BakeError::io(path, "read"))?;
    let values: Vec<f32> =
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    if values.len() != count {
        return Err(BakeError::input(path, "length", format!("{count} values"), values.len()));
    }
    match values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
        None => Ok(values),
        Some(at) => Err(BakeError::input(path, format!("value {at}"), "finite and not negative", values[at])),
    }
}
