//! Light of a point in an endless medium that scatters all it takes, by Monte Carlo: the table behind
//! [`squall_runtime::point_spread`].
//!
//! Photons start at the light and are followed through spheres around it, in optical depths, until they leave the outermost. Their
//! first flight is drawn from half its own density and half one even in ln ρ, weighted, so that the neighbourhood of the light is
//! seen as well as the rest. Every later flight leaves, in each shell that it passes, weight times length at one random point of
//! its way there: by the angle to the way straight from the light and by how often it was scattered before (a track-length estimator). That is the
//! radiance L of the scattering orders 1 and above; order 1 has a closed form ([`squall_runtime::airlight`]), by which it is tested. What the
//! table holds is J = ∫ p L dω, light of two scatterings and more, the phase function averaged around the way from the light.
//! Light paths end outside, or by Russian roulette at scatterings 32, 64, 128 …
//!
//! Photons run in [`BATCHES`] batches, each photon with random numbers of its own: the bytes do not depend on the number of threads.
//!
//! | symbol | name | unit |
//! | ρ | optical depth from the light | – |
//! | α | angle between light's way and the way straight from its source | rad |
//! | L | radiance per I β² | 1/sr |

mod photon;
mod spread;

pub use photon::{SpreadPhase, solve_light};
pub use spread::{Light, bake_point_spread, scattered};

use std::ops::RangeInclusive;

/// How much chance.
#[derive(Clone, Copy, Debug)]
pub struct SpreadSettings {
    /// Photons for each phase function, within [`PHOTONS`].
    pub photons: u64,
    /// Every seed gives results of its own, the same seed always the same.
    pub seed: u64,
}

impl Default for SpreadSettings {
    fn default() -> Self {
        Self { photons: 1_000_000, seed: 1 }
    }
}

/// Photons that can be asked for.
pub const PHOTONS: RangeInclusive<u64> = 100..=1_000_000_000;
/// Independent batches behind every standard error.
pub const BATCHES: u64 = crate::monte_carlo::BATCHES;
/// Bins over the angle that light is gathered in.
pub const BINS: usize = 96;

#[cfg(test)]
mod tests;
