//! What light on blocks of cells costs.

use crate::error::BakeError;
use crate::evaluate::RelitError;
use crate::evaluate::views::Views;
use crate::progress::Progress;
use crate::recipe::model::ResponseSettings;
use crate::response::solve_held_out;
use squall_formats::section::provenance::BudgetRecord;
use squall_formats::section::response::DirectTerm;
use squall_runtime::relight::{
    PointLight, RelightBuffers, RelightOptions, Relighter, Relit, view_region_frame,
};

/// Relative L2 error of `lights` relit from `relighter`'s bytes and read between the middles of its cells, against the same lights
/// solved on the cloud's own cells; all light, direct light alike on both sides where the runtime adds it.
///
/// Errors: lights that the rows do not reach, a solve that does not converge, an interruption.
pub(super) fn error_of(
    relighter: &Relighter,
    settings: &ResponseSettings,
    lights: &[PointLight],
    progress: &dyn Progress,
) -> Result<f64, BakeError> {
    let shown = relighter.cloud();
    let settings = ResponseSettings { refine: 1, ..*settings };
    let truth = solve_held_out(shown, &settings, &[lights.to_vec()], None, progress)?;
    let Some(truth) = truth.into_iter().next() else { return Ok(0.0) };
    let known = relighter.known_cells();
    let seen = |cell: usize| known[cell] && (truth.seen.is_empty() || truth.seen[cell]);
    let views = Views::new(shown, relighter.view_region(), 0, seen);
    let (wanted, direct) = views.truth(&truth, relighter.direct());
    let mut buffers = RelightBuffers::default();
    let relit = relighter.relight(lights, RelightOptions::default(), &mut buffers)?;
    let mut planes = Vec::with_capacity(relit.planes.len());
    for plane in relit.planes.chunks_exact(relit.cells) {
        let mut cells = vec![0.0; shown.shape.len()];
        relighter.spread(plane, &mut cells);
        planes.append(&mut cells);
    }
    let frame = relighter.view_region().map(|region| view_region_frame(region, shown));
    let factors = views.factors(relit.basis, frame.as_ref());
    let spread = Relit { cells: shown.shape.len(), planes: &planes, ..relit };
    let mut found = views.light(&spread, &factors);
    if relighter.direct() == DirectTerm::AtRunTime {
        found.iter_mut().zip(&direct).for_each(|(sum, value)| *sum += value);
    }
    let RelitError { l2, .. } = views.compare(&found, &wanted);
    Ok(l2)
}

/// The record of that.
pub(super) fn record(error: f64, chosen: String) -> BudgetRecord {
    BudgetRecord {
        part: "light cells".into(),
        metric: "L2 of a held-out stroke's light on blocks of cells, against a solve on the shown cells"
            .into(),
        asked: None,
        got: error,
        chosen,
        next_better: None,
        next_cheaper: None,
    }
}
