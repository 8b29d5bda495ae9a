//! A picture in linear light: what every shading call reads and writes.

use crate::error::RuntimeError;

/// Linear RGB radiance, row 0 = top, x fastest. Watts per square metre per steradian per colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `width * height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

impl Picture {
    /// A black picture. Errors: zero or more than 2²⁸ pixels.
    pub fn new(width: usize, height: usize) -> Result<Self, RuntimeError> {
        let count = width.checked_mul(height).filter(|&count| (1..=1 << 28).contains(&count));
        let count = count.ok_or_else(|| {
            RuntimeError::argument("picture size", "1 to 2^28 pixels", format!("{width} × {height}"))
        })?;
        Ok(Self { width, height, pixels: vec![[0.0; 3]; count] })
    }

    /// The pixels of row `y`, from the left.
    pub fn row(&self, y: usize) -> &[[f32; 3]] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }
}
