//! Fills section `CLRT`: the cloud's answer to each virtual lamp, solved, transformed and compressed.
//!
//! Sixteen lamps are solved side by side, batches run in parallel, and what comes out is put together in row order, so that
//! the bytes do not depend on the number of threads. Test strokes that no lamp was chosen for go along: solved directly
//! with the same solver, they say what splitting a stroke over lamps costs; relit from the very bytes that ship, they say
//! what compression costs.

pub mod judge;

use crate::compress::{CompressedRow, compress_row};
use crate::error::BakeError;
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::haar::Haar;
use squall_formats::section::response::{
    ChannelBasis, Codec, DirectTerm, DistantKind, DistantSource, NO_ROW, ResponseHead, ResponseRows,
    SolverRecord, SourceBasis,
};
use squall_formats::sphere::{self, MAX_HARMONICS, degree_of};
use squall_runtime::relight::LampPoint;
use squall_runtime::transport::Cloud;
use squall_runtime::transport::cloud::CoarseIndex;
use squall_runtime::transport::direct::{DirectField, Light, Tracer};
use squall_runtime::transport::lanes::{F32x16, Lanes};
use squall_runtime::transport::quadrature::Quadrature;
use squall_runtime::transport::solve::{BatchReport, GATHERED, SolveBuffers, SolveSettings, Solver};

/// Lamps solved side by side.
pub const BATCH: usize = 16;
/// Batches between two ordered gatherings: enough for many threads, few enough to bound memory.
const BATCHES_AT_ONCE: usize = 16;

/// Nodes of the lamp grid.
#[derive(Clone, Debug, PartialEq)]
pub struct LampGrid {
    /// Rising node coordinates, m.
    pub x_m: Vec<f64>,
    /// Rising node coordinates, m.
    pub y_m: Vec<f64>,
    /// Rising node coordinates, m.
    pub z_m: Vec<f64>,
    /// Which nodes to bake, x fastest; all where empty.
    pub wanted: Vec<bool>,
}

impl LampGrid {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.x_m.len() * self.y_m.len() * self.z_m.len()
    }

    /// Whether there is no node.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The nodes that a lamp at `point` is split over; `None` outside the grid.
    pub fn around(&self, point: DVec3) -> Option<Vec<usize>> {
        let side = |axis: &[f64], value: f64| -> Option<[usize; 2]> {
            let (first, last) = (*axis.first()?, *axis.last()?);
            if !(first..=last).contains(&value) {
                return None;
            }
            let high = axis.partition_point(|&node| node < value);
            Some(if axis[high] == value { [high, high] } else { [high - 1, high] })
        };
        let (x, y, z) = (side(&self.x_m, point.x)?, side(&self.y_m, point.y)?, side(&self.z_m, point.z)?);
        let mut nodes = Vec::with_capacity(8);
        for corner in 0..8 {
            let node =
                x[corner & 1] + self.x_m.len() * (y[corner >> 1 & 1] + self.y_m.len() * z[corner >> 2]);
            if !nodes.contains(&node) {
                nodes.push(node);
            }
        }
        Some(nodes)
    }

    /// Position of node `index`.
    pub fn position(&self, index: usize) -> DVec3 {
        let (nx, ny) = (self.x_m.len(), self.y_m.len());
        DVec3::new(self.x_m[index % nx], self.y_m[index / nx % ny], self.z_m[index / nx / ny])
    }
}

/// How to bake a response.
#[derive(Clone, Copy, Debug)]
pub struct ResponseSettings {
    /// Directions or harmonics.
    pub channels: ChannelBasis,
    /// Direct light in the rows or left to the runtime.
    pub direct: DirectTerm,
    /// How coefficients are stored.
    pub codec: Codec,
    /// How far a source may be off, relative to its own L2 norm.
    pub relative_error: f64,
    /// Solve cells per stored cell and axis.
    pub refine: u32,
    /// Direct rays per boundary face of the solve grid and axis.
    pub samples: u32,
    /// The sweeps.
    pub solve: SolveSettings,
}

