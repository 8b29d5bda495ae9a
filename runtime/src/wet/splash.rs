//! Splashes where drops hit what a frame shows, \[toyshop\] §3.3: as many as the rain's flux Σ N v says, in their places of the world.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | Σ N v | `flux`: drops that come down, by size | 1/(m² s) |
//! | R | crater radius, (D³v²/(3g))^¼, what a splash is measured by | m |
//! | K | splash number; drops below it spread without a splash | – |
//!
//! Where a splash covers a few pixels it is drawn, from a synthesised sequence with a flip, a size and an opacity of its own. Farther away splashes
//! are the mean of what would be drawn: each class gives way to its own mean over an octave of distance, so that nothing pops and no light is lost.

mod haze;
pub(crate) mod hits;
pub(crate) mod impact;
mod sequence;

pub use impact::{Thrown, life_s, splash_number, splashes, thrown};

use crate::error::RuntimeError;
use crate::wet::controls::controls;
use crate::wet::drop::eye::Eye;
use crate::wet::drop::light::{DropLight, LightControls, LightMemory};
use crate::wet::drop::{self, Opacity, lightning_bias, milky};
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::surface::nodes::Nodes;
use glam::Vec2;
use hits::{Class, Columns, Fall, Hit};
use sequence::Sequence;

controls! {
    /// How splashes look.
    pub struct SplashControls {
        /// Factor on a splash's size.
        size: 1.0, 0.1..=10.0, "", "";
        /// How much sizes differ, as a share of the mean.
        size_spread: 0.35, 0.0..=0.9, "", "";
        /// Opacity of the water.
        opacity: 1.0, 0.0..=1.0, "", "alpha";
        /// How much opacities differ, as a share of the mean.
        opacity_spread: 0.4, 0.0..=0.9, "", "";
        /// Opacity that reflecting edges add.
        edge_strength: 0.5, 0.0..=10.0, "", "e_s";
        /// Opacity where nothing is reflected.
        edge_bias: 0.9, 0.0..=10.0, "", "e_b";
        /// Factor on light that splashes scatter from the sun, lamps overhead and lightning, most of it where that is behind them.
        back_light: 1.0, 0.0..=100.0, "", "";
        /// White in the water.
        milk: 0.2, 0.0..=1.0, "", "milk";
        /// How much brighter and clearer splashes are in lightning.
        contrast: 0.25, 0.0..=10.0, "", "k_c";
        /// Depth of the film of water that drops fall on.
        film_mm: 0.2, 0.0..=10.0, "mm", "";
        /// Splashes whose pictures are this wide or smaller are haze.
        smallest_px: 3.0, 1.0..=64.0, "px", "";
        /// Factor on the haze of far splashes.
        haze: 1.0, 0.0..=10.0, "", "";
        /// Irradiance of lightning at its brightest, in the buffers' unit.
        flash: 10.0, 0.0..=1e6, "W/m2", "";
        /// Height of lamps overhead over the ground, by which the light map tells where they stand.
        lamp_height_m: 5.0, 0.5..=100.0, "m", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SplashReport {
    /// Splashes drawn one by one.
    pub splashes: u64,
    /// Pixels that they touched, each as often as it was.
    pub pixels: u64,
    /// Pixels of haze.
    pub haze_pixels: u64,
}

/// Splashes, with what is kept from frame to frame: the sequence, and memory.
///
/// ```
/// use squall_runtime::wet::splash::Splashes;
/// let splashes = Splashes::new();
/// # let _ = splashes;
/// ```
#[derive(Clone, Debug)]
pub struct Splashes {
    sequence: Sequence,
    columns: Columns,
    light: LightMemory,
    found: Vec<Found>,
    far: Nodes<haze::Far>,
}

/// A splash to draw.
#[derive(Clone, Debug)]
struct Found {
    hit: Hit,
    radius: f32,
    weight: f32,
    share_of_life: f32,
}

/// One class of drops that splash.
#[derive(Clone, Copy, Debug)]
struct Kind {
    class: usize,
    life_s: f64,
    radius: f32,
}

impl Default for Splashes {
    fn default() -> Self {
        Self::new()
    }
}

/// Share of splashes of one class that are drawn, where their pictures are so many pixels wide: none at `smallest`, all from twice that on.
fn drawn(width_px: f32, smallest: f32) -> f32 {
    let share = (width_px / smallest - 1.0).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

impl Splashes {
    /// Makes the sequence: some tens of milliseconds.
    pub fn new() -> Self {
        let (columns, light, found, far) = Default::default();
        Self { sequence: Sequence::bake(), columns, light, found, far }
    }

    /// Clears `out` and draws the splashes of a frame's time into it. Needs depth and normals; surfaces under `maps.height_m` and where `wettable` is 0 have none.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, numbers of the frame outside what effects take, or controls out of their ranges.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &SplashControls,
        out: &mut Layer,
    ) -> Result<SplashReport, RuntimeError> {
        drop::check(frame)?;
        controls.check()?;
        out.clear(frame.buffer.size);
        let mut report = SplashReport::default();
        let kinds = kinds(frame, controls);
        if kinds.is_empty() {
            return Ok(report);
        }
        let eye = Eye::new(frame.camera);
        let far =
            |kind: &Kind| sequence::WIDTH * kind.radius * eye.pixels_per_metre(1.0) / controls.smallest_px;
        let farthest = kinds.iter().map(far).fold(0.0, f32::max);
        self.columns.read(frame.buffer, &eye, farthest, false);
        let fall = Fall::new(frame);
        self.found.clear();
        for kind in &kinds {
            let drop = &frame.flux[kind.class];
            let class =
                Class { drop, stream: kind.class as u64, life_s: kind.life_s, far_m: far(kind), fall: &fall };
            let found = &mut self.found;
            self.columns.hits(frame, &eye, &class, |hit| {
                let width = sequence::WIDTH * kind.radius * eye.pixels_per_metre(hit.spot.depth);
                let weight = drawn(width, controls.smallest_px);
                if weight > 0.0 {
                    let share_of_life = (hit.age_s / kind.life_s) as f32;
                    found.push(Found { hit: hit.clone(), radius: kind.radius, weight, share_of_life });
                }
            });
        }
        self.found.sort_by(|a, b| b.hit.spot.depth.total_cmp(&a.hit.spot.depth));
        let lights =
            LightControls { flash: controls.flash, lamp_height_m: controls.lamp_height_m, paper: false };
        let mut light = self.light.prepare(frame, &eye, &lights);
        let brush = Brush { frame, eye: &eye, controls, sequence: &self.sequence };
        if controls.haze > 0.0 {
            report.haze_pixels = brush.haze(&kinds, &fall, &mut self.far, &mut light, out);
        }
        for found in &mut self.found {
            report.pixels += brush.splash(found, &mut light, out);
            report.splashes += 1;
        }
        Ok(report)
    }
}

/// Classes that splash at all.
fn kinds(frame: &WetFrame<'_>, controls: &SplashControls) -> Vec<Kind> {
    let film = f64::from(controls.film_mm) * 1e-3;
    let splashing = frame
        .flux
        .iter()
        .enumerate()
        .filter(|(_, drop)| drop.impacts_per_m2_s > 0.0 && impact::splashes(drop, film));
    let kind = |(class, drop): (usize, &crate::wet::ripples::DropFlux)| Kind {
        class,
        life_s: impact::life_s(drop),
        radius: drop.crater_radius_m() as f32 * controls.size,
    };
    splashing.map(kind).filter(|_| controls.opacity > 0.0).collect()
}

/// What drawing takes.
struct Brush<'a, 'b> {
    frame: &'a WetFrame<'b>,
    eye: &'a Eye,
    controls: &'a SplashControls,
    sequence: &'a Sequence,
}

impl Brush<'_, '_> {
    fn opacity(&self) -> Opacity {
        Opacity {
            edge_strength: self.controls.edge_strength,
            edge_bias: self.controls.edge_bias,
            distance: 1.0,
            lightning_bias: lightning_bias(self.controls.contrast, self.frame.lightning),
            paper_m: None,
        }
    }

    /// The picture's direction, to the right and up, in which the world's up points.
    fn upright(&self) -> Vec2 {
        Vec2::new(self.eye.right.z, self.eye.up.z).try_normalize().unwrap_or(Vec2::Y)
    }

    /// Draws one splash; returns pixels touched.
    fn splash(&self, found: &mut Found, light: &mut DropLight<'_>, out: &mut Layer) -> u64 {
        let (eye, controls) = (self.eye, self.controls);
        let Found { hit, radius, weight, share_of_life } = found;
        let mut own = |spread: f32| 1.0 + spread * hit.random.range(-1.0, 1.0) as f32;
        let (radius, strength) =
            (*radius * own(controls.size_spread), *weight * own(controls.opacity_spread));
        let (flip, variant) = if hit.random.unit() < 0.5 { (-1.0, 0) } else { (1.0, 1) };
        let variant = variant + hit.random.below(2) as usize;
        let spot = hit.spot;
        let side = sequence::WIDTH * radius * eye.pixels_per_metre(spot.depth);
        let direction = eye.towards(hit.offset);
        let (view, share) = sequence::between_views((-direction.z).max(0.0));
        // Of a few pixels no one tells two elevations from their mix.
        let (view, share) = if side < MIXED_PX && share > 0.5 { (view + 1, 0.0) } else { (view, share) };
        let share = if side < MIXED_PX { 0.0 } else { share };
        let level = libm::roundf(libm::log2f((sequence::SIDE as f32 / side).max(1.0)));
        let clips = [view, view + 1].map(|view| {
            self.sequence.clip(variant, view.min(sequence::VIEWS - 1), *share_of_life, level as usize)
        });
        let blur = libm::roundf(0.7 * level);
        let (opacity, fresnel) = (self.opacity(), light.fresnel);
        let beams = light.beams_from(hit.place, direction);
        let beams = (beams.0 * controls.back_light, beams.1);
        let ball = light.ball(&spot);
        let up = self.upright();
        let right = Vec2::new(up.y, -up.x);
        let bounds = [view, view + 1]
            .map(|view| self.sequence.bounds(variant, view.min(sequence::VIEWS - 1), *share_of_life));
        let [rows, columns] =
            cover(eye, &spot, [right * flip, up], side, &bounds[..1 + usize::from(share > 0.0)]);
        let nearest = spot.depth - 2.2 * radius;
        let mut touched = 0;
        for y in rows {
            for x in columns.clone() {
                let at = Vec2::new(x as f32 + 0.5 - spot.x, spot.y - y as f32 - 0.5) / side;
                let [u, v] =
                    [0.5 + flip * at.dot(right), 1.0 - sequence::BELOW / sequence::WIDTH - at.dot(up)];
                let first = clips[0].at(u, v);
                let texel = if share > 0.0 { first.lerp(clips[1].at(u, v), share) } else { first };
                let pixel = y * eye.size[0] + x;
                if texel.z < 0.004 || self.frame.buffer.depth_m[pixel] < nearest {
                    continue;
                }
                let flat = (Vec2::new(flip * texel.x, texel.y) / texel.z).clamp_length_max(1.0);
                let turned = right * flat.x + up * flat.y;
                let cosine = (1.0 - turned.length_squared()).max(0.0).sqrt();
                let reflected = fresnel.at(cosine);
                let alpha = opacity.of(texel.z * controls.opacity * strength, reflected);
                let glint = drop::glint(turned, beams.1);
                let colour = (ball.radiance(turned, blur) + beams.0 * glint) * opacity.lightning_bias;
                out.over(pixel, (milky(colour, controls.milk) * alpha).into(), alpha);
                touched += 1;
            }
        }
        touched
    }
}

/// Splashes of fewer pixels show one elevation.
const MIXED_PX: f32 = 12.0;
/// Where the place of impact lies in a picture, from its top.
const BASE: f32 = 1.0 - sequence::BELOW / sequence::WIDTH;

/// Rows and columns of the frame in which a splash at a spot has water, from the parts of its pictures that have; `axes` are the pictures' right and up.
fn cover(
    eye: &Eye,
    spot: &drop::eye::Spot,
    axes: [Vec2; 2],
    side: f32,
    bounds: &[[f32; 4]],
) -> [std::ops::Range<usize>; 2] {
    let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
    for part in bounds {
        for corner in [[0, 1], [2, 1], [0, 3], [2, 3]] {
            let at = side * (axes[0] * (part[corner[0]] - 0.5) + axes[1] * (BASE - part[corner[1]]));
            let at = Vec2::new(spot.x + at.x, spot.y - at.y);
            (low, high) = (low.min(at), high.max(at));
        }
    }
    let span = |low: f32, high: f32, most: usize| {
        let begin = low.max(0.0) as usize;
        begin..((high + 1.0).clamp(0.0, most as f32) as usize).max(begin)
    };
    [span(low.y, high.y, eye.size[1]), span(low.x, high.x, eye.size[0])]
}

#[cfg(test)]
mod tests;
