//! Halos in the rain of a frame: what street lamps and channels in sight shed on the rain before them, scattered once
//! ([`crate::airlight`]) and more often ([`crate::point_spread`]).
//!
//! Both tables are of an even medium. To a lamp, the rain on the way counts as even, as thick as it is in the mean; on the ray, rain
//! that thins out counts as rain that ends sooner. A stroke that stands beyond the rain's bounds lights it as a distant light instead
//! ([`super::rain`]). A lamp lights the rain that its town's walls let it reach ([`Halos::with_walls`]);
//! walls before a channel's rain are not looked for.
//!
//! A halo is smooth but where its light stands: it is worked out at the corners of tiles of 8 × 8 pixels, for as many depths as the
//! tile's things need, and lies between them where the tile's middle agrees with that; elsewhere it is worked out pixel by pixel.

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
use crate::shade::town::Town;
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
/// Share by which a tile's middle may differ from what lies between its corners.
const EVEN: f32 = 0.02;
/// Logarithm of the ratio of depths between which light counts as growing evenly, and most nodes of a tile.
const DEPTH_STEP: f32 = 0.4;
const MOST_DEPTHS: usize = 10;
/// Optical depth behind which nothing comes to the eye: e^−30 is 10^−13.
const DEEPEST: f32 = 30.0;

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
    /// A lamp, all orders, and its number.
    Lamp(DVec3, usize),
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
    walls: Option<&'a Town>,
    lights: Vec<Halo>,
}

impl<'a> Halos<'a> {
    /// None yet.
    pub fn new(tables: &'a Spreading, medium: &Medium, field: &'a dyn RainPath) -> Self {
        Self { tables, extinction: medium.extinction().0, field, walls: None, lights: Vec::new() }
    }

    /// The same where a town's walls and hills stand between its own lamps, in its own order, and the rain that they light.
    #[must_use]
    pub fn with_walls(self, walls: Option<&'a Town>) -> Self {
        Self { walls, ..self }
    }

    fn add(&mut self, shape: Shape, intensity: [f32; 3], extinction: f64, distance: f64) {
        let total = f64::from(intensity.iter().sum::<f32>());
        let once = self.tables.once.most() * extinction * total;
        let more = self.tables.more.most_at(extinction, distance) * total;
        let most = match shape {
            Shape::Lamp(..) => [once, more],
            Shape::Line(_) => [once, 0.0],
            Shape::Ball(..) => [0.0, more],
        };
        if extinction > 0.0 && total > 0.0 {
            self.lights.push(Halo { shape, intensity, extinction, most });
        }
    }

