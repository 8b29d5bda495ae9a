//! What baking can refuse, split by who must act; each variant knows its exit code.

use squall_formats::ReadError;
use squall_runtime::RuntimeError;
use squall_runtime::transport::ArgumentError;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Why a bake, a solve or a picture did not come about.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// An input file that is missing, unreadable as what it claims to be, or out of range.
    #[error("{}: {field}: wanted {wanted}, found {found}", file.display())]
    Input {
        /// The file.
        file: PathBuf,
        /// Place or field inside it.
        field: String,
        /// What is accepted there.
        wanted: String,
        /// What is there.
        found: String,
    },
    /// A place in a recipe that is wrong.
    #[error(transparent)]
    Recipe(#[from] Box<RecipeError>),
    /// The system refused to read or write.
    #[error("{}: cannot {action}: {source}", file.display())]
    Io {
        /// The file or folder.
        file: PathBuf,
        /// read, write, …
        action: &'static str,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// An asset that the runtime refuses.
    #[error(transparent)]
    Asset(#[from] RuntimeError),
    /// A method that could not reach what was asked of it, with the best it reached.
    #[error("{what}: wanted {wanted}, reached {reached}; {hint}")]
    NotReached {
        /// Which computation.
        what: String,
        /// What was asked for.
        wanted: String,
        /// The best that was reached.
        reached: String,
        /// What would help.
        hint: String,
    },
    /// Measured figures above what was allowed, or not measured.
    #[error("{asset}: {}", found.join("; "))]
    OverLimit {
        /// What the asset is called.
        asset: String,
        /// Each figure with its bound, in words.
        found: Vec<String>,
    },
    /// A setting of a computation that is out of range, named as the recipe names it.
    #[error("{field}: wanted {wanted}, found {found}")]
    Setting {
        /// Its key.
        field: &'static str,
        /// What is accepted there.
        wanted: String,
        /// What it is.
        found: String,
    },
    /// A check found an asset damaged.
    #[error(transparent)]
    Damaged(RuntimeError),
    /// A check found two files different.
    #[error("{} and {}: {what}", a.display(), b.display())]
    Different {
        /// The one.
        a: PathBuf,
        /// The other.
        b: PathBuf,
        /// In what they differ.
        what: String,
    },
    /// A light that was to be drawn left no picture.
    #[error("no picture was drawn")]
    NoPicture,
    /// Frames of a sequence that failed while others were made.
    #[error("{failed} of {of} frames failed; the first: {first}")]
    Frames {
        /// How many.
        failed: usize,
        /// Of how many.
        of: usize,
        /// What was wrong with the first.
        first: String,
    },
    /// An error that was told before, where more than one thing fails by it.
    #[error("{words}")]
    Told {
        /// Its exit code.
        exit_code: u8,
        /// Its words.
        words: String,
    },
    /// Ctrl-C or a termination signal.
    #[error("interrupted; nothing was written")]
    Interrupted,
}

/// What is wrong at one place of a recipe.
#[derive(Clone, Debug)]
pub struct RecipeError {
    /// The recipe.
    pub file: Box<Path>,
    /// Its whole text.
    pub text: Box<str>,
    /// Bytes of the text that are meant.
    pub span: Range<usize>,
    /// Which key.
    pub field: String,
    /// What is accepted.
    pub wanted: String,
    /// What stands there.
    pub found: String,
}

impl RecipeError {
    /// Line and column of the place, counted from 1; columns in characters.
    pub fn line_and_column(&self) -> (usize, usize) {
        let before = &self.text[..self.floor(self.span.start)];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// The start of the character that byte `at` lies in.
    fn floor(&self, at: usize) -> usize {
        let at = at.min(self.text.len());
        (0..=at).rev().find(|&i| self.text.is_char_boundary(i)).unwrap_or(0)
    }
}

impl std::fmt::Display for RecipeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (line, column) = self.line_and_column();
        let (file, field) = (self.file.display(), &self.field);
        write!(f, "{file}:{line}:{column}: {field}: wanted {}, found {}", self.wanted, self.found)
    }
}

impl std::error::Error for RecipeError {}

/// Exit code of the command for what the runtime refused: 3 bad input, 4 the system.
pub fn runtime_exit_code(error: &RuntimeError) -> u8 {
    match error {
        RuntimeError::Io { source, .. } => io_exit_code(source),
        // No graphics card, or one that answers no more.
        RuntimeError::Device { .. } => 4,
        // An asset or an argument that was refused.
        _ => 3,
    }
}

/// A file that is not there, or is a folder, is bad input; anything else is the system's refusal.
pub fn io_exit_code(error: &std::io::Error) -> u8 {
    match error.kind() {
        std::io::ErrorKind::NotFound | std::io::ErrorKind::IsADirectory => 3,
        _ => 4,
    }
}

impl From<ArgumentError> for BakeError {
    fn from(error: ArgumentError) -> Self {
        Self::Asset(error.into())
    }
}

impl From<RecipeError> for BakeError {
    fn from(error: RecipeError) -> Self {
        Self::Recipe(Box::new(error))
    }
}

impl BakeError {
    /// Exit code of the command for this error: 1 a check failed, 3 bad input, 4 the system, 130 interrupted.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Damaged(_)
            | Self::Different { .. }
            | Self::NoPicture
            | Self::NotReached { .. }
            | Self::OverLimit { .. }
            | Self::Frames { .. } => 1,
            Self::Told { exit_code, .. } => *exit_code,
            Self::Input { .. } | Self::Recipe(_) | Self::Setting { .. } => 3,
            Self::Asset(error) => runtime_exit_code(error),
            Self::Io { source, .. } => io_exit_code(source),
            Self::Interrupted => 130,
        }
    }

    /// An [`BakeError::Input`].
    pub fn input(
        file: &Path,
        field: impl Into<String>,
        wanted: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self::Input {
            file: file.to_owned(),
            field: field.into(),
            wanted: wanted.into(),
            found: found.to_string(),
        }
    }

    /// An [`BakeError::Io`].
    pub fn io(file: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let file = file.to_owned();
        move |source| Self::Io { file, action, source }
    }

    /// Bytes of `file` that are no asset.
    pub fn bytes(file: &Path, source: ReadError) -> Self {
        Self::Asset(RuntimeError::Asset { path: file.to_owned(), source })
    }
}
