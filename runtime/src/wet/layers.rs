//! Rainfall as layers over the picture, \[toyshop\] §3.1: the paper's full-screen pass, a baseline beside rain whose drops have places in the world.
//!
//! A pixel at (x, y), across the rain's direction and along it, looks up the placement of drops at
//!
//! q = ((x, y) − v̂ |v| T)/w, w = p_r r > 0,
//!
//! where T is the time since the beginning: the paper prints Δt, which has to accumulate, and v where its unit vector v̂ is meant. Each layer has its own w: as with
//! a projective texture, what has a larger one is larger, nearer and faster. Placement is a texture of 8 bits, a byte a drop, which says whether the rain is
//! strong enough for it; its repeats are shifted by a hash, without which the view shows the same drops again ([`LayerControls::shift`] 0, the paper's).
//! A drop lies wholly in its texel, so that shifts cut none.
//!
//! How many drops a layer has follows the flux: as many as the air holds between the layer's two depths.

#[cfg(feature = "gpu")]
pub mod card;

use crate::error::RuntimeError;
use crate::random::{Random, mix};
use crate::wet::controls::controls;
use crate::wet::drop::eye::{Eye, Spot};
use crate::wet::drop::light::{DropLight, LightControls, LightMemory};
use crate::wet::drop::{self, Opacity, Weather, glint, lightning_bias, milky};
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::material::{WATER_INDEX, fresnel};
use glam::{DVec2, DVec3, Vec2};

