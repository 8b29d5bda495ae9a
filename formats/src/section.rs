//! Section tags, and one module per section.

pub mod bolt;
pub mod cloud;
pub mod density;
pub mod provenance;
pub mod response;
pub mod streak;
pub mod town;
pub mod view;

use crate::ReadError;

/// Four ASCII letters that name a section's kind.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tag(pub [u8; 4]);

impl std::fmt::Display for Tag {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for byte in self.0 {
            write!(f, "{}", byte.escape_ascii())?;
        }
        Ok(())
    }
}

impl std::fmt::Debug for Tag {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Tag({self})")
    }
}

/// Tags of the sections that this build reads; any other is skipped when optional and refused when required.
pub const KNOWN: &[Tag] = &[
    bolt::BoltSection::TAG,
    cloud::CloudSection::TAG,
    density::DensitySection::TAG,
    response::ResponseSection::TAG,
    provenance::ProvenanceSection::TAG,
    streak::StreakSection::TAG,
    town::TownSection::TAG,
    view::ViewSection::TAG,
];

/// Whether this build reads sections of kind `tag`.
pub fn is_known(tag: Tag) -> bool {
    KNOWN.contains(&tag)
}

/// Refuses a section version above `newest` by name.
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
    if bytes[end as usize..padded].iter().any(|&b| b != 0) {
        return Err(ReadError::Invalid {
            section,
            offset: end,
            field: "padding behind the metadata",
            wanted: "zero",
            found: "something else".into(),
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
