//! Mist over what rain strikes, seen where it stands before something else: halos at silhouettes, \[toyshop\] §3.4.
//!
//! | symbol | name | unit |
//! |---|---|---|
//! | Σ N v | `flux` | 1/(m² s) |
//! | n, d | droplets that a splash throws out, and their diameter ([`thrown`]) | –, m |
//! | u | `throw_m_per_s`: the droplets' speed upwards | m/s |
//! | h | u²/(3g), mean height of the mist: of u t − g t²/2 over the flight's 2u/g | m |
//!
//! Droplets stay in the air for 2u/g, so over a square metre hang Σ N v n 2u/g of them; their discs over the height h are the mist's extinction
//! σ = Σ N v n π d²/4 · 2u/(g h), thinning out upwards as e^{−z/h}. A ray that passes an edge at the height z and comes down on the surface at an angle a goes
//! through h/sin a of it, at most as far as the surface reaches. Where the scene's meshes are known mist stands on their fins; else on the edges
//! of depth.

mod edges;
mod fins;

use crate::error::RuntimeError;
use crate::random;
use crate::wet::controls::controls;
use crate::wet::drop::eye::{Eye, Spot};
use crate::wet::drop::light::{DropLight, LightControls, LightMemory};
use crate::wet::drop::{self, lightning_bias, milky};
use crate::wet::frame::{Layer, WetFrame};
use crate::wet::splash::hits::Fall;
use crate::wet::splash::thrown;
use glam::{DVec3, Vec3};
use std::f64::consts::FRAC_PI_4;

controls! {
    /// How mist at silhouettes looks.
    pub struct HaloControls {
        /// Factor on the mist's density: 1 is what droplets come to that are counted over deep water, rain on sheet metal and stone shows more.
        amount: 3.0, 0.0..=100.0, "", "";
        /// Speed at which splashes throw droplets up: mist stands as high as they are on the mean.
        throw_m_per_s: 1.1, 0.1..=5.0, "m/s", "";
        /// How far surfaces reach along a look past their edge.
        reach_m: 1.5, 0.01..=100.0, "m", "";
        /// How much the mist flickers with single drops' impacts.
        flicker: 1.0, 0.0..=1.0, "", "";
        /// Least step of depth that is an edge, where no fins are known.
        step_m: 0.25, 0.01..=100.0, "m", "";
        /// Depth of the film of water that drops fall on.
        film_mm: 0.2, 0.0..=10.0, "mm", "";
        /// Factor on light that mist scatters from the sun, lamps overhead and lightning, most of it where that is behind.
        back_light: 1.0, 0.0..=100.0, "", "";
        /// White in the mist.
        milk: 0.2, 0.0..=1.0, "", "milk";
        /// How much brighter mist is in lightning.
        contrast: 0.25, 0.0..=10.0, "", "k_c";
        /// Irradiance of lightning at its brightest, in the buffers' unit.
        flash: 10.0, 0.0..=1e6, "W/m2", "";
        /// Height of lamps overhead over the ground, by which the light map tells where they stand.
        lamp_height_m: 5.0, 0.5..=100.0, "m", "";
    }
}

/// What was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HaloReport {
    /// Fins that are silhouettes in the picture; 0 where edges of depth stand in for them.
    pub fins: u64,
    /// Pixels that an edge of depth begins at; 0 where fins are known.
    pub edges: u64,
    /// Pixels with mist, each as often as it has some.
    pub pixels: u64,
}

/// Heights of mist, h, beyond which it is left out.
const HIGHEST: f32 = 5.0;
/// Side of a cell of the mist's flicker, m, and its time, s.
const CELL_M: f64 = 0.06;
const FLICKER_S: f64 = 0.12;
const GRAVITY: f64 = 9.80665;

/// Halos, with the memory that is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Halos {
    light: LightMemory,
    columns: Vec<edges::Edge>,
}

/// The mist over a surface that the rain strikes squarely.
#[derive(Clone, Copy, Debug)]
struct Mist {
    /// Extinction at the surface, 1/m.
    extinction: f32,
    /// Mean height, m.
    height: f32,
    /// Impacts that feed one cell of the flicker.
    impacts: f64,
    /// Speed of the drops that feed it, m/s.
    speed: f64,
}

/// What drawing takes.
struct Brush<'a, 'b> {
    frame: &'a WetFrame<'b>,
    eye: &'a Eye,
    controls: &'a HaloControls,
    mist: Mist,
    fall: Fall<'a>,
    bias: f32,
}

/// Mean height of a droplet over its flight, m, that is thrown up at a speed, m/s: two thirds of the height that it comes to.
fn mean_height_m(speed: f64) -> f64 {
    speed * speed / (3.0 * GRAVITY)
}

