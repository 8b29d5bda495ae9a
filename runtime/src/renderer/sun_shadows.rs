//! Shadows of towers and hills in sunlit rain, and the crepuscular rays between them: what the sun doesn't reach shows none of its light.
//!
//! The picture has the sun's light as if the sun stood free of town and hills along the whole ray: as eq. 12 of \[weber\] has it, E p(θ) (1 − F)
//! ([`crate::medium::Medium::apply`]), or dimmed by rain and cloud, E (1 − F) [p(θ) a + b] ([`super::rain_sun`]). A ray that ended after t m
//! would show (1 − e^−τ(t)) times its own means a and b; so each stretch holds a difference, and of stretches in shadow it is taken
//! off again. Shares change slowly from pixel to pixel but for the edges of shadows
//! and of things: they are worked out at the corners of tiles, and lie between them where the tile's middle and sides agree.
//! Light that drops have sent on before is in shadow where the straight beam is.
//!
//! | symbol | quantity | unit |
//! |---|---|---|
//! | E | irradiance of the sun at the eye, or above rain and cloud | W/m² |
//! | a, b | mean shares of light that comes straight, and scattered; 1 and 0 in eq. 12 | –, 1/sr |
//! | p | phase function | 1/sr |
//! | τ, F | optical depth along the ray; transmittance of all of it | – |

use super::rain_sun::{SunTable, shown};
use crate::camera::{Camera, Ray};
use crate::medium::Medium;
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::rain::RainPath;
use crate::shade::adaptive::Spacing;
use crate::shade::town::Town;
use crate::world::Sun;
use glam::{DVec3, Vec2};

/// Edge of the largest tile, px.
const LARGEST: usize = 16;
/// Share of a pixel's light below which shadows are left out.
const UNSEEN: f32 = 1e-4;
/// Share of the tolerance of halos that what lies between a tile's corners may be off by.
const ALLOWED: f32 = 0.5;

/// The sun of a frame, and what of the town stands before it.
#[derive(Clone, Copy)]
pub struct SunShadows<'a> {
    town: &'a Town,
    sun: Sun,
}

impl<'a> SunShadows<'a> {
    /// Of a sun that shines and a town that can keep it off; else none.
    pub fn new(town: Option<&'a Town>, sun: Option<Sun>) -> Option<Self> {
        let town = town.filter(|town| town.can_shade())?;
        let sun = sun.filter(|sun| sun.irradiance != [0.0; 3])?;
        Some(Self { town, sun })
    }

    /// Whether the sun doesn't reach a place.
    pub fn is_dark(&self, place: DVec3) -> bool {
        self.town.is_shaded(place.as_vec3(), self.sun.towards)
    }

    /// Unit vector towards the sun.
    pub fn towards(&self) -> DVec3 {
        self.sun.towards.as_dvec3()
    }

    /// Of all light that even rain without end would scatter along a ray, the share that would come from stretches in shadow up to `end`
    /// m; `left(t)` is what comes through the first t m.
    pub fn share(&self, ray: &Ray, end: f64, left: impl Fn(f64) -> f64) -> f32 {
        let mut stretches = Vec::new();
        self.town.find_shadows((ray.origin, ray.direction), self.sun.towards, end, &mut stretches);
        share_of(&stretches, |metres| Vec2::X * (1.0 - left(metres)) as f32).x
    }

    /// Takes the sun's light off `picture` where the rain before its things, `metres` away, is in shadow. `left` is what the medium left
    /// of each pixel's light; `table` the sun's light as it was added, that of eq. 12 without one.
    pub fn draw<V: RainPath>(
        &self,
        (medium, volume): (&Medium, &V),
        camera: &Camera,
        (metres, left): (&[f32], &[f32]),
        (spacing, table): (Spacing, Option<&SunTable>),
        picture: &mut Picture,
    ) {
        let width = picture.width;
        let secants = camera.secants();
        let smallest = (spacing.pixels as usize / 2).clamp(2, LARGEST);
        let rows = picture.pixels.par_chunks_mut(width * LARGEST);
        let rows = rows.zip(metres.par_chunks(width * LARGEST)).zip(left.par_chunks(width * LARGEST));
        rows.enumerate().for_each(|(number, ((pixels, metres), left))| {
            let top = number * LARGEST;
            let ray = |x: f64, y: f64| {
                let y = top as f64 + y;
                (camera.ray_with(&secants, x, y), secants.at(x, y))
            };
            let means = |[x, y]: [f64; 2], metres: f64| {
                table.map_or(Vec2::X, |table| table.at([x, top as f64 + y], metres))
            };
            let height = pixels.len() / width;
            let mut strip = Strip {
                sun_shadows: self,
                share: Share { medium, volume, stretches: Vec::new() },
                ray: &ray,
                means: &means,
                smallest,
                tolerance: spacing.tolerance,
                width,
                height,
                pixels,
                metres,
                left,
            };
            for x in (0..width).step_by(LARGEST) {
                strip.tile([x, 0], LARGEST);
            }
        });
    }
}

