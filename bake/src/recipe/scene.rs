//! `[scene]` of a recipe, as it is typed and checked.

use super::model::{PuddleMask, SceneSpec};
use super::number::Number;
use super::place::Source;
use crate::error::RecipeError;
use glam::DVec3;
use serde::Deserialize;
use squall_formats::section::response::towards_sun;
use std::path::PathBuf;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneFile {
    file: Spanned<PathBuf>,
    #[serde(rename = "lumens_per_W")]
    lumens_per_watt: Option<Number>,
    region_m: Option<Spanned<[f64; 4]>>,
    cell_m: Option<Number>,
    deepest_m: Option<Number>,
    puddles: Option<Spanned<PathBuf>>,
    puddles_white_m: Option<Number>,
    drips: Option<bool>,
    fins: Option<bool>,
    #[serde(default)]
    overhead: OverheadFile,
    #[serde(default)]
    lightning: LightningFile,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct OverheadFile {
    bake: Option<bool>,
    cell_m: Option<Number>,
    points: Option<Number>,
    seed: Option<u64>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightningFile {
    directions: Option<Spanned<Vec<DirectionFile>>>,
    cell_m: Option<Number>,
    top_m: Option<Number>,
    paths: Option<Number>,
    bounces: Option<Number>,
    seed: Option<u64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DirectionFile {
    azimuth_deg: f64,
    elevation_deg: f64,
}

/// Two key directions, from the side and from rather high, that leave the shadows of each other free.
const USUAL_DIRECTIONS_DEG: [[f64; 2]; 2] = [[35.0, 40.0], [200.0, 60.0]];

impl SceneFile {
    pub(super) fn check(self, source: &Source) -> Result<SceneSpec, RecipeError> {
        let file = source.beside("scene.file", &self.file)?;
        if !cfg!(feature = "meshes") {
            let wanted = "no meshes: this program was built without feature `meshes`";
            return Err(source.error(self.file.span(), "scene", wanted, file.display()));
        }
        let number = |field: &str, value: &Option<Number>, usual: f64, range: [f64; 2], unit: &str| {
            source.number(&format!("scene.{field}"), value, usual, range, unit)
        };
        let count = |field: &str, value: &Option<Number>, usual: u32, range: [u32; 2]| {
            source.count(&format!("scene.{field}"), value, usual, range)
        };
        let region_m = self.region_m.as_ref().map(|region| {
            let [x0, y0, x1, y1] = *region.get_ref();
            let good = x0 < x1 && y0 < y1 && region.get_ref().iter().all(|at| at.abs() <= 1e7);
            let wanted = "x and y of a low corner, then of a higher one, within ±1e7 m";
            let found = || format!("{:?}", region.get_ref());
            good.then_some([[x0, y0], [x1, y1]])
                .ok_or_else(|| source.error(region.span(), "scene.region_m", wanted, found()))
        });
        let region_m = region_m.transpose()?;
        let puddles = self.puddles.as_ref().map(|path| source.beside("scene.puddles", path)).transpose()?;
        if let (None, Some(white)) = (&puddles, &self.puddles_white_m) {
            let wanted = "`puddles` beside it";
            return Err(source.error(white.span(), "scene.puddles_white_m", wanted, "none"));
        }
        let white_m = number("puddles_white_m", &self.puddles_white_m, 0.03, [1e-4, 10.0], "m")?;
        let (overhead, lightning) = (&self.overhead, &self.lightning);
        let overhead_cell = number("overhead.cell_m", &overhead.cell_m, 0.25, [1e-3, 1e4], "m")?;
        Ok(SceneSpec {
            file,
            lumens_per_watt: number("lumens_per_W", &self.lumens_per_watt, 683.0, [1e-6, 1e6], "lm/W")?,
            region_m,
            cell_m: number("cell_m", &self.cell_m, 0.1, [1e-3, 1e4], "m")?,
            deepest_m: number("deepest_m", &self.deepest_m, 0.3, [1e-3, 100.0], "m")?,
            puddles: puddles.map(|file| PuddleMask { file, white_m }),
            drips: self.drips.unwrap_or(true),
            fins: self.fins.unwrap_or(true),
            overhead_cell_m: overhead.bake.unwrap_or(true).then_some(overhead_cell),
            overhead_points: count("overhead.points", &overhead.points, 4, [1, 4096])?,
            overhead_seed: overhead.seed.unwrap_or(1),
            directions: directions(lightning.directions.as_ref(), source)?,
            lightning_cell_m: number("lightning.cell_m", &lightning.cell_m, 2.0, [0.05, 1e4], "m")?,
            lightning_top_m: number("lightning.top_m", &lightning.top_m, 12.0, [0.1, 1e4], "m")?,
            paths: count("lightning.paths", &lightning.paths, 3072, [16, 1 << 20])?,
            bounces: count("lightning.bounces", &lightning.bounces, 3, [1, 64])?,
            lightning_seed: lightning.seed.unwrap_or(1),
        })
    }
}

fn directions(
    typed: Option<&Spanned<Vec<DirectionFile>>>,
    source: &Source,
) -> Result<Vec<DVec3>, RecipeError> {
    let towards = |[azimuth, elevation]: [f64; 2]| {
        DVec3::from_array(towards_sun(azimuth.to_radians(), elevation.to_radians()))
    };
    let Some(typed) = typed else { return Ok(USUAL_DIRECTIONS_DEG.map(towards).to_vec()) };
    let refuse = |wanted: &str, found: String| {
        Err(source.error(typed.span(), "scene.lightning.directions", wanted, found))
    };
    // The runtime mixes the light of two directions by two intensities.
    if !matches!(typed.get_ref().len(), 0 | 2) {
        return refuse("two key directions, of L1 and of L2, or none", typed.get_ref().len().to_string());
    }
    let mut out = Vec::new();
    for one in typed.get_ref() {
        if !(one.azimuth_deg.abs() <= 5729.5 && one.elevation_deg.abs() <= 90.0) {
            let found = format!("{}, {}", one.azimuth_deg, one.elevation_deg);
            return refuse("azimuth_deg of −5729.5 to 5729.5, elevation_deg of −90 to 90", found);
        }
        out.push(towards([one.azimuth_deg, one.elevation_deg]));
    }
    Ok(out)
}