    /// Adds lamps, as far as it rains between them and the eye.
    pub fn add_lamps(&mut self, lamps: &[StreetLamp], eye: DVec3) {
        for (number, lamp) in lamps.iter().enumerate() {
            let place = DVec3::from_array(lamp.position.map(f64::from));
            let distance = eye.distance(place);
            let ray = Ray { origin: eye, direction: (place - eye).normalize_or(DVec3::Z) };
            let share = match self.field.is_everywhere() || distance == 0.0 {
                true => 1.0,
                false => self.field.path(&ray, 0.0, distance) / distance,
            };
            self.add(Shape::Lamp(place, number), lamp.intensity, self.extinction * share, distance);
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
                Shape::Lamp(place, _) => (*place, LAMP_RADIUS_M),
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
            // Light that is scattered more than once goes the same ways to begin with, and loses the same share.
            let mut open = 1.0;
            if bounds[0] >= 0.5 * least || (bounds[1] >= 0.5 * least && self.walls.is_some()) {
                match shape {
                    Shape::Lamp(_, number) => {
                        let whole = once.of_point(*extinction, &beside);
                        let seen = match self.walls {
                            Some(town) => {
                                let reaches = |along: f64| {
                                    let place = ray.origin + ray.direction * along;
                                    f64::from(town.lamp_reaches(*number, place.as_vec3()))
                                };
                                once.of_point_past(*extinction, &beside, whole, &reaches)
                            }
                            None => whole,
                        };
                        let [total, left] = [whole, seen].map(|light| light[0] + light[1] + light[2]);
                        open = if total > 0.0 { left / total } else { 1.0 };
                        add(seen);
                    }
                    Shape::Line(ends) => {
                        add(once.of_line(*extinction, *ends, ray.origin, ray.direction, end));
                    }
                    Shape::Ball(..) => {}
                }
            }
            if bounds[1] >= 0.5 * least {
                add(more.of_point(*extinction, &beside).map(|share| share * open));
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
                let metres = self.ends(self.metres[at]);
                (near, far) = (near.min(metres), far.max(metres));
                (0..3).for_each(|band| darkest[band] = darkest[band].min(self.pixels[at][band]));
            }
        }
        let Some(depths) = Depths::between(near, far) else { return self.each((left, right), height) };
        let at = |x: f64, y: f64, end: f32| self.halos.radiance(&(self.ray)(x, y), f64::from(end), darkest);
        let (x, y) = ([left as f64, right as f64], [0.0, height as f64]);
        let corners =
            |end: f32| [at(x[0], y[0], end), at(x[1], y[0], end), at(x[0], y[1], end), at(x[1], y[1], end)];
        let nodes: Vec<[[f32; 3]; 4]> = (0..depths.count).map(|i| corners(depths.node(i))).collect();
        // The middle of the tile, at the depth midway between two nodes, is where a mixture is farthest off.
        let end = depths.node_at(0.5 * (depths.count - 1) as f32);
        let (found, wanted) = (depths.mix(&nodes, end, [0.5; 2]), at(0.5 * (x[0] + x[1]), 0.5 * y[1], end));
        let is_even = (0..3).all(|band| (found[band] - wanted[band]).abs() <= EVEN * wanted[band].abs());
        if !is_even {
            return self.each((left, right), height);
        }
        for y in 0..height {
            for x in left..right {
                let place = y * self.width + x;
                let share = [(x - left) as f32 + 0.5, y as f32 + 0.5];
                let share = [share[0] / (right - left) as f32, share[1] / height as f32];
                let halo = depths.mix(&nodes, self.ends(self.metres[place]), share);
                (0..3).for_each(|band| self.pixels[place][band] += halo[band]);
            }
        }
    }

    /// Where a ray ends as far as halos tell: behind this optical depth nothing comes to the eye.
    fn ends(&self, metres: f32) -> f32 {
        metres.min(DEEPEST / self.halos.extinction as f32)
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

/// Depths of a tile's things, and nodes between them at equal ratios.
struct Depths {
    near: f32,
    /// Logarithm of the ratio of one node to the one before.
    step: f32,
    count: usize,
}

impl Depths {
    /// Nodes from `near` to `far`; none where they would be so many that each pixel by itself is cheaper.
    fn between(near: f32, far: f32) -> Option<Self> {
        // What stands at the lens has no ratio to anything.
        let near = near.max(f32::MIN_POSITIVE);
        let span = libm::logf(far.max(near) / near);
        let count = 1 + libm::ceilf(span / DEPTH_STEP) as usize;
        let step = if count > 1 { span / (count - 1) as f32 } else { 0.0 };
        (count <= MOST_DEPTHS).then_some(Self { near, step, count })
    }

    fn node(&self, i: usize) -> f32 {
        self.node_at(i as f32)
    }

    fn node_at(&self, place: f32) -> f32 {
        self.near * libm::expf(self.step * place)
    }

    /// Light at a depth and a share of the tile's width and height, of what its corners have at each node.
    fn mix(&self, nodes: &[[[f32; 3]; 4]], metres: f32, [u, v]: [f32; 2]) -> [f32; 3] {
        let corners = |nodes: &[[f32; 3]; 4], band: usize| {
            let [a, b, c, d] = nodes.map(|corner| corner[band]);
            let (top, bottom) = (a + u * (b - a), c + u * (d - c));
            top + v * (bottom - top)
        };
        if self.count == 1 {
            return std::array::from_fn(|band| corners(&nodes[0], band));
        }
        let i = ((libm::logf((metres / self.near).max(1.0)) / self.step) as usize).min(self.count - 2);
        // Light grows with the ray's length and not with its logarithm.
        let [from, to] = [self.node(i), self.node(i + 1)];
        let share = ((metres - from) / (to - from)).clamp(0.0, 1.0);
        std::array::from_fn(|band| {
            let near = corners(&nodes[i], band);
            near + share * (corners(&nodes[i + 1], band) - near)
        })
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
