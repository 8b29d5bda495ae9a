//! Light that runs along a channel: the leader's tip comes down in 20 ms, the front of a return stroke runs up at a third of light's
//! speed. A stroke is cut into pieces along its way, each with a brightness of its own; light is linear, so that the pieces together
//! are the stroke. Exposures that see all of it pass see the stroke as a whole.

use super::curve::FlashCurve;
use crate::error::RuntimeError;
use crate::stroke::{Segment, Stroke};
use glam::DVec3;
use squall_formats::units::{MetresPerSecond, Seconds};
use std::collections::HashMap;
use std::sync::Arc;

/// How fast the front of a return stroke runs up its channel: a third of light's speed.
pub const FRONT_SPEED: MetresPerSecond = MetresPerSecond(1e8);

/// Most pieces that a stroke is cut into.
const MOST_PIECES: usize = 64;

/// When light reaches a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Passage {
    /// The front of a return stroke, after the stroke begins at the ground, s: when it enters, when it leaves.
    pub front: [f64; 2],
    /// The leader's tip, as shares of its time, 0 to 1.
    pub leader: [f64; 2],
    /// What the leader's light is multiplied by, so that all pieces together have the whole's.
    pub leader_share: f64,
}

/// A stroke cut into pieces along its way from the ground.
///
/// ```
/// use squall_runtime::{Stroke, formats::units::Seconds, frame::{ChannelPieces, FlashCurve}, glam::DVec3};
/// let stroke = Stroke::between(DVec3::new(0.0, 0.0, 3000.0), DVec3::ZERO, 7, 1e7)?;
/// let pieces = ChannelPieces::of(&stroke, 12)?;
/// // Five microseconds after it began, the front has come half a kilometre far.
/// let seen = pieces.brightness(&FlashCurve::natural(3), Seconds(4e-6), Seconds(1e-6));
/// assert!(seen[0] > 0.5 && seen[11] < 0.1 * seen[0]);
/// # Ok::<(), squall_runtime::RuntimeError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelPieces {
    strokes: Vec<Arc<Stroke>>,
    passages: Vec<Passage>,
}

/// Of a segment, m: from the ground along the channel to its two ends, the smaller first; from where the leader began to its middle.
#[derive(Clone, Copy)]
struct Along {
    ground: [f64; 2],
    cloud: f64,
}

impl ChannelPieces {
    /// A stroke in `count` pieces about as long along its main channel, the one at the ground first, branches with what the front reaches at
    /// the same time. The ground is at the lower end of the main channel.
    ///
    /// Errors: as [`Stroke::check`]; no piece, or more than 64.
    pub fn of(stroke: &Stroke, count: usize) -> Result<Self, RuntimeError> {
        stroke.check()?;
        if !(1..=MOST_PIECES).contains(&count) {
            return Err(RuntimeError::argument("pieces", format!("1 to {MOST_PIECES}"), count));
        }
        let (along, length) = along(&stroke.segments);
        let farthest = along.iter().map(|own| own.ground[1]).fold(0.0, f64::max);
        let mut parts = vec![Vec::<(Segment, Along)>::new(); count];
        for (segment, own) in stroke.segments.iter().zip(along) {
            let place = 0.5 * (own.ground[0] + own.ground[1]) / farthest.max(f64::MIN_POSITIVE);
            parts[((place * count as f64) as usize).min(count - 1)].push((*segment, own));
        }
        let (mut strokes, mut passages) = (Vec::new(), Vec::new());
        for part in parts.iter().filter(|part| !part.is_empty()) {
            let segments: Vec<Segment> = part.iter().map(|(segment, _)| *segment).collect();
            passages.push(passage(part, length));
            strokes.push(Arc::new(Stroke { segments, color: stroke.color }));
        }
        let mut pieces = Self { strokes, passages };
        pieces.share_leader();
        Ok(pieces)
    }

