//! A medium as a graphics card asks for it.

use super::{Medium, Phase};

impl Medium {
    /// Extinction, nearest and farthest planar depth of every drawn shell.
    pub(crate) fn shells(&self) -> impl Iterator<Item = [f32; 4]> {
        self.drawn.iter().map(|shell| [shell.extinction as f32, shell.near as f32, shell.far as f32, 0.0])
    }
}

impl Phase {
    /// Asymmetry and factor of Henyey and Greenstein's function, a factor of 0 where it is a table; degrees 1 and 2 of any, the mean of
    /// the colours.
    pub(crate) fn numbers(&self) -> [f32; 4] {
        let mean = |degree| self.moments(degree).iter().sum::<f64>() as f32 / 3.0;
        let (factor, g) = self.as_henyey_greenstein().unwrap_or_default();
        [g as f32, factor as f32, mean(1), mean(2)]
    }

    /// Values by half degrees of a table.
    pub(crate) fn texels(&self) -> Option<Vec<[f32; 4]>> {
        let Self::Table(table) = self else { return None };
        Some(table.bins().iter().map(|&[r, g, b]| [r as f32, g as f32, b as f32, 0.0]).collect())
    }

    /// What is left of each degree of harmonics, 0 to the highest.
    pub(crate) fn weakening(&self) -> Vec<[f32; 4]> {
        let degrees = 0..=crate::world::HIGHEST_DEGREE;
        degrees.map(|l| self.moments(l)).map(|[r, g, b]| [r as f32, g as f32, b as f32, 0.0]).collect()
    }
}
