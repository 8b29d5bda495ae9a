//! A flash in time: how brightly a stroke shines from moment to moment, and what an exposure sees of it.
//!
//! A curve is a share of the stroke's stated intensity. It is a sum of return strokes, of pieces that are linear in time (leader,
//! continuing current, an artist's keys), each integrated over the shutter in closed form. The unit is chosen so that an exposure of
//! 1/30 s that holds the first return stroke and nothing else has brightness 1; a shorter one that holds it is brighter, as its mean is.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | E      | `energy`: a return stroke's integral over time | s |
//! | r, d   | `RISE_S`, `DECAY_S` of its light | s |
//!
//! i(t) = E (e^{−t/d} − e^{−t/r})/(d − r) from its start on.

use super::front::Passage;
use crate::error::RuntimeError;
use crate::random::mix;
use squall_formats::units::Seconds;
use std::f64::consts::TAU;

/// Integral of the first return stroke, s: of brightness 1 in a frame of film's 30 a second.
pub const FIRST_STROKE_S: f64 = 1.0 / 30.0;
/// Time in which a return stroke's light rises, s: some microseconds of the current and the front's way up the channel.
const RISE_S: f64 = 2e-5;
/// Time in which it fades, s: optical pulses are some 150 to 200 µs wide.
const DECAY_S: f64 = 1.5e-4;
/// Share of flashes with one stroke alone, and mean number of strokes of all flashes.
const SINGLE_SHARE: f64 = 1.0 / 3.0;
const MEAN_STROKES: f64 = 3.67;
/// Intervals between strokes: geometric mean, s, and standard deviation in decades.
const INTERVAL_S: f64 = 0.063;
const INTERVAL_DECADES: f64 = 0.32;
/// Subsequent strokes over the first: geometric mean (peak currents of 12 and 30 kA), and standard deviation in decades.
const SUBSEQUENT: f64 = 0.4;
const SUBSEQUENT_DECADES: f64 = 0.25;
/// Share of strokes after the first with a continuing current, its light over its own stroke's integral, 1/s, and its duration: geometric
/// mean, s, and decades.
const CONTINUING_SHARE: f64 = 0.3;
const CONTINUING_PER_S: f64 = 2.0;
const CONTINUING_S: f64 = 0.12;
const CONTINUING_DECADES: f64 = 0.3;
/// The stepped leader: it comes down in so long, s, and is at its end so bright over the first stroke's integral, 1/s.
const LEADER_S: f64 = 0.02;
const LEADER_PER_S: f64 = 0.6;
/// Most strokes of one flash; records are in the twenties.
const MOST_STROKES: u32 = 26;

/// A return stroke of a flash.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReturnStroke {
    /// When its light begins to rise.
    pub start: Seconds,
    /// Its integral over time, in units of the stroke's stated intensity, s.
    pub energy: Seconds,
}

/// A light that grows or fades evenly between two moments.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Line {
    from: f64,
    to: f64,
    start: f64,
    end: f64,
    /// Whether it is a leader, whose tip comes down the channel.
    is_leader: bool,
}

/// How brightly a stroke shines from moment to moment.
///
/// ```
/// use squall_runtime::{formats::units::Seconds, frame::FlashCurve};
/// let flash = FlashCurve::natural(7);
/// // The first return stroke begins at time 0: nothing is brighter than a frame that holds it.
/// let lit = flash.mean(Seconds(-0.001), Seconds(1.0 / 30.0));
/// let dark = flash.mean(Seconds(-10.0), Seconds(1.0 / 30.0));
/// assert!(lit > 0.9 && dark == 0.0);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlashCurve {
    strokes: Vec<ReturnStroke>,
    lines: Vec<Line>,
}

/// Draws from a seed, one after the other.
struct Draws(u64);

