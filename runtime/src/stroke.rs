//! Lightning strokes: grown from a seed, and turned into points of light.
//!
//! The channel follows Reed and Wyvill \[reed-wyvill\]: short segments, each turned away from the channel's heading by a small
//! random angle, branches that leave at a wider one and keep to their parent's heading. The heading itself wanders: the
//! straight line from start to end is displaced at its middle, then each half at its own, as real channels stray at every
//! scale. Light falls with branch order and towards the tip of a branch, and along a channel it is in proportion to length.

use crate::error::RuntimeError;
use crate::frame::{Flash, FlashStroke};
use crate::load::Asset;
use crate::random::Random;
use crate::relight::PointLight;
use glam::DVec3;
use squall_formats::section::bolt::{BoltSection, StrokeRecord};
use std::sync::Arc;

/// A straight piece of channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Start, m.
    pub from: DVec3,
    /// End, m.
    pub to: DVec3,
    /// 0 for the main channel, one more for each branching.
    pub order: u8,
    /// Radiant intensity of the whole piece, W/sr.
    pub intensity: f64,
}

/// A stroke of lightning: an asset's, grown from a seed, or one's own.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// Main channel first, then branches as they were left.
    pub segments: Vec<Segment>,
    /// Colour of its light: weights of the red, green and blue band, mean 1.
    pub color: [f32; 3],
}

impl Default for Stroke {
    /// White, and without a segment.
    fn default() -> Self {
        Self { segments: Vec::new(), color: [1.0; 3] }
    }
}

/// More segments than this are not grown; branches beyond are left out.
const MAX_SEGMENTS: usize = 1 << 16;
/// Shortest segments of [`Stroke::between`], m.
const SHORTEST_USUAL_M: f64 = 5.0;
/// Halvings of the main channel's line.
const WANDER_LEVELS: u32 = 5;
/// How fast a branch fades towards its tip: light per length goes as (distance to the tip)^½.
const TAPER: f64 = 0.5;

/// A branch that waits to be grown.
struct Bud {
    at: DVec3,
    heading: DVec3,
    length: f64,
    order: u8,
    brightness: f64,
}

impl Stroke {
    /// A stroke from `from` to `to` that is grown from `seed` as recipes grow theirs unless told otherwise, segments a hundredth
    /// of its length (5 m at least); `intensity` in W/sr, white.
    ///
    /// ```
    /// use squall_runtime::{Stroke, glam::DVec3};
    /// let stroke = Stroke::between(DVec3::new(0.0, 0.0, 900.0), DVec3::new(120.0, 40.0, 0.0), 7, 1e7)?;
    /// assert!((stroke.intensity() / 1e7 - 1.0).abs() < 1e-12);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    ///
    /// Errors: numbers that no stroke has ([`StrokeRecord::check`]); an empty path.
    pub fn between(from: DVec3, to: DVec3, seed: u64, intensity: f64) -> Result<Self, RuntimeError> {
        let record = StrokeRecord {
            name: "own".into(),
            seed,
            from_m: from.to_array(),
            to_m: to.to_array(),
            segment_m: (0.01 * from.distance(to)).max(SHORTEST_USUAL_M).min(from.distance(to)),
            intensity_w_per_sr: intensity,
            color: [1.0; 3],
            ..StrokeRecord::usual()
        };
        record.check().map_err(|(field, wanted, found)| RuntimeError::argument(field, wanted, found))?;
        Ok(Self::grow(&record))
    }

    /// A stroke of given segments.
    ///
    /// Errors: none, too many, or numbers that are not finite, negative intensities or colours.
    pub fn from_segments(segments: Vec<Segment>, color: [f32; 3]) -> Result<Self, RuntimeError> {
        let stroke = Self { segments, color };
        stroke.check()?;
        Ok(stroke)
    }

    /// A stroke along a line of points, `intensity` W/sr in all, spread evenly by length; a single point is a spark.
    ///
    /// ```
    /// use squall_runtime::{Stroke, glam::DVec3};
    /// let path = [DVec3::new(0.0, 0.0, 700.0), DVec3::new(50.0, 0.0, 650.0), DVec3::new(0.0, 20.0, 600.0)];
    /// let stroke = Stroke::from_points(&path, 2e6, [0.8, 0.75, 1.28])?;
    /// assert_eq!(stroke.segments.len(), 2);
    /// # Ok::<(), squall_runtime::RuntimeError>(())
    /// ```
    ///
    /// Errors: as [`Stroke::from_segments`].
    pub fn from_points(points: &[DVec3], intensity: f64, color: [f32; 3]) -> Result<Self, RuntimeError> {
        let single = [points.first().copied().unwrap_or_default(); 2];
        let line = if points.len() == 1 { &single } else { points };
        let total: f64 = line.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let count = line.len().saturating_sub(1) as f64;
        let segment = |pair: &[DVec3]| {
            let share = if total > 0.0 { pair[0].distance(pair[1]) / total } else { 1.0 / count };
            Segment { from: pair[0], to: pair[1], order: 0, intensity: intensity * share }
        };
        Self::from_segments(line.windows(2).map(segment).collect(), color)
    }

