//! Lightning strokes: grown from a seed, and turned into points of light.
//!
//! The channel follows Reed and Wyvill \[reed-wyvill\]: short segments, each turned away from the channel's heading by a small
//! random angle, branches that leave at a wider one and keep to their parent's heading. The heading itself wanders: the
//! straight line from start to end is displaced at its middle, then each half at its own, as real channels stray at every
//! scale. Light falls with branch order and towards the tip of a branch, and along a channel it is in proportion to length.
//!
//! A few numbers grow up to [`MAX_SEGMENTS`] segments, so strokes grow when they flash and not when an asset is opened, and
//! those that flash together have a limit in sum: [`grow_together`]. Growth is specified to the bit in SPEC.md, "Growth of a
//! stroke", since light grids are pruned to where segments are.

mod named;

use crate::error::RuntimeError;
use crate::random::Random;
use crate::relight::PointLight;
use glam::DVec3;
pub(crate) use named::Strokes;
use squall_formats::section::bolt::{BoltSection, StrokeRecord};
use squall_formats::section::view::ViewFlash;
use squall_formats::{Limits, ReadError};
use std::collections::HashMap;

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

/// A grown stroke.
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

/// A stroke has no more segments than this; branches beyond are left out.
pub const MAX_SEGMENTS: usize = 1 << 16;
/// Shortest segments of [`Stroke::between`], m.
const SHORTEST_USUAL_M: f64 = 5.0;
/// Halvings of the main channel's line.
const WANDER_LEVELS: u32 = 5;
/// How fast a branch fades towards its tip: light per length goes as (distance to the tip)^½.
const TAPER: f64 = 0.5;

/// A branch that waits to be grown.
#[derive(Clone, Copy)]
struct Bud {
    at: DVec3,
    heading: DVec3,
    length: f64,
    order: u8,
    brightness: f64,
}

/// A stroke while it grows.
struct Growth<'r> {
    record: &'r StrokeRecord,
    random: Random,
    /// Segments that it stops at.
    most: usize,
    segments: Vec<Segment>,
    /// Branches in the order in which they were left, which is that in which they grow.
    buds: Vec<Bud>,
}

impl Growth<'_> {
    /// The line that the main channel follows: from start to end, halved and displaced level by level.
    fn line(&mut self) -> Vec<DVec3> {
        let (from, to) = (DVec3::from_array(self.record.from_m), DVec3::from_array(self.record.to_m));
        let mut line = vec![from, to];
        for level in 0..WANDER_LEVELS {
            let mut finer = Vec::with_capacity(2 * line.len());
            for pair in line.windows(2) {
                let offset =
                    self.record.wander * (pair[1] - pair[0]).length() * if level == 0 { 1.0 } else { 0.8 };
                let side = across(pair[1] - pair[0], &mut self.random);
                let middle = 0.5 * (pair[0] + pair[1]);
                finer.extend([pair[0], middle + side * (offset * self.random.normal() * 0.5)]);
            }
            finer.push(to);
            line = finer;
        }
        line
    }

    /// The main channel: segments that turn about the line's heading and end where it ends.
    fn follow(&mut self, line: &[DVec3]) {
        let record = self.record;
        let total: f64 = line.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let (mut at, mut goal, mut gone) = (line[0], 1, 0.0);
        while goal < line.len() && self.segments.len() < self.most {
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
            let heading = turned(left.normalize(), record.turn_rad, &mut self.random);
            let end = at + heading * record.segment_m;
            self.push(at, end, 0, 1.0);
            gone += record.segment_m;
            if self.random.unit() < record.branching && record.max_order > 0 {
                let length = (total - gone).max(0.0) * record.branch_length * self.random.range(0.25, 1.0);
                let parent = left.normalize();
                self.leave(
                    parent,
                    Bud { at: end, heading: parent, length, order: 1, brightness: record.branch_intensity },
                );
            }
            at = end;
        }
    }

    /// A branch: the same turns about a heading of its own, fading to nothing.
    fn branch(&mut self, bud: Bud) {
        let record = self.record;
        let (mut at, mut gone, mut heading) = (bud.at, 0.0, bud.heading);
        while gone < bud.length && self.segments.len() < self.most {
            // The heading drifts slowly, the segments scatter about it.
            heading = turned(heading, 0.25 * record.turn_rad, &mut self.random);
            let end = at + turned(heading, record.turn_rad, &mut self.random) * record.segment_m;
            let left = (1.0 - gone / bud.length).max(0.0);
            let brightness = bud.brightness * libm::pow(left, TAPER);
            self.push(at, end, bud.order, brightness);
            gone += record.segment_m;
            let order = bud.order + 1;
            if order <= record.max_order && self.random.unit() < record.branching {
                let length =
                    (bud.length - gone).max(0.0) * record.branch_length * self.random.range(0.25, 1.0);
                let brightness = brightness * record.branch_intensity;
                self.leave(heading, Bud { at: end, heading, length, order, brightness });
            }
            at = end;
        }
    }

    /// Leaves a branch that turns away from its parent's heading.
    fn leave(&mut self, parent: DVec3, bud: Bud) {
        let heading = turned(parent, self.record.branch_rad, &mut self.random);
        self.buds.push(Bud { heading, ..bud });
    }

    fn push(&mut self, from: DVec3, to: DVec3, order: u8, brightness: f64) {
        self.segments.push(Segment { from, to, order, intensity: brightness * from.distance(to) });
    }
}

