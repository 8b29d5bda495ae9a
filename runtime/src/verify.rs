//! Whether an asset is whole: every checksum, every section through its own reader, every row of bulk decoded once.
//!
//! Opening an asset checks what it is about to use; this checks all of it, and takes one pass over the file.

use crate::error::RuntimeError;
use crate::load::Asset;
use crate::stroke::{flashing, grow_together};
use squall_formats::container::Entry;
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::check::check;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::response::ResponseSection;
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
/// Errors: the first section, in file order, that is damaged, of a newer version, or not what it should be; an asset that is
/// read piece by piece.
pub fn verify(asset: &Asset) -> Result<Verified, RuntimeError> {
    asset.check_is_whole()?;
    asset.check_heads()?;
    check_flashes(asset)?;
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

/// What a picture of the asset's own view would ask of its strokes: that they are there, and their segments in sum.
fn check_flashes(asset: &Asset) -> Result<(), RuntimeError> {
    let has = |tag| asset.directory().find(tag).is_some();
    if !has(ViewSection::TAG) {
        return Ok(());
    }
    let view = asset.section(ViewSection::TAG, "the view", ViewSection::read)?;
    let strokes = match has(BoltSection::TAG) {
        true => asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?.strokes,
        false => Vec::new(),
    };
    let unknown = |name: &str| ReadError::Invalid {
        section: ViewSection::TAG,
        offset: None,
        field: "flashes.stroke",
        wanted: "the name of a stroke of section BOLT",
        found: name.to_owned(),
    };
    flashing(&view.flashes, &strokes)
        .map_err(unknown)
        .and_then(|lit| grow_together(lit.iter().map(|&(record, _)| record), asset.limits()))
        .map_err(|error| asset.wrap(error))
        .map(drop)
}

/// Reads one section whole. Number of its rows; `None` for a kind that this build does not know.
fn read_section(asset: &Asset, entry: &Entry) -> Result<Option<usize>, ReadError> {
    let bytes = entry.bytes(asset.bytes())?;
    let Some(checked) = check(entry.tag, bytes, entry.version, asset.limits())? else { return Ok(None) };
    // What opening checks must reach to the bulk.
    if entry.head_length != entry.length - checked.bulk_bytes {
        return Err(ReadError::Invalid {
            section: entry.tag,
            offset: None,
            field: "head length in the section table",
            wanted: "everything before the bulk",
            found: entry.head_length.to_string(),
        });
    }
    if entry.tag == ResponseSection::TAG {
        let response = ResponseSection::read(bytes, entry.version, asset.limits())?;
        response.check_grid(cloud_shape(asset)?)?;
    }
    Ok(Some(checked.rows))
}

/// Shape of the cloud grid that a response stands beside.
fn cloud_shape(asset: &Asset) -> Result<GridShape, ReadError> {
    let missing =
        ReadError::Missing { section: CloudSection::TAG, holds: "the grid that section CLRT lights" };
    let entry = asset.directory().find(CloudSection::TAG).ok_or(missing)?;
    Ok(CloudSection::read(entry.bytes(asset.bytes())?, entry.version, asset.limits())?.head.shape)
}

#[cfg(test)]
mod tests {
    use super::*;
    use squall_formats::Tag;
    use squall_formats::container::{OutSection, write};

    #[test]
    fn a_section_of_unknown_kind_is_counted_apart() {
        let mut bytes = Vec::new();
        write(&mut bytes, &[OutSection::small(Tag(*b"ELSE"), 1, false, vec![0; 3])]).unwrap();
        let done = verify(&Asset::from_bytes(&bytes).unwrap()).unwrap();
        assert_eq!(done, Verified { bytes: 131, sections: 0, unknown: 1, rows: 0 });
    }
}
