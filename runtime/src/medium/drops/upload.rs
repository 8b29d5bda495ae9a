//! The table's bins, as a graphics card reads them.

use super::PhaseTable;

impl PhaseTable {
    /// 1/sr in the middle of every bin of half a degree.
    pub(crate) fn bins(&self) -> &[[f64; 3]] {
        &self.values
    }
}
