//! What a budget may choose among: spacings of virtual lights, bases of the rows and errors of their coding.

use super::lights::Site;
use crate::evaluate::Outcome;
use crate::recipe::model::Clouds;
use crate::response::visibility::stand_apart;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::view_region::MAX_VIEW_DEGREE;

/// The coarsest spacing is the longest side of the bounds over this; each next is finer by √2.
const COARSEST: f64 = 2.0;
const SPACINGS: usize = 14;
/// Errors of coding from the coarsest, each next finer by 2^¼.
const COARSEST_ERROR: f64 = 0.5;
const ERRORS: usize = 40;

/// A candidate and what came of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tried {
    /// Distance between virtual lights, m.
    pub(super) spacing_m: f64,
    /// Basis of the rows.
    pub(super) basis: DirectionalBasis,
    /// Error of coding.
    pub(super) error: f64,
    /// What it gave and took.
    pub(super) outcome: Outcome,
}

impl std::fmt::Display for Tried {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Outcome { scores, bytes, relight_ms, .. } = self.outcome;
        let setting = setting(self.spacing_m, self.basis, self.error);
        let (stroke, codec) = (100.0 * scores.stroke.l2, 100.0 * scores.codec.l2);
        let megabytes = bytes as f64 / 1e6;
        write!(
            f,
            "{setting}: stroke L2 {stroke:.2} %, relit L2 {codec:.2} %, {megabytes:.3} MB, counts for {relight_ms:.3} ms"
        )
    }
}

/// A setting in words.
pub(super) fn setting(spacing_m: f64, basis: DirectionalBasis, error: f64) -> String {
    let towards =
        if let DirectionalBasis::ViewRegion { .. } = basis { " towards the view region" } else { "" };
    let count = basis.count();
    let plural = if count == 1 { "coefficient" } else { "coefficients" };
    format!("virtual lights {spacing_m:.4} m apart, {count} {plural}{towards}, coded to {error:.3e}")
}

/// Spacings that may be chosen, m, from coarse to fine; one alone where there is nothing to choose.
pub(super) fn spacings(site: &Site<'_>) -> Vec<f64> {
    let (clouds, side) = (site.clouds, site.side());
    if clouds.given.spacing || clouds.budget.stroke_l2.is_none() && !clouds.budget.costs() {
        return vec![site.usual_spacing_m()];
    }
    (0..SPACINGS).map(|i| side / COARSEST * libm::exp2(-0.5 * i as f64)).collect()
}

/// Bases that may be chosen; last the widest, which the others are made from.
pub(super) fn bases(site: &Site<'_>) -> Vec<DirectionalBasis> {
    let clouds = site.clouds;
    // Direct light inside the rows is too sharp for harmonics: a recipe that wants it there names its basis.
    let fixed = clouds.given.basis
        || clouds.response.direct == DirectTerm::InRows
        || clouds.budget.stroke_l2.is_none() && !clouds.budget.costs();
    if fixed {
        return vec![clouds.response.basis];
    }
    // Towards a view region only where it stands apart.
    let view_region = clouds.response.view_region.filter(|view_region| stand_apart(site.cloud, view_region));
    let view_region = view_region
        .iter()
        .flat_map(|_| (0..=MAX_VIEW_DEGREE).map(|degree| DirectionalBasis::ViewRegion { degree }));
    view_region.chain((0..=3).map(|degree| DirectionalBasis::Harmonics { degree })).collect()
}

/// Errors of coding that may be chosen, from coarse to fine.
pub(super) fn errors(clouds: &Clouds) -> Vec<f64> {
    if clouds.given.error {
        return vec![clouds.response.relative_error];
    }
    (0..ERRORS).map(|i| COARSEST_ERROR * libm::exp2(-0.25 * i as f64)).collect()
}
