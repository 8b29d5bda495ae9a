//! What sections hold, in JSON: docs/json.md, "inspect".

use super::super::json;
use serde_json::{Value, json};
use squall_formats::section::bolt::BoltSection;
use squall_formats::section::cloud::CloudSection;
use squall_formats::section::provenance::InputRecord;
use squall_formats::section::response::{
    Codec, DirectTerm, DirectionalBasis, DistantKind, NO_ROW, ResponseHead, ResponseSection,
};
use squall_formats::section::view::ViewSection;
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
    });
    let region = head.view_region.map(|region| json!({ "low_m": region.low_m, "high_m": region.high_m }));
    let cells = head.shape.len();
    Ok(json!({
        "light_grid": grid.map(|(grid, _)| grid.axes().map(<[f64]>::len)),
        "bounds_m": grid.map(|(grid, _)| grid.bounds()),
        "virtual_lights": baked,
        "prune": grid.zip(baked).map(|((_, rows), baked)| baked < rows.len()),
        "share_of_bounds": grid.map(|_| share_of_bounds(&head)),
        "distant": distant.collect::<Vec<_>>(),
        "basis": basis,
        "degree": degree,
        "coefficients": head.basis.count(),
        "direct": match head.direct {
            DirectTerm::InRows => "rows",
            DirectTerm::AtRunTime => "run-time",
        },
        "codec": match head.codec {
            Codec::Bytes => "bytes",
            Codec::Paper => "paper",
        },
        "view_region": region,
        "cells": cells,
        "lit_cells": (0..cells).filter(|&cell| head.sees(cell)).count(),
    }))
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

/// Share of the light grid's box in which a point light can be relit from rows: the volume between eight nodes that all have one. An axis of a
/// single node counts as one interval.
pub fn share_of_bounds(head: &ResponseHead) -> f64 {
    let Some((grid, rows)) = head.sources.light_grid() else { return 0.0 };
    let [x_m, y_m, z_m] = grid.axes();
    let intervals = |axis: &[f64]| -> Vec<([usize; 2], f64)> {
        match axis {
            [_] => vec![([0, 0], 1.0)],
            _ => axis.windows(2).enumerate().map(|(at, ends)| ([at, at + 1], ends[1] - ends[0])).collect(),
        }
    };
    let has_row = |x: usize, y: usize, z: usize| {
        rows.get(x + x_m.len() * (y + y_m.len() * z)).is_some_and(|&row| row != NO_ROW)
    };
    let (mut lit, mut whole) = (0.0, 0.0);
    for (z, depth) in intervals(z_m) {
        for (y, height) in intervals(y_m) {
            for (x, width) in intervals(x_m) {
                let volume = width * height * depth;
                let all = z.iter().all(|&z| y.iter().all(|&y| x.iter().all(|&x| has_row(x, y, z))));
                whole += volume;
                lit += if all { volume } else { 0.0 };
            }
        }
    }
    if whole > 0.0 { lit / whole } else { 0.0 }
}
