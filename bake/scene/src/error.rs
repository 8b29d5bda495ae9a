//! Why a scene was refused.

/// What is wrong with a scene's file or with what is asked of it: place, wanted, found.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// A file that is no scene, or a number in it out of range.
    #[error("{field}: wanted {wanted}, found {found}")]
    Input {
        /// Place or field in the file.
        field: String,
        /// What is accepted there.
        wanted: String,
        /// What is there.
        found: String,
    },
    /// Somebody wants the work to stop.
    #[error("interrupted")]
    Interrupted,
}

impl SceneError {
    /// A [`SceneError::Input`].
    pub fn input(field: impl Into<String>, wanted: impl Into<String>, found: impl ToString) -> Self {
        Self::Input { field: field.into(), wanted: wanted.into(), found: found.to_string() }
    }
}