/// What to bake rows for.
#[derive(Clone, Debug, PartialEq)]
pub struct Sources {
    /// Virtual lamps.
    pub lamps: LampGrid,
    /// Distant light.
    pub distant: Vec<DistantKind>,
}

/// What a bake of a response made.
pub struct BakedResponse {
    /// The section's head.
    pub head: ResponseHead,
    /// The section's rows.
    pub rows: ResponseRows,
    /// Test strokes, for judging the written bytes.
    pub tests: Vec<TestStroke>,
    /// Coefficients kept, means not counted.
    pub kept: usize,
    /// Sweeps times sixteen lamps.
    pub sweeps: u64,
}

/// A stroke that the lamps were not chosen for, with its truth.
#[derive(Clone, Debug)]
pub struct TestStroke {
    /// The stroke's points.
    pub lamps: Vec<LampPoint>,
    /// J in the 26 directions, cells outermost: the stroke solved directly, all light.
    pub truth: Vec<f32>,
    /// The part of that which the runtime adds itself: direct light with [`DirectTerm::AtRunTime`], else zero.
    pub direct: Vec<f32>,
    /// Σ e_l b_l from the solved rows before compression, in the response's channels, one plane a channel.
    pub uncompressed: Vec<f32>,
}

struct Batch {
    report: BatchReport,
    rows: Vec<(CompressedRow, Option<Vec<f32>>)>,
}

/// Bakes the rows of all wanted nodes, and behind them those of distant light.
///
/// `strokes` are judged, not baked for. Errors: a solve that does not converge, settings out of range, an interruption.
pub fn bake_response(
    cloud: &Cloud,
    sources: &Sources,
    settings: &ResponseSettings,
    strokes: &[Vec<LampPoint>],
    progress: &dyn Progress,
) -> Result<BakedResponse, BakeError> {
    let factors = [settings.refine; 3];
    let fine = cloud.refined(factors)?;
    let solver = Solver::<4>::new(&fine, settings.solve)?;
    let parent = CoarseIndex::new(fine.shape, factors);
    let context = Context {
        settings,
        tracer: Tracer::new(&fine, solver.scaled().extinction_scale),
        fine: &fine,
        solver: &solver,
        parent,
        haar: Haar::new(cloud.shape),
        directions: sphere::directions_26().map(DVec3::from_array),
    };
    let grid = &sources.lamps;
    let nodes: Vec<usize> =
        (0..grid.len()).filter(|&node| grid.wanted.is_empty() || grid.wanted[node]).collect();
    let mut node_rows = vec![NO_ROW; grid.len()];
    for (row, &node) in nodes.iter().enumerate() {
        node_rows[node] = row as u32;
    }
    let mut head = ResponseHead {
        shape: cloud.shape,
        sources: SourceBasis::LampGrid {
            x_m: grid.x_m.clone(),
            y_m: grid.y_m.clone(),
            z_m: grid.z_m.clone(),
            rows: node_rows,
        },
        distant: (nodes.len()..)
            .zip(&sources.distant)
            .map(|(row, &kind)| DistantSource { kind, row: row as u32 })
            .collect(),
        channels: settings.channels,
        direct: settings.direct,
        codec: settings.codec,
        solver: SolverRecord {
            refine: factors,
            directions: directions_record(settings.solve.quadrature),
            scheme: settings.solve.scheme,
            extinction_scale: solver.scaled().extinction_scale,
            tolerance: settings.solve.tolerance,
            worst_residual: 0.0,
            most_sweeps: 0,
        },
    };
    let weights: Vec<Vec<(u32, f32)>> = strokes.iter().map(|lamps| split_stroke(&head, lamps)).collect();

    progress.begin("test strokes", strokes.len() as u64);
    let mut tests = context.solve_strokes(strokes, progress)?;

    // Lamps first, then distant light, in batches of their own: only the latter always keep their direct light.
    let lamp = |&node: &usize| vec![Light::Point { position: grid.position(node), intensity: 1.0 }];
    let lamps: Vec<Vec<Light>> = nodes.iter().map(lamp).collect();
    let distant: Vec<Vec<Light>> =
        sources.distant.iter().map(|&kind| distant_lights(kind)).collect::<Result<_, _>>()?;
    progress.begin("cloud response", (lamps.len() + distant.len()) as u64);
    let (mut rows, mut kept, mut sweeps) = (ResponseRows::default(), 0, 0u64);
    let mut batches: Vec<(u32, &[Vec<Light>], bool)> = Vec::new();
    for (lights, first, in_rows) in [(&lamps, 0, context.in_rows()), (&distant, lamps.len(), true)] {
        batches.extend(
            lights.chunks(BATCH).enumerate().map(|(i, part)| ((first + i * BATCH) as u32, part, in_rows)),
        );
    }
    for group in batches.chunks(BATCHES_AT_ONCE) {
        let solved: Vec<Result<Batch, BakeError>> = group
            .par_iter()
            .map_init(Work::default, |work, &(first, lights, in_rows)| {
                progress.check()?;
                let needed = |row: u32| weights.iter().any(|list| list.iter().any(|&(r, _)| r == row));
                let done = context.solve_batch(lights, in_rows, |lane| needed(first + lane as u32), work);
                progress.advance(lights.len() as u64);
                done
            })
            .collect();
        for batch in solved {
            let batch = batch?;
            head.solver.most_sweeps = head.solver.most_sweeps.max(batch.report.sweeps);
            sweeps += u64::from(batch.report.sweeps);
            for lane in &batch.report.lanes {
                head.solver.worst_residual = head.solver.worst_residual.max(lane.residual);
            }
            for (row, values) in batch.rows {
                let number = rows.rows.len() as u32;
                if let Some(values) = values {
                    add_to_tests(&mut tests, &weights, number, &values);
                }
                kept += row.kept;
                rows.bounds.extend_from_slice(&row.bounds);
                rows.rows.push(row.bytes);
            }
        }
    }
    Ok(BakedResponse { head, rows, tests, kept, sweeps })
}

