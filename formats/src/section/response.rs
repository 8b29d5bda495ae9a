//! `CLRT` v5: what a cloud does with the light of virtual sources. Bytes: SPEC.md, "CLRT".
//!
//! A row belongs to one virtual source and holds, per coefficient of a directional basis, the Haar transform of the cloud's
//! answer to a source of unit strength: of in-scattered radiance J ([`crate::basis`]). Rows are contiguous and found through
//! an index, so that a reader touches only the sources that a stroke needs.

mod entropy;
mod finer;
mod head;
mod stream;
mod sun;

pub use crate::basis::DirectionalBasis;
pub use entropy::EntropyRecord;
pub use finer::{FinerLevel, MOST_LEVELS, Window};
pub use head::{
    Codec, DirectTerm, DistantKind, DistantSource, NO_ROW, ResponseHead, SolverRecord, SourceBasis, Stored,
    SweepScheme, pack_seen,
};
pub use stream::{
    COEFFICIENT_BYTES, CoefficientPlane, ESCAPE, RowCode, StreamWriter, accumulate, check_stream,
    coefficient_planes, each_coefficient,
};

pub use sun::{SUN_TOLERANCE_RAD, SunDirections, towards_sun};

use crate::container::{OutSection, checksum};
use crate::error::{Limits, ReadError};
use crate::grid::GridShape;
use crate::meta::{check_version, join_head, split_head};
use crate::tag::Tag;
use head::invalid;

/// Where a row lies, and how far it may be off.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct RowEntry {
    /// Start, from the first row's.
    pub offset: u64,
    /// Length, bytes.
    pub length: u32,
    /// CRC-32 of the row.
    pub checksum: u32,
}

/// How far a stored coefficient of a source of unit strength is from what was solved, as an L2 norm over cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct CoefficientBound {
    /// γ of \[dobashi\] §6: root of the sum of squares of the coefficients left out.
    pub discarded: f32,
    /// Root of the sum of squares of what quantising changed in those that were kept.
    pub quantised: f32,
}

impl CoefficientBound {
    /// γ + q.
    pub fn total(self) -> f32 {
        self.discarded + self.quantised
    }
}

/// A cloud response: a view into the asset's bytes.
#[derive(Clone, Debug)]
pub struct ResponseSection<'a> {
    /// Version that it was written in.
    pub version: u16,
    /// What the rows mean.
    pub head: ResponseHead,
    /// One entry a row.
    pub index: &'a [RowEntry],
    /// One bound a row and coefficient, coefficients innermost.
    pub bounds: &'a [CoefficientBound],
    /// All rows.
    pub rows: &'a [u8],
    /// How they are read.
    pub code: RowCode,
}

impl<'a> ResponseSection<'a> {
    /// The section's tag.
    pub const TAG: Tag = head::TAG;
    /// The newest version that this build reads. It writes the oldest that can say what there is to say: 2, 3 with a sun or with light
    /// on blocks of cells, 4 with finer levels of virtual lights or codec `Entropy`, 5 with fitted light.
    pub const VERSION: u16 = 5;

