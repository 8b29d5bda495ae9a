//! A profile's nodes as a graphics card reads them.

use super::Profile;

impl Profile {
    /// Value and first integral at every node.
    pub fn nodes(&self) -> impl Iterator<Item = [f32; 2]> {
        self.values.iter().zip(&self.first).map(|(value, first)| [*value as f32, *first as f32])
    }
}

impl Profile {
    /// Nodes of every profile.
    pub const NODES: usize = super::INTERVALS + 1;
}
