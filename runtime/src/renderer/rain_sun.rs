//! The sun in a frame's rain: dimmed by the rain and the cloud between it and every drop, and by nothing else, wherever the eye stands.
//!
//! A ray shows L = E ∫ [p(θ) D + M(τ_s, θ)] e^−τ dτ of the sun, D = C e^−τ_s what comes straight to a place and M what comes there scattered
//! ([`crate::medium::Phase::values_again`]), τ_s the rain between the place and the sun, C the cloud ([`super::cloud_shade`]). Of all that
//! a ray of transmittance F scatters, 1 − F, both have a mean along the ray: L = E (1 − F) [p(θ) a + b], 0 ≤ a ≤ 1. Means change slowly from
//! pixel to pixel and with the distance at which a ray ends; they are tabulated over the picture and over distances, once a frame, and p and
//! F are each pixel's own. Where nothing dims the sun a is 1 and b is 0: eq. 12 of \[weber\].
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | E | irradiance of the sun above rain and storm | W/m² |
//! | τ, F | optical depth along the ray; transmittance of all of it | – |
//! | a, b | mean shares of light that comes straight, and scattered | –, 1/sr |

use super::cloud_shade::CloudShade;
use super::world::{SunSeen, Surrounding};
use crate::camera::{Camera, Ray};
use crate::frame::Frame;
use crate::medium::{Medium, Phase};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::{RainField, RainPath};
use crate::world::{Beam, InScattering, Sun};
use glam::{DVec2, DVec3, Vec2};

/// Nodes across a picture, and at least and at most down it.
const ACROSS: usize = 33;
const DOWN: [usize; 2] = [9, 33];
/// Distances: the first, and the step of ln(1 + t/first) to the next; the last is 40 km away.
pub(crate) const DISTANCES: usize = 20;
pub(crate) const FIRST_M: f64 = 40.0;
pub(crate) const STEP: f64 = 0.3637;
/// Pieces between two distances, and parts of those where the cloud's shadow falls.
const PIECES: u32 = 2;
const SHADED: u32 = 3;
/// Transmittance behind which nothing is looked for.
const GONE: f64 = 1e-5;

/// The sun, and what stands between it and the rain.
pub struct RainSun<'a> {
    /// Where it rains.
    pub field: RainField<'a>,
    /// Extinction of all of the rain, 1/m.
    pub extinction: f64,
    /// How the rain spreads light.
    pub phase: &'a Phase,
    /// The sun above it.
    pub sun: Sun,
    /// The cloud before the sun.
    pub shade: Option<&'a CloudShade>,
}

impl RainSun<'_> {
    /// What comes through the rain to a place straight, and what comes there scattered and is sent on to the eye, 1/sr.
    fn at(&self, place: DVec3, cosine: f64) -> DVec2 {
        let depth = depth_to_sun(&self.field, self.extinction, (place, self.sun));
        DVec2::new(libm::exp(-depth), self.phase.values_again(depth, cosine))
    }

    /// What comes through the cloud to a place.
    fn open(&self, place: DVec3) -> f64 {
        self.shade.map_or(1.0, |shade| f64::from(shade.left(place)))
    }

    /// The means of a ray up to each distance.
    fn along(&self, ray: &Ray, out: &mut [Vec2; DISTANCES]) {
        let cosine = ray.direction.dot(self.sun.towards.as_dvec3());
        let place = |t: f64| ray.origin + ray.direction * t;
        let parts = if self.shade.is_some() { SHADED } else { 1 };
        let farthest = RainPath::farthest(&self.field);
        let (mut left, mut sum) = (1.0, DVec2::ZERO);
        let (mut here, mut begin) = (0.0, self.at(place(0.0), cosine));
        let mut lit = begin * self.open(place(0.0));
        out[0] = lit.as_vec2();
        for k in 1..DISTANCES {
            let [first, last] = [k - 1, k].map(distance);
            for piece in 1..=PIECES {
                let next = first + (last - first) * f64::from(piece) / f64::from(PIECES);
                if left <= GONE || here >= farthest {
                    break;
                }
                let end = self.at(place(next), cosine);
                let depth = self.extinction * self.field.path(ray, here, next) / f64::from(parts);
                // Between a part's ends D and M count as linear in the depth.
                let gone = -libm::expm1(-depth);
                let later =
                    if depth > 1e-4 { (gone - depth * libm::exp(-depth)) / depth } else { 0.5 * depth };
                for part in 1..=parts {
                    let share = f64::from(part) / f64::from(parts);
                    let then = begin.lerp(end, share) * self.open(place(here + (next - here) * share));
                    sum += left * ((gone - later) * lit + later * then);
                    (left, lit) = (left * (1.0 - gone), then);
                }
                (here, begin) = (next, end);
            }
            let whole = 1.0 - left;
            out[k] = if whole > 1e-9 { (sum / whole).as_vec2() } else { lit.as_vec2() };
        }
    }
}

