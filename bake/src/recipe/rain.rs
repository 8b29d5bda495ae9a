//! `[rain]` of a recipe, as it is typed and checked.

use super::model::{DensitySpec, FitSettings, Rain};
use super::number::Number;
use super::place::Source;
use super::rain_map::RainMapFile;
use crate::error::RecipeError;
use serde::Deserialize;
use squall_formats::section::density::Ranges;
use squall_formats::section::streak::Method;
use squall_formats::units::{Degrees, Millimetres, MillimetresPerHour, Seconds};
use std::path::PathBuf;
use toml::Spanned;

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RainFile {
    density: DensityFile,
    streaks: StreaksFile,
    map: Option<RainMapFile>,
    farthest_m: Option<Number>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct DensityFile {
    rate_mm_per_h: Option<Spanned<[f64; 2]>>,
    vertical_fov_deg: Option<Spanned<[f64; 2]>>,
    exposure_ms: Option<Spanned<[f64; 2]>>,
    streak_px: Option<Spanned<[f64; 2]>>,
    diameter_mm: Option<Spanned<[f64; 2]>>,
    classes: Option<Number>,
    class_error: Option<Number>,
    error: Option<Number>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct StreaksFile {
    pictures: Option<Vec<Spanned<PathBuf>>>,
    layer: Option<String>,
    method: Option<Spanned<String>>,
    cosines: Option<Number>,
    psnr_db: Option<Number>,
}

impl RainFile {
    pub(super) fn check(&self, source: &Source, has_cloud: bool) -> Result<Rain, RecipeError> {
        let density = self.density.check(source)?;
        let streaks = &self.streaks;
        let mut pictures = Vec::new();
        for picture in streaks.pictures.iter().flatten() {
            pictures.push(source.beside("rain.streaks.pictures", picture)?);
        }
        let usual = FitSettings::default();
        let method = match &streaks.method {
            None => usual.method,
            Some(name) => Method::from_name(name.get_ref()).ok_or_else(|| {
                let known: Vec<&str> = Method::ALL.iter().map(|m| m.name()).collect();
                let wanted = format!("one of {}", known.join(", "));
                source.error(name.span(), "rain.streaks.method", wanted, format!("\"{}\"", name.get_ref()))
            })?,
        };
        let cosines =
            source.count("rain.streaks.cosines", &streaks.cosines, usual.cosines as u32, [0, 64])? as usize;
        let psnr_db = source.optional("rain.streaks.psnr_db", &streaks.psnr_db, [1.0, 80.0], "dB")?;
        // What is said outright overrides the budget.
        let psnr_db = psnr_db.filter(|_| streaks.cosines.is_none());
        let method_given = streaks.method.is_some();
        let layer = streaks.layer.clone();
        let map = self.map.as_ref().map(|map| map.check(source, has_cloud)).transpose()?;
        let farthest_m = source.optional("rain.farthest_m", &self.farthest_m, [1.0, 1e7], "m")?;
        let fit = FitSettings { method, cosines };
        Ok(Rain { pictures, layer, fit, psnr_db, method_given, density, map, farthest_m })
    }
}

impl DensityFile {
    fn check(&self, source: &Source) -> Result<DensitySpec, RecipeError> {
        let (density, usual) = (self, DensitySpec::default());
        let rate = source.range(
            "rain.density.rate_mm_per_h",
            &density.rate_mm_per_h,
            usual.ranges.rate.map(|r| r.0),
            [1e-3, 1000.0],
            "mm/h",
        )?;
        let fov = source.range(
            "rain.density.vertical_fov_deg",
            &density.vertical_fov_deg,
            usual.ranges.vertical_fov.map(|v| v.0),
            [1.0, 179.0],
            "degrees",
        )?;
        let exposure = source.range(
            "rain.density.exposure_ms",
            &density.exposure_ms,
            usual.ranges.exposure.map(|t| t.0 * 1000.0),
            [1e-3, 1000.0],
            "ms",
        )?;
        let length_px = source.range(
            "rain.density.streak_px",
            &density.streak_px,
            usual.ranges.length_px,
            [1.0, 1e4],
            "px",
        )?;
        let diameter = source.range(
            "rain.density.diameter_mm",
            &density.diameter_mm,
            usual.diameter.map(|d| d.0),
            [0.1, 12.0],
            "mm",
        )?;
        let class_error =
            source.optional("rain.density.class_error", &density.class_error, [1e-3, 0.5], "")?;
        Ok(DensitySpec {
            ranges: Ranges {
                rate: rate.map(MillimetresPerHour),
                vertical_fov: fov.map(Degrees),
                exposure: exposure.map(|ms| Seconds(ms / 1000.0)),
                length_px,
            },
            diameter: diameter.map(Millimetres),
            classes: source.count("rain.density.classes", &density.classes, usual.classes as u32, [1, 64])?
                as usize,
            // What is said outright overrides the budget.
            class_error: class_error.filter(|_| density.classes.is_none()),
            relative_error: source.number("rain.density.error", &density.error, 5e-3, [1e-9, 0.5], "")?,
        })
    }
}
