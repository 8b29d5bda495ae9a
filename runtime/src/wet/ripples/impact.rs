//! Drops that strike: how wide and deep, how many.

use super::{IMPACTS_MAX, RippleSettings};
use crate::error::RuntimeError;

/// Gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// Rain of one size of drop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DropFlux {
    /// Diameter, m.
    pub diameter_m: f64,
    /// Speed at the surface, m/s.
    pub speed_m_per_s: f64,
    /// Drops that cross a square metre a second: number density times speed, summed over the sizes that this one stands for.
    pub impacts_per_m2_s: f64,
}

/// One drop's mark on the water.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// Place from the lattice's corner, m.
    pub at_m: [f32; 2],
    /// Radius of the ring that it begins with, m.
    pub radius_m: f32,
    /// Depth of its middle, m; the rim stands a quarter of that above the water at rest, so that none is made or lost.
    pub depth_m: f32,
}

impl DropFlux {
    /// Radius of the crater, m: a half ball of water lifted out takes π ρ g R⁴/4 of energy, the drop brings π ρ D³v²/12; so R = (D³v²/(3g))^¼.
    /// Drops of 2 mm make craters of 1 cm.
    pub fn crater_radius_m(&self) -> f64 {
        let cube = self.diameter_m * self.diameter_m * self.diameter_m;
        libm::sqrt(libm::sqrt(cube * self.speed_m_per_s * self.speed_m_per_s / (3.0 * GRAVITY)))
    }

    /// What one drop of this flux does at a place of a surface.
    pub fn impact(&self, at_m: [f32; 2], settings: &RippleSettings) -> Impact {
        let radius_m = self.crater_radius_m() as f32;
        Impact { at_m, radius_m, depth_m: settings.ring_share * radius_m.min(settings.depth_m) }
    }

    /// Checks the numbers; returns the impacts that they come to.
    pub(super) fn check(&self, area_m2: f64, seconds: f64) -> Result<f64, RuntimeError> {
        if !(0.0..=0.1).contains(&self.diameter_m) {
            return Err(RuntimeError::argument("diameter_m", "0 to 0.1 m", self.diameter_m));
        }
        if !(0.0..=1e3).contains(&self.speed_m_per_s) {
            return Err(RuntimeError::argument("speed_m_per_s", "0 to 1000 m/s", self.speed_m_per_s));
        }
        // Slots are drawn whole: one before the call's own time and one behind it may be.
        let drawn = area_m2 * (seconds + 2.0 * super::SLOT_S);
        let most = f64::from(IMPACTS_MAX) / drawn;
        if !(0.0..=most).contains(&self.impacts_per_m2_s) {
            let wanted = format!("0 to {most:.1}, which is {IMPACTS_MAX} impacts in this call");
            return Err(RuntimeError::argument("impacts_per_m2_s", wanted, self.impacts_per_m2_s));
        }
        Ok(self.impacts_per_m2_s * drawn)
    }
}
