//! How a medium spreads light.

use super::drops::PhaseTable;
use crate::phase::{henyey_greenstein, paper_henyey_greenstein};
use std::sync::Arc;

/// How the medium spreads light.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Phase {
    /// Henyey and Greenstein's function with this asymmetry.
    HenyeyGreenstein(f64),
    /// The same as \[weber\] eq. 10 prints it, which loses light.
    Paper(f64),
    /// By angle and colour: [`PhaseTable::drops`] has the rainbow.
    Table(Arc<PhaseTable>),
}

impl Phase {
    /// Value for a cosine between travel directions, 1/sr per colour.
    pub fn values(&self, cos_theta: f64) -> [f64; 3] {
        match self {
            &Self::HenyeyGreenstein(g) => [henyey_greenstein(g, cos_theta); 3],
            &Self::Paper(g) => [paper_henyey_greenstein(g, cos_theta); 3],
            Self::Table(table) => table.values(cos_theta),
        }
    }

    /// Legendre moments χ_l = 2π ∫ p(μ) P_l(μ) dμ per colour: what blurring by it leaves of degree l of a function on the sphere.
    pub fn moments(&self, degree: usize) -> [f64; 3] {
        let power = |g: f64| (0..degree).fold(1.0, |product, _| product * g);
        match self {
            &Self::HenyeyGreenstein(g) => [power(g); 3],
            &Self::Paper(g) => [power(g) * (1.0 - g) / (1.0 + g); 3],
            Self::Table(table) => table.moments(degree),
        }
    }

    /// Factor on Henyey and Greenstein's function of the asymmetry beside it, where it is one.
    pub(crate) fn as_henyey_greenstein(&self) -> Option<(f64, f64)> {
        match *self {
            Self::HenyeyGreenstein(g) => Some((1.0, g)),
            Self::Paper(g) => Some(((1.0 - g) / (1.0 + g), g)),
            Self::Table(_) => None,
        }
    }
}
