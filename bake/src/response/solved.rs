//! Rows before they are coded.

use super::{BakedResponse, TestStroke};
use crate::compress::{CompressedRow, compress_row};
use rayon::prelude::*;
use squall_formats::section::response::{ChannelBasis, Codec, ResponseHead, ResponseRows};

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
}

impl SolvedRows {
    /// The response that these rows make in `channels`, coded so that each source is off by at most `relative_error`, and what
    /// it keeps. Test strokes come along in the same channels.
    ///
    /// Panics when `channels` holds more than was solved for.
    pub fn encode(&self, channels: ChannelBasis, codec: Codec, relative_error: f64) -> BakedResponse {
        let cells = self.head.shape.len();
        let length = channels.count() * cells;
        let code =
            |planes: &Vec<f32>| compress_row(&planes[..length], channels.count(), codec, relative_error);
        let coded: Vec<CompressedRow> = self.planes.par_iter().map(code).collect();
        let (mut rows, mut kept) = (ResponseRows::default(), 0);
        for row in coded {
            kept += row.kept;
            rows.bounds.extend_from_slice(&row.bounds);
            rows.rows.push(row.bytes);
        }
        let cut = |test: &TestStroke| {
            let uncompressed = test.uncompressed.iter().take(length).copied().collect();
            TestStroke { uncompressed, ..test.clone() }
        };
        BakedResponse {
            head: ResponseHead { channels, codec, ..self.head.clone() },
            rows,
            tests: self.tests.iter().map(cut).collect(),
            kept,
            sweeps: self.sweeps,
        }
    }
}
