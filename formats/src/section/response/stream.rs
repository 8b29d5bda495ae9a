//! A row's planes, one a coefficient of the directional basis, and what they are stored as, forward beside inverse. Bytes: SPEC.md, "CLRT".

use super::entropy::{EntropyRecord, EntropyTables, no_tables};
use super::head::{Codec, TAG, invalid};
use crate::error::ReadError;
use std::sync::Arc;

/// A row's plane of one basis coefficient, over all cells, as it lies in the file: its Haar transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoefficientPlane<'a> {
    /// Haar coefficient 0: the mean over cells times √cells.
    pub mean: f32,
    /// Value of a quantised 1.
    pub step: f32,
    /// The rest.
    pub stream: &'a [u8],
}

/// Bytes of a plane's fixed part: mean, step, stream length.
pub const COEFFICIENT_BYTES: usize = 12;
/// Stream value that announces an f32.
pub const ESCAPE: i8 = i8::MIN;
/// Largest value of a pair that is no escape.
const LARGEST_SMALL: f32 = 127.0;

/// Splits a row into its planes, one a coefficient of the basis. Errors: a row that ends early or has bytes left over.
pub fn coefficient_planes(row: &[u8], count: usize) -> Result<Vec<CoefficientPlane<'_>>, ReadError> {
    let short = |missing: usize| ReadError::Truncated {
        section: TAG,
        offset: row.len() as u64,
        missing: missing as u64,
    };
    // A count of the caller's may be any.
    let bytes = count.saturating_mul(COEFFICIENT_BYTES);
    let (fixed, mut rest) = row.split_at_checked(bytes).ok_or_else(|| short(bytes - row.len()))?;
    let mut out = Vec::with_capacity(count);
    for part in fixed.chunks_exact(COEFFICIENT_BYTES) {
        let word = |at: usize| [part[at], part[at + 1], part[at + 2], part[at + 3]];
        let (mean, step) = (f32::from_le_bytes(word(0)), f32::from_le_bytes(word(4)));
        let length = u32::from_le_bytes(word(8)) as usize;
        if !(mean.is_finite() && step >= 0.0 && (step * LARGEST_SMALL).is_finite()) {
            return Err(invalid(
                None,
                "mean and step of a plane",
                "finite, step from 0",
                format!("{mean}, {step}"),
            ));
        }
        let stream = rest.get(..length).ok_or_else(|| short(length - rest.len()))?;
        rest = &rest[length..];
        out.push(CoefficientPlane { mean, step, stream });
    }
    if !rest.is_empty() {
        return Err(invalid(None, "row", "no byte behind its last plane", format!("{} bytes", rest.len())));
    }
    Ok(out)
}

/// How rows are read: their codec, and what belongs to it.
#[derive(Clone, Debug)]
pub struct RowCode {
    codec: Codec,
    tables: Option<Arc<EntropyTables>>,
}

impl RowCode {
    /// That of a codec that needs nothing beside the rows. Rows of [`Codec::Entropy`] are refused by it.
    pub fn plain(codec: Codec) -> Self {
        Self { codec, tables: None }
    }

    /// That of a section whose grid has `cells`, with `row_bytes` bytes of rows.
    ///
    /// Errors: tables that are not sound.
    pub(super) fn new(
        codec: Codec,
        record: Option<&EntropyRecord>,
        cells: usize,
        row_bytes: u64,
    ) -> Result<Self, ReadError> {
        let tables = match (codec, record) {
            (Codec::Entropy, Some(record)) => Some(Arc::new(EntropyTables::new(record, cells, row_bytes)?)),
            (Codec::Entropy, None) => return Err(no_tables()),
            (Codec::Paper | Codec::Bytes, _) => None,
        };
        Ok(Self { codec, tables })
    }
}

/// A coefficient as it lies in a stream.
pub(super) enum Coefficient {
    /// So many of the plane's steps.
    Steps(i8),
    /// The value itself.
    Exact(f32),
}

