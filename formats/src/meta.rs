//! Small metadata as bincode, behind one module: fixed-width little-endian integers, a byte limit,
//! and no byte left over.
//!
//! bincode 1.3.3 is complete but no longer maintained. It stays pinned because its wire form is simple
//! enough to write down (SPEC.md, "Metadata") and, with a limit set, it takes no more memory than the
//! bytes it is given; a compatible successor can replace it here alone. Types stored with it hold no
//! zero-sized elements, whose count a hostile file could inflate at no cost to itself.

use crate::error::{Limits, ReadError};
use crate::section::Tag;
use bincode::Options;
use serde::{Serialize, de::DeserializeOwned};

fn options(limit: u64) -> impl Options {
    bincode::DefaultOptions::new()
        .with_fixint_encoding()
        .with_little_endian()
        .with_limit(limit)
        .reject_trailing_bytes()
}

/// The bytes of `value`. Infallible for the types stored in assets, which have no unsized parts.
pub fn encode<T: Serialize>(value: &T) -> Vec<u8> {
    options(u64::MAX)
        .serialize(value)
        .unwrap_or_else(|error| unreachable!("metadata always encodes: {error}"))
}

/// Reads a `T` that fills `bytes` exactly.
///
/// Errors: [`ReadError::OverLimit`] above `limits.head_bytes`, [`ReadError::Invalid`] when the bytes are
/// not a `T` or some are left over.
pub fn decode<T: DeserializeOwned>(section: Tag, bytes: &[u8], limits: &Limits) -> Result<T, ReadError> {
    if bytes.len() as u64 > limits.head_bytes {
        return Err(ReadError::OverLimit {
            section,
            field: "metadata bytes",
            wanted: bytes.len() as u64,
            allowed: limits.head_bytes,
        });
    }
    options(bytes.len() as u64).deserialize(bytes).map_err(|error| ReadError::Invalid {
        section,
        offset: 0,
        field: "metadata",
        wanted: "a complete record of this section's version",
        found: error.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TAG: Tag = Tag(*b"TEST");

    #[test]
    fn a_record_reads_back_and_a_byte_more_or_less_is_refused() {
        let record = (7u32, vec![1.5f64, -2.0], "name".to_string());
        let mut bytes = encode(&record);
        let read: (u32, Vec<f64>, String) = decode(TAG, &bytes, &Limits::default()).unwrap();
        assert_eq!(read, record);
        for cut in 0..bytes.len() {
            assert!(decode::<(u32, Vec<f64>, String)>(TAG, &bytes[..cut], &Limits::default()).is_err());
        }
        bytes.push(0);
        assert!(decode::<(u32, Vec<f64>, String)>(TAG, &bytes, &Limits::default()).is_err());
    }

    #[test]
    fn a_huge_count_in_few_bytes_is_refused_without_taking_memory() {
        let bytes = u64::MAX.to_le_bytes();
        assert!(decode::<Vec<f64>>(TAG, &bytes, &Limits::default()).is_err());
    }
}
