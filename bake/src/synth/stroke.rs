//! Lightning strokes from seeds, as lists of lamps.

use crate::error::BakeError;
use serde::Serialize;
use squall_formats::section::bolt::StrokeRecord;
use squall_runtime::stroke::Stroke;
use std::path::Path;

#[derive(Serialize)]
struct Lamp {
    position_m: [f64; 3],
    #[serde(rename = "intensity_W_per_sr")]
    intensity: f64,
}

/// LAMPS.json of a stroke between two `ends`, m, with the recipe's default growth: points of light whose intensities sum to
/// `intensity`, W/sr, at least `spacing` m apart along a channel.
///
/// Errors: ends closer than a metre or farther than 1000 km apart, an intensity or spacing out of range.
pub fn stroke_json(
    seed: u64,
    ends: [[f64; 3]; 2],
    intensity: f64,
    spacing: f64,
) -> Result<String, BakeError> {
    let mut record = StrokeRecord { seed, from_m: ends[0], to_m: ends[1], ..StrokeRecord::usual() };
    record.intensity_w_per_sr = intensity;
    record.segment_m = record.length() / 100.0;
    let refused = |(field, wanted, found): (&'static str, &'static str, String)| {
        BakeError::input(Path::new("synth stroke"), field, wanted, found)
    };
    record.check().map_err(refused)?;
    if !(0.0..=1e6).contains(&spacing) {
        return Err(refused(("spacing", "0 to 1e6 m", spacing.to_string())));
    }
    let lights: Vec<Lamp> = Stroke::grow(&record)
        .lights(spacing)
        .into_iter()
        .map(|light| Lamp { position_m: light.position.to_array(), intensity: light.intensity })
        .collect();
    let text = serde_json::to_string_pretty(&lights).map_err(std::io::Error::from);
    Ok(text.map_err(BakeError::io(Path::new("synth stroke"), "write"))? + "\n")
}
