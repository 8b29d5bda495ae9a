//! How good a response is: strokes that it was not baked for, relit from the bytes that ship.

use super::{TestStroke, add_direct};
use crate::error::BakeError;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::sphere::{self, MAX_HARMONICS};
use squall_formats::view_region::{ViewRegion, ViewRegionFrame};
use squall_runtime::random::Random;
use squall_runtime::relight::{
    PointLight, RelightBuffers, RelightOptions, Relighter, Relit, basis_factors, view_region_frame,
};
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::Cloud;
use std::ops::Range;

/// Errors of relit light against a truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RelitError {
    /// √Σ(x−r)² / √Σr² over cells and views, weighted by what each view counts for.
    pub l2: f64,
    /// 99.9th percentile of |x−r| over the largest r.
    pub tail: f64,
    /// Median of |x−r|/r where r is above 10⁻⁴ of the largest.
    pub median: f64,
}

/// What test strokes say of a response.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scores {
    /// Relit from the written bytes, against the same rows before compression.
    pub codec: RelitError,
    /// Relit from the written bytes, against the stroke solved directly; all light, direct light included.
    pub stroke: RelitError,
}

/// Where light is judged: the cells that can be seen, in the 26 directions or towards eyes.
pub struct Views {
    /// Cells that are judged.
    cells: Vec<u32>,
    /// Middles of those and directions from them to the eyes, eyes innermost; nothing for the 26 directions.
    view_region: Option<Vec<(DVec3, DVec3)>>,
    /// What each view of a cell counts for, summing to 1.
    weights: Vec<f64>,
}

/// Eyes that judge light at once.
const VIEWPOINTS: usize = 8;
/// Seed of their places, beside their number.
const VIEWPOINTS_SEED: u64 = 0xe7e5;

/// Factors of channels in every view: those of a cell's views behind one another, or of one cell's that stand for all.
pub struct ViewFactors {
    channels: usize,
    factors: Vec<f32>,
}

