//! `PLAC` v1: the point of the ground that an asset's scene stands on. Bytes: SPEC.md, "PLAC".

use crate::container::OutSection;
use crate::error::{Limits, ReadError};
use crate::meta::{self, check_version};
use crate::tag::Tag;
use serde::{Deserialize, Serialize};

/// Where a scene stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlaceSection {
    /// A point of the ground in the asset's coordinates, m: the town's own origin, where the sky's sun has its stated elevation.
    pub origin_m: [f64; 3],
}

/// Largest coordinate, m.
const FARTHEST_M: f64 = 1e9;

impl PlaceSection {
    /// The section's tag.
    pub const TAG: Tag = Tag(*b"PLAC");
    /// Version that this build writes, and the newest that it reads.
    pub const VERSION: u16 = 1;

    /// Reads and checks the point.
    ///
    /// Errors: another version, bytes that are no record of this one, a coordinate beyond ±10⁹ m.
    pub fn read(bytes: &[u8], version: u16, limits: &Limits) -> Result<Self, ReadError> {
        check_version(Self::TAG, version, Self::VERSION)?;
        let section: Self = meta::decode(Self::TAG, bytes, limits)?;
        if section.origin_m.iter().all(|at| at.abs() <= FARTHEST_M) {
            return Ok(section);
        }
        Err(ReadError::Invalid {
            section: Self::TAG,
            offset: None,
            field: "origin_m",
            wanted: "three numbers within 1e9 m",
            found: format!("{:?}", section.origin_m),
        })
    }

    /// The section's bytes.
    pub fn write(&self) -> OutSection {
        OutSection::small(Self::TAG, Self::VERSION, false, meta::encode(self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_reads_back_and_one_beyond_any_map_is_refused() {
        let read = |place: PlaceSection| PlaceSection::read(&meta::encode(&place), 1, &Limits::default());
        let place = PlaceSection { origin_m: [3e5, -5e6, 200.0] };
        assert_eq!(read(place).unwrap(), place);
        for wrong in [f64::NAN, 2e9, f64::NEG_INFINITY] {
            assert!(read(PlaceSection { origin_m: [0.0, wrong, 0.0] }).is_err());
        }
    }
}