    /// Scales the leader's light so that all pieces together give what a light that grows evenly does.
    fn share_leader(&mut self) {
        let lights = self.strokes.iter().map(|stroke| stroke.intensity());
        let (mut all, mut lit) = (0.0, 0.0);
        for (light, passage) in lights.zip(&self.passages) {
            all += light;
            lit += light * (1.0 - 0.5 * (passage.leader[0] + passage.leader[1]));
        }
        let share = if lit > 0.0 { 0.5 * all / lit } else { 1.0 };
        self.passages.iter_mut().for_each(|passage| passage.leader_share = share);
    }

    /// The pieces as strokes, that at the ground first.
    pub fn strokes(&self) -> &[Arc<Stroke>] {
        &self.strokes
    }

    /// Every piece's brightness over a shutter that opens at `opens` and stays open for `exposure`, which is above 0: [`FlashCurve::mean`] of
    /// the piece. Keys and continuing currents light all pieces alike.
    pub fn brightness(&self, curve: &FlashCurve, opens: Seconds, exposure: Seconds) -> Vec<f64> {
        self.passages.iter().map(|passage| curve.mean_of_piece(passage, opens, exposure)).collect()
    }
}

/// What the segments of a piece have in common.
fn passage(part: &[(Segment, Along)], length: f64) -> Passage {
    let ends = part.iter().map(|(_, own)| own.ground);
    let [from, to] = ends.fold([f64::INFINITY, 0.0], |[a, b], [c, d]| [a.min(c), f64::max(b, d)]);
    let (mut light, mut moment) = (0.0, 0.0);
    for (segment, own) in part {
        // Dark segments count a little, so that a dark piece has a place.
        let weight = segment.intensity + f64::MIN_POSITIVE;
        light += weight;
        moment += weight * own.cloud;
    }
    let (middle, half) = (moment / light, 0.5 * (to - from));
    let share = |metres: f64| (metres / length.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    Passage {
        front: [from, to].map(|metres| metres / FRONT_SPEED.0),
        leader: [share(middle - half), share(middle + half)],
        leader_share: 1.0,
    }
}

/// Where each segment lies along the way of light, and the length of the main channel.
fn along(segments: &[Segment]) -> (Vec<Along>, f64) {
    let main = segments.iter().filter(|segment| segment.order == 0);
    let length: f64 = main.clone().map(|segment| segment.from.distance(segment.to)).sum();
    let ends = (main.clone().next(), main.clone().next_back());
    let is_up = matches!(ends, (Some(first), Some(last)) if first.from.z < last.to.z);
    let bits = |point: DVec3| point.to_array().map(f64::to_bits);
    // A branch that starts where no segment before it ends leaves the nearest point of the main channel.
    let nearest = |point: DVec3| {
        let mut gone = 0.0;
        let mut best = (f64::INFINITY, [0.0; 2]);
        for segment in main.clone() {
            let own = segment.from.distance(segment.to);
            for (end, way) in [(segment.from, gone), (segment.to, gone + own)] {
                let place = if is_up { [way, length - way] } else { [length - way, way] };
                if end.distance(point) < best.0 {
                    best = (end.distance(point), place);
                }
            }
            gone += own;
        }
        best.1
    };
    // From the ground, and from the leader's beginning, to the points that segments end in.
    let mut known: HashMap<[u64; 3], [f64; 2]> = HashMap::new();
    let mut all = Vec::with_capacity(segments.len());
    let mut gone = 0.0;
    for segment in segments {
        let own = segment.from.distance(segment.to);
        let (start, end) = if segment.order == 0 {
            let place = |gone: f64| if is_up { [gone, length - gone] } else { [length - gone, gone] };
            gone += own;
            (place(gone - own), place(gone))
        } else {
            let start = known.get(&bits(segment.from)).copied().unwrap_or_else(|| nearest(segment.from));
            (start, start.map(|metres| metres + own))
        };
        known.insert(bits(segment.to), end);
        let ground = [start[0].min(end[0]).max(0.0), start[0].max(end[0])];
        all.push(Along { ground, cloud: 0.5 * (start[1] + end[1]) });
    }
    (all, length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stroke() -> Stroke {
        Stroke::between(DVec3::new(100.0, 0.0, 3000.0), DVec3::new(0.0, 200.0, 0.0), 7, 1e7).unwrap()
    }

    fn sum(pieces: &ChannelPieces, brightness: &[f64]) -> f64 {
        pieces.strokes().iter().zip(brightness).map(|(piece, own)| piece.intensity() * own).sum()
    }

    #[test]
    fn pieces_hold_every_segment_once_and_together_have_the_strokes_light() {
        /// Sums of some hundred numbers; a front that passes within an exposure is all of its light but for tails of a millionth.
        const ROUND_OFF: f64 = 1e-6;
        let stroke = stroke();
        let pieces = ChannelPieces::of(&stroke, 12).unwrap();
        let count: usize = pieces.strokes().iter().map(|piece| piece.segments.len()).sum();
        assert_eq!(count, stroke.segments.len());
        for seed in 0..6 {
            let curve = FlashCurve::natural(seed);
            for (opens, exposure) in [(-0.05, 0.06), (-0.03, 3.0)] {
                let seen = pieces.brightness(&curve, Seconds(opens), Seconds(exposure));
                let wanted = curve.mean(Seconds(opens), Seconds(exposure)) * stroke.intensity();
                let found = sum(&pieces, &seen);
                assert!((found / wanted - 1.0).abs() < ROUND_OFF, "{seed} {opens}: {found} {wanted}");
            }
        }
        for late in [10.0, 1e4, 1e8] {
            let seen = pieces.brightness(&FlashCurve::natural(2), Seconds(late), Seconds(1e-6));
            assert!(seen.iter().all(|&own| own == 0.0), "{late}: {seen:?}");
        }
        assert!(ChannelPieces::of(&stroke, 0).is_err() && ChannelPieces::of(&stroke, 65).is_err());
    }

    #[test]
    fn the_front_runs_up_at_a_third_of_lights_speed_and_the_leader_comes_down() {
        let stroke = stroke();
        let pieces = ChannelPieces::of(&stroke, 12).unwrap();
        let curve = FlashCurve::natural(3);
        let lowest = |piece: &Stroke| piece.segments.iter().map(|s| s.from.z.min(s.to.z)).fold(1e9, f64::min);
        assert!(lowest(&pieces.strokes()[0]) < 1.0, "the first piece stands on the ground");
        // 12 µs after the beginning the front is 1.2 km along the channel.
        let at = 12e-6;
        let seen = pieces.brightness(&curve, Seconds(at - 5e-8), Seconds(1e-7));
        // What was alight before the stroke began, the leader.
        let before = pieces.brightness(&curve, Seconds(-2e-6), Seconds(1e-6));
        for ((passage, now), before) in pieces.passages.iter().zip(&seen).zip(&before) {
            let is_passed = passage.front[0] < at - 1e-7;
            assert_eq!(*now > 2.0 * before, is_passed, "{passage:?}: {now} {before}");
        }
        assert!(seen[0] > 10.0 * before[0] && pieces.passages[11].front[0] > at);
        // Half way down, the leader lights the upper half alone.
        let half = pieces.brightness(&curve, Seconds(-0.0101), Seconds(1e-4));
        assert!(half[0] == 0.0 && half[1] == 0.0 && half[11] > 0.0, "{half:?}");
        let lit = half.iter().filter(|own| **own > 0.0).count();
        assert!((4..=8).contains(&lit), "{half:?}");
    }

    #[test]
    fn keys_light_all_pieces_alike_and_no_light_is_below_zero() {
        let pieces = ChannelPieces::of(&stroke(), 5).unwrap();
        let keys = [(Seconds(0.0), 1.0), (Seconds(1.0), 3.0)];
        let curve = FlashCurve::from_keys(&keys).unwrap();
        let seen = pieces.brightness(&curve, Seconds(0.4), Seconds(0.2));
        assert!(seen.iter().all(|own| (own - 2.0).abs() < 1e-12), "{seen:?}");
        let natural = FlashCurve::natural(4);
        for step in 0..400 {
            let opens = Seconds(-0.025 + f64::from(step) * 1e-4);
            for exposure in [1e-9, 1e-6, 1e-4] {
                let seen = pieces.brightness(&natural, opens, Seconds(exposure));
                assert!(seen.iter().all(|own| *own >= 0.0 && own.is_finite()), "{opens:?} {seen:?}");
            }
        }
    }
}
