//! Rows before they are coded.

use super::hidden::HiddenCells;
use super::job::{BakedResponse, HeldOutStroke};
use super::region::ViewRegionMap;
use crate::compress::{CompressedRow, PlaneWeights, compress_row, compress_weighted_row};
use rayon::prelude::*;
use squall_formats::haar::Haar;
use squall_formats::section::response::{Codec, DirectionalBasis, ResponseHead, ResponseRows};
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::Cloud;

/// Rows solved and Haar-transformed, not yet coded: what compression is tried on.
pub struct SolvedRows {
    /// Head of a response in this basis, coded by nothing yet.
    pub head: ResponseHead,
    /// Coefficients of every row, one plane each.
    pub planes: Vec<Vec<f32>>,
    /// Held-out strokes.
    pub held_out: Vec<HeldOutStroke>,
    /// Sweeps times sixteen lights.
    pub sweeps: u64,
    /// What errors count for in the basis that was solved for.
    pub(super) weights: PlaneWeights,
    /// What turns them into polynomials towards the view region, where there is one and sixteen harmonics were solved for.
    pub(super) towards: Option<TowardsViewRegion>,
}

/// From sixteen harmonics to polynomials towards a view region, of each degree.
pub(super) struct TowardsViewRegion {
    maps: [ViewRegionMap; 3],
    hidden: Option<HiddenCells>,
    haar: Haar,
}

impl TowardsViewRegion {
    /// `head` says which cells the rows hold light for.
    pub(super) fn new(cloud: &Cloud, view_region: &ViewRegion, head: &ResponseHead) -> Self {
        let seen = head
            .seen
            .as_ref()
            .map(|_| (0..cloud.shape.len()).map(|cell| head.sees(cell)).collect::<Vec<_>>());
        Self {
            maps: [0, 1, 2].map(|degree| ViewRegionMap::new(cloud, view_region, degree, seen.as_deref())),
            hidden: seen.and_then(|seen| HiddenCells::of(cloud.shape, seen)),
            haar: Haar::new(cloud.shape),
        }
    }

    /// Planes of light, cells that nobody reads filled.
    fn light(&self, harmonics: &[f32], degree: u8) -> Vec<f32> {
        let mut planes = self.maps[usize::from(degree)].apply(harmonics);
        if let Some(hidden) = &self.hidden {
            planes.chunks_exact_mut(self.haar.len()).for_each(|plane| hidden.fill(plane));
        }
        planes
    }

    /// Planes of coefficients, from such planes.
    fn coefficients(&self, harmonics: &[f32], degree: u8) -> Vec<f32> {
        let (mut light, mut scratch) = (harmonics.to_vec(), Vec::new());
        light.chunks_exact_mut(self.haar.len()).for_each(|plane| self.haar.inverse(plane, &mut scratch));
        let mut planes = self.light(&light, degree);
        planes.chunks_exact_mut(self.haar.len()).for_each(|plane| self.haar.forward(plane, &mut scratch));
        planes
    }
}

impl SolvedRows {
    /// The response that these rows make in `basis`, coded so that each source is off by at most `relative_error`, and what
    /// it keeps. Held-out strokes come along in the same basis.
    ///
    /// Panics when `basis` holds more than was solved for, or is towards a view region and no sixteen harmonics with one were.
    pub fn encode(&self, basis: DirectionalBasis, codec: Codec, relative_error: f64) -> BakedResponse {
        let cells = self.head.shape.len();
        let length = basis.count() * cells;
        // Rows that were solved towards a view region already are coded as they are.
        let towards = match (basis, &self.towards) {
            (DirectionalBasis::ViewRegion { degree }, Some(towards)) => Some((towards, degree)),
            (DirectionalBasis::ViewRegion { .. }, None) => {
                assert_eq!(basis, self.head.basis, "rows were solved without a view region");
                None
            }
            _ => None,
        };
        let code = |planes: &Vec<f32>| match towards {
            Some((towards, degree)) => {
                let planes = towards.coefficients(planes, degree);
                compress_row(&planes, basis.count(), codec, relative_error)
            }
            None => {
                let planes = &planes[..length];
                // Gathers read harmonics of degree 1.
                match basis {
                    DirectionalBasis::Harmonics { degree: 1 } => {
                        compress_weighted_row(planes, &self.weights, basis.count(), codec, relative_error)
                    }
                    _ => compress_row(planes, basis.count(), codec, relative_error),
                }
            }
        };
        let coded: Vec<CompressedRow> = self.planes.par_iter().map(code).collect();
        let (mut rows, mut kept) = (ResponseRows::default(), 0);
        for row in coded {
            kept += row.kept;
            rows.bounds.extend_from_slice(&row.bounds);
            rows.rows.push(row.bytes);
        }
        let cut = |stroke: &HeldOutStroke| {
            let uncompressed = match towards {
                Some((towards, degree)) if !stroke.uncompressed.is_empty() => {
                    towards.light(&stroke.uncompressed, degree)
                }
                _ => stroke.uncompressed.iter().take(length).copied().collect(),
            };
            HeldOutStroke { uncompressed, ..stroke.clone() }
        };
        BakedResponse {
            head: ResponseHead { basis, codec, ..self.head.clone() },
            rows,
            held_out: self.held_out.iter().map(cut).collect(),
            kept,
            sweeps: self.sweeps,
        }
    }
}