/// Optical depth of the rain between a place and the sun.
pub fn depth_to_sun(field: &RainField<'_>, extinction: f64, (place, sun): (DVec3, Sun)) -> f64 {
    if extinction == 0.0 {
        return 0.0;
    }
    let ray = Ray { origin: place, direction: sun.towards.as_dvec3() };
    extinction * field.path(&ray, 0.0, f64::INFINITY)
}

/// What dims and spreads the sun's light on its way to the frame's drops, and to its rain of which none is drawn.
pub fn around_eye(frame: &Frame, field: &RainField<'_>) -> [Medium; 2] {
    let rate = field.rate(frame.weather.rate);
    [Medium::geometric(rate).with_phase(frame.medium.drop_phase()), frame.medium.undrawn(rate)]
}

/// What drops near the eye show of the world, the sun, where it is dimmed, and the flashes' beam; what rain none of which is drawn shows, where
/// that is something else; and that rain.
pub fn shown_around_eye(
    frame: &Frame,
    field: &RainField<'_>,
    mut seen: Option<(&mut Surrounding, Option<Sun>, Beam)>,
) -> (InScattering, Option<InScattering>, Medium) {
    let [of_drops, undrawn] = around_eye(frame, field);
    let mut shown_by = |medium: &Medium| match &mut seen {
        Some((surrounding, sun, flash)) => {
            let depth = |sun| depth_to_sun(field, medium.extinction().0, (frame.camera.position, sun));
            let sun = SunSeen::Behind(sun.map_or(0.0, depth));
            surrounding.in_scattering(medium.phase(), sun).with_beam(*flash)
        }
        None => InScattering::dark(medium.phase()),
    };
    let drops = shown_by(&of_drops);
    let is_own = undrawn.phase() != of_drops.phase() || undrawn.extinction() != of_drops.extinction();
    (drops, is_own.then(|| shown_by(&undrawn)), undrawn)
}

/// The k-th distance, m.
fn distance(k: usize) -> f64 {
    FIRST_M * libm::expm1(STEP * k as f64)
}

/// Means over a picture and over distances.
pub struct SunTable {
    /// Nodes across and down; pixels between them.
    pub counts: [usize; 2],
    step: [f64; 2],
    /// By distance, row and column.
    pub means: Vec<Vec2>,
}

impl SunTable {
    /// Columns and rows of [`SunTable::texels`].
    #[cfg(feature = "gpu")]
    pub const SIZE: [u32; 2] = [ACROSS as u32, (DOWN[1] * DISTANCES) as u32];

    /// Means as a graphics card takes them: distance after distance, dark rows after the last.
    #[cfg(feature = "gpu")]
    pub fn texels(&self) -> Vec<[f32; 4]> {
        let mut texels: Vec<[f32; 4]> = self.means.iter().map(|means| [means.x, means.y, 0.0, 0.0]).collect();
        texels.resize(ACROSS * DOWN[1] * DISTANCES, [0.0; 4]);
        texels
    }

    /// What a camera sees.
    pub fn new(sun: &RainSun<'_>, camera: &Camera) -> Self {
        let size = [camera.width, camera.height].map(f64::from);
        let down =
            libm::round((ACROSS - 1) as f64 * size[1] / size[0] * camera.pixel_aspect.recip()) as usize + 1;
        let counts = [ACROSS, down.clamp(DOWN[0], DOWN[1])];
        let step = [0, 1].map(|axis| size[axis] / (counts[axis] - 1) as f64);
        let secants = camera.secants();
        let mut rays = vec![[Vec2::ZERO; DISTANCES]; counts[0] * counts[1]];
        rays.par_chunks_mut(counts[0]).enumerate().for_each(|(row, rays)| {
            for (column, means) in rays.iter_mut().enumerate() {
                let ray = camera.ray_with(&secants, column as f64 * step[0], row as f64 * step[1]);
                sun.along(&ray, means);
            }
        });
        let means = (0..DISTANCES).flat_map(|k| rays.iter().map(move |means| means[k])).collect();
        Self { counts, step, means }
    }

    /// Means at pixel coordinates of a ray that ends after `metres`.
    pub fn at(&self, [x, y]: [f64; 2], metres: f64) -> Vec2 {
        let (row, v) = self.place(y, 1);
        let (k, share) = between(metres as f32);
        let [near, far] = [k, k + 1].map(|k| {
            let [a, b] = [row, row + 1]
                .map(|row| self.across(&self.means[(k * self.counts[1] + row) * self.counts[0]..], x));
            a.lerp(b, v)
        });
        near.lerp(far, share)
    }

    /// Node before a pixel coordinate and the share of the next one.
    fn place(&self, at: f64, axis: usize) -> (usize, f32) {
        let at = (at / self.step[axis]).clamp(0.0, (self.counts[axis] - 1) as f64);
        let node = (at as usize).min(self.counts[axis] - 2);
        (node, (at - node as f64) as f32)
    }

    fn across(&self, row: &[Vec2], x: f64) -> Vec2 {
        let (column, u) = self.place(x, 0);
        row[column].lerp(row[column + 1], u)
    }

