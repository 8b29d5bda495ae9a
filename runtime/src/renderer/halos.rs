//! Halos in the rain of a frame: what street lamps and channels in sight shed on the rain before them, scattered once
//! ([`crate::airlight`]) and more often ([`crate::point_spread`]).
//!
//! Both tables are of an even medium. To a lamp, the rain on the way counts as even, as thick as it is in the mean; on the ray, rain
//! that thins out counts as rain that ends sooner. A stroke that stands beyond the rain's bounds lights it as a distant light instead
//! ([`super::rain`]). Walls between a light and the rain are not looked for.
//!
//! A halo is smooth but where its light stands and where the scene's depth jumps: it is worked out at the corners of tiles of 8 × 8
//! pixels where depth and middle of the tile agree with that, and pixel by pixel elsewhere.

#[cfg(feature = "gpu")]
mod upload;

use super::lit_stroke::LitStroke;
use crate::airlight::{Airlight, PointBeside};
use crate::camera::{Camera, Ray};
use crate::medium::{Medium, Phase};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::point_spread::PointSpread;
use crate::rain::RainPath;
use glam::DVec3;
use squall_formats::section::town::StreetLamp;

/// A light that adds less than this share of a pixel leaves no halo there.
const LEAST: f32 = 1e-4;
/// Radius of a lamp's glass, m.
const LAMP_RADIUS_M: f64 = 0.15;
/// Points that a stroke stands for where its light is scattered more than once.
const STROKE_POINTS: usize = 24;
/// Edge of a tile, px.
const TILE: usize = 8;
/// Share by which a tile's middle may differ from the mean of its corners, or from itself at another depth of the tile.
const EVEN: f32 = 0.02;

/// How a medium of one phase function spreads light of points; kept from frame to frame.
pub struct Spreading {
    once: Airlight,
    more: PointSpread,
}

impl Spreading {
    /// What was kept, if it is of this phase function; else worked out.
    pub fn of(kept: Option<Self>, phase: &Phase) -> Self {
        match kept {
            Some(known) if known.once.phase() == phase => known,
            _ => Self { once: Airlight::new(phase), more: PointSpread::new(phase) },
        }
    }
}

/// A light with a halo.
struct Halo {
    shape: Shape,
    intensity: [f32; 3],
    /// Extinction of the rain before it, 1/m.
    extinction: f64,
    /// Radiance above which no ray sees of it, times its distance from the ray for light that is scattered once.
    most: [f64; 2],
}

/// What of a light scatters.
enum Shape {
    /// A lamp, all orders.
    Lamp(DVec3),
    /// A piece of a stroke between two ends, scattered once.
    Line([DVec3; 2]),
    /// A part of a stroke and its radius, scattered more than once.
    Ball(DVec3, f64),
}

/// The lights of a frame that have halos.
pub struct Halos<'a> {
    tables: &'a Spreading,
    extinction: f64,
    field: &'a dyn RainPath,
    lights: Vec<Halo>,
}

impl<'a> Halos<'a> {
    /// None yet.
    pub fn new(tables: &'a Spreading, medium: &Medium, field: &'a dyn RainPath) -> Self {
        Self { tables, extinction: medium.extinction().0, field, lights: Vec::new() }
    }

    fn add(&mut self, shape: Shape, intensity: [f32; 3], extinction: f64, distance: f64) {
        let total = f64::from(intensity.iter().sum::<f32>());
        let once = self.tables.once.most() * extinction * total;
        let more = self.tables.more.most_at(extinction, distance) * total;
        let most = match shape {
            Shape::Lamp(_) => [once, more],
            Shape::Line(_) => [once, 0.0],
            Shape::Ball(..) => [0.0, more],
        };
        if extinction > 0.0 && total > 0.0 {
            self.lights.push(Halo { shape, intensity, extinction, most });
        }
    }

    /// Adds lamps, as far as it rains between them and the eye.
    pub fn add_lamps(&mut self, lamps: &[StreetLamp], eye: DVec3) {
        for lamp in lamps {
            let place = DVec3::from_array(lamp.position.map(f64::from));
            let distance = eye.distance(place);
            let ray = Ray { origin: eye, direction: (place - eye).normalize_or(DVec3::Z) };
            let share = match self.field.is_everywhere() || distance == 0.0 {
                true => 1.0,
                false => self.field.path(&ray, 0.0, distance) / distance,
            };
            self.add(Shape::Lamp(place), lamp.intensity, self.extinction * share, distance);
        }
    }

    /// Adds a stroke that stands within the same rain.
    pub fn add_stroke(&mut self, stroke: &LitStroke, eye: DVec3) {
        let seen: Vec<([DVec3; 2], [f32; 3])> = stroke
            .lights
            .images
            .iter()
            .map(|line| {
                let light = |band: usize| stroke.scale[band] * line.intensity[band] * line.visibility;
                ([line.from.as_dvec3(), line.to.as_dvec3()], std::array::from_fn(light))
            })
            .collect();
        for &(ends, intensity) in &seen {
            self.add(Shape::Line(ends), intensity, self.extinction, eye.distance(ends[0]));
        }
        for part in seen.chunks(seen.len().div_ceil(STROKE_POINTS).max(1)) {
            let (mut middle, mut total, mut intensity) = (DVec3::ZERO, 0.0, [0.0f32; 3]);
            for (ends, own) in part {
                let weight = f64::from(own.iter().sum::<f32>());
                middle += 0.5 * (ends[0] + ends[1]) * weight;
                total += weight;
                (0..3).for_each(|band| intensity[band] += own[band]);
            }
            if total > 0.0 {
                let middle = middle / total;
                let ends = part.iter().flat_map(|(ends, _)| ends);
                let radius = 0.5 * ends.map(|end| end.distance(middle)).fold(0.0, f64::max);
                self.add(Shape::Ball(middle, radius), intensity, self.extinction, eye.distance(middle));
            }
        }
    }

