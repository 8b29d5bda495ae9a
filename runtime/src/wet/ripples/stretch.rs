//! A stretch of time cut into steps, and the drops that strike in it: the same for a surface in memory and one on a card.

use super::{
    COURANT_SHARE, DropFlux, IMPACTS_MAX, Impact, RippleReport, RippleSettings, SHORTEST_SHARE, SLOT_S,
    STEPS_MAX, Scheme, step,
};
use crate::error::RuntimeError;
use crate::random::Random;

/// Time that goes by in one call.
pub struct Stretch {
    begin_s: f64,
    seconds: f64,
    /// Steps, 1 or more.
    pub steps: u32,
    /// When which drops strike, in order.
    pub arrivals: Vec<(f64, Impact)>,
}

impl Stretch {
    /// `seconds` from `time_s` on, and what was owed before; `None` where that is too short for a step and waits.
    ///
    /// Errors: as [`super::Ripples::advance`].
    pub fn new(
        settings: &RippleSettings,
        (time_s, owed_s): (f64, &mut f64),
        seconds: f64,
        (rain, seed): (&[DropFlux], u64),
    ) -> Result<Option<Self>, RuntimeError> {
        let longest = longest_step(settings);
        let most = longest * f64::from(STEPS_MAX);
        if !(0.0..=most).contains(&seconds) {
            return Err(RuntimeError::argument(
                "seconds",
                format!("0 to {most:.3} ({STEPS_MAX} steps)"),
                seconds,
            ));
        }
        let mut expected = 0.0;
        for flux in rain {
            expected += flux.check(area_m2(settings), seconds + *owed_s)?;
        }
        if expected > f64::from(IMPACTS_MAX) {
            return Err(RuntimeError::argument(
                "rain",
                format!("{IMPACTS_MAX} impacts in this call, all sizes together"),
                expected,
            ));
        }
        let seconds = seconds + *owed_s;
        // A step much shorter than the one before would lose the surface's motion to round-off.
        if seconds < SHORTEST_SHARE * longest {
            *owed_s = seconds;
            return Ok(None);
        }
        *owed_s = 0.0;
        let steps = libm::ceil(seconds / longest) as u32;
        let arrivals = arrivals(settings, time_s..time_s + seconds, rain, seed);
        Ok(Some(Self { begin_s: time_s, seconds, steps, arrivals }))
    }

    /// When a step ends, s.
    pub fn end_of(&self, step: u32) -> f64 {
        if step + 1 == self.steps {
            self.begin_s + self.seconds
        } else {
            self.begin_s + self.seconds * f64::from(step + 1) / f64::from(self.steps)
        }
    }

    /// What was done when all of it has gone by.
    pub fn report(&self) -> RippleReport {
        RippleReport { steps: self.steps, impacts: self.arrivals.len() as u32 }
    }
}

/// A lattice's area, m².
pub fn area_m2(settings: &RippleSettings) -> f64 {
    let spacing = f64::from(settings.spacing_m);
    (settings.cells[0] * settings.cells[1]) as f64 * spacing * spacing
}

/// Impacts of a stretch of time, in order. Arrivals of a Poisson process have exponential gaps; each flux and slot has a stream of its own.
fn arrivals(
    settings: &RippleSettings,
    span: std::ops::Range<f64>,
    rain: &[DropFlux],
    seed: u64,
) -> Vec<(f64, Impact)> {
    let area = area_m2(settings);
    let sides = [0, 1].map(|axis| settings.cells[axis] as f32 * settings.spacing_m);
    let mut arrivals = Vec::new();
    for (class, flux) in rain.iter().enumerate() {
        let rate = flux.impacts_per_m2_s * area;
        if rate <= 0.0 {
            continue;
        }
        for slot in (span.start / SLOT_S) as u64..=(span.end / SLOT_S) as u64 {
            let mut random = Random::from_parts(&[seed, class as u64, slot]);
            let (mut time, end) = (slot as f64 * SLOT_S, (slot + 1) as f64 * SLOT_S);
            loop {
                time -= libm::log(1.0 - random.unit()) / rate;
                if time >= end {
                    break;
                }
                let at_m = sides.map(|side| random.unit() as f32 * side);
                if span.contains(&time) {
                    arrivals.push((time, flux.impact(at_m, settings)));
                }
            }
        }
    }
    arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
    arrivals
}

/// The bound of C² falls with γ, and γ grows with the step: γ of the undamped bound's step is an upper one.
pub fn longest_step(settings: &RippleSettings) -> f64 {
    let eigenvalue = if settings.scheme == Scheme::Nine { 16.0 / 3.0 } else { 8.0 };
    let crossing = f64::from(settings.spacing_m) / f64::from(settings.speed_m_per_s);
    let longest = |gamma: f64| libm::sqrt(2.0 * (2.0 - gamma) / eigenvalue) * crossing;
    let gamma = step::damping(settings, longest(0.0));
    COURANT_SHARE * longest(gamma)
}