impl Views {
    /// Views of the cells that are `seen`: the 26 directions where `view_region` may stand anywhere, else towards eyes drawn at random from
    /// their box. Another `number` draws others.
    pub fn new(
        cloud: &Cloud,
        view_region: Option<&ViewRegion>,
        number: u64,
        seen: impl Fn(usize) -> bool,
    ) -> Self {
        let cells: Vec<u32> =
            (0..cloud.shape.len()).filter(|&cell| seen(cell)).map(|cell| cell as u32).collect();
        let Some(view_region) = view_region else {
            return Self { cells, view_region: None, weights: sphere::weights_26().to_vec() };
        };
        let mut random = Random::from_parts(&[VIEWPOINTS_SEED, number]);
        let places: [DVec3; VIEWPOINTS] = std::array::from_fn(|_| {
            let at = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0)];
            DVec3::from_array(view_region.point(at))
        });
        let towards = |&cell: &u32| {
            let middle = cloud.centre(cloud.shape.cell(cell as usize));
            places.map(|eye| (middle, (eye - middle).try_normalize().unwrap_or(DVec3::Z)))
        };
        Self {
            view_region: Some(cells.iter().flat_map(towards).collect()),
            cells,
            weights: vec![1.0 / VIEWPOINTS as f64; VIEWPOINTS],
        }
    }

    /// Errors of `found` against `wanted`, values of these views both.
    pub fn compare(&self, found: &[f32], wanted: &[f32]) -> RelitError {
        compare_views(found, wanted, &self.weights)
    }

    /// Factors of `basis`' channels; its frame where it is towards eyes.
    pub fn factors(&self, basis: DirectionalBasis, frame: Option<&ViewRegionFrame>) -> ViewFactors {
        let mut factors = Vec::new();
        let mut one = Vec::new();
        match &self.view_region {
            None => {
                for direction in sphere::directions_26() {
                    basis_factors(basis, None, DVec3::from_array(direction), &mut one);
                    factors.extend_from_slice(&one);
                }
            }
            Some(view_region) => {
                for &(middle, towards) in view_region {
                    basis_factors(basis, frame.map(|frame| (frame, middle)), towards, &mut one);
                    factors.extend_from_slice(&one);
                }
            }
        }
        ViewFactors { channels: basis.count(), factors }
    }

    /// Relit light, a value a cell and view, views innermost.
    pub fn light(&self, relit: &Relit<'_>, factors: &ViewFactors) -> Vec<f32> {
        let (views, channels) = (self.weights.len(), factors.channels);
        let mut out = Vec::with_capacity(self.cells.len() * views);
        for (place, &cell) in self.cells.iter().enumerate() {
            let first = if self.view_region.is_some() { place * views } else { 0 };
            let rows = factors.factors[first * channels..].chunks_exact(channels).take(views);
            out.extend(rows.map(|row| relit.value(cell as usize, row)));
        }
        out
    }

    /// Errors of relit light against other light in the same channels.
    pub fn errors(&self, found: &Relit<'_>, wanted: &Relit<'_>, factors: &ViewFactors) -> RelitError {
        self.compare(&self.light(found, factors), &self.light(wanted, factors))
    }

    /// Light in the 26 directions, read between them.
    fn between(&self, values: &[f32]) -> Vec<f32> {
        let Some(view_region) = &self.view_region else {
            let of_cell = |&cell: &u32| &values[26 * cell as usize..26 * (cell as usize + 1)];
            return self.cells.iter().flat_map(of_cell).copied().collect();
        };
        let mut out = Vec::with_capacity(view_region.len());
        for (place, (_, towards)) in view_region.iter().enumerate() {
            let cell = 26 * self.cells[place / VIEWPOINTS] as usize;
            let near = sphere::interpolate_26(towards.to_array());
            out.push(near.iter().map(|&(direction, weight)| weight as f32 * values[cell + direction]).sum());
        }
        out
    }

    /// Light in the 26 directions that has no more than degree 3 in it.
    fn smooth(&self, values: &[f32]) -> Vec<f32> {
        if self.view_region.is_none() {
            return self.between(values);
        }
        let (basis, cells) = (DirectionalBasis::Harmonics { degree: 3 }, values.len() / 26);
        let mut planes = vec![0.0; MAX_HARMONICS * cells];
        add_direct(basis, values, 1.0, &mut planes);
        self.light(&Relit { basis, frame: None, cells, planes: &planes }, &self.factors(basis, None))
    }

    /// A test stroke's direct light.
    fn direct(&self, test: &TestStroke) -> Vec<f32> {
        if self.view_region.is_none() || test.direct_to_viewers.is_empty() {
            return self.between(&test.direct);
        }
        let cells = self.cells.iter();
        cells.flat_map(|&cell| [test.direct_to_viewers[cell as usize]; VIEWPOINTS]).collect()
    }

    /// A test stroke's light, solved directly, and the part of it that the runtime adds itself.
    pub fn truth(&self, test: &TestStroke, direct_term: DirectTerm) -> (Vec<f32>, Vec<f32>) {
        // Light that was scattered on its way has no more than the solver's degree in it, direct light has.
        let rest: Vec<f32> = test.truth.iter().zip(&test.direct).map(|(all, direct)| all - direct).collect();
        let (mut truth, mut direct) = (self.smooth(&rest), self.direct(test));
        truth.iter_mut().zip(&direct).for_each(|(sum, direct)| *sum += direct);
        if direct_term == DirectTerm::InRows {
            direct.fill(0.0);
        }
        (truth, direct)
    }
}

/// Test strokes with their light as it is judged, for responses of one cloud that leave the same cells out.
pub struct HeldOutSet {
    views: Views,
    strokes: Vec<(Vec<f32>, Vec<f32>)>,
}

impl HeldOutSet {
    /// Prepares the light of `tests`, which [`HeldOutSet::scores`] is to be given again. Eyes are those of `number`.
    pub fn new(
        cloud: &Cloud,
        view_region: Option<&ViewRegion>,
        direct: DirectTerm,
        tests: &[TestStroke],
        number: u64,
    ) -> Self {
        let seen = tests.first().map(|test| test.seen.clone()).unwrap_or_default();
        let views = Views::new(cloud, view_region, number, |cell| seen.is_empty() || seen[cell]);
        let strokes = tests.par_iter().map(|test| views.truth(test, direct)).collect();
        Self { views, strokes }
    }

