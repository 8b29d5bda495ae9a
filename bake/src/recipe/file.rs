//! The recipe's text as it is typed, and its way to a checked [`Recipe`].

use super::clouds::{CloudsFile, parse_directions};
use super::model::{Clouds, DensitySpec, FitSettings, Rain, Recipe};
use super::place::Source;
use super::view::ViewFile;
use crate::error::{BakeError, RecipeError};
use crate::input::scene::beside;
use crate::input::without_mark;
use serde::Deserialize;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::density::Ranges;
use squall_formats::section::streak::Method;
use squall_formats::section::view::ViewSection;
use squall_formats::units::{Degrees, Millimetres, MillimetresPerHour, Seconds};
use squall_formats::view_region::ViewRegion;
use squall_runtime::transport::quadrature::Quadrature;
use std::path::{Path, PathBuf};
use toml::Spanned;

pub(super) type Number = Spanned<f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RecipeFile {
    clouds: Option<CloudsFile>,
    rain: Option<RainFile>,
    #[serde(default)]
    strokes: Vec<Spanned<StrokeFile>>,
    town: Option<TownFile>,
    view: Option<Spanned<ViewFile>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TownFile {
    file: Spanned<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewAlone {
    view: Spanned<ViewFile>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RainFile {
    density: DensityFile,
    streaks: StreaksFile,
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StrokeFile {
    name: String,
    seed: u64,
    from_m: [f64; 3],
    to_m: [f64; 3],
    segment_m: Option<f64>,
    turn_deg: Option<f64>,
    wander: Option<f64>,
    branching: Option<f64>,
    branch_deg: Option<f64>,
    branch_length: Option<f64>,
    max_order: Option<u8>,
    branch_intensity: Option<f64>,
    #[serde(rename = "intensity_W_per_sr")]
    intensity: f64,
    color: Option<[f32; 3]>,
}

/// Reads a recipe's text.
pub(super) fn read(path: &Path, text: String) -> Result<Recipe, BakeError> {
    let source = Source { file: path, text: without_mark(&text) };
    let file: RecipeFile = toml::from_str(source.text).map_err(|error| source.refused_text(&error))?;
    let has_strokes = !file.strokes.is_empty();
    let clouds = file.clouds.map(|clouds| clouds.check(has_strokes, &source)).transpose()?;
    let rain = file.rain.map(|rain| rain.check(&source)).transpose()?;
    let mut strokes: Vec<StrokeRecord> = Vec::new();
    for (number, stroke) in file.strokes.into_iter().enumerate() {
        let span = stroke.span();
        let record = stroke.into_inner().record();
        let table = ["strokes", &number.to_string()];
        record
            .check()
            .map_err(|(field, wanted, found)| source.refused(&table, field, wanted, found, span.clone()))?;
        if strokes.iter().any(|other| other.name == record.name) {
            let found = format!("`{}` twice", record.name);
            return Err(source.error(span, "strokes.name", "each name once", found).into());
        }
        strokes.push(record);
    }
    if let Some(clouds) = &clouds {
        check_held_out(clouds, !strokes.is_empty(), &source)?;
    }
    let town = file.town.map(|town| source.beside("town.file", &town.file)).transpose()?;
    if clouds.is_none() && rain.is_none() && strokes.is_empty() && town.is_none() {
        let wanted = "at least one of [clouds], [rain], [town] and [[strokes]]";
        return Err(source.error(0..0, "recipe", wanted, "none of them").into());
    }
    let names: Vec<String> = strokes.iter().map(|record| record.name.clone()).collect();
    let view = file.view.map(|view| check_view(view, &source, &names)).transpose()?;
    if let (Some(view), Some(clouds)) = (&view, &clouds)
        && let Some(view_region) = &clouds.response.view_region
        && !view_region.contains(view.camera.position_m)
    {
        let span = source.locate(&["view", "position_m"]).unwrap_or(0..0);
        let ViewRegion { low_m, high_m } = view_region;
        let wanted = format!("within [{}], {low_m:?} to {high_m:?}", clouds.keys.view_region);
        let found = format!("{:?}", view.camera.position_m);
        return Err(source.error(span, "view.position_m", wanted, found).into());
    }
    if let (Some(view), None) = (&view, &rain)
        && view.rain.rate_mm_per_h > 0.0
    {
        let span = source.locate(&["view", "rain", "rate_mm_per_h"]).unwrap_or(0..0);
        let wanted = "0 in a recipe without [rain]";
        let found = view.rain.rate_mm_per_h;
        return Err(source.error(span, "view.rain.rate_mm_per_h", wanted, found.to_string()).into());
    }
    Ok(Recipe { file: path.to_owned(), text, clouds, rain, strokes, town, view })
}

/// Refuses what nothing could confirm: a budget without held-out strokes, virtual lights pruned to strokes that are not there.
fn check_held_out(clouds: &Clouds, has_strokes: bool, source: &Source) -> Result<(), RecipeError> {
    if clouds.budget.needs_held_out() && clouds.held_out_strokes == 0 {
        let span = source.locate(&["clouds", "response", "test_strokes"]).unwrap_or(0..0);
        let wanted = "at least 1 beside [clouds.budget]";
        return Err(source.error(span, "clouds.response.test_strokes", wanted, 0));
    }
    if clouds.lights.prune && !has_strokes {
        let span = source.locate(&["clouds", "lightning", "prune"]).unwrap_or(0..0);
        return Err(source.error(span, "clouds.lightning.prune", "[[strokes]] to prune to", "none"));
    }
    Ok(())
}

fn check_view(
    view: Spanned<ViewFile>,
    source: &Source,
    strokes: &[String],
) -> Result<ViewSection, RecipeError> {
    let span = view.span();
    view.into_inner().check(source, span, strokes)
}

/// Reads a file that holds a view alone.
pub(super) fn read_view(path: &Path, text: &str, strokes: &[String]) -> Result<ViewSection, BakeError> {
    let source = Source { file: path, text: without_mark(text) };
    let file: ViewAlone = toml::from_str(source.text).map_err(|error| source.refused_text(&error))?;
    Ok(check_view(file.view, &source, strokes)?)
}

impl Source<'_> {
    /// `value` if it lies in [low, high], or `default`.
    pub(super) fn number(
        &self,
        field: &str,
        value: &Option<Number>,
        default: f64,
        [low, high]: [f64; 2],
        unit: &str,
    ) -> Result<f64, RecipeError> {
        let Some(value) = value else { return Ok(default) };
        let number = *value.get_ref();
        if number >= low && number <= high {
            return Ok(number);
        }
        let wanted = format!("{low} to {high}{}{unit}", if unit.is_empty() { "" } else { " " });
        Err(self.error(value.span(), field, wanted, number))
    }

    /// Like [`Source::number`], nothing where the recipe says nothing.
    pub(super) fn optional(
        &self,
        field: &str,
        value: &Option<Number>,
        range: [f64; 2],
        unit: &str,
    ) -> Result<Option<f64>, RecipeError> {
        value.as_ref().map(|_| self.number(field, value, 0.0, range, unit)).transpose()
    }

    /// Like [`Source::number`], for whole numbers.
    pub(super) fn count(
        &self,
        field: &str,
        value: &Option<Number>,
        default: u32,
        [low, high]: [u32; 2],
    ) -> Result<u32, RecipeError> {
        let number = self.number(field, value, f64::from(default), [f64::from(low), f64::from(high)], "")?;
        match value {
            Some(value) if number != number.floor() => {
                Err(self.error(value.span(), field, "a whole number", number))
            }
            _ => Ok(number as u32),
        }
    }

    /// A rising pair inside [low, high], or `default`.
    pub(super) fn range(
        &self,
        field: &str,
        value: &Option<Spanned<[f64; 2]>>,
        default: [f64; 2],
        [low, high]: [f64; 2],
        unit: &str,
    ) -> Result<[f64; 2], RecipeError> {
        let Some(value) = value else { return Ok(default) };
        let pair = *value.get_ref();
        if low <= pair[0] && pair[0] < pair[1] && pair[1] <= high {
            return Ok(pair);
        }
        let wanted = format!("two rising numbers within {low} to {high} {unit}");
        Err(self.error(value.span(), field, wanted, format!("{pair:?}")))
    }

    /// A file beside the recipe, which must be there.
    pub(super) fn beside(&self, field: &str, name: &Spanned<PathBuf>) -> Result<PathBuf, RecipeError> {
        let path = beside(self.file, name.get_ref());
        if path.is_file() {
            return Ok(path);
        }
        let why = match std::fs::metadata(&path) {
            Ok(metadata) if metadata.is_dir() => "a folder",
            Ok(_) => "neither a file nor a folder",
            Err(error) if error.kind() == std::io::ErrorKind::PermissionDenied => {
                "out of reach (no permission)"
            }
            Err(_) => "not there",
        };
        Err(self.error(name.span(), field, "a file", format!("{}, which is {why}", path.display())))
    }

    pub(super) fn directions(&self, value: &Spanned<String>) -> Result<Quadrature, RecipeError> {
        parse_directions(value.get_ref()).ok_or_else(|| {
            let wanted = "\"14\", \"26\" or \"50\" (Lebedev), or polar nodes × azimuths, such as \"4x16\"";
            self.error(
                value.span(),
                "clouds.transport.directions",
                wanted,
                format!("\"{}\"", value.get_ref()),
            )
        })
    }
}

impl RainFile {
    fn check(&self, source: &Source) -> Result<Rain, RecipeError> {
        let (density, usual) = (&self.density, DensitySpec::default());
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
        let spec = DensitySpec {
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
        };
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
        Ok(Rain {
            pictures,
            layer,
            fit: FitSettings { method, cosines },
            psnr_db,
            method_given,
            density: spec,
        })
    }
}

impl StrokeFile {
    fn record(self) -> StrokeRecord {
        let usual = StrokeRecord::usual();
        let mut record = StrokeRecord {
            name: self.name,
            seed: self.seed,
            from_m: self.from_m,
            to_m: self.to_m,
            segment_m: 0.0,
            turn_rad: self.turn_deg.map_or(usual.turn_rad, f64::to_radians),
            wander: self.wander.unwrap_or(usual.wander),
            branching: self.branching.unwrap_or(usual.branching),
            branch_rad: self.branch_deg.map_or(usual.branch_rad, f64::to_radians),
            branch_length: self.branch_length.unwrap_or(usual.branch_length),
            max_order: self.max_order.unwrap_or(usual.max_order),
            branch_intensity: self.branch_intensity.unwrap_or(usual.branch_intensity),
            intensity_w_per_sr: self.intensity,
            color: self.color.unwrap_or(usual.color),
        };
        record.segment_m = self.segment_m.unwrap_or(record.length() / 100.0);
        record
    }
}
