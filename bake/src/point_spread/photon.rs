//! The life of a photon around a point light.

use super::spread::Light;
use super::{BATCHES, BINS, PHOTONS, SpreadSettings};
use crate::error::BakeError;
use crate::monte_carlo::phase::{Phase as Sampled, around, azimuth};
use crate::progress::Progress;
use glam::DVec3;
use rayon::prelude::*;
use squall_runtime::RuntimeError;
use squall_runtime::medium::Phase;
use squall_runtime::point_spread::axes::{self, FARTHEST, RADII};
use squall_runtime::random::Random;

/// Nearest place of a first scattering that is drawn evenly in ln ρ.
const FIRST_NEAR: f64 = 0.5 * axes::NEAREST;
/// Scatterings at which roulette begins; it comes again at every doubling.
const PATIENCE: u32 = 32;
/// Photons between two looks at whether to stop.
const STEP: u64 = 256;
/// Steps of a tabulated phase function's cumulative distribution.
const QUANTILES: usize = 7200;

/// A phase function that photons can be scattered by.
pub enum SpreadPhase {
    /// Henyey and Greenstein's.
    HenyeyGreenstein(Sampled),
    /// The cumulative distribution over the angle, in even steps of it.
    Table(Vec<f64>),
}

impl SpreadPhase {
    /// One colour of a phase function.
    ///
    /// Errors: the paper's as printed, which loses light and has no distribution.
    pub fn new(phase: &Phase, band: usize) -> Result<Self, BakeError> {
        match phase {
            &Phase::HenyeyGreenstein(g) => Ok(Self::HenyeyGreenstein(Sampled::new(g))),
            Phase::Table(table) => {
                let step = std::f64::consts::PI / QUANTILES as f64;
                let mut sum = vec![0.0];
                for i in 0..QUANTILES {
                    let (sin, cos) = libm::sincos(step * (i as f64 + 0.5));
                    sum.push(sum[i] + table.values(cos)[band] * sin);
                }
                let whole = sum[QUANTILES];
                Ok(Self::Table(sum.into_iter().map(|value| value / whole).collect()))
            }
            other => {
                let wanted = "a phase function that scatters all it takes";
                Err(RuntimeError::argument("phase", wanted, format!("{other:?}")).into())
            }
        }
    }

    fn scatter(&self, direction: DVec3, random: &mut Random) -> DVec3 {
        match self {
            Self::HenyeyGreenstein(phase) => phase.scatter(direction, random),
            Self::Table(sums) => {
                let drawn = random.unit();
                let bin = sums.partition_point(|&sum| sum <= drawn).clamp(1, QUANTILES);
                let share = (drawn - sums[bin - 1]) / (sums[bin] - sums[bin - 1]).max(f64::MIN_POSITIVE);
                let angle = std::f64::consts::PI / QUANTILES as f64 * (bin as f64 - 1.0 + share);
                let (sin, cos) = libm::sincos(angle);
                let (x, y) = azimuth(random);
                around(direction, cos, sin * x, sin * y).normalize()
            }
        }
    }
}

/// The shells' edges, and what photons leave in them.
struct Tally<'a> {
    edges: &'a [f64],
    /// Order 1, then all above it: by shell, then angle.
    light: [Vec<f64>; 2],
}

