//! What a picture of a streak says of itself: a text chunk of its PNG, JSON under a keyword of its own.

use super::Input;
use crate::error::BakeError;
use serde::{Deserialize, Serialize};
use squall_formats::section::streak::{DropNotes, SceneNotes};

/// Keyword of the chunk.
pub const KEYWORD: &str = "squall streak";

/// A drop, its light and the line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreakNotes {
    /// The drop.
    pub drop: DropNotes,
    /// How it was lit and looked at.
    pub scene: SceneNotes,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fields {
    diameter_mm: f64,
    exposure_ms: f64,
    view_elevation_deg: f64,
    light_share: f64,
    light_azimuth_deg: f64,
    light_elevation_deg: f64,
}

impl StreakNotes {
    /// The chunk's text.
    pub fn to_json(&self) -> String {
        let Self { drop, scene } = self;
        format!(
            "{{\"diameter_mm\":{:.3},\"exposure_ms\":{:.3},\"view_elevation_deg\":{},\"light_share\":{:.3},\
             \"light_azimuth_deg\":{},\"light_elevation_deg\":{}}}",
            drop.diameter_mm,
            drop.exposure_ms,
            scene.view_elevation_deg,
            scene.light_share,
            scene.light_azimuth_deg,
            scene.light_elevation_deg
        )
    }

    /// What a picture says; nothing where it has no such chunk.
    ///
    /// Errors: a chunk that is no such JSON or holds numbers out of range.
    pub fn of(input: &Input) -> Result<Option<Self>, BakeError> {
        // Whatever else is wrong with the file is said where its pixels are read.
        let Ok(reader) = png::Decoder::new(std::io::Cursor::new(&input.bytes)).read_info() else {
            return Ok(None);
        };
        let chunks = &reader.info().uncompressed_latin1_text;
        let Some(chunk) = chunks.iter().find(|chunk| chunk.keyword == KEYWORD) else { return Ok(None) };
        let refused = |wanted: &str, found: String| {
            BakeError::input(&input.path, format!("text chunk \"{KEYWORD}\""), wanted, found)
        };
        let fields: Fields = serde_json::from_str(&chunk.text)
            .map_err(|error| refused("JSON with a drop's numbers", error.to_string()))?;
        let ranges = [
            ("diameter_mm", fields.diameter_mm, 0.0, 65.535),
            ("exposure_ms", fields.exposure_ms, 0.0, 65.535),
            ("view_elevation_deg", fields.view_elevation_deg, -90.0, 90.0),
            ("light_share", fields.light_share, 0.0, 1.0),
            ("light_azimuth_deg", fields.light_azimuth_deg, -180.0, 180.0),
            ("light_elevation_deg", fields.light_elevation_deg, -90.0, 90.0),
        ];
        for (name, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(refused(&format!("{name} from {low} to {high}"), value.to_string()));
            }
        }
        let drop = DropNotes { diameter_mm: fields.diameter_mm, exposure_ms: fields.exposure_ms };
        let scene = SceneNotes {
            view_elevation_deg: fields.view_elevation_deg,
            light_share: fields.light_share,
            light_azimuth_deg: fields.light_azimuth_deg,
            light_elevation_deg: fields.light_elevation_deg,
        };
        Ok(Some(Self { drop, scene }))
    }
}
