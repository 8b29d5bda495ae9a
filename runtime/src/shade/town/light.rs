//! How a town's surfaces are lit, and what wet ground mirrors.
//!
//! The mirror is the water's exact Fresnel share of what tilted facets see. Broad things (sky, cloud, walls) are
//! seen along a few stratified facet normals; points (street lamps, a flash's channel) have a closed form and so
//! neither grain nor gaps. Near grazing, the facets' spread alone draws reflections out towards the viewer: the
//! streaks of \[toyshop\] §6.3 without a blur pass.

use super::ground::FILM_SLOPE;
use super::line::{Images, Place};
use super::rain::RainBetween;
use super::{Hit, Surface, Thing, Town};
use crate::shade::water::{GLASS, fresnel_reflectance, rippled_highlight, water_reflectance};
use crate::world::Sun;
use glam::{Vec2, Vec3};

/// A light without extent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneLight {
    /// Where, m.
    pub position: Vec3,
    /// Radiant intensity per colour, W/sr.
    pub intensity: [f32; 3],
    /// Share of it that arrives through rain and cloud, in [0, 1].
    pub visibility: f32,
}

/// A light that fills a ball, as the lit part of a cloud does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlowLight {
    /// Middle of the ball, m.
    pub centre: Vec3,
    /// Its radius, m.
    pub radius: f32,
    /// Mean radiance of its face, W/(m² sr).
    pub radiance: [f32; 3],
}

/// The light of one stroke on the town, as points; its share of a picture is kept apart from the rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StrokeLights {
    /// Points that light surfaces and cast shadows.
    pub points: Vec<SceneLight>,
    /// Lines whose image stands in the water.
    pub images: Images,
}

/// Light of everything else, and of up to `N` strokes apart: all of it goes the same way, and each part scales with its source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts<const N: usize> {
    /// Everything else, per colour.
    pub base: [f32; 3],
    /// Each stroke's, per channel.
    pub strokes: [[f32; 3]; N],
}

impl<const N: usize> Parts<N> {
    /// No light.
    pub const NONE: Self = Self { base: [0.0; 3], strokes: [[0.0; 3]; N] };

    pub(super) fn of(base: [f32; 3]) -> Self {
        Self { base, ..Self::NONE }
    }

    /// The smaller of two numbers everywhere.
    pub(super) fn least(self, other: Self) -> Self {
        self.zip(other, |a, b| if b < a { b } else { a })
    }

    /// The larger of two numbers everywhere.
    pub(super) fn most(self, other: Self) -> Self {
        self.zip(other, |a, b| if b > a { b } else { a })
    }

    fn zip(mut self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        (0..3).for_each(|band| self.base[band] = of(self.base[band], other.base[band]));
        // One after another, so that a register takes several.
        let strokes = self.strokes.as_flattened_mut().iter_mut().zip(other.strokes.as_flattened());
        strokes.for_each(|(light, &other)| *light = of(*light, other));
        self
    }

    pub(super) fn each(mut self, change: impl Fn(usize, f32) -> f32) -> Self {
        for light in std::iter::once(&mut self.base).chain(&mut self.strokes) {
            (0..3).for_each(|band| light[band] = change(band, light[band]));
        }
        self
    }

    /// Adds `factor` times `other`.
    pub fn add(&mut self, factor: f32, other: Self) {
        add(&mut self.base, factor, other.base);
        let strokes = self.strokes.as_flattened_mut().iter_mut().zip(other.strokes.as_flattened());
        strokes.for_each(|(sum, value)| *sum += factor * value);
    }
}

