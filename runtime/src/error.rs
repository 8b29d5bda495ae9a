//! What the runtime can refuse.

use squall_formats::{ReadError, Tag};
use squall_transport::ArgumentError;
use std::path::PathBuf;

/// Why an asset could not be opened, or a call on it could not be answered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// The file cannot be opened, mapped or read.
    #[error("{}: cannot read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The bytes are not a whole asset that this build reads.
    #[error("{}: {source}", path.display())]
    Asset {
        /// The file, or `(memory)`.
        path: PathBuf,
        /// What is wrong with the bytes.
        source: ReadError,
    },
    /// An asset that is read piece by piece lacks bytes that the call needs: [`crate::Asset::give`] takes them, then call again.
    #[error("{}: {} bytes in {} pieces have not been fetched, the first from byte {}", path.display(),
        ranges.iter().map(|range| range.end - range.start).sum::<u64>(), ranges.len(),
        ranges.last().map_or(0, |range| range.start))]
    NotFetched {
        /// What the asset was opened as.
        path: PathBuf,
        /// Bytes of the file, the last piece first.
        ranges: Vec<std::ops::Range<u64>>,
    },
    /// An argument outside what the call accepts.
    #[error("{field}: wanted {wanted}, found {found}")]
    Argument {
        /// Which argument.
        field: &'static str,
        /// The accepted range.
        wanted: String,
        /// The value given.
        found: String,
    },
    /// A graphics card that is not there, cannot do what is needed or answers no more.
    #[error("graphics device: wanted {wanted}, found {found}")]
    Device {
        /// What is needed.
        wanted: String,
        /// What there is.
        found: String,
    },
}

impl RuntimeError {
    /// Whether the asset lacks the section `tag`.
    pub fn is_missing(&self, tag: Tag) -> bool {
        matches!(self, Self::Asset { source: ReadError::Missing { section, .. }, .. } if *section == tag)
    }

    /// An [`RuntimeError::Argument`].
    pub fn argument(field: &'static str, wanted: impl Into<String>, found: impl ToString) -> Self {
        Self::Argument { field, wanted: wanted.into(), found: found.to_string() }
    }
}

impl From<ArgumentError> for RuntimeError {
    fn from(error: ArgumentError) -> Self {
        Self::Argument { field: error.field, wanted: error.wanted, found: error.found }
    }
}
