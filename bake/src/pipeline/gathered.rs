//! What gathers at run time leave of the error of held-out strokes.

use crate::error::BakeError;
use crate::evaluate::RelitError;
use crate::evaluate::held_out::HeldOutSet;
use crate::progress::Progress;
use crate::recipe::model::ResponseSettings;
use crate::response::{HeldOutStroke, solve_held_out};
use squall_formats::section::provenance::BudgetRecord;
use squall_runtime::{Asset, Clouds};

/// Most gathers that are measured.
pub(super) const MOST: u32 = 2;

/// Errors after 1 to [`MOST`] gathers, relit from the asset's bytes. Where rows hold light for blocks of the cloud's cells, gathers bring it to the
/// cells, and it is those that the strokes are solved in to compare.
///
/// Errors: a damaged row, a solve that does not converge, an interruption.
pub(super) fn errors(
    asset: &Asset,
    (settings, strokes): (&ResponseSettings, &[HeldOutStroke]),
    progress: &dyn Progress,
) -> Result<Vec<RelitError>, BakeError> {
    let mut clouds = Clouds::new(asset)?;
    let relighter = clouds.relighter();
    let (cloud, region, direct) = (relighter.cloud(), relighter.view_region(), relighter.direct());
    let fine;
    let strokes = if relighter.is_coarse() {
        let lights: Vec<_> = strokes.iter().map(|stroke| stroke.lights.clone()).collect();
        let settings = ResponseSettings { refine: 1, ..*settings };
        fine = solve_held_out(cloud, &settings, &lights, None, progress)?;
        &fine
    } else {
        strokes
    };
    progress.begin("gathers", u64::from(MOST));
    let set = HeldOutSet::new(cloud, region, direct, strokes, 0);
    let mut errors = Vec::new();
    for gathers in 1..=MOST {
        progress.check()?;
        errors.push(set.gathered(&mut clouds, strokes, gathers)?);
        progress.advance(1);
    }
    Ok(errors)
}

/// Those in a few words.
pub(super) fn words(errors: &[RelitError]) -> String {
    let one = |(at, error): (usize, &RelitError)| {
        format!("{} gathers {:.1} %, median {:.1} %", at + 1, 100.0 * error.l2, 100.0 * error.median)
    };
    let all: Vec<String> = errors.iter().enumerate().map(one).collect();
    format!("stroke L2 after {}", all.join("; after "))
}

/// The records of those.
pub(super) fn records(errors: &[RelitError]) -> Vec<BudgetRecord> {
    let one = |(at, error): (usize, &RelitError)| {
        let record = |what: &str, got: f64| BudgetRecord {
            part: "lightning grid".into(),
            metric: format!("{what} after {} gathers at run time", at + 1),
            asked: None,
            got,
            chosen: "relit from the bytes".into(),
            next_better: None,
            next_cheaper: None,
        };
        [record("stroke L2, all light,", error.l2), record("median pointwise stroke error", error.median)]
    };
    errors.iter().enumerate().flat_map(one).collect()
}