/// Everything that shines on the town from outside; its own lamps come on top.
#[derive(Clone, Copy)]
pub struct Lighting<'a> {
    /// Irradiance of the sky on a surface by its unit normal, W/m².
    pub ambient: &'a (dyn Fn(Vec3) -> [f32; 3] + Sync),
    /// Points that light surfaces and cast shadows: a stroke as a handful of points.
    pub points: &'a [SceneLight],
    /// Lines whose image stands in the water: a stroke's channel. What is listed here must not
    /// be in the closure that says what leaving rays see, or its image stands there twice.
    pub images: &'a Images,
    /// Strokes whose light is to be told apart; those beyond the parts that are asked for are left out.
    pub strokes: &'a [StrokeLights],
    /// Lit cloud, as light on surfaces without shadows; its image comes from the closure.
    pub glows: &'a [GlowLight],
    /// Radiance of a ray (origin m, unit direction) that meets nothing: sky and cloud, W/(m² sr). Reflections alone
    /// ask for it, several times a pixel: [`crate::shade::environment`] makes it cheap.
    pub leaves: &'a (dyn Fn(Vec3, Vec3) -> [f32; 3] + Sync),
    /// The sun, where it shines: with shadows, and a glint on the water.
    pub sun: Option<Sun>,
    /// The rain that every light comes through on its own way.
    pub rain: &'a dyn RainBetween,
}

/// How a rough mirror is looked into for one sample of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Mirror {
    /// Facets looked at on the roughest film, at least 1; smoother water needs fewer.
    pub facets: u32,
    /// Which of the pixel's samples this is and how many there are: together they look along one sequence of
    /// facets without gap, which is what keeps grain away.
    pub sample: [u32; 2],
    /// Place in the unit square that shifts the facets of neighbouring pixels against each other.
    pub shift: Vec2,
    /// Angle that a pixel covers, rad: highlights are never narrower.
    pub angle: f32,
    /// Factor on the images of points; 0 leaves them out. They are smooth over a pixel, so that a few of its
    /// samples can show them for all.
    pub points: f32,
}

/// The light at a spot that its surface makes something of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shading<const N: usize> {
    /// Irradiance, W/m².
    pub irradiance: Parts<N>,
    /// Radiance that a pane of glass shows, W/(m² sr); none where there is no glass.
    pub pane: Option<Parts<N>>,
    /// Radiance of the water's facets, and the share that they keep from what lies below; none where it is dry.
    pub mirrored: Option<(Parts<N>, f32)>,
}

/// Whether walls stand before pieces of a channel that are close to each other: where they do not before the first and the last,
/// they don't between, and the same of where they do.
#[derive(Default)]
struct Openness {
    ends: Option<[bool; 2]>,
}

impl Openness {
    /// Whether piece `number` of `count` is seen; `is_open` looks.
    fn at(&mut self, number: usize, count: usize, is_open: &dyn Fn(usize) -> bool) -> bool {
        let ends = *self.ends.get_or_insert_with(|| {
            let first = is_open(0);
            [first, if count > 1 { is_open(count - 1) } else { first }]
        });
        match ends {
            [first, last] if first == last => first,
            [first, _] if number == 0 => first,
            [_, last] if number + 1 == count => last,
            _ => is_open(number),
        }
    }
}

/// Just below the share of a number of single precision that, added to it, never changes it.
const HALF_A_DIGIT: f32 = 2.9e-8;
/// As far as anything that casts a shadow may stand, m.
const FARTHEST_SHADE_M: f32 = 5e4;

/// Irradiance of one point on a surface, per colour, without shadow.
pub(super) fn irradiance(light: &SceneLight, point: Vec3, normal: Vec3) -> [f32; 3] {
    let way = light.position - point;
    let squared = way.length_squared().max(1e-6);
    let cosine = normal.dot(way) / squared.sqrt();
    let share = light.visibility * cosine.max(0.0) / squared;
    light.intensity.map(|value| value * share)
}

fn add(sum: &mut [f32; 3], factor: f32, value: [f32; 3]) {
    for band in 0..3 {
        sum[band] += factor * value[band];
    }
}

/// What a surface sends by itself, and what it scatters of light that arrives.
fn scattered<const N: usize>(irradiance: Parts<N>, surface: &Surface) -> Parts<N> {
    let mut light = irradiance.each(|band, arriving| surface.albedo[band] * arriving / std::f32::consts::PI);
    add(&mut light.base, 1.0, surface.emission);
    light
}

/// The k-th point of a sequence that fills the unit square evenly, and its first side best of all: multiples of
/// the golden ratio there, of a number far from it along the other.
fn spread(k: u32, shift: Vec2) -> Vec2 {
    let at = Vec2::new(0.618_034, 0.754_877_7) * k as f32 + shift;
    at - at.floor()
}