impl Draws {
    /// Uniform in (0, 1).
    fn uniform(&mut self) -> f64 {
        self.0 = mix(self.0.wrapping_add(0x9e37_79b9_7f4a_7c15));
        ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// Log-normal: geometric mean and standard deviation in decades.
    fn spread(&mut self, middle: f64, decades: f64) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(self.uniform()));
        let normal = radius * libm::cos(TAU * self.uniform());
        middle * libm::pow(10.0, decades * normal)
    }
}

impl FlashCurve {
    /// A flash as nature draws them, its first return stroke at time 0: number of strokes, intervals and strengths by the statistics
    /// of observed flashes, a stepped leader before the first, continuing currents after some. Another seed is another flash.
    pub fn natural(seed: u64) -> Self {
        let mut draws = Draws(mix(seed ^ 0x666c_6173_6800));
        let mut curve = Self::default();
        let leader = LEADER_PER_S * FIRST_STROKE_S;
        curve.lines.push(Line { from: -LEADER_S, to: 0.0, start: 0.0, end: leader, is_leader: true });
        let mut add_line = |from: f64, to: f64, start: f64, end: f64| {
            curve.lines.push(Line { from, to, start, end, is_leader: false });
        };
        let mut strokes = vec![ReturnStroke { start: Seconds(0.0), energy: Seconds(FIRST_STROKE_S) }];
        if draws.uniform() >= SINGLE_SHARE {
            // Two, and more as often as leaves the mean where it is.
            let others = (MEAN_STROKES - SINGLE_SHARE) / (1.0 - SINGLE_SHARE) - 2.0;
            let again = others / (1.0 + others);
            let mut count = 2;
            while count < MOST_STROKES && draws.uniform() < again {
                count += 1;
            }
            let mut at = 0.0;
            for _ in 1..count {
                at += draws.spread(INTERVAL_S, INTERVAL_DECADES);
                let energy = FIRST_STROKE_S * draws.spread(SUBSEQUENT, SUBSEQUENT_DECADES);
                strokes.push(ReturnStroke { start: Seconds(at), energy: Seconds(energy) });
                if draws.uniform() < CONTINUING_SHARE {
                    let long = draws.spread(CONTINUING_S, CONTINUING_DECADES);
                    add_line(at, at + long, CONTINUING_PER_S * energy, 0.0);
                }
            }
        }
        curve.strokes = strokes;
        curve
    }

    /// A curve through keys, times and intensities, straight between them and dark outside.
    ///
    /// Errors: fewer than two keys, times that do not rise, numbers that are not finite, an intensity below 0.
    pub fn from_keys(keys: &[(Seconds, f64)]) -> Result<Self, RuntimeError> {
        let refused = |wanted: &str, found: String| Err(RuntimeError::argument("flash keys", wanted, found));
        if keys.len() < 2 {
            return refused("at least two of a stroke, which it shines between", keys.len().to_string());
        }
        if let Some((time, value)) =
            keys.iter().find(|(time, value)| !(time.0.is_finite() && *value >= 0.0 && value.is_finite()))
        {
            return refused("finite times, and intensities of 0 or more", format!("{value} at {} s", time.0));
        }
        let lines = keys.windows(2).map(|pair| Line {
            from: pair[0].0.0,
            to: pair[1].0.0,
            start: pair[0].1,
            end: pair[1].1,
            is_leader: false,
        });
        let lines: Vec<Line> = lines.collect();
        match lines.iter().find(|line| line.from >= line.to) {
            Some(line) => refused("times that rise", format!("{} s after {} s", line.to, line.from)),
            None => Ok(Self { strokes: Vec::new(), lines }),
        }
    }

    /// The same curve later by `delay`.
    #[must_use]
    pub fn delayed(mut self, delay: Seconds) -> Self {
        self.strokes.iter_mut().for_each(|stroke| stroke.start.0 += delay.0);
        for line in &mut self.lines {
            line.from += delay.0;
            line.to += delay.0;
        }
        self
    }