    /// Reads head, index and bounds, and views the rows; those are bulk, each with a checksum of its own.
    pub fn read(bytes: &'a [u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let (record, rest) = split_head(Self::TAG, bytes)?;
        let (head, count) = ResponseHead::read(record, version, limits)?;
        let coefficients = head.basis.count();
        // Where what follows the metadata begins in the section.
        let start = (bytes.len() - rest.len()) as u64;
        // In 64 bits: on a 32-bit machine a hostile count could wrap around.
        let index_bytes = count as u64 * size_of::<RowEntry>() as u64;
        let bounds_bytes = count as u64 * coefficients as u64 * size_of::<CoefficientBound>() as u64;
        let rows_start = (index_bytes + bounds_bytes).next_multiple_of(64);
        if (rest.len() as u64) < rows_start {
            let missing = rows_start - rest.len() as u64;
            return Err(ReadError::Truncated { section: Self::TAG, offset: bytes.len() as u64, missing });
        }
        let [index_bytes, bounds_bytes, rows_start] =
            [index_bytes, bounds_bytes, rows_start].map(|length| length as usize);
        let cast = |error: bytemuck::PodCastError| {
            invalid(Some(start), "index", "an aligned array", error.to_string())
        };
        let index: &[RowEntry] = bytemuck::try_cast_slice(&rest[..index_bytes]).map_err(cast)?;
        let bounds: &[CoefficientBound] =
            bytemuck::try_cast_slice(&rest[index_bytes..index_bytes + bounds_bytes]).map_err(cast)?;
        let padding = &rest[index_bytes + bounds_bytes..rows_start];
        if let Some(at) = padding.iter().position(|&b| b != 0) {
            let offset = start + (index_bytes + bounds_bytes + at) as u64;
            return Err(invalid(Some(offset), "padding before the rows", "zero", padding[at].to_string()));
        }
        let rows = &rest[rows_start..];
        check_index(index, rows, start)?;
        let sound = |b: &CoefficientBound| b.total().is_finite() && b.discarded >= 0.0 && b.quantised >= 0.0;
        if let Some(at) = bounds.iter().position(|bound| !sound(bound)) {
            let offset = start + (index_bytes + at * size_of::<CoefficientBound>()) as u64;
            let found = format!("{} and {}", bounds[at].discarded, bounds[at].quantised);
            return Err(invalid(Some(offset), "error bounds", "finite and not negative", found));
        }
        let code = RowCode::new(head.codec, head.entropy.as_ref(), head.shape.len(), rows.len() as u64)?;
        Ok(Self { version, head, index, bounds, rows, code })
    }

    /// Number of virtual sources.
    pub fn row_count(&self) -> usize {
        self.index.len()
    }

    /// Length of section bytes that are checked on opening: everything before the rows.
    pub fn head_length(&self, section_length: u64) -> u64 {
        section_length - self.rows.len() as u64
    }

    /// The bytes of row `row` with their checksum verified.
    pub fn row(&self, row: usize) -> Result<&'a [u8], ReadError> {
        checked_row(self.index, self.rows, row)
    }

    /// Verifies `bytes`, which came apart from the section, to be row `row` of `index`.
    pub fn check_row(index: &[RowEntry], row: usize, bytes: &[u8]) -> Result<(), ReadError> {
        same_checksum(index[row].checksum, checksum(bytes), row)
    }

    /// The bytes of row `row`, for a reader that has verified it before.
    pub fn row_unchecked(&self, row: usize) -> Result<&'a [u8], ReadError> {
        row_bytes(self.index, self.rows, row)
    }

    /// Bounds of row `row`, one a coefficient.
    pub fn bounds_of(&self, row: usize) -> &'a [CoefficientBound] {
        let coefficients = self.head.basis.count();
        self.bounds.get(row * coefficients..(row + 1) * coefficients).unwrap_or_default()
    }

    /// Checks that the rows describe cells of the asset's cloud grid, or equal blocks of them: [`blocks_of`].
    ///
    /// Errors: another shape.
    pub fn check_grid(&self, cloud: GridShape) -> Result<(), ReadError> {
        blocks_of(self.head.shape, cloud).map(drop)
    }
}

/// Cells of the asset's cloud grid, whose shape is `cloud`, along x, y and z in a cell of rows of the shape `response`.
///
/// Errors: blocks that are not all of the same whole number of cells.
pub fn blocks_of(response: GridShape, cloud: GridShape) -> Result<[u32; 3], ReadError> {
    let (light, cells) = (response.to_array(), cloud.to_array());
    if (0..3).all(|axis| light[axis] > 0 && cells[axis] > 0 && cells[axis].is_multiple_of(light[axis])) {
        return Ok([0, 1, 2].map(|axis: usize| (cells[axis] / light[axis]) as u32));
    }
    let [nx, ny, nz] = response.to_array();
    let [cx, cy, cz] = cloud.to_array();
    let found = format!("{nx} × {ny} × {nz} cells beside {cx} × {cy} × {cz} of section CLDG");
    Err(invalid(None, "shape", "the cloud grid's, or that of equal blocks of its cells", found))
}

/// The bytes of row `row` among all `rows`, unchecked. Errors: no such row.
pub fn row_bytes<'a>(index: &[RowEntry], rows: &'a [u8], row: usize) -> Result<&'a [u8], ReadError> {
    let entry = index.get(row).ok_or_else(|| invalid(None, "row", "below the row count", row.to_string()))?;
    let start = entry.offset as usize;
    rows.get(start..start + entry.length as usize).ok_or(ReadError::Truncated {
        section: ResponseSection::TAG,
        offset: entry.offset,
        missing: u64::from(entry.length),
    })
}

