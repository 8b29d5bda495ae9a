//! How light that a cell scatters depends on direction: J and the bases that it is stored in. Bytes: SPEC.md, "CLRT".
//!
//! **In-scattered radiance**, J(ω) = ∫ p(ω·ω′) L(ω′) dω′, W/(m² sr): the radiance L of all directions ω′, weighed by the
//! phase function p, 1/sr, and integrated over the sphere. A medium of albedo ϖ and extinction σ, 1/m, sends ϖ σ J(ω) per
//! volume and steradian in direction of travel ω. Stored J is the mean over a cell. This is the one definition of J; all
//! other pages mean this one.
//!
//! | symbol | meaning | unit |
//! | J | in-scattered radiance | W/(m² sr) |
//! | c_i | coefficient of J on function i of a basis, a number a cell | of J |
//! | f_i | factor of coefficient i in a direction: J(ω) = Σ c_i f_i(ω) | – |

use crate::sphere;
use crate::view_region::{ViewRegionFrame, view_functions};
use serde::{Deserialize, Serialize};

/// What the coefficients of a row mean: a basis of in-scattered radiance J as a function of direction ([`self`](crate::basis)).
///
/// ```
/// use squall_formats::basis::DirectionalBasis;
///
/// let basis = DirectionalBasis::Harmonics { degree: 1 };
/// assert_eq!((basis.count(), basis.name()), (4, "4 harmonics".to_owned()));
///
/// // J = 0.5 Y_00 + 2 Y_10, seen in a direction of travel straight up.
/// let coefficients = [0.5, 0.0, 2.0, 0.0];
/// let mut factors = Vec::new();
/// basis.factors([0.0, 0.0, 1.0], None, &mut factors);
/// let j: f32 = coefficients.iter().zip(&factors).map(|(c, f)| c * f).sum();
/// assert!((j - (0.5 * 0.28209 + 2.0 * 0.48860)).abs() < 1e-4);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum DirectionalBasis {
    /// J in the 26 directions of [`sphere::directions_26`], read between by [`sphere::interpolate_26`].
    Directions26,
    /// J's coefficients on the real orthonormal harmonics of degree 0 to `degree`, in [`sphere::harmonics`]' order.
    Harmonics {
        /// Highest degree, 0 to 3.
        degree: u8,
    },
    /// J towards viewpoints in a view region alone: its coefficients on the polynomials of [`ViewRegionFrame`].
    ViewRegion {
        /// Highest degree, 0 to 2.
        degree: u8,
    },
}

impl DirectionalBasis {
    /// Number of coefficients.
    pub const fn count(self) -> usize {
        match self {
            Self::Directions26 => 26,
            Self::Harmonics { degree } => sphere::harmonic_count(degree as usize),
            Self::ViewRegion { degree } => view_functions(degree),
        }
    }

    /// What the basis is called in reports: "26 directions", "4 harmonics", "3 coefficients towards the view region".
    pub fn name(self) -> String {
        match self {
            Self::Directions26 => "26 directions".to_owned(),
            Self::Harmonics { .. } => format!("{} harmonics", self.count()),
            Self::ViewRegion { .. } => format!("{} coefficients towards the view region", self.count()),
        }
    }

    /// Factor of each coefficient in unit direction `towards`: J(towards) = Σ coefficient × factor. `factors` is emptied and
    /// then holds [`DirectionalBasis::count`] numbers.
    ///
    /// Those of [`DirectionalBasis::ViewRegion`] differ from cell to cell: `view` is the region's frame and the middle of
    /// the cell, m, and without it they are 0. The other bases do not look at it.
    pub fn factors(
        self,
        towards: [f64; 3],
        view: Option<(&ViewRegionFrame, [f64; 3])>,
        factors: &mut Vec<f32>,
    ) {
        factors.clear();
        factors.resize(self.count(), 0.0);
        match self {
            Self::ViewRegion { .. } => {
                let Some((frame, cell)) = view else { return };
                fill(factors, &frame.functions(cell, towards));
            }
            Self::Directions26 => {
                for (direction, weight) in sphere::interpolate_26(towards) {
                    factors[direction] += weight as f32;
                }
            }
            Self::Harmonics { .. } => fill(factors, &sphere::harmonics(towards)),
        }
    }
}

fn fill(factors: &mut [f32], values: &[f64]) {
    for (factor, &value) in factors.iter_mut().zip(values) {
        *factor = value as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view_region::ViewRegion;

    #[test]
    fn a_basis_has_as_many_factors_as_coefficients_and_they_are_finite() {
        let frame = ViewRegionFrame::new(&ViewRegion { low_m: [0.0; 3], high_m: [1.0; 3] }, [5.0, 9.0, 2.0]);
        let view_region = (0..=2).map(|degree| DirectionalBasis::ViewRegion { degree });
        let harmonics = (0..=3).map(|degree| DirectionalBasis::Harmonics { degree });
        for basis in view_region.chain(harmonics).chain([DirectionalBasis::Directions26]) {
            let mut factors = vec![f32::NAN; 99];
            basis.factors([0.48, -0.6, 0.64], Some((&frame, [5.0, 8.0, 2.0])), &mut factors);
            assert_eq!(factors.len(), basis.count(), "{}", basis.name());
            assert!(factors.iter().all(|factor| factor.is_finite()));
        }
    }

    #[test]
    fn without_a_frame_nothing_is_known_towards_a_view_region() {
        let mut factors = Vec::new();
        DirectionalBasis::ViewRegion { degree: 1 }.factors([0.0, 0.0, 1.0], None, &mut factors);
        assert_eq!(factors, [0.0; 3]);
    }
}
