//! Whether an asset is whole: every checksum, every section through its own reader, every row of bulk decoded once.
//!
//! Opening an asset checks what it is about to use; this checks all of it, and takes one pass over the file.

use crate::error::RuntimeError;
use crate::load::Asset;
use squall_formats::container::Entry;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::density::DensitySection;
use squall_formats::section::provenance::ProvenanceSection;
use squall_formats::section::response::{ResponseSection, accumulate, channels};
use squall_formats::section::streak::StreakSection;
use squall_formats::section::town::TownSection;
use squall_formats::section::view::ViewSection;
use squall_formats::{GridShape, ReadError};

/// What a check looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Bytes of the file.
    pub bytes: u64,
    /// Sections read through their own readers.
    pub sections: usize,
    /// Optional sections of kinds unknown to this build, of which only the checksums were checked.
    pub unknown: usize,
    /// Rows of bulk data, each with a checksum of its own.
    pub rows: usize,
}

/// Checks every byte of `asset`.
///
/// Errors: the first section, in file order, that is damaged, of a newer version, or not what it should be.
pub fn verify(asset: &Asset) -> Result<Verified, RuntimeError> {
    asset.check_heads()?;
    let mut done = Verified { bytes: asset.bytes().len() as u64, ..Verified::default() };
    for entry in &asset.directory().entries {
        entry.check_whole(asset.bytes()).map_err(|error| asset.wrap(error))?;
        match read_section(asset, entry).map_err(|error| asset.wrap(error))? {
            Some(rows) => {
                done.sections += 1;
                done.rows += rows;
            }
            None => done.unknown += 1,
        }
    }
    Ok(done)
}

/// Reads one section whole. Number of its rows; `None` for a kind that this build does not know.
fn read_section(asset: &Asset, entry: &Entry) -> Result<Option<usize>, ReadError> {
    let (bytes, version, limits) = (entry.bytes(asset.bytes())?, entry.version, asset.limits());
    match entry.tag {
        BoltSection::TAG => drop(BoltSection::read(bytes, version, limits)?),
        DensitySection::TAG => drop(DensitySection::read(bytes, version, limits)?),
        ProvenanceSection::TAG => drop(ProvenanceSection::read(bytes, version, limits)?),
        TownSection::TAG => drop(TownSection::read(bytes, version, limits)?),
        StreakSection::TAG => drop(StreakSection::read(bytes, version, limits)?),
        ViewSection::TAG => drop(ViewSection::read(bytes, version, limits)?),
        CloudSection::TAG => {
            let cloud = CloudSection::read(bytes, version, limits)?;
            check_head_length(entry, size_of_val(cloud.extinction))?;
            cloud.check_values()?;
        }
        ResponseSection::TAG => {
            let response = ResponseSection::read(bytes, version, limits)?;
            check_head_length(entry, response.rows.len())?;
            check_grid(asset, response.head.shape)?;
            return decode_rows(&response).map(Some);
        }
        _ => return Ok(None),
    }
    // Sections without bulk are all head.
    if !matches!(entry.tag, CloudSection::TAG) {
        check_head_length(entry, 0)?;
    }
    Ok(Some(0))
}

/// The part checked on opening must reach to the bulk.
fn check_head_length(entry: &Entry, bulk: usize) -> Result<(), ReadError> {
    if entry.head_length == entry.length - bulk as u64 {
        return Ok(());
    }
    Err(ReadError::Invalid {
        section: entry.tag,
        offset: 0,
        field: "head length in the section table",
        wanted: "everything before the bulk",
        found: entry.head_length.to_string(),
    })
}

/// A response describes the cloud grid's cells, or blocks of them; so its size is bounded by bytes that are there.
fn check_grid(asset: &Asset, shape: GridShape) -> Result<(), ReadError> {
    let whole = match asset.directory().find(CloudSection::TAG) {
        Some(entry) => {
            CloudSection::read(entry.bytes(asset.bytes())?, entry.version, asset.limits())?.head.shape
        }
        None => GridShape::new(0, 0, 0),
    };
    let divides = |whole: u32, part: u32| whole >= part && whole.is_multiple_of(part);
    if divides(whole.nx, shape.nx) && divides(whole.ny, shape.ny) && divides(whole.nz, shape.nz) {
        return Ok(());
    }
    Err(ReadError::Invalid {
        section: ResponseSection::TAG,
        offset: 8,
        field: "shape",
        wanted: "one that divides the cloud grid's",
        found: format!("{shape:?} beside {whole:?}"),
    })
}

fn decode_rows(response: &ResponseSection<'_>) -> Result<usize, ReadError> {
    let cells = response.head.shape.checked_len().unwrap_or(0);
    let mut sums = vec![0.0f32; cells];
    for row in 0..response.row_count() {
        for channel in channels(response.row(row)?, response.head.channels.count())? {
            accumulate(&channel, response.head.codec, 1.0, &mut sums)?;
        }
    }
    Ok(response.row_count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::Tag;
    use squall_formats::container::{OutSection, write};
    use squall_formats::section::KNOWN;

    /// An asset of one optional section that holds three zeros.
    fn asset(tag: Tag) -> Asset {
        let mut bytes = Vec::new();
        write(&mut bytes, &[OutSection::small(tag, 1, false, vec![0; 3])]).unwrap();
        Asset::from_bytes(&bytes).unwrap()
    }

    #[test]
    fn every_known_section_is_read_and_an_unknown_one_is_counted() {
        for &tag in KNOWN {
            let error = verify(&asset(tag)).expect_err("three zeros are no section");
            assert!(error.to_string().contains(&format!("section {tag}")), "{error}");
        }
        let unknown = verify(&asset(Tag(*b"ELSE"))).unwrap();
        assert_eq!((unknown.sections, unknown.unknown), (0, 1));
    }
}
