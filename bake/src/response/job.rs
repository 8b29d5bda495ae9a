//! What a response is baked from, and what comes of it.

use super::cache::ResponseCache;
use super::grid::WantedLights;
use crate::recipe::model::ResponseSettings;
use squall_formats::section::response::{DistantKind, ResponseHead, ResponseRows, SunDirections};
use squall_runtime::relight::PointLight;
use squall_runtime::transport::Cloud;
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
    /// Where rows and strokes may have been solved before.
    pub cache: Option<&'a ResponseCache>,
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
