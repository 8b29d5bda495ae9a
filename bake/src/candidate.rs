//! What a setting gives and what it costs, tried on a few strokes: solved once, coded in many ways, relit from the bytes.
//!
//! Budgets choose by these figures and charts show them. Everything here is a function of the inputs; nothing looks at a clock.

use crate::budget::clouds::STROKES;
use crate::budget::cost;
use crate::error::BakeError;
use crate::progress::Progress;
use crate::recipe::Recipe;
use crate::response::evaluate::{HeldOutSet, Scores};
use crate::response::{
    BakedResponse, ResponseSettings, SolvedRows, Sources, TestStroke, WantedLights, solve_rows,
};
use crate::storm::clouds::{place_lights, strokes_for};
use squall_formats::container::{self, OutSection};
use squall_formats::meta;
use squall_formats::section::cloud::{CloudHead, CloudSection};
use squall_formats::section::response::{self, Codec, DirectionalBasis};
use squall_runtime::Asset;
use squall_runtime::relight::{PointLight, Relighter};
use squall_runtime::transport::{Boundary, Cloud};
use std::path::Path;

/// A cloud's grid as a section.
pub fn grid_section(cloud: &Cloud) -> OutSection {
    CloudSection {
        head: CloudHead {
            shape: cloud.shape,
            cell_m: cloud.cell_m,
            origin_m: cloud.origin_m.to_array(),
            albedo: cloud.albedo,
            g: cloud.g,
            periodic_xy: cloud.boundary == Boundary::PeriodicXy,
        },
        extinction: &cloud.extinction,
    }
    .write()
}

/// An asset in memory with a cloud and its response, and the response's bytes.
///
/// Errors: none that a response from [`crate::response`] brings about.
pub fn asset_of(cloud: &Cloud, baked: BakedResponse) -> Result<(Asset, u64), BakeError> {
    let section = response::write(&baked.head, baked.rows);
    let bytes = section.length();
    let mut out = Vec::new();
    container::write(&mut out, &[grid_section(cloud), section])
        .map_err(BakeError::io(Path::new("(memory)"), "write"))?;
    Ok((Asset::from_bytes(&out)?, bytes))
}

/// A lamp grid tried on some strokes: the rows that those touch, solved and not yet coded.
pub struct Candidate<'a> {
    cloud: &'a Cloud,
    solved: SolvedRows,
    held_out_set: HeldOutSet,
    /// Lamps that a bake of this grid would solve for.
    pub lights: usize,
    /// Rows of distant light beside them.
    distant: usize,
    /// Most rows that a stroke or the scene relights at once.
    most_rows: usize,
}

/// What a whole response has beside the rows that a trial solves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Whole<'a> {
    /// Rows of distant light.
    pub distant: usize,
    /// What the scene relights at once: [`cost::flashes`].
    pub flashes: &'a [Vec<PointLight>],
}

/// What coding a trial's rows in one way gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Errors on the trial's strokes, relit from bytes.
    pub scores: Scores,
    /// Bytes of the whole response, estimated from those of the tried rows.
    pub bytes: u64,
    /// Milliseconds that relighting a stroke counts for, at most: [`crate::budget::cost`].
    pub relight_ms: f64,
}

impl<'a> Candidate<'a> {
    /// Solves the rows of `lights` that `strokes` touch; `known` as in [`solve_rows`].
    ///
    /// Errors: as [`solve_rows`].
    pub fn new(
        cloud: &'a Cloud,
        lights: &WantedLights,
        whole: Whole<'_>,
        settings: &ResponseSettings,
        (strokes, known): (&[Vec<PointLight>], Option<&[TestStroke]>),
        progress: &dyn Progress,
    ) -> Result<Self, BakeError> {
        let wanted = touched(lights, strokes);
        let sources = Sources { lights: WantedLights { wanted, ..lights.clone() }, distant: Vec::new() };
        let solved = solve_rows(cloud, &sources, settings, strokes, known, progress)?;
        let held_out_set =
            HeldOutSet::new(cloud, settings.view_region.as_ref(), settings.direct, &solved.tests, 0);
        let rows = |stroke: &Vec<PointLight>| count(&touched(lights, std::slice::from_ref(stroke)));
        let most_rows = strokes.iter().chain(whole.flashes).map(rows).max().unwrap_or(0);
        Ok(Self {
            cloud,
            solved,
            held_out_set,
            lights: lights.wanted_count(),
            distant: whole.distant,
            most_rows,
        })
    }

    /// Codes the rows.
    pub fn encode(&self, channels: DirectionalBasis, codec: Codec, error: f64) -> BakedResponse {
        self.solved.encode(channels, codec, error)
    }

    /// Codes the rows and judges them by the strokes.
    ///
    /// Errors: none that rows solved here bring about.
    pub fn code(&self, channels: DirectionalBasis, codec: Codec, error: f64) -> Result<Outcome, BakeError> {
        let coded = self.encode(channels, codec, error);
        let (tried, tests) = (coded.rows.rows.len().max(1), coded.tests.clone());
        // The head names every node of the grid, solved or not; index, bounds and rows grow with the rows.
        let head = meta::encode(&coded.head).len() as u64;
        let (asset, bytes) = asset_of(self.cloud, coded)?;
        let relighter = Relighter::new(&asset)?;
        let scores = self.held_out_set.scores(&relighter, &tests)?;
        let head_now = &relighter.response().head;
        let row_bytes = bytes.saturating_sub(head) as f64 / tried as f64;
        let relight_ms = cost::relight_ms(head_now, row_bytes * self.most_rows as f64);
        let rows = (self.lights + self.distant) as u64;
        let bytes = head + bytes.saturating_sub(head) * rows / tried as u64;
        Ok(Outcome { scores, bytes, relight_ms })
    }

    /// Bytes that the solved rows of such a trial take.
    pub fn bytes(
        lights: &WantedLights,
        strokes: &[Vec<PointLight>],
        channels: DirectionalBasis,
        cloud: &Cloud,
    ) -> usize {
        count(&touched(lights, strokes)) * channels.count() * cloud.shape.len() * size_of::<f32>()
    }

    /// The strokes with their truth.
    pub fn tests(&self) -> Vec<TestStroke> {
        self.solved.tests.iter().map(|test| TestStroke { uncompressed: Vec::new(), ..test.clone() }).collect()
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

/// The recipe's lamp grid at a spacing, and the strokes that judge a response over it.
///
/// Errors: a recipe without clouds, more lamps than days allow.
pub fn held_out_strokes(
    recipe: &Recipe,
    cloud: &Cloud,
    spacing_m: f64,
) -> Result<(WantedLights, Vec<Vec<PointLight>>), BakeError> {
    let Some(clouds) = &recipe.clouds else {
        return Err(BakeError::input(&recipe.file, "recipe", "a table [clouds]", "none"));
    };
    let lights = place_lights(recipe, clouds, cloud, spacing_m)?;
    let first = if clouds.budget.judges() { STROKES[1] } else { 0 };
    let numbers = first..first + clouds.test_strokes as usize;
    let strokes = strokes_for(recipe, clouds, cloud, &lights, spacing_m, numbers);
    Ok((lights, strokes))
}