/// What a ray scatters where the sun doesn't reach it.
struct Share<'a, V> {
    medium: &'a Medium,
    volume: &'a V,
    /// Kept from ray to ray, so that none allocates.
    stretches: Vec<[f32; 2]>,
}

impl<V: RainPath> Share<'_, V> {
    /// Of all light that even rain without end would scatter, the shares that would come from stretches in shadow; the ray's length is
    /// `secant` times its planar depth, and `means` are its own up to a distance.
    fn of(
        &mut self,
        sun_shadows: &SunShadows<'_>,
        (ray, secant): (&Ray, f64),
        end: f64,
        means: impl Fn(f64) -> Vec2,
    ) -> Vec2 {
        let end = end.min(self.volume.farthest());
        let towards = sun_shadows.sun.towards;
        sun_shadows.town.find_shadows((ray.origin, ray.direction), towards, end, &mut self.stretches);
        share_of(&self.stretches, |metres| {
            let depth = self.medium.optical_depth_in(self.volume, ray, metres / secant, secant);
            means(metres) * -libm::expm1(-depth) as f32
        })
    }
}

/// What stretches of a ray scatter of all light, `upto(t)` of which its first t m do.
fn share_of(stretches: &[[f32; 2]], upto: impl Fn(f64) -> Vec2) -> Vec2 {
    let ends = stretches.iter().map(|ends| ends.map(f64::from));
    ends.map(|[from, to]| upto(to) - upto(from)).sum()
}

/// Some rows of a picture.
struct Strip<'a, V> {
    sun_shadows: &'a SunShadows<'a>,
    share: Share<'a, V>,
    /// The ray through a place of the picture, y from the strip's top, and its secant.
    ray: &'a (dyn Fn(f64, f64) -> (Ray, f64) + Sync),
    /// Means of the sun's light of that ray, up to a distance.
    means: &'a (dyn Fn([f64; 2], f64) -> Vec2 + Sync),
    smallest: usize,
    tolerance: f32,
    width: usize,
    height: usize,
    pixels: &'a mut [[f32; 3]],
    metres: &'a [f32],
    left: &'a [f32],
}

const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
/// Where shares between the corners are compared.
const CHECKS: [[f64; 2]; 5] = [[0.5, 0.5], [0.5, 0.0], [0.0, 0.5], [1.0, 0.5], [0.5, 1.0]];

/// What a tile's pixels have in common.
struct Extremes {
    /// Metres to the nearest and to the farthest thing.
    ends: [f32; 2],
    /// What the medium leaves at least and at most.
    left: [f32; 2],
    /// Of the pixel with least light, the mean of its colours, W/(m² sr).
    darkest: f32,
}

/// Shares at a tile's corners, of rays as long as to its nearest and to its farthest thing.
struct Corners {
    near: [Vec2; 4],
    far: [Vec2; 4],
    left: [f32; 2],
}

impl Corners {
    /// The share at a place of the tile, of a ray that leaves so much light: rays in even light lie evenly between.
    fn at(&self, place: [f32; 2], left: f32) -> Vec2 {
        let [least, most] = self.left;
        let far = between(&self.far, place);
        if most - least <= 0.0 {
            return far;
        }
        let near = between(&self.near, place);
        far + (near - far) * ((left - least) / (most - least)).clamp(0.0, 1.0)
    }
}