    /// Relights every test stroke from `relighter`'s bytes. Each figure is the root mean square (L2) or the mean (tail, median)
    /// over strokes.
    pub fn scores(&self, relighter: &Relighter, tests: &[TestStroke]) -> Result<Scores, BakeError> {
        let frame =
            relighter.view_region().map(|view_region| view_region_frame(view_region, relighter.cloud()));
        let factors = self.views.factors(relighter.response().head.channels, frame.as_ref());
        let each: Vec<Result<Scores, BakeError>> = tests
            .par_iter()
            .zip(&self.strokes)
            .map(|(test, (truth, direct))| {
                let mut buffers = RelightBuffers::default();
                let relit = relighter.relight(&test.lights, RelightOptions::default(), &mut buffers)?;
                let mut shown = self.views.light(&relit, &factors);
                let unpacked = Relit { planes: &test.uncompressed, ..relit };
                let codec = self.views.compare(&shown, &self.views.light(&unpacked, &factors));
                shown.iter_mut().zip(direct).for_each(|(sum, direct)| *sum += direct);
                Ok(Scores { codec, stroke: self.views.compare(&shown, truth) })
            })
            .collect();
        let (mut sum, mut count) = (Scores::default(), 0.0f64);
        for scores in each {
            let scores = scores?;
            for (to, from) in [(&mut sum.codec, scores.codec), (&mut sum.stroke, scores.stroke)] {
                to.l2 += from.l2 * from.l2;
                to.tail += from.tail;
                to.median += from.median;
            }
            count += 1.0;
        }
        for part in [&mut sum.codec, &mut sum.stroke] {
            part.l2 = libm::sqrt(part.l2 / count.max(1.0));
            part.tail /= count.max(1.0);
            part.median /= count.max(1.0);
        }
        Ok(sum)
    }
}

/// A [`HeldOutSet`] for one response alone.
pub fn evaluate(relighter: &Relighter, tests: &[TestStroke], number: u64) -> Result<Scores, BakeError> {
    let held_out_set =
        HeldOutSet::new(relighter.cloud(), relighter.view_region(), relighter.direct(), tests, number);
    held_out_set.scores(relighter, tests)
}

/// Errors of `found` against `wanted`, `weights.len()` values a cell each of which counts for its weight; weights sum to 1.
fn compare_views(found: &[f32], wanted: &[f32], weights: &[f64]) -> RelitError {
    let peak = wanted.iter().fold(0.0f32, |peak, &v| peak.max(v.abs()));
    let (mut square, mut wanted_square) = (0.0, 0.0);
    let (mut differences, mut relative) = (Vec::with_capacity(wanted.len()), Vec::new());
    for (i, (&x, &r)) in found.iter().zip(wanted).enumerate() {
        let difference = f64::from(x - r);
        square += weights[i % weights.len()] * difference * difference;
        wanted_square += weights[i % weights.len()] * f64::from(r) * f64::from(r);
        differences.push((x - r).abs());
        if r > 1e-4 * peak {
            relative.push((x - r).abs() / r);
        }
    }
    // Nothing is off from nothing; something is, beyond any measure. So is what is no number.
    if !(wanted_square > 0.0 && square.is_finite()) {
        let off = if square == 0.0 && wanted_square == 0.0 { 0.0 } else { f64::INFINITY };
        return RelitError { l2: off, tail: off, median: off };
    }
    let pick = |values: &mut Vec<f32>, share: f64| -> f64 {
        if values.is_empty() {
            return 0.0;
        }
        let at = ((values.len() as f64 - 1.0) * share) as usize;
        f64::from(*values.select_nth_unstable_by(at, f32::total_cmp).1)
    };
    RelitError {
        l2: libm::sqrt(square / wanted_square),
        tail: pick(&mut differences, 0.999) / f64::from(peak),
        median: pick(&mut relative, 0.5),
    }
}

