//! An asset's response without a borrow of the asset: what its rows mean, and where each lies in the asset's bytes.

use crate::error::RuntimeError;
use crate::load::Asset;
use squall_formats::section::response::{
    CoefficientBound, ResponseHead, ResponseSection, RowEntry, blocks_of, checked_row, row_bytes,
};
use squall_formats::{GridShape, ReadError};
use std::ops::Range;

/// An asset's response: heads are parsed once, rows are read where they lie.
pub struct Response {
    asset: Asset,
    /// Version that the section was written in.
    pub version: u16,
    /// What the rows mean.
    pub head: ResponseHead,
    /// One entry a row.
    pub index: Vec<RowEntry>,
    /// One bound a row and coefficient, coefficients innermost.
    pub bounds: Vec<CoefficientBound>,
    /// Where all rows lie in the asset's bytes.
    rows: Range<usize>,
}

impl Response {
    /// Reads the head. Errors: the asset has no response, or a damaged one.
    pub(super) fn new(asset: &Asset) -> Result<Self, RuntimeError> {
        let section = asset.section(ResponseSection::TAG, "the cloud's response", ResponseSection::read)?;
        // A section that was just read is in the directory; rows are its end.
        let end = asset.directory().find(ResponseSection::TAG).map_or(0, |entry| entry.offset + entry.length);
        let rows = (end as usize).saturating_sub(section.rows.len())..end as usize;
        let (index, bounds) = (section.index.to_vec(), section.bounds.to_vec());
        Ok(Self { asset: asset.clone(), version: section.version, head: section.head, index, bounds, rows })
    }

    /// Cells of a cloud grid of shape `cloud` in a cell of the rows, along x, y and z.
    ///
    /// Errors: as [`squall_formats::section::response::blocks_of`].
    pub(super) fn blocks(&self, cloud: GridShape) -> Result<[u32; 3], ReadError> {
        blocks_of(self.head.shape, cloud)
    }

    /// Number of rows: virtual point lights and distant lights.
    pub fn row_count(&self) -> usize {
        self.index.len()
    }

    /// Has rows `wanted` in memory, of an asset that is read piece by piece; of others they are.
    ///
    /// Errors: they cannot be read, or nobody reads them ([`RuntimeError::NotFetched`]).
    pub(crate) fn fetch(&self, wanted: impl Iterator<Item = usize>) -> Result<(), RuntimeError> {
        self.asset.fetch_rows((&self.index, self.rows.len()), wanted)
    }

    /// The bytes of row `row` with their checksum verified.
    ///
    /// Errors: the row is damaged, cannot be read, or there is none of this number.
    pub fn row(&self, row: usize) -> Result<&[u8], RuntimeError> {
        if self.asset.range_rows().is_some() {
            return self.row_unchecked(row);
        }
        checked_row(&self.index, self.rows(), row).map_err(|error| self.asset.wrap(error))
    }

    /// The bytes of row `row`, for a reader that has verified it before.
    ///
    /// Errors: it cannot be read, or there is none of this number.
    pub fn row_unchecked(&self, row: usize) -> Result<&[u8], RuntimeError> {
        let wrap = |error| self.asset.wrap(error);
        let Some(fetched) = self.asset.range_rows().filter(|_| row < self.index.len()) else {
            return row_bytes(&self.index, self.rows(), row).map_err(wrap);
        };
        // Every row is checked as it comes.
        self.fetch(std::iter::once(row))?;
        let lacking = || RuntimeError::NotFetched { path: self.asset.path().to_owned(), ranges: Vec::new() };
        fetched.row(row, self.index.len()).ok_or_else(lacking)
    }

    /// All rows, of an asset that is here whole.
    fn rows(&self) -> &[u8] {
        self.asset.bytes().get(self.rows.clone()).unwrap_or_default()
    }

    /// Bounds of row `row`, one a coefficient.
    pub fn bounds_of(&self, row: usize) -> &[CoefficientBound] {
        let coefficients = self.head.basis.count();
        self.bounds.get(row * coefficients..(row + 1) * coefficients).unwrap_or_default()
    }
}
