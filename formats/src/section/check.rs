//! Reads a section of any kind whole, for those who want to know that it is sound rather than what it says.

use super::bolt::BoltSection;
use super::cloud::CloudSection;
use super::density::DensitySection;
use super::place::PlaceSection;
use super::provenance::ProvenanceSection;
use super::rain_place::RainPlaceSection;
use super::response::{ResponseSection, check_stream, coefficient_planes};
use super::streak::StreakSection;
use super::town::TownSection;
use super::view::ViewSection;
use super::wet_maps::WetMapsSection;
use super::{Tag, is_known};
use crate::error::{Limits, ReadError};

/// What a sound section holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Checked {
    /// Bytes behind the head: those whose checksum is not looked at on opening.
    pub bulk_bytes: u64,
    /// Rows in the bulk, each with a checksum of its own.
    pub rows: usize,
}

/// Reads every byte of a section of kind `tag`; `None` for a kind that this build does not know.
///
/// Takes no memory beyond what the section's own reader takes. Errors: whatever that reader refuses, and values, rows or
/// coefficients in the bulk that it would only come upon when it is used.
pub fn check(tag: Tag, bytes: &[u8], version: u16, limits: &Limits) -> Result<Option<Checked>, ReadError> {
    let mut checked = Checked::default();
    match tag {
        BoltSection::TAG => drop(BoltSection::read(bytes, version, limits)?),
        DensitySection::TAG => drop(DensitySection::read(bytes, version, limits)?),
        PlaceSection::TAG => drop(PlaceSection::read(bytes, version, limits)?),
        ProvenanceSection::TAG => drop(ProvenanceSection::read(bytes, version, limits)?),
        RainPlaceSection::TAG => drop(RainPlaceSection::read(bytes, version, limits)?),
        TownSection::TAG => drop(TownSection::read(bytes, version, limits)?),
        StreakSection::TAG => drop(StreakSection::read(bytes, version, limits)?),
        ViewSection::TAG => drop(ViewSection::read(bytes, version, limits)?),
        WetMapsSection::TAG => drop(WetMapsSection::read(bytes, version, limits)?),
        CloudSection::TAG => {
            let cloud = CloudSection::read(bytes, version, limits)?;
            cloud.check_values()?;
            checked.bulk_bytes = cloud.extinction.bytes();
        }
        ResponseSection::TAG => {
            let response = ResponseSection::read(bytes, version, limits)?;
            let windows = response.head.finer.iter().flat_map(|level| level.windows_of_rows());
            let full =
                response.head.finer.first().map_or(response.row_count(), |level| level.first_row as usize);
            let whole = std::iter::repeat_n(response.head.shape.len(), full);
            for (row, cells) in whole.chain(windows.map(|window| window.shape.len())).enumerate() {
                for plane in coefficient_planes(response.row(row)?, response.head.basis.count())? {
                    check_stream(&plane, &response.code, cells)?;
                }
            }
            checked = Checked { bulk_bytes: response.rows.len() as u64, rows: response.row_count() };
        }
        _ => {
            debug_assert!(!is_known(tag), "{tag} is known and not checked");
            return Ok(None);
        }
    }
    Ok(Some(checked))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::KNOWN;

    #[test]
    fn every_known_section_is_checked_and_no_other() {
        for &tag in KNOWN {
            let error = check(tag, &[0; 3], 1, &Limits::default()).expect_err("three zeros are no section");
            assert!(error.to_string().contains(&format!("section {tag}")), "{error}");
        }
        assert_eq!(check(Tag(*b"ELSE"), &[0; 3], 1, &Limits::default()).unwrap(), None);
    }
}
