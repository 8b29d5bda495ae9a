//! What a setting gives and what it costs, tried on a few strokes: solved once, coded in many ways, relit from the bytes.
//!
//! Budgets choose by these figures and charts show them.

use super::held_out::HeldOutSet;
use super::{Outcome, cost};
use crate::asset::asset_of;
use crate::error::BakeError;
use crate::progress::Progress;
use crate::response::{BakedResponse, HeldOutStroke, Job, SolvedRows, Sources, WantedLights, solve_rows};
use squall_formats::meta;
use squall_formats::section::response::{Codec, DirectionalBasis};
use squall_runtime::relight::{PointLight, Relighter};
use squall_runtime::transport::Cloud;

/// A light grid tried on some strokes: the rows that those touch, solved and not yet coded.
pub struct Candidate<'a> {
    cloud: &'a Cloud,
    solved: SolvedRows,
    held_out: HeldOutSet,
    /// Virtual lights that a bake of this grid would solve for.
    pub lights: usize,
    /// Rows of distant light beside them.
    distant: usize,
    /// Most rows that a stroke or the scene relights at once.
    most_rows: usize,
}

impl<'a> Candidate<'a> {
    /// Solves the rows of `job` that its strokes touch, its distant light left out. `flashes` is what the scene relights at once:
    /// [`cost::flashes`].
    ///
    /// Errors: as [`solve_rows`].
    pub fn new(
        job: &Job<'a>,
        flashes: &[Vec<PointLight>],
        progress: &dyn Progress,
    ) -> Result<Self, BakeError> {
        let (lights, settings) = (&job.sources.lights, job.settings);
        let wanted = touched(lights, job.held_out);
        let sources =
            Sources { lights: WantedLights { wanted, ..lights.clone() }, distant: Vec::new(), sun: None };
        let solved = solve_rows(&Job { sources: &sources, ..*job }, progress)?;
        let view_region = settings.view_region.as_ref();
        let held_out = HeldOutSet::new(job.cloud, view_region, settings.direct, &solved.held_out, 0);
        let rows = |stroke: &Vec<PointLight>| count(&touched(lights, std::slice::from_ref(stroke)));
        let most_rows = job.held_out.iter().chain(flashes).map(rows).max().unwrap_or(0);
        Ok(Self {
            cloud: job.cloud,
            solved,
            held_out,
            lights: lights.wanted_count(),
            distant: job.sources.distant.len(),
            most_rows,
        })
    }

    /// Codes the rows.
    pub fn encode(&self, basis: DirectionalBasis, codec: Codec, error: f64) -> BakedResponse {
        self.solved.encode(basis, codec, error)
    }

    /// Codes the rows and scores them by the strokes.
    ///
    /// Errors: none that rows solved here bring about.
    pub fn code(&self, basis: DirectionalBasis, codec: Codec, error: f64) -> Result<Outcome, BakeError> {
        let coded = self.encode(basis, codec, error);
        let (tried, strokes) = (coded.rows.rows.len().max(1), coded.held_out.clone());
        // The head names every node of the grid, solved or not; index, bounds and rows grow with the rows.
        let head = meta::encode(&coded.head).len() as u64;
        let (asset, bytes) = asset_of(self.cloud, coded)?;
        let relighter = Relighter::new(&asset)?;
        let scores = self.held_out.scores(&relighter, &strokes)?;
        let head_now = &relighter.response().head;
        let row_bytes = bytes.saturating_sub(head) as f64 / tried as f64;
        let relight_ms = cost::relight_ms(head_now, row_bytes * self.most_rows as f64);
        let rows = (self.lights + self.distant) as u64;
        let bytes = head + bytes.saturating_sub(head) * rows / tried as u64;
        Ok(Outcome { scores, bytes, relight_ms, sun_l2: None })
    }

    /// Bytes that the solved rows of such a candidate take.
    pub fn bytes(
        lights: &WantedLights,
        strokes: &[Vec<PointLight>],
        basis: DirectionalBasis,
        cloud: &Cloud,
    ) -> usize {
        count(&touched(lights, strokes)) * basis.count() * cloud.shape.len() * size_of::<f32>()
    }

    /// The strokes with their truth.
    pub fn held_out(&self) -> Vec<HeldOutStroke> {
        let bare = |stroke: &HeldOutStroke| HeldOutStroke { uncompressed: Vec::new(), ..stroke.clone() };
        self.solved.held_out.iter().map(bare).collect()
    }

    /// Rows that were solved.
    pub fn rows(&self) -> usize {
        self.solved.planes.len()
    }
}

/// Which nodes of `lights` the strokes are split over; those that are not wanted stay so.
pub fn touched(lights: &WantedLights, strokes: &[Vec<PointLight>]) -> Vec<bool> {
    let mut touched = vec![false; lights.len()];
    for point in strokes.iter().flatten() {
        for node in lights.around(point.position).into_iter().flatten() {
            touched[node] = lights.is_wanted(node);
        }
    }
    touched
}

/// Number of nodes marked.
pub fn count(marks: &[bool]) -> usize {
    marks.iter().filter(|&&mark| mark).count()
}
