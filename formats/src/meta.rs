//! A section's metadata: which version it is of, where its record lies, and the record itself, as bincode behind this one
//! module: fixed-width little-endian integers, a byte limit, and no byte left over.
//!
//! bincode 1.3.3 is complete but no longer maintained. It stays pinned because its wire form is simple
//! enough to write down (SPEC.md, "Metadata") and, with a limit set, it takes no more memory than the
//! bytes it is given; a compatible successor can replace it here alone. Types stored with it hold no
//! zero-sized elements, whose count a hostile file could inflate at no cost to itself.

use crate::error::{Limits, ReadError};
use crate::tag::Tag;
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
        offset: None,
        field: "metadata",
        wanted: "a complete record of this section's version",
        found: error.to_string(),
    })
}

/// Refuses a section of version 0, which is none, or above `newest`, by name.
pub fn check_version(tag: Tag, found: u16, newest: u16) -> Result<(), ReadError> {
    if found == 0 || found > newest {
        return Err(ReadError::Unsupported { what: format!("section {tag}"), found, newest });
    }
    Ok(())
}

/// Sections with bulk start with the length of their metadata as u64, the metadata, and zeros up to a multiple of 64.
/// Returns metadata and what follows the zeros.
pub(crate) fn split_head(section: Tag, bytes: &[u8]) -> Result<(&[u8], &[u8]), ReadError> {
    let short = |missing: u64| ReadError::Truncated { section, offset: bytes.len() as u64, missing };
    let (length, rest) = bytes.split_first_chunk::<8>().ok_or_else(|| short(8 - bytes.len() as u64))?;
    let length = u64::from_le_bytes(*length);
    let end = length.saturating_add(8);
    if end > bytes.len() as u64 {
        return Err(short(end - bytes.len() as u64));
    }
    let padded = end.next_multiple_of(64).min(bytes.len() as u64) as usize;
    if let Some(at) = bytes[end as usize..padded].iter().position(|&b| b != 0) {
        return Err(ReadError::Invalid {
            section,
            offset: Some(end + at as u64),
            field: "padding behind the metadata",
            wanted: "zero",
            found: bytes[end as usize + at].to_string(),
        });
    }
    Ok((&rest[..length as usize], &bytes[padded..]))
}

/// The inverse of [`split_head`]: length, metadata, zeros up to a multiple of 64.
pub(crate) fn join_head(metadata: &[u8]) -> Vec<u8> {
    let mut bytes = (metadata.len() as u64).to_le_bytes().to_vec();
    bytes.extend_from_slice(metadata);
    bytes.resize(bytes.len().next_multiple_of(64), 0);
    bytes
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