impl<V: RainPath> Strip<'_, V> {
    fn tile(&mut self, [x, y]: [usize; 2], size: usize) {
        let (right, bottom) = ((x + size).min(self.width), (y + size).min(self.height));
        if x >= right || y >= bottom {
            return;
        }
        let extremes = self.extremes([x, y], [right, bottom]);
        let place = |[u, v]: [f64; 2]| [x as f64 + u * size as f64, y as f64 + v * size as f64];
        let far = f64::from(extremes.ends[1]);
        let sunlight = |at: &[f64; 2]| self.sunlight(place(*at), (self.means)(place(*at), far));
        let brightest = CORNERS.iter().chain(&CHECKS[..1]).map(sunlight).fold(0.0, f32::max);
        // Where all of the sun's light doesn't show, its shadow doesn't.
        if brightest * (1.0 - extremes.left[0]) <= UNSEEN * extremes.darkest {
            return;
        }
        let allowed = [brightest.max(1e-30), self.tolerance * ALLOWED * extremes.darkest];
        if let Some(corners) = self.corners(&extremes, &place, ([right, bottom], allowed)) {
            for py in y..bottom {
                for px in x..right {
                    let own = [px - x, py - y].map(|off| (off as f32 + 0.5) / size as f32);
                    self.take([px, py], corners.at(own, self.left[py * self.width + px]));
                }
            }
        } else if size > self.smallest {
            let half = size / 2;
            [[0, 0], [half, 0], [0, half], [half, half]]
                .into_iter()
                .for_each(|[dx, dy]| self.tile([x + dx, y + dy], half));
        } else {
            for py in y..bottom {
                for px in x..right {
                    let metres = self.metres[py * self.width + px];
                    let share = self.share_at([px as f64 + 0.5, py as f64 + 0.5], metres);
                    self.take([px, py], share);
                }
            }
        }
    }

    /// The shares at a tile's corners, where they tell what is between within what is `allowed`.
    fn corners(
        &mut self,
        extremes: &Extremes,
        place: &dyn Fn([f64; 2]) -> [f64; 2],
        ([right, bottom], [brightest, allowed]): ([usize; 2], [f32; 2]),
    ) -> Option<Corners> {
        let ([near, far], [least, most]) = (extremes.ends, extremes.left);
        let is_even = (most - least) * brightest <= allowed;
        let far_shares = CORNERS.map(|at| self.share_at(place(at), far));
        let near_shares = match is_even {
            true => far_shares,
            false => CORNERS.map(|at| self.share_at(place(at), near)),
        };
        let corners = Corners {
            near: near_shares,
            far: far_shares,
            left: if is_even { [0.0; 2] } else { extremes.left },
        };
        let tells = |share: [f64; 2], strip: &mut Self| {
            let [px, py] = place(share);
            let at = (py as usize).min(bottom - 1) * strip.width + (px as usize).min(right - 1);
            let (metres, left) = (strip.metres[at], strip.left[at]);
            let wanted = strip.share_at([px, py], if is_even { far } else { metres });
            let off = (corners.at(share.map(|v| v as f32), left) - wanted).abs();
            strip.sunlight([px, py], off) <= allowed
        };
        CHECKS.iter().all(|&share| tells(share, self)).then_some(corners)
    }

    fn extremes(&self, [x, y]: [usize; 2], [right, bottom]: [usize; 2]) -> Extremes {
        let mut found = Extremes { ends: [f32::INFINITY, 0.0], left: [1.0, 0.0], darkest: f32::INFINITY };
        for row in y..bottom {
            for at in row * self.width + x..row * self.width + right {
                let ([near, far], [least, most]) = (found.ends, found.left);
                found.ends = [near.min(self.metres[at]), far.max(self.metres[at])];
                found.left = [least.min(self.left[at]), most.max(self.left[at])];
                let [r, g, b] = self.pixels[at];
                found.darkest = found.darkest.min((r + g + b) / 3.0);
            }
        }
        found
    }

    fn share_at(&mut self, [x, y]: [f64; 2], end: f32) -> Vec2 {
        let (ray, secant) = (self.ray)(x, y);
        if end.is_nan() || end <= 0.0 {
            return Vec2::ZERO;
        }
        let means = |metres: f64| (self.means)([x, y], metres);
        self.share.of(self.sun_shadows, (&ray, secant), f64::from(end), means)
    }

    /// What these shares show of the sun, the mean of its colours.
    fn sunlight(&self, [x, y]: [f64; 2], share: Vec2) -> f32 {
        let [r, g, b] = self.shown((self.ray)(x, y).0.direction, share);
        (r + g + b) / 3.0
    }

    fn shown(&self, direction: DVec3, share: Vec2) -> [f32; 3] {
        let values = self.share.medium.phase().values(direction.dot(self.sun_shadows.towards()));
        shown(&self.sun_shadows.sun, values, share)
    }

    /// Takes shares of the sun's light off a pixel.
    fn take(&mut self, [x, y]: [usize; 2], share: Vec2) {
        let at = y * self.width + x;
        let middle = [x as f64 + 0.5, y as f64 + 0.5];
        // A pixel has no more than what its own ray scatters.
        let most = (self.means)(middle, f64::from(self.metres[at])) * (1.0 - self.left[at]);
        let share = share.min(most).max(Vec2::ZERO);
        if share == Vec2::ZERO {
            return;
        }
        let shown = self.shown((self.ray)(middle[0], middle[1]).0.direction, share);
        for band in 0..3 {
            let pixel = &mut self.pixels[at][band];
            *pixel = (*pixel - shown[band]).max(0.0);
        }
    }
}

/// Shares at a place of a tile.
fn between(&[a, b, c, d]: &[Vec2; 4], [u, v]: [f32; 2]) -> Vec2 {
    let (top, bottom) = (a + u * (b - a), c + u * (d - c));
    top + v * (bottom - top)
}

#[cfg(test)]
mod tests;
