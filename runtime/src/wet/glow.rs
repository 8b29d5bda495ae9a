//! Glow around lights in rain: the atmosphere's point spread, and \[toyshop\] §6.2's blur after Kawase as a baseline.
//!
//! Light of a pixel of radiance L that stands at optical depth T is scattered into the directions around it. A pixel of solid angle Ω is a point of
//! intensity L Ω d²; the medium shows I β² M of it at an angle α beside it ([`crate::airlight`] once, [`crate::point_spread`] more often), which is
//! L Ω T² M(T, α): a kernel K(T, α) = T² M, 1/sr, whose integral is the share of the light that comes scattered. The picture is
//! split by depth; each part is blurred by a mixture of kernels of doubling width that has K's energy in every ring.
//!
//! Mist, beside the rain, dims what is behind it as it scatters: e^{−β d} is left, and the world's light scattered towards the eye comes in its place. The
//! sky, whose distance no buffer tells, is taken to have its mist in it.
//!
//! Light below a threshold is left out: the world's even light is in the rain's medium already. The lens's own bloom is [`crate::tone::bloom`].
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | β | extinction of rain and mist | 1/m |
//! | T | optical depth from the eye | – |

#[cfg(feature = "gpu")]
pub mod card;

use crate::airlight::{Airlight, PointBeside};
use crate::error::RuntimeError;
use crate::medium::{Medium, Phase};
use crate::parallel::prelude::*;
use crate::picture::Picture;
use crate::point_spread::PointSpread;
use crate::tone::bloom::{add_doubled, halve, halved};
use crate::wet::controls::controls;
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::reflect::view::View;
use crate::world::{InScattering, WorldLight};
use glam::Vec3;
use squall_formats::drops::Optics;
use squall_formats::units::MillimetresPerHour;

controls! {
    /// How lights glow.
    pub struct GlowControls {
        /// Factor on the glow; 1 is physical.
        strength: 1.0, 0.0..=100.0, "", "";
        /// Extinction of mist and spray beside the rain's own, which dims by it and scatters it: 3 is a kilometre of sight.
        mist: 1.0, 0.0..=100.0, "1/km", "";
        /// Light above so many times the world's mean glows.
        threshold: 4.0, 0.0..=1e6, "", "";
        /// Distance of lights in the sky, and of the farthest place whose mist counts: as far as rain reaches.
        sky: 1000.0, 1.0..=1e6, "m", "";
        /// Above ½, the glow is a blur after Kawase.
        paper: 0.0, 0.0..=1.0, "", "";
        /// Passes of that blur, each wider by a pixel of half the picture.
        paper_passes: 5.0, 1.0..=16.0, "", "";
        /// How much of the blurred light is added.
        paper_amount: 0.25, 0.0..=10.0, "", "";
    }
}

/// Optical depths at which kernels are worked out; light between two is shared by them.
const DEPTHS: [f64; 6] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0];
/// Kernels of doubling width.
const LEVELS: usize = 9;
/// Radius, in pixels of its level, that a kernel's ring begins at.
const RING: f64 = 0.55;
/// Pixels between places of the picture at which mist's own light is looked up.
const NODES_PX: usize = 16;
/// Points of a ring's midpoint rule.
const POINTS: usize = 12;

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GlowReport {
    /// Pixels of half the size that glow.
    pub sources: usize,
}

/// Glow of frames; keeps its tables between them.
#[derive(Default)]
pub struct Glow {
    tables: Option<(Airlight, PointSpread)>,
    world: Option<(WorldLight, InScattering)>,
}

