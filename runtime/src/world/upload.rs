//! A world's light as a graphics card takes it.

use super::degrees::Basis;

#[cfg(test)]
impl super::WorldLight {
    /// Every coefficient in the order l² + l + m; zeros above degree 2 where only those are known.
    pub(crate) fn all_coefficients(&self) -> Vec<[f32; 4]> {
        let known = self.harmonics.iter().chain(&self.finer);
        let mut all: Vec<[f32; 4]> = known.map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        all.resize(super::degrees::COUNT, [0.0; 4]);
        all
    }
}

/// Factors of the harmonics' recurrence by number.
pub(crate) fn basis_steps() -> Vec<[f32; 4]> {
    Basis::new().flat()
}
