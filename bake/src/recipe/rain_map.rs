//! `[rain.map]` of a recipe, as it is typed and checked.

use super::model::{RainMapSource, RainMapSpec, Shower};
use super::number::Number;
use super::place::Source;
use crate::error::RecipeError;
use serde::Deserialize;
use squall_formats::section::rain_place::MOST_SIDE;
use std::path::{Path, PathBuf};
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RainMapFile {
    file: Option<Spanned<PathBuf>>,
    from: Option<Spanned<String>>,
    cells: Option<Spanned<[u32; 2]>>,
    origin_m: Option<Spanned<[f64; 2]>>,
    cell_m: Option<Number>,
    rate_mm_per_h: Option<Number>,
    top_m: Option<Number>,
    top_softness_m: Option<Number>,
    least_water: Option<Number>,
    #[serde(default)]
    showers: Vec<Spanned<ShowerFile>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ShowerFile {
    centre_m: [f64; 2],
    radius_m: Number,
    softness_m: Option<Number>,
    rate_mm_per_h: Number,
}

/// Share of the wettest column's water below which a column rains nothing, where a recipe says none.
const LEAST_WATER: f64 = 0.3;

impl RainMapFile {
    pub(super) fn check(&self, source: &Source, has_cloud: bool) -> Result<RainMapSpec, RecipeError> {
        let key = |name: &str| format!("rain.map.{name}");
        let whole = || source.locate(&["rain", "map"]).unwrap_or(0..0);
        let rate = source.optional(&key("rate_mm_per_h"), &self.rate_mm_per_h, [1e-3, 1000.0], "mm/h")?;
        let top = source.optional(&key("top_m"), &self.top_m, [-1e6, 1e6], "m")?;
        let softness = source.number(&key("top_softness_m"), &self.top_softness_m, 100.0, [0.0, 1e6], "m")?;
        let needless = |name: &str, span: Option<std::ops::Range<usize>>, why: &str| match span {
            Some(span) => Err(source.error(span, key(name), why, "a value")),
            None => Ok(()),
        };
        let map = match (&self.file, &self.from) {
            (Some(file), None) => {
                needless("least_water", self.least_water.as_ref().map(Spanned::span), "nothing beside file")?;
                self.of_file(source, file)?
            }
            (None, Some(from)) if from.get_ref() == "cloud" => {
                if !has_cloud {
                    return Err(source.error(from.span(), key("from"), "a recipe with [clouds]", "none"));
                }
                let beside = "nothing beside from = \"cloud\"";
                needless("cells", self.cells.as_ref().map(Spanned::span), beside)?;
                needless("origin_m", self.origin_m.as_ref().map(Spanned::span), beside)?;
                needless("cell_m", self.cell_m.as_ref().map(Spanned::span), beside)?;
                let least =
                    source.number(&key("least_water"), &self.least_water, LEAST_WATER, [0.0, 0.999], "")?;
                RainMapSource::Cloud { least_water: least }
            }
            (None, Some(from)) => {
                let found = format!("\"{}\"", from.get_ref());
                return Err(source.error(from.span(), key("from"), "\"cloud\"", found));
            }
            (found, _) => {
                let found = if found.is_some() { "both" } else { "neither" };
                return Err(source.error(whole(), "rain.map", "one of file and from", found));
            }
        };
        let is_numbers = match &map {
            RainMapSource::File { path, cells, .. } => cells.is_some() || ends_in(path, "npy"),
            RainMapSource::Cloud { .. } => false,
        };
        if rate.is_none() && !is_numbers {
            let wanted = "the rate of the heaviest rain, mm/h";
            return Err(source.error(whole(), key("rate_mm_per_h"), wanted, "nothing"));
        }
        let showers =
            self.showers.iter().map(|shower| shower_of(source, shower)).collect::<Result<_, _>>()?;
        Ok(RainMapSpec { source: map, rate_mm_per_h: rate, top_m: top, softness_m: softness, showers })
    }

    fn of_file(&self, source: &Source, file: &Spanned<PathBuf>) -> Result<RainMapSource, RecipeError> {
        let path = source.beside("rain.map.file", file)?;
        let missing = |name: &str, wanted: &str| {
            source.error(file.span(), format!("rain.map.{name}"), wanted, "nothing")
        };
        let cells = match (&self.cells, ends_in(&path, "f32")) {
            (Some(cells), true) => {
                let sides = *cells.get_ref();
                if sides.iter().any(|side| !(1..=MOST_SIDE).contains(side)) {
                    let wanted = format!("two numbers of 1 to {MOST_SIDE}");
                    return Err(source.error(cells.span(), "rain.map.cells", wanted, format!("{sides:?}")));
                }
                Some(sides)
            }
            (None, true) => return Err(missing("cells", "cells along x and y of a .f32 file")),
            (Some(cells), false) => {
                let wanted = "nothing: only a .f32 file leaves its size open";
                return Err(source.error(cells.span(), "rain.map.cells", wanted, "a value"));
            }
            (None, false) => None,
        };
        let Some(origin) = &self.origin_m else {
            return Err(missing("origin_m", "the lowest corner, x and y in m"));
        };
        let origin_m = *origin.get_ref();
        if !origin_m.iter().all(|at| (-1e9..=1e9).contains(at)) {
            let found = format!("{origin_m:?}");
            return Err(source.error(origin.span(), "rain.map.origin_m", "two numbers within ±1e9 m", found));
        }
        if self.cell_m.is_none() {
            return Err(missing("cell_m", "the edge of a cell, m"));
        }
        let cell_m = source.number("rain.map.cell_m", &self.cell_m, 1.0, [1e-3, 1e7], "m")?;
        Ok(RainMapSource::File { path, cells, origin_m, cell_m })
    }
}

/// Whether a file's name ends so.
pub(crate) fn ends_in(path: &Path, end: &str) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case(end))
}

fn shower_of(source: &Source, shower: &Spanned<ShowerFile>) -> Result<Shower, RecipeError> {
    let file = shower.get_ref();
    if !file.centre_m.iter().all(|at| (-1e9..=1e9).contains(at)) {
        let (field, found) = ("rain.map.showers.centre_m", format!("{:?}", file.centre_m));
        return Err(source.error(shower.span(), field, "two numbers within ±1e9 m", found));
    }
    let number = |field: &str, value: &Option<Number>, default: f64, range: [f64; 2], unit: &str| {
        source.number(&format!("rain.map.showers.{field}"), value, default, range, unit)
    };
    Ok(Shower {
        centre_m: file.centre_m,
        radius_m: number("radius_m", &Some(file.radius_m.clone()), 0.0, [0.0, 1e7], "m")?,
        softness_m: number("softness_m", &file.softness_m, 0.0, [0.0, 1e7], "m")?,
        rate_mm_per_h: number(
            "rate_mm_per_h",
            &Some(file.rate_mm_per_h.clone()),
            0.0,
            [1e-3, 1000.0],
            "mm/h",
        )?,
    })
}