    /// The same curve, `factor` times as bright.
    #[must_use]
    pub fn times(mut self, factor: f64) -> Self {
        self.strokes.iter_mut().for_each(|stroke| stroke.energy.0 *= factor);
        for line in &mut self.lines {
            line.start *= factor;
            line.end *= factor;
        }
        self
    }

    /// Both lights together: curves add.
    #[must_use]
    pub fn and(mut self, other: Self) -> Self {
        self.strokes.extend(other.strokes);
        self.lines.extend(other.lines);
        self
    }

    /// Its return strokes, in the order in which they were added.
    pub fn return_strokes(&self) -> &[ReturnStroke] {
        &self.strokes
    }

    /// From when to when there is light, s: to where a return stroke has faded to a millionth. `None` for a curve without light.
    pub fn span(&self) -> Option<[Seconds; 2]> {
        let faded = DECAY_S * 14.0;
        let strokes = self.strokes.iter().map(|stroke| [stroke.start.0, stroke.start.0 + faded]);
        let all = strokes.chain(self.lines.iter().map(|line| [line.from, line.to]));
        let span = all.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        Some(span.map(Seconds))
    }

    /// Share of the stroke's stated intensity at one moment, as an exposure of no length would have it.
    pub fn value(&self, time: Seconds) -> f64 {
        let pulse = |stroke: &ReturnStroke| {
            let t = time.0 - stroke.start.0;
            let shape = libm::exp(-t / DECAY_S) - libm::exp(-t / RISE_S);
            if t > 0.0 { stroke.energy.0 * shape / (DECAY_S - RISE_S) } else { 0.0 }
        };
        let line = |line: &Line| {
            let t = (time.0 - line.from) / (line.to - line.from);
            if (0.0..1.0).contains(&t) { line.start + (line.end - line.start) * t } else { 0.0 }
        };
        self.strokes.iter().map(pulse).sum::<f64>() + self.lines.iter().map(line).sum::<f64>()
    }

    /// Mean over a shutter that opens at `opens` and stays open for `exposure`: what a [`super::Flash`]'s brightness is. The integral is
    /// exact; an exposure of 0 is [`FlashCurve::value`].
    pub fn mean(&self, opens: Seconds, exposure: Seconds) -> f64 {
        if exposure.0 <= 0.0 {
            return self.value(opens);
        }
        let closes = opens.0 + exposure.0;
        let strokes = self.strokes.iter().map(|stroke| {
            let until = |time: f64| stroke.energy.0 * faded(time - stroke.start.0);
            until(closes) - until(opens.0)
        });
        let lines = self.lines.iter().map(|line| line.integral(opens.0, closes));
        ((strokes.sum::<f64>() + lines.sum::<f64>()) / exposure.0).max(0.0)
    }

    /// The same of a piece of the channel, which fronts and leaders pass in a time of their own.
    pub(super) fn mean_of_piece(&self, passage: &Passage, opens: Seconds, exposure: Seconds) -> f64 {
        let closes = opens.0 + exposure.0;
        let [enters, leaves] = passage.front;
        let strokes = self.strokes.iter().map(|stroke| {
            let until = |time: f64| {
                let t = time - stroke.start.0;
                stroke.energy.0 * faded_behind(t - enters, t - leaves)
            };
            until(closes) - until(opens.0)
        });
        let lines = self.lines.iter().map(|line| match line.is_leader {
            true => line.passing(passage).iter().map(|part| part.integral(opens.0, closes)).sum(),
            false => line.integral(opens.0, closes),
        });
        ((strokes.sum::<f64>() + lines.sum::<f64>()) / exposure.0).max(0.0)
    }
}

/// Rise of a piece's light once the front is there, s; [`RISE_S`] has the front's way in it.
const PIECE_RISE_S: f64 = 5e-6;

/// Decay times after which less than an ulp of a stroke's light is still to come.
const LONG_FADED: f64 = 40.0;

