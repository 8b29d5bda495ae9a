//! Held-out strokes: which they are, and what they say of a response's bytes.

use super::views::Views;
use super::{RelitError, Scores};
use crate::error::BakeError;
use crate::response::HeldOutStroke;
use glam::DVec3;
use rayon::prelude::*;
use squall_formats::section::bolt::StrokeRecord;
use squall_formats::section::response::{DirectTerm, DirectionalBasis};
use squall_formats::sphere::MAX_HARMONICS;
use squall_formats::view_region::ViewRegion;
use squall_runtime::Clouds;
use squall_runtime::clouds::LightQuality;
use squall_runtime::random::Random;
use squall_runtime::relight::{
    PointLight, RelightBuffers, RelightOptions, Relighter, Relit, view_region_frame,
};
use squall_runtime::stroke::Stroke;
use squall_runtime::transport::Cloud;
use std::ops::Range;

/// Held-out strokes with their light as it is seen, for responses of one cloud that leave the same cells out.
pub struct HeldOutSet {
    views: Views,
    strokes: Vec<(Vec<f32>, Vec<f32>)>,
}

impl HeldOutSet {
    /// Prepares the light of `strokes`, which [`HeldOutSet::scores`] is to be given again. Viewpoints are those of `number`.
    pub fn new(
        cloud: &Cloud,
        view_region: Option<&ViewRegion>,
        direct: DirectTerm,
        strokes: &[HeldOutStroke],
        number: u64,
    ) -> Self {
        let seen = strokes.first().map(|stroke| stroke.seen.clone()).unwrap_or_default();
        let views = Views::new(cloud, view_region, number, |cell| seen.is_empty() || seen[cell]);
        let strokes = strokes.par_iter().map(|stroke| views.truth(stroke, direct)).collect();
        Self { views, strokes }
    }

    /// Relights every stroke from `relighter`'s bytes; scores are [`RelitError::mean`] over strokes.
    ///
    /// Errors: a stroke that the asset has no rows for, a damaged row.
    pub fn scores(&self, relighter: &Relighter, strokes: &[HeldOutStroke]) -> Result<Scores, BakeError> {
        let frame = relighter
            .view_region()
            .map(|view_region| view_region_frame(view_region, relighter.light_cloud()));
        let factors = self.views.factors(relighter.response().head.basis, frame.as_ref());
        let each: Vec<Result<Scores, BakeError>> = strokes
            .par_iter()
            .zip(&self.strokes)
            .map(|(stroke, (truth, direct))| {
                let mut buffers = RelightBuffers::default();
                let relit = relighter.relight(&stroke.lights, RelightOptions::default(), &mut buffers)?;
                let mut shown = self.views.light(&relit, &factors);
                let unpacked = Relit { planes: &stroke.uncompressed, ..relit };
                let codec = self.views.compare(&shown, &self.views.light(&unpacked, &factors));
                shown.iter_mut().zip(direct).for_each(|(sum, direct)| *sum += direct);
                Ok(Scores { codec, stroke: self.views.compare(&shown, truth) })
            })
            .collect();
        let each = each.into_iter().collect::<Result<Vec<Scores>, _>>()?;
        let mean = |of: fn(&Scores) -> RelitError| RelitError::mean(&each.iter().map(of).collect::<Vec<_>>());
        Ok(Scores { codec: mean(|scores| scores.codec), stroke: mean(|scores| scores.stroke) })
    }
}

impl HeldOutSet {
    /// How far the strokes' light is off their truth when it is relit from `clouds`' rows and gathered `gathers` times, against all light as
    /// [`HeldOutSet::scores`] has it.
    ///
    /// Errors: rows that light cannot be gathered from, a stroke that the asset has no rows for, a damaged row.
    pub fn gathered(
        &self,
        clouds: &mut Clouds,
        strokes: &[HeldOutStroke],
        gathers: u32,
    ) -> Result<RelitError, BakeError> {
        clouds.set_quality(LightQuality { gathers, ..LightQuality::PLAIN })?;
        let basis = DirectionalBasis::Harmonics { degree: 3 };
        let factors = self.views.factors(basis, None);
        let mut errors = Vec::with_capacity(strokes.len());
        for (stroke, (truth, direct)) in strokes.iter().zip(&self.strokes) {
            let light = clouds.light(&stroke.lights)?;
            let coefficients = light.in_scattered().live.as_chunks::<MAX_HARMONICS>().0;
            let cells = coefficients.len();
            let plane = |m: usize| coefficients.iter().map(move |row| row[m]);
            let planes: Vec<f32> = (0..MAX_HARMONICS).flat_map(plane).collect();
            let relit = Relit { basis, frame: None, cells, planes: &planes };
            let mut found = self.views.light(&relit, &factors);
            found.iter_mut().zip(direct).for_each(|(sum, direct)| *sum += direct);
            errors.push(self.views.compare(&found, truth));
        }
        Ok(RelitError::mean(&errors))
    }
}

/// Scores of one response alone: [`HeldOutSet::scores`].
///
/// Errors: as there.
pub fn evaluate(relighter: &Relighter, strokes: &[HeldOutStroke], number: u64) -> Result<Scores, BakeError> {
    let set = HeldOutSet::new(
        relighter.light_cloud(),
        relighter.view_region(),
        relighter.direct(),
        strokes,
        number,
    );
    set.scores(relighter, strokes)
}

/// Stretches of given strokes, each moved by up to `shift` metres: light that no row was baked for where only
/// virtual lights around those strokes were. Points that are not `usable` are left out; a stretch keeps at least half of its own.
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

/// Strokes grown at random between points of `bounds` that lie in or under the cloud; half of them run to the floor of `bounds`.
/// Points are `spacing` metres apart. The same seed gives the same strokes.
pub fn grown_strokes(
    cloud: &Cloud,
    bounds: [DVec3; 2],
    usable: impl Fn(DVec3) -> bool,
    spacing: f64,
    numbers: Range<usize>,
) -> Vec<Vec<PointLight>> {
    /// Tries for each stroke before it is given up.
    const TRIES: u64 = 200;
    let densest = cloud.extinction.iter().fold(0.0f32, |most, &e| most.max(e));
    let [low, high] = bounds;
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