/// Hands every coefficient of a stream and its index, below `cells`, to `each`.
///
/// The stream of codec `Bytes` is pairs (gap, value): the index moves on by gap + 1 from the one before, 0 at the start, and
/// the coefficient there is value × step; the value −128 says that an f32 follows and is the coefficient. A pair with
/// value 0 only moves on.
#[inline(always)]
pub(super) fn walk(
    plane: &CoefficientPlane<'_>,
    code: &RowCode,
    cells: usize,
    mut each: impl FnMut(usize, Coefficient),
) -> Result<(), ReadError> {
    let within = |index: usize| {
        let beyond = || invalid(None, "coefficient index", "below the number of cells", index.to_string());
        if index < cells { Ok(index) } else { Err(beyond()) }
    };
    let finite = |bytes: [u8; 4]| {
        let value = f32::from_le_bytes(bytes);
        let error = || invalid(None, "coefficient", "finite", value.to_string());
        if value.is_finite() { Ok(Coefficient::Exact(value)) } else { Err(error()) }
    };
    let broken = || invalid(None, "coefficient stream", "whole coefficients", "one cut off".into());
    within(0)?;
    match code.codec {
        Codec::Paper => {
            let (pairs, rest) = plane.stream.as_chunks::<8>();
            for pair in pairs {
                let index = u32::from_le_bytes([pair[0], pair[1], pair[2], pair[3]]) as usize;
                each(within(index)?, finite([pair[4], pair[5], pair[6], pair[7]])?);
            }
            if rest.is_empty() { Ok(()) } else { Err(broken()) }
        }
        Codec::Bytes => {
            let mut index = 0usize;
            let mut stream = plane.stream;
            while let [gap, value, rest @ ..] = stream {
                index = within(index + usize::from(*gap) + 1)?;
                stream = rest;
                let value = *value as i8;
                if value != ESCAPE {
                    each(index, Coefficient::Steps(value));
                } else if let [a, b, c, d, rest @ ..] = stream {
                    each(index, finite([*a, *b, *c, *d])?);
                    stream = rest;
                } else {
                    return Err(broken());
                }
            }
            if stream.is_empty() { Ok(()) } else { Err(broken()) }
        }
        Codec::Entropy => {
            let tables = code.tables.as_deref().ok_or_else(no_tables)?;
            tables.walk(plane.stream, cells, |index, coefficient| {
                if let Coefficient::Exact(value) = coefficient {
                    finite(value.to_le_bytes())?;
                }
                each(index, coefficient);
                Ok(())
            })
        }
    }
}

/// Adds `weight` times a plane's coefficients to `sums`, which has one place a cell.
///
/// Errors: an index beyond the grid, a coefficient that is not finite, or a stream that ends inside a pair.
#[inline]
pub fn accumulate(
    plane: &CoefficientPlane<'_>,
    code: &RowCode,
    weight: f32,
    sums: &mut [f32],
) -> Result<(), ReadError> {
    if let Some(sum) = sums.first_mut() {
        *sum += weight * plane.mean;
    }
    let scale = weight * plane.step;
    walk(plane, code, sums.len(), |index, coefficient| {
        sums[index] += match coefficient {
            Coefficient::Steps(steps) => scale * f32::from(steps),
            Coefficient::Exact(value) => weight * value,
        };
    })
}

/// Hands every coefficient of a plane but its first, the mean, to `each`: where it belongs, below `cells`, and its value.
///
/// Errors: those of [`accumulate`].
pub fn each_coefficient(
    plane: &CoefficientPlane<'_>,
    code: &RowCode,
    cells: usize,
    mut each: impl FnMut(usize, f32),
) -> Result<(), ReadError> {
    walk(plane, code, cells, |index, coefficient| {
        let value = match coefficient {
            Coefficient::Steps(steps) => plane.step * f32::from(steps),
            Coefficient::Exact(value) => value,
        };
        if value != 0.0 {
            each(index, value);
        }
    })
}

/// Whether a plane could be added to a grid of `cells`; the errors of [`accumulate`], without its work.
pub fn check_stream(plane: &CoefficientPlane<'_>, code: &RowCode, cells: usize) -> Result<(), ReadError> {
    walk(plane, code, cells, |_, _| ())
}