/// Share of a return stroke's light that is out of a piece which the front entered `first` and left `last` ago, s.
fn faded_behind(first: f64, last: f64) -> f64 {
    // All of it; the difference below would be that of two long times, and its ulps over a moment's exposure would shine.
    if last > LONG_FADED * DECAY_S {
        return 1.0;
    }
    let share = |t: f64, fade: f64| t - fade * -libm::expm1(-t / fade);
    // ∫ of what is faded at one place over the front's time in the piece.
    let sum = |t: f64| {
        if t <= 0.0 {
            return 0.0;
        }
        (DECAY_S * share(t, DECAY_S) - PIECE_RISE_S * share(t, PIECE_RISE_S)) / (DECAY_S - PIECE_RISE_S)
    };
    let time = (first - last).max(1e-9);
    (sum(last + time) - sum(last)) / time
}

/// Share of a return stroke's light that is out after `t`.
fn faded(t: f64) -> f64 {
    if t <= 0.0 {
        return 0.0;
    }
    let (decay, rise) = (DECAY_S * -libm::expm1(-t / DECAY_S), RISE_S * -libm::expm1(-t / RISE_S));
    (decay - rise) / (DECAY_S - RISE_S)
}

impl Line {
    /// A leader's light in a piece: it grows while the tip passes, and stays until the return stroke.
    fn passing(&self, passage: &Passage) -> [Self; 2] {
        let at = |share: f64| self.from + (self.to - self.from) * share;
        let [enters, leaves] = passage.leader.map(at);
        let end = self.end * passage.leader_share;
        let own = Self { from: enters, to: leaves, start: 0.0, end, is_leader: true };
        [own, Self { from: leaves, to: self.to, start: end, ..own }]
    }