/// The value that a normal variable stays below with probability `share`, cut at ±2.9: polynomial of \[giles\],
/// error below 1e-4.
fn normal_quantile(share: f32) -> f32 {
    const POWERS: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725e-3,
        -4.177_681_6e-3,
        0.246_640_73,
        1.501_409_4,
    ];
    let x = 2.0 * share.clamp(0.002, 0.998) - 1.0;
    let w = -libm::logf((1.0 - x) * (1.0 + x)) - 2.5;
    std::f32::consts::SQRT_2 * x * POWERS.iter().fold(0.0, |sum, power| sum * w + power)
}

impl Town {
    /// Irradiance of everything on a spot, W/m².
    pub fn irradiance<const N: usize>(&self, hit: &Hit, lighting: &Lighting) -> Parts<N> {
        let mut sum = (lighting.ambient)(hit.normal);
        for glow in lighting.glows {
            let way = glow.centre - hit.point;
            let squared = way.length_squared().max(1e-6);
            // A ball of radiance L sends π L (r/d)² to a surface that faces it.
            let share = (glow.radius * glow.radius / squared).min(1.0);
            let cosine = (hit.normal.dot(way) / squared.sqrt()).max(0.0);
            add(&mut sum, std::f32::consts::PI * share * cosine, glow.radiance);
        }
        let start = Self::lifted(hit);
        let shadowed = |sum: &mut [f32; 3], lights: &[SceneLight]| {
            for light in lights {
                let own = irradiance(light, hit.point, hit.normal);
                if own.iter().any(|&v| v > 0.0) && !self.is_blocked(start, light.position) {
                    add(sum, lighting.rain.left_far(start, light.position), own);
                }
            }
        };
        shadowed(&mut sum, lighting.points);
        if let Some(sun) = &lighting.sun {
            let cosine = hit.normal.dot(sun.towards);
            let [left, sent_on] = lighting.rain.of_beam(start, sun.towards, cosine);
            let direct = left * cosine.max(0.0);
            let is_lit = direct > 0.0 && self.sees(start, sun.towards);
            add(&mut sum, if is_lit { direct + sent_on } else { sent_on }, sun.irradiance);
        }
        let lamps = self.lamp_irradiance(hit, lighting, sum);
        add(&mut sum, 1.0, lamps);
        let mut parts = Parts::of(sum);
        for (sum, stroke) in parts.strokes.iter_mut().zip(lighting.strokes) {
            shadowed(sum, &stroke.points);
        }
        parts
    }

    /// Whether nothing of the town stands before the sky in unit direction `towards`.
    pub(super) fn sees(&self, start: Vec3, towards: Vec3) -> bool {
        !self.is_blocked(start, start + towards * FARTHEST_SHADE_M)
    }

    /// What a mirrored ray sees: the town, or what is beyond, through the rain on its way.
    fn seen<const N: usize>(
        &self,
        start: Vec3,
        onward: Vec3,
        blur: impl Fn(f32) -> f32,
        lighting: &Lighting,
    ) -> Parts<N> {
        let (light, metres) = match self.trace(start, onward, f32::MAX) {
            Some(other) => {
                let surface = self.surface(&other, blur(other.distance));
                (self.matt(&other, &surface, lighting), other.distance)
            }
            None => (Parts::of((lighting.leaves)(start, onward)), f32::INFINITY),
        };
        let (left, added) = lighting.rain.along(start, onward, metres);
        // A hidden sky contributes nothing, however bright it is.
        let mut light = light.each(|_, value| if left > 0.0 { value * left } else { 0.0 });
        add(&mut light.base, 1.0, added);
        light
    }

    /// What a spot sends back towards the eye all around: its own light and what it scatters.
    fn matt<const N: usize>(&self, hit: &Hit, surface: &Surface, lighting: &Lighting) -> Parts<N> {
        scattered(self.irradiance::<N>(hit, lighting), surface)
    }

    /// Whether a spot may show panes of glass.
    pub(super) fn has_panes(&self, hit: &Hit) -> bool {
        matches!(hit.thing, Thing::Block(number, Some(_), _) if self.blocks[number].windows.is_some())
    }