impl Glow {
    /// Nothing kept yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Draws the glow of `picture`'s lights, which is the frame's light before any rain is before it.
    ///
    /// Errors: a picture or buffers of another size than the camera's.
    pub fn draw(
        &mut self,
        (frame, picture): (&WetFrame<'_>, &[[f32; 3]]),
        controls: &GlowControls,
        out: &mut Layer,
    ) -> Result<GlowReport, RuntimeError> {
        frame.check()?;
        let size = frame.buffer.size;
        if picture.len() != size[0] * size[1] {
            return Err(RuntimeError::argument(
                "picture",
                format!("{} pixels", size[0] * size[1]),
                picture.len(),
            ));
        }
        out.clear(size);
        if frame.rate_mm_per_h.partial_cmp(&0.0).is_none_or(|order| order.is_le()) {
            return Ok(GlowReport::default());
        }
        let rain = Medium::geometric(MillimetresPerHour(frame.rate_mm_per_h)).extinction().0;
        let extinction = rain + f64::from(controls.mist) * 1e-3;
        if controls.paper <= 0.5 {
            self.mist(frame, controls, out);
        }
        let least = frame.light.mean_radiance().map(|value| value * controls.threshold);
        let half = [halved(size[0]), halved(size[1])];
        let classes = if controls.paper > 0.5 { 1 } else { DEPTHS.len() };
        let mut parts = vec![Picture::new(half[0], half[1])?; classes];
        let mut report = GlowReport::default();
        let mut lit = vec![false; classes];
        for (at, picture_at) in (0..half[0] * half[1]).map(|at| (at, (at % half[0], at / half[0]))) {
            let Some((light, depth)) = source((frame, picture), picture_at, least) else { continue };
            report.sources += 1;
            let thickness = extinction * f64::from(depth.min(controls.sky));
            let (low, share, scale) = if classes == 1 { (0, 0.0, 1.0) } else { class_of(thickness) };
            for (class, share) in [(low, 1.0 - share), ((low + 1).min(classes - 1), share)] {
                if share > 0.0 {
                    let share = share * scale;
                    (0..3).for_each(|band| parts[class].pixels[at][band] += share * light[band]);
                    lit[class] = true;
                }
            }
        }
        if report.sources == 0 {
            return Ok(report);
        }
        let glow = if controls.paper > 0.5 {
            let blurred = kawase(&parts[0], controls.paper_passes as usize);
            scaled(blurred, controls.paper_amount)
        } else {
            let focal = frame.camera.pixels_per_metre();
            let lit: Vec<(usize, &Picture)> =
                parts.iter().enumerate().filter(|(class, _)| lit[*class]).collect();
            scaled(self.spread(&lit, focal, half)?, controls.strength)
        };
        // Back to the picture's own size.
        let mist = Picture { width: size[0], height: size[1], pixels: std::mem::take(&mut out.light) };
        out.light = add_doubled(&mist, 1.0, &glow).pixels;
        Ok(report)
    }

    /// What mist leaves of the light behind it, and what it shows of the world's.
    fn mist(&mut self, frame: &WetFrame<'_>, controls: &GlowControls, out: &mut Layer) {
        let extinction = controls.mist * 1e-3;
        if extinction <= 0.0 {
            return;
        }
        let world = match self.world.take() {
            Some(known) if known.0 == *frame.light => known,
            _ => {
                let phase = Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry);
                (frame.light.clone(), frame.light.in_scattering(&phase))
            }
        };
        let view = View::new(frame.camera);
        let [width, height] = out.size;
        // The world's scattered light is smooth: looked up at nodes, and between them told by those.
        let across = width.div_ceil(NODES_PX) + 1;
        let nodes = nodes_of_mist(&view, &world.1, [across, height.div_ceil(NODES_PX) + 1]);
        let rows = out.light.par_chunks_mut(width).zip(out.alpha.par_chunks_mut(width)).enumerate();
        rows.for_each(|(y, (light, alpha))| {
            let part = |at: usize| ((at % NODES_PX) as f32 + 0.5) / NODES_PX as f32;
            let (first, down) = (y / NODES_PX * across, part(y));
            for (x, (light, alpha)) in light.iter_mut().zip(alpha).enumerate() {
                let depth = frame.buffer.depth_m[y * width + x];
                // The sky's light has come through all the mist that there is: nobody knows from how far.
                if !(depth > 0.0 && depth.is_finite()) {
                    continue;
                }
                let slant = if view.is_parallel() { 1.0 } else { view.place(x, y, 1.0).length() };
                let hidden = 1.0 - libm::expf(-extinction * (depth * slant).min(controls.sky));
                let (left, along) = (first + x / NODES_PX, part(x));
                let at = |column: usize| nodes[column].lerp(nodes[column + across], down);
                *alpha = hidden;
                *light = (at(left).lerp(at(left + 1), along) * hidden).into();
            }
        });
        self.world = Some(world);
    }

