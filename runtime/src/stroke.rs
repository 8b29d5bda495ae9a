//! Lightning strokes: grown from a seed, and turned into points of light.
//!
//! The channel follows Reed and Wyvill \[reed-wyvill\]: short segments, each turned away from the channel's heading by a small
//! random angle, branches that leave at a wider one and keep to their parent's heading. The heading itself wanders: the
//! straight line from start to end is displaced at its middle, then each half at its own, as real channels stray at every
//! scale. Light falls with branch order and towards the tip of a branch, and along a channel it is in proportion to length.

use crate::random::Random;
use crate::relight::PointLight;
use glam::DVec3;
use squall_formats::section::bolt::StrokeRecord;

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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stroke {
    /// Main channel first, then branches as they were left.
    pub segments: Vec<Segment>,
}

/// More segments than this are not grown; branches beyond are left out.
const MAX_SEGMENTS: usize = 1 << 16;
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
        let mut stroke = Self::default();
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
    fn growth_is_bounded_whatever_the_numbers() {
        let wild =
            StrokeRecord { branching: 1.0, branch_length: 1.0, max_order: 8, segment_m: 1.0, ..record() };
        assert!(wild.check().is_ok());
        assert!(Stroke::grow(&wild).segments.len() <= MAX_SEGMENTS);
    }
}
