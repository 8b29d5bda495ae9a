//! The recipe's text as it is typed, and its way to a checked [`Recipe`].

use super::clouds::CloudsFile;
use super::model::{Clouds, Rain, Recipe, SunWish};
use super::place::Source;
use super::rain::RainFile;
use super::scene::SceneFile;
use super::view::ViewFile;
use crate::error::{BakeError, RecipeError};
use crate::input::without_mark;
use glam::DVec3;
use serde::Deserialize;
use serde::de::IgnoredAny;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::response::{DistantKind, towards_sun};
use squall_formats::section::view::ViewSection;
use squall_formats::view_region::ViewRegion;
use std::path::{Path, PathBuf};
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RecipeFile {
    clouds: Option<CloudsFile>,
    rain: Option<RainFile>,
    #[serde(default)]
    strokes: Vec<Spanned<StrokeFile>>,
    town: Option<TownFile>,
    scene: Option<SceneFile>,
    place: Option<PlaceFile>,
    view: Option<Spanned<ViewFile>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TownFile {
    file: Spanned<PathBuf>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaceFile {
    origin_m: Spanned<[f64; 3]>,
}

/// A view in a file of its own, or in a whole recipe, whose other tables are another command's to check.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewAlone {
    view: Spanned<ViewFile>,
    #[serde(rename = "clouds")]
    _clouds: Option<IgnoredAny>,
    #[serde(rename = "rain")]
    _rain: Option<IgnoredAny>,
    #[serde(rename = "strokes")]
    _strokes: Option<IgnoredAny>,
    #[serde(rename = "town")]
    _town: Option<IgnoredAny>,
    #[serde(rename = "scene")]
    _scene: Option<IgnoredAny>,
    #[serde(rename = "place")]
    _place: Option<IgnoredAny>,
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
    let has_cloud = file.clouds.is_some();
    let mut clouds = file.clouds.map(|clouds| clouds.check(has_strokes, &source)).transpose()?;
    let rain = file.rain.map(|rain| rain.check(&source, has_cloud)).transpose()?;
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
    let place_m = file.place.map(|place| place.check(&source)).transpose()?;
    let town = file.town.map(|town| source.beside("town.file", &town.file)).transpose()?;
    let scene = file.scene.map(|scene| scene.check(&source)).transpose()?;
    if clouds.is_none() && rain.is_none() && strokes.is_empty() && town.is_none() && scene.is_none() {
        let wanted = "at least one of [clouds], [rain], [town], [scene] and [[strokes]]";
        return Err(source.error(0..0, "recipe", wanted, "none of them").into());
    }
    let names: Vec<String> = strokes.iter().map(|record| record.name.clone()).collect();
    let view = file.view.map(|view| check_view(view, &source, &names)).transpose()?;
    if let Some(clouds) = &mut clouds {
        light_by_sky(clouds, view.as_ref(), &source)?;
    }
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
    if let Some(view) = &view {
        check_view_rate(view, rain.as_ref(), &source)?;
    }
    Ok(Recipe { file: path.to_owned(), text, clouds, rain, strokes, town, scene, place_m, view })
}

/// Refuses a picture of more rain than the recipe's tables will hold, which no command could draw.
fn check_view_rate(view: &ViewSection, rain: Option<&Rain>, source: &Source) -> Result<(), RecipeError> {
    let rate = view.rain.rate_mm_per_h;
    let wanted = match rain {
        None if rate > 0.0 => "0 in a recipe without [rain]".to_owned(),
        Some(rain) if rate > rain.density.ranges.rate[1].0 => {
            let most = rain.density.ranges.rate[1].0;
            format!("0 to {most} mm/h, where rain.density.rate_mm_per_h ends")
        }
        _ => return Ok(()),
    };
    let span = source.locate(&["view", "rain", "rate_mm_per_h"]);
    let span = span.or_else(|| source.locate(&["view"])).unwrap_or(0..0);
    Err(source.error(span, "view.rain.rate_mm_per_h", wanted, rate.to_string()))
}

/// A recipe that frames a picture and says nothing of the sky's light on its cloud gets the light of the sky that the picture shows. A
/// sun "view" is the picture's.
///
/// Errors: that without a picture; a budget for a sun that the recipe has none of.
fn light_by_sky(clouds: &mut Clouds, view: Option<&ViewSection>, source: &Source) -> Result<(), RecipeError> {
    if view.is_some() && !clouds.given.sky {
        clouds.distant = vec![DistantKind::UpperSky, DistantKind::LowerSky];
        clouds.sun = Some(SunWish::View);
    }
    if let Some(SunWish::View) = clouds.sun {
        let Some(view) = view else {
            let span = source.locate(&["clouds", "response", "sun"]).unwrap_or(0..0);
            return Err(source.error(span, "clouds.response.sun", "a [view] beside \"view\"", "none"));
        };
        let towards = towards_sun(view.sky.sun_azimuth_rad, view.sky.sun_elevation_rad);
        clouds.sun = Some(SunWish::At(DVec3::from_array(towards)));
    }
    if clouds.budget.sun_l2.is_some() && clouds.sun.is_none() {
        let span = source.locate(&["clouds", "budget", "sun_l2"]).unwrap_or(0..0);
        let wanted = "sun in [clouds.response] beside it";
        return Err(source.error(span, "clouds.budget.sun_l2", wanted, "none"));
    }
    Ok(())
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

impl PlaceFile {
    fn check(self, source: &Source) -> Result<[f64; 3], RecipeError> {
        let origin_m = *self.origin_m.get_ref();
        if origin_m.iter().all(|at| at.abs() <= 1e9) {
            return Ok(origin_m);
        }
        let wanted = "three numbers, -1e9 to 1e9 m";
        Err(source.error(self.origin_m.span(), "place.origin_m", wanted, format!("{origin_m:?}")))
    }
}

/// Reads the view of a file that holds it alone, or of a recipe.
pub(super) fn read_view(path: &Path, text: &str, strokes: &[String]) -> Result<ViewSection, BakeError> {
    let source = Source { file: path, text: without_mark(text) };
    let file: ViewAlone = toml::from_str(source.text).map_err(|error| source.refused_text(&error))?;
    Ok(check_view(file.view, &source, strokes)?)
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
