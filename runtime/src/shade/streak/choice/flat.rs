//! The choice as a graphics card reads it.

use super::Choice;

impl Choice {
    /// Where each bin begins, one more than there are bins; then the bins' patterns.
    pub fn flat(&self) -> Vec<u32> {
        self.starts.iter().copied().chain(self.patterns.iter().map(|pattern| u32::from(*pattern))).collect()
    }
}
