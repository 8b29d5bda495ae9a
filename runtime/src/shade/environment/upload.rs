//! A map of directions as a graphics card's texels.

use super::{Environment, EnvironmentWindow};

impl Environment {
    /// Which directions it holds; radiances row by row from the bottom.
    #[cfg(test)]
    pub(crate) fn texels(&self) -> (EnvironmentWindow, &[[f32; 3]]) {
        (self.window, &self.pixels)
    }
}