/// Stretches of given strokes, each moved by up to `shift` metres: unseen light where only the lamps around those strokes
/// were baked. Points that are not `usable` are left out; a stretch keeps at least half of its own.
pub fn shifted_strokes(
    strokes: &[Vec<PointLight>],
    usable: impl Fn(DVec3) -> bool,
    shift: f64,
    numbers: Range<usize>,
) -> Vec<Vec<PointLight>> {
    /// Tries for each stretch before it is given up.
    const TRIES: u64 = 50;
    let mut found = Vec::new();
    for number in numbers {
        let Some(whole) = strokes.get(number.checked_rem(strokes.len()).unwrap_or(0)) else { break };
        if whole.is_empty() {
            continue;
        }
        for attempt in 0..TRIES {
            let mut random = Random::from_parts(&[0x5417, number as u64, attempt]);
            let length = ((whole.len() as f64 * random.range(0.3, 1.0)) as usize).max(1);
            let start = (random.unit() * (whole.len() - length) as f64) as usize;
            let by = random.direction() * (shift * random.unit());
            let moved = |light: &PointLight| PointLight { position: light.position + by, ..*light };
            let stretch = whole[start..start + length].iter().map(moved);
            let stretch: Vec<PointLight> = stretch.filter(|light| usable(light.position)).collect();
            if 2 * stretch.len() >= length {
                found.push(stretch);
                break;
            }
        }
    }
    found
}

/// Extinction of the cell that `point` lies in, 1/m; 0 outside the grid.
pub fn extinction_at(cloud: &Cloud, point: DVec3) -> f32 {
    let cell: [f64; 3] =
        std::array::from_fn(|axis| ((point[axis] - cloud.origin_m[axis]) / cloud.cell_m[axis]).floor());
    let counts = cloud.shape.to_array();
    if (0..3).any(|axis| cell[axis] < 0.0 || cell[axis] >= counts[axis] as f64) {
        return 0.0;
    }
    cloud.extinction[cloud.shape.index(cell[0] as usize, cell[1] as usize, cell[2] as usize)]
}

/// Strokes grown at random between points of the reach that lie in or under the cloud; half of them run to the reach's floor.
/// Points are `spacing` metres apart. The same seed gives the same strokes.
pub fn test_strokes(
    cloud: &Cloud,
    reach: [DVec3; 2],
    usable: impl Fn(DVec3) -> bool,
    spacing: f64,
    numbers: Range<usize>,
) -> Vec<Vec<PointLight>> {
    /// Tries for each stroke before it is given up.
    const TRIES: u64 = 200;
    let densest = cloud.extinction.iter().fold(0.0f32, |most, &e| most.max(e));
    let [low, high] = reach;
    let mut strokes = Vec::new();
    for number in numbers.start as u64..numbers.end as u64 {
        for attempt in 0..TRIES {
            let mut random = Random::from_parts(&[0x7e57, number, attempt]);
            let mut place = || {
                DVec3::new(
                    random.range(low.x, high.x),
                    random.range(low.y, high.y),
                    random.range(low.z, high.z),
                )
            };
            let (from, mut to) = (place(), place());
            if number % 2 == 1 {
                to.z = low.z;
            }
            if extinction_at(cloud, from) < 0.1 * densest {
                continue;
            }
            let record = StrokeRecord {
                name: String::new(),
                seed: number * TRIES + attempt,
                from_m: from.to_array(),
                to_m: to.to_array(),
                segment_m: from.distance(to) / 60.0,
                turn_rad: 0.28,
                wander: 0.15,
                branching: 0.1,
                branch_rad: 0.6,
                branch_length: 0.5,
                max_order: 2,
                branch_intensity: 0.4,
                intensity_w_per_sr: 1.0,
                color: [1.0; 3],
            };
            if record.check().is_err() {
                continue;
            }
            let lights = Stroke::grow(&record).lights(spacing);
            if lights.iter().all(|light| usable(light.position)) {
                strokes.push(lights);
                break;
            }
        }
    }
    strokes
}