/// The same with the row's checksum verified. Errors: no such row, or a damaged one.
pub fn checked_row<'a>(index: &[RowEntry], rows: &'a [u8], row: usize) -> Result<&'a [u8], ReadError> {
    let bytes = row_bytes(index, rows, row)?;
    same_checksum(index[row].checksum, checksum(bytes), row)?;
    Ok(bytes)
}

fn same_checksum(wanted: u32, found: u32, row: usize) -> Result<(), ReadError> {
    if wanted != found {
        let part = format!("row {row}");
        return Err(ReadError::Checksum { section: ResponseSection::TAG, part, wanted, found });
    }
    Ok(())
}

/// Rows follow each other without gap or overlap and fill the section.
fn check_index(index: &[RowEntry], rows: &[u8], start: u64) -> Result<(), ReadError> {
    let mut end = 0u64;
    for (row, entry) in index.iter().enumerate() {
        if entry.offset != end {
            let offset = start + (row * size_of::<RowEntry>()) as u64;
            let wanted = "the end of the row before";
            return Err(invalid(Some(offset), "row offset", wanted, entry.offset.to_string()));
        }
        end = end.saturating_add(u64::from(entry.length));
    }
    if end == rows.len() as u64 {
        return Ok(());
    }
    let found = format!("{} bytes for {end}", rows.len());
    Err(invalid(Some(start), "rows", "as long as the index says", found))
}

/// Rows gathered for writing.
#[derive(Clone, Debug, Default)]
pub struct ResponseRows {
    /// One a source, in row order.
    pub rows: Vec<Vec<u8>>,
    /// One a row and coefficient.
    pub bounds: Vec<CoefficientBound>,
}

/// The section's bytes. `rows` lie as codec `Paper` or `Bytes` has them; with codec `Entropy` they come as `Bytes` and are coded here,
/// where that is shorter, else left so.
pub fn write(head: &ResponseHead, rows: ResponseRows) -> OutSection {
    write_beside(head, rows, head.shape)
}

/// [`write()`] beside a cloud grid of shape `cloud`, blocks of whose cells the rows may describe.
pub fn write_beside(head: &ResponseHead, mut rows: ResponseRows, cloud: GridShape) -> OutSection {
    let mut head = head.clone();
    if head.codec == Codec::Entropy {
        let size = (head.shape.len(), head.basis.count());
        let cells: Vec<usize> = (0..rows.rows.len()).map(|row| head.row_cells(row as u32)).collect();
        match entropy::transcoded(&rows.rows, &|row| cells[row], size) {
            Some((record, coded)) => {
                head.entropy = Some(record);
                rows.rows = coded;
            }
            None => head.codec = Codec::Bytes,
        }
    }
    let version = head.version(cloud != head.shape);
    let mut front = join_head(&head.encode(version));
    let start = front.len();
    let mut offset = 0u64;
    for row in &rows.rows {
        let entry = RowEntry { offset, length: row.len() as u32, checksum: checksum(row) };
        front.extend_from_slice(bytemuck::bytes_of(&entry));
        offset += row.len() as u64;
    }
    front.extend_from_slice(bytemuck::cast_slice(&rows.bounds));
    front.resize(start + (front.len() - start).next_multiple_of(64), 0);
    let head_length = front.len() as u64;
    let mut parts = vec![front];
    parts.extend(rows.rows);
    OutSection { tag: ResponseSection::TAG, version, required: true, head_length, parts }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_without_cells_and_rows_of_endless_planes_are_refused() {
        let [none, some] = [GridShape::new(0, 1, 1), GridShape::new(4, 1, 1)];
        for (light, cloud) in [(none, none), (none, some), (some, none)] {
            assert!(blocks_of(light, cloud).is_err(), "{light:?} {cloud:?}");
        }
        assert_eq!(blocks_of(GridShape::new(2, 1, 1), some).unwrap(), [2, 1, 1]);
        for count in [1, usize::MAX / 2, usize::MAX] {
            assert!(
                matches!(coefficient_planes(&[0; 5], count), Err(ReadError::Truncated { .. })),
                "{count}"
            );
        }
    }
}