    /// Adds the sun's light to `picture` as the rain before its things, `metres` away, shows it. `left` is what the rain left of each
    /// pixel's light.
    pub fn draw(
        &self,
        sun: &RainSun<'_>,
        camera: &Camera,
        (metres, left): (&[f32], &[f32]),
        picture: &mut Picture,
    ) {
        let width = picture.width;
        let rows = picture.pixels.par_chunks_mut(width);
        let rows = rows.zip(metres.par_chunks(width)).zip(left.par_chunks(width));
        rows.enumerate().for_each(|(y, ((pixels, metres), left))| {
            let mut line = [Vec2::ZERO; DISTANCES * ACROSS];
            let (row, v) = self.place(y as f64 + 0.5, 1);
            for k in 0..DISTANCES {
                let own = &self.means[(k * self.counts[1] + row) * ACROSS..];
                for column in 0..ACROSS {
                    line[k * ACROSS + column] = own[column].lerp(own[ACROSS + column], v);
                }
            }
            let seen = RowOfSun::new(sun, camera, y);
            let per_pixel = self.step[0].recip() as f32;
            for (x, pixel) in pixels.iter_mut().enumerate() {
                let scattered = 1.0 - left[x];
                if scattered <= 0.0 {
                    continue;
                }
                let (k, share) = between(metres[x]);
                let at = (x as f32 + 0.5) * per_pixel;
                let column = (at as usize).min(ACROSS - 2);
                let u = at - column as f32;
                let own = |k: usize| line[k * ACROSS + column].lerp(line[k * ACROSS + column + 1], u);
                let means = own(k).lerp(own(k + 1), share);
                let phase = seen.phase(x);
                for band in 0..3 {
                    let shown = sun.sun.irradiance[band] * (phase[band] * means.x + means.y);
                    pixel[band] += scattered * shown;
                }
            }
        });
    }
}

/// The sun's phase function along one row of pixels.
struct RowOfSun<'a> {
    phase: &'a Phase,
    /// Scale, (1 − |g|)² and 2 g of Henyey and Greenstein's function, where it is one.
    closed: Option<[f32; 3]>,
    /// cos θ = (first + along · t)/√(level + t²), t the tangent to the right at a pixel's middle.
    first: f32,
    along: f32,
    level: f32,
    tangent: f32,
    per_pixel: f32,
}

impl<'a> RowOfSun<'a> {
    fn new(sun: &RainSun<'a>, camera: &Camera, y: usize) -> Self {
        let towards = sun.sun.towards.as_dvec3();
        let [own, next] = [0.5, 1.5].map(|x| camera.tangents(x, y as f64 + 0.5));
        let closed = sun.phase.as_henyey_greenstein().map(|(factor, g)| {
            let scale = factor * (1.0 - g * g) / (4.0 * std::f64::consts::PI);
            [scale, (1.0 - g.abs()) * (1.0 - g.abs()), 2.0 * g].map(|value| value as f32)
        });
        Self {
            phase: sun.phase,
            closed,
            first: (camera.forward - camera.up * own.y).dot(towards) as f32,
            along: camera.right.dot(towards) as f32,
            level: (1.0 + own.y * own.y) as f32,
            tangent: own.x as f32,
            per_pixel: (next.x - own.x) as f32,
        }
    }

    /// 1/sr per colour at pixel x.
    fn phase(&self, x: usize) -> [f32; 3] {
        let t = self.tangent + x as f32 * self.per_pixel;
        let cosine = (self.first + self.along * t) / (self.level + t * t).sqrt();
        let Some([scale, narrow, twice]) = self.closed else {
            return self.phase.values(f64::from(cosine.clamp(-1.0, 1.0))).map(|value| value as f32);
        };
        // 1 + g² − 2g cos θ in a form that keeps its digits at the peak.
        let base = narrow + twice * (1.0f32.copysign(twice) - cosine);
        [scale / (base * base.sqrt()); 3]
    }
}

/// Distance before one, and the share of the next; the logarithm's fraction by a parabola, within a fiftieth of a step.
fn between(metres: f32) -> (usize, f32) {
    const PER_OCTAVE: f32 = std::f32::consts::LN_2 / STEP as f32;
    let bits = (1.0 + metres.max(0.0) / FIRST_M as f32).to_bits();
    let fraction = f32::from_bits(bits & 0x7f_ffff | 0x3f80_0000);
    let octaves = (bits >> 23) as f32 - 127.0;
    let at = PER_OCTAVE * (octaves + (2.0 - fraction / 3.0) * fraction - 5.0 / 3.0);
    let k = (at.max(0.0) as usize).min(DISTANCES - 2);
    (k, (at - k as f32).clamp(0.0, 1.0))
}

/// Radiance of a whole ray: E (p a + b).
pub fn shown(sun: &Sun, phase: [f64; 3], means: Vec2) -> [f32; 3] {
    std::array::from_fn(|band| sun.irradiance[band] * (phase[band] as f32 * means.x + means.y))
}

#[cfg(test)]
mod tests;