controls! {
    /// How layers of rain look.
    pub struct LayerControls {
        /// Distance of the nearest layer; each further one is twice as far.
        near_m: 0.7, 0.1..=100.0, "m", "p_r";
        /// Number of layers.
        layers: 3.0, 1.0..=6.0, "", "r_i";
        /// Factor on the drops' number.
        amount: 1.0, 0.0..=10.0, "", "";
        /// Factor on the drops' width.
        size: 1.0, 0.1..=20.0, "", "";
        /// Time that a shutter is open: drops are as long as they fall in it.
        exposure_ms: 4.0, 0.1..=100.0, "ms", "";
        /// 1 shifts the texture's repeats by a hash, 0 repeats it as the paper does.
        shift: 1.0, 0.0..=1.0, "", "";
        /// Above ½ water looks as the paper prints it, a baseline: rays are bent once and don't come out again, opacity grows with the distance.
        paper: 0.0, 0.0..=1.0, "", "";
        /// Opacity of the water.
        opacity: 1.0, 0.0..=1.0, "", "alpha";
        /// Opacity that reflecting edges add.
        edge_strength: 0.6, 0.0..=10.0, "", "e_s";
        /// Opacity where nothing is reflected.
        edge_bias: 0.9, 0.0..=10.0, "", "e_b";
        /// How much a drop's velocity blurs what it shows.
        blur: 1.0, 0.0..=4.0, "", "";
        /// Factor on light that drops scatter from the sun, lamps overhead and lightning.
        back_light: 1.0, 0.0..=100.0, "", "";
        /// White in the water.
        milk: 0.2, 0.0..=1.0, "", "milk";
        /// How much brighter and clearer drops are in lightning.
        contrast: 0.25, 0.0..=10.0, "", "k_c";
        /// Irradiance of lightning at its brightest, in the buffers' unit.
        flash: 10.0, 0.0..=1e6, "W/m2", "";
        /// Height of lamps overhead over the ground, by which the light map tells where they stand.
        lamp_height_m: 5.0, 0.5..=100.0, "m", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LayerReport {
    /// Layers.
    pub layers: u64,
    /// Pixels that their drops touched, each as often as it was.
    pub pixels: u64,
}

/// Texels of the placement along an axis: 2⁸.
const SIDE: i64 = 256;
/// Drops in a cubic metre at which every texel of the placement has one: beyond any rain's drops of a millimetre and more.
const MOST_PER_M3: f64 = 2500.0;
/// Smallest drop that makes a streak, m.
const LEAST_M: f64 = 1e-3;
/// Pixels along the side of a block that has one light.
const BLOCK: usize = 16;
/// Share of a texel's height that a drop's way may take.
const LONGEST: f32 = 0.8;

/// Layers of rain, with the placement of drops and the memory that is kept from frame to frame.
#[derive(Clone, Debug)]
pub struct Layers {
    placement: Vec<u8>,
    light: LightMemory,
}

/// What drawing takes.
struct Brush<'a, 'b> {
    frame: &'a WetFrame<'b>,
    eye: &'a Eye,
    controls: &'a LayerControls,
}

/// One layer, ready.
#[derive(Clone, Copy, Debug)]
struct Sheet {
    depth: f32,
    /// Texel's width and height, px.
    cell: Vec2,
    /// How far the layer has fallen, texels: whole ones, and the rest.
    fallen: (i64, f32),
    /// Half a drop's width and its way, px.
    radius: f32,
    way: f32,
    /// Bytes below this are drops.
    threshold: u32,
    key: u64,
}

impl Default for Layers {
    fn default() -> Self {
        Self::new(0)
    }
}

/// The paper's texture coordinates as it prints them, \[toyshop\] §3.1: v |v| Δt over w = p_r r, for the rain's velocity v in the picture. The velocity counts twice, and as Δt is
/// one frame's, drops stand still; from w = 0 nothing comes.
pub fn paper_coordinates(velocity: Vec2, step_s: f32, parallax: f32, distribution: f32) -> Vec2 {
    velocity * velocity.length() * step_s / (parallax * distribution)
}

impl Layers {
    /// Draws the placement of drops; another seed is another rain.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::from_parts(&[seed, 0x4C41_5952]);
        let placement = (0..SIDE * SIDE).map(|_| random.below(256) as u8).collect();
        Self { placement, light: LightMemory::default() }
    }

    /// The byte of a texel of one layer; texels beyond the texture's edges are those of its repeats.
    fn byte(&self, key: u64, x: i64, y: i64) -> u32 {
        let shift = if key == 0 { 0 } else { mix(mix(key ^ (x >> 8) as u64) ^ (y >> 8) as u64) };
        let [x, y] = [x.wrapping_add(shift as i64 & 0xFF), y.wrapping_add(shift as i64 >> 8 & 0xFF)];
        u32::from(self.placement[((y & (SIDE - 1)) * SIDE + (x & (SIDE - 1))) as usize])
    }

    /// Clears `out` and draws layers of rain, each before what lies behind it. Needs depth.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, numbers of the frame outside what effects take, or controls out of their ranges.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &LayerControls,
        out: &mut Layer,
    ) -> Result<LayerReport, RuntimeError> {
        drop::check(frame)?;
        controls.check()?;
        out.clear(frame.buffer.size);
        let mut report = LayerReport::default();
        let eye = Eye::new(frame.camera);
        let Some((along, sheets)) = sheets(&frame.weather(), &eye, controls) else { return Ok(report) };
        let mut light = std::mem::take(&mut self.light);
        let lights = LightControls {
            flash: controls.flash,
            lamp_height_m: controls.lamp_height_m,
            paper: controls.paper > 0.5,
        };
        let mut now = light.prepare(frame, &eye, &lights);
        let brush = Brush { frame, eye: &eye, controls };
        for sheet in sheets.iter().rev() {
            report.pixels += self.sheet(&brush, (along, sheet), &mut now, out);
            report.layers += 1;
        }
        self.light = light;
        Ok(report)
    }

    fn sheet(
        &self,
        &Brush { frame, eye, controls }: &Brush<'_, '_>,
        (along, sheet): (Vec2, &Sheet),
        light: &mut DropLight<'_>,
        out: &mut Layer,
    ) -> u64 {
        let across = Vec2::new(along.y, -along.x);
        let middle = Vec2::new(0.5 * eye.size[0] as f32, 0.5 * eye.size[1] as f32);
        let opacity = Opacity {
            edge_strength: controls.edge_strength,
            edge_bias: controls.edge_bias,
            distance: 1.0,
            lightning_bias: lightning_bias(controls.contrast, frame.lightning),
            paper_m: (controls.paper > 0.5).then_some(sheet.depth),
        };
        let blur = controls.blur * drop::velocity_blur(sheet.way, sheet.radius);
        let mut touched = 0;
        let step = Vec2::new(across.x / sheet.cell.x, along.x / sheet.cell.y);
        // Neighbours in a row are mostly of one texel, whose drop is looked up once; light once a block.
        let mut texel = ([i64::MAX; 2], None);
        let mut known = vec![None; eye.size[0].div_ceil(BLOCK) * eye.size[1].div_ceil(BLOCK)];
        for y in 0..eye.size[1] {
            let at = Vec2::new(0.5 - middle.x, middle.y - y as f32 - 0.5);
            let begin = [at.dot(across) / sheet.cell.x, at.dot(along) / sheet.cell.y - sheet.fallen.1];
            let mut next = 0;
            while next < eye.size[0] {
                let x = next;
                next += 1;
                let q = Vec2::new(begin[0] + step.x * x as f32, begin[1] + step.y * x as f32);
                let low = [q.x as i64 - i64::from(q.x < 0.0), q.y as i64 - i64::from(q.y < 0.0)];
                if texel.0 != low {
                    let cell = [low[0], low[1] - sheet.fallen.0];
                    let drop = self.byte(sheet.key, cell[0], cell[1]) < sheet.threshold;
                    texel = (low, drop.then(|| sheet.drop(cell)));
                }
                let part = Vec2::new(q.x - low[0] as f32, q.y - low[1] as f32);
                let Some(one) = &texel.1 else {
                    next += leave(part.x, step.x).min(leave(part.y, step.y));
                    continue;
                };
                let Some((flat, share)) = sheet.covers(one, part) else { continue };
                let pixel = y * eye.size[0] + x;
                if frame.buffer.depth_m[pixel] < sheet.depth {
                    continue;
                }
                let turned = across * flat.x + along * flat.y;
                let cosine = (1.0 - turned.length_squared()).max(0.0).sqrt();
                let reflected = fresnel(f64::from(cosine), WATER_INDEX) as f32;
                let alpha = opacity.of(share * controls.opacity, reflected);
                if alpha < 1e-3 {
                    continue;
                }
                let block = y / BLOCK * eye.size[0].div_ceil(BLOCK) + x / BLOCK;
                let beams = *known[block].get_or_insert_with(|| {
                    // At its middle, whichever of its drops is met first.
                    let middle = [x, y].map(|at| (at / BLOCK * BLOCK + BLOCK / 2) as f32);
                    let offset = eye.at(middle[0], middle[1], sheet.depth);
                    let place: DVec3 = eye.position + offset.as_dvec3();
                    let (beams, from) = light.beams_from(place, eye.towards(offset));
                    (beams * controls.back_light, from)
                });
                let spot = Spot { x: x as f32, y: y as f32, depth: sheet.depth };
                let shown = light.ball(&spot).radiance(turned, blur) + beams.0 * glint(turned, beams.1);
                let colour = milky(shown * opacity.lightning_bias, controls.milk);
                out.over(pixel, (colour * alpha).into(), alpha);
                touched += 1;
            }
        }
        touched
    }
}

