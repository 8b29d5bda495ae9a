//! `manifest.json`: what a run was told, what it read and what it wrote, so that the same bytes can be made again. It has no times of day
//! and no place but names as they read from its own folder: the same run writes the same manifest.

use super::job::Job;
use super::journal::Heading;
use crate::error::BakeError;
use crate::input::json::read_json;
use crate::input::{Fingerprint, Input};
use serde::{Deserialize, Serialize};
use squall_formats::units::Radians;
use squall_runtime::glam::Vec3;
use squall_runtime::world::{Sun, WorldLight};
use std::path::{Path, PathBuf};

/// What this version writes.
const VERSION: u32 = 1;
/// Name of the file.
pub const NAME: &str = "manifest.json";

/// A run of `squall rain`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Program and version that wrote it.
    pub tool: String,
    /// Version of this form.
    pub manifest: u32,
    /// What it was told.
    pub settings: Job,
    /// The asset whose rain it is; `null` for the built-in one, whose hash is given all the same.
    pub asset: AssetRecord,
    /// What was read beside the frames and the asset.
    #[serde(default)]
    pub inputs: Inputs,
    /// The light that the rain is in.
    pub light: StoredLight,
    /// Every frame at every rate.
    pub frames: Vec<FrameRecord>,
}

/// A file that was read or written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Its name from the manifest's folder.
    pub name: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// BLAKE3 of its bytes, in hexadecimal digits.
    pub blake3: String,
}

/// Files that a whole run shares; `null` for those that it was not given.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inputs {
    /// Where cameras stood.
    pub pose: Option<FileRecord>,
    /// When frames were taken.
    pub times: Option<FileRecord>,
    /// The panorama, or the manifest whose light it is.
    pub environment: Option<FileRecord>,
}

/// The asset of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AssetRecord {
    /// Its name from the manifest's folder, or "built-in".
    pub name: String,
    /// BLAKE3 of its bytes.
    pub blake3: String,
}

/// A world's light in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredLight {
    /// Where it is from, in words.
    pub from: String,
    /// Spherical harmonics of the radiance, in the frames' own unit.
    pub coefficients: Vec<[f32; 3]>,
    /// The sun, where there is one.
    pub sun: Option<StoredSun>,
}

/// A sun in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredSun {
    /// Unit vector to it.
    pub towards: [f32; 3],
    /// Irradiance across its beam.
    pub irradiance: [f32; 3],
    /// Half the angle that it covers.
    pub angular_radius_rad: f64,
}

/// What happened to a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameRecord {
    /// The frame's name without its ending.
    pub frame: String,
    /// Rainfall intensity.
    pub rate_mm_per_h: f64,
    /// "left" or "right" of a pair.
    pub camera: Option<String>,
    /// Time of the middle of the exposure.
    pub time_s: f64,
    /// The frame.
    pub colour: Option<FileRecord>,
    /// Its depth.
    pub depth: Option<FileRecord>,
    /// How the frame's samples stand for light.
    pub transfer: Option<String>,
    /// What was written.
    pub outputs: Vec<OutputRecord>,
    /// What was counted; `null` for a frame that failed.
    pub counts: Option<Counts>,
    /// Why it failed.
    pub error: Option<String>,
}

/// A file that was written for a frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputRecord {
    /// "frame", "mask", "transmittance", "in_scattered" or "streaks".
    pub kind: String,
    /// Its name from the manifest's folder.
    pub name: PathBuf,
    /// BLAKE3 of its bytes; of a list of streaks that several frames share, of this frame's lines.
    pub blake3: String,
}

/// What was counted in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Streaks drawn: those that can reach the frame. What the scene hides counts, and the odd one ends beside the frame.
    pub streaks: usize,
    /// Those whose drop is inside it in the middle of the exposure.
    pub inside: usize,
    /// Pixels without a depth.
    pub holes: usize,
    /// Mean coverage.
    pub mean_alpha: f64,
    /// Mean transmittance.
    pub mean_transmittance: f64,
}

impl Manifest {
    /// The manifest of a run and what became of its frames.
    pub fn new(heading: Heading, frames: Vec<FrameRecord>) -> Self {
        let Heading { tool, settings, asset, inputs, light } = heading;
        Self { tool, manifest: VERSION, settings, asset, inputs, light, frames }
    }

    /// Reads a manifest. Errors: no such file, no manifest, one of another version, light that is none.
    pub fn read(path: &Path) -> Result<Self, BakeError> {
        let manifest: Self = read_json(path, "the manifest of a run of squall rain")?;
        if manifest.manifest != VERSION {
            let wanted = format!("version {VERSION}");
            return Err(BakeError::input(path, "manifest", wanted, manifest.manifest));
        }
        manifest.light.world(path)?;
        Ok(manifest)
    }

    /// Its text. Errors: none that its types allow.
    pub fn text(&self) -> std::io::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}

impl StoredLight {
    /// The numbers of a light.
    pub fn of(light: &WorldLight, from: String) -> Self {
        let sun = light.sun.as_ref().map(|sun| StoredSun {
            towards: sun.towards.to_array(),
            irradiance: sun.irradiance,
            angular_radius_rad: sun.angular_radius.0,
        });
        Self { from, coefficients: light.coefficients(), sun }
    }

    /// The light of the numbers. Errors: numbers that no light has; `path` is where they stand.
    pub fn world(&self, path: &Path) -> Result<WorldLight, BakeError> {
        let sun = self.sun.as_ref().map(|sun| Sun {
            towards: Vec3::from_array(sun.towards),
            irradiance: sun.irradiance,
            angular_radius: Radians(sun.angular_radius_rad),
        });
        WorldLight::from_coefficients(&self.coefficients, sun)
            .map_err(|error| BakeError::input(path, "light", "the light of a manifest", error))
    }
}

impl FileRecord {
    /// A file as it was read, under a name.
    pub fn of(name: PathBuf, input: &Input) -> Self {
        Self::of_print(name, &input.fingerprint())
    }

    /// A file by its length and hash, under a name.
    pub fn of_print(name: PathBuf, print: &Fingerprint) -> Self {
        Self { name, bytes: print.bytes, blake3: blake3::Hash::from(print.hash).to_hex().to_string() }
    }
}
