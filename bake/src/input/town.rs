//! A town as JSON: the `TOWN` section with units in the keys and degrees for turns.

use crate::error::BakeError;
use crate::input::Input;
use crate::input::json::{parse_json, read_text_input};
use serde::{Deserialize, Serialize};
use squall_formats::section::town::{Block, Ground, HeightMap, Road, StreetLamp, TownSection, Windows};
use squall_formats::{Limits, ReadError};
use std::path::Path;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TownFile {
    #[serde(default, skip_serializing_if = "String::is_empty")]
    note: String,
    ground: GroundFile,
    #[serde(default)]
    blocks: Vec<BlockFile>,
    #[serde(default)]
    lamps: Vec<LightFile>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    hills: Option<HillsFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GroundFile {
    albedo: [f32; 3],
    wetness: f32,
    puddles: f32,
    puddle_size_m: f32,
    ripple: f32,
    #[serde(default)]
    seed: u32,
    #[serde(default)]
    roads: Vec<RoadFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RoadFile {
    from_m: [f32; 2],
    to_m: [f32; 2],
    half_width_m: f32,
    albedo: [f32; 3],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BlockFile {
    centre_m: [f32; 2],
    half_m: [f32; 2],
    #[serde(default)]
    foot_m: f32,
    height_m: f32,
    #[serde(default)]
    yaw_deg: f32,
    albedo: [f32; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    windows: Option<WindowsFile>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct WindowsFile {
    pitch_m: [f32; 2],
    glass: f32,
    lit: f32,
    #[serde(rename = "radiance_W_per_m2_sr")]
    radiance: [f32; 3],
    seed: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightFile {
    position_m: [f32; 3],
    #[serde(rename = "intensity_W_per_sr")]
    intensity: [f32; 3],
}

/// Heights in metres; the section keeps them in steps of a 65535th of the highest.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HillsFile {
    origin_m: [f32; 2],
    cell_m: [f32; 2],
    counts: [u32; 2],
    heights_m: Vec<f32>,
}

impl HillsFile {
    fn into_section(self, file: &Path) -> Result<HeightMap, BakeError> {
        let wanted = "heights in [0, 9000] m";
        if let Some(bad) = self.heights_m.iter().find(|h| !(0.0..=9_000.0).contains(*h)) {
            return Err(BakeError::input(file, "hills.heights_m", wanted, bad));
        }
        let top = self.heights_m.iter().fold(0.0f32, |a, &b| a.max(b));
        let step = top / 65_535.0;
        let steps = |height: f32| if step > 0.0 { (height / step).round() as u16 } else { 0 };
        let heights = self.heights_m.iter().map(|&height| steps(height)).collect();
        Ok(HeightMap { origin: self.origin_m, cell: self.cell_m, counts: self.counts, step, heights })
    }
}

impl TownFile {
    fn into_section(self, file: &Path) -> Result<TownSection, BakeError> {
        let GroundFile { albedo, wetness, puddles, puddle_size_m, ripple, seed, roads } = self.ground;
        let roads = roads.into_iter().map(|road| Road {
            from: road.from_m,
            to: road.to_m,
            half_width: road.half_width_m,
            albedo: road.albedo,
        });
        let blocks = self.blocks.into_iter().map(|block| Block {
            centre: block.centre_m,
            half: block.half_m,
            foot: block.foot_m,
            height: block.height_m,
            yaw: block.yaw_deg.to_radians(),
            albedo: block.albedo,
            windows: block.windows.map(|w| Windows {
                pitch: w.pitch_m,
                glass: w.glass,
                lit: w.lit,
                radiance: w.radiance,
                seed: w.seed,
            }),
        });
        let lamps = self.lamps.into_iter();
        Ok(TownSection {
            ground: Ground {
                albedo,
                wetness,
                puddles,
                puddle_size: puddle_size_m,
                ripple,
                seed,
                roads: roads.collect(),
            },
            blocks: blocks.collect(),
            lamps: lamps.map(|l| StreetLamp { position: l.position_m, intensity: l.intensity }).collect(),
            hills: self.hills.map(|hills| hills.into_section(file)).transpose()?,
        })
    }

    fn from_section(town: &TownSection, note: &str) -> Self {
        let ground = &town.ground;
        let roads = ground.roads.iter().map(|road| RoadFile {
            from_m: road.from,
            to_m: road.to,
            half_width_m: road.half_width,
            albedo: road.albedo,
        });
        let blocks = town.blocks.iter().map(|block| BlockFile {
            centre_m: block.centre,
            half_m: block.half,
            foot_m: block.foot,
            height_m: block.height,
            yaw_deg: block.yaw.to_degrees(),
            albedo: block.albedo,
            windows: block.windows.as_ref().map(|w| WindowsFile {
                pitch_m: w.pitch,
                glass: w.glass,
                lit: w.lit,
                radiance: w.radiance,
                seed: w.seed,
            }),
        });
        let lamps = town.lamps.iter();
        Self {
            note: note.into(),
            ground: GroundFile {
                albedo: ground.albedo,
                wetness: ground.wetness,
                puddles: ground.puddles,
                puddle_size_m: ground.puddle_size,
                ripple: ground.ripple,
                seed: ground.seed,
                roads: roads.collect(),
            },
            blocks: blocks.collect(),
            lamps: lamps.map(|l| LightFile { position_m: l.position, intensity: l.intensity }).collect(),
            hills: town.hills.as_ref().map(|hills| HillsFile {
                origin_m: hills.origin,
                cell_m: hills.cell,
                counts: hills.counts,
                heights_m: hills.heights.iter().map(|&h| f32::from(h) * hills.step).collect(),
            }),
        }
    }
}

/// Reads a town file. Errors: missing or unreadable, no JSON of a town (with line and column), an unknown key, a value outside
/// its range.
pub fn read_town(file: &Path) -> Result<TownSection, BakeError> {
    town_of(&read_text_input(file)?)
}

/// The town of a file that was read already. Errors: as [`read_town`].
pub fn town_of(input: &Input) -> Result<TownSection, BakeError> {
    let file = input.path.as_path();
    let read: TownFile = parse_json(input, "a town (ground, blocks, lamps, hills)")?;
    let town = read.into_section(file)?;
    town.validate(&Limits::default()).map_err(|error| match error {
        ReadError::Invalid { field, wanted, found, .. } => BakeError::input(file, field, wanted, found),
        other => BakeError::bytes(file, other),
    })?;
    Ok(town)
}

/// A town as JSON text that [`read_town`] reads back; `note` says where it comes from.
pub fn town_json(town: &TownSection, note: &str) -> String {
    let text = serde_json::to_string_pretty(&TownFile::from_section(town, note))
        .unwrap_or_else(|error| unreachable!("a town always encodes: {error}"));
    // One object a line: numbers of an array stay together.
    let mut out = String::with_capacity(text.len());
    let mut depth = 0;
    for line in text.lines() {
        let piece = line.trim_start();
        if depth > 0 {
            depth += i32::from(piece.ends_with('[')) - i32::from(piece.starts_with(']'));
            out.push_str(if out.ends_with(',') { " " } else { "" });
            out.push_str(piece);
        } else {
            out.push('\n');
            out.push_str(line);
            let numbers = ["_m\": [", "albedo\": [", "sr\": [", "counts\": ["];
            depth += i32::from(numbers.iter().any(|end| piece.ends_with(end)));
        }
    }
    out.push('\n');
    out.trim_start().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::town::synth_town;

    fn write(text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("town.json");
        std::fs::write(&path, text).unwrap();
        (folder, path)
    }

    #[test]
    fn a_town_reads_back_as_it_was_written() {
        let town = synth_town(3);
        let (_folder, path) = write(&town_json(&town, "seed 3"));
        let read = read_town(&path).unwrap();
        /// Degrees and metres of hills are rounded to single precision on the way.
        const ROUND_OFF: f32 = 1e-5;
        assert_eq!(read.ground, town.ground);
        assert_eq!(read.lamps, town.lamps);
        assert_eq!(read.blocks.len(), town.blocks.len());
        for (a, b) in read.blocks.iter().zip(&town.blocks) {
            assert!((a.yaw - b.yaw).abs() < ROUND_OFF);
            assert_eq!(Block { yaw: 0.0, ..a.clone() }, Block { yaw: 0.0, ..b.clone() });
        }
        let (a, b) = (read.hills.unwrap(), town.hills.unwrap());
        // Half a step of the coarser quantisation, and single precision.
        let step = a.step.max(b.step);
        let metres =
            |map: &HeightMap| map.heights.iter().map(|&h| f32::from(h) * map.step).collect::<Vec<_>>();
        assert!(metres(&a).iter().zip(metres(&b)).all(|(a, b)| (a - b).abs() <= step));
    }

    #[test]
    fn an_unknown_key_a_wrong_type_and_a_bad_value_are_refused_with_their_place() {
        let good = r#"{"ground": {"albedo": [0.1,0.1,0.1], "wetness": 1, "puddles": 0.2, "puddle_size_m": 3, "ripple": 0.02}}"#;
        let (_folder, path) = write(good);
        assert!(read_town(&path).is_ok());
        for (bad, says) in [
            (
                good.replace("wetness", "wettness"),
                "line 1 column 47: unknown key: wanted a known key; the nearest is `wetness`, found `wettness`",
            ),
            (good.replace("0.2", "\"much\""), "line 1 column"),
            (good.replace("0.2", "1.2"), "ground wetness, puddles and ripple"),
            (good[..50].to_string(), "line 1"),
        ] {
            let (_folder, path) = write(&bad);
            let error = read_town(&path).unwrap_err();
            assert_eq!(error.exit_code(), 3);
            assert!(error.to_string().contains(says), "{error}");
        }
        assert_eq!(read_town(Path::new("no/such/town.json")).unwrap_err().exit_code(), 3);
    }
}
