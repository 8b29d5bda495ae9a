//! What transport can refuse.

/// An argument outside what the call accepts.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: wanted {wanted}, found {found}")]
pub struct ArgumentError {
    /// Which argument.
    pub field: &'static str,
    /// The accepted range.
    pub wanted: String,
    /// The value given.
    pub found: String,
}

impl ArgumentError {
    /// Argument `field`, whose value `found` is not one of `wanted`.
    pub fn new(field: &'static str, wanted: impl Into<String>, found: impl ToString) -> Self {
        Self { field, wanted: wanted.into(), found: found.to_string() }
    }
}