    /// Its light between two moments.
    fn integral(&self, from: f64, to: f64) -> f64 {
        let (low, high) = (from.max(self.from), to.min(self.to));
        if low >= high {
            return 0.0;
        }
        let at =
            |time: f64| self.start + (self.end - self.start) * (time - self.from) / (self.to - self.from);
        0.5 * (at(low) + at(high)) * (high - low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLASHES: u64 = 4000;

    #[test]
    fn seeded_flashes_have_the_statistics_of_observed_ones() {
        /// Standard errors of 4000 flashes are some 1 to 2 %; four of them.
        const SAMPLING: f64 = 0.08;
        /// Four standard deviations of the mean of ten thousand intervals .32 decades wide.
        const INTERVALS: f64 = 0.03;
        let flashes: Vec<FlashCurve> = (0..FLASHES).map(FlashCurve::natural).collect();
        let counts: Vec<usize> = flashes.iter().map(|flash| flash.return_strokes().len()).collect();
        let mean = counts.iter().sum::<usize>() as f64 / FLASHES as f64;
        let single = counts.iter().filter(|count| **count == 1).count() as f64 / FLASHES as f64;
        assert!((mean / 3.67 - 1.0).abs() < SAMPLING, "{mean} strokes a flash");
        assert!((single / SINGLE_SHARE - 1.0).abs() < SAMPLING, "{single} have one stroke");
        let mut logs = Vec::new();
        for flash in &flashes {
            for pair in flash.return_strokes().windows(2) {
                logs.push(libm::log10(pair[1].start.0 - pair[0].start.0));
            }
        }
        let middle = logs.iter().sum::<f64>() / logs.len() as f64;
        let spread =
            (logs.iter().map(|log| (log - middle) * (log - middle)).sum::<f64>() / logs.len() as f64).sqrt();
        let geometric = libm::pow(10.0, middle);
        assert!((geometric / INTERVAL_S - 1.0).abs() < INTERVALS, "{geometric} s between strokes");
        assert!((spread / 0.32 - 1.0).abs() < SAMPLING, "{spread} decades");
    }

    #[test]
    fn the_mean_over_a_shutter_is_the_integral_of_the_value() {
        /// Midpoint rule with steps of 1 µs against rises of 20.
        const QUADRATURE: f64 = 1e-3;
        let curve = FlashCurve::natural(5).and(FlashCurve::natural(11).delayed(Seconds(0.0007)).times(0.5));
        for (opens, exposure) in [(-0.004, 0.005), (-0.0001, 0.0004), (0.0, 0.02)] {
            let steps = (exposure * 1e6) as usize;
            let at =
                |step: usize| curve.value(Seconds(opens + (step as f64 + 0.5) * exposure / steps as f64));
            let sum = (0..steps).map(at).sum::<f64>() / steps as f64;
            let mean = curve.mean(Seconds(opens), Seconds(exposure));
            assert!((mean - sum).abs() <= QUADRATURE * sum, "{mean} {sum}");
        }
        assert_eq!(curve.mean(Seconds(0.1), Seconds(0.0)), curve.value(Seconds(0.1)));
    }

    #[test]
    fn frames_end_to_end_lose_none_of_the_light() {
        /// Round-off of a sum of some hundred terms, and the leader's and the strokes' tails.
        const ROUND_OFF: f64 = 1e-9;
        for seed in 0..40 {
            let curve = FlashCurve::natural(seed);
            let [from, to] = curve.span().unwrap();
            let whole =
                curve.mean(Seconds(from.0 - 1.0), Seconds(to.0 - from.0 + 2.0)) * (to.0 - from.0 + 2.0);
            let frames = ((to.0 - from.0) * 24.0).ceil() as usize + 2;
            let frame = |k: usize| curve.mean(Seconds(from.0 + k as f64 / 24.0), Seconds(1.0 / 24.0)) / 24.0;
            let sum: f64 = (0..frames).map(frame).sum();
            assert!((sum - whole).abs() < ROUND_OFF, "{seed}: {sum} {whole}");
        }
    }

    #[test]
    fn an_exposure_that_holds_the_first_stroke_alone_has_brightness_one() {
        let curve = FlashCurve { lines: Vec::new(), ..FlashCurve::natural(0) };
        let first = FlashCurve { strokes: curve.strokes[..1].to_vec(), ..curve };
        assert!((first.mean(Seconds(-0.001), Seconds(1.0 / 30.0)) - 1.0).abs() < 1e-9);
        assert!((first.mean(Seconds(-0.001), Seconds(1.0 / 120.0)) - 4.0).abs() < 1e-9);
    }

    #[test]
    fn two_flashes_mix_and_keys_are_straight_lines() {
        let [a, b] = [FlashCurve::natural(3), FlashCurve::natural(4).delayed(Seconds(0.05))];
        let both = a.clone().and(b.clone());
        for k in 0..20 {
            let (opens, exposure) = (Seconds(f64::from(k) / 50.0), Seconds(0.02));
            let sum = a.mean(opens, exposure) + b.mean(opens, exposure);
            assert!((both.mean(opens, exposure) - sum).abs() < 1e-12);
        }
        let keys = [(Seconds(1.0), 0.0), (Seconds(2.0), 4.0), (Seconds(4.0), 0.0)];
        let curve = FlashCurve::from_keys(&keys).unwrap();
        assert_eq!(
            (curve.value(Seconds(1.5)), curve.value(Seconds(3.0)), curve.value(Seconds(5.0))),
            (2.0, 2.0, 0.0)
        );
        assert!((curve.mean(Seconds(0.0), Seconds(10.0)) - 0.6).abs() < 1e-12);
        for wrong in [
            vec![],
            vec![(Seconds(0.0), 1.0)],
            vec![(Seconds(0.0), 1.0), (Seconds(0.0), 2.0)],
            vec![(Seconds(0.0), 1.0), (Seconds(1.0), -2.0)],
            vec![(Seconds(0.0), 1.0), (Seconds(f64::NAN), 2.0)],
        ] {
            assert!(FlashCurve::from_keys(&wrong).is_err(), "{wrong:?}");
        }
    }
}