/// Beams that together are distant light of unit strength: for a hemisphere, one a direction of a fine set.
fn distant_lights(kind: DistantKind) -> Result<Vec<Light>, BakeError> {
    let downward = match kind {
        DistantKind::Beam { direction } => {
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
pub fn directions_record(set: Quadrature) -> [u8; 2] {
    match set {
        Quadrature::Lebedev14 => [0, 14],
        Quadrature::Lebedev26 => [0, 26],
        Quadrature::Lebedev50 => [0, 50],
        Quadrature::DoubleGauss { polar, azimuths } => [polar, azimuths],
    }
}

fn add_to_tests(tests: &mut [TestStroke], weights: &[Vec<(u32, f32)>], row: u32, values: &[f32]) {
    for (test, weights) in tests.iter_mut().zip(weights) {
        if let Some(&(_, weight)) = weights.iter().find(|(r, _)| *r == row) {
            test.uncompressed.resize(values.len(), 0.0);
            for (sum, value) in test.uncompressed.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
    }
}

/// The weights that the runtime will give the stroke; none for a stroke that leaves the grid.
fn split_stroke(head: &ResponseHead, lamps: &[LampPoint]) -> Vec<(u32, f32)> {
    squall_runtime::relight::split_lamps(head, lamps)
        .map(|weights| weights.iter().map(|w| (w.row, w.intensity)).collect())
        .unwrap_or_default()
}

struct Context<'a> {
    settings: &'a ResponseSettings,
    fine: &'a Cloud,
    tracer: Tracer<'a>,
    solver: &'a Solver<4>,
    parent: CoarseIndex,
    haar: Haar,
    directions: [DVec3; 26],
}

#[derive(Default)]
struct Work<P> {
    direct: Option<DirectField<4>>,
    sources: Vec<[P; 4]>,
    gathered: Vec<[P; GATHERED]>,
    buffers: SolveBuffers<P, 4>,
    towards: Vec<Vec<f32>>,
    scratch: Vec<f32>,
}

impl Context<'_> {
    fn in_rows(&self) -> bool {
        self.settings.direct == DirectTerm::InRows
    }

    /// Traces lights, one list a lane, and solves for what they scatter.
    fn solve_lanes<P: Lanes>(
        &self,
        lanes: &[Vec<Light>],
        towards: bool,
        work: &mut Work<P>,
    ) -> Result<BatchReport, BakeError> {
        let directions: &[DVec3] = if towards { &self.directions } else { &[] };
        let fits = |field: &DirectField<4>| field.towards.len() == self.fine.shape.len() * directions.len();
        let mut direct = match work.direct.take() {
            Some(field) if fits(&field) => field,
            _ => DirectField::new(self.fine, directions),
        };
        let share = 1.0 / self.fine.cell_volume() as f32;
        work.sources.clear();
        work.sources.resize(self.fine.shape.len(), [P::splat(0.0); 4]);
        work.towards.clear();
        for (lane, lights) in lanes.iter().enumerate() {
            direct.clear();
            for &light in lights {
                self.tracer.rays(light, self.settings.samples, |ray| {
                    self.tracer.trace(ray, &mut direct);
                });
            }
            for (source, moments) in work.sources.iter_mut().zip(&direct.moments) {
                for m in 0..4 {
                    source[m].set_lane(lane, moments[m] * share);
                }
            }
            if towards {
                let coarse = self.parent.means(&direct.towards, directions.len());
                work.towards.push(coarse.into_iter().map(|v| v * share).collect());
            }
        }
        work.direct = Some(direct);
        let report = self.solver.solve(&work.sources, &mut work.gathered, &mut work.buffers, None);
        for (lane, lights) in report.lanes.iter().zip(lanes) {
            if !lane.converged {
                return Err(BakeError::NotReached {
                    what: format!("transport of {:?}", lights.first()),
                    wanted: format!("residual {:e}", self.settings.solve.tolerance),
                    reached: format!("{:e} after {} sweeps", lane.residual, report.sweeps),
                    hint: "a larger tolerance or more sweeps help".into(),
                });
            }
        }
        Ok(report)
    }

    /// J's harmonic coefficients of one lane's scattered light in the stored cells, 16 a cell.
    fn coefficients<P: Lanes>(&self, lane: usize, work: &Work<P>) -> Vec<f32> {
        let powers = [1.0, self.fine.g, self.fine.g * self.fine.g, self.fine.g * self.fine.g * self.fine.g];
        let scale: [f32; MAX_HARMONICS] = std::array::from_fn(|m| powers[degree_of(m)] as f32);
        let mut fine = Vec::with_capacity(work.gathered.len() * MAX_HARMONICS);
        for moments in &work.gathered {
            fine.extend((0..MAX_HARMONICS).map(|m| moments[m].lane(lane) * scale[m]));
        }
        if self.settings.refine == 1 { fine } else { self.parent.means(&fine, MAX_HARMONICS) }
    }

    /// One lane's channels, one plane a channel.
    fn channels<P: Lanes>(&self, lane: usize, in_rows: bool, work: &Work<P>) -> Vec<f32> {
        let coefficients = self.coefficients(lane, work);
        let cells = coefficients.len() / MAX_HARMONICS;
        let count = self.settings.channels.count();
        let mut planes = vec![0.0f32; cells * count];
        match self.settings.channels {
            ChannelBasis::Harmonics { .. } => {
                for (cell, values) in coefficients.chunks_exact(MAX_HARMONICS).enumerate() {
                    for channel in 0..count {
                        planes[channel * cells + cell] = values[channel];
                    }
                }
            }
            ChannelBasis::Directions26 => {
                let all = in_26_directions(&coefficients);
                for (cell, values) in all.chunks_exact(26).enumerate() {
                    for channel in 0..26 {
                        planes[channel * cells + cell] = values[channel];
                    }
                }
            }
        }
        if in_rows {
            add_direct(self.settings.channels, &work.towards[lane], 1.0, &mut planes);
        }
        planes
    }

    fn solve_batch(
        &self,
        lanes: &[Vec<Light>],
        in_rows: bool,
        needed: impl Fn(usize) -> bool,
        work: &mut Work<F32x16>,
    ) -> Result<Batch, BakeError> {
        let report = self.solve_lanes(lanes, in_rows, work)?;
        let mut rows = Vec::with_capacity(lanes.len());
        for lane in 0..lanes.len() {
            let mut planes = self.channels(lane, in_rows, work);
            let kept = needed(lane).then(|| planes.clone());
            for plane in planes.chunks_exact_mut(self.haar.len()) {
                self.haar.forward(plane, &mut work.scratch);
            }
            let (codec, error) = (self.settings.codec, self.settings.relative_error);
            rows.push((compress_row(&planes, self.settings.channels.count(), codec, error), kept));
        }
        Ok(Batch { report, rows })
    }

    fn solve_strokes(
        &self,
        strokes: &[Vec<LampPoint>],
        progress: &dyn Progress,
    ) -> Result<Vec<TestStroke>, BakeError> {
        // One stroke a task: tracing its many points is most of the work.
        let solved: Vec<Result<TestStroke, BakeError>> = strokes
            .par_iter()
            .map_init(Work::<f32>::default, |work, lamps| {
                progress.check()?;
                let light = |l: &LampPoint| Light::Point { position: l.position, intensity: l.intensity };
                let lights: Vec<Light> = lamps.iter().map(light).collect();
                self.solve_lanes(&[lights], true, work)?;
                let mut truth = in_26_directions(&self.coefficients(0, work));
                let direct = std::mem::take(&mut work.towards[0]);
                for (sum, value) in truth.iter_mut().zip(&direct) {
                    *sum += value;
                }
                progress.advance(1);
                let direct = if self.in_rows() { vec![0.0; direct.len()] } else { direct };
                Ok(TestStroke { lamps: lamps.clone(), truth, direct, uncompressed: Vec::new() })
            })
            .collect();
        solved.into_iter().collect()
    }
}

/// Adds `factor` times direct light, given in the 26 directions, to channels; harmonics take its projection, which the set's
/// degree of 7 makes exact as far as the harmonics reach.
pub fn add_direct(basis: ChannelBasis, towards: &[f32], factor: f32, planes: &mut [f32]) {
    let cells = towards.len() / 26;
    let (directions, weights) = (sphere::directions_26(), sphere::weights_26());
    for (cell, values) in towards.chunks_exact(26).enumerate() {
        match basis {
            ChannelBasis::Directions26 => {
                for (channel, value) in values.iter().enumerate() {
                    planes[channel * cells + cell] += factor * value;
                }
            }
            ChannelBasis::Harmonics { .. } => {
                for (d, value) in values.iter().enumerate() {
                    let harmonics = sphere::harmonics(directions[d]);
                    let weight = 4.0 * std::f64::consts::PI * weights[d];
                    for channel in 0..basis.count() {
                        planes[channel * cells + cell] +=
                            factor * ((weight * harmonics[channel]) as f32 * value);
                    }
                }
            }
        }
    }
}

/// Harmonic coefficients, 16 a cell, to values in the 26 directions, 26 a cell.
pub fn in_26_directions(coefficients: &[f32]) -> Vec<f32> {
    let basis: Vec<[f32; MAX_HARMONICS]> =
        sphere::directions_26().iter().map(|&d| sphere::harmonics(d).map(|v| v as f32)).collect();
    let mut out = Vec::with_capacity(coefficients.len() / MAX_HARMONICS * 26);
    for values in coefficients.chunks_exact(MAX_HARMONICS) {
        out.extend(basis.iter().map(|b| b.iter().zip(values).map(|(x, y)| x * y).sum::<f32>()));
    }
    out
}

/// Node coordinates of a lamp grid over a cloud. \[dobashi\] §5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampSpacing {
    /// Distance between nodes sideways and above the cloud's base, h_usr, m.
    pub base_m: f64,
    /// ε of eq. 4, 1/m²: how much 1/r² may fall from one node below the base to the next.
    pub epsilon: f64,
    /// Longest interval below the base, m. Eq. 4 alone lets it grow without end once 1/r² < ε.
    pub longest_m: f64,
}

/// Nodes over the box `low`…`high`: even steps of at most `base_m` sideways and above `base_height`; below it the longest
/// intervals that eq. 4 allows, no shorter than `base_m` and no longer than `longest_m`, down to `low.z`.
///
/// Eq. 4 as printed is singular at the base itself (r = 0) and unbounded far below; the first interval here is `base_m`.
pub fn lamp_grid(low: DVec3, high: DVec3, base_height: f64, spacing: LampSpacing) -> LampGrid {
    let even = |from: f64, to: f64| -> Vec<f64> {
        let count = ((to - from) / spacing.base_m - 1e-9).ceil().max(0.0) as usize;
        (0..=count).map(|i| from + (to - from) * i as f64 / count.max(1) as f64).collect()
    };
    let base = base_height.clamp(low.z, high.z);
    let mut below = Vec::new();
    let (mut r, deepest) = (0.0f64, base - low.z);
    while deepest - r > 1e-6 {
        let longest = if r == 0.0 {
            spacing.base_m
        } else {
            let left = 1.0 / (r * r) - spacing.epsilon;
            if left > 0.0 { 1.0 / left.sqrt() - r } else { f64::INFINITY }
        };
        r = (r + longest.clamp(spacing.base_m, spacing.longest_m.max(spacing.base_m))).min(deepest);
        below.push(base - r);
    }
    below.reverse();
    let mut z_m = below;
    z_m.extend(even(base, high.z));
    LampGrid { x_m: even(low.x, high.x), y_m: even(low.y, high.y), z_m, wanted: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPACING: LampSpacing = LampSpacing { base_m: 100.0, epsilon: 2e-6, longest_m: 1000.0 };

    #[test]
    fn lamp_intervals_are_even_above_the_base_and_widen_below_it_within_eq_4() {
        let grid = lamp_grid(DVec3::new(0.0, 0.0, -4000.0), DVec3::new(1000.0, 500.0, 400.0), 0.0, SPACING);
        assert_eq!(grid.x_m.len(), 11);
        assert_eq!(grid.y_m.len(), 6);
        assert_eq!((grid.z_m[0], *grid.z_m.last().unwrap()), (-4000.0, 400.0));
        let below: Vec<f64> = grid.z_m.iter().filter(|&&z| z <= 0.0).rev().map(|z| -z).collect();
        let steps: Vec<f64> = below.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(steps.windows(2).rev().skip(1).all(|w| w[1] >= w[0] - 1e-9), "{steps:?}");
        for (pair, step) in below.windows(2).zip(&steps) {
            let fall = 1.0 / (pair[0] * pair[0]) - 1.0 / (pair[1] * pair[1]);
            assert!(fall <= SPACING.epsilon * (1.0 + 1e-9) || *step <= SPACING.base_m + 1e-9, "{pair:?}");
            assert!(*step <= SPACING.longest_m + 1e-9);
        }
    }

    #[test]
    fn a_lamp_box_above_the_base_or_of_no_height_still_has_nodes() {
        let grid = lamp_grid(DVec3::new(0.0, 0.0, 100.0), DVec3::new(0.0, 0.0, 100.0), 0.0, SPACING);
        assert_eq!((grid.x_m.len(), grid.y_m.len(), grid.z_m.len()), (1, 1, 1));
    }
}
