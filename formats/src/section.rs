//! Section tags, and one module per section.

pub mod bolt;
pub mod check;
pub mod cloud;
pub mod density;
pub mod place;
pub mod provenance;
pub mod rain_place;
pub mod response;
pub mod streak;
pub mod town;
pub mod view;
pub mod wet_maps;

pub use crate::meta::check_version;
pub use crate::tag::Tag;

use crate::container::Directory;
use crate::error::ReadError;

/// Tags of the sections that this build reads; any other is skipped when optional and refused when required.
pub const KNOWN: &[Tag] = &[
    bolt::BoltSection::TAG,
    cloud::CloudSection::TAG,
    density::DensitySection::TAG,
    place::PlaceSection::TAG,
    response::ResponseSection::TAG,
    provenance::ProvenanceSection::TAG,
    rain_place::RainPlaceSection::TAG,
    streak::StreakSection::TAG,
    town::TownSection::TAG,
    view::ViewSection::TAG,
    wet_maps::WetMapsSection::TAG,
];

/// Those of [`KNOWN`] that an asset marks as required; it marks none of the others so.
pub const REQUIRED: &[Tag] = &[cloud::CloudSection::TAG, response::ResponseSection::TAG];

/// Whether this build reads sections of kind `tag`.
pub fn is_known(tag: Tag) -> bool {
    KNOWN.contains(&tag)
}

/// Checks which sections an asset has and how they are marked, before any is read.
///
/// Errors: a required section of a kind that this build does not know, by name; a known one that is marked as required and
/// should not be, or the other way round.
pub fn check_marks(directory: &Directory) -> Result<(), ReadError> {
    for entry in &directory.entries {
        let (section, marked) = (entry.tag, entry.required);
        if !is_known(section) {
            if marked {
                return Err(ReadError::UnknownRequired { section });
            }
            continue;
        }
        if marked != REQUIRED.contains(&section) {
            let words = |marked: bool| if marked { "set" } else { "not set" };
            return Err(ReadError::Invalid {
                section,
                offset: None,
                field: "flag \"required\" in the section table",
                wanted: words(!marked),
                found: words(marked).into(),
            });
        }
    }
    Ok(())
}