/// Grows strokes that flash together, in the order given.
///
/// Errors: [`ReadError::OverLimit`] where they have more than `limits.segments` segments in sum; memory beyond that is not
/// taken, nor work done.
pub fn grow_together<'r>(
    records: impl IntoIterator<Item = &'r StrokeRecord>,
    limits: &Limits,
) -> Result<Vec<Stroke>, ReadError> {
    let (mut strokes, mut grown) = (Vec::new(), 0u64);
    for record in records {
        let left = usize::try_from(limits.segments - grown).unwrap_or(usize::MAX);
        let stroke = Stroke::grow_up_to(record, MAX_SEGMENTS.min(left.saturating_add(1)));
        grown += stroke.segments.len() as u64;
        if grown > limits.segments {
            return Err(ReadError::OverLimit {
                section: BoltSection::TAG,
                field: "segments of strokes that flash together",
                wanted: grown,
                allowed: limits.segments,
            });
        }
        strokes.push(stroke);
    }
    Ok(strokes)
}

/// The records of the strokes that `flashes` name and give light, each with its factor; of strokes of one name the first.
///
/// Errors: the first name that no record has.
pub fn flashing<'r, 'f>(
    flashes: &'f [ViewFlash],
    records: &'r [StrokeRecord],
) -> Result<Vec<(&'r StrokeRecord, f64)>, &'f str> {
    let mut named = HashMap::with_capacity(records.len());
    for record in records {
        named.entry(record.name.as_str()).or_insert(record);
    }
    let lit = flashes.iter().filter(|flash| flash.brightness > 0.0);
    lit.map(|flash| match named.get(flash.stroke.as_str()) {
        Some(&record) => Ok((record, flash.brightness)),
        None => Err(flash.stroke.as_str()),
    })
    .collect()
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

    /// Grows the stroke of `record`, whose numbers must have passed [`StrokeRecord::check`]: at most [`MAX_SEGMENTS`]
    /// segments, some 5 MB while it grows.
    pub fn grow(record: &StrokeRecord) -> Self {
        Self::grow_up_to(record, MAX_SEGMENTS)
    }

    /// Like [`Stroke::grow`], but stops at `most` segments.
    fn grow_up_to(record: &StrokeRecord, most: usize) -> Self {
        let random = Random::from_parts(&[record.seed, 0x424f_4c54]);
        let mut growth = Growth { record, random, most, segments: Vec::new(), buds: Vec::new() };
        let line = growth.line();
        growth.follow(&line);
        let mut next = 0;
        while next < growth.buds.len() && growth.segments.len() < most {
            growth.branch(growth.buds[next]);
            next += 1;
        }
        let mut segments = growth.segments;
        let total: f64 = segments.iter().map(|s| s.intensity).sum();
        let scale = if total > 0.0 { record.intensity_w_per_sr / total } else { 0.0 };
        segments.iter_mut().for_each(|s| s.intensity *= scale);
        Self { segments, color: record.color }
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

    fn wild() -> StrokeRecord {
        StrokeRecord { branching: 1.0, branch_length: 1.0, max_order: 8, segment_m: 1.0, ..record() }
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
        assert!(wild().check().is_ok());
        assert_eq!(Stroke::grow(&wild()).segments.len(), MAX_SEGMENTS);
    }

    #[test]
    fn strokes_that_flash_together_are_bounded_in_sum_and_each_is_what_it_is_alone() {
        let few = record();
        let alone = Stroke::grow(&few);
        let segments = 2 * alone.segments.len() as u64;
        let limits = Limits { segments, ..Limits::default() };
        assert_eq!(grow_together([&few, &few], &limits).unwrap(), [alone.clone(), alone]);
        let one_less = Limits { segments: segments - 1, ..Limits::default() };
        match grow_together([&few, &few], &one_less) {
            Err(ReadError::OverLimit { wanted, allowed, .. }) => {
                assert_eq!((wanted, allowed), (segments, segments - 1));
            }
            other => panic!("{other:?}"),
        }
        let many = vec![wild(); 17];
        assert!(grow_together(&many[..16], &Limits::default()).is_ok(), "as many as the limit allows");
        assert!(grow_together(&many, &Limits::default()).is_err());
    }

    #[test]
    fn a_flash_finds_the_first_stroke_of_its_name_or_says_which_is_missing() {
        let flash = |stroke: &str, brightness| ViewFlash { stroke: stroke.into(), brightness };
        let records = [record(), StrokeRecord { seed: 9, ..record() }];
        let found = flashing(&[flash("test", 2.0), flash("dark", 0.0)], &records).unwrap();
        assert_eq!(found, [(&records[0], 2.0)]);
        assert_eq!(flashing(&[flash("gone", 1.0)], &records), Err("gone"));
    }
}
