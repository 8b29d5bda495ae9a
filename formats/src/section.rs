//! Section tags, and one module per section.

pub mod town;

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
pub const KNOWN: &[Tag] = &[town::TownSection::TAG];

/// Whether this build reads sections of kind `tag`.
pub fn is_known(tag: Tag) -> bool {
    KNOWN.contains(&tag)
}

/// Refuses a section version above `newest` by name.
pub fn check_version(tag: Tag, found: u16, newest: u16) -> Result<(), crate::ReadError> {
    if found == 0 || found > newest {
        return Err(crate::ReadError::Unsupported { what: format!("section {tag}"), found, newest });
    }
    Ok(())
}
