//! Pieces that are neither rows nor strokes: whole sections that took a while.

use super::store::Key;
use super::{ResponseCache, program};
use crate::provenance::tool;

/// Longest piece, bytes.
const LONGEST: usize = 64 << 20;

impl ResponseCache {
    /// Name of a piece that depends on these bytes and on this very program.
    pub(crate) fn piece_key(&self, kind: &str, parts: &[&[u8]]) -> Key {
        let mut hasher = blake3::Hasher::new();
        for part in [tool().as_bytes(), program(), b"piece", kind.as_bytes()].iter().chain(parts) {
            hasher.update(&(part.len() as u64).to_le_bytes());
            hasher.update(part);
        }
        *hasher.finalize().as_bytes()
    }

    /// A piece that was kept.
    pub(crate) fn piece(&self, key: &Key) -> Option<Vec<u8>> {
        self.store.get(key, LONGEST)
    }

    /// Keeps a piece.
    pub(crate) fn keep_piece(&self, key: &Key, bytes: &[u8]) {
        if bytes.len() <= LONGEST {
            self.store.put(key, bytes);
        }
    }
}