impl Tally<'_> {
    /// The shell of a place at distance `r` from the light, none inside the first.
    fn shell(&self, r: f64) -> Option<usize> {
        let place = (axes::place(r) - axes::place(axes::NEAREST)) / axes::step();
        (place >= 0.0).then(|| (place as usize).min(RADII - 1))
    }

    /// Leaves weight times length along a flight from `start`, `length` long.
    fn leave(
        &mut self,
        order: usize,
        (start, way): (DVec3, DVec3),
        length: f64,
        weight: f64,
        random: &mut Random,
    ) {
        let middle = start.dot(way);
        let least = (start.length_squared() - middle * middle).max(0.0);
        let mut shell = self.shell(start.length());
        let mut at = 0.0;
        // From shell to shell: inwards while the light comes nearer, then outwards.
        for _ in 0..2 * RADII + 4 {
            let inner = shell.map(|shell| self.edges[shell]).filter(|edge| edge * edge > least);
            let inwards = inner.map(|edge| -middle - (edge * edge - least).sqrt()).filter(|&t| t > at);
            let outer = self.edges[shell.map_or(0, |shell| shell + 1)];
            let outwards = -middle + (outer * outer - least).max(0.0).sqrt();
            let (next, beyond) = match inwards {
                Some(t) => (t, shell.and_then(|shell| shell.checked_sub(1))),
                None => (outwards, Some(shell.map_or(0, |shell| shell + 1))),
            };
            let end = next.min(length).max(at);
            if let Some(shell) = shell
                && end > at
            {
                let t = at + (end - at) * random.unit();
                let along = middle + t;
                let r = (least + along * along).sqrt();
                // (1 − cos α)/2 without a difference of ones.
                let less = if along > 0.0 { least / (r + along) } else { r - along };
                let bin = axes::angle_place((0.5 * less / r).sqrt(), BINS + 1) as usize;
                let share = weight * (end - at) * (1.0 + 0.5 * r)
                    / (4.0 * std::f64::consts::PI * r * r * axes::step());
                self.light[order][shell * BINS + bin.min(BINS - 1)] += share;
            }
            if next >= length || beyond.is_some_and(|shell| shell >= RADII) {
                return;
            }
            (at, shell) = (end, beyond);
        }
    }
}

/// A distance for the first scattering, and its weight.
fn first_flight(random: &mut Random) -> (f64, f64) {
    let whole = -libm::expm1(-FARTHEST);
    let span = libm::log(FARTHEST / FIRST_NEAR);
    let r = match random.unit() < 0.5 {
        true => -libm::log1p(-random.unit() * whole),
        false => FIRST_NEAR * libm::exp(span * random.unit()),
    };
    let own = libm::exp(-r);
    let even = if r >= FIRST_NEAR { 0.5 / (r * span) } else { 0.0 };
    (r.min(FARTHEST * (1.0 - 1e-12)), own / (0.5 * own / whole + even))
}

/// Follows one photon.
fn follow(phase: &SpreadPhase, power: f64, random: &mut Random, tally: &mut Tally<'_>) {
    let (r, weight) = first_flight(random);
    let mut way = DVec3::Z;
    let (mut place, mut weight) = (way * r, weight * power);
    for order in 1u32.. {
        way = phase.scatter(way, random);
        let middle = place.dot(way);
        let leaves =
            -middle + (middle * middle + FARTHEST * FARTHEST - place.length_squared()).max(0.0).sqrt();
        let length = random.exponential();
        tally.leave(usize::from(order > 1), (place, way), length.min(leaves), weight, random);
        if length >= leaves {
            return;
        }
        place += way * length;
        if order >= PATIENCE && order.is_power_of_two() {
            if random.unit() < 0.5 {
                return;
            }
            weight *= 2.0;
        }
    }
}

/// Radiance around a point light: order 1, and all above it. `stream` tells phase functions' random numbers apart.
///
/// Errors: photons out of range, an interruption.
pub fn solve_light(
    phase: &SpreadPhase,
    settings: &SpreadSettings,
    stream: u64,
    progress: &dyn Progress,
) -> Result<Light, BakeError> {
    if !PHOTONS.contains(&settings.photons) {
        let wanted = format!("{} to {} photons", PHOTONS.start(), PHOTONS.end());
        return Err(RuntimeError::argument("photons", wanted, settings.photons).into());
    }
    let edges: Vec<f64> = (0..=RADII).map(axes::edge).collect();
    let run = |batch: u64| -> Result<[Vec<f64>; 2], BakeError> {
        let light = std::array::from_fn(|_| vec![0.0; RADII * BINS]);
        let mut tally = Tally { edges: &edges, light };
        let photons = settings.photons / BATCHES + u64::from(batch < settings.photons % BATCHES);
        // A source of 1 W/sr on all sides.
        let power = 4.0 * std::f64::consts::PI / photons as f64;
        for photon in 0..photons {
            if photon % STEP == 0 {
                progress.check()?;
                progress.advance(STEP.min(photons - photon));
            }
            let mut random = Random::from_parts(&[settings.seed, stream, batch, photon]);
            follow(phase, power, &mut random, &mut tally);
        }
        Ok(tally.light)
    };
    let batches = (0..BATCHES).into_par_iter().map(run).collect::<Result<Vec<_>, _>>()?;
    Ok(Light::of(&batches))
}