/// Puts a stream together; coefficients come in rising index, index 0 excluded.
#[derive(Clone, Debug, Default)]
pub struct StreamWriter {
    bytes: Vec<u8>,
    at: usize,
}

impl StreamWriter {
    fn move_to(&mut self, index: usize) -> u8 {
        let mut gap = index - self.at - 1;
        while gap > 255 {
            self.bytes.extend_from_slice(&[255, 0]);
            gap -= 256;
        }
        self.at = index;
        gap as u8
    }

    /// A coefficient of `value` steps, −127 to 127.
    pub fn small(&mut self, index: usize, value: i8) {
        let gap = self.move_to(index);
        self.bytes.extend_from_slice(&[gap, value as u8]);
    }

    /// A coefficient kept as it is.
    pub fn large(&mut self, index: usize, value: f32) {
        let gap = self.move_to(index);
        self.bytes.extend_from_slice(&[gap, ESCAPE as u8]);
        self.bytes.extend_from_slice(&value.to_le_bytes());
    }

    /// The stream so far, which is taken; the next coefficient starts a new one.
    pub fn take(&mut self) -> Vec<u8> {
        self.at = 0;
        std::mem::take(&mut self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELLS: usize = 2000;

    fn sums(stream: &[u8], codec: Codec, weight: f32) -> Result<Vec<f32>, ReadError> {
        let plane = CoefficientPlane { mean: 3.0, step: 0.5, stream };
        let mut sums = vec![0.0; CELLS];
        let code = RowCode::plain(codec);
        accumulate(&plane, &code, weight, &mut sums)?;
        check_stream(&plane, &code, CELLS)?;
        Ok(sums)
    }

    #[test]
    fn coefficients_come_back_where_and_as_they_were_written_whatever_the_gap() {
        // Gaps of one, of exactly one byte's range and just beyond it, and of several.
        let small = [(1, 1i8), (2, -127), (258, 127), (515, 5)];
        let large = [(1540, 1e9f32), (CELLS - 1, -0.125)];
        let mut writer = StreamWriter::default();
        small.iter().for_each(|&(index, value)| writer.small(index, value));
        large.iter().for_each(|&(index, value)| writer.large(index, value));
        let mut wanted = vec![0.0; CELLS];
        wanted[0] = 6.0;
        small.iter().for_each(|&(index, value)| wanted[index] = f32::from(value));
        large.iter().for_each(|&(index, value)| wanted[index] = 2.0 * value);
        assert_eq!(sums(&writer.take(), Codec::Bytes, 2.0).unwrap(), wanted);
    }

    #[test]
    fn a_stream_that_leaves_the_grid_ends_early_or_holds_no_number_is_refused() {
        let pair = |index: u32, value: f32| [index.to_le_bytes(), value.to_le_bytes()].concat();
        let escape = |value: f32| [&[0, ESCAPE as u8][..], &value.to_le_bytes()].concat();
        let nan = f32::NAN;
        let beyond = [255, 0].repeat(CELLS / 256 + 1);
        for (codec, field, stream) in [
            (Codec::Paper, "coefficient index", pair(CELLS as u32, 1.0)),
            (Codec::Paper, "coefficient index", pair(u32::MAX, 1.0)),
            (Codec::Paper, "coefficient", pair(7, nan)),
            (Codec::Paper, "coefficient stream", pair(7, 1.0)[..7].to_vec()),
            (Codec::Bytes, "coefficient index", beyond),
            (Codec::Bytes, "coefficient", escape(f32::INFINITY)),
            (Codec::Bytes, "coefficient stream", escape(1.0)[..5].to_vec()),
            (Codec::Bytes, "coefficient stream", vec![3]),
        ] {
            match sums(&stream, codec, 1.0) {
                Err(ReadError::Invalid { field: found, .. }) => assert_eq!(found, field),
                other => panic!("{field}: {other:?}"),
            }
        }
    }
}
