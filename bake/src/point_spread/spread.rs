//! From radiance around a light to what the medium scatters of it, and the table of all phase functions.

use super::photon::{SpreadPhase, solve_light};
use super::{BATCHES, BINS, SpreadSettings};
use crate::error::BakeError;
use crate::monte_carlo::{Measured, Moments};
use crate::progress::Progress;
use rayon::prelude::*;
use squall_runtime::medium::{Phase, PhaseTable};
use squall_runtime::point_spread::axes::{self, ANGLES, ASYMMETRIES, PHASES, RADII, VALUES};
use std::f64::consts::PI;
use std::sync::Arc;

/// Azimuths over half a turn that a phase function is averaged over.
const AZIMUTHS: usize = 256;

/// Radiance around a point light, ρ L dω in bins of the angle, mean over shells: order 1, and all above it.
#[derive(Clone, Debug)]
pub struct Light {
    orders: [Moments; 2],
}

impl Light {
    /// Of batches, each an estimate of the whole.
    pub(super) fn of(batches: &[[Vec<f64>; 2]]) -> Self {
        let mut orders = std::array::from_fn(|_| Moments::new(RADII * BINS));
        for (count, batch) in batches.iter().enumerate() {
            for (moments, values) in orders.iter_mut().zip(batch) {
                Moments::add(moments, values, (count + 1) as f64);
            }
        }
        Self { orders }
    }

    /// Radiance in the middle of a shell and a bin, order 1 (`more` = false) or all above, per I β².
    pub fn radiance(&self, more: bool, shell: usize, bin: usize) -> Measured {
        let [low, high] = [0.0, 1.0].map(|edge| axes::sine(bin as f64 + edge, BINS + 1));
        // ∫ sin α dα is 2 d sin²(α/2).
        let unit = 4.0 * PI * (high * high - low * low) * axes::radius(shell);
        let Measured { mean, standard_error } = self.orders[usize::from(more)].measured(shell * BINS + bin);
        Measured { mean: mean / unit, standard_error: standard_error / unit }
    }

    /// Sine of half the angle in a bin's middle.
    pub fn half_sine(bin: usize) -> f64 {
        axes::sine(bin as f64 + 0.5, BINS + 1)
    }
}

/// A phase function's mean around the way from the light, by bin of arriving light, then node of light that goes on, 1/sr.
fn turned(phase: &Phase, band: usize) -> Vec<f64> {
    let cos_sin = |half: f64| (1.0 - 2.0 * half * half, 2.0 * half * (1.0 - half * half).max(0.0).sqrt());
    let row = |bin: usize| -> Vec<f64> {
        let from = cos_sin(Light::half_sine(bin));
        let node = |j: usize| {
            let to = cos_sin(axes::sine(j as f64, ANGLES));
            let value = |k: usize| {
                let azimuth = libm::cos(PI * (k as f64 + 0.5) / AZIMUTHS as f64);
                phase.values((from.0 * to.0 + from.1 * to.1 * azimuth).clamp(-1.0, 1.0))[band]
            };
            (0..AZIMUTHS).map(value).sum::<f64>() / AZIMUTHS as f64
        };
        (0..ANGLES).map(node).collect()
    };
    (0..BINS).into_par_iter().flat_map_iter(row).collect()
}

/// ρ J of two scatterings and more, by shell, then node of angle, per I β².
pub fn scattered(light: &Light, phase: &Phase, band: usize) -> Vec<f32> {
    let turned = turned(phase, band);
    let mut out = vec![0.0f64; RADII * ANGLES];
    for (shell, row) in out.chunks_exact_mut(ANGLES).enumerate() {
        for bin in 0..BINS {
            let arrives: f64 = light.orders.iter().map(|order| order.measured(shell * BINS + bin).mean).sum();
            for (value, share) in row.iter_mut().zip(&turned[bin * ANGLES..]) {
                *value += arrives * share;
            }
        }
    }
    out.into_iter().map(|value| value as f32).collect()
}

/// The table that the runtime ships: little-endian single precision, [`VALUES`] of them.
///
/// Errors: as [`solve_light`].
pub fn bake_point_spread(settings: &SpreadSettings, progress: &dyn Progress) -> Result<Vec<u8>, BakeError> {
    let photons = settings.photons / BATCHES * BATCHES;
    progress.begin("photons", photons * PHASES as u64);
    let drops = Phase::Table(Arc::new(PhaseTable::drops()));
    let greys = ASYMMETRIES.map(|g| (Phase::HenyeyGreenstein(g), 0));
    let colours = [0, 1, 2].map(|band| (drops.clone(), band));
    let mut bytes = Vec::with_capacity(4 * VALUES);
    for (stream, (phase, band)) in greys.iter().chain(&colours).enumerate() {
        let light = solve_light(&SpreadPhase::new(phase, *band)?, settings, stream as u64, progress)?;
        bytes.extend(scattered(&light, phase, *band).into_iter().flat_map(f32::to_le_bytes));
    }
    Ok(bytes)
}
