//! Light in 26 directions and its harmonics.

use squall_formats::section::response::DirectionalBasis;
use squall_formats::sphere::{self, MAX_HARMONICS};

/// Adds `factor` times direct light, given in the 26 directions, to planes of `basis`; harmonics take its projection, which the set's
/// degree of 7 makes exact as far as the harmonics reach. A basis towards a view region never holds any.
pub fn add_direct(basis: DirectionalBasis, towards: &[f32], factor: f32, planes: &mut [f32]) {
    let cells = towards.len() / 26;
    let (directions, weights) = (sphere::directions_26(), sphere::weights_26());
    for (cell, values) in towards.chunks_exact(26).enumerate() {
        match basis {
            DirectionalBasis::Directions26 => {
                for (plane, value) in values.iter().enumerate() {
                    planes[plane * cells + cell] += factor * value;
                }
            }
            DirectionalBasis::ViewRegion { .. } => {}
            DirectionalBasis::Harmonics { .. } => {
                for (d, value) in values.iter().enumerate() {
                    let harmonics = sphere::harmonics(directions[d]);
                    let weight = 4.0 * std::f64::consts::PI * weights[d];
                    for plane in 0..basis.count() {
                        planes[plane * cells + cell] += factor * ((weight * harmonics[plane]) as f32 * value);
                    }
                }
            }
        }
    }
}

/// Harmonic coefficients, 16 a cell, to values in the 26 directions, 26 a cell.
pub fn in_26_directions(coefficients: &[f32]) -> Vec<f32> {
    let basis: Vec<[f32; MAX_HARMONICS]> =
        sphere::directions_26().iter().map(|&d| sphere::harmonics(d).map(|v| v as f32)).collect();
    let mut out = Vec::with_capacity(coefficients.len() / MAX_HARMONICS * 26);
    for values in coefficients.chunks_exact(MAX_HARMONICS) {
        out.extend(basis.iter().map(|b| b.iter().zip(values).map(|(x, y)| x * y).sum::<f32>()));
    }
    out
}
