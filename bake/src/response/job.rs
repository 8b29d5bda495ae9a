//! What a response is baked from, and what comes of it.

use super::cache::ResponseCache;
use super::grid::WantedLights;
use crate::compress::PlaneWeights;
use crate::error::BakeError;
use crate::recipe::model::{ErrorFor, ResponseSettings};
use squall_formats::section::response::{DistantKind, ResponseHead, ResponseRows, Stored, SunDirections};
use squall_runtime::relight::PointLight;
use squall_runtime::transport::cloud::CoarseIndex;
use squall_runtime::transport::fit::{HatFit, weights};
use squall_runtime::transport::{ArgumentError, Cloud};
use std::sync::Arc;

/// What to bake rows for.
#[derive(Clone, Debug, PartialEq)]
pub struct Sources {
    /// Virtual point lights.
    pub lights: WantedLights,
    /// Distant light, beams of the sun last.
    pub distant: Vec<DistantKind>,
    /// What those beams cover, where there are any.
    pub sun: Option<SunDirections>,
}

/// One response to be solved for.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The cloud that answers.
    pub cloud: &'a Cloud,
    /// One row each.
    pub sources: &'a Sources,
    /// How to solve, and how to store.
    pub settings: &'a ResponseSettings,
    /// Strokes that no row is baked for: solved directly, they say what splitting a stroke over virtual lights costs.
    pub held_out: &'a [Vec<PointLight>],
    /// `held_out` with its truth where an earlier job solved for it: it depends on the cloud and on how light is solved, not on
    /// sources, basis or coding.
    pub known: Option<&'a [HeldOutStroke]>,
    /// The cells that are shown, where `cloud` is blocks of them: with [`Stored::Fit`] light is solved for in these (or their parts) and fitted
    /// to `cloud`'s. Without it that is not asked for.
    pub shown: Option<&'a Cloud>,
    /// Where rows and strokes may have been solved before.
    pub cache: Option<&'a ResponseCache>,
}

impl Job<'_> {
    /// What an error in each plane of a row counts for.
    pub(super) fn plane_weights(&self) -> PlaneWeights {
        match self.settings.error_for {
            ErrorFor::Viewers => PlaneWeights::even(self.settings.basis.count()),
            ErrorFor::Gathers => {
                let scale = self.cloud.scaled(GATHERED_DEGREE).extinction_scale;
                PlaneWeights::for_gathers(self.cloud.g, self.cloud.albedo, scale)
            }
        }
    }
}

/// Degree up to which a gather scatters what it reads.
const GATHERED_DEGREE: usize = 1;

/// The cells that light is solved for in, and how those become the stored ones.
pub(super) struct SolveCells {
    /// The solve grid.
    pub(super) fine: Cloud,
    /// Its cells to a stored one.
    pub(super) factors: [u32; 3],
    /// What fits it; means where `None`.
    pub(super) fit: Option<HatFit>,
    /// Solve cells whose light is read.
    pub(super) read: Vec<bool>,
}

impl SolveCells {
    /// Those of `job`.
    ///
    /// Errors: more cells than a grid can have, a grid that `job`'s is no blocks of.
    pub(super) fn new(job: &Job<'_>) -> Result<Self, BakeError> {
        let (cloud, settings) = (job.cloud, job.settings);
        let own = job.shown.filter(|_| settings.stored == Stored::Fit).unwrap_or(cloud);
        let fine = own.refined([settings.refine; 3])?;
        let size = |axis: usize| (fine.shape.to_array()[axis] / cloud.shape.to_array()[axis]) as u32;
        let factors = [0, 1, 2].map(size);
        let whole = |axis: usize| factors[axis] as usize * cloud.shape.to_array()[axis];
        if [0, 1, 2].map(whole) != fine.shape.to_array() {
            let wanted = format!("whole blocks of the {:?} solve cells", fine.shape.to_array());
            return Err(ArgumentError::new(
                "response cells",
                wanted,
                format!("{:?}", cloud.shape.to_array()),
            )
            .into());
        }
        if settings.stored == Stored::Means || factors == [1; 3] {
            let (shaded, parent) = (cloud.shaded(), CoarseIndex::new(fine.shape, factors));
            let read = (0..fine.shape.len()).map(|cell| shaded[parent.of(cell)]).collect();
            return Ok(Self { fine, factors, fit: None, read });
        }
        let fit = HatFit::new(&fine, factors, weights(&fine, settings.view_region.as_ref()))?;
        let read = fit.weights().iter().map(|&weight| weight > 0.0).collect();
        Ok(Self { fine, factors, fit: Some(fit), read })
    }
}

/// A stroke that no row was baked for, with its truth.
#[derive(Clone, Debug)]
pub struct HeldOutStroke {
    /// The stroke's points.
    pub lights: Vec<PointLight>,
    /// J in the 26 directions, cells outermost: the stroke solved directly, all light.
    pub truth: Vec<f32>,
    /// The direct part of that, which the runtime adds itself with
    /// [`AtRunTime`](squall_formats::section::response::DirectTerm::AtRunTime).
    pub direct: Vec<f32>,
    /// J of direct light, cell means, towards the middle of the view region; empty without one. Errors of strokes seen from a view
    /// region are relative to it, beside what was scattered: 26 directions are too few to read a narrow phase function between.
    pub direct_to_viewers: Vec<f32>,
    /// Σ e_l b_l from the solved rows before compression, in the response's basis, one plane a coefficient.
    pub uncompressed: Vec<f32>,
    /// Which cells count; all where empty.
    pub seen: Arc<[bool]>,
}

/// What a bake of a response made.
pub struct BakedResponse {
    /// The section's head.
    pub head: ResponseHead,
    /// The section's rows.
    pub rows: ResponseRows,
    /// Held-out strokes, for evaluating the written bytes.
    pub held_out: Vec<HeldOutStroke>,
    /// Coefficients kept, means not counted.
    pub kept: usize,
    /// Sweeps times sixteen lights.
    pub sweeps: u64,
}