    /// Every class's light through its own kernel.
    fn spread(
        &mut self,
        lit: &[(usize, &Picture)],
        focal: f64,
        half: [usize; 2],
    ) -> Result<Picture, RuntimeError> {
        let phase = Phase::HenyeyGreenstein(Optics::GEOMETRIC.asymmetry);
        let (once, more) =
            self.tables.get_or_insert_with(|| (Airlight::new(&phase), PointSpread::new(&phase)));
        let mut sums: Vec<Picture> = Vec::new();
        for (class, part) in lit {
            let weights = ring_energies(DEPTHS[*class], 0.5 * focal, (once, more));
            let mut level = (*part).clone();
            for (number, weight) in weights.into_iter().enumerate() {
                if number > 0 {
                    level = halve(&level);
                }
                if sums.len() <= number {
                    sums.push(Picture::new(level.width, level.height)?);
                }
                let pixels = sums[number].pixels.iter_mut().zip(&level.pixels);
                pixels
                    .for_each(|(sum, light)| (0..3).for_each(|band| sum[band] += weight[band] * light[band]));
                if level.width < 2 && level.height < 2 {
                    break;
                }
            }
        }
        let mut spread = sums.pop().map_or_else(|| Picture::new(half[0], half[1]), Ok)?;
        while let Some(fine) = sums.pop() {
            spread = add_doubled(&fine, 1.0, &spread);
        }
        Ok(spread)
    }
}

/// The world's light that mist scatters towards the eye at so many nodes across and down.
fn nodes_of_mist(view: &View, world: &InScattering, [across, down]: [usize; 2]) -> Vec<Vec3> {
    let node = |node: usize| {
        let corner = [node % across, node / across].map(|at| (at * NODES_PX) as f32);
        let ray = if view.is_parallel() { Vec3::Z } else { view.ray(corner) };
        let light = world.radiance(view.to_world(ray.normalize_or(Vec3::Z)).as_dvec3());
        Vec3::from_array(light).max(Vec3::ZERO)
    };
    (0..across * down).map(node).collect()
}

/// Light above the threshold of two by two pixels, in the mean, and the depth of the brightest.
fn source(
    (frame, picture): (&WetFrame<'_>, &[[f32; 3]]),
    (x, y): (usize, usize),
    least: [f32; 3],
) -> Option<([f32; 3], f32)> {
    let [width, height] = frame.buffer.size;
    let (mut sum, mut brightest) = ([0.0f32; 3], (0.0f32, f32::INFINITY));
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let at = (2 * y + dy).min(height - 1) * width + (2 * x + dx).min(width - 1);
        let over: [f32; 3] = std::array::from_fn(|band| {
            let over = picture[at][band] - least[band];
            if over > 0.0 && over.is_finite() { 0.25 * over } else { 0.0 }
        });
        let total = over[0] + over[1] + over[2];
        if total > brightest.0 {
            let depth = frame.buffer.depth_m[at];
            brightest = (total, if depth > 0.0 { depth } else { f32::INFINITY });
        }
        (0..3).for_each(|band| sum[band] += over[band]);
    }
    (brightest.0 > 0.0).then_some((sum, brightest.1))
}

