//! Halos in the rain of a frame: what street lamps and channels in sight shed on the rain before them.
//!
//! Only where rain is the same from the eye to the light does the airlight's table hold; a stroke that stands beyond the rain's
//! bounds lights it as a distant light instead ([`super::rain`]). Walls between a light and the rain are not looked for.

use super::lit_stroke::LitStroke;
use crate::airlight::{Airlight, PointBeside};
use crate::camera::{Camera, Ray};
use crate::medium::Medium;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use glam::DVec3;
use squall_formats::section::town::StreetLamp;

/// A light that adds less than this share of a pixel leaves no halo there.
const LEAST: f32 = 1e-4;
/// Radius of a lamp's glass, m.
const LAMP_RADIUS_M: f64 = 0.15;

/// A light with a halo: a point, or a line between two ends.
struct Glowing {
    ends: [DVec3; 2],
    intensity: [f32; 3],
}

/// The lights of a frame that have halos.
pub struct Halos<'a> {
    airlight: &'a Airlight,
    extinction: f64,
    lights: Vec<Glowing>,
}

impl<'a> Halos<'a> {
    /// None yet.
    pub fn new(airlight: &'a Airlight, medium: &Medium) -> Self {
        Self { airlight, extinction: medium.extinction().0, lights: Vec::new() }
    }

    /// Adds the lamps within `full` m of the eye, the distance to which rain is the same.
    pub fn add_lamps(&mut self, lamps: &[StreetLamp], eye: DVec3, full: f64) {
        for lamp in lamps {
            let place = DVec3::from_array(lamp.position.map(f64::from));
            if eye.distance(place) <= full {
                self.lights.push(Glowing { ends: [place; 2], intensity: lamp.intensity });
            }
        }
    }

    /// Adds a stroke that stands within the same rain.
    pub fn add_stroke(&mut self, stroke: &LitStroke) {
        for line in stroke.lights.images.iter() {
            let intensity =
                std::array::from_fn(|band| stroke.scale[band] * line.intensity[band] * line.visibility);
            self.lights.push(Glowing { ends: [line.from.as_dvec3(), line.to.as_dvec3()], intensity });
        }
    }

    /// Adds the halos to a picture whose things stand `metres` away.
    pub fn draw(&self, camera: &Camera, metres: &[f32], picture: &mut Picture) {
        if self.lights.is_empty() || self.extinction == 0.0 {
            return;
        }
        let width = picture.width;
        let secants = camera.secants();
        let row = |(y, (pixels, metres)): (usize, (&mut [[f32; 3]], &[f32]))| {
            for (x, (pixel, metres)) in pixels.iter_mut().zip(metres).enumerate() {
                let ray = camera.ray_with(&secants, x as f64 + 0.5, y as f64 + 0.5);
                let halo = self.radiance(&ray, f64::from(*metres), *pixel);
                (0..3).for_each(|band| pixel[band] += halo[band]);
            }
        };
        picture.pixels.par_chunks_mut(width).zip(metres.par_chunks(width)).enumerate().for_each(row);
    }

    fn radiance(&self, ray: &Ray, end: f64, pixel: [f32; 3]) -> [f32; 3] {
        let least = LEAST * (pixel[0] + pixel[1] + pixel[2]);
        // No ray sees more of a point than all that is scattered into it without loss.
        let most = self.airlight.most() * self.extinction;
        let mut sum = [0.0f32; 3];
        for Glowing { ends, intensity } in &self.lights {
            let point = ends[0] == ends[1];
            let middle = 0.5 * (ends[0] + ends[1]);
            let radius = if point { LAMP_RADIUS_M } else { 0.5 * ends[0].distance(ends[1]) };
            let beside = PointBeside::new(middle, ray.origin, ray.direction, end, radius);
            let total = intensity[0] + intensity[1] + intensity[2];
            if (most / beside.h) as f32 * total < least {
                continue;
            }
            let share = match point {
                true => self.airlight.of_point(self.extinction, &beside),
                false => self.airlight.of_line(self.extinction, *ends, ray.origin, ray.direction, end),
            };
            (0..3).for_each(|band| sum[band] += intensity[band] * share[band] as f32);
        }
        sum
    }
}

/// Whether all of a stroke that the eye may see stands within `full` m of it.
pub fn stands_within(stroke: &LitStroke, eye: DVec3, full: f64) -> bool {
    let lines = &stroke.lights.images;
    !lines.is_empty()
        && lines
            .iter()
            .all(|line| [line.from, line.to].iter().all(|end| eye.distance(end.as_dvec3()) <= full))
}
