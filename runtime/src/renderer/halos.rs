//! Halos in the rain of a frame: what street lamps and channels in sight shed on the rain before them, scattered once
//! ([`crate::airlight`]) and more often ([`crate::point_spread`]).
//!
//! Both tables are of an even medium. To a lamp, the rain on the way counts as even, as thick as it is in the mean; on the ray, rain
//! that thins out counts as rain that ends sooner. A stroke that stands beyond the rain's bounds lights it as a distant light instead
//! ([`super::rain`]). A lamp lights the rain that its town's walls let it reach ([`Halos::with_walls`]);
//! walls before a channel's rain are not looked for.
//!
//! A halo is smooth but where its light stands: it is worked out at the corners of tiles ([`tiles`]), for as many depths as the
//! tile's things need, and lies between them where the tile's middle agrees with that; elsewhere it is worked out pixel by pixel.

pub(crate) mod kept;
mod tiles;
#[cfg(feature = "gpu")]
mod upload;

use super::lit_stroke::LitStroke;
use crate::airlight::{Airlight, LitPieces, PointBeside};
use crate::camera::{Camera, Ray};
use crate::frame::FrameQuality;
use crate::medium::{Medium, Phase};
use crate::picture::Picture;
use crate::point_spread::PointSpread;
use crate::rain::RainPath;
use crate::shade::adaptive::Spacing;
use crate::shade::town::Town;
use glam::DVec3;
use squall_formats::section::town::StreetLamp;

/// Radius of a lamp's glass, m.
const LAMP_RADIUS_M: f64 = 0.15;
/// Optical depth behind which nothing comes to the eye: e^−30 is 10^−13.
const DEEPEST: f32 = 30.0;
/// Cosines that a phase function's peak is looked for at, the ends among them.
const COSINES: u32 = 2000;
/// Points that a stroke stands for where its light is scattered more than once.
const STROKE_POINTS: usize = 24;
/// How a medium of one phase function spreads light of points; kept from frame to frame.
pub struct Spreading {
    once: Airlight,
    more: PointSpread,
    /// Largest value of the phase function, 1/sr.
    peak: f64,
}