/// The class below an optical depth, the share of the one above, and what of its kernel is left: thinner than the first class, light is scattered once,
/// in proportion to depth.
fn class_of(thickness: f64) -> (usize, f32, f32) {
    let last = DEPTHS.len() - 1;
    let above = DEPTHS.iter().position(|&depth| depth > thickness).unwrap_or(last).max(1);
    let place = |depth: f64| libm::log(depth);
    let (low, high) = (place(DEPTHS[above - 1]), place(DEPTHS[above]));
    let share = (place(thickness.clamp(DEPTHS[0], DEPTHS[last])) - low) / (high - low);
    (above - 1, share as f32, (thickness / DEPTHS[0]).clamp(0.0, 1.0) as f32)
}

/// K at an optical depth and angle, 1/sr per colour.
fn kernel(depth: f64, angle: f64, (once, more): (&Airlight, &PointSpread)) -> [f64; 3] {
    let (sin, cos) = libm::sincos(angle);
    let beside = PointBeside { h: depth * sin, foot: depth * cos, end: f64::INFINITY };
    let (one, rest) = (once.of_point(1.0, &beside), more.lookup_seen(depth, libm::sin(0.5 * angle)));
    std::array::from_fn(|band| depth * depth * (one[band] + rest[band]))
}

/// Energy of K in the rings of kernels of doubling width, `focal` pixels a radian; the first has all that is nearer.
fn ring_energies(depth: f64, focal: f64, tables: (&Airlight, &PointSpread)) -> [[f32; 3]; LEVELS] {
    std::array::from_fn(|level| {
        let radius = |number: usize| RING * (1u32 << number) as f64 / focal;
        let (from, to) = (if level == 0 { 0.0 } else { radius(level) }, radius(level + 1));
        let mut sum = [0.0; 3];
        for point in 0..POINTS {
            let tangent = from + (to - from) * (point as f64 + 0.5) / POINTS as f64;
            // A flat picture's ring: dω = 2π t dt / (1 + t²)^{3/2}.
            let secant = 1.0 + tangent * tangent;
            let ring =
                std::f64::consts::TAU * tangent * (to - from) / POINTS as f64 / (secant * secant.sqrt());
            let value = kernel(depth, libm::atan(tangent), tables);
            (0..3).for_each(|band| sum[band] += value[band] * ring);
        }
        sum.map(|value| value as f32)
    })
}

fn scaled(mut picture: Picture, factor: f32) -> Picture {
    picture.pixels.iter_mut().flatten().for_each(|value| *value *= factor);
    picture
}

/// Kawase's blur as \[toyshop\] §6.2 has it: each pass takes the mean of four looks between pixels, a pixel further out than the last. Weights of each pass
/// sum to 1.
pub fn kawase(picture: &Picture, passes: usize) -> Picture {
    let mut now = picture.clone();
    for pass in 0..passes {
        let before = now.clone();
        let (width, height) = (before.width, before.height);
        // A look half a pixel beyond is the mean of two by two.
        let reach = pass as isize;
        let at = |x: isize, y: isize| {
            let x = x.clamp(0, width as isize - 1) as usize;
            let y = y.clamp(0, height as isize - 1) as usize;
            before.pixels[y * width + x]
        };
        for y in 0..height as isize {
            for x in 0..width as isize {
                let mut sum = [0.0f32; 3];
                for (sx, sy) in [(-1, -1), (1, -1), (-1, 1), (1, 1)] {
                    for (ex, ey) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                        let pixel = at(x + sx * (reach + ex), y + sy * (reach + ey));
                        (0..3).for_each(|band| sum[band] += pixel[band] * 0.0625);
                    }
                }
                now.pixels[y as usize * width + x as usize] = sum;
            }
        }
    }
    now
}

/// Share of light that the paper's linear fog leaves, \[toyshop\] §6.2: all of it up to `start` m, none from `end` on. It is not Beer–Lambert's: what is in
/// fog falls exponentially, without a beginning and without an end.
pub fn paper_fog(distance_m: f32, start_m: f32, end_m: f32) -> f32 {
    if end_m <= start_m {
        return if distance_m < start_m { 1.0 } else { 0.0 };
    }
    ((end_m - distance_m) / (end_m - start_m)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests;
