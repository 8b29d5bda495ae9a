//! The recurrence as a graphics card reads it.

use super::{Basis, DEGREE};

impl Basis {
    /// a, a·b and, at number m² + 2m, Q_mm.
    pub fn flat(&self) -> Vec<[f32; 4]> {
        let mut all: Vec<[f32; 4]> =
            self.steps.iter().map(|&[a, ab]| [a as f32, ab as f32, 0.0, 0.0]).collect();
        for m in 0..=DEGREE {
            all[m * m + 2 * m][2] = self.starts[m] as f32;
        }
        all
    }
}
