//! How many rays each point of a stroke sends.
//!
//! A stroke has a thousand points, most of them faint, and what a reader sees is their sum: a budget for all of them, shared by their
//! intensity, does what eight times as many rays do that are the same for each. Numbers are powers of two, so that few sets of
//! directions serve all points.

use crate::relight::PointLight;

/// Rays of direct light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectRays {
    /// So many from each point; the error falls with about the 0.7th power of their number.
    PerPoint(u32),
    /// So many from a whole stroke, bright points more than faint ones, and 4 at least from each: a stroke of n points sends up to 4 n more.
    PerStroke(u32),
}

/// Power of a point's intensity that its share of the rays goes with.
const POWER: f64 = 0.6;
/// Fewest and most rays of a point that takes its share of a budget.
const FEWEST: u32 = 4;
const MOST: u32 = 1 << 16;

impl DirectRays {
    /// A still picture's.
    pub const STILL: Self = Self::PerStroke(1 << 16);
    /// A preview's.
    pub const PREVIEW: Self = Self::PerStroke(1 << 14);

    /// Rays for what transport sweeps scatter on, an eighth of a picture's: what single rays miss is not seen behind a scattering and a sweep.
    #[cfg(feature = "live")]
    pub(crate) fn for_gathers(self) -> Self {
        /// A picture's rays over a gather's.
        const SHARE: u32 = 8;
        match self {
            Self::PerPoint(rays) => Self::PerPoint((rays / SHARE).max(1)),
            Self::PerStroke(rays) => Self::PerStroke((rays / SHARE).max(1)),
        }
    }

    /// Rays of each of `lights`, at least 1. Pictures of every kind send the same rays: the number of a light, the number of its rays
    /// and a seed say where they go.
    pub(crate) fn of(self, lights: &[PointLight]) -> Vec<u32> {
        let budget = match self {
            Self::PerPoint(rays) => return vec![rays.max(1); lights.len()],
            Self::PerStroke(rays) => f64::from(rays.max(1)),
        };
        let weights: Vec<f64> = lights.iter().map(|light| libm::pow(light.intensity.abs(), POWER)).collect();
        let whole: f64 = weights.iter().sum();
        let rays = |weight: &f64| {
            let share = budget * weight / whole;
            // Nothing shines: 0/0, which no comparison holds for.
            let power = if share > 1.0 { libm::rint(libm::log2(share)) } else { 0.0 };
            (1u32 << power.min(31.0) as u32).clamp(FEWEST, MOST)
        };
        weights.iter().map(rays).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn lights(intensities: &[f64]) -> Vec<PointLight> {
        intensities.iter().map(|&intensity| PointLight { position: DVec3::ZERO, intensity }).collect()
    }

    #[test]
    fn a_budget_is_shared_in_powers_of_two_that_grow_with_intensity() {
        let own: Vec<f64> = (1..=1000).map(|i| libm::pow(f64::from(i), 1.7)).collect();
        let rays = DirectRays::PerStroke(1 << 17).of(&lights(&own));
        assert!(rays.iter().all(|rays| rays.is_power_of_two()) && rays.is_sorted());
        // Rounding to powers of two moves the sum by a few per cent, and the fewest of each add some.
        let sum: u32 = rays.iter().sum();
        assert!((100_000..160_000).contains(&sum), "{sum}");
        assert!(rays[999] >= 16 * rays[9]);
        assert_eq!(DirectRays::PerPoint(7).of(&lights(&own[..2])), [7, 7]);
    }

    #[test]
    fn dark_and_taking_lights_have_rays_too() {
        assert_eq!(DirectRays::PerStroke(4096).of(&lights(&[0.0, 0.0])), [FEWEST; 2]);
        assert_eq!(DirectRays::PerStroke(4096).of(&lights(&[5.0, -5.0])), [2048; 2]);
        assert_eq!(DirectRays::PerStroke(u32::MAX).of(&lights(&[1.0])), [MOST]);
        assert!(DirectRays::PerStroke(1).of(&[]).is_empty());
        assert_eq!(DirectRays::PerPoint(0).of(&lights(&[1.0])), [1]);
    }
}
