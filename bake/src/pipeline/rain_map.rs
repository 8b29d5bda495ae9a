//! Where rain is: a map from a file, or from the water in a cloud's columns.

use super::stage::{Clock, StageOutput};
use crate::error::BakeError;
use crate::input::npy::{is_npy, read_npy};
use crate::input::picture::{grey_of, picture_file};
use crate::input::scene::read_scene;
use crate::input::{Fingerprint, Input};
use crate::provenance::input_record;
use crate::recipe::ends_in;
use crate::recipe::model::{Rain, RainMapSource, RainMapSpec, Recipe, Shower};
use squall_formats::section::rain_place::{MOST_SIDE, RainMapRecord, RainPlaceSection};
use squall_runtime::transport::Cloud;
use std::path::Path;

/// The section of where rain is, if the recipe says anything of it.
///
/// Errors: a map that is missing, damaged, of another size or without rain; a cloud without water.
pub(super) fn place(recipe: &Recipe, rain: &Rain) -> Result<StageOutput, BakeError> {
    if rain.map.is_none() && rain.farthest_m.is_none() {
        return Ok(StageOutput::default());
    }
    let clock = Clock::start();
    let mut inputs = Vec::new();
    let map = match &rain.map {
        None => None,
        Some(spec) => {
            let (map, input) = map(recipe, spec)?;
            inputs.extend(input.map(|input| input_record(recipe, &input)));
            Some(map)
        }
    };
    let made = map.as_ref().map_or_else(
        || "no map".to_owned(),
        |map| {
            let wet = map.steps.iter().filter(|steps| **steps > 0).count();
            format!("{} × {} cells, {wet} of them wet", map.size[0], map.size[1])
        },
    );
    let section = RainPlaceSection { farthest_m: rain.farthest_m, map };
    // What the reader would refuse is refused here, where the recipe is known.
    section.check().map_err(|(field, wanted, found)| {
        BakeError::input(&recipe.file, format!("rain.{field}"), wanted, found)
    })?;
    let section = section.write();
    let report = clock.report("place of rain", made, section.length(), "rates within 1/65535".into());
    Ok(StageOutput { sections: vec![section], inputs, reports: vec![report], ..StageOutput::default() })
}

fn map(recipe: &Recipe, spec: &RainMapSpec) -> Result<(RainMapRecord, Option<Fingerprint>), BakeError> {
    let (map, input) = map_alone(recipe, spec)?;
    let showered = with_showers(map, &spec.showers).ok_or_else(|| {
        let wanted = format!("a map of at most {MOST_SIDE} cells a side with its showers");
        BakeError::input(&recipe.file, "rain.map.showers", wanted, "more")
    })?;
    Ok((showered, input))
}

/// The map with showers, larger where they reach beyond it; `None` where that is too large.
fn with_showers(map: RainMapRecord, showers: &[Shower]) -> Option<RainMapRecord> {
    if showers.is_empty() {
        return Some(map);
    }
    // Whole cells on each side.
    let mut beyond = [[0.0f64; 2]; 2];
    for shower in showers {
        let reach = shower.radius_m + shower.softness_m;
        for axis in 0..2 {
            let low = (shower.centre_m[axis] - reach - map.origin_m[axis]) / map.cell_m;
            let high = (shower.centre_m[axis] + reach - map.origin_m[axis]) / map.cell_m;
            beyond[axis][0] = beyond[axis][0].max((-low).ceil());
            beyond[axis][1] = beyond[axis][1].max((high - f64::from(map.size[axis])).ceil());
        }
    }
    let size = [0, 1].map(|axis| f64::from(map.size[axis]) + beyond[axis][0] + beyond[axis][1]);
    if size.iter().any(|side| *side > f64::from(MOST_SIDE)) {
        return None;
    }
    let size = size.map(|side| side as u32);
    let skipped = beyond.map(|ends| ends[0] as u32);
    let origin_m = [0, 1].map(|axis| map.origin_m[axis] - beyond[axis][0] * map.cell_m);
    let own = map.rates();
    let rates: Vec<f32> = (0..size[0] * size[1])
        .map(|at| {
            let cell = [at % size[0], at / size[0]];
            let inner = [0, 1].map(|axis| cell[axis].wrapping_sub(skipped[axis]));
            let within = inner[0] < map.size[0] && inner[1] < map.size[1];
            let mut rate = if within { own[(inner[1] * map.size[0] + inner[0]) as usize] } else { 0.0 };
            for shower in showers {
                let [dx, dy] = [0, 1].map(|axis| {
                    origin_m[axis] + (f64::from(cell[axis]) + 0.5) * map.cell_m - shower.centre_m[axis]
                });
                let outside = (dx * dx + dy * dy).sqrt() - shower.radius_m;
                let share = if outside <= 0.0 {
                    1.0
                } else if outside < shower.softness_m {
                    1.0 - outside / shower.softness_m
                } else {
                    0.0
                };
                rate = rate.max((shower.rate_mm_per_h * share) as f32);
            }
            rate
        })
        .collect();
    let (heaviest_mm_per_h, steps) = RainMapRecord::quantise(&rates);
    Some(RainMapRecord { origin_m, size, heaviest_mm_per_h, steps, ..map })
}