/// Whole steps that stay in a texel, from a part of it.
fn leave(part: f32, step: f32) -> usize {
    let room = if step > 0.0 { 1.0 - part } else { part };
    // Less one, as round-off must not step over the next texel's first pixel.
    (room / step.abs().max(1e-6) - 1.0).max(0.0) as usize
}

/// A texel's drop: its middle in the texel, its half width as it is and as it is drawn, px.
#[derive(Clone, Copy, Debug)]
struct Streak {
    middle: Vec2,
    radius: f32,
    drawn: f32,
}

impl Sheet {
    /// The drop of a texel.
    fn drop(&self, cell: [i64; 2]) -> Streak {
        let bits = mix(self.key ^ mix(cell[0] as u64) ^ (cell[1] as u64).rotate_left(32));
        let number = |shift: u32| (bits >> shift & 0xFFFF) as f32 / 65536.0;
        // Drops differ: wide ones are rare.
        let radius = self.radius * (0.7 + 0.9 * number(0) * number(16));
        let drawn = radius.max(0.5);
        let long = 0.5 * self.way + drawn;
        let room = Vec2::new(1.0 - 2.0 * drawn / self.cell.x, 1.0 - 2.0 * long / self.cell.y).max(Vec2::ZERO);
        Streak { middle: Vec2::splat(0.5) + (Vec2::new(number(32), number(48)) - 0.5) * room, radius, drawn }
    }

