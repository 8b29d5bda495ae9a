//! How water in the air looks, shared by all that draws drops: the world through a ball of water and in it, lamps and lightning on it, the paper's
//! controls. \[toyshop\] §3.1 and §3.2.

mod ball;
#[cfg(feature = "gpu")]
pub(crate) mod card;
pub(crate) mod eye;
mod fall;
pub(crate) mod light;
mod look;
mod rain;
#[cfg(test)]
pub(crate) mod stage;
mod stamp;

pub use ball::{paper_through, through_ball};
pub use fall::{fall_time_s, fallen, last_speed};
pub(crate) use light::glint;
pub use look::{Opacity, distance_fade, lightning_bias, milky, paper_opacity};
pub use rain::{DropControls, DropReport, Drops};
pub(crate) use stamp::{Paint, Stamp, covered, velocity_blur};
pub use stamp::{flatness, swing_rate};

use crate::error::RuntimeError;
use crate::wet::frame::WetFrame;
use crate::wet::ripples::DropFlux;
use glam::DVec3;

/// Most drops of one class that come down on a square metre in a second; a cloudburst's drops of all sizes are a few 10⁴.
const FLUX_MOST: f64 = 2e5;
/// Classes of drops of one rain at most.
const CLASSES_MOST: usize = 256;
/// Strongest wind, m/s, and longest time from the beginning, s.
const WIND_MOST: f64 = 150.0;
const TIME_MOST: f64 = 1e9;

/// Refuses frames that no effect can draw on.
///
/// Errors: a camera or buffers that don't fit each other; wind, time or rain that is not a number or outside what rain does.
pub(crate) fn check(frame: &WetFrame<'_>) -> Result<(), RuntimeError> {
    frame.camera.check()?;
    frame.check()?;
    check_weather(&frame.weather(), frame.lightning)
}

/// What falls, and when.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Weather<'a> {
    pub flux: &'a [DropFlux],
    pub rate_mm_per_h: f64,
    pub wind: DVec3,
    pub time_s: f64,
    pub seed: u64,
}

/// Refuses wind, time, rain and lightning that are not numbers or outside what they do.
pub(crate) fn check_weather(frame: &Weather<'_>, lightning: [f32; 2]) -> Result<(), RuntimeError> {
    if !(0.0..=WIND_MOST).contains(&frame.wind.length()) {
        return Err(RuntimeError::argument("wind", format!("up to {WIND_MOST} m/s"), frame.wind));
    }
    if !(-TIME_MOST..=TIME_MOST).contains(&frame.time_s) {
        return Err(RuntimeError::argument("time_s", format!("-{TIME_MOST} to {TIME_MOST}"), frame.time_s));
    }
    if !(0.0..=1000.0).contains(&frame.rate_mm_per_h) {
        return Err(RuntimeError::argument("rate_mm_per_h", "0 to 1000", frame.rate_mm_per_h));
    }
    if frame.flux.len() > CLASSES_MOST {
        return Err(RuntimeError::argument(
            "flux",
            format!("at most {CLASSES_MOST} classes"),
            frame.flux.len(),
        ));
    }
    for drop in frame.flux {
        let ranges = [
            ("diameter_m", drop.diameter_m, 0.1),
            ("speed_m_per_s", drop.speed_m_per_s, 1e3),
            ("impacts_per_m2_s", drop.impacts_per_m2_s, FLUX_MOST),
        ];
        for (field, value, most) in ranges {
            if !(0.0..=most).contains(&value) {
                return Err(RuntimeError::argument(field, format!("0 to {most}"), value));
            }
        }
    }
    if lightning.iter().any(|value| !value.is_finite()) {
        let found = format!("{lightning:?}");
        return Err(RuntimeError::argument("lightning", "finite intensities", found));
    }
    Ok(())
}
