//! The order of a response's rows, and the batches that they are solved in.

use super::job::{Job, SolveCells, Sources};
use crate::error::BakeError;
use glam::DVec3;
use squall_formats::section::response::{
    DistantKind, DistantSource, NO_ROW, ResponseHead, SolverRecord, SourceBasis, Stored, pack_seen,
};
use squall_runtime::transport::direct::Light;
use squall_runtime::transport::quadrature::Quadrature;

/// Lights solved side by side.
pub const BATCH: usize = 16;

/// Neighbouring rows that are solved side by side.
pub(super) struct Part {
    /// Number of the first row.
    pub(super) first: u32,
    /// Lights of each row.
    pub(super) lights: Vec<Vec<Light>>,
    /// Whether their direct light goes into the rows.
    pub(super) in_rows: bool,
}

/// All rows in batches: virtual lights first, then distant light in batches of its own, which keeps its direct light, then beams of
/// the sun, which never do.
///
/// Errors: none that a fixed direction set brings about.
pub(super) fn parts(sources: &Sources, in_rows: bool) -> Result<Vec<Part>, BakeError> {
    let grid = &sources.lights;
    let light = |node: usize| vec![Light::Point { position: grid.position(node), intensity: 1.0 }];
    let lights: Vec<Vec<Light>> = wanted_nodes(sources).map(light).collect();
    let is_sun = |kind: &DistantKind| matches!(kind, DistantKind::Sun { .. });
    let suns = sources.distant.iter().position(is_sun).unwrap_or(sources.distant.len());
    debug_assert!(sources.distant[suns..].iter().all(is_sun), "beams of the sun stand last");
    let of = |kinds: &[DistantKind]| -> Result<Vec<Vec<Light>>, BakeError> {
        kinds.iter().map(|&kind| distant_lights(kind)).collect()
    };
    let (sky, suns) = (of(&sources.distant[..suns])?, of(&sources.distant[suns..])?);
    let mut parts = Vec::new();
    for (lights, first, in_rows) in
        [(&lights, 0, in_rows), (&sky, lights.len(), true), (&suns, lights.len() + sky.len(), false)]
    {
        parts.extend(lights.chunks(BATCH).enumerate().map(|(at, chunk)| Part {
            first: (first + at * BATCH) as u32,
            lights: chunk.to_vec(),
            in_rows,
        }));
    }
    Ok(parts)
}

fn wanted_nodes(sources: &Sources) -> impl Iterator<Item = usize> {
    let grid = &sources.lights;
    (0..grid.len()).filter(|&node| grid.is_wanted(node))
}

/// The head of a job's section before anything is solved: rows are numbered, what solving finds is still zero. `seen` are the
/// cells that are stored; all where `None`.
pub(super) fn planned_head(
    (job, cells): (&Job<'_>, &SolveCells),
    extinction_scale: f64,
    seen: Option<&[bool]>,
) -> ResponseHead {
    let (sources, settings) = (job.sources, job.settings);
    let grid = &sources.lights;
    let mut node_rows = vec![NO_ROW; grid.len()];
    let mut rows = 0;
    for node in wanted_nodes(sources) {
        node_rows[node] = rows;
        rows += 1;
    }
    ResponseHead {
        shape: job.cloud.shape,
        sources: SourceBasis::LightGrid { grid: grid.grid.clone(), rows: node_rows },
        distant: (rows..).zip(&sources.distant).map(|(row, &kind)| DistantSource { kind, row }).collect(),
        basis: settings.basis,
        direct: settings.direct,
        codec: settings.codec,
        solver: SolverRecord {
            refine: cells.factors,
            directions: directions_record(settings.solve.quadrature),
            scheme: settings.solve.scheme,
            extinction_scale,
            tolerance: settings.solve.tolerance,
            worst_residual: 0.0,
            most_sweeps: 0,
        },
        view_region: settings.view_region,
        seen: seen.map(pack_seen),
        sun: sources.sun.clone(),
        entropy: None,
        stored: if cells.fit.is_some() { Stored::Fit } else { Stored::Means },
        finer: Vec::new(),
    }
}

/// Beams that together are distant light of unit strength: for a hemisphere, one a direction of a fine set.
fn distant_lights(kind: DistantKind) -> Result<Vec<Light>, BakeError> {
    let downward = match kind {
        DistantKind::Beam { direction } | DistantKind::Sun { direction } => {
            return Ok(vec![Light::Beam { direction: DVec3::from_array(direction), irradiance: 1.0 }]);
        }
        DistantKind::UpperSky => true,
        DistantKind::LowerSky => false,
    };
    let set = Quadrature::DoubleGauss { polar: 3, azimuths: 12 }.ordinates()?;
    let mine = set.iter().filter(|o| (o.direction[2] < 0.0) == downward);
    Ok(mine
        .map(|o| Light::Beam {
            direction: DVec3::from_array(o.direction),
            irradiance: 4.0 * std::f64::consts::PI * o.weight,
        })
        .collect())
}

/// How [`SolverRecord`] writes a direction set down.
fn directions_record(set: Quadrature) -> [u8; 2] {
    match set {
        Quadrature::Lebedev14 => [0, 14],
        Quadrature::Lebedev26 => [0, 26],
        Quadrature::Lebedev50 => [0, 50],
        Quadrature::DoubleGauss { polar, azimuths } => [polar, azimuths],
    }
}