    /// At a part of a texel: the normal's lean across and along the way, and the share of the shutter's time that the drop is there.
    fn covers(&self, drop: &Streak, part: Vec2) -> Option<(Vec2, f32)> {
        let at = (part - drop.middle) * self.cell / drop.drawn;
        if at.x.abs() >= 1.0 {
            return None;
        }
        let (share, normals) = drop::covered(at.x, at.y, self.way / drop.drawn)?;
        let edge = ((1.0 - at.x.abs()) * drop.drawn + 0.25).clamp(0.0, 1.0);
        let flat = Vec2::new(at.x, 0.5 * (normals[0] + normals[1])).clamp_length_max(0.999);
        let thin = drop.radius / drop.drawn;
        Some((flat, share * edge * thin * thin.max(0.3)))
    }
}

/// The rain's direction in the picture, and its layers, the nearest first; `None` where no rain is.
fn sheets(frame: &Weather<'_>, eye: &Eye, controls: &LayerControls) -> Option<(Vec2, Vec<Sheet>)> {
    let large = || frame.flux.iter().filter(|drop| drop.diameter_m >= LEAST_M && drop.speed_m_per_s > 0.1);
    let number: f64 = large().map(|drop| drop.impacts_per_m2_s / drop.speed_m_per_s).sum();
    let flux: f64 = large().map(|drop| drop.impacts_per_m2_s).sum();
    let share = f64::from(controls.amount) * number / MOST_PER_M3;
    if share.is_nan() || share <= 0.0 {
        return None;
    }
    let speed = flux / number;
    let width = large().map(|drop| drop.impacts_per_m2_s * drop.diameter_m).sum::<f64>() / flux;
    let velocity = DVec3::new(frame.wind.x, frame.wind.y, -speed);
    let seen = DVec2::new(velocity.dot(eye.right.as_dvec3()), velocity.dot(eye.up.as_dvec3()));
    let along = seen.try_normalize().unwrap_or(DVec2::NEG_Y);
    let layers = controls.layers as usize;
    let sheet = |k: usize| {
        let depth = controls.near_m * (1u32 << k) as f32;
        let per_metre = eye.pixels_per_metre(depth);
        let fall = seen.length() as f32 * per_metre;
        let radius = 0.5 * width as f32 * controls.size * per_metre;
        let way = (fall * controls.exposure_ms * 1e-3).max(1e-3);
        // The layer stands for depths from depth/√2 to √2 depth; a texel is as wide as makes every one hold a drop at the most rain there is.
        let tall = (way + 2.0 * radius).max(2.0) / LONGEST;
        let held = MOST_PER_M3 * f64::from(depth * depth * depth) * (2.828_427 - 0.353_553) / 3.0;
        let per_pixel = held / f64::from(eye.pixels_per_metre(1.0) * eye.pixels_per_metre(1.0));
        let wide = (1.0 / (per_pixel * f64::from(tall))) as f32;
        // Where drops would lie over one another a texel holds no more than one.
        let cell = Vec2::new(wide.max(2.0 * radius.max(0.5) + 1.0), tall);
        let crowded = (cell.x / wide).min(2.0);
        // y grows along the fall: what is seen at y now was higher before.
        let fallen = frame.time_s * f64::from(fall) / f64::from(tall);
        let whole = libm::floor(fallen);
        Sheet {
            depth,
            cell,
            fallen: (whole as i64, (fallen - whole) as f32),
            radius,
            way,
            threshold: (256.0 * share.min(1.0) * f64::from(crowded)).min(256.0) as u32,
            key: if controls.shift >= 0.5 { mix(frame.seed ^ (k as u64 + 1)) | 1 } else { 0 },
        }
    };
    Some((along.as_vec2(), (0..layers).map(sheet).collect()))
}

#[cfg(test)]
mod tests;