    /// Refuses a stroke whose public fields were set to what no stroke is.
    ///
    /// Errors: as [`Stroke::from_segments`].
    pub fn check(&self) -> Result<(), RuntimeError> {
        let count = self.segments.len();
        if count == 0 || count > MAX_SEGMENTS {
            return Err(RuntimeError::argument("stroke segments", format!("1 to {MAX_SEGMENTS}"), count));
        }
        for segment in &self.segments {
            if !(segment.from.is_finite() && segment.to.is_finite()) {
                let found = format!("{} to {}", segment.from, segment.to);
                return Err(RuntimeError::argument("stroke segment", "two finite points", found));
            }
            if !(segment.intensity >= 0.0 && segment.intensity.is_finite()) {
                let wanted = "a finite number from 0, W/sr";
                return Err(RuntimeError::argument("stroke intensity", wanted, segment.intensity));
            }
        }
        if !self.color.iter().all(|band| *band >= 0.0 && band.is_finite()) {
            let found = format!("{:?}", self.color);
            return Err(RuntimeError::argument("stroke colour", "three finite numbers from 0", found));
        }
        Ok(())
    }

    /// The same stroke in another colour: weights of the red, green and blue band.
    #[must_use]
    pub fn colored(self, color: [f32; 3]) -> Self {
        Self { color, ..self }
    }

    /// Grows the stroke of `record`, whose numbers must have passed [`StrokeRecord::check`].
    pub fn grow(record: &StrokeRecord) -> Self {
        let mut random = Random::from_parts(&[record.seed, 0x424f_4c54]);
        let (from, to) = (DVec3::from_array(record.from_m), DVec3::from_array(record.to_m));
        let mut line = vec![from, to];
        for level in 0..WANDER_LEVELS {
            let mut finer = Vec::with_capacity(2 * line.len());
            for pair in line.windows(2) {
                let offset =
                    record.wander * (pair[1] - pair[0]).length() * if level == 0 { 1.0 } else { 0.8 };
                let side = across(pair[1] - pair[0], &mut random);
                finer.extend([pair[0], 0.5 * (pair[0] + pair[1]) + side * (offset * random.normal() * 0.5)]);
            }
            finer.push(to);
            line = finer;
        }
        let mut stroke = Self { color: record.color, ..Self::default() };
        let mut buds = Vec::new();
        stroke.follow(record, &line, &mut random, &mut buds);
        let mut next = 0;
        while next < buds.len() && stroke.segments.len() < MAX_SEGMENTS {
            let bud = std::mem::replace(
                &mut buds[next],
                Bud { at: from, heading: DVec3::Z, length: 0.0, order: 0, brightness: 0.0 },
            );
            next += 1;
            stroke.branch(record, &bud, &mut random, &mut buds);
        }
        let total: f64 = stroke.segments.iter().map(|s| s.intensity).sum();
        let scale = if total > 0.0 { record.intensity_w_per_sr / total } else { 0.0 };
        stroke.segments.iter_mut().for_each(|s| s.intensity *= scale);
        stroke
    }

    /// The main channel: segments that turn about the line's heading and end where it ends.
    fn follow(&mut self, record: &StrokeRecord, line: &[DVec3], random: &mut Random, buds: &mut Vec<Bud>) {
        let total: f64 = line.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let (mut at, mut goal, mut gone) = (line[0], 1, 0.0);
        while goal < line.len() && self.segments.len() < MAX_SEGMENTS {
            let left = line[goal] - at;
            // A goal that is about reached hands over to the next; the last one is met exactly.
            if left.length() < 1.5 * record.segment_m {
                if goal + 1 < line.len() {
                    goal += 1;
                    continue;
                }
                self.push(at, line[goal], 0, 1.0);
                break;
            }
            let heading = turned(left.normalize(), record.turn_rad, random);
            let end = at + heading * record.segment_m;
            self.push(at, end, 0, 1.0);
            gone += record.segment_m;
            if random.unit() < record.branching && record.max_order > 0 {
                let length = (total - gone).max(0.0) * record.branch_length * random.range(0.25, 1.0);
                buds.push(self.bud(
                    record,
                    end,
                    left.normalize(),
                    length,
                    1,
                    record.branch_intensity,
                    random,
                ));
            }
            at = end;
        }
    }