    /// Adds the halos to a picture whose things stand `metres` away.
    pub fn draw(&self, camera: &Camera, metres: &[f32], picture: &mut Picture) {
        if self.lights.is_empty() {
            return;
        }
        let width = picture.width;
        let secants = camera.secants();
        let rows = picture.pixels.par_chunks_mut(width * TILE).zip(metres.par_chunks(width * TILE));
        rows.enumerate().for_each(|(tile_row, (pixels, metres))| {
            let ray = |x: f64, y: f64| camera.ray_with(&secants, x, (tile_row * TILE) as f64 + y);
            let mut strip = Strip { halos: self, ray: &ray, width, pixels, metres };
            (0..width).step_by(TILE).for_each(|left| strip.tile(left));
        });
    }

    /// Radiance that all lights add on a ray that ends `end` m away, before a pixel of so much light.
    pub(crate) fn radiance(&self, ray: &Ray, end: f64, pixel: [f32; 3]) -> [f32; 3] {
        let least = f64::from(LEAST * (pixel[0] + pixel[1] + pixel[2]));
        let end = if self.field.is_everywhere() { end } else { self.field.path(ray, 0.0, end) };
        let Spreading { once, more } = self.tables;
        let mut sum = [0.0f32; 3];
        for Halo { shape, intensity, extinction, most } in &self.lights {
            let (middle, radius) = match shape {
                Shape::Lamp(place) => (*place, LAMP_RADIUS_M),
                Shape::Line(ends) => (0.5 * (ends[0] + ends[1]), 0.5 * ends[0].distance(ends[1])),
                Shape::Ball(place, radius) => (*place, *radius),
            };
            let beside = PointBeside::new(middle, ray.origin, ray.direction, end, radius);
            let bounds = [most[0] / beside.h, most[1]];
            if bounds[0] + bounds[1] < least {
                continue;
            }
            let mut add = |share: [f64; 3]| {
                (0..3).for_each(|band| sum[band] += intensity[band] * share[band] as f32);
            };
            if bounds[0] >= 0.5 * least {
                match shape {
                    Shape::Lamp(_) => add(once.of_point(*extinction, &beside)),
                    Shape::Line(ends) => {
                        add(once.of_line(*extinction, *ends, ray.origin, ray.direction, end));
                    }
                    Shape::Ball(..) => {}
                }
            }
            if bounds[1] >= 0.5 * least {
                add(more.of_point(*extinction, &beside));
            }
        }
        sum
    }
}

/// A row of tiles.
struct Strip<'a> {
    halos: &'a Halos<'a>,
    /// The ray through a place of the picture, y from the strip's top.
    ray: &'a (dyn Fn(f64, f64) -> Ray + Sync),
    width: usize,
    pixels: &'a mut [[f32; 3]],
    metres: &'a [f32],
}

impl Strip<'_> {
    fn tile(&mut self, left: usize) {
        let right = (left + TILE).min(self.width);
        let height = self.pixels.len() / self.width;
        let (mut near, mut far, mut darkest) = (f32::INFINITY, 0.0f32, [f32::INFINITY; 3]);
        for y in 0..height {
            for at in y * self.width + left..y * self.width + right {
                (near, far) = (near.min(self.metres[at]), far.max(self.metres[at]));
                (0..3).for_each(|band| darkest[band] = darkest[band].min(self.pixels[at][band]));
            }
        }
        let at = |x: f64, y: f64, end: f32| self.halos.radiance(&(self.ray)(x, y), f64::from(end), darkest);
        let (x, y) = ([left as f64, right as f64], [0.0, height as f64]);
        let middle = |end: f32| at(0.5 * (x[0] + x[1]), 0.5 * y[1], end);
        let (first, last) = (middle(near), middle(far));
        let even =
            |a: &[f32; 3], b: &[f32; 3]| (0..3).all(|band| (a[band] - b[band]).abs() <= EVEN * a[band].abs());
        let corners = even(&last, &first)
            .then(|| [at(x[0], y[0], far), at(x[1], y[0], far), at(x[0], y[1], far), at(x[1], y[1], far)]);
        let mean = |corners: &[[f32; 3]; 4]| {
            std::array::from_fn(|band| 0.25 * corners.iter().map(|corner| corner[band]).sum::<f32>())
        };
        match corners.filter(|corners| even(&last, &mean(corners))) {
            Some(corners) => self.mix((left, right), height, &corners),
            None => self.each((left, right), height),
        }
    }

    /// Adds what lies between a tile's corners.
    fn mix(&mut self, (left, right): (usize, usize), height: usize, [a, b, c, d]: &[[f32; 3]; 4]) {
        for y in 0..height {
            let v = (y as f32 + 0.5) / height as f32;
            for x in left..right {
                let u = ((x - left) as f32 + 0.5) / (right - left) as f32;
                let pixel = &mut self.pixels[y * self.width + x];
                for band in 0..3 {
                    let (top, bottom) =
                        (a[band] + u * (b[band] - a[band]), c[band] + u * (d[band] - c[band]));
                    pixel[band] += top + v * (bottom - top);
                }
            }
        }
    }

    /// Adds the halo of every pixel of a tile.
    fn each(&mut self, (left, right): (usize, usize), height: usize) {
        for y in 0..height {
            for x in left..right {
                let at = y * self.width + x;
                let ray = (self.ray)(x as f64 + 0.5, y as f64 + 0.5);
                let halo = self.halos.radiance(&ray, f64::from(self.metres[at]), self.pixels[at]);
                (0..3).for_each(|band| self.pixels[at][band] += halo[band]);
            }
        }
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

#[cfg(test)]
mod tests;