fn map_alone(recipe: &Recipe, spec: &RainMapSpec) -> Result<(RainMapRecord, Option<Fingerprint>), BakeError> {
    match &spec.source {
        RainMapSource::File { path, cells, origin_m, cell_m } => {
            let (size, rates, input) = read(path, *cells)?;
            let rates = scaled(rates, spec.rate_mm_per_h);
            let top_m = spec.top_m.map(|top| [top, spec.softness_m]);
            let (heaviest_mm_per_h, steps) = RainMapRecord::quantise(&rates);
            let (origin_m, cell_m) = (*origin_m, *cell_m);
            Ok((RainMapRecord { origin_m, cell_m, size, heaviest_mm_per_h, top_m, steps }, Some(input)))
        }
        RainMapSource::Cloud { least_water } => {
            let Some(clouds) = &recipe.clouds else {
                return Err(BakeError::input(
                    &recipe.file,
                    "rain.map.from",
                    "a recipe with [clouds]",
                    "none",
                ));
            };
            let cloud = read_scene(&clouds.scene, clouds.optics)?.cloud;
            let map = under_cloud(&cloud, *least_water, spec);
            let none = || BakeError::input(&clouds.scene, "cloud", "water in some column", "none");
            Ok((map.ok_or_else(none)?, None))
        }
    }
}

/// Rates scaled to a heaviest one, where it is given.
fn scaled(mut rates: Vec<f32>, heaviest: Option<f64>) -> Vec<f32> {
    let peak = rates.iter().fold(0.0f32, |most, rate| most.max(*rate));
    if let (Some(heaviest), true) = (heaviest, peak > 0.0) {
        let factor = heaviest / f64::from(peak);
        rates.iter_mut().for_each(|rate| *rate = (f64::from(*rate) * factor) as f32);
    }
    rates
}

/// Size and rates of a map's file, y upwards.
fn read(path: &Path, cells: Option<[u32; 2]>) -> Result<([u32; 2], Vec<f32>, Fingerprint), BakeError> {
    let Some([columns, rows]) = cells else {
        if ends_in(path, "npy") {
            return read_array(path);
        }
        let input = picture_file(path)?;
        let picture = grey_of(&input, None)?.picture;
        let size = [picture.width, picture.height];
        if size.iter().any(|side| *side > MOST_SIDE as usize) {
            let wanted = format!("at most {MOST_SIDE} pixels a side");
            return Err(BakeError::input(path, "picture", wanted, format!("{} × {}", size[0], size[1])));
        }
        // A picture's first row is on top, and a map's is where y is least.
        let rates = picture.pixels.chunks(size[0]).rev().flatten().copied().collect();
        return Ok((size.map(|side| side as u32), rates, input.fingerprint()));
    };
    let wanted = u64::from(columns) * u64::from(rows) * 4;
    let input = Input::read(path, wanted.max(1 << 20))?;
    if input.bytes.len() as u64 != wanted {
        let words = format!("{wanted} bytes: {columns} × {rows} numbers of single precision");
        return Err(BakeError::input(path, "rain.map.cells", words, format!("{} bytes", input.bytes.len())));
    }
    let (numbers, _) = input.bytes.as_chunks::<4>();
    let rates: Vec<f32> = numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    check_rates(path, columns as usize, &rates)?;
    Ok(([columns, rows], rates, input.fingerprint()))
}