impl Mist {
    fn new(frame: &WetFrame<'_>, controls: &HaloControls) -> Option<Self> {
        let (u, film) = (f64::from(controls.throw_m_per_s), f64::from(controls.film_mm) * 1e-3);
        let height = mean_height_m(u);
        let (mut discs, mut impacts, mut speeds) = (0.0, 0.0, 0.0);
        for drop in frame.flux.iter().filter(|drop| drop.impacts_per_m2_s > 0.0) {
            let out = thrown(drop, film);
            if out.count > 0.0 {
                discs += drop.impacts_per_m2_s * out.count * FRAC_PI_4 * out.diameter_m * out.diameter_m;
                impacts += drop.impacts_per_m2_s;
                speeds += drop.impacts_per_m2_s * drop.speed_m_per_s;
            }
        }
        let extinction = f64::from(controls.amount) * discs * 2.0 * u / (GRAVITY * height);
        (extinction > 0.0).then(|| Self {
            extinction: extinction as f32,
            height: height as f32,
            impacts: impacts * CELL_M * f64::from(controls.reach_m).min(1.0) * FLICKER_S,
            speed: speeds / impacts,
        })
    }
}

impl Halos {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Clears `out` and draws the mist at silhouettes. Needs depth; normals where there are no fins.
    ///
    /// # Errors
    ///
    /// Buffers of another size than the camera's, numbers of the frame outside what effects take, controls out of their ranges, a fin that is nowhere.
    pub fn draw(
        &mut self,
        frame: &WetFrame<'_>,
        controls: &HaloControls,
        out: &mut Layer,
    ) -> Result<HaloReport, RuntimeError> {
        drop::check(frame)?;
        controls.check()?;
        fins::check(&frame.maps.fins)?;
        out.clear(frame.buffer.size);
        let mut report = HaloReport::default();
        let Some(mist) = Mist::new(frame, controls) else { return Ok(report) };
        let eye = Eye::new(frame.camera);
        let lights =
            LightControls { flash: controls.flash, lamp_height_m: controls.lamp_height_m, paper: false };
        let mut light = self.light.prepare(frame, &eye, &lights);
        let bias = lightning_bias(controls.contrast, frame.lightning);
        let brush = Brush { frame, eye: &eye, controls, mist, fall: Fall::new(frame), bias };
        if frame.maps.fins.is_empty() {
            brush.edges(&mut self.columns, &mut light, out, &mut report);
        } else {
            brush.fins(&mut light, out, &mut report);
        }
        Ok(report)
    }
}

impl Brush<'_, '_> {
    /// Colour of mist at a place, before opacity.
    fn colour(&self, light: &mut DropLight<'_>, place: DVec3, spot: &Spot, direction: Vec3) -> Vec3 {
        let beams = light.beams(place, direction) * self.controls.back_light;
        milky((light.ball(spot).mean() + beams) * self.bias, self.controls.milk)
    }

    /// Share of the rain that a surface with this normal gets, over a level one in still air.
    fn struck(&self, normal: Vec3) -> f32 {
        let wind = self.frame.wind;
        let fall = DVec3::new(wind.x, wind.y, -self.mist.speed);
        (-(fall.dot(normal.as_dvec3())) / self.mist.speed).max(0.0) as f32
    }

    /// Optical thickness over a surface at the height 0, for a look whose angle to the surface has this sine.
    fn thickness(&self, sine: f32) -> f32 {
        self.mist.extinction * self.controls.reach_m.min(self.mist.height / sine.abs().max(1e-3))
    }

    /// How dense the mist is at a place of an edge over its mean, and how high over its mean: by cells of the world and slots of time.
    fn flicker(&self, along: [f64; 2]) -> f32 {
        if self.controls.flicker <= 0.0 {
            return 1.0;
        }
        let spread = f64::from(self.controls.flicker) / self.mist.impacts.max(1.0).sqrt();
        let at = [along[0] / CELL_M, along[1] / CELL_M, self.frame.time_s / FLICKER_S];
        let low = at.map(libm::floor);
        let part = [0, 1, 2].map(|k| at[k] - low[k]);
        let mut sum = 0.0;
        for corner in 0..8u32 {
            let step = [0, 1, 2].map(|k| corner >> k & 1);
            let weight: f64 = (0..3).map(|k| if step[k] == 1 { part[k] } else { 1.0 - part[k] }).product();
            let cell = [0, 1, 2].map(|k| (low[k] as i64 + i64::from(step[k])) as u64);
            let bits = random::mix(
                random::mix(cell[0] ^ self.frame.seed) ^ cell[1].rotate_left(21) ^ cell[2].rotate_left(42),
            );
            // An even number between 0 and 2 has the variance 1/3; sums of eight have less.
            let value = (bits >> 11) as f64 / (1u64 << 52) as f64;
            sum += weight * value;
        }
        (1.0 + spread * 2.5 * (sum - 1.0)).max(0.0) as f32
    }
}

#[cfg(test)]
mod tests;
