//! A map of directions as a graphics card's texels.

#[cfg(test)]
use super::{Environment, EnvironmentWindow};

#[cfg(test)]
impl Environment {
    /// Which directions it holds; radiances row by row from the bottom.
    pub(crate) fn texels(&self) -> (EnvironmentWindow, &[[f32; 3]]) {
        (self.window, &self.pixels)
    }
}
