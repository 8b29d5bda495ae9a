//! Readers of what people hand in: recipes, scenes, lamps, cameras, grids, towns, pictures. Each refuses with file,
//! field, wanted, found. docs/inputs.md says what each file holds.
//!
//! A file is read once, whole, up to a limit that its kind has: what is hashed into provenance is what was used.

pub mod depth;
pub mod facts;
pub mod gbuffer;
pub mod json;
pub mod light_probe;
#[cfg(feature = "meshes")]
pub mod meshes;
pub mod npy;
pub mod picture;
pub mod pose;
pub mod scene;
pub mod sequence;
pub mod streak_notes;
pub mod town;
pub mod vdb;
pub mod volume;

use crate::error::BakeError;
pub use json::read_json;
use squall_formats::magic::kind_of;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Largest text input read, bytes (64 MiB); a scene or a lamp list is far smaller.
pub const MAX_TEXT_BYTES: u64 = 64 << 20;
/// Largest picture read, bytes (2 GiB).
pub const MAX_PICTURE_BYTES: u64 = 2 << 30;
/// UTF-8's byte order mark, which some editors put in front of text.
const BYTE_ORDER_MARK: &str = "\u{feff}";

/// A file as it was read, once.
#[derive(Clone, Debug)]
pub struct Input {
    /// The file.
    pub path: PathBuf,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Which file was used, and what was in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fingerprint {
    /// The file.
    pub path: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
    /// BLAKE3 of its bytes.
    pub hash: [u8; 32],
}

impl Input {
    /// Reads a file of at most `most` bytes. Pipes are read to their end; a file that never ends is refused as soon as it
    /// gives more than `most`.
    ///
    /// Errors: no such file, a folder, a longer file, the system's refusal.
    pub fn read(path: &Path, most: u64) -> Result<Self, BakeError> {
        Self::read_if(path, most, |_| true)
    }

    /// Like [`Input::read`], but stops after the first bytes where `wanted` does not take them: they are all that the
    /// result then holds.
    pub fn read_if(path: &Path, most: u64, wanted: impl FnOnce(&[u8]) -> bool) -> Result<Self, BakeError> {
        let mut file = File::open(path).map_err(BakeError::io(path, "open"))?;
        let metadata = file.metadata().map_err(BakeError::io(path, "read"))?;
        if metadata.is_dir() {
            return Err(BakeError::input(path, "file", "a file", "a folder"));
        }
        let too_long = |found: String| BakeError::input(path, "file", at_most(most), found);
        let mut bytes = Vec::new();
        let mut read = |bytes: &mut Vec<u8>, count: u64| {
            file.by_ref().take(count).read_to_end(bytes).map_err(BakeError::io(path, "read"))
        };
        read(&mut bytes, squall_formats::magic::LOOKED_AT as u64)?;
        if !wanted(&bytes) {
            return Ok(Self { path: path.to_owned(), bytes });
        }
        if metadata.is_file() && metadata.len() > most {
            return Err(too_long(format!("{} bytes", metadata.len())));
        }
        if metadata.is_file() {
            bytes.reserve_exact((metadata.len() as usize).saturating_sub(bytes.len()));
        }
        // One byte more than is allowed tells a longer file, whatever its length was said to be.
        read(&mut bytes, (most + 1).saturating_sub(squall_formats::magic::LOOKED_AT as u64))?;
        if bytes.len() as u64 > most {
            return Err(too_long("more".into()));
        }
        Ok(Self { path: path.to_owned(), bytes })
    }

    /// Its name, length and hash.
    pub fn fingerprint(&self) -> Fingerprint {
        let hash = *blake3::hash(&self.bytes).as_bytes();
        Fingerprint { path: self.path.clone(), bytes: self.bytes.len() as u64, hash }
    }

    /// What the bytes are by their start, for messages.
    pub fn kind(&self) -> String {
        kind_of(&self.bytes).map_or_else(
            || {
                let start = &self.bytes[..self.bytes.len().min(8)];
                format!("a file that starts with \"{}\"", start.escape_ascii())
            },
            |kind| format!("{kind}, by its first bytes"),
        )
    }

