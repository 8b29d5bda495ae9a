//! Codecs from outside beside ours: a script codes the same rows, and what comes back is scored as ours is.
//!
//! The script (`data/peers/compress.py` is one) is called with `list`, and then with `code ID FOLDER` for each peer and error. Rows
//! go through files in a temporary folder:
//!
//! | file | by | holds |
//! |---|---|---|
//! | `task.json` | us | `shape` of a row (channels, z, y, x; x fastest), `rows`, `relative_l2` that each row may be off by, `repeats` |
//! | `rows.f32` | us | light in cells, not coefficients: little-endian f32, row after row |
//! | `back.f32` | script | the rows as they decode |
//! | `coded.json` | script | `bytes` of each row; `seconds` of processor time that decoding took, a list a repeat, or none |

mod exchange;

use super::compression::{BYTES, Sight, TIME, mean_errors, timed_sums};
use super::{Cost, Point};
use crate::error::BakeError;
use crate::evaluate::RelitError;
use crate::progress::Progress;
use crate::response::SolvedRows;
use exchange::{Coded, Exchange};
use serde::Deserialize;
use squall_formats::section::response::{self, ResponseRows};
use squall_runtime::relight::SourceWeight;
use std::path::{Path, PathBuf};

/// Relative L2 errors that rows are asked for, in a full sweep: fewer than ours, as each takes a search.
const ASKED: &[f64] = &[0.3, 0.1, 0.03, 0.01, 5e-3, 2e-3, 1e-3];
/// The same in a quick sweep.
const ASKED_QUICKLY: &[f64] = &[0.1, 0.01];

/// Times that each row's decoding is timed: it takes some milliseconds, far above what a clock resolves.
const DECODINGS: usize = 5;

/// A codec from outside, as the script names it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Peer {
    /// What the script knows it by.
    pub id: String,
    /// Name and version.
    pub name: String,
}

/// A script and the codecs that it has here.
#[derive(Clone, Debug)]
pub struct Peers {
    script: PathBuf,
    /// Those whose libraries are here.
    pub found: Vec<Peer>,
    /// Those whose libraries are not, in words.
    pub absent: Vec<String>,
}

impl Peers {
    /// Asks `script`, run by `python3`, which codecs it has.
    ///
    /// Errors: no such file, no `python3`, a script that fails or does not answer as agreed, an interruption.
    pub fn ask(script: &Path, progress: &dyn Progress) -> Result<Self, BakeError> {
        let (found, absent) = exchange::list(script, progress)?;
        Ok(Self { script: script.to_owned(), found, absent })
    }

    /// Points that a sweep of one kind of rows makes.
    pub(super) fn steps(&self, quick: bool) -> usize {
        self.found.len() * asked(quick).len()
    }

    /// Every peer's rows at every error, scored by the strokes of `solved`; `all` virtual lights would be stored.
    pub(super) fn sweep(
        &self,
        solved: &SolvedRows,
        sight: &Sight,
        (truth, all): (&str, usize),
        quick: bool,
        progress: &dyn Progress,
    ) -> Result<Vec<Point>, BakeError> {
        if self.found.is_empty() || solved.planes.is_empty() {
            return Ok(Vec::new());
        }
        let evaluate = Evaluate::new(solved, sight)?;
        let exchange = Exchange::new(&self.script, solved)?;
        let mut points = Vec::new();
        for peer in &self.found {
            for &error in asked(quick) {
                progress.check()?;
                let coded = exchange.code(peer, error, DECODINGS, progress)?;
                let mut sums = evaluate.sums();
                exchange.read_back(peer, |row, values| evaluate.add(&mut sums, row, values))?;
                points.push(evaluate.point(peer, error, &coded, &sums, (truth, all)));
                progress.advance(1);
            }
        }
        Ok(points)
    }
}

fn asked(quick: bool) -> &'static [f64] {
    if quick { ASKED_QUICKLY } else { ASKED }
}

/// Strokes as sums over rows of light in cells.
struct Evaluate<'a> {
    solved: &'a SolvedRows,
    /// From where they are compared.
    sight: &'a Sight,
    /// Rows and weights of each stroke.
    weights: Vec<Vec<SourceWeight>>,
    /// Seconds that adding up a stroke's rows takes once they are decoded, a mean over strokes.
    adding: Cost,
    /// Bytes of a section around its rows: head and index. Bounds are left out, which only our codecs store.
    around: u64,
}

impl<'a> Evaluate<'a> {
    fn new(solved: &'a SolvedRows, sight: &'a Sight) -> Result<Self, BakeError> {
        let (weights, adding) = timed_sums(solved)?;
        let rows = &solved.planes;
        let empty = ResponseRows { rows: vec![Vec::new(); rows.len()], bounds: Vec::new() };
        let around = response::write(&solved.head, empty).length();
        Ok(Self { solved, sight, weights, adding, around })
    }

    /// One plane a channel and stroke, nothing in it yet.
    fn sums(&self) -> Vec<Vec<f32>> {
        let length = self.solved.planes.first().map_or(0, Vec::len);
        vec![vec![0.0; length]; self.weights.len()]
    }

    /// Adds a row to the strokes that touch it. Rows have to come in order, for sums to be rounded as those of our own.
    fn add(&self, sums: &mut [Vec<f32>], row: usize, values: &[f32]) {
        for (sum, weights) in sums.iter_mut().zip(&self.weights) {
            let Some(weight) = weights.iter().find(|weight| weight.row as usize == row) else { continue };
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight.intensity * value);
        }
    }

    /// Errors of the strokes' sums, the root mean square (L2) or the mean (tail, median) over strokes.
    fn errors(&self, sums: &[Vec<f32>]) -> Vec<(&'static str, f64)> {
        let each: Vec<RelitError> = sums
            .iter()
            .zip(&self.solved.held_out)
            .map(|(sum, stroke)| self.sight.errors(self.solved.head.basis, sum, &stroke.uncompressed))
            .collect();
        mean_errors(&each)
    }

    /// Seconds of a stroke: its rows decoded whole and added up. None where the script took no times.
    fn time(&self, coded: &Coded) -> Option<Cost> {
        if coded.seconds.is_empty() {
            return None;
        }
        let of_all = |times: &Vec<f64>| -> f64 {
            self.weights.iter().flatten().map(|weight| times[weight.row as usize]).sum()
        };
        let strokes = self.weights.len().max(1) as f64;
        let decoding = Cost::of(coded.seconds.iter().map(|times| of_all(times) / strokes).collect());
        Some(Cost {
            median: decoding.median + self.adding.median,
            p10: decoding.p10 + self.adding.p10,
            p90: decoding.p90 + self.adding.p90,
        })
    }

    fn point(
        &self,
        peer: &Peer,
        error: f64,
        coded: &Coded,
        sums: &[Vec<f32>],
        (truth, all): (&str, usize),
    ) -> Point {
        let rows = coded.bytes.len() as f64;
        let bytes = coded.bytes.iter().map(|&bytes| bytes as f64).sum::<f64>() + self.around as f64;
        let mut costs = vec![(BYTES, Cost::exact(bytes / rows))];
        costs.extend(self.time(coded).map(|cost| (TIME, cost.times(1e6))));
        Point {
            series: peer.name.clone(),
            setting: format!("{}, asked {error:e}; rows decoded whole, then added", peer.name),
            truth: truth.into(),
            errors: self.errors(sums),
            costs,
            bytes: Some((bytes * all as f64 / rows) as u64),
            chosen: false,
            baseline: false,
        }
    }
}
