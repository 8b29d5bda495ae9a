//! How far a long computation is, and whether somebody wants it to stop.

use crate::error::BakeError;

/// Receives progress. Implementations are called from several threads.
pub trait Progress: Sync {
    /// A stage of `total` steps begins.
    fn begin(&self, stage: &str, total: u64);
    /// `steps` more of the present stage are done.
    fn advance(&self, steps: u64);
    /// Whether to stop as soon as possible.
    fn interrupted(&self) -> bool;

    /// [`BakeError::Interrupted`] once somebody wants to stop.
    fn check(&self) -> Result<(), BakeError> {
        if self.interrupted() { Err(BakeError::Interrupted) } else { Ok(()) }
    }
}

/// Says nothing and never stops.
pub struct Quiet;

impl Progress for Quiet {
    fn begin(&self, _: &str, _: u64) {}
    fn advance(&self, _: u64) {}
    fn interrupted(&self) -> bool {
        false
    }
}