    /// A branch: the same turns about a heading of its own, fading to nothing.
    fn branch(&mut self, record: &StrokeRecord, bud: &Bud, random: &mut Random, buds: &mut Vec<Bud>) {
        let (mut at, mut gone, mut heading) = (bud.at, 0.0, bud.heading);
        while gone < bud.length && self.segments.len() < MAX_SEGMENTS {
            // The heading drifts slowly, the segments scatter about it.
            heading = turned(heading, 0.25 * record.turn_rad, random);
            let end = at + turned(heading, record.turn_rad, random) * record.segment_m;
            let left = (1.0 - gone / bud.length).max(0.0);
            self.push(at, end, bud.order, bud.brightness * libm::pow(left, TAPER));
            gone += record.segment_m;
            let next_order = bud.order + 1;
            if next_order <= record.max_order && random.unit() < record.branching {
                let length = (bud.length - gone).max(0.0) * record.branch_length * random.range(0.25, 1.0);
                let brightness = bud.brightness * libm::pow(left, TAPER) * record.branch_intensity;
                buds.push(self.bud(record, end, heading, length, next_order, brightness, random));
            }
            at = end;
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn bud(
        &self,
        record: &StrokeRecord,
        at: DVec3,
        parent: DVec3,
        length: f64,
        order: u8,
        brightness: f64,
        random: &mut Random,
    ) -> Bud {
        Bud { at, heading: turned(parent, record.branch_rad, random), length, order, brightness }
    }

    fn push(&mut self, from: DVec3, to: DVec3, order: u8, brightness: f64) {
        self.segments.push(Segment { from, to, order, intensity: brightness * from.distance(to) });
    }

    /// Radiant intensity of all segments, W/sr.
    pub fn intensity(&self) -> f64 {
        self.segments.iter().map(|s| s.intensity).sum()
    }

    /// Points of light along the stroke: neighbouring segments of one channel are drawn together until they are `spacing`
    /// metres long, at their centre of intensity. Their intensities sum to the stroke's.
    pub fn lights(&self, spacing: f64) -> Vec<PointLight> {
        let mut lights = Vec::new();
        let (mut length, mut intensity, mut moment) = (0.0, 0.0, DVec3::ZERO);
        for (i, segment) in self.segments.iter().enumerate() {
            length += segment.from.distance(segment.to);
            intensity += segment.intensity;
            moment += segment.intensity * 0.5 * (segment.from + segment.to);
            let next = self.segments.get(i + 1);
            let ends = next.is_none_or(|n| n.order != segment.order || n.from != segment.to);
            if ends || length >= spacing {
                if intensity > 0.0 {
                    lights.push(PointLight { position: moment / intensity, intensity });
                }
                (length, intensity, moment) = (0.0, 0.0, DVec3::ZERO);
            }
        }
        lights
    }
}

/// The strokes of an asset, grown.
#[derive(Default)]
pub(crate) struct Strokes {
    list: Vec<(StrokeRecord, Arc<Stroke>)>,
}

impl Strokes {
    /// Errors: a damaged section. An asset without it has no strokes.
    pub fn of(asset: &Asset) -> Result<Self, RuntimeError> {
        if asset.directory().find(BoltSection::TAG).is_none() {
            return Ok(Self::default());
        }
        let section = asset.section(BoltSection::TAG, "the strokes", BoltSection::read)?;
        let grown = |record: StrokeRecord| {
            let stroke = Arc::new(Stroke::grow(&record));
            (record, stroke)
        };
        Ok(Self { list: section.strokes.into_iter().map(grown).collect() })
    }

    pub fn iter(&self) -> impl Iterator<Item = (&StrokeRecord, &Arc<Stroke>)> {
        self.list.iter().map(|(record, stroke)| (record, stroke))
    }

    /// The stroke that flashes. Errors: no stroke of the asset has its name.
    pub fn find(&self, flash: &Flash) -> Result<Arc<Stroke>, RuntimeError> {
        let name = match &flash.stroke {
            FlashStroke::Own(stroke) => return Ok(stroke.clone()),
            FlashStroke::Named(name) => name,
        };
        if let Some((_, stroke)) = self.list.iter().find(|(record, _)| record.name == *name) {
            return Ok(stroke.clone());
        }
        let names: Vec<&str> = self.list.iter().map(|(record, _)| record.name.as_str()).collect();
        let known = format!("the name of one of the asset's strokes ({})", names.join(", "));
        Err(RuntimeError::argument("flashes.stroke", known, name))
    }
}

/// A unit vector across `along`, at a random angle about it.
fn across(along: DVec3, random: &mut Random) -> DVec3 {
    let along = along.normalize_or(DVec3::Z);
    let first = along.any_orthonormal_vector();
    let second = along.cross(first);
    let (sin, cos) = libm::sincos(std::f64::consts::TAU * random.unit());
    first * cos + second * sin
}

/// `heading` turned away by a random angle of mean `mean` about a random axis.
fn turned(heading: DVec3, mean: f64, random: &mut Random) -> DVec3 {
    // Reed and Wyvill's angles are normal about their mean with a spread of a third of it.
    let angle = mean * (1.0 + random.normal() / 3.0);
    let side = across(heading, random);
    let (sin, cos) = libm::sincos(angle);
    (heading * cos + side * sin).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record() -> StrokeRecord {
        StrokeRecord {
            name: "test".into(),
            seed: 5,
            from_m: [0.0, 0.0, 3000.0],
            to_m: [500.0, -300.0, 0.0],
            segment_m: 40.0,
            turn_rad: 0.28,
            wander: 0.15,
            branching: 0.2,
            branch_rad: 0.6,
            branch_length: 0.5,
            max_order: 3,
            branch_intensity: 0.4,
            intensity_w_per_sr: 1e9,
            color: [1.0; 3],
        }
    }

    #[test]
    fn a_stroke_runs_from_its_start_to_its_end_without_a_gap() {
        let stroke = Stroke::grow(&record());
        let main: Vec<_> = stroke.segments.iter().filter(|s| s.order == 0).collect();
        assert_eq!(main[0].from, DVec3::new(0.0, 0.0, 3000.0));
        assert_eq!(main.last().unwrap().to, DVec3::new(500.0, -300.0, 0.0));
        assert!(main.windows(2).all(|pair| pair[0].to == pair[1].from));
        assert!(stroke.segments.iter().any(|s| s.order == 2), "branches of branches");
    }

    #[test]
    fn points_of_light_carry_the_strokes_whole_intensity() {
        let stroke = Stroke::grow(&record());
        for spacing in [1.0, 100.0, 1e9] {
            let sum: f64 = stroke.lights(spacing).iter().map(|light| light.intensity).sum();
            // Round-off of a few hundred additions.
            assert!((sum / 1e9 - 1.0).abs() < 1e-12);
        }
        assert!(stroke.lights(100.0).len() < stroke.segments.len());
    }

    #[test]
    fn light_per_length_falls_with_branch_order() {
        let stroke = Stroke::grow(&record());
        let brightest = |order: u8| -> f64 {
            let of = |s: &&Segment| s.order == order;
            let per_length = |s: &Segment| s.intensity / s.from.distance(s.to);
            stroke.segments.iter().filter(of).map(per_length).fold(0.0, f64::max)
        };
        assert!(brightest(0) > brightest(1) && brightest(1) > brightest(2));
    }

    #[test]
    fn the_same_seed_grows_the_same_stroke_and_another_seed_does_not() {
        assert_eq!(Stroke::grow(&record()), Stroke::grow(&record()));
        assert_ne!(Stroke::grow(&record()), Stroke::grow(&StrokeRecord { seed: 6, ..record() }));
    }

    #[test]
    fn own_strokes_carry_their_light_and_nonsense_is_refused() {
        let points = [DVec3::ZERO, DVec3::X * 3.0, DVec3::new(3.0, 1.0, 0.0)];
        let stroke = Stroke::from_points(&points, 8.0, [1.0; 3]).unwrap();
        assert_eq!(stroke.segments.iter().map(|s| s.intensity).collect::<Vec<_>>(), [6.0, 2.0]);
        assert_eq!(Stroke::from_points(&points[..1], 8.0, [1.0; 3]).unwrap().lights(0.0).len(), 1);
        assert!(Stroke::from_points(&[], 8.0, [1.0; 3]).is_err());
        assert!(Stroke::from_points(&points, f64::NAN, [1.0; 3]).is_err());
        assert!(Stroke::from_points(&points, -1.0, [1.0; 3]).is_err());
        assert!(Stroke::from_points(&points, 1.0, [1.0, f32::NAN, 1.0]).is_err());
        assert!(Stroke::from_points(&[DVec3::NAN, DVec3::ZERO], 1.0, [1.0; 3]).is_err());
        assert!(Stroke::between(DVec3::ZERO, DVec3::Z * 1e3, 1, 1e6).is_ok());
        assert!(Stroke::between(DVec3::ZERO, DVec3::ZERO, 1, f64::INFINITY).is_err());
    }

    #[test]
    fn growth_is_bounded_whatever_the_numbers() {
        let wild =
            StrokeRecord { branching: 1.0, branch_length: 1.0, max_order: 8, segment_m: 1.0, ..record() };
        assert!(wild.check().is_ok());
        assert!(Stroke::grow(&wild).segments.len() <= MAX_SEGMENTS);
    }
}
