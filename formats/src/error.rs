//! What can be wrong with bytes, split by who must act, and the limits checked before memory is taken.

use crate::tag::Tag;

/// How errors name the first eight bytes of a file; [`ReadError::is_foreign`] looks for it.
pub(crate) const MAGIC_FIELD: &str = "magic";

/// Why bytes were refused. Each says where, what was wanted and what was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// Not a Squall asset at all, or one whose header was damaged.
    #[error("header, byte {offset}: {field}: wanted {wanted}, found {found}")]
    Header {
        /// Byte offset in the file.
        offset: u64,
        /// Which header field.
        field: &'static str,
        /// What a good file has there.
        wanted: String,
        /// What this file has there.
        found: String,
    },
    /// A format or section version that this build does not know; a newer Squall wrote it.
    #[error("{what}: version {found} is not supported; this build reads up to version {newest}")]
    Unsupported {
        /// The file itself, or a section's tag.
        what: String,
        /// Version in the file.
        found: u16,
        /// Newest version that this build reads.
        newest: u16,
    },
    /// A required section of a kind that this build does not know.
    #[error("section {section} is required but unknown to this build")]
    UnknownRequired {
        /// The unknown tag.
        section: Tag,
    },
    /// A section that the caller needs and the asset does not have.
    #[error("the asset has no section {section} ({holds})")]
    Missing {
        /// The tag looked for.
        section: Tag,
        /// What that section would hold, in words.
        holds: &'static str,
    },
    /// Bytes end before a value does.
    #[error("section {section}, byte {offset}: {missing} more bytes wanted")]
    Truncated {
        /// Section whose bytes end.
        section: Tag,
        /// Offset inside the section.
        offset: u64,
        /// How many bytes are missing.
        missing: u64,
    },
    /// Stored and recomputed checksums differ.
    #[error(
        "section {section}, {part}: checksum: wanted {wanted:08x}, found {found:08x}; the file is damaged"
    )]
    Checksum {
        /// Damaged section.
        section: Tag,
        /// Which part of it.
        part: String,
        /// Checksum stored in the file.
        wanted: u32,
        /// Checksum of the bytes that are there.
        found: u32,
    },
    /// A value outside its range.
    #[error("section {section}{}: {field}: wanted {wanted}, found {found}", place(.offset))]
    Invalid {
        /// Section that holds the value.
        section: Tag,
        /// Offset of the value inside the section; `None` where the field has no place of its own, as those of a
        /// metadata record behind lists have none.
        offset: Option<u64>,
        /// Which field.
        field: &'static str,
        /// What a good file has there.
        wanted: &'static str,
        /// What this file has there.
        found: String,
    },
    /// A count above the limit that guards memory.
    #[error("section {section}: {field}: {wanted} wanted, {allowed} allowed")]
    OverLimit {
        /// Section that asks for too much.
        section: Tag,
        /// Which count.
        field: &'static str,
        /// What the file asks for.
        wanted: u64,
        /// What the limits allow.
        allowed: u64,
    },
}

fn place(offset: &Option<u64>) -> String {
    offset.map_or_else(String::new, |offset| format!(", byte {offset}"))
}

impl ReadError {
    /// Whether the bytes are no asset at all: they do not start as one does.
    pub fn is_foreign(&self) -> bool {
        matches!(self, Self::Header { field: MAGIC_FIELD, .. })
    }

    /// Whether the bytes are an asset that came to harm, as opposed to one that this build cannot judge.
    pub fn is_damage(&self) -> bool {
        match self {
            Self::Header { .. } => !self.is_foreign(),
            Self::Truncated { .. }
            | Self::Checksum { .. }
            | Self::Invalid { .. }
            | Self::OverLimit { .. } => true,
            Self::Unsupported { .. } | Self::UnknownRequired { .. } | Self::Missing { .. } => false,
        }
    }
}

/// Upper bounds on what a file may ask for, checked before any allocation.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Sections in a file.
    pub sections: u32,
    /// Bytes of one section's head (its metadata).
    pub head_bytes: u64,
    /// Cells of a grid.
    pub cells: u64,
    /// Virtual sources of a cloud response: nodes of its light grid, and distant lights.
    pub sources: u64,
    /// Streak patterns.
    pub patterns: u64,
    /// Cosines and products of tables over all streak patterns: the work of preparing them goes with their sum.
    pub pattern_terms: u64,
    /// Strokes, blocks, street lamps, roads, flashes, provenance inputs and budgets: of each so many.
    pub items: u64,
    /// Segments of all strokes that are grown together, as those are that flash in one picture.
    pub segments: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            sections: 64,
            head_bytes: 64 << 20,
            cells: 1 << 28,
            sources: 1 << 24,
            patterns: 1 << 12,
            pattern_terms: 1 << 18,
            items: 1 << 20,
            segments: 1 << 20,
        }
    }
}