    /// What a pane of glass at a spot shows. A pane is flat: it shows things as finely as the pixel does.
    pub(super) fn pane<const N: usize>(
        &self,
        direction: Vec3,
        hit: &Hit,
        footprint: f32,
        lighting: &Lighting,
    ) -> Parts<N> {
        let cosine = -direction.dot(hit.normal);
        let seen = direction + hit.normal * (2.0 * cosine);
        self.seen(Self::lifted(hit), seen, |_| footprint, lighting)
    }

    /// Radiance of what a ray in unit `direction` met, towards where it came from, W/(m² sr).
    ///
    /// `footprint` is the width that the sample covers there, m.
    pub fn shade<const N: usize>(
        &self,
        direction: Vec3,
        hit: &Hit,
        footprint: f32,
        lighting: &Lighting,
        mirror: Mirror,
    ) -> Parts<N> {
        let surface = self.surface(hit, footprint);
        let shading = Shading {
            irradiance: self.irradiance::<N>(hit, lighting),
            pane: (surface.glass > 0.0).then(|| self.pane(direction, hit, footprint, lighting)),
            mirrored: (surface.wet > 0.0).then(|| self.mirrored(direction, hit, &surface, lighting, mirror)),
        };
        self.composed(direction, hit, &surface, &shading)
    }

    /// The same of a surface in light that was worked out.
    pub(super) fn composed<const N: usize>(
        &self,
        direction: Vec3,
        hit: &Hit,
        surface: &Surface,
        shading: &Shading<N>,
    ) -> Parts<N> {
        let mut light = scattered(shading.irradiance, surface);
        if let Some(pane) = shading.pane {
            let share = surface.glass * fresnel_reflectance(-direction.dot(hit.normal), GLASS);
            light.add(share, pane);
        }
        if let Some((mut mirrored, share)) = shading.mirrored {
            mirrored.add(-share, light);
            light.add(surface.wet, mirrored);
        }
        light
    }

    /// Light from the water's facets and the share that they keep from what lies below.
    pub(super) fn mirrored<const N: usize>(
        &self,
        direction: Vec3,
        hit: &Hit,
        surface: &Surface,
        lighting: &Lighting,
        mirror: Mirror,
    ) -> (Parts<N>, f32) {
        let (sum, share) = self.facets(direction, hit, surface, lighting, mirror);
        let mut light = sum;
        light.add(1.0, self.images(direction, hit, surface, (lighting, mirror), sum));
        (light, share)
    }

