//! Neon that flickers, \[toyshop\] §6.3: what a sign sends of its own goes down for moments, and what mirrors it, and glows around it, goes down with it.
//!
//! A sign is what shines in a strong colour, told apart by where it stands in the world and by its colour; its moments are hashed by sign and slot of time, so that the
//! same time shows the same light. What a sign throws on walls is in the buffers' colour with all other light, and stays.

use crate::error::RuntimeError;
use crate::parallel::prelude::*;
use crate::random::{hash, mix};
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::reflect::view::View;

controls! {
    /// How neon flickers.
    pub struct FlickerControls {
        /// Share of a sign's light that its moments take.
        depth: 0.6, 0.0..=1.0, "", "";
        /// Moments that may be dark, a second.
        rate: 12.0, 0.1..=120.0, "1/s", "";
        /// Share of them that are.
        often: 0.25, 0.0..=1.0, "", "";
        /// Share of signs that flicker at all.
        signs: 0.5, 0.0..=1.0, "", "";
        /// Strength of colour from which light counts as neon: 0 is white, 1 one colour alone.
        colour: 0.45, 0.0..=1.0, "", "";
        /// Brightness from which light counts, over the world's mean.
        brightness: 8.0, 0.0..=1e6, "", "";
        /// Size of a sign.
        size: 3.0, 0.1..=100.0, "m", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FlickerReport {
    /// Pixels of neon that are darker now.
    pub pixels: usize,
}

/// Draws what neon lacks now as a layer that hides it. Needs emission; without it nothing flickers.
///
/// # Errors
///
/// Buffers of another size than the camera's, a time that is no number, controls out of their ranges.
pub fn draw(
    frame: &WetFrame<'_>,
    controls: &FlickerControls,
    out: &mut Layer,
) -> Result<FlickerReport, RuntimeError> {
    frame.check()?;
    controls.check()?;
    if !frame.time_s.is_finite() {
        return Err(RuntimeError::argument("time_s", "a finite number", frame.time_s));
    }
    out.clear(frame.buffer.size);
    let Some(emission) = &frame.buffer.emission else { return Ok(FlickerReport::default()) };
    let (view, width) = (View::new(frame.camera), frame.buffer.size[0]);
    let mean: f32 = frame.light.mean_radiance().iter().sum();
    let least = (mean / 3.0 * controls.brightness).max(f32::MIN_POSITIVE);
    let row = |(y, alpha): (usize, &mut [f32])| {
        let mut dark = 0;
        for (x, alpha) in alpha.iter_mut().enumerate() {
            let at = y * width + x;
            let (own, all, depth) = (emission[at], frame.colour[at], frame.buffer.depth_m[at]);
            let (most, low) = (own[0].max(own[1]).max(own[2]), own[0].min(own[1]).min(own[2]));
            let shines = most >= least && most - low >= controls.colour * most && most.is_finite();
            if !(shines && depth > 0.0 && depth.is_finite()) {
                continue;
            }
            let place = view.eye + view.to_world(view.place(x, y, depth)).as_dvec3();
            let cell = |axis: usize| libm::floor(place[axis] / f64::from(controls.size)) as i64 as u64;
            let band = own.iter().position(|value| *value == most).unwrap_or(0) as u64;
            let sign = hash(&[frame.seed, 0x4E45_4F4E, cell(0), cell(1), cell(2), band]);
            let gone = controls.depth * gone(sign, frame.time_s, controls);
            // Air between may have taken a little of it: no more than there is.
            let share = (most / all[0].max(all[1]).max(all[2]).max(f32::MIN_POSITIVE)).min(1.0);
            *alpha = gone * share;
            dark += usize::from(*alpha > 0.0);
        }
        dark
    };
    let pixels = out.alpha.par_chunks_mut(width).enumerate().map(row).sum();
    Ok(FlickerReport { pixels })
}

/// Share of a sign's dip that it is in at a time, 0 to 1.
fn gone(sign: u64, time_s: f64, controls: &FlickerControls) -> f32 {
    let unit = |bits: u64| (mix(bits) >> 40) as f32 / (1u64 << 24) as f32;
    if unit(sign) >= controls.signs {
        return 0.0;
    }
    let slots = time_s * f64::from(controls.rate) + f64::from(unit(sign ^ 1));
    let slot = libm::floor(slots);
    let moment = mix(sign ^ (slot as i64 as u64).rotate_left(17));
    if unit(moment) >= controls.often {
        return 0.0;
    }
    // Down at once, and up again by degrees.
    let since = (slots - slot) as f32;
    (1.0 - since) * (0.4 + 0.6 * unit(moment ^ 2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wet::drop::stage::Stage;
    use glam::DVec3;

    fn stage() -> Stage {
        let mut stage = Stage::new(DVec3::new(3.0, 0.0, 1.6), DVec3::new(3.0, 5.0, 0.5), [64, 48]);
        let mut emission = vec![[0.0; 3]; 64 * 48];
        for y in 40..48 {
            for x in 0..64 {
                (emission[y * 64 + x], stage.buffer.colour[y * 64 + x]) = ([9.0, 0.2, 3.0], [9.1, 0.3, 3.1]);
            }
        }
        emission[39 * 64] = [9.0; 3];
        stage.buffer.emission = Some(emission);
        stage
    }

    fn at(stage: &Stage, time: f64, controls: &FlickerControls) -> (Layer, usize) {
        let mut layer = Layer::default();
        let report = draw(&stage.frame(time), controls, &mut layer).unwrap();
        (layer, report.pixels)
    }

    #[test]
    fn neon_goes_down_for_moments_and_white_lamps_do_not() {
        let stage = stage();
        let controls = FlickerControls { signs: 1.0, ..FlickerControls::default() };
        let dark = |time: f64| at(&stage, time, &controls).1;
        let moments: Vec<usize> = (0..200).map(|k| dark(f64::from(k) / 48.0)).collect();
        let often = moments.iter().filter(|count| **count > 0).count();
        assert!(often > 20 && moments.contains(&0), "{often}");
        let all = FlickerControls { often: 1.0, ..controls };
        let (layer, count) = at(&stage, 0.6, &all);
        assert!(count == 64 * 8 && layer.alpha[39 * 64] == 0.0, "{count}");
        assert!(layer.alpha.iter().all(|alpha| (0.0..=all.depth).contains(alpha)));
    }

    #[test]
    fn the_same_time_has_the_same_light_and_nothing_flickers_without_emission() {
        let mut stage = stage();
        let controls = FlickerControls { signs: 1.0, often: 1.0, ..FlickerControls::default() };
        assert_eq!(at(&stage, 3.1, &controls).0, at(&stage, 3.1, &controls).0);
        assert_ne!(at(&stage, 3.1, &controls).0, at(&stage, 3.2, &controls).0);
        assert_eq!(at(&stage, 3.1, &FlickerControls { signs: 0.0, ..controls }).1, 0);
        stage.buffer.emission = None;
        assert_eq!(at(&stage, 3.1, &controls).1, 0);
        let wrong = FlickerControls { rate: 0.0, ..controls };
        assert!(draw(&stage.frame(0.0), &wrong, &mut Layer::default()).is_err());
    }
}
