//! Rows before they are coded.

use super::hidden::HiddenCells;
use super::view_region::ViewRegionMap;
use super::{BakedResponse, TestStroke};
use crate::compress::{CompressedRow, compress_row};
use rayon::prelude::*;
use squall_formats::haar::Haar;
use squall_formats::section::response::{Codec, DirectionalBasis, ResponseHead, ResponseRows};
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::Cloud;

/// Rows solved and Haar-transformed, not yet coded: what compression is tried on.
pub struct SolvedRows {
    /// Head of a response in these channels, coded by nothing yet.
    pub head: ResponseHead,
    /// Coefficients of every row, one plane a channel.
    pub planes: Vec<Vec<f32>>,
    /// Test strokes.
    pub tests: Vec<TestStroke>,
    /// Sweeps times sixteen lamps.
    pub sweeps: u64,
    /// What turns them into polynomials towards eyes; where there are eyes, and sixteen harmonics were solved for.
    pub(super) towards: Option<TowardsViewRegion>,
}

/// From sixteen harmonics to polynomials towards eyes, of each degree.
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
    /// The response that these rows make in `channels`, coded so that each source is off by at most `relative_error`, and what
    /// it keeps. Test strokes come along in the same channels.
    ///
    /// Panics when `channels` holds more than was solved for, or is towards eyes and no sixteen harmonics with eyes were.
    pub fn encode(&self, channels: DirectionalBasis, codec: Codec, relative_error: f64) -> BakedResponse {
        let cells = self.head.shape.len();
        let length = channels.count() * cells;
        // Rows that were solved towards eyes already are coded as they are.
        let towards = match (channels, &self.towards) {
            (DirectionalBasis::ViewRegion { degree }, Some(towards)) => Some((towards, degree)),
            (DirectionalBasis::ViewRegion { .. }, None) => {
                assert_eq!(channels, self.head.basis, "rows were solved without eyes");
                None
            }
            _ => None,
        };
        let code = |planes: &Vec<f32>| match towards {
            Some((towards, degree)) => {
                let planes = towards.coefficients(planes, degree);
                compress_row(&planes, channels.count(), codec, relative_error)
            }
            None => compress_row(&planes[..length], channels.count(), codec, relative_error),
        };
        let coded: Vec<CompressedRow> = self.planes.par_iter().map(code).collect();
        let (mut rows, mut kept) = (ResponseRows::default(), 0);
        for row in coded {
            kept += row.kept;
            rows.bounds.extend_from_slice(&row.bounds);
            rows.rows.push(row.bytes);
        }
        let cut = |test: &TestStroke| {
            let uncompressed = match towards {
                Some((towards, degree)) if !test.uncompressed.is_empty() => {
                    towards.light(&test.uncompressed, degree)
                }
                _ => test.uncompressed.iter().take(length).copied().collect(),
            };
            TestStroke { uncompressed, ..test.clone() }
        };
        BakedResponse {
            head: ResponseHead { basis: channels, codec, ..self.head.clone() },
            rows,
            tests: self.tests.iter().map(cut).collect(),
            kept,
            sweeps: self.sweeps,
        }
    }
}