/// The same of a NumPy array: rows and columns of mm/h, its first row where y is least.
fn read_array(path: &Path) -> Result<([u32; 2], Vec<f32>, Fingerprint), BakeError> {
    let side = u64::from(MOST_SIDE);
    // As many doubles as there may be, and a header.
    let input = Input::read(path, side * side * 8 + (1 << 17))?;
    if !is_npy(&input) {
        return Err(BakeError::input(path, "format", "NumPy's .npy", input.kind()));
    }
    let array = read_npy(&input)?;
    if array.width.max(array.height) > MOST_SIDE as usize {
        let found = format!("{} × {}", array.width, array.height);
        return Err(BakeError::input(path, "npy shape", format!("at most {MOST_SIDE} cells a side"), found));
    }
    let rates: Vec<f32> = array.values.iter().map(|value| *value as f32).collect();
    check_rates(path, array.width, &rates)?;
    Ok(([array.width as u32, array.height as u32], rates, input.fingerprint()))
}

fn check_rates(path: &Path, columns: usize, rates: &[f32]) -> Result<(), BakeError> {
    if let Some(at) = rates.iter().position(|rate| !(*rate >= 0.0 && *rate <= 1e30)) {
        let field = format!("cell {} × {}", at % columns, at / columns);
        return Err(BakeError::input(path, field, "a rate of 0 mm/h or more", rates[at]));
    }
    if rates.iter().all(|rate| *rate == 0.0) {
        return Err(BakeError::input(path, "rates", "rain somewhere", "0 mm/h in every cell"));
    }
    Ok(())
}

/// Share of the rain that falls from a height at or below the map's top.
const BELOW_TOP: f64 = 0.9;

/// Rain under a cloud: none where a column holds less than `least_water` of the wettest one's water, and beyond that growing
/// linearly with it, as drops grow out of cloud water above a threshold \[kessler\]; the wettest column has the map's rate. Water is
/// extinction summed over height, because droplets of one size scatter in proportion to it.
fn under_cloud(cloud: &Cloud, least_water: f64, spec: &RainMapSpec) -> Option<RainMapRecord> {
    let [nx, ny, nz] = cloud.shape.to_array();
    let mut columns = vec![0.0f64; nx * ny];
    let mut bases = vec![nz; nx * ny];
    for k in 0..nz {
        for (at, column) in columns.iter_mut().enumerate() {
            let extinction = f64::from(cloud.extinction[k * nx * ny + at]);
            *column += extinction;
            if extinction > 0.0 {
                bases[at] = bases[at].min(k);
            }
        }
    }
    let wettest = columns.iter().copied().fold(0.0, f64::max);
    if wettest <= 0.0 {
        return None;
    }
    let least = least_water * wettest;
    let rain = |column: f64| ((column - least) / (wettest - least)).max(0.0);
    // The height that most of the rain falls from.
    let mut by_height = vec![0.0; nz];
    for (column, base) in columns.iter().zip(&bases).filter(|(_, base)| **base < nz) {
        by_height[*base] += rain(*column);
    }
    let whole: f64 = by_height.iter().sum();
    let mut below = 0.0;
    let base = by_height.iter().position(|rain| {
        below += rain;
        below >= BELOW_TOP * whole
    });
    let height = cloud.origin_m.z + base.unwrap_or(0) as f64 * cloud.cell_m[2];
    let cell_m = cloud.cell_m[0].min(cloud.cell_m[1]);
    let sides = [nx, ny].map(|side| side as f64);
    let size = [0, 1].map(|axis| {
        let cells = (sides[axis] * cloud.cell_m[axis] / cell_m - 1e-6).ceil();
        cells.clamp(1.0, f64::from(MOST_SIDE)) as u32
    });
    let rates: Vec<f32> = (0..size[0] * size[1])
        .map(|at| {
            let middle = [at % size[0], at / size[0]].map(|cell| (f64::from(cell) + 0.5) * cell_m);
            let column =
                [0, 1].map(|axis| ((middle[axis] / cloud.cell_m[axis]) as usize).min([nx, ny][axis] - 1));
            rain(columns[column[1] * nx + column[0]]) as f32
        })
        .collect();
    let (heaviest_mm_per_h, steps) = RainMapRecord::quantise(&scaled(rates, spec.rate_mm_per_h));
    Some(RainMapRecord {
        origin_m: [cloud.origin_m.x, cloud.origin_m.y],
        cell_m,
        size,
        heaviest_mm_per_h,
        top_m: Some([spec.top_m.unwrap_or(height), spec.softness_m]),
        steps,
    })
}

#[cfg(test)]
mod tests;
