//! The table of edges as a graphics card reads it.

use super::EdgeTable;

impl EdgeTable {
    /// Of every transition half its length, px, then its values.
    pub fn nodes(&self) -> Vec<f32> {
        let each = self.transitions.iter();
        each.flat_map(|one| std::iter::once(one.radius).chain(one.values)).collect()
    }
}
