//! Section tags: the four letters by which the section table names a section's kind.
//!
//! This file stands below all others of the crate that read bytes: errors name sections, and so does everything that
//! can be wrong with one.

/// Four ASCII letters that name a section's kind.
///
/// ```
/// use squall_formats::Tag;
///
/// assert_eq!(Tag(*b"CLDG").to_string(), "CLDG");
/// assert!(Tag(*b"CLDG").is_letters());
/// assert!(!Tag(*b"CL\0G").is_letters());
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Tag(pub [u8; 4]);

impl Tag {
    /// Whether all four bytes are ASCII letters, as those of every section are.
    pub const fn is_letters(self) -> bool {
        let [a, b, c, d] = self.0;
        a.is_ascii_alphabetic()
            && b.is_ascii_alphabetic()
            && c.is_ascii_alphabetic()
            && d.is_ascii_alphabetic()
    }
}

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
