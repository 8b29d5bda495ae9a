//! What sections hold, in JSON: docs/json.md, "inspect".

use super::super::json;
use serde_json::{Value, json};
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::provenance::InputRecord;
use squall_formats::section::response::{
    Codec, DirectTerm, DirectionalBasis, DistantKind, NO_ROW, ResponseSection, SunDirections,
};
use squall_formats::section::view::ViewSection;
use squall_runtime::relight::share_lit;
use squall_runtime::{Asset, RuntimeError};

/// A file that went in.
pub fn input(record: &InputRecord) -> Value {
    json!({ "name": record.name, "bytes": record.bytes, "blake3": json::hex(&record.hash) })
}

/// The cloud's grid.
pub fn grid(asset: &Asset) -> Result<Value, RuntimeError> {
    let head = asset.section(CloudSection::TAG, "the cloud grid", CloudSection::read)?.head;
    Ok(json!({
        "cells": head.shape.to_array(),
        "cell_m": head.cell_m,
        "origin_m": head.origin_m,
        "albedo": head.albedo,
        "g": head.g,
        "periodic_xy": head.periodic_xy,
    }))
}

/// The cloud's response: what rows there are and what they hold.
pub fn response(asset: &Asset) -> Result<Value, RuntimeError> {
    let head = asset.section(ResponseSection::TAG, "the cloud's response", ResponseSection::read)?.head;
    let grid = head.sources.light_grid();
    let baked = grid.map(|(_, rows)| rows.iter().filter(|&&row| row != NO_ROW).count());
    let (basis, degree) = match head.basis {
        DirectionalBasis::Directions26 => ("directions-26", None),
        DirectionalBasis::Harmonics { degree } => ("harmonics", Some(degree)),
        DirectionalBasis::ViewRegion { degree } => ("view-region", Some(degree)),
    };
    let distant = head.distant.iter().map(|source| match source.kind {
        DistantKind::UpperSky => json!({ "kind": "upper-sky", "direction": null }),
        DistantKind::LowerSky => json!({ "kind": "lower-sky", "direction": null }),
        DistantKind::Beam { direction } => json!({ "kind": "beam", "direction": direction }),
        DistantKind::Sun { direction } => json!({ "kind": "sun", "direction": direction }),
    });
    let region = head.view_region.map(|region| json!({ "low_m": region.low_m, "high_m": region.high_m }));
    let cells = head.shape.len();
    Ok(json!({
        "light_grid": grid.map(|(grid, _)| grid.axes().map(<[f64]>::len)),
        "bounds_m": grid.map(|(grid, _)| grid.bounds()),
        "virtual_lights": baked,
        "finer_levels": head.finer.iter().map(|level| json!({
            "light_grid": level.grid.axes().map(<[f64]>::len),
            "virtual_lights": level.nodes.len(),
            "windows": level.windows.len(),
        })).collect::<Vec<_>>(),
        "prune": grid.zip(baked).map(|((_, rows), baked)| baked < rows.len()),
        "share_of_bounds": grid.map(|_| share_lit(&head.sources)),
        "distant": distant.collect::<Vec<_>>(),
        "basis": basis,
        "degree": degree,
        "coefficients": head.basis.count(),
        "direct": match head.direct {
            DirectTerm::InRows => "rows",
            DirectTerm::AtRunTime => "run-time",
        },
        "codec": match head.codec {
            Codec::Entropy => "entropy",
            Codec::Bytes => "bytes",
            Codec::Paper => "paper",
        },
        "view_region": region,
        "sun": head.sun.as_ref().map(sun),
        "light_cells": head.shape.to_array(),
        "cells": cells,
        "lit_cells": (0..cells).filter(|&cell| head.sees(cell)).count(),
    }))
}

/// Where the sun may stand.
fn sun(directions: &SunDirections) -> Value {
    match directions {
        SunDirections::Rings { elevations_rad, counts } => json!({
            "kind": "rings",
            "elevations_deg": elevations_rad.iter().map(|ring| ring.to_degrees()).collect::<Vec<_>>(),
            "counts": counts,
        }),
        SunDirections::Path => json!({ "kind": "path", "elevations_deg": null, "counts": null }),
    }
}

/// The strokes, with the keys that SPEC.md gives them.
pub fn strokes(asset: &Asset) -> Result<Value, RuntimeError> {
    let section = asset.section(BoltSection::TAG, "strokes", BoltSection::read)?;
    Ok(serde_json::to_value(section.strokes).unwrap_or_default())
}

/// The recipe's own picture, with the keys that SPEC.md gives it.
pub fn view(asset: &Asset) -> Result<Value, RuntimeError> {
    let view = asset.section(ViewSection::TAG, "the view", ViewSection::read)?;
    Ok(serde_json::to_value(view).unwrap_or_default())
}