impl Spreading {
    /// What was kept, if it is of this phase function; else worked out.
    pub fn of(kept: Option<Self>, phase: &Phase) -> Self {
        match kept {
            Some(known) if known.once.phase() == phase => known,
            _ => {
                let value = |i: u32| phase.values(f64::from(i) / f64::from(COSINES) * 2.0 - 1.0);
                let peak = (0..=COSINES).flat_map(value).fold(0.0, f64::max);
                Self { once: Airlight::new(phase), more: PointSpread::new(phase), peak }
            }
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
    /// Sum of the intensities.
    total: f64,
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
    /// The field under covers, as the eye sees it.
    covered: Option<&'a dyn RainPath>,
    fineness: tiles::Fineness,
    /// Light that stands behind the halos at least.
    behind: [f32; 3],
    lights: Vec<Halo>,
}

impl<'a> Halos<'a> {
    /// None yet.
    pub fn new(tables: &'a Spreading, medium: &Medium, field: &'a dyn RainPath) -> Self {
        Self {
            tables,
            extinction: medium.extinction().0,
            field,
            walls: None,
            covered: None,
            fineness: FrameQuality::STILL.halos.into(),
            behind: [0.0; 3],
            lights: Vec::new(),
        }
    }

    /// The same where a town's walls and hills stand between its own lamps, in its own order, and the rain that they light.
    #[must_use]
    pub fn with_walls(self, walls: Option<&'a Town>) -> Self {
        Self { walls, ..self }
    }

    /// The same where covers keep rain off, which scatters nothing there and dims no lamp: `covered` is the field under them.
    #[must_use]
    pub fn under(self, covered: &'a dyn RainPath) -> Self {
        Self { covered: covered.has_covers().then_some(covered), ..self }
    }

    /// The same looked at as finely as a frame wants it.
    #[must_use]
    pub fn with_spacing(self, spacing: Spacing) -> Self {
        Self { fineness: spacing.into(), ..self }
    }

    /// The same before pixels of so much light at least, whatever their picture has: halos that are kept for other pictures.
    #[must_use]
    pub fn before(self, behind: [f32; 3]) -> Self {
        Self { behind, ..self }
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
            self.lights.push(Halo { shape, intensity, extinction, most, total });
        }
    }

    /// Adds lamps, as far as it rains between them and the eye.
    pub fn add_lamps(&mut self, lamps: &[StreetLamp], eye: DVec3) {
        for (number, lamp) in lamps.iter().enumerate() {
            let place = DVec3::from_array(lamp.position.map(f64::from));
            let distance = eye.distance(place);
            let ray = Ray { origin: eye, direction: (place - eye).normalize_or(DVec3::Z) };
            let field = self.covered.unwrap_or(self.field);
            let share = match field.is_everywhere() || distance == 0.0 {
                true => 1.0,
                false => field.path(&ray, 0.0, distance) / distance,
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
        if !self.lights.is_empty() {
            tiles::draw(self, camera, metres, picture);
        }
    }

    /// Radiance that all lights add on a ray that ends `end` m away, before a pixel of so much light.
    #[cfg(test)]
    pub(crate) fn radiance(&self, ray: &Ray, end: f64, pixel: [f32; 3]) -> [f32; 3] {
        self.radiance_of(0..self.lights.len(), ray, end, pixel)
    }

    /// The same of some lights by their numbers.
    fn radiance_of(
        &self,
        lights: impl Iterator<Item = usize>,
        ray: &Ray,
        end: f64,
        pixel: [f32; 3],
    ) -> [f32; 3] {
        let mut sum = [[0.0; 3]];
        self.add_radiance(lights, ray, (&[end], end), pixel, &mut sum);
        sum[0]
    }

    /// Adds radiance on a ray that ends at each of some distances, m, to as many sums. Where walls stand before lights is looked for once, on the
    /// ray that ends `farthest`.
    fn add_radiance(
        &self,
        lights: impl Iterator<Item = usize>,
        ray: &Ray,
        (ends, farthest): (&[f64], f64),
        pixel: [f32; 3],
        sums: &mut [[f32; 3]],
    ) {
        let least = f64::from(self.fineness.least * (pixel[0] + pixel[1] + pixel[2]));
        // Where something keeps rain off before the ray's end.
        let is_dry =
            |covered: &&dyn RainPath| covered.is_dry_before(ray.direction.as_vec3(), farthest as f32);
        let dry = self.covered.filter(is_dry);
        let is_partial = self.walls.is_some() || dry.is_some();
        let rained_on =
            |end: f64| if self.field.is_everywhere() { end } else { self.field.path(ray, 0.0, end) };
        let mut paths = [0.0; tiles::MOST_DEPTHS];
        paths.iter_mut().zip(ends).for_each(|(path, &end)| *path = rained_on(end));
        let (paths, farthest) = (&paths[..ends.len()], rained_on(farthest));
        let Spreading { once, more, .. } = self.tables;
        for number in lights {
            let Halo { shape, intensity, extinction, .. } = &self.lights[number];
            let (middle, radius) = match shape {
                Shape::Lamp(place, _) => (*place, LAMP_RADIUS_M),
                Shape::Line(ends) => (0.5 * (ends[0] + ends[1]), 0.5 * ends[0].distance(ends[1])),
                Shape::Ball(place, radius) => (*place, *radius),
            };
            let longest = PointBeside::new(middle, ray.origin, ray.direction, farthest, radius);
            let mut lit = None;
            for (&end, sum) in paths.iter().zip(&mut *sums) {
                let beside = PointBeside { end, ..longest };
                let bounds = self.bounds(number, &beside, radius, least);
                let mut add = |share: [f64; 3]| {
                    (0..3).for_each(|band| sum[band] += intensity[band] * share[band] as f32);
                };
                // Light that is scattered more than once goes the same ways to begin with, and loses the same share.
                let mut open = 1.0;
                if bounds[0] > 0.0 || (bounds[1] > 0.0 && is_partial) {
                    match shape {
                        Shape::Lamp(_, number) => {
                            let whole = once.of_point(*extinction, &beside);
                            let is_seen = is_partial && whole.iter().any(|band| *band > 0.0);
                            let seen = match is_seen {
                                true => {
                                    let lit = lit
                                        .get_or_insert_with(|| self.lit_pieces(*number, ray, &longest, dry));
                                    once.of_point_past(*extinction, &beside, whole, lit)
                                }
                                false => whole,
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
                if bounds[1] > 0.0 {
                    add(more.of_point(*extinction, &beside).map(|share| share * open));
                }
            }
        }
    }

    /// Pieces of a ray that lamp `number` lights, past walls and where it rains.
    fn lit_pieces(
        &self,
        number: usize,
        ray: &Ray,
        beside: &PointBeside,
        dry: Option<&dyn RainPath>,
    ) -> LitPieces {
        let reaches = |along: f64| {
            let place = ray.origin + ray.direction * along;
            if dry.is_some_and(|covered| !covered.is_reached(place)) {
                return 0.0;
            }
            self.walls.map_or(1.0, |town| f64::from(town.lamp_reaches(number, place.as_vec3())))
        };
        LitPieces::of(beside, (&reaches, self.fineness.pieces))
    }

    /// Bounds on what a light adds that is scattered once, and more often; 0 of what stays below `least`.
    fn bounds(&self, number: usize, beside: &PointBeside, radius: f64, least: f64) -> [f64; 2] {
        let Halo { extinction, most, total, shape, .. } = &self.lights[number];
        let mut bounds = [most[0] / beside.h, most[1]];
        let keep = |bounds: [f64; 2]| {
            let is_lost = bounds[0] + bounds[1] < least;
            bounds.map(|bound| if is_lost || bound < 0.5 * least { 0.0 } else { bound })
        };
        bounds = keep(bounds);
        // A ray that soon ends sees little even of what is bright around the light: its length times the most that is scattered
        // towards it anywhere as near to the light as it comes.
        let nearest = (beside.foot - beside.end).max(-beside.foot).max(0.0);
        let near = (nearest * nearest + beside.h * beside.h).sqrt() - radius;
        if near <= beside.end || bounds == [0.0; 2] {
            return bounds;
        }
        if !matches!(shape, Shape::Ball(..)) {
            let once = self.tables.peak * extinction * total * beside.end / (near * near);
            bounds[0] = bounds[0].min(once);
        }
        if bounds[1] > 0.0 {
            bounds[1] = bounds[1].min(self.tables.more.most_of_piece(*extinction, near, beside.end) * total);
        }
        keep(bounds)
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