    /// The bytes as text, without a byte order mark; `what` says what was expected.
    ///
    /// Errors: bytes that are no UTF-8.
    pub fn text(&self, what: &str) -> Result<&str, BakeError> {
        if !may_be_text(&self.bytes) {
            return Err(BakeError::input(&self.path, "file", format!("{what}, UTF-8 text"), self.kind()));
        }
        match std::str::from_utf8(&self.bytes) {
            Ok(text) => Ok(without_mark(text)),
            Err(error) => {
                let found = match kind_of(&self.bytes) {
                    Some(kind) if kind != "text" => format!("{kind}, by its first bytes"),
                    _ => format!("byte {} that is no UTF-8", error.valid_up_to()),
                };
                Err(BakeError::input(&self.path, "file", format!("{what}, UTF-8 text"), found))
            }
        }
    }
}

/// Text behind its byte order mark, if it has one.
pub(crate) fn without_mark(text: &str) -> &str {
    text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text)
}

fn at_most(bytes: u64) -> String {
    match bytes {
        _ if bytes >= 1 << 30 && bytes.is_multiple_of(1 << 30) => format!("at most {} GiB", bytes >> 30),
        _ if bytes >= 1 << 20 && bytes.is_multiple_of(1 << 20) => format!("at most {} MiB", bytes >> 20),
        _ => format!("at most {bytes} bytes"),
    }
}

/// Reads a whole text file of at most 64 MiB, byte order mark included; `what` says what it should hold.
pub fn read_text(path: &Path, what: &str) -> Result<String, BakeError> {
    // What is no text by its first bytes is not read further.
    let input = json::read_text_input(path)?;
    input.text(what)?;
    Ok(String::from_utf8(input.bytes).unwrap_or_default())
}

/// Whether bytes may be text: text has no zero bytes.
pub(crate) fn may_be_text(start: &[u8]) -> bool {
    !start.contains(&0)
}

/// A grid's values, and which file they came from.
pub(crate) struct Grid {
    /// The values, in the file's order.
    pub values: Vec<f32>,
    /// The file.
    pub input: Fingerprint,
}

/// Reads a raw little-endian f32 array of exactly `count` finite values.
///
/// Errors: a missing file, another length, a value that is not finite or below zero; the message names the value's
/// index.
pub fn read_grid(path: &Path, count: usize) -> Result<Vec<f32>, BakeError> {
    Ok(read_grid_file(path, count)?.values)
}

/// Like [`read_grid`], with the file's fingerprint.
pub(crate) fn read_grid_file(path: &Path, count: usize) -> Result<Grid, BakeError> {
    let wanted = count as u64 * 4;
    let words = || format!("{wanted} bytes ({count} little-endian f32 values, as the scene's dims say)");
    let metadata = std::fs::metadata(path).map_err(BakeError::io(path, "read"))?;
    let mut input = Input { path: path.to_owned(), bytes: Vec::new() };
    if !metadata.is_file() || metadata.len() == wanted {
        input = Input::read(path, wanted)?;
    }
    if input.bytes.len() as u64 != wanted {
        let length = if metadata.is_file() { metadata.len() } else { input.bytes.len() as u64 };
        if metadata.is_file() {
            input = Input::read_if(path, 0, |_| false)?;
        }
        let kind =
            kind_of(&input.bytes).map_or(String::new(), |kind| format!(": {kind}, by its first bytes"));
        return Err(BakeError::input(path, "length", words(), format!("{length} bytes{kind}")));
    }
    let values: Vec<f32> =
        input.bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    match values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
        None => Ok(Grid { values, input: input.fingerprint() }),
        Some(at) => {
            let kind = kind_of(&input.bytes).map_or(String::new(), |kind| format!(" in {kind}"));
            let found = format!("{}{kind}", values[at]);
            Err(BakeError::input(path, format!("value {at}"), "finite and not negative", found))
        }
    }
}