    /// Images of points and lines in water whose facets show `facets`: what that cannot be told from is left out.
    pub(super) fn images<const N: usize>(
        &self,
        direction: Vec3,
        hit: &Hit,
        surface: &Surface,
        (lighting, mirror): (&Lighting, Mirror),
        facets: Parts<N>,
    ) -> Parts<N> {
        let mut sum = facets;
        if mirror.points == 0.0 {
            return Parts::NONE;
        }
        let (start, to_viewer) = (Self::lifted(hit), -direction);
        // A pixel's own width adds to the facets' spread, so that no highlight falls between pixels.
        let slope = (surface.slope * surface.slope + 0.25 * mirror.angle * mirror.angle).sqrt();
        // What adds less than a thousandth is not worth asking whether a wall stands before it.
        let faint = |share: f32, light: f32, sum: &[f32; 3]| share * light < 1e-3 * sum[1];
        // What is below half a last digit of the sum leaves it as it is: neither walls nor rain need be asked.
        let is_lost = |share: f32, light: [f32; 3], sum: &[f32; 3]| {
            (0..3).all(|band| share * light[band] <= HALF_A_DIGIT * sum[band])
        };
        let place = Place { point: hit.point, normal: hit.normal, to_viewer, slope };
        let shown_of = |images: &'_ Images, sum: &mut [f32; 3]| {
            images.each_shown(&place, |centre, lines| {
                let mut left = None;
                let mut open = Openness::default();
                for (number, (light, bright)) in lines.iter().enumerate() {
                    let share = mirror.points * bright * light.visibility;
                    if is_lost(share, light.intensity, sum) {
                        continue;
                    }
                    let is_open = |number: usize| !self.is_blocked(start, lines[number].0.middle());
                    let faint = faint(share, light.intensity[1], sum);
                    if faint || open.at(number, lines.len(), &is_open) {
                        let left = *left.get_or_insert_with(|| lighting.rain.left_far(start, centre));
                        add(sum, share * left, light.intensity);
                    }
                }
            });
        };
        shown_of(lighting.images, &mut sum.base);
        // Measured against the stroke's own light, what is faint is so at any brightness.
        for (sum, stroke) in sum.strokes.iter_mut().zip(lighting.strokes) {
            shown_of(&stroke.images, sum);
        }
        self.each_lamp_in_water(hit, to_viewer, slope, |number, lamp| {
            let way = lamp.position - hit.point;
            let squared = way.length_squared().max(1e-4);
            let highlight = rippled_highlight(hit.normal, way / squared.sqrt(), to_viewer, slope);
            let share = mirror.points * highlight / squared;
            if share > 0.0 && !is_lost(share, lamp.intensity, &sum.base) {
                let reach = if faint(share, lamp.intensity[1], &sum.base) {
                    1.0
                } else {
                    self.lamp_share(number, hit)
                };
                add(&mut sum.base, share * reach * lighting.rain.left(start, lamp.position), lamp.intensity);
            }
        });
        if let Some(sun) = &lighting.sun {
            // A facet's tilt turns a reflection by twice as much, so the disc counts with half its size; a disc's standard
            // deviation along one axis is half its radius.
            let disc = 0.25 * sun.angular_radius.0 as f32;
            let slope = (slope * slope + disc * disc).sqrt();
            let share = mirror.points * rippled_highlight(hit.normal, sun.towards, to_viewer, slope);
            if share > 0.0 && self.sees(start, sun.towards) {
                let [left, _] = lighting.rain.of_beam(start, sun.towards, 0.0);
                add(&mut sum.base, share * left, sun.irradiance);
            }
        }
        sum.add(-1.0, facets);
        sum
    }

    /// What the facets of a rough mirror show of the world around, and the share of it that they reflect.
    pub(super) fn facets<const N: usize>(
        &self,
        direction: Vec3,
        hit: &Hit,
        surface: &Surface,
        lighting: &Lighting,
        mirror: Mirror,
    ) -> (Parts<N>, f32) {
        let start = Self::lifted(hit);
        let to_viewer = -direction;
        let along = direction.truncate().normalize_or(Vec2::X);
        let (mut sum, mut share, mut weights) = (Parts::NONE, 0.0, 0.0);
        // A rough film needs all facets, still water few: the samples of a pixel differ anyway.
        let facets =
            (mirror.facets as f32 * (surface.slope / FILM_SLOPE).sqrt().min(1.0)).ceil().max(1.0) as u32;
        for k in 0..facets {
            // Slopes towards and away from the eye move a reflection up and down, which at grazing is most of
            // what happens: they get the sequence's better side.
            let at = spread(mirror.sample[0] + k * mirror.sample[1], mirror.shift);
            let (toward, aside) = (normal_quantile(at.x), normal_quantile(at.y));
            let tilt = (along * toward + along.perp() * aside) * surface.slope;
            let facet = (hit.normal + tilt.extend(0.0)).normalize();
            // A facet shows itself as large as it is seen.
            let seen = to_viewer.dot(facet);
            if seen <= 0.0 {
                continue;
            }
            let mut onward = direction + facet * (2.0 * seen);
            // What a steep facet sends down meets the water again and goes up after all.
            onward.z = onward.z.abs().max(1e-4);
            let onward = onward.normalize();
            let reflected = seen * water_reflectance(seen);
            let blur = |metres: f32| metres * (surface.slope + mirror.angle);
            let light = self.seen(start, onward, blur, lighting);
            sum.add(reflected, light);
            share += reflected;
            weights += seen;
        }
        if weights > 0.0 {
            sum = sum.each(|_, value| value / weights);
            share /= weights;
        }
        (sum, share)
    }
}

#[cfg(test)]
mod tests;
