//! The mean of splashes that are too far away to be drawn one by one.

use super::hits::Fall;
use super::{Brush, Kind, drawn, sequence};
use crate::wet::drop::eye::Spot;
use crate::wet::drop::light::DropLight;
use crate::wet::drop::milky;
use crate::wet::frame::{Layer, WetFrame};
use glam::Vec3;

impl Brush<'_, '_> {
    /// Optical thickness of splashes that are not drawn one by one, seen straight across, by pixels a metre: a table of octaves' eighths.
    fn thickness(&self, kinds: &[Kind], sine: f32) -> Vec<f32> {
        let spread = self.controls.size_spread;
        let mean = self.sequence.mean(sine) * (1.0 + spread * spread / 3.0);
        let of = |step: usize| {
            let per_metre = per_metre_of(step);
            let kind = |kind: &Kind| {
                let width = sequence::WIDTH * kind.radius;
                let alive = self.frame.flux[kind.class].impacts_per_m2_s * kind.life_s;
                alive as f32
                    * width
                    * width
                    * mean
                    * (1.0 - drawn(width * per_metre, self.controls.smallest_px))
            };
            kinds.iter().map(kind).sum::<f32>()
        };
        (0..STEPS).map(of).collect()
    }

    /// Lays the mean of far splashes over the surfaces that they stand on; returns pixels touched.
    pub(super) fn haze(
        &self,
        kinds: &[Kind],
        fall: &Fall<'_>,
        light: &mut DropLight<'_>,
        out: &mut Layer,
    ) -> u64 {
        /// Pixels of a row that share their light and shelter.
        const RUN: usize = 4;
        let (eye, buffer, controls) = (self.eye, self.frame.buffer, self.controls);
        let tables = [0.15, 0.6, 0.95].map(|sine| self.thickness(kinds, sine));
        let opacity = self.opacity();
        let own = opacity.of(controls.opacity, 0.066) * controls.haze;
        let speed = mean_speed(self.frame, kinds);
        let mut touched = 0;
        for y in 0..eye.size[1] {
            for begin in (0..eye.size[0]).step_by(RUN) {
                let mut run: Option<(f32, f32, Vec3)> = None;
                for x in begin..(begin + RUN).min(eye.size[0]) {
                    let pixel = y * eye.size[0] + x;
                    let depth = buffer.depth_m[pixel];
                    let normal = Vec3::from(buffer.normal[pixel]);
                    if !(depth > 0.0 && depth.is_finite() && normal.z >= 0.5) {
                        continue;
                    }
                    let per_metre = eye.pixels_per_metre(depth);
                    let offset = eye.at(x as f32 + 0.5, y as f32 + 0.5, depth);
                    let direction = eye.towards(offset);
                    let sine = (-direction.z).max(0.0);
                    let view = if sine < 0.35 { 0 } else { 1 + usize::from(sine > 0.8) };
                    let thickness = lookup(&tables[view], per_metre);
                    if thickness < 1e-5 {
                        continue;
                    }
                    let steep = -normal.dot(direction);
                    if steep <= 0.0 {
                        continue;
                    }
                    let (_, open, colour) = match run {
                        Some(known) if (known.0 - depth).abs() < 0.03 * depth => known,
                        _ => {
                            let place = eye.position + offset.as_dvec3();
                            let spot = Spot { x: x as f32, y: y as f32, depth };
                            let open = if fall.sheltered(place, speed) { 0.0 } else { 1.0 };
                            let beams = light.beams(place, direction) * controls.back_light;
                            let colour = (light.ball(&spot).mean() + beams) * opacity.lightning_bias;
                            *run.insert((depth, open, milky(colour, controls.milk)))
                        }
                    };
                    let wettable = buffer.wettable.as_ref().map_or(1.0, |mask| mask[pixel].clamp(0.0, 1.0));
                    let through = thickness * own * open * wettable * normal.z / steep.max(0.02);
                    if through > 0.0 {
                        let alpha = 1.0 - libm::expf(-through);
                        out.over(pixel, (colour * alpha).into(), alpha);
                        touched += 1;
                    }
                }
            }
        }
        touched
    }
}

/// Entries of the table over pixels a metre: eight an octave from 1/16 px on.
const STEPS: usize = 8 * 18;

fn per_metre_of(step: usize) -> f32 {
    libm::exp2f(step as f32 / 8.0 - 4.0)
}

fn lookup(table: &[f32], per_metre: f32) -> f32 {
    let at = ((libm::log2f(per_metre.max(1e-9)) + 4.0) * 8.0).clamp(0.0, (STEPS - 2) as f32);
    let low = at as usize;
    table[low] + (at - low as f32) * (table[low + 1] - table[low])
}

/// Speed of the drops that splash, the mean over their number, m/s.
fn mean_speed(frame: &WetFrame<'_>, kinds: &[Kind]) -> f64 {
    let sum = kinds.iter().map(|kind| &frame.flux[kind.class]).fold((0.0, 0.0), |sum, drop| {
        (sum.0 + drop.impacts_per_m2_s, sum.1 + drop.impacts_per_m2_s * drop.speed_m_per_s)
    });
    sum.1 / sum.0.max(1e-30)
}
